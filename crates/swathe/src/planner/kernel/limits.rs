//! A lower bound on the cost to the goal from a coarse grid, and the ground that it rules out.
//!
//! Lattice nodes lie every 8 or 16 cells, one of them on the goal; between them lie blocks, each with the least cost per
//! metre `m` of its cells, rim included. Node values are distances on the lattice with 8 neighbours, where a step costs
//! its length times the least `m` of the blocks that it runs along. Then no way over cells costs less:
//!
//! - Every step over cells that runs in a block costs at least `m` times its octile length. (A knight's move that spans
//!   two blocks runs half in each. Steps of 16 neighbours may be shorter than octile, by the factor `KNIGHT`.)
//! - Values at the corners of a block, continued linearly along its sides, differ between any two points of its rim by at
//!   most `m` times their octile distance: on one side and on opposite sides because corners do, on adjacent sides because
//!   with slopes `a`, `b` at the shared corner |a|, |b| and |a - b| / sqrt(2) are at most `m`. Both blocks beside a side
//!   see the same values there.
//! - What is Lipschitz on the rim has a Lipschitz continuation inside (E. J. Mc Shane, Bull. AMS 40, 1934). It is 0 at the goal,
//!   nowhere falls by more than a step costs, and is at least the least corner of the block.

use crate::grid::{Cell, EIGHT};
use crate::planner::radix_heap::CostHeap;

use super::costs::CellCost;
use super::settle::Ground;

/// Queries over at least so many rows or columns use the wide blocks.
const FAR_CELLS: usize = 1500;

/// Side of the blocks for a query, as a power of two of cells: narrow ones bound better and are more.
pub(super) fn shift(start: Cell, goal: Cell) -> u32 {
    let cells = start.row.abs_diff(goal.row).max(start.column.abs_diff(goal.column));
    if cells < FAR_CELLS { 3 } else { 4 }
}

/// Blocks beside the coarse way that the first, narrow search may use.
const TUBE: usize = 1;
/// Least ratio of the length of steps on 16 neighbours to the octile one: that of a knight's move.
const KNIGHT: f64 = 0.926_209;
/// A hair less than the bound, so that rounding cannot lift it above the truth.
const HAIR: f64 = 1.0 - 1e-9;

/// Until when cells of each block may be expanded.
pub(super) struct Limits {
    /// The first bucket that is too late.
    end: Vec<u64>,
    frame: Frame,
}

/// Bytes that limits and what they are made of hold for a map.
pub(super) fn bytes(rows: usize, columns: usize, shift: u32) -> u64 {
    // Bound, least cost, limit, and the queue, for every block.
    (((rows >> shift) + 2) * ((columns >> shift) + 2) * (8 + 8 + 8 + 16)) as u64
}

/// Where the lattice lies.
#[derive(Clone, Copy)]
struct Frame {
    /// Side of a block as a power of two.
    shift: u32,
    /// Rows and columns that the lattice begins before the grid.
    before: [usize; 2],
    /// Blocks from north to south and from west to east.
    blocks: [usize; 2],
}

impl Limits {
    #[inline(always)]
    pub(super) fn passed(&self, row: usize, column: usize, round: u64) -> bool {
        let block = self.frame.block(row, column);
        self.end.get(block).is_some_and(|&end| round >= end)
    }
}

impl Frame {
    fn new(rows: usize, columns: usize, goal: Cell, shift: u32) -> Self {
        let side = 1 << shift;
        let before = [goal.row, goal.column].map(|at| (side - at % side) % side);
        Self {
            shift,
            before,
            blocks: [(rows - 1 + before[0]) / side + 1, (columns - 1 + before[1]) / side + 1],
        }
    }

    #[inline(always)]
    fn block(&self, row: usize, column: usize) -> usize {
        ((row + self.before[0]) >> self.shift) * self.blocks[1] + ((column + self.before[1]) >> self.shift)
    }

    fn nodes_across(&self) -> usize {
        self.blocks[1] + 1
    }

    /// The rows (`axis` 0) or columns (1) of cells in a row or column of blocks.
    fn span(&self, axis: usize, block: usize, cells: usize) -> std::ops::Range<usize> {
        let before = self.before[axis];
        (block << self.shift).saturating_sub(before)..(((block + 1) << self.shift) - before).min(cells)
    }

    /// The node at the north-west corner of the block of a cell.
    fn node(&self, cell: Cell) -> usize {
        ((cell.row + self.before[0]) >> self.shift) * self.nodes_across()
            + ((cell.column + self.before[1]) >> self.shift)
    }

    /// The corners of the block at a row and column of blocks.
    fn corners(&self, row: usize, column: usize) -> [usize; 4] {
        let first = row * self.nodes_across() + column;
        [
            first,
            first + 1,
            first + self.nodes_across(),
            first + self.nodes_across() + 1,
        ]
    }
}

/// Least costs from lattice nodes to the goal, found from the goal outwards as far as asked.
pub(super) struct Coarse<'a, 'b, C> {
    ground: &'a Ground<'b, C>,
    frame: Frame,
    /// Least cost per metre of every block; NaN where it was not asked for yet.
    least: Vec<f64>,
    to_goal: Vec<f64>,
    queue: CostHeap,
    settled_to: f64,
    /// First and last row and column of nodes with a value.
    reached: [[usize; 2]; 2],
    metres: f64,
}

impl<'a, 'b, C: CellCost> Coarse<'a, 'b, C> {
    pub(super) fn new(ground: &'a Ground<'b, C>, start: Cell, goal: Cell, sixteen: bool) -> Self {
        let frame = Frame::new(ground.rows, ground.columns, goal, shift(start, goal));
        let mut to_goal = vec![f64::INFINITY; (frame.blocks[0] + 1) * frame.nodes_across()];
        let mut queue = CostHeap::new();
        to_goal[frame.node(goal)] = 0.0;
        queue.push(0.0, frame.node(goal) as u32);
        let shortest = if sixteen { KNIGHT } else { 1.0 };
        Self {
            ground,
            frame,
            least: vec![f64::NAN; frame.blocks[0] * frame.blocks[1]],
            to_goal,
            queue,
            settled_to: 0.0,
            reached: [
                frame.node(goal) / frame.nodes_across(),
                frame.node(goal) % frame.nodes_across(),
            ]
            .map(|at| [at, at]),
            metres: ground.metres * f64::from(1 << frame.shift) * shortest * HAIR,
        }
    }

    /// The least cost from a cell's block to the goal, infinite when nothing leads there.
    pub(super) fn bound(&mut self, cell: Cell) -> f64 {
        let corners = self.corners_of(cell);
        while corners.iter().any(|&node| self.to_goal[node] > self.settled_to) && self.settle_one() {}
        corners
            .iter()
            .map(|&node| self.to_goal[node])
            .fold(f64::INFINITY, f64::min)
    }

    /// Limits that keep a search near the coarse way from a cell, whose bound was asked for.
    pub(super) fn tube(&mut self, from: Cell) -> Limits {
        let [rows, columns] = self.frame.blocks;
        let mut end = vec![0; rows * columns];
        let corners = self.corners_of(from);
        let mut node = corners
            .into_iter()
            .min_by(|&a, &b| self.to_goal[a].total_cmp(&self.to_goal[b]));
        while let Some(here) = node {
            let (row, column) = (here / self.frame.nodes_across(), here % self.frame.nodes_across());
            for row in row.saturating_sub(TUBE + 1)..(row + TUBE + 1).min(rows) {
                let line = row * columns;
                end[line + column.saturating_sub(TUBE + 1)..line + (column + TUBE + 1).min(columns)].fill(u64::MAX);
            }
            let costs = self.steps(here);
            node = (0..8)
                .filter_map(|k| Some((self.neighbour(here, k)?, costs[k])))
                .filter(|&(near, _)| self.to_goal[near] < self.to_goal[here])
                .min_by(|a, b| (self.to_goal[a.0] + a.1).total_cmp(&(self.to_goal[b.0] + b.1)))
                .map(|(near, _)| near);
        }
        Limits { end, frame: self.frame }
    }

    /// Limits for ways that cost no more than `most`; `round` gives the last bucket of a cost from the start.
    pub(super) fn limits(&mut self, most: f64, round: impl Fn(f64) -> u64) -> Limits {
        while self.settled_to <= most && self.settle_one() {}
        let across = self.frame.blocks[1];
        let mut end = vec![0; self.frame.blocks[0] * across];
        let [rows, columns] = self.blocks_near(0);
        for row in rows {
            for column in columns.clone() {
                let corners = self.frame.corners(row, column).map(|node| self.to_goal[node]);
                let left = most - corners.into_iter().fold(f64::INFINITY, f64::min);
                // Nodes beyond `most` may not have their least value yet; it is beyond `most` too.
                if left >= 0.0 {
                    end[row * across + column] = round(left).saturating_add(1);
                }
            }
        }
        Limits { end, frame: self.frame }
    }

    /// The cells that a search in a tube can have labelled, as ranges of indices: those of open blocks and around.
    pub(super) fn for_each_labelled(&self, tube: &Limits, mut visit: impl FnMut(std::ops::Range<usize>)) {
        let [rows, columns] = self.frame.blocks;
        let open = |row: usize, column: usize| tube.end[row * columns + column] > 0;
        let [near_rows, near_columns] = self.blocks_near(TUBE + 1);
        for row in near_rows {
            let above_to_below = row.saturating_sub(1)..(row + 2).min(rows);
            for column in near_columns.clone() {
                let west_to_east = column.saturating_sub(1)..(column + 2).min(columns);
                if above_to_below
                    .clone()
                    .any(|row| west_to_east.clone().any(|column| open(row, column)))
                {
                    let cells = self.frame.span(1, column, self.ground.columns);
                    for line in self.frame.span(0, row, self.ground.rows) {
                        let line = line * self.ground.columns;
                        visit(line + cells.start..line + cells.end);
                    }
                }
            }
        }
    }

    /// Rows and columns of blocks no more than some from nodes with a value.
    fn blocks_near(&self, blocks: usize) -> [std::ops::Range<usize>; 2] {
        [0, 1].map(|axis| {
            let [first, last] = self.reached[axis];
            first.saturating_sub(blocks + 1)..(last + blocks + 1).min(self.frame.blocks[axis])
        })
    }

    fn corners_of(&self, cell: Cell) -> [usize; 4] {
        let node = self.frame.node(cell);
        self.frame
            .corners(node / self.frame.nodes_across(), node % self.frame.nodes_across())
    }

    /// Settles the next node; false when none is left.
    fn settle_one(&mut self) -> bool {
        let Some((cost, node)) = self.queue.pop() else {
            self.settled_to = f64::INFINITY;
            return false;
        };
        let node = node as usize;
        if cost > self.to_goal[node] {
            return true;
        }
        self.settled_to = cost;
        let costs = self.steps(node);
        let across = self.frame.nodes_across();
        for (k, step) in costs.into_iter().enumerate() {
            if let Some(near) = self.neighbour(node, k)
                && cost + step < self.to_goal[near]
            {
                self.to_goal[near] = cost + step;
                for (reached, at) in self.reached.iter_mut().zip([near / across, near % across]) {
                    *reached = [reached[0].min(at), reached[1].max(at)];
                }
                self.queue.push(cost + step, near as u32);
            }
        }
        true
    }

    fn neighbour(&self, node: usize, k: usize) -> Option<usize> {
        let across = self.frame.nodes_across();
        let row = (node / across).checked_add_signed(EIGHT[k].rows as isize)?;
        let column = (node % across).checked_add_signed(EIGHT[k].columns as isize)?;
        (row <= self.frame.blocks[0] && column < across).then_some(row * across + column)
    }

    /// Costs of the eight steps out of a node.
    fn steps(&mut self, node: usize) -> [f64; 8] {
        let (row, column) = (node / self.frame.nodes_across(), node % self.frame.nodes_across());
        // Counter-clockwise from the north-east.
        let [ne, nw, sw, se] =
            [(1, 0), (1, 1), (0, 1), (0, 0)].map(|(up, left)| match (row.checked_sub(up), column.checked_sub(left)) {
                (Some(row), Some(column)) => self.least_of(row, column),
                _ => f64::INFINITY,
            });
        let diagonal = self.metres * std::f64::consts::SQRT_2;
        [
            self.metres * ne.min(se),
            diagonal * ne,
            self.metres * ne.min(nw),
            diagonal * nw,
            self.metres * nw.min(sw),
            diagonal * sw,
            self.metres * sw.min(se),
            diagonal * se,
        ]
    }

    /// Least cost per metre of a block, rim included; infinite when closed or outside.
    fn least_of(&mut self, row: usize, column: usize) -> f64 {
        let [rows, columns] = self.frame.blocks;
        if row >= rows || column >= columns {
            return f64::INFINITY;
        }
        let block = row * columns + column;
        if self.least[block].is_nan() {
            let with_rim = |span: std::ops::Range<usize>, cells: usize| span.start..(span.end + 1).min(cells);
            let across = self.frame.span(1, column, self.ground.columns);
            let across = with_rim(across, self.ground.columns);
            let mut least = f64::INFINITY;
            for row in with_rim(self.frame.span(0, row, self.ground.rows), self.ground.rows) {
                let line = row * self.ground.columns;
                for cost in &self.ground.costs[line + across.start..line + across.end] {
                    let cost = cost.per_metre();
                    least = if cost < least { cost } else { least };
                }
            }
            self.least[block] = least;
        }
        self.least[block]
    }
}
