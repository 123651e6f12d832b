//! Whether the sensors could have seen in time what the body ran into.
//!
//! The place of contact was seen in time when, along the true way of the sensor, a beam of its fan would have met it at three
//! scans at least, and the body then still had its stopping distance to go. What moves counts only when the body itself moved:
//! nobody who stands can help being run into.

use std::collections::VecDeque;

use crate::grid::Position;
use crate::sim::{BodyState, Footprint, Laser, Robot, Shape, World};

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
        let params = robot.params();
        let mut seen = 0;
        let mut way_m: f64 = self
            .states
            .iter()
            .zip(self.states.iter().skip(1))
            .map(|(one, next)| one.pose.distance_m(&next.pose))
            .sum();
        let mut last: Option<&BodyState> = None;
        for state in &self.states {
            if let Some(last) = last {
                way_m -= last.pose.distance_m(&state.pose);
            }
            last = Some(state);
            let target = mover.map_or(place, |number| world.movers()[number].at(state.time_s));
            let radius_m = mover.map_or(0.0, |number| world.movers()[number].radius_m);
            let laser = params.has_laser.then_some(&params.laser);
            let mut sensors = laser.into_iter().chain(&params.sonar);
            seen += usize::from(sensors.any(|sensor| sees(world, sensor, state, target, radius_m)));
            if seen >= SCANS {
                let speed_mps = state.speed_mps.abs();
                let braking_mps2 = robot.body().motion().max_braking_mps2;
                let react_s = vehicle.reaction_time_s + params.scan_delay_s;
                let stopping_m = speed_mps * react_s + speed_mps * speed_mps / (2.0 * braking_mps2);
                return Blame {
                    moves,
                    seen_in_time: way_m >= stopping_m,
                };
            }
        }
        Blame {
            moves,
            seen_in_time: false,
        }
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
    let beam = Laser {
        beams: 1,
        angle_min_rad: bearing_rad,
        ..laser.clone()
    };
    let ranges_m = beam.true_ranges_m(world, &state.pose, state.height_m, state.time_s);
    (ranges_m[0] - (away_m - radius_m)).abs() <= NEAR_M
}
