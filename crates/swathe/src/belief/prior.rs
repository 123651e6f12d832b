//! What the map alone says of its polygons.

use super::{BeliefError, BeliefParams, CLASS_COUNT, CLASSES, PerClass, class_index};
use crate::soil::SoilClass;

/// What the map says of a unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Prior {
    /// It is of a class, or unknown.
    Class(SoilClass),
    /// It is a mixture, for instance of components with their shares, in the order of [`CLASSES`].
    Mixture(PerClass),
}

/// One polygon of the soil map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// Its number in the layer of units, above 0.
    pub id: u32,
    /// Number of its map symbol; polygons of one symbol learn from each other. 0 for no symbol.
    pub symbol: u32,
    /// What the map says.
    pub prior: Prior,
}

/// The shares that the map gives a unit.
pub(super) fn prior_of(unit: &Unit, params: &BeliefParams) -> Result<PerClass, BeliefError> {
    match unit.prior {
        Prior::Mixture(shares) => {
            let sum: f64 = shares.iter().sum();
            if shares.iter().all(|&share| share >= 0.0) && (sum - 1.0).abs() <= 1e-6 {
                Ok(shares.map(|share| share / sum))
            } else {
                Err(BeliefError::Mixture { unit: unit.id })
            }
        }
        Prior::Class(class) => {
            let Some(mapped) = class_index(class) else {
                // Not mapped: any of the five kinds of ground.
                return Ok([0.2, 0.2, 0.2, 0.2, 0.2, 0.0]);
            };
            let row = &params.confusion[mapped];
            let others: f64 = (0..CLASS_COUNT).filter(|&k| k != mapped).map(|k| row[k]).sum();
            if others <= 0.0 {
                return Ok(certain_but(mapped, params.purity));
            }
            let rest = 1.0 - params.purity;
            Ok(std::array::from_fn(|k| {
                if k == mapped {
                    params.purity
                } else {
                    rest * row[k] / others
                }
            }))
        }
    }
}

/// A share for the mapped class, the rest evenly among the other kinds of ground.
fn certain_but(mapped: usize, purity: f64) -> PerClass {
    let others = (0..CLASS_COUNT)
        .filter(|&k| k != mapped && CLASSES[k] != SoilClass::None)
        .count();
    std::array::from_fn(|k| match k {
        k if k == mapped => purity,
        k if CLASSES[k] == SoilClass::None => 0.0,
        _ => (1.0 - purity) / others as f64,
    })
}
