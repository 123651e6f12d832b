//! The vector field histogram of Borenstein and Koren, "The vector field histogram: fast obstacle avoidance for mobile
//! robots", IEEE Transactions on Robotics and Automation 7(3), 1991. Symbols are the paper's.

use std::f64::consts::SQRT_2;

use super::polar::{
    Cells, Opening, PolarHistogram, Steering, direction_of, openings, sector_gap, sector_of, threshold,
};
use super::{GOODNESS_MAX, Goodness};

/// The paper's parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VfhParams {
    /// `w_s`: cells along the side of the active window, odd.
    pub window_cells: usize,
    /// Side of a cell in metres.
    pub cell_size_m: f64,
    /// n: number of sectors; the paper's α of 5 degrees gives 72.
    pub sectors: usize,
    /// l: how many sectors to each side smooth one.
    pub smoothing: usize,
    /// τ: a smoothed density of at least this blocks; `None` asks what an obstacle 0.3 m wide gives at `reaction_m`.
    pub tau: Option<f32>,
    /// Distance at which an obstacle 0.3 m wide must block, in metres.
    pub reaction_m: f64,
    /// `s_max`: sectors from which on a valley is wide.
    pub s_max: usize,
    /// Sectors off the target that count as much as a class of goodness that the ground lacks; not the paper's.
    pub ground_sectors: f64,
    /// Whether smoothing keeps the mean density (weights over (l + 1)²) instead of the paper's sum over 2l + 1.
    pub unit_gain: bool,
}

impl Default for VfhParams {
    fn default() -> Self {
        Self {
            window_cells: 33,
            cell_size_m: 0.1,
            sectors: 72,
            smoothing: 5,
            tau: None,
            reaction_m: 1.2,
            s_max: 18,
            ground_sectors: 0.4,
            unit_gain: false,
        }
    }
}

/// The method with its tables.
#[derive(Clone, Debug)]
pub struct Vfh {
    params: VfhParams,
    tau: f32,
    /// Sector and `a - b d` of every cell.
    cells: Vec<(u16, f32)>,
    /// Share of a neighbour's density, by distance in sectors.
    weights: Vec<f32>,
    middle: usize,
}

impl Vfh {
    /// Tables for some parameters. Windows are made odd and sectors at least 4.
    pub fn new(params: VfhParams) -> Self {
        let params = VfhParams {
            window_cells: params.window_cells.max(3) | 1,
            sectors: params.sectors.clamp(4, 3600),
            ..params
        };
        let cells = Cells::new(params.window_cells);
        // b = 1, and a = d_max makes the magnitude vanish in the corners.
        let d_max = SQRT_2 * (params.window_cells - 1) as f64 / 2.0;
        let l = params.smoothing;
        let gain = if params.unit_gain {
            ((l + 1) * (l + 1)) as f32
        } else {
            (2 * l + 1) as f32
        };
        let weight = |j: usize| {
            // The paper writes 1, 2, ..., l, ..., 2, 1 for 2 l + 1 sectors: the three in the middle share the l.
            let count = if params.unit_gain {
                l + 1 - j
            } else {
                (l + 1 - j).min(l.max(1))
            };
            count as f32 / gain
        };
        let mut vfh = Self {
            params,
            tau: 0.0,
            cells: cells
                .beta_rad
                .iter()
                .zip(&cells.from_middle)
                .map(|(&beta, &d)| {
                    // k = floor(β / α): sector k reaches from kα on; half a sector makes kα its middle.
                    (sector_of(beta, params.sectors) as u16, (d_max - d) as f32)
                })
                .collect(),
            weights: (0..=l).map(weight).collect(),
            middle: (cells.side / 2) * (cells.side + 1),
        };
        vfh.tau = params.tau.unwrap_or_else(|| {
            let reaction_m = params.reaction_m;
            threshold(params.window_cells, params.cell_size_m, reaction_m, |window| {
                vfh.density(window)
            })
        });
        vfh
    }

    /// Parameters in use.
    pub fn params(&self) -> &VfhParams {
        &self.params
    }

    /// τ in use.
    pub fn tau(&self) -> f32 {
        self.tau
    }

    /// h': the smoothed density of every sector of a window.
    fn density(&self, window: &[u8]) -> Vec<f32> {
        let n = self.params.sectors;
        let mut h = vec![0.0f32; n];
        for (index, (&c, &(k, closeness))) in window.iter().zip(&self.cells).enumerate() {
            if c > 0 && index != self.middle {
                h[usize::from(k)] += f32::from(c) * f32::from(c) * closeness;
            }
        }
        let smooth = |k: usize| {
            let around =
                (1..=self.params.smoothing.min(n / 2)).map(|j| self.weights[j] * (h[(k + j) % n] + h[(k + n - j) % n]));
            self.weights[0] * h[k] + around.sum::<f32>()
        };
        (0..n).map(smooth).collect()
    }

    /// Chooses a direction for a window and a target direction; `travel_rad` is where the robot drives now. `ground` tells the
    /// goodness of the ground in every direction: worse ground makes a valley count as farther from the target.
    pub fn steer(
        &self,
        window: &[u8],
        travel_rad: f64,
        target_rad: f64,
        ground: Option<Goodness>,
    ) -> (PolarHistogram, Steering) {
        let n = self.params.sectors;
        let density = self.density(window);
        let blocked: Vec<bool> = density.iter().map(|&h| h >= self.tau && h > 0.0).collect();
        let crowding = f64::from(density[sector_of(travel_rad, n)] / self.tau.max(f32::MIN_POSITIVE)).min(1.0);
        let valleys = openings(&blocked);
        let k_targ = sector_of(target_rad, n);
        // The valley that holds the target, else the one with the nearest border.
        let gap = |valley: &Opening| {
            let gap = if valley.holds(k_targ, n) {
                -1.0
            } else {
                self.border_gap(valley.right, target_rad)
                    .min(self.border_gap(valley.left(n), target_rad))
            };
            gap + self.lack(self.through(valley, target_rad, ground), ground)
        };
        let chosen = valleys.iter().min_by(|a, b| gap(a).total_cmp(&gap(b)));
        let steering = chosen.map_or(Steering::CLOSED, |valley| Steering {
            direction_rad: Some(self.through(valley, target_rad, ground)),
            crowding,
            width_rad: valley.width as f64 * std::f64::consts::TAU / n as f64,
        });
        let masked = blocked.clone();
        (
            PolarHistogram {
                density,
                blocked,
                masked,
            },
            steering,
        )
    }

    fn border_gap(&self, sector: usize, target_rad: f64) -> f64 {
        let n = self.params.sectors;
        sector_gap(direction_of(sector as f64, n), target_rad, n)
    }

    /// What the ground in a direction lacks of the best, in sectors off the target.
    fn lack(&self, direction_rad: f64, ground: Option<Goodness>) -> f64 {
        ground.map_or(0.0, |goodness| {
            self.params.ground_sectors * (GOODNESS_MAX - goodness(direction_rad))
        })
    }

    /// Where to steer through a valley.
    fn through(&self, valley: &Opening, target_rad: f64, ground: Option<Goodness>) -> f64 {
        let (n, s_max) = (self.params.sectors, self.params.s_max);
        let k_targ = sector_of(target_rad, n);
        let (right, left) = (valley.right, valley.left(n));
        let to_right = (k_targ + n - right) % n;
        let to_left = (left + n - k_targ) % n;
        if valley.width == n {
            target_rad
        } else if valley.width < s_max {
            // Narrow: through the middle.
            direction_of(right as f64 + (valley.width - 1) as f64 / 2.0, n)
        } else if valley.holds(k_targ, n) && to_right.min(to_left) >= s_max / 2 {
            // Far from both borders the target itself keeps the distance that s_max / 2 would give.
            target_rad
        } else {
            // Wide: s_max / 2 away from the border k_n that is nearest to the target.
            let inwards = s_max as f64 / 2.0;
            let from_right = direction_of(right as f64 + inwards, n);
            let from_left = direction_of(left as f64 - inwards, n);
            let off_right = self.border_gap(right, target_rad) + self.lack(from_right, ground);
            if off_right <= self.border_gap(left, target_rad) + self.lack(from_left, ground) {
                from_right
            } else {
                from_left
            }
        }
    }

    /// Speed after section IV-C: slower the denser the direction of travel and the faster the robot turns.
    ///
    /// `crowding` is `h'_c` over `h_m`; `turning` is Ω over its greatest.
    pub fn speed_mps(crowding: f64, turning: f64, greatest_mps: f64, least_mps: f64) -> f64 {
        let slower = greatest_mps * (1.0 - crowding.clamp(0.0, 1.0));
        slower * (1.0 - turning.abs().clamp(0.0, 1.0)) + least_mps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    /// A window of 33 cells with obstacles at directions (degrees) and distances (cells).
    fn window(obstacles: &[(f64, f64)]) -> Vec<u8> {
        let mut cells = vec![0; 33 * 33];
        for &(degrees, distance) in obstacles {
            let (sin, cos) = degrees.to_radians().sin_cos();
            for spread in -1..=1 {
                let right = 16.0 + distance * cos - f64::from(spread) * sin;
                let down = 16.0 - distance * sin - f64::from(spread) * cos;
                cells[down.round() as usize * 33 + right.round() as usize] = 15;
            }
        }
        cells
    }

    #[test]
    fn a_free_window_leads_to_the_target() {
        let vfh = Vfh::new(VfhParams::default());
        let (polar, steering) = vfh.steer(&window(&[]), 0.0, 1.234, None);
        assert!(polar.blocked.iter().all(|blocked| !blocked));
        assert_eq!(steering.direction_rad, Some(1.234));
        assert_eq!(steering.crowding, 0.0);
    }

    #[test]
    fn an_obstacle_ahead_blocks_when_it_is_near() {
        let vfh = Vfh::new(VfhParams::default());
        let blocked = |distance| {
            vfh.steer(&window(&[(90.0, distance)]), FRAC_PI_2, FRAC_PI_2, None)
                .0
                .blocked[18]
        };
        assert!(blocked(6.0) && blocked(11.0));
        assert!(!blocked(16.0));
    }

    #[test]
    fn it_steers_past_the_nearer_border() {
        let vfh = Vfh::new(VfhParams::default());
        let ahead = [(80.0, 6.0), (90.0, 6.0), (100.0, 6.0)];
        let steer = |target: f64| {
            vfh.steer(&window(&ahead), FRAC_PI_2, target, None)
                .1
                .direction_rad
                .unwrap()
        };
        let (left, right) = (steer(100f64.to_radians()), steer(80f64.to_radians()));
        assert!(left > FRAC_PI_2 + 0.6 && left < PI, "{left}");
        assert!(right < FRAC_PI_2 - 0.6 && right > 0.0, "{right}");
    }

    #[test]
    fn a_narrow_gap_is_taken_through_its_middle() {
        let vfh = Vfh::new(VfhParams {
            smoothing: 1,
            ..VfhParams::default()
        });
        let walls: Vec<_> = (0..72)
            .map(|k| f64::from(k) * 5.0)
            .filter(|d| (d - 90.0).abs() > 20.0)
            .map(|d| (d, 8.0))
            .collect();
        let steering = vfh.steer(&window(&walls), FRAC_PI_2, 80f64.to_radians(), None).1;
        let direction = steering.direction_rad.unwrap();
        assert!((direction - FRAC_PI_2).abs() < 0.1, "{direction}");
        assert!(steering.width_rad < FRAC_PI_2);
    }

    #[test]
    fn walls_all_around_leave_nothing() {
        let vfh = Vfh::new(VfhParams::default());
        let walls: Vec<_> = (0..72).map(|k| (f64::from(k) * 5.0, 5.0)).collect();
        assert_eq!(vfh.steer(&window(&walls), 0.0, 0.0, None).1.direction_rad, None);
    }

    #[test]
    fn smoothing_with_unit_gain_keeps_the_sum() {
        let sum = |unit_gain| {
            let vfh = Vfh::new(VfhParams {
                unit_gain,
                ..VfhParams::default()
            });
            vfh.density(&window(&[(40.0, 9.0)])).iter().sum::<f32>()
        };
        let raw = Vfh::new(VfhParams {
            smoothing: 0,
            unit_gain: true,
            ..VfhParams::default()
        });
        let raw = raw.density(&window(&[(40.0, 9.0)])).iter().sum::<f32>();
        approx::assert_relative_eq!(sum(true), raw, max_relative = 1e-4);
        // The paper's weights for l = 5: 5 + 2 (5 + 4 + 3 + 2 + 1) over 11.
        approx::assert_relative_eq!(sum(false), raw * 35.0 / 11.0, max_relative = 1e-4);
    }

    #[test]
    fn speed_falls_with_density_and_turning() {
        let speed = |crowding, turning| Vfh::speed_mps(crowding, turning, 0.78, 0.04);
        approx::assert_relative_eq!(speed(0.0, 0.0), 0.82);
        approx::assert_relative_eq!(speed(1.0, 0.0), 0.04);
        assert!(speed(0.5, 0.5) < speed(0.5, 0.0) && speed(0.5, 0.5) < speed(0.0, 0.5));
    }

    #[test]
    fn turning_the_world_turns_the_answer() {
        let vfh = Vfh::new(VfhParams::default());
        let ahead = [(61.0, 7.3), (71.0, 6.2)];
        let turned = |quarter: f64| ahead.map(|(degrees, distance)| (degrees + 90.0 * quarter, distance));
        let first = vfh.steer(&window(&ahead), 1.0, 1.1, None).1.direction_rad.unwrap();
        for quarter in [1.0, 2.0, 3.0] {
            let turn = quarter * FRAC_PI_2;
            let answer = vfh
                .steer(&window(&turned(quarter)), 1.0 + turn, 1.1 + turn, None)
                .1
                .direction_rad
                .unwrap();
            let gap = (answer - first - turn).rem_euclid(TAU);
            assert!(!(1e-6..=TAU - 1e-6).contains(&gap), "{gap}");
        }
    }
}
