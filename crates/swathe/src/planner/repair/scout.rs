//! What a repair after dearer costs needs to look at, found by a look ahead from the robot.
//!
//! After costs have only risen, the costs settled before are lower bounds on what they are now, and the best there are:
//! A* from the robot with them (adaptive A*, Koenig and Likhachev, AAMAS 2005) leaves the cells that the change spoiled by
//! the shortest way round. It ends at cells whose way to the goal has not changed. Only cells through which a way from the
//! robot may cost no more than the best one found so have to be repaired: a fraction of what the straight distance allows.
//!
//! The lower bound of a cell is the lesser of
//!
//! - what is settled of it: that is consistent with the steps of all cells whose promise is not below it;
//! - `F` less the straight bound from the robot, where `F` is the least key of the cells whose promise is below what is
//!   settled: ways by such a cell cost no less, and it is consistent too. The lesser of both is consistent at every cell.

use crate::grid::Cell;
use crate::progress::Report;

use super::settle::beside;
use super::{BROKEN, ChangingGraph, INFINITE, Repair, SOUND, STEP, UNSURE};

/// Relative slack of the cells that are kept, above that of the end of the repair.
const SLACK: f64 = 2e-10;

/// Cells expanded between two reports.
const CELLS_PER_REPORT: u64 = 1 << 16;

/// How the look ahead ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scouted {
    /// The cells that matter have their costs from the robot.
    Known,
    /// It does not help here, or took too much.
    Not,
    /// The caller asked to stop.
    Stopped,
}

impl Repair {
    /// Finds the cells that matter and their costs from the robot, with `most` expansions; `open` are all open cells.
    pub(super) fn scout(
        &mut self,
        graph: &impl ChangingGraph,
        open: &[u32],
        most: u64,
        report: &mut Report,
    ) -> Scouted {
        let start = self.geometry.index(self.start);
        let [settled, _] = self.values(start);
        let mut cheaper = f64::INFINITY;
        for &index in open {
            let [settled, promised] = self.values(index as usize);
            if promised < settled {
                let cell = self.geometry.cell(index as usize);
                cheaper = cheaper.min(f64::from_bits(promised) + graph.least(self.start, cell));
            }
        }
        // Where something near has become cheaper, what was settled tells little.
        if settled == INFINITE || cheaper < f64::from_bits(settled) * (1.0 + SLACK) {
            return Scouted::Not;
        }
        if self.from_robot.is_empty() {
            self.from_robot = vec![0; self.geometry.cell_count()];
        }
        let mut noted = Vec::new();
        let ended = self.look_ahead(graph, cheaper, most, &mut noted, report);
        for index in noted {
            self.marks[index as usize] &= !(SOUND | BROKEN);
        }
        self.ahead.empty_into(&mut Vec::new());
        match ended {
            Ok(best) if best < f64::INFINITY => {
                let most = best * (1.0 + SLACK);
                let mut reached = std::mem::take(&mut self.reached);
                reached.retain(|&index| {
                    let at = index as usize;
                    let keep = self.cost_from_robot(at) + self.at_least(graph, self.geometry.cell(at), cheaper) <= most;
                    if !keep {
                        self.from_robot[at] = 0;
                    }
                    keep
                });
                self.reached = reached;
                self.scouted = true;
                Scouted::Known
            }
            Ok(_) => {
                self.forget_scouted();
                Scouted::Not
            }
            Err(ended) => {
                self.forget_scouted();
                ended
            }
        }
    }

    /// A* from the robot until no way can be cheaper than one found; returns the cost of that.
    fn look_ahead(
        &mut self,
        graph: &impl ChangingGraph,
        cheaper: f64,
        most: u64,
        noted: &mut Vec<u32>,
        report: &mut Report,
    ) -> Result<f64, Scouted> {
        let steps = graph.steps();
        let start = self.geometry.index(self.start);
        let mut best = f64::INFINITY;
        let mut expanded = 0;
        self.reach(start, 0.0);
        let first = self.at_least(graph, self.start, cheaper);
        self.ahead.push(first.to_bits(), start as u32);
        while let Some((key, index)) = self.ahead.pop() {
            if f64::from_bits(key) > best * (1.0 + SLACK) {
                break;
            }
            let index = index as usize;
            let here = self.geometry.cell(index);
            let so_far = self.cost_from_robot(index);
            // An entry that was overtaken; rounding alone lifts keys by less.
            if (so_far + self.at_least(graph, here, cheaper)) * (1.0 + SLACK) < f64::from_bits(key) {
                continue;
            }
            let settled = f64::from_bits(self.values(index)[0]);
            if settled * (1.0 + SLACK) <= cheaper - graph.least(self.start, here) && self.is_sound(index, noted) {
                best = best.min(so_far + settled);
                continue;
            }
            if expanded == most {
                return Err(Scouted::Not);
            }
            if expanded % CELLS_PER_REPORT == 0 && !report(self.looked, 0) {
                return Err(Scouted::Stopped);
            }
            expanded += 1;
            self.looked += 1;
            self.effort += 1;
            self.tally.expanded += 1;
            if let Some(trace) = &mut self.trace {
                trace.push(here);
            }
            let together = graph.costs_around(here);
            for (k, step) in steps.iter().enumerate() {
                let cost = match &together {
                    Some(costs) => costs[k],
                    None => graph.edge_cost(here, k),
                };
                // Steps that leave the map are closed.
                if cost == f64::INFINITY {
                    continue;
                }
                let near = index.wrapping_add_signed(self.offsets[k]);
                let cost = so_far + cost;
                if cost < self.cost_from_robot(near) {
                    self.reach(near, cost);
                    let bound = cost + self.at_least(graph, beside(here, *step), cheaper);
                    if bound <= best * (1.0 + SLACK) {
                        self.ahead.push(bound.to_bits(), near as u32);
                    }
                }
            }
        }
        Ok(best)
    }

    /// Lower bound on the cost from a cell to the goal; see the head of this file.
    fn at_least(&self, graph: &impl ChangingGraph, cell: Cell, cheaper: f64) -> f64 {
        let settled = f64::from_bits(self.values(self.geometry.index(cell))[0]);
        let below = cheaper - graph.least(self.start, cell);
        settled.min(below).max(0.0)
    }

    /// Whether the way from a cell to the goal is as it was: no cell of it is open. What is found is noted for all of them.
    fn is_sound(&mut self, index: usize, noted: &mut Vec<u32>) -> bool {
        let goal = self.geometry.index(self.goal);
        let first = noted.len();
        let mut at = index;
        let sound = loop {
            let mark = self.marks[at];
            if mark & (SOUND | BROKEN) > 0 {
                break mark & SOUND > 0;
            }
            noted.push(at as u32);
            let [settled, promised] = self.values(at);
            if settled != promised || settled == INFINITE || mark & UNSURE > 0 {
                break false;
            }
            if at == goal {
                break true;
            }
            let Some(&offset) = self.offsets.get(usize::from(mark & STEP).wrapping_sub(1)) else {
                break false;
            };
            at = at.wrapping_add_signed(offset);
        };
        for &at in &noted[first..] {
            self.marks[at as usize] |= if sound { SOUND } else { BROKEN };
        }
        sound
    }

    /// Cost from the robot to a cell as far as it is known, else infinite.
    pub(super) fn cost_from_robot(&self, index: usize) -> f64 {
        f64::from_bits(self.from_robot[index] ^ INFINITE)
    }

    fn reach(&mut self, index: usize, cost: f64) {
        if self.from_robot[index] == 0 {
            self.reached.push(index as u32);
        }
        self.from_robot[index] = cost.to_bits() ^ INFINITE;
    }

    /// Forgets the costs from the robot.
    pub(super) fn forget_scouted(&mut self) {
        for index in self.reached.drain(..) {
            self.from_robot[index as usize] = 0;
        }
        self.scouted = false;
    }
}
