//! The vehicle: its size, limits and power, and the soil strength it needs.
//!
//! Sources: mobility index and vehicle cone index after FM 5-430-00-1 (as restated by Wong et al. 2020), the deflection
//! factor after Priddy and Willoughby 2006; the rule for small vehicles is a Maclaurin-type limiting cone index.

use thiserror::Error;

/// Kilopascals per pound per square inch.
pub const KPA_PER_PSI: f64 = 6.894_757;

/// Standard gravity in m/s².
pub const GRAVITY_MPS2: f64 = 9.806_65;

/// Below this mass the mobility index is far outside what it was calibrated on, and the small-vehicle rule holds.
const SMALL_VEHICLE_KG: f64 = 500.0;

/// Wheels of a vehicle, all of them driven.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wheels {
    /// Number of wheels.
    pub count: u32,
    /// Outer diameter in metres.
    pub diameter_m: f64,
    /// Width in metres.
    pub width_m: f64,
    /// Height of the tyre's section in metres.
    pub section_height_m: f64,
    /// Deflection on hard ground in metres.
    pub deflection_m: f64,
    /// Whether chains are fitted.
    pub chains: bool,
}

/// Tracks of a vehicle (two of them).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracks {
    /// Length of track on the ground in metres.
    pub contact_length_m: f64,
    /// Width of one track in metres.
    pub width_m: f64,
    /// Whether grousers are higher than 1.5 inches (38 mm).
    pub grousers: bool,
    /// Number of road wheels in contact, both sides together.
    pub road_wheels: u32,
    /// Area of one track shoe in square metres.
    pub shoe_area_m2: f64,
}

/// What the vehicle stands on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RunningGear {
    /// Wheels.
    Wheels(Wheels),
    /// Tracks.
    Tracks(Tracks),
}

/// Everything the planner asks about a vehicle. Grades and slopes are rise over run.
#[derive(Clone, Debug, PartialEq)]
pub struct Vehicle {
    /// Length in metres.
    pub length_m: f64,
    /// Width in metres.
    pub width_m: f64,
    /// Free height under the body in metres.
    pub ground_clearance_m: f64,
    /// Mass in kilograms, payload included.
    pub mass_kg: f64,
    /// Greatest speed in m/s.
    pub max_speed_mps: f64,
    /// Least turning radius in metres; 0 turns in place.
    pub min_turn_radius_m: f64,
    /// Reaction time before braking, in seconds.
    pub reaction_time_s: f64,
    /// How far ahead obstacles are seen, in metres.
    pub sight_distance_m: f64,
    /// Steepest grade driven up.
    pub grade_up: f64,
    /// Steepest grade driven down.
    pub grade_down: f64,
    /// Steepest side slope.
    pub side_slope: f64,
    /// Highest step climbed, in metres.
    pub step_height_m: f64,
    /// Power in watts.
    pub power_w: f64,
    /// Share of the power that reaches the ground.
    pub drive_efficiency: f64,
    /// Power drawn at rest, in watts.
    pub idle_power_w: f64,
    /// Friction while braking.
    pub braking_friction: f64,
    /// Friction of driven wheels or tracks on firm ground.
    pub traction_friction: f64,
    /// Whether gears are changed by hand.
    pub manual_transmission: bool,
    /// What it stands on.
    pub running_gear: RunningGear,
    /// A measured vehicle cone index in kPa that replaces the formula.
    pub measured_cone_index_kpa: Option<f64>,
    /// Distance between the centre lines of left and right wheels or tracks, in metres.
    pub gauge_m: Option<f64>,
    /// Height of the centre of gravity above the ground in metres.
    pub centre_of_gravity_m: Option<f64>,
}

/// What can be wrong with a vehicle.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum VehicleError {
    /// A figure is outside its range.
    #[error("The vehicle's {name} of {given} is not usable: {allowed}.")]
    Figure {
        /// The figure.
        name: &'static str,
        /// The value given.
        given: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

/// How a vehicle turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Steering {
    /// Two driven wheels and a caster; turns in place.
    Differential,
    /// Driven wheels or tracks that do not steer; turns in place and slips in every turn.
    Skid,
    /// Steered wheels; never tighter than the least turning radius.
    Ackermann,
}

/// How a vehicle changes its motion: the figures of a vehicle file that only driving needs, for the navigator and for the
/// simulated body alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// How it turns.
    pub steering: Steering,
    /// Greatest acceleration in m/s².
    pub max_acceleration_mps2: f64,
    /// Greatest braking in m/s².
    pub max_braking_mps2: f64,
    /// Greatest turn rate in rad/s.
    pub max_turn_rate_radps: f64,
}

impl Motion {
    /// Checks every figure.
    ///
    /// # Errors
    /// [`VehicleError::Figure`] naming the first that is not above 0.
    pub fn validate(&self) -> Result<(), VehicleError> {
        let figures = [
            ("greatest acceleration in m/s²", self.max_acceleration_mps2),
            ("greatest braking in m/s²", self.max_braking_mps2),
            ("greatest turn rate in rad/s", self.max_turn_rate_radps),
        ];
        for (name, given) in figures {
            if !(given > 0.0 && given.is_finite()) {
                let allowed = "it must be above 0 and finite";
                return Err(VehicleError::Figure { name, given, allowed });
            }
        }
        Ok(())
    }
}

/// Soil strength that a vehicle needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConeIndex {
    /// For one pass, in kPa.
    pub one_pass_kpa: f64,
    /// For fifty passes, in kPa.
    pub fifty_passes_kpa: f64,
    /// Whether the formula was used outside what it was calibrated on.
    pub extrapolated: bool,
}

impl Vehicle {
    /// Checks every figure.
    ///
    /// # Errors
    /// [`VehicleError::Figure`] naming the first figure outside its range.
    pub fn validate(&self) -> Result<(), VehicleError> {
        let positive = [
            ("length in metres", self.length_m),
            ("width in metres", self.width_m),
            ("mass in kilograms", self.mass_kg),
            ("greatest speed in m/s", self.max_speed_mps),
            ("sight distance in metres", self.sight_distance_m),
            ("grade up", self.grade_up),
            ("grade down", self.grade_down),
            ("side slope", self.side_slope),
            ("power in watts", self.power_w),
            ("drive efficiency", self.drive_efficiency),
            ("braking friction", self.braking_friction),
            ("traction friction", self.traction_friction),
            ("gauge in metres", self.gauge_m.unwrap_or(1.0)),
            (
                "height of the centre of gravity in metres",
                self.centre_of_gravity_m.unwrap_or(1.0),
            ),
        ];
        for (name, given) in positive {
            if !(given.is_finite() && given > 0.0) {
                let allowed = "it must be finite and above 0";
                return Err(VehicleError::Figure { name, given, allowed });
            }
        }
        let not_negative = [
            ("ground clearance in metres", self.ground_clearance_m),
            ("least turning radius in metres", self.min_turn_radius_m),
            ("reaction time in seconds", self.reaction_time_s),
            ("step height in metres", self.step_height_m),
            ("idle power in watts", self.idle_power_w),
            ("cone index in kPa", self.measured_cone_index_kpa.unwrap_or(0.0)),
        ];
        for (name, given) in not_negative {
            if !(given.is_finite() && given >= 0.0) {
                let allowed = "it must be finite and not below 0";
                return Err(VehicleError::Figure { name, given, allowed });
            }
        }
        Ok(())
    }

    /// Radius of the circle around the footprint, in metres.
    pub fn circumscribed_radius_m(&self) -> f64 {
        self.length_m.hypot(self.width_m) / 2.0
    }

    /// The side slope on which the vehicle would tip over when it stands still: half its gauge over the height of its centre
    /// of gravity (the static stability factor). `None` unless both are known.
    pub fn rollover_slope(&self) -> Option<f64> {
        Some(self.gauge_m? / (2.0 * self.centre_of_gravity_m?))
    }

    /// The side slope that is never exceeded: the limit, or less where the vehicle would tip over before.
    pub fn max_side_slope(&self) -> f64 {
        self.side_slope.min(self.rollover_slope().unwrap_or(f64::INFINITY))
    }

    /// The steeper of the two grade limits.
    pub fn max_grade(&self) -> f64 {
        self.grade_up.max(self.grade_down)
    }

    /// Vehicle cone index: measured, by the small-vehicle rule, or by the mobility index.
    pub fn cone_index(&self) -> ConeIndex {
        if let Some(one_pass_kpa) = self.measured_cone_index_kpa {
            return ConeIndex {
                one_pass_kpa,
                fifty_passes_kpa: SMALL_FIFTY_RATIO * one_pass_kpa,
                extrapolated: false,
            };
        }
        if self.mass_kg < SMALL_VEHICLE_KG {
            return small_cone_index(self);
        }
        let index = mobility_index(self);
        let (one_pass, fifty) = match self.running_gear {
            RunningGear::Wheels(wheels) => {
                let deflection = (wheels.deflection_m / wheels.section_height_m).max(0.01);
                let factor = (0.15 / deflection).powf(0.25);
                let one_pass = if index <= 115.0 {
                    11.48 + 0.2 * index - 39.2 / (index + 3.74)
                } else {
                    4.1 * index.powf(0.446)
                };
                (one_pass * factor, 28.23 + 0.43 * index - 92.67 / (index + 3.67))
            }
            RunningGear::Tracks(_) => (
                7.0 + 0.2 * index - 39.2 / (index + 5.6),
                19.27 + 0.43 * index - 125.79 / (index + 7.08),
            ),
        };
        let one_pass_kpa = one_pass.max(1.0) * KPA_PER_PSI;
        ConeIndex {
            one_pass_kpa,
            fifty_passes_kpa: (fifty * KPA_PER_PSI).max(1.05 * one_pass_kpa),
            extrapolated: false,
        }
    }
}

/// Ratio of the strengths for fifty passes and one where no formula applies (estimate).
const SMALL_FIFTY_RATIO: f64 = 1.8;

/// 1.85 W / (b^0.8 d^0.8 δ^0.4) in kPa, with the load W on one wheel in kN and lengths in metres, at least 10 kPa.
/// A track counts as a wheel whose contact is the track's length.
fn small_cone_index(vehicle: &Vehicle) -> ConeIndex {
    let weight_kn = vehicle.mass_kg * GRAVITY_MPS2 / 1000.0;
    let (load_kn, width_m, diameter_m, deflection_m) = match vehicle.running_gear {
        RunningGear::Wheels(w) => (weight_kn / f64::from(w.count), w.width_m, w.diameter_m, w.deflection_m),
        RunningGear::Tracks(t) => (weight_kn / 2.0, t.width_m, t.contact_length_m, t.contact_length_m),
    };
    let divisor = width_m.powf(0.8) * diameter_m.powf(0.8) * deflection_m.max(0.005).powf(0.4);
    let one_pass_kpa = (1.85 * load_kn / divisor).max(10.0);
    ConeIndex {
        one_pass_kpa,
        fifty_passes_kpa: SMALL_FIFTY_RATIO * one_pass_kpa,
        extrapolated: true,
    }
}

/// The mobility index in the units it was published in: pounds, inches, psi.
pub fn mobility_index(vehicle: &Vehicle) -> f64 {
    const POUNDS_PER_KG: f64 = 2.204_623;
    const INCHES_PER_M: f64 = 39.370_08;
    let weight_lb = vehicle.mass_kg * POUNDS_PER_KG;
    let clearance_factor = vehicle.ground_clearance_m * INCHES_PER_M / 10.0;
    let horsepower_per_ton = vehicle.power_w / 745.7 / (weight_lb / 2000.0);
    let engine = if horsepower_per_ton >= 10.0 { 1.0 } else { 1.05 };
    let transmission = if vehicle.manual_transmission { 1.05 } else { 1.0 };
    let index = match vehicle.running_gear {
        RunningGear::Wheels(wheels) => {
            let count = f64::from(wheels.count);
            let (width_in, diameter_in) = (wheels.width_m * INCHES_PER_M, wheels.diameter_m * INCHES_PER_M);
            let contact_psi = weight_lb / (count * width_in * diameter_in / 2.0);
            let axle_kips = weight_lb / 1000.0 / (count / 2.0);
            let weight = match axle_kips {
                x if x < 2.0 => 0.553 * x,
                x if x < 13.5 => 0.033 * x + 1.05,
                x if x < 20.0 => 0.142 * x - 0.42,
                x => 0.278 * x - 3.115,
            };
            let tyre = (10.0 + width_in) / 100.0;
            let grouser = if wheels.chains { 1.05 } else { 1.0 };
            let load = weight_lb / 1000.0 / count;
            contact_psi * weight / (tyre * grouser) + load - clearance_factor
        }
        RunningGear::Tracks(tracks) => {
            let width_in = tracks.width_m * INCHES_PER_M;
            let contact_in2 = 2.0 * tracks.contact_length_m * INCHES_PER_M * width_in;
            let weight = match weight_lb {
                w if w < 50_000.0 => 1.0,
                w if w < 70_000.0 => 1.2,
                w if w < 100_000.0 => 1.4,
                _ => 1.8,
            };
            let grouser = if tracks.grousers { 1.1 } else { 1.0 };
            let shoe_in2 = tracks.shoe_area_m2 * INCHES_PER_M * INCHES_PER_M;
            let bogie = weight_lb / 10.0 / (f64::from(tracks.road_wheels) * shoe_in2);
            weight_lb / contact_in2 * weight / (width_in / 100.0 * grouser) + bogie - clearance_factor
        }
    };
    (index * engine * transmission).max(0.0)
}

/// Vehicles for tests of every module.
#[cfg(test)]
pub(crate) mod fixtures {
    use super::{RunningGear, Vehicle, Wheels};

    /// A Pioneer-like small robot: 25 % up, 30 % down, 20 % side slope.
    pub(crate) fn pioneer() -> Vehicle {
        Vehicle {
            length_m: 0.51,
            width_m: 0.5,
            ground_clearance_m: 0.08,
            mass_kg: 20.0,
            max_speed_mps: 0.7,
            min_turn_radius_m: 0.0,
            reaction_time_s: 0.3,
            sight_distance_m: 8.0,
            grade_up: 0.25,
            grade_down: 0.30,
            side_slope: 0.20,
            step_height_m: 0.1,
            power_w: 120.0,
            drive_efficiency: 0.6,
            idle_power_w: 15.0,
            braking_friction: 0.5,
            traction_friction: 0.7,
            manual_transmission: false,
            running_gear: RunningGear::Wheels(Wheels {
                count: 4,
                diameter_m: 0.215,
                width_m: 0.09,
                section_height_m: 0.05,
                deflection_m: 0.01,
                chains: false,
            }),
            measured_cone_index_kpa: None,
            gauge_m: None,
            centre_of_gravity_m: None,
        }
    }

    /// A farm tractor of five tonnes.
    pub(crate) fn tractor() -> Vehicle {
        Vehicle {
            length_m: 4.4,
            width_m: 2.2,
            mass_kg: 5000.0,
            max_speed_mps: 8.0,
            min_turn_radius_m: 4.8,
            sight_distance_m: 40.0,
            grade_up: 0.30,
            grade_down: 0.30,
            power_w: 75_000.0,
            ground_clearance_m: 0.45,
            running_gear: RunningGear::Wheels(Wheels {
                count: 4,
                diameter_m: 1.5,
                width_m: 0.45,
                section_height_m: 0.3,
                deflection_m: 0.06,
                chains: false,
            }),
            ..pioneer()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    #[test]
    fn small_vehicles_follow_their_own_rule() {
        // A wheel of 67 N with 1 cm of deflection needs 34 kPa (Pioneer 2-DX: 0.165 m x 0.037 m tyres).
        let mut robot = fixtures::pioneer();
        robot.mass_kg = 4.0 * 67.0 / GRAVITY_MPS2;
        let RunningGear::Wheels(ref mut wheels) = robot.running_gear else {
            unreachable!("the fixture has wheels")
        };
        wheels.diameter_m = 0.165;
        wheels.width_m = 0.037;
        let index = robot.cone_index();
        let expected = 1.85 * 0.067 / (0.165f64.powf(0.8) * 0.037f64.powf(0.8) * 0.01f64.powf(0.4));
        assert_relative_eq!(index.one_pass_kpa, expected, epsilon = 1e-9);
        assert!(index.extrapolated);
    }

    #[test]
    fn large_vehicles_need_stronger_soil_and_more_passes_need_more() {
        let tractor = fixtures::tractor().cone_index();
        let psi = tractor.one_pass_kpa / KPA_PER_PSI;
        assert!((10.0..40.0).contains(&psi), "{psi}");
        assert!(tractor.fifty_passes_kpa > tractor.one_pass_kpa && !tractor.extrapolated);
    }

    proptest! {
        #[test]
        fn a_heavier_vehicle_never_needs_weaker_soil(mass in 600.0f64..20_000.0) {
            let mut light = fixtures::tractor();
            light.mass_kg = mass;
            let mut heavy = light.clone();
            heavy.mass_kg = mass * 1.2;
            prop_assert!(heavy.cone_index().one_pass_kpa >= light.cone_index().one_pass_kpa);
        }
    }

    #[test]
    fn a_figure_outside_its_range_is_named() {
        let mut vehicle = fixtures::pioneer();
        vehicle.grade_up = f64::NAN;
        assert!(vehicle.validate().unwrap_err().to_string().contains("grade up"));
        assert_eq!(fixtures::tractor().validate(), Ok(()));
    }
}
