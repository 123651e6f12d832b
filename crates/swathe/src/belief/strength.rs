//! How strong the ground is believed to be, class by class: the table, what was told, and what was measured near and far.

use super::{CLASS_COUNT, PerClass, SoilBelief, UnitBelief, mixture_of};
use crate::grid::Cell;

/// What readings say of the strength of a class at a place.
#[derive(Clone, Copy, Debug)]
struct Measured {
    /// Chance that none of them was of the very same soil.
    other: f64,
    weight: f64,
    sum_ln: f64,
}

impl Default for Measured {
    fn default() -> Self {
        Self {
            other: 1.0,
            weight: 0.0,
            sum_ln: 0.0,
        }
    }
}

impl Measured {
    /// Mean of the logarithms of what was measured in kPa; `None` where nothing was.
    fn mean_ln(&self) -> Option<f64> {
        (self.weight > 1e-9).then(|| self.sum_ln / self.weight)
    }
}

impl SoilBelief {
    /// Strength in kPa of a class at a cell, from its table's value, from what was told of its unit, and from what was measured
    /// far off in it. The logarithms are averaged with the inverse of their variances as weights. Rock and no ground have none.
    fn usual_strength_kpa(&self, unit: &UnitBelief, class: usize, table_kpa: f64, near: &[f64], is_unit: bool) -> f64 {
        let remoulding_ln = self.params.types.0[class].remoulding_index.ln();
        let noise = self.params.reading_spread_ln.powi(2);
        let (mut weights, mut sum) = (0.0, 0.0);
        if let Some(strength_ln) = unit.strength_ln {
            weights += 1.0 / noise;
            sum += (strength_ln + remoulding_ln) / noise;
        }
        let far = if is_unit { self.params.far_strength_weight } else { 0.0 };
        for (known, near) in unit.evidence.iter().zip(near) {
            let Some(strength_ln) = known.strength_ln else { continue };
            let weight = (1.0 - near) * far * known.increment[class] / noise;
            weights += weight;
            sum += weight * (strength_ln + remoulding_ln);
        }
        if weights == 0.0 {
            return table_kpa;
        }
        let table_weight = self.params.table_spread_ln.powi(-2);
        ((table_weight * table_kpa.ln() + sum) / (table_weight + weights)).exp()
    }

    /// What was measured near a cell says of the strength of each class there.
    ///
    /// A reading speaks for a cell when both are of the very same soil, which is the less likely the less the reading looks like
    /// the class: firm sand beside it says nothing of how firm clay would be.
    fn measured(&self, unit: &UnitBelief, near: &[f64]) -> [Measured; CLASS_COUNT] {
        let mixture = mixture_of(unit, near);
        let mut found = [Measured::default(); CLASS_COUNT];
        for (known, &near) in unit.evidence.iter().zip(near) {
            let Some(strength_ln) = known.strength_ln else { continue };
            let likelihood = &known.matched.likelihood;
            let expected: f64 = mixture.iter().zip(likelihood).map(|(share, value)| share * value).sum();
            for (k, measured) in found.iter_mut().enumerate() {
                let (same, other) = (near * likelihood[k], (1.0 - near) * expected);
                let same = if same + other > 0.0 {
                    same / (same + other)
                } else {
                    near
                };
                measured.other *= 1.0 - same;
                measured.weight += same;
                measured.sum_ln += same * (strength_ln + self.params.types.0[k].remoulding_index.ln());
            }
        }
        found
    }

    /// Chance of each class at a cell that it does not carry what needs a strength, where it is that class; `tables_kpa` are the
    /// strengths of the classes by their table.
    pub(in crate::belief) fn failing(&self, cell: Cell, tables_kpa: &PerClass, needed_kpa: f64) -> PerClass {
        let (unit, near, is_unit) = self.around(cell);
        let measured = self.measured(unit, &near);
        std::array::from_fn(|k| {
            let usual_kpa = self.usual_strength_kpa(unit, k, tables_kpa[k], &near, is_unit);
            let usually = if usual_kpa < needed_kpa { 1.0 } else { 0.0 };
            let Some(measured_ln) = measured[k].mean_ln() else {
                return usually;
            };
            let spread_ln = self.params.reading_spread_ln / measured[k].weight.max(1.0).sqrt();
            let here = normal_share((needed_kpa.ln() - measured_ln) / spread_ln);
            measured[k].other * usually + (1.0 - measured[k].other) * here
        })
    }

    /// Strength in kPa that a class is expected to have at a cell, from its table's value and all that was measured.
    pub(in crate::belief) fn strength_kpa(&self, cell: Cell, class: usize, table_kpa: f64) -> f64 {
        let (unit, near, is_unit) = self.around(cell);
        let usual_kpa = self.usual_strength_kpa(unit, class, table_kpa, &near, is_unit);
        let measured = self.measured(unit, &near)[class];
        let Some(measured_ln) = measured.mean_ln() else {
            return usual_kpa;
        };
        (measured.other * usual_kpa.ln() + (1.0 - measured.other) * measured_ln).exp()
    }

    /// The unit of a cell, how near its readings are, and whether it is a polygon at all.
    fn around(&self, cell: Cell) -> (&UnitBelief, Vec<f64>, bool) {
        let place = self.ground.units[cell] as usize;
        let (unit, at) = (&self.units[place], self.geometry().centre(cell));
        let near = unit.evidence.iter().map(|known| self.nearness(known.at, at)).collect();
        (unit, near, place != 0)
    }
}

/// Share of a standard normal distribution below a value, to 1e-7 (Abramowitz and Stegun 1964, 26.2.17).
fn normal_share(value: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * value.abs());
    let series = [
        1.330_274_429,
        -1.821_255_978,
        1.781_477_937,
        -0.356_563_782,
        0.319_381_53,
    ];
    let tail = (-0.5 * value * value).exp() / std::f64::consts::TAU.sqrt()
        * t
        * series.iter().fold(0.0, |sum, factor| sum * t + factor);
    if value > 0.0 { 1.0 - tail } else { tail }
}
