//! Paths that a car can drive.

use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use swathe::grid::Position;
use swathe::planner::{CurveArc, DrivableParams, DrivablePath, DrivenWay, Pose, Status};

use crate::convert::{entry, nest_params, position};
use crate::planner::facts;
use crate::progress::PythonReport;
use crate::region::Region;

/// Poses of an arc lie this share of the turning radius apart.
const SPACING_RADII: f64 = 0.2;

/// Drives along points through the nests of a region: a dictionary with `status` and the path or the refusal.
#[pyfunction]
#[pyo3(signature = (region, request, nest, report))]
pub(crate) fn drivable_path<'py>(
    py: Python<'py>,
    region: &Region,
    request: &Bound<'py, PyDict>,
    nest: &Bound<'py, PyDict>,
    report: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let points: Vec<(f64, f64)> = entry(request, "points")?;
    let way = DrivenWay {
        points: points.into_iter().map(position).collect(),
        headings_rad: [
            entry(request, "start_heading_rad")?,
            entry(request, "goal_heading_rad")?,
        ],
        params: DrivableParams {
            reverse_factor: entry(request, "reverse_factor")?,
            cusp_time_s: entry(request, "cusp_time_s")?,
            weight: entry(request, "weight")?,
            most_states: entry(request, "most_states")?,
        },
    };
    let nest = nest_params(nest)?;
    let mut told = PythonReport::new(report);
    let result = region.with(py, false, |terrain, ranker, vehicle, params| {
        let mut tell = |done, total| told.tell("route", done, total);
        let moisture = params.moisture_percent;
        Ok(swathe::planner::drivable_way(
            terrain, ranker, vehicle, moisture, &nest, &way, &mut tell,
        )?)
    });
    match told.settle(result)? {
        Ok(path) => {
            let found = driven(py, &path)?;
            found.set_item("status", Status::RouteFound.name())?;
            Ok(found)
        }
        Err(refusal) => {
            let found = PyDict::new(py);
            let Position { x_m, y_m } = refusal.place.unwrap_or(Position::new(f64::NAN, f64::NAN));
            found.set_item("status", refusal.status.name())?;
            found.set_item("reason", refusal.reason)?;
            found.set_item("place", (x_m, y_m))?;
            found.set_item("remedy", refusal.remedy)?;
            Ok(found)
        }
    }
}

/// The core's default parameters, for the test that compares them with Python's.
#[pyfunction]
pub(crate) fn drivable_defaults(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let usual = DrivableParams::default();
    let found = PyDict::new(py);
    found.set_item("reverse_factor", usual.reverse_factor)?;
    found.set_item("cusp_time_s", usual.cusp_time_s)?;
    found.set_item("weight", usual.weight)?;
    found.set_item("most_states", usual.most_states)?;
    Ok(found)
}

/// A path as a dictionary of arrays.
pub(crate) fn driven<'py>(py: Python<'py>, path: &DrivablePath) -> PyResult<Bound<'py, PyDict>> {
    let found = facts(py, &path.total)?;
    let arcs: PyResult<Vec<_>> = path
        .arcs
        .iter()
        .map(|driven| {
            let Pose { x_m, y_m, heading_rad } = driven.from;
            let arc = facts(py, &driven.facts)?;
            arc.set_item("start", (x_m, y_m, heading_rad))?;
            arc.set_item("curvature_per_m", driven.arc.curvature_per_m)?;
            arc.set_item("map_length_m", driven.arc.length_m.abs())?;
            arc.set_item("reverse", driven.arc.length_m < 0.0)?;
            Ok(arc)
        })
        .collect();
    found.set_item("arcs", PyList::new(py, arcs?)?)?;
    let spacing_m = if path.radius_m > 0.0 {
        SPACING_RADII * path.radius_m
    } else {
        f64::INFINITY
    };
    let poses = path.poses(spacing_m);
    let rows: Vec<f64> = poses
        .iter()
        .flat_map(|driven| [driven.pose.x_m, driven.pose.y_m, driven.pose.heading_rad])
        .collect();
    found.set_item("poses", PyArray1::from_vec(py, rows).reshape([poses.len(), 3])?)?;
    let reverse = poses.iter().map(|driven| driven.reverse).collect();
    found.set_item("reverse", PyArray1::from_vec(py, reverse))?;
    let curvature = poses.iter().map(|driven| driven.curvature_per_m).collect();
    found.set_item("curvature_per_m", PyArray1::from_vec(py, curvature))?;
    found.set_item("cusps", path.cusps)?;
    found.set_item("reverse_m", path.reverse_m)?;
    found.set_item("radius_m", path.radius_m)?;
    found.set_item("states", path.states)?;
    Ok(found)
}

type Arcs = Vec<(f64, f64)>;

/// [(curvature, signed length)] of the shortest curve that is driven forward only.
#[pyfunction]
pub(crate) fn dubins(start: (f64, f64, f64), goal: (f64, f64, f64), radius_m: f64) -> Arcs {
    arcs(&swathe::planner::dubins(pose(start), pose(goal), radius_m))
}

/// [(curvature, signed length)] of the shortest curve that may reverse.
#[pyfunction]
pub(crate) fn reeds_shepp(start: (f64, f64, f64), goal: (f64, f64, f64), radius_m: f64) -> Arcs {
    arcs(&swathe::planner::reeds_shepp(pose(start), pose(goal), radius_m))
}

fn pose((x_m, y_m, heading_rad): (f64, f64, f64)) -> Pose {
    Pose { x_m, y_m, heading_rad }
}

fn arcs(found: &[CurveArc]) -> Arcs {
    found.iter().map(|arc| (arc.curvature_per_m, arc.length_m)).collect()
}
