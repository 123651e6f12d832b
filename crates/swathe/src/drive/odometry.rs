//! Dead reckoning from the speeds that the robot is told, beside its pose: when the pose was corrected, and how much it may be off.

use std::collections::VecDeque;

use crate::local::PoseDoubt;
use crate::sensor::{Pose, wrap};

/// A pose that moves otherwise than the wheels by this much, and half of what they moved, in one step was corrected, and for how
/// long a scan may be late for it.
const CORRECTED_M: f64 = 0.02;
const CORRECTED_RAD: f64 = 0.01;
const LATE_S: f64 = 0.5;

/// Seconds in which the doubt that a correction left fades to 1/e.
const DOUBT_S: f64 = 10.0;

/// From the frame of the pose to that of odometry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Shift {
    x_m: f64,
    y_m: f64,
    turn_rad: f64,
}

impl Shift {
    fn between(pose: &Pose, odometry: &Pose) -> Self {
        let turn_rad = wrap(odometry.heading_rad - pose.heading_rad);
        let (sin, cos) = turn_rad.sin_cos();
        Self {
            x_m: odometry.x_m - (cos * pose.x_m - sin * pose.y_m),
            y_m: odometry.y_m - (sin * pose.x_m + cos * pose.y_m),
            turn_rad,
        }
    }

    /// A pose in the frame of odometry.
    pub fn pose(&self, pose: &Pose) -> Pose {
        let (sin, cos) = self.turn_rad.sin_cos();
        Pose::level(
            self.x_m + cos * pose.x_m - sin * pose.y_m,
            self.y_m + sin * pose.x_m + cos * pose.y_m,
            wrap(pose.heading_rad + self.turn_rad),
        )
    }

    /// A place and a velocity of odometry in the frame of the pose.
    pub fn back(&self, (x_m, y_m): (f64, f64), (vx, vy): (f64, f64)) -> [f64; 4] {
        let (sin, cos) = self.turn_rad.sin_cos();
        let (x_m, y_m) = (x_m - self.x_m, y_m - self.y_m);
        [
            cos * x_m + sin * y_m,
            cos * y_m - sin * x_m,
            cos * vx + sin * vy,
            cos * vy - sin * vx,
        ]
    }
}

/// Dead reckoning, and how the pose lay to it.
#[derive(Clone, Debug, Default)]
pub(super) struct Odometry {
    pose: Pose,
    /// How pose and odometry lay to each other, and until when, the last first.
    shifts: VecDeque<(f64, Shift)>,
    doubt: PoseDoubt,
}

impl Odometry {
    /// Takes in how the robot moved since the last call.
    pub fn roll(&mut self, time_s: f64, pose: &Pose, (speed_mps, turn_radps): (f64, f64), step_s: f64) {
        let middle_rad = self.pose.heading_rad + turn_radps * step_s / 2.0;
        self.pose = Pose::level(
            self.pose.x_m + speed_mps * step_s * middle_rad.cos(),
            self.pose.y_m + speed_mps * step_s * middle_rad.sin(),
            wrap(self.pose.heading_rad + turn_radps * step_s),
        );
        let shift = Shift::between(pose, &self.pose);
        let keep = (-step_s.max(0.0) / DOUBT_S).exp();
        self.doubt.place_m *= keep;
        self.doubt.heading_rad *= keep;
        while self.shifts.len() > 1 && self.shifts.back().is_some_and(|(then_s, _)| *then_s < time_s - LATE_S) {
            self.shifts.pop_back();
        }
        if let Some((then_s, last)) = self.shifts.front_mut() {
            // A pose that goes on about as the wheels tell is the better odometry: speeds change within a step.
            let here = last.pose(pose);
            let off_m = here.distance_m(&self.pose);
            let off_rad = wrap(here.heading_rad - self.pose.heading_rad).abs();
            if off_m < CORRECTED_M + 0.5 * (speed_mps * step_s).abs()
                && off_rad < CORRECTED_RAD + 0.5 * (turn_radps * step_s).abs()
            {
                *then_s = time_s;
                self.pose = here;
                return;
            }
            self.doubt.place_m = self.doubt.place_m.max(off_m);
            self.doubt.heading_rad = self.doubt.heading_rad.max(off_rad);
        }
        self.shifts.push_front((time_s, shift));
    }

    /// How pose and odometry lay to each other lately, the last first.
    pub fn shifts(&self) -> impl Iterator<Item = &Shift> {
        self.shifts.iter().map(|(_, shift)| shift)
    }

    /// How far poses may be off each other: as far as the greatest correction of the last seconds moved them.
    pub fn doubt(&self) -> PoseDoubt {
        self.doubt
    }
}
