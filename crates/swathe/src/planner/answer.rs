//! What is asked of the planner and what it answers.

use crate::corridor::{ArcKind, Corridor};
use crate::grid::{Cell, LayerView, Position};
use crate::nest::Nests;
use crate::rank::SourceFault;
use crate::swarm::{Budget, StopRule, SwarmParams, Tally};

use super::drivable::DrivablePath;
use super::path_kind::PathKind;
use super::refusal::Refusal;
use super::route::Route;
use super::stop::StopReport;
use super::{Objective, SegmentFacts};

/// Which way regions are found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// The termite swarm inside the swathe.
    Swarm,
    /// One linear pass over the whole map: the oracle.
    Exact,
}

/// What is being done, for progress reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Laying the arc.
    Corridor,
    /// Finding nests.
    Regions,
    /// Searching the way.
    Route,
}

/// Called with the stage, the work done and the work expected; false asks to stop.
pub type StageReport<'a> = dyn FnMut(Stage, u64, u64) -> bool + 'a;

/// The layers that planning reads.
#[derive(Clone, Copy, Debug)]
pub struct Terrain<'a> {
    /// Heights in metres, NaN unknown.
    pub elevation_m: LayerView<'a, f32>,
    /// Soil class codes.
    pub soil: Option<LayerView<'a, u8>>,
    /// The user's factor on the cost of each cell, at least 0; the ground is closed where it is NaN or infinite. Give the
    /// ranker a zone there too, or nests will hold cells that no way may enter.
    pub cost_factor: Option<LayerView<'a, f32>>,
    /// Whether the map goes on beyond these cells, which limits what can be certified.
    pub map_continues: bool,
}

/// What is asked of the planner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanRequest {
    /// Where the vehicle is.
    pub start: Position,
    /// Where it should go.
    pub goal: Position,
    /// How regions are found.
    pub method: Method,
    /// The swarm's parameters; its nest parameters hold for the exact method too.
    pub swarm: SwarmParams,
    /// How the arc is laid.
    pub arc: ArcKind,
    /// Width of the swathe; a quarter of the distance when not given.
    pub width_m: Option<f64>,
    /// Which kind of path the route follows.
    pub path: PathKind,
    /// Headings at start and goal, counter-clockwise from east; free where not given. They hold for driven paths.
    pub headings_rad: [Option<f64>; 2],
    /// Whether suitable ground outside the nests may be crossed, at three times the cost, when nothing else connects.
    pub bridge: bool,
    /// Whether the swathe is widened until the route is known to be the best of the whole map.
    pub certify: bool,
    /// What the way should save.
    pub objective: Objective,
    /// Whether the way is charged, and kept within limits, as if driven back from goal to start.
    pub reversed: bool,
    /// When the swarm stops; where not given, when the route is good enough for the arc that is laid anew, and when the
    /// swathe is finished for the others and for a certificate.
    pub stop: Option<StopRule>,
    /// What the swarm may spend; the cells of the coarse map behind [`ArcKind::Spine`] count.
    pub budget: Budget,
}

/// What the swarm did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SwarmReport {
    /// Its tally.
    pub tally: Tally,
    /// How often the swathe was widened.
    pub widened: u32,
}

/// The planner's answer.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Route or refusal.
    pub answer: Result<Route, Refusal>,
    /// The arcs that follow the route within the vehicle's turning radius, where it was asked for.
    pub drivable: Option<DrivablePath>,
    /// Cells of the way before shortcuts.
    pub path: Vec<Cell>,
    /// Cost of that way in seconds, weighted by the objective.
    pub path_cost: Option<f64>,
    /// Nothing can cost less than this.
    pub cost_lower_bound: Option<f64>,
    /// Whether the way is known to be the best of the whole map.
    pub optimal: bool,
    /// Where the start was moved to, with the distance.
    pub start: Option<(Position, f64)>,
    /// Where the goal was moved to, with the distance.
    pub goal: Option<(Position, f64)>,
    /// The nests.
    pub nests: Option<Nests>,
    /// The corridor (swarm only).
    pub corridor: Option<Corridor>,
    /// What the swarm did (swarm only).
    pub swarm: Option<SwarmReport>,
    /// Cells whose rank was asked for, those of the coarse map included.
    pub cells_evaluated: u64,
    /// Ground beside the route that could not be read: it counts as no-go ground.
    pub(super) unread: Option<SourceFault>,
    /// How the swarm's search ended (swarm only).
    pub stopped: Option<StopReport>,
}

impl Plan {
    pub(super) fn empty() -> Self {
        Self {
            answer: Ok(Route {
                legs: Vec::new(),
                total: SegmentFacts::default(),
            }),
            drivable: None,
            path: Vec::new(),
            path_cost: None,
            cost_lower_bound: None,
            optimal: false,
            start: None,
            goal: None,
            nests: None,
            corridor: None,
            swarm: None,
            cells_evaluated: 0,
            unread: None,
            stopped: None,
        }
    }

    /// Notes what a swarm that was never widened has done.
    pub(super) fn note(&mut self, tally: &Tally) {
        self.swarm = Some(SwarmReport {
            tally: *tally,
            widened: 0,
        });
        self.cells_evaluated = tally.cells_evaluated;
    }

    pub(super) fn refused(mut self, refusal: Refusal) -> Self {
        self.answer = Err(refusal);
        self
    }
}
