//! VFH+ of Ulrich and Borenstein, "VFH+: reliable obstacle avoidance for fast mobile robots", ICRA 1998, 1572-1577. Symbols
//! are the paper's.
//!
//! The work of an update does not depend on what the window holds: the magnitudes are integers (b = 1, so that
//! `a = 1 + ((w_s - 1) / 2)²` is one, too), and every cell adds its magnitude where its enlarged sector range begins and takes
//! it away where the range ends, so that one running sum gives all densities exactly.

use std::f64::consts::{PI, TAU};

use crate::sensor::wrap;

use super::polar::{Cells, PolarHistogram, Steering, direction_of, openings, sector_gap, sector_of};
use super::{GOODNESS_MAX, Goodness};

/// Tables kept for different enlargements.
const MOST_TABLES: usize = 24;

/// Width of the obstacle that sets the threshold, in metres.
const OBSTACLE_M: f64 = 0.3;

/// Cells that are looked at together for the turning circles.
const LANES: usize = 8;

/// What single precision may be wrong by in a cosine, and a little more.
const ROUNDING: f64 = 1e-6;

/// What happens when an obstacle lies within robot radius and safety distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TooClose {
    /// Every direction is closed (the paper).
    Stop,
    /// Directions that lead nearer to it are closed, those that lead away stay open.
    TurnAway,
}

/// The paper's parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VfhPlusParams {
    /// `w_s`: diameter of the active window in cells, odd.
    pub window_cells: usize,
    /// Side of a cell in metres.
    pub cell_size_m: f64,
    /// n: number of sectors; the paper's α of 5 degrees gives 72.
    pub sectors: usize,
    /// `τ_high`; `None` asks what an obstacle 0.3 m wide gives at the body's reaction distance.
    pub tau_high: Option<f32>,
    /// `τ_low` as a share of `τ_high`; between them a sector stays what it was.
    pub tau_low_share: f32,
    /// `s_max`: sectors from which on an opening is wide.
    pub s_max: usize,
    /// `μ_1`, `μ_2`, `μ_3`: weights of the gap to target, heading and the direction chosen before.
    pub mu: [f64; 3],
    /// `μ_4`: weight of what the ground in a direction lacks of the best goodness, by class; not the paper's.
    pub mu_ground: f64,
    /// Certainty from which on a cell counts as an obstacle for the turning circle and for being too close.
    pub sure: u8,
    /// What happens when an obstacle is too close.
    pub too_close: TooClose,
}

impl Default for VfhPlusParams {
    fn default() -> Self {
        Self {
            window_cells: 61,
            cell_size_m: 0.1,
            sectors: 72,
            tau_high: None,
            tau_low_share: 0.6,
            s_max: 16,
            mu: [5.0, 2.0, 2.0],
            mu_ground: 2.0,
            sure: 6,
            too_close: TooClose::Stop,
        }
    }
}

/// What the method must know of the robot at its present speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// `r_r + d_s`: robot radius and safety distance in metres.
    pub enlarged_m: f64,
    /// `r_L` and `r_R`: least radius of a turn to the left and to the right in metres, 0 for a robot that turns in place.
    pub turn_radius_m: [f64; 2],
    /// Distance at which an obstacle 0.3 m wide must block, in metres.
    pub reaction_m: f64,
}

/// Where the enlarged cells begin and end, for one enlargement.
#[derive(Clone, Debug)]
struct Table {
    enlarged_m: f64,
    /// Cells by the bucket in which their range begins, and where each bucket starts.
    begins: Buckets,
    /// The same for the bucket after the range.
    ends: Buckets,
    /// Cells nearer than the enlargement.
    near: Vec<u16>,
}

/// Cells in groups.
#[derive(Clone, Debug)]
struct Buckets {
    cells: Vec<u16>,
    starts: Vec<u32>,
}

impl Buckets {
    fn of(count: usize, mut pairs: Vec<(u32, u16)>) -> Self {
        pairs.sort_unstable();
        let starts = (0..=count).map(|bucket| pairs.partition_point(|pair| (pair.0 as usize) < bucket) as u32);
        Self {
            starts: starts.collect(),
            cells: pairs.into_iter().map(|pair| pair.1).collect(),
        }
    }

    fn sum(&self, bucket: usize, magnitudes: &[i32]) -> i64 {
        let cells = &self.cells[self.starts[bucket] as usize..self.starts[bucket + 1] as usize];
        cells.iter().map(|&cell| i64::from(magnitudes[usize::from(cell)])).sum()
    }
}

/// The method with its tables and its memory of the last step.
#[derive(Clone, Debug)]
pub struct VfhPlus {
    params: VfhPlusParams,
    cells: Cells,
    /// For the turning circles, by groups of [`LANES`] cells: east and north of their directions, their distances in cells, and
    /// one over those. Cells outside the circle and the one in the middle are never inside a turning circle.
    turning: Vec<[[f32; LANES]; 4]>,
    /// a - b d² of every cell; 0 outside the circle and in the middle.
    weights: Vec<i32>,
    tables: Vec<Table>,
    magnitudes: Vec<i32>,
    polar: PolarHistogram,
    tau_high: f32,
    previous_rad: Option<f64>,
}

impl VfhPlus {
    /// Tables for some parameters. The window is made odd and at most 255 cells wide, sectors lie between 4 and 3600.
    pub fn new(params: VfhPlusParams) -> Self {
        let params = VfhPlusParams {
            window_cells: params.window_cells.clamp(3, 255) | 1,
            sectors: params.sectors.clamp(4, 3600),
            ..params
        };
        let cells = Cells::new(params.window_cells);
        let a = cells.radius_cells() * cells.radius_cells() + 1.0;
        let weight = |&d: &f64| {
            if d == 0.0 {
                0
            } else {
                (a - d * d).round().max(0.0) as i32
            }
        };
        let count = cells.beta_rad.len();
        let group = |first: usize| {
            let part = |figure: &dyn Fn(usize) -> f64, padding: f32| {
                std::array::from_fn(|lane| {
                    let cell = first + lane;
                    let counts = cell < count && weight(&cells.from_middle[cell]) > 0;
                    if counts { figure(cell) as f32 } else { padding }
                })
            };
            [
                part(&|cell| cells.beta_rad[cell].cos(), 0.0),
                part(&|cell| cells.beta_rad[cell].sin(), 0.0),
                part(&|cell| cells.from_middle[cell], f32::MAX),
                part(&|cell| 1.0 / cells.from_middle[cell], 0.0),
            ]
        };
        let turning = (0..count).step_by(LANES).map(group).collect();
        Self {
            turning,
            weights: cells.from_middle.iter().map(weight).collect(),
            tables: Vec::new(),
            magnitudes: vec![0; cells.side * cells.side],
            polar: PolarHistogram {
                density: vec![0.0; params.sectors],
                blocked: vec![false; params.sectors],
                masked: vec![false; params.sectors],
            },
            tau_high: 0.0,
            previous_rad: None,
            cells,
            params,
        }
    }

    /// Parameters in use.
    pub fn params(&self) -> &VfhPlusParams {
        &self.params
    }

    /// Densities and openings of the last step.
    pub fn histogram(&self) -> &PolarHistogram {
        &self.polar
    }

    /// `τ_high` of the last step.
    pub fn tau_high(&self) -> f32 {
        self.tau_high
    }

    /// Forgets the last step: its direction and which sectors it blocked.
    pub fn forget(&mut self) {
        self.previous_rad = None;
        self.polar.blocked.fill(false);
    }

    /// Direction chosen in the last step.
    pub fn previous_rad(&self) -> Option<f64> {
        self.previous_rad
    }

    /// Sets the direction that counts as chosen in the last step.
    pub fn set_previous(&mut self, direction_rad: Option<f64>) {
        self.previous_rad = direction_rad;
    }

    /// Chooses a direction; `ground` tells the goodness of the ground in every direction.
    pub fn steer(
        &mut self,
        window: &[u8],
        heading_rad: f64,
        target_rad: f64,
        body: &Body,
        ground: Option<Goodness>,
    ) -> Steering {
        self.update(window, heading_rad, body);
        let n = self.params.sectors;
        let [mu_1, mu_2, mu_3] = self.params.mu;
        let mu_4 = self.params.mu_ground;
        let previous_rad = self.previous_rad.unwrap_or(heading_rad);
        let cost = |c: f64| {
            mu_1 * sector_gap(c, target_rad, n)
                + mu_2 * sector_gap(c, heading_rad, n)
                + mu_3 * sector_gap(c, previous_rad, n)
                + ground.map_or(0.0, |goodness| mu_4 * (GOODNESS_MAX - goodness(c)))
        };
        let best = self
            .candidates(target_rad)
            .into_iter()
            .min_by(|a, b| cost(a.0).total_cmp(&cost(b.0)));
        let steering = best.map_or(Steering::CLOSED, |(direction_rad, width_rad)| Steering {
            direction_rad: Some(direction_rad),
            crowding: self.crowding(direction_rad),
            width_rad,
        });
        self.previous_rad = steering.direction_rad;
        steering
    }

    /// Density in a direction over the density that blocks, at most 1.
    pub fn crowding(&self, direction_rad: f64) -> f64 {
        let density = self.polar.density[sector_of(direction_rad, self.params.sectors)];
        f64::from(density / self.tau_high.max(f32::MIN_POSITIVE)).min(1.0)
    }

    /// The candidate directions of every opening (stage 4), with the width of the opening.
    pub fn candidates(&self, target_rad: f64) -> Vec<(f64, f64)> {
        let n = self.params.sectors;
        let sector_rad = TAU / n as f64;
        let mut found = Vec::new();
        for opening in openings(&self.polar.masked) {
            let width_rad = opening.width as f64 * sector_rad;
            if opening.width == n {
                found.push((wrap(target_rad), width_rad));
                continue;
            }
            let (right, last) = (opening.right as f64, opening.width as f64 - 1.0);
            if opening.width < self.params.s_max {
                found.push((direction_of(right + last / 2.0, n), width_rad));
                continue;
            }
            let inwards = self.params.s_max as f64 / 2.0;
            found.push((direction_of(right + inwards, n), width_rad));
            found.push((direction_of(right + last - inwards, n), width_rad));
            // The target itself, when it lies between these two.
            let place = (target_rad / sector_rad - right).rem_euclid(n as f64);
            if (inwards..=last - inwards).contains(&place) {
                found.push((wrap(target_rad), width_rad));
            }
        }
        found
    }

    /// Stages 1 to 3: primary, binary and masked histogram of a window.
    pub fn update(&mut self, window: &[u8], heading_rad: f64, body: &Body) {
        let n = self.params.sectors;
        let table = self.table(body.enlarged_m);
        for ((m, &c), &weight) in self.magnitudes.iter_mut().zip(window).zip(&self.weights) {
            *m = i32::from(c) * i32::from(c) * weight;
        }
        let table = &self.tables[table];
        // Ranges may begin up to a turn before sector 0 and end up to a turn after the last: three turns of buckets.
        let mut running = 0i64;
        self.polar.density.fill(0.0);
        for turn in 0..3 {
            for (k, density) in self.polar.density.iter_mut().enumerate() {
                let bucket = turn * n + k;
                running += table.begins.sum(bucket, &self.magnitudes) - table.ends.sum(bucket, &self.magnitudes);
                *density += running as f32;
            }
        }
        let a = self.cells.radius_cells() * self.cells.radius_cells() + 1.0;
        self.tau_high = self.params.tau_high.unwrap_or_else(|| {
            let d = body.reaction_m / self.params.cell_size_m;
            let across = (OBSTACLE_M / self.params.cell_size_m).round().max(1.0);
            let certain = f64::from(super::CERTAINTY_MAX);
            (across * certain * certain * (a - d * d).max(1.0)) as f32
        });
        let tau_low = self.tau_high * self.params.tau_low_share;
        let polar = &mut self.polar;
        for ((blocked, &density), masked) in polar.blocked.iter_mut().zip(&polar.density).zip(&mut polar.masked) {
            *blocked = density > self.tau_high || (*blocked && density >= tau_low);
            *masked = *blocked;
        }
        self.mask_turns(window, heading_rad, body);
        self.mask_near(window, body);
    }

    /// Stage 3: sectors that lie beyond an obstacle inside the turning circle are masked.
    ///
    /// All in cosines and sines off the heading, in lanes and without branches: the work is the same whatever the window holds.
    #[allow(clippy::needless_bitwise_bool, reason = "no branches: the loop becomes vector code")]
    fn mask_turns(&mut self, window: &[u8], heading_rad: f64, body: &Body) {
        let [r_left, r_right] = body.turn_radius_m;
        if r_left <= 0.0 && r_right <= 0.0 {
            return;
        }
        let size = self.params.cell_size_m;
        let (sin, cos) = heading_rad.sin_cos();
        let (sin, cos) = (sin as f32, cos as f32);
        // A cell at distance d, s = sin of its direction off the heading, lies inside the circle of its side when
        // d² - 2 r d |s| + r² < (r + R)²; over d: d - 2 r |s| < (R² + 2 r R) / d.
        let enlarged = body.enlarged_m / size;
        let circle = |r: f64| ((2.0 * r / size) as f32, (enlarged * (enlarged + 2.0 * r / size)) as f32);
        let (left_circle, right_circle) = (circle(r_left), circle(r_right));
        let below = i32::from(self.params.sure) - 1;
        // The greatest cosine of a cell that blocks is the least angle off the heading.
        let (mut most_left, mut most_right) = ([-2.0f32; LANES], [-2.0f32; LANES]);
        let mut look = |[east, north, away, over]: &[[f32; LANES]; 4], certainties: &[u8; LANES]| {
            for lane in 0..LANES {
                let c = east[lane] * cos + north[lane] * sin;
                let s = north[lane] * cos - east[lane] * sin;
                let stands = i32::from(certainties[lane]) > below;
                let is_left = s >= 0.0;
                let (twice, reach) = if is_left { left_circle } else { right_circle };
                let inside = stands & (away[lane] - twice * s.abs() < reach * over[lane]);
                let left = if inside & is_left { c } else { -2.0 };
                let right = if inside & !is_left { c } else { -2.0 };
                most_left[lane] = if left > most_left[lane] { left } else { most_left[lane] };
                most_right[lane] = if right > most_right[lane] {
                    right
                } else {
                    most_right[lane]
                };
            }
        };
        // No cell farther away than a circle reaches, and so no row farther up or down, lies inside one.
        let (side, half) = (self.cells.side, self.cells.side / 2);
        let most_cells = (2.0 * r_left.max(r_right) / size + enlarged + 1.0)
            .min(side as f64)
            .ceil() as usize;
        let first = half.saturating_sub(most_cells) * side / LANES;
        let end = ((half + most_cells + 1).min(side) * side).div_ceil(LANES);
        let (groups, rest) = window.as_chunks::<LANES>();
        let whole = end.min(groups.len());
        for (group, certainties) in self.turning[first..whole].iter().zip(&groups[first..whole]) {
            look(group, certainties);
        }
        if end > whole {
            let mut certainties = [0; LANES];
            certainties[..rest.len()].copy_from_slice(rest);
            look(&self.turning[whole], &certainties);
        }
        let greatest = |lanes: [f32; LANES]| f64::from(lanes.into_iter().fold(-2.0, f32::max));
        let (cos_left, cos_right) = (greatest(most_left), greatest(most_right));
        let n = self.params.sectors;
        for (k, masked) in self.polar.masked.iter_mut().enumerate() {
            let ahead = wrap(direction_of(k as f64, n) - heading_rad);
            let beyond = if ahead >= 0.0 { cos_left } else { cos_right };
            // The sector that points at the obstacle itself is left to the binary histogram.
            *masked |= ahead.cos() < beyond - ROUNDING;
        }
    }

    /// An obstacle nearer than the enlargement closes everything, or all that leads nearer to it.
    fn mask_near(&mut self, window: &[u8], body: &Body) {
        let index = self.table(body.enlarged_m);
        let near = &self.tables[index].near;
        let n = self.params.sectors;
        for &cell in near {
            let cell = usize::from(cell);
            if window[cell] < self.params.sure {
                continue;
            }
            if self.params.too_close == TooClose::Stop || self.cells.from_middle[cell] == 0.0 {
                self.polar.masked.fill(true);
                return;
            }
            let beta = self.cells.beta_rad[cell];
            for (k, masked) in self.polar.masked.iter_mut().enumerate() {
                *masked |= wrap(direction_of(k as f64, n) - beta).abs() < PI / 2.0;
            }
        }
    }

    /// The table of an enlargement, made when it is first asked for.
    fn table(&mut self, enlarged_m: f64) -> usize {
        // Steps of a tenth of a cell are finer than the window.
        let step = self.params.cell_size_m / 10.0;
        let enlarged_m = (enlarged_m / step).ceil().max(0.0) * step;
        if let Some(found) = self.tables.iter().position(|table| table.enlarged_m == enlarged_m) {
            return found;
        }
        if self.tables.len() == MOST_TABLES {
            self.tables.remove(0);
        }
        let n = self.params.sectors;
        let per_rad = n as f64 / TAU;
        let r = enlarged_m / self.params.cell_size_m;
        let (mut begins, mut ends, mut near) = (Vec::new(), Vec::new(), Vec::new());
        for (cell, &weight) in self.weights.iter().enumerate() {
            let d = self.cells.from_middle[cell];
            if d <= r {
                near.push(cell as u16);
            }
            if weight == 0 || d <= r {
                continue;
            }
            let (beta, gamma) = (self.cells.beta_rad[cell], (r / d).asin());
            // A cell that falls between two sectors counts for the nearest.
            let middle = beta * per_rad;
            let low = ((beta - gamma) * per_rad).ceil().min(middle.round());
            let high = ((beta + gamma) * per_rad).floor().max(middle.round());
            let shift = n as f64;
            begins.push(((low + shift) as u32, cell as u16));
            ends.push(((high + 1.0 + shift) as u32, cell as u16));
        }
        self.tables.push(Table {
            enlarged_m,
            begins: Buckets::of(3 * n, begins),
            ends: Buckets::of(3 * n, ends),
            near,
        });
        self.tables.len() - 1
    }
}

#[cfg(test)]
mod tests;
