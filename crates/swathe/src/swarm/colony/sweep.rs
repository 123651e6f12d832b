//! Permuting swarms: where a run holds all visits of a tile, they are made at once, 64 cells a word.
//!
//! What a permuting swarm knows after any number of visits is decided by which cells it has visited how often: it has looked
//! at these and at the vicinities of foci, and cores follow. So the visits of a tile may be made together, and a run that
//! ends within a tile, tick by tick, ends as if each had been made by itself. Nests are not joined here: their sets follow
//! from the flags when somebody asks.

use crate::grid::Cell;
use crate::nest::{Contact, UnionFind, Vicinity, pack_at_least};
use crate::progress::Report;
use crate::rank::{CellRank, CellSource};
use crate::swarm::StopRule;
use crate::swarm::itinerary::{Itinerary, TILE_CELLS, Tile};

use super::planes::{bytes_of, planes_of};
use super::{Colony, Ending, GROUND, flag};

/// Visits between two reports.
const VISITS_PER_REPORT: u64 = 1 << 18;

/// Cells about a tile that its visits may change.
const MARGIN: usize = 2;

/// Rows, and columns, of a tile with its margin.
const SIDE: usize = TILE_CELLS + 2 * MARGIN;

/// One bit for each cell of a tile with its margin.
type Bits = [u64; SIDE];

impl<Source: CellSource> Colony<Source> {
    /// [`Colony::run`] of a permuting swarm.
    pub(super) fn run_along(&mut self, itinerary: &Itinerary, ticks: u64, report: &mut Report) -> Ending {
        let agents = self.agents.len() as u64;
        let start = (self.tally.ticks - self.epoch_start).saturating_mul(agents);
        let last = self.tally.ticks.saturating_add(ticks);
        let last = last.min(self.budget.ticks.unwrap_or(u64::MAX)).max(self.tally.ticks) - self.epoch_start;
        let end = last.min(u64::MAX / agents) * agents;
        let total = self.open;
        let (mut visit, mut next_report, mut stopped, mut swept) = (start, start, false, false);
        let ending = loop {
            if visit.is_multiple_of(agents) {
                self.tally.ticks = self.epoch_start + visit / agents;
                if let Some(ending) = self.over() {
                    if ending == Ending::Finished {
                        self.trace.finish();
                    }
                    break ending;
                }
                if visit >= end {
                    break Ending::TicksSpent;
                }
            }
            if visit >= next_report {
                next_report = visit + VISITS_PER_REPORT;
                stopped = stopped || !report(total - self.open, total);
            }
            if stopped && visit.is_multiple_of(agents) {
                break Ending::Stopped;
            }
            let tile = itinerary.tile(visit);
            if !self.prefetch_tile(&tile) {
                break self.spent().unwrap_or(Ending::Stopped);
            }
            let whole = visit == tile.visits.start && tile.visits.end <= end && !stopped;
            if whole && self.sweep(&tile) {
                swept = true;
                visit = tile.visits.end;
            } else {
                visit = self.visit_singly(&tile, visit);
            }
        };
        if swept {
            self.place_agents(itinerary, start, visit);
        }
        ending
    }

    /// Has the source read what the visits of a tile need. Returns whether it is there.
    fn prefetch_tile(&mut self, tile: &Tile) -> bool {
        let (geometry, columns) = (self.geometry, tile.column..tile.column + tile.columns);
        let rows = tile.row..tile.row + tile.rows;
        let mut cells = rows.flat_map(|row| columns.clone().map(move |column| Cell::new(row, column)));
        self.prefetch(&mut cells.by_ref().map(|cell| geometry.index(cell)))
    }

    /// Makes visits one by one until the tick or the tile is over, and returns the number of the next.
    fn visit_singly(&mut self, tile: &Tile, visit: u64) -> u64 {
        let agents = self.agents.len() as u64;
        let since_start = visit / agents;
        let next = tile.visits.end.min((since_start + 1) * agents);
        let mut visits = Vec::with_capacity((next - visit) as usize);
        for visit in visit..next {
            let agent = (visit % agents) as usize;
            let index = self.geometry.index(tile.cell(visit));
            if self.flags[index] & GROUND == flag::INSIDE {
                self.agents[agent] = index as u32;
                visits.push((agent, index as u32));
            } else {
                self.trace.arrive(since_start, None);
            }
        }
        self.tally.ticks = self.epoch_start + since_start + 1;
        self.tally.visits += visits.len() as u64;
        self.serve(since_start, visits.into_iter());
        next
    }

    /// Puts every agent where its last visit from `start` to `end` led it.
    fn place_agents(&mut self, itinerary: &Itinerary, start: u64, end: u64) {
        let agents = self.agents.len() as u64;
        let mut tile = itinerary.tile(start);
        for (agent, place) in (0..agents).zip(&mut self.agents) {
            let mut visit = end - agents + agent;
            while visit >= start {
                if !tile.visits.contains(&visit) {
                    tile = itinerary.tile(visit);
                }
                let index = self.geometry.index(tile.cell(visit));
                if self.flags[index] & GROUND == flag::INSIDE {
                    *place = index as u32;
                    break;
                }
                let Some(earlier) = visit.checked_sub(agents) else {
                    break;
                };
                visit = earlier;
            }
        }
    }

    /// Makes all visits of a tile at once; returns false, having done nothing, where they must be made one by one: when the
    /// swarm may be finished within the tile, or must tell the tick of a connection, or every visit or evaluation counts, or
    /// nests are of an uncommon kind.
    fn sweep(&mut self, tile: &Tile) -> bool {
        let connects = self.watched.is_some() && self.tally.connected_at.is_none();
        let nest = &self.params.nest;
        let is_counted = self.budget.evaluations.is_some() || matches!(self.rule, StopRule::Statistical { .. });
        if connects || is_counted || nest.vicinity != Vicinity::Moore1 || nest.contact == Contact::Overlap {
            return false;
        }
        let mut planes = self.planes(tile);
        let open_here: u32 = planes
            .iter()
            .map(|p| (p[INSIDE] & !p[DEAD] & !p[CORE]).count_ones())
            .sum();
        if self.open <= u64::from(open_here) {
            return false;
        }
        let before = planes;
        let own = (u64::MAX >> (64 - tile.columns)) << MARGIN;
        let mut visited: Bits = [0; SIDE];
        for (visited, plane) in visited.iter_mut().zip(&planes).skip(MARGIN).take(tile.rows) {
            *visited = plane[INSIDE] & !plane[HALO] & own;
        }
        self.tally.visits += count(&visited);
        self.look_at(tile, &visited, &mut planes);
        let foci = self.drop_pellets(tile, &visited, &mut planes);
        self.look_at(tile, &grown(&foci), &mut planes);
        self.find_cores(&foci, &mut planes);
        self.note(tile, &before, &planes);
        // What sets there were are not those of these nests.
        self.sets = UnionFind::new(0);
        true
    }

    /// Asks for the ranks of those cells of the swathe that are not known, and takes note of them.
    fn look_at(&mut self, tile: &Tile, cells: &Bits, planes: &mut Planes) {
        let mut unsuitable: Bits = [0; SIDE];
        let mut ranks = [CellRank::UNKNOWN; SIDE];
        for (place, plane) in planes.iter_mut().enumerate() {
            let unseen = cells[place] & plane[INSIDE] & !plane[EVALUATED];
            let mut suitable = 0;
            let mut left = unseen;
            while left > 0 {
                let first = left.trailing_zeros();
                let long = (left >> first).trailing_ones();
                let ranks = &mut ranks[..long as usize];
                // Cells of the swathe lie in the map, so nothing is below zero.
                let (row, column) = (tile.row + place - MARGIN, tile.column + first as usize - MARGIN);
                self.source.rank_window(row, column, ranks);
                let mut word = [0];
                pack_at_least(ranks, self.params.nest.rank_min, |rank| rank.rank(), &mut word);
                suitable |= word[0] << first;
                left &= !(u64::MAX >> (64 - long) << first);
            }
            self.tally.cells_evaluated += u64::from(unseen.count_ones());
            plane[EVALUATED] |= unseen;
            plane[SUITABLE] |= suitable;
            unsuitable[place] = unseen & !suitable;
        }
        for (plane, near) in planes.iter_mut().zip(grown(&unsuitable)) {
            let dead = near & plane[INSIDE] & !plane[DEAD];
            plane[DEAD] |= dead;
            self.open -= u64::from(dead.count_ones());
        }
    }

    /// Drops a pellet on every visited cell that has room for one, and returns the cells that are full now.
    fn drop_pellets(&mut self, tile: &Tile, visited: &Bits, planes: &mut Planes) -> Bits {
        let mut foci: Bits = [0; SIDE];
        for (place, plane) in planes.iter_mut().enumerate() {
            let mut full = visited[place] & plane[SUITABLE] & !plane[FULL];
            if full > 0 && !self.pellets.is_empty() {
                let first = (tile.row + place - MARGIN) * self.geometry.columns() + tile.column;
                let room = full >> MARGIN;
                for (bit, pellets) in self.pellets[first..first + tile.columns].iter_mut().enumerate() {
                    *pellets += (room >> bit & 1) as u8;
                    let is_full = *pellets == self.params.pellet_max;
                    full &= !(u64::from(!is_full) << (bit + MARGIN));
                }
            }
            plane[FULL] |= full;
            foci[place] = full;
        }
        foci
    }

    /// The core test of foci in whose vicinity nothing is unknown.
    fn find_cores(&mut self, foci: &Bits, planes: &mut Planes) {
        let border = if self.params.nest.border_suitable { u64::MAX } else { 0 };
        let mut bad: Bits = [0; SIDE];
        for (bad, plane) in bad.iter_mut().zip(planes.iter()) {
            let good = (plane[INSIDE] & plane[EVALUATED] & plane[SUITABLE]) | (!plane[INSIDE] & border);
            *bad = !good;
        }
        let near_bad = grown(&bad);
        let mut cores: Bits = [0; SIDE];
        for (place, plane) in planes.iter_mut().enumerate() {
            cores[place] = foci[place] & !near_bad[place] & !plane[CORE];
            plane[CORE] |= cores[place];
        }
        self.open -= count(&cores);
        self.tally.cores += count(&cores);
        for (plane, near) in planes.iter_mut().zip(grown(&cores)) {
            plane[NEST] |= near & plane[INSIDE];
        }
    }

    /// What is known of the cells of a tile and its margin; nothing is inside beyond the map.
    fn planes(&self, tile: &Tile) -> Planes {
        let mut planes = [[0; 8]; SIDE];
        for (place, index, width, shift) in self.rows_about(tile) {
            let mut bytes = [0; SIDE];
            bytes[shift..shift + width].copy_from_slice(&self.flags[index..index + width]);
            planes[place] = planes_of(&bytes);
        }
        planes
    }

    /// Writes back what has changed.
    fn note(&mut self, tile: &Tile, before: &Planes, planes: &Planes) {
        for (place, index, width, shift) in self.rows_about(tile) {
            if before[place] != planes[place] {
                let bytes = bytes_of(&planes[place]);
                self.flags[index..index + width].copy_from_slice(&bytes[shift..shift + width]);
            }
        }
    }

    /// For each row of a tile and its margin that lies in the map: its number, the index of its first cell in the map, the
    /// number of cells, and the number of columns beyond the map before them.
    fn rows_about(&self, tile: &Tile) -> impl Iterator<Item = (usize, usize, usize, usize)> + use<Source> {
        let (rows, columns) = (self.geometry.rows(), self.geometry.columns());
        let (row, shift) = (tile.row, MARGIN.saturating_sub(tile.column));
        let first = tile.column.saturating_sub(MARGIN);
        let width = (SIDE - shift).min(columns - first);
        (0..SIDE).filter_map(move |place| {
            let row = (row + place).checked_sub(MARGIN).filter(|&row| row < rows)?;
            Some((place, row * columns + first, width, shift))
        })
    }
}

/// Bits of cells by row, one word for each flag.
type Planes = [[u64; 8]; SIDE];

const INSIDE: usize = flag::INSIDE.trailing_zeros() as usize;
const EVALUATED: usize = flag::EVALUATED.trailing_zeros() as usize;
const SUITABLE: usize = flag::SUITABLE.trailing_zeros() as usize;
const DEAD: usize = flag::DEAD.trailing_zeros() as usize;
const CORE: usize = flag::CORE.trailing_zeros() as usize;
const NEST: usize = flag::NEST.trailing_zeros() as usize;
const HALO: usize = flag::HALO.trailing_zeros() as usize;
const FULL: usize = flag::FULL.trailing_zeros() as usize;

/// The cells and the eight around each.
fn grown(cells: &Bits) -> Bits {
    let along = cells.map(|word| word << 1 | word | word >> 1);
    let at = |row: usize| along.get(row).copied().unwrap_or(0);
    std::array::from_fn(|row| at(row.wrapping_sub(1)) | along[row] | at(row + 1))
}

fn count(cells: &Bits) -> u64 {
    cells.iter().map(|word| u64::from(word.count_ones())).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{GridGeometry, Layer};
    use crate::nest::{NestParams, Nests, exact_nests};
    use crate::progress::silent;
    use crate::random::philox;
    use crate::rank::RankMap;
    use crate::swarm::{Explore, SwarmParams, Tally};
    use proptest::prelude::*;

    /// Ground of several tiles: patches of bad cells, so that much is open and much is not.
    fn world(rows: usize, columns: usize, seed: u64, holes: u32) -> RankMap {
        let geometry = GridGeometry::new(rows, columns, 1.0, 0.0, 0.0).unwrap();
        let rank = |i: usize| {
            let (row, column) = (i / columns, i % columns);
            let patch = philox([row as u32 / 23, column as u32 / 17, 5, 0], seed)[0].is_multiple_of(4);
            let hole = philox([i as u32, 7, 0, 0], seed)[0] % 1000 < if patch { 700 } else { holes };
            if hole { 4 } else { 8 }
        };
        RankMap::from_ranks(geometry, &(0..rows * columns).map(rank).collect::<Vec<u8>>()).unwrap()
    }

    /// All that a permuting swarm leaves behind.
    fn left_by(colony: &Colony<&RankMap>) -> (Nests, Tally, Vec<u32>, Vec<u8>, Vec<u8>, u64) {
        (
            colony.nests().unwrap(),
            colony.tally(),
            colony.agents.clone(),
            colony.pellets.clone(),
            colony.flags.clone(),
            colony.open,
        )
    }

    fn params(agents: u32, pellet_max: u8, corner: bool, border_suitable: bool, seed: u64) -> SwarmParams {
        let contact = if corner { Contact::Corner } else { Contact::Edge };
        SwarmParams {
            agents,
            pellet_max,
            nest: NestParams {
                contact,
                border_suitable,
                ..NestParams::default()
            },
            explore: Explore::Permute,
            seed,
            ..SwarmParams::default()
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn visits_made_at_once_are_visits_made_one_by_one(
            rows in 60usize..150, columns in 60usize..200, agents in prop_oneof![1u32..40, 500u32..9000], seed: u64,
            pellet_max in 1u8..4, corner: bool, border_suitable: bool, part: bool, share in 0u64..130, holes in 0u32..60,
        ) {
            let map = world(rows, columns, seed, holes);
            let mut inside = Layer::filled(map.cells().geometry(), true);
            if part {
                for (i, cell) in inside.data_mut().iter_mut().enumerate() {
                    *cell = (i / columns).abs_diff(i % columns) < 70;
                }
            }
            let params = params(agents, pellet_max, corner, border_suitable, seed);
            let cells = (rows * columns) as u64;
            let ticks = share * cells * u64::from(pellet_max) / 100 / u64::from(agents);
            let mut at_once = Colony::deploy(&map, &inside, params).unwrap();
            let ending = at_once.run(ticks, &mut silent());
            let mut singly = Colony::deploy(&map, &inside, params).unwrap();
            let itinerary = singly.itinerary.clone().unwrap();
            let mut visit = 0;
            let end = ticks * u64::from(agents);
            while visit < end && (singly.open > 0 || visit % u64::from(agents) > 0) {
                visit = singly.visit_singly(&itinerary.tile(visit), visit);
            }
            prop_assert_eq!(left_by(&at_once), left_by(&singly));
            let oracle = exact_nests(&map, Some(&inside), &params.nest).unwrap();
            let nests = at_once.nests().unwrap();
            for cell in map.geometry().cells() {
                prop_assert!(nests.label(cell) == 0 || oracle.label(cell) > 0);
            }
            if ending == Ending::Finished {
                prop_assert_eq!(&nests, &oracle);
            }
            // Walked on tick by tick or shown, the swarm comes to the same end.
            let frame = at_once.frame(1);
            prop_assert!(frame.nests.iter().zip(nests.labels().data()).all(|(name, label)| (*name > 0) == (*label > 0)));
            at_once.build_sets();
            prop_assert_eq!(at_once.nests().unwrap(), nests);
            prop_assert_eq!(at_once.run(u64::MAX, &mut silent()), Ending::Finished);
            prop_assert_eq!(at_once.nests().unwrap(), oracle);
        }

        #[test]
        fn a_swarm_stopped_by_its_report_goes_on_as_if_it_had_not_been(
            agents in 1u32..3000, seed: u64, reports in 0u64..3, pellet_max in 1u8..3,
        ) {
            let map = world(600, 700, seed, 10);
            let inside = Layer::filled(map.geometry(), true);
            let params = params(agents, pellet_max, false, false, seed);
            let mut stopped = Colony::deploy(&map, &inside, params).unwrap();
            let mut told = 0;
            let ending = stopped.run(u64::MAX, &mut |_, _| {
                told += 1;
                told <= reports
            });
            prop_assert!(ending == Ending::Stopped || told <= reports);
            let ticks = stopped.tally().ticks;
            let mut straight = Colony::deploy(&map, &inside, params).unwrap();
            straight.run(ticks, &mut silent());
            prop_assert_eq!(left_by(&stopped), left_by(&straight));
            prop_assert_eq!(stopped.run(u64::MAX, &mut silent()), straight.run(u64::MAX, &mut silent()));
            prop_assert_eq!(left_by(&stopped), left_by(&straight));
        }
    }

    #[test]
    fn a_watched_swarm_tells_the_tick_of_the_connection_whether_it_is_cut_or_not() {
        let map = world(130, 140, 3, 0);
        let inside = Layer::filled(map.geometry(), true);
        let params = params(70, 1, false, false, 3);
        let oracle = exact_nests(&map, None, &params.nest).unwrap();
        let of_largest = || {
            map.geometry()
                .cells()
                .filter(|&cell| oracle.label(cell) == oracle.largest())
        };
        let (a, b) = (of_largest().next().unwrap(), of_largest().last().unwrap());
        let connected_at = |ticks: u64| {
            let mut colony = Colony::deploy(&map, &inside, params).unwrap();
            colony.watch(a, b);
            while colony.run(ticks, &mut silent()) != Ending::Finished {}
            colony.tally().connected_at
        };
        assert!(connected_at(1).is_some());
        assert_eq!(connected_at(1), connected_at(u64::MAX));
    }
}
