//! The opening by 3 x 3 cells in one pass over rows of bits, bands of rows in parallel.

use rayon::prelude::*;

use crate::grid::GridGeometry;

use super::BitRows;

/// Rows of a band: few enough to share among threads, many enough that four rows more are no loss.
pub(super) const BAND_ROWS: usize = 256;

/// The cells that some 3 x 3 block of suitable cells holds; cells beyond the map are not suitable.
///
/// `suitable` writes the bits of a row, all of them, and is asked for the rows beside a band of `band_rows` once more.
pub(super) fn opened(geometry: GridGeometry, band_rows: usize, suitable: impl Fn(usize, &mut [u64]) + Sync) -> BitRows {
    let mut mask = BitRows::empty(geometry);
    let words = mask.words_per_row();
    let rows = geometry.rows();
    mask.words_mut()
        .par_chunks_mut(band_rows * words)
        .enumerate()
        .for_each(|(band, out)| {
            let mut window = Window::new(words);
            let first = band * band_rows;
            // Row r of the opening follows from rows r - 2 to r + 2.
            for row in first.saturating_sub(2)..first + out.len() / words + 2 {
                if row < rows {
                    window.push(|words| suitable(row, words));
                } else {
                    window.push(|words| words.fill(0));
                }
                if let Some(place) = row.checked_sub(first + 2) {
                    window.write(&mut out[place * words..(place + 1) * words]);
                }
            }
        });
    mask
}

/// The last three rows of suitable cells and of cores, each already combined along the row.
struct Window {
    suitable: [Vec<u64>; 3],
    cores: [Vec<u64>; 3],
}

impl Window {
    fn new(words: usize) -> Self {
        let row = || vec![0; words];
        Self {
            suitable: [row(), row(), row()],
            cores: [row(), row(), row()],
        }
    }

    /// Takes the next row of suitable cells, and with it the cores of the row before.
    fn push(&mut self, fill: impl FnOnce(&mut [u64])) {
        self.suitable.rotate_left(1);
        self.cores.rotate_left(1);
        let [north, here, south] = &mut self.suitable;
        fill(south);
        along(south, |west, word, east| west & word & east);
        let cores = &mut self.cores[2];
        for (((core, north), here), south) in cores.iter_mut().zip(north).zip(here).zip(south) {
            *core = *north & *here & *south;
        }
        along(cores, |west, word, east| west | word | east);
    }

    /// Writes the row of the opening two rows behind the last one taken.
    fn write(&self, out: &mut [u64]) {
        let [north, here, south] = &self.cores;
        for (((out, north), here), south) in out.iter_mut().zip(north).zip(here).zip(south) {
            *out = north | here | south;
        }
    }
}

/// Combines each cell of a row with its neighbours to the west and east; beyond the row there are none.
fn along(words: &mut [u64], join: impl Fn(u64, u64, u64) -> u64) {
    let mut west = 0;
    for index in 0..words.len() {
        let word = words[index];
        let east = words.get(index + 1).map_or(0, |next| next << 63);
        words[index] = join(word << 1 | west, word, word >> 1 | east);
        west = word >> 63;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::disc;
    use crate::random::philox;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_opening_is_erosion_then_dilation_whatever_the_bands(
            rows in 1usize..20, columns in 1usize..140, seed: u64, band_rows in 1usize..22,
        ) {
            let geometry = GridGeometry::new(rows, columns, 1.0, 0.0, 0.0).unwrap();
            let suitable = BitRows::from_fn(geometry, |row, column| {
                !philox([row as u32, column as u32, 0, 0], seed)[0].is_multiple_of(11)
            });
            let block = disc(1.5);
            let fused = opened(geometry, band_rows, |row, words| words.copy_from_slice(suitable.row(row)));
            prop_assert_eq!(fused, suitable.eroded(&block, false).dilated(&block));
        }
    }
}
