//! One evaluator, its limits and its bounds.

use super::*;
use crate::planner::{Search, cost_field, search, shorten};
use crate::progress::silent;
use crate::vehicle::fixtures::{pioneer, tractor};
use proptest::prelude::*;

/// Smooth hills of a given height with a few voids and soils.
fn hills(seed: u64, height_m: f64) -> (Layer<f32>, Layer<u8>) {
    let geometry = GridGeometry::new(18, 20, 10.0, 500.0, 900.0).unwrap();
    let draw = |i: u32| crate::random::unit(crate::random::philox([i, 0, 0, 0], seed)[0]);
    let heights = geometry.cells().map(|cell| {
        let (row, column) = (cell.row as f64, cell.column as f64);
        let wave = (row * (0.2 + draw(1) * 0.3) + draw(2)).sin() * (column * (0.2 + draw(3) * 0.3)).cos();
        let void = draw(100 + geometry.index(cell) as u32) < 0.02;
        if void { f32::NAN } else { (height_m * wave) as f32 }
    });
    let soils = geometry
        .cells()
        .map(|cell| (draw(1000 + geometry.index(cell) as u32 / 7) * 6.0) as u8);
    (
        Layer::new(geometry, heights.collect(), "z").unwrap(),
        Layer::new(geometry, soils.collect(), "soil").unwrap(),
    )
}

fn known(elevation: &Layer<f32>) -> impl Fn(usize) -> bool {
    |index: usize| elevation.data()[index].is_finite()
}

fn ground<'a>(elevation: &'a Layer<f32>, soil: &'a Layer<u8>, vehicle: &'a Vehicle, goal: Cell) -> Ground<'a> {
    let goal = elevation.geometry().centre(goal);
    Ground::new(
        elevation.view(),
        Some(soil.view()),
        vehicle,
        18.0,
        known(elevation),
        None,
        goal,
    )
}

/// A ground to be drawn at random, with everything that a cost may depend on.
#[derive(Clone, Debug)]
struct World {
    elevation: Layer<f32>,
    soil: Layer<u8>,
    factor: Option<Layer<f32>>,
    vehicle: Vehicle,
    objective: Objective,
}

impl World {
    fn ground(&self, goal: Cell) -> Ground<'_> {
        let geometry = self.elevation.geometry();
        // Exposure as a formula: any number from 0 to 1 by cell will do.
        let exposure = move |cell: Cell| (geometry.index(cell) % 7) as f64 / 6.0;
        let ground = ground(&self.elevation, &self.soil, &self.vehicle, goal)
            .with_objective(self.objective)
            .with_exposure(exposure);
        match &self.factor {
            Some(factor) => ground.with_factor(factor.view()),
            None => ground,
        }
    }
}

/// A ground of which no more is told than its edges, searched without a bound in full order.
struct Plain<'a, 'b>(&'a Ground<'b>);

impl StepGraph for Plain<'_, '_> {
    fn geometry(&self) -> GridGeometry {
        self.0.geometry()
    }

    fn steps(&self) -> &[Step] {
        self.0.steps()
    }

    fn edge_cost(&self, from: Cell, step: usize) -> f64 {
        self.0.edge_cost(from, step)
    }

    fn bound(&self, _: Cell) -> f64 {
        0.0
    }
}

fn weight() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), Just(1.0), 0.1f64..20.0]
}

prop_compose! {
    fn world()(
        seed: u64, height in 1.0f64..40.0, large: bool, time in weight(), energy in weight(), risk in weight(),
        priced: bool, tippy: bool, slippery in 0.2f64..1.0, brakes in 0.2f64..1.0, idle in prop_oneof![Just(0.0), Just(20.0)],
    ) -> World {
        let (elevation, soil) = hills(seed, height);
        let geometry = elevation.geometry();
        let draw = |i: u32| crate::random::unit(crate::random::philox([i, 1, 0, 0], seed)[0]);
        let factor = geometry.cells().map(|cell| match draw(geometry.index(cell) as u32) {
            x if x < 0.02 => f32::NAN,
            x if x < 0.04 => f32::INFINITY,
            x if x < 0.10 => 0.0,
            x => (4.0 * x) as f32,
        });
        let vehicle = Vehicle {
            traction_friction: slippery,
            braking_friction: brakes,
            idle_power_w: idle,
            gauge_m: tippy.then_some(0.3),
            centre_of_gravity_m: tippy.then_some(1.0),
            ..if large { tractor() } else { pioneer() }
        };
        let time = if time + energy == 0.0 { 1.0 } else { time };
        World {
            factor: priced.then(|| Layer::new(geometry, factor.collect(), "factors").unwrap()),
            elevation,
            soil,
            vehicle,
            objective: Objective { time, energy, risk, risk_distance_m: None },
        }
    }
}

/// The limits by the angles of their definition, apart from the code that plans.
fn keeps_every_limit(world: &World, cell: Cell, heading_rad: f64) -> bool {
    let vehicle = &world.vehicle;
    let gradient = gradient_at(world.elevation.view(), cell).unwrap();
    let theta = gradient.east.hypot(gradient.north).atan();
    let uphill_rad = gradient.north.atan2(gradient.east);
    let pitch = theta.tan() * (heading_rad - uphill_rad).cos();
    let roll = theta.tan() * (heading_rad - uphill_rad).sin();
    let class = SoilClass::ALL[usize::from(world.soil[cell])];
    let soil = Trafficability::of(vehicle, class, 18.0);
    let pull = pitch.atan().sin() / theta.cos();
    let room = 1e-6;
    let tips = match (vehicle.gauge_m, vehicle.centre_of_gravity_m) {
        (Some(gauge_m), Some(height_m)) => roll.abs() > gauge_m / 2.0 / height_m + room,
        _ => false,
    };
    pitch <= vehicle.grade_up + room
        && pitch >= -vehicle.grade_down - room
        && roll.abs() <= vehicle.side_slope + room
        && pitch <= soil.drawbar_grade + room
        && soil.rolling_resistance + pull <= vehicle.traction_friction + room
        && vehicle.braking_friction + pull > -room
        && !tips
}

proptest! {
    #[test]
    fn an_edge_costs_what_its_segment_costs_and_the_reversed_ground_the_way_back(world in world()) {
        let ground = world.ground(Cell::new(0, 0));
        let geometry = ground.geometry();
        let back = world.ground(Cell::new(0, 0)).reversed(geometry.centre(Cell::new(0, 0)));
        for cell in geometry.cells() {
            for (k, step) in SIXTEEN.iter().enumerate() {
                let edge = ground.edge_cost(cell, k);
                let Some(near) = step.from(&geometry, cell) else {
                    prop_assert!(edge.is_infinite());
                    continue;
                };
                prop_assert_eq!(back.edge_cost(near, (k + 8) % 16), edge);
                let [a, b] = [geometry.centre(cell), geometry.centre(near)];
                let facts = ground.segment(a, b);
                prop_assert_eq!(facts, back.segment(b, a));
                match facts {
                    Ok(facts) => {
                        prop_assert!((edge - facts.cost).abs() <= 1e-9 * facts.cost, "{edge} {facts:?}");
                        let least = ground.least_cost(a, b, a.distance_m(b));
                        prop_assert!(least <= edge * (1.0 + 1e-9), "{least} {edge}");
                        let Objective { time, energy, risk, .. } = world.objective;
                        if world.factor.is_none() {
                            let sum = time * facts.time_s + energy * facts.energy_j / world.vehicle.power_w + risk * facts.risk_s;
                            prop_assert!((sum - facts.cost).abs() <= 1e-9 * sum, "{sum} {facts:?}");
                        }
                    }
                    Err(obstacle) => prop_assert!(edge.is_infinite(), "{edge} {obstacle:?}"),
                }
            }
        }
    }

    #[test]
    fn the_bound_never_exceeds_a_step_and_the_bound_after_it(world in world(), goal in 0usize..360, reversed: bool) {
        let goal = world.elevation.geometry().cell(goal);
        let mut ground = world.ground(goal);
        let geometry = ground.geometry();
        if reversed {
            ground = ground.reversed(geometry.centre(goal));
        }
        for cell in geometry.cells() {
            for (k, step) in SIXTEEN.iter().enumerate() {
                if let Some(near) = step.from(&geometry, cell) {
                    let (bound, after) = (ground.bound(cell), ground.edge_cost(cell, k) + ground.bound(near));
                    prop_assert!(bound <= after * (1.0 + 1e-9) + 1e-9, "{bound} {after}");
                }
            }
        }
    }

    #[test]
    fn ways_are_optimal_and_shortcuts_keep_every_limit_and_never_cost_more(
        world in world(), a in 0usize..360, b in 0usize..360, reversed: bool,
    ) {
        let geometry = world.elevation.geometry();
        let (start, goal) = (geometry.cell(a), geometry.cell(b));
        let mut ground = world.ground(goal);
        if reversed {
            ground = ground.reversed(geometry.centre(goal));
        }
        let field = cost_field(&ground, start, &mut silent()).unwrap();
        match search(&ground, start, goal, &mut silent()) {
            Search::Unreachable => prop_assert!(field[b].is_infinite()),
            Search::Stopped => prop_assert!(false),
            Search::Found { cells, cost } => {
                prop_assert!((cost - field[b]).abs() <= 1e-9 * cost);
                let [from, to] = [start, goal].map(|cell| geometry.centre(cell));
                let bound = ground.least_cost(from, to, from.distance_m(to));
                prop_assert!(cost >= bound * (1.0 - 1e-9));
                let centres: Vec<_> = cells.iter().map(|&cell| geometry.centre(cell)).collect();
                let points = shorten(&ground, &centres);
                let mut total = 0.0;
                for pair in points.windows(2) {
                    let facts = ground.segment(pair[0], pair[1]);
                    prop_assert!(facts.is_ok(), "{:?}", facts);
                    total += facts.unwrap().cost;
                    let [from, to] = if reversed { [pair[1], pair[0]] } else { [pair[0], pair[1]] };
                    let heading_rad = (to.y_m - from.y_m).atan2(to.x_m - from.x_m);
                    pieces(&geometry, from, to, |piece| {
                        let kept = piece.end <= piece.start || keeps_every_limit(&world, piece.cell, heading_rad);
                        assert!(kept, "{:?} {heading_rad}", piece.cell);
                        true
                    });
                    let facts = facts.unwrap();
                    prop_assert!(facts.grade_max <= world.vehicle.grade_up + 1e-6);
                    prop_assert!(facts.grade_min >= -world.vehicle.grade_down - 1e-6);
                }
                prop_assert!(total <= cost * (1.0 + 1e-9));
                prop_assert_eq!((points[0], points[points.len() - 1]), (centres[0], centres[centres.len() - 1]));
            }
        }
    }

    #[test]
    fn a_way_costs_what_its_reverse_costs_on_the_reversed_ground(world in world(), a in 0usize..360, b in 0usize..360) {
        let geometry = world.elevation.geometry();
        let (start, goal) = (geometry.cell(a), geometry.cell(b));
        let there = search(&world.ground(goal), start, goal, &mut silent());
        let reversed = world.ground(goal).reversed(geometry.centre(start));
        match (there, search(&reversed, goal, start, &mut silent())) {
            (Search::Found { cost, .. }, Search::Found { cost: back, cells }) => {
                prop_assert!((cost - back).abs() <= 1e-9 * cost, "{cost} {back}");
                prop_assert_eq!((cells[0], cells[cells.len() - 1]), (goal, start));
            }
            (there, back) => prop_assert_eq!(there, back),
        }
    }

    #[test]
    fn what_quickens_the_search_changes_no_bit_of_a_cost(world in world(), a in 0usize..360, b in 0usize..360, reversed: bool) {
        let geometry = world.elevation.geometry();
        let (start, goal) = (geometry.cell(a), geometry.cell(b));
        let mut ground = world.ground(goal);
        if reversed {
            ground = ground.reversed(geometry.centre(goal));
        }
        let in_order = cost_field(&Plain(&ground), start, &mut silent()).unwrap();
        prop_assert_eq!(&cost_field(&ground, start, &mut silent()).unwrap(), &in_order);
        match search(&ground, start, goal, &mut silent()) {
            Search::Found { cost, cells } => {
                prop_assert_eq!(cost, in_order[b]);
                let step = |pair: &[Cell]| {
                    let k = SIXTEEN.iter().position(|step| step.from(&geometry, pair[0]) == Some(pair[1]));
                    ground.edge_cost(pair[0], k.unwrap())
                };
                prop_assert_eq!(cells.windows(2).map(step).fold(0.0, |sum, cost| sum + cost), cost);
            }
            _ => prop_assert!(in_order[b].is_infinite()),
        }
    }

    #[test]
    fn what_is_known_of_a_step_beforehand_holds(world in world(), reversed: bool) {
        let mut ground = world.ground(Cell::new(0, 0));
        let geometry = ground.geometry();
        if reversed {
            ground = ground.reversed(geometry.centre(Cell::new(0, 0)));
        }
        for cell in geometry.cells() {
            let surroundings = ground.surroundings(cell);
            for (k, step) in SIXTEEN.iter().enumerate() {
                let Some(near) = step.from(&geometry, cell) else { continue };
                let cost = ground.edge_cost(cell, k);
                prop_assert_eq!(ground.edge_cost_seen(cell, k, surroundings), cost);
                let least = ground.least_step(cell, near, k);
                prop_assert!(least.is_nan() || least <= cost, "{least} {cost}");
            }
        }
    }

    #[test]
    fn between_steady_grades_the_speed_is_the_soils(
        grade in -1.0f64..1.0, braking in 0.2f64..1.0, sight in 1.0f64..60.0, power in 0.05f64..2.0, large: bool,
    ) {
        let vehicle = if large { tractor() } else { pioneer() };
        let vehicle = Vehicle {
            braking_friction: braking,
            sight_distance_m: sight,
            power_w: power * vehicle.power_w,
            ..vehicle
        };
        for class in SoilClass::ALL {
            let soil = Trafficability::of(&vehicle, class, 18.0);
            let [low, high] = motion::steady_grades(&vehicle, &soil);
            for grade in [grade, low, high, f64::midpoint(low, high)] {
                if low <= grade && grade <= high {
                    prop_assert_eq!(speed_mps(&vehicle, &soil, grade), Some(soil.speed_mps));
                }
            }
        }
    }

    #[test]
    fn no_objective_opens_or_closes_a_step(world in world()) {
        let (ground, geometry) = (world.ground(Cell::new(0, 0)), world.elevation.geometry());
        let quickest = World { objective: Objective::default(), ..world.clone() };
        let quickest = quickest.ground(Cell::new(0, 0));
        for cell in geometry.cells() {
            for k in 0..16 {
                prop_assert_eq!(ground.edge_cost(cell, k).is_finite(), quickest.edge_cost(cell, k).is_finite());
            }
        }
    }
}

/// A straight ramp of gravel to the east, driven over 270 m; what it takes by the formulas of mechanics, worked out by hand.
#[rstest::rstest]
#[case::level(0.0)]
#[case::up(0.2)]
#[case::gently_down(-0.02)]
#[case::down(-0.25)]
fn time_and_energy_of_a_ramp_are_those_of_mechanics(#[case] grade: f64) {
    let geometry = GridGeometry::new(5, 40, 10.0, 0.0, 0.0).unwrap();
    let data = geometry.cells().map(|c| (grade * 10.0 * c.column as f64) as f32);
    let elevation = Layer::new(geometry, data.collect(), "ramp").unwrap();
    let soil = Layer::filled(geometry, SoilClass::Gravel as u8);
    let vehicle = Vehicle {
        power_w: 40.0,
        ..pioneer()
    };
    let resistance = Trafficability::of(&vehicle, SoilClass::Gravel, 18.0).rolling_resistance;
    let ground = ground(&elevation, &soil, &vehicle, Cell::new(0, 0));
    let [from, to] = [3, 30].map(|column| geometry.centre(Cell::new(2, column)));
    let facts = ground.segment(from, to).unwrap();
    let (run_m, rise_m) = (270.0f64, 270.0 * grade);
    let length_m = (run_m * run_m + rise_m * rise_m).sqrt();
    // Work on the way: rolling resistance on the weight's share across the slope, and lifting; 24 W reach the ground.
    let work_j = 20.0 * 9.80665 * (resistance * run_m + rise_m);
    let speed_mps = if work_j > 0.0 {
        (24.0 * length_m / work_j).min(0.7)
    } else {
        0.7
    };
    let time_s = length_m / speed_mps;
    let energy_j = work_j.max(0.0) / 0.6 + 15.0 * time_s;
    approx::assert_relative_eq!(facts.length_m, length_m, max_relative = 1e-5);
    approx::assert_relative_eq!(facts.time_s, time_s, max_relative = 1e-5);
    approx::assert_relative_eq!(facts.energy_j, energy_j, max_relative = 1e-5);
    if grade == 0.2 {
        // 0.043 + 0.2 of 196 N over 270 m against 24 W: 0.50 m/s, 546 s, 21.5 kJ on the ground and 8.2 kJ at idle.
        assert!((speed_mps - 0.513).abs() < 0.002, "{speed_mps}");
        assert!((energy_j - 29_500.0).abs() < 500.0, "{energy_j}");
    }
}

#[test]
fn every_objective_saves_what_it_is_about() {
    // A hill across the way: over it is shorter, around it level.
    let geometry = GridGeometry::new(41, 61, 10.0, 0.0, 0.0).unwrap();
    let heights = geometry.cells().map(|cell| {
        let (rows, columns) = (cell.row as f64 - 20.0, cell.column as f64 - 30.0);
        (20.0 * (-(rows * rows + columns * columns) / 100.0).exp()) as f32
    });
    let elevation = Layer::new(geometry, heights.collect(), "hill").unwrap();
    let soil = Layer::filled(geometry, SoilClass::Gravel as u8);
    let vehicle = pioneer();
    let (start, goal) = (Cell::new(20, 2), Cell::new(20, 58));
    // Closed ground along the way around to the south.
    let exposure = |cell: Cell| if cell.row > 24 { 1.0 } else { 0.0 };
    let facts = |time, energy, risk| {
        let objective = Objective {
            time,
            energy,
            risk,
            risk_distance_m: None,
        };
        let ground = ground(&elevation, &soil, &vehicle, goal)
            .with_objective(objective)
            .with_exposure(exposure);
        let Search::Found { cells, .. } = search(&ground, start, goal, &mut silent()) else {
            panic!("open ground has a way")
        };
        cells.windows(2).fold([0.0; 3], |[time, energy, risk], pair| {
            let [a, b] = [pair[0], pair[1]].map(|cell| geometry.centre(cell));
            let facts = ground.segment(a, b).unwrap();
            [time + facts.time_s, energy + facts.energy_j, risk + facts.risk_s]
        })
    };
    let quickest = facts(1.0, 0.0, 0.0);
    let thriftiest = facts(0.0, 1.0, 0.0);
    let safest = facts(1.0, 0.0, 1000.0);
    assert!(
        quickest[0] < thriftiest[0] && quickest[0] <= safest[0],
        "{quickest:?} {thriftiest:?}"
    );
    assert!(
        thriftiest[1] < quickest[1] && thriftiest[1] <= safest[1],
        "{thriftiest:?} {quickest:?}"
    );
    assert_eq!(safest[2], 0.0);
    let mixed = facts(1.0, 1.0, 0.0);
    assert!(mixed[0] <= thriftiest[0] && mixed[1] <= quickest[1]);
}

#[test]
fn an_objective_that_measures_nothing_is_refused() {
    let check = |time, energy, risk, risk_distance_m| {
        let objective = Objective {
            time,
            energy,
            risk,
            risk_distance_m,
        };
        objective.validate(10.0)
    };
    assert_eq!(check(1.0, 0.0, 2.0, Some(640.0)), Ok(()));
    for bad in [-1.0, f64::NAN, f64::INFINITY, 2e6] {
        assert!(check(bad, 1.0, 0.0, None).is_err() && check(1.0, bad, 0.0, None).is_err());
        assert!(check(1.0, 0.0, bad, None).is_err() && check(1.0, 0.0, 1.0, Some(1e3 * bad)).is_err());
    }
    let refused = check(0.0, 0.0, 1.0, None).unwrap_err().to_string();
    assert!(refused.contains("time or energy"), "{refused}");
}

#[test]
fn uphill_takes_longer_than_downhill_and_both_have_limits() {
    let geometry = GridGeometry::new(5, 40, 10.0, 0.0, 0.0).unwrap();
    let ramp = |grade: f64| {
        let data = geometry.cells().map(|c| (grade * 10.0 * c.column as f64) as f32);
        Layer::new(geometry, data.collect(), "ramp").unwrap()
    };
    let soil = Layer::filled(geometry, SoilClass::Gravel as u8);
    let vehicle = Vehicle {
        power_w: 40.0,
        ..pioneer()
    };
    let drive = |grade, from, to| {
        let elevation = ramp(grade);
        let ground = ground(&elevation, &soil, &vehicle, Cell::new(2, 0));
        let [from, to] = [from, to].map(|column| geometry.centre(Cell::new(2, column)));
        ground.segment(from, to)
    };
    let (up, down) = (drive(0.2, 3, 30).unwrap(), drive(0.2, 30, 3).unwrap());
    assert!(up.time_s > 1.01 * down.time_s && up.energy_j > down.energy_j);
    approx::assert_relative_eq!(up.climb_m, 54.0, epsilon = 1e-3);
    approx::assert_relative_eq!(up.grade_max, 0.2, epsilon = 1e-5);
    // 28 % is beyond the limit uphill and within it downhill.
    assert!(matches!(drive(0.28, 3, 30), Err(Obstacle::Grade(_, _))));
    assert!(drive(0.28, 30, 3).is_ok());
}

#[test]
fn side_slopes_bind_across_and_not_along() {
    let geometry = GridGeometry::new(20, 20, 10.0, 0.0, 0.0).unwrap();
    let data = geometry.cells().map(|c| (0.23 * 10.0 * c.column as f64) as f32);
    let elevation = Layer::new(geometry, data.collect(), "slope").unwrap();
    let (vehicle, soil) = (pioneer(), Layer::filled(geometry, 1u8));
    let ground = ground(&elevation, &soil, &vehicle, Cell::new(0, 0));
    let centre = |row, column| geometry.centre(Cell::new(row, column));
    assert!(ground.segment(centre(5, 5), centre(5, 15)).is_ok());
    assert!(matches!(
        ground.segment(centre(5, 5), centre(15, 5)),
        Err(Obstacle::SideSlope(_, slope)) if (slope - 0.23).abs() < 1e-4
    ));
}
