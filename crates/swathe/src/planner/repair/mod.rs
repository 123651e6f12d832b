//! Route repair: D* Lite. After cells have changed or the robot has moved, only what depends on that is searched again.
//!
//! The search runs from the goal towards the robot and keeps two costs for every cell: the one it has settled, and the one
//! that its successors promise. Cells where both differ are open. A repair takes open cells by a lower bound on the cost
//! of a way from the robot through them, and ends as soon as none can matter to the robot. Source: Koenig and Likhachev,
//! "D* Lite", AAAI 2002 (the optimised form), and "Incremental A*", NIPS 2001.
//!
//! Four things are done otherwise than there:
//!
//! - Instead of a growing offset of keys, the open cells are keyed anew before a repair; they are few. Moves along the way
//!   need no repair at all: a scalar tells how far the robot may go before an open cell could matter.
//! - Costs are floats, summed from the goal backwards, and a step makes the sum larger by at least its last bit. So every
//!   way has one cost, whatever was searched before it; the cost of a repaired way equals that of a fresh plan to the last
//!   bit, and steps that cost nothing cannot hold each other up in a circle after their way to the goal was closed.
//! - A repair that comes to a share of a fresh plan's work is given up for a fresh plan.
//! - Where costs have only risen, a look ahead from the robot tells which cells need repair (`scout.rs`).

mod cells;
mod ground;
mod scout;
mod settle;
#[cfg(test)]
mod tests;

use crate::grid::{Cell, GridGeometry, Step};
use crate::progress::Report;

use super::PlannerError;
use super::radix_heap::RadixHeap;
use super::search::{Search, StepGraph};
use settle::Ended;

pub use cells::ChangingCells;

/// A graph whose costs may change while a robot drives.
pub trait ChangingGraph: StepGraph {
    /// How far, in rows or columns, the steps out of a cell look: a changed cell can change the steps out of every cell
    /// within this many rows and columns.
    fn reach(&self) -> usize;

    /// A lower bound on the cost from a cell to another, consistent with the edges. It may fall when cells change.
    fn least(&self, from: Cell, to: Cell) -> f64;

    /// The costs of all steps out of a cell, for graphs that work them out together more quickly than one by one and
    /// whose steps cost the same in both directions, to the last bit. Steps come as [`EIGHT`](crate::grid::EIGHT) or
    /// [`SIXTEEN`](crate::grid::SIXTEEN), opposite ones half a turn apart; places beyond the last step are not read.
    fn costs_around(&self, _cell: Cell) -> Option<[f64; MOST_STEPS]> {
        None
    }
}

/// Most steps out of a cell of a graph that prices them together.
pub const MOST_STEPS: usize = 16;

/// Share of a fresh plan's work after which a repair is given up for one, when nothing else is asked.
pub const REPAIR_SHARE: f64 = 0.2;

/// Bits of the infinite cost. State is stored xored with it, so that memory that was never touched means infinite.
const INFINITE: u64 = f64::INFINITY.to_bits();

/// Cells with indices one after the other that are forgotten together.
const BLOCK: usize = 64;

/// Mark of a cell: its step towards the goal plus one, 0 when there is none.
const STEP: u8 = 0x1f;

/// Mark of a cell that a list holds already.
const LISTED: u8 = 0x20;

/// Mark of a cell whose way was withdrawn: what it is promised is no more than a lower bound until it is looked at again.
const UNSURE: u8 = 0x40;

/// Mark of a cell whose way to the goal is known to be as it was, while looking ahead.
const SOUND: u8 = 0x80;

/// Mark of a cell whose way to the goal is known to be spoiled, while looking ahead.
const BROKEN: u8 = LISTED;

/// What the searches of a [`Repair`] have done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RepairTally {
    /// Cells that the last search settled, unsettled or looked ahead from.
    pub expanded: u64,
    /// Cells that it looked at, those around changed cells included: expanded, or their successors compared.
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
/// Needs a little over 17 bytes per cell, given by the system as cells are first touched, 8 more for cells looked at ahead, and
/// 16 for every open cell.
#[derive(Clone, Debug)]
pub struct Repair {
    geometry: GridGeometry,
    start: Cell,
    goal: Cell,
    share: f64,
    /// Settled and promised cost of every cell: bits xored with those of infinity.
    costs: Vec<[u64; 2]>,
    marks: Vec<u8>,
    /// Blocks in which something was promised; and of every block, whether it is among them.
    used: Vec<u32>,
    is_used: Vec<bool>,
    /// How far the index of a cell is from that of the cell where a step leads.
    offsets: Vec<isize>,
    queue: RadixHeap,
    /// Cells that are open and not in the queue.
    touched: Vec<u32>,
    /// Costs from the robot to the cells that matter to a repair: bits xored with those of infinity.
    from_robot: Vec<u64>,
    /// Cells that have such a cost.
    reached: Vec<u32>,
    /// Cells to look ahead from.
    ahead: RadixHeap,
    /// Whether the repair goes by costs from the robot.
    scouted: bool,
    /// The robot's cell at the last search if that went by costs from the robot: then the costs along its way are right.
    way_from: Option<Cell>,
    /// Nothing open costs less than this by way of the cell, where the robot was at the last search.
    floor: Option<(f64, Cell)>,
    /// Effort after which the repair that is due is given up, once it was worked out.
    allowed: Option<u64>,
    /// Effort taken for the repair that is due, or going on.
    effort: u64,
    /// Cells looked at since the last search.
    looked: u64,
    /// Whether anything was searched.
    begun: bool,
    /// Whether the search that is going on began from nothing.
    afresh: bool,
    tally: RepairTally,
    trace: Option<Vec<Cell>>,
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
            used: Vec::new(),
            is_used: Vec::new(),
            offsets: graph.steps().iter().map(|step| offset(&geometry, *step)).collect(),
            queue: RadixHeap::new(),
            touched: Vec::new(),
            from_robot: Vec::new(),
            reached: Vec::new(),
            ahead: RadixHeap::new(),
            scouted: false,
            way_from: None,
            floor: None,
            allowed: None,
            effort: 0,
            looked: 0,
            begun: false,
            afresh: true,
            tally: RepairTally::default(),
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
        self.way_from = None;
        if self.effort + listed.len() as u64 > self.allowance(graph) {
            self.forget();
            return;
        }
        self.effort += listed.len() as u64;
        self.looked += listed.len() as u64;
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
            let mut ended = self.settle(graph, report);
            if matches!(ended, Ended::Beyond) {
                self.forget();
                ended = self.settle(graph, report);
            }
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
        // What is little is cleared in place: new memory would be given page by page again.
        if self.used.len() * BLOCK < cells / 4 && self.costs.len() == cells {
            for block in self.used.drain(..) {
                let first = block as usize * BLOCK;
                let end = (first + BLOCK).min(cells);
                self.costs[first..end].fill([0; 2]);
                self.marks[first..end].fill(0);
                self.is_used[block as usize] = false;
            }
        } else {
            // Zeroed memory comes from the system untouched, so this costs what is used of it later.
            self.costs = vec![[0; 2]; cells];
            self.marks = vec![0; cells];
            self.is_used = vec![false; cells.div_ceil(BLOCK)];
            self.used.clear();
        }
        let mut none = Vec::new();
        self.queue.empty_into(&mut none);
        let goal = self.geometry.index(self.goal);
        self.set_promised(goal, 0);
        self.touched = vec![goal as u32];
        self.floor = None;
        self.way_from = None;
        self.begun = false;
        self.afresh = true;
        self.allowed = None;
        self.effort = 0;
    }

    /// Whether the robot's cost is known to be right without a search.
    fn is_current(&mut self, graph: &impl ChangingGraph) -> bool {
        let start = self.geometry.index(self.start);
        if let Some(from) = self.way_from {
            let (mut at, goal) = (self.geometry.index(from), self.geometry.index(self.goal));
            while at != start && at != goal {
                let step = usize::from(self.marks[at] & STEP);
                let Some(&offset) = self.offsets.get(step.wrapping_sub(1)) else {
                    return false;
                };
                at = at.wrapping_add_signed(offset);
            }
            if at == start {
                self.way_from = Some(self.start);
            }
            return at == start;
        }
        let [settled, promised] = self.values(start);
        let Some((floor, at)) = self.floor else { return false };
        let unsure = self.marks[start] & UNSURE > 0;
        settled == promised && !unsure && floor - graph.least(at, self.start) >= f64::from_bits(settled)
    }

    /// Works out anew what a cell's successors promise; returns whether it is open.
    fn look_again(&mut self, graph: &impl ChangingGraph, index: usize) -> bool {
        let cell = self.geometry.cell(index);
        if cell == self.goal {
            return false;
        }
        let (best, towards) = match graph.costs_around(cell) {
            Some(costs) => self.promise_at_once(&costs, index),
            None => self.promise(graph, cell),
        };
        self.set_promised(index, best);
        self.marks[index] = towards;
        self.values(index)[0] != best
    }

    /// What a cell's successors promise and the mark of the step there, step by step.
    fn promise(&self, graph: &impl ChangingGraph, cell: Cell) -> (u64, u8) {
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
        (best, towards)
    }

    /// The same for steps that were priced together. Those that leave the map are closed, so it does not matter which cell
    /// is looked at for them.
    fn promise_at_once(&self, costs: &[f64; MOST_STEPS], index: usize) -> (u64, u8) {
        let (mut best, mut towards) = (INFINITE, 0);
        for (k, (&offset, &cost)) in self.offsets.iter().zip(costs).enumerate() {
            let Some(values) = self.costs.get(index.wrapping_add_signed(offset)) else {
                continue;
            };
            let offered = joined(cost, values[0] ^ INFINITE);
            let better = offered < best;
            best = if better { offered } else { best };
            towards = if better { k as u8 + 1 } else { towards };
        }
        (best, towards)
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

    /// Sets what is promised to a cell, and notes its block for [`Self::forget`]: every other lasting write to a cell comes later.
    fn set_promised(&mut self, index: usize, cost: u64) {
        let block = index / BLOCK;
        if !self.is_used[block] {
            self.is_used[block] = true;
            self.used.push(block as u32);
        }
        self.costs[index][1] = cost ^ INFINITE;
    }
}

/// How far a step leads among the indices of cells.
fn offset(geometry: &GridGeometry, step: Step) -> isize {
    step.rows as isize * geometry.columns() as isize + step.columns as isize
}

/// A step's cost and the cost behind it, in bits: their sum, and in any case more than what is behind.
fn joined(step: f64, behind: u64) -> u64 {
    (step + f64::from_bits(behind)).to_bits().max(behind + 1)
}
