//! Ranks.

use numpy::{PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use swathe::grid::Cell;
use swathe::rank::{CellSource, Reason};

use crate::convert::{bands, rounding, values_mut};
use crate::error::{CoreError, invalid};
use crate::region::Region;

/// Rank (low four bits) and reason code (high four bits) of every cell, in an array of the caller's when one is given.
#[pyfunction]
#[pyo3(signature = (region, out=None))]
pub(crate) fn rank_map<'py>(
    py: Python<'py>,
    region: &Region,
    out: Option<Bound<'py, PyArray2<u8>>>,
) -> PyResult<Bound<'py, PyArray2<u8>>> {
    let geometry = region.geometry();
    // Numpy's own allocation comes in large pages where the system has them.
    let ranks = out.unwrap_or_else(|| PyArray2::zeros(py, [geometry.rows(), geometry.columns()], false));
    let mut written = ranks.try_readwrite().map_err(|error| {
        let fix = "Give an array that may be written and that no layer of the region shares.";
        invalid(format!("The ranks cannot be written: {error}."), fix)
    })?;
    let bytes = values_mut(&mut written)?;
    region.with(py, false, |_, ranker, _, _| Ok(ranker.rank_bytes(bytes)?))?;
    drop(written);
    Ok(ranks)
}

/// (rank, reason code) of one cell, evaluated alone.
#[pyfunction]
pub(crate) fn rank_cell(py: Python<'_>, region: &Region, row: i64, column: i64) -> PyResult<(u8, u8)> {
    let geometry = region.geometry();
    let Some(Cell { row, column }) = geometry.checked(row, column) else {
        let (rows, columns) = (geometry.rows(), geometry.columns());
        let error = swathe::grid::GridError::OutsideGrid {
            row,
            column,
            rows,
            columns,
        };
        return Err(CoreError::from(error).into());
    };
    region.with(py, false, |_, ranker, _, _| {
        let found = ranker.cell_rank(Cell::new(row, column));
        Ok((found.rank(), found.reason() as u8))
    })
}

/// Names of the reason codes in order.
#[pyfunction]
pub(crate) fn reasons() -> Vec<&'static str> {
    Reason::ALL.map(Reason::name).to_vec()
}

/// Table I for one difference of grey levels.
#[pyfunction]
pub(crate) fn height_goodness(difference: f64, bands_name: &str, rounding_name: &str) -> PyResult<u8> {
    Ok(swathe::rank::height_goodness(
        difference,
        bands(bands_name)?,
        rounding(rounding_name)?,
    ))
}

/// (weights, principal eigenvalue, consistency ratio) of a comparison matrix.
#[pyfunction]
pub(crate) fn ahp(matrix: Vec<Vec<f64>>, force: bool) -> PyResult<(Vec<f64>, f64, f64)> {
    let found = swathe::rank::ahp(&matrix, force).map_err(CoreError::from)?;
    Ok((found.weights, found.lambda_max, found.consistency_ratio))
}
