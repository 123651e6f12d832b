//! The navigator: from what the robot sees to what it should do, one [`Navigator::step`] at a time.
//!
//! A step goes down one list: time and pose, scan, certainty grid, memory, region, route, traps, local method, safety. It
//! works with nothing but one range sensor; a [`Region`] adds what a map knows. The vehicle never goes faster than it can
//! stop within the ground that it sees to be free.

mod attitude;
mod event;
mod follow;
mod knowledge;
mod learning;
mod memory;
mod motion;
mod movers;
mod navigator;
mod odometry;
mod params;
mod probing;
mod recovery;
mod region;
mod route;
mod safety;
mod sense;
mod steer;
#[cfg(test)]
mod tests;
mod thread;
mod tracks;
mod unconfirmed;
mod wall;
mod watch;

pub use event::{Command, Event, Reason, Recovery, Status};
pub use knowledge::{Knowledge, KnownMap, Learnt, Outlook, ProbeSite, RouteChange, Standing};
pub use learning::UNSEEN;
pub use navigator::{Navigator, Observation};
pub use params::{DriveError, DriveParams, Method, OutsideNests};
pub use region::Region;
pub use steer::Histogram;
