//! The ground as the vehicle feels it: which steps its limits allow and what each costs.
//!
//! One evaluator serves edges of the search, shortcuts and the finished route: heights between cell centres are
//! bilinear, a straight segment is cut at cell borders, and each piece has the grade of its ends, the soil of its cell and
//! the speed that power, soil, braking distance and the vehicle itself allow. Limits hold twice: for the grade of every
//! piece, and for pitch and roll of Horn's gradient of every cell that is crossed. They do not depend on the objective:
//! what is closed to the quickest way is closed to every other.

mod facts;
mod headings;
mod limits;
mod motion;
mod objective;
mod pricing;
mod template;

use rayon::prelude::*;

use crate::grid::{Cell, GridGeometry, Layer, LayerView, Position, SIXTEEN, Step, pieces, swept_cells};
use crate::nest::BitRows;
use crate::soil::{SoilClass, Trafficability};
use crate::terrain::gradient_at;
use crate::vehicle::Vehicle;

use super::search::StepGraph;
use limits::Limits;
use motion::{energy_j, speed_mps};
use pricing::Pricing;
use template::{Template, bilinear};

pub use facts::{Obstacle, SegmentFacts};
pub use headings::Headings;
pub(super) use motion::cost_per_m;
pub use objective::Objective;

/// Cost factor of suitable cells outside the nests, where they may be crossed at all.
pub const BRIDGE_FACTOR: f64 = 3.0;

/// The graph of directed steps over open cells.
pub struct Ground<'a> {
    elevation_m: LayerView<'a, f32>,
    soil: Option<LayerView<'a, u8>>,
    vehicle: &'a Vehicle,
    soils: [Trafficability; 7],
    limits: Limits,
    pricing: Pricing<'a>,
    /// Allowed directions of each open cell; 0 is closed.
    headings: Layer<u16>,
    /// Soil codes of open cells, a bit each.
    soils_met: u8,
    bridged: Option<BitRows>,
    radius_m: f64,
    templates: Vec<Template>,
    /// Grades at which the speed on each soil is the soil's own.
    steady: [[f64; 2]; 7],
    /// No piece is quicker than this on any open cell.
    fastest_mps: f64,
    /// Rows and columns that a template reaches beyond the cell.
    reach: usize,
    goal: Position,
    /// Whether every way costs what the way back along it costs.
    reversed: bool,
}

impl<'a> Ground<'a> {
    /// The ground of open cells, on which time is what a way costs. `bridged` marks the open cells that are no nest.
    pub fn new(
        elevation_m: LayerView<'a, f32>,
        soil: Option<LayerView<'a, u8>>,
        vehicle: &'a Vehicle,
        moisture_percent: f64,
        is_open: impl Fn(usize) -> bool + Sync,
        bridged: Option<BitRows>,
        goal: Position,
    ) -> Self {
        let geometry = elevation_m.geometry();
        let soils = SoilClass::ALL.map(|class| Trafficability::of(vehicle, class, moisture_percent));
        let limits = Limits::new(vehicle);
        let mut headings = Layer::filled(geometry, 0);
        let columns = geometry.columns();
        let soils_met = headings
            .data_mut()
            .par_chunks_mut(columns)
            .enumerate()
            .map(|(row, out)| {
                let mut met = 0u8;
                for (column, allowed) in out.iter_mut().enumerate() {
                    if !is_open(row * columns + column) {
                        continue;
                    }
                    let cell = Cell::new(row, column);
                    if let Some(gradient) = gradient_at(elevation_m, cell) {
                        let code = soil.map_or(0, |soil| soil[cell]);
                        *allowed = limits.headings(gradient, &soils[usize::from(code)]);
                        met |= 1 << code;
                    }
                }
                met
            })
            .reduce(|| 0, |a, b| a | b);
        let known = Headings {
            allowed: headings,
            soils_met,
        };
        let mut ground = Self::on(elevation_m, soil, vehicle, moisture_percent, known, goal);
        ground.bridged = bridged;
        ground
    }

    /// The same ground where a way costs what an objective says. What weighs risk needs [`Self::with_exposure`] too.
    #[must_use]
    pub fn with_objective(mut self, objective: Objective) -> Self {
        self.pricing = Pricing::new(self.vehicle, &self.soils, objective);
        self
    }

    /// The same ground with the exposure of cells to no-go ground, 0 to 1.
    #[must_use]
    pub fn with_exposure(mut self, exposure: impl Fn(Cell) -> f64 + 'a) -> Self {
        self.pricing.exposure = Some(Box::new(exposure));
        self
    }

    /// The same ground where every cell multiplies the cost by a factor of at least 0 and is closed where that is not
    /// finite. Call it after [`Self::with_objective`].
    #[must_use]
    pub fn with_factor(mut self, factor: LayerView<'a, f32>) -> Self {
        let mut least = f32::INFINITY;
        for (allowed, &factor) in self.headings.data_mut().iter_mut().zip(factor.data()) {
            if !factor.is_finite() {
                *allowed = 0;
            } else if *allowed != 0 {
                least = least.min(factor);
            }
        }
        let least = if least.is_finite() { f64::from(least) } else { 0.0 };
        self.pricing.multiply(factor, least);
        self
    }

    /// The same ground seen the other way round: from `a` to `b` costs what from `b` to `a` costs on this one, and is
    /// allowed where that is. `goal` is the place that bounds are about.
    #[must_use]
    pub fn reversed(mut self, goal: Position) -> Self {
        self.reversed = !self.reversed;
        self.goal = goal;
        self
    }

    /// Least cost per metre of level distance anywhere, climbing left out.
    pub fn least_cost_per_m(&self) -> f64 {
        self.pricing.flat_per_m
    }

    /// Nothing that covers this level distance from `a`'s height to `b`'s can cost less; `run_m` is at least their
    /// distance.
    pub fn least_cost(&self, a: Position, b: Position, run_m: f64) -> f64 {
        let rise_m = if self.pricing.counts_energy() {
            self.height_m(b) - self.height_m(a)
        } else {
            0.0
        };
        self.pricing.least(run_m, if self.reversed { -rise_m } else { rise_m })
    }

    /// What climbing adds at least to the cost of a step of this level length, as far as is known without looking at it.
    pub(super) fn least_climb(&self, from: Cell, to: Cell, run_m: f64) -> f64 {
        self.pricing.climb(run_m, self.rise_m(from, to))
    }

    /// The objective.
    pub(super) fn objective(&self) -> &Objective {
        &self.pricing.objective
    }

    /// The distance in metres from which no-go ground counts.
    pub(super) fn risk_reach_m(&self) -> f64 {
        let cell_size_m = self.geometry().cell_size_m();
        self.pricing.objective.reach_m(self.vehicle, cell_size_m)
    }

    /// Whether a cell is open and the vehicle's circle at its centre touches open cells only.
    pub fn is_clear(&self, cell: Cell) -> bool {
        let centre = self.geometry().centre(cell);
        self.is_open(cell)
            && swept_cells(&self.geometry(), centre, centre, self.radius_m, |near| {
                near.is_some_and(|near| self.is_open(near))
            })
    }

    /// The cells that the vehicle touches on a step, as steps from where it begins.
    pub(super) fn swept(&self, step: usize) -> &[Step] {
        &self.templates[step].swept
    }

    /// The limit that closes a cell to a heading, given as a unit vector to the east and north.
    pub(super) fn limit_at(&self, cell: Cell, (east, north): (f64, f64)) -> Option<Obstacle> {
        let gradient = gradient_at(self.elevation_m, cell)?;
        let sign = if self.reversed { -1.0 } else { 1.0 };
        let soil = &self.soils[self.soil_code(cell)];
        self.limits
            .broken(cell, 0.0, gradient, (sign * east, sign * north), soil)
    }

    fn is_open(&self, cell: Cell) -> bool {
        self.headings[cell] != 0
    }

    /// What driving straight from `a` to `b` costs. Risk is told where the objective weighs it.
    ///
    /// # Errors
    /// The [`Obstacle`] that makes it impossible, the first along the way.
    pub fn segment(&self, a: Position, b: Position) -> Result<SegmentFacts, Obstacle> {
        self.segment_beside(a, b, self.pricing.exposure.as_deref())
    }

    /// The same with the exposure of cells to no-go ground.
    pub(super) fn segment_beside(
        &self,
        a: Position,
        b: Position,
        exposure: Option<&dyn Fn(Cell) -> f64>,
    ) -> Result<SegmentFacts, Obstacle> {
        let (a, b) = if self.reversed { (b, a) } else { (a, b) };
        let geometry = self.geometry();
        let mut obstacle = None;
        swept_cells(&geometry, a, b, self.radius_m, |near| {
            obstacle = match near {
                None => Some(Obstacle::MapEdge),
                Some(cell) if !self.is_open(cell) => Some(Obstacle::Closed(cell)),
                Some(_) => None,
            };
            obstacle.is_none()
        });
        if let Some(obstacle) = obstacle {
            return Err(obstacle);
        }
        let run_m = a.distance_m(b);
        let mut facts = SegmentFacts {
            grade_max: f64::NEG_INFINITY,
            grade_min: f64::INFINITY,
            ..SegmentFacts::default()
        };
        if run_m == 0.0 {
            return Ok(SegmentFacts::default());
        }
        let heading = ((b.x_m - a.x_m) / run_m, (b.y_m - a.y_m) / run_m);
        let mut height_m = self.height_m(a);
        let complete = pieces(&geometry, a, b, |piece| {
            let next_m = self.height_m(a.towards(b, piece.end));
            let piece_m = run_m * (piece.end - piece.start);
            if piece_m > 0.0 {
                let rise_m = next_m - height_m;
                let at = exposure.map_or(0.0, |exposure| exposure(piece.cell));
                obstacle = self
                    .note_limits(piece.cell, heading, rise_m / piece_m, &mut facts)
                    .or_else(|| self.add(piece.cell, piece_m, rise_m, at, &mut facts));
            }
            height_m = next_m;
            obstacle.is_none()
        });
        match obstacle {
            Some(obstacle) => Err(obstacle),
            None if complete => Ok(facts),
            None => Err(Obstacle::MapEdge),
        }
    }

    /// Checks the limits of a piece and notes its grades.
    fn note_limits(&self, cell: Cell, heading: (f64, f64), grade: f64, facts: &mut SegmentFacts) -> Option<Obstacle> {
        let gradient = gradient_at(self.elevation_m, cell)?;
        let soil = &self.soils[self.soil_code(cell)];
        let broken = self.limits.broken(cell, grade, gradient, heading, soil);
        if broken.is_none() {
            facts.grade_max = facts.grade_max.max(grade);
            facts.grade_min = facts.grade_min.min(grade);
            facts.side_slope_max = facts.side_slope_max.max(gradient.across(heading.0, heading.1).abs());
        }
        broken
    }

    /// Adds cost, time, energy and lengths of a piece.
    fn add(&self, cell: Cell, run_m: f64, rise_m: f64, exposure: f64, facts: &mut SegmentFacts) -> Option<Obstacle> {
        let code = self.soil_code(cell);
        let soil = &self.soils[code];
        let grade = rise_m / run_m;
        let Some(speed_mps) = speed_mps(self.vehicle, soil, grade) else {
            return Some(Obstacle::Braking(cell, grade));
        };
        let length_m = run_m.hypot(rise_m);
        let time_s = length_m / speed_mps;
        let energy_j = energy_j(self.vehicle, soil, grade, length_m, time_s);
        let cost = self.pricing.cost(cell, time_s, || energy_j, || exposure);
        facts.length_m += length_m;
        facts.time_s += time_s;
        facts.risk_s += exposure * time_s;
        if self.is_bridged(cell) {
            facts.cost += BRIDGE_FACTOR * cost;
            facts.bridged_m += run_m;
        } else {
            facts.cost += cost;
        }
        facts.energy_j += energy_j;
        facts.climb_m += rise_m.max(0.0);
        facts.descent_m += (-rise_m).max(0.0);
        facts.soil_m[code] += run_m;
        None
    }

    fn is_bridged(&self, cell: Cell) -> bool {
        self.bridged.as_ref().is_some_and(|bridged| bridged.get(cell))
    }

    fn soil_code(&self, cell: Cell) -> usize {
        self.soil.map_or(0, |soil| usize::from(soil[cell]))
    }

    /// Height at a position: bilinear between the known centres around it, weights of unknown ones shared out.
    fn height_m(&self, position: Position) -> f64 {
        let geometry = self.geometry();
        let (row, column) = geometry.fractional(position);
        let (mut sum, mut total) = (0.0, 0.0);
        for (rows, columns, weight) in bilinear(row, column) {
            if let Some(cell) = geometry.checked(rows, columns) {
                let height = f64::from(self.elevation_m[cell]);
                if height.is_finite() {
                    sum += weight * height;
                    total += weight;
                }
            }
        }
        sum / total
    }

    /// Rise from one cell to another as it is driven.
    fn rise_m(&self, from: Cell, to: Cell) -> f64 {
        let rise_m = f64::from(self.elevation_m[to]) - f64::from(self.elevation_m[from]);
        if self.reversed { -rise_m } else { rise_m }
    }

    /// Height at an inner border of a template that begins at the cell with an index.
    fn border_m(&self, from: usize, weights: &[(isize, f64)]) -> f64 {
        let height = |offset: isize| f64::from(*self.elevation_m.at(from.wrapping_add_signed(offset)));
        let sum = weights
            .iter()
            .fold(0.0, |sum, &(offset, weight)| sum + weight * height(offset));
        if sum.is_finite() {
            // All heights are known, and weights add up to one exactly.
            return sum;
        }
        let (mut sum, mut total) = (0.0, 0.0);
        for &(offset, weight) in weights {
            if height(offset).is_finite() {
                sum += weight * height(offset);
                total += weight;
            }
        }
        sum / total
    }

    /// Whether no template that begins at a cell leaves the map.
    fn is_inner(&self, from: Cell) -> bool {
        let geometry = self.geometry();
        from.row >= self.reach
            && from.column >= self.reach
            && from.row + self.reach < geometry.rows()
            && from.column + self.reach < geometry.columns()
    }

    fn all_open(&self, from: Cell, steps: &[Step]) -> bool {
        let geometry = self.geometry();
        if self.is_inner(from) {
            let here = geometry.index(from) as i64;
            let columns = geometry.columns() as i64;
            return steps.iter().all(|step| {
                let index = here + i64::from(step.rows) * columns + i64::from(step.columns);
                self.headings.data()[index as usize] != 0
            });
        }
        steps.iter().all(|step| {
            let near = geometry.offset(from, step.rows, step.columns);
            near.is_some_and(|near| self.headings[near] != 0)
        })
    }

    /// What a step costs the vehicle that drives it; `clear` holds steps whose cells are known to allow them.
    fn driven_cost(&self, from: Cell, step: usize, clear: u32) -> f64 {
        let bit = 1 << step;
        let template = &self.templates[step];
        let is_clear = clear >> step & 1 == 1;
        if !is_clear && (self.headings[from] & bit == 0 || !self.all_open(from, &template.swept)) {
            return f64::INFINITY;
        }
        let geometry = self.geometry();
        let (first, columns) = (geometry.index(from), geometry.columns());
        let mut cost = 0.0;
        let mut height_m = f64::from(*self.elevation_m.at(first));
        for crossed in &template.crossed {
            let index = first.wrapping_add_signed(crossed.offset);
            if !is_clear && self.headings.data()[index] & bit == 0 {
                return f64::INFINITY;
            }
            let next_m = if crossed.border.is_empty() {
                f64::from(*self.elevation_m.at(index))
            } else {
                self.border_m(first, &crossed.border)
            };
            let run_m = crossed.run_m;
            let grade = (next_m - height_m) / run_m;
            let code = self.soil.map_or(0, |soil| usize::from(soil.data()[index]));
            let soil = &self.soils[code];
            if !self.limits.allows_grade(grade, soil) {
                return f64::INFINITY;
            }
            let [low, high] = self.steady[code];
            let speed_mps = if (low..=high).contains(&grade) {
                soil.speed_mps
            } else if let Some(speed_mps) = speed_mps(self.vehicle, soil, grade) {
                speed_mps
            } else {
                return f64::INFINITY;
            };
            let length_m = run_m * (1.0 + grade * grade).sqrt();
            let time_s = length_m / speed_mps;
            cost += if self.pricing.is_plain() && self.bridged.is_none() {
                time_s
            } else {
                let cell = Cell::new(index / columns, index % columns);
                let energy_j = || energy_j(self.vehicle, soil, grade, length_m, time_s);
                let piece = self
                    .pricing
                    .cost(cell, time_s, energy_j, || self.pricing.exposure_at(cell));
                if self.is_bridged(cell) {
                    BRIDGE_FACTOR * piece
                } else {
                    piece
                }
            };
            height_m = next_m;
        }
        cost
    }

    /// The headings that every cell allows that a template beginning at this one can touch; none at the rim of the map.
    fn clear_headings(&self, from: Cell) -> u16 {
        if !self.is_inner(from) {
            return 0;
        }
        let (width, columns) = (2 * self.reach + 1, self.geometry().columns());
        let north_west = self.geometry().index(from) - self.reach * (columns + 1);
        let rows = self.headings.data()[north_west..].chunks(columns).take(width);
        rows.fold(u16::MAX, |all, row| {
            row[..width].iter().fold(all, |all, &allowed| all & allowed)
        })
    }
}

impl StepGraph for Ground<'_> {
    fn geometry(&self) -> GridGeometry {
        self.elevation_m.geometry()
    }

    fn steps(&self) -> &[Step] {
        &SIXTEEN
    }

    fn edge_cost(&self, from: Cell, step: usize) -> f64 {
        self.edge_cost_seen(from, step, 0)
    }

    fn bound(&self, cell: Cell) -> f64 {
        let centre = self.geometry().centre(cell);
        let (east_m, north_m) = (self.goal.x_m - centre.x_m, self.goal.y_m - centre.y_m);
        let distance_m = (east_m * east_m + north_m * north_m).sqrt();
        let climb = match self.geometry().cell_at(self.goal) {
            Some(goal) if self.pricing.counts_energy() => self.pricing.climb(distance_m, self.rise_m(cell, goal)),
            _ => 0.0,
        };
        // No open cell is quicker than the fastest of them. A hair less than the bound, so that rounding cannot make it
        // inconsistent.
        let flat_per_m = self.least_cost_per_m() * (self.vehicle.max_speed_mps / self.fastest_mps).max(1.0);
        (flat_per_m * distance_m + climb) * (1.0 - 1e-12)
    }

    fn scale(&self) -> Option<f64> {
        // Where factors differ much, the least cost tells nothing of the usual one.
        let scale = self.least_cost_per_m() * self.geometry().cell_size_m();
        (!self.pricing.has_factor() && scale.is_normal()).then_some(scale)
    }

    fn least_step(&self, from: Cell, to: Cell, step: usize) -> f64 {
        if self.pricing.has_factor() {
            return 0.0;
        }
        // The straight line is no longer than its pieces together. An unknown height leaves nothing known.
        let (run_m, rise_m) = (self.templates[step].run_m, self.rise_m(from, to));
        let length_m = (run_m * run_m + rise_m * rise_m).sqrt();
        self.pricing.objective.time * length_m / self.fastest_mps * (1.0 - 1e-12)
    }

    fn surroundings(&self, from: Cell) -> u32 {
        if self.reversed {
            return 0;
        }
        u32::from(self.clear_headings(from))
    }

    fn edge_cost_seen(&self, from: Cell, step: usize, surroundings: u32) -> f64 {
        if !self.reversed {
            return self.driven_cost(from, step, surroundings);
        }
        let to = SIXTEEN[step].from(&self.geometry(), from);
        to.map_or(f64::INFINITY, |to| {
            self.driven_cost(to, (step + SIXTEEN.len() / 2) % SIXTEEN.len(), 0)
        })
    }
}

#[cfg(test)]
mod tests;
