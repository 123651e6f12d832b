//! What a way should save: seconds, joules, nearness to no-go ground, or a weighted sum of them.

use crate::planner::PlannerError;
use crate::vehicle::Vehicle;

/// Greatest weight.
const MOST_WEIGHT: f64 = 1e6;

/// Fewest and most cells that risk reaches: a map cannot tell less than a few cells, and more takes too long.
const REACH_CELLS: (f64, f64) = (3.0, 64.0);

/// Weights of what a way costs. The sum is in seconds:
///
/// cost = `time` · t + `energy` · E / P + `risk` · Σ t · max(0, 1 − d / d₀)²
///
/// with the time t in seconds, the energy E in joules over the vehicle's rated power P in watts (so energy counts as the
/// seconds that its power would take to deliver it), and the distance d to the nearest no-go or unknown cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Objective {
    /// Weight of a second of driving, 0 to 10⁶.
    pub time: f64,
    /// Weight of a second of rated power, 0 to 10⁶.
    pub energy: f64,
    /// Weight of a second beside no-go ground, 0 to 10⁶.
    pub risk: f64,
    /// The distance d₀ in metres from which no-go ground counts; when not given, twice the radius of the circle around the
    /// vehicle, at least 3 cells and at most 64.
    pub risk_distance_m: Option<f64>,
}

impl Default for Objective {
    /// Time alone.
    fn default() -> Self {
        Self {
            time: 1.0,
            energy: 0.0,
            risk: 0.0,
            risk_distance_m: None,
        }
    }
}

impl Objective {
    /// Checks the weights and the reach of risk on a map with cells of this size.
    ///
    /// # Errors
    /// [`PlannerError::Objective`] naming what is outside its range. Time and energy must not both weigh nothing: far
    /// from no-go ground every way would then cost the same.
    pub fn validate(&self, cell_size_m: f64) -> Result<(), PlannerError> {
        let wrong = |name, given, allowed| Err(PlannerError::Objective { name, given, allowed });
        for (name, given) in [("time", self.time), ("energy", self.energy), ("risk", self.risk)] {
            if !(0.0..=MOST_WEIGHT).contains(&given) {
                return wrong(name, given, "a weight must be a number from 0 to 1,000,000");
            }
        }
        if self.time + self.energy < 1e-6 {
            let allowed =
                "time or energy must weigh at least 0.000001, or ways far from no-go ground would cost nothing";
            return wrong("time", self.time, allowed);
        }
        match self.risk_distance_m {
            Some(given) if !(given > 0.0 && given <= REACH_CELLS.1 * cell_size_m) => wrong(
                "risk distance in metres",
                given,
                "it must be above 0 and at most 64 cells",
            ),
            _ => Ok(()),
        }
    }

    /// What to say after seconds that are not plain time.
    pub(in crate::planner) fn weighing(&self) -> &'static str {
        match (self.time > 0.0, self.energy > 0.0, self.risk > 0.0) {
            (_, false, false) => "",
            (false, true, false) => " of rated power",
            _ => " of weighted cost",
        }
    }

    /// The distance in metres from which no-go ground counts.
    pub fn reach_m(&self, vehicle: &Vehicle, cell_size_m: f64) -> f64 {
        let (least, most) = REACH_CELLS;
        self.risk_distance_m
            .unwrap_or((2.0 * vehicle.circumscribed_radius_m()).clamp(least * cell_size_m, most * cell_size_m))
    }
}
