//! A ditch lies below the beams of a level laser: what keeps a vehicle out of it is the map.

mod driving;

use driving::{STEP_S, car, ground, jackal, motion};
use rstest::rstest;
use swathe::belief::{BeliefParams, Prior, SoilBelief, Unit};
use swathe::drive::{DriveParams, Knowledge, KnownMap, Navigator, Reason};
use swathe::episode::{Actors, Episode, EpisodeParams, Happening, Verdict};
use swathe::grid::{Layer, Position};
use swathe::nest::NestParams;
use swathe::rank::RankParams;
use swathe::sensor::Pose;
use swathe::sim::{Footprint, Laser, NoGo, Noise, Robot, RobotParams, World};
use swathe::soil::SoilClass;
use swathe::vehicle::Vehicle;

/// A ditch 1 m wide and as deep, 12 m ahead of the start and across the way to the goal, from the south edge of the ground to here.
const DITCH_X_M: f64 = 12.0;
const SOUTH_M: f64 = -40.0;
const PART_M: f64 = 4.0;
const ALL_M: f64 = 40.0;
const GOAL: Position = Position { x_m: 30.0, y_m: 0.0 };

fn level() -> World {
    ground(|_, _| 0.0)
}

fn ditched(north_m: f64) -> World {
    let mut world = level();
    let line = [SOUTH_M, north_m].map(|y_m| Position::new(DITCH_X_M, y_m));
    world.dig(&line, 1.0, 1.0).unwrap();
    world
}

/// What is known of a world whose heights are the map's.
fn known(world: &World, vehicle: &Vehicle) -> Knowledge {
    let heights = world.relief().heights().clone();
    let geometry = heights.geometry();
    let unit = Unit {
        id: 1,
        symbol: 0,
        prior: Prior::Class(SoilClass::Gravel),
    };
    let belief = SoilBelief::new(&Layer::filled(geometry, 1), &[unit], BeliefParams::default()).unwrap();
    let map = KnownMap {
        elevation_m: heights,
        soil: Some(Layer::filled(geometry, SoilClass::Gravel as u8)),
        grey: None,
        zones: None,
        vehicle: vehicle.clone(),
        rank: RankParams::default(),
        nest: NestParams::default(),
        explains_returns: true,
    };
    Knowledge::new(map, belief).unwrap()
}

/// How a drive ended.
struct Outcome {
    verdict: Verdict,
    reason: Reason,
    /// Height of the lowest ground that a wheel came onto.
    lowest_m: f64,
    /// What the judge says of ground beyond the vehicle's limits.
    entered: Vec<NoGo>,
    /// The most northern and the most eastern place of its middle.
    farthest_m: (f64, f64),
}

/// Drives in a world with the heights of another on the map.
fn drive(world: &World, map: &World, vehicle: &Vehicle) -> Outcome {
    let limits = motion(vehicle);
    let mut robot = Robot::new(world, vehicle.clone(), limits, Pose::default(), RobotParams::default()).unwrap();
    let params = DriveParams::default().within(&limits);
    let mut navigator = Navigator::with_knowledge(vehicle, GOAL, known(map, vehicle), None, params).unwrap();
    let params = EpisodeParams {
        control_period_s: STEP_S,
        time_limit_s: 120.0,
        records: false,
        ..EpisodeParams::default()
    };
    let mut episode = Episode::new(&robot, params).unwrap();
    let (mut lowest_m, mut entered, mut farthest_m) = (0.0_f64, Vec::new(), (0.0_f64, 0.0_f64));
    while episode.outcome().is_none() {
        let mut actors = Actors {
            world,
            robot: &mut robot,
            navigator: &mut navigator,
            clock: &mut || 0.0,
        };
        let moment = episode.advance(&mut actors, STEP_S);
        entered.extend(moment.events.iter().filter_map(|(_, told)| match told {
            Happening::NoGoEntered { reason, .. } => Some(*reason),
            _ => None,
        }));
        let pose = robot.state().pose;
        farthest_m = (farthest_m.0.max(pose.y_m), farthest_m.1.max(pose.x_m));
        let wheels = Footprint::new(&pose, vehicle.length_m, vehicle.width_m).corners();
        let heights = wheels.into_iter().filter_map(|wheel| world.relief().height_m(wheel));
        lowest_m = heights.fold(lowest_m, f64::min);
    }
    Outcome {
        verdict: episode.outcome().unwrap().verdict,
        reason: navigator.reason(),
        lowest_m,
        entered,
        farthest_m,
    }
}

#[rstest]
#[case::jackal(jackal())]
#[case::car(car())]
fn a_ditch_on_the_map_is_driven_around_its_end_and_no_wheel_comes_into_it(#[case] vehicle: Vehicle) {
    let world = ditched(PART_M);
    let outcome = drive(&world, &world, &vehicle);
    assert_eq!((outcome.verdict, outcome.lowest_m), (Verdict::Reached, 0.0));
    assert_eq!(outcome.entered, []);
    assert!(outcome.farthest_m.0 > PART_M, "{:?}", outcome.farthest_m);
}

#[rstest]
#[case::jackal(jackal())]
#[case::car(car())]
fn a_ditch_all_across_the_map_stops_the_drive_before_it_with_the_reason(#[case] vehicle: Vehicle) {
    let world = ditched(ALL_M);
    let outcome = drive(&world, &world, &vehicle);
    assert_eq!((outcome.verdict, outcome.reason), (Verdict::NotReached, Reason::CutOff));
    assert_eq!((outcome.lowest_m, outcome.entered), (0.0, vec![]));
    assert!(outcome.farthest_m.1 < DITCH_X_M, "{:?}", outcome.farthest_m);
}

#[test]
fn a_ditch_on_no_map_is_below_the_beams_and_the_judge_tells_who_drives_into_it() {
    let (world, vehicle) = (ditched(PART_M), jackal());
    // On the brink the nose is level still: nothing comes back from the ditch.
    let laser = Laser::sick_lms200(false, true);
    for x_m in [0.0, 6.0, 11.0] {
        let scan = laser.scan(&world, &Pose::level(x_m, 0.0, 0.0), 0.0, 0.0, Noise::new(1), 1);
        assert!(scan.ranges_m.iter().all(|range_m| range_m.is_infinite()), "{x_m}");
    }
    let outcome = drive(&world, &level(), &vehicle);
    assert!(outcome.lowest_m < -0.5, "{}", outcome.lowest_m);
    assert_eq!(outcome.entered.first(), Some(&NoGo::Grade));
}
