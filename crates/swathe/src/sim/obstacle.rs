//! Upright things that stand in the way, with exact plane geometry. Sets are closed: what touches, meets.

use crate::grid::Position;
use crate::sensor::Pose;
use crate::vehicle::Vehicle;

use super::{SimError, require};

/// An outline on the ground.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A disc.
    Disc {
        /// Its centre.
        centre: Position,
        /// Its radius in metres.
        radius_m: f64,
    },
    /// A solid simple polygon, its corners in order, the last joined to the first.
    Polygon(Vec<Position>),
    /// A thin wall along a line of points.
    Wall(Vec<Position>),
}

/// Something upright that vehicles collide with and lasers see.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// Its outline.
    pub shape: Shape,
    /// Height above the ground at its middle in metres; a vehicle drives over what is not higher than its step height.
    pub height_m: f64,
}

/// The rectangle that a vehicle covers at a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    corners: [Position; 4],
}

impl Shape {
    /// A box (a crate, a rock) of a length and width turned by a heading.
    pub fn rectangle(centre: Position, length_m: f64, width_m: f64, heading_rad: f64) -> Self {
        let pose = Pose::level(centre.x_m, centre.y_m, heading_rad);
        Self::Polygon(Footprint::new(&pose, length_m, width_m).corners.to_vec())
    }

    /// Checks every figure.
    ///
    /// # Errors
    /// [`SimError::Figure`] when a coordinate is not finite, a radius is not above 0 or there are too few points.
    pub fn validate(&self) -> Result<(), SimError> {
        let (points, least): (&[Position], usize) = match self {
            Self::Disc { centre, radius_m } => {
                require("radius in metres", *radius_m, *radius_m > 0.0, "it must be above 0")?;
                (std::slice::from_ref(centre), 1)
            }
            Self::Polygon(points) => (points, 3),
            Self::Wall(points) => (points, 2),
        };
        let count = points.len() as f64;
        require(
            "number of points of an obstacle",
            count,
            points.len() >= least,
            "an area needs 3, a wall 2",
        )?;
        for point in points {
            require("easting of an obstacle", point.x_m, true, "it must be finite")?;
            require("northing of an obstacle", point.y_m, true, "it must be finite")?;
        }
        Ok(())
    }

    /// The straight edges of polygons and walls.
    pub(crate) fn edges(&self) -> impl Iterator<Item = (Position, Position)> + '_ {
        let (points, closed): (&[Position], bool) = match self {
            Self::Disc { .. } => (&[], false),
            Self::Polygon(points) => (points, true),
            Self::Wall(points) => (points, false),
        };
        let count = if closed {
            points.len()
        } else {
            points.len().saturating_sub(1)
        };
        (0..count).map(|n| (points[n], points[(n + 1) % points.len()]))
    }

    /// (west, south, east, north) of what it covers.
    pub(super) fn bounds(&self) -> [f64; 4] {
        let (points, margin): (&[Position], f64) = match self {
            Self::Disc { centre, radius_m } => (std::slice::from_ref(centre), *radius_m),
            Self::Polygon(points) | Self::Wall(points) => (points, 0.0),
        };
        let none = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        points.iter().fold(none, |[west, south, east, north], p| {
            [
                west.min(p.x_m - margin),
                south.min(p.y_m - margin),
                east.max(p.x_m + margin),
                north.max(p.y_m + margin),
            ]
        })
    }

    /// The middle of its bounds.
    pub(super) fn middle(&self) -> Position {
        let [west, south, east, north] = self.bounds();
        Position::new(west.midpoint(east), south.midpoint(north))
    }

    /// Distance from a point in metres; 0 inside.
    pub fn distance_m(&self, from: Position) -> f64 {
        match self {
            Self::Disc { centre, radius_m } => (from.distance_m(*centre) - radius_m).max(0.0),
            Self::Polygon(points) if contains(points, from) => 0.0,
            Self::Polygon(_) | Self::Wall(_) => self
                .edges()
                .map(|(a, b)| from.distance_to_segment_m(a, b))
                .fold(f64::INFINITY, f64::min),
        }
    }
}

impl Footprint {
    /// A rectangle around a pose.
    pub fn new(pose: &Pose, length_m: f64, width_m: f64) -> Self {
        let (sin, cos) = pose.heading_rad.sin_cos();
        let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)].map(|(ahead, left)| {
            let (x, y) = (ahead * length_m / 2.0, left * width_m / 2.0);
            Position::new(pose.x_m + cos * x - sin * y, pose.y_m + sin * x + cos * y)
        });
        Self { corners }
    }

    /// What a vehicle covers.
    pub fn of(vehicle: &Vehicle, pose: &Pose) -> Self {
        Self::new(pose, vehicle.length_m, vehicle.width_m)
    }

    /// Front left, rear left, rear right, front right.
    pub fn corners(&self) -> [Position; 4] {
        self.corners
    }

    /// Whether it meets a shape; touching counts.
    pub fn meets(&self, shape: &Shape) -> bool {
        match shape {
            Shape::Disc { centre, radius_m } => {
                contains(&self.corners, *centre)
                    || self
                        .edges()
                        .any(|(a, b)| centre.distance_to_segment_m(a, b) <= *radius_m)
            }
            Shape::Polygon(points) | Shape::Wall(points) => {
                let solid = matches!(shape, Shape::Polygon(_));
                shape.edges().any(|(a, b)| self.edges().any(|(c, d)| cross(a, b, c, d)))
                    || points.first().is_some_and(|&point| contains(&self.corners, point))
                    || (solid && contains(points, self.corners[0]))
            }
        }
    }

    /// Metres to a shape, 0 where they meet.
    pub fn distance_m(&self, shape: &Shape) -> f64 {
        if self.meets(shape) {
            return 0.0;
        }
        let to_edges = |point: Position| self.edges().map(move |(a, b)| point.distance_to_segment_m(a, b));
        match shape {
            Shape::Disc { centre, radius_m } => to_edges(*centre).fold(f64::INFINITY, f64::min) - radius_m,
            // Two segments that do not cross are nearest at an end of one of them.
            Shape::Polygon(points) | Shape::Wall(points) => {
                let corners = self
                    .corners
                    .iter()
                    .flat_map(|&corner| shape.edges().map(move |(a, b)| corner.distance_to_segment_m(a, b)));
                let ends = points.iter().flat_map(|&point| to_edges(point));
                corners.chain(ends).fold(f64::INFINITY, f64::min)
            }
        }
        .max(0.0)
    }

    fn edges(&self) -> impl Iterator<Item = (Position, Position)> + '_ {
        (0..4).map(|n| (self.corners[n], self.corners[(n + 1) % 4]))
    }
}

/// Twice the signed area of a triangle; above 0 when it turns left.
fn turn(a: Position, b: Position, c: Position) -> f64 {
    (b.x_m - a.x_m) * (c.y_m - a.y_m) - (b.y_m - a.y_m) * (c.x_m - a.x_m)
}

/// Whether two closed segments have a point in common.
fn cross(a: Position, b: Position, c: Position, d: Position) -> bool {
    let sides = [turn(c, d, a), turn(c, d, b), turn(a, b, c), turn(a, b, d)];
    let between = |p: f64, q: f64, r: f64, s: f64| p.min(q) <= r.max(s) && r.min(s) <= p.max(q);
    sides[0] * sides[1] <= 0.0
        && sides[2] * sides[3] <= 0.0
        // Segments of one line must also overlap.
        && between(a.x_m, b.x_m, c.x_m, d.x_m)
        && between(a.y_m, b.y_m, c.y_m, d.y_m)
}

/// Whether a point lies in a simple polygon (even-odd rule).
fn contains(corners: &[Position], point: Position) -> bool {
    let mut inside = false;
    let Some(&(mut before)) = corners.last() else {
        return false;
    };
    for &corner in corners {
        if (corner.y_m > point.y_m) != (before.y_m > point.y_m) {
            let t = (point.y_m - corner.y_m) / (before.y_m - corner.y_m);
            inside ^= point.x_m < corner.x_m + t * (before.x_m - corner.x_m);
        }
        before = corner;
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(x_m: f64, y_m: f64) -> Position {
        Position::new(x_m, y_m)
    }

    #[test]
    fn touching_meets_and_a_hair_apart_does_not() {
        let robot = Footprint::new(&Pose::level(0.0, 0.0, 0.0), 2.0, 1.0);
        for gap in [0.0, 1e-9] {
            let crate_ahead = Shape::rectangle(at(1.5 + gap, 0.0), 1.0, 1.0, 0.0);
            let disc = Shape::Disc {
                centre: at(0.0, 1.0 + gap),
                radius_m: 0.5,
            };
            let wall = Shape::Wall(vec![at(1.0 + gap, -9.0), at(1.0 + gap, 9.0)]);
            for shape in [crate_ahead, disc, wall] {
                assert_eq!(robot.meets(&shape), gap == 0.0, "{shape:?}");
            }
        }
    }

    #[test]
    fn what_lies_inside_meets() {
        let robot = Footprint::new(&Pose::level(0.0, 0.0, 0.3), 2.0, 1.0);
        assert!(robot.meets(&Shape::rectangle(at(0.0, 0.0), 9.0, 9.0, 1.0)));
        assert!(robot.meets(&Shape::rectangle(at(0.0, 0.0), 0.1, 0.1, 1.0)));
        assert!(robot.meets(&Shape::Wall(vec![at(0.0, 0.0), at(0.1, 0.1)])));
        assert!(robot.meets(&Shape::Disc {
            centre: at(0.1, 0.0),
            radius_m: 0.01
        }));
        assert!(robot.meets(&Shape::Disc {
            centre: at(5.0, 0.0),
            radius_m: 9.0
        }));
    }

    #[test]
    fn shapes_that_cannot_be_are_refused() {
        assert!(
            Shape::Disc {
                centre: at(0.0, 0.0),
                radius_m: 0.0
            }
            .validate()
            .is_err()
        );
        assert!(
            Shape::Disc {
                centre: at(f64::NAN, 0.0),
                radius_m: 1.0
            }
            .validate()
            .is_err()
        );
        assert!(Shape::Polygon(vec![at(0.0, 0.0), at(1.0, 0.0)]).validate().is_err());
        assert!(Shape::Wall(Vec::new()).validate().is_err());
        assert!(Shape::rectangle(at(0.0, 0.0), 1.0, 1.0, 0.0).validate().is_ok());
    }

    proptest! {
        #[test]
        fn a_box_meets_when_a_point_of_one_lies_in_the_other(
            x in -3.0f64..3.0, y in -3.0f64..3.0, turn in -4.0f64..4.0, length in 0.1f64..3.0, width in 0.1f64..3.0,
        ) {
            let robot = Footprint::new(&Pose::level(0.0, 0.0, 0.4), 2.0, 1.0);
            let shape = Shape::rectangle(at(x, y), length, width, turn);
            // Sampled points of the robot: one in the box means that they meet, none nearer than the samples' spacing
            // means that they do not.
            let mut nearest = f64::INFINITY;
            for i in 0..=40 {
                for j in 0..=20 {
                    let (a, l) = (f64::from(i) / 20.0 - 1.0, f64::from(j) / 20.0 - 0.5);
                    let (sin, cos) = 0.4f64.sin_cos();
                    nearest = nearest.min(shape.distance_m(at(cos * a - sin * l, sin * a + cos * l)));
                }
            }
            let spacing = 0.05f64.hypot(0.05);
            let distance_m = robot.distance_m(&shape);
            prop_assert!(distance_m <= nearest + 1e-9 && distance_m >= nearest - spacing, "{distance_m} {nearest}");
            if nearest == 0.0 {
                prop_assert!(robot.meets(&shape));
            } else if nearest > spacing {
                prop_assert!(!robot.meets(&shape));
            }
        }
    }
}
