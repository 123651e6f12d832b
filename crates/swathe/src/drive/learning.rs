//! What the navigator learns of the ground: readings, news from outside, and what follows for grids, window and route.

use crate::belief::SoilUpdate;
use crate::grid::{GridGeometry, Layer, Position};
use crate::nest::GridsParams;
use crate::sensor::PenetrometerReading;
use crate::vehicle::Vehicle;

use super::event::Event;
use super::knowledge::{Knowledge, Learnt, RouteChange};
use super::navigator::{Navigator, Observation};
use super::params::{DriveError, DriveParams, OutsideNests};
use super::region::{RegionState, Source};
use super::steer::Histogram;

/// Certainty of a cell where nothing was seen, in [`Navigator::certainty_window`].
pub const UNSEEN: u8 = u8::MAX;

impl Navigator {
    /// A navigator on ground that readings and updates teach it more of; `grids` are the usual ones where not given.
    ///
    /// # Errors
    /// [`DriveError`] when the vehicle, a parameter, the goal or the grids are not usable.
    pub fn with_knowledge(
        vehicle: &Vehicle,
        goal: Position,
        knowledge: Knowledge,
        grids: Option<GridsParams>,
        params: DriveParams,
    ) -> Result<Self, DriveError> {
        let knowledge = knowledge.with_outside(params.outside_nests == OutsideNests::Cost);
        Self::on(vehicle, goal, Some(Source::Known(Box::new(knowledge), grids)), params)
    }

    /// What is known of the ground, where the region can learn.
    pub fn knowledge(&self) -> Option<&Knowledge> {
        match (&self.region, &self.pending_region) {
            (Some(region), _) => region.knowledge(),
            (None, Some(Source::Known(knowledge, _))) => Some(knowledge),
            (None, _) => None,
        }
    }

    /// Points of the global route: the given one, or the one that is kept right while the ground is learnt.
    pub fn global_route(&self) -> &[Position] {
        match (&self.region, &self.pending_region) {
            (Some(region), _) => region.route(),
            (None, Some(source)) => source.route(),
            (None, None) => &[],
        }
    }

    /// The polar histogram of the last step in which the local method was asked; `None` before the first.
    pub fn histogram(&self) -> Option<Histogram> {
        self.local.histogram()
    }

    /// The certainty grid as a layer, never `None` in practice: 0 to [`crate::local::CERTAINTY_MAX`], [`UNSEEN`] where nothing was seen.
    pub fn certainty_window(&self) -> Option<Layer<u8>> {
        let (side, size) = (self.grid.side_cells(), self.grid.params().cell_size_m);
        let middle = self.grid.middle_m();
        let (row, column) = self.grid.cell_of(middle.0, middle.1);
        let first = (row - side as i64 / 2, column - side as i64 / 2);
        let cell = |index: usize| (first.0 + (index / side) as i64, first.1 + (index % side) as i64);
        let data = (0..side * side).map(|index| self.grid.certainty_of(cell(index)).unwrap_or(UNSEEN));
        let (west_m, north_m) = (first.1 as f64 * size, -first.0 as f64 * size);
        let geometry = GridGeometry::new(side, side, size, west_m, north_m).ok()?;
        Layer::new(geometry, data.collect(), "the certainty").ok()
    }

    /// Begins with the region at the first pose.
    pub(super) fn begin_region(&mut self, at: Position) {
        if let Some(source) = self.pending_region.take() {
            // Checked when the navigator was made; a pose beside the map only moves the grids' window there.
            self.region = RegionState::new(source, &self.vehicle, &self.params, at).ok();
            self.lay_global(at);
        }
    }

    /// Lays the global way from a place, where the region keeps one.
    pub(super) fn lay_global(&mut self, at: Position) {
        let goal = self.goal;
        let knowledge = self.region.as_mut().and_then(RegionState::knowledge_mut);
        if let Some(knowledge) = knowledge {
            let change = knowledge.lay(at, goal);
            let doubted = knowledge.doubted().to_vec();
            self.events.push(route_event(&change));
            if let Some(region) = self.region.as_mut().filter(|_| !doubted.is_empty()) {
                region.refresh(&doubted);
                self.window = None;
            }
        }
    }

    /// Takes in a reading that came with a step.
    pub(super) fn take_reading(&mut self, seen: &Observation, at: Position) {
        let Some(reading) = seen.reading else { return };
        self.probing.answered(at);
        let knowledge = self.region.as_mut().and_then(RegionState::knowledge_mut);
        let Some(Ok(learnt)) = knowledge.map(|knowledge| knowledge.learn(reading, at)) else {
            self.events.push(Event::ReadingRefused);
            return;
        };
        self.events.push(Event::ReadingTaken {
            at: Position::new(reading.x_m, reading.y_m),
            class: learnt.class,
            probabilities: learnt.probabilities,
            cone_index_kpa: learnt.cone_index_kpa,
            cells_changed: learnt.ranks.len(),
        });
        self.follow(&learnt);
    }

    /// What the region knows, before its first step too.
    fn teachable(&mut self) -> Result<&mut Knowledge, DriveError> {
        let knowledge = match (&mut self.region, &mut self.pending_region) {
            (Some(region), _) => region.knowledge_mut(),
            (None, Some(Source::Known(knowledge, _))) => Some(&mut **knowledge),
            (None, _) => None,
        };
        knowledge.ok_or(DriveError::NoKnowledge)
    }

    /// Lets everything follow what was learnt between steps, for the next step to tell.
    fn tell_next(&mut self, event: Event, learnt: &Learnt) {
        // A step begins with an empty list.
        let told = std::mem::take(&mut self.events);
        self.events.append(&mut self.news);
        self.events.push(event);
        self.follow(learnt);
        self.news = std::mem::replace(&mut self.events, told);
    }

    /// Takes in news of the soil of an area, between steps; ranks, nests, both grids and the route follow at once, and the
    /// next step's events tell it.
    ///
    /// # Errors
    /// [`DriveError::Belief`] when the update is not usable, [`DriveError::NoKnowledge`] when the region cannot learn.
    pub fn learn_soil(&mut self, update: &SoilUpdate) -> Result<Learnt, DriveError> {
        let at = self.place().unwrap_or(self.goal);
        let learnt = self.teachable()?.learn_soil(update, at)?;
        let event = Event::SoilUpdate {
            source: update.source.clone(),
            told_s: update.time_s,
            class: learnt.class,
            cells_changed: learnt.ranks.len(),
        };
        self.tell_next(event, &learnt);
        Ok(learnt)
    }

    /// Takes in a reading that another vehicle has taken, between steps; everything follows as from a reading of its own.
    ///
    /// # Errors
    /// [`DriveError::Belief`] when the reading is not usable, [`DriveError::NoKnowledge`] when the region cannot learn.
    pub fn learn_reading(&mut self, reading: &PenetrometerReading) -> Result<Learnt, DriveError> {
        let at = self.place().unwrap_or(self.goal);
        let learnt = self.teachable()?.learn(reading, at)?;
        let event = Event::ReadingTaken {
            at: Position::new(reading.x_m, reading.y_m),
            class: learnt.class,
            probabilities: learnt.probabilities,
            cone_index_kpa: learnt.cone_index_kpa,
            cells_changed: learnt.ranks.len(),
        };
        self.tell_next(event, &learnt);
        Ok(learnt)
    }

    /// Lets grids and window follow what was learnt, and says so.
    fn follow(&mut self, learnt: &Learnt) {
        if let Some(region) = &mut self.region {
            region.refresh(&learnt.ranks);
        }
        if let (cells_gained, cells_lost, Some(nests)) = (learnt.nest_cells.0, learnt.nest_cells.1, learnt.nest_count) {
            self.events.push(Event::NestsChanged {
                cells_gained,
                cells_lost,
                nests,
            });
        }
        let route = &learnt.route;
        if route.is_other || route.standing != route.standing_before {
            self.events.push(route_event(route));
        }
        if route.is_other || !learnt.ranks.is_empty() {
            self.window = None;
        }
        self.probing.forget_plan();
    }
}

fn route_event(change: &RouteChange) -> Event {
    Event::RouteRepaired {
        cost_before: change.cost_before,
        cost_after: change.cost_after,
        cells: change.cells,
        standing: change.standing,
        afresh: change.afresh,
    }
}
