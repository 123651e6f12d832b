//! Ways at any angle: Lazy Theta* on the directed cost, then vertices moved off the cell centres.
//!
//! Every cost told is the integral along the way's real segments. A way that can be driven never costs less than the
//! cheapest one, so neither does the answer; how near it comes is measured in docs/any-angle.md.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::grid::{Cell, Position};
use crate::progress::Report;

use super::ground::Ground;
use super::refine::refine;
use super::search::{Search, StepGraph, search};

/// Farthest that Lazy Theta* looks back along a straight line: it keeps the work per cell bounded, and `refine` joins
/// what is left in pieces.
const MOST_SIGHT_CELLS: f64 = 16.0;

/// Expansions between two reports.
const EXPANSIONS_PER_REPORT: u64 = 1 << 12;

/// A graph of steps in which straight segments between any two positions have a cost too.
pub trait AnyAngle: StepGraph {
    /// Cost of the straight segment from `a` to `b`: the integral along it, not negative; infinite when it is closed.
    fn segment_cost(&self, a: Position, b: Position) -> f64;

    /// Where along the segment, as fractions between 0 and 1, a bend may pay because the ground changes abruptly.
    fn bends(&self, _a: Position, _b: Position) -> Vec<f64> {
        Vec::new()
    }
}

impl AnyAngle for Ground<'_> {
    fn segment_cost(&self, a: Position, b: Position) -> f64 {
        self.segment(a, b).map_or(f64::INFINITY, |facts| facts.cost)
    }
}

/// A way of straight segments.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    /// Its vertices from start to goal; a single one when they are the same.
    pub points: Vec<Position>,
    /// The integral of the cost along it.
    pub cost: f64,
}

impl Way {
    /// A way with the cost that it has on a graph.
    pub(super) fn of(graph: &impl AnyAngle, points: Vec<Position>) -> Self {
        let cost = points.windows(2).map(|pair| graph.segment_cost(pair[0], pair[1])).sum();
        Self { points, cost }
    }
}

/// How a search at any angle ended.
#[derive(Clone, Debug, PartialEq)]
pub enum WaySearch {
    /// A way; not proven to be a cheapest one.
    Found(Way),
    /// No way exists over the graph's steps.
    Unreachable,
    /// The caller asked to stop.
    Stopped,
}

/// A cheap way at any angle between the centres of `start` and `goal`: it never costs more than the cheapest way over
/// the graph's steps.
///
/// Two ways are refined and the cheaper one is taken: that of Lazy Theta* and that over the graph's steps.
pub fn any_angle(graph: &impl AnyAngle, start: Cell, goal: Cell, report: &mut Report) -> WaySearch {
    let steps = match search(graph, start, goal, report) {
        Search::Found { cells, .. } => cells,
        Search::Unreachable => return WaySearch::Unreachable,
        Search::Stopped => return WaySearch::Stopped,
    };
    let Some(sighted) = lazy_theta(graph, start, goal, report) else {
        return WaySearch::Stopped;
    };
    let [steps, sighted] = [steps, sighted].map(|cells| centres(graph, &cells));
    best_refined(graph, &steps, &sighted, report).map_or(WaySearch::Stopped, WaySearch::Found)
}

/// The centres of cells.
pub(super) fn centres(graph: &impl StepGraph, cells: &[Cell]) -> Vec<Position> {
    cells.iter().map(|&cell| graph.geometry().centre(cell)).collect()
}

/// Refines a way and another and returns the cheaper, the first among equals; `None` only when the caller asked to stop.
/// The other one is left out when it has no vertices.
pub(super) fn best_refined(
    graph: &impl AnyAngle,
    way: &[Position],
    other: &[Position],
    report: &mut Report,
) -> Option<Way> {
    let best = refine(graph, way, report)?;
    if other.is_empty() {
        return Some(best);
    }
    let other = refine(graph, other, report)?;
    Some(if other.cost < best.cost { other } else { best })
}

/// Lazy Theta* from `start` to `goal` (Nash, Koenig and Tovey 2010), on costs instead of lengths: when a cell is expanded,
/// the straight segment from its predecessor's parent is integrated once, and taken when it costs no more than the step.
///
/// Returns the vertices, none when there is no way, and `None` when the caller asked to stop. Costs that fall when a cell
/// is expanded do not reach cells expanded before, so the result alone has no bound.
pub(super) fn lazy_theta(graph: &impl AnyAngle, start: Cell, goal: Cell, report: &mut Report) -> Option<Vec<Cell>> {
    let geometry = graph.geometry();
    let cells = geometry.cell_count();
    let (first, last) = (geometry.index(start), geometry.index(goal));
    let sight_m = MOST_SIGHT_CELLS * geometry.cell_size_m();
    let mut cost = vec![f64::INFINITY; cells];
    let mut parent = vec![u32::MAX; cells];
    let mut settled = vec![false; cells];
    let mut queue = BinaryHeap::new();
    (cost[first], parent[first]) = (0.0, first as u32);
    // Costs are not negative, so their bits are in order.
    queue.push(Reverse((graph.bound(start).to_bits(), first as u32)));
    let mut expanded = 0;
    while let Some(Reverse((_, index))) = queue.pop() {
        let index = index as usize;
        if settled[index] {
            continue;
        }
        settled[index] = true;
        if expanded % EXPANSIONS_PER_REPORT == 0 && !report(expanded, 0) {
            return None;
        }
        expanded += 1;
        let here = geometry.cell(index);
        let seen_from = parent[parent[index] as usize] as usize;
        let (from, to) = (geometry.centre(geometry.cell(seen_from)), geometry.centre(here));
        if seen_from != parent[index] as usize && from.distance_m(to) <= sight_m {
            let straight = cost[seen_from] + graph.segment_cost(from, to);
            if straight <= cost[index] {
                (cost[index], parent[index]) = (straight, seen_from as u32);
            }
        }
        if index == last {
            break;
        }
        for (k, step) in graph.steps().iter().enumerate() {
            let Some(near) = step.from(&geometry, here) else {
                continue;
            };
            let next = geometry.index(near);
            if settled[next] {
                continue;
            }
            let stepped = cost[index] + graph.edge_cost(here, k);
            if stepped < cost[next] {
                (cost[next], parent[next]) = (stepped, index as u32);
                queue.push(Reverse(((stepped + graph.bound(near)).to_bits(), next as u32)));
            }
        }
    }
    if !settled[last] {
        return Some(Vec::new());
    }
    let mut way = vec![goal];
    let mut at = last;
    while at != first {
        at = parent[at] as usize;
        way.push(geometry.cell(at));
    }
    way.reverse();
    Some(way)
}

#[cfg(test)]
mod tests;
