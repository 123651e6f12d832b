//! A colony whose agents are sent: the caller decides where they are deployed, the rules of nests stay the same.

use crate::grid::Cell;
use crate::rank::CellSource;

use super::{Colony, GROUND, flag};

impl<Source: CellSource> Colony<Source> {
    /// Ticks in which the agents visit these cells, as many a tick as there are agents. Cells outside the swathe are left
    /// out, and so is what the budget does not allow; none moves when ground that is needed cannot be read ([`Self::spent`]).
    pub fn send(&mut self, cells: &[Cell]) {
        let ground = |cell: &Cell| self.flags[self.geometry.index(*cell)] & GROUND == flag::INSIDE;
        let cells = cells.iter().filter(|cell| ground(cell));
        let cells: Vec<u32> = cells.map(|&cell| self.geometry.index(cell) as u32).collect();
        if !self.prefetch(&mut cells.iter().map(|&cell| cell as usize)) {
            return;
        }
        for sent in cells.chunks(self.agents.len().max(1)) {
            if self.spent().is_some() {
                break;
            }
            self.tick(sent);
        }
        // These visits were not random.
        self.quiet_visits = 0;
    }

    /// Whether a cell is known to be suitable.
    pub fn is_suitable(&self, cell: Cell) -> bool {
        self.flags[self.geometry.index(cell)] & flag::SUITABLE > 0
    }

    /// Whether a cell lies in a nest.
    pub fn is_nest(&self, cell: Cell) -> bool {
        self.flags[self.geometry.index(cell)] & flag::NEST > 0
    }

    /// Whether a cell may still become a core.
    pub fn is_open(&self, cell: Cell) -> bool {
        self.flags[self.geometry.index(cell)] & (flag::INSIDE | flag::DEAD | flag::CORE) == flag::INSIDE
    }

    /// Whether nothing that is known keeps a cell out of every nest: some cell of its vicinity is or may become a core.
    pub fn may_be_nest(&self, cell: Cell) -> bool {
        let flags = self.flags[self.geometry.index(cell)];
        // Most cells are unseen, and may be cores themselves.
        if flags & flag::NEST > 0 || flags & (flag::INSIDE | flag::DEAD) == flag::INSIDE {
            return true;
        }
        flags & (flag::EVALUATED | flag::SUITABLE) != flag::EVALUATED
            && self
                .vicinity
                .iter()
                .any(|step| step.from(&self.geometry, cell).is_some_and(|core| self.is_open(core)))
    }

    /// The cells that must be settled before it is known whether `cell` lies in a nest.
    pub fn open_cores(&self, cell: Cell) -> impl Iterator<Item = Cell> {
        self.vicinity
            .iter()
            .filter_map(move |step| step.from(&self.geometry, cell))
            .filter(|&core| self.is_open(core))
    }

    /// Number of cells that may still become cores.
    pub fn open_count(&self) -> u64 {
        self.open
    }
}
