//! What the laser met too seldom for the certainty grid to be sure of: a corner that it grazed in passing stands there all the same.

use std::collections::{BTreeMap, VecDeque};

use crate::grid::Position;
use crate::local::CertaintyGrid;
use crate::sensor::{Pose, Return, Scan};

use super::params::Shape;
use super::sense::SURE;

/// The last scans whose every return counts, and for how many seconds.
const FRESH_SCANS: usize = 40;
const FRESH_S: f64 = 1.0;

/// What has left the sensor's view since counts for so many seconds.
const KEPT_S: f64 = 30.0;

/// Only what two scans running met within so many metres of each other is kept so long: a single return may be of nothing.
const AGAIN_M: f64 = 0.15;

/// Returns nearer to each other than this in metres are one.
const APART_M: f64 = 0.02;

/// Distance of the places that stand for a face between two returns, and how far beyond its own size the robot looks for faces.
const BETWEEN_M: f64 = 0.05;
const NEAR_M: f64 = 1.0;

/// A beam that goes on by so many metres has not met what was met there before.
const BEYOND_M: f64 = 0.1;

/// Returns that may be of something that the certainty grid does not hold.
#[derive(Clone, Debug, Default)]
pub(super) struct Unconfirmed {
    /// Where each of the last scans met something, by its time.
    fresh: VecDeque<(f64, Vec<Position>)>,
    /// Where the last one older than those did.
    before: Vec<Position>,
    /// Older ones that nothing has confirmed or contradicted since, by time and place.
    kept: BTreeMap<(i64, i64), (f64, Position)>,
}

impl Unconfirmed {
    /// Takes in where a scan met something, `told` by its beams, and what it shows of older returns within reach of the robot.
    /// Returns of neighbouring beams near to the robot that are no farther apart than half its width are of one face.
    pub fn observe(
        &mut self,
        time_s: f64,
        (pose, scan): (&Pose, &Scan),
        told: &[Return],
        grid: &CertaintyGrid,
        shape: &Shape,
    ) {
        let reach_m = shape.reach_m();
        let near_m = reach_m.min(2.0 * shape.radius_m + NEAR_M);
        let sensor = pose.of_mount(&scan.mount);
        let from = Position::new(sensor.x_m, sensor.y_m);
        let goes_beyond = |place: Position| {
            let away_m = from.distance_m(place);
            let bearing_rad = (place.y_m - from.y_m).atan2(place.x_m - from.x_m) - sensor.heading_rad;
            // Both beams beside it: what is thin may stand between them.
            scan.beam_at(bearing_rad).is_some_and(|beam| {
                [beam.floor(), beam.ceil()].into_iter().all(|beam| {
                    let told = (beam >= 0.0).then(|| told.get(beam as usize)).flatten();
                    told.and_then(|told| told.range_m())
                        .is_some_and(|range_m| range_m > away_m + BEYOND_M)
                })
            })
        };
        let at = Position::new(pose.x_m, pose.y_m);
        let counts = |place: Position| {
            let is_known = || grid.is_met_at(place.x_m, place.y_m, SURE);
            at.distance_m(place) <= reach_m && !is_known() && !goes_beyond(place)
        };
        self.kept
            .retain(|_, &mut (then, place)| (0.0..=KEPT_S).contains(&(time_s - then)) && counts(place));
        let mut places = Vec::new();
        let mut last: Option<Position> = None;
        for (beam, told) in told.iter().enumerate() {
            let &Return::Obstacle { range_m } = told else {
                last = None;
                continue;
            };
            let place = scan.end_of(beam, range_m, &sensor);
            // Nobody has seen what lies between two neighbouring beams that graze a face: a corner of the body would find room.
            if let Some(last) = last.filter(|last| (BETWEEN_M..=shape.half_width_m).contains(&last.distance_m(place)))
                && at.distance_m(place) <= near_m
            {
                let pieces = (last.distance_m(place) / BETWEEN_M).ceil();
                let between = (1..pieces as usize).map(|piece| last.towards(place, piece as f64 / pieces));
                for place in between.filter(|&place| !grid.is_met_at(place.x_m, place.y_m, SURE)) {
                    self.kept.insert(key_of(place), (time_s, place));
                }
            }
            places.push(place);
            last = Some(place);
        }
        self.fresh.push_back((time_s, places));
        let is_old = |then: f64| then < time_s - FRESH_S;
        while self.fresh.len() > FRESH_SCANS || self.fresh.front().is_some_and(|&(then, _)| is_old(then)) {
            let Some((then, places)) = self.fresh.pop_front() else {
                break;
            };
            let next = self.fresh.front().map_or(&[][..], |(_, places)| places);
            let is_twice = |place: Position| {
                let mut others = self.before.iter().chain(next);
                others.any(|other| other.distance_m(place) <= AGAIN_M)
            };
            for &place in places.iter().filter(|&&place| counts(place) && is_twice(place)) {
                self.kept.insert(key_of(place), (then, place));
            }
            self.before = places;
        }
    }

    /// All of them, those that were confirmed within the last second too.
    pub fn places(&self) -> impl Iterator<Item = Position> {
        let fresh = self.fresh.iter().flat_map(|(_, places)| places).copied();
        fresh.chain(self.kept.values().map(|&(_, place)| place))
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.fresh.clear();
        self.before.clear();
        self.kept.clear();
    }
}

fn key_of(place: Position) -> (i64, i64) {
    let along = |metres: f64| (metres / APART_M).floor() as i64;
    (along(place.x_m), along(place.y_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::local::CertaintyParams;
    use crate::sensor::Mount;

    /// Three beams half a right angle apart, of which only the middle one meets something.
    fn fan(middle_m: f64) -> Scan {
        Scan {
            ranges_m: vec![20.0, middle_m, 20.0],
            angle_min_rad: -std::f64::consts::FRAC_PI_4,
            angle_increment_rad: std::f64::consts::FRAC_PI_4,
            range_min_m: 0.1,
            range_max_m: 20.0,
            mount: Mount::default(),
        }
    }

    /// Reaches 8 m, looks for faces to 4 m, and is 1 m wide.
    fn shape() -> Shape {
        Shape {
            half_length_m: 1.0,
            half_width_m: 0.5,
            radius_m: 1.5,
            max_speed_mps: 4.0,
            max_turn_rate_radps: 1.0,
            turn_radius_m: 0.0,
            reaction_s: 0.75,
            braking_friction: 0.6,
            braking_mps2: 2.0,
            acceleration_mps2: 1.0,
        }
    }

    /// A look from the origin.
    fn look(unconfirmed: &mut Unconfirmed, time_s: f64, heading_rad: f64, middle_m: f64, grid: &CertaintyGrid) {
        let (pose, scan) = (Pose::level(0.0, 0.0, heading_rad), fan(middle_m));
        let told: Vec<Return> = (0..3).map(|beam| scan.beam(beam)).collect();
        unconfirmed.observe(time_s, (&pose, &scan), &told, grid, &shape());
    }

    fn nothing() -> CertaintyGrid {
        CertaintyGrid::new(CertaintyParams::default(), 0.0, 0.0)
    }

    const BACK_RAD: f64 = std::f64::consts::PI;

    #[test]
    fn what_was_grazed_counts_while_nobody_looks_there_again() {
        let (mut unconfirmed, grid) = (Unconfirmed::default(), nothing());
        look(&mut unconfirmed, 0.0, 0.0, 3.0, &grid);
        look(&mut unconfirmed, 0.02, 0.0, 3.0, &grid);
        look(&mut unconfirmed, 1.01, BACK_RAD, 20.0, &grid);
        for k in 11..100 {
            look(&mut unconfirmed, 0.1 * f64::from(k), BACK_RAD, 20.0, &grid);
            assert_eq!(unconfirmed.places().count(), 1, "{k}");
        }
        // In the same direction, but nearer, something hides it.
        look(&mut unconfirmed, 10.0, 0.0, 2.0, &grid);
        assert!(unconfirmed.places().any(|place| (place.x_m - 3.0).abs() < 1e-9));
        look(&mut unconfirmed, 12.0, 0.0, 20.0, &grid);
        assert_eq!(unconfirmed.places().count(), 0);
    }

    #[test]
    fn it_is_let_go_when_it_is_old_or_far_or_known() {
        for (time_s, heading_rad, x_m, known, expected) in [
            (29.0, BACK_RAD, 3.0, false, 1),
            (31.0, BACK_RAD, 3.0, false, 0),
            (2.0, BACK_RAD, 9.0, false, 0),
            (2.0, BACK_RAD, 3.0, true, 0),
        ] {
            let (mut unconfirmed, mut grid) = (Unconfirmed::default(), nothing());
            look(&mut unconfirmed, 0.0, 0.0, x_m, &grid);
            look(&mut unconfirmed, 0.02, 0.0, x_m, &grid);
            look(&mut unconfirmed, 1.5, heading_rad, 20.0, &grid);
            if known {
                for _ in 0..4 {
                    let scan = fan(x_m);
                    grid.observe(&Pose::default(), &scan, |beam| scan.beam(beam));
                }
            }
            look(&mut unconfirmed, time_s, heading_rad, 20.0, &grid);
            assert_eq!(unconfirmed.places().count(), expected, "{time_s} {x_m} {known}");
        }
    }

    #[test]
    fn what_only_one_scan_met_counts_for_a_second() {
        let (mut unconfirmed, grid) = (Unconfirmed::default(), nothing());
        for (k, middle_m) in [20.0, 3.0, 20.0, 4.0, 3.0].into_iter().enumerate() {
            look(&mut unconfirmed, 0.02 * k as f64, 0.0, middle_m, &grid);
        }
        look(&mut unconfirmed, 1.0, BACK_RAD, 20.0, &grid);
        assert_eq!(unconfirmed.places().count(), 3);
        look(&mut unconfirmed, 5.0, BACK_RAD, 20.0, &grid);
        assert_eq!(unconfirmed.places().count(), 0);
    }

    #[test]
    fn between_neighbouring_returns_near_by_there_is_a_face() {
        for (ranges_m, expected) in [([2.0, 2.4], 8), ([2.0, 2.6], 0), ([5.0, 5.4], 0), ([2.0, 20.0], 0)] {
            let (mut unconfirmed, grid) = (Unconfirmed::default(), nothing());
            let scan = Scan {
                ranges_m: ranges_m.to_vec(),
                angle_min_rad: 0.0,
                angle_increment_rad: 0.02,
                range_min_m: 0.1,
                range_max_m: 20.0,
                mount: Mount::default(),
            };
            let told: Vec<Return> = (0..2).map(|beam| scan.beam(beam)).collect();
            let met = told
                .iter()
                .filter(|told| matches!(told, Return::Obstacle { .. }))
                .count();
            unconfirmed.observe(0.0, (&Pose::default(), &scan), &told, &grid, &shape());
            assert_eq!(unconfirmed.places().count(), met + expected, "{ranges_m:?}");
            // They stay when the robot has turned away.
            look(&mut unconfirmed, 5.0, BACK_RAD, 20.0, &grid);
            assert_eq!(unconfirmed.places().count(), expected, "{ranges_m:?}");
        }
    }

    #[test]
    fn the_same_place_seen_again_and_again_is_one() {
        let (mut unconfirmed, grid) = (Unconfirmed::default(), nothing());
        for k in 0..30 {
            look(&mut unconfirmed, 0.02 * f64::from(k), 0.0, 3.0, &grid);
        }
        assert_eq!(unconfirmed.places().count(), 30);
        look(&mut unconfirmed, 5.0, BACK_RAD, 20.0, &grid);
        assert_eq!(unconfirmed.places().count(), 1);
    }
}
