//! The vehicle's ground as a graph whose cells may change.

use crate::grid::Cell;
use crate::planner::Ground;
use crate::planner::search::StepGraph;

use super::ChangingGraph;

impl ChangingGraph for Ground<'_> {
    fn reach(&self) -> usize {
        let swept = (0..self.steps().len()).flat_map(|step| self.swept(step));
        let widest = swept.map(|step| step.rows.unsigned_abs().max(step.columns.unsigned_abs()));
        // Slopes and heights on the borders are made from the cells around those that are touched.
        widest.max().unwrap_or(0) as usize + 1
    }

    fn least(&self, from: Cell, to: Cell) -> f64 {
        let geometry = self.geometry();
        let distance_m = geometry.centre(from).distance_m(geometry.centre(to));
        self.least_cost_per_m() * (1.0 - 1e-12) * distance_m
    }
}
