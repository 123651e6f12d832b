//! The drive learns: readings, news and probing end to end, on ground that is drawn as text.

use proptest::prelude::*;
use rstest::rstest;

use super::world::{STEP_S, World, jackal};
use crate::belief::{BeliefParams, CLASSES, Extent, Prior, ProbePolicy, SoilBelief, SoilUpdate, Unit, Word};
use crate::drive::{
    Command, DriveError, DriveParams, Event, Knowledge, KnownMap, Method, Navigator, Observation, OutsideNests, Reason,
    Standing, Status,
};
use crate::grid::{GridGeometry, Layer, Position};
use crate::nest::NestParams;
use crate::rank::RankParams;
use crate::sensor::{Mount, PenetrometerReading, Pose, wrap};
use crate::soil::SoilClass;

const CELL_M: f64 = 4.0;

fn class_of(letter: char) -> SoilClass {
    match letter {
        's' => SoilClass::Sand,
        'c' => SoilClass::Clay,
        'n' => SoilClass::None,
        _ => SoilClass::Gravel,
    }
}

/// Ground of 4 m cells, so wet that clay and silt do not carry; the west edge at 0, the middle row around y = 0.
fn ground(rows: &[&str], slope_north: f64) -> Knowledge {
    let (height, width) = (rows.len(), rows[0].len());
    let geometry = GridGeometry::new(height, width, CELL_M, 0.0, height as f64 * CELL_M / 2.0).unwrap();
    let classes: Vec<SoilClass> = rows.iter().flat_map(|row| row.chars()).map(class_of).collect();
    let codes: Vec<u8> = classes.iter().map(|&class| class as u8).collect();
    let numbers: Vec<u32> = classes.iter().map(|&class| class as u32).collect();
    let unit = |class: SoilClass| Unit {
        id: class as u32,
        symbol: 0,
        prior: Prior::Class(class),
    };
    let units: Vec<Unit> = CLASSES
        .iter()
        .copied()
        .filter(|class| classes.contains(class))
        .map(unit)
        .collect();
    let layer = Layer::new(geometry, numbers, "polygons").unwrap();
    let belief = SoilBelief::new(&layer, &units, BeliefParams::default()).unwrap();
    let rise = |cell: crate::grid::Cell| (slope_north * geometry.centre(cell).y_m) as f32;
    let mut vehicle = jackal();
    vehicle.measured_cone_index_kpa = Some(150.0);
    let map = KnownMap {
        elevation_m: Layer::new(geometry, geometry.cells().map(rise).collect(), "z").unwrap(),
        soil: Some(Layer::new(geometry, codes, "soil").unwrap()),
        grey: None,
        zones: None,
        vehicle,
        rank: RankParams {
            moisture_percent: 40.0,
            ..RankParams::default()
        },
        nest: NestParams::default(),
        explains_returns: false,
    };
    Knowledge::new(map, belief).unwrap()
}

fn navigator(knowledge: Knowledge, goal: (f64, f64), params: DriveParams) -> Navigator {
    let vehicle = knowledge.map().vehicle.clone();
    Navigator::with_knowledge(&vehicle, Position::new(goal.0, goal.1), knowledge, None, params).unwrap()
}

fn reading(at: Position, kpa: f64) -> PenetrometerReading {
    PenetrometerReading {
        x_m: at.x_m,
        y_m: at.y_m,
        depths_m: vec![0.05, 0.10, 0.15],
        cone_indices_kpa: vec![0.9 * kpa, kpa, 1.1 * kpa],
        refusal_depth_m: None,
        sleeve_frictions_kpa: None,
    }
}

/// A robot that obeys, with a penetrometer that finds the true strength of a place.
struct Drive<'a> {
    navigator: Navigator,
    world: World,
    pose: Pose,
    speed_mps: f64,
    turn_radps: f64,
    time_s: f64,
    /// Cone index that a push at a place finds, when there is a penetrometer.
    truth: Option<&'a dyn Fn(Position) -> f64>,
    events: Vec<Event>,
    way_m: f64,
    places: Vec<Position>,
}

impl<'a> Drive<'a> {
    fn new(navigator: Navigator, at: (f64, f64), truth: Option<&'a dyn Fn(Position) -> f64>) -> Self {
        Self {
            navigator,
            world: World::default(),
            pose: Pose::level(at.0, at.1, 0.0),
            speed_mps: 0.0,
            turn_radps: 0.0,
            time_s: 0.0,
            truth,
            events: Vec::new(),
            way_m: 0.0,
            places: Vec::new(),
        }
    }

    fn at(&self) -> Position {
        Position::new(self.pose.x_m, self.pose.y_m)
    }

    /// Where the penetrometer goes in: on a boom half a metre long before the front edge.
    fn cone(&self) -> Position {
        let cone = self.pose.of_mount(&Mount {
            x_m: 0.5 * jackal().length_m + 0.5,
            ..Mount::default()
        });
        Position::new(cone.x_m, cone.y_m)
    }

    fn step(&mut self, hand: Option<&PenetrometerReading>) -> Command {
        let scan = self.world.scan(&self.pose, Mount::default(), 181, 4.7, 8.0);
        let probed = (self.navigator.wants_probe() && hand.is_none())
            .then(|| self.truth.map(|truth| reading(self.cone(), truth(self.cone()))))
            .flatten();
        let command = self.navigator.step(&Observation {
            time_s: self.time_s,
            pose: self.pose,
            speed_mps: self.speed_mps,
            turn_rate_radps: self.turn_radps,
            scan: Some(&scan),
            reading: hand.or(probed.as_ref()),
        });
        self.events.extend(self.navigator.events().iter().cloned());
        (self.speed_mps, self.turn_radps) = (command.speed_mps, command.turn_rate_radps);
        let middle = self.pose.heading_rad + 0.5 * self.turn_radps * STEP_S;
        self.pose.x_m += self.speed_mps * middle.cos() * STEP_S;
        self.pose.y_m += self.speed_mps * middle.sin() * STEP_S;
        self.pose.heading_rad = wrap(self.pose.heading_rad + self.turn_radps * STEP_S);
        self.way_m += self.speed_mps.abs() * STEP_S;
        self.places.push(self.at());
        self.time_s += STEP_S;
        command
    }

    fn run(&mut self, seconds: f64) -> Command {
        let end_s = self.time_s + seconds;
        loop {
            let command = self.step(None);
            if matches!(command.status, Status::Reached | Status::Stopped) || self.time_s >= end_s {
                return command;
            }
        }
    }

    fn count(&self, kind: &str) -> usize {
        self.events.iter().filter(|event| event.kind() == kind).count()
    }
}

/// Sand in the middle, gravel around it.
const OVAL: [&str; 13] = [
    "gggggggggggggggg",
    "gggggggggggggggg",
    "gggggggggggggggg",
    "gggggggggggggggg",
    "ggggssssssssgggg",
    "ggggssssssssgggg",
    "ggggssssssssgggg",
    "ggggssssssssgggg",
    "ggggssssssssgggg",
    "gggggggggggggggg",
    "gggggggggggggggg",
    "gggggggggggggggg",
    "gggggggggggggggg",
];

#[test]
fn a_reading_under_the_robot_sends_it_back_to_safe_ground_and_around() {
    let mut drive = Drive::new(
        navigator(ground(&OVAL, 0.0), (60.0, 0.0), DriveParams::default()),
        (6.0, 0.0),
        None,
    );
    drive.run(8.0);
    assert!(drive.pose.x_m > 17.0, "{:?}", drive.pose);
    // It sinks in, again and again: the sand is a bog.
    let on_sand = drive.at();
    for _ in 0..2 {
        drive.step(Some(&reading(on_sand, 5.0)));
    }
    assert_eq!(drive.count("reading_taken"), 2);
    assert!(drive.count("nests_changed") >= 1 && drive.count("route_repaired") >= 2);
    let knowledge = drive.navigator.knowledge().unwrap();
    let cell = knowledge.geometry().cell_at(on_sand).unwrap();
    assert_eq!(knowledge.ranks()[cell], 1);
    let first = drive.places.len();
    let command = drive.run(120.0);
    assert_eq!(command.status, Status::Reached, "{:?}", drive.navigator.reason());
    assert!(drive.events.iter().any(|event| event.kind() == "recovery"));
    // Once it has left the bog it stays out of it.
    let knowledge = drive.navigator.knowledge().unwrap();
    let rank = |place: &Position| knowledge.geometry().cell_at(*place).map(|cell| knowledge.ranks()[cell]);
    let left = drive.places[first..]
        .iter()
        .position(|place| rank(place) != Some(1))
        .unwrap();
    assert!(drive.places[first + left..].iter().all(|place| rank(place) != Some(1)));
}

#[test]
fn news_change_what_every_grid_answers_at_the_same_step() {
    let mut drive = Drive::new(
        navigator(ground(&["gggggggggg"; 9], 0.0), (36.0, 0.0), DriveParams::default()),
        (6.0, 0.0),
        None,
    );
    let told = |drive: &mut Drive| {
        drive.step(None);
        let events = drive.navigator.events().iter();
        let mut answers = events.filter_map(|event| match event {
            Event::Navigability { grids, navigable, .. } => Some((grids.clone(), *navigable)),
            _ => None,
        });
        answers.next_back().unwrap()
    };
    assert_eq!(told(&mut drive), (vec![true, true], true));
    let all = (0..9).flat_map(|row| (0..10).map(move |column| crate::grid::Cell::new(row, column)));
    let news = |time_s, class| SoilUpdate {
        time_s,
        source: "gauge".to_owned(),
        extent: Extent::Cells(all.clone().collect()),
        word: Word::Class(class),
        cone_index_kpa: None,
    };
    drive.navigator.learn_soil(&news(1.0, SoilClass::None)).unwrap();
    assert_eq!(told(&mut drive), (vec![false, false], false));
    drive.navigator.learn_soil(&news(2.0, SoilClass::Gravel)).unwrap();
    assert_eq!(told(&mut drive), (vec![true, true], true));
}

#[test]
fn no_safe_nest_and_no_way_are_told() {
    let rows = ["ssssssssss"; 9];
    let mut drive = Drive::new(
        navigator(ground(&rows, 0.0), (36.0, 0.0), DriveParams::default()),
        (6.0, 0.0),
        None,
    );
    drive.run(2.0);
    drive.step(Some(&reading(drive.at(), 5.0)));
    let command = drive.step(Some(&reading(drive.at(), 5.0)));
    assert_eq!(
        (command.status, drive.navigator.reason()),
        (Status::Stopped, Reason::NoSafeNest)
    );
    // Water right across: the robot waits, and drives on when it is gone.
    let mut drive = Drive::new(
        navigator(ground(&OVAL, 0.0), (60.0, 0.0), DriveParams::default()),
        (6.0, 0.0),
        None,
    );
    drive.run(2.0);
    let across: Vec<_> = (0..13)
        .flat_map(|row| [7, 8].map(|column| crate::grid::Cell::new(row, column)))
        .collect();
    let told = |time_s, class| SoilUpdate {
        time_s,
        source: "gauge".to_owned(),
        extent: Extent::Cells(across.clone()),
        word: Word::Class(class),
        cone_index_kpa: None,
    };
    drive.navigator.learn_soil(&told(1.0, SoilClass::None)).unwrap();
    let command = drive.run(5.0);
    assert_eq!(
        (command.status, drive.navigator.reason()),
        (Status::NoRoute, Reason::CutOff)
    );
    assert_eq!(drive.speed_mps, 0.0);
    assert_eq!(drive.count("soil_update"), 1);
    drive.navigator.learn_soil(&told(2.0, SoilClass::Sand)).unwrap();
    assert_eq!(drive.run(60.0).status, Status::Reached);
}

#[test]
fn readings_are_asked_for_after_so_many_metres_and_waited_for() {
    let params = DriveParams {
        probing: ProbePolicy::EveryMetres(12.0),
        probe_wait_s: 3.0,
        ..DriveParams::default()
    };
    let truth = |_: Position| 2500.0;
    let mut drive = Drive::new(
        navigator(ground(&OVAL, 0.0), (60.0, 0.0), params),
        (6.0, 0.0),
        Some(&truth),
    );
    assert_eq!(drive.run(90.0).status, Status::Reached);
    assert!(
        (3..=4).contains(&drive.count("probe_wanted")),
        "{}",
        drive.count("probe_wanted")
    );
    assert_eq!(drive.count("reading_taken"), drive.count("probe_wanted"));
    assert_eq!(drive.count("trap"), 0);
    // Without an instrument it waits its time and drives on.
    let mut drive = Drive::new(navigator(ground(&OVAL, 0.0), (60.0, 0.0), params), (6.0, 0.0), None);
    assert_eq!(drive.run(120.0).status, Status::Reached);
    assert_eq!(drive.count("probe_missed"), drive.count("probe_wanted"));
    assert!(drive.count("probe_missed") >= 3 && drive.count("trap") == 0);
    // And one that never probes never asks.
    let mut drive = Drive::new(
        navigator(ground(&OVAL, 0.0), (60.0, 0.0), DriveParams::default()),
        (6.0, 0.0),
        Some(&truth),
    );
    assert_eq!(drive.run(60.0).status, Status::Reached);
    assert_eq!(drive.count("probe_wanted"), 0);
}

#[test]
fn probing_where_it_matters_keeps_the_robot_out_of_a_bog_that_the_map_does_not_know() {
    // The sand of the map is in truth a bog.
    let bog = |place: Position| {
        if (16.0..48.0).contains(&place.x_m) && place.y_m.abs() < 10.0 {
            8.0
        } else {
            3000.0
        }
    };
    let metres_in_bog = |probing| {
        let params = DriveParams {
            probing,
            ..DriveParams::default()
        };
        let mut drive = Drive::new(
            navigator(ground(&OVAL, 0.0), (60.0, 0.0), params),
            (6.0, 0.0),
            Some(&bog),
        );
        assert_eq!(drive.run(200.0).status, Status::Reached);
        let inside = drive.places.windows(2).filter(|pair| bog(pair[0]) < 100.0);
        (
            inside.map(|pair| pair[0].distance_m(pair[1])).sum::<f64>(),
            drive.count("probe_wanted"),
        )
    };
    let (blind_m, never) = metres_in_bog(ProbePolicy::Never);
    assert_eq!(never, 0);
    let probe_cost = 1.0;
    for policy in [
        ProbePolicy::WhereItMatters { probe_cost },
        ProbePolicy::WhereItPays { probe_cost },
    ] {
        let (probed_m, probes) = metres_in_bog(policy);
        assert!((1..=8).contains(&probes), "{policy:?}: {probes}");
        assert!(
            blind_m > 25.0 && probed_m < 0.9 * blind_m,
            "{policy:?}: {blind_m} {probed_m}"
        );
    }
}

#[test]
fn a_reading_is_taken_where_it_saves_most_or_where_the_first_one_pays() {
    // Gravel at first, which may be something else, and sand from 16 m on, which is likelier not to carry.
    let probe_cost = 1.0;
    let wanted = |probing| {
        let params = DriveParams {
            probing,
            ..DriveParams::default()
        };
        let mut drive = Drive::new(navigator(ground(&OVAL, 0.0), (60.0, 0.0), params), (6.0, 0.0), None);
        drive.run(30.0);
        let savings = drive.events.iter().filter_map(|event| match event {
            Event::ProbeWanted { at, expected_saving_s } => Some((at.x_m, expected_saving_s.unwrap())),
            _ => None,
        });
        savings.collect::<Vec<_>>()
    };
    let first = wanted(ProbePolicy::WhereItPays { probe_cost })[0];
    let most = wanted(ProbePolicy::WhereItMatters { probe_cost })[0];
    assert!(first.0 < 8.0 && (16.0..17.0).contains(&most.0), "{first:?} {most:?}");
    assert!(first.1 > probe_cost && most.1 > first.1, "{first:?} {most:?}");
}

#[test]
fn every_local_method_keeps_off_ground_that_was_learnt_to_be_no_go() {
    for method in [Method::Vfh, Method::VfhPlus, Method::VfhStar, Method::Player] {
        let params = DriveParams {
            method,
            ..DriveParams::default()
        };
        let mut drive = Drive::new(navigator(ground(&OVAL, 0.0), (60.0, 0.0), params), (6.0, 0.0), None);
        drive.step(None);
        let update = SoilUpdate {
            time_s: 0.0,
            source: "scout".to_owned(),
            extent: Extent::Unit(SoilClass::Sand as u32),
            word: Word::Class(SoilClass::None),
            cone_index_kpa: None,
        };
        drive.navigator.learn_soil(&update).unwrap();
        let command = drive.run(180.0);
        let knowledge = drive.navigator.knowledge().unwrap();
        let rank = |place: &Position| knowledge.geometry().cell_at(*place).map(|cell| knowledge.ranks()[cell]);
        assert!(drive.places.iter().all(|place| rank(place) != Some(1)), "{method:?}");
        // Player's method alone often turns back where others go around.
        if method != Method::Player {
            assert_eq!(
                command.status,
                Status::Reached,
                "{method:?} {:?}",
                drive.navigator.reason()
            );
        }
    }
}

#[test]
fn slopes_close_directions_for_the_local_methods() {
    // 22 % up to the north: across it is steeper than the side slope allows (20 %), along it is not.
    let rows = ["gggggggggggggggg"; 16];
    let knowledge = ground(&rows, 0.22);
    let cell = crate::grid::Cell::new(8, 8);
    assert!(knowledge.slope_allows(cell, 1.57) && knowledge.slope_allows(cell, -1.57));
    assert!(!knowledge.slope_allows(cell, 0.0) && !knowledge.slope_allows(cell, std::f64::consts::PI));
    let mut drive = Drive::new(
        navigator(knowledge, (52.0, 0.0), DriveParams::default()),
        (12.0, 0.0),
        None,
    );
    drive.run(3.0);
    let seen = drive.navigator.histogram().unwrap();
    let east = seen.blocked[0];
    let north = seen.blocked[seen.blocked.len() / 4];
    assert!(east && !north, "{:?}", seen.blocked);
}

#[rstest]
fn ground_that_becomes_no_go_under_the_robot_is_left_and_the_rest_of_it_driven_around(
    #[values(true, false)] recover: bool,
) {
    let params = DriveParams {
        recover,
        ..DriveParams::default()
    };
    let mut drive = Drive::new(navigator(ground(&OVAL, 0.0), (60.0, 0.0), params), (6.0, 0.0), None);
    drive.run(3.0);
    let here = drive.at();
    // Where it is, and farther on across the straight way.
    for (x_m, radius_m) in [(here.x_m, 5.0), (36.0, 8.0)] {
        drive
            .navigator
            .learn_soil(&SoilUpdate {
                time_s: 3.0,
                source: "scout".to_owned(),
                extent: Extent::Disc {
                    at: Position::new(x_m, 0.0),
                    radius_m,
                },
                word: Word::Class(SoilClass::None),
                cone_index_kpa: None,
            })
            .unwrap();
    }
    let learnt = drive.places.len();
    assert_eq!(
        drive.run(200.0).status,
        Status::Reached,
        "{:?}",
        drive.navigator.reason()
    );
    // By the discs themselves, less half the diagonal of a cell.
    let on_no_go = |place: &Position| {
        [(here.x_m, 5.0), (36.0, 8.0)]
            .iter()
            .any(|(x_m, radius_m)| (place.x_m - x_m).hypot(place.y_m) < radius_m - CELL_M / 2.0_f64.sqrt())
    };
    let after = &drive.places[learnt..];
    assert!(on_no_go(&after[0]));
    let left = after.iter().position(|place| !on_no_go(place)).unwrap();
    assert!(!after[left..].iter().any(on_no_go));
}

#[test]
fn finished_ranks_learn_nothing_and_say_so() {
    let mut navigator = Navigator::new(&jackal(), Position::new(5.0, 0.0), None, DriveParams::default()).unwrap();
    let update = SoilUpdate {
        time_s: 0.0,
        source: String::new(),
        extent: Extent::Unit(1),
        word: Word::Class(SoilClass::Sand),
        cone_index_kpa: None,
    };
    assert_eq!(navigator.learn_soil(&update), Err(DriveError::NoKnowledge));
    assert!(navigator.knowledge().is_none() && navigator.global_route().is_empty());
}

#[test]
fn another_goal_gets_another_route() {
    let mut drive = Drive::new(
        navigator(ground(&OVAL, 0.0), (60.0, 0.0), DriveParams::default()),
        (6.0, 0.0),
        None,
    );
    drive.step(None);
    drive.navigator.set_goal(Position::new(6.0, 20.0)).unwrap();
    drive.step(None);
    let last = *drive.navigator.global_route().last().unwrap();
    assert!(last.distance_m(Position::new(6.0, 20.0)) < 1e-9);
    assert_eq!(drive.run(60.0).status, Status::Reached);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn no_reading_and_no_news_break_a_drive(
        told in prop::collection::vec(
            (prop::option::of((any::<f64>(), any::<f64>(), prop::collection::vec(any::<f64>(), 0..4))),
             prop::option::of((-5.0f64..70.0, -40.0f64..40.0, 0.0f64..1e4)),
             prop::option::of((any::<f64>(), any::<f64>(), any::<f64>(), 0usize..7, prop::option::of(any::<f64>())))),
            1..12,
        ),
        blocks: bool,
    ) {
        let params = DriveParams {
            window_cells: 64,
            outside_nests: if blocks { OutsideNests::Block } else { OutsideNests::Cost },
            probing: ProbePolicy::WhereItMatters { probe_cost: 0.0 },
            ..DriveParams::default()
        };
        let mut drive = Drive::new(navigator(ground(&OVAL, 0.0), (60.0, 0.0), params), (6.0, 0.0), None);
        for (broken, sound, news) in told {
            if let Some((x_m, y_m, radius_m, class, kpa)) = news {
                let _ = drive.navigator.learn_soil(&SoilUpdate {
                    time_s: x_m,
                    source: "?".to_owned(),
                    extent: Extent::Disc { at: Position::new(x_m % 80.0, y_m % 40.0), radius_m },
                    word: Word::Class(SoilClass::ALL[class]),
                    cone_index_kpa: kpa,
                });
            }
            let broken = broken.map(|(x_m, y_m, figures)| PenetrometerReading {
                x_m, y_m, depths_m: figures.clone(), cone_indices_kpa: figures, refusal_depth_m: None, sleeve_frictions_kpa: None,
            });
            let sound = sound.map(|(x, y, kpa)| reading(Position::new(x, y), kpa));
            for hand in [broken, sound] {
                let command = drive.step(hand.as_ref());
                prop_assert!(command.speed_mps.is_finite() && command.turn_rate_radps.is_finite());
            }
        }
        let knowledge = drive.navigator.knowledge().unwrap();
        prop_assert!(knowledge.standing() != Standing::Unasked);
    }
}
