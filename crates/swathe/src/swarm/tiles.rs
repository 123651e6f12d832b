//! The swarm over tiles: each tile is a job of its own, for another thread, process or machine, and seams are merged.
//!
//! A job looks at its tile and at a halo as wide as the vicinity reaches, and finds the cores of the tile's own cells: every
//! core of the map is found by exactly one job. What its cores settle, in the tile and in the halo, is the result; cells that
//! two jobs settle, and settled cells that touch across a seam, join nests. Neither the order of jobs nor the size of tiles
//! changes the nests.

use crate::grid::{Cell, EIGHT, FOUR, GridError, GridGeometry, Layer, Step};
use crate::nest::{Contact, NestParams, Nests, UnionFind};
use crate::progress::Report;
use crate::random::philox;
use crate::rank::{CellRank, CellSource, RANK_REACH_CELLS};

use super::{Colony, Ending, SwarmError, SwarmParams, Tally};

/// A block of cells of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First row.
    pub row: usize,
    /// First column.
    pub column: usize,
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
}

impl Window {
    /// The window with `margin_cells` more on every side, cut at the edge of a map.
    fn grown(self, margin_cells: usize, map: &GridGeometry) -> Self {
        let (row, column) = (
            self.row.saturating_sub(margin_cells),
            self.column.saturating_sub(margin_cells),
        );
        let end = |first: usize, count: usize, most: usize| (first + count).saturating_add(margin_cells).min(most);
        Self {
            row,
            column,
            rows: end(self.row, self.rows, map.rows()) - row,
            columns: end(self.column, self.columns, map.columns()) - column,
        }
    }

    fn holds(self, cell: Cell) -> bool {
        (self.row..self.row + self.rows).contains(&cell.row)
            && (self.column..self.column + self.columns).contains(&cell.column)
    }

    /// Refuses a window that has no cells or does not lie in a grid.
    fn check(self, grid: &GridGeometry) -> Result<(), SwarmError> {
        let (rows, columns) = (self.rows, self.columns);
        if rows == 0 || columns == 0 {
            return Err(GridError::Empty { rows, columns }.into());
        }
        let row = self.row.saturating_add(rows - 1);
        let column = self.column.saturating_add(columns - 1);
        if row < grid.rows() && column < grid.columns() {
            return Ok(());
        }
        Err(GridError::OutsideGrid {
            row: row as i64,
            column: column as i64,
            rows: grid.rows(),
            columns: grid.columns(),
        }
        .into())
    }
}

/// One tile's share of the work: plain data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileJob {
    /// The whole map.
    pub map: GridGeometry,
    /// The tile's own cells.
    pub own: Window,
    /// How the swarm of the tile works; its seed is the tile's own.
    pub params: SwarmParams,
}

/// What a tile's swarm has found: plain data.
#[derive(Clone, Debug, PartialEq)]
pub struct TileResult {
    /// The tile's own cells.
    pub own: Window,
    /// The own cells with the halo.
    pub window: Window,
    /// Labels of the window's cells, row by row; 0 is no nest. The halo's are what the neighbours must know of.
    pub labels: Vec<u32>,
    /// How the swarm ended.
    pub ending: Ending,
    /// What it has done. Cells of the halo count for every tile that looked at them, cores for one tile alone.
    pub tally: Tally,
}

/// The jobs of a map in tiles of `tile_cells` x `tile_cells`, those at the south and east edge smaller, in raster order.
///
/// Seeds of tiles are drawn from the seed in `params` by the tile's place.
///
/// # Errors
/// [`SwarmError`] when a parameter is outside its range or a tile has no cells.
pub fn tile_jobs(map: GridGeometry, tile_cells: usize, params: SwarmParams) -> Result<Vec<TileJob>, SwarmError> {
    params.validate()?;
    if tile_cells == 0 {
        return Err(SwarmError::Parameter {
            name: "tile size",
            given: 0.0,
            allowed: "1 cell or more is allowed",
        });
    }
    let mut jobs = Vec::new();
    for row in (0..map.rows()).step_by(tile_cells) {
        for column in (0..map.columns()).step_by(tile_cells) {
            let [low, high, ..] = philox([row as u32, column as u32, 0, u32::MAX], params.seed);
            jobs.push(TileJob {
                map,
                own: Window {
                    row,
                    column,
                    rows: tile_cells.min(map.rows() - row),
                    columns: tile_cells.min(map.columns() - column),
                },
                params: SwarmParams {
                    seed: u64::from(high) << 32 | u64::from(low),
                    ..params
                },
            });
        }
    }
    Ok(jobs)
}

impl TileJob {
    /// The cells that the job looks at: its own with a halo, cut at the map's edge.
    ///
    /// # Errors
    /// [`SwarmError`] when the vicinity is not usable or the tile does not lie in the map.
    pub fn window(&self) -> Result<Window, SwarmError> {
        self.own.check(&self.map)?;
        Ok(self.own.grown(reach_cells(&self.params.nest)?, &self.map))
    }

    /// The cells whose terrain decides the ranks of [`Self::window`].
    ///
    /// # Errors
    /// As [`Self::window`].
    pub fn terrain_window(&self) -> Result<Window, SwarmError> {
        Ok(self.window()?.grown(RANK_REACH_CELLS, &self.map))
    }

    /// Runs the tile's swarm until it is finished, `ticks` are over, or `report` returns false.
    ///
    /// `source` has the ranks of a part of the map (or all of it) whose first cell is `first` and which holds
    /// [`Self::window`].
    ///
    /// # Errors
    /// [`SwarmError`] when a parameter is outside its range, or the tile lies outside the map or the source.
    pub fn run<Source: CellSource>(
        &self,
        source: &Source,
        first: Cell,
        ticks: u64,
        report: &mut Report,
    ) -> Result<TileResult, SwarmError> {
        let window = self.window()?;
        let given = source.geometry();
        let (Some(row), Some(column)) = (
            window.row.checked_sub(first.row),
            window.column.checked_sub(first.column),
        ) else {
            return Err(GridError::OutsideGrid {
                row: window.row as i64 - first.row as i64,
                column: window.column as i64 - first.column as i64,
                rows: given.rows(),
                columns: given.columns(),
            }
            .into());
        };
        Window { row, column, ..window }.check(&given)?;
        let part = Part {
            source,
            geometry: GridGeometry::new(window.rows, window.columns, given.cell_size_m(), 0.0, 0.0)?,
            row,
            column,
        };
        let own = Window {
            row: self.own.row - window.row,
            column: self.own.column - window.column,
            ..self.own
        };
        let everywhere = Layer::filled(part.geometry, true);
        let mut colony = Colony::deploy_within(part, &everywhere, self.params, |cell| own.holds(cell))?;
        let ending = colony.run(ticks, report);
        Ok(TileResult {
            own: self.own,
            window,
            labels: colony.take_nests()?.into_labels().into_data(),
            ending,
            tally: colony.tally(),
        })
    }
}

/// A part of a source, with cells counted from its own corner.
struct Part<'a, Source> {
    source: &'a Source,
    geometry: GridGeometry,
    row: usize,
    column: usize,
}

impl<Source: CellSource> CellSource for Part<'_, Source> {
    fn geometry(&self) -> GridGeometry {
        self.geometry
    }

    fn cell_rank(&self, cell: Cell) -> CellRank {
        self.source
            .cell_rank(Cell::new(cell.row + self.row, cell.column + self.column))
    }

    fn rank_window(&self, row: usize, column: usize, ranks: &mut [CellRank]) {
        self.source.rank_window(row + self.row, column + self.column, ranks);
    }
}

/// The nests of the whole map from the results of its tiles, in any order.
///
/// Tiles that are missing or have not finished leave ground out, never in: the nests then lie inside the finished ones.
///
/// # Errors
/// [`SwarmError`] when a result does not fit the map, or holds labels that no tile gives.
pub fn merge_tiles(map: GridGeometry, nest: &NestParams, results: &[TileResult]) -> Result<Nests, SwarmError> {
    let reach_cells = reach_cells(nest)?;
    for result in results {
        result.check(&map)?;
    }
    let mut sets = UnionFind::new(1);
    let mut labels = vec![0; map.cell_count()];
    for result in results {
        result.enter(&map, &mut sets, &mut labels);
    }
    let touching: &[Step] = match nest.contact {
        Contact::Overlap => &[],
        Contact::Edge => &FOUR,
        Contact::Corner => &EIGHT,
    };
    for result in results {
        // Cells of a tile that its own cores did not settle lie at most the vicinity's reach from the seam.
        for cell in result.own.rim(reach_cells.max(1)) {
            let here = labels[map.index(cell)];
            for near in touching.iter().filter_map(|step| step.from(&map, cell)) {
                let there = labels[map.index(near)];
                if here > 0 && there > 0 {
                    sets.union(here, there);
                }
            }
        }
    }
    for label in &mut labels {
        *label = sets.find(*label);
    }
    Ok(Nests::from_labels(map, labels)?)
}

impl Window {
    /// The cells at most `width_cells` from the outside.
    fn rim(self, width_cells: usize) -> impl Iterator<Item = Cell> {
        let inner = move |count: usize| width_cells..count.saturating_sub(width_cells).max(width_cells);
        (0..self.rows).flat_map(move |row| {
            let middle = if inner(self.rows).contains(&row) {
                inner(self.columns)
            } else {
                0..0
            };
            let (west, east) = (
                0..middle.start.min(self.columns),
                middle.end.min(self.columns)..self.columns,
            );
            west.chain(east)
                .map(move |column| Cell::new(self.row + row, self.column + column))
        })
    }
}

impl TileResult {
    fn check(&self, map: &GridGeometry) -> Result<(), SwarmError> {
        self.own.check(map)?;
        self.window.check(map)?;
        let (expected, found) = (self.window.rows * self.window.columns, self.labels.len());
        if expected != found {
            let what = "A tile's result";
            return Err(GridError::ShapeMismatch { what, expected, found }.into());
        }
        match self.labels.iter().find(|&&label| label as usize > expected) {
            None => Ok(()),
            Some(&label) => Err(SwarmError::Parameter {
                name: "label of a tile's nest",
                given: f64::from(label),
                allowed: "0 to the number of the tile's cells is allowed",
            }),
        }
    }

    /// Enters the tile's labels into those of the map, as sets of their own, and joins sets that share a cell.
    fn enter(&self, map: &GridGeometry, sets: &mut UnionFind, labels: &mut [u32]) {
        let most = self.labels.iter().copied().max().unwrap_or(0);
        let mut set_of = vec![0; most as usize + 1];
        for (row, ours) in self.labels.chunks(self.window.columns).enumerate() {
            let first = map.index(Cell::new(self.window.row + row, self.window.column));
            for (label, known) in ours.iter().zip(&mut labels[first..]) {
                if *label == 0 {
                    continue;
                }
                let set = &mut set_of[*label as usize];
                if *set == 0 {
                    *set = sets.push();
                }
                if *known == 0 {
                    *known = *set;
                } else {
                    sets.union(*known, *set);
                }
            }
        }
    }
}

/// How far the vicinity reaches, in cells.
fn reach_cells(nest: &NestParams) -> Result<usize, SwarmError> {
    let steps = nest.validate()?;
    let reach = steps.iter().map(|step| step.rows.abs().max(step.columns.abs())).max();
    Ok(reach.unwrap_or(0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nest::{Vicinity, exact_nests, suitable_cells};
    use crate::progress::silent;
    use crate::rank::{RankMap, RankParams, Ranker};
    use crate::swarm::Explore;
    use crate::vehicle::fixtures::tractor;
    use proptest::prelude::*;

    const FOREVER: u64 = 1_000_000;

    fn world(rows: usize, columns: usize, seed: u64, holes: u32) -> RankMap {
        let geometry = GridGeometry::new(rows, columns, 1.0, 0.0, 0.0).unwrap();
        let hole = |i: usize| philox([i as u32, 31, 0, 0], seed)[0] % 100 < holes;
        let ranks: Vec<u8> = (0..rows * columns).map(|i| if hole(i) { 4 } else { 8 }).collect();
        RankMap::from_ranks(geometry, &ranks).unwrap()
    }

    fn nest_params() -> impl Strategy<Value = NestParams> {
        let vicinities = prop_oneof![
            Just(Vicinity::Cell),
            Just(Vicinity::VonNeumann1),
            Just(Vicinity::Moore1),
            Just(Vicinity::Disc(2.0)),
            Just(Vicinity::Disc(3.2))
        ];
        let contacts = prop_oneof![Just(Contact::Overlap), Just(Contact::Edge), Just(Contact::Corner)];
        (vicinities, contacts, any::<bool>()).prop_map(|(vicinity, contact, border_suitable)| NestParams {
            vicinity,
            contact,
            border_suitable,
            ..NestParams::default()
        })
    }

    fn run_all(map: &RankMap, tile_cells: usize, params: SwarmParams, ticks: u64) -> Vec<TileResult> {
        let jobs = tile_jobs(map.geometry(), tile_cells, params).unwrap();
        let run = |job: &TileJob| job.run(map, Cell::new(0, 0), ticks, &mut silent()).unwrap();
        jobs.iter().map(run).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(192))]

        #[test]
        fn finished_tiles_of_any_size_in_any_order_are_the_exact_nests(
            rows in 1usize..26, columns in 1usize..26, tile_cells in 1usize..28, seed: u64, holes in 0u32..30,
            nest in nest_params(), order: u64,
        ) {
            let map = world(rows, columns, seed, holes);
            let params = SwarmParams { agents: 16, nest, explore: Explore::Permute, seed, ..SwarmParams::default() };
            let mut results = run_all(&map, tile_cells, params, FOREVER);
            results.sort_by_key(|result| philox([result.own.row as u32, result.own.column as u32, 0, 0], order));
            let oracle = exact_nests(&map, None, &nest).unwrap();
            prop_assert_eq!(merge_tiles(map.geometry(), &nest, &results).unwrap(), oracle);
            prop_assert!(results.iter().all(|result| result.ending == Ending::Finished));
            // Every core is found by one tile alone.
            let mut whole = Colony::deploy(&map, &Layer::filled(map.geometry(), true), params).unwrap();
            whole.run(FOREVER, &mut silent());
            prop_assert_eq!(results.iter().map(|result| result.tally.cores).sum::<u64>(), whole.tally().cores);
            let own: usize = results.iter().map(|result| result.own.rows * result.own.columns).sum();
            prop_assert_eq!(own, rows * columns);
        }

        #[test]
        fn unfinished_and_missing_tiles_leave_ground_out_and_never_in(
            seed: u64, holes in 0u32..25, ticks in 0u64..6, kept: u64, nest in nest_params(),
        ) {
            let map = world(20, 23, seed, holes);
            let params = SwarmParams { agents: 5, nest, seed, ..SwarmParams::default() };
            let mut results = run_all(&map, 8, params, ticks);
            let mut place = 0;
            results.retain(|_| {
                place += 1;
                kept >> place & 1 == 1
            });
            let found = merge_tiles(map.geometry(), &nest, &results).unwrap();
            let oracle = exact_nests(&map, None, &nest).unwrap();
            let suitable = suitable_cells(&map, nest.rank_min, None);
            let mut of = vec![0; found.count() + 1];
            for cell in map.geometry().cells().filter(|&cell| found.label(cell) > 0) {
                prop_assert!(suitable.get(cell) && oracle.label(cell) > 0);
                let whole = &mut of[found.label(cell) as usize];
                prop_assert!(*whole == 0 || *whole == oracle.label(cell));
                *whole = oracle.label(cell);
            }
        }

        #[test]
        fn a_worker_that_has_only_the_terrain_of_its_window_finds_the_same(
            rows in 3usize..24, columns in 3usize..24, tile_cells in 1usize..12, seed: u64, nest in nest_params(),
        ) {
            let geometry = GridGeometry::new(rows, columns, 10.0, 500.0, 900.0).unwrap();
            let height = |i: usize| {
                let draw = philox([i as u32, 37, 0, 0], seed)[0] % 100;
                if draw == 0 { f32::NAN } else { draw as f32 * 0.09 }
            };
            let heights: Vec<f32> = (0..rows * columns).map(height).collect();
            let elevation_m = Layer::new(geometry, heights, "heights").unwrap();
            let (vehicle, ranking) = (tractor(), RankParams::default());
            let whole = Ranker::new(elevation_m.view(), None, None, None, &vehicle, ranking).unwrap();
            let params = SwarmParams { agents: 9, nest, explore: Explore::Permute, seed, ..SwarmParams::default() };
            for job in tile_jobs(geometry, tile_cells, params).unwrap() {
                let part = job.terrain_window().unwrap();
                let heights = (0..part.rows * part.columns)
                    .map(|i| elevation_m[Cell::new(part.row + i / part.columns, part.column + i % part.columns)])
                    .collect();
                let shape = GridGeometry::new(part.rows, part.columns, 10.0, 0.0, 0.0).unwrap();
                let cut = Layer::new(shape, heights, "heights").unwrap();
                let ranker = Ranker::new(cut.view(), None, None, None, &vehicle, ranking).unwrap();
                let there = job.run(&ranker, Cell::new(part.row, part.column), FOREVER, &mut silent()).unwrap();
                let here = job.run(&whole, Cell::new(0, 0), FOREVER, &mut silent()).unwrap();
                prop_assert_eq!(there, here);
            }
        }
    }

    #[test]
    fn one_tile_and_one_cell_are_tiles_too_and_no_result_is_no_nest() {
        let map = world(1, 1, 0, 0);
        let nest = NestParams {
            vicinity: Vicinity::Cell,
            ..NestParams::default()
        };
        for seed in [0, u64::MAX] {
            let params = SwarmParams {
                agents: 100_000,
                nest,
                seed,
                ..SwarmParams::default()
            };
            let results = run_all(&map, usize::MAX, params, FOREVER);
            assert_eq!((results.len(), results[0].tally.cores), (1, 1));
            assert_eq!(merge_tiles(map.geometry(), &nest, &results).unwrap().count(), 1);
        }
        assert_eq!(merge_tiles(map.geometry(), &nest, &[]).unwrap().count(), 0);
    }

    #[test]
    fn tiles_that_do_not_fit_are_refused() {
        let map = world(10, 12, 0, 0);
        let geometry = map.geometry();
        let params = SwarmParams::default();
        assert!(matches!(
            tile_jobs(geometry, 0, params),
            Err(SwarmError::Parameter { name: "tile size", .. })
        ));
        let nobody = SwarmParams { agents: 0, ..params };
        assert!(tile_jobs(geometry, 5, nobody).is_err());
        let job = tile_jobs(geometry, 5, params).unwrap()[0];
        let run = |job: TileJob, first| job.run(&map, first, 1, &mut silent());
        for own in [
            Window { rows: 0, ..job.own },
            Window { row: 9, ..job.own },
            Window {
                column: usize::MAX,
                ..job.own
            },
            Window {
                rows: usize::MAX,
                ..job.own
            },
        ] {
            assert!(matches!(
                run(TileJob { own, ..job }, Cell::new(0, 0)),
                Err(SwarmError::Grid(_))
            ));
        }
        assert!(matches!(run(job, Cell::new(1, 0)), Err(SwarmError::Grid(_))));
        let small = world(4, 12, 0, 0);
        assert!(job.run(&small, Cell::new(0, 0), 1, &mut silent()).is_err());
        let result = run(job, Cell::new(0, 0)).unwrap();
        let mut short = result.clone();
        short.labels.pop();
        let mut strange = result.clone();
        strange.labels[3] = u32::MAX;
        let mut away = result;
        away.window.row = 8;
        for wrong in [short, strange, away] {
            assert!(merge_tiles(geometry, &params.nest, &[wrong]).is_err());
        }
    }
}
