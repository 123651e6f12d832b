//! Whether there is a way through a world at all, by a search of poses that shares no code with any planner.
//!
//! The vehicle's rectangle, 0.1 m wider on every side, must be free of whatever stands at every pose. A vehicle that turns in place
//! moves along sixteen directions between the cells of a lattice and turns from one to the next; one with a turning circle drives
//! arcs of its least radius and straights, forwards and backwards, with one pose kept for a cell and heading. What moves is left
//! out. Ground that is too steep in every direction, too weak, unknown or outside is closed. A way that is found is one; a
//! narrow one may be missed between the cells of the lattice.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::{FRAC_PI_4, PI, TAU};

use crate::grid::{Cell, GridGeometry, Position};
use crate::sensor::{Pose, wrap};
use crate::soil::Trafficability;
use crate::vehicle::Vehicle;

use super::{Footprint, World};

/// A way for a vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    /// Metres driven, forwards and backwards.
    pub length_m: f64,
    /// Poses along it, from the start on.
    pub poses: Vec<Pose>,
}

/// Margin in metres around the vehicle.
const MARGIN_M: f64 = 0.1;

/// Side of the lattice's cells in metres, or this share of the vehicle's width where that is more.
const CELL_M: f64 = 0.1;
const CELL_SHARE: f64 = 0.2;

/// Most cells of the lattice; larger worlds get larger cells.
const MOST_CELLS: f64 = 4_000_000.0;

/// Distance to the goal that counts as there, in metres.
const ARRIVAL_M: f64 = 0.3;

/// Steps (columns, rows down) of the eight axes along which a vehicle that turns in place moves to and fro.
const AXES: [(i32, i32); 8] = [(1, 0), (2, -1), (1, -1), (1, -2), (0, -1), (-1, -2), (-1, -1), (-2, -1)];

/// Headings that are told apart for a vehicle with a turning circle.
const HEADINGS: usize = 64;

/// Costs are whole tenths of millimetres, so that the queue is of whole numbers.
const UNITS: f64 = 10_000.0;

/// The shortest way that the search finds from a pose to within 0.3 m of the goal, in any heading there; `None` when it finds none.
pub fn way(world: &World, vehicle: &Vehicle, start: &Pose, goal: Position) -> Option<Way> {
    let truth = Truth::new(world, vehicle)?;
    if !truth.is_free(start) {
        return None;
    }
    truth.fine.cell_at(goal)?;
    let to_go = truth.distances(goal);
    if vehicle.min_turn_radius_m > 0.0 {
        truth.drive(start, goal, &to_go)
    } else {
        truth.walk(start, goal, &to_go)
    }
}

/// The length in metres of [`way`].
pub fn passable(world: &World, vehicle: &Vehicle, start: &Pose, goal: Position) -> Option<f64> {
    way(world, vehicle, start, goal).map(|way| way.length_m)
}

struct Truth<'a> {
    world: &'a World,
    vehicle: &'a Vehicle,
    fine: GridGeometry,
    /// From the centre of every cell to what stands nearest, as far as it matters.
    near_m: Vec<f32>,
    /// Whether the ground of every terrain cell carries the vehicle in some direction.
    ground: Vec<bool>,
}

/// What a search keeps of a state.
#[derive(Clone, Copy)]
struct Node {
    cost: u64,
    pose: (f64, f64, f64),
    from: u32,
}

const NOBODY: u32 = u32::MAX;

impl<'a> Truth<'a> {
    fn new(world: &'a World, vehicle: &'a Vehicle) -> Option<Self> {
        let map = world.geometry();
        let (width_m, height_m) = (
            map.columns() as f64 * map.cell_size_m(),
            map.rows() as f64 * map.cell_size_m(),
        );
        let size_m = CELL_M
            .max(CELL_SHARE * vehicle.width_m)
            .max((width_m * height_m / MOST_CELLS).sqrt());
        let count = |length_m: f64| (length_m / size_m).ceil().max(1.0) as usize;
        let fine = GridGeometry::new(count(height_m), count(width_m), size_m, map.west_m(), map.north_m()).ok()?;
        let reach_m = vehicle.circumscribed_radius_m() + 2.0 * MARGIN_M + 2.0 * size_m;
        let mut near_m = vec![reach_m as f32; fine.cell_count()];
        for obstacle in world.obstacles() {
            if obstacle.height_m <= vehicle.step_height_m {
                continue;
            }
            let [west, south, east, north] = obstacle.shape.bounds();
            let (low_row, low_column) = fine.fractional(Position::new(west - reach_m, north + reach_m));
            let (high_row, high_column) = fine.fractional(Position::new(east + reach_m, south - reach_m));
            for row in low_row.max(0.0) as usize..(high_row.ceil().max(0.0) as usize).min(fine.rows()) {
                for column in low_column.max(0.0) as usize..(high_column.ceil().max(0.0) as usize).min(fine.columns()) {
                    let cell = Cell::new(row, column);
                    let near_m = &mut near_m[fine.index(cell)];
                    *near_m = near_m.min(obstacle.shape.distance_m(fine.centre(cell)) as f32);
                }
            }
        }
        let ground = map
            .cells()
            .map(|cell| carries(world, vehicle, map.centre(cell)))
            .collect();
        Some(Self {
            world,
            vehicle,
            fine,
            near_m,
            ground,
        })
    }

    fn is_free(&self, pose: &Pose) -> bool {
        let at = Position::new(pose.x_m, pose.y_m);
        let map = self.world.geometry();
        let (Some(cell), Some(ground)) = (self.fine.cell_at(at), map.cell_at(at)) else {
            return false;
        };
        if !self.ground[map.index(ground)] {
            return false;
        }
        let near_m = f64::from(self.near_m[self.fine.index(cell)]);
        // The place lies at most half a diagonal from the centre of its cell.
        let off_m = self.fine.diagonal_m() / 2.0;
        let (length_m, width_m) = (
            self.vehicle.length_m + 2.0 * MARGIN_M,
            self.vehicle.width_m + 2.0 * MARGIN_M,
        );
        if near_m + off_m < length_m.min(width_m) / 2.0 {
            return false;
        }
        let footprint = Footprint::new(pose, length_m, width_m);
        let corners = Footprint::of(self.vehicle, pose).corners();
        let inside = corners.into_iter().all(|corner| map.cell_at(corner).is_some());
        inside && (near_m - off_m > length_m.hypot(width_m) / 2.0 || !self.meets(&footprint, at))
    }

    fn meets(&self, footprint: &Footprint, at: Position) -> bool {
        let mut near = Vec::new();
        let reach_m = self.vehicle.circumscribed_radius_m() + 2.0 * MARGIN_M;
        self.world.near(at, reach_m, &mut near);
        near.iter().any(|&number| {
            let obstacle = &self.world.obstacles()[number as usize];
            obstacle.height_m > self.vehicle.step_height_m && footprint.meets(&obstacle.shape)
        })
    }

    /// Metres to the goal from every cell for a disc that fits into the vehicle: never more than the vehicle needs, by far.
    fn distances(&self, goal: Position) -> Vec<f32> {
        let fine = self.fine;
        let slim_m = self.vehicle.length_m.min(self.vehicle.width_m) / 2.0 + MARGIN_M - fine.diagonal_m() / 2.0;
        let mut least = vec![u64::MAX; fine.cell_count()];
        let mut queue = BinaryHeap::new();
        if let Some(cell) = fine.cell_at(goal) {
            least[fine.index(cell)] = 0;
            queue.push(Reverse((0u64, fine.index(cell))));
        }
        while let Some(Reverse((cost, index))) = queue.pop() {
            if cost > least[index] {
                continue;
            }
            for (rows, columns) in [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)] {
                let Some(next) = fine.offset(fine.cell(index), rows, columns) else {
                    continue;
                };
                let next = fine.index(next);
                let further = cost + if rows == 0 || columns == 0 { 1000 } else { 1414 };
                if f64::from(self.near_m[next]) > slim_m && further < least[next] {
                    least[next] = further;
                    queue.push(Reverse((further, next)));
                }
            }
        }
        // Eight directions lengthen a way by up to 8.24 %: straight ones must not look longer than they are.
        let metres = |&cost: &u64| {
            if cost == u64::MAX {
                f32::INFINITY
            } else {
                (cost as f64 / 1000.0 * fine.cell_size_m() / 1.0824) as f32
            }
        };
        least.iter().map(metres).collect()
    }

    /// The search for a vehicle that turns in place. A rectangle looks the same after half a turn: eight axes do.
    fn walk(&self, start: &Pose, goal: Position, to_go: &[f32]) -> Option<Way> {
        let axis_rad = |axis: usize| (-f64::from(AXES[axis].1)).atan2(f64::from(AXES[axis].0));
        let size_m = self.fine.cell_size_m();
        let here = self.fine.cell_at(Position::new(start.x_m, start.y_m))?;
        let first = (0..8)
            .filter(|&axis| {
                let off_rad = wrap(axis_rad(axis) - start.heading_rad);
                off_rad.abs().min(PI - off_rad.abs()) <= FRAC_PI_4 / 1.4
            })
            .map(|axis| (self.fine.index(here) * 8 + axis, (start.x_m, start.y_m, axis_rad(axis))));
        let key = |index: usize| index / 8;
        let next = |index: usize, _: (f64, f64, f64), found: &mut Vec<(usize, (f64, f64, f64), f64)>| {
            let (cell, axis) = (self.fine.cell(index / 8), index % 8);
            let centre = self.fine.centre(cell);
            for side in [1, -1] {
                let (columns, rows) = AXES[axis];
                if let Some(to) = self.fine.offset(cell, side * rows, side * columns) {
                    let centre = self.fine.centre(to);
                    let length_m = f64::from(columns).hypot(f64::from(rows)) * size_m;
                    let pose = (centre.x_m, centre.y_m, axis_rad(axis));
                    found.push((self.fine.index(to) * 8 + axis, pose, length_m));
                }
                let turned = (axis + if side > 0 { 1 } else { 7 }) % 8;
                let between = wrap(axis_rad(turned) - axis_rad(axis));
                let half_rad = axis_rad(axis) + wrap_half(between) / 2.0;
                if self.is_free(&Pose::level(centre.x_m, centre.y_m, half_rad)) {
                    let pose = (centre.x_m, centre.y_m, axis_rad(turned));
                    found.push((index / 8 * 8 + turned, pose, 0.0));
                }
            }
        };
        self.search(self.fine.cell_count() * 8, first.collect(), goal, to_go, key, next)
    }

    /// The search for a vehicle with a turning circle.
    fn drive(&self, start: &Pose, goal: Position, to_go: &[f32]) -> Option<Way> {
        let size_m = self.fine.cell_size_m();
        let step_m = 1.5 * size_m;
        let curvature = 1.0 / self.vehicle.min_turn_radius_m;
        // Arcs must also leave the sector of their heading.
        let step_m = step_m.max(1.05 * TAU / HEADINGS as f64 / curvature);
        let index_of = |(x_m, y_m, heading_rad): (f64, f64, f64)| {
            let cell = self.fine.cell_at(Position::new(x_m, y_m))?;
            let heading = (heading_rad.rem_euclid(TAU) / TAU * HEADINGS as f64) as usize % HEADINGS;
            Some(self.fine.index(cell) * HEADINGS + heading)
        };
        let pose = (start.x_m, start.y_m, start.heading_rad);
        let first = vec![(index_of(pose)?, pose)];
        let key = |index: usize| index / HEADINGS;
        let pieces = (step_m / (0.5 * self.vehicle.width_m)).ceil().max(1.0) as usize;
        let next = |_: usize, (x, y, heading): (f64, f64, f64), found: &mut Vec<(usize, (f64, f64, f64), f64)>| {
            for bend in [0.0, curvature, -curvature] {
                for way_m in [step_m, -step_m] {
                    let at = |share: f64| {
                        let (way_m, turn) = (way_m * share, way_m * share * bend);
                        let chord_m = if turn == 0.0 {
                            way_m
                        } else {
                            way_m * (turn / 2.0).sin() / (turn / 2.0)
                        };
                        let (sin, cos) = (heading + turn / 2.0).sin_cos();
                        (x + chord_m * cos, y + chord_m * sin, wrap(heading + turn))
                    };
                    let is_open = (1..pieces).all(|piece| {
                        let (x_m, y_m, heading_rad) = at(piece as f64 / pieces as f64);
                        self.is_free(&Pose::level(x_m, y_m, heading_rad))
                    });
                    let to = at(1.0);
                    if is_open && let Some(index) = index_of(to) {
                        found.push((index, to, step_m));
                    }
                }
            }
        };
        self.search(self.fine.cell_count() * HEADINGS, first, goal, to_go, key, next)
    }

    /// A* over the states of a lattice: `key` gives the cell of a state, `next` what can be reached from it.
    fn search(
        &self,
        states: usize,
        first: Vec<(usize, (f64, f64, f64))>,
        goal: Position,
        to_go: &[f32],
        key: impl Fn(usize) -> usize,
        mut next: impl FnMut(usize, (f64, f64, f64), &mut Vec<(usize, (f64, f64, f64), f64)>),
    ) -> Option<Way> {
        let left = |index: usize| {
            let metres = (f64::from(to_go[key(index)]) - ARRIVAL_M).max(0.0);
            metres.is_finite().then_some((metres * UNITS) as u64)
        };
        // Number of a state's node; poses are judged once, when first reached.
        let mut known = vec![NOBODY; states];
        let mut nodes: Vec<Node> = Vec::new();
        let mut queue = BinaryHeap::new();
        for (index, pose) in first {
            if let Some(left) = left(index)
                && self.is_free(&Pose::level(pose.0, pose.1, pose.2))
            {
                known[index] = nodes.len() as u32;
                queue.push(Reverse((left, nodes.len() as u32, index)));
                nodes.push(Node {
                    cost: 0,
                    pose,
                    from: NOBODY,
                });
            }
        }
        let mut settled = vec![false; states];
        let mut found = Vec::new();
        while let Some(Reverse((_, number, index))) = queue.pop() {
            if std::mem::replace(&mut settled[index], true) {
                continue;
            }
            let node = nodes[number as usize];
            if goal.distance_m(Position::new(node.pose.0, node.pose.1)) <= ARRIVAL_M {
                return Some(retrace(&nodes, number));
            }
            found.clear();
            next(index, node.pose, &mut found);
            for &(to, pose, length_m) in &found {
                let (false, Some(left)) = (settled[to], left(to)) else {
                    continue;
                };
                let cost = node.cost + (length_m * UNITS) as u64;
                let before = known[to];
                if before != NOBODY && nodes[before as usize].cost <= cost {
                    continue;
                }
                if !self.is_free(&Pose::level(pose.0, pose.1, pose.2)) {
                    continue;
                }
                known[to] = nodes.len() as u32;
                queue.push(Reverse((cost + left, nodes.len() as u32, to)));
                nodes.push(Node {
                    cost,
                    pose,
                    from: number,
                });
            }
        }
        None
    }
}

/// A difference of axes as the smaller turn of a line: -pi/2 to pi/2.
fn wrap_half(angle_rad: f64) -> f64 {
    if angle_rad > PI / 2.0 {
        angle_rad - PI
    } else if angle_rad < -PI / 2.0 {
        angle_rad + PI
    } else {
        angle_rad
    }
}

fn retrace(nodes: &[Node], last: u32) -> Way {
    let length_m = nodes[last as usize].cost as f64 / UNITS;
    let mut poses = Vec::new();
    let mut number = last;
    while number != NOBODY {
        let (x_m, y_m, heading_rad) = nodes[number as usize].pose;
        poses.push(Pose::level(x_m, y_m, heading_rad));
        number = nodes[number as usize].from;
    }
    poses.reverse();
    Way { length_m, poses }
}

/// Whether the ground at a place lets the vehicle pass in some direction.
fn carries(world: &World, vehicle: &Vehicle, at: Position) -> bool {
    (0..8).any(|eighth| {
        let heading_rad = f64::from(eighth) * FRAC_PI_4;
        // At the edge of the map a wheel may stand outside; the search asks for the corners itself.
        let Ok(ground) = world.ground_under(vehicle, &Pose::level(at.x_m, at.y_m, heading_rad)) else {
            return world.relief().height_m(at).is_some();
        };
        let fares = Trafficability::of(vehicle, ground.soil, world.moisture_percent());
        let grade = ground.pitch_rad.tan();
        fares.go
            && grade <= vehicle.grade_up
            && -grade <= vehicle.grade_down
            && ground.roll_rad.tan().abs() <= vehicle.max_side_slope()
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Obstacle, Shape};
    use super::*;
    use crate::grid::Layer;
    use crate::soil::SoilClass;
    use crate::vehicle::fixtures::{pioneer, tractor};
    use rstest::rstest;

    fn level(half_m: f64) -> World {
        let count = (4.0 * half_m) as usize;
        let geometry = GridGeometry::new(count, count, 0.5, -half_m, half_m).unwrap();
        let soil = Layer::filled(geometry, SoilClass::Gravel as u8);
        World::new(Layer::filled(geometry, 0.0), soil, 20.0).unwrap()
    }

    fn with_walls(half_m: f64, walls: &[&[(f64, f64)]]) -> World {
        let mut world = level(half_m);
        let wall = |points: &&[(f64, f64)]| Obstacle {
            shape: Shape::Wall(points.iter().map(|&(x, y)| Position::new(x, y)).collect()),
            height_m: 1.0,
        };
        world.place(walls.iter().map(wall).collect()).unwrap();
        world
    }

    /// A vehicle longer than wide that turns in place.
    fn long() -> Vehicle {
        Vehicle {
            length_m: 1.2,
            width_m: 0.4,
            ..pioneer()
        }
    }

    #[test]
    fn an_open_field_is_crossed_straight() {
        for (vehicle, y_m) in [(pioneer(), 0.0), (pioneer(), 3.0), (tractor(), 0.0)] {
            let way = way(
                &level(20.0),
                &vehicle,
                &Pose::level(-10.0, 0.0, 0.0),
                Position::new(10.0, y_m),
            )
            .unwrap();
            let straight_m = 20.0f64.hypot(y_m) - ARRIVAL_M;
            assert!(
                way.length_m > straight_m - 0.4 && way.length_m < 1.03 * straight_m + 0.3,
                "{}",
                way.length_m
            );
            assert_eq!(way.poses.first().unwrap().x_m, -10.0);
        }
    }

    #[rstest]
    #[case(0.04, false)]
    #[case(0.35, true)]
    fn a_long_vehicle_passes_lengthwise_where_its_circle_does_not_fit(#[case] spare_m: f64, #[case] expected: bool) {
        let half_m = (long().width_m + 2.0 * MARGIN_M + spare_m) / 2.0;
        assert!(half_m < long().circumscribed_radius_m());
        let world = with_walls(5.0, &[&[(0.0, -5.0), (0.0, -half_m)], &[(0.0, half_m), (0.0, 5.0)]]);
        let way = passable(&world, &long(), &Pose::level(-3.0, 0.0, 0.0), Position::new(3.0, 0.0));
        let narrower = half_m - spare_m / 2.0 - 0.02;
        let closed = with_walls(5.0, &[&[(0.0, -5.0), (0.0, -narrower)], &[(0.0, narrower), (0.0, 5.0)]]);
        assert_eq!(
            passable(&closed, &long(), &Pose::level(-3.0, 0.0, 0.0), Position::new(3.0, 0.0)),
            None
        );
        if expected {
            assert!(way.is_some());
        }
    }

    #[test]
    fn a_vehicle_that_cannot_turn_in_place_needs_room_to_turn() {
        // A passage closed at its end; the goal lies behind the vehicle's back.
        let width_m = tractor().width_m + 2.0;
        let sides = [
            (-30.0, width_m / 2.0),
            (20.0, width_m / 2.0),
            (20.0, -width_m / 2.0),
            (-30.0, -width_m / 2.0),
        ];
        let world = with_walls(30.0, &[&sides]);
        let start = Pose::level(0.0, 0.0, 0.0);
        let behind = way(&world, &tractor(), &start, Position::new(-15.0, 0.0)).unwrap();
        // Backwards all the way, without a turn.
        assert!(behind.length_m < 16.0 && behind.poses.iter().all(|pose| pose.heading_rad.abs() < 0.5));
        // Beside it, out of reach of any arc in so narrow a place without going to and fro.
        let aside = way(&level(30.0), &tractor(), &start, Position::new(0.0, 6.0)).unwrap();
        assert!(aside.length_m > 8.0, "{}", aside.length_m);
    }

    #[test]
    fn every_pose_of_a_way_is_free_in_the_world() {
        let world = with_walls(12.0, &[&[(2.0, 4.0), (2.0, -9.0)], &[(-2.0, -4.0), (-2.0, 9.0)]]);
        for vehicle in [pioneer(), long()] {
            let way = way(&world, &vehicle, &Pose::level(-8.0, 0.0, 0.0), Position::new(8.0, 0.0)).unwrap();
            assert!(way.length_m > 20.0);
            for pose in &way.poses {
                assert!(!world.collides(&vehicle, pose, 0.0));
                assert!(
                    world
                        .clearance_m(&vehicle, pose, 0.0, 1.0)
                        .is_none_or(|away_m| away_m >= MARGIN_M - 1e-9)
                );
            }
        }
    }
}
