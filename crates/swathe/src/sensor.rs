//! What a robot senses: poses, scans and penetrometer readings. Data only, with the checks that any user of them needs.

use std::f64::consts::{PI, TAU};

use thiserror::Error;

use crate::grid::Position;

/// Where a robot is and how it is turned, in a metric frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// East in metres.
    pub x_m: f64,
    /// North in metres.
    pub y_m: f64,
    /// Heading, counter-clockwise from east.
    pub heading_rad: f64,
    /// Nose up is positive.
    pub pitch_rad: f64,
    /// Right side down is positive.
    pub roll_rad: f64,
}

impl Pose {
    /// A level pose.
    pub fn level(x_m: f64, y_m: f64, heading_rad: f64) -> Self {
        Self {
            x_m,
            y_m,
            heading_rad,
            pitch_rad: 0.0,
            roll_rad: 0.0,
        }
    }

    /// Whether every figure is finite.
    pub fn is_finite(&self) -> bool {
        [self.x_m, self.y_m, self.heading_rad, self.pitch_rad, self.roll_rad]
            .iter()
            .all(|figure| figure.is_finite())
    }

    /// Metres between two poses in the plane.
    pub fn distance_m(&self, other: &Self) -> f64 {
        (self.x_m - other.x_m).hypot(self.y_m - other.y_m)
    }

    /// The pose of something that is mounted on the body.
    #[must_use]
    pub fn of_mount(&self, mount: &Mount) -> Self {
        let (sin, cos) = self.heading_rad.sin_cos();
        Self {
            x_m: self.x_m + cos * mount.x_m - sin * mount.y_m,
            y_m: self.y_m + sin * mount.x_m + cos * mount.y_m,
            heading_rad: wrap(self.heading_rad + mount.heading_rad),
            ..*self
        }
    }

    /// Where a sensor at a pose of the same frame sits on a body here: what [`Pose::of_mount`] undoes.
    pub fn mount_of(&self, sensor: &Self) -> Mount {
        let (dx, dy) = (sensor.x_m - self.x_m, sensor.y_m - self.y_m);
        let (sin, cos) = self.heading_rad.sin_cos();
        Mount {
            x_m: cos * dx + sin * dy,
            y_m: cos * dy - sin * dx,
            heading_rad: wrap(sensor.heading_rad - self.heading_rad),
        }
    }
}

/// Where a sensor sits on the body: x ahead, y to the left.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mount {
    /// Ahead of the body's origin in metres.
    pub x_m: f64,
    /// Left of it in metres.
    pub y_m: f64,
    /// Counter-clockwise from the robot's nose.
    pub heading_rad: f64,
}

/// Ranges in a fan of directions, from a laser or a ring of sonars.
#[derive(Clone, Debug, PartialEq)]
pub struct Scan {
    /// Metres; infinite or at least `range_max_m` is clear, NaN or below `range_min_m` is invalid.
    pub ranges_m: Vec<f64>,
    /// Direction of the first beam, counter-clockwise from the sensor's axis.
    pub angle_min_rad: f64,
    /// From one beam to the next; negative when the sensor turns clockwise.
    pub angle_increment_rad: f64,
    /// Shortest distance that is measured.
    pub range_min_m: f64,
    /// Longest distance that is measured.
    pub range_max_m: f64,
    /// Where the sensor sits on the body.
    pub mount: Mount,
}

/// Greatest figure of a mount, in metres or radians: no sensor sits farther from its body's origin.
pub const MOUNT_MAX: f64 = 100.0;

/// What a beam tells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Return {
    /// Something stands at this range.
    Obstacle {
        /// Metres from the sensor.
        range_m: f64,
    },
    /// The beam met ground that the map and the robot's attitude explain.
    Ground {
        /// Metres from the sensor.
        range_m: f64,
    },
    /// Nothing up to this range.
    Clear {
        /// Metres from the sensor.
        range_m: f64,
    },
    /// Nothing can be said.
    Invalid,
}

impl Return {
    /// How far the beam went, in metres from the sensor; `None` where nothing can be said.
    pub fn range_m(self) -> Option<f64> {
        match self {
            Self::Obstacle { range_m } | Self::Ground { range_m } | Self::Clear { range_m } => Some(range_m),
            Self::Invalid => None,
        }
    }
}

/// Why a scan cannot be used at all. Single bad beams are [`Return::Invalid`] instead.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ScanError {
    /// No beams.
    #[error("The scan is empty.")]
    Empty,
    /// A figure of the scan's description is not usable.
    #[error("The scan's {name} of {given} is not usable: {allowed}.")]
    Figure {
        /// The figure.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

impl Scan {
    /// Checks the description of the scan; its ranges may be anything.
    ///
    /// # Errors
    /// [`ScanError`] when there are no beams, or limits or angles are not finite or contradict each other.
    pub fn validate(&self) -> Result<(), ScanError> {
        if self.ranges_m.is_empty() {
            return Err(ScanError::Empty);
        }
        let figure = |name, given, allowed| Err(ScanError::Figure { name, given, allowed });
        if !self.angle_min_rad.is_finite() {
            return figure("first angle", self.angle_min_rad, "it must be finite");
        }
        let fan_rad = self.angle_increment_rad.abs() * (self.ranges_m.len() - 1) as f64;
        if !(fan_rad.is_finite() && fan_rad <= TAU + 1e-6) {
            let given = self.angle_increment_rad;
            return figure("angle between beams", given, "all beams must lie within one turn");
        }
        if !(self.range_min_m >= 0.0 && self.range_min_m.is_finite()) {
            return figure("least range", self.range_min_m, "it must be at least 0 m");
        }
        if !(self.range_max_m > self.range_min_m && self.range_max_m.is_finite()) {
            return figure("greatest range", self.range_max_m, "it must exceed the least range");
        }
        let Mount { x_m, y_m, heading_rad } = self.mount;
        for given in [x_m, y_m, heading_rad] {
            if !(-MOUNT_MAX..=MOUNT_MAX).contains(&given) {
                return figure("mount", given, "its figures must be finite and at most 100");
            }
        }
        Ok(())
    }

    /// Direction of a beam, counter-clockwise from the sensor's axis.
    pub fn beam_rad(&self, beam: usize) -> f64 {
        self.angle_min_rad + self.angle_increment_rad * beam as f64
    }

    /// The beam that points to a bearing from the sensor's forward axis, in radians, with a fraction where it lies between two;
    /// `None` outside the fan.
    pub(crate) fn beam_at(&self, bearing_rad: f64) -> Option<f64> {
        let bearing = wrap(bearing_rad - self.angle_min_rad);
        let step = self.angle_increment_rad;
        if step == 0.0 {
            return None;
        }
        // The bearing may be a turn more or less, as the fan may begin anywhere.
        let turn = std::f64::consts::TAU;
        [bearing, bearing + turn, bearing - turn]
            .map(|bearing| bearing / step)
            .into_iter()
            .find(|beam| (-0.5..self.ranges_m.len() as f64 - 0.5).contains(beam))
    }

    /// Where a beam ends that goes so far from the sensor's pose.
    pub(crate) fn end_of(&self, beam: usize, range_m: f64, sensor: &Pose) -> Position {
        let (sin, cos) = (sensor.heading_rad + self.beam_rad(beam)).sin_cos();
        Position::new(sensor.x_m + range_m * cos, sensor.y_m + range_m * sin)
    }

    /// What a beam tells by its range alone.
    pub fn beam(&self, beam: usize) -> Return {
        let range_m = self.ranges_m[beam];
        if range_m.is_nan() || range_m < self.range_min_m {
            Return::Invalid
        } else if range_m >= self.range_max_m {
            Return::Clear {
                range_m: self.range_max_m,
            }
        } else {
            Return::Obstacle { range_m }
        }
    }
}

/// One push of a cone penetrometer.
#[derive(Clone, Debug, PartialEq)]
pub struct PenetrometerReading {
    /// East in metres.
    pub x_m: f64,
    /// North in metres.
    pub y_m: f64,
    /// Depths of the samples in metres, rising.
    pub depths_m: Vec<f64>,
    /// Cone index at each depth in kPa.
    pub cone_indices_kpa: Vec<f64>,
    /// Depth at which the cone could not be pushed on.
    pub refusal_depth_m: Option<f64>,
    /// Sleeve friction at each depth in kPa, where the instrument measures it.
    pub sleeve_frictions_kpa: Option<Vec<f64>>,
}

/// Greatest cone index that is taken for a measurement, in kPa: ten times what instruments for vehicles are built for.
pub const CONE_INDEX_MAX_KPA: f64 = 100_000.0;

/// Greatest depth that is taken for a measurement, in metres.
pub const DEPTH_MAX_M: f64 = 5.0;

/// Why a reading cannot be used.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ReadingError {
    /// Neither a sample nor a refusal.
    #[error("The reading holds neither a cone index nor a refusal depth.")]
    Empty,
    /// Columns of different lengths.
    #[error("The reading has {depths} depths and {values} {name}.")]
    Lengths {
        /// Number of depths.
        depths: usize,
        /// Number of values.
        values: usize,
        /// What the values are.
        name: &'static str,
    },
    /// A figure that no instrument gives.
    #[error("The reading's {name} of {given} is not physical: {allowed}.")]
    Figure {
        /// The figure.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

impl PenetrometerReading {
    /// Checks every figure.
    ///
    /// # Errors
    /// [`ReadingError`] naming the first figure that is missing or outside its physical range.
    pub fn validate(&self) -> Result<(), ReadingError> {
        let figure = |name, given, allowed| Err(ReadingError::Figure { name, given, allowed });
        for (name, given) in [("easting", self.x_m), ("northing", self.y_m)] {
            if !given.is_finite() {
                return figure(name, given, "it must be finite");
            }
        }
        if self.depths_m.is_empty() && self.refusal_depth_m.is_none() {
            return Err(ReadingError::Empty);
        }
        let depths = self.depths_m.len();
        let columns = [
            ("cone indices", Some(&self.cone_indices_kpa)),
            ("sleeve frictions", self.sleeve_frictions_kpa.as_ref()),
        ];
        for (name, column) in columns {
            let Some(column) = column else { continue };
            if column.len() != depths {
                let values = column.len();
                return Err(ReadingError::Lengths { depths, values, name });
            }
            for &given in column {
                if !(0.0..=CONE_INDEX_MAX_KPA).contains(&given) {
                    return figure(name, given, "0 to 100 000 kPa is allowed");
                }
            }
        }
        let all_depths = self.depths_m.iter().chain(&self.refusal_depth_m);
        for &given in all_depths {
            if !(0.0..=DEPTH_MAX_M).contains(&given) {
                return figure("depth", given, "0 to 5 m is allowed");
            }
        }
        for pair in self.depths_m.windows(2) {
            if pair[1] <= pair[0] {
                return figure("depth", pair[1], "depths must rise");
            }
        }
        Ok(())
    }
}

/// An angle brought to -pi (left out) to pi.
pub fn wrap(angle_rad: f64) -> f64 {
    let turned = angle_rad.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rstest::rstest;

    fn scan(ranges_m: Vec<f64>) -> Scan {
        Scan {
            ranges_m,
            angle_min_rad: -PI / 2.0,
            angle_increment_rad: PI / 180.0,
            range_min_m: 0.2,
            range_max_m: 8.0,
            mount: Mount::default(),
        }
    }

    #[rstest]
    #[case(f64::NAN, Return::Invalid)]
    #[case(0.0, Return::Invalid)]
    #[case(-1.0, Return::Invalid)]
    #[case(f64::NEG_INFINITY, Return::Invalid)]
    #[case(0.2, Return::Obstacle { range_m: 0.2 })]
    #[case(7.9, Return::Obstacle { range_m: 7.9 })]
    #[case(8.0, Return::Clear { range_m: 8.0 })]
    #[case(f64::INFINITY, Return::Clear { range_m: 8.0 })]
    fn a_beam_tells_what_its_range_says(#[case] range_m: f64, #[case] expected: Return) {
        assert_eq!(scan(vec![range_m]).beam(0), expected);
    }

    #[test]
    fn what_cannot_be_a_scan_is_refused() {
        assert_eq!(scan(Vec::new()).validate(), Err(ScanError::Empty));
        assert!(scan(vec![1.0; 181]).validate().is_ok());
        assert!(scan(vec![1.0; 362]).validate().is_err());
        for spoil in [
            |scan: &mut Scan| scan.angle_min_rad = f64::NAN,
            |scan: &mut Scan| scan.angle_increment_rad = f64::INFINITY,
            |scan: &mut Scan| scan.range_min_m = -1.0,
            |scan: &mut Scan| scan.range_max_m = 0.1,
            |scan: &mut Scan| scan.range_max_m = f64::INFINITY,
            |scan: &mut Scan| scan.mount.y_m = f64::NAN,
            |scan: &mut Scan| scan.mount.x_m = 1e200,
        ] {
            let mut spoiled = scan(vec![1.0; 3]);
            spoil(&mut spoiled);
            assert!(matches!(spoiled.validate(), Err(ScanError::Figure { .. })));
        }
    }

    #[test]
    fn what_cannot_be_a_reading_is_refused() {
        let reading = PenetrometerReading {
            x_m: 1.0,
            y_m: 2.0,
            depths_m: vec![0.05, 0.1, 0.15],
            cone_indices_kpa: vec![300.0, 500.0, 800.0],
            refusal_depth_m: None,
            sleeve_frictions_kpa: None,
        };
        assert!(reading.validate().is_ok());
        let only_refusal = PenetrometerReading {
            depths_m: Vec::new(),
            cone_indices_kpa: Vec::new(),
            refusal_depth_m: Some(0.02),
            ..reading.clone()
        };
        assert!(only_refusal.validate().is_ok());
        for spoil in [
            |reading: &mut PenetrometerReading| reading.x_m = f64::NAN,
            |reading: &mut PenetrometerReading| reading.depths_m[1] = 0.3,
            |reading: &mut PenetrometerReading| reading.depths_m[0] = -0.1,
            |reading: &mut PenetrometerReading| reading.cone_indices_kpa[0] = f64::NAN,
            |reading: &mut PenetrometerReading| reading.cone_indices_kpa[0] = 1e9,
            |reading: &mut PenetrometerReading| reading.cone_indices_kpa.truncate(2),
            |reading: &mut PenetrometerReading| reading.sleeve_frictions_kpa = Some(vec![1.0]),
            |reading: &mut PenetrometerReading| reading.refusal_depth_m = Some(9.0),
            |reading: &mut PenetrometerReading| {
                reading.depths_m.clear();
                reading.cone_indices_kpa.clear();
            },
        ] {
            let mut spoiled = reading.clone();
            spoil(&mut spoiled);
            assert!(spoiled.validate().is_err(), "{spoiled:?}");
        }
    }

    #[test]
    fn a_mount_moves_and_turns_with_the_body() {
        let mount = Mount {
            x_m: 0.2,
            y_m: 0.1,
            heading_rad: PI / 2.0,
        };
        let sensor = Pose::level(5.0, 7.0, PI / 2.0).of_mount(&mount);
        approx::assert_relative_eq!(sensor.x_m, 4.9, epsilon = 1e-12);
        approx::assert_relative_eq!(sensor.y_m, 7.2, epsilon = 1e-12);
        approx::assert_relative_eq!(sensor.heading_rad, PI, epsilon = 1e-12);
    }

    proptest! {
        #[test]
        fn wrapping_keeps_the_direction(angle in -1e4f64..1e4) {
            let wrapped = wrap(angle);
            prop_assert!(wrapped > -PI && wrapped <= PI);
            prop_assert!((wrapped.sin() - angle.sin()).abs() < 1e-9 && (wrapped.cos() - angle.cos()).abs() < 1e-9);
        }
    }
}
