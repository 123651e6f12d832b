//! The local methods by themselves.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use swathe::local::{Body, PlayerDriver, PlayerParams, PlayerState, TooClose, VfhPlusParams};
use swathe::sensor::{Mount, Pose, Scan};

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

/// Player's driver and method with their memory of the last step.
#[pyclass(module = "swathe._core")]
pub(crate) struct PlayerVfh {
    inner: PlayerDriver,
}

/// Pairs of figures at 0 and 1 m/s.
type Pair = [f64; 2];

#[pymethods]
impl PlayerVfh {
    /// `figures` are cell size, sector angle in degrees, greatest speed, that in narrow and in wide openings, acceleration, least
    /// turn rate, safety factor, weights of the wanted and of the current direction, distance and angle epsilon, and escape's speed,
    /// time and turn rate; `pairs` are safety distance, turn rate, free space's and obstacles' cutoff. All in SI units.
    #[new]
    fn new(robot_radius_m: f64, window_diameter: usize, figures: [f64; 15], pairs: [Pair; 4], seed: u64) -> Self {
        let [
            cell_size_m,
            sector_angle_deg,
            max_speed_mps,
            max_speed_narrow_opening_mps,
            max_speed_wide_opening_mps,
            max_acceleration_mps2,
            min_turnrate_radps,
            min_turn_radius_safety_factor,
            weight_desired_dir,
            weight_current_dir,
            distance_epsilon_m,
            angle_epsilon_rad,
            escape_speed_mps,
            escape_time_s,
            escape_max_turnrate_radps,
        ] = figures;
        let [safety_dist_m, max_turnrate_radps, free_space_cutoff, obs_cutoff] = pairs;
        let params = PlayerParams {
            cell_size_m,
            window_diameter,
            sector_angle_deg,
            safety_dist_m,
            max_speed_mps,
            max_speed_narrow_opening_mps,
            max_speed_wide_opening_mps,
            max_acceleration_mps2,
            min_turnrate_radps,
            max_turnrate_radps,
            min_turn_radius_safety_factor,
            free_space_cutoff,
            obs_cutoff,
            weight_desired_dir,
            weight_current_dir,
            distance_epsilon_m,
            angle_epsilon_rad,
            escape_speed_mps,
            escape_time_s,
            escape_max_turnrate_radps,
            robot_radius_m,
            ..PlayerParams::default()
        };
        Self {
            inner: PlayerDriver::new(params, seed),
        }
    }

    /// Speed, turn rate and direction off the nose on the way from a pose to a place and heading (each east, north, heading), and
    /// what the driver does: 0 drives, 1 escapes, 2 turns, 3 is there. `fan` is as for `update`.
    #[allow(clippy::too_many_arguments, reason = "what a robot senses, as plain figures")]
    fn drive(
        &mut self,
        ranges_m: Vec<f64>,
        fan: (f64, f64, f64, f64),
        pose: (f64, f64, f64),
        speed_mps: f64,
        goal: (f64, f64, f64),
        step_s: f64,
    ) -> PyResult<(f64, f64, f64, u8)> {
        let scan = scan_of(ranges_m, fan)?;
        let at = |(x_m, y_m, heading_rad)| Pose::level(x_m, y_m, heading_rad);
        let (told, state) = self.inner.drive(&scan, (&at(pose), speed_mps), &at(goal), step_s);
        let state = match state {
            PlayerState::Driving => 0,
            PlayerState::Escaping => 1,
            PlayerState::Turning => 2,
            PlayerState::There => 3,
        };
        Ok((told.speed_mps, told.turn_rate_radps, told.direction_rad, state))
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
        let mut scan = scan_of(vec![0.0; beams], fan)?;
        let inner = self.inner.method();
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
    fn histogram<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.inner.method().histogram())
    }
}

/// A scan from first angle, angle between beams, least and greatest range.
fn scan_of(ranges_m: Vec<f64>, fan: (f64, f64, f64, f64)) -> PyResult<Scan> {
    let scan = Scan {
        ranges_m,
        angle_min_rad: fan.0,
        angle_increment_rad: fan.1,
        range_min_m: fan.2,
        range_max_m: fan.3,
        mount: Mount::default(),
    };
    scan.validate()
        .map_err(|error| invalid(error.to_string(), "Correct the scan."))?;
    Ok(scan)
}
