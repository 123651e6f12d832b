//! The navigator.

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::drive::{DriveParams, Method, Observation, OutsideNests, Region};
use swathe::grid::Layer;
use swathe::sensor::{Mount, PenetrometerReading, Pose, Scan};

use crate::convert::{Shape, entry, geometry, position, values, word};
use crate::error::{CoreError, invalid};
use crate::vehicle::Vehicle;

const METHODS: [(&str, Method); 4] = [
    ("vfh", Method::Vfh),
    ("vfh+", Method::VfhPlus),
    ("vfh*", Method::VfhStar),
    ("player", Method::Player),
];

const OUTSIDE: [(&str, OutsideNests); 2] = [("cost", OutsideNests::Cost), ("block", OutsideNests::Block)];

fn params(dict: &Bound<PyDict>) -> PyResult<DriveParams> {
    Ok(DriveParams {
        method: word("method", &entry::<String>(dict, "method")?, &METHODS)?,
        outside_nests: word("outside_nests", &entry::<String>(dict, "outside_nests")?, &OUTSIDE)?,
        arrival_m: entry(dict, "arrival_m")?,
        max_turn_rate_radps: entry(dict, "max_turn_rate_radps")?,
        acceleration_mps2: entry(dict, "acceleration_mps2")?,
        braking_mps2: entry(dict, "braking_mps2")?,
        margin_m: entry(dict, "margin_m")?,
        stale_s: entry(dict, "stale_s")?,
        sensor_height_m: entry(dict, "sensor_height_m")?,
        memory: entry(dict, "memory")?,
        recover: entry(dict, "recover")?,
        ..DriveParams::default()
    })
}

/// (ranks, shape, route) of a region.
type Map<'py> = (PyReadonlyArray2<'py, u8>, Shape, Vec<(f64, f64)>);

/// The navigator with all that it remembers.
#[pyclass(module = "swathe._core")]
pub(crate) struct Navigator {
    pub(crate) inner: swathe::drive::Navigator,
}

#[pymethods]
impl Navigator {
    #[new]
    #[pyo3(signature = (vehicle, goal, dict, region))]
    fn new(vehicle: &Vehicle, goal: (f64, f64), dict: &Bound<'_, PyDict>, region: Option<Map<'_>>) -> PyResult<Self> {
        let region = match region {
            None => None,
            Some((ranks, shape, route)) => Some(Region {
                ranks: Layer::new(geometry(shape)?, values(&ranks)?.to_vec(), "the rank map")
                    .map_err(CoreError::from)?,
                elevation_m: None,
                route: route.into_iter().map(position).collect(),
                grids: None,
            }),
        };
        let made = swathe::drive::Navigator::new(&vehicle.inner, position(goal), region, params(dict)?);
        Ok(Self {
            inner: made.map_err(CoreError::from)?,
        })
    }

    /// A step: (speed, turn rate, status, reason).
    #[pyo3(signature = (time_s, pose, speeds, ranges_m, scan, reading))]
    #[allow(clippy::too_many_arguments, clippy::type_complexity, reason = "what a robot senses")]
    fn step(
        &mut self,
        py: Python<'_>,
        time_s: f64,
        pose: (f64, f64, f64, f64, f64),
        speeds: (f64, f64),
        ranges_m: Option<PyReadonlyArray1<'_, f64>>,
        scan: [f64; 7],
        reading: Option<(f64, f64, Vec<f64>, Vec<f64>, Option<f64>)>,
    ) -> PyResult<(f64, f64, &'static str, &'static str)> {
        let apart = |_| {
            invalid(
                "The ranges are not contiguous.".to_owned(),
                "Use numpy.ascontiguousarray.",
            )
        };
        let ranges_m = ranges_m
            .map(|ranges| ranges.as_slice().map(<[f64]>::to_vec))
            .transpose()
            .map_err(apart)?;
        let scan = ranges_m.map(|ranges_m| Scan {
            ranges_m,
            angle_min_rad: scan[0],
            angle_increment_rad: scan[1],
            range_min_m: scan[2],
            range_max_m: scan[3],
            mount: Mount {
                x_m: scan[4],
                y_m: scan[5],
                heading_rad: scan[6],
            },
        });
        let reading = reading.map(
            |(x_m, y_m, depths_m, cone_indices_kpa, refusal_depth_m)| PenetrometerReading {
                x_m,
                y_m,
                depths_m,
                cone_indices_kpa,
                refusal_depth_m,
                sleeve_frictions_kpa: None,
            },
        );
        let (x_m, y_m, heading_rad, pitch_rad, roll_rad) = pose;
        let seen = Observation {
            time_s,
            pose: Pose {
                x_m,
                y_m,
                heading_rad,
                pitch_rad,
                roll_rad,
            },
            speed_mps: speeds.0,
            turn_rate_radps: speeds.1,
            scan: scan.as_ref(),
            reading: reading.as_ref(),
        };
        let inner = &mut self.inner;
        let command = py.detach(|| inner.step(&seen));
        let reason = self.inner.reason().text();
        Ok((
            command.speed_mps,
            command.turn_rate_radps,
            command.status.name(),
            reason,
        ))
    }

    /// What happened in the last step, in words.
    fn events(&self) -> Vec<String> {
        self.inner.events().iter().map(|event| format!("{event:?}")).collect()
    }

    /// The way from the robot on.
    fn way(&self) -> Vec<(f64, f64)> {
        self.inner.way().iter().map(|point| (point.x_m, point.y_m)).collect()
    }
}
