//! Nest cells that follow changed ranks: the opening of the suitable cells, worked out anew only around what has changed.

use crate::grid::{Cell, GridGeometry, Layer, Step};
use crate::nest::{BitRows, NestError, NestParams, Nests, label_nests};
use crate::rank::RankView;

const SUITABLE: u8 = 1;
const CORE: u8 = 2;
const NEST: u8 = 4;

/// Which cells are suitable, cores and nests.
#[derive(Clone, Debug)]
pub(super) struct NestCells {
    params: NestParams,
    steps: Vec<Step>,
    flags: Layer<u8>,
}

impl NestCells {
    /// The nests of a map of plain ranks.
    ///
    /// # Errors
    /// [`NestError`] when a parameter is outside its range.
    pub fn new(ranks: &Layer<u8>, params: NestParams) -> Result<Self, NestError> {
        let steps = params.validate()?;
        let geometry = ranks.geometry();
        let suitable = BitRows::at_least(geometry, ranks.data(), params.rank_min, |&rank| rank);
        let mut cores = suitable.eroded(&steps, params.border_suitable);
        cores.keep(&suitable);
        let mut nests = cores.dilated(&steps);
        nests.keep(&suitable);
        let flags = geometry.cells().map(|cell| {
            let flag = |set: &BitRows, flag: u8| if set.get(cell) { flag } else { 0 };
            flag(&suitable, SUITABLE) | flag(&cores, CORE) | flag(&nests, NEST)
        });
        let flags = flags.collect();
        Ok(Self {
            params,
            steps,
            flags: Layer::new(geometry, flags, "the nests")?,
        })
    }

    pub fn holds(&self, cell: Cell) -> bool {
        self.flags[cell] & NEST > 0
    }

    pub fn holds_at(&self, index: usize) -> bool {
        self.flags.data()[index] & NEST > 0
    }

    /// Labels and sizes of the nests.
    ///
    /// # Errors
    /// [`NestError`] never in practice: the parameters were checked.
    pub fn labelled(&self, ranks: &Layer<u8>) -> Result<Nests, NestError> {
        let geometry = self.geometry();
        let plain = RankView::new(geometry, ranks.data()).map_err(|_| NestError::RankMin {
            rank: self.params.rank_min,
        })?;
        let mut labels = Layer::filled(geometry, 0);
        let sizes = label_nests(plain, &self.params, labels.data_mut())?;
        Ok(Nests::new(labels, sizes))
    }

    fn geometry(&self) -> GridGeometry {
        self.flags.geometry()
    }

    /// Takes in that cells have other ranks now; returns those that came into a nest or left one, in the order of rows.
    pub fn update(&mut self, changed: impl Iterator<Item = Cell>, ranks: &Layer<u8>) -> Vec<Cell> {
        let geometry = self.geometry();
        let mut near = Vec::new();
        for cell in changed {
            let suitable = ranks[cell] >= self.params.rank_min;
            if suitable != (self.flags[cell] & SUITABLE > 0) {
                self.flags[cell] ^= SUITABLE;
                // Vicinities are symmetric: these are the cells in whose vicinity the changed one lies.
                self.list_around(cell, &mut near);
            }
        }
        let mut touched = Vec::new();
        for index in once_each(near) {
            let cell = geometry.cell(index as usize);
            if self.is_core(cell) != (self.flags[cell] & CORE > 0) {
                self.flags[cell] ^= CORE;
                self.list_around(cell, &mut touched);
            } else if self.flags[cell] & (SUITABLE | NEST) == NEST {
                touched.push(index);
            }
        }
        let mut toggled = Vec::new();
        for index in once_each(touched) {
            let cell = geometry.cell(index as usize);
            if self.is_nest(cell) != (self.flags[cell] & NEST > 0) {
                self.flags[cell] ^= NEST;
                toggled.push(cell);
            }
        }
        toggled
    }

    fn list_around(&self, cell: Cell, found: &mut Vec<u32>) {
        let geometry = self.geometry();
        let near = self.steps.iter().filter_map(|step| step.from(&geometry, cell));
        found.extend(near.map(|near| geometry.index(near) as u32));
    }

    fn is_core(&self, cell: Cell) -> bool {
        let geometry = self.geometry();
        let fits = |step: &Step| match step.from(&geometry, cell) {
            Some(near) => self.flags[near] & SUITABLE > 0,
            None => self.params.border_suitable,
        };
        self.flags[cell] & SUITABLE > 0 && self.steps.iter().all(fits)
    }

    fn is_nest(&self, cell: Cell) -> bool {
        let geometry = self.geometry();
        let mut near = self.steps.iter().filter_map(|step| step.from(&geometry, cell));
        self.flags[cell] & SUITABLE > 0 && near.any(|near| self.flags[near] & CORE > 0)
    }
}

fn once_each(mut cells: Vec<u32>) -> Vec<u32> {
    cells.sort_unstable();
    cells.dedup();
    cells
}
