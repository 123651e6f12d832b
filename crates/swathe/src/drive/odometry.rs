//! The pose that the drive goes by. Where the told pose is corrected it does not jump, but goes on as the wheels tell and comes to
//! the told one while the robot drives: what was seen a second ago stays where it is seen now. A scan that comes late is put to
//! where its sensor was on this way.

use std::borrow::Cow;
use std::collections::VecDeque;

use crate::local::PoseDoubt;
use crate::sensor::{Pose, Scan, wrap};

/// A pose that moves otherwise than the wheels by this much, and half of what they moved, in one step was corrected, and for how
/// long a scan may be late for it.
const CORRECTED_M: f64 = 0.02;
const CORRECTED_RAD: f64 = 0.01;
const LATE_S: f64 = 0.5;

/// Metres in which what is left of a correction falls to 1/e, and how little is left out.
const PULL_M: f64 = 5.0;
const PULLED_M: f64 = 1e-4;
const PULLED_RAD: f64 = 1e-5;

/// Seconds in which the doubt that a correction left fades to 1/e.
const DOUBT_S: f64 = 10.0;

/// From the told pose to the one that the drive goes by.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Shift {
    x_m: f64,
    y_m: f64,
    turn_rad: f64,
}

impl Shift {
    fn between(told: &Pose, own: &Pose) -> Self {
        let turn_rad = wrap(own.heading_rad - told.heading_rad);
        let (sin, cos) = turn_rad.sin_cos();
        Self {
            x_m: own.x_m - (cos * told.x_m - sin * told.y_m),
            y_m: own.y_m - (sin * told.x_m + cos * told.y_m),
            turn_rad,
        }
    }

    fn pose(&self, told: &Pose) -> Pose {
        let (sin, cos) = self.turn_rad.sin_cos();
        Pose {
            x_m: self.x_m + cos * told.x_m - sin * told.y_m,
            y_m: self.y_m + sin * told.x_m + cos * told.y_m,
            heading_rad: wrap(told.heading_rad + self.turn_rad),
            ..*told
        }
    }
}

/// The way of the pose that the drive goes by.
#[derive(Clone, Debug, Default)]
pub(super) struct Odometry {
    pose: Pose,
    /// How it lay to the told pose, and until when, the last first.
    shifts: VecDeque<(f64, Shift)>,
    /// Whether pose and wheels told otherwise in the last step.
    was_off: bool,
    sensor: Option<Pose>,
    doubt: PoseDoubt,
}

impl Odometry {
    /// Takes in how the robot moved since the last call; returns the pose to go by.
    pub fn roll(&mut self, time_s: f64, told: &Pose, (speed_mps, turn_radps): (f64, f64), step_s: f64) -> Pose {
        let Some((then_s, last)) = self.shifts.front_mut() else {
            self.shifts.push_front((time_s, Shift::default()));
            self.pose = *told;
            return *told;
        };
        let keep = (-step_s.max(0.0) / DOUBT_S).exp();
        self.doubt.place_m *= keep;
        self.doubt.heading_rad *= keep;
        let middle_rad = self.pose.heading_rad + turn_radps * step_s / 2.0;
        let reckoned = Pose {
            x_m: self.pose.x_m + speed_mps * step_s * middle_rad.cos(),
            y_m: self.pose.y_m + speed_mps * step_s * middle_rad.sin(),
            heading_rad: wrap(self.pose.heading_rad + turn_radps * step_s),
            ..*told
        };
        // A pose that goes on about as the wheels tell is the better odometry: speeds change within a step.
        let here = last.pose(told);
        let off_m = here.distance_m(&reckoned);
        let off_rad = wrap(here.heading_rad - reckoned.heading_rad).abs();
        let is_off = off_m >= CORRECTED_M + 0.5 * (speed_mps * step_s).abs()
            || off_rad >= CORRECTED_RAD + 0.5 * (turn_radps * step_s).abs();
        // Wheels that spin go on telling otherwise: the pose is right then.
        let was_off = std::mem::replace(&mut self.was_off, is_off);
        if is_off && !was_off {
            self.doubt.place_m = self.doubt.place_m.max(off_m);
            self.doubt.heading_rad = self.doubt.heading_rad.max(off_rad);
            self.pose = reckoned;
            self.shifts.push_front((time_s, Shift::between(told, &reckoned)));
        } else {
            let driven_m = here.distance_m(&self.pose);
            *then_s = time_s;
            self.pose = here;
            if *last != Shift::default() {
                self.pose = pulled(&here, told, 1.0 - (-driven_m / PULL_M).exp());
                *last = if self.pose == *told {
                    Shift::default()
                } else {
                    Shift::between(told, &self.pose)
                };
            }
        }
        let is_late = |(then_s, _): &(f64, Shift)| *then_s < time_s - LATE_S;
        while self.shifts.len() > 1 && self.shifts.back().is_some_and(is_late) {
            self.shifts.pop_back();
        }
        self.pose
    }

    /// The pose to go by for one that is told between the steps.
    pub fn now(&self, told: &Pose) -> Pose {
        self.shifts.front().map_or(*told, |(_, shift)| shift.pose(told))
    }

    /// A scan whose mount is where its sensor was on the way that the drive goes by. It may come from before the told pose was
    /// corrected: of the ways in which both lay to each other lately, that one holds which leads the sensor's way on.
    pub fn place<'a>(&mut self, told: &Pose, scan: &'a Scan) -> Cow<'a, Scan> {
        let seen_from = told.of_mount(&scan.mount);
        let last = self.sensor;
        let off = |sensor: &Pose| {
            last.map_or(0.0, |last| {
                last.distance_m(sensor) + wrap(last.heading_rad - sensor.heading_rad).abs()
            })
        };
        let sensor = self
            .shifts
            .iter()
            .map(|(_, shift)| shift.pose(&seen_from))
            .min_by(|one, other| off(one).total_cmp(&off(other)))
            .unwrap_or(seen_from);
        self.sensor = Some(sensor);
        if self.shifts.iter().all(|(_, shift)| *shift == Shift::default()) {
            return Cow::Borrowed(scan);
        }
        let mount = self.now(told).mount_of(&sensor);
        Cow::Owned(Scan { mount, ..scan.clone() })
    }

    /// How far poses may be off each other: as far as the greatest correction of the last seconds moved them.
    pub fn doubt(&self) -> PoseDoubt {
        self.doubt
    }
}

/// A pose moved towards another by a share of the way, or all of it where next to nothing is left.
fn pulled(pose: &Pose, to: &Pose, share: f64) -> Pose {
    let turn_rad = wrap(to.heading_rad - pose.heading_rad);
    if pose.distance_m(to) < PULLED_M && turn_rad.abs() < PULLED_RAD {
        return *to;
    }
    Pose {
        x_m: pose.x_m + share * (to.x_m - pose.x_m),
        y_m: pose.y_m + share * (to.y_m - pose.y_m),
        heading_rad: wrap(pose.heading_rad + share * turn_rad),
        ..*to
    }
}
