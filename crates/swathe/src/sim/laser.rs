//! Beams against obstacles, movers and the ground, with the body's attitude.
//!
//! All beams of a scan lie in one plane that is tilted with the body. Seen from above, directions in that plane are a linear map of
//! directions in the sensor, so that the corners of obstacles, taken back through that map, give range and beam at once: only
//! beams between the two corners of an edge are cut with it. A scan costs time by what is near, not by beams times obstacles.

use std::f64::consts::{PI, TAU};

use crate::grid::Position;
use crate::random::unit;
use crate::sensor::{Mount, Pose, Scan, wrap};
use crate::vehicle::Vehicle;

use super::noise::{Noise, Stream, normals};
use super::relief::Ray;
use super::{Shape, SimError, World, require};

/// A ranging sensor: a laser scanner, or one cone of a sonar ring.
#[derive(Clone, Debug, PartialEq)]
pub struct Laser {
    /// Number of beams.
    pub beams: usize,
    /// Direction of the first beam, counter-clockwise from the sensor's axis.
    pub angle_min_rad: f64,
    /// From one beam to the next.
    pub angle_increment_rad: f64,
    /// Shortest distance that is measured; nearer things give 0 (invalid).
    pub range_min_m: f64,
    /// Longest distance that is measured; beyond it beams give infinity (clear).
    pub range_max_m: f64,
    /// Where it sits on the body.
    pub mount: Mount,
    /// Height of the beams above the ground under the body in metres.
    pub height_m: f64,
    /// Scans per second.
    pub rate_hz: f64,
    /// Standard deviation of a range in metres.
    pub noise_m: f64,
    /// An error common to all ranges, in metres.
    pub bias_m: f64,
    /// Share of beams that return nothing usable (NaN).
    pub dropout: f64,
    /// Step of the ranges in metres; 0 for none.
    pub resolution_m: f64,
}

/// Axes of the Pioneer's eight front sonars, counter-clockwise from the nose (Pioneer 2 and 3 operations manuals).
pub const PIONEER_SONAR_RAD: [f64; 8] = [
    PI / 2.0,
    50.0 * PI / 180.0,
    30.0 * PI / 180.0,
    10.0 * PI / 180.0,
    -10.0 * PI / 180.0,
    -30.0 * PI / 180.0,
    -50.0 * PI / 180.0,
    -PI / 2.0,
];

/// Places of those sonars on the body in metres, as the robot's parameter files list them.
const PIONEER_SONAR_PLACES_M: [(f64, f64); 8] = [
    (0.069, 0.136),
    (0.114, 0.119),
    (0.148, 0.078),
    (0.166, 0.027),
    (0.166, -0.027),
    (0.148, -0.078),
    (0.114, -0.119),
    (0.069, -0.136),
];

/// Width of a sonar's cone.
pub const SONAR_CONE_RAD: f64 = 30.0 * PI / 180.0;

/// Length and width of the Pioneer that the places are those of.
const PIONEER_M: (f64, f64) = (0.44, 0.38);

/// Rays of one sonar cone; its range is the shortest.
const CONE_RAYS: usize = 7;

/// The Pioneer's front ring: eight cones of 30 degrees, 0.1 to 5 m. Each is scanned with [`Laser::cone`].
pub fn pioneer_sonar() -> Vec<Laser> {
    let of = |(&heading_rad, (x_m, y_m)): (&f64, (f64, f64))| Laser {
        beams: CONE_RAYS,
        angle_min_rad: -SONAR_CONE_RAD / 2.0,
        angle_increment_rad: SONAR_CONE_RAD / (CONE_RAYS - 1) as f64,
        range_min_m: 0.1,
        range_max_m: 5.0,
        mount: Mount { x_m, y_m, heading_rad },
        height_m: 0.18,
        rate_hz: 25.0,
        noise_m: 0.02,
        bias_m: 0.0,
        dropout: 0.0,
        resolution_m: 0.01,
    };
    PIONEER_SONAR_RAD.iter().zip(PIONEER_SONAR_PLACES_M).map(of).collect()
}

/// The same ring on another vehicle: its places lie as they do on the Pioneer, drawn out to the vehicle's length and width.
pub fn sonar_ring(vehicle: &Vehicle) -> Vec<Laser> {
    let (length_m, width_m) = PIONEER_M;
    let mut ring = pioneer_sonar();
    for cone in &mut ring {
        cone.mount.x_m *= vehicle.length_m / length_m;
        cone.mount.y_m *= vehicle.width_m / width_m;
    }
    ring
}

impl Laser {
    /// The SICK LMS 200 with 181 or 361 beams over half a turn, in its 8 m (1 mm) or 80 m (10 mm) mode. Rates are those of its fast
    /// serial line (75 and 32 Hz would be possible; 35 Hz is what a drive takes). Noise 5 mm; mounted 0.1 m ahead, 0.3 m high.
    pub fn sick_lms200(half_degrees: bool, far: bool) -> Self {
        let beams = if half_degrees { 361 } else { 181 };
        Self {
            beams,
            angle_min_rad: -PI / 2.0,
            angle_increment_rad: PI / (beams - 1) as f64,
            range_min_m: 0.2,
            range_max_m: if far { 81.92 } else { 8.192 },
            mount: Mount {
                x_m: 0.1,
                ..Mount::default()
            },
            height_m: 0.3,
            rate_hz: if half_degrees { 32.0 } else { 35.0 },
            noise_m: 0.005,
            bias_m: 0.0,
            dropout: 0.0,
            resolution_m: if far { 0.01 } else { 0.001 },
        }
    }

    /// Checks every figure.
    ///
    /// # Errors
    /// [`SimError::Figure`] naming the first figure outside its range.
    pub fn validate(&self) -> Result<(), SimError> {
        let beams = self.beams as f64;
        require(
            "number of beams",
            beams,
            (1.0..=10_000.0).contains(&beams),
            "1 to 10 000 are allowed",
        )?;
        require("first beam", self.angle_min_rad, true, "it must be finite")?;
        let fan = self.angle_increment_rad * (beams - 1.0);
        let fits = self.angle_increment_rad > 0.0 && fan <= TAU + 1e-9;
        require(
            "angle between beams",
            self.angle_increment_rad,
            fits,
            "above 0, all within one turn",
        )?;
        require(
            "least range",
            self.range_min_m,
            self.range_min_m >= 0.0,
            "it must not be below 0 m",
        )?;
        let fits = self.range_max_m > self.range_min_m && self.range_max_m <= 10_000.0;
        require(
            "greatest range",
            self.range_max_m,
            fits,
            "above the least range, at most 10 000 m",
        )?;
        for given in [self.mount.x_m, self.mount.y_m, self.mount.heading_rad] {
            require("mount", given, true, "it must be finite")?;
        }
        require(
            "height of the beams",
            self.height_m,
            self.height_m > 0.0,
            "it must be above 0 m",
        )?;
        require(
            "rate of scans",
            self.rate_hz,
            self.rate_hz > 0.0,
            "it must be above 0 Hz",
        )?;
        require(
            "noise of ranges",
            self.noise_m,
            self.noise_m >= 0.0,
            "it must not be below 0 m",
        )?;
        require("bias of ranges", self.bias_m, true, "it must be finite")?;
        require(
            "share of lost beams",
            self.dropout,
            (0.0..=1.0).contains(&self.dropout),
            "0 to 1 is allowed",
        )?;
        require(
            "step of ranges",
            self.resolution_m,
            self.resolution_m >= 0.0,
            "it must not be below 0 m",
        )
    }

    /// True ranges of all beams from a body at a pose on ground of a height; infinite where nothing is met.
    pub fn true_ranges_m(&self, world: &World, body: &Pose, ground_m: f64, time_s: f64) -> Vec<f64> {
        let sight = Sight::new(self, body, ground_m);
        let mut ranges_m = vec![f64::INFINITY; self.beams];
        self.meet_ground(world, &sight, &mut ranges_m);
        let mut near = Vec::new();
        world.near(sight.at, self.range_max_m, &mut near);
        for &n in &near {
            let obstacle = &world.obstacles()[n as usize];
            self.meet(&sight, &obstacle.shape, world.top_m(n as usize), &mut ranges_m);
        }
        for mover in world.movers() {
            let shape = Shape::Disc {
                centre: mover.at(time_s),
                radius_m: mover.radius_m,
            };
            self.meet(&sight, &shape, f64::INFINITY, &mut ranges_m);
        }
        ranges_m
    }

    /// A scan as the sensor gives it: with noise, steps, lost beams and its range limits. `count` numbers the scans of a run.
    pub fn scan(&self, world: &World, body: &Pose, ground_m: f64, time_s: f64, noise: Noise, count: u64) -> Scan {
        let mut ranges_m = self.true_ranges_m(world, body, ground_m, time_s);
        self.disturb(&mut ranges_m, noise, count, 0);
        Scan {
            ranges_m,
            angle_min_rad: self.angle_min_rad,
            angle_increment_rad: self.angle_increment_rad,
            range_min_m: self.range_min_m,
            range_max_m: self.range_max_m,
            mount: self.mount,
        }
    }

    /// A scan of one beam: the shortest range of the cone that the beams span. `index` tells the cones of a ring apart.
    #[allow(clippy::too_many_arguments, reason = "a moment, and the place of its draws")]
    pub fn cone(
        &self,
        world: &World,
        body: &Pose,
        ground_m: f64,
        time_s: f64,
        noise: Noise,
        count: u64,
        index: u32,
    ) -> Scan {
        let ranges_m = self.true_ranges_m(world, body, ground_m, time_s);
        let mut nearest = [ranges_m.into_iter().fold(f64::INFINITY, f64::min)];
        // Places far beyond the beams of a scanner, so that no draw is used twice.
        self.disturb(&mut nearest, noise, count, 1_000_000 + index);
        Scan {
            ranges_m: nearest.to_vec(),
            angle_min_rad: 0.0,
            angle_increment_rad: 0.0,
            range_min_m: self.range_min_m,
            range_max_m: self.range_max_m,
            mount: self.mount,
        }
    }

    fn disturb(&self, ranges_m: &mut [f64], noise: Noise, count: u64, first: u32) {
        let quiet = self.noise_m == 0.0 && self.dropout == 0.0;
        for (pair, ranges_m) in (first..).zip(ranges_m.chunks_mut(2)) {
            // One draw serves two beams: two normals for noise and two numbers for loss.
            let (normals, chances) = if quiet {
                ([0.0; 2], [1.0; 2])
            } else {
                let words = noise.words(Stream::Beams, count, pair);
                (normals([words[0], words[1]]), [unit(words[2]), unit(words[3])])
            };
            for ((range_m, normal), chance) in ranges_m.iter_mut().zip(normals).zip(chances) {
                *range_m = self.measured(*range_m, normal, chance);
            }
        }
    }

    fn measured(&self, true_m: f64, normal: f64, chance: f64) -> f64 {
        if chance < self.dropout {
            return f64::NAN;
        }
        let mut range_m = true_m + self.bias_m + self.noise_m * normal;
        if self.resolution_m > 0.0 {
            range_m = (range_m / self.resolution_m).round() * self.resolution_m;
        }
        if range_m >= self.range_max_m {
            f64::INFINITY
        } else if range_m < self.range_min_m {
            0.0
        } else {
            range_m
        }
    }

    fn meet_ground(&self, world: &World, sight: &Sight, ranges_m: &mut [f64]) {
        for (range_m, &beam) in ranges_m.iter_mut().zip(&sight.beams) {
            let ray = sight.ray(beam);
            if let Some(hit) = world.relief().hit_m(&ray, self.range_max_m) {
                *range_m = hit;
            }
        }
    }

    /// Direction of a beam in the body, counter-clockwise from its nose.
    fn body_rad(&self, beam: usize) -> f64 {
        self.mount.heading_rad + self.angle_min_rad + self.angle_increment_rad * beam as f64
    }

    fn meet(&self, sight: &Sight, shape: &Shape, top_m: f64, ranges_m: &mut [f64]) {
        if let Shape::Disc { centre, radius_m } = shape {
            let (dx, dy) = (centre.x_m - sight.at.x_m, centre.y_m - sight.at.y_m);
            let distance_m = dx.hypot(dy);
            if distance_m - radius_m > self.range_max_m {
                return;
            }
            // The two tangents span its beams; close by, all beams are tried.
            let spread = if distance_m > 1.5 * radius_m {
                let side = radius_m / (distance_m * distance_m - radius_m * radius_m).sqrt();
                [(dx - dy * side, dy + dx * side), (dx + dy * side, dy - dx * side)].map(|(x, y)| sight.seen(x, y))
            } else {
                [(1.0, 0.0); 2]
            };
            let angles = spread.map(|(x, y)| y.atan2(x));
            let span = if distance_m > 1.5 * radius_m {
                wrap(angles[0] - angles[1]).abs()
            } else {
                TAU
            };
            let from = if wrap(angles[0] - angles[1]) > 0.0 {
                angles[1]
            } else {
                angles[0]
            };
            self.each_beam(from, span, |beam| {
                let [x, y, up] = sight.ray(sight.beams[beam]).direction;
                let (square, along) = (x * x + y * y, x * dx + y * dy);
                let rest = along * along - square * (distance_m * distance_m - radius_m * radius_m);
                if rest < 0.0 || square == 0.0 {
                    return;
                }
                let near = (along - rest.sqrt()) / square;
                let range_m = if near >= 0.0 {
                    near
                } else {
                    (along + rest.sqrt()) / square
                };
                if range_m >= 0.0 && range_m < ranges_m[beam] && sight.height_m + up * range_m <= top_m {
                    ranges_m[beam] = range_m;
                }
            });
            return;
        }
        for (a, b) in shape.edges() {
            let [a, b] = [a, b].map(|end| sight.seen(end.x_m - sight.at.x_m, end.y_m - sight.at.y_m));
            let (ex, ey) = (b.0 - a.0, b.1 - a.1);
            let from_line = a.0 * ey - a.1 * ex;
            let span = wrap(b.1.atan2(b.0) - a.1.atan2(a.0));
            let from = if span > 0.0 { a.1.atan2(a.0) } else { b.1.atan2(b.0) };
            self.each_beam(from, span.abs(), |beam| {
                let (sin, cos) = sight.beams[beam];
                let across = cos * ey - sin * ex;
                if across == 0.0 {
                    return;
                }
                let range_m = from_line / across;
                // Along the edge 0 to 1, from the cross product of the beam with its first end.
                let along = (a.0 * sin - a.1 * cos) / across;
                let met = range_m >= 0.0 && range_m < ranges_m[beam] && (0.0..=1.0).contains(&along);
                if met && sight.height_m + sight.up(cos, sin) * range_m <= top_m {
                    ranges_m[beam] = range_m;
                }
            });
        }
    }

    /// Calls for every beam whose direction in the body lies within `span_rad` counter-clockwise of `from_rad`, and a few more.
    fn each_beam(&self, from_rad: f64, span_rad: f64, mut call: impl FnMut(usize)) {
        let first_rad = self.mount.heading_rad + self.angle_min_rad;
        let margin_rad = 1e-6;
        let step = self.angle_increment_rad;
        // The fan may begin anywhere in the span; look at it from one turn before.
        let offset = (from_rad - margin_rad - first_rad).rem_euclid(TAU) - TAU;
        for turn in 0..3 {
            let low = offset + TAU * f64::from(turn);
            let first = (low / step).ceil().max(0.0);
            let last = ((low + span_rad + 2.0 * margin_rad) / step)
                .floor()
                .min((self.beams - 1) as f64);
            if last >= first {
                for beam in first as usize..=last as usize {
                    call(beam);
                }
            }
        }
    }
}

/// The plane of the beams from one place.
struct Sight {
    at: Position,
    height_m: f64,
    /// Sine and cosine of heading, pitch and roll.
    heading: (f64, f64),
    pitch: (f64, f64),
    roll: (f64, f64),
    /// The same of the direction of every beam in the body.
    beams: Vec<(f64, f64)>,
}

impl Sight {
    fn new(laser: &Laser, body: &Pose, ground_m: f64) -> Self {
        let mut sight = Self {
            at: Position::new(body.x_m, body.y_m),
            height_m: ground_m,
            heading: body.heading_rad.sin_cos(),
            pitch: body.pitch_rad.sin_cos(),
            roll: body.roll_rad.sin_cos(),
            beams: (0..laser.beams).map(|beam| laser.body_rad(beam).sin_cos()).collect(),
        };
        // The mount, its height included, turns with the body.
        let (x, y, up) = (laser.mount.x_m, laser.mount.y_m, laser.height_m);
        let ((sp, cp), (sr, cr)) = (sight.pitch, sight.roll);
        let left = cr * y - sr * up;
        let raised = sr * y + cr * up;
        let ahead = cp * x - sp * raised;
        let (sin, cos) = sight.heading;
        sight.height_m += sp * x + cp * raised;
        sight.at = Position::new(body.x_m + cos * ahead - sin * left, body.y_m + sin * ahead + cos * left);
        sight
    }

    /// Metres up per metre of a beam with this cosine and sine of its direction in the body.
    fn up(&self, cos: f64, sin: f64) -> f64 {
        let ((sp, cp), (sr, _)) = (self.pitch, self.roll);
        sp * cos + cp * sr * sin
    }

    /// The line of a beam by sine and cosine of its direction in the body.
    fn ray(&self, (sin, cos): (f64, f64)) -> Ray {
        let ((sp, cp), (sr, cr)) = (self.pitch, self.roll);
        let (ahead, left) = (cp * cos - sp * sr * sin, cr * sin);
        let (sh, ch) = self.heading;
        Ray {
            origin_m: [self.at.x_m, self.at.y_m, self.height_m],
            direction: [ch * ahead - sh * left, sh * ahead + ch * left, self.up(cos, sin)],
        }
    }

    /// An offset east and north as cosine and sine of the direction of the beam that passes over it, times its range.
    fn seen(&self, east_m: f64, north_m: f64) -> (f64, f64) {
        let (sh, ch) = self.heading;
        let (ahead, left) = (ch * east_m + sh * north_m, ch * north_m - sh * east_m);
        let ((sp, cp), (sr, cr)) = (self.pitch, self.roll);
        let sin = left / cr;
        ((ahead + sp * sr * sin) / cp, sin)
    }
}

#[cfg(test)]
#[path = "laser_tests.rs"]
mod tests;
