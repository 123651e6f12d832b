//! Dijkstra and A* over grid steps.
//!
//! Where the graph tells the scale of its costs the queue is a circle of buckets; cells of one bucket are taken first in,
//! first out, and again when they were taken too early, so that costs come out the same to the last bit as from a queue
//! in full order. A step is priced only when a lower bound on its cost leaves room for a cheaper way.

use std::collections::HashSet;

use crate::grid::{Cell, GridGeometry, Step};
use crate::progress::Report;

use super::kernel::Buckets;
use super::radix_heap::CostHeap;

/// Expansions between two reports.
const EXPANSIONS_PER_REPORT: u64 = 1 << 16;

/// Buckets for the cost that a graph gives as its scale.
const BUCKETS_PER_SCALE: f64 = 4.0;

/// Buckets of the circle; costlier steps wait outside.
const CIRCLE: usize = 1 << 10;

/// Bits of the infinite cost. Costs are stored xored with it, so that memory that was never touched means infinite.
const INFINITE: u64 = f64::INFINITY.to_bits();

/// A directed graph whose nodes are cells and whose edges are steps.
pub trait StepGraph {
    /// The cells.
    fn geometry(&self) -> GridGeometry;

    /// The steps that lead out of every cell.
    fn steps(&self) -> &[Step];

    /// Cost of the step with an index out of a cell, not negative; infinite when it is closed or leaves the grid.
    fn edge_cost(&self, from: Cell, step: usize) -> f64;

    /// A lower bound, consistent with the edges, on the cost from a cell to the goal; 0 makes A* into Dijkstra.
    fn bound(&self, cell: Cell) -> f64;

    /// The cost of a short step over usual ground, above 0 and finite; `None` when costs differ by orders of magnitude.
    fn scale(&self) -> Option<f64> {
        None
    }

    /// A lower bound on the cost of the step with an index from a cell to another, quicker to know than the cost.
    fn least_step(&self, _from: Cell, _to: Cell, _step: usize) -> f64 {
        0.0
    }

    /// What [`Self::edge_cost_seen`] can use for all the steps out of a cell.
    fn surroundings(&self, _from: Cell) -> u32 {
        0
    }

    /// [`Self::edge_cost`], given the [`Self::surroundings`] of the cell.
    fn edge_cost_seen(&self, from: Cell, step: usize, _surroundings: u32) -> f64 {
        self.edge_cost(from, step)
    }
}

/// How a search ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Search {
    /// A cheapest way.
    Found {
        /// Its cells from start to goal.
        cells: Vec<Cell>,
        /// Its cost.
        cost: f64,
    },
    /// No way exists.
    Unreachable,
    /// The caller asked to stop.
    Stopped,
}

/// Costs from a start, settled as far as the search went.
struct Costs {
    /// Bits xored with those of infinity.
    to: Vec<u64>,
    /// Cells whose steps were followed from the cost that they have.
    settled: Vec<u64>,
}

impl Costs {
    fn new(cells: usize) -> Self {
        Self {
            // Zeroed memory comes from the system untouched.
            to: vec![0; cells],
            settled: vec![0; cells.div_ceil(64)],
        }
    }

    fn to(&self, index: usize) -> f64 {
        f64::from_bits(self.to[index] ^ INFINITE)
    }

    fn lower(&mut self, index: usize, cost: f64) {
        self.to[index] = cost.to_bits() ^ INFINITE;
        self.settled[index / 64] &= !(1 << (index % 64));
    }

    fn is_settled(&self, index: usize) -> bool {
        self.settled[index / 64] >> (index % 64) & 1 == 1
    }

    fn settle(&mut self, index: usize) {
        self.settled[index / 64] |= 1 << (index % 64);
    }
}

/// A cheapest way from `start` to `goal`. `report` counts expanded cells.
pub fn search(graph: &impl StepGraph, start: Cell, goal: Cell, report: &mut Report) -> Search {
    let mut costs = Costs::new(graph.geometry().cell_count());
    match settle(graph, start, Some(goal), &mut costs, report) {
        None => Search::Stopped,
        Some(false) => Search::Unreachable,
        Some(true) => Search::Found {
            cells: trace(graph, start, goal, &costs),
            cost: costs.to(graph.geometry().index(goal)),
        },
    }
}

/// Costs from `start` to every cell, infinite where no way leads; `None` when the caller asked to stop.
pub fn cost_field(graph: &impl StepGraph, start: Cell, report: &mut Report) -> Option<Vec<f64>> {
    let mut costs = Costs::new(graph.geometry().cell_count());
    settle(graph, start, None, &mut costs, report)?;
    Some(
        costs
            .to
            .into_iter()
            .map(|bits| f64::from_bits(bits ^ INFINITE))
            .collect(),
    )
}

/// Cells by a cost that never falls far.
trait Queue {
    /// Whether cells can come out too early, so that cheaper ways to settled cells must be followed too.
    const REOPENS: bool;

    fn push(&mut self, cost: f64, cell: u32);

    /// Takes a cell, with its turn: once a later turn comes, costs of cells taken in earlier ones are the least.
    fn pop(&mut self) -> Option<(u64, u32)>;
}

/// A queue in full order: every cell has a turn of its own.
struct Ordered {
    heap: CostHeap,
    turn: u64,
}

impl Queue for Ordered {
    const REOPENS: bool = false;

    fn push(&mut self, cost: f64, cell: u32) {
        self.heap.push(cost, cell);
    }

    fn pop(&mut self) -> Option<(u64, u32)> {
        self.turn += 1;
        self.heap.pop().map(|(_, cell)| (self.turn, cell))
    }
}

/// A circle of buckets: the cells of a bucket share a turn.
struct Circle {
    buckets: Buckets<u32>,
    per_cost: f64,
    /// Cells taken out together, and how many of them were handed on.
    present: Vec<u32>,
    given: usize,
}

impl Queue for Circle {
    const REOPENS: bool = true;

    fn push(&mut self, cost: f64, cell: u32) {
        self.buckets.push((cost * self.per_cost) as u64, cell);
    }

    fn pop(&mut self) -> Option<(u64, u32)> {
        while self.given == self.present.len() {
            self.given = 0;
            if !self.buckets.take(&mut self.present) && !self.buckets.advance() {
                return None;
            }
        }
        self.given += 1;
        Some((self.buckets.round(), self.present[self.given - 1]))
    }
}

/// Settles cells until the goal is; returns whether it was reached.
fn settle(
    graph: &impl StepGraph,
    start: Cell,
    goal: Option<Cell>,
    costs: &mut Costs,
    report: &mut Report,
) -> Option<bool> {
    if let Some(scale) = graph.scale() {
        let queue = Circle {
            buckets: Buckets::new(CIRCLE),
            per_cost: BUCKETS_PER_SCALE / scale,
            present: Vec::new(),
            given: 0,
        };
        settle_by(queue, graph, start, goal, costs, report)
    } else {
        let (heap, turn) = (CostHeap::new(), 0);
        settle_by(Ordered { heap, turn }, graph, start, goal, costs, report)
    }
}

fn settle_by<Q: Queue>(
    mut queue: Q,
    graph: &impl StepGraph,
    start: Cell,
    goal: Option<Cell>,
    costs: &mut Costs,
    report: &mut Report,
) -> Option<bool> {
    let geometry = graph.geometry();
    let goal = goal.map(|goal| geometry.index(goal));
    let steps: Vec<(Step, isize)> = graph
        .steps()
        .iter()
        .map(|&step| {
            let offset = step.rows as isize * geometry.columns() as isize + step.columns as isize;
            (step, offset)
        })
        .collect();
    let reach = steps
        .iter()
        .map(|(step, _)| step.rows.unsigned_abs().max(step.columns.unsigned_abs()) as usize)
        .max()
        .unwrap_or(0);
    let first = geometry.index(start);
    costs.lower(first, 0.0);
    queue.push(graph.bound(start), first as u32);
    let mut expanded = 0;
    let mut goal_turn = None;
    while let Some((turn, index)) = queue.pop() {
        if goal_turn.is_some_and(|goal_turn| turn > goal_turn) {
            break;
        }
        let index = index as usize;
        if costs.is_settled(index) {
            continue;
        }
        costs.settle(index);
        if Some(index) == goal {
            goal_turn = Some(turn);
            continue;
        }
        if expanded % EXPANSIONS_PER_REPORT == 0 && !report(expanded, 0) {
            return None;
        }
        expanded += 1;
        let (here, so_far) = (geometry.cell(index), costs.to(index));
        let surroundings = graph.surroundings(here);
        let is_inner = here.row >= reach
            && here.column >= reach
            && here.row + reach < geometry.rows()
            && here.column + reach < geometry.columns();
        for (k, &(step, offset)) in steps.iter().enumerate() {
            if !is_inner && step.from(&geometry, here).is_none() {
                continue;
            }
            let next = index.wrapping_add_signed(offset);
            let known = costs.to(next);
            if so_far >= known || !Q::REOPENS && costs.is_settled(next) {
                continue;
            }
            let near = Cell::new(
                here.row.wrapping_add_signed(step.rows as isize),
                here.column.wrapping_add_signed(step.columns as isize),
            );
            if so_far + graph.least_step(here, near, k) >= known {
                continue;
            }
            let cost = so_far + graph.edge_cost_seen(here, k, surroundings);
            if cost < known {
                costs.lower(next, cost);
                queue.push(cost + graph.bound(near), next as u32);
            }
        }
    }
    report(expanded, 0);
    Some(goal_turn.is_some())
}

/// Walks back from the goal along edges that explain the costs exactly; no parents are stored.
///
/// Edges of no cost can lead into a dead end or a circle, so the walk backtracks and enters no cell twice.
fn trace(graph: &impl StepGraph, start: Cell, goal: Cell, costs: &Costs) -> Vec<Cell> {
    let geometry = graph.geometry();
    let mut entered = HashSet::from([goal]);
    let mut walk = vec![(goal, 0)];
    while let Some((here, first)) = walk.last().copied()
        && here != start
    {
        let cost = costs.to(geometry.index(here));
        let previous = (first..graph.steps().len()).find_map(|k| {
            let Step { rows, columns } = graph.steps()[k];
            let before = geometry.offset(here, -rows, -columns)?;
            let index = geometry.index(before);
            let explains = costs.is_settled(index)
                && costs.to(index) + graph.edge_cost(before, k) == cost
                && !entered.contains(&before);
            explains.then_some((k, before))
        });
        let end = walk.len() - 1;
        if let Some((k, before)) = previous {
            walk[end].1 = k + 1;
            entered.insert(before);
            walk.push((before, 0));
        } else {
            walk.pop();
        }
    }
    walk.iter().rev().map(|&(cell, _)| cell).collect()
}
