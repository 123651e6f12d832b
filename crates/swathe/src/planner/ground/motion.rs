//! Force, speed and energy of the vehicle on a soil and grade: the physics that every cost stands on.
//!
//! Driving force F = m g (C cos α + sin α) for a rolling resistance C and a grade tan α, so that over a piece F · length =
//! m g (C · run + rise). Speed is the least of what the soil, power over force and braking within sight allow. Downhill
//! nothing is won back.

use crate::soil::Trafficability;
use crate::vehicle::{GRAVITY_MPS2, Vehicle};

use super::Objective;

/// Greatest speed on a soil and grade, or `None` where the brakes cannot hold the vehicle.
pub(super) fn speed_mps(vehicle: &Vehicle, soil: &Trafficability, grade: f64) -> Option<f64> {
    let cos = 1.0 / (1.0 + grade * grade).sqrt();
    let speed_mps = soil.powered_speed_mps(vehicle, grade);
    // v² / a + v t = d with twice the deceleration a.
    let doubled_mps2 = 2.0 * GRAVITY_MPS2 * cos * (vehicle.braking_friction + grade);
    if doubled_mps2 <= 0.0 {
        return None;
    }
    let t = vehicle.reaction_time_s;
    let stopping = (t * t + 4.0 * vehicle.sight_distance_m / doubled_mps2).sqrt() - t;
    Some(speed_mps.min(stopping * doubled_mps2 / 2.0))
}

/// Grades between which [`speed_mps`] is the soil's speed, to the last bit: neither power nor braking comes near to it.
/// A low end above the high one means none.
pub(super) fn steady_grades(vehicle: &Vehicle, soil: &Trafficability) -> [f64; 2] {
    /// What counts as near.
    const ROOM: f64 = 1e-6;
    /// Beyond 45 degrees nothing is promised.
    const STEEPEST: f64 = 1.0;
    let none = [f64::INFINITY, f64::NEG_INFINITY];
    let left_m = vehicle.sight_distance_m - soil.speed_mps * vehicle.reaction_time_s;
    if soil.speed_mps <= 0.0 || left_m <= 0.0 {
        return none;
    }
    // Cosines are at most 1 where they make the force greater, and at least this where they make braking weaker.
    let cos = 1.0 / (1.0 + STEEPEST * STEEPEST).sqrt();
    let weight_n = vehicle.mass_kg * GRAVITY_MPS2;
    let pulled = vehicle.drive_efficiency * vehicle.power_w / (weight_n * soil.speed_mps);
    let held = soil.speed_mps * soil.speed_mps / left_m / (2.0 * GRAVITY_MPS2 * cos);
    let low = held - vehicle.braking_friction + ROOM;
    let high = pulled - soil.rolling_resistance - ROOM;
    let (low, high) = (low.max(-STEEPEST), high.min(STEEPEST));
    if low <= high { [low, high] } else { none }
}

/// Driving force in newtons on a soil and grade; negative where the vehicle must brake.
pub(super) fn force_n(vehicle: &Vehicle, soil: &Trafficability, grade: f64) -> f64 {
    let cos = 1.0 / (1.0 + grade * grade).sqrt();
    let weight_n = vehicle.mass_kg * GRAVITY_MPS2;
    weight_n * cos * (soil.rolling_resistance + grade)
}

/// Energy in joules of a stretch of this length and time.
pub(super) fn energy_j(vehicle: &Vehicle, soil: &Trafficability, grade: f64, length_m: f64, time_s: f64) -> f64 {
    force_n(vehicle, soil, grade).max(0.0) * length_m / vehicle.drive_efficiency + vehicle.idle_power_w * time_s
}

/// Cost of a metre along the surface on a soil and grade far from no-go ground; `None` where the brakes do not hold.
pub(in crate::planner) fn cost_per_m(
    vehicle: &Vehicle,
    soil: &Trafficability,
    grade: f64,
    objective: &Objective,
) -> Option<f64> {
    let time_s = 1.0 / speed_mps(vehicle, soil, grade)?;
    let energy_s = energy_j(vehicle, soil, grade, 1.0, time_s) / vehicle.power_w;
    Some(objective.time * time_s + objective.energy * energy_s)
}
