//! When the robot stops for a penetrometer reading, and how it waits for one.

use crate::belief::ProbePolicy;
use crate::grid::Position;
use crate::sensor::{Mount, Pose};

use super::event::{Event, Reason, Status};
use super::knowledge::{Outlook, ProbeSite, from_nearest};
use super::motion::Now;
use super::navigator::Navigator;
use super::region::RegionState;

/// How far ahead on the global way readings are weighed, in metres.
const REACH_M: f64 = 60.0;

/// Cells that may be looked at in a step to weigh readings.
const WORK_PER_STEP: u64 = 20_000;

/// Speed and turn rate at which the robot stands.
const REST_MPS: f64 = 0.02;
const REST_RADPS: f64 = 0.05;

/// What ground that does not carry costs at least where it is met unknown, in seconds (estimate: to free the vehicle).
const STUCK_S: f64 = 3600.0;

/// Distance from a site at which the cone is there, in metres.
const THERE_M: f64 = 0.5;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum State {
    #[default]
    Driving,
    Stopping,
    Waiting {
        since_s: f64,
    },
}

/// What is known of readings ahead.
#[derive(Clone, Debug)]
struct Plan {
    made_at: Position,
    outlooks: Vec<Outlook>,
    /// The site chosen, what a reading there saves, and how near the robot came.
    chosen: Option<(ProbeSite, f64, f64)>,
}

/// Where the robot stands with its readings.
#[derive(Clone, Debug, Default)]
pub(super) struct Probing {
    state: State,
    since_last_m: f64,
    last_at: Option<Position>,
    plan: Option<Plan>,
    saving_s: Option<f64>,
    /// Metres to the place where the next reading is due, or to the next one that is not weighed yet.
    left_m: Option<f64>,
}

impl Probing {
    /// A reading came.
    pub fn answered(&mut self, at: Position) {
        *self = Self {
            last_at: Some(at),
            ..Self::default()
        };
    }

    /// The ground is known otherwise: what readings are worth must be weighed anew.
    pub fn forget_plan(&mut self) {
        self.plan = None;
    }

    /// How far the robot may drive before it must stop for a reading, in metres.
    pub fn left_m(&self) -> f64 {
        self.left_m.unwrap_or(f64::INFINITY)
    }

    pub fn is_waiting(&self) -> bool {
        matches!(self.state, State::Waiting { .. })
    }

    fn note_way(&mut self, at: Position) {
        if let Some(last) = self.last_at.replace(at) {
            self.since_last_m += last.distance_m(at);
        }
    }
}

impl Navigator {
    /// Whether the robot stands and waits for a penetrometer reading where it is.
    pub fn wants_probe(&self) -> bool {
        self.probing.is_waiting()
    }

    /// Stops for a reading when it is due and waits for it; `None` drives on.
    pub(super) fn probe(&mut self, now: &Now) -> Option<((f64, f64), Status, Reason)> {
        let at = now.at();
        self.probing.note_way(at);
        self.probing.left_m = None;
        if self.recovery.is_some() || self.region.as_ref().is_none_or(|region| region.knowledge().is_none()) {
            self.probing.state = State::Driving;
            return None;
        }
        let cone = self.cone_at(&now.pose);
        if self.probing.state == State::Driving && self.is_probe_due(cone) {
            self.probing.state = State::Stopping;
        }
        let stands = now.speed_mps.abs() <= REST_MPS && now.turn_rate_radps.abs() <= REST_RADPS;
        if self.probing.state == State::Stopping && stands {
            self.probing.state = State::Waiting { since_s: now.time_s };
            let expected_saving_s = self.probing.saving_s;
            self.events.push(Event::ProbeWanted {
                at: cone,
                expected_saving_s,
            });
        }
        match self.probing.state {
            State::Driving => None,
            State::Waiting { since_s } if now.time_s - since_s > self.params.probe_wait_s => {
                let waited_s = now.time_s - since_s;
                self.events.push(Event::ProbeMissed { waited_s });
                self.probing.answered(at);
                self.watch.restart();
                None
            }
            State::Stopping | State::Waiting { .. } => {
                // Standing on purpose is no trap.
                self.watch.restart();
                self.blocked_since_s = None;
                Some(((0.0, 0.0), Status::Driving, Reason::Probing))
            }
        }
    }

    /// Where the cone goes in, at the end of its boom.
    fn cone_at(&self, pose: &Pose) -> Position {
        let mount = Mount {
            x_m: self.shape.half_length_m + self.params.probe_boom_m,
            ..Mount::default()
        };
        let cone = pose.of_mount(&mount);
        Position::new(cone.x_m, cone.y_m)
    }

    fn is_probe_due(&mut self, cone: Position) -> bool {
        match self.params.probing {
            ProbePolicy::Never => false,
            ProbePolicy::EveryMetres(metres) => {
                self.probing.saving_s = None;
                self.probing.left_m = Some((metres - self.probing.since_last_m).max(0.0));
                self.probing.since_last_m >= metres
            }
            policy => self.is_worth_a_reading(cone, policy),
        }
    }

    /// Weighs readings along the way ahead of the cone, as much in a step as is quick, and says when it is where the policy
    /// takes one. The robot drives no faster than it can stop there, or where a reading is not weighed yet.
    fn is_worth_a_reading(&mut self, at: Position, policy: ProbePolicy) -> bool {
        let Some(knowledge) = self.region.as_mut().and_then(RegionState::knowledge_mut) else {
            return false;
        };
        let spacing_m = 0.5 * knowledge.belief().params().length_m;
        // Half of what was weighed lies behind by then.
        let is_old = |plan: &Plan| plan.chosen.is_none() && plan.made_at.distance_m(at) >= 0.5 * REACH_M;
        if self.probing.plan.as_ref().is_none_or(is_old) {
            // What the robot is about to drive: the way on its memory, and from its end on the global one.
            let mut way = from_nearest(self.window.as_ref().map_or(&[], |window| &window.way), at).to_vec();
            way.extend(from_nearest(knowledge.route(), way.last().copied().unwrap_or(at)));
            let sites = knowledge.probe_sites(at, &way, spacing_m, REACH_M);
            self.probing.plan = Some(Plan {
                made_at: at,
                outlooks: sites.into_iter().map(|site| knowledge.outlook(site, &way)).collect(),
                chosen: None,
            });
        }
        let Some(plan) = &mut self.probing.plan else {
            return false;
        };
        let dead_end_s = knowledge.route_cost().unwrap_or(0.0).max(STUCK_S);
        let mut work = 0;
        // Once the first that pays is found, those behind it are left for later.
        let settles = |outlook: &Outlook| matches!(policy, ProbePolicy::WhereItPays { probe_cost } if outlook.is_done() && outlook.saving > probe_cost);
        while let Some(outlook) = plan
            .outlooks
            .iter_mut()
            .take_while(|outlook| !settles(outlook))
            .find(|outlook| !outlook.is_done())
        {
            if work >= WORK_PER_STEP {
                self.probing.left_m = Some(outlook.site.at.distance_m(at));
                return false;
            }
            // An outcome that cannot be weighed costs next to nothing, but it must end.
            work += knowledge.weigh(outlook, dead_end_s) + 1;
        }
        if plan.chosen.is_none() {
            // What lies behind by now is left out.
            let away_m = |outlook: &Outlook| outlook.site.at.distance_m(at);
            let sites = 0..plan.outlooks.len();
            let nearest = sites.min_by(|&a, &b| away_m(&plan.outlooks[a]).total_cmp(&away_m(&plan.outlooks[b])));
            let ahead = nearest.map_or(&[][..], |nearest| &plan.outlooks[nearest..]);
            let weighed = ahead
                .iter()
                .map(|outlook| if outlook.is_done() { outlook.saving } else { 0.0 });
            let best = policy.pick(weighed).map(|place| &ahead[place]);
            plan.chosen = best.map(|best| (best.site, best.saving, f64::INFINITY));
        }
        let Some((site, saving, nearest_m)) = &mut plan.chosen else {
            return false;
        };
        let away_m = site.at.distance_m(at);
        let is_leaving = away_m > *nearest_m + 0.2;
        *nearest_m = nearest_m.min(away_m);
        // Across the next line of the map another soil may lie.
        self.probing.left_m = Some((away_m - THERE_M).max(0.0));
        let unit_here = knowledge
            .geometry()
            .cell_at(at)
            .map(|cell| knowledge.belief().unit_at(cell));
        let is_there = away_m <= THERE_M && unit_here == Some(knowledge.belief().unit_at(site.cell));
        if is_there || (is_leaving && away_m <= spacing_m) {
            self.probing.saving_s = Some(*saving);
            return true;
        }
        if is_leaving && away_m > spacing_m {
            // The robot went another way.
            self.probing.plan = None;
        }
        false
    }
}
