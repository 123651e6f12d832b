//! The pipeline of a step.

use crate::grid::Position;
use crate::local::{CertaintyGrid, CertaintyParams};
use crate::nest::Navigability;
use crate::sensor::{Mount, PenetrometerReading, Pose, Scan, wrap};
use crate::vehicle::Vehicle;

use super::event::{Command, Event, Reason, Recovery, Status};
use super::follow::Thread;
use super::memory::Memory;
use super::motion::{Now, ROLLS_MPS};
use super::movers::GivingWay;
use super::odometry::Odometry;
use super::params::{DriveError, DriveParams, Shape};
use super::probing::Probing;
use super::region::{Region, RegionState, Source};
use super::route::{Ground, Layout, RouteWindow, Standing};
use super::safety::Surroundings;
use super::sense::{MEMORY_CELLS, Repeat, SURE};
use super::steer::Local;
use super::thread::Met;
use super::tracks::Tracks;
use super::unconfirmed::Unconfirmed;
use super::wall::Walk;
use super::watch::Watch;

/// Greatest coordinate, in metres, and speed that count as usable.
const PLACE_MAX_M: f64 = 1e8;
const SPEED_MAX: f64 = 1e3;

/// A pose that moved or turned by this much more than one and a half times what the vehicle can has jumped.
const JUMP_M: f64 = 0.5;
const JUMP_RAD: f64 = 0.5;

/// Seconds that count for the first step, and at most for any.
const FIRST_STEP_S: f64 = 0.1;
const STEP_MAX_S: f64 = 1.0;

/// What the robot senses in a step.
#[derive(Clone, Copy, Debug)]
pub struct Observation<'a> {
    /// Time in seconds, on a clock of its own.
    pub time_s: f64,
    /// Where the robot is, in the goal's frame.
    pub pose: Pose,
    /// Measured speed, negative when backing.
    pub speed_mps: f64,
    /// Measured turn rate, counter-clockwise.
    pub turn_rate_radps: f64,
    /// The latest scan, if a new one came.
    pub scan: Option<&'a Scan>,
    /// A penetrometer reading, if one came.
    pub reading: Option<&'a PenetrometerReading>,
}

/// The navigator with all that it remembers.
#[derive(Debug)]
pub struct Navigator {
    pub(super) params: DriveParams,
    pub(super) shape: Shape,
    pub(super) vehicle: Vehicle,
    pub(super) goal: Position,
    pub(super) pending_region: Option<Source>,
    pub(super) region: Option<RegionState>,
    pub(super) grid: CertaintyGrid,
    pub(super) memory: Memory,
    pub(super) window: Option<RouteWindow>,
    pub(super) window_cells: usize,
    pub(super) local: Local,
    pub(super) around: Surroundings,
    pub(super) watch: Watch,
    pub(super) recovery: Option<Recovery>,
    pub(super) walk: Walk,
    /// Where things were met, for ways of the footprint itself.
    pub(super) met: Met,
    pub(super) thread: Thread,
    pub(super) odometry: Odometry,
    pub(super) tracks: Tracks,
    pub(super) giving_way: GivingWay,
    pub(super) unconfirmed: Unconfirmed,
    pub(super) attempts: u32,
    pub(super) all_attempts: u32,
    pub(super) trap_at: Option<Position>,
    pub(super) looked_around: bool,
    /// Whether it has forgotten what it had seen on the way to this goal.
    pub(super) has_forgotten: bool,
    pub(super) end: Option<(Status, Reason)>,
    pub(super) slip_until_s: f64,
    pub(super) blocked_since_s: Option<f64>,
    pub(super) probing: Probing,
    /// What happened between steps.
    pub(super) news: Vec<Event>,
    last: Option<(f64, Pose)>,
    /// Seconds since the step before, as far as they count.
    step_s: f64,
    /// Time of the last command, whatever it was given for.
    told_s: Option<f64>,
    pub(super) scan_time_s: Option<f64>,
    pub(super) refused: Option<Reason>,
    pub(super) repeat: Repeat,
    /// The same for every further sensor, by its mount.
    pub(super) repeats: Vec<(Mount, Repeat)>,
    pub(super) last_command: Command,
    reason: Reason,
    pub(super) events: Vec<Event>,
}

impl Navigator {
    /// A navigator at rest, which waits for its first scan.
    ///
    /// # Errors
    /// [`DriveError`] when the vehicle, a parameter, the goal or the region's grids are not usable.
    pub fn new(
        vehicle: &Vehicle,
        goal: Position,
        region: Option<Region>,
        params: DriveParams,
    ) -> Result<Self, DriveError> {
        Self::on(vehicle, goal, region.map(Source::Ranked), params)
    }

    /// A navigator on whatever is known of the ground.
    pub(super) fn on(
        vehicle: &Vehicle,
        goal: Position,
        region: Option<Source>,
        params: DriveParams,
    ) -> Result<Self, DriveError> {
        vehicle.validate()?;
        params.validate()?;
        for (name, given) in [("goal's x in metres", goal.x_m), ("goal's y in metres", goal.y_m)] {
            check_place(name, given)?;
        }
        if let Some(region) = &region {
            // Made at the first pose; what can be wrong with them is told now.
            RegionState::check(region, vehicle)?;
        }
        let shape = Shape::of(vehicle, &params);
        let needed_m = shape.stopping_m(shape.max_speed_mps) + shape.radius_m + 1.0;
        let cell_size_m = (needed_m / 90.0).max(shape.radius_m / 14.0).max(0.1);
        let half = (needed_m / cell_size_m).ceil() as usize;
        let grid = CertaintyParams {
            cell_size_m,
            side_cells: 161.max(2 * half + 21),
            evidence: params.evidence,
            fade_s: params.fade_s,
        };
        Ok(Self {
            grid: CertaintyGrid::new(grid, 0.0, 0.0),
            memory: Memory::new(cell_size_m * MEMORY_CELLS as f64, params.most_tiles),
            window: None,
            window_cells: params.window_cells,
            local: Local::new(params.method, &shape, cell_size_m, (2 * half + 1).clamp(61, 121)),
            around: Surroundings::default(),
            watch: Watch::default(),
            recovery: None,
            walk: Walk::default(),
            met: Met::new(),
            thread: Thread::default(),
            odometry: Odometry::default(),
            tracks: Tracks::default(),
            giving_way: GivingWay::default(),
            unconfirmed: Unconfirmed::default(),
            attempts: 0,
            all_attempts: 0,
            trap_at: None,
            looked_around: false,
            has_forgotten: false,
            end: None,
            slip_until_s: f64::NEG_INFINITY,
            blocked_since_s: None,
            probing: Probing::default(),
            news: Vec::new(),
            last: None,
            step_s: FIRST_STEP_S,
            told_s: None,
            scan_time_s: None,
            refused: None,
            repeat: Repeat::default(),
            repeats: Vec::new(),
            last_command: Command {
                speed_mps: 0.0,
                turn_rate_radps: 0.0,
                status: Status::Driving,
            },
            reason: Reason::OnTheWay,
            events: Vec::new(),
            vehicle: vehicle.clone(),
            pending_region: region,
            region: None,
            goal,
            shape,
            params,
        })
    }

    /// What happened in the last step.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// Why the last step's status holds.
    pub fn reason(&self) -> Reason {
        self.reason
    }

    /// The goal.
    pub fn goal(&self) -> Position {
        self.goal
    }

    /// The way on the memory from the robot on, empty when there is none.
    pub fn way(&self) -> &[Position] {
        self.window.as_ref().map_or(&[], |window| &window.way)
    }

    /// What is seen around the robot.
    pub fn certainty(&self) -> &CertaintyGrid {
        &self.grid
    }

    /// Sets another goal and starts anew towards it; what was seen is kept.
    ///
    /// # Errors
    /// [`DriveError::Figure`] when it is not a place.
    pub fn set_goal(&mut self, goal: Position) -> Result<(), DriveError> {
        for (name, given) in [("goal's x in metres", goal.x_m), ("goal's y in metres", goal.y_m)] {
            check_place(name, given)?;
        }
        self.goal = goal;
        self.end = None;
        self.window = None;
        self.start_over();
        if let Some(at) = self.place() {
            let told = std::mem::take(&mut self.events);
            self.lay_global(at);
            self.news.append(&mut self.events);
            self.events = told;
        }
        Ok(())
    }

    /// Where the robot was last.
    pub(super) fn place(&self) -> Option<Position> {
        self.last.map(|(_, pose)| Position::new(pose.x_m, pose.y_m))
    }

    /// A step: what was observed in, a command out. Any input is taken; what cannot be used ends in a stop with its reason,
    /// never in a panic.
    pub fn step(&mut self, seen: &Observation) -> Command {
        self.events.clear();
        self.events.append(&mut self.news);
        let before = (self.last_command.status, self.reason);
        let (wanted, status, reason) = self.decide(seen);
        let command = self.limited(wanted, status, seen);
        self.told_s = seen.time_s.is_finite().then_some(seen.time_s).or(self.told_s);
        if before != (status, reason) {
            self.events.push(Event::Status { status, reason });
        }
        self.reason = reason;
        self.last_command = command;
        command
    }

    /// The one list of a step.
    fn decide(&mut self, seen: &Observation) -> ((f64, f64), Status, Reason) {
        let stand = |status, reason| ((0.0, 0.0), status, reason);
        if !is_usable(seen) {
            return stand(Status::Fault, Reason::BadState);
        }
        let told = Pose {
            heading_rad: wrap(seen.pose.heading_rad),
            ..seen.pose
        };
        let kept = self.keep_time(seen.time_s, &told);
        let step_s = kept.unwrap_or(0.0);
        let moves = (seen.speed_mps, seen.turn_rate_radps);
        let pose = self.odometry.roll(seen.time_s, &told, moves, step_s);
        let placed = seen.scan.map(|scan| self.odometry.place(&told, scan));
        let scan = placed.as_deref();
        let at = Position::new(pose.x_m, pose.y_m);
        if kept.is_ok() {
            self.begin_region(at);
        }
        let is_taken = self.look(seen.time_s, &pose, scan, step_s);
        if let Err(reason) = kept {
            return stand(Status::Fault, reason);
        }
        self.take_reading(seen, at);
        let answer = self.ask_grids(&pose);
        if let Some((status, reason)) = self.end {
            return stand(status, reason);
        }
        if at.distance_m(self.goal) <= self.params.arrival_m {
            self.end = Some((Status::Reached, Reason::AtGoal));
            return stand(Status::Reached, Reason::AtGoal);
        }
        let Some(scan_s) = &mut self.scan_time_s else {
            return stand(Status::Fault, self.refused.unwrap_or(Reason::NoScanYet));
        };
        // What comes from a clock that runs ahead is of now at best, and ages from now on.
        *scan_s = scan_s.min(seen.time_s);
        let age_s = seen.time_s - *scan_s;
        if age_s > self.params.stale_s {
            self.watch.restart();
            return stand(Status::Fault, self.refused.unwrap_or(Reason::StaleScan));
        }
        let scan = scan.filter(|_| is_taken);
        self.gather(&pose, seen.speed_mps);
        if let Some(reason) = self.own_ground(at) {
            self.end = Some((Status::Stopped, reason));
            return stand(Status::Stopped, reason);
        }
        if let Some(told) = self.cut_off() {
            return told;
        }
        let aim = self.aim();
        if self.params.memory {
            self.lay_route(at, aim);
            if let Some((status, reason)) = self.no_way(seen.time_s, at) {
                return stand(status, reason);
            }
        }
        self.note_headway(seen, &pose, step_s);
        let now = Now {
            time_s: seen.time_s,
            step_s,
            age_s,
            pose,
            speed_mps: seen.speed_mps,
            turn_rate_radps: seen.turn_rate_radps,
            scan,
            answer,
            aim,
        };
        if let Some(told) = self.probe(&now) {
            return told;
        }
        if self.params.recover
            && let Some((wanted, status, reason)) = self.recover(&now)
        {
            let wanted = self.give_way(&now, wanted);
            return (self.guarded(&now, wanted), status, reason);
        }
        if let Some((status, reason)) = self.end {
            return stand(status, reason);
        }
        let wanted = self.drive(&now);
        let wanted = self.give_way(&now, wanted);
        let wanted = self.guarded(&now, wanted);
        match self.recovery {
            Some(_) => (wanted, Status::Recovering, Reason::GroundNoGo),
            None => (wanted, Status::Driving, Reason::OnTheWay),
        }
    }

    /// Gathers what stands around a pose: from the certainty grid, and what was met too seldom for it.
    fn gather(&mut self, pose: &Pose, speed_mps: f64) {
        let reach_m = self.shape.reach_m();
        let stopping_m = self.shape.stopping_m(speed_mps.abs().min(self.shape.max_speed_mps));
        self.around.gather(
            (&self.grid, SURE),
            pose,
            &self.shape,
            (reach_m, stopping_m),
            (self.margin_m(speed_mps), self.least_m()),
        );
        self.around.add(
            self.unconfirmed.places(),
            (&self.grid, SURE),
            pose,
            &self.shape,
            reach_m,
        );
    }

    /// Seconds since the last step, or why they cannot be told.
    fn keep_time(&mut self, time_s: f64, pose: &Pose) -> Result<f64, Reason> {
        let Some((last_s, last)) = self.last.replace((time_s, *pose)) else {
            self.grid.move_to(pose.x_m, pose.y_m);
            self.step_s = FIRST_STEP_S;
            return Ok(FIRST_STEP_S);
        };
        let step_s = time_s - last_s;
        let (distance_m, turn_rad) = (last.distance_m(pose), wrap(pose.heading_rad - last.heading_rad));
        if step_s < 0.0 {
            // What came before is of another time; the next step goes on from this one.
            self.scan_time_s = None;
            self.watch.restart();
            return Err(Reason::ClockWentBack);
        }
        let may_turn_rad = 1.5 * self.shape.max_turn_rate_radps * step_s + JUMP_RAD;
        if distance_m > 1.5 * self.shape.max_speed_mps * step_s + JUMP_M || turn_rad.abs() > may_turn_rad {
            self.events.push(Event::PoseJump { distance_m, turn_rad });
            self.grid.clear();
            self.memory.clear();
            self.met.clear();
            self.odometry = Odometry::default();
            self.tracks.clear();
            self.unconfirmed.clear();
            self.window = None;
            self.scan_time_s = None;
            self.start_over();
            self.grid.move_to(pose.x_m, pose.y_m);
            return Err(Reason::PoseJumped);
        }
        self.step_s = step_s.min(STEP_MAX_S);
        Ok(self.step_s)
    }

    /// Forgets what the drive was busy with.
    pub(super) fn start_over(&mut self) {
        self.watch.restart();
        self.watch.forget_places();
        self.recovery = None;
        self.walk = Walk::default();
        self.thread = Thread::default();
        self.attempts = 0;
        self.all_attempts = 0;
        self.has_forgotten = false;
        self.trap_at = None;
        self.looked_around = false;
        self.blocked_since_s = None;
        self.local.forget();
        if let Some(region) = &mut self.region {
            region.leaving_no_go = false;
        }
    }

    fn ask_grids(&mut self, pose: &Pose) -> Option<Navigability> {
        let answer = self.region.as_mut()?.ask(pose);
        self.events.push(Event::Navigability {
            grids: (0..answer.grids()).map(|grid| answer.in_grid(grid)).collect(),
            navigable: answer.navigable(),
            disagreement: answer.disagreement(),
        });
        Some(answer)
    }

    /// Says so when the map knows no way to the goal, and waits for better news.
    fn cut_off(&mut self) -> Option<((f64, f64), Status, Reason)> {
        let region = self.region.as_ref()?;
        let is_off = !region.lets_arrive(self.goal, self.params.arrival_m);
        if self.recovery.is_some() || !(is_off || region.is_cut_off()) {
            return None;
        }
        self.watch.restart();
        let reason = if is_off { Reason::GoalOffMap } else { Reason::CutOff };
        Some(((0.0, 0.0), Status::NoRoute, reason))
    }

    /// What is driven to: the goal, or a safe nest first.
    fn aim(&self) -> Position {
        match self.recovery {
            Some(Recovery::Retreat { to }) => to,
            _ => self.goal,
        }
    }

    /// Keeps the window around the robot and the way in it right.
    fn lay_route(&mut self, at: Position, aim: Position) {
        let stale = self.window.as_ref().is_none_or(|window| {
            (window.is_leaving(at)
                && !(window.goal_inside && window.standing == Standing::Found && !window.is_outside(at)))
                || window.cells() != self.window_cells
        });
        if stale {
            let layout = Layout {
                cells: self.window_cells,
                closed_m: self.shape.radius_m + 0.5 * self.params.margin_m,
                unknown_cost: self.params.unknown_cost,
                arrival_m: self.params.arrival_m,
                goal: aim,
                global: self.region.as_ref().map_or(&[], |region| region.rest_of_route(at)),
            };
            let ground = self.region.as_ref().map(|region| region as &dyn Ground);
            self.window = RouteWindow::new(&self.memory, at, &layout, ground);
        }
        let Some(window) = &mut self.window else { return };
        if let Some(afresh) = window.repair(at) {
            let length_m = window.length_m();
            self.events.push(Event::Route { length_m, afresh });
        }
    }

    /// The command within the vehicle's limits, whatever was wanted.
    fn limited(&self, (wanted_mps, turn_radps): (f64, f64), status: Status, seen: &Observation) -> Command {
        let finite = |value: f64| if value.is_finite() { value } else { 0.0 };
        let (wanted_mps, turn_radps) = (finite(wanted_mps), finite(turn_radps));
        let told_mps = self.last_command.speed_mps;
        let since_s = self
            .told_s
            .map_or(self.step_s, |told_s| finite(seen.time_s - told_s).max(0.0));
        let step_s = self.step_s.min(since_s);
        let speed_mps = self
            .shape
            .reachable(wanted_mps, finite(seen.speed_mps), told_mps, step_s);
        // What is slower than wanted keeps to the same arc, and so does what brakes: that is what was looked at.
        let share = if wanted_mps == 0.0 { 1.0 } else { speed_mps / wanted_mps };
        let rolls_mps = finite(seen.speed_mps);
        let turn_radps = if (wanted_mps, turn_radps) == (0.0, 0.0) && rolls_mps.abs() > ROLLS_MPS {
            finite(seen.turn_rate_radps) * (1.0 - self.shape.braking_mps2 * step_s / rolls_mps.abs()).max(0.0)
        } else {
            turn_radps * share
        };
        Command {
            speed_mps,
            turn_rate_radps: self.shape.turn_rate(turn_radps, speed_mps),
            status,
        }
    }

    fn note_headway(&mut self, seen: &Observation, pose: &Pose, step_s: f64) {
        let told_mps = self.last_command.speed_mps;
        self.watch
            .note(seen.time_s, step_s, pose, seen.speed_mps, told_mps, self.params.trap_s);
        let at = Position::new(pose.x_m, pose.y_m);
        if self.recovery.is_none() {
            self.watch
                .note_place(pose.x_m, pose.y_m, (0.5 * self.shape.radius_m).max(0.5));
        }
        let away_m = (4.0 * self.shape.radius_m).max(3.0);
        if self.trap_at.is_some_and(|trap| trap.distance_m(at) > away_m) {
            self.trap_at = None;
            self.attempts = 0;
            self.looked_around = false;
        }
    }
}

fn check_place(name: &'static str, given: f64) -> Result<(), DriveError> {
    if given.abs() <= PLACE_MAX_M {
        return Ok(());
    }
    let allowed = "it must be finite and at most 1e8 m from the origin";
    Err(DriveError::Figure { name, given, allowed })
}

/// Whether time and pose can be used.
pub(super) fn is_place(time_s: f64, pose: &Pose) -> bool {
    time_s.is_finite() && pose.is_finite() && pose.x_m.abs() <= PLACE_MAX_M && pose.y_m.abs() <= PLACE_MAX_M
}

fn is_usable(seen: &Observation) -> bool {
    is_place(seen.time_s, &seen.pose) && seen.speed_mps.abs() <= SPEED_MAX && seen.turn_rate_radps.abs() <= SPEED_MAX
}
