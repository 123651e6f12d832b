//! Pictures of a swarm at work: what stands in every block of cells at a tick.

use crate::grid::Cell;
use crate::nest::UnionFind;
use crate::progress::Report;
use crate::rank::CellSource;

use super::{Colony, Ending, Tally, flag, sets_of};

/// What is known of a block of cells; a block shows the greatest of its cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Seen {
    /// Outside the swathe.
    Outside = 0,
    /// Not looked at yet.
    Unseen = 1,
    /// Not suitable.
    Unsuitable = 2,
    /// Suitable.
    Suitable = 3,
}

/// A swarm at one tick. Layers are in raster order of blocks of `step` x `step` cells from the north-west.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// What the swarm has done so far.
    pub tally: Tally,
    /// Rows of blocks.
    pub rows: usize,
    /// Columns of blocks.
    pub columns: usize,
    /// Cells per side of a block.
    pub step: usize,
    /// [`Seen`] of every block.
    pub seen: Vec<u8>,
    /// The most pellets on a cell of the block.
    pub pellets: Vec<u8>,
    /// The nest of the block's first nest cell, named by its least cell plus one (names change only when nests merge);
    /// 0 where there is none.
    pub nests: Vec<u32>,
    /// Row and column of the block of every agent.
    pub agents: Vec<[u32; 2]>,
}

/// When frames are taken; the first and the last state of a run always are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FrameTicks {
    /// Every so many ticks; 0 counts as 1.
    Every(u64),
    /// At these ticks, in rising order.
    At(Vec<u64>),
}

impl FrameTicks {
    /// The first tick after `tick` at which a frame is due.
    fn after(&self, tick: u64) -> u64 {
        match self {
            Self::Every(ticks) => {
                let ticks = (*ticks).max(1);
                (tick / ticks + 1).saturating_mul(ticks)
            }
            Self::At(ticks) => ticks.iter().copied().find(|&at| at > tick).unwrap_or(u64::MAX),
        }
    }
}

impl<Source: CellSource> Colony<Source> {
    /// The swarm as it stands, in blocks of `step` x `step` cells (0 counts as 1).
    pub fn frame(&self, step: usize) -> Frame {
        let step = step.max(1);
        let (rows, columns) = (
            self.geometry.rows().div_ceil(step),
            self.geometry.columns().div_ceil(step),
        );
        let blocks = rows * columns;
        let block = |cell: Cell| cell.row / step * columns + cell.column / step;
        let (mut seen, mut pellets, mut nests) = (vec![0; blocks], vec![0; blocks], vec![0; blocks]);
        let built;
        let sets = if self.sets.is_empty() {
            built = self.nests().map_or_else(|_| UnionFind::new(0), |nests| sets_of(&nests));
            &built
        } else {
            &self.sets
        };
        for (index, &flags) in self.flags.iter().enumerate() {
            let at = block(self.geometry.cell(index));
            let here = if flags & flag::INSIDE == 0 {
                Seen::Outside
            } else if flags & flag::EVALUATED == 0 {
                Seen::Unseen
            } else if flags & flag::SUITABLE == 0 {
                Seen::Unsuitable
            } else {
                Seen::Suitable
            };
            seen[at] = seen[at].max(here as u8);
            pellets[at] = pellets[at].max(self.pellets_at(index));
            if nests[at] == 0 && flags & flag::NEST > 0 {
                nests[at] = sets.peek(index as u32) + 1;
            }
        }
        let agents = self
            .agents()
            .map(|cell| [(cell.row / step) as u32, (cell.column / step) as u32]);
        Frame {
            tally: self.tally,
            rows,
            columns,
            step,
            seen,
            pellets,
            nests,
            agents: agents.collect(),
        }
    }

    /// [`Colony::run`] that shows frames on the way; it ends the same. `show` returns false to stop.
    pub fn run_in_frames(
        &mut self,
        ticks: u64,
        frames: &FrameTicks,
        step: usize,
        report: &mut Report,
        show: &mut dyn FnMut(Frame) -> bool,
    ) -> Ending {
        let last = self.tally.ticks.saturating_add(ticks);
        let last = self
            .budget
            .ticks
            .map_or(last, |most| last.min(most.max(self.tally.ticks)));
        loop {
            if !show(self.frame(step)) {
                return Ending::Stopped;
            }
            let now = self.tally.ticks;
            let ending = self.run(frames.after(now).min(last) - now, report);
            if ending != Ending::TicksSpent || self.tally.ticks >= last {
                if self.tally.ticks > now {
                    show(self.frame(step));
                }
                return ending;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{GridGeometry, Layer};
    use crate::progress::silent;
    use crate::rank::RankMap;
    use crate::swarm::SwarmParams;
    use proptest::prelude::*;

    fn world(seed: u64) -> RankMap {
        let geometry = GridGeometry::new(23, 31, 1.0, 0.0, 0.0).unwrap();
        let ranks = (0..23 * 31).map(|i| {
            let hole = crate::random::philox([i, 3, 0, 0], seed)[0] % 100 < 9;
            if hole { 3 } else { 9 }
        });
        RankMap::from_ranks(geometry, &ranks.collect::<Vec<u8>>()).unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn a_run_that_is_watched_ends_like_one_that_is_not(
            seed: u64, every in 0u64..9, ticks in 0u64..60, step in 0usize..6, at in prop::collection::vec(0u64..70, 0..6),
        ) {
            let map = world(seed);
            let inside = Layer::filled(map.cells().geometry(), true);
            let params = SwarmParams { agents: 30, seed, pellet_max: 2, ..SwarmParams::default() };
            let mut plain = Colony::deploy(&map, &inside, params).unwrap();
            let ending = plain.run(ticks, &mut silent());
            for frames in [FrameTicks::Every(every), FrameTicks::At({ let mut at = at.clone(); at.sort_unstable(); at })] {
                let mut shown = Vec::new();
                let mut watched = Colony::deploy(&map, &inside, params).unwrap();
                let end = watched.run_in_frames(ticks, &frames, step, &mut silent(), &mut |frame| {
                    shown.push(frame);
                    true
                });
                prop_assert_eq!(end, ending);
                prop_assert_eq!(watched.tally(), plain.tally());
                prop_assert_eq!(watched.nests().unwrap(), plain.nests().unwrap());
                prop_assert_eq!(shown[0].tally.ticks, 0);
                let last = shown.last().unwrap();
                prop_assert_eq!(last.tally, plain.tally());
                for pair in shown.windows(2) {
                    prop_assert!(pair[0].tally.ticks < pair[1].tally.ticks);
                    prop_assert!(pair[0].seen.iter().zip(&pair[1].seen).all(|(before, after)| before <= after));
                }
                let side = step.max(1);
                prop_assert_eq!(last.seen.len(), 23usize.div_ceil(side) * 31usize.div_ceil(side));
                if side == 1 {
                    let nests = plain.nests().unwrap();
                    let of_nests = nests.labels().data().iter().map(|&label| label > 0);
                    prop_assert!(last.nests.iter().map(|&name| name > 0).eq(of_nests));
                }
            }
        }
    }

    #[test]
    fn a_viewer_can_stop_the_swarm() {
        let map = world(1);
        let inside = Layer::filled(map.cells().geometry(), true);
        let mut colony = Colony::deploy(&map, &inside, SwarmParams::default()).unwrap();
        let ending = colony.run_in_frames(9, &FrameTicks::Every(1), 1, &mut silent(), &mut |_| false);
        assert_eq!((ending, colony.tally().ticks), (Ending::Stopped, 0));
    }
}
