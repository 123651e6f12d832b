//! Whether the sensors could have seen in time what the body ran into.
//!
//! The place of contact was seen in time when, along the true way of the sensor, a beam of its fan would have met it at three
//! scans at least, and the body then still had its stopping distance to go. With what moves, the three scans must have shown it
//! since it last turned, for where it goes then no scan before could tell; and stopping must have helped: at some moment since
//! then the body could have braked to rest where it would not have been run into. Nobody who stands can help that, and nobody
//! who is overtaken.

use std::collections::VecDeque;

use crate::grid::Position;
use crate::sensor::Pose;
use crate::sim::{BodyState, Footprint, Laser, Mover, Robot, Shape, World};
use crate::vehicle::Vehicle;

/// Seconds that are looked back.
const LOOK_BACK_S: f64 = 20.0;

/// Scans that must have shown a thing.
const SCANS: usize = 3;

/// A beam that ends this near to the place of contact has met it.
const NEAR_M: f64 = 0.3;

/// Distance between points of an outline that are tried, and most of them.
const OUTLINE_STEP_M: f64 = 0.02;
const OUTLINE_POINTS: usize = 4000;

/// Speed below which a body is run into rather than running into something.
const STANDS_MPS: f64 = 0.05;

/// A body at rest would have been run into when that happens until so long after the collision, looked at in steps.
const AFTER_S: f64 = 5.0;
const REST_STEP_S: f64 = 0.05;

/// Where the body was lately.
#[derive(Clone, Debug, Default)]
pub(super) struct Trail {
    states: VecDeque<BodyState>,
}

/// What was run into.
pub(super) struct Blame {
    pub moves: bool,
    pub seen_in_time: bool,
}

impl Trail {
    pub fn note(&mut self, body: &BodyState) {
        if self.states.back().is_some_and(|last| last.time_s >= body.time_s) {
            return;
        }
        self.states.push_back(*body);
        while self
            .states
            .front()
            .is_some_and(|first| first.time_s < body.time_s - LOOK_BACK_S)
        {
            self.states.pop_front();
        }
    }

    /// What the body, which has just collided, ran into, and whether it could have been seen in time.
    pub fn blame(&self, world: &World, robot: &Robot) -> Blame {
        let body = robot.state();
        let vehicle = robot.body().vehicle();
        let footprint = Footprint::of(vehicle, &body.pose);
        let mut nearest = (f64::INFINITY, None, Position::new(body.pose.x_m, body.pose.y_m));
        for obstacle in world
            .obstacles()
            .iter()
            .filter(|one| one.height_m > vehicle.step_height_m)
        {
            let away_m = footprint.distance_m(&obstacle.shape);
            if away_m < nearest.0 {
                nearest = (away_m, None, contact(&footprint, &obstacle.shape));
            }
        }
        for (number, mover) in world.movers().iter().enumerate() {
            let (centre, radius_m) = (mover.at(body.time_s), mover.radius_m);
            let away_m = footprint.distance_m(&Shape::Disc { centre, radius_m });
            if away_m < nearest.0 {
                nearest = (away_m, Some(number), centre);
            }
        }
        let (_, mover, place) = nearest;
        let moves = mover.is_some();
        // The state after the collision stands; the one before it tells how fast the body was.
        let before_mps = self.states.iter().rev().nth(1).map_or(0.0, |state| state.speed_mps);
        if moves && before_mps.abs() < STANDS_MPS {
            return Blame {
                moves,
                seen_in_time: false,
            };
        }
        let Some(first) = self.seen_since(world, robot, place, mover) else {
            return Blame {
                moves,
                seen_in_time: false,
            };
        };
        let seen_in_time = match mover {
            None => self.rest(robot, first).is_some(),
            Some(number) => (first..self.states.len())
                .map_while(|from| self.rest(robot, from))
                .any(|rest| rest.is_clear_of(&world.movers()[number], vehicle, body.time_s + AFTER_S)),
        };
        Blame { moves, seen_in_time }
    }

    /// The first of the states since which enough scans have shown a place, or something that moves.
    fn seen_since(&self, world: &World, robot: &Robot, place: Position, mover: Option<usize>) -> Option<usize> {
        let params = robot.params();
        let laser = params.has_laser.then_some(&params.laser);
        let mover = mover.map(|number| &world.movers()[number]);
        let now_s = robot.state().time_s;
        let straight_since_s = mover.map_or(f64::NEG_INFINITY, |mover| mover.straight_since_s(now_s));
        let seen = self.states.iter().enumerate().filter(|(_, state)| {
            if state.time_s < straight_since_s {
                return false;
            }
            let target = mover.map_or(place, |mover| mover.at(state.time_s));
            let radius_m = mover.map_or(0.0, |mover| mover.radius_m);
            let mut sensors = laser.into_iter().chain(&params.sonar);
            sensors.any(|sensor| sees(world, sensor, state, target, radius_m))
        });
        seen.map(|(number, _)| number).nth(SCANS - 1)
    }

    /// Where the body would have come to rest on its way, had it braked at a state; `None` beyond the collision.
    fn rest(&self, robot: &Robot, from: usize) -> Option<Rest> {
        let state = self.states[from];
        let speed_mps = state.speed_mps.abs();
        let braking_mps2 = robot.body().motion().max_braking_mps2;
        let react_s = robot.body().vehicle().reaction_time_s + robot.params().scan_delay_s;
        let stopping_m = speed_mps * react_s + speed_mps * speed_mps / (2.0 * braking_mps2);
        let mut way_m = 0.0;
        let mut last = state.pose;
        for next in self.states.range(from..) {
            way_m += last.distance_m(&next.pose);
            last = next.pose;
            if way_m >= stopping_m {
                return Some(Rest {
                    pose: last,
                    since_s: state.time_s + react_s + speed_mps / braking_mps2,
                });
            }
        }
        None
    }
}

/// Where a body would have stood, and from when on.
struct Rest {
    pose: Pose,
    since_s: f64,
}

impl Rest {
    /// Whether what moves would not have run into it by a time.
    fn is_clear_of(&self, mover: &Mover, vehicle: &Vehicle, until_s: f64) -> bool {
        let footprint = Footprint::of(vehicle, &self.pose);
        let radius_m = mover.radius_m;
        let steps = ((until_s - self.since_s) / REST_STEP_S).ceil() as usize;
        (0..=steps).all(|step| {
            let centre = mover.at(self.since_s + step as f64 * REST_STEP_S);
            footprint.distance_m(&Shape::Disc { centre, radius_m }) > 0.0
        })
    }
}

/// The place of a shape's outline that is nearest to a footprint.
fn contact(footprint: &Footprint, shape: &Shape) -> Position {
    let [front_left, rear_left, rear_right, front_right] = footprint.corners();
    let outline = Shape::Polygon(vec![front_left, rear_left, rear_right, front_right]);
    if let Shape::Disc { centre, radius_m } = shape {
        let middle = front_left.towards(rear_right, 0.5);
        let away_m = middle.distance_m(*centre);
        return centre.towards(middle, (radius_m / away_m.max(1e-9)).min(1.0));
    }
    let mut nearest = (f64::INFINITY, front_left);
    for (a, b) in shape.edges() {
        let steps = ((a.distance_m(b) / OUTLINE_STEP_M).ceil() as usize).clamp(1, OUTLINE_POINTS);
        for step in 0..=steps {
            let point = a.towards(b, step as f64 / steps as f64);
            let away_m = outline.distance_m(point);
            if away_m < nearest.0 {
                nearest = (away_m, point);
            }
        }
    }
    nearest.1
}

/// Whether a beam of the sensor's fan towards a place would end at it.
fn sees(world: &World, laser: &Laser, state: &BodyState, target: Position, radius_m: f64) -> bool {
    let sensor = state.pose.of_mount(&laser.mount);
    let away_m = Position::new(sensor.x_m, sensor.y_m).distance_m(target);
    let bearing_rad = (target.y_m - sensor.y_m).atan2(target.x_m - sensor.x_m) - sensor.heading_rad;
    let fan_rad = laser.angle_increment_rad * (laser.beams - 1) as f64;
    let along_rad = (bearing_rad - laser.angle_min_rad).rem_euclid(std::f64::consts::TAU);
    if along_rad > fan_rad + laser.angle_increment_rad / 2.0 || away_m - radius_m > laser.range_max_m {
        return false;
    }
    // The beams of the fan on either side: a thing between them was not to be seen.
    let below = (along_rad / laser.angle_increment_rad)
        .floor()
        .min((laser.beams - 1) as f64);
    let count = if below as usize + 1 < laser.beams { 2 } else { 1 };
    let beams = Laser {
        beams: count,
        angle_min_rad: laser.angle_min_rad + below * laser.angle_increment_rad,
        ..laser.clone()
    };
    let ranges_m = beams.true_ranges_m(world, &state.pose, state.height_m, state.time_s);
    ranges_m
        .iter()
        .any(|range_m| (range_m - (away_m - radius_m)).abs() <= NEAR_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{GridGeometry, Layer};
    use crate::sim::{Command, Motion, Obstacle, RobotParams, Steering};
    use crate::soil::SoilClass;
    use crate::vehicle::fixtures::pioneer;

    const STEP_S: f64 = 1.0 / 35.0;

    /// Drives straight at a speed from (0, 0) eastwards until something is hit.
    fn hit(obstacles: Vec<Obstacle>, movers: Vec<Mover>, speed_mps: f64) -> Blame {
        let geometry = GridGeometry::new(40, 40, 1.0, -20.0, 20.0).unwrap();
        let soil = Layer::filled(geometry, SoilClass::Gravel as u8);
        let mut world = World::new(Layer::filled(geometry, 0.0), soil, 20.0).unwrap();
        world.place(obstacles).unwrap();
        world.set_in_motion(movers).unwrap();
        let motion = Motion {
            steering: Steering::Differential,
            max_acceleration_mps2: 1.0,
            max_braking_mps2: 1.5,
            max_turn_rate_radps: 2.0,
        };
        let start = Pose::level(0.0, 0.0, 0.0);
        let mut robot = Robot::new(&world, pioneer(), motion, start, RobotParams::default()).unwrap();
        let mut trail = Trail::default();
        let command = Command {
            speed_mps,
            turn_rate_radps: 0.0,
        };
        while robot.state().collisions == 0 {
            trail.note(robot.state());
            robot.step(&world, command, STEP_S);
            trail.note(robot.state());
            assert!(robot.state().time_s < 60.0, "nothing was hit");
        }
        trail.blame(&world, &robot)
    }

    fn crate_at(x_m: f64) -> Vec<Obstacle> {
        let shape = Shape::Disc {
            centre: Position::new(x_m, 0.0),
            radius_m: 0.4,
        };
        vec![Obstacle { shape, height_m: 1.0 }]
    }

    fn walker(speed_mps: f64, path: &[(f64, f64)]) -> Vec<Mover> {
        vec![Mover {
            path: path.iter().map(|&(x_m, y_m)| Position::new(x_m, y_m)).collect(),
            speed_mps,
            radius_m: 0.3,
            start_m: 0.0,
        }]
    }

    #[test]
    fn what_stands_ahead_is_seen_in_time_and_what_stands_behind_is_not() {
        let ahead = hit(crate_at(4.0), Vec::new(), 1.0);
        assert!(!ahead.moves && ahead.seen_in_time);
        let behind = hit(crate_at(-2.0), Vec::new(), -1.0);
        assert!(!behind.moves && !behind.seen_in_time);
    }

    #[test]
    fn who_crosses_the_way_could_be_let_pass() {
        let crossing = hit(Vec::new(), walker(0.5, &[(4.0, -2.6), (4.0, 8.0)]), 0.7);
        assert!(crossing.moves && crossing.seen_in_time);
    }

    #[test]
    fn who_turns_out_of_sight_could_not_be_foreseen() {
        // He passes on the left, turns behind the body and walks into its flank; had it stood still, he would have passed before it.
        let path = [(4.0, 2.0), (-1.0, 2.0), (5.0, -1.0)];
        let turned = hit(Vec::new(), walker(2.1, &path), 0.5);
        assert!(turned.moves && !turned.seen_in_time);
        // The same in its sight.
        let path = [(4.0, 4.0), (3.5, 3.0), (1.9, 0.0), (0.0, -3.0)];
        let crossing = hit(Vec::new(), walker(1.0, &path), 0.5);
        assert!(crossing.moves && crossing.seen_in_time);
    }

    #[test]
    fn who_overtakes_and_who_walks_into_a_standing_body_cannot_be_helped() {
        // Seen ahead first; then he walks round and comes from behind.
        let round = [(3.0, 1.5), (-3.0, 1.5), (-3.0, 0.0), (9.0, 0.0)];
        let overtaking = hit(Vec::new(), walker(2.0, &round), 0.1);
        assert!(overtaking.moves && !overtaking.seen_in_time);
        let standing = hit(Vec::new(), walker(1.0, &[(6.0, 0.0), (-6.0, 0.0)]), 0.0);
        assert!(standing.moves && !standing.seen_in_time);
    }
}
