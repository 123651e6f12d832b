//! The search of a repair: from open cells until the robot's cost is right.

use std::collections::HashSet;

use crate::grid::Cell;
use crate::progress::Report;

use super::{ChangingGraph, INFINITE, LISTED, Repair, UNSURE, joined};

/// Effort that a repair may always take: on maps this small it does not matter.
const FREE_EFFORT: u64 = 128;

/// Effort of expanding a cell, in that of comparing its successors (measured: 105 and 50 ns).
const EXPANSION: u64 = 2;

/// Cells that are looked at to estimate how many a fresh plan would expand.
const SAMPLES: usize = 1024;

/// Cells looked at between two reports.
const WORK_PER_REPORT: u64 = 1 << 12;

/// Relative slack of the end of a search, far above what rounding does to a key and far below what matters.
const SLACK: f64 = 1e-10;

/// A robot that is walled in with this many cells or fewer is noticed before the whole map is searched.
const POCKET_CELLS: usize = 1024;

/// How a search for the robot's cost ended.
pub(super) enum Ended {
    /// The robot's cost is right.
    Settled,
    /// The robot is walled in.
    Enclosed,
    /// It took more than it may.
    Beyond,
    /// The caller asked to stop.
    Stopped,
}

impl Repair {
    /// Puts every open cell into the queue by its key of now.
    fn key_anew(&mut self, graph: &impl ChangingGraph) {
        let mut open = std::mem::take(&mut self.touched);
        self.queue.empty_into(&mut open);
        open.retain(|&index| {
            let index = index as usize;
            let [settled, promised] = self.values(index);
            let open = settled != promised || self.marks[index] & UNSURE > 0;
            let keep = open && self.marks[index] & LISTED == 0;
            if keep {
                self.marks[index] |= LISTED;
            }
            keep
        });
        for &index in &open {
            let at = index as usize;
            self.marks[at] &= !LISTED;
            let [settled, promised] = self.values(at);
            let key = self.key(graph, self.geometry.cell(at), settled.min(promised));
            self.queue.push(key, index);
        }
    }

    /// Lower bound on the cost of a way from the robot through a cell.
    fn key(&self, graph: &impl ChangingGraph, cell: Cell, cost: u64) -> u64 {
        (f64::from_bits(cost) + graph.least(self.start, cell)).to_bits()
    }

    /// Searches until the robot's cost is right, or for a while.
    pub(super) fn settle(&mut self, graph: &impl ChangingGraph, report: &mut Report) -> Ended {
        let allowed = self.allowance(graph);
        self.begun = true;
        self.floor = None;
        self.key_anew(graph);
        let start = self.geometry.index(self.start);
        let mut looked_around = false;
        let mut next_report = self.looked;
        let ended = loop {
            let Some((key, index)) = self.queue.pop() else {
                self.floor = Some((f64::INFINITY, self.start));
                break Ended::Settled;
            };
            let [settled, promised] = self.values(start);
            let best = f64::from_bits(settled.min(promised));
            if f64::from_bits(key) > best * (1.0 + SLACK) {
                self.queue.push(key, index);
                self.floor = Some((f64::from_bits(key), self.start));
                break Ended::Settled;
            }
            if best.is_infinite() && !looked_around {
                looked_around = true;
                if self.is_enclosed(graph) {
                    self.queue.push(key, index);
                    break Ended::Enclosed;
                }
            }
            if self.looked >= next_report {
                next_report = self.looked + WORK_PER_REPORT;
                if !report(self.looked, 0) {
                    self.queue.push(key, index);
                    break Ended::Stopped;
                }
            }
            if self.effort > allowed {
                break Ended::Beyond;
            }
            self.expand(graph, key, index as usize);
        };
        self.tally.work = self.looked;
        if matches!(ended, Ended::Settled) {
            (self.allowed, self.effort, self.looked) = (None, 0, 0);
            self.tally.afresh = self.afresh;
            if std::mem::take(&mut self.afresh) {
                self.tally.fresh_plans += 1;
            } else {
                self.tally.repairs += 1;
            }
        }
        ended
    }

    /// Settles or unsettles an open cell.
    fn expand(&mut self, graph: &impl ChangingGraph, key: u64, index: usize) {
        let unsure = self.marks[index] & UNSURE > 0;
        if unsure {
            self.look_again(graph, index);
            self.looked += 1;
            self.effort += 1;
        }
        let [settled, promised] = self.values(index);
        if settled == promised {
            return;
        }
        let here = self.geometry.cell(index);
        let key_now = self.key(graph, here, settled.min(promised));
        if key_now > key {
            // An entry that was overtaken; a cell that was looked at only now has no other yet.
            if unsure {
                self.queue.push(key_now, index as u32);
            }
            return;
        }
        self.tally.expanded += 1;
        self.looked += 1;
        self.effort += EXPANSION;
        if let Some(trace) = &mut self.trace {
            trace.push(here);
        }
        if settled > promised {
            self.set_settled(index, promised);
            self.offer(graph, here, promised);
        } else {
            self.set_settled(index, INFINITE);
            if promised < INFINITE {
                self.queue.push(self.key(graph, here, promised), index as u32);
            }
            self.withdraw(graph, here);
        }
    }

    /// Lets the cells before a settled one go by way of it.
    fn offer(&mut self, graph: &impl ChangingGraph, here: Cell, cost: u64) {
        for (k, step) in graph.steps().iter().enumerate() {
            let Some(before) = self.geometry.offset(here, -step.rows, -step.columns) else {
                continue;
            };
            let index = self.geometry.index(before);
            let [settled, promised] = self.values(index);
            if promised <= cost {
                continue;
            }
            let offered = joined(graph.edge_cost(before, k), cost);
            if offered < promised {
                self.set_promised(index, offered);
                self.marks[index] = k as u8 + 1;
                if offered < settled {
                    self.queue.push(self.key(graph, before, offered), index as u32);
                }
            }
        }
    }

    /// Marks the cells that went by way of an unsettled one. They are looked at again when it is their turn: by then all
    /// that was nearer to the goal is known, and many need it once instead of several times.
    fn withdraw(&mut self, graph: &impl ChangingGraph, here: Cell) {
        for (k, step) in graph.steps().iter().enumerate() {
            let Some(before) = self.geometry.offset(here, -step.rows, -step.columns) else {
                continue;
            };
            let index = self.geometry.index(before);
            if self.marks[index] == k as u8 + 1 {
                self.marks[index] |= UNSURE;
                let [settled, promised] = self.values(index);
                if settled == promised {
                    self.queue.push(self.key(graph, before, settled), index as u32);
                }
            }
        }
    }

    /// Effort after which a repair is no longer worth it.
    ///
    /// A fresh plan expands the cells through which a way from the robot may cost no more than the best one. How many
    /// these are is told well enough by cells on a lattice, from what is settled of the map as it was.
    pub(super) fn allowance(&mut self, graph: &impl ChangingGraph) -> u64 {
        if self.afresh || self.share.is_infinite() {
            return u64::MAX;
        }
        if self.share <= 0.0 {
            return 0;
        }
        if let Some(allowed) = self.allowed {
            return allowed;
        }
        let [settled, promised] = self.values(self.geometry.index(self.start));
        let best = f64::from_bits(settled.min(promised));
        let apart = ((self.geometry.cell_count() / SAMPLES) as f64).sqrt().max(1.0) as usize;
        let (mut within, mut all) = (0.0, 0.0);
        for row in (apart / 2..self.geometry.rows()).step_by(apart) {
            for column in (apart / 2..self.geometry.columns()).step_by(apart) {
                let cell = Cell::new(row, column);
                let settled = f64::from_bits(self.values(self.geometry.index(cell))[0]);
                all += 1.0;
                if settled.is_finite() && settled + graph.least(self.start, cell) <= best {
                    within += 1.0;
                }
            }
        }
        let fresh = within / f64::max(all, 1.0) * self.geometry.cell_count() as f64;
        let allowed = (self.share * fresh * EXPANSION as f64) as u64 + FREE_EFFORT;
        self.allowed = Some(allowed);
        allowed
    }

    /// Whether no way leads out of a few cells around the robot, and the goal is not among them.
    fn is_enclosed(&self, graph: &impl ChangingGraph) -> bool {
        let mut reached = HashSet::from([self.start]);
        let mut open = vec![self.start];
        while let Some(here) = open.pop() {
            for (k, step) in graph.steps().iter().enumerate() {
                let Some(next) = step.from(&self.geometry, here) else {
                    continue;
                };
                if !reached.contains(&next) && graph.edge_cost(here, k).is_finite() {
                    if next == self.goal || reached.len() == POCKET_CELLS {
                        return false;
                    }
                    reached.insert(next);
                    open.push(next);
                }
            }
        }
        true
    }
}
