//! An episode: the navigator drives the simulated robot, and what happens is recorded second by second.
//!
//! What the robot believes and the truth meet only here. [`Episode`] holds neither: world, robot and navigator are lent to it for
//! every [`Episode::advance`] as [`Actors`], so that whoever owns them may look at them, or teach the navigator, in between. One
//! control step is: the robot senses, the navigator commands, the body moves. A scan that arrives late is handed on with the
//! sensor's mount moved back to where the robot thinks it was when the scan was taken, as any driver with time stamps does.
//!
//! The same world, seeds, parameters and calls give the same [`Second`]s to the bit.

mod blame;
mod fault;
mod judge;
mod record;
mod run;
mod second;
#[cfg(test)]
mod tests;

use thiserror::Error;

pub use fault::{Fault, FaultKind};
pub use judge::{Outcome, Verdict};
pub use run::{Actors, Episode};
pub use second::{
    CertaintyMap, CommandRows, GridRows, Happening, HistogramRow, MotionRows, MoverRows, ScanRows, Second, SonarRows,
    status_code,
};

/// How an episode runs.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeParams {
    /// Seconds from one control step to the next.
    pub control_period_s: f64,
    /// Simulated seconds after which the episode ends as a timeout.
    pub time_limit_s: f64,
    /// Seconds without a way or with a fault, standing, after which the episode ends as not reached.
    pub patience_s: f64,
    /// Whether the first collision ends the episode.
    pub stops_at_collision: bool,
    /// Whether rows, maps and histograms are recorded; events and the outcome always are.
    pub records: bool,
    /// What goes wrong with the sensors, and when.
    pub faults: Vec<Fault>,
}

impl Default for EpisodeParams {
    /// A step for every scan of the SICK LMS 200, ten minutes at most.
    fn default() -> Self {
        Self {
            control_period_s: 1.0 / 35.0,
            time_limit_s: 600.0,
            patience_s: 15.0,
            stops_at_collision: true,
            records: true,
            faults: Vec::new(),
        }
    }
}

/// What an episode cannot be made of.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum EpisodeError {
    /// A figure is outside its range.
    #[error("The episode's {name} of {given} is not usable: {allowed}.")]
    Figure {
        /// The figure.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

impl EpisodeParams {
    /// Checks every figure.
    ///
    /// # Errors
    /// [`EpisodeError::Figure`] naming the first figure outside its range.
    pub fn validate(&self) -> Result<(), EpisodeError> {
        let figures = [
            (
                "control period in seconds",
                self.control_period_s,
                0.005,
                1.0,
                "0.005 to 1 s is allowed",
            ),
            (
                "time limit in seconds",
                self.time_limit_s,
                0.0,
                1e6,
                "0 to 1e6 s is allowed",
            ),
            (
                "patience in seconds",
                self.patience_s,
                0.0,
                1e6,
                "0 to 1e6 s is allowed",
            ),
        ];
        for (name, given, least, most, allowed) in figures {
            if !(given >= least && given <= most) {
                return Err(EpisodeError::Figure { name, given, allowed });
            }
        }
        self.faults.iter().try_for_each(Fault::validate)
    }
}
