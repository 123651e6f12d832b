//! Polar histograms: how dense obstacles are in every direction, and which directions are left.

use std::f64::consts::TAU;

use crate::sensor::wrap;

/// Obstacle density by direction, and what was made of it. Sector k points to k times the sector's angle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PolarHistogram {
    /// Obstacle density of every sector.
    pub density: Vec<f32>,
    /// Whether a sector is too dense to drive into.
    pub blocked: Vec<bool>,
    /// Whether a sector is blocked or closed all the same: beyond an obstacle in the turning circle, or towards one that is too near.
    pub masked: Vec<bool>,
}

/// What a method has decided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steering {
    /// Where to steer, counter-clockwise from east; `None` when every direction is closed.
    pub direction_rad: Option<f64>,
    /// Density in the direction of travel over the density that blocks, 0 to 1.
    pub crowding: f64,
    /// Width of the opening that is steered through.
    pub width_rad: f64,
}

impl Steering {
    /// No direction is open.
    pub const CLOSED: Self = Self {
        direction_rad: None,
        crowding: 1.0,
        width_rad: 0.0,
    };
}

/// Neighbouring sectors that are all open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Opening {
    /// The first, most clockwise sector.
    pub right: usize,
    /// Number of sectors.
    pub width: usize,
}

impl Opening {
    /// The last, most counter-clockwise sector.
    pub fn left(&self, sectors: usize) -> usize {
        (self.right + self.width - 1) % sectors
    }

    /// Whether a sector is one of its own.
    pub fn holds(&self, sector: usize, sectors: usize) -> bool {
        (sector + sectors - self.right) % sectors < self.width
    }
}

/// The openings of a closed circle of sectors; one of full width when nothing is blocked.
pub fn openings(blocked: &[bool]) -> Vec<Opening> {
    let sectors = blocked.len();
    let Some(first) = blocked.iter().position(|&closed| closed) else {
        return if sectors == 0 {
            Vec::new()
        } else {
            vec![Opening {
                right: 0,
                width: sectors,
            }]
        };
    };
    let mut found: Vec<Opening> = Vec::new();
    let mut open = false;
    // From a blocked sector on around, so that no opening is cut in two.
    for k in (first..first + sectors).map(|k| k % sectors) {
        match (blocked[k], open) {
            (false, false) => found.push(Opening { right: k, width: 1 }),
            (false, true) => {
                if let Some(last) = found.last_mut() {
                    last.width += 1;
                }
            }
            (true, _) => {}
        }
        open = !blocked[k];
    }
    found
}

/// Sectors between two directions, the shorter way around: the papers' Δ, not rounded.
pub fn sector_gap(a_rad: f64, b_rad: f64, sectors: usize) -> f64 {
    wrap(a_rad - b_rad).abs() / (TAU / sectors as f64)
}

/// The sector whose direction is nearest.
pub(super) fn sector_of(direction_rad: f64, sectors: usize) -> usize {
    ((direction_rad.rem_euclid(TAU) / TAU * sectors as f64).round() as usize) % sectors
}

/// Direction of a sector, which may be given as a fraction.
pub(super) fn direction_of(sector: f64, sectors: usize) -> f64 {
    wrap(sector * TAU / sectors as f64)
}

/// Direction of every cell of a window from its middle, and its distance in cells.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    pub side: usize,
    pub beta_rad: Vec<f64>,
    pub from_middle: Vec<f64>,
}

impl Cells {
    pub fn new(side: usize) -> Self {
        let half = (side / 2) as f64;
        let offsets = || (0..side * side).map(|i| ((i % side) as f64 - half, half - (i / side) as f64));
        Self {
            side,
            beta_rad: offsets().map(|(x, y)| y.atan2(x).rem_euclid(TAU)).collect(),
            from_middle: offsets().map(|(x, y)| x.hypot(y)).collect(),
        }
    }

    /// Half the side: the radius of the circle that fits.
    pub fn radius_cells(&self) -> f64 {
        (self.side / 2) as f64
    }
}

/// The density that an obstacle 0.3 m wide and seen with certainty gives at a distance, found by asking the method itself:
/// the threshold at which that obstacle blocks from there on.
///
/// `density` is called with a window that holds the obstacle straight east, and returns the histogram.
pub fn threshold(side: usize, cell_size_m: f64, distance_m: f64, density: impl FnOnce(&[u8]) -> Vec<f32>) -> f32 {
    const WIDTH_M: f64 = 0.3;
    let half = (side / 2) as i64;
    let mut window = vec![0; side * side];
    let away = ((distance_m / cell_size_m).round() as i64).clamp(1, half);
    let wide = ((WIDTH_M / cell_size_m).round() as i64).max(1);
    for down in (half - wide / 2)..(half - wide / 2 + wide) {
        if (0..side as i64).contains(&down) {
            window[(down * side as i64 + half + away) as usize] = super::CERTAINTY_MAX;
        }
    }
    density(&window).first().copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn drawn(text: &str) -> Vec<bool> {
        text.chars().map(|c| c == '#').collect()
    }

    #[test]
    fn openings_go_around_the_circle() {
        let at = |right, width| Opening { right, width };
        assert_eq!(openings(&drawn("..##...#")), [at(4, 3), at(0, 2)]);
        assert_eq!(openings(&drawn("#..#")), [at(1, 2)]);
        assert_eq!(openings(&drawn(".##.")), [at(3, 2)]);
        assert_eq!(openings(&drawn("....")), [at(0, 4)]);
        assert_eq!(openings(&drawn("####")), []);
        assert_eq!(openings(&[]), []);
    }

    proptest! {
        #[test]
        fn every_open_sector_lies_in_one_opening(blocked in prop::collection::vec(any::<bool>(), 1..80)) {
            let found = openings(&blocked);
            for (k, &closed) in blocked.iter().enumerate() {
                let holders = found.iter().filter(|opening| opening.holds(k, blocked.len())).count();
                prop_assert_eq!(holders, usize::from(!closed));
            }
        }

        #[test]
        fn sectors_and_directions_match(sectors in 1usize..400, direction in -10.0f64..10.0) {
            let k = sector_of(direction, sectors);
            prop_assert!(k < sectors);
            prop_assert!(sector_gap(direction, direction_of(k as f64, sectors), sectors) <= 0.5 + 1e-6);
        }
    }
}
