//! From nests to a route: search, shortcuts, certificate, and reasons when there is no way.

mod answer;
mod any_angle;
mod cells;
mod clearance;
mod cost_segments;
mod drivable;
mod eikonal;
mod ground;
mod guided;
mod kernel;
mod lazy_astar;
mod path_kind;
mod plan;
mod radix_heap;
mod refine;
mod refusal;
mod repair;
mod route;
mod search;
mod smooth;
mod spine;
mod stop;
mod swathe;
#[cfg(test)]
mod tiled_tests;
mod watch;

use thiserror::Error;

use crate::corridor::CorridorError;
use crate::grid::GridError;
use crate::nest::NestError;
use crate::rank::{RankError, SourceFault};
use crate::swarm::SwarmError;

pub use answer::{Method, Plan, PlanRequest, Stage, StageReport, SwarmReport, Terrain};
pub use any_angle::{AnyAngle, Way, WaySearch, any_angle};
pub use cells::{Algorithm, Corners, CostCells, cell_cost_field, shortest_path};
pub use cost_segments::{AnyAngleMethod, CostSegments, any_angle_path};
pub use drivable::{
    CurveArc, DrivableParams, DrivablePath, DrivenArc, DrivenPose, DrivenWay, Pose, drivable_path, drivable_way,
    dubins, reeds_shepp,
};
pub use eikonal::eikonal_field;
pub use ground::{BRIDGE_FACTOR, Ground, Headings, Objective, Obstacle, SegmentFacts};
pub use kernel::CellCost;
pub use lazy_astar::{LazyAnswer, LazyRequest, lazy_astar};
pub use path_kind::PathKind;
pub use plan::{plan, plan_watched};
pub use refusal::{Refusal, Status};
pub use repair::{ChangingCells, ChangingGraph, REPAIR_SHARE, Repair, RepairTally};
pub use route::{Leg, Route};
pub use search::{Search, StepGraph, cost_field, search};
pub use smooth::shorten;
pub use stop::{StopReport, StoppedBy};
pub use watch::{ArcFrame, Film, Watch};

/// What can be wrong with a planner request. "No route" is not an error but a [`Refusal`].
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PlannerError {
    /// Layers or cells do not fit the grid.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The ranking is not usable.
    #[error(transparent)]
    Rank(#[from] RankError),
    /// The corridor is not usable.
    #[error(transparent)]
    Corridor(#[from] CorridorError),
    /// The nests are not usable.
    #[error(transparent)]
    Nest(#[from] NestError),
    /// The swarm is not usable.
    #[error(transparent)]
    Swarm(#[from] SwarmError),
    /// A cost below zero.
    #[error(
        "The cost {cost} at cell ({row}, {column}) is negative: costs must be at least 0, NaN or infinite where closed."
    )]
    NegativeCost {
        /// Row of the cell.
        row: usize,
        /// Column of the cell.
        column: usize,
        /// Its cost.
        cost: f64,
    },
    /// A number of neighbours that no graph has.
    #[error("{given} neighbours are not offered: 8 or 16 is allowed.")]
    Neighbours {
        /// The number given.
        given: u32,
    },
    /// A weight of the bound that no search has.
    #[error("A weight of {weight} for the bound is not usable: 1 to 1000 is allowed.")]
    Weight {
        /// The value given.
        weight: f64,
    },
    /// A figure of a drivable path that is not usable.
    #[error("A {name} of {given} is not usable: {allowed}.")]
    Drivable {
        /// What it is.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// An objective that no way can be measured by.
    #[error("The objective's {name} of {given} is not usable: {allowed}.")]
    Objective {
        /// What of it.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// A user's cost factor below zero.
    #[error(
        "The cost factor {factor} at cell ({row}, {column}) is negative: factors must be at least 0, NaN or infinite where closed."
    )]
    NegativeFactor {
        /// Row of the cell.
        row: usize,
        /// Column of the cell.
        column: usize,
        /// Its factor.
        factor: f32,
    },
    /// A start or goal that is not a place.
    #[error("The {name} ({x_m}, {y_m}) is not a place: both coordinates must be finite.")]
    NotAPlace {
        /// Start or goal.
        name: &'static str,
        /// East.
        x_m: f64,
        /// North.
        y_m: f64,
    },
    /// Ground that is read when it is needed cannot be read.
    #[error(transparent)]
    Source(#[from] SourceFault),
    /// A search that would hold more memory than allowed.
    #[error(
        "The search needs {needed} bytes beside the costs, more than the {limit} allowed: about {cells} cells would fit."
    )]
    Memory {
        /// Bytes needed.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
        /// Cells of a map of this shape that would fit.
        cells: u64,
    },
    /// The caller asked to stop.
    #[error("The planner was stopped.")]
    Stopped,
}
