//! From a penetrometer's profile to what it says for each soil class.

use super::{BeliefError, BeliefParams, CLASS_COUNT, CLASSES, Matching, PerClass, SoilTypes, class_index};
use crate::sensor::PenetrometerReading;
use crate::soil::SoilClass;

/// Atmospheric pressure in kPa, Robertson's unit of cone resistance.
const ATMOSPHERE_KPA: f64 = 100.0;

/// Least likelihood of a class beside 1 for the best, so that one odd profile never rules anything out (estimate).
const LEAST_LIKELIHOOD: f64 = 0.01;

/// What a profile looks like over the layer that carries the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Features {
    /// Mean cone index in kPa; `None` when no sample lies in the layer or all of them are 0.
    pub cone_index_kpa: Option<f64>,
    /// Rise with depth in kPa per metre, from two samples on.
    pub gradient_kpa_per_m: Option<f64>,
    /// Standard deviation about the straight line over the mean, from three samples on.
    pub roughness: Option<f64>,
    /// Depth in metres at which the cone was refused, by the operator's word or by its cone index.
    pub refusal_depth_m: Option<f64>,
    /// Mean sleeve friction in kPa, where it was measured and is above 0.
    pub sleeve_friction_kpa: Option<f64>,
}

/// What a reading says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Likelihood of the reading on each class, relative to the greatest.
    pub likelihood: PerClass,
    /// The class that explains it best.
    pub observed: SoilClass,
    /// Mean cone index in kPa of the layer; `None` when the ground refused the cone or nothing was measured.
    pub cone_index_kpa: Option<f64>,
}

impl Features {
    /// The features of a reading over a layer from the surface down.
    pub fn of(reading: &PenetrometerReading, params: &BeliefParams) -> Self {
        let within: Vec<(f64, f64)> = reading
            .depths_m
            .iter()
            .copied()
            .zip(reading.cone_indices_kpa.iter().copied())
            .filter(|&(depth, _)| depth <= params.layer_depth_m)
            .collect();
        let mean = |values: &mut dyn Iterator<Item = f64>| -> Option<f64> {
            let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
            (count > 0).then(|| sum / f64::from(count)).filter(|&mean| mean > 0.0)
        };
        let cone_index_kpa = mean(&mut within.iter().map(|&(_, kpa)| kpa));
        let line = (within.len() >= 2).then(|| straight_line(&within));
        let roughness = match (line, cone_index_kpa) {
            (Some((_, residual)), Some(kpa)) if within.len() >= 3 => Some(residual / kpa),
            _ => None,
        };
        let hit = within.iter().find(|&&(_, kpa)| kpa > params.refusal_kpa);
        let told = reading.refusal_depth_m.filter(|&depth| depth <= params.layer_depth_m);
        let refusal_depth_m = match (hit.map(|&(depth, _)| depth), told) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
        let sleeve = reading.sleeve_frictions_kpa.as_ref();
        let sleeve_friction_kpa = sleeve.and_then(|frictions| {
            let depths = reading.depths_m.iter().zip(frictions);
            mean(
                &mut depths
                    .filter(|&(&depth, _)| depth <= params.layer_depth_m)
                    .map(|(_, &kpa)| kpa),
            )
        });
        Self {
            cone_index_kpa,
            gradient_kpa_per_m: line.map(|(slope, _)| slope),
            roughness,
            refusal_depth_m,
            sleeve_friction_kpa,
        }
    }
}

/// Slope of the least-squares line through samples of rising depth, and the standard deviation about it.
fn straight_line(samples: &[(f64, f64)]) -> (f64, f64) {
    let count = samples.len() as f64;
    let (depths, values) = samples.iter().fold((0.0, 0.0), |(d, v), s| (d + s.0, v + s.1));
    let (depth, value) = (depths / count, values / count);
    let across: f64 = samples.iter().map(|s| (s.0 - depth).powi(2)).sum();
    let along: f64 = samples.iter().map(|s| (s.0 - depth) * (s.1 - value)).sum();
    let slope = if across > 0.0 { along / across } else { 0.0 };
    let left: f64 = samples
        .iter()
        .map(|s| (s.1 - value - slope * (s.0 - depth)).powi(2))
        .sum();
    (slope, (left / count).sqrt())
}

/// What a penetrometer reading says: by refusal, else by sleeve friction (soil behaviour type), else by its features.
///
/// Refusal within [`BeliefParams::refusal_depth_m`] is rock 0.85 to gravel 0.15. Soil behaviour is the unnormalised index
/// `I = sqrt((3.47 - lg(q/p))^2 + (lg R + 1.22)^2)` of Robertson (2010), R the friction ratio in per cent, with the bounds
/// 1.31, 2.05, 2.60, 2.95 and 3.60 between gravel, sand, sand to silt, silt, clay and organic soil.
///
/// # Errors
/// [`BeliefError::Reading`] for what is not physical, [`BeliefError::Parameter`] for one without a sample in the layer.
pub fn match_profile(reading: &PenetrometerReading, params: &BeliefParams) -> Result<Match, BeliefError> {
    reading.validate()?;
    let features = Features::of(reading, params);
    if features
        .refusal_depth_m
        .is_some_and(|depth| depth <= params.refusal_depth_m)
    {
        let rest = LEAST_LIKELIHOOD;
        return Ok(Match {
            cone_index_kpa: None,
            ..matched([0.15 / 0.85, rest, rest, rest, 1.0, rest])
        });
    }
    let sampled = reading.depths_m.iter().any(|&depth| depth <= params.layer_depth_m);
    if !sampled && features.refusal_depth_m.is_none() {
        return Err(BeliefError::Parameter {
            name: "shallowest sample in metres",
            given: reading.depths_m.first().copied().unwrap_or(f64::NAN),
            allowed: "a sample within the layer that carries the vehicle is needed",
        });
    }
    // A cone that sinks under its own weight is the weakest that can be told from nothing.
    let cone_index_kpa = features.cone_index_kpa.or(sampled.then_some(1.0));
    let found = if let (Some(cone_kpa), Some(sleeve_kpa)) = (features.cone_index_kpa, features.sleeve_friction_kpa) {
        matched(by_behaviour(cone_kpa, sleeve_kpa, &params.confusion))
    } else {
        let by_table = matched(by_features(&features, &params.types));
        match params.matching {
            Matching::Table => by_table,
            Matching::Confusion => match_class(by_table.observed, params)?,
        }
    };
    Ok(Match {
        cone_index_kpa,
        ..found
    })
}

/// What the word of somebody who looked says, who errs as the confusion matrix tells.
///
/// # Errors
/// [`BeliefError::NoClass`] for unknown soil.
pub fn match_class(class: SoilClass, params: &BeliefParams) -> Result<Match, BeliefError> {
    let observed = class_index(class).ok_or(BeliefError::NoClass)?;
    let column = params.confusion.map(|row| row[observed]);
    let greatest = column.iter().copied().fold(0.0, f64::max);
    if greatest <= 0.0 {
        return Err(BeliefError::Parameter {
            name: "sum of a column of confusions",
            given: greatest,
            allowed: "a class that is observed must be possible",
        });
    }
    Ok(Match {
        likelihood: column.map(|chance| chance / greatest),
        observed: class,
        cone_index_kpa: None,
    })
}

/// A match of likelihoods that are not all 0, brought to 1 for the best.
fn matched(likelihood: PerClass) -> Match {
    let best = (0..CLASS_COUNT).fold(0, |best, k| if likelihood[k] > likelihood[best] { k } else { best });
    Match {
        likelihood: likelihood.map(|value| (value / likelihood[best]).max(LEAST_LIKELIHOOD)),
        observed: CLASSES[best],
        cone_index_kpa: None,
    }
}

fn by_behaviour(cone_kpa: f64, sleeve_kpa: f64, confusion: &[PerClass; CLASS_COUNT]) -> PerClass {
    let friction_percent = 100.0 * sleeve_kpa / cone_kpa;
    let index = (3.47 - (cone_kpa / ATMOSPHERE_KPA).log10()).hypot(friction_percent.log10() + 1.22);
    let observed: PerClass = match index {
        i if i < 1.31 => [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        i if i < 2.05 => [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        i if i < 2.60 => [0.0, 0.6, 0.0, 0.4, 0.0, 0.0],
        i if i < 2.95 => [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        i if i < 3.60 => [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        _ => [0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
    };
    let of_row = |row: &PerClass| row.iter().zip(&observed).map(|(chance, share)| chance * share).sum();
    let likelihood = confusion.each_ref().map(of_row);
    if likelihood.iter().any(|&value| value > 0.0) {
        likelihood
    } else {
        observed
    }
}

fn by_features(features: &Features, types: &SoilTypes) -> PerClass {
    let logs = types.0.map(|soil| {
        let mut log = 0.0;
        for (value, spread) in [
            (features.cone_index_kpa.map(f64::ln), soil.cone_index_ln_kpa),
            (features.gradient_kpa_per_m, soil.gradient_kpa_per_m),
            (features.roughness, soil.roughness),
        ] {
            if let Some(value) = value {
                let z = (value - spread.mean) / spread.deviation;
                log -= 0.5 * z * z + spread.deviation.ln();
            }
        }
        log + match features.refusal_depth_m {
            Some(_) => soil.refusal.ln(),
            None => (1.0 - soil.refusal).ln(),
        }
    });
    // Far from every class all likelihoods would vanish: only their ratios count.
    let greatest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    logs.map(|log| (log - greatest).exp())
}
