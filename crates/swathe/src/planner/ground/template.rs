//! The sixteen steps cut into pieces once, with the same code that cuts segments.

use crate::grid::{Cell, GridGeometry, Step, pieces, swept_cells};

/// One of the sixteen steps, cut into pieces.
#[derive(Clone, Debug)]
pub(super) struct Template {
    /// Cells that the vehicle's circle touches.
    pub(super) swept: Vec<Step>,
    pub(super) crossed: Vec<Crossed>,
    pub(super) run_m: f64,
}

/// The piece of a step in one cell. Offsets are of indices, from where the step begins.
#[derive(Clone, Debug)]
pub(super) struct Crossed {
    pub(super) offset: isize,
    pub(super) run_m: f64,
    /// Height at the border where it ends as a weighted sum; empty at the centre where the step ends.
    pub(super) border: Vec<(isize, f64)>,
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
pub(super) fn template(step: Step, map: GridGeometry, radius_m: f64) -> Template {
    let cell_size_m = map.cell_size_m();
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
    let by_index = |cell: Cell| {
        let Step { rows, columns } = offset(cell);
        rows as isize * map.columns() as isize + columns as isize
    };
    let run_m = cell_size_m * step.length_cells();
    let (mut swept, mut crossed) = (Vec::new(), Vec::new());
    swept_cells(&geometry, a, b, radius_m, |cell| {
        swept.extend(cell.map(offset));
        true
    });
    pieces(&geometry, a, b, |piece| {
        let (row, column) = geometry.fractional(a.towards(b, piece.end));
        let weights = bilinear(row, column).map(|(row, column, weight)| {
            let cell = Cell::new(row as usize, column as usize);
            // Exact fractions, so that weights sum to one exactly.
            (by_index(cell), (weight * 64.0).round() / 64.0)
        });
        crossed.push(Crossed {
            offset: by_index(piece.cell),
            run_m: run_m * (piece.end - piece.start),
            border: weights.into_iter().filter(|(_, weight)| *weight > 0.0).collect(),
        });
        true
    });
    if let Some(last) = crossed.last_mut() {
        last.border.clear();
    }
    Template { swept, crossed, run_m }
}
