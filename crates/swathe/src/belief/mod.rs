//! Soil belief: what penetrometer readings and the soil map together say of the ground, by map polygon and by cell.
//!
//! Every polygon ("unit") has a mixture of soil classes under a Dirichlet distribution that starts from the map and that
//! every reading in it moves; near a reading its own likelihood counts directly. Beliefs are worked out from all readings
//! anew, so the order in which they came does not matter. The model is this project's own; the conversion of sleeve
//! friction follows Robertson's soil behaviour type (2010), the strength of soil [`crate::soil`].

mod area;
mod decision;
mod posterior;
mod prior;
mod probe;
mod profile;
mod table;
#[cfg(test)]
mod tests;

use thiserror::Error;

use crate::grid::GridError;
use crate::sensor::ReadingError;
use crate::soil::{SoilClass, SoilError};

pub use area::{Extent, SoilUpdate, Word};
pub use decision::{AGAINST_MAP, Decision, Decisions, Going};
pub use posterior::{Changed, Observation, ReadingId, SoilBelief};
pub use prior::{Prior, Unit};
pub use probe::{ProbePolicy, ProbeValue, RoutePrices, next_probe, probe_value};
pub use profile::{Features, Match, match_class, match_profile};
pub use table::{SoilType, SoilTypes, Spread};

/// Number of classes that a belief tells apart.
pub const CLASS_COUNT: usize = 6;

/// The classes that a belief tells apart, in the order of every array of probabilities.
pub const CLASSES: [SoilClass; CLASS_COUNT] = [
    SoilClass::Gravel,
    SoilClass::Sand,
    SoilClass::Clay,
    SoilClass::Silt,
    SoilClass::Rock,
    SoilClass::None,
];

/// One probability, likelihood or weight per class of [`CLASSES`].
pub type PerClass = [f64; CLASS_COUNT];

/// Place of a class in [`CLASSES`]; `None` for unknown soil.
pub fn class_index(class: SoilClass) -> Option<usize> {
    CLASSES.iter().position(|&known| known == class)
}

/// How a profile without sleeve friction becomes a likelihood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matching {
    /// By the class-conditional distributions of the table.
    Table,
    /// The best match by the table, with the confusion matrix for how often such a match is wrong.
    Confusion,
}

/// How readings change the belief.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// Bayesian update.
    Bayes,
    /// The paper's: the class that is observed replaces the polygon's (most frequent one, of equals the worst to drive
    /// on), or, with a radius in metres, the class within it (nearest reading).
    PaperRelabel {
        /// How far a reading reaches; `None` for its whole polygon.
        radius_m: Option<f64>,
    },
}

/// Parameters of a soil belief. All defaults are estimates of this project.
#[derive(Clone, Debug, PartialEq)]
pub struct BeliefParams {
    /// How readings change the belief; default Bayes.
    pub rule: Rule,
    /// How a bare profile is matched; default by the table.
    pub matching: Matching,
    /// Chance that a class (row) is observed as another (column), in the order of [`CLASSES`]; rows sum to 1.
    pub confusion: [PerClass; CLASS_COUNT],
    /// Share of a mapped polygon that is of its mapped class, 0 to 1; default 0.75. The rest follows the confusion.
    pub purity: f64,
    /// Readings that the map is worth; default 4.
    pub map_weight: f64,
    /// Distance in metres over which a reading's direct say falls to 1/e; default 20.
    pub length_m: f64,
    /// What a reading adds to other polygons of the same map symbol, as a share; default 0.5.
    pub same_symbol_share: f64,
    /// Depth of the layer that carries the vehicle, in metres; default 0.15 (0 to 6 in).
    pub layer_depth_m: f64,
    /// Cone index in kPa from which the ground counts as refusing the cone; default 5000.
    pub refusal_kpa: f64,
    /// Depth in metres within which refusal speaks for rock; default 0.05.
    pub refusal_depth_m: f64,
    /// Share of confidence that the soil is at least as good as its goodness says; default 0.8.
    pub goodness_confidence: f64,
    /// Greatest probability of ground that does not carry the vehicle; default 0.05.
    pub no_go_tolerance: f64,
    /// Spread of true strength about the class's table, as a standard deviation of its logarithm; default 1.
    pub table_spread_ln: f64,
    /// Spread of one measured cone index about the strength of the place, likewise; default 0.3.
    pub reading_spread_ln: f64,
    /// Say of a reading in the strength of its class far away in the same polygon, 0 to 1; default 0.05.
    pub far_strength_weight: f64,
    /// What cone index, gradient and refusal are like on each class.
    pub types: SoilTypes,
}

impl Default for BeliefParams {
    fn default() -> Self {
        // The five classes of the paper are told apart among themselves; one in a hundred looks like no ground.
        let confusion = [
            [0.693, 0.1485, 0.0297, 0.0396, 0.0792, 0.01],
            [0.099, 0.7128, 0.0594, 0.1089, 0.0099, 0.01],
            [0.0198, 0.0594, 0.6534, 0.2475, 0.0099, 0.01],
            [0.0198, 0.1188, 0.2475, 0.594, 0.0099, 0.01],
            [0.1188, 0.0198, 0.0099, 0.0099, 0.8316, 0.01],
            [0.01, 0.05, 0.24, 0.34, 0.01, 0.35],
        ];
        Self {
            rule: Rule::Bayes,
            matching: Matching::Table,
            confusion,
            purity: 0.75,
            map_weight: 4.0,
            length_m: 20.0,
            same_symbol_share: 0.5,
            layer_depth_m: 0.15,
            refusal_kpa: 5000.0,
            refusal_depth_m: 0.05,
            goodness_confidence: 0.8,
            no_go_tolerance: 0.05,
            table_spread_ln: 1.0,
            reading_spread_ln: 0.3,
            far_strength_weight: 0.05,
            types: SoilTypes::default(),
        }
    }
}

impl BeliefParams {
    /// Checks every figure.
    ///
    /// # Errors
    /// [`BeliefError::Parameter`] naming the first that is outside its range.
    pub fn validate(&self) -> Result<(), BeliefError> {
        let share = "it must be from 0 to 1";
        let positive = "it must be finite and above 0";
        let check = |name, given: f64, holds: bool, allowed| {
            if holds {
                Ok(())
            } else {
                Err(BeliefError::Parameter { name, given, allowed })
            }
        };
        for (name, given) in [
            ("purity", self.purity),
            ("share of the same symbol", self.same_symbol_share),
            ("goodness confidence", self.goodness_confidence),
            ("no-go tolerance", self.no_go_tolerance),
            ("far strength weight", self.far_strength_weight),
        ] {
            check(name, given, (0.0..=1.0).contains(&given), share)?;
        }
        for (name, given) in [
            ("map weight", self.map_weight),
            ("length in metres", self.length_m),
            ("depth of the layer in metres", self.layer_depth_m),
            ("refusal cone index in kPa", self.refusal_kpa),
            ("refusal depth in metres", self.refusal_depth_m),
            ("spread of the table", self.table_spread_ln),
            ("spread of a reading", self.reading_spread_ln),
        ] {
            check(name, given, given.is_finite() && given > 0.0, positive)?;
        }
        if let Rule::PaperRelabel { radius_m: Some(given) } = self.rule {
            check("radius in metres", given, given.is_finite() && given > 0.0, positive)?;
        }
        for row in &self.confusion {
            for &given in row {
                check("chance of a confusion", given, (0.0..=1.0).contains(&given), share)?;
            }
            let sum: f64 = row.iter().sum();
            let allowed = "every row must sum to 1";
            check("sum of a row of confusions", sum, (sum - 1.0).abs() <= 1e-6, allowed)?;
        }
        self.types.validate()
    }
}

/// What can be wrong with a soil belief or with what it is told.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum BeliefError {
    /// The layers do not fit.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The moisture is not usable.
    #[error(transparent)]
    Soil(#[from] SoilError),
    /// A reading that no instrument gives.
    #[error(transparent)]
    Reading(#[from] ReadingError),
    /// A parameter outside its range.
    #[error("The {name} of {given} is not usable: {allowed}.")]
    Parameter {
        /// Which one.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// A figure of the table of soil types outside its range.
    #[error("The {name} of {class} is {given}: {allowed}.")]
    Type {
        /// Name of the soil class.
        class: &'static str,
        /// The figure.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// Shares of classes that are no mixture.
    #[error("The shares of soil classes in map unit {unit} are no mixture: they must be at least 0 and sum to 1.")]
    Mixture {
        /// The unit's number.
        unit: u32,
    },
    /// A number of the layer that no unit has, or the same number twice.
    #[error("Map unit {unit} {problem}.")]
    Unit {
        /// The unit's number.
        unit: u32,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// A reading outside the map.
    #[error("The reading at ({x_m}, {y_m}) m lies outside the map.")]
    OutsideMap {
        /// East in metres.
        x_m: f64,
        /// North in metres.
        y_m: f64,
    },
    /// A hand reading of unknown soil.
    #[error("A reading must name a soil class; unknown soil is none.")]
    NoClass,
    /// No reading has this number.
    #[error("There is no reading {id}.")]
    NoReading {
        /// The number given.
        id: u64,
    },
}
