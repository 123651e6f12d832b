//! From probabilities to what a vehicle may count on: a soil code for ranking, and go or no-go.

use rayon::prelude::*;

use super::{BeliefError, CLASS_COUNT, CLASSES, Changed, PerClass, SoilBelief, Word, class_index};
use crate::grid::{Cell, Layer};
use crate::soil::{SoilClass, SoilTable, check_moisture};
use crate::vehicle::Vehicle;

/// What the ground has to carry, and how strong soil is today.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Going {
    needed_kpa: f64,
    moisture_percent: f64,
    table: SoilTable,
    /// Strength of each class by its table; infinite on rock, 0 where there is no ground.
    strengths_kpa: [f64; CLASS_COUNT],
}

/// What is decided for one cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// The class that ranking should take.
    ///
    /// Where the ground carries the vehicle, the best class that is no better than `goodness` and carries it by the table;
    /// where it does not, the likeliest one that fails, or no ground when only a measurement speaks against it. Ranks
    /// made from these codes at the same moisture have the gate in them.
    pub code: SoilClass,
    /// Greatest goodness that the soil reaches with the confidence asked for; 3 for unknown soil.
    pub goodness: u8,
    /// Probability that the ground does not carry the vehicle; rock always does, no ground never.
    pub no_go_probability: f64,
    /// Whether that is no more than what is tolerated.
    pub go: bool,
}

/// What is decided for every cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Decisions {
    /// Soil codes, to be ranked like a soil layer.
    pub codes: Layer<u8>,
    /// Whether the ground is too likely not to carry the vehicle.
    pub no_go: Layer<bool>,
}

impl Going {
    /// What a vehicle needs for one pass, on soil of a moisture in per cent of the dry weight.
    ///
    /// # Errors
    /// [`BeliefError::Soil`] for a moisture outside 1 to 200 %.
    pub fn new(vehicle: &Vehicle, moisture_percent: f64, table: SoilTable) -> Result<Self, BeliefError> {
        Self::with_cone_index(vehicle.cone_index().one_pass_kpa, moisture_percent, table)
    }

    /// The same for a vehicle cone index in kPa.
    ///
    /// # Errors
    /// [`BeliefError`] for a moisture outside 1 to 200 %, or a cone index that is not finite and above 0.
    pub fn with_cone_index(needed_kpa: f64, moisture_percent: f64, table: SoilTable) -> Result<Self, BeliefError> {
        check_moisture(moisture_percent)?;
        if !(needed_kpa.is_finite() && needed_kpa > 0.0) {
            return Err(BeliefError::Parameter {
                name: "vehicle cone index in kPa",
                given: needed_kpa,
                allowed: "it must be finite and above 0",
            });
        }
        let strengths_kpa = CLASSES.map(|class| match class {
            SoilClass::None => 0.0,
            class => class.rating_cone_index_kpa(moisture_percent).unwrap_or(f64::INFINITY),
        });
        Ok(Self {
            needed_kpa,
            moisture_percent,
            table,
            strengths_kpa,
        })
    }

    /// The vehicle cone index in kPa.
    pub fn needed_kpa(&self) -> f64 {
        self.needed_kpa
    }

    /// The moisture in per cent of the dry weight.
    pub fn moisture_percent(&self) -> f64 {
        self.moisture_percent
    }

    fn carries_by_table(&self, class: usize) -> bool {
        self.strengths_kpa[class] >= self.needed_kpa
    }

    /// Chance of each class that it does not carry the vehicle, by its table: 0 or 1.
    fn fails_by_table(&self) -> PerClass {
        std::array::from_fn(|k| if self.carries_by_table(k) { 0.0 } else { 1.0 })
    }

    /// Probability of a goodness of at least `least`.
    fn at_least(&self, chances: &PerClass, least: u8) -> f64 {
        let good = (0..CLASS_COUNT).filter(|&k| CLASSES[k].goodness(self.table) >= least);
        good.map(|k| chances[k]).sum()
    }

    /// The best class that is no better than a goodness and carries the vehicle by the table.
    fn best_within(&self, chances: &PerClass, goodness: u8) -> SoilClass {
        let fits = |k: &usize| self.carries_by_table(*k) && CLASSES[*k].goodness(self.table) <= goodness;
        let goodness_of = |k: usize| CLASSES[k].goodness(self.table);
        let best = (0..CLASS_COUNT).filter(fits).max_by(|&a, &b| {
            goodness_of(a)
                .cmp(&goodness_of(b))
                .then(chances[a].total_cmp(&chances[b]))
        });
        best.map_or(SoilClass::Rock, |k| CLASSES[k])
    }

    /// The likeliest class that does not carry the vehicle, or no ground when only a measurement speaks against it.
    fn likeliest_that_fails(&self, chances: &PerClass, fails: &PerClass) -> SoilClass {
        let failing = |k: usize| chances[k] * fails[k];
        let likeliest = (0..CLASS_COUNT)
            .filter(|&k| fails[k] > 0.0)
            .max_by(|&a, &b| failing(a).total_cmp(&failing(b)));
        likeliest
            .filter(|&k| !self.carries_by_table(k))
            .map_or(SoilClass::None, |k| CLASSES[k])
    }
}

/// By how much readings must have raised the odds of ground that does not carry against the map's before they close it
/// (estimate).
pub const AGAINST_MAP: f64 = 2.0;

/// Probability of ground that does not carry from which readings close it however much is asked of them.
const LIKELIER_THAN_NOT: f64 = 0.5;

fn odds(chance: f64) -> f64 {
    chance / (1.0 - chance).max(1e-12)
}

/// Probability of ground that does not carry the vehicle, of classes with a chance each that they do not.
fn risk(chances: &PerClass, fails: &PerClass) -> f64 {
    let failing = chances.iter().zip(fails).map(|(chance, fails)| chance * fails);
    failing.sum::<f64>().clamp(0.0, 1.0)
}

impl SoilBelief {
    /// What a vehicle may count on at a cell.
    pub fn decide(&self, cell: Cell, going: &Going) -> Decision {
        if self.is_unknown(cell) {
            return Decision {
                code: SoilClass::Unknown,
                goodness: SoilClass::Unknown.goodness(going.table),
                no_go_probability: 0.0,
                go: true,
            };
        }
        let chances = self.class_probabilities(cell);
        self.decide_by(&chances, &self.fails(cell, going), going)
    }

    /// Chance of each class at a cell that it does not carry the vehicle.
    fn fails(&self, cell: Cell, going: &Going) -> PerClass {
        let failing = self.failing(cell, &going.strengths_kpa, going.needed_kpa);
        std::array::from_fn(|k| match CLASSES[k] {
            SoilClass::Rock => 0.0,
            SoilClass::None => 1.0,
            _ => failing[k],
        })
    }

    fn decide_by(&self, chances: &PerClass, fails: &PerClass, going: &Going) -> Decision {
        let no_go_probability = risk(chances, fails);
        let go = no_go_probability <= self.params().no_go_tolerance;
        // Rounding must not take a certain class its goodness.
        let confidence = self.params().goodness_confidence - 1e-12;
        let reached = |least: &u8| going.at_least(chances, *least) >= confidence;
        let goodness = (2..=5).rev().find(reached).unwrap_or(1);
        let code = if go {
            going.best_within(chances, goodness)
        } else {
            going.likeliest_that_fails(chances, fails)
        };
        Decision {
            code,
            goodness,
            no_go_probability,
            go,
        }
    }

    /// The cone index in kPa that a push on a class of [`CLASSES`] is expected to find at a cell today: its strength by
    /// moisture and what was measured, before remoulding. `None` for rock, no ground and places beyond the last class.
    pub fn expected_cone_index_kpa(&self, cell: Cell, class: usize, going: &Going) -> Option<f64> {
        let soil = self.params().types.0.get(class)?;
        let table_kpa = going.strengths_kpa[class];
        let is_measured = table_kpa.is_finite() && table_kpa > 0.0;
        is_measured.then(|| self.strength_kpa(cell, class, table_kpa) / soil.remoulding_index)
    }

    /// What a vehicle may count on at a cell that a soil map says to be of a class, to be ranked like the map.
    ///
    /// Where nothing was measured or told the map's word stands, as a plan takes it. What was measured must speak against
    /// the map before its word is left: where the class, or a better one, is no less likely than by the map alone, and
    /// ground that does not carry is no likelier, the map's class stands, or the better one that the belief allows. Beyond
    /// [`Self::reach_m`] of every reading in its polygon the map's word stands as long as the polygon's mixture holds the class
    /// or better ones for likelier than not. Else it is as [`Self::decide`] says: no-go above the tolerance, and the goodness
    /// that is reached with confidence.
    pub fn decide_beside(&self, cell: Cell, mapped: SoilClass, going: &Going) -> Decision {
        self.decide_against(cell, mapped, going, AGAINST_MAP)
    }

    /// The same where more is asked of the readings before they close what the map leaves open: the odds must have risen by
    /// another factor than [`AGAINST_MAP`]. Ground that more likely than not does not carry is closed whatever is asked.
    pub fn decide_against(&self, cell: Cell, mapped: SoilClass, going: &Going, against: f64) -> Decision {
        let (mapped, drawn) = match self.word(cell) {
            None => (mapped, false),
            Some(Word::Class(class)) => (class, true),
            Some(Word::Probabilities(_)) => return self.decide(cell, going),
        };
        let stays = |no_go_probability: f64, go: bool| Decision {
            code: mapped,
            goodness: mapped.goodness(going.table),
            no_go_probability,
            go,
        };
        let index = class_index(mapped);
        let carries = index.is_none_or(|k| going.carries_by_table(k));
        if !self.is_told(cell) {
            let by_map = if index.is_none() && !drawn {
                0.0
            } else {
                risk(&self.prior(cell), &going.fails_by_table())
            };
            return stays(by_map, carries);
        }
        let Some(class) = index else {
            return self.decide(cell, going);
        };
        if let Some(mixture) = self.mixture_far_off(cell) {
            // One reading speaks for its surroundings, not for a polygon as large as the map.
            let least = mapped.goodness(going.table);
            let upholds =
                |k: usize| k == class || (going.carries_by_table(k) && CLASSES[k].goodness(going.table) >= least);
            let upheld: f64 = (0..CLASS_COUNT).filter(|&k| upholds(k)).map(|k| mixture[k]).sum();
            if upheld > 0.5 {
                return stays(risk(&mixture, &going.fails_by_table()), carries);
            }
        }
        let (chances, prior) = (self.class_probabilities(cell), self.prior(cell));
        let fails = self.fails(cell, going);
        let found = self.decide_by(&chances, &fails, going);
        let by_map = risk(&prior, &going.fails_by_table());
        let risen = odds(found.no_go_probability) > against.max(1.0) * odds(by_map) + 1e-12;
        let stands = !risen && (found.no_go_probability < LIKELIER_THAN_NOT || found.no_go_probability <= by_map);
        let go = found.go || (carries && stands);
        if !go {
            return if carries {
                found
            } else {
                stays(found.no_go_probability, false)
            };
        }
        let least = mapped.goodness(going.table);
        let confirmed = carries && going.at_least(&chances, least) >= going.at_least(&prior, least) - 1e-12;
        if confirmed && found.goodness <= least {
            return stays(found.no_go_probability, true);
        }
        Decision {
            code: going.best_within(&chances, found.goodness),
            go,
            ..found
        }
    }

    /// Soil codes to rank by, beside a map: [`Self::decide_beside`] of every cell, rows in parallel.
    pub fn codes_beside(&self, mapped: &Layer<u8>, going: &Going) -> Layer<u8> {
        let geometry = self.geometry();
        let mut codes = Layer::filled(geometry, 0_u8);
        let rows = codes.data_mut().par_chunks_mut(geometry.columns()).enumerate();
        rows.for_each(|(row, codes)| {
            for (column, code) in codes.iter_mut().enumerate() {
                let cell = Cell::new(row, column);
                let class = SoilClass::from_code(mapped[cell]).unwrap_or(SoilClass::Unknown);
                *code = self.decide_beside(cell, class, going).code as u8;
            }
        });
        codes
    }

    /// What a vehicle may count on at every cell, rows in parallel.
    pub fn decide_all(&self, going: &Going) -> Decisions {
        let geometry = self.geometry();
        let mut codes = Layer::filled(geometry, 0_u8);
        let mut no_go = Layer::filled(geometry, false);
        let columns = geometry.columns();
        let rows = codes.data_mut().par_chunks_mut(columns);
        let rows = rows.zip(no_go.data_mut().par_chunks_mut(columns)).enumerate();
        rows.for_each(|(row, (codes, no_go))| {
            for (column, (code, closed)) in codes.iter_mut().zip(no_go).enumerate() {
                let decision = self.decide(Cell::new(row, column), going);
                (*code, *closed) = (decision.code as u8, !decision.go);
            }
        });
        Decisions { codes, no_go }
    }

    /// Brings decisions up to date after a change; gives the cells whose soil code differs now, with the new code.
    ///
    /// Decisions on another grid are made anew from nothing.
    pub fn redecide(&self, decisions: &mut Decisions, changed: &Changed, going: &Going) -> Vec<(Cell, u8)> {
        let geometry = self.geometry();
        if decisions.codes.geometry() != geometry || decisions.no_go.geometry() != geometry {
            *decisions = self.decide_all(going);
            let cells = decisions.codes.data().iter().enumerate();
            return cells.map(|(index, &code)| (geometry.cell(index), code)).collect();
        }
        let differs = |&index: &u32| {
            let cell = geometry.cell(index as usize);
            let found = self.decide(cell, going);
            let same = decisions.codes[cell] == found.code as u8 && decisions.no_go[cell] != found.go;
            (!same).then_some((cell, found))
        };
        let inside: Vec<(Cell, Decision)> = changed
            .cells
            .par_iter()
            .filter(|&&index| (index as usize) < geometry.cell_count())
            .filter_map(differs)
            .collect();
        let mut other = Vec::with_capacity(inside.len());
        for (cell, found) in inside {
            let code = found.code as u8;
            if decisions.codes[cell] != code {
                other.push((cell, code));
            }
            decisions.codes[cell] = code;
            decisions.no_go[cell] = !found.go;
        }
        other
    }
}
