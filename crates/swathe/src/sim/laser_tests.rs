//! Beams against plain geometry.

use super::*;
use crate::grid::{GridGeometry, Layer};
use crate::sim::world::tests::{motion, plain};
use crate::sim::{Command, Mover, Obstacle, Robot, RobotParams, Steering};
use crate::soil::SoilClass;
use crate::vehicle::fixtures::pioneer;
use approx::assert_relative_eq;
use proptest::prelude::*;
use rstest::rstest;

fn still(world: &World, laser: &Laser, pose: &Pose) -> Vec<f64> {
    laser.true_ranges_m(world, pose, 0.0, 0.0)
}

fn obstacle(shape: Shape, height_m: f64) -> Obstacle {
    Obstacle { shape, height_m }
}

#[test]
fn a_wall_ahead_is_seen_at_its_distance() {
    let mut world = plain(0.0);
    let wall = Shape::Wall(vec![Position::new(3.0, -9.0), Position::new(3.0, 9.0)]);
    world.place(vec![obstacle(wall, 1.0)]).unwrap();
    let laser = Laser::sick_lms200(false, false);
    let ranges = still(&world, &laser, &Pose::default());
    assert_relative_eq!(ranges[90], 2.9, epsilon = 1e-12);
    assert_relative_eq!(ranges[90 + 45], 2.9 * 2f64.sqrt(), epsilon = 1e-9);
    assert_eq!(ranges[0], f64::INFINITY);
    let turned = still(&world, &laser, &Pose::level(0.0, 0.0, PI));
    assert!(turned.iter().all(|range| range.is_infinite()));
}

#[test]
fn beams_pass_over_what_is_low_and_meet_the_ground_when_the_nose_is_down() {
    let mut world = plain(0.0);
    let shape = Shape::rectangle(Position::new(3.0, 0.0), 1.0, 1.0, 0.0);
    world.place(vec![obstacle(shape, 0.2)]).unwrap();
    let laser = Laser {
        mount: Mount::default(),
        ..Laser::sick_lms200(false, false)
    };
    assert_eq!(still(&world, &laser, &Pose::default())[90], f64::INFINITY);
    let nodding = Pose {
        pitch_rad: -0.05,
        ..Pose::default()
    };
    // 0.3 m high at an angle of 0.05: it meets the crate's face below its top.
    assert_relative_eq!(
        still(&world, &laser, &nodding)[90],
        (2.5 - 0.3 * 0.05f64.sin()) / 0.05f64.cos(),
        epsilon = 1e-9
    );
    let away = Pose {
        heading_rad: PI,
        ..nodding
    };
    assert_relative_eq!(still(&world, &laser, &away)[90], 0.3 / 0.05f64.tan(), epsilon = 1e-9);
    // Leaning to the right, beams to the right meet the ground and those to the left do not.
    let leaning = Pose {
        roll_rad: 0.1,
        heading_rad: PI,
        ..Pose::default()
    };
    let ranges = still(&world, &laser, &leaning);
    assert!(ranges[0].is_finite() && ranges[180].is_infinite());
}

#[test]
fn a_hill_ahead_is_seen() {
    let geometry = GridGeometry::new(80, 80, 0.5, -20.0, 20.0).unwrap();
    // Level up to x = 5, then rising by one in two.
    let height = |x: f64| (0.5 * (x - 5.0).max(0.0)) as f32;
    let heights = geometry.cells().map(|cell| height(geometry.centre(cell).x_m)).collect();
    let ground = Layer::new(geometry, heights, "heights").unwrap();
    let world = World::new(ground, Layer::filled(geometry, SoilClass::Sand as u8), 20.0).unwrap();
    let laser = Laser {
        mount: Mount::default(),
        ..Laser::sick_lms200(false, false)
    };
    let range_m = still(&world, &laser, &Pose::default())[90];
    // Heights are exact at the centres 4.75, 5.25 (0.125 m) and 5.75 (0.375 m).
    assert_relative_eq!(range_m, 5.25 + 0.5 * (0.3 - 0.125) / 0.25, epsilon = 1e-6);
}

#[test]
fn a_scan_has_noise_steps_losses_and_limits_and_repeats_by_seed() {
    let mut world = plain(0.0);
    let near = Shape::Disc {
        centre: Position::new(0.0, 0.6),
        radius_m: 0.45,
    };
    let wall = Shape::Wall(vec![Position::new(3.0, -19.0), Position::new(3.0, 19.0)]);
    world.place(vec![obstacle(near, 1.0), obstacle(wall, 1.0)]).unwrap();
    let laser = Laser {
        dropout: 0.2,
        noise_m: 0.02,
        bias_m: 0.1,
        ..Laser::sick_lms200(true, false)
    };
    laser.validate().unwrap();
    let (mut errors, mut lost) = (Vec::new(), 0);
    let truth = still(&world, &laser, &Pose::default());
    for count in 0..200 {
        let scan = laser.scan(&world, &Pose::default(), 0.0, 0.0, Noise::new(5), count);
        scan.validate().unwrap();
        let again = laser.scan(&world, &Pose::default(), 0.0, 0.0, Noise::new(5), count);
        for ((range, again), truth) in scan.ranges_m.iter().zip(&again.ranges_m).zip(&truth) {
            assert_eq!(range.to_bits(), again.to_bits());
            if range.is_nan() {
                lost += 1;
            } else if range.is_finite() && *range > 0.0 && *truth < 8.0 {
                assert_relative_eq!(*range, (range / 0.001).round() * 0.001, epsilon = 1e-12);
                assert!((0.2..8.192).contains(range));
                if *truth > 0.4 {
                    errors.push(range - truth);
                }
            }
        }
    }
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let deviation = (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / errors.len() as f64).sqrt();
    assert!(
        (mean - 0.1).abs() < 0.001 && (deviation - 0.02).abs() < 0.001,
        "{mean} {deviation}"
    );
    assert!((f64::from(lost) / (200.0 * 361.0) - 0.2).abs() < 0.01, "{lost}");
}

/// Beams, degrees between them, greatest range and step of ranges in metres, and greatest rate of the device on its fast line.
const LMS200: [(bool, bool, usize, f64, f64, f64, f64); 4] = [
    (false, false, 181, 1.0, 8.192, 0.001, 75.0),
    (true, false, 361, 0.5, 8.192, 0.001, 32.0),
    (false, true, 181, 1.0, 81.92, 0.01, 75.0),
    (true, true, 361, 0.5, 81.92, 0.01, 32.0),
];

#[test]
fn an_lms_200_has_the_beams_ranges_steps_and_rates_of_its_modes() {
    for (half_degrees, far, beams, degrees, range_max_m, resolution_m, most_hz) in LMS200 {
        let laser = Laser::sick_lms200(half_degrees, far);
        laser.validate().unwrap();
        assert_eq!(
            (laser.beams, laser.range_max_m, laser.resolution_m),
            (beams, range_max_m, resolution_m)
        );
        assert_relative_eq!(laser.angle_increment_rad, degrees.to_radians(), epsilon = 1e-12);
        assert_relative_eq!(laser.body_rad(0), -PI / 2.0, epsilon = 1e-12);
        assert_relative_eq!(laser.body_rad(beams - 1), PI / 2.0, epsilon = 1e-12);
        // A range is a number of 13 bits, in steps.
        assert_relative_eq!(range_max_m, 8192.0 * resolution_m, epsilon = 1e-9);
        assert_eq!(laser.rate_hz, most_hz.min(35.0));
    }
}

/// Ranges straight ahead to a wall at a distance from the sensor, as they are measured without noise.
fn ahead_m(half_degrees: bool, far: bool, distance_m: f64) -> f64 {
    let laser = Laser {
        noise_m: 0.0,
        ..Laser::sick_lms200(half_degrees, far)
    };
    let mut world = plain(0.0);
    let x_m = laser.mount.x_m + distance_m;
    let wall = Shape::Wall(vec![Position::new(x_m, -9.0), Position::new(x_m, 9.0)]);
    world.place(vec![obstacle(wall, 1.0)]).unwrap();
    let scan = laser.scan(&world, &Pose::default(), 0.0, 0.0, Noise::new(1), 1);
    scan.ranges_m[laser.beams / 2]
}

#[test]
fn an_lms_200_measures_to_8191_steps_of_its_mode_and_nothing_beyond() {
    for half_degrees in [false, true] {
        for (far, step_m, found) in [
            (false, 0.001, [(5.0004, 5.0), (5.0006, 5.001), (8.191, 8.191)]),
            (true, 0.01, [(5.004, 5.0), (5.006, 5.01), (81.91, 81.91)]),
        ] {
            for (distance_m, measured_m) in found {
                assert_relative_eq!(ahead_m(half_degrees, far, distance_m), measured_m, epsilon = 1e-9);
            }
            assert_eq!(ahead_m(half_degrees, far, 8191.6 * step_m), f64::INFINITY);
            assert_eq!(ahead_m(half_degrees, far, 0.19), 0.0);
            assert_eq!(ahead_m(half_degrees, far, 50.0).is_finite(), far);
        }
    }
}

#[rstest]
#[case(false, 35)]
#[case(true, 32)]
fn a_robot_gets_as_many_scans_a_second_as_its_laser_takes(#[case] half_degrees: bool, #[case] scans: usize) {
    let world = plain(0.0);
    let limits = motion(Steering::Differential);
    let params = RobotParams {
        laser: Laser::sick_lms200(half_degrees, false),
        ..RobotParams::default()
    };
    let mut robot = Robot::new(&world, pioneer(), limits, Pose::default(), params).unwrap();
    // The first step also gives the scan of the start.
    robot.step(&world, Command::default(), 0.005);
    let got = (0..400).filter(|_| robot.step(&world, Command::default(), 0.005).scan.is_some());
    assert_eq!(got.count(), 2 * scans);
}

#[test]
fn the_sonar_ring_sees_the_nearest_thing_in_each_cone() {
    let mut world = plain(0.0);
    world
        .set_in_motion(vec![Mover {
            path: vec![Position::new(2.0, 0.3)],
            speed_mps: 0.0,
            radius_m: 0.2,
            start_m: 0.0,
        }])
        .unwrap();
    let ring = pioneer_sonar();
    let ranges: Vec<f64> = (0u32..)
        .zip(&ring)
        .map(|(n, cone)| {
            cone.validate().unwrap();
            cone.cone(&world, &Pose::default(), 0.0, 0.0, Noise::new(1), 1, n)
                .ranges_m[0]
        })
        .collect();
    assert!((ranges[3] - 1.65).abs() < 0.15, "{ranges:?}");
    assert!(ranges[0].is_infinite() && ranges[7].is_infinite());
}

#[test]
fn lasers_that_cannot_be_are_refused() {
    for spoil in [
        |laser: &mut Laser| laser.beams = 0,
        |laser: &mut Laser| laser.angle_increment_rad = 0.0,
        |laser: &mut Laser| laser.angle_increment_rad = 1.0,
        |laser: &mut Laser| laser.range_max_m = 0.1,
        |laser: &mut Laser| laser.noise_m = f64::NAN,
        |laser: &mut Laser| laser.dropout = 1.5,
        |laser: &mut Laser| laser.rate_hz = 0.0,
        |laser: &mut Laser| laser.height_m = 0.0,
    ] {
        let mut laser = Laser::sick_lms200(false, true);
        laser.validate().unwrap();
        spoil(&mut laser);
        assert!(laser.validate().is_err(), "{laser:?}");
    }
}

fn shapes() -> impl Strategy<Value = Vec<Shape>> {
    let place = || (-9.0f64..9.0, -9.0f64..9.0);
    let at = |(x, y): (f64, f64)| Position::new(x, y);
    let shape = prop_oneof![
        (place(), 0.1f64..2.0).prop_map(move |(c, radius_m)| Shape::Disc {
            centre: at(c),
            radius_m
        }),
        (place(), 0.1f64..3.0, 0.1f64..3.0, -4.0f64..4.0).prop_map(move |(c, l, w, h)| Shape::rectangle(
            at(c),
            l,
            w,
            h
        )),
        prop::collection::vec(place(), 2..5).prop_map(move |points| Shape::Wall(points.into_iter().map(at).collect())),
    ];
    prop::collection::vec(shape, 1..12)
}

/// Range at which a beam from `origin` along `direction` (per metre of range) first meets the border of a shape.
fn by_force(shape: &Shape, origin: Position, direction: (f64, f64)) -> f64 {
    let (dx, dy) = direction;
    let mut nearest = f64::INFINITY;
    if let Shape::Disc { centre, radius_m } = shape {
        // |o + t d - c| = r by the plain quadratic formula.
        let (ox, oy) = (origin.x_m - centre.x_m, origin.y_m - centre.y_m);
        let (a, b, c) = (
            dx * dx + dy * dy,
            2.0 * (ox * dx + oy * dy),
            ox * ox + oy * oy - radius_m * radius_m,
        );
        let root = (b * b - 4.0 * a * c).sqrt();
        for t in [(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)] {
            if t >= 0.0 {
                nearest = nearest.min(t);
            }
        }
    }
    for (p, q) in shape.edges() {
        // o + t d = p + s (q - p) by Cramer's rule.
        let (ex, ey) = (p.x_m - q.x_m, p.y_m - q.y_m);
        let (rx, ry) = (p.x_m - origin.x_m, p.y_m - origin.y_m);
        let determinant = dx * ey - dy * ex;
        let (t, s) = ((rx * ey - ry * ex) / determinant, (dx * ry - dy * rx) / determinant);
        if t >= 0.0 && (0.0..=1.0).contains(&s) {
            nearest = nearest.min(t);
        }
    }
    nearest
}

proptest! {
    #[test]
    fn scans_agree_with_every_beam_cut_with_every_edge(
        shapes in shapes(), x in -9.0f64..9.0, y in -9.0f64..9.0, heading_rad in -4.0f64..4.0,
        pitch_rad in -0.3f64..0.3, roll_rad in -0.3f64..0.3, mount_rad in -4.0f64..4.0, around: bool,
    ) {
        let geometry = GridGeometry::new(1, 1, 1.0, 0.0, 0.0).unwrap();
        let void = Layer::filled(geometry, f32::NAN);
        let mut world = World::new(void, Layer::filled(geometry, 0), 20.0).unwrap();
        world.place(shapes.iter().map(|shape| obstacle(shape.clone(), 1.0)).collect()).unwrap();
        let increment = if around { TAU / 180.0 } else { PI / 180.0 };
        let laser = Laser {
            mount: Mount { x_m: 0.2, y_m: -0.1, heading_rad: mount_rad },
            angle_increment_rad: increment,
            range_max_m: 30.0,
            ..Laser::sick_lms200(false, false)
        };
        let body = Pose { x_m: x, y_m: y, heading_rad, pitch_rad, roll_rad };
        let ranges = still(&world, &laser, &body);
        let sight = Sight::new(&laser, &body, 0.0);
        for (beam, range_m) in ranges.iter().enumerate() {
            let [dx, dy, _] = sight.ray(laser.body_rad(beam).sin_cos()).direction;
            let expected = shapes.iter().map(|shape| by_force(shape, sight.at, (dx, dy))).fold(f64::INFINITY, f64::min);
            if expected < 30.0 && (range_m - expected).abs() > 1e-6 {
                // A beam along a tangent or through a corner may see or miss it; a neighbour a hair aside then agrees.
                let aside: Vec<f64> = [-1e-9, 1e-9].into_iter().map(|turn| {
                    let [dx, dy, _] = sight.ray((laser.body_rad(beam) + turn).sin_cos()).direction;
                    shapes.iter().map(|shape| by_force(shape, sight.at, (dx, dy))).fold(f64::INFINITY, f64::min)
                }).collect();
                prop_assert!(aside.iter().any(|other| (range_m - other).abs() < 1e-3), "beam {beam}: {range_m} {expected}");
            }
        }
    }

    #[test]
    fn rotation_by_attitude_keeps_lengths(h in -4.0f64..4.0, p in -1.0f64..1.0, r in -1.0f64..1.0, beam in -4.0f64..4.0) {
        let laser = Laser::sick_lms200(false, false);
        let sight = Sight::new(&laser, &Pose { x_m: 0.0, y_m: 0.0, heading_rad: h, pitch_rad: p, roll_rad: r }, 0.0);
        let [x, y, z] = sight.ray(beam.sin_cos()).direction;
        prop_assert!((x * x + y * y + z * z - 1.0).abs() < 1e-12);
        let (cos, sin) = sight.seen(x, y);
        prop_assert!((cos - beam.cos()).abs() < 1e-9 && (sin - beam.sin()).abs() < 1e-9);
    }
}
