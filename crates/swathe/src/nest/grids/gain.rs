//! What a second grid gains: how often a gap in closed ground, wider than a navigation cell and narrower than two, is
//! found, counted on drawn ground and as an exact share.

use rayon::prelude::*;

use crate::grid::{GridGeometry, LayerView, Position};
use crate::random::{philox, unit};

use super::super::NestError;
use super::params::check_phases;
use super::{Footprint, GridMode, GridsParams, OverlappingGrids, Phase, RankCodes};

/// Terrain cells across a navigation cell: halves, thirds and quarters of it end on their edges.
const FINE: usize = 12;

/// Navigation cells across the drawn world, and its terrain cells.
const WORLD: usize = 4;
const WORLD_FINE: usize = WORLD * FINE;

/// Widest gap in navigation cells: every grid finds every wider one.
const SIDE_MAX: f64 = 2.0;

const TRIALS_MAX: u32 = 1_000_000;

/// The shape of a gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GapShape {
    /// A corridor from north to south: only its width is limited.
    Corridor,
    /// A square.
    Pocket,
}

/// Counts how many of `trials` gaps are found: ground is drawn closed but for one gap of `side_in_cells` navigation
/// cells whose place among the cells is random, grids are made from its terrain cells, and the gap counts as found when
/// some point of it is navigable. The same seed gives the same count.
///
/// # Errors
/// [`NestError::Figure`] for a side outside 0 to 2, phases that are none, or trials outside 1 to 1,000,000.
pub fn gaps_found(
    shape: GapShape,
    side_in_cells: f64,
    mode: GridMode,
    phases: &[Phase],
    trials: u32,
    seed: u64,
) -> Result<u32, NestError> {
    check(side_in_cells, phases)?;
    if !(1..=TRIALS_MAX).contains(&trials) {
        let (name, given) = ("number of trials", f64::from(trials));
        let allowed = "1 to 1000000 is allowed";
        return Err(NestError::Figure { name, given, allowed });
    }
    let params = GridsParams {
        mode,
        phases: phases.to_vec(),
        window_cells: WORLD + 2,
        // The side of a navigation cell is one metre.
        ..GridsParams::new(0.25)
    };
    let geometry = GridGeometry::new(WORLD_FINE, WORLD_FINE, 1.0 / FINE as f64, 0.0, 0.0)?;
    let point = Footprint::circle(0.0)?;
    let found = (0..trials).into_par_iter().map(|trial| {
        let [east, south, ..] = philox([trial, 0, 0, 0], seed);
        // The terrain cells that lie wholly inside the gap.
        let inside = |phase: f64| {
            let (from, to) = (1.0 + phase, 1.0 + phase + side_in_cells);
            (from * FINE as f64).ceil() as usize..((to * FINE as f64).floor() as usize).min(WORLD_FINE)
        };
        let columns = inside(unit(east));
        let (rows, looked_at) = match shape {
            GapShape::Corridor => (0..WORLD_FINE, FINE..2 * FINE),
            GapShape::Pocket => (inside(unit(south)), inside(unit(south))),
        };
        let mut codes = vec![1; WORLD_FINE * WORLD_FINE];
        for row in rows {
            // Empty when the gap is narrower than a terrain cell.
            if let Some(open) = codes.get_mut(row * WORLD_FINE + columns.start..row * WORLD_FINE + columns.end) {
                open.fill(10);
            }
        }
        let evidence = RankCodes(LayerView::new(geometry, &codes, "the drawn ground")?);
        let middle = WORLD as f64 / 2.0;
        let grids = OverlappingGrids::new(params.clone(), Position::new(middle, -middle), &evidence)?;
        let place = |cell: usize| (cell as f64 + 0.5) / FINE as f64;
        let mut places = looked_at.flat_map(|row| columns.clone().map(move |column| (place(column), -place(row))));
        let found = places.any(|(x_m, y_m)| grids.navigable(Position::new(x_m, y_m), 0.0, &point).navigable());
        Ok(u32::from(found))
    });
    found.sum()
}

/// The share of all places of a gap at which it is found, exactly: the area of places that some grid (every grid, for
/// [`GridMode::And`]) finds.
///
/// With `q = side_in_cells - 1` one grid finds a corridor with probability `q`, a pocket with `q²`. A second grid
/// moved by a quarter along both axes finds `2q` (`q` to 1/4), `q + 1/4` (to 3/4), then every corridor, but no more
/// than `2q² - max(0, q - 1/4, 2q - 1)²` of the pockets.
///
/// # Errors
/// [`NestError::Figure`] for a side outside 0 to 2 or phases that are none.
pub fn gap_share(shape: GapShape, side_in_cells: f64, mode: GridMode, phases: &[Phase]) -> Result<f64, NestError> {
    check(side_in_cells, phases)?;
    let spare = side_in_cells - 1.0;
    if spare <= 0.0 {
        return Ok(0.0);
    }
    let params = GridsParams {
        mode,
        phases: phases.to_vec(),
        ..GridsParams::new(1.0)
    };
    let phases = params.asked_phases();
    // A grid finds the gap along an axis when its next line comes within the spare length.
    let fits = |line: f64, gap: f64| (line - gap).rem_euclid(1.0) <= spare;
    // What is found changes only where a line, or its last place that fits, is passed.
    let steps = |shares: Vec<f64>| {
        let turns = shares
            .iter()
            .flat_map(|&share| [share, (share - spare).rem_euclid(1.0)]);
        let mut turns: Vec<f64> = turns.chain([0.0, 1.0]).collect();
        turns.sort_by(f64::total_cmp);
        let steps = turns
            .windows(2)
            .map(|pair| (f64::midpoint(pair[0], pair[1]), pair[1] - pair[0]));
        steps.collect::<Vec<_>>()
    };
    let east = steps(phases.iter().map(|phase| phase.east).collect());
    let south = match shape {
        GapShape::Corridor => vec![(0.0, 1.0)],
        GapShape::Pocket => steps(phases.iter().map(|phase| phase.south).collect()),
    };
    let mut share = 0.0;
    for &(x, width) in &east {
        for &(y, height) in &south {
            let finds = |phase: &Phase| fits(phase.east, x) && (shape == GapShape::Corridor || fits(phase.south, y));
            let found = match mode {
                GridMode::And => phases.iter().all(finds),
                GridMode::Or | GridMode::Single | GridMode::Exact16 => phases.iter().any(finds),
            };
            if found {
                share += width * height;
            }
        }
    }
    // The pieces of a whole may round to a little more.
    Ok(share.min(1.0))
}

fn check(side_in_cells: f64, phases: &[Phase]) -> Result<(), NestError> {
    if !(side_in_cells > 0.0 && side_in_cells <= SIDE_MAX) {
        let (name, given) = ("gap's side in navigation cells", side_in_cells);
        let allowed = "it must be above 0 and at most 2";
        return Err(NestError::Figure { name, given, allowed });
    }
    check_phases(phases)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nest::product_phases;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    const DIAGONAL: [Phase; 2] = [Phase::new(0.0, 0.0), Phase::new(0.25, 0.25)];

    fn share(shape: GapShape, spare: f64, phases: &[Phase]) -> f64 {
        gap_share(shape, 1.0 + spare, GridMode::Or, phases).unwrap()
    }

    /// One grid and a second a quarter or half cell on, along one axis.
    fn corridor(spare: f64, offset: f64) -> f64 {
        if spare <= offset {
            2.0 * spare
        } else {
            (spare + offset.min(1.0 - offset)).min(1.0)
        }
    }

    proptest! {
        #[test]
        fn shares_are_the_closed_forms(spare in 0.0f64..1.0) {
            let single = [Phase::new(0.0, 0.0)];
            let both = 2.0 * spare - corridor(spare, 0.25);
            let half = [Phase::new(0.0, 0.0), Phase::new(0.5, 0.5)];
            for (phases, corridors, pockets) in [
                (&single[..], spare, spare * spare),
                (&DIAGONAL[..], corridor(spare, 0.25), 2.0 * spare * spare - both * both),
                (&half[..], corridor(spare, 0.5), 2.0 * spare * spare - (2.0 * spare - 1.0).max(0.0).powi(2)),
                (&product_phases(&[0.0, 0.5]), corridor(spare, 0.5), corridor(spare, 0.5).powi(2)),
                (&product_phases(&[0.0, 0.25]), corridor(spare, 0.25), corridor(spare, 0.25).powi(2)),
            ] {
                assert_relative_eq!(share(GapShape::Corridor, spare, phases), corridors, epsilon = 1e-12);
                assert_relative_eq!(share(GapShape::Pocket, spare, phases), pockets, epsilon = 1e-12);
            }
            let cautious = gap_share(GapShape::Corridor, 1.0 + spare, GridMode::And, &DIAGONAL).unwrap();
            assert_relative_eq!(cautious, both, epsilon = 1e-12);
            let exact = gap_share(GapShape::Pocket, 1.0 + spare, GridMode::Exact16, &DIAGONAL).unwrap();
            assert_relative_eq!(exact, (4.0 * spare).min(1.0).powi(2), epsilon = 1e-12);
        }

        #[test]
        fn evenly_spaced_phases_find_everything_from_one_nth_above_a_cell(n in 1usize..=8) {
            let shares: Vec<f64> = (0..n).map(|i| i as f64 / n as f64).collect();
            let spare = 1.0 / n as f64;
            let found = share(GapShape::Pocket, spare, &product_phases(&shares));
            assert_relative_eq!(found, 1.0, epsilon = 1e-9);
            prop_assert!(share(GapShape::Pocket, 0.9 * spare, &product_phases(&shares)) < 0.9);
        }
    }

    #[test]
    fn the_published_figures_hold_and_the_diagonal_guarantees_nothing_below_two_cells() {
        for (spare, one, two) in [(0.25, 0.0625, 0.125), (0.5, 0.25, 0.4375), (0.75, 0.5625, 0.875)] {
            assert_relative_eq!(share(GapShape::Pocket, spare, &DIAGONAL[..1]), one, epsilon = 1e-12);
            assert_relative_eq!(share(GapShape::Pocket, spare, &DIAGONAL), two, epsilon = 1e-12);
        }
        assert!(share(GapShape::Pocket, 0.99, &DIAGONAL) < 1.0);
        assert_relative_eq!(share(GapShape::Corridor, 0.75, &DIAGONAL), 1.0);
        assert!(share(GapShape::Corridor, 0.74, &DIAGONAL) < 1.0);
    }

    #[test]
    fn counts_on_drawn_ground_agree_with_the_shares() {
        const TRIALS: u32 = 3000;
        let (half, quarter) = (product_phases(&[0.0, 0.5]), product_phases(&[0.0, 0.25]));
        let thirds = product_phases(&[0.0, 1.0 / 3.0, 2.0 / 3.0]);
        let cases: [(GridMode, &[Phase]); 7] = [
            (GridMode::Single, &DIAGONAL),
            (GridMode::Or, &DIAGONAL),
            (GridMode::And, &DIAGONAL),
            (GridMode::Or, &half),
            (GridMode::Or, &quarter),
            (GridMode::Or, &thirds),
            (GridMode::Exact16, &DIAGONAL),
        ];
        for shape in [GapShape::Corridor, GapShape::Pocket] {
            for (mode, phases) in cases {
                for side in [1.0, 1.125, 1.25, 1.5, 1.75, 2.0] {
                    let expected = gap_share(shape, side, mode, phases).unwrap();
                    let found = f64::from(gaps_found(shape, side, mode, phases, TRIALS, 7).unwrap());
                    let deviation = (expected * (1.0 - expected) / f64::from(TRIALS)).sqrt();
                    let off = (found / f64::from(TRIALS) - expected).abs();
                    assert!(
                        off <= 4.0 * deviation + 1e-9,
                        "{shape:?} {mode:?} {phases:?} {side}: {found} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn figures_outside_their_range_are_refused_and_narrow_gaps_are_never_found() {
        for side in [0.0, -1.0, 2.01, f64::NAN] {
            assert!(gaps_found(GapShape::Pocket, side, GridMode::Or, &DIAGONAL, 10, 0).is_err());
            assert!(gap_share(GapShape::Pocket, side, GridMode::Or, &DIAGONAL).is_err());
        }
        assert!(gaps_found(GapShape::Pocket, 1.5, GridMode::Or, &[], 10, 0).is_err());
        assert!(gaps_found(GapShape::Pocket, 1.5, GridMode::Or, &DIAGONAL, 0, 0).is_err());
        for side in [0.01, 0.5, 0.99] {
            assert_eq!(
                gaps_found(GapShape::Pocket, side, GridMode::Or, &DIAGONAL, 50, 0),
                Ok(0)
            );
        }
    }
}
