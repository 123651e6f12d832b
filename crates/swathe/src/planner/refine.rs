//! Refinement: a way's vertices leave the cell centres as long as the integrated cost falls.

use crate::grid::Position;
use crate::progress::Report;

use super::any_angle::{AnyAngle, Way};
use super::smooth::shorten;

/// Passes at one step length before it is halved.
const MOST_PASSES: usize = 6;

/// Least relative gain of a pass that counts as one.
const LEAST_GAIN: f64 = 1e-6;

/// Shortest segments that a way is divided into, in cells.
const FINEST_CELLS: f64 = 2.0;

/// Shortest sideways move, in cells.
const LEAST_SHIFT_CELLS: f64 = 1.0 / 64.0;

/// Shortest move of a single vertex, in cells.
const LEAST_MOVE_CELLS: f64 = 1.0 / 4096.0;

/// Moves, adds and drops vertices of a way while its cost falls; the ends stay. `None` when the caller asked to stop.
///
/// From coarse to fine the way is divided into short segments and all inner vertices are shifted sideways together, by the
/// choice of left, middle or right that costs least along the whole way (dynamic programming). Then single vertices are
/// moved, also those put where the ground changes abruptly: there a cheapest way refracts. Finds a local minimum.
pub(super) fn refine(graph: &impl AnyAngle, way: &[Position], report: &mut Report) -> Option<Way> {
    let cell_m = graph.geometry().cell_size_m();
    let mut best = Way::of(graph, way.to_vec());
    take_if_cheaper(graph, &mut best, way);
    if !best.cost.is_finite() || best.points.len() < 2 {
        return Some(best);
    }
    let length_m: f64 = best.points.windows(2).map(|pair| pair[0].distance_m(pair[1])).sum();
    let mut spacing_m = length_m / 2.0;
    let mut passes = 0;
    while spacing_m >= FINEST_CELLS * cell_m {
        let mut points = divided(&best.points, spacing_m);
        let mut shift_m = (spacing_m / 4.0).min(16.0 * cell_m);
        while shift_m >= LEAST_SHIFT_CELLS * cell_m {
            for _ in 0..MOST_PASSES {
                if !report(passes, 0) {
                    return None;
                }
                passes += 1;
                if !shift(graph, &mut points, shift_m) {
                    break;
                }
            }
            shift_m /= 2.0;
        }
        take_if_cheaper(graph, &mut best, &points);
        spacing_m /= 2.0;
    }
    for _ in 0..MOST_PASSES {
        let before = best.cost;
        for bent in [false, true] {
            let mut points = if bent {
                with_bends(graph, &best.points)
            } else {
                best.points.clone()
            };
            let mut move_m = cell_m / 2.0;
            while move_m >= LEAST_MOVE_CELLS * cell_m {
                if !report(passes, 0) {
                    return None;
                }
                passes += 1;
                move_each(graph, &mut points, move_m);
                move_m /= 2.0;
            }
            take_if_cheaper(graph, &mut best, &points);
        }
        if best.cost >= before * (1.0 - LEAST_GAIN) {
            break;
        }
    }
    Some(best)
}

/// Takes the points without needless vertices unless they cost more than the best so far.
fn take_if_cheaper(graph: &impl AnyAngle, best: &mut Way, points: &[Position]) {
    let shorter = Way::of(graph, shorten(graph, points));
    if shorter.cost <= best.cost {
        *best = shorter;
    }
}

/// The same way with no segment longer than `spacing_m`.
fn divided(points: &[Position], spacing_m: f64) -> Vec<Position> {
    let mut divided = vec![points[0]];
    for pair in points.windows(2) {
        let parts = (pair[0].distance_m(pair[1]) / spacing_m).ceil().max(1.0);
        divided.extend((1..parts as usize).map(|part| pair[0].towards(pair[1], part as f64 / parts)));
        divided.push(pair[1]);
    }
    divided
}

/// The same way with vertices where the ground changes abruptly.
fn with_bends(graph: &impl AnyAngle, points: &[Position]) -> Vec<Position> {
    let mut bent = vec![points[0]];
    for pair in points.windows(2) {
        let bends = graph.bends(pair[0], pair[1]);
        bent.extend(bends.into_iter().map(|t| pair[0].towards(pair[1], t)));
        bent.push(pair[1]);
    }
    bent
}

/// Shifts inner vertices by `shift_m` to the left or right, or leaves them, whatever costs least along the whole way.
/// Returns whether the way became cheaper.
fn shift(graph: &impl AnyAngle, points: &mut [Position], shift_m: f64) -> bool {
    let last = points.len() - 1;
    let places: Vec<Vec<Position>> = (0..=last)
        .map(|i| {
            let here = points[i];
            if i == 0 || i == last {
                return vec![here];
            }
            let (before, after) = (points[i - 1], points[i + 1]);
            let along_m = before.distance_m(after);
            if along_m == 0.0 {
                return vec![here];
            }
            let east_m = -(after.y_m - before.y_m) / along_m * shift_m;
            let north_m = (after.x_m - before.x_m) / along_m * shift_m;
            // Staying comes first, so that it wins among equals.
            [0.0, 1.0, -1.0]
                .map(|side| Position::new(here.x_m + side * east_m, here.y_m + side * north_m))
                .to_vec()
        })
        .collect();
    let mut stay = 0.0;
    let mut least = vec![0.0];
    let mut chosen: Vec<Vec<usize>> = Vec::new();
    for pair in places.windows(2) {
        let mut next = Vec::new();
        let mut from = Vec::new();
        for (j, &to) in pair[1].iter().enumerate() {
            let mut reached = (f64::INFINITY, 0);
            for (i, &origin) in pair[0].iter().enumerate() {
                let segment = graph.segment_cost(origin, to);
                if i == 0 && j == 0 {
                    stay += segment;
                }
                if least[i] + segment < reached.0 {
                    reached = (least[i] + segment, i);
                }
            }
            next.push(reached.0);
            from.push(reached.1);
        }
        least = next;
        chosen.push(from);
    }
    if least[0].is_nan() || least[0] >= stay * (1.0 - LEAST_GAIN) {
        return false;
    }
    let mut at = 0;
    for i in (1..=last).rev() {
        points[i] = places[i][at];
        at = chosen[i - 1][at];
    }
    true
}

/// Moves each inner vertex by `move_m` in whichever of ten directions lowers the cost, while one does.
///
/// Eight are those of the compass. The other two lead along the segments that meet in the vertex: beside a corner, where
/// the compass finds nothing open, they draw the way tight around it.
fn move_each(graph: &impl AnyAngle, points: &mut [Position], move_m: f64) {
    const DIAGONAL: f64 = std::f64::consts::FRAC_1_SQRT_2;
    const DIRECTIONS: [(f64, f64); 8] = [
        (1.0, 0.0),
        (0.0, 1.0),
        (-1.0, 0.0),
        (0.0, -1.0),
        (DIAGONAL, DIAGONAL),
        (-DIAGONAL, DIAGONAL),
        (-DIAGONAL, -DIAGONAL),
        (DIAGONAL, -DIAGONAL),
    ];
    for i in 1..points.len().saturating_sub(1) {
        let (before, after) = (points[i - 1], points[i + 1]);
        let through = |place| graph.segment_cost(before, place) + graph.segment_cost(place, after);
        let mut cost = through(points[i]);
        for _ in 0..MOST_PASSES {
            let here = points[i];
            let along = [before, after].map(|end| {
                let away_m = here.distance_m(end).max(move_m);
                ((end.x_m - here.x_m) / away_m, (end.y_m - here.y_m) / away_m)
            });
            let better = along.iter().chain(&DIRECTIONS).find_map(|(east, north)| {
                let place = Position::new(here.x_m + east * move_m, here.y_m + north * move_m);
                let moved = through(place);
                (moved < cost * (1.0 - 1e-12)).then_some((place, moved))
            });
            let Some((place, moved)) = better else { break };
            (points[i], cost) = (place, moved);
        }
    }
}
