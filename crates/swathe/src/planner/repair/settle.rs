//! The search of a repair: from open cells until the robot's cost is right.

use crate::grid::{Cell, Step};
use crate::progress::Report;

use super::scout::Scouted;
use super::{ChangingGraph, INFINITE, LISTED, MOST_STEPS, Repair, UNSURE, joined};

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
    /// Puts every open cell into the queue by its key of now; `most` bounds the look ahead. False when asked to stop.
    fn key_anew(&mut self, graph: &impl ChangingGraph, most: u64, report: &mut Report) -> bool {
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
            self.marks[index as usize] &= !LISTED;
        }
        if !self.afresh && self.scout(graph, &open, most, report) == Scouted::Stopped {
            self.touched = open;
            return false;
        }
        for &index in &open {
            let [settled, promised] = self.values(index as usize);
            self.put(graph, self.geometry.cell(index as usize), settled.min(promised));
        }
        true
    }

    /// Lower bound on the cost of a way from the robot through a cell, infinite for cells that do not matter.
    ///
    /// Among those that do, the costs from the robot would make the bound of all cells of a way the same but for rounding,
    /// and cells would be settled before those they depend on; the cost to the goal alone keeps them in order.
    fn key(&self, graph: &impl ChangingGraph, cell: Cell, cost: u64) -> u64 {
        if !self.scouted {
            return (f64::from_bits(cost) + graph.least(self.start, cell)).to_bits();
        }
        if self.cost_from_robot(self.geometry.index(cell)) < f64::INFINITY {
            cost
        } else {
            INFINITE
        }
    }

    /// Puts an open cell into the queue, or aside when it does not matter now.
    fn put(&mut self, graph: &impl ChangingGraph, cell: Cell, cost: u64) {
        let index = self.geometry.index(cell) as u32;
        let key = self.key(graph, cell, cost);
        if self.scouted && key == INFINITE {
            self.touched.push(index);
        } else {
            self.queue.push(key, index);
        }
    }

    /// Searches until the robot's cost is right, or for a while.
    pub(super) fn settle(&mut self, graph: &impl ChangingGraph, report: &mut Report) -> Ended {
        let allowed = self.allowance(graph);
        self.begun = true;
        self.floor = None;
        self.way_from = None;
        // Half of what is allowed for looking ahead leaves as much for a repair without.
        if !self.key_anew(graph, allowed.saturating_sub(self.effort) / 2, report) {
            return Ended::Stopped;
        }
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
            // Around the robot there are as many cells to look at as most fresh plans take, so those are begun first.
            let is_worth = !self.afresh || self.effort >= EXPANSION * POCKET_CELLS as u64 / 2;
            // A look ahead that ended well has found a way.
            if best.is_infinite() && is_worth && !looked_around && !self.scouted {
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
        if std::mem::take(&mut self.scouted) {
            // Others than the robot's way may still need what was put aside.
            self.floor = None;
            if matches!(ended, Ended::Settled) {
                self.way_from = Some(self.start);
            }
        }
        self.forget_scouted();
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
                self.put(graph, here, promised);
            }
            self.withdraw(graph, here);
        }
    }

    /// Lets the cells before a settled one go by way of it.
    fn offer(&mut self, graph: &impl ChangingGraph, here: Cell, cost: u64) {
        if let Some(costs) = graph.costs_around(here) {
            self.offer_at_once(graph, here, cost, &costs);
            return;
        }
        for (k, step) in graph.steps().iter().enumerate() {
            let Some(before) = self.geometry.offset(here, -step.rows, -step.columns) else {
                continue;
            };
            let index = self.geometry.index(before);
            if self.values(index)[1] > cost {
                let offered = joined(graph.edge_cost(before, k), cost);
                self.take(graph, before, k, offered);
            }
        }
    }

    /// The same for steps that were priced together; each costs what the opposite one does.
    fn offer_at_once(&mut self, graph: &impl ChangingGraph, here: Cell, cost: u64, costs: &[f64; MOST_STEPS]) {
        let index = self.geometry.index(here);
        let steps = graph.steps();
        for (k, step) in steps.iter().enumerate() {
            let back = opposite(k, steps.len());
            let Some(values) = self.costs.get(index.wrapping_add_signed(self.offsets[k])) else {
                continue;
            };
            // Where a step leaves the map it is closed, and nothing is promised less than by a closed one.
            let offered = joined(costs[k], cost);
            if offered < values[1] ^ INFINITE {
                let before = beside(here, *step);
                self.take(graph, before, back, offered);
            }
        }
    }

    /// Gives a cell another promise and the step that keeps it, when it is less than the one it has.
    fn take(&mut self, graph: &impl ChangingGraph, cell: Cell, step: usize, offered: u64) {
        let index = self.geometry.index(cell);
        let [settled, promised] = self.values(index);
        if offered < promised {
            self.set_promised(index, offered);
            self.marks[index] = step as u8 + 1;
            if offered < settled {
                self.put(graph, cell, offered);
            }
        }
    }

    /// Marks the cells that went by way of an unsettled one. They are looked at again when it is their turn: by then all
    /// that was nearer to the goal is known, and many need it once instead of several times.
    fn withdraw(&mut self, graph: &impl ChangingGraph, here: Cell) {
        let index = self.geometry.index(here);
        for (k, step) in graph.steps().iter().enumerate() {
            let before = index.wrapping_add_signed(-self.offsets[k]);
            // No cell holds a step that leaves the map, so one that is beside only by its index does not hold this step.
            if self.marks.get(before) == Some(&(k as u8 + 1)) {
                self.marks[before] |= UNSURE;
                let [settled, promised] = self.values(before);
                if settled == promised {
                    let back = Step {
                        rows: -step.rows,
                        columns: -step.columns,
                    };
                    let cell = beside(here, back);
                    self.put(graph, cell, settled);
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
                // Most cells lie farther from the goal than the robot.
                if settled.is_finite() && settled <= best && settled + graph.least(self.start, cell) <= best {
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
    fn is_enclosed(&mut self, graph: &impl ChangingGraph) -> bool {
        let start = self.geometry.index(self.start);
        self.marks[start] |= LISTED;
        let mut reached = vec![start];
        let mut at = 0;
        let mut is_pocket = true;
        while is_pocket && let Some(&index) = reached.get(at) {
            at += 1;
            let here = self.geometry.cell(index);
            for (k, step) in graph.steps().iter().enumerate() {
                let Some(next) = step.from(&self.geometry, here) else {
                    continue;
                };
                let index = self.geometry.index(next);
                if self.marks[index] & LISTED == 0 && graph.edge_cost(here, k).is_finite() {
                    if next == self.goal || reached.len() == POCKET_CELLS {
                        is_pocket = false;
                        break;
                    }
                    self.marks[index] |= LISTED;
                    reached.push(index);
                }
            }
        }
        for index in reached {
            self.marks[index] &= !LISTED;
        }
        is_pocket
    }
}

/// The step that leads back, among as many as turn around a cell.
fn opposite(step: usize, steps: usize) -> usize {
    let half = steps / 2;
    if step < half { step + half } else { step - half }
}

/// The cell where a step leads that is known to stay on the map.
pub(super) fn beside(cell: Cell, step: Step) -> Cell {
    Cell::new(
        cell.row.wrapping_add_signed(step.rows as isize),
        cell.column.wrapping_add_signed(step.columns as isize),
    )
}
