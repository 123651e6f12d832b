//! Planning on drawn worlds, and the swarm beside the exact method.

use super::*;
use crate::planner::Objective;
use crate::soil::SoilClass;
use crate::swarm::{Budget, SwarmParams};
use crate::vehicle::fixtures::pioneer;
use proptest::prelude::*;

/// A world as text, 10 m cells: '.' level ground, a digit a height in 40 m, '~' water, '?' unknown elevation.
pub(super) fn world(rows: &[&str]) -> (Layer<f32>, Layer<u8>) {
    let geometry = GridGeometry::new(rows.len(), rows[0].len(), 10.0, 0.0, 0.0).unwrap();
    let bytes: Vec<u8> = rows.iter().flat_map(|row| row.bytes()).collect();
    let heights = bytes.iter().map(|byte| match byte {
        b'1'..=b'9' => 40.0 * f32::from(*byte - b'0'),
        b'?' => f32::NAN,
        _ => 0.0,
    });
    let soils = bytes.iter().map(|byte| {
        let class = if *byte == b'~' {
            SoilClass::None
        } else {
            SoilClass::Sand
        };
        class as u8
    });
    (
        Layer::new(geometry, heights.collect(), "z").unwrap(),
        Layer::new(geometry, soils.collect(), "soil").unwrap(),
    )
}

pub(super) fn request(geometry: GridGeometry, start: (usize, usize), goal: (usize, usize)) -> PlanRequest {
    PlanRequest {
        start: geometry.centre(Cell::new(start.0, start.1)),
        goal: geometry.centre(Cell::new(goal.0, goal.1)),
        method: Method::Swarm,
        swarm: SwarmParams {
            agents: 64,
            ..SwarmParams::default()
        },
        arc: ArcKind::Spine,
        width_m: None,
        headings_rad: [None; 2],
        path: PathKind::default(),
        bridge: false,
        certify: false,
        objective: Objective::default(),
        reversed: false,
        stop: None,
        budget: Budget::default(),
    }
}

pub(super) fn solve(layers: &(Layer<f32>, Layer<u8>), request: &PlanRequest) -> Plan {
    solve_with(layers, &pioneer(), None, request)
}

/// Plans for a vehicle with a user's factor on costs, whose closed cells are zones.
fn solve_with(
    (elevation, soil): &(Layer<f32>, Layer<u8>),
    vehicle: &Vehicle,
    factor: Option<&Layer<f32>>,
    request: &PlanRequest,
) -> Plan {
    let params = RankParams::default();
    let geometry = elevation.geometry();
    let zones = factor.map(|factor| {
        let closed = factor.data().iter().map(|factor| !factor.is_finite());
        Layer::new(geometry, closed.collect(), "zones").unwrap()
    });
    let zones = zones.as_ref().map(Layer::view);
    let ranker = Ranker::new(elevation.view(), Some(soil.view()), None, zones, vehicle, params).unwrap();
    let terrain = Terrain {
        elevation_m: elevation.view(),
        soil: Some(soil.view()),
        cost_factor: factor.map(Layer::view),
        map_continues: false,
    };
    plan(terrain, &ranker, vehicle, &params, request, &mut |_, _, _| true).unwrap()
}

pub(super) const LAKE: [&str; 12] = [
    "....................",
    "....................",
    "....................",
    "....................",
    "........~~..........",
    "........~~..........",
    "........~~..........",
    "........~~..........",
    "........~~..........",
    "........~~..........",
    "........~~..........",
    "........~~..........",
];

pub(super) const RIVER: [&str; 6] = [
    "........~~..........",
    "........~~..........",
    "........~~..........",
    "........~~..........",
    "........~~..........",
    "........~~..........",
];

#[test]
fn the_way_leads_around_water() {
    let layers = world(&LAKE);
    let ask = request(layers.0.geometry(), (9, 3), (9, 15));
    let found = solve(&layers, &ask);
    let route = found.answer.unwrap();
    assert!(route.total.length_m > 150.0 && route.total.length_m < 240.0);
    assert!(
        route.legs.iter().any(|leg| leg.reason.contains("water or peat")),
        "{route:?}"
    );
    let exact = solve(
        &layers,
        &PlanRequest {
            method: Method::Exact,
            ..ask
        },
    );
    assert!(exact.optimal);
    approx::assert_relative_eq!(exact.path_cost.unwrap(), found.path_cost.unwrap(), epsilon = 1e-9);
}

#[test]
fn a_river_is_a_reasoned_refusal() {
    let layers = world(&RIVER);
    let found = solve(&layers, &request(layers.0.geometry(), (3, 2), (3, 17)));
    let refusal = found.answer.unwrap_err();
    assert_eq!(refusal.status, Status::NoRoute);
    assert!(refusal.reason.contains("water or peat"), "{}", refusal.reason);
    let place = refusal.place.unwrap();
    assert!((80.0..100.0).contains(&place.x_m), "{place:?}");
    assert!(!refusal.remedy.is_empty());
}

#[test]
fn a_passage_too_narrow_for_a_nest_can_be_bridged() {
    let mut rows = RIVER.to_vec();
    rows[3] = "....................";
    let layers = world(&rows);
    let ask = request(layers.0.geometry(), (3, 2), (3, 17));
    let refusal = solve(&layers, &ask).answer.unwrap_err();
    assert!(refusal.remedy.contains("--bridge"), "{refusal:?}");
    let bridged = solve(&layers, &PlanRequest { bridge: true, ..ask });
    let total = bridged.answer.unwrap().total;
    assert!(total.bridged_m > 10.0 && total.cost > total.time_s);
    assert!(!bridged.optimal);
}

#[test]
fn ends_are_moved_to_near_ground_or_refused() {
    let layers = world(&LAKE);
    let geometry = layers.0.geometry();
    let near = solve(&layers, &request(geometry, (9, 8), (9, 2)));
    assert!((5.0..25.0).contains(&near.start.unwrap().1));
    assert!(near.answer.is_ok());
    let cliffs = world(&[
        "....1234321....",
        "....1234321....",
        "....1234321....",
        "....1234321....",
    ]);
    let ask = |start, goal| solve(&cliffs, &request(cliffs.0.geometry(), start, goal));
    let refusal = ask((1, 1), (1, 8)).answer.unwrap_err();
    assert_eq!(refusal.status, Status::GoalBlocked);
    assert!(refusal.reason.contains("too steep"), "{refusal:?}");
    assert_eq!(ask((1, 8), (1, 1)).answer.unwrap_err().status, Status::StartBlocked);
    let mut away = request(geometry, (1, 1), (2, 2));
    away.goal = Position::new(5000.0, -50.0);
    let refusal = solve(&layers, &away).answer.unwrap_err();
    assert_eq!(refusal.status, Status::OutsideMap);
    assert!(refusal.reason.contains("4800 m outside"), "{refusal:?}");
}

/// Every kind of path from one place to another in the same cell, by every method.
fn within_a_cell(layers: &(Layer<f32>, Layer<u8>), start: Position, goal: Position) -> Vec<Route> {
    use PathKind::{AnyAngle, Auto, Drivable, Grid8, Grid16};
    let ask = PlanRequest {
        start,
        goal,
        ..request(layers.0.geometry(), (0, 0), (0, 0))
    };
    let mut routes = Vec::new();
    for path in [Grid8, Grid16, AnyAngle, Drivable, Auto] {
        for (method, arc) in [
            (Method::Swarm, ArcKind::Spine),
            (Method::Swarm, ArcKind::Relaid),
            (Method::Exact, ArcKind::Spine),
        ] {
            let ask = PlanRequest {
                method,
                arc,
                path,
                ..ask
            };
            routes.push(solve(layers, &ask).answer.unwrap());
        }
    }
    routes
}

#[test]
fn a_start_that_is_the_goal_is_a_route_of_no_length() {
    let layers = world(&LAKE);
    let place = layers.0.geometry().centre(Cell::new(2, 2));
    for route in within_a_cell(&layers, place, place) {
        assert_eq!((route.legs.len(), route.total.length_m), (0, 0.0));
    }
}

#[test]
fn ends_in_one_cell_are_joined_where_that_can_be_driven() {
    let layers = world(&LAKE);
    let place = layers.0.geometry().centre(Cell::new(7, 7));
    let (start, goal) = (place, Position::new(place.x_m - 3.0, place.y_m));
    for route in within_a_cell(&layers, start, goal) {
        assert_eq!(route.points(), [start, goal]);
    }
    // Too near to the water for the vehicle's width.
    let (start, goal) = [3.0, -3.0]
        .map(|north_m| Position::new(place.x_m + 4.99, place.y_m + north_m))
        .into();
    for route in within_a_cell(&layers, start, goal) {
        assert_eq!(route.legs, []);
    }
}

#[test]
fn a_void_is_no_ground() {
    let mut rows = LAKE.map(|row| row.replace('~', "?")).to_vec();
    rows[0] = "........??..........".to_owned();
    let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
    let layers = world(&rows);
    let route = solve(&layers, &request(layers.0.geometry(), (9, 3), (9, 15)))
        .answer
        .unwrap();
    for leg in &route.legs {
        for end in [leg.from, leg.to] {
            assert!(layers.0[layers.0.geometry().cell_at(end).unwrap()].is_finite());
        }
    }
}

#[test]
fn a_stop_is_heard_in_every_stage() {
    let layers = world(&LAKE);
    let (elevation, soil) = &layers;
    let vehicle = pioneer();
    let params = RankParams::default();
    let ranker = Ranker::new(elevation.view(), Some(soil.view()), None, None, &vehicle, params).unwrap();
    let terrain = Terrain {
        elevation_m: elevation.view(),
        soil: None,
        cost_factor: None,
        map_continues: false,
    };
    let ask = request(elevation.geometry(), (9, 3), (9, 15));
    for stage in [Stage::Corridor, Stage::Regions, Stage::Route] {
        let found = plan(terrain, &ranker, &vehicle, &params, &ask, &mut |at, _, _| at != stage);
        assert_eq!(found.unwrap_err(), PlannerError::Stopped, "{stage:?}");
    }
}

#[test]
fn the_guided_swarm_finds_the_way_around_water_and_looks_at_little() {
    let rows: Vec<String> = (0..60)
        .map(|row| {
            (0..60)
                .map(|column| {
                    if row > 10 && (28..32).contains(&column) {
                        '~'
                    } else {
                        '.'
                    }
                })
                .collect()
        })
        .collect();
    let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
    let layers = world(&rows);
    let mut ask = request(layers.0.geometry(), (30, 10), (30, 50));
    ask.arc = ArcKind::Relaid;
    let (guided, exact) = (
        solve(&layers, &ask),
        solve(
            &layers,
            &PlanRequest {
                method: Method::Exact,
                ..ask
            },
        ),
    );
    let (cost, best) = (guided.path_cost.unwrap(), exact.path_cost.unwrap());
    assert!(cost <= best * 1.02, "{cost} {best}");
    assert!(guided.cells_evaluated < 60 * 60 * 6 / 10, "{}", guided.cells_evaluated);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn the_guided_swarm_answers_as_the_exact_method_does(
        seed: u64, a in 0usize..900, b in 0usize..900, holes in 0u32..9, agents in 1u32..90, pellet_max in 1u8..4,
    ) {
        let geometry = GridGeometry::new(30, 30, 10.0, 0.0, 0.0).unwrap();
        let cells = geometry.cells().map(|cell| {
            let draw = crate::random::philox([geometry.index(cell) as u32, 3, 0, 0], seed);
            if draw[0] % 100 < holes { SoilClass::None as u8 } else { (draw[1] % 5) as u8 }
        });
        let layers = (
            Layer::filled(geometry, 5.0f32),
            Layer::new(geometry, cells.collect(), "soil").unwrap(),
        );
        let (a, b) = (geometry.cell(a), geometry.cell(b));
        let mut ask = request(geometry, (a.row, a.column), (b.row, b.column));
        ask.arc = ArcKind::Relaid;
        ask.swarm.agents = agents;
        ask.swarm.pellet_max = pellet_max;
        let guided = solve(&layers, &ask);
        let exact = solve(&layers, &PlanRequest { method: Method::Exact, ..ask });
        let oracle = exact.nests.unwrap();
        let found = guided.nests.as_ref().unwrap();
        for cell in geometry.cells() {
            prop_assert!(found.label(cell) == 0 || oracle.label(cell) > 0);
        }
        prop_assert!(guided.cells_evaluated <= 900);
        match (&guided.answer, &exact.answer) {
            (Ok(_), Ok(_)) => {
                prop_assert!(guided.path_cost.unwrap() >= exact.path_cost.unwrap() * (1.0 - 1e-9));
                prop_assert_eq!(guided.path.first(), exact.path.first());
                prop_assert_eq!(guided.path.last(), exact.path.last());
            }
            (Err(refusal), Err(other)) => prop_assert_eq!(refusal.status, other.status),
            (found, least) => prop_assert!(false, "{:?} {:?}", found, least),
        }
        let again = solve(&layers, &ask);
        prop_assert_eq!(again.path, guided.path);
        prop_assert_eq!(again.nests, guided.nests);
    }
}

/// Waves of some height with soils and a few holes, and the user's factors on their costs.
fn waves(seed: u64, height_m: f64, holes: u32) -> ((Layer<f32>, Layer<u8>), Layer<f32>) {
    let geometry = GridGeometry::new(30, 30, 10.0, 0.0, 0.0).unwrap();
    let draw = |cell: Cell| crate::random::philox([geometry.index(cell) as u32, 3, 0, 0], seed);
    let heights = geometry.cells().map(|cell| {
        let phase = (seed % 7) as f64;
        (height_m * (0.4 * cell.row as f64 + phase).sin() * (0.3 * cell.column as f64).cos()) as f32
    });
    let soils = geometry.cells().map(|cell| match draw(cell) {
        [hole, ..] if hole % 100 < holes => SoilClass::None as u8,
        [_, class, ..] => (class % 5) as u8,
    });
    let factors = geometry.cells().map(|cell| match draw(cell)[2] % 100 {
        0 => f32::INFINITY,
        k => k as f32 / 50.0,
    });
    (
        (
            Layer::new(geometry, heights.collect(), "z").unwrap(),
            Layer::new(geometry, soils.collect(), "soil").unwrap(),
        ),
        Layer::new(geometry, factors.collect(), "factors").unwrap(),
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn under_every_objective_all_methods_agree_and_the_way_back_costs_the_same_reversed(
        seed: u64, a in 0usize..900, b in 0usize..900, holes in 0u32..6, height in 0.0f64..8.0,
        time in 0.0f64..2.0, energy in 0.1f64..4.0, risk in prop_oneof![Just(0.0), 0.5f64..9.0], priced: bool,
    ) {
        let (layers, factor) = waves(seed, height, holes);
        let factor = priced.then_some(&factor);
        let geometry = layers.0.geometry();
        let vehicle = pioneer();
        let (a, b) = (geometry.cell(a), geometry.cell(b));
        let mut ask = request(geometry, (a.row, a.column), (b.row, b.column));
        ask.objective = Objective { time, energy, risk, risk_distance_m: None };
        let solve = |request: &PlanRequest| solve_with(&layers, &vehicle, factor, request);
        let exact = solve(&PlanRequest { method: Method::Exact, ..ask });
        let back = PlanRequest { method: Method::Exact, start: ask.goal, goal: ask.start, reversed: true, ..ask };
        let back = solve(&back);
        let certified = solve(&PlanRequest { certify: true, width_m: Some(80.0), ..ask });
        let guided = solve(&PlanRequest { arc: ArcKind::Relaid, ..ask });
        match &exact.answer {
            Err(refusal) => {
                for other in [&back, &certified, &guided] {
                    prop_assert!(other.answer.is_err(), "{:?}", refusal);
                }
            }
            Ok(route) => {
                let least = exact.path_cost.unwrap();
                let same = |cost: f64| (cost - least).abs() <= 1e-9 * least.max(1.0);
                prop_assert!(same(back.path_cost.unwrap()), "{} {:?}", least, back.path_cost);
                prop_assert!(certified.optimal && same(certified.path_cost.unwrap()));
                prop_assert!(guided.path_cost.unwrap() >= least * (1.0 - 1e-9));
                prop_assert!(exact.cost_lower_bound.unwrap() <= route.total.cost * (1.0 + 1e-9));
                if factor.is_none() {
                    let total = route.total;
                    let sum = time * total.time_s + energy * total.energy_j / vehicle.power_w + risk * total.risk_s;
                    prop_assert!((sum - total.cost).abs() <= 1e-9 * sum.max(1.0), "{sum} {total:?}");
                }
            }
        }
    }
}

#[test]
fn risk_keeps_away_from_water_and_a_factor_from_dear_ground() {
    let layers = world(&LAKE);
    let geometry = layers.0.geometry();
    let ask = PlanRequest {
        method: Method::Exact,
        ..request(geometry, (9, 3), (9, 15))
    };
    let objective = Objective {
        risk: 50.0,
        ..Objective::default()
    };
    let quick = solve(&layers, &ask).answer.unwrap().total;
    let safe = solve(&layers, &PlanRequest { objective, ..ask }).answer.unwrap().total;
    assert!(
        quick.risk_s > 0.0 && safe.risk_s < 0.7 * quick.risk_s,
        "{quick:?} {safe:?}"
    );
    assert!(safe.time_s > quick.time_s);
    // Level ground with a dear field in the middle.
    let layers = world(&["...................."; 20]);
    let geometry = layers.0.geometry();
    let ask = PlanRequest {
        method: Method::Exact,
        ..request(geometry, (10, 2), (10, 17))
    };
    let is_dear = |cell: &Cell| (8..13).contains(&cell.row) && (8..12).contains(&cell.column);
    let factor = geometry.cells().map(|cell| if is_dear(&cell) { 5.0 } else { 1.0 });
    let factor = Layer::new(geometry, factor.collect(), "factor").unwrap();
    assert!(solve(&layers, &ask).path.iter().any(is_dear));
    let around = solve_with(&layers, &pioneer(), Some(&factor), &ask);
    assert!(!around.path.iter().any(is_dear));
    let closed = geometry
        .cells()
        .map(|cell| if cell.column == 9 { f32::NAN } else { 1.0 });
    let closed = Layer::new(geometry, closed.collect(), "factor").unwrap();
    let refusal = solve_with(&layers, &pioneer(), Some(&closed), &ask).answer.unwrap_err();
    assert_eq!(refusal.status, Status::NoRoute);
}

#[test]
fn bad_objectives_and_factors_are_named() {
    let layers = world(&LAKE);
    let (geometry, vehicle, params) = (layers.0.geometry(), pioneer(), RankParams::default());
    let ranker = Ranker::new(layers.0.view(), None, None, None, &vehicle, params).unwrap();
    let mut factor = Layer::filled(geometry, 1.0f32);
    factor.data_mut()[23] = -0.5;
    let ask = request(geometry, (1, 1), (1, 5));
    let plan_with = |cost_factor, objective| {
        let terrain = Terrain {
            elevation_m: layers.0.view(),
            soil: None,
            cost_factor,
            map_continues: false,
        };
        let ask = PlanRequest { objective, ..ask };
        plan(terrain, &ranker, &vehicle, &params, &ask, &mut |_, _, _| true)
            .unwrap_err()
            .to_string()
    };
    let refused = plan_with(Some(factor.view()), Objective::default());
    assert!(refused.contains("(1, 3)") && refused.contains("-0.5"), "{refused}");
    let refused = plan_with(
        None,
        Objective {
            energy: f64::NAN,
            ..Objective::default()
        },
    );
    assert!(refused.contains("energy"), "{refused}");
}

/// On a slope of 12 % that falls to the west or to the south: eastward is up it or across it.
#[rstest::rstest]
#[case::grade(Vehicle { grade_up: 0.1, side_slope: 0.05, ..pioneer() }, true, "12 % uphill lies across")]
#[case::traction(Vehicle { traction_friction: 0.14, side_slope: 0.05, ..pioneer() }, true, "too little traction")]
#[case::side_slope(Vehicle { side_slope: 0.05, grade_up: 0.05, ..pioneer() }, false, "a side slope of 12 % lies across")]
#[case::rollover(
    Vehicle { gauge_m: Some(0.32), centre_of_gravity_m: Some(2.0), grade_up: 0.05, ..pioneer() }, false, "tip over")]
fn a_refusal_names_the_limit_that_binds(#[case] vehicle: Vehicle, #[case] up: bool, #[case] named: &str) {
    let geometry = GridGeometry::new(20, 20, 10.0, 0.0, 0.0).unwrap();
    let heights = geometry.cells().map(|cell| {
        let along = if up { cell.column } else { 19 - cell.row };
        1.199 * along as f32
    });
    let layers = (
        Layer::new(geometry, heights.collect(), "ramp").unwrap(),
        Layer::filled(geometry, SoilClass::Gravel as u8),
    );
    let ask = PlanRequest {
        method: Method::Exact,
        ..request(geometry, (10, 2), (10, 17))
    };
    let refusal = solve_with(&layers, &vehicle, None, &ask).answer.unwrap_err();
    assert_eq!(refusal.status, Status::NoRoute);
    assert!(refusal.reason.contains(named), "{refusal:?}");
    assert!(refusal.place.is_some());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_certified_swarm_route_costs_what_the_exact_route_costs(
        seed: u64, a in 0usize..900, b in 0usize..900, holes in 0u32..6,
    ) {
        let geometry = GridGeometry::new(30, 30, 10.0, 0.0, 0.0).unwrap();
        let cells = geometry.cells().map(|cell| {
            let draw = crate::random::philox([geometry.index(cell) as u32, 3, 0, 0], seed);
            if draw[0] % 100 < holes { SoilClass::None as u8 } else { (draw[1] % 5) as u8 }
        });
        let layers = (
            Layer::filled(geometry, 5.0f32),
            Layer::new(geometry, cells.collect(), "soil").unwrap(),
        );
        let (a, b) = (geometry.cell(a), geometry.cell(b));
        let mut ask = request(geometry, (a.row, a.column), (b.row, b.column));
        ask.certify = true;
        ask.width_m = Some(80.0);
        let swarm = solve(&layers, &ask);
        let exact = solve(&layers, &PlanRequest { method: Method::Exact, ..ask });
        match (&swarm.answer, &exact.answer) {
            (Ok(route), Ok(best)) => {
                prop_assert!(swarm.optimal && exact.optimal);
                let (found, least) = (swarm.path_cost.unwrap(), exact.path_cost.unwrap());
                prop_assert!((found - least).abs() <= 1e-9 * least.max(1.0), "{found} {least}");
                prop_assert!(route.total.cost <= found * (1.0 + 1e-9) + 20.0);
                prop_assert!(route.total.cost >= swarm.cost_lower_bound.unwrap() * (1.0 - 1e-9));
                prop_assert_eq!(best.legs.is_empty(), route.legs.is_empty());
            }
            (Err(refusal), Err(other)) => prop_assert_eq!(refusal.status, other.status),
            (found, least) => prop_assert!(false, "{:?} {:?}", found, least),
        }
    }
}
