//! Laws of ways at any angle over plain costs and over ground, and of the eikonal field.

use super::*;
use crate::grid::{GridGeometry, Layer};
use crate::planner::{
    Algorithm, AnyAngleMethod, Corners, CostSegments, PlannerError, any_angle_path, eikonal_field, shortest_path,
};
use crate::progress::silent;
use crate::vehicle::fixtures::tractor;
use proptest::prelude::*;
use rstest::rstest;

const CELL_M: f64 = 2.0;

/// A world as text: '#' closed, a digit its cost per metre, 's' and 'g' cost 1.
fn world(rows: &[&str]) -> (Layer<f64>, Cell, Cell) {
    let geometry = GridGeometry::new(rows.len(), rows[0].len(), CELL_M, 50.0, 70.0).unwrap();
    let bytes: Vec<u8> = rows.iter().flat_map(|row| row.bytes()).collect();
    let find = |wanted| geometry.cell(bytes.iter().position(|&b| b == wanted).unwrap());
    let costs = bytes.iter().map(|&byte| match byte {
        b'#' => f64::INFINITY,
        b'0'..=b'9' => f64::from(byte - b'0'),
        _ => 1.0,
    });
    let costs = Layer::new(geometry, costs.collect(), "costs").unwrap();
    (costs, find(b's'), find(b'g'))
}

fn ask(costs: &Layer<f64>, start: Cell, goal: Cell, corners: Corners, method: AnyAngleMethod) -> WaySearch {
    any_angle_path(costs.view(), start, goal, corners, method, &mut silent()).unwrap()
}

fn costs() -> impl Strategy<Value = Layer<f64>> {
    let cell = prop_oneof![
        8 => 0.5f64..9.0, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY), 1 => Just(0.0)
    ];
    (1usize..12, 1usize..12).prop_flat_map(move |(rows, columns)| {
        prop::collection::vec(cell.clone(), rows * columns).prop_map(move |data| {
            let geometry = GridGeometry::new(rows, columns, CELL_M, 500.0, -70.0).unwrap();
            Layer::new(geometry, data, "costs").unwrap()
        })
    })
}

/// The segment's cost as the sum over many samples.
fn sampled(costs: &Layer<f64>, a: Position, b: Position) -> f64 {
    const SAMPLES: u32 = 20_000;
    let mean: f64 = (0..SAMPLES)
        .map(|i| {
            costs
                .geometry()
                .cell_at(a.towards(b, (f64::from(i) + 0.5) / f64::from(SAMPLES)))
        })
        .map(|cell| cell.map_or(f64::NAN, |cell| costs[cell]))
        .sum();
    mean / f64::from(SAMPLES) * a.distance_m(b)
}

proptest! {
    #[test]
    fn a_way_is_open_ends_where_asked_and_costs_between_the_bound_and_the_steps(
        layer in costs(), a: prop::sample::Index, b: prop::sample::Index, cut: bool,
    ) {
        let geometry = layer.geometry();
        let (start, goal) = (
            geometry.cell(a.index(geometry.cell_count())), geometry.cell(b.index(geometry.cell_count())),
        );
        let corners = if cut { Corners::Cut } else { Corners::Keep };
        let graph = CostSegments::new(layer.view(), goal, corners).unwrap();
        let least = layer.data().iter().copied().fold(f64::INFINITY, f64::min);
        let open_ends = [start, goal].iter().all(|&end| layer[end].is_finite());
        let mut by_method = Vec::new();
        for method in [AnyAngleMethod::Theta, AnyAngleMethod::Auto, AnyAngleMethod::Eikonal] {
            let found = ask(&layer, start, goal, corners, method);
            if let WaySearch::Found(Way { points, cost }) = &found {
                prop_assert!(open_ends);
                prop_assert_eq!(points[0], geometry.centre(start));
                prop_assert_eq!(points[points.len() - 1], geometry.centre(goal));
                prop_assert_eq!(points.len() == 1, start == goal);
                let sum: f64 = points.windows(2).map(|pair| graph.segment_cost(pair[0], pair[1])).sum();
                prop_assert!(sum == *cost && cost.is_finite());
                let straight = geometry.centre(start).distance_m(geometry.centre(goal));
                prop_assert!(*cost >= least * straight * (1.0 - 1e-9));
            }
            by_method.push(found);
        }
        for neighbours in [8, 16] {
            let steps = shortest_path(
                layer.view(), start, goal, neighbours, corners, Algorithm::Dijkstra, &mut silent(),
            ).unwrap();
            for found in &by_method[..2] {
                match (&steps, found) {
                    (Search::Found { cost: steps, .. }, WaySearch::Found(way)) if open_ends => {
                        prop_assert!(way.cost <= steps * (1.0 + 1e-9) + 1e-12, "{} {}", way.cost, steps);
                    }
                    (_, WaySearch::Found(_)) => prop_assert!(false, "a way where none is"),
                    (steps, _) => prop_assert!(!open_ends || *steps == Search::Unreachable),
                }
            }
        }
        match (&by_method[0], &by_method[1], &by_method[2]) {
            (WaySearch::Found(theta), WaySearch::Found(best), other) => {
                prop_assert!(best.cost <= theta.cost);
                match other {
                    WaySearch::Found(eikonal) => prop_assert!(best.cost <= eikonal.cost),
                    other => prop_assert!(cut, "{:?}", other),
                }
            }
            (_, _, other) => prop_assert_eq!(other, &WaySearch::Unreachable),
        }
    }

    #[test]
    fn a_segment_costs_what_samples_along_it_add_up_to(
        layer in costs(), a in (0.0f64..1.0, 0.0f64..1.0), b in (0.0f64..1.0, 0.0f64..1.0),
    ) {
        let geometry = layer.geometry();
        let place = |(x, y): (f64, f64)| Position::new(
            geometry.west_m() + x * geometry.columns() as f64 * CELL_M,
            geometry.north_m() - y * geometry.rows() as f64 * CELL_M,
        );
        let (a, b) = (place(a), place(b));
        let graph = CostSegments::new(layer.view(), Cell::new(0, 0), Corners::Cut).unwrap();
        let (cost, sampled) = (graph.segment_cost(a, b), sampled(&layer, a, b));
        if cost.is_finite() && sampled.is_finite() {
            // Each border is off by one sample at most, and there are at most 24.
            let slack = 24.0 * 9.0 * a.distance_m(b) / 20_000.0;
            prop_assert!((cost - sampled).abs() <= slack + 1e-9, "{} {}", cost, sampled);
        }
        prop_assert!(cost.is_infinite() || !sampled.is_nan() && sampled < f64::INFINITY);
        let kept = CostSegments::new(layer.view(), Cell::new(0, 0), Corners::Keep).unwrap().segment_cost(a, b);
        prop_assert!(kept.is_infinite() || kept == cost);
        // Through an exact corner the other direction may meet it in another order of rounding.
        let back = graph.segment_cost(b, a);
        prop_assert!(back.is_infinite() && cost.is_infinite() || (back - cost).abs() <= 1e-7 * (1.0 + cost));
    }

    #[test]
    fn an_eikonal_field_reaches_what_shares_sides_and_scales_with_the_cost(layer in costs(), factor in 0.1f64..10.0) {
        let geometry = layer.geometry();
        let start = Cell::new(0, 0);
        let field = eikonal_field(layer.view(), start, &mut silent()).unwrap();
        let mut reached = vec![layer[start].is_finite()];
        reached.resize(geometry.cell_count(), false);
        let mut todo = vec![start];
        while let Some(here) = todo.pop().filter(|_| reached[0]) {
            for step in crate::grid::FOUR {
                let Some(near) = step.from(&geometry, here) else { continue };
                if layer[near].is_finite() && !reached[geometry.index(near)] {
                    reached[geometry.index(near)] = true;
                    todo.push(near);
                }
            }
        }
        for (value, reached) in field.iter().zip(reached) {
            prop_assert_eq!(value.is_finite(), reached);
            prop_assert!(*value >= 0.0);
        }
        let scaled: Vec<f64> = layer.data().iter().map(|cost| cost * factor).collect();
        let scaled = Layer::new(geometry, scaled, "costs").unwrap();
        for (one, other) in field.iter().zip(eikonal_field(scaled.view(), start, &mut silent()).unwrap()) {
            prop_assert!(!one.is_finite() || (one * factor - other).abs() <= 1e-6 * (1.0 + other));
        }
    }

    #[test]
    fn on_ground_it_never_costs_more_than_the_steps_and_keeps_the_limits(
        seed: u64, height in 0.0f64..12.0, a in 0usize..400, b in 0usize..400,
    ) {
        let geometry = GridGeometry::new(20, 20, 10.0, 0.0, 0.0).unwrap();
        let phase = f64::from(crate::random::philox([1, 5, 0, 0], seed)[0] % 7);
        let heights = geometry.cells().map(|cell| {
            (height * (0.5 * cell.row as f64 + phase).sin() * (0.4 * cell.column as f64).cos()) as f32
        });
        let elevation = Layer::new(geometry, heights.collect(), "z").unwrap();
        let vehicle = tractor();
        let (start, goal) = (geometry.cell(a), geometry.cell(b));
        let ground = Ground::new(elevation.view(), None, &vehicle, 20.0, |_| true, None, geometry.centre(goal));
        let steps = search(&ground, start, goal, &mut silent());
        match (steps, any_angle(&ground, start, goal, &mut silent())) {
            (Search::Found { cost, .. }, WaySearch::Found(way)) => {
                prop_assert!(way.cost <= cost * (1.0 + 1e-6), "{} {}", way.cost, cost);
                prop_assert!(way.cost >= ground.bound(start) * (1.0 - 1e-9));
                prop_assert!(way.points.windows(2).all(|pair| ground.segment(pair[0], pair[1]).is_ok()));
            }
            (Search::Unreachable, WaySearch::Unreachable) => {}
            other => prop_assert!(false, "{:?}", other),
        }
    }
}

#[rstest]
// Free ground: the straight line, whatever its heading.
#[case(&["s11111", "111111", "11111g"], 5f64.hypot(2.0))]
#[case(&["s1111g"], 5.0)]
#[case(&["s", "1", "g"], 2.0)]
// The corner of a closed block is passed as near as one likes.
#[case(&["s1111", "11#11", "11#1g"], 2.5f64.hypot(0.5) + 1.5f64.hypot(1.5))]
fn drawn_worlds(#[case] rows: &[&str], #[case] expected_cells: f64) {
    let (layer, start, goal) = world(rows);
    for method in [AnyAngleMethod::Theta, AnyAngleMethod::Eikonal, AnyAngleMethod::Auto] {
        let WaySearch::Found(way) = ask(&layer, start, goal, Corners::Keep, method) else {
            panic!("no way")
        };
        approx::assert_relative_eq!(way.cost, expected_cells * CELL_M, max_relative = 1e-3);
        assert!(way.cost >= expected_cells * CELL_M * (1.0 - 1e-9), "{way:?}");
    }
}

#[test]
fn beside_cheap_ground_the_way_leaves_at_the_critical_angle() {
    let (mut layer, start, goal) = world(&["11111111111", "s111111111g"]);
    layer.data_mut()[11..].fill(3.0);
    let WaySearch::Found(way) = ask(&layer, start, goal, Corners::Keep, AnyAngleMethod::Auto) else {
        panic!("no way")
    };
    // Half a cell of cost 3 on either side, sine of the angle 1/3; the rest along the border at cost 1.
    let cosine = (1.0 - 1.0 / 9.0f64).sqrt();
    let expected_m = 3.0 / cosine + 10.0 - 1.0 / 3.0 / cosine;
    approx::assert_relative_eq!(way.cost, expected_m * CELL_M, max_relative = 1e-8);
    assert_eq!(way.points.len(), 4);
}

#[test]
fn corners_are_kept_or_cut() {
    let (layer, start, goal) = world(&["1#g", "11#", "s11"]);
    assert_eq!(
        ask(&layer, start, goal, Corners::Keep, AnyAngleMethod::Auto),
        WaySearch::Unreachable
    );
    let WaySearch::Found(way) = ask(&layer, start, goal, Corners::Cut, AnyAngleMethod::Auto) else {
        panic!("no way")
    };
    approx::assert_relative_eq!(way.cost, 8f64.sqrt() * CELL_M, epsilon = 1e-9);
}

#[test]
fn bad_requests_are_named_closed_ends_reach_nothing_and_a_report_stops() {
    let (mut layer, start, goal) = world(&["s111", "1111", "111g"]);
    let outside = Cell::new(9, 0);
    let method = AnyAngleMethod::Auto;
    for (a, b) in [(start, outside), (outside, goal)] {
        let asked = any_angle_path(layer.view(), a, b, Corners::Keep, method, &mut silent());
        assert!(matches!(asked, Err(PlannerError::Grid(_))));
    }
    let stopped = any_angle_path(layer.view(), start, goal, Corners::Keep, method, &mut |_, _| false);
    assert_eq!(stopped, Ok(WaySearch::Stopped));
    assert_eq!(
        eikonal_field(layer.view(), start, &mut |_, _| false),
        Err(PlannerError::Stopped)
    );
    layer.data_mut()[0] = f64::NAN;
    for (a, b) in [(start, goal), (goal, start), (start, start)] {
        assert_eq!(ask(&layer, a, b, Corners::Keep, method), WaySearch::Unreachable);
    }
    let field = eikonal_field(layer.view(), start, &mut silent()).unwrap();
    assert!(field.iter().all(|cost| cost.is_infinite()));
    layer.data_mut()[3] = -1.0;
    let negative = any_angle_path(layer.view(), goal, goal, Corners::Keep, method, &mut silent());
    assert!(matches!(negative, Err(PlannerError::NegativeCost { .. })));
    assert!(eikonal_field(layer.view(), outside, &mut silent()).is_err());
}

/// A stop at any report is heard, and no later report changes that.
#[test]
fn a_stop_is_heard_wherever_it_comes() {
    let (layer, start, goal) = world(&["s11911", "11#9#1", "1111#g"]);
    for reports in 0..2000 {
        let mut left = reports;
        let found = any_angle_path(
            layer.view(),
            start,
            goal,
            Corners::Keep,
            AnyAngleMethod::Auto,
            &mut |_, _| {
                left -= 1;
                left >= 0
            },
        );
        if matches!(found, Ok(WaySearch::Found(_))) {
            assert!(reports > 3);
            return;
        }
        assert_eq!(found, Ok(WaySearch::Stopped));
    }
    panic!("never found");
}
