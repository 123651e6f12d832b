//! The vehicle as a moving body: commands in, motion within its limits out, with slip on real ground.
//!
//! The running gear follows the command within the limits of acceleration, braking, turn rate and turning radius, and no faster
//! than power and soil allow on the grade. Over the ground the vehicle moves slower than its running gear turns: with κ the share
//! of the greatest traction that is used, (C + tan α) / (C + drawbar grade), slip is -ln(1 - κ) / 10, at most 1 (the exponential
//! traction curve of Wismer and Luth 1973 solved for slip; 10 is an estimate for tyres on firm soil). Braking downhill
//! slides by the same curve with braking friction as the greatest. Across a slope the vehicle drifts downhill by the curve with
//! traction friction as the greatest, per metre driven. Skid steering loses a share of every turn.

use crate::grid::Position;
use crate::sensor::{Pose, wrap};
use crate::soil::{SoilClass, Trafficability};
use crate::vehicle::{GRAVITY_MPS2, Motion, Steering, Vehicle};

use super::noise::{Noise, Stream};
use super::{NoGo, SimError, World, require};

/// What a vehicle is told to do. What is not finite counts as 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Command {
    /// Forward speed in m/s; negative is backwards.
    pub speed_mps: f64,
    /// Turn rate in rad/s, counter-clockwise.
    pub turn_rate_radps: f64,
}

/// What keeps a vehicle from moving.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// It ran into something; it may drive away from it.
    Collision,
    /// It sank in; nothing moves it any more.
    Sunk,
    /// It would have left the map, or its wheels known ground.
    Edge,
}

/// Where a body is and how it moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BodyState {
    /// Seconds since the start.
    pub time_s: f64,
    /// True place and attitude.
    pub pose: Pose,
    /// Height of the ground under its middle in metres.
    pub height_m: f64,
    /// Speed of the running gear in m/s.
    pub wheel_speed_mps: f64,
    /// Turn rate of the running gear in rad/s.
    pub wheel_turn_rate_radps: f64,
    /// Speed over the ground in m/s.
    pub speed_mps: f64,
    /// Turn rate over the ground in rad/s.
    pub turn_rate_radps: f64,
    /// Share of the running gear's motion that is lost; below 0 when it slides further than it turns.
    pub slip: f64,
    /// What kept it from moving in the last step.
    pub stop: Option<Stop>,
    /// Which limit of the ground it is beyond.
    pub no_go: Option<NoGo>,
    /// How often it ran into something.
    pub collisions: u32,
}

/// Longest time that is integrated at once, in seconds.
const PIECE_S: f64 = 0.02;

/// Longest step that is taken, in seconds.
const STEP_MAX_S: f64 = 60.0;

/// Rate constant of the traction curve (estimate for tyres on firm soil).
const TRACTION_RATE: f64 = 10.0;

/// Seconds for which one draw of the slip holds.
const SLIP_DRAW_S: f64 = 0.1;

/// Share of a turn that skid steering loses (estimate).
const SKID_TURN_LOSS: f64 = 0.1;

/// Metres from one collision to the next that counts as another; pushing on against the same thing does not.
const NEW_HIT_M: f64 = 0.05;

/// A vehicle in the world.
#[derive(Clone, Debug)]
pub struct Body {
    vehicle: Vehicle,
    motion: Motion,
    /// Relative deviation of the slip, drawn ten times a second.
    slip_variation: f64,
    noise: Noise,
    fares: [Trafficability; 7],
    state: BodyState,
    /// Where it last ran into something.
    hit_at: Option<Pose>,
}

impl Body {
    /// A vehicle at rest at a place and heading; its attitude follows from the ground.
    ///
    /// # Errors
    /// [`SimError`] when the vehicle, its motion, the pose or the variation (0 to 1) is not usable.
    pub fn new(
        world: &World,
        vehicle: Vehicle,
        motion: Motion,
        at: Pose,
        slip_variation: f64,
        noise: Noise,
    ) -> Result<Self, SimError> {
        vehicle.validate()?;
        motion.validate()?;
        for (name, given) in [("easting", at.x_m), ("northing", at.y_m), ("heading", at.heading_rad)] {
            require(name, given, true, "it must be finite")?;
        }
        let fits = (0.0..=1.0).contains(&slip_variation);
        require("variation of the slip", slip_variation, fits, "it must be from 0 to 1")?;
        let fares = SoilClass::ALL.map(|soil| Trafficability::of(&vehicle, soil, world.moisture_percent()));
        let mut body = Self {
            vehicle,
            motion,
            slip_variation,
            noise,
            fares,
            state: BodyState {
                pose: Pose::level(at.x_m, at.y_m, wrap(at.heading_rad)),
                ..BodyState::default()
            },
            hit_at: None,
        };
        body.rest(world);
        Ok(body)
    }

    /// The state.
    pub fn state(&self) -> &BodyState {
        &self.state
    }

    /// The vehicle.
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// How it changes its motion.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// The command as the vehicle can follow it: finite, within speed, turn rate and turning radius.
    pub fn allowed(&self, command: Command) -> Command {
        let finite = |given: f64| if given.is_finite() { given } else { 0.0 };
        let most = self.vehicle.max_speed_mps;
        let speed_mps = finite(command.speed_mps).clamp(-most, most);
        Command {
            speed_mps,
            turn_rate_radps: self.allowed_turn(finite(command.turn_rate_radps), speed_mps),
        }
    }

    fn allowed_turn(&self, turn_rate_radps: f64, speed_mps: f64) -> f64 {
        let mut most = self.motion.max_turn_rate_radps;
        if self.vehicle.min_turn_radius_m > 0.0 {
            most = most.min(speed_mps.abs() / self.vehicle.min_turn_radius_m);
        }
        turn_rate_radps.clamp(-most, most)
    }

    /// Moves for a time (at most a minute at once; not finite or below 0 counts as 0).
    pub fn step(&mut self, world: &World, command: Command, duration_s: f64) -> &BodyState {
        let duration_s = if duration_s.is_finite() {
            duration_s.clamp(0.0, STEP_MAX_S)
        } else {
            0.0
        };
        let pieces = (duration_s / PIECE_S - 1e-9).ceil().max(1.0);
        let wanted = self.allowed(command);
        if self.state.stop != Some(Stop::Sunk) {
            self.state.stop = None;
        }
        for _ in 0..pieces as u32 {
            self.piece(world, wanted, duration_s / pieces);
        }
        &self.state
    }

    /// Stands still for a time, as for a probe.
    pub fn wait(&mut self, world: &World, duration_s: f64) {
        self.step(world, Command::default(), duration_s);
    }

    fn piece(&mut self, world: &World, wanted: Command, dt_s: f64) {
        let before = self.state;
        let fares = self.fares[world.soil_at(place(&before.pose)) as usize];
        self.state.time_s += dt_s;
        if before.stop == Some(Stop::Sunk) || !fares.go {
            self.halt(Stop::Sunk);
            self.rest(world);
            return;
        }
        let ahead = if wanted.speed_mps < 0.0 || (wanted.speed_mps == 0.0 && before.wheel_speed_mps < 0.0) {
            -1.0
        } else {
            1.0
        };
        let grade = before.pose.pitch_rad.tan() * ahead;
        self.turn_wheels(wanted, &fares, grade, dt_s);
        let state = self.state;
        let moving = if state.wheel_speed_mps < 0.0 { -1.0 } else { 1.0 };
        let slip = self.slip(&fares, before.pose.pitch_rad.tan() * moving);
        let speed_mps = state.wheel_speed_mps * (1.0 - slip);
        let lost = if self.motion.steering == Steering::Skid {
            SKID_TURN_LOSS
        } else {
            0.0
        };
        // A car turns with the ground that it covers.
        let turned = if self.motion.steering == Steering::Ackermann {
            1.0 - slip.max(0.0)
        } else {
            1.0 - lost
        };
        let turn_rate_radps = self.allowed_turn(state.wheel_turn_rate_radps * turned, f64::INFINITY);
        let lean = before.pose.roll_rad.tan();
        let drift = slip_for(lean.abs() / self.vehicle.traction_friction).min(1.0);
        // Right side down is positive: downhill is then to the right.
        let sideways_mps = -speed_mps.abs() * drift * lean.signum();
        let pose = along_arc(&before.pose, speed_mps, sideways_mps, turn_rate_radps, dt_s);
        let stop = if world.collides(&self.vehicle, &pose, self.state.time_s) {
            Some(Stop::Collision)
        } else {
            let off = world.ground_under(&self.vehicle, &pose).is_err();
            let was_on = world.ground_under(&self.vehicle, &before.pose).is_ok();
            (off && was_on).then_some(Stop::Edge)
        };
        if let Some(stop) = stop {
            if stop == Stop::Collision && self.hit_at.is_none_or(|hit| hit.distance_m(&before.pose) > NEW_HIT_M) {
                self.state.collisions += 1;
                self.hit_at = Some(before.pose);
            }
            self.halt(stop);
        } else {
            self.state.pose = pose;
            self.state.speed_mps = speed_mps;
            self.state.turn_rate_radps = turn_rate_radps;
            self.state.slip = slip;
        }
        self.rest(world);
    }

    /// Brings the running gear towards the command within every limit.
    fn turn_wheels(&mut self, wanted: Command, fares: &Trafficability, grade: f64, dt_s: f64) {
        let mut most = fares.powered_speed_mps(&self.vehicle, grade);
        if grade > fares.drawbar_grade {
            most = 0.0;
        }
        let target = wanted.speed_mps.clamp(-most, most);
        let speed = self.state.wheel_speed_mps;
        let slowing = target * speed < 0.0 || target.abs() < speed.abs();
        let rate = if slowing {
            // Brakes hold no better than the ground; they never fail altogether.
            let uphill = self.state.pose.pitch_rad.tan() * speed.signum();
            let held = GRAVITY_MPS2 * (self.vehicle.braking_friction + uphill) / (1.0 + uphill * uphill).sqrt();
            self.motion.max_braking_mps2.min(held.max(0.1))
        } else {
            self.motion.max_acceleration_mps2
        };
        // Through standstill in a piece of its own, because braking and acceleration differ.
        let target = if target * speed < 0.0 { 0.0 } else { target };
        self.state.wheel_speed_mps = speed + (target - speed).clamp(-rate * dt_s, rate * dt_s);
        // The wheels at half the width reach the turn by the same acceleration.
        let turning = 2.0 * self.motion.max_acceleration_mps2 / self.vehicle.width_m;
        let rate = self.state.wheel_turn_rate_radps;
        let turn = rate + (wanted.turn_rate_radps - rate).clamp(-turning * dt_s, turning * dt_s);
        self.state.wheel_turn_rate_radps = self.allowed_turn(turn, self.state.wheel_speed_mps);
    }

    fn slip(&self, fares: &Trafficability, grade: f64) -> f64 {
        let count = (self.state.time_s / SLIP_DRAW_S) as u64;
        let drawn = self.noise.normals(Stream::Slip, count, 0)[0];
        let variation = (1.0 + self.slip_variation * drawn).clamp(0.0, 2.0);
        let load = fares.rolling_resistance + grade;
        if load >= 0.0 {
            let used = load / (fares.rolling_resistance + fares.drawbar_grade).max(1e-9);
            (slip_for(used) * variation).min(1.0)
        } else {
            -(slip_for(-load / self.vehicle.braking_friction) * variation).min(1.0)
        }
    }

    fn halt(&mut self, stop: Stop) {
        self.state.wheel_speed_mps = 0.0;
        self.state.wheel_turn_rate_radps = 0.0;
        self.state.speed_mps = 0.0;
        self.state.turn_rate_radps = 0.0;
        self.state.stop = Some(stop);
    }

    /// Takes height, attitude and limits from the ground; off known ground the attitude stays.
    fn rest(&mut self, world: &World) {
        let pose = &mut self.state.pose;
        self.state.no_go = match world.ground_under(&self.vehicle, pose) {
            Ok(ground) => {
                (pose.pitch_rad, pose.roll_rad) = (ground.pitch_rad, ground.roll_rad);
                self.state.height_m = ground.height_m;
                let backwards = self.state.wheel_speed_mps < 0.0;
                let grade = if backwards {
                    -ground.pitch_rad.tan()
                } else {
                    ground.pitch_rad.tan()
                };
                if !self.fares[ground.soil as usize].go {
                    Some(NoGo::Soil)
                } else if grade > self.vehicle.grade_up || -grade > self.vehicle.grade_down {
                    Some(NoGo::Grade)
                } else if ground.roll_rad.tan().abs() > self.vehicle.max_side_slope() {
                    Some(NoGo::SideSlope)
                } else {
                    None
                }
            }
            Err(reason) => Some(reason),
        };
    }
}

fn place(pose: &Pose) -> Position {
    Position::new(pose.x_m, pose.y_m)
}

/// Slip at which a share of the greatest traction is used; infinite at all of it.
fn slip_for(used: f64) -> f64 {
    if used < 1.0 {
        -(1.0 - used).ln() / TRACTION_RATE
    } else {
        f64::INFINITY
    }
}

/// The pose after driving a circular arc, with a drift to the left of the middle heading.
fn along_arc(from: &Pose, speed_mps: f64, left_mps: f64, turn_rate_radps: f64, dt_s: f64) -> Pose {
    let half_turn = turn_rate_radps * dt_s / 2.0;
    let chord = if half_turn.abs() < 1e-9 {
        1.0
    } else {
        half_turn.sin() / half_turn
    };
    let (sin, cos) = (from.heading_rad + half_turn).sin_cos();
    // Distances are along the slope; the map sees their horizontal part.
    let ahead_m = speed_mps * dt_s * chord * from.pitch_rad.cos();
    let left_m = left_mps * dt_s * from.roll_rad.cos();
    Pose {
        x_m: from.x_m + cos * ahead_m - sin * left_m,
        y_m: from.y_m + sin * ahead_m + cos * left_m,
        heading_rad: wrap(from.heading_rad + turn_rate_radps * dt_s),
        ..*from
    }
}

#[cfg(test)]
#[path = "body_tests.rs"]
mod tests;
