//! Drives through 30 by 30 m with 40 discs, with 181 beams and map memory.

use std::f64::consts::PI;

use swathe::drive::{Command, DriveParams, Navigator, Observation, Region, Status};
use swathe::grid::{GridGeometry, Layer, Position};
use swathe::random::{philox, unit};
use swathe::sensor::{Mount, Pose, Scan, wrap};
use swathe::vehicle::{RunningGear, Vehicle, Wheels};

fn jackal() -> Vehicle {
    Vehicle {
        length_m: 0.508,
        width_m: 0.43,
        ground_clearance_m: 0.065,
        mass_kg: 17.0,
        max_speed_mps: 2.0,
        min_turn_radius_m: 0.0,
        reaction_time_s: 0.3,
        sight_distance_m: 10.0,
        grade_up: 0.35,
        grade_down: 0.35,
        side_slope: 0.27,
        step_height_m: 0.05,
        power_w: 500.0,
        drive_efficiency: 0.55,
        idle_power_w: 34.0,
        braking_friction: 0.6,
        traction_friction: 0.6,
        manual_transmission: false,
        running_gear: RunningGear::Wheels(Wheels {
            count: 4,
            diameter_m: 0.194,
            width_m: 0.04,
            section_height_m: 0.03,
            deflection_m: 0.006,
            chains: false,
        }),
        measured_cone_index_kpa: None,
        gauge_m: None,
        centre_of_gravity_m: None,
    }
}

fn range_m(discs: &[[f64; 3]], pose: &Pose, angle_rad: f64) -> f64 {
    let (sin, cos) = angle_rad.sin_cos();
    let mut least_m = f64::INFINITY;
    for &[x, y, r] in discs {
        let (dx, dy) = (x - pose.x_m, y - pose.y_m);
        let (along, aside) = (dx * cos + dy * sin, dy * cos - dx * sin);
        if aside.abs() < r && along > 0.0 {
            least_m = least_m.min(along - (r * r - aside * aside).sqrt());
        }
    }
    if least_m < 8.0 { least_m } else { f64::INFINITY }
}

/// A map of 2 m cells around the world: rolling ground, some no-go patches, a route.
fn map(seed: u64) -> Region {
    let geometry = GridGeometry::new(40, 40, 2.0, -25.0, 40.0).expect("a grid");
    let heights = GridGeometry::new(80, 80, 1.0, -25.0, 40.0).expect("a grid");
    let ranks = geometry.cells().map(|cell| {
        let (place, drawn) = (
            geometry.centre(cell),
            unit(philox([cell.row as u32, cell.column as u32, 0, 1], seed)[0]),
        );
        let is_free = (place.x_m - 1.0).hypot(place.y_m) < 5.0 || (place.x_m - 28.0).hypot(place.y_m) < 5.0;
        if !is_free && drawn < 0.03 {
            1
        } else {
            5 + (drawn * 5.0) as u8
        }
    });
    let height = |cell| {
        let place: Position = heights.centre(cell);
        (0.3 * (place.x_m / 6.0).sin() + 0.3 * (place.y_m / 5.0).cos()) as f32
    };
    Region {
        ranks: Layer::new(geometry, ranks.collect(), "the ranks").expect("as many as cells"),
        elevation_m: Some(
            Layer::new(heights, heights.cells().map(height).collect(), "the heights").expect("as many as cells"),
        ),
        route: (0..28).map(|x| Position::new(f64::from(x), 0.0)).collect(),
        grids: None,
    }
}

/// Drives through the world of a seed for a number of steps at most; `call` is given the navigator and what it observes, and returns
/// its command. Returns the steps taken.
pub fn drive(
    seed: u64,
    has_map: bool,
    most_steps: u32,
    mut call: impl FnMut(&mut Navigator, &Observation) -> Command,
) -> u32 {
    let draw = |i: u32| philox([i, 0, 0, 0], seed).map(unit);
    let discs: Vec<[f64; 3]> = (0..40)
        .map(|i| [draw(i)[0] * 30.0, (draw(i)[1] - 0.5) * 30.0, 0.2 + 0.6 * draw(i)[2]])
        .filter(|&[x, y, r]| (x - 1.0).hypot(y) > r + 1.0 && (x - 28.0).hypot(y) > r + 1.0)
        .collect();
    let region = has_map.then(|| map(seed));
    let mut navigator =
        Navigator::new(&jackal(), Position::new(28.0, 0.0), region, DriveParams::default()).expect("usable");
    let (mut pose, mut speed_mps) = (Pose::level(1.0, 0.0, 0.0), 0.0);
    for step in 0..most_steps {
        let beam_rad = |beam: i32| pose.heading_rad + f64::from(beam - 90) * PI / 180.0;
        let scan = Scan {
            ranges_m: (0..181).map(|beam| range_m(&discs, &pose, beam_rad(beam))).collect(),
            angle_min_rad: -PI / 2.0,
            angle_increment_rad: PI / 180.0,
            range_min_m: 0.01,
            range_max_m: 8.0,
            mount: Mount::default(),
        };
        let command = call(
            &mut navigator,
            &Observation {
                time_s: f64::from(step) / 35.0,
                pose,
                speed_mps,
                turn_rate_radps: 0.0,
                scan: Some(&scan),
                reading: None,
            },
        );
        if command.status == Status::Reached {
            return step + 1;
        }
        speed_mps = command.speed_mps;
        pose.heading_rad = wrap(pose.heading_rad + command.turn_rate_radps / 35.0);
        pose.x_m += speed_mps * pose.heading_rad.cos() / 35.0;
        pose.y_m += speed_mps * pose.heading_rad.sin() / 35.0;
    }
    most_steps
}
