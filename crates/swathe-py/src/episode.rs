//! Episodes.

use std::time::Instant;

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::episode::{
    Actors, EpisodeParams, Fault, FaultKind, Happening, MotionRows, Outcome, ScanRows, Second, SonarRows,
};
use swathe::grid::Position;
use swathe::sensor::{Mount, Pose};
use swathe::sim::SONAR_CONE_RAD;

use crate::convert::{array, entry};
use crate::drive::Navigator;
use crate::error::{CoreError, invalid};
use crate::events::event_fields;
use crate::sim::{SimRobot, no_go_word, reading_figures};

/// Start, end, kind, figures.
type FaultFigures = (f64, f64, String, Vec<f64>);

fn fault((from_s, until_s, kind, figures): FaultFigures) -> PyResult<Fault> {
    let one = |number: usize| figures.get(number).copied().unwrap_or(0.0);
    let kind = match kind.as_str() {
        "scan_dead" => FaultKind::ScanDead,
        "scan_nan" => FaultKind::ScanNan,
        "scan_zero" => FaultKind::ScanZero,
        "scan_beams" => FaultKind::ScanBeams(one(0) as usize),
        "scan_max" => FaultKind::ScanMax,
        "scan_repeated" => FaultKind::ScanRepeated,
        "scan_late" => FaultKind::ScanLate(one(0)),
        "scan_swapped" => FaultKind::ScanSwapped,
        "pose_off" => FaultKind::PoseOff([one(0), one(1), one(2)]),
        "clock_off" => FaultKind::ClockOff(one(0)),
        "reading_of" => FaultKind::ReadingOf(one(0)),
        other => {
            return Err(invalid(
                format!("The fault {other:?} is not known."),
                "Choose one of swathe.episode.FaultKind.",
            ));
        }
    };
    Ok(Fault { from_s, until_s, kind })
}

fn params(dict: &Bound<'_, PyDict>) -> PyResult<EpisodeParams> {
    let usual = EpisodeParams::default();
    let period: Option<f64> = entry(dict, "control_period_s")?;
    Ok(EpisodeParams {
        control_period_s: period.unwrap_or(usual.control_period_s),
        time_limit_s: entry(dict, "time_limit_s")?,
        patience_s: entry(dict, "patience_s")?,
        stops_at_collision: entry(dict, "stops_at_collision")?,
        records: entry(dict, "records")?,
        faults: entry::<Vec<FaultFigures>>(dict, "faults")?
            .into_iter()
            .map(fault)
            .collect::<PyResult<_>>()?,
    })
}

fn place(fields: &Bound<'_, PyDict>, at: &Position) -> PyResult<()> {
    fields.set_item("x_m", at.x_m)?;
    fields.set_item("y_m", at.y_m)
}

fn happening<'py>(py: Python<'py>, told: &Happening) -> PyResult<(&'static str, Bound<'py, PyDict>)> {
    let fields = PyDict::new(py);
    let kind = match told {
        Happening::Drive(event) => return Ok((event.kind(), event_fields(py, event)?)),
        Happening::FaultBegins(kind) => {
            fields.set_item("fault", kind)?;
            "fault_begins"
        }
        Happening::FaultEnds(kind) => {
            fields.set_item("fault", kind)?;
            "fault_ends"
        }
        Happening::ProbeBegins { at, seconds } => {
            place(&fields, at)?;
            fields.set_item("seconds", seconds)?;
            "probe_begins"
        }
        Happening::Collision {
            at,
            moves,
            seen_in_time,
        } => {
            place(&fields, at)?;
            fields.set_item("moves", moves)?;
            fields.set_item("seen_in_time", seen_in_time)?;
            "collision"
        }
        Happening::Sunk => "sunk",
        Happening::NoGoEntered { at, reason } => {
            place(&fields, at)?;
            fields.set_item("reason", no_go_word(*reason))?;
            "no_go_entered"
        }
        Happening::End { verdict, reason } => {
            fields.set_item("status", verdict.name())?;
            fields.set_item("reason", reason)?;
            "end"
        }
    };
    Ok((kind, fields))
}

fn line<'py>(py: Python<'py>, points: &[Position]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let flat = points.iter().flat_map(|point| [point.x_m, point.y_m]).collect();
    PyArray1::from_vec(py, flat).reshape([points.len(), 2])
}

/// A figure of a pose.
type OfPose = fn(&Pose) -> f64;

fn motion(py: Python<'_>, rows: MotionRows) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    let figures: [(&str, OfPose); 5] = [
        ("x_m", |pose| pose.x_m),
        ("y_m", |pose| pose.y_m),
        ("heading_rad", |pose| pose.heading_rad),
        ("pitch_rad", |pose| pose.pitch_rad),
        ("roll_rad", |pose| pose.roll_rad),
    ];
    for (name, figure) in figures {
        dict.set_item(name, PyArray1::from_vec(py, rows.poses.iter().map(figure).collect()))?;
    }
    dict.set_item("times_s", PyArray1::from_vec(py, rows.times_s))?;
    dict.set_item("speed_mps", PyArray1::from_vec(py, rows.speeds_mps))?;
    dict.set_item("turn_rate_radps", PyArray1::from_vec(py, rows.turn_rates_radps))?;
    Ok(dict)
}

fn scans<'py>(py: Python<'py>, rows: ScanRows, robot: &swathe::sim::Robot) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let (count, laser) = (rows.times_s.len(), &robot.params().laser);
    let Mount { x_m, y_m, heading_rad } = laser.mount;
    dict.set_item("times_s", PyArray1::from_vec(py, rows.times_s))?;
    dict.set_item("arrivals_s", PyArray1::from_vec(py, rows.arrivals_s))?;
    let ranges_m = PyArray1::from_vec(py, rows.ranges_m).reshape([count, rows.beams])?;
    dict.set_item("ranges_m", ranges_m)?;
    dict.set_item("angle_min_rad", laser.angle_min_rad)?;
    dict.set_item("angle_increment_rad", laser.angle_increment_rad)?;
    dict.set_item("range_min_m", laser.range_min_m)?;
    dict.set_item("range_max_m", laser.range_max_m)?;
    dict.set_item("mount", (x_m, y_m, heading_rad))?;
    Ok(dict)
}

fn sonar<'py>(py: Python<'py>, rows: SonarRows, robot: &swathe::sim::Robot) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let ring = &robot.params().sonar;
    let mounts: Vec<_> = ring
        .iter()
        .map(|cone| (cone.mount.x_m, cone.mount.y_m, cone.mount.heading_rad))
        .collect();
    dict.set_item("times_s", PyArray1::from_vec(py, rows.times_s))?;
    dict.set_item("arrivals_s", PyArray1::from_vec(py, rows.arrivals_s))?;
    dict.set_item("cones", PyArray1::from_vec(py, rows.cones))?;
    dict.set_item("ranges_m", PyArray1::from_vec(py, rows.ranges_m))?;
    dict.set_item("cone_rad", SONAR_CONE_RAD)?;
    dict.set_item("range_min_m", ring.first().map_or(0.0, |cone| cone.range_min_m))?;
    dict.set_item("range_max_m", ring.first().map_or(0.0, |cone| cone.range_max_m))?;
    dict.set_item("mounts", mounts)?;
    Ok(dict)
}

fn second<'py>(py: Python<'py>, told: Second, robot: &swathe::sim::Robot) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("start_s", told.start_s)?;
    dict.set_item("end_s", told.end_s)?;
    dict.set_item("scans", scans(py, told.scans, robot)?)?;
    dict.set_item("sonar", sonar(py, told.sonar, robot)?)?;
    dict.set_item("odometry", motion(py, told.odometry)?)?;
    dict.set_item("truth", motion(py, told.truth)?)?;
    let commands = PyDict::new(py);
    commands.set_item("times_s", PyArray1::from_vec(py, told.commands.times_s))?;
    commands.set_item("speed_mps", PyArray1::from_vec(py, told.commands.speeds_mps))?;
    commands.set_item(
        "turn_rate_radps",
        PyArray1::from_vec(py, told.commands.turn_rates_radps),
    )?;
    commands.set_item("status", PyArray1::from_vec(py, told.commands.statuses))?;
    dict.set_item("commands", commands)?;
    let events: PyResult<Vec<_>> = told
        .events
        .iter()
        .map(|(time_s, told)| happening(py, told).map(|(kind, fields)| (*time_s, kind, fields)))
        .collect();
    dict.set_item("events", events?)?;
    for (name, lines) in [("ways", told.ways), ("routes", told.routes)] {
        let lines: PyResult<Vec<_>> = lines
            .iter()
            .map(|(time_s, points)| line(py, points).map(|points| (*time_s, points)))
            .collect();
        dict.set_item(name, lines?)?;
    }
    let maps: PyResult<Vec<_>> = told
        .maps
        .into_iter()
        .map(|map| {
            let grid = map.certainty.geometry();
            let certainty = array(py, grid, map.certainty.into_data())?;
            Ok((map.time_s, certainty, grid.west_m(), grid.north_m(), grid.cell_size_m()))
        })
        .collect();
    dict.set_item("maps", maps?)?;
    let histograms: PyResult<Vec<_>> = told
        .histograms
        .into_iter()
        .map(|row| {
            let (fields, shown) = (PyDict::new(py), row.histogram);
            fields.set_item("densities", shown.densities)?;
            fields.set_item("thresholds", shown.thresholds)?;
            fields.set_item("blocked", shown.blocked)?;
            fields.set_item("masked", shown.masked)?;
            fields.set_item("first_rad", shown.first_rad)?;
            fields.set_item("direction_rad", shown.direction_rad)?;
            Ok((row.time_s, fields))
        })
        .collect();
    dict.set_item("histograms", histograms?)?;
    let movers = PyDict::new(py);
    let (times, count) = (told.movers.times_s.len(), told.movers.radii_m.len());
    movers.set_item("times_s", PyArray1::from_vec(py, told.movers.times_s))?;
    movers.set_item(
        "positions_m",
        line(py, &told.movers.positions)?.reshape([times, count, 2])?,
    )?;
    movers.set_item("radii_m", PyArray1::from_vec(py, told.movers.radii_m))?;
    dict.set_item("movers", movers)?;
    let readings = told.readings.into_iter();
    let readings: Vec<_> = readings
        .map(|(time_s, reading)| (time_s, reading_figures(reading)))
        .collect();
    dict.set_item("readings", readings)?;
    let grids = PyDict::new(py);
    let rows = told.grids.times_s.len();
    grids.set_item("times_s", PyArray1::from_vec(py, told.grids.times_s))?;
    let answers = PyArray1::from_vec(py, told.grids.answers).reshape([rows, told.grids.grids])?;
    grids.set_item("answers", answers)?;
    grids.set_item("navigable", PyArray1::from_vec(py, told.grids.navigable))?;
    dict.set_item("grids", grids)?;
    Ok(dict)
}

fn outcome<'py>(py: Python<'py>, told: &Outcome) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("status", told.verdict.name())?;
    dict.set_item("reason", told.reason)?;
    dict.set_item("distance_m", told.distance_m)?;
    dict.set_item("duration_s", told.duration_s)?;
    dict.set_item("min_clearance_m", told.min_clearance_m)?;
    dict.set_item("collisions", told.collisions)?;
    dict.set_item("replans", told.replans)?;
    dict.set_item("probes", told.probes)?;
    dict.set_item("soil_updates", told.soil_updates)?;
    dict.set_item("no_go_entries", told.no_go_entries)?;
    dict.set_item("goal_distance_m", told.goal_distance_m)?;
    dict.set_item("top_speed_mps", told.top_speed_mps)?;
    dict.set_item("longest_step_s", told.longest_step_s)?;
    Ok(dict)
}

/// A drive from its beginning on.
#[pyclass(module = "swathe._core")]
pub(crate) struct Episode {
    inner: swathe::episode::Episode,
    robot: Py<SimRobot>,
    navigator: Py<Navigator>,
}

#[pymethods]
impl Episode {
    #[new]
    fn new(py: Python<'_>, robot: Py<SimRobot>, navigator: Py<Navigator>, dict: &Bound<'_, PyDict>) -> PyResult<Self> {
        let made = swathe::episode::Episode::new(&robot.borrow(py).inner, params(dict)?);
        let inner = made.map_err(CoreError::from)?;
        Ok(Self {
            inner,
            robot,
            navigator,
        })
    }

    fn advance<'py>(&mut self, py: Python<'py>, seconds: f64) -> PyResult<Bound<'py, PyDict>> {
        let mut robot = self.robot.borrow_mut(py);
        let robot = &mut *robot;
        let world = robot.world.borrow(py);
        let mut navigator = self.navigator.borrow_mut(py);
        let (truth, body, driver) = (&world.inner, &mut robot.inner, &mut navigator.inner);
        let inner = &mut self.inner;
        let told = py.detach(|| {
            let begun = Instant::now();
            let mut actors = Actors {
                world: truth,
                robot: body,
                navigator: driver,
                clock: &mut || begun.elapsed().as_secs_f64(),
            };
            inner.advance(&mut actors, seconds)
        });
        second(py, told, &robot.inner)
    }

    fn outcome<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        self.inner.outcome().map(|told| outcome(py, told)).transpose()
    }

    fn ask_for_probe(&mut self) {
        self.inner.ask_for_probe();
    }
}
