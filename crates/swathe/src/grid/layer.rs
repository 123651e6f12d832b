//! One value per cell of a geometry.

use std::ops::{Index, IndexMut};

use super::{Cell, GridError, GridGeometry, Tiles};

/// Values of a grid, owned, row by row from the north-west.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer<T> {
    geometry: GridGeometry,
    data: Vec<T>,
}

/// Values of a grid, borrowed: all of them side by side, or in tiles of which only some may be there.
#[derive(Debug)]
pub struct LayerView<'a, T> {
    geometry: GridGeometry,
    /// Nothing where the values lie in tiles.
    data: &'a [T],
    tiles: Option<&'a Tiles<T>>,
}

impl<T> Clone for LayerView<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for LayerView<'_, T> {}

impl<T> Layer<T> {
    /// A layer from its values.
    ///
    /// # Errors
    /// [`GridError::ShapeMismatch`] when there is not one value per cell; `what` names the layer in it.
    pub fn new(geometry: GridGeometry, data: Vec<T>, what: &'static str) -> Result<Self, GridError> {
        check(&geometry, data.len(), what)?;
        Ok(Self { geometry, data })
    }

    /// The same value everywhere.
    pub fn filled(geometry: GridGeometry, value: T) -> Self
    where
        T: Clone,
    {
        let data = vec![value; geometry.cell_count()];
        Self { geometry, data }
    }

    /// The geometry.
    pub fn geometry(&self) -> GridGeometry {
        self.geometry
    }

    /// The values.
    pub fn data(&self) -> &[T] {
        &self.data
    }

    /// The values, to be changed.
    pub fn data_mut(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// The values, given away.
    pub fn into_data(self) -> Vec<T> {
        self.data
    }

    /// The layer, borrowed.
    pub fn view(&self) -> LayerView<'_, T> {
        LayerView {
            geometry: self.geometry,
            data: &self.data,
            tiles: None,
        }
    }
}

impl<T> Index<Cell> for Layer<T> {
    type Output = T;
    fn index(&self, cell: Cell) -> &T {
        &self.data[self.geometry.index(cell)]
    }
}

impl<T> IndexMut<Cell> for Layer<T> {
    fn index_mut(&mut self, cell: Cell) -> &mut T {
        let index = self.geometry.index(cell);
        &mut self.data[index]
    }
}

impl<'a, T> LayerView<'a, T> {
    /// A layer over borrowed values.
    ///
    /// # Errors
    /// [`GridError::ShapeMismatch`] when there is not one value per cell; `what` names the layer in it.
    pub fn new(geometry: GridGeometry, data: &'a [T], what: &'static str) -> Result<Self, GridError> {
        check(&geometry, data.len(), what)?;
        let tiles = None;
        Ok(Self { geometry, data, tiles })
    }

    pub(super) fn of_tiles(geometry: GridGeometry, tiles: &'a Tiles<T>) -> Self {
        Self {
            geometry,
            data: &[],
            tiles: Some(tiles),
        }
    }

    /// The geometry.
    pub fn geometry(&self) -> GridGeometry {
        self.geometry
    }

    /// Whether the values lie in tiles: then there are neither [`Self::data`] nor [`Self::row`]s, only cells.
    pub fn is_tiled(&self) -> bool {
        self.tiles.is_some()
    }

    /// The values of a layer that is not in tiles; nothing of one that is.
    pub fn data(&self) -> &'a [T] {
        self.data
    }

    /// One row of values of a layer that is not in tiles.
    pub fn row(&self, row: usize) -> &'a [T] {
        let columns = self.geometry.columns();
        &self.data[row * columns..(row + 1) * columns]
    }
}

impl<T> Index<Cell> for LayerView<'_, T> {
    type Output = T;
    #[inline]
    fn index(&self, cell: Cell) -> &T {
        // The check against the end of the values, which must be made anyway, tells layers in tiles from others.
        match self.data.get(self.geometry.index(cell)) {
            Some(value) => value,
            None => self.in_tiles(cell),
        }
    }
}

impl<T> LayerView<'_, T> {
    /// The value of the cell with an index, which must lie inside; in tiles too.
    #[inline]
    pub fn at(&self, index: usize) -> &T {
        match self.data.get(index) {
            Some(value) => value,
            None => self.in_tiles(self.geometry.cell(index)),
        }
    }

    #[cold]
    fn in_tiles(&self, cell: Cell) -> &T {
        match self.tiles {
            Some(tiles) => tiles.at(cell),
            None => &self.data[self.geometry.index(cell)],
        }
    }
}

fn check(geometry: &GridGeometry, found: usize, what: &'static str) -> Result<(), GridError> {
    let expected = geometry.cell_count();
    if found == expected {
        Ok(())
    } else {
        Err(GridError::ShapeMismatch { what, expected, found })
    }
}
