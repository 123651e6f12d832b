//! The planner.

use numpy::{Element, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use swathe::grid::{Cell, LayerView, Position};
use swathe::planner::{
    Algorithm, CellCost, Corners, LazyRequest, Leg, Plan, PlanRequest, PlannerError, Search, SegmentFacts, Stage,
    Status,
};

use crate::convert::{arc_kind, array, entry, geometry, method, nest_params, position, swarm_params, values, word};
use crate::error::CoreError;
use crate::nest::give;
use crate::progress::PythonReport;
use crate::region::Region;
use crate::swarm::tally_dict;

type Places = Option<(Vec<(usize, usize)>, f64)>;

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

/// Lazy A* through nests: a dictionary of `cells` and `cost` (None without a way), `cells_evaluated`, `cells_expanded`.
#[pyfunction]
#[pyo3(signature = (region, start, goal, nest, weight, report))]
pub(crate) fn lazy_astar<'py>(
    py: Python<'py>,
    region: &Region,
    start: (usize, usize),
    goal: (usize, usize),
    nest: &Bound<'py, PyDict>,
    weight: f64,
    report: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let [start, goal] = [start, goal].map(|(row, column)| Cell::new(row, column));
    let nest = nest_params(nest)?;
    let request = LazyRequest {
        start,
        goal,
        nest,
        weight,
    };
    let mut told = PythonReport::new(report);
    let result = region.with(py, false, |terrain, ranker, vehicle, params| {
        let mut tell = |done, total| told.tell("route", done, total);
        let moisture = params.moisture_percent;
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
#[pyo3(signature = (region, request, map_continues, report))]
pub(crate) fn plan<'py>(
    py: Python<'py>,
    region: &Region,
    request: &Bound<'py, PyDict>,
    map_continues: bool,
    report: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let request = PlanRequest {
        start: position(entry(request, "start")?),
        goal: position(entry(request, "goal")?),
        method: method(&entry::<String>(request, "method")?)?,
        swarm: swarm_params(request)?,
        arc: arc_kind(&entry::<String>(request, "arc")?, entry(request, "sagitta_m")?)?,
        width_m: entry(request, "width_m")?,
        bridge: entry(request, "bridge")?,
        certify: entry(request, "certify")?,
    };
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
        let plan = swathe::planner::plan(terrain, ranker, vehicle, params, &request, &mut tell)?;
        Ok(plan)
    });
    answer(py, told.settle(result)?)
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
    let path: Vec<(usize, usize)> = plan.path.iter().map(|cell| (cell.row, cell.column)).collect();
    found.set_item("path", path)?;
    found.set_item("path_cost", plan.path_cost)?;
    found.set_item("cost_lower_bound", plan.cost_lower_bound)?;
    found.set_item("optimal", plan.optimal)?;
    found.set_item("start", plan.start.map(|(p, away_m)| (place(p), away_m)))?;
    found.set_item("goal", plan.goal.map(|(p, away_m)| (place(p), away_m)))?;
    found.set_item("cells_evaluated", plan.cells_evaluated)?;
    if let Some(nests) = plan.nests {
        let (labels, sizes) = give(py, nests)?;
        found.set_item("labels", labels)?;
        found.set_item("sizes", sizes)?;
    }
    if let Some(swarm) = plan.swarm {
        found.set_item("swarm", tally_dict(py, swarm.tally)?)?;
        found.set_item("widened", swarm.widened)?;
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

fn facts<'py>(py: Python<'py>, facts: &SegmentFacts) -> PyResult<Bound<'py, PyDict>> {
    let found = PyDict::new(py);
    found.set_item("length_m", facts.length_m)?;
    found.set_item("time_s", facts.time_s)?;
    found.set_item("cost", facts.cost)?;
    found.set_item("energy_j", facts.energy_j)?;
    found.set_item("climb_m", facts.climb_m)?;
    found.set_item("descent_m", facts.descent_m)?;
    found.set_item("grade_max", facts.grade_max)?;
    found.set_item("grade_min", facts.grade_min)?;
    found.set_item("side_slope_max", facts.side_slope_max)?;
    found.set_item("soil_m", facts.soil_m.to_vec())?;
    found.set_item("bridged_m", facts.bridged_m)?;
    Ok(found)
}
