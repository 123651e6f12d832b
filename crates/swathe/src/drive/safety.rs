//! How far the footprint can go: obstacles that the certainty grid holds, and ground that was seen.

use crate::grid::Position;
use crate::local::CertaintyGrid;
use crate::sensor::{Pose, Scan};

use super::params::Shape;

/// Obstacles around the robot, in its body frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Surroundings {
    /// Ahead and left of the body's origin, in metres.
    points: Vec<(f64, f64)>,
    /// How near each may come: the margin, or less when it is nearer already.
    margins: Vec<f64>,
    cell_size_m: f64,
    margin_m: f64,
    /// What it may come to where things are nearer than the margin already.
    least_m: f64,
    reach_m: f64,
}

/// Distance in metres that a stop keeps at least, how much less when things are as near already, and how much nearer it may come
/// then.
const HARD_M: f64 = 0.02;
const SLACK_M: f64 = 0.003;
const CREEP_M: f64 = 0.001;

/// Distance kept from single returns, which are noisy.
const UNSURE_M: f64 = 0.01;

/// Steps in which a way is tried, in metres, or a cell where that is less.
const STEP_M: f64 = 0.12;

/// Seen cells among the eight around one that make it a seen one.
const LEAST_SEEN: usize = 5;

/// Steps of a turn that are tried.
const TURN_STEP_RAD: f64 = 0.06;

impl Surroundings {
    /// Collects the obstacles within reach of a pose.
    pub fn gather(
        &mut self,
        (grid, sure): (&CertaintyGrid, u8),
        pose: &Pose,
        shape: &Shape,
        (reach_m, stopping_m): (f64, f64),
        (margin_m, least_m): (f64, f64),
    ) {
        self.points.clear();
        self.margins.clear();
        self.cell_size_m = grid.params().cell_size_m;
        (self.margin_m, self.least_m) = (margin_m, least_m);
        self.reach_m = reach_m;
        let (sin, cos) = pose.heading_rad.sin_cos();
        let (row, column) = grid.cell_of(pose.x_m, pose.y_m);
        let half = ((reach_m + shape.radius_m) / self.cell_size_m).ceil() as i64;
        let half = half.min(grid.side_cells() as i64 / 2);
        grid.each_sure((row, column), half, sure, |(down, right)| {
            let mut take = |(x_m, y_m): (f64, f64)| {
                let (x_m, y_m) = (x_m - pose.x_m, y_m - pose.y_m);
                self.push(shape, (cos * x_m + sin * y_m, cos * y_m - sin * x_m));
            };
            // Beyond where the robot can stop one place of a cell is enough.
            let (x_m, y_m) = grid.met_at((down, right));
            if (x_m - pose.x_m).hypot(y_m - pose.y_m) < shape.radius_m + 1.0 + stopping_m {
                grid.places_of((down, right), grid.parts_met((down, right)))
                    .for_each(&mut take);
            } else {
                take((x_m, y_m));
            }
        });
    }

    /// Adds places where something was met that the grid is not sure of.
    pub fn add(
        &mut self,
        places: impl Iterator<Item = Position>,
        (grid, sure): (&CertaintyGrid, u8),
        pose: &Pose,
        shape: &Shape,
        reach_m: f64,
    ) {
        let (sin, cos) = pose.heading_rad.sin_cos();
        for Position { x_m, y_m } in places {
            let (dx, dy) = (x_m - pose.x_m, y_m - pose.y_m);
            if !is_within((dx, dy), reach_m) || grid.is_met_at(x_m, y_m, sure) {
                continue;
            }
            self.push(shape, (cos * dx + sin * dy, cos * dy - sin * dx));
            if let Some(margin_m) = self.margins.last_mut() {
                *margin_m = margin_m.min(UNSURE_M);
            }
        }
    }

    fn push(&mut self, shape: &Shape, (ahead_m, left_m): (f64, f64)) {
        let margin_m = self.margin_of(shape, (ahead_m, left_m));
        self.points.push((ahead_m, left_m));
        self.margins.push(margin_m);
    }

    /// Metres from the body's origin to the nearest obstacle.
    pub fn nearest_m(&self) -> f64 {
        self.points
            .iter()
            .map(|&(x, y)| x.hypot(y))
            .fold(f64::INFINITY, f64::min)
    }

    /// Whether the vehicle stays clear of everything when it is told a command for some seconds and then brakes to a stop: it
    /// follows both no faster than it can, so that arcs begin and end as those that it drives now.
    pub fn stays_clear(&self, shape: &Shape, (mut speed, mut turn): (f64, f64), told: (f64, f64), told_s: f64) -> bool {
        const PIECE_S: f64 = 0.05;
        const MOST_PIECES: usize = 200;
        let spin = shape.acceleration_mps2 / shape.half_width_m;
        let ahead_m = speed.abs().max(told.0.abs());
        let hull_m = shape.radius_m + ahead_m * (told_s + PIECE_S) + shape.stopping_m(ahead_m);
        let near: Vec<(f64, f64, f64)> = self
            .points
            .iter()
            .zip(&self.margins)
            .filter(|&(&point, _)| is_within(point, hull_m))
            .map(|(&(x, y), &margin_m)| {
                let beyond_m = (x.abs() - shape.half_length_m).max(y.abs() - shape.half_width_m);
                // What is nearer already may stay as near.
                (x, y, (margin_m.min(HARD_M) - SLACK_M).min(beyond_m - CREEP_M))
            })
            .collect();
        if near.is_empty() {
            return true;
        }
        let (mut x_m, mut y_m, mut heading_rad) = (0.0_f64, 0.0_f64, 0.0_f64);
        // The command ends with a piece of its own: a whole one more of a hard turn would be another arc.
        let told_pieces = (told_s / PIECE_S).ceil();
        let told_piece_s = told_s / told_pieces.max(1.0);
        for piece in 0..MOST_PIECES {
            let brakes = piece as f64 >= told_pieces;
            let piece_s = if brakes { PIECE_S } else { told_piece_s };
            if brakes && speed.abs() < 1e-3 && turn.abs() < 0.05 {
                return true;
            }
            let (to_mps, to_radps) = if brakes {
                // On the same arc.
                let slower = (speed.abs() - shape.braking_mps2 * piece_s).max(0.0);
                (
                    0.0,
                    if speed.abs() > 0.1 {
                        turn * slower / speed.abs()
                    } else {
                        0.0
                    },
                )
            } else {
                told
            };
            let gains = to_mps * speed >= 0.0 && to_mps.abs() > speed.abs();
            let most = piece_s
                * if gains {
                    shape.acceleration_mps2
                } else {
                    shape.braking_mps2
                };
            speed += (to_mps - speed).clamp(-most, most);
            turn += (to_radps - turn).clamp(-spin * piece_s, spin * piece_s);
            let middle_rad = heading_rad + turn * piece_s / 2.0;
            x_m += speed * piece_s * middle_rad.cos();
            y_m += speed * piece_s * middle_rad.sin();
            heading_rad += turn * piece_s;
            let (sin, cos) = heading_rad.sin_cos();
            for &(px, py, margin_m) in &near {
                let (dx, dy) = (px - x_m, py - y_m);
                let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
                if (ahead.abs() - shape.half_length_m).max(left.abs() - shape.half_width_m) < margin_m {
                    return false;
                }
            }
        }
        true
    }

    /// The same after a turn in place.
    pub fn turned(&self, shape: &Shape, turn_rad: f64) -> Self {
        let (sin, cos) = turn_rad.sin_cos();
        let turn = |&(x, y): &(f64, f64)| (cos * x + sin * y, cos * y - sin * x);
        let points: Vec<(f64, f64)> = self.points.iter().map(turn).collect();
        let margins = points.iter().map(|&point| self.margin_of(shape, point)).collect();
        Self {
            points,
            margins,
            ..*self
        }
    }

    /// How near an obstacle may come: what is near already may come a little nearer in a step, but not by less than it is known to.
    fn margin_of(&self, shape: &Shape, (ahead_m, left_m): (f64, f64)) -> f64 {
        let beyond = (ahead_m.abs() - shape.half_length_m).max(left_m.abs() - shape.half_width_m);
        let least_m = (0.3 * self.cell_size_m).min(self.least_m).min(beyond - 1e-4);
        (beyond - 0.2 * self.cell_size_m).max(least_m).min(self.margin_m)
    }

    /// How far around the obstacles are known.
    pub fn reach_m(&self) -> f64 {
        self.reach_m
    }

    /// Metres that the footprint can go along an arc before it meets an obstacle, or ground that was not seen. Curvature is
    /// counter-clockwise per metre of forward way; backwards with `forward` false.
    pub fn free_m(
        &self,
        shape: &Shape,
        curvature_per_m: f64,
        forward: bool,
        reach_m: f64,
        seen: impl Fn(f64, f64) -> bool,
    ) -> f64 {
        let step_m = self.cell_size_m.min(STEP_M);
        let side = if forward { 1.0 } else { -1.0 };
        let steps = (reach_m / step_m).ceil() as usize;
        // Only obstacles that the footprint's circle can reach on this way.
        let hull = shape.radius_m + self.margin_m + reach_m;
        let near = |&&(point, _): &&((f64, f64), f64)| is_within(point, hull);
        let obstacles: Vec<((f64, f64), f64)> = self.points.iter().copied().zip(self.margins.iter().copied()).collect();
        let obstacles: Vec<((f64, f64), f64)> = obstacles.iter().filter(near).copied().collect();
        for k in 1..=steps {
            let way_m = side * k as f64 * step_m;
            let (x, y, turn) = along(curvature_per_m, way_m);
            let (sin, cos) = turn.sin_cos();
            for &((px, py), margin_m) in &obstacles {
                let (dx, dy) = (px - x, py - y);
                if dx * dx + dy * dy > (shape.radius_m + self.margin_m).powi(2) {
                    continue;
                }
                let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
                let beyond = (ahead.abs() - shape.half_length_m).max(left.abs() - shape.half_width_m);
                // What already touches must at least be left behind.
                let leaves = margin_m <= 0.0 && px * side < 0.0 && ahead * side <= px * side + 1e-9;
                if beyond < margin_m.max(0.0) && !leaves {
                    return (k - 1) as f64 * step_m;
                }
            }
            let edge = side * shape.half_length_m;
            let place = |left: f64| (x + cos * edge - sin * left, y + sin * edge + cos * left);
            let is_seen = |left: f64| {
                let (ahead, left) = place(left);
                seen(ahead, left)
            };
            // Behind, mostly only cells tell what was seen: what stands just beside the way may lie in one of them. What lies
            // behind the face of a thing that is known is not to be seen, and that thing is reckoned with.
            let is_open_beside = |side: f64| {
                let (ahead, left) = place(side * (shape.half_width_m + self.cell_size_m));
                let is_face = |&((px, py), _): &((f64, f64), f64)| is_within((px - ahead, py - left), self.cell_size_m);
                seen(ahead, left) || (is_seen(side * shape.half_width_m) && obstacles.iter().any(is_face))
            };
            let is_open = if forward {
                [-1.0, 1.0].into_iter().all(|side| is_seen(side * shape.half_width_m))
            } else {
                [-1.0, 1.0].into_iter().all(is_open_beside)
            };
            if !(is_seen(0.0) && is_open) {
                return (k - 1) as f64 * step_m;
            }
        }
        reach_m
    }

    /// How far the footprint can turn in place towards an angle, in radians with its sign.
    pub fn turn_rad(&self, shape: &Shape, wanted_rad: f64) -> f64 {
        let steps = (wanted_rad.abs() / TURN_STEP_RAD).ceil() as usize;
        let mut free_rad = 0.0;
        for k in 1..=steps {
            let turn = wanted_rad * k as f64 / steps as f64;
            let (sin, cos) = turn.sin_cos();
            for (&(px, py), &margin_m) in self.points.iter().zip(&self.margins) {
                if px * px + py * py > (shape.radius_m + self.margin_m).powi(2) {
                    continue;
                }
                let (ahead, left) = (cos * px + sin * py, cos * py - sin * px);
                let beyond = (ahead.abs() - shape.half_length_m).max(left.abs() - shape.half_width_m);
                // In place half a margin is enough: nothing is approached at speed.
                let enough_m = (0.5 * margin_m).max(margin_m.min(0.3 * self.cell_size_m));
                if beyond < enough_m.max(0.0) {
                    return free_rad;
                }
            }
            free_rad = turn;
        }
        wanted_rad
    }
}

/// Whether a place is no farther away than some metres; in squares, for this is asked of every place in every step.
fn is_within((x_m, y_m): (f64, f64), reach_m: f64) -> bool {
    x_m * x_m + y_m * y_m <= reach_m * reach_m
}

/// Place and turn after some metres of an arc.
pub(super) fn along(curvature_per_m: f64, way_m: f64) -> (f64, f64, f64) {
    let turn = curvature_per_m * way_m;
    if turn.abs() < 1e-6 {
        (way_m, 0.0, turn)
    } else {
        (turn.sin() / curvature_per_m, (1.0 - turn.cos()) / curvature_per_m, turn)
    }
}

/// Whether a place was seen before, as the certainty grid remembers it.
pub(super) fn was_seen(grid: &CertaintyGrid, x_m: f64, y_m: f64) -> bool {
    let (row, column) = grid.cell_of(x_m, y_m);
    let is_seen = |row: i64, column: i64| grid.certainty_of((row, column)).is_some();
    // Beams leave gaps: a cell among seen ones counts, one at their edge does not.
    let around = || (0..9).filter(|k| is_seen(row - 1 + k / 3, column - 1 + k % 3)).count();
    is_seen(row, column) || around() >= LEAST_SEEN
}

/// Whether a place was seen: by the present scan's nearest beams, or before, as the certainty grid remembers it. Where the robot
/// stood counts as seen.
pub(super) struct Sight<'a> {
    pub grid: &'a CertaintyGrid,
    pub pose: &'a Pose,
    pub scan: Option<&'a Scan>,
}

impl Sight<'_> {
    /// Whether a place in the body frame was seen.
    pub fn has(&self, ahead_m: f64, left_m: f64) -> bool {
        self.by_scan(ahead_m, left_m) || self.by_memory(ahead_m, left_m)
    }

    fn by_memory(&self, ahead_m: f64, left_m: f64) -> bool {
        let (sin, cos) = self.pose.heading_rad.sin_cos();
        let x_m = self.pose.x_m + cos * ahead_m - sin * left_m;
        let y_m = self.pose.y_m + sin * ahead_m + cos * left_m;
        was_seen(self.grid, x_m, y_m)
    }

    fn by_scan(&self, ahead_m: f64, left_m: f64) -> bool {
        let Some(scan) = self.scan else { return false };
        let (dx, dy) = (ahead_m - scan.mount.x_m, left_m - scan.mount.y_m);
        let away_m = dx.hypot(dy);
        let beams = scan.ranges_m.len();
        let Some(place) = scan.beam_at(dy.atan2(dx) - scan.mount.heading_rad) else {
            return false;
        };
        let nearest = place.round() as i64;
        (nearest - 1..=nearest + 1).any(|beam| {
            let inside = beam >= 0 && (beam as usize) < beams && (beam as f64 - place).abs() <= 1.01;
            inside
                && scan
                    .beam(beam as usize)
                    .range_m()
                    .is_some_and(|range_m| range_m >= away_m)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::local::CertaintyParams;
    use proptest::prelude::*;

    fn shape() -> Shape {
        Shape {
            half_length_m: 0.5,
            half_width_m: 0.3,
            radius_m: 0.583,
            max_speed_mps: 2.0,
            max_turn_rate_radps: 1.5,
            turn_radius_m: 0.0,
            reaction_s: 0.2,
            braking_friction: 0.6,
            braking_mps2: 1.5,
            acceleration_mps2: 1.0,
        }
    }

    fn around(stamps: &[(f64, f64)]) -> Surroundings {
        let mut grid = CertaintyGrid::new(CertaintyParams::default(), 0.0, 0.0);
        for &(x, y) in stamps {
            grid.stamp(x, y);
        }
        let mut found = Surroundings::default();
        found.gather(
            (&grid, 6),
            &Pose::level(0.0, 0.0, 0.0),
            &shape(),
            (5.0, 1.0),
            (0.1, 0.03),
        );
        found
    }

    #[test]
    fn the_way_ends_before_the_obstacle() {
        let free = around(&[(3.0, 0.0)]).free_m(&shape(), 0.0, true, 5.0, |_, _| true);
        assert!(free > 2.1 && free < 2.45, "{free}");
        // Beside the way nothing is met; backwards neither.
        assert_eq!(around(&[(3.0, 0.6)]).free_m(&shape(), 0.0, true, 5.0, |_, _| true), 5.0);
        assert_eq!(
            around(&[(3.0, 0.0)]).free_m(&shape(), 0.0, false, 5.0, |_, _| true),
            5.0
        );
        // An arc to the left misses it.
        assert_eq!(around(&[(3.0, 0.0)]).free_m(&shape(), 0.5, true, 3.0, |_, _| true), 3.0);
    }

    #[test]
    fn ground_that_was_not_seen_is_not_entered() {
        let free = around(&[]).free_m(&shape(), 0.0, true, 5.0, |x, _| x < 2.0);
        assert!(free > 1.3 && free < 1.55, "{free}");
    }

    #[test]
    fn backwards_ground_beside_the_body_must_have_been_seen_too() {
        // The body is 0.6 m wide, a cell 0.1 m.
        for (seen_m, forward, expected_m) in [
            (0.35, true, 2.0),
            (0.35, false, 0.0),
            (0.45, false, 2.0),
            (0.25, true, 0.0),
        ] {
            let free = around(&[]).free_m(&shape(), 0.0, forward, 2.0, |_, y| y.abs() < seen_m);
            assert_eq!(free, expected_m, "{seen_m} {forward}");
        }
    }

    #[test]
    fn backwards_the_face_of_a_thing_beside_hides_what_need_not_be_seen() {
        // A face along the left side, a cell beyond the body, as far back as 1.5 m: nothing behind it is ever seen.
        let face: Vec<(f64, f64)> = (-15..=10).map(|k| (0.1 * f64::from(k), 0.45)).collect();
        let back_m = |stamps: &[(f64, f64)], seen_m: f64| {
            around(stamps).free_m(&shape(), 0.0, false, 3.0, |_, left| left < seen_m)
        };
        assert_eq!(back_m(&[], 0.35), 0.0);
        let free_m = back_m(&face, 0.35);
        assert!((0.9..=1.15).contains(&free_m), "{free_m}");
        // Ground that the corner itself would enter must have been seen all the same.
        assert_eq!(back_m(&face, 0.25), 0.0);
    }

    #[test]
    fn what_stands_beside_is_left_behind_but_not_run_into() {
        let beside = around(&[(0.3, 0.35)]);
        assert_eq!(beside.free_m(&shape(), 0.0, true, 1.0, |_, _| true), 1.0);
        assert!(beside.free_m(&shape(), 1.0, true, 1.0, |_, _| true) < 1.0);
        assert!(beside.turn_rad(&shape(), 1.5).abs() < 1.0);
    }

    proptest! {
        #[test]
        fn another_obstacle_never_makes_the_way_longer(
            stamps in prop::collection::vec((-3.0f64..4.0, -3.0f64..3.0), 1..8), curvature in -1.0f64..1.0, forward: bool,
        ) {
            let far: Vec<_> = stamps.into_iter().filter(|&(x, y)| x.hypot(y) > 0.9).collect();
            let mut last = f64::INFINITY;
            for count in 0..=far.len() {
                let free = around(&far[..count]).free_m(&shape(), curvature, forward, 3.0, |_, _| true);
                prop_assert!(free <= last);
                last = free;
            }
        }
    }
}
