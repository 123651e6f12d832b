//! How near a cell is to no-go or unknown ground, which is what risk counts.
//!
//! Over a whole ground by an exact distance transform, or around single cells for searches that look at little. Both give
//! the same numbers, whatever was found out in which order: only ranks decide, never how far a swarm has come.

use std::cell::RefCell;

use crate::grid::{Cell, GridGeometry, Layer, Step, disc, squared_distances};
use crate::rank::CellSource;

use super::refusal::is_no_go;

/// Exposure to no-go ground at a squared distance in cells: max(0, 1 − d / d₀)².
fn exposure(squared_cells: u64, cell_size_m: f64, reach_m: f64) -> f64 {
    let share = (1.0 - (squared_cells as f64).sqrt() * cell_size_m / reach_m).max(0.0);
    share * share
}

/// Distances to no-go ground around all open cells.
pub(super) struct ClearanceField {
    squared: Layer<u64>,
    reach_m: f64,
    /// Cells whose rank was asked for.
    pub(super) cells_evaluated: u64,
}

impl ClearanceField {
    /// Ranks the cells that are not open within `reach_m` of open ones, and measures from those that are no-go.
    pub(super) fn new(source: &impl CellSource, is_open: impl Fn(usize) -> bool + Sync, reach_m: f64) -> Self {
        let geometry = source.geometry();
        let reach_cells = reach_m / geometry.cell_size_m();
        let from_open = squared_distances(geometry, &is_open);
        let near = |squared: u64| squared > 0 && squared as f64 <= reach_cells * reach_cells;
        let cells_evaluated = from_open.data().iter().filter(|&&squared| near(squared)).count() as u64;
        let squared = squared_distances(geometry, |index| {
            near(from_open.data()[index]) && is_no_go(source.cell_rank(geometry.cell(index)))
        });
        Self {
            squared,
            reach_m,
            cells_evaluated,
        }
    }

    pub(super) fn exposure(&self, cell: Cell) -> f64 {
        exposure(self.squared[cell], self.squared.geometry().cell_size_m(), self.reach_m)
    }
}

/// Distances to no-go ground around single cells. Every cell is looked at once.
pub(super) struct Nearness<Look> {
    geometry: GridGeometry,
    /// Steps within reach, the nearest first, with their squared lengths in cells.
    steps: Vec<(Step, u64)>,
    reach_m: f64,
    is_no_go: Look,
    known: RefCell<Vec<u8>>,
}

const CLEAR: u8 = 1;
const NO_GO: u8 = 2;

impl<Look: Fn(Cell) -> bool> Nearness<Look> {
    pub(super) fn new(geometry: GridGeometry, reach_m: f64, is_no_go: Look) -> Self {
        let mut steps: Vec<(Step, u64)> = disc(reach_m / geometry.cell_size_m())
            .into_iter()
            .map(|step| {
                let squared = i64::from(step.rows).pow(2) + i64::from(step.columns).pow(2);
                (step, squared as u64)
            })
            .collect();
        steps.sort_by_key(|step| step.1);
        Self {
            geometry,
            steps,
            reach_m,
            is_no_go,
            known: RefCell::new(vec![0; geometry.cell_count()]),
        }
    }

    pub(super) fn exposure(&self, cell: Cell) -> f64 {
        let nearest = self.steps.iter().find(|(step, _)| {
            let near = step.from(&self.geometry, cell);
            near.is_some_and(|near| self.is_no_go(near))
        });
        nearest.map_or(0.0, |&(_, squared)| {
            exposure(squared, self.geometry.cell_size_m(), self.reach_m)
        })
    }

    fn is_no_go(&self, cell: Cell) -> bool {
        let index = self.geometry.index(cell);
        let known = self.known.borrow()[index];
        if known > 0 {
            return known == NO_GO;
        }
        let no_go = (self.is_no_go)(cell);
        self.known.borrow_mut()[index] = if no_go { NO_GO } else { CLEAR };
        no_go
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rank::RankMap;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn both_ways_of_measuring_agree_and_nearer_is_riskier(
            ranks in prop::collection::vec(0u8..40, 180), reach_cells in 0.5f64..6.0,
        ) {
            let geometry = GridGeometry::new(12, 15, 4.0, 0.0, 0.0).unwrap();
            let ranks: Vec<u8> = ranks.iter().map(|&rank| rank.min(9)).collect();
            let map = RankMap::from_ranks(geometry, &ranks).unwrap();
            let is_open = |index: usize| ranks[index] >= 6;
            let reach_m = 4.0 * reach_cells;
            let field = ClearanceField::new(&map, is_open, reach_m);
            let near = Nearness::new(geometry, reach_m, |cell| is_no_go(map.cell_rank(cell)));
            for cell in geometry.cells().filter(|&cell| is_open(geometry.index(cell))) {
                let nearest_m = geometry
                    .cells()
                    .filter(|&other| ranks[geometry.index(other)] < 2)
                    .map(|other| geometry.centre(cell).distance_m(geometry.centre(other)))
                    .fold(f64::INFINITY, f64::min);
                let expected = (1.0 - nearest_m / reach_m).max(0.0).powi(2);
                prop_assert!((field.exposure(cell) - expected).abs() < 1e-12);
                prop_assert_eq!(field.exposure(cell), near.exposure(cell));
            }
        }
    }
}
