//! Costs per metre that change under a robot: the graph of [`CostCells`](crate::planner::CostCells), owned.

use crate::grid::{Cell, EIGHT, GridError, GridGeometry, LayerView, SIXTEEN, Step};
use crate::planner::search::StepGraph;
use crate::planner::{Corners, PlannerError};

use super::{ChangingGraph, MOST_STEPS};

/// Closed cells around the map, as many as a step reaches, so that no step needs to look where the map ends.
const BORDER: usize = 2;

/// Costs per metre on a grid of 8 or 16 neighbours, whose cells may be given new costs.
///
/// A step costs what it costs in [`CostCells`](crate::planner::CostCells), to the last bit.
#[derive(Clone, Debug)]
pub struct ChangingCells {
    geometry: GridGeometry,
    /// With the border; infinite where closed.
    costs: Vec<f64>,
    stride: usize,
    steps: &'static [Step],
    lengths_m: Vec<f64>,
    corners: Corners,
    /// No cell was ever cheaper per metre.
    least: f64,
    goal: Cell,
}

impl ChangingCells {
    /// A graph over a copy of costs per metre; NaN and infinite cells are closed.
    ///
    /// # Errors
    /// [`PlannerError::NegativeCost`] naming the first negative cell, [`PlannerError::Neighbours`] for a number other than
    /// 8 or 16, [`PlannerError::Grid`] when the goal lies outside.
    pub fn new(costs: LayerView<f64>, goal: Cell, neighbours: u32, corners: Corners) -> Result<Self, PlannerError> {
        let geometry = costs.geometry();
        let steps: &[Step] = match neighbours {
            8 => &EIGHT,
            16 => &SIXTEEN,
            given => return Err(PlannerError::Neighbours { given }),
        };
        inside(&geometry, goal)?;
        let stride = geometry.columns() + 2 * BORDER;
        let mut cells = Self {
            geometry,
            costs: vec![f64::INFINITY; stride * (geometry.rows() + 2 * BORDER)],
            stride,
            steps,
            lengths_m: steps
                .iter()
                .map(|step| geometry.cell_size_m() * step.length_cells())
                .collect(),
            corners,
            least: f64::INFINITY,
            goal,
        };
        for row in 0..geometry.rows() {
            for (column, &cost) in costs.row(row).iter().enumerate() {
                let cell = Cell::new(row, column);
                check(cell, cost)?;
                cells.set(cell, cost);
            }
        }
        Ok(cells)
    }

    /// Gives cells other costs per metre, NaN and infinite closing them; returns those that were not so before.
    ///
    /// # Errors
    /// [`PlannerError::Grid`] for a cell outside, [`PlannerError::NegativeCost`]; the graph is then as it was.
    pub fn change(
        &mut self,
        changes: impl IntoIterator<Item = (Cell, f64)> + Clone,
    ) -> Result<Vec<Cell>, PlannerError> {
        for (cell, cost) in changes.clone() {
            inside(&self.geometry, cell)?;
            check(cell, cost)?;
        }
        let changes = changes.into_iter();
        Ok(changes
            .filter(|&(cell, cost)| self.set(cell, cost))
            .map(|(cell, _)| cell)
            .collect())
    }

    /// Sets a cost that was checked; returns whether it is another one.
    fn set(&mut self, cell: Cell, cost: f64) -> bool {
        let at = self.place(cell);
        let cost = if cost.is_finite() { cost } else { f64::INFINITY };
        let before = std::mem::replace(&mut self.costs[at], cost);
        self.least = self.least.min(cost);
        before != cost
    }

    /// Cost per metre of a cell, infinite where closed or outside.
    pub fn cost(&self, cell: Cell) -> f64 {
        if inside(&self.geometry, cell).is_err() {
            return f64::INFINITY;
        }
        self.costs[self.place(cell)]
    }

    fn place(&self, cell: Cell) -> usize {
        (cell.row + BORDER) * self.stride + cell.column + BORDER
    }
}

fn check(cell: Cell, cost: f64) -> Result<(), PlannerError> {
    if cost < 0.0 {
        let Cell { row, column } = cell;
        return Err(PlannerError::NegativeCost { row, column, cost });
    }
    Ok(())
}

/// Says where a cell lies outside.
pub(super) fn inside(geometry: &GridGeometry, cell: Cell) -> Result<(), GridError> {
    if cell.row < geometry.rows() && cell.column < geometry.columns() {
        return Ok(());
    }
    Err(GridError::OutsideGrid {
        row: cell.row as i64,
        column: cell.column as i64,
        rows: geometry.rows(),
        columns: geometry.columns(),
    })
}

impl StepGraph for ChangingCells {
    fn geometry(&self) -> GridGeometry {
        self.geometry
    }

    fn steps(&self) -> &[Step] {
        self.steps
    }

    fn edge_cost(&self, from: Cell, step: usize) -> f64 {
        let Step { rows, columns } = self.steps[step];
        let here = self.place(from) as i64;
        let at = |rows: i32, columns: i32| {
            self.costs[(here + i64::from(rows) * self.stride as i64 + i64::from(columns)) as usize]
        };
        let ends = at(0, 0) + at(rows, columns);
        let length_m = self.lengths_m[step];
        match (rows.abs(), columns.abs()) {
            (1, 1) if self.corners == Corners::Keep && !(at(rows, 0) + at(0, columns)).is_finite() => f64::INFINITY,
            (1, 2) => length_m / 4.0 * (ends + (at(0, columns / 2) + at(rows, columns / 2))),
            (2, 1) => length_m / 4.0 * (ends + (at(rows / 2, 0) + at(rows / 2, columns))),
            _ => length_m / 2.0 * ends,
        }
    }

    fn bound(&self, cell: Cell) -> f64 {
        self.least(cell, self.goal)
    }
}

impl ChangingCells {
    /// Costs per metre in the square of `W` by `W` cells around a cell.
    fn square<const W: usize>(&self, cell: Cell) -> [[f64; W]; W] {
        let mut square = [[f64::INFINITY; W]; W];
        let mut first = self.place(cell) - (W / 2) * (self.stride + 1);
        for line in &mut square {
            if let Some(costs) = self.costs.get(first..).and_then(<[f64]>::first_chunk::<W>) {
                *line = *costs;
            }
            first += self.stride;
        }
        square
    }

    /// Costs of the eight steps in the middle of a square, in the order of [`EIGHT`].
    fn eight<const W: usize>(&self, around: &[[f64; W]; W], halves_m: [f64; 2]) -> [f64; 8] {
        let at = |rows: i32, columns: i32| around[(W as i32 / 2 + rows) as usize][(W as i32 / 2 + columns) as usize];
        let keep = self.corners == Corners::Keep;
        std::array::from_fn(|k| {
            let Step { rows, columns } = EIGHT[k];
            let cost = halves_m[k % 2] * (at(0, 0) + at(rows, columns));
            let closed = k % 2 == 1 && keep && at(rows, 0) + at(0, columns) == f64::INFINITY;
            if closed { f64::INFINITY } else { cost }
        })
    }
}

impl ChangingGraph for ChangingCells {
    fn costs_around(&self, cell: Cell) -> Option<[f64; MOST_STEPS]> {
        let mut costs = [f64::INFINITY; MOST_STEPS];
        let halves_m = |diagonal: usize| [self.lengths_m[0] / 2.0, self.lengths_m[diagonal] / 2.0];
        if self.steps.len() == 8 {
            let eight = self.eight(&self.square::<3>(cell), halves_m(1));
            costs[..8].copy_from_slice(&eight);
            return Some(costs);
        }
        let around = self.square::<5>(cell);
        let eight = self.eight(&around, halves_m(2));
        let at = |rows: i32, columns: i32| around[(2 + rows) as usize][(2 + columns) as usize];
        for k in 0..8 {
            costs[2 * k] = eight[k];
            let Step { rows, columns } = SIXTEEN[2 * k + 1];
            let (near, far) = ((rows / 2, columns / 2), (rows - rows / 2, columns - columns / 2));
            let between = at(near.0, near.1) + at(far.0, far.1);
            costs[2 * k + 1] = self.lengths_m[2 * k + 1] / 4.0 * ((at(0, 0) + at(rows, columns)) + between);
        }
        Some(costs)
    }

    fn reach(&self) -> usize {
        if self.steps.len() > 8 { 2 } else { 1 }
    }

    fn least(&self, from: Cell, to: Cell) -> f64 {
        if self.least == 0.0 || self.least.is_infinite() {
            return 0.0;
        }
        let rows = from.row.abs_diff(to.row) as f64;
        let columns = from.column.abs_diff(to.column) as f64;
        // A hair less than the bound, so that rounding cannot make it inconsistent.
        self.least * (1.0 - 1e-12) * self.geometry.cell_size_m() * (rows * rows + columns * columns).sqrt()
    }
}
