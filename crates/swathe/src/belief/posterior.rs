//! The belief itself: units, readings, and the probabilities of soil classes.

use std::sync::Arc;

use super::area::{Extent, SoilUpdate, Word};
use super::prior::{Prior, Unit, prior_of};
use super::{
    BeliefError, BeliefParams, CLASS_COUNT, CLASSES, Match, PerClass, Rule, class_index, match_class, match_profile,
};
use crate::grid::{Cell, GridGeometry, Layer, Position};
use crate::sensor::PenetrometerReading;
use crate::soil::{SoilClass, SoilTable};

#[path = "strength.rs"]
mod strength;

/// Nearness below which a reading has no direct say any more: 9.2 lengths away.
const LEAST_NEARNESS: f64 = 1e-4;

/// Lengths within which a reading speaks against the map for itself; farther away its polygon must speak (estimate).
const REACH_LENGTHS: f64 = 2.0;

/// What was learnt at a place.
#[derive(Clone, Debug, PartialEq)]
pub enum Observation {
    /// A push of the penetrometer.
    Reading(PenetrometerReading),
    /// Somebody's word on the class of the soil.
    Class {
        /// Where.
        at: Position,
        /// What was seen.
        class: SoilClass,
    },
}

/// Number of a reading within its belief.
pub type ReadingId = u64;

/// Where a belief has changed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Changed {
    /// The reading that was added or withdrawn.
    pub reading: ReadingId,
    /// Numbers of the units whose belief may differ now, rising; 0 stands for ground without a polygon.
    pub units: Vec<u32>,
    /// Indices of the cells that may differ, rising.
    pub cells: Vec<u32>,
}

/// A reading in its place.
#[derive(Clone, Debug)]
struct Placed {
    id: ReadingId,
    unit: usize,
    at: Position,
    matched: Match,
}

/// A reading as its own unit sees it.
#[derive(Clone, Debug)]
struct Evidence {
    at: Position,
    matched: Match,
    /// What it adds to the unit's mixture, less where readings crowd.
    increment: PerClass,
    /// Logarithm of the measured strength in kPa before remoulding.
    strength_ln: Option<f64>,
}

/// What is known of a unit.
#[derive(Clone, Debug)]
struct UnitBelief {
    symbol: u32,
    mapped_unknown: bool,
    prior: PerClass,
    /// Map weight times prior, and what other polygons of the symbol add.
    base: PerClass,
    evidence: Vec<Evidence>,
    informed: bool,
    /// What an area was said to be, for units that are areas.
    word: Option<Word>,
    /// Logarithm of a strength in kPa before remoulding that was told of all of it.
    strength_ln: Option<f64>,
}

/// What the map's polygons are, shared by copies of a belief.
#[derive(Clone, Debug)]
struct Ground {
    /// Place of each cell's unit in `ids`.
    units: Layer<u32>,
    ids: Vec<u32>,
    cells: Vec<Vec<u32>>,
}

/// What is believed of the soil.
#[derive(Clone, Debug)]
pub struct SoilBelief {
    ground: Arc<Ground>,
    params: Arc<BeliefParams>,
    units: Vec<UnitBelief>,
    readings: Vec<Placed>,
    next_id: ReadingId,
    /// The polygons of the map before anybody drew areas over them.
    mapped: Option<(Arc<Ground>, usize)>,
    /// What was said of areas, in an order of its own.
    areas: Vec<SoilUpdate>,
}

impl SoilBelief {
    /// A belief that knows the map only. `layer` holds the number of each cell's unit, 0 for none.
    ///
    /// # Errors
    /// [`BeliefError`] when a parameter or a mixture is outside its range, a unit is 0, given twice, or missing.
    pub fn new(layer: &Layer<u32>, units: &[Unit], params: BeliefParams) -> Result<Self, BeliefError> {
        params.validate()?;
        let mut sorted = units.to_vec();
        sorted.sort_by_key(|unit| unit.id);
        if let Some(first) = sorted.first().filter(|unit| unit.id == 0) {
            let problem = "is not allowed: 0 means no polygon";
            return Err(BeliefError::Unit {
                unit: first.id,
                problem,
            });
        }
        if let Some(pair) = sorted.windows(2).find(|pair| pair[0].id == pair[1].id) {
            let problem = "is given twice";
            return Err(BeliefError::Unit {
                unit: pair[0].id,
                problem,
            });
        }
        let nothing = Unit {
            id: 0,
            symbol: 0,
            prior: Prior::Class(SoilClass::Unknown),
        };
        sorted.insert(0, nothing);
        let ids: Vec<u32> = sorted.iter().map(|unit| unit.id).collect();
        let mut cells = vec![Vec::new(); ids.len()];
        let mut places = Vec::with_capacity(layer.data().len());
        for (index, unit) in layer.data().iter().enumerate() {
            let Ok(place) = ids.binary_search(unit) else {
                let problem = "is in the layer and not among the units";
                return Err(BeliefError::Unit { unit: *unit, problem });
            };
            cells[place].push(index as u32);
            places.push(place as u32);
        }
        let mut beliefs = Vec::with_capacity(sorted.len());
        for unit in &sorted {
            let prior = prior_of(unit, &params)?;
            beliefs.push(UnitBelief {
                symbol: unit.symbol,
                mapped_unknown: unit.prior == Prior::Class(SoilClass::Unknown),
                prior,
                base: prior.map(|share| params.map_weight * share),
                evidence: Vec::new(),
                informed: false,
                word: None,
                strength_ln: None,
            });
        }
        let ground = Ground {
            units: Layer::new(layer.geometry(), places, "the layer of map units")?,
            ids,
            cells,
        };
        Ok(Self {
            ground: Arc::new(ground),
            params: Arc::new(params),
            units: beliefs,
            readings: Vec::new(),
            next_id: 0,
            mapped: None,
            areas: Vec::new(),
        })
    }

    /// The geometry of the cells.
    pub fn geometry(&self) -> GridGeometry {
        self.ground.units.geometry()
    }

    /// The parameters.
    pub fn params(&self) -> &BeliefParams {
        &self.params
    }

    /// Number of readings that count.
    pub fn reading_count(&self) -> usize {
        self.readings.len()
    }

    /// Takes a reading into account; what has changed carries its number.
    ///
    /// # Errors
    /// [`BeliefError`] when the reading is not physical, says nothing, or lies outside the map.
    pub fn add(&mut self, observation: &Observation) -> Result<Changed, BeliefError> {
        let (unit, id) = self.place(observation)?;
        Ok(self.refresh(unit, id))
    }

    /// Puts a reading in its place; returns its unit and number.
    fn place(&mut self, observation: &Observation) -> Result<(usize, ReadingId), BeliefError> {
        let (at, matched) = match observation {
            Observation::Reading(reading) => (
                Position::new(reading.x_m, reading.y_m),
                match_profile(reading, &self.params)?,
            ),
            Observation::Class { at, class } => (*at, match_class(*class, &self.params)?),
        };
        let Some(cell) = self.geometry().cell_at(at) else {
            let Position { x_m, y_m } = at;
            return Err(BeliefError::OutsideMap { x_m, y_m });
        };
        let unit = self.ground.units[cell] as usize;
        let id = self.next_id;
        self.next_id += 1;
        self.readings.push(Placed { id, unit, at, matched });
        // Sums are taken in an order that belongs to the readings and not to their coming.
        self.readings.sort_by(canonical);
        Ok((unit, id))
    }

    /// The belief that would follow from an observation.
    ///
    /// # Errors
    /// As [`Self::add`].
    pub fn foreseen(&self, observation: &Observation) -> Result<Self, BeliefError> {
        let mut after = self.clone();
        let (unit, _) = after.place(observation)?;
        after.learn_in(unit);
        Ok(after)
    }

    /// Forgets a reading.
    ///
    /// # Errors
    /// [`BeliefError::NoReading`] when there is none of this number.
    pub fn withdraw(&mut self, id: ReadingId) -> Result<Changed, BeliefError> {
        let place = self.readings.iter().position(|reading| reading.id == id);
        let place = place.ok_or(BeliefError::NoReading { id })?;
        let unit = self.readings.remove(place).unit;
        Ok(self.refresh(unit, id))
    }

    /// Probability of each of [`CLASSES`] at a cell; they sum to 1.
    pub fn class_probabilities(&self, cell: Cell) -> PerClass {
        let unit = &self.units[self.ground.units[cell] as usize];
        match self.params.rule {
            Rule::Bayes => self.posterior(unit, self.geometry().centre(cell)),
            Rule::PaperRelabel { radius_m } => {
                relabelled(unit, self.geometry().centre(cell), radius_m).map_or(unit.prior, certain)
            }
        }
    }

    /// Whether the map and every reading are silent about a cell.
    pub(super) fn is_unknown(&self, cell: Cell) -> bool {
        let place = self.ground.units[cell] as usize;
        let unit = &self.units[place];
        if !unit.mapped_unknown {
            return false;
        }
        let at = self.geometry().centre(cell);
        match self.params.rule {
            Rule::PaperRelabel { radius_m } => relabelled(unit, at, radius_m).is_none(),
            Rule::Bayes if place == 0 => unit.evidence.iter().all(|known| self.nearness(known.at, at) == 0.0),
            Rule::Bayes => !unit.informed,
        }
    }

    /// 1 at a reading, falling with distance, 0 where it has no say.
    fn nearness(&self, from: Position, to: Position) -> f64 {
        let near = (-from.distance_m(to) / self.params.length_m).exp();
        if near < LEAST_NEARNESS { 0.0 } else { near }
    }

    fn posterior(&self, unit: &UnitBelief, at: Position) -> PerClass {
        if unit.evidence.is_empty() {
            return normalised(unit.base).unwrap_or(unit.prior);
        }
        let near: Vec<f64> = unit.evidence.iter().map(|known| self.nearness(known.at, at)).collect();
        let mixture = mixture_of(unit, &near);
        let mut found = mixture;
        for (known, &near) in unit.evidence.iter().zip(&near) {
            if near == 0.0 {
                continue; // Its factor is the same for every class.
            }
            let likelihood = &known.matched.likelihood;
            let expected: f64 = mixture.iter().zip(likelihood).map(|(share, value)| share * value).sum();
            let product: PerClass =
                std::array::from_fn(|k| found[k] * (near * likelihood[k] + (1.0 - near) * expected));
            // Readings that contradict the map entirely count without it; those that contradict each other are left out.
            found = normalised(product)
                .or_else(|| (expected == 0.0).then(|| normalised(*likelihood)).flatten())
                .unwrap_or(found);
        }
        found
    }

    /// Works out anew the units that a reading in one of them touches.
    fn refresh(&mut self, unit: usize, reading: ReadingId) -> Changed {
        let touched = self.learn_in(unit);
        let mut cells: Vec<u32> = touched
            .iter()
            .flat_map(|&place| &self.ground.cells[place])
            .copied()
            .collect();
        cells.sort_unstable();
        let units = touched.iter().map(|&place| self.ground.ids[place]).collect();
        Changed { reading, units, cells }
    }

    /// Takes the readings of a unit in; returns the units that learn from it.
    fn learn_in(&mut self, unit: usize) -> Vec<usize> {
        let touched = self.alike(unit);
        self.units[unit].evidence = self.evidence_of(unit);
        self.learn_from_each_other(&touched);
        touched
    }

    /// Works out anew what units of one symbol have from their map and from each other.
    fn learn_from_each_other(&mut self, touched: &[usize]) {
        for &place in touched {
            let mut base = self.units[place].prior.map(|share| self.params.map_weight * share);
            let mut informed = !self.units[place].evidence.is_empty();
            for &other in touched.iter().filter(|&&other| other != place) {
                for known in &self.units[other].evidence {
                    informed = true;
                    for (weight, increment) in base.iter_mut().zip(&known.increment) {
                        *weight += self.params.same_symbol_share * increment;
                    }
                }
            }
            (self.units[place].base, self.units[place].informed) = (base, informed);
        }
    }

    /// The units that learn from a unit, it among them.
    fn alike(&self, unit: usize) -> Vec<usize> {
        let symbol = self.units[unit].symbol;
        let learns = self.params.same_symbol_share > 0.0 && self.params.rule == Rule::Bayes;
        (0..self.units.len())
            .filter(|&other| other == unit || (learns && symbol != 0 && self.units[other].symbol == symbol))
            .collect()
    }

    fn evidence_of(&self, unit: usize) -> Vec<Evidence> {
        let own: Vec<&Placed> = self.readings.iter().filter(|reading| reading.unit == unit).collect();
        let prior = self.units[unit].prior;
        let found = own.iter().map(|reading| {
            let likelihood = reading.matched.likelihood;
            let crowd: f64 = own
                .iter()
                .map(|other| (-reading.at.distance_m(other.at) / self.params.length_m).exp())
                .sum();
            let weighed = normalised(std::array::from_fn(|k| prior[k] * likelihood[k]));
            let share = weighed.or_else(|| normalised(likelihood)).unwrap_or(prior);
            // Ground without a polygon has nothing in common: a reading there speaks for its own place.
            let weight = if unit == 0 { 0.0 } else { 1.0 / crowd };
            Evidence {
                at: reading.at,
                matched: reading.matched,
                increment: share.map(|share| weight * share),
                strength_ln: reading.matched.cone_index_kpa.map(f64::ln),
            }
        });
        found.collect()
    }

    /// Draws an area over the map: from now on its cells are a polygon of their own, with what is said of it in place of what
    /// the map says. Readings inside keep their say. Where areas overlap the latest counts, whatever order they came in.
    /// Returns the indices of the cells whose belief may differ now, rising.
    ///
    /// # Errors
    /// [`BeliefError`] when the update is not usable; the belief is then as it was.
    pub fn redraw(&mut self, update: &SoilUpdate) -> Result<Vec<u32>, BeliefError> {
        let count = self.units.len();
        let (base, base_units) = self
            .mapped
            .get_or_insert_with(|| (Arc::clone(&self.ground), count))
            .clone();
        update.check(&self.geometry(), &base.ids)?;
        let at = self.areas.partition_point(|known| known.order(update).is_le());
        self.areas.insert(at, update.clone());
        let geometry = self.geometry();
        let mut places = base.units.clone();
        let mut ids = base.ids.clone();
        self.units.truncate(base_units);
        for update in &self.areas {
            let number = ids.len() as u32;
            ids.push(ids.last().map_or(1, |last| last + 1));
            let cells: Vec<u32> = match &update.extent {
                Extent::Unit(id) => base
                    .ids
                    .binary_search(id)
                    .map_or_else(|_| Vec::new(), |place| base.cells[place].clone()),
                extent => extent.cells(&geometry),
            };
            for index in cells {
                places.data_mut()[index as usize] = number;
            }
            let prior = update.shares(&self.params)?;
            self.units.push(UnitBelief {
                symbol: 0,
                mapped_unknown: false,
                prior,
                base: prior.map(|share| self.params.map_weight * share),
                evidence: Vec::new(),
                informed: false,
                word: Some(update.word),
                strength_ln: update.cone_index_kpa.map(f64::ln),
            });
        }
        let mut cells = vec![Vec::new(); ids.len()];
        for (index, &place) in places.data().iter().enumerate() {
            cells[place as usize].push(index as u32);
        }
        let before = std::mem::replace(
            &mut self.ground,
            Arc::new(Ground {
                units: places,
                ids,
                cells,
            }),
        );
        Ok(self.place_again(&before, at + base_units))
    }

    /// Brings readings and units in order after the polygons have changed; returns the cells whose belief may differ.
    fn place_again(&mut self, before: &Ground, drawn: usize) -> Vec<u32> {
        let geometry = self.geometry();
        let mut moved = false;
        for reading in &mut self.readings {
            let Some(cell) = geometry.cell_at(reading.at) else {
                continue;
            };
            let unit = self.ground.units[cell] as usize;
            moved |= before.ids[before.units[cell] as usize] != self.ground.ids[unit] || unit >= drawn;
            reading.unit = unit;
        }
        for unit in 0..self.units.len() {
            self.units[unit].evidence = self.evidence_of(unit);
        }
        for unit in 0..self.units.len() {
            self.learn_from_each_other(&self.alike(unit));
        }
        if moved {
            return (0..geometry.cell_count() as u32).collect();
        }
        // Numbers of areas that came later have moved on by one: what matters is what lies in the one that was drawn.
        self.ground.cells[drawn].clone()
    }

    /// What was said of the area that a cell lies in, if of any.
    pub fn word(&self, cell: Cell) -> Option<Word> {
        self.units[self.ground.units[cell] as usize].word
    }

    /// Probability of each class by the map alone, or by what was said of the area.
    pub(super) fn prior(&self, cell: Cell) -> PerClass {
        self.units[self.ground.units[cell] as usize].prior
    }

    /// Whether anything but the map counts at a cell.
    pub(super) fn is_told(&self, cell: Cell) -> bool {
        let unit = &self.units[self.ground.units[cell] as usize];
        unit.informed || !unit.evidence.is_empty() || unit.strength_ln.is_some()
    }

    /// The mixture of a cell's polygon with all that was read in it, where no reading is near enough to speak for the cell
    /// itself; `None` where one is, or where something was said of all the polygon.
    pub(super) fn mixture_far_off(&self, cell: Cell) -> Option<PerClass> {
        let unit = &self.units[self.ground.units[cell] as usize];
        let at = self.geometry().centre(cell);
        let reach_m = self.reach_m();
        let is_near = |known: &Evidence| known.at.distance_m(at) <= reach_m;
        if self.params.rule != Rule::Bayes || unit.strength_ln.is_some() || unit.evidence.iter().any(is_near) {
            return None;
        }
        let mut mixture = unit.base;
        for known in &unit.evidence {
            for (weight, increment) in mixture.iter_mut().zip(&known.increment) {
                *weight += increment;
            }
        }
        normalised(mixture)
    }

    /// How far from a reading it speaks against the map for itself, in metres.
    pub fn reach_m(&self) -> f64 {
        REACH_LENGTHS * self.params.length_m
    }

    /// Number of the map's polygon at a cell, 0 for none; areas drawn over the map have numbers above the map's.
    pub fn unit_at(&self, cell: Cell) -> u32 {
        self.ground.ids[self.ground.units[cell] as usize]
    }

    /// Numbers of the places of all readings that count, in an order of their own.
    pub fn readings(&self) -> impl Iterator<Item = (ReadingId, Position, &Match)> {
        self.readings
            .iter()
            .map(|reading| (reading.id, reading.at, &reading.matched))
    }
}

/// The mixture of a unit without the share of each reading that counts for itself, by its nearness.
fn mixture_of(unit: &UnitBelief, near: &[f64]) -> PerClass {
    let mut mixture = unit.base;
    for (known, near) in unit.evidence.iter().zip(near) {
        for (weight, increment) in mixture.iter_mut().zip(&known.increment) {
            *weight += (1.0 - near) * increment;
        }
    }
    normalised(mixture).unwrap_or(unit.prior)
}

/// The class by the paper's rule, if a reading reaches so far.
fn relabelled(unit: &UnitBelief, at: Position, radius_m: Option<f64>) -> Option<usize> {
    let Some(radius_m) = radius_m else {
        let mut counts = [0_usize; CLASS_COUNT];
        for known in &unit.evidence {
            counts[class_index(known.matched.observed)?] += 1;
        }
        let worse = |k: usize| u8::MAX - CLASSES[k].goodness(SoilTable::Text);
        let none_last = |k: usize| CLASSES[k] == SoilClass::None;
        return (0..CLASS_COUNT)
            .filter(|&k| counts[k] > 0)
            .max_by_key(|&k| (counts[k], none_last(k), worse(k)));
    };
    let distances = unit.evidence.iter().map(|known| (known.at.distance_m(at), known));
    let reached = distances.filter(|(distance, _)| *distance <= radius_m);
    let nearest = reached.min_by(|a, b| a.0.total_cmp(&b.0))?;
    class_index(nearest.1.matched.observed)
}

/// An order of readings that does not know when they came.
fn canonical(one: &Placed, other: &Placed) -> std::cmp::Ordering {
    let places = one.at.x_m.total_cmp(&other.at.x_m);
    let places = places.then(one.at.y_m.total_cmp(&other.at.y_m));
    let pairs = one.matched.likelihood.iter().zip(&other.matched.likelihood);
    let likelihoods = pairs.fold(places, |order, (a, b)| order.then(a.total_cmp(b)));
    let strength = |reading: &Placed| reading.matched.cone_index_kpa.unwrap_or(-1.0);
    likelihoods.then(strength(one).total_cmp(&strength(other)))
}

/// Shares that sum to 1, or nothing when there is nothing to share.
fn normalised(weights: PerClass) -> Option<PerClass> {
    let sum: f64 = weights.iter().sum();
    (sum > 0.0 && sum.is_finite()).then(|| weights.map(|weight| weight / sum))
}

pub(super) fn certain(class: usize) -> PerClass {
    std::array::from_fn(|k| f64::from(u8::from(k == class)))
}
