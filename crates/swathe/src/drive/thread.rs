//! Ways for the footprint itself, where the circle around it finds none or leads into trouble.
//!
//! A search of poses on what was met, place by place rather than cell by cell: A* with a weighted bound over places and headings
//! as in Hybrid A* (Dolgov, Thrun, Montemerlo and Diebel, "Path planning for autonomous vehicles in unknown semi-structured
//! environments", International Journal of Robotics Research 29, 2010). A vehicle that turns in place goes along sixteen
//! directions and turns between them; one with a turning circle drives arcs and straights, forwards and backwards. The bound is
//! the way of a disc that fits into the footprint. The search goes on from step to step while the robot stands.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};
use std::f64::consts::{PI, TAU};

use crate::grid::Position;
use crate::local::CertaintyGrid;
use crate::sensor::{Pose, wrap};

use super::memory::{Memory, Seen};
use super::params::Shape;

/// The parts of cells in which something was met, by cell of the certainty grid's lattice.
pub(super) type Met = HashMap<(i64, i64), u64>;

/// Distance kept from what was met, in metres: what is left of the 0.1 m that a passable gap has on each side is for steering.
const MARGIN_M: f64 = 0.06;

/// States that a search looks at in one step of the navigator, and in all.
const WORK_PER_STEP: usize = 1500;
const MOST_STATES: [usize; 2] = [150_000, 300_000];

/// Weight of the bound.
const WEIGHT: f64 = 1.5;

/// Backing costs as much as this many times the way forward, turning back as much as this many radii of the footprint.
const BACK_FACTOR: f64 = 1.5;
const CUSP_RADII: f64 = 0.5;

/// Within this many metres of the circle around the footprint ground costs more.
const NEAR_M: f64 = 0.15;
const NEAR_FACTOR: f64 = 1.4;

/// Cells that a search looks at beyond robot and goal, and at most along a side.
const AROUND_CELLS: i64 = 128;
const MOST_CELLS: i64 = 640;

/// Headings that a vehicle with a turning circle tells apart, and how much wider than its least circle it plans.
const HEADINGS: f64 = 64.0;
const WIDER: f64 = 1.05;

/// Steps (east, north) of the sixteen directions, counter-clockwise.
const AXES: [(i32, i32); 16] = [
    (1, 0),
    (2, 1),
    (1, 1),
    (1, 2),
    (0, 1),
    (-1, 2),
    (-1, 1),
    (-2, 1),
    (-1, 0),
    (-2, -1),
    (-1, -1),
    (-1, -2),
    (0, -1),
    (1, -2),
    (1, -1),
    (2, -1),
];

fn axis_rad(axis: usize) -> f64 {
    let (east, north) = AXES[axis % 16];
    f64::from(north).atan2(f64::from(east))
}

/// What is known: where things were met, what was seen, and the grid whose cells these are.
pub(super) type Known<'a> = (&'a Met, &'a Memory, &'a CertaintyGrid);

/// A part of a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Leg {
    /// Turn in place to a heading.
    Turn { to_rad: f64 },
    /// Drive an arc; backwards with a negative length.
    Run {
        from: (f64, f64, f64),
        curvature_per_m: f64,
        length_m: f64,
    },
}

/// How a search stands.
pub(super) enum Threading {
    On,
    Found(Vec<Leg>),
    Nothing,
}

/// What was met around robot and goal.
struct Field {
    size_m: f64,
    first: (i64, i64),
    rows: i64,
    columns: i64,
    /// Which points lie in each cell: the first, and how many.
    slots: Vec<(u32, u32)>,
    /// East, north, and how near it may come to the footprint.
    points: Vec<(f64, f64, f64)>,
    /// From the centre of every cell to what was met nearest, as far as it matters.
    near_m: Vec<f32>,
    known: Vec<bool>,
    /// Metres to the goal for a disc that fits into the footprint.
    to_go_m: Vec<f32>,
    half_length_m: f64,
    half_width_m: f64,
    radius_m: f64,
}

impl std::fmt::Debug for Field {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.debug_struct("Field")
            .field("points", &self.points.len())
            .finish_non_exhaustive()
    }
}

impl Field {
    fn lay((met, memory, grid): Known, shape: &Shape, pose: &Pose, goal: Position, closes: f64) -> Self {
        let size_m = grid.params().cell_size_m;
        let cell = |x_m: f64, y_m: f64| ((-y_m / size_m).floor() as i64, (x_m / size_m).floor() as i64);
        let (here, there) = (cell(pose.x_m, pose.y_m), cell(goal.x_m, goal.y_m));
        let range = |a: i64, b: i64| {
            let (low, high) = (a.min(b) - AROUND_CELLS, a.max(b) + AROUND_CELLS);
            (low, (high - low + 1).clamp(1, MOST_CELLS))
        };
        let ((first_row, rows), (first_column, columns)) = (range(here.0, there.0), range(here.1, there.1));
        let count = (rows * columns) as usize;
        let reach_m = shape.radius_m + MARGIN_M + NEAR_M + size_m;
        let mut field = Self {
            size_m,
            first: (first_row, first_column),
            rows,
            columns,
            slots: vec![(0, 0); count],
            points: Vec::new(),
            near_m: vec![reach_m as f32; count],
            known: vec![false; count],
            to_go_m: Vec::new(),
            half_length_m: shape.half_length_m,
            half_width_m: shape.half_width_m,
            radius_m: shape.radius_m,
        };
        let (sin, cos) = pose.heading_rad.sin_cos();
        let reach = (reach_m / size_m).ceil() as i64;
        for (&cell, &parts) in met {
            let Some(index) = field.index(cell) else { continue };
            let first = field.points.len() as u32;
            field.slots[index] = (first, parts.count_ones());
            for (x_m, y_m) in grid.places_of(cell, parts) {
                let (dx, dy) = (x_m - pose.x_m, y_m - pose.y_m);
                let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
                let beyond_m = (ahead.abs() - shape.half_length_m).max(left.abs() - shape.half_width_m);
                // What is nearer already may stay as near.
                field.points.push((x_m, y_m, closes.min(beyond_m - 0.01).max(-0.05)));
            }
            let places = field.points[first as usize..].to_vec();
            for row in cell.0 - reach..=cell.0 + reach {
                for column in cell.1 - reach..=cell.1 + reach {
                    if let Some(around) = field.index((row, column)) {
                        let (east_m, north_m) = ((column as f64 + 0.5) * size_m, -(row as f64 + 0.5) * size_m);
                        let near_m = &mut field.near_m[around];
                        for &(x_m, y_m, _) in &places {
                            *near_m = near_m.min((east_m - x_m).hypot(north_m - y_m) as f32);
                        }
                    }
                }
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let (x_m, y_m) = (
                    ((first_column + column) as f64 + 0.5) * size_m,
                    -((first_row + row) as f64 + 0.5) * size_m,
                );
                field.known[(row * columns + column) as usize] = memory.get(memory.cell_of(x_m, y_m)) != Seen::Unknown;
            }
        }
        field.to_go_m = field.distances(there, closes);
        field
    }

    fn cell(&self, x_m: f64, y_m: f64) -> (i64, i64) {
        ((-y_m / self.size_m).floor() as i64, (x_m / self.size_m).floor() as i64)
    }

    fn index(&self, (row, column): (i64, i64)) -> Option<usize> {
        let (row, column) = (row - self.first.0, column - self.first.1);
        let inside = (0..self.rows).contains(&row) && (0..self.columns).contains(&column);
        inside.then_some((row * self.columns + column) as usize)
    }

    fn at(&self, x_m: f64, y_m: f64) -> Option<usize> {
        self.index(self.cell(x_m, y_m))
    }

    /// Dijkstra from the goal.
    fn distances(&self, goal: (i64, i64), closes: f64) -> Vec<f32> {
        const WAYS: [(i64, i64, u32); 8] = [
            (0, 1, 1000),
            (1, 0, 1000),
            (0, -1, 1000),
            (-1, 0, 1000),
            (1, 1, 1414),
            (1, -1, 1414),
            (-1, 1, 1414),
            (-1, -1, 1414),
        ];
        let slim_m = self.half_length_m.min(self.half_width_m) + closes.min(0.0) - 0.5 * self.size_m;
        let mut least = vec![u32::MAX; self.known.len()];
        let mut queue = BinaryHeap::new();
        if let Some(index) = self.index(goal) {
            least[index] = 0;
            queue.push(std::cmp::Reverse((0_u32, index as u32)));
        }
        while let Some(std::cmp::Reverse((cost, index))) = queue.pop() {
            let index = index as usize;
            if cost > least[index] {
                continue;
            }
            let (row, column) = (index as i64 / self.columns, index as i64 % self.columns);
            for (down, right, length) in WAYS {
                let Some(next) = self.index((row + down + self.first.0, column + right + self.first.1)) else {
                    continue;
                };
                let further = cost + if self.known[next] { length } else { length * 3 / 2 };
                if f64::from(self.near_m[next]) > slim_m && further < least[next] {
                    least[next] = further;
                    queue.push(std::cmp::Reverse((further, next as u32)));
                }
            }
        }
        let metres = |&cost: &u32| {
            if cost == u32::MAX {
                f32::INFINITY
            } else {
                (f64::from(cost) * self.size_m / 1000.0) as f32
            }
        };
        least.iter().map(metres).collect()
    }

    /// Whether the footprint may stand at a pose.
    fn is_free(&self, (x_m, y_m, heading_rad): (f64, f64, f64)) -> bool {
        let cell = self.cell(x_m, y_m);
        let Some(index) = self.index(cell) else { return false };
        let near_m = f64::from(self.near_m[index]);
        let off_m = 0.71 * self.size_m;
        if near_m - off_m > self.radius_m + MARGIN_M {
            return true;
        }
        let reach = ((self.radius_m + MARGIN_M) / self.size_m).ceil() as i64;
        let (sin, cos) = heading_rad.sin_cos();
        for row in cell.0 - reach..=cell.0 + reach {
            for column in cell.1 - reach..=cell.1 + reach {
                let Some(index) = self.index((row, column)) else {
                    continue;
                };
                let (first, count) = self.slots[index];
                for &(px, py, margin_m) in &self.points[first as usize..(first + count) as usize] {
                    let (dx, dy) = (px - x_m, py - y_m);
                    let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
                    if (ahead.abs() - self.half_length_m).max(left.abs() - self.half_width_m) < margin_m {
                        return false;
                    }
                }
            }
        }
        true
    }
}

#[derive(Clone, Copy, Debug)]
struct Node {
    at: (f64, f64, f64),
    cost_m: f64,
    from: u32,
    leg: Leg,
    backs: bool,
}

#[derive(Clone, Copy, Debug)]
struct Open {
    bound_m: f64,
    node: u32,
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Open {}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound_m.total_cmp(&self.bound_m).then(other.node.cmp(&self.node))
    }
}

type Key = (i32, i32, u16);

/// A search of poses that goes on from step to step.
#[derive(Debug)]
pub(super) struct Search {
    field: Field,
    start: (f64, f64, f64),
    goal: Position,
    near_goal_m: f64,
    most_states: usize,
    turn_radius_m: f64,
    nodes: Vec<Node>,
    best: HashMap<Key, f64>,
    open: BinaryHeap<Open>,
}

impl Search {
    /// A search from a pose to within some metres of a goal. The free room on each side is less than usual with `tight`.
    pub fn new(known: Known, shape: &Shape, pose: &Pose, (goal, near_goal_m): (Position, f64), tight: bool) -> Self {
        let size_m = known.2.params().cell_size_m;
        let away_m = Position::new(pose.x_m, pose.y_m).distance_m(goal);
        let most_m = (MOST_CELLS - 2 * AROUND_CELLS) as f64 * size_m;
        let goal = if away_m > most_m {
            Position::new(pose.x_m, pose.y_m).towards(goal, most_m / away_m)
        } else {
            goal
        };
        let closes = if tight { 0.5 * MARGIN_M } else { MARGIN_M };
        let field = Field::lay(known, shape, pose, goal, closes);
        let start = (pose.x_m, pose.y_m, pose.heading_rad);
        let mut search = Self {
            field,
            start,
            goal,
            near_goal_m,
            most_states: MOST_STATES[usize::from(tight)],
            turn_radius_m: shape.turn_radius_m,
            nodes: Vec::new(),
            best: HashMap::new(),
            open: BinaryHeap::new(),
        };
        let leg = Leg::Turn {
            to_rad: pose.heading_rad,
        };
        search.reach(start, 0.0, u32::MAX, leg, false);
        search
    }

    fn key(&self, (x_m, y_m, heading_rad): (f64, f64, f64)) -> Key {
        let along = |from: f64, to: f64| ((to - from) / self.field.size_m).round() as i32;
        let sectors = if self.turn_radius_m > 0.0 { HEADINGS } else { 96.0 };
        let sector = (heading_rad.rem_euclid(TAU) / TAU * sectors).round() as u16 % sectors as u16;
        (along(self.start.0, x_m), along(self.start.1, y_m), sector)
    }

    fn reach(&mut self, at: (f64, f64, f64), cost_m: f64, from: u32, leg: Leg, backs: bool) {
        let Some(index) = self.field.at(at.0, at.1) else { return };
        let to_go_m = f64::from(self.field.to_go_m[index]);
        if !to_go_m.is_finite() {
            return;
        }
        let key = self.key(at);
        if self.best.get(&key).is_some_and(|&best_m| best_m <= cost_m + 1e-9) {
            return;
        }
        self.best.insert(key, cost_m);
        self.open.push(Open {
            bound_m: cost_m + WEIGHT * to_go_m,
            node: self.nodes.len() as u32,
        });
        self.nodes.push(Node {
            at,
            cost_m,
            from,
            leg,
            backs,
        });
    }

    /// Goes on.
    pub fn go_on(&mut self) -> Threading {
        for _ in 0..WORK_PER_STEP {
            let Some(Open { node, .. }) = self.open.pop() else {
                return Threading::Nothing;
            };
            let now = self.nodes[node as usize];
            if self
                .best
                .get(&self.key(now.at))
                .is_some_and(|&best_m| best_m < now.cost_m - 1e-9)
            {
                continue;
            }
            if Position::new(now.at.0, now.at.1).distance_m(self.goal) <= self.near_goal_m {
                return Threading::Found(self.legs(node));
            }
            if self.nodes.len() > self.most_states {
                return Threading::Nothing;
            }
            if self.turn_radius_m > 0.0 {
                self.drive_from(node, &now);
            } else {
                self.walk_from(node, &now);
            }
        }
        Threading::On
    }

    /// Cost of a metre at a place.
    fn factor(&self, at: (f64, f64, f64), backs: bool) -> f64 {
        let Some(index) = self.field.at(at.0, at.1) else {
            return 1.0;
        };
        let near = f64::from(self.field.near_m[index]) < self.field.radius_m + NEAR_M;
        (if near { NEAR_FACTOR } else { 1.0 })
            * if backs { BACK_FACTOR } else { 1.0 }
            * if self.field.known[index] { 1.0 } else { 1.5 }
    }

    /// Whether what is behind at a pose was seen.
    fn sees_behind(&self, (x_m, y_m, heading_rad): (f64, f64, f64)) -> bool {
        let back_m = self.field.half_length_m;
        self.field
            .at(x_m - back_m * heading_rad.cos(), y_m - back_m * heading_rad.sin())
            .is_some_and(|index| self.field.known[index])
    }

    fn walk_from(&mut self, node: u32, now: &Node) {
        let size_m = self.field.size_m;
        let (x_m, y_m, heading_rad) = now.at;
        let axis = (0..16).find(|&axis| wrap(axis_rad(axis) - heading_rad).abs() < 1e-6);
        if let Some(axis) = axis {
            let (east, north) = (f64::from(AXES[axis].0) * size_m, f64::from(AXES[axis].1) * size_m);
            let length_m = east.hypot(north);
            for side in [1.0, -1.0] {
                let to = (x_m + side * east, y_m + side * north, heading_rad);
                let backs = side < 0.0;
                let middle = (x_m + side * east / 2.0, y_m + side * north / 2.0, heading_rad);
                if !self.field.is_free(to) || !self.field.is_free(middle) || (backs && !self.sees_behind(to)) {
                    continue;
                }
                let turns_back = if now.from != u32::MAX && matches!(now.leg, Leg::Run { .. }) && backs != now.backs {
                    CUSP_RADII * self.field.radius_m
                } else {
                    0.0
                };
                let leg = Leg::Run {
                    from: now.at,
                    curvature_per_m: 0.0,
                    length_m: side * length_m,
                };
                let cost_m = now.cost_m + length_m * self.factor(to, backs) + turns_back;
                self.reach(to, cost_m, node, leg, backs);
            }
        }
        // From a heading of its own, the robot turns to the axes beside it.
        let turns: Vec<f64> = match axis {
            Some(axis) => vec![axis_rad(axis + 1), axis_rad(axis + 15)],
            None => (0..16)
                .map(axis_rad)
                .filter(|&to_rad| wrap(to_rad - heading_rad).abs() < 0.5)
                .collect(),
        };
        for to_rad in turns {
            let by_rad = wrap(to_rad - heading_rad);
            let is_free = (1..=4).all(|k| {
                let part_rad = heading_rad + by_rad * f64::from(k) / 4.0;
                self.field.is_free((x_m, y_m, part_rad))
            });
            if is_free {
                let cost_m = now.cost_m + by_rad.abs() * 0.5 * self.field.radius_m + 0.02;
                self.reach((x_m, y_m, to_rad), cost_m, node, Leg::Turn { to_rad }, now.backs);
            }
        }
    }

    fn drive_from(&mut self, node: u32, now: &Node) {
        let tightest = 1.0 / (WIDER * self.turn_radius_m);
        // So long that an arc leads into another heading.
        let length_m = (1.5 * self.field.size_m).max(1.1 * TAU / HEADINGS / tightest);
        let steps = (length_m / self.field.size_m).ceil().max(2.0) as usize;
        for side in [1.0, -1.0] {
            let backs = side < 0.0;
            for curvature_per_m in [0.0, tightest, -tightest, 0.5 * tightest, -0.5 * tightest] {
                let poses: Vec<(f64, f64, f64)> = (1..=steps)
                    .map(|k| after(now.at, curvature_per_m, side * length_m * k as f64 / steps as f64))
                    .collect();
                if !poses.iter().all(|&pose| self.field.is_free(pose)) {
                    continue;
                }
                let to = poses[steps - 1];
                if backs && !self.sees_behind(to) {
                    continue;
                }
                let leg = Leg::Run {
                    from: now.at,
                    curvature_per_m,
                    length_m: side * length_m,
                };
                let turns_back = if now.from != u32::MAX && backs != now.backs {
                    2.0 * CUSP_RADII * self.field.radius_m
                } else {
                    0.0
                };
                let cost_m = now.cost_m + length_m * self.factor(to, backs) + turns_back;
                self.reach(to, cost_m, node, leg, backs);
            }
        }
    }

    /// The legs to a node, those that go on alike put together.
    fn legs(&self, mut node: u32) -> Vec<Leg> {
        let mut all = Vec::new();
        while let Some(now) = self.nodes.get(node as usize)
            && now.from != u32::MAX
        {
            all.push(now.leg);
            node = now.from;
        }
        let mut legs: Vec<Leg> = Vec::new();
        for leg in all.into_iter().rev() {
            match (legs.last_mut(), leg) {
                (Some(Leg::Turn { to_rad }), Leg::Turn { to_rad: further }) => *to_rad = further,
                (
                    Some(Leg::Run {
                        curvature_per_m: before,
                        length_m: sofar_m,
                        ..
                    }),
                    Leg::Run {
                        curvature_per_m,
                        length_m,
                        ..
                    },
                ) if (*before - curvature_per_m).abs() < 1e-12 && *sofar_m * length_m > 0.0 => *sofar_m += length_m,
                _ => legs.push(leg),
            }
        }
        legs
    }
}

/// The pose after some metres of an arc, negative ones backwards.
pub(super) fn after((x_m, y_m, heading_rad): (f64, f64, f64), curvature_per_m: f64, way_m: f64) -> (f64, f64, f64) {
    let (ahead, left, turn) = super::safety::along(curvature_per_m, way_m);
    let (sin, cos) = heading_rad.sin_cos();
    (
        x_m + cos * ahead - sin * left,
        y_m + sin * ahead + cos * left,
        wrap(heading_rad + turn),
    )
}

/// Where a robot is on an arc: metres along it in the direction of travel, metres to its left and how far its heading is off.
pub(super) fn on_run(pose: &Pose, from: (f64, f64, f64), curvature_per_m: f64, backs: bool) -> (f64, f64, f64) {
    let (dx, dy) = (pose.x_m - from.0, pose.y_m - from.1);
    let (sin, cos) = from.2.sin_cos();
    let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
    let (way_m, left_m) = if curvature_per_m.abs() < 1e-9 {
        (ahead, left)
    } else {
        let radius_m = 1.0 / curvature_per_m;
        let side = radius_m.signum();
        // Around the circle's middle, which lies at (0, radius).
        let angle = (side * ahead).atan2(side * (radius_m - left));
        let angle = if backs && side * angle > PI / 2.0 {
            angle - side * TAU
        } else {
            angle
        };
        let angle = if !backs && side * angle < -PI / 2.0 {
            angle + side * TAU
        } else {
            angle
        };
        (angle * radius_m, side * (radius_m.abs() - ahead.hypot(radius_m - left)))
    };
    let heading_rad = from.2 + curvature_per_m * way_m;
    let along_m = if backs { -way_m } else { way_m };
    (along_m, left_m, wrap(heading_rad - pose.heading_rad))
}
