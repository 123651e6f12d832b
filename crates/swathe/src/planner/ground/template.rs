//! The sixteen steps cut into pieces once, with the same code that cuts segments.

use crate::grid::{Cell, GridGeometry, Step, pieces, swept_cells};

/// One of the sixteen steps, cut into pieces.
#[derive(Clone, Debug)]
pub(super) struct Template {
    /// Cells that the vehicle's circle touches.
    pub(super) swept: Vec<Step>,
    /// Cells crossed, with the share of the length in each.
    pub(super) crossed: Vec<(Step, f64)>,
    /// Heights at the inner borders as weighted sums.
    pub(super) borders: Vec<Vec<(Step, f64)>>,
    pub(super) run_m: f64,
}

/// The four centres around a point given in cells from the corner, with their bilinear weights.
pub(super) fn bilinear(row: f64, column: f64) -> [(i64, i64, f64); 4] {
    let (low_row, low_column) = ((row - 0.5).floor(), (column - 0.5).floor());
    let (down, right) = (row - 0.5 - low_row, column - 0.5 - low_column);
    let (r, c) = (low_row as i64, low_column as i64);
    [
        (r, c, (1.0 - down) * (1.0 - right)),
        (r, c + 1, (1.0 - down) * right),
        (r + 1, c, down * (1.0 - right)),
        (r + 1, c + 1, down * right),
    ]
}

/// Cuts a step into pieces with the same code that cuts segments, on a scrap of grid.
pub(super) fn template(step: Step, cell_size_m: f64, radius_m: f64) -> Template {
    let middle = (radius_m / cell_size_m).ceil() as usize + 3;
    let side = 2 * middle + 1;
    let geometry = GridGeometry::new(side, side, cell_size_m, 0.0, 0.0).expect("a scrap of grid has cells");
    let from = Cell::new(middle, middle);
    let to = step.from(&geometry, from).expect("the scrap holds the step");
    let (a, b) = (geometry.centre(from), geometry.centre(to));
    let offset = |cell: Cell| Step {
        rows: cell.row as i32 - middle as i32,
        columns: cell.column as i32 - middle as i32,
    };
    let (mut swept, mut crossed, mut borders) = (Vec::new(), Vec::new(), Vec::new());
    swept_cells(&geometry, a, b, radius_m, |cell| {
        swept.extend(cell.map(offset));
        true
    });
    pieces(&geometry, a, b, |piece| {
        crossed.push((offset(piece.cell), piece.end - piece.start));
        let (row, column) = geometry.fractional(a.towards(b, piece.end));
        let weights = bilinear(row, column).map(|(row, column, weight)| {
            let cell = Cell::new(row as usize, column as usize);
            // Exact fractions, so that weights sum to one exactly.
            (offset(cell), (weight * 64.0).round() / 64.0)
        });
        borders.push(weights.into_iter().filter(|(_, weight)| *weight > 0.0).collect());
        true
    });
    // The last border is the target's centre.
    borders.pop();
    Template {
        swept,
        crossed,
        borders,
        run_m: cell_size_m * step.length_cells(),
    }
}
