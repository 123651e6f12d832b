//! A robot: a body with its sensors, and what reaches its computer and when.

use std::collections::VecDeque;

use crate::grid::Position;
use crate::sensor::{Mount, PenetrometerReading, Pose, Scan};
use crate::vehicle::Vehicle;

use super::{
    Body, BodyState, Command, Laser, Localiser, LocaliserParams, Motion, Noise, Penetrometer, SimError, World, require,
};

/// How a robot senses.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotParams {
    /// Its laser.
    pub laser: Laser,
    /// Whether it carries the laser.
    pub has_laser: bool,
    /// Cones of its sonar ring; none for none.
    pub sonar: Vec<Laser>,
    /// Its penetrometer.
    pub penetrometer: Penetrometer,
    /// Errors of its pose.
    pub localiser: LocaliserParams,
    /// Seconds from a scan to its arrival.
    pub scan_delay_s: f64,
    /// Share of scans that never arrive.
    pub scan_dropout: f64,
    /// Relative deviation of its slip.
    pub slip_variation: f64,
    /// Seed of everything that is drawn.
    pub seed: u64,
}

impl Default for RobotParams {
    /// A SICK LMS 200 in its 8 m mode, no sonar, exact poses, no delay or loss.
    fn default() -> Self {
        Self {
            laser: Laser::sick_lms200(false, false),
            has_laser: true,
            sonar: Vec::new(),
            penetrometer: Penetrometer::default(),
            localiser: LocaliserParams::default(),
            scan_delay_s: 0.0,
            scan_dropout: 0.0,
            slip_variation: 0.2,
            seed: 0,
        }
    }
}

/// What reaches the robot's computer after a step, and the truth beside it.
#[derive(Clone, Debug)]
pub struct Observation {
    /// The pose as the robot thinks it is.
    pub pose: Pose,
    /// The newest scan that arrived in this step and the time at which it was taken.
    pub scan: Option<(f64, Scan)>,
    /// The newest shot of the sonar ring that arrived in this step, one scan of a single beam from every cone, and the time at
    /// which it was taken.
    pub sonar: Option<(f64, Vec<Scan>)>,
    /// The truth.
    pub body: BodyState,
}

/// A robot in the world.
#[derive(Clone, Debug)]
pub struct Robot {
    body: Body,
    params: RobotParams,
    noise: Noise,
    localiser: Localiser,
    /// Scans under way with the time at which they were taken.
    under_way: VecDeque<(f64, Scan)>,
    /// The same of the sonar ring.
    echoes: VecDeque<(f64, Vec<Scan>)>,
    scans: u64,
    pings: u64,
    shots: u64,
    pushes: u64,
}

impl Robot {
    /// A robot at rest.
    ///
    /// # Errors
    /// [`SimError`] when the vehicle, the pose or a parameter is not usable.
    pub fn new(
        world: &World,
        vehicle: Vehicle,
        motion: Motion,
        at: Pose,
        params: RobotParams,
    ) -> Result<Self, SimError> {
        params.laser.validate()?;
        params.sonar.iter().try_for_each(Laser::validate)?;
        params.penetrometer.validate()?;
        let delay = params.scan_delay_s;
        require(
            "delay of scans",
            delay,
            (0.0..=60.0).contains(&delay),
            "0 to 60 s is allowed",
        )?;
        let share = params.scan_dropout;
        require(
            "share of lost scans",
            share,
            (0.0..=1.0).contains(&share),
            "0 to 1 is allowed",
        )?;
        let noise = Noise::new(params.seed);
        let body = Body::new(world, vehicle, motion, at, params.slip_variation, noise)?;
        let localiser = Localiser::new(params.localiser, body.state(), noise)?;
        Ok(Self {
            body,
            params,
            noise,
            localiser,
            under_way: VecDeque::new(),
            echoes: VecDeque::new(),
            scans: 0,
            pings: 0,
            shots: 0,
            pushes: 0,
        })
    }

    /// The truth.
    pub fn state(&self) -> &BodyState {
        self.body.state()
    }

    /// The body.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// How it senses.
    pub fn params(&self) -> &RobotParams {
        &self.params
    }

    /// The pose as the robot thinks it is.
    pub fn pose(&self) -> Pose {
        self.localiser.estimate()
    }

    /// Moves for a time and senses at the end: a scan is taken when one was due in between (the newest, where several were).
    pub fn step(&mut self, world: &World, command: Command, duration_s: f64) -> Observation {
        let body = *self.body.step(world, command, duration_s);
        let pose = self.localiser.update(&body);
        let due = (body.time_s * self.params.laser.rate_hz + 1e-9).floor() as u64 + 1;
        if self.params.has_laser && due > self.scans {
            self.scans = due;
            if !self.is_lost(due, u32::MAX) {
                let scan = self.scan(world);
                self.under_way.push_back((body.time_s, scan));
            }
        }
        if let Some(cone) = self.params.sonar.first() {
            let due = (body.time_s * cone.rate_hz + 1e-9).floor() as u64 + 1;
            if due > self.pings {
                self.pings = due;
                if !self.is_lost(due, u32::MAX - 1) {
                    let echo = self.sonar(world);
                    self.echoes.push_back((body.time_s, echo));
                }
            }
        }
        let until_s = body.time_s + 1e-9 - self.params.scan_delay_s;
        let scan = newest(&mut self.under_way, until_s);
        let sonar = newest(&mut self.echoes, until_s);
        Observation {
            pose,
            scan,
            sonar,
            body,
        }
    }

    /// Whether a scan or a shot of the ring never arrives.
    fn is_lost(&self, count: u64, draw: u32) -> bool {
        self.noise.units(super::noise::Stream::Beams, count, draw)[0] < self.params.scan_dropout
    }

    /// A scan of this moment.
    pub fn scan(&mut self, world: &World) -> Scan {
        let state = self.body.state();
        self.shots += 1;
        let laser = &self.params.laser;
        laser.scan(world, &state.pose, state.height_m, state.time_s, self.noise, self.shots)
    }

    /// One scan of a single beam from every sonar.
    pub fn sonar(&mut self, world: &World) -> Vec<Scan> {
        let state = self.body.state();
        self.shots += 1;
        let cone = |(n, cone): (u32, &Laser)| {
            cone.cone(
                world,
                &state.pose,
                state.height_m,
                state.time_s,
                self.noise,
                self.shots,
                n,
            )
        };
        (0u32..).zip(&self.params.sonar).map(cone).collect()
    }

    /// Stops, pushes the penetrometer into the soil before the robot, and gives the reading when it is done. Its place is the one
    /// that the robot thinks it is at.
    pub fn probe(&mut self, world: &World) -> PenetrometerReading {
        // A vehicle that slides does not probe for ever.
        for _ in 0..600 {
            if self.body.state().speed_mps == 0.0 {
                break;
            }
            self.body.wait(world, 0.1);
        }
        let (reading, seconds) = self.push(world);
        self.body.wait(world, seconds);
        self.localiser.update(self.body.state());
        reading
    }

    /// A reading of the soil at the cone's place, at the end of its boom, and the seconds that the push takes; time does not pass
    /// here. Its place is the one that follows from where the robot thinks it is.
    pub fn push(&mut self, world: &World) -> (PenetrometerReading, f64) {
        let pose = self.localiser.update(self.body.state());
        let at = self.body.state().pose;
        let push = self.pushes;
        self.pushes += 1;
        let mount = Mount {
            x_m: 0.5 * self.body.vehicle().length_m + self.params.penetrometer.boom_m,
            ..Mount::default()
        };
        let [place, thought] = [at, pose].map(|pose| pose.of_mount(&mount));
        let cone = Position::new(place.x_m, place.y_m);
        let (mut reading, seconds) = self.params.penetrometer.probe(world, cone, self.noise, push);
        (reading.x_m, reading.y_m) = (thought.x_m, thought.y_m);
        (reading, seconds)
    }
}

/// The newest of what was taken until a time; older ones are let go.
fn newest<T>(under_way: &mut VecDeque<(f64, T)>, until_s: f64) -> Option<(f64, T)> {
    let mut found = None;
    while under_way.front().is_some_and(|(taken_s, _)| *taken_s <= until_s) {
        found = under_way.pop_front();
    }
    found
}
