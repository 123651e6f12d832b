//! Every repair against a search that knows nothing of repairs.

use proptest::prelude::*;

use super::*;
use crate::grid::Layer;
use crate::planner::{Algorithm, Corners, CostCells, Ground, search};
use crate::progress::silent;
use crate::vehicle::Vehicle;
use crate::vehicle::fixtures::{pioneer, tractor};

const CLOSED: f64 = f64::INFINITY;

/// Costs to a goal of every cell: sums from the goal backwards, improved until nothing improves.
fn truth(graph: &impl StepGraph, goal: Cell) -> Vec<u64> {
    let geometry = graph.geometry();
    let mut costs = vec![INFINITE; geometry.cell_count()];
    costs[geometry.index(goal)] = 0;
    loop {
        let before = costs.clone();
        for cell in geometry.cells() {
            for (k, step) in graph.steps().iter().enumerate() {
                let Some(next) = step.from(&geometry, cell) else {
                    continue;
                };
                let behind = costs[geometry.index(next)];
                let cost = graph.edge_cost(cell, k);
                if cost.is_finite() && behind < INFINITE {
                    let index = geometry.index(cell);
                    // No cost and no progress would be a circle: at least the last bit grows.
                    let sum = cost + f64::from_bits(behind);
                    let sum = if sum.to_bits() == behind { sum.next_up() } else { sum };
                    costs[index] = costs[index].min(sum.to_bits());
                }
            }
        }
        if costs == before {
            return costs;
        }
    }
}

/// The cost of a way as the steps of a graph say.
fn driven(graph: &impl StepGraph, cells: &[Cell]) -> f64 {
    let geometry = graph.geometry();
    let step = |pair: &[Cell]| {
        let leads = |step: &Step| step.from(&geometry, pair[0]) == Some(pair[1]);
        graph.edge_cost(pair[0], graph.steps().iter().position(leads).unwrap())
    };
    cells.windows(2).rev().fold(0.0, |sum, pair| step(pair) + sum)
}

/// Whether a repaired way is one and costs exactly what it must; returns its cost.
fn check(graph: &impl ChangingGraph, repair: &mut Repair) -> Result<f64, TestCaseError> {
    let geometry = graph.geometry();
    let (start, goal) = (repair.start(), repair.goal());
    let found = repair.path(graph, &mut silent());
    let fresh = Repair::new(graph, start, goal).unwrap().path(graph, &mut silent());
    let least = truth(graph, goal)[geometry.index(start)];
    let outside = search(graph, start, goal, &mut silent());
    match (&found, &fresh, &outside) {
        (Search::Found { cells, cost }, Search::Found { cost: again, .. }, Search::Found { cost: other, .. }) => {
            let exact = f64::from_bits(least);
            let exact = if exact < f64::MIN_POSITIVE { 0.0 } else { exact };
            prop_assert_eq!(*cost, exact);
            prop_assert_eq!(cost, again);
            prop_assert!((cost - other).abs() <= 1e-12 * other.max(1e-290), "{} {}", cost, other);
            prop_assert_eq!((cells[0], cells[cells.len() - 1]), (start, goal));
            let walked = driven(graph, cells);
            prop_assert!(
                (cost - walked).abs() <= 1e-12 * walked.max(1e-290),
                "{} {}",
                cost,
                walked
            );
            Ok(*cost)
        }
        (Search::Unreachable, Search::Unreachable, Search::Unreachable) => {
            prop_assert_eq!(least, INFINITE);
            Ok(CLOSED)
        }
        other => {
            prop_assert!(false, "{:?}", other);
            Ok(CLOSED)
        }
    }
}

fn cost_of_a_cell() -> impl Strategy<Value = f64> {
    prop_oneof![
        12 => 0.5f64..9.0,
        4 => Just(1.0),
        2 => Just(CLOSED),
        1 => Just(f64::NAN),
        2 => Just(0.0),
        1 => Just(1e-300),
        1 => 1e-9f64..1e9,
    ]
}

fn layer() -> impl Strategy<Value = Layer<f64>> {
    (1usize..10, 1usize..10).prop_flat_map(|(rows, columns)| {
        prop::collection::vec(cost_of_a_cell(), rows * columns).prop_map(move |data| {
            let geometry = GridGeometry::new(rows, columns, 2.0, 0.0, 0.0).unwrap();
            Layer::new(geometry, data, "costs").unwrap()
        })
    })
}

/// What happens between two plans.
#[derive(Clone, Debug)]
enum Event {
    /// A patch of cells changes: where, how large, and to what.
    Patch(prop::sample::Index, usize, usize, Vec<f64>),
    /// The robot goes on along its way.
    Follow(usize),
    /// The robot is put elsewhere.
    Jump(prop::sample::Index),
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        5 => (any::<prop::sample::Index>(), 1usize..5, 1usize..5, prop::collection::vec(cost_of_a_cell(), 16))
            .prop_map(|(at, rows, columns, costs)| Event::Patch(at, rows, columns, costs)),
        3 => (1usize..4).prop_map(Event::Follow),
        1 => any::<prop::sample::Index>().prop_map(Event::Jump),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn any_sequence_of_changes_and_moves_costs_exactly_what_a_fresh_plan_costs(
        layer in layer(), a: prop::sample::Index, b: prop::sample::Index, sixteen: bool, cut: bool,
        share in prop_oneof![Just(0.0), Just(REPAIR_SHARE), Just(f64::INFINITY)],
        events in prop::collection::vec((event(), any::<bool>()), 1..14),
    ) {
        let geometry = layer.geometry();
        let cell = |index: &prop::sample::Index| geometry.cell(index.index(geometry.cell_count()));
        let goal = cell(&b);
        let corners = if cut { Corners::Cut } else { Corners::Keep };
        let mut graph = ChangingCells::new(layer.view(), goal, if sixteen { 16 } else { 8 }, corners).unwrap();
        let mut repair = Repair::new(&graph, cell(&a), goal).unwrap().with_share(share);
        check(&graph, &mut repair)?;
        for (event, plan) in &events {
            match event {
                Event::Patch(at, rows, columns, costs) => {
                    let corner = cell(at);
                    let mut changed = Vec::new();
                    for (i, &cost) in costs.iter().take(rows * columns).enumerate() {
                        let at = geometry.offset(corner, (i / columns) as i32, (i % columns) as i32);
                        if let Some(at) = at {
                            changed.extend(graph.change([(at, cost)]).unwrap());
                        }
                    }
                    repair.update(&graph, changed);
                }
                Event::Follow(steps) => {
                    if let Search::Found { cells, .. } = repair.path(&graph, &mut silent()) {
                        repair.move_to(cells[(*steps).min(cells.len() - 1)]).unwrap();
                    }
                }
                Event::Jump(to) => repair.move_to(cell(to)).unwrap(),
            }
            if *plan {
                check(&graph, &mut repair)?;
            }
        }
        check(&graph, &mut repair)?;
    }

    #[test]
    fn a_stop_at_any_report_is_gone_on_with(
        layer in layer(), a: prop::sample::Index, b: prop::sample::Index, at: prop::sample::Index, cost in cost_of_a_cell(),
    ) {
        let geometry = layer.geometry();
        let cell = |index: &prop::sample::Index| geometry.cell(index.index(geometry.cell_count()));
        let (start, goal) = (cell(&a), cell(&b));
        let mut graph = ChangingCells::new(layer.view(), goal, 8, Corners::Keep).unwrap();
        let mut repair = Repair::new(&graph, start, goal).unwrap();
        let stopped = repair.path(&graph, &mut |_, _| false);
        prop_assert!(start == goal || matches!(stopped, Search::Stopped | Search::Unreachable));
        graph.change([(cell(&at), cost)]).unwrap();
        repair.update(&graph, [cell(&at)]);
        check(&graph, &mut repair)?;
    }

    #[test]
    fn steps_cost_what_they_cost_in_the_search_from_scratch(layer in layer(), sixteen: bool, cut: bool) {
        let (geometry, goal) = (layer.geometry(), Cell::new(0, 0));
        let corners = if cut { Corners::Cut } else { Corners::Keep };
        let neighbours = if sixteen { 16 } else { 8 };
        let ours = ChangingCells::new(layer.view(), goal, neighbours, corners).unwrap();
        let theirs = CostCells::new(layer.view(), goal, neighbours, corners, Algorithm::AStar).unwrap();
        for cell in geometry.cells() {
            for k in 0..ours.steps().len() {
                prop_assert_eq!(ours.edge_cost(cell, k), theirs.edge_cost(cell, k));
                // Priced together, forwards and backwards.
                let together = ours.costs_around(cell).unwrap();
                prop_assert_eq!(together[k], ours.edge_cost(cell, k));
                if let Some(next) = ours.steps()[k].from(&geometry, cell) {
                    let back = (k + ours.steps().len() / 2) % ours.steps().len();
                    prop_assert_eq!(together[k], ours.edge_cost(next, back));
                } else {
                    prop_assert_eq!(together[k], CLOSED);
                }
            }
            prop_assert!((ours.bound(cell) - theirs.bound(cell)).abs() <= 1e-9 * theirs.bound(cell));
        }
    }
}

/// Waves of some height with a few kinds of soil.
fn waves(seed: u64, height_m: f64) -> (Layer<f32>, Layer<u8>) {
    let geometry = GridGeometry::new(14, 16, 10.0, 0.0, 0.0).unwrap();
    let draw = |i: u32| crate::random::unit(crate::random::philox([i, 3, 0, 0], seed)[0]);
    let heights = geometry.cells().map(|cell| {
        let wave = (cell.row as f64 * (0.2 + 0.3 * draw(1))).sin() * (cell.column as f64 * (0.2 + 0.3 * draw(2))).cos();
        (height_m * wave) as f32
    });
    let soils = (0..geometry.cell_count() as u32).map(|i| (draw(50 + i / 9) * 6.0) as u8);
    (
        Layer::new(geometry, heights.collect(), "z").unwrap(),
        Layer::new(geometry, soils.collect(), "soil").unwrap(),
    )
}

fn ground<'a>(elevation: &'a Layer<f32>, soil: &'a Layer<u8>, vehicle: &'a Vehicle, goal: Cell) -> Ground<'a> {
    let at = elevation.geometry().centre(goal);
    let known = |index: usize| elevation.data()[index].is_finite();
    Ground::new(elevation.view(), Some(soil.view()), vehicle, 18.0, known, None, at)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn changed_soil_and_heights_under_a_vehicle_cost_exactly_what_a_fresh_plan_costs(
        seed: u64, height in 1.0f64..14.0, large: bool, a in 0usize..224, b in 0usize..224,
        changes in prop::collection::vec((0usize..224, prop_oneof![
            (0u8..6).prop_map(|code| (Some(code), 0.0)), (-4.0f32..4.0).prop_map(|rise| (None, rise)),
            Just((None, f32::NAN)),
        ], any::<bool>()), 1..8),
    ) {
        let (mut elevation, mut soil) = waves(seed, height);
        let vehicle = if large { tractor() } else { pioneer() };
        let geometry = elevation.geometry();
        let (start, goal) = (geometry.cell(a), geometry.cell(b));
        let mut repair = Repair::new(&ground(&elevation, &soil, &vehicle, goal), start, goal)
            .unwrap()
            .with_share(f64::INFINITY);
        check(&ground(&elevation, &soil, &vehicle, goal), &mut repair)?;
        for (at, (code, rise_m), go_on) in changes {
            let corner = geometry.cell(at);
            let patch: Vec<Cell> = (0..6).filter_map(|i| geometry.offset(corner, i / 3, i % 3)).collect();
            for &cell in &patch {
                match code {
                    Some(code) => soil[cell] = code,
                    None => elevation[cell] += rise_m,
                }
            }
            let changed = ground(&elevation, &soil, &vehicle, goal);
            repair.update(&changed, patch);
            check(&changed, &mut repair)?;
            if let (true, Search::Found { cells, .. }) = (go_on, repair.path(&changed, &mut silent())) {
                repair.move_to(cells[2.min(cells.len() - 1)]).unwrap();
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn no_step_reads_a_cell_beyond_its_reach(
        seed: u64, height in 1.0f64..14.0, large: bool, at in 0usize..224, rise_m in -6.0f32..6.0, code in 0u8..6,
    ) {
        let (mut elevation, mut soil) = waves(seed, height);
        let vehicle = if large { tractor() } else { pioneer() };
        let geometry = elevation.geometry();
        let (changed, goal) = (geometry.cell(at), Cell::new(0, 0));
        let edges = |ground: &Ground| -> Vec<u64> {
            let costs = geometry.cells().flat_map(|cell| (0..16).map(move |k| (cell, k)));
            costs.map(|(cell, k)| ground.edge_cost(cell, k).to_bits()).collect()
        };
        let before = edges(&ground(&elevation, &soil, &vehicle, goal));
        elevation[changed] += rise_m;
        soil[changed] = code;
        let after = ground(&elevation, &soil, &vehicle, goal);
        for (place, (before, after_)) in before.iter().zip(edges(&after)).enumerate() {
            let cell = geometry.cell(place / 16);
            let away = cell.row.abs_diff(changed.row).max(cell.column.abs_diff(changed.column));
            prop_assert!(*before == after_ || away <= after.reach(), "{:?} {:?}", cell, changed);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn what_a_plan_from_nothing_forgets_leaves_nothing_behind(
        goal in (0usize..120, 0usize..120), away in (-9i32..=9, -9i32..=9),
        changes in prop::collection::vec(((-9i32..=9, -9i32..=9), prop_oneof![Just(CLOSED), Just(1.0), 1.0..4.0_f64]), 1..12),
    ) {
        let geometry = GridGeometry::new(120, 120, 1.0, 0.0, 0.0).unwrap();
        let goal = Cell::new(goal.0, goal.1);
        let start = geometry.offset(goal, away.0, away.1).unwrap_or(goal);
        let costs = Layer::filled(geometry, 1.0);
        let mut graph = ChangingCells::new(costs.view(), goal, 8, Corners::Keep).unwrap();
        let mut repair = Repair::new(&graph, start, goal).unwrap().with_share(0.0);
        repair.path(&graph, &mut silent());
        for ((rows, columns), cost) in changes {
            let Some(cell) = geometry.offset(goal, rows, columns).filter(|&cell| cell != goal) else {
                continue;
            };
            graph.change([(cell, cost)]).unwrap();
            repair.update(&graph, [cell]);
            let mut fresh = Repair::new(&graph, start, goal).unwrap();
            let found = repair.path(&graph, &mut silent());
            prop_assert_eq!(&found, &fresh.path(&graph, &mut silent()));
            if found == Search::Unreachable {
                // That search is not at its end.
                break;
            }
            prop_assert!(repair.costs == fresh.costs && repair.marks == fresh.marks);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn nothing_is_left_of_what_repairs_and_stops_leave(
        a in (20usize..100, 20usize..100), b in (20usize..100, 20usize..100),
        patches in prop::collection::vec(((-12i32..=12, -12i32..=12), cost_of_a_cell(), any::<bool>(), 0usize..4), 1..10),
    ) {
        let geometry = GridGeometry::new(600, 120, 1.0, 0.0, 0.0).unwrap();
        let (start, goal) = (Cell::new(a.0, a.1), Cell::new(b.0, b.1));
        let costs = Layer::filled(geometry, 1.0);
        let mut graph = ChangingCells::new(costs.view(), goal, 8, Corners::Keep).unwrap();
        let mut repair = Repair::new(&graph, start, goal).unwrap().with_share(f64::INFINITY);
        for ((rows, columns), cost, stops, steps) in patches {
            if let Search::Found { cells, .. } = repair.path(&graph, &mut |_, _| !stops) {
                repair.move_to(cells[steps.min(cells.len() - 1)]).unwrap();
            }
            let around = |step: i32| geometry.offset(repair.start(), rows + step / 3, columns + step % 3);
            let patch: Vec<Cell> = (0..9).filter_map(around).collect();
            graph.change(patch.iter().map(|&cell| (cell, cost))).unwrap();
            repair.update(&graph, patch);
        }
        let noted = repair.used.iter().filter(|&&block| repair.is_used[block as usize]).count();
        prop_assert_eq!((noted, noted), (repair.used.len(), repair.is_used.iter().filter(|&&used| used).count()));
        // Little enough to be cleared in place.
        prop_assume!(noted * BLOCK < geometry.cell_count() / 4);
        repair.forget();
        let fresh = Repair::new(&graph, repair.start(), goal).unwrap();
        prop_assert!(repair.costs == fresh.costs && repair.marks == fresh.marks);
        prop_assert!(repair.is_used == fresh.is_used && repair.used == fresh.used);
    }
}

/// A world as text: '#' closed, a digit its cost per metre, 's' and 'g' cost 1.
fn world(rows: &[&str]) -> (ChangingCells, Cell, Cell) {
    let geometry = GridGeometry::new(rows.len(), rows[0].len(), 1.0, 0.0, 0.0).unwrap();
    let bytes: Vec<u8> = rows.iter().flat_map(|row| row.bytes()).collect();
    let find = |wanted| geometry.cell(bytes.iter().position(|&b| b == wanted).unwrap());
    let costs = bytes.iter().map(|&byte| match byte {
        b'#' => CLOSED,
        b'0'..=b'9' => f64::from(byte - b'0'),
        _ => 1.0,
    });
    let costs = Layer::new(geometry, costs.collect(), "costs").unwrap();
    let goal = find(b'g');
    (
        ChangingCells::new(costs.view(), goal, 8, Corners::Keep).unwrap(),
        find(b's'),
        goal,
    )
}

fn cost(search: &Search) -> f64 {
    match search {
        Search::Found { cost, .. } => *cost,
        _ => CLOSED,
    }
}

#[test]
fn a_door_that_closes_and_opens_again() {
    let (mut graph, start, goal) = world(&["s11#111", "11###11", "1111111", "11###11", "111#11g"]);
    let mut repair = Repair::new(&graph, start, goal).unwrap().with_share(f64::INFINITY);
    let open = cost(&repair.path(&graph, &mut silent()));
    assert!(open < 9.0);
    for _ in 0..3 {
        let door = Cell::new(2, 3);
        graph.change([(door, CLOSED)]).unwrap();
        repair.update(&graph, [door]);
        assert_eq!(repair.path(&graph, &mut silent()), Search::Unreachable);
        graph.change([(door, 1.0)]).unwrap();
        repair.update(&graph, [door]);
        assert_eq!(cost(&repair.path(&graph, &mut silent())), open);
    }
    // That the robot is walled in is noticed without a search.
    assert_eq!((repair.tally().fresh_plans, repair.tally().repairs), (1, 3));
}

#[test]
fn free_ground_does_not_hold_itself_up_when_its_way_is_closed() {
    let (mut graph, start, goal) = world(&["s00001g"]);
    let mut repair = Repair::new(&graph, start, goal).unwrap().with_share(f64::INFINITY);
    approx::assert_relative_eq!(cost(&repair.path(&graph, &mut silent())), 2.0, epsilon = 1e-12);
    graph.change([(Cell::new(0, 5), CLOSED)]).unwrap();
    repair.update(&graph, [Cell::new(0, 5)]);
    assert_eq!(repair.path(&graph, &mut silent()), Search::Unreachable);
}

#[test]
fn ground_that_costs_nothing_costs_nothing() {
    let geometry = GridGeometry::new(9, 9, 1.0, 0.0, 0.0).unwrap();
    let free = Layer::filled(geometry, 0.0);
    let goal = Cell::new(8, 8);
    let graph = ChangingCells::new(free.view(), goal, 16, Corners::Keep).unwrap();
    let mut repair = Repair::new(&graph, Cell::new(0, 0), goal).unwrap();
    assert_eq!(cost(&repair.path(&graph, &mut silent())), 0.0);
}

#[test]
fn going_along_the_way_searches_nothing_and_far_changes_next_to_nothing() {
    let geometry = GridGeometry::new(120, 120, 1.0, 0.0, 0.0).unwrap();
    let draw = |i: usize| 1.0 + crate::random::unit(crate::random::philox([i as u32, 0, 0, 0], 4)[0]);
    let costs = Layer::new(geometry, (0..geometry.cell_count()).map(draw).collect(), "costs").unwrap();
    let goal = Cell::new(110, 110);
    let mut graph = ChangingCells::new(costs.view(), goal, 8, Corners::Keep).unwrap();
    let mut repair = Repair::new(&graph, Cell::new(20, 60), goal).unwrap();
    let Search::Found { cells, .. } = repair.path(&graph, &mut silent()) else {
        panic!("open ground")
    };
    let whole = repair.tally().work;
    for &cell in &cells[1..cells.len() / 2] {
        repair.move_to(cell).unwrap();
        assert!(matches!(repair.path(&graph, &mut silent()), Search::Found { .. }));
        assert_eq!(repair.tally().expanded, 0);
    }
    let far = Cell::new(2, 2);
    graph.change([(far, 9.0)]).unwrap();
    repair.update(&graph, [far]);
    repair.path(&graph, &mut silent());
    assert!(repair.tally().expanded == 0 && repair.tally().work < 20);
    // On the way just ahead of the robot: a repair, and far less work than the first plan.
    let ahead = cells[cells.len() / 2 + 4];
    let patch: Vec<Cell> = (0..25)
        .filter_map(|i| geometry.offset(ahead, i / 5 - 2, i % 5 - 2))
        .collect();
    for &cell in &patch {
        graph.change([(cell, 6.0)]).unwrap();
    }
    repair.update(&graph, patch);
    repair.path(&graph, &mut silent());
    let tally = repair.tally();
    assert!(
        !tally.afresh && tally.expanded > 0 && tally.work * 10 < whole,
        "{tally:?} {whole}"
    );
}

#[test]
fn too_much_work_is_given_up_for_a_fresh_plan() {
    let geometry = GridGeometry::new(100, 100, 1.0, 0.0, 0.0).unwrap();
    let costs = Layer::filled(geometry, 1.0);
    let (start, goal) = (Cell::new(5, 5), Cell::new(90, 80));
    let mut graph = ChangingCells::new(costs.view(), goal, 8, Corners::Keep).unwrap();
    let mut repair = Repair::new(&graph, start, goal).unwrap();
    repair.path(&graph, &mut silent());
    // A dear ring around the goal raises every cost there is, though few cells have changed.
    let ring: Vec<Cell> = geometry
        .cells()
        .filter(|cell| cell.row.abs_diff(goal.row).max(cell.column.abs_diff(goal.column)) == 2)
        .collect();
    for &cell in &ring {
        graph.change([(cell, 50.0)]).unwrap();
    }
    repair.update(&graph, ring);
    repair.path(&graph, &mut silent());
    assert!(repair.tally().afresh && repair.tally().fresh_plans == 2);
    let all: Vec<Cell> = geometry.cells().collect();
    for &cell in &all {
        graph.change([(cell, 3.0)]).unwrap();
    }
    repair.update(&graph, all);
    repair.path(&graph, &mut silent());
    assert!(repair.tally().afresh && repair.tally().fresh_plans == 3);
}

#[test]
fn a_walled_in_robot_is_noticed_without_searching_the_map() {
    let geometry = GridGeometry::new(200, 200, 1.0, 0.0, 0.0).unwrap();
    let costs = Layer::filled(geometry, 1.0);
    let (start, goal) = (Cell::new(20, 20), Cell::new(180, 180));
    let mut graph = ChangingCells::new(costs.view(), goal, 8, Corners::Keep).unwrap();
    let mut repair = Repair::new(&graph, start, goal).unwrap();
    repair.path(&graph, &mut silent());
    let wall: Vec<Cell> = geometry
        .cells()
        .filter(|cell| cell.row.abs_diff(20).max(cell.column.abs_diff(20)) == 4)
        .collect();
    for &cell in &wall {
        graph.change([(cell, CLOSED)]).unwrap();
    }
    repair.update(&graph, wall.iter().copied());
    // A plan from nothing too.
    for repair in [&mut repair, &mut Repair::new(&graph, start, goal).unwrap()] {
        assert_eq!(repair.path(&graph, &mut silent()), Search::Unreachable);
        assert!(repair.tally().work < 4000, "{:?}", repair.tally());
    }
    for &cell in &wall {
        graph.change([(cell, 1.0)]).unwrap();
    }
    repair.update(&graph, wall);
    let again = cost(&repair.path(&graph, &mut silent()));
    approx::assert_relative_eq!(again, 160.0 * 2f64.sqrt(), epsilon = 1e-9);
}

#[test]
fn bad_requests_are_named_and_change_nothing() {
    let (mut graph, start, goal) = world(&["s11", "11g"]);
    assert!(matches!(
        Repair::new(&graph, Cell::new(2, 0), goal),
        Err(PlannerError::Grid(_))
    ));
    let mut repair = Repair::new(&graph, start, goal).unwrap();
    assert!(matches!(repair.move_to(Cell::new(0, 3)), Err(PlannerError::Grid(_))));
    assert_eq!(repair.start(), start);
    assert!(matches!(
        graph.change([(Cell::new(0, 0), 7.0), (Cell::new(1, 1), -1.0)]),
        Err(PlannerError::NegativeCost { row: 1, column: 1, .. })
    ));
    assert!(matches!(
        graph.change([(Cell::new(5, 1), 1.0)]),
        Err(PlannerError::Grid(_))
    ));
    assert_eq!(
        (graph.cost(Cell::new(1, 1)), graph.cost(Cell::new(9, 9))),
        (1.0, CLOSED)
    );
    repair.update(&graph, [Cell::new(70, 70)]);
    approx::assert_relative_eq!(cost(&repair.path(&graph, &mut silent())), 1.0 + 2f64.sqrt());
}
