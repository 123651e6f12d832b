//! A gate on the speed of the grid search that no clock decides: instructions per cell, counted by callgrind.
//!
//! The bounds are what was counted (in the profile of tests, its checks included) when they were set, and a tenth more.
//! When a change is worth more instructions because it saves waiting for memory, measure it with
//! `make bench ONLY=route-4000` and set them anew.

mod callgrind;

use std::hint::black_box;

use rstest::rstest;
use swathe::grid::{Cell, GridGeometry, LayerView};
use swathe::planner::{Algorithm, Corners, Search, cell_cost_field, shortest_path};
use swathe::random::{philox, unit};

const SIDE: usize = 300;

/// The jobs by name, as the process under callgrind is told.
const JOBS: [&str; 4] = ["eight", "sixteen", "guided", "floats"];

/// Counted alone, under this name.
#[inline(never)]
fn kernel_job(job: &str, costs: LayerView<f32>) -> u64 {
    let ends = [Cell::new(0, 0), Cell::new(SIDE - 1, SIDE - 1)];
    let mut settled = 0;
    let mut tell = |done, _| {
        settled = done;
        true
    };
    if job == "floats" {
        black_box(cell_cost_field(costs, ends[0], 8, Corners::Keep, None, &mut tell).is_ok());
        return settled;
    }
    let (neighbours, algorithm) = match job {
        "sixteen" => (16, Algorithm::Dijkstra),
        "guided" => (8, Algorithm::Auto),
        _ => (8, Algorithm::Dijkstra),
    };
    let found = shortest_path(
        costs,
        ends[0],
        ends[1],
        neighbours,
        Corners::Keep,
        algorithm,
        None,
        &mut tell,
    );
    assert!(matches!(found, Ok(Search::Found { .. })));
    settled
}

#[test]
#[ignore = "run by the test below, under callgrind"]
fn job() {
    let Ok(job) = std::env::var("SWATHE_KERNEL_JOB") else {
        return;
    };
    let patch = |index: usize| [(index / SIDE / 40) as u32, (index % SIDE / 40) as u32, 0, 0];
    let costs: Vec<f32> = (0..SIDE * SIDE)
        .map(|index| {
            let rough = unit(philox([index as u32, 0, 0, 1], 7)[0]);
            (1.0 + 6.0 * unit(philox(patch(index), 7)[0]) + rough) as f32
        })
        .collect();
    let geometry = GridGeometry::new(SIDE, SIDE, 1.0, 0.0, 0.0).unwrap();
    let settled = kernel_job(&job, LayerView::new(geometry, &costs, "costs").unwrap());
    println!("settled={settled}");
}

/// Instructions per cell of the map.
fn instructions_per_cell(job: &str) -> Option<f64> {
    Some(callgrind::instructions("kernel_job", "SWATHE_KERNEL_JOB", job)? / (SIDE * SIDE) as f64)
}

#[rstest]
#[case(JOBS[0], 1060.0)]
#[case(JOBS[1], 2580.0)]
#[case(JOBS[2], 790.0)]
#[case(JOBS[3], 920.0)]
fn instructions_per_cell_stay_below_their_bound(#[case] job: &str, #[case] bound: f64) {
    if let Some(counted) = instructions_per_cell(job) {
        println!("{job}: {counted:.0}");
        assert!(
            counted <= bound,
            "{job}: {counted:.0} instructions per cell, above {bound}"
        );
        assert!(
            counted >= 0.5 * bound,
            "{job}: {counted:.0} instructions per cell: set the bound of {bound} lower"
        );
    }
}
