//! The swarm.

use numpy::{Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::grid::{Cell, GridGeometry, Layer};
use swathe::nest::Nests;
use swathe::rank::{CellSource, RankView};
use swathe::swarm::{
    Colony, Ending, Frame, FrameTicks, State, StopRule, SwarmParams, TRANSITIONS, Tally, TileJob, TileResult, Window,
};

use crate::convert::{array, geometry, nest_params, swarm_params, values};
use crate::error::CoreError;
use crate::nest::give;
use crate::progress::PythonReport;
use crate::region::Region;
use crate::stop::stop_params;

/// The tally as a dictionary.
pub(crate) fn tally_dict(py: Python<'_>, tally: Tally) -> PyResult<Bound<'_, PyDict>> {
    let found = PyDict::new(py);
    found.set_item("ticks", tally.ticks)?;
    found.set_item("visits", tally.visits)?;
    found.set_item("cells_evaluated", tally.cells_evaluated)?;
    found.set_item("cores", tally.cores)?;
    found.set_item("connected_at", tally.connected_at)?;
    Ok(found)
}

/// Shows frames to a Python callable and remembers what it raised.
struct Viewer {
    view: Option<Py<PyAny>>,
    raised: Option<PyErr>,
}

impl Viewer {
    /// Shows a frame and returns whether to go on.
    fn show(&mut self, frame: Frame) -> bool {
        let Some(view) = &self.view else { return true };
        let shown = Python::attach(|py| view.call1(py, (frame_dict(py, frame)?,)).map(drop));
        match shown {
            Ok(()) => true,
            Err(error) => {
                self.raised = Some(error);
                false
            }
        }
    }
}

pub(crate) fn frame_dict(py: Python<'_>, frame: Frame) -> PyResult<Bound<'_, PyDict>> {
    fn layer<T: Element>(py: Python<'_>, data: Vec<T>, rows: usize) -> PyResult<Bound<'_, PyArray2<T>>> {
        let columns = data.len() / rows;
        PyArray1::from_vec(py, data).reshape([rows, columns])
    }
    let frame_agents = frame.agents.len();
    let found = tally_dict(py, frame.tally)?;
    found.set_item("step", frame.step)?;
    found.set_item("seen", layer(py, frame.seen, frame.rows)?)?;
    found.set_item("pellets", layer(py, frame.pellets, frame.rows)?)?;
    found.set_item("nests", layer(py, frame.nests, frame.rows)?)?;
    let agents = frame.agents.into_flattened();
    found.set_item("agents", PyArray1::from_vec(py, agents).reshape([frame_agents, 2])?)?;
    Ok(found)
}

/// (chart, from, to, when) of every transition of the swarm's flow charts, and (name, text) of every state.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "two tables of words")]
pub(crate) fn transitions() -> (
    Vec<(&'static str, &'static str, &'static str, &'static str)>,
    Vec<(&'static str, &'static str)>,
) {
    let rows = TRANSITIONS.map(|row| (row.chart.name(), row.from.name(), row.to.name(), row.when));
    let states = State::ALL.map(|state| (state.name(), state.text()));
    (rows.to_vec(), states.to_vec())
}

/// Runs a swarm inside a mask (everywhere without one) for at most `ticks`; returns labels, sizes, how it ended and the tally.
///
/// `stop` holds a rule and budgets. With `on_frame` it is called with a frame every `frame_every` ticks, or at `frame_ticks` when that is 0, in blocks of
/// `frame_step` cells.
#[pyfunction]
#[pyo3(signature = (region, inside, params, ticks, stop, report, on_frame=None, frame_every=0, frame_ticks=vec![], frame_step=1))]
#[allow(clippy::too_many_arguments, reason = "the mirror's keyword arguments")]
pub(crate) fn run_swarm<'py>(
    py: Python<'py>,
    region: &Region,
    inside: Option<PyReadonlyArray2<'py, bool>>,
    params: &Bound<'py, PyDict>,
    ticks: u64,
    stop: &Bound<'py, PyDict>,
    report: Option<Py<PyAny>>,
    on_frame: Option<Py<PyAny>>,
    frame_every: u64,
    frame_ticks: Vec<u64>,
    frame_step: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let params = swarm_params(params)?;
    let (rule, budget, deadline) = stop_params(stop)?;
    let mask = inside.as_ref().map(values).transpose()?.map(<[bool]>::to_vec);
    let mut told = PythonReport::new(report);
    let is_watched = on_frame.is_some();
    let mut viewer = Viewer {
        view: on_frame,
        raised: None,
    };
    let frames = match frame_every {
        0 => FrameTicks::At(frame_ticks),
        every => FrameTicks::Every(every),
    };
    let result = region.with(py, false, |_, ranker, _, _| {
        let mut colony = deploy(ranker, mask, params)?;
        colony.stop_by(rule.unwrap_or(StopRule::Finished), budget)?;
        let mut late = false;
        let mut tell = |done, total| {
            late = deadline.is_over();
            !late && told.tell("regions", done, total)
        };
        let ending = if is_watched {
            colony.run_in_frames(ticks, &frames, frame_step, &mut tell, &mut |frame| viewer.show(frame))
        } else {
            colony.run(ticks, &mut tell)
        };
        let ending = if late { "seconds_spent" } else { word(ending) };
        let quiet = colony.quiet_visits_needed();
        Ok((ending, quiet, colony.tally(), colony.take_nests()?))
    });
    if let Some(error) = viewer.raised {
        return Err(error);
    }
    let (ending, quiet, tally, nests) = told.settle(result)?;
    swarm_dict(py, ending, quiet, tally, nests)
}

/// The same on plain ranks that are known already, without frames.
#[pyfunction]
#[pyo3(signature = (ranks, inside, params, ticks, report))]
pub(crate) fn run_swarm_on_ranks<'py>(
    py: Python<'py>,
    ranks: PyReadonlyArray2<'py, u8>,
    inside: Option<PyReadonlyArray2<'py, bool>>,
    params: &Bound<'py, PyDict>,
    ticks: u64,
    report: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let params = swarm_params(params)?;
    let grid = map(ranks.as_array().dim())?;
    let ranks = values(&ranks)?;
    let mask = inside.as_ref().map(values).transpose()?.map(<[bool]>::to_vec);
    let mut told = PythonReport::new(report);
    let result = py.detach(|| -> Result<_, CoreError> {
        let mut colony = deploy(RankView::new(grid, ranks)?, mask, params)?;
        let ending = colony.run(ticks, &mut |done, total| told.tell("regions", done, total));
        Ok((word(ending), colony.tally(), colony.take_nests()?))
    });
    let (ending, tally, nests) = told.settle(result.map_err(PyErr::from))?;
    swarm_dict(py, ending, None, tally, nests)
}

/// A swarm inside a mask, or everywhere; the mask is not kept.
fn deploy<Source: CellSource>(
    source: Source,
    mask: Option<Vec<bool>>,
    params: SwarmParams,
) -> Result<Colony<Source>, CoreError> {
    let geometry = source.geometry();
    let mask = mask.unwrap_or_else(|| vec![true; geometry.cell_count()]);
    let mask = Layer::new(geometry, mask, "the swathe")?;
    Ok(Colony::deploy(source, &mask, params)?)
}

fn swarm_dict<'py>(
    py: Python<'py>,
    ending: &str,
    quiet_visits: Option<u64>,
    tally: Tally,
    nests: Nests,
) -> PyResult<Bound<'py, PyDict>> {
    let found = tally_dict(py, tally)?;
    let (labels, sizes) = give(py, nests)?;
    found.set_item("labels", labels)?;
    found.set_item("sizes", sizes)?;
    found.set_item("ending", ending)?;
    found.set_item("quiet_visits", quiet_visits)?;
    Ok(found)
}

fn word(ending: Ending) -> &'static str {
    match ending {
        Ending::Finished => "finished",
        Ending::Connected => "connected",
        Ending::Statistical => "statistical",
        Ending::EvaluationsSpent => "evaluations_spent",
        Ending::TicksSpent => "ticks_spent",
        Ending::Stopped => "stopped",
        Ending::Unread(_) => "unread",
    }
}

/// (row, column, rows, columns) of a block of cells.
type Block = (usize, usize, usize, usize);

fn block(window: Window) -> Block {
    (window.row, window.column, window.rows, window.columns)
}

fn window((row, column, rows, columns): Block) -> Window {
    Window {
        row,
        column,
        rows,
        columns,
    }
}

/// A map of this many rows and columns; where it lies does not matter to a swarm.
fn map((rows, columns): (usize, usize)) -> PyResult<GridGeometry> {
    geometry((rows, columns, 1.0, 0.0, 0.0))
}

/// (own cells, cells whose terrain the tile needs, seed) of every tile of a map.
#[pyfunction]
pub(crate) fn tile_jobs(
    map_shape: (usize, usize),
    tile_cells: usize,
    params: &Bound<'_, PyDict>,
) -> PyResult<Vec<(Block, Block, u64)>> {
    let jobs = swathe::swarm::tile_jobs(map(map_shape)?, tile_cells, swarm_params(params)?).map_err(CoreError::from)?;
    let jobs = jobs.iter().map(|job| {
        let terrain = job.terrain_window().map_err(CoreError::from)?;
        Ok((block(job.own), block(terrain), job.params.seed))
    });
    jobs.collect()
}

/// Runs the swarm of a tile on the part of the map that begins at `first`; returns its window, labels, how it ended and the
/// tally.
#[pyfunction]
#[pyo3(signature = (region, first, map_shape, own, params, ticks, threads))]
#[allow(clippy::too_many_arguments, reason = "a job's parts, called from one place")]
pub(crate) fn run_tile<'py>(
    py: Python<'py>,
    region: &Region,
    first: (usize, usize),
    map_shape: (usize, usize),
    own: Block,
    params: &Bound<'py, PyDict>,
    ticks: u64,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let job = TileJob {
        map: map(map_shape)?,
        own: window(own),
        params: swarm_params(params)?,
    };
    let mut told = PythonReport::new(None);
    let result = region.with_threads(py, threads, false, |_, ranker, _, _| {
        let first = Cell::new(first.0, first.1);
        Ok(job.run(ranker, first, ticks, &mut |done, total| {
            told.tell("regions", done, total)
        })?)
    });
    let result = told.settle(result)?;
    let found = tally_dict(py, result.tally)?;
    let part = map((result.window.rows, result.window.columns))?;
    found.set_item("own", block(result.own))?;
    found.set_item("window", block(result.window))?;
    found.set_item("labels", array(py, part, result.labels)?)?;
    found.set_item("ending", word(result.ending))?;
    Ok(found)
}

/// (labels, cells of each nest) of a map from (own cells, window, labels) of its tiles, in any order.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "an array and its counts; what a tile found")]
pub(crate) fn merge_tiles<'py>(
    py: Python<'py>,
    map_shape: (usize, usize),
    params: &Bound<'py, PyDict>,
    tiles: Vec<(Block, Block, PyReadonlyArray2<'py, u32>)>,
) -> PyResult<(Bound<'py, PyArray2<u32>>, Vec<u32>)> {
    let (map, params) = (map(map_shape)?, nest_params(params)?);
    let results = tiles.iter().map(|(own, around, labels)| {
        Ok(TileResult {
            own: window(*own),
            window: window(*around),
            labels: values(labels)?.to_vec(),
            ending: Ending::Finished,
            tally: Tally::default(),
        })
    });
    let results = results.collect::<PyResult<Vec<TileResult>>>()?;
    let nests = py.detach(|| swathe::swarm::merge_tiles(map, &params, &results));
    give(py, nests.map_err(CoreError::from)?)
}
