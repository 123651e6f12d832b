//! The whole of planning: corridor, swarm, nests, search, shortcuts, certificate.

use crate::corridor::{ArcKind, capsule_half_width_m};
use crate::grid::{Cell, GridGeometry, Layer, LayerView, Position};
use crate::nest::{BitRows, Nests, exact_nests};
use crate::rank::{CellSource, RankParams, Ranker, SourceFault};
use crate::swarm::StopRule;
use crate::vehicle::Vehicle;

use super::answer::{Method, Plan, PlanRequest, Stage, StageReport, Terrain};
use super::any_angle::{best_refined, centres, lazy_theta};
use super::clearance::ClearanceField;
use super::ground::Ground;
use super::path_kind::{EightNeighbours, PathKind};
use super::refusal::{Refusal, Status, blocked_end, disconnected, limited};
use super::route::{Route, read_beside};
use super::search::{Search, search};
use super::smooth::{drop_collinear, shorten};
use super::stop::{StoppedBy, stopped_early};
use super::watch::Watch;
use super::{Obstacle, PlannerError};

/// How far start and goal are moved to reach a nest, in cells.
const SNAP_CELLS: f64 = 2.0;

/// Ticks after which a swarm that has not finished is taken as it is: far beyond what a swarm that can finish needs.
pub(super) const MOST_TICKS: u64 = 100_000_000;

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
    let mut forever = || false;
    let mut report = |stage, done, total| report(stage, done, total);
    let mut watch = Watch::new(&mut report, &mut forever, None);
    plan_watched(terrain, ranker, vehicle, params, request, &mut watch)
}

/// [`plan`] for as long as there is time, with pictures.
///
/// # Errors
/// [`PlannerError`] when the request is not usable or the caller asked to stop.
pub fn plan_watched(
    terrain: Terrain,
    ranker: &Ranker,
    vehicle: &Vehicle,
    params: &RankParams,
    request: &PlanRequest,
    watch: &mut Watch,
) -> Result<Plan, PlannerError> {
    request.swarm.validate()?;
    request.stop.map_or(Ok(()), StopRule::validate)?;
    let geometry = terrain.elevation_m.geometry();
    request.objective.validate(geometry.cell_size_m())?;
    check_factor(terrain.cost_factor)?;
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
    // Only the guided swarm needs but a part of the ground; risk is counted from no-go cells that nobody need have seen.
    let needs_a_part = request.method == Method::Swarm && planner.is_guided() && request.objective.risk == 0.0;
    if ranker.reads_when_needed() && !needs_a_part {
        ranker.prefetch(&mut geometry.cells(), 0)?;
    }
    match request.method {
        Method::Exact => {
            watch.tell(Stage::Regions, 0, 1)?;
            let rank = ranker.rank_all();
            answer.cells_evaluated = geometry.cell_count() as u64;
            let nests = exact_nests(&rank, None, &request.swarm.nest)?;
            planner.finish(answer, nests, Searched::Whole, watch)
        }
        Method::Swarm if planner.is_guided() => planner.with_guided_swarm(answer, watch),
        Method::Swarm => planner.with_swarm(answer, watch),
    }
}

/// Checks a user's factor on costs.
///
/// # Errors
/// [`PlannerError::NegativeFactor`] naming the first cell with a factor below zero.
pub(super) fn check_factor(factor: Option<LayerView<f32>>) -> Result<(), PlannerError> {
    let Some(factors) = factor else { return Ok(()) };
    match factors.data().iter().position(|&factor| factor < 0.0) {
        None => Ok(()),
        Some(index) => {
            let Cell { row, column } = factors.geometry().cell(index);
            let factor = factors.data()[index];
            Err(PlannerError::NegativeFactor { row, column, factor })
        }
    }
}

fn outside(geometry: GridGeometry, name: &str, place: Position) -> Refusal {
    let east = geometry.west_m() + geometry.columns() as f64 * geometry.cell_size_m();
    let south = geometry.north_m() - geometry.rows() as f64 * geometry.cell_size_m();
    let away = |low: f64, high: f64, at: f64| (low - at).max(at - high).max(0.0);
    let distance_m = away(geometry.west_m(), east, place.x_m).hypot(away(south, geometry.north_m(), place.y_m));
    let away = if distance_m < 1.0 {
        "on the edge of the map or just outside".to_owned()
    } else {
        format!("{distance_m:.0} m outside the map")
    };
    Refusal {
        status: Status::OutsideMap,
        reason: format!("The {name} lies {away}."),
        place: Some(place),
        remedy: "Give elevation that covers it; points are longitude,latitude unless `--points-crs` says otherwise."
            .to_owned(),
    }
}

/// Cells of both ends inside nests, with how far they were moved in metres.
pub(super) struct Ends {
    pub(super) start: (Cell, f64),
    pub(super) goal: (Cell, f64),
    pub(super) connected: bool,
}

/// Which cells are settled: known to be nests or not.
#[derive(Clone, Copy)]
pub(super) enum Searched<'a> {
    /// All of the map.
    Whole,
    /// All inside a swathe.
    Swathe(&'a Layer<bool>),
    /// Some around the route.
    Part,
    /// Some, and the search for more was ended.
    Early(StoppedBy),
}

impl Searched<'_> {
    pub(super) fn is_whole(&self) -> bool {
        matches!(self, Self::Whole)
    }
}

/// The request with everything that it is answered from.
pub(super) struct Planner<'a> {
    pub(super) terrain: Terrain<'a>,
    pub(super) ranker: &'a Ranker<'a>,
    pub(super) vehicle: &'a Vehicle,
    pub(super) params: &'a RankParams,
    pub(super) request: &'a PlanRequest,
    pub(super) ends: [Cell; 2],
}

impl Planner<'_> {
    pub(super) fn geometry(&self) -> GridGeometry {
        self.terrain.elevation_m.geometry()
    }

    pub(super) fn places(&self) -> [Position; 2] {
        [self.request.start, self.request.goal]
    }

    /// When the swarm stops: as asked, else when the route is good enough with an arc that is laid anew, and when the swathe
    /// is finished with one that stays.
    pub(super) fn rule(&self) -> StopRule {
        let usual = if self.is_guided() {
            StopRule::Good
        } else {
            StopRule::Finished
        };
        self.request.stop.unwrap_or(usual)
    }

    fn is_guided(&self) -> bool {
        self.request.arc == ArcKind::Relaid && !self.request.certify && self.request.width_m.is_none()
    }

    /// Distance around start and goal within which the swathe decides nothing any more: what is a nest within the reach of
    /// snapping depends on cells up to two vicinities farther.
    pub(super) fn settled_radius_m(&self) -> f64 {
        (SNAP_CELLS + 2.0 * self.vicinity_reach() + 1.0) * 2f64.sqrt() * self.geometry().cell_size_m()
    }

    /// Cells that a vicinity reaches beyond its centre.
    fn vicinity_reach(&self) -> f64 {
        let steps = self.request.swarm.nest.vicinity.steps().unwrap_or_default();
        f64::from(steps.iter().map(|step| step.rows.abs()).max().unwrap_or(0))
    }

    /// The nest cells nearest to start and goal. On the whole map, where no wider swathe can connect them, a pair a little
    /// farther off is taken when it lies in one nest.
    pub(super) fn snap(&self, nests: &Nests, whole: bool) -> Result<Ends, Status> {
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

    /// Searches the way on the nests that were found.
    pub(super) fn finish(
        &self,
        mut answer: Plan,
        nests: Nests,
        searched: Searched,
        watch: &mut Watch,
    ) -> Result<Plan, PlannerError> {
        let geometry = self.geometry();
        let snapped = self.snap(&nests, searched.is_whole());
        if let Searched::Early(by) = searched
            && !snapped.as_ref().is_ok_and(|ends| ends.connected)
        {
            answer.nests = Some(nests);
            return Ok(answer.refused(stopped_early(by, self.request.budget)));
        }
        let ends = match snapped {
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
        let bridging = !ends.connected && self.request.bridge && searched.is_whole();
        if !ends.connected && !bridging {
            let refusal = self.why_disconnected(&nests, &ends);
            answer.nests = Some(nests);
            return Ok(answer.refused(refusal));
        }
        watch.tell(Stage::Route, 0, 0)?;
        let ground = self.ground(&nests, &ends, bridging, &mut answer.cells_evaluated);
        let (first, last) = (ends.start.0, ends.goal.0);
        let mut tell = |done, total| watch.ask(Stage::Route, done, total);
        let found = match self.request.path {
            PathKind::Grid8 => search(&EightNeighbours(&ground), first, last, &mut tell),
            PathKind::Grid16 | PathKind::AnyAngle | PathKind::Drivable | PathKind::Auto => {
                search(&ground, first, last, &mut tell)
            }
        };
        match found {
            Search::Stopped => return Err(PlannerError::Stopped),
            Search::Unreachable => {
                let limited = limited(&ground, &nests, [ends.start.0, ends.goal.0], self.vehicle);
                drop(ground);
                let refusal = match searched {
                    Searched::Early(by) => stopped_early(by, self.request.budget),
                    _ => limited.unwrap_or_else(|| self.why_disconnected(&nests, &ends)),
                };
                answer.nests = Some(nests);
                return Ok(answer.refused(refusal));
            }
            Search::Found { cells, cost } => {
                answer.optimal = !bridging && self.is_optimal(searched, cost, &ends, &ground);
                match self.route(&ground, &cells, &mut answer, watch)? {
                    Ok(route) => {
                        let ends = (route.legs.first(), route.legs.last());
                        let least = match ends {
                            (Some(first), Some(last)) => {
                                ground.least_cost(first.from, last.to, first.from.distance_m(last.to))
                            }
                            _ => 0.0,
                        };
                        answer.cost_lower_bound = Some(least);
                        answer = self.driven(&ground, route, answer, watch)?;
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

    /// The ground of the nest that holds the start, or of all nests and what bridges them, priced by the objective. Cells
    /// whose rank the pricing asks for are added to `evaluated`.
    pub(super) fn ground(&self, nests: &Nests, ends: &Ends, bridging: bool, evaluated: &mut u64) -> Ground<'_> {
        let geometry = self.geometry();
        let labels = nests.labels().data();
        let nest = nests.label(ends.start.0);
        let goal = geometry.centre(ends.goal.0);
        let Terrain { elevation_m, soil, .. } = self.terrain;
        if !bridging {
            let is_open = |index: usize| labels[index] == nest;
            let moisture = self.params.moisture_percent;
            let ground = Ground::new(elevation_m, soil, self.vehicle, moisture, is_open, None, goal);
            return self.priced(ground, is_open, ends, evaluated);
        }
        let rank_min = self.request.swarm.nest.rank_min;
        let bridged = BitRows::from_fn(geometry, |row, column| {
            let cell = Cell::new(row, column);
            nests.label(cell) == 0 && self.ranker.cell_rank(cell).rank() >= rank_min
        });
        let open = bridged.clone();
        let is_open = |index: usize| labels[index] > 0 || open.get(geometry.cell(index));
        let ground = Ground::new(
            elevation_m,
            soil,
            self.vehicle,
            self.params.moisture_percent,
            is_open,
            Some(bridged),
            goal,
        );
        self.priced(ground, is_open, ends, evaluated)
    }

    /// Lets a ground cost what the request says.
    fn priced<'a>(
        &self,
        ground: Ground<'a>,
        is_open: impl Fn(usize) -> bool + Sync,
        ends: &Ends,
        evaluated: &mut u64,
    ) -> Ground<'a>
    where
        Self: 'a,
    {
        let mut ground = ground.with_objective(self.request.objective);
        if self.request.objective.risk > 0.0 {
            let field = ClearanceField::new(self.ranker, is_open, ground.risk_reach_m());
            let all = self.geometry().cell_count() as u64;
            *evaluated = (*evaluated + field.cells_evaluated).min(all.max(*evaluated));
            ground = ground.with_exposure(move |cell| field.exposure(cell));
        }
        if let Some(factor) = self.terrain.cost_factor {
            ground = ground.with_factor(factor);
        }
        if self.request.reversed {
            ground = ground.reversed(self.geometry().centre(ends.goal.0));
        }
        ground
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
    fn is_optimal(&self, searched: Searched, cost: f64, ends: &Ends, ground: &Ground) -> bool {
        let geometry = self.geometry();
        let [start, goal] = [ends.start.0, ends.goal.0].map(|cell| geometry.centre(cell));
        let mut half_m = match searched {
            Searched::Whole => f64::INFINITY,
            Searched::Swathe(inside) => capsule_half_width_m(inside, start, goal),
            Searched::Part | Searched::Early(_) => 0.0,
        };
        if self.terrain.map_continues {
            let rim = geometry.cells().filter(|cell| {
                cell.row == 0
                    || cell.column == 0
                    || cell.row + 1 == geometry.rows()
                    || cell.column + 1 == geometry.columns()
            });
            let rim_m = rim.map(|cell| geometry.centre(cell).distance_to_segment_m(start, goal));
            half_m = half_m.min(rim_m.fold(f64::INFINITY, f64::min));
        }
        // Within two vicinities of the border nests can be smaller than they would be on the whole map.
        half_m = (half_m - (2.0 * self.vicinity_reach() + 1.0) * geometry.cell_size_m()).max(0.0);
        let direct_m = start.distance_m(goal);
        // All of the map was searched, or the bound of a way that has to leave it decides.
        half_m.is_infinite() || cost <= ground.least_cost(start, goal, direct_m.hypot(2.0 * half_m))
    }

    /// Makes the kind of path that was asked for of the way, with the exact ends joined to it where that can be driven.
    fn route(
        &self,
        ground: &Ground,
        cells: &[Cell],
        answer: &mut Plan,
        watch: &mut Watch,
    ) -> Result<Result<Route, Obstacle>, PlannerError> {
        let exact = [answer.start, answer.goal].map(|end| end.map(|end| end.0));
        let joined = |points| match exact {
            [Some(start), Some(goal)] => join(ground, points, start, goal),
            _ => points,
        };
        let steps = centres(ground, cells);
        let points = match self.request.path {
            PathKind::Grid8 => joined(drop_collinear(&steps)),
            PathKind::Grid16 | PathKind::Drivable | PathKind::Auto => joined(shorten(ground, &steps)),
            PathKind::AnyAngle => {
                let mut tell = |done, total| watch.ask(Stage::Route, done, total);
                let (first, last) = (cells[0], cells[cells.len() - 1]);
                let sighted = lazy_theta(ground, first, last, &mut tell).ok_or(PlannerError::Stopped)?;
                let (short, sighted) = (joined(shorten(ground, &steps)), joined(centres(ground, &sighted)));
                let best = best_refined(ground, &short, &sighted, &mut tell).ok_or(PlannerError::Stopped)?;
                best.points
            }
        };
        match read_beside(ground, self.ranker, &points) {
            Ok(()) => {}
            Err(SourceFault::Stopped) => return Err(PlannerError::Stopped),
            Err(fault) => answer.unread = Some(fault),
        }
        let max_speed_mps = self.vehicle.max_speed_mps;
        Ok(Route::evaluate(ground, self.ranker, &points, max_speed_mps))
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
            return vec![start];
        }
        let direct = ground.segment(start, goal).is_ok();
        return if direct { vec![start, goal] } else { points };
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

#[cfg(test)]
mod stop_tests;
#[cfg(test)]
mod tests;
