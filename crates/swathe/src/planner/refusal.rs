//! Negative answers: what is in the way, where, and the nearest thing that would change it.

use crate::grid::{Cell, EIGHT, GridGeometry, Layer, LayerView, Position, Step};
use crate::nest::Nests;
use crate::progress::silent;
use crate::rank::{CellRank, CellSource, Reason};
use crate::terrain::gradient_at;
use crate::vehicle::Vehicle;

use super::cells::{Algorithm, Corners, shortest_path};
use super::ground::{Ground, Obstacle};
use super::search::{Search, StepGraph, search};

/// How planning ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// There is a route.
    RouteFound,
    /// Start and goal are ground, but no way connects them.
    NoRoute,
    /// The vehicle cannot stand at the start.
    StartBlocked,
    /// The vehicle cannot stand at the goal.
    GoalBlocked,
    /// Start or goal lies outside the map.
    OutsideMap,
    /// Ground that was needed could not be read.
    Unread,
}

impl Status {
    /// A stable word for files.
    pub fn name(self) -> &'static str {
        match self {
            Self::RouteFound => "route_found",
            Self::NoRoute => "no_route",
            Self::StartBlocked => "start_blocked",
            Self::GoalBlocked => "goal_blocked",
            Self::OutsideMap => "outside_map",
            Self::Unread => "unread",
        }
    }
}

/// A negative answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Refusal {
    /// What kind.
    pub status: Status,
    /// Why, in one sentence.
    pub reason: String,
    /// Where.
    pub place: Option<Position>,
    /// The nearest thing that would change it, in one sentence.
    pub remedy: String,
}

/// What a closed cell is, for a sentence: "ground too steep", "water or peat", ...
pub(super) fn describe_cell(source: &impl CellSource, cell: Cell) -> String {
    describe(source.cell_rank(cell))
}

fn describe(found: CellRank) -> String {
    match found.reason() {
        Reason::UnknownElevation => "unknown elevation".to_owned(),
        Reason::Grade => "ground that is too steep".to_owned(),
        Reason::SideSlope => "ground that slopes too much in every heading".to_owned(),
        Reason::SoilStrength => "soil that is too weak".to_owned(),
        Reason::NoGround => "water or peat".to_owned(),
        Reason::Step => "steps that are too high".to_owned(),
        Reason::UnknownSoil => "unknown soil".to_owned(),
        Reason::Zone => "a closed zone".to_owned(),
        Reason::None if found.rank() >= crate::rank::RANK_MIN_GATED => "ground too narrow for a nest".to_owned(),
        Reason::None => format!("poor ground (rank {})", found.rank()),
    }
}

/// Whether a cell is no-go or unknown.
pub(super) fn is_no_go(found: CellRank) -> bool {
    found.rank() < 2
}

/// What would make a closed cell passable.
fn cure(found: CellRank, slope: Option<f64>, vehicle: &Vehicle) -> String {
    let slope = slope.unwrap_or(f64::NAN);
    match found.reason() {
        Reason::UnknownElevation => "Give elevation data that covers the place, or choose another place.".to_owned(),
        Reason::Grade => format!(
            "A vehicle that drives {} % would pass (this one: {:.0} % up, {:.0} % down).",
            (slope * 100.0).ceil(),
            vehicle.grade_up * 100.0,
            vehicle.grade_down * 100.0
        ),
        Reason::SideSlope => format!(
            "A vehicle that bears a side slope of {} % would pass (this one: {:.0} %).",
            (slope * 100.0).ceil(),
            vehicle.side_slope * 100.0
        ),
        Reason::SoilStrength => {
            "Drier ground (`--moisture`) or a vehicle with less ground pressure would pass.".to_owned()
        }
        Reason::NoGround => "Choose another place or a soil map that knows a crossing.".to_owned(),
        Reason::Step => format!(
            "A vehicle that climbs higher steps would pass (this one: {:.2} m).",
            vehicle.step_height_m
        ),
        Reason::UnknownSoil => "Give a soil map that covers the place, or drop `--unknown-soil avoid`.".to_owned(),
        Reason::Zone => "Choose another place or open the zone.".to_owned(),
        Reason::None => "Try `--bridge`, which may leave the nests, or a finer `--cell-size`.".to_owned(),
    }
}

/// Refuses a start or goal on which the vehicle cannot stand.
pub(super) fn blocked_end(
    status: Status,
    place: Position,
    cell: Cell,
    found: CellRank,
    elevation_m: LayerView<f32>,
    vehicle: &Vehicle,
    snap_m: f64,
) -> Refusal {
    let name = if status == Status::StartBlocked {
        "start"
    } else {
        "goal"
    };
    let slope = gradient_at(elevation_m, cell).map(crate::terrain::Gradient::slope);
    let steep = match (found.reason(), slope) {
        (Reason::Grade | Reason::SideSlope, Some(slope)) => format!(" ({:.0} %)", slope * 100.0),
        _ => String::new(),
    };
    Refusal {
        status,
        reason: format!(
            "The {name} lies on {}{steep}, and no safe ground is within {snap_m:.0} m of it.",
            describe(found)
        ),
        place: Some(place),
        remedy: cure(found, slope, vehicle),
    }
}

/// Refuses because ground could not be read; nothing is said of whether a way exists.
pub(super) fn unread() -> Refusal {
    Refusal {
        status: Status::Unread,
        reason: "The elevation that was needed next could not be read. Whether there is a way is not known.".to_owned(),
        place: None,
        remedy: "Check the file and the network, and plan again.".to_owned(),
    }
}

/// Refuses on a part of a map that goes on: a way may lead around it.
pub(super) fn beyond() -> Refusal {
    Refusal {
        status: Status::NoRoute,
        reason: "No safe ground connects start and goal inside the part of the map that was given.".to_owned(),
        place: None,
        remedy: "Give a larger part of the map.".to_owned(),
    }
}

/// Refuses start and goal in different nests: finds the way that leaves the nests least and says what blocks it.
pub(super) fn disconnected(
    source: &impl CellSource,
    elevation_m: LayerView<f32>,
    nests: &Nests,
    start: Cell,
    goal: Cell,
    vehicle: &Vehicle,
) -> Refusal {
    let geometry = nests.geometry();
    let costs: Vec<f64> = geometry
        .cells()
        .map(|cell| match nests.label(cell) {
            0 if elevation_m[cell].is_finite() => 1.0,
            0 => 3.0,
            _ => 1e-4,
        })
        .collect();
    let costs = Layer::new(geometry, costs, "the costs").map(|costs| {
        shortest_path(
            costs.view(),
            start,
            goal,
            8,
            Corners::Cut,
            Algorithm::Dijkstra,
            None,
            &mut silent(),
        )
    });
    let way = match costs {
        Ok(Ok(Search::Found { cells, .. })) => cells,
        _ => vec![start, goal],
    };
    let gaps = gaps_along(&way, nests);
    let longest = gaps.iter().max_by_key(|gap| gap.len()).map_or(&way[..], |gap| gap);
    let length_m = (longest.len() as f64 + 1.0) * geometry.cell_size_m();
    let closed: Vec<(Cell, CellRank)> = longest.iter().map(|&cell| (cell, source.cell_rank(cell))).collect();
    // The hardest of the obstacles decides what would help: no-go before poor ground.
    let no_go = closed.iter().filter(|(_, found)| found.rank() < 2);
    let slope_at = |cell| gradient_at(elevation_m, cell).map(crate::terrain::Gradient::slope);
    let hardest = no_go
        .max_by(|a, b| {
            let key = |entry: &(Cell, CellRank)| slope_at(entry.0).unwrap_or(f64::INFINITY);
            key(a).total_cmp(&key(b))
        })
        .or_else(|| closed.get(closed.len() / 2));
    let Some(&(cell, found)) = hardest else {
        return Refusal {
            status: Status::NoRoute,
            reason: "Start and goal lie in one nest, but no way through it keeps the vehicle's limits in every direction of travel."
                .to_owned(),
            place: None,
            remedy: "A vehicle with a greater side slope or grade limit would pass.".to_owned(),
        };
    };
    let steep = match slope_at(cell) {
        Some(slope) if matches!(found.reason(), Reason::Grade | Reason::SideSlope) => {
            format!(" (up to {:.0} %)", slope * 100.0)
        }
        _ => String::new(),
    };
    let others = match gaps.len() {
        0 | 1 => String::new(),
        n => format!(" (the widest of {n} gaps on the way)"),
    };
    Refusal {
        status: Status::NoRoute,
        reason: format!(
            "No safe ground connects start and goal: about {length_m:.0} m of {}{steep} lie between{others}.",
            describe(found)
        ),
        place: Some(geometry.centre(cell)),
        remedy: cure(found, slope_at(cell), vehicle),
    }
}

/// Open cells as a graph that no limit closes, to see which limit closes the ground.
struct Unlimited<'a, 'b> {
    ground: &'a Ground<'b>,
    nests: &'a Nests,
    nest: u32,
}

impl StepGraph for Unlimited<'_, '_> {
    fn geometry(&self) -> GridGeometry {
        self.nests.geometry()
    }

    fn steps(&self) -> &[Step] {
        &EIGHT
    }

    fn edge_cost(&self, from: Cell, step: usize) -> f64 {
        let Some(to) = EIGHT[step]
            .from(&self.geometry(), from)
            .filter(|&to| self.nests.label(to) == self.nest)
        else {
            return f64::INFINITY;
        };
        let [a, b] = [from, to].map(|cell| self.geometry().centre(cell));
        // What is allowed is nearly free, so the way breaks as few limits as it can.
        EIGHT[step].length_cells() * if self.ground.segment(a, b).is_ok() { 1e-3 } else { 1.0 }
    }

    fn bound(&self, _: Cell) -> f64 {
        0.0
    }
}

/// Refuses ends in one nest between which the vehicle's limits leave no way: finds the way that breaks them least and names
/// the first limit that it breaks.
pub(super) fn limited(ground: &Ground, nests: &Nests, [start, goal]: [Cell; 2], vehicle: &Vehicle) -> Option<Refusal> {
    let geometry = ground.geometry();
    let nest = nests.label(start);
    let graph = Unlimited { ground, nests, nest };
    let Search::Found { cells, .. } = search(&graph, start, goal, &mut silent()) else {
        return None;
    };
    let broken = cells.windows(2).find_map(|pair| {
        let [a, b] = [pair[0], pair[1]].map(|cell| geometry.centre(cell));
        let length_m = a.distance_m(b);
        let heading = ((b.x_m - a.x_m) / length_m, (b.y_m - a.y_m) / length_m);
        Some(match ground.segment(a, b).err()? {
            Obstacle::Closed(cell) if nests.label(cell) == nest => {
                ground.limit_at(cell, heading).unwrap_or(Obstacle::Closed(cell))
            }
            other => other,
        })
    })?;
    let percent = |slope: f64| (slope.abs() * 100.0).ceil();
    let (cell, what, remedy) = match broken {
        Obstacle::MapEdge => return None,
        Obstacle::Closed(cell) => (
            cell,
            "a passage too narrow for the circle around the vehicle".to_owned(),
            "A smaller vehicle or a finer `--cell-size` would pass.".to_owned(),
        ),
        Obstacle::Grade(cell, grade) => (
            cell,
            format!(
                "{} % {}",
                percent(grade),
                if grade > 0.0 { "uphill" } else { "downhill" }
            ),
            format!(
                "A vehicle that drives {} % would pass (this one: {:.0} % up, {:.0} % down).",
                percent(grade),
                vehicle.grade_up * 100.0,
                vehicle.grade_down * 100.0
            ),
        ),
        Obstacle::Traction(cell, grade) => (
            cell,
            format!(
                "{} % uphill (for which the soil gives too little traction)",
                percent(grade)
            ),
            "Drier ground (`--moisture`) or a vehicle with less ground pressure or more friction would pass."
                .to_owned(),
        ),
        Obstacle::Braking(cell, grade) => (
            cell,
            format!("{} % downhill (on which the brakes do not hold)", percent(grade)),
            format!(
                "A vehicle with more braking friction would pass (this one: {:.2}).",
                vehicle.braking_friction
            ),
        ),
        Obstacle::SideSlope(cell, slope) => (
            cell,
            format!("a side slope of {} %", percent(slope)),
            format!(
                "A vehicle that bears a side slope of {} % would pass (this one: {:.0} %).",
                percent(slope),
                vehicle.side_slope * 100.0
            ),
        ),
        Obstacle::Rollover(cell, slope) => (
            cell,
            format!(
                "a side slope of {} % (on which the vehicle would tip over)",
                percent(slope)
            ),
            format!(
                "A vehicle with a wider gauge or a lower centre of gravity would pass (this one tips over at {:.0} %).",
                vehicle.rollover_slope().unwrap_or(f64::INFINITY) * 100.0
            ),
        ),
    };
    Some(Refusal {
        status: Status::NoRoute,
        reason: format!(
            "Start and goal lie in one nest, but no way through it keeps the vehicle's limits in every direction of travel: \
             {what} lies across the way that breaks them least."
        ),
        place: Some(geometry.centre(cell)),
        remedy,
    })
}

/// The stretches of a way that lie in no nest.
fn gaps_along<'a>(way: &'a [Cell], nests: &Nests) -> Vec<&'a [Cell]> {
    way.split(|&cell| nests.label(cell) > 0)
        .filter(|gap| !gap.is_empty())
        .collect()
}
