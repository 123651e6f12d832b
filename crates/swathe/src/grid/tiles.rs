//! A layer whose values come tile by tile, and stay away where nobody asked for them.

use std::sync::OnceLock;

use super::{Cell, GridError, GridGeometry, LayerView};

/// How the cells of a geometry are cut into square tiles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileGrid {
    geometry: GridGeometry,
    shift: u32,
    first: (usize, usize),
    rows: usize,
    columns: usize,
}

/// The cells of a tile that lie on the grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileCells {
    /// Its first row.
    pub row: usize,
    /// Its first column.
    pub column: usize,
    /// Its rows.
    pub rows: usize,
    /// Its columns.
    pub columns: usize,
}

impl TileGrid {
    /// Tiles of `side` x `side` cells, a power of two. `first` is the row and column inside its tile of the cell in the
    /// north-west, so that the tiles of a part of a map can be those of the map.
    ///
    /// # Errors
    /// [`GridError::TileSide`] when the side is no power of two, or the first cell lies outside a tile.
    pub fn new(geometry: GridGeometry, side: usize, first: (usize, usize)) -> Result<Self, GridError> {
        if !side.is_power_of_two() || side > 1 << 15 || first.0.max(first.1) >= side {
            return Err(GridError::TileSide { side, first });
        }
        Ok(Self {
            geometry,
            shift: side.trailing_zeros(),
            first,
            rows: (first.0 + geometry.rows()).div_ceil(side),
            columns: (first.1 + geometry.columns()).div_ceil(side),
        })
    }

    /// The cells that are cut.
    pub fn geometry(&self) -> GridGeometry {
        self.geometry
    }

    /// Number of tiles.
    pub fn count(&self) -> usize {
        self.rows * self.columns
    }

    /// Cells of the side of a tile.
    pub fn side(&self) -> usize {
        1 << self.shift
    }

    /// The number of the tile that holds a cell, counted row by row from the north-west.
    pub fn tile_of(&self, cell: Cell) -> usize {
        ((cell.row + self.first.0) >> self.shift) * self.columns + ((cell.column + self.first.1) >> self.shift)
    }

    /// The cells of a tile.
    pub fn cells_of(&self, tile: usize) -> TileCells {
        let span = |place: usize, first: usize, cells: usize| {
            let low = (place << self.shift).saturating_sub(first);
            let high = (((place + 1) << self.shift) - first).min(cells);
            (low, high - low)
        };
        let (row, rows) = span(tile / self.columns, self.first.0, self.geometry.rows());
        let (column, columns) = span(tile % self.columns, self.first.1, self.geometry.columns());
        TileCells {
            row,
            column,
            rows,
            columns,
        }
    }

    /// The tiles that hold a cell or any within `reach` rows and columns of it.
    pub fn tiles_around(&self, cell: Cell, reach: usize) -> impl Iterator<Item = usize> {
        let span = |place: usize, first: usize, cells: usize| {
            let low = (place.saturating_sub(reach) + first) >> self.shift;
            let high = (place.saturating_add(reach).min(cells - 1) + first) >> self.shift;
            low..=high
        };
        let columns = span(cell.column, self.first.1, self.geometry.columns());
        let wide = self.columns;
        span(cell.row, self.first.0, self.geometry.rows())
            .flat_map(move |row| columns.clone().map(move |column| row * wide + column))
    }

    fn place_in_tile(&self, cell: Cell) -> usize {
        let inside = self.side() - 1;
        (((cell.row + self.first.0) & inside) << self.shift) | ((cell.column + self.first.1) & inside)
    }
}

/// Values of a grid, each tile of them there or not yet. A tile is written once, so readers need no lock.
#[derive(Debug)]
pub struct Tiles<T> {
    grid: TileGrid,
    slots: Vec<OnceLock<Box<[T]>>>,
    unread: T,
}

impl<T: Copy> Tiles<T> {
    /// No tile is there: every cell has the value `unread`.
    pub fn new(grid: TileGrid, unread: T) -> Self {
        Self {
            grid,
            slots: (0..grid.count()).map(|_| OnceLock::new()).collect(),
            unread,
        }
    }

    /// How the cells are cut.
    pub fn grid(&self) -> TileGrid {
        self.grid
    }

    /// Whether a tile is there.
    pub fn has(&self, tile: usize) -> bool {
        self.slots[tile].get().is_some()
    }

    /// Number of tiles that are there.
    pub fn read_count(&self) -> usize {
        self.slots.iter().filter(|slot| slot.get().is_some()).count()
    }

    /// Writes the values of the cells of a tile, row by row; a tile that is there already stays as it is.
    ///
    /// # Errors
    /// [`GridError::ShapeMismatch`] when there is not one value per cell of the tile.
    pub fn set(&self, tile: usize, values: &[T]) -> Result<(), GridError> {
        let cells = self.grid.cells_of(tile);
        let (expected, found) = (cells.rows * cells.columns, values.len());
        if expected != found {
            let what = "the tile";
            return Err(GridError::ShapeMismatch { what, expected, found });
        }
        let side = self.grid.side();
        let mut all = vec![self.unread; side * side].into_boxed_slice();
        for (row, values) in values.chunks(cells.columns).enumerate() {
            let first = self.grid.place_in_tile(Cell::new(cells.row + row, cells.column));
            all[first..first + cells.columns].copy_from_slice(values);
        }
        // Whoever was first wrote the same.
        let _ = self.slots[tile].set(all);
        Ok(())
    }
}

impl<T> Tiles<T> {
    /// The layer, borrowed.
    pub fn view(&self) -> LayerView<'_, T> {
        LayerView::of_tiles(self.grid.geometry, self)
    }

    /// The value of a cell, or that of cells that were not read.
    pub(super) fn at(&self, cell: Cell) -> &T {
        match self.slots[self.grid.tile_of(cell)].get() {
            Some(values) => &values[self.grid.place_in_tile(cell)],
            None => &self.unread,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn grid(rows: usize, columns: usize, side: usize, first: (usize, usize)) -> TileGrid {
        TileGrid::new(GridGeometry::new(rows, columns, 1.0, 0.0, 0.0).unwrap(), side, first).unwrap()
    }

    proptest! {
        #[test]
        fn every_cell_lies_in_the_cells_of_its_tile_and_in_no_other(
            rows in 1usize..20, columns in 1usize..20, shift in 0u32..5, first: (u8, u8),
        ) {
            let side = 1usize << shift;
            let grid = grid(rows, columns, side, (usize::from(first.0) % side, usize::from(first.1) % side));
            let mut seen = 0;
            for tile in 0..grid.count() {
                let cells = grid.cells_of(tile);
                prop_assert!(cells.rows > 0 && cells.columns > 0 && cells.rows <= side && cells.columns <= side);
                for row in cells.row..cells.row + cells.rows {
                    for column in cells.column..cells.column + cells.columns {
                        prop_assert_eq!(grid.tile_of(Cell::new(row, column)), tile);
                        seen += 1;
                    }
                }
            }
            prop_assert_eq!(seen, rows * columns);
        }

        #[test]
        fn a_layer_of_which_all_tiles_are_there_is_the_layer(
            rows in 1usize..20, columns in 1usize..20, shift in 0u32..5, first: (u8, u8), left_out in 0usize..40,
        ) {
            let side = 1usize << shift;
            let grid = grid(rows, columns, side, (usize::from(first.0) % side, usize::from(first.1) % side));
            let tiles = Tiles::new(grid, u32::MAX);
            for tile in (0..grid.count()).filter(|&tile| tile != left_out) {
                let TileCells { row, column, rows: high, columns: wide } = grid.cells_of(tile);
                let values = (row..row + high).flat_map(|r| (column..column + wide).map(move |c| (r * columns + c) as u32));
                tiles.set(tile, &values.collect::<Vec<_>>()).unwrap();
            }
            for cell in grid.geometry().cells() {
                let expected = if grid.tile_of(cell) == left_out { u32::MAX } else { (cell.row * columns + cell.column) as u32 };
                prop_assert_eq!(tiles.view()[cell], expected);
            }
            prop_assert_eq!(tiles.read_count(), grid.count() - usize::from(left_out < grid.count()));
        }

        #[test]
        fn the_tiles_around_a_cell_are_those_of_the_cells_around_it(
            rows in 1usize..20, columns in 1usize..20, shift in 0u32..4, at: (usize, usize), reach in 0usize..6,
        ) {
            let grid = grid(rows, columns, 1 << shift, (0, (1 << shift) - 1));
            let cell = Cell::new(at.0 % rows, at.1 % columns);
            let near = grid.geometry().cells().filter(|near| {
                near.row.abs_diff(cell.row) <= reach && near.column.abs_diff(cell.column) <= reach
            });
            let mut expected: Vec<usize> = near.map(|near| grid.tile_of(near)).collect();
            expected.sort_unstable();
            expected.dedup();
            prop_assert_eq!(grid.tiles_around(cell, reach).collect::<Vec<_>>(), expected);
        }
    }

    #[test]
    fn sides_that_are_no_power_of_two_and_tiles_of_the_wrong_size_are_refused() {
        let geometry = GridGeometry::new(5, 5, 1.0, 0.0, 0.0).unwrap();
        for (side, first) in [(0, (0, 0)), (3, (0, 0)), (4, (4, 0)), (1 << 20, (0, 0))] {
            assert_eq!(
                TileGrid::new(geometry, side, first),
                Err(GridError::TileSide { side, first })
            );
        }
        let tiles = Tiles::new(grid(5, 5, 4, (0, 0)), 0u8);
        assert!(tiles.set(1, &[1; 16]).is_err());
        assert!(tiles.set(1, &[1; 4]).is_ok());
        assert!(tiles.has(1) && !tiles.has(0));
    }
}
