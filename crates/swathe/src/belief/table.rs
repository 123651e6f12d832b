//! What a penetrometer meets on each soil class: a table that users may edit.

use super::{BeliefError, CLASS_COUNT, CLASSES};
use crate::soil::{SoilClass, check_moisture};

/// A figure's middle and its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// The middle.
    pub mean: f64,
    /// One standard deviation, above 0.
    pub deviation: f64,
}

/// What a penetrometer meets on one soil class.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoilType {
    /// Natural logarithm of the mean cone index in kPa over the layer that carries the vehicle.
    pub cone_index_ln_kpa: Spread,
    /// Rise of the cone index with depth, in kPa per metre.
    pub gradient_kpa_per_m: Spread,
    /// Standard deviation of the cone index about its straight line, over its mean.
    pub roughness: Spread,
    /// Chance, above 0 and below 1, that the cone is refused within the layer.
    pub refusal: f64,
    /// Rating cone index over cone index, above 0 and at most 1: what traffic leaves of the strength.
    pub remoulding_index: f64,
}

/// A row for each class of [`CLASSES`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoilTypes(pub [SoilType; CLASS_COUNT]);

impl Default for SoilTypes {
    /// Estimates for soil of a normal day.
    fn default() -> Self {
        let soil = |kpa: f64, spread, gradient, roughness, refusal, remoulding_index| {
            let [gradient, roughness] = [gradient, roughness].map(|(mean, deviation)| Spread { mean, deviation });
            SoilType {
                cone_index_ln_kpa: Spread {
                    mean: kpa.ln(),
                    deviation: spread,
                },
                gradient_kpa_per_m: gradient,
                roughness,
                refusal,
                remoulding_index,
            }
        };
        Self([
            soil(3500.0, 0.5, (15_000.0, 8000.0), (0.5, 0.2), 0.4, 1.0),
            soil(1200.0, 0.6, (8000.0, 5000.0), (0.15, 0.08), 0.03, 1.0),
            soil(800.0, 0.6, (1000.0, 2000.0), (0.08, 0.06), 0.01, 0.8),
            soil(600.0, 0.6, (2000.0, 2000.0), (0.10, 0.06), 0.02, 0.7),
            soil(8000.0, 0.5, (60_000.0, 40_000.0), (0.5, 0.25), 0.97, 1.0),
            soil(150.0, 0.6, (300.0, 600.0), (0.2, 0.1), 0.001, 0.5),
        ])
    }
}

impl SoilTypes {
    /// The table of a day with a moisture in per cent of the dry weight: the cone index of clay and silt moves to the strength
    /// that they have then, before remoulding, and its rise with depth in proportion. The others keep theirs.
    ///
    /// # Errors
    /// [`BeliefError::Soil`] for a moisture outside 1 to 200 %.
    pub fn on_day(mut self, moisture_percent: f64) -> Result<Self, BeliefError> {
        check_moisture(moisture_percent)?;
        for (class, soil) in CLASSES.iter().zip(&mut self.0) {
            let (SoilClass::Clay | SoilClass::Silt, Some(rating_kpa)) =
                (class, class.rating_cone_index_kpa(moisture_percent))
            else {
                continue;
            };
            let today_ln = (rating_kpa / soil.remoulding_index).ln();
            let factor = (today_ln - soil.cone_index_ln_kpa.mean).exp();
            soil.cone_index_ln_kpa.mean = today_ln;
            soil.gradient_kpa_per_m.mean *= factor;
            soil.gradient_kpa_per_m.deviation *= factor;
        }
        Ok(self)
    }

    /// Checks every figure.
    ///
    /// # Errors
    /// [`BeliefError::Type`] naming the first that is outside its range.
    pub fn validate(&self) -> Result<(), BeliefError> {
        for (class, soil) in CLASSES.iter().zip(&self.0) {
            let check = |name, given: f64, holds: bool, allowed| {
                let class = class.name();
                if holds {
                    Ok(())
                } else {
                    Err(BeliefError::Type {
                        class,
                        name,
                        given,
                        allowed,
                    })
                }
            };
            for (name, spread) in [
                ("cone index", soil.cone_index_ln_kpa),
                ("gradient", soil.gradient_kpa_per_m),
                ("roughness", soil.roughness),
            ] {
                check(name, spread.mean, spread.mean.is_finite(), "it must be finite")?;
                let positive = spread.deviation.is_finite() && spread.deviation > 0.0;
                check(
                    name,
                    spread.deviation,
                    positive,
                    "its deviation must be finite and above 0",
                )?;
            }
            let refusal = soil.refusal > 0.0 && soil.refusal < 1.0;
            check(
                "chance of refusal",
                soil.refusal,
                refusal,
                "it must be above 0 and below 1",
            )?;
            let index = soil.remoulding_index;
            let fits = index > 0.0 && index <= 1.0;
            check("remoulding index", index, fits, "it must be above 0 and at most 1")?;
        }
        Ok(())
    }
}
