//! Along a way of the footprint, leg by leg, each step of it as safe as any other.

use crate::grid::Position;
use crate::sensor::wrap;

use super::event::Recovery;
use super::motion::{Now, ROLLS_MPS, TURN_LOOK_RAD};
use super::navigator::Navigator;
use super::params::REST_MPS;
use super::safety::Sight;
use super::thread::{Effort, Leg, Search, Threading, on_run};

/// Distance kept from obstacles on such a way at rest, in metres.
pub(super) const THREAD_MARGIN_M: f64 = 0.03;

/// And from what is nearer already: less than the search keeps, or its ways could not be begun.
pub(super) const THREAD_LEAST_M: f64 = 0.018;

/// Share of the greatest speed on such a way, and where there is room to turn on the spot and this much more.
const SHARE: f64 = 0.4;
const WIDE_SHARE: f64 = 0.8;
const WIDE_MPS: f64 = 3.0;
const WIDE_M: f64 = 0.15;

/// Widest turn that is driven on the way, where there is room, instead of on the spot.
const BEND_RAD: f64 = 0.7;
/// Farther beside a run than this a vehicle that turns in place stops, and another way is searched; farther off its heading it
/// stops and turns back to it.
const STRAY_M: f64 = 0.6;
const STRAY_RAD: f64 = 1.0;

/// Distance kept before an obstacle on a leg, and so by a vehicle with a turning circle that backs.
const KEEP_M: f64 = 0.02;
const BACK_KEEP_M: f64 = 0.15;

/// Longest way over which the wheels of a vehicle with a turning circle go from one arc to the next, the share of the brakes that
/// is used to be slow enough for it, and how far ahead it is looked for.
const CHANGE_M: f64 = 0.6;
const CHANGE_SHARE: f64 = 0.3;
const CHANGE_LOOK_M: f64 = 6.0;

/// A heading that is off by less is that of the leg; a place by less, its end.
const TURNED_RAD: f64 = 0.03;
const THERE_M: f64 = 0.02;

/// Seconds without a step forward after which another way is searched, and how often in a row.
const BLOCKED_S: f64 = 0.7;
const MOST_SEARCHES: u32 = 6;

/// Metres on such a way after which it counts as one that leads somewhere.
const HEADWAY_M: f64 = 1.0;

/// The usual way is as good when it is at most this much longer.
const AS_GOOD: f64 = 1.3;
const AS_GOOD_M: f64 = 1.0;

/// Seconds after which a search that found nothing is worth another, doubled with each in a row.
const AGAIN_S: f64 = 4.0;
const MOST_DOUBLINGS: u32 = 6;

/// A way of the footprint that is being searched or driven.
#[derive(Debug, Default)]
pub(super) struct Thread {
    search: Option<Box<Search>>,
    legs: Vec<Leg>,
    leg: usize,
    effort: Effort,
    blocked_since_s: Option<f64>,
    searches: u32,
    /// Where the last search began.
    searched_at: Option<Position>,
    failed_s: Option<f64>,
    /// How many in a row came to nothing without headway, and whether the last saw the goal closed in.
    failures: u32,
    pub(super) goal_closed: bool,
    /// Where it began, and after how many metres the usual way is tried again: longer each time.
    from: Option<Position>,
    leave_m: f64,
}

/// How an arc is to be steered.
struct Led {
    curvature_per_m: f64,
    speed_mps: f64,
}

/// What a step on such a way says.
pub(super) enum Threaded {
    On((f64, f64)),
    Done,
    Lost,
}

impl Navigator {
    /// Whether a way of the footprint may be searched: not again right after nothing was found.
    pub(super) fn may_thread(&self, time_s: f64) -> bool {
        self.params.memory
            && self.thread.failed_s.is_none_or(|failed| {
                let wait_s = AGAIN_S * f64::from(1 << self.thread.failures.saturating_sub(1).min(MOST_DOUBLINGS));
                time_s - failed > wait_s
            })
    }

    /// The recovery that searches and drives one.
    pub(super) fn begin_thread(&mut self, at: Position) -> Recovery {
        let least_m = (6.0 * self.shape.radius_m).max(3.0);
        let leave_m = if self.thread.leave_m > 0.0 {
            2.0 * self.thread.leave_m
        } else {
            least_m
        };
        self.thread = Thread {
            from: Some(at),
            leave_m,
            searched_at: self.thread.searched_at,
            failed_s: self.thread.failed_s,
            failures: self.thread.failures,
            goal_closed: self.thread.goal_closed,
            ..Thread::default()
        };
        Recovery::Thread
    }

    /// Searches on, or drives on.
    pub(super) fn thread_on(&mut self, now: &Now) -> Threaded {
        if self.thread.search.is_some() || self.thread.leg >= self.thread.legs.len() {
            return self.search_on(now);
        }
        // What no sensor sees holds the robot: off this way that is noticed, and remembered for the next.
        if self.watch.is_held() {
            return Threaded::Lost;
        }
        let at = now.at();
        let left_behind = self
            .thread
            .from
            .is_some_and(|from| from.distance_m(at) > self.thread.leave_m);
        let rest_m: f64 = self.thread.legs[self.thread.leg..].iter().map(Leg::length_m).sum();
        let is_as_good = self.window.as_ref().is_some_and(|window| {
            let is_short = !window.goal_inside || window.length_m() <= AS_GOOD * rest_m + AS_GOOD_M;
            window.is_open(at) && !window.way.is_empty() && is_short
        });
        if left_behind && is_as_good {
            return Threaded::Done;
        }
        // What would not be safe blocks as what stands in the way does.
        let told = self.on_leg(now);
        let wanted = self.guarded(now, told);
        if wanted == (0.0, 0.0) && now.speed_mps.abs() < ROLLS_MPS {
            let since_s = *self.thread.blocked_since_s.get_or_insert(now.time_s);
            if now.time_s - since_s > BLOCKED_S {
                self.thread.legs.clear();
                self.thread.blocked_since_s = None;
            }
        } else {
            self.thread.blocked_since_s = None;
        }
        Threaded::On(wanted)
    }

    fn search_on(&mut self, now: &Now) -> Threaded {
        if now.speed_mps.abs() > REST_MPS {
            return Threaded::On((0.0, 0.0));
        }
        if self.thread.search.is_none() {
            if self.thread.searches >= MOST_SEARCHES {
                self.thread.failed_s = Some(now.time_s);
                self.thread.failures += 1;
                return Threaded::Lost;
            }
            let gets_on = |then: Position| then.distance_m(now.at()) > HEADWAY_M;
            if self.thread.searched_at.is_some_and(gets_on) {
                self.thread.searches = 0;
                self.thread.failures = 0;
            }
            self.thread.searched_at = Some(now.at());
            self.thread.searches += 1;
            self.thread.legs.clear();
            let near_goal_m = 0.7 * self.params.arrival_m;
            self.thread.search = Some(Box::new(Search::new(
                (&self.met, &self.memory, &self.grid),
                &self.shape,
                &now.pose,
                (now.aim, near_goal_m),
                self.thread.effort,
            )));
            return Threaded::On((0.0, 0.0));
        }
        let Some(search) = &mut self.thread.search else {
            return Threaded::Lost;
        };
        match search.go_on() {
            Threading::On => Threaded::On((0.0, 0.0)),
            Threading::Found(legs) => {
                self.thread.search = None;
                self.thread.goal_closed = false;
                self.thread.legs = legs;
                self.thread.leg = 0;
                if self.thread.legs.is_empty() {
                    Threaded::Done
                } else {
                    Threaded::On((0.0, 0.0))
                }
            }
            Threading::Nothing { .. } if self.thread.effort != Effort::Tight => {
                self.thread.search = None;
                self.thread.effort = match self.thread.effort {
                    Effort::Usual => Effort::Wide,
                    Effort::Wide | Effort::Tight => Effort::Tight,
                };
                Threaded::On((0.0, 0.0))
            }
            Threading::Nothing { goal_closed } => {
                self.thread.search = None;
                self.thread.failed_s = Some(now.time_s);
                self.thread.failures += 1;
                self.thread.goal_closed = goal_closed;
                Threaded::Lost
            }
        }
    }

    fn on_leg(&mut self, now: &Now) -> (f64, f64) {
        let is_wide = self.is_wide();
        while let Some(&leg) = self.thread.legs.get(self.thread.leg) {
            let wanted = match leg {
                Leg::Turn { to_rad } if is_wide && self.is_bend(now, to_rad) => None,
                Leg::Turn { to_rad } => self.turn_to(now, to_rad),
                Leg::Run {
                    from,
                    curvature_per_m,
                    length_m,
                } => self.run(now, from, curvature_per_m, length_m),
            };
            match wanted {
                Some(wanted) => return wanted,
                None => self.thread.leg += 1,
            }
        }
        (0.0, 0.0)
    }

    /// Whether there is room to turn on the spot, and more.
    fn is_wide(&self) -> bool {
        self.around.nearest_m() > self.shape.radius_m + WIDE_M
    }

    /// Whether a turn leads on in the direction of travel, so little that it is driven in passing.
    fn is_bend(&self, now: &Now, to_rad: f64) -> bool {
        let next = self.thread.legs.get(self.thread.leg + 1);
        let goes_on = matches!(next, Some(Leg::Run { length_m, .. })
            if now.speed_mps.abs() < ROLLS_MPS || now.speed_mps * length_m > 0.0);
        goes_on && wrap(to_rad - now.pose.heading_rad).abs() < BEND_RAD
    }

    /// Turns to a heading; `None` when it is turned.
    fn turn_to(&self, now: &Now, to_rad: f64) -> Option<(f64, f64)> {
        let off_rad = wrap(to_rad - now.pose.heading_rad);
        if off_rad.abs() < TURNED_RAD {
            return None;
        }
        if now.speed_mps.abs() > ROLLS_MPS {
            return Some((0.0, 0.0));
        }
        let free_rad = self
            .free_turn_rad(now, off_rad.clamp(-TURN_LOOK_RAD, TURN_LOOK_RAD))
            .abs();
        if free_rad < 0.03_f64.min(off_rad.abs()) {
            return Some((0.0, 0.0));
        }
        let most = (0.6 * self.shape.max_turn_rate_radps)
            .min(self.turn_rate_within(free_rad, now))
            .max(0.05);
        Some((0.0, (2.0 * off_rad).clamp(-most, most)))
    }

    /// The curvature to steer on an arc, and how fast: the next arc is begun half a change before this one ends, as the turn rate
    /// takes time to follow.
    fn led(&self, now: &Now, curvature_per_m: f64, length_m: f64, rest_m: f64) -> Led {
        let shape = &self.shape;
        let mut led = Led {
            curvature_per_m,
            speed_mps: shape.max_speed_mps,
        };
        if shape.turns_in_place() {
            return led;
        }
        let spin_radps2 = shape.acceleration_mps2 / shape.half_width_m;
        let mut ahead_m = rest_m;
        let mut before_per_m = curvature_per_m;
        for leg in &self.thread.legs[(self.thread.leg + 1).min(self.thread.legs.len())..] {
            let &Leg::Run {
                curvature_per_m: next_per_m,
                length_m: next_m,
                ..
            } = leg
            else {
                break;
            };
            if next_m * length_m < 0.0 || ahead_m > CHANGE_LOOK_M {
                break;
            }
            let change_per_m = (next_per_m - before_per_m).abs();
            if change_per_m > 1e-6 {
                let calm_mps = (spin_radps2 * CHANGE_M / change_per_m).sqrt();
                let braking_mps2 = CHANGE_SHARE * shape.braking_mps2;
                led.speed_mps = led
                    .speed_mps
                    .min((calm_mps * calm_mps + 2.0 * braking_mps2 * ahead_m).sqrt());
                let lead_m = 0.5 * now.speed_mps * now.speed_mps * change_per_m / spin_radps2;
                if ahead_m < lead_m {
                    led.curvature_per_m = next_per_m;
                }
            }
            before_per_m = next_per_m;
            ahead_m += next_m.abs();
        }
        led
    }

    /// Drives an arc; `None` at its end.
    fn run(&self, now: &Now, from: (f64, f64, f64), curvature: f64, length_m: f64) -> Option<(f64, f64)> {
        let shape = &self.shape;
        let backs = length_m < 0.0;
        let (along_m, left_m, off_rad) = on_run(&now.pose, from, curvature, backs);
        let rest_m = length_m.abs() - along_m;
        if rest_m < THERE_M {
            return None;
        }
        // Steered back from far off it would drive around in circles.
        if shape.turns_in_place() && left_m.abs() > STRAY_M {
            return Some((0.0, 0.0));
        }
        if shape.turns_in_place() && off_rad.abs() > STRAY_RAD {
            return self
                .turn_to(now, wrap(now.pose.heading_rad + off_rad))
                .or(Some((0.0, 0.0)));
        }
        let within_m = (0.6 * shape.radius_m).max(0.25);
        let side = if backs { -1.0 } else { 1.0 };
        let led = self.led(now, curvature, length_m, rest_m);
        let steered = led.curvature_per_m + side * 2.0 * off_rad / within_m - left_m / (within_m * within_m);
        let tightest = if shape.turns_in_place() {
            1.0 / within_m
        } else {
            1.0 / shape.turn_radius_m
        };
        let steered = steered.clamp(-tightest, tightest);
        let braking_mps2 = self.braking_mps2(&now.pose, !backs);
        let is_wide = self.is_wide();
        let after = &self.thread.legs[(self.thread.leg + 1).min(self.thread.legs.len())..];
        let goes_on = match after {
            [Leg::Run { length_m: next_m, .. }, ..] => next_m * length_m > 0.0,
            [Leg::Turn { to_rad }, Leg::Run { length_m: next_m, .. }, ..] => {
                is_wide && next_m * length_m > 0.0 && wrap(to_rad - now.pose.heading_rad).abs() < BEND_RAD
            }
            _ => false,
        };
        let sight = Sight {
            grid: &self.grid,
            pose: &now.pose,
            scan: now.scan,
        };
        let reach_m = shape.stopping_m(now.speed_mps.abs().max(self.last_command.speed_mps.abs()) + 0.2) + 0.5;
        let free_m = self.around.free_m(shape, steered, !backs, reach_m, |ahead_m, aside_m| {
            sight.has(ahead_m, aside_m)
        });
        let free_m = free_m.min(self.allowed_m(&now.pose, steered, !backs, reach_m));
        let delay_s = now.age_s + now.step_s.min(0.5);
        let least_mps = (SHARE * shape.max_speed_mps).min(0.5 + 0.5 * shape.radius_m);
        let room_m = self.around.nearest_m() - shape.half_width_m.min(shape.half_length_m);
        let share = (room_m / shape.radius_m).clamp(0.0, 1.0);
        let calm_mps = least_mps + share * ((WIDE_SHARE * shape.max_speed_mps).min(WIDE_MPS) - least_mps).max(0.0);
        let calm_mps = calm_mps * if backs { 0.5 } else { 1.0 };
        // Backwards it keeps away from corners that were seen from one side, unless it would not get on otherwise.
        let keeps_m = if backs && !shape.turns_in_place() && self.thread.searches < 2 {
            BACK_KEEP_M
        } else {
            KEEP_M
        };
        let mut speed_mps = calm_mps
            .min(led.speed_mps)
            .min(shape.speed_for(free_m - keeps_m, braking_mps2, delay_s));
        if !goes_on {
            speed_mps = speed_mps.min(shape.speed_for(rest_m, 0.5 * braking_mps2, delay_s) + 0.03);
        }
        if free_m <= 0.0 || speed_mps < 0.01 {
            return Some((0.0, 0.0));
        }
        Some((side * speed_mps, side * speed_mps * steered))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::tests::world::{World, pioneer};
    use crate::drive::{DriveParams, Observation};
    use crate::sensor::{Mount, Pose};
    use rstest::rstest;
    use std::f64::consts::PI;

    const STEP_S: f64 = 1.0 / 35.0;

    #[rstest]
    fn a_run_is_driven_to_its_end_or_given_up_without_circling(
        #[values(-2.6, -1.5, -0.4, 0.4, 1.5, 2.6)] heading_rad: f64,
        #[values(-2.5, -1.2, -0.2, 0.3, 1.8)] left_m: f64,
        #[values(-4.0, 0.0, 4.0)] turns_radps: f64,
    ) {
        let world = World::with_walls(&[&[(14.0, -8.0), (14.0, 8.0)]]);
        let mut navigator = Navigator::new(&pioneer(), Position::new(12.0, 0.0), None, DriveParams::default()).unwrap();
        let mut pose = Pose::level(0.0, left_m, heading_rad);
        let (mut speed_mps, mut turn_radps, mut turned_rad) = (1.0_f64, turns_radps, 0.0);
        let end_s = (0..35 * 30).find_map(|k| {
            if k == 1 {
                navigator.recovery = Some(Recovery::Thread);
                navigator.thread.leave_m = f64::INFINITY;
                navigator.thread.legs = vec![Leg::Run {
                    from: (0.0, 0.0, 0.0),
                    curvature_per_m: 0.0,
                    length_m: 6.0,
                }];
            }
            let scan = world.scan(&pose, Mount::default(), 361, 2.0 * PI, 10.0);
            let command = navigator.step(&Observation {
                time_s: f64::from(k) * STEP_S,
                pose,
                speed_mps,
                turn_rate_radps: turn_radps,
                scan: Some(&scan),
                reading: None,
            });
            // As fast as its wheels can: 2 m/s², 0.2 m aside.
            speed_mps += (command.speed_mps - speed_mps).clamp(-2.0 * STEP_S, 2.0 * STEP_S);
            turn_radps += (command.turn_rate_radps - turn_radps).clamp(-9.0 * STEP_S, 9.0 * STEP_S);
            turned_rad += turn_radps.abs() * STEP_S;
            let (sin, cos) = pose.heading_rad.sin_cos();
            pose = Pose::level(
                pose.x_m + speed_mps * STEP_S * cos,
                pose.y_m + speed_mps * STEP_S * sin,
                wrap(pose.heading_rad + turn_radps * STEP_S),
            );
            let is_over = pose.x_m > 5.9 || (k > 1 && navigator.thread.legs.is_empty());
            is_over.then_some(f64::from(k) * STEP_S)
        });
        assert!(
            end_s.is_some() && turned_rad < 2.5 * PI,
            "{end_s:?} {turned_rad} {pose:?}"
        );
        let is_given_up = navigator.thread.legs.is_empty();
        assert!(is_given_up || (left_m.abs() < 1.0 && pose.y_m.abs() < 0.2), "{pose:?}");
    }
}
