//! The shape of the ground.

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use swathe::grid::{EIGHT, GridGeometry, Layer, LayerView};
use swathe::terrain::{Grouping, TerrainError};

use crate::convert::{array, geometry, values};
use crate::error::{CoreError, invalid};

type Heights<'py> = PyReadonlyArray2<'py, f32>;
type Result2<'py, T> = PyResult<Bound<'py, PyArray2<T>>>;

/// Runs `work` on an array without the interpreter and returns an array of the result's shape.
fn map<'py, T: numpy::Element + Send>(
    py: Python<'py>,
    heights: &Heights<'py>,
    cell_size_m: f64,
    work: impl FnOnce(LayerView<f32>) -> Result<Layer<T>, TerrainError> + Send,
) -> Result2<'py, T> {
    let (rows, columns) = heights.as_array().dim();
    let grid: GridGeometry = geometry((rows, columns, cell_size_m, 0.0, 0.0))?;
    let data = values(heights)?;
    let layer = py
        .detach(|| work(LayerView::new(grid, data, "the elevation")?))
        .map_err(CoreError::from)?;
    let grid = layer.geometry();
    array(py, grid, layer.into_data())
}

/// Squared distances in cells to the nearest marked cell; the greatest number where none is marked.
#[pyfunction]
pub(crate) fn squared_distances<'py>(py: Python<'py>, marks: PyReadonlyArray2<'py, bool>) -> Result2<'py, u64> {
    let (rows, columns) = marks.as_array().dim();
    let grid = geometry((rows, columns, 1.0, 0.0, 0.0))?;
    let data = values(&marks)?;
    let layer = py.detach(|| swathe::grid::squared_distances(grid, |index| data[index]));
    array(py, grid, layer.into_data())
}

/// Horn's slope, rise over run.
#[pyfunction]
pub(crate) fn slope<'py>(py: Python<'py>, elevation_m: Heights<'py>, cell_size_m: f64) -> Result2<'py, f32> {
    map(py, &elevation_m, cell_size_m, swathe::terrain::slope)
}

/// Downhill direction, counter-clockwise from east.
#[pyfunction]
pub(crate) fn aspect_rad<'py>(py: Python<'py>, elevation_m: Heights<'py>, cell_size_m: f64) -> Result2<'py, f32> {
    map(py, &elevation_m, cell_size_m, swathe::terrain::aspect_rad)
}

/// Deviation from the plane of the 3 x 3 cells.
#[pyfunction]
pub(crate) fn roughness_m<'py>(py: Python<'py>, elevation_m: Heights<'py>, cell_size_m: f64) -> Result2<'py, f32> {
    map(py, &elevation_m, cell_size_m, |layer| {
        let grid = layer.geometry();
        let rough = |cell| swathe::terrain::roughness_at(layer, cell);
        let data = grid
            .cells()
            .map(|cell| rough(cell).map_or(f32::NAN, |r| r.deviation_m as f32));
        Ok(Layer::new(grid, data.collect(), "the roughness")?)
    })
}

/// Grey levels 0 to 255 as floats, NaN where unknown.
#[pyfunction]
pub(crate) fn height_map<'py>(
    py: Python<'py>,
    elevation_m: Heights<'py>,
    height_range_m: Option<(f64, f64)>,
) -> Result2<'py, f32> {
    map(py, &elevation_m, 1.0, |layer| {
        let grey = swathe::terrain::height_map(layer, height_range_m)?;
        let grid = grey.geometry();
        let levels = grey.into_data().into_iter();
        let data = levels.map(|level| level.map_or(f32::NAN, f32::from)).collect();
        Ok(Layer::new(grid, data, "the height map")?)
    })
}

fn grouping(name: &str) -> PyResult<Grouping> {
    match name {
        "8x8" => Ok(Grouping::Square8),
        "2x4" => Ok(Grouping::Rows2Columns4),
        "none" => Ok(Grouping::None),
        other => Err(invalid(
            format!("The grouping {other:?} is not known; known are 8x8, 2x4, none."),
            "Choose one of them.",
        )),
    }
}

/// Means of groups of cells.
#[pyfunction]
pub(crate) fn group_mean<'py>(py: Python<'py>, layer: Heights<'py>, group: &str) -> Result2<'py, f32> {
    let group = grouping(group)?;
    map(py, &layer, 1.0, |layer| swathe::terrain::group_mean(layer, group))
}

/// Greatest values of groups of cells.
#[pyfunction]
pub(crate) fn block_max<'py>(py: Python<'py>, layer: Heights<'py>, group: &str) -> Result2<'py, f32> {
    let group = grouping(group)?;
    map(py, &layer, 1.0, |layer| swathe::terrain::block_max(layer, group))
}

/// Differences to the neighbour in direction 0 (east) to 7, counter-clockwise.
#[pyfunction]
pub(crate) fn directional_difference<'py>(py: Python<'py>, layer: Heights<'py>, direction: usize) -> Result2<'py, f32> {
    let step = EIGHT[direction % 8];
    map(py, &layer, 1.0, |layer| {
        Ok(swathe::terrain::directional_difference(layer, step))
    })
}
