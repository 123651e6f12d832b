//! What moves: cells in which something came to stand that were seen free all around before. Where they lie and when they came
//! tells how fast and where to; the robot gives way by braking, waiting or backing.

use std::collections::VecDeque;

use crate::local::CertaintyGrid;
use crate::sensor::Pose;

use super::motion::Now;
use super::navigator::Navigator;
use super::params::Shape;
use super::safety::{Sight, along};

/// Seconds for which a trace counts, and for which what was met last is where the thing is.
const TRACE_S: f64 = 2.5;
const LATELY_S: f64 = 0.6;

/// Traces this near to each other, in metres, are of one thing.
const ONE_M: f64 = 0.7;

/// Traces, and cells left behind, from which on a thing counts, and seconds that the traces must span.
const LEAST: usize = 4;
const LEAST_GONE: usize = 3;

/// What comes lies this far before what goes.
const AHEAD_M: f64 = 0.15;
const LEAST_S: f64 = 0.2;

/// Fastest that is believed, in m/s; slower ones than the least stand.
const FASTEST_MPS: f64 = 3.0;
const SLOWEST_MPS: f64 = 0.2;

/// Half the size of a thing that moves, in metres, and the distance kept from it, more with every second ahead.
const HALF_M: f64 = 0.3;
const ROOM_M: f64 = 0.25;
const ROOM_MPS: f64 = 0.1;

/// Seconds that are looked ahead, and how finely.
const AHEAD_S: f64 = 3.0;
const STEP_S: f64 = 0.2;

/// A thing that moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mover {
    pub x_m: f64,
    pub y_m: f64,
    pub east_mps: f64,
    pub north_mps: f64,
}

/// The last traces.
#[derive(Clone, Debug, Default)]
pub(super) struct Movers {
    /// Where and when something came to stand.
    traces: VecDeque<(f64, f64, f64)>,
    /// Where and when something was gone.
    gone: VecDeque<(f64, f64, f64)>,
    pub found: Vec<Mover>,
}

impl Movers {
    pub fn clear(&mut self) {
        self.traces.clear();
        self.gone.clear();
        self.found.clear();
    }

    /// Notes that something came to stand where ground had been seen.
    pub fn came(&mut self, time_s: f64, (x_m, y_m): (f64, f64)) {
        self.traces.push_back((x_m, y_m, time_s));
    }

    /// Notes that something is gone.
    pub fn went(&mut self, time_s: f64, (x_m, y_m): (f64, f64)) {
        self.gone.push_back((x_m, y_m, time_s));
    }

    /// Works out what moves now.
    pub fn work_out(&mut self, time_s: f64, grid: &CertaintyGrid, sure: u8) {
        for traces in [&mut self.traces, &mut self.gone] {
            while traces.front().is_some_and(|&(.., then)| then < time_s - TRACE_S) {
                traces.pop_front();
            }
        }
        self.found.clear();
        if self.gone.len() < LEAST_GONE || self.traces.len() < LEAST {
            return;
        }
        let mut left: Vec<(f64, f64, f64)> = self.traces.iter().copied().collect();
        while let Some(last) = left.pop() {
            let mut one = vec![last];
            let mut k = 0;
            while k < one.len() {
                let (x_m, y_m, _) = one[k];
                k += 1;
                left.retain(|&trace| {
                    let near = (trace.0 - x_m).hypot(trace.1 - y_m) < ONE_M;
                    if near {
                        one.push(trace);
                    }
                    !near
                });
            }
            self.found.extend(mover(&one, &self.gone, time_s, grid, sure));
        }
    }
}

/// What some traces are of: the line through places and times.
fn mover(
    traces: &[(f64, f64, f64)],
    gone: &VecDeque<(f64, f64, f64)>,
    time_s: f64,
    grid: &CertaintyGrid,
    sure: u8,
) -> Option<Mover> {
    let count = traces.len() as f64;
    let latest_s = traces.iter().map(|trace| trace.2).fold(f64::NEG_INFINITY, f64::max);
    let first_s = traces.iter().map(|trace| trace.2).fold(f64::INFINITY, f64::min);
    if traces.len() < LEAST || latest_s - first_s < LEAST_S {
        return None;
    }
    let mean = |of: fn(&(f64, f64, f64)) -> f64| traces.iter().map(of).sum::<f64>() / count;
    let (x_m, y_m, t_s) = (mean(|trace| trace.0), mean(|trace| trace.1), mean(|trace| trace.2));
    let spread = traces.iter().map(|trace| (trace.2 - t_s).powi(2)).sum::<f64>();
    let slope = |of: fn(&(f64, f64, f64)) -> f64, middle: f64| {
        traces
            .iter()
            .map(|trace| (trace.2 - t_s) * (of(trace) - middle))
            .sum::<f64>()
            / spread
    };
    let (east_mps, north_mps) = (slope(|trace| trace.0, x_m), slope(|trace| trace.1, y_m));
    let speed_mps = east_mps.hypot(north_mps);
    if !(SLOWEST_MPS..=FASTEST_MPS).contains(&speed_mps) {
        return None;
    }
    // What stands leaves nothing behind; what only flickers is gone where it comes.
    let left: Vec<_> = gone
        .iter()
        .filter(|left| {
            traces
                .iter()
                .any(|trace| (trace.0 - left.0).hypot(trace.1 - left.1) < ONE_M)
        })
        .collect();
    if left.len() < LEAST_GONE {
        return None;
    }
    let few = left.len() as f64;
    let (left_x_m, left_y_m) = (
        left.iter().map(|left| left.0).sum::<f64>() / few,
        left.iter().map(|left| left.1).sum::<f64>() / few,
    );
    let ahead_m = ((x_m - left_x_m) * east_mps + (y_m - left_y_m) * north_mps) / speed_mps;
    if ahead_m < AHEAD_M {
        return None;
    }
    // What has gone again is not there any more.
    let still = traces
        .iter()
        .any(|&(x_m, y_m, _)| grid.certainty_at(x_m, y_m).is_some_and(|certainty| certainty >= sure));
    if !still {
        return None;
    }
    let lately: Vec<&(f64, f64, f64)> = traces.iter().filter(|trace| trace.2 >= latest_s - LATELY_S).collect();
    let few = lately.len() as f64;
    let at_s = lately.iter().map(|trace| trace.2).sum::<f64>() / few;
    // The traces are its front: the middle follows.
    let back = HALF_M / speed_mps;
    let since_s = (time_s - at_s).min(1.0) - back.min(1.0);
    Some(Mover {
        x_m: lately.iter().map(|trace| trace.0).sum::<f64>() / few + east_mps * since_s,
        y_m: lately.iter().map(|trace| trace.1).sum::<f64>() / few + north_mps * since_s,
        east_mps,
        north_mps,
    })
}

/// Seconds until the footprint comes too near to what moves on an arc at a speed, and the least room on the way.
fn room(movers: &[Mover], shape: &Shape, pose: &Pose, (speed_mps, curvature): (f64, f64)) -> (f64, f64) {
    let (mut least_m, mut until_s) = (f64::INFINITY, f64::INFINITY);
    let (sin, cos) = pose.heading_rad.sin_cos();
    for k in 0..=(AHEAD_S / STEP_S) as usize {
        let time_s = k as f64 * STEP_S;
        let (ahead, left, turn) = along(curvature, speed_mps * time_s);
        let (x_m, y_m) = (pose.x_m + cos * ahead - sin * left, pose.y_m + sin * ahead + cos * left);
        let (sin, cos) = (pose.heading_rad + turn).sin_cos();
        for mover in movers {
            let (dx, dy) = (
                mover.x_m + mover.east_mps * time_s - x_m,
                mover.y_m + mover.north_mps * time_s - y_m,
            );
            let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
            let beyond_m = (ahead.abs() - shape.half_length_m)
                .max(0.0)
                .hypot((left.abs() - shape.half_width_m).max(0.0));
            let room_m = beyond_m - HALF_M - ROOM_M - ROOM_MPS * time_s;
            least_m = least_m.min(room_m);
            if room_m < 0.0 {
                until_s = until_s.min(time_s);
            }
        }
    }
    (until_s, least_m)
}

impl Navigator {
    /// The command, or another that gives way to what moves.
    pub(super) fn give_way(&mut self, now: &Now, wanted: (f64, f64)) -> (f64, f64) {
        if self.movers.found.is_empty() {
            return wanted;
        }
        let shape = &self.shape;
        let near_m = shape.radius_m + AHEAD_S * (shape.max_speed_mps.min(3.0) + 1.0) + 1.0;
        let movers: Vec<Mover> = self
            .movers
            .found
            .iter()
            .copied()
            .filter(|mover| (mover.x_m - now.pose.x_m).hypot(mover.y_m - now.pose.y_m) < near_m)
            .collect();
        if movers.is_empty() {
            return wanted;
        }
        let curvature = if wanted.0.abs() > 0.01 {
            wanted.1 / wanted.0
        } else {
            0.0
        };
        // No faster than it drives: what it may reach is looked at again in the next step.
        let speed_mps = wanted.0.signum() * wanted.0.abs().min(now.speed_mps.abs() + 0.4);
        let (until_s, _) = room(&movers, shape, &now.pose, (speed_mps, curvature));
        if until_s.is_infinite() {
            return wanted;
        }
        let (stands_s, stands_m) = room(&movers, shape, &now.pose, (0.0, 0.0));
        if stands_s.is_infinite() || stands_s > 2.5 {
            // Slower, or wait until it has passed.
            for share in [0.6, 0.3] {
                let slow = share * speed_mps;
                if room(&movers, shape, &now.pose, (slow, curvature)).0.is_infinite() {
                    return (slow, slow * curvature);
                }
            }
            return (0.0, 0.0);
        }
        // It comes this way: out of it by whichever arc leaves the most room.
        let sight = Sight {
            grid: &self.grid,
            pose: &now.pose,
            scan: now.scan,
        };
        let bend = if shape.turns_in_place() {
            1.0 / shape.radius_m.max(0.4)
        } else {
            1.0 / shape.turn_radius_m
        };
        let most_mps = (0.6 * shape.max_speed_mps).clamp(0.3_f64.min(shape.max_speed_mps), 1.2);
        let mut best = ((0.0, 0.0), stands_s.min(AHEAD_S), stands_m);
        for side in [1.0, -1.0] {
            for curvature in [0.0, bend, -bend, 0.5 * bend, -0.5 * bend] {
                let free_m = self
                    .around
                    .free_m(shape, curvature, side > 0.0, 2.0, |ahead_m, left_m| {
                        sight.has(ahead_m, left_m)
                    });
                let braking_mps2 = self.braking_mps2(&now.pose, side > 0.0);
                let free_m = free_m.min(self.allowed_m(&now.pose, curvature, side > 0.0, 2.0));
                let speed_mps = shape
                    .speed_for(free_m - 0.05, braking_mps2, now.age_s + now.step_s.min(0.5))
                    .min(most_mps);
                if speed_mps < 0.1 {
                    continue;
                }
                // Where it must stop again counts.
                let mean_mps = side * speed_mps.min(free_m / AHEAD_S);
                let (until_s, least_m) = room(&movers, shape, &now.pose, (mean_mps, curvature));
                let until_s = until_s.min(AHEAD_S);
                if until_s > best.1 + 0.1 || (until_s >= best.1 && least_m > best.2 + 0.02) {
                    best = ((side * speed_mps, side * speed_mps * curvature), until_s, least_m);
                }
            }
        }
        best.0
    }
}
