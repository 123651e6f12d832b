//! Masks as rows of bits, 64 cells a word: erosion and dilation by any vicinity.

use rayon::prelude::*;

use crate::grid::{Cell, GridGeometry, Step};

/// A mask of cells, one bit each.
#[derive(Clone, Debug, PartialEq)]
pub struct BitRows {
    geometry: GridGeometry,
    columns: usize,
    words: usize,
    data: Vec<u64>,
}

impl BitRows {
    /// A mask from a predicate on (row, column), rows in parallel.
    pub fn from_fn(geometry: GridGeometry, holds: impl Fn(usize, usize) -> bool + Sync) -> Self {
        let mut mask = Self::empty(geometry);
        let columns = mask.columns;
        mask.data
            .par_chunks_mut(mask.words)
            .enumerate()
            .for_each(|(row, words)| {
                for (index, word) in words.iter_mut().enumerate() {
                    let first = index * 64;
                    for bit in 0..64.min(columns - first) {
                        *word |= u64::from(holds(row, first + bit)) << bit;
                    }
                }
            });
        mask
    }

    /// The cells whose byte, after `byte`, is at least `least` (both below 128, `least` above 0).
    pub fn at_least<T: Sync>(geometry: GridGeometry, cells: &[T], least: u8, byte: impl Fn(&T) -> u8 + Sync) -> Self {
        let mut mask = Self::empty(geometry);
        let columns = mask.columns;
        mask.data
            .par_chunks_mut(mask.words)
            .zip(cells.par_chunks(columns))
            .for_each(|(words, cells)| pack_at_least(cells, least, &byte, words));
        mask
    }

    /// A mask of no cell.
    pub fn empty(geometry: GridGeometry) -> Self {
        let words = geometry.columns().div_ceil(64);
        Self {
            geometry,
            columns: geometry.columns(),
            words,
            data: vec![0; words * geometry.rows()],
        }
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.geometry.rows()
    }

    /// The geometry of the cells.
    pub fn geometry(&self) -> GridGeometry {
        self.geometry
    }

    /// The words of a row; bits beyond the last column are zero.
    pub fn row(&self, row: usize) -> &[u64] {
        &self.data[row * self.words..(row + 1) * self.words]
    }

    /// Whether a cell is in the mask.
    pub fn get(&self, cell: Cell) -> bool {
        self.row(cell.row)[cell.column / 64] >> (cell.column % 64) & 1 == 1
    }

    /// Number of cells in the mask.
    pub fn count(&self) -> u64 {
        self.data.iter().map(|word| u64::from(word.count_ones())).sum()
    }

    /// Keeps only the cells that are in `other` too, a mask of the same geometry.
    pub fn keep(&mut self, other: &Self) {
        for (word, other) in self.data.iter_mut().zip(&other.data) {
            *word &= other;
        }
    }

    /// Adds the cells that are not in `other`, a mask of the same geometry.
    pub fn add_missing(&mut self, other: &Self) {
        let tail = self.tail();
        for (row, other) in self.data.chunks_mut(self.words).zip(other.data.chunks(self.words)) {
            for (word, other) in row.iter_mut().zip(other) {
                *word |= !other;
            }
            row[self.words - 1] &= tail;
        }
    }

    /// The bits of a row's last word that are cells.
    fn tail(&self) -> u64 {
        u64::MAX >> (self.words * 64 - self.columns)
    }

    /// The cells all of whose `steps` lead to a cell of the mask; `border` stands for cells beyond the grid.
    #[must_use]
    pub fn eroded(&self, steps: &[Step], border: bool) -> Self {
        self.combined(steps, border, u64::MAX, |all, word| all & word)
    }

    /// The cells some of whose `steps` lead to a cell of the mask.
    #[must_use]
    pub fn dilated(&self, steps: &[Step]) -> Self {
        self.combined(steps, false, 0, |any, word| any | word)
    }

    fn combined(&self, steps: &[Step], border: bool, start: u64, join: impl Fn(u64, u64) -> u64 + Sync) -> Self {
        let beyond = if border { u64::MAX } else { 0 };
        let tail = self.tail();
        let mut out = Self {
            data: vec![start; self.data.len()],
            ..*self
        };
        out.data
            .par_chunks_mut(self.words)
            .enumerate()
            .for_each(|(row, words)| {
                for step in steps {
                    let source = row as i64 + i64::from(step.rows);
                    if !(0..self.rows() as i64).contains(&source) {
                        for word in words.iter_mut() {
                            *word = join(*word, beyond);
                        }
                        continue;
                    }
                    let source = self.row(source as usize);
                    // Bits beyond the last column take the border's value too.
                    let at = |index: i64| -> u64 {
                        if !(0..self.words as i64).contains(&index) {
                            return beyond;
                        }
                        let word = source[index as usize];
                        if index as usize == self.words - 1 {
                            word | (beyond & !tail)
                        } else {
                            word
                        }
                    };
                    let shift = i64::from(step.columns);
                    let (whole, bits) = (shift.div_euclid(64), shift.rem_euclid(64) as u32);
                    for (index, word) in words.iter_mut().enumerate() {
                        let low = at(index as i64 + whole);
                        let shifted = if bits == 0 {
                            low
                        } else {
                            low >> bits | at(index as i64 + whole + 1) << (64 - bits)
                        };
                        *word = join(*word, shifted);
                    }
                }
                words[self.words - 1] &= tail;
            });
        out
    }

    /// Calls `visit` with the half-open column range of each run of set bits in a row, from the west.
    pub fn runs(&self, row: usize, visit: impl FnMut(usize, usize)) {
        runs_of(self.row(row), self.columns, visit);
    }

    /// The words of all rows, to be changed; bits beyond the last column must stay zero.
    pub(super) fn words_mut(&mut self) -> &mut [u64] {
        &mut self.data
    }

    /// Words of a row.
    pub fn words_per_row(&self) -> usize {
        self.words
    }
}

/// Writes one bit for each cell whose byte is at least `least`, eight cells at a time.
pub(crate) fn pack_at_least<T>(cells: &[T], least: u8, byte: impl Fn(&T) -> u8, words: &mut [u64]) {
    const HIGH: u64 = 0x8080_8080_8080_8080;
    // Adding this to a byte below 128 sets its high bit exactly when the byte is at least `least`.
    let lift = u64::from_ne_bytes([0x80 - least; 8]);
    let pack = |cells: &[T]| {
        let mut bytes = [0; 8];
        for (to, from) in bytes.iter_mut().zip(cells) {
            *to = byte(from);
        }
        let lifted = (u64::from_le_bytes(bytes) + lift) & HIGH;
        // The product gathers the eight high bits in its top byte, in order.
        (lifted >> 7).wrapping_mul(0x0102_0408_1020_4080) >> 56
    };
    for (word, cells) in words.iter_mut().zip(cells.chunks(64)) {
        *word = 0;
        if let Ok(whole) = <&[T; 64]>::try_from(cells) {
            for place in 0..8 {
                *word |= pack(&whole[8 * place..8 * place + 8]) << (8 * place);
            }
        } else {
            for (place, eight) in cells.chunks(8).enumerate() {
                *word |= pack(eight) << (8 * place);
            }
        }
    }
}

/// Calls `visit` with the half-open column range of each run of set bits in a row of words.
#[inline]
pub(super) fn runs_of(words: &[u64], columns: usize, mut visit: impl FnMut(usize, usize)) {
    let (mut before, mut from) = (0, None);
    for (index, &word) in words.iter().enumerate() {
        // A bit wherever a cell differs from the one to its west.
        let mut edges = word ^ (word << 1 | before);
        before = word >> 63;
        while edges != 0 {
            let column = index * 64 + edges.trailing_zeros() as usize;
            edges &= edges - 1;
            from = match from {
                None => Some(column),
                Some(from) => {
                    visit(from, column);
                    None
                }
            };
        }
    }
    if let Some(from) = from {
        visit(from, columns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::disc;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn erosion_dilation_and_runs_are_what_they_say(
            columns in 1usize..140, seed: u64, radius in 0.0f64..3.0, border: bool,
        ) {
            let geometry = GridGeometry::new(6, columns, 1.0, 0.0, 0.0).unwrap();
            let holds = |row: usize, column: usize| {
                !crate::random::philox([row as u32, column as u32, 0, 0], seed)[0].is_multiple_of(5)
            };
            let mask = BitRows::from_fn(geometry, holds);
            let steps = disc(radius);
            let (eroded, dilated) = (mask.eroded(&steps, border), mask.dilated(&steps));
            for cell in geometry.cells() {
                prop_assert_eq!(mask.get(cell), holds(cell.row, cell.column));
                let near = |default| steps.iter().map(move |s| s.from(&geometry, cell)).map(move |c| {
                    c.map_or(default, |c| holds(c.row, c.column))
                });
                prop_assert_eq!(eroded.get(cell), near(border).all(|set| set));
                prop_assert_eq!(dilated.get(cell), near(false).any(|set| set));
            }
            let bytes: Vec<u8> = geometry.cells().map(|cell| (cell.row * 31 + cell.column * 7) as u8 % 128).collect();
            let least = (seed % 127) as u8 + 1;
            let high = BitRows::at_least(geometry, &bytes, least, |byte| *byte);
            for (cell, byte) in geometry.cells().zip(&bytes) {
                prop_assert_eq!(high.get(cell), *byte >= least);
            }
            let mut total = 0;
            for row in 0..6 {
                mask.runs(row, |from, to| total += (to - from) as u64);
            }
            prop_assert_eq!(total, mask.count());
        }
    }
}
