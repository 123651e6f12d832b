//! Faults of the sensors by schedule: what goes wrong between the robot's sensors and its navigator.

use std::collections::VecDeque;

use crate::sensor::{PenetrometerReading, Pose, Scan, wrap};

use super::EpisodeError;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaultKind {
    /// No scan arrives.
    ScanDead,
    /// Every range is NaN.
    ScanNan,
    /// Every range is 0.
    ScanZero,
    /// A scan has this many beams, the first ones or with infinite ones added.
    ScanBeams(usize),
    /// Every range is the greatest.
    ScanMax,
    /// The first scan comes again and again.
    ScanRepeated,
    /// Scans come this many seconds later.
    ScanLate(f64),
    /// Every other scan comes after the one that was taken after it.
    ScanSwapped,
    /// The pose is off by this much east, north and in heading; a jump at the start and at the end.
    PoseOff([f64; 3]),
    /// The clock is off by this many seconds.
    ClockOff(f64),
    /// Readings of the penetrometer have this cone index in kPa.
    ReadingOf(f64),
}

impl FaultKind {
    /// The word for it, as in Python.
    pub fn name(self) -> &'static str {
        match self {
            Self::ScanDead => "scan_dead",
            Self::ScanNan => "scan_nan",
            Self::ScanZero => "scan_zero",
            Self::ScanBeams(_) => "scan_beams",
            Self::ScanMax => "scan_max",
            Self::ScanRepeated => "scan_repeated",
            Self::ScanLate(_) => "scan_late",
            Self::ScanSwapped => "scan_swapped",
            Self::PoseOff(_) => "pose_off",
            Self::ClockOff(_) => "clock_off",
            Self::ReadingOf(_) => "reading_of",
        }
    }
}

/// Something that goes wrong for a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fault {
    /// First moment in seconds.
    pub from_s: f64,
    /// First moment at which it is over; infinite for good.
    pub until_s: f64,
    /// What goes wrong.
    pub kind: FaultKind,
}

/// Most beams that a wrong scan may have, and the longest extra delay in seconds.
const BEAMS_MAX: usize = 10_000;
const LATE_MAX_S: f64 = 60.0;

impl Fault {
    pub(super) fn validate(&self) -> Result<(), EpisodeError> {
        let figure = |name, given, allowed| Err(EpisodeError::Figure { name, given, allowed });
        if !(self.from_s >= 0.0 && self.from_s.is_finite()) {
            return figure("start of a fault", self.from_s, "it must be at least 0 s");
        }
        if self.until_s.is_nan() || self.until_s < self.from_s {
            return figure("end of a fault", self.until_s, "it must not come before its start");
        }
        match self.kind {
            FaultKind::ScanBeams(beams) if beams > BEAMS_MAX => {
                figure("number of beams of a fault", beams as f64, "at most 10 000 are allowed")
            }
            FaultKind::ScanLate(late_s) if !(0.0..=LATE_MAX_S).contains(&late_s) => {
                figure("delay of a fault", late_s, "0 to 60 s is allowed")
            }
            _ => Ok(()),
        }
    }

    pub(super) fn is_on(&self, time_s: f64) -> bool {
        time_s + 1e-9 >= self.from_s && time_s + 1e-9 < self.until_s
    }
}

/// A scan with the time at which it was taken.
pub(super) type Taken = (f64, Scan);

/// Scans that faults hold back.
#[derive(Clone, Debug, Default)]
pub(super) struct Held {
    /// Late ones with the time at which they come.
    late: VecDeque<(f64, Taken)>,
    /// One that comes after the next, and whether that has come.
    swapped: Option<(Taken, bool)>,
    /// The one that comes again and again, and by which fault.
    repeated: Option<(usize, Scan)>,
}

impl Held {
    /// What arrives of the scans now, the last to come at the end, when `scan` has come from the sensor.
    pub fn deliver(&mut self, faults: &[Fault], time_s: f64, scan: Option<Taken>) -> Vec<Taken> {
        let mut arriving = Vec::with_capacity(1);
        if let Some(taken) = scan {
            self.take(faults, time_s, taken, &mut arriving);
        }
        while self.late.front().is_some_and(|(due_s, _)| *due_s <= time_s + 1e-9) {
            arriving.extend(self.late.pop_front().map(|(_, taken)| taken));
        }
        arriving
    }

    fn take(&mut self, faults: &[Fault], time_s: f64, mut taken: Taken, arriving: &mut Vec<Taken>) {
        for (number, fault) in faults.iter().enumerate() {
            if !fault.is_on(time_s) {
                if self.repeated.as_ref().is_some_and(|(of, _)| *of == number) {
                    self.repeated = None;
                }
                continue;
            }
            let ranges_m = &mut taken.1.ranges_m;
            match fault.kind {
                FaultKind::ScanDead => return,
                FaultKind::ScanNan => ranges_m.fill(f64::NAN),
                FaultKind::ScanZero => ranges_m.fill(0.0),
                FaultKind::ScanBeams(beams) => ranges_m.resize(beams, f64::INFINITY),
                FaultKind::ScanMax => {
                    let most_m = taken.1.range_max_m;
                    ranges_m.fill(most_m);
                }
                FaultKind::ScanRepeated => match &self.repeated {
                    Some((_, first)) => taken.1.clone_from(first),
                    None => self.repeated = Some((number, taken.1.clone())),
                },
                FaultKind::ScanLate(late_s) => {
                    self.late.push_back((taken.0 + late_s, taken));
                    return;
                }
                FaultKind::ScanSwapped => {
                    // One scan a time, as steps take no more: the second, the first, the fourth, the third.
                    match self.swapped.take() {
                        None => {
                            self.swapped = Some((taken, false));
                            return;
                        }
                        Some((earlier, false)) => self.swapped = Some((earlier, true)),
                        Some((earlier, true)) => self.swapped = Some((std::mem::replace(&mut taken, earlier), false)),
                    }
                }
                FaultKind::PoseOff(_) | FaultKind::ClockOff(_) | FaultKind::ReadingOf(_) => {}
            }
        }
        arriving.push(taken);
    }
}

/// The clock as the navigator reads it.
pub(super) fn clock_s(faults: &[Fault], time_s: f64) -> f64 {
    let off = |fault: &Fault| match fault.kind {
        FaultKind::ClockOff(seconds) if fault.is_on(time_s) => seconds,
        _ => 0.0,
    };
    time_s + faults.iter().map(off).sum::<f64>()
}

/// The pose as it reaches the navigator.
pub(super) fn pose_told(faults: &[Fault], time_s: f64, pose: &Pose) -> Pose {
    let mut told = *pose;
    for fault in faults.iter().filter(|fault| fault.is_on(time_s)) {
        if let FaultKind::PoseOff([east_m, north_m, turn_rad]) = fault.kind {
            told.x_m += east_m;
            told.y_m += north_m;
            told.heading_rad = wrap(told.heading_rad + turn_rad);
        }
    }
    told
}

/// The reading as it reaches the navigator.
pub(super) fn reading_told(faults: &[Fault], time_s: f64, reading: &mut PenetrometerReading) {
    for fault in faults.iter().filter(|fault| fault.is_on(time_s)) {
        if let FaultKind::ReadingOf(kpa) = fault.kind {
            reading.cone_indices_kpa.fill(kpa);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn swapped_scans_come_one_by_one_each_after_the_next() {
        let faults = [Fault {
            kind: FaultKind::ScanSwapped,
            from_s: 0.0,
            until_s: 100.0,
        }];
        let scan = Scan {
            ranges_m: vec![1.0],
            angle_min_rad: 0.0,
            angle_increment_rad: 0.1,
            range_min_m: 0.0,
            range_max_m: 8.0,
            mount: crate::sensor::Mount::default(),
        };
        let mut held = Held::default();
        let mut told = |time_s: f64| -> Vec<f64> {
            let arriving = held.deliver(&faults, time_s, Some((time_s, scan.clone())));
            arriving.iter().map(|taken| taken.0).collect()
        };
        assert!(told(1.0).is_empty());
        let times: Vec<Vec<f64>> = (2..8).map(|second| told(f64::from(second))).collect();
        assert_eq!(times, [[2.0], [1.0], [4.0], [3.0], [6.0], [5.0]]);
    }
}
