//! What the laser met too seldom for the certainty grid to be sure of: a corner that it grazed in passing stands there all the same.

use std::collections::{BTreeMap, VecDeque};

use crate::grid::Position;
use crate::local::CertaintyGrid;
use crate::sensor::{Pose, Return, Scan};

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

/// A beam that goes on by so many metres has not met what was met there before.
const BEYOND_M: f64 = 0.1;

/// Returns that may be of something that the certainty grid does not hold.
#[derive(Clone, Debug, Default)]
pub(super) struct Glimpses {
    /// Where each of the last scans met something, by its time.
    fresh: VecDeque<(f64, Vec<Position>)>,
    /// Where the last one older than those did.
    before: Vec<Position>,
    /// Older ones that nothing has confirmed or contradicted since, by time and place.
    kept: BTreeMap<(i64, i64), (f64, Position)>,
}

impl Glimpses {
    /// Notes where a scan met something, `told` by its beams, and what it shows of older returns within reach of the robot.
    pub fn note(
        &mut self,
        time_s: f64,
        (pose, scan): (&Pose, &Scan),
        told: &[Return],
        grid: &CertaintyGrid,
        reach_m: f64,
    ) {
        let sensor = pose.of_mount(&scan.mount);
        let from = Position::new(sensor.x_m, sensor.y_m);
        let goes_beyond = |place: Position| {
            let away_m = from.distance_m(place);
            let bearing_rad = (place.y_m - from.y_m).atan2(place.x_m - from.x_m) - sensor.heading_rad;
            // Both beams beside it: what is thin may stand between them.
            scan.beam_at(bearing_rad).is_some_and(|beam| {
                [beam.floor(), beam.ceil()].into_iter().all(|beam| {
                    let is_beam = beam >= 0.0 && (beam as usize) < told.len();
                    is_beam
                        && match told[beam as usize] {
                            Return::Obstacle { range_m } | Return::Ground { range_m } | Return::Clear { range_m } => {
                                range_m > away_m + BEYOND_M
                            }
                            Return::Invalid => false,
                        }
                })
            })
        };
        let at = Position::new(pose.x_m, pose.y_m);
        let counts = |place: Position| {
            let is_sure = || {
                grid.certainty_at(place.x_m, place.y_m)
                    .is_some_and(|certainty| certainty >= SURE)
            };
            at.distance_m(place) <= reach_m && !is_sure() && !goes_beyond(place)
        };
        self.kept
            .retain(|_, &mut (then, place)| (0.0..=KEPT_S).contains(&(time_s - then)) && counts(place));
        let places = told.iter().enumerate().filter_map(|(beam, told)| {
            let &Return::Obstacle { range_m } = told else {
                return None;
            };
            let (sin, cos) = (sensor.heading_rad + scan.beam_rad(beam)).sin_cos();
            Some(Position::new(from.x_m + cos * range_m, from.y_m + sin * range_m))
        });
        self.fresh.push_back((time_s, places.collect()));
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
                let key = [place.x_m, place.y_m].map(|along| (along / APART_M).floor() as i64);
                self.kept.insert((key[0], key[1]), (then, place));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::local::CertaintyParams;
    use crate::sensor::Mount;

    /// Three beams half a right angle apart, from the origin; only the middle one meets something.
    fn look(glimpses: &mut Glimpses, time_s: f64, heading_rad: f64, middle_m: f64, grid: &CertaintyGrid) {
        let scan = Scan {
            ranges_m: vec![20.0, middle_m, 20.0],
            angle_min_rad: -std::f64::consts::FRAC_PI_4,
            angle_increment_rad: std::f64::consts::FRAC_PI_4,
            range_min_m: 0.1,
            range_max_m: 20.0,
            mount: Mount::default(),
        };
        let told: Vec<Return> = (0..3).map(|beam| scan.beam(beam)).collect();
        glimpses.note(time_s, (&Pose::level(0.0, 0.0, heading_rad), &scan), &told, grid, 8.0);
    }

    fn nothing() -> CertaintyGrid {
        CertaintyGrid::new(CertaintyParams::default(), 0.0, 0.0)
    }

    const BACK_RAD: f64 = std::f64::consts::PI;

    #[test]
    fn what_was_glimpsed_counts_while_nobody_looks_there_again() {
        let (mut glimpses, grid) = (Glimpses::default(), nothing());
        look(&mut glimpses, 0.0, 0.0, 3.0, &grid);
        look(&mut glimpses, 0.02, 0.0, 3.0, &grid);
        look(&mut glimpses, 1.01, BACK_RAD, 20.0, &grid);
        for k in 11..100 {
            look(&mut glimpses, 0.1 * f64::from(k), BACK_RAD, 20.0, &grid);
            assert_eq!(glimpses.places().count(), 1, "{k}");
        }
        // In the same direction, but nearer, something hides it.
        look(&mut glimpses, 10.0, 0.0, 2.0, &grid);
        assert!(glimpses.places().any(|place| (place.x_m - 3.0).abs() < 1e-9));
        look(&mut glimpses, 12.0, 0.0, 20.0, &grid);
        assert_eq!(glimpses.places().count(), 0);
    }

    #[test]
    fn it_is_let_go_when_it_is_old_or_far_or_known() {
        for (time_s, heading_rad, x_m, known, expected) in [
            (29.0, BACK_RAD, 3.0, false, 1),
            (31.0, BACK_RAD, 3.0, false, 0),
            (2.0, BACK_RAD, 9.0, false, 0),
            (2.0, BACK_RAD, 3.0, true, 0),
        ] {
            let (mut glimpses, mut grid) = (Glimpses::default(), nothing());
            look(&mut glimpses, 0.0, 0.0, x_m, &grid);
            look(&mut glimpses, 0.02, 0.0, x_m, &grid);
            look(&mut glimpses, 1.5, heading_rad, 20.0, &grid);
            if known {
                grid.stamp(x_m, 0.0);
            }
            look(&mut glimpses, time_s, heading_rad, 20.0, &grid);
            assert_eq!(glimpses.places().count(), expected, "{time_s} {x_m} {known}");
        }
    }

    #[test]
    fn what_only_one_scan_met_counts_for_a_second() {
        let (mut glimpses, grid) = (Glimpses::default(), nothing());
        for (k, middle_m) in [20.0, 3.0, 20.0, 4.0, 3.0].into_iter().enumerate() {
            look(&mut glimpses, 0.02 * k as f64, 0.0, middle_m, &grid);
        }
        look(&mut glimpses, 1.0, BACK_RAD, 20.0, &grid);
        assert_eq!(glimpses.places().count(), 3);
        look(&mut glimpses, 5.0, BACK_RAD, 20.0, &grid);
        assert_eq!(glimpses.places().count(), 0);
    }

    #[test]
    fn the_same_place_seen_again_and_again_is_one() {
        let (mut glimpses, grid) = (Glimpses::default(), nothing());
        for k in 0..30 {
            look(&mut glimpses, 0.02 * f64::from(k), 0.0, 3.0, &grid);
        }
        assert_eq!(glimpses.places().count(), 30);
        look(&mut glimpses, 5.0, BACK_RAD, 20.0, &grid);
        assert_eq!(glimpses.places().count(), 1);
    }
}
