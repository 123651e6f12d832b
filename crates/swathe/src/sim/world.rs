//! The world as it is: ground, obstacles and what moves.

use crate::grid::{Layer, Position};
use crate::sensor::Pose;
use crate::soil::{SoilClass, check_moisture};
use crate::vehicle::Vehicle;

use super::noise::Noise;
use super::{Footprint, Ground, NoGo, Obstacle, Relief, Shape, SimError, TruthErrors, require};

/// A disc (a person, an animal, another vehicle) that goes to and fro along a path.
#[derive(Clone, Debug, PartialEq)]
pub struct Mover {
    /// Points of the path, at least one.
    pub path: Vec<Position>,
    /// Speed along it in m/s.
    pub speed_mps: f64,
    /// Radius in metres.
    pub radius_m: f64,
    /// Metres along the path at time 0.
    pub start_m: f64,
}

impl Mover {
    /// Where it is at a time: a function of time alone.
    pub fn at(&self, time_s: f64) -> Position {
        let length_m: f64 = self.path.windows(2).map(|pair| pair[0].distance_m(pair[1])).sum();
        if length_m == 0.0 {
            return self.path[0];
        }
        let there_and_back = (self.start_m + self.speed_mps * time_s).rem_euclid(2.0 * length_m);
        let mut left_m = there_and_back.min(2.0 * length_m - there_and_back);
        for pair in self.path.windows(2) {
            let piece_m = pair[0].distance_m(pair[1]);
            if left_m <= piece_m && piece_m > 0.0 {
                return pair[0].towards(pair[1], left_m / piece_m);
            }
            left_m -= piece_m;
        }
        self.path[self.path.len() - 1]
    }

    /// Since when it has walked straight on at a time: negative infinity where it never turns.
    pub fn straight_since_s(&self, time_s: f64) -> f64 {
        let mut corners_m = vec![0.0];
        for pair in self.path.windows(2) {
            corners_m.push(corners_m[corners_m.len() - 1] + pair[0].distance_m(pair[1]));
        }
        let length_m = corners_m[corners_m.len() - 1];
        if length_m == 0.0 || self.speed_mps <= 0.0 {
            return f64::NEG_INFINITY;
        }
        let there_and_back_m = (self.start_m + self.speed_mps * time_s).rem_euclid(2.0 * length_m);
        let back_m = corners_m.iter().map(|corner_m| 2.0 * length_m - corner_m);
        let passed_m = corners_m
            .iter()
            .copied()
            .chain(back_m)
            .filter(|&corner_m| corner_m <= there_and_back_m);
        time_s - (there_and_back_m - passed_m.fold(0.0, f64::max)) / self.speed_mps
    }

    fn validate(&self) -> Result<(), SimError> {
        require(
            "number of points of a path",
            self.path.len() as f64,
            !self.path.is_empty(),
            "give at least one",
        )?;
        for point in &self.path {
            require("easting of a path", point.x_m, true, "it must be finite")?;
            require("northing of a path", point.y_m, true, "it must be finite")?;
        }
        require(
            "speed of what moves",
            self.speed_mps,
            self.speed_mps >= 0.0,
            "it must not be below 0 m/s",
        )?;
        require(
            "radius of what moves",
            self.radius_m,
            self.radius_m > 0.0,
            "it must be above 0 m",
        )?;
        require("start along a path", self.start_m, true, "it must be finite")
    }
}

/// The truth.
#[derive(Clone, Debug)]
pub struct World {
    relief: Relief,
    soil: Layer<u8>,
    moisture_percent: f64,
    obstacles: Vec<Obstacle>,
    tops_m: Vec<f64>,
    index: Buckets,
    movers: Vec<Mover>,
}

impl World {
    /// Ground without anything on it: true heights (NaN where there is no surface to know), true soil codes, and moisture in
    /// per cent of the dry weight.
    ///
    /// # Errors
    /// [`SimError`] when the layers do not share a geometry, or a soil code or the moisture is not usable.
    pub fn new(elevation_m: Layer<f32>, soil: Layer<u8>, moisture_percent: f64) -> Result<Self, SimError> {
        Layer::new(elevation_m.geometry(), vec![(); soil.data().len()], "the soil layer")?;
        for &code in soil.data() {
            SoilClass::from_code(code)?;
        }
        Ok(Self {
            relief: Relief::new(elevation_m),
            soil,
            moisture_percent: check_moisture(moisture_percent)?,
            obstacles: Vec::new(),
            tops_m: Vec::new(),
            index: Buckets::default(),
            movers: Vec::new(),
        })
    }

    /// The ground behind a map: the map with drawn errors.
    ///
    /// # Errors
    /// [`SimError`] as for [`World::new`], or when the errors are not usable.
    pub fn behind_map(
        elevation_m: &Layer<f32>,
        soil: &Layer<u8>,
        moisture_percent: f64,
        errors: &TruthErrors,
        seed: u64,
    ) -> Result<Self, SimError> {
        errors.validate()?;
        let noise = Noise::new(seed);
        Self::new(
            errors.heights(elevation_m, noise),
            errors.soil(soil, noise),
            moisture_percent,
        )
    }

    /// Puts obstacles into the world.
    ///
    /// # Errors
    /// [`SimError::Figure`] when a shape is not one or a height is not above 0.
    pub fn place(&mut self, obstacles: Vec<Obstacle>) -> Result<(), SimError> {
        for obstacle in &obstacles {
            obstacle.shape.validate()?;
            require(
                "height of an obstacle",
                obstacle.height_m,
                obstacle.height_m > 0.0,
                "it must be above 0 m",
            )?;
        }
        self.obstacles.extend(obstacles);
        self.settle();
        Ok(())
    }

    /// Sets things in motion.
    ///
    /// # Errors
    /// [`SimError::Figure`] when a path, speed or radius is not usable.
    pub fn set_in_motion(&mut self, movers: Vec<Mover>) -> Result<(), SimError> {
        movers.iter().try_for_each(Mover::validate)?;
        self.movers.extend(movers);
        Ok(())
    }

    /// Digs a ditch along a line: cells within half its width lie deeper by its depth. Ditches narrower than a cell show only
    /// where they pass its centre.
    ///
    /// # Errors
    /// [`SimError::Figure`] when the line has no point, or width or depth is not above 0.
    pub fn dig(&mut self, line: &[Position], width_m: f64, depth_m: f64) -> Result<(), SimError> {
        Shape::Wall(line.to_vec()).validate()?;
        require("width of a ditch", width_m, width_m > 0.0, "it must be above 0 m")?;
        require("depth of a ditch", depth_m, depth_m > 0.0, "it must be above 0 m")?;
        let geometry = self.geometry();
        let mut heights = self.relief.heights().clone();
        for (cell, height) in geometry.cells().zip(heights.data_mut()) {
            let centre = geometry.centre(cell);
            let nearest = line
                .windows(2)
                .map(|pair| centre.distance_to_segment_m(pair[0], pair[1]));
            if nearest.fold(f64::INFINITY, f64::min) <= width_m / 2.0 {
                *height -= depth_m as f32;
            }
        }
        self.relief = Relief::new(heights);
        self.settle();
        Ok(())
    }

    /// Tops of obstacles stand on the ground at their middle; off known ground they reach the sky.
    fn settle(&mut self) {
        let top = |obstacle: &Obstacle| {
            let ground = self.relief.height_m(obstacle.shape.middle());
            ground.map_or(f64::INFINITY, |height| height + obstacle.height_m)
        };
        self.tops_m = self.obstacles.iter().map(top).collect();
        self.index = Buckets::new(&self.obstacles);
    }

    /// Where the cells of the ground lie.
    pub fn geometry(&self) -> crate::grid::GridGeometry {
        self.relief.geometry()
    }

    /// The true surface.
    pub fn relief(&self) -> &Relief {
        &self.relief
    }

    /// True soil codes.
    pub fn soil(&self) -> &Layer<u8> {
        &self.soil
    }

    /// Moisture in per cent of the dry weight.
    pub fn moisture_percent(&self) -> f64 {
        self.moisture_percent
    }

    /// What stands.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    /// What moves.
    pub fn movers(&self) -> &[Mover] {
        &self.movers
    }

    /// Height above sea of the top of an obstacle.
    pub(super) fn top_m(&self, obstacle: usize) -> f64 {
        self.tops_m[obstacle]
    }

    /// Writes the numbers of the obstacles that may lie within `reach_m` of a point into `found`, rising.
    pub(super) fn near(&self, at: Position, reach_m: f64, found: &mut Vec<u32>) {
        self.index.query(at, reach_m, found);
    }

    /// Soil at a position; `Unknown` outside the map.
    pub fn soil_at(&self, at: Position) -> SoilClass {
        let cell = self.geometry().cell_at(at);
        cell.and_then(|cell| SoilClass::from_code(self.soil[cell]).ok())
            .unwrap_or(SoilClass::Unknown)
    }

    /// The ground under the corners of a vehicle, from which its attitude follows.
    ///
    /// # Errors
    /// [`NoGo::Outside`] where its middle lies outside the map, [`NoGo::Unknown`] where a corner's height is not known.
    pub fn ground_under(&self, vehicle: &Vehicle, pose: &Pose) -> Result<Ground, NoGo> {
        let middle = Position::new(pose.x_m, pose.y_m);
        if self.geometry().cell_at(middle).is_none() {
            return Err(NoGo::Outside);
        }
        let width_m = vehicle.gauge_m.unwrap_or(vehicle.width_m);
        let wheels = Footprint::new(pose, vehicle.length_m, width_m).corners();
        let mut heights_m = [0.0; 4];
        for (height_m, wheel) in heights_m.iter_mut().zip(wheels) {
            *height_m = self.relief.height_m(wheel).ok_or(NoGo::Unknown)?;
        }
        let [front_left, rear_left, rear_right, front_right] = heights_m;
        let rise_m = (front_left + front_right - rear_left - rear_right) / 2.0;
        let lift_m = (front_left + rear_left - front_right - rear_right) / 2.0;
        Ok(Ground {
            soil: self.soil_at(middle),
            height_m: heights_m.iter().sum::<f64>() / 4.0,
            pitch_rad: (rise_m / vehicle.length_m).atan(),
            roll_rad: (lift_m / width_m).atan(),
        })
    }

    /// Whether a vehicle meets something that stands or moves at a time. What is not higher than the step that the vehicle
    /// climbs does not count.
    pub fn collides(&self, vehicle: &Vehicle, pose: &Pose, time_s: f64) -> bool {
        let footprint = Footprint::of(vehicle, pose);
        let middle = Position::new(pose.x_m, pose.y_m);
        let reach_m = vehicle.circumscribed_radius_m();
        let mut near = Vec::new();
        self.near(middle, reach_m, &mut near);
        near.iter().any(|&n| {
            let obstacle = &self.obstacles[n as usize];
            obstacle.height_m > vehicle.step_height_m && footprint.meets(&obstacle.shape)
        }) || self.movers.iter().any(|mover| {
            let (centre, radius_m) = (mover.at(time_s), mover.radius_m);
            centre.distance_m(middle) <= radius_m + reach_m && footprint.meets(&Shape::Disc { centre, radius_m })
        })
    }

    /// Metres between a vehicle and the nearest thing that stands or moves at a time, 0 where they meet; `None` when nothing is
    /// within `reach_m`. What the vehicle climbs does not count.
    pub fn clearance_m(&self, vehicle: &Vehicle, pose: &Pose, time_s: f64, reach_m: f64) -> Option<f64> {
        let footprint = Footprint::of(vehicle, pose);
        let middle = Position::new(pose.x_m, pose.y_m);
        let mut near = Vec::new();
        self.near(middle, vehicle.circumscribed_radius_m() + reach_m, &mut near);
        let stands = near.iter().filter_map(|&n| {
            let obstacle = &self.obstacles[n as usize];
            (obstacle.height_m > vehicle.step_height_m).then(|| footprint.distance_m(&obstacle.shape))
        });
        let moves = self.movers.iter().map(|mover| {
            let (centre, radius_m) = (mover.at(time_s), mover.radius_m);
            footprint.distance_m(&Shape::Disc { centre, radius_m })
        });
        let least_m = stands.chain(moves).fold(f64::INFINITY, f64::min);
        (least_m <= reach_m).then_some(least_m)
    }

    /// Why a vehicle must not stand or drive (forwards) at a pose; `None` where it may.
    pub fn no_go(&self, vehicle: &Vehicle, pose: &Pose, time_s: f64) -> Option<NoGo> {
        if self.collides(vehicle, pose, time_s) {
            return Some(NoGo::Obstacle);
        }
        let ground = match self.ground_under(vehicle, pose) {
            Ok(ground) => ground,
            Err(reason) => return Some(reason),
        };
        let fares = crate::soil::Trafficability::of(vehicle, ground.soil, self.moisture_percent);
        let grade = ground.pitch_rad.tan();
        if !fares.go {
            Some(NoGo::Soil)
        } else if grade > vehicle.grade_up || -grade > vehicle.grade_down {
            Some(NoGo::Grade)
        } else if ground.roll_rad.tan().abs() > vehicle.max_side_slope() {
            Some(NoGo::SideSlope)
        } else {
            None
        }
    }
}

/// Side of a bucket in metres: a few obstacles each in clutter, few buckets to a scan.
const BUCKET_M: f64 = 4.0;

/// Most buckets in a row or column; a world beyond it gets larger buckets.
const MOST_BUCKETS: f64 = 1024.0;

/// Numbers of obstacles by where they lie.
#[derive(Clone, Debug, Default)]
struct Buckets {
    west_m: f64,
    south_m: f64,
    size_m: [f64; 2],
    columns: usize,
    rows: usize,
    members: Vec<Vec<u32>>,
}

impl Buckets {
    fn new(obstacles: &[Obstacle]) -> Self {
        let none = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        let all = obstacles.iter().fold(none, |all, obstacle| {
            let one = obstacle.shape.bounds();
            [
                all[0].min(one[0]),
                all[1].min(one[1]),
                all[2].max(one[2]),
                all[3].max(one[3]),
            ]
        });
        if obstacles.is_empty() {
            return Self::default();
        }
        let count = |span_m: f64| (span_m / BUCKET_M).ceil().clamp(1.0, MOST_BUCKETS);
        let (columns, rows) = (count(all[2] - all[0]), count(all[3] - all[1]));
        let side = |span_m: f64, count: f64| (span_m / count).max(BUCKET_M);
        let mut buckets = Self {
            west_m: all[0],
            south_m: all[1],
            size_m: [side(all[2] - all[0], columns), side(all[3] - all[1], rows)],
            columns: columns as usize,
            rows: rows as usize,
            members: vec![Vec::new(); columns as usize * rows as usize],
        };
        for (n, obstacle) in (0u32..).zip(obstacles) {
            let [columns, rows] = buckets.range(obstacle.shape.bounds());
            for row in rows[0]..=rows[1] {
                for column in columns[0]..=columns[1] {
                    buckets.members[row * buckets.columns + column].push(n);
                }
            }
        }
        buckets
    }

    /// First and last column and row of an area, brought inside.
    fn range(&self, [west, south, east, north]: [f64; 4]) -> [[usize; 2]; 2] {
        // A cast saturates, so that far places end up at the border.
        let column = |x: f64| (((x - self.west_m) / self.size_m[0]) as usize).min(self.columns - 1);
        let row = |y: f64| (((y - self.south_m) / self.size_m[1]) as usize).min(self.rows - 1);
        [[column(west), column(east)], [row(south), row(north)]]
    }

    fn query(&self, at: Position, reach_m: f64, found: &mut Vec<u32>) {
        found.clear();
        if self.members.is_empty() {
            return;
        }
        let area = [at.x_m - reach_m, at.y_m - reach_m, at.x_m + reach_m, at.y_m + reach_m];
        let [columns, rows] = self.range(area);
        for row in rows[0]..=rows[1] {
            for column in columns[0]..=columns[1] {
                found.extend(&self.members[row * self.columns + column]);
            }
        }
        found.sort_unstable();
        found.dedup();
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::grid::GridGeometry;
    use crate::sim::{Motion, Steering};
    use crate::vehicle::fixtures::pioneer;

    /// Ground of gravel, 40 m on a side around the origin, with a grade to the east.
    pub(in crate::sim) fn plain(grade: f64) -> World {
        let geometry = GridGeometry::new(80, 80, 0.5, -20.0, 20.0).unwrap();
        let heights = geometry
            .cells()
            .map(|cell| (geometry.centre(cell).x_m * grade) as f32)
            .collect();
        let elevation = Layer::new(geometry, heights, "heights").unwrap();
        World::new(elevation, Layer::filled(geometry, SoilClass::Gravel as u8), 20.0).unwrap()
    }

    /// What a small robot can.
    pub(in crate::sim) fn motion(steering: Steering) -> Motion {
        Motion {
            steering,
            max_acceleration_mps2: 0.5,
            max_braking_mps2: 0.8,
            max_turn_rate_radps: 1.5,
        }
    }

    #[test]
    fn a_mover_goes_to_and_fro_and_is_a_function_of_time() {
        let at = Position::new;
        let mover = Mover {
            path: vec![at(0.0, 0.0), at(3.0, 0.0), at(3.0, 4.0)],
            speed_mps: 2.0,
            radius_m: 0.3,
            start_m: 1.0,
        };
        assert_eq!(mover.at(0.0), at(1.0, 0.0));
        assert_eq!(mover.at(2.0), at(3.0, 2.0));
        assert_eq!(mover.at(4.0), at(3.0, 2.0));
        assert_eq!(mover.at(7.0), at(1.0, 0.0));
        // At a start, a corner and both ends.
        for (time_s, since_s) in [(0.0, -0.5), (2.0, 1.0), (4.0, 3.0), (6.75, 6.5)] {
            assert_eq!(mover.straight_since_s(time_s), since_s, "{time_s}");
        }
        let still = Mover {
            path: vec![at(5.0, 5.0)],
            ..mover
        };
        assert_eq!(still.at(100.0), at(5.0, 5.0));
        assert_eq!(still.straight_since_s(100.0), f64::NEG_INFINITY);
    }

    #[test]
    fn every_reason_of_no_go_is_found() {
        let vehicle = pioneer();
        let east = Pose::level(0.0, 0.0, 0.0);
        let north = Pose::level(0.0, 0.0, std::f64::consts::FRAC_PI_2);
        assert_eq!(plain(0.1).no_go(&vehicle, &east, 0.0), None);
        assert_eq!(plain(0.27).no_go(&vehicle, &east, 0.0), Some(NoGo::Grade));
        assert_eq!(plain(-0.27).no_go(&vehicle, &east, 0.0), None);
        assert_eq!(plain(-0.31).no_go(&vehicle, &east, 0.0), Some(NoGo::Grade));
        assert_eq!(plain(0.22).no_go(&vehicle, &north, 0.0), Some(NoGo::SideSlope));
        assert_eq!(
            plain(0.0).no_go(&vehicle, &Pose::level(21.0, 0.0, 0.0), 0.0),
            Some(NoGo::Outside)
        );
        let mut world = plain(0.0);
        world
            .place(vec![Obstacle {
                shape: Shape::Disc {
                    centre: Position::new(0.5, 0.0),
                    radius_m: 0.3,
                },
                height_m: 1.0,
            }])
            .unwrap();
        assert_eq!(world.no_go(&vehicle, &east, 0.0), Some(NoGo::Obstacle));
        assert_eq!(world.no_go(&vehicle, &Pose::level(-2.0, 0.0, 0.0), 0.0), None);
        let mut world = plain(0.0);
        world.soil.data_mut().fill(SoilClass::None as u8);
        assert_eq!(world.no_go(&vehicle, &east, 0.0), Some(NoGo::Soil));
        let mut heights = plain(0.0).relief.heights().clone();
        heights.data_mut().fill(f32::NAN);
        let void = World::new(heights, plain(0.0).soil, 20.0).unwrap();
        assert_eq!(void.no_go(&vehicle, &east, 0.0), Some(NoGo::Unknown));
    }

    #[test]
    fn a_low_thing_is_driven_over_and_a_mover_is_met_when_it_is_there() {
        let vehicle = pioneer();
        let here = Pose::level(0.0, 0.0, 0.0);
        let mut world = plain(0.0);
        let shape = Shape::rectangle(Position::new(0.0, 0.0), 0.2, 0.2, 0.0);
        world
            .place(vec![Obstacle {
                shape,
                height_m: vehicle.step_height_m,
            }])
            .unwrap();
        assert!(!world.collides(&vehicle, &here, 0.0));
        let path = vec![Position::new(0.0, 5.0), Position::new(0.0, -5.0)];
        world
            .set_in_motion(vec![Mover {
                path,
                speed_mps: 1.0,
                radius_m: 0.3,
                start_m: 0.0,
            }])
            .unwrap();
        assert!(!world.collides(&vehicle, &here, 0.0) && world.collides(&vehicle, &here, 5.0));
    }

    #[test]
    fn a_ditch_lies_deeper_and_stops_who_cannot_cross_it() {
        let mut world = plain(0.0);
        world
            .dig(&[Position::new(2.0, -20.0), Position::new(2.0, 20.0)], 1.0, 1.0)
            .unwrap();
        assert_eq!(world.relief.height_m(Position::new(1.75, 0.25)), Some(-1.0));
        assert_eq!(world.relief.height_m(Position::new(0.25, 0.25)), Some(0.0));
        assert_eq!(
            world.no_go(&pioneer(), &Pose::level(1.5, 0.0, 0.0), 0.0),
            Some(NoGo::Grade)
        );
        assert!(world.dig(&[], 1.0, 1.0).is_err() && world.dig(&[Position::new(0.0, 0.0); 2], -1.0, 1.0).is_err());
    }

    #[test]
    fn layers_that_do_not_fit_and_soils_that_are_none_are_refused() {
        let elevation = || plain(0.0).relief.heights().clone();
        let other = GridGeometry::new(2, 2, 1.0, 0.0, 0.0).unwrap();
        assert!(World::new(elevation(), Layer::filled(other, 1), 20.0).is_err());
        assert!(World::new(elevation(), Layer::filled(elevation().geometry(), 9), 20.0).is_err());
        assert!(World::new(elevation(), Layer::filled(elevation().geometry(), 1), f64::NAN).is_err());
    }

    proptest::proptest! {
        #[test]
        fn the_index_finds_whatever_is_within_reach(
            places in proptest::collection::vec((-50.0f64..50.0, -50.0f64..50.0, 0.1f64..9.0), 1..40),
            x in -80.0f64..80.0, y in -80.0f64..80.0, reach in 0.1f64..30.0,
        ) {
            let disc = |&(x, y, radius_m): &(f64, f64, f64)| Obstacle {
                shape: Shape::Disc { centre: Position::new(x, y), radius_m }, height_m: 1.0,
            };
            let obstacles: Vec<Obstacle> = places.iter().map(disc).collect();
            let mut found = Vec::new();
            Buckets::new(&obstacles).query(Position::new(x, y), reach, &mut found);
            for (n, obstacle) in (0u32..).zip(&obstacles) {
                let near = obstacle.shape.distance_m(Position::new(x, y)) <= reach;
                proptest::prop_assert!(!near || found.contains(&n));
            }
        }
    }
}
