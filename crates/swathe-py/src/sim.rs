//! The simulated world.

use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::grid::{Layer, Position};
use swathe::sensor::{Mount, PenetrometerReading, Pose, Scan};
use swathe::sim::{
    BodyState, Command, Laser, LocaliserParams, Mover, NoGo, Obstacle, Penetrometer, RobotParams, ScenarioKind, Shape,
    Steering, Stop, TruthErrors, sonar_ring,
};

use crate::convert::{Shape as GridShape, array, entry, geometry, position, values, word};
use crate::error::CoreError;
use crate::vehicle::Vehicle;

type Point = (f64, f64);
/// x, y, heading, pitch, roll.
type PoseFigures = (f64, f64, f64, f64, f64);
/// Ranges, first angle, step, least and greatest range, mount.
type ScanFigures<'py> = (Bound<'py, PyArray1<f64>>, f64, f64, f64, f64, (f64, f64, f64));
/// Time, pose, height, wheel speed, wheel turn rate, speed, turn rate, slip, stop, no-go, collisions.
type StateFigures = (
    (f64, PoseFigures, f64),
    (f64, f64, f64, f64, f64),
    Option<&'static str>,
    Option<&'static str>,
    u32,
);
/// Depths, cone indices, refusal depth.
pub(crate) type ReadingFigures = (Point, Vec<f64>, Vec<f64>, Option<f64>);

const KINDS: [(&str, ScenarioKind); 5] = [
    ("clutter", ScenarioKind::Clutter),
    ("corridor", ScenarioKind::Corridor),
    ("u-trap", ScenarioKind::UTrap),
    ("dead-end", ScenarioKind::DeadEnd),
    ("moving", ScenarioKind::Moving),
];

fn pose((x_m, y_m, heading_rad): (f64, f64, f64)) -> Pose {
    Pose::level(x_m, y_m, heading_rad)
}

fn pose_figures(pose: &Pose) -> PoseFigures {
    (pose.x_m, pose.y_m, pose.heading_rad, pose.pitch_rad, pose.roll_rad)
}

fn scan_figures(py: Python<'_>, scan: Scan) -> ScanFigures<'_> {
    let Mount { x_m, y_m, heading_rad } = scan.mount;
    (
        PyArray1::from_vec(py, scan.ranges_m),
        scan.angle_min_rad,
        scan.angle_increment_rad,
        scan.range_min_m,
        scan.range_max_m,
        (x_m, y_m, heading_rad),
    )
}

pub(crate) fn reading_figures(reading: PenetrometerReading) -> ReadingFigures {
    let place = (reading.x_m, reading.y_m);
    (
        place,
        reading.depths_m,
        reading.cone_indices_kpa,
        reading.refusal_depth_m,
    )
}

pub(crate) fn no_go_word(reason: NoGo) -> &'static str {
    match reason {
        NoGo::Obstacle => "obstacle",
        NoGo::Soil => "soil",
        NoGo::Grade => "grade",
        NoGo::SideSlope => "side_slope",
        NoGo::Unknown => "unknown",
        NoGo::Outside => "outside",
    }
}

fn state_figures(state: &BodyState) -> StateFigures {
    let stop = state.stop.map(|stop| match stop {
        Stop::Collision => "collision",
        Stop::Sunk => "sunk",
        Stop::Edge => "edge",
    });
    (
        (state.time_s, pose_figures(&state.pose), state.height_m),
        (
            state.wheel_speed_mps,
            state.wheel_turn_rate_radps,
            state.speed_mps,
            state.turn_rate_radps,
            state.slip,
        ),
        stop,
        state.no_go.map(no_go_word),
        state.collisions,
    )
}

fn points(given: Vec<Point>) -> Vec<Position> {
    given.into_iter().map(position).collect()
}

/// The truth.
#[pyclass(module = "swathe._core")]
pub(crate) struct SimWorld {
    pub(crate) inner: swathe::sim::World,
}

#[pymethods]
impl SimWorld {
    #[new]
    #[pyo3(signature = (elevation_m, soil, shape, moisture_percent, errors, seed))]
    fn new(
        py: Python<'_>,
        elevation_m: PyReadonlyArray2<'_, f32>,
        soil: PyReadonlyArray2<'_, u8>,
        shape: GridShape,
        moisture_percent: f64,
        errors: Option<(f64, f64, f64)>,
        seed: u64,
    ) -> PyResult<Self> {
        let grid = geometry(shape)?;
        let (heights, codes) = (values(&elevation_m)?.to_vec(), values(&soil)?.to_vec());
        let made = py.detach(move || -> Result<_, CoreError> {
            let elevation = Layer::new(grid, heights, "the elevation")?;
            let soil = Layer::new(grid, codes, "the soil layer")?;
            Ok(match errors {
                None => swathe::sim::World::new(elevation, soil, moisture_percent)?,
                Some((height_m, patch_m, soil_share)) => {
                    let errors = TruthErrors {
                        height_m,
                        patch_m,
                        soil_share,
                    };
                    swathe::sim::World::behind_map(&elevation, &soil, moisture_percent, &errors, seed)?
                }
            })
        });
        Ok(Self { inner: made? })
    }

    /// Discs (centre, radius, height), polygons and walls (points, height).
    fn place(
        &mut self,
        discs: Vec<(Point, f64, f64)>,
        polygons: Vec<(Vec<Point>, f64)>,
        walls: Vec<(Vec<Point>, f64)>,
    ) -> PyResult<()> {
        let disc = |((x, y), radius_m, height_m)| Obstacle {
            shape: Shape::Disc {
                centre: Position::new(x, y),
                radius_m,
            },
            height_m,
        };
        let polygon = |(corners, height_m)| Obstacle {
            shape: Shape::Polygon(points(corners)),
            height_m,
        };
        let wall = |(line, height_m)| Obstacle {
            shape: Shape::Wall(points(line)),
            height_m,
        };
        let all = discs.into_iter().map(disc).chain(polygons.into_iter().map(polygon));
        let all = all.chain(walls.into_iter().map(wall)).collect();
        Ok(self.inner.place(all).map_err(CoreError::from)?)
    }

    /// Discs that go to and fro: path, speed, radius, metres along the path at time 0.
    fn set_in_motion(&mut self, movers: Vec<(Vec<Point>, f64, f64, f64)>) -> PyResult<()> {
        let mover = |(path, speed_mps, radius_m, start_m)| Mover {
            path: points(path),
            speed_mps,
            radius_m,
            start_m,
        };
        let movers = movers.into_iter().map(mover).collect();
        Ok(self.inner.set_in_motion(movers).map_err(CoreError::from)?)
    }

    fn dig(&mut self, line: Vec<Point>, width_m: f64, depth_m: f64) -> PyResult<()> {
        Ok(self
            .inner
            .dig(&points(line), width_m, depth_m)
            .map_err(CoreError::from)?)
    }

    fn elevation_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let heights = self.inner.relief().heights();
        array(py, heights.geometry(), heights.data().to_vec())
    }

    fn soil<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        array(py, self.inner.geometry(), self.inner.soil().data().to_vec())
    }

    fn geometry(&self) -> GridShape {
        let grid = self.inner.geometry();
        (
            grid.rows(),
            grid.columns(),
            grid.cell_size_m(),
            grid.west_m(),
            grid.north_m(),
        )
    }

    fn height_m(&self, at: Point) -> Option<f64> {
        self.inner.relief().height_m(position(at))
    }

    fn collides(&self, vehicle: &Vehicle, at: (f64, f64, f64), time_s: f64) -> bool {
        self.inner.collides(&vehicle.inner, &pose(at), time_s)
    }

    fn no_go(&self, vehicle: &Vehicle, at: (f64, f64, f64), time_s: f64) -> Option<&'static str> {
        self.inner.no_go(&vehicle.inner, &pose(at), time_s).map(no_go_word)
    }

    /// Length and poses (x, y, heading) of the shortest way.
    #[allow(clippy::type_complexity, reason = "length and poses")]
    fn way(
        &self,
        py: Python<'_>,
        vehicle: &Vehicle,
        start: (f64, f64, f64),
        goal: Point,
    ) -> Option<(f64, Vec<(f64, f64, f64)>)> {
        let (world, vehicle) = (&self.inner, &vehicle.inner);
        let found = py.detach(|| swathe::sim::way(world, vehicle, &pose(start), position(goal)))?;
        let poses = found.poses.iter().map(|pose| (pose.x_m, pose.y_m, pose.heading_rad));
        Some((found.length_m, poses.collect()))
    }

    /// Outlines: (kind, points, radius or 0, height).
    fn obstacles(&self) -> Vec<(&'static str, Vec<Point>, f64, f64)> {
        let pairs = |points: &[Position]| points.iter().map(|p| (p.x_m, p.y_m)).collect();
        let one = |obstacle: &Obstacle| match &obstacle.shape {
            Shape::Disc { centre, radius_m } => ("disc", pairs(&[*centre]), *radius_m, obstacle.height_m),
            Shape::Polygon(points) => ("polygon", pairs(points), 0.0, obstacle.height_m),
            Shape::Wall(points) => ("wall", pairs(points), 0.0, obstacle.height_m),
        };
        self.inner.obstacles().iter().map(one).collect()
    }

    /// Places and radii of what moves at a time.
    fn movers(&self, time_s: f64) -> Vec<(Point, f64)> {
        let one = |mover: &Mover| {
            let at = mover.at(time_s);
            ((at.x_m, at.y_m), mover.radius_m)
        };
        self.inner.movers().iter().map(one).collect()
    }
}

/// A drawn world, its start and its goal.
#[pyfunction]
pub(crate) fn random_world(
    seed: u64,
    density: f64,
    kind: &str,
    scale: f64,
) -> PyResult<(SimWorld, PoseFigures, Point)> {
    let kind = word("kind of world", kind, &KINDS)?;
    let drawn = swathe::sim::random_world(seed, density, kind, scale).map_err(CoreError::from)?;
    let goal = (drawn.goal.x_m, drawn.goal.y_m);
    Ok((SimWorld { inner: drawn.world }, pose_figures(&drawn.start), goal))
}

fn laser(dict: &Bound<'_, PyDict>) -> PyResult<Laser> {
    let number = |name: &str| entry::<f64>(dict, name);
    let (x_m, y_m, heading_rad) = entry(dict, "mount")?;
    Ok(Laser {
        beams: entry(dict, "beams")?,
        angle_min_rad: number("angle_min_rad")?,
        angle_increment_rad: number("angle_increment_rad")?,
        range_min_m: number("range_min_m")?,
        range_max_m: number("range_max_m")?,
        mount: Mount { x_m, y_m, heading_rad },
        height_m: number("height_m")?,
        rate_hz: number("rate_hz")?,
        noise_m: number("noise_m")?,
        bias_m: number("bias_m")?,
        dropout: number("dropout")?,
        resolution_m: number("resolution_m")?,
    })
}

/// Figures of the SICK LMS 200 as the core knows it, by name.
#[pyfunction]
pub(crate) fn sick_lms200(py: Python<'_>, half_degrees: bool, far: bool) -> PyResult<Bound<'_, PyDict>> {
    let laser = Laser::sick_lms200(half_degrees, far);
    let dict = PyDict::new(py);
    dict.set_item("beams", laser.beams)?;
    dict.set_item("mount", (laser.mount.x_m, laser.mount.y_m, laser.mount.heading_rad))?;
    for (name, figure) in [
        ("angle_min_rad", laser.angle_min_rad),
        ("angle_increment_rad", laser.angle_increment_rad),
        ("range_min_m", laser.range_min_m),
        ("range_max_m", laser.range_max_m),
        ("height_m", laser.height_m),
        ("rate_hz", laser.rate_hz),
        ("noise_m", laser.noise_m),
        ("bias_m", laser.bias_m),
        ("dropout", laser.dropout),
        ("resolution_m", laser.resolution_m),
    ] {
        dict.set_item(name, figure)?;
    }
    Ok(dict)
}

fn robot_params(
    dict: &Bound<'_, PyDict>,
    sensing: &Bound<'_, PyDict>,
    vehicle: &swathe::vehicle::Vehicle,
) -> PyResult<RobotParams> {
    let number = |name: &str| entry::<f64>(dict, name);
    Ok(RobotParams {
        laser: laser(sensing)?,
        has_laser: entry(dict, "has_laser")?,
        sonar: if entry(dict, "sonar")? {
            sonar_ring(vehicle)
        } else {
            Vec::new()
        },
        penetrometer: Penetrometer {
            boom_m: number("probe_boom_m")?,
            ..Penetrometer::default()
        },
        localiser: LocaliserParams {
            scale_error: number("scale_error")?,
            distance_noise_m: number("distance_noise_m")?,
            heading_noise_rad: number("heading_noise_rad")?,
            heading_drift_radps: number("heading_drift_radps")?,
            fix_rate_hz: number("fix_rate_hz")?,
            fix_noise_m: number("fix_noise_m")?,
            fix_heading_noise_rad: number("fix_heading_noise_rad")?,
            blind_to_slip: entry(dict, "blind_to_slip")?,
            fuses_fixes: entry(dict, "fuses_fixes")?,
        },
        scan_delay_s: number("scan_delay_s")?,
        scan_dropout: number("scan_dropout")?,
        slip_variation: number("slip_variation")?,
        seed: entry(dict, "seed")?,
    })
}

/// A robot and the world that it is in.
#[pyclass(module = "swathe._core")]
pub(crate) struct SimRobot {
    pub(crate) inner: swathe::sim::Robot,
    pub(crate) world: Py<SimWorld>,
}

#[pymethods]
impl SimRobot {
    #[new]
    fn new(
        py: Python<'_>,
        world: Py<SimWorld>,
        vehicle: &Vehicle,
        motion: (String, f64, f64, f64),
        at: (f64, f64, f64),
        sensing: &Bound<'_, PyDict>,
        params: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
        let (steering, max_acceleration_mps2, max_braking_mps2, max_turn_rate_radps) = motion;
        let known = [
            ("differential", Steering::Differential),
            ("skid", Steering::Skid),
            ("ackermann", Steering::Ackermann),
        ];
        let motion = swathe::sim::Motion {
            steering: word("steering", &steering, &known)?,
            max_acceleration_mps2,
            max_braking_mps2,
            max_turn_rate_radps,
        };
        let params = robot_params(params, sensing, &vehicle.inner)?;
        let truth = world.borrow(py);
        let made = swathe::sim::Robot::new(&truth.inner, vehicle.inner.clone(), motion, pose(at), params);
        let inner = made.map_err(CoreError::from)?;
        drop(truth);
        Ok(Self { inner, world })
    }

    #[allow(clippy::type_complexity, reason = "estimate, newest scan with its time, truth")]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        speed_mps: f64,
        turn_rate_radps: f64,
        duration_s: f64,
    ) -> (PoseFigures, Option<(f64, ScanFigures<'py>)>, StateFigures) {
        let truth = self.world.borrow(py);
        let (world, robot) = (&truth.inner, &mut self.inner);
        let command = Command {
            speed_mps,
            turn_rate_radps,
        };
        let seen = py.detach(|| robot.step(world, command, duration_s));
        let scan = seen.scan.map(|(taken_s, scan)| (taken_s, scan_figures(py, scan)));
        (pose_figures(&seen.pose), scan, state_figures(&seen.body))
    }

    fn scan<'py>(&mut self, py: Python<'py>) -> ScanFigures<'py> {
        let truth = self.world.borrow(py);
        scan_figures(py, self.inner.scan(&truth.inner))
    }

    fn sonar<'py>(&mut self, py: Python<'py>) -> Vec<ScanFigures<'py>> {
        let truth = self.world.borrow(py);
        let scans = self.inner.sonar(&truth.inner);
        scans.into_iter().map(|scan| scan_figures(py, scan)).collect()
    }

    fn probe(&mut self, py: Python<'_>) -> ReadingFigures {
        let truth = self.world.borrow(py);
        let (world, robot) = (&truth.inner, &mut self.inner);
        reading_figures(py.detach(|| robot.probe(world)))
    }

    fn is_in(&self, world: &Bound<'_, SimWorld>) -> bool {
        self.world.is(world)
    }

    fn pose(&self) -> PoseFigures {
        pose_figures(&self.inner.pose())
    }

    fn state(&self) -> StateFigures {
        state_figures(self.inner.state())
    }
}
