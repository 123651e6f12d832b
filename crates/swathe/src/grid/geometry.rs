//! Where cells lie: rows and columns of square cells in a projected, north-up frame.

use thiserror::Error;

/// A cell by row (0 is north) and column (0 is west).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Cell {
    /// Row, counted from the north edge.
    pub row: usize,
    /// Column, counted from the west edge.
    pub column: usize,
}

impl Cell {
    /// The cell at a row and column.
    pub const fn new(row: usize, column: usize) -> Self {
        Self { row, column }
    }
}

/// A point of the map frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// Metres east.
    pub x_m: f64,
    /// Metres north.
    pub y_m: f64,
}

impl Position {
    /// The point at metres east and north.
    pub const fn new(x_m: f64, y_m: f64) -> Self {
        Self { x_m, y_m }
    }

    /// Distance to another point, in metres.
    pub fn distance_m(self, other: Self) -> f64 {
        (self.x_m - other.x_m).hypot(self.y_m - other.y_m)
    }

    /// The point a fraction `t` of the way to another.
    #[must_use]
    pub fn towards(self, other: Self, t: f64) -> Self {
        Self::new(
            self.x_m + t * (other.x_m - self.x_m),
            self.y_m + t * (other.y_m - self.y_m),
        )
    }

    /// Distance to the segment from `a` to `b`, in metres.
    pub fn distance_to_segment_m(self, a: Self, b: Self) -> f64 {
        let (dx, dy) = (b.x_m - a.x_m, b.y_m - a.y_m);
        let length_squared = dx * dx + dy * dy;
        if length_squared == 0.0 {
            return self.distance_m(a);
        }
        let t = ((self.x_m - a.x_m) * dx + (self.y_m - a.y_m) * dy) / length_squared;
        self.distance_m(a.towards(b, t.clamp(0.0, 1.0)))
    }
}

/// What can be wrong with a grid or with a layer on it.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum GridError {
    /// No rows or no columns.
    #[error("A grid of {rows} rows and {columns} columns has no cells.")]
    Empty {
        /// Rows given.
        rows: usize,
        /// Columns given.
        columns: usize,
    },
    /// More cells than 32-bit labels can count.
    #[error("A grid of {rows} rows and {columns} columns has more than 4294967294 cells.")]
    TooManyCells {
        /// Rows given.
        rows: usize,
        /// Columns given.
        columns: usize,
    },
    /// The cell size or the corner is not a usable number.
    #[error("The {name} of {given} m is not usable: it must be finite{and}.")]
    NotALength {
        /// What it is.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What else is asked.
        and: &'static str,
    },
    /// A layer's data does not have the geometry's number of cells.
    #[error("{what} has {found} cells where the grid has {expected}.")]
    ShapeMismatch {
        /// The layer.
        what: &'static str,
        /// Cells of the geometry.
        expected: usize,
        /// Cells given.
        found: usize,
    },
    /// Tiles that do not fit a grid.
    #[error(
        "Tiles of {side} cells a side that begin {} rows and {} columns before the grid cannot be made.", first.0, first.1
    )]
    TileSide {
        /// Cells of the side of a tile; a power of two up to 32,768.
        side: usize,
        /// Row and column inside its tile of the first cell.
        first: (usize, usize),
    },
    /// A cell lies outside the grid.
    #[error("Cell ({row}, {column}) lies outside a grid of {rows} rows and {columns} columns.")]
    OutsideGrid {
        /// Row given.
        row: i64,
        /// Column given.
        column: i64,
        /// Rows of the grid.
        rows: usize,
        /// Columns of the grid.
        columns: usize,
    },
}

/// Rows and columns of square cells with their place in the map frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridGeometry {
    rows: usize,
    columns: usize,
    cell_size_m: f64,
    west_m: f64,
    north_m: f64,
}

impl GridGeometry {
    /// A grid whose cell (0, 0) has its north-west corner at (`west_m`, `north_m`).
    ///
    /// # Errors
    /// [`GridError`] when there are no cells or too many, or a number is not finite (the cell size above zero).
    pub fn new(rows: usize, columns: usize, cell_size_m: f64, west_m: f64, north_m: f64) -> Result<Self, GridError> {
        if rows == 0 || columns == 0 {
            return Err(GridError::Empty { rows, columns });
        }
        if rows.checked_mul(columns).is_none_or(|cells| cells >= u32::MAX as usize) {
            return Err(GridError::TooManyCells { rows, columns });
        }
        if !(cell_size_m.is_finite() && cell_size_m > 0.0) {
            return Err(GridError::NotALength {
                name: "cell size",
                given: cell_size_m,
                and: " and above zero",
            });
        }
        for (name, given) in [("west edge", west_m), ("north edge", north_m)] {
            if !given.is_finite() {
                return Err(GridError::NotALength { name, given, and: "" });
            }
        }
        Ok(Self {
            rows,
            columns,
            cell_size_m,
            west_m,
            north_m,
        })
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Side of a cell in metres.
    pub fn cell_size_m(&self) -> f64 {
        self.cell_size_m
    }

    /// Map x of the west edge.
    pub fn west_m(&self) -> f64 {
        self.west_m
    }

    /// Map y of the north edge.
    pub fn north_m(&self) -> f64 {
        self.north_m
    }

    /// Number of cells.
    pub fn cell_count(&self) -> usize {
        self.rows * self.columns
    }

    /// Length of the map's diagonal in metres.
    pub fn diagonal_m(&self) -> f64 {
        (self.rows as f64).hypot(self.columns as f64) * self.cell_size_m
    }

    /// Index of a cell in row-major order.
    pub fn index(&self, cell: Cell) -> usize {
        debug_assert!(cell.row < self.rows && cell.column < self.columns);
        cell.row * self.columns + cell.column
    }

    /// The cell at an index.
    pub fn cell(&self, index: usize) -> Cell {
        debug_assert!(index < self.cell_count());
        Cell::new(index / self.columns, index % self.columns)
    }

    /// The cell at a signed row and column, if inside.
    pub fn checked(&self, row: i64, column: i64) -> Option<Cell> {
        let inside = (0..self.rows as i64).contains(&row) && (0..self.columns as i64).contains(&column);
        inside.then(|| Cell::new(row as usize, column as usize))
    }

    /// The cell a number of rows and columns away, if inside.
    pub fn offset(&self, cell: Cell, rows: i32, columns: i32) -> Option<Cell> {
        self.checked(
            cell.row as i64 + i64::from(rows),
            cell.column as i64 + i64::from(columns),
        )
    }

    /// The cell that holds a position, if inside. The south and east edges are outside.
    pub fn cell_at(&self, position: Position) -> Option<Cell> {
        let row = ((self.north_m - position.y_m) / self.cell_size_m).floor();
        let column = ((position.x_m - self.west_m) / self.cell_size_m).floor();
        let inside = row >= 0.0 && row < self.rows as f64 && column >= 0.0 && column < self.columns as f64;
        inside.then(|| Cell::new(row as usize, column as usize))
    }

    /// The centre of a cell.
    pub fn centre(&self, cell: Cell) -> Position {
        Position::new(
            self.west_m + (cell.column as f64 + 0.5) * self.cell_size_m,
            self.north_m - (cell.row as f64 + 0.5) * self.cell_size_m,
        )
    }

    /// A position in cells south of the north edge and east of the west edge, fractions kept.
    pub fn fractional(&self, position: Position) -> (f64, f64) {
        (
            (self.north_m - position.y_m) / self.cell_size_m,
            (position.x_m - self.west_m) / self.cell_size_m,
        )
    }

    /// Every cell, row by row from the north-west.
    pub fn cells(&self) -> impl Iterator<Item = Cell> + use<> {
        let columns = self.columns;
        (0..self.cell_count()).map(move |index| Cell::new(index / columns, index % columns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn cell_to_position_and_back_is_identity(
            rows in 1usize..500, columns in 1usize..500, size in 0.01f64..500.0,
            west in -1e7f64..1e7, north in -1e7f64..1e7, pick: prop::sample::Index,
        ) {
            let geometry = GridGeometry::new(rows, columns, size, west, north).unwrap();
            let cell = geometry.cell(pick.index(geometry.cell_count()));
            prop_assert_eq!(geometry.cell_at(geometry.centre(cell)), Some(cell));
            prop_assert_eq!(geometry.cell(geometry.index(cell)), cell);
        }

        #[test]
        fn distance_to_a_segment_is_never_more_than_to_its_ends(
            p in (-9.0..9.0, -9.0..9.0), a in (-9.0..9.0, -9.0..9.0), b in (-9.0..9.0, -9.0..9.0),
        ) {
            let [p, a, b] = [p, a, b].map(|(x, y)| Position::new(x, y));
            let distance = p.distance_to_segment_m(a, b);
            prop_assert!(distance <= p.distance_m(a) + 1e-12 && distance <= p.distance_m(b) + 1e-12);
        }
    }

    #[test]
    fn rejects_grids_that_cannot_be() {
        assert!(matches!(
            GridGeometry::new(0, 3, 1.0, 0.0, 0.0),
            Err(GridError::Empty { .. })
        ));
        assert!(matches!(
            GridGeometry::new(1 << 20, 1 << 20, 1.0, 0.0, 0.0),
            Err(GridError::TooManyCells { .. })
        ));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(GridGeometry::new(3, 3, bad, 0.0, 0.0).is_err());
        }
        assert!(GridGeometry::new(3, 3, 1.0, f64::NAN, 0.0).is_err());
    }

    #[test]
    fn north_is_row_zero_and_far_edges_are_outside() {
        let geometry = GridGeometry::new(2, 3, 10.0, 100.0, 200.0).unwrap();
        assert_eq!(geometry.cell_at(Position::new(100.0, 200.0)), Some(Cell::new(0, 0)));
        assert_eq!(geometry.cell_at(Position::new(129.9, 180.1)), Some(Cell::new(1, 2)));
        assert_eq!(geometry.cell_at(Position::new(130.0, 190.0)), None);
        assert_eq!(geometry.cell_at(Position::new(105.0, 180.0)), None);
        assert_eq!(geometry.cell_at(Position::new(f64::NAN, 190.0)), None);
    }
}
