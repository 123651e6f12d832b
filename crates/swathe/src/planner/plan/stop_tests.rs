//! The rules and budgets that end a swarm, for every arc and exploration.

use super::tests::{LAKE, RIVER, request, solve, world};
use super::*;
use crate::planner::{ArcFrame, Film};
use crate::swarm::{Budget, Explore, SwarmParams};
use proptest::prelude::*;

const ARCS: [ArcKind; 4] = [
    ArcKind::Relaid,
    ArcKind::Spine,
    ArcKind::Line,
    ArcKind::Circle { sagitta_m: None },
];

const LOOSE: StopRule = StopRule::Statistical {
    open_share: 0.02,
    doubt: 0.1,
};

fn arcs() -> impl Strategy<Value = ArcKind> {
    prop::sample::select(&ARCS)
}

fn rules() -> impl Strategy<Value = Option<StopRule>> {
    prop_oneof![
        Just(None),
        Just(Some(StopRule::Good)),
        Just(Some(StopRule::Connected)),
        Just(Some(StopRule::Finished)),
        Just(Some(LOOSE))
    ]
}

fn explorations() -> impl Strategy<Value = Explore> {
    prop_oneof![Just(Explore::Walk), Just(Explore::Uniform), Just(Explore::Permute)]
}

type Layers = (Layer<f32>, Layer<u8>);

/// Level ground with ponds, where start and goal are clear of them.
fn ponds(seed: u64) -> Layers {
    let rows: Vec<String> = (0..40)
        .map(|row| {
            let cell = |column: u32| {
                let clear = !(6..=42).contains(&column);
                let pond = crate::random::philox([row / 3, column / 3, 1, 0], seed)[0] % 100 < 28;
                if pond && !clear { '~' } else { '.' }
            };
            (0..48).map(cell).collect()
        })
        .collect();
    world(&rows.iter().map(String::as_str).collect::<Vec<_>>())
}

/// Plans with a film, for at most so many looks at the clock.
fn watched(layers: &Layers, request: &PlanRequest, looks: u64, most: usize) -> (Plan, Vec<ArcFrame>) {
    let vehicle = crate::vehicle::fixtures::pioneer();
    let params = RankParams::default();
    let (elevation, soil) = layers;
    let ranker = Ranker::new(elevation.view(), Some(soil.view()), None, None, &vehicle, params).unwrap();
    let terrain = Terrain {
        elevation_m: elevation.view(),
        soil: Some(soil.view()),
        cost_factor: None,
        map_continues: false,
    };
    let mut film = Film::new(most, 1);
    let mut looked = 0;
    let mut over = || {
        looked += 1;
        looked > looks
    };
    let mut report = |_, _, _| true;
    let mut watch = Watch::new(&mut report, &mut over, Some(&mut film));
    let plan = plan_watched(terrain, &ranker, &vehicle, &params, request, &mut watch).unwrap();
    (plan, film.frames())
}

/// What two answers must share to be the same.
fn bytes(plan: &Plan) -> String {
    format!(
        "{:?}",
        (
            &plan.answer,
            &plan.path,
            plan.path_cost,
            &plan.nests,
            plan.swarm,
            plan.stopped
        )
    )
}

/// A route that keeps every limit, or a refusal that claims nothing; and nests of the map.
fn check(layers: &Layers, ask: &PlanRequest, found: &Plan) -> Result<(), TestCaseError> {
    let exact = solve(
        layers,
        &PlanRequest {
            method: Method::Exact,
            stop: None,
            ..*ask
        },
    );
    let (known, all) = (found.nests.as_ref().unwrap(), exact.nests.unwrap());
    for cell in layers.0.geometry().cells() {
        prop_assert!(known.label(cell) == 0 || all.label(cell) > 0);
    }
    let stopped = found.stopped.unwrap();
    prop_assert!(stopped.unknown_cells <= stopped.swathe_cells);
    match (&found.answer, exact.answer) {
        (Ok(route), Ok(_)) => {
            for leg in &route.legs {
                prop_assert!(leg.facts.time_s.is_finite() && leg.rank_min >= 6, "{leg:?}");
            }
            prop_assert!(found.path.iter().all(|&cell| known.label(cell) > 0));
            prop_assert!(found.path_cost.unwrap() >= exact.path_cost.unwrap() - 1e-6);
        }
        (Ok(_), Err(refusal)) => prop_assert!(false, "a route where there is none: {refusal:?}"),
        (Err(refusal), exact) => {
            let early = refusal.reason.starts_with("Stopped early: ");
            prop_assert!(early || exact.is_err(), "{refusal:?}");
            prop_assert!(!early || refusal.reason.ends_with("is not known.") && refusal.status == Status::NoRoute);
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn whatever_ends_the_search_the_answer_is_a_route_or_claims_nothing(
        seed: u64, arc in arcs(), stop in rules(), explore in explorations(), agents in 1u32..400,
        ticks in prop::option::of(0u64..60), evaluations in prop::option::of(0u64..2000), looks in 0u64..40,
        pellet_max in 1u8..3,
    ) {
        let layers = ponds(seed);
        let ask = PlanRequest {
            arc, stop,
            budget: Budget { ticks, evaluations },
            swarm: SwarmParams { agents, pellet_max, explore, seed, ..SwarmParams::default() },
            ..request(layers.0.geometry(), (20, 2), (21, 45))
        };
        let looks = if looks > 20 { u64::MAX } else { looks };
        let (found, frames) = watched(&layers, &ask, looks, 12);
        check(&layers, &ask, &found)?;
        prop_assert!(frames.len() <= 12);
        prop_assert!(evaluations.is_none_or(|most| found.cells_evaluated <= most));
        if let Some(swarm) = found.swarm {
            prop_assert!(ticks.is_none_or(|most| swarm.tally.ticks <= most));
        }
    }

    #[test]
    fn a_larger_budget_never_evaluates_less_and_a_boundless_one_changes_nothing(
        seed: u64, arc in arcs(), stop in rules(), explore in explorations(), small in 0u64..1500, more in 0u64..600,
        in_ticks: bool,
    ) {
        let layers = ponds(seed);
        let swarm = SwarmParams { agents: 40, seed, explore, ..SwarmParams::default() };
        let ask = PlanRequest { swarm, arc, stop, ..request(layers.0.geometry(), (20, 2), (21, 45)) };
        let with = |most: u64| {
            let budget = if in_ticks {
                Budget { ticks: Some(most), evaluations: None }
            } else {
                Budget { ticks: None, evaluations: Some(most) }
            };
            solve(&layers, &PlanRequest { budget, ..ask })
        };
        prop_assert!(with(small).cells_evaluated <= with(small + more).cells_evaluated);
        let free = solve(&layers, &ask);
        prop_assert_eq!(bytes(&with(u64::MAX)), bytes(&free));
        let (filmed, frames) = watched(&layers, &ask, u64::MAX, 9);
        prop_assert_eq!(bytes(&filmed), bytes(&free));
        prop_assert!(frames.windows(2).all(|pair| pair[0].swarm.tally.ticks < pair[1].swarm.tally.ticks));
    }
}

#[test]
fn a_budget_of_nothing_looks_at_nothing_and_says_so() {
    let layers = world(&LAKE);
    for arc in ARCS {
        let ask = PlanRequest {
            arc,
            ..request(layers.0.geometry(), (9, 3), (9, 15))
        };
        for (ticks, evaluations, word) in [(Some(0), None, "0 ticks"), (None, Some(0), "0 evaluations")] {
            let budget = Budget { ticks, evaluations };
            let found = solve(&layers, &PlanRequest { budget, ..ask });
            let coarse = if ticks.is_some() && arc == ArcKind::Spine { 6 } else { 0 };
            assert_eq!(found.cells_evaluated, coarse, "{arc:?}");
            let stopped = found.stopped.unwrap();
            assert_eq!(stopped.unknown_cells, stopped.swathe_cells);
            let refusal = found.answer.unwrap_err();
            assert!(refusal.reason.contains(word), "{refusal:?}");
            assert!(refusal.remedy.contains("--max-"), "{refusal:?}");
        }
        let (found, _) = watched(&layers, &ask, 0, 5);
        assert_eq!(found.stopped.unwrap().by, StoppedBy::Seconds);
        assert_eq!(found.swarm.unwrap().tally.cells_evaluated, 0);
    }
}

#[test]
fn each_rule_is_named_by_what_ended_the_search() {
    let layers = ponds(4);
    for arc in ARCS {
        let ask = request(layers.0.geometry(), (20, 2), (21, 45));
        let by = |stop| {
            let found = solve(&layers, &PlanRequest { arc, stop, ..ask });
            assert!(found.answer.is_ok(), "{arc:?} {stop:?}");
            (found.stopped.unwrap().by, found.cells_evaluated)
        };
        let (usual, good, connected) = (by(None), by(Some(StopRule::Good)), by(Some(StopRule::Connected)));
        let finished = by(Some(StopRule::Finished));
        assert_eq!(usual, if arc == ArcKind::Relaid { good } else { finished });
        assert_eq!(connected.0, StoppedBy::Connected, "{arc:?}");
        assert_eq!(finished.0, StoppedBy::Finished);
        assert!(connected.1 <= good.1 && good.1 <= finished.1, "{arc:?}");
        // So few cells may be finished first.
        assert!(matches!(
            by(Some(LOOSE)).0,
            StoppedBy::Statistical | StoppedBy::Finished
        ));
    }
}

#[test]
fn a_river_is_a_claim_when_the_map_is_finished_and_none_when_the_search_was_ended() {
    let layers = world(&RIVER);
    for arc in ARCS {
        let ask = PlanRequest {
            arc,
            ..request(layers.0.geometry(), (3, 2), (3, 17))
        };
        for stop in [
            None,
            Some(StopRule::Good),
            Some(StopRule::Connected),
            Some(StopRule::Finished),
        ] {
            let found = solve(&layers, &PlanRequest { stop, ..ask });
            let refusal = found.answer.unwrap_err();
            assert!(
                refusal.reason.starts_with("No safe ground connects"),
                "{arc:?} {stop:?} {refusal:?}"
            );
            assert_eq!(found.stopped.unwrap().by, StoppedBy::Finished);
        }
    }
}

#[test]
fn a_rule_that_is_none_is_refused() {
    let layers = world(&LAKE);
    let vehicle = crate::vehicle::fixtures::pioneer();
    let params = RankParams::default();
    let ranker = Ranker::new(layers.0.view(), None, None, None, &vehicle, params).unwrap();
    let terrain = Terrain {
        elevation_m: layers.0.view(),
        soil: None,
        cost_factor: None,
        map_continues: false,
    };
    let stop = Some(StopRule::Statistical {
        open_share: 0.0,
        doubt: 0.05,
    });
    let ask = PlanRequest {
        stop,
        ..request(layers.0.geometry(), (9, 3), (9, 15))
    };
    let error = plan(terrain, &ranker, &vehicle, &params, &ask, &mut |_, _, _| true).unwrap_err();
    assert!(matches!(error, PlannerError::Swarm(_)));
}
