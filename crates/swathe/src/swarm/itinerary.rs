//! The order in which a permuting swarm visits the box of cells that holds its swathe: tile after tile in random order,
//! and the cells of each tile in random order. Neighbours are visited close in time, so what is known of them is at hand.

use std::ops::Range;

use crate::grid::Cell;
use crate::random::philox;

use super::agents::Extent;

/// Cells along a side of a tile, smaller ones at the south and east edge: with two cells about it, which is as far as a
/// visit changes anything under 3 x 3 vicinities, a row of a tile is one word of bits.
pub(super) const TILE_CELLS: usize = 60;

/// A random order of the cells of a box, each once an epoch.
#[derive(Clone, Debug)]
pub(super) struct Itinerary {
    extent: Extent,
    seed: u64,
    /// Numbers of the tiles in the order of visits.
    tiles: Vec<u32>,
    /// The visit with which each of them begins, and the number of visits of an epoch.
    starts: Vec<u64>,
}

/// A tile in its turn.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tile {
    /// First row.
    pub row: usize,
    /// First column.
    pub column: usize,
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Its visits, counted from the first epoch.
    pub visits: Range<u64>,
    key: u64,
}

impl Itinerary {
    pub(super) fn new(extent: Extent, seed: u64) -> Self {
        let tiles = extent.rows.div_ceil(TILE_CELLS) as u64 * extent.columns.div_ceil(TILE_CELLS) as u64;
        let mut itinerary = Self {
            extent,
            seed,
            tiles: (0..tiles).map(|turn| permuted(turn, tiles, seed) as u32).collect(),
            starts: Vec::with_capacity(tiles as usize + 1),
        };
        let mut start = 0;
        for turn in 0..itinerary.tiles.len() {
            itinerary.starts.push(start);
            let (_, _, rows, columns) = itinerary.block(turn);
            start += (rows * columns) as u64;
        }
        itinerary.starts.push(start);
        itinerary
    }

    /// First row, first column, rows and columns of the tile whose turn it is.
    fn block(&self, turn: usize) -> (usize, usize, usize, usize) {
        let Extent { rows, columns, .. } = self.extent;
        let across = columns.div_ceil(TILE_CELLS);
        let number = self.tiles[turn] as usize;
        let (row, column) = (number / across * TILE_CELLS, number % across * TILE_CELLS);
        let (high, wide) = (TILE_CELLS.min(rows - row), TILE_CELLS.min(columns - column));
        (self.extent.row + row, self.extent.column + column, high, wide)
    }

    /// The tile to which a visit belongs.
    pub(super) fn tile(&self, visit: u64) -> Tile {
        let count = self.extent.cell_count();
        let (epoch, within) = (visit / count, visit % count);
        let turn = self.starts.partition_point(|&start| start <= within) - 1;
        let (row, column, rows, columns) = self.block(turn);
        let [low, high, ..] = philox([self.tiles[turn], 0, 0, u32::MAX - 1], self.seed);
        Tile {
            row,
            column,
            rows,
            columns,
            visits: epoch * count + self.starts[turn]..epoch * count + self.starts[turn + 1],
            key: u64::from(high) << 32 | u64::from(low),
        }
    }
}

impl Tile {
    /// The cell of one of its visits.
    pub(super) fn cell(&self, visit: u64) -> Cell {
        let place = permuted(visit - self.visits.start, (self.rows * self.columns) as u64, self.key) as usize;
        Cell::new(self.row + place / self.columns, self.column + place % self.columns)
    }
}

/// Number `place` of a random order of `0..count`, `place` being below `count`: a Feistel network over the next power of
/// four, walked until it lands inside.
fn permuted(place: u64, count: u64, seed: u64) -> u64 {
    let half_bits = (64 - (count.max(2) - 1).leading_zeros()).div_ceil(2);
    let mask = (1u64 << half_bits) - 1;
    let mut number = place;
    loop {
        let (mut left, mut right) = (number >> half_bits, number & mask);
        for round in 0..4 {
            let mixed = philox([right as u32, (right >> 32) as u32, round, u32::MAX], seed)[0];
            (left, right) = (right, left ^ (u64::from(mixed) & mask));
        }
        number = left << half_bits | right;
        if number < count {
            return number;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_permutation_gives_each_number_once(count in 1u64..3000, seed: u64) {
            let mut seen = vec![false; count as usize];
            for place in 0..count {
                let number = permuted(place, count, seed) as usize;
                prop_assert!(!seen[number]);
                seen[number] = true;
            }
        }

        #[test]
        fn each_cell_of_a_box_of_any_shape_is_visited_once_an_epoch(
            row in 0usize..5, column in 0usize..5, rows in 1usize..200, columns in 1usize..200, seed: u64, epoch in 0u64..3,
        ) {
            let extent = Extent { row, column, rows, columns };
            let itinerary = Itinerary::new(extent, seed);
            let mut seen = vec![false; rows * columns];
            let mut visit = epoch * extent.cell_count();
            while visit < (epoch + 1) * extent.cell_count() {
                let tile = itinerary.tile(visit);
                prop_assert_eq!(tile.visits.start, visit);
                for visit in tile.visits.clone() {
                    prop_assert!(visit % 97 > 0 || itinerary.tile(visit) == tile);
                    let cell = tile.cell(visit);
                    let place = (cell.row - row) * columns + cell.column - column;
                    prop_assert!(!seen[place]);
                    seen[place] = true;
                }
                visit = tile.visits.end;
            }
            prop_assert!(seen.iter().all(|&seen| seen));
        }
    }

    #[test]
    fn seeds_give_orders_of_their_own() {
        let extent = Extent {
            row: 0,
            column: 0,
            rows: 130,
            columns: 150,
        };
        let cells = |seed| {
            let itinerary = Itinerary::new(extent, seed);
            (0..9)
                .map(|visit| itinerary.tile(visit).cell(visit))
                .collect::<Vec<_>>()
        };
        assert_ne!(cells(0), cells(1));
    }
}
