//! The whole of planning: corridor, swarm, nests, search, shortcuts, certificate.

use crate::corridor::{ArcKind, Corridor, capsule_half_width_m};
use crate::grid::{Cell, GridGeometry, Layer, LayerView, Position};
use crate::nest::{BitRows, NestParams, Nests, exact_nests};
use crate::progress::silent;
use crate::rank::{CellSource, RankParams, Ranker};
use crate::swarm::{Colony, Ending, SwarmParams, Tally};
use crate::vehicle::Vehicle;

use super::cells::{Algorithm, Corners, shortest_path};
use super::ground::Ground;
use super::refusal::{Refusal, Status, blocked_end, disconnected};
use super::route::Route;
use super::search::{Search, search};
use super::smooth::shorten;
use super::{Obstacle, PlannerError};

/// Cells of the map that make one cell of the coarse map on which the arc is laid, per side.
const COARSE: usize = 8;

/// How far start and goal are moved to reach a nest, in cells.
const SNAP_CELLS: f64 = 2.0;

/// Ticks after which a swarm that has not finished is taken as it is: far beyond what a swarm that can finish needs.
const MOST_TICKS: u64 = 100_000_000;

/// Which way regions are found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// The termite swarm inside the swathe.
    Swarm,
    /// One linear pass over the whole map: the oracle.
    Exact,
}

/// What is being done, for progress reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Laying the arc.
    Corridor,
    /// Finding nests.
    Regions,
    /// Searching the way.
    Route,
}

/// Called with the stage, the work done and the work expected; false asks to stop.
pub type StageReport<'a> = dyn FnMut(Stage, u64, u64) -> bool + 'a;

/// The layers that planning reads.
#[derive(Clone, Copy, Debug)]
pub struct Terrain<'a> {
    /// Heights in metres, NaN unknown.
    pub elevation_m: LayerView<'a, f32>,
    /// Soil class codes.
    pub soil: Option<LayerView<'a, u8>>,
    /// Whether the map goes on beyond these cells, which limits what can be certified.
    pub map_continues: bool,
}

/// What is asked of the planner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanRequest {
    /// Where the vehicle is.
    pub start: Position,
    /// Where it should go.
    pub goal: Position,
    /// How regions are found.
    pub method: Method,
    /// The swarm's parameters; its nest parameters hold for the exact method too.
    pub swarm: SwarmParams,
    /// How the arc is laid.
    pub arc: ArcKind,
    /// Width of the swathe; a quarter of the distance when not given.
    pub width_m: Option<f64>,
    /// Whether suitable ground outside the nests may be crossed, at three times the cost, when nothing else connects.
    pub bridge: bool,
    /// Whether the swathe is widened until the route is known to be the best of the whole map.
    pub certify: bool,
}

/// What the swarm did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SwarmReport {
    /// Its tally.
    pub tally: Tally,
    /// How often the swathe was widened.
    pub widened: u32,
}

/// The planner's answer.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Route or refusal.
    pub answer: Result<Route, Refusal>,
    /// Cells of the way before shortcuts.
    pub path: Vec<Cell>,
    /// Cost of that way in seconds.
    pub path_cost: Option<f64>,
    /// Nothing can cost less than this.
    pub cost_lower_bound: Option<f64>,
    /// Whether the way is known to be the best of the whole map.
    pub optimal: bool,
    /// Where the start was moved to, with the distance.
    pub start: Option<(Position, f64)>,
    /// Where the goal was moved to, with the distance.
    pub goal: Option<(Position, f64)>,
    /// The nests.
    pub nests: Option<Nests>,
    /// The corridor (swarm only).
    pub corridor: Option<Corridor>,
    /// What the swarm did (swarm only).
    pub swarm: Option<SwarmReport>,
    /// Cells whose rank was asked for, those of the coarse map included.
    pub cells_evaluated: u64,
}

impl Plan {
    fn empty() -> Self {
        Self {
            answer: Ok(Route {
                legs: Vec::new(),
                total: super::SegmentFacts::default(),
            }),
            path: Vec::new(),
            path_cost: None,
            cost_lower_bound: None,
            optimal: false,
            start: None,
            goal: None,
            nests: None,
            corridor: None,
            swarm: None,
            cells_evaluated: 0,
        }
    }

    fn refused(mut self, refusal: Refusal) -> Self {
        self.answer = Err(refusal);
        self
    }
}

/// Plans a route over ranked terrain.
///
/// # Errors
/// [`PlannerError`] when the request is not usable or the caller asked to stop. No route is a [`Refusal`] in the answer.
pub fn plan(
    terrain: Terrain,
    ranker: &Ranker,
    vehicle: &Vehicle,
    params: &RankParams,
    request: &PlanRequest,
    report: &mut StageReport,
) -> Result<Plan, PlannerError> {
    request.swarm.validate()?;
    let geometry = terrain.elevation_m.geometry();
    let mut answer = Plan::empty();
    let mut ends = Vec::new();
    for (name, place) in [("start", request.start), ("goal", request.goal)] {
        if !(place.x_m.is_finite() && place.y_m.is_finite()) {
            let Position { x_m, y_m } = place;
            return Err(PlannerError::NotAPlace { name, x_m, y_m });
        }
        let Some(cell) = geometry.cell_at(place) else {
            return Ok(answer.refused(outside(geometry, name, place)));
        };
        ends.push(cell);
    }
    let planner = Planner {
        terrain,
        ranker,
        vehicle,
        params,
        request,
        ends: [ends[0], ends[1]],
    };
    match request.method {
        Method::Exact => {
            if !report(Stage::Regions, 0, 1) {
                return Err(PlannerError::Stopped);
            }
            let rank = ranker.rank_all();
            answer.cells_evaluated = geometry.cell_count() as u64;
            let nests = exact_nests(&rank, None, &request.swarm.nest)?;
            planner.finish(answer, nests, None, report)
        }
        Method::Swarm => planner.with_swarm(answer, report),
    }
}

fn outside(geometry: GridGeometry, name: &str, place: Position) -> Refusal {
    let east = geometry.west_m() + geometry.columns() as f64 * geometry.cell_size_m();
    let south = geometry.north_m() - geometry.rows() as f64 * geometry.cell_size_m();
    let away = |low: f64, high: f64, at: f64| (low - at).max(at - high).max(0.0);
    let distance_m = away(geometry.west_m(), east, place.x_m).hypot(away(south, geometry.north_m(), place.y_m));
    Refusal {
        status: Status::OutsideMap,
        reason: format!("The {name} lies {distance_m:.0} m outside the map."),
        place: Some(place),
        remedy: "Give elevation that covers it; points are longitude,latitude unless `--points-crs` says otherwise."
            .to_owned(),
    }
}

/// Cells of both ends inside nests.
struct Ends {
    start: (Cell, f64),
    goal: (Cell, f64),
    connected: bool,
}

/// The request with everything that it is answered from.
struct Planner<'a> {
    terrain: Terrain<'a>,
    ranker: &'a Ranker<'a>,
    vehicle: &'a Vehicle,
    params: &'a RankParams,
    request: &'a PlanRequest,
    ends: [Cell; 2],
}

impl Planner<'_> {
    fn geometry(&self) -> GridGeometry {
        self.terrain.elevation_m.geometry()
    }

    fn places(&self) -> [Position; 2] {
        [self.request.start, self.request.goal]
    }

    /// Runs the swarm in a swathe that is widened until start and goal connect, or the route is certified.
    fn with_swarm(&self, mut answer: Plan, report: &mut StageReport) -> Result<Plan, PlannerError> {
        let geometry = self.geometry();
        if !report(Stage::Corridor, 0, 1) {
            return Err(PlannerError::Stopped);
        }
        let [start, goal] = self.places();
        let mut coarse_cells = 0;
        let mut corridor = Corridor::lay(geometry, start, goal, self.request.arc, self.request.width_m, || {
            let (spine, cells) = self.spine();
            coarse_cells = cells;
            spine
        })?;
        let mut inside = corridor.cells(geometry);
        let mut colony = Colony::deploy(self.ranker, &inside, self.request.swarm)?;
        colony.watch(self.ends[0], self.ends[1]);
        let mut widened = 0;
        loop {
            let ending = colony.run(MOST_TICKS, &mut |done, total| report(Stage::Regions, done, total));
            if ending == Ending::Stopped {
                return Err(PlannerError::Stopped);
            }
            let tally = colony.tally();
            answer.swarm = Some(SwarmReport { tally, widened });
            answer.cells_evaluated = tally.cells_evaluated + coarse_cells;
            answer.corridor = Some(corridor.clone());
            let nests = colony.take_nests()?;
            let whole = inside.data().iter().all(|&inside| inside);
            let ends = self.snap(&nests, whole);
            let refused = ends.is_err() && corridor.width_m() >= 2.0 * self.settled_radius_m();
            let connected = ends.is_ok_and(|ends| ends.connected);
            if refused || connected || whole {
                answer = self.finish(answer, nests, (!whole).then_some(&inside), report)?;
                let again = !whole && (answer.answer.is_err() || self.request.certify && !answer.optimal);
                if refused || !again {
                    return Ok(answer);
                }
                let nests = answer.nests.take();
                let Some(nests) = nests else { return Ok(answer) };
                colony.give_nests(&nests);
            } else {
                colony.give_nests(&nests);
            }
            corridor = corridor.widened();
            widened += 1;
            inside = corridor.cells(geometry);
            colony.widen(&inside)?;
        }
    }

    /// Distance around start and goal within which the swathe decides nothing any more: what is a nest within the reach of
    /// snapping depends on cells up to two vicinities farther.
    fn settled_radius_m(&self) -> f64 {
        let steps = self.request.swarm.nest.vicinity.steps().unwrap_or_default();
        let reach = steps.iter().map(|step| step.rows.abs()).max().unwrap_or(0);
        (SNAP_CELLS + 2.0 * f64::from(reach) + 1.0) * 2f64.sqrt() * self.geometry().cell_size_m()
    }

    /// The cheapest way on a coarse map on which nothing but unknown ground is closed, and the cells that it looked at.
    fn spine(&self) -> (Option<Vec<Position>>, u64) {
        let geometry = self.geometry();
        let (rows, columns) = (geometry.rows().div_ceil(COARSE), geometry.columns().div_ceil(COARSE));
        let coarse = GridGeometry::new(
            rows,
            columns,
            geometry.cell_size_m() * COARSE as f64,
            geometry.west_m(),
            geometry.north_m(),
        );
        let Ok(coarse) = coarse else { return (None, 0) };
        let elevation = coarse_mean(self.terrain.elevation_m, coarse);
        let soil = self.terrain.soil.map(|soil| {
            let centre = |cell: Cell| {
                Cell::new(
                    (cell.row * COARSE + COARSE / 2).min(geometry.rows() - 1),
                    (cell.column * COARSE + COARSE / 2).min(geometry.columns() - 1),
                )
            };
            coarse.cells().map(|cell| soil[centre(cell)]).collect::<Vec<u8>>()
        });
        let soil = soil.and_then(|soil| Layer::new(coarse, soil, "the soil").ok());
        let params = RankParams {
            profile: crate::rank::Profile::Metric,
            ..*self.params
        };
        let ranker = Ranker::new(
            elevation.view(),
            soil.as_ref().map(Layer::view),
            None,
            None,
            self.vehicle,
            params,
        );
        let Ok(ranker) = ranker else { return (None, 0) };
        let map = ranker.rank_all();
        let costs = map.cells().data().iter().map(|found| match found.rank() {
            0 => f64::INFINITY,
            1 => 6.0,
            rank => 1.0 + 0.3 * (10.0 - f64::from(rank)),
        });
        let costs = Layer::new(coarse, costs.collect(), "the costs");
        let way = costs.ok().and_then(|costs| {
            let [start, goal] = self.places().map(|place| coarse.cell_at(place));
            let found = shortest_path(
                costs.view(),
                start?,
                goal?,
                16,
                Corners::Cut,
                Algorithm::Auto,
                &mut silent(),
            );
            match found {
                Ok(Search::Found { cells, .. }) => Some(cells),
                _ => None,
            }
        });
        let points = way.map(|cells| {
            let [start, goal] = self.places();
            let inner = cells.iter().skip(1).take(cells.len().saturating_sub(2));
            let mut points = vec![start];
            points.extend(inner.map(|&cell| coarse.centre(cell)));
            points.push(goal);
            points
        });
        (points, coarse.cell_count() as u64)
    }

    /// The nest cells nearest to start and goal. On the whole map, where no wider swathe can connect them, a pair a little
    /// farther off is taken when it lies in one nest.
    fn snap(&self, nests: &Nests, whole: bool) -> Result<Ends, Status> {
        let geometry = self.geometry();
        let near = |end: Cell, place: Position| {
            let steps = crate::grid::disc(SNAP_CELLS);
            let cells = steps.iter().filter_map(move |step| step.from(&geometry, end));
            let mut found: Vec<(Cell, f64)> = cells
                .filter(|&cell| nests.label(cell) > 0)
                .map(|cell| {
                    let away_m = if cell == end {
                        0.0
                    } else {
                        geometry.centre(cell).distance_m(place)
                    };
                    (cell, away_m)
                })
                .collect();
            found.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
            found
        };
        let starts = near(self.ends[0], self.request.start);
        let goals = near(self.ends[1], self.request.goal);
        let (Some(&start), Some(&goal)) = (starts.first(), goals.first()) else {
            return Err(if starts.is_empty() {
                Status::StartBlocked
            } else {
                Status::GoalBlocked
            });
        };
        let together = |(a, b): &((Cell, f64), (Cell, f64))| nests.label(a.0) == nests.label(b.0);
        let farther = || {
            let pairs = starts.iter().flat_map(|a| goals.iter().map(move |b| (*a, *b)));
            pairs
                .filter(together)
                .min_by(|x, y| (x.0.1 + x.1.1).total_cmp(&(y.0.1 + y.1.1)))
        };
        let nearest = (start, goal);
        let joined = if together(&nearest) {
            Some(nearest)
        } else if whole {
            farther()
        } else {
            None
        };
        let (start, goal) = joined.unwrap_or(nearest);
        Ok(Ends {
            start,
            goal,
            connected: joined.is_some(),
        })
    }

    /// Searches the way on finished nests. `inside` is the swathe when it is not the whole map.
    fn finish(
        &self,
        mut answer: Plan,
        nests: Nests,
        inside: Option<&Layer<bool>>,
        report: &mut StageReport,
    ) -> Result<Plan, PlannerError> {
        let geometry = self.geometry();
        let ends = match self.snap(&nests, inside.is_none()) {
            Ok(ends) => ends,
            Err(status) => {
                let which = usize::from(status == Status::GoalBlocked);
                let cell = self.ends[which];
                let refusal = blocked_end(
                    status,
                    self.places()[which],
                    cell,
                    self.ranker.cell_rank(cell),
                    self.terrain.elevation_m,
                    self.vehicle,
                    SNAP_CELLS * geometry.cell_size_m(),
                );
                answer.nests = Some(nests);
                return Ok(answer.refused(refusal));
            }
        };
        answer.start = Some((self.standing(ends.start, self.request.start), ends.start.1));
        answer.goal = Some((self.standing(ends.goal, self.request.goal), ends.goal.1));
        let bridging = !ends.connected && self.request.bridge && inside.is_none();
        if !ends.connected && !bridging {
            let refusal = self.why_disconnected(&nests, &ends);
            answer.nests = Some(nests);
            return Ok(answer.refused(refusal));
        }
        if !report(Stage::Route, 0, 0) {
            return Err(PlannerError::Stopped);
        }
        let ground = self.ground(&nests, &ends, bridging);
        let found = search(&ground, ends.start.0, ends.goal.0, &mut |done, total| {
            report(Stage::Route, done, total)
        });
        match found {
            Search::Stopped => return Err(PlannerError::Stopped),
            Search::Unreachable => {
                drop(ground);
                let refusal = self.why_disconnected(&nests, &ends);
                answer.nests = Some(nests);
                return Ok(answer.refused(refusal));
            }
            Search::Found { cells, cost } => {
                answer.optimal = !bridging && self.is_optimal(inside, cost, &ground);
                let route = self.route(&ground, &cells, &answer);
                match route {
                    Ok(route) => {
                        let ends = (route.legs.first(), route.legs.last());
                        let direct_m = match ends {
                            (Some(first), Some(last)) => first.from.distance_m(last.to),
                            _ => 0.0,
                        };
                        answer.cost_lower_bound = Some(ground.least_cost_per_m() * direct_m);
                        answer.answer = Ok(route);
                    }
                    Err(_) => unreachable_segment(&mut answer),
                }
                answer.path = cells;
                answer.path_cost = Some(cost);
            }
        }
        answer.nests = Some(nests);
        Ok(answer)
    }

    /// The exact place where the cell itself is ground, else the centre of the cell that it was moved to.
    fn standing(&self, end: (Cell, f64), place: Position) -> Position {
        if end.1 == 0.0 {
            place
        } else {
            self.geometry().centre(end.0)
        }
    }

    fn ground(&self, nests: &Nests, ends: &Ends, bridging: bool) -> Ground<'_> {
        let geometry = self.geometry();
        let labels = nests.labels().data();
        let nest = nests.label(ends.start.0);
        let goal = geometry.centre(ends.goal.0);
        let Terrain { elevation_m, soil, .. } = self.terrain;
        if !bridging {
            return Ground::new(
                elevation_m,
                soil,
                self.vehicle,
                self.params.moisture_percent,
                |index| labels[index] == nest,
                None,
                goal,
            );
        }
        let rank_min = self.request.swarm.nest.rank_min;
        let bridged = BitRows::from_fn(geometry, |row, column| {
            let cell = Cell::new(row, column);
            nests.label(cell) == 0 && self.ranker.cell_rank(cell).rank() >= rank_min
        });
        let open = bridged.clone();
        Ground::new(
            elevation_m,
            soil,
            self.vehicle,
            self.params.moisture_percent,
            |index| labels[index] > 0 || open.get(geometry.cell(index)),
            Some(bridged),
            goal,
        )
    }

    fn why_disconnected(&self, nests: &Nests, ends: &Ends) -> Refusal {
        disconnected(
            self.ranker,
            self.terrain.elevation_m,
            nests,
            ends.start.0,
            ends.goal.0,
            self.vehicle,
        )
    }

    /// Whether no way that leaves the searched cells can cost less: it would have to leave the widest capsule inside them.
    fn is_optimal(&self, inside: Option<&Layer<bool>>, cost: f64, ground: &Ground) -> bool {
        let [start, goal] = self.places();
        let mut half_m = inside.map_or(f64::INFINITY, |inside| capsule_half_width_m(inside, start, goal));
        if self.terrain.map_continues {
            let geometry = self.geometry();
            let rim = geometry.cells().filter(|cell| {
                cell.row == 0
                    || cell.column == 0
                    || cell.row + 1 == geometry.rows()
                    || cell.column + 1 == geometry.columns()
            });
            let rim_m = rim.map(|cell| geometry.centre(cell).distance_to_segment_m(start, goal));
            half_m = half_m.min(rim_m.fold(f64::INFINITY, f64::min));
        }
        let direct_m = start.distance_m(goal);
        cost <= ground.least_cost_per_m() * direct_m.hypot(2.0 * half_m)
    }

    /// Shortens the way and joins the exact ends to it where that can be driven.
    fn route(&self, ground: &Ground, cells: &[Cell], answer: &Plan) -> Result<Route, Obstacle> {
        let geometry = self.geometry();
        let centres: Vec<Position> = cells.iter().map(|&cell| geometry.centre(cell)).collect();
        let mut points = shorten(ground, &centres);
        let exact = [answer.start, answer.goal].map(|end| end.map(|end| end.0));
        if let [Some(start), Some(goal)] = exact {
            points = join(ground, points, start, goal);
        }
        Route::evaluate(ground, self.ranker, &points, self.vehicle.max_speed_mps)
    }
}

/// A search over edges can only end in segments that can be driven; a disagreement would be our own bug, and is said as
/// a refusal instead of a wrong route.
fn unreachable_segment(answer: &mut Plan) {
    answer.optimal = false;
    answer.answer = Err(Refusal {
        status: Status::NoRoute,
        reason: "The way that was found cannot be driven as straight segments.".to_owned(),
        place: None,
        remedy: "Please report this with the run's summary.json.".to_owned(),
    });
}

/// Moves the first and last vertex to the exact ends, or joins the ends to them, where that can be driven.
fn join(ground: &Ground, mut points: Vec<Position>, start: Position, goal: Position) -> Vec<Position> {
    if points.len() < 2 {
        if start == goal {
            return Vec::new();
        }
        let direct = ground.segment(start, goal).is_ok();
        return if direct { vec![start, goal] } else { Vec::new() };
    }
    let drivable = |a, b| ground.segment(a, b).is_ok();
    if drivable(start, points[1]) {
        points[0] = start;
    } else if start != points[0] && drivable(start, points[0]) {
        points.insert(0, start);
    }
    let last = points.len() - 1;
    if drivable(points[last - 1], goal) {
        points[last] = goal;
    } else if goal != points[last] && drivable(points[last], goal) {
        points.push(goal);
    }
    points
}

/// Means of the known heights of coarse cells; NaN where none is known.
fn coarse_mean(elevation_m: LayerView<f32>, coarse: GridGeometry) -> Layer<f32> {
    let geometry = elevation_m.geometry();
    let data = coarse.cells().map(|cell| {
        let (mut sum, mut count) = (0.0, 0u32);
        for row in (cell.row * COARSE..(cell.row + 1) * COARSE).take_while(|&row| row < geometry.rows()) {
            let from = cell.column * COARSE;
            let to = (from + COARSE).min(geometry.columns());
            for &height in &elevation_m.row(row)[from..to] {
                if height.is_finite() {
                    sum += f64::from(height);
                    count += 1;
                }
            }
        }
        (sum / f64::from(count)) as f32
    });
    let mut means = Layer::filled(coarse, f32::NAN);
    for (mean, value) in means.data_mut().iter_mut().zip(data) {
        *mean = value;
    }
    means
}

/// Nest parameters under which a ranking's own lowest suitable rank holds.
pub fn nest_params(params: &RankParams) -> NestParams {
    NestParams {
        rank_min: params.rank_min(),
        ..NestParams::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soil::SoilClass;
    use crate::vehicle::fixtures::pioneer;
    use proptest::prelude::*;

    /// A world as text, 10 m cells: '.' level ground, a digit a height in 40 m, '~' water, '?' unknown elevation.
    fn world(rows: &[&str]) -> (Layer<f32>, Layer<u8>) {
        let geometry = GridGeometry::new(rows.len(), rows[0].len(), 10.0, 0.0, 0.0).unwrap();
        let bytes: Vec<u8> = rows.iter().flat_map(|row| row.bytes()).collect();
        let heights = bytes.iter().map(|byte| match byte {
            b'1'..=b'9' => 40.0 * f32::from(*byte - b'0'),
            b'?' => f32::NAN,
            _ => 0.0,
        });
        let soils = bytes.iter().map(|byte| {
            let class = if *byte == b'~' {
                SoilClass::None
            } else {
                SoilClass::Sand
            };
            class as u8
        });
        (
            Layer::new(geometry, heights.collect(), "z").unwrap(),
            Layer::new(geometry, soils.collect(), "soil").unwrap(),
        )
    }

    fn request(geometry: GridGeometry, start: (usize, usize), goal: (usize, usize)) -> PlanRequest {
        PlanRequest {
            start: geometry.centre(Cell::new(start.0, start.1)),
            goal: geometry.centre(Cell::new(goal.0, goal.1)),
            method: Method::Swarm,
            swarm: SwarmParams {
                agents: 64,
                ..SwarmParams::default()
            },
            arc: ArcKind::Spine,
            width_m: None,
            bridge: false,
            certify: false,
        }
    }

    fn solve(layers: &(Layer<f32>, Layer<u8>), request: &PlanRequest) -> Plan {
        let (elevation, soil) = layers;
        let vehicle = pioneer();
        let params = RankParams::default();
        let ranker = Ranker::new(elevation.view(), Some(soil.view()), None, None, &vehicle, params).unwrap();
        let terrain = Terrain {
            elevation_m: elevation.view(),
            soil: Some(soil.view()),
            map_continues: false,
        };
        plan(terrain, &ranker, &vehicle, &params, request, &mut |_, _, _| true).unwrap()
    }

    const LAKE: [&str; 12] = [
        "....................",
        "....................",
        "....................",
        "....................",
        "........~~..........",
        "........~~..........",
        "........~~..........",
        "........~~..........",
        "........~~..........",
        "........~~..........",
        "........~~..........",
        "........~~..........",
    ];

    const RIVER: [&str; 6] = [
        "........~~..........",
        "........~~..........",
        "........~~..........",
        "........~~..........",
        "........~~..........",
        "........~~..........",
    ];

    #[test]
    fn the_way_leads_around_water() {
        let layers = world(&LAKE);
        let ask = request(layers.0.geometry(), (9, 3), (9, 15));
        let found = solve(&layers, &ask);
        let route = found.answer.unwrap();
        assert!(route.total.length_m > 150.0 && route.total.length_m < 240.0);
        assert!(
            route.legs.iter().any(|leg| leg.reason.contains("water or peat")),
            "{route:?}"
        );
        let exact = solve(
            &layers,
            &PlanRequest {
                method: Method::Exact,
                ..ask
            },
        );
        assert!(exact.optimal);
        approx::assert_relative_eq!(exact.path_cost.unwrap(), found.path_cost.unwrap(), epsilon = 1e-9);
    }

    #[test]
    fn a_river_is_a_reasoned_refusal() {
        let layers = world(&RIVER);
        let found = solve(&layers, &request(layers.0.geometry(), (3, 2), (3, 17)));
        let refusal = found.answer.unwrap_err();
        assert_eq!(refusal.status, Status::NoRoute);
        assert!(refusal.reason.contains("water or peat"), "{}", refusal.reason);
        let place = refusal.place.unwrap();
        assert!((80.0..100.0).contains(&place.x_m), "{place:?}");
        assert!(!refusal.remedy.is_empty());
    }

    #[test]
    fn a_passage_too_narrow_for_a_nest_can_be_bridged() {
        let mut rows = RIVER.to_vec();
        rows[3] = "....................";
        let layers = world(&rows);
        let ask = request(layers.0.geometry(), (3, 2), (3, 17));
        let refusal = solve(&layers, &ask).answer.unwrap_err();
        assert!(refusal.remedy.contains("--bridge"), "{refusal:?}");
        let bridged = solve(&layers, &PlanRequest { bridge: true, ..ask });
        let total = bridged.answer.unwrap().total;
        assert!(total.bridged_m > 10.0 && total.cost > total.time_s);
        assert!(!bridged.optimal);
    }

    #[test]
    fn ends_are_moved_to_near_ground_or_refused() {
        let layers = world(&LAKE);
        let geometry = layers.0.geometry();
        let near = solve(&layers, &request(geometry, (9, 8), (9, 2)));
        assert!((5.0..25.0).contains(&near.start.unwrap().1));
        assert!(near.answer.is_ok());
        let cliffs = world(&[
            "....1234321....",
            "....1234321....",
            "....1234321....",
            "....1234321....",
        ]);
        let ask = |start, goal| solve(&cliffs, &request(cliffs.0.geometry(), start, goal));
        let refusal = ask((1, 1), (1, 8)).answer.unwrap_err();
        assert_eq!(refusal.status, Status::GoalBlocked);
        assert!(refusal.reason.contains("too steep"), "{refusal:?}");
        assert_eq!(ask((1, 8), (1, 1)).answer.unwrap_err().status, Status::StartBlocked);
        let mut away = request(geometry, (1, 1), (2, 2));
        away.goal = Position::new(5000.0, -50.0);
        let refusal = solve(&layers, &away).answer.unwrap_err();
        assert_eq!(refusal.status, Status::OutsideMap);
        assert!(refusal.reason.contains("4800 m outside"), "{refusal:?}");
    }

    #[test]
    fn a_start_that_is_the_goal_is_a_route_of_no_length() {
        let layers = world(&LAKE);
        let found = solve(&layers, &request(layers.0.geometry(), (2, 2), (2, 2)));
        let route = found.answer.unwrap();
        assert_eq!((route.legs.len(), route.total.length_m), (0, 0.0));
    }

    #[test]
    fn a_void_is_no_ground() {
        let mut rows = LAKE.map(|row| row.replace('~', "?")).to_vec();
        rows[0] = "........??..........".to_owned();
        let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
        let layers = world(&rows);
        let route = solve(&layers, &request(layers.0.geometry(), (9, 3), (9, 15)))
            .answer
            .unwrap();
        for leg in &route.legs {
            for end in [leg.from, leg.to] {
                assert!(layers.0[layers.0.geometry().cell_at(end).unwrap()].is_finite());
            }
        }
    }

    #[test]
    fn a_stop_is_heard_in_every_stage() {
        let layers = world(&LAKE);
        let (elevation, soil) = &layers;
        let vehicle = pioneer();
        let params = RankParams::default();
        let ranker = Ranker::new(elevation.view(), Some(soil.view()), None, None, &vehicle, params).unwrap();
        let terrain = Terrain {
            elevation_m: elevation.view(),
            soil: None,
            map_continues: false,
        };
        let ask = request(elevation.geometry(), (9, 3), (9, 15));
        for stage in [Stage::Corridor, Stage::Regions, Stage::Route] {
            let found = plan(terrain, &ranker, &vehicle, &params, &ask, &mut |at, _, _| at != stage);
            assert_eq!(found.unwrap_err(), PlannerError::Stopped, "{stage:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn a_certified_swarm_route_costs_what_the_exact_route_costs(
            seed: u64, a in 0usize..900, b in 0usize..900, holes in 0u32..6,
        ) {
            let geometry = GridGeometry::new(30, 30, 10.0, 0.0, 0.0).unwrap();
            let cells = geometry.cells().map(|cell| {
                let draw = crate::random::philox([geometry.index(cell) as u32, 3, 0, 0], seed);
                if draw[0] % 100 < holes { SoilClass::None as u8 } else { (draw[1] % 5) as u8 }
            });
            let layers = (
                Layer::filled(geometry, 5.0f32),
                Layer::new(geometry, cells.collect(), "soil").unwrap(),
            );
            let (a, b) = (geometry.cell(a), geometry.cell(b));
            let mut ask = request(geometry, (a.row, a.column), (b.row, b.column));
            ask.certify = true;
            ask.width_m = Some(80.0);
            let swarm = solve(&layers, &ask);
            let exact = solve(&layers, &PlanRequest { method: Method::Exact, ..ask });
            match (&swarm.answer, &exact.answer) {
                (Ok(route), Ok(best)) => {
                    prop_assert!(swarm.optimal && exact.optimal);
                    let (found, least) = (swarm.path_cost.unwrap(), exact.path_cost.unwrap());
                    prop_assert!((found - least).abs() <= 1e-9 * least.max(1.0), "{found} {least}");
                    prop_assert!(route.total.cost <= found * (1.0 + 1e-9) + 20.0);
                    prop_assert!(route.total.cost >= swarm.cost_lower_bound.unwrap() * (1.0 - 1e-9));
                    prop_assert_eq!(best.legs.is_empty(), route.legs.is_empty());
                }
                (Err(refusal), Err(other)) => prop_assert_eq!(refusal.status, other.status),
                (found, least) => prop_assert!(false, "{:?} {:?}", found, least),
            }
        }
    }
}
