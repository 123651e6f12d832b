//! The simulated world: the truth, apart from everything that a robot believes.
//!
//! [`World`] holds real terrain and soil, obstacles, ditches and moving things; [`Body`] is moved over it by commands, within
//! the vehicle's limits and with slip; [`Laser`] and [`Penetrometer`] sense it. [`Robot`] puts them together with noise,
//! dropouts, delay and odometry drift. Everything that is drawn comes from one seed through counters, so that the same seed
//! and commands give the same bytes. Nothing here sees maps, ranks or routes.
//!
//! Limits: obstacles are upright, a beam does not see their tops; soil acts through slip, speed and sinkage by class, not
//! through deformation of the ground.

mod body;
mod draw;
mod ground;
mod laser;
mod localiser;
mod noise;
mod obstacle;
mod penetrometer;
mod relief;
mod robot;
mod way;
mod world;

use thiserror::Error;

use crate::grid::GridError;
use crate::soil::SoilError;
use crate::vehicle::VehicleError;

pub use crate::vehicle::{Motion, Steering};
pub use body::{Body, BodyState, Command, Stop};
pub use draw::{Scenario, ScenarioKind, random_world};
pub use ground::{Ground, NoGo, TruthErrors};
pub use laser::{Laser, PIONEER_SONAR_RAD, SONAR_CONE_RAD, pioneer_sonar, sonar_ring};
pub use localiser::{Localiser, LocaliserParams};
pub use noise::Noise;
pub use obstacle::{Footprint, Obstacle, Shape};
pub use penetrometer::Penetrometer;
pub use relief::Relief;
pub use robot::{Observation, Robot, RobotParams};
pub use way::{Way, passable, way};
pub use world::{Mover, World};

/// What can be wrong with a request to the simulated world.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SimError {
    /// The layers do not fit each other or the grid.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// A soil code or moisture is not usable.
    #[error(transparent)]
    Soil(#[from] SoilError),
    /// The vehicle is not usable.
    #[error(transparent)]
    Vehicle(#[from] VehicleError),
    /// A figure is outside its range.
    #[error("The simulated {name} of {given} is not usable: {allowed}.")]
    Figure {
        /// The figure.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

/// Checks a figure.
fn require(name: &'static str, given: f64, fits: bool, allowed: &'static str) -> Result<(), SimError> {
    if given.is_finite() && fits {
        Ok(())
    } else {
        Err(SimError::Figure { name, given, allowed })
    }
}
