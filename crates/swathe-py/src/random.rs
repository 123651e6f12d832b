//! Drawn numbers.

use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use swathe::random::{philox, unit};

/// Numbers from 0 to below 1: draw `index` of a stream under a seed is the same whatever else is drawn.
#[pyfunction]
pub(crate) fn uniform(py: Python<'_>, seed: u64, stream: u32, count: u32) -> Bound<'_, PyArray1<f64>> {
    let draws: Vec<f64> = (0..count)
        .map(|index| unit(philox([stream, index, 0, 0], seed)[0]))
        .collect();
    draws.into_pyarray(py)
}
