//! What the drive knows of the ground and how it learns: soil belief, ranks, nests and the global way, changed in one step.
//!
//! A reading or an update moves the belief; cells whose soil is judged otherwise are ranked anew; nests are opened anew
//! around cells that are suitable no more or again; and the way is repaired over the cells that this has opened, closed or
//! priced otherwise. All of it equals what would be made of the same belief from nothing.

mod nests;
mod outlook;
#[cfg(test)]
mod tests;
mod way;

use rayon::prelude::*;

use crate::belief::{AGAINST_MAP, Going, Observation, PerClass, SoilBelief, SoilUpdate};
use crate::grid::{Cell, GridGeometry, Layer, Position};
use crate::nest::{NestParams, Nests};
use crate::planner::Headings;
use crate::rank::{CellSource, Profile, RankParams, Ranker};
use crate::sensor::PenetrometerReading;
use crate::soil::SoilClass;
use crate::terrain::{allowed_headings, gradient_at};
use crate::vehicle::Vehicle;

use super::params::DriveError;
use nests::NestCells;
use way::{GlobalWay, Known};

pub(super) use outlook::from_nearest;
pub use outlook::{Outlook, ProbeSite};
pub use way::Standing;

/// The map before anything is learnt, with the vehicle and the rules that rank it.
#[derive(Clone, Debug)]
pub struct KnownMap {
    /// Heights of terrain cells in metres, NaN unknown.
    pub elevation_m: Layer<f32>,
    /// Soil class codes of the same cells; `None` where no soil map is at hand.
    pub soil: Option<Layer<u8>>,
    /// Averaged grey levels, for the paper's profiles.
    pub grey: Option<Layer<f32>>,
    /// Cells that are closed whatever the ground.
    pub zones: Option<Layer<bool>>,
    /// The vehicle.
    pub vehicle: Vehicle,
    /// How cells are ranked, moisture among it.
    pub rank: RankParams,
    /// How suitable cells become nests.
    pub nest: NestParams,
    /// Whether the heights are fine enough to tell which returns of a range sensor are ground.
    pub explains_returns: bool,
}

/// What became of the global way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RouteChange {
    /// Cost from where the robot was when it was last asked for, in seconds; `None` without a way.
    pub cost_before: Option<f64>,
    /// Cost from where the robot is now.
    pub cost_after: Option<f64>,
    /// How robot and goal stood to each other.
    pub standing_before: Standing,
    /// How they stand now.
    pub standing: Standing,
    /// Cells of the way.
    pub cells: usize,
    /// Whether the way leads over other cells than the rest of the one before.
    pub is_other: bool,
    /// Whether the search began from nothing.
    pub afresh: bool,
}

/// What a reading or an update has changed.
#[derive(Clone, Debug, PartialEq)]
pub struct Learnt {
    /// Probability of each of [`crate::belief::CLASSES`] where the reading was taken or in the first cell of the area.
    pub probabilities: PerClass,
    /// The class that the reading looks like, or that was told.
    pub class: SoilClass,
    /// Mean cone index in kPa, where it was measured.
    pub cone_index_kpa: Option<f64>,
    /// Cells with another rank: which, the rank before and after.
    pub ranks: Vec<(Cell, u8, u8)>,
    /// Cells that came into a nest, and that left one.
    pub nest_cells: (usize, usize),
    /// Nests there are now; counted only where some cell came or left.
    pub nest_count: Option<usize>,
    /// What became of the global way.
    pub route: RouteChange,
}

/// What is known of the ground.
#[derive(Clone, Debug)]
pub struct Knowledge {
    map: KnownMap,
    belief: SoilBelief,
    going: Going,
    /// Soil codes in use: the map's, or what the belief says against it.
    codes: Layer<u8>,
    ranks: Layer<u8>,
    nests: NestCells,
    /// Directions of sixteen in which the slope of each cell keeps within the vehicle's limits, a bit each.
    slopes: Layer<u16>,
    /// `None` only while a ground is made of them.
    headings: Option<Headings>,
    way: GlobalWay,
    outside: bool,
    /// By how much readings must have raised the odds against the map to close what it leaves open.
    against: f64,
    /// Cells that have another rank since the way was last laid, because more was asked of readings.
    doubted: Vec<(Cell, u8, u8)>,
}

/// Factors of [`AGAINST_MAP`] that are tried in turn where what readings closed cuts the robot off: the least doubtful opens first.
const DOUBTS: [f64; 3] = [2.0, 4.0, 1e9];

/// What changed codes have changed.
#[derive(Default)]
struct Applied {
    /// The codes as they were.
    codes: Vec<(usize, u8)>,
    ranks: Vec<(Cell, u8, u8)>,
    /// Cells that came into a nest or left one.
    toggled: Vec<Cell>,
    /// Cells whose steps may cost something else.
    touched: Vec<Cell>,
}

impl Applied {
    /// Cells with another rank than at first, in one row each.
    fn ranks_between(&mut self) -> Vec<(Cell, u8, u8)> {
        let mut ranks = std::mem::take(&mut self.ranks);
        // Stable: changes of a cell stay in their order.
        ranks.sort_by_key(|change| change.0);
        let mut found: Vec<(Cell, u8, u8)> = Vec::with_capacity(ranks.len());
        for (cell, before, after) in ranks {
            match found.last_mut() {
                Some(last) if last.0 == cell => last.2 = after,
                _ => found.push((cell, before, after)),
            }
        }
        found.retain(|change| change.1 != change.2);
        found
    }

    /// How many cells came into a nest in the end, and how many left one.
    fn nest_cells(&mut self, nests: &NestCells) -> (usize, usize) {
        self.toggled.sort_unstable();
        let mut counts = (0, 0);
        for same in self.toggled.chunk_by(|a, b| a == b).filter(|same| same.len() % 2 == 1) {
            if nests.holds(same[0]) {
                counts.0 += 1;
            } else {
                counts.1 += 1;
            }
        }
        counts
    }
}

impl Knowledge {
    /// What a map and a belief say together. The belief must be of the map's cells; readings in it count.
    ///
    /// # Errors
    /// [`DriveError`] when layers do not fit each other, or the vehicle or a parameter is outside its range.
    pub fn new(map: KnownMap, belief: SoilBelief) -> Result<Self, DriveError> {
        let geometry = map.elevation_m.geometry();
        if belief.geometry() != geometry {
            let (expected, found) = (geometry.cell_count(), belief.geometry().cell_count());
            let what = "the soil belief";
            return Err(
                crate::rank::RankError::Grid(crate::grid::GridError::ShapeMismatch { what, expected, found }).into(),
            );
        }
        let going = Going::new(&map.vehicle, map.rank.moisture_percent, map.rank.soil_table)?;
        let mut codes = Layer::filled(geometry, 0);
        // What can be wrong with layers and rules is told before they are used.
        let unknown = Layer::filled(geometry, 0);
        let mapped = map.soil.as_ref().unwrap_or(&unknown);
        ranker(&map, mapped)?;
        let columns = geometry.columns();
        codes
            .data_mut()
            .par_chunks_mut(columns)
            .enumerate()
            .for_each(|(row, codes)| {
                for (column, code) in codes.iter_mut().enumerate() {
                    *code = judged(&map, &belief, &going, AGAINST_MAP, Cell::new(row, column));
                }
            });
        let ranks = ranker(&map, &codes)?.rank_all();
        let ranks = ranks.cells().data().iter().map(|rank| rank.rank()).collect();
        let ranks = Layer::new(geometry, ranks, "the rank map").map_err(crate::rank::RankError::from)?;
        let nests = NestCells::new(&ranks, map.nest)?;
        let heights = map.elevation_m.view();
        let Vehicle {
            grade_up, grade_down, ..
        } = map.vehicle;
        let side_slope = map.vehicle.max_side_slope();
        let slope = |cell| match map.rank.profile {
            // The literal profile follows the paper's tables alone.
            Profile::Literal => u16::MAX,
            _ => gradient_at(heights, cell).map_or(0, |it| allowed_headings(it, grade_up, grade_down, side_slope)),
        };
        let slopes = geometry.cells().map(slope).collect();
        let slopes = Layer::new(geometry, slopes, "the slopes").map_err(crate::rank::RankError::from)?;
        let mut knowledge = Self {
            belief,
            going,
            codes,
            ranks,
            nests,
            slopes,
            headings: None,
            way: GlobalWay::default(),
            outside: true,
            against: AGAINST_MAP,
            doubted: Vec::new(),
            map,
        };
        let headings = knowledge.known().first_ground().into_headings();
        knowledge.headings = Some(headings);
        Ok(knowledge)
    }

    /// Whether ground outside the nests may be crossed where they do not lead to the goal; default yes.
    #[must_use]
    pub fn with_outside(mut self, outside: bool) -> Self {
        self.outside = outside;
        self
    }

    fn known(&self) -> Known<'_> {
        Known {
            map: &self.map,
            codes: &self.codes,
            ranks: &self.ranks,
            nests: &self.nests,
            outside: self.outside,
        }
    }

    /// Where the cells lie.
    pub fn geometry(&self) -> GridGeometry {
        self.ranks.geometry()
    }

    /// The map with its vehicle and rules.
    pub fn map(&self) -> &KnownMap {
        &self.map
    }

    /// What is believed of the soil.
    pub fn belief(&self) -> &SoilBelief {
        &self.belief
    }

    /// Soil codes in use.
    pub fn codes(&self) -> &Layer<u8> {
        &self.codes
    }

    /// Ranks: 0 unknown, 1 no-go, 2 to 10.
    pub fn ranks(&self) -> &Layer<u8> {
        &self.ranks
    }

    /// Whether a cell lies in a nest.
    pub fn in_nest(&self, cell: Cell) -> bool {
        self.nests.holds(cell)
    }

    /// The nests.
    ///
    /// # Errors
    /// [`DriveError::Nest`] never in practice: the parameters were checked.
    pub fn nests(&self) -> Result<Nests, DriveError> {
        Ok(self.nests.labelled(&self.ranks)?)
    }

    /// Places of the global way from where the robot was when it was last found, empty without one.
    pub fn route(&self) -> &[Position] {
        &self.way.places
    }

    /// Cells of the global way.
    pub fn route_cells(&self) -> &[Cell] {
        &self.way.cells
    }

    /// Cost of the global way in seconds.
    pub fn route_cost(&self) -> Option<f64> {
        self.way.cost
    }

    /// How robot and goal stand to each other.
    pub fn standing(&self) -> Standing {
        self.way.standing
    }

    /// Whether the slope of a cell keeps within the vehicle's limits on a heading, to the nearest of sixteen; unknown ground
    /// does.
    pub fn slope_allows(&self, cell: Cell, heading_rad: f64) -> bool {
        if self.ranks[cell] == 0 {
            return true;
        }
        let allowed = self.slopes[cell];
        // The directions of the steps are not evenly spaced: the nearest is looked up.
        allowed == u16::MAX || allowed >> nearest_heading(heading_rad) & 1 == 1
    }

    /// Whether the slopes of all known cells around a place allow every heading.
    pub(super) fn is_gentle_around(&self, at: Position, reach_m: f64) -> bool {
        let geometry = self.geometry();
        let (row, column) = geometry.fractional(at);
        let reach = reach_m / geometry.cell_size_m();
        let range = |middle: f64, count: usize| {
            let bound = |value: f64| value.clamp(0.0, count as f64) as usize;
            bound((middle - reach).floor())..bound((middle + reach).ceil())
        };
        let columns = range(column, geometry.columns());
        range(row, geometry.rows()).all(|row| {
            let cell = |column| Cell::new(row, column);
            columns
                .clone()
                .all(|column| self.slopes[cell(column)] == u16::MAX || self.ranks[cell(column)] == 0)
        })
    }

    /// Probability of each of [`crate::belief::CLASSES`] at a place, and of ground that does not carry the vehicle; `None`
    /// outside the map.
    pub fn soil_at(&self, at: Position) -> Option<(PerClass, f64)> {
        let cell = self.geometry().cell_at(at)?;
        let decision = self.belief.decide(cell, &self.going);
        Some((self.belief.class_probabilities(cell), decision.no_go_probability))
    }

    /// Finds the global way from a place to a goal.
    pub fn lay(&mut self, at: Position, goal: Position) -> RouteChange {
        self.way.aim(at, goal);
        let found = self.find(&[]);
        let mut applied = Applied::default();
        let change = self.doubt(at, found, &mut applied);
        self.doubted = applied.ranks_between();
        change
    }

    /// Cells whose rank [`Self::lay`] has changed, with the rank before and after: what readings closed on too little evidence to
    /// cut the robot off.
    pub fn doubted(&self) -> &[(Cell, u8, u8)] {
        &self.doubted
    }

    /// Where readings alone cut the robot off from its goal, asks more of them, a step at a time, until a way is open: better
    /// the least doubtful ground than none. Nothing changes where no way opens even so, or where the robot itself stands on
    /// ground that is closed: that it must leave first.
    fn doubt(&mut self, at: Position, found: RouteChange, changed: &mut Applied) -> RouteChange {
        let is_closed = |cell| self.ranks[cell] == 1;
        if found.cost_after.is_some()
            || self.way.standing == Standing::Unasked
            || self.belief.reading_count() == 0
            || self.geometry().cell_at(at).is_none_or(is_closed)
        {
            return found;
        }
        let all: Vec<u32> = (0..self.geometry().cell_count() as u32).collect();
        let mut with = |knowledge: &mut Self, factor: f64| {
            knowledge.against = factor * AGAINST_MAP;
            let recoded = knowledge.recoded(&knowledge.belief, &all);
            let applied = knowledge.apply(&recoded);
            let found = knowledge.find(&applied.touched);
            changed.ranks.extend(applied.ranks);
            changed.toggled.extend(applied.toggled);
            found
        };
        // Whether it helps at all first, by the greatest of them.
        let [first, second, most] = DOUBTS;
        let mut last = with(self, most);
        if last.cost_after.is_none() {
            last = with(self, 1.0);
        } else {
            for factor in [first, second, most] {
                last = with(self, factor);
                if last.cost_after.is_some() {
                    break;
                }
            }
        }
        RouteChange {
            cost_before: found.cost_before,
            standing_before: found.standing_before,
            is_other: true,
            ..last
        }
    }

    /// Takes in a push of the penetrometer by a robot that is at `at`; all that follows from it follows at once.
    ///
    /// # Errors
    /// [`DriveError::Belief`] when the reading is not physical, says nothing or lies outside the map; nothing is changed then.
    pub fn learn(&mut self, reading: &PenetrometerReading, at: Position) -> Result<Learnt, DriveError> {
        let matched = crate::belief::match_profile(reading, self.belief.params())?;
        let changed = self.belief.add(&Observation::Reading(reading.clone()))?;
        let place = Position::new(reading.x_m, reading.y_m);
        let probabilities = match self.geometry().cell_at(place) {
            Some(cell) => self.belief.class_probabilities(cell),
            None => matched.likelihood,
        };
        let told = (probabilities, matched.observed, matched.cone_index_kpa);
        Ok(self.follow(&changed.cells, at, told))
    }

    /// Takes in news of the soil of an area, likewise.
    ///
    /// # Errors
    /// [`DriveError::Belief`] when the update is not usable; nothing is changed then.
    pub fn learn_soil(&mut self, update: &SoilUpdate, at: Position) -> Result<Learnt, DriveError> {
        let cells = self.belief.redraw(update)?;
        let prior = update.shares(self.belief.params())?;
        let likeliest = (0..prior.len()).fold(0, |best, k| if prior[k] > prior[best] { k } else { best });
        let told = (prior, crate::belief::CLASSES[likeliest], update.cone_index_kpa);
        Ok(self.follow(&cells, at, told))
    }

    /// Brings everything in line with the belief in some cells.
    fn follow(&mut self, cells: &[u32], at: Position, told: (PerClass, SoilClass, Option<f64>)) -> Learnt {
        let all: Vec<u32>;
        let mut cells = cells;
        if self.against.total_cmp(&AGAINST_MAP).is_ne() {
            // The doubts of the last time are weighed anew.
            self.against = AGAINST_MAP;
            all = (0..self.geometry().cell_count() as u32).collect();
            cells = &all;
        }
        let recoded = self.recoded(&self.belief, cells);
        let mut applied = self.apply(&recoded);
        self.way.move_to(at);
        let found = self.find(&applied.touched);
        let route = self.doubt(at, found, &mut applied);
        let (gained, lost) = applied.nest_cells(&self.nests);
        let moved = gained + lost > 0;
        let (probabilities, class, cone_index_kpa) = told;
        Learnt {
            probabilities,
            class,
            cone_index_kpa,
            ranks: applied.ranks_between(),
            nest_cells: (gained, lost),
            nest_count: if moved {
                self.nests().ok().map(|nests| nests.count())
            } else {
                None
            },
            route,
        }
    }

    /// Cells whose soil a belief judges otherwise than it is in use, with the new code.
    fn recoded(&self, belief: &SoilBelief, cells: &[u32]) -> Vec<(usize, u8)> {
        let geometry = self.geometry();
        let count = geometry.cell_count();
        let differs = |&index: &u32| {
            let index = index as usize;
            let code = judged(&self.map, belief, &self.going, self.against, geometry.cell(index));
            (code != self.codes.data()[index]).then_some((index, code))
        };
        let inside = cells.par_iter().filter(|&&index| (index as usize) < count);
        inside.filter_map(differs).collect()
    }

    /// Gives cells other soil codes; ranks, nests and open directions follow.
    fn apply(&mut self, recoded: &[(usize, u8)]) -> Applied {
        let geometry = self.geometry();
        let mut done = Applied::default();
        for &(index, code) in recoded {
            let before = std::mem::replace(&mut self.codes.data_mut()[index], code);
            done.codes.push((index, before));
        }
        let (Ok(ranker), false) = (ranker(&self.map, &self.codes), recoded.is_empty()) else {
            // Layers and rules were checked, and codes are those of classes.
            return done;
        };
        for &(index, _) in recoded {
            let cell = geometry.cell(index);
            let rank = ranker.cell_rank(cell).rank();
            let before = std::mem::replace(&mut self.ranks[cell], rank);
            if before != rank {
                done.ranks.push((cell, before, rank));
            }
        }
        let toggled = self.nests.update(done.ranks.iter().map(|change| change.0), &self.ranks);
        done.toggled.clone_from(&toggled);
        done.touched = recoded
            .iter()
            .map(|&(index, _)| geometry.cell(index))
            .chain(toggled)
            .collect();
        done.touched.sort_unstable();
        done.touched.dedup();
        if let Some(headings) = self.headings.take() {
            let known = self.known();
            let mut ground = known.ground(headings, geometry.centre(Cell::new(0, 0)));
            for &cell in &done.touched {
                ground.reconsider(cell, self.nests.holds(cell));
            }
            self.headings = Some(ground.into_headings());
        }
        done
    }

    /// Finds the way again after the steps around some cells have changed.
    fn find(&mut self, touched: &[Cell]) -> RouteChange {
        let mut way = std::mem::take(&mut self.way);
        let headings = self.headings.take();
        let known = self.known();
        let ground = match headings {
            Some(headings) => known.ground(headings, self.geometry().centre(Cell::new(0, 0))),
            None => known.first_ground(),
        };
        let change = way.find(&known, &ground, touched);
        self.headings = Some(ground.into_headings());
        self.way = way;
        change
    }
}

/// The ranker of a map with these soil codes.
fn ranker<'a>(map: &'a KnownMap, codes: &'a Layer<u8>) -> Result<Ranker<'a>, crate::rank::RankError> {
    Ranker::new(
        map.elevation_m.view(),
        Some(codes.view()),
        map.grey.as_ref().map(Layer::view),
        map.zones.as_ref().map(Layer::view),
        &map.vehicle,
        map.rank,
    )
}

/// The soil code that a cell is ranked by.
fn judged(map: &KnownMap, belief: &SoilBelief, going: &Going, against: f64, cell: Cell) -> u8 {
    let code = map.soil.as_ref().map_or(0, |soil| soil[cell]);
    let mapped = SoilClass::from_code(code).unwrap_or(SoilClass::Unknown);
    belief.decide_against(cell, mapped, going, against).code as u8
}

/// The direction of sixteen nearest to a heading.
fn nearest_heading(heading_rad: f64) -> usize {
    let (north, east) = heading_rad.sin_cos();
    let along = |k: usize| crate::terrain::HEADINGS[k].0 * east + crate::terrain::HEADINGS[k].1 * north;
    (0..crate::terrain::HEADINGS.len()).fold(0, |best, k| if along(k) > along(best) { k } else { best })
}
