//! The shape of the ground: grey height map, directional height differences, gradient, slope, aspect, roughness.

mod gradient;
mod height_map;
mod roughness;

use thiserror::Error;

use crate::grid::GridError;

pub use gradient::{Gradient, HEADINGS, allowed_headings, aspect_rad, gradient_at, neighbourhood, slope};
pub use height_map::{Grouping, block_max, directional_difference, group_mean, height_map, worst_difference};
pub use roughness::{Roughness, roughness_at};

/// What can be wrong with a terrain request.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum TerrainError {
    /// The layers do not fit each other or the grid.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// No cell of the elevation is known.
    #[error("No cell of the elevation is known.")]
    AllVoid,
    /// The range of heights is not usable.
    #[error("The height range {low} .. {high} m is not usable: both must be finite and the first lower.")]
    HeightRange {
        /// Lower height given.
        low: f64,
        /// Higher height given.
        high: f64,
    },
}
