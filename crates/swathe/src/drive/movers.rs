//! Giving way to what moves: of the ways in which the vehicle could go on, stop or get out of the way in the next seconds, the one
//! that keeps it clear of where everything will be by then and still leads on.
//!
//! A dynamic window (Fox, Burgard and Thrun 1997) over arcs, speeds and turns in place, with time: a way is weighed against straight
//! lines through the velocities of what moves, as velocity obstacles do (Fiorini and Shiller 1998).

use crate::sensor::{Pose, wrap};

use super::motion::{Now, ROLLS_MPS};
use super::navigator::Navigator;
use super::params::Shape;
use super::safety::Sight;
use super::tracks::Mover;

/// Seconds that are looked ahead, more for a body that takes longer to pass, in steps that grow from the first to the second after
/// a second.
const AHEAD_S: [f64; 2] = [4.0, 8.0];
const AHEAD_S_PER_M: f64 = 2.0;
const AHEAD_FROM_M: f64 = 0.7;
const STEPS_S: [f64; 2] = [0.1, 0.2];

/// Room that is kept from what moves, in metres, more with every second ahead, and what the doubt of its place adds at most.
const ROOM_M: f64 = 0.3;
const ROOM_MPS: f64 = 0.08;
const UNSURE_M: f64 = 0.3;
const UNSURE_SHARE: f64 = 0.3;

/// Nearer than this it is a collision, which costs so much.
const TOUCH_M: f64 = 0.05;
const TOUCH_COST: f64 = 10.0;

/// A way that costs no more is driven as wanted.
const LITTLE_COST: f64 = 0.1;

/// What a metre of headway in the wanted direction is worth, and by how much another way must be better than the one begun.
const HEADWAY_WORTH: f64 = 0.1;
const CHANGE_COST: f64 = 0.25;

/// What it costs to go where the sensor does not look.
const BACK_COST: f64 = 0.3;

/// Something that was not seen for this long is looked for, which is worth so much more than to stand.
const LOOK_S: f64 = 0.7;
const LOOK_WORTH: f64 = 0.1;

/// Longest way that is looked at, and those after which it may stop.
const REACH_M: f64 = 4.0;
const WAYS_M: [f64; 2] = [1.2, REACH_M];

/// Room left at the end of a way, and the least speed at which it is worth to leave.
const SPARE_M: f64 = 0.1;
const LEAST_MPS: f64 = 0.08;

/// Nearer to a heading than this, the turn is done.
const TURNED_RAD: f64 = 0.1;

/// Turns in place before driving off.
const TURNS_RAD: [f64; 6] = [0.4, -0.4, 0.8, -0.8, 1.4, -1.4];

/// Longest that waiting for what moves does not count as trouble.
const PATIENCE_S: f64 = 20.0;

/// Who walks along beside the vehicle, between it and where it wants to, leads it astray: so far off the nose, and this near. After
/// so many seconds he is let go on, for so many.
const ASTRAY_RAD: f64 = 1.2;
const ASTRAY_M: f64 = 1.5;
const ASTRAY_MPS: f64 = 0.1;
const ASTRAY_S: f64 = 4.0;
const LET_GO_S: f64 = 8.0;

/// A way to go on: a turn in place, then an arc at a speed for some metres, then rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plan {
    pub turn_rad: f64,
    pub turn_rate_radps: f64,
    pub curvature_per_m: f64,
    /// Negative backwards.
    pub speed_mps: f64,
    pub way_m: f64,
}

impl Plan {
    pub const REST: Self = Self {
        turn_rad: 0.0,
        turn_rate_radps: 0.0,
        curvature_per_m: 0.0,
        speed_mps: 0.0,
        way_m: 0.0,
    };

    /// Whether it only turns, to see.
    fn is_look(&self) -> bool {
        self.turn_rad != 0.0 && self.speed_mps == 0.0
    }

    /// What to command now for it.
    fn command(&self, speed_mps: f64) -> (f64, f64) {
        if self.turn_rad == 0.0 {
            return (self.speed_mps, self.speed_mps * self.curvature_per_m);
        }
        if speed_mps.abs() > ROLLS_MPS {
            return (0.0, 0.0);
        }
        (0.0, self.turn_rate_radps.copysign(self.turn_rad))
    }
}

/// What is known of giving way.
#[derive(Clone, Debug, Default)]
pub(super) struct GivingWay {
    /// The way begun, and the heading that it turns to.
    last: Option<(Plan, f64)>,
    since_s: Option<f64>,
    /// How long somebody has led the vehicle astray, and until when he is let go on.
    astray_s: f64,
    let_go_until_s: Option<f64>,
}

/// What a plan costs against what moves, and where it leads to: ahead and left after a while.
pub(super) fn cost(
    movers: &[Mover],
    shape: &Shape,
    pose: &Pose,
    (speed_mps, turn_rate_radps): (f64, f64),
    braking_mps2: f64,
    plan: &Plan,
) -> (f64, (f64, f64)) {
    // Wheels come to an arc by and by, too.
    let spin_radps2 = shape.acceleration_mps2 / shape.half_width_m;
    let mut turns_radps = turn_rate_radps;
    let (mut ahead_m, mut left_m, mut heading_rad) = (0.0, 0.0, 0.0_f64);
    let (mut rolls_mps, mut turn_rad, mut way_m) = (speed_mps, plan.turn_rad, plan.way_m);
    let ahead_s = ahead_s(shape);
    let (sin, cos) = pose.heading_rad.sin_cos();
    let local: Vec<_> = movers
        .iter()
        .map(|mover| {
            let (dx, dy) = (mover.x_m - pose.x_m, mover.y_m - pose.y_m);
            (
                cos * dx + sin * dy,
                cos * dy - sin * dx,
                cos * mover.east_mps + sin * mover.north_mps,
                cos * mover.north_mps - sin * mover.east_mps,
                mover.half_m + (UNSURE_SHARE * mover.unsure_m).min(UNSURE_M),
            )
        })
        .collect();
    let (mut most, mut time_s) = (0.0_f64, 0.0);
    let mut led = None;
    loop {
        let (sin, cos) = heading_rad.sin_cos();
        for &(x_m, y_m, ahead_mps, left_mps, half_m) in &local {
            let (dx, dy) = (x_m + ahead_mps * time_s - ahead_m, y_m + left_mps * time_s - left_m);
            let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
            let gap_m = (ahead.abs() - shape.half_length_m)
                .max(0.0)
                .hypot((left.abs() - shape.half_width_m).max(0.0))
                - half_m;
            let later = 1.0 - 0.5 * time_s / ahead_s;
            let cost = if gap_m < TOUCH_M {
                TOUCH_COST * later
            } else {
                (1.0 - gap_m / (ROOM_M + ROOM_MPS * time_s)).max(0.0) * later
            };
            most = most.max(cost);
        }
        if time_s >= AHEAD_S[0] / 2.0 && led.is_none() {
            led = Some((ahead_m, left_m));
        }
        if time_s >= ahead_s {
            return (most, led.unwrap_or((ahead_m, left_m)));
        }
        let step_s = STEPS_S[usize::from(time_s > 0.95)];
        time_s += step_s;
        let towards = |from: f64, to: f64| {
            // Brakes work at once, the motor by and by.
            let slower = to.abs() < from.abs() || to * from < 0.0;
            let most = step_s * if slower { braking_mps2 } else { shape.acceleration_mps2 };
            from + (to - from).clamp(-most, most)
        };
        let rolled_mps = rolls_mps;
        let mut roll = |rolls_mps: f64, turned_rad: f64| {
            let (sin, cos) = (heading_rad + turned_rad / 2.0).sin_cos();
            ahead_m += rolls_mps * step_s * cos;
            left_m += rolls_mps * step_s * sin;
            heading_rad += turned_rad;
        };
        // Who brakes stays on his arc.
        let braked = |rolls_mps: f64| {
            if rolled_mps.abs() > ROLLS_MPS {
                rolls_mps / rolled_mps
            } else {
                0.0
            }
        };
        if turn_rad != 0.0 {
            if rolls_mps.abs() > ROLLS_MPS {
                rolls_mps = towards(rolls_mps, 0.0);
                turns_radps *= braked(rolls_mps);
                roll(rolls_mps, turns_radps * step_s);
                continue;
            }
            rolls_mps = 0.0;
            let turned_rad = (plan.turn_rate_radps * step_s).min(turn_rad.abs()).copysign(turn_rad);
            heading_rad += turned_rad;
            turn_rad -= turned_rad;
            continue;
        }
        let left_mps = (2.0 * braking_mps2 * way_m).sqrt();
        let wanted_mps = plan.speed_mps.abs().min(left_mps).copysign(plan.speed_mps);
        rolls_mps = towards(rolls_mps, wanted_mps);
        if plan.speed_mps == 0.0 {
            turns_radps *= braked(rolls_mps);
        } else {
            let off_radps = plan.curvature_per_m * rolls_mps - turns_radps;
            turns_radps += off_radps.clamp(-spin_radps2 * step_s, spin_radps2 * step_s);
        }
        roll(rolls_mps, turns_radps * step_s);
        way_m = (way_m - (rolls_mps * step_s).abs()).max(0.0);
    }
}

/// Seconds that are looked ahead for a body.
fn ahead_s(shape: &Shape) -> f64 {
    (AHEAD_S_PER_M * (shape.radius_m - AHEAD_FROM_M) + AHEAD_S[0]).clamp(AHEAD_S[0], AHEAD_S[1])
}

impl Navigator {
    /// The command, or another that gives way to what moves.
    pub(super) fn give_way(&mut self, now: &Now, wanted: (f64, f64)) -> (f64, f64) {
        let movers = self.movers_near(now);
        let wanted = if self.lets_go_on(now, &movers) {
            (0.0, 0.0)
        } else {
            wanted
        };
        let Some(plan) = self.plan_around(now, wanted, &movers) else {
            (self.giving_way.last, self.giving_way.since_s) = (None, None);
            return wanted;
        };
        // Who waits for others is in no trouble, for a while.
        let since_s = *self.giving_way.since_s.get_or_insert(now.time_s);
        if now.time_s - since_s < PATIENCE_S {
            self.watch.restart();
            self.blocked_since_s = None;
        }
        self.giving_way.last = Some((plan, wrap(now.pose.heading_rad + plan.turn_rad)));
        plan.command(now.speed_mps)
    }

    /// Whether to stand until somebody who leads the vehicle astray has gone on.
    fn lets_go_on(&mut self, now: &Now, movers: &[Mover]) -> bool {
        let off_rad = now.off_rad();
        let (sin, cos) = now.pose.heading_rad.sin_cos();
        let leads = movers.iter().any(|mover| {
            let (dx, dy) = (mover.x_m - now.pose.x_m, mover.y_m - now.pose.y_m);
            let (ahead_m, left_m) = (cos * dx + sin * dy, cos * dy - sin * dx);
            let is_beside = ahead_m.abs() < self.shape.half_length_m + ASTRAY_M
                && left_m.abs() < self.shape.half_width_m + mover.half_m + ASTRAY_M;
            let along_mps = cos * mover.east_mps + sin * mover.north_mps;
            is_beside && left_m * off_rad > 0.0 && along_mps > ASTRAY_MPS
        });
        let giving_way = &mut self.giving_way;
        if let Some(until_s) = giving_way.let_go_until_s {
            if leads && now.time_s < until_s {
                return true;
            }
            (giving_way.astray_s, giving_way.let_go_until_s) = (0.0, None);
            return false;
        }
        let is_astray = leads && off_rad.abs() > ASTRAY_RAD;
        let step_s = if is_astray { now.step_s } else { -now.step_s };
        giving_way.astray_s = (giving_way.astray_s + step_s).max(0.0);
        if giving_way.astray_s > ASTRAY_S {
            giving_way.let_go_until_s = Some(now.time_s + LET_GO_S);
        }
        giving_way.let_go_until_s.is_some()
    }

    fn movers_near(&self, now: &Now) -> Vec<Mover> {
        let near_m = self.shape.radius_m + ahead_s(&self.shape) * (self.shape.max_speed_mps.min(2.0) + 1.0);
        let mut movers = self.tracks.found(now.time_s);
        movers.retain(|mover| (mover.x_m - now.pose.x_m).hypot(mover.y_m - now.pose.y_m) < near_m);
        movers
    }

    /// The best plan where what is wanted comes too near to what moves.
    fn plan_around(&self, now: &Now, wanted: (f64, f64), movers: &[Mover]) -> Option<Plan> {
        if movers.is_empty() {
            return None;
        }
        let shape = &self.shape;
        let braking_mps2 = self
            .braking_mps2(&now.pose, true)
            .min(self.braking_mps2(&now.pose, false))
            .max(0.1);
        let weigh = |plan: &Plan| {
            cost(
                movers,
                shape,
                &now.pose,
                (now.speed_mps, now.turn_rate_radps),
                braking_mps2,
                plan,
            )
        };
        let on = self.wanted_plan(now, wanted);
        let (on_cost, led) = weigh(&on);
        if on_cost <= LITTLE_COST {
            return None;
        }
        let away_m = led.0.hypot(led.1);
        let towards = if away_m > 0.05 {
            (led.0 / away_m, led.1 / away_m)
        } else {
            let off_rad = now.off_rad();
            (off_rad.cos(), off_rad.sin())
        };
        let worth = |plan: &Plan| {
            let (cost, led) = weigh(plan);
            let headway_m = (led.0 * towards.0 + led.1 * towards.1).clamp(-2.0, 2.0);
            let back = if plan.speed_mps < 0.0 { BACK_COST } else { 0.0 };
            let looks = if plan.is_look() { LOOK_WORTH } else { 0.0 };
            cost + back - looks - HEADWAY_WORTH * headway_m
        };
        let best = self
            .plans(now, &on, movers)
            .into_iter()
            .map(|plan| (worth(&plan), plan))
            .min_by(|one, other| one.0.total_cmp(&other.0))?;
        // Who changes his mind at every step gets nowhere.
        match self.begun(now) {
            Some(begun) if worth(&begun) <= best.0 + CHANGE_COST => Some(begun),
            _ => Some(best.1),
        }
    }

    /// What is left of the way that was begun.
    fn begun(&self, now: &Now) -> Option<Plan> {
        let (mut plan, heading_rad) = self.giving_way.last?;
        if plan.turn_rad != 0.0 {
            plan.turn_rad = wrap(heading_rad - now.pose.heading_rad);
            if plan.turn_rad.abs() < TURNED_RAD {
                plan.turn_rad = 0.0;
            }
        } else if plan.speed_mps != 0.0 {
            plan.way_m -= now.speed_mps.abs() * now.step_s;
        }
        if plan.speed_mps == 0.0 && plan.turn_rad == 0.0 {
            return Some(plan);
        }
        if plan.turn_rad != 0.0 {
            let free_rad = self.around.turn_rad(&self.shape, plan.turn_rad);
            if free_rad.abs() + 1e-9 < plan.turn_rad.abs() {
                return None;
            }
            plan.turn_rate_radps = self.turn_rate_within(free_rad, now);
        }
        if plan.speed_mps == 0.0 {
            return Some(plan);
        }
        let forward = plan.speed_mps > 0.0;
        let free_m = self.free_way_m(now, plan.turn_rad, plan.curvature_per_m, forward) - SPARE_M;
        plan.way_m = plan.way_m.min(free_m);
        let safe_mps = self.leaving_mps(now, free_m, forward);
        plan.speed_mps = plan.speed_mps.abs().min(safe_mps).copysign(plan.speed_mps);
        (safe_mps >= LEAST_MPS && plan.way_m > 0.0).then_some(plan)
    }

    /// How fast the vehicle may leave along a free way.
    fn leaving_mps(&self, now: &Now, free_m: f64, forward: bool) -> f64 {
        let braking_mps2 = self.braking_mps2(&now.pose, forward);
        self.shape
            .speed_for(free_m, braking_mps2, now.age_s + now.step_s.min(0.5))
            .min(self.shape.max_speed_mps)
    }

    /// What is wanted, as a plan.
    fn wanted_plan(&self, now: &Now, (speed_mps, turn_radps): (f64, f64)) -> Plan {
        if speed_mps.abs() < 0.01 {
            let turns = turn_radps != 0.0 && self.shape.turns_in_place();
            return if turns {
                Plan {
                    turn_rad: 0.8_f64.copysign(turn_radps),
                    turn_rate_radps: turn_radps.abs(),
                    ..Plan::REST
                }
            } else {
                Plan::REST
            };
        }
        let curvature_per_m = turn_radps / speed_mps;
        Plan {
            curvature_per_m,
            speed_mps,
            way_m: self.free_way_m(now, 0.0, curvature_per_m, speed_mps > 0.0),
            ..Plan::REST
        }
    }

    /// How far the vehicle can go along an arc after a turn in place.
    fn free_way_m(&self, now: &Now, turn_rad: f64, curvature_per_m: f64, forward: bool) -> f64 {
        let sight = Sight {
            grid: &self.grid,
            pose: &now.pose,
            scan: now.scan,
        };
        let reach_m = REACH_M.min(self.around.reach_m());
        let free_m = if turn_rad == 0.0 {
            self.around
                .free_m(&self.shape, curvature_per_m, forward, reach_m, |ahead_m, left_m| {
                    sight.has(ahead_m, left_m)
                })
        } else {
            let (sin, cos) = turn_rad.sin_cos();
            self.around.turned(&self.shape, turn_rad).free_m(
                &self.shape,
                curvature_per_m,
                forward,
                reach_m,
                |ahead_m, left_m| sight.has(cos * ahead_m - sin * left_m, sin * ahead_m + cos * left_m),
            )
        };
        let pose = Pose {
            heading_rad: wrap(now.pose.heading_rad + turn_rad),
            ..now.pose
        };
        free_m.min(self.allowed_m(&pose, curvature_per_m, forward, reach_m))
    }

    /// Ways to go on: as wanted but slower, at rest, and out of the way.
    fn plans(&self, now: &Now, on: &Plan, movers: &[Mover]) -> Vec<Plan> {
        let shape = &self.shape;
        let mut plans = vec![*on, Plan::REST];
        if on.speed_mps != 0.0 {
            plans.extend([0.6, 0.3].map(|share| Plan {
                speed_mps: share * on.speed_mps,
                ..*on
            }));
        }
        let mut leave = |turn_rad: f64, curvature_per_m: f64, forward: bool, turn_rate_radps: f64| {
            let free_m = self.free_way_m(now, turn_rad, curvature_per_m, forward) - SPARE_M;
            let safe_mps = self.leaving_mps(now, free_m, forward);
            if safe_mps < LEAST_MPS {
                return;
            }
            let side = if forward { 1.0 } else { -1.0 };
            for way_m in WAYS_M {
                for share in [1.0, 0.5] {
                    plans.push(Plan {
                        turn_rad,
                        turn_rate_radps,
                        curvature_per_m,
                        speed_mps: side * share * safe_mps,
                        way_m: way_m.min(free_m),
                    });
                }
                if free_m < WAYS_M[0] {
                    break;
                }
            }
        };
        let bend = if shape.turns_in_place() {
            1.0 / shape.radius_m.max(0.4)
        } else {
            1.0 / shape.turn_radius_m
        };
        for forward in [true, false] {
            for curvature_per_m in [0.0, 0.5 * bend, -0.5 * bend, bend, -bend] {
                leave(0.0, curvature_per_m, forward, 0.0);
            }
        }
        if shape.turns_in_place() {
            for turn_rad in TURNS_RAD {
                let free_rad = self.around.turn_rad(shape, turn_rad);
                if free_rad.abs() + 1e-9 < turn_rad.abs() {
                    continue;
                }
                let rate_radps = self.turn_rate_within(free_rad, now);
                leave(turn_rad, 0.0, true, rate_radps);
                leave(turn_rad, 0.0, false, rate_radps);
            }
        }
        plans.extend(self.looks(now, movers));
        plans
    }

    /// Turns in place to where something must be that is not seen.
    fn looks(&self, now: &Now, movers: &[Mover]) -> Vec<Plan> {
        if !self.shape.turns_in_place() {
            return Vec::new();
        }
        let towards = |mover: &Mover| {
            let off_rad = (mover.y_m - now.pose.y_m).atan2(mover.x_m - now.pose.x_m) - now.pose.heading_rad;
            let turn_rad = wrap(off_rad);
            let free_rad = self.around.turn_rad(&self.shape, turn_rad);
            (free_rad.abs() > 2.0 * TURNED_RAD).then(|| Plan {
                turn_rad: free_rad,
                turn_rate_radps: self.turn_rate_within(free_rad, now),
                ..Plan::REST
            })
        };
        let unseen = movers.iter().filter(|mover| mover.unseen_s > LOOK_S);
        unseen.filter_map(towards).collect()
    }
}
