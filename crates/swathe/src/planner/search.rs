//! Dijkstra and A* over grid steps.

use std::collections::HashSet;

use crate::grid::{Cell, GridGeometry, Step};
use crate::progress::Report;

use super::radix_heap::RadixHeap;

/// Expansions between two reports.
const EXPANSIONS_PER_REPORT: u64 = 1 << 16;

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
///
/// Each is kept as the bits in which it differs from infinity: memory that is nothing but zeros costs nothing until it is
/// written, so that a search of a few cells of a large map is quick.
struct Costs {
    bits: Vec<u64>,
    settled: Vec<u64>,
}

const INFINITE: u64 = f64::INFINITY.to_bits();

impl Costs {
    fn new(cells: usize) -> Self {
        Self {
            bits: vec![0; cells],
            settled: vec![0; cells.div_ceil(64)],
        }
    }

    fn to(&self, index: usize) -> f64 {
        f64::from_bits(self.bits[index] ^ INFINITE)
    }

    fn set(&mut self, index: usize, cost: f64) {
        self.bits[index] = cost.to_bits() ^ INFINITE;
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
    Some((0..costs.bits.len()).map(|index| costs.to(index)).collect())
}

/// Settles cells until the goal is; returns whether it was reached.
fn settle(
    graph: &impl StepGraph,
    start: Cell,
    goal: Option<Cell>,
    costs: &mut Costs,
    report: &mut Report,
) -> Option<bool> {
    let geometry = graph.geometry();
    let goal = goal.map(|goal| geometry.index(goal));
    let mut queue = RadixHeap::new();
    let first = geometry.index(start);
    costs.set(first, 0.0);
    queue.push(graph.bound(start), first as u32);
    let mut expanded = 0;
    while let Some((_, index)) = queue.pop() {
        let index = index as usize;
        if costs.is_settled(index) {
            continue;
        }
        costs.settle(index);
        if Some(index) == goal {
            report(expanded, 0);
            return Some(true);
        }
        if expanded % EXPANSIONS_PER_REPORT == 0 && !report(expanded, 0) {
            return None;
        }
        expanded += 1;
        let (here, so_far) = (geometry.cell(index), costs.to(index));
        for (k, step) in graph.steps().iter().enumerate() {
            let Some(near) = step.from(&geometry, here) else {
                continue;
            };
            let next = geometry.index(near);
            if costs.is_settled(next) {
                continue;
            }
            let cost = so_far + graph.edge_cost(here, k);
            if cost < costs.to(next) {
                costs.set(next, cost);
                queue.push(cost + graph.bound(near), next as u32);
            }
        }
    }
    Some(false)
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
