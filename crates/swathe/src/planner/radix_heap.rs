//! Cells by their costs.

use super::queue::Queue;

/// Cells ordered by a cost that never falls below the last one taken.
pub(super) struct RadixHeap(Queue);

impl RadixHeap {
    pub(super) fn new() -> Self {
        Self(Queue::new())
    }

    /// Adds a cell. Costs that rounding put below the last one taken count as equal to it.
    pub(super) fn push(&mut self, cost: f64, cell: u32) {
        debug_assert!(cost >= 0.0);
        // The bits of non-negative floats are in the order of the floats; adding 0.0 turns -0.0 into 0.0.
        self.0.push((cost + 0.0).to_bits(), cell);
    }

    /// Takes the cell of least cost.
    pub(super) fn pop(&mut self) -> Option<(f64, u32)> {
        self.0.pop().map(|(key, cell)| (f64::from_bits(key), cell))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn costs_come_out_in_order(
            first in prop::collection::vec(0.0f64..1e6, 1..50), more in prop::collection::vec(0.0f64..1e3, 0..50),
        ) {
            let mut heap = RadixHeap::new();
            for &cost in &first {
                heap.push(cost, 0);
            }
            let (mut last, mut taken) = (0.0, 0);
            let mut more_left = more.iter();
            while let Some((cost, _)) = heap.pop() {
                prop_assert!(cost >= last);
                last = cost;
                taken += 1;
                if let Some(extra) = more_left.next() {
                    heap.push(last + extra, 1);
                }
            }
            prop_assert_eq!(taken, first.len() + more.len().min(taken));
        }
    }
}
