//! Laws of the belief, and worlds drawn as text.
//!
//! Why this file is long: the laws of one belief share its worlds.

use proptest::prelude::*;
use rstest::rstest;

use super::*;
use crate::grid::{Cell, GridGeometry, Layer, Position};
use crate::random::{philox, unit};
use crate::sensor::PenetrometerReading;
use crate::soil::{SoilClass, SoilTable};

const CELL_M: f64 = 10.0;

/// A layer of units from rows of digits.
fn layer(rows: &[&str]) -> Layer<u32> {
    let geometry = GridGeometry::new(rows.len(), rows[0].len(), CELL_M, 0.0, rows.len() as f64 * CELL_M).unwrap();
    let units = rows.iter().flat_map(|row| row.chars());
    Layer::new(
        geometry,
        units.map(|digit| digit.to_digit(10).unwrap()).collect(),
        "units",
    )
    .unwrap()
}

fn unit_of(id: u32, symbol: u32, class: SoilClass) -> Unit {
    Unit {
        id,
        symbol,
        prior: Prior::Class(class),
    }
}

fn three_units() -> SoilBelief {
    let units = [
        unit_of(1, 7, SoilClass::Sand),
        unit_of(2, 7, SoilClass::Sand),
        unit_of(3, 8, SoilClass::Clay),
    ];
    SoilBelief::new(&layer(&["1113330222", "1113330222"]), &units, BeliefParams::default()).unwrap()
}

fn one_unit(class: SoilClass, params: BeliefParams) -> SoilBelief {
    SoilBelief::new(&layer(&["1111111111"]), &[unit_of(1, 0, class)], params).unwrap()
}

fn seen(x_m: f64, y_m: f64, class: SoilClass) -> Observation {
    Observation::Class {
        at: Position::new(x_m, y_m),
        class,
    }
}

fn reading(x_m: f64, y_m: f64, cone_indices_kpa: [f64; 3]) -> PenetrometerReading {
    PenetrometerReading {
        x_m,
        y_m,
        depths_m: vec![0.05, 0.1, 0.15],
        cone_indices_kpa: cone_indices_kpa.to_vec(),
        refusal_depth_m: None,
        sleeve_frictions_kpa: None,
    }
}

fn identity() -> [PerClass; CLASS_COUNT] {
    std::array::from_fn(|row| std::array::from_fn(|column| f64::from(u8::from(row == column))))
}

fn going(needed_kpa: f64, moisture_percent: f64) -> Going {
    Going::with_cone_index(needed_kpa, moisture_percent, SoilTable::Text).unwrap()
}

fn cells(belief: &SoilBelief) -> impl Iterator<Item = Cell> + use<> {
    let geometry = belief.geometry();
    (0..geometry.cell_count()).map(move |index| geometry.cell(index))
}

fn all_chances(belief: &SoilBelief) -> Vec<PerClass> {
    cells(belief).map(|cell| belief.class_probabilities(cell)).collect()
}

#[test]
fn without_readings_the_belief_is_the_prior() {
    let mixture = [0.1, 0.2, 0.3, 0.4, 0.0, 0.0];
    let units = [
        unit_of(1, 0, SoilClass::Clay),
        Unit {
            id: 2,
            symbol: 0,
            prior: Prior::Mixture(mixture),
        },
    ];
    let belief = SoilBelief::new(&layer(&["012"]), &units, BeliefParams::default()).unwrap();
    let flat = belief.class_probabilities(Cell::new(0, 0));
    approx::assert_relative_eq!(flat[..], [0.2, 0.2, 0.2, 0.2, 0.2, 0.0][..], epsilon = 1e-12);
    let clay = belief.class_probabilities(Cell::new(0, 1));
    approx::assert_relative_eq!(clay[2], 0.75, epsilon = 1e-12);
    // The rest of the clay follows its row of the confusion: silt 0.2475 of 0.3466.
    approx::assert_relative_eq!(clay[3], 0.25 * 0.2475 / 0.3466, epsilon = 1e-12);
    let mixed = belief.class_probabilities(Cell::new(0, 2));
    approx::assert_relative_eq!(mixed[..], mixture[..], epsilon = 1e-12);
    let unknown = belief.decide(Cell::new(0, 0), &going(100.0, 20.0));
    assert_eq!(
        (unknown.code, unknown.goodness, unknown.go),
        (SoilClass::Unknown, 3, true)
    );
}

#[rstest]
#[case(SoilClass::Sand)]
#[case(SoilClass::Clay)]
#[case(SoilClass::Silt)]
#[case(SoilClass::Rock)]
#[case(SoilClass::None)]
fn without_readings_a_mapped_class_is_ranked_as_itself(#[case] class: SoilClass) {
    let belief = one_unit(class, BeliefParams::default());
    let decision = belief.decide(Cell::new(0, 0), &going(100.0, 20.0));
    assert_eq!(decision.code, class);
    assert_eq!(decision.go, class != SoilClass::None);
}

#[test]
fn an_instrument_that_never_errs_makes_its_place_certain() {
    let params = BeliefParams {
        confusion: identity(),
        ..BeliefParams::default()
    };
    for mapped in [SoilClass::Sand, SoilClass::Unknown] {
        for class in CLASSES {
            let mut belief = one_unit(mapped, params.clone());
            belief.add(&seen(5.0, 5.0, class)).unwrap();
            let chances = belief.class_probabilities(Cell::new(0, 0));
            assert_eq!(
                chances[class_index(class).unwrap()],
                1.0,
                "{mapped:?} {class:?}: {chances:?}"
            );
            let far = belief.class_probabilities(Cell::new(0, 9));
            assert!(far[class_index(class).unwrap()] < 1.0);
        }
    }
}

#[test]
fn a_reading_stops_at_its_polygon_but_for_those_of_the_same_symbol() {
    let mut belief = three_units();
    let before = all_chances(&belief);
    // In the clay, 1 m from the sand.
    let changed = belief.add(&seen(31.0, 5.0, SoilClass::Gravel)).unwrap();
    assert_eq!(changed.units, [3]);
    assert_eq!(changed.cells, [3, 4, 5, 13, 14, 15]);
    for (cell, (old, new)) in before.iter().zip(all_chances(&belief)).enumerate() {
        assert_eq!(*old != new, changed.cells.contains(&(cell as u32)), "cell {cell}");
    }
    let before = all_chances(&belief);
    let changed = belief.add(&seen(15.0, 5.0, SoilClass::Rock)).unwrap();
    assert_eq!(changed.units, [1, 2]);
    let after = all_chances(&belief);
    for (cell, (old, new)) in before.iter().zip(&after).enumerate() {
        assert_eq!(old != new, changed.cells.contains(&(cell as u32)), "cell {cell}");
    }
    // The clay's reading says nothing of the sand.
    let mut alone = three_units();
    alone.add(&seen(15.0, 5.0, SoilClass::Rock)).unwrap();
    assert_eq!(all_chances(&alone)[..3], after[..3]);
    // The other polygon of the symbol learns, and less than the one that was probed.
    let rock = |cell: usize| after[cell][4] - before[cell][4];
    assert!(rock(9) > 0.0 && rock(9) < rock(0), "{} {}", rock(9), rock(0));
}

#[test]
fn ground_without_a_polygon_learns_only_close_by() {
    let belief = SoilBelief::new(&layer(&["0".repeat(40).as_str()]), &[], BeliefParams::default());
    let mut belief = belief.unwrap();
    belief.add(&seen(5.0, 5.0, SoilClass::Sand)).unwrap();
    let decide = |column| belief.decide(Cell::new(0, column), &going(100.0, 20.0));
    assert_ne!(decide(0).code, SoilClass::Unknown);
    assert_eq!(decide(39).code, SoilClass::Unknown);
}

#[test]
fn what_cannot_be_used_is_refused() {
    let mut belief = three_units();
    let before = all_chances(&belief);
    assert!(matches!(
        belief.add(&Observation::Reading(reading(5.0, 5.0, [-1.0, 2.0, 3.0]))),
        Err(BeliefError::Reading(_))
    ));
    assert!(matches!(
        belief.add(&Observation::Reading(reading(-5.0, 5.0, [1.0, 2.0, 3.0]))),
        Err(BeliefError::OutsideMap { .. })
    ));
    let mut deep = reading(5.0, 5.0, [1.0, 2.0, 3.0]);
    deep.depths_m = vec![0.5, 0.6, 0.7];
    assert!(matches!(
        belief.add(&Observation::Reading(deep)),
        Err(BeliefError::Parameter { .. })
    ));
    assert_eq!(
        belief.add(&seen(5.0, 5.0, SoilClass::Unknown)),
        Err(BeliefError::NoClass)
    );
    assert!(belief.add(&seen(f64::NAN, 5.0, SoilClass::Sand)).is_err());
    assert_eq!(belief.withdraw(3), Err(BeliefError::NoReading { id: 3 }));
    assert_eq!(before, all_chances(&belief));
}

#[test]
fn units_and_parameters_that_do_not_fit_are_refused() {
    let new = |units: &[Unit]| SoilBelief::new(&layer(&["01"]), units, BeliefParams::default()).err();
    let sand = unit_of(1, 0, SoilClass::Sand);
    assert!(matches!(new(&[]), Some(BeliefError::Unit { unit: 1, .. })));
    assert!(matches!(new(&[sand, sand]), Some(BeliefError::Unit { unit: 1, .. })));
    assert!(matches!(
        new(&[sand, unit_of(0, 0, SoilClass::Clay)]),
        Some(BeliefError::Unit { unit: 0, .. })
    ));
    for mixture in [
        [0.5; CLASS_COUNT],
        [f64::NAN; CLASS_COUNT],
        [2.0, -1.0, 0.0, 0.0, 0.0, 0.0],
    ] {
        let prior = Prior::Mixture(mixture);
        assert_eq!(new(&[Unit { prior, ..sand }]), Some(BeliefError::Mixture { unit: 1 }));
    }
    for spoil in [
        |params: &mut BeliefParams| params.purity = 1.1,
        |params: &mut BeliefParams| params.length_m = 0.0,
        |params: &mut BeliefParams| params.map_weight = f64::INFINITY,
        |params: &mut BeliefParams| params.confusion[2][2] = 0.9,
        |params: &mut BeliefParams| params.confusion[0] = [f64::NAN; CLASS_COUNT],
        |params: &mut BeliefParams| params.rule = Rule::PaperRelabel { radius_m: Some(-1.0) },
        |params: &mut BeliefParams| params.types.0[1].refusal = 1.0,
        |params: &mut BeliefParams| params.types.0[1].roughness.deviation = 0.0,
    ] {
        let mut params = BeliefParams::default();
        spoil(&mut params);
        assert!(params.validate().is_err());
    }
}

#[rstest]
#[case(0, 0.4)]
#[case(1, 0.0)]
#[case(2, 0.0)]
#[case(3, 0.0)]
#[case(5, 0.0)]
fn the_typical_profile_of_a_class_is_matched_as_it(#[case] class: usize, #[case] wobble: f64) {
    let params = BeliefParams::default();
    let soil = params.types.0[class];
    let middle = soil.cone_index_ln_kpa.mean.exp();
    let rise = soil.gradient_kpa_per_m.mean * 0.05;
    let bend = wobble.max(soil.roughness.mean) * middle * 2.0_f64.sqrt();
    let profile = reading(
        5.0,
        5.0,
        [middle - rise + bend / 2.0, middle - bend, middle + rise + bend / 2.0],
    );
    let found = match_profile(&profile, &params).unwrap();
    assert_eq!(found.observed, CLASSES[class], "{:?}", found.likelihood);
    approx::assert_relative_eq!(found.cone_index_kpa.unwrap(), middle, max_relative = 1e-9);
}

#[test]
fn refusal_at_the_surface_is_rock_and_sometimes_gravel() {
    let params = BeliefParams::default();
    let mut told = reading(5.0, 5.0, [300.0; 3]);
    told.refusal_depth_m = Some(0.02);
    for profile in [told, reading(5.0, 5.0, [5100.0, 100.0, 100.0])] {
        let found = match_profile(&profile, &params).unwrap();
        assert_eq!((found.observed, found.cone_index_kpa), (SoilClass::Rock, None));
        approx::assert_relative_eq!(found.likelihood[0], 0.15 / 0.85, epsilon = 1e-12);
    }
}

// Indices by hand: q = 10 000 kPa with R 0.5 % has sqrt(1.47^2 + 0.919^2) = 1.734; q = 1000 kPa with 1 %
// sqrt(2.47^2 + 1.22^2) = 2.755; with 4 % sqrt(2.47^2 + 1.822^2) = 3.069; q = 300 kPa with 5 % sqrt(2.993^2 + 1.919^2) = 3.555;
// q = 100 kPa with 8 % sqrt(3.47^2 + 2.123^2) = 4.068; q = 30 000 kPa with 0.3 % sqrt(0.993^2 + 0.697^2) = 1.213.
#[rstest]
#[case(4000.0, 0.5, SoilClass::Sand)]
#[case(1000.0, 1.0, SoilClass::Silt)]
#[case(1000.0, 4.0, SoilClass::Clay)]
#[case(300.0, 5.0, SoilClass::Clay)]
#[case(100.0, 8.0, SoilClass::None)]
fn sleeve_friction_tells_the_soil_behaviour_type(
    #[case] cone_kpa: f64,
    #[case] friction_percent: f64,
    #[case] expected: SoilClass,
) {
    let mut profile = reading(5.0, 5.0, [cone_kpa; 3]);
    profile.sleeve_frictions_kpa = Some(vec![cone_kpa * friction_percent / 100.0; 3]);
    let params = BeliefParams::default();
    let found = match_profile(&profile, &params).unwrap();
    let column = class_index(expected).unwrap();
    let likeliest = params.confusion.iter().map(|row| row[column]).fold(0.0, f64::max);
    assert_eq!(
        params.confusion[class_index(found.observed).unwrap()][column],
        likeliest
    );
}

#[test]
fn a_soft_place_in_sand_is_closed_and_firm_clay_is_opened() {
    // Wet: clay has 132 kPa and silt 202 by the table, sand and gravel the cap.
    let needed = going(300.0, 35.0);
    let mut sand = one_unit(
        SoilClass::Sand,
        BeliefParams {
            no_go_tolerance: 0.3,
            ..BeliefParams::default()
        },
    );
    let here = Cell::new(0, 0);
    assert!(sand.decide(here, &needed).go);
    sand.add(&Observation::Reading(reading(5.0, 5.0, [60.0, 80.0, 100.0])))
        .unwrap();
    let soft = sand.decide(here, &needed);
    assert!(!soft.go && soft.no_go_probability > 0.9, "{soft:?}");
    assert!(sand.decide(Cell::new(0, 9), &needed).no_go_probability < soft.no_go_probability);

    let mut clay = one_unit(SoilClass::Clay, BeliefParams::default());
    assert_eq!(clay.decide(here, &needed).code, SoilClass::Clay);
    assert!(!clay.decide(here, &needed).go);
    clay.add(&Observation::Reading(reading(5.0, 5.0, [1500.0, 1550.0, 1600.0])))
        .unwrap();
    let firm = clay.decide(here, &needed);
    assert!(firm.go, "{firm:?}");
    // Its code passes the gate that ranks have by the table.
    assert!(firm.code.rating_cone_index_kpa(35.0).is_none_or(|kpa| kpa >= 300.0));
    assert!(!clay.decide(Cell::new(0, 9), &needed).go);
}

#[test]
fn firm_sand_says_nothing_of_how_firm_clay_beside_it_would_be() {
    // Two cells on, clay would be as weak as by its table; at the very place it would be as firm as was measured.
    let needed = going(300.0, 35.0);
    let mut sand = one_unit(SoilClass::Sand, BeliefParams::default());
    let clay = class_index(SoilClass::Clay).unwrap();
    let strength = |belief: &SoilBelief, column| {
        let expected = belief
            .expected_cone_index_kpa(Cell::new(0, column), clay, &needed)
            .unwrap();
        expected * belief.params().types.0[clay].remoulding_index
    };
    let by_table = strength(&sand, 2);
    sand.add(&Observation::Reading(reading(5.0, 5.0, [1500.0, 2000.0, 2500.0])))
        .unwrap();
    assert!(strength(&sand, 0) > 5.0 * by_table);
    assert!(strength(&sand, 2) < 1.5 * by_table, "{} {by_table}", strength(&sand, 2));
}

#[test]
fn more_evidence_that_is_asked_for_closes_less_and_never_opens_what_likelier_fails() {
    let needed = going(150.0, 40.0);
    let mut sand = one_unit(SoilClass::Sand, BeliefParams::default());
    sand.add(&Observation::Reading(reading(5.0, 5.0, [60.0, 80.0, 100.0])))
        .unwrap();
    let closed = |against: f64| -> Vec<usize> {
        let is_closed = |column: &usize| {
            let decision = sand.decide_against(Cell::new(0, *column), SoilClass::Sand, &needed, against);
            !decision.go
        };
        (0..10).filter(is_closed).collect()
    };
    let counts = [1.0, AGAINST_MAP, 4.0, 1e9].map(|against| closed(against).len());
    assert!(counts.windows(2).all(|pair| pair[0] >= pair[1]), "{counts:?}");
    assert!(counts[0] > counts[3] && counts[3] > 0, "{counts:?}");
    assert_eq!(closed(1e9)[0], 0);
}

#[test]
fn a_wet_days_table_matches_wet_silt_as_silt_and_not_as_no_ground() {
    let params = BeliefParams::default();
    let wet_kpa = SoilClass::Silt.rating_cone_index_kpa(40.0).unwrap() / 0.7;
    let profile = reading(0.0, 0.0, [0.87 * wet_kpa, 1.13 * wet_kpa, 1.4 * wet_kpa]);
    let today = BeliefParams {
        types: params.types.on_day(40.0).unwrap(),
        ..params.clone()
    };
    let [usual, wet] = [&params, &today].map(|params| match_profile(&profile, params).unwrap());
    let [silt, none] = [SoilClass::Silt, SoilClass::None].map(|class| class_index(class).unwrap());
    assert!(usual.likelihood[none] > usual.likelihood[silt], "{usual:?}");
    assert!(wet.likelihood[silt] > wet.likelihood[none], "{wet:?}");
    assert!(params.types.on_day(0.5).is_err());
}

#[test]
fn mistaking_gravel_for_rock_closes_nothing() {
    let mut gravel = one_unit(SoilClass::Gravel, BeliefParams::default());
    for x in [5.0, 25.0, 45.0] {
        gravel.add(&seen(x, 5.0, SoilClass::Rock)).unwrap();
    }
    let heavy = going(1000.0, 10.0);
    for cell in cells(&gravel) {
        assert!(gravel.decide(cell, &heavy).go);
    }
}

#[test]
fn the_papers_rule_replaces_the_class() {
    let relabel = |radius_m| BeliefParams {
        rule: Rule::PaperRelabel { radius_m },
        ..BeliefParams::default()
    };
    let class_at = |belief: &SoilBelief, column| {
        let chances = belief.class_probabilities(Cell::new(0, column));
        CLASSES[chances.iter().position(|&chance| chance == 1.0).unwrap_or(5)]
    };
    let mut whole = one_unit(SoilClass::Clay, relabel(None));
    whole.add(&seen(5.0, 5.0, SoilClass::Sand)).unwrap();
    assert_eq!([class_at(&whole, 0), class_at(&whole, 9)], [SoilClass::Sand; 2]);
    whole.add(&seen(95.0, 5.0, SoilClass::Silt)).unwrap();
    assert_eq!(class_at(&whole, 0), SoilClass::Silt); // Of equals the worse to drive on.
    let mut near = one_unit(SoilClass::Clay, relabel(Some(25.0)));
    near.add(&seen(5.0, 5.0, SoilClass::Sand)).unwrap();
    assert_eq!(class_at(&near, 2), SoilClass::Sand);
    approx::assert_relative_eq!(near.class_probabilities(Cell::new(0, 3))[2], 0.75);
}

/// True classes are drawn from the prior by polygon and place, observations by the confusion: the belief must do better
/// than the map, and where it says 80 % it must be right about as often.
#[test]
fn the_belief_is_calibrated_and_better_than_the_map() {
    let draw = |chances: &PerClass, number: f64| {
        let mut sum = 0.0;
        chances.iter().position(|chance| {
            sum += chance;
            number < sum
        })
    };
    let params = BeliefParams::default();
    let (mut brier_map, mut brier_belief, mut places) = (0.0, 0.0, 0);
    let (mut sure, mut right) = (0.0, 0.0);
    for seed in 0..150_u64 {
        let mapped = CLASSES[(seed % 5) as usize];
        let mut belief = one_unit(mapped, params.clone());
        let prior = belief.class_probabilities(Cell::new(0, 0));
        // One class per cell pair, so that a reading tells of its neighbour.
        let truth: Vec<usize> = (0..10)
            .map(|column| draw(&prior, unit(philox([column / 2, 0, 0, 0], seed)[0])).unwrap_or(0))
            .collect();
        for column in [0_u32, 3, 4, 9] {
            let row = &params.confusion[truth[column as usize]];
            let observed = draw(row, unit(philox([column, 1, 0, 0], seed)[0])).unwrap_or(0);
            belief
                .add(&seen(f64::from(column) * CELL_M + 5.0, 5.0, CLASSES[observed]))
                .unwrap();
        }
        for (column, &class) in truth.iter().enumerate() {
            let found = belief.class_probabilities(Cell::new(0, column));
            let brier = |chances: &PerClass| -> f64 {
                (0..CLASS_COUNT)
                    .map(|k| (chances[k] - f64::from(u8::from(k == class))).powi(2))
                    .sum()
            };
            brier_map += brier(&prior);
            brier_belief += brier(&found);
            places += 1;
            for (k, chance) in found
                .iter()
                .enumerate()
                .filter(|(_, chance)| (0.7..0.9).contains(*chance))
            {
                sure += chance;
                right += f64::from(u8::from(k == class));
            }
        }
    }
    let (map, belief) = (brier_map / f64::from(places), brier_belief / f64::from(places));
    assert!(belief < 0.95 * map, "belief {belief:.3}, map {map:.3}");
    assert!((right / sure - 1.0).abs() < 0.12, "expected {sure:.1}, found {right}");
}

fn observation() -> impl Strategy<Value = Observation> {
    let place = (0.0f64..100.0, 0.0f64..20.0);
    let by_word = (place.clone(), 0..CLASS_COUNT).prop_map(|((x, y), class)| seen(x, y, CLASSES[class]));
    let pushed = (
        place,
        [0.0f64..9000.0, 0.0..9000.0, 0.0..9000.0],
        proptest::option::of(0.0f64..0.2),
    );
    let pushed = pushed.prop_map(|((x, y), kpa, refusal_depth_m)| {
        Observation::Reading(PenetrometerReading {
            refusal_depth_m,
            ..reading(x, y, kpa)
        })
    });
    prop_oneof![by_word, pushed]
}

proptest! {
    #[test]
    fn probabilities_are_probabilities(observations in prop::collection::vec(observation(), 0..12)) {
        let mut belief = three_units();
        for observation in &observations {
            belief.add(observation).unwrap();
        }
        for cell in cells(&belief) {
            let chances = belief.class_probabilities(cell);
            prop_assert!(chances.iter().all(|chance| (0.0..=1.0).contains(chance)), "{chances:?}");
            prop_assert!((chances.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            let decision = belief.decide(cell, &going(150.0, 35.0));
            prop_assert!((0.0..=1.0).contains(&decision.no_go_probability));
            // What is ranked by the code agrees with the decision.
            let by_table = decision.code.rating_cone_index_kpa(35.0).is_none_or(|kpa| kpa >= 150.0);
            prop_assert_eq!(by_table && decision.code != SoilClass::None, decision.go);
        }
    }

    #[test]
    fn the_order_of_readings_does_not_matter(
        (observations, shuffled) in prop::collection::vec(observation(), 1..8)
            .prop_flat_map(|all| (Just(all.clone()), Just(all).prop_shuffle())),
    ) {
        let [mut one, mut other] = [three_units(), three_units()];
        for (a, b) in observations.iter().zip(&shuffled) {
            one.add(a).unwrap();
            other.add(b).unwrap();
        }
        prop_assert_eq!(all_chances(&one), all_chances(&other));
        prop_assert_eq!(one.decide_all(&going(150.0, 25.0)), other.decide_all(&going(150.0, 25.0)));
    }

    #[test]
    fn a_reading_that_is_withdrawn_leaves_nothing(
        observations in prop::collection::vec(observation(), 0..6),
        doubtful in observation(),
    ) {
        let mut belief = three_units();
        for observation in &observations {
            belief.add(observation).unwrap();
        }
        let before = all_chances(&belief);
        let id = belief.add(&doubtful).unwrap().reading;
        belief.withdraw(id).unwrap();
        prop_assert_eq!(all_chances(&belief), before);
    }

    #[test]
    fn decisions_brought_up_to_date_are_those_made_anew(observations in prop::collection::vec(observation(), 1..8)) {
        let mut belief = three_units();
        let needed = going(150.0, 25.0);
        let mut decisions = belief.decide_all(&needed);
        for observation in &observations {
            let changed = belief.add(observation).unwrap();
            let before = decisions.codes.clone();
            let cells = belief.redecide(&mut decisions, &changed, &needed);
            prop_assert_eq!(&decisions, &belief.decide_all(&needed));
            let differ = before.data().iter().zip(decisions.codes.data()).filter(|(a, b)| a != b).count();
            prop_assert_eq!(cells.len(), differ);
        }
    }

    #[test]
    fn no_profile_rules_a_class_out(observation in observation()) {
        if let Observation::Reading(reading) = observation {
            let found = match_profile(&reading, &BeliefParams::default()).unwrap();
            prop_assert!(found.likelihood.iter().all(|value| (0.01..=1.0).contains(value)));
        }
    }
}

/// A short way over ground that is sand or wet clay and a long one round it: what it is worth to know.
#[test]
fn a_reading_is_worth_what_it_is_expected_to_save() {
    let belief = one_unit(SoilClass::Clay, BeliefParams::default());
    let needed = going(300.0, 35.0);
    let decisions = belief.decide_all(&needed);
    assert!(decisions.no_go.data().iter().all(|&closed| closed));
    let here = Cell::new(0, 0);
    // The way round costs 100; the short one 60, once the first cell is open.
    let price = |cells: &[(Cell, u8)]| {
        let open = cells.iter().any(|&(cell, code)| {
            cell == here
                && code != SoilClass::None as u8
                && code != SoilClass::Clay as u8
                && code != SoilClass::Silt as u8
        });
        RoutePrices {
            kept: 100.0,
            best: if open { 60.0 } else { 100.0 },
        }
    };
    let half = Unit {
        id: 1,
        symbol: 0,
        prior: Prior::Mixture([0.0, 0.5, 0.5, 0.0, 0.0, 0.0]),
    };
    let params = BeliefParams {
        no_go_tolerance: 0.2,
        ..BeliefParams::default()
    };
    let tolerant = SoilBelief::new(&layer(&["1111111111"]), &[half], params).unwrap();
    let decisions_now = tolerant.decide_all(&needed);
    let found = probe_value(&tolerant, &decisions_now, here, &needed, 1000.0, price).unwrap();
    approx::assert_relative_eq!(found.chances.iter().sum::<f64>(), 1.0, epsilon = 1e-9);
    let by_hand: f64 = found
        .chances
        .iter()
        .zip(found.savings)
        .map(|(chance, saving)| chance * saving)
        .sum();
    approx::assert_relative_eq!(found.expected_saving, by_hand, epsilon = 1e-12);
    assert!(found.savings.contains(&40.0) && found.savings[2] == 0.0, "{found:?}");

    let closed = |_: &[(Cell, u8)]| RoutePrices {
        kept: f64::INFINITY,
        best: f64::INFINITY,
    };
    let nowhere = probe_value(&tolerant, &decisions_now, here, &needed, 1000.0, closed).unwrap();
    assert_eq!(nowhere.expected_saving, 0.0);
    assert!(probe_value(&belief, &decisions, here, &needed, f64::NAN, closed).is_err());
}

#[test]
fn a_reading_of_ground_that_is_certain_is_worth_nothing() {
    let params = BeliefParams {
        confusion: identity(),
        purity: 1.0,
        ..BeliefParams::default()
    };
    let belief = one_unit(SoilClass::Sand, params);
    let needed = going(300.0, 35.0);
    let asked = |_: &[(Cell, u8)]| RoutePrices { kept: 9.0, best: 1.0 };
    let found = probe_value(
        &belief,
        &belief.decide_all(&needed),
        Cell::new(0, 4),
        &needed,
        100.0,
        asked,
    );
    assert_eq!(found.unwrap().expected_saving, 0.0);
}

#[test]
fn each_policy_probes_when_it_says() {
    let [here, near, far] = [0, 1, 2].map(|column| Cell::new(0, column));
    let candidates = [near, far];
    let value = |cell: Cell| cell.column as f64 * 10.0;
    let next = |policy, since| next_probe(policy, here, since, &candidates, value);
    assert_eq!(next(ProbePolicy::Never, 1e9), None);
    assert_eq!(next(ProbePolicy::EveryMetres(50.0), 49.9), None);
    assert_eq!(next(ProbePolicy::EveryMetres(50.0), 50.0), Some(here));
    assert_eq!(next(ProbePolicy::WhereItMatters { probe_cost: 5.0 }, 0.0), Some(far));
    assert_eq!(next(ProbePolicy::WhereItMatters { probe_cost: 20.0 }, 0.0), None);
    assert_eq!(next(ProbePolicy::WhereItPays { probe_cost: 5.0 }, 0.0), Some(near));
    assert_eq!(next(ProbePolicy::WhereItPays { probe_cost: 10.0 }, 0.0), Some(far));
    assert_eq!(next(ProbePolicy::WhereItPays { probe_cost: 20.0 }, 0.0), None);
    assert!(ProbePolicy::WhereItPays { probe_cost: -1.0 }.validate().is_err());
    assert!(ProbePolicy::EveryMetres(0.0).validate().is_err());
    assert!(ProbePolicy::WhereItMatters { probe_cost: f64::NAN }.validate().is_err());
    assert!(ProbePolicy::Never.validate().is_ok());
}
