//! Route repair.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use swathe::grid::{Cell, LayerView};
use swathe::planner::{ChangingCells, Corners, PlannerError, Repair, Search};

use crate::convert::{geometry, values};
use crate::error::{CoreError, invalid};
use crate::progress::PythonReport;

/// Costs per metre and a way over them that is kept right.
#[pyclass(module = "swathe._core")]
pub(crate) struct Replanner {
    graph: ChangingCells,
    repair: Repair,
}

#[pymethods]
impl Replanner {
    #[new]
    #[pyo3(signature = (costs, start, goal, cell_size_m, neighbours, cut_corners, share, trace))]
    #[allow(clippy::too_many_arguments, reason = "the mirror's keyword arguments")]
    fn new(
        py: Python<'_>,
        costs: PyReadonlyArray2<'_, f64>,
        start: (usize, usize),
        goal: (usize, usize),
        cell_size_m: f64,
        neighbours: u32,
        cut_corners: bool,
        share: f64,
        trace: bool,
    ) -> PyResult<Self> {
        let (rows, columns) = costs.as_array().dim();
        let grid = geometry((rows, columns, cell_size_m, 0.0, 0.0))?;
        let corners = if cut_corners { Corners::Cut } else { Corners::Keep };
        let [start, goal] = [start, goal].map(|(row, column)| Cell::new(row, column));
        let data = values(&costs)?;
        let made = py.detach(|| -> Result<Self, CoreError> {
            let costs = LayerView::new(grid, data, "the costs")?;
            let graph = ChangingCells::new(costs, goal, neighbours, corners)?;
            let repair = Repair::new(&graph, start, goal)?.with_share(share);
            let repair = if trace { repair.with_trace() } else { repair };
            Ok(Self { graph, repair })
        });
        Ok(made?)
    }

    /// Moves the robot.
    fn move_to(&mut self, cell: (usize, usize)) -> PyResult<()> {
        let moved = self.repair.move_to(Cell::new(cell.0, cell.1));
        Ok(moved.map_err(CoreError::from)?)
    }

    /// Gives the rectangle whose north-west cell is (row, column) other costs; returns how many cells have changed.
    fn update_window(
        &mut self,
        py: Python<'_>,
        row: usize,
        column: usize,
        costs: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<usize> {
        let columns = costs.as_array().dim().1.max(1);
        let data = values(&costs)?;
        let changes = data.chunks(columns).enumerate().flat_map(|(down, line)| {
            let cells = (column..).map(move |column| Cell::new(row + down, column));
            cells.zip(line.iter().copied())
        });
        self.change(py, changes)
    }

    /// Gives single cells other costs; returns how many have changed.
    fn update_cells(
        &mut self,
        py: Python<'_>,
        rows: PyReadonlyArray1<'_, i64>,
        columns: PyReadonlyArray1<'_, i64>,
        costs: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<usize> {
        let apart = || invalid("An array is not contiguous.".to_owned(), "Use numpy.ascontiguousarray.");
        let rows = rows.as_slice().map_err(|_| apart())?;
        let columns = columns.as_slice().map_err(|_| apart())?;
        let costs = costs.as_slice().map_err(|_| apart())?;
        // A number below zero becomes one that is outside.
        let cells = rows.iter().zip(columns);
        let cells = cells.map(|(&row, &column)| Cell::new(row as usize, column as usize));
        self.change(py, cells.zip(costs.iter().copied()))
    }

    /// (cells, cost) of a cheapest way from the robot to the goal, or None.
    #[pyo3(signature = (report))]
    #[allow(clippy::type_complexity, reason = "a way and its cost")]
    fn path(&mut self, py: Python<'_>, report: Option<Py<PyAny>>) -> PyResult<Option<(Vec<(usize, usize)>, f64)>> {
        let mut told = PythonReport::new(report);
        let Self { graph, repair } = self;
        let found = py.detach(|| repair.path(graph, &mut |done, total| told.tell("route", done, total)));
        match told.settle(Ok(found))? {
            Search::Found { cells, cost } => {
                Ok(Some((cells.iter().map(|cell| (cell.row, cell.column)).collect(), cost)))
            }
            Search::Unreachable => Ok(None),
            Search::Stopped => Err(CoreError::from(PlannerError::Stopped).into()),
        }
    }

    /// Cost per metre of a cell, infinite where closed.
    fn cost(&self, cell: (usize, usize)) -> f64 {
        self.graph.cost(Cell::new(cell.0, cell.1))
    }

    /// Rows and columns of the cells that the last search expanded, in their order.
    fn expanded<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let cells = self.repair.expanded();
        let flat = cells.iter().flat_map(|cell| [cell.row as u32, cell.column as u32]);
        PyArray1::from_iter(py, flat).reshape([cells.len(), 2])
    }

    /// (expanded, work, afresh, fresh plans, repairs) of the searches.
    fn tally(&self) -> (u64, u64, bool, u64, u64) {
        let tally = self.repair.tally();
        (
            tally.expanded,
            tally.work,
            tally.afresh,
            tally.fresh_plans,
            tally.repairs,
        )
    }
}

impl Replanner {
    fn change(&mut self, py: Python<'_>, changes: impl Iterator<Item = (Cell, f64)> + Clone + Send) -> PyResult<usize> {
        let Self { graph, repair } = self;
        let changed = py.detach(|| -> Result<usize, CoreError> {
            let changed = graph.change(changes)?;
            let count = changed.len();
            repair.update(graph, changed);
            Ok(count)
        });
        Ok(changed?)
    }
}
