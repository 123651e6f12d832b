//! What the map says while driving: ranks, nests of the overlapping grids, elevation and the global route.

use std::collections::{HashSet, VecDeque};

use crate::grid::{Cell, GridGeometry, Layer, Position};
use crate::nest::{Footprint, GridsParams, Navigability, OverlappingGrids, RankCodes};
use crate::sensor::Pose;
use crate::soil::{SoilClass, Trafficability};
use crate::vehicle::Vehicle;

use super::knowledge::{Knowledge, Standing};
use super::params::{DriveError, DriveParams, OutsideNests};
use super::route::Ground;

/// Cost of ground outside the nests, and of no-go ground while the robot leaves it.
const OUTSIDE_COST: f32 = 3.0;
const NO_GO_COST: f32 = 20.0;

/// Cells along the side of a block of the route's window that shares one answer about nests, which are coarse.
const BLOCK: usize = 4;

/// Cost of ground with slopes beyond the vehicle's limits in some direction, off the global route, which knows in which.
const STEEP_COST: f32 = 3.0;

/// Speed outside the nests, as a share of the usual.
const OUTSIDE_SPEED: f64 = 0.5;

/// Radii of the footprint's circle nearer than which no slope closes a direction: obstacles are made wider by one.
const SLOPE_RADII: f64 = 4.0;

/// Steps of a turn in place that are looked at.
const TURN_STEP_RAD: f64 = 0.06;

/// Directions in which slopes are looked at.
const SLOPE_DIRECTIONS: usize = 96;

/// How far a safe nest is looked for, in metres.
const RETREAT_M: f64 = 60.0;

/// How far behind itself a robot looks that backs off along its trail, in metres.
const TRAIL_AIM_M: f64 = 3.0;

/// The map that a navigator may be given.
#[derive(Clone, Debug)]
pub struct Region {
    /// Rank of every terrain cell: 0 unknown, 1 no-go, 2 to 10.
    pub ranks: Layer<u8>,
    /// Elevation in metres on a grid of its own; returns that it explains are ground.
    pub elevation_m: Option<Layer<f32>>,
    /// Points of the global route, empty without one.
    pub route: Vec<Position>,
    /// The overlapping grids; `None` takes those for the vehicle.
    pub grids: Option<GridsParams>,
}

/// Where ranks come from.
#[derive(Clone, Debug)]
pub(super) enum Source {
    /// A map that says what it says.
    Ranked(Region),
    /// One that learns, with the overlapping grids for it.
    Known(Box<Knowledge>, Option<GridsParams>),
}

impl Source {
    pub fn ranks(&self) -> &Layer<u8> {
        match self {
            Self::Ranked(region) => &region.ranks,
            Self::Known(knowledge, _) => knowledge.ranks(),
        }
    }

    pub fn route(&self) -> &[Position] {
        match self {
            Self::Ranked(region) => &region.route,
            Self::Known(knowledge, _) => knowledge.route(),
        }
    }

    fn grids(&self) -> Option<&GridsParams> {
        match self {
            Self::Ranked(region) => region.grids.as_ref(),
            Self::Known(_, grids) => grids.as_ref(),
        }
    }

    /// The elevation map, if it can tell which returns are ground.
    fn elevation_m(&self) -> Option<&Layer<f32>> {
        match self {
            Self::Ranked(region) => region.elevation_m.as_ref(),
            Self::Known(knowledge, _) => {
                let map = knowledge.map();
                map.explains_returns.then_some(&map.elevation_m)
            }
        }
    }
}

/// The map in use.
#[derive(Debug)]
pub(super) struct RegionState {
    source: Source,
    grids: OverlappingGrids,
    footprint: Footprint,
    point: Footprint,
    outside: OutsideNests,
    radius_m: f64,
    /// Half the length and half the gauge of the vehicle: where its wheels stand.
    wheels_m: (f64, f64),
    /// Whether no-go ground may be crossed, to leave it.
    pub leaving_no_go: bool,
    /// Places that the robot came by, the latest last: ground that has carried it.
    trail: VecDeque<Position>,
}

impl RegionState {
    pub fn new(source: Source, vehicle: &Vehicle, params: &DriveParams, at: Position) -> Result<Self, DriveError> {
        let usual = || GridsParams::for_vehicle(vehicle);
        let grids = source.grids().cloned().unwrap_or_else(usual);
        Ok(Self {
            grids: OverlappingGrids::new(grids, at, &RankCodes(source.ranks().view()))?,
            footprint: Footprint::of_vehicle(vehicle)?,
            point: Footprint::circle(0.0)?,
            outside: params.outside_nests,
            radius_m: vehicle.circumscribed_radius_m(),
            wheels_m: (vehicle.length_m / 2.0, vehicle.gauge_m.unwrap_or(vehicle.width_m) / 2.0),
            leaving_no_go: false,
            trail: VecDeque::new(),
            source,
        })
    }

    /// Says what is wrong with the grids of a map, which are made at the first pose.
    pub fn check(source: &Source, vehicle: &Vehicle) -> Result<(), DriveError> {
        let usual = || GridsParams::for_vehicle(vehicle);
        let grids = source.grids().cloned().unwrap_or_else(usual);
        grids.validate(source.ranks().geometry())?;
        Footprint::of_vehicle(vehicle)?;
        Ok(())
    }

    /// Moves the grids with the robot and asks them all.
    pub fn ask(&mut self, pose: &Pose) -> Navigability {
        let at = Position::new(pose.x_m, pose.y_m);
        // The evidence keeps its geometry and the pose is finite: this cannot fail.
        let moved = self.grids.recentre(at, &RankCodes(self.source.ranks().view()));
        debug_assert!(moved.is_ok());
        self.grids.navigable(at, pose.heading_rad, &self.footprint)
    }

    /// Takes in where the robot is: its trail grows as it drives, and is taken back as it backs off along it.
    pub fn note(&mut self, at: Position) {
        if self.leaving_no_go {
            while self.trail.len() > 1 && self.trail[self.trail.len() - 1].distance_m(at) < TRAIL_AIM_M {
                self.trail.pop_back();
            }
            return;
        }
        if self.trail.back().is_none_or(|last| last.distance_m(at) >= 1.0) {
            self.trail.push_back(at);
        }
        if self.trail.len() as f64 > RETREAT_M {
            self.trail.pop_front();
        }
    }

    /// The place on the trail that a robot which backs off along it steers to.
    pub fn trail_end(&self) -> Option<Position> {
        self.trail.back().copied()
    }

    /// How far back along the trail the ground is a nest again, and a little farther; where it is none, to the first place that
    /// is not closed with room to turn, or at least not closed.
    pub fn way_back_m(&self, at: Position) -> Option<f64> {
        let is_open = |place: Position| self.rank(place).is_some_and(|rank| rank != 1);
        let has_room = |place: Position| {
            (0..8).all(|k| {
                let (north, east) = (f64::from(k) * std::f64::consts::FRAC_PI_4).sin_cos();
                let away_m = 2.0 * self.radius_m;
                is_open(Position::new(place.x_m + away_m * east, place.y_m + away_m * north))
            })
        };
        let (mut way_m, mut last) = (0.0, at);
        let mut best: Option<(u8, f64)> = None;
        for &place in self.trail.iter().rev() {
            way_m += last.distance_m(place);
            last = place;
            if !is_open(place) {
                continue;
            }
            if self.in_nest(place) {
                return Some(way_m + self.radius_m);
            }
            let worth = if has_room(place) { 2 } else { 1 };
            if best.is_none_or(|(known, _)| worth > known) {
                best = Some((worth, way_m));
            }
        }
        best.map(|(_, way_m)| way_m + self.radius_m)
    }

    /// Rank at a place; `None` outside the map.
    pub fn rank(&self, at: Position) -> Option<u8> {
        let ranks = self.source.ranks();
        Some(ranks[ranks.geometry().cell_at(at)?])
    }

    /// For every column and every row of another grid, the column and row of the ranks at its middle; `None` outside.
    fn lines(&self, columns: impl Iterator<Item = f64>, rows: impl Iterator<Item = f64>) -> [Vec<Option<usize>>; 2] {
        let geometry = self.source.ranks().geometry();
        let inside = |place: f64, count: usize| (place >= 0.0 && place < count as f64).then_some(place as usize);
        let column = |x_m| inside(geometry.fractional(Position::new(x_m, 0.0)).1, geometry.columns());
        let row = |y_m| inside(geometry.fractional(Position::new(0.0, y_m)).0, geometry.rows());
        [columns.map(column).collect(), rows.map(row).collect()]
    }

    /// Sets the cells of a window around a place (row by row from the north-west) that the map forbids to `closed`; returns
    /// whether there are any.
    pub fn close_forbidden(&self, at: Position, cell_size_m: f64, window: &mut [u8], closed: u8) -> bool {
        if self.leaving_no_go {
            return false;
        }
        let side = window.len().isqrt();
        let half = (side / 2) as f64;
        let offset = |k: usize| (k as f64 - half) * cell_size_m;
        let [columns, rows] = self.lines(
            (0..side).map(|k| at.x_m + offset(k)),
            (0..side).map(|k| at.y_m - offset(k)),
        );
        let mut any = false;
        if self.outside == OutsideNests::Block {
            any = self.close_outside(at, cell_size_m, window, closed);
        }
        for (cells, row) in window.chunks_exact_mut(side).zip(rows) {
            let Some(row) = row else { continue };
            let ranks = self.source.ranks().view().row(row);
            for (cell, column) in cells.iter_mut().zip(&columns) {
                if column.is_some_and(|column| ranks[column] == 1) {
                    *cell = closed;
                    any = true;
                }
            }
        }
        self.close_slopes(at, cell_size_m, window, closed) || any
    }

    /// The same for ground whose slope the vehicle must not drive on in the direction in which it lies.
    fn close_slopes(&self, at: Position, cell_size_m: f64, window: &mut [u8], closed: u8) -> bool {
        let Some(knowledge) = self.knowledge() else {
            return false;
        };
        let side = window.len().isqrt();
        let half = (side / 2) as f64;
        let reach_m = (half * cell_size_m).max(cell_size_m);
        if knowledge.is_gentle_around(at, reach_m) {
            return false;
        }
        let near_m = (SLOPE_RADII * self.radius_m).min(0.7 * reach_m);
        let mut any = false;
        for k in 0..SLOPE_DIRECTIONS {
            let heading_rad = k as f64 * std::f64::consts::TAU / SLOPE_DIRECTIONS as f64;
            let (sin, cos) = heading_rad.sin_cos();
            for step in 0.. {
                let away_m = near_m + f64::from(step) * cell_size_m;
                if away_m > reach_m {
                    break;
                }
                let (right, down) = (away_m * cos, -away_m * sin);
                if self.slope_forbids(Position::new(at.x_m + right, at.y_m - down), heading_rad) {
                    let place = |offset_m: f64| ((offset_m / cell_size_m).round() + half) as usize;
                    if let Some(cell) = window.get_mut(place(down) * side + place(right)) {
                        *cell = closed;
                        any = true;
                    }
                }
            }
        }
        any
    }

    /// Whether the slope of a place must not be driven on with a heading.
    fn slope_forbids(&self, at: Position, heading_rad: f64) -> bool {
        let Some(knowledge) = self.knowledge().filter(|_| !self.leaving_no_go) else {
            return false;
        };
        let cell = knowledge.geometry().cell_at(at);
        cell.is_some_and(|cell| !knowledge.slope_allows(cell, heading_rad))
    }

    /// Whether slopes beyond the vehicle's limits lie within a distance, so that [`Self::steepness`] must be asked.
    pub fn is_steep_around(&self, at: Position, reach_m: f64) -> bool {
        let steep = |knowledge: &Knowledge| !knowledge.is_gentle_around(at, reach_m + self.radius_m);
        !self.leaving_no_go && self.knowledge().is_some_and(steep)
    }

    /// The slope under the wheels at a place as a share of the vehicle's limits of grade and side slope: beyond 1 it must not be
    /// there on that heading, driving forward or back. 0 where a height is not known, or nothing is known of limits.
    pub fn steepness(&self, at: Position, heading_rad: f64, forward: bool) -> f64 {
        let Some(knowledge) = self.knowledge() else { return 0.0 };
        let map = knowledge.map();
        let (sin, cos) = heading_rad.sin_cos();
        let (ahead_m, left_m) = self.wheels_m;
        let mut heights_m = [0.0; 4];
        for (height_m, (ahead, left)) in heights_m
            .iter_mut()
            .zip([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
        {
            let (ahead, left) = (ahead * ahead_m, left * left_m);
            let wheel = Position::new(at.x_m + cos * ahead - sin * left, at.y_m + sin * ahead + cos * left);
            match height_between(&map.elevation_m, wheel) {
                Some(known_m) => *height_m = known_m,
                None => return 0.0,
            }
        }
        let [front_left, rear_left, rear_right, front_right] = heights_m;
        let rise = (front_left + front_right - rear_left - rear_right) / (4.0 * ahead_m);
        let lift = (front_left + rear_left - front_right - rear_right) / (4.0 * left_m);
        let grade = if forward { rise } else { -rise };
        let vehicle = &map.vehicle;
        let along = (grade / vehicle.grade_up).max(-grade / vehicle.grade_down);
        along.max(lift.abs() / vehicle.max_side_slope())
    }

    /// Radians that the vehicle may turn in place towards an angle before its wheels come onto slopes beyond its limits.
    pub fn turn_allowed_rad(&self, pose: &Pose, wanted_rad: f64) -> f64 {
        let at = Position::new(pose.x_m, pose.y_m);
        if !self.is_steep_around(at, 0.0) {
            return wanted_rad;
        }
        let most = self.steepness(at, pose.heading_rad, true).max(1.0);
        let steps = (wanted_rad.abs() / TURN_STEP_RAD).ceil();
        let steep = |turn_rad: f64| self.steepness(at, pose.heading_rad + turn_rad, true) > most;
        let first = (1..=steps as u32).find(|&k| steep(wanted_rad * f64::from(k) / steps));
        first.map_or(wanted_rad, |k| wanted_rad * f64::from(k - 1) / steps)
    }

    /// Whether the map closes a place that lies some metres away in a direction.
    pub fn forbids_towards(&self, at: Position, heading_rad: f64, away_m: f64) -> bool {
        self.forbids(at) || (away_m >= SLOPE_RADII * self.radius_m && self.slope_forbids(at, heading_rad))
    }

    /// The same for ground outside the nests, asked once for every few cells.
    fn close_outside(&self, at: Position, cell_size_m: f64, window: &mut [u8], closed: u8) -> bool {
        let side = window.len().isqrt();
        let middle = side / 2;
        let mut any = false;
        for (down, right) in blocks(side, side) {
            let offset = |first: usize| ((first + BLOCK / 2).min(side - 1) as f64 - middle as f64) * cell_size_m;
            if self.in_nest(Position::new(at.x_m + offset(right), at.y_m - offset(down))) {
                continue;
            }
            any = true;
            for row in down..(down + BLOCK).min(side) {
                window[row * side + right..row * side + (right + BLOCK).min(side)].fill(closed);
            }
        }
        any
    }

    /// Whether the map forbids to drive there.
    pub fn forbids(&self, at: Position) -> bool {
        let blocks = self.outside == OutsideNests::Block;
        !self.leaving_no_go && (self.rank(at) == Some(1) || blocks && !self.in_nest(at))
    }

    /// Whether ground that may be driven on lies within the arrival distance of a goal.
    pub fn lets_arrive(&self, goal: Position, arrival_m: f64) -> bool {
        let around = [(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)];
        around.into_iter().any(|(east, north)| {
            let place = Position::new(goal.x_m + east * arrival_m, goal.y_m + north * arrival_m);
            !matches!(self.rank(place), None | Some(1))
        })
    }

    /// Whether a place lies in a nest.
    pub fn in_nest(&self, at: Position) -> bool {
        self.grids.navigable(at, 0.0, &self.point).navigable()
    }

    /// Share of the usual speed, by what the grids say of the robot's pose.
    pub fn speed_factor(answer: Navigability) -> f64 {
        if answer.navigable() {
            answer.speed_factor()
        } else {
            OUTSIDE_SPEED
        }
    }

    /// Greatest speed that the soil, as it is believed, and the engine allow on the grade that the robot climbs; infinite where
    /// nothing is known of them, and on no-go ground, which is to be left.
    pub fn going_mps(&self, pose: &Pose) -> f64 {
        let at = Position::new(pose.x_m, pose.y_m);
        let fares = self.knowledge().and_then(|knowledge| {
            let code = knowledge.codes()[knowledge.geometry().cell_at(at)?];
            let (map, class) = (knowledge.map(), SoilClass::from_code(code).ok()?);
            let fares = Trafficability::of(&map.vehicle, class, map.rank.moisture_percent);
            fares
                .go
                .then(|| fares.powered_speed_mps(&map.vehicle, pose.pitch_rad.tan()))
        });
        fares.unwrap_or(f64::INFINITY)
    }

    /// What is left of the global route from the point nearest to a place on.
    pub fn rest_of_route(&self, at: Position) -> &[Position] {
        let route = self.source.route();
        let nearest = (0..route.len()).min_by(|&a, &b| route[a].distance_m(at).total_cmp(&route[b].distance_m(at)));
        nearest.map_or(&[], |nearest| &route[nearest..])
    }

    /// Points of the global route.
    pub fn route(&self) -> &[Position] {
        self.source.route()
    }

    /// What learns, if the map does.
    pub fn knowledge(&self) -> Option<&Knowledge> {
        match &self.source {
            Source::Ranked(_) => None,
            Source::Known(knowledge, _) => Some(knowledge),
        }
    }

    /// What learns, to be taught; [`Self::refresh`] must follow.
    pub fn knowledge_mut(&mut self) -> Option<&mut Knowledge> {
        match &mut self.source {
            Source::Ranked(_) => None,
            Source::Known(knowledge, _) => Some(knowledge),
        }
    }

    /// Whether no-go ground is known to lie between robot and goal.
    pub fn is_cut_off(&self) -> bool {
        self.knowledge()
            .is_some_and(|knowledge| knowledge.standing() == Standing::CutOff)
    }

    /// Cells of the global route and those beside them.
    fn around_route(&self) -> HashSet<(i64, i64)> {
        let cells = self.knowledge().map_or(&[][..], Knowledge::route_cells);
        let around = |cell: &Cell| {
            let (row, column) = (cell.row as i64, cell.column as i64);
            (-1..=1).flat_map(move |down| (-1..=1).map(move |right| (row + down, column + right)))
        };
        cells.iter().flat_map(around).collect()
    }

    fn is_steep_off_route(&self, at: Position, on_route: &HashSet<(i64, i64)>) -> bool {
        self.knowledge().is_some_and(|knowledge| {
            let (row, column) = knowledge.geometry().fractional(at);
            !knowledge.is_gentle_around(at, 0.0) && !on_route.contains(&(row.floor() as i64, column.floor() as i64))
        })
    }

    /// Lets the grids follow ranks that have changed: which, before and after.
    pub fn refresh(&mut self, ranks: &[(Cell, u8, u8)]) {
        let mut window: Option<(Cell, Cell)> = None;
        for &(cell, _, _) in ranks {
            let (low, high) = window.get_or_insert((cell, cell));
            *low = Cell::new(low.row.min(cell.row), low.column.min(cell.column));
            *high = Cell::new(high.row.max(cell.row), high.column.max(cell.column));
        }
        if let Some((low, high)) = window {
            let (rows, columns) = (low.row..high.row + 1, low.column..high.column + 1);
            let refreshed = self
                .grids
                .refresh(rows, columns, &RankCodes(self.source.ranks().view()));
            debug_assert!(refreshed.is_ok());
        }
    }

    /// The nearest suitable ground, in a nest if there is one within reach.
    pub fn retreat(&self, at: Position) -> Option<Position> {
        let ranks = self.source.ranks();
        let geometry = ranks.geometry();
        let reach = (RETREAT_M / geometry.cell_size_m()).ceil() as i64;
        let (row, column) = geometry.fractional(at);
        let (row, column) = (row.floor() as i64, column.floor() as i64);
        let rank_min = self.grids.params().rank_min;
        let mut best: Option<(bool, f64, Position)> = None;
        for down in row - reach..=row + reach {
            for right in column - reach..=column + reach {
                let Some(cell) = geometry.checked(down, right) else {
                    continue;
                };
                let place = geometry.centre(cell);
                let away_m = place.distance_m(at);
                if ranks[cell] < rank_min || away_m > RETREAT_M {
                    continue;
                }
                let candidate = (!self.in_nest(place), away_m, place);
                if best.is_none_or(|best| (candidate.0, candidate.1) < (best.0, best.1)) {
                    best = Some(candidate);
                }
            }
        }
        best.map(|(_, _, place)| place)
    }

    /// Elevation at a place, between the centres of four cells; `None` where it is not known.
    pub fn height_m(&self, at: Position) -> Option<f64> {
        height_between(self.source.elevation_m()?, at)
    }
}

/// The same of any map.
fn height_between(elevation: &Layer<f32>, at: Position) -> Option<f64> {
    let geometry = elevation.geometry();
    let (row, column) = geometry.fractional(at);
    let (row, column) = (row - 0.5, column - 0.5);
    let (top, left) = (row.floor(), column.floor());
    let (down, right) = (row - top, column - left);
    let mut sum = 0.0;
    for (rows, share_down) in [(0, 1.0 - down), (1, down)] {
        for (columns, share_right) in [(0, 1.0 - right), (1, right)] {
            let share = share_down * share_right;
            if share > 0.0 {
                let cell = geometry.checked(top as i64 + rows, left as i64 + columns)?;
                sum += share * f64::from(elevation[cell]);
            }
        }
    }
    sum.is_finite().then_some(sum)
}

/// First rows and columns of the blocks of a grid.
fn blocks(rows: usize, columns: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..rows)
        .step_by(BLOCK)
        .flat_map(move |down| (0..columns).step_by(BLOCK).map(move |right| (down, right)))
}

impl Ground for RegionState {
    fn factors(&self, geometry: &GridGeometry) -> Vec<f32> {
        let (rows, columns) = (geometry.rows(), geometry.columns());
        let centre = |row, column| geometry.centre(Cell::new(row, column));
        let lines = self.lines(
            (0..columns).map(|column| centre(0, column).x_m),
            (0..rows).map(|row| centre(row, 0).y_m),
        );
        let no_go = if self.leaving_no_go { NO_GO_COST } else { f32::INFINITY };
        let mut factors = Vec::with_capacity(geometry.cell_count());
        for row in &lines[1] {
            let ranks = row.map(|row| self.source.ranks().view().row(row));
            let factor = |column: &Option<usize>| match ranks.zip(*column).map(|(ranks, column)| ranks[column]) {
                Some(1) => no_go,
                None => f32::INFINITY,
                Some(_) => 1.0,
            };
            factors.extend(lines[0].iter().map(factor));
        }
        let on_route = self.around_route();
        for (down, right) in blocks(rows, columns) {
            let middle = centre((down + BLOCK / 2).min(rows - 1), (right + BLOCK / 2).min(columns - 1));
            let answer = self.grids.navigable(middle, 0.0, &self.point);
            let mut outside = match answer.navigable() {
                true => answer.cost_factor() as f32,
                false if self.outside == OutsideNests::Block && !self.leaving_no_go => f32::INFINITY,
                false => OUTSIDE_COST,
            };
            if self.is_steep_off_route(middle, &on_route) {
                outside *= STEEP_COST;
            }
            if outside <= 1.0 {
                continue;
            }
            for row in down..(down + BLOCK).min(rows) {
                let line = &mut factors[row * columns + right..row * columns + (right + BLOCK).min(columns)];
                for factor in line {
                    *factor *= outside;
                }
            }
        }
        factors
    }
}
