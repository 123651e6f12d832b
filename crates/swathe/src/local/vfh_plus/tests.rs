//! VFH+ on drawn windows, and its first stage beside the paper's formula.

use super::*;
use crate::local::CERTAINTY_MAX;
use proptest::prelude::*;
use std::f64::consts::FRAC_PI_2;

const BODY: Body = Body {
    enlarged_m: 0.4,
    turn_radius_m: [0.0, 0.0],
    reaction_m: 1.5,
};

/// A window drawn as text, one character a cell, '#' certain, the robot in the middle; enlarged to 61 cells.
fn window(rows: &[&str]) -> Vec<u8> {
    let mut cells = vec![0; 61 * 61];
    let (down, right) = (30 - rows.len() / 2, 30 - rows[0].len() / 2);
    for (r, row) in rows.iter().enumerate() {
        for (c, byte) in row.bytes().enumerate() {
            if byte == b'#' {
                cells[(down + r) * 61 + right + c] = CERTAINTY_MAX;
            }
        }
    }
    cells
}

fn degrees(steering: Steering) -> f64 {
    steering.direction_rad.map_or(f64::NAN, f64::to_degrees)
}

/// The paper's first stage cell by cell and sector by sector.
fn slow_density(vfh: &VfhPlus, window: &[u8], r_cells: f64, slack_rad: f64) -> Vec<f64> {
    let n = vfh.params.sectors;
    let side = vfh.params.window_cells;
    let half = (side / 2) as f64;
    let mut density = vec![0.0; n];
    for (index, &c) in window.iter().enumerate() {
        let (x, y) = ((index % side) as f64 - half, half - (index / side) as f64);
        let d = x.hypot(y);
        let m = f64::from(c) * f64::from(c) * (1.0 + half * half - d * d).round();
        if d <= r_cells || m <= 0.0 {
            continue;
        }
        let (beta, gamma) = (y.atan2(x), (r_cells / d).asin());
        for (k, density) in density.iter_mut().enumerate() {
            if wrap(direction_of(k as f64, n) - beta).abs() <= gamma + slack_rad {
                *density += m;
            }
        }
    }
    density
}

/// Stage 3 cell by cell: the least angle off the heading, left and right, of what stands within the circles that the middle of a
/// turning vehicle keeps to, enlarged; a turn where nothing does.
fn slow_turns(window: &[u8], heading_rad: f64, radii_m: [f64; 2], enlarged_m: f64, slack_m: f64) -> [f64; 2] {
    let mut limits = [TAU; 2];
    for (index, _) in window.iter().enumerate().filter(|&(_, &certainty)| certainty > 0) {
        let (x_m, y_m) = (0.1 * ((index % 61) as f64 - 30.0), 0.1 * (30.0 - (index / 61) as f64));
        let (away_m, off_rad) = (x_m.hypot(y_m), wrap(y_m.atan2(x_m) - heading_rad));
        if away_m > 3.0 + 1e-9 {
            continue;
        }
        let side = usize::from(off_rad < 0.0);
        let radius_m = radii_m[side];
        // The distance to the circle's middle, radius to the side, less the radius: without losing figures for a wide circle.
        let beside_m = away_m * off_rad.sin().abs();
        let over = away_m * away_m - 2.0 * radius_m * beside_m - enlarged_m * (enlarged_m + 2.0 * radius_m);
        if over < 2.0 * slack_m * (radius_m + enlarged_m) {
            limits[side] = limits[side].min(off_rad.abs());
        }
    }
    limits
}

proptest! {
    #[test]
    fn the_running_sum_gives_the_papers_densities(
        seed: u64, share in 0.0f64..1.0, enlarged in 0.26f64..0.9, heading in -PI..PI,
    ) {
        let draw = |i: u32| crate::random::philox([i, 0, 0, 0], seed);
        let cells: Vec<u8> = (0..61 * 61).map(|i| {
            let words = draw(i);
            if crate::random::unit(words[0]) < share { crate::random::below(words[1], 16) as u8 } else { 0 }
        }).collect();
        let mut vfh = VfhPlus::new(VfhPlusParams::default());
        vfh.update(&cells, heading, &Body { enlarged_m: enlarged, ..BODY });
        // Where a range ends exactly on a sector, rounding decides whether that sector counts.
        let slow = |slack_rad| slow_density(&vfh, &cells, vfh.tables[0].enlarged_m / 0.1, slack_rad);
        for ((&fast, least), most) in vfh.polar.density.iter().zip(slow(-1e-9)).zip(slow(1e-9)) {
            let fast = f64::from(fast);
            prop_assert!(fast >= least * (1.0 - 1e-6) && fast <= most * (1.0 + 1e-6), "{fast} {least} {most}");
        }
        // Free space is exactly free.
        let free = vec![0; 61 * 61];
        vfh.update(&free, heading, &BODY);
        prop_assert!(vfh.polar.density.iter().all(|&density| density == 0.0));
    }

    #[test]
    fn what_lies_beyond_an_obstacle_in_a_turning_circle_is_masked_by_the_papers_rule(
        seed: u64, share in prop_oneof![0.0f64..0.002, 0.0f64..0.03], enlarged in 0.26f64..0.9, heading in -PI..PI,
        radii in prop::array::uniform2(prop_oneof![0.05f64..6.0, Just(1e9), Just(0.0)]),
    ) {
        let draw = |i: u32| crate::random::unit(crate::random::philox([i, 0, 0, 0], seed)[0]);
        let cells: Vec<u8> = (0..61 * 61).map(|i| if draw(i) < share { CERTAINTY_MAX } else { 0 }).collect();
        let mut vfh = VfhPlus::new(VfhPlusParams::default());
        vfh.update(&cells, heading, &Body { enlarged_m: enlarged, turn_radius_m: radii, ..BODY });
        if radii != [0.0; 2] && !vfh.tables[0].near.iter().any(|&cell| cells[usize::from(cell)] > 0) {
            // Where a cell lies on a circle's edge, or a sector points along it, rounding decides.
            let (least, most) = (slow_turns(&cells, heading, radii, enlarged, -1e-4), slow_turns(&cells, heading, radii, enlarged, 1e-4));
            for (k, (&masked, &blocked)) in vfh.polar.masked.iter().zip(&vfh.polar.blocked).enumerate() {
                let ahead = wrap(direction_of(k as f64, 72) - heading);
                if ahead.abs() > 1e-6 && ahead.abs() < PI - 1e-6 {
                    let side = usize::from(ahead < 0.0);
                    prop_assert!(masked || blocked || ahead.abs() <= least[side] + 1e-3, "{k}: {ahead} {least:?}");
                    prop_assert!(!masked || blocked || ahead.abs() >= most[side] - 1e-3, "{k}: {ahead} {most:?}");
                }
            }
        }
    }

    #[test]
    fn what_is_chosen_is_open(seed: u64, share in 0.0f64..0.1, heading in -PI..PI, target in -PI..PI, car: bool) {
        let draw = |i: u32| crate::random::unit(crate::random::philox([i, 0, 0, 0], seed)[0]);
        let cells: Vec<u8> = (0..61 * 61).map(|i| if draw(i) < share { CERTAINTY_MAX } else { 0 }).collect();
        let mut vfh = VfhPlus::new(VfhPlusParams { too_close: TooClose::TurnAway, ..VfhPlusParams::default() });
        let body = Body { turn_radius_m: if car { [0.8, 0.8] } else { [0.0; 2] }, ..BODY };
        let steering = vfh.steer(&cells, heading, target, &body, None);
        if let Some(direction) = steering.direction_rad {
            prop_assert!(direction > -PI && direction <= PI);
            let sector = sector_of(direction, 72);
            // A target between two sectors may round to the one at the opening's edge, never to a blocked one.
            prop_assert!(!vfh.polar.masked[sector]);
        } else {
            prop_assert!(vfh.polar.masked.iter().all(|&masked| masked));
        }
    }
}

#[test]
fn free_space_leads_to_the_target() {
    let mut vfh = VfhPlus::new(VfhPlusParams::default());
    let steering = vfh.steer(&window(&["."]), 0.0, 0.3, &BODY, None);
    assert_eq!(steering.direction_rad, Some(0.3));
    assert_eq!(steering.crowding, 0.0);
}

#[test]
fn a_wall_ahead_is_passed_on_the_side_of_the_target() {
    // The wall stands 1 m to the east, from 1 m south to 1 m north.
    let mut rows = vec!["....................#"; 21];
    rows[10] = "....................#";
    let steer = |target: f64| {
        let mut vfh = VfhPlus::new(VfhPlusParams::default());
        degrees(vfh.steer(&window(&rows), 0.0, target.to_radians(), &BODY, None))
    };
    assert!(steer(20.0) > 60.0, "{}", steer(20.0));
    assert!(steer(-20.0) < -60.0, "{}", steer(-20.0));
}

#[test]
fn the_wider_the_robot_the_wider_the_gap_it_needs() {
    // Two posts to the east with a gap of 0.9 m between them, in a long wall 1.5 m away.
    let mut rows = vec!["...............................#"; 41];
    for row in &mut rows[16..25] {
        *row = "................................";
    }
    let through = |enlarged_m: f64| {
        let mut vfh = VfhPlus::new(VfhPlusParams::default());
        let body = Body { enlarged_m, ..BODY };
        degrees(vfh.steer(&window(&rows), 0.0, 0.0, &body, None)).abs() < 10.0
    };
    assert!(through(0.2));
    assert!(!through(0.75));
}

#[test]
fn between_the_thresholds_a_sector_stays_what_it_was() {
    let mut vfh = VfhPlus::new(VfhPlusParams {
        tau_high: Some(1.0e5),
        ..VfhPlusParams::default()
    });
    let blocked = |vfh: &mut VfhPlus, certainty: u8| {
        let mut cells = window(&["."]);
        cells[30 * 61 + 45] = certainty;
        vfh.update(&cells, 0.0, &BODY);
        vfh.polar.blocked[0]
    };
    // 15 cells away: weight 676; certainty 11 gives 82 000, between 60 000 and 100 000.
    assert!(!blocked(&mut vfh, 11));
    assert!(blocked(&mut vfh, 15));
    assert!(blocked(&mut vfh, 11));
    assert!(!blocked(&mut vfh, 8));
    assert!(!blocked(&mut vfh, 11));
}

#[test]
fn a_car_cannot_turn_into_what_its_turning_circle_hits() {
    // An obstacle to the left, 0.7 m away: a car that turns left would touch it, a robot that turns in place would not.
    let mut cells = window(&["."]);
    for right in 28..33 {
        cells[23 * 61 + right] = CERTAINTY_MAX;
    }
    let direction = |turn_radius_m: f64| {
        let mut vfh = VfhPlus::new(VfhPlusParams::default());
        let body = Body {
            turn_radius_m: [turn_radius_m; 2],
            ..BODY
        };
        degrees(vfh.steer(&cells, 0.0, 170f64.to_radians(), &body, None))
    };
    assert!(direction(0.0) > 140.0, "{}", direction(0.0));
    assert!(direction(1.0) < 90.0, "{}", direction(1.0));
}

#[test]
fn too_close_stops_or_turns_away() {
    let mut cells = window(&["."]);
    cells[30 * 61 + 33] = CERTAINTY_MAX;
    let steer = |too_close| {
        let params = VfhPlusParams {
            too_close,
            ..VfhPlusParams::default()
        };
        VfhPlus::new(params).steer(&cells, 0.0, 0.0, &BODY, None).direction_rad
    };
    assert_eq!(steer(TooClose::Stop), None);
    assert!(steer(TooClose::TurnAway).is_some_and(|direction| direction.abs() >= FRAC_PI_2));
}
