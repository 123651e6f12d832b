//! Horn's gradient, and the headings that a slope leaves open.

use crate::grid::{Cell, Layer, LayerView, SIXTEEN};

use super::TerrainError;

/// Slope of the ground: rise over run to the east and to the north.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gradient {
    /// Rise over run to the east.
    pub east: f64,
    /// Rise over run to the north.
    pub north: f64,
}

impl Gradient {
    /// Rise over run along the fall line.
    pub fn slope(self) -> f64 {
        self.east.hypot(self.north)
    }

    /// Rise over run when heading along the unit vector (`east`, `north`): the pitch.
    pub fn along(self, east: f64, north: f64) -> f64 {
        self.east * east + self.north * north
    }

    /// Rise over run to the left of that heading: the roll.
    pub fn across(self, east: f64, north: f64) -> f64 {
        self.north * east - self.east * north
    }
}

/// The 3 x 3 heights around a cell, row by row from the north-west, or `None` where its own height is unknown.
///
/// Beyond the map's edge heights continue the line of the two next cells inward, as `gdaldem -compute_edges` does. A
/// neighbour that is unknown continues the line or plane of those that are known.
pub fn neighbourhood(elevation_m: LayerView<f32>, cell: Cell) -> Option<[f64; 9]> {
    let geometry = elevation_m.geometry();
    let centre = f64::from(elevation_m[cell]);
    if !centre.is_finite() {
        return None;
    }
    let at = |rows: i32, columns: i32| -> Option<f64> {
        geometry
            .offset(cell, rows, columns)
            .map(|near| f64::from(elevation_m[near]))
    };
    let row_line = |rows: i32, columns: i32| -> Option<f64> {
        at(rows, columns).or_else(|| Some(2.0 * at(0, columns)? - at(-rows, columns)?))
    };
    let mut heights = [centre; 9];
    for (slot, height) in heights.iter_mut().enumerate() {
        let (rows, columns) = (slot as i32 / 3 - 1, slot as i32 % 3 - 1);
        if (rows, columns) != (0, 0) {
            *height = row_line(rows, columns)
                .or_else(|| Some(2.0 * row_line(rows, 0)? - row_line(rows, -columns)?))
                .unwrap_or(f64::NAN);
        }
    }
    if heights.iter().any(|height| !height.is_finite()) {
        complete(&mut heights);
    }
    Some(heights)
}

/// Fills unknown heights so that a plane stays a plane: from the opposite neighbour through the centre, else from the
/// plane through the centre and two known neighbours beside it, else the centre's height.
fn complete(heights: &mut [f64; 9]) {
    /// The slots of the ring around the centre, clockwise from the north-west.
    const RING: [usize; 8] = [0, 1, 2, 5, 8, 7, 6, 3];
    let centre = heights[4];
    let fill = |heights: &mut [f64; 9], guess: &dyn Fn(&[f64; 9], usize) -> f64| {
        let known = *heights;
        for place in 0..8 {
            if !known[RING[place]].is_finite() {
                heights[RING[place]] = guess(&known, place);
            }
        }
    };
    let ring = |known: &[f64; 9], place: usize| known[RING[place % 8]];
    fill(heights, &|known, place| 2.0 * centre - ring(known, place + 4));
    fill(heights, &|known, place| {
        let beside = |a: usize, b: usize| {
            if place % 2 == 0 {
                // A corner is the sum of the two edges beside it.
                ring(known, place + a) + ring(known, place + b) - centre
            } else {
                // An edge is the corner beside it less the next edge.
                ring(known, place + a) - ring(known, place + 2 * a) + centre
            }
        };
        let (first, second) = (beside(1, 7), beside(7, 1));
        if first.is_finite() { first } else { second }
    });
    fill(heights, &|_, _| centre);
}

/// Horn's gradient at a cell, or `None` where its height is unknown.
///
/// Source: Horn, "Hill shading and the reflectance map", Proc. IEEE 69 (1981); the weights 1, 2, 1.
pub fn gradient_at(elevation_m: LayerView<f32>, cell: Cell) -> Option<Gradient> {
    let [nw, n, ne, w, _, e, sw, s, se] = neighbourhood(elevation_m, cell)?;
    let run = 8.0 * elevation_m.geometry().cell_size_m();
    Some(Gradient {
        east: ((ne + 2.0 * e + se) - (nw + 2.0 * w + sw)) / run,
        north: ((nw + 2.0 * n + ne) - (sw + 2.0 * s + se)) / run,
    })
}

/// Slope of every cell as rise over run; NaN where the height is unknown.
///
/// # Errors
/// None today; the signature leaves room for a request to stop.
pub fn slope(elevation_m: LayerView<f32>) -> Result<Layer<f32>, TerrainError> {
    map_gradient(elevation_m, Gradient::slope)
}

/// Downhill direction of every cell, counter-clockwise from east; NaN where it is flat or unknown.
///
/// # Errors
/// None today; the signature leaves room for a request to stop.
pub fn aspect_rad(elevation_m: LayerView<f32>) -> Result<Layer<f32>, TerrainError> {
    map_gradient(elevation_m, |gradient| {
        if gradient.slope() == 0.0 {
            f64::NAN
        } else {
            (-gradient.north).atan2(-gradient.east)
        }
    })
}

fn map_gradient(elevation_m: LayerView<f32>, value: impl Fn(Gradient) -> f64) -> Result<Layer<f32>, TerrainError> {
    let geometry = elevation_m.geometry();
    let data = geometry
        .cells()
        .map(|cell| gradient_at(elevation_m, cell).map_or(f32::NAN, |g| value(g) as f32))
        .collect();
    Ok(Layer::new(geometry, data, "the result")?)
}

/// Unit vectors (east, north) of the 16 directions of [`SIXTEEN`].
pub static HEADINGS: std::sync::LazyLock<[(f64, f64); 16]> = std::sync::LazyLock::new(|| {
    SIXTEEN.map(|step| {
        let length = step.length_cells();
        (f64::from(step.columns) / length, f64::from(-step.rows) / length)
    })
});

/// The directions of [`SIXTEEN`] whose pitch stays within -`grade_down` .. `grade_up` and whose roll stays within
/// `side_slope`, as a bit set (bit k = direction k).
pub fn allowed_headings(gradient: Gradient, grade_up: f64, grade_down: f64, side_slope: f64) -> u16 {
    let slope = gradient.slope();
    if slope <= grade_up.min(grade_down).min(side_slope) {
        return u16::MAX;
    }
    let mut allowed = 0;
    for (k, &(east, north)) in HEADINGS.iter().enumerate() {
        let pitch = gradient.along(east, north);
        if pitch <= grade_up && pitch >= -grade_down && gradient.across(east, north).abs() <= side_slope {
            allowed |= 1 << k;
        }
    }
    allowed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::GridGeometry;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    fn plane(rows: usize, columns: usize, east: f64, north: f64) -> Layer<f32> {
        let geometry = GridGeometry::new(rows, columns, 2.0, 0.0, 0.0).unwrap();
        let data = geometry
            .cells()
            .map(|cell| {
                let p = geometry.centre(cell);
                (east * p.x_m + north * p.y_m) as f32
            })
            .collect();
        Layer::new(geometry, data, "plane").unwrap()
    }

    proptest! {
        #[test]
        fn a_plane_has_its_own_gradient_everywhere_up_to_the_edge(
            rows in 2usize..7, columns in 2usize..7, east in -2.0f64..2.0, north in -2.0f64..2.0,
        ) {
            let layer = plane(rows, columns, east, north);
            for cell in layer.geometry().cells() {
                let gradient = gradient_at(layer.view(), cell).unwrap();
                prop_assert!((gradient.east - east).abs() < 1e-5, "{cell:?} {gradient:?}");
                prop_assert!((gradient.north - north).abs() < 1e-5, "{cell:?} {gradient:?}");
            }
        }

        #[test]
        fn a_void_beside_a_plane_does_not_bend_it(hole in 0usize..25, east in -1.0f64..1.0) {
            let mut layer = plane(5, 5, east, 0.5);
            layer.data_mut()[hole] = f32::NAN;
            for cell in layer.geometry().cells() {
                match gradient_at(layer.view(), cell) {
                    None => prop_assert_eq!(layer.geometry().index(cell), hole),
                    Some(gradient) => prop_assert!((gradient.east - east).abs() < 1e-5),
                }
            }
        }

        #[test]
        fn headings_shrink_as_the_slope_grows(
            angle in 0.0f64..std::f64::consts::TAU, slope in 0.0f64..0.6, up in 0.1f64..0.4, side in 0.1f64..0.4,
        ) {
            let gradient = |slope: f64| Gradient { east: slope * angle.cos(), north: slope * angle.sin() };
            let gentle = allowed_headings(gradient(slope), up, up, side);
            let steep = allowed_headings(gradient(slope * 1.1), up, up, side);
            prop_assert_eq!(steep & !gentle, 0);
            // What may be driven up may be driven down when both limits are equal.
            prop_assert_eq!(gentle.rotate_left(8), gentle);
        }
    }

    #[test]
    fn aspect_points_downhill() {
        let downhill_to_west = plane(3, 3, 0.2, 0.0);
        let aspect = aspect_rad(downhill_to_west.view()).unwrap();
        assert_relative_eq!(aspect.data()[4].abs(), std::f32::consts::PI, epsilon = 1e-4);
    }

    #[test]
    fn one_cell_is_flat_and_a_void_is_unknown() {
        let geometry = GridGeometry::new(1, 1, 2.0, 0.0, 0.0).unwrap();
        let single = Layer::new(geometry, vec![7.0], "z").unwrap();
        assert_eq!(slope(single.view()).unwrap().data(), [0.0]);
        let void = Layer::new(geometry, vec![f32::NAN], "z").unwrap();
        assert!(slope(void.view()).unwrap().data()[0].is_nan());
    }
}
