//! How long one question to the overlapping grids takes. Left out of ordinary runs, because it reads the clock:
//! `cargo test --release --package swathe --test grid_query_time -- --ignored --nocapture`

use std::hint::black_box;
use std::time::Instant;

use swathe::grid::{GridGeometry, Position};
use swathe::nest::{Footprint, GridMode, GridsParams, OverlappingGrids, product_phases};
use swathe::random::{philox, unit};
use swathe::rank::RankMap;

#[test]
#[ignore = "a measurement"]
fn time_of_a_query_and_of_a_move() {
    const QUERIES: u32 = 1 << 20;
    let geometry = GridGeometry::new(1000, 1000, 0.25, 0.0, 250.0).unwrap();
    // One cell in 1024 closed: most cells are suitable, so that most questions look at all they can.
    let ranks = (0..1_000_000).map(|cell| {
        if philox([cell, 0, 0, 0], 3)[0].is_multiple_of(1024) {
            1
        } else {
            8
        }
    });
    let map = RankMap::from_ranks(geometry, &ranks.collect::<Vec<u8>>()).unwrap();
    let poses: Vec<(Position, f64)> = (0..QUERIES)
        .map(|pose| {
            let [x, y, heading, _] = philox([pose, 1, 0, 0], 3);
            (
                Position::new(100.0 + 50.0 * unit(x), 100.0 + 50.0 * unit(y)),
                6.0 * unit(heading),
            )
        })
        .collect();
    let (circle, rectangle) = (
        Footprint::circle(0.36).unwrap(),
        Footprint::rectangle(0.51, 0.5).unwrap(),
    );
    for (name, mode, phases) in [
        ("two grids", GridMode::Or, GridsParams::new(0.714).phases),
        ("four grids", GridMode::Or, product_phases(&[0.0, 0.5])),
        ("sixteen grids", GridMode::Exact16, GridsParams::new(0.714).phases),
    ] {
        let params = GridsParams {
            mode,
            phases,
            ..GridsParams::new(0.714)
        };
        let mut grids = OverlappingGrids::new(params, Position::new(125.0, 125.0), &map).unwrap();
        for (shape, footprint) in [("circle", circle), ("rectangle", rectangle)] {
            let start = Instant::now();
            let mut yes = 0;
            for &(position, heading_rad) in &poses {
                yes += u32::from(
                    grids
                        .navigable(black_box(position), heading_rad, &footprint)
                        .navigable(),
                );
            }
            let nanoseconds = start.elapsed().as_secs_f64() * 1e9 / f64::from(QUERIES);
            let share = f64::from(yes) / f64::from(QUERIES);
            println!("{name}, {shape}: {nanoseconds:.0} ns a question, {share:.2} navigable");
        }
        let start = Instant::now();
        for step in 0..100 {
            grids
                .recentre(Position::new(125.0 + 0.714 * 4.0 * f64::from(step % 20), 125.0), &map)
                .unwrap();
        }
        let microseconds = start.elapsed().as_secs_f64() * 1e6 / 100.0;
        println!("{name}: {microseconds:.0} us a move by about one cell");
    }
}
