//! Input that nobody should give.

use super::world::{World, car, jackal, step};
use crate::drive::{DriveParams, Event, Navigator, Observation, Reason, Region, Status};
use crate::grid::{GridGeometry, Layer, Position};
use crate::sensor::{Mount, PenetrometerReading, Pose, Scan};
use proptest::prelude::*;
use std::f64::consts::PI;

fn navigator() -> Navigator {
    Navigator::new(&jackal(), Position::new(20.0, 0.0), None, DriveParams::default()).unwrap()
}

fn clear_scan() -> Scan {
    World::default().scan(&Pose::default(), Mount::default(), 181, PI, 8.0)
}

#[test]
fn nothing_moves_before_the_first_scan() {
    let mut navigator = navigator();
    let command = step(&mut navigator, 0.0, Pose::default(), None);
    assert_eq!((command.speed_mps, command.turn_rate_radps), (0.0, 0.0));
    assert_eq!((command.status, navigator.reason()), (Status::Fault, Reason::NoScanYet));
    assert!(step(&mut navigator, 0.1, Pose::default(), Some(&clear_scan())).speed_mps > 0.0);
}

#[test]
fn scans_that_say_nothing_move_nothing() {
    let ranges: [(Vec<f64>, Reason); 5] = [
        (Vec::new(), Reason::BadScan),
        (vec![f64::NAN; 181], Reason::BlindScan),
        (vec![0.0; 181], Reason::BlindScan),
        (vec![f64::NEG_INFINITY; 181], Reason::BlindScan),
        (vec![8.0; 1000], Reason::BadScan),
    ];
    for (ranges_m, reason) in ranges {
        let mut navigator = navigator();
        let scan = Scan {
            ranges_m,
            ..clear_scan()
        };
        let command = step(&mut navigator, 0.0, Pose::default(), Some(&scan));
        assert_eq!((command.speed_mps, command.status), (0.0, Status::Fault));
        assert_eq!(navigator.reason(), reason);
        assert!(navigator.events().contains(&Event::ScanRefused { reason }));
    }
    // All at the greatest range is clear ground.
    let mut navigator = navigator();
    let scan = Scan {
        ranges_m: vec![8.0; 181],
        ..clear_scan()
    };
    assert!(step(&mut navigator, 0.0, Pose::default(), Some(&scan)).speed_mps > 0.0);
}

#[test]
fn a_frozen_scan_stops_a_robot_that_moves() {
    let mut world = World::default();
    world.discs.push((7.0, 3.0, 1.0));
    let scan = world.scan(&Pose::default(), Mount::default(), 181, PI, 8.0);
    let mut navigator = navigator();
    let mut status = Status::Driving;
    for k in 0..30 {
        let pose = Pose::level(f64::from(k) * 0.1, 0.0, 0.0);
        status = step(&mut navigator, f64::from(k) * 0.1, pose, Some(&scan)).status;
    }
    assert_eq!((status, navigator.reason()), (Status::Fault, Reason::FrozenScan));
}

#[test]
fn clock_and_pose_that_jump_stop_the_robot_once() {
    let scan = clear_scan();
    let mut navigator = navigator();
    assert!(step(&mut navigator, 10.0, Pose::default(), Some(&scan)).speed_mps > 0.0);
    let late = step(&mut navigator, 9.0, Pose::default(), Some(&scan));
    assert_eq!(
        (late.status, navigator.reason()),
        (Status::Fault, Reason::ClockWentBack)
    );
    assert!(step(&mut navigator, 9.1, Pose::default(), Some(&scan)).speed_mps > 0.0);
    let jump = step(&mut navigator, 9.2, Pose::level(50.0, 0.0, 0.0), Some(&scan));
    assert_eq!((jump.status, navigator.reason()), (Status::Fault, Reason::PoseJumped));
    assert!(
        matches!(navigator.events()[0], Event::PoseJump { distance_m, turn_rad } if (distance_m, turn_rad) == (50.0, 0.0))
    );
    let after = step(&mut navigator, 9.3, Pose::level(50.0, 0.0, 0.0), Some(&scan));
    assert_eq!(after.status, Status::Driving);
}

#[test]
fn goals_and_parameters_that_cannot_be_are_refused() {
    for goal in [f64::NAN, f64::INFINITY, 1e12] {
        let goal = Position::new(goal, 0.0);
        assert!(Navigator::new(&jackal(), goal, None, DriveParams::default()).is_err());
        assert!(navigator().set_goal(goal).is_err());
    }
    for spoil in [
        |params: &mut DriveParams| params.arrival_m = f64::NAN,
        |params: &mut DriveParams| params.braking_mps2 = 0.0,
        |params: &mut DriveParams| params.window_cells = 1,
        |params: &mut DriveParams| params.unknown_cost = 0.5,
    ] {
        let mut params = DriveParams::default();
        spoil(&mut params);
        assert!(Navigator::new(&jackal(), Position::new(1.0, 1.0), None, params).is_err());
    }
}

#[test]
fn readings_are_handed_on_and_their_ranks_taken_in() {
    let geometry = GridGeometry::new(20, 20, 2.0, -20.0, 20.0).unwrap();
    let region = Region {
        ranks: Layer::filled(geometry, 8),
        elevation_m: None,
        route: Vec::new(),
        grids: None,
    };
    let params = DriveParams::default();
    let mut navigator = Navigator::new(&jackal(), Position::new(15.0, 0.0), Some(region), params).unwrap();
    let reading = PenetrometerReading {
        x_m: 1.0,
        y_m: 0.0,
        depths_m: vec![0.1],
        cone_indices_kpa: vec![5.0],
        refusal_depth_m: None,
        sleeve_frictions_kpa: None,
    };
    let scan = clear_scan();
    let mut hand = |reading: &PenetrometerReading| {
        let seen = Observation {
            time_s: 0.0,
            pose: Pose::default(),
            speed_mps: 0.0,
            turn_rate_radps: 0.0,
            scan: Some(&scan),
            reading: Some(reading),
        };
        navigator.step(&seen);
        navigator.events().to_vec()
    };
    // Finished ranks cannot learn.
    assert!(hand(&reading).contains(&Event::ReadingRefused));
    let unusable = PenetrometerReading {
        cone_indices_kpa: vec![f64::NAN],
        ..reading
    };
    assert!(hand(&unusable).contains(&Event::ReadingRefused));
}

/// A figure as a broken driver may give it: often sensible, sometimes not.
fn figure(least: f64, most: f64) -> impl Strategy<Value = f64> {
    prop_oneof![8 => least..most, 1 => prop::num::f64::ANY, 1 => Just(0.0)]
}

fn any_scan() -> impl Strategy<Value = Scan> {
    let figures = (
        figure(-3.2, 3.2),
        figure(-0.1, 0.1),
        figure(0.0, 0.5),
        figure(1.0, 30.0),
    );
    let mount = (figure(-0.5, 0.5), figure(-0.5, 0.5), figure(-3.2, 3.2));
    (prop::collection::vec(figure(0.0, 12.0), 0..60), figures, mount).prop_map(|(ranges_m, figures, mount)| Scan {
        ranges_m,
        angle_min_rad: figures.0,
        angle_increment_rad: figures.1,
        range_min_m: figures.2,
        range_max_m: figures.3,
        mount: Mount {
            x_m: mount.0,
            y_m: mount.1,
            heading_rad: mount.2,
        },
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn no_input_breaks_a_step_or_gets_a_command_beyond_the_limits(
        steps in prop::collection::vec(
            (figure(0.0, 0.3), figure(-1.0, 1.0), figure(-1.0, 1.0), figure(-4.0, 4.0), (figure(-0.3, 0.3), figure(-0.3, 0.3)),
             figure(-3.0, 3.0), prop::option::weighted(0.9, any_scan())),
            1..25,
        ),
        is_car: bool, has_region: bool,
    ) {
        let vehicle = if is_car { car() } else { jackal() };
        let region = has_region.then(|| {
            let geometry = GridGeometry::new(24, 24, 2.0, -24.0, 24.0).unwrap();
            let ranks = (0..geometry.cell_count()).map(|index| (index * 7 % 11) as u8).collect();
            let heights = (0..geometry.cell_count()).map(|index| (index % 5) as f32 * 0.1).collect();
            Region {
                ranks: Layer::new(geometry, ranks, "the ranks").unwrap(),
                elevation_m: Some(Layer::new(geometry, heights, "the heights").unwrap()),
                route: vec![Position::new(0.0, 0.0), Position::new(15.0, 3.0)],
                grids: None,
            }
        });
        let params = DriveParams { window_cells: 64, ..DriveParams::default() };
        let mut navigator = Navigator::new(&vehicle, Position::new(15.0, 3.0), region, params).unwrap();
        let (mut time_s, mut x_m, mut y_m) = (0.0, 0.0, 0.0);
        for (step_s, east, north, heading_rad, (pitch_rad, roll_rad), speed_mps, scan) in &steps {
            time_s += step_s;
            x_m += 0.2 * east;
            y_m += 0.2 * north;
            let pose = Pose { x_m, y_m, heading_rad: *heading_rad, pitch_rad: *pitch_rad, roll_rad: *roll_rad };
            let command = navigator.step(&Observation {
                time_s, pose, speed_mps: *speed_mps, turn_rate_radps: *speed_mps, scan: scan.as_ref(), reading: None,
            });
            prop_assert!(command.speed_mps.abs() <= vehicle.max_speed_mps);
            prop_assert!(command.turn_rate_radps.abs() <= params.max_turn_rate_radps);
            if is_car {
                prop_assert!(command.turn_rate_radps.abs() <= command.speed_mps.abs() / vehicle.min_turn_radius_m + 1e-9);
            }
            // A broken clock or pose need not last.
            if !time_s.is_finite() { time_s = 0.0; }
            if !(x_m.is_finite() && y_m.is_finite()) { (x_m, y_m) = (0.0, 0.0); }
        }
    }
}
