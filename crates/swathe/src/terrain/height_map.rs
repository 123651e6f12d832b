//! The paper's height map: grey levels 0-255, averaged by groups of 8 pixels, differenced in eight directions.
//!
//! Source: Vckay, Aneja and Deodhare. The text fixes the grey range and the group of 8; which group is our reading
//! (8 x 8 keeps cells square; 2 x 4 is the literal count).

use crate::grid::{Cell, GridGeometry, Layer, LayerView, Step};

use super::TerrainError;

/// Which pixels are averaged into one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grouping {
    /// 8 x 8 pixels.
    Square8,
    /// 2 rows x 4 columns; only for tables and figures, since its cells are not square.
    Rows2Columns4,
    /// No averaging.
    None,
}

impl Grouping {
    /// (rows, columns) of a group.
    pub fn size(self) -> (usize, usize) {
        match self {
            Self::Square8 => (8, 8),
            Self::Rows2Columns4 => (2, 4),
            Self::None => (1, 1),
        }
    }
}

/// Grey levels 0 (lowest) to 255 (highest), rounded half away from zero; `None` where the height is unknown.
///
/// `range_m` is what black and white stand for; the least and greatest known height when not given.
///
/// # Errors
/// [`TerrainError::AllVoid`] without a known height, [`TerrainError::HeightRange`] for a range that is not one.
pub fn height_map(elevation_m: LayerView<f32>, range_m: Option<(f64, f64)>) -> Result<Layer<Option<u8>>, TerrainError> {
    let (low, high) = match range_m {
        Some((low, high)) if low.is_finite() && high.is_finite() && low < high => (low, high),
        Some((low, high)) => return Err(TerrainError::HeightRange { low, high }),
        None => known_range(elevation_m).ok_or(TerrainError::AllVoid)?,
    };
    // A level plain is black, not a division by zero.
    let span_m = if high > low { high - low } else { f64::INFINITY };
    let data = elevation_m
        .data()
        .iter()
        .map(|&height| {
            height
                .is_finite()
                .then(|| ((f64::from(height) - low) * 255.0 / span_m).clamp(0.0, 255.0).round() as u8)
        })
        .collect();
    Ok(Layer::new(elevation_m.geometry(), data, "the height map")?)
}

fn known_range(elevation_m: LayerView<f32>) -> Option<(f64, f64)> {
    let known = elevation_m.data().iter().filter(|height| height.is_finite());
    known.fold(None, |range, &height| {
        let height = f64::from(height);
        let (low, high) = range.unwrap_or((height, height));
        Some((low.min(height), high.max(height)))
    })
}

/// Means of groups of cells; a group with any unknown cell is unknown, so that voids never count as ground.
///
/// Groups are counted from the north-west corner; an incomplete group at the south or east edge is left out unless
/// the grid is smaller than one group, which then is one cell. The result keeps the north-west corner and is on cells
/// of the group's height (for [`Grouping::Rows2Columns4`], whose cells are not square, it is the group's row count).
///
/// # Errors
/// [`TerrainError::Grid`] when the result has no geometry.
pub fn group_mean(values: LayerView<f32>, grouping: Grouping) -> Result<Layer<f32>, TerrainError> {
    group(values, grouping, |sum, count, _| (sum / count as f64) as f32)
}

/// Greatest value of each group; unknown cells are passed over.
///
/// # Errors
/// [`TerrainError::Grid`] when the result has no geometry.
pub fn block_max(values: LayerView<f32>, grouping: Grouping) -> Result<Layer<f32>, TerrainError> {
    group(values, grouping, |_, _, greatest| greatest)
}

fn group(
    values: LayerView<f32>,
    grouping: Grouping,
    value: impl Fn(f64, usize, f32) -> f32,
) -> Result<Layer<f32>, TerrainError> {
    let from = values.geometry();
    let (tall, wide) = grouping.size();
    let (tall, wide) = (tall.min(from.rows()), wide.min(from.columns()));
    let geometry = GridGeometry::new(
        from.rows() / tall,
        from.columns() / wide,
        from.cell_size_m() * tall as f64,
        from.west_m(),
        from.north_m(),
    )?;
    let data = geometry
        .cells()
        .map(|cell| {
            let (mut sum, mut greatest) = (0.0, f32::NAN);
            for row in cell.row * tall..(cell.row + 1) * tall {
                for &height in &values.row(row)[cell.column * wide..(cell.column + 1) * wide] {
                    sum += f64::from(height);
                    greatest = greatest.max(height);
                }
            }
            value(sum, tall * wide, greatest)
        })
        .collect();
    Ok(Layer::new(geometry, data, "the groups")?)
}

/// Height differences to the neighbour one `step` away; NaN where either is unknown or outside.
pub fn directional_difference(values: LayerView<f32>, step: Step) -> Layer<f32> {
    let geometry = values.geometry();
    let mut out = Layer::filled(geometry, f32::NAN);
    for cell in geometry.cells() {
        if let Some(near) = step.from(&geometry, cell) {
            out[cell] = values[near] - values[cell];
        }
    }
    out
}

/// The greatest absolute difference to the neighbours in `steps`, each divided by its distance in cells so that a
/// diagonal counts per metre; `None` where the cell or all those neighbours are unknown.
pub fn worst_difference(values: LayerView<f32>, cell: Cell, steps: &[Step]) -> Option<f64> {
    let geometry = values.geometry();
    let here = f64::from(values[cell]);
    steps
        .iter()
        .filter_map(|step| {
            let near = f64::from(values[step.from(&geometry, cell)?]);
            let difference = (near - here).abs() / step.length_cells();
            difference.is_finite().then_some(difference)
        })
        .reduce(f64::max)
        // One cell alone has no difference: it is level where it is known.
        .or_else(|| (here.is_finite() && geometry.cell_count() == 1).then_some(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::EIGHT;
    use proptest::prelude::*;

    fn layer(rows: usize, columns: usize, data: Vec<f32>) -> Layer<f32> {
        let geometry = GridGeometry::new(rows, columns, 30.0, 0.0, 0.0).unwrap();
        Layer::new(geometry, data, "z").unwrap()
    }

    #[test]
    fn black_is_lowest_and_white_is_highest() {
        let grey = height_map(layer(1, 4, vec![100.0, 300.0, f32::NAN, 200.0]).view(), None).unwrap();
        assert_eq!(grey.data(), [Some(0), Some(255), None, Some(128)]);
        let plain = height_map(layer(1, 2, vec![5.0, 5.0]).view(), None).unwrap();
        assert_eq!(plain.data(), [Some(0), Some(0)]);
        let void = height_map(layer(1, 1, vec![f32::NAN]).view(), None);
        assert_eq!(void.unwrap_err(), TerrainError::AllVoid);
    }

    #[test]
    fn groups_of_eight_are_means_and_voids_stay_unknown() {
        let mut data: Vec<f32> = (0..16 * 17).map(|i| (i % 17) as f32).collect();
        data[3] = f32::NAN;
        let mean = group_mean(layer(16, 17, data.clone()).view(), Grouping::Square8).unwrap();
        assert_eq!((mean.geometry().rows(), mean.geometry().columns()), (2, 2));
        assert_eq!(mean.geometry().cell_size_m(), 240.0);
        assert!(mean.data()[0].is_nan());
        assert_eq!(mean.data()[1..], [11.5, 3.5, 11.5]);
        let literal = group_mean(layer(16, 17, data).view(), Grouping::Rows2Columns4).unwrap();
        assert_eq!((literal.geometry().rows(), literal.geometry().columns()), (8, 4));
    }

    #[test]
    fn differences_are_signed_and_worst_counts_diagonals_per_metre() {
        let heights = layer(3, 3, vec![0.0, 0.0, 14.142_136, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0]);
        let east = directional_difference(heights.view(), crate::grid::FOUR[0]);
        assert_eq!(east.data()[4], 9.0);
        assert_eq!(east.data()[1], 14.142_136);
        assert!(east.data()[2].is_nan());
        let worst = worst_difference(heights.view(), Cell::new(1, 1), &EIGHT).unwrap();
        approx::assert_relative_eq!(worst, 10.0, epsilon = 1e-6);
    }

    proptest! {
        #[test]
        fn differences_there_and_back_cancel(data in prop::collection::vec(-50.0f32..50.0, 20)) {
            let heights = layer(4, 5, data);
            for k in 0..8 {
                let there = directional_difference(heights.view(), EIGHT[k]);
                let back = directional_difference(heights.view(), EIGHT[(k + 4) % 8]);
                for cell in heights.geometry().cells() {
                    if let Some(near) = EIGHT[k].from(&heights.geometry(), cell) {
                        prop_assert_eq!(there[cell], -back[near]);
                    }
                }
            }
        }
    }
}
