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

    fn cell(self, number: u64) -> Cell {
        Cell::new(
            self.row + (number / self.columns as u64) as usize,
            self.column + (number % self.columns as u64) as usize,
        )
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
    /// How an agent comes to its cell in a tick: deployed anew, or on foot.
    pub(super) fn arrival(&self, agent: u32, tick: u64) -> State {
        let walks = || {
            let draw = philox([agent, tick as u32, (tick >> 32) as u32, 0], self.seed);
            unit(draw[0]) >= self.teleport
        };
        if self.explore == Explore::Walk && tick > 0 && walks() {
            State::Forage
        } else {
            State::Deploy
        }
    }
}

impl<Inside: Fn(usize) -> bool, Pellets: Fn(usize) -> u8> Field<'_, Inside, Pellets> {
    /// The cell that an agent visits in a tick (tick 0 is the first deployment), or `None` when a permutation sends it
    /// outside the swathe.
    pub(super) fn visit(&self, agent: u32, tick: u64, here: usize) -> Option<usize> {
        let draw = philox([agent, tick as u32, (tick >> 32) as u32, 0], self.params.seed);
        match self.params.explore {
            Explore::Permute => {
                let visit = tick * u64::from(self.params.agents) + u64::from(agent);
                let number = permuted(visit, self.extent.cell_count(), self.params.seed);
                let index = self.geometry.index(self.extent.cell(number));
                (self.inside)(index).then_some(index)
            }
            Explore::Uniform => Some(self.deploy(agent, tick).unwrap_or(here)),
            Explore::Walk if tick == 0 || unit(draw[0]) < self.params.teleport => {
                Some(self.deploy(agent, tick).unwrap_or(here))
            }
            Explore::Walk => Some(self.step(here, draw[1])),
        }
    }

    /// A random cell of the swathe, all equally likely.
    fn deploy(&self, agent: u32, tick: u64) -> Option<usize> {
        (1..=DEPLOYMENT_TRIES).find_map(|attempt| {
            let draw = philox([agent, tick as u32, (tick >> 32) as u32, attempt], self.params.seed);
            let cell = Cell::new(
                self.extent.row + below(draw[0], self.extent.rows as u32) as usize,
                self.extent.column + below(draw[1], self.extent.columns as u32) as usize,
            );
            let index = self.geometry.index(cell);
            (self.inside)(index).then_some(index)
        })
    }

    /// A step to one of eight neighbours; at the swathe's edge the agent turns back, or stays in a corner.
    fn step(&self, here: usize, word: u32) -> usize {
        let cell = self.geometry.cell(here);
        let direction = if self.params.attract > 0.0 {
            self.attracted(cell, word)
        } else {
            (word >> 29) as usize
        };
        let target = |direction: usize| {
            EIGHT[direction]
                .from(&self.geometry, cell)
                .map(|near| self.geometry.index(near))
                .filter(|&index| (self.inside)(index))
        };
        target(direction)
            .or_else(|| target((direction + 4) % 8))
            .unwrap_or(here)
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

/// Visit number `visit` of a random order of `0..count` that repeats every `count` visits: a Feistel network over the
/// next power of four, walked until it lands inside.
fn permuted(visit: u64, count: u64, seed: u64) -> u64 {
    let half_bits = (64 - (count.max(2) - 1).leading_zeros()).div_ceil(2);
    let mask = (1u64 << half_bits) - 1;
    let mut number = visit % count;
    loop {
        let (mut left, mut right) = (number >> half_bits, number & mask);
        for round in 0..4 {
            let mixed = philox([right as u32, (right >> 32) as u32, round, u32::MAX], seed)[0];
            (left, right) = (right, left ^ (u64::from(mixed) & mask));
        }
        number = left << half_bits | right;
        if number < count {
            return number;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_permutation_visits_each_number_once(count in 1u64..3000, seed: u64) {
            let mut seen = vec![false; count as usize];
            for visit in 0..count {
                let number = permuted(visit, count, seed) as usize;
                prop_assert!(!seen[number]);
                seen[number] = true;
            }
        }
    }
}
