//! What others say of the soil of an area while a drive is on.

use std::cmp::Ordering;

use super::posterior::certain;
use super::prior::prior_of;
use super::{BeliefError, BeliefParams, PerClass, Prior, Rule, Unit, class_index};
use crate::grid::{Cell, GridGeometry, Position};
use crate::soil::SoilClass;

/// Greatest cone index in kPa that an instrument gives.
const MOST_KPA: f64 = 100_000.0;

/// Where an update holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Extent {
    /// The polygon of the map with this number.
    Unit(u32),
    /// The cells whose centres lie within a radius, and the cell of the place itself.
    Disc {
        /// The middle.
        at: Position,
        /// The radius in metres, at least 0.
        radius_m: f64,
    },
    /// These cells.
    Cells(Vec<Cell>),
}

/// What is said of the soil.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Word {
    /// It is of a class, as on a map.
    Class(SoilClass),
    /// Probability of each of [`super::CLASSES`].
    Probabilities(PerClass),
}

/// News of the soil of an area: a newer map of it.
#[derive(Clone, Debug, PartialEq)]
pub struct SoilUpdate {
    /// When it was true, in seconds on the drive's clock; where areas overlap the latest counts.
    pub time_s: f64,
    /// Who says so.
    pub source: String,
    /// Where.
    pub extent: Extent,
    /// What.
    pub word: Word,
    /// Cone index in kPa that holds for all of it, above 0 and at most 100 000.
    pub cone_index_kpa: Option<f64>,
}

impl Extent {
    /// Indices of the cells of a disc or a list, rising; a polygon's cells are known to the belief.
    pub(super) fn cells(&self, geometry: &GridGeometry) -> Vec<u32> {
        let mut found: Vec<u32> = match self {
            Self::Unit(_) => Vec::new(),
            Self::Cells(cells) => cells.iter().map(|&cell| geometry.index(cell) as u32).collect(),
            &Self::Disc { at, radius_m } => {
                let size = geometry.cell_size_m();
                let (row, column) = geometry.fractional(at);
                let reach = radius_m / size;
                let range = |middle: f64, most: usize| {
                    let bound = |value: f64| value.clamp(0.0, most as f64) as usize;
                    bound((middle - reach).floor() - 1.0)..bound((middle + reach).ceil() + 1.0)
                };
                let rows = range(row, geometry.rows());
                let columns = range(column, geometry.columns());
                let cells = rows.flat_map(|row| columns.clone().map(move |column| Cell::new(row, column)));
                let inside = |cell: &Cell| geometry.centre(*cell).distance_m(at) <= radius_m;
                let own = geometry.cell_at(at);
                cells
                    .filter(inside)
                    .chain(own)
                    .map(|cell| geometry.index(cell) as u32)
                    .collect()
            }
        };
        found.sort_unstable();
        found.dedup();
        found
    }
}

impl SoilUpdate {
    /// Checks every figure against the map.
    ///
    /// # Errors
    /// [`BeliefError`] naming what is not usable.
    pub(super) fn check(&self, geometry: &GridGeometry, ids: &[u32]) -> Result<(), BeliefError> {
        let refuse = |name, given, allowed| Err(BeliefError::Parameter { name, given, allowed });
        if !self.time_s.is_finite() {
            return refuse("time of the update in seconds", self.time_s, "it must be finite");
        }
        if let Some(given) = self.cone_index_kpa
            && !(given > 0.0 && given <= MOST_KPA)
        {
            return refuse("cone index in kPa", given, "it must be above 0 and at most 100000");
        }
        match self.word {
            Word::Class(class) if class_index(class).is_none() => return Err(BeliefError::NoClass),
            Word::Probabilities(shares) => {
                let sum: f64 = shares.iter().sum();
                if shares.iter().any(|share| share.is_nan() || *share < 0.0) || sum.is_nan() || (sum - 1.0).abs() > 1e-6
                {
                    return refuse("sum of the probabilities", sum, "they must be at least 0 and sum to 1");
                }
            }
            Word::Class(_) => {}
        }
        match &self.extent {
            Extent::Unit(unit) => {
                let known = *unit != 0 && ids.binary_search(unit).is_ok();
                let problem = "is not on the map";
                if known {
                    Ok(())
                } else {
                    Err(BeliefError::Unit { unit: *unit, problem })
                }
            }
            Extent::Disc { at, radius_m } => {
                if !(radius_m.is_finite() && *radius_m >= 0.0) {
                    return refuse("radius in metres", *radius_m, "it must be finite and at least 0");
                }
                let Position { x_m, y_m } = *at;
                if x_m.is_finite() && y_m.is_finite() && !self.extent.cells(geometry).is_empty() {
                    return Ok(());
                }
                Err(BeliefError::OutsideMap { x_m, y_m })
            }
            Extent::Cells(cells) => {
                if cells.is_empty() {
                    return refuse("number of cells", 0.0, "at least one is needed");
                }
                let outside = |cell: &&Cell| cell.row >= geometry.rows() || cell.column >= geometry.columns();
                let Some(cell) = cells.iter().find(outside) else {
                    return Ok(());
                };
                Err(BeliefError::Grid(crate::grid::GridError::OutsideGrid {
                    row: cell.row as i64,
                    column: cell.column as i64,
                    rows: geometry.rows(),
                    columns: geometry.columns(),
                }))
            }
        }
    }

    /// The shares of [`super::CLASSES`] that the area has from now on, before readings count.
    ///
    /// # Errors
    /// [`BeliefError`] for shares that are no mixture, or unknown soil.
    pub fn shares(&self, params: &BeliefParams) -> Result<PerClass, BeliefError> {
        let prior = match (self.word, params.rule) {
            (Word::Probabilities(shares), _) => Prior::Mixture(shares),
            (Word::Class(class), Rule::PaperRelabel { .. }) => match class_index(class) {
                Some(index) => Prior::Mixture(certain(index)),
                None => return Err(BeliefError::NoClass),
            },
            (Word::Class(class), Rule::Bayes) => Prior::Class(class),
        };
        let (id, symbol) = (0, 0);
        prior_of(&Unit { id, symbol, prior }, params)
    }

    /// An order that belongs to the updates and not to their coming: by time, then by what they say.
    pub(super) fn order(&self, other: &Self) -> Ordering {
        let times = self.time_s.total_cmp(&other.time_s);
        times
            .then_with(|| self.source.cmp(&other.source))
            .then_with(|| format!("{self:?}").cmp(&format!("{other:?}")))
    }
}
