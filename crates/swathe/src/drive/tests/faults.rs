//! Sensors that lie, poses that jump, and switches that are off: what the robot makes of them while it drives.

use std::f64::consts::PI;

use rstest::rstest;

use super::world::{Setup, World, car, jackal, region, step};
use crate::drive::{DriveParams, Event, Method, Navigator, Reason, Recovery, Status};
use crate::grid::Position;
use crate::local::Evidence;
use crate::sensor::{Mount, Pose, Scan};

fn post() -> World {
    World {
        discs: vec![(7.0, 3.0, 1.0)],
        walls: Vec::new(),
    }
}

fn to_the_east() -> Navigator {
    Navigator::new(&jackal(), Position::new(20.0, 0.0), None, DriveParams::default()).unwrap()
}

#[rstest]
fn a_scan_that_is_repeated_stops_the_robot_whatever_beams_it_had_lost(
    #[values(vec![], vec![0], vec![3, 60, 90, 180])] lost: Vec<usize>,
    #[values(false, true)] is_second_sensor: bool,
) {
    let mount = Mount::default();
    let mut scan = post().scan(&Pose::default(), mount, 181, PI, 8.0);
    for beam in lost {
        scan.ranges_m[beam] = f64::NAN;
    }
    let mut navigator = to_the_east();
    let mut status = Status::Driving;
    for k in 0..30 {
        let (time_s, pose) = (f64::from(k) * 0.1, Pose::level(f64::from(k) * 0.1, 0.0, 0.0));
        if is_second_sensor {
            let _ = navigator.sense(time_s, &pose, &scan, 0.0);
            status = step(&mut navigator, time_s, pose, None).status;
        } else {
            status = step(&mut navigator, time_s, pose, Some(&scan)).status;
        }
    }
    assert_eq!((status, navigator.reason()), (Status::Fault, Reason::FrozenScan));
}

#[test]
fn two_further_lasers_that_see_alike_are_not_taken_for_one_that_repeats_itself() {
    let (left, right) = (
        Mount {
            y_m: 0.2,
            ..Mount::default()
        },
        Mount {
            y_m: -0.2,
            ..Mount::default()
        },
    );
    let world = post();
    let mut navigator = to_the_east();
    for k in 0..30 {
        let (time_s, pose) = (f64::from(k) * 0.1, Pose::level(f64::from(k) * 0.1, 0.0, 0.0));
        let ranges_m = world.scan(&pose, Mount::default(), 181, PI, 8.0).ranges_m;
        for mount in [left, right] {
            let scan = Scan {
                ranges_m: ranges_m.clone(),
                ..world.scan(&pose, mount, 181, PI, 8.0)
            };
            assert_eq!(navigator.sense(time_s, &pose, &scan, 0.0), Ok(()));
        }
        assert_eq!(step(&mut navigator, time_s, pose, None).status, Status::Driving);
    }
}

#[rstest]
fn what_a_clock_that_runs_ahead_has_seen_grows_old_all_the_same(#[values(0.3, 1e6)] ahead_s: f64) {
    let mut navigator = to_the_east();
    let clear = World::default().scan(&Pose::default(), Mount::default(), 181, PI, 8.0);
    navigator.sense(ahead_s, &Pose::default(), &clear, 0.0).unwrap();
    let told: Vec<_> = (0..20)
        .map(|k| step(&mut navigator, f64::from(k) * 0.1, Pose::default(), None))
        .collect();
    assert!(told[0].speed_mps > 0.0);
    assert_eq!((told[19].status, told[19].speed_mps), (Status::Fault, 0.0));
    assert_eq!(navigator.reason(), Reason::StaleScan);
}

#[test]
fn a_scan_that_was_refused_is_not_used_because_another_sensor_saw_something_just_then() {
    let params = DriveParams {
        method: Method::Player,
        ..DriveParams::default()
    };
    let mut navigator = Navigator::new(&jackal(), Position::new(20.0, 0.0), None, params).unwrap();
    let clear = World::default().scan(&Pose::default(), Mount::default(), 181, PI, 8.0);
    navigator.sense(0.0, &Pose::default(), &clear, 0.0).unwrap();
    let beyond_all_round = Scan {
        ranges_m: vec![8.0; 1000],
        ..clear
    };
    step(&mut navigator, 0.0, Pose::default(), Some(&beyond_all_round));
    let refused = Event::ScanRefused {
        reason: Reason::BadScan,
    };
    assert!(navigator.events().contains(&refused));
    // Player's method sees scans alone, and has had none.
    assert!(navigator.histogram().is_none_or(|seen| seen.direction_rad.is_none()));
}

#[rstest]
#[case(jackal(), PI)]
#[case(jackal(), -2.0)]
#[case(car(), 2.0)]
fn a_heading_that_jumps_stops_the_robot_once(#[case] vehicle: crate::vehicle::Vehicle, #[case] by_rad: f64) {
    let mut navigator = Navigator::new(&vehicle, Position::new(20.0, 0.0), None, DriveParams::default()).unwrap();
    let world = post();
    let scan = |heading_rad| world.scan(&Pose::level(0.0, 0.0, heading_rad), Mount::default(), 181, PI, 8.0);
    assert_eq!(
        step(&mut navigator, 0.0, Pose::default(), Some(&scan(0.0))).status,
        Status::Driving
    );
    let turned = Pose::level(0.0, 0.0, by_rad);
    let told = step(&mut navigator, 0.1, turned, Some(&scan(by_rad)));
    assert_eq!(
        (told.status, told.speed_mps, navigator.reason()),
        (Status::Fault, 0.0, Reason::PoseJumped)
    );
    let jump = |event: &&Event| matches!(event, Event::PoseJump { distance_m, turn_rad } if *distance_m == 0.0 && (turn_rad.abs() - by_rad.abs()).abs() < 1e-9);
    assert_eq!(navigator.events().iter().filter(jump).count(), 1);
    assert_ne!(
        step(&mut navigator, 0.2, turned, Some(&scan(by_rad))).status,
        Status::Fault
    );
}

#[rstest]
fn a_robot_that_finds_itself_on_no_go_ground_leaves_it_and_keeps_off_the_rest(#[values(true, false)] recover: bool) {
    // It starts on a disc of no-go ground; another lies across the straight way.
    let off = |x: f64, y: f64| x.hypot(y) < 4.0 || (x - 14.0).hypot(y) < 3.0;
    let world = World::default();
    let mut setup = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (25.0, 0.0));
    setup.region = Some(region(move |x, y| if off(x, y) { 1 } else { 8 }));
    setup.params.recover = recover;
    let drive = setup.drive();
    assert_eq!(drive.status, Status::Reached);
    assert_eq!(drive.statuses, [Status::Recovering, Status::Driving, Status::Reached]);
    assert!(drive.metres > 26.0, "{}", drive.metres);
}

#[rstest]
fn a_robot_that_slides_onto_no_go_ground_leaves_it_and_says_why(#[values(true, false)] recover: bool) {
    let world = World::default();
    let params = DriveParams {
        recover,
        ..DriveParams::default()
    };
    let ground = region(|x, y| {
        if (6.0..12.0).contains(&x) && y.abs() < 8.0 {
            1
        } else {
            8
        }
    });
    let mut navigator = Navigator::new(&jackal(), Position::new(25.0, 0.0), Some(ground), params).unwrap();
    // The pose goes where it wants, whatever was told.
    let begun = (0..75).find_map(|k| {
        let pose = Pose::level(1.0 + 0.12 * f64::from(k), 0.0, 0.0);
        let scan = world.scan(&pose, Mount::default(), 181, PI, 8.0);
        let status = step(&mut navigator, 0.1 * f64::from(k), pose, Some(&scan)).status;
        let recovery = navigator.events().iter().find_map(|event| match event {
            Event::Recovery { recovery, .. } => Some(*recovery),
            _ => None,
        })?;
        Some((recovery, status, navigator.reason()))
    });
    let (recovery, status, reason) = begun.unwrap();
    assert_eq!((status, reason), (Status::Recovering, Reason::GroundNoGo));
    // One that must not recover from traps drives straight to the nearest nest.
    assert_eq!(matches!(recovery, Recovery::BackOff { .. }), recover, "{recovery:?}");
    assert_eq!(matches!(recovery, Recovery::Retreat { .. }), !recover, "{recovery:?}");
}

#[rstest]
fn every_method_drives_on_between_scans_that_come_less_often_than_steps(
    #[values(Method::Vfh, Method::VfhPlus, Method::VfhStar, Method::Player)] method: Method,
) {
    let world = World::default();
    let drive = |every: usize| {
        let mut setup = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (12.0, 0.0));
        setup.seconds = 30.0;
        setup.params = DriveParams {
            method,
            memory: false,
            recover: false,
            ..DriveParams::default()
        };
        setup.drive_with(|step, scan, _| {
            if step % every != 0 {
                *scan = None;
            }
        })
    };
    let (often, seldom) = (drive(1), drive(4));
    assert_eq!((often.status, seldom.status), (Status::Reached, Status::Reached));
    assert!(
        seldom.seconds < 2.0 * often.seconds,
        "{} {}",
        seldom.seconds,
        often.seconds
    );
}

#[rstest]
fn what_stood_in_the_way_is_forgotten_when_evidence_fades(
    #[values(Evidence::himm(), Evidence::default())] evidence: Evidence,
) {
    // A wall across; from then on nobody looks there any more, as the beams that would clear it are lost.
    let wall = World::with_walls(&[&[(4.0, -6.0), (4.0, 6.0)]]);
    let way_m = |fade_s: f64| {
        let params = DriveParams {
            evidence,
            fade_s,
            ..DriveParams::default()
        };
        let mut navigator = Navigator::new(&jackal(), Position::new(8.0, 0.0), None, params).unwrap();
        let seen = wall.scan(&Pose::default(), Mount::default(), 181, PI, 8.0);
        let mut lost = seen.clone();
        lost.ranges_m.fill(f64::NAN);
        lost.ranges_m[0] = 1.0;
        let mut lengths = Vec::new();
        for k in 0..300 {
            // Slightly off each time, as no two scans are the same.
            let mut scan = if k < 20 { seen.clone() } else { lost.clone() };
            scan.ranges_m[0] += 1e-9 * f64::from(k);
            step(&mut navigator, 0.1 * f64::from(k), Pose::default(), Some(&scan));
            lengths.push(
                navigator
                    .way()
                    .windows(2)
                    .map(|pair| pair[0].distance_m(pair[1]))
                    .sum::<f64>(),
            );
        }
        (lengths[19], lengths[299])
    };
    let (around_m, still_m) = way_m(f64::INFINITY);
    assert!(around_m > 11.0 && still_m > 11.0, "{around_m} {still_m}");
    let (around_m, straight_m) = way_m(5.0);
    assert!(around_m > 11.0 && straight_m < 10.0, "{around_m} {straight_m}");
}
