//! Union-find whose root is the least member, so that labels do not depend on the order of unions.

/// Disjoint sets of `0..len`.
#[derive(Clone, Debug)]
pub struct UnionFind {
    parent: Vec<u32>,
}

impl UnionFind {
    /// `len` sets of one.
    pub fn new(len: usize) -> Self {
        Self {
            parent: (0..len as u32).collect(),
        }
    }

    /// Adds a set of one and returns its number.
    pub fn push(&mut self) -> u32 {
        let number = self.parent.len() as u32;
        self.parent.push(number);
        number
    }

    /// Makes every one of `items` a set of one. They must be all the members of the sets that they are in.
    pub fn separate(&mut self, items: &[u32]) {
        for &item in items {
            self.parent[item as usize] = item;
        }
    }

    /// The least member of the set that holds `item`.
    pub fn find(&mut self, item: u32) -> u32 {
        let mut here = item;
        while self.parent[here as usize] != here {
            let above = self.parent[self.parent[here as usize] as usize];
            self.parent[here as usize] = above;
            here = above;
        }
        here
    }

    /// The least member without shortening the way for the next search.
    pub fn peek(&self, item: u32) -> u32 {
        let mut here = item;
        while self.parent[here as usize] != here {
            here = self.parent[here as usize];
        }
        here
    }

    /// Number of items.
    pub fn len(&self) -> usize {
        self.parent.len()
    }

    /// Whether there are no items.
    pub fn is_empty(&self) -> bool {
        self.parent.is_empty()
    }

    /// The sets numbered from 1 in the order of their least members: each item's number, and the sum of the `weights` of
    /// each set's items.
    pub fn into_numbers(self, weights: &[u32]) -> (Vec<u32>, Vec<u32>) {
        let (mut numbers, mut sums) = (self.parent, Vec::new());
        for (item, weight) in weights.iter().enumerate() {
            // A parent comes before its members and holds its number already.
            let parent = numbers[item] as usize;
            if parent == item {
                sums.push(0);
                numbers[item] = sums.len() as u32;
            } else {
                numbers[item] = numbers[parent];
            }
            sums[numbers[item] as usize - 1] += weight;
        }
        (numbers, sums)
    }

    /// Writes the numbers of the sets, counted from 1 in the order of their least members, over zeros where `counts`
    /// holds (for all of a set or for none of it), and returns the sizes of the sets.
    pub fn label(&self, counts: impl Fn(usize) -> bool, labels: &mut [u32]) -> Vec<u32> {
        let mut sizes: Vec<u32> = Vec::new();
        for (item, &parent) in self.parent.iter().enumerate() {
            if counts(item) {
                if parent as usize == item {
                    sizes.push(0);
                    labels[item] = sizes.len() as u32;
                } else {
                    labels[item] = labels[parent as usize];
                }
                sizes[labels[item] as usize - 1] += 1;
            }
        }
        sizes
    }

    /// The same labels in the memory of the sets.
    pub fn into_labels(self, counts: impl Fn(usize) -> bool) -> (Vec<u32>, Vec<u32>) {
        let (mut labels, mut sizes): (_, Vec<u32>) = (self.parent, Vec::new());
        for item in 0..labels.len() {
            if counts(item) {
                let parent = labels[item] as usize;
                if parent == item {
                    sizes.push(0);
                    labels[item] = sizes.len() as u32;
                } else {
                    labels[item] = labels[parent];
                }
                sizes[labels[item] as usize - 1] += 1;
            } else {
                labels[item] = 0;
            }
        }
        (labels, sizes)
    }

    /// Joins the sets of `a` and `b`; returns whether they were apart.
    pub fn union(&mut self, a: u32, b: u32) -> bool {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b) as usize] = a.min(b);
        a != b
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_root_is_the_least_member_whatever_the_order(
            pairs in prop::collection::vec((0u32..30, 0u32..30), 0..60),
        ) {
            let roots = |pairs: &mut dyn Iterator<Item = (u32, u32)>| {
                let mut sets = UnionFind::new(30);
                for (a, b) in pairs {
                    sets.union(a, b);
                }
                (0..30).map(|i| sets.find(i)).collect::<Vec<_>>()
            };
            let forward = roots(&mut pairs.iter().copied());
            let backward = roots(&mut pairs.iter().rev().map(|&(a, b)| (b, a)));
            prop_assert_eq!(&forward, &backward);
            for (item, root) in forward.iter().enumerate() {
                prop_assert!(*root as usize <= item);
            }
        }
    }
}
