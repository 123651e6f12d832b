//! The vector field histogram as Player's `vfh` driver behaves, by the names of its parameters.
//!
//! Written from a description of the driver's behaviour, not from its code. It looks at the present scan only, in the half
//! plane ahead; everything behind a return is taken as filled. Some oddities of the driver are left out: its rounded 2π, the
//! wrong centre of openings that wrap around, tables built before the robot's size is known.

use std::f64::consts::{FRAC_PI_2, PI};

use crate::sensor::{Scan, wrap};

use super::polar::{Cells, direction_of, openings};
use super::{GOODNESS_MAX, Goodness};

/// The driver's parameters and defaults, in SI units. `_0ms` and `_1ms` hold at 0 and 1 m/s, linear between and beyond;
/// safety distance and turn rate never fall below 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlayerParams {
    /// `cell_size` in metres.
    pub cell_size_m: f64,
    /// `window_diameter` in cells.
    pub window_diameter: usize,
    /// `sector_angle` in degrees.
    pub sector_angle_deg: f64,
    /// `safety_dist_0ms`, `safety_dist_1ms` in metres.
    pub safety_dist_m: [f64; 2],
    /// `max_speed` in m/s.
    pub max_speed_mps: f64,
    /// `max_speed_narrow_opening` in m/s.
    pub max_speed_narrow_opening_mps: f64,
    /// `max_speed_wide_opening` in m/s.
    pub max_speed_wide_opening_mps: f64,
    /// `max_acceleration` in m/s².
    pub max_acceleration_mps2: f64,
    /// `min_turnrate` in rad/s, for turns in place at the goal.
    pub min_turnrate_radps: f64,
    /// `max_turnrate_0ms`, `max_turnrate_1ms` in rad/s.
    pub max_turnrate_radps: [f64; 2],
    /// `min_turn_radius_safety_factor`.
    pub min_turn_radius_safety_factor: f64,
    /// `free_space_cutoff_0ms`, `free_space_cutoff_1ms`.
    pub free_space_cutoff: [f64; 2],
    /// `obs_cutoff_0ms`, `obs_cutoff_1ms`.
    pub obs_cutoff: [f64; 2],
    /// `weight_desired_dir`.
    pub weight_desired_dir: f64,
    /// `weight_current_dir`.
    pub weight_current_dir: f64,
    /// `distance_epsilon` in metres: nearer to the goal is there.
    pub distance_epsilon_m: f64,
    /// `angle_epsilon` in radians: less off the goal's heading is in it.
    pub angle_epsilon_rad: f64,
    /// `escape_speed` in m/s, driven where every direction is closed; none without.
    pub escape_speed_mps: f64,
    /// `escape_time` in seconds, and none without.
    pub escape_time_s: f64,
    /// `escape_max_turnrate` in rad/s: each escape turns by chance, to either side and no faster.
    pub escape_max_turnrate_radps: f64,
    /// Degrees off the goal that count as much as a class of goodness that the ground lacks; not the driver's.
    pub ground_deg: f64,
    /// Robot radius in metres; the driver takes half the longer side of the base.
    pub robot_radius_m: f64,
}

impl Default for PlayerParams {
    fn default() -> Self {
        let turn = 40f64.to_radians();
        Self {
            cell_size_m: 0.1,
            window_diameter: 61,
            sector_angle_deg: 5.0,
            safety_dist_m: [0.1, 0.1],
            max_speed_mps: 0.2,
            max_speed_narrow_opening_mps: 0.2,
            max_speed_wide_opening_mps: 0.2,
            max_acceleration_mps2: 0.2,
            min_turnrate_radps: 10f64.to_radians(),
            max_turnrate_radps: [turn, turn],
            min_turn_radius_safety_factor: 1.0,
            free_space_cutoff: [2e6, 2e6],
            obs_cutoff: [2e6, 2e6],
            weight_desired_dir: 5.0,
            weight_current_dir: 3.0,
            distance_epsilon_m: 0.5,
            angle_epsilon_rad: 10f64.to_radians(),
            escape_speed_mps: 0.0,
            escape_time_s: 0.0,
            escape_max_turnrate_radps: 0.0,
            ground_deg: 2.0,
            robot_radius_m: 0.25,
        }
    }
}

/// What the driver commands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlayerSteering {
    /// Forward speed in m/s.
    pub speed_mps: f64,
    /// Turn rate, counter-clockwise.
    pub turn_rate_radps: f64,
    /// Direction picked, counter-clockwise from the nose.
    pub direction_rad: f64,
}

/// The driver's method with its memory: the last direction, speed and blocked sectors.
#[derive(Clone, Debug)]
pub struct PlayerVfh {
    params: PlayerParams,
    /// The cells of the half plane ahead, without the robot's own.
    cells: Vec<FrontCell>,
    /// Enlargement for which the cells' ranges of sectors hold, in metres.
    enlarged_m: f64,
    sectors: usize,
    histogram: Vec<f64>,
    blocked: Vec<bool>,
    masked: Vec<bool>,
    direction_rad: f64,
    speed_mps: f64,
}

/// A cell of the half plane ahead.
#[derive(Clone, Copy, Debug)]
struct FrontCell {
    beta_rad: f64,
    d_m: f64,
    /// The half-degree beam nearest to its direction.
    beam: u16,
    magnitude: f64,
    /// First and last sector that it counts for when enlarged; sectors below 0 lie a turn on.
    sectors: [i32; 2],
}

/// Openings narrower than this are ignored.
const LEAST_OPENING_DEG: f64 = 10.0;

/// Openings narrower than this are driven through the middle.
const WIDE_OPENING_DEG: f64 = 80.0;

/// From the border of a wide opening to a candidate.
const INSET_DEG: f64 = 40.0;

/// Off the nose by this much, the turn rate is the greatest.
const FULL_TURN_DEG: f64 = 75.0;

/// A step of speed when the time since the last is not known or long, in m/s.
const FIXED_STEP_MPS: f64 = 0.01;

/// Time steps beyond this count as not known.
const LONG_STEP_S: f64 = 0.3;

impl PlayerVfh {
    /// The method at rest. The window is made odd and at most 255 cells wide, the sector angle lies between 0.1 and 90 degrees.
    pub fn new(params: PlayerParams) -> Self {
        let sectors = (360.0 / params.sector_angle_deg.clamp(0.1, 90.0)).round() as usize;
        let window = Cells::new(params.window_diameter.clamp(3, 255) | 1);
        let places = window.beta_rad.iter().zip(&window.from_middle);
        let ahead = places.map(|(&beta, &d)| (wrap(beta), d * params.cell_size_m));
        let ahead = ahead.filter(|&(beta, d_m)| d_m > 0.0 && beta.abs() <= FRAC_PI_2 + 1e-9);
        Self {
            cells: ahead
                .map(|(beta_rad, d_m)| FrontCell {
                    beta_rad,
                    d_m,
                    beam: ((beta_rad + FRAC_PI_2).to_degrees() * 2.0).round().clamp(0.0, 360.0) as u16,
                    magnitude: (3000.0 - 1000.0 * d_m).powi(4) / 1e8,
                    sectors: [0, -1],
                })
                .collect(),
            enlarged_m: f64::NAN,
            sectors,
            histogram: vec![0.0; sectors],
            blocked: vec![false; sectors],
            masked: vec![false; sectors],
            direction_rad: 0.0,
            speed_mps: 0.0,
            params,
        }
    }

    /// Metres from the robot to the window's far corners, beyond which nothing counts.
    pub fn reach_m(&self) -> f64 {
        self.cells.iter().fold(0.0, |most, cell| cell.d_m.max(most)) + self.params.cell_size_m
    }

    /// Density of every sector in the last step, from the nose on counter-clockwise.
    pub fn histogram(&self) -> &[f64] {
        &self.histogram
    }

    /// Whether a sector was blocked in the last step, or could not be reached; all are when something was too near.
    pub fn masked(&self) -> &[bool] {
        &self.masked
    }

    /// One update: the scan, the measured speed, the goal's direction from the nose, and the time since the last update.
    ///
    /// The scan must have passed [`Scan::validate`].
    pub fn update(&mut self, scan: &Scan, speed_mps: f64, goal_rad: f64, step_s: f64) -> PlayerSteering {
        self.update_on(scan, speed_mps, goal_rad, step_s, None)
    }

    /// The same on ground whose goodness is known, with directions from the nose.
    pub fn update_on(
        &mut self,
        scan: &Scan,
        speed_mps: f64,
        goal_rad: f64,
        step_s: f64,
        ground: Option<Goodness>,
    ) -> PlayerSteering {
        let at_speed = |pair: [f64; 2]| pair[0] + (pair[1] - pair[0]) * speed_mps.max(0.0);
        let params = self.params;
        let max_turn_radps = at_speed(params.max_turnrate_radps).max(0.0);
        let enlarged_m = params.robot_radius_m + at_speed(params.safety_dist_m).max(0.0);
        let ranges_m = half_degrees(scan);
        if !self.fill(&ranges_m, enlarged_m) {
            self.speed_mps = 0.0;
            self.masked.fill(true);
            return PlayerSteering {
                speed_mps: 0.0,
                turn_rate_radps: max_turn_radps,
                direction_rad: self.direction_rad,
            };
        }
        let (free, occupied) = (at_speed(params.free_space_cutoff), at_speed(params.obs_cutoff));
        for (blocked, &density) in self.blocked.iter_mut().zip(&self.histogram) {
            *blocked = density > occupied || (*blocked && density >= free);
        }
        let turn_radius_m = params.min_turn_radius_safety_factor * speed_mps.max(0.0) / max_turn_radps.max(1e-6);
        self.mask(&ranges_m, turn_radius_m, enlarged_m);
        let (direction_rad, most_mps) = self.pick(wrap(goal_rad), ground);
        let Some(direction_rad) = direction_rad else {
            self.speed_mps = 0.0;
            return PlayerSteering {
                speed_mps: 0.0,
                turn_rate_radps: max_turn_radps,
                direction_rad: self.direction_rad,
            };
        };
        self.direction_rad = direction_rad;
        let faster = if step_s > 0.0 && step_s <= LONG_STEP_S {
            params.max_acceleration_mps2 * step_s
        } else {
            FIXED_STEP_MPS
        };
        self.speed_mps = (self.speed_mps + faster).min(most_mps);
        let share = (direction_rad / FULL_TURN_DEG.to_radians()).clamp(-1.0, 1.0);
        PlayerSteering {
            speed_mps: self.speed_mps,
            turn_rate_radps: share * max_turn_radps,
            direction_rad,
        }
    }

    /// Works out anew which sectors each cell counts for.
    fn enlarge(&mut self, enlarged_m: f64) {
        if self.enlarged_m == enlarged_m {
            return;
        }
        self.enlarged_m = enlarged_m;
        let sector_rad = std::f64::consts::TAU / self.sectors as f64;
        for cell in &mut self.cells {
            // Nearer cells close everything before they count.
            let gamma = (enlarged_m / cell.d_m).min(1.0).asin();
            let first = ((cell.beta_rad - gamma) / sector_rad).ceil() as i32;
            cell.sectors = [first, ((cell.beta_rad + gamma) / sector_rad).floor() as i32];
        }
    }

    /// Fills the histogram; false when something is nearer than the enlargement.
    fn fill(&mut self, ranges_m: &[f64; 361], enlarged_m: f64) -> bool {
        self.enlarge(enlarged_m);
        self.histogram.fill(0.0);
        let half_cell_m = self.params.cell_size_m / 2.0;
        for cell in &self.cells {
            if !cell.is_filled(ranges_m, half_cell_m) {
                continue;
            }
            if cell.d_m < enlarged_m {
                return false;
            }
            for k in cell.sectors[0]..=cell.sectors[1] {
                let k = if k < 0 { k + self.sectors as i32 } else { k };
                self.histogram[k as usize] += cell.magnitude;
            }
        }
        true
    }

    /// Masks the rear half and everything beyond an obstacle in one of the two turning circles.
    fn mask(&mut self, ranges_m: &[f64; 361], turn_radius_m: f64, enlarged_m: f64) {
        let (mut left, mut right) = (PI, -PI);
        let half_cell_m = self.params.cell_size_m / 2.0;
        for cell in &self.cells {
            if !cell.is_filled(ranges_m, half_cell_m) {
                continue;
            }
            let (beta, d_m) = (cell.beta_rad, cell.d_m);
            let (x, y) = (d_m * beta.cos(), d_m * beta.sin());
            if beta >= 0.0 && x.hypot(y - turn_radius_m) < turn_radius_m + enlarged_m {
                left = beta.min(left);
            }
            if beta <= 0.0 && x.hypot(y + turn_radius_m) < turn_radius_m + enlarged_m {
                right = beta.max(right);
            }
        }
        for (k, (masked, &blocked)) in self.masked.iter_mut().zip(&self.blocked).enumerate() {
            let ahead = direction_of(k as f64, self.sectors);
            *masked = blocked || ahead.abs() > FRAC_PI_2 + 1e-9 || ahead > left || ahead < right;
        }
    }

    /// The direction picked, if any, and the greatest speed for the opening it lies in.
    fn pick(&self, goal_rad: f64, ground: Option<Goodness>) -> (Option<f64>, f64) {
        let params = &self.params;
        let in_front = |k: usize| direction_of(k as f64, self.sectors).abs() <= FRAC_PI_2 + 1e-9;
        if (0..self.sectors).all(|k| !in_front(k) || !self.masked[k]) {
            return (Some(goal_rad), params.max_speed_mps);
        }
        let sector_deg = 360.0 / self.sectors as f64;
        let mut candidates = Vec::new();
        for opening in openings(&self.masked) {
            // From the first open sector to the last.
            let (right, last) = (opening.right as f64, opening.width as f64 - 1.0);
            let width_deg = last * sector_deg;
            let at = |sectors: f64| direction_of(right + sectors, self.sectors);
            if width_deg < LEAST_OPENING_DEG {
                continue;
            }
            if width_deg < WIDE_OPENING_DEG {
                candidates.push((at(last / 2.0), params.max_speed_narrow_opening_mps));
                continue;
            }
            let inset = INSET_DEG / sector_deg;
            for place in [last / 2.0, inset, last - inset] {
                candidates.push((at(place), params.max_speed_wide_opening_mps));
            }
            let goal = (goal_rad.to_degrees() / sector_deg - right).rem_euclid(self.sectors as f64);
            if (inset..=last - inset).contains(&goal) {
                candidates.push((goal_rad, params.max_speed_wide_opening_mps));
            }
        }
        let cost = |direction: f64| {
            let lack = ground.map_or(0.0, |goodness| GOODNESS_MAX - goodness(direction));
            params.weight_desired_dir * (wrap(goal_rad - direction).abs() + params.ground_deg.to_radians() * lack)
                + params.weight_current_dir * wrap(self.direction_rad - direction).abs()
        };
        let best = candidates.into_iter().min_by(|a, b| cost(a.0).total_cmp(&cost(b.0)));
        best.map_or((None, 0.0), |(direction, speed)| (Some(direction), speed))
    }
}

impl FrontCell {
    /// A cell counts as filled when it lies behind the return of the beam nearest to its direction.
    fn is_filled(&self, ranges_m: &[f64; 361], half_cell_m: f64) -> bool {
        self.d_m + half_cell_m > ranges_m[usize::from(self.beam)]
    }
}

/// Ranges over the half plane ahead in half degrees, from the right (0) over the nose (180) to the left (360): whole degrees
/// of the scan, each copied to the next half. Directions that the scan does not cover are closed; invalid beams are, too.
fn half_degrees(scan: &Scan) -> [f64; 361] {
    let mut ranges_m = [0.0; 361];
    for degree in 0..=180usize {
        let wanted = (degree as f64 - 90.0).to_radians() - scan.mount.heading_rad;
        let beam = (wrap(wanted - scan.angle_min_rad) / scan.angle_increment_rad).round();
        let last = scan.ranges_m.len() as f64 - 1.0;
        let covered = (-0.5..=last + 0.5).contains(&beam);
        let told = scan.beam(beam.clamp(0.0, last) as usize);
        let range_m = told.range_m().filter(|_| covered).unwrap_or(0.0);
        ranges_m[2 * degree] = range_m;
        if degree < 180 {
            ranges_m[2 * degree + 1] = range_m;
        }
    }
    ranges_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::Mount;
    use proptest::prelude::*;

    /// A scan of 181 whole degrees in a world of discs (x ahead, y left, radius).
    fn scan(discs: &[(f64, f64, f64)]) -> Scan {
        let range = |degree: usize| {
            let (sin, cos) = (degree as f64 - 90.0).to_radians().sin_cos();
            let hits = discs.iter().filter_map(|&(x, y, r)| {
                let along = x * cos + y * sin;
                let beside = (x * x + y * y - along * along).max(0.0);
                (along > 0.0 && beside < r * r).then(|| along - (r * r - beside).sqrt())
            });
            hits.fold(f64::INFINITY, f64::min)
        };
        Scan {
            ranges_m: (0..=180).map(range).collect(),
            angle_min_rad: -FRAC_PI_2,
            angle_increment_rad: 1f64.to_radians(),
            range_min_m: 0.0,
            range_max_m: 8.0,
            mount: Mount::default(),
        }
    }

    #[test]
    fn free_ahead_it_drives_to_the_goal_and_speeds_up_by_its_acceleration() {
        let mut vfh = PlayerVfh::new(PlayerParams::default());
        let clear = scan(&[]);
        let first = vfh.update(&clear, 0.0, 0.3, 0.1);
        assert_eq!(first.direction_rad, 0.3);
        approx::assert_relative_eq!(first.speed_mps, 0.02);
        approx::assert_relative_eq!(first.turn_rate_radps, 0.3 / 75f64.to_radians() * 40f64.to_radians());
        // A long pause counts as a fixed step, and the greatest speed is kept.
        approx::assert_relative_eq!(vfh.update(&clear, 0.0, 0.3, 5.0).speed_mps, 0.03);
        for _ in 0..30 {
            vfh.update(&clear, 0.1, 0.3, 0.1);
        }
        approx::assert_relative_eq!(vfh.update(&clear, 0.2, 0.3, 0.1).speed_mps, 0.2);
    }

    #[test]
    fn behind_the_nose_it_turns_at_its_greatest() {
        let mut vfh = PlayerVfh::new(PlayerParams::default());
        let steering = vfh.update(&scan(&[]), 0.0, 3.0, 0.1);
        approx::assert_relative_eq!(steering.turn_rate_radps, 40f64.to_radians());
    }

    #[test]
    fn something_too_close_stops_it_and_makes_it_spin_left() {
        let mut vfh = PlayerVfh::new(PlayerParams::default());
        let steering = vfh.update(&scan(&[(0.4, 0.0, 0.15)]), 0.2, 0.0, 0.1);
        assert_eq!(steering.speed_mps, 0.0);
        approx::assert_relative_eq!(steering.turn_rate_radps, 40f64.to_radians());
    }

    #[test]
    fn what_is_given_for_rest_and_1_mps_goes_on_in_a_straight_line_beyond() {
        let params = PlayerParams {
            safety_dist_m: [0.1, 0.3],
            max_turnrate_radps: [1.0, 0.6],
            min_turn_radius_safety_factor: 0.0,
            ..PlayerParams::default()
        };
        let behind = |speed_mps: f64| {
            let mut vfh = PlayerVfh::new(params);
            vfh.update(&scan(&[]), speed_mps, PI, 0.1).turn_rate_radps.abs()
        };
        for (speed_mps, radps) in [(-1.0, 1.0), (0.0, 1.0), (1.0, 0.6), (2.0, 0.2), (3.0, 0.0)] {
            approx::assert_relative_eq!(behind(speed_mps), radps, epsilon = 1e-9);
        }
        // 0.6 m away: near enough to stop for at 2 m/s, not at 1 m/s.
        let stops = |speed_mps: f64| {
            let mut vfh = PlayerVfh::new(params);
            vfh.update(&scan(&[(0.75, 0.0, 0.15)]), speed_mps, 0.0, 0.1).speed_mps == 0.0
        };
        assert!(stops(2.0) && !stops(1.0));
    }

    #[test]
    fn an_obstacle_ahead_is_passed() {
        let mut vfh = PlayerVfh::new(PlayerParams::default());
        let steering = vfh.update(&scan(&[(1.0, 0.1, 0.3)]), 0.1, 0.0, 0.1);
        assert!(
            steering.direction_rad < -0.4 && steering.direction_rad > -FRAC_PI_2,
            "{steering:?}"
        );
        assert!(steering.speed_mps > 0.0);
    }

    #[test]
    fn everything_behind_a_return_is_filled() {
        let mut vfh = PlayerVfh::new(PlayerParams::default());
        vfh.update(&scan(&[(1.0, 0.0, 0.3)]), 0.0, 0.0, 0.1);
        let filled = vfh.histogram()[0];
        // The sum of (3000 - d)^4 / 10^8 along the 23 cells behind one return is far above one cell's.
        assert!(filled > 5.0 * (3000.0f64 - 700.0).powi(4) / 1e8);
        assert_eq!(vfh.histogram()[36], 0.0);
    }

    #[test]
    fn directions_that_are_not_measured_are_closed() {
        let mut vfh = PlayerVfh::new(PlayerParams::default());
        let mut narrow = scan(&[]);
        narrow.ranges_m = vec![f64::INFINITY; 5];
        narrow.angle_min_rad = -2f64.to_radians();
        assert_eq!(vfh.update(&narrow, 0.0, 0.0, 0.1).speed_mps, 0.0);
    }

    proptest! {
        #[test]
        fn commands_stay_within_the_limits(
            ranges in prop::collection::vec(prop::num::f64::ANY, 181), speed in -1.0f64..2.0, goal in -10.0f64..10.0,
        ) {
            let mut vfh = PlayerVfh::new(PlayerParams::default());
            let mut any = scan(&[]);
            any.ranges_m = ranges;
            for _ in 0..3 {
                let steering = vfh.update(&any, speed, goal, 0.1);
                prop_assert!((0.0..=0.2).contains(&steering.speed_mps));
                prop_assert!(steering.turn_rate_radps.abs() <= 40f64.to_radians() + 1e-9);
            }
        }
    }
}
