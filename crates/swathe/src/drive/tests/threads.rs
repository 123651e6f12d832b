//! Ways of the footprint in tight places, where there are none, and stops in time.

use proptest::prelude::*;
use rstest::rstest;

use super::world::vehicle;
use crate::drive::memory::{Memory, Seen};
use crate::drive::motion::Now;
use crate::drive::params::Shape;
use crate::drive::safety::Surroundings;
use crate::drive::thread::{Effort, Leg, Met, Search, Threading, after};
use crate::drive::watch::Watch;
use crate::drive::{DriveParams, Navigator};
use crate::grid::Position;
use crate::local::{CertaintyGrid, CertaintyParams};
use crate::sensor::{Pose, wrap};

type Point = (f64, f64);

/// Points of a line, as dense as a scan from nearby has them.
fn line((x1, y1): Point, (x2, y2): Point) -> Vec<Point> {
    let count = ((x2 - x1).hypot(y2 - y1) / 0.02).ceil() as usize;
    (0..=count)
        .map(|k| k as f64 / count as f64)
        .map(|share| (x1 + share * (x2 - x1), y1 + share * (y2 - y1)))
        .collect()
}

fn square((x, y): Point, half: f64) -> Vec<Point> {
    let corners = [
        (-half, -half),
        (half, -half),
        (half, half),
        (-half, half),
        (-half, -half),
    ];
    let at = |(dx, dy): Point| (x + dx, y + dy);
    corners
        .windows(2)
        .flat_map(|pair| line(at(pair[0]), at(pair[1])))
        .collect()
}

enum Told {
    Way(Vec<Leg>),
    None { goal_closed: bool },
}

fn search(shape: &Shape, points: &[Point], start: &Pose, goal: Point, effort: Effort) -> Told {
    let grid = CertaintyGrid::new(CertaintyParams::default(), 0.0, 0.0);
    let mut memory = Memory::new(0.2, 200);
    for row in -120..120 {
        for column in -120..120 {
            memory.set((row, column), Seen::Free);
        }
    }
    let mut met = Met::new();
    for &(x_m, y_m) in points {
        let part = |along: f64| ((along / 0.1).rem_euclid(1.0) * 8.0) as u32;
        *met.entry(grid.cell_of(x_m, y_m)).or_default() |= 1 << (part(-y_m) * 8 + part(x_m));
    }
    let goal = (Position::new(goal.0, goal.1), 0.3);
    let mut search = Search::new((&met, &memory, &grid), shape, start, goal, effort);
    loop {
        match search.go_on() {
            Threading::On => {}
            Threading::Found(legs) => return Told::Way(legs),
            Threading::Nothing { goal_closed } => return Told::None { goal_closed },
        }
    }
}

/// Poses along legs, a centimetre and a degree or so apart.
fn poses(start: &Pose, legs: &[Leg]) -> Vec<(f64, f64, f64)> {
    let mut at = (start.x_m, start.y_m, start.heading_rad);
    let mut all = vec![at];
    for leg in legs {
        match *leg {
            Leg::Turn { to_rad } => {
                let by_rad = wrap(to_rad - at.2);
                all.extend((0..=50).map(|k| (at.0, at.1, at.2 + by_rad * f64::from(k) / 50.0)));
                at.2 = to_rad;
            }
            Leg::Run {
                from,
                curvature_per_m,
                length_m,
            } => {
                assert!((from.0 - at.0).hypot(from.1 - at.1) < 1e-6 && wrap(from.2 - at.2).abs() < 1e-6);
                let count = (length_m.abs() / 0.01).ceil().max(1.0);
                let along = |k: u32| after(from, curvature_per_m, length_m * f64::from(k) / count);
                all.extend((0..=count as u32).map(along));
                at = after(from, curvature_per_m, length_m);
            }
        }
    }
    all
}

/// Least distance of points from a footprint, negative inside.
fn room_m(shape: &Shape, (x, y, heading_rad): (f64, f64, f64), points: &[Point]) -> f64 {
    let (sin, cos) = heading_rad.sin_cos();
    points
        .iter()
        .map(|&(px, py)| {
            let (dx, dy) = (px - x, py - y);
            let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
            (ahead.abs() - shape.half_length_m).max(left.abs() - shape.half_width_m)
        })
        .fold(f64::INFINITY, f64::min)
}

fn shape(turn_radius_m: f64) -> Shape {
    Shape::of(&vehicle(0.99, 0.67, 1.0, turn_radius_m), &DriveParams::default())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn a_way_keeps_clear_of_all_that_was_met_and_leads_to_the_goal(
        crates in prop::collection::vec((-4.0..4.0_f64, -4.0..4.0_f64, 0.15..0.5_f64), 0..14),
        heading_rad in -3.0..3.0_f64, turns in prop::sample::select(vec![0.0, 0.8]),
    ) {
        let (start, goal) = (Pose::level(-5.5, 0.0, heading_rad), (5.5, 0.3));
        let points: Vec<Point> = crates.iter().flat_map(|&(x, y, half)| square((x, y), half)).collect();
        let shape = shape(turns);
        if let Told::Way(legs) = search(&shape, &points, &start, goal, Effort::Usual) {
            let way = poses(&start, &legs);
            for &pose in &way {
                // 0.06 m less what a cell's part is wide and what a turn swings out between its pieces.
                prop_assert!(room_m(&shape, pose, &points) > 0.03, "{pose:?}");
            }
            let end = way[way.len() - 1];
            prop_assert!((end.0 - goal.0).hypot(end.1 - goal.1) <= 0.3 + 1e-6);
        } else {
            // So few crates never close a field of that size for a vehicle that turns in place.
            prop_assert!(turns > 0.0 || crates.len() > 6);
        }
    }
}

#[rstest]
#[case::beside_a_wall(0.115, 0.3)]
#[case::nearer(0.09, 0.25)]
fn a_vehicle_beside_a_wall_gets_away_without_room_to_turn(#[case] right_m: f64, #[case] left_m: f64) {
    let shape = shape(0.0);
    let start = Pose::level(0.0, 0.0, 0.02);
    let wall_m = -shape.half_width_m - right_m;
    let mut points = line((-5.0, wall_m), (5.0, wall_m));
    points.extend(square((0.3, shape.half_width_m + left_m + 0.3), 0.3));
    points.extend(line((-5.0, wall_m), (-5.0, 2.0)));
    let Told::Way(legs) = search(&shape, &points, &start, (-2.0, 3.0), Effort::Usual) else {
        panic!("it can drive off along the wall");
    };
    assert!(
        poses(&start, &legs)
            .into_iter()
            .all(|pose| room_m(&shape, pose, &points) > 0.01)
    );
}

#[rstest]
#[case::short(0.6)]
#[case::long(4.0)]
fn a_vehicle_in_a_crooked_slot_drives_out_of_it(#[case] ahead_m: f64) {
    // Twelve degrees off the nearest direction, and no room to turn to it.
    let shape = shape(0.0);
    let heading_rad: f64 = 0.21;
    let start = Pose::level(0.0, 0.0, heading_rad);
    let (sin, cos) = heading_rad.sin_cos();
    let at = |ahead: f64, left: f64| (cos * ahead - sin * left, sin * ahead + cos * left);
    let half = shape.half_width_m + 0.07;
    let mut points = line(at(-0.8, half), at(ahead_m, half));
    points.extend(line(at(-0.8, -half), at(ahead_m, -half)));
    points.extend(line(at(-0.8, -half), at(-0.8, half)));
    let Told::Way(legs) = search(&shape, &points, &start, (-4.0, 0.0), Effort::Tight) else {
        panic!("it can drive straight ahead");
    };
    assert!(
        poses(&start, &legs)
            .into_iter()
            .all(|pose| room_m(&shape, pose, &points) > 0.005)
    );
}

#[rstest]
#[case::around_the_goal((4.0, 0.0), true)]
#[case::around_the_robot((-4.0, 0.0), false)]
fn a_ring_of_things_is_told_by_what_it_closes_in(#[case] middle: Point, #[case] expected: bool) {
    for turn_radius_m in [0.0, 0.8] {
        let start = Pose::level(-4.0, 0.0, 0.0);
        match search(
            &shape(turn_radius_m),
            &square(middle, 2.0),
            &start,
            (4.0, 0.0),
            Effort::Tight,
        ) {
            Told::None { goal_closed } => assert_eq!(goal_closed, expected),
            Told::Way(_) => panic!("there is no way"),
        }
    }
}

#[test]
fn a_way_round_a_long_wall_is_found_with_more_effort() {
    let start = Pose::level(-2.0, 0.0, 0.0);
    let wall = line((0.0, -20.0), (0.0, 20.0));
    let told = |effort| search(&shape(0.0), &wall, &start, (2.0, 0.0), effort);
    assert!(matches!(told(Effort::Usual), Told::None { .. }));
    let Told::Way(legs) = told(Effort::Wide) else {
        panic!("it leads around the end of the wall");
    };
    assert!(legs.iter().map(Leg::length_m).sum::<f64>() > 40.0);
}

/// A navigator at the origin that moves and was told something, with one place around it that it knows of.
fn moving(place: Point, limits: Shape, moves: (f64, f64), told: (f64, f64)) -> (Navigator, Now<'static>) {
    let mut navigator = Navigator::new(
        &vehicle(0.99, 0.67, 1.0, 0.0),
        Position::new(9.0, 0.0),
        None,
        DriveParams::default(),
    )
    .expect("plain figures");
    navigator.shape = limits;
    navigator.around = around(place, &limits);
    navigator.last_command.speed_mps = told.0;
    navigator.last_command.turn_rate_radps = told.1;
    let now = Now {
        time_s: 1.0,
        step_s: 0.05,
        age_s: 0.0,
        pose: Pose::level(0.0, 0.0, 0.0),
        speed_mps: moves.0,
        turn_rate_radps: moves.1,
        scan: None,
        answer: None,
        aim: Position::new(9.0, 0.0),
    };
    (navigator, now)
}

/// Surroundings of a robot at the origin that hold one place.
fn around(place: Point, shape: &Shape) -> Surroundings {
    let mut grid = CertaintyGrid::new(CertaintyParams::default(), 0.0, 0.0);
    grid.stamp(place.0, place.1);
    let mut found = Surroundings::default();
    found.gather((&grid, 6), &Pose::level(0.0, 0.0, 0.0), shape, (5.0, 1.0), (0.1, 0.03));
    found
}

#[test]
fn a_stop_in_time_is_one_within_what_is_free() {
    let shape = Shape {
        braking_mps2: 0.5,
        acceleration_mps2: 0.3,
        ..shape(0.0)
    };
    // At 1 m/s the vehicle needs 1 m, and 0.495 m are its own.
    for (away_m, expected) in [(1.2, false), (1.75, true)] {
        let there = around((away_m, 0.0), &shape);
        assert_eq!(
            there.stays_clear(&shape, (1.0, 0.0), (0.0, 0.0), 0.0),
            expected,
            "{away_m}"
        );
        // To go on for half a second first is another thing.
        assert!(!there.stays_clear(&shape, (1.0, 0.0), (1.0, 0.0), 0.5));
        assert!(there.stays_clear(&shape, (0.0, 0.0), (0.0, 0.0), 0.5));
    }
}

#[test]
fn an_arc_that_cannot_be_driven_at_once_is_no_way_past() {
    let shape = Shape {
        braking_mps2: 0.5,
        acceleration_mps2: 0.3,
        ..shape(0.0)
    };
    let there = around((1.3, 0.0), &shape);
    // On this arc the place would be passed on the left by far.
    let told = (0.9, -2.2);
    let on_arc = there.free_m(&shape, told.1 / told.0, true, 1.5, |_, _| true);
    assert!(on_arc > 1.2, "{on_arc}");
    // But the wheels take a second to such a turn, and by then it is too late.
    assert!(!there.stays_clear(&shape, (0.9, 0.0), told, 0.1));
    assert!(there.stays_clear(&shape, (0.3, 0.0), (0.3, -0.7), 0.06));
}

#[test]
fn a_drive_that_comes_to_the_same_places_again_and_again_is_noticed() {
    let mut watch = Watch::default();
    // There and back again is a dead end.
    for k in 0..80 {
        let x_m = 0.25 * f64::from(if k < 40 { k } else { 80 - k });
        watch.note_place(x_m, 0.0, 0.5);
        assert!(!watch.goes_round());
    }
    let mut watch = Watch::default();
    let mut rounds = 0.0;
    while !watch.goes_round() {
        let (sin, cos) = (rounds * std::f64::consts::TAU).sin_cos();
        watch.note_place(3.0 * cos, 3.0 * sin, 0.5);
        rounds += 0.01;
        assert!(rounds < 5.0);
    }
    assert!(rounds > 2.5, "{rounds}");
    watch.forget_places();
    assert!(!watch.goes_round());
}

#[test]
fn a_vehicle_with_a_turning_circle_keeps_room_beside_it() {
    // The straight way along the wall is the shortest, but nobody could turn off it.
    let shape = shape(0.8);
    let start = Pose::level(0.0, 0.0, 0.0);
    let wall_m = shape.half_width_m + 0.09;
    let wall = line((2.0, wall_m), (12.0, wall_m));
    let Told::Way(legs) = search(&shape, &wall, &start, (9.0, 0.0), Effort::Usual) else {
        panic!("the ground is open");
    };
    let way = poses(&start, &legs);
    let close = way.iter().filter(|&&pose| room_m(&shape, pose, &wall) < 0.2).count();
    assert!(close < way.len() / 3, "{close} of {}", way.len());
}

#[test]
fn a_vehicle_backs_only_where_it_saw_the_ground_itself() {
    // The memory knows the ground by coarser cells than the certainty grid, which has seen nothing here.
    let shape = shape(0.8);
    let start = Pose::level(0.0, 0.0, 0.0);
    let ahead = line((shape.half_length_m + 0.3, -3.0), (shape.half_length_m + 0.3, 3.0));
    assert!(matches!(
        search(&shape, &ahead, &start, (-4.0, 0.0), Effort::Tight),
        Told::None { .. }
    ));
}

#[test]
fn a_command_is_kept_to_where_a_stop_at_once_would_touch() {
    let shape = shape(0.0);
    let limits = Shape {
        braking_mps2: 1.0,
        acceleration_mps2: 2.0,
        ..shape
    };
    let moves = (1.0, 1.5);
    let told = (1.0, 3.0);
    let mut kept = 0;
    for k in 0..400 {
        let place = (0.7 + 0.004 * f64::from(k % 100), -0.3 + 0.2 * f64::from(k / 100));
        let there = around(place, &limits);
        if there.stays_clear(&limits, moves, (0.0, 0.0), 0.0) || !there.stays_clear(&limits, moves, told, 0.05) {
            continue;
        }
        let (navigator, now) = moving(place, limits, moves, told);
        // Straight on is no way to go either.
        if navigator.guarded(&now, (1.0, 0.0)) == told {
            kept += 1;
        }
    }
    assert!(kept > 0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8192))]
    #[test]
    fn after_a_command_a_stop_is_as_safe_as_to_go_on(
        place in (0.2f64..1.2, -0.8f64..0.8), moves in (0.2f64..1.5, -3.0f64..3.0), wanted in (0.2f64..1.5, -4.0f64..4.0),
    ) {
        let limits = Shape { braking_mps2: 2.0, acceleration_mps2: 2.0, ..shape(0.0) };
        let (navigator, now) = moving(place, limits, moves, moves);
        // Where no stop was safe before, no rule makes it so.
        let was_safe = navigator.around.stays_clear(&limits, moves, (0.0, 0.0), 0.0);
        let told = navigator.guarded(&now, wanted);
        prop_assert!(!was_safe || told == (0.0, 0.0) || navigator.around.stays_clear(&limits, moves, told, now.step_s), "{told:?}");
    }
}
