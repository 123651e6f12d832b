//! Player's `vfh` driver around its method: to a place, into a heading there, and out of where it is stuck.
//!
//! Written from the description of the driver's parameters in Player's manual, not from its code.

use crate::random::{philox, unit};
use crate::sensor::{Pose, Scan, wrap};

use super::player::{PlayerParams, PlayerSteering, PlayerVfh};

/// What the driver is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlayerState {
    /// On its way to the place.
    Driving,
    /// On its way out: the method had found every direction closed.
    Escaping,
    /// At the place, turning into the heading.
    Turning,
    /// At the place in the heading.
    There,
}

/// The driver with its method.
#[derive(Clone, Debug)]
pub struct PlayerDriver {
    vfh: PlayerVfh,
    params: PlayerParams,
    seed: u64,
    /// Escapes so far, seconds that are left of the last, and its turn rate.
    escapes: u32,
    escape_s: f64,
    escape_radps: f64,
}

impl PlayerDriver {
    /// The driver at rest. Its escapes turn by chance; `seed` draws them.
    pub fn new(params: PlayerParams, seed: u64) -> Self {
        Self {
            vfh: PlayerVfh::new(params),
            params,
            seed,
            escapes: 0,
            escape_s: 0.0,
            escape_radps: 0.0,
        }
    }

    /// The method.
    pub fn method(&mut self) -> &mut PlayerVfh {
        &mut self.vfh
    }

    /// One update on the way from a pose to a place and a heading there: within `distance_epsilon` of the place it turns in place,
    /// as fast as it is off and no slower than `min_turnrate`, until it is within `angle_epsilon`.
    ///
    /// The scan must have passed [`Scan::validate`] and the poses must be finite.
    pub fn drive(
        &mut self,
        scan: &Scan,
        (pose, speed_mps): (&Pose, f64),
        goal: &Pose,
        step_s: f64,
    ) -> (PlayerSteering, PlayerState) {
        let rest = PlayerSteering {
            speed_mps: 0.0,
            turn_rate_radps: 0.0,
            direction_rad: 0.0,
        };
        if pose.distance_m(goal) <= self.params.distance_epsilon_m {
            self.escape_s = 0.0;
            let off_rad = wrap(goal.heading_rad - pose.heading_rad);
            if off_rad.abs() <= self.params.angle_epsilon_rad {
                return (rest, PlayerState::There);
            }
            let most_radps = self.params.max_turnrate_radps[0];
            let share = off_rad.abs() / std::f64::consts::PI;
            let turn_radps = (share * most_radps).max(self.params.min_turnrate_radps.min(most_radps));
            let turning = PlayerSteering {
                turn_rate_radps: turn_radps.copysign(off_rad),
                direction_rad: off_rad,
                ..rest
            };
            return (turning, PlayerState::Turning);
        }
        if self.escape_s > 0.0 {
            self.escape_s -= step_s.max(0.0);
            return (self.escaping(), PlayerState::Escaping);
        }
        let goal_rad = wrap((goal.y_m - pose.y_m).atan2(goal.x_m - pose.x_m) - pose.heading_rad);
        let told = self.vfh.update(scan, speed_mps, goal_rad, step_s);
        if told.speed_mps > 0.0 || self.params.escape_speed_mps == 0.0 || self.params.escape_time_s <= 0.0 {
            return (told, PlayerState::Driving);
        }
        self.escape_s = self.params.escape_time_s;
        let chance = unit(philox([self.escapes, 0, 0, 0], self.seed)[0]);
        self.escapes = self.escapes.wrapping_add(1);
        self.escape_radps = (2.0 * chance - 1.0) * self.params.escape_max_turnrate_radps;
        (self.escaping(), PlayerState::Escaping)
    }

    fn escaping(&self) -> PlayerSteering {
        PlayerSteering {
            speed_mps: self.params.escape_speed_mps,
            turn_rate_radps: self.escape_radps,
            direction_rad: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::Mount;
    use std::f64::consts::FRAC_PI_2;

    fn scan(range_m: f64) -> Scan {
        Scan {
            ranges_m: vec![range_m; 181],
            angle_min_rad: -FRAC_PI_2,
            angle_increment_rad: 1f64.to_radians(),
            range_min_m: 0.0,
            range_max_m: 8.0,
            mount: Mount::default(),
        }
    }

    fn moved(pose: &Pose, told: &PlayerSteering, step_s: f64) -> Pose {
        let heading_rad = wrap(pose.heading_rad + told.turn_rate_radps * step_s);
        let (sin, cos) = heading_rad.sin_cos();
        let way_m = told.speed_mps * step_s;
        Pose::level(pose.x_m + cos * way_m, pose.y_m + sin * way_m, heading_rad)
    }

    #[test]
    fn it_drives_to_the_place_and_turns_into_the_heading() {
        let params = PlayerParams::default();
        let mut driver = PlayerDriver::new(params, 1);
        let goal = Pose::level(2.0, 1.0, -2.5);
        let mut pose = Pose::level(0.0, 0.0, 0.0);
        let (mut speed_mps, mut turned) = (0.0, 0);
        for _ in 0..600 {
            let (told, state) = driver.drive(&scan(f64::INFINITY), (&pose, speed_mps), &goal, 0.1);
            match state {
                PlayerState::Driving => assert_eq!(turned, 0),
                PlayerState::Turning => {
                    turned += 1;
                    assert_eq!(told.speed_mps, 0.0);
                    assert!(told.turn_rate_radps.abs() >= params.min_turnrate_radps);
                    assert!(told.turn_rate_radps.abs() <= params.max_turnrate_radps[0]);
                }
                PlayerState::There => {
                    assert!(turned > 0 && pose.distance_m(&goal) <= params.distance_epsilon_m);
                    assert!(wrap(pose.heading_rad - goal.heading_rad).abs() <= params.angle_epsilon_rad);
                    assert_eq!((told.speed_mps, told.turn_rate_radps), (0.0, 0.0));
                    return;
                }
                PlayerState::Escaping => panic!("nothing is in the way"),
            }
            speed_mps = told.speed_mps;
            pose = moved(&pose, &told, 0.1);
        }
        panic!("a minute is enough");
    }

    #[test]
    fn where_all_is_closed_it_escapes_for_its_time_if_it_may() {
        let (start, goal) = (Pose::level(0.0, 0.0, 0.0), Pose::level(5.0, 0.0, 0.0));
        let closed = scan(0.2);
        let mut stays = PlayerDriver::new(PlayerParams::default(), 1);
        let (told, state) = stays.drive(&closed, (&start, 0.0), &goal, 0.1);
        assert_eq!((told.speed_mps, state), (0.0, PlayerState::Driving));
        let params = PlayerParams {
            escape_speed_mps: -0.1,
            escape_time_s: 1.0,
            escape_max_turnrate_radps: 0.5,
            ..PlayerParams::default()
        };
        let mut turns = Vec::new();
        let mut driver = PlayerDriver::new(params, 7);
        for _ in 0..20 {
            let mut steps = 0;
            loop {
                let (told, state) = driver.drive(&closed, (&start, 0.0), &goal, 0.1);
                assert_eq!((told.speed_mps, state), (-0.1, PlayerState::Escaping));
                if steps == 0 {
                    turns.push(told.turn_rate_radps);
                }
                assert_eq!(told.turn_rate_radps, turns[turns.len() - 1]);
                steps += 1;
                if steps > 10 {
                    break;
                }
            }
            // Free again, and the method drives.
            driver.escape_s = 0.0;
        }
        assert!(turns.iter().all(|turn| turn.abs() <= 0.5));
        assert!(turns.iter().any(|&turn| turn > 0.1) && turns.iter().any(|&turn| turn < -0.1));
        let (_, state) = driver.drive(&scan(f64::INFINITY), (&start, 0.0), &goal, 0.1);
        assert_eq!(state, PlayerState::Driving);
        let again = PlayerDriver::new(params, 7).drive(&closed, (&start, 0.0), &goal, 0.1);
        assert_eq!(again.0.turn_rate_radps, turns[0]);
    }
}
