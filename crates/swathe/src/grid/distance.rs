//! The exact Euclidean distance transform: how far every cell is from the nearest marked one.
//!
//! Two passes in whole numbers. Source: Meijster, Roerdink and Hesselink, "A general algorithm for computing distance
//! transforms in linear time", 2000.

use rayon::prelude::*;

use super::{GridGeometry, Layer};

/// What stands for "no marked cell anywhere".
pub const UNREACHED: u64 = u64::MAX;

/// Squared distances, in cells, from the centre of every cell to the centre of the nearest marked one; [`UNREACHED`]
/// everywhere when none is marked.
pub fn squared_distances(geometry: GridGeometry, is_marked: impl Fn(usize) -> bool + Sync) -> Layer<u64> {
    let (rows, columns) = (geometry.rows(), geometry.columns());
    // Rows to the nearest marked cell of the same column: down the map, then up again.
    let mut vertical = vec![u32::MAX; geometry.cell_count()];
    for row in 0..rows {
        let (above, here) = vertical.split_at_mut(row * columns);
        let above = row.checked_sub(1).map(|before| &above[before * columns..]);
        let here = &mut here[..columns];
        for (column, cell) in here.iter_mut().enumerate() {
            *cell = if is_marked(row * columns + column) {
                0
            } else {
                above.map_or(u32::MAX, |above| above[column].saturating_add(1))
            };
        }
    }
    for row in (0..rows.saturating_sub(1)).rev() {
        let (here, below) = vertical.split_at_mut((row + 1) * columns);
        let here = &mut here[row * columns..];
        for (cell, &below) in here.iter_mut().zip(&below[..columns]) {
            *cell = (*cell).min(below.saturating_add(1));
        }
    }
    let mut squared = Layer::filled(geometry, UNREACHED);
    squared
        .data_mut()
        .par_chunks_mut(columns)
        .zip(vertical.par_chunks(columns))
        .for_each_init(Vec::new, |stack, (out, vertical)| row_distances(vertical, stack, out));
    squared
}

/// Lower envelope of the parabolas that stand over the columns of a row. `stack` holds (column, first column where it is
/// the lowest).
fn row_distances(vertical: &[u32], stack: &mut Vec<(usize, usize)>, out: &mut [u64]) {
    let height = |column: usize| i128::from(vertical[column]) * i128::from(vertical[column]);
    let at = |x: usize, column: usize| {
        let away = x as i128 - column as i128;
        away * away + height(column)
    };
    stack.clear();
    for column in (0..vertical.len()).filter(|&column| vertical[column] != u32::MAX) {
        while let Some(&(lowest, from)) = stack.last()
            && at(from, lowest) > at(from, column)
        {
            stack.pop();
        }
        let Some(&(lowest, _)) = stack.last() else {
            stack.push((column, 0));
            continue;
        };
        // The last place where the parabola before is not above this one.
        let (a, b) = (lowest as i128, column as i128);
        let meet = (b * b - a * a + height(column) - height(lowest)).div_euclid(2 * (b - a)) + 1;
        if meet < vertical.len() as i128 {
            stack.push((column, meet as usize));
        }
    }
    for (x, out) in out.iter_mut().enumerate().rev() {
        while stack.last().is_some_and(|&(_, from)| from > x) {
            stack.pop();
        }
        if let Some(&(column, _)) = stack.last() {
            *out = at(x, column) as u64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn distances_are_those_to_the_nearest_of_all_marked_cells(
            rows in 1usize..14, columns in 1usize..14, marks in prop::collection::vec(0u8..12, 196),
        ) {
            let geometry = GridGeometry::new(rows, columns, 3.0, 0.0, 0.0).unwrap();
            let is_marked = |index: usize| marks[index] == 0;
            let found = squared_distances(geometry, is_marked);
            for cell in geometry.cells() {
                let nearest = geometry.cells().filter(|&other| is_marked(geometry.index(other))).map(|other| {
                    let (down, right) = (cell.row.abs_diff(other.row) as u64, cell.column.abs_diff(other.column) as u64);
                    down * down + right * right
                });
                prop_assert_eq!(found[cell], nearest.min().unwrap_or(UNREACHED), "{:?}", cell);
            }
        }
    }

    #[test]
    fn without_a_mark_nothing_is_near() {
        let geometry = GridGeometry::new(2, 3, 1.0, 0.0, 0.0).unwrap();
        assert_eq!(squared_distances(geometry, |_| false).data(), [UNREACHED; 6]);
    }
}
