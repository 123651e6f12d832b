//! Drivable paths on drawn worlds, audited from their sampled poses alone.

use std::f64::consts::{FRAC_PI_2, PI};

use super::curves::principal;
use super::*;
use crate::grid::{Cell, GridGeometry, Layer};
use crate::planner::{Search, search, shorten};
use crate::progress::silent;
use crate::soil::SoilClass;
use crate::vehicle::fixtures::{pioneer, tractor};
use proptest::prelude::*;

const CELL_M: f64 = 2.0;

/// A world as text, 2 m cells: '#' is closed, 's' and 'g' are the ends.
struct World {
    elevation: Layer<f32>,
    soil: Layer<u8>,
    open: Vec<bool>,
    ends: [Cell; 2],
}

fn world(rows: &[&str]) -> World {
    let geometry = GridGeometry::new(rows.len(), rows[0].len(), CELL_M, 1000.0, 2000.0).unwrap();
    let bytes: Vec<u8> = rows.iter().flat_map(|row| row.bytes()).collect();
    let place = |letter| geometry.cell(bytes.iter().position(|&byte| byte == letter).unwrap());
    World {
        elevation: Layer::filled(geometry, 100.0),
        soil: Layer::filled(geometry, SoilClass::Gravel as u8),
        open: bytes.iter().map(|&byte| byte != b'#').collect(),
        ends: [place(b's'), place(b'g')],
    }
}

impl World {
    fn geometry(&self) -> GridGeometry {
        self.elevation.geometry()
    }

    fn ground<'a>(&'a self, vehicle: &'a Vehicle) -> Ground<'a> {
        let goal = self.geometry().centre(self.ends[1]);
        let (elevation, soil) = (self.elevation.view(), Some(self.soil.view()));
        Ground::new(elevation, soil, vehicle, 18.0, |index| self.open[index], None, goal)
    }

    /// The route as planned, its ends at the cells' centres.
    fn route(&self, ground: &Ground) -> Option<Vec<Position>> {
        let [start, goal] = self.ends;
        match search(ground, start, goal, &mut silent()) {
            Search::Found { cells, .. } => {
                let centres: Vec<Position> = cells.iter().map(|&cell| self.geometry().centre(cell)).collect();
                Some(shorten(ground, &centres))
            }
            _ => None,
        }
    }

    fn drive(&self, vehicle: &Vehicle, headings: [Option<f64>; 2]) -> Result<DrivablePath, Refusal> {
        let ground = self.ground(vehicle);
        let route = self.route(&ground).expect("the world has a route");
        let params = DrivableParams::default();
        let found = drivable_path(
            &ground,
            vehicle,
            &route,
            headings[0],
            headings[1],
            &params,
            &mut silent(),
        );
        found.unwrap()
    }

    /// Checks a path by its poses, with nothing of the planner's but the vehicle's radius and size.
    fn audit(&self, path: &DrivablePath, vehicle: &Vehicle, headings: [Option<f64>; 2]) {
        let poses = path.poses(0.3);
        let [start, goal] = self.ends.map(|cell| self.geometry().centre(cell));
        let (first, last) = (poses[0].pose, poses[poses.len() - 1].pose);
        assert_eq!((first.position(), last.position()), (start, goal));
        for (pose, heading) in [(first, headings[0]), (last, headings[1])] {
            if let Some(heading) = heading {
                assert!(principal(pose.heading_rad - heading).abs() < 1e-6, "{pose:?} {heading}");
            }
        }
        let least_m = vehicle.min_turn_radius_m;
        for three in poses.windows(3) {
            let [a, b, c] = [0, 1, 2].map(|i| three[i].pose.position());
            let is_cusp = three[0].reverse != three[1].reverse || three[1].reverse != three[2].reverse;
            if !is_cusp {
                let radius_m = circle_through(a, b, c);
                assert!(radius_m >= least_m * (1.0 - 1e-3), "{radius_m} of {least_m} at {b:?}");
            }
        }
        for pair in poses.windows(2) {
            let step_m = pair[0].pose.position().distance_m(pair[1].pose.position());
            let turned = principal(pair[1].pose.heading_rad - pair[0].pose.heading_rad).abs();
            assert!(
                step_m <= 0.3 + 1e-6 && turned <= step_m / least_m * 1.01 + 1e-6,
                "{pair:?}"
            );
            // The vehicle moves where its nose, or its tail, points.
            if step_m > 1e-3 {
                let (dx, dy) = (pair[1].pose.x_m - pair[0].pose.x_m, pair[1].pose.y_m - pair[0].pose.y_m);
                let nose = dy.atan2(dx) + if pair[0].reverse { PI } else { 0.0 };
                assert!(principal(nose - pair[0].pose.heading_rad).abs() < 0.1, "{pair:?}");
            }
        }
        // Arcs lie within half a per cent of their radius from the chords that were looked at.
        let reach_m = vehicle.circumscribed_radius_m() - 0.006 * least_m;
        for driven in &poses {
            for (index, open) in self.open.iter().enumerate() {
                let centre = self.geometry().centre(self.geometry().cell(index));
                let dx = ((driven.pose.x_m - centre.x_m).abs() - CELL_M / 2.0).max(0.0);
                let dy = ((driven.pose.y_m - centre.y_m).abs() - CELL_M / 2.0).max(0.0);
                assert!(*open || dx.hypot(dy) >= reach_m, "{driven:?} meets a closed cell");
            }
        }
        let length_m: f64 = path.arcs.iter().map(|driven| driven.arc.length_m.abs()).sum();
        approx::assert_relative_eq!(length_m, path.total.length_m, max_relative = 1e-6);
        let changes = poses
            .windows(2)
            .filter(|pair| pair[0].reverse != pair[1].reverse)
            .count();
        assert_eq!(changes, path.cusps);
        assert!(path.total.cost >= length_m / vehicle.max_speed_mps * (1.0 - 1e-9));
    }
}

/// Radius of the circle through three points; infinite on a line.
fn circle_through(a: Position, b: Position, c: Position) -> f64 {
    let (ab, bc, ca) = (a.distance_m(b), b.distance_m(c), c.distance_m(a));
    let area = ((b.x_m - a.x_m) * (c.y_m - a.y_m) - (c.x_m - a.x_m) * (b.y_m - a.y_m)).abs() / 2.0;
    if area < 1e-9 * ab.max(bc) || ab.min(bc) < 1e-3 {
        return f64::INFINITY;
    }
    ab * bc * ca / (4.0 * area)
}

const WALL: [&str; 20] = [
    "..............................",
    "..............................",
    "..............................",
    "..............................",
    "..............................",
    "..............#...............",
    "..............#...............",
    "..............#...............",
    "..............#...............",
    "..............#...............",
    "..............#...............",
    "..............#...............",
    "..............#...............",
    "..............#...............",
    "..............#...............",
    "...s..........#...........g...",
    "..............#...............",
    "..............#...............",
    "..............#...............",
    "..............#...............",
];

/// A lane too narrow to turn round in, open at the east.
const LANE: [&str; 12] = [
    "##########################",
    "##########################",
    "########################..",
    "######################....",
    "..........................",
    "..........................",
    "....g............s........",
    "..........................",
    "..........................",
    "######################....",
    "########################..",
    "##########################",
];

#[test]
fn a_wall_is_rounded_within_the_turning_radius() {
    let (world, vehicle) = (world(&WALL), tractor());
    for headings in [
        [None, None],
        [Some(FRAC_PI_2), None],
        [Some(PI), Some(PI)],
        [None, Some(FRAC_PI_2)],
    ] {
        let path = world.drive(&vehicle, headings).unwrap();
        world.audit(&path, &vehicle, headings);
        let route = world.ground(&vehicle);
        let cost: f64 = {
            let points = world.route(&route).unwrap();
            points
                .windows(2)
                .map(|pair| route.segment(pair[0], pair[1]).unwrap().cost)
                .sum()
        };
        // Turning costs, but not much more than turning round at both ends.
        let most = if headings == [None, None] {
            1.2 * cost
        } else {
            cost + 12.0
        };
        assert!(
            path.total.cost >= 0.97 * cost && path.total.cost <= most,
            "{} {cost} {headings:?}",
            path.total.cost
        );
    }
}

#[test]
fn in_a_lane_it_is_turned_by_reversing() {
    let (world, vehicle) = (world(&LANE), tractor());
    let away = [Some(0.0), Some(PI)];
    let path = world.drive(&vehicle, away).unwrap();
    world.audit(&path, &vehicle, away);
    assert!(path.cusps >= 1 && path.reverse_m > 0.0, "{path:?}");
    // With the nose towards the goal there is nothing to turn.
    let towards = [Some(PI), Some(PI)];
    let straight = world.drive(&vehicle, towards).unwrap();
    world.audit(&straight, &vehicle, towards);
    assert_eq!((straight.cusps, straight.arcs.len()), (0, 1));
}

#[test]
fn what_cannot_be_turned_is_a_reasoned_refusal() {
    // A bend with no room to swing out, and no room to turn.
    let bend = world(&[
        "...##########",
        ".s.##########",
        "...##########",
        "...##########",
        "...##########",
        "...##########",
        "...##########",
        "...##########",
        "...##########",
        ".............",
        "...........g.",
        ".............",
    ]);
    let vehicle = Vehicle {
        min_turn_radius_m: 12.0,
        ..tractor()
    };
    let refusal = bend.drive(&vehicle, [None, None]).unwrap_err();
    assert_eq!(refusal.status, Status::NoRoute);
    assert!(
        refusal.reason.contains("turning radius of 12.0 m"),
        "{}",
        refusal.reason
    );
    assert!(refusal.place.is_some() && !refusal.remedy.is_empty());
    // The same bend is no trouble for a vehicle that turns in place: it keeps the route.
    let turning = Vehicle {
        min_turn_radius_m: 0.0,
        ..tractor()
    };
    let ground = bend.ground(&turning);
    let route = bend.route(&ground).unwrap();
    let path = bend.drive(&turning, [None, None]).unwrap();
    let mut points: Vec<Position> = path.arcs.iter().map(|driven| driven.from.position()).collect();
    points.extend(path.end.map(Pose::position));
    assert_eq!(points, route);
}

#[test]
fn a_stop_and_a_limit_of_states_are_honoured() {
    let (world, vehicle) = (world(&LANE), tractor());
    let ground = world.ground(&vehicle);
    let route = world.route(&ground).unwrap();
    let ask = |params: DrivableParams, report: &mut Report| {
        drivable_path(&ground, &vehicle, &route, Some(0.0), Some(PI), &params, report)
    };
    let usual = DrivableParams::default();
    let mut calls = 0;
    let whole = ask(usual, &mut |_, _| {
        calls += 1;
        true
    });
    assert!(whole.unwrap().is_ok());
    for last in 0..calls.min(40) {
        let mut left = last;
        let stopped = ask(usual, &mut |_, _| {
            left -= 1;
            left >= 0
        });
        assert_eq!(stopped, Err(PlannerError::Stopped), "after {last} of {calls} reports");
    }
    let few = DrivableParams {
        most_states: 20,
        ..usual
    };
    let refusal = ask(few, &mut silent()).unwrap().unwrap_err();
    assert!(refusal.reason.contains("20 states"), "{}", refusal.reason);
    for bad in [
        DrivableParams {
            weight: f64::NAN,
            ..usual
        },
        DrivableParams {
            reverse_factor: 0.5,
            ..usual
        },
        DrivableParams {
            cusp_time_s: -1.0,
            ..usual
        },
        DrivableParams {
            most_states: 0,
            ..usual
        },
    ] {
        assert!(matches!(ask(bad, &mut silent()), Err(PlannerError::Drivable { .. })));
    }
}

#[test]
fn reversing_keeps_the_limits_of_the_nose() {
    let geometry = GridGeometry::new(30, 30, CELL_M, 0.0, 0.0).unwrap();
    let ramp = |grade: f64| {
        let heights = geometry
            .cells()
            .map(|cell| (grade * CELL_M * cell.column as f64) as f32);
        Layer::new(geometry, heights.collect(), "ramp").unwrap()
    };
    // 25 % up and 30 % down: 28 % is driven down forward; in reverse the nose would point up too steeply.
    let vehicle = Vehicle {
        grade_up: 0.25,
        min_turn_radius_m: 4.8,
        ..tractor()
    };
    let soil = Layer::filled(geometry, SoilClass::Gravel as u8);
    let params = DrivableParams::default();
    let cost = |grade: f64, heading_rad: f64, length_m: f64| {
        let elevation = ramp(grade);
        let goal = geometry.centre(Cell::new(0, 0));
        let ground = Ground::new(
            elevation.view(),
            Some(soil.view()),
            &vehicle,
            18.0,
            |_| true,
            None,
            goal,
        );
        let from = Pose::new(geometry.centre(Cell::new(15, 15)), heading_rad);
        let arc = CurveArc {
            curvature_per_m: 0.0,
            length_m,
        };
        Drive::new(&ground, &vehicle, &params)
            .arc(from, arc, None)
            .map(|facts| facts.cost)
    };
    assert!(cost(0.28, PI, 10.0).is_some());
    assert!(cost(0.28, 0.0, -10.0).is_none());
    assert!(cost(0.28, 0.0, 10.0).is_none());
    // Within all limits reversing the same way takes twice as long.
    let (down, back) = (cost(0.1, PI, 10.0).unwrap(), cost(0.1, 0.0, -10.0).unwrap());
    approx::assert_relative_eq!(back, 2.0 * down, max_relative = 1e-9);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    // With reversing as cheap as driving forward the shortest curve is known.
    #[test]
    fn on_open_ground_it_is_the_shortest_curve(
        ends in [(0usize..20, 0usize..20), (0usize..20, 0usize..20)], headings in [-3.1f64..3.1, -3.1f64..3.1],
    ) {
        let rows: Vec<String> = (0..48)
            .map(|row| (0..48).map(|column| match (row, column) {
                at if at == (14 + ends[0].0, 14 + ends[0].1) => 's',
                at if at == (14 + ends[1].0, 14 + ends[1].1) => 'g',
                _ => '.',
            }).collect())
            .collect();
        prop_assume!(ends[0] != ends[1]);
        let world = world(&rows.iter().map(String::as_str).collect::<Vec<_>>());
        let vehicle = tractor();
        let ground = world.ground(&vehicle);
        let route = world.route(&ground).unwrap();
        let params = DrivableParams { reverse_factor: 1.0, cusp_time_s: 0.0, ..DrivableParams::default() };
        let asked = headings.map(Some);
        let path = drivable_path(&ground, &vehicle, &route, asked[0], asked[1], &params, &mut silent());
        let path = path.unwrap().unwrap();
        world.audit(&path, &vehicle, asked);
        let [from, to] = [(route[0], headings[0]), (route[route.len() - 1], headings[1])]
            .map(|(place, heading)| Pose::new(place, heading));
        let shortest: f64 = reeds_shepp(from, to, 4.8).iter().map(|arc| arc.length_m.abs()).sum();
        prop_assert!(path.total.length_m >= shortest - 1e-4, "{} {shortest}", path.total.length_m);
        prop_assert!(path.total.length_m <= 1.03 * shortest + 1e-4, "{} {shortest}", path.total.length_m);
    }

    #[test]
    fn among_drawn_obstacles_every_path_keeps_the_radius_and_the_ground(
        seed: u64, density in 0.0f64..0.06, headings in [prop::option::of(-3.1f64..3.1), prop::option::of(-3.1f64..3.1)],
    ) {
        let draw = |index: usize| crate::random::unit(crate::random::philox([index as u32, 7, 0, 0], seed)[0]);
        let rows: Vec<String> = (0..24)
            .map(|row| (0..32).map(|column| match (row, column) {
                (20, 3) => 's',
                (3, 28) => 'g',
                _ if draw(row * 32 + column) < density => '#',
                _ => '.',
            }).collect())
            .collect();
        let world = world(&rows.iter().map(String::as_str).collect::<Vec<_>>());
        let vehicle = tractor();
        let ground = world.ground(&vehicle);
        let Some(route) = world.route(&ground) else { return Ok(()) };
        let ask = || drivable_path(
            &ground, &vehicle, &route, headings[0], headings[1], &DrivableParams::default(), &mut silent(),
        ).unwrap();
        let found = ask();
        prop_assert_eq!(&found, &ask());
        match found {
            Ok(path) => world.audit(&path, &vehicle, headings),
            Err(refusal) => prop_assert!(refusal.reason.contains("turning radius")),
        }
    }
}

#[test]
fn vehicles_of_the_fixtures_turn_as_they_should() {
    assert_eq!(pioneer().min_turn_radius_m, 0.0);
    assert!(tractor().min_turn_radius_m > 0.0);
}
