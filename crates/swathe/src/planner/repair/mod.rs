//! Route repair: D* Lite. After cells have changed or the robot has moved, only what depends on that is searched again.
//!
//! The search runs from the goal towards the robot and keeps two costs for every cell: the one it has settled, and the one
//! that its successors promise. Cells where both differ are open. A repair takes open cells by a lower bound on the cost
//! of a way from the robot through them, and ends as soon as none can matter to the robot. Source: Koenig and Likhachev,
//! "D* Lite", AAAI 2002 (the optimised form), and "Incremental A*", NIPS 2001.
//!
//! Three things are done otherwise than there:
//!
//! - Instead of a growing offset of keys, the open cells are keyed anew before a repair; they are few. Moves along the way
//!   need no repair at all: a scalar tells how far the robot may go before an open cell could matter.
//! - Costs are floats, summed from the goal backwards, and a step makes the sum larger by at least its last bit. So every
//!   way has one cost, whatever was searched before it; the cost of a repaired way equals that of a fresh plan to the last
//!   bit, and steps that cost nothing cannot hold each other up in a circle after their way to the goal was closed.
//! - A repair that comes to a share of a fresh plan's work is given up for a fresh plan.

mod cells;
mod ground;
mod queue;
#[cfg(test)]
mod tests;

use std::collections::HashSet;

use crate::grid::{Cell, GridGeometry, Step};
use crate::progress::Report;

use super::PlannerError;
use super::search::{Search, StepGraph};
use queue::Queue;

pub use cells::ChangingCells;

/// A graph whose costs may change while a robot drives.
pub trait ChangingGraph: StepGraph {
    /// How far, in rows or columns, the steps out of a cell look: a changed cell can change the steps out of every cell
    /// within this many rows and columns.
    fn reach(&self) -> usize;

    /// A lower bound on the cost from a cell to another, consistent with the edges. It may fall when cells change.
    fn least(&self, from: Cell, to: Cell) -> f64;
}

/// Share of a fresh plan's work after which a repair is given up for one, when nothing else is asked.
pub const REPAIR_SHARE: f64 = 0.2;

/// What a repair may always do, in cells: on maps this small it does not matter.
const FREE_WORK: u64 = 64;

/// Cells looked at between two reports.
const WORK_PER_REPORT: u64 = 1 << 16;

/// Relative slack of the end of a search, far above what rounding does to a key and far below what matters.
const SLACK: f64 = 1e-10;

/// A robot that is walled in with this many cells or fewer is noticed before the whole map is searched.
const POCKET_CELLS: usize = 1024;

/// Bits of the infinite cost. State is stored xored with it, so that memory that was never touched means infinite.
const INFINITE: u64 = f64::INFINITY.to_bits();

/// Mark of a cell: its step towards the goal plus one, 0 when there is none.
const STEP: u8 = 0x1f;

/// Mark of a cell that a list holds already.
const LISTED: u8 = 0x20;

/// Mark of a cell whose way was withdrawn: what it is promised is no more than a lower bound until it is looked at again.
const UNSURE: u8 = 0x40;

/// What the searches of a [`Repair`] have done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RepairTally {
    /// Cells that the last search settled or unsettled.
    pub expanded: u64,
    /// Cells looked at since the search before the last: expanded, or their successors compared.
    pub work: u64,
    /// Whether the last search began from nothing.
    pub afresh: bool,
    /// Searches from nothing so far.
    pub fresh_plans: u64,
    /// Repairs so far.
    pub repairs: u64,
}

/// A way to a goal that is kept right while cells change and the robot moves.
///
/// Needs 17 bytes per cell, given by the system as cells are first touched, and 16 for every open cell.
#[derive(Clone, Debug)]
pub struct Repair {
    geometry: GridGeometry,
    start: Cell,
    goal: Cell,
    share: f64,
    /// Settled and promised cost of every cell: bits xored with those of infinity.
    costs: Vec<[u64; 2]>,
    marks: Vec<u8>,
    queue: Queue,
    /// Cells that are open and not in the queue.
    touched: Vec<u32>,
    /// Nothing open costs less than this by way of the cell, where the robot was at the last search.
    floor: Option<(f64, Cell)>,
    /// Work and cost of the last search from nothing.
    fresh: Option<(u64, f64)>,
    /// Whether anything was searched.
    begun: bool,
    /// Whether the search that is going on began from nothing.
    afresh: bool,
    tally: RepairTally,
    work_before: u64,
    trace: Option<Vec<Cell>>,
}

/// How a search for the robot's cost ended.
enum Ended {
    Settled,
    Enclosed,
    Beyond,
    Stopped,
}

impl Repair {
    /// A way from `start` to `goal`, to be searched by the first [`Repair::path`].
    ///
    /// # Errors
    /// [`PlannerError::Grid`] when a cell lies outside.
    pub fn new(graph: &impl ChangingGraph, start: Cell, goal: Cell) -> Result<Self, PlannerError> {
        let geometry = graph.geometry();
        cells::inside(&geometry, start)?;
        cells::inside(&geometry, goal)?;
        let mut repair = Self {
            geometry,
            start,
            goal,
            share: REPAIR_SHARE,
            costs: Vec::new(),
            marks: Vec::new(),
            queue: Queue::new(),
            touched: Vec::new(),
            floor: None,
            fresh: None,
            begun: false,
            afresh: true,
            tally: RepairTally::default(),
            work_before: 0,
            trace: None,
        };
        repair.forget();
        Ok(repair)
    }

    /// Sets the share of a fresh plan's work after which a repair is given up: 0 always plans afresh, infinity never.
    #[must_use]
    pub fn with_share(mut self, share: f64) -> Self {
        self.share = share;
        self
    }

    /// Keeps the cells that each search expands, for pictures; see [`Repair::expanded`].
    #[must_use]
    pub fn with_trace(mut self) -> Self {
        self.trace = Some(Vec::new());
        self
    }

    /// The cells that the last search expanded in their order, empty when they are not kept.
    pub fn expanded(&self) -> &[Cell] {
        self.trace.as_deref().unwrap_or(&[])
    }

    /// What the searches have done.
    pub fn tally(&self) -> RepairTally {
        self.tally
    }

    /// Where the robot is.
    pub fn start(&self) -> Cell {
        self.start
    }

    /// Where it should go.
    pub fn goal(&self) -> Cell {
        self.goal
    }

    /// Moves the robot.
    ///
    /// # Errors
    /// [`PlannerError::Grid`] when the cell lies outside.
    pub fn move_to(&mut self, cell: Cell) -> Result<(), PlannerError> {
        cells::inside(&self.geometry, cell)?;
        self.start = cell;
        Ok(())
    }

    /// Takes in that cells have changed; `graph` already knows them as they are now. Cells outside are ignored, and order
    /// and repetition do not matter, but runs along rows are quickest.
    pub fn update(&mut self, graph: &impl ChangingGraph, changed: impl IntoIterator<Item = Cell>) {
        if !self.begun {
            return;
        }
        let first = self.touched.len();
        self.list_around(changed, graph.reach());
        let listed = self.touched.split_off(first);
        if listed.is_empty() {
            return;
        }
        for &index in &listed {
            self.marks[index as usize] &= !LISTED;
        }
        self.floor = None;
        self.work_before += listed.len() as u64;
        if self.work_before > self.allowance() {
            self.forget();
            return;
        }
        for index in listed {
            if self.look_again(graph, index as usize) {
                self.touched.push(index);
            }
        }
    }

    /// A cheapest way from the robot to the goal, repaired or searched afresh as needed. `report` counts cells looked at.
    ///
    /// The cost is the least over all ways of the sum of steps taken from the goal backwards, the same to the last bit as
    /// that of a `Repair` made now. After [`Search::Stopped`] the next call goes on.
    pub fn path(&mut self, graph: &impl ChangingGraph, report: &mut Report) -> Search {
        if let Some(trace) = &mut self.trace {
            trace.clear();
        }
        self.tally.expanded = 0;
        self.tally.afresh = false;
        if self.start == self.goal {
            return Search::Found {
                cells: vec![self.goal],
                cost: 0.0,
            };
        }
        if !self.is_current(graph) {
            let ended = match self.settle(graph, self.allowance(), report) {
                Ended::Beyond => {
                    self.forget();
                    self.settle(graph, u64::MAX, report)
                }
                ended => ended,
            };
            match ended {
                Ended::Stopped => return Search::Stopped,
                Ended::Enclosed => return Search::Unreachable,
                Ended::Settled | Ended::Beyond => {}
            }
        }
        let cost = f64::from_bits(self.values(self.geometry.index(self.start))[0]);
        if cost.is_infinite() {
            return Search::Unreachable;
        }
        match self.way(graph.steps()) {
            Some(cells) => Search::Found {
                cells,
                // Steps that cost nothing add less than any cost that is one.
                cost: if cost < f64::MIN_POSITIVE { 0.0 } else { cost },
            },
            // Cannot happen while the bound is consistent.
            None => Search::Unreachable,
        }
    }

    /// Forgets all that was searched.
    fn forget(&mut self) {
        let cells = self.geometry.cell_count();
        // Zeroed memory comes from the system untouched, so this costs what is used of it later.
        self.costs = vec![[0; 2]; cells];
        self.marks = vec![0; cells];
        let mut none = Vec::new();
        self.queue.empty_into(&mut none);
        let goal = self.geometry.index(self.goal);
        self.set_promised(goal, 0);
        self.touched = vec![goal as u32];
        self.floor = None;
        self.begun = false;
        self.afresh = true;
        self.work_before = 0;
    }

    /// Work after which a repair is no longer worth it.
    fn allowance(&self) -> u64 {
        let Some((work, cost)) = self.fresh.filter(|_| !self.afresh) else {
            return u64::MAX;
        };
        if self.share <= 0.0 {
            return 0;
        }
        // The region that a search looks at grows with the square of the distance.
        let [settled, promised] = self.values(self.geometry.index(self.start));
        let nearer = (f64::from_bits(settled.min(promised)) / cost).powi(2);
        let nearer = if nearer < 1.0 { nearer.max(1e-9) } else { 1.0 };
        ((self.share * nearer * work as f64) as u64).saturating_add(FREE_WORK)
    }

    /// Whether the robot's cost is known to be right without a search.
    fn is_current(&self, graph: &impl ChangingGraph) -> bool {
        let [settled, promised] = self.values(self.geometry.index(self.start));
        let Some((floor, at)) = self.floor else { return false };
        let unsure = self.marks[self.geometry.index(self.start)] & UNSURE > 0;
        settled == promised && !unsure && floor - graph.least(at, self.start) >= f64::from_bits(settled)
    }

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
    fn settle(&mut self, graph: &impl ChangingGraph, most_work: u64, report: &mut Report) -> Ended {
        self.begun = true;
        self.key_anew(graph);
        let start = self.geometry.index(self.start);
        let (mut work, mut looked_around) = (self.work_before, false);
        let mut next_report = work;
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
            if work >= next_report {
                next_report = work + WORK_PER_REPORT;
                if !report(work, 0) {
                    self.queue.push(key, index);
                    break Ended::Stopped;
                }
            }
            if work > most_work {
                break Ended::Beyond;
            }
            work += self.expand(graph, key, index as usize);
        };
        self.tally.work = work;
        match ended {
            Ended::Settled => {
                self.work_before = 0;
                self.tally.afresh = self.afresh;
                if std::mem::take(&mut self.afresh) {
                    self.tally.fresh_plans += 1;
                    self.fresh = Some((work, f64::from_bits(self.values(start)[0])));
                } else {
                    self.tally.repairs += 1;
                }
            }
            Ended::Beyond => {}
            Ended::Enclosed | Ended::Stopped => self.work_before = work,
        }
        ended
    }

    /// Settles or unsettles an open cell; returns the cells looked at.
    fn expand(&mut self, graph: &impl ChangingGraph, key: u64, index: usize) -> u64 {
        let unsure = self.marks[index] & UNSURE > 0;
        if unsure {
            self.look_again(graph, index);
        }
        let [settled, promised] = self.values(index);
        if settled == promised {
            return u64::from(unsure);
        }
        let here = self.geometry.cell(index);
        let key_now = self.key(graph, here, settled.min(promised));
        if key_now > key {
            // An entry that was overtaken; a cell that was looked at only now has no other yet.
            if unsure {
                self.queue.push(key_now, index as u32);
            }
            return u64::from(unsure);
        }
        self.tally.expanded += 1;
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
        1 + u64::from(unsure)
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

    /// Works out anew what a cell's successors promise; returns whether it is open.
    fn look_again(&mut self, graph: &impl ChangingGraph, index: usize) -> bool {
        let cell = self.geometry.cell(index);
        if cell == self.goal {
            return false;
        }
        let (mut best, mut towards) = (INFINITE, 0);
        for (k, step) in graph.steps().iter().enumerate() {
            let Some(next) = step.from(&self.geometry, cell) else {
                continue;
            };
            let cost = self.values(self.geometry.index(next))[0];
            if cost < best {
                let offered = joined(graph.edge_cost(cell, k), cost);
                if offered < best {
                    (best, towards) = (offered, k as u8 + 1);
                }
            }
        }
        self.set_promised(index, best);
        self.marks[index] = towards;
        self.values(index)[0] != best
    }

    /// Appends the cells within `reach` rows and columns of some cells to those touched, each once and marked.
    fn list_around(&mut self, changed: impl IntoIterator<Item = Cell>, reach: usize) {
        let (rows, columns) = (self.geometry.rows(), self.geometry.columns());
        let mut changed = changed
            .into_iter()
            .filter(|cell| cell.row < rows && cell.column < columns)
            .peekable();
        while let Some(first) = changed.next() {
            let mut last = first.column;
            while let Some(next) = changed.next_if(|next| next.row == first.row && next.column == last + 1) {
                last = next.column;
            }
            let west = first.column.saturating_sub(reach);
            let east = (last + reach).min(columns - 1);
            for row in first.row.saturating_sub(reach)..=(first.row + reach).min(rows - 1) {
                for index in row * columns + west..=row * columns + east {
                    if self.marks[index] & LISTED == 0 {
                        self.marks[index] |= LISTED;
                        self.touched.push(index as u32);
                    }
                }
            }
        }
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

    /// The way from the robot to the goal along the steps that the search left.
    fn way(&self, steps: &[Step]) -> Option<Vec<Cell>> {
        let mut cells = vec![self.start];
        let mut here = self.start;
        while here != self.goal {
            let step = self.marks[self.geometry.index(here)] & STEP;
            here = steps
                .get(usize::from(step).checked_sub(1)?)?
                .from(&self.geometry, here)?;
            cells.push(here);
            if cells.len() > self.geometry.cell_count() {
                return None;
            }
        }
        Some(cells)
    }

    /// Settled and promised cost of a cell, as bits.
    fn values(&self, index: usize) -> [u64; 2] {
        self.costs[index].map(|bits| bits ^ INFINITE)
    }

    fn set_settled(&mut self, index: usize, cost: u64) {
        self.costs[index][0] = cost ^ INFINITE;
    }

    fn set_promised(&mut self, index: usize, cost: u64) {
        self.costs[index][1] = cost ^ INFINITE;
    }
}

/// A step's cost and the cost behind it, in bits: their sum, and in any case more than what is behind.
fn joined(step: f64, behind: u64) -> u64 {
    (step + f64::from_bits(behind)).to_bits().max(behind + 1)
}
