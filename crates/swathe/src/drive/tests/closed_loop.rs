//! Whole drives.

use super::world::{Drive, Setup, World, car, jackal, pioneer, region};
use crate::drive::safety::Sight;
use crate::drive::{DriveParams, Method, Navigator, Observation, OutsideNests, Reason, Status};
use crate::grid::Position;
use crate::sensor::{Mount, Pose};
use crate::vehicle::Vehicle;
use rstest::rstest;

const GOAL: (f64, f64) = (28.0, 0.0);
const SIZE: (f64, f64) = (30.0, 30.0);

fn cluttered(seed: u64, count: u32, vehicle: &Vehicle) -> World {
    let free_m = 1.5 * vehicle.circumscribed_radius_m() + 0.3;
    World::strewn(
        seed,
        count,
        SIZE,
        (0.2, 0.8),
        &[(1.0, 0.0, free_m), (GOAL.0, GOAL.1, free_m)],
    )
}

fn told(drive: &Drive) -> String {
    format!(
        "{:?} {:?} after {:.1} s, {:.1} m, least clearance {:.2} m, {:?} at {:?}",
        drive.status,
        drive.navigator.reason(),
        drive.seconds,
        drive.metres,
        drive.least_clearance_m,
        drive.statuses,
        drive.pose
    )
}

#[rstest]
#[case(jackal())]
#[case(pioneer())]
#[case(car())]
fn free_space_is_crossed_at_speed(#[case] vehicle: Vehicle) {
    let world = World::default();
    let limit = vehicle.max_speed_mps;
    let mut setup = Setup::new(&world, vehicle, (1.0, 0.0, 0.3), (60.0, 0.0));
    setup.range_m = 15.0;
    let drive = setup.drive();
    assert_eq!(drive.status, Status::Reached, "{}", told(&drive));
    let mean = drive.metres / drive.seconds;
    assert!(mean >= 0.8 * limit, "{mean} of {limit}: {}", told(&drive));
}

#[rstest]
#[case(jackal(), 45, 24)]
#[case(pioneer(), 45, 12)]
#[case(car(), 12, 12)]
fn cluttered_worlds_are_crossed_without_touching_anything(
    #[case] vehicle: Vehicle,
    #[case] count: u32,
    #[case] worlds: u64,
) {
    let (mut passable, mut reached) = (0, 0);
    let mut missed = Vec::new();
    for seed in 0..worlds {
        let world = cluttered(seed, count, &vehicle);
        let drive = Setup::new(&world, vehicle.clone(), (1.0, 0.0, 0.0), GOAL).drive();
        assert!(!drive.collided, "seed {seed}: {}", told(&drive));
        if world.passable((1.0, 0.0), GOAL, vehicle.circumscribed_radius_m() + 0.25, SIZE) {
            passable += 1;
            reached += u32::from(drive.status == Status::Reached);
            if drive.status != Status::Reached {
                missed.push(format!("seed {seed}: {}", told(&drive)));
            }
        }
    }
    assert!(
        f64::from(reached) >= 0.98 * f64::from(passable),
        "{reached} of {passable}: {missed:?}"
    );
}

#[rstest]
#[case(1.0)]
#[case(1.6)]
fn a_robot_that_sees_little_drives_no_faster_than_it_can_stop_in_it(#[case] range_m: f64) {
    let world = World::default();
    let mut setup = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (20.0, 0.0));
    setup.range_m = range_m;
    let (reaction_s, braking_mps2) = (setup.vehicle.reaction_time_s, setup.params.braking_mps2);
    let drive = setup.drive();
    assert_eq!(drive.status, Status::Reached, "{}", told(&drive));
    let stops_in_m = drive.top_mps * reaction_s + drive.top_mps * drive.top_mps / (2.0 * braking_mps2);
    assert!(
        stops_in_m <= range_m && drive.top_mps > 0.3,
        "{stops_in_m} m from {} m/s",
        drive.top_mps
    );
}

fn u_trap() -> World {
    World::with_walls(&[&[(6.0, -4.0), (12.0, -4.0), (12.0, 4.0), (6.0, 4.0)]])
}

#[test]
fn a_u_trap_holds_the_local_method_and_not_the_navigator() {
    let world = u_trap();
    let mut alone = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (20.0, 0.0));
    alone.params = DriveParams {
        memory: false,
        recover: false,
        ..DriveParams::default()
    };
    alone.seconds = 120.0;
    let alone = alone.drive();
    assert!(alone.status != Status::Reached && !alone.collided, "{}", told(&alone));
    let full = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (20.0, 0.0)).drive();
    assert!(full.status == Status::Reached && !full.collided, "{}", told(&full));
}

#[rstest]
#[case(Method::Vfh)]
#[case(Method::VfhPlus)]
#[case(Method::VfhStar)]
#[case(Method::Player)]
fn every_method_gets_through(#[case] method: Method) {
    let world = cluttered(3, 30, &jackal());
    let mut setup = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), GOAL);
    setup.params.method = method;
    let drive = setup.drive();
    assert!(drive.status == Status::Reached && !drive.collided, "{}", told(&drive));
}

#[test]
fn a_vehicle_that_sees_nothing_behind_it_may_back_to_where_it_stood() {
    let mut navigator = Navigator::new(&car(), Position::new(20.0, 0.0), None, DriveParams::default()).unwrap();
    let ahead = Mount {
        x_m: 1.5,
        ..Mount::default()
    };
    for (time_s, x_m) in [(0.0, 0.0), (1.0, 2.0)] {
        let pose = Pose::level(x_m, 0.0, 0.0);
        let scan = World::default().scan(&pose, ahead, 181, std::f64::consts::PI, 8.0);
        navigator.step(&Observation {
            time_s,
            pose,
            speed_mps: 0.0,
            turn_rate_radps: 0.0,
            scan: Some(&scan),
            reading: None,
        });
        let sight = Sight {
            grid: &navigator.grid,
            pose: &pose,
            scan: Some(&scan),
        };
        let free_m = navigator
            .around
            .free_m(&navigator.shape, 0.0, false, 5.0, |x_m, y_m| sight.has(x_m, y_m));
        assert!((x_m - 0.2..=x_m).contains(&free_m), "{free_m} of {x_m} m");
    }
}

#[test]
fn a_goal_in_a_closed_ring_is_told_as_blocked() {
    let ring = [(15.0, -3.0), (21.0, -3.0), (21.0, 3.0), (15.0, 3.0), (15.0, -3.0)];
    let drive = Setup::new(&World::with_walls(&[&ring]), jackal(), (1.0, 0.0, 0.0), (18.0, 0.0)).drive();
    assert!(!drive.collided, "{}", told(&drive));
    assert_eq!(drive.status, Status::NoRoute, "{}", told(&drive));
    assert_eq!(drive.navigator.reason(), Reason::GoalBlocked);
}

#[test]
fn a_goal_inside_an_obstacle_is_told() {
    let mut world = World::default();
    world.discs.push((18.0, 0.0, 1.5));
    let mut setup = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (18.0, 0.0));
    // Every way out is tried before.
    setup.seconds = 900.0;
    let drive = setup.drive();
    assert!(!drive.collided, "{}", told(&drive));
    assert!(
        matches!(drive.status, Status::NoRoute | Status::Stopped),
        "{}",
        told(&drive)
    );
}

#[rstest]
#[case(jackal())]
#[case(pioneer())]
#[case(car())]
fn a_dead_sensor_stops_the_vehicle_within_its_braking_distance(#[case] vehicle: Vehicle) {
    let world = World::default();
    let mut setup = Setup::new(&world, vehicle.clone(), (1.0, 0.0, 0.0), (60.0, 0.0));
    setup.seconds = 30.0;
    setup.range_m = 15.0;
    let params = setup.params;
    let dies = 100;
    let drive = setup.drive_with(|step, scan, _| {
        if step >= dies {
            *scan = None;
        }
    });
    assert_eq!(drive.status, Status::Fault, "{}", told(&drive));
    assert_eq!(drive.navigator.reason(), Reason::StaleScan);
    // Where it was when the sensor died: measured by an own drive until then.
    let mut until = Setup::new(&world, vehicle, (1.0, 0.0, 0.0), (60.0, 0.0));
    until.seconds = dies as f64 * 0.1;
    until.range_m = 15.0;
    let until = until.drive();
    let speed = until.top_mps;
    let allowed_m = speed * (params.stale_s + 0.2) + speed * speed / (2.0 * params.braking_mps2);
    assert!(
        drive.metres - until.metres <= allowed_m,
        "{} m",
        drive.metres - until.metres
    );
    assert!(until.metres > 3.0);
}

#[test]
fn no_go_ground_of_the_map_is_driven_around_though_no_sensor_sees_it() {
    let world = World::default();
    let bog = |x: f64, y: f64| {
        if (8.0..14.0).contains(&x) && y.abs() < 6.0 {
            1
        } else {
            8
        }
    };
    let mut setup = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (25.0, 0.0));
    setup.region = Some(region(bog));
    let drive = setup.drive();
    assert_eq!(drive.status, Status::Reached, "{}", told(&drive));
    assert!(drive.metres > 27.0, "{}", told(&drive));
}

#[rstest]
#[case(Method::Vfh)]
#[case(Method::VfhPlus)]
#[case(Method::VfhStar)]
#[case(Method::Player)]
fn every_method_alone_stays_off_ground_that_the_map_forbids(#[case] method: Method) {
    let world = World::default();
    let bog = |x: f64, y: f64| {
        if (8.0..11.0).contains(&x) && (-1.0..2.0).contains(&y) {
            1
        } else {
            8
        }
    };
    let mut setup = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (25.0, 0.0));
    setup.region = Some(region(bog));
    setup.params = DriveParams {
        method,
        memory: false,
        recover: false,
        ..DriveParams::default()
    };
    let drive = setup.drive();
    // On no-go ground the robot would begin a retreat.
    assert!(!drive.statuses.contains(&Status::Recovering), "{}", told(&drive));
    assert_eq!(drive.status, Status::Reached, "{}", told(&drive));
}

#[test]
fn ground_outside_the_nests_is_slow_or_as_in_the_paper_closed() {
    let world = World::default();
    // Suitable ground with a strip that is passable, but no nest.
    let strip = |x: f64, y: f64| if (8.0..14.0).contains(&x) && y < 14.0 { 3 } else { 8 };
    let drive = |outside_nests| {
        let mut setup = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (25.0, 0.0));
        setup.region = Some(region(strip));
        setup.params.outside_nests = outside_nests;
        setup.drive()
    };
    let cost = drive(OutsideNests::Cost);
    assert_eq!(cost.status, Status::Reached, "{}", told(&cost));
    let block = drive(OutsideNests::Block);
    assert_eq!(block.status, Status::Reached, "{}", told(&block));
    // Around the strip's northern end; straight on, half as fast.
    assert!(cost.metres < 27.0, "{}", told(&cost));
    assert!(block.metres > 35.0, "{}", told(&block));
    let free = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (25.0, 0.0)).drive();
    assert!(cost.seconds > free.seconds + 2.5, "{} {}", cost.seconds, free.seconds);
}

#[test]
fn a_robot_on_no_go_ground_retreats_or_stops_with_the_reason() {
    let world = World::default();
    let mut setup = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (25.0, 0.0));
    setup.region = Some(region(|x, y| if x.hypot(y) < 4.0 { 1 } else { 8 }));
    let drive = setup.drive();
    assert_eq!(
        drive.statuses[..2],
        [Status::Recovering, Status::Driving],
        "{}",
        told(&drive)
    );
    assert_eq!(drive.status, Status::Reached, "{}", told(&drive));
    let mut setup = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (25.0, 0.0));
    setup.region = Some(region(|_, _| 1));
    let drive = setup.drive();
    assert_eq!(drive.status, Status::Stopped);
    assert_eq!(drive.navigator.reason(), Reason::NoSafeNest);
    assert!(drive.metres < 0.1);
}

#[test]
fn a_goal_beyond_the_maps_edge_is_told() {
    let world = World::default();
    let mut setup = Setup::new(&world, jackal(), (1.0, 0.0, 0.0), (55.0, 0.0));
    setup.region = Some(region(|_, _| 8));
    let drive = setup.drive();
    assert_eq!(drive.status, Status::NoRoute, "{}", told(&drive));
    assert_eq!(drive.navigator.reason(), Reason::GoalOffMap);
}
