//! A region: the layers that are ranked and planned on, kept together.

use std::sync::{Mutex, PoisonError};

use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::drive::KnownMap;
use swathe::grid::{GridError, GridGeometry, Layer, LayerView, TileCells, TileGrid, Tiles};
use swathe::nest::NestParams;
use swathe::planner::Terrain;
use swathe::rank::{RankParams, Ranker, SourceFault, TiledHeights};

use crate::convert::{Shape, geometry, rank_params, values};
use crate::error::{CoreError, invalid};
use crate::vehicle::Vehicle;

/// Elevation with optional soil, grey levels and zones on one geometry, with the vehicle and the rules that rank them.
#[pyclass(frozen, module = "swathe._core")]
pub(crate) struct Region {
    geometry: GridGeometry,
    heights: Heights,
    soil: Option<Py<PyArray2<u8>>>,
    grey: Option<Py<PyArray2<f32>>>,
    zones: Option<Py<PyArray2<bool>>>,
    vehicle: Py<Vehicle>,
    params: RankParams,
}

/// Heights that are all there, or in tiles that `read(row, column, rows, columns)` brings when they are needed.
enum Heights {
    Whole(Py<PyArray2<f32>>),
    Tiled { tiles: Tiles<f32>, read: Py<PyAny> },
}

#[pymethods]
impl Region {
    #[new]
    #[pyo3(signature = (shape, elevation_m, soil, grey, zones, vehicle, params))]
    #[allow(clippy::too_many_arguments, reason = "one constructor, called from one place")]
    fn new(
        shape: Shape,
        elevation_m: Bound<'_, PyArray2<f32>>,
        soil: Option<Bound<'_, PyArray2<u8>>>,
        grey: Option<Bound<'_, PyArray2<f32>>>,
        zones: Option<Bound<'_, PyArray2<bool>>>,
        vehicle: Py<Vehicle>,
        params: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
        let geometry = geometry(shape)?;
        let expected = geometry.cell_count();
        let layers = [
            ("the elevation", Some(elevation_m.len())),
            ("the soil layer", soil.as_ref().map(PyUntypedArrayMethods::len)),
            ("the height map", grey.as_ref().map(PyUntypedArrayMethods::len)),
            ("the zones", zones.as_ref().map(PyUntypedArrayMethods::len)),
        ];
        for (what, found) in layers {
            if let Some(found) = found.filter(|&found| found != expected) {
                let error = GridError::ShapeMismatch { what, expected, found };
                return Err(CoreError::from(error).into());
            }
        }
        Ok(Self {
            geometry,
            heights: Heights::Whole(elevation_m.unbind()),
            soil: soil.map(Bound::unbind),
            grey: grey.map(Bound::unbind),
            zones: zones.map(Bound::unbind),
            vehicle,
            params: rank_params(params)?,
        })
    }

    /// A region whose heights `read(row, column, rows, columns)` brings when they are first needed, in tiles of `tile_side`
    /// cells; the north-western cell is the one at `first` of its tile. None instead of heights says that they cannot be read.
    #[staticmethod]
    #[pyo3(signature = (shape, tile_side, first, read, soil, vehicle, params))]
    fn tiled(
        shape: Shape,
        tile_side: usize,
        first: (usize, usize),
        read: Py<PyAny>,
        soil: Option<Bound<'_, PyArray2<u8>>>,
        vehicle: Py<Vehicle>,
        params: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
        let geometry = geometry(shape)?;
        let (expected, found) = (geometry.cell_count(), soil.as_ref().map(PyUntypedArrayMethods::len));
        if let Some(found) = found.filter(|&found| found != expected) {
            let what = "the soil layer";
            return Err(CoreError::from(GridError::ShapeMismatch { what, expected, found }).into());
        }
        let grid = TileGrid::new(geometry, tile_side, first).map_err(CoreError::from)?;
        let tiles = Tiles::new(grid, f32::NAN);
        Ok(Self {
            geometry,
            heights: Heights::Tiled { tiles, read },
            soil: soil.map(Bound::unbind),
            grey: None,
            zones: None,
            vehicle,
            params: rank_params(params)?,
        })
    }
}

/// The heights of a tile from Python, on the thread that called the core. What Python raises stops the work.
fn read_tile(read: &Py<PyAny>, cells: TileCells, raised: &Mutex<Option<PyErr>>) -> Result<Vec<f32>, SourceFault> {
    let TileCells {
        row,
        column,
        rows,
        columns,
    } = cells;
    let heights = Python::attach(|py| {
        let found = read.bind(py).call1((row, column, rows, columns))?;
        let heights: Option<PyReadonlyArray2<f32>> = found.extract()?;
        heights.map(|heights| Ok(values(&heights)?.to_vec())).transpose()
    });
    match heights {
        Ok(Some(heights)) => Ok(heights),
        Ok(None) => Err(SourceFault::Unreadable { row, column }),
        Err(error) => {
            *raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            Err(SourceFault::Stopped)
        }
    }
}

impl Region {
    /// A copy of the layers with vehicle and rules, for a drive that changes what it knows.
    pub(crate) fn known_map(&self, py: Python<'_>, nest: NestParams, explains_returns: bool) -> PyResult<KnownMap> {
        let Heights::Whole(heights) = &self.heights else {
            return Err(invalid(
                "A region that is read when it is needed cannot be driven on.".to_owned(),
                "Read it first.",
            ));
        };
        let elevation_m = layer(py, self.geometry, heights, "the elevation")?;
        let soil = self
            .soil
            .as_ref()
            .map(|soil| layer(py, self.geometry, soil, "the soil layer"));
        let grey = self
            .grey
            .as_ref()
            .map(|grey| layer(py, self.geometry, grey, "the height map"));
        let zones = self
            .zones
            .as_ref()
            .map(|zones| layer(py, self.geometry, zones, "the zones"));
        Ok(KnownMap {
            elevation_m,
            soil: soil.transpose()?,
            grey: grey.transpose()?,
            zones: zones.transpose()?,
            vehicle: self.vehicle.get().inner.clone(),
            rank: self.params,
            nest,
            explains_returns,
        })
    }

    pub(crate) fn geometry(&self) -> GridGeometry {
        self.geometry
    }

    /// Calls `work` with the terrain and its ranker, without the interpreter.
    pub(crate) fn with<T: Send>(
        &self,
        py: Python<'_>,
        map_continues: bool,
        work: impl FnOnce(Terrain, &Ranker, &swathe::vehicle::Vehicle, &RankParams) -> Result<T, CoreError> + Send,
    ) -> PyResult<T> {
        self.with_threads(py, None, map_continues, work)
    }

    /// The same on that many threads of its own: a worker process that was forked has none of its parent's.
    pub(crate) fn with_threads<T: Send>(
        &self,
        py: Python<'_>,
        threads: Option<usize>,
        map_continues: bool,
        work: impl FnOnce(Terrain, &Ranker, &swathe::vehicle::Vehicle, &RankParams) -> Result<T, CoreError> + Send,
    ) -> PyResult<T> {
        let read = |array: &Py<PyArray2<f32>>| array.bind(py).readonly();
        let elevation_m = match &self.heights {
            Heights::Whole(heights) => Some(read(heights)),
            Heights::Tiled { .. } => None,
        };
        let grey = self.grey.as_ref().map(read);
        let soil = self.soil.as_ref().map(|soil| soil.bind(py).readonly());
        let zones = self.zones.as_ref().map(|zones| zones.bind(py).readonly());
        let elevation_m = elevation_m.as_ref().map(values).transpose()?;
        let raised = Mutex::new(None);
        let tiled = match &self.heights {
            Heights::Whole(_) => None,
            Heights::Tiled { tiles, read } => Some(TiledHeights::new(tiles, |cells| read_tile(read, cells, &raised))),
        };
        let tiled = tiled.as_ref();
        let grey = grey.as_ref().map(values).transpose()?;
        let soil = soil.as_ref().map(values).transpose()?;
        let zones = zones.as_ref().map(values).transpose()?;
        let (geometry, params, vehicle) = (self.geometry, self.params, &self.vehicle.get().inner);
        let all = move || {
            let elevation_m = match tiled {
                Some(tiled) => tiled.elevation_m(),
                None => LayerView::new(geometry, elevation_m.unwrap_or_default(), "the elevation")?,
            };
            let soil = soil
                .map(|soil| LayerView::new(geometry, soil, "the soil layer"))
                .transpose()?;
            let grey = grey
                .map(|grey| LayerView::new(geometry, grey, "the height map"))
                .transpose()?;
            let zones = zones
                .map(|zones| LayerView::new(geometry, zones, "the zones"))
                .transpose()?;
            let mut ranker = Ranker::new(elevation_m, soil, grey, zones, vehicle, params)?;
            if let Some(tiled) = tiled {
                ranker = ranker.reading(tiled);
            }
            let terrain = Terrain {
                elevation_m,
                soil,
                cost_factor: None,
                map_continues,
            };
            work(terrain, &ranker, vehicle, &params)
        };
        let pool = threads.and_then(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok());
        let result = py.detach(move || match pool {
            Some(pool) => pool.install(all),
            None => all(),
        });
        let raised = raised.lock().unwrap_or_else(PoisonError::into_inner).take();
        match raised {
            Some(error) => Err(error),
            None => Ok(result?),
        }
    }
}

fn layer<T: numpy::Element + Copy>(
    py: Python<'_>,
    geometry: GridGeometry,
    array: &Py<PyArray2<T>>,
    what: &'static str,
) -> PyResult<Layer<T>> {
    let data = values(&array.bind(py).readonly())?.to_vec();
    Ok(Layer::new(geometry, data, what).map_err(CoreError::from)?)
}

/// The core's default parameters, for the test that compares them with Python's.
#[pyfunction]
pub(crate) fn defaults(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let (rank, swarm) = (RankParams::default(), swathe::swarm::SwarmParams::default());
    let found = PyDict::new(py);
    found.set_item("moisture_percent", rank.moisture_percent)?;
    found.set_item("paper_grade", rank.paper_grade)?;
    found.set_item("agents", swarm.agents)?;
    found.set_item("pellet_max", swarm.pellet_max)?;
    found.set_item("teleport", swarm.teleport)?;
    found.set_item("attract", swarm.attract)?;
    found.set_item("seed", swarm.seed)?;
    found.set_item("rank_min", swarm.nest.rank_min)?;
    found.set_item("rank_min_literal", swathe::rank::RANK_MIN_LITERAL)?;
    found.set_item("sagitta_share", swathe::corridor::SAGITTA_SHARE)?;
    Ok(found)
}
