//! Any field of view and number of beams, and a sonar ring as the only or an additional sensor.

mod driving;

use std::f64::consts::PI;

use driving::{Drive, STEP_S, crates, ground, jackal, motion};
use rstest::rstest;
use swathe::drive::{DriveParams, Method, Navigator, Observation, Status};
use swathe::grid::Position;
use swathe::sensor::Pose;
use swathe::sim::{self, Laser, Robot, RobotParams, pioneer_sonar};

/// A laser with so many beams over so many degrees.
fn laser(beams: usize, degrees: f64) -> Laser {
    let fan_rad = degrees.to_radians();
    // A full circle does not see its first direction twice.
    let gaps = if degrees < 360.0 { (beams - 1).max(1) } else { beams };
    Laser {
        beams,
        angle_min_rad: if beams == 1 { 0.0 } else { -fan_rad / 2.0 },
        angle_increment_rad: if beams == 1 { 1.0 } else { fan_rad / gaps as f64 },
        ..Laser::sick_lms200(false, false)
    }
}

#[rstest]
#[case(1, 0.0, false)]
#[case(7, 90.0, false)]
#[case(31, 60.0, true)]
#[case(181, 180.0, true)]
#[case(361, 180.0, true)]
#[case(541, 270.0, true)]
#[case(1080, 360.0, true)]
fn any_fan_is_driven_with_and_none_is_run_into_what_it_shows(
    #[case] beams: usize,
    #[case] degrees: f64,
    #[case] arrives: bool,
    #[values(Method::Vfh, Method::VfhPlus, Method::VfhStar, Method::Player)] method: Method,
) {
    let mut world = ground(|_, _| 0.0);
    // Straight ahead: a beam that looks there sees it.
    world.place(crates(&[(9.0, 0.0)])).unwrap();
    let mut drive = Drive::new(&world, jackal(), (20.0, 0.0));
    drive.robot.laser = laser(beams, degrees);
    drive.params.method = method;
    drive.seconds = 90.0;
    let outcome = drive.run();
    assert_eq!(outcome.collisions, 0, "{}", outcome.told());
    // Player's method closes what is not measured: it needs the whole half plane ahead.
    if arrives && (method != Method::Player || degrees >= 180.0) {
        assert_eq!(outcome.status, Status::Reached, "{}", outcome.told());
    }
}

/// Drives with the Pioneer's ring of eight cones, alone or beside a laser.
fn with_sonar(has_laser: bool) -> (Status, u32, f64) {
    let mut world = ground(|_, _| 0.0);
    world.place(crates(&[(8.0, 0.0), (13.0, 1.0)])).unwrap();
    let vehicle = jackal();
    let params = RobotParams {
        sonar: pioneer_sonar(),
        laser: laser(31, 20.0),
        ..RobotParams::default()
    };
    let limits = motion(&vehicle);
    let mut robot = Robot::new(&world, vehicle.clone(), limits, Pose::default(), params).unwrap();
    let params = DriveParams::default().within(&limits);
    let mut navigator = Navigator::new(&vehicle, Position::new(18.0, 0.0), None, params).unwrap();
    let mut command = sim::Command::default();
    let mut status = Status::Driving;
    for _ in 0..(120.0 / STEP_S) as usize {
        let seen = robot.step(&world, command, STEP_S);
        for cone in robot.sonar(&world) {
            // A ring that meets nothing is clear, never blind.
            let taken = navigator.sense(seen.body.time_s, &seen.pose, &cone, PI / 6.0);
            assert!(taken.is_ok(), "{taken:?}");
        }
        let told = navigator.step(&Observation {
            time_s: seen.body.time_s,
            pose: seen.pose,
            speed_mps: seen.body.wheel_speed_mps,
            turn_rate_radps: seen.body.turn_rate_radps,
            scan: seen.scan.as_ref().filter(|_| has_laser).map(|(_, scan)| scan),
            reading: None,
        });
        status = told.status;
        command = sim::Command {
            speed_mps: told.speed_mps,
            turn_rate_radps: told.turn_rate_radps,
        };
        if status == Status::Reached || seen.body.collisions > 0 {
            break;
        }
    }
    (status, robot.state().collisions, robot.state().time_s)
}

#[rstest]
fn a_sonar_ring_is_enough_and_helps_a_narrow_laser(#[values(false, true)] has_laser: bool) {
    let (status, collisions, seconds) = with_sonar(has_laser);
    assert_eq!((status, collisions), (Status::Reached, 0), "after {seconds} s");
}
