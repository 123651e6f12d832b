//! Ticks: agents move, look, drop pellets and build.
//!
//! Moves are pure functions of the seed, so those of several ticks are worked out ahead, agents in parallel. Cells that nobody
//! knows yet are gathered before they are looked at, in parallel too; what follows from a rank is noted in order. Where the
//! lines between threads run therefore changes nothing.

use std::hint::black_box;
use std::ops::Range;

use rayon::prelude::*;

use crate::grid::{Cell, EIGHT, FOUR, Step};
use crate::nest::Contact;
use crate::rank::{CellRank, CellSource};
use crate::swarm::agents::Field;
use crate::swarm::{Explore, State, StopRule};

use super::{Colony, GROUND, flag};

/// Most visits that are worked out ahead.
const VISITS_AHEAD: u64 = 1 << 18;

/// Agents whose moves are worked out together.
const BLOCK: usize = 64;

/// Rows to the north and south of where an agent comes down that it is likely to walk on.
const TOUCHED_ROWS: usize = 3;

/// From this many moves, or looks, on several threads share them.
const PARALLEL_MOVES: usize = 1 << 14;
const PARALLEL_LOOKS: usize = 1 << 10;

/// The cells that agents visit in the next ticks: blocks of agents, in each block tick by tick.
struct Ahead {
    ticks: usize,
    agents: usize,
    cells: Vec<u32>,
    /// For each block and tick a bit for each visit that is not in vain: those that will change nothing, because the cell
    /// was known and had no room for a pellet when the moves were worked out, need no second look.
    busy: Vec<u64>,
}

impl Ahead {
    /// Agents and the cells of their visits in one tick, agent by agent: those not in vain, or the others.
    fn visits(&self, tick: usize, busy: bool) -> impl Iterator<Item = (usize, u32)> + Clone {
        let blocks = self.cells.chunks(BLOCK * self.ticks).zip(self.busy.chunks(self.ticks));
        blocks.enumerate().flat_map(move |(block, (cells, marks))| {
            let crew = u64::MAX >> (BLOCK - BLOCK.min(self.agents - block * BLOCK));
            let chosen = crew & if busy { marks[tick] } else { !marks[tick] };
            places(chosen).map(move |place| (block * BLOCK + place, cells[tick * BLOCK + place]))
        })
    }
}

/// The places of the bits that are set.
fn places(word: u64) -> impl Iterator<Item = usize> + Clone {
    let mut left = word;
    std::iter::from_fn(move || {
        let place = (left > 0).then_some(left.trailing_zeros() as usize);
        left &= left.wrapping_sub(1);
        place
    })
}

impl<Source: CellSource> Colony<Source> {
    /// Spends at most `ticks` ticks, less when the swarm is over; at least one of one that is not, unless ground that is
    /// needed cannot be read ([`Self::spent`]).
    pub(super) fn spend(&mut self, ticks: u64) {
        let ahead = self.ahead(ticks);
        if !self.prefetch(&mut ahead.cells.iter().map(|&cell| cell as usize)) {
            return;
        }
        let mut spent = 0;
        while spent < ahead.ticks && self.over().is_none() {
            let since_start = self.tally.ticks - self.epoch_start;
            self.tally.ticks += 1;
            self.tally.visits += ahead.agents as u64;
            self.trace_idle(since_start, &ahead, spent);
            self.serve(since_start, ahead.visits(spent, true));
            spent += 1;
        }
        if let Some(last) = spent.checked_sub(1) {
            for (block, agents) in self.agents.chunks_mut(BLOCK).enumerate() {
                let first = (block * ahead.ticks + last) * BLOCK;
                agents.copy_from_slice(&ahead.cells[first..first + agents.len()]);
            }
        }
    }

    /// Notes the turns of agents whose visits are in vain.
    fn trace_idle(&mut self, since_start: u64, ahead: &Ahead, tick: usize) {
        if cfg!(test) {
            for (agent, cell) in ahead.visits(tick, false) {
                let arrival = self.params.arrival(agent as u32, since_start);
                self.trace.arrive(since_start, Some(arrival));
                let suitable = self.flags[cell as usize] & flag::SUITABLE > 0;
                self.trace.enter_if(suitable, State::Count);
                self.trace.enter(State::Forage);
            }
        }
    }

    fn counts_quiet(&self) -> bool {
        matches!(self.rule, StopRule::Statistical { .. })
    }

    /// Has the source read what ticks need that visit these cells: the cells, and the vicinities of those that become foci.
    /// Returns whether it is there.
    pub(super) fn prefetch(&mut self, visits: &mut dyn Iterator<Item = usize>) -> bool {
        let mut cells = visits.map(|index| self.geometry.cell(index));
        self.fault = self.source.prefetch(&mut cells, self.vicinity_reach).err();
        self.fault.is_none()
    }

    /// Works out where agents go, as far ahead as nothing that they find can turn them.
    fn ahead(&self, ticks: u64) -> Ahead {
        let led_by_pellets = self.params.explore == Explore::Walk && self.params.attract > 0.0;
        let agents = self.agents.len();
        let most = if led_by_pellets {
            1
        } else {
            (VISITS_AHEAD / agents as u64).max(1)
        };
        let ticks = ticks.min(most) as usize;
        let field = Field {
            geometry: self.geometry,
            extent: self.extent,
            params: &self.params,
            inside: |index: usize| self.flags[index] & GROUND == flag::INSIDE,
            pellets: |index: usize| self.pellets_at(index),
        };
        // The statistical rule counts visits in vain, too.
        let counts_quiet = self.counts_quiet();
        let first_tick = self.tally.ticks - self.epoch_start;
        let blocks = agents.div_ceil(BLOCK);
        let (mut cells, mut busy) = (vec![0; blocks * BLOCK * ticks], vec![0; blocks * ticks]);
        let walk = |(block, (cells, busy)): (usize, (&mut [u32], &mut [u64]))| {
            let first = block * BLOCK;
            let mut here = [Cell::new(0, 0); BLOCK];
            let agents = &self.agents[first..agents.min(first + BLOCK)];
            for (here, &agent) in here.iter_mut().zip(agents) {
                *here = self.geometry.cell(agent as usize);
            }
            let draws = self.draw_and_touch(
                &field,
                first..first + agents.len(),
                first_tick..first_tick + ticks as u64,
            );
            let ticks = (first_tick..).zip(draws.chunks(agents.len()));
            for (((tick, draws), cells), busy) in ticks.zip(cells.chunks_mut(BLOCK)).zip(busy) {
                for (agent, ((here, cell), &draw)) in here.iter_mut().zip(cells).zip(draws).enumerate() {
                    *here = field.visit((first + agent) as u32, tick, draw, *here);
                    let index = self.geometry.index(*here);
                    *cell = index as u32;
                    *busy |= u64::from(counts_quiet || !is_vain(self.flags[index])) << agent;
                }
            }
        };
        if agents * ticks < PARALLEL_MOVES {
            let blocks = cells.chunks_mut(BLOCK * ticks).zip(busy.chunks_mut(ticks));
            blocks.enumerate().for_each(walk);
        } else {
            let blocks = cells.par_chunks_mut(BLOCK * ticks).zip(busy.par_chunks_mut(ticks));
            blocks.enumerate().for_each(walk);
        }
        Ahead {
            ticks,
            agents,
            cells,
            busy,
        }
    }

    /// The numbers by which moves are decided, tick by tick. Ground on which agents will come down is touched, all of it one
    /// after the other, so that the memory it lies in is on its way when the moves are made.
    fn draw_and_touch<Inside: Fn(usize) -> bool, Pellets: Fn(usize) -> u8>(
        &self,
        field: &Field<Inside, Pellets>,
        agents: Range<usize>,
        ticks: Range<u64>,
    ) -> Vec<[u32; 2]> {
        let mut draws = Vec::with_capacity(agents.len() * (ticks.end - ticks.start) as usize);
        let mut landings = Vec::new();
        for tick in ticks {
            for agent in agents.clone() {
                let draw = self.params.draw(agent as u32, tick);
                draws.push(draw);
                if self.params.is_deployed(tick, draw) {
                    landings.push(self.geometry.index(field.landing(agent as u32, tick, 1)));
                }
            }
        }
        let columns = self.geometry.columns();
        let reach = if self.params.explore == Explore::Walk {
            TOUCHED_ROWS
        } else {
            0
        };
        let mut sum = 0u8;
        for landing in landings {
            for row in 0..=2 * reach {
                let index = (landing + row * columns).wrapping_sub(reach * columns);
                sum ^= self.flags.get(index).copied().unwrap_or(0);
            }
        }
        black_box(sum);
        draws
    }

    /// One synchronous tick, given where each agent goes: look, drop, build.
    pub(super) fn tick(&mut self, visits: &[u32]) {
        let since_start = self.tally.ticks - self.epoch_start;
        self.tally.ticks += 1;
        self.tally.visits += visits.len() as u64;
        self.agents[..visits.len()].copy_from_slice(visits);
        self.serve(since_start, visits.iter().copied().enumerate());
    }

    /// What agents do on the cells that they visit in a tick: look, drop, build.
    pub(super) fn serve(&mut self, since_start: u64, visits: impl Iterator<Item = (usize, u32)> + Clone) {
        if self.params.explore != Explore::Permute || self.params.nest.contact == Contact::Overlap {
            self.build_sets();
        }
        let mut unseen = Vec::new();
        for (_, cell) in visits.clone() {
            self.claim(cell as usize, &mut unseen);
        }
        self.look(&unseen);
        let mut full = Vec::new();
        let counts_quiet = self.counts_quiet();
        for (agent, cell) in visits {
            let arrival = self.params.arrival(agent as u32, since_start);
            self.trace.arrive(since_start, Some(arrival));
            let index = cell as usize;
            let flags = self.flags[index];
            self.trace.enter_if(flags & flag::SUITABLE > 0, State::Count);
            let is_news = flags & (flag::SUITABLE | flag::FULL) == flag::SUITABLE;
            if counts_quiet && arrival == State::Deploy {
                self.quiet_visits = if is_news { 0 } else { self.quiet_visits + 1 };
            }
            if is_news {
                self.trace.enter(State::Drop);
                if self.drop_pellet(index) {
                    full.push(self.geometry.cell(index));
                    self.trace.enter(State::Build);
                }
            }
            self.trace.enter(State::Forage);
        }
        self.build(full);
        self.note_connection();
    }

    /// Puts a cell of the swathe that nobody knows on the list of those to look at, once. Returns whether it is known then;
    /// the budget may forbid that.
    fn claim(&mut self, index: usize, unseen: &mut Vec<u32>) -> bool {
        let flags = &mut self.flags[index];
        if *flags & (flag::EVALUATED | flag::INSIDE) == flag::INSIDE {
            let count = self.tally.cells_evaluated + unseen.len() as u64;
            if self.budget.evaluations.is_some_and(|most| count >= most) {
                return false;
            }
            *flags |= flag::EVALUATED;
            unseen.push(index as u32);
        }
        true
    }

    /// Asks for the ranks of claimed cells and takes note of them in order.
    fn look(&mut self, claimed: &[u32]) {
        if claimed.len() < PARALLEL_LOOKS {
            for &index in claimed {
                let rank = self.source.cell_rank(self.geometry.cell(index as usize));
                self.learn(index as usize, rank);
            }
            return;
        }
        let (source, geometry) = (&self.source, self.geometry);
        let ranks = claimed
            .par_iter()
            .with_min_len(PARALLEL_LOOKS / 4)
            .map(|&index| source.cell_rank(geometry.cell(index as usize)));
        let ranks: Vec<CellRank> = ranks.collect();
        for (&index, rank) in claimed.iter().zip(ranks) {
            self.learn(index as usize, rank);
        }
    }

    /// Takes note of a cell's rank.
    fn learn(&mut self, index: usize, rank: CellRank) {
        self.tally.cells_evaluated += 1;
        if rank.rank() >= self.params.nest.rank_min {
            self.flags[index] |= flag::SUITABLE;
            return;
        }
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

    /// The core test of cells whose pellets are full. All look at the same place of their vicinity at a time, so that a cell
    /// that turns out unsuitable spares those around it the rest.
    pub(super) fn build(&mut self, mut full: Vec<Cell>) {
        let mut unseen = Vec::new();
        for &cell in &full {
            self.trace.enter_at(cell, State::Build);
        }
        if self.params.explore == Explore::Permute {
            self.look_around(&full);
        }
        for step in 0..self.vicinity.len() {
            full.retain(|&cell| {
                let flags = self.flags[self.geometry.index(cell)];
                self.trace.leave_if(flags, cell);
                flags & (flag::DEAD | flag::CORE) == 0
            });
            if full.is_empty() {
                return;
            }
            unseen.clear();
            full.retain(|&cell| {
                self.trace.enter_at(cell, State::Examine);
                let near = self.vicinity[step].from(&self.geometry, cell);
                let known = near.is_none_or(|near| self.claim(self.geometry.index(near), &mut unseen));
                if !known {
                    // A test that the budget cuts short is made again after the next pellet.
                    self.take_pellet(self.geometry.index(cell));
                }
                known
            });
            self.look(&unseen);
        }
        for cell in full {
            let index = self.geometry.index(cell);
            let flags = self.flags[index];
            self.trace.leave_if(flags, cell);
            if flags & (flag::DEAD | flag::CORE) == 0 {
                self.trace.take_up(cell, State::Core);
                self.flags[index] |= flag::CORE;
                self.open -= 1;
                self.tally.cores += 1;
                self.settle(cell);
                self.trace.enter(State::Forage);
            }
        }
    }

    /// Looks at the whole vicinity of foci. What a permuting swarm knows is thereby decided by its visits alone, whatever
    /// order they came in, so that those of a tile can be made at once.
    fn look_around(&mut self, foci: &[Cell]) {
        let mut unseen = Vec::new();
        for &focus in foci {
            for step in 0..self.vicinity.len() {
                if let Some(near) = self.vicinity[step].from(&self.geometry, focus) {
                    self.claim(self.geometry.index(near), &mut unseen);
                }
            }
        }
        self.look(&unseen);
    }

    /// Makes the vicinity of a core ground of its nest.
    fn settle(&mut self, core: Cell) {
        let index = self.geometry.index(core);
        for step in 0..self.vicinity.len() {
            if let Some(near) = self.vicinity[step].from(&self.geometry, core) {
                let near_index = self.geometry.index(near);
                if self.flags[near_index] & flag::INSIDE > 0 {
                    self.trace.enter(State::Join);
                    if self.params.nest.contact == Contact::Overlap {
                        let joined = self.sets.union(index as u32, near_index as u32);
                        let nest = self.flags[near_index] & flag::NEST > 0;
                        self.trace.enter_if(joined && nest, State::Merge);
                    }
                    self.join(near);
                }
            }
        }
    }

    /// Adds a cell to its nest and merges the nests that it touches.
    pub(super) fn join(&mut self, cell: Cell) {
        let index = self.geometry.index(cell);
        if self.flags[index] & flag::NEST > 0 {
            return;
        }
        self.flags[index] |= flag::NEST;
        if self.sets.is_empty() {
            return;
        }
        let touching: &[Step] = match self.params.nest.contact {
            Contact::Overlap => &[],
            Contact::Edge => &FOUR,
            Contact::Corner => &EIGHT,
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
}

/// Whether a visit to a cell with these flags changes nothing: it is known, and has no room for a pellet.
fn is_vain(flags: u8) -> bool {
    flags & flag::EVALUATED > 0 && flags & (flag::SUITABLE | flag::FULL) != flag::SUITABLE
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{GridGeometry, Layer};
    use crate::nest::{NestParams, Nests, Vicinity, exact_nests};
    use crate::progress::silent;
    use crate::random::philox;
    use crate::rank::RankMap;
    use crate::swarm::{Ending, SwarmParams, Tally};
    use proptest::prelude::*;

    fn world(rows: usize, columns: usize, seed: u64, holes: u32) -> RankMap {
        let geometry = GridGeometry::new(rows, columns, 1.0, 0.0, 0.0).unwrap();
        let hole = |i: usize| philox([i as u32, 11, 0, 0], seed)[0] % 1000 < holes;
        let ranks: Vec<u8> = (0..rows * columns).map(|i| if hole(i) { 4 } else { 8 }).collect();
        RankMap::from_ranks(geometry, &ranks).unwrap()
    }

    fn everywhere(map: &RankMap) -> Layer<bool> {
        Layer::filled(map.cells().geometry(), true)
    }

    /// All that a colony holds.
    type Bytes = (Nests, Tally, Vec<u32>, Vec<u8>, Vec<u8>, Ending);

    fn bytes(colony: &Colony<&RankMap>, ending: Ending) -> Bytes {
        (
            colony.nests().unwrap(),
            colony.tally(),
            colony.agents.clone(),
            colony.pellets.clone(),
            colony.flags.clone(),
            ending,
        )
    }

    fn on_threads(threads: usize, map: &RankMap, params: SwarmParams, ticks: u64) -> Bytes {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut colony = Colony::deploy(map, &everywhere(map), params).unwrap();
            let ending = colony.run(ticks, &mut silent());
            bytes(&colony, ending)
        })
    }

    fn explorations() -> impl Strategy<Value = (Explore, f64)> {
        prop_oneof![
            Just((Explore::Walk, 0.0)),
            Just((Explore::Walk, 3.0)),
            Just((Explore::Uniform, 0.0)),
            Just((Explore::Permute, 0.0))
        ]
    }

    fn agent_counts() -> impl Strategy<Value = u32> {
        prop_oneof![
            10u32..100,
            100u32..5000,
            Just(16_384u32),
            30_000u32..=100_000,
            Just(100_000u32)
        ]
    }

    fn ends_of_seeds() -> impl Strategy<Value = u64> {
        prop_oneof![Just(0u64), Just(u64::MAX), any::<u64>()]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn one_two_and_eight_threads_give_the_same_bytes(
            agents in agent_counts(), seed in ends_of_seeds(), explore in explorations(), rows in 20usize..160,
            columns in 20usize..160, holes in 0u32..150, pellet_max in 1u8..4, ticks in 1u64..70,
        ) {
            let map = world(rows, columns, seed, holes);
            let (explore, attract) = explore;
            let params = SwarmParams { agents, pellet_max, attract, explore, seed, ..SwarmParams::default() };
            // Many agents settle such a map in few ticks.
            let ticks = ticks.min(1 + 2_000_000 / u64::from(agents));
            let one = on_threads(1, &map, params, ticks);
            prop_assert_eq!(&one, &on_threads(2, &map, params, ticks));
            prop_assert_eq!(&one, &on_threads(8, &map, params, ticks));
        }

        #[test]
        fn runs_cut_anywhere_are_one_run(
            agents in 1u32..300, seed: u64, explore in explorations(), cuts in prop::collection::vec(0u64..40, 1..6),
        ) {
            let map = world(30, 40, seed, 60);
            let (explore, attract) = explore;
            let params = SwarmParams { agents, attract, explore, seed, ..SwarmParams::default() };
            let mut pieces = Colony::deploy(&map, &everywhere(&map), params).unwrap();
            let mut ending = Ending::TicksSpent;
            for &ticks in &cuts {
                ending = pieces.run(ticks, &mut silent());
            }
            let mut whole = Colony::deploy(&map, &everywhere(&map), params).unwrap();
            let at_once = whole.run(cuts.iter().sum(), &mut silent());
            prop_assert_eq!(bytes(&pieces, ending), bytes(&whole, at_once));
        }

        #[test]
        fn each_cell_is_asked_for_once_whatever_the_crowd(agents in agent_counts(), seed: u64, explore in explorations()) {
            let map = world(60, 70, seed, 80);
            let source = Counting { map: &map, asked: std::sync::atomic::AtomicU64::new(0) };
            let (explore, attract) = explore;
            let params = SwarmParams { agents, attract, explore, seed, ..SwarmParams::default() };
            let mut colony = Colony::deploy(&source, &everywhere(&map), params).unwrap();
            colony.run(1_000_000, &mut silent());
            let asked = source.asked.load(std::sync::atomic::Ordering::Relaxed);
            prop_assert_eq!(asked, colony.tally().cells_evaluated);
            prop_assert!(asked <= 60 * 70);
        }
    }

    struct Counting<'a> {
        map: &'a RankMap,
        asked: std::sync::atomic::AtomicU64,
    }

    impl CellSource for Counting<'_> {
        fn geometry(&self) -> GridGeometry {
            self.map.geometry()
        }

        fn cell_rank(&self, cell: Cell) -> CellRank {
            self.asked.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            self.map.cell_rank(cell)
        }
    }

    #[test]
    fn more_agents_than_cells_and_a_map_of_one_cell_end_with_the_exact_nests() {
        for (rows, columns) in [(1, 1), (1, 7), (3, 3), (9, 4)] {
            for (vicinity, border_suitable) in [
                (Vicinity::Cell, false),
                (Vicinity::Moore1, true),
                (Vicinity::Moore1, false),
            ] {
                for (agents, seed) in [(1, 0), (40, u64::MAX), (100_000, 0), (100_000, u64::MAX)] {
                    let map = world(rows, columns, 3, 50);
                    let nest = NestParams {
                        vicinity,
                        border_suitable,
                        ..NestParams::default()
                    };
                    let params = SwarmParams {
                        agents,
                        nest,
                        seed,
                        ..SwarmParams::default()
                    };
                    let mut colony = Colony::deploy(&map, &everywhere(&map), params).unwrap();
                    assert_eq!(colony.run(0, &mut silent()) == Ending::Finished, colony.open == 0);
                    assert_eq!(colony.tally(), Tally::default());
                    assert_eq!(colony.run(100_000, &mut silent()), Ending::Finished);
                    assert_eq!(colony.nests().unwrap(), exact_nests(&map, None, &nest).unwrap());
                }
            }
        }
    }
}
