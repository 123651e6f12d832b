//! Which returns are ground: what the elevation map and the robot's attitude explain.

use crate::grid::Position;
use crate::sensor::{Mount, Pose, Return, Scan};

use super::region::RegionState;

/// The plane of a scan's beams over the map.
pub(super) struct Attitude<'a> {
    region: &'a RegionState,
    /// The sensor's place and height.
    at: Position,
    height_m: f64,
    /// Sine and cosine of heading, pitch and roll.
    heading: (f64, f64),
    pitch: (f64, f64),
    roll: (f64, f64),
    tolerance_m: f64,
}

impl RegionState {
    /// How a scan of a sensor at a height lies over the map; `None` where the elevation under the robot is not known.
    pub fn attitude(&self, pose: &Pose, scan: &Scan, sensor_m: f64, tolerance_m: f64) -> Option<Attitude<'_>> {
        let here_m = self.height_m(Position::new(pose.x_m, pose.y_m))?;
        let (heading, (sin_p, cos_p), (sin_r, cos_r)) = (
            pose.heading_rad.sin_cos(),
            pose.pitch_rad.sin_cos(),
            pose.roll_rad.sin_cos(),
        );
        // The mount, its height included, turns with the body: by roll first, then by pitch, then by heading.
        let Mount { x_m, y_m, .. } = scan.mount;
        let left_m = cos_r * y_m - sin_r * sensor_m;
        let raised_m = sin_r * y_m + cos_r * sensor_m;
        let ahead_m = cos_p * x_m - sin_p * raised_m;
        let (sin, cos) = heading;
        Some(Attitude {
            region: self,
            at: Position::new(
                pose.x_m + cos * ahead_m - sin * left_m,
                pose.y_m + sin * ahead_m + cos * left_m,
            ),
            height_m: here_m + sin_p * x_m + cos_p * raised_m,
            heading,
            pitch: (sin_p, cos_p),
            roll: (sin_r, cos_r),
            tolerance_m,
        })
    }
}

impl Attitude<'_> {
    /// What a beam tells: a return at the height of the ground, or below, is ground.
    pub fn explain(&self, scan: &Scan, beam: usize) -> Return {
        let told = scan.beam(beam);
        let Return::Obstacle { range_m } = told else {
            return told;
        };
        let (sin, cos) = (scan.mount.heading_rad + scan.beam_rad(beam)).sin_cos();
        let ((sin_p, cos_p), (sin_r, cos_r)) = (self.pitch, self.roll);
        let (ahead, left) = (cos_p * cos - sin_p * sin_r * sin, cos_r * sin);
        let up = sin_p * cos + cos_p * sin_r * sin;
        let (sin_h, cos_h) = self.heading;
        let end = Position::new(
            self.at.x_m + range_m * (cos_h * ahead - sin_h * left),
            self.at.y_m + range_m * (sin_h * ahead + cos_h * left),
        );
        match self.region.height_m(end) {
            Some(ground_m) if self.height_m + range_m * up <= ground_m + self.tolerance_m => Return::Ground { range_m },
            _ => told,
        }
    }
}
