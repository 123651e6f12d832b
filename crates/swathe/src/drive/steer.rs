//! The local method behind one door, whatever its name.

use std::f64::consts::TAU;

use crate::grid::Position;
use crate::local::{
    Body, CERTAINTY_MAX, CertaintyGrid, PlayerParams, PlayerVfh, PolarHistogram, Steering, TooClose, Vfh, VfhParams,
    VfhPlus, VfhPlusParams, VfhStar, VfhStarParams,
};
use crate::sensor::{Pose, Scan, wrap};

use super::params::{Method, Shape};
use super::region::RegionState;

/// Weight of the ground's goodness in a direction, `μ_4`.
const MU_GROUND: f64 = 2.0;

#[derive(Debug)]
enum Kind {
    Vfh(Vfh),
    Plus(VfhPlus),
    Star(Box<VfhStar>),
    Player(PlayerVfh),
}

/// The polar histogram of a step and what was made of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// Obstacle density of every sector; sector k points k times the sector's angle off `first_rad`.
    pub densities: Vec<f32>,
    /// Whether a sector is too dense to drive into.
    pub blocked: Vec<bool>,
    /// Direction of sector 0, counter-clockwise from east.
    pub first_rad: f64,
    /// Densities below which a sector opens and from which it is blocked; equal where a method has one.
    pub thresholds: (f64, f64),
    /// Where the method steers to; `None` when every direction is closed.
    pub direction_rad: Option<f64>,
}

#[derive(Debug)]
pub(super) struct Local {
    kind: Kind,
    /// What the method of 1991 saw last; the others keep it themselves.
    seen: Option<PolarHistogram>,
    nose_rad: f64,
    direction_rad: Option<f64>,
    side: usize,
    window: Vec<u8>,
    costs: Vec<f32>,
}

/// What a step hands to the local method.
pub(super) struct Situation<'a> {
    pub grid: &'a CertaintyGrid,
    pub scan: Option<&'a Scan>,
    pub pose: &'a Pose,
    pub speed_mps: f64,
    pub step_s: f64,
    pub target: Position,
    pub region: Option<&'a RegionState>,
    pub margin_m: f64,
}

impl Local {
    pub fn new(method: Method, shape: &Shape, cell_size_m: f64, window_cells: usize) -> Self {
        let plus = VfhPlusParams {
            window_cells,
            cell_size_m,
            too_close: TooClose::TurnAway,
            ..VfhPlusParams::default()
        };
        let kind = match method {
            Method::Vfh => Kind::Vfh(Vfh::new(VfhParams {
                cell_size_m,
                // The method does not know the robot's size: the threshold must.
                reaction_m: shape.radius_m + 2.0 * shape.stopping_m(shape.max_speed_mps / 2.0),
                ..VfhParams::default()
            })),
            Method::VfhPlus => Kind::Plus(VfhPlus::new(plus)),
            Method::VfhStar => Kind::Star(Box::new(VfhStar::new(VfhStarParams {
                plus,
                step_m: (2.0 * shape.radius_m).max(0.8),
                ..VfhStarParams::default()
            }))),
            Method::Player => Kind::Player(PlayerVfh::new(PlayerParams {
                max_speed_mps: shape.max_speed_mps,
                max_speed_narrow_opening_mps: shape.max_speed_mps,
                max_speed_wide_opening_mps: shape.max_speed_mps,
                max_acceleration_mps2: shape.acceleration_mps2,
                robot_radius_m: shape.radius_m,
                ..PlayerParams::default()
            })),
        };
        let (side, sectors) = match &kind {
            Kind::Vfh(vfh) => (vfh.params().window_cells, 0),
            Kind::Plus(vfh) => (vfh.params().window_cells, vfh.params().sectors),
            Kind::Star(vfh) => (vfh.plus().params().window_cells, vfh.params().plus.sectors),
            Kind::Player(_) => (1, 0),
        };
        Self {
            kind,
            seen: None,
            nose_rad: 0.0,
            direction_rad: None,
            side,
            window: vec![0; side * side],
            costs: vec![0.0; sectors],
        }
    }

    /// Forgets the last step.
    pub fn forget(&mut self) {
        match &mut self.kind {
            Kind::Vfh(_) | Kind::Player(_) => {}
            Kind::Plus(vfh) => vfh.forget(),
            Kind::Star(vfh) => vfh.forget(),
        }
    }

    /// Chooses a direction.
    pub fn steer(&mut self, shape: &Shape, now: &Situation) -> Steering {
        let pose = now.pose;
        let target_rad = (now.target.y_m - pose.y_m).atan2(now.target.x_m - pose.x_m);
        let enlarged_m = shape.radius_m + now.margin_m;
        let body = Body {
            enlarged_m,
            turn_radius_m: [shape.turn_radius_m; 2],
            reaction_m: shape.stopping_m(now.speed_mps.abs()) + enlarged_m + 0.3,
        };
        if !matches!(self.kind, Kind::Player(_)) {
            now.grid.copy_window(pose.x_m, pose.y_m, self.side, &mut self.window);
        }
        let mut has_costs = false;
        if let Some(region) = now.region {
            self.close_forbidden(region, now);
            has_costs = self.ground_costs(region, pose, shape);
        }
        let costs = has_costs.then_some(self.costs.as_slice());
        let steering = match &mut self.kind {
            Kind::Vfh(vfh) => {
                let (seen, steering) = vfh.steer(&self.window, pose.heading_rad, target_rad);
                self.seen = Some(seen);
                steering
            }
            Kind::Plus(vfh) => vfh.steer(&self.window, pose.heading_rad, target_rad, &body, costs),
            Kind::Star(vfh) => {
                let towards = |x_m: f64, y_m: f64| (now.target.y_m - y_m).atan2(now.target.x_m - x_m);
                vfh.steer(now.grid, pose, &body, towards, costs)
            }
            Kind::Player(vfh) => {
                let Some(scan) = now.scan else { return Steering::CLOSED };
                let goal_rad = wrap(target_rad - pose.heading_rad);
                let told = vfh.update(scan, now.speed_mps, goal_rad, now.step_s);
                Steering {
                    direction_rad: (told.speed_mps > 0.0).then(|| wrap(pose.heading_rad + told.direction_rad)),
                    crowding: 0.0,
                    width_rad: TAU,
                }
            }
        };
        (self.nose_rad, self.direction_rad) = (pose.heading_rad, steering.direction_rad);
        steering
    }

    /// What the last step saw; `None` before the first.
    pub fn histogram(&self) -> Option<Histogram> {
        let (seen, thresholds) = match &self.kind {
            Kind::Vfh(vfh) => (self.seen.clone()?, [f64::from(vfh.tau()); 2]),
            Kind::Plus(vfh) => (vfh.histogram().clone(), thresholds_of(vfh)),
            Kind::Star(vfh) => (vfh.plus().histogram().clone(), thresholds_of(vfh.plus())),
            Kind::Player(vfh) => {
                let [low, high] = PlayerParams::default().obs_cutoff;
                let densities: Vec<f32> = vfh.histogram().iter().map(|&density| density as f32).collect();
                return Some(Histogram {
                    blocked: vfh.histogram().iter().map(|&density| density > low.max(high)).collect(),
                    densities,
                    first_rad: self.nose_rad,
                    thresholds: (low.min(high), low.max(high)),
                    direction_rad: self.direction_rad,
                });
            }
        };
        Some(Histogram {
            densities: seen.density,
            blocked: seen.blocked,
            first_rad: 0.0,
            thresholds: (thresholds[0], thresholds[1]),
            direction_rad: self.direction_rad,
        })
    }

    /// Ground that the map forbids is an obstacle in the window.
    fn close_forbidden(&mut self, region: &RegionState, now: &Situation) {
        let size = now.grid.params().cell_size_m;
        let half = (self.side / 2) as f64;
        for (index, cell) in self.window.iter_mut().enumerate() {
            let right = ((index % self.side) as f64 - half) * size;
            let down = ((index / self.side) as f64 - half) * size;
            if region.forbids(Position::new(now.pose.x_m + right, now.pose.y_m - down)) {
                *cell = CERTAINTY_MAX;
            }
        }
    }

    /// Costs of the directions by the goodness of the ground ahead of them.
    fn ground_costs(&mut self, region: &RegionState, pose: &Pose, shape: &Shape) -> bool {
        let sectors = self.costs.len();
        for (k, cost) in self.costs.iter_mut().enumerate() {
            let (sin, cos) = (k as f64 * TAU / sectors as f64).sin_cos();
            let goodness = |share: f64| {
                let away_m = share * (shape.radius_m + 2.0);
                let at = Position::new(pose.x_m + cos * away_m, pose.y_m + sin * away_m);
                match region.rank(at) {
                    Some(rank @ 1..=10) => f64::from(rank) / 2.0,
                    _ => 3.0,
                }
            };
            let mean = [0.3, 0.65, 1.0].map(goodness).iter().sum::<f64>() / 3.0;
            *cost = (MU_GROUND * (5.0 - mean)) as f32;
        }
        sectors > 0
    }
}

/// Both thresholds of VFH+.
fn thresholds_of(vfh: &VfhPlus) -> [f64; 2] {
    let high = f64::from(vfh.tau_high());
    [f64::from(vfh.params().tau_low_share) * high, high]
}
