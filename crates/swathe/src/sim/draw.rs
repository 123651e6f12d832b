//! Worlds drawn for trials.

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

/// Distance in metres that crates keep from the paths of what moves.
const LANE_M: f64 = 0.6;

/// Distance in metres of the wall around a world from its edge.
const FENCE_M: f64 = 0.25;

/// Draws a world of 40 x 40 m around the origin, level gravel with a wall around it, the start in the west and the goal in the
/// east. `density` is crates of 0.4 to 1.2 m per 100 m². `scale` makes the world with all lengths in it larger, for larger vehicles;
/// people stay as they are. Draws do not check that there is a way: ask [`super::passable`].
///
/// # Errors
/// [`SimError::Figure`] when the density is not from 0 to 50 or the scale not from 1 to 20.
pub fn random_world(seed: u64, density: f64, kind: ScenarioKind, scale: f64) -> Result<Scenario, SimError> {
    require("scale", scale, (1.0..=20.0).contains(&scale), "1 to 20 is allowed")?;
    require(
        "density of crates",
        density,
        (0.0..=50.0).contains(&density),
        "0 to 50 per 100 m² is allowed",
    )?;
    let geometry = GridGeometry::new(80, 80, 0.5 * scale, -HALF_M * scale, HALF_M * scale)?;
    let soil = Layer::filled(geometry, SoilClass::Gravel as u8);
    let mut world = World::new(Layer::filled(geometry, 0.0), soil, 20.0)?;
    let noise = Noise::new(seed);
    let [across, aside, width, side] = noise.units(Stream::World, 0, 0);
    let (start, goal) = (
        Position::new(-15.0, 6.0 * across - 3.0),
        Position::new(15.0, 6.0 * aside - 3.0),
    );
    let mut walls = walls_of(kind, width, side);
    let edge = HALF_M - FENCE_M;
    walls.push(vec![
        (-edge, -edge),
        (edge, -edge),
        (edge, edge),
        (-edge, edge),
        (-edge, -edge),
    ]);
    let scaled = |(x, y): (f64, f64)| Position::new(scale * x, scale * y);
    let mut obstacles: Vec<Obstacle> = walls
        .into_iter()
        .map(|points| Obstacle {
            shape: Shape::Wall(points.into_iter().map(scaled).collect()),
            height_m: 2.0 * scale,
        })
        .collect();
    let movers = if kind == ScenarioKind::Moving {
        people(noise, scale)
    } else {
        Vec::new()
    };
    let lanes: Vec<Shape> = movers.iter().map(|mover| Shape::Wall(mover.path.clone())).collect();
    let crates = (density * (2.0 * HALF_M).powi(2) / 100.0).round() as u64;
    for count in 1..=crates {
        let [x, y, turn, length] = noise.units(Stream::World, count, 0);
        let centre = Position::new(HALF_M * (2.0 * x - 1.0), HALF_M * (2.0 * y - 1.0));
        let width_m = 0.4 + 0.8 * noise.units(Stream::World, count, 1)[0];
        let length_m = 0.4 + 0.8 * length;
        let shape = Shape::rectangle(
            scaled((centre.x_m, centre.y_m)),
            scale * length_m,
            scale * width_m,
            std::f64::consts::PI * turn,
        );
        let keeps_away = |from: Position| shape.distance_m(scaled((from.x_m, from.y_m))) > FREE_M * scale;
        let room_m = LANE_M + scale * length_m.hypot(width_m) / 2.0;
        let in_lane = lanes.iter().any(|lane| lane.distance_m(shape.middle()) < room_m);
        if keeps_away(start) && keeps_away(goal) && !in_lane {
            obstacles.push(Obstacle {
                shape,
                height_m: 0.8 * scale,
            });
        }
    }
    world.place(obstacles)?;
    world.set_in_motion(movers)?;
    Ok(Scenario {
        world,
        start: Pose::level(scale * start.x_m, scale * start.y_m, 0.0),
        goal: scaled((goal.x_m, goal.y_m)),
    })
}

/// Walls of a kind of world; the two numbers from 0 to 1 draw their measures.
fn walls_of(kind: ScenarioKind, width: f64, side: f64) -> Vec<Vec<(f64, f64)>> {
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
    walls
}

/// People who cross between start and goal, to and fro.
fn people(noise: Noise, scale: f64) -> Vec<Mover> {
    let walk = |n: u32| {
        let [from, to, speed, phase] = noise.units(Stream::World, 0, 1 + n);
        let x_m = |share: f64| scale * (20.0 * share - 10.0);
        Mover {
            path: vec![
                Position::new(x_m(from), -12.0 * scale),
                Position::new(x_m(to), 12.0 * scale),
            ],
            speed_mps: 0.3 + 0.7 * speed,
            radius_m: 0.3,
            start_m: 24.0 * scale * phase,
        }
    };
    (0..6).map(walk).collect()
}

impl Scenario {
    /// Why the vehicle must not even stand at the start; `None` where it may.
    pub fn start_no_go(&self, vehicle: &Vehicle) -> Option<NoGo> {
        self.world.no_go(vehicle, &self.start, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::passable;
    use super::*;
    use crate::vehicle::fixtures::{pioneer, tractor};
    use rstest::rstest;

    fn ways(scenario: &Scenario, vehicle: &Vehicle) -> Option<f64> {
        passable(&scenario.world, vehicle, &scenario.start, scenario.goal)
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
            let [one, two] = [(); 2].map(|()| random_world(seed, 2.5, kind, 1.0).unwrap());
            assert_eq!(one.world.obstacles(), two.world.obstacles());
            assert_eq!(one.world.movers(), two.world.movers());
            let other = random_world(seed + 100, 2.5, kind, 1.0).unwrap();
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
        let trap = random_world(1, 0.0, ScenarioKind::UTrap, 1.0).unwrap();
        let straight_m = Position::new(trap.start.x_m, trap.start.y_m).distance_m(trap.goal);
        assert!(ways(&trap, &pioneer()).unwrap() > straight_m + 0.5);
        // The tractor's circle is wider than the corridor, its rectangle is not.
        let corridor = random_world(1, 0.0, ScenarioKind::Corridor, 1.0).unwrap();
        assert!(ways(&corridor, &pioneer()).is_some());
        assert!(ways(&corridor, &tractor()).is_some_and(|length_m| length_m > 30.0));
        assert!(random_world(1, f64::NAN, ScenarioKind::Clutter, 1.0).is_err());
    }
}
