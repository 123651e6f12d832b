//! Changed ranks: pellets, cores and nests follow them, and only the nests that lost a core are labelled anew.

use crate::grid::{Cell, EIGHT, FOUR, GridError};
use crate::nest::Contact;
use crate::rank::CellSource;
use crate::swarm::SwarmError;

use super::{Colony, flag};

/// What an update has changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// Cells that were looked at: changed cells that were known before, and what was missing around cells that became cores
    /// at once.
    pub cells_evaluated: u64,
    /// Cells that were suitable and are no more.
    pub cells_fallen: u64,
    /// Cells that were unsuitable and are suitable now.
    pub cells_risen: u64,
    /// Cores that are cores no more.
    pub cores_lost: u64,
    /// Cells that may become cores again.
    pub cells_reopened: u64,
    /// Nests that lost a core.
    pub nests_touched: u64,
    /// Cells of those nests: all that were labelled anew.
    pub cells_relabelled: u64,
}

impl<Source: CellSource> Colony<Source> {
    /// Follows the source after the ranks of `changed` cells have changed (falls and rises, each cell once or more often).
    ///
    /// Cells that nobody has looked at stay unseen. Nests hold what is known of the present map at once; what the rises
    /// allow is found by the next [`Self::run`], which ends with the nests of the present map.
    ///
    /// # Errors
    /// [`SwarmError::Grid`] when a cell lies outside the map, or the source has another shape now; nothing is changed then.
    pub fn update(&mut self, changed: &[Cell]) -> Result<Changes, SwarmError> {
        self.check_changes(changed)?;
        // What rises may make cores of cells around it, which look at their own vicinity.
        self.source
            .prefetch(&mut changed.iter().copied(), 2 * self.vicinity_reach)?;
        self.build_sets();
        let mut changes = Changes::default();
        let seen_before = self.tally.cells_evaluated;
        let around = self.look_again(changed, &mut changes);
        let (mut lost, mut full) = (Vec::new(), Vec::new());
        for index in around {
            let index = index as usize;
            let (flags, may_be_core) = (self.flags[index], self.may_be_core(index));
            if flags & flag::DEAD > 0 && may_be_core {
                self.flags[index] &= !flag::DEAD;
                self.open += 1;
                changes.cells_reopened += 1;
                if flags & flag::FULL > 0 {
                    // No further pellet would bring it to the test.
                    full.push(self.geometry.cell(index));
                }
            } else if flags & flag::DEAD == 0 && !may_be_core {
                self.flags[index] |= flag::DEAD;
                if flags & flag::CORE > 0 {
                    self.flags[index] &= !flag::CORE;
                    lost.push(self.geometry.cell(index));
                } else {
                    self.open -= 1;
                }
            }
        }
        changes.cores_lost = lost.len() as u64;
        (changes.nests_touched, changes.cells_relabelled) = self.forget_cores(&lost);
        self.build(full);
        changes.cells_evaluated = self.tally.cells_evaluated - seen_before;
        self.note_connection();
        Ok(changes)
    }

    /// Takes note that some cells are cores no more; returns how many nests and how many cells of them are labelled anew.
    pub(super) fn forget_cores(&mut self, lost: &[Cell]) -> (u64, u64) {
        self.tally.cores -= lost.len() as u64;
        if !lost.is_empty() {
            self.build_sets();
        }
        let touched = self.relabel(lost);
        if !lost.is_empty() && !self.is_connected() {
            self.tally.connected_at = None;
        }
        touched
    }

    fn check_changes(&self, changed: &[Cell]) -> Result<(), SwarmError> {
        let (known, given) = (self.geometry, self.source.geometry());
        for (what, expected, found) in [
            ("A row of the changed map", known.columns(), given.columns()),
            ("A column of the changed map", known.rows(), given.rows()),
        ] {
            if expected != found {
                return Err(GridError::ShapeMismatch { what, expected, found }.into());
            }
        }
        let outside = |cell: &&Cell| cell.row >= known.rows() || cell.column >= known.columns();
        changed.iter().find(outside).map_or(Ok(()), |cell| {
            Err(GridError::OutsideGrid {
                row: cell.row as i64,
                column: cell.column as i64,
                rows: known.rows(),
                columns: known.columns(),
            }
            .into())
        })
    }

    /// Asks again for the ranks of known cells; returns the cells whose core test may come out otherwise now, in order.
    fn look_again(&mut self, changed: &[Cell], changes: &mut Changes) -> Vec<u32> {
        let mut known: Vec<usize> = changed.iter().map(|&cell| self.geometry.index(cell)).collect();
        known.retain(|&index| self.flags[index] & flag::EVALUATED > 0);
        known.sort_unstable();
        known.dedup();
        self.tally.cells_evaluated += known.len() as u64;
        let mut around = Vec::new();
        for index in known {
            let cell = self.geometry.cell(index);
            let suitable = self.source.cell_rank(cell).rank() >= self.params.nest.rank_min;
            if suitable == (self.flags[index] & flag::SUITABLE > 0) {
                continue;
            }
            self.flags[index] ^= flag::SUITABLE;
            if suitable {
                changes.cells_risen += 1;
            } else {
                changes.cells_fallen += 1;
                self.clear_pellets(index);
            }
            // Vicinities are symmetric: these are the cells in whose vicinity the changed one lies.
            let near = self.vicinity.iter().filter_map(|step| step.from(&self.geometry, cell));
            let near = near.map(|near| self.geometry.index(near));
            around.extend(
                near.filter(|&near| self.flags[near] & flag::INSIDE > 0)
                    .map(|near| near as u32),
            );
        }
        around.sort_unstable();
        around.dedup();
        around
    }

    /// Labels the nests of lost cores anew.
    fn relabel(&mut self, lost: &[Cell]) -> (u64, u64) {
        let mut nests = 0;
        let mut members = Vec::new();
        for &core in lost {
            for step in 0..self.vicinity.len() {
                let near = self.vicinity[step].from(&self.geometry, core);
                if let Some(index) = near.map(|near| self.geometry.index(near))
                    && self.flags[index] & flag::NEST > 0
                {
                    nests += 1;
                    self.leave(index, &mut members);
                }
            }
        }
        self.sets.separate(&members);
        for &index in &members {
            let cell = self.geometry.cell(index as usize);
            for step in 0..self.vicinity.len() {
                let core = self.vicinity[step].from(&self.geometry, cell);
                let core = core.map(|core| self.geometry.index(core));
                if let Some(core) = core.filter(|&core| self.flags[core] & flag::CORE > 0) {
                    self.join(cell);
                    if self.params.nest.contact != Contact::Overlap {
                        break;
                    }
                    self.sets.union(index, core as u32);
                }
            }
        }
        (nests, members.len() as u64)
    }

    /// Takes every cell of the nest that holds a cell out of it and puts them at the end of `members`.
    fn leave(&mut self, index: usize, members: &mut Vec<u32>) {
        let mut next = members.len();
        self.flags[index] &= !flag::NEST;
        members.push(index as u32);
        let root = self.sets.find(index as u32);
        while let Some(&member) = members.get(next) {
            next += 1;
            let cell = self.geometry.cell(member as usize);
            let touching = match self.params.nest.contact {
                Contact::Overlap => &self.vicinity[..],
                Contact::Edge => &FOUR,
                Contact::Corner => &EIGHT,
            };
            for step in touching {
                if let Some(near) = step.from(&self.geometry, cell) {
                    let near = self.geometry.index(near);
                    if self.flags[near] & flag::NEST > 0 && self.sets.find(near as u32) == root {
                        self.flags[near] &= !flag::NEST;
                        members.push(near as u32);
                    }
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
    use crate::rank::{CellRank, RankMap};
    use crate::swarm::{Ending, Explore, SwarmParams};
    use proptest::prelude::*;
    use std::collections::BTreeSet;
    use std::sync::Mutex;

    const FOREVER: u64 = 1_000_000;

    /// A map that writes down which cells it was asked for.
    struct Watched {
        map: RankMap,
        asked: Mutex<Vec<Cell>>,
    }

    impl Watched {
        fn new(rows: usize, columns: usize, seed: u64, holes: u32) -> Self {
            let geometry = GridGeometry::new(rows, columns, 1.0, 0.0, 0.0).unwrap();
            let hole = |i: usize| philox([i as u32, 23, 0, 0], seed)[0] % 100 < holes;
            let ranks: Vec<u8> = (0..rows * columns).map(|i| if hole(i) { 4 } else { 8 }).collect();
            Self {
                map: RankMap::from_ranks(geometry, &ranks).unwrap(),
                asked: Mutex::default(),
            }
        }

        fn rank(&mut self, cell: Cell, rank: u8) {
            self.map.cells_mut()[cell] = CellRank::ranked(rank);
        }

        /// The cells asked for since the last call, each at most once.
        fn asked(&self) -> BTreeSet<Cell> {
            let asked = std::mem::take(&mut *self.asked.lock().unwrap());
            let cells: BTreeSet<Cell> = asked.iter().copied().collect();
            assert_eq!(cells.len(), asked.len(), "a cell was asked for twice");
            cells
        }
    }

    impl CellSource for Watched {
        fn geometry(&self) -> GridGeometry {
            self.map.geometry()
        }

        fn cell_rank(&self, cell: Cell) -> CellRank {
            self.asked.lock().unwrap().push(cell);
            self.map.cell_rank(cell)
        }
    }

    fn vicinities() -> impl Strategy<Value = Vicinity> {
        prop_oneof![
            Just(Vicinity::Cell),
            Just(Vicinity::VonNeumann1),
            Just(Vicinity::Moore1),
            Just(Vicinity::Disc(2.0))
        ]
    }

    fn nest_params() -> impl Strategy<Value = NestParams> {
        let contacts = prop_oneof![Just(Contact::Overlap), Just(Contact::Edge), Just(Contact::Corner)];
        (vicinities(), contacts, any::<bool>()).prop_map(|(vicinity, contact, border_suitable)| NestParams {
            vicinity,
            contact,
            border_suitable,
            ..NestParams::default()
        })
    }

    fn explorations() -> impl Strategy<Value = Explore> {
        prop_oneof![Just(Explore::Walk), Just(Explore::Uniform), Just(Explore::Permute)]
    }

    /// Rounds of changes: where, and the new rank; and the ticks that pass after each.
    type Rounds = Vec<(Vec<(prop::sample::Index, u8)>, u64)>;

    fn rounds() -> impl Strategy<Value = Rounds> {
        let change = (
            any::<prop::sample::Index>(),
            prop_oneof![Just(3u8), Just(5), Just(6), Just(9)],
        );
        prop::collection::vec((prop::collection::vec(change, 0..12), 0u64..30), 1..8)
    }

    fn lies_inside(found: &Nests, oracle: &Nests) -> bool {
        let mut of = vec![0; found.count()];
        found
            .labels()
            .data()
            .iter()
            .zip(oracle.labels().data())
            .all(|(&label, &whole)| {
                let Some(slot) = (label as usize).checked_sub(1) else {
                    return true;
                };
                let first = std::mem::replace(&mut of[slot], whole);
                whole > 0 && (first == 0 || first == whole)
            })
    }

    /// Cells of the nests that hold a cell of `fallen`.
    fn cells_touched(nests: &Nests, fallen: &[Cell]) -> u64 {
        let touched: BTreeSet<u32> = fallen
            .iter()
            .map(|&cell| nests.label(cell))
            .filter(|&n| n > 0)
            .collect();
        touched
            .iter()
            .map(|&nest| u64::from(nests.sizes()[nest as usize - 1]))
            .sum()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(192))]

        #[test]
        fn nests_follow_every_change_and_nothing_is_looked_at_in_vain(
            rows in 1usize..18, columns in 1usize..18, seed: u64, holes in 0u32..25, agents in 1u32..40,
            pellet_max in 1u8..4, nest in nest_params(), explore in explorations(), rounds in rounds(), masked: bool,
        ) {
            let source = Watched::new(rows, columns, seed, holes);
            let geometry = source.map.geometry();
            let mut inside = Layer::filled(geometry, true);
            if masked {
                for (i, cell) in inside.data_mut().iter_mut().enumerate() {
                    *cell = !philox([i as u32, 29, 0, 0], seed)[0].is_multiple_of(20);
                }
            }
            let params = SwarmParams { agents, pellet_max, nest, explore, seed, ..SwarmParams::default() };
            let mut colony = Colony::deploy(source, &inside, params).unwrap();
            let mut looked_again = 0;
            for (changes, ticks) in &rounds {
                colony.run(*ticks, &mut silent());
                colony.source().asked();
                let before = colony.nests().unwrap();
                let old = colony.source().map.clone();
                let known: BTreeSet<Cell> = geometry.cells().filter(|&cell| colony.is_evaluated(cell)).collect();
                let cells: Vec<Cell> = changes.iter().map(|(pick, _)| geometry.cell(pick.index(geometry.cell_count()))).collect();
                for (&cell, (_, rank)) in cells.iter().zip(changes) {
                    colony.source_mut().rank(cell, *rank);
                }
                let evaluated = colony.tally().cells_evaluated;
                let found = colony.update(&cells).unwrap();
                // Looked at: what was named and known, and cells that were new.
                let asked = colony.source().asked();
                prop_assert!(asked.iter().all(|cell| cells.contains(cell) || !known.contains(cell)));
                prop_assert!(cells.iter().all(|cell| asked.contains(cell) || !known.contains(cell)));
                prop_assert_eq!(found.cells_evaluated, asked.len() as u64);
                prop_assert_eq!(colony.tally().cells_evaluated, evaluated + found.cells_evaluated);
                looked_again += asked.intersection(&known).count() as u64;
                // Labelled anew: no more than the nests that lost ground.
                let suitable = |map: &RankMap, cell| map.cell_rank(cell).rank() >= nest.rank_min;
                let present = colony.source().map.clone();
                let fallen: Vec<Cell> = known
                    .into_iter()
                    .filter(|&cell| suitable(&old, cell) && !suitable(&present, cell))
                    .collect();
                prop_assert_eq!(found.cells_fallen, fallen.len() as u64);
                if !(masked && nest.border_suitable) {
                    prop_assert!(found.cells_relabelled <= cells_touched(&before, &fallen));
                }
                prop_assert_eq!(found.cells_relabelled == 0, found.cores_lost == 0);
                // At no time is anything a nest that the present map does not have.
                let oracle = exact_nests(&present, Some(&inside), &nest).unwrap();
                prop_assert!(lies_inside(&colony.nests().unwrap(), &oracle));
                colony.run(5, &mut silent());
                prop_assert!(lies_inside(&colony.nests().unwrap(), &oracle));
            }
            prop_assert_eq!(colony.run(FOREVER, &mut silent()), Ending::Finished);
            let present = colony.source().map.clone();
            prop_assert_eq!(colony.nests().unwrap(), exact_nests(&present, Some(&inside), &nest).unwrap());
            let mut fresh = Colony::deploy(&present, &inside, params).unwrap();
            prop_assert_eq!(fresh.run(FOREVER, &mut silent()), Ending::Finished);
            prop_assert_eq!(colony.nests().unwrap(), fresh.nests().unwrap());
            prop_assert_eq!(colony.tally().cores, fresh.tally().cores);
            let inside_cells = inside.data().iter().filter(|inside| **inside).count() as u64;
            prop_assert!(colony.tally().cells_evaluated - looked_again <= inside_cells);
            // Widening after changes finds the rest of the present map.
            let everywhere = Layer::filled(geometry, true);
            colony.widen(&everywhere).unwrap();
            prop_assert_eq!(colony.run(FOREVER, &mut silent()), Ending::Finished);
            prop_assert_eq!(colony.nests().unwrap(), exact_nests(&present, None, &nest).unwrap());
        }
    }

    /// A finished colony on kind ground of two rooms, 5 x 5 each, joined by a hall of 3 x 3.
    fn two_rooms() -> Colony<Watched> {
        let mut source = Watched::new(5, 13, 0, 0);
        for column in 5..8 {
            source.rank(Cell::new(0, column), 2);
            source.rank(Cell::new(4, column), 2);
        }
        let everywhere = Layer::filled(source.geometry(), true);
        let mut colony = Colony::deploy(source, &everywhere, SwarmParams::default()).unwrap();
        colony.watch(Cell::new(2, 0), Cell::new(2, 12));
        assert_eq!(colony.run(FOREVER, &mut silent()), Ending::Finished);
        colony
    }

    fn change(colony: &mut Colony<Watched>, cell: Cell, rank: u8) -> Changes {
        colony.source_mut().rank(cell, rank);
        colony.update(&[cell]).unwrap()
    }

    #[test]
    fn a_fall_in_the_hall_parts_the_rooms_at_once_and_a_rise_joins_them_at_once() {
        let mut colony = two_rooms();
        assert_eq!(colony.nests().unwrap().count(), 1);
        assert!(colony.tally().connected_at.is_some());
        let hall = Cell::new(2, 6);
        let parted = change(&mut colony, hall, 3);
        assert_eq!((parted.cores_lost, parted.nests_touched), (3, 1));
        assert_eq!(parted.cells_relabelled, 5 * 13 - 6);
        assert_eq!(parted.cells_evaluated, 1);
        assert_eq!(colony.nests().unwrap().sizes(), [25 + 3, 25 + 3]);
        assert_eq!(colony.tally().connected_at, None);
        assert_eq!(colony.pellets(hall), 0);
        let joined = change(&mut colony, hall, 7);
        assert_eq!((joined.cells_relabelled, joined.cells_reopened), (0, 3));
        colony.run(FOREVER, &mut silent());
        assert_eq!(colony.nests().unwrap().count(), 1);
        assert!(colony.tally().connected_at.is_some());
    }

    #[test]
    fn a_nest_far_away_is_not_touched() {
        let mut colony = two_rooms();
        change(&mut colony, Cell::new(2, 6), 3);
        let east = change(&mut colony, Cell::new(2, 11), 3);
        assert_eq!((east.nests_touched, east.cells_relabelled), (1, 28));
    }

    #[test]
    fn a_rank_that_stays_suitable_and_a_cell_that_nobody_knows_change_nothing() {
        let mut colony = two_rooms();
        let same = change(&mut colony, Cell::new(2, 2), 10);
        assert_eq!(
            same,
            Changes {
                cells_evaluated: 1,
                ..Changes::default()
            }
        );
        let source = Watched::new(5, 5, 0, 0);
        let everywhere = Layer::filled(source.geometry(), true);
        let mut unseen = Colony::deploy(source, &everywhere, SwarmParams::default()).unwrap();
        assert_eq!(change(&mut unseen, Cell::new(2, 2), 2), Changes::default());
        assert_eq!(unseen.update(&[]).unwrap(), Changes::default());
    }

    #[test]
    fn cells_outside_and_maps_of_another_shape_are_refused_and_nothing_changes() {
        let mut colony = two_rooms();
        let before = (colony.nests().unwrap(), colony.tally());
        let outside = colony.update(&[Cell::new(0, 0), Cell::new(5, 0)]);
        assert!(matches!(
            outside,
            Err(SwarmError::Grid(GridError::OutsideGrid { row: 5, .. }))
        ));
        for (rows, columns) in [(13, 5), (5, 12), (6, 13)] {
            *colony.source_mut() = Watched::new(rows, columns, 0, 0);
            let shape = colony.update(&[]);
            assert!(matches!(shape, Err(SwarmError::Grid(GridError::ShapeMismatch { .. }))));
        }
        assert_eq!((colony.nests().unwrap(), colony.tally()), before);
    }
}
