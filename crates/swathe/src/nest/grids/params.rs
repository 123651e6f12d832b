//! What the overlapping grids are made of: the robot's size, the side of a cell, the phases, how answers combine.

use crate::grid::GridGeometry;
use crate::rank::RANK_MIN_GATED;
use crate::vehicle::Vehicle;

use super::super::NestError;

/// Most grids that can be asked together.
pub const GRIDS_MAX: usize = 64;

/// Robot sizes in the side of a navigation cell, or its area in squares of the robot's size.
const SIZES: f64 = 4.0;

/// The range of a navigation cell's side in terrain cells.
const SIDE_IN_TERRAIN_CELLS: std::ops::RangeInclusive<f64> = 1e-3..=1e4;

/// The range of the window's side in navigation cells.
const WINDOW_CELLS: std::ops::RangeInclusive<usize> = 2..=512;

/// Navigation cells across a map up to which positions resolve far below the slack of a query.
const ACROSS_MAX: f64 = (1u64 << 28) as f64;

/// How "a cell of four robot sizes" is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SizeReading {
    /// The side is four sizes.
    Side,
    /// The area is four squares of the size: the side is two sizes.
    Area,
}

/// How the answers of the grids become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GridMode {
    /// Some grid holds the footprint. Each grid is an inner approximation of free ground, so this is sound.
    Or,
    /// Every grid holds it.
    And,
    /// The first grid alone.
    Single,
    /// Some of the sixteen grids at all quarter phases holds it, whatever the list of phases says.
    Exact16,
}

/// Where a grid begins: shares of a cell, at least 0 and below 1, by which it lies east and south of the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phase {
    /// Share of a cell to the east.
    pub east: f64,
    /// Share of a cell to the south.
    pub south: f64,
}

impl Phase {
    /// The phase with these shares.
    pub const fn new(east: f64, south: f64) -> Self {
        Self { east, south }
    }
}

/// Every pair of the shares: `[0, 1/2]` gives four grids that find every square of one and a half cells, and `n` evenly
/// spaced shares every square of `1 + 1/n` cells.
pub fn product_phases(shares: &[f64]) -> Vec<Phase> {
    let pairs = shares
        .iter()
        .flat_map(|&south| shares.iter().map(move |&east| Phase::new(east, south)));
    pairs.collect()
}

/// What overlapping grids are made of.
#[derive(Clone, Debug, PartialEq)]
pub struct GridsParams {
    /// Size of the robot in metres, above zero: usually the diameter of the circle around its footprint.
    pub size_m: f64,
    /// Default: the side of a cell is four sizes.
    pub reading: SizeReading,
    /// Default: some grid.
    pub mode: GridMode,
    /// 1 to 64 phases. Default: (0, 0) and a quarter of a cell along both axes.
    pub phases: Vec<Phase>,
    /// Cells across the window that follows the robot, 2 to 512; default 32.
    pub window_cells: usize,
    /// Lowest suitable rank of a terrain cell, 2 to 10; default 6.
    pub rank_min: u8,
}

impl GridsParams {
    /// The usual grids for a robot of this size in metres.
    pub fn new(size_m: f64) -> Self {
        Self {
            size_m,
            reading: SizeReading::Side,
            mode: GridMode::Or,
            phases: vec![Phase::new(0.0, 0.0), Phase::new(0.25, 0.25)],
            window_cells: 32,
            rank_min: RANK_MIN_GATED,
        }
    }

    /// The usual grids for a vehicle: its size is the diameter of the circle around its footprint.
    pub fn for_vehicle(vehicle: &Vehicle) -> Self {
        Self::new(2.0 * vehicle.circumscribed_radius_m())
    }

    /// The robot's size in cells: a quarter, or a half when the area is read.
    pub fn size_in_cells(&self) -> f64 {
        match self.reading {
            SizeReading::Side => 1.0 / SIZES,
            SizeReading::Area => 1.0 / SIZES.sqrt(),
        }
    }

    /// Side of a navigation cell in metres.
    pub fn cell_size_m(&self) -> f64 {
        self.size_m / self.size_in_cells()
    }

    /// The phases of the grids that the mode asks.
    pub fn asked_phases(&self) -> Vec<Phase> {
        match self.mode {
            GridMode::Or | GridMode::And => self.phases.clone(),
            GridMode::Single => self.phases.iter().take(1).copied().collect(),
            GridMode::Exact16 => product_phases(&[0.0, 0.25, 0.5, 0.75]),
        }
    }

    /// Checks the parameters, for terrain of this geometry.
    ///
    /// # Errors
    /// [`NestError::RankMin`], or [`NestError::Figure`] naming the parameter.
    pub fn validate(&self, terrain: GridGeometry) -> Result<(), NestError> {
        let refuse = |name, given, allowed| Err(NestError::Figure { name, given, allowed });
        if !(2..=10).contains(&self.rank_min) {
            return Err(NestError::RankMin { rank: self.rank_min });
        }
        if !(self.size_m.is_finite() && self.size_m > 0.0) {
            return refuse("robot size in metres", self.size_m, "it must be finite and above 0");
        }
        let side = self.cell_size_m() / terrain.cell_size_m();
        let across = terrain.rows().max(terrain.columns()) as f64 / side;
        if !SIDE_IN_TERRAIN_CELLS.contains(&side) || across > ACROSS_MAX {
            let allowed =
                "its navigation cell must measure 0.001 to 10000 terrain cells, and the map 2^28 of its cells";
            return refuse("robot size in metres", self.size_m, allowed);
        }
        if !WINDOW_CELLS.contains(&self.window_cells) {
            let given = self.window_cells as f64;
            return refuse("window in navigation cells", given, "2 to 512 is allowed");
        }
        check_phases(&self.phases)
    }
}

/// # Errors
/// [`NestError::Figure`] for none, too many, or a share outside 0 to 1.
pub(super) fn check_phases(phases: &[Phase]) -> Result<(), NestError> {
    let refuse = |name, given, allowed| Err(NestError::Figure { name, given, allowed });
    if !(1..=GRIDS_MAX).contains(&phases.len()) {
        return refuse("number of phases", phases.len() as f64, "1 to 64 are allowed");
    }
    let shares = phases.iter().flat_map(|phase| [phase.east, phase.south]);
    for share in shares {
        if !(0.0..1.0).contains(&share) {
            return refuse("phase", share, "it must be at least 0 and below 1");
        }
    }
    Ok(())
}
