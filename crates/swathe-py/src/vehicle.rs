//! The vehicle.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::soil::{SoilClass, Trafficability};
use swathe::vehicle::{RunningGear, Tracks, Wheels};

use crate::convert::entry;
use crate::error::CoreError;

/// A vehicle as the core sees it; made from the flat figures of `swathe.vehicle.Vehicle`.
#[pyclass(frozen, module = "swathe._core")]
pub(crate) struct Vehicle {
    pub(crate) inner: swathe::vehicle::Vehicle,
}

#[pymethods]
impl Vehicle {
    #[new]
    fn new(figures: &Bound<'_, PyDict>) -> PyResult<Self> {
        let number = |name: &str| entry::<f64>(figures, name);
        let running_gear = if entry::<String>(figures, "running_gear")? == "tracks" {
            RunningGear::Tracks(Tracks {
                contact_length_m: number("track_contact_length_m")?,
                width_m: number("track_width_m")?,
                grousers: entry(figures, "track_grousers")?,
                road_wheels: entry(figures, "track_road_wheels")?,
                shoe_area_m2: number("track_shoe_area_m2")?,
            })
        } else {
            RunningGear::Wheels(Wheels {
                count: entry(figures, "wheel_count")?,
                diameter_m: number("wheel_diameter_m")?,
                width_m: number("wheel_width_m")?,
                section_height_m: number("wheel_section_height_m")?,
                deflection_m: number("wheel_deflection_m")?,
                chains: entry(figures, "wheel_chains")?,
            })
        };
        let inner = swathe::vehicle::Vehicle {
            length_m: number("length_m")?,
            width_m: number("width_m")?,
            ground_clearance_m: number("ground_clearance_m")?,
            mass_kg: number("mass_kg")?,
            max_speed_mps: number("max_speed_mps")?,
            min_turn_radius_m: number("min_turn_radius_m")?,
            reaction_time_s: number("reaction_time_s")?,
            sight_distance_m: number("sight_distance_m")?,
            grade_up: number("grade_up")?,
            grade_down: number("grade_down")?,
            side_slope: number("side_slope")?,
            step_height_m: number("step_height_m")?,
            power_w: number("power_w")?,
            drive_efficiency: number("drive_efficiency")?,
            idle_power_w: number("idle_power_w")?,
            braking_friction: number("braking_friction")?,
            traction_friction: number("traction_friction")?,
            manual_transmission: entry(figures, "manual_transmission")?,
            running_gear,
            measured_cone_index_kpa: entry(figures, "vehicle_cone_index_kpa")?,
            gauge_m: entry(figures, "gauge_m")?,
            centre_of_gravity_m: entry(figures, "centre_of_gravity_m")?,
        };
        inner.validate().map_err(CoreError::from)?;
        Ok(Self { inner })
    }

    /// (one pass kPa, fifty passes kPa, extrapolated).
    fn cone_index(&self) -> (f64, f64, bool) {
        let index = self.inner.cone_index();
        (index.one_pass_kpa, index.fifty_passes_kpa, index.extrapolated)
    }

    /// The side slope on which it tips over at rest, or None when gauge or centre of gravity are not known.
    fn rollover_slope(&self) -> Option<f64> {
        self.inner.rollover_slope()
    }

    /// (go, steepest grade by traction, rolling resistance, speed m/s) on a soil class.
    fn on_soil(&self, code: u8, moisture_percent: f64) -> PyResult<(bool, f64, f64, f64)> {
        let class = SoilClass::from_code(code).map_err(CoreError::from)?;
        let moisture = swathe::soil::check_moisture(moisture_percent).map_err(CoreError::from)?;
        let fares = Trafficability::of(&self.inner, class, moisture);
        Ok((fares.go, fares.drawbar_grade, fares.rolling_resistance, fares.speed_mps))
    }
}
