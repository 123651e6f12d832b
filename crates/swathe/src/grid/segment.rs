//! Straight segments over the grid: the pieces they cut out of cells, and the cells that a moving disc touches.

use super::{Cell, GridGeometry, Position};

/// Lengths below this many cells count as touching: it absorbs the rounding of map coordinates.
const TOUCH_CELLS: f64 = 1e-7;

/// The part of a segment inside one cell, as fractions of the segment's length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// The cell.
    pub cell: Cell,
    /// Where the part starts, 0 at the segment's start.
    pub start: f64,
    /// Where it ends, 1 at the segment's end.
    pub end: f64,
}

/// Calls `visit` with each piece of the segment from `a` to `b` in order and stops when it returns false.
///
/// Returns false when `visit` did, or when the segment leaves the grid. Method: Amanatides and Woo 1987.
pub fn pieces(geometry: &GridGeometry, a: Position, b: Position, mut visit: impl FnMut(Piece) -> bool) -> bool {
    let (row_a, column_a) = geometry.fractional(a);
    let (row_b, column_b) = geometry.fractional(b);
    let (rows, columns) = (row_b - row_a, column_b - column_a);
    let mut row = nudge(row_a, rows).floor() as i64;
    let mut column = nudge(column_a, columns).floor() as i64;
    let mut start = 0.0;
    loop {
        let Some(cell) = geometry.checked(row, column) else {
            return false;
        };
        let next_row = crossing(row_a, rows, row);
        let next_column = crossing(column_a, columns, column);
        let end = next_row.min(next_column).min(1.0).max(start);
        if (end > start || end >= 1.0) && !visit(Piece { cell, start, end }) {
            return false;
        }
        if end >= 1.0 - 1e-12 {
            return true;
        }
        // Through a corner both indices change at once.
        if next_row <= end {
            row += if rows > 0.0 { 1 } else { -1 };
        }
        if next_column <= end {
            column += if columns > 0.0 { 1 } else { -1 };
        }
        start = end;
    }
}

/// The fraction at which a coordinate leaves the cell with this index.
fn crossing(from: f64, change: f64, index: i64) -> f64 {
    if change.abs() < TOUCH_CELLS {
        f64::INFINITY
    } else if change > 0.0 {
        snap((index as f64 + 1.0 - from) / change)
    } else {
        snap((index as f64 - from) / change)
    }
}

/// Rounds a fraction so that two crossings of one corner compare equal.
fn snap(t: f64) -> f64 {
    (t * 1e10).round() / 1e10
}

/// Moves a coordinate that lies on a cell border into the cell that the segment enters.
fn nudge(from: f64, change: f64) -> f64 {
    let nearest = from.round();
    if (from - nearest).abs() < TOUCH_CELLS {
        if change < 0.0 { nearest - 0.5 } else { nearest + 0.25 }
    } else {
        from
    }
}

/// Calls `visit` with each cell that a disc of `radius_m` moving from `a` to `b` touches (`None` outside the grid),
/// and stops when it returns false. Returns whether all were visited.
///
/// With radius zero these are the cells that the segment crosses or passes at a border or corner. A disc that only
/// grazes a cell's border does not touch the cell.
pub fn swept_cells(
    geometry: &GridGeometry,
    a: Position,
    b: Position,
    radius_m: f64,
    mut visit: impl FnMut(Option<Cell>) -> bool,
) -> bool {
    let (row_a, column_a) = geometry.fractional(a);
    let (row_b, column_b) = geometry.fractional(b);
    let radius = radius_m / geometry.cell_size_m();
    let reach = if radius > 2.0 * TOUCH_CELLS {
        radius - TOUCH_CELLS
    } else {
        TOUCH_CELLS
    };
    let (low_row, high_row) = (row_a.min(row_b), row_a.max(row_b));
    let first = (low_row - reach).floor() as i64;
    let last = (high_row + reach).floor() as i64;
    for row in first..=last {
        // The part of the segment within reach of this row bounds the columns that can be touched.
        let band = (row as f64 - reach, row as f64 + 1.0 + reach);
        let (t0, t1) = clip(row_a, row_b, band);
        let (x0, x1) = (
            column_a + t0 * (column_b - column_a),
            column_a + t1 * (column_b - column_a),
        );
        let from = (x0.min(x1) - reach).floor() as i64;
        let to = (x0.max(x1) + reach).floor() as i64;
        for column in from..=to {
            let square = (row as f64, column as f64);
            if distance_to_square((row_a, column_a), (row_b, column_b), square) <= reach
                && !visit(geometry.checked(row, column))
            {
                return false;
            }
        }
    }
    true
}

/// The fractions between which a coordinate running from `a` to `b` lies in a band.
fn clip(a: f64, b: f64, band: (f64, f64)) -> (f64, f64) {
    let change = b - a;
    if change == 0.0 {
        return (0.0, 1.0);
    }
    let (t0, t1) = ((band.0 - a) / change, (band.1 - a) / change);
    (t0.min(t1).clamp(0.0, 1.0), t0.max(t1).clamp(0.0, 1.0))
}

/// Distance in cells from the segment to the unit square whose low corner is given.
fn distance_to_square(a: (f64, f64), b: (f64, f64), square: (f64, f64)) -> f64 {
    let low = Position::new(square.0, square.1);
    let (p, q) = (Position::new(a.0, a.1), Position::new(b.0, b.1));
    if enters(p, q, low) {
        return 0.0;
    }
    let outside = |point: Position| {
        let dx = (low.x_m - point.x_m).max(point.x_m - low.x_m - 1.0).max(0.0);
        let dy = (low.y_m - point.y_m).max(point.y_m - low.y_m - 1.0).max(0.0);
        dx.hypot(dy)
    };
    let corners = [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)];
    corners
        .iter()
        .map(|(dx, dy)| Position::new(low.x_m + dx, low.y_m + dy).distance_to_segment_m(p, q))
        .fold(outside(p).min(outside(q)), f64::min)
}

/// Whether the segment meets the unit square (slab test).
fn enters(p: Position, q: Position, low: Position) -> bool {
    let (mut t0, mut t1) = (0.0_f64, 1.0_f64);
    for (from, to, edge) in [(p.x_m, q.x_m, low.x_m), (p.y_m, q.y_m, low.y_m)] {
        let change = to - from;
        if change == 0.0 {
            if from < edge || from > edge + 1.0 {
                return false;
            }
        } else {
            let (u, v) = ((edge - from) / change, (edge + 1.0 - from) / change);
            t0 = t0.max(u.min(v));
            t1 = t1.min(u.max(v));
        }
    }
    t0 <= t1
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn grid() -> GridGeometry {
        GridGeometry::new(20, 20, 2.0, 100.0, 400.0).unwrap()
    }

    fn walked(a: Cell, b: Cell) -> Vec<Piece> {
        let geometry = grid();
        let mut found = Vec::new();
        assert!(pieces(&geometry, geometry.centre(a), geometry.centre(b), |piece| {
            found.push(piece);
            true
        }));
        found
    }

    fn touched(a: Cell, b: Cell, radius_cells: f64) -> Vec<(usize, usize)> {
        let geometry = grid();
        let mut found = Vec::new();
        swept_cells(
            &geometry,
            geometry.centre(a),
            geometry.centre(b),
            radius_cells * 2.0,
            |cell| {
                found.extend(cell.map(|cell| (cell.row, cell.column)));
                true
            },
        );
        found.sort_unstable();
        found
    }

    #[test]
    fn a_knights_move_has_four_equal_pieces() {
        let found = walked(Cell::new(5, 5), Cell::new(6, 7));
        let cells: Vec<_> = found.iter().map(|p| (p.cell.row, p.cell.column)).collect();
        assert_eq!(cells, [(5, 5), (5, 6), (6, 6), (6, 7)]);
        for piece in found {
            approx::assert_relative_eq!(piece.end - piece.start, 0.25, epsilon = 1e-9);
        }
    }

    #[test]
    fn a_diagonal_touches_both_side_cells_and_crosses_none() {
        assert_eq!(walked(Cell::new(5, 5), Cell::new(6, 6)).len(), 2);
        assert_eq!(
            touched(Cell::new(5, 5), Cell::new(6, 6), 0.0),
            [(5, 5), (5, 6), (6, 5), (6, 6)]
        );
    }

    #[test]
    fn a_wider_disc_touches_the_next_cells() {
        let knight = |radius| touched(Cell::new(5, 5), Cell::new(6, 7), radius).len();
        assert_eq!(knight(0.0), 4);
        // The cells beside the move are 0.2236 cells from its line.
        assert_eq!(knight(0.22), 4);
        assert_eq!(knight(0.23), 6);
        assert_eq!(touched(Cell::new(5, 5), Cell::new(5, 6), 0.49).len(), 2);
        assert_eq!(touched(Cell::new(5, 5), Cell::new(5, 6), 0.51).len(), 8);
    }

    proptest! {
        #[test]
        fn pieces_cover_the_segment_in_touching_cells(
            a in (0usize..20, 0usize..20), b in (0usize..20, 0usize..20),
        ) {
            let (a, b) = (Cell::new(a.0, a.1), Cell::new(b.0, b.1));
            let found = walked(a, b);
            prop_assert_eq!((found[0].cell, found[found.len() - 1].cell), (a, b));
            prop_assert_eq!((found[0].start, found[found.len() - 1].end), (0.0, 1.0));
            prop_assert!(found.windows(2).all(|pair| pair[0].end == pair[1].start));
            let swept = touched(a, b, 0.0);
            prop_assert!(found.iter().all(|p| swept.contains(&(p.cell.row, p.cell.column))));
        }

        #[test]
        fn what_is_seen_from_a_to_b_is_seen_from_b_to_a(
            a in (0usize..20, 0usize..20), b in (0usize..20, 0usize..20), radius in 0.0f64..3.0,
        ) {
            let (a, b) = (Cell::new(a.0, a.1), Cell::new(b.0, b.1));
            prop_assert_eq!(touched(a, b, radius), touched(b, a, radius));
        }
    }
}
