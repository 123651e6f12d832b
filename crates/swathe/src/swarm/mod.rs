//! The termite swarm: agents drop pellets on suitable cells, full cells become cores of nests, touching nests merge.
//!
//! Limits, stated first: for a full static map the swarm does more work than the one linear pass of
//! [`exact_nests`](crate::nest::exact_nests), with which it agrees cell for cell once it is finished. At every earlier
//! time its nests are a subset: precision is 1, only recall grows. Source: Vckay, Aneja and Deodhare for the rules; numbers
//! other than their 10 agents are ours.

mod agents;
mod colony;
mod itinerary;
mod stop;
mod tiles;
mod transitions;

use thiserror::Error;

use crate::grid::GridError;
use crate::nest::{NestError, NestParams};
use crate::rank::SourceFault;

pub use colony::{Changes, Colony, Ending, Frame, FrameTicks, Seen, Tally};
pub use stop::{Budget, STATISTICAL, StopRule};
pub use tiles::{TileJob, TileResult, Window, merge_tiles, tile_jobs};
pub use transitions::{Chart, State, TRANSITIONS, Transition};

/// Most agents of a swarm.
pub const MOST_AGENTS: u32 = 1_000_000;

/// How agents look for ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Explore {
    /// Step to a neighbour, now and then be deployed anew.
    Walk,
    /// Be deployed anew every tick.
    Uniform,
    /// Visit the cells in the order of a random permutation, each once an epoch: tile after tile, and the cells of a tile.
    Permute,
}

/// Parameters of a swarm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SwarmParams {
    /// Number of agents; default 1024 (the paper: 10).
    pub agents: u32,
    /// Pellets that make a cell a focus; default 1 (profile `paper`: 3).
    pub pellet_max: u8,
    /// What nests are.
    pub nest: NestParams,
    /// Probability of being deployed anew per tick, above 0 for a walk that must finish; default 0.05.
    pub teleport: f64,
    /// Pull of pellets on the walk; default 0.
    pub attract: f64,
    /// Default walk.
    pub explore: Explore,
    /// Seed of every random draw; default 0.
    pub seed: u64,
}

impl Default for SwarmParams {
    fn default() -> Self {
        Self {
            agents: 1024,
            pellet_max: 1,
            nest: NestParams::default(),
            teleport: 0.05,
            attract: 0.0,
            explore: Explore::Walk,
            seed: 0,
        }
    }
}

/// What can be wrong with a swarm request.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SwarmError {
    /// The nest parameters are not usable.
    #[error(transparent)]
    Nest(#[from] NestError),
    /// The mask does not fit the map.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// Ground that is read when it is needed cannot be read.
    #[error(transparent)]
    Source(#[from] SourceFault),
    /// A parameter is outside its range.
    #[error("The swarm's {name} of {given} is not usable: {allowed}.")]
    Parameter {
        /// Which one.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

impl SwarmParams {
    /// Checks every parameter.
    ///
    /// # Errors
    /// [`SwarmError`] naming the first one outside its range.
    pub fn validate(&self) -> Result<(), SwarmError> {
        self.nest.validate()?;
        let fail = |name, given, allowed| Err(SwarmError::Parameter { name, given, allowed });
        if !(1..=MOST_AGENTS).contains(&self.agents) {
            return fail("number of agents", f64::from(self.agents), "1 to 1000000 is allowed");
        }
        if self.pellet_max == 0 {
            return fail("pellet limit", 0.0, "1 to 255 is allowed");
        }
        if !(0.0..=1.0).contains(&self.teleport) {
            return fail("probability of new deployment", self.teleport, "0 to 1 is allowed");
        }
        if !(self.attract.is_finite() && self.attract >= 0.0) {
            return fail("attraction", self.attract, "it must be finite and not below 0");
        }
        Ok(())
    }
}
