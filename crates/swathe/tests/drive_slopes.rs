//! On hills that the map knows, no vehicle comes onto slopes beyond its limits: the simulated body is the judge. And soil and grade
//! slow it down.
//!
//! More hills: `cargo test --release -p swathe --test drive_slopes -- --ignored --nocapture`.

mod driving;

use driving::{STEP_S, car, ground, jackal, motion};
use rstest::rstest;
use swathe::belief::{BeliefParams, Prior, SoilBelief, Unit};
use swathe::drive::{DriveParams, Knowledge, KnownMap, Navigator, Observation};
use swathe::episode::{Actors, Episode, EpisodeParams, Happening, Verdict};
use swathe::grid::{Layer, Position};
use swathe::nest::NestParams;
use swathe::rank::RankParams;
use swathe::sensor::Pose;
use swathe::sim::{Robot, RobotParams, World};
use swathe::soil::{SoilClass, Trafficability};
use swathe::vehicle::Vehicle;

/// Of six drives across hills this many must arrive: some end before a slope that the vehicle finds no way around.
const LEAST_REACHED: usize = 3;

/// Hills and hollows in rows and columns of 24 m, at their sides steeper than the vehicles may stand across (20 %), and here and
/// there than they may climb (30 %).
fn hills(turned_rad: f64) -> World {
    let (sin, cos) = turned_rad.sin_cos();
    ground(move |x_m, y_m| {
        let wave = |way_m: f64| (way_m * std::f64::consts::TAU / 24.0).sin();
        1.3 * wave(cos * x_m + sin * y_m) * wave(cos * y_m - sin * x_m)
    })
}

fn known(world: &World, vehicle: &Vehicle, class: SoilClass, moisture_percent: f64) -> Knowledge {
    let heights = world.relief().heights().clone();
    let geometry = heights.geometry();
    let unit = Unit {
        id: 1,
        symbol: 0,
        prior: Prior::Class(class),
    };
    let belief = SoilBelief::new(&Layer::filled(geometry, 1), &[unit], BeliefParams::default()).unwrap();
    let map = KnownMap {
        elevation_m: heights,
        soil: Some(Layer::filled(geometry, class as u8)),
        grey: None,
        zones: None,
        vehicle: vehicle.clone(),
        rank: RankParams {
            moisture_percent,
            ..RankParams::default()
        },
        nest: NestParams::default(),
        explains_returns: true,
    };
    Knowledge::new(map, belief).unwrap()
}

/// Drives across turned hills to a goal 48 m east; how it ended, and how often slopes beyond the limits were come onto.
fn drive(vehicle: &Vehicle, turned_rad: f64, goal_north_m: f64) -> (Verdict, usize) {
    let world = hills(turned_rad);
    let limits = motion(vehicle);
    let mut robot = Robot::new(&world, vehicle.clone(), limits, Pose::default(), RobotParams::default()).unwrap();
    let params = DriveParams::default().within(&limits);
    let goal = Position::new(48.0, goal_north_m);
    let mut navigator = Navigator::with_knowledge(
        vehicle,
        goal,
        known(&world, vehicle, SoilClass::Gravel, 20.0),
        None,
        params,
    )
    .unwrap();
    let params = EpisodeParams {
        control_period_s: STEP_S,
        time_limit_s: 300.0,
        records: false,
        ..EpisodeParams::default()
    };
    let mut episode = Episode::new(&robot, params).unwrap();
    let mut entered = 0;
    while episode.outcome().is_none() {
        let mut actors = Actors {
            world: &world,
            robot: &mut robot,
            navigator: &mut navigator,
            clock: &mut || 0.0,
        };
        let second = episode.advance(&mut actors, 1.0);
        let no_go = |(_, told): &&(f64, Happening)| matches!(told, Happening::NoGoEntered { .. });
        entered += second.events.iter().filter(no_go).count();
    }
    (episode.outcome().unwrap().verdict, entered)
}

/// How many of some drives reached their goals, and how often all of them came onto slopes beyond the limits.
fn outcomes(vehicle: &Vehicle, drives: impl Iterator<Item = (f64, f64)>) -> (usize, usize) {
    let vehicle = Vehicle {
        grade_up: 0.3,
        grade_down: 0.3,
        side_slope: 0.2,
        ..vehicle.clone()
    };
    let outcomes = drives.map(|(turned_rad, goal_north_m)| drive(&vehicle, turned_rad, goal_north_m));
    outcomes.fold((0, 0), |(reached, entered), (verdict, times)| {
        (reached + usize::from(verdict == Verdict::Reached), entered + times)
    })
}

#[rstest]
// A vehicle that turns on the spot swings a little farther than it was told.
#[case::jackal(jackal(), 1)]
#[case::car(car(), 0)]
fn slopes_beyond_its_limits_are_driven_around(#[case] vehicle: Vehicle, #[case] most: usize) {
    let drives = (0..6).map(f64::from).map(|number| (0.4 * number, 12.0 - 6.0 * number));
    let (reached, entered) = outcomes(&vehicle, drives);
    assert!(
        reached >= LEAST_REACHED && entered <= most,
        "reached {reached}, entered {entered}"
    );
}

#[rstest]
#[case::jackal("Jackal", jackal())]
#[case::car("car", car())]
#[ignore = "a measurement: more hills"]
fn slopes_beyond_its_limits_on_more_hills(#[case] name: &str, #[case] vehicle: Vehicle) {
    let drives = (0..24).map(|number| (0.13 * f64::from(number), 12.0 - 6.0 * f64::from(number % 5)));
    let (reached, entered) = outcomes(&vehicle, drives);
    println!("{name}: reached {reached} of 24, onto slopes beyond the limits {entered} times");
}

/// The greatest speed that a vehicle is told on ground of a class with a grade ahead, and what soil and engine allow there.
fn speeds_on(vehicle: &Vehicle, class: SoilClass, moisture_percent: f64, grade: f64) -> (f64, f64) {
    let world = ground(|x_m, _| grade * x_m);
    let limits = motion(vehicle);
    let mut robot = Robot::new(&world, vehicle.clone(), limits, Pose::default(), RobotParams::default()).unwrap();
    let map = known(&world, vehicle, class, moisture_percent);
    let params = DriveParams::default().within(&limits);
    let mut navigator = Navigator::with_knowledge(vehicle, Position::new(20.0, 0.0), map, None, params).unwrap();
    let (mut told, mut most_mps) = (swathe::sim::Command::default(), 0.0f64);
    for _ in 0..(15.0 / STEP_S) as usize {
        let seen = robot.step(&world, told, STEP_S);
        let command = navigator.step(&Observation {
            time_s: seen.body.time_s,
            pose: seen.pose,
            speed_mps: seen.body.wheel_speed_mps,
            turn_rate_radps: seen.body.turn_rate_radps,
            scan: seen.scan.as_ref().map(|(_, scan)| scan),
            reading: None,
        });
        most_mps = most_mps.max(command.speed_mps);
        told = swathe::sim::Command {
            speed_mps: command.speed_mps,
            turn_rate_radps: command.turn_rate_radps,
        };
    }
    let fares = Trafficability::of(vehicle, class, moisture_percent);
    (most_mps, fares.powered_speed_mps(vehicle, grade))
}

#[test]
fn weak_soil_slows_the_vehicle() {
    let vehicle = Vehicle {
        measured_cone_index_kpa: Some(100.0),
        ..jackal()
    };
    let wet = (20..60).map(f64::from).find(|&wet| {
        let fares = Trafficability::of(&vehicle, SoilClass::Silt, wet);
        fares.go && fares.speed_mps < 0.7 * vehicle.max_speed_mps
    });
    let (told_mps, allowed_mps) = speeds_on(&vehicle, SoilClass::Silt, wet.unwrap(), 0.0);
    assert!(
        told_mps <= allowed_mps + 1e-9 && told_mps > 0.8 * allowed_mps,
        "{told_mps} of {allowed_mps}"
    );
    let (told_mps, _) = speeds_on(&vehicle, SoilClass::Gravel, 20.0, 0.0);
    assert!(told_mps > 0.9 * vehicle.max_speed_mps, "{told_mps}");
}

#[rstest]
#[case::jackal(Vehicle { power_w: 100.0, ..jackal() })]
#[case::car(Vehicle { power_w: 8_000.0, ..car() })]
fn a_grade_within_its_limits_slows_the_vehicle_uphill_alone(#[case] vehicle: Vehicle) {
    let speeds_on = |grade: f64| speeds_on(&vehicle, SoilClass::Gravel, 20.0, grade);
    let (steep, most_mps) = (0.3, vehicle.max_speed_mps);
    assert!(steep < 0.8 * vehicle.grade_up && steep < 0.8 * vehicle.grade_down);
    for grade in [0.0, -steep] {
        let (told_mps, _) = speeds_on(grade);
        assert!(told_mps > 0.9 * most_mps, "{grade}: {told_mps}");
    }
    let (told_mps, allowed_mps) = speeds_on(steep);
    assert!(allowed_mps < 0.8 * most_mps, "{allowed_mps}");
    assert!(
        told_mps <= 1.005 * allowed_mps && told_mps > 0.8 * allowed_mps,
        "{told_mps} of {allowed_mps}"
    );
}
