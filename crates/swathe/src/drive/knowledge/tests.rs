//! Laws of what the drive learns: whatever comes, in whatever order, equals what is made of the same belief from nothing.

use proptest::prelude::*;

use super::*;
use crate::belief::{BeliefParams, CLASSES, Extent, Prior, Rule, Unit, Word};
use crate::corridor::ArcKind;
use crate::grid::GridGeometry;
use crate::nest::{Vicinity, exact_nests};
use crate::planner::{Method, Objective, PathKind, PlanRequest, Terrain, plan};
use crate::random::{philox, unit};
use crate::rank::RankMap;
use crate::swarm::{Budget, SwarmParams};
use crate::vehicle::fixtures::tractor;

const CELL_M: f64 = 10.0;

/// Wet enough for clay and silt not to carry the tractor.
const WET: f64 = 45.0;

fn class_of(letter: char) -> SoilClass {
    match letter {
        'g' => SoilClass::Gravel,
        's' => SoilClass::Sand,
        'c' => SoilClass::Clay,
        'i' => SoilClass::Silt,
        'r' => SoilClass::Rock,
        'n' => SoilClass::None,
        _ => SoilClass::Unknown,
    }
}

/// Level ground whose soil is drawn as text, one polygon a letter.
fn drawn(rows: &[&str]) -> Knowledge {
    let geometry = GridGeometry::new(rows.len(), rows[0].len(), CELL_M, 0.0, rows.len() as f64 * CELL_M).unwrap();
    let letters: Vec<char> = rows.iter().flat_map(|row| row.chars()).collect();
    let codes = letters.iter().map(|&letter| class_of(letter) as u8).collect();
    let numbers = letters.iter().map(|&letter| class_of(letter) as u32).collect();
    let soil = Layer::new(geometry, codes, "the soil").unwrap();
    let layer = Layer::new(geometry, numbers, "the polygons").unwrap();
    made(Layer::filled(geometry, 0.0), soil, &layer, BeliefParams::default())
}

fn map_of(elevation_m: Layer<f32>, soil: Layer<u8>) -> KnownMap {
    KnownMap {
        elevation_m,
        soil: Some(soil),
        grey: None,
        zones: None,
        vehicle: tractor(),
        rank: RankParams {
            moisture_percent: WET,
            ..RankParams::default()
        },
        nest: NestParams::default(),
        explains_returns: false,
    }
}

fn made(elevation_m: Layer<f32>, soil: Layer<u8>, layer: &Layer<u32>, params: BeliefParams) -> Knowledge {
    let mut ids: Vec<(u32, u8)> = layer.data().iter().copied().zip(soil.data().iter().copied()).collect();
    ids.sort_unstable();
    ids.dedup_by_key(|pair| pair.0);
    let units: Vec<Unit> = ids
        .into_iter()
        .filter(|&(id, _)| id > 0)
        .map(|(id, code)| Unit {
            id,
            symbol: u32::from(code),
            prior: Prior::Class(SoilClass::from_code(code).unwrap()),
        })
        .collect();
    let belief = SoilBelief::new(layer, &units, params).unwrap();
    Knowledge::new(map_of(elevation_m, soil), belief).unwrap()
}

const SIDE: usize = 22;

/// Hills and patches of soil, in polygons of five by five cells.
fn strewn(seed: u64, params: BeliefParams) -> Knowledge {
    let geometry = GridGeometry::new(SIDE, SIDE, CELL_M, 0.0, SIDE as f64 * CELL_M).unwrap();
    let height = |cell: Cell| {
        let wave = |a: u32| 6.0 * unit(philox([a, 1, 0, 0], seed)[0]);
        let (x, y) = (cell.column as f64 / 5.0, cell.row as f64 / 5.0);
        (wave(0) * (x + wave(1)).sin() + wave(2) * (y + wave(3)).sin()) as f32
    };
    let number = |cell: Cell| (cell.row / 5 * 5 + cell.column / 5 + 1) as u32;
    let code = |cell: Cell| {
        let draw = philox([number(cell), 2, 0, 0], seed)[0] % 16;
        [1, 2, 2, 2, 2, 2, 2, 2, 1, 1, 3, 4, 5, 6, 0, 2][draw as usize]
    };
    let elevation_m = Layer::new(geometry, geometry.cells().map(height).collect(), "z").unwrap();
    let soil = Layer::new(geometry, geometry.cells().map(code).collect(), "soil").unwrap();
    let layer = Layer::new(geometry, geometry.cells().map(number).collect(), "polygons").unwrap();
    made(elevation_m, soil, &layer, params)
}

fn reading(x_m: f64, y_m: f64, kpa: f64) -> PenetrometerReading {
    PenetrometerReading {
        x_m,
        y_m,
        depths_m: vec![0.05, 0.10, 0.15],
        cone_indices_kpa: vec![0.8 * kpa, kpa, 1.2 * kpa],
        refusal_depth_m: None,
        sleeve_frictions_kpa: None,
    }
}

fn update(time_s: f64, extent: Extent, word: Word) -> SoilUpdate {
    SoilUpdate {
        time_s,
        source: "a scout".to_owned(),
        extent,
        word,
        cone_index_kpa: None,
    }
}

#[derive(Clone, Debug)]
enum News {
    Reading(PenetrometerReading),
    Update(SoilUpdate),
}

fn news() -> impl Strategy<Value = News> {
    let place = || (0.0..SIDE as f64 * CELL_M, 0.0..SIDE as f64 * CELL_M);
    let pushed = (place(), 3.0f64..9.0).prop_map(|((x, y), ln)| News::Reading(reading(x, y, ln.exp())));
    let extent = prop_oneof![
        (1u32..26).prop_map(Extent::Unit),
        (place(), 0.0f64..45.0).prop_map(|((x, y), radius_m)| Extent::Disc {
            at: Position::new(x, y),
            radius_m
        }),
        prop::collection::vec((0..SIDE, 0..SIDE), 1..6)
            .prop_map(|cells| Extent::Cells(cells.into_iter().map(|(row, column)| Cell::new(row, column)).collect())),
    ];
    let word = prop_oneof![
        (0usize..6).prop_map(|k| Word::Class(CLASSES[k])),
        (0usize..6, 0usize..6, 0.0f64..1.0).prop_map(|(a, b, share)| {
            let mut shares = [0.0; 6];
            shares[a] += share;
            shares[b] += 1.0 - share;
            Word::Probabilities(shares)
        }),
    ];
    let told = (0u32..4, extent, word, prop::option::of(10.0f64..2000.0)).prop_map(|(time, extent, word, kpa)| {
        News::Update(SoilUpdate {
            cone_index_kpa: kpa,
            ..update(f64::from(time), extent, word)
        })
    });
    prop_oneof![pushed, told]
}

fn rules() -> impl Strategy<Value = BeliefParams> {
    let rule = prop_oneof![
        Just(Rule::Bayes),
        Just(Rule::PaperRelabel { radius_m: None }),
        Just(Rule::PaperRelabel { radius_m: Some(25.0) })
    ];
    rule.prop_map(|rule| BeliefParams {
        rule,
        ..BeliefParams::default()
    })
}

fn tell(knowledge: &mut Knowledge, news: &News, at: Position) -> Learnt {
    match news {
        News::Reading(reading) => knowledge.learn(reading, at).unwrap(),
        News::Update(update) => knowledge.learn_soil(update, at).unwrap(),
    }
}

/// Everything that follows from a belief, to be compared.
fn shown(knowledge: &Knowledge) -> (Vec<u8>, Vec<u8>, Vec<u32>, Option<u64>, Standing) {
    (
        knowledge.codes().data().to_vec(),
        knowledge.ranks().data().to_vec(),
        knowledge.nests().unwrap().labels().data().to_vec(),
        knowledge.route_cost().map(f64::to_bits),
        knowledge.standing(),
    )
}

fn ends(geometry: GridGeometry, draw: [(usize, usize); 2]) -> [Position; 2] {
    draw.map(|(row, column)| geometry.centre(Cell::new(row, column)))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn whatever_is_learnt_equals_a_fresh_start_with_the_same_belief(
        seed: u64, params in rules(), told in prop::collection::vec((news(), (0..SIDE, 0..SIDE)), 1..7), goal in (0..SIDE, 0..SIDE),
        outside: bool,
    ) {
        let mut knowledge = strewn(seed, params).with_outside(outside);
        let geometry = knowledge.geometry();
        let [first, goal] = ends(geometry, [told[0].1, goal]);
        knowledge.lay(first, goal);
        for (news, at) in &told {
            let at = geometry.centre(Cell::new(at.0, at.1));
            let before = knowledge.ranks().clone();
            let learnt = tell(&mut knowledge, news, at);
            let changed = before.data().iter().zip(knowledge.ranks().data()).filter(|(a, b)| a != b).count();
            prop_assert_eq!(learnt.ranks.len(), changed);
            let mut fresh = Knowledge::new(knowledge.map().clone(), knowledge.belief().clone()).unwrap().with_outside(outside);
            fresh.lay(at, goal);
            prop_assert_eq!(shown(&knowledge), shown(&fresh));
            // And the nests are those of the exact pass.
            let ranks = RankMap::from_ranks(geometry, knowledge.ranks().data()).unwrap();
            let exact = exact_nests(&ranks, None, &knowledge.map().nest).unwrap();
            for cell in geometry.cells() {
                prop_assert_eq!(knowledge.in_nest(cell), exact.label(cell) > 0);
            }
        }
    }

    #[test]
    fn the_order_of_news_does_not_matter(
        seed: u64, params in rules(), told in prop::collection::vec(news(), 2..6), turn in 0usize..6, ends_at in [(0..SIDE, 0..SIDE), (0..SIDE, 0..SIDE)],
    ) {
        let mut turned = told.clone();
        turned.rotate_left(turn % told.len());
        turned.reverse();
        let both = [told, turned].map(|told| {
            let mut knowledge = strewn(seed, params.clone());
            let [at, goal] = ends(knowledge.geometry(), ends_at);
            knowledge.lay(at, goal);
            for news in &told {
                tell(&mut knowledge, news, at);
            }
            shown(&knowledge)
        });
        prop_assert_eq!(&both[0], &both[1]);
    }

    #[test]
    fn without_news_ranks_nests_and_route_are_the_plans(seed: u64, params in rules(), ends_at in [(0..SIDE, 0..SIDE), (0..SIDE, 0..SIDE)]) {
        let mut knowledge = strewn(seed, params).with_outside(false);
        let geometry = knowledge.geometry();
        let [start, goal] = ends(geometry, ends_at);
        knowledge.lay(start, goal);
        let map = knowledge.map();
        let ranker = ranker(map, map.soil.as_ref().unwrap()).unwrap();
        let planned: Vec<u8> = ranker.rank_all().cells().data().iter().map(|rank| rank.rank()).collect();
        prop_assert_eq!(knowledge.ranks().data(), &planned[..]);
        let terrain = Terrain {
            elevation_m: map.elevation_m.view(), soil: map.soil.as_ref().map(Layer::view), cost_factor: None, map_continues: false,
        };
        let request = PlanRequest {
            start, goal, method: Method::Exact, swarm: SwarmParams::default(), arc: ArcKind::Line, width_m: None,
            path: PathKind::Grid16, headings_rad: [None; 2], bridge: false, certify: false, objective: Objective::default(),
            reversed: false, stop: None, budget: Budget::default(),
        };
        let answer = plan(terrain, &ranker, &map.vehicle, &map.rank, &request, &mut |_, _, _| true).unwrap();
        let inside = |at: Position| geometry.cell_at(at).is_some_and(|cell| knowledge.in_nest(cell));
        // Where its ends lie in two nests, the plan may set out from a nest close by instead; the drive never does.
        let moved = answer.start.is_some() || answer.goal.is_some();
        if inside(start) && inside(goal) && !moved {
            match (answer.path_cost, knowledge.route_cost()) {
                (Some(a), Some(b)) => prop_assert!((a - b).abs() <= 1e-9 * a, "{} {}", a, b),
                (None, None) => prop_assert_eq!(knowledge.standing(), Standing::CutOff),
                (a, b) => prop_assert!(false, "{:?} {:?}", a, b),
            }
        }
    }

    #[test]
    fn weighing_a_reading_changes_nothing(seed: u64, told in prop::collection::vec(news(), 0..3), ends_at in [(0..SIDE, 0..SIDE), (0..SIDE, 0..SIDE)]) {
        let mut knowledge = strewn(seed, BeliefParams::default());
        let [at, goal] = ends(knowledge.geometry(), ends_at);
        knowledge.lay(at, goal);
        for news in &told {
            tell(&mut knowledge, news, at);
        }
        let (before, route) = (shown(&knowledge), knowledge.route().to_vec());
        for site in knowledge.probe_sites(at, &route, 40.0, 120.0) {
            let mut outlook = knowledge.outlook(site, &route);
            while !outlook.is_done() {
                knowledge.weigh(&mut outlook, 100.0);
            }
            prop_assert!(outlook.saving >= 0.0 && outlook.saving.is_finite());
        }
        prop_assert_eq!(shown(&knowledge), before);
        prop_assert_eq!(knowledge.route(), &route[..]);
    }
}

/// A band of sand across, clay beside it, and a longer way over gravel.
const FORK: [&str; 12] = [
    "gggggggggggggggggggg",
    "gggggggggggggggggggg",
    "gggggggggggggggggggg",
    "gggggggggggggggggggg",
    "ggggnnnnnnnnnnnngggg",
    "ggggnnnnnnnnnnnngggg",
    "ggggssssssssssssgggg",
    "ggggssssssssssssgggg",
    "ggggssssssssssssgggg",
    "ggggssssssssssssgggg",
    "ggggnnnnnnnnnnnngggg",
    "nnnnnnnnnnnnnnnnnnnn",
];

fn fork() -> (Knowledge, Position, Position) {
    let mut knowledge = drawn(&FORK);
    let [at, goal] = ends(knowledge.geometry(), [(7, 1), (7, 18)]);
    knowledge.lay(at, goal);
    (knowledge, at, goal)
}

#[test]
fn soft_ground_that_is_measured_closes_its_polygon_and_turns_the_route() {
    let (mut knowledge, at, _) = fork();
    let straight = knowledge.route_cost().unwrap();
    assert!(knowledge.route().iter().all(|place| (place.y_m - at.y_m).abs() < 15.0));
    // Three pushes that sink in: the sand of the map is soft silt.
    for x in [60.0, 80.0, 100.0] {
        knowledge.learn(&reading(x, 45.0, 20.0), at).unwrap();
    }
    let middle = Cell::new(7, 9);
    assert_eq!(knowledge.ranks()[middle], 1);
    assert!(!knowledge.in_nest(middle));
    assert_eq!(knowledge.standing(), Standing::InNests);
    assert!(knowledge.route_cost().unwrap() > straight + 1.0);
    assert!(knowledge.route().iter().any(|place| place.y_m > 80.0));
}

#[test]
fn a_robot_that_readings_alone_cut_off_goes_over_the_least_doubtful_ground() {
    // One way across; a soft reading at its near end closes all of it, though its far end was never looked at.
    let rows = [
        "gggnnnnnnggg",
        "gggssssssggg",
        "gggssssssggg",
        "gggssssssggg",
        "gggnnnnnnggg",
    ];
    let mut knowledge = drawn(&rows);
    let [at, goal] = ends(knowledge.geometry(), [(2, 1), (2, 10)]);
    assert_eq!(knowledge.lay(at, goal).standing, Standing::InNests);
    knowledge.learn(&reading(55.0, 41.0, 60.0), at).unwrap();
    let no_go = |knowledge: &Knowledge, cell| {
        let (_, chance) = knowledge.soil_at(knowledge.geometry().centre(cell)).unwrap();
        chance
    };
    assert_eq!(knowledge.ranks()[Cell::new(0, 5)], 1);
    assert!(knowledge.route_cost().is_some(), "{:?}", knowledge.standing());
    for &cell in knowledge.route_cells() {
        assert!(no_go(&knowledge, cell) < 0.5, "{cell:?}");
    }
    // A reading that says better brings the usual caution back.
    knowledge.learn(&reading(55.0, 15.0, 2500.0), at).unwrap();
    let mut fresh = Knowledge::new(knowledge.map().clone(), knowledge.belief().clone()).unwrap();
    fresh.lay(at, goal);
    assert_eq!(shown(&knowledge), shown(&fresh));
    // What is told of all of it holds.
    let sand = Extent::Unit(SoilClass::Sand as u32);
    knowledge
        .learn_soil(&update(1.0, sand, Word::Class(SoilClass::None)), at)
        .unwrap();
    assert_eq!(knowledge.standing(), Standing::CutOff);
}

#[test]
fn the_first_ground_of_another_polygon_is_a_site() {
    let (knowledge, at, _) = fork();
    let way = knowledge.route().to_vec();
    let sites = knowledge.probe_sites(at, &way, 30.0, 120.0);
    // Sand begins at 40 m.
    assert!(
        sites.iter().any(|site| (40.0..41.5).contains(&site.at.x_m)),
        "{sites:?}"
    );
}

#[test]
fn a_reading_that_agrees_with_the_map_changes_no_rank() {
    let (mut knowledge, at, _) = fork();
    let before = shown(&knowledge);
    let soil = knowledge.belief().params().types.0[1];
    let usual_kpa = soil.cone_index_ln_kpa.mean.exp();
    let learnt = knowledge.learn(&reading(80.0, 45.0, usual_kpa), at).unwrap();
    assert!(learnt.probabilities[1] > 0.75, "{:?}", learnt.probabilities);
    assert_eq!(learnt.ranks, Vec::new());
    assert_eq!(shown(&knowledge), before);
}

#[test]
fn news_of_an_area_close_it_and_later_news_open_it_again() {
    let (mut knowledge, at, _) = fork();
    let before = shown(&knowledge);
    let sand = Extent::Unit(SoilClass::Sand as u32);
    let flood = update(10.0, sand.clone(), Word::Class(SoilClass::None));
    let learnt = knowledge.learn_soil(&flood, at).unwrap();
    assert_eq!(learnt.ranks.len(), 48);
    assert!(learnt.nest_cells.1 >= 48 && learnt.nest_count == Some(1));
    assert!(learnt.route.is_other && learnt.route.cost_after > learnt.route.cost_before);
    let dry = update(20.0, sand, Word::Class(SoilClass::Sand));
    knowledge.learn_soil(&dry, at).unwrap();
    assert_eq!(shown(&knowledge), before);
}

#[test]
fn a_chance_of_no_ground_above_the_tolerance_is_no_go() {
    let (mut knowledge, at, _) = fork();
    let word = |none: f64| Word::Probabilities([0.0, 1.0 - none, 0.0, 0.0, 0.0, none]);
    let cells = || Extent::Cells(vec![Cell::new(7, 9)]);
    knowledge.learn_soil(&update(1.0, cells(), word(0.04)), at).unwrap();
    assert_ne!(knowledge.ranks()[Cell::new(7, 9)], 1);
    knowledge.learn_soil(&update(2.0, cells(), word(0.06)), at).unwrap();
    assert_eq!(knowledge.ranks()[Cell::new(7, 9)], 1);
    let (_, no_go) = knowledge.soil_at(knowledge.geometry().centre(Cell::new(7, 9))).unwrap();
    approx::assert_relative_eq!(no_go, 0.06, epsilon = 1e-9);
}

#[test]
fn a_robot_that_is_cut_off_is_told() {
    let (mut knowledge, at, _) = fork();
    for extent in [SoilClass::Sand as u32, SoilClass::Gravel as u32].map(Extent::Unit) {
        knowledge
            .learn_soil(&update(1.0, extent, Word::Class(SoilClass::None)), at)
            .unwrap();
    }
    assert_eq!(knowledge.standing(), Standing::CutOff);
    assert!(knowledge.route().is_empty() && knowledge.route_cost().is_none());
}

#[test]
fn ground_outside_the_nests_is_crossed_only_where_that_is_allowed() {
    // A band one cell wide is no nest of 3 x 3 cells, but carries.
    let rows = [
        "ggggnnnngggg",
        "ggggnnnngggg",
        "gggggggggggg",
        "ggggnnnngggg",
        "ggggnnnngggg",
    ];
    let mut knowledge = drawn(&rows);
    let [at, goal] = ends(knowledge.geometry(), [(2, 1), (2, 10)]);
    assert_eq!(knowledge.lay(at, goal).standing, Standing::Outside);
    assert_eq!(knowledge.with_outside(false).lay(at, goal).standing, Standing::CutOff);
}

#[test]
fn a_reading_is_worth_most_where_the_way_depends_on_it() {
    let (mut knowledge, at, goal) = fork();
    let worth = |knowledge: &mut Knowledge, row: usize, column: usize| {
        let cell = Cell::new(row, column);
        let at = knowledge.geometry().centre(cell);
        let mut outlook = knowledge.outlook(ProbeSite { cell, at }, &[]);
        while !outlook.is_done() {
            knowledge.weigh(&mut outlook, 100.0);
        }
        outlook.saving
    };
    // On the sand that the way crosses; not in the gravel that nobody doubts, nor on water.
    let (on_sand, on_water) = (worth(&mut knowledge, 7, 6), worth(&mut knowledge, 11, 10));
    assert!(on_sand > 1.0 && on_sand > 5.0 * on_water, "{on_sand} {on_water}");
    // Go or no-go counts: a vehicle that any soil carries has less to learn, but for what is no ground at all.
    let mut map = knowledge.map().clone();
    map.vehicle.measured_cone_index_kpa = Some(1.0);
    let mut light = Knowledge::new(map, knowledge.belief().clone()).unwrap();
    light.lay(at, goal);
    let for_light = worth(&mut light, 7, 6);
    assert!(for_light < on_sand, "{for_light} {on_sand}");
}

#[test]
fn the_vicinity_of_nests_may_be_another() {
    let (knowledge, at, goal) = fork();
    let mut map = knowledge.map().clone();
    map.nest.vicinity = Vicinity::Disc(2.0);
    let mut wide = Knowledge::new(map, knowledge.belief().clone()).unwrap();
    wide.lay(at, goal);
    wide.learn_soil(&update(1.0, Extent::Unit(2), Word::Class(SoilClass::None)), at)
        .unwrap();
    let mut fresh = Knowledge::new(wide.map().clone(), wide.belief().clone()).unwrap();
    fresh.lay(at, goal);
    assert_eq!(shown(&wide), shown(&fresh));
}

#[test]
fn what_cannot_be_changes_nothing() {
    let (mut knowledge, at, _) = fork();
    let before = shown(&knowledge);
    assert!(knowledge.learn(&reading(-5.0, 45.0, 100.0), at).is_err());
    assert!(knowledge.learn(&reading(50.0, 45.0, f64::NAN), at).is_err());
    let class = Word::Class(SoilClass::None);
    let disc = |radius_m| Extent::Disc { at, radius_m };
    for wrong in [
        update(f64::NAN, disc(1.0), class),
        update(0.0, disc(-1.0), class),
        update(0.0, disc(f64::INFINITY), class),
        update(0.0, Extent::Unit(77), class),
        update(0.0, Extent::Unit(0), class),
        update(0.0, Extent::Cells(Vec::new()), class),
        update(0.0, Extent::Cells(vec![Cell::new(0, 99)]), class),
        update(0.0, disc(1.0), Word::Class(SoilClass::Unknown)),
        update(0.0, disc(1.0), Word::Probabilities([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])),
        update(0.0, disc(1.0), Word::Probabilities([f64::NAN, 1.0, 0.0, 0.0, 0.0, 0.0])),
    ] {
        assert!(knowledge.learn_soil(&wrong, at).is_err(), "{wrong:?}");
    }
    assert_eq!(shown(&knowledge), before);
}
