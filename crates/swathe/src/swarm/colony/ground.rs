//! The ground of a colony: which cells its agents walk on, and which of them may still become cores.

use crate::grid::{Cell, Layer};
use crate::nest::BitRows;
use crate::rank::CellSource;
use crate::swarm::agents::Extent;
use crate::swarm::itinerary::Itinerary;
use crate::swarm::{Explore, SwarmError};

use super::{Colony, GROUND, flag, planes};

impl<Source: CellSource> Colony<Source> {
    /// Enlarges the swathe; nothing that is known is evaluated again. Cells that could not be cores only because the old
    /// swathe ended beside them may become cores now; cores that counted on suitable ground beyond it must be found again.
    ///
    /// # Errors
    /// [`SwarmError::Grid`] when the mask does not fit the map.
    pub fn widen(&mut self, inside: &Layer<bool>) -> Result<(), SwarmError> {
        let mask = inside.data();
        Layer::new(self.geometry, vec![(); mask.len()], "the swathe")?;
        for (flags, &inside) in self.flags.iter_mut().zip(mask) {
            *flags |= u8::from(inside) * flag::INSIDE;
        }
        self.extent = self.ground_box().unwrap_or(self.extent);
        self.epoch_start = self.tally.ticks;
        self.ground_cells = self
            .flags
            .iter()
            .map(|flags| u64::from(flags & GROUND == flag::INSIDE))
            .sum();
        self.quiet_visits = 0;
        self.itinerary =
            (self.params.explore == Explore::Permute).then(|| Itinerary::new(self.extent, self.params.seed));
        let lost = self.uncore_the_leaning();
        self.reopen();
        self.forget_cores(&lost);
        Ok(())
    }

    /// The smallest box that holds the agents' ground.
    pub(super) fn ground_box(&self) -> Option<Extent> {
        let ground = |flags: &u8| flags & GROUND == flag::INSIDE;
        let columns = self.geometry.columns();
        let (mut first, mut last) = ((usize::MAX, usize::MAX), (0, 0));
        for (row, flags) in self.flags.chunks(columns).enumerate() {
            if let (Some(west), Some(east)) = (flags.iter().position(ground), flags.iter().rposition(ground)) {
                first = (first.0.min(row), first.1.min(west));
                last = (row, last.1.max(east));
            }
        }
        (first.0 != usize::MAX).then(|| Extent {
            row: first.0,
            column: first.1,
            rows: last.0 - first.0 + 1,
            columns: last.1 - first.1 + 1,
        })
    }

    /// Takes the cores that counted on ground beyond the swathe which nobody has looked at for cores no more, and returns
    /// them.
    pub(super) fn uncore_the_leaning(&mut self) -> Vec<Cell> {
        let mut lost = Vec::new();
        if !self.params.nest.border_suitable || self.tally.cores == 0 {
            return lost;
        }
        for index in 0..self.flags.len() {
            if self.flags[index] & flag::CORE > 0 && self.leans_on_the_border(index) {
                self.flags[index] &= !flag::CORE;
                lost.push(self.geometry.cell(index));
            }
        }
        lost
    }

    /// Decides of every cell of the swathe but the cores whether it may be a core, a word of cells at a time: as
    /// [`Self::may_be_core`] does for one.
    pub(super) fn reopen(&mut self) {
        let border = self.params.nest.border_suitable;
        let kind = BitRows::at_least(self.geometry, &self.flags, 1, |flags| {
            let known_bad = flags & (flag::EVALUATED | flag::SUITABLE) == flag::EVALUATED;
            let is_inside = flags & flag::INSIDE > 0;
            u8::from((is_inside && !known_bad) || (!is_inside && border))
        });
        let possible = kind.eroded(&self.vicinity, border);
        let columns = self.geometry.columns();
        self.open = 0;
        for (row, flags) in self.flags.chunks_mut(columns).enumerate() {
            for (flags, &word) in flags.chunks_mut(64).zip(possible.row(row)) {
                let mut open = 0u8;
                for (flags, possible) in flags.iter_mut().zip(planes::spread(word)) {
                    let settled = *flags & (flag::INSIDE | flag::CORE) != flag::INSIDE;
                    let opens = possible > 0 && *flags & flag::HALO == 0;
                    // A count of pellets that is full would never trigger the test again.
                    let reopened = *flags & !(flag::DEAD | flag::FULL);
                    let decided = if opens { reopened } else { *flags | flag::DEAD };
                    open += u8::from(opens && !settled);
                    *flags = if settled { *flags } else { decided };
                }
                self.open += u64::from(open);
            }
        }
        for (pellets, flags) in self.pellets.iter_mut().zip(&self.flags) {
            if flags & (flag::INSIDE | flag::CORE | flag::DEAD) == flag::INSIDE {
                *pellets = 0;
            }
        }
    }

    /// Whether nothing that is known keeps a cell from being a core.
    pub(super) fn may_be_core(&self, index: usize) -> bool {
        if self.flags[index] & flag::HALO > 0 {
            return false;
        }
        let cell = self.geometry.cell(index);
        self.vicinity.iter().all(|step| {
            let near = step
                .from(&self.geometry, cell)
                .map(|near| self.flags[self.geometry.index(near)]);
            match near {
                Some(flags) if flags & flag::INSIDE > 0 => {
                    flags & (flag::EVALUATED | flag::SUITABLE) != flag::EVALUATED
                }
                _ => self.params.nest.border_suitable,
            }
        })
    }

    /// Whether ground that was beyond the swathe and counted as suitable is inside now, and nobody has looked at it.
    pub(super) fn leans_on_the_border(&self, core: usize) -> bool {
        let cell = self.geometry.cell(core);
        let near = self.vicinity.iter().filter_map(|step| step.from(&self.geometry, cell));
        let mut flags = near.map(|near| self.flags[self.geometry.index(near)]);
        self.params.nest.border_suitable && flags.any(|flags| flags & (flag::INSIDE | flag::EVALUATED) == flag::INSIDE)
    }
}
