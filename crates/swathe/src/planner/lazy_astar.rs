//! Lazy A*: the honest peer of the swarm. It finds a cheapest way through the nests of the whole map and asks for the
//! rank of a cell only when it comes to expand it.
//!
//! A step is queued with a hopeful cost (least cost per metre times its length) and looked at when it comes out of the
//! queue: the cells that the vehicle touches on it are ranked then, and it goes back with its true cost or is dropped. With
//! weight 1 the answer is optimal, with weight w it costs at most w times the optimum. Source of the method: Cohen, Phillips
//! and Likhachev, "Planning single-arm manipulations with n-arm robots", RSS 2014 (lazy weighted A*).

use std::cell::{Cell as Slot, RefCell};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::grid::{Cell, GridError, GridGeometry, Step};
use crate::nest::NestParams;
use crate::progress::Report;
use crate::rank::CellSource;
use crate::vehicle::Vehicle;

use super::answer::Terrain;
use super::clearance::Nearness;
use super::plan::check_factor;
use super::refusal::is_no_go;
use super::search::{Search, StepGraph};
use super::{Ground, Objective, PlannerError};

/// Entries taken from the queue between two reports.
const ENTRIES_PER_REPORT: u64 = 1 << 16;

/// Greatest weight of the bound.
const MOST_WEIGHT: f64 = 1e3;

/// What lazy A* is asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LazyRequest {
    /// First cell of the way, in a nest.
    pub start: Cell,
    /// Last cell of the way, in a nest.
    pub goal: Cell,
    /// What nests are.
    pub nest: NestParams,
    /// Weight of the bound, 1 (optimal) to 1000.
    pub weight: f64,
    /// What the way should save.
    pub objective: Objective,
    /// Whether the way is charged, and kept within limits, as if driven back from goal to start.
    pub reversed: bool,
}

/// What lazy A* has found and what it took.
#[derive(Clone, Debug, PartialEq)]
pub struct LazyAnswer {
    /// The way.
    pub search: Search,
    /// Cells whose rank was asked for, each once.
    pub cells_evaluated: u64,
    /// Cells expanded.
    pub cells_expanded: u64,
}

/// What is known of a cell, one bit each.
mod flag {
    pub(super) const EVALUATED: u8 = 1;
    pub(super) const SUITABLE: u8 = 2;
    pub(super) const CORE_KNOWN: u8 = 4;
    pub(super) const CORE: u8 = 8;
    pub(super) const NEST_KNOWN: u8 = 16;
    pub(super) const NEST: u8 = 32;
    pub(super) const NO_GO: u8 = 64;
}

/// Nests that are looked at cell by cell, every rank asked for once.
struct LazyNests<'a, Source> {
    source: &'a Source,
    geometry: GridGeometry,
    params: NestParams,
    vicinity: Vec<Step>,
    flags: RefCell<Vec<u8>>,
    evaluated: Slot<u64>,
}

impl<'a, Source: CellSource> LazyNests<'a, Source> {
    fn new(source: &'a Source, params: NestParams) -> Result<Self, PlannerError> {
        let geometry = source.geometry();
        Ok(Self {
            source,
            geometry,
            vicinity: params.validate()?,
            params,
            flags: RefCell::new(vec![0; geometry.cell_count()]),
            evaluated: Slot::new(0),
        })
    }

    fn flags(&self, index: usize) -> u8 {
        self.flags.borrow()[index]
    }

    /// Notes that something is known, and how it is.
    fn note(&self, index: usize, known: u8, holds: bool, what: u8) -> bool {
        self.flags.borrow_mut()[index] |= known | if holds { what } else { 0 };
        holds
    }

    fn is_suitable(&self, cell: Cell) -> bool {
        let index = self.geometry.index(cell);
        let flags = self.flags(index);
        if flags & flag::EVALUATED > 0 {
            return flags & flag::SUITABLE > 0;
        }
        self.evaluated.set(self.evaluated.get() + 1);
        let found = self.source.cell_rank(cell);
        self.note(index, flag::EVALUATED, is_no_go(found), flag::NO_GO);
        self.note(
            index,
            flag::EVALUATED,
            found.rank() >= self.params.rank_min,
            flag::SUITABLE,
        )
    }

    fn is_no_go(&self, cell: Cell) -> bool {
        !self.is_suitable(cell) && self.flags(self.geometry.index(cell)) & flag::NO_GO > 0
    }

    /// Whether the whole vicinity of a cell is suitable.
    fn is_core(&self, cell: Cell) -> bool {
        let index = self.geometry.index(cell);
        let flags = self.flags(index);
        if flags & flag::CORE_KNOWN > 0 {
            return flags & flag::CORE > 0;
        }
        let near = |step: &Step| step.from(&self.geometry, cell);
        // A cell that is known to be unsuitable decides without a new look.
        let known = self.vicinity.iter().any(|step| match near(step) {
            None => !self.params.border_suitable,
            Some(near) => self.flags(self.geometry.index(near)) & (flag::EVALUATED | flag::SUITABLE) == flag::EVALUATED,
        });
        let core = !known
            && self
                .vicinity
                .iter()
                .all(|step| near(step).is_none_or(|near| self.is_suitable(near)));
        self.note(index, flag::CORE_KNOWN, core, flag::CORE)
    }

    /// Whether a cell lies in a nest: in the vicinity of a core. Vicinities are symmetric.
    fn is_nest(&self, cell: Cell) -> bool {
        let index = self.geometry.index(cell);
        let flags = self.flags(index);
        if flags & flag::NEST_KNOWN > 0 {
            return flags & flag::NEST > 0;
        }
        let near = |step: &Step| step.from(&self.geometry, cell);
        let is_known_core = |near: Cell| self.flags(self.geometry.index(near)) & flag::CORE > 0;
        let nest = self.is_suitable(cell)
            && (self.vicinity.iter().filter_map(near).any(is_known_core)
                || self.is_core(cell)
                || self.vicinity.iter().filter_map(near).any(|near| self.is_core(near)));
        self.note(index, flag::NEST_KNOWN, nest, flag::NEST)
    }
}

/// A step in the queue, by its key: hopeful, or looked at. Looked-at steps go first among equals.
type Entry = Reverse<(u64, bool, u32, u32, u8)>;

/// Costs and parents of the cells reached so far.
struct Reached {
    cost: Vec<f64>,
    parent: Vec<u32>,
    settled: Vec<bool>,
}

/// Finds a cheapest way through nests (at weight 1), ranking cells only where it comes to expand them.
///
/// # Errors
/// [`PlannerError::Grid`] when start or goal lies outside, [`PlannerError::Nest`] and [`PlannerError::Weight`] for parameters
/// outside their range.
pub fn lazy_astar(
    terrain: Terrain,
    source: &impl CellSource,
    vehicle: &Vehicle,
    moisture_percent: f64,
    request: &LazyRequest,
    report: &mut Report,
) -> Result<LazyAnswer, PlannerError> {
    let geometry = terrain.elevation_m.geometry();
    let LazyRequest {
        start, goal, weight, ..
    } = *request;
    for cell in [start, goal] {
        if cell.row >= geometry.rows() || cell.column >= geometry.columns() {
            return Err(GridError::OutsideGrid {
                row: cell.row as i64,
                column: cell.column as i64,
                rows: geometry.rows(),
                columns: geometry.columns(),
            }
            .into());
        }
    }
    if !(1.0..=MOST_WEIGHT).contains(&weight) {
        return Err(PlannerError::Weight { weight });
    }
    request.objective.validate(geometry.cell_size_m())?;
    check_factor(terrain.cost_factor)?;
    // Which cells the search comes to is not known before: a source in tiles is read to its end.
    source.prefetch(&mut geometry.cells(), 0)?;
    let nests = LazyNests::new(source, request.nest)?;
    let mut ground = Ground::new(
        terrain.elevation_m,
        terrain.soil,
        vehicle,
        moisture_percent,
        |_| true,
        None,
        geometry.centre(goal),
    )
    .with_objective(request.objective);
    if request.objective.risk > 0.0 {
        let near = Nearness::new(geometry, ground.risk_reach_m(), |cell| nests.is_no_go(cell));
        ground = ground.with_exposure(move |cell| near.exposure(cell));
    }
    if let Some(factor) = terrain.cost_factor {
        ground = ground.with_factor(factor);
    }
    if request.reversed {
        ground = ground.reversed(geometry.centre(goal));
    }
    let mut expanded = 0;
    let search = if nests.is_nest(start) && nests.is_nest(goal) {
        run(&ground, &nests, request, &mut expanded, report)
    } else {
        Search::Unreachable
    };
    Ok(LazyAnswer {
        search,
        cells_evaluated: nests.evaluated.get(),
        cells_expanded: expanded,
    })
}

fn run(
    ground: &Ground,
    nests: &LazyNests<impl CellSource>,
    request: &LazyRequest,
    expanded: &mut u64,
    report: &mut Report,
) -> Search {
    let geometry = nests.geometry;
    let (first, last) = (geometry.index(request.start), geometry.index(request.goal));
    let cells = geometry.cell_count();
    let mut reached = Reached {
        cost: vec![f64::INFINITY; cells],
        parent: vec![u32::MAX; cells],
        settled: vec![false; cells],
    };
    let key = |cost: f64, cell: Cell| (cost + request.weight * ground.bound(cell)).to_bits();
    // A hair less, as with the bound.
    let hopeful_per_m = ground.least_cost_per_m() * (1.0 - 1e-12) * geometry.cell_size_m();
    let mut queue: BinaryHeap<Entry> = BinaryHeap::new();
    reached.cost[first] = 0.0;
    queue.push(Reverse((key(0.0, request.start), false, first as u32, u32::MAX, 0)));
    let mut taken = 0;
    while let Some(Reverse((_, hopeful, index, before, step))) = queue.pop() {
        if taken % ENTRIES_PER_REPORT == 0 && !report(*expanded, 0) {
            return Search::Stopped;
        }
        taken += 1;
        let index = index as usize;
        if reached.settled[index] {
            continue;
        }
        let here = geometry.cell(index);
        if hopeful {
            let from = geometry.cell(before as usize);
            let cost = reached.cost[before as usize] + edge_cost(ground, nests, from, usize::from(step));
            if cost < reached.cost[index] {
                reached.cost[index] = cost;
                reached.parent[index] = before;
                queue.push(Reverse((key(cost, here), false, index as u32, before, step)));
            }
            continue;
        }
        reached.settled[index] = true;
        if index == last {
            let mut way = vec![here];
            let mut at = index;
            while at != first {
                at = reached.parent[at] as usize;
                way.push(geometry.cell(at));
            }
            way.reverse();
            return Search::Found {
                cells: way,
                cost: reached.cost[last],
            };
        }
        *expanded += 1;
        for (k, step) in ground.steps().iter().enumerate() {
            let Some(near) = step.from(&geometry, here) else {
                continue;
            };
            let next = geometry.index(near);
            let length = step.length_cells();
            let climb = ground.least_climb(here, near, length * geometry.cell_size_m()) * (1.0 - 1e-12);
            let hope = reached.cost[index] + hopeful_per_m * length + climb;
            if !reached.settled[next] && hope < reached.cost[next] {
                queue.push(Reverse((key(hope, near), true, next as u32, index as u32, k as u8)));
            }
        }
    }
    Search::Unreachable
}

/// Cost of a step whose cells are looked at first: infinite when the vehicle touches a cell that is no nest.
fn edge_cost(ground: &Ground, nests: &LazyNests<impl CellSource>, from: Cell, step: usize) -> f64 {
    let inside = ground.swept(step).iter().all(|offset| {
        let near = nests.geometry.offset(from, offset.rows, offset.columns);
        near.is_some_and(|near| nests.is_nest(near))
    });
    if inside {
        ground.edge_cost(from, step)
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Layer;
    use crate::nest::{Contact, Vicinity, exact_nests};
    use crate::planner::clearance::ClearanceField;
    use crate::planner::search;
    use crate::progress::silent;
    use crate::rank::RankMap;
    use crate::vehicle::fixtures::{pioneer, tractor};
    use proptest::prelude::*;

    const ROWS: usize = 22;
    const COLUMNS: usize = 26;

    /// Waves of some height with holes in their ranks.
    fn world(seed: u64, height_m: f64, holes: u32) -> (Layer<f32>, RankMap) {
        let geometry = GridGeometry::new(ROWS, COLUMNS, 10.0, 0.0, 0.0).unwrap();
        let draw = |i: u32| crate::random::philox([i, 5, 0, 0], seed)[0];
        let heights = geometry.cells().map(|cell| {
            let phase = f64::from(draw(1) % 7);
            (height_m * (0.4 * cell.row as f64 + phase).sin() * (0.3 * cell.column as f64).cos()) as f32
        });
        let ranks = (0..geometry.cell_count() as u32).map(|i| if draw(i + 9) % 100 < holes { 3 } else { 8 });
        let ranks: Vec<u8> = ranks.collect();
        (
            Layer::new(geometry, heights.collect(), "z").unwrap(),
            RankMap::from_ranks(geometry, &ranks).unwrap(),
        )
    }

    fn terrain(elevation: &Layer<f32>) -> Terrain<'_> {
        Terrain {
            elevation_m: elevation.view(),
            soil: None,
            cost_factor: None,
            map_continues: false,
        }
    }

    proptest! {
        #[test]
        fn it_costs_what_the_search_over_exact_nests_costs_and_the_weight_bounds_the_excess(
            seed: u64, height in 0.0f64..6.0, holes in 0u32..14, a in 0..ROWS * COLUMNS, b in 0..ROWS * COLUMNS,
            weight in 1.0f64..3.0, large: bool, corner: bool, border_suitable: bool, round: bool,
            energy in 0.0f64..3.0, risk in prop_oneof![Just(0.0), 0.0f64..9.0], priced: bool, reversed: bool,
        ) {
            let (elevation, ranks) = world(seed, height, holes);
            let geometry = elevation.geometry();
            let vehicle = if large { tractor() } else { pioneer() };
            let nest = NestParams {
                contact: if corner { Contact::Corner } else { Contact::Edge },
                vicinity: if round { Vicinity::VonNeumann1 } else { Vicinity::Moore1 },
                border_suitable,
                ..NestParams::default()
            };
            let (start, goal) = (geometry.cell(a), geometry.cell(b));
            let exact = exact_nests(&ranks, None, &nest).unwrap();
            let labels = exact.labels().data();
            let factors = geometry.cells().map(|cell| match (cell.row * 7 + cell.column) % 11 {
                0 => f32::NAN,
                k => k as f32 / 4.0,
            });
            let factors = Layer::new(geometry, factors.collect(), "factors").unwrap();
            let objective = Objective { energy, risk, ..Objective::default() };
            let mut whole = Ground::new(
                elevation.view(), None, &vehicle, 20.0, |index| labels[index] > 0, None, geometry.centre(goal),
            )
            .with_objective(objective);
            let field = ClearanceField::new(&ranks, |index| labels[index] > 0, whole.risk_reach_m());
            whole = whole.with_exposure(move |cell| field.exposure(cell));
            let terrain = Terrain { cost_factor: priced.then(|| factors.view()), ..terrain(&elevation) };
            if let Some(factor) = terrain.cost_factor {
                whole = whole.with_factor(factor);
            }
            if reversed {
                whole = whole.reversed(geometry.centre(goal));
            }
            let ends_are_nests = exact.label(start) > 0 && exact.label(goal) > 0;
            let truth = if ends_are_nests {
                search(&whole, start, goal, &mut silent())
            } else {
                Search::Unreachable
            };
            for weight in [1.0, weight] {
                let request = LazyRequest { start, goal, nest, weight, objective, reversed };
                let found = lazy_astar(terrain, &ranks, &vehicle, 20.0, &request, &mut silent()).unwrap();
                prop_assert!(found.cells_evaluated <= (ROWS * COLUMNS) as u64);
                match (&truth, &found.search) {
                    (Search::Found { cost: least, .. }, Search::Found { cells, cost }) => {
                        prop_assert!(*cost >= least * (1.0 - 1e-9));
                        prop_assert!(*cost <= least * weight * (1.0 + 1e-9), "{} {} {}", cost, least, weight);
                        prop_assert_eq!((cells[0], cells[cells.len() - 1]), (start, goal));
                        let driven: f64 = cells.windows(2).map(|pair| {
                            let step = whole.steps().iter().position(|step| step.from(&geometry, pair[0]) == Some(pair[1]));
                            whole.edge_cost(pair[0], step.unwrap())
                        }).sum();
                        prop_assert!((driven - cost).abs() <= 1e-9 * cost.max(1.0));
                    }
                    (truth, found) => prop_assert_eq!(truth, found),
                }
            }
        }
    }

    #[test]
    fn it_looks_at_a_part_of_the_map_and_at_less_when_weighted() {
        let geometry = GridGeometry::new(100, 100, 10.0, 0.0, 0.0).unwrap();
        let heights = geometry
            .cells()
            .map(|cell| (2.0 * (0.3 * cell.row as f64).sin() * (0.2 * cell.column as f64).cos()) as f32);
        let elevation = Layer::new(geometry, heights.collect(), "z").unwrap();
        let ranks = RankMap::from_ranks(geometry, &vec![9; 10_000]).unwrap();
        let looked_at = [1.0, 1.25, 2.0].map(|weight| {
            let request = LazyRequest {
                start: Cell::new(75, 10),
                goal: Cell::new(34, 90),
                nest: NestParams::default(),
                weight,
                objective: Objective::default(),
                reversed: false,
            };
            let found = lazy_astar(terrain(&elevation), &ranks, &tractor(), 20.0, &request, &mut silent()).unwrap();
            assert!(matches!(found.search, Search::Found { .. }));
            assert!(found.cells_expanded < found.cells_evaluated);
            found.cells_evaluated
        });
        assert!(
            looked_at[0] < 9000 && looked_at[1] <= looked_at[0] && looked_at[2] < looked_at[0],
            "{looked_at:?}"
        );
    }

    #[test]
    fn what_is_not_usable_is_named_and_a_stop_is_heard() {
        let (elevation, ranks) = world(1, 0.0, 0);
        let ask = |goal, weight, go_on: bool| {
            let request = LazyRequest {
                start: Cell::new(1, 1),
                goal,
                nest: NestParams::default(),
                weight,
                objective: Objective::default(),
                reversed: false,
            };
            lazy_astar(terrain(&elevation), &ranks, &pioneer(), 20.0, &request, &mut |_, _| {
                go_on
            })
        };
        for weight in [0.5, f64::NAN, f64::INFINITY] {
            assert!(matches!(
                ask(Cell::new(5, 5), weight, true),
                Err(PlannerError::Weight { .. })
            ));
        }
        assert!(matches!(ask(Cell::new(ROWS, 0), 1.0, true), Err(PlannerError::Grid(_))));
        assert_eq!(ask(Cell::new(5, 5), 1.0, false).unwrap().search, Search::Stopped);
        let same = ask(Cell::new(1, 1), 1.0, true).unwrap();
        assert!(matches!(same.search, Search::Found { cost: 0.0, .. }));
    }
}
