//! A world of discs and walls, and a robot that obeys its vehicle's limits in it. Only for tests.

use std::f64::consts::PI;

use crate::drive::{Command, DriveParams, Navigator, Observation, Region, Status};
use crate::grid::{GridGeometry, Layer, Position};
use crate::random::{philox, unit};
use crate::sensor::{Mount, Pose, Scan, wrap};
use crate::vehicle::{RunningGear, Vehicle, Wheels};

/// Seconds between steps of the navigator, and of the robot's motion.
pub const STEP_S: f64 = 0.1;
const MOTION_S: f64 = 0.02;

#[derive(Clone, Debug, Default)]
pub struct World {
    /// East, north, radius.
    pub discs: Vec<(f64, f64, f64)>,
    /// From and to.
    pub walls: Vec<[(f64, f64); 2]>,
}

pub fn vehicle(length_m: f64, width_m: f64, max_speed_mps: f64, min_turn_radius_m: f64) -> Vehicle {
    Vehicle {
        length_m,
        width_m,
        ground_clearance_m: 0.1,
        mass_kg: 20.0,
        max_speed_mps,
        min_turn_radius_m,
        reaction_time_s: 0.3,
        sight_distance_m: 10.0,
        grade_up: 0.3,
        grade_down: 0.3,
        side_slope: 0.2,
        step_height_m: 0.05,
        power_w: 500.0,
        drive_efficiency: 0.6,
        idle_power_w: 30.0,
        braking_friction: 0.6,
        traction_friction: 0.6,
        manual_transmission: false,
        running_gear: RunningGear::Wheels(Wheels {
            count: 4,
            diameter_m: 0.2,
            width_m: 0.05,
            section_height_m: 0.03,
            deflection_m: 0.005,
            chains: false,
        }),
        measured_cone_index_kpa: None,
        gauge_m: None,
        centre_of_gravity_m: None,
    }
}

pub fn jackal() -> Vehicle {
    vehicle(0.508, 0.43, 2.0, 0.0)
}

pub fn pioneer() -> Vehicle {
    vehicle(0.44, 0.38, 0.7, 0.0)
}

pub fn car() -> Vehicle {
    vehicle(3.0, 1.6, 3.0, 4.0)
}

impl World {
    /// Discs strewn over a rectangle, none near the points to keep free.
    pub fn strewn(seed: u64, count: u32, size_m: (f64, f64), radii_m: (f64, f64), keep: &[(f64, f64, f64)]) -> Self {
        let mut discs = Vec::new();
        for i in 0..count {
            let draw = philox([i, 0, 0, 0], seed).map(unit);
            let disc = (
                draw[0] * size_m.0,
                (draw[1] - 0.5) * size_m.1,
                radii_m.0 + draw[2] * (radii_m.1 - radii_m.0),
            );
            if keep
                .iter()
                .all(|&(x, y, free_m)| (disc.0 - x).hypot(disc.1 - y) > free_m + disc.2)
            {
                discs.push(disc);
            }
        }
        Self {
            discs,
            walls: Vec::new(),
        }
    }

    pub fn with_walls(points: &[&[(f64, f64)]]) -> Self {
        let walls = points
            .iter()
            .flat_map(|line| line.windows(2).map(|pair| [pair[0], pair[1]]));
        Self {
            discs: Vec::new(),
            walls: walls.collect(),
        }
    }

    fn range_m(&self, x: f64, y: f64, angle: f64, most_m: f64) -> f64 {
        let (sin, cos) = angle.sin_cos();
        let mut range_m = f64::INFINITY;
        for &(cx, cy, r) in &self.discs {
            let (dx, dy) = (cx - x, cy - y);
            let along = dx * cos + dy * sin;
            let aside = dy * cos - dx * sin;
            if aside.abs() < r && along > 0.0 {
                range_m = range_m.min((along - (r * r - aside * aside).sqrt()).max(0.0));
            }
        }
        for &[(ax, ay), (bx, by)] in &self.walls {
            let (ex, ey) = (bx - ax, by - ay);
            let across = cos * ey - sin * ex;
            if across.abs() > 1e-12 {
                let (dx, dy) = (ax - x, ay - y);
                let along = (dx * ey - dy * ex) / across;
                let share = (dx * sin - dy * cos) / across;
                if along > 0.0 && (0.0..=1.0).contains(&share) {
                    range_m = range_m.min(along);
                }
            }
        }
        if range_m < most_m { range_m } else { f64::INFINITY }
    }

    pub fn scan(&self, pose: &Pose, mount: Mount, beams: usize, fan_rad: f64, most_m: f64) -> Scan {
        let sensor = pose.of_mount(&mount);
        let increment = fan_rad / (beams - 1) as f64;
        let beam = |k: usize| sensor.heading_rad - fan_rad / 2.0 + increment * k as f64;
        Scan {
            ranges_m: (0..beams)
                .map(|k| self.range_m(sensor.x_m, sensor.y_m, beam(k), most_m))
                .collect(),
            angle_min_rad: -fan_rad / 2.0,
            angle_increment_rad: increment,
            range_min_m: 0.01,
            range_max_m: most_m,
            mount,
        }
    }

    /// Metres between the footprint and the nearest obstacle, 0 when they touch.
    pub fn clearance_m(&self, pose: &Pose, vehicle: &Vehicle) -> f64 {
        let (sin, cos) = pose.heading_rad.sin_cos();
        let outside = |x: f64, y: f64| {
            let (dx, dy) = (x - pose.x_m, y - pose.y_m);
            let ahead = (cos * dx + sin * dy).abs() - vehicle.length_m / 2.0;
            let left = (cos * dy - sin * dx).abs() - vehicle.width_m / 2.0;
            ahead.max(0.0).hypot(left.max(0.0))
        };
        let mut least = f64::INFINITY;
        for &(x, y, r) in &self.discs {
            least = least.min((outside(x, y) - r).max(0.0));
        }
        for &[(ax, ay), (bx, by)] in &self.walls {
            let steps = ((bx - ax).hypot(by - ay) / 0.02).ceil().max(1.0);
            for k in 0..=steps as usize {
                let t = k as f64 / steps;
                least = least.min(outside(ax + t * (bx - ax), ay + t * (by - ay)));
            }
        }
        least
    }

    /// Whether a disc of this radius can get from one place to another: a flood over cells of 0.1 m, apart from the
    /// navigator's own search.
    pub fn passable(&self, from: (f64, f64), to: (f64, f64), radius_m: f64, size_m: (f64, f64)) -> bool {
        let size = 0.1;
        let (columns, rows) = ((size_m.0 / size) as i64 + 200, (size_m.1 / size) as i64 + 200);
        let place =
            |(row, column): (i64, i64)| (column as f64 * size - 10.0, row as f64 * size - size_m.1 / 2.0 - 10.0);
        let cell = |(x, y): (f64, f64)| (((y + size_m.1 / 2.0 + 10.0) / size) as i64, ((x + 10.0) / size) as i64);
        let point = vehicle(1e-3, 1e-3, 1.0, 0.0);
        let mut seen = vec![false; (columns * rows) as usize];
        let mut stack = vec![cell(from)];
        while let Some((row, column)) = stack.pop() {
            if !(0..rows).contains(&row) || !(0..columns).contains(&column) {
                continue;
            }
            let index = (row * columns + column) as usize;
            if std::mem::replace(&mut seen[index], true) {
                continue;
            }
            let (x, y) = place((row, column));
            if self.clearance_m(&Pose::level(x, y, 0.0), &point) < radius_m {
                continue;
            }
            if (row, column) == cell(to) {
                return true;
            }
            stack.extend([
                (row + 1, column),
                (row - 1, column),
                (row, column + 1),
                (row, column - 1),
            ]);
        }
        false
    }
}

/// Ground of 60 m by 60 m from (-10, -30) on, ranked by place.
pub fn region(rank: impl Fn(f64, f64) -> u8) -> Region {
    let geometry = GridGeometry::new(60, 60, 1.0, -10.0, 30.0).unwrap();
    let ranks = geometry.cells().map(|cell| {
        let centre = geometry.centre(cell);
        rank(centre.x_m, centre.y_m)
    });
    Region {
        ranks: Layer::new(geometry, ranks.collect(), "the ranks").unwrap(),
        elevation_m: None,
        route: Vec::new(),
        grids: None,
    }
}

/// A step of a robot that stands.
pub fn step(navigator: &mut Navigator, time_s: f64, pose: Pose, scan: Option<&Scan>) -> Command {
    navigator.step(&Observation {
        time_s,
        pose,
        speed_mps: 0.0,
        turn_rate_radps: 0.0,
        scan,
        reading: None,
    })
}

/// How a drive went.
#[derive(Debug)]
pub struct Drive {
    pub status: Status,
    pub navigator: Navigator,
    pub collided: bool,
    pub least_clearance_m: f64,
    pub seconds: f64,
    pub metres: f64,
    pub top_mps: f64,
    pub statuses: Vec<Status>,
    pub pose: Pose,
}

/// How to drive.
pub struct Setup<'a> {
    pub world: &'a World,
    pub vehicle: Vehicle,
    pub start: Pose,
    pub goal: (f64, f64),
    pub params: DriveParams,
    pub region: Option<Region>,
    pub seconds: f64,
    pub fan_rad: f64,
    pub beams: usize,
    pub range_m: f64,
}

impl<'a> Setup<'a> {
    pub fn new(world: &'a World, vehicle: Vehicle, start: (f64, f64, f64), goal: (f64, f64)) -> Self {
        Self {
            world,
            vehicle,
            start: Pose::level(start.0, start.1, start.2),
            goal,
            params: DriveParams::default(),
            region: None,
            seconds: 240.0,
            fan_rad: PI,
            beams: 181,
            range_m: 10.0,
        }
    }

    pub fn drive(self) -> Drive {
        self.drive_with(|_, _, _| {})
    }

    /// Drives; `spoil` may change what the navigator is given (step, scan as `None` when it is lost, measured speed).
    pub fn drive_with(self, mut spoil: impl FnMut(usize, &mut Option<Scan>, &mut f64)) -> Drive {
        let goal = Position::new(self.goal.0, self.goal.1);
        let navigator = Navigator::new(&self.vehicle, goal, self.region.clone(), self.params).unwrap();
        let mut drive = Drive {
            status: Status::Driving,
            navigator,
            collided: false,
            least_clearance_m: f64::INFINITY,
            seconds: 0.0,
            metres: 0.0,
            top_mps: 0.0,
            statuses: Vec::new(),
            pose: self.start,
        };
        let mount = Mount {
            x_m: self.vehicle.length_m / 2.0 - 0.05,
            ..Mount::default()
        };
        let (mut speed, mut turn) = (0.0f64, 0.0f64);
        let mut waiting = 0;
        for step in 0..(self.seconds / STEP_S) as usize {
            let mut scan = Some(
                self.world
                    .scan(&drive.pose, mount, self.beams, self.fan_rad, self.range_m),
            );
            let mut measured = speed;
            spoil(step, &mut scan, &mut measured);
            let command = drive.navigator.step(&Observation {
                time_s: step as f64 * STEP_S,
                pose: drive.pose,
                speed_mps: measured,
                turn_rate_radps: turn,
                scan: scan.as_ref(),
                reading: None,
            });
            self.check(&command);
            if drive.statuses.last() != Some(&command.status) {
                drive.statuses.push(command.status);
            }
            drive.status = command.status;
            drive.seconds = step as f64 * STEP_S;
            let mut left_s = STEP_S;
            while left_s > 1e-9 {
                self.obey(&command, &mut speed, &mut turn);
                let pose = &mut drive.pose;
                pose.heading_rad = wrap(pose.heading_rad + turn * MOTION_S);
                pose.x_m += speed * pose.heading_rad.cos() * MOTION_S;
                pose.y_m += speed * pose.heading_rad.sin() * MOTION_S;
                drive.metres += speed.abs() * MOTION_S;
                left_s -= MOTION_S;
            }
            drive.top_mps = drive.top_mps.max(speed);
            let clearance_m = self.world.clearance_m(&drive.pose, &self.vehicle);
            drive.least_clearance_m = drive.least_clearance_m.min(clearance_m);
            drive.collided |= clearance_m <= 0.0;
            match command.status {
                Status::Reached | Status::Stopped => waiting += 30,
                Status::NoRoute => waiting += 1,
                _ => waiting = 0,
            }
            if waiting > 100 || drive.collided {
                break;
            }
        }
        drive
    }

    fn obey(&self, command: &Command, speed: &mut f64, turn: &mut f64) {
        let slower = command.speed_mps.abs() < speed.abs() || command.speed_mps * *speed < 0.0;
        let limit = if slower {
            self.params.braking_mps2
        } else {
            self.params.acceleration_mps2
        };
        *speed += (command.speed_mps - *speed).clamp(-limit * MOTION_S, limit * MOTION_S);
        // A car keeps the curvature that it is told, whatever its speed.
        let wanted = if self.vehicle.min_turn_radius_m > 0.0 {
            let curvature = if command.speed_mps.abs() > 1e-6 {
                command.turn_rate_radps / command.speed_mps
            } else {
                0.0
            };
            curvature * *speed
        } else {
            command.turn_rate_radps
        };
        *turn += (wanted - *turn).clamp(-6.0 * MOTION_S, 6.0 * MOTION_S);
    }

    fn check(&self, command: &Command) {
        assert!(command.speed_mps.is_finite() && command.turn_rate_radps.is_finite());
        assert!(command.speed_mps.abs() <= self.vehicle.max_speed_mps);
        assert!(command.turn_rate_radps.abs() <= self.params.max_turn_rate_radps);
        if self.vehicle.min_turn_radius_m > 0.0 {
            let most = command.speed_mps.abs() / self.vehicle.min_turn_radius_m;
            assert!(command.turn_rate_radps.abs() <= most + 1e-9);
        }
    }
}
