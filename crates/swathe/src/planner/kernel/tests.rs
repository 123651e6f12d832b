//! Every algorithm against Dijkstra in floats, on worlds large enough that the coarse grid limits the search.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use proptest::prelude::*;
use rstest::rstest;

use crate::grid::{Cell, GridGeometry, LayerView};
use crate::planner::search::{Search, StepGraph};
use crate::planner::{Algorithm, CellCost, Corners, CostCells, PlannerError, cell_cost_field, shortest_path};
use crate::progress::silent;
use crate::random::{philox, unit};

const ALGORITHMS: [Algorithm; 3] = [Algorithm::Auto, Algorithm::Dijkstra, Algorithm::AStar];

#[derive(Clone, Copy, Debug)]
enum Kind {
    Even,
    Rough,
    Patches,
    Broad,
    Maze,
    FreePatches,
    AllFree,
    Unequal,
    CostlyWalls,
    Subnormal,
    Huge,
}

const KINDS: [Kind; 11] = [
    Kind::Even,
    Kind::Rough,
    Kind::Patches,
    Kind::Broad,
    Kind::Maze,
    Kind::FreePatches,
    Kind::AllFree,
    Kind::Unequal,
    Kind::CostlyWalls,
    Kind::Subnormal,
    Kind::Huge,
];

fn world(kind: Kind, rows: usize, columns: usize, seed: u32) -> Vec<f64> {
    let patch_of = |row: usize, column: usize, side: usize| {
        unit(philox([(row / side) as u32, (column / side) as u32, 1, 0], u64::from(seed))[0])
    };
    let cost = |index: usize| {
        let (row, column) = (index / columns, index % columns);
        let [a, b, c, _] = philox([index as u32, 0, 0, 0], u64::from(seed)).map(unit);
        let rough = 1.0 + 7.0 * a;
        match kind {
            Kind::Rough => [rough, f64::NAN, f64::INFINITY][usize::from(b < 0.2) * (1 + usize::from(c < 0.5))],
            Kind::Patches => 1.0 + 7.0 * patch_of(row, column, 11) + 0.1 * a,
            Kind::Broad => 1.0 + 7.0 * patch_of(row, column, 60) + 0.1 * a,
            Kind::Maze if row % 6 == 3 => [f64::INFINITY, 1.0][usize::from(b < 0.05)],
            Kind::Maze | Kind::Even => 1.0,
            Kind::FreePatches => [rough, 0.0][usize::from(patch_of(row, column, 5) < 0.4)],
            Kind::AllFree => 0.0,
            Kind::Unequal => 10.0f64.powf(6.0 * a),
            Kind::CostlyWalls => [rough, 1e9][usize::from(patch_of(row, column, 4) < 0.3)],
            Kind::Subnormal => rough * 1e-310,
            Kind::Huge => rough * 1e303,
        }
    };
    (0..rows * columns).map(cost).collect()
}

/// Textbook Dijkstra in floats with a binary heap.
fn outside<C: CellCost>(graph: &CostCells<C>, start: Cell) -> Vec<f64> {
    let geometry = graph.geometry();
    let mut costs = vec![f64::INFINITY; geometry.cell_count()];
    costs[geometry.index(start)] = 0.0;
    let mut heap = BinaryHeap::from([(Reverse(0), geometry.index(start))]);
    while let Some((Reverse(bits), index)) = heap.pop() {
        if f64::from_bits(bits) > costs[index] {
            continue;
        }
        let here = geometry.cell(index);
        for (k, step) in graph.steps().iter().enumerate() {
            let cost = costs[index] + graph.edge_cost(here, k);
            if let Some(near) = step.from(&geometry, here)
                && cost < costs[geometry.index(near)]
            {
                costs[geometry.index(near)] = cost;
                heap.push((Reverse(cost.to_bits()), geometry.index(near)));
            }
        }
    }
    costs
}

/// The cost of a way, which must be one.
fn walked<C: CellCost>(graph: &CostCells<C>, cells: &[Cell]) -> f64 {
    let geometry = graph.geometry();
    let along = cells.windows(2).map(|pair| {
        let step = |k: &usize| graph.steps()[*k].from(&geometry, pair[0]) == Some(pair[1]);
        graph.edge_cost(pair[0], (0..graph.steps().len()).find(step).unwrap())
    });
    along.sum()
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * b
}

/// Compares every algorithm, there and back, and the field, with Dijkstra from outside.
fn compare<C: CellCost>(costs: &[C], columns: usize, ends: [Cell; 2], neighbours: u32, corners: Corners) {
    let geometry = GridGeometry::new(costs.len() / columns, columns, 0.7, 0.0, 0.0).unwrap();
    let view = LayerView::new(geometry, costs, "costs").unwrap();
    let [start, goal] = ends;
    let graph = CostCells::new(view, goal, neighbours, corners, Algorithm::Dijkstra).unwrap();
    let field = outside(&graph, start);
    let least = field[geometry.index(goal)];
    for algorithm in ALGORITHMS {
        for [from, to] in [[start, goal], [goal, start]] {
            let found = shortest_path(view, from, to, neighbours, corners, algorithm, None, &mut silent()).unwrap();
            match found {
                Search::Found { cells, cost } => {
                    assert!(
                        close(cost, least),
                        "{algorithm:?} {from:?} {to:?}: {cost} instead of {least}"
                    );
                    assert!(close(walked(&graph, &cells), cost));
                    assert_eq!((cells[0], cells[cells.len() - 1]), (from, to));
                    let mut once = cells.clone();
                    once.sort();
                    once.dedup();
                    assert_eq!(once.len(), cells.len());
                }
                Search::Unreachable => assert!(least.is_infinite(), "{algorithm:?}"),
                Search::Stopped => panic!("stopped"),
            }
        }
    }
    let found = cell_cost_field(view, start, neighbours, corners, None, &mut silent())
        .unwrap()
        .unwrap();
    for (found, expected) in found.iter().zip(&field) {
        let closed_start = !costs[geometry.index(start)].per_metre().is_finite();
        assert!(
            found == expected || close(*found, *expected) || closed_start,
            "{found} instead of {expected}"
        );
    }
}

fn ends(costs: &[f64], columns: usize, picks: [usize; 2]) -> [Cell; 2] {
    let open: Vec<usize> = (0..costs.len()).filter(|&index| costs[index].is_finite()).collect();
    picks.map(|pick| {
        let index = open[pick % open.len()];
        Cell::new(index / columns, index % columns)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(120))]
    #[test]
    fn every_search_finds_the_least_cost(
        kind in prop::sample::select(&KINDS[..]), rows in 30usize..90, columns in 140usize..160, seed: u32,
        picks: [usize; 2], sixteen: bool, cut: bool,
    ) {
        let costs = world(kind, rows, columns, seed);
        let corners = if cut { Corners::Cut } else { Corners::Keep };
        compare(&costs, columns, ends(&costs, columns, picks), if sixteen { 16 } else { 8 }, corners);
    }

    #[test]
    fn small_and_narrow_maps_are_searched_too(
        kind in prop::sample::select(&KINDS[..]), rows in 1usize..5, columns in 1usize..7, seed: u32,
        picks: [usize; 2], sixteen: bool,
    ) {
        let costs = world(kind, rows, columns, seed);
        prop_assume!(costs.iter().any(|cost| cost.is_finite()));
        compare(&costs, columns, ends(&costs, columns, picks), if sixteen { 16 } else { 8 }, Corners::Keep);
    }
}

#[test]
fn long_steps_that_cut_corners_are_not_left_out() {
    let (rows, columns) = (60, 154);
    let costs = world(Kind::Maze, rows, columns, 83_175_415);
    let picks = [3_587_821_079_290_031_644, 1_258_502_586_808_104_674];
    compare(&costs, columns, ends(&costs, columns, picks), 16, Corners::Cut);
}

#[rstest]
#[case(1, 6000)]
#[case(6000, 1)]
#[case(2, 3000)]
fn strips_beyond_the_size_of_a_guided_map(#[case] rows: usize, #[case] columns: usize) {
    let costs = world(Kind::Patches, rows, columns, 5);
    compare(
        &costs,
        columns,
        [Cell::new(0, 0), Cell::new(rows - 1, columns - 1)],
        16,
        Corners::Keep,
    );
}

#[test]
fn costs_of_every_kind_of_number_are_read_in_place() {
    let (columns, ends) = (120, [Cell::new(3, 2), Cell::new(70, 110)]);
    let costs = world(Kind::Patches, 80, columns, 9);
    compare(
        &costs.iter().map(|&cost| cost as f32).collect::<Vec<_>>(),
        columns,
        ends,
        8,
        Corners::Keep,
    );
    compare(
        &costs.iter().map(|&cost| (30.0 * cost) as u8).collect::<Vec<_>>(),
        columns,
        ends,
        8,
        Corners::Keep,
    );
    compare(
        &costs.iter().map(|&cost| (5000.0 * cost) as u16).collect::<Vec<_>>(),
        columns,
        ends,
        16,
        Corners::Keep,
    );
    compare(
        &costs.iter().map(|&cost| cost < 6.0).collect::<Vec<_>>(),
        columns,
        ends,
        16,
        Corners::Keep,
    );
}

#[test]
fn a_way_may_cost_many_times_what_a_label_holds() {
    // 400,000 steps of 2^31 units each along one winding corridor.
    let (rows, columns) = (801, 1000);
    let wall = |index: usize| {
        let (row, column) = (index / columns, index % columns);
        row % 2 == 1 && column != if row % 4 == 1 { columns - 1 } else { 0 }
    };
    let costs: Vec<u8> = (0..rows * columns).map(|index| u8::from(!wall(index))).collect();
    let open: Vec<bool> = costs.iter().map(|&cost| cost == 1).collect();
    let geometry = GridGeometry::new(rows, columns, 1.0, 0.0, 0.0).unwrap();
    let (start, goal) = (Cell::new(0, 0), Cell::new(rows - 1, columns - 1));
    for algorithm in [Algorithm::Auto, Algorithm::Dijkstra] {
        let view = LayerView::new(geometry, &open, "costs").unwrap();
        let found = shortest_path(view, start, goal, 8, Corners::Keep, algorithm, None, &mut silent()).unwrap();
        let expected = 401.0 * 999.0 + 800.0;
        assert!(
            matches!(found, Search::Found { cost, .. } if cost == expected),
            "{expected}"
        );
    }
}

#[test]
fn free_ground_is_crossed_straight() {
    let costs = vec![0.0; 10_000];
    let geometry = GridGeometry::new(100, 100, 1.0, 0.0, 0.0).unwrap();
    let view = LayerView::new(geometry, &costs, "costs").unwrap();
    let (start, goal) = (Cell::new(0, 0), Cell::new(99, 50));
    let found = shortest_path(
        view,
        start,
        goal,
        8,
        Corners::Keep,
        Algorithm::Auto,
        None,
        &mut silent(),
    );
    assert!(matches!(found, Ok(Search::Found { cells, cost: 0.0 }) if cells.len() == 100));
}

#[test]
fn less_memory_than_needed_is_refused_with_what_would_fit() {
    let costs = vec![1.0f32; 250_000];
    let ask = |side: usize, limit| {
        let geometry = GridGeometry::new(side, side, 1.0, 0.0, 0.0).unwrap();
        let view = LayerView::new(geometry, &costs[..side * side], "costs").unwrap();
        let (start, goal) = (Cell::new(0, 0), Cell::new(side - 1, side - 1));
        shortest_path(
            view,
            start,
            goal,
            8,
            Corners::Keep,
            Algorithm::Auto,
            Some(limit),
            &mut silent(),
        )
    };
    let Err(PlannerError::Memory { needed, limit, cells }) = ask(500, 1_000_000) else {
        panic!("not refused");
    };
    assert!(limit == 1_000_000 && needed > 1_000_000 && needed < 1_600_000);
    let side = (0.9 * cells as f64).sqrt() as usize;
    assert!(ask(side, limit).is_ok());
    assert!(ask(500, needed).is_ok());
}

#[rstest]
#[case(Algorithm::Auto)]
#[case(Algorithm::Dijkstra)]
#[case(Algorithm::AStar)]
fn a_report_stops_a_search_at_any_time(#[case] algorithm: Algorithm) {
    let costs = world(Kind::Patches, 900, 900, 3);
    let geometry = GridGeometry::new(900, 900, 1.0, 0.0, 0.0).unwrap();
    let view = LayerView::new(geometry, &costs, "costs").unwrap();
    let ends = [Cell::new(0, 0), Cell::new(899, 899)];
    for reports in 0..2 {
        let mut left = reports;
        let mut stop = |_, _| {
            left -= 1;
            left >= 0
        };
        let found = shortest_path(view, ends[0], ends[1], 8, Corners::Keep, algorithm, None, &mut stop);
        assert_eq!(found, Ok(Search::Stopped));
    }
}

#[test]
fn a_coarse_bound_leaves_most_of_a_map_out() {
    let costs = world(Kind::Broad, 500, 500, 4);
    let geometry = GridGeometry::new(500, 500, 1.0, 0.0, 0.0).unwrap();
    let view = LayerView::new(geometry, &costs, "costs").unwrap();
    let settled = ALGORITHMS.map(|algorithm| {
        let mut settled = 0;
        let mut tell = |done, _| {
            settled = done;
            true
        };
        let ends = [Cell::new(250, 50), Cell::new(250, 450)];
        shortest_path(view, ends[0], ends[1], 8, Corners::Keep, algorithm, None, &mut tell).unwrap();
        settled
    });
    let [auto, dijkstra, a_star] = settled;
    assert!(2 * auto < dijkstra && a_star < dijkstra, "{settled:?}");
}
