//! Shortcuts: vertices of a way are dropped while the straight segment stays allowed and costs no more.

use crate::grid::Position;

use super::any_angle::AnyAngle;

/// Passes over the way before it is taken as it is.
const MOST_PASSES: usize = 40;

/// Drops vertices of a way whose consecutive segments can all be driven. The cost never rises; the ends stay.
///
/// Each pass looks at every second vertex that is left, the cheapest removals of the finest scale first, so a shortcut
/// grows by doubling. Not optimal: a vertex is only dropped, never moved.
pub fn shorten(graph: &impl AnyAngle, way: &[Position]) -> Vec<Position> {
    let mut points = drop_collinear(way);
    if points.is_empty() {
        return points;
    }
    let mut costs: Vec<f64> = points
        .windows(2)
        .map(|pair| graph.segment_cost(pair[0], pair[1]))
        .collect();
    for _ in 0..MOST_PASSES {
        let before = points.len();
        let mut kept = vec![points[0]];
        let mut kept_costs = Vec::new();
        let mut here = 0;
        while here + 1 < points.len() {
            let shortcut = (here + 2 < points.len())
                .then(|| {
                    let old = costs[here] + costs[here + 1];
                    let new = graph.segment_cost(points[here], points[here + 2]);
                    (old.is_finite() && new <= old * (1.0 + 1e-12)).then_some(new)
                })
                .flatten();
            let step = if shortcut.is_some() { 2 } else { 1 };
            kept_costs.push(shortcut.unwrap_or(costs[here]));
            here += step;
            kept.push(points[here]);
        }
        (points, costs) = (kept, kept_costs);
        if points.len() == before {
            break;
        }
    }
    points
}

/// Drops vertices in the middle of straight runs.
pub(super) fn drop_collinear(way: &[Position]) -> Vec<Position> {
    let mut points: Vec<Position> = Vec::new();
    for &point in way {
        if let [.., a, b] = points[..] {
            let cross = (b.x_m - a.x_m) * (point.y_m - b.y_m) - (b.y_m - a.y_m) * (point.x_m - b.x_m);
            let onward = (b.x_m - a.x_m) * (point.x_m - b.x_m) + (b.y_m - a.y_m) * (point.y_m - b.y_m);
            if cross.abs() <= 1e-9 * onward.abs() && onward > 0.0 {
                points.pop();
            }
        }
        points.push(point);
    }
    points
}
