//! The local methods by themselves.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use swathe::local::{Body, PlayerParams, TooClose, VfhPlusParams};
use swathe::sensor::{Mount, Scan};

use crate::convert::{values, word};
use crate::error::invalid;

const TOO_CLOSE: [(&str, TooClose); 2] = [("stop", TooClose::Stop), ("turn_away", TooClose::TurnAway)];

/// Enlargement, least turning radii to the left and right, reaction distance.
type BodyFigures = (f64, f64, f64, f64);

/// VFH+ with its memory of the last step.
#[pyclass(module = "swathe._core")]
pub(crate) struct VfhPlus {
    inner: swathe::local::VfhPlus,
}

#[pymethods]
impl VfhPlus {
    #[new]
    #[pyo3(signature = (window_cells, cell_size_m, sectors, too_close))]
    fn new(window_cells: usize, cell_size_m: f64, sectors: usize, too_close: &str) -> PyResult<Self> {
        let params = VfhPlusParams {
            window_cells,
            cell_size_m,
            sectors,
            too_close: word("answer to what is too close", too_close, &TOO_CLOSE)?,
            ..VfhPlusParams::default()
        };
        Ok(Self {
            inner: swathe::local::VfhPlus::new(params),
        })
    }

    /// Cells along the window's side.
    fn window_cells(&self) -> usize {
        self.inner.params().window_cells
    }

    /// Direction (NaN when all is closed), crowding and width for each window (a row of its cells), one after the other.
    fn steer<'py>(
        &mut self,
        py: Python<'py>,
        windows: PyReadonlyArray2<'py, u8>,
        heading_rad: f64,
        target_rad: f64,
        body: BodyFigures,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let cells = self.window_cells() * self.window_cells();
        let windows = values(&windows)?;
        if !windows.len().is_multiple_of(cells) {
            return Err(invalid(format!("A window must have {cells} cells."), ""));
        }
        let body = Body {
            enlarged_m: body.0,
            turn_radius_m: [body.1, body.2],
            reaction_m: body.3,
        };
        let inner = &mut self.inner;
        let told: Vec<f64> = py.detach(|| {
            let steer = |window| {
                let told = inner.steer(window, heading_rad, target_rad, &body, None);
                [told.direction_rad.unwrap_or(f64::NAN), told.crowding, told.width_rad]
            };
            windows.chunks_exact(cells).flat_map(steer).collect()
        });
        let rows = told.len() / 3;
        PyArray1::from_vec(py, told).reshape([rows, 3])
    }

    /// Density, blocked and masked sectors of the last step.
    #[allow(clippy::type_complexity, reason = "a histogram")]
    fn histogram<'py>(
        &self,
        py: Python<'py>,
    ) -> (
        Bound<'py, PyArray1<f32>>,
        Bound<'py, PyArray1<bool>>,
        Bound<'py, PyArray1<bool>>,
    ) {
        let polar = self.inner.histogram();
        (
            PyArray1::from_slice(py, &polar.density),
            PyArray1::from_slice(py, &polar.blocked),
            PyArray1::from_slice(py, &polar.masked),
        )
    }
}

/// Player's method with its memory of the last step.
#[pyclass(module = "swathe._core")]
pub(crate) struct PlayerVfh {
    inner: swathe::local::PlayerVfh,
}

#[pymethods]
impl PlayerVfh {
    #[new]
    fn new(robot_radius_m: f64) -> Self {
        let params = PlayerParams {
            robot_radius_m,
            ..PlayerParams::default()
        };
        Self {
            inner: swathe::local::PlayerVfh::new(params),
        }
    }

    /// Speed, turn rate and direction off the nose for each scan (a row of ranges), one after the other.
    ///
    /// `fan` is first angle, angle between beams, least and greatest range.
    fn update<'py>(
        &mut self,
        py: Python<'py>,
        scans: PyReadonlyArray2<'py, f64>,
        fan: (f64, f64, f64, f64),
        speed_mps: f64,
        goal_rad: f64,
        step_s: f64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let beams = scans.as_array().ncols().max(1);
        let ranges = values(&scans)?;
        let mut scan = Scan {
            ranges_m: vec![0.0; beams],
            angle_min_rad: fan.0,
            angle_increment_rad: fan.1,
            range_min_m: fan.2,
            range_max_m: fan.3,
            mount: Mount::default(),
        };
        scan.validate()
            .map_err(|error| invalid(error.to_string(), "Correct the scan."))?;
        let inner = &mut self.inner;
        let told: Vec<f64> = py.detach(|| {
            let mut update = |ranges: &[f64]| {
                scan.ranges_m.copy_from_slice(ranges);
                let told = inner.update(&scan, speed_mps, goal_rad, step_s);
                [told.speed_mps, told.turn_rate_radps, told.direction_rad]
            };
            ranges.chunks_exact(beams).flat_map(&mut update).collect()
        });
        let rows = told.len() / 3;
        PyArray1::from_vec(py, told).reshape([rows, 3])
    }

    /// Density of every sector in the last step, from the nose on counter-clockwise.
    fn histogram<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.inner.histogram())
    }
}
