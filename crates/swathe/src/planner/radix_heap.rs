//! Cells by the bits of a cost: a monotone priority queue, exact, without a bucket width to choose.
//!
//! Source: Ahuja, Mehlhorn, Orlin, Tarjan, "Faster algorithms for the shortest path problem", J. ACM 37 (1990), in the
//! form with one bucket per highest differing bit of the key. It can be emptied to be keyed anew, which is how a move of the robot
//! and changed costs enter a repair, and then it may begin below what it gave last.

/// Cells ordered by a key that never falls below the last one taken since the queue was last emptied.
#[derive(Clone, Debug)]
pub(super) struct RadixHeap {
    /// By the highest bit in which a key differs from the last one taken.
    buckets: Vec<Vec<(u64, u32)>>,
    /// Which buckets but the first hold something: bit 0 is that of bucket 1.
    filled: u64,
    last: u64,
}

impl RadixHeap {
    pub(super) fn new() -> Self {
        Self {
            buckets: vec![Vec::new(); 65],
            filled: 0,
            last: 0,
        }
    }

    /// Adds a cell. Keys that rounding put below the last one taken count as equal to it.
    pub(super) fn push(&mut self, key: u64, cell: u32) {
        self.file(key.max(self.last), cell);
    }

    fn file(&mut self, key: u64, cell: u32) {
        let bucket = Self::bucket(key, self.last);
        if bucket > 0 {
            self.filled |= 1 << (bucket - 1);
        }
        self.buckets[bucket].push((key, cell));
    }

    /// Takes a cell of least key.
    pub(super) fn pop(&mut self) -> Option<(u64, u32)> {
        if self.buckets[0].is_empty() {
            if self.filled == 0 {
                return None;
            }
            let lowest = self.filled.trailing_zeros() as usize + 1;
            self.filled &= self.filled - 1;
            let mut entries = std::mem::take(&mut self.buckets[lowest]);
            self.last = entries.iter().map(|entry| entry.0).min()?;
            for &(key, cell) in &entries {
                self.file(key, cell);
            }
            entries.clear();
            self.buckets[lowest] = entries;
        }
        self.buckets[0].pop()
    }

    /// Moves all cells to the end of a list; the queue may begin anywhere afterwards.
    pub(super) fn empty_into(&mut self, cells: &mut Vec<u32>) {
        for bucket in &mut self.buckets {
            cells.extend(bucket.drain(..).map(|entry| entry.1));
        }
        (self.filled, self.last) = (0, 0);
    }

    fn bucket(key: u64, last: u64) -> usize {
        64 - (key ^ last).leading_zeros() as usize
    }
}

/// Cells ordered by a cost that never falls below the last one taken.
pub(super) struct CostHeap(RadixHeap);

impl CostHeap {
    pub(super) fn new() -> Self {
        Self(RadixHeap::new())
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
        fn keys_come_out_in_order_and_once_emptied_it_begins_anew(
            first in prop::collection::vec(0u64..1 << 60, 1..60), more in prop::collection::vec(0u64..1 << 40, 0..60),
            again in prop::collection::vec(0u64..1 << 30, 1..20),
        ) {
            let mut queue = RadixHeap::new();
            for &key in &first {
                queue.push(key, 0);
            }
            let (mut last, mut taken, mut extra) = (0, 0, more.iter());
            while let Some((key, _)) = queue.pop() {
                prop_assert!(key >= last);
                (last, taken) = (key, taken + 1);
                if let Some(extra) = extra.next() {
                    queue.push(last + extra, 1);
                }
            }
            prop_assert_eq!(taken, first.len() + more.len().min(taken));
            queue.push(last, 7);
            let mut left = Vec::new();
            queue.empty_into(&mut left);
            prop_assert_eq!(left, [7]);
            for &key in &again {
                queue.push(key, 0);
            }
            let mut sorted = again.clone();
            sorted.sort_unstable();
            let out: Vec<u64> = std::iter::from_fn(|| queue.pop()).map(|entry| entry.0).collect();
            prop_assert_eq!(out, sorted);
        }

        #[test]
        fn costs_come_out_as_they_went_in(
            costs in prop::collection::vec(
                prop_oneof![0.0f64..1e6, Just(-0.0), Just(0.0), Just(1e-310), Just(f64::INFINITY)],
                1..60,
            ),
        ) {
            let mut heap = CostHeap::new();
            for &cost in &costs {
                heap.push(cost, 0);
            }
            let mut sorted = costs.clone();
            sorted.sort_by(f64::total_cmp);
            let out: Vec<f64> = std::iter::from_fn(|| heap.pop()).map(|entry| entry.0).collect();
            prop_assert_eq!(out, sorted);
        }
    }
}
