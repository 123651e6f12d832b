//! Laws of the certainty grid.

use super::*;
use crate::sensor::Mount;
use proptest::prelude::*;
use rstest::rstest;
use std::f64::consts::PI;

fn beam(range_m: f64) -> Scan {
    Scan {
        ranges_m: vec![range_m],
        angle_min_rad: 0.0,
        angle_increment_rad: 0.0,
        range_min_m: 0.1,
        range_max_m: 5.0,
        mount: Mount::default(),
    }
}

fn grid(evidence: Evidence, fade_s: f64) -> CertaintyGrid {
    let params = CertaintyParams {
        side_cells: 41,
        evidence,
        fade_s,
        ..CertaintyParams::default()
    };
    CertaintyGrid::new(params, 0.05, 0.05)
}

fn look(grid: &mut CertaintyGrid, pose: &Pose, scan: &Scan) {
    grid.observe(pose, scan, |index| scan.beam(index));
}

#[test]
fn himm_adds_three_at_the_hit_and_takes_one_before_it() {
    let mut grid = grid(Evidence::himm(), f64::INFINITY);
    let pose = Pose::level(0.05, 0.05, 0.0);
    for _ in 0..2 {
        look(&mut grid, &pose, &beam(1.0));
    }
    assert_eq!(grid.certainty_at(1.05, 0.05), Some(6));
    assert_eq!(grid.certainty_at(0.55, 0.05), Some(0));
    assert_eq!(grid.certainty_at(1.15, 0.05), None);
    // The obstacle goes: the cell is crossed and loses one a scan.
    look(&mut grid, &pose, &beam(1.5));
    assert_eq!(grid.certainty_at(1.05, 0.05), Some(5));
    for _ in 0..9 {
        look(&mut grid, &pose, &beam(1.0));
    }
    assert_eq!(grid.certainty_at(1.05, 0.05), Some(15));
}

#[test]
fn log_odds_follow_the_formula_and_stay_between_the_clamps() {
    let mut grid = grid(Evidence::default(), f64::INFINITY);
    let pose = Pose::level(0.05, 0.05, 0.0);
    look(&mut grid, &pose, &beam(1.0));
    // One hit: p = 0.7, 15 (2p - 1) = 6.
    assert_eq!(grid.certainty_at(1.05, 0.05), Some(6));
    look(&mut grid, &pose, &beam(1.0));
    // Two: odds (7/3)², p = 0.845, 10.3.
    assert_eq!(grid.certainty_at(1.05, 0.05), Some(10));
    for _ in 0..20 {
        look(&mut grid, &pose, &beam(1.0));
    }
    assert_eq!(grid.certainty_at(1.05, 0.05), Some(14));
    // From 0.97, crossed nine times, less than even odds are left.
    for _ in 0..9 {
        look(&mut grid, &pose, &beam(1.5));
    }
    assert_eq!(grid.certainty_at(1.05, 0.05), Some(0));
}

#[test]
fn a_hit_wins_over_other_beams_of_the_same_scan_and_clear_beams_only_clear() {
    let mut grid = grid(Evidence::himm(), f64::INFINITY);
    let mut fan = beam(1.0);
    fan.ranges_m = vec![1.5, 1.0, 1.5, f64::INFINITY, f64::NAN];
    look(&mut grid, &Pose::level(0.05, 0.05, 0.0), &fan);
    assert_eq!(grid.certainty_at(1.05, 0.05), Some(3));
    assert_eq!(grid.certainty_at(1.55, 0.05), Some(3));
    assert_eq!(grid.certainty_at(1.85, 0.05), Some(0));
}

#[test]
fn ground_is_no_obstacle() {
    let mut grid = grid(Evidence::himm(), f64::INFINITY);
    let scan = beam(1.0);
    grid.observe(&Pose::level(0.05, 0.05, 0.0), &scan, |_| Return::Ground {
        range_m: 1.0,
    });
    assert_eq!(grid.certainty_at(0.95, 0.05), Some(0));
    assert_eq!(grid.certainty_at(1.05, 0.05), None);
}

#[test]
fn evidence_fades() {
    let mut grid = grid(Evidence::himm(), 30.0);
    grid.stamp(1.0, 1.0);
    assert_eq!(grid.certainty_at(1.0, 1.0), Some(15));
    grid.fade(30.0);
    // 15 / e is 5.5.
    assert!(matches!(grid.certainty_at(1.0, 1.0), Some(5 | 6)));
    grid.fade(f64::INFINITY);
    assert_eq!(grid.certainty_at(1.0, 1.0), Some(0));
    assert_eq!(grid.changed().len(), 2);
}

#[rstest]
fn evidence_fades_in_its_time_however_small_the_steps(
    #[values(Evidence::himm(), Evidence::default())] evidence: Evidence,
    #[values(0.5, 30.0, 1e5)] fade_s: f64,
    #[values(1.0 / 35.0, 0.1, 2.0)] step_s: f64,
) {
    let mut grid = grid(evidence, fade_s);
    for row in -15..=15 {
        for column in -15..=15 {
            grid.stamp(0.1 * f64::from(column), 0.1 * f64::from(row));
        }
    }
    let level = |grid: &CertaintyGrid| {
        let cells: Vec<_> = grid
            .seen()
            .map(|(x, y, _)| grid.index(grid.lattice(x, y)).unwrap())
            .collect();
        cells
            .iter()
            .map(|&index| f64::from(grid.counts.get(index).level))
            .sum::<f64>()
            / cells.len() as f64
    };
    let before = level(&grid);
    let steps = (30.0 / step_s).round();
    for _ in 0..steps as usize {
        grid.fade(step_s);
    }
    // The last of it may not have been due yet.
    let faded_s = steps * step_s - grid.unfaded_s;
    assert!(grid.unfaded_s < fade_s / 64.0);
    let (share, wanted) = (level(&grid) / before, (-faded_s / fade_s).exp());
    assert!((share - wanted).abs() < 0.02, "{share} {wanted}");
}

proptest! {
    #[test]
    fn moving_keeps_what_stays_in_the_window_and_forgets_the_rest(
        places in prop::collection::vec((-1.9f64..1.9, -1.9f64..1.9), 1..20),
        moves in prop::collection::vec((-1.5f64..1.5, -1.5f64..1.5), 1..6),
    ) {
        let mut grid = grid(Evidence::himm(), f64::INFINITY);
        for &(x_m, y_m) in &places {
            grid.stamp(x_m, y_m);
        }
        let mut kept: Vec<_> = places.iter().map(|&(x, y)| grid.lattice(x, y)).collect();
        let (mut x_m, mut y_m) = (0.05, 0.05);
        for (right, up) in moves {
            (x_m, y_m) = (x_m + right, y_m + up);
            grid.move_to(x_m, y_m);
            kept.retain(|&cell| grid.index(cell).is_some());
        }
        kept.sort_unstable();
        kept.dedup();
        let mut seen: Vec<_> = grid.seen().map(|(x, y, certainty)| {
            assert_eq!(certainty, 15);
            grid.lattice(x, y)
        }).collect();
        seen.sort_unstable();
        prop_assert_eq!(seen, kept);
    }

    #[test]
    fn a_beam_crosses_the_cells_that_its_points_lie_in(
        x in -0.5f64..0.5, y in -0.5f64..0.5, heading in -PI..PI, range in 0.2f64..1.4,
    ) {
        let mut grid = grid(Evidence::himm(), f64::INFINITY);
        look(&mut grid, &Pose::level(x, y, heading), &beam(range));
        let last = grid.lattice(x + range * heading.cos(), y + range * heading.sin());
        for part in 0..1000 {
            let along = range * f64::from(part) / 1000.0;
            let (px, py) = (x + along * heading.cos(), y + along * heading.sin());
            let is_last = grid.lattice(px, py) == last;
            let certainty = grid.certainty_at(px, py);
            // A point next to a border may be rounded to the other side of it.
            let near = |v: f64| { let f = (v / 0.1).rem_euclid(1.0); !(1e-6..=1.0 - 1e-6).contains(&f) };
            let expected = if is_last { 3 } else { 0 };
            prop_assert!(certainty == Some(expected) || near(px) || near(py));
        }
        let seen = grid.seen().count() as i64;
        let first = grid.lattice(x, y);
        prop_assert_eq!(seen, (last.0 - first.0).abs() + (last.1 - first.1).abs() + 1);
    }

    #[test]
    fn a_beam_that_leaves_the_window_crosses_its_cells_up_to_the_border(
        x in -1.9f64..1.9, y in -1.9f64..1.9, heading in -PI..PI, range in 4.5f64..8.0,
    ) {
        let mut grid = grid(Evidence::himm(), f64::INFINITY);
        let mut scan = beam(range);
        scan.range_max_m = 10.0;
        look(&mut grid, &Pose::level(x, y, heading), &scan);
        let mut crossed: Vec<(i64, i64)> = Vec::new();
        let cell_at = |along: f64| grid.lattice(x + along * heading.cos(), y + along * heading.sin());
        // No farther than the window is wide.
        let last = cell_at(4.1);
        for part in 0..20_000 {
            let cell = cell_at(4.1 * f64::from(part) / 20_000.0);
            if crossed.last() != Some(&cell) && cell != last && grid.index(cell).is_some() {
                crossed.push(cell);
            }
        }
        prop_assert!(crossed.iter().all(|&cell| grid.certainty_of(cell) == Some(0)));
        // A corner may be cut between two of the points.
        prop_assert!(grid.seen().count() <= crossed.len() + 2);
    }

    #[test]
    fn no_scan_can_break_the_grid(
        ranges in prop::collection::vec(prop::num::f64::ANY, 0..50),
        x in -1e3f64..1e3, y in -1e3f64..1e3, heading in -10.0f64..10.0,
    ) {
        let mut grid = grid(Evidence::default(), f64::INFINITY);
        let mut scan = beam(1.0);
        scan.angle_increment_rad = 0.1;
        scan.ranges_m = ranges;
        look(&mut grid, &Pose::level(x, y, heading), &scan);
        let mut window = vec![0; 33 * 33];
        grid.copy_window(x, y, 33, &mut window);
        prop_assert!(window.iter().all(|&certainty| certainty <= CERTAINTY_MAX));
    }
}

#[test]
fn a_corner_stays_when_beams_cross_the_rest_of_its_cell() {
    let mut grid = grid(Evidence::default(), f64::INFINITY);
    let met = Pose::level(0.05, 0.015, 0.0);
    for _ in 0..10 {
        look(&mut grid, &met, &beam(1.0));
    }
    let sure = grid.certainty_at(1.05, 0.05);
    assert_eq!(sure, Some(14));
    // Seven centimetres beside it the way is free.
    for _ in 0..30 {
        look(&mut grid, &Pose::level(0.05, 0.085, 0.0), &beam(1.5));
    }
    assert_eq!(grid.certainty_at(1.05, 0.05), sure);
    // Through the place itself it is not there any more.
    for _ in 0..9 {
        look(&mut grid, &met, &beam(1.5));
    }
    assert_eq!(grid.certainty_at(1.05, 0.05), Some(0));
}

#[test]
fn what_is_near_is_kept_when_the_rest_is_forgotten() {
    let mut grid = grid(Evidence::default(), f64::INFINITY);
    for range_m in [0.5, 1.5] {
        for _ in 0..5 {
            look(&mut grid, &Pose::level(0.05, range_m - 0.45, 0.0), &beam(range_m));
        }
    }
    let told = |grid: &CertaintyGrid| [grid.certainty_at(0.55, 0.05), grid.certainty_at(1.55, 1.05)];
    let before = told(&grid);
    assert!(before.iter().all(|&certainty| certainty > Some(0)));
    grid.clear_beyond(0.05, 0.05, 0.9);
    assert_eq!(told(&grid), [before[0], None]);
}

#[test]
fn what_was_met_from_a_doubtful_pose_goes_when_beams_pass_beside_it() {
    let certainty_after = |doubt: PoseDoubt| {
        let mut grid = grid(Evidence::default(), f64::INFINITY);
        for _ in 0..10 {
            look(&mut grid, &Pose::level(0.05, 0.015, 0.0), &beam(1.0));
        }
        grid.doubt_poses(doubt);
        for _ in 0..10 {
            look(&mut grid, &Pose::level(0.05, 0.085, 0.0), &beam(1.5));
        }
        grid.certainty_at(1.05, 0.05)
    };
    assert_eq!(certainty_after(PoseDoubt::default()), Some(14));
    // Seven centimetres aside at a metre.
    for (place_m, heading_rad) in [(0.07, 0.0), (0.0, 0.07)] {
        assert_eq!(certainty_after(PoseDoubt { place_m, heading_rad }), Some(0));
    }
}

proptest! {
    #[test]
    fn what_goes_away_is_forgotten_by_a_sensor_that_stands_still(x_m in 0.6..1.6_f64, y_m in -1.2..1.2_f64, radius_m in 0.1..0.3_f64) {
        let mut grid = grid(Evidence::default(), f64::INFINITY);
        let pose = Pose::level(0.05, 0.05, 0.0);
        let beams = 181;
        let mut fan = Scan {
            angle_min_rad: -PI / 2.0,
            angle_increment_rad: PI / 180.0,
            ..beam(1.0)
        };
        let there = |k: usize| {
            let (sin, cos) = (-PI / 2.0 + PI / 180.0 * k as f64).sin_cos();
            let (dx, dy) = (x_m - 0.05, y_m - 0.05);
            let (along, aside) = (dx * cos + dy * sin, dy * cos - dx * sin);
            if aside.abs() < radius_m && along > 0.0 {
                along - (radius_m * radius_m - aside * aside).sqrt()
            } else {
                f64::INFINITY
            }
        };
        fan.ranges_m = (0..beams).map(there).collect();
        for _ in 0..10 {
            look(&mut grid, &pose, &fan);
        }
        prop_assert!(grid.seen().any(|(_, _, certainty)| certainty >= 6));
        fan.ranges_m = vec![f64::INFINITY; beams];
        for _ in 0..12 {
            look(&mut grid, &pose, &fan);
        }
        let left: Vec<_> = grid.seen().filter(|&(_, _, certainty)| certainty >= 3).collect();
        prop_assert!(left.is_empty(), "{left:?}");
    }
}

#[test]
fn where_the_robot_stands_nothing_else_does_unless_it_was_met_there() {
    for evidence in [Evidence::default(), Evidence::himm()] {
        let mut grid = grid(evidence, f64::INFINITY);
        grid.stamp(0.05, 0.25);
        let quarter_rad = PI / 2.0;
        grid.stand_on(&Pose::level(0.05, 0.05, quarter_rad), 0.52, 0.22);
        assert_eq!(grid.certainty_at(0.05, 0.45), Some(0));
        assert_eq!(grid.certainty_at(0.05, -0.45), Some(0));
        assert_eq!(grid.certainty_at(0.25, 0.05), Some(0));
        assert_eq!(grid.certainty_at(0.35, 0.05), None);
        assert_eq!(grid.certainty_at(0.05, 0.65), None);
        assert!(grid.certainty_at(0.05, 0.25) > Some(10));
        // All but the one that was known.
        assert_eq!(grid.changed().len(), 11 * 5 - 1);
        let known = grid.seen().count();
        grid.stand_on(&Pose::level(0.05, 0.05, quarter_rad), 0.52, 0.22);
        assert_eq!((grid.changed().len(), grid.seen().count()), (0, known));
    }
}

/// Cells by which a straight line passes from border to border, all but the last (Amanatides and Woo 1987).
fn crossed(grid: &CertaintyGrid, from: (f64, f64), to: (f64, f64)) -> Vec<(i64, i64)> {
    let (mut cell, last) = (grid.lattice(from.0, from.1), grid.lattice(to.0, to.1));
    let size = grid.params.cell_size_m;
    let along = [(from.1 - to.1) / size, (to.0 - from.0) / size];
    let place = [-from.1 / size, from.0 / size];
    let mut found = Vec::new();
    while cell != last && found.len() < 1000 {
        found.push(cell);
        let border = |axis: usize, cell: i64| {
            let border = if along[axis] > 0.0 { cell + 1 } else { cell };
            (border as f64 - place[axis]) / along[axis]
        };
        if border(0, cell.0) < border(1, cell.1) {
            cell.0 += along[0].signum() as i64;
        } else {
            cell.1 += along[1].signum() as i64;
        }
    }
    found
}

/// A step of [`scans_count_as_if_every_cell_of_every_beam_was_looked_at`].
#[derive(Clone, Debug)]
enum Deed {
    /// From a place of the window, in parts of it, and a heading.
    Look((f64, f64), f64, Vec<f64>),
    Move(f64, f64),
    Forget(f64),
    Stand,
}

fn deed() -> impl Strategy<Value = Deed> {
    let range_m = prop_oneof![1 => 0.2f64..4.0, 2 => Just(9.0)];
    let place = (0.01f64..0.99, 0.01f64..0.99);
    prop_oneof![
        8 => (place, -PI..PI, prop::collection::vec(range_m, 20..90)).prop_map(|(at, to, ranges_m)| Deed::Look(at, to, ranges_m)),
        2 => (-0.8f64..0.8, -0.8f64..0.8).prop_map(|(x_m, y_m)| Deed::Move(x_m, y_m)),
        1 => (0.0f64..2.0).prop_map(Deed::Forget),
        1 => Just(Deed::Stand),
    ]
}

proptest! {
    #[test]
    fn scans_count_as_if_every_cell_of_every_beam_was_looked_at(
        side_cells in prop::sample::select(vec![3usize, 7, 15, 31, 41, 63]), x_m in -1e4f64..1e4, y_m in -1e4f64..1e4,
        deeds in prop::collection::vec(deed(), 1..20), is_himm: bool,
    ) {
        let evidence = if is_himm { Evidence::himm() } else { Evidence::default() };
        let params = CertaintyParams { side_cells, evidence, ..CertaintyParams::default() };
        let mut grid = CertaintyGrid::new(params, x_m, y_m);
        let half = grid.side / 2;
        let side_m = grid.side as f64 * 0.1;
        let mut levels: std::collections::BTreeMap<(i64, i64), i16> = std::collections::BTreeMap::new();
        let certainties = |levels: &std::collections::BTreeMap<_, i16>, of: &Levels| -> Vec<((i64, i64), u8)> {
            levels.iter().map(|(&cell, &level)| (cell, of.certainty(level))).collect()
        };
        for deed in deeds {
            let (west_m, north_m) = (grid.middle_m().0 - side_m / 2.0, grid.middle_m().1 + side_m / 2.0);
            let before = certainties(&levels, &grid.levels);
            match deed {
                Deed::Move(right_m, up_m) => {
                    let (x_m, y_m) = grid.middle_m();
                    grid.move_to(x_m + right_m, y_m + up_m);
                    levels.retain(|&cell, _| grid.index(cell).is_some());
                }
                Deed::Forget(near_m) => {
                    let (x_m, y_m) = grid.middle_m();
                    grid.clear_beyond(x_m, y_m, near_m);
                    let (reach, (row, column)) = ((near_m / 0.1).ceil() as i64, grid.lattice(x_m, y_m));
                    levels.retain(|cell, _| (cell.0 - row).abs() <= reach && (cell.1 - column).abs() <= reach);
                }
                Deed::Stand => {
                    let (x_m, y_m) = grid.middle_m();
                    grid.stand_on(&Pose::level(x_m, y_m, 0.0), 0.16, 0.06);
                    let (row, column) = grid.lattice(x_m, y_m);
                    for cell in (row - 1..=row + 1).flat_map(|row| (column - 1..=column + 1).map(move |column| (row, column))) {
                        if cell.0 == row {
                            levels.entry(cell).or_insert(0);
                        }
                    }
                }
                Deed::Look((right, down), heading_rad, ref ranges_m) => {
                    let pose = Pose::level(west_m + right * side_m, north_m - down * side_m, heading_rad);
                    let fan = Scan { ranges_m: ranges_m.clone(), angle_increment_rad: 0.07, ..beam(1.0) };
                    look(&mut grid, &pose, &fan);
                    let ends: Vec<(f64, f64, bool)> = (0..fan.ranges_m.len())
                        .filter_map(|beam| {
                            let told = fan.beam(beam);
                            let range_m = told.range_m()?;
                            let end = fan.end_of(beam, range_m.min(side_m), &pose);
                            Some((end.x_m, end.y_m, matches!(told, Return::Obstacle { .. }) && range_m <= side_m))
                        })
                        .collect();
                    let mut counted = std::collections::BTreeSet::new();
                    let mut count = |cell: (i64, i64), change: i16| {
                        if (cell.0 - grid.middle.0).abs() <= half && (cell.1 - grid.middle.1).abs() <= half && counted.insert(cell) {
                            let level = levels.entry(cell).or_insert(0);
                            *level = (*level + change).clamp(grid.levels.low, grid.levels.high);
                        }
                    };
                    for end in ends.iter().filter(|end| end.2) {
                        count(grid.lattice(end.0, end.1), grid.levels.hit);
                    }
                    for end in &ends {
                        for cell in crossed(&grid, (pose.x_m, pose.y_m), (end.0, end.1)) {
                            count(cell, -grid.levels.miss);
                        }
                    }
                }
            }
            // Log-odds tell nothing of a cell in which something stands beside the beam; there the grid itself is asked.
            for (&cell, level) in &mut levels {
                if !is_himm && let Some(index) = grid.index(cell) && grid.met[index].hits > 0 {
                    *level = grid.counts.get(index).known_level();
                }
            }
            let after = certainties(&levels, &grid.levels);
            let mut seen: Vec<_> = grid.seen().map(|(x_m, y_m, certainty)| (grid.lattice(x_m, y_m), certainty)).collect();
            seen.sort_unstable();
            prop_assert_eq!(&seen, &after);
            if matches!(deed, Deed::Look(..) | Deed::Stand) {
                let mut changed = grid.changed().to_vec();
                changed.sort_unstable();
                let differs: Vec<_> = after.iter().filter(|told| !before.contains(told)).map(|told| told.0).collect();
                prop_assert_eq!(changed, differs);
            }
        }
    }
}
