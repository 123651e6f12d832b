//! What moves: tracks against worlds that are known, and giving way to it.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use proptest::prelude::*;

use super::world::{World, car, jackal, pioneer};
use crate::drive::movers::{Plan, cost};
use crate::drive::odometry::Odometry;
use crate::drive::params::Shape;
use crate::drive::tracks::{Mover, Tracks};
use crate::drive::{DriveParams, Navigator, Observation, Status};
use crate::grid::Position;
use crate::sensor::{Mount, Pose, wrap};
use crate::vehicle::Vehicle;

const STEP_S: f64 = 1.0 / 35.0;

/// A pose that is off the truth: turned and shifted by what the last fix made of it.
fn told(pose: &Pose, (east_m, north_m, turn_rad): (f64, f64, f64)) -> Pose {
    let (sin, cos) = turn_rad.sin_cos();
    Pose::level(
        east_m + cos * pose.x_m - sin * pose.y_m,
        north_m + sin * pose.x_m + cos * pose.y_m,
        wrap(pose.heading_rad + turn_rad),
    )
}

/// What leads from one pose to another.
fn from_to(one: &Pose, other: &Pose) -> (f64, f64, f64) {
    let turn_rad = wrap(other.heading_rad - one.heading_rad);
    let turned = told(one, (0.0, 0.0, turn_rad));
    (other.x_m - turned.x_m, other.y_m - turned.y_m, turn_rad)
}

/// Watches a world that changes with time from a vehicle that drives an arc; its pose jumps once a second.
fn watch(
    world: impl Fn(f64) -> World,
    (speed_mps, turn_radps): (f64, f64),
    jumps: &[(f64, f64, f64)],
    mut each: impl FnMut(f64, &Tracks, (f64, f64, f64)),
) {
    let (mut odometry, mut tracks) = (Odometry::default(), Tracks::default());
    let mut truth = Pose::default();
    for k in 0..(jumps.len() * 35) {
        let time_s = k as f64 * STEP_S;
        let jump = jumps[k / 35];
        let step_s = if k == 0 { 0.0 } else { STEP_S };
        let pose = odometry.roll(time_s, &told(&truth, jump), (speed_mps, turn_radps), step_s);
        let scan = world(time_s).scan(&truth, Mount::default(), 181, PI, 8.0);
        tracks.beams = (0..181).map(|beam| scan.beam(beam)).collect();
        tracks.observe(time_s, &pose, &scan);
        each(time_s, &tracks, from_to(&truth, &pose));
        truth = on_arc(&truth, (speed_mps, turn_radps));
    }
}

/// Where a pose gets to in a step.
fn on_arc(from: &Pose, (speed_mps, turn_radps): (f64, f64)) -> Pose {
    let middle_rad = from.heading_rad + turn_radps * STEP_S / 2.0;
    Pose::level(
        from.x_m + speed_mps * STEP_S * middle_rad.cos(),
        from.y_m + speed_mps * STEP_S * middle_rad.sin(),
        wrap(from.heading_rad + turn_radps * STEP_S),
    )
}

fn fixes() -> impl Strategy<Value = Vec<(f64, f64, f64)>> {
    prop::collection::vec((-0.2..0.2_f64, -0.2..0.2_f64, -0.05..0.05_f64), 4)
}

/// What seems to move among posts and walls that stand, less the posts that a narrow robot would run into.
fn seems_to_move(posts: &[(f64, f64, f64)], drives: (f64, f64), fixes: &[(f64, f64, f64)]) -> Option<Mover> {
    let steps = fixes.len() * 35;
    let way: Vec<Pose> = std::iter::successors(Some(Pose::default()), |pose| Some(on_arc(pose, drives)))
        .take(steps)
        .collect();
    let is_passed = |&&(x_m, y_m, radius_m): &&(f64, f64, f64)| {
        way.iter()
            .all(|pose| (x_m - pose.x_m).hypot(y_m - pose.y_m) > radius_m + 0.2)
    };
    let world = World {
        discs: posts.iter().filter(is_passed).copied().collect(),
        walls: vec![[(7.5, -4.0), (7.5, 4.0)], [(3.0, 2.0), (6.0, 2.5)]],
    };
    let mut first = None;
    watch(
        |_| world.clone(),
        drives,
        fixes,
        |time_s, tracks, _| {
            first = first.or_else(|| tracks.found(time_s).first().copied());
        },
    );
    first
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn what_stands_never_moves(
        posts in prop::collection::vec((1.0..7.0_f64, -4.0..4.0_f64, 0.1..0.6_f64), 0..12),
        drives_mps in -0.5..0.7_f64, turns_radps in -0.6..0.6_f64, fixes in fixes(),
    ) {
        let mover = seems_to_move(&posts, (drives_mps, turns_radps), &fixes);
        prop_assert!(mover.is_none(), "{mover:?}");
    }
}

/// Near what it passes the beams lie denser than the pose is sure.
#[test]
fn a_thin_post_that_is_nearly_touched_in_passing_never_moves() {
    let fixes = [
        (0.0, 0.127_771, 0.039_135),
        (0.0, 0.0, 0.0),
        (0.0, -0.175_089, 0.017_738),
        (0.184_929, -0.129_607, -0.019_377),
    ];
    assert_eq!(
        seems_to_move(&[(2.633_842, -0.126_575, 0.1)], (0.695_681, -0.105_893), &fixes),
        None
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn who_walks_is_found_where_he_is_and_as_fast_as_he_goes(
        away_m in 2.5..5.0_f64, bearing_rad in -0.5..0.5_f64, course_rad in FRAC_PI_2..3.0 * FRAC_PI_2, walks_mps in 0.4..1.0_f64,
        drives_mps in 0.0..0.6_f64, turns_radps in -0.2..0.2_f64, fixes in fixes(),
    ) {
        let from = (away_m * bearing_rad.cos(), away_m * bearing_rad.sin());
        let (vx, vy) = (walks_mps * course_rad.cos(), walks_mps * course_rad.sin());
        // Who walks straight away hides where he goes to: he is found later.
        let place = |time_s: f64| (from.0 + vx * (time_s - 1.0), from.1 + vy * (time_s - 1.0));
        let world = |time_s: f64| {
            let at = place(time_s);
            World { discs: vec![(at.0, at.1, 0.3)], walls: vec![[(7.5, -4.0), (7.5, 4.0)]] }
        };
        let mut wrong = None;
        watch(world, (drives_mps, turns_radps), &fixes, |time_s, tracks, off| {
            let at = place(time_s);
            if (1.9..2.0).contains(&time_s) && at.0 > 1.0 {
                let truth = told(&Pose::level(at.0, at.1, course_rad), off);
                let found = tracks.found(time_s);
                let is_right = found.len() == 1 && found.iter().all(|one| {
                    let off_m = (one.x_m - truth.x_m).hypot(one.y_m - truth.y_m);
                    let course = truth.heading_rad;
                    let off_mps = (one.east_mps - walks_mps * course.cos()).hypot(one.north_mps - walks_mps * course.sin());
                    off_m < 0.2 && off_mps < 0.25
                });
                if !is_right {
                    wrong = Some((time_s, truth, found));
                }
            }
        });
        prop_assert!(wrong.is_none(), "{wrong:?}");
    }

    #[test]
    fn who_has_gone_out_of_sight_goes_on(north_m in 0.8..2.0_f64, walks_mps in 0.5..1.0_f64) {
        // From ahead on the left to behind: the fan ends abeam.
        let place = |time_s: f64| (2.0 - walks_mps * time_s, north_m);
        let world = |time_s: f64| {
            let at = place(time_s);
            World { discs: vec![(at.0, at.1, 0.3)], walls: Vec::new() }
        };
        let mut off_m = f64::INFINITY;
        watch(world, (0.0, 0.0), &[(0.0, 0.0, 0.0); 7], |time_s, tracks, _| {
            let at = place(time_s);
            let nearest = tracks.found(time_s).iter().map(|one| (one.x_m - at.0).hypot(one.y_m - at.1)).fold(f64::INFINITY, f64::min);
            off_m = nearest;
        });
        prop_assert!(off_m < 0.6, "{off_m}");
    }
}

#[test]
fn who_comes_up_beside_at_the_edge_of_the_fan_is_found() {
    // A part of him is beyond the edge all the time: only what he stands on now, which was free before, tells that he walks.
    let drives_mps = 0.6;
    let world = |time_s: f64| World {
        discs: vec![(drives_mps * time_s - 0.5 + 0.12 * time_s, 1.2, 0.3)],
        walls: vec![[(7.5, -4.0), (7.5, 4.0)]],
    };
    let mut found_s = None;
    watch(world, (drives_mps, 0.0), &[(0.0, 0.0, 0.0); 6], |time_s, tracks, _| {
        let is_he = |one: &Mover| (one.y_m - 1.2).abs() < 0.2 && (one.east_mps - 0.72).abs() < 0.25;
        if tracks.found(time_s).iter().any(is_he) {
            found_s.get_or_insert(time_s);
        }
    });
    assert!(found_s.is_some_and(|time_s| time_s < 5.0), "{found_s:?}");
}

#[test]
fn who_has_gone_out_of_sight_is_not_forgotten_while_a_vehicle_backs() {
    let place = |time_s: f64| (2.0 - 0.5 * time_s, 1.2);
    let world = |time_s: f64| {
        let at = place(time_s);
        World {
            discs: vec![(at.0, at.1, 0.3)],
            walls: Vec::new(),
        }
    };
    let mut off_m = f64::INFINITY;
    watch(world, (0.0, 0.0), &[(0.0, 0.0, 0.0); 24], |time_s, tracks, _| {
        let at = place(time_s);
        let away = |one: &Mover| (one.x_m - at.0).hypot(one.y_m - at.1);
        off_m = tracks.found(time_s).iter().map(away).fold(f64::INFINITY, f64::min);
    });
    assert!(off_m < 2.0, "{off_m}");
}

fn mover() -> impl Strategy<Value = Mover> {
    (-4.0..4.0_f64, -4.0..4.0_f64, -1.0..1.0_f64, -1.0..1.0_f64).prop_map(|(x_m, y_m, east_mps, north_mps)| Mover {
        x_m,
        y_m,
        east_mps,
        north_mps,
        half_m: 0.3,
        unsure_m: 0.0,
        unseen_s: 0.0,
    })
}

fn plan() -> impl Strategy<Value = Plan> {
    (-1.4..1.4_f64, -1.0..1.0_f64, -1.0..1.0_f64, 0.0..3.0_f64).prop_map(
        |(turn_rad, curvature_per_m, speed_mps, way_m)| Plan {
            turn_rad,
            turn_rate_radps: 1.0,
            curvature_per_m,
            speed_mps,
            way_m,
        },
    )
}

proptest! {
    #[test]
    fn a_plan_costs_the_same_wherever_it_is_made_and_more_with_more_about(
        movers in prop::collection::vec(mover(), 1..4), plan in plan(), moves in (-0.5..1.0_f64, -1.0..1.0_f64),
        shift in (-50.0..50.0_f64, -50.0..50.0_f64, -3.0..3.0_f64),
    ) {
        let shape = Shape::of(&jackal(), &DriveParams::default());
        let weigh = |movers: &[Mover], pose: &Pose| cost(movers, &shape, pose, moves, 1.5, &plan).0;
        let here = weigh(&movers, &Pose::default());
        let there = Pose::level(shift.0, shift.1, shift.2);
        let turned: Vec<Mover> = movers.iter().map(|one| {
            let at = told(&Pose::level(one.x_m, one.y_m, 0.0), shift);
            let speed = told(&Pose::level(one.east_mps, one.north_mps, 0.0), (0.0, 0.0, shift.2));
            Mover { x_m: at.x_m, y_m: at.y_m, east_mps: speed.x_m, north_mps: speed.y_m, ..*one }
        }).collect();
        prop_assert!((weigh(&turned, &there) - here).abs() < 1e-6);
        prop_assert!(weigh(&movers[1..], &Pose::default()) <= here);
    }

    #[test]
    fn who_stands_is_met_exactly_when_a_line_leads_through_him(
        aside_m in -3.0..3.0_f64, course_rad in 0.0..TAU, walks_mps in 0.8..1.0_f64,
    ) {
        // Two metres before he is nearest to the middle of a vehicle at rest, which has the same reach all around.
        let shape = Shape { half_length_m: 0.2, half_width_m: 0.2, ..Shape::of(&jackal(), &DriveParams::default()) };
        let (sin, cos) = course_rad.sin_cos();
        let one = Mover {
            x_m: -2.0 * cos - aside_m * sin, y_m: -2.0 * sin + aside_m * cos,
            east_mps: walks_mps * cos, north_mps: walks_mps * sin, half_m: 0.3, unsure_m: 0.0, unseen_s: 0.0,
        };
        let (costs, _) = cost(&[one], &shape, &Pose::default(), (0.0, 0.0), 1.5, &Plan::REST);
        if aside_m.abs() < 0.4 {
            prop_assert!(costs > 1.0, "{costs}");
        }
        if aside_m.abs() > 0.2 * 1.5 + 0.3 + 0.7 {
            prop_assert!(costs == 0.0, "{costs}");
        }
    }
}

/// Drives in the open while somebody walks straight across; the least distance between the two, and how it ended.
fn meeting(vehicle: &Vehicle, walks_mps: f64, course_rad: f64, at_s: f64) -> (f64, Status) {
    let goal = (12.0, 0.0);
    let params = DriveParams::default();
    let mut navigator = Navigator::new(vehicle, Position::new(goal.0, goal.1), None, params).unwrap();
    let (mut pose, mut speed_mps, mut turn_radps) = (Pose::default(), 0.0, 0.0);
    let mut least_m = f64::INFINITY;
    let mut status = Status::Driving;
    for k in 0..(120.0 / STEP_S) as usize {
        let time_s = k as f64 * STEP_S;
        // He is in the middle of the way at that time.
        let (x_m, y_m) = (
            6.0 + walks_mps * (time_s - at_s) * course_rad.cos(),
            walks_mps * (time_s - at_s) * course_rad.sin(),
        );
        let world = World {
            discs: vec![(x_m, y_m, 0.3)],
            walls: Vec::new(),
        };
        least_m = least_m.min(world.clearance_m(&pose, vehicle));
        let scan = world.scan(&pose, Mount::default(), 181, PI, 8.0);
        let command = navigator.step(&Observation {
            time_s,
            pose,
            speed_mps,
            turn_rate_radps: turn_radps,
            scan: Some(&scan),
            reading: None,
        });
        status = command.status;
        if status == Status::Reached {
            break;
        }
        (speed_mps, turn_radps) = (command.speed_mps, command.turn_rate_radps);
        let middle_rad = pose.heading_rad + turn_radps * STEP_S / 2.0;
        pose = Pose::level(
            pose.x_m + speed_mps * STEP_S * middle_rad.cos(),
            pose.y_m + speed_mps * STEP_S * middle_rad.sin(),
            wrap(pose.heading_rad + turn_radps * STEP_S),
        );
    }
    (least_m, status)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn who_crosses_in_the_open_is_never_touched(
        walks_mps in 0.3..1.0_f64, course_rad in FRAC_PI_2 - 0.6..FRAC_PI_2 + 0.6, at_s in 2.0..12.0_f64, kind in 0..3_usize,
    ) {
        let vehicle = &[jackal(), pioneer(), car()][kind];
        let (least_m, status) = meeting(vehicle, walks_mps, course_rad, at_s);
        prop_assert!(least_m > 0.05 && status == Status::Reached, "{least_m} {status:?}");
    }
}

#[test]
fn an_arc_to_which_the_wheels_do_not_come_in_time_is_no_way_past_him() {
    let slow = Shape {
        acceleration_mps2: 0.3,
        ..Shape::of(&jackal(), &DriveParams::default())
    };
    let quick = Shape {
        acceleration_mps2: 30.0,
        ..slow
    };
    let one = Mover {
        x_m: 1.6,
        y_m: 0.0,
        east_mps: -0.5,
        north_mps: 0.0,
        half_m: 0.3,
        unsure_m: 0.0,
        unseen_s: 0.0,
    };
    let plan = Plan {
        curvature_per_m: 2.0,
        speed_mps: 1.0,
        way_m: 1.6,
        ..Plan::REST
    };
    let weigh =
        |shape: &Shape, turns_radps: f64| cost(&[one], shape, &Pose::default(), (1.0, turns_radps), 1.5, &plan).0;
    assert!(weigh(&quick, 0.0) < 1.0, "{}", weigh(&quick, 0.0));
    assert!(weigh(&slow, 0.0) > 5.0, "{}", weigh(&slow, 0.0));
    // Who is on the arc already is past him.
    assert!(weigh(&slow, 2.0) < 1.0);
}

#[test]
fn a_large_body_looks_ahead_until_he_is_past_it() {
    let jackal = Shape::of(&jackal(), &DriveParams::default());
    let large = Shape {
        half_length_m: 2.2,
        half_width_m: 1.1,
        radius_m: 2.46,
        ..jackal
    };
    // Where he comes to the body's side after six seconds.
    let coming = |shape: &Shape| Mover {
        x_m: -shape.half_length_m,
        y_m: shape.half_width_m + 0.3 + 6.0 * 0.6,
        east_mps: 0.0,
        north_mps: -0.6,
        half_m: 0.3,
        unsure_m: 0.0,
        unseen_s: 0.0,
    };
    let weigh = |shape: &Shape| cost(&[coming(shape)], shape, &Pose::default(), (0.0, 0.0), 1.5, &Plan::REST).0;
    assert_eq!(weigh(&jackal), 0.0);
    assert!(weigh(&large) > 1.0, "{}", weigh(&large));
}

/// Meetings with a slow vehicle, five of each figure evenly over its range, that end badly.
fn bad_meetings(walks_mps: [f64; 2], course_rad: [f64; 2], at_s: [f64; 2]) -> Vec<[f64; 3]> {
    let within = |[least, most]: [f64; 2], fifth: usize| least + (most - least) * fifth as f64 / 4.0;
    let all = (0..125).map(|k| {
        [
            within(walks_mps, k % 5),
            within(course_rad, k / 5 % 5),
            within(at_s, k / 25),
        ]
    });
    all.filter(|&[walks_mps, course_rad, at_s]| {
        let (least_m, status) = meeting(&pioneer(), walks_mps, course_rad, at_s);
        least_m <= 0.05 || status != Status::Reached
    })
    .collect()
}

#[test]
fn who_comes_up_from_abeam_is_not_cut_off() {
    // Half of him is beyond the fan for seconds: his place and speed come from the half that is seen.
    let bad = bad_meetings([0.85, 1.0], [0.97, 1.17], [9.0, 12.0]);
    assert!(bad.is_empty(), "{bad:?}");
}

#[test]
fn who_walks_along_does_not_lead_it_astray() {
    let bad = bad_meetings([0.3, 0.42], [1.0, 1.9], [8.0, 11.0]);
    assert!(bad.is_empty(), "{bad:?}");
}
