//! The colony: all agents, the cells they know, and the nests they have built.

mod changes;
mod frame;
mod ground;
mod guided;
mod pellets;
mod planes;
mod stop;
mod sweep;
mod tick;
mod trace;

use crate::grid::{Cell, GridGeometry, Layer, Step};
use crate::nest::{BitRows, NestError, Nests, UnionFind, nests_of_cells};
use crate::progress::Report;
use crate::rank::{CellSource, SourceFault};

use super::agents::Extent;
use super::itinerary::Itinerary;
use super::{Budget, State, StopRule, SwarmError, SwarmParams};

pub use frame::{Frame, FrameTicks, Seen};

pub use changes::Changes;

/// What is known of a cell, one bit each.
mod flag {
    pub(super) const INSIDE: u8 = 1;
    pub(super) const EVALUATED: u8 = 2;
    pub(super) const SUITABLE: u8 = 4;
    /// Some cell of its vicinity is not suitable, so it can never be a core.
    pub(super) const DEAD: u8 = 8;
    pub(super) const CORE: u8 = 16;
    pub(super) const NEST: u8 = 32;
    /// Ground that is looked at for the cores beside it, but is nobody's to walk on or to be a core.
    pub(super) const HALO: u8 = 64;
    /// It has as many pellets as make a focus.
    pub(super) const FULL: u8 = 128;
}

/// The bits that tell the ground of the agents: these cells are inside, and not of the halo.
const GROUND: u8 = flag::INSIDE | flag::HALO;

/// Most ticks between two reports.
const TICKS_PER_REPORT: u64 = 64;

/// Visits after which a report is due, so that a crowd can be stopped too.
const VISITS_PER_REPORT: u64 = 1 << 20;

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// No cell can become a core any more.
    Finished,
    /// The watched cells lie in one nest, and that was the rule.
    Connected,
    /// Little can be left to find, and that was the rule.
    Statistical,
    /// The given number of ticks is over.
    TicksSpent,
    /// The budget of evaluations is spent.
    EvaluationsSpent,
    /// The caller asked to stop.
    Stopped,
    /// Ground that was needed cannot be read.
    Unread(SourceFault),
}

/// What a swarm has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Ticks so far.
    pub ticks: u64,
    /// Visits of agents to cells.
    pub visits: u64,
    /// Cells whose rank was asked for, each once, and once more for every [`Colony::update`] that names it.
    pub cells_evaluated: u64,
    /// Cores that stand.
    pub cores: u64,
    /// Tick in which the two watched cells came into one nest.
    pub connected_at: Option<u64>,
}

/// A swarm at work. The source of its ranks is owned, or borrowed by giving a reference.
pub struct Colony<Source: CellSource> {
    source: Source,
    params: SwarmParams,
    vicinity: Vec<Step>,
    /// Rows and columns that the vicinity reaches.
    vicinity_reach: usize,
    geometry: GridGeometry,
    extent: Extent,
    flags: Vec<u8>,
    /// Pellets of every cell; empty where one pellet makes a focus, as the flags tell then.
    pellets: Vec<u8>,
    /// Sets of nest cells. Empty while nobody has asked for them: they follow from the flags.
    sets: UnionFind,
    agents: Vec<u32>,
    /// Cells that may still become cores.
    open: u64,
    /// Tick at which the present swathe was set; permutations start anew there.
    epoch_start: u64,
    /// Where a permutation leads in the present swathe.
    itinerary: Option<Itinerary>,
    watched: Option<(usize, usize)>,
    rule: StopRule,
    budget: Budget,
    /// Visits to random cells in a row that met nothing new; counted for the statistical rule alone.
    quiet_visits: u64,
    /// Why the last ground that was needed is not there.
    fault: Option<SourceFault>,
    /// Cells that agents walk on.
    ground_cells: u64,
    tally: Tally,
    trace: trace::Trace,
}

impl<Source: CellSource> Colony<Source> {
    /// Deploys the agents at random inside the swathe.
    ///
    /// # Errors
    /// [`SwarmError`] when a parameter is outside its range or the mask does not fit the map.
    pub fn deploy(source: Source, inside: &Layer<bool>, params: SwarmParams) -> Result<Self, SwarmError> {
        let flags = vec![0; source.geometry().cell_count()];
        Self::deploy_on(source, inside, params, flags)
    }

    /// Deploys the agents on the cells of the swathe that are their own; the others are looked at, and may lie in a nest, but
    /// are never cores.
    pub(super) fn deploy_within(
        source: Source,
        inside: &Layer<bool>,
        params: SwarmParams,
        own: impl Fn(Cell) -> bool,
    ) -> Result<Self, SwarmError> {
        let cells = source.geometry().cells();
        let flags = cells.map(|cell| if own(cell) { 0 } else { flag::HALO }).collect();
        Self::deploy_on(source, inside, params, flags)
    }

    fn deploy_on(
        source: Source,
        inside: &Layer<bool>,
        params: SwarmParams,
        flags: Vec<u8>,
    ) -> Result<Self, SwarmError> {
        params.validate()?;
        let geometry = source.geometry();
        let vicinity = params.nest.vicinity.steps()?;
        let reach = vicinity
            .iter()
            .map(|step| step.rows.unsigned_abs().max(step.columns.unsigned_abs()));
        let mut colony = Self {
            source,
            vicinity_reach: reach.max().unwrap_or(0) as usize,
            vicinity,
            params,
            geometry,
            extent: Extent {
                row: 0,
                column: 0,
                rows: geometry.rows(),
                columns: geometry.columns(),
            },
            flags,
            pellets: no_pellets(&params, geometry.cell_count()),
            sets: UnionFind::new(0),
            agents: vec![0; params.agents as usize],
            open: 0,
            epoch_start: 0,
            itinerary: None,
            watched: None,
            rule: StopRule::Finished,
            budget: Budget::default(),
            quiet_visits: 0,
            fault: None,
            ground_cells: 0,
            tally: Tally::default(),
            trace: trace::Trace::default(),
        };
        colony.widen(inside)?;
        let first = colony
            .flags
            .iter()
            .position(|flags| flags & GROUND == flag::INSIDE)
            .unwrap_or(0);
        colony.agents.fill(first as u32);
        Ok(colony)
    }

    /// Watches for the tick in which two cells come into one nest.
    pub fn watch(&mut self, a: Cell, b: Cell) {
        self.build_sets();
        self.watched = Some((self.geometry.index(a), self.geometry.index(b)));
        self.note_connection();
    }

    /// Runs until the swarm is finished, its rule or budget ends it ([`Self::stop_by`]), `ticks` are over, or `report`
    /// (cells settled, cells in all) returns false.
    pub fn run(&mut self, ticks: u64, report: &mut Report) -> Ending {
        // What could not be read before is tried again.
        self.fault = None;
        if let Some(itinerary) = self.itinerary.take() {
            let ending = self.run_along(&itinerary, ticks, report);
            self.itinerary = Some(itinerary);
            return ending;
        }
        let last = self.tally.ticks.saturating_add(ticks);
        let total = self.open;
        let mut ahead = 1;
        let per_report = (VISITS_PER_REPORT / self.agents.len().max(1) as u64).clamp(1, TICKS_PER_REPORT);
        loop {
            match self.over() {
                None => {}
                Some(Ending::Finished) => break,
                Some(ending) => return ending,
            }
            if self.tally.ticks >= last {
                return Ending::TicksSpent;
            }
            let since_report = self.tally.ticks % per_report;
            if since_report == 0 && !report(total - self.open, total) {
                return Ending::Stopped;
            }
            let ticks = ahead.min(last - self.tally.ticks).min(per_report - since_report);
            self.spend(ticks);
            // A swarm that is soon finished foresees little in vain.
            ahead = (2 * ahead).min(per_report);
        }
        self.trace.finish();
        Ending::Finished
    }

    /// Where the ranks come from.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// Where the ranks come from, to be changed. [`Self::update`] must follow with every cell whose rank is another now.
    pub fn source_mut(&mut self) -> &mut Source {
        &mut self.source
    }

    /// What the swarm has done so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// The cells of the swathe.
    pub fn is_inside(&self, cell: Cell) -> bool {
        self.flags[self.geometry.index(cell)] & flag::INSIDE > 0
    }

    /// Cells of the agents.
    pub fn agents(&self) -> impl Iterator<Item = Cell> {
        self.agents.iter().map(|&index| self.geometry.cell(index as usize))
    }

    /// Whether a cell has been evaluated.
    pub fn is_evaluated(&self, cell: Cell) -> bool {
        self.flags[self.geometry.index(cell)] & flag::EVALUATED > 0
    }

    /// The nests built so far, with the memory that held them. [`Self::give_nests`] must come before anything else.
    ///
    /// # Errors
    /// [`NestError::Grid`] never in practice: the labels are of the map.
    pub fn take_nests(&mut self) -> Result<Nests, NestError> {
        self.pellets = Vec::new();
        if self.sets.is_empty() {
            return self.nests();
        }
        let sets = std::mem::replace(&mut self.sets, UnionFind::new(0));
        let flags = &self.flags;
        let (labels, sizes) = sets.into_labels(|index| flags[index] & flag::NEST > 0);
        Ok(Nests::new(Layer::new(self.geometry, labels, "the nests")?, sizes))
    }

    /// Takes back nests that [`Self::take_nests`] gave, so that the swathe can be widened.
    pub fn give_nests(&mut self, nests: &Nests) {
        self.sets = sets_of(nests);
        // Cells that are settled never look at their pellets again; the others count anew.
        self.pellets = no_pellets(&self.params, self.geometry.cell_count());
        for flags in &mut self.flags {
            *flags &= !flag::FULL;
        }
    }

    /// The nests built so far.
    ///
    /// # Errors
    /// [`NestError::Grid`] never in practice: the labels are of the map.
    pub fn nests(&self) -> Result<Nests, NestError> {
        let is_nest = |flags: &u8| u8::from(flags & flag::NEST > 0);
        if self.sets.is_empty() {
            let cells = BitRows::at_least(self.geometry, &self.flags, 1, is_nest);
            return nests_of_cells(self.geometry, &cells, self.params.nest.contact);
        }
        let mut labels = Layer::filled(self.geometry, 0);
        let sizes = self
            .sets
            .label(|index| is_nest(&self.flags[index]) > 0, labels.data_mut());
        Ok(Nests::new(labels, sizes))
    }

    /// Makes the sets of nest cells that a sweep has left out. Under contact `overlap` none is ever left out once there is
    /// a nest.
    fn build_sets(&mut self) {
        if !self.sets.is_empty() {
            return;
        }
        self.sets = match self.nests() {
            Ok(nests) if nests.count() > 0 => sets_of(&nests),
            _ => UnionFind::new(self.geometry.cell_count()),
        };
    }

    /// Whether the watched cells lie in one nest.
    fn is_connected(&mut self) -> bool {
        self.watched.is_some_and(|(a, b)| {
            self.flags[a] & self.flags[b] & flag::NEST > 0 && self.sets.find(a as u32) == self.sets.find(b as u32)
        })
    }

    fn note_connection(&mut self) {
        if self.tally.connected_at.is_none() && self.is_connected() {
            self.tally.connected_at = Some(self.tally.ticks);
        }
    }
}

/// Counts of pellets, where more than one makes a focus.
fn no_pellets(params: &SwarmParams, cells: usize) -> Vec<u8> {
    let counts = if params.pellet_max > 1 { cells } else { 0 };
    vec![0; counts]
}

/// Sets of the cells of nests.
fn sets_of(nests: &Nests) -> UnionFind {
    let labels = nests.labels().data();
    let mut roots = vec![u32::MAX; nests.count()];
    let mut sets = UnionFind::new(labels.len());
    for (index, &label) in labels.iter().enumerate() {
        if label > 0 {
            let root = &mut roots[label as usize - 1];
            *root = (*root).min(index as u32);
            sets.union(*root, index as u32);
        }
    }
    sets
}

#[cfg(test)]
mod tests;
