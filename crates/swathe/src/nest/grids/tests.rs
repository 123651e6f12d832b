//! Laws of the overlapping grids on drawn ground, against brute force over terrain cells.

use std::sync::atomic::{AtomicU64, Ordering};

use proptest::prelude::*;

use super::*;
use crate::grid::{Cell, Layer, LayerView};
use crate::random::philox;
use crate::rank::{CellRank, RankMap};
use crate::vehicle::fixtures;

/// Ground of 24 x 30 cells of 1 m, closed here and there.
fn drawn(seed: u64, closed_in_64: u32) -> RankMap {
    let geometry = GridGeometry::new(24, 30, 1.0, 500.3, 900.7).unwrap();
    let ranks = (0..geometry.cell_count() as u32).map(|cell| {
        if philox([cell, 0, 0, 0], seed)[0] % 64 < closed_in_64 {
            (cell % 6) as u8
        } else {
            6 + (cell % 5) as u8
        }
    });
    RankMap::from_ranks(geometry, &ranks.collect::<Vec<_>>()).unwrap()
}

fn grids(map: &RankMap, mode: GridMode, size_m: f64) -> OverlappingGrids {
    let params = GridsParams {
        mode,
        window_cells: 16,
        ..GridsParams::new(size_m)
    };
    OverlappingGrids::new(params, Position::new(515.0, 889.0), map).unwrap()
}

/// The footprint as a shape in map metres: a disc by radius, or a rectangle by length and width.
#[derive(Clone, Copy, Debug)]
enum Ground {
    Disc(f64),
    Box(f64, f64),
}

impl Ground {
    fn footprint(self) -> Footprint {
        match self {
            Self::Disc(radius_m) => Footprint::circle(radius_m).unwrap(),
            Self::Box(length_m, width_m) => Footprint::rectangle(length_m, width_m).unwrap(),
        }
    }

    /// Many points of the closed footprint, its edge among them.
    fn points(self, at: Position, heading_rad: f64) -> Vec<Position> {
        let shares = || (0..=12).map(|i| f64::from(i) / 6.0 - 1.0);
        let pairs = shares().flat_map(|a| shares().map(move |b| (a, b)));
        let (sin, cos) = heading_rad.sin_cos();
        let place = |(a, b): (f64, f64)| {
            let (along, aside) = match self {
                Self::Disc(radius) => {
                    let (turn, out) = (std::f64::consts::PI * a, radius * (b + 1.0) / 2.0);
                    (out * turn.cos(), out * turn.sin())
                }
                Self::Box(length, width) => (a * length / 2.0, b * width / 2.0),
            };
            Position::new(at.x_m + along * cos - aside * sin, at.y_m + along * sin + aside * cos)
        };
        pairs.map(place).collect()
    }
}

impl Ground {
    /// Whether the footprint, grown by a length, touches the square of a half side around a centre.
    fn touches(self, at: Position, heading_rad: f64, centre: Position, half: f64, growth_m: f64) -> bool {
        let (dx, dy) = (centre.x_m - at.x_m, centre.y_m - at.y_m);
        match self {
            Self::Disc(radius) => {
                let [off_x, off_y] = [dx, dy].map(|off| (off.abs() - half).max(0.0));
                off_x.hypot(off_y) <= radius + growth_m
            }
            Self::Box(length, width) => {
                let (sin, cos) = heading_rad.sin_cos();
                let (along, aside) = (length / 2.0 + growth_m, width / 2.0 + growth_m);
                // Two rectangles are apart exactly when an axis of one of them parts them.
                let turned = half * (sin.abs() + cos.abs());
                dx.abs() <= half + along * cos.abs() + aside * sin.abs()
                    && dy.abs() <= half + along * sin.abs() + aside * cos.abs()
                    && (dx * cos + dy * sin).abs() <= turned + along
                    && (dy * cos - dx * sin).abs() <= turned + aside
            }
        }
    }
}

fn ground() -> impl Strategy<Value = Ground> {
    prop_oneof![
        (0.0f64..3.0).prop_map(Ground::Disc),
        (0.0f64..5.0, 0.0f64..3.0).prop_map(|(length, width)| Ground::Box(length, width)),
    ]
}

fn pose() -> impl Strategy<Value = (Position, f64)> {
    (495.0f64..535.0, 872.0f64..905.0, -7.0f64..7.0).prop_map(|(x, y, heading)| (Position::new(x, y), heading))
}

fn mode() -> impl Strategy<Value = GridMode> {
    prop_oneof![
        Just(GridMode::Or),
        Just(GridMode::And),
        Just(GridMode::Single),
        Just(GridMode::Exact16)
    ]
}

proptest! {
    #[test]
    fn navigable_ground_is_suitable_ground(
        seed: u64, closed in 0u32..6, size in 0.1f64..1.2, mode in mode(),
        poses in prop::collection::vec((pose(), ground()), 20..40),
    ) {
        let map = drawn(seed, closed);
        let grids = grids(&map, mode, size);
        for ((at, heading), ground) in poses {
            if grids.navigable(at, heading, &ground.footprint()).navigable() {
                for point in ground.points(at, heading) {
                    let cell = map.cells().geometry().cell_at(point);
                    prop_assert!(cell.is_some_and(|cell| map.cells()[cell].rank() >= 6), "{at:?} {ground:?} {point:?}");
                }
            }
        }
    }

    #[test]
    fn a_grid_holds_a_footprint_exactly_when_its_cells_do(
        seed: u64, closed in 0u32..4, size in 0.2f64..1.2, at in pose(), ground in ground(),
    ) {
        let map = drawn(seed, closed);
        let grids = grids(&map, GridMode::Or, size);
        let answer = grids.navigable(at.0, at.1, &ground.footprint());
        let across = grids.params().window_cells as i64;
        for grid in 0..2 {
            let geometry = grids.geometry(grid).unwrap();
            let ranks = grids.ranks(grid).unwrap();
            prop_assume!(geometry.cell_at(at.0).is_some());
            let side = geometry.cell_size_m();
            // Every cell that a footprint grown by a length touches is suitable.
            let all_suit = |growth_m: f64| {
                let cells = (-6..across + 6).flat_map(|row| (-6..across + 6).map(move |column| (row, column)));
                cells.into_iter().all(|(row, column)| {
                    let suits = geometry.checked(row, column).is_some_and(|cell| ranks[geometry.index(cell)] >= 6);
                    let x_m = geometry.west_m() + (column as f64 + 0.5) * side;
                    let y_m = geometry.north_m() - (row as f64 + 0.5) * side;
                    suits || !ground.touches(at.0, at.1, Position::new(x_m, y_m), side / 2.0, growth_m)
                })
            };
            prop_assert!(all_suit(0.0) || !answer.in_grid(grid));
            prop_assert!(!all_suit(1e-5 * side) || answer.in_grid(grid));
        }
    }

    #[test]
    fn more_grids_hold_more_and_agreement_holds_less(
        seed: u64, closed in 0u32..6, size in 0.2f64..1.2,
        poses in prop::collection::vec((pose(), ground()), 20..40),
    ) {
        let map = drawn(seed, closed);
        let [or, and, single, exact] = [GridMode::Or, GridMode::And, GridMode::Single, GridMode::Exact16]
            .map(|mode| grids(&map, mode, size));
        for ((at, heading), ground) in poses {
            let footprint = ground.footprint();
            let [or, and, single, exact] = [&or, &and, &single, &exact].map(|grids| grids.navigable(at, heading, &footprint));
            prop_assert!(or.navigable() || !single.navigable());
            prop_assert!(exact.navigable() || !or.navigable());
            prop_assert!(!and.navigable() || (and.in_grid(0) && and.in_grid(1)));
            prop_assert_eq!(single.navigable(), or.in_grid(0));
            prop_assert_eq!((or.in_grid(0), or.in_grid(1)), (and.in_grid(0), and.in_grid(1)));
            prop_assert_eq!(or.disagreement(), or.in_grid(0) != or.in_grid(1));
            prop_assert!(!single.disagreement());
            prop_assert_eq!(or.speed_factor() < 1.0, or.disagreement());
        }
    }

    #[test]
    fn sixteen_quarter_phases_are_the_opening_by_four_cells(seed: u64, closed in 0u32..8) {
        let map = drawn(seed, closed);
        // A navigation cell measures 4 terrain cells.
        let grids = grids(&map, GridMode::Exact16, 1.0);
        let geometry = map.cells().geometry();
        let suits = |row: i64, column: i64| {
            geometry.checked(row, column).is_some_and(|cell| map.cells()[cell].rank() >= 6)
        };
        let point = Footprint::circle(0.0).unwrap();
        for cell in geometry.cells() {
            let corners = (-3..=0).flat_map(|down| (-3..=0).map(move |right| (cell.row as i64 + down, cell.column as i64 + right)));
            let opened = corners.into_iter().any(|(row, column)| {
                (0..4).all(|down| (0..4).all(|right| suits(row + down, column + right)))
            });
            prop_assert_eq!(grids.navigable(geometry.centre(cell), 0.0, &point).navigable(), opened);
        }
    }

    #[test]
    fn a_window_that_moved_equals_a_new_one(
        seed: u64, size in 0.05f64..2.0, mode in mode(), across in 2usize..14,
        moves in prop::collection::vec((480.0f64..550.0, 860.0f64..920.0), 1..6),
    ) {
        let map = drawn(seed, 4);
        let params = GridsParams { mode, window_cells: across, ..GridsParams::new(size) };
        let mut moved = OverlappingGrids::new(params.clone(), Position::new(515.0, 889.0), &map).unwrap();
        for (x, y) in moves {
            // A long way, and a short step from there.
            for step in [0.0, 0.7] {
                let at = Position::new(x + step, y - step);
                moved.recentre(at, &map).unwrap();
                prop_assert_eq!(&moved, &OverlappingGrids::new(params.clone(), at, &map).unwrap());
            }
        }
    }

    #[test]
    fn refreshed_grids_equal_new_ones(
        seed: u64, size in 0.05f64..2.0, mode in mode(), row in 0usize..24, column in 0usize..30,
        rows in 1usize..9, columns in 1usize..9,
    ) {
        let before = drawn(seed, 3);
        let mut after = before.clone();
        let (row_end, column_end) = ((row + rows).min(24), (column + columns).min(30));
        for row in row..row_end {
            for column in column..column_end {
                after.cells_mut()[Cell::new(row, column)] = drawn(seed ^ 1, 20).cells()[Cell::new(row, column)];
            }
        }
        let mut changed = grids(&before, mode, size);
        changed.refresh(row..row_end, column..column_end, &after).unwrap();
        prop_assert_eq!(changed, grids(&after, mode, size));
    }

    #[test]
    fn joined_nests_are_what_a_robot_can_reach_over_all_grids(seed: u64, closed in 0u32..10, area: bool, thirds: bool) {
        let map = drawn(seed, closed);
        let params = GridsParams {
            reading: if area { SizeReading::Area } else { SizeReading::Side },
            phases: if thirds { product_phases(&[0.0, 1.0 / 3.0]) } else { GridsParams::new(1.0).phases },
            window_cells: 14,
            ..GridsParams::new(if area { 1.1 } else { 0.55 })
        };
        let least_m = params.size_m;
        let grids = OverlappingGrids::new(params, Position::new(515.0, 889.0), &map).unwrap();
        let joined = grids.joined_nests();
        let nodes: Vec<(usize, Cell)> = (0..grids.phases().len())
            .flat_map(|grid| grids.geometry(grid).unwrap().cells().map(move |cell| (grid, cell)))
            .filter(|&(grid, cell)| joined[grid][cell] > 0)
            .collect();
        let linked = |&(a, from): &(usize, Cell), &(b, to): &(usize, Cell)| {
            let [here, there] = [(a, from), (b, to)].map(|(grid, cell)| grids.geometry(grid).unwrap().centre(cell));
            let side = grids.params().cell_size_m();
            let overlap = [here.x_m - there.x_m, here.y_m - there.y_m].map(|apart: f64| side - apart.abs());
            if a == b {
                from.row.abs_diff(to.row) + from.column.abs_diff(to.column) <= 1
            } else {
                overlap.iter().all(|&overlap| overlap >= least_m - 1e-6)
            }
        };
        // Flood from every node that has not been reached yet.
        let mut reached = vec![0u32; nodes.len()];
        let mut count = 0;
        for start in 0..nodes.len() {
            if reached[start] == 0 {
                count += 1;
                reached[start] = count;
                let mut open = vec![start];
                while let Some(node) = open.pop() {
                    for next in 0..nodes.len() {
                        if reached[next] == 0 && linked(&nodes[node], &nodes[next]) {
                            reached[next] = count;
                            open.push(next);
                        }
                    }
                }
            }
        }
        for (node, &(grid, cell)) in nodes.iter().enumerate() {
            prop_assert_eq!(joined[grid][cell], reached[node]);
            prop_assert!(grids.nests(grid).unwrap().label(cell) > 0);
        }
    }
}

#[test]
fn a_cell_has_the_least_rank_that_it_touches_and_none_beyond_the_terrain() {
    let geometry = GridGeometry::new(4, 4, 1.0, 0.0, 4.0).unwrap();
    let ranks = [9, 9, 9, 9, 9, 8, 9, 9, 9, 9, 9, 7, 9, 9, 0, 9];
    let map = RankMap::from_ranks(geometry, &ranks).unwrap();
    let params = GridsParams {
        phases: vec![Phase::new(0.0, 0.0), Phase::new(0.25, 0.0)],
        window_cells: 4,
        // The side is two terrain cells.
        ..GridsParams::new(0.5)
    };
    let grids = OverlappingGrids::new(params, Position::new(2.0, 2.0), &map).unwrap();
    let plain = [0, 0, 0, 0, 0, 8, 9, 0, 0, 9, 0, 0, 0, 0, 0, 0];
    assert_eq!(grids.ranks(0), Some(&plain[..]));
    // Half a terrain cell on, three columns are touched, and the second cell reaches beyond the east edge.
    let moved = [0, 0, 0, 0, 0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    assert_eq!(grids.ranks(1), Some(&moved[..]));
    assert_eq!((grids.ranks(2), grids.geometry(2), grids.nests(2)), (None, None, None));
    assert_eq!(grids.nests(0).unwrap().sizes(), [3]);
    let west = grids.geometry(1).unwrap();
    assert_eq!((west.west_m(), west.north_m(), west.cell_size_m()), (-1.5, 6.0, 2.0));
}

#[test]
fn a_cell_that_ends_on_a_terrain_edge_but_for_rounding_does_not_touch_the_next() {
    // Three terrain cells of 0.1 m make a navigation cell of 0.3 m, in numbers that are not exact. Every second
    // strip of three columns is closed.
    let geometry = GridGeometry::new(30, 30, 0.1, 0.0, 0.0).unwrap();
    let ranks: Vec<u8> = geometry
        .cells()
        .map(|cell| if cell.column / 3 % 2 == 0 { 8 } else { 1 })
        .collect();
    let map = RankMap::from_ranks(geometry, &ranks).unwrap();
    let params = GridsParams {
        window_cells: 10,
        ..GridsParams::new(0.3 / 4.0)
    };
    let grids = OverlappingGrids::new(params, Position::new(1.55, -1.55), &map).unwrap();
    assert_eq!(grids.geometry(0).unwrap().west_m(), 0.0);
    let expected: Vec<u8> = (0..100).map(|cell| if cell % 2 == 0 { 8 } else { 1 }).collect();
    assert_eq!(grids.ranks(0), Some(&expected[..]));
}

#[test]
fn outside_the_window_the_terrain_and_the_numbers_nothing_is_navigable() {
    let geometry = GridGeometry::new(40, 40, 1.0, 0.0, 40.0).unwrap();
    let map = RankMap::new(Layer::filled(geometry, CellRank::ranked(10)));
    let params = GridsParams {
        window_cells: 4,
        ..GridsParams::new(1.0)
    };
    let mut grids = OverlappingGrids::new(params, Position::new(20.0, 20.0), &map).unwrap();
    let says = |grids: &OverlappingGrids, x, y, heading, footprint: Footprint| {
        grids.navigable(Position::new(x, y), heading, &footprint).navigable()
    };
    let (disc, long) = (Footprint::circle(0.5).unwrap(), Footprint::rectangle(1.0, 0.5).unwrap());
    for footprint in [disc, long] {
        assert!(says(&grids, 20.0, 20.0, 0.3, footprint));
        assert!(!says(&grids, 35.0, 20.0, 0.3, footprint), "outside the window");
        assert!(!says(&grids, f64::NAN, 20.0, 0.3, footprint));
        assert!(!says(&grids, 20.0, f64::INFINITY, 0.3, footprint));
    }
    for heading in [f64::NAN, f64::INFINITY] {
        assert!(!says(&grids, 20.0, 20.0, heading, long));
    }
    assert!(!says(&grids, 20.0, 20.0, 0.0, Footprint::circle(1e300).unwrap()));
    // At the edge of the terrain, and far beyond it.
    grids.recentre(Position::new(40.0, 20.0), &map).unwrap();
    assert!(says(&grids, 38.0, 20.0, 0.0, disc) && !says(&grids, 39.8, 20.0, 0.0, disc));
    for far in [1e6, -1e6, 1e300, -1e300] {
        assert_eq!(grids.recentre(Position::new(far, far), &map), Ok(0));
        assert!(!says(&grids, far, far, 0.0, disc));
    }
}

/// Counts how often each terrain cell is asked for.
struct Counted<'a> {
    map: &'a RankMap,
    asked: Vec<AtomicU64>,
}

impl CellSource for Counted<'_> {
    fn geometry(&self) -> GridGeometry {
        self.map.geometry()
    }
    fn cell_rank(&self, cell: Cell) -> CellRank {
        self.asked[self.map.geometry().index(cell)].fetch_add(1, Ordering::Relaxed);
        self.map.cell_rank(cell)
    }
}

#[test]
fn a_move_by_one_column_asks_for_that_column_alone() {
    let geometry = GridGeometry::new(400, 400, 1.0, 0.0, 400.0).unwrap();
    let map = RankMap::new(Layer::filled(geometry, CellRank::ranked(10)));
    let asked = (0..geometry.cell_count()).map(|_| AtomicU64::new(0)).collect();
    let source = Counted { map: &map, asked };
    let params = GridsParams {
        window_cells: 20,
        ..GridsParams::new(2.0)
    };
    let mut grids = OverlappingGrids::new(params, Position::new(204.0, 196.0), &source).unwrap();
    // Twenty cells of eight terrain cells, and a quarter cell of the second grid: each asked once.
    let total: u64 = source.asked.iter().map(|asked| asked.load(Ordering::Relaxed)).sum();
    assert_eq!(total, 162 * 162);
    assert!(source.asked.iter().all(|asked| asked.load(Ordering::Relaxed) <= 1));
    assert_eq!(grids.recentre(Position::new(205.0, 196.0), &source), Ok(0));
    let evaluated = grids.recentre(Position::new(212.0, 196.0), &source).unwrap();
    assert_eq!(evaluated, 162 * 10);
    let after: u64 = source.asked.iter().map(|asked| asked.load(Ordering::Relaxed)).sum();
    assert_eq!(after - total, evaluated);
    let diagonal = grids.recentre(Position::new(220.0, 204.0), &source).unwrap();
    assert!(diagonal <= 162 * 10 * 2);
}

#[test]
fn figures_outside_their_range_and_moved_terrain_are_refused() {
    let map = drawn(1, 2);
    let at = Position::new(515.0, 889.0);
    let good = GridsParams::for_vehicle(&fixtures::pioneer());
    assert!((good.cell_size_m() - 4.0 * 0.51f64.hypot(0.5)).abs() < 1e-12);
    let area = GridsParams {
        reading: SizeReading::Area,
        ..good.clone()
    };
    assert!((area.cell_size_m() - 2.0 * 0.51f64.hypot(0.5)).abs() < 1e-12);
    let wrong = [
        GridsParams {
            size_m: 0.0,
            ..good.clone()
        },
        GridsParams {
            size_m: f64::NAN,
            ..good.clone()
        },
        GridsParams {
            size_m: 1e-5,
            ..good.clone()
        },
        GridsParams {
            size_m: 1e5,
            ..good.clone()
        },
        GridsParams {
            window_cells: 1,
            ..good.clone()
        },
        GridsParams {
            window_cells: 513,
            ..good.clone()
        },
        GridsParams {
            phases: Vec::new(),
            ..good.clone()
        },
        GridsParams {
            phases: vec![Phase::new(0.0, 0.0); 65],
            ..good.clone()
        },
        GridsParams {
            phases: vec![Phase::new(0.0, 1.0)],
            ..good.clone()
        },
        GridsParams {
            phases: vec![Phase::new(f64::NAN, 0.0)],
            ..good.clone()
        },
        GridsParams {
            rank_min: 1,
            ..good.clone()
        },
    ];
    for params in wrong {
        assert!(OverlappingGrids::new(params.clone(), at, &map).is_err(), "{params:?}");
    }
    let mut grids = OverlappingGrids::new(good.clone(), at, &map).unwrap();
    let nowhere = Position::new(f64::NAN, 0.0);
    assert!(OverlappingGrids::new(good, nowhere, &map).is_err() && grids.recentre(nowhere, &map).is_err());
    let elsewhere = GridGeometry::new(24, 30, 1.0, 0.0, 0.0).unwrap();
    let elsewhere = RankMap::new(Layer::filled(elsewhere, CellRank::ranked(10)));
    assert_eq!(grids.recentre(at, &elsewhere), Err(NestError::EvidenceMoved));
    assert_eq!(grids.refresh(0..1, 0..1, &elsewhere), Err(NestError::EvidenceMoved));
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        assert!(Footprint::circle(bad).is_err() && Footprint::rectangle(1.0, bad).is_err());
    }
}

#[test]
fn bytes_that_hold_no_rank_are_unknown_and_reasons_do_not_matter() {
    let geometry = GridGeometry::new(1, 5, 1.0, 0.0, 0.0).unwrap();
    let codes = [0x10, 0x21, 0x07, 0x0f, 0xff];
    let source = RankCodes(LayerView::new(geometry, &codes, "ranks").unwrap());
    let ranks: Vec<u8> = geometry.cells().map(|cell| source.cell_rank(cell).rank()).collect();
    assert_eq!(ranks, [0, 1, 7, 0, 0]);
}
