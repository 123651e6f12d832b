//! Rank of every cell: 0 unknown, 1 no-go, 2 (worst) to 10 (best), with the reason of every no-go.
//!
//! Profile `metric` judges the slope against the vehicle's limits; profile `paper` follows the tables of Vckay, Aneja and
//! Deodhare on grey levels, with the vehicle's limits and the paper's 25 % grade as gates; `literal` has no gates.

mod ahp;
mod criteria;
mod paper;
mod plain;
mod ranker;
mod tiled;

use thiserror::Error;

use crate::grid::{Cell, GridError, GridGeometry, Layer, LayerView};
use crate::soil::{SoilClass, SoilError, SoilTable};
use crate::vehicle::VehicleError;

pub use ahp::{Ahp, ahp};
pub use paper::{Bands, Directions, Rounding, height_goodness};
pub use ranker::Ranker;
pub use tiled::{SourceFault, TileReader, TiledHeights};

/// Lowest rank that counts as suitable when gates hold.
pub const RANK_MIN_GATED: u8 = 6;

/// Lowest rank that counts as suitable without gates: 6 would let gravel cliffs pass.
pub const RANK_MIN_LITERAL: u8 = 7;

/// How far around a cell its rank looks, in cells: with this much ground about it, a window of a map is ranked like the map.
pub const RANK_REACH_CELLS: usize = 1;

/// Why a cell is no-go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Reason {
    /// It is not no-go.
    None = 0,
    /// The elevation is unknown (rank 0).
    UnknownElevation = 1,
    /// Steeper than the vehicle drives, up or down.
    Grade = 2,
    /// No heading keeps both the grade and the side slope within limits.
    SideSlope = 3,
    /// The soil is weaker than the vehicle needs, on the level or on this slope.
    SoilStrength = 4,
    /// Water or peat.
    NoGround = 5,
    /// A step higher than the vehicle climbs.
    Step = 6,
    /// The soil is unknown and unknown soil is to be avoided.
    UnknownSoil = 7,
    /// Inside a hard zone.
    Zone = 8,
}

impl Reason {
    /// Every reason in the order of its code.
    pub const ALL: [Self; 9] = [
        Self::None,
        Self::UnknownElevation,
        Self::Grade,
        Self::SideSlope,
        Self::SoilStrength,
        Self::NoGround,
        Self::Step,
        Self::UnknownSoil,
        Self::Zone,
    ];

    /// A stable word for files.
    pub fn name(self) -> &'static str {
        [
            "none",
            "unknown_elevation",
            "grade",
            "side_slope",
            "soil_strength",
            "no_ground",
            "step",
            "unknown_soil",
            "zone",
        ][self as usize]
    }
}

/// Rank and reason of one cell in one byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellRank(u8);

impl CellRank {
    /// Unknown elevation.
    pub const UNKNOWN: Self = Self((Reason::UnknownElevation as u8) << 4);

    /// A rank from 2 to 10.
    pub const fn ranked(rank: u8) -> Self {
        debug_assert!(rank >= 2 && rank <= 10);
        Self(rank)
    }

    /// No-go for a reason.
    pub const fn no_go(reason: Reason) -> Self {
        Self(1 | (reason as u8) << 4)
    }

    /// 0 unknown, 1 no-go, 2..10.
    pub const fn rank(self) -> u8 {
        self.0 & 15
    }

    /// Why it is no-go or unknown.
    pub const fn reason(self) -> Reason {
        Reason::ALL[(self.0 >> 4) as usize]
    }

    /// The rank in the low four bits, the code of the reason in the high four.
    pub const fn byte(self) -> u8 {
        self.0
    }
}

/// Ranks of a whole grid.
#[derive(Clone, Debug, PartialEq)]
pub struct RankMap {
    cells: Layer<CellRank>,
}

impl RankMap {
    /// A rank map from its cells.
    pub fn new(cells: Layer<CellRank>) -> Self {
        Self { cells }
    }

    /// A rank map from plain ranks; no-go cells carry no reason but "unknown elevation" for rank 0.
    ///
    /// # Errors
    /// [`RankError::Rank`] above 10, [`RankError::Grid`] for the wrong number of cells.
    pub fn from_ranks(geometry: GridGeometry, ranks: &[u8]) -> Result<Self, RankError> {
        check_ranks(ranks)?;
        let cells = ranks.iter().map(|&rank| plain_rank(rank)).collect();
        Ok(Self::new(Layer::new(geometry, cells, "the rank map")?))
    }

    /// The cells.
    pub fn cells(&self) -> &Layer<CellRank> {
        &self.cells
    }

    /// The cells, to be changed.
    pub fn cells_mut(&mut self) -> &mut Layer<CellRank> {
        &mut self.cells
    }
}

/// A plain rank of 0 to 10, with no reason but "unknown elevation" for 0.
fn plain_rank(rank: u8) -> CellRank {
    match rank {
        0 => CellRank::UNKNOWN,
        rank => CellRank(rank),
    }
}

fn check_ranks(ranks: &[u8]) -> Result<(), RankError> {
    let greatest = ranks.iter().copied().fold(0, u8::max);
    if greatest > 10 {
        return Err(RankError::Rank { rank: greatest });
    }
    Ok(())
}

/// Plain ranks of a whole grid, borrowed: 0 unknown, 1 no-go, 2 to 10.
#[derive(Clone, Copy, Debug)]
pub struct RankView<'a>(LayerView<'a, u8>);

impl<'a> RankView<'a> {
    /// A view of ranks, row by row from the north-west.
    ///
    /// # Errors
    /// [`RankError::Rank`] above 10, [`RankError::Grid`] for the wrong number of cells.
    pub fn new(geometry: GridGeometry, ranks: &'a [u8]) -> Result<Self, RankError> {
        check_ranks(ranks)?;
        Ok(Self(LayerView::new(geometry, ranks, "the rank map")?))
    }

    /// The geometry of the cells.
    pub fn geometry(&self) -> GridGeometry {
        self.0.geometry()
    }

    /// The ranks, all of them 0 to 10.
    pub fn ranks(&self) -> &'a [u8] {
        self.0.data()
    }
}

/// Where ranks come from, cell by cell: a map made before, or terrain that is ranked when it is first looked at.
pub trait CellSource: Sync {
    /// The geometry of the cells.
    fn geometry(&self) -> GridGeometry;

    /// Rank and reason of a cell. The same cell always gives the same answer.
    fn cell_rank(&self, cell: Cell) -> CellRank;

    /// Ranks of the cells that follow each other in a row, from `column` on: for each what [`Self::cell_rank`] gives.
    fn rank_window(&self, row: usize, column: usize, ranks: &mut [CellRank]) {
        for (place, rank) in ranks.iter_mut().enumerate() {
            *rank = self.cell_rank(Cell::new(row, column + place));
        }
    }

    /// Makes sure that the ranks of these cells, and of all within `reach` rows and columns of them, can be told. A source
    /// that reads its ground when it is needed does so here: between ticks, on the caller's thread, never while ranks are
    /// asked for. Others do nothing.
    ///
    /// # Errors
    /// [`SourceFault`] when ground cannot be read; what was read stays.
    fn prefetch(&self, cells: &mut dyn Iterator<Item = Cell>, reach: usize) -> Result<(), SourceFault> {
        let _ = (cells, reach);
        Ok(())
    }
}

impl<Source: CellSource> CellSource for &Source {
    fn geometry(&self) -> GridGeometry {
        (**self).geometry()
    }

    fn cell_rank(&self, cell: Cell) -> CellRank {
        (**self).cell_rank(cell)
    }

    fn rank_window(&self, row: usize, column: usize, ranks: &mut [CellRank]) {
        (**self).rank_window(row, column, ranks);
    }

    fn prefetch(&self, cells: &mut dyn Iterator<Item = Cell>, reach: usize) -> Result<(), SourceFault> {
        (**self).prefetch(cells, reach)
    }
}

impl CellSource for RankView<'_> {
    fn geometry(&self) -> GridGeometry {
        self.0.geometry()
    }

    fn cell_rank(&self, cell: Cell) -> CellRank {
        plain_rank(self.0[cell])
    }

    fn rank_window(&self, row: usize, column: usize, ranks: &mut [CellRank]) {
        let first = self.geometry().index(Cell::new(row, column));
        for (to, &from) in ranks.iter_mut().zip(&self.0.data()[first..]) {
            *to = plain_rank(from);
        }
    }
}

impl CellSource for RankMap {
    fn geometry(&self) -> GridGeometry {
        self.cells.geometry()
    }

    fn cell_rank(&self, cell: Cell) -> CellRank {
        self.cells[cell]
    }

    fn rank_window(&self, row: usize, column: usize, ranks: &mut [CellRank]) {
        let first = self.geometry().index(Cell::new(row, column));
        ranks.copy_from_slice(&self.cells.data()[first..first + ranks.len()]);
    }
}

/// Which rules rank the cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Profile {
    /// Slope against the vehicle's limits, hard gates.
    Metric,
    /// The paper's tables, with gates.
    Paper,
    /// The paper's tables, without gates.
    Literal,
}

/// What unknown soil counts as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnknownSoil {
    /// Goodness 3, not gated.
    Neutral,
    /// A class of the caller's choice.
    Class(SoilClass),
    /// No-go.
    Avoid,
}

/// How height goodness and soil goodness become one rank.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Combine {
    /// `2 (w_height height + w_soil soil)`, rounded half away from zero; weights of one half are the paper's eq. 1.
    Weighted {
        /// Weight of the height goodness.
        height: f64,
        /// Weight of the soil goodness.
        soil: f64,
    },
    /// Twice the worse of the two.
    Min,
}

impl Combine {
    /// Eq. 1: the plain sum.
    pub const SUM: Self = Self::Weighted { height: 0.5, soil: 0.5 };
}

/// Parameters of a ranking.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RankParams {
    /// Which rules; default metric.
    pub profile: Profile,
    /// Gravimetric moisture of the soil in per cent; default 20 (a normal day, estimate).
    pub moisture_percent: f64,
    /// Goodness of silt; default the text's 2.
    pub soil_table: SoilTable,
    /// What unknown soil counts as; default neutral.
    pub unknown_soil: UnknownSoil,
    /// How goodnesses combine; default eq. 1.
    pub combine: Combine,
    /// The paper's bound on safe travel, rise over run; default 0.25. Used by profile `paper`.
    pub paper_grade: f64,
    /// Which directions count in Table I; default the worst of 8.
    pub directions: Directions,
    /// The bins of Table I; default symmetric.
    pub bands: Bands,
    /// How real differences meet integer bins; default rounding half away from zero.
    pub rounding: Rounding,
}

impl Default for RankParams {
    fn default() -> Self {
        Self {
            profile: Profile::Metric,
            moisture_percent: 20.0,
            soil_table: SoilTable::Text,
            unknown_soil: UnknownSoil::Neutral,
            combine: Combine::SUM,
            paper_grade: 0.25,
            directions: Directions::Worst,
            bands: Bands::Symmetric,
            rounding: Rounding::HalfAway,
        }
    }
}

impl RankParams {
    /// Lowest suitable rank of the profile.
    pub fn rank_min(&self) -> u8 {
        match self.profile {
            Profile::Metric | Profile::Paper => RANK_MIN_GATED,
            Profile::Literal => RANK_MIN_LITERAL,
        }
    }
}

/// What can be wrong with a ranking.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RankError {
    /// The layers do not fit each other.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The soil layer or the moisture is not usable.
    #[error(transparent)]
    Soil(#[from] SoilError),
    /// The vehicle is not usable.
    #[error(transparent)]
    Vehicle(#[from] VehicleError),
    /// A rank above 10.
    #[error("Rank {rank} is not one of 0 (unknown), 1 (no-go), 2 to 10.")]
    Rank {
        /// The value given.
        rank: u8,
    },
    /// A weight or limit is not usable.
    #[error("The {name} of {given} is not usable: {allowed}.")]
    Parameter {
        /// Which one.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// The profile needs grey levels and none were given.
    #[error("The paper's profiles rank grey levels, and none were given.")]
    NoHeightMap,
    /// A comparison matrix that is not one.
    #[error("The comparison matrix is not usable: {why}.")]
    Matrix {
        /// What is wrong.
        why: String,
    },
    /// Judgements that contradict each other.
    #[error("The comparisons contradict each other: consistency ratio {ratio:.3}, at most 0.10 is allowed.")]
    Inconsistent {
        /// The consistency ratio.
        ratio: f64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rank_and_reason_share_a_byte() {
        assert_eq!(size_of::<CellRank>(), 1);
        for reason in Reason::ALL {
            let cell = CellRank::no_go(reason);
            assert_eq!((cell.rank(), cell.reason()), (1, reason));
        }
        for rank in 2..=10 {
            let cell = CellRank::ranked(rank);
            assert_eq!((cell.rank(), cell.reason()), (rank, Reason::None));
        }
        let unknown = CellRank::UNKNOWN;
        assert_eq!((unknown.rank(), unknown.reason()), (0, Reason::UnknownElevation));
    }

    #[test]
    fn ranks_above_ten_are_refused() {
        let geometry = GridGeometry::new(1, 2, 1.0, 0.0, 0.0).unwrap();
        assert_eq!(
            RankMap::from_ranks(geometry, &[2, 11]),
            Err(RankError::Rank { rank: 11 })
        );
    }
}
