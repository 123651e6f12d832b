//! A way read back from labels.

use crate::grid::Cell;
use crate::planner::search::Search;

use super::costs::CellCost;
use super::labels::{Fixed, Labels};
use super::settle::Ground;
use super::stencil::Stencil;

/// A way: cells from start to goal, and the step that leads out of each but the last.
pub(super) struct Way {
    cells: Vec<usize>,
    steps: Vec<u8>,
}

impl Way {
    /// Walks back from the goal along steps that explain the labels.
    ///
    /// Every label was made by such a step from a label that is lower, or, of floats, was remembered with the step that
    /// improved it last: either way the walk ends at the start and enters no cell twice.
    pub(super) fn trace<C: CellCost, S: Stencil<W, N>, L: Labels, const W: usize, const N: usize>(
        ground: &Ground<C>,
        kind: &L,
        labels: &[L::Label],
        [start, goal]: [usize; 2],
    ) -> Self {
        let (mut cells, mut steps) = (vec![goal], Vec::new());
        let mut here = goal;
        while here != start {
            let (row, column) = (here / ground.columns, here % ground.columns);
            let before = (0..N).find_map(|k| {
                let row = row.checked_add_signed(-S::STEPS[k].rows as isize)?;
                let column = column.checked_add_signed(-S::STEPS[k].columns as isize)?;
                if row >= ground.rows || column >= ground.columns {
                    return None;
                }
                let before = row * ground.columns + column;
                let cost = || S::costs(&ground.around::<W>(before, row, column), ground.metres, ground.keep)[k];
                kind.explains(here, k, labels[before], labels[here], cost)
                    .then_some((before, k as u8))
            });
            let Some((before, k)) = before else {
                debug_assert!(false, "a label without a step that explains it");
                break;
            };
            cells.push(before);
            steps.push(k);
            here = before;
        }
        cells.reverse();
        steps.reverse();
        Self { cells, steps }
    }

    /// The cost over a ground, summed from start to goal.
    pub(super) fn cost<C: CellCost, S: Stencil<W, N>, const W: usize, const N: usize>(
        &self,
        ground: &Ground<C>,
    ) -> f64 {
        self.costs::<C, S, W, N>(ground).sum()
    }

    /// The cost over a ground in whole units, each step rounded down as labels are.
    pub(super) fn units<C: CellCost, S: Stencil<W, N>, const W: usize, const N: usize>(
        &self,
        ground: &Ground<C>,
    ) -> u64 {
        self.costs::<C, S, W, N>(ground)
            .map(|cost| u64::from(Fixed::units(cost)))
            .sum()
    }

    fn costs<C: CellCost, S: Stencil<W, N>, const W: usize, const N: usize>(
        &self,
        ground: &Ground<C>,
    ) -> impl Iterator<Item = f64> {
        self.cells.iter().zip(&self.steps).map(|(&cell, &k)| {
            let (row, column) = (cell / ground.columns, cell % ground.columns);
            S::costs(&ground.around::<W>(cell, row, column), ground.metres, ground.keep)[usize::from(k)]
        })
    }

    /// The answer, with the cost in the ground's own metres.
    pub(super) fn into_search<C: CellCost, S: Stencil<W, N>, const W: usize, const N: usize>(
        self,
        ground: &Ground<C>,
    ) -> Search {
        let cost = self.cost::<C, S, W, N>(ground);
        let cell = |index| Cell::new(index / ground.columns, index % ground.columns);
        Search::Found {
            cells: self.cells.into_iter().map(cell).collect(),
            cost,
        }
    }
}
