//! Whole episodes.

use super::*;
use crate::drive::{DriveParams, Navigator};
use crate::sim::{Motion, Robot, RobotParams, Scenario, ScenarioKind, Steering, random_world};
use crate::vehicle::Vehicle;
use crate::vehicle::fixtures::pioneer;

fn motion() -> Motion {
    Motion {
        steering: Steering::Differential,
        max_acceleration_mps2: 1.0,
        max_braking_mps2: 1.5,
        max_turn_rate_radps: 2.0,
    }
}

struct Cast {
    scenario: Scenario,
    robot: Robot,
    navigator: Navigator,
    episode: Episode,
}

fn cast(seed: u64, kind: ScenarioKind, density: f64, vehicle: &Vehicle, params: EpisodeParams) -> Cast {
    let scenario = random_world(seed, density, kind, 1.0).unwrap();
    let sensing = RobotParams {
        seed,
        ..RobotParams::default()
    };
    let robot = Robot::new(&scenario.world, vehicle.clone(), motion(), scenario.start, sensing).unwrap();
    let navigator = Navigator::new(vehicle, scenario.goal, None, DriveParams::default()).unwrap();
    let episode = Episode::new(&robot, params).unwrap();
    Cast {
        scenario,
        robot,
        navigator,
        episode,
    }
}

impl Cast {
    fn advance(&mut self, seconds: f64) -> Second {
        let mut actors = Actors {
            world: &self.scenario.world,
            robot: &mut self.robot,
            navigator: &mut self.navigator,
            clock: &mut || 0.0,
        };
        self.episode.advance(&mut actors, seconds)
    }

    fn drive(&mut self) -> Vec<Second> {
        let mut seconds = Vec::new();
        while self.episode.outcome().is_none() {
            seconds.push(self.advance(1.0));
            assert!(seconds.len() < 2000);
        }
        seconds
    }
}

#[test]
fn a_cluttered_world_is_crossed_and_told_second_by_second() {
    let mut cast = cast(1, ScenarioKind::Clutter, 2.5, &pioneer(), EpisodeParams::default());
    let seconds = cast.drive();
    let outcome = cast.episode.outcome().unwrap().clone();
    assert_eq!(outcome.verdict, Verdict::Reached, "{outcome:?}");
    assert!(
        outcome.goal_distance_m < 0.6 && outcome.distance_m > 25.0,
        "{outcome:?}"
    );
    assert!(outcome.min_clearance_m.unwrap() > 0.0);
    let rows: usize = seconds.iter().map(|second| second.truth.times_s.len()).sum();
    assert!((rows as f64 - 35.0 * outcome.duration_s).abs() < 3.0, "{rows}");
    for pair in seconds.windows(2) {
        assert_eq!(pair[0].end_s, pair[1].start_s);
    }
    for second in &seconds {
        assert_eq!(second.truth.times_s, second.commands.times_s);
        assert_eq!(second.scans.ranges_m.len(), 181 * second.scans.times_s.len());
        assert!(second.maps.len() <= 1);
        for time_s in &second.truth.times_s {
            assert!(*time_s + 1e-6 >= second.start_s && *time_s < second.end_s + 1e-6);
        }
    }
    assert!(seconds.iter().any(|second| !second.ways.is_empty()));
}

#[test]
fn the_same_seed_gives_the_same_seconds_however_they_are_cut() {
    let drive = |seed, piece_s| {
        let mut cast = cast(seed, ScenarioKind::Moving, 2.5, &pioneer(), EpisodeParams::default());
        let mut poses = Vec::new();
        for _ in 0..(12.0 / piece_s) as usize {
            poses.extend(cast.advance(piece_s).truth.poses);
        }
        poses
    };
    assert_eq!(drive(2, 1.0), drive(2, 1.0));
    assert_eq!(drive(2, 1.0), drive(2, 4.0));
    assert_ne!(drive(2, 1.0), drive(3, 1.0));
}

#[test]
fn what_a_cone_finds_is_remoulded_what_carries_the_vehicle() {
    use crate::belief::{CLASSES, SoilTypes};
    use crate::grid::{GridGeometry, Layer, Position};
    use crate::sim::{Noise, Penetrometer, World};
    use crate::soil::SoilClass;
    let tool = Penetrometer {
        push_variation: 0.0,
        sample_variation: 0.0,
        ..Penetrometer::default()
    };
    for (class, soil) in CLASSES.into_iter().zip(SoilTypes::default().0) {
        let Some(rating_kpa) = class.rating_cone_index_kpa(40.0).filter(|_| class != SoilClass::None) else {
            continue;
        };
        let geometry = GridGeometry::new(4, 4, 10.0, 0.0, 40.0).unwrap();
        let world = World::new(Layer::filled(geometry, 0.0), Layer::filled(geometry, class as u8), 40.0).unwrap();
        let (reading, _) = tool.probe(&world, Position::new(5.0, 5.0), Noise::new(0), 0);
        // At 7.5 cm the profile has the class's mean.
        let at = reading
            .depths_m
            .iter()
            .position(|&depth_m| (depth_m - 0.075).abs() < 1e-9)
            .unwrap();
        let strength_kpa = reading.cone_indices_kpa[at] * soil.remoulding_index;
        approx::assert_relative_eq!(strength_kpa, rating_kpa, max_relative = 1e-9);
    }
}
