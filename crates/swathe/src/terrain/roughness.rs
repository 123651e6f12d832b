//! How rough a cell is once its slope is taken away.

use crate::grid::{Cell, LayerView};

use super::neighbourhood;

/// Unevenness of the 3 x 3 cells around a cell, measured from the plane fitted to them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// Root mean square distance from the plane, in metres.
    pub deviation_m: f64,
    /// Greatest jump between the cell and a neighbour beyond what the plane explains, in metres.
    pub step_m: f64,
}

/// Roughness at a cell, or `None` where its height is unknown.
///
/// The plane is the least-squares fit to the nine heights (its coefficients are the plain means of the differences).
pub fn roughness_at(elevation_m: LayerView<f32>, cell: Cell) -> Option<Roughness> {
    let heights = neighbourhood(elevation_m, cell)?;
    let mean = heights.iter().sum::<f64>() / 9.0;
    let [nw, n, ne, w, centre, e, sw, s, se] = heights;
    let per_column = (ne + e + se - nw - w - sw) / 6.0;
    let per_row = (sw + s + se - nw - n - ne) / 6.0;
    let mut squares = 0.0;
    let mut step_m: f64 = 0.0;
    for (slot, height) in heights.iter().enumerate() {
        let (row, column) = ((slot / 3) as f64 - 1.0, (slot % 3) as f64 - 1.0);
        let tilt = per_row * row + per_column * column;
        squares += (height - mean - tilt).powi(2);
        step_m = step_m.max((height - centre - tilt).abs());
    }
    Some(Roughness {
        deviation_m: (squares / 9.0).sqrt(),
        step_m,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{GridGeometry, Layer};

    fn layer(heights: [f32; 9]) -> Layer<f32> {
        let geometry = GridGeometry::new(3, 3, 1.0, 0.0, 0.0).unwrap();
        Layer::new(geometry, heights.to_vec(), "z").unwrap()
    }

    #[test]
    fn a_tilted_plane_is_smooth_and_a_kerb_is_a_step() {
        let tilted = layer([0.0, 1.0, 2.0, 0.5, 1.5, 2.5, 1.0, 2.0, 3.0]);
        let smooth = roughness_at(tilted.view(), Cell::new(1, 1)).unwrap();
        assert!(smooth.deviation_m < 1e-6 && smooth.step_m < 1e-6);
        let mut spike = tilted;
        spike.data_mut()[4] += 0.3;
        let rough = roughness_at(spike.view(), Cell::new(1, 1)).unwrap();
        approx::assert_relative_eq!(rough.step_m, 0.3, epsilon = 1e-6);
        assert!(rough.deviation_m > 0.09);
    }
}
