//! Ways of the footprint itself.

use proptest::prelude::*;
use rstest::rstest;

use super::world::vehicle;
use crate::drive::DriveParams;
use crate::drive::memory::{Memory, Seen};
use crate::drive::params::Shape;
use crate::drive::thread::{Effort, Leg, Met, Search, Threading, after, on_run};
use crate::grid::Position;
use crate::local::{CertaintyGrid, CertaintyParams};
use crate::sensor::{Pose, wrap};

/// A wall from south to north at x = 2 with a gap around y = 0, met to the last part of its cells.
fn wall_with_gap(grid: &CertaintyGrid, gap_m: f64) -> Met {
    let mut met = Met::new();
    for step in -400..=400 {
        let y_m = f64::from(step) * 0.0125;
        if y_m.abs() >= gap_m / 2.0 {
            let cell = grid.cell_of(2.0, y_m);
            let part = |along: f64| ((along / 0.1).rem_euclid(1.0) * 8.0) as u32;
            *met.entry(cell).or_default() |= 1 << (part(-y_m) * 8 + part(2.0));
        }
    }
    met
}

fn found(shape: &Shape, gap_m: f64) -> Option<Vec<Leg>> {
    let grid = CertaintyGrid::new(CertaintyParams::default(), 0.0, 0.0);
    let mut memory = Memory::new(0.2, 100);
    for row in -100..100 {
        for column in -100..100 {
            memory.set((row, column), Seen::Free);
        }
    }
    let met = wall_with_gap(&grid, gap_m);
    let known = (&met, &memory, &grid);
    let goal = (Position::new(4.0, 1.0), 0.35);
    let mut search = Search::new(known, shape, &Pose::level(0.0, 0.0, 0.4), goal, Effort::Tight);
    for _ in 0..400 {
        match search.go_on() {
            Threading::On => {}
            Threading::Found(legs) => return Some(legs),
            Threading::Nothing { .. } => return None,
        }
    }
    None
}

#[rstest]
#[case(0.0)]
#[case(0.6)]
fn a_gap_narrower_than_the_circle_is_found_and_kept_clear_of(#[case] turn_radius_m: f64) {
    // The circle around it is 1.08 m wide.
    let vehicle = vehicle(1.0, 0.4, 1.0, turn_radius_m);
    let shape = Shape::of(&vehicle, &DriveParams::default());
    let legs = found(&shape, 0.64).expect("the rectangle fits through");
    let mut at = (0.0, 0.0, 0.4);
    for leg in legs {
        match leg {
            Leg::Turn { to_rad } => at.2 = to_rad,
            Leg::Run {
                from,
                curvature_per_m,
                length_m,
            } => {
                assert!((from.0 - at.0).hypot(from.1 - at.1) < 1e-6 && wrap(from.2 - at.2).abs() < 1e-6);
                for k in 0..=100 {
                    let (x_m, y_m, heading_rad) = after(from, curvature_per_m, length_m * f64::from(k) / 100.0);
                    for step in -400..=400_i32 {
                        let (wall_x_m, wall_y_m) = (2.0, f64::from(step) * 0.0125);
                        if wall_y_m.abs() < 0.32 {
                            continue;
                        }
                        let (dx, dy) = (wall_x_m - x_m, wall_y_m - y_m);
                        let (sin, cos) = heading_rad.sin_cos();
                        let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
                        assert!((ahead.abs() - 0.5).max(left.abs() - 0.2) > 0.0);
                    }
                }
                at = after(from, curvature_per_m, length_m);
            }
        }
    }
    assert!((at.0 - 4.0).hypot(at.1 - 1.0) <= 0.35 + 1e-9);
}

#[test]
fn a_gap_narrower_than_the_footprint_is_not() {
    let shape = Shape::of(&vehicle(1.0, 0.4, 1.0, 0.0), &DriveParams::default());
    // The wall ends 5 m away on both sides: a way around it would be longer than the search's cells reach.
    let legs = found(&shape, 0.36);
    let goes_through = legs.is_some_and(|legs| {
        legs.iter()
            .any(|leg| matches!(leg, Leg::Run { from, .. } if (from.0 - 2.0).abs() < 0.5 && from.1.abs() < 4.0))
    });
    assert!(!goes_through);
}

proptest! {
    #[test]
    fn where_a_robot_is_on_an_arc_is_where_the_arc_leads(
        curvature in -1.0..1.0_f64, way_m in 0.0..2.0_f64, backs: bool, heading_rad in -3.0..3.0_f64, off_m in -0.2..0.2_f64,
    ) {
        let from = (1.0, -2.0, heading_rad);
        let (x_m, y_m, on_rad) = after(from, curvature, if backs { -way_m } else { way_m });
        // A little to the left of it.
        let pose = Pose::level(x_m - off_m * on_rad.sin(), y_m + off_m * on_rad.cos(), on_rad);
        let (along_m, left_m, off_rad) = on_run(&pose, from, curvature, backs);
        prop_assert!((along_m - way_m).abs() < 1e-6 && (left_m - off_m).abs() < 1e-6 && off_rad.abs() < 1e-6);
    }
}
