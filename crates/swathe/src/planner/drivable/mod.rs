//! Paths that a car can drive: the route is followed by arcs that respect the turning radius, reversing where needed.
//!
//! Method: Hybrid A* (Dolgov, Thrun, Montemerlo and Diebel, "Path planning for autonomous vehicles in unknown semi-structured
//! environments", International Journal of Robotics Research 29 (2010) 485-501) inside a corridor around the route, which is
//! widened up to the whole ground when nothing is found. States are continuous poses, one kept for each place, heading and
//! direction of a lattice. Every arc is integrated over the ground by the evaluator of routes, per direction of travel.
//! Not optimal: the bound is weighted, and one pose stands for its lattice cell. Curvature is bounded, not continuous.
//!
//! The pose is that of the middle of the footprint, the heading that of travel. Radii that makers give are those of an outer
//! wheel, so keeping them for the middle is cautious.

mod curves;
mod drive;
mod field;
mod search;
mod smooth;

use crate::grid::Position;
use crate::nest::{NestParams, exact_nests};
use crate::progress::Report;
use crate::rank::Ranker;
use crate::vehicle::Vehicle;

use super::PlannerError;
use super::answer::{Plan, Stage, Terrain};
use super::ground::{Ground, SegmentFacts};
use super::plan::Planner;
use super::refusal::{Refusal, Status};
use super::route::Route;
use super::search::StepGraph;
use super::watch::Watch;
use drive::Drive;
use field::Field;
use search::{Ended, Hybrid};

pub use curves::{CurveArc, Pose, dubins, reeds_shepp};

/// How a drivable path is searched. All figures are estimates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrivableParams {
    /// How many times the time, and so the cost, of reversing is that of driving forward; at least 1.
    pub reverse_factor: f64,
    /// Seconds for a change between forward and reverse; at least 0.
    pub cusp_time_s: f64,
    /// Weight of the expected cost; 1 or more. Greater values search less and may find dearer paths: on drawn obstacles 2
    /// took 1 to 20 % of the states that 1.5 took, for paths mostly within 3 % (one in twenty 15 %) of it.
    pub weight: f64,
    /// States after which the search gives up, at least 1; a state takes about 150 bytes.
    pub most_states: usize,
}

impl Default for DrivableParams {
    fn default() -> Self {
        Self {
            reverse_factor: 2.0,
            cusp_time_s: 4.0,
            weight: 2.0,
            most_states: 1_000_000,
        }
    }
}

impl DrivableParams {
    fn validate(&self) -> Result<(), PlannerError> {
        let checks = [
            (
                "reverse factor",
                self.reverse_factor,
                1.0,
                1000.0,
                "1 to 1000 is allowed",
            ),
            (
                "time of a change of direction",
                self.cusp_time_s,
                0.0,
                1e6,
                "0 to 1000000 s is allowed",
            ),
            ("weight of the bound", self.weight, 1.0, 1000.0, "1 to 1000 is allowed"),
            (
                "number of states",
                self.most_states as f64,
                1.0,
                1e8,
                "1 to 100000000 is allowed",
            ),
        ];
        for (name, given, low, high, allowed) in checks {
            // A comparison that NaN fails.
            if !(given >= low && given <= high) {
                return Err(PlannerError::Drivable { name, given, allowed });
            }
        }
        Ok(())
    }
}

/// A part of a path with one curvature and one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrivenArc {
    /// Where it starts.
    pub from: Pose,
    /// Curvature and signed length: negative is driven in reverse.
    pub arc: CurveArc,
    /// What it costs and asks, for the direction of travel, with the charge for reversing.
    pub facts: SegmentFacts,
}

/// A pose on a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrivenPose {
    /// Where the vehicle is.
    pub pose: Pose,
    /// Whether it is there driving in reverse.
    pub reverse: bool,
    /// Curvature of the arc that it is on, in 1/m.
    pub curvature_per_m: f64,
}

/// A path that a vehicle with a turning radius can drive.
#[derive(Clone, Debug, PartialEq)]
pub struct DrivablePath {
    /// Its arcs in order; the end of one is the start of the next.
    pub arcs: Vec<DrivenArc>,
    /// Where it ends; `None` when it has no arcs.
    pub end: Option<Pose>,
    /// Sum over the arcs; changes of direction are in time and cost.
    pub total: SegmentFacts,
    /// Changes between forward and reverse.
    pub cusps: usize,
    /// Metres in reverse.
    pub reverse_m: f64,
    /// The least turning radius that it keeps, in metres; 0 for a vehicle that turns in place.
    pub radius_m: f64,
    /// States that the search made.
    pub states: usize,
}

impl DrivablePath {
    fn empty(radius_m: f64) -> Self {
        Self {
            arcs: Vec::new(),
            end: None,
            total: SegmentFacts::default(),
            cusps: 0,
            reverse_m: 0.0,
            radius_m,
            states: 0,
        }
    }

    /// Poses along the path, at most `spacing_m` apart, with both ends of every arc.
    ///
    /// Where two arcs meet without a change of direction their common pose stands once, with the curvature of the later
    /// arc; at a change of direction, and where a vehicle turns in place, it stands twice. `spacing_m` must be above zero.
    pub fn poses(&self, spacing_m: f64) -> Vec<DrivenPose> {
        let mut found: Vec<DrivenPose> = Vec::new();
        for (index, driven) in self.arcs.iter().enumerate() {
            let arc = driven.arc;
            let count = (arc.length_m.abs() / spacing_m).ceil().max(1.0) as usize;
            let at = |step: usize| DrivenPose {
                pose: driven.from.after(CurveArc {
                    length_m: arc.length_m * step as f64 / count as f64,
                    ..arc
                }),
                reverse: arc.length_m < 0.0,
                curvature_per_m: arc.curvature_per_m,
            };
            if let Some(last) = found.last()
                && last.reverse == (arc.length_m < 0.0)
                && curves::principal(last.pose.heading_rad - driven.from.heading_rad).abs() < 1e-6
            {
                found.pop();
            }
            found.extend((0..count).map(at));
            let end = self.arcs.get(index + 1).map(|next| next.from).or(self.end);
            let mut last = at(count);
            if let Some(end) = end {
                (last.pose.x_m, last.pose.y_m) = (end.x_m, end.y_m);
            }
            found.push(last);
        }
        found
    }
}

/// What a search in one corridor takes.
struct Attempt {
    /// Half the corridor's width in first widths; infinite is the whole ground.
    width: f64,
    /// Length of the steps in turning radii.
    step: f64,
}

/// Corridors from narrow to the whole ground, the later ones with finer steps.
const ATTEMPTS: [Attempt; 4] = [
    Attempt { width: 1.0, step: 0.5 },
    Attempt { width: 3.0, step: 0.5 },
    Attempt { width: 9.0, step: 0.25 },
    Attempt {
        width: f64::INFINITY,
        step: 0.25,
    },
];

/// Half the width of the first corridor, in turning radii and in cells.
const FIRST_RADII: f64 = 4.0;
const FIRST_CELLS: f64 = 4.0;

/// A path from the first to the last of a route's points that keeps the vehicle's turning radius.
///
/// Headings at the ends are free where not given. A vehicle that turns in place keeps the route as it is. `report` counts
/// the states that were looked at.
///
/// Limits hold for the direction of travel and, in reverse, for the way the nose points as well: the stricter counts.
///
/// # Errors
/// [`PlannerError`] for a figure that is not usable or a request to stop. No such path is a [`Refusal`] in the answer.
pub fn drivable_path(
    ground: &Ground,
    vehicle: &Vehicle,
    route: &[Position],
    start_heading_rad: Option<f64>,
    goal_heading_rad: Option<f64>,
    params: &DrivableParams,
    report: &mut Report,
) -> Result<Result<DrivablePath, Refusal>, PlannerError> {
    params.validate()?;
    for (name, place) in [("start", route.first()), ("goal", route.last())] {
        if let Some(&Position { x_m, y_m }) = place
            && !(x_m.is_finite() && y_m.is_finite())
        {
            return Err(PlannerError::NotAPlace { name, x_m, y_m });
        }
    }
    for (name, heading) in [
        ("heading at the start", start_heading_rad),
        ("heading at the goal", goal_heading_rad),
    ] {
        if let Some(given) = heading
            && !given.is_finite()
        {
            let allowed = "it must be finite";
            return Err(PlannerError::Drivable { name, given, allowed });
        }
    }
    let radius_m = vehicle.min_turn_radius_m;
    let (Some(&start), Some(&goal)) = (route.first(), route.last()) else {
        return Ok(Ok(DrivablePath::empty(radius_m)));
    };
    let drive = Drive::new(ground, vehicle, params);
    if radius_m == 0.0 {
        return Ok(drive.turning_in_place(route).ok_or_else(|| blocked(start, radius_m)));
    }
    let geometry = ground.geometry();
    let (Some(_), Some(goal_cell)) = (geometry.cell_at(start), geometry.cell_at(goal)) else {
        return Ok(Err(blocked(start, radius_m)));
    };
    let first_m = (FIRST_RADII * radius_m).max(FIRST_CELLS * geometry.cell_size_m());
    let (mut states, mut nearest) = (0, start);
    for Attempt { width, step } in ATTEMPTS {
        let half_m = width * first_m;
        if half_m.is_finite() && half_m >= geometry.diagonal_m() {
            continue;
        }
        let Some(field) = Field::lay(ground, route, goal_cell, half_m, report) else {
            return Err(PlannerError::Stopped);
        };
        let hybrid = Hybrid::new(&drive, &field, route, [start_heading_rad, goal_heading_rad], step);
        match hybrid.search(&mut states, report) {
            Ended::Found(steps) => {
                let Some(steps) = smooth::smooth(&drive, &field, steps, report) else {
                    return Err(PlannerError::Stopped);
                };
                let path = drive.path(&steps, states);
                return Ok(path.ok_or_else(|| blocked(start, radius_m)));
            }
            Ended::Stopped => return Err(PlannerError::Stopped),
            Ended::TooMany(place) => return Ok(Err(too_many(place, params.most_states))),
            Ended::Nothing(place) => nearest = place,
        }
    }
    Ok(Err(blocked(nearest, radius_m)))
}

/// Drives along some points through the nests of the whole map, as [`drivable_path`] does along a route.
///
/// # Errors
/// Those of [`drivable_path`], and nest parameters that are not usable.
pub fn drivable_way(
    terrain: Terrain,
    ranker: &Ranker,
    vehicle: &Vehicle,
    moisture_percent: f64,
    nest: &NestParams,
    way: &DrivenWay,
    report: &mut Report,
) -> Result<Result<DrivablePath, Refusal>, PlannerError> {
    if !report(0, 0) {
        return Err(PlannerError::Stopped);
    }
    let nests = exact_nests(&ranker.rank_all(), None, nest)?;
    let labels = nests.labels().data();
    let goal = way.points.last().copied().unwrap_or(Position::new(0.0, 0.0));
    let Terrain { elevation_m, soil, .. } = terrain;
    let is_open = |index: usize| labels[index] > 0;
    let ground = Ground::new(elevation_m, soil, vehicle, moisture_percent, is_open, None, goal);
    let [start_heading, goal_heading] = way.headings_rad;
    drivable_path(
        &ground,
        vehicle,
        &way.points,
        start_heading,
        goal_heading,
        &way.params,
        report,
    )
}

/// What [`drivable_way`] follows.
#[derive(Clone, Debug, PartialEq)]
pub struct DrivenWay {
    /// Points from start to goal; the corridor is laid around their connecting lines.
    pub points: Vec<Position>,
    /// Headings at start and goal; free where not given.
    pub headings_rad: [Option<f64>; 2],
    /// How the path is searched.
    pub params: DrivableParams,
}

impl Planner<'_> {
    /// Puts a route into the answer, with the arcs that follow it where the request asks for them.
    pub(super) fn driven(
        &self,
        ground: &Ground,
        route: Route,
        mut answer: Plan,
        watch: &mut Watch,
    ) -> Result<Plan, PlannerError> {
        if !self.request.path.is_driven(self.vehicle, self.geometry().cell_size_m()) {
            answer.answer = Ok(route);
            return Ok(answer);
        }
        let [start_heading, goal_heading] = self.request.headings_rad;
        let mut tell = |done, total| watch.ask(Stage::Route, done, total);
        let params = DrivableParams::default();
        let (points, vehicle) = (route.points(), self.vehicle);
        match drivable_path(
            ground,
            vehicle,
            &points,
            start_heading,
            goal_heading,
            &params,
            &mut tell,
        )? {
            Ok(path) => {
                answer.drivable = Some(path);
                answer.answer = Ok(route);
            }
            Err(refusal) => answer = answer.refused(refusal),
        }
        Ok(answer)
    }
}

fn blocked(place: Position, radius_m: f64) -> Refusal {
    Refusal {
        status: Status::NoRoute,
        reason: format!(
            "No path with a turning radius of {radius_m:.1} m leads to the goal, also in reverse; the nearest to it that was \
             reached is shown."
        ),
        place: Some(place),
        remedy: "A smaller turning radius, other headings at start and goal, or a route whose turns are not checked \
                 (`--path grid16`) would help."
            .to_owned(),
    }
}

fn too_many(place: Position, most: usize) -> Refusal {
    Refusal {
        status: Status::NoRoute,
        reason: format!(
            "No path that keeps the turning radius was found among {most} states; the search gave up there."
        ),
        place: Some(place),
        remedy: "Allow more states, choose coarser cells (`--cell-size`), or take the route with its turns unchecked \
                 (`--path grid16`)."
            .to_owned(),
    }
}

#[cfg(test)]
mod tests;
