//! The navigator in a closed loop with a small kinematic world, and alone with input that nobody should give.

mod bad_input;
mod closed_loop;
mod faults;
mod learning;
mod movers;
mod odometry;
mod region;
mod threads;
mod ways;
pub(super) mod world;
