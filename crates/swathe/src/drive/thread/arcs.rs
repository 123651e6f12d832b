//! The search for a vehicle with a turning circle: arcs and straights, forwards and backwards.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};
use std::f64::consts::TAU;

use crate::grid::Position;

use super::field::Field;
use super::{BACK_FACTOR, Effort, Leg, NEAR_FACTOR, Progress, UNSEEN_FACTOR, WEIGHT, after};

/// States that are looked at in one step of the navigator, and in all.
const WORK_PER_STEP: usize = 800;
const MOST_STATES: usize = 600_000;

/// Turning back costs as much as this many radii of the footprint.
const CUSP_RADII: f64 = 1.0;

/// Headings that are told apart, by effort.
const HEADINGS: u16 = 24;
const FINE_HEADINGS: u16 = 64;

/// Side of the cells within which states are one, as a share of a step.
const SAME_SHARE: f64 = 0.4;

/// How much wider than its least circle the vehicle plans.
const WIDER: f64 = 1.05;

/// Room that a vehicle keeps beside it and before it, and what a metre costs without, as a multiple: beside a wall it cannot
/// turn away any more, and corners that were seen from one side only reach farther than what was met of them.
const SPARE_M: f64 = 0.25;
const TIGHT_FACTOR: f64 = 2.0;
const TIGHT_BACK_FACTOR: f64 = 4.0;

/// Longest way between two poses that are looked at, in metres.
const PIECE_M: f64 = 0.12;

/// A state: its cell, and a part of the turn.
type Key = (i64, i64, u16);

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

/// Whether a vehicle has room to spare at a pose, beside it and before it in the direction of travel.
fn has_room(field: &Field, (x_m, y_m, heading_rad): (f64, f64, f64), backs: bool) -> bool {
    let (sin, cos) = heading_rad.sin_cos();
    let further_m = if backs { -SPARE_M } else { SPARE_M };
    [(further_m, 0.0), (0.0, SPARE_M), (0.0, -SPARE_M)]
        .into_iter()
        .all(|(ahead, left)| {
            field.is_free((
                x_m + cos * ahead - sin * left,
                y_m + sin * ahead + cos * left,
                heading_rad,
            ))
        })
}

/// Such a search.
pub(super) struct Arcs {
    start: (f64, f64, f64),
    goal: Position,
    near_goal_m: f64,
    tightest_per_m: f64,
    headings: u16,
    /// Length of a step, so long that an arc leads into another heading, and side of the cells of states.
    length_m: f64,
    same_m: f64,
    nodes: Vec<Node>,
    /// Least cost of each state, and whether it was looked at.
    best: HashMap<Key, (f64, bool)>,
    open: BinaryHeap<Open>,
}

impl Arcs {
    pub fn new(
        field: &Field,
        start: (f64, f64, f64),
        (goal, near_goal_m): (Position, f64),
        turn_radius_m: f64,
        effort: Effort,
    ) -> Self {
        let headings = if effort == Effort::Tight {
            FINE_HEADINGS
        } else {
            HEADINGS
        };
        let tightest_per_m = 1.0 / (WIDER * turn_radius_m);
        let length_m = (1.5 * field.size_m).max(1.1 * TAU / f64::from(headings) / tightest_per_m);
        Self {
            start,
            goal,
            near_goal_m,
            tightest_per_m,
            headings,
            length_m,
            same_m: field.size_m.max(SAME_SHARE * length_m),
            nodes: Vec::new(),
            best: HashMap::new(),
            open: BinaryHeap::new(),
        }
    }

    /// Puts the robot's own pose into the queue.
    pub fn begin(&mut self, field: &Field) {
        let leg = Leg::Turn { to_rad: self.start.2 };
        self.reach(field, self.start, 0.0, u32::MAX, leg, false);
    }

    fn key(&self, (x_m, y_m, heading_rad): (f64, f64, f64)) -> Key {
        let (row, column) = (
            ((self.start.1 - y_m) / self.same_m).round() as i64,
            ((x_m - self.start.0) / self.same_m).round() as i64,
        );
        let sector = (heading_rad.rem_euclid(TAU) / TAU * f64::from(self.headings)).round() as u16 % self.headings;
        (row, column, sector)
    }

    fn reach(&mut self, field: &Field, at: (f64, f64, f64), cost_m: f64, from: u32, leg: Leg, backs: bool) {
        let Some(to_go_m) = field.at(at.0, at.1).and_then(|index| field.to_go_m(index)) else {
            return;
        };
        let key = self.key(at);
        let enough_m = SAME_SHARE * self.length_m;
        let is_as_good = |&(best_m, is_done): &(f64, bool)| is_done || best_m <= cost_m + enough_m;
        if self.best.get(&key).is_some_and(is_as_good) {
            return;
        }
        self.best.insert(key, (cost_m, false));
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
    pub fn go_on(&mut self, field: &Field) -> Progress {
        for _ in 0..WORK_PER_STEP {
            let Some(Open { node, .. }) = self.open.pop() else {
                return Progress::Exhausted;
            };
            let now = self.nodes[node as usize];
            let key = self.key(now.at);
            if self
                .best
                .insert(key, (now.cost_m, true))
                .is_some_and(|(_, is_done)| is_done)
            {
                continue;
            }
            if Position::new(now.at.0, now.at.1).distance_m(self.goal) <= self.near_goal_m {
                return Progress::Found(self.legs(node));
            }
            if self.nodes.len() > MOST_STATES {
                return Progress::Exhausted;
            }
            self.drive_from(field, node, &now);
        }
        Progress::On
    }

    /// Cost of a metre at a place.
    fn factor(field: &Field, at: (f64, f64, f64), backs: bool) -> f64 {
        let Some(index) = field.at(at.0, at.1) else {
            return 1.0;
        };
        let tight = if !field.is_near(index) {
            1.0
        } else if has_room(field, at, backs) {
            NEAR_FACTOR
        } else if backs {
            TIGHT_BACK_FACTOR
        } else {
            TIGHT_FACTOR
        };
        tight * if backs { BACK_FACTOR } else { 1.0 } * if field.is_known(index) { 1.0 } else { UNSEEN_FACTOR }
    }

    fn drive_from(&mut self, field: &Field, node: u32, now: &Node) {
        let (tightest, length_m) = (self.tightest_per_m, self.length_m);
        let steps = (length_m / field.size_m.min(PIECE_M)).ceil().max(2.0) as usize;
        for side in [1.0, -1.0] {
            let backs = side < 0.0;
            for curvature_per_m in [0.0, tightest, -tightest, 0.5 * tightest, -0.5 * tightest] {
                let poses: Vec<(f64, f64, f64)> = (1..=steps)
                    .map(|k| after(now.at, curvature_per_m, side * length_m * k as f64 / steps as f64))
                    .collect();
                if !poses.iter().all(|&pose| field.is_free(pose)) {
                    continue;
                }
                let to = poses[steps - 1];
                if backs && !poses.iter().all(|&pose| field.sees_behind(pose)) {
                    continue;
                }
                let leg = Leg::Run {
                    from: now.at,
                    curvature_per_m,
                    length_m: side * length_m,
                };
                let turns_back = if now.from != u32::MAX && backs != now.backs {
                    CUSP_RADII * field.radius_m
                } else {
                    0.0
                };
                let cost_m = now.cost_m + length_m * Self::factor(field, to, backs) + turns_back;
                self.reach(field, to, cost_m, node, leg, backs);
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
