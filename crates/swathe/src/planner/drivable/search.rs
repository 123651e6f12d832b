//! Hybrid A* from a start pose to a goal pose inside a corridor.
//!
//! Beside the short arcs, curves are shot from poses to anchors further along the route and to the goal, so straight
//! stretches are crossed at once and the short arcs matter where the route turns more sharply than the vehicle.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};
use std::f64::consts::TAU;

use crate::grid::Position;
use crate::progress::Report;

use super::curves::{CurveArc, Pose, principal};
use super::drive::{Drive, Step};
use super::field::Field;

/// Side of a cell of the lattice in steps: a straight step always leaves its cell.
const SIDE_STEPS: f64 = 0.7;

/// Curvatures of the steps, in shares of the greatest; the outer ones and the middle are also driven in reverse.
const CURVATURES: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];

/// Headings of a free start or goal.
const FREE_HEADINGS: u32 = 12;

/// Anchors ahead that are shot at.
const ANCHORS_AHEAD: usize = 3;

/// Within this many turning radii of the goal it is shot at, and the bound knows its heading.
const NEAR_GOAL_RADII: f64 = 10.0;

/// Of the poses that were reached by a short arc, curves are shot from every third, and from ever fewer as the search goes on.
const SHOTS_EVERY: usize = 3;
const EXPANSIONS_PER_SHOT: usize = 1000;

/// Expansions between two reports.
const EXPANSIONS_PER_REPORT: usize = 256;

/// How a search ended.
pub(super) enum Ended {
    /// The curves from start to goal.
    Found(Vec<Step>),
    /// Nothing more to look at; the place nearest to the goal that was reached.
    Nothing(Position),
    /// More states than allowed; the same place.
    TooMany(Position),
    /// The caller asked to stop.
    Stopped,
}

/// How a pose was reached.
#[derive(Clone, Debug)]
enum How {
    Start,
    Arc(CurveArc),
    Shot(Box<[CurveArc]>),
}

#[derive(Clone, Debug)]
struct State {
    pose: Pose,
    cost: f64,
    /// Cost of the step that led here, without a change of direction at its begin.
    step_cost: f64,
    /// Expected cost from here.
    hope: f64,
    parent: u32,
    how: How,
    /// Whether it was reached in reverse; `None` at the start.
    reverse: Option<bool>,
    is_goal: bool,
}

/// A state in the queue; the least promise first, then the newest, so that the order is always the same.
struct Entry {
    promise: f64,
    state: u32,
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        other
            .promise
            .total_cmp(&self.promise)
            .then(self.state.cmp(&other.state))
    }
}

/// A pose on the route, with the cost from there to the goal.
struct Anchor {
    pose: Pose,
    to_goal: f64,
}

/// The search.
pub(super) struct Hybrid<'a, 'g> {
    drive: &'a Drive<'a, 'g>,
    field: &'a Field,
    starts: Vec<Pose>,
    goals: Vec<Pose>,
    goal_is_free: bool,
    anchors: Vec<Anchor>,
    step_m: f64,
    /// Headings of the lattice: the gentlest step turns by one of them.
    headings: f64,
    states: Vec<State>,
    best: HashMap<[i32; 4], f64>,
    queue: BinaryHeap<Entry>,
}

impl<'a, 'g> Hybrid<'a, 'g> {
    /// A search along a route of at least one point. `step` is the length of the short arcs in turning radii.
    pub(super) fn new(
        drive: &'a Drive<'a, 'g>,
        field: &'a Field,
        route: &[Position],
        [start_heading, goal_heading]: [Option<f64>; 2],
        step: f64,
    ) -> Self {
        let (start, goal) = (route[0], route[route.len() - 1]);
        let legs: Vec<f64> = route.windows(2).map(|pair| bearing(pair[0], pair[1])).collect();
        let poses = |place: Position, heading: Option<f64>, along: Option<&f64>| -> Vec<Pose> {
            let free = (0..FREE_HEADINGS).map(|k| f64::from(k) / f64::from(FREE_HEADINGS) * TAU);
            let headings: Vec<f64> = match heading {
                Some(heading) => vec![heading],
                None => along.copied().into_iter().chain(free).collect(),
            };
            let pose = |heading| Pose::new(place, principal(heading));
            headings.into_iter().map(pose).collect()
        };
        let mut search = Self {
            drive,
            field,
            starts: poses(start, start_heading, legs.first()),
            goals: poses(goal, goal_heading, legs.last()),
            goal_is_free: goal_heading.is_none(),
            anchors: Vec::new(),
            step_m: step * drive.radius_m(),
            headings: (2.0 * TAU / step).round(),
            states: Vec::new(),
            best: HashMap::new(),
            queue: BinaryHeap::new(),
        };
        search.anchors = search.anchors_along(route);
        search
    }

    /// Searches; `made` counts states over several searches.
    pub(super) fn search(mut self, made: &mut usize, report: &mut Report) -> Ended {
        let most = self.drive.params().most_states;
        for pose in self.starts.clone() {
            self.reach(pose, 0, How::Start, 0.0, false);
        }
        // With a free heading the best start is not known before all have been looked along.
        for start in 0..self.states.len() as u32 {
            self.shoot(start);
        }
        let (mut nearest, mut least) = (self.starts[0].position(), f64::INFINITY);
        let mut expanded = 0;
        while let Some(Entry { state, .. }) = self.queue.pop() {
            let index = state as usize;
            let State {
                pose,
                cost,
                hope,
                is_goal,
                ..
            } = self.states[index];
            if is_goal {
                *made += self.states.len();
                return Ended::Found(self.trace(index));
            }
            if self.best.get(&self.key(index)).is_some_and(|&best| best < cost) {
                continue;
            }
            if hope < least {
                (nearest, least) = (pose.position(), hope);
            }
            if expanded % EXPANSIONS_PER_REPORT == 0 && !report((*made + self.states.len()) as u64, 0) {
                return Ended::Stopped;
            }
            expanded += 1;
            if *made + self.states.len() >= most {
                return Ended::TooMany(nearest);
            }
            let how = &self.states[index].how;
            let by_arc = matches!(how, How::Arc(_));
            if matches!(how, How::Shot(_)) || by_arc && expanded % (SHOTS_EVERY + expanded / EXPANSIONS_PER_SHOT) == 0 {
                self.shoot(state);
            }
            self.go_on(state);
        }
        *made += self.states.len();
        Ended::Nothing(nearest)
    }

    /// Drives short arcs.
    fn go_on(&mut self, from: u32) {
        let pose = self.states[from as usize].pose;
        for (index, share) in CURVATURES.into_iter().enumerate() {
            for reverse in [false, true] {
                if reverse && index % 2 == 1 {
                    continue;
                }
                let arc = CurveArc {
                    curvature_per_m: share / self.drive.radius_m(),
                    length_m: if reverse { -self.step_m } else { self.step_m },
                };
                // A state that cannot become the best of its cell is not integrated.
                let to = pose.after(arc);
                let least = self.states[from as usize].cost + self.drive.least_cost(pose.position(), to.position());
                if self
                    .best
                    .get(&self.cell(to, reverse))
                    .is_some_and(|&best| best <= least)
                {
                    continue;
                }
                if let Some(facts) = self.drive.arc(pose, arc, self.field.inside.as_ref()) {
                    self.reach(to, from, How::Arc(arc), facts.cost, false);
                }
            }
        }
    }

    /// Shoots curves at the goal, when it is near, and at the next anchors.
    fn shoot(&mut self, from: u32) {
        let State { pose, hope, .. } = self.states[from as usize];
        let inside = self.field.inside.as_ref();
        let near = NEAR_GOAL_RADII * self.drive.radius_m() + 2.0 * self.drive.cell_size_m();
        let goal = self.goals[0];
        let first = self.anchors.partition_point(|anchor| anchor.to_goal >= hope);
        let ahead = first..self.anchors.len().min(first + ANCHORS_AHEAD);
        let mut shots = Vec::new();
        if pose.position().distance_m(goal.position()) < near || ahead.len() < ANCHORS_AHEAD {
            // A free goal is entered as it comes, and with other headings only where that cannot be.
            let first = self.straight_in(pose, goal.position());
            let shot = self.drive.shot(pose, &first, inside);
            let shot = shot.or_else(|| self.drive.shot(pose, &self.goals, inside));
            shots.extend(shot.map(|step| (step, true)));
        }
        for anchor in &self.anchors[ahead] {
            shots.extend(self.drive.shot(pose, &[anchor.pose], inside).map(|step| (step, false)));
        }
        for (step, is_goal) in shots {
            self.reach(
                step.to,
                from,
                How::Shot(step.arcs.into_boxed_slice()),
                step.cost,
                is_goal,
            );
        }
    }

    /// The poses with which a turn to either side and a straight line lead to a free goal.
    fn straight_in(&self, pose: Pose, goal: Position) -> Vec<Pose> {
        if !self.goal_is_free {
            return Vec::new();
        }
        let radius_m = self.drive.radius_m();
        let turned = [1.0, -1.0].map(|side: f64| {
            let (sin, cos) = pose.heading_rad.sin_cos();
            let (x, y) = (pose.x_m - side * radius_m * sin, pose.y_m + side * radius_m * cos);
            let (dx, dy) = (goal.x_m - x, goal.y_m - y);
            let sine = radius_m / dx.hypot(dy);
            (sine <= 1.0).then(|| Pose::new(goal, principal(dy.atan2(dx) + side * sine.asin())))
        });
        turned.into_iter().flatten().collect()
    }

    /// Notes a state, unless its cell of the lattice is known to be reached for less.
    fn reach(&mut self, pose: Pose, parent: u32, how: How, step_cost: f64, is_goal: bool) {
        let before = self.states.get(parent as usize);
        let (first, last) = match &how {
            How::Start => (None, None),
            How::Arc(arc) => (Some(arc.length_m < 0.0), Some(arc.length_m < 0.0)),
            How::Shot(arcs) => (
                arcs.first().map(|arc| arc.length_m < 0.0),
                arcs.last().map(|arc| arc.length_m < 0.0),
            ),
        };
        let (mut cost, mut reverse) = (step_cost, last);
        if let (Some(before), false) = (before, matches!(how, How::Start)) {
            cost += before.cost;
            if let (Some(was), Some(is)) = (before.reverse, first)
                && was != is
            {
                cost += self.drive.cusp_cost;
            }
            reverse = last.or(before.reverse);
        }
        let hope = if is_goal {
            0.0
        } else {
            self.hope(pose, before.map(|before| before.hope))
        };
        let index = self.states.len() as u32;
        self.states.push(State {
            pose,
            cost,
            step_cost,
            hope,
            parent,
            how,
            reverse,
            is_goal,
        });
        if !is_goal {
            let key = self.key(index as usize);
            let best = self.best.entry(key).or_insert(f64::INFINITY);
            if cost >= *best {
                self.states.pop();
                return;
            }
            *best = cost;
        }
        let promise = cost + self.drive.params().weight * hope;
        self.queue.push(Entry { promise, state: index });
    }

    /// Expected cost from a pose: that of the route's graph, and near a goal with a heading that of the curve to it.
    ///
    /// Where the graph has no cost (beside closed cells) that of the pose before counts: it leads back there.
    fn hope(&self, pose: Pose, before: Option<f64>) -> f64 {
        let goal = self.goals[0];
        let straight = self.drive.least_cost(pose.position(), goal.position());
        let graph = self.field.to_goal(pose.position()).or(before).unwrap_or(0.0);
        let mut hope = straight.max(graph);
        let near_m = NEAR_GOAL_RADII * self.drive.radius_m();
        if !self.goal_is_free && pose.position().distance_m(goal.position()) < near_m {
            hope = hope.max(self.drive.curve_cost(pose, goal));
        }
        hope
    }

    fn key(&self, index: usize) -> [i32; 4] {
        let State { pose, reverse, .. } = self.states[index];
        self.cell(pose, reverse.unwrap_or(false))
    }

    /// The cell of the lattice.
    fn cell(&self, pose: Pose, reverse: bool) -> [i32; 4] {
        let side_m = SIDE_STEPS * self.step_m;
        let origin = self.starts[0];
        let heading = (pose.heading_rad.rem_euclid(TAU) / TAU * self.headings).round() % self.headings;
        [
            ((pose.x_m - origin.x_m) / side_m).floor() as i32,
            ((pose.y_m - origin.y_m) / side_m).floor() as i32,
            heading as i32,
            i32::from(reverse),
        ]
    }

    /// The steps that led to a state.
    fn trace(&self, goal: usize) -> Vec<Step> {
        let mut steps = Vec::new();
        let mut here = &self.states[goal];
        loop {
            let arcs = match &here.how {
                How::Start => break,
                How::Arc(arc) => vec![*arc],
                How::Shot(arcs) => arcs.to_vec(),
            };
            let before = &self.states[here.parent as usize];
            steps.push(Step {
                from: before.pose,
                to: here.pose,
                arcs,
                cost: here.step_cost,
            });
            here = before;
        }
        steps.reverse();
        steps
    }

    /// Poses along the route's legs: where the arcs around its turns begin and end, or the middle of a short leg.
    fn anchors_along(&self, route: &[Position]) -> Vec<Anchor> {
        let radius_m = self.drive.radius_m();
        let turns: Vec<f64> = route
            .windows(3)
            .map(|three| {
                let turn = principal(bearing(three[1], three[2]) - bearing(three[0], three[1])).abs();
                (radius_m * (turn / 2.0).tan()).clamp(0.0, 3.0 * radius_m)
            })
            .collect();
        let legs = route.len().saturating_sub(1);
        let mut anchors: Vec<Anchor> = Vec::new();
        for leg in 0..legs {
            let (a, b) = (route[leg], route[leg + 1]);
            let length_m = a.distance_m(b);
            if length_m == 0.0 {
                continue;
            }
            let after = if leg == 0 { None } else { Some(turns[leg - 1]) };
            let before = if leg + 1 == legs {
                None
            } else {
                Some(length_m - turns[leg])
            };
            let (low, high) = (after.unwrap_or(0.0), before.unwrap_or(length_m));
            let places: Vec<f64> = if low < high {
                let middle = (high - low > 6.0 * radius_m).then_some(f64::midpoint(low, high));
                [after, middle, before].into_iter().flatten().collect()
            } else {
                vec![f64::midpoint(low, high).clamp(0.0, length_m)]
            };
            for place in places {
                let position = a.towards(b, place / length_m);
                let last = anchors.last().map_or(f64::INFINITY, |anchor| anchor.to_goal);
                anchors.push(Anchor {
                    pose: Pose::new(position, bearing(a, b)),
                    // Falling along the route, whatever the interpolation does.
                    to_goal: self.field.to_goal(position).unwrap_or(last).min(last),
                });
            }
        }
        anchors
    }
}

fn bearing(from: Position, to: Position) -> f64 {
    (to.y_m - from.y_m).atan2(to.x_m - from.x_m)
}
