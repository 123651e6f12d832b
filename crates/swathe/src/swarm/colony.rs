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
use crate::rank::CellSource;

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
mod tests {
    use super::*;
    use crate::nest::{Contact, NestParams, Vicinity, exact_nests};
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

    /// FNV-1a of everything that a run leaves behind.
    fn checksum(params: SwarmParams, ticks: u64) -> u64 {
        let map = world(90, 70, 3, 6);
        let mut inside = everywhere(&map);
        for (i, cell) in inside.data_mut().iter_mut().enumerate() {
            *cell = i % 70 + i / 70 > 20;
        }
        let mut colony = Colony::deploy(&map, &inside, params).unwrap();
        colony.run(ticks, &mut silent());
        let tally = colony.tally();
        let cells = map.cells().geometry().cells();
        let pellets = cells.map(|cell| u64::from(colony.pellets(cell)));
        let agents = colony.agents().map(|cell| (cell.row * 70 + cell.column) as u64);
        let counts = [tally.ticks, tally.visits, tally.cells_evaluated, tally.cores];
        let numbers = pellets.chain(agents).chain(counts).collect::<Vec<_>>();
        let nests = colony.nests().unwrap();
        let labels = nests.labels().data().iter().map(|&label| u64::from(label));
        let bytes = numbers.into_iter().chain(labels).flat_map(u64::to_le_bytes);
        bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        })
    }

    #[test]
    fn the_same_seed_leaves_the_same_bytes_as_ever() {
        let with = |explore, pellet_max, attract, agents, contact| SwarmParams {
            explore,
            pellet_max,
            attract,
            agents,
            nest: NestParams {
                contact,
                ..NestParams::default()
            },
            seed: 0x1234_5678_9abc,
            ..SwarmParams::default()
        };
        let found = [
            checksum(with(Explore::Walk, 1, 0.0, 40, Contact::Edge), 60),
            checksum(with(Explore::Walk, 3, 0.0, 5000, Contact::Corner), 5),
            checksum(with(Explore::Walk, 2, 2.5, 300, Contact::Overlap), 25),
            checksum(with(Explore::Uniform, 2, 0.0, 100, Contact::Edge), 80),
        ];
        assert_eq!(
            found,
            [
                0x6b1c_40a4_0355_3a34,
                0xbde9_4245_4241_4ec5,
                0x435e_2957_0fcb_f018,
                0xf7c0_1823_0a22_62a7
            ]
        );
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
