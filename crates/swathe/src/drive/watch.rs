//! What tells that the drive goes wrong: no headway, heading to and fro, wheels that slip, something that holds the robot.

use std::collections::VecDeque;

use crate::sensor::Pose;

use super::event::Reason;

/// Heading reversals within [`REVERSAL_S`] that make an oscillation.
const REVERSALS: usize = 3;
const REVERSAL_S: f64 = 10.0;

/// A wanted turn of at least this counts for a reversal.
const REVERSAL_RAD: f64 = 1.0;

/// Seconds over which wheels and pose are compared, and metres that the wheels must have gone.
const SLIP_S: f64 = 1.5;
const SLIP_M: f64 = 0.3;

/// Share of the wheels' way that must be lost to count as slipping.
const SLIP_SHARE: f64 = 0.7;

/// Earlier passes of a place that show that the drive goes round, and how many of the last places do not count for one.
const PASSES: usize = 3;
const LATELY: usize = 8;

#[derive(Clone, Copy, Debug)]
struct Moment {
    time_s: f64,
    x_m: f64,
    y_m: f64,
    /// Metres by the measured speed; backwards counts down, so that driving to and fro is no slip.
    measured_m: f64,
    /// Metres by the measured speed and by the commands, in either direction.
    turned_m: f64,
    commanded_m: f64,
}

/// The last seconds.
#[derive(Clone, Debug, Default)]
pub(super) struct Watch {
    moments: VecDeque<Moment>,
    reversals: VecDeque<f64>,
    side: f64,
    measured_m: f64,
    turned_m: f64,
    commanded_m: f64,
    /// Places of the drive, in order and some way apart, and how often the last of them was passed before.
    crumbs: Vec<(f64, f64)>,
    passes: usize,
}

impl Watch {
    /// Takes in a place of the drive.
    pub fn note_place(&mut self, x_m: f64, y_m: f64, apart_m: f64) {
        let away_m = |crumb: &(f64, f64)| (crumb.0 - x_m).hypot(crumb.1 - y_m);
        if self.crumbs.last().is_some_and(|last| away_m(last) < apart_m) {
            return;
        }
        let old = self.crumbs.len().saturating_sub(LATELY);
        let is_here: Vec<bool> = self.crumbs[..old]
            .iter()
            .map(|crumb| away_m(crumb) < 0.8 * apart_m)
            .collect();
        self.passes = is_here
            .iter()
            .zip(is_here.iter().skip(1))
            .filter(|&(&one, &next)| one && !next)
            .count();
        self.crumbs.push((x_m, y_m));
    }

    /// Forgets the places of the drive.
    pub fn forget_places(&mut self) {
        self.crumbs.clear();
        self.passes = 0;
    }

    /// Whether the drive comes to the same place again and again.
    pub fn goes_round(&self) -> bool {
        self.passes >= PASSES
    }

    /// Forgets the last seconds.
    pub fn restart(&mut self) {
        self.moments.clear();
        self.reversals.clear();
    }

    /// Takes in a step.
    pub fn note(&mut self, time_s: f64, step_s: f64, pose: &Pose, speed_mps: f64, commanded_mps: f64, keep_s: f64) {
        self.measured_m += speed_mps * step_s;
        self.turned_m += speed_mps.abs() * step_s;
        self.commanded_m += commanded_mps.abs() * step_s;
        self.moments.push_back(Moment {
            time_s,
            x_m: pose.x_m,
            y_m: pose.y_m,
            measured_m: self.measured_m,
            turned_m: self.turned_m,
            commanded_m: self.commanded_m,
        });
        while self.moments.len() > 2 && self.moments[1].time_s <= time_s - keep_s {
            self.moments.pop_front();
        }
    }

    /// Takes in how far the robot wants to turn.
    pub fn note_turn(&mut self, time_s: f64, turn_rad: f64) {
        if turn_rad.abs() < REVERSAL_RAD {
            return;
        }
        if self.side != 0.0 && self.side != turn_rad.signum() {
            self.reversals.push_back(time_s);
        }
        self.side = turn_rad.signum();
        while self.reversals.front().is_some_and(|&then| then < time_s - REVERSAL_S) {
            self.reversals.pop_front();
        }
    }

    /// Whether the robot stays in one place: nowhere in the last seconds was it farther away than `near_m`.
    pub fn trap(&self, seconds: f64, near_m: f64) -> Option<Reason> {
        let (first, last) = (self.moments.front()?, self.moments.back()?);
        if self.reversals.len() >= REVERSALS || self.goes_round() {
            return Some(Reason::Oscillating);
        }
        if last.time_s - first.time_s < seconds {
            return None;
        }
        let stays = |then: &Moment| (then.x_m - last.x_m).hypot(then.y_m - last.y_m) < near_m;
        self.moments.iter().all(stays).then_some(Reason::Trapped)
    }

    /// Share of the wheels' way that was lost in the last moments, when they turned enough to tell.
    pub fn slip(&self) -> Option<f64> {
        let (then, last) = self.moment(SLIP_S)?;
        let wheels_m = (last.measured_m - then.measured_m).abs();
        let share = 1.0 - (then.x_m - last.x_m).hypot(then.y_m - last.y_m) / wheels_m.max(1e-9);
        (wheels_m >= SLIP_M && share >= SLIP_SHARE).then_some(share)
    }

    /// Whether the robot is held: told to go, and neither wheels nor pose do.
    pub fn is_held(&self) -> bool {
        let Some((then, last)) = self.moment(2.0) else {
            return false;
        };
        let told_m = last.commanded_m - then.commanded_m;
        let most_m = (last.turned_m - then.turned_m).max((then.x_m - last.x_m).hypot(then.y_m - last.y_m));
        told_m >= SLIP_M && most_m < 0.2 * told_m
    }

    /// The moment some seconds ago, and the last one.
    fn moment(&self, seconds: f64) -> Option<(&Moment, &Moment)> {
        let last = self.moments.back()?;
        let then = self
            .moments
            .iter()
            .rev()
            .find(|then| then.time_s <= last.time_s - seconds)?;
        // A gap in time says nothing.
        (last.time_s - then.time_s < 2.0 * seconds).then_some((then, last))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twelve seconds of ten steps each: how fast the wheels turn, how fast the robot moves, how fast it is told to.
    fn drive(wheels_mps: f64, moves_mps: f64, told_mps: f64) -> Watch {
        let mut watch = Watch::default();
        for k in 0..120 {
            let time_s = f64::from(k) * 0.1;
            let pose = Pose::level(moves_mps * time_s, 0.0, 0.0);
            watch.note(time_s, 0.1, &pose, wheels_mps, told_mps, 8.0);
        }
        watch
    }

    #[test]
    fn a_robot_that_drives_is_left_alone() {
        let watch = drive(0.5, 0.5, 0.5);
        assert_eq!(watch.trap(8.0, 1.0), None);
        assert_eq!(watch.slip(), None);
        assert!(!watch.is_held());
    }

    #[test]
    fn slip_hold_and_trap_are_told_apart() {
        let slips = drive(0.5, 0.05, 0.5);
        assert!(slips.slip().is_some_and(|share| (share - 0.9).abs() < 0.02));
        assert!(!slips.is_held());
        let held = drive(0.0, 0.0, 0.5);
        assert_eq!(held.slip(), None);
        assert!(held.is_held());
        assert_eq!(held.trap(7.9, 1.0), Some(Reason::Trapped));
        assert!(!drive(0.0, 0.0, 0.0).is_held());
    }

    #[test]
    fn a_robot_that_turns_back_has_not_slipped() {
        let mut watch = Watch::default();
        for k in 0..40 {
            let time_s = f64::from(k) * 0.1;
            let speed = if k < 32 { -1.0 } else { 1.0 };
            let x_m = if k < 32 { -time_s } else { time_s - 6.4 };
            watch.note(time_s, 0.1, &Pose::level(x_m, 0.0, 0.0), speed, speed, 8.0);
        }
        assert_eq!(watch.slip(), None);
        assert!(!watch.is_held());
    }

    #[test]
    fn wanting_to_and_fro_is_an_oscillation() {
        let mut watch = drive(0.5, 0.5, 0.5);
        for k in 0..4 {
            watch.note_turn(12.0 + f64::from(k), if k % 2 == 0 { 1.5 } else { -1.5 });
        }
        assert_eq!(watch.trap(8.0, 1.0), Some(Reason::Oscillating));
        watch.note_turn(30.0, 1.5);
        assert_eq!(watch.trap(8.0, 1.0), None);
    }
}
