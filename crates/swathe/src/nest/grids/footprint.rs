//! The ground a robot stands on, and the cells of a unit grid that it touches.

use crate::vehicle::Vehicle;

use super::super::NestError;

/// Growth of a footprint in cells on every side before cells are looked up. It covers what rounding can do, and the
/// shift of [`super::evidence::SNAP`] with which cell edges are laid on edges of terrain cells.
pub(super) const SLACK: f64 = 1e-6;

/// The ground a robot stands on: a disc, or a rectangle that turns with the heading. Its edge belongs to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint(Shape);

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    Circle { radius_m: f64 },
    Rectangle { length_m: f64, width_m: f64 },
}

impl Footprint {
    /// A disc around the position.
    ///
    /// # Errors
    /// [`NestError::Figure`] unless the radius is finite and not below 0.
    pub fn circle(radius_m: f64) -> Result<Self, NestError> {
        let radius_m = length("footprint's radius in metres", radius_m)?;
        Ok(Self(Shape::Circle { radius_m }))
    }

    /// A rectangle around the position, its length along the heading.
    ///
    /// # Errors
    /// [`NestError::Figure`] unless both sides are finite and not below 0.
    pub fn rectangle(length_m: f64, width_m: f64) -> Result<Self, NestError> {
        let length_m = length("footprint's length in metres", length_m)?;
        let width_m = length("footprint's width in metres", width_m)?;
        Ok(Self(Shape::Rectangle { length_m, width_m }))
    }

    /// The rectangle of a vehicle.
    ///
    /// # Errors
    /// [`NestError::Figure`] unless both sides are finite and not below 0.
    pub fn of_vehicle(vehicle: &Vehicle) -> Result<Self, NestError> {
        Self::rectangle(vehicle.length_m, vehicle.width_m)
    }

    /// The footprint in cells around (0, 0), x east and y south, grown by the slack.
    pub(super) fn outline(&self, heading_rad: f64, cell_size_m: f64) -> Outline {
        match self.0 {
            // Touches cells outside every window.
            _ if !heading_rad.is_finite() => Outline::Circle(f64::INFINITY),
            Shape::Circle { radius_m } => Outline::Circle(radius_m / cell_size_m + SLACK),
            Shape::Rectangle { length_m, width_m } => {
                let along = length_m / cell_size_m / 2.0 + SLACK;
                let aside = width_m / cell_size_m / 2.0 + SLACK;
                let (sin, cos) = heading_rad.sin_cos();
                // Forward is (cos, -sin) and left (-sin, -cos), because y points south.
                let (fx, fy, lx, ly) = (along * cos, -along * sin, -aside * sin, -aside * cos);
                Outline::Rectangle([
                    (fx + lx, fy + ly),
                    (fx - lx, fy - ly),
                    (-fx - lx, -fy - ly),
                    (-fx + lx, -fy + ly),
                ])
            }
        }
    }
}

fn length(name: &'static str, given: f64) -> Result<f64, NestError> {
    if given.is_finite() && given >= 0.0 {
        return Ok(given);
    }
    let allowed = "it must be finite and not below 0";
    Err(NestError::Figure { name, given, allowed })
}

/// A footprint in cells around its position.
#[derive(Clone, Copy, Debug)]
pub(super) enum Outline {
    Circle(f64),
    Rectangle([(f64, f64); 4]),
}

impl Outline {
    /// Whether `holds(row, column)` is true of every cell that the outline touches when it stands at (`x`, `y`), all of
    /// them inside `across` rows and columns. A convex outline touches one run of cells in each row.
    #[inline]
    pub(super) fn all_touched(&self, x: f64, y: f64, across: usize, holds: impl Fn(usize, usize) -> bool) -> bool {
        let reach = match self {
            Self::Circle(radius) => *radius,
            Self::Rectangle(corners) => corners.iter().fold(0.0, |most: f64, corner| most.max(corner.1)),
        };
        let across_f = across as f64;
        let (top, bottom) = (y - reach, y + reach);
        // False for NaN too.
        if !(top >= 0.0 && bottom < across_f) {
            return false;
        }
        (top as usize..=bottom as usize).all(|row| {
            let (west, east) = self.span(row as f64 - y);
            let (west, east) = (x + west, x + east);
            west >= 0.0 && east < across_f && (west as usize..=east as usize).all(|column| holds(row, column))
        })
    }

    /// The least and greatest x of the outline between `y` and `y + 1`, both measured from its position.
    #[inline]
    fn span(&self, y: f64) -> (f64, f64) {
        match self {
            Self::Circle(radius) => {
                let off = y.max(-1.0 - y).max(0.0);
                let half = (radius * radius - off * off).max(0.0).sqrt();
                (-half, half)
            }
            Self::Rectangle(corners) => {
                let mut span = (f64::INFINITY, f64::NEG_INFINITY);
                for (index, &from) in corners.iter().enumerate() {
                    let to = corners[(index + 1) % 4];
                    if from.1.max(to.1) < y || from.1.min(to.1) > y + 1.0 {
                        continue;
                    }
                    for (end, other) in [(from, to), (to, from)] {
                        let level = end.1.clamp(y, y + 1.0);
                        let x = if level == end.1 {
                            end.0
                        } else {
                            end.0 + (level - end.1) * (other.0 - end.0) / (other.1 - end.1)
                        };
                        span = (span.0.min(x), span.1.max(x));
                    }
                }
                span
            }
        }
    }
}
