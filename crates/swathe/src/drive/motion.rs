//! From a place to drive to, to a speed and a turn rate that are safe.

use crate::grid::Position;
use crate::nest::Navigability;
use crate::sensor::{Pose, Scan, wrap};

use super::event::{Event, Recovery};
use super::follow::{THREAD_LEAST_M, THREAD_MARGIN_M};
use super::navigator::Navigator;
use super::params::REST_MPS;
use super::region::RegionState;
use super::safety::{Sight, along};
use super::steer::Situation;

/// Off the wanted direction by this much, a robot that can turns in place.
const IN_PLACE_RAD: f64 = 0.9;

/// Turn rate by radian off the wanted direction.
const TURN_GAIN: f64 = 2.0;

/// Speed next to trouble: on a closed histogram, backing, slipping; as a share of the greatest.
const CAREFUL_SHARE: f64 = 0.25;

/// Share of the brakes with which a goal is come to.
const ARRIVE_SHARE: f64 = 0.8;

/// Off the way by this much, the local method is only asked after the way itself, at this share of the greatest speed.
const STRAY_RAD: f64 = 0.7;
const STRAY_SHARE: f64 = 0.5;

/// Speed below which a vehicle turns in place, and the angle that is looked at for it.
pub(super) const ROLLS_MPS: f64 = 0.1;
pub(super) const TURN_LOOK_RAD: f64 = 0.6;

/// Share of the limits of grade and side slope that arcs may use: vehicles do not keep to them exactly.
const STEEPEST: f64 = 0.99;

/// Turn between two places of an arc that are looked at.
const STEP_RAD: f64 = 0.1;

/// By how much a radian of turn must lessen that share where it is more.
const RELIEF_PER_RAD: f64 = 0.1;

/// Headings to each side of the way that are tried on slopes, and from one to the next.
const FAN: u32 = 8;
const FAN_STEP_RAD: f64 = 0.2;

/// Seconds at rest with nothing to do but wait that call for a recovery.
const BLOCKED_S: f64 = 1.5;

/// What a step has found out before it decides.
pub(super) struct Now<'a> {
    pub time_s: f64,
    pub step_s: f64,
    /// Age of the last usable scan.
    pub age_s: f64,
    pub pose: Pose,
    pub speed_mps: f64,
    pub turn_rate_radps: f64,
    pub scan: Option<&'a Scan>,
    pub answer: Option<Navigability>,
    pub aim: Position,
}

impl Now<'_> {
    pub fn at(&self) -> Position {
        Position::new(self.pose.x_m, self.pose.y_m)
    }

    /// Angle from the nose to what is driven to.
    pub fn off_rad(&self) -> f64 {
        let at = self.at();
        wrap((self.aim.y_m - at.y_m).atan2(self.aim.x_m - at.x_m) - self.pose.heading_rad)
    }
}

/// Wheels that skid turn a vehicle by up to this share less than they are told.
const SKID_SHARE: f64 = 0.15;

impl Navigator {
    /// Distance kept from obstacles at a speed.
    pub(super) fn margin_m(&self, speed_mps: f64) -> f64 {
        // What stands is known to half a cell at worst.
        let half_m = 0.5 * self.grid.params().cell_size_m;
        let rest_m = if self.recovery == Some(Recovery::Thread) {
            THREAD_MARGIN_M
        } else {
            self.params.margin_m.max(half_m)
        };
        rest_m + 0.05 * speed_mps.abs().min(self.shape.max_speed_mps)
    }

    /// Distance kept from what is nearer than the margin already.
    pub(super) fn least_m(&self) -> f64 {
        if self.recovery == Some(Recovery::Thread) {
            THREAD_LEAST_M
        } else {
            THREAD_MARGIN_M
        }
    }

    /// Chooses where to, how fast, and checks that it is safe.
    pub(super) fn drive(&mut self, now: &Now) -> (f64, f64) {
        let at = now.at();
        let share = (now.speed_mps.abs() / self.shape.max_speed_mps).min(1.0);
        let [least_m, most_m] = self.params.lookahead_m;
        let lookahead_m = (least_m + (most_m - least_m) * share).max(1.5 * self.shape.radius_m);
        let is_steep = self
            .region
            .as_ref()
            .is_some_and(|region| region.is_steep_around(at, lookahead_m));
        // What a slope costs on another heading than that of the way is not known here.
        let sight_m = if is_steep { lookahead_m } else { f64::INFINITY };
        let on_way = self
            .window
            .as_ref()
            .and_then(|window| window.ahead(at, lookahead_m, sight_m));
        let target = on_way.unwrap_or(now.aim);
        let steering = self.local.steer(
            &self.shape,
            &Situation {
                grid: &self.grid,
                scan: now.scan,
                pose: &now.pose,
                speed_mps: now.speed_mps,
                step_s: now.step_s,
                target,
                region: self.region.as_ref(),
                margin_m: self.margin_m(now.speed_mps),
            },
        );
        let target_rad = (target.y_m - at.y_m).atan2(target.x_m - at.x_m);
        let mut directions = Vec::with_capacity(4);
        // The histogram does not know that obstacles behind the goal do not matter.
        let is_last = at.distance_m(now.aim) <= lookahead_m;
        if is_last && self.window.as_ref().is_some_and(|window| window.sees(at, now.aim)) {
            let aim_rad = wrap(now.pose.heading_rad + now.off_rad());
            directions.push((aim_rad, 1.0 - 0.8 * steering.crowding));
        }
        // A histogram that turns away from an open way would lead to and fro.
        let strays = |direction_rad: f64| wrap(direction_rad - target_rad).abs() > STRAY_RAD;
        if self.params.memory && on_way.is_some() && steering.direction_rad.is_some_and(strays) {
            directions.push((target_rad, STRAY_SHARE));
        }
        match steering.direction_rad {
            Some(direction_rad) => directions.push((direction_rad, 1.0 - 0.8 * steering.crowding)),
            None => self.events.push(Event::LocalClosed),
        }
        // The memory knows ways that the histogram is too coarse for; the sweep decides whether they are free.
        if self.params.memory && on_way.is_some() {
            directions.push((target_rad, CAREFUL_SHARE));
        }
        let first_rad = directions.first().map_or(target_rad, |first| first.0);
        self.watch.note_turn(now.time_s, wrap(first_rad - now.pose.heading_rad));
        // Across a slope the way may be too steep: the nearest heading that is not leads around.
        if is_steep {
            for aside in 1..=FAN {
                let aside_rad = f64::from(aside) * FAN_STEP_RAD;
                directions.push((target_rad + aside_rad, CAREFUL_SHARE));
                directions.push((target_rad - aside_rad, CAREFUL_SHARE));
            }
        }
        for (direction_rad, share) in directions {
            let wanted = self.towards(now, direction_rad, share);
            if wanted != (0.0, 0.0) {
                self.blocked_since_s = None;
                return wanted;
            }
        }
        self.blocked_since_s.get_or_insert(now.time_s);
        (0.0, 0.0)
    }

    /// Speed and turn rate towards a direction, as fast as is safe; zero when it is not.
    fn towards(&self, now: &Now, direction_rad: f64, share: f64) -> (f64, f64) {
        let shape = &self.shape;
        let off_rad = wrap(direction_rad - now.pose.heading_rad);
        let wanted_turn = (TURN_GAIN * off_rad).clamp(-shape.max_turn_rate_radps, shape.max_turn_rate_radps);
        if shape.turns_in_place() && off_rad.abs() > IN_PLACE_RAD {
            return self.turn(now, off_rad);
        }
        let turning = (wanted_turn / shape.max_turn_rate_radps).abs();
        let mut speed_mps = shape.max_speed_mps * share * (1.0 - 0.7 * turning) * self.ground_share(now);
        if let Some(region) = &self.region {
            speed_mps = speed_mps.min(region.going_mps(&now.pose));
        }
        // Arrive, rather than run past.
        let left_m = now.at().distance_m(now.aim).min(self.probing.left_m());
        speed_mps = speed_mps.min(shape.speed_for(left_m, ARRIVE_SHARE * shape.braking_mps2, 0.0) + 0.1);
        speed_mps = speed_mps.clamp(0.05_f64.min(shape.max_speed_mps), shape.max_speed_mps);
        let turn_radps = shape.turn_rate(wanted_turn, speed_mps);
        let curvature = turn_radps / speed_mps;
        let safe_mps = self.safe_mps(now, curvature, true);
        if safe_mps < REST_MPS {
            if shape.turns_in_place() && off_rad.abs() > 0.1 {
                return self.turn(now, off_rad);
            }
            return (0.0, 0.0);
        }
        let faster = now.speed_mps.max(self.last_command.speed_mps).max(0.0) + shape.acceleration_mps2 * now.step_s;
        let speed_mps = speed_mps.min(safe_mps).min(faster.max(REST_MPS));
        (speed_mps, curvature * speed_mps)
    }

    /// Turns in place towards an angle off the nose, when the footprint is free to.
    fn turn(&self, now: &Now, off_rad: f64) -> (f64, f64) {
        // Stop first: what is swept while rolling on is not looked at.
        if now.speed_mps.abs() > ROLLS_MPS {
            return (0.0, 0.0);
        }
        for wanted_rad in [off_rad, off_rad - off_rad.signum() * std::f64::consts::TAU] {
            let looked_rad = wanted_rad.clamp(-TURN_LOOK_RAD, TURN_LOOK_RAD);
            let free_rad = self.free_turn_rad(now, looked_rad);
            if free_rad.abs() >= 0.1 {
                let most = self.turn_rate_within(free_rad, now);
                return (0.0, (TURN_GAIN * wanted_rad).clamp(-most, most));
            }
        }
        (0.0, 0.0)
    }

    /// How much of a turn in place is free and brings the wheels onto no slope beyond their limits.
    pub(super) fn free_turn_rad(&self, now: &Now, wanted_rad: f64) -> f64 {
        let free_rad = self.around.turn_rad(&self.shape, wanted_rad);
        match &self.region {
            Some(region) => region.turn_allowed_rad(&now.pose, free_rad),
            None => free_rad,
        }
    }

    /// Greatest turn rate in place from which the vehicle stands within a free angle: its wheels, half its width aside, brake as
    /// they do straight ahead.
    pub(super) fn turn_rate_within(&self, free_rad: f64, now: &Now) -> f64 {
        let braking = self.shape.acceleration_mps2.min(self.shape.braking_mps2) / self.shape.half_width_m;
        let lost = braking * (now.age_s + 2.0 * now.step_s.min(0.5));
        let rate = lost.mul_add(lost, 2.0 * braking * free_rad.abs()).sqrt() - lost;
        rate.min(self.shape.max_turn_rate_radps)
    }

    /// Greatest speed along an arc from which the vehicle stops within what is free and seen.
    pub(super) fn safe_mps(&self, now: &Now, curvature: f64, forward: bool) -> f64 {
        let shape = &self.shape;
        let braking_mps2 = self.braking_mps2(&now.pose, forward);
        if braking_mps2 <= 0.0 {
            return 0.0;
        }
        let sight = Sight {
            grid: &self.grid,
            pose: &now.pose,
            scan: now.scan,
        };
        let speed = now.speed_mps.abs().max(self.last_command.speed_mps.abs()) + shape.acceleration_mps2 * now.step_s;
        let reach_m = shape.stopping_m(speed.min(shape.max_speed_mps)) + 1.0;
        let free_m = self
            .around
            .free_m(shape, curvature, forward, reach_m, |ahead_m, left_m| {
                sight.has(ahead_m, left_m)
            });
        let free_m = free_m.min(self.allowed_m(&now.pose, curvature, forward, reach_m));
        let buffer_m = 0.5 * self.grid.params().cell_size_m;
        shape.speed_for(free_m - buffer_m, braking_mps2, now.age_s + now.step_s.min(0.5))
    }

    /// The command, or one from which the vehicle still stops in time: however it moves now, it cannot be on another arc at once.
    pub(super) fn guarded(&self, now: &Now, wanted: (f64, f64)) -> (f64, f64) {
        let moves = (now.speed_mps, now.turn_rate_radps);
        let step_s = now.step_s.min(0.5);
        let told_s = now.age_s + 2.0 * step_s;
        let wanted = self.shape.within_turn_rate(wanted);
        let follows = |told: (f64, f64), told_s: f64| self.around.stays_clear(&self.shape, moves, told, told_s);
        let clears = |told: (f64, f64), told_s: f64| {
            let is_arc = self.shape.turns_in_place() && told.0 != 0.0 && told.1 != 0.0;
            follows(told, told_s) && (!is_arc || follows((told.0, (1.0 - SKID_SHARE) * told.1), told_s))
        };
        // The next step must be free to stop as well as to go on.
        let is_safe = |told: (f64, f64)| clears(told, told_s) && clears(told, told_s - step_s);
        let slower = [1.0, 0.5, 0.25].map(|share| (share * wanted.0, share * wanted.1));
        if let Some(told) = slower.into_iter().find(|&told| is_safe(told)) {
            return told;
        }
        // The last command was found clear with a stop after one more step of it, not with one at once. What moves is another thing:
        // for it a stop is the best.
        let last = (self.last_command.speed_mps, self.last_command.turn_rate_radps);
        if wanted != (0.0, 0.0) && !clears((0.0, 0.0), 0.0) && clears(last, 0.5 * told_s) {
            return last;
        }
        (0.0, 0.0)
    }

    /// Metres along an arc before the middle of the robot would come onto ground that the map forbids, or its wheels onto slopes
    /// beyond its limits. Where it is beyond them already, it may go where they are no steeper.
    pub(super) fn allowed_m(&self, pose: &Pose, curvature_per_m: f64, forward: bool, reach_m: f64) -> f64 {
        let Some(region) = self.region.as_ref() else {
            return reach_m;
        };
        // Neither a cell nor much of a turn is stepped over.
        let step_m = self
            .grid
            .params()
            .cell_size_m
            .min((STEP_RAD / curvature_per_m.abs()).max(0.02));
        let (sin, cos) = pose.heading_rad.sin_cos();
        let side = if forward { 1.0 } else { -1.0 };
        let steps = (reach_m / step_m).ceil() as usize;
        let at = Position::new(pose.x_m, pose.y_m);
        let steepest = region
            .is_steep_around(at, reach_m)
            .then(|| region.steepness(at, pose.heading_rad, forward));
        let forbidden = (1..=steps).find(|&k| {
            let (ahead_m, left_m, turn_rad) = along(curvature_per_m, side * k as f64 * step_m);
            let (east_m, north_m) = (cos * ahead_m - sin * left_m, sin * ahead_m + cos * left_m);
            let place = Position::new(pose.x_m + east_m, pose.y_m + north_m);
            // A turn that is no relief would creep beyond the limits bit by bit.
            let steep = |now: f64| {
                let most = STEEPEST.max(now - RELIEF_PER_RAD * turn_rad.abs());
                region.steepness(place, pose.heading_rad + turn_rad, forward) > most
            };
            region.forbids(place) || steepest.is_some_and(steep)
        });
        forbidden.map_or(reach_m, |k| (k - 1) as f64 * step_m)
    }

    /// Braking on the slope that the robot stands on: what it does on the level as long as its wheels hold, as the planner and the
    /// simulated body have it.
    pub(super) fn braking_mps2(&self, pose: &Pose, forward: bool) -> f64 {
        let uphill = if forward { pose.pitch_rad } else { -pose.pitch_rad };
        let grip = self.shape.braking_friction * uphill.cos() + uphill.sin();
        self.shape.braking_mps2.min(crate::vehicle::GRAVITY_MPS2 * grip)
    }

    /// Share of the greatest speed that the ground allows.
    fn ground_share(&self, now: &Now) -> f64 {
        let nests = now.answer.map_or(1.0, RegionState::speed_factor);
        if now.time_s < self.slip_until_s {
            0.5 * nests
        } else {
            nests
        }
    }

    /// Whether the robot has stood for long with nothing safe to do.
    pub(super) fn is_blocked(&self, time_s: f64) -> bool {
        self.blocked_since_s.is_some_and(|since| time_s - since > BLOCKED_S)
    }

    /// Speed next to trouble.
    pub(super) fn careful_mps(&self) -> f64 {
        CAREFUL_SHARE * self.shape.max_speed_mps
    }
}
