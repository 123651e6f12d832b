//! Planning and swarms on ground that is read tile by tile: the answers are those of the whole map.

use std::cell::RefCell;
use std::sync::Mutex;

use proptest::prelude::*;

use super::*;
use crate::corridor::ArcKind;
use crate::grid::{Cell, GridGeometry, Layer, TileCells, TileGrid, Tiles};
use crate::nest::{NestParams, Vicinity, exact_nests};
use crate::progress::silent;
use crate::random::{philox, unit};
use crate::rank::{CellSource, RankParams, Ranker, TiledHeights};
use crate::swarm::{Budget, Colony, Ending, Explore, STATISTICAL, StopRule, SwarmParams};
use crate::vehicle::fixtures::pioneer;

/// Hills with some rough patches and voids.
fn hills(rows: usize, columns: usize, seed: u64) -> Layer<f32> {
    let geometry = GridGeometry::new(rows, columns, 10.0, 0.0, 0.0).unwrap();
    let wave = |k: u32| f64::from(philox([k, 1, 0, 0], seed)[0] % 100);
    let heights = geometry.cells().map(|cell| {
        let (r, c) = (cell.row as f64, cell.column as f64);
        let draw = philox([cell.row as u32, cell.column as u32, 3, 0], seed);
        if draw[1].is_multiple_of(997) {
            return f32::NAN;
        }
        let hill = 9.0 * ((r + wave(0)) / 6.0).sin() + 9.0 * ((c + wave(1)) / 5.0).cos();
        (hill + 0.4 * unit(draw[0])) as f32
    });
    Layer::new(geometry, heights.collect(), "z").unwrap()
}

fn part(heights: &Layer<f32>, cells: TileCells) -> Vec<f32> {
    let rows = cells.row..cells.row + cells.rows;
    rows.flat_map(|row| (cells.column..cells.column + cells.columns).map(move |column| heights[Cell::new(row, column)]))
        .collect()
}

fn request(geometry: GridGeometry, from: (usize, usize), to: (usize, usize), seed: u64) -> PlanRequest {
    PlanRequest {
        start: geometry.centre(Cell::new(from.0, from.1)),
        goal: geometry.centre(Cell::new(to.0, to.1)),
        method: Method::Swarm,
        swarm: SwarmParams {
            agents: 64,
            seed,
            ..SwarmParams::default()
        },
        arc: ArcKind::Relaid,
        width_m: None,
        bridge: false,
        certify: false,
        stop: None,
        budget: Budget::default(),
        path: PathKind::default(),
        objective: Objective::default(),
        reversed: false,
        headings_rad: [None; 2],
    }
}

fn solve(heights: &Layer<f32>, request: &PlanRequest) -> Plan {
    let (vehicle, params) = (pioneer(), RankParams::default());
    let ranker = Ranker::new(heights.view(), None, None, None, &vehicle, params).unwrap();
    let terrain = Terrain {
        elevation_m: heights.view(),
        soil: None,
        cost_factor: None,
        map_continues: false,
    };
    plan(terrain, &ranker, &vehicle, &params, request, &mut |_, _, _| true).unwrap()
}

/// Plans on tiles of which at most `most` can be read; returns the tiles read too.
fn solve_in_tiles(
    heights: &Layer<f32>,
    request: &PlanRequest,
    side: usize,
    most: usize,
    fault: SourceFault,
) -> (Result<Plan, PlannerError>, Vec<TileCells>) {
    let (vehicle, params) = (pioneer(), RankParams::default());
    let tiles = Tiles::new(
        TileGrid::new(heights.geometry(), side, (side / 3, 0)).unwrap(),
        f32::NAN,
    );
    let read = Mutex::new(Vec::new());
    let reader = TiledHeights::new(&tiles, |cells| {
        let mut read = read.lock().unwrap();
        if read.len() == most {
            return Err(fault);
        }
        read.push(cells);
        Ok(part(heights, cells))
    });
    let ranker = Ranker::new(reader.elevation_m(), None, None, None, &vehicle, params).unwrap();
    let ranker = ranker.reading(&reader);
    let terrain = Terrain {
        elevation_m: reader.elevation_m(),
        soil: None,
        cost_factor: None,
        map_continues: false,
    };
    let answer = plan(terrain, &ranker, &vehicle, &params, request, &mut |_, _, _| true);
    drop(reader);
    (answer, read.into_inner().unwrap())
}

const BROKEN: SourceFault = SourceFault::Unreadable { row: 0, column: 0 };

fn told(plan: &Plan) -> String {
    format!("{plan:?}")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn a_plan_on_tiles_is_the_plan_on_the_whole_map(
        rows in 20usize..90, columns in 20usize..90, seed: u64, shift in 2u32..6, ends: (u16, u16, u16, u16), line: bool, exact: bool, risk: bool,
        path in prop_oneof![
            Just(PathKind::Grid8), Just(PathKind::Grid16), Just(PathKind::AnyAngle), Just(PathKind::Drivable)
        ],
        rule in prop_oneof![
            Just(StopRule::Good), Just(StopRule::Connected), Just(StopRule::Finished), Just(STATISTICAL)
        ],
    ) {
        let heights = hills(rows, columns, seed);
        let from = (usize::from(ends.0) % rows, usize::from(ends.1) % columns);
        let to = (usize::from(ends.2) % rows, usize::from(ends.3) % columns);
        let mut request = request(heights.geometry(), from, to, seed);
        request.stop = Some(rule);
        request.path = path;
        request.objective.risk = f64::from(u8::from(risk));
        if exact {
            request.method = Method::Exact;
        }
        if line {
            request.arc = ArcKind::Spine;
        }
        let whole = solve(&heights, &request);
        let (tiled, read) = solve_in_tiles(&heights, &request, 1 << shift, usize::MAX, BROKEN);
        let (whole, tiled) = (told(&whole), told(&tiled.unwrap()));
        let same = whole.chars().zip(tiled.chars()).take_while(|(a, b)| a == b).count();
        let from = |told: &str| told.chars().skip(same.saturating_sub(60)).take(120).collect::<String>();
        prop_assert!(whole == tiled, "{} ... {}", from(&whole), from(&tiled));
        for (place, cells) in read.iter().enumerate() {
            prop_assert!(!read[..place].contains(cells), "{:?} was read twice", cells);
        }
    }

    #[test]
    fn a_finished_swarm_on_tiles_has_the_nests_of_the_full_rank_map(
        rows in 5usize..60, columns in 5usize..60, seed: u64, shift in 2u32..6, agents in 1u32..300, wide: bool,
        explore in prop_oneof![Just(Explore::Walk), Just(Explore::Uniform), Just(Explore::Permute)],
    ) {
        let heights = hills(rows, columns, seed);
        let (vehicle, params) = (pioneer(), RankParams::default());
        let vicinity = if wide { Vicinity::Disc(3.0) } else { Vicinity::Moore1 };
        let nest = NestParams { vicinity, ..NestParams::default() };
        let full = Ranker::new(heights.view(), None, None, None, &vehicle, params).unwrap().rank_all();
        let tiles = Tiles::new(TileGrid::new(heights.geometry(), 1 << shift, (0, 1)).unwrap(), f32::NAN);
        let reader = TiledHeights::new(&tiles, |cells| Ok(part(&heights, cells)));
        let ranker = Ranker::new(reader.elevation_m(), None, None, None, &vehicle, params).unwrap().reading(&reader);
        let everywhere = Layer::filled(heights.geometry(), true);
        let params = SwarmParams { agents, nest, explore, seed, ..SwarmParams::default() };
        let mut colony = Colony::deploy(&ranker, &everywhere, params).unwrap();
        prop_assert_eq!(colony.run(10_000_000, &mut silent()), Ending::Finished);
        prop_assert_eq!(colony.nests().unwrap(), exact_nests(&full, None, &nest).unwrap());
        for cell in heights.geometry().cells().filter(|&cell| colony.is_evaluated(cell)) {
            prop_assert_eq!(ranker.cell_rank(cell), full.cell_rank(cell));
        }
    }

    #[test]
    fn ground_that_cannot_be_read_leaves_a_valid_route_or_says_so_and_keeps_the_nests(
        seed: u64, most in 0usize..40, stopped: bool,
    ) {
        let heights = hills(60, 80, seed);
        let request = request(heights.geometry(), (5, 5), (52, 70), seed);
        let whole = solve(&heights, &request);
        let fault = if stopped { SourceFault::Stopped } else { SourceFault::Unreadable { row: 3, column: 4 } };
        let (answer, read) = solve_in_tiles(&heights, &request, 8, most, fault);
        prop_assert!(read.len() <= most);
        match answer {
            Err(error) => prop_assert!(stopped, "{error}"),
            Ok(answer) if answer.fault().is_none() => prop_assert_eq!(told(&answer), told(&whole)),
            Ok(answer) => {
                prop_assert!(!stopped);
                prop_assert_eq!(answer.fault(), Some(fault));
                let full = Ranker::new(heights.view(), None, None, None, &pioneer(), RankParams::default()).unwrap().rank_all();
                let oracle = exact_nests(&full, None, &request.swarm.nest).unwrap();
                let nests = answer.nests.as_ref().unwrap();
                for cell in heights.geometry().cells() {
                    prop_assert!(nests.label(cell) == 0 || oracle.label(cell) > 0);
                }
                match &answer.answer {
                    Ok(_) => prop_assert!(answer.path.iter().all(|&cell| nests.label(cell) > 0)),
                    Err(refusal) => prop_assert_eq!(refusal.status, Status::Unread),
                }
            }
        }
    }
}

#[test]
fn only_the_tiles_along_the_way_are_read() {
    let heights = hills(400, 400, 5);
    let request = request(heights.geometry(), (40, 40), (40, 340), 1);
    let (answer, read) = solve_in_tiles(&heights, &request, 16, usize::MAX, BROKEN);
    assert!(answer.unwrap().answer.is_ok());
    let all = 26 * 25;
    assert!(read.len() > 19 && read.len() < all / 3, "{} of {all}", read.len());
}

#[test]
fn a_part_of_a_map_without_a_way_is_not_read_to_its_end() {
    let mut heights = hills(200, 200, 5);
    let geometry = heights.geometry();
    for row in 0..200 {
        for column in 95..105 {
            heights[Cell::new(row, column)] = f32::NAN;
        }
    }
    let request = request(geometry, (100, 60), (100, 140), 1);
    let (vehicle, params) = (pioneer(), RankParams::default());
    let tiles = Tiles::new(TileGrid::new(geometry, 16, (0, 0)).unwrap(), f32::NAN);
    let count = Mutex::new(RefCell::new(0));
    let reader = TiledHeights::new(&tiles, |cells| {
        *count.lock().unwrap().get_mut() += 1;
        Ok(part(&heights, cells))
    });
    let ranker = Ranker::new(reader.elevation_m(), None, None, None, &vehicle, params).unwrap();
    let ranker = ranker.reading(&reader);
    for (map_continues, all) in [(true, false), (false, true)] {
        let terrain = Terrain {
            elevation_m: reader.elevation_m(),
            soil: None,
            cost_factor: None,
            map_continues,
        };
        let answer = plan(terrain, &ranker, &vehicle, &params, &request, &mut |_, _, _| true).unwrap();
        assert_eq!(answer.answer.unwrap_err().status, Status::NoRoute);
        assert_eq!(tiles.read_count() == tiles.grid().count(), all);
    }
}
