//! A cone penetrometer pushed into the true soil.
//!
//! What carries a vehicle is the rating cone index, what a cone meets is more: traffic leaves only a share of the strength, the
//! remoulding index. The cone index over depth is the class's rating cone index over that share, times 0.6 + 0.4 z / 7.5 cm, so
//! that its mean over the upper 15 cm is the class's figure (the gradient is an estimate). Soil of unknown class counts as 700
//! kPa; where there is no ground (water, peat) the cone meets 5 kPa. On rock the cone stops within 3 cm; elsewhere where the
//! force is more than the instrument's greatest cone index.

use crate::grid::Position;
use crate::sensor::PenetrometerReading;
use crate::soil::SoilClass;

use super::noise::{Noise, Stream};
use super::{SimError, World, require};

/// A digital cone penetrometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Penetrometer {
    /// Depth of a full push in metres.
    pub depth_m: f64,
    /// Metres between samples.
    pub spacing_m: f64,
    /// Speed of the cone in m/s (ASABE EP542: about 30 mm/s).
    pub speed_mps: f64,
    /// Seconds to lower and to lift the instrument.
    pub set_up_s: f64,
    /// Relative deviation from one push to the next (log-normal).
    pub push_variation: f64,
    /// Relative deviation from one sample to the next (log-normal).
    pub sample_variation: f64,
    /// Greatest cone index that the instrument presses, in kPa.
    pub refusal_kpa: f64,
    /// Metres from the front edge of the vehicle forwards to the cone, on its boom; below 0 behind that edge.
    pub boom_m: f64,
}

impl Default for Penetrometer {
    /// 30 cm at 30 mm/s, a sample each 2.5 cm, half a metre before the front edge; variations are estimates, because published
    /// spreads differ widely.
    fn default() -> Self {
        Self {
            depth_m: 0.3,
            spacing_m: 0.025,
            speed_mps: 0.03,
            set_up_s: 5.0,
            push_variation: 0.15,
            sample_variation: 0.1,
            refusal_kpa: 5000.0,
            boom_m: 0.5,
        }
    }
}

/// Cone index in kPa of soil of unknown class.
const UNKNOWN_KPA: f64 = 700.0;

/// Cone index in kPa where there is no ground.
const NO_GROUND_KPA: f64 = 5.0;

/// Longest boom in metres.
const BOOM_MAX_M: f64 = 20.0;

/// Depth in metres over which the profile has the class's mean.
const CRITICAL_DEPTH_M: f64 = 0.15;

impl Penetrometer {
    /// Checks every figure.
    ///
    /// # Errors
    /// [`SimError::Figure`] naming the first figure outside its range.
    pub fn validate(&self) -> Result<(), SimError> {
        let depth = self.depth_m;
        require(
            "depth of a push",
            depth,
            depth > 0.0 && depth <= 5.0,
            "above 0, at most 5 m",
        )?;
        let fits = self.spacing_m >= 0.001 && self.spacing_m <= depth;
        require(
            "distance between samples",
            self.spacing_m,
            fits,
            "1 mm to the depth of a push is allowed",
        )?;
        require(
            "speed of the cone",
            self.speed_mps,
            self.speed_mps > 0.0,
            "it must be above 0 m/s",
        )?;
        require(
            "time to set up",
            self.set_up_s,
            self.set_up_s >= 0.0,
            "it must not be below 0 s",
        )?;
        for given in [self.push_variation, self.sample_variation] {
            require(
                "variation of cone indices",
                given,
                (0.0..=2.0).contains(&given),
                "0 to 2 is allowed",
            )?;
        }
        require(
            "boom of the penetrometer",
            self.boom_m,
            self.boom_m.abs() <= BOOM_MAX_M,
            "at most 20 m either way is allowed",
        )?;
        let fits = self.refusal_kpa > 0.0 && self.refusal_kpa <= crate::sensor::CONE_INDEX_MAX_KPA;
        require(
            "greatest cone index",
            self.refusal_kpa,
            fits,
            "above 0, at most 100 000 kPa",
        )
    }

    /// A reading at a position and the seconds that it takes. `count` numbers the pushes of a run.
    pub fn probe(&self, world: &World, at: Position, noise: Noise, count: u64) -> (PenetrometerReading, f64) {
        let soil = world.soil_at(at);
        let mean_kpa = match soil {
            SoilClass::None => NO_GROUND_KPA,
            class => class
                .rating_cone_index_kpa(world.moisture_percent())
                .map_or(UNKNOWN_KPA, |rating_kpa| rating_kpa / remoulding_index(class)),
        };
        let [push, chance] = noise.normals(Stream::Probe, count, 0);
        let rock_m = (soil == SoilClass::Rock).then(|| (0.01 + 0.01 * chance.abs()).min(0.03));
        let mut reading = PenetrometerReading {
            x_m: at.x_m,
            y_m: at.y_m,
            depths_m: Vec::new(),
            cone_indices_kpa: Vec::new(),
            refusal_depth_m: rock_m,
            sleeve_frictions_kpa: None,
        };
        let mut reached_m = rock_m.unwrap_or(self.depth_m);
        // A depth that falls short of a sample by rounding alone still holds it.
        let samples = ((self.depth_m / self.spacing_m) + 1e-9).floor() as u32;
        for sample in 1..=samples {
            let depth_m = f64::from(sample) * self.spacing_m;
            if depth_m > reached_m + 1e-12 {
                break;
            }
            let drawn = noise.normals(Stream::Probe, count, sample)[0];
            let variation = factor(self.push_variation, push) * factor(self.sample_variation, drawn);
            let cone_index_kpa = mean_kpa * (0.6 + 0.8 * depth_m / CRITICAL_DEPTH_M) * variation;
            if cone_index_kpa > self.refusal_kpa {
                reading.refusal_depth_m = Some(depth_m);
                reached_m = depth_m;
                break;
            }
            reading.depths_m.push(depth_m);
            reading.cone_indices_kpa.push(cone_index_kpa);
        }
        (reading, self.set_up_s + reached_m / self.speed_mps)
    }
}

/// What traffic leaves of the strength of a class, as a share (estimates: the fine-grained ones lose the most; clean sand loses
/// nothing by US Army practice).
fn remoulding_index(class: SoilClass) -> f64 {
    match class {
        SoilClass::Clay => 0.8,
        SoilClass::Silt => 0.7,
        _ => 1.0,
    }
}

/// A log-normal factor of mean 1 and this relative deviation.
fn factor(variation: f64, normal: f64) -> f64 {
    let square = (1.0 + variation * variation).ln();
    (square.sqrt() * normal - square / 2.0).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{GridGeometry, Layer};

    fn world(soil: SoilClass) -> World {
        let geometry = GridGeometry::new(4, 4, 10.0, 0.0, 40.0).unwrap();
        World::new(Layer::filled(geometry, 0.0), Layer::filled(geometry, soil as u8), 25.0).unwrap()
    }

    #[test]
    fn the_mean_of_many_pushes_is_the_strength_of_the_true_class() {
        let tool = Penetrometer {
            depth_m: 0.15,
            refusal_kpa: 100_000.0,
            ..Penetrometer::default()
        };
        for soil in [SoilClass::Clay, SoilClass::Silt, SoilClass::Sand] {
            let world = world(soil);
            let mut all = Vec::new();
            for count in 0..2000 {
                let (reading, _) = tool.probe(&world, Position::new(5.0, 5.0), Noise::new(1), count);
                reading.validate().unwrap();
                all.extend(reading.cone_indices_kpa);
            }
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            // Six samples at 2.5 .. 15 cm: the mean depth is 8.75 cm.
            let expected = soil.rating_cone_index_kpa(25.0).unwrap() * (0.6 + 0.8 * 0.0875 / 0.15);
            let carries = mean * remoulding_index(soil);
            assert!(
                (carries / expected - 1.0).abs() < 0.02,
                "{soil:?}: {carries} {expected}"
            );
        }
    }

    #[test]
    fn the_cone_meets_the_soil_before_the_vehicle_and_says_where() {
        use crate::sensor::Pose;
        use crate::sim::{Motion, Robot, RobotParams};
        let vehicle = crate::vehicle::fixtures::tractor();
        let geometry = GridGeometry::new(40, 40, 1.0, 0.0, 40.0).unwrap();
        // Water to the east of 20 m.
        let soil = |cell: crate::grid::Cell| if cell.column < 20 { SoilClass::Sand } else { SoilClass::None } as u8;
        let codes = Layer::new(geometry, geometry.cells().map(soil).collect(), "soil").unwrap();
        let world = World::new(Layer::filled(geometry, 0.0), codes, 25.0).unwrap();
        let finds = |x_m: f64, boom_m: f64| {
            let params = RobotParams {
                penetrometer: Penetrometer {
                    boom_m,
                    ..Penetrometer::default()
                },
                ..RobotParams::default()
            };
            let motion = Motion {
                steering: crate::sim::Steering::Ackermann,
                max_acceleration_mps2: 1.0,
                max_braking_mps2: 3.0,
                max_turn_rate_radps: 0.6,
            };
            let at = Pose::level(x_m, 20.5, 0.0);
            let (reading, _) = Robot::new(&world, vehicle.clone(), motion, at, params)
                .unwrap()
                .push(&world);
            (reading.x_m, reading.cone_indices_kpa[0] < 50.0)
        };
        let half_m = 0.5 * vehicle.length_m;
        assert_eq!(finds(16.0, 0.5), (16.0 + half_m + 0.5, false));
        assert_eq!(finds(18.0, 0.5), (18.0 + half_m + 0.5, true));
        assert_eq!(finds(18.0, -half_m), (18.0, false));
    }

    #[test]
    fn a_push_takes_the_time_of_its_depth_and_rock_refuses() {
        let tool = Penetrometer::default();
        let (_, seconds) = tool.probe(&world(SoilClass::Clay), Position::new(5.0, 5.0), Noise::new(1), 0);
        approx::assert_relative_eq!(seconds, 15.0, epsilon = 1e-9);
        let (reading, seconds) = tool.probe(&world(SoilClass::Rock), Position::new(5.0, 5.0), Noise::new(1), 0);
        reading.validate().unwrap();
        assert!(reading.refusal_depth_m.unwrap() <= 0.03 && seconds < 6.1);
        let (water, _) = tool.probe(&world(SoilClass::None), Position::new(5.0, 5.0), Noise::new(1), 0);
        assert!(water.cone_indices_kpa.iter().all(|kpa| *kpa < 30.0));
    }
}
