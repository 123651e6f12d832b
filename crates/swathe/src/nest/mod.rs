//! Nests: connected regions of suitable cells in which the vicinity of every core is suitable too.
//!
//! In the limit of the termite swarm a nest is a component of the morphological opening of the suitable cells by the
//! vicinity; [`exact_nests`] computes that directly and is the oracle beside the swarm.

mod bit_rows;
mod exact;
mod graph;
mod grids;
mod opening;
mod outline;
mod union_find;

use thiserror::Error;

use crate::grid::{Cell, GridError, GridGeometry, Layer, Step, disc};

pub use bit_rows::BitRows;
pub(crate) use bit_rows::pack_at_least;
pub use exact::{exact_nests, label_nests, nests_of_cells, suitable_cells};
pub use graph::{Gap, nest_graph};
pub use grids::{
    DISAGREEMENT_COST_FACTOR, DISAGREEMENT_SPEED_FACTOR, Footprint, GRIDS_MAX, GapShape, GridMode, GridsParams,
    Navigability, OverlappingGrids, Phase, RankCodes, SizeReading, gap_share, gaps_found, product_phases,
};
pub use outline::{Outline, Ring, outlines};
pub use union_find::UnionFind;

/// What can be wrong with a nest request.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum NestError {
    /// The layers do not fit each other.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The lowest suitable rank is not one.
    #[error("A lowest suitable rank of {rank} is not usable: 2 to 10 is allowed.")]
    RankMin {
        /// The value given.
        rank: u8,
    },
    /// The vicinity's radius is not usable.
    #[error("A vicinity of radius {radius_cells} cells is not usable: 0 to 50 is allowed.")]
    Vicinity {
        /// The value given.
        radius_cells: f64,
    },
    /// A figure of the overlapping grids is outside its range.
    #[error("The {name} of {given} is not usable: {allowed}.")]
    Figure {
        /// The figure.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// Overlapping grids were given terrain of another geometry than they were made on.
    #[error("The terrain is not on the geometry that the overlapping grids were made on.")]
    EvidenceMoved,
}

/// The cells around a cell that must be suitable for it to become a nest's core.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Vicinity {
    /// The cell alone.
    Cell,
    /// The cell and the four that share an edge.
    VonNeumann1,
    /// The 3 x 3 cells.
    Moore1,
    /// All cells whose centre is at most this many cells away.
    Disc(f64),
}

impl Vicinity {
    /// The steps from a cell to its vicinity, its own included.
    ///
    /// # Errors
    /// [`NestError::Vicinity`] for a radius outside 0..50.
    pub fn steps(self) -> Result<Vec<Step>, NestError> {
        match self {
            Self::Cell => Ok(disc(0.0)),
            Self::VonNeumann1 => Ok(disc(1.0)),
            Self::Moore1 => Ok(disc(1.5)),
            Self::Disc(radius) if (0.0..=50.0).contains(&radius) => Ok(disc(radius)),
            Self::Disc(radius_cells) => Err(NestError::Vicinity { radius_cells }),
        }
    }
}

/// When two nests are one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Contact {
    /// They share a cell.
    Overlap,
    /// They share a cell or an edge; a robot smaller than a cell can cross.
    Edge,
    /// They share a cell, an edge or a corner.
    Corner,
}

/// How suitable cells become nests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NestParams {
    /// Lowest suitable rank, 2 to 10; default 6.
    pub rank_min: u8,
    /// Default 3 x 3.
    pub vicinity: Vicinity,
    /// Default edge.
    pub contact: Contact,
    /// Whether cells beyond the map or swathe count as suitable; default no.
    pub border_suitable: bool,
}

impl Default for NestParams {
    fn default() -> Self {
        Self {
            rank_min: crate::rank::RANK_MIN_GATED,
            vicinity: Vicinity::Moore1,
            contact: Contact::Edge,
            border_suitable: false,
        }
    }
}

impl NestParams {
    /// Checks the parameters and returns the vicinity's steps.
    ///
    /// # Errors
    /// [`NestError`] naming the parameter.
    pub fn validate(&self) -> Result<Vec<Step>, NestError> {
        if !(2..=10).contains(&self.rank_min) {
            return Err(NestError::RankMin { rank: self.rank_min });
        }
        self.vicinity.steps()
    }
}

/// Labelled nests: 0 is no nest, nests count from 1 in raster order of their first cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Nests {
    labels: Layer<u32>,
    sizes: Vec<u32>,
}

impl Nests {
    /// Nests from labels that are already compact and in raster order.
    pub(crate) fn new(labels: Layer<u32>, sizes: Vec<u32>) -> Self {
        Self { labels, sizes }
    }

    /// Nests from labels of any numbering; they are renumbered.
    ///
    /// # Errors
    /// [`NestError::Grid`] when there is not one label per cell.
    pub fn from_labels(geometry: GridGeometry, labels: Vec<u32>) -> Result<Self, NestError> {
        let mut numbers = std::collections::HashMap::new();
        let mut sizes = Vec::new();
        let mut labels = labels;
        let mut last = (0, 0);
        for label in labels.iter_mut().filter(|label| **label > 0) {
            // Neighbours mostly share their label.
            if last.0 != *label {
                let number = *numbers.entry(*label).or_insert_with(|| {
                    sizes.push(0);
                    sizes.len() as u32
                });
                last = (*label, number);
            }
            let number = last.1;
            sizes[number as usize - 1] += 1;
            *label = number;
        }
        Ok(Self::new(Layer::new(geometry, labels, "the nests")?, sizes))
    }

    /// The geometry.
    pub fn geometry(&self) -> GridGeometry {
        self.labels.geometry()
    }

    /// Label of a cell.
    pub fn label(&self, cell: Cell) -> u32 {
        self.labels[cell]
    }

    /// The labels.
    pub fn labels(&self) -> &Layer<u32> {
        &self.labels
    }

    /// The labels, given away.
    pub fn into_labels(self) -> Layer<u32> {
        self.labels
    }

    /// Number of nests.
    pub fn count(&self) -> usize {
        self.sizes.len()
    }

    /// Cells of each nest; nest n is at n - 1.
    pub fn sizes(&self) -> &[u32] {
        &self.sizes
    }

    /// The label of the nest with most cells (the first of equals), 0 without a nest.
    pub fn largest(&self) -> u32 {
        let largest = self.sizes.iter().max().copied().unwrap_or(0);
        let position = self.sizes.iter().position(|&size| size == largest);
        position.map_or(0, |index| index as u32 + 1)
    }
}
