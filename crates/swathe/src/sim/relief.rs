//! The true surface: heights between cell centres, and where a ray meets it.
//!
//! Heights are bilinear between the centres of cells and level in the outermost half cell. Rays skip over ground below
//! them with a pyramid of greatest heights (maximum mipmaps: Tevs, Ihrke, Seidel, I3D 2008) and are cut exactly with the
//! bilinear patches that remain. A patch with an unknown corner is no surface.

use crate::grid::{GridGeometry, Layer, Position};

/// The true surface of the ground.
#[derive(Clone, Debug)]
pub struct Relief {
    heights: Layer<f32>,
    levels: Vec<Level>,
}

/// Greatest heights of blocks of patches; -inf where there is no surface.
#[derive(Clone, Debug)]
struct Level {
    rows: usize,
    columns: usize,
    greatest_m: Vec<f32>,
}

/// A straight line in space with the range as parameter.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    /// East, north and height of its origin in metres.
    pub(super) origin_m: [f64; 3],
    /// Metres east, north and up per metre.
    pub(super) direction: [f64; 3],
}

/// Metres by which a ray is pushed over the border of a patch.
const NUDGE_M: f64 = 1e-9;

impl Relief {
    /// The surface through the heights of cells; NaN where unknown.
    pub fn new(heights: Layer<f32>) -> Self {
        let levels = pyramid(&heights);
        Self { heights, levels }
    }

    /// Where the cells lie.
    pub fn geometry(&self) -> GridGeometry {
        self.heights.geometry()
    }

    /// Heights of cells in metres.
    pub fn heights(&self) -> &Layer<f32> {
        &self.heights
    }

    /// Height at a position in metres; `None` outside the map and where a cell around it is unknown.
    pub fn height_m(&self, at: Position) -> Option<f64> {
        let geometry = self.geometry();
        geometry.cell_at(at)?;
        let (south, east) = geometry.fractional(at);
        let (v, u) = (south + 0.5, east + 0.5);
        let [a, b, c, d] = self.patch(v.floor() as usize, u.floor() as usize);
        let (fu, fv) = (u.fract(), v.fract());
        let height = a + b * fu + c * fv + d * fu * fv;
        (!height.is_nan()).then_some(height)
    }

    /// Coefficients a + b u + c v + d u v of a patch, with u east and v south in cells. Patch (0, 0) ends at the centre of
    /// cell (0, 0).
    fn patch(&self, row: usize, column: usize) -> [f64; 4] {
        let [nw, ne, sw, se] = corners(&self.heights, row, column).map(f64::from);
        [nw, ne - nw, sw - nw, se - sw - ne + nw]
    }

    /// Range in metres at which a ray first meets the surface, up to `range_max_m`; 0 where it begins below it.
    pub(super) fn hit_m(&self, ray: &Ray, range_max_m: f64) -> Option<f64> {
        let geometry = self.geometry();
        let size_m = geometry.cell_size_m();
        let origin = Position::new(ray.origin_m[0], ray.origin_m[1]);
        let (south, east) = geometry.fractional(origin);
        let (u0, v0, z0) = (east + 0.5, south + 0.5, ray.origin_m[2]);
        let (du, dv, dz) = (ray.direction[0] / size_m, -ray.direction[1] / size_m, ray.direction[2]);
        // The part of the ray over the map, the outer half cells included.
        let (u_end, v_end) = (geometry.columns() as f64 + 0.5, geometry.rows() as f64 + 0.5);
        let (u_in, u_out) = slab(u0, du, 0.5, u_end)?;
        let (v_in, v_out) = slab(v0, dv, 0.5, v_end)?;
        let end = range_max_m.min(u_out).min(v_out);
        let mut t = u_in.max(v_in).max(0.0);
        let top = self.levels.len() - 1;
        let lowest = |from: f64, to: f64| z0 + dz * if dz < 0.0 { to } else { from };
        // Most beams of an upright robot pass above all ground; the top is one block.
        if lowest(t, end) > f64::from(self.levels[top].greatest_m[0]) {
            return None;
        }
        let mut level = top.min(1);
        while t < end {
            let ahead = t + NUDGE_M;
            let (u, v) = (u0 + du * ahead, v0 + dv * ahead);
            let pyramid = &self.levels[level];
            let column = ((u.max(0.0) as usize) >> level).min(pyramid.columns - 1);
            let row = ((v.max(0.0) as usize) >> level).min(pyramid.rows - 1);
            let span = (1usize << level) as f64;
            let exit = border(u0, du, column as f64 * span, span)
                .min(border(v0, dv, row as f64 * span, span))
                .max(ahead);
            let greatest = f64::from(pyramid.greatest_m[row * pyramid.columns + column]);
            if lowest(t, exit.min(end)) > greatest {
                t = exit;
                level = (level + 1).min(top);
            } else if level > 0 {
                level -= 1;
            } else {
                let coefficients = self.patch(row, column);
                let local = [u0 + du * t - column as f64, v0 + dv * t - row as f64, z0 + dz * t];
                if let Some(further) = cut(coefficients, local, [du, dv, dz], exit.min(end) - t) {
                    return Some(t + further);
                }
                t = exit;
            }
        }
        None
    }
}

/// Ranges at which a coordinate enters and leaves `low..high`; `None` when it never does.
fn slab(start: f64, rate: f64, low: f64, high: f64) -> Option<(f64, f64)> {
    if rate == 0.0 {
        return (low..high).contains(&start).then_some((0.0, f64::INFINITY));
    }
    let (a, b) = ((low - start) / rate, (high - start) / rate);
    Some((a.min(b), a.max(b)))
}

/// Range at which a coordinate leaves the block from `low` on.
fn border(start: f64, rate: f64, low: f64, span: f64) -> f64 {
    if rate == 0.0 {
        f64::INFINITY
    } else {
        (if rate > 0.0 { low + span - start } else { low - start }) / rate
    }
}

/// Smallest t in 0..=end at which z + dz t is not above the patch.
fn cut([a, b, c, d]: [f64; 4], [u, v, z]: [f64; 3], [du, dv, dz]: [f64; 3], end: f64) -> Option<f64> {
    // Height above the patch as square t² + linear t + constant.
    let constant = z - (a + b * u + c * v + d * u * v);
    if constant.is_nan() {
        return None;
    }
    if constant <= 0.0 {
        return Some(0.0);
    }
    let linear = dz - (b * du + c * dv + d * (u * dv + v * du));
    let square = -d * du * dv;
    let discriminant = linear * linear - 4.0 * square * constant;
    if discriminant < 0.0 {
        return None;
    }
    // The form that does not cancel: one root is q / square, the other constant / q.
    let q = -0.5 * (linear + discriminant.sqrt().copysign(linear));
    let roots = [constant / q, if square == 0.0 { f64::NAN } else { q / square }];
    let inside = roots.into_iter().filter(|root| (0.0..=end).contains(root));
    inside.min_by(f64::total_cmp)
}

/// Heights at the corners of a patch (north-west, north-east, south-west, south-east), level beyond the outer centres.
fn corners(heights: &Layer<f32>, row: usize, column: usize) -> [f32; 4] {
    let geometry = heights.geometry();
    let (last_row, last_column) = (geometry.rows() - 1, geometry.columns() - 1);
    let (north, south) = (row.saturating_sub(1).min(last_row), row.min(last_row));
    let (west, east) = (column.saturating_sub(1).min(last_column), column.min(last_column));
    let at = |row: usize, column: usize| heights.data()[row * (last_column + 1) + column];
    [at(north, west), at(north, east), at(south, west), at(south, east)]
}

fn pyramid(heights: &Layer<f32>) -> Vec<Level> {
    let geometry = heights.geometry();
    let (rows, columns) = (geometry.rows() + 1, geometry.columns() + 1);
    let mut greatest_m = Vec::with_capacity(rows * columns);
    for row in 0..rows {
        for column in 0..columns {
            let found = corners(heights, row, column);
            let unknown = found.iter().any(|height| height.is_nan());
            let greatest = found.into_iter().fold(f32::NEG_INFINITY, f32::max);
            greatest_m.push(if unknown { f32::NEG_INFINITY } else { greatest });
        }
    }
    let mut levels = vec![Level {
        rows,
        columns,
        greatest_m,
    }];
    while let Some(finer) = levels.last().filter(|level| level.rows > 1 || level.columns > 1) {
        let (rows, columns) = (finer.rows.div_ceil(2), finer.columns.div_ceil(2));
        let mut greatest_m = vec![f32::NEG_INFINITY; rows * columns];
        for row in 0..finer.rows {
            for column in 0..finer.columns {
                let greatest = &mut greatest_m[row / 2 * columns + column / 2];
                *greatest = greatest.max(finer.greatest_m[row * finer.columns + column]);
            }
        }
        levels.push(Level {
            rows,
            columns,
            greatest_m,
        });
    }
    levels
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn relief(rows: usize, columns: usize, heights: Vec<f32>) -> Relief {
        let geometry = GridGeometry::new(rows, columns, 0.5, -2.0, 5.0).unwrap();
        Relief::new(Layer::new(geometry, heights, "heights").unwrap())
    }

    #[test]
    fn heights_are_those_of_cells_at_their_centres_and_linear_between() {
        let ground = relief(2, 2, vec![1.0, 3.0, 5.0, f32::NAN]);
        let centre = |row, column| ground.geometry().centre(crate::grid::Cell::new(row, column));
        assert_eq!(ground.height_m(Position::new(-1.99, 4.99)), Some(1.0));
        assert_eq!(ground.height_m(centre(0, 0).towards(centre(1, 1), 0.5)), None);
        assert_eq!(ground.height_m(Position::new(9.0, 4.0)), None);
        assert_eq!(ground.height_m(Position::new(f64::NAN, 4.0)), None);
        let plain = relief(1, 2, vec![1.0, 3.0]);
        assert_eq!(
            plain.height_m(plain.geometry().centre(crate::grid::Cell::new(0, 1))),
            Some(3.0)
        );
        assert_eq!(plain.height_m(Position::new(-1.5, 4.75)), Some(2.0));
    }

    #[test]
    fn a_ray_meets_level_ground_where_geometry_says() {
        let ground = relief(40, 40, vec![2.0; 1600]);
        let down = 0.1f64.atan();
        let ray = Ray {
            origin_m: [0.0, 0.0, 2.5],
            direction: [down.cos(), 0.0, -down.sin()],
        };
        let range_m = ground.hit_m(&ray, 80.0).unwrap();
        approx::assert_relative_eq!(range_m, 0.5 / down.sin(), epsilon = 1e-9);
        assert_eq!(ground.hit_m(&ray, 4.9), None);
    }

    proptest! {
        #[test]
        fn hits_agree_with_a_fine_march(
            heights in prop::collection::vec(prop_oneof![9 => -1.0f32..1.0, 1 => Just(f32::NAN)], 12 * 9),
            x in -3.0f64..4.0, y in -2.0f64..6.0, z in -1.0f64..3.0,
            heading in -4.0f64..4.0, elevation in -1.2f64..0.4,
        ) {
            let ground = relief(12, 9, heights);
            let (sin, cos) = elevation.sin_cos();
            let ray = Ray { origin_m: [x, y, z], direction: [cos * heading.cos(), cos * heading.sin(), sin] };
            let range_max_m = 8.0;
            let hit = ground.hit_m(&ray, range_max_m);
            let above = |t: f64| {
                let at = Position::new(x + ray.direction[0] * t, y + ray.direction[1] * t);
                ground.height_m(at).map(|height| z + sin * t - height)
            };
            let step = 0.001;
            let until = hit.unwrap_or(range_max_m);
            for n in 0..(until / step) as usize {
                let t = n as f64 * step;
                // Nothing before the hit lies clearly below the surface.
                prop_assert!(t > until - 0.002 || above(t).is_none_or(|gap| gap > -1e-6), "{t} of {until}");
            }
            if let Some(t) = hit {
                let near: Vec<f64> = [t - 1e-7, t, t + 1e-7].into_iter().filter_map(above).collect();
                prop_assert!(near.iter().any(|gap| *gap < 1e-5), "{t}: {near:?}");
            }
        }
    }
}
