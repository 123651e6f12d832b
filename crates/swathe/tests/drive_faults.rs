//! Faults in the middle of a drive: a safe stop, a clear event, and on again when the fault is over.

mod driving;

use driving::{Drive, Given, Outcome, STEP_S, car, crates, ground, jackal, map_of, motion};
use rstest::rstest;
use swathe::drive::{Event, Reason, Status};
use swathe::grid::Position;
use swathe::sensor::Scan;
use swathe::sim::{LocaliserParams, Obstacle, RobotParams, Shape, World};
use swathe::vehicle::Vehicle;

/// The fault lasts from the first step to the second.
const FROM: usize = 140;
const TO: usize = 280;

fn plain() -> World {
    let mut world = ground(|_, _| 0.0);
    world.place(crates(&[(12.0, 0.2), (20.0, -1.5), (26.0, 1.0)])).unwrap();
    world
}

type Spoil = fn(usize, &mut Given);

fn ranges(given: &mut Given, change: impl Fn(&mut Scan)) {
    if let Some(scan) = &mut given.scan {
        change(scan);
    }
}

/// Every way a sensor may fail that leaves the robot without sight.
const BLINDING: [(&str, Spoil, Reason); 9] = [
    ("dead", |_, given| given.scan = None, Reason::StaleScan),
    (
        "empty",
        |_, given| ranges(given, |scan| scan.ranges_m.clear()),
        Reason::BadScan,
    ),
    (
        "nan",
        |_, given| ranges(given, |scan| scan.ranges_m.fill(f64::NAN)),
        Reason::BlindScan,
    ),
    (
        "zero",
        |_, given| ranges(given, |scan| scan.ranges_m.fill(0.0)),
        Reason::BlindScan,
    ),
    (
        "negative",
        |_, given| ranges(given, |scan| scan.ranges_m.fill(-1.0)),
        Reason::BlindScan,
    ),
    (
        "too long",
        |_, given| ranges(given, |scan| scan.ranges_m.resize(1000, 5.0)),
        Reason::BadScan,
    ),
    (
        "no limits",
        |_, given| ranges(given, |scan| scan.range_max_m = f64::NAN),
        Reason::BadScan,
    ),
    ("nowhere", |_, given| given.pose.x_m = f64::NAN, Reason::BadState),
    ("unphysical speed", |_, given| given.speed_mps = 1e9, Reason::BadState),
];

/// Metres driven after a step until the vehicle stood, and the greatest speed before.
fn driven_after(world: &World, vehicle: &Vehicle, spoil: Spoil) -> (Outcome, f64, f64, bool) {
    let (mut at, mut speed_mps, mut metres, mut stood) = (None, 0.0f64, 0.0, false);
    let outcome = Drive::new(world, vehicle.clone(), (34.0, 0.0)).run_with(
        |step, given| {
            if (FROM..TO).contains(&step) {
                spoil(step, given);
            }
        },
        |moment| {
            if moment.step == FROM - 1 {
                at = Some(moment.truth.pose);
                speed_mps = moment.truth.speed_mps.abs();
            }
            if let Some(at) = at
                && (FROM..TO).contains(&moment.step)
            {
                metres = moment.truth.pose.distance_m(&at);
                stood |= moment.truth.speed_mps == 0.0;
            }
        },
    );
    (outcome, metres, speed_mps, stood)
}

#[rstest]
fn a_blind_robot_stops_within_its_braking_distance_says_why_and_goes_on_when_it_sees_again(
    #[values(false, true)] is_car: bool,
    #[values(0, 1, 2, 3, 4, 5, 6, 7, 8)] fault: usize,
) {
    let (name, spoil, reason) = BLINDING[fault];
    let (world, vehicle) = (
        if is_car { ground(|_, _| 0.0) } else { plain() },
        if is_car { car() } else { jackal() },
    );
    let (outcome, metres, speed_mps, stood) = driven_after(&world, &vehicle, spoil);
    // Until the last scan is stale the robot may go on in what it saw; then it brakes.
    let allowed_m =
        speed_mps * (0.5 + 2.0 * STEP_S) + speed_mps * speed_mps / (2.0 * motion(&vehicle).max_braking_mps2) + 0.05;
    assert!(
        stood && metres <= allowed_m,
        "{name}: {metres} of {allowed_m} m: {}",
        outcome.told()
    );
    assert!(speed_mps > 0.5, "{name}: {speed_mps}");
    let told = outcome.steps_of(|event| {
        *event
            == Event::Status {
                status: Status::Fault,
                reason,
            }
    });
    assert!(
        told.iter().any(|step| (FROM..TO).contains(step)),
        "{name}: {:?}",
        outcome.events
    );
    let on = outcome.steps_of(|event| {
        matches!(
            event,
            Event::Status {
                status: Status::Driving,
                ..
            }
        )
    });
    assert!(on.iter().any(|&step| step >= TO), "{name}");
    assert!(
        outcome.status == Status::Reached && outcome.collisions == 0,
        "{name}: {}",
        outcome.told()
    );
}

#[rstest]
#[case::all_at_maximum_is_clear(|_: usize, given: &mut Given| ranges(given, |scan| scan.ranges_m.fill(scan.range_max_m)))]
#[case::every_tenth_scan_lost(|step: usize, given: &mut Given| if step.is_multiple_of(10) { given.scan = None })]
#[case::half_the_beams_lost(|step: usize, given: &mut Given| ranges(given, |scan| {
    scan.ranges_m.iter_mut().skip(step % 2).step_by(2).for_each(|range_m| *range_m = f64::NAN);
}))]
#[case::one_beam_mad(|step: usize, given: &mut Given| ranges(given, |scan| scan.ranges_m[step * 37 % 181] = 0.5))]
fn what_does_not_blind_the_robot_does_not_stop_it(#[case] spoil: Spoil) {
    // Nothing stands where the fault hides it.
    let world = ground(|_, _| 0.0);
    let outcome = Drive::new(&world, jackal(), (34.0, 0.0)).run_with(
        |step, given| {
            if (FROM..TO).contains(&step) {
                spoil(step, given);
            }
        },
        |_| {},
    );
    assert!(
        outcome.status == Status::Reached && outcome.seconds < 40.0,
        "{}",
        outcome.told()
    );
}

#[test]
fn repeated_scans_are_noticed_when_the_robot_moves() {
    let world = plain();
    let mut frozen = None;
    let outcome = Drive::new(&world, jackal(), (34.0, 0.0)).run_with(
        |step, given| {
            if step == FROM {
                frozen.clone_from(&given.scan);
            }
            if (FROM..TO).contains(&step) {
                given.scan.clone_from(&frozen);
            }
        },
        |_| {},
    );
    let reason = Reason::FrozenScan;
    assert!(
        !outcome
            .steps_of(|event| *event == Event::ScanRefused { reason })
            .is_empty(),
        "{}",
        outcome.told()
    );
    assert!(
        outcome.status == Status::Reached && outcome.collisions == 0,
        "{}",
        outcome.told()
    );
}

#[test]
fn late_scans_make_it_slower_and_not_blind() {
    let world = plain();
    let drive = |scan_delay_s| {
        let mut drive = Drive::new(&world, jackal(), (34.0, 0.0));
        drive.robot.scan_delay_s = scan_delay_s;
        drive.run()
    };
    let (prompt, late) = (drive(0.0), drive(0.2));
    assert!(
        late.status == Status::Reached && late.collisions == 0,
        "{}",
        late.told()
    );
    assert!(late.seconds > prompt.seconds, "{} {}", late.told(), prompt.told());
}

#[test]
fn a_clock_that_goes_back_and_a_pose_that_jumps_are_told_and_the_drive_goes_on() {
    let world = plain();
    let outcome = Drive::new(&world, jackal(), (34.0, 0.0)).run_with(
        |step, given| {
            if step == FROM {
                given.time_s -= 2.0;
            }
            if step == TO {
                given.pose.y_m += 30.0;
            }
        },
        |_| {},
    );
    let told = |reason| {
        outcome.steps_of(|event| {
            *event
                == Event::Status {
                    status: Status::Fault,
                    reason,
                }
        })
    };
    assert_eq!(told(Reason::ClockWentBack), [FROM]);
    assert!(told(Reason::PoseJumped).starts_with(&[TO]));
    assert!(
        outcome.status == Status::Reached && outcome.collisions == 0,
        "{}",
        outcome.told()
    );
}

#[rstest]
#[case::drift_with_fixes(LocaliserParams { scale_error: 0.02, fix_rate_hz: 1.0, fix_noise_m: 0.3, ..LocaliserParams::default() })]
fn a_noisy_pose_is_driven_with(#[case] localiser: LocaliserParams) {
    let world = plain();
    let mut drive = Drive::new(&world, jackal(), (34.0, 0.0));
    drive.robot = RobotParams {
        localiser,
        seed: 5,
        ..drive.robot
    };
    let outcome = drive.run();
    assert!(
        outcome.status == Status::Reached && outcome.collisions == 0,
        "{}",
        outcome.told()
    );
}

fn ring(x_m: f64, half_m: f64) -> Obstacle {
    let corner = |x: f64, y: f64| Position::new(x_m + half_m * x, half_m * y);
    let corners = [
        corner(-1.0, -1.0),
        corner(1.0, -1.0),
        corner(1.0, 1.0),
        corner(-1.0, 1.0),
        corner(-1.0, -1.0),
    ];
    Obstacle {
        shape: Shape::Wall(corners.to_vec()),
        height_m: 1.0,
    }
}

#[test]
fn goals_that_cannot_be_reached_are_told() {
    let mut inside = ground(|_, _| 0.0);
    inside
        .place(vec![Obstacle {
            shape: Shape::Disc {
                centre: Position::new(18.0, 0.0),
                radius_m: 1.5,
            },
            height_m: 1.0,
        }])
        .unwrap();
    let mut walled = ground(|_, _| 0.0);
    walled.place(vec![ring(18.0, 3.0)]).unwrap();
    let plain = ground(|_, _| 0.0);
    let cases = [
        (&inside, (18.0, 0.0), vec![Reason::GoalBlocked]),
        (&walled, (18.0, 0.0), vec![Reason::GoalBlocked]),
        (&plain, (200.0, 0.0), vec![Reason::GoalOffMap]),
    ];
    for (world, goal, reasons) in cases {
        let mut drive = Drive::new(world, jackal(), goal);
        drive.region = Some(map_of(world));
        let outcome = drive.run();
        assert_eq!(
            (outcome.status, outcome.collisions),
            (Status::NoRoute, 0),
            "{}",
            outcome.told()
        );
        assert!(reasons.contains(&outcome.reason), "{}", outcome.told());
    }
}

#[test]
fn without_a_memory_a_wall_is_followed_out_of_a_trap_and_inside_a_ring_it_is_given_up() {
    let mut trap = ground(|_, _| 0.0);
    let place = |x, y| Position::new(x, y);
    let wall = Shape::Wall(vec![
        place(9.0, -1.5),
        place(12.0, -1.5),
        place(12.0, 1.5),
        place(9.0, 1.5),
    ]);
    trap.place(vec![Obstacle {
        shape: wall,
        height_m: 1.0,
    }])
    .unwrap();
    let mut ringed = ground(|_, _| 0.0);
    ringed.place(vec![ring(0.0, 2.0)]).unwrap();
    let drive = |world, goal, wall_is_followed: bool| {
        let mut drive = Drive::new(world, jackal(), goal);
        drive.params.memory = false;
        drive.params.most_recoveries = 6;
        drive.params.follow_walls = wall_is_followed;
        drive.seconds = 400.0;
        drive.run()
    };
    let follows = |outcome: &Outcome| {
        let is_walk = |event: &Event| {
            matches!(
                event,
                Event::Recovery {
                    recovery: swathe::drive::Recovery::FollowWall { .. },
                    ..
                }
            )
        };
        !outcome.steps_of(is_walk).is_empty()
    };
    let out = drive(&trap, (24.0, 0.0), true);
    assert!(
        out.status == Status::Reached && out.collisions == 0 && follows(&out),
        "{}",
        out.told()
    );
    let held = drive(&trap, (24.0, 0.0), false);
    assert_eq!(
        (held.status, held.reason),
        (Status::Stopped, Reason::RecoveriesSpent),
        "{}",
        held.told()
    );
    let around = drive(&ringed, (18.0, 0.0), true);
    assert_eq!(
        (around.status, around.reason),
        (Status::Stopped, Reason::RecoveriesSpent),
        "{}",
        around.told()
    );
    assert!(follows(&around) && around.collisions == 0);
}
