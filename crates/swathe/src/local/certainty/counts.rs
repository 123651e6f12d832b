//! Evidence of every cell, and where all of it is the same.

use std::ops::Range;

/// Level of a cell that no beam has reached, below every other.
const UNSEEN_LEVEL: i16 = i16::MIN;

/// Cells along the side of a block, as bits.
pub(super) const BLOCK_BITS: u32 = 3;

/// Evidence of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Count {
    pub level: i16,
    /// Number of the last scan that counted for it; beams that cross a surely free cell are not noted.
    pub scan: u16,
}

impl Count {
    const UNSEEN: Self = Self {
        level: UNSEEN_LEVEL,
        scan: 0,
    };

    /// The level to count on from.
    pub fn known_level(self) -> i16 {
        if self.level == UNSEEN_LEVEL { 0 } else { self.level }
    }
}

/// Evidence of the cells of a square whose sides are a power of two.
///
/// Most cells around a robot are as surely free as they can be, and a beam that crosses them changes nothing. So every block of
/// eight by eight cells knows how many of its cells are not.
#[derive(Clone, Debug)]
pub(super) struct Counts {
    cells: Vec<Count>,
    unsure: Vec<u8>,
    /// Bits of a cell's column in its index.
    shift: u32,
    /// Level of a cell that is surely free.
    low: i16,
}

impl Counts {
    /// Cells that nobody has seen; `shift` must not be less than a block has bits.
    pub fn new(shift: u32, low: i16) -> Self {
        let blocks_shift = shift - BLOCK_BITS;
        Self {
            cells: vec![Count::UNSEEN; 1 << (2 * shift)],
            unsure: vec![1 << (2 * BLOCK_BITS); 1 << (2 * blocks_shift)],
            shift,
            low,
        }
    }

    pub fn get(&self, index: usize) -> Count {
        self.cells[index]
    }

    #[inline]
    pub fn set(&mut self, index: usize, count: Count) {
        let before = std::mem::replace(&mut self.cells[index], count);
        let block = self.block(index);
        self.unsure[block] += u8::from(count.level != self.low);
        self.unsure[block] -= u8::from(before.level != self.low);
    }

    /// Forgets cells that follow each other.
    pub fn forget(&mut self, cells: Range<usize>) {
        cells.for_each(|index| self.set(index, Count::UNSEEN));
    }

    /// Forgets which scans counted.
    pub fn forget_scans(&mut self) {
        self.cells.iter_mut().for_each(|count| count.scan = 0);
    }

    /// Whether a cell is as surely free as it can be.
    #[inline]
    pub fn is_free(&self, index: usize) -> bool {
        self.cells[index].level == self.low
    }

    /// Whether all cells of the block in which a cell lies are surely free.
    #[inline]
    pub fn is_block_free(&self, index: usize) -> bool {
        self.unsure[self.block(index)] == 0
    }

    fn block(&self, index: usize) -> usize {
        let column = (index & ((1 << self.shift) - 1)) >> BLOCK_BITS;
        (index >> (self.shift + BLOCK_BITS) << (self.shift - BLOCK_BITS)) | column
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_block_is_free_when_all_its_cells_are(
            low in -500i16..=0, sets in prop::collection::vec((0usize..256, -2i16..3), 0..600),
            forgotten in prop::collection::vec((0usize..256, 0usize..40), 0..3),
        ) {
            let mut counts = Counts::new(4, low);
            for index in 0..256 {
                counts.set(index, Count { level: low, scan: 1 });
            }
            for (index, above) in sets {
                counts.set(index, Count { level: low + above.max(0), scan: 2 });
            }
            for (first, cells) in forgotten {
                counts.forget(first..(first + cells).min(256));
            }
            for index in 0..256 {
                let (row, column) = (index / 16 / 8 * 8, index % 16 / 8 * 8);
                let block = (row..row + 8).flat_map(|row| (column..column + 8).map(move |column| 16 * row + column));
                prop_assert_eq!(counts.is_block_free(index), block.clone().all(|index| counts.is_free(index)));
                prop_assert_eq!(counts.is_free(index), counts.get(index).level == low);
            }
            counts.forget(0..256);
            prop_assert!((0..256).all(|index| counts.get(index).known_level() == 0 && !counts.is_block_free(index)));
        }
    }
}
