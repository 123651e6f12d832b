//! Long sequences of whatever may reach a navigator, by a robot that obeys it or not: commands are always numbers, always within
//! the vehicle's limits, and nothing is driven on after the senses have failed for longer than they may.

mod driving;

use driving::{car, jackal, motion};
use proptest::prelude::*;
use std::f64::consts::PI;
use swathe::drive::{DriveParams, Method, Navigator, Observation, Region, Status};
use swathe::grid::{GridGeometry, Layer, Position};
use swathe::sensor::{Mount, PenetrometerReading, Pose, Scan, wrap};

/// What happens in a step.
#[derive(Clone, Debug)]
enum Happens {
    /// A scan of a wall of this distance ahead, or of nothing.
    Scan(Option<f64>),
    /// No scan.
    Nothing,
    /// A scan with these ranges.
    Ranges(Vec<f64>),
    /// The scan of the step before, again.
    Again,
    /// The clock goes by this much instead.
    Clock(f64),
    /// The pose is off by this much from now on.
    Jump(f64, f64),
    /// The measured speed is this.
    Speed(f64),
    /// The attitude is this.
    Tilt(f64, f64),
    /// Another goal.
    Goal(f64, f64),
    /// A reading of this cone index.
    Reading(f64),
    /// A cone of a sonar.
    Sonar(f64, f64),
    /// The robot is held where it is.
    Held,
}

fn figure(least: f64, most: f64) -> impl Strategy<Value = f64> {
    prop_oneof![9 => least..most, 1 => prop::num::f64::ANY, 1 => Just(0.0), 1 => Just(f64::INFINITY)]
}

fn happens() -> impl Strategy<Value = Happens> {
    prop_oneof![
        20 => prop::option::of(0.4f64..9.0).prop_map(Happens::Scan),
        3 => Just(Happens::Nothing),
        2 => prop::collection::vec(figure(0.0, 9.0), 0..200).prop_map(Happens::Ranges),
        2 => Just(Happens::Again),
        1 => figure(-1.0, 2.0).prop_map(Happens::Clock),
        1 => (figure(-3.0, 3.0), figure(-3.0, 3.0)).prop_map(|(x, y)| Happens::Jump(x, y)),
        2 => figure(-3.0, 3.0).prop_map(Happens::Speed),
        1 => (figure(-0.3, 0.3), figure(-0.3, 0.3)).prop_map(|(pitch, roll)| Happens::Tilt(pitch, roll)),
        1 => (figure(-30.0, 30.0), figure(-30.0, 30.0)).prop_map(|(x, y)| Happens::Goal(x, y)),
        1 => figure(-10.0, 3000.0).prop_map(Happens::Reading),
        2 => (figure(0.0, 6.0), figure(0.0, 1.0)).prop_map(|(range, cone)| Happens::Sonar(range, cone)),
        2 => Just(Happens::Held),
    ]
}

fn fan(range_m: impl Fn(f64) -> f64) -> Scan {
    let angle = |beam: usize| -PI / 2.0 + beam as f64 * PI / 60.0;
    Scan {
        ranges_m: (0..61).map(|beam| range_m(angle(beam))).collect(),
        angle_min_rad: -PI / 2.0,
        angle_increment_rad: PI / 60.0,
        range_min_m: 0.05,
        range_max_m: 8.0,
        mount: Mount::default(),
    }
}

fn map() -> Region {
    let geometry = GridGeometry::new(40, 40, 2.0, -40.0, 40.0).unwrap();
    let ranks = (0..geometry.cell_count()).map(|index| if index % 29 == 0 { 1 } else { 4 + (index % 7) as u8 });
    let heights = (0..geometry.cell_count()).map(|index| (index % 5) as f32 * 0.1);
    Region {
        ranks: Layer::new(geometry, ranks.collect(), "the ranks").unwrap(),
        elevation_m: Some(Layer::new(geometry, heights.collect(), "the heights").unwrap()),
        route: vec![Position::new(0.0, 0.0), Position::new(15.0, 3.0)],
        grids: None,
    }
}

const STEP_S: f64 = 0.1;

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn whatever_happens_commands_keep_every_limit(
        steps in prop::collection::vec(happens(), 20..120),
        is_car: bool, has_map: bool, memory: bool,
        method in prop_oneof![Just(Method::Vfh), Just(Method::VfhPlus), Just(Method::VfhStar), Just(Method::Player)],
    ) {
        let vehicle = if is_car { car() } else { jackal() };
        let limits = motion(&vehicle);
        let params = DriveParams { method, memory, window_cells: 64, trap_s: 2.0, most_recoveries: 2, ..DriveParams::default() }.within(&limits);
        let mut navigator = Navigator::new(&vehicle, Position::new(15.0, 3.0), has_map.then(map), params).unwrap();
        let (mut time_s, mut pose, mut off) = (0.0, Pose::default(), (0.0, 0.0));
        let (mut told_mps, mut blind_s, mut last_s) = (0.0f64, 0.0, 0.0);
        let mut scan = fan(|_| f64::INFINITY);
        for step in &steps {
            time_s += STEP_S;
            let mut seen_speed_mps = told_mps;
            let (mut shown, mut reading, mut at_s, mut is_held) = (None, None, time_s, false);
            match step {
                Happens::Scan(wall) => {
                    scan = fan(|angle| wall.map_or(f64::INFINITY, |wall| wall / angle.cos().max(1e-3)));
                    shown = Some(scan.clone());
                }
                Happens::Nothing => {}
                Happens::Ranges(ranges) => shown = Some(Scan { ranges_m: ranges.clone(), ..fan(|_| 1.0) }),
                Happens::Again => shown = Some(scan.clone()),
                Happens::Clock(by) => at_s = time_s + by,
                Happens::Jump(x, y) => off = (off.0 + x, off.1 + y),
                Happens::Speed(speed) => seen_speed_mps = *speed,
                Happens::Tilt(pitch, roll) => (pose.pitch_rad, pose.roll_rad) = (*pitch, *roll),
                Happens::Goal(x, y) => {
                    let is_place = x.abs() <= 1e8 && y.abs() <= 1e8;
                    prop_assert_eq!(navigator.set_goal(Position::new(*x, *y)).is_ok(), is_place);
                }
                Happens::Reading(cone_index_kpa) => reading = Some(PenetrometerReading {
                    x_m: pose.x_m, y_m: pose.y_m, depths_m: vec![0.1], cone_indices_kpa: vec![*cone_index_kpa],
                    refusal_depth_m: None, sleeve_frictions_kpa: None,
                }),
                Happens::Sonar(range_m, cone_rad) => {
                    let cone = Scan { ranges_m: vec![*range_m], angle_increment_rad: 0.0, angle_min_rad: 0.0, ..fan(|_| 1.0) };
                    let place = Pose { x_m: pose.x_m + off.0, y_m: pose.y_m + off.1, ..pose };
                    if navigator.sense(time_s, &place, &cone, *cone_rad).is_ok() {
                        blind_s = 0.0;
                    }
                }
                Happens::Held => is_held = true,
            }
            let place = Pose { x_m: pose.x_m + off.0, y_m: pose.y_m + off.1, ..pose };
            let is_sighted = shown.is_some();
            let command = navigator.step(&Observation {
                time_s: at_s, pose: place, speed_mps: seen_speed_mps, turn_rate_radps: 0.0, scan: shown.as_ref(), reading: reading.as_ref(),
            });
            blind_s = if is_sighted { 0.0 } else { blind_s + STEP_S };
            // Numbers within the limits of speed, turn rate, turning circle and acceleration.
            let (speed_mps, turn_radps) = (command.speed_mps, command.turn_rate_radps);
            prop_assert!(speed_mps.abs() <= vehicle.max_speed_mps && turn_radps.abs() <= params.max_turn_rate_radps);
            if is_car {
                prop_assert!(turn_radps.abs() <= speed_mps.abs() / vehicle.min_turn_radius_m + 1e-9);
            }
            let side = speed_mps.signum();
            let before_mps = (told_mps * side).max(if seen_speed_mps.is_finite() { seen_speed_mps * side } else { 0.0 }).max(0.0);
            prop_assert!(speed_mps * side <= before_mps + limits.max_acceleration_mps2 * 1.0 + 1e-9);
            let gap_s = at_s - last_s;
            if gap_s.is_finite() && gap_s >= 0.0 {
                prop_assert!(speed_mps * side <= before_mps + limits.max_acceleration_mps2 * gap_s.max(STEP_S) + 1e-9);
            }
            if at_s.is_finite() { last_s = at_s; }
            if matches!(command.status, Status::Fault | Status::Stopped | Status::Reached | Status::NoRoute) {
                prop_assert_eq!((speed_mps, turn_radps), (0.0, 0.0));
            }
            prop_assert!(blind_s <= params.stale_s + 2.0 * STEP_S || speed_mps == 0.0, "blind for {} s at {} m/s", blind_s, speed_mps);
            told_mps = speed_mps;
            if !is_held {
                pose.heading_rad = wrap(pose.heading_rad + turn_radps * STEP_S);
                pose.x_m += speed_mps * pose.heading_rad.cos() * STEP_S;
                pose.y_m += speed_mps * pose.heading_rad.sin() * STEP_S;
            }
            // What broke the pose need not last.
            if !(off.0.abs() < 50.0 && off.1.abs() < 50.0) { off = (0.0, 0.0); }
            if !(pose.pitch_rad.abs() < 1.0 && pose.roll_rad.abs() < 1.0) { (pose.pitch_rad, pose.roll_rad) = (0.0, 0.0); }
        }
    }
}
