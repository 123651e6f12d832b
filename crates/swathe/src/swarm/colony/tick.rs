//! Ticks: agents move, look, drop pellets and build.
//!
//! Moves are pure functions of the seed, so those of several ticks are worked out ahead, agents in parallel. Cells that nobody
//! knows yet are gathered before they are looked at, in parallel too; what follows from a rank is noted in order. Where the
//! lines between threads run therefore changes nothing.

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

/// From this many moves, or looks, on several threads share them.
const PARALLEL_MOVES: usize = 1 << 14;
const PARALLEL_LOOKS: usize = 1 << 10;

/// No cell: the agent rests in this tick.
const NOWHERE: u32 = u32::MAX;

/// The cells that agents visit in the next ticks: blocks of agents, in each block tick by tick.
struct Ahead {
    ticks: usize,
    agents: usize,
    cells: Vec<u32>,
}

impl Ahead {
    /// The cells of one tick, agent by agent.
    fn visits(&self, tick: usize) -> impl Iterator<Item = u32> + Clone {
        let blocks = self.cells.chunks(BLOCK * self.ticks);
        blocks
            .flat_map(move |block| &block[tick * BLOCK..(tick + 1) * BLOCK])
            .copied()
            .take(self.agents)
    }
}

impl<Source: CellSource> Colony<Source> {
    /// Spends at most `ticks` ticks, less when the swarm is over; at least one of one that is not.
    pub(super) fn spend(&mut self, ticks: u64) {
        let ahead = self.ahead(ticks);
        for tick in 0..ahead.ticks {
            if self.over().is_some() {
                return;
            }
            self.tick(ahead.visits(tick));
        }
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
            pellets: |index: usize| self.pellets[index],
        };
        let first_tick = self.tally.ticks - self.epoch_start;
        let mut cells = vec![NOWHERE; agents.div_ceil(BLOCK) * BLOCK * ticks];
        let walk = |(block, cells): (usize, &mut [u32])| {
            let first = block * BLOCK;
            let mut here = [0; BLOCK];
            let agents = &self.agents[first..agents.min(first + BLOCK)];
            here[..agents.len()].copy_from_slice(agents);
            for (tick, cells) in (first_tick..).zip(cells.chunks_mut(BLOCK)) {
                for (agent, (here, cell)) in here.iter_mut().zip(cells).enumerate().take(agents.len()) {
                    if let Some(index) = field.visit((first + agent) as u32, tick, *here as usize) {
                        *here = index as u32;
                        *cell = index as u32;
                    }
                }
            }
        };
        if agents * ticks < PARALLEL_MOVES {
            cells.chunks_mut(BLOCK * ticks).enumerate().for_each(walk);
        } else {
            cells.par_chunks_mut(BLOCK * ticks).enumerate().for_each(walk);
        }
        Ahead { ticks, agents, cells }
    }

    /// One synchronous tick, given where each agent goes: look, drop, build.
    pub(super) fn tick(&mut self, visits: impl Iterator<Item = u32> + Clone) {
        let since_start = self.tally.ticks - self.epoch_start;
        self.tally.ticks += 1;
        let mut unseen = Vec::new();
        for cell in visits.clone().filter(|&cell| cell != NOWHERE) {
            self.claim(cell as usize, &mut unseen);
        }
        self.look(&unseen);
        let mut full = Vec::new();
        let counts_quiet = matches!(self.rule, StopRule::Statistical { .. });
        for (agent, cell) in visits.enumerate() {
            let arrival = (cell != NOWHERE).then(|| self.params.arrival(agent as u32, since_start));
            self.trace.arrive(since_start, arrival);
            if cell == NOWHERE {
                continue;
            }
            self.tally.visits += 1;
            self.agents[agent] = cell;
            let index = cell as usize;
            let pellets = &mut self.pellets[index];
            let suitable = self.flags[index] & flag::SUITABLE > 0;
            self.trace.enter_if(suitable, State::Count);
            if counts_quiet && arrival == Some(State::Deploy) {
                let is_news = suitable && *pellets < self.params.pellet_max;
                self.quiet_visits = if is_news { 0 } else { self.quiet_visits + 1 };
            }
            if suitable && *pellets < self.params.pellet_max {
                *pellets += 1;
                self.trace.enter(State::Drop);
                if *pellets == self.params.pellet_max {
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
                    self.pellets[self.geometry.index(cell)] -= 1;
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
