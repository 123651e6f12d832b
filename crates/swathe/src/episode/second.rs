//! What is recorded of an episode: rows, maps and events, in the order in which they came.

use crate::drive::{self, Status};
use crate::grid::{Layer, Position};
use crate::sensor::{PenetrometerReading, Pose, Scan};
use crate::sim::NoGo;

use super::judge::Verdict;

/// Scans that reached the robot, in the order of their arrival.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScanRows {
    /// When each was taken.
    pub times_s: Vec<f64>,
    /// When each arrived.
    pub arrivals_s: Vec<f64>,
    /// Ranges, `beams` to a scan. Scans of another length, which only faults make, are cut or filled with NaN.
    pub ranges_m: Vec<f32>,
    /// Beams of a scan of the sensor.
    pub beams: usize,
}

impl ScanRows {
    pub(super) fn push(&mut self, taken_s: f64, arrival_s: f64, scan: &Scan) {
        self.times_s.push(taken_s);
        self.arrivals_s.push(arrival_s);
        let missing = self.beams.saturating_sub(scan.ranges_m.len());
        self.ranges_m
            .extend(scan.ranges_m.iter().take(self.beams).map(|&range_m| range_m as f32));
        self.ranges_m.extend(std::iter::repeat_n(f32::NAN, missing));
    }
}

/// What the cones of the sonar ring heard, one row a cone, in the order of arrival; no rows without a ring.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SonarRows {
    /// When each was taken.
    pub times_s: Vec<f64>,
    /// When each arrived.
    pub arrivals_s: Vec<f64>,
    /// Number of the cone in the ring.
    pub cones: Vec<u8>,
    /// Its range: infinite is clear, NaN or below the least range invalid.
    pub ranges_m: Vec<f32>,
}

impl SonarRows {
    pub(super) fn push(&mut self, taken_s: f64, arrival_s: f64, cone: usize, scan: &Scan) {
        self.times_s.push(taken_s);
        self.arrivals_s.push(arrival_s);
        self.cones.push(cone as u8);
        let range_m = scan.ranges_m.first().copied().unwrap_or(f64::NAN);
        self.ranges_m.push(range_m as f32);
    }
}

/// Poses and speeds, one row a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotionRows {
    /// Times.
    pub times_s: Vec<f64>,
    /// Poses.
    pub poses: Vec<Pose>,
    /// Forward speeds in m/s.
    pub speeds_mps: Vec<f64>,
    /// Turn rates in rad/s.
    pub turn_rates_radps: Vec<f64>,
}

impl MotionRows {
    pub(super) fn push(&mut self, time_s: f64, pose: &Pose, speed_mps: f64, turn_rate_radps: f64) {
        self.times_s.push(time_s);
        self.poses.push(*pose);
        self.speeds_mps.push(speed_mps);
        self.turn_rates_radps.push(turn_rate_radps);
    }
}

/// Commands, one row a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CommandRows {
    /// Times.
    pub times_s: Vec<f64>,
    /// Speeds in m/s.
    pub speeds_mps: Vec<f64>,
    /// Turn rates in rad/s.
    pub turn_rates_radps: Vec<f64>,
    /// [`status_code`]s.
    pub statuses: Vec<u8>,
}

/// A status as a number: driving, recovering, reached, stopped, `no_route`, fault.
pub fn status_code(status: Status) -> u8 {
    match status {
        Status::Driving => 0,
        Status::Recovering => 1,
        Status::Reached => 2,
        Status::Stopped => 3,
        Status::NoRoute => 4,
        Status::Fault => 5,
    }
}

/// The certainty window at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct CertaintyMap {
    /// When.
    pub time_s: f64,
    /// Certainties as [`drive::Navigator::certainty_window`] gives them.
    pub certainty: Layer<u8>,
}

/// The local method's histogram at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct HistogramRow {
    /// When.
    pub time_s: f64,
    /// What the method saw and chose.
    pub histogram: drive::Histogram,
}

/// Where what moves was.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MoverRows {
    /// Times.
    pub times_s: Vec<f64>,
    /// Places, all movers of a time one after the other.
    pub positions: Vec<Position>,
    /// Radii in metres.
    pub radii_m: Vec<f64>,
}

/// What the overlapping grids said, one row a step; no rows without a region.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GridRows {
    /// Times.
    pub times_s: Vec<f64>,
    /// Each grid's answer, `grids` to a row.
    pub answers: Vec<bool>,
    /// Number of grids.
    pub grids: usize,
    /// The answer in the grids' mode.
    pub navigable: Vec<bool>,
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq)]
pub enum Happening {
    /// The navigator told it.
    Drive(drive::Event),
    /// A fault of the sensors begins.
    FaultBegins(&'static str),
    /// A fault of the sensors is over.
    FaultEnds(&'static str),
    /// The penetrometer is pushed in.
    ProbeBegins {
        /// Where the robot thinks it is.
        at: Position,
        /// How long it takes.
        seconds: f64,
    },
    /// The body ran into something.
    Collision {
        /// Where its middle was in truth.
        at: Position,
        /// Whether what it ran into moves.
        moves: bool,
        /// Whether the sensor could see it while there was time to stop.
        seen_in_time: bool,
    },
    /// The body sank in and moves no more.
    Sunk,
    /// The body came onto ground beyond the vehicle's limits.
    NoGoEntered {
        /// Where its middle is in truth.
        at: Position,
        /// Which limit.
        reason: NoGo,
    },
    /// The episode is over.
    End {
        /// How.
        verdict: Verdict,
        /// Why, in a sentence.
        reason: &'static str,
    },
}

/// What happened in one call of [`super::Episode::advance`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Second {
    /// First moment.
    pub start_s: f64,
    /// First moment of the next one.
    pub end_s: f64,
    /// Scans.
    pub scans: ScanRows,
    /// What the sonar ring heard.
    pub sonar: SonarRows,
    /// The robot as it believes: pose, speed of its wheels, turn rate.
    pub odometry: MotionRows,
    /// The body.
    pub truth: MotionRows,
    /// Commands.
    pub commands: CommandRows,
    /// Everything else that happened.
    pub events: Vec<(f64, Happening)>,
    /// The local route whenever it changed.
    pub ways: Vec<(f64, Vec<Position>)>,
    /// The global route whenever it changed.
    pub routes: Vec<(f64, Vec<Position>)>,
    /// The certainty window, once a second.
    pub maps: Vec<CertaintyMap>,
    /// The histogram, twice a second.
    pub histograms: Vec<HistogramRow>,
    /// What moves, twice a second.
    pub movers: MoverRows,
    /// Penetrometer readings.
    pub readings: Vec<(f64, PenetrometerReading)>,
    /// The overlapping grids.
    pub grids: GridRows,
}
