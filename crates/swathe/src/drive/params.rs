//! Parameters of the navigator, and what can be wrong with them.

use thiserror::Error;

use crate::belief::{BeliefError, ProbePolicy};
use crate::local::Evidence;
use crate::nest::NestError;
use crate::rank::RankError;
use crate::vehicle::{Motion, Vehicle, VehicleError};

/// Local method that steers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The vector field histogram of 1991.
    Vfh,
    /// VFH+ of 1998.
    VfhPlus,
    /// VFH* of 2000: VFH+ with look-ahead.
    VfhStar,
    /// As Player's `vfh` driver.
    Player,
}

/// What ground outside the nests of the overlapping grids is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutsideNests {
    /// Three times the cost at half the speed.
    Cost,
    /// An obstacle, as in the paper; gaps under two navigation cells may close.
    Block,
}

/// How the navigator drives. Defaults are estimates of ours unless a source is named.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveParams {
    /// Local method.
    pub method: Method,
    /// Distance to the goal that counts as arrival, in metres.
    pub arrival_m: f64,
    /// Greatest turn rate in rad/s; vehicles with a turning circle turn no faster than it allows.
    pub max_turn_rate_radps: f64,
    /// Greatest acceleration in m/s².
    pub acceleration_mps2: f64,
    /// Braking that is counted on, on level ground, in m/s²; never more than the vehicle's braking friction gives.
    pub braking_mps2: f64,
    /// Distance kept from obstacles at rest, in metres; more with speed.
    pub margin_m: f64,
    /// Age in seconds at which the last usable scan no longer counts.
    pub stale_s: f64,
    /// Height of the range sensor above the ground, in metres.
    pub sensor_height_m: f64,
    /// Height of sonars, whose cones [`super::Navigator::sense`] takes in; default that of the Pioneer's ring.
    pub sonar_height_m: f64,
    /// A return this near to the elevation map, in metres, is ground.
    pub ground_tolerance_m: f64,
    /// How the certainty grid counts evidence.
    pub evidence: Evidence,
    /// Seconds in which what was seen fades to 1/e.
    pub fade_s: f64,
    /// Look-ahead on the route at rest and at full speed, in metres.
    pub lookahead_m: [f64; 2],
    /// Cost of ground that was never seen, as a multiple of seen ground.
    pub unknown_cost: f64,
    /// Whether a route is laid on the memory of what was seen; without it the local method heads straight for the goal.
    pub memory: bool,
    /// Whether the robot gets out of traps by itself.
    pub recover: bool,
    /// Whether it follows a wall before it gives up.
    pub follow_walls: bool,
    /// Seconds without headway that make a trap.
    pub trap_s: f64,
    /// Recoveries without headway after which the robot gives up.
    pub most_recoveries: u32,
    /// Cells along the side of the window that the route is laid in, 64 to 2048; it grows to four times that in traps.
    pub window_cells: usize,
    /// Tiles of 64 by 64 cells that are remembered.
    pub most_tiles: usize,
    /// What ground outside the nests is.
    pub outside_nests: OutsideNests,
    /// When the robot stops for a penetrometer reading; costs are in seconds of driving.
    pub probing: ProbePolicy,
    /// Seconds that it waits for one before it drives on.
    pub probe_wait_s: f64,
    /// Metres from the front edge of the footprint forwards to the cone, on its boom; below 0 behind that edge.
    pub probe_boom_m: f64,
}

impl Default for DriveParams {
    fn default() -> Self {
        Self {
            method: Method::VfhPlus,
            arrival_m: 0.5,
            max_turn_rate_radps: 1.5,
            acceleration_mps2: 1.0,
            braking_mps2: 1.5,
            margin_m: 0.1,
            stale_s: 0.5,
            sensor_height_m: 0.3,
            sonar_height_m: 0.18,
            ground_tolerance_m: 0.15,
            evidence: Evidence::default(),
            fade_s: f64::INFINITY,
            lookahead_m: [2.0, 5.0],
            unknown_cost: 1.5,
            memory: true,
            recover: true,
            follow_walls: true,
            trap_s: 8.0,
            most_recoveries: 12,
            window_cells: 256,
            most_tiles: 2048,
            outside_nests: OutsideNests::Cost,
            probing: ProbePolicy::Never,
            probe_wait_s: 30.0,
            probe_boom_m: 0.5,
        }
    }
}

/// What a navigator cannot be made of.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum DriveError {
    /// The vehicle is not usable.
    #[error(transparent)]
    Vehicle(#[from] VehicleError),
    /// The region's grids are not usable.
    #[error(transparent)]
    Nest(#[from] NestError),
    /// What is told of the soil is not usable.
    #[error(transparent)]
    Belief(#[from] BeliefError),
    /// The map cannot be ranked.
    #[error(transparent)]
    Rank(#[from] RankError),
    /// News of the soil for a region that does not know its soil.
    #[error("The navigator's region cannot learn: it holds finished ranks, or there is none.")]
    NoKnowledge,
    /// A figure outside its range.
    #[error("The navigator's {name} of {given} is not usable: {allowed}.")]
    Figure {
        /// The figure.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

impl DriveParams {
    /// The same for a vehicle that moves like this: never more than its acceleration, braking and turn rate.
    #[must_use]
    pub fn within(self, motion: &Motion) -> Self {
        Self {
            acceleration_mps2: self.acceleration_mps2.min(motion.max_acceleration_mps2),
            braking_mps2: self.braking_mps2.min(motion.max_braking_mps2),
            max_turn_rate_radps: self.max_turn_rate_radps.min(motion.max_turn_rate_radps),
            ..self
        }
    }

    /// Checks every figure.
    ///
    /// # Errors
    /// [`DriveError::Figure`] naming the first figure outside its range.
    pub fn validate(&self) -> Result<(), DriveError> {
        let figures = [
            ("arrival distance in metres", self.arrival_m, 0.01, 1e3),
            ("greatest turn rate in rad/s", self.max_turn_rate_radps, 0.01, 100.0),
            ("acceleration in m/s²", self.acceleration_mps2, 0.01, 100.0),
            ("braking in m/s²", self.braking_mps2, 0.01, 100.0),
            ("margin in metres", self.margin_m, 0.0, 10.0),
            ("age of a stale scan in seconds", self.stale_s, 0.01, 60.0),
            ("sensor height in metres", self.sensor_height_m, 0.0, 100.0),
            ("sonar height in metres", self.sonar_height_m, 0.0, 100.0),
            ("ground tolerance in metres", self.ground_tolerance_m, 0.0, 10.0),
            ("fading time in seconds", self.fade_s, 0.1, f64::INFINITY),
            ("look-ahead at rest in metres", self.lookahead_m[0], 0.1, 1e3),
            ("look-ahead at full speed in metres", self.lookahead_m[1], 0.1, 1e3),
            ("cost of unknown ground", self.unknown_cost, 1.0, 1e3),
            ("time without headway in seconds", self.trap_s, 0.5, 3600.0),
            ("window in cells", self.window_cells as f64, 64.0, 2048.0),
            ("number of tiles", self.most_tiles as f64, 16.0, 1e6),
            ("wait for a reading in seconds", self.probe_wait_s, 0.0, 3600.0),
            ("boom of the penetrometer in metres", self.probe_boom_m, -20.0, 20.0),
        ];
        for (name, given, least, most) in figures {
            if !(given >= least && given <= most) {
                let allowed = "see the documentation of the parameters for its range";
                return Err(DriveError::Figure { name, given, allowed });
            }
        }
        self.probing.validate()?;
        Ok(())
    }
}

/// Speeds below this are rest.
pub(super) const REST_MPS: f64 = 0.03;

/// What the navigator works out of the vehicle once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    pub half_length_m: f64,
    pub half_width_m: f64,
    /// Of the circle around the footprint.
    pub radius_m: f64,
    pub max_speed_mps: f64,
    pub max_turn_rate_radps: f64,
    pub turn_radius_m: f64,
    pub reaction_s: f64,
    pub braking_friction: f64,
    pub braking_mps2: f64,
    pub acceleration_mps2: f64,
}

impl Shape {
    pub fn of(vehicle: &Vehicle, params: &DriveParams) -> Self {
        let grip_mps2 = vehicle.braking_friction * crate::vehicle::GRAVITY_MPS2;
        Self {
            half_length_m: vehicle.length_m / 2.0,
            half_width_m: vehicle.width_m / 2.0,
            radius_m: vehicle.circumscribed_radius_m(),
            max_speed_mps: vehicle.max_speed_mps,
            max_turn_rate_radps: params.max_turn_rate_radps,
            turn_radius_m: vehicle.min_turn_radius_m,
            reaction_s: vehicle.reaction_time_s,
            braking_friction: vehicle.braking_friction,
            braking_mps2: params.braking_mps2.min(grip_mps2),
            acceleration_mps2: params.acceleration_mps2,
        }
    }

    pub fn turns_in_place(&self) -> bool {
        self.turn_radius_m <= 0.0
    }

    /// Metres in which the vehicle stops from a speed, reaction included.
    pub fn stopping_m(&self, speed_mps: f64) -> f64 {
        speed_mps * self.reaction_s + speed_mps * speed_mps / (2.0 * self.braking_mps2)
    }

    /// How far around the robot every obstacle counts, in metres.
    pub fn reach_m(&self) -> f64 {
        self.stopping_m(self.max_speed_mps) + 1.0
    }

    /// Greatest speed from which it stops within a distance, with a braking that the slope may lessen.
    pub fn speed_for(&self, free_m: f64, braking_mps2: f64, delay_s: f64) -> f64 {
        let at = braking_mps2 * (self.reaction_s + delay_s);
        (at.mul_add(at, 2.0 * braking_mps2 * free_m.max(0.0)).sqrt() - at).max(0.0)
    }

    /// A speed that the vehicle can have after a time: no faster than its acceleration allows from what it drives and was told,
    /// and through rest when it turns back. Slower is always allowed, as brakes are the vehicle's own.
    pub fn reachable(&self, wanted_mps: f64, measured_mps: f64, told_mps: f64, step_s: f64) -> f64 {
        let side = wanted_mps.signum();
        let now_mps = (measured_mps * side).max(told_mps * side).max(0.0);
        let most_mps = (now_mps + self.acceleration_mps2 * step_s).min(self.max_speed_mps);
        // Rolling the other way still: rest first.
        let rolls_back = measured_mps * side < -REST_MPS;
        if rolls_back {
            0.0
        } else {
            side * (wanted_mps * side).min(most_mps)
        }
    }

    /// The fastest command on the arc of one that the turn rate allows.
    pub fn within_turn_rate(&self, (speed_mps, turn_radps): (f64, f64)) -> (f64, f64) {
        let share = (self.max_turn_rate_radps / turn_radps.abs().max(1e-9)).min(1.0);
        (share * speed_mps, share * turn_radps)
    }

    /// A turn rate within the limits at a speed.
    pub fn turn_rate(&self, wanted_radps: f64, speed_mps: f64) -> f64 {
        let most = if self.turns_in_place() {
            self.max_turn_rate_radps
        } else {
            (speed_mps.abs() / self.turn_radius_m).min(self.max_turn_rate_radps)
        };
        wanted_radps.clamp(-most, most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::fixtures::{pioneer, tractor};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_turns_too_fast_is_slowed_on_its_arc(
            speed_mps in -3.0..3.0_f64, turn_radps in -12.0..12.0_f64, is_car in prop::bool::ANY,
        ) {
            let vehicle = if is_car { tractor() } else { pioneer() };
            let shape = Shape::of(&vehicle, &DriveParams::default());
            let (slower_mps, slower_radps) = shape.within_turn_rate((speed_mps, turn_radps));
            prop_assert!(slower_radps.abs() <= shape.max_turn_rate_radps * (1.0 + 1e-12));
            prop_assert!((slower_mps * turn_radps - slower_radps * speed_mps).abs() < 1e-9);
            prop_assert!(turn_radps.abs() > shape.max_turn_rate_radps || (slower_mps, slower_radps) == (speed_mps, turn_radps));
        }
    }
}
