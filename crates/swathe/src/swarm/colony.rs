//! The colony: all agents, the cells they know, and the nests they have built.

mod frame;
mod trace;

use rayon::prelude::*;

use crate::grid::{Cell, FOUR, GridGeometry, Layer, Step};
use crate::nest::{Contact, NestError, Nests, UnionFind};
use crate::progress::Report;
use crate::rank::{CellRank, CellSource};

use super::agents::{Extent, Field};
use super::{State, SwarmError, SwarmParams};

pub use frame::{Frame, FrameTicks, Seen};

mod guided;

/// What is known of a cell, one bit each.
mod flag {
    pub(super) const INSIDE: u8 = 1;
    pub(super) const EVALUATED: u8 = 2;
    pub(super) const SUITABLE: u8 = 4;
    /// Some cell of its vicinity is not suitable, so it can never be a core.
    pub(super) const DEAD: u8 = 8;
    pub(super) const CORE: u8 = 16;
    pub(super) const NEST: u8 = 32;
}

/// From this many agents on they are served by several threads.
const PARALLEL_AGENTS: u32 = 4096;
/// Ticks between two reports.
const TICKS_PER_REPORT: u64 = 64;

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// No cell can become a core any more.
    Finished,
    /// The given number of ticks is over.
    TicksSpent,
    /// The caller asked to stop.
    Stopped,
}

/// What a swarm has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Ticks so far.
    pub ticks: u64,
    /// Visits of agents to cells.
    pub visits: u64,
    /// Cells whose rank was asked for, each once.
    pub cells_evaluated: u64,
    /// Cores found.
    pub cores: u64,
    /// Tick in which the two watched cells came into one nest.
    pub connected_at: Option<u64>,
}

/// A swarm at work.
pub struct Colony<'a, Source: CellSource> {
    source: &'a Source,
    params: SwarmParams,
    vicinity: Vec<Step>,
    geometry: GridGeometry,
    extent: Extent,
    flags: Vec<u8>,
    pellets: Vec<u8>,
    sets: UnionFind,
    agents: Vec<u32>,
    /// Cells that may still become cores.
    open: u64,
    /// Tick at which the present swathe was set; permutations start anew there.
    epoch_start: u64,
    watched: Option<(usize, usize)>,
    tally: Tally,
    trace: trace::Trace,
}

impl<'a, Source: CellSource> Colony<'a, Source> {
    /// Deploys the agents at random inside the swathe.
    ///
    /// # Errors
    /// [`SwarmError`] when a parameter is outside its range or the mask does not fit the map.
    pub fn deploy(source: &'a Source, inside: &Layer<bool>, params: SwarmParams) -> Result<Self, SwarmError> {
        params.validate()?;
        let geometry = source.geometry();
        let cells = geometry.cell_count();
        let mut colony = Self {
            source,
            vicinity: params.nest.vicinity.steps()?,
            params,
            geometry,
            extent: Extent {
                row: 0,
                column: 0,
                rows: geometry.rows(),
                columns: geometry.columns(),
            },
            flags: vec![0; cells],
            pellets: vec![0; cells],
            sets: UnionFind::new(cells),
            agents: vec![0; params.agents as usize],
            open: 0,
            epoch_start: 0,
            watched: None,
            tally: Tally::default(),
            trace: trace::Trace::default(),
        };
        colony.widen(inside)?;
        let first = colony
            .flags
            .iter()
            .position(|flags| flags & flag::INSIDE > 0)
            .unwrap_or(0);
        colony.agents.fill(first as u32);
        Ok(colony)
    }

    /// Enlarges the swathe; nothing that is known is evaluated again. Cells that could not be cores only because the old
    /// swathe ended beside them may become cores now.
    ///
    /// # Errors
    /// [`SwarmError::Grid`] when the mask does not fit the map.
    pub fn widen(&mut self, inside: &Layer<bool>) -> Result<(), SwarmError> {
        let mask = inside.data();
        Layer::new(self.geometry, vec![(); mask.len()], "the swathe")?;
        let (mut low, mut high) = ((usize::MAX, usize::MAX), (0, 0));
        for (index, flags) in self.flags.iter_mut().enumerate() {
            if mask[index] {
                *flags |= flag::INSIDE;
            }
            if *flags & flag::INSIDE > 0 {
                let cell = self.geometry.cell(index);
                low = (low.0.min(cell.row), low.1.min(cell.column));
                high = (high.0.max(cell.row), high.1.max(cell.column));
            }
        }
        if low.0 != usize::MAX {
            self.extent = Extent {
                row: low.0,
                column: low.1,
                rows: high.0 - low.0 + 1,
                columns: high.1 - low.1 + 1,
            };
        }
        self.epoch_start = self.tally.ticks;
        self.open = 0;
        for index in 0..self.flags.len() {
            let flags = self.flags[index];
            if flags & flag::INSIDE == 0 || flags & flag::CORE > 0 {
                continue;
            }
            if self.may_be_core(index) {
                self.flags[index] &= !flag::DEAD;
                // A pellet count that is full would never trigger the test again.
                self.pellets[index] = 0;
                self.open += 1;
            } else {
                self.flags[index] |= flag::DEAD;
            }
        }
        Ok(())
    }

    /// Watches for the tick in which two cells come into one nest.
    pub fn watch(&mut self, a: Cell, b: Cell) {
        self.watched = Some((self.geometry.index(a), self.geometry.index(b)));
        self.note_connection();
    }

    /// Runs until the swarm is finished, `ticks` are over, or `report` (cells settled, cells in all) returns false.
    pub fn run(&mut self, ticks: u64, report: &mut Report) -> Ending {
        let last = self.tally.ticks.saturating_add(ticks);
        let total = self.open;
        while self.open > 0 {
            if self.tally.ticks >= last {
                return Ending::TicksSpent;
            }
            if self.tally.ticks.is_multiple_of(TICKS_PER_REPORT) && !report(total - self.open, total) {
                return Ending::Stopped;
            }
            self.tick();
        }
        self.trace.finish();
        Ending::Finished
    }

    /// What the swarm has done so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// The cells of the swathe.
    pub fn is_inside(&self, cell: Cell) -> bool {
        self.flags[self.geometry.index(cell)] & flag::INSIDE > 0
    }

    /// Pellets on a cell.
    pub fn pellets(&self, cell: Cell) -> u8 {
        self.pellets[self.geometry.index(cell)]
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
        let sets = std::mem::replace(&mut self.sets, UnionFind::new(0));
        self.pellets = Vec::new();
        let flags = &self.flags;
        Nests::from_labels(self.geometry, sets.into_roots(|index| flags[index] & flag::NEST > 0))
    }

    /// Takes back nests that [`Self::take_nests`] gave, so that the swathe can be widened.
    pub fn give_nests(&mut self, nests: &Nests) {
        let mut roots = vec![u32::MAX; nests.count()];
        let mut sets = UnionFind::new(self.geometry.cell_count());
        for (index, &label) in nests.labels().data().iter().enumerate() {
            if label > 0 {
                let root = &mut roots[label as usize - 1];
                *root = (*root).min(index as u32);
                sets.union(*root, index as u32);
            }
        }
        self.sets = sets;
        // Cells that are settled never look at their pellets again; the others count anew.
        self.pellets = vec![0; self.geometry.cell_count()];
    }

    /// The nests built so far.
    ///
    /// # Errors
    /// [`NestError::Grid`] never in practice: the labels are of the map.
    pub fn nests(&self) -> Result<Nests, NestError> {
        let labels = (0..self.flags.len()).map(|index| {
            if self.flags[index] & flag::NEST > 0 {
                self.sets.peek(index as u32) + 1
            } else {
                0
            }
        });
        Nests::from_labels(self.geometry, labels.collect())
    }

    /// One synchronous tick: move, evaluate, drop, build.
    fn tick(&mut self) {
        let visits = self.visits(self.tally.ticks - self.epoch_start);
        self.settle(visits);
    }

    /// Takes in what the agents saw in a tick, in the order of the agents.
    fn settle(&mut self, visits: Vec<Option<(usize, Option<CellRank>)>>) {
        self.tally.ticks += 1;
        let mut full = Vec::new();
        for (agent, visit) in visits.into_iter().enumerate() {
            self.trace.arrive(tick, visit.map(|visit| visit.2));
            let Some((index, rank, _)) = visit else { continue };
            self.tally.visits += 1;
            self.agents[agent] = index as u32;
            if let Some(rank) = rank {
                self.learn(index, rank);
            }
            let pellets = &mut self.pellets[index];
            let suitable = self.flags[index] & flag::SUITABLE > 0;
            self.trace.enter_if(suitable, State::Count);
            if suitable && *pellets < self.params.pellet_max {
                *pellets += 1;
                self.trace.enter(State::Drop);
                if *pellets == self.params.pellet_max {
                    full.push(index);
                    self.trace.enter(State::Build);
                }
            }
            self.trace.enter(State::Forage);
        }
        for index in full {
            self.build(index);
            self.trace.enter(State::Forage);
        }
        self.note_connection();
    }

    /// The cell that each agent visits, with its rank where it was not known yet.
    fn visits(&self, tick: u64) -> Vec<Option<(usize, Option<CellRank>, State)>> {
        let field = Field {
            geometry: self.geometry,
            extent: self.extent,
            params: &self.params,
            inside: |index: usize| self.flags[index] & flag::INSIDE > 0,
            pellets: |index: usize| self.pellets[index],
        };
        let visit = |(agent, &here): (usize, &u32)| {
            let (index, arrival) = field.visit(agent as u32, tick, here as usize)?;
            let known = self.flags[index] & (flag::EVALUATED | flag::INSIDE) != flag::INSIDE;
            let rank = (!known).then(|| self.source.cell_rank(self.geometry.cell(index)));
            Some((index, rank, arrival))
        };
        if self.params.agents < PARALLEL_AGENTS {
            self.agents.iter().enumerate().map(visit).collect()
        } else {
            self.agents.par_iter().enumerate().map(visit).collect()
        }
    }

    /// Takes note of a cell's rank; two agents may bring the same news.
    fn learn(&mut self, index: usize, rank: CellRank) {
        if self.flags[index] & flag::EVALUATED > 0 {
            return;
        }
        self.tally.cells_evaluated += 1;
        self.flags[index] |= flag::EVALUATED;
        if rank.rank() >= self.params.nest.rank_min {
            self.flags[index] |= flag::SUITABLE;
        } else {
            let cell = self.geometry.cell(index);
            for step in &self.vicinity {
                if let Some(near) = step.from(&self.geometry, cell) {
                    let flags = &mut self.flags[self.geometry.index(near)];
                    if *flags & (flag::INSIDE | flag::DEAD) == flag::INSIDE {
                        *flags |= flag::DEAD;
                        self.open -= 1;
                    }
                }
            }
        }
    }

    /// The core test of a cell whose pellets are full.
    fn build(&mut self, index: usize) {
        let cell = self.geometry.cell(index);
        self.trace.begin(State::Build);
        for step in 0..self.vicinity.len() {
            if self.flags[index] & flag::DEAD > 0 {
                return self.trace.enter(State::Reject);
            }
            self.trace.enter(State::Examine);
            if let Some(near) = self.vicinity[step].from(&self.geometry, cell) {
                let near_index = self.geometry.index(near);
                let flags = self.flags[near_index];
                if flags & (flag::EVALUATED | flag::INSIDE) == flag::INSIDE {
                    self.learn(near_index, self.source.cell_rank(near));
                }
            }
        }
        if self.flags[index] & (flag::DEAD | flag::CORE) > 0 {
            return self.trace.enter_if(self.flags[index] & flag::DEAD > 0, State::Reject);
        }
        self.trace.enter(State::Core);
        self.flags[index] |= flag::CORE;
        self.open -= 1;
        self.tally.cores += 1;
        for step in 0..self.vicinity.len() {
            if let Some(near) = self.vicinity[step].from(&self.geometry, cell) {
                let near_index = self.geometry.index(near);
                if self.flags[near_index] & flag::INSIDE > 0 {
                    self.trace.enter(State::Join);
                    let joined = self.sets.union(index as u32, near_index as u32);
                    self.trace
                        .enter_if(joined && self.flags[near_index] & flag::NEST > 0, State::Merge);
                    self.join(near);
                }
            }
        }
    }

    /// Adds a cell to its nest and merges the nests that it touches.
    fn join(&mut self, cell: Cell) {
        let index = self.geometry.index(cell);
        if self.flags[index] & flag::NEST > 0 {
            return;
        }
        self.flags[index] |= flag::NEST;
        let touching: &[Step] = match self.params.nest.contact {
            Contact::Overlap => &[],
            Contact::Edge => &FOUR,
            Contact::Corner => &crate::grid::EIGHT,
        };
        for step in touching {
            if let Some(near) = step.from(&self.geometry, cell) {
                let near = self.geometry.index(near);
                if self.flags[near] & flag::NEST > 0 {
                    let joined = self.sets.union(index as u32, near as u32);
                    self.trace.enter_if(joined, State::Merge);
                }
            }
        }
    }

    /// Whether nothing that is known keeps a cell from being a core.
    fn may_be_core(&self, index: usize) -> bool {
        let cell = self.geometry.cell(index);
        self.vicinity.iter().all(|step| {
            let near = step
                .from(&self.geometry, cell)
                .map(|near| self.flags[self.geometry.index(near)]);
            match near {
                Some(flags) if flags & flag::INSIDE > 0 => {
                    flags & (flag::EVALUATED | flag::SUITABLE) != flag::EVALUATED
                }
                _ => self.params.nest.border_suitable,
            }
        })
    }

    fn note_connection(&mut self) {
        if self.tally.connected_at.is_none()
            && let Some((a, b)) = self.watched
            && self.flags[a] & self.flags[b] & flag::NEST > 0
            && self.sets.find(a as u32) == self.sets.find(b as u32)
        {
            self.tally.connected_at = Some(self.tally.ticks);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nest::{NestParams, Vicinity, exact_nests};
    use crate::progress::silent;
    use crate::random::philox;
    use crate::rank::RankMap;
    use crate::swarm::Explore;
    use proptest::prelude::*;

    fn world(rows: usize, columns: usize, seed: u64, holes: u32) -> RankMap {
        let geometry = GridGeometry::new(rows, columns, 1.0, 0.0, 0.0).unwrap();
        let ranks: Vec<u8> = (0..rows * columns)
            .map(|i| {
                let hole = philox([i as u32, 7, 0, 0], seed)[0] % 100 < holes;
                if hole { 4 } else { 8 }
            })
            .collect();
        RankMap::from_ranks(geometry, &ranks).unwrap()
    }

    fn everywhere(map: &RankMap) -> Layer<bool> {
        Layer::filled(map.cells().geometry(), true)
    }

    fn contacts() -> impl Strategy<Value = Contact> {
        prop_oneof![Just(Contact::Overlap), Just(Contact::Edge), Just(Contact::Corner)]
    }

    fn explorations() -> impl Strategy<Value = Explore> {
        prop_oneof![Just(Explore::Walk), Just(Explore::Uniform), Just(Explore::Permute)]
    }

    fn vicinities() -> impl Strategy<Value = Vicinity> {
        prop_oneof![
            Just(Vicinity::Cell),
            Just(Vicinity::VonNeumann1),
            Just(Vicinity::Moore1),
            Just(Vicinity::Disc(2.0))
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]

        #[test]
        fn the_limit_is_the_oracle_and_every_tick_is_inside_it(
            rows in 1usize..20, columns in 1usize..20, seed: u64, holes in 0u32..25, agents in 1u32..40,
            pellet_max in 1u8..4, contact in contacts(), explore in explorations(), vicinity in vicinities(),
            half: bool, border_suitable: bool,
        ) {
            let map = world(rows, columns, seed, holes);
            let mut inside = everywhere(&map);
            if half {
                for (i, cell) in inside.data_mut().iter_mut().enumerate() {
                    *cell = i % columns <= columns / 2;
                }
            }
            let nest = NestParams { vicinity, contact, border_suitable, ..NestParams::default() };
            let params = SwarmParams { agents, pellet_max, nest, explore, seed, ..SwarmParams::default() };
            let oracle = exact_nests(&map, Some(&inside), &nest).unwrap();
            let mut colony = Colony::deploy(&map, &inside, params).unwrap();
            for _ in 0..3 {
                colony.run(3, &mut silent());
                let nests = colony.nests().unwrap();
                for cell in map.cells().geometry().cells() {
                    prop_assert!(nests.label(cell) == 0 || oracle.label(cell) > 0);
                }
            }
            prop_assert_eq!(colony.run(1_000_000, &mut silent()), Ending::Finished);
            prop_assert_eq!(colony.nests().unwrap(), oracle);
            prop_assert!(colony.tally().cells_evaluated <= inside.data().iter().filter(|i| **i).count() as u64);
        }

        #[test]
        fn widening_ends_where_a_fresh_start_ends_and_evaluates_nothing_twice(
            seed: u64, holes in 0u32..20, cut in 1usize..18,
        ) {
            let map = world(12, 18, seed, holes);
            let mut narrow = everywhere(&map);
            for (i, cell) in narrow.data_mut().iter_mut().enumerate() {
                *cell = i % 18 < cut;
            }
            let params = SwarmParams { agents: 20, seed, ..SwarmParams::default() };
            let mut colony = Colony::deploy(&map, &narrow, params).unwrap();
            colony.run(1_000_000, &mut silent());
            colony.widen(&everywhere(&map)).unwrap();
            colony.run(1_000_000, &mut silent());
            prop_assert_eq!(colony.nests().unwrap(), exact_nests(&map, None, &params.nest).unwrap());
            prop_assert!(colony.tally().cells_evaluated <= 12 * 18);
        }

        #[test]
        fn many_threads_and_one_give_the_same_colony(seed: u64) {
            let map = world(40, 50, seed, 8);
            let params = SwarmParams { agents: PARALLEL_AGENTS, seed, pellet_max: 3, ..SwarmParams::default() };
            let run = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| {
                    let mut colony = Colony::deploy(&map, &everywhere(&map), params).unwrap();
                    colony.run(5, &mut silent());
                    (colony.nests().unwrap(), colony.tally(), colony.agents.clone(), colony.pellets.clone())
                })
            };
            let (one, many) = (run(1), run(3));
            prop_assert_eq!(one, many);
        }
    }

    #[test]
    fn a_permutation_finishes_in_as_many_epochs_as_pellets() {
        let map = world(30, 30, 5, 5);
        for pellet_max in 1..=3 {
            let params = SwarmParams {
                agents: 100,
                pellet_max,
                explore: Explore::Permute,
                ..SwarmParams::default()
            };
            let mut colony = Colony::deploy(&map, &everywhere(&map), params).unwrap();
            assert_eq!(colony.run(9 * u64::from(pellet_max), &mut silent()), Ending::Finished);
        }
    }

    #[test]
    fn a_hopeless_or_empty_swathe_is_finished_at_once_or_soon() {
        let map = world(5, 5, 0, 100);
        let params = SwarmParams::default();
        let mut colony = Colony::deploy(&map, &everywhere(&map), params).unwrap();
        assert_eq!(colony.run(10_000, &mut silent()), Ending::Finished);
        assert_eq!(colony.nests().unwrap().count(), 0);
        let nowhere = Layer::filled(map.cells().geometry(), false);
        let mut colony = Colony::deploy(&map, &nowhere, params).unwrap();
        assert_eq!(colony.run(1, &mut silent()), Ending::Finished);
        assert_eq!(colony.tally().visits, 0);
    }

    #[test]
    fn watching_notes_when_two_cells_connect_and_a_report_can_stop() {
        let map = world(30, 30, 1, 0);
        let params = SwarmParams {
            agents: 3,
            ..SwarmParams::default()
        };
        let mut colony = Colony::deploy(&map, &everywhere(&map), params).unwrap();
        colony.watch(Cell::new(0, 0), Cell::new(29, 29));
        assert_eq!(colony.run(1000, &mut |_, _| false), Ending::Stopped);
        assert_eq!(colony.tally().connected_at, None);
        colony.run(1_000_000, &mut silent());
        let at = colony.tally().connected_at.unwrap();
        assert!(0 < at && at <= colony.tally().ticks);
    }

    #[test]
    fn parameters_outside_their_range_are_named() {
        let bad = [
            SwarmParams {
                agents: 0,
                ..SwarmParams::default()
            },
            SwarmParams {
                pellet_max: 0,
                ..SwarmParams::default()
            },
            SwarmParams {
                teleport: 1.5,
                ..SwarmParams::default()
            },
            SwarmParams {
                attract: f64::NAN,
                ..SwarmParams::default()
            },
        ];
        for params in bad {
            assert!(matches!(params.validate(), Err(SwarmError::Parameter { .. })));
        }
    }
}
