//! Where agents go: pure functions of the frozen state, so that the order in which they are served does not matter.

use crate::grid::{Cell, EIGHT, GridGeometry};
use crate::random::{below, philox, unit};

use super::{Explore, State, SwarmParams};

/// Tries to find a cell inside the swathe before an agent stays where it is.
const DEPLOYMENT_TRIES: u32 = 64;

/// The box of cells that holds the swathe.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    pub row: usize,
    pub column: usize,
    pub rows: usize,
    pub columns: usize,
}

impl Extent {
    pub(super) fn cell_count(self) -> u64 {
        self.rows as u64 * self.columns as u64
    }
}

/// What a move is decided from.
pub(super) struct Field<'a, Inside, Pellets> {
    pub geometry: GridGeometry,
    pub extent: Extent,
    pub params: &'a SwarmParams,
    pub inside: Inside,
    pub pellets: Pellets,
}

impl SwarmParams {
    /// The numbers by which an agent's move in a tick is decided.
    #[inline]
    pub(super) fn draw(&self, agent: u32, tick: u64) -> [u32; 2] {
        let draw = philox([agent, tick as u32, (tick >> 32) as u32, 0], self.seed);
        [draw[0], draw[1]]
    }

    /// Whether a move is a new deployment, and not a step.
    #[inline]
    pub(super) fn is_deployed(&self, tick: u64, draw: [u32; 2]) -> bool {
        self.explore != Explore::Walk || tick == 0 || unit(draw[0]) < self.teleport
    }

    /// How an agent comes to its cell in a tick: deployed anew, or on foot.
    pub(super) fn arrival(&self, agent: u32, tick: u64) -> State {
        if self.is_deployed(tick, self.draw(agent, tick)) {
            State::Deploy
        } else {
            State::Forage
        }
    }
}

impl<Inside: Fn(usize) -> bool, Pellets: Fn(usize) -> u8> Field<'_, Inside, Pellets> {
    /// The cell that an agent visits in a tick (tick 0 is the first deployment), unless a permutation sends it. `draw` is
    /// that of [`SwarmParams::draw`].
    pub(super) fn visit(&self, agent: u32, tick: u64, draw: [u32; 2], here: Cell) -> Cell {
        if self.params.is_deployed(tick, draw) {
            self.deploy(agent, tick).unwrap_or(here)
        } else {
            self.step(here, draw[1])
        }
    }

    /// A random cell of the swathe, all equally likely.
    fn deploy(&self, agent: u32, tick: u64) -> Option<Cell> {
        let mut attempts = (1..=DEPLOYMENT_TRIES).map(|attempt| self.landing(agent, tick, attempt));
        attempts.find(|&cell| (self.inside)(self.geometry.index(cell)))
    }

    /// Where a deployed agent comes down at an attempt, counted from 1: somewhere in the box that holds the swathe.
    pub(super) fn landing(&self, agent: u32, tick: u64, attempt: u32) -> Cell {
        let draw = philox([agent, tick as u32, (tick >> 32) as u32, attempt], self.params.seed);
        Cell::new(
            self.extent.row + below(draw[0], self.extent.rows as u32) as usize,
            self.extent.column + below(draw[1], self.extent.columns as u32) as usize,
        )
    }

    /// A step to one of eight neighbours; at the swathe's edge the agent turns back, or stays in a corner.
    fn step(&self, cell: Cell, word: u32) -> Cell {
        let direction = if self.params.attract > 0.0 {
            self.attracted(cell, word)
        } else {
            (word >> 29) as usize
        };
        let target = |direction: usize| {
            EIGHT[direction]
                .from(&self.geometry, cell)
                .filter(|&near| (self.inside)(self.geometry.index(near)))
        };
        target(direction)
            .or_else(|| target((direction + 4) % 8))
            .unwrap_or(cell)
    }

    /// A direction drawn with weight 1 + attraction x share of pellets there.
    fn attracted(&self, cell: Cell, word: u32) -> usize {
        let weight = EIGHT.map(|step| {
            step.from(&self.geometry, cell).map_or(1.0, |near| {
                let pellets = f64::from((self.pellets)(self.geometry.index(near)));
                1.0 + self.params.attract * pellets / f64::from(self.params.pellet_max)
            })
        });
        let mut left = unit(word) * weight.iter().sum::<f64>();
        weight
            .iter()
            .position(|weight| {
                left -= weight;
                left < 0.0
            })
            .unwrap_or(7)
    }
}
