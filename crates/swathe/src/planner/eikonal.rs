//! The eikonal field: costs from a start to every cell as if the cost were smooth and any heading could be taken.
//!
//! Fast marching on cell centres (Sethian 1996), of second order where the cost is smooth (Sethian 1999) and of first order
//! elsewhere. Right for isotropic costs that change little from cell to cell: there it has no preferred direction, as the
//! costs over 8 or 16 neighbours have. Not a bound: values may lie on either side of the truth.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::grid::{Cell, GridGeometry, LayerView, Position, disc};
use crate::progress::Report;

use super::PlannerError;
use super::any_angle::AnyAngle;
use super::cells::Corners;
use super::cost_segments::CostSegments;
use super::search::StepGraph;

/// Radius around the start within which values begin as integrals along straight segments, in cells: the field has a kink at
/// the start, where differences would be wrong.
const EXACT_CELLS: f64 = 10.0;

/// Reach of a step of the way down the field, in cells: far enough for about a hundred headings.
const DOWN_CELLS: f64 = 6.0;

/// Greatest relative difference of costs across a stencil for which it is of second order.
const SMOOTH: f64 = 0.25;

/// Cells between two reports.
const CELLS_PER_REPORT: u64 = 1 << 14;

/// Costs from a start to every cell.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct EikonalField {
    geometry: GridGeometry,
    start: Cell,
    costs: Vec<f64>,
    /// Turn at which each cell was settled, `u32::MAX` never.
    turns: Vec<u32>,
}

/// One axis of a stencil: the difference quotient is `weight` times (value - `base`).
#[derive(Clone, Copy, Debug)]
struct Side {
    /// Value of the nearest cell.
    near: f64,
    base: f64,
    weight: f64,
    /// Cost per metre of the nearest cell.
    cost: f64,
}

/// Costs from the centre of `start` to the centre of every cell, in row-major order; infinite where no way of steps along
/// rows and columns leads, and everywhere when the start is closed.
///
/// # Errors
/// [`PlannerError::NegativeCost`], [`PlannerError::Grid`] when the start lies outside, [`PlannerError::Stopped`].
pub fn eikonal_field(costs: LayerView<f64>, start: Cell, report: &mut Report) -> Result<Vec<f64>, PlannerError> {
    let graph = CostSegments::new(costs, start, Corners::Keep)?;
    let field = march(&graph, start, None, report).ok_or(PlannerError::Stopped)?;
    Ok(field.costs)
}

/// Marches from `start` over every cell, or until `goal` is settled; `None` when the caller asked to stop.
///
/// With a `goal`, cells that were not settled are infinite.
pub(super) fn march(
    graph: &CostSegments,
    start: Cell,
    goal: Option<Cell>,
    report: &mut Report,
) -> Option<EikonalField> {
    let geometry = graph.geometry();
    let mut field = EikonalField {
        geometry,
        start,
        costs: vec![f64::INFINITY; geometry.cell_count()],
        turns: vec![u32::MAX; geometry.cell_count()],
    };
    let mut queue = BinaryHeap::new();
    let from = geometry.centre(start);
    if graph.cost(start).is_finite() {
        for near in disc(EXACT_CELLS).iter().filter_map(|step| step.from(&geometry, start)) {
            let cost = if near == start {
                0.0
            } else {
                graph.segment_cost(from, geometry.centre(near))
            };
            if cost.is_finite() {
                field.costs[geometry.index(near)] = cost;
                queue.push(Reverse((cost.to_bits(), geometry.index(near) as u32)));
            }
        }
    }
    let goal = goal.map(|goal| geometry.index(goal));
    let mut turn: u32 = 0;
    while let Some(Reverse((bits, index))) = queue.pop() {
        let index = index as usize;
        if field.turns[index] != u32::MAX || f64::from_bits(bits) > field.costs[index] {
            continue;
        }
        field.turns[index] = turn;
        if u64::from(turn) % CELLS_PER_REPORT == 0 && !report(u64::from(turn), 0) {
            return None;
        }
        turn += 1;
        if Some(index) == goal {
            break;
        }
        let here = geometry.cell(index);
        for (rows, columns) in [(0, 1), (-1, 0), (0, -1), (1, 0)] {
            let Some(near) = geometry.offset(here, rows, columns) else {
                continue;
            };
            let next = geometry.index(near);
            if field.turns[next] != u32::MAX || !graph.cost(near).is_finite() {
                continue;
            }
            let value = field.value(graph, near);
            if value < field.costs[next] {
                field.costs[next] = value;
                queue.push(Reverse((value.to_bits(), next as u32)));
            }
        }
    }
    for (cost, turn) in field.costs.iter_mut().zip(&field.turns) {
        if *turn == u32::MAX {
            *cost = f64::INFINITY;
        }
    }
    Some(field)
}

impl EikonalField {
    /// The way down the field from `goal` to the start, told from start to goal; `None` when the goal was not reached.
    ///
    /// Each step goes straight to the centre within reach for which field and segment together cost least, among those
    /// settled before, so the way comes to an end.
    pub(super) fn way_to(&self, graph: &CostSegments, goal: Cell) -> Option<Vec<Position>> {
        let geometry = self.geometry;
        let reach = disc(DOWN_CELLS);
        let mut here = goal;
        let mut way = vec![geometry.centre(goal)];
        if self.turns[geometry.index(goal)] == u32::MAX {
            return None;
        }
        while here != self.start {
            let to = geometry.centre(here);
            let turn = self.turns[geometry.index(here)];
            let nearby = reach.iter().filter_map(|step| step.from(&geometry, here));
            let before = nearby
                .filter(|&near| self.turns[geometry.index(near)] < turn)
                .map(|near| {
                    let rest = graph.segment_cost(geometry.centre(near), to);
                    (self.costs[geometry.index(near)] + rest, near)
                })
                .min_by(|a, b| a.0.total_cmp(&b.0))?;
            if !before.0.is_finite() {
                return None;
            }
            here = before.1;
            way.push(geometry.centre(here));
        }
        way.reverse();
        Some(way)
    }

    /// The value that the settled neighbours give a cell.
    fn value(&self, graph: &CostSegments, cell: Cell) -> f64 {
        let cell_m = self.geometry.cell_size_m();
        let own = graph.cost(cell);
        let axes = [[(-1, 0), (1, 0)], [(0, -1), (0, 1)]]
            .map(|directions| directions.map(|direction| self.side(graph, cell, own, direction)));
        let nearer = |sides: [Option<Side>; 2]| sides.into_iter().flatten().min_by(|a, b| a.near.total_cmp(&b.near));
        let sides = axes.map(nearer);
        if let [Some(a), Some(b)] = sides {
            let exact_m = EXACT_CELLS * cell_m;
            let away_m = self.geometry.centre(cell).distance_m(self.geometry.centre(self.start));
            // Near the kink at the start differences of second order would fall below the integrals.
            if away_m > exact_m
                && [a, b].iter().all(|side| side.weight > 1.0)
                && let Some(value) = two_sided(a, b, own * cell_m)
            {
                return value;
            }
            // Differences of first order are right half-way between the cells, so the cost is taken there.
            let half_way = own / 2.0 + (a.cost + b.cost) / 4.0;
            if let Some(value) = two_sided(a.first_order(), b.first_order(), half_way * cell_m) {
                return value;
            }
        }
        let alone = |side: Side| side.near + f64::midpoint(own, side.cost) * cell_m;
        sides.into_iter().flatten().map(alone).fold(f64::INFINITY, f64::min)
    }

    /// The settled neighbour in a direction, with the next one behind it where the cost is smooth.
    fn side(&self, graph: &CostSegments, cell: Cell, own: f64, (rows, columns): (i32, i32)) -> Option<Side> {
        let settled = |times: i32| {
            let near = self.geometry.offset(cell, times * rows, times * columns)?;
            let index = self.geometry.index(near);
            (self.turns[index] != u32::MAX).then(|| (self.costs[index], graph.cost(near)))
        };
        let (near, cost) = settled(1)?;
        let first = Side {
            near,
            base: near,
            weight: 1.0,
            cost,
        };
        let alike = |cost: f64| (cost - own).abs() <= SMOOTH * own.min(cost);
        match settled(2) {
            Some((far, beyond)) if far <= near && alike(cost) && alike(beyond) => Some(Side {
                base: (4.0 * near - far) / 3.0,
                weight: 1.5,
                ..first
            }),
            _ => Some(first),
        }
    }
}

impl Side {
    fn first_order(self) -> Self {
        Self {
            base: self.near,
            weight: 1.0,
            ..self
        }
    }
}

/// The greater root of the sum of squared differences = the squared cost of a cell's side, if both sides lie upwind of it.
fn two_sided(a: Side, b: Side, side_cost: f64) -> Option<f64> {
    let (low, high) = if a.base <= b.base { (a, b) } else { (b, a) };
    // In units of the cost of a side, so that nothing overflows.
    let apart = (high.base - low.base) / side_cost;
    let (p, q) = (low.weight * low.weight, high.weight * high.weight);
    let root = (p + q) - p * q * apart * apart;
    if root.is_nan() || root < 0.0 {
        return None;
    }
    let value = low.base + side_cost * (q * apart + root.sqrt()) / (p + q);
    (value >= a.near && value >= b.near && value.is_finite()).then_some(value)
}
