//! Worlds drawn for trials, and whether there is a way through them at all.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::grid::{GridGeometry, Layer, Position};
use crate::sensor::Pose;
use crate::soil::SoilClass;
use crate::vehicle::Vehicle;

use super::noise::{Noise, Stream};
use super::{Mover, NoGo, Obstacle, Shape, SimError, World, require};

/// What a drawn world is a trial of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScenarioKind {
    /// Crates all over.
    Clutter,
    /// One corridor through a wall, crates on both sides.
    Corridor,
    /// A pocket of three walls between start and goal, open to the start.
    UTrap,
    /// A long passage that is closed at its end, and a gap elsewhere.
    DeadEnd,
    /// Crates, and people who cross.
    Moving,
}

/// A drawn world with where to go.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// The truth.
    pub world: World,
    /// Where the robot begins.
    pub start: Pose,
    /// Where it is to go.
    pub goal: Position,
}

/// Half the side of a drawn world in metres.
const HALF_M: f64 = 20.0;

/// Distance in metres around start and goal that is left free.
const FREE_M: f64 = 1.5;

/// Draws a world of 40 x 40 m around the origin, level gravel, the start in the west and the goal in the east. `density` is
/// crates of 0.4 to 1.2 m per 100 m². Draws do not check that there is a way: ask [`passable`].
///
/// # Errors
/// [`SimError::Figure`] when the density is not from 0 to 50.
pub fn random_world(seed: u64, density: f64, kind: ScenarioKind) -> Result<Scenario, SimError> {
    require(
        "density of crates",
        density,
        (0.0..=50.0).contains(&density),
        "0 to 50 per 100 m² is allowed",
    )?;
    let geometry = GridGeometry::new(80, 80, 0.5, -HALF_M, HALF_M)?;
    let soil = Layer::filled(geometry, SoilClass::Gravel as u8);
    let mut world = World::new(Layer::filled(geometry, 0.0), soil, 20.0)?;
    let noise = Noise::new(seed);
    let [across, aside, width, side] = noise.units(Stream::World, 0, 0);
    let (start, goal) = (
        Position::new(-15.0, 6.0 * across - 3.0),
        Position::new(15.0, 6.0 * aside - 3.0),
    );
    let mut walls: Vec<Vec<(f64, f64)>> = Vec::new();
    match kind {
        ScenarioKind::Clutter | ScenarioKind::Moving => {}
        ScenarioKind::Corridor => {
            let (half, middle) = (1.0 + width, 16.0 * side - 8.0);
            walls.push(vec![
                (-4.0, HALF_M),
                (-4.0, middle + half),
                (4.0, middle + half),
                (4.0, HALF_M),
            ]);
            walls.push(vec![
                (-4.0, -HALF_M),
                (-4.0, middle - half),
                (4.0, middle - half),
                (4.0, -HALF_M),
            ]);
        }
        ScenarioKind::UTrap => {
            let (half, depth) = (3.0 + 3.0 * width, 3.0 + 4.0 * side);
            walls.push(vec![
                (4.0 - depth, half),
                (4.0, half),
                (4.0, -half),
                (4.0 - depth, -half),
            ]);
        }
        ScenarioKind::DeadEnd => {
            let (half, far) = (1.5 + width, if side < 0.5 { 1.0 } else { -1.0 });
            walls.push(vec![(-8.0, half), (4.0, half), (4.0, -half), (-8.0, -half)]);
            // The gap lies at one edge of the map; the other side is walled up to it.
            walls.push(vec![(4.0, half * far), (4.0, 14.0 * far)]);
            walls.push(vec![(4.0, -half * far), (4.0, -HALF_M * far)]);
        }
    }
    let mut obstacles: Vec<Obstacle> = walls
        .into_iter()
        .map(|points| Obstacle {
            shape: Shape::Wall(points.into_iter().map(|(x, y)| Position::new(x, y)).collect()),
            height_m: 2.0,
        })
        .collect();
    let crates = (density * (2.0 * HALF_M).powi(2) / 100.0).round() as u64;
    for count in 1..=crates {
        let [x, y, turn, length] = noise.units(Stream::World, count, 0);
        let centre = Position::new(HALF_M * (2.0 * x - 1.0), HALF_M * (2.0 * y - 1.0));
        let width_m = 0.4 + 0.8 * noise.units(Stream::World, count, 1)[0];
        let shape = Shape::rectangle(centre, 0.4 + 0.8 * length, width_m, std::f64::consts::PI * turn);
        if shape.distance_m(start) > FREE_M && shape.distance_m(goal) > FREE_M {
            obstacles.push(Obstacle { shape, height_m: 0.8 });
        }
    }
    world.place(obstacles)?;
    if kind == ScenarioKind::Moving {
        let walk = |n: u32| {
            let [from, to, speed, phase] = noise.units(Stream::World, 0, 1 + n);
            let x = |share: f64| 20.0 * share - 10.0;
            Mover {
                path: vec![Position::new(x(from), -12.0), Position::new(x(to), 12.0)],
                speed_mps: 0.3 + 0.7 * speed,
                radius_m: 0.3,
                start_m: 24.0 * phase,
            }
        };
        world.set_in_motion((0..6).map(walk).collect())?;
    }
    Ok(Scenario {
        world,
        start: Pose::level(start.x_m, start.y_m, 0.0),
        goal,
    })
}

/// Side of the cells of the search in metres.
const CELL_M: f64 = 0.1;

/// Margin in metres around the vehicle.
const MARGIN_M: f64 = 0.1;

/// Most cells that are searched.
const MOST_CELLS: f64 = 25_000_000.0;

/// The length in metres of a way for the vehicle's circle, 0.1 m wider, from start to goal, or `None`: the truth that trials are
/// judged by. It is a plain search of cells of 0.1 m (coarser in worlds above 500 m), apart from every planner. What moves is
/// left out. Ground that is too steep in every direction, too weak, unknown or outside is closed.
pub fn passable(world: &World, vehicle: &Vehicle, start: Position, goal: Position) -> Option<f64> {
    let map = world.geometry();
    let (width_m, height_m) = (
        map.columns() as f64 * map.cell_size_m(),
        map.rows() as f64 * map.cell_size_m(),
    );
    let size_m = CELL_M.max((width_m * height_m / MOST_CELLS).sqrt());
    let count = |length_m: f64| (length_m / size_m).ceil().max(1.0) as usize;
    let fine = GridGeometry::new(count(height_m), count(width_m), size_m, map.west_m(), map.north_m()).ok()?;
    let open = open_cells(world, vehicle, fine);
    let [start, goal] = [start, goal].map(|place| fine.cell_at(place).map(|cell| fine.index(cell)));
    let (start, goal) = (start?, goal?);
    if !open[start] || !open[goal] {
        return None;
    }
    // Costs in thousandths of a cell, so that the queue is of whole numbers.
    let mut least = vec![u64::MAX; open.len()];
    let mut queue = BinaryHeap::from([Reverse((0u64, start))]);
    least[start] = 0;
    while let Some(Reverse((cost, index))) = queue.pop() {
        if index == goal {
            return Some(cost as f64 / 1000.0 * size_m);
        }
        if cost > least[index] {
            continue;
        }
        let cell = fine.cell(index);
        for (rows, columns) in [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)] {
            let Some(next) = fine.offset(cell, rows, columns) else {
                continue;
            };
            let next = fine.index(next);
            let further = cost + if rows == 0 || columns == 0 { 1000 } else { 1414 };
            if open[next] && further < least[next] {
                least[next] = further;
                queue.push(Reverse((further, next)));
            }
        }
    }
    None
}

fn open_cells(world: &World, vehicle: &Vehicle, fine: GridGeometry) -> Vec<bool> {
    let reach_m = vehicle.circumscribed_radius_m() + MARGIN_M;
    // On a flat world all cells of one soil are alike; ground is asked once per terrain cell.
    let map = world.geometry();
    let ground: Vec<bool> = map.cells().map(|cell| fit(world, vehicle, map.centre(cell))).collect();
    let mut open: Vec<bool> = fine
        .cells()
        .map(|cell| {
            map.cell_at(fine.centre(cell))
                .is_some_and(|cell| ground[map.index(cell)])
        })
        .collect();
    for obstacle in world.obstacles() {
        if obstacle.height_m <= vehicle.step_height_m {
            continue;
        }
        let [west, south, east, north] = obstacle.shape.bounds();
        let (low_row, low_column) = fine.fractional(Position::new(west - reach_m, north + reach_m));
        let (high_row, high_column) = fine.fractional(Position::new(east + reach_m, south - reach_m));
        for row in low_row.max(0.0) as usize..(high_row.ceil().max(0.0) as usize).min(fine.rows()) {
            for column in low_column.max(0.0) as usize..(high_column.ceil().max(0.0) as usize).min(fine.columns()) {
                let cell = crate::grid::Cell::new(row, column);
                if obstacle.shape.distance_m(fine.centre(cell)) <= reach_m {
                    open[fine.index(cell)] = false;
                }
            }
        }
    }
    open
}

/// Whether the ground at a place lets the vehicle pass in some direction.
fn fit(world: &World, vehicle: &Vehicle, at: Position) -> bool {
    (0..8).any(|eighth| {
        let heading_rad = f64::from(eighth) * std::f64::consts::FRAC_PI_4;
        let Ok(ground) = world.ground_under(vehicle, &Pose::level(at.x_m, at.y_m, heading_rad)) else {
            return false;
        };
        let fares = crate::soil::Trafficability::of(vehicle, ground.soil, world.moisture_percent());
        let grade = ground.pitch_rad.tan();
        fares.go
            && grade <= vehicle.grade_up
            && -grade <= vehicle.grade_down
            && ground.roll_rad.tan().abs() <= vehicle.max_side_slope()
    })
}

impl Scenario {
    /// Why the vehicle must not even stand at the start; `None` where it may.
    pub fn start_no_go(&self, vehicle: &Vehicle) -> Option<NoGo> {
        self.world.no_go(vehicle, &self.start, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::fixtures::{pioneer, tractor};
    use rstest::rstest;

    fn ways(scenario: &Scenario, vehicle: &Vehicle) -> Option<f64> {
        let start = Position::new(scenario.start.x_m, scenario.start.y_m);
        passable(&scenario.world, vehicle, start, scenario.goal)
    }

    #[rstest]
    #[case(ScenarioKind::Clutter)]
    #[case(ScenarioKind::Corridor)]
    #[case(ScenarioKind::UTrap)]
    #[case(ScenarioKind::DeadEnd)]
    #[case(ScenarioKind::Moving)]
    fn drawn_worlds_repeat_by_seed_and_most_have_a_way(#[case] kind: ScenarioKind) {
        let mut found = 0;
        for seed in 0..8 {
            let [one, two] = [(); 2].map(|()| random_world(seed, 2.5, kind).unwrap());
            assert_eq!(one.world.obstacles(), two.world.obstacles());
            assert_eq!(one.world.movers(), two.world.movers());
            let other = random_world(seed + 100, 2.5, kind).unwrap();
            assert_ne!(one.world.obstacles(), other.world.obstacles());
            assert!(
                one.start_no_go(&pioneer())
                    .is_none_or(|reason| reason != NoGo::Obstacle)
            );
            let straight_m = Position::new(one.start.x_m, one.start.y_m).distance_m(one.goal);
            if let Some(length_m) = ways(&one, &pioneer()) {
                assert!(length_m > straight_m - 0.5, "{length_m} {straight_m}");
                found += 1;
            }
        }
        assert!(found >= 6, "{kind:?}: {found} of 8");
    }

    #[test]
    fn traps_cost_a_detour_and_walls_close() {
        let trap = random_world(1, 0.0, ScenarioKind::UTrap).unwrap();
        let straight_m = Position::new(trap.start.x_m, trap.start.y_m).distance_m(trap.goal);
        assert!(ways(&trap, &pioneer()).unwrap() > straight_m + 0.5);
        // The corridor is at most 4 m wide: too narrow for the tractor's circle.
        let corridor = random_world(1, 0.0, ScenarioKind::Corridor).unwrap();
        assert!(ways(&corridor, &pioneer()).is_some());
        assert_eq!(ways(&corridor, &tractor()), None);
        assert!(random_world(1, f64::NAN, ScenarioKind::Clutter).is_err());
    }

    #[test]
    fn a_gap_counts_to_the_centimetre_of_its_cells() {
        let geometry = GridGeometry::new(20, 20, 0.5, -5.0, 5.0).unwrap();
        let wide_m = 2.0 * (pioneer().circumscribed_radius_m() + MARGIN_M);
        for (gap_m, expected) in [(wide_m - 0.02, false), (wide_m + 0.25, true)] {
            let soil = Layer::filled(geometry, SoilClass::Gravel as u8);
            let mut world = World::new(Layer::filled(geometry, 0.0), soil, 20.0).unwrap();
            let wall = |from: f64, to: f64| Obstacle {
                shape: Shape::Wall(vec![Position::new(0.0, from), Position::new(0.0, to)]),
                height_m: 1.0,
            };
            world
                .place(vec![wall(-5.0, -gap_m / 2.0), wall(gap_m / 2.0, 5.0)])
                .unwrap();
            let way = passable(&world, &pioneer(), Position::new(-3.0, 0.0), Position::new(3.0, 0.0));
            assert_eq!(way.is_some(), expected, "{gap_m}");
        }
    }
}
