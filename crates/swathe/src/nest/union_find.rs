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

    /// The same without shortening the way for the next search.
    pub fn peek(&self, item: u32) -> u32 {
        let mut here = item;
        while self.parent[here as usize] != here {
            here = self.parent[here as usize];
        }
        here
    }

    /// The least member of each item's set plus one, or 0 where `counts` is false, in the memory of the sets.
    pub fn into_roots(mut self, counts: impl Fn(usize) -> bool) -> Vec<u32> {
        // Parents come before their members, so one pass in order suffices.
        for item in 0..self.parent.len() {
            let above = self.parent[item] as usize;
            self.parent[item] = self.parent[above];
        }
        for (item, root) in self.parent.iter_mut().enumerate() {
            *root = if counts(item) { *root + 1 } else { 0 };
        }
        self.parent
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
