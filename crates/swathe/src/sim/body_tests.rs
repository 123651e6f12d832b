//! Laws of motion.

use super::*;
use crate::grid::{GridGeometry, Layer};
use crate::sim::world::tests::{motion, plain};
use crate::sim::{Obstacle, Shape};
use crate::vehicle::fixtures::{pioneer, tractor};
use approx::assert_relative_eq;
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

fn body(world: &World, vehicle: Vehicle, steering: Steering, at: Pose) -> Body {
    Body::new(world, vehicle, motion(steering), at, 0.0, Noise::new(1)).unwrap()
}

fn go(speed_mps: f64, turn_rate_radps: f64) -> Command {
    Command {
        speed_mps,
        turn_rate_radps,
    }
}

#[test]
fn a_straight_drive_is_as_long_as_speed_times_time_less_slip() {
    let world = plain(0.0);
    let mut robot = body(&world, pioneer(), Steering::Differential, Pose::level(-15.0, 0.0, 0.0));
    robot.step(&world, go(0.5, 0.0), 5.0);
    let (before, slip) = (robot.state().pose, robot.state().slip);
    assert!(slip > 0.0 && slip < 0.05, "{slip}");
    robot.step(&world, go(0.5, 0.0), 20.0);
    assert_relative_eq!(
        robot.state().pose.distance_m(&before),
        10.0 * (1.0 - slip),
        epsilon = 1e-9
    );
    assert_eq!(robot.state().pose.y_m, 0.0);
}

#[test]
fn a_circle_closes() {
    let world = plain(0.0);
    let mut robot = body(&world, pioneer(), Steering::Differential, Pose::level(0.0, 0.0, 0.0));
    robot.step(&world, go(0.5, 0.25), 10.0);
    let before = robot.state().pose;
    robot.step(&world, go(0.5, 0.25), 2.0 * PI / 0.25);
    let after = robot.state().pose;
    assert!(after.distance_m(&before) < 1e-6 && wrap(after.heading_rad - before.heading_rad).abs() < 1e-9);
    // The diameter is that of speed over turn rate.
    robot.step(&world, go(0.5, 0.25), PI / 0.25);
    let diameter_m = 2.0 * robot.state().speed_mps / 0.25;
    assert_relative_eq!(robot.state().pose.distance_m(&before), diameter_m, epsilon = 1e-6);
}

/// The turns of wheels and vehicle, in rad, in a time at a command after it has come up to it.
fn turned(steering: Steering, command: Command) -> (f64, f64) {
    let world = plain(0.0);
    let mut robot = body(&world, pioneer(), steering, Pose::level(0.0, 0.0, 0.0));
    robot.step(&world, command, 4.0);
    let (mut wheels_rad, mut vehicle_rad) = (0.0, 0.0);
    for _ in 0..100 {
        let before = *robot.state();
        let after = *robot.step(&world, command, 0.02);
        wheels_rad += 0.02 * after.wheel_turn_rate_radps;
        vehicle_rad += wrap(after.pose.heading_rad - before.pose.heading_rad);
    }
    (wheels_rad, vehicle_rad)
}

#[test]
fn wheels_that_skid_turn_the_vehicle_a_tenth_less_than_it_is_told() {
    for command in [go(0.5, 0.4), go(0.5, -0.4), go(-0.5, 0.4), go(0.0, 1.0)] {
        let told_rad = 2.0 * command.turn_rate_radps;
        let (wheels_rad, vehicle_rad) = turned(Steering::Skid, command);
        assert_relative_eq!(wheels_rad, told_rad, epsilon = 1e-9);
        assert_relative_eq!(vehicle_rad, 0.9 * told_rad, epsilon = 1e-9);
        let (_, vehicle_rad) = turned(Steering::Differential, command);
        assert_relative_eq!(vehicle_rad, told_rad, epsilon = 1e-9);
    }
}

#[test]
fn braking_takes_the_distance_of_its_deceleration() {
    let world = plain(0.0);
    let mut robot = body(&world, pioneer(), Steering::Differential, Pose::level(-15.0, 0.0, 0.0));
    robot.step(&world, go(0.7, 0.0), 5.0);
    let (before, slip) = (robot.state().pose, robot.state().slip);
    robot.step(&world, go(0.0, 0.0), 3.0);
    assert_eq!(robot.state().speed_mps, 0.0);
    let expected = 0.7 * 0.7 / (2.0 * 0.8) * (1.0 - slip);
    // Speeds change in pieces of 0.02 s.
    assert_relative_eq!(robot.state().pose.distance_m(&before), expected, epsilon = 0.02 * 0.7);
}

#[test]
fn a_car_never_turns_tighter_than_its_radius_and_not_on_the_spot() {
    let world = plain(0.0);
    let mut car = body(&world, tractor(), Steering::Ackermann, Pose::level(0.0, -5.0, 0.0));
    car.step(&world, go(0.0, 1.0), 5.0);
    assert_eq!(car.state().pose, Pose::level(0.0, -5.0, 0.0));
    let before = car.state().pose;
    for _ in 0..60 {
        car.step(&world, go(1.0, 1.5), 0.1);
        let state = car.state();
        assert!(state.turn_rate_radps.abs() * 4.8 <= state.speed_mps.abs() + 1e-9);
    }
    assert!(car.state().pose.distance_m(&before) > 3.0);
}

#[test]
fn hills_slow_the_weak_and_stop_the_slipping() {
    let speed_on = |grade: f64| {
        let world = plain(grade);
        let mut vehicle = pioneer();
        vehicle.power_w = 30.0;
        let mut robot = body(&world, vehicle, Steering::Differential, Pose::level(-15.0, 0.0, 0.0));
        *robot.step(&world, go(0.7, 0.0), 4.0)
    };
    let (flat, hill, steep) = (speed_on(0.0), speed_on(0.2), speed_on(0.7));
    assert!(flat.speed_mps > hill.speed_mps && hill.speed_mps > 0.1, "{hill:?}");
    // 18 W at the ground over m g (C + 0.2) cos.
    let weight = 20.0 * GRAVITY_MPS2;
    let c = Trafficability::of(&pioneer(), SoilClass::Gravel, 20.0).rolling_resistance;
    assert_relative_eq!(
        hill.wheel_speed_mps,
        18.0 / (weight * (c + 0.2) / 1.04f64.sqrt()),
        epsilon = 1e-6
    );
    assert!(hill.slip > flat.slip && steep.speed_mps == 0.0);
    assert_eq!((flat.no_go, steep.no_go), (None, Some(NoGo::Grade)));
    assert_relative_eq!(hill.pose.pitch_rad, 0.2f64.atan(), epsilon = 1e-5);
}

#[test]
fn a_side_slope_leans_it_and_lets_it_drift_downhill() {
    let world = plain(-0.15);
    // Downhill is east; driving north has it on the right.
    let mut robot = body(&world, pioneer(), Steering::Skid, Pose::level(0.0, -10.0, FRAC_PI_2));
    robot.step(&world, go(0.5, 0.0), 10.0);
    let state = robot.state();
    assert_relative_eq!(state.pose.roll_rad, 0.15f64.atan(), epsilon = 1e-5);
    assert!(state.pose.x_m > 0.02 && state.pose.y_m > -6.0, "{state:?}");
}

#[test]
fn a_wall_stops_it_without_a_dent_and_it_can_back_off() {
    let mut world = plain(0.0);
    let wall = Shape::Wall(vec![Position::new(1.0, -5.0), Position::new(1.0, 5.0)]);
    world
        .place(vec![Obstacle {
            shape: wall,
            height_m: 1.0,
        }])
        .unwrap();
    let mut robot = body(&world, pioneer(), Steering::Differential, Pose::level(-1.0, 0.0, 0.0));
    for _ in 0..60 {
        robot.step(&world, go(0.7, 0.0), 0.1);
        assert!(!world.collides(&pioneer(), &robot.state().pose, 0.0));
    }
    let state = *robot.state();
    assert_eq!((state.stop, state.collisions), (Some(Stop::Collision), 1));
    assert!((0.74 - state.pose.x_m) < 0.03, "{state:?}");
    let back = robot.step(&world, go(-0.5, 0.0), 2.0);
    assert!(back.pose.x_m < 0.5 && back.stop.is_none());
}

#[test]
fn weak_soil_holds_it_for_ever_and_the_edge_of_the_world_does_not_let_it_out() {
    let geometry = GridGeometry::new(1, 1, 4.0, -2.0, 2.0).unwrap();
    let world =
        |soil: SoilClass| World::new(Layer::filled(geometry, 0.0), Layer::filled(geometry, soil as u8), 20.0).unwrap();
    let swamp = world(SoilClass::None);
    let mut robot = body(&swamp, pioneer(), Steering::Skid, Pose::default());
    let sunk = *robot.step(&swamp, go(0.7, 0.0), 5.0);
    assert_eq!(
        (sunk.stop, sunk.no_go, sunk.pose.x_m),
        (Some(Stop::Sunk), Some(NoGo::Soil), 0.0)
    );
    let gravel = world(SoilClass::Gravel);
    let mut robot = body(&gravel, pioneer(), Steering::Skid, Pose::default());
    let edge = *robot.step(&gravel, go(0.7, 0.0), 20.0);
    assert_eq!(edge.stop, Some(Stop::Edge));
    assert!(edge.pose.x_m < 2.0 && edge.no_go.is_none());
}

#[test]
fn a_robot_that_begins_nowhere_is_told_so_and_may_move() {
    let world = plain(0.0);
    let mut lost = body(&world, pioneer(), Steering::Skid, Pose::level(500.0, 0.0, 0.0));
    let state = lost.step(&world, go(0.5, 0.0), 2.0);
    assert_eq!((state.no_go, state.stop), (Some(NoGo::Outside), None));
    assert!(state.pose.x_m > 500.0);
    for bad in [f64::NAN, f64::INFINITY] {
        let made = Body::new(
            &world,
            pioneer(),
            motion(Steering::Skid),
            Pose::level(bad, 0.0, 0.0),
            0.0,
            Noise::new(1),
        );
        assert!(made.is_err());
    }
}

proptest! {
    #[test]
    fn whatever_is_commanded_limits_hold_and_nothing_is_nan(
        commands in prop::collection::vec(
            (prop_oneof![4 => -9.0f64..9.0, 1 => any::<f64>()], prop_oneof![4 => -9.0f64..9.0, 1 => any::<f64>()], 0.0f64..1.0),
            1..30,
        ),
        grade in -0.2f64..0.2, car: bool, seed: u64,
    ) {
        let world = plain(grade);
        let (vehicle, steering) = if car { (tractor(), Steering::Ackermann) } else { (pioneer(), Steering::Skid) };
        let limits = motion(steering);
        let mut robot = Body::new(&world, vehicle.clone(), limits, Pose::default(), 0.3, Noise::new(seed)).unwrap();
        for (speed, turn, dt) in commands {
            let before = *robot.state();
            let state = *robot.step(&world, go(speed, turn), dt);
            prop_assert!(state.pose.is_finite() && state.speed_mps.is_finite() && state.slip.is_finite());
            prop_assert!(state.wheel_speed_mps.abs() <= vehicle.max_speed_mps + 1e-9);
            prop_assert!(state.turn_rate_radps.abs() <= limits.max_turn_rate_radps + 1e-9);
            let change = (state.wheel_speed_mps - before.wheel_speed_mps).abs();
            prop_assert!(state.stop.is_some() || change <= 0.8 * dt + 1e-9);
            prop_assert!(state.time_s >= before.time_s);
        }
    }
}
