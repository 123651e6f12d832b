//! Nests.

use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::grid::Position;
use swathe::nest::Nests;
use swathe::rank::RankView;

use crate::convert::{Shape, array, geometry, nest_params, values, values_mut};
use crate::error::CoreError;

/// (labels, cells of each nest) of a rank map, in one linear pass.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "an array and its counts")]
pub(crate) fn exact_nests<'py>(
    py: Python<'py>,
    rank: PyReadonlyArray2<'py, u8>,
    params: &Bound<'py, PyDict>,
) -> PyResult<(Bound<'py, PyArray2<u32>>, Vec<u32>)> {
    let (rows, columns) = rank.as_array().dim();
    let (grid, params) = (geometry((rows, columns, 1.0, 0.0, 0.0))?, nest_params(params)?);
    let data = values(&rank)?;
    // Numpy's own allocation comes in large pages where the system has them.
    let labels = PyArray2::zeros(py, [rows, columns], false);
    let mut written = labels.readwrite();
    let target = values_mut(&mut written)?;
    let sizes = py.detach(|| -> Result<Vec<u32>, CoreError> {
        let ranks = RankView::new(grid, data)?;
        Ok(swathe::nest::label_nests(ranks, &params, target)?)
    })?;
    Ok((labels, sizes))
}

/// Labels and sizes for Python.
#[allow(clippy::type_complexity, reason = "an array and its counts")]
pub(crate) fn give(py: Python<'_>, nests: Nests) -> PyResult<(Bound<'_, PyArray2<u32>>, Vec<u32>)> {
    let (geometry, sizes) = (nests.geometry(), nests.sizes().to_vec());
    Ok((array(py, geometry, nests.into_labels().into_data())?, sizes))
}

fn take(labels: &PyReadonlyArray2<u32>, shape: Shape) -> PyResult<Nests> {
    let labels = values(labels)?.to_vec();
    Ok(Nests::from_labels(geometry(shape)?, labels).map_err(CoreError::from)?)
}

type Ring = Vec<(f64, f64)>;

/// (nest, exterior ring, holes) of every nest of at least `least_cells`, in map metres.
#[pyfunction]
pub(crate) fn outlines(
    py: Python<'_>,
    labels: PyReadonlyArray2<'_, u32>,
    shape: Shape,
    least_cells: u32,
) -> PyResult<Vec<(u32, Ring, Vec<Ring>)>> {
    let nests = take(&labels, shape)?;
    let found = py.detach(|| swathe::nest::outlines(&nests, |nest| nests.sizes()[nest as usize - 1] >= least_cells));
    let ring = |ring: Vec<Position>| ring.into_iter().map(|p| (p.x_m, p.y_m)).collect();
    Ok(found
        .into_iter()
        .map(|outline| {
            let holes = outline.holes.into_iter().map(ring).collect();
            (outline.nest, ring(outline.exterior), holes)
        })
        .collect())
}

type Gap = (u32, u32, (usize, usize), (usize, usize), f64);

/// (nest, nest, cell, cell, metres) of the gaps between neighbouring nests.
#[pyfunction]
pub(crate) fn nest_graph(py: Python<'_>, labels: PyReadonlyArray2<'_, u32>, shape: Shape) -> PyResult<Vec<Gap>> {
    let nests = take(&labels, shape)?;
    let gaps = py.detach(|| swathe::nest::nest_graph(&nests));
    Ok(gaps
        .into_iter()
        .map(|gap| {
            let cell = |cell: swathe::grid::Cell| (cell.row, cell.column);
            (gap.from_nest, gap.to_nest, cell(gap.from), cell(gap.to), gap.distance_m)
        })
        .collect())
}
