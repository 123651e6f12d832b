//! Colonies against the exact nests.

use super::*;
use crate::nest::{Contact, NestParams, Vicinity, exact_nests};
use crate::progress::silent;
use crate::random::philox;
use crate::rank::RankMap;
use crate::swarm::Explore;
use proptest::prelude::*;

fn world(rows: usize, columns: usize, seed: u64, holes: u32) -> RankMap {
    let geometry = GridGeometry::new(rows, columns, 1.0, 0.0, 0.0).unwrap();
    let ranks: Vec<u8> = (0..rows * columns)
        .map(|i| {
            let hole = philox([i as u32, 7, 0, 0], seed)[0] % 100 < holes;
            if hole { 4 } else { 8 }
        })
        .collect();
    RankMap::from_ranks(geometry, &ranks).unwrap()
}

fn everywhere(map: &RankMap) -> Layer<bool> {
    Layer::filled(map.cells().geometry(), true)
}

fn contacts() -> impl Strategy<Value = Contact> {
    prop_oneof![Just(Contact::Overlap), Just(Contact::Edge), Just(Contact::Corner)]
}

fn explorations() -> impl Strategy<Value = Explore> {
    prop_oneof![Just(Explore::Walk), Just(Explore::Uniform), Just(Explore::Permute)]
}

fn vicinities() -> impl Strategy<Value = Vicinity> {
    prop_oneof![
        Just(Vicinity::Cell),
        Just(Vicinity::VonNeumann1),
        Just(Vicinity::Moore1),
        Just(Vicinity::Disc(2.0))
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn the_limit_is_the_oracle_and_every_tick_is_inside_it(
        rows in 1usize..20, columns in 1usize..20, seed: u64, holes in 0u32..25, agents in 1u32..40,
        pellet_max in 1u8..4, contact in contacts(), explore in explorations(), vicinity in vicinities(),
        half: bool, border_suitable: bool,
    ) {
        let map = world(rows, columns, seed, holes);
        let mut inside = everywhere(&map);
        if half {
            for (i, cell) in inside.data_mut().iter_mut().enumerate() {
                *cell = i % columns <= columns / 2;
            }
        }
        let nest = NestParams { vicinity, contact, border_suitable, ..NestParams::default() };
        let params = SwarmParams { agents, pellet_max, nest, explore, seed, ..SwarmParams::default() };
        let oracle = exact_nests(&map, Some(&inside), &nest).unwrap();
        let mut colony = Colony::deploy(&map, &inside, params).unwrap();
        for _ in 0..3 {
            colony.run(3, &mut silent());
            let nests = colony.nests().unwrap();
            for cell in map.cells().geometry().cells() {
                prop_assert!(nests.label(cell) == 0 || oracle.label(cell) > 0);
            }
        }
        prop_assert_eq!(colony.run(1_000_000, &mut silent()), Ending::Finished);
        prop_assert_eq!(colony.nests().unwrap(), oracle);
        prop_assert!(colony.tally().cells_evaluated <= inside.data().iter().filter(|i| **i).count() as u64);
    }

    #[test]
    fn widening_ends_where_a_fresh_start_ends_and_evaluates_nothing_twice(
        seed: u64, holes in 0u32..20, cut in 1usize..18,
    ) {
        let map = world(12, 18, seed, holes);
        let mut narrow = everywhere(&map);
        for (i, cell) in narrow.data_mut().iter_mut().enumerate() {
            *cell = i % 18 < cut;
        }
        let params = SwarmParams { agents: 20, seed, ..SwarmParams::default() };
        let mut colony = Colony::deploy(&map, &narrow, params).unwrap();
        colony.run(1_000_000, &mut silent());
        colony.widen(&everywhere(&map)).unwrap();
        colony.run(1_000_000, &mut silent());
        prop_assert_eq!(colony.nests().unwrap(), exact_nests(&map, None, &params.nest).unwrap());
        prop_assert!(colony.tally().cells_evaluated <= 12 * 18);
    }
}

#[test]
fn a_permutation_finishes_in_as_many_epochs_as_pellets() {
    let map = world(30, 30, 5, 5);
    for pellet_max in 1..=3 {
        let params = SwarmParams {
            agents: 100,
            pellet_max,
            explore: Explore::Permute,
            ..SwarmParams::default()
        };
        let mut colony = Colony::deploy(&map, &everywhere(&map), params).unwrap();
        assert_eq!(colony.run(9 * u64::from(pellet_max), &mut silent()), Ending::Finished);
    }
}

#[test]
fn a_hopeless_or_empty_swathe_is_finished_at_once_or_soon() {
    let map = world(5, 5, 0, 100);
    let params = SwarmParams::default();
    let mut colony = Colony::deploy(&map, &everywhere(&map), params).unwrap();
    assert_eq!(colony.run(10_000, &mut silent()), Ending::Finished);
    assert_eq!(colony.nests().unwrap().count(), 0);
    let nowhere = Layer::filled(map.cells().geometry(), false);
    let mut colony = Colony::deploy(&map, &nowhere, params).unwrap();
    assert_eq!(colony.run(1, &mut silent()), Ending::Finished);
    assert_eq!(colony.tally().visits, 0);
}

#[test]
fn watching_notes_when_two_cells_connect_and_a_report_can_stop() {
    let map = world(30, 30, 1, 0);
    let params = SwarmParams {
        agents: 3,
        ..SwarmParams::default()
    };
    let mut colony = Colony::deploy(&map, &everywhere(&map), params).unwrap();
    colony.watch(Cell::new(0, 0), Cell::new(29, 29));
    assert_eq!(colony.run(1000, &mut |_, _| false), Ending::Stopped);
    assert_eq!(colony.tally().connected_at, None);
    colony.run(1_000_000, &mut silent());
    let at = colony.tally().connected_at.unwrap();
    assert!(0 < at && at <= colony.tally().ticks);
}

/// FNV-1a of everything that a run leaves behind.
fn checksum(params: SwarmParams, ticks: u64) -> u64 {
    let map = world(90, 70, 3, 6);
    let mut inside = everywhere(&map);
    for (i, cell) in inside.data_mut().iter_mut().enumerate() {
        *cell = i % 70 + i / 70 > 20;
    }
    let mut colony = Colony::deploy(&map, &inside, params).unwrap();
    colony.run(ticks, &mut silent());
    let tally = colony.tally();
    let cells = map.cells().geometry().cells();
    let pellets = cells.map(|cell| u64::from(colony.pellets(cell)));
    let agents = colony.agents().map(|cell| (cell.row * 70 + cell.column) as u64);
    let counts = [tally.ticks, tally.visits, tally.cells_evaluated, tally.cores];
    let numbers = pellets.chain(agents).chain(counts).collect::<Vec<_>>();
    let nests = colony.nests().unwrap();
    let labels = nests.labels().data().iter().map(|&label| u64::from(label));
    let bytes = numbers.into_iter().chain(labels).flat_map(u64::to_le_bytes);
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

#[test]
fn the_same_seed_leaves_the_same_bytes_as_ever() {
    let with = |explore, pellet_max, attract, agents, contact| SwarmParams {
        explore,
        pellet_max,
        attract,
        agents,
        nest: NestParams {
            contact,
            ..NestParams::default()
        },
        seed: 0x1234_5678_9abc,
        ..SwarmParams::default()
    };
    let found = [
        checksum(with(Explore::Walk, 1, 0.0, 40, Contact::Edge), 60),
        checksum(with(Explore::Walk, 3, 0.0, 5000, Contact::Corner), 5),
        checksum(with(Explore::Walk, 2, 2.5, 300, Contact::Overlap), 25),
        checksum(with(Explore::Uniform, 2, 0.0, 100, Contact::Edge), 80),
    ];
    assert_eq!(
        found,
        [
            0x6b1c_40a4_0355_3a34,
            0xbde9_4245_4241_4ec5,
            0x435e_2957_0fcb_f018,
            0xf7c0_1823_0a22_62a7
        ]
    );
}

#[test]
fn parameters_outside_their_range_are_named() {
    let bad = [
        SwarmParams {
            agents: 0,
            ..SwarmParams::default()
        },
        SwarmParams {
            pellet_max: 0,
            ..SwarmParams::default()
        },
        SwarmParams {
            teleport: 1.5,
            ..SwarmParams::default()
        },
        SwarmParams {
            attract: f64::NAN,
            ..SwarmParams::default()
        },
    ];
    for params in bad {
        assert!(matches!(params.validate(), Err(SwarmError::Parameter { .. })));
    }
}
