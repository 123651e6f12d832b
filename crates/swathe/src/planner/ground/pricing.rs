//! What a piece of a way costs under an objective, and what none can cost less than.

use crate::grid::{Cell, LayerView};
use crate::soil::Trafficability;
use crate::vehicle::{GRAVITY_MPS2, Vehicle};

use super::Objective;

/// An objective, the user's factor and the exposure of cells, with the bounds that follow.
pub(super) struct Pricing<'a> {
    pub(super) objective: Objective,
    pub(super) exposure: Option<Box<dyn Fn(Cell) -> f64 + 'a>>,
    factor: Option<LayerView<'a, f32>>,
    /// Whether cost is time and nothing else.
    plain: bool,
    per_joule: f64,
    /// Least cost of a metre of level distance, climbing left out.
    pub(super) flat_per_m: f64,
    /// Least cost of a metre of height that is climbed.
    pull_per_m: f64,
    least_resistance: f64,
}

impl<'a> Pricing<'a> {
    pub(super) fn new(vehicle: &Vehicle, soils: &[Trafficability], objective: Objective) -> Self {
        let per_joule = objective.energy / vehicle.power_w;
        let resistances = soils.iter().map(|soil| soil.rolling_resistance);
        Self {
            objective,
            exposure: None,
            factor: None,
            plain: objective.time == 1.0 && objective.energy == 0.0 && objective.risk == 0.0,
            per_joule,
            flat_per_m: (objective.time + per_joule * vehicle.idle_power_w) / vehicle.max_speed_mps,
            pull_per_m: per_joule * vehicle.mass_kg * GRAVITY_MPS2 / vehicle.drive_efficiency,
            least_resistance: resistances.fold(f64::INFINITY, f64::min),
        }
    }

    /// Takes the user's factor, of which no open cell has less than `least`.
    pub(super) fn multiply(&mut self, factor: LayerView<'a, f32>, least: f64) {
        self.factor = Some(factor);
        self.plain = false;
        self.flat_per_m *= least;
        self.pull_per_m *= least;
    }

    pub(super) fn is_plain(&self) -> bool {
        self.plain
    }

    pub(super) fn has_factor(&self) -> bool {
        self.factor.is_some()
    }

    pub(super) fn counts_energy(&self) -> bool {
        self.pull_per_m > 0.0
    }

    pub(super) fn exposure_at(&self, cell: Cell) -> f64 {
        self.exposure.as_ref().map_or(0.0, |exposure| exposure(cell))
    }

    /// Cost of a piece in a cell. Energy and exposure are asked for only where they count.
    pub(super) fn cost(
        &self,
        cell: Cell,
        time_s: f64,
        energy_j: impl FnOnce() -> f64,
        exposure: impl FnOnce() -> f64,
    ) -> f64 {
        if self.plain {
            return time_s;
        }
        let mut cost = self.objective.time * time_s;
        if self.per_joule > 0.0 {
            cost += self.per_joule * energy_j();
        }
        if self.objective.risk > 0.0 {
            cost += self.objective.risk * time_s * exposure();
        }
        self.factor.map_or(cost, |factor| f64::from(factor[cell]) * cost)
    }

    /// Nothing that covers this level distance and rise can cost less.
    ///
    /// The driving force over a piece does work m g (C · run + rise), so the work of a whole way is at least m g (C run +
    /// rise) with the least C, and at least 0: nothing is won back downhill. Consistent, because run and rise add up.
    pub(super) fn least(&self, run_m: f64, rise_m: f64) -> f64 {
        self.flat_per_m * run_m + self.climb(run_m, rise_m)
    }

    /// The part of it that is work against rolling resistance and height.
    pub(super) fn climb(&self, run_m: f64, rise_m: f64) -> f64 {
        if !self.counts_energy() {
            return 0.0;
        }
        // An unknown height leaves the work out.
        self.pull_per_m * (self.least_resistance * run_m + rise_m).max(0.0)
    }
}
