//! Overlapping grids: navigation cells of four robot sizes in several grids a part of a cell apart, in a window that
//! follows the robot.
//!
//! A cell counts as suitable when every terrain cell that it touches is suitable, so that the suitable cells of each
//! grid lie inside free ground, and so does their union. A nest of a grid is a component of its suitable cells
//! (vicinity `cell`, contact along edges): a cell lies in a nest exactly when it is suitable. All grids are made from
//! the same terrain cells and none from another. They hold what the map says (height, soil); what sensors see is kept
//! elsewhere.

mod evidence;
mod footprint;
mod gain;
mod joined;
mod params;
#[cfg(test)]
mod tests;

use std::ops::Range;

use crate::grid::{GridGeometry, Position};
use crate::rank::CellSource;

use super::{BitRows, Contact, NestError, Nests, nests_of_cells};

use evidence::{Block, SNAP};

pub use evidence::RankCodes;
pub use footprint::Footprint;
pub use gain::{GapShape, gap_share, gaps_found};
pub use params::{GRIDS_MAX, GridMode, GridsParams, Phase, SizeReading, product_phases};

/// Speed on ground that one grid alone holds, as a share of the usual.
pub const DISAGREEMENT_SPEED_FACTOR: f64 = 0.5;

/// Cost of ground that one grid alone holds, as a multiple of the usual.
pub const DISAGREEMENT_COST_FACTOR: f64 = 1.2;

/// Whether ground is navigable: what each grid says and what follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Navigability {
    grids: u64,
    count: u8,
    combined: bool,
}

impl Navigability {
    /// The answer in the mode of the grids.
    pub fn navigable(self) -> bool {
        self.combined
    }

    /// Whether the grid with this number holds the footprint; false beyond the last.
    pub fn in_grid(self, grid: usize) -> bool {
        grid < usize::from(self.count) && self.grids >> grid & 1 == 1
    }

    /// Number of grids that were asked.
    pub fn grids(self) -> usize {
        usize::from(self.count)
    }

    /// Whether one grid alone of several holds the footprint.
    pub fn disagreement(self) -> bool {
        self.count > 1 && self.grids.is_power_of_two()
    }

    /// [`DISAGREEMENT_SPEED_FACTOR`] under disagreement, otherwise 1.
    pub fn speed_factor(self) -> f64 {
        if self.disagreement() {
            DISAGREEMENT_SPEED_FACTOR
        } else {
            1.0
        }
    }

    /// [`DISAGREEMENT_COST_FACTOR`] under disagreement, otherwise 1.
    pub fn cost_factor(self) -> f64 {
        if self.disagreement() {
            DISAGREEMENT_COST_FACTOR
        } else {
            1.0
        }
    }
}

/// The grids: the same window of rows and columns in each, moved by its phase.
#[derive(Clone, Debug, PartialEq)]
pub struct OverlappingGrids {
    params: GridsParams,
    phases: Vec<Phase>,
    terrain: GridGeometry,
    /// Side of a navigation cell in terrain cells.
    side: f64,
    /// Row and column of the window's first cell, counted from the north-west corner of the terrain.
    first: (i64, i64),
    /// Least rank of the terrain under each cell, 0 where it reaches beyond the terrain, grid by grid.
    ranks: Vec<u8>,
}

impl OverlappingGrids {
    /// Grids in a window around a position, evaluated from the terrain's ranks. The first phase begins at the
    /// north-west corner of the terrain.
    ///
    /// # Errors
    /// [`NestError::Figure`] or [`NestError::RankMin`] when a parameter is outside its range or the position is not
    /// finite.
    pub fn new(
        params: GridsParams,
        position: Position,
        evidence: &(impl CellSource + ?Sized),
    ) -> Result<Self, NestError> {
        let terrain = evidence.geometry();
        params.validate(terrain)?;
        let phases = params.asked_phases();
        let across = params.window_cells;
        let mut grids = Self {
            side: params.cell_size_m() / terrain.cell_size_m(),
            terrain,
            first: (0, 0),
            ranks: vec![0; phases.len() * across * across],
            phases,
            params,
        };
        grids.first = grids.first_around(position)?;
        let (rows, columns) = (0..across, 0..across);
        grids.assess(&Block { rows, columns }, evidence);
        Ok(grids)
    }

    /// Moves the window to a new position, keeps the cells that stay inside and evaluates the rows and columns that
    /// came in. The result equals new grids at that position. Returns how many terrain cells were evaluated.
    ///
    /// # Errors
    /// [`NestError::EvidenceMoved`] when the terrain has another geometry than at first, [`NestError::Figure`] when the
    /// position is not finite. The grids stay as they were.
    pub fn recentre(&mut self, position: Position, evidence: &(impl CellSource + ?Sized)) -> Result<u64, NestError> {
        self.check_evidence(evidence)?;
        let first = self.first_around(position)?;
        let (down, right) = (first.0 - self.first.0, first.1 - self.first.1);
        self.first = first;
        let across = self.params.window_cells;
        if down.unsigned_abs() >= across as u64 || right.unsigned_abs() >= across as u64 {
            let (rows, columns) = (0..across, 0..across);
            return Ok(self.assess(&Block { rows, columns }, evidence));
        }
        let (new_rows, kept_rows) = entered(across, down);
        let (new_columns, kept_columns) = entered(across, right);
        self.shift(down, right, &kept_rows, &kept_columns);
        let (rows, columns) = (new_rows, 0..across);
        let from_rows = self.assess(&Block { rows, columns }, evidence);
        let (rows, columns) = (kept_rows, new_columns);
        Ok(from_rows + self.assess(&Block { rows, columns }, evidence))
    }

    /// Evaluates the cells again that touch changed terrain cells (rows and columns of the terrain, ends excluded).
    /// Returns how many terrain cells were evaluated.
    ///
    /// # Errors
    /// [`NestError::EvidenceMoved`] when the terrain has another geometry than at first.
    pub fn refresh(
        &mut self,
        rows: Range<usize>,
        columns: Range<usize>,
        evidence: &(impl CellSource + ?Sized),
    ) -> Result<u64, NestError> {
        self.check_evidence(evidence)?;
        if rows.is_empty() || columns.is_empty() {
            return Ok(0);
        }
        // Phases move a grid by less than a cell to the south and east: one more cell on that side's other end.
        let touched = |range: Range<usize>, first: i64| {
            let inside = |cell: f64| (cell - first as f64).clamp(0.0, self.params.window_cells as f64) as usize;
            inside((range.start as f64 / self.side - SNAP).floor() - 1.0)
                ..inside((range.end as f64 / self.side + SNAP).ceil())
        };
        let (rows, columns) = (touched(rows, self.first.0), touched(columns, self.first.1));
        Ok(self.assess(&Block { rows, columns }, evidence))
    }

    /// Whether a robot that stands here is on navigable ground: for each grid, whether every cell that the footprint
    /// touches lies in a nest of it. Cells outside the window or partly outside the terrain lie in none; a pose that is
    /// not finite is not navigable. `heading_rad` turns rectangles, counter-clockwise from east.
    #[inline]
    pub fn navigable(&self, position: Position, heading_rad: f64, footprint: &Footprint) -> Navigability {
        let (row, column) = self.terrain.fractional(position);
        let y = row / self.side - self.first.0 as f64;
        let x = column / self.side - self.first.1 as f64;
        let outline = footprint.outline(heading_rad, self.params.cell_size_m());
        let across = self.params.window_cells;
        let mut grids = 0;
        for (grid, (phase, ranks)) in self
            .phases
            .iter()
            .zip(self.ranks.chunks_exact(across * across))
            .enumerate()
        {
            let suits = |row, column| ranks[row * across + column] >= self.params.rank_min;
            let holds = outline.all_touched(x - phase.east, y - phase.south, across, suits);
            grids |= u64::from(holds) << grid;
        }
        let combined = match self.params.mode {
            GridMode::And => grids.count_ones() as usize == self.phases.len(),
            GridMode::Or | GridMode::Single | GridMode::Exact16 => grids != 0,
        };
        let count = self.phases.len() as u8;
        Navigability { grids, count, combined }
    }

    /// The parameters.
    pub fn params(&self) -> &GridsParams {
        &self.params
    }

    /// The phases of the grids in their order.
    pub fn phases(&self) -> &[Phase] {
        &self.phases
    }

    /// Geometry of a grid's cells in the window, `None` beyond the last grid.
    pub fn geometry(&self, grid: usize) -> Option<GridGeometry> {
        let phase = self.phases.get(grid)?;
        let (across, cell_size_m) = (self.params.window_cells, self.params.cell_size_m());
        let west_m = self.terrain.west_m() + (self.first.1 as f64 + phase.east) * cell_size_m;
        let north_m = self.terrain.north_m() - (self.first.0 as f64 + phase.south) * cell_size_m;
        GridGeometry::new(across, across, cell_size_m, west_m, north_m).ok()
    }

    /// Ranks of a grid's cells, row by row: the least of the terrain cells that a cell touches, 0 where it reaches
    /// beyond the terrain. `None` beyond the last grid.
    pub fn ranks(&self, grid: usize) -> Option<&[u8]> {
        let cells = self.params.window_cells * self.params.window_cells;
        self.ranks.chunks_exact(cells).nth(grid)
    }

    /// Nests of a grid inside the window, `None` beyond the last grid.
    pub fn nests(&self, grid: usize) -> Option<Nests> {
        let geometry = self.geometry(grid)?;
        let cells = BitRows::at_least(geometry, self.ranks(grid)?, self.params.rank_min, |rank| *rank);
        nests_of_cells(geometry, &cells, Contact::Edge).ok()
    }

    fn check_evidence(&self, evidence: &(impl CellSource + ?Sized)) -> Result<(), NestError> {
        if evidence.geometry() == self.terrain {
            Ok(())
        } else {
            Err(NestError::EvidenceMoved)
        }
    }

    /// The window's first row and column around a position; a window far outside stops beside the terrain.
    fn first_around(&self, position: Position) -> Result<(i64, i64), NestError> {
        for (name, given) in [
            ("position's x in metres", position.x_m),
            ("position's y in metres", position.y_m),
        ] {
            if !given.is_finite() {
                let allowed = "it must be finite";
                return Err(NestError::Figure { name, given, allowed });
            }
        }
        let across = self.params.window_cells as f64;
        let (row, column) = self.terrain.fractional(position);
        let first = |along: f64, cells: usize| {
            let beyond = cells as f64 / self.side + across;
            ((along / self.side).clamp(-across, beyond) - (across / 2.0)).floor() as i64
        };
        Ok((first(row, self.terrain.rows()), first(column, self.terrain.columns())))
    }

    /// Moves what is kept of each grid to its new place.
    fn shift(&mut self, down: i64, right: i64, rows: &Range<usize>, columns: &Range<usize>) {
        let across = self.params.window_cells;
        for ranks in self.ranks.chunks_exact_mut(across * across) {
            let mut moved = |row: usize| {
                let from = (row as i64 + down) as usize * across + (columns.start as i64 + right) as usize;
                ranks.copy_within(from..from + columns.len(), row * across + columns.start);
            };
            // Rows are moved in the order in which none is overwritten before it has moved.
            if down >= 0 {
                rows.clone().for_each(&mut moved);
            } else {
                rows.clone().rev().for_each(&mut moved);
            }
        }
    }
}

/// Rows (or columns) of the window that a move by `by` brings in, and those that stay.
fn entered(across: usize, by: i64) -> (Range<usize>, Range<usize>) {
    let moved = by.unsigned_abs() as usize;
    if by >= 0 {
        (across - moved..across, 0..across - moved)
    } else {
        (0..moved, moved..across)
    }
}
