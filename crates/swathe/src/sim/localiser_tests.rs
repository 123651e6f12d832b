//! What odometry makes of wheels that slip.

use super::*;
use crate::sim::world::tests::{motion, plain};
use crate::sim::{Command, Robot, RobotParams, Steering};
use crate::vehicle::fixtures::pioneer;
use approx::assert_relative_eq;

/// How far a robot went in five seconds at a told speed, how far it thinks that it went, and how far its wheels turned.
fn went(grade: f64, localiser: LocaliserParams) -> [f64; 3] {
    let world = plain(grade);
    let limits = motion(Steering::Differential);
    let params = RobotParams {
        localiser,
        has_laser: false,
        slip_variation: 0.0,
        ..RobotParams::default()
    };
    let start = Pose::level(-15.0, 0.0, 0.0);
    let mut robot = Robot::new(&world, pioneer(), limits, start, params).unwrap();
    let command = Command {
        speed_mps: 0.5,
        turn_rate_radps: 0.0,
    };
    let mut wheels_m = 0.0;
    for _ in 0..250 {
        let before_mps = robot.state().wheel_speed_mps;
        robot.step(&world, command, 0.02);
        wheels_m += 0.02 * before_mps.midpoint(robot.state().wheel_speed_mps);
    }
    [
        robot.state().pose.distance_m(&start),
        robot.pose().distance_m(&start),
        wheels_m,
    ]
}

const WHEELS: LocaliserParams = LocaliserParams {
    blind_to_slip: true,
    scale_error: 0.0,
    distance_noise_m: 0.0,
    heading_noise_rad: 0.0,
    heading_drift_radps: 0.0,
    fix_rate_hz: 0.0,
    fix_noise_m: 0.0,
    fix_heading_noise_rad: 0.0,
    fuses_fixes: false,
};

#[test]
fn who_counts_wheels_thinks_to_have_gone_as_far_as_they_turned() {
    for grade in [0.0, 0.2] {
        let [gone_m, thought_m, wheels_m] = went(grade, WHEELS);
        assert_relative_eq!(thought_m, wheels_m, epsilon = 1e-9);
        let lost = 1.0 - gone_m / wheels_m;
        // On the slope more slips, and the map sees the horizontal part of the way.
        let least = if grade > 0.0 { 0.04 } else { 0.005 };
        assert!(lost > least, "{grade}: {lost}");
    }
}

#[test]
fn who_sees_slip_thinks_to_be_where_it_is() {
    let seeing = LocaliserParams {
        blind_to_slip: false,
        ..WHEELS
    };
    for grade in [0.0, 0.2] {
        let [gone_m, thought_m, wheels_m] = went(grade, seeing);
        assert_relative_eq!(thought_m, gone_m, epsilon = 1e-9);
        assert!(thought_m < 0.995 * wheels_m, "{grade}: {thought_m} {wheels_m}");
    }
}

#[test]
fn fixes_bring_who_counts_wheels_back_to_where_it_is() {
    let fixed = LocaliserParams {
        fix_rate_hz: 1.0,
        ..WHEELS
    };
    let [gone_m, thought_m, wheels_m] = went(0.2, fixed);
    // The last fix came with the last step.
    assert_relative_eq!(thought_m, gone_m, epsilon = 1e-9);
    assert!(wheels_m - gone_m > 0.05, "{wheels_m} {gone_m}");
}
