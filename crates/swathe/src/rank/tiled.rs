//! Ground that is read when it is first needed, tile by tile, between two ticks and on the caller's thread alone.

use std::collections::BTreeSet;
use std::fmt;
use std::sync::{Mutex, PoisonError};

use thiserror::Error;

use crate::grid::{Cell, GridError, LayerView, TileCells, TileGrid, Tiles};

/// Why ground that is needed is not there.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum SourceFault {
    /// The tile whose first cell this is cannot be read.
    #[error("The tile at row {row}, column {column} cannot be read.")]
    Unreadable {
        /// First row of the tile.
        row: usize,
        /// First column of the tile.
        column: usize,
    },
    /// The caller asked to stop.
    #[error("Reading was stopped.")]
    Stopped,
}

/// Reads the tiles of a map that are missing.
pub trait TileReader: fmt::Debug + Sync {
    /// Reads what is missing of the ground within `reach` rows and columns of the cells, each tile once.
    ///
    /// # Errors
    /// [`SourceFault`]; tiles that came before stay.
    fn read_around(&self, cells: &mut dyn Iterator<Item = Cell>, reach: usize) -> Result<(), SourceFault>;
}

/// Reads the heights of some cells, row by row; NaN is unknown.
type ReadTile<'a> = dyn FnMut(TileCells) -> Result<Vec<f32>, SourceFault> + Send + 'a;

/// Heights in tiles with what reads them.
pub struct TiledHeights<'a> {
    elevation_m: &'a Tiles<f32>,
    read: Mutex<Box<ReadTile<'a>>>,
}

impl fmt::Debug for TiledHeights<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let read = self.elevation_m.read_count();
        write!(formatter, "TiledHeights({read} of {} tiles)", self.grid().count())
    }
}

impl<'a> TiledHeights<'a> {
    /// Tiles, and what reads the cells of one. Cells that are not read are unknown.
    pub fn new(
        elevation_m: &'a Tiles<f32>,
        read: impl FnMut(TileCells) -> Result<Vec<f32>, SourceFault> + Send + 'a,
    ) -> Self {
        Self {
            elevation_m,
            read: Mutex::new(Box::new(read)),
        }
    }

    /// The heights.
    pub fn elevation_m(&self) -> LayerView<'a, f32> {
        self.elevation_m.view()
    }

    fn grid(&self) -> TileGrid {
        self.elevation_m.grid()
    }

    fn read(&self, tile: usize) -> Result<(), SourceFault> {
        let cells = self.grid().cells_of(tile);
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        let heights = (*read)(cells)?;
        self.elevation_m
            .set(tile, &heights)
            .map_err(|_: GridError| SourceFault::Unreadable {
                row: cells.row,
                column: cells.column,
            })
    }
}

impl TileReader for TiledHeights<'_> {
    fn read_around(&self, cells: &mut dyn Iterator<Item = Cell>, reach: usize) -> Result<(), SourceFault> {
        let grid = self.grid();
        let mut missing = BTreeSet::new();
        for cell in cells {
            missing.extend(
                grid.tiles_around(cell, reach)
                    .filter(|&tile| !self.elevation_m.has(tile)),
            );
        }
        missing.into_iter().try_for_each(|tile| self.read(tile))
    }
}
