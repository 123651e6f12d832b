//! The last recovery: along whatever stands in the way with one side to it, until the straight line from where that began to
//! the goal is met again nearer to the goal. Bug-2 of Lumelsky and Stepanov, "Path-planning strategies for a point mobile
//! automaton moving amidst unknown obstacles of arbitrary shape", Algorithmica 2, 1987.
//!
//! It needs no memory and no route: it also leads out where these are wrong.

use crate::grid::Position;

use super::event::Recovery;
use super::motion::Now;
use super::navigator::Navigator;
use super::safety::Sight;

/// Metres after which a walk along a wall is given up.
const MOST_M: f64 = 300.0;

/// Nearer to the goal by this much than at the beginning, the line to the goal may be followed again.
const GAIN_M: f64 = 0.5;

/// Seconds without a way on after which a walk is given up.
const BLOCKED_S: f64 = 3.0;

/// Arcs that are tried, from towards the wall to away from it, as shares of the tightest.
const ARCS: [f64; 8] = [1.0, 0.6, 0.3, 0.0, -0.3, -0.6, -1.0, -2.0];

/// How a walk along a wall goes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Walk {
    last: Option<Position>,
    gone_m: f64,
    /// How far away from its beginning it has been.
    farthest_m: f64,
    /// Distance to the goal at the beginning of the last walk: another must begin nearer.
    began_m: Option<f64>,
    blocked_since_s: Option<f64>,
}

/// What a step along a wall says.
pub(super) enum Along {
    /// The walk goes on with a speed and a turn rate.
    On((f64, f64)),
    /// The line to the goal is met: it has led past the wall.
    Left,
    /// It does not lead out.
    Lost,
}

impl Navigator {
    /// The walk that may begin here; `None` when one that began no farther from the goal did not lead out.
    pub(super) fn wall_walk(&mut self, now: &Now) -> Option<Recovery> {
        let from = now.at();
        let away_m = from.distance_m(now.aim);
        if !self.params.follow_walls || self.walk.began_m.is_some_and(|began_m| away_m > began_m - GAIN_M) {
            return None;
        }
        self.walk = Walk {
            began_m: Some(away_m),
            ..Walk::default()
        };
        // The wall stays on the side to which the goal would have the robot turn.
        let on_left = now.off_rad() >= 0.0;
        Some(Recovery::FollowWall { from, on_left })
    }

    /// Walks on along a wall.
    pub(super) fn along_wall(&mut self, now: &Now, from: Position, on_left: bool) -> Along {
        let at = now.at();
        let (walk, goal) = (&mut self.walk, now.aim);
        walk.gone_m += walk.last.replace(at).map_or(0.0, |last| last.distance_m(at));
        walk.farthest_m = walk.farthest_m.max(at.distance_m(from));
        let near_m = self.shape.radius_m.max(0.3);
        if at.distance_to_segment_m(from, goal) < near_m && at.distance_m(goal) < from.distance_m(goal) - GAIN_M {
            return Along::Left;
        }
        let is_around = walk.farthest_m > 4.0 * near_m && at.distance_m(from) < near_m;
        let is_blocked = walk.blocked_since_s.is_some_and(|since| now.time_s - since > BLOCKED_S);
        if is_around || is_blocked || walk.gone_m > MOST_M || self.watch.is_held() {
            return Along::Lost;
        }
        let shape = &self.shape;
        let side = if on_left { 1.0 } else { -1.0 };
        let tightest_m = (shape.radius_m + self.params.margin_m + 0.25).max(shape.turn_radius_m);
        let sight = Sight {
            grid: &self.grid,
            pose: &now.pose,
            scan: now.scan,
        };
        let needed_m = 2.0 * shape.radius_m + 0.3;
        let is_free = |curvature: f64| {
            let seen = |ahead_m: f64, left_m: f64| sight.has(ahead_m, left_m);
            self.around.free_m(shape, curvature, true, needed_m, seen) >= needed_m
        };
        let mut arcs = ARCS
            .iter()
            .filter(|&&share| share >= -1.0 || shape.turns_in_place())
            .map(|share| side * share / tightest_m);
        let free = arcs.find(|&curvature| is_free(curvature));
        if let Some(curvature) = free {
            let speed_mps = self.safe_mps(now, curvature, true).min(self.careful_mps());
            let told = self.guarded(now, (speed_mps, curvature * speed_mps));
            if told != (0.0, 0.0) {
                self.walk.blocked_since_s = None;
                return Along::On(told);
            }
        }
        // Away from the wall in place, where the footprint is free to.
        let away_rad = -side * 0.6;
        if shape.turns_in_place() && self.around.turn_rad(shape, away_rad).abs() >= 0.1 {
            let told = self.guarded(now, (0.0, -side * 0.5 * shape.max_turn_rate_radps));
            if told != (0.0, 0.0) {
                self.walk.blocked_since_s = None;
                return Along::On(told);
            }
        }
        self.walk.blocked_since_s.get_or_insert(now.time_s);
        Along::On((0.0, 0.0))
    }
}
