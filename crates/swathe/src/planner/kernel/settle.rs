//! The loop that settles cells, bucket by bucket.

use std::hint::black_box;

use crate::progress::Report;

use super::costs::CellCost;
use super::labels::Labels;
use super::limits::Limits;
use super::queue::Buckets;
use super::stencil::Stencil;

/// Entries whose surroundings are fetched together, before they are expanded.
const FETCHED: usize = 16;
/// Cells settled between two reports.
const CELLS_PER_REPORT: u64 = 1 << 18;

/// Costs per metre as the loop sees them: the caller's own numbers, in place.
pub(in crate::planner) struct Ground<'a, C> {
    /// Row by row.
    pub(in crate::planner) costs: &'a [C],
    pub(in crate::planner) rows: usize,
    pub(in crate::planner) columns: usize,
    /// Side of a cell, in metres times the scale of the labels.
    pub(in crate::planner) metres: f64,
    /// Whether cells that a step passes at a corner must be open.
    pub(in crate::planner) keep: bool,
}

/// How settling ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Settled {
    /// The goal has its least cost.
    Goal,
    /// Nothing is left to settle.
    All,
    /// The caller asked to stop.
    Stopped,
}

impl<C: CellCost> Ground<'_, C> {
    /// The same ground with another side of a cell.
    pub(super) fn with_metres(&self, metres: f64) -> Self {
        Self {
            costs: self.costs,
            metres,
            ..*self
        }
    }

    /// The same ground with other costs.
    pub(super) fn with_costs<'a, D>(&self, costs: &'a [D]) -> Ground<'a, D> {
        Ground {
            costs,
            rows: self.rows,
            columns: self.columns,
            metres: self.metres,
            keep: self.keep,
        }
    }
    /// Costs per metre around a cell; cells outside are closed.
    #[inline(always)]
    pub(super) fn around<const W: usize>(&self, index: usize, row: usize, column: usize) -> [[f64; W]; W] {
        self.square(self.costs, CellCost::per_metre, f64::NAN, index, row, column)
    }

    /// The values around a cell, and `outside` for cells outside.
    #[inline(always)]
    fn square<T: Copy, V: Copy, const W: usize>(
        &self,
        values: &[T],
        value: impl Fn(T) -> V,
        outside: V,
        index: usize,
        row: usize,
        column: usize,
    ) -> [[V; W]; W] {
        let reach = W / 2;
        let mut square = [[outside; W]; W];
        if row.wrapping_sub(reach) < self.rows.saturating_sub(2 * reach)
            && column.wrapping_sub(reach) < self.columns.saturating_sub(2 * reach)
        {
            let mut first = index - reach * self.columns - reach;
            for line in &mut square {
                if let Some(found) = values.get(first..).and_then(<[T]>::first_chunk::<W>) {
                    *line = found.map(&value);
                }
                first += self.columns;
            }
            return square;
        }
        for (r, line) in square.iter_mut().enumerate() {
            for (c, place) in line.iter_mut().enumerate() {
                let (row, column) = ((row + r).wrapping_sub(reach), (column + c).wrapping_sub(reach));
                if row < self.rows && column < self.columns {
                    *place = value(values[row * self.columns + column]);
                }
            }
        }
        square
    }

    /// Settles cells from `start` on until `goal` has its least cost, and counts them in `settled`, which is reported now
    /// and then, and at the end.
    ///
    /// Cells whose limit the present bucket has passed are not expanded.
    pub(super) fn settle<S: Stencil<W, N>, L: Labels, const W: usize, const N: usize>(
        &self,
        start: usize,
        goal: Option<usize>,
        limits: Option<&Limits>,
        kind: &mut L,
        labels: &mut [L::Label],
        settled: &mut u64,
        report: &mut Report,
    ) -> Settled {
        let offsets = S::STEPS.map(|step| step.rows as isize * self.columns as isize + step.columns as isize);
        let row_of = Divisor::new(self.columns);
        let mut queue = Buckets::new(kind.circle());
        labels[start] = L::START;
        queue.push(0, (start as u32, L::START));
        let mut present: Vec<(u32, L::Label)> = Vec::new();
        let mut next_report = *settled;
        loop {
            let round = queue.round();
            while queue.take(&mut present) {
                for (place, &(index, label)) in present.iter().enumerate() {
                    if place % FETCHED == 0 {
                        self.fetch(labels, &present, place + FETCHED);
                        if *settled >= next_report {
                            next_report = *settled + CELLS_PER_REPORT;
                            if !report(*settled, 0) {
                                return Settled::Stopped;
                            }
                        }
                    }
                    let index = index as usize;
                    if labels[index] != label {
                        continue;
                    }
                    let row = row_of.of(index);
                    let column = index - row * self.columns;
                    if limits.is_some_and(|limits| limits.passed(row, column, round)) {
                        continue;
                    }
                    *settled += 1;
                    let costs = S::costs(&self.around::<W>(index, row, column), self.metres, self.keep);
                    let near = S::pick(&self.square(labels, |label| label, L::UNREACHED, index, row, column));
                    let (better, mut improved) = kind.improved(label, &near, &costs);
                    while improved != 0 {
                        let k = improved.trailing_zeros() as usize & (N - 1);
                        improved &= improved - 1;
                        let near = index.wrapping_add_signed(offsets[k]);
                        labels[near] = better[k];
                        kind.came(near, k);
                        queue.push(kind.bucket(better[k], round), (near as u32, better[k]));
                    }
                }
            }
            if let Some(goal) = goal
                && labels[goal] != L::UNREACHED
                && kind.bucket(labels[goal], round) <= round
            {
                report(*settled, 0);
                return Settled::Goal;
            }
            if !queue.advance() {
                report(*settled, 0);
                return Settled::All;
            }
        }
    }

    /// Reads what the entries from a place on will need, all at once, so that memory answers them side by side.
    #[inline(always)]
    fn fetch<T: Copy + PartialEq>(&self, labels: &[T], entries: &[(u32, T)], from: usize) {
        for &(index, _) in entries.iter().skip(from).take(FETCHED) {
            let index = index as usize;
            for near in [index.wrapping_sub(self.columns), index + self.columns] {
                if let (Some(&label), Some(&cost)) = (labels.get(near), self.costs.get(near)) {
                    black_box((label, cost));
                }
            }
        }
    }
}

/// Division of 32-bit numbers by one and the same number, as a multiplication.
///
/// Source: Lemire, Kaser and Kurz, "Faster remainder by direct computation", Software: Practice and Experience 49 (2019).
struct Divisor {
    inverse: u64,
}

impl Divisor {
    fn new(divisor: usize) -> Self {
        Self {
            // Wraps to 0 for 1, which `of` knows.
            inverse: (u64::MAX / divisor as u64).wrapping_add(1),
        }
    }

    #[inline(always)]
    fn of(&self, number: usize) -> usize {
        if self.inverse == 0 {
            return number;
        }
        ((u128::from(self.inverse) * number as u128) >> 64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn division_by_multiplication_is_division(number: u32, divisor in prop_oneof![1u32..9, 1u32..=u32::MAX]) {
            let quotient = Divisor::new(divisor as usize).of(number as usize);
            prop_assert_eq!(quotient, (number / divisor) as usize);
        }
    }
}
