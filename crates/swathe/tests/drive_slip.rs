//! Wheels that slip and things that hold the robot unseen: what is told, and how it is driven after it.

mod driving;

use std::ops::Range;

use driving::{STEP_S, ground, jackal, motion};
use rstest::rstest;
use swathe::drive::{Command, DriveParams, Event, Navigator, Observation, Reason, Recovery, Status};
use swathe::grid::Position;
use swathe::sensor::Pose;
use swathe::sim::{self, LocaliserParams, Obstacle, Robot, RobotParams, Shape, World};

const GOAL: Position = Position { x_m: 30.0, y_m: 0.0 };

/// Ground that gives way under wheels which drive forwards.
struct Slick {
    x_m: Range<f64>,
    north_m: f64,
    /// Share of the wheels' way that is lost.
    lost: f64,
}

impl Slick {
    fn lost_at(&self, pose: &Pose, told_mps: f64) -> f64 {
        let is_on = self.x_m.contains(&pose.x_m) && pose.y_m.abs() < self.north_m;
        if is_on && told_mps > 0.0 { self.lost } else { 0.0 }
    }
}

/// What a step told, and where the robot was in truth.
struct Moment {
    time_s: f64,
    at: Pose,
    wheels_mps: f64,
    command: Command,
    reason: Reason,
    events: Vec<Event>,
}

/// Drives a Jackal 30 m to the east.
fn drive(world: &World, slick: Option<&Slick>, robot: RobotParams, seconds: f64) -> Vec<Moment> {
    let vehicle = jackal();
    let limits = motion(&vehicle);
    let mut robot = Robot::new(world, vehicle.clone(), limits, Pose::default(), robot).unwrap();
    let params = DriveParams::default().within(&limits);
    let mut navigator = Navigator::new(&vehicle, GOAL, None, params).unwrap();
    let mut moments: Vec<Moment> = Vec::new();
    let (mut told, mut wheels_mps) = (sim::Command::default(), 0.0_f64);
    for _ in 0..(seconds / STEP_S) as usize {
        let lost = slick.map_or(0.0, |slick| slick.lost_at(&robot.state().pose, told.speed_mps));
        let change = (-limits.max_braking_mps2 * STEP_S, limits.max_acceleration_mps2 * STEP_S);
        wheels_mps += (told.speed_mps - wheels_mps).clamp(change.0, change.1);
        let driven = if lost > 0.0 {
            sim::Command {
                speed_mps: (1.0 - lost) * wheels_mps,
                ..told
            }
        } else {
            told
        };
        let seen = robot.step(world, driven, STEP_S);
        if lost == 0.0 {
            wheels_mps = seen.body.wheel_speed_mps;
        }
        let command = navigator.step(&Observation {
            time_s: seen.body.time_s,
            pose: seen.pose,
            speed_mps: wheels_mps,
            turn_rate_radps: seen.body.turn_rate_radps,
            scan: seen.scan.as_ref().map(|(_, scan)| scan),
            reading: None,
        });
        told = sim::Command {
            speed_mps: command.speed_mps,
            turn_rate_radps: command.turn_rate_radps,
        };
        moments.push(Moment {
            time_s: seen.body.time_s,
            at: seen.body.pose,
            wheels_mps,
            command,
            reason: navigator.reason(),
            events: navigator.events().to_vec(),
        });
        if matches!(command.status, Status::Reached | Status::Stopped) {
            break;
        }
    }
    moments
}

/// Times and shares of the slips that were told.
fn slips(moments: &[Moment]) -> Vec<(f64, f64)> {
    let of = |moment: &Moment| {
        let share = |event: &Event| match *event {
            Event::Slip { share } => Some((moment.time_s, share)),
            _ => None,
        };
        moment.events.iter().filter_map(share).collect::<Vec<_>>()
    };
    moments.iter().flat_map(of).collect()
}

/// Where in a drive traps of a reason were told.
fn traps(moments: &[Moment], reason: Reason) -> Vec<usize> {
    let is_trap = |at: &usize| moments[*at].events.contains(&Event::Trap { reason });
    (0..moments.len()).filter(is_trap).collect()
}

fn is_reached(moments: &[Moment]) -> bool {
    moments
        .last()
        .is_some_and(|last| last.command.status == Status::Reached)
}

/// The moments of a drive within some seconds after a time.
fn after(moments: &[Moment], from_s: f64, seconds: f64) -> impl Iterator<Item = &Moment> {
    moments
        .iter()
        .filter(move |moment| (from_s..from_s + seconds).contains(&moment.time_s))
}

#[test]
fn a_slip_is_told_and_halves_the_speed_for_three_seconds_at_a_time() {
    let slick = Slick {
        x_m: 8.0..11.0,
        north_m: f64::INFINITY,
        lost: 0.8,
    };
    let moments = drive(&ground(|_, _| 0.0), Some(&slick), RobotParams::default(), 60.0);
    let slips = slips(&moments);
    let most_mps = jackal().max_speed_mps;
    let came_s = moments.iter().find(|moment| moment.at.x_m >= 8.0).unwrap().time_s;
    let first_s = slips[0].0;
    // It takes the time over which wheels and pose are compared, and no more.
    assert!((came_s..came_s + 2.0).contains(&first_s), "{came_s} {first_s}");
    for &(time_s, share) in &slips {
        assert!((0.7..0.85).contains(&share), "{time_s}: {share}");
    }
    for pair in slips.windows(2) {
        assert!((3.0..3.1).contains(&(pair[1].0 - pair[0].0)), "{slips:?}");
    }
    let before = after(&moments, came_s, first_s - came_s - STEP_S / 2.0);
    assert!(before.map(|moment| moment.command.speed_mps).fold(0.0, f64::max) > 0.95 * most_mps);
    for &(time_s, _) in &slips {
        for moment in after(&moments, time_s, 2.9) {
            let told_mps = moment.command.speed_mps;
            assert!(told_mps <= 0.5 * most_mps + 1e-9, "{}: {told_mps}", moment.time_s);
            assert!(told_mps > 0.4 * most_mps, "{}: {told_mps}", moment.time_s);
        }
    }
    // It goes on, and as fast as ever where the ground holds.
    assert!(traps(&moments, Reason::Slipping).is_empty() && is_reached(&moments));
    let on = after(&moments, slips[slips.len() - 1].0 + 5.0, 60.0);
    assert!(on.map(|moment| moment.command.speed_mps).fold(0.0, f64::max) > 0.95 * most_mps);
}

/// Asserts that the drive backs off after a trap, slowly and by more than a length.
fn backs_off(moments: &[Moment], trap: usize, reason: Reason) {
    let told = &moments[trap];
    let backs = |event: &Event| matches!(event, Event::Recovery { recovery: Recovery::BackOff { left_m }, .. } if *left_m >= 0.8);
    assert!(told.events.iter().any(backs), "{:?}", told.events);
    assert!(told.events.contains(&Event::Status {
        status: Status::Recovering,
        reason
    }));
    assert_eq!((told.command.status, told.reason), (Status::Recovering, reason));
    let recovers = |moment: &&Moment| moment.command.status == Status::Recovering;
    let backing: Vec<&Moment> = moments[trap..].iter().take_while(recovers).collect();
    for moment in &backing {
        let told_mps = moment.command.speed_mps;
        assert!(
            told_mps <= 0.0 && told_mps >= -0.25 * jackal().max_speed_mps - 1e-9,
            "{told_mps}"
        );
    }
    let backed_m = backing[backing.len() - 1].at.distance_m(&told.at);
    assert!(backed_m > 0.7, "{backed_m}");
}

#[test]
fn wheels_that_only_spin_are_a_trap_that_is_backed_out_of_and_gone_around() {
    let slick = Slick {
        x_m: 8.0..11.0,
        north_m: 1.0,
        lost: 0.99,
    };
    let moments = drive(&ground(|_, _| 0.0), Some(&slick), RobotParams::default(), 300.0);
    let spins = traps(&moments, Reason::Slipping);
    assert!(!spins.is_empty() && traps(&moments, Reason::Bumped).is_empty());
    assert!(slips(&moments)[0].0 <= moments[spins[0]].time_s);
    backs_off(&moments, spins[0], Reason::Slipping);
    assert!(is_reached(&moments));
}

/// Level ground with something lower than the beams, and higher than the robot climbs, across its way.
fn with_a_kerb(width_m: f64) -> World {
    let mut world = ground(|_, _| 0.0);
    let shape = Shape::rectangle(Position::new(10.0, 0.0), 0.4, width_m, 0.0);
    world.place(vec![Obstacle { shape, height_m: 0.2 }]).unwrap();
    world
}

#[rstest]
#[case::narrow(0.4)]
#[case::wide(1.5)]
fn what_holds_it_unseen_is_soon_noticed_backed_off_from_and_gone_around(#[case] width_m: f64) {
    let moments = drive(&with_a_kerb(width_m), None, RobotParams::default(), 300.0);
    let held = traps(&moments, Reason::Bumped);
    assert!(!held.is_empty() && traps(&moments, Reason::Slipping).is_empty() && slips(&moments).is_empty());
    backs_off(&moments, held[0], Reason::Bumped);
    // Whatever it is about, it does not push on for ever.
    let (mut pushed_s, mut longest_s) = (0.0_f64, 0.0_f64);
    for pair in moments.windows(2) {
        let pushes = pair[1].command.speed_mps > 0.3 && pair[1].wheels_mps.abs() < 0.01;
        pushed_s = if pushes { pushed_s + STEP_S } else { 0.0 };
        longest_s = longest_s.max(pushed_s);
    }
    assert!(longest_s < 5.0, "{longest_s}");
    assert!(is_reached(&moments));
}

#[rstest]
#[case::level(0.0, LocaliserParams::default())]
#[case::hilly(1.0, LocaliserParams::default())]
#[case::odometry_of_wheels_with_fixes(0.0, LocaliserParams {
    blind_to_slip: true,
    scale_error: 0.02,
    fix_rate_hz: 1.0,
    fix_noise_m: 0.1,
    ..LocaliserParams::default()
})]
fn a_drive_on_ground_that_holds_tells_of_no_slip_and_no_hold(#[case] swell_m: f64, #[case] localiser: LocaliserParams) {
    let world = ground(|x_m, y_m| swell_m * ((x_m / 6.0).sin() + (y_m / 7.0).cos()));
    let robot = RobotParams {
        localiser,
        ..RobotParams::default()
    };
    let moments = drive(&world, None, robot, 120.0);
    assert!(slips(&moments).is_empty(), "{:?}", slips(&moments));
    for reason in [Reason::Slipping, Reason::Bumped] {
        assert!(traps(&moments, reason).is_empty());
    }
    assert!(is_reached(&moments));
}
