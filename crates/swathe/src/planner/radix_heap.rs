//! A monotone priority queue for costs: exact, without a bucket width to choose.
//!
//! Source: Ahuja, Mehlhorn, Orlin, Tarjan, "Faster algorithms for the shortest path problem", J. ACM 37 (1990), in the
//! form with one bucket per highest differing bit of the key.

/// Cells ordered by a cost that never falls below the last one taken.
pub(super) struct RadixHeap {
    buckets: Vec<Vec<(u64, u32)>>,
    last: u64,
}

impl RadixHeap {
    pub(super) fn new() -> Self {
        Self {
            buckets: vec![Vec::new(); 65],
            last: 0,
        }
    }

    /// Adds a cell. Costs that rounding put below the last one taken count as equal to it.
    pub(super) fn push(&mut self, cost: f64, cell: u32) {
        debug_assert!(cost >= 0.0);
        // The bits of non-negative floats are in the order of the floats; adding 0.0 turns -0.0 into 0.0.
        let key = (cost + 0.0).to_bits().max(self.last);
        self.buckets[Self::bucket(key, self.last)].push((key, cell));
    }

    /// Takes the cell of least cost.
    pub(super) fn pop(&mut self) -> Option<(f64, u32)> {
        if self.buckets[0].is_empty() {
            let lowest = self.buckets.iter().position(|bucket| !bucket.is_empty())?;
            let entries = std::mem::take(&mut self.buckets[lowest]);
            self.last = entries.iter().map(|entry| entry.0).min()?;
            for &(key, cell) in &entries {
                self.buckets[Self::bucket(key, self.last)].push((key, cell));
            }
            let mut emptied = entries;
            emptied.clear();
            self.buckets[lowest] = emptied;
        }
        let (key, cell) = self.buckets[0].pop()?;
        Some((f64::from_bits(key), cell))
    }

    fn bucket(key: u64, last: u64) -> usize {
        64 - (key ^ last).leading_zeros() as usize
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
