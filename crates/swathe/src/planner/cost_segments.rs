//! Straight segments over plain costs per metre: the exact integral of a cost that is constant in each cell.

use crate::grid::{Cell, GridGeometry, LayerView, Position, Step, pieces, swept_cells};
use crate::progress::Report;

use super::PlannerError;
use super::any_angle::{AnyAngle, Way, WaySearch, any_angle};
use super::cells::{Algorithm, Corners, CostCells};
use super::eikonal::march;
use super::refine::refine;
use super::search::StepGraph;

/// Coordinates nearer than this to a cell border, in cells, lie on it; the same as in `grid::swept_cells`.
const ON_BORDER_CELLS: f64 = 1e-7;

/// Relative jump of the cost between two cells at which a bend may pay.
const ABRUPT: f64 = 0.01;

/// How a way at any angle over plain costs is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnyAngleMethod {
    /// The cheapest of all that the others find.
    Auto,
    /// Lazy Theta* and the way over 16 neighbours, refined.
    Theta,
    /// The way down the eikonal field, refined.
    Eikonal,
}

/// Costs per metre as a graph of 16 neighbours and of straight segments.
///
/// A segment on the border of two cells costs what the cheaper one does, the limit of segments just inside it. With
/// [`Corners::Keep`] it must not touch closed cells, not even at a corner.
#[derive(Clone, Debug)]
pub struct CostSegments<'a> {
    cells: CostCells<'a>,
    costs: LayerView<'a, f64>,
    corners: Corners,
    /// Whether a cell or one of the eight around it is closed: only there a touch must be looked for.
    closed_near: Vec<bool>,
}

impl<'a> CostSegments<'a> {
    /// A graph over costs per metre; NaN and infinite cells are closed.
    ///
    /// # Errors
    /// [`PlannerError::NegativeCost`] naming the first negative cell, [`PlannerError::Grid`] when the goal lies outside.
    pub fn new(costs: LayerView<'a, f64>, goal: Cell, corners: Corners) -> Result<Self, PlannerError> {
        let cells = CostCells::new(costs, goal, 16, corners, Algorithm::Auto)?;
        let geometry = costs.geometry();
        let mut closed_near = vec![false; geometry.cell_count()];
        for (index, cost) in costs.data().iter().enumerate() {
            if cost.is_finite() {
                continue;
            }
            let cell = geometry.cell(index);
            for (rows, columns) in (-1..=1).flat_map(|rows| (-1..=1).map(move |columns| (rows, columns))) {
                if let Some(near) = geometry.offset(cell, rows, columns) {
                    closed_near[geometry.index(near)] = true;
                }
            }
        }
        Ok(Self {
            cells,
            costs,
            corners,
            closed_near,
        })
    }

    /// Cost per metre in a cell, infinite when it is closed.
    pub(super) fn cost(&self, cell: Cell) -> f64 {
        let cost = self.costs[cell];
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    /// Cost per metre beside a border: of the cheaper cell, infinite when the corners are kept and one is closed.
    fn cost_beside(&self, a: Option<Cell>, b: Option<Cell>) -> f64 {
        let [a, b] = [a, b].map(|cell| cell.map(|cell| self.cost(cell)));
        match (a, b) {
            (Some(a), Some(b)) if self.corners == Corners::Keep && !(a + b).is_finite() => f64::INFINITY,
            (Some(a), Some(b)) => a.min(b),
            (one, other) => one.or(other).unwrap_or(f64::INFINITY),
        }
    }

    /// Mean cost per metre of a segment on a border, from and to given along it; `beside` gives that at an index.
    fn along_border(from: f64, to: f64, beside: impl Fn(i64) -> f64) -> f64 {
        let (low, high) = (from.min(to), from.max(to));
        let mut sum = 0.0;
        for index in low.floor() as i64..=high.floor() as i64 {
            let inside = high.min(index as f64 + 1.0) - low.max(index as f64);
            if inside > ON_BORDER_CELLS {
                sum += beside(index) * inside;
            }
        }
        sum / (high - low)
    }
}

impl StepGraph for CostSegments<'_> {
    fn geometry(&self) -> GridGeometry {
        self.costs.geometry()
    }

    fn steps(&self) -> &[Step] {
        self.cells.steps()
    }

    fn edge_cost(&self, from: Cell, step: usize) -> f64 {
        self.cells.edge_cost(from, step)
    }

    fn bound(&self, cell: Cell) -> f64 {
        self.cells.bound(cell)
    }
}

impl AnyAngle for CostSegments<'_> {
    fn segment_cost(&self, a: Position, b: Position) -> f64 {
        let geometry = self.geometry();
        let run_m = a.distance_m(b);
        let (row_a, column_a) = geometry.fractional(a);
        let (row_b, column_b) = geometry.fractional(b);
        let border = |from: f64, to: f64| {
            let line = from.round();
            ((from - line).abs() < ON_BORDER_CELLS && (to - line).abs() < ON_BORDER_CELLS).then_some(line as i64)
        };
        if run_m > ON_BORDER_CELLS * geometry.cell_size_m() {
            if let Some(row) = border(row_a, row_b) {
                return run_m
                    * Self::along_border(column_a, column_b, |column| {
                        self.cost_beside(geometry.checked(row - 1, column), geometry.checked(row, column))
                    });
            }
            if let Some(column) = border(column_a, column_b) {
                return run_m
                    * Self::along_border(row_a, row_b, |row| {
                        self.cost_beside(geometry.checked(row, column - 1), geometry.checked(row, column))
                    });
            }
        }
        let mut mean = 0.0;
        let mut closed_near = false;
        let complete = pieces(&geometry, a, b, |piece| {
            let cost = self.cost(piece.cell);
            mean += cost * (piece.end - piece.start);
            closed_near |= self.closed_near[geometry.index(piece.cell)];
            cost.is_finite()
        });
        let open = complete
            && (!closed_near
                || self.corners == Corners::Cut
                || swept_cells(&geometry, a, b, 0.0, |near| {
                    near.is_none_or(|near| self.cost(near).is_finite())
                }));
        if open { mean * run_m } else { f64::INFINITY }
    }

    fn bends(&self, a: Position, b: Position) -> Vec<f64> {
        let mut bends = Vec::new();
        let mut before: Option<f64> = None;
        pieces(&self.geometry(), a, b, |piece| {
            let cost = self.cost(piece.cell);
            if before.is_some_and(|before| (before - cost).abs() > ABRUPT * before.min(cost)) {
                bends.push(piece.start);
            }
            before = Some(cost);
            true
        });
        bends
    }
}

/// A cheap way at any angle over costs per metre, from centre to centre.
///
/// # Errors
/// [`PlannerError::NegativeCost`], or [`PlannerError::Grid`] when start or goal lies outside.
pub fn any_angle_path(
    costs: LayerView<f64>,
    start: Cell,
    goal: Cell,
    corners: Corners,
    method: AnyAngleMethod,
    report: &mut Report,
) -> Result<WaySearch, PlannerError> {
    let graph = CostSegments::new(costs, goal, corners)?;
    // The start is checked by the same rule as the goal.
    CostCells::new(costs, start, 16, corners, Algorithm::Auto)?;
    if !graph.cost(start).is_finite() || !graph.cost(goal).is_finite() {
        return Ok(WaySearch::Unreachable);
    }
    let mut best: Option<Way> = None;
    if method != AnyAngleMethod::Eikonal {
        match any_angle(&graph, start, goal, report) {
            WaySearch::Found(way) => best = Some(way),
            other => return Ok(other),
        }
    }
    if method != AnyAngleMethod::Theta {
        let Some(field) = march(&graph, start, Some(goal), report) else {
            return Ok(WaySearch::Stopped);
        };
        // Steps of the field share a side; where corners may be cut, only the other methods find a way.
        if let Some(down) = field.way_to(&graph, goal) {
            match refine(&graph, &down, report) {
                None => return Ok(WaySearch::Stopped),
                Some(way) if best.as_ref().is_none_or(|best| way.cost < best.cost) => best = Some(way),
                Some(_) => {}
            }
        }
    }
    Ok(best.map_or(WaySearch::Unreachable, WaySearch::Found))
}
