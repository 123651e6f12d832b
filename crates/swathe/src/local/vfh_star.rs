//! VFH* of Ulrich and Borenstein, "VFH*: local obstacle avoidance with look-ahead verification", ICRA 2000, 2505-2511.
//! Symbols are the paper's: every candidate of VFH+ is driven in thought, VFH+ is asked again at the place it leads to, and a
//! search of A* over these places finds the first step of the cheapest way.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::sensor::{Pose, wrap};

use super::certainty::CertaintyGrid;
use super::polar::{Steering, sector_gap};
use super::vfh_plus::{Body, VfhPlus, VfhPlusParams};
use super::{GOODNESS_MAX, Ground};

/// The paper's parameters; its own figures are not known to us, the defaults are ours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VfhStarParams {
    /// VFH+ at every node.
    pub plus: VfhPlusParams,
    /// `n_g`: goal depth; 1 is VFH+.
    pub depth: usize,
    /// `d_s`: metres driven from node to node.
    pub step_m: f64,
    /// λ: discount by depth.
    pub discount: f64,
    /// `μ_1'`, `μ_2'`, `μ_3'`: weights below the root.
    pub mu: [f64; 3],
    /// Nodes after which the best so far is taken.
    pub most_nodes: usize,
}

impl Default for VfhStarParams {
    fn default() -> Self {
        Self {
            plus: VfhPlusParams::default(),
            depth: 5,
            step_m: 0.8,
            discount: 0.8,
            mu: [5.0, 1.0, 1.0],
            most_nodes: 400,
        }
    }
}

/// A place that is reached in thought.
#[derive(Clone, Copy, Debug)]
struct Node {
    pose: Pose,
    /// Direction in which it was reached.
    direction_rad: f64,
    /// First step that leads here: a candidate of the root.
    first: (f64, f64),
    depth: usize,
    cost: f64,
    /// Cost and what is left at least.
    key: f64,
    /// Order of making, so that ties are broken the same way every time.
    number: usize,
}

impl PartialEq for Node {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Node {}

impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Node {
    /// The cheapest is the greatest, as the heap gives the greatest first; among equals the deeper, then the older.
    fn cmp(&self, other: &Self) -> Ordering {
        let by_key = other.key.total_cmp(&self.key);
        by_key
            .then(self.depth.cmp(&other.depth))
            .then(other.number.cmp(&self.number))
    }
}

/// The method: VFH+ at the robot, and another that is asked in thought.
#[derive(Clone, Debug)]
pub struct VfhStar {
    params: VfhStarParams,
    here: VfhPlus,
    ahead: VfhPlus,
    window: Vec<u8>,
    expanded: usize,
}

impl VfhStar {
    /// Tables for some parameters. The depth is at least 1.
    pub fn new(params: VfhStarParams) -> Self {
        let here = VfhPlus::new(params.plus);
        let side = here.params().window_cells;
        Self {
            params: VfhStarParams {
                depth: params.depth.max(1),
                ..params
            },
            ahead: here.clone(),
            here,
            window: vec![0; side * side],
            expanded: 0,
        }
    }

    /// Parameters in use.
    pub fn params(&self) -> &VfhStarParams {
        &self.params
    }

    /// VFH+ at the robot as it was in the last step.
    pub fn plus(&self) -> &VfhPlus {
        &self.here
    }

    /// Nodes that were expanded in the last step.
    pub fn expanded(&self) -> usize {
        self.expanded
    }

    /// Forgets the last step.
    pub fn forget(&mut self) {
        self.here.forget();
    }

    /// Chooses a direction. `target` gives the direction to the target from any place; the ground closes cells and weighs
    /// directions at every place that is reached in thought.
    pub fn steer(
        &mut self,
        grid: &CertaintyGrid,
        pose: &Pose,
        body: &Body,
        target: impl Fn(f64, f64) -> f64,
        ground: Option<&dyn Ground>,
    ) -> Steering {
        let n = self.params.plus.sectors;
        let side = self.here.params().window_cells;
        let previous_rad = self.here.previous_rad().unwrap_or(pose.heading_rad);
        let target_rad = target(pose.x_m, pose.y_m);
        let lack =
            |x_m: f64, y_m: f64, c: f64| ground.map_or(0.0, |ground| GOODNESS_MAX - ground.goodness(x_m, y_m, c));
        let mu_4 = self.params.plus.mu_ground;
        grid.copy_window(pose.x_m, pose.y_m, side, &mut self.window);
        if let Some(ground) = ground {
            ground.close(pose.x_m, pose.y_m, &mut self.window);
        }
        self.here.update(&self.window, pose.heading_rad, body);
        let mut queue = BinaryHeap::new();
        let mut number = 0;
        let [mu_1, mu_2, mu_3] = self.params.plus.mu;
        for first in self.here.candidates(target_rad) {
            let c = first.0;
            let cost = mu_1 * sector_gap(c, target_rad, n)
                + mu_2 * sector_gap(c, pose.heading_rad, n)
                + mu_3 * sector_gap(c, previous_rad, n)
                + mu_4 * lack(pose.x_m, pose.y_m, c);
            let root = Node {
                pose: *pose,
                direction_rad: previous_rad,
                first,
                depth: 0,
                cost: 0.0,
                key: 0.0,
                number: 0,
            };
            number += 1;
            queue.push(self.driven(&root, first, cost, body, &target, number));
        }
        self.expanded = 0;
        let mut best: Option<Node> = None;
        while let Some(node) = queue.pop() {
            // The deepest place so far is what is taken when nothing reaches the goal depth.
            if best.is_none_or(|best| node.depth > best.depth) {
                best = Some(node);
            }
            if node.depth >= self.params.depth || self.expanded >= self.params.most_nodes {
                break;
            }
            self.expanded += 1;
            let Pose {
                x_m, y_m, heading_rad, ..
            } = node.pose;
            grid.copy_window(x_m, y_m, side, &mut self.window);
            if let Some(ground) = ground {
                ground.close(x_m, y_m, &mut self.window);
            }
            // What the robot will have blocked by then is not known: no hysteresis.
            self.ahead.forget();
            self.ahead.update(&self.window, heading_rad, body);
            let target_rad = target(x_m, y_m);
            let [mu_1, mu_2, mu_3] = self.params.mu;
            for first in self.ahead.candidates(target_rad) {
                let c = first.0;
                number += 1;
                let mut child = self.driven(&node, first, 0.0, body, &target, number);
                // k_e: where the step really leads, which differs from c while the robot is still turning.
                let k_e = (child.pose.y_m - y_m).atan2(child.pose.x_m - x_m);
                let to_target = sector_gap(c, target_rad, n).max(sector_gap(k_e, target_rad, n));
                let step = mu_1 * to_target
                    + mu_2 * sector_gap(c, heading_rad, n)
                    + mu_3 * sector_gap(c, node.direction_rad, n)
                    + mu_4 * lack(x_m, y_m, c);
                let cost = node.cost + self.params.discount.powi(node.depth as i32) * step;
                child.key = child.key - child.cost + cost;
                child.cost = cost;
                child.first = node.first;
                queue.push(child);
            }
        }
        let steering = best.map_or(Steering::CLOSED, |best| Steering {
            direction_rad: Some(best.first.0),
            crowding: self.here.crowding(best.first.0),
            width_rad: best.first.1,
        });
        self.here.set_previous(steering.direction_rad);
        steering
    }

    /// The node that a candidate leads to: along the least turning circle until the heading fits, then straight on.
    fn driven(
        &self,
        from: &Node,
        candidate: (f64, f64),
        cost: f64,
        body: &Body,
        target: &impl Fn(f64, f64) -> f64,
        number: usize,
    ) -> Node {
        let turn_rad = wrap(candidate.0 - from.pose.heading_rad);
        let side = if turn_rad >= 0.0 { 1.0 } else { -1.0 };
        let radius_m = body.turn_radius_m[usize::from(turn_rad < 0.0)].max(0.0);
        let arc_m = (radius_m * turn_rad.abs()).min(self.params.step_m);
        let turned = if radius_m > 0.0 {
            side * arc_m / radius_m
        } else {
            turn_rad
        };
        let start = from.pose.heading_rad;
        let heading = start + turned;
        let (mut x_m, mut y_m) = (from.pose.x_m, from.pose.y_m);
        x_m += side * radius_m * (heading.sin() - start.sin());
        y_m -= side * radius_m * (heading.cos() - start.cos());
        let rest_m = self.params.step_m - arc_m;
        x_m += rest_m * heading.cos();
        y_m += rest_m * heading.sin();
        let depth = from.depth + 1;
        let pose = Pose::level(x_m, y_m, wrap(heading));
        let n = self.params.plus.sectors;
        let target_rad = target(x_m, y_m);
        let [_, mu_2, mu_3] = self.params.mu;
        // What is left at least: turning to the target and then keeping on.
        let left = if depth >= self.params.depth {
            0.0
        } else {
            let gaps = mu_2 * sector_gap(target_rad, heading, n) + mu_3 * sector_gap(target_rad, candidate.0, n);
            self.params.discount.powi(depth as i32) * gaps
        };
        Node {
            pose,
            direction_rad: candidate.0,
            first: candidate,
            depth,
            cost,
            key: cost + left,
            number,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::local::CertaintyParams;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    const BODY: Body = Body {
        enlarged_m: 0.3,
        turn_radius_m: [0.0, 0.0],
        reaction_m: 1.5,
    };

    /// A world drawn as text, a character for 0.2 m; the robot at 's', the target at 'g'.
    fn world(rows: &[&str]) -> (CertaintyGrid, Pose, (f64, f64)) {
        let at = |r: usize, c: usize| (0.2 * c as f64 + 0.1, -0.2 * r as f64 - 0.1);
        let (mut start, mut goal) = ((0.0, 0.0), (0.0, 0.0));
        let middle = at(rows.len() / 2, rows[0].len() / 2);
        let mut grid = CertaintyGrid::new(CertaintyParams::default(), middle.0, middle.1);
        for (r, row) in rows.iter().enumerate() {
            for (c, byte) in row.bytes().enumerate() {
                let (x, y) = at(r, c);
                match byte {
                    b's' => start = (x, y),
                    b'g' => goal = (x, y),
                    b'#' => [-0.05, 0.05].into_iter().for_each(|dx| {
                        grid.stamp(x + dx, y - 0.05);
                        grid.stamp(x + dx, y + 0.05);
                    }),
                    _ => {}
                }
            }
        }
        (grid, Pose::level(start.0, start.1, 0.0), goal)
    }

    fn first_step(rows: &[&str], depth: usize) -> f64 {
        let (grid, pose, goal) = world(rows);
        let params = VfhStarParams {
            depth,
            ..VfhStarParams::default()
        };
        let target = |x: f64, y: f64| (goal.1 - y).atan2(goal.0 - x);
        let steering = VfhStar::new(params).steer(&grid, &pose, &BODY, target, None);
        steering.direction_rad.map_or(f64::NAN, f64::to_degrees)
    }

    /// Two ways around a block: the one that points more to the target ends in a pocket.
    const POCKET: [&str; 21] = [
        "....................................",
        "...###################..............",
        "....................#...............",
        "....................#...............",
        "....................#...............",
        "....................#...............",
        "....................#...............",
        "....................#...............",
        "....................#...............",
        "...........##########.............g.",
        "...........##########...............",
        ".....s.....##########...............",
        "...........##########...............",
        "...........##########...............",
        "....................................",
        "....................................",
        "....................................",
        "....................................",
        "....................................",
        "....................................",
        "....................................",
    ];

    #[test]
    fn looking_ahead_it_does_not_enter_a_pocket() {
        let (blind, seeing) = (first_step(&POCKET, 1), first_step(&POCKET, 5));
        assert!(blind > 20.0, "{blind}");
        assert!(seeing < -20.0, "{seeing}");
    }

    #[test]
    fn depth_one_is_vfh_plus() {
        let (grid, pose, goal) = world(&POCKET);
        let mut window = vec![0; 61 * 61];
        grid.copy_window(pose.x_m, pose.y_m, 61, &mut window);
        let target = (goal.1 - pose.y_m).atan2(goal.0 - pose.x_m);
        let plus = VfhPlus::new(VfhPlusParams::default()).steer(&window, 0.0, target, &BODY, None);
        assert_eq!(plus.direction_rad.map(f64::to_degrees), Some(first_step(&POCKET, 1)));
    }

    proptest! {
        #[test]
        fn it_ends_and_chooses_one_of_vfh_plus_candidates(seed: u64, share in 0.0f64..0.2, heading in -PI..PI) {
            let mut grid = CertaintyGrid::new(CertaintyParams::default(), 0.0, 0.0);
            for i in 0..400u32 {
                let words = crate::random::philox([i, 0, 0, 0], seed);
                let at = |word: u32| 12.0 * crate::random::unit(word) - 6.0;
                if crate::random::unit(words[2]) < share {
                    grid.stamp(at(words[0]), at(words[1]));
                }
            }
            let mut star = VfhStar::new(VfhStarParams::default());
            let body = Body { turn_radius_m: [0.5, 0.5], ..BODY };
            let steering = star.steer(&grid, &Pose::level(0.0, 0.0, heading), &body, |x, y| (-y).atan2(5.0 - x), None);
            prop_assert!(star.expanded() <= star.params().most_nodes);
            let candidates = star.plus().candidates(0.0f64.atan2(5.0));
            match steering.direction_rad {
                Some(direction) => prop_assert!(candidates.iter().any(|candidate| candidate.0 == direction)),
                None => prop_assert!(candidates.is_empty()),
            }
        }
    }
}
