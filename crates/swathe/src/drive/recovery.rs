//! Out of trouble: what counts as trouble, and the explicit states that lead out of it.

use std::f64::consts::{PI, TAU};

use crate::grid::Position;
use crate::sensor::wrap;

use super::event::{Event, Reason, Recovery, Status};
use super::follow::Threaded;
use super::memory::Seen;
use super::motion::{Now, ROLLS_MPS, TURN_LOOK_RAD};
use super::navigator::Navigator;
use super::region::RegionState;
use super::route::Standing;
use super::safety::Sight;
use super::wall::Along;

/// How much larger than at first the window of the route may become, along a side.
const WINDOW_GROWTH: usize = 4;

/// All recoveries of a drive, as a multiple of those without headway.
const ALL_RECOVERIES: u32 = 10;

/// Poses that were corrected by this much lately may have put things to where they are not.
const DOUBTFUL_M: f64 = 0.02;

/// Off the nose by this much, the way does not lead through the place before it.
const STAMP_RAD: f64 = 0.8;

/// Seconds of driving carefully after a slip.
const SLIP_CARE_S: f64 = 3.0;

/// Share of the wheels' way whose loss means that the robot is stuck.
const STUCK_SHARE: f64 = 0.9;

impl Navigator {
    /// Looks at the ground under the robot: no-go ground is left for the nearest safe nest, or the drive ends.
    pub(super) fn own_ground(&mut self, at: Position) -> Option<Reason> {
        let region = self.region.as_mut()?;
        region.note(at);
        if region.leaving_no_go && matches!(self.recovery, Some(Recovery::BackOff { .. })) {
            return None;
        }
        if let Some(Recovery::Retreat { to }) = self.recovery {
            if region.rank(at) != Some(1) && at.distance_m(to) <= self.params.arrival_m.max(self.shape.radius_m) {
                region.leaving_no_go = false;
                self.recovery = None;
                self.window = None;
                self.watch.restart();
                self.lay_global(at);
            }
            return None;
        }
        if region.rank(at) != Some(1) {
            if std::mem::take(&mut region.leaving_no_go) {
                self.window = None;
                self.watch.restart();
                self.lay_global(at);
            }
            return None;
        }
        // Back over ground that has carried it first; what is nearest may lie beyond the worst.
        if self.params.recover
            && !region.leaving_no_go
            && let Some(left_m) = region.way_back_m(at)
        {
            region.leaving_no_go = true;
            self.window = None;
            self.begin(Recovery::BackOff { left_m }, at);
            return None;
        }
        let Some(to) = region.retreat(at) else {
            return Some(Reason::NoSafeNest);
        };
        region.leaving_no_go = true;
        self.window = None;
        self.begin(Recovery::Retreat { to }, at);
        None
    }

    /// What follows when the route is closed: a larger window, a look around, or the answer that there is no way.
    pub(super) fn no_way(&mut self, time_s: f64, at: Position) -> Option<(Status, Reason)> {
        let window = self.window.as_ref()?;
        let reason = match window.standing {
            Standing::Pending | Standing::Found => return None,
            Standing::Enclosed => Reason::Enclosed,
            Standing::GoalBlocked => Reason::GoalBlocked,
        };
        if matches!(
            self.recovery,
            Some(
                Recovery::TurnInPlace { .. }
                    | Recovery::BackOff { .. }
                    | Recovery::Thread
                    | Recovery::FollowWall { .. }
            )
        ) {
            return None;
        }
        if !window.goal_inside && self.grow() {
            return None;
        }
        if self.params.recover && !self.looked_around && self.shape.turns_in_place() {
            self.looked_around = true;
            self.begin(Recovery::TurnInPlace { left_rad: TAU }, at);
            return None;
        }
        if self.params.recover && self.may_thread(time_s) {
            let recovery = self.begin_thread(at);
            self.begin(recovery, at);
            return None;
        }
        let goal = self.goal;
        let off_map = self
            .region
            .as_ref()
            .is_some_and(|region| !matches!(region.rank(goal), Some(rank) if rank != 1));
        let reason = if self.thread.goal_closed {
            Reason::GoalBlocked
        } else {
            reason
        };
        // What closes the goal in was looked at from near by; only a wrong pose can have put it there.
        let is_doubtful = reason == Reason::Enclosed || self.odometry.doubt().place_m > DOUBTFUL_M;
        if !off_map && is_doubtful && self.forget(at) {
            return None;
        }
        if reason == Reason::GoalBlocked {
            // A goal cell that was closed may be open again, or another cell near it may do.
            self.window = None;
        }
        self.blocked_since_s = None;
        self.watch.restart();
        Some((Status::NoRoute, if off_map { Reason::GoalOffMap } else { reason }))
    }

    /// Makes the window of the route larger; false when it is as large as it may be.
    fn grow(&mut self) -> bool {
        if self.window_cells >= WINDOW_GROWTH * self.params.window_cells {
            return false;
        }
        self.window_cells *= 2;
        self.window = None;
        let cells = self.window_cells;
        self.events.push(Event::WindowGrown { cells });
        true
    }

    fn begin(&mut self, recovery: Recovery, at: Position) {
        self.recovery = Some(recovery);
        self.trap_at.get_or_insert(at);
        self.watch.restart();
        self.blocked_since_s = None;
        let attempt = self.attempts;
        self.events.push(Event::Recovery { recovery, attempt });
    }

    /// Goes on with a recovery, or begins one when the drive is in trouble. `None` goes on driving.
    pub(super) fn recover(&mut self, now: &Now) -> Option<((f64, f64), Status, Reason)> {
        match self.recovery {
            Some(Recovery::TurnInPlace { left_rad }) => {
                if let Some(wanted) = self.turn_on(now, left_rad) {
                    return Some((wanted, Status::Recovering, Reason::Trapped));
                }
                self.finish();
            }
            Some(Recovery::BackOff { left_m }) => {
                if let Some(wanted) = self.back_on(now, left_m) {
                    let leaves = self.region.as_ref().is_some_and(|region| region.leaving_no_go);
                    let reason = if leaves { Reason::GroundNoGo } else { Reason::Trapped };
                    return Some((wanted, Status::Recovering, reason));
                }
                self.finish();
            }
            Some(Recovery::Thread) => match self.thread_on(now) {
                Threaded::On(wanted) => return Some((wanted, Status::Recovering, Reason::Trapped)),
                Threaded::Done => {
                    self.attempts = 0;
                    self.trap_at = None;
                    self.finish();
                }
                Threaded::Lost => self.finish(),
            },
            Some(Recovery::FollowWall { from, on_left }) => match self.along_wall(now, from, on_left) {
                Along::On(wanted) => return Some((wanted, Status::Recovering, Reason::Trapped)),
                Along::Left => {
                    self.attempts = 0;
                    self.trap_at = None;
                    self.finish();
                }
                Along::Lost => return Some(self.give_up(now.at())),
            },
            Some(Recovery::Retreat { .. } | Recovery::Forget) | None => {}
        }
        let reason = self.trouble(now)?;
        self.events.push(Event::Trap { reason });
        self.attempts += 1;
        self.all_attempts += 1;
        let most = self.params.most_recoveries;
        if self.attempts > most || self.all_attempts > most.saturating_mul(ALL_RECOVERIES) {
            let Some(walk) = self.wall_walk(now) else {
                return Some(self.give_up(now.at()));
            };
            self.begin(walk, now.at());
            return Some(((0.0, 0.0), Status::Recovering, reason));
        }
        self.choose(now, reason);
        Some(((0.0, 0.0), Status::Recovering, reason))
    }

    fn give_up(&mut self, at: Position) -> ((f64, f64), Status, Reason) {
        if self.forget(at) {
            return ((0.0, 0.0), Status::Recovering, Reason::Trapped);
        }
        self.end = Some((Status::Stopped, Reason::RecoveriesSpent));
        ((0.0, 0.0), Status::Stopped, Reason::RecoveriesSpent)
    }

    /// Whether the drive is in trouble, and in which.
    fn trouble(&mut self, now: &Now) -> Option<Reason> {
        if let Some(share) = self.watch.slip() {
            if now.time_s >= self.slip_until_s {
                self.events.push(Event::Slip { share });
                self.slip_until_s = now.time_s + SLIP_CARE_S;
            }
            if share >= STUCK_SHARE {
                return Some(Reason::Slipping);
            }
        }
        if self.watch.is_held() {
            return Some(Reason::Bumped);
        }
        if self.is_blocked(now.time_s) || self.circles(now) {
            return Some(Reason::Trapped);
        }
        let near_m = (1.5 * self.shape.radius_m).clamp(0.5, 2.0);
        self.watch.trap(self.params.trap_s - 0.2, near_m)
    }

    /// Whether a vehicle with a turning circle would drive around its goal for ever: the goal lies well inside that circle.
    fn circles(&self, now: &Now) -> bool {
        let radius_m = self.shape.turn_radius_m;
        let (away_m, off_rad) = (now.at().distance_m(now.aim), now.off_rad());
        let (ahead_m, left_m) = (away_m * off_rad.cos(), away_m * off_rad.sin());
        ahead_m.hypot(left_m.abs() - radius_m) < radius_m - self.params.arrival_m
    }

    /// Begins the recovery that suits the trouble and what was tried before.
    fn choose(&mut self, now: &Now, reason: Reason) {
        let at = now.at();
        let back_m = (2.0 * self.shape.radius_m).max(0.8) * (1.0 + 0.25 * f64::from(self.attempts.min(8)));
        let backs = Recovery::BackOff { left_m: back_m };
        if self.circles(now) {
            // Straight back until the goal lies on the circle, and a little more to turn in.
            let (radius_m, off_rad) = (self.shape.turn_radius_m, now.off_rad());
            let away_m = at.distance_m(now.aim);
            let (ahead_m, left_m) = (away_m * off_rad.cos(), away_m * off_rad.sin());
            let inside_m = left_m.abs() - radius_m;
            let left_m = (radius_m * radius_m - inside_m * inside_m).max(0.0).sqrt() - ahead_m + 0.5 * radius_m;
            return self.begin(Recovery::BackOff { left_m }, at);
        }
        if matches!(reason, Reason::Bumped | Reason::Slipping) {
            self.stamp_ahead(now);
            self.feel_ahead(now);
            return self.begin(backs, at);
        }
        let goes_round = self.watch.goes_round();
        self.watch.forget_places();
        if (self.attempts >= 2 || goes_round) && self.may_thread(now.time_s) {
            let recovery = self.begin_thread(at);
            return self.begin(recovery, at);
        }
        if self.attempts % 4 == 3 && self.window.as_ref().is_some_and(|window| !window.goal_inside) {
            self.grow();
        }
        // A car turns to and fro wherever it turns round: that alone closes nothing.
        let turns_round = reason == Reason::Oscillating && !self.shape.turns_in_place();
        if (reason == Reason::Oscillating || self.attempts.is_multiple_of(4)) && !turns_round {
            self.stamp_ahead(now);
        }
        let turns = self.shape.turns_in_place();
        if turns && (self.attempts % 2 == 1 || reason == Reason::Oscillating) {
            let to = self
                .window
                .as_ref()
                .and_then(|window| window.ahead(at, 2.0, 2.0))
                .unwrap_or(now.aim);
            let off_rad = wrap((to.y_m - at.y_m).atan2(to.x_m - at.x_m) - now.pose.heading_rad);
            let left_rad = if off_rad.abs() < 0.3 { PI } else { off_rad };
            return self.begin(Recovery::TurnInPlace { left_rad }, at);
        }
        self.begin(backs, at);
    }

    /// Forgets what was seen and tried: things that went away out of sight, or that a wrong pose put into the way, close it no
    /// longer. What stands near to the robot is kept, for it may stand where no sensor looks. False when it has done so before.
    fn forget(&mut self, at: Position) -> bool {
        if !self.params.recover || !self.params.memory || self.has_forgotten {
            return false;
        }
        let near_m = 2.0 * self.shape.radius_m;
        self.grid.clear_beyond(at.x_m, at.y_m, near_m);
        self.memory.clear_beyond(at.x_m, at.y_m, near_m);
        let grid = &self.grid;
        self.met.retain(|&cell, _| grid.certainty_of(cell).is_some());
        self.window = None;
        self.start_over();
        self.has_forgotten = true;
        self.begin(Recovery::Forget, at);
        self.finish();
        true
    }

    fn finish(&mut self) {
        self.recovery = None;
        self.watch.restart();
        self.blocked_since_s = None;
    }

    /// Marks the place before the robot's nose as closed, for good.
    fn stamp_ahead(&mut self, now: &Now) {
        let ahead_m = self.shape.radius_m + 2.0 * self.memory.cell_size_m;
        let (sin, cos) = now.pose.heading_rad.sin_cos();
        let at = now.at();
        let place = Position::new(at.x_m + cos * ahead_m, at.y_m + sin * ahead_m);
        // The way leads elsewhere: what is before the nose does not close it.
        let leads_ahead = |to: Position| {
            let off_rad = wrap((to.y_m - at.y_m).atan2(to.x_m - at.x_m) - now.pose.heading_rad);
            off_rad.abs() < STAMP_RAD
        };
        let next = self
            .window
            .as_ref()
            .and_then(|window| window.ahead(at, ahead_m, ahead_m));
        if !next.is_none_or(leads_ahead) {
            return;
        }
        // The goal must stay within reach.
        if place.distance_m(self.goal) <= self.shape.radius_m + self.params.arrival_m {
            return;
        }
        let cell = self.memory.cell_of(place.x_m, place.y_m);
        if self.memory.set(cell, Seen::Stamped) {
            if let Some(window) = &mut self.window {
                window.set(cell, Seen::Stamped);
            }
            self.events.push(Event::Stamped { at: place });
        }
    }

    /// Remembers what the nose has run into.
    fn feel_ahead(&mut self, now: &Now) {
        let ahead_m = self.shape.half_length_m + 0.5 * self.grid.params().cell_size_m;
        let (sin, cos) = now.pose.heading_rad.sin_cos();
        let (x_m, y_m) = (now.pose.x_m + cos * ahead_m, now.pose.y_m + sin * ahead_m);
        *self.met.entry(self.grid.cell_of(x_m, y_m)).or_default() |= 1 << 36;
    }

    /// Turns on; `None` when done or no longer possible.
    fn turn_on(&mut self, now: &Now, left_rad: f64) -> Option<(f64, f64)> {
        if left_rad.abs() < 0.1 {
            return None;
        }
        if now.speed_mps.abs() > ROLLS_MPS {
            return Some((0.0, 0.0));
        }
        let tried = left_rad.clamp(-TURN_LOOK_RAD, TURN_LOOK_RAD);
        let free_rad = self.free_turn_rad(now, tried).abs();
        if free_rad < 0.05_f64.min(left_rad.abs()) {
            return None;
        }
        let most = (0.6 * self.shape.max_turn_rate_radps).min(self.turn_rate_within(free_rad, now));
        let turn_radps = (2.0 * left_rad).clamp(-most, most);
        self.recovery = Some(Recovery::TurnInPlace {
            left_rad: left_rad - turn_radps * now.step_s,
        });
        Some((0.0, turn_radps))
    }

    /// Backs on; `None` when done or no longer possible.
    fn back_on(&mut self, now: &Now, left_m: f64) -> Option<(f64, f64)> {
        if left_m <= 0.0 {
            return None;
        }
        let at = now.at();
        let to = self
            .window
            .as_ref()
            .and_then(|window| window.ahead(at, 2.0, 2.0))
            .unwrap_or(now.aim);
        let off_rad = wrap((to.y_m - at.y_m).atan2(to.x_m - at.x_m) - now.pose.heading_rad);
        // Backwards, the nose turns left on a curvature to the right: towards the target first, then straight.
        let bend = if self.shape.turns_in_place() {
            0.0
        } else {
            1.0 / self.shape.turn_radius_m
        };
        if let Some(behind) = self
            .region
            .as_ref()
            .filter(|region| region.leaving_no_go)
            .and_then(RegionState::trail_end)
        {
            // The arc through that place.
            let (sin, cos) = now.pose.heading_rad.sin_cos();
            let (east_m, north_m) = (behind.x_m - at.x_m, behind.y_m - at.y_m);
            let aside_m = cos * north_m - sin * east_m;
            let most = if bend > 0.0 {
                bend
            } else {
                1.0 / self.shape.radius_m.max(0.1)
            };
            let curvature = (2.0 * aside_m / (east_m.hypot(north_m).powi(2)).max(0.01)).clamp(-most, most);
            return self.back_along(now, curvature, left_m);
        }
        let curvatures = [-off_rad.signum() * bend, 0.0, off_rad.signum() * bend];
        let sight = Sight {
            grid: &self.grid,
            pose: &now.pose,
            scan: now.scan,
        };
        let free_m = |curvature: f64| {
            let seen = |ahead_m: f64, aside_m: f64| sight.has(ahead_m, aside_m);
            self.around.free_m(&self.shape, curvature, false, left_m.max(0.5), seen)
        };
        let curvature = curvatures
            .into_iter()
            .find(|&curvature| free_m(curvature) >= (0.5 * left_m).min(1.0))
            .unwrap_or(0.0);
        self.back_along(now, curvature, left_m)
    }

    /// Backs off along an arc; `None` where that is not safe.
    fn back_along(&mut self, now: &Now, curvature: f64, left_m: f64) -> Option<(f64, f64)> {
        let safe_mps = self.safe_mps(now, curvature, false).min(self.careful_mps());
        if safe_mps < 0.02 {
            return None;
        }
        let moved_m = now.speed_mps.abs().max(0.2 * safe_mps) * now.step_s;
        self.recovery = Some(Recovery::BackOff {
            left_m: left_m - moved_m,
        });
        Some((-safe_mps, -safe_mps * curvature))
    }
}
