//! The corridor around a route and the cost from its cells to the goal.

use crate::corridor::Corridor;
use crate::grid::{Cell, GridGeometry, Layer, Position, Step};
use crate::progress::Report;

use crate::planner::ground::Ground;
use crate::planner::radix_heap::CostHeap;
use crate::planner::search::StepGraph;

/// Cells settled between two reports.
const CELLS_PER_REPORT: u64 = 1 << 14;

/// The search for costs goes on until they are this many times those from the start.
const BEYOND: f64 = 2.0;

/// Costs to the goal on the route's graph, inside the corridor.
pub(super) struct Field {
    geometry: GridGeometry,
    /// Infinite where the goal is not reached or was not looked for.
    to_goal: Vec<f32>,
    /// Cells of the corridor; `None` is the whole ground.
    pub(super) inside: Option<Layer<bool>>,
}

impl Field {
    /// Lays the corridor and settles its cells from the goal backwards; `None` when asked to stop.
    pub(super) fn lay(
        ground: &Ground,
        route: &[Position],
        goal: Cell,
        half_m: f64,
        report: &mut Report,
    ) -> Option<Self> {
        let geometry = ground.geometry();
        let inside = half_m
            .is_finite()
            .then(|| Corridor::around(geometry, route, 2.0 * half_m).cells(geometry));
        let start = route.first().and_then(|&start| geometry.cell_at(start));
        let start = start.map(|start| geometry.index(start));
        let mut field = Self {
            geometry,
            to_goal: vec![f32::INFINITY; geometry.cell_count()],
            inside,
        };
        let mut cost = std::collections::HashMap::new();
        let mut queue = CostHeap::new();
        let first = geometry.index(goal);
        cost.insert(first as u32, 0.0);
        queue.push(0.0, first as u32);
        let (mut settled, mut most) = (0, f64::INFINITY);
        while let Some((so_far, index)) = queue.pop() {
            let place = index as usize;
            if field.to_goal[place].is_finite() {
                continue;
            }
            if settled % CELLS_PER_REPORT == 0 && !report(settled, 0) {
                return None;
            }
            settled += 1;
            field.to_goal[place] = so_far as f32;
            cost.remove(&index);
            if so_far > most {
                break;
            }
            if Some(place) == start {
                most = BEYOND * so_far;
            }
            let here = geometry.cell(place);
            for (k, step) in ground.steps().iter().enumerate() {
                let Step { rows, columns } = *step;
                let Some(before) = geometry.offset(here, -rows, -columns) else {
                    continue;
                };
                let index = geometry.index(before);
                let open = field.inside.as_ref().is_none_or(|inside| inside[before]);
                if !open || field.to_goal[index].is_finite() {
                    continue;
                }
                let next = so_far + ground.edge_cost(before, k);
                let known = cost.entry(index as u32).or_insert(f64::INFINITY);
                if next < *known {
                    *known = next;
                    queue.push(next, index as u32);
                }
            }
        }
        Some(field)
    }

    /// The cost to the goal from a place: bilinear between the centres around it that have one; `None` when none has.
    pub(super) fn to_goal(&self, place: Position) -> Option<f64> {
        let (row, column) = self.geometry.fractional(place);
        let (row, column) = (row - 0.5, column - 0.5);
        let (north, west) = (row.floor(), column.floor());
        let (mut sum, mut total) = (0.0, 0.0);
        for (rows, row_weight) in [(0, 1.0 - (row - north)), (1, row - north)] {
            for (columns, column_weight) in [(0, 1.0 - (column - west)), (1, column - west)] {
                let Some(cell) = self.geometry.checked(north as i64 + rows, west as i64 + columns) else {
                    continue;
                };
                let cost = self.to_goal[self.geometry.index(cell)];
                if cost.is_finite() {
                    // A trace of weight, so that a place at a centre without a cost takes those beside it.
                    let weight = row_weight * column_weight + 1e-9;
                    sum += weight * f64::from(cost);
                    total += weight;
                }
            }
        }
        (total > 0.0).then(|| sum / total)
    }
}
