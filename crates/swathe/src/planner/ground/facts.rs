//! What a straight segment asks of the vehicle, or what makes it impossible.

use crate::grid::Cell;

/// What a straight segment costs and asks of the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SegmentFacts {
    /// Length along the surface, in metres.
    pub length_m: f64,
    /// Time in seconds.
    pub time_s: f64,
    /// The planner's cost in seconds: the objective's sum, times the user's factor, weighted where nests are left.
    pub cost: f64,
    /// Energy in joules.
    pub energy_j: f64,
    /// Exposure to no-go ground: seconds, weighted from 0 (out of reach) to nearly 1 (beside it).
    pub risk_s: f64,
    /// Sum of rises, in metres.
    pub climb_m: f64,
    /// Sum of falls, in metres.
    pub descent_m: f64,
    /// Steepest grade up (negative when there is none).
    pub grade_max: f64,
    /// Steepest grade down as a negative number.
    pub grade_min: f64,
    /// Steepest side slope.
    pub side_slope_max: f64,
    /// Metres on each soil, by code.
    pub soil_m: [f64; 7],
    /// Metres outside the nests.
    pub bridged_m: f64,
}

/// Why a straight segment cannot be driven. Slopes are rise over run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Obstacle {
    /// It leaves the map.
    MapEdge,
    /// A cell that it touches is closed.
    Closed(Cell),
    /// A grade beyond the vehicle's limit in this direction (negative downhill).
    Grade(Cell, f64),
    /// A grade up that the soil does not give the traction for.
    Traction(Cell, f64),
    /// A grade down (negative) on which the brakes do not hold.
    Braking(Cell, f64),
    /// A side slope beyond the vehicle's limit in this direction.
    SideSlope(Cell, f64),
    /// A side slope on which the vehicle would tip over, though its side slope limit allows it.
    Rollover(Cell, f64),
}
