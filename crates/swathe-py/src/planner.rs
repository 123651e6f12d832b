//! The planner.

use numpy::{Element, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use swathe::grid::{Cell, LayerView, Position};
use swathe::planner::{
    Algorithm, AnyAngleMethod, ArcFrame, CellCost, Corners, Film, LazyRequest, Leg, Objective, PathKind, Plan,
    PlanRequest, PlannerError, Search, SegmentFacts, Stage, Status, Terrain, Watch, Way, WaySearch,
};

use crate::convert::{arc_kind, array, entry, geometry, method, nest_params, position, swarm_params, values, word};
use crate::drivable::driven;
use crate::error::CoreError;
use crate::nest::give;
use crate::progress::PythonReport;
use crate::region::Region;
use crate::stop::stop_params;
use crate::swarm::{frame_dict, tally_dict};

type Places = Option<(Vec<(usize, usize)>, f64)>;
type Vertices = Option<(Vec<(f64, f64)>, f64)>;

/// Costs per metre in one of the kinds of number that the core reads in place.
#[derive(FromPyObject)]
pub(crate) enum Costs<'py> {
    Flags(PyReadonlyArray2<'py, bool>),
    Bytes(PyReadonlyArray2<'py, u8>),
    Words(PyReadonlyArray2<'py, u16>),
    Singles(PyReadonlyArray2<'py, f32>),
    Doubles(PyReadonlyArray2<'py, f64>),
}

/// What both searches over cells are asked for, but the start.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct CellSearch {
    cell_size_m: f64,
    neighbours: u32,
    cut_corners: bool,
    memory_limit_bytes: Option<u64>,
}

impl CellSearch {
    fn corners(&self) -> Corners {
        if self.cut_corners { Corners::Cut } else { Corners::Keep }
    }
}

/// (cells, cost) of a cheapest way over costs per metre, or None.
#[pyfunction]
#[pyo3(signature = (costs, start, goal, options, algorithm, report))]
pub(crate) fn shortest_path(
    py: Python<'_>,
    costs: Costs<'_>,
    start: (usize, usize),
    goal: (usize, usize),
    options: CellSearch,
    algorithm: &str,
    report: Option<Py<PyAny>>,
) -> PyResult<Places> {
    let algorithm = word(
        "method",
        algorithm,
        &[
            ("auto", Algorithm::Auto),
            ("dijkstra", Algorithm::Dijkstra),
            ("astar", Algorithm::AStar),
        ],
    )?;
    match costs {
        Costs::Flags(costs) => path(py, &costs, [start, goal], &options, algorithm, report),
        Costs::Bytes(costs) => path(py, &costs, [start, goal], &options, algorithm, report),
        Costs::Words(costs) => path(py, &costs, [start, goal], &options, algorithm, report),
        Costs::Singles(costs) => path(py, &costs, [start, goal], &options, algorithm, report),
        Costs::Doubles(costs) => path(py, &costs, [start, goal], &options, algorithm, report),
    }
}

fn path<C: CellCost + Element>(
    py: Python<'_>,
    costs: &PyReadonlyArray2<'_, C>,
    ends: [(usize, usize); 2],
    options: &CellSearch,
    algorithm: Algorithm,
    report: Option<Py<PyAny>>,
) -> PyResult<Places> {
    let (rows, columns) = costs.as_array().dim();
    let grid = geometry((rows, columns, options.cell_size_m, 0.0, 0.0))?;
    let data = values(costs)?;
    let [start, goal] = ends.map(|(row, column)| Cell::new(row, column));
    let mut told = PythonReport::new(report);
    let result = py.detach(|| -> Result<Search, CoreError> {
        let costs = LayerView::new(grid, data, "the costs")?;
        let mut tell = |done, total| told.tell("route", done, total);
        let (neighbours, memory) = (options.neighbours, options.memory_limit_bytes);
        Ok(swathe::planner::shortest_path(
            costs,
            start,
            goal,
            neighbours,
            options.corners(),
            algorithm,
            memory,
            &mut tell,
        )?)
    });
    match told.settle(result.map_err(PyErr::from))? {
        Search::Found { cells, cost } => Ok(Some((cells.iter().map(|cell| (cell.row, cell.column)).collect(), cost))),
        Search::Unreachable => Ok(None),
        Search::Stopped => Err(CoreError::from(PlannerError::Stopped).into()),
    }
}

/// Costs from the start to every cell, infinite where no way leads.
#[pyfunction]
#[pyo3(signature = (costs, start, options, report))]
pub(crate) fn cost_field<'py>(
    py: Python<'py>,
    costs: Costs<'py>,
    start: (usize, usize),
    options: CellSearch,
    report: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    match costs {
        Costs::Flags(costs) => field(py, &costs, start, &options, report),
        Costs::Bytes(costs) => field(py, &costs, start, &options, report),
        Costs::Words(costs) => field(py, &costs, start, &options, report),
        Costs::Singles(costs) => field(py, &costs, start, &options, report),
        Costs::Doubles(costs) => field(py, &costs, start, &options, report),
    }
}

fn field<'py, C: CellCost + Element>(
    py: Python<'py>,
    costs: &PyReadonlyArray2<'py, C>,
    start: (usize, usize),
    options: &CellSearch,
    report: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (rows, columns) = costs.as_array().dim();
    let grid = geometry((rows, columns, options.cell_size_m, 0.0, 0.0))?;
    let data = values(costs)?;
    let start = Cell::new(start.0, start.1);
    let mut told = PythonReport::new(report);
    let result = py.detach(|| -> Result<Vec<f64>, CoreError> {
        let costs = LayerView::new(grid, data, "the costs")?;
        let mut tell = |done, total| told.tell("route", done, total);
        let (neighbours, memory) = (options.neighbours, options.memory_limit_bytes);
        let found = swathe::planner::cell_cost_field(costs, start, neighbours, options.corners(), memory, &mut tell)?;
        Ok(found.ok_or(PlannerError::Stopped)?)
    });
    array(py, grid, told.settle(result.map_err(PyErr::from))?)
}

/// ([(row, column)], cost) of a cheap way at any angle over costs per metre, or None; cell centres are whole numbers.
#[pyfunction]
#[pyo3(signature = (costs, start, goal, cell_size_m, method, cut_corners, report))]
#[allow(clippy::too_many_arguments, reason = "the mirror's keyword arguments")]
pub(crate) fn any_angle_path<'py>(
    py: Python<'py>,
    costs: PyReadonlyArray2<'py, f64>,
    start: (usize, usize),
    goal: (usize, usize),
    cell_size_m: f64,
    method: &str,
    cut_corners: bool,
    report: Option<Py<PyAny>>,
) -> PyResult<Vertices> {
    let (rows, columns) = costs.as_array().dim();
    let grid = geometry((rows, columns, cell_size_m, 0.0, 0.0))?;
    let known = [
        ("auto", AnyAngleMethod::Auto),
        ("theta", AnyAngleMethod::Theta),
        ("eikonal", AnyAngleMethod::Eikonal),
    ];
    let method = word("method", method, &known)?;
    let corners = if cut_corners { Corners::Cut } else { Corners::Keep };
    let data = values(&costs)?;
    let [start, goal] = [start, goal].map(|(row, column)| Cell::new(row, column));
    let mut told = PythonReport::new(report);
    let result = py.detach(|| -> Result<WaySearch, CoreError> {
        let costs = LayerView::new(grid, data, "the costs")?;
        let mut tell = |done, total| told.tell("route", done, total);
        Ok(swathe::planner::any_angle_path(
            costs, start, goal, corners, method, &mut tell,
        )?)
    });
    match told.settle(result.map_err(PyErr::from))? {
        WaySearch::Found(Way { points, cost }) => {
            let places = points.iter().map(|&point| grid.fractional(point));
            Ok(Some((
                places.map(|(row, column)| (row - 0.5, column - 0.5)).collect(),
                cost,
            )))
        }
        WaySearch::Unreachable => Ok(None),
        WaySearch::Stopped => Err(CoreError::from(swathe::planner::PlannerError::Stopped).into()),
    }
}

/// Eikonal costs from a cell to every cell, infinite where none leads.
#[pyfunction]
#[pyo3(signature = (costs, start, cell_size_m, report))]
pub(crate) fn eikonal_field<'py>(
    py: Python<'py>,
    costs: PyReadonlyArray2<'py, f64>,
    start: (usize, usize),
    cell_size_m: f64,
    report: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (rows, columns) = costs.as_array().dim();
    let grid = geometry((rows, columns, cell_size_m, 0.0, 0.0))?;
    let data = values(&costs)?;
    let mut told = PythonReport::new(report);
    let result = py.detach(|| -> Result<Vec<f64>, CoreError> {
        let costs = LayerView::new(grid, data, "the costs")?;
        let mut tell = |done, total| told.tell("route", done, total);
        Ok(swathe::planner::eikonal_field(
            costs,
            Cell::new(start.0, start.1),
            &mut tell,
        )?)
    });
    array(py, grid, told.settle(result.map_err(PyErr::from))?)
}

fn path_kind(given: &str) -> PyResult<PathKind> {
    let known = [
        ("grid8", PathKind::Grid8),
        ("grid16", PathKind::Grid16),
        ("any-angle", PathKind::AnyAngle),
        ("drivable", PathKind::Drivable),
        ("auto", PathKind::Auto),
    ];
    word("path", given, &known)
}

/// Lazy A* through nests: a dictionary of `cells` and `cost` (None without a way), `cells_evaluated`, `cells_expanded`.
#[pyfunction]
#[pyo3(signature = (region, start, goal, nest, weight, request, factor, report))]
#[allow(clippy::too_many_arguments, reason = "the mirror's keyword arguments")]
pub(crate) fn lazy_astar<'py>(
    py: Python<'py>,
    region: &Region,
    start: (usize, usize),
    goal: (usize, usize),
    nest: &Bound<'py, PyDict>,
    weight: f64,
    request: &Bound<'py, PyDict>,
    factor: Option<PyReadonlyArray2<'py, f32>>,
    report: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let [start, goal] = [start, goal].map(|(row, column)| Cell::new(row, column));
    let nest = nest_params(nest)?;
    let request = LazyRequest {
        start,
        goal,
        nest,
        weight,
        objective: objective(request)?,
        reversed: entry(request, "reversed")?,
    };
    let factor = factor.as_ref().map(values).transpose()?;
    let mut told = PythonReport::new(report);
    let result = region.with(py, false, |terrain, ranker, vehicle, params| {
        let mut tell = |done, total| told.tell("route", done, total);
        let moisture = params.moisture_percent;
        let terrain = priced(terrain, factor)?;
        Ok(swathe::planner::lazy_astar(
            terrain, ranker, vehicle, moisture, &request, &mut tell,
        )?)
    });
    let answer = told.settle(result)?;
    let found = PyDict::new(py);
    let (cells, cost) = match answer.search {
        Search::Found { cells, cost } => (Some(cells), Some(cost)),
        Search::Unreachable => (None, None),
        Search::Stopped => return Err(CoreError::from(PlannerError::Stopped).into()),
    };
    let cells = cells.map(|cells| cells.iter().map(|cell| (cell.row, cell.column)).collect::<Vec<_>>());
    found.set_item("cells", cells)?;
    found.set_item("cost", cost)?;
    found.set_item("cells_evaluated", answer.cells_evaluated)?;
    found.set_item("cells_expanded", answer.cells_expanded)?;
    Ok(found)
}

/// Plans a route; the answer is a dictionary that `swathe.planner` wraps.
#[pyfunction]
#[pyo3(signature = (region, request, factor, map_continues, report))]
pub(crate) fn plan<'py>(
    py: Python<'py>,
    region: &Region,
    request: &Bound<'py, PyDict>,
    factor: Option<PyReadonlyArray2<'py, f32>>,
    map_continues: bool,
    report: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let (stop, budget, deadline) = stop_params(request)?;
    let most_frames: usize = entry(request, "frames")?;
    let mut film = Film::new(most_frames, entry(request, "frame_step")?);
    let request = PlanRequest {
        start: position(entry(request, "start")?),
        goal: position(entry(request, "goal")?),
        method: method(&entry::<String>(request, "method")?)?,
        swarm: swarm_params(request)?,
        arc: arc_kind(&entry::<String>(request, "arc")?, entry(request, "sagitta_m")?)?,
        width_m: entry(request, "width_m")?,
        path: path_kind(&entry::<String>(request, "path")?)?,
        headings_rad: [
            entry(request, "start_heading_rad")?,
            entry(request, "goal_heading_rad")?,
        ],
        bridge: entry(request, "bridge")?,
        certify: entry(request, "certify")?,
        objective: objective(request)?,
        reversed: entry(request, "reversed")?,
        stop,
        budget,
    };
    let factor = factor.as_ref().map(values).transpose()?;
    let mut told = PythonReport::new(report);
    let result = region.with(py, map_continues, |terrain, ranker, vehicle, params| {
        let mut tell = |stage, done, total| {
            let stage = match stage {
                Stage::Corridor => "corridor",
                Stage::Regions => "regions",
                Stage::Route => "route",
            };
            told.tell(stage, done, total)
        };
        let terrain = priced(terrain, factor)?;
        let mut is_over = || deadline.is_over();
        let film = (most_frames > 0).then_some(&mut film);
        let mut watch = Watch::new(&mut tell, &mut is_over, film);
        let plan = swathe::planner::plan_watched(terrain, ranker, vehicle, params, &request, &mut watch)?;
        Ok(plan)
    });
    let found = answer(py, told.settle(result)?)?;
    let frames: PyResult<Vec<_>> = film.frames().into_iter().map(|frame| arc_frame(py, frame)).collect();
    found.set_item("frames", PyList::new(py, frames?)?)?;
    Ok(found)
}

fn arc_frame(py: Python<'_>, frame: ArcFrame) -> PyResult<Bound<'_, PyDict>> {
    let found = frame_dict(py, frame.swarm)?;
    let arc: Vec<(f64, f64)> = frame.arc.iter().map(|p| (p.x_m, p.y_m)).collect();
    found.set_item("arc", arc)?;
    found.set_item("width_m", frame.width_m)?;
    found.set_item("is_route", frame.is_route)?;
    Ok(found)
}

/// The objective of a request's entry (time, energy, risk, risk distance in metres or None).
fn objective(request: &Bound<'_, PyDict>) -> PyResult<Objective> {
    let (time, energy, risk, risk_distance_m) = entry(request, "objective")?;
    Ok(Objective {
        time,
        energy,
        risk,
        risk_distance_m,
    })
}

/// The terrain with a user's factor on costs.
fn priced<'a>(terrain: Terrain<'a>, factor: Option<&'a [f32]>) -> Result<Terrain<'a>, CoreError> {
    let geometry = terrain.elevation_m.geometry();
    let view = |factor| LayerView::new(geometry, factor, "the cost factor");
    let cost_factor = factor.map(view).transpose()?;
    Ok(Terrain { cost_factor, ..terrain })
}

fn answer(py: Python<'_>, plan: Plan) -> PyResult<Bound<'_, PyDict>> {
    let found = PyDict::new(py);
    let place = |p: Position| (p.x_m, p.y_m);
    match &plan.answer {
        Ok(route) => {
            found.set_item("status", Status::RouteFound.name())?;
            found.set_item("total", facts(py, &route.total)?)?;
            let legs: PyResult<Vec<_>> = route.legs.iter().map(|one| leg(py, one)).collect();
            found.set_item("legs", PyList::new(py, legs?)?)?;
        }
        Err(refusal) => {
            found.set_item("status", refusal.status.name())?;
            found.set_item("reason", &refusal.reason)?;
            found.set_item("place", refusal.place.map(place))?;
            found.set_item("remedy", &refusal.remedy)?;
        }
    }
    if let Some(path) = &plan.drivable {
        found.set_item("drivable", driven(py, path)?)?;
    }
    let path: Vec<(usize, usize)> = plan.path.iter().map(|cell| (cell.row, cell.column)).collect();
    found.set_item("path", path)?;
    found.set_item("path_cost", plan.path_cost)?;
    found.set_item("cost_lower_bound", plan.cost_lower_bound)?;
    found.set_item("optimal", plan.optimal)?;
    found.set_item("start", plan.start.map(|(p, away_m)| (place(p), away_m)))?;
    found.set_item("goal", plan.goal.map(|(p, away_m)| (place(p), away_m)))?;
    found.set_item("cells_evaluated", plan.cells_evaluated)?;
    found.set_item("is_complete", plan.fault().is_none())?;
    if let Some(nests) = plan.nests {
        let (labels, sizes) = give(py, nests)?;
        found.set_item("labels", labels)?;
        found.set_item("sizes", sizes)?;
    }
    if let Some(swarm) = plan.swarm {
        found.set_item("swarm", tally_dict(py, swarm.tally)?)?;
        found.set_item("widened", swarm.widened)?;
    }
    if let Some(stopped) = plan.stopped {
        found.set_item(
            "stopped",
            (
                stopped.by.name(),
                stopped.unknown_cells,
                stopped.swathe_cells,
                stopped.quiet_visits,
            ),
        )?;
    }
    if let Some(corridor) = plan.corridor {
        let arc: Vec<(f64, f64)> = corridor.arc().iter().copied().map(place).collect();
        found.set_item("arc", arc)?;
        found.set_item("width_m", corridor.width_m())?;
        found.set_item("sagitta_m", corridor.sagitta_m())?;
    }
    Ok(found)
}

fn leg<'py>(py: Python<'py>, leg: &Leg) -> PyResult<Bound<'py, PyDict>> {
    let found = facts(py, &leg.facts)?;
    found.set_item("from", (leg.from.x_m, leg.from.y_m))?;
    found.set_item("to", (leg.to.x_m, leg.to.y_m))?;
    found.set_item("soil", leg.soil.name())?;
    found.set_item("rank_min", leg.rank_min)?;
    found.set_item("reason", &leg.reason)?;
    Ok(found)
}

pub(crate) fn facts<'py>(py: Python<'py>, facts: &SegmentFacts) -> PyResult<Bound<'py, PyDict>> {
    let found = PyDict::new(py);
    found.set_item("length_m", facts.length_m)?;
    found.set_item("time_s", facts.time_s)?;
    found.set_item("cost", facts.cost)?;
    found.set_item("energy_j", facts.energy_j)?;
    found.set_item("risk_s", facts.risk_s)?;
    found.set_item("climb_m", facts.climb_m)?;
    found.set_item("descent_m", facts.descent_m)?;
    found.set_item("grade_max", facts.grade_max)?;
    found.set_item("grade_min", facts.grade_min)?;
    found.set_item("side_slope_max", facts.side_slope_max)?;
    found.set_item("soil_m", facts.soil_m.to_vec())?;
    found.set_item("bridged_m", facts.bridged_m)?;
    Ok(found)
}
