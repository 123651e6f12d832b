//! The loop: sense, command, move.

use std::collections::VecDeque;

use crate::drive::{self, Navigator, Observation, Reason, Status};
use crate::grid::Position;
use crate::sensor::{PenetrometerReading, Pose, Scan};
use crate::sim::{self, Robot, World};

use super::blame::Trail;
use super::fault::{Held, Taken, clock_s, pose_told, reading_told};
use super::judge::{Outcome, STANDS_MPS, Tally, Verdict};
use super::record::{Recorder, Told, happenings};
use super::second::{Happening, Second};
use super::{EpisodeError, EpisodeParams};

/// Who takes part.
pub struct Actors<'a> {
    /// The truth.
    pub world: &'a World,
    /// The robot in it.
    pub robot: &'a mut Robot,
    /// What drives it.
    pub navigator: &'a mut Navigator,
    /// A clock in seconds, asked before and after every step of the navigator. A constant will do; nothing but
    /// [`Outcome::longest_step_s`] comes of it.
    pub clock: &'a mut dyn FnMut() -> f64,
}

/// Seconds for which the robot remembers where it was.
const POSES_S: f64 = 5.0;

/// A drive from its beginning on.
#[derive(Clone, Debug)]
pub struct Episode {
    params: EpisodeParams,
    seen: Option<sim::Observation>,
    held: Held,
    /// The same for every cone of the sonar ring.
    held_cones: Vec<Held>,
    /// Where the robot thought it was.
    poses: VecDeque<(f64, Pose)>,
    tally: Tally,
    trail: Trail,
    recorder: Recorder,
    faults_on: Vec<bool>,
    sunk: bool,
    /// Whether somebody wants a reading here.
    probe_wanted: bool,
    /// The reading under way and when it is done.
    probing: Option<(f64, PenetrometerReading)>,
    outcome: Option<Outcome>,
    /// When the second that is asked for next begins.
    next_s: f64,
}

impl Episode {
    /// An episode that begins with the robot as it is.
    ///
    /// # Errors
    /// [`EpisodeError::Figure`] when a parameter is not usable.
    pub fn new(robot: &Robot, params: EpisodeParams) -> Result<Self, EpisodeError> {
        params.validate()?;
        Ok(Self {
            faults_on: vec![false; params.faults.len()],
            tally: Tally::new(robot.state()),
            next_s: robot.state().time_s,
            params,
            seen: None,
            held: Held::default(),
            held_cones: vec![Held::default(); robot.params().sonar.len()],
            poses: VecDeque::new(),
            trail: Trail::default(),
            recorder: Recorder::default(),
            sunk: false,
            probe_wanted: false,
            probing: None,
            outcome: None,
        })
    }

    /// How it runs.
    pub fn params(&self) -> &EpisodeParams {
        &self.params
    }

    /// How it ended, once it has.
    pub fn outcome(&self) -> Option<&Outcome> {
        self.outcome.as_ref()
    }

    /// Has the robot stop and probe the soil, as an operator would.
    pub fn ask_for_probe(&mut self) {
        self.probe_wanted = true;
    }

    /// Drives on for some seconds, or to the end, and returns what happened. Seconds that are not finite or below 0 count as 0.
    pub fn advance(&mut self, actors: &mut Actors, seconds: f64) -> Second {
        let seconds = if seconds.is_finite() { seconds.max(0.0) } else { 0.0 };
        let mut second = Second {
            start_s: self.next_s,
            end_s: self.next_s + seconds,
            ..Second::default()
        };
        second.scans.beams = actors.robot.params().laser.beams;
        second.movers.radii_m = actors.world.movers().iter().map(|mover| mover.radius_m).collect();
        while self.outcome.is_none() {
            let seen = match self.seen.take() {
                Some(seen) => seen,
                // The first look, before anything moves.
                None => actors.robot.step(actors.world, sim::Command::default(), 0.0),
            };
            if seen.body.time_s + 1e-9 >= second.end_s {
                self.seen = Some(seen);
                break;
            }
            self.step(actors, seen, &mut second);
        }
        if self.outcome.is_some() {
            second.end_s = second.end_s.min(actors.robot.state().time_s.max(second.start_s));
        }
        self.next_s = second.end_s;
        second
    }

    /// One control step.
    fn step(&mut self, actors: &mut Actors, mut seen: sim::Observation, second: &mut Second) {
        let time_s = seen.body.time_s;
        self.note_faults(time_s, second);
        let faults = &self.params.faults;
        let pose = pose_told(faults, time_s, &seen.pose);
        self.poses.push_back((time_s, pose));
        while self.poses.front().is_some_and(|(then_s, _)| *then_s < time_s - POSES_S) {
            self.poses.pop_front();
        }
        let arrived = self.held.deliver(faults, time_s, seen.scan.take());
        let latest: Option<Scan> = arrived.last().and_then(|taken| self.brought_here(taken, &pose));
        let echoes = self.listen(actors, time_s, &pose, seen.sonar.take(), second);
        let reading = self.probe(actors, &seen.body, &pose, second);
        let before_s = (actors.clock)();
        let command = actors.navigator.step(&Observation {
            time_s: clock_s(&self.params.faults, time_s),
            pose,
            speed_mps: seen.body.wheel_speed_mps,
            turn_rate_radps: seen.body.turn_rate_radps,
            scan: latest.as_ref(),
            reading: reading.as_ref(),
        });
        self.tally.longest_step_s = self.tally.longest_step_s.max((actors.clock)() - before_s);
        second
            .events
            .extend(happenings(actors.navigator).map(|happening| (time_s, happening)));
        self.count(actors.navigator);
        if self.params.records {
            let told = Told {
                time_s,
                pose: &pose,
                speed_mps: seen.body.wheel_speed_mps,
                turn_rate_radps: seen.body.turn_rate_radps,
                arrived: &arrived,
                echoes: &echoes,
                reading: reading.as_ref(),
                command,
                body: &seen.body,
            };
            self.recorder.step(second, actors.world, actors.navigator, &told);
        }
        // Nothing moves the vehicle while the cone is in the ground, or an operator waits for it to stand.
        let given = if self.probing.is_some() || self.probe_wanted {
            sim::Command::default()
        } else {
            sim::Command {
                speed_mps: command.speed_mps,
                turn_rate_radps: command.turn_rate_radps,
            }
        };
        let collisions = seen.body.collisions;
        self.trail.note(&seen.body);
        let seen = actors.robot.step(actors.world, given, self.params.control_period_s);
        self.trail.note(&seen.body);
        self.note_body(actors, &seen.body, collisions, second);
        let verdict = if seen.body.collisions > collisions && self.params.stops_at_collision {
            Some((Verdict::Collision, "The vehicle ran into something."))
        } else {
            let told: (Status, Reason) = (command.status, actors.navigator.reason());
            self.tally.verdict(&self.params, &seen.body, told)
        };
        if let Some((verdict, reason)) = verdict {
            let goal = actors.navigator.goal();
            self.outcome = Some(self.tally.outcome(&seen.body, goal, verdict, reason));
            second
                .events
                .push((seen.body.time_s, Happening::End { verdict, reason }));
        }
        self.seen = Some(seen);
    }

    /// Hands what the sonar ring heard to the navigator; cones fail as scans do.
    fn listen(
        &mut self,
        actors: &mut Actors,
        time_s: f64,
        pose: &Pose,
        heard: Option<(f64, Vec<Scan>)>,
        second: &mut Second,
    ) -> Vec<(usize, Taken)> {
        let (taken_s, mut scans) = heard.map_or((time_s, Vec::new().into_iter()), |(taken_s, scans)| {
            (taken_s, scans.into_iter())
        });
        let mut echoes = Vec::new();
        for (cone, held) in self.held_cones.iter_mut().enumerate() {
            let scan = scans.next().map(|scan| (taken_s, scan));
            let arrived = held.deliver(&self.params.faults, time_s, scan);
            echoes.extend(arrived.into_iter().map(|taken| (cone, taken)));
        }
        let (mut hears, mut refused) = (false, None);
        for (_, taken) in &echoes {
            let Some(scan) = self.brought_here(taken, pose) else {
                continue;
            };
            let clock_s = clock_s(&self.params.faults, time_s);
            match actors.navigator.sense(clock_s, pose, &scan, sim::SONAR_CONE_RAD) {
                Ok(()) => hears = true,
                Err(reason) => refused = Some(reason),
            }
        }
        // A cone that says nothing is no news; a ring of them is.
        if let Some(reason) = refused.filter(|_| !hears) {
            let told = drive::Event::ScanRefused { reason };
            second.events.push((time_s, Happening::Drive(told)));
        }
        echoes
    }

    /// Begins a probe when one is wanted and the body stands, and hands out the reading when it is done.
    fn probe(
        &mut self,
        actors: &mut Actors,
        body: &sim::BodyState,
        pose: &Pose,
        second: &mut Second,
    ) -> Option<PenetrometerReading> {
        let time_s = body.time_s;
        if let Some((done_s, mut reading)) = self.probing.take() {
            if time_s + 1e-9 < done_s {
                self.probing = Some((done_s, reading));
                return None;
            }
            reading_told(&self.params.faults, time_s, &mut reading);
            return Some(reading);
        }
        let stands = body.speed_mps.abs() < STANDS_MPS && body.stop != Some(sim::Stop::Sunk);
        if (self.probe_wanted || actors.navigator.wants_probe()) && stands {
            self.probe_wanted = false;
            let (reading, seconds) = actors.robot.push(actors.world);
            let at = Position::new(pose.x_m, pose.y_m);
            second.events.push((time_s, Happening::ProbeBegins { at, seconds }));
            self.probing = Some((time_s + seconds, reading));
        }
        None
    }

    /// A scan as if it were taken from where the robot is now: its mount is where the sensor was. `None` when the robot does not
    /// remember any more where that was.
    fn brought_here(&self, (taken_s, scan): &Taken, pose: &Pose) -> Option<Scan> {
        let mut scan = scan.clone();
        let (_, then) = self.poses.iter().rev().find(|(then_s, _)| *then_s <= taken_s + 1e-9)?;
        if then == pose {
            return Some(scan);
        }
        let sensor = then.of_mount(&scan.mount);
        scan.mount = pose.mount_of(&sensor);
        Some(scan)
    }

    fn note_faults(&mut self, time_s: f64, second: &mut Second) {
        for (fault, was_on) in self.params.faults.iter().zip(&mut self.faults_on) {
            let is_on = fault.is_on(time_s);
            if is_on != *was_on {
                let name = fault.kind.name();
                let told = if is_on {
                    Happening::FaultBegins(name)
                } else {
                    Happening::FaultEnds(name)
                };
                second.events.push((time_s, told));
                *was_on = is_on;
            }
        }
    }

    fn count(&mut self, navigator: &Navigator) {
        for event in navigator.events() {
            match event {
                drive::Event::Route { .. } => self.tally.replans += 1,
                drive::Event::ReadingTaken { .. } => self.tally.probes += 1,
                drive::Event::SoilUpdate { .. } => self.tally.soil_updates += 1,
                _ => {}
            }
        }
    }

    fn note_body(&mut self, actors: &Actors, body: &sim::BodyState, collisions: u32, second: &mut Second) {
        let at = Position::new(body.pose.x_m, body.pose.y_m);
        if let Some(reason) = self.tally.note(actors.world, actors.robot.body().vehicle(), body) {
            second.events.push((body.time_s, Happening::NoGoEntered { at, reason }));
        }
        if body.collisions > collisions {
            let blame = self.trail.blame(actors.world, actors.robot);
            let told = Happening::Collision {
                at,
                moves: blame.moves,
                seen_in_time: blame.seen_in_time,
            };
            second.events.push((body.time_s, told));
        }
        if body.stop == Some(sim::Stop::Sunk) && !self.sunk {
            self.sunk = true;
            second.events.push((body.time_s, Happening::Sunk));
        }
    }
}
