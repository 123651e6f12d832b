//! From terrain cells to navigation cells: which terrain a cell touches, and the least rank of it.

use std::ops::Range;

use crate::grid::{Cell, GridGeometry, LayerView};
use crate::rank::{CellRank, CellSource, Reason};

use super::{OverlappingGrids, Phase};

/// An edge of a navigation cell this near to an edge of terrain cells, in navigation cells, counts as lying on it.
pub(super) const SNAP: f64 = 2.5e-7;

/// Ranks of terrain as bytes, the rank in the low four bits: a source of evidence over borrowed memory. A byte that
/// holds no rank counts as unknown.
#[derive(Clone, Copy, Debug)]
pub struct RankCodes<'a>(pub LayerView<'a, u8>);

impl CellSource for RankCodes<'_> {
    fn geometry(&self) -> GridGeometry {
        self.0.geometry()
    }

    fn cell_rank(&self, cell: Cell) -> CellRank {
        match self.0[cell] & 15 {
            1 => CellRank::no_go(Reason::None),
            rank @ 2..=10 => CellRank::ranked(rank),
            _ => CellRank::UNKNOWN,
        }
    }
}

/// Rows and columns of navigation cells in the window.
pub(super) struct Block {
    pub(super) rows: Range<usize>,
    pub(super) columns: Range<usize>,
}

/// The terrain rows and columns that the rows and columns of a block of one grid touch.
struct Touched {
    rows: Vec<Range<i64>>,
    columns: Vec<Range<i64>>,
}

impl OverlappingGrids {
    /// The terrain rows or columns that cells touch: each from where it begins to before where it ends, which may be
    /// outside the terrain.
    fn touched(&self, cells: &Range<usize>, first: i64, phase: f64) -> Vec<Range<i64>> {
        let edge = |cell: usize| {
            let place = ((first + cell as i64) as f64 + phase) * self.side;
            let nearest = place.round();
            if (place - nearest).abs() <= SNAP * self.side {
                nearest
            } else {
                place
            }
        };
        let touched = |cell: usize| edge(cell).floor() as i64..edge(cell + 1).ceil() as i64;
        cells.clone().map(touched).collect()
    }

    /// Evaluates a block of cells of every grid, asking for each terrain cell under it once. Returns how many it asked.
    pub(super) fn assess(&mut self, block: &Block, evidence: &(impl CellSource + ?Sized)) -> u64 {
        if block.rows.is_empty() || block.columns.is_empty() {
            return 0;
        }
        let across = self.params.window_cells;
        let limits = (self.terrain.rows() as i64, self.terrain.columns() as i64);
        let touched = |phase: &Phase| Touched {
            rows: self.touched(&block.rows, self.first.0, phase.south),
            columns: self.touched(&block.columns, self.first.1, phase.east),
        };
        let touched: Vec<Touched> = self.phases.iter().map(touched).collect();
        let rows = hull(touched.iter().map(|grid| grid.rows.as_slice()), limits.0);
        let columns = hull(touched.iter().map(|grid| grid.columns.as_slice()), limits.1);
        for (Touched { rows, columns }, ranks) in touched.iter().zip(self.ranks.chunks_exact_mut(across * across)) {
            for (row, touched_rows) in block.rows.clone().zip(rows) {
                for (column, touched_columns) in block.columns.clone().zip(columns) {
                    let inside = within(touched_rows, limits.0) && within(touched_columns, limits.1);
                    ranks[row * across + column] = if inside { u8::MAX } else { 0 };
                }
            }
        }
        let mut codes = vec![0; columns.clone().count()];
        let mut least = vec![0; block.columns.len()];
        // The first row of cells of each grid that a later terrain row can touch.
        let mut starts = vec![0; self.phases.len()];
        for terrain_row in rows.clone() {
            for (code, column) in codes.iter_mut().zip(columns.clone()) {
                *code = evidence
                    .cell_rank(Cell::new(terrain_row as usize, column as usize))
                    .rank();
            }
            let grids = touched.iter().zip(self.ranks.chunks_exact_mut(across * across));
            for ((grid, ranks), start) in grids.zip(&mut starts) {
                while grid.rows.get(*start).is_some_and(|touched| touched.end <= terrain_row) {
                    *start += 1;
                }
                let reached = grid.rows[*start..]
                    .iter()
                    .take_while(|touched| touched.start <= terrain_row);
                let reached = *start..*start + reached.count();
                if reached.is_empty() {
                    continue;
                }
                for (least, touched) in least.iter_mut().zip(&grid.columns) {
                    let from = touched.start.clamp(columns.start, columns.end) - columns.start;
                    let to = touched.end.clamp(columns.start, columns.end) - columns.start;
                    *least = codes[from as usize..to as usize].iter().copied().min().unwrap_or(0);
                }
                for row in reached {
                    let from = (block.rows.start + row) * across + block.columns.start;
                    for (rank, least) in ranks[from..from + least.len()].iter_mut().zip(&least) {
                        *rank = (*rank).min(*least);
                    }
                }
            }
        }
        (rows.count() * codes.len()) as u64
    }
}

/// Whether a range of rows or columns lies inside a terrain of `limit` of them.
fn within(range: &Range<i64>, limit: i64) -> bool {
    range.start >= 0 && range.end <= limit
}

/// The range around all ranges, cut to a terrain of `limit` rows or columns.
fn hull<'a>(grids: impl Iterator<Item = &'a [Range<i64>]> + Clone, limit: i64) -> Range<i64> {
    let start = grids
        .clone()
        .filter_map(|ranges| ranges.first())
        .map(|range| range.start)
        .min();
    let end = grids.filter_map(|ranges| ranges.last()).map(|range| range.end).max();
    let (start, end) = (start.unwrap_or(0).clamp(0, limit), end.unwrap_or(0).clamp(0, limit));
    start..end
}
