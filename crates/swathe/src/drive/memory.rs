//! The memory of what was seen: cells in tiles that are made when something is first seen there.

use std::collections::HashMap;

/// Cells along a tile's side.
const SIDE: i64 = 64;

/// What is remembered of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Seen {
    /// Never seen.
    #[default]
    Unknown,
    /// Seen, and nothing there.
    Free,
    /// Something stands there.
    Occupied,
    /// Felt, or marked as a trap; stays.
    Stamped,
}

impl Seen {
    pub fn closed(self) -> bool {
        matches!(self, Self::Occupied | Self::Stamped)
    }
}

/// The memory; cells by row (down from y = 0) and column (right from x = 0).
#[derive(Clone, Debug)]
pub(super) struct Memory {
    pub cell_size_m: f64,
    most_tiles: usize,
    index: HashMap<(i64, i64), usize>,
    tiles: Vec<((i64, i64), Vec<Seen>)>,
    /// The tile that was asked for last; neighbours follow each other.
    last: Option<((i64, i64), usize)>,
}

impl Memory {
    pub fn new(cell_size_m: f64, most_tiles: usize) -> Self {
        Self {
            cell_size_m,
            most_tiles,
            index: HashMap::new(),
            tiles: Vec::new(),
            last: None,
        }
    }

    pub fn clear(&mut self) {
        self.index.clear();
        self.tiles.clear();
        self.last = None;
    }

    /// Forgets everything farther from a place than some metres.
    pub fn clear_beyond(&mut self, x_m: f64, y_m: f64, near_m: f64) {
        let reach = (near_m / self.cell_size_m).ceil() as i64;
        let (row, column) = self.cell_of(x_m, y_m);
        let kept: Vec<((i64, i64), Seen)> = (row - reach..=row + reach)
            .flat_map(|row| (column - reach..=column + reach).map(move |column| (row, column)))
            .map(|cell| (cell, self.get(cell)))
            .collect();
        self.clear();
        for (cell, seen) in kept {
            if seen != Seen::Unknown {
                self.set(cell, seen);
            }
        }
    }

    pub fn cell_of(&self, x_m: f64, y_m: f64) -> (i64, i64) {
        (
            (-y_m / self.cell_size_m).floor() as i64,
            (x_m / self.cell_size_m).floor() as i64,
        )
    }

    fn place((row, column): (i64, i64)) -> ((i64, i64), usize) {
        let within = row.rem_euclid(SIDE) * SIDE + column.rem_euclid(SIDE);
        ((row.div_euclid(SIDE), column.div_euclid(SIDE)), within as usize)
    }

    pub fn get(&self, cell: (i64, i64)) -> Seen {
        let (key, within) = Self::place(cell);
        match self.last {
            Some((last, at)) if last == key => self.tiles[at].1[within],
            _ => self
                .index
                .get(&key)
                .map_or(Seen::Unknown, |&at| self.tiles[at].1[within]),
        }
    }

    /// Copies a square of cells, row by row from a first one on.
    pub fn copy_square(&self, first: (i64, i64), side: usize, square: &mut Vec<Seen>) {
        square.clear();
        square.resize(side * side, Seen::Unknown);
        let end = (first.0 + side as i64, first.1 + side as i64);
        for down in first.0.div_euclid(SIDE)..=(end.0 - 1).div_euclid(SIDE) {
            for right in first.1.div_euclid(SIDE)..=(end.1 - 1).div_euclid(SIDE) {
                let Some(&at) = self.index.get(&(down, right)) else {
                    continue;
                };
                let tile = &self.tiles[at].1;
                let (left, most) = ((right * SIDE).max(first.1), ((right + 1) * SIDE).min(end.1));
                for row in (down * SIDE).max(first.0)..((down + 1) * SIDE).min(end.0) {
                    let from = ((row - down * SIDE) * SIDE + left - right * SIDE) as usize;
                    let to = (row - first.0) as usize * side + (left - first.1) as usize;
                    let count = (most - left) as usize;
                    square[to..to + count].copy_from_slice(&tile[from..from + count]);
                }
            }
        }
    }

    /// Sets a cell; returns whether it was something else before.
    pub fn set(&mut self, cell: (i64, i64), seen: Seen) -> bool {
        let (key, within) = Self::place(cell);
        let at = match self.last {
            Some((last, at)) if last == key => at,
            _ => {
                let at = self.tile(key);
                self.last = Some((key, at));
                at
            }
        };
        let before = std::mem::replace(&mut self.tiles[at].1[within], seen);
        before != seen
    }

    /// The tile with a key, made if need be; the one farthest away makes room for it.
    fn tile(&mut self, key: (i64, i64)) -> usize {
        if let Some(&at) = self.index.get(&key) {
            return at;
        }
        if self.tiles.len() >= self.most_tiles {
            let away = |(row, column): (i64, i64)| (row - key.0).pow(2) + (column - key.1).pow(2);
            // The first of the farthest, so that the same drive forgets the same tiles.
            let farthest = (0..self.tiles.len()).rev().max_by_key(|&at| away(self.tiles[at].0));
            if let Some(at) = farthest {
                let old = std::mem::replace(&mut self.tiles[at].0, key);
                self.tiles[at].1.fill(Seen::Unknown);
                self.index.remove(&old);
                self.index.insert(key, at);
                return at;
            }
        }
        self.tiles.push((key, vec![Seen::Unknown; (SIDE * SIDE) as usize]));
        self.index.insert(key, self.tiles.len() - 1);
        self.tiles.len() - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn only_what_is_near_is_kept(cells in prop::collection::btree_set((-100i64..100, -100i64..100), 1..60), near_m in 0.1..8.0_f64) {
            let mut memory = Memory::new(0.2, 1000);
            for &cell in &cells {
                memory.set(cell, Seen::Occupied);
            }
            memory.clear_beyond(0.1, -0.1, near_m);
            let reach = (near_m / 0.2).ceil() as i64;
            for &cell in &cells {
                let is_kept = memory.get(cell) == Seen::Occupied;
                prop_assert_eq!(is_kept, cell.0.abs().max(cell.1.abs()) <= reach);
            }
        }

        #[test]
        fn cells_are_remembered_wherever_they_lie(cells in prop::collection::btree_set((-500i64..500, -500i64..500), 1..40)) {
            let mut memory = Memory::new(0.2, 1000);
            for &cell in &cells {
                prop_assert!(memory.set(cell, Seen::Occupied));
                prop_assert!(!memory.set(cell, Seen::Occupied));
            }
            for row in -3..3 {
                for column in -3..3 {
                    let expected = if cells.contains(&(row, column)) { Seen::Occupied } else { Seen::Unknown };
                    prop_assert_eq!(memory.get((row, column)), expected);
                }
            }
            prop_assert!(cells.iter().all(|&cell| memory.get(cell) == Seen::Occupied));
            let mut square = Vec::new();
            memory.copy_square((-200, -130), 300, &mut square);
            for (index, &seen) in square.iter().enumerate() {
                prop_assert_eq!(memory.get((-200 + index as i64 / 300, -130 + index as i64 % 300)), seen);
            }
        }
    }

    #[test]
    fn the_tile_farthest_away_makes_room() {
        let mut memory = Memory::new(0.2, 3);
        for tile in 0..4 {
            memory.set((0, tile * SIDE), Seen::Free);
        }
        assert_eq!(memory.tiles.len(), 3);
        assert_eq!(memory.get((0, 0)), Seen::Unknown);
        assert_eq!(memory.get((0, 3 * SIDE)), Seen::Free);
        assert_eq!(memory.get((0, SIDE)), Seen::Free);
    }
}
