//! The ground as the vehicle feels it: which steps its limits allow and how long each takes.
//!
//! One evaluator serves edges of the search, shortcuts and the finished route: heights between cell centres are
//! bilinear, a straight segment is cut at cell borders, and each piece has the grade of its ends, the soil of its cell and
//! the speed that power, soil, braking distance and the vehicle itself allow. Limits hold twice: for the grade of every
//! piece, and for pitch and roll of Horn's gradient of every cell that is crossed.

use rayon::prelude::*;

use crate::grid::{Cell, GridGeometry, Layer, LayerView, Position, SIXTEEN, Step, pieces, swept_cells};
use crate::nest::BitRows;
use crate::soil::{SoilClass, Trafficability};
use crate::terrain::{allowed_headings, gradient_at};
use crate::vehicle::{GRAVITY_MPS2, Vehicle};

use super::search::StepGraph;

/// Cost factor of suitable cells outside the nests, where they may be crossed at all.
pub const BRIDGE_FACTOR: f64 = 3.0;

/// Relative slack of limits, so that a segment exactly at a limit does not fail by rounding.
const SLACK: f64 = 1e-9;

/// What a straight segment costs and asks of the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SegmentFacts {
    /// Length along the surface, in metres.
    pub length_m: f64,
    /// Time in seconds.
    pub time_s: f64,
    /// The planner's cost: time, weighted where nests are left.
    pub cost: f64,
    /// Energy in joules.
    pub energy_j: f64,
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

/// Why a straight segment cannot be driven.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Obstacle {
    /// It leaves the map.
    MapEdge,
    /// A cell that it touches is closed.
    Closed(Cell),
    /// A grade beyond the limit in this direction.
    Grade(Cell, f64),
    /// A side slope beyond the limit in this direction.
    SideSlope(Cell, f64),
    /// Brakes or power do not suffice.
    Force(Cell),
}

/// One of the sixteen steps, cut into pieces.
#[derive(Clone, Debug)]
struct Template {
    /// Cells that the vehicle's circle touches.
    swept: Vec<Step>,
    /// Cells crossed, with the share of the length in each.
    crossed: Vec<(Step, f64)>,
    /// Heights at the inner borders as weighted sums.
    borders: Vec<Vec<(Step, f64)>>,
    run_m: f64,
}

/// The graph of directed steps over open cells.
pub struct Ground<'a> {
    elevation_m: LayerView<'a, f32>,
    soil: Option<LayerView<'a, u8>>,
    vehicle: &'a Vehicle,
    soils: [Trafficability; 7],
    /// Allowed directions of each open cell; 0 is closed.
    headings: Layer<u16>,
    bridged: Option<BitRows>,
    radius_m: f64,
    templates: Vec<Template>,
    /// Rows and columns that a template reaches beyond the cell.
    reach: usize,
    goal: Position,
}

impl<'a> Ground<'a> {
    /// The ground of open cells. `bridged` marks the open cells that are no nest.
    pub fn new(
        elevation_m: LayerView<'a, f32>,
        soil: Option<LayerView<'a, u8>>,
        vehicle: &'a Vehicle,
        moisture_percent: f64,
        is_open: impl Fn(usize) -> bool + Sync,
        bridged: Option<BitRows>,
        goal: Position,
    ) -> Self {
        let geometry = elevation_m.geometry();
        let soils = SoilClass::ALL.map(|class| Trafficability::of(vehicle, class, moisture_percent));
        let radius_m = vehicle.circumscribed_radius_m();
        let templates: Vec<Template> = SIXTEEN
            .iter()
            .map(|step| template(*step, geometry.cell_size_m(), radius_m))
            .collect();
        let reach = templates
            .iter()
            .flat_map(|template| &template.swept)
            .map(|step| step.rows.abs().max(step.columns.abs()) as usize)
            .max()
            .unwrap_or(0);
        let mut headings = Layer::filled(geometry, 0);
        let columns = geometry.columns();
        headings
            .data_mut()
            .par_chunks_mut(columns)
            .enumerate()
            .for_each(|(row, out)| {
                for (column, allowed) in out.iter_mut().enumerate() {
                    if !is_open(row * columns + column) {
                        continue;
                    }
                    let cell = Cell::new(row, column);
                    if let Some(gradient) = gradient_at(elevation_m, cell) {
                        let code = soil.map_or(0, |soil| soil[cell]);
                        let traction = soils[usize::from(code)].drawbar_grade;
                        *allowed = allowed_headings(
                            gradient,
                            vehicle.grade_up.min(traction) * (1.0 + SLACK),
                            vehicle.grade_down * (1.0 + SLACK),
                            vehicle.side_slope * (1.0 + SLACK),
                        );
                    }
                }
            });
        Self {
            elevation_m,
            soil,
            vehicle,
            soils,
            headings,
            bridged,
            radius_m,
            templates,
            reach,
            goal,
        }
    }

    /// Least cost per metre anywhere: that of the greatest speed.
    pub fn least_cost_per_m(&self) -> f64 {
        1.0 / self.vehicle.max_speed_mps
    }

    /// Whether a cell is open and the vehicle's circle at its centre touches open cells only.
    pub fn is_clear(&self, cell: Cell) -> bool {
        let centre = self.geometry().centre(cell);
        self.is_open(cell)
            && swept_cells(&self.geometry(), centre, centre, self.radius_m, |near| {
                near.is_some_and(|near| self.is_open(near))
            })
    }

    /// The cells that the vehicle touches on a step, as steps from where it begins.
    pub(super) fn swept(&self, step: usize) -> &[Step] {
        &self.templates[step].swept
    }

    fn is_open(&self, cell: Cell) -> bool {
        self.headings[cell] != 0
    }

    /// What driving straight from `a` to `b` costs.
    ///
    /// # Errors
    /// The [`Obstacle`] that makes it impossible, the first along the way.
    pub fn segment(&self, a: Position, b: Position) -> Result<SegmentFacts, Obstacle> {
        let geometry = self.geometry();
        let mut obstacle = None;
        swept_cells(&geometry, a, b, self.radius_m, |near| {
            obstacle = match near {
                None => Some(Obstacle::MapEdge),
                Some(cell) if !self.is_open(cell) => Some(Obstacle::Closed(cell)),
                Some(_) => None,
            };
            obstacle.is_none()
        });
        if let Some(obstacle) = obstacle {
            return Err(obstacle);
        }
        let run_m = a.distance_m(b);
        let mut facts = SegmentFacts {
            grade_max: f64::NEG_INFINITY,
            grade_min: f64::INFINITY,
            ..SegmentFacts::default()
        };
        if run_m == 0.0 {
            return Ok(SegmentFacts::default());
        }
        let (east, north) = ((b.x_m - a.x_m) / run_m, (b.y_m - a.y_m) / run_m);
        let mut height_m = self.height_m(a);
        let complete = pieces(&geometry, a, b, |piece| {
            let next_m = self.height_m(a.towards(b, piece.end));
            let piece_m = run_m * (piece.end - piece.start);
            if piece_m > 0.0 {
                let rise_m = next_m - height_m;
                obstacle = self
                    .limits(piece.cell, east, north, rise_m / piece_m, &mut facts)
                    .or_else(|| self.add(piece.cell, piece_m, rise_m, &mut facts));
            }
            height_m = next_m;
            obstacle.is_none()
        });
        match obstacle {
            Some(obstacle) => Err(obstacle),
            None if complete => Ok(facts),
            None => Err(Obstacle::MapEdge),
        }
    }

    /// Checks the limits of a piece and notes its grades.
    fn limits(&self, cell: Cell, east: f64, north: f64, grade: f64, facts: &mut SegmentFacts) -> Option<Obstacle> {
        let gradient = gradient_at(self.elevation_m, cell)?;
        let traction = self.soils[self.soil_code(cell)].drawbar_grade;
        let up = self.vehicle.grade_up.min(traction) * (1.0 + SLACK);
        let down = self.vehicle.grade_down * (1.0 + SLACK);
        let (pitch, roll) = (gradient.along(east, north), gradient.across(east, north));
        for slope in [grade, pitch] {
            if slope > up || slope < -down {
                return Some(Obstacle::Grade(cell, slope));
            }
        }
        if roll.abs() > self.vehicle.side_slope * (1.0 + SLACK) {
            return Some(Obstacle::SideSlope(cell, roll.abs()));
        }
        facts.grade_max = facts.grade_max.max(grade);
        facts.grade_min = facts.grade_min.min(grade);
        facts.side_slope_max = facts.side_slope_max.max(roll.abs());
        None
    }

    /// Adds time, energy and lengths of a piece.
    fn add(&self, cell: Cell, run_m: f64, rise_m: f64, facts: &mut SegmentFacts) -> Option<Obstacle> {
        let soil = self.soil_code(cell);
        let grade = rise_m / run_m;
        let Some(speed_mps) = speed_mps(self.vehicle, &self.soils[soil], grade) else {
            return Some(Obstacle::Force(cell));
        };
        let length_m = run_m.hypot(rise_m);
        let time_s = length_m / speed_mps;
        facts.length_m += length_m;
        facts.time_s += time_s;
        if self.bridged.as_ref().is_some_and(|bridged| bridged.get(cell)) {
            facts.cost += BRIDGE_FACTOR * time_s;
            facts.bridged_m += run_m;
        } else {
            facts.cost += time_s;
        }
        facts.energy_j += self.force_n(soil, grade).max(0.0) * length_m / self.vehicle.drive_efficiency
            + self.vehicle.idle_power_w * time_s;
        facts.climb_m += rise_m.max(0.0);
        facts.descent_m += (-rise_m).max(0.0);
        facts.soil_m[soil] += run_m;
        None
    }

    fn soil_code(&self, cell: Cell) -> usize {
        self.soil.map_or(0, |soil| usize::from(soil[cell]))
    }

    /// Height at a position: bilinear between the known centres around it, weights of unknown ones shared out.
    fn height_m(&self, position: Position) -> f64 {
        let geometry = self.geometry();
        let (row, column) = geometry.fractional(position);
        let (mut sum, mut total) = (0.0, 0.0);
        for (rows, columns, weight) in bilinear(row, column) {
            if let Some(cell) = geometry.checked(rows, columns) {
                let height = f64::from(self.elevation_m[cell]);
                if height.is_finite() {
                    sum += weight * height;
                    total += weight;
                }
            }
        }
        sum / total
    }

    /// Driving force in newtons on a soil and grade.
    fn force_n(&self, soil: usize, grade: f64) -> f64 {
        let cos = 1.0 / (1.0 + grade * grade).sqrt();
        let weight_n = self.vehicle.mass_kg * GRAVITY_MPS2;
        weight_n * cos * (self.soils[soil].rolling_resistance + grade)
    }

    /// Height at an inner border of a template.
    fn border_m(&self, from: Cell, weights: &[(Step, f64)]) -> f64 {
        let geometry = self.geometry();
        let (mut sum, mut total) = (0.0, 0.0);
        for (step, weight) in weights {
            let row = (from.row as i64 + i64::from(step.rows)) as usize;
            let column = (from.column as i64 + i64::from(step.columns)) as usize;
            let height = f64::from(self.elevation_m.data()[row * geometry.columns() + column]);
            if height.is_finite() {
                sum += weight * height;
                total += weight;
            }
        }
        if total == 1.0 { sum } else { sum / total }
    }

    fn all_open(&self, from: Cell, steps: &[Step]) -> bool {
        let geometry = self.geometry();
        let inner = from.row >= self.reach
            && from.column >= self.reach
            && from.row + self.reach < geometry.rows()
            && from.column + self.reach < geometry.columns();
        if inner {
            let here = geometry.index(from) as i64;
            let columns = geometry.columns() as i64;
            return steps.iter().all(|step| {
                let index = here + i64::from(step.rows) * columns + i64::from(step.columns);
                self.headings.data()[index as usize] != 0
            });
        }
        steps.iter().all(|step| {
            let near = geometry.offset(from, step.rows, step.columns);
            near.is_some_and(|near| self.headings[near] != 0)
        })
    }
}

impl StepGraph for Ground<'_> {
    fn geometry(&self) -> GridGeometry {
        self.elevation_m.geometry()
    }

    fn steps(&self) -> &[Step] {
        &SIXTEEN
    }

    fn edge_cost(&self, from: Cell, step: usize) -> f64 {
        let bit = 1 << step;
        let template = &self.templates[step];
        if self.headings[from] & bit == 0 || !self.all_open(from, &template.swept) {
            return f64::INFINITY;
        }
        let mut cost = 0.0;
        let mut height_m = f64::from(self.elevation_m[from]);
        for (place, (offset, share)) in template.crossed.iter().enumerate() {
            let cell = Cell::new(
                (from.row as i64 + i64::from(offset.rows)) as usize,
                (from.column as i64 + i64::from(offset.columns)) as usize,
            );
            if self.headings[cell] & bit == 0 {
                return f64::INFINITY;
            }
            let next_m = match template.borders.get(place) {
                Some(weights) => self.border_m(from, weights),
                None => f64::from(self.elevation_m[cell]),
            };
            let run_m = template.run_m * share;
            let grade = (next_m - height_m) / run_m;
            let soil = self.soil_code(cell);
            let up = self.vehicle.grade_up.min(self.soils[soil].drawbar_grade);
            if grade > up * (1.0 + SLACK) || grade < -self.vehicle.grade_down * (1.0 + SLACK) {
                return f64::INFINITY;
            }
            let Some(speed_mps) = speed_mps(self.vehicle, &self.soils[soil], grade) else {
                return f64::INFINITY;
            };
            let time_s = run_m * (1.0 + grade * grade).sqrt() / speed_mps;
            let outside = self.bridged.as_ref().is_some_and(|bridged| bridged.get(cell));
            cost += if outside { BRIDGE_FACTOR * time_s } else { time_s };
            height_m = next_m;
        }
        cost
    }

    fn bound(&self, cell: Cell) -> f64 {
        let distance_m = self.geometry().centre(cell).distance_m(self.goal);
        // A hair less than the bound, so that rounding cannot make it inconsistent.
        self.least_cost_per_m() * (1.0 - 1e-12) * distance_m
    }
}

/// Greatest speed on a soil and grade, or `None` where the brakes cannot hold the vehicle.
pub(super) fn speed_mps(vehicle: &Vehicle, soil: &Trafficability, grade: f64) -> Option<f64> {
    let cos = 1.0 / (1.0 + grade * grade).sqrt();
    let mut speed_mps = soil.speed_mps;
    let resistance = soil.rolling_resistance + grade;
    if resistance > 0.0 {
        let force_n = vehicle.mass_kg * GRAVITY_MPS2 * cos * resistance;
        speed_mps = speed_mps.min(vehicle.drive_efficiency * vehicle.power_w / force_n);
    }
    // v² / a + v t = d with twice the deceleration a.
    let doubled_mps2 = 2.0 * GRAVITY_MPS2 * cos * (vehicle.braking_friction + grade);
    if doubled_mps2 <= 0.0 {
        return None;
    }
    let t = vehicle.reaction_time_s;
    let stopping = (t * t + 4.0 * vehicle.sight_distance_m / doubled_mps2).sqrt() - t;
    Some(speed_mps.min(stopping * doubled_mps2 / 2.0))
}

/// The four centres around a point given in cells from the corner, with their bilinear weights.
fn bilinear(row: f64, column: f64) -> [(i64, i64, f64); 4] {
    let (low_row, low_column) = ((row - 0.5).floor(), (column - 0.5).floor());
    let (down, right) = (row - 0.5 - low_row, column - 0.5 - low_column);
    let (r, c) = (low_row as i64, low_column as i64);
    [
        (r, c, (1.0 - down) * (1.0 - right)),
        (r, c + 1, (1.0 - down) * right),
        (r + 1, c, down * (1.0 - right)),
        (r + 1, c + 1, down * right),
    ]
}

/// Cuts a step into pieces with the same code that cuts segments, on a scrap of grid.
fn template(step: Step, cell_size_m: f64, radius_m: f64) -> Template {
    let middle = (radius_m / cell_size_m).ceil() as usize + 3;
    let side = 2 * middle + 1;
    let geometry = GridGeometry::new(side, side, cell_size_m, 0.0, 0.0).expect("a scrap of grid has cells");
    let from = Cell::new(middle, middle);
    let to = step.from(&geometry, from).expect("the scrap holds the step");
    let (a, b) = (geometry.centre(from), geometry.centre(to));
    let offset = |cell: Cell| Step {
        rows: cell.row as i32 - middle as i32,
        columns: cell.column as i32 - middle as i32,
    };
    let (mut swept, mut crossed, mut borders) = (Vec::new(), Vec::new(), Vec::new());
    swept_cells(&geometry, a, b, radius_m, |cell| {
        swept.extend(cell.map(offset));
        true
    });
    pieces(&geometry, a, b, |piece| {
        crossed.push((offset(piece.cell), piece.end - piece.start));
        let (row, column) = geometry.fractional(a.towards(b, piece.end));
        let weights = bilinear(row, column).map(|(row, column, weight)| {
            let cell = Cell::new(row as usize, column as usize);
            // Exact fractions, so that weights sum to one exactly.
            (offset(cell), (weight * 64.0).round() / 64.0)
        });
        borders.push(weights.into_iter().filter(|(_, weight)| *weight > 0.0).collect());
        true
    });
    // The last border is the target's centre.
    borders.pop();
    Template {
        swept,
        crossed,
        borders,
        run_m: cell_size_m * step.length_cells(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::{Search, cost_field, search, shorten};
    use crate::progress::silent;
    use crate::vehicle::fixtures::{pioneer, tractor};
    use proptest::prelude::*;

    /// Smooth hills of a given height with a few voids and soils.
    fn hills(seed: u64, height_m: f64) -> (Layer<f32>, Layer<u8>) {
        let geometry = GridGeometry::new(18, 20, 10.0, 500.0, 900.0).unwrap();
        let draw = |i: u32| crate::random::unit(crate::random::philox([i, 0, 0, 0], seed)[0]);
        let heights = geometry.cells().map(|cell| {
            let (row, column) = (cell.row as f64, cell.column as f64);
            let wave = (row * (0.2 + draw(1) * 0.3) + draw(2)).sin() * (column * (0.2 + draw(3) * 0.3)).cos();
            let void = draw(100 + geometry.index(cell) as u32) < 0.02;
            if void { f32::NAN } else { (height_m * wave) as f32 }
        });
        let soils = geometry
            .cells()
            .map(|cell| (draw(1000 + geometry.index(cell) as u32 / 7) * 6.0) as u8);
        (
            Layer::new(geometry, heights.collect(), "z").unwrap(),
            Layer::new(geometry, soils.collect(), "soil").unwrap(),
        )
    }

    fn ground<'a>(elevation: &'a Layer<f32>, soil: &'a Layer<u8>, vehicle: &'a Vehicle, goal: Cell) -> Ground<'a> {
        let goal = elevation.geometry().centre(goal);
        let known = |index: usize| elevation.data()[index].is_finite();
        Ground::new(elevation.view(), Some(soil.view()), vehicle, 18.0, known, None, goal)
    }

    proptest! {
        #[test]
        fn an_edge_costs_what_its_segment_costs(seed: u64, height in 1.0f64..30.0, large: bool) {
            let (elevation, soil) = hills(seed, height);
            let vehicle = if large { tractor() } else { pioneer() };
            let ground = ground(&elevation, &soil, &vehicle, Cell::new(0, 0));
            let geometry = ground.geometry();
            for cell in geometry.cells() {
                for (k, step) in SIXTEEN.iter().enumerate() {
                    let edge = ground.edge_cost(cell, k);
                    let Some(near) = step.from(&geometry, cell) else {
                        prop_assert!(edge.is_infinite());
                        continue;
                    };
                    match ground.segment(geometry.centre(cell), geometry.centre(near)) {
                        Ok(facts) => prop_assert!((edge - facts.cost).abs() < 1e-9 * facts.cost, "{edge} {facts:?}"),
                        Err(obstacle) => prop_assert!(edge.is_infinite(), "{edge} {obstacle:?}"),
                    }
                }
            }
        }

        #[test]
        fn ways_are_optimal_and_shortcuts_keep_every_limit_and_never_cost_more(
            seed: u64, height in 1.0f64..30.0, a in 0usize..360, b in 0usize..360, large: bool,
        ) {
            let (elevation, soil) = hills(seed, height);
            let vehicle = if large { tractor() } else { pioneer() };
            let geometry = elevation.geometry();
            let (start, goal) = (geometry.cell(a), geometry.cell(b));
            let ground = ground(&elevation, &soil, &vehicle, goal);
            let field = cost_field(&ground, start, &mut silent()).unwrap();
            match search(&ground, start, goal, &mut silent()) {
                Search::Unreachable => prop_assert!(field[b].is_infinite()),
                Search::Stopped => prop_assert!(false),
                Search::Found { cells, cost } => {
                    prop_assert!((cost - field[b]).abs() <= 1e-9 * cost);
                    let bound = ground.least_cost_per_m() * geometry.centre(start).distance_m(geometry.centre(goal));
                    prop_assert!(cost >= bound * (1.0 - 1e-9));
                    let centres: Vec<_> = cells.iter().map(|&cell| geometry.centre(cell)).collect();
                    let points = shorten(&ground, &centres);
                    let mut total = 0.0;
                    for pair in points.windows(2) {
                        let facts = ground.segment(pair[0], pair[1]);
                        prop_assert!(facts.is_ok(), "{:?}", facts);
                        let facts = facts.unwrap();
                        prop_assert!(facts.grade_max <= vehicle.grade_up + 1e-6);
                        prop_assert!(facts.grade_min >= -vehicle.grade_down - 1e-6);
                        prop_assert!(facts.side_slope_max <= vehicle.side_slope + 1e-6);
                        total += facts.cost;
                    }
                    prop_assert!(total <= cost * (1.0 + 1e-9));
                    prop_assert_eq!((points[0], points[points.len() - 1]), (centres[0], centres[centres.len() - 1]));
                }
            }
        }
    }

    #[test]
    fn uphill_takes_longer_than_downhill_and_both_have_limits() {
        let geometry = GridGeometry::new(5, 40, 10.0, 0.0, 0.0).unwrap();
        let ramp = |grade: f64| {
            let data = geometry.cells().map(|c| (grade * 10.0 * c.column as f64) as f32);
            Layer::new(geometry, data.collect(), "ramp").unwrap()
        };
        let soil = Layer::filled(geometry, SoilClass::Gravel as u8);
        let vehicle = Vehicle {
            power_w: 40.0,
            ..pioneer()
        };
        let drive = |grade, from, to| {
            let elevation = ramp(grade);
            let ground = ground(&elevation, &soil, &vehicle, Cell::new(2, 0));
            let [from, to] = [from, to].map(|column| geometry.centre(Cell::new(2, column)));
            ground.segment(from, to)
        };
        let (up, down) = (drive(0.2, 3, 30).unwrap(), drive(0.2, 30, 3).unwrap());
        assert!(up.time_s > 1.01 * down.time_s && up.energy_j > down.energy_j);
        approx::assert_relative_eq!(up.climb_m, 54.0, epsilon = 1e-3);
        approx::assert_relative_eq!(up.grade_max, 0.2, epsilon = 1e-5);
        // 28 % is beyond the limit uphill and within it downhill.
        assert!(matches!(drive(0.28, 3, 30), Err(Obstacle::Grade(_, _))));
        assert!(drive(0.28, 30, 3).is_ok());
    }

    #[test]
    fn side_slopes_bind_across_and_not_along() {
        let geometry = GridGeometry::new(20, 20, 10.0, 0.0, 0.0).unwrap();
        let data = geometry.cells().map(|c| (0.23 * 10.0 * c.column as f64) as f32);
        let elevation = Layer::new(geometry, data.collect(), "slope").unwrap();
        let (vehicle, soil) = (pioneer(), Layer::filled(geometry, 1u8));
        let ground = ground(&elevation, &soil, &vehicle, Cell::new(0, 0));
        let centre = |row, column| geometry.centre(Cell::new(row, column));
        assert!(ground.segment(centre(5, 5), centre(5, 15)).is_ok());
        assert!(matches!(
            ground.segment(centre(5, 5), centre(15, 5)),
            Err(Obstacle::SideSlope(_, slope)) if (slope - 0.23).abs() < 1e-4
        ));
    }
}
