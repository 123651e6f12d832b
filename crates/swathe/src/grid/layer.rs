//! One value per cell of a geometry.

use std::ops::{Index, IndexMut};

use super::{Cell, GridError, GridGeometry};

/// Values of a grid, owned, row by row from the north-west.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer<T> {
    geometry: GridGeometry,
    data: Vec<T>,
}

/// Values of a grid, borrowed.
#[derive(Debug)]
pub struct LayerView<'a, T> {
    geometry: GridGeometry,
    data: &'a [T],
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
        Ok(Self { geometry, data })
    }

    /// The geometry.
    pub fn geometry(&self) -> GridGeometry {
        self.geometry
    }

    /// The values.
    pub fn data(&self) -> &'a [T] {
        self.data
    }

    /// One row of values.
    pub fn row(&self, row: usize) -> &'a [T] {
        let columns = self.geometry.columns();
        &self.data[row * columns..(row + 1) * columns]
    }
}

impl<T> Index<Cell> for LayerView<'_, T> {
    type Output = T;
    fn index(&self, cell: Cell) -> &T {
        &self.data[self.geometry.index(cell)]
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
