//! How an episode ends: what is counted on the way, and when it is over.

use crate::drive::{Reason, Status};
use crate::grid::Position;
use crate::sensor::Pose;
use crate::sim::{BodyState, NoGo, World};
use crate::vehicle::Vehicle;

use super::EpisodeParams;

/// How an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The robot says that it is at the goal, and stands.
    Reached,
    /// The navigator gave up, or could not go on.
    NotReached,
    /// The body ran into something.
    Collision,
    /// The time was over.
    Timeout,
}

impl Verdict {
    /// The word for it, as in Python.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reached => "reached",
            Self::NotReached => "not_reached",
            Self::Collision => "collision",
            Self::Timeout => "timeout",
        }
    }
}

/// How an episode went.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// How it ended.
    pub verdict: Verdict,
    /// Why, in a sentence.
    pub reason: &'static str,
    /// Metres that the body drove.
    pub distance_m: f64,
    /// Simulated seconds.
    pub duration_s: f64,
    /// Least distance of the footprint to anything; `None` when nothing came within about ten metres.
    pub min_clearance_m: Option<f64>,
    /// How often it ran into something.
    pub collisions: u32,
    /// How often the local route changed.
    pub replans: u32,
    /// Readings taken.
    pub probes: u32,
    /// How often knowledge of the soil came from outside.
    pub soil_updates: u32,
    /// How often the body came onto ground beyond its vehicle's limits.
    pub no_go_entries: u32,
    /// True distance to the goal at the end.
    pub goal_distance_m: f64,
    /// Greatest true speed.
    pub top_speed_mps: f64,
    /// Longest step of the navigator by the clock that was lent.
    pub longest_step_s: f64,
}

/// How near things must be to count for the clearance.
const CLEARANCE_REACH_M: f64 = 10.0;

/// How far a body that nothing is near may go before it is looked at again.
const CLEARANCE_STEP_M: f64 = 0.5;

/// Speed below which a body stands.
pub(super) const STANDS_MPS: f64 = 0.02;

/// What is counted on the way.
#[derive(Clone, Debug)]
pub(super) struct Tally {
    pub distance_m: f64,
    pub clearance_m: f64,
    /// How much less than now the clearance may become before it must be looked at again.
    slack_m: f64,
    pub replans: u32,
    pub probes: u32,
    pub soil_updates: u32,
    pub no_go_entries: u32,
    pub top_speed_mps: f64,
    pub longest_step_s: f64,
    no_go: Option<NoGo>,
    last: Pose,
    last_s: f64,
    waiting_since_s: Option<f64>,
}

impl Tally {
    pub fn new(start: &BodyState) -> Self {
        Self {
            distance_m: 0.0,
            clearance_m: f64::INFINITY,
            slack_m: 0.0,
            replans: 0,
            probes: 0,
            soil_updates: 0,
            no_go_entries: 0,
            top_speed_mps: 0.0,
            longest_step_s: 0.0,
            // Where it begins it was not brought to by the drive.
            no_go: start.no_go,
            last: start.pose,
            last_s: start.time_s,
            waiting_since_s: None,
        }
    }

    /// Takes in where the body is; returns the limit that it has just gone beyond.
    pub fn note(&mut self, world: &World, vehicle: &Vehicle, body: &BodyState) -> Option<NoGo> {
        let moved_m = self.last.distance_m(&body.pose);
        self.distance_m += moved_m;
        self.top_speed_mps = self.top_speed_mps.max(body.speed_mps.abs());
        // No corner moves farther than the middle and the turn together; what moves comes nearer by itself.
        let turned_rad = crate::sensor::wrap(body.pose.heading_rad - self.last.heading_rad).abs();
        let approach_mps = world.movers().iter().map(|mover| mover.speed_mps).fold(0.0, f64::max);
        let nearer_m =
            moved_m + turned_rad * vehicle.circumscribed_radius_m() + approach_mps * (body.time_s - self.last_s);
        self.slack_m -= nearer_m;
        (self.last, self.last_s) = (body.pose, body.time_s);
        if self.slack_m <= 0.0 {
            self.slack_m = match world.clearance_m(vehicle, &body.pose, body.time_s, CLEARANCE_REACH_M) {
                Some(here_m) => {
                    self.clearance_m = self.clearance_m.min(here_m);
                    here_m - self.clearance_m
                }
                None => CLEARANCE_STEP_M,
            };
        }
        let before = std::mem::replace(&mut self.no_go, body.no_go);
        match body.no_go {
            Some(reason @ (NoGo::Soil | NoGo::Grade | NoGo::SideSlope)) if before.is_none() => {
                self.no_go_entries += 1;
                Some(reason)
            }
            _ => None,
        }
    }

    /// Whether the episode is over, when no collision ended it.
    pub fn verdict(
        &mut self,
        params: &EpisodeParams,
        body: &BodyState,
        told: (Status, Reason),
    ) -> Option<(Verdict, &'static str)> {
        let stands = body.speed_mps.abs() < STANDS_MPS;
        let (status, reason) = told;
        match status {
            Status::Reached if stands => return Some((Verdict::Reached, reason.text())),
            Status::Stopped if stands => return Some((Verdict::NotReached, reason.text())),
            Status::NoRoute | Status::Fault if stands => {
                let since_s = *self.waiting_since_s.get_or_insert(body.time_s);
                if body.time_s - since_s >= params.patience_s {
                    return Some((Verdict::NotReached, reason.text()));
                }
            }
            _ => self.waiting_since_s = None,
        }
        if body.stop == Some(crate::sim::Stop::Sunk) {
            return Some((Verdict::NotReached, "The vehicle sank in."));
        }
        (body.time_s + 1e-9 >= params.time_limit_s).then_some((Verdict::Timeout, "The time was over."))
    }

    /// The outcome.
    pub fn outcome(&self, body: &BodyState, goal: Position, verdict: Verdict, reason: &'static str) -> Outcome {
        Outcome {
            verdict,
            reason,
            distance_m: self.distance_m,
            duration_s: body.time_s,
            min_clearance_m: self.clearance_m.is_finite().then_some(self.clearance_m),
            collisions: body.collisions,
            replans: self.replans,
            probes: self.probes,
            soil_updates: self.soil_updates,
            no_go_entries: self.no_go_entries,
            goal_distance_m: Position::new(body.pose.x_m, body.pose.y_m).distance_m(goal),
            top_speed_mps: self.top_speed_mps,
            longest_step_s: self.longest_step_s,
        }
    }
}
