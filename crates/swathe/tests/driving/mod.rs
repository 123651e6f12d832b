//! The navigator in the simulated world, with whatever a test does to what it senses. Each test program uses a part.
#![allow(dead_code, reason = "each test program uses a part")]

use swathe::drive::{Command, DriveParams, Event, Navigator, Observation, Reason, Region, Status};
use swathe::grid::{GridGeometry, Layer, Position};
use swathe::sensor::{Pose, Scan};
use swathe::sim::{self, Laser, Obstacle, Robot, RobotParams, Shape, World};
use swathe::soil::SoilClass;
use swathe::vehicle::{Motion, RunningGear, Steering, Vehicle, Wheels};

/// Seconds between steps.
pub const STEP_S: f64 = 1.0 / 35.0;

/// A Jackal-like robot that may stand on grades of 60 %.
pub fn jackal() -> Vehicle {
    Vehicle {
        length_m: 0.508,
        width_m: 0.43,
        ground_clearance_m: 0.065,
        mass_kg: 17.0,
        max_speed_mps: 2.0,
        min_turn_radius_m: 0.0,
        reaction_time_s: 0.3,
        sight_distance_m: 10.0,
        grade_up: 0.6,
        grade_down: 0.6,
        side_slope: 0.6,
        step_height_m: 0.05,
        power_w: 500.0,
        drive_efficiency: 0.55,
        idle_power_w: 34.0,
        braking_friction: 0.8,
        traction_friction: 0.9,
        manual_transmission: false,
        running_gear: RunningGear::Wheels(Wheels {
            count: 4,
            diameter_m: 0.194,
            width_m: 0.04,
            section_height_m: 0.03,
            deflection_m: 0.006,
            chains: false,
        }),
        measured_cone_index_kpa: None,
        gauge_m: None,
        centre_of_gravity_m: None,
    }
}

/// A car-like robot.
pub fn car() -> Vehicle {
    Vehicle {
        length_m: 3.0,
        width_m: 1.6,
        mass_kg: 800.0,
        max_speed_mps: 3.0,
        min_turn_radius_m: 4.0,
        ground_clearance_m: 0.3,
        power_w: 20_000.0,
        running_gear: RunningGear::Wheels(Wheels {
            count: 4,
            diameter_m: 0.6,
            width_m: 0.25,
            section_height_m: 0.15,
            deflection_m: 0.03,
            chains: false,
        }),
        ..jackal()
    }
}

pub fn motion(vehicle: &Vehicle) -> Motion {
    let is_car = vehicle.min_turn_radius_m > 0.0;
    Motion {
        steering: if is_car {
            Steering::Ackermann
        } else {
            Steering::Differential
        },
        max_acceleration_mps2: 1.5,
        max_braking_mps2: 2.0,
        max_turn_rate_radps: 2.0,
    }
}

/// Ground of 1 m cells, x from -10 to 70 and y from -40 to 40, whose height is given by place.
pub fn ground(height_m: impl Fn(f64, f64) -> f64) -> World {
    let geometry = GridGeometry::new(160, 160, 0.5, -10.0, 40.0).unwrap();
    let heights = geometry.cells().map(|cell| {
        let place = geometry.centre(cell);
        height_m(place.x_m, place.y_m) as f32
    });
    let heights = Layer::new(geometry, heights.collect(), "the heights").unwrap();
    World::new(heights, Layer::filled(geometry, SoilClass::Gravel as u8), 10.0).unwrap()
}

/// Crates of 0.6 m and 1 m height at places.
pub fn crates(places: &[(f64, f64)]) -> Vec<Obstacle> {
    let crate_at = |&(x_m, y_m): &(f64, f64)| Obstacle {
        shape: Shape::rectangle(Position::new(x_m, y_m), 0.6, 0.6, 0.3),
        height_m: 1.0,
    };
    places.iter().map(crate_at).collect()
}

/// A map of one rank around everything, with the world's true elevation.
pub fn map_of(world: &World) -> Region {
    let heights = world.relief().heights().clone();
    Region {
        ranks: Layer::filled(heights.geometry(), 8),
        elevation_m: Some(heights),
        route: Vec::new(),
        grids: None,
    }
}

/// What a step was given and what it told.
pub struct Moment<'a> {
    pub step: usize,
    pub time_s: f64,
    pub truth: &'a sim::BodyState,
    pub command: Command,
    pub navigator: &'a Navigator,
}

/// What a step is given; tests spoil it.
pub struct Given {
    pub time_s: f64,
    pub pose: Pose,
    pub speed_mps: f64,
    pub turn_rate_radps: f64,
    pub scan: Option<Scan>,
}

#[derive(Debug)]
pub struct Outcome {
    pub status: Status,
    pub reason: Reason,
    pub collisions: u32,
    pub seconds: f64,
    pub metres: f64,
    pub pose: Pose,
    pub events: Vec<(usize, Event)>,
}

pub struct Drive<'a> {
    pub world: &'a World,
    pub vehicle: Vehicle,
    pub start: Pose,
    pub goal: Position,
    pub region: Option<Region>,
    pub params: DriveParams,
    pub robot: RobotParams,
    pub seconds: f64,
}

impl<'a> Drive<'a> {
    pub fn new(world: &'a World, vehicle: Vehicle, goal: (f64, f64)) -> Self {
        let motion = motion(&vehicle);
        Self {
            world,
            start: Pose::level(0.0, 0.0, 0.0),
            goal: Position::new(goal.0, goal.1),
            region: None,
            params: DriveParams::default().within(&motion),
            robot: RobotParams {
                laser: Laser {
                    mount: swathe::sensor::Mount {
                        x_m: vehicle.length_m / 2.0 - 0.1,
                        ..swathe::sensor::Mount::default()
                    },
                    ..Laser::sick_lms200(false, false)
                },
                ..RobotParams::default()
            },
            vehicle,
            seconds: 120.0,
        }
    }

    pub fn run(self) -> Outcome {
        self.run_with(|_, _| {}, |_| {})
    }

    /// Drives; `spoil` may change what a step is given, `look` sees what came of it.
    pub fn run_with(self, mut spoil: impl FnMut(usize, &mut Given), mut look: impl FnMut(&Moment)) -> Outcome {
        let motion = motion(&self.vehicle);
        let mut robot = Robot::new(self.world, self.vehicle.clone(), motion, self.start, self.robot.clone()).unwrap();
        let mut navigator = Navigator::new(&self.vehicle, self.goal, self.region.clone(), self.params).unwrap();
        let mut outcome = Outcome {
            status: Status::Driving,
            reason: Reason::OnTheWay,
            collisions: 0,
            seconds: 0.0,
            metres: 0.0,
            pose: self.start,
            events: Vec::new(),
        };
        let mut command = sim::Command::default();
        let mut standing = 0;
        for step in 0..(self.seconds / STEP_S) as usize {
            let seen = robot.step(self.world, command, STEP_S);
            let mut given = Given {
                time_s: seen.body.time_s,
                pose: seen.pose,
                speed_mps: seen.body.wheel_speed_mps,
                turn_rate_radps: seen.body.turn_rate_radps,
                scan: seen.scan.map(|(_, scan)| scan),
            };
            spoil(step, &mut given);
            let told = navigator.step(&Observation {
                time_s: given.time_s,
                pose: given.pose,
                speed_mps: given.speed_mps,
                turn_rate_radps: given.turn_rate_radps,
                scan: given.scan.as_ref(),
                reading: None,
            });
            assert!(told.speed_mps.abs() <= self.vehicle.max_speed_mps && told.turn_rate_radps.is_finite());
            assert!(told.turn_rate_radps.abs() <= self.params.max_turn_rate_radps);
            command = sim::Command {
                speed_mps: told.speed_mps,
                turn_rate_radps: told.turn_rate_radps,
            };
            look(&Moment {
                step,
                time_s: seen.body.time_s,
                truth: &seen.body,
                command: told,
                navigator: &navigator,
            });
            outcome
                .events
                .extend(navigator.events().iter().map(|event| (step, event.clone())));
            outcome.status = told.status;
            outcome.reason = navigator.reason();
            outcome.collisions = seen.body.collisions;
            outcome.seconds = seen.body.time_s;
            outcome.metres += seen.body.pose.distance_m(&outcome.pose);
            outcome.pose = seen.body.pose;
            standing = match told.status {
                Status::Reached | Status::Stopped => standing + 20,
                Status::NoRoute => standing + 1,
                _ => 0,
            };
            if standing > 100 || seen.body.collisions > 0 {
                break;
            }
        }
        outcome
    }
}

impl Outcome {
    /// The steps of events that a test asks for.
    pub fn steps_of(&self, is_wanted: impl Fn(&Event) -> bool) -> Vec<usize> {
        let wanted = self.events.iter().filter(|(_, event)| is_wanted(event));
        wanted.map(|(step, _)| *step).collect()
    }

    pub fn told(&self) -> String {
        format!(
            "{:?} {:?} after {:.1} s and {:.1} m, {} collisions, at {:.1} {:.1}",
            self.status, self.reason, self.seconds, self.metres, self.collisions, self.pose.x_m, self.pose.y_m
        )
    }
}
