//! What was met around robot and goal, on a lattice through the robot's place.

use crate::grid::Position;
use crate::local::CertaintyGrid;
use crate::sensor::Pose;

use super::super::memory::{Memory, Seen};
use super::super::params::Shape;
use super::super::safety::was_seen;
use super::Known;
use super::frame::Frame;

/// Distance kept from what was met, in metres: what is left of the 0.1 m that a passable gap has on each side is for steering.
pub(super) const MARGIN_M: f64 = 0.06;

/// How much nearer than now what is near may come, and how near at most: no nearer than the drive lets it, or the first step of a
/// way could not be driven.
const SWING_M: f64 = 0.035;
const LEAST_M: f64 = 0.032;

/// Within this many metres of the circle around the footprint ground costs more.
const NEAR_M: f64 = 0.15;

/// Within this many radii of the footprint the certainty grid tells what was seen, farther away the memory, whose cells are larger.
const FINELY_RADII: f64 = 4.0;

/// Discs that cover a footprint.
const COVERS: usize = 4;

/// Most cells along a side.
pub(super) const MOST_CELLS: i64 = 1200;

/// Tenths of a cell from one cell to the next, straight and across, and how much longer ground is that was never seen.
const STRAIGHT: u32 = 10;
const ACROSS: u32 = 14;
const UNSEEN: (u32, u32) = (3, 2);

/// No way from a cell to the goal.
const NONE: u32 = u32::MAX;

/// Steps of laying a field, each in portions.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// How near things are, by occupied cell.
    Nearness(usize),
    /// How far it is to the goal, by that distance.
    Distances(u32),
    Done,
}

/// What was met around robot and goal, in a frame of its own.
pub(super) struct Field {
    pub frame: Frame,
    pub size_m: f64,
    /// Place of the first cell's middle, north-west.
    origin: (f64, f64),
    pub rows: i64,
    pub columns: i64,
    /// Where the points of each cell begin; one more at the end.
    slots: Vec<u32>,
    /// East, north, and how near it may come to the footprint.
    points: Vec<(f64, f64, f64)>,
    /// From the middle of every cell to what was met nearest, as far as it matters; nearer by what it may come nearer.
    near_m: Vec<f32>,
    known: Vec<bool>,
    /// To the goal for a disc that fits into the footprint, in tenths of a cell.
    to_go: Vec<u32>,
    /// Cells by their distance, modulo the number of these.
    buckets: Vec<Vec<u32>>,
    stage: Stage,
    reach: i64,
    closes_m: f64,
    /// How much nearer the bound may come than a footprint: as much as a place may be off the middle of its cell.
    loose_m: f64,
    pub half_length_m: f64,
    pub half_width_m: f64,
    pub radius_m: f64,
    /// Middles along the footprint, by metres ahead, of discs that cover it together with what it keeps from things, and of discs
    /// within it; the radius of the former, the latter have half its width.
    covers: [f64; COVERS],
    cover_m: f64,
    /// How far from its middle nothing is near to a footprint in any heading.
    clear_m: f64,
    within: [f64; 3],
}

impl std::fmt::Debug for Field {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.debug_struct("Field")
            .field("points", &self.points.len())
            .finish_non_exhaustive()
    }
}

impl Field {
    /// A field from a pose to within some metres of a goal, still to be laid.
    pub fn new(
        (met, memory, grid): Known,
        shape: &Shape,
        pose: &Pose,
        (goal, near_goal_m): (Position, f64),
        (closes_m, around_cells): (f64, i64),
        frame: Frame,
    ) -> Self {
        let size_m = grid.params().cell_size_m;
        let pose = &frame.pose(pose);
        let goal = frame.inside((goal.x_m, goal.y_m));
        let goal = Position::new(goal.0, goal.1);
        let offset = |to: Position| {
            let (right, down) = ((to.x_m - pose.x_m) / size_m, (pose.y_m - to.y_m) / size_m);
            (down.round() as i64, right.round() as i64)
        };
        let range = |to: i64| {
            let (low, high) = (to.min(0) - around_cells, to.max(0) + around_cells);
            (low, (high - low + 1).clamp(1, MOST_CELLS))
        };
        let there = offset(goal);
        let ((first_row, rows), (first_column, columns)) = (range(there.0), range(there.1));
        let origin = (
            pose.x_m + first_column as f64 * size_m,
            pose.y_m - first_row as f64 * size_m,
        );
        let count = (rows * columns) as usize;
        let reach_m = shape.radius_m + MARGIN_M + NEAR_M + size_m;
        let mut field = Self {
            frame,
            size_m,
            origin,
            rows,
            columns,
            slots: vec![0; count + 1],
            points: Vec::new(),
            near_m: vec![reach_m as f32; count],
            known: vec![false; count],
            to_go: vec![NONE; count],
            buckets: vec![Vec::new(); 32],
            stage: Stage::Nearness(0),
            reach: (reach_m / size_m).ceil() as i64,
            closes_m,
            loose_m: if shape.turns_in_place() { 0.0 } else { 0.5 * size_m },
            half_length_m: shape.half_length_m,
            half_width_m: shape.half_width_m,
            radius_m: shape.radius_m,
            covers: std::array::from_fn(|k| {
                let share = (2 * k + 1) as f64 / COVERS as f64 - 1.0;
                share * shape.half_length_m
            }),
            cover_m: (shape.half_length_m / COVERS as f64 + closes_m).hypot(shape.half_width_m + closes_m),
            clear_m: (shape.half_length_m + closes_m).hypot(shape.half_width_m + closes_m),
            within: [-1.0, 0.0, 1.0].map(|side| side * (shape.half_length_m - shape.half_width_m).max(0.0)),
        };
        field.place(met, grid, pose);
        field.note_known(memory, grid, pose);
        let near = (near_goal_m / size_m).ceil() as i64 + 1;
        let there = (there.0 - first_row, there.1 - first_column);
        for row in there.0 - near..=there.0 + near {
            for column in there.1 - near..=there.1 + near {
                let Some(index) = field.index((row, column)) else {
                    continue;
                };
                let (x_m, y_m) = field.middle((row, column));
                if goal.distance_m(Position::new(x_m, y_m)) <= near_goal_m {
                    field.to_go[index] = 0;
                }
            }
        }
        field
    }

    /// Notes what was seen; around the robot as the drive itself will see it, which is driven next.
    fn note_known(&mut self, memory: &Memory, grid: &CertaintyGrid, pose: &Pose) {
        let corners = [(0, 0), (0, self.columns), (self.rows, 0), (self.rows, self.columns)].map(|corner| {
            let (x_m, y_m) = self.frame.outside(self.middle(corner));
            memory.cell_of(x_m, y_m)
        });
        let first_row = corners.iter().map(|corner| corner.0).min().unwrap_or(0);
        let first_column = corners.iter().map(|corner| corner.1).min().unwrap_or(0);
        let wide = |corner: &(i64, i64)| (corner.0 - first_row).max(corner.1 - first_column);
        let side = corners.iter().map(wide).max().unwrap_or(0) as usize + 2;
        let mut seen = Vec::new();
        memory.copy_square((first_row, first_column), side, &mut seen);
        let finely_m = FINELY_RADII * self.radius_m;
        for row in 0..self.rows {
            for column in 0..self.columns {
                let (x_m, y_m) = self.middle((row, column));
                let is_here = (x_m - pose.x_m).abs().max((y_m - pose.y_m).abs()) < finely_m;
                let (x_m, y_m) = self.frame.outside((x_m, y_m));
                let (down, right) = memory.cell_of(x_m, y_m);
                let place = (down - first_row) as usize * side + (right - first_column) as usize;
                self.known[(row * self.columns + column) as usize] =
                    seen[place] != Seen::Unknown && (!is_here || was_seen(grid, x_m, y_m));
            }
        }
    }

    /// Sorts what was met into the cells.
    fn place(&mut self, met: &super::Met, grid: &CertaintyGrid, pose: &Pose) {
        let (sin, cos) = pose.heading_rad.sin_cos();
        let mut placed: Vec<(u32, (f64, f64, f64))> = Vec::new();
        for (&cell, &parts) in met {
            for place in grid.places_of(cell, parts) {
                let (x_m, y_m) = self.frame.inside(place);
                let Some(index) = self.at(x_m, y_m) else { continue };
                let (dx, dy) = (x_m - pose.x_m, y_m - pose.y_m);
                let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
                let beyond_m = (ahead.abs() - self.half_length_m).max(left.abs() - self.half_width_m);
                // What is near already may come a little nearer, as corners do in the first turn.
                let least_m = LEAST_M.min(beyond_m - 0.005);
                let margin_m = self.closes_m.min((beyond_m - SWING_M).max(least_m)).max(-0.05);
                placed.push((index as u32, (x_m, y_m, margin_m)));
            }
        }
        // The order of the map is another one in every run.
        placed.sort_by(|one, other| {
            let by_place = |a: &(f64, f64, f64), b: &(f64, f64, f64)| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1));
            one.0.cmp(&other.0).then_with(|| by_place(&one.1, &other.1))
        });
        for &(index, _) in &placed {
            self.slots[index as usize + 1] += 1;
        }
        for index in 1..self.slots.len() {
            self.slots[index] += self.slots[index - 1];
        }
        self.points = placed.into_iter().map(|(_, point)| point).collect();
    }

    /// Goes on laying for about so many cells; true when all is laid.
    pub fn lay_on(&mut self, work: usize) -> bool {
        match self.stage {
            Stage::Done => return true,
            Stage::Nearness(first) => {
                let end = self.spread(first, work);
                self.stage = if end < self.near_m.len() {
                    Stage::Nearness(end)
                } else {
                    self.begin_distances();
                    Stage::Distances(0)
                };
            }
            Stage::Distances(level) => {
                self.stage = self.measure(level, work).map_or(Stage::Done, Stage::Distances);
            }
        }
        self.stage == Stage::Done
    }

    /// Tells the cells around occupied ones how near these are; returns where to go on.
    fn spread(&mut self, first: usize, work: usize) -> usize {
        let mut done = 0;
        for index in first..self.near_m.len() {
            let (from, to) = (self.slots[index] as usize, self.slots[index + 1] as usize);
            done += 1;
            if from == to {
                continue;
            }
            let cell = (index as i64 / self.columns, index as i64 % self.columns);
            for row in cell.0 - self.reach..=cell.0 + self.reach {
                for column in cell.1 - self.reach..=cell.1 + self.reach {
                    let Some(around) = self.index((row, column)) else {
                        continue;
                    };
                    let (x_m, y_m) = self.middle((row, column));
                    let mut near_m = self.near_m[around];
                    for &(px, py, margin_m) in &self.points[from..to] {
                        let away_m = (px - x_m).hypot(py - y_m) + self.closes_m - margin_m;
                        near_m = near_m.min(away_m as f32);
                    }
                    self.near_m[around] = near_m;
                }
            }
            done += ((2 * self.reach + 1).pow(2) as usize * (to - from)) / 16;
            if done > work {
                return index + 1;
            }
        }
        self.near_m.len()
    }

    /// Where a disc that fits into the footprint may be.
    fn lets_disc(&self, index: usize) -> bool {
        f64::from(self.near_m[index]) + self.loose_m >= self.half_length_m.min(self.half_width_m) + self.closes_m - 1e-3
    }

    fn begin_distances(&mut self) {
        for index in 0..self.to_go.len() {
            if self.to_go[index] == 0 {
                if self.lets_disc(index) {
                    self.buckets[0].push(index as u32);
                } else {
                    self.to_go[index] = NONE;
                }
            }
        }
    }

    /// Dijkstra from the goal by whole distances (Dial, "Algorithm 360", Communications of the ACM 12, 1969); returns at which
    /// distance to go on.
    fn measure(&mut self, mut level: u32, work: usize) -> Option<u32> {
        const WAYS: [(i64, i64, u32); 8] = [
            (0, 1, STRAIGHT),
            (1, 0, STRAIGHT),
            (0, -1, STRAIGHT),
            (-1, 0, STRAIGHT),
            (1, 1, ACROSS),
            (1, -1, ACROSS),
            (-1, 1, ACROSS),
            (-1, -1, ACROSS),
        ];
        let count = self.buckets.len() as u32;
        let mut done = 0;
        let mut empty = 0;
        while empty < count {
            let mut bucket = std::mem::take(&mut self.buckets[(level % count) as usize]);
            empty = if bucket.is_empty() { empty + 1 } else { 0 };
            done += bucket.len();
            for index in bucket.drain(..) {
                let index = index as usize;
                if self.to_go[index] != level {
                    continue;
                }
                let (row, column) = (index as i64 / self.columns, index as i64 % self.columns);
                for (down, right, length) in WAYS {
                    let Some(next) = self.index((row + down, column + right)) else {
                        continue;
                    };
                    let length = if self.known[next] {
                        length
                    } else {
                        length * UNSEEN.0 / UNSEEN.1
                    };
                    let further = level + length;
                    if further < self.to_go[next] && self.lets_disc(next) {
                        self.to_go[next] = further;
                        self.buckets[(further % count) as usize].push(next as u32);
                    }
                }
            }
            self.buckets[(level % count) as usize] = bucket;
            level += 1;
            if done > work {
                return Some(level);
            }
        }
        None
    }

    /// The middle of a cell.
    pub fn middle(&self, (row, column): (i64, i64)) -> (f64, f64) {
        (
            self.origin.0 + column as f64 * self.size_m,
            self.origin.1 - row as f64 * self.size_m,
        )
    }

    /// The cell of a place, which may lie outside.
    pub fn cell(&self, x_m: f64, y_m: f64) -> (i64, i64) {
        (
            ((self.origin.1 - y_m) / self.size_m).round() as i64,
            ((x_m - self.origin.0) / self.size_m).round() as i64,
        )
    }

    pub fn index(&self, (row, column): (i64, i64)) -> Option<usize> {
        let inside = (0..self.rows).contains(&row) && (0..self.columns).contains(&column);
        inside.then_some((row * self.columns + column) as usize)
    }

    pub fn at(&self, x_m: f64, y_m: f64) -> Option<usize> {
        self.index(self.cell(x_m, y_m))
    }

    /// Whether the ways from the goal all end inside the field: what was met closes the goal in, not the robot.
    pub fn closes_goal_in(&self) -> bool {
        let reaches = |row: i64, column: i64| self.to_go[(row * self.columns + column) as usize] != NONE;
        let (last_row, last_column) = (self.rows - 1, self.columns - 1);
        let along_rows = (0..self.rows).any(|row| reaches(row, 0) || reaches(row, last_column));
        let along_columns = (0..self.columns).any(|column| reaches(0, column) || reaches(last_row, column));
        !along_rows && !along_columns
    }

    /// Whether the ground of a cell was seen.
    pub fn is_known(&self, index: usize) -> bool {
        self.known[index]
    }

    /// Metres to the goal from a cell for a disc that fits into the footprint.
    pub fn to_go_m(&self, index: usize) -> Option<f64> {
        let to_go = self.to_go[index];
        (to_go != NONE).then(|| f64::from(to_go) * self.size_m / f64::from(STRAIGHT))
    }

    /// Whether something is so near to a cell's middle that the circle around the footprint would graze it.
    pub fn is_near(&self, index: usize) -> bool {
        f64::from(self.near_m[index]) < self.radius_m + NEAR_M
    }

    /// Whether the footprint may stand around a cell's middle in any heading, or in none; `None` where that must be looked at.
    pub fn plainly(&self, index: usize) -> Option<bool> {
        let near_m = f64::from(self.near_m[index]);
        if near_m > self.clear_m {
            Some(true)
        } else if self.lets_disc(index) {
            None
        } else {
            Some(false)
        }
    }

    /// Whether the footprint may stand at a pose.
    pub fn is_free(&self, (x_m, y_m, heading_rad): (f64, f64, f64)) -> bool {
        let cell = self.cell(x_m, y_m);
        let Some(index) = self.index(cell) else { return false };
        if f64::from(self.near_m[index]) - 0.71 * self.size_m > self.clear_m {
            return true;
        }
        let (sin, cos) = heading_rad.sin_cos();
        // Discs tell most poses.
        let slack_m = 0.71 * self.size_m;
        let near_m = |ahead_m: f64| {
            self.at(x_m + cos * ahead_m, y_m + sin * ahead_m)
                .map_or(0.0, |index| f64::from(self.near_m[index]))
        };
        let least_m = self.half_width_m.min(self.half_length_m) + self.closes_m;
        if self.within.iter().any(|&ahead_m| near_m(ahead_m) + slack_m < least_m) {
            return false;
        }
        let enough_m = self.cover_m + slack_m;
        if self.covers.iter().all(|&ahead_m| near_m(ahead_m) > enough_m) {
            return true;
        }
        let reach = (self.clear_m / self.size_m).ceil() as i64;
        let columns = (cell.1 - reach).max(0)..(cell.1 + reach + 1).min(self.columns);
        for row in (cell.0 - reach).max(0)..(cell.0 + reach + 1).min(self.rows) {
            // The points of a row of cells follow each other.
            let first = self.slots[(row * self.columns + columns.start) as usize] as usize;
            let last = self.slots[(row * self.columns + columns.end) as usize] as usize;
            for &(px, py, margin_m) in &self.points[first..last] {
                let (dx, dy) = (px - x_m, py - y_m);
                let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
                if (ahead.abs() - self.half_length_m).max(left.abs() - self.half_width_m) < margin_m {
                    return false;
                }
            }
        }
        true
    }

    /// Whether what is behind at a pose was seen, as far as a cell beside its corners; there the face of a thing that is known hides
    /// what need not be seen.
    pub fn sees_behind(&self, (x_m, y_m, heading_rad): (f64, f64, f64)) -> bool {
        let (sin, cos) = heading_rad.sin_cos();
        let back_m = self.half_length_m;
        let cell = |left_m: f64| self.at(x_m - back_m * cos - left_m * sin, y_m - back_m * sin + left_m * cos);
        let is_known = |left_m: f64| cell(left_m).is_some_and(|index| self.known[index]);
        let is_open_beside = |side: f64| {
            let is_face = |index: usize| f64::from(self.near_m[index]) <= self.size_m;
            cell(side * (self.half_width_m + self.size_m))
                .is_some_and(|index| self.known[index] || (is_known(side * self.half_width_m) && is_face(index)))
        };
        is_known(0.0) && is_open_beside(-1.0) && is_open_beside(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Met;
    use super::*;
    use crate::local::CertaintyParams;
    use proptest::prelude::*;

    fn shape((half_length_m, half_width_m): (f64, f64), turn_radius_m: f64) -> Shape {
        Shape {
            half_length_m,
            half_width_m,
            radius_m: half_length_m.hypot(half_width_m),
            max_speed_mps: 2.0,
            max_turn_rate_radps: 1.0,
            turn_radius_m,
            reaction_s: 0.2,
            braking_friction: 0.6,
            braking_mps2: 1.0,
            acceleration_mps2: 1.0,
        }
    }

    #[test]
    fn behind_is_seen_only_where_a_cell_beside_the_body_is_too() {
        let mut memory = Memory::new(0.2, 100);
        for cell in (-20..20).flat_map(|row| (-20..20).map(move |column| (row, column))) {
            memory.set(cell, Seen::Free);
        }
        // The body is 0.6 m wide, a cell 0.1 m.
        for (half_seen_m, expected) in [(0.42, false), (0.52, true)] {
            let mut grid = CertaintyGrid::new(CertaintyParams::default(), 0.0, 0.0);
            grid.stand_on(&Pose::default(), 1.5, half_seen_m);
            let (start, goal) = (Pose::default(), Position::new(1.0, 0.0));
            let frame = Frame::of(&Pose::default());
            let room = (MARGIN_M, 30);
            let field = Field::new(
                (&Met::new(), &memory, &grid),
                &shape((0.5, 0.3), 0.0),
                &start,
                (goal, 0.3),
                room,
                frame,
            );
            assert_eq!(field.sees_behind((-0.5, 0.0, 0.0)), expected, "{half_seen_m}");
            // No ground behind was seen there at all.
            assert!(!field.sees_behind((-1.4, 0.0, 0.0)));
        }
    }

    #[test]
    fn behind_the_face_of_a_thing_beside_need_not_be_seen() {
        let mut memory = Memory::new(0.2, 100);
        for cell in (-20..20).flat_map(|row| (-20..20).map(move |column| (row, column))) {
            memory.set(cell, Seen::Free);
        }
        let sees = |has_face: bool, half_seen_m: f64| {
            let mut grid = CertaintyGrid::new(CertaintyParams::default(), 0.0, 0.0);
            grid.stand_on(&Pose::default(), 1.5, half_seen_m);
            // Along both sides as far back as 1.2 m, known from before: the grid saw no more than the body's own way.
            let met: Met = (-12..=12)
                .flat_map(|k| [(0.1 * f64::from(k), 0.46), (0.1 * f64::from(k), -0.46)])
                .filter(|_| has_face)
                .map(|(x_m, y_m)| (grid.cell_of(x_m, y_m), u64::MAX))
                .collect();
            let (start, goal) = (Pose::default(), Position::new(1.0, 0.0));
            let mut field = Field::new(
                (&met, &memory, &grid),
                &shape((0.5, 0.3), 0.0),
                &start,
                (goal, 0.3),
                (MARGIN_M, 30),
                Frame::of(&Pose::default()),
            );
            while !field.lay_on(1000) {}
            [-0.5, -0.9].map(|x_m| field.sees_behind((x_m, 0.0, 0.0)))
        };
        assert_eq!(sees(false, 0.42), [false, false]);
        assert_eq!(sees(true, 0.42), [true, false]);
        assert_eq!(sees(true, 0.2), [false, false]);
    }

    proptest! {
        #[test]
        fn discs_tell_what_the_points_do(
            cells in prop::collection::vec((-30..30_i64, -30..30_i64, 0..64_u32), 1..30),
            poses in prop::collection::vec((-2.5..2.5_f64, -2.5..2.5_f64, -3.1..3.1_f64), 40),
            (half_length_m, half_width_m) in (0.2..1.2_f64, 0.2..0.6_f64), turn_radius_m in prop::sample::select(vec![0.0, 2.0]),
        ) {
            let shape = shape((half_length_m, half_width_m), turn_radius_m);
            let grid = CertaintyGrid::new(CertaintyParams::default(), 0.0, 0.0);
            let memory = Memory::new(0.2, 100);
            let mut met = Met::new();
            for (row, column, part) in cells {
                *met.entry((row, column)).or_default() |= 1_u64 << part;
            }
            let (start, goal) = (Pose::level(0.0, 0.0, 0.3), Position::new(1.0, 1.0));
            let mut field = Field::new((&met, &memory, &grid), &shape, &start, (goal, 0.3), (MARGIN_M, 64), Frame::of(&Pose::default()));
            while !field.lay_on(1000) {}
            for (x_m, y_m, heading_rad) in poses {
                let (sin, cos) = heading_rad.sin_cos();
                let expected = field.points.iter().all(|&(px, py, margin_m)| {
                    let (dx, dy) = (px - x_m, py - y_m);
                    let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
                    (ahead.abs() - half_length_m).max(left.abs() - half_width_m) >= margin_m
                });
                prop_assert_eq!(field.is_free((x_m, y_m, heading_rad)), expected);
            }
        }
    }
}
