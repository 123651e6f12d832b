//! The swarm.

use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::grid::Layer;
use swathe::swarm::{Colony, Ending, Tally};

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

/// Runs a swarm inside a mask (everywhere without one) for at most `ticks`; returns labels, sizes, how it ended and the tally.
#[pyfunction]
#[pyo3(signature = (region, inside, params, ticks, report))]
pub(crate) fn run_swarm<'py>(
    py: Python<'py>,
    region: &Region,
    inside: Option<PyReadonlyArray2<'py, bool>>,
    params: &Bound<'py, PyDict>,
    ticks: u64,
    report: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let params = swarm_params(params)?;
    let mask = inside.as_ref().map(values).transpose()?.map(<[bool]>::to_vec);
    let mut told = PythonReport::new(report);
    let result = region.with(py, false, |terrain, ranker, _, _| {
        let geometry = terrain.elevation_m.geometry();
        let mask = mask.unwrap_or_else(|| vec![true; geometry.cell_count()]);
        let mask = Layer::new(geometry, mask, "the swathe")?;
        let mut colony = Colony::deploy(ranker, &mask, params)?;
        let ending = colony.run(ticks, &mut |done, total| told.tell("regions", done, total));
        Ok((ending, colony.tally(), colony.take_nests()?))
    });
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
