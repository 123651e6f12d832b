//! The search for a vehicle that turns in place: along sixteen directions, with turns from one to the next.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::grid::Position;
use crate::sensor::wrap;

use super::field::Field;
use super::{BACK_FACTOR, Leg, NEAR_FACTOR, Progress, UNSEEN_FACTOR, WEIGHT};

/// Steps (columns east, rows north) of the sixteen directions, counter-clockwise.
const AXES: [(i64, i64); 16] = [
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
const COUNT: usize = AXES.len();

/// States that are looked at in one step of the navigator, and for how many one counts whose slants are looked at.
const WORK_PER_STEP: usize = 6000;
const SLANT_WORK: usize = 6;

/// A turn costs as much as this many radii of the footprint by radian, and a little by itself.
const TURN_RADII: f64 = 0.5;
const TURN_M: f64 = 0.02;

/// Longest part of a turn between two headings that are looked at: no corner is cut in between.
const TURN_PIECE_RAD: f64 = 0.02;

/// Widest turn from the robot's own heading to a direction.
const FIRST_TURN_RAD: f64 = 0.5;

/// Costs are whole tenths of millimetres, from 1 on: 0 was not reached.
const UNITS: f64 = 10_000.0;

/// Bit of a mask that was worked out.
const KNOWN: u32 = 1 << 31;

/// Where there is no room to turn, the vehicle leaves a direction by slants: so many steps along and one aside.
const SLANTS: [i64; 2] = [3, 6];

/// Off its own heading by less the vehicle drives straight to a cell where it cannot turn on the spot, up to so far away.
const SETS_OFF_RAD: f64 = 0.15;
const SETS_OFF_M: f64 = 1.5;

/// How a state was reached.
const FORWARD: u8 = 0;
const BACKWARD: u8 = 1;
const LEFT: u8 = 2;
const RIGHT: u8 = 3;
const BEGIN: u8 = 4;
/// And by slants from here on: which, backwards or not, to the right or not.
const SLANT: u8 = 5;
/// Bit of one that was looked at: with a weighted bound, to look again at what was reached more cheaply later would take for ever.
const DONE: u8 = 0x80;

fn axis_rad(axis: usize) -> f64 {
    let (east, north) = AXES[axis % COUNT];
    (north as f64).atan2(east as f64)
}

/// Such a search.
pub(super) struct Walk {
    start: (f64, f64, f64),
    goal: Position,
    near_goal_m: f64,
    /// By cell, when it is looked at: bit k whether the footprint fits along the axis of direction k (and k + 8), bit 8 + k
    /// whether it can turn from there to the next.
    masks: Vec<u32>,
    best: Vec<u32>,
    from: Vec<u8>,
    open: BinaryHeap<Reverse<(u32, u32)>>,
}

impl Walk {
    pub fn new(field: &Field, start: (f64, f64, f64), goal: Position, near_goal_m: f64) -> Self {
        let count = (field.rows * field.columns) as usize;
        Self {
            start,
            goal,
            near_goal_m,
            masks: vec![0; count],
            best: vec![0; count * COUNT],
            from: vec![0; count * COUNT],
            open: BinaryHeap::new(),
        }
    }

    /// Puts the directions beside the robot's heading into the queue.
    pub fn begin(&mut self, field: &Field) {
        let (x_m, y_m, heading_rad) = self.start;
        let Some(index) = field.at(x_m, y_m) else { return };
        self.face(field, (index, (x_m, y_m)), heading_rad, 0.0);
        if !self.open.is_empty() {
            return;
        }
        let cell = (index as i64 / field.columns, index as i64 % field.columns);
        let reach = (SETS_OFF_M / field.size_m).ceil() as i64;
        for row in cell.0 - reach..=cell.0 + reach {
            for column in cell.1 - reach..=cell.1 + reach {
                let (to, Some(index)) = (field.middle((row, column)), field.index((row, column))) else {
                    continue;
                };
                let length_m = (to.0 - x_m).hypot(to.1 - y_m);
                let ahead_rad = (to.1 - y_m).atan2(to.0 - x_m);
                let backs = wrap(ahead_rad - heading_rad).abs() > FRAC_PI_2;
                let to_rad = if backs { wrap(ahead_rad + PI) } else { ahead_rad };
                let is_near = length_m > 0.5 * field.size_m && length_m <= SETS_OFF_M;
                if is_near
                    && wrap(to_rad - heading_rad).abs() < SETS_OFF_RAD
                    && turns_free(field, (x_m, y_m), heading_rad, to_rad)
                    && runs_free(field, (x_m, y_m), to, to_rad)
                {
                    self.face(field, (index, to), to_rad, length_m * NEAR_FACTOR);
                }
            }
        }
    }

    /// Turns from a heading to the directions beside it.
    fn face(&mut self, field: &Field, (index, at): (usize, (f64, f64)), heading_rad: f64, so_far_m: f64) {
        for axis in 0..COUNT {
            let by_rad = wrap(axis_rad(axis) - heading_rad).abs();
            if by_rad < FIRST_TURN_RAD && turns_free(field, at, heading_rad, axis_rad(axis)) {
                let by_m = so_far_m + by_rad * TURN_RADII * field.radius_m;
                self.reach(field, index, axis, by_m, 0, BEGIN);
            }
        }
    }

    fn reach(&mut self, field: &Field, index: usize, axis: usize, by_m: f64, before: u32, how: u8) {
        let Some(to_go_m) = field.to_go_m(index) else { return };
        let cost = before.saturating_add((by_m * UNITS) as u32 + 1);
        let state = index * COUNT + axis;
        let is_done = self.from[state] & DONE != 0;
        if is_done || (self.best[state] != 0 && self.best[state] <= cost) {
            return;
        }
        self.best[state] = cost;
        self.from[state] = how;
        let bound = cost.saturating_add((WEIGHT * to_go_m * UNITS) as u32);
        self.open.push(Reverse((bound, state as u32)));
    }

    /// Where the footprint fits in a cell.
    fn mask(&mut self, field: &Field, index: usize) -> u32 {
        let known = self.masks[index];
        if known != 0 {
            return known;
        }
        let mask = KNOWN
            | match field.plainly(index) {
                Some(true) => 0xffff,
                Some(false) => 0,
                None => {
                    let (x_m, y_m) = field.middle((index as i64 / field.columns, index as i64 % field.columns));
                    let mut mask = 0;
                    for axis in 0..COUNT / 2 {
                        mask |= u32::from(field.is_free((x_m, y_m, axis_rad(axis)))) << axis;
                    }
                    for axis in 0..COUNT / 2 {
                        let next = (axis + 1) % (COUNT / 2);
                        let both = mask >> axis & mask >> next & 1 == 1;
                        let turns = both && turns_free(field, (x_m, y_m), axis_rad(axis), axis_rad(axis + 1));
                        mask |= u32::from(turns) << (COUNT / 2 + axis);
                    }
                    mask
                }
            };
        self.masks[index] = mask;
        mask
    }

    /// Goes on.
    pub fn go_on(&mut self, field: &Field) -> Progress {
        let mut work = 0;
        while work < WORK_PER_STEP {
            work += 1;
            let Some(Reverse((bound, state))) = self.open.pop() else {
                return Progress::Exhausted;
            };
            let (index, axis) = (state as usize / COUNT, state as usize % COUNT);
            let cost = self.best[state as usize];
            let to_go_m = field.to_go_m(index).unwrap_or(0.0);
            if bound > cost.saturating_add((WEIGHT * to_go_m * UNITS) as u32) || self.from[state as usize] & DONE != 0 {
                continue;
            }
            self.from[state as usize] |= DONE;
            let cell = (index as i64 / field.columns, index as i64 % field.columns);
            let (x_m, y_m) = field.middle(cell);
            if Position::new(x_m, y_m).distance_m(self.goal) <= self.near_goal_m {
                return Progress::Found(self.legs(field, state as usize));
            }
            let (east, north) = AXES[axis];
            let length_m = (east as f64).hypot(north as f64) * field.size_m;
            for side in [1, -1] {
                let Some(next) = field.index((cell.0 - side * north, cell.1 + side * east)) else {
                    continue;
                };
                if field.to_go_m(next).is_none() || self.mask(field, next) >> (axis % (COUNT / 2)) & 1 == 0 {
                    continue;
                }
                let (to_x_m, to_y_m) = field.middle((cell.0 - side * north, cell.1 + side * east));
                let heading_rad = axis_rad(axis);
                let is_long = east.abs() + north.abs() > 2;
                if is_long
                    && field.plainly(next) != Some(true)
                    && !field.is_free((x_m.midpoint(to_x_m), y_m.midpoint(to_y_m), heading_rad))
                {
                    continue;
                }
                let backs = side < 0;
                if backs && !field.sees_behind((to_x_m, to_y_m, heading_rad)) {
                    continue;
                }
                let factor = (if field.is_near(next) { NEAR_FACTOR } else { 1.0 })
                    * if backs { BACK_FACTOR } else { 1.0 }
                    * if field.is_known(next) { 1.0 } else { UNSEEN_FACTOR };
                let how = if backs { BACKWARD } else { FORWARD };
                self.reach(field, next, axis, length_m * factor, cost, how);
            }
            let mask = self.mask(field, index);
            if mask >> (COUNT / 2) & 0xff != 0xff {
                self.slant(field, cell, axis, cost);
                work += SLANT_WORK;
            }
            for (to, turn, how) in [
                ((axis + 1) % COUNT, axis % (COUNT / 2), LEFT),
                ((axis + COUNT - 1) % COUNT, (axis + COUNT - 1) % (COUNT / 2), RIGHT),
            ] {
                if mask >> (COUNT / 2 + turn) & 1 == 1 {
                    let by_rad = wrap(axis_rad(to) - axis_rad(axis)).abs();
                    self.reach(
                        field,
                        index,
                        to,
                        by_rad * TURN_RADII * field.radius_m + TURN_M,
                        cost,
                        how,
                    );
                }
            }
        }
        Progress::On
    }

    /// Goes on by slants, which need less room than turns.
    fn slant(&mut self, field: &Field, cell: (i64, i64), axis: usize, cost: u32) {
        let from = field.middle(cell);
        let heading_rad = axis_rad(axis);
        for how in SLANT..SLANT + 8 {
            let ((east, north), side) = slant(how, axis);
            let to = (cell.0 - north, cell.1 + east);
            let Some(next) = field.index(to) else { continue };
            let fits = field.to_go_m(next).is_some() && self.mask(field, next) >> (axis % (COUNT / 2)) & 1 == 1;
            if !fits {
                continue;
            }
            let at = field.middle(to);
            let to_rad = (side * (at.1 - from.1)).atan2(side * (at.0 - from.0));
            let backs = side < 0.0;
            if (backs && !field.sees_behind((at.0, at.1, to_rad)))
                || !turns_free(field, from, heading_rad, to_rad)
                || !runs_free(field, from, at, to_rad)
                || !turns_free(field, at, to_rad, heading_rad)
            {
                continue;
            }
            let length_m = (at.0 - from.0).hypot(at.1 - from.1);
            let factor = NEAR_FACTOR * if backs { BACK_FACTOR } else { 1.0 };
            self.reach(field, next, axis, length_m * factor + 2.0 * TURN_M, cost, how);
        }
    }

    /// The legs to a state.
    fn legs(&self, field: &Field, last: usize) -> Vec<Leg> {
        let mut steps = Vec::new();
        let mut state = last;
        loop {
            let how = self.from[state] & !DONE;
            steps.push((state, how));
            let (index, axis) = (state / COUNT, state % COUNT);
            let (east, north) = AXES[axis];
            let back = |(east, north): (i64, i64)| (index as i64 + north * field.columns - east) as usize;
            state = match how {
                FORWARD => back((east, north)) * COUNT + axis,
                BACKWARD => back((-east, -north)) * COUNT + axis,
                LEFT => index * COUNT + (axis + COUNT - 1) % COUNT,
                RIGHT => index * COUNT + (axis + 1) % COUNT,
                BEGIN => break,
                _ => back(slant(how, axis).0) * COUNT + axis,
            };
        }
        // Ends of the runs, with the side on which each is driven.
        let mut ends = vec![((self.start.0, self.start.1), 0.0)];
        let mut last = BEGIN;
        for &(state, how) in steps.iter().rev() {
            let (index, axis) = (state / COUNT, state % COUNT);
            let at = field.middle((index as i64 / field.columns, index as i64 % field.columns));
            let is_start = (at.0 - self.start.0).hypot(at.1 - self.start.1) < 0.5 * field.size_m;
            match how {
                BEGIN if is_start => {}
                BEGIN => {
                    let (sin, cos) = self.start.2.sin_cos();
                    let ahead_m = (at.0 - self.start.0) * cos + (at.1 - self.start.1) * sin;
                    ends.push((at, ahead_m.signum()));
                }
                FORWARD | BACKWARD => {
                    let side = if how == BACKWARD { -1.0 } else { 1.0 };
                    if last == how
                        && let Some(end) = ends.last_mut()
                    {
                        end.0 = at;
                    } else {
                        ends.push((at, side));
                    }
                }
                LEFT | RIGHT => {}
                _ => ends.push((at, slant(how, axis).1)),
            }
            last = how;
        }
        straighten(field, self.start, &ends)
    }
}

/// Cells east and north of a slant from a direction, and the side on which it is driven.
fn slant(how: u8, axis: usize) -> ((i64, i64), f64) {
    let which = how - SLANT;
    let along = SLANTS[usize::from(which & 1)];
    let side = if which & 2 == 0 { 1 } else { -1 };
    let aside = if which & 4 == 0 { 1 } else { -1 };
    let (east, north) = AXES[axis];
    let cells = (side * along * east - aside * north, side * along * north + aside * east);
    (cells, side as f64)
}

/// Whether the footprint can turn in place by the shorter way.
fn turns_free(field: &Field, at: (f64, f64), from_rad: f64, to_rad: f64) -> bool {
    let by_rad = wrap(to_rad - from_rad);
    let pieces = (by_rad.abs() / TURN_PIECE_RAD).ceil().max(1.0);
    (1..=pieces as u32).all(|k| field.is_free((at.0, at.1, from_rad + by_rad * f64::from(k) / pieces)))
}

/// Whether the footprint can go straight from place to place in a heading.
fn runs_free(field: &Field, from: (f64, f64), to: (f64, f64), heading_rad: f64) -> bool {
    let length_m = (to.0 - from.0).hypot(to.1 - from.1);
    let pieces = (length_m / (0.5 * field.size_m)).ceil().max(1.0);
    (0..=pieces as u32).all(|k| {
        let share = f64::from(k) / pieces;
        let at = (from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1));
        field.is_free((at.0, at.1, heading_rad))
    })
}

/// Ends of runs, with the side on which each is driven, as legs with as few turns as can be: from the end of a run straight to the
/// end of a later one, where that is free.
fn straighten(field: &Field, start: (f64, f64, f64), ends: &[((f64, f64), f64)]) -> Vec<Leg> {
    let heading = |from: (f64, f64), to: (f64, f64), side: f64| (side * (to.1 - from.1)).atan2(side * (to.0 - from.0));
    let mut kept: Vec<Leg> = Vec::new();
    let mut heading_rad = start.2;
    let mut k = 0;
    while k + 1 < ends.len() {
        let from = ends[k].0;
        let side = ends[k + 1].1;
        let alike = ends[k + 1..].iter().take_while(|end| end.1 == side).count();
        let straight = (2..=alike).rev().map(|count| k + count).find(|&to| {
            let to_rad = heading(from, ends[to].0, side);
            let next_rad = ends
                .get(to + 1)
                .map_or(to_rad, |next| heading(ends[to].0, next.0, next.1));
            runs_free(field, from, ends[to].0, to_rad)
                && turns_free(field, from, heading_rad, to_rad)
                && turns_free(field, ends[to].0, to_rad, next_rad)
        });
        let to = straight.unwrap_or(k + 1);
        let to_rad = heading(from, ends[to].0, side);
        let by_rad = wrap(to_rad - heading_rad);
        if by_rad.abs() > 1e-9 {
            if !turns_free(field, from, heading_rad, to_rad) {
                // The other way round, in parts that are each the shorter way.
                let round_rad = by_rad - by_rad.signum() * TAU;
                kept.extend([1.0, 2.0].map(|third| Leg::Turn {
                    to_rad: wrap(heading_rad + round_rad * third / 3.0),
                }));
            }
            kept.push(Leg::Turn { to_rad });
        }
        let length_m = side * (ends[to].0.0 - from.0).hypot(ends[to].0.1 - from.1);
        kept.push(Leg::Run {
            from: (from.0, from.1, to_rad),
            curvature_per_m: 0.0,
            length_m,
        });
        heading_rad = to_rad;
        k = to;
    }
    kept
}
