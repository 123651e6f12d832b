//! The local method behind one door, whatever its name.

use std::f64::consts::TAU;

use crate::grid::Position;
use crate::local::{
    Body, CERTAINTY_MAX, CertaintyGrid, Goodness, Ground, PlayerParams, PlayerVfh, PolarHistogram, Steering, TooClose,
    Vfh, VfhParams, VfhPlus, VfhPlusParams, VfhStar, VfhStarParams,
};
use crate::sensor::{Pose, Scan, wrap};

use super::params::{Method, Shape};
use super::region::RegionState;

/// `d_s`: metres ahead of the footprint's circle over which the goodness of the ground counts.
const GROUND_AHEAD_M: f64 = 2.0;

/// Goodness of ground that the map does not know.
const UNKNOWN_GOODNESS: f64 = 3.0;

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
    /// Whether it is blocked or closed all the same: beyond an obstacle in the turning circle, towards one that is too near, or, for
    /// Player's method, behind.
    pub masked: Vec<bool>,
    /// Direction of sector 0, counter-clockwise from east.
    pub first_rad: f64,
    /// Densities below which a sector opens and from which it is blocked; equal where a method has one.
    pub thresholds: (f64, f64),
    /// Where the method steers to; `None` when it finds no direction.
    pub direction_rad: Option<f64>,
}

#[derive(Debug)]
pub(super) struct Local {
    kind: Kind,
    /// What the method of 1991 saw last; the others keep it themselves.
    seen: Option<PolarHistogram>,
    /// What Player's method told of the last scan: it sees scans alone, and they may come less often than steps.
    of_last_scan: Steering,
    nose_rad: Option<f64>,
    direction_rad: Option<f64>,
    side: usize,
    window: Vec<u8>,
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
        let side = match &kind {
            Kind::Vfh(vfh) => vfh.params().window_cells,
            Kind::Plus(vfh) => vfh.params().window_cells,
            Kind::Star(_) | Kind::Player(_) => 1,
        };
        Self {
            kind,
            seen: None,
            of_last_scan: Steering::CLOSED,
            nose_rad: None,
            direction_rad: None,
            side,
            window: vec![0; side * side],
        }
    }

    /// Forgets the last step.
    pub fn forget(&mut self) {
        self.of_last_scan = Steering::CLOSED;
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
        let ground = now.region.map(|region| Underfoot {
            region,
            cell_size_m: now.grid.params().cell_size_m,
            ahead_m: shape.radius_m + GROUND_AHEAD_M,
        });
        if matches!(self.kind, Kind::Vfh(_) | Kind::Plus(_)) {
            now.grid.copy_window(pose.x_m, pose.y_m, self.side, &mut self.window);
            if let Some(ground) = &ground {
                ground.close(pose.x_m, pose.y_m, &mut self.window);
            }
        }
        let goodness = ground
            .as_ref()
            .map(|ground| |direction_rad: f64| ground.goodness(pose.x_m, pose.y_m, direction_rad));
        let by_direction = goodness.as_ref().map(|goodness| goodness as Goodness);
        let steering = match &mut self.kind {
            Kind::Vfh(vfh) => {
                let (seen, steering) = vfh.steer(&self.window, pose.heading_rad, target_rad, by_direction);
                self.seen = Some(seen);
                steering
            }
            Kind::Plus(vfh) => vfh.steer(&self.window, pose.heading_rad, target_rad, &body, by_direction),
            Kind::Star(vfh) => {
                let towards = |x_m: f64, y_m: f64| (now.target.y_m - y_m).atan2(now.target.x_m - x_m);
                let ground = ground.as_ref().map(|ground| ground as &dyn Ground);
                vfh.steer(now.grid, pose, &body, towards, ground)
            }
            Kind::Player(vfh) => {
                let Some(scan) = now.scan else { return self.of_last_scan };
                let goal_rad = wrap(target_rad - pose.heading_rad);
                let told = if let Some(ground) = &ground {
                    // The method sees scans alone: forbidden ground returns its beams.
                    let reach_m = vfh.reach_m();
                    let scan = ground.in_scan(scan, pose, reach_m);
                    let ahead = |off_rad: f64| ground.goodness(pose.x_m, pose.y_m, pose.heading_rad + off_rad);
                    vfh.update_on(&scan, now.speed_mps, goal_rad, now.step_s, Some(&ahead))
                } else {
                    vfh.update(scan, now.speed_mps, goal_rad, now.step_s)
                };
                self.of_last_scan = Steering {
                    direction_rad: (told.speed_mps > 0.0).then(|| wrap(pose.heading_rad + told.direction_rad)),
                    crowding: 0.0,
                    width_rad: TAU,
                };
                self.of_last_scan
            }
        };
        (self.nose_rad, self.direction_rad) = (Some(pose.heading_rad), steering.direction_rad);
        steering
    }

    /// What the last step saw; `None` before the first.
    pub fn histogram(&self) -> Option<Histogram> {
        let nose_rad = self.nose_rad?;
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
                    masked: vfh.masked().to_vec(),
                    first_rad: nose_rad,
                    thresholds: (low.min(high), low.max(high)),
                    direction_rad: self.direction_rad,
                });
            }
        };
        Some(Histogram {
            densities: seen.density,
            blocked: seen.blocked,
            masked: seen.masked,
            first_rad: 0.0,
            thresholds: (thresholds[0], thresholds[1]),
            direction_rad: self.direction_rad,
        })
    }
}

/// The map's ground as the local methods ask for it.
struct Underfoot<'a> {
    region: &'a RegionState,
    cell_size_m: f64,
    /// `d_s`: metres ahead whose goodness counts.
    ahead_m: f64,
}

impl Underfoot<'_> {
    /// A scan whose beams end at the latest where ground is forbidden.
    fn in_scan(&self, scan: &Scan, pose: &Pose, reach_m: f64) -> Scan {
        let sensor = pose.of_mount(&scan.mount);
        let mut closed = scan.clone();
        let steps = (reach_m / self.cell_size_m).ceil() as usize;
        for (beam, range_m) in closed.ranges_m.iter_mut().enumerate() {
            let heading_rad = sensor.heading_rad + scan.beam_rad(beam);
            let (sin, cos) = heading_rad.sin_cos();
            let forbidden = (1..=steps).map(|step| step as f64 * self.cell_size_m).find(|&away_m| {
                let place = Position::new(sensor.x_m + away_m * cos, sensor.y_m + away_m * sin);
                self.region.forbids_towards(place, heading_rad, away_m)
            });
            // What could not be measured stays closed.
            if let Some(away_m) = forbidden
                && *range_m > away_m
            {
                *range_m = away_m.max(scan.range_min_m);
            }
        }
        closed
    }
}

impl Ground for Underfoot<'_> {
    fn close(&self, x_m: f64, y_m: f64, window: &mut [u8]) {
        self.region
            .close_forbidden(Position::new(x_m, y_m), self.cell_size_m, window, CERTAINTY_MAX);
    }

    fn goodness(&self, x_m: f64, y_m: f64, direction_rad: f64) -> f64 {
        let (sin, cos) = direction_rad.sin_cos();
        let goodness = |share: f64| {
            let away_m = share * self.ahead_m;
            match self.region.rank(Position::new(x_m + cos * away_m, y_m + sin * away_m)) {
                // A rank is the sum of two goodnesses.
                Some(rank @ 1..=10) => f64::from(rank) / 2.0,
                _ => UNKNOWN_GOODNESS,
            }
        };
        [0.25, 0.5, 0.75, 1.0].map(goodness).iter().sum::<f64>() / 4.0
    }
}

/// Both thresholds of VFH+.
fn thresholds_of(vfh: &VfhPlus) -> [f64; 2] {
    let high = f64::from(vfh.tau_high());
    [f64::from(vfh.params().tau_low_share) * high, high]
}
