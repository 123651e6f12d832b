//! The vehicle's limits by heading, each with its own name, so that a refusal can say which one binds.
//!
//! With pitch tan α and roll tan β of the ground along and across the heading, and its whole slope tan θ: the vehicle's
//! own limits of grade and side slope; traction tan α ≤ drawbar pull over weight and C + sin α / cos θ ≤ μ; braking
//! `μ_b + sin α / cos θ > 0`; and tan β up to the slope at which it tips over.

use crate::grid::Cell;
use crate::soil::Trafficability;
use crate::terrain::{Gradient, HEADINGS, allowed_headings};
use crate::vehicle::Vehicle;

use super::Obstacle;

/// Relative slack of limits, so that a segment exactly at a limit does not fail by rounding.
const SLACK: f64 = 1e-9;

/// Limits with their slack.
#[derive(Clone, Debug)]
pub(super) struct Limits {
    up: f64,
    down: f64,
    side: f64,
    rollover: f64,
    friction: f64,
    braking: f64,
}

impl Limits {
    pub(super) fn new(vehicle: &Vehicle) -> Self {
        Self {
            up: vehicle.grade_up * (1.0 + SLACK),
            down: vehicle.grade_down * (1.0 + SLACK),
            side: vehicle.side_slope * (1.0 + SLACK),
            rollover: vehicle.rollover_slope().unwrap_or(f64::INFINITY) * (1.0 + SLACK),
            friction: vehicle.traction_friction * (1.0 + SLACK),
            braking: vehicle.braking_friction,
        }
    }

    /// The headings that a cell's gradient leaves open on its soil, as a bit set.
    pub(super) fn headings(&self, gradient: Gradient, soil: &Trafficability) -> u16 {
        let up = self.up.min(soil.drawbar_grade * (1.0 + SLACK));
        let mut allowed = allowed_headings(gradient, up, self.down, self.side.min(self.rollover));
        // Friction binds at most as much as straight up or down the slope.
        if gradient.slope() > self.braking.min(self.friction - soil.rolling_resistance) {
            for (k, &(east, north)) in HEADINGS.iter().enumerate() {
                let pitch = gradient.along(east, north);
                if !(self.grips(gradient, pitch, soil) && self.brakes(gradient, pitch)) {
                    allowed &= !(1 << k);
                }
            }
        }
        allowed
    }

    /// The first limit that a piece breaks, by the grade of its ends and the gradient of its cell.
    pub(super) fn broken(
        &self,
        cell: Cell,
        grade: f64,
        gradient: Gradient,
        (east, north): (f64, f64),
        soil: &Trafficability,
    ) -> Option<Obstacle> {
        let (pitch, roll) = (gradient.along(east, north), gradient.across(east, north).abs());
        let traction = soil.drawbar_grade * (1.0 + SLACK);
        for slope in [grade, pitch] {
            if slope > self.up || slope < -self.down {
                return Some(Obstacle::Grade(cell, slope));
            }
            if slope > traction {
                return Some(Obstacle::Traction(cell, slope));
            }
        }
        if roll > self.side {
            return Some(Obstacle::SideSlope(cell, roll));
        }
        if roll > self.rollover {
            return Some(Obstacle::Rollover(cell, roll));
        }
        if !self.grips(gradient, pitch, soil) {
            return Some(Obstacle::Traction(cell, pitch));
        }
        (!self.brakes(gradient, pitch)).then_some(Obstacle::Braking(cell, pitch))
    }

    /// Whether a grade of a piece keeps the limits of grade and drawbar pull.
    pub(super) fn allows_grade(&self, grade: f64, soil: &Trafficability) -> bool {
        grade <= self.up && grade <= soil.drawbar_grade * (1.0 + SLACK) && grade >= -self.down
    }

    fn grips(&self, gradient: Gradient, pitch: f64, soil: &Trafficability) -> bool {
        soil.rolling_resistance + pull(gradient, pitch) <= self.friction
    }

    fn brakes(&self, gradient: Gradient, pitch: f64) -> bool {
        self.braking + pull(gradient, pitch) > 0.0
    }
}

/// Weight along the heading over weight on the ground: sin α / cos θ.
fn pull(gradient: Gradient, pitch: f64) -> f64 {
    let slope = gradient.slope();
    pitch * ((1.0 + slope * slope) / (1.0 + pitch * pitch)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::fixtures::pioneer;
    use proptest::prelude::*;

    fn soil(drawbar_grade: f64) -> Trafficability {
        Trafficability {
            go: true,
            drawbar_grade,
            rolling_resistance: 0.05,
            speed_mps: 1.0,
        }
    }

    /// A vehicle that climbs anything but for the limit under test.
    fn able() -> Vehicle {
        Vehicle {
            grade_up: 1.5,
            grade_down: 1.5,
            side_slope: 1.5,
            traction_friction: 2.0,
            braking_friction: 2.0,
            ..pioneer()
        }
    }

    proptest! {
        #[test]
        fn headings_are_those_that_break_no_limit(
            east in -1.2f64..1.2, north in -1.2f64..1.2, drawbar in 0.1f64..0.8, friction in 0.2f64..1.2,
            braking in 0.2f64..1.2, height in 0.1f64..1.0,
        ) {
            let vehicle = Vehicle {
                traction_friction: friction,
                braking_friction: braking,
                gauge_m: Some(0.4),
                centre_of_gravity_m: Some(height),
                grade_up: 0.6,
                side_slope: 0.5,
                ..able()
            };
            let limits = Limits::new(&vehicle);
            let gradient = Gradient { east, north };
            let allowed = limits.headings(gradient, &soil(drawbar));
            for (k, &heading) in HEADINGS.iter().enumerate() {
                let broken = limits.broken(Cell::new(0, 0), 0.0, gradient, heading, &soil(drawbar));
                prop_assert_eq!(allowed >> k & 1 == 1, broken.is_none(), "{} {:?}", k, broken);
            }
        }
    }

    #[test]
    fn every_limit_has_its_name() {
        let eastward = |vehicle: &Vehicle, east: f64, north: f64, drawbar: f64| {
            let gradient = Gradient { east, north };
            let limits = Limits::new(vehicle);
            limits.broken(Cell::new(0, 0), 0.0, gradient, (1.0, 0.0), &soil(drawbar))
        };
        let tippy = Vehicle {
            gauge_m: Some(0.4),
            centre_of_gravity_m: Some(0.5),
            ..able()
        };
        let slippery = Vehicle {
            traction_friction: 0.35,
            ..able()
        };
        let brakeless = Vehicle {
            braking_friction: 0.3,
            ..able()
        };
        assert!(eastward(&tippy, 0.3, 0.3, 1.0).is_none());
        assert!(matches!(eastward(&able(), 1.6, 0.0, 2.0), Some(Obstacle::Grade(_, g)) if g > 0.0));
        assert!(matches!(eastward(&able(), -1.6, 0.0, 2.0), Some(Obstacle::Grade(_, g)) if g < 0.0));
        assert!(matches!(
            eastward(&able(), 0.3, 0.0, 0.2),
            Some(Obstacle::Traction(_, _))
        ));
        assert!(matches!(
            eastward(&able(), 0.0, 1.6, 1.0),
            Some(Obstacle::SideSlope(_, _))
        ));
        assert!(matches!(eastward(&tippy, 0.0, -0.41, 1.0), Some(Obstacle::Rollover(_, slope)) if slope == 0.41));
        assert!(eastward(&tippy, 0.0, 0.4, 1.0).is_none());
        // 0.05 + 0.29 stays below 0.35 straight up, and no longer where the ground also falls to the side.
        assert!(eastward(&slippery, 0.29, 0.0, 1.0).is_none());
        assert!(matches!(
            eastward(&slippery, 0.29, 0.5, 1.0),
            Some(Obstacle::Traction(_, _))
        ));
        assert!(eastward(&brakeless, -0.29, 0.0, 1.0).is_none());
        assert!(matches!(
            eastward(&brakeless, -0.29, 0.5, 1.0),
            Some(Obstacle::Braking(_, _))
        ));
    }
}
