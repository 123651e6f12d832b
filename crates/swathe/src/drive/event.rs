//! What a step of the navigator tells: a command, and what happened.

use crate::belief::PerClass;
use crate::grid::Position;
use crate::soil::SoilClass;

use super::knowledge::Standing;

/// What the robot is told to do until the next step. Both figures are finite and within the vehicle's limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Forward speed in m/s, negative when backing.
    pub speed_mps: f64,
    /// Turn rate in rad/s, counter-clockwise.
    pub turn_rate_radps: f64,
    /// How the drive stands.
    pub status: Status,
}

/// How the drive stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// On the way.
    Driving,
    /// Getting out of a trap.
    Recovering,
    /// At the goal; final until another goal is set.
    Reached,
    /// Given up for a reason; final until another goal is set.
    Stopped,
    /// What is known closes every way; the robot waits and looks again.
    NoRoute,
    /// The sensors or the pose cannot be used; the robot stands until they can.
    Fault,
}

impl Status {
    /// The word for it, as in Python.
    pub fn name(self) -> &'static str {
        match self {
            Self::Driving => "driving",
            Self::Recovering => "recovering",
            Self::Reached => "reached",
            Self::Stopped => "stopped",
            Self::NoRoute => "no_route",
            Self::Fault => "fault",
        }
    }
}

/// Why a status holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// On the way to the goal.
    OnTheWay,
    /// Before the first usable scan.
    NoScanYet,
    /// Within the arrival distance.
    AtGoal,
    /// The last usable scan is too old.
    StaleScan,
    /// The scan's description cannot be used.
    BadScan,
    /// No beam of the scan says anything.
    BlindScan,
    /// The same ranges again and again though the robot moved.
    FrozenScan,
    /// Time, pose or speed is not a number, or out of any range.
    BadState,
    /// The clock went back.
    ClockWentBack,
    /// The pose jumped.
    PoseJumped,
    /// An obstacle stands on the goal, or what was seen closes it in.
    GoalBlocked,
    /// The goal lies on ground that the map forbids, or outside the map.
    GoalOffMap,
    /// Obstacles close every way that the map leaves.
    Enclosed,
    /// No headway.
    Trapped,
    /// Heading to and fro.
    Oscillating,
    /// Wheels turn and the robot does not move.
    Slipping,
    /// The robot does not move though it should: something that the sensors do not see.
    Bumped,
    /// Every recovery was tried.
    RecoveriesSpent,
    /// The robot's own ground is no-go.
    GroundNoGo,
    /// The robot's own ground is no-go, and no safe nest is near.
    NoSafeNest,
    /// Ground that the map forbids lies between robot and goal.
    CutOff,
    /// The robot stands for a penetrometer reading.
    Probing,
}

impl Reason {
    /// A stable word for files.
    pub fn name(self) -> &'static str {
        match self {
            Self::OnTheWay => "on_the_way",
            Self::NoScanYet => "no_scan_yet",
            Self::AtGoal => "at_goal",
            Self::StaleScan => "stale_scan",
            Self::BadScan => "bad_scan",
            Self::BlindScan => "blind_scan",
            Self::FrozenScan => "frozen_scan",
            Self::BadState => "bad_state",
            Self::ClockWentBack => "clock_went_back",
            Self::PoseJumped => "pose_jumped",
            Self::GoalBlocked => "goal_blocked",
            Self::GoalOffMap => "goal_off_map",
            Self::Enclosed => "enclosed",
            Self::Trapped => "trapped",
            Self::Oscillating => "oscillating",
            Self::Slipping => "slipping",
            Self::Bumped => "bumped",
            Self::RecoveriesSpent => "recoveries_spent",
            Self::GroundNoGo => "ground_no_go",
            Self::NoSafeNest => "no_safe_nest",
            Self::CutOff => "cut_off",
            Self::Probing => "probing",
        }
    }

    /// A sentence for people.
    pub fn text(self) -> &'static str {
        match self {
            Self::OnTheWay => "On the way to the goal.",
            Self::NoScanYet => "No usable scan has come yet.",
            Self::AtGoal => "The goal is reached.",
            Self::StaleScan => "The last usable scan is too old.",
            Self::BadScan => "The scan cannot be used.",
            Self::BlindScan => "No beam of the scan says anything.",
            Self::FrozenScan => "The scan repeats itself though the robot has moved.",
            Self::BadState => "The time, pose or speed is not usable.",
            Self::ClockWentBack => "The clock went back.",
            Self::PoseJumped => "The pose jumped.",
            Self::GoalBlocked => "An obstacle stands on the goal, or what was seen closes it in.",
            Self::GoalOffMap => "The goal lies outside the map or on ground that the map forbids.",
            Self::Enclosed => "What was seen closes every way to the goal.",
            Self::Trapped => "The robot made no headway.",
            Self::Oscillating => "The robot turned to and fro.",
            Self::Slipping => "The wheels turn, but the robot does not move.",
            Self::Bumped => "The robot is held by something that it does not see.",
            Self::RecoveriesSpent => "No way out was found.",
            Self::GroundNoGo => "The ground under the robot is no-go.",
            Self::NoSafeNest => "The ground under the robot is no-go, and no safe nest is near.",
            Self::CutOff => "Ground that the map forbids lies between the robot and the goal.",
            Self::Probing => "The robot stands for a penetrometer reading.",
        }
    }
}

/// A way out of trouble.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Recovery {
    /// Turns in place by this much in all, counter-clockwise positive, and looks around.
    TurnInPlace {
        /// What is left, in radians.
        left_rad: f64,
    },
    /// Drives backwards within what is remembered.
    BackOff {
        /// What is left, in metres.
        left_m: f64,
    },
    /// Searches a way for the footprint itself, where the circle around it finds none, and drives it.
    Thread,
    /// Drives along a wall until the straight line to the goal is met again nearer to it; the last before giving up.
    FollowWall {
        /// Where it began.
        from: Position,
        /// Whether the wall is kept to the left.
        on_left: bool,
    },
    /// Forgets what was seen, but for what stands near to the robot, and looks again: before it says that there is no way.
    Forget,
    /// Drives to the nearest safe nest.
    Retreat {
        /// Where it lies.
        to: Position,
    },
}

/// What happened in a step.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// Another status or reason than before.
    Status {
        /// The new status.
        status: Status,
        /// Why.
        reason: Reason,
    },
    /// What every overlapping grid says of the robot's pose; at every step with a region.
    Navigability {
        /// Each grid's answer.
        grids: Vec<bool>,
        /// The answer in the grids' mode.
        navigable: bool,
        /// Whether one grid alone says yes.
        disagreement: bool,
    },
    /// A scan was left out.
    ScanRefused {
        /// Why.
        reason: Reason,
    },
    /// The pose jumped; what was seen before is forgotten.
    PoseJump {
        /// How far, in metres.
        distance_m: f64,
        /// By how much it turned, counter-clockwise.
        turn_rad: f64,
    },
    /// The route on the memory is another one.
    Route {
        /// Its length in metres.
        length_m: f64,
        /// Whether the search began from nothing.
        afresh: bool,
    },
    /// The local method finds every direction closed.
    LocalClosed,
    /// Headway has stopped.
    Trap {
        /// Why it is taken for a trap.
        reason: Reason,
    },
    /// A recovery begins.
    Recovery {
        /// Which.
        recovery: Recovery,
        /// How many since the last headway.
        attempt: u32,
    },
    /// A place was marked as closed.
    Stamped {
        /// Where.
        at: Position,
    },
    /// The window of the route was made larger.
    WindowGrown {
        /// Cells along its side.
        cells: usize,
    },
    /// The wheels turn more than the robot moves.
    Slip {
        /// Share of the wheels' way that was lost.
        share: f64,
    },
    /// A penetrometer reading was taken in.
    ReadingTaken {
        /// Where it was taken.
        at: Position,
        /// The class that it looks like.
        class: SoilClass,
        /// Probability of each of [`crate::belief::CLASSES`] there now.
        probabilities: PerClass,
        /// Mean cone index in kPa of the layer that carries the vehicle; `None` where the cone was refused.
        cone_index_kpa: Option<f64>,
        /// Cells whose rank it changed.
        cells_changed: usize,
    },
    /// A penetrometer reading could not be used.
    ReadingRefused,
    /// News of the soil of an area were taken in.
    SoilUpdate {
        /// Who says so.
        source: String,
        /// When it was true, by its own word.
        told_s: f64,
        /// The likeliest class.
        class: SoilClass,
        /// Cells whose rank it changed.
        cells_changed: usize,
    },
    /// Cells came into nests or left them.
    NestsChanged {
        /// Cells that came into a nest.
        cells_gained: usize,
        /// Cells that left one.
        cells_lost: usize,
        /// Nests there are now.
        nests: usize,
    },
    /// The global way was laid, or repaired after the ground was known better.
    RouteRepaired {
        /// Its cost in seconds before, from where the robot was then; `None` without a way.
        cost_before: Option<f64>,
        /// Its cost now, from where the robot is.
        cost_after: Option<f64>,
        /// Its terrain cells.
        cells: usize,
        /// How robot and goal stand to each other.
        standing: Standing,
        /// Whether the search began from nothing.
        afresh: bool,
    },
    /// The robot stands and waits for a penetrometer reading where it is.
    ProbeWanted {
        /// Where.
        at: Position,
        /// Seconds of driving that the reading is expected to save, where that is why.
        expected_saving_s: Option<f64>,
    },
    /// No reading came in time; the robot drives on.
    ProbeMissed {
        /// How long it waited, in seconds.
        waited_s: f64,
    },
}

impl Event {
    /// A stable word for files.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Status { .. } => "status",
            Self::Navigability { .. } => "navigability",
            Self::ScanRefused { .. } => "scan_refused",
            Self::PoseJump { .. } => "pose_jump",
            Self::Route { .. } => "route",
            Self::LocalClosed => "local_closed",
            Self::Trap { .. } => "trap",
            Self::Recovery { .. } => "recovery",
            Self::Stamped { .. } => "stamped",
            Self::WindowGrown { .. } => "window_grown",
            Self::Slip { .. } => "slip",
            Self::ReadingTaken { .. } => "reading_taken",
            Self::ReadingRefused => "reading_refused",
            Self::SoilUpdate { .. } => "soil_update",
            Self::NestsChanged { .. } => "nests_changed",
            Self::RouteRepaired { .. } => "route_repaired",
            Self::ProbeWanted { .. } => "probe_wanted",
            Self::ProbeMissed { .. } => "probe_missed",
        }
    }
}
