//! The metric profile's goodness of slope and roughness, and the tables that make ranking a look-up.

use crate::soil::{SoilClass, Trafficability};
use crate::terrain::Roughness;
use crate::vehicle::Vehicle;

use super::{CellRank, Combine, RankParams, Reason, UnknownSoil};

/// Slope bands as shares of the vehicle's grade limit: up to 1/3 -> 5, 2/3 -> 4, 1 -> 3, 1.5 -> 2, above -> 1.
const SLOPE_BANDS: [f64; 4] = [1.0 / 3.0, 2.0 / 3.0, 1.0, 1.5];

/// Roughness bands as shares of the ground clearance (estimate).
const ROUGHNESS_BANDS: [f64; 4] = [0.1, 0.25, 0.5, 1.0];

/// What one soil means for this vehicle on this day.
#[derive(Clone, Copy, Debug)]
struct SoilRow {
    goodness: u8,
    gate: Option<Reason>,
    /// Square of the steepest slope that some heading can be driven on.
    steepest_squared: f32,
}

/// Everything that ranking needs beside the cell itself.
#[derive(Clone, Debug)]
pub(super) struct Criteria {
    soils: [SoilRow; 7],
    bands_squared: [f32; 4],
    /// Rank by height goodness - 1 and soil goodness - 1.
    ranks: [[u8; 5]; 5],
    limit_squared: f32,
    gated: bool,
    clearance_m: f64,
    step_height_m: f64,
}

impl Criteria {
    /// `limit` is the steepest grade of the profile and `gated` whether limits hold.
    pub(super) fn new(vehicle: &Vehicle, params: &RankParams, limit: f64, gated: bool) -> Self {
        let soils = SoilClass::ALL.map(|class| {
            let (effective, avoided) = match (class, params.unknown_soil) {
                (SoilClass::Unknown, UnknownSoil::Class(chosen)) => (chosen, false),
                (SoilClass::Unknown, UnknownSoil::Avoid) => (class, true),
                _ => (class, false),
            };
            let traffic = Trafficability::of(vehicle, effective, params.moisture_percent);
            let gate = match effective {
                _ if avoided => Some(Reason::UnknownSoil),
                SoilClass::None => Some(Reason::NoGround),
                _ if !traffic.go => Some(Reason::SoilStrength),
                _ => None,
            };
            let steepest = limit.min(vehicle.grade_up.min(traffic.drawbar_grade).max(vehicle.grade_down));
            SoilRow {
                goodness: effective.goodness(params.soil_table),
                gate: gate.filter(|_| gated),
                steepest_squared: (steepest * steepest) as f32,
            }
        });
        let mut ranks = [[2; 5]; 5];
        for (height, row) in ranks.iter_mut().enumerate() {
            for (soil, rank) in row.iter_mut().enumerate() {
                *rank = combine(params.combine, height as u8 + 1, soil as u8 + 1);
            }
        }
        Self {
            soils,
            bands_squared: SLOPE_BANDS.map(|band| ((band * limit) * (band * limit)) as f32),
            ranks,
            limit_squared: (limit * limit) as f32,
            gated,
            clearance_m: vehicle.ground_clearance_m.max(0.01),
            step_height_m: vehicle.step_height_m,
        }
    }

    /// Ranks by soil code and number of exceeded bands (3 = beyond the limit), and the squared slope up to which each
    /// soil's row holds: what a pass over plain terrain looks up.
    pub(super) fn tables(&self) -> ([[CellRank; 4]; 8], [f32; 8]) {
        let mut ranks = [[CellRank::UNKNOWN; 4]; 8];
        let mut steepest = [f32::INFINITY; 8];
        let beyond = self.limit_squared * 2.0 + 1.0;
        for (soil, row) in ranks.iter_mut().enumerate().take(self.soils.len()) {
            for (exceeded, rank) in row.iter_mut().enumerate() {
                let slope_squared = if exceeded == 3 { beyond } else { 0.0 };
                *rank = self.cell_rank(slope_squared, soil as u8, 5 - exceeded as u8);
            }
            steepest[soil] = self.soils[soil].steepest_squared;
        }
        (ranks, steepest)
    }

    /// Squared slopes above which a band is left, the third being the limit.
    pub(super) fn bands_squared(&self) -> [f32; 3] {
        [self.bands_squared[0], self.bands_squared[1], self.limit_squared]
    }

    /// Goodness of a squared slope: 5 minus the number of bands it exceeds.
    pub(super) fn slope_goodness(&self, slope_squared: f32) -> u8 {
        let exceeded: u8 = self
            .bands_squared
            .iter()
            .map(|&band| u8::from(slope_squared > band))
            .sum();
        5 - exceeded
    }

    /// Goodness of unevenness against the vehicle's ground clearance.
    pub(super) fn roughness_goodness(&self, roughness: Roughness) -> u8 {
        let share = roughness.deviation_m / self.clearance_m;
        5 - ROUGHNESS_BANDS.iter().filter(|&&band| share > band).count() as u8
    }

    /// The step gate.
    pub(super) fn step_gate(&self, roughness: Roughness) -> Option<Reason> {
        (self.gated && roughness.step_m > self.step_height_m).then_some(Reason::Step)
    }

    /// Rank of a cell whose soil code is below 7.
    pub(super) fn cell_rank(&self, slope_squared: f32, soil: u8, height_goodness: u8) -> CellRank {
        let row = &self.soils[usize::from(soil)];
        if let Some(reason) = row.gate {
            return CellRank::no_go(reason);
        }
        if self.gated && slope_squared > row.steepest_squared {
            return CellRank::no_go(if slope_squared > self.limit_squared {
                Reason::Grade
            } else {
                Reason::SoilStrength
            });
        }
        CellRank::ranked(self.ranks[usize::from(height_goodness) - 1][usize::from(row.goodness) - 1])
    }
}

fn combine(how: Combine, height: u8, soil: u8) -> u8 {
    let (height_goodness, soil_goodness) = (f64::from(height), f64::from(soil));
    let rank = match how {
        Combine::Weighted { height, soil } => 2.0 * (height * height_goodness + soil * soil_goodness),
        Combine::Min => 2.0 * height_goodness.min(soil_goodness),
    };
    rank.round().clamp(2.0, 10.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_weights_are_equation_one() {
        for height in 1..=5 {
            for soil in 1..=5 {
                assert_eq!(combine(Combine::SUM, height, soil), height + soil);
            }
        }
    }

    #[test]
    fn the_worse_of_both_can_rule() {
        assert_eq!(combine(Combine::Min, 5, 1), 2);
        assert_eq!(combine(Combine::Min, 4, 5), 8);
    }
}
