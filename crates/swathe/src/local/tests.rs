//! What all four methods do alike.

use super::*;
use crate::sensor::{Mount, Pose, Scan};
use rstest::rstest;
use std::f64::consts::PI;

const SIDE: i64 = 61;

const BODY: Body = Body {
    enlarged_m: 0.3,
    turn_radius_m: [0.0, 0.0],
    reaction_m: 1.5,
};

/// Ground whose goodness is told by how far north it lies, and closed parts by place.
struct Map {
    goodness: fn(f64) -> f64,
    closed: fn(f64, f64) -> bool,
}

impl Ground for Map {
    fn close(&self, x_m: f64, y_m: f64, window: &mut [u8]) {
        let side = (window.len() as f64).sqrt() as usize;
        for (index, cell) in window.iter_mut().enumerate() {
            let offset = |k: usize| 0.1 * (k as f64 - (side / 2) as f64);
            if (self.closed)(x_m + offset(index % side), y_m - offset(index / side)) {
                *cell = CERTAINTY_MAX;
            }
        }
    }

    fn goodness(&self, _: f64, y_m: f64, direction_rad: f64) -> f64 {
        (self.goodness)(y_m + direction_rad.sin())
    }
}

/// The robot looks east at a block that stands from 0.9 to 1.2 m ahead and 0.5 m to each side; the target lies straight behind it
/// and a little to the left. The direction that a method takes, in degrees.
fn past_the_block(method: &str, map: Option<&Map>) -> f64 {
    let target_rad = 2f64.to_radians();
    let is_block = |x: f64, y: f64| (0.85..1.2).contains(&x) && y.abs() < 0.5;
    let stands = |x: f64, y: f64| is_block(x, y) || map.is_some_and(|map| (map.closed)(x, y));
    let goodness = map.map(|map| |direction_rad: f64| map.goodness(0.0, 0.0, direction_rad));
    let goodness = goodness.as_ref().map(|goodness| goodness as Goodness);
    let window = |side: i64| -> Vec<u8> {
        let place = |k: i64| 0.1 * (k - side / 2) as f64;
        let cell = |index: i64| {
            if stands(place(index % side), -place(index / side)) {
                CERTAINTY_MAX
            } else {
                0
            }
        };
        (0..side * side).map(cell).collect()
    };
    let direction_rad = match method {
        "vfh" => {
            Vfh::new(VfhParams::default())
                .steer(&window(33), 0.0, target_rad, goodness)
                .1
                .direction_rad
        }
        "vfh+" => {
            let mut vfh = VfhPlus::new(VfhPlusParams::default());
            vfh.steer(&window(SIDE), 0.0, target_rad, &BODY, goodness).direction_rad
        }
        "vfh*" => {
            let mut grid = CertaintyGrid::new(CertaintyParams::default(), 0.0, 0.0);
            // Cells have their middles half a cell off the origin; the robot stands in the middle of one.
            for k in 0..80 * 80 {
                let (x, y) = (0.1 * f64::from(k % 80) - 4.0, 0.1 * f64::from(k / 80) - 4.0);
                if is_block(x, y) {
                    grid.stamp(x + 0.05, y - 0.05);
                }
            }
            let target = |x: f64, y: f64| (6.0 * target_rad.sin() - y).atan2(6.0 - x);
            let ground = map.map(|map| map as &dyn Ground);
            let mut vfh = VfhStar::new(VfhStarParams::default());
            vfh.steer(&grid, &Pose::level(0.05, -0.05, 0.0), &BODY, target, ground)
                .direction_rad
        }
        _ => {
            let range_m = |beam: usize| {
                let (sin, cos) = (beam as f64).to_radians().sin_cos();
                let away = (1..100).map(|step| 0.05 * f64::from(step));
                away.into_iter()
                    .find(|&away| stands(away * sin, -away * cos))
                    .unwrap_or(f64::INFINITY)
            };
            let scan = Scan {
                ranges_m: (0..=180).map(range_m).collect(),
                angle_min_rad: -PI / 2.0,
                angle_increment_rad: PI / 180.0,
                range_min_m: 0.0,
                range_max_m: 8.0,
                mount: Mount::default(),
            };
            let steering = PlayerVfh::new(PlayerParams::default()).update_on(&scan, 0.1, target_rad, 0.1, goodness);
            (steering.speed_mps > 0.0).then_some(steering.direction_rad)
        }
    };
    direction_rad.map_or(f64::NAN, f64::to_degrees)
}

fn nowhere(_: f64, _: f64) -> bool {
    false
}

#[rstest]
fn every_method_turns_to_the_better_ground(#[values("vfh", "vfh+", "vfh*", "player")] method: &str) {
    let towards_target = past_the_block(method, None);
    assert!(towards_target > 10.0, "{towards_target}");
    let even = Map {
        goodness: |_| 1.0,
        closed: nowhere,
    };
    assert_eq!(past_the_block(method, Some(&even)), towards_target);
    let bad_left = Map {
        goodness: |north_m| if north_m > 0.0 { 1.0 } else { 5.0 },
        closed: nowhere,
    };
    let away = past_the_block(method, Some(&bad_left));
    assert!(away < -10.0, "{away}");
}

#[rstest]
fn ground_that_the_map_closes_is_an_obstacle_to_every_method(#[values("vfh", "vfh+", "vfh*", "player")] method: &str) {
    let bog_left = Map {
        goodness: |_| 5.0,
        closed: |x, y| x > 0.5 && y > 0.2,
    };
    let away = past_the_block(method, Some(&bog_left));
    assert!(away < -10.0, "{away}");
}
