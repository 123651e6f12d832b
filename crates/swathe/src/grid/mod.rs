//! One geometry, many layers: cells, positions, layers and the iterators that walk them.

mod distance;
mod geometry;
mod layer;
mod segment;
mod steps;
mod tiles;

pub use distance::{UNREACHED, squared_distances};
pub use geometry::{Cell, GridError, GridGeometry, Position};
pub use layer::{Layer, LayerView};
pub use segment::{Piece, pieces, swept_cells};
pub use steps::{EIGHT, FOUR, SIXTEEN, Step, disc};
pub use tiles::{TileCells, TileGrid, Tiles};
