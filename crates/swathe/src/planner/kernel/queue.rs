//! A circle of buckets: the queue of a search whose costs never fall.
//!
//! Source: Dial, "Algorithm 360: shortest-path forest with topological ordering", CACM 12 (1969), with buckets wider than
//! one unit; Dinitz (1978): a width of at most the least edge loses nothing. Inside a wider bucket cells are taken first in,
//! first out and may be taken again (Meyer and Sanders, "Delta-stepping", J. Algorithms 49, 2003).

/// Entries by bucket number; numbers only grow.
pub(in crate::planner) struct Buckets<E> {
    slots: Vec<Vec<E>>,
    waiting: usize,
    /// Entries beyond the circle, with their bucket.
    far: Vec<(u64, E)>,
    nearest_far: u64,
    round: u64,
}

impl<E: Copy> Buckets<E> {
    /// A circle of a number of buckets, which is a power of two.
    pub(in crate::planner) fn new(buckets: usize) -> Self {
        debug_assert!(buckets.is_power_of_two());
        Self {
            slots: std::iter::repeat_with(Vec::new).take(buckets).collect(),
            waiting: 0,
            far: Vec::new(),
            nearest_far: u64::MAX,
            round: 0,
        }
    }

    /// The bucket whose turn it is.
    pub(in crate::planner) fn round(&self) -> u64 {
        self.round
    }

    /// How many buckets the circle has.
    pub(in crate::planner) fn circle(&self) -> u64 {
        self.slots.len() as u64
    }

    /// Adds an entry; a bucket whose turn has passed counts as the present one.
    #[inline]
    pub(in crate::planner) fn push(&mut self, bucket: u64, entry: E) {
        let bucket = bucket.max(self.round);
        if bucket - self.round >= self.circle() {
            self.nearest_far = self.nearest_far.min(bucket);
            self.far.push((bucket, entry));
            return;
        }
        let slot = bucket as usize & (self.slots.len() - 1);
        self.slots[slot].push(entry);
        self.waiting += 1;
    }

    /// Swaps the entries of the present bucket into `taken`, whose own are dropped; false when there are none.
    pub(in crate::planner) fn take(&mut self, taken: &mut Vec<E>) -> bool {
        taken.clear();
        let slot = self.round as usize & (self.slots.len() - 1);
        std::mem::swap(&mut self.slots[slot], taken);
        self.waiting -= taken.len();
        !taken.is_empty()
    }

    /// Goes on to the next bucket with entries; false when none are left. The present bucket must be empty.
    pub(in crate::planner) fn advance(&mut self) -> bool {
        if self.waiting == 0 {
            if self.far.is_empty() {
                return false;
            }
            self.round = self.nearest_far;
        } else {
            self.round += 1;
            while self.round < self.nearest_far && self.slots[self.round as usize & (self.slots.len() - 1)].is_empty() {
                self.round += 1;
            }
        }
        if self.round >= self.nearest_far {
            self.nearest_far = u64::MAX;
            for (bucket, entry) in std::mem::take(&mut self.far) {
                self.push(bucket, entry);
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn entries_come_out_by_bucket_and_none_is_lost(
            first in prop::collection::vec(0u64..1000, 1..40), more in prop::collection::vec(0u64..300, 0..40),
            jump in prop_oneof![Just(0u64), Just(1 << 40)],
        ) {
            let mut queue = Buckets::new(16);
            for &bucket in &first {
                queue.push(bucket + jump, bucket + jump);
            }
            let (mut taken, mut seen, mut last) = (Vec::new(), 0, 0);
            let mut extra = more.iter();
            loop {
                while queue.take(&mut taken) {
                    for &entry in &taken {
                        prop_assert!(entry >= last && entry == queue.round());
                        last = entry;
                        seen += 1;
                        if let Some(add) = extra.next() {
                            queue.push(entry + add, entry + add);
                        }
                    }
                }
                if !queue.advance() {
                    break;
                }
            }
            prop_assert_eq!(seen, first.len() + more.len() - extra.len());
        }
    }
}
