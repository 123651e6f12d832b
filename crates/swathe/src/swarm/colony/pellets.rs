//! Pellets: a bit says that a cell is full, a count is kept only where more than one pellet makes it so.

use crate::grid::Cell;
use crate::rank::CellSource;

use super::{Colony, flag};

impl<Source: CellSource> Colony<Source> {
    /// Pellets on a cell.
    pub fn pellets(&self, cell: Cell) -> u8 {
        self.pellets_at(self.geometry.index(cell))
    }

    pub(super) fn pellets_at(&self, index: usize) -> u8 {
        let full = u8::from(self.flags[index] & flag::FULL > 0);
        self.pellets.get(index).copied().unwrap_or(full)
    }

    pub(super) fn clear_pellets(&mut self, index: usize) {
        self.flags[index] &= !flag::FULL;
        if let Some(pellets) = self.pellets.get_mut(index) {
            *pellets = 0;
        }
    }

    /// Adds a pellet to a cell that is not full; returns whether it is full now.
    pub(super) fn drop_pellet(&mut self, index: usize) -> bool {
        let full = self.pellets.get_mut(index).is_none_or(|pellets| {
            *pellets += 1;
            *pellets == self.params.pellet_max
        });
        self.flags[index] |= u8::from(full) * flag::FULL;
        full
    }

    /// Takes a pellet back from a cell that was full.
    pub(super) fn take_pellet(&mut self, index: usize) {
        self.flags[index] &= !flag::FULL;
        if let Some(pellets) = self.pellets.get_mut(index) {
            *pellets = pellets.saturating_sub(1);
        }
    }
}
