//! Where a reading pays: the expected saving of route cost, and when to stop and probe.

use super::{BeliefError, CLASS_COUNT, CLASSES, Decisions, Going, Observation, PerClass, SoilBelief};
use crate::grid::Cell;

/// When a robot stops to take a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ProbePolicy {
    /// It never does.
    Never,
    /// After every so many metres.
    EveryMetres(f64),
    /// Where the reading is expected to save most of all that could be taken, if that is more than it costs, in the unit of
    /// route costs.
    WhereItMatters {
        /// What taking a reading costs.
        probe_cost: f64,
    },
    /// At the first of the places on the way where a reading is expected to save more than it costs: what one farther on
    /// tells comes too late for the ground before it.
    WhereItPays {
        /// What taking a reading costs.
        probe_cost: f64,
    },
}

/// Costs of routes over changed soil, in one unit; infinite where there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoutePrices {
    /// The route that would be driven without the reading.
    pub kept: f64,
    /// The best route when the outcome is known.
    pub best: f64,
}

/// What a reading at a cell is worth before it is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeValue {
    /// Expected saving of route cost, at least 0.
    pub expected_saving: f64,
    /// Chance of each observation, in the order of [`CLASSES`].
    pub chances: PerClass,
    /// Saving after each observation.
    pub savings: PerClass,
}

/// Expected saving of route cost by a reading at a cell.
///
/// For each class that may be observed, the belief that would follow is worked out and the caller prices the present route
/// and the best one on the cells whose code would change, given with their new codes. `decisions` are those of the
/// belief as it is. A present route that turns out closed costs `dead_end_cost`, the price of finding that out on the
/// way and driving on from there; so does a world without any route. Prices that are not numbers count as that, too.
///
/// # Errors
/// [`BeliefError::Parameter`] when `dead_end_cost` is not finite or below 0.
pub fn probe_value(
    belief: &SoilBelief,
    decisions: &Decisions,
    cell: Cell,
    going: &Going,
    dead_end_cost: f64,
    mut price: impl FnMut(&[(Cell, u8)]) -> RoutePrices,
) -> Result<ProbeValue, BeliefError> {
    if !(dead_end_cost.is_finite() && dead_end_cost >= 0.0) {
        return Err(BeliefError::Parameter {
            name: "cost of a dead end",
            given: dead_end_cost,
            allowed: "it must be finite and at least 0",
        });
    }
    let known = belief.class_probabilities(cell);
    let confusion = &belief.params().confusion;
    let chances: PerClass =
        std::array::from_fn(|observed| (0..CLASS_COUNT).map(|k| known[k] * confusion[k][observed]).sum());
    let at = belief.geometry().centre(cell);
    let mut savings = [0.0; CLASS_COUNT];
    for (observed, &class) in CLASSES.iter().enumerate() {
        if chances[observed] <= 0.0 {
            continue;
        }
        let mut after = belief.clone();
        let changed = after.add(&Observation::Class { at, class })?;
        let mut outlook = decisions.clone();
        let cells = after.redecide(&mut outlook, &changed, going);
        if cells.is_empty() {
            continue;
        }
        let RoutePrices { kept, best } = price(&cells);
        let finite = |cost: f64| if cost.is_finite() { cost } else { dead_end_cost };
        savings[observed] = (finite(kept) - finite(best)).max(0.0);
    }
    Ok(ProbeValue {
        expected_saving: chances
            .iter()
            .zip(&savings)
            .map(|(chance, saving)| chance * saving)
            .sum(),
        chances,
        savings,
    })
}

/// Where to take the next reading, if at all: `here`, or one of the candidates, which stand in the order in which they are
/// met. It is worth more than a reading costs and is the first of those with the greatest value for
/// [`ProbePolicy::WhereItMatters`], the first of all for [`ProbePolicy::WhereItPays`].
///
/// `since_last_m` is how far the robot has driven since its last reading. `value` is asked by these two alone.
pub fn next_probe(
    policy: ProbePolicy,
    here: Cell,
    since_last_m: f64,
    candidates: &[Cell],
    mut value: impl FnMut(Cell) -> f64,
) -> Option<Cell> {
    match policy {
        ProbePolicy::EveryMetres(metres) => (since_last_m >= metres).then_some(here),
        policy => {
            let place = policy.pick(candidates.iter().map(|&cell| value(cell)));
            place.map(|place| candidates[place])
        }
    }
}

impl ProbePolicy {
    /// Place of the reading to take among the expected savings of all that could be taken, in the order in which they are met.
    pub(crate) fn pick(self, savings: impl IntoIterator<Item = f64>) -> Option<usize> {
        let mut savings = savings.into_iter();
        match self {
            Self::Never | Self::EveryMetres(_) => None,
            Self::WhereItMatters { probe_cost } => {
                let mut best: Option<(usize, f64)> = None;
                for (place, saving) in savings.enumerate() {
                    if saving > best.map_or(probe_cost, |(_, most)| most) {
                        best = Some((place, saving));
                    }
                }
                best.map(|(place, _)| place)
            }
            Self::WhereItPays { probe_cost } => savings.position(|saving| saving > probe_cost),
        }
    }

    /// Checks its figure.
    ///
    /// # Errors
    /// [`BeliefError::Parameter`] for a distance that is not above 0 or a cost below 0.
    pub fn validate(self) -> Result<Self, BeliefError> {
        let (name, given, holds, allowed) = match self {
            Self::Never => return Ok(self),
            Self::EveryMetres(metres) => (
                "distance between readings",
                metres,
                metres > 0.0,
                "it must be above 0 m",
            ),
            Self::WhereItMatters { probe_cost } | Self::WhereItPays { probe_cost } => (
                "cost of a reading",
                probe_cost,
                probe_cost >= 0.0,
                "it must be at least 0",
            ),
        };
        if holds && given.is_finite() {
            Ok(self)
        } else {
            Err(BeliefError::Parameter { name, given, allowed })
        }
    }
}
