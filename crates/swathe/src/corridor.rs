//! The arc from start to goal and the swathe of cells around it, in which everything after happens.
//!
//! The paper lays an arc and a wide swathe; figures are ours: a width of a quarter of the distance, doubled whenever start
//! and goal do not connect inside, until the swathe is the whole map.

use rayon::prelude::*;
use thiserror::Error;

use crate::grid::{GridGeometry, Layer, Position};

/// Width of a swathe over the distance from start to goal.
const WIDTH_SHARE: f64 = 0.25;

/// Least width in cells.
const LEAST_WIDTH_CELLS: f64 = 20.0;

/// Sagitta of the circular arc over the distance, where none is given.
pub const SAGITTA_SHARE: f64 = 0.1;

/// What can be wrong with a corridor request.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum CorridorError {
    /// The width or sagitta is not usable.
    #[error("The swathe's {name} of {given} m is not usable: {allowed}.")]
    Length {
        /// Which one.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

/// How the arc is laid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ArcKind {
    /// A straight line.
    Line,
    /// A circular arc, as in the paper. The sagitta in metres is the arc's height over the middle of the chord, positive
    /// to the left of the way to the goal; a tenth of the distance where none is given.
    Circle {
        /// Height over the chord.
        sagitta_m: Option<f64>,
    },
    /// The way that a search on coarse terrain finds, laid by the caller.
    Spine,
    /// The cheapest way over what is known so far and may still be ground, laid anew whenever more is known.
    Relaid,
}

/// An arc and the width of the swathe around it.
#[derive(Clone, Debug, PartialEq)]
pub struct Corridor {
    arc: Vec<Position>,
    width_m: f64,
    sagitta_m: Option<f64>,
}

impl Corridor {
    /// Lays an arc from `start` to `goal` on a grid. `lay` is the search behind [`ArcKind::Spine`]: it returns the way's
    /// points, or `None` when there is none, which leaves a straight line.
    ///
    /// # Errors
    /// [`CorridorError::Length`] for a width that is not above zero or a sagitta that is not finite.
    pub fn lay(
        geometry: GridGeometry,
        start: Position,
        goal: Position,
        kind: ArcKind,
        width_m: Option<f64>,
        lay: impl FnOnce() -> Option<Vec<Position>>,
    ) -> Result<Self, CorridorError> {
        let distance_m = start.distance_m(goal);
        let usual = (WIDTH_SHARE * distance_m).max(LEAST_WIDTH_CELLS * geometry.cell_size_m());
        let width_m = width_m.unwrap_or(usual);
        if !(width_m.is_finite() && width_m > 0.0) {
            return Err(CorridorError::Length {
                name: "width",
                given: width_m,
                allowed: "it must be finite and above 0",
            });
        }
        let mut sagitta = None;
        let arc = match kind {
            ArcKind::Line => vec![start, goal],
            ArcKind::Circle { sagitta_m } => {
                let sagitta_m = sagitta_m.unwrap_or(SAGITTA_SHARE * distance_m);
                sagitta = Some(sagitta_m);
                circle(start, goal, sagitta_m)?
            }
            ArcKind::Spine | ArcKind::Relaid => {
                lay().map_or_else(|| vec![start, goal], |points| simplify(&points, geometry.cell_size_m()))
            }
        };
        Ok(Self {
            arc,
            width_m,
            sagitta_m: sagitta,
        })
    }

    /// A swathe of a width around an arc that was laid by the caller.
    pub fn around(geometry: GridGeometry, arc: &[Position], width_m: f64) -> Self {
        Self {
            arc: simplify(arc, geometry.cell_size_m()),
            width_m,
            sagitta_m: None,
        }
    }

    /// The arc's points from start to goal.
    pub fn arc(&self) -> &[Position] {
        &self.arc
    }

    /// Width of the swathe in metres.
    pub fn width_m(&self) -> f64 {
        self.width_m
    }

    /// Sagitta of a circular arc in metres.
    pub fn sagitta_m(&self) -> Option<f64> {
        self.sagitta_m
    }

    /// The same arc with twice the width.
    #[must_use]
    pub fn widened(&self) -> Self {
        Self {
            width_m: 2.0 * self.width_m,
            ..self.clone()
        }
    }

    /// Distance from a position to the arc, in metres.
    pub fn distance_m(&self, position: Position) -> f64 {
        match self.arc.as_slice() {
            [single] => position.distance_m(*single),
            points => points
                .windows(2)
                .map(|pair| position.distance_to_segment_m(pair[0], pair[1]))
                .fold(f64::INFINITY, f64::min),
        }
    }

    /// The cells whose centre is at most half the width from the arc.
    pub fn cells(&self, geometry: GridGeometry) -> Layer<bool> {
        let half_m = self.width_m / 2.0;
        let mut inside = Layer::filled(geometry, false);
        let columns = geometry.columns();
        let segments: Vec<[Position; 2]> = if self.arc.len() == 1 {
            vec![[self.arc[0]; 2]]
        } else {
            self.arc.windows(2).map(|pair| [pair[0], pair[1]]).collect()
        };
        inside
            .data_mut()
            .par_chunks_mut(columns)
            .enumerate()
            .for_each(|(row, out)| {
                let y_m = geometry.centre(crate::grid::Cell::new(row, 0)).y_m;
                for [a, b] in &segments {
                    if y_m < a.y_m.min(b.y_m) - half_m || y_m > a.y_m.max(b.y_m) + half_m {
                        continue;
                    }
                    // Columns beyond the segment's box cannot be within reach.
                    let column = |x_m: f64| (x_m - geometry.west_m()) / geometry.cell_size_m() - 0.5;
                    let first = column(a.x_m.min(b.x_m) - half_m).floor().max(0.0) as usize;
                    let last = column(a.x_m.max(b.x_m) + half_m).ceil().min(columns as f64 - 1.0);
                    if last < 0.0 || first >= columns {
                        continue;
                    }
                    for (column, cell) in out.iter_mut().enumerate().take(last as usize + 1).skip(first) {
                        if !*cell {
                            let centre = geometry.centre(crate::grid::Cell::new(row, column));
                            *cell = centre.distance_to_segment_m(*a, *b) <= half_m;
                        }
                    }
                }
            });
        inside
    }
}

/// Half the width of the widest capsule around the straight line from `start` to `goal` that holds no cell outside the
/// swathe; infinite when the swathe is the whole map.
pub fn capsule_half_width_m(inside: &Layer<bool>, start: Position, goal: Position) -> f64 {
    let geometry = inside.geometry();
    let nearest_m = inside
        .data()
        .par_iter()
        .enumerate()
        .filter(|&(_, &inside)| !inside)
        .map(|(index, _)| geometry.centre(geometry.cell(index)).distance_to_segment_m(start, goal))
        .reduce(|| f64::INFINITY, f64::min);
    // A way leaves the swathe when it reaches the centre of a cell outside.
    nearest_m.max(0.0)
}

fn circle(start: Position, goal: Position, sagitta_m: f64) -> Result<Vec<Position>, CorridorError> {
    let chord_m = start.distance_m(goal);
    if !sagitta_m.is_finite() {
        return Err(CorridorError::Length {
            name: "sagitta",
            given: sagitta_m,
            allowed: "it must be finite",
        });
    }
    if sagitta_m == 0.0 || chord_m == 0.0 {
        return Ok(vec![start, goal]);
    }
    let height = sagitta_m.abs();
    let radius_m = (chord_m * chord_m / 4.0 + height * height) / (2.0 * height);
    let half_angle = 2.0 * (2.0 * height / chord_m).atan();
    let pieces = 2 * ((half_angle / 0.1).ceil() as usize).max(4);
    let (along_x, along_y) = ((goal.x_m - start.x_m) / chord_m, (goal.y_m - start.y_m) / chord_m);
    let side = sagitta_m.signum();
    let mut points: Vec<Position> = (0..=pieces)
        .map(|i| {
            let angle = half_angle * (2.0 * i as f64 / pieces as f64 - 1.0);
            let along = chord_m / 2.0 + radius_m * angle.sin();
            let across = side * (radius_m * angle.cos() - (radius_m - height));
            Position::new(
                start.x_m + along * along_x - across * along_y,
                start.y_m + along * along_y + across * along_x,
            )
        })
        .collect();
    points[0] = start;
    points[pieces] = goal;
    Ok(points)
}

/// Douglas-Peucker: drops points nearer than `tolerance_m` to the line between those that stay.
fn simplify(points: &[Position], tolerance_m: f64) -> Vec<Position> {
    if points.len() < 3 {
        return points.to_vec();
    }
    let mut keep = vec![false; points.len()];
    let mut open = vec![(0, points.len() - 1)];
    (keep[0], keep[points.len() - 1]) = (true, true);
    while let Some((first, last)) = open.pop() {
        let farthest = (first + 1..last)
            .map(|i| (points[i].distance_to_segment_m(points[first], points[last]), i))
            .max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((distance_m, middle)) = farthest
            && distance_m > tolerance_m
        {
            keep[middle] = true;
            open.extend([(first, middle), (middle, last)]);
        }
    }
    let kept = points.iter().zip(keep);
    kept.filter_map(|(point, keep)| keep.then_some(*point)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Cell;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    fn grid() -> GridGeometry {
        GridGeometry::new(40, 60, 10.0, 0.0, 400.0).unwrap()
    }

    fn lay(kind: ArcKind, width_m: Option<f64>) -> Corridor {
        let (start, goal) = (Position::new(55.0, 55.0), Position::new(555.0, 305.0));
        Corridor::lay(grid(), start, goal, kind, width_m, || None).unwrap()
    }

    #[test]
    fn the_circle_rises_by_its_sagitta_over_the_chord() {
        let corridor = lay(ArcKind::Circle { sagitta_m: Some(60.0) }, None);
        let arc = corridor.arc();
        let (start, goal) = (arc[0], arc[arc.len() - 1]);
        let middle = arc[arc.len() / 2];
        assert_relative_eq!(middle.distance_to_segment_m(start, goal), 60.0, epsilon = 1e-6);
        // Left of the way east-north-east is north-west.
        assert!(middle.y_m > start.towards(goal, 0.5).y_m);
        let radius = (start.distance_m(goal).powi(2) / 4.0 + 3600.0) / 120.0;
        let mid = start.towards(goal, 0.5);
        let (dx, dy) = ((goal.x_m - start.x_m), (goal.y_m - start.y_m));
        let chord = dx.hypot(dy);
        let down = radius - 60.0;
        let centre = Position::new(mid.x_m + down * dy / chord, mid.y_m - down * dx / chord);
        for point in arc {
            assert_relative_eq!(point.distance_m(centre), radius, epsilon = 1e-6);
        }
    }

    proptest! {
        #[test]
        fn cells_are_those_within_half_the_width(width in 1.0f64..300.0, sagitta in -100.0f64..100.0) {
            let corridor = lay(ArcKind::Circle { sagitta_m: Some(sagitta) }, Some(width));
            let inside = corridor.cells(grid());
            let wider = corridor.widened().cells(grid());
            for cell in grid().cells() {
                let distance = corridor.distance_m(grid().centre(cell));
                prop_assert_eq!(inside[cell], distance <= width / 2.0);
                prop_assert!(!inside[cell] || wider[cell]);
            }
        }

        #[test]
        fn the_capsule_holds_no_outside_cell(width in 1.0f64..900.0) {
            let corridor = lay(ArcKind::Line, Some(width));
            let inside = corridor.cells(grid());
            let (start, goal) = (corridor.arc()[0], corridor.arc()[1]);
            let half = capsule_half_width_m(&inside, start, goal);
            prop_assert!(half >= width / 2.0 || half.is_infinite());
            for cell in grid().cells() {
                let distance = grid().centre(cell).distance_to_segment_m(start, goal);
                prop_assert!(inside[cell] || distance >= half);
            }
        }
    }

    #[test]
    fn a_spine_follows_the_search_and_drops_idle_points() {
        let ends = (Position::new(5.0, 5.0), Position::new(305.0, 5.0));
        let way: Vec<_> = (0..=30)
            .map(|i| {
                let x = 5.0 + 10.0 * f64::from(i);
                Position::new(x, 5.0 + (150.0 - (x - 155.0).abs()).max(0.0))
            })
            .collect();
        let corridor = Corridor::lay(grid(), ends.0, ends.1, ArcKind::Spine, None, || Some(way)).unwrap();
        assert_eq!(corridor.arc().len(), 3);
        assert!(corridor.cells(grid())[Cell::new(25, 15)]);
    }

    #[test]
    fn widths_that_are_not_lengths_are_refused() {
        let p = Position::new(5.0, 5.0);
        for bad in [0.0, -3.0, f64::NAN] {
            assert!(Corridor::lay(grid(), p, p, ArcKind::Line, Some(bad), || None).is_err());
        }
        let sagitta_m = Some(f64::INFINITY);
        assert!(Corridor::lay(grid(), p, p, ArcKind::Circle { sagitta_m }, None, || None).is_err());
    }
}
