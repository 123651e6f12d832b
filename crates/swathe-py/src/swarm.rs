//! The swarm.

use numpy::{Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::grid::Layer;
use swathe::swarm::{Colony, Ending, Frame, FrameTicks, State, TRANSITIONS, Tally};

use crate::convert::{swarm_params, values};
use crate::nest::give;
use crate::progress::PythonReport;
use crate::region::Region;

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

fn frame_dict(py: Python<'_>, frame: Frame) -> PyResult<Bound<'_, PyDict>> {
    fn layer<T: Element>(py: Python<'_>, data: Vec<T>, rows: usize) -> PyResult<Bound<'_, PyArray2<T>>> {
        let columns = data.len() / rows;
        PyArray1::from_vec(py, data).reshape([rows, columns])
    }
    let found = tally_dict(py, frame.tally)?;
    found.set_item("step", frame.step)?;
    found.set_item("seen", layer(py, frame.seen, frame.rows)?)?;
    found.set_item("pellets", layer(py, frame.pellets, frame.rows)?)?;
    found.set_item("nests", layer(py, frame.nests, frame.rows)?)?;
    let agents = frame.agents.len();
    found.set_item("agents", layer(py, frame.agents.into_flattened(), agents)?)?;
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
/// With `on_frame` it is called with a frame every `frame_every` ticks, or at `frame_ticks` when that is 0, in blocks of
/// `frame_step` cells.
#[pyfunction]
#[pyo3(signature = (region, inside, params, ticks, report, on_frame=None, frame_every=0, frame_ticks=vec![], frame_step=1))]
#[allow(clippy::too_many_arguments, reason = "the mirror's keyword arguments")]
pub(crate) fn run_swarm<'py>(
    py: Python<'py>,
    region: &Region,
    inside: Option<PyReadonlyArray2<'py, bool>>,
    params: &Bound<'py, PyDict>,
    ticks: u64,
    report: Option<Py<PyAny>>,
    on_frame: Option<Py<PyAny>>,
    frame_every: u64,
    frame_ticks: Vec<u64>,
    frame_step: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let params = swarm_params(params)?;
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
    let result = region.with(py, false, |terrain, ranker, _, _| {
        let geometry = terrain.elevation_m.geometry();
        let mask = mask.unwrap_or_else(|| vec![true; geometry.cell_count()]);
        let mask = Layer::new(geometry, mask, "the swathe")?;
        let mut colony = Colony::deploy(ranker, &mask, params)?;
        let mut tell = |done, total| told.tell("regions", done, total);
        let ending = if is_watched {
            colony.run_in_frames(ticks, &frames, frame_step, &mut tell, &mut |frame| viewer.show(frame))
        } else {
            colony.run(ticks, &mut tell)
        };
        Ok((ending, colony.tally(), colony.take_nests()?))
    });
    if let Some(error) = viewer.raised {
        return Err(error);
    }
    let (ending, tally, nests) = told.settle(result)?;
    let found = tally_dict(py, tally)?;
    let (labels, sizes) = give(py, nests)?;
    found.set_item("labels", labels)?;
    found.set_item("sizes", sizes)?;
    found.set_item(
        "ending",
        match ending {
            Ending::Finished => "finished",
            Ending::TicksSpent => "ticks_spent",
            Ending::Stopped => "stopped",
        },
    )?;
    Ok(found)
}
