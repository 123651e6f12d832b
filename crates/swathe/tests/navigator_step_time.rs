//! How long a step of the navigator takes, in a world of 30 by 30 m with 40 discs, 181 beams and map memory. Not run by
//! `cargo test`: `cargo test --release -p swathe --test navigator_step_time -- --ignored --nocapture`.

use std::f64::consts::PI;
use std::time::Instant;

use swathe::drive::{DriveParams, Navigator, Observation, Status};
use swathe::grid::Position;
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

#[test]
#[ignore = "a measurement"]
fn step_time() {
    let mut times_us = Vec::new();
    for seed in 0..12 {
        let draw = |i: u32| philox([i, 0, 0, 0], seed).map(unit);
        let discs: Vec<[f64; 3]> = (0..40)
            .map(|i| [draw(i)[0] * 30.0, (draw(i)[1] - 0.5) * 30.0, 0.2 + 0.6 * draw(i)[2]])
            .filter(|&[x, y, r]| (x - 1.0).hypot(y) > r + 1.0 && (x - 28.0).hypot(y) > r + 1.0)
            .collect();
        let mut navigator =
            Navigator::new(&jackal(), Position::new(28.0, 0.0), None, DriveParams::default()).expect("usable");
        let (mut pose, mut speed_mps) = (Pose::level(1.0, 0.0, 0.0), 0.0);
        for step in 0..3000 {
            let time_s = f64::from(step) / 35.0;
            let beam_rad = |beam: i32| pose.heading_rad + f64::from(beam - 90) * PI / 180.0;
            let scan = Scan {
                ranges_m: (0..181).map(|beam| range_m(&discs, &pose, beam_rad(beam))).collect(),
                angle_min_rad: -PI / 2.0,
                angle_increment_rad: PI / 180.0,
                range_min_m: 0.01,
                range_max_m: 8.0,
                mount: Mount::default(),
            };
            let started = Instant::now();
            let command = navigator.step(&Observation {
                time_s,
                pose,
                speed_mps,
                turn_rate_radps: 0.0,
                scan: Some(&scan),
                reading: None,
            });
            times_us.push(started.elapsed().as_secs_f64() * 1e6);
            if command.status == Status::Reached {
                break;
            }
            speed_mps = command.speed_mps;
            pose.heading_rad = wrap(pose.heading_rad + command.turn_rate_radps / 35.0);
            pose.x_m += speed_mps * pose.heading_rad.cos() / 35.0;
            pose.y_m += speed_mps * pose.heading_rad.sin() / 35.0;
        }
    }
    times_us.sort_by(f64::total_cmp);
    let at = |share: f64| times_us[(share * (times_us.len() - 1) as f64) as usize];
    println!(
        "{} steps: median {:.0} us, 90 % {:.0} us, 99 % {:.0} us, most {:.0} us",
        times_us.len(),
        at(0.5),
        at(0.9),
        at(0.99),
        at(1.0)
    );
}
