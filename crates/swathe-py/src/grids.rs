//! Overlapping grids.

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::grid::{GridError, LayerView};
use swathe::nest::{Footprint, GapShape, GridMode, GridsParams, NestError, Phase, RankCodes, SizeReading};

use crate::convert::{Shape, array, entry, geometry, position, values, word};
use crate::error::{CoreError, invalid};
use crate::nest::give;

const MODES: [(&str, GridMode); 4] = [
    ("or", GridMode::Or),
    ("and", GridMode::And),
    ("single", GridMode::Single),
    ("exact16", GridMode::Exact16),
];

const GAP_SHAPES: [(&str, GapShape); 2] = [("corridor", GapShape::Corridor), ("pocket", GapShape::Pocket)];

fn phases(given: Vec<(f64, f64)>) -> Vec<Phase> {
    given.into_iter().map(|(east, south)| Phase::new(east, south)).collect()
}

pub(crate) fn params(dict: &Bound<PyDict>) -> PyResult<GridsParams> {
    let usual = GridsParams::new(entry(dict, "size_m")?);
    let reading = word(
        "reading of the size",
        &entry::<String>(dict, "reading")?,
        &[("side", SizeReading::Side), ("area", SizeReading::Area)],
    )?;
    let given: Option<Vec<(f64, f64)>> = entry(dict, "phases")?;
    Ok(GridsParams {
        reading,
        mode: word("mode", &entry::<String>(dict, "mode")?, &MODES)?,
        phases: given.map_or(usual.phases, phases),
        window_cells: entry::<Option<usize>>(dict, "window_cells")?.unwrap_or(usual.window_cells),
        rank_min: entry(dict, "rank_min")?,
        ..usual
    })
}

/// The grids, and the geometry of the terrain they are made from.
#[pyclass(module = "swathe._core")]
pub(crate) struct OverlappingGrids {
    inner: swathe::nest::OverlappingGrids,
    shape: Shape,
}

#[pymethods]
impl OverlappingGrids {
    #[new]
    fn new(
        py: Python<'_>,
        rank: PyReadonlyArray2<'_, u8>,
        shape: Shape,
        at: (f64, f64),
        dict: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
        let params = params(dict)?;
        let evidence = RankCodes(LayerView::new(geometry(shape)?, values(&rank)?, "the rank map").map_err(core)?);
        let grids = py.detach(|| swathe::nest::OverlappingGrids::new(params, position(at), &evidence));
        let inner = grids.map_err(CoreError::from)?;
        Ok(Self { inner, shape })
    }

    /// Moves the window; returns how many terrain cells were evaluated.
    fn recentre(&mut self, py: Python<'_>, rank: PyReadonlyArray2<'_, u8>, at: (f64, f64)) -> PyResult<u64> {
        let terrain = geometry(self.shape)?;
        let evidence = RankCodes(LayerView::new(terrain, values(&rank)?, "the rank map").map_err(core)?);
        let inner = &mut self.inner;
        let evaluated = py.detach(|| inner.recentre(position(at), &evidence));
        Ok(evaluated.map_err(CoreError::from)?)
    }

    /// Evaluates cells over changed terrain cells (row, column, rows, columns) again; returns how many were evaluated.
    fn refresh(
        &mut self,
        py: Python<'_>,
        rank: PyReadonlyArray2<'_, u8>,
        window: (usize, usize, usize, usize),
    ) -> PyResult<u64> {
        let (row, column, rows, columns) = window;
        let terrain = geometry(self.shape)?;
        let evidence = RankCodes(LayerView::new(terrain, values(&rank)?, "the rank map").map_err(core)?);
        let inner = &mut self.inner;
        let (rows, columns) = (row..row.saturating_add(rows), column..column.saturating_add(columns));
        let evaluated = py.detach(|| inner.refresh(rows, columns, &evidence));
        Ok(evaluated.map_err(CoreError::from)?)
    }

    /// (combined, each grid, one grid alone) of a disc (radius) or a rectangle (length, width) at a pose.
    #[pyo3(signature = (at, heading_rad, radius_m, rectangle_m))]
    fn navigable(
        &self,
        at: (f64, f64),
        heading_rad: f64,
        radius_m: Option<f64>,
        rectangle_m: Option<(f64, f64)>,
    ) -> PyResult<(bool, Vec<bool>, bool)> {
        let footprint = match (radius_m, rectangle_m) {
            (Some(radius_m), None) => Footprint::circle(radius_m),
            (None, Some((length_m, width_m))) => Footprint::rectangle(length_m, width_m),
            _ => {
                return Err(invalid(
                    "A footprint is a disc or a rectangle.".to_owned(),
                    "Give one of them.",
                ));
            }
        };
        let footprint = footprint.map_err(CoreError::from)?;
        let answer = self.inner.navigable(position(at), heading_rad, &footprint);
        let grids = (0..answer.grids()).map(|grid| answer.in_grid(grid)).collect();
        Ok((answer.navigable(), grids, answer.disagreement()))
    }

    /// Shares of a cell by which each grid lies east and south of the first.
    fn phases(&self) -> Vec<(f64, f64)> {
        self.inner
            .phases()
            .iter()
            .map(|phase| (phase.east, phase.south))
            .collect()
    }

    /// Geometry of a grid's cells in the window.
    fn geometry(&self, grid: usize) -> PyResult<Shape> {
        let found = self.inner.geometry(grid).ok_or_else(no_such_grid)?;
        let (rows, columns) = (found.rows(), found.columns());
        Ok((rows, columns, found.cell_size_m(), found.west_m(), found.north_m()))
    }

    /// Ranks of a grid's cells in the window.
    fn ranks<'py>(&self, py: Python<'py>, grid: usize) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let geometry = self.inner.geometry(grid).ok_or_else(no_such_grid)?;
        let ranks = self.inner.ranks(grid).ok_or_else(no_such_grid)?;
        array(py, geometry, ranks.to_vec())
    }

    /// (labels, cells of each nest) of a grid's nests in the window.
    #[allow(clippy::type_complexity, reason = "an array and its counts")]
    fn nests<'py>(&self, py: Python<'py>, grid: usize) -> PyResult<(Bound<'py, PyArray2<u32>>, Vec<u32>)> {
        give(py, self.inner.nests(grid).ok_or_else(no_such_grid)?)
    }

    /// Labels of every grid's cells, counted through all grids together.
    fn joined_nests<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<u32>>>> {
        let joined = py.detach(|| self.inner.joined_nests());
        let labels = joined
            .into_iter()
            .map(|labels| array(py, labels.geometry(), labels.into_data()));
        labels.collect()
    }
}

fn core(error: GridError) -> CoreError {
    error.into()
}

fn no_such_grid() -> PyErr {
    invalid("There is no grid of this number.".to_owned(), "Grids count from 0.")
}

/// How many of `trials` gaps of a side are found on drawn ground.
#[pyfunction]
pub(crate) fn gaps_found(
    py: Python<'_>,
    shape: &str,
    side_in_cells: f64,
    mode: &str,
    phases: Vec<(f64, f64)>,
    trials: u32,
    seed: u64,
) -> PyResult<u32> {
    let (shape, mode) = (word("shape of a gap", shape, &GAP_SHAPES)?, word("mode", mode, &MODES)?);
    let phases = self::phases(phases);
    let found = py.detach(|| swathe::nest::gaps_found(shape, side_in_cells, mode, &phases, trials, seed));
    Ok(found.map_err(CoreError::from)?)
}

/// The share of all places of a gap at which it is found.
#[pyfunction]
pub(crate) fn gap_share(shape: &str, side_in_cells: f64, mode: &str, phases: Vec<(f64, f64)>) -> PyResult<f64> {
    let (shape, mode) = (word("shape of a gap", shape, &GAP_SHAPES)?, word("mode", mode, &MODES)?);
    let share: Result<f64, NestError> = swathe::nest::gap_share(shape, side_in_cells, mode, &self::phases(phases));
    Ok(share.map_err(CoreError::from)?)
}
