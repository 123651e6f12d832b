//! The route on the memory: a window of cells around the robot in which the cheapest way to the goal is kept right by D* Lite
//! while cells change.
//!
//! A cell is closed when an obstacle lies within the circle around the footprint; around that, costs fall off in two rings.
//! A goal outside the window is replaced by where the global route, or the straight line, leaves the window.

use crate::grid::{Cell, GridGeometry, LayerView, Position};
use crate::planner::{ChangingCells, Corners, Repair, Search};

use super::memory::{Memory, Seen};

/// Cells that a search looks at in one step of the navigator; what is left is done in the next.
const WORK_PER_STEP: u64 = 12_288;

/// Cost near obstacles, ring by ring outwards.
const RING_COSTS: [f64; 2] = [3.0, 1.4];

/// Depth of each ring as a share of the closed radius, one cell at least.
const RING_SHARE: f64 = 0.6;

/// How far around a closed goal that stands for one outside the window an open cell is looked for, in cells.
const BORDER_SEARCH_CELLS: i64 = 96;

/// A line that costs this much more than the way is still taken for it: both are counted by samples.
const SAME_COST: f64 = 1.005;

/// How the route stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Standing {
    /// A search is going on and none has ended yet.
    Pending,
    /// There is a way.
    Found,
    /// Closed cells separate robot and goal.
    Enclosed,
    /// No open cell at the goal.
    GoalBlocked,
}

/// What the window must know of ground that the sensors do not tell.
pub(super) trait Ground {
    /// Cost of the ground of every cell of a grid as a multiple of the usual, infinite where closed.
    fn factors(&self, geometry: &GridGeometry) -> Vec<f32>;
}

/// How a window is laid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout<'a> {
    pub cells: usize,
    pub closed_m: f64,
    pub unknown_cost: f64,
    pub arrival_m: f64,
    pub goal: Position,
    /// The rest of the global route, empty without one.
    pub global: &'a [Position],
}

fn disc(radius_cells: f64) -> Vec<(i64, i64)> {
    let reach = radius_cells.floor() as i64;
    let inside = |row: i64, column: i64| ((row * row + column * column) as f64) <= radius_cells * radius_cells;
    (-reach..=reach)
        .flat_map(|row| (-reach..=reach).map(move |column| (row, column)))
        .filter(|&(row, column)| inside(row, column))
        .collect()
}

/// What the cells of the window cost and why.
#[derive(Debug)]
struct Costs {
    geometry: GridGeometry,
    /// Lattice row and column of the first cell.
    first: (i64, i64),
    seen: Vec<Seen>,
    terrain: Vec<f32>,
    /// Obstacles near each cell: within the closed radius, and within each ring.
    near: [Vec<u16>; 3],
    discs: [Vec<(i64, i64)>; 3],
    unknown_cost: f64,
    /// Cells whose cost must be worked out anew.
    dirty: Vec<u32>,
    is_dirty: Vec<bool>,
}

impl Costs {
    fn new(memory: &Memory, at: Position, layout: &Layout, ground: Option<&dyn Ground>) -> Option<Self> {
        let size = memory.cell_size_m;
        let side = layout.cells;
        let (row, column) = memory.cell_of(at.x_m, at.y_m);
        let first = (row - side as i64 / 2, column - side as i64 / 2);
        let geometry = GridGeometry::new(side, side, size, first.1 as f64 * size, -first.0 as f64 * size).ok()?;
        let closed = layout.closed_m / size;
        let ring = (closed * RING_SHARE).max(1.0);
        let count = geometry.cell_count();
        let mut costs = Self {
            geometry,
            first,
            seen: vec![Seen::Unknown; count],
            terrain: ground.map_or_else(|| vec![1.0; count], |ground| ground.factors(&geometry)),
            near: std::array::from_fn(|_| vec![0; count]),
            discs: [disc(closed), disc(closed + ring), disc(closed + 2.0 * ring)],
            unknown_cost: layout.unknown_cost,
            dirty: Vec::new(),
            is_dirty: vec![false; count],
        };
        memory.copy_square(first, side, &mut costs.seen);
        for index in 0..count {
            let cell = geometry.cell(index);
            if costs.seen[index].closed() {
                costs.spread(cell, true);
            }
        }
        // All costs are worked out when the graph is made.
        costs.dirty.clear();
        costs.is_dirty.fill(false);
        Some(costs)
    }

    /// Counts an obstacle in, or out.
    fn spread(&mut self, cell: Cell, closes: bool) {
        for (ring, (near, disc)) in self.near.iter_mut().zip(&self.discs).enumerate() {
            for &(rows, columns) in disc {
                let Some(around) = self
                    .geometry
                    .checked(cell.row as i64 + rows, cell.column as i64 + columns)
                else {
                    continue;
                };
                let index = self.geometry.index(around);
                let before = near[index];
                near[index] = if closes {
                    before.saturating_add(1)
                } else {
                    before.saturating_sub(1)
                };
                // A count that does not come from or go to nothing changes no cost.
                if (before == 0 || near[index] == 0) && !self.is_dirty[index] && ring < 3 {
                    self.is_dirty[index] = true;
                    self.dirty.push(index as u32);
                }
            }
        }
    }

    fn cost(&self, index: usize) -> f64 {
        if self.near[0][index] > 0 {
            return f64::INFINITY;
        }
        let seen = if self.seen[index] == Seen::Unknown {
            self.unknown_cost
        } else {
            1.0
        };
        let ring = match (self.near[1][index] > 0, self.near[2][index] > 0) {
            (true, _) => RING_COSTS[0],
            (false, true) => RING_COSTS[1],
            _ => 1.0,
        };
        seen * ring * f64::from(self.terrain[index])
    }

    fn inside(&self, (row, column): (i64, i64)) -> Option<Cell> {
        self.geometry.checked(row - self.first.0, column - self.first.1)
    }

    /// The open cell nearest to one, at most some cells away.
    fn open_near(&self, cell: Cell, reach: i64) -> Option<Cell> {
        let is_open = |cell: Cell| self.cost(self.geometry.index(cell)).is_finite();
        if is_open(cell) {
            return Some(cell);
        }
        let mut best: Option<(i64, Cell)> = None;
        for around in 1..=reach {
            if best.is_some_and(|(away, _)| around * around > away) {
                break;
            }
            let edge = (-around..=around)
                .flat_map(|along| [(-around, along), (around, along), (along, -around), (along, around)]);
            for (rows, columns) in edge {
                let away = rows * rows + columns * columns;
                if away > reach * reach || best.is_some_and(|(least, _)| away >= least) {
                    continue;
                }
                let Some(near) = self
                    .geometry
                    .checked(cell.row as i64 + rows, cell.column as i64 + columns)
                else {
                    continue;
                };
                if is_open(near) {
                    best = Some((away, near));
                }
            }
        }
        best.map(|(_, cell)| cell)
    }
}

/// The window with its search.
#[derive(Debug)]
pub(super) struct RouteWindow {
    costs: Costs,
    graph: ChangingCells,
    repair: Repair,
    /// Whether the goal itself lies inside, not something that stands for it.
    pub goal_inside: bool,
    pub standing: Standing,
    /// The way, from the robot on.
    pub way: Vec<Position>,
    escape_cells: i64,
}

impl RouteWindow {
    /// A window around a place, filled from the memory. `None` when no grid can be laid there.
    pub fn new(memory: &Memory, at: Position, layout: &Layout, ground: Option<&dyn Ground>) -> Option<Self> {
        let costs = Costs::new(memory, at, layout, ground)?;
        let geometry = costs.geometry;
        let size = geometry.cell_size_m();
        let goal_cell = geometry.cell_at(layout.goal);
        let goal_inside = goal_cell.is_some();
        let reach = (layout.arrival_m / size).floor() as i64;
        let found = match goal_cell {
            Some(cell) => costs.open_near(cell, reach),
            None => stand_in(&geometry, at, layout).and_then(|cell| costs.open_near(cell, BORDER_SEARCH_CELLS)),
        };
        let standing = if found.is_some() {
            Standing::Pending
        } else {
            Standing::GoalBlocked
        };
        let start = geometry.cell_at(at)?;
        let goal = found.unwrap_or(start);
        let data: Vec<f64> = (0..geometry.cell_count()).map(|index| costs.cost(index)).collect();
        let layer = LayerView::new(geometry, &data, "the window's costs").ok()?;
        let graph = ChangingCells::new(layer, goal, 8, Corners::Keep).ok()?;
        let repair = Repair::new(&graph, start, goal).ok()?;
        let escape_cells = (2.0 * layout.closed_m / size).ceil() as i64 + 1;
        Some(Self {
            costs,
            graph,
            repair,
            goal_inside,
            standing,
            way: Vec::new(),
            escape_cells,
        })
    }

    /// Whether a place lies so near to the border that the window should move.
    pub fn is_leaving(&self, at: Position) -> bool {
        let geometry = &self.costs.geometry;
        let (row, column) = geometry.fractional(at);
        let (rows, columns) = (geometry.rows() as f64, geometry.columns() as f64);
        let inner = |along: f64, cells: f64| along > 0.22 * cells && along < 0.78 * cells;
        !(inner(row, rows) && inner(column, columns))
    }

    /// Whether a place lies outside.
    pub fn is_outside(&self, at: Position) -> bool {
        self.costs.geometry.cell_at(at).is_none()
    }

    /// Cells along the side.
    pub fn cells(&self) -> usize {
        self.costs.geometry.rows()
    }

    /// Takes in that a cell of the lattice is remembered otherwise than before.
    pub fn set(&mut self, cell: (i64, i64), seen: Seen) {
        let Some(cell) = self.costs.inside(cell) else { return };
        let index = self.costs.geometry.index(cell);
        let before = std::mem::replace(&mut self.costs.seen[index], seen);
        if before.closed() != seen.closed() {
            self.costs.spread(cell, seen.closed());
        }
        if (before == Seen::Unknown) != (seen == Seen::Unknown) && !self.costs.is_dirty[index] {
            self.costs.is_dirty[index] = true;
            self.costs.dirty.push(index as u32);
        }
    }

    /// Whether the robot could stand at a place for all that is known; outside the window it could.
    pub fn is_open(&self, at: Position) -> bool {
        self.cost_at(at).is_finite()
    }

    /// Whether the straight line between two places is open.
    pub fn sees(&self, from: Position, to: Position) -> bool {
        self.line_cost(from, to).is_finite()
    }

    /// Repairs the way from a place; returns whether another way was found, and whether it was searched from nothing.
    pub fn repair(&mut self, at: Position) -> Option<bool> {
        let Self {
            costs, graph, repair, ..
        } = self;
        let geometry = costs.geometry;
        costs.dirty.sort_unstable();
        let changes: Vec<(Cell, f64)> = costs
            .dirty
            .iter()
            .map(|&index| (geometry.cell(index as usize), costs.cost(index as usize)))
            .collect();
        for &index in &costs.dirty {
            costs.is_dirty[index as usize] = false;
        }
        costs.dirty.clear();
        if let Ok(changed) = graph.change(changes.iter().copied()) {
            repair.update(graph, changed);
        }
        let here = geometry.cell_at(at)?;
        if self.standing == Standing::GoalBlocked {
            return None;
        }
        if !graph.cost(repair.goal()).is_finite() {
            self.standing = Standing::GoalBlocked;
            self.way.clear();
            return None;
        }
        // A robot inside a closed cell leaves it by the nearest open one.
        let Some(start) = costs.open_near(here, self.escape_cells) else {
            self.standing = Standing::Enclosed;
            self.way.clear();
            return None;
        };
        repair.move_to(start).ok()?;
        let mut first_look = None;
        let found = repair.path(graph, &mut |looked, _| {
            let first = *first_look.get_or_insert(looked);
            looked - first < WORK_PER_STEP
        });
        match found {
            Search::Found { cells, .. } => {
                let afresh = repair.tally().afresh;
                let way: Vec<Position> = cells.iter().map(|&cell| geometry.centre(cell)).collect();
                let is_new = !self.way.ends_with(&way[1.min(way.len())..]);
                self.way = way;
                self.standing = Standing::Found;
                is_new.then_some(afresh)
            }
            Search::Unreachable => {
                self.standing = Standing::Enclosed;
                self.way.clear();
                None
            }
            Search::Stopped => None,
        }
    }

    /// Metres along the way.
    pub fn length_m(&self) -> f64 {
        self.way.windows(2).map(|pair| pair[0].distance_m(pair[1])).sum()
    }

    /// The place to head for, some metres ahead at most: on the straight line to the farthest point of the way to which that line
    /// is open and costs no more than the way itself, as far as `sight_m` along it. A way of steps to eight sides turns where open
    /// ground does not ask for it.
    pub fn ahead(&self, at: Position, lookahead_m: f64, sight_m: f64) -> Option<Position> {
        let first = *self.way.first()?;
        let mut best = *self.way.get(1).unwrap_or(&first);
        let mut along_m = 0.0;
        // As far as the way's first cell at least: with that no straight line over like ground costs more.
        let mut way_cost = at.distance_m(first) * self.cost_at(at).min(RING_COSTS[0]);
        // What is near is looked at point by point; farther away each look reaches a quarter farther.
        let mut next_m = 0.0;
        for (step, pair) in self.way.windows(2).enumerate() {
            let piece_m = pair[0].distance_m(pair[1]);
            along_m += piece_m;
            way_cost += piece_m * self.cost_at(pair[1]);
            let is_end = step + 2 == self.way.len();
            if along_m < next_m && !is_end {
                continue;
            }
            if along_m > lookahead_m.max(sight_m) {
                break;
            }
            // Two cells are less than any look-ahead.
            next_m = along_m + (2.0 * piece_m).max(if along_m < lookahead_m { 0.0 } else { 0.25 * along_m });
            let line_cost = self.line_cost(at, pair[1]);
            let is_near = along_m <= lookahead_m;
            let is_worth = if is_near {
                line_cost.is_finite()
            } else {
                line_cost <= way_cost * SAME_COST
            };
            if step > 0 && !is_worth {
                break;
            }
            best = pair[1];
        }
        let away_m = at.distance_m(best);
        Some(if away_m > lookahead_m {
            at.towards(best, lookahead_m / away_m)
        } else {
            best
        })
    }

    /// What a straight line costs, infinite where it is not open; outside the window everything costs the same.
    fn line_cost(&self, from: Position, to: Position) -> f64 {
        let length_m = from.distance_m(to);
        let steps = (length_m / self.costs.geometry.cell_size_m() * 1.5).ceil().max(1.0);
        let mut cost = 0.0;
        for k in 1..=steps as usize {
            cost += self.cost_at(from.towards(to, k as f64 / steps));
            if cost == f64::INFINITY {
                break;
            }
        }
        cost * length_m / steps
    }

    fn cost_at(&self, at: Position) -> f64 {
        let geometry = &self.costs.geometry;
        geometry
            .cell_at(at)
            .map_or(1.0, |cell| self.costs.cost(geometry.index(cell)))
    }
}

/// A cell near the window's border that stands for a goal outside: where the global route leaves, or the straight line.
fn stand_in(geometry: &GridGeometry, at: Position, layout: &Layout) -> Option<Cell> {
    let half_m = geometry.rows() as f64 * geometry.cell_size_m() * 0.48;
    let leaves = |to: Position| {
        let away = (to.x_m - at.x_m).abs().max((to.y_m - at.y_m).abs());
        (away > half_m).then(|| at.towards(to, half_m / away))
    };
    let mut last = None;
    for &point in layout.global {
        if let Some(border) = leaves(point) {
            // Between two points of the route the border is crossed somewhere; the last point inside is surely on it.
            return geometry.cell_at(last.unwrap_or(border));
        }
        last = Some(point);
    }
    geometry.cell_at(leaves(layout.goal)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A window over a memory drawn as text ('#' stands, '.' was seen, ' ' was not), one metre a cell, the first row north.
    fn drawn(rows: &[&str], at: (usize, usize), goal: (usize, usize), closed_m: f64) -> (Memory, RouteWindow) {
        let mut memory = Memory::new(1.0, 100);
        for (row, line) in rows.iter().enumerate() {
            for (column, byte) in line.bytes().enumerate() {
                let seen = match byte {
                    b'#' => Seen::Occupied,
                    b'.' => Seen::Free,
                    _ => continue,
                };
                memory.set((row as i64, column as i64), seen);
            }
        }
        let place = |(row, column): (usize, usize)| Position::new(column as f64 + 0.5, -(row as f64) - 0.5);
        let layout = Layout {
            cells: 64,
            closed_m,
            unknown_cost: 1.5,
            arrival_m: 0.5,
            goal: place(goal),
            global: &[],
        };
        let window = RouteWindow::new(&memory, place(at), &layout, None).unwrap();
        (memory, window)
    }

    const POCKET: [&str; 7] = [
        "...........",
        "..#######..",
        "........#..",
        "........#..",
        "........#..",
        "..#######..",
        "...........",
    ];

    #[test]
    fn the_way_leads_out_of_a_pocket() {
        let (_, mut window) = drawn(&POCKET, (3, 6), (3, 10), 0.5);
        window.repair(Position::new(6.5, -3.5));
        assert_eq!(window.standing, Standing::Found);
        assert!(window.goal_inside);
        // Out to the west, around and back: longer than 4 m by far.
        assert!(window.length_m() > 14.0, "{}", window.length_m());
        assert!(window.way.iter().all(|&point| window.is_open(point)));
    }

    #[test]
    fn a_changed_cell_changes_the_way_as_a_new_window_would() {
        let (mut memory, mut window) = drawn(&POCKET, (3, 6), (3, 10), 0.5);
        let at = Position::new(6.5, -3.5);
        window.repair(at);
        let around = window.length_m();
        memory.set((3, 8), Seen::Free);
        window.set((3, 8), Seen::Free);
        assert!(window.repair(at).is_some());
        assert!(window.length_m() < 5.0 && around > 14.0);
        window.set((3, 8), Seen::Occupied);
        window.repair(at);
        approx::assert_relative_eq!(window.length_m(), around, epsilon = 1e-9);
    }

    #[test]
    fn what_is_closed_for_a_wide_robot_is_open_for_a_narrow_one() {
        let gap = ["....#....", "....#....", ".........", "....#....", "....#...."];
        let length = |closed_m| {
            let (_, mut window) = drawn(&gap, (2, 1), (2, 7), closed_m);
            window.repair(Position::new(1.5, -2.5));
            window.length_m()
        };
        assert!(length(0.6) < 6.5);
        assert!(length(1.2) > 8.0);
    }

    #[test]
    fn over_open_ground_it_heads_straight_for_the_goal_and_through_no_wall() {
        const OPEN: [&str; 1] = ["."; 1];
        let at = Position::new(0.5, -0.5);
        let off = |window: &RouteWindow, goal: Position, sight_m: f64| {
            let to = window.ahead(at, 4.0, sight_m).unwrap();
            assert!(at.distance_m(to) <= 4.0 + 1e-9);
            ((to.y_m - at.y_m).atan2(to.x_m - at.x_m) - (goal.y_m - at.y_m).atan2(goal.x_m - at.x_m)).abs()
        };
        for (row, column) in [(0, 20), (5, 20), (9, 20), (20, 12)] {
            let (_, mut window) = drawn(&OPEN, (0, 0), (row, column), 0.5);
            window.repair(at);
            let goal = Position::new(column as f64 + 0.5, -(row as f64) - 0.5);
            assert!(off(&window, goal, f64::INFINITY) < 0.01, "{row} {column}");
        }
        // Steps to eight sides lead elsewhere first.
        let (_, mut window) = drawn(&OPEN, (0, 0), (9, 20), 0.5);
        window.repair(at);
        assert!(off(&window, Position::new(20.5, -9.5), 4.0) > 0.2);
        // Around the end of a wall no line is taken that crosses it.
        let wall = [
            "..........",
            "..........",
            "#########.",
            "..........",
            "..........",
            "..........",
            "..........",
        ];
        let (_, mut window) = drawn(&wall, (0, 0), (6, 0), 0.5);
        window.repair(at);
        let to = window.ahead(at, 4.0, f64::INFINITY).unwrap();
        assert!(window.sees(at, to), "{to:?}");
    }

    #[test]
    fn closed_goals_and_robots_are_told() {
        let box_of = ["#####", "#...#", "#...#", "#...#", "#####"];
        let (_, mut window) = drawn(&box_of, (2, 2), (2, 8), 0.5);
        window.repair(Position::new(2.5, -2.5));
        assert_eq!(window.standing, Standing::Enclosed);
        let (_, mut window) = drawn(&box_of, (2, 8), (2, 0), 0.5);
        window.repair(Position::new(8.5, -2.5));
        assert_eq!(window.standing, Standing::GoalBlocked);
    }

    #[test]
    fn a_goal_outside_is_replaced_by_the_border_towards_it() {
        let (_, mut window) = drawn(&["."], (0, 0), (0, 400), 0.5);
        assert!(!window.goal_inside);
        window.repair(Position::new(0.5, -0.5));
        let last = *window.way.last().unwrap();
        assert!(last.x_m > 25.0 && (last.y_m + 0.5).abs() < 1.5, "{last:?}");
    }
}
