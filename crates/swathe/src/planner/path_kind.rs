//! Which kind of path a route follows.

use crate::grid::{Cell, EIGHT, GridGeometry, Step};
use crate::vehicle::Vehicle;

use super::ground::Ground;
use super::search::StepGraph;

/// Which kind of path a route follows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PathKind {
    /// Steps to 8 neighbours, as they are.
    Grid8,
    /// Steps to 16 neighbours, then shortcuts.
    Grid16,
    /// Straight segments at any angle.
    AnyAngle,
    /// As `Grid16`, then followed by arcs within the vehicle's turning radius.
    Drivable,
    /// `Drivable` for a vehicle that cannot turn in place where its turning radius spans a terrain cell, else `Grid16`.
    #[default]
    Auto,
}

impl PathKind {
    /// Whether the route is followed by arcs.
    pub(super) fn is_driven(self, vehicle: &Vehicle, cell_size_m: f64) -> bool {
        match self {
            Self::Grid8 | Self::Grid16 | Self::AnyAngle => false,
            Self::Drivable => true,
            Self::Auto => vehicle.min_turn_radius_m > 0.0 && vehicle.min_turn_radius_m >= cell_size_m,
        }
    }
}

/// The ground with steps to 8 neighbours only.
pub(super) struct EightNeighbours<'a>(pub(super) &'a Ground<'a>);

impl StepGraph for EightNeighbours<'_> {
    fn geometry(&self) -> GridGeometry {
        self.0.geometry()
    }

    fn steps(&self) -> &[Step] {
        &EIGHT
    }

    /// Every second one of the sixteen steps is one of the eight.
    fn edge_cost(&self, from: Cell, step: usize) -> f64 {
        self.0.edge_cost(from, 2 * step)
    }

    fn bound(&self, cell: Cell) -> f64 {
        self.0.bound(cell)
    }

    fn scale(&self) -> Option<f64> {
        self.0.scale()
    }

    fn least_step(&self, from: Cell, to: Cell, step: usize) -> f64 {
        self.0.least_step(from, to, 2 * step)
    }

    fn surroundings(&self, from: Cell) -> u32 {
        self.0.surroundings(from)
    }

    fn edge_cost_seen(&self, from: Cell, step: usize, surroundings: u32) -> f64 {
        self.0.edge_cost_seen(from, 2 * step, surroundings)
    }
}
