//! Contents of a window of 61 cells that a histogram may find hard, and the scan that would show them.

use std::f64::consts::PI;

use swathe::local::{Body, CERTAINTY_MAX};
use swathe::random::{below, philox, unit};
use swathe::sensor::{Mount, Scan};

pub const SIDE: usize = 61;

pub const CONTENTS: [&str; 8] = [
    "empty",
    "full",
    "checkerboard",
    "noise",
    "sparse",
    "walls",
    "corridor",
    "near",
];

pub const BODY: Body = Body {
    enlarged_m: 0.4,
    turn_radius_m: [0.0, 0.0],
    reaction_m: 1.5,
};

/// Certainties of a window by the name of what it holds.
pub fn window_of(name: &str) -> Vec<u8> {
    let certainty = |index: usize| {
        let (row, column) = (index / SIDE, index % SIDE);
        let away = (row as f64 - 30.0).hypot(column as f64 - 30.0);
        let draw = philox([index as u32, 0, 0, 0], 3);
        let stands = match name {
            "empty" => false,
            // All but the cells within the robot's enlarged circle, so that nothing is decided early.
            "full" => away > 4.5,
            "checkerboard" => away > 4.5 && (row + column).is_multiple_of(2),
            "noise" => return if away > 4.5 { below(draw[1], 16) as u8 } else { 0 },
            "sparse" => away > 4.5 && unit(draw[0]) < 0.02,
            "walls" => away > 4.5 && (row.is_multiple_of(9) || column.is_multiple_of(11)),
            "corridor" => column.abs_diff(30) == 8,
            _ => away <= 8.0,
        };
        if stands { CERTAINTY_MAX } else { 0 }
    };
    (0..SIDE * SIDE).map(certainty).collect()
}

/// What a laser of 181 beams in the middle of such a window sees to the east.
pub fn scan_of(name: &str) -> Scan {
    let window = window_of(name);
    let range_m = |beam: usize| {
        let (sin, cos) = (-PI / 2.0 + beam as f64 * PI / 180.0).sin_cos();
        let cell = |step: usize| {
            let away = step as f64 * 0.25;
            ((30.0 - away * sin).round() as usize) * SIDE + (30.0 + away * cos).round() as usize
        };
        let met = (1..120).find(|&step| window[cell(step)] > 0);
        met.map_or(f64::INFINITY, |step| (step as f64 * 0.025).max(0.36))
    };
    Scan {
        ranges_m: (0..181).map(range_m).collect(),
        angle_min_rad: -PI / 2.0,
        angle_increment_rad: PI / 180.0,
        range_min_m: 0.01,
        range_max_m: 8.0,
        mount: Mount::default(),
    }
}
