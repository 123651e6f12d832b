//! The one map from the core's errors to Python's.

use pyo3::prelude::*;
use swathe::belief::BeliefError;
use swathe::corridor::CorridorError;
use swathe::drive::DriveError;
use swathe::grid::GridError;
use swathe::nest::NestError;
use swathe::planner::PlannerError;
use swathe::rank::{RankError, SourceFault};
use swathe::sensor::ReadingError;
use swathe::sim::SimError;
use swathe::soil::SoilError;
use swathe::swarm::SwarmError;
use swathe::terrain::TerrainError;
use swathe::vehicle::VehicleError;

mod python {
    pyo3::import_exception!(swathe.errors, AllVoidError);
    pyo3::import_exception!(swathe.errors, InterruptedBySignalError);
    pyo3::import_exception!(swathe.errors, InvalidParameterError);
    pyo3::import_exception!(swathe.errors, InvalidVehicleError);
    pyo3::import_exception!(swathe.errors, OutsideGridError);
    pyo3::import_exception!(swathe.errors, ShapeMismatchError);
    pyo3::import_exception!(swathe.errors, UnreadableFileError);
    pyo3::import_exception!(swathe.errors, TooLargeError);
}

/// Any error of the core.
#[derive(Debug)]
pub(crate) enum CoreError {
    Grid(GridError),
    Terrain(TerrainError),
    Soil(SoilError),
    Belief(BeliefError),
    Vehicle(VehicleError),
    Rank(RankError),
    Corridor(CorridorError),
    Drive(DriveError),
    Nest(NestError),
    Swarm(SwarmError),
    Planner(PlannerError),
    Sim(SimError),
}

macro_rules! from {
    ($($variant:ident($error:ty)),*) => {
        $(impl From<$error> for CoreError {
            fn from(error: $error) -> Self {
                Self::$variant(error)
            }
        })*
    };
}
from!(
    Grid(GridError),
    Terrain(TerrainError),
    Soil(SoilError),
    Belief(BeliefError),
    Vehicle(VehicleError),
    Rank(RankError),
    Corridor(CorridorError),
    Drive(DriveError),
    Nest(NestError),
    Swarm(SwarmError),
    Planner(PlannerError),
    Sim(SimError)
);

/// Which Python class stands for an error, and what the user should do about it.
enum Class {
    Parameter(&'static str),
    Shape,
    Outside,
    Vehicle,
    AllVoid,
    Unread,
    TooLarge,
    Stopped,
}

impl CoreError {
    fn class(&self) -> Class {
        match self {
            Self::Grid(error)
            | Self::Terrain(TerrainError::Grid(error))
            | Self::Rank(RankError::Grid(error))
            | Self::Nest(NestError::Grid(error))
            | Self::Swarm(SwarmError::Grid(error) | SwarmError::Nest(NestError::Grid(error)))
            | Self::Sim(SimError::Grid(error))
            | Self::Planner(
                PlannerError::Grid(error)
                | PlannerError::Rank(RankError::Grid(error))
                | PlannerError::Nest(NestError::Grid(error))
                | PlannerError::Swarm(SwarmError::Grid(error) | SwarmError::Nest(NestError::Grid(error))),
            ) => of_grid(error),
            Self::Belief(error) | Self::Drive(DriveError::Belief(error)) => of_belief(error),
            Self::Terrain(TerrainError::AllVoid) => Class::AllVoid,
            Self::Terrain(TerrainError::HeightRange { .. }) => Class::Parameter("Give low,high in metres."),
            Self::Soil(error)
            | Self::Rank(RankError::Soil(error))
            | Self::Sim(SimError::Soil(error))
            | Self::Planner(PlannerError::Rank(RankError::Soil(error))) => of_soil(error),
            Self::Vehicle(VehicleError::Figure { .. })
            | Self::Drive(DriveError::Vehicle(_))
            | Self::Sim(SimError::Vehicle(VehicleError::Figure { .. }))
            | Self::Rank(RankError::Vehicle(VehicleError::Figure { .. }))
            | Self::Planner(PlannerError::Rank(RankError::Vehicle(VehicleError::Figure { .. }))) => Class::Vehicle,
            Self::Rank(error) | Self::Drive(DriveError::Rank(error)) | Self::Planner(PlannerError::Rank(error)) => {
                of_rank(error)
            }
            Self::Drive(DriveError::NoKnowledge) => Class::Parameter("Make the region with swathe.drive.Region.of."),
            Self::Drive(DriveError::Figure { .. })
            | Self::Corridor(CorridorError::Length { .. })
            | Self::Sim(SimError::Figure { .. })
            | Self::Swarm(SwarmError::Parameter { .. })
            | Self::Planner(
                PlannerError::Corridor(CorridorError::Length { .. })
                | PlannerError::Swarm(SwarmError::Parameter { .. })
                | PlannerError::Drivable { .. },
            ) => Class::Parameter("Leave it out for the usual value."),
            Self::Nest(error)
            | Self::Drive(DriveError::Nest(error))
            | Self::Swarm(SwarmError::Nest(error))
            | Self::Planner(PlannerError::Nest(error) | PlannerError::Swarm(SwarmError::Nest(error))) => of_nest(error),
            Self::Planner(PlannerError::NegativeCost { .. } | PlannerError::NegativeFactor { .. }) => {
                Class::Parameter("Mark closed cells with NaN or infinity instead.")
            }
            Self::Planner(PlannerError::Neighbours { .. }) => Class::Parameter("Give 8 or 16."),
            Self::Planner(PlannerError::Weight { .. }) => Class::Parameter("Give 1 to 1000."),
            Self::Planner(PlannerError::Objective { .. }) => {
                Class::Parameter("Give time, energy, risk or weights such as time=1,energy=0.5.")
            }
            Self::Planner(PlannerError::NotAPlace { .. }) => Class::Parameter("Give two finite numbers."),
            Self::Planner(PlannerError::Memory { .. }) => Class::TooLarge,
            Self::Planner(PlannerError::Stopped) => Class::Stopped,
            Self::Swarm(SwarmError::Source(fault))
            | Self::Planner(PlannerError::Source(fault) | PlannerError::Swarm(SwarmError::Source(fault))) => {
                match fault {
                    SourceFault::Unreadable { .. } => Class::Unread,
                    SourceFault::Stopped => Class::Stopped,
                }
            }
        }
    }

    fn message(&self) -> String {
        match self {
            Self::Grid(error) => error.to_string(),
            Self::Terrain(error) => error.to_string(),
            Self::Soil(error) => error.to_string(),
            Self::Belief(error) => error.to_string(),
            Self::Vehicle(error) => error.to_string(),
            Self::Rank(error) => error.to_string(),
            Self::Corridor(error) => error.to_string(),
            Self::Drive(error) => error.to_string(),
            Self::Nest(error) => error.to_string(),
            Self::Swarm(error) => error.to_string(),
            Self::Planner(error) => error.to_string(),
            Self::Sim(error) => error.to_string(),
        }
    }
}

fn of_grid(error: &GridError) -> Class {
    match error {
        GridError::Empty { .. } => Class::Parameter("Give at least one row and one column."),
        GridError::TooManyCells { .. } => Class::Parameter("Choose a window or coarser cells."),
        GridError::NotALength { .. } => Class::Parameter("Give it in metres."),
        GridError::TileSide { .. } => Class::Parameter("Give a power of two up to 32768, and a place inside a tile."),
        GridError::ShapeMismatch { .. } => Class::Shape,
        GridError::OutsideGrid { .. } => Class::Outside,
    }
}

fn of_soil(error: &SoilError) -> Class {
    match error {
        SoilError::UnknownCode { .. } => Class::Parameter("Use the codes of swathe.soil.SoilClass."),
        SoilError::Moisture { .. } => Class::Parameter("Give dry, normal, wet or a number of per cent."),
    }
}

fn of_belief(error: &BeliefError) -> Class {
    match error {
        BeliefError::Grid(error) => of_grid(error),
        BeliefError::Soil(error) => of_soil(error),
        BeliefError::Reading(_) => Class::Parameter("Leave the reading out, or correct it."),
        BeliefError::Parameter { .. } => Class::Parameter("Leave it out for the usual value."),
        BeliefError::Type { .. } => Class::Parameter("Correct the figure in the table of soil types."),
        BeliefError::Mixture { .. } => Class::Parameter("Give one share from 0 to 1 for each class."),
        BeliefError::Unit { .. } => Class::Parameter("Give every polygon a number of its own, above 0."),
        BeliefError::OutsideMap { .. } => Class::Outside,
        BeliefError::NoClass => Class::Parameter("Give gravel, sand, clay, silt, rock or none."),
        BeliefError::NoReading { .. } => Class::Parameter("Give a number that adding a reading returned."),
    }
}

fn of_rank(error: &RankError) -> Class {
    match error {
        RankError::Grid(error) => of_grid(error),
        RankError::Soil(error) => of_soil(error),
        RankError::Vehicle(VehicleError::Figure { .. }) => Class::Vehicle,
        RankError::Rank { .. } => Class::Parameter("Give ranks as swathe.rank makes them."),
        RankError::Parameter { .. } => Class::Parameter("Leave it out for the usual value."),
        RankError::NoHeightMap => Class::Parameter("Give the grey levels, or choose profile metric."),
        RankError::Matrix { .. } => Class::Parameter("Give a square matrix with a_ji = 1 / a_ij."),
        RankError::Inconsistent { .. } => {
            Class::Parameter("Review the comparisons, or pass force=True to use them anyway.")
        }
    }
}

fn of_nest(error: &NestError) -> Class {
    match error {
        NestError::Grid(error) => of_grid(error),
        NestError::RankMin { .. } => Class::Parameter("Give 6 with gates or 7 without."),
        NestError::Vicinity { .. } => Class::Parameter("Give moore1, von_neumann1, cell or disk:r."),
        NestError::Figure { .. } => Class::Parameter("Leave it out for the usual value, or give one inside the range."),
        NestError::EvidenceMoved => Class::Parameter("Make new grids on the new terrain."),
    }
}

impl From<CoreError> for PyErr {
    fn from(error: CoreError) -> Self {
        let message = error.message();
        match error.class() {
            Class::Parameter(remedy) => python::InvalidParameterError::new_err((message, remedy)),
            Class::Shape => python::ShapeMismatchError::new_err((
                message,
                "Read all layers on one geometry, for instance with the same window.",
            )),
            Class::Outside => {
                python::OutsideGridError::new_err((message, "Rows and columns count from 0 at the north-west."))
            }
            Class::Vehicle => {
                python::InvalidVehicleError::new_err((message, "Correct the figure in the vehicle's file."))
            }
            Class::AllVoid => python::AllVoidError::new_err((message, "Give elevation data that covers the area.")),
            Class::Unread => {
                python::UnreadableFileError::new_err((message, "Check the file and the network, and try again."))
            }
            Class::TooLarge => python::TooLargeError::new_err((
                message,
                "Use coarser cells or a part of the map, or allow more memory.",
            )),
            Class::Stopped => python::InterruptedBySignalError::new_err((message, "")),
        }
    }
}

/// An error of the caller's, said before the core is asked.
pub(crate) fn invalid(message: String, remedy: &'static str) -> PyErr {
    python::InvalidParameterError::new_err((message, remedy))
}

/// One error of every kind that the core knows, by name.
#[allow(clippy::too_many_lines, reason = "a table")]
fn samples() -> Vec<(&'static str, CoreError)> {
    let figure = || VehicleError::Figure {
        name: "mass in kilograms",
        given: -1.0,
        allowed: "it must be finite and above 0",
    };
    let (name, given, allowed) = ("width", -1.0, "it must be above 0");
    vec![
        ("grid.empty", GridError::Empty { rows: 0, columns: 3 }.into()),
        (
            "grid.too_many_cells",
            GridError::TooManyCells {
                rows: 1 << 20,
                columns: 1 << 20,
            }
            .into(),
        ),
        (
            "grid.not_a_length",
            GridError::NotALength {
                name: "cell size",
                given: 0.0,
                and: "",
            }
            .into(),
        ),
        (
            "grid.shape_mismatch",
            GridError::ShapeMismatch {
                what: "the soil layer",
                expected: 4,
                found: 3,
            }
            .into(),
        ),
        ("grid.tile_side", GridError::TileSide { side: 3, first: (0, 0) }.into()),
        (
            "grid.outside_grid",
            GridError::OutsideGrid {
                row: 9,
                column: 0,
                rows: 3,
                columns: 3,
            }
            .into(),
        ),
        (
            "terrain.grid",
            TerrainError::Grid(GridError::Empty { rows: 0, columns: 0 }).into(),
        ),
        ("terrain.all_void", TerrainError::AllVoid.into()),
        (
            "terrain.height_range",
            TerrainError::HeightRange { low: 2.0, high: 1.0 }.into(),
        ),
        ("soil.unknown_code", SoilError::UnknownCode { code: 9 }.into()),
        ("soil.moisture", SoilError::Moisture { percent: -3.0 }.into()),
        (
            "belief.grid",
            BeliefError::Grid(GridError::Empty { rows: 0, columns: 0 }).into(),
        ),
        (
            "belief.soil",
            BeliefError::Soil(SoilError::Moisture { percent: -3.0 }).into(),
        ),
        ("belief.reading", BeliefError::Reading(ReadingError::Empty).into()),
        (
            "belief.parameter",
            BeliefError::Parameter { name, given, allowed }.into(),
        ),
        (
            "belief.type",
            BeliefError::Type {
                class: "clay",
                name,
                given,
                allowed,
            }
            .into(),
        ),
        ("belief.mixture", BeliefError::Mixture { unit: 3 }.into()),
        (
            "belief.unit",
            BeliefError::Unit {
                unit: 3,
                problem: "is given twice",
            }
            .into(),
        ),
        (
            "belief.outside_map",
            BeliefError::OutsideMap { x_m: 1.0, y_m: 2.0 }.into(),
        ),
        ("belief.no_class", BeliefError::NoClass.into()),
        ("belief.no_reading", BeliefError::NoReading { id: 4 }.into()),
        ("vehicle.figure", figure().into()),
        (
            "rank.grid",
            RankError::Grid(GridError::Empty { rows: 0, columns: 0 }).into(),
        ),
        ("rank.soil", RankError::Soil(SoilError::UnknownCode { code: 9 }).into()),
        ("rank.vehicle", RankError::Vehicle(figure()).into()),
        ("rank.rank", RankError::Rank { rank: 11 }.into()),
        ("rank.parameter", RankError::Parameter { name, given, allowed }.into()),
        ("rank.no_height_map", RankError::NoHeightMap.into()),
        (
            "rank.matrix",
            RankError::Matrix {
                why: "it has 0 criteria".to_owned(),
            }
            .into(),
        ),
        ("rank.inconsistent", RankError::Inconsistent { ratio: 0.5 }.into()),
        ("drive.vehicle", DriveError::Vehicle(figure()).into()),
        ("drive.belief", DriveError::Belief(BeliefError::NoClass).into()),
        ("drive.rank", DriveError::Rank(RankError::Rank { rank: 11 }).into()),
        ("drive.no_knowledge", DriveError::NoKnowledge.into()),
        ("drive.nest", DriveError::Nest(NestError::RankMin { rank: 11 }).into()),
        ("drive.figure", DriveError::Figure { name, given, allowed }.into()),
        ("corridor.length", CorridorError::Length { name, given, allowed }.into()),
        (
            "nest.grid",
            NestError::Grid(GridError::Empty { rows: 0, columns: 0 }).into(),
        ),
        ("nest.rank_min", NestError::RankMin { rank: 11 }.into()),
        ("nest.vicinity", NestError::Vicinity { radius_cells: -1.0 }.into()),
        ("nest.figure", NestError::Figure { name, given, allowed }.into()),
        ("nest.evidence_moved", NestError::EvidenceMoved.into()),
        ("swarm.nest", SwarmError::Nest(NestError::RankMin { rank: 0 }).into()),
        (
            "swarm.grid",
            SwarmError::Grid(GridError::Empty { rows: 0, columns: 0 }).into(),
        ),
        ("swarm.parameter", SwarmError::Parameter { name, given, allowed }.into()),
        (
            "swarm.source",
            SwarmError::Source(SourceFault::Unreadable { row: 256, column: 0 }).into(),
        ),
        (
            "planner.grid",
            PlannerError::Grid(GridError::Empty { rows: 0, columns: 0 }).into(),
        ),
        ("planner.rank", PlannerError::Rank(RankError::NoHeightMap).into()),
        (
            "planner.corridor",
            PlannerError::Corridor(CorridorError::Length { name, given, allowed }).into(),
        ),
        (
            "planner.nest",
            PlannerError::Nest(NestError::RankMin { rank: 0 }).into(),
        ),
        (
            "planner.swarm",
            PlannerError::Swarm(SwarmError::Parameter { name, given, allowed }).into(),
        ),
        ("planner.source", PlannerError::Source(SourceFault::Stopped).into()),
        (
            "planner.negative_cost",
            PlannerError::NegativeCost {
                row: 0,
                column: 1,
                cost: -1.0,
            }
            .into(),
        ),
        ("planner.neighbours", PlannerError::Neighbours { given: 5 }.into()),
        ("planner.weight", PlannerError::Weight { weight: 0.5 }.into()),
        (
            "planner.drivable",
            PlannerError::Drivable { name, given, allowed }.into(),
        ),
        (
            "planner.objective",
            PlannerError::Objective { name, given, allowed }.into(),
        ),
        (
            "planner.negative_factor",
            PlannerError::NegativeFactor {
                row: 0,
                column: 1,
                factor: -1.0,
            }
            .into(),
        ),
        (
            "planner.not_a_place",
            PlannerError::NotAPlace {
                name: "start",
                x_m: f64::NAN,
                y_m: 0.0,
            }
            .into(),
        ),
        (
            "planner.memory",
            PlannerError::Memory {
                needed: 400,
                limit: 100,
                cells: 25,
            }
            .into(),
        ),
        ("planner.stopped", PlannerError::Stopped.into()),
        (
            "sim.grid",
            SimError::Grid(GridError::Empty { rows: 0, columns: 0 }).into(),
        ),
        ("sim.soil", SimError::Soil(SoilError::UnknownCode { code: 9 }).into()),
        ("sim.vehicle", SimError::Vehicle(figure()).into()),
        ("sim.figure", SimError::Figure { name, given, allowed }.into()),
    ]
}

/// Names of every kind of error that the core knows.
#[pyfunction]
pub(crate) fn error_kinds() -> Vec<&'static str> {
    samples().into_iter().map(|(name, _)| name).collect()
}

/// Raises the error with this name, so that tests can see what Python makes of it.
#[pyfunction]
pub(crate) fn raise_error(kind: &str) -> PyResult<()> {
    match samples().into_iter().find(|(name, _)| *name == kind) {
        Some((_, error)) => Err(error.into()),
        None => Ok(()),
    }
}
