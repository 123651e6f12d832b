//! Tracks of what moves, from scans alone.
//!
//! A return that lies where an earlier scan of the last seconds looked through is new: something came there. Returns that lie
//! together make a cluster; a cluster that is mostly new begins a track, which a Kalman filter of constant velocity (Kalman 1960;
//! Bar-Shalom and Fortmann 1988) carries on from the nearest new cluster of each scan. What stands is new nowhere and becomes
//! none. What leaves the fan of the sensor, or is hidden, is carried on for some seconds.
//!
//! All of it goes by a pose that does not jump when the told one is corrected.

use std::collections::VecDeque;

use crate::sensor::{Pose, Return, Scan, wrap};

/// Farthest returns that are looked at.
const FAR_M: f64 = 12.0;

/// Earlier scans are kept every so many seconds, for so long; those younger than the least tell nothing yet.
const PAST_STEP_S: f64 = 0.2;
const PAST_S: f64 = 1.7;
const PAST_LEAST_S: f64 = 0.3;

/// A beam that went on for this much has looked through a place; one that ended this near has met something there.
const THROUGH_M: f64 = 0.2;

/// The beams of an earlier scan that pass this near beside a place tell of it, and at least one on each side: the pose drifts while
/// scans are kept.
const BESIDE_M: f64 = 0.06;

/// Returns nearer together than this, or than so many beams lie apart at their range, are of one thing.
const ONE_M: f64 = 0.22;
const ONE_BEAMS: f64 = 2.5;

/// Widest thing that walks or drives about here: wider ones are walls.
const WIDEST_M: f64 = 1.3;

/// Share of the known returns of a cluster that must be new to begin and to go on with a track, and how many to begin.
const NEW_TO_BEGIN: f64 = 0.5;
const NEW_TO_GO_ON: f64 = 0.2;
const LEAST_NEW: usize = 2;

/// The same share, of the returns where something is known, for a cluster of which only a part is seen to tell that its track moves.
const NEW_IF_CUT: f64 = 0.9;

/// Half the size of a thing, in metres: what is seen of it is its front.
const HALF_M: [f64; 2] = [0.3, 0.6];

/// Points that tell where a round thing is, steps of the search for it, and how far they may lie off it.
const LEAST_ROUND: usize = 4;
const ROUNDS: usize = 5;
const ROUND_M: f64 = 0.05;

/// Deviation of a cluster's middle, and the density of the noise by which what moves changes its speed, in m²/s³.
const PLACE_M: f64 = 0.08;
const WHIM: f64 = 0.03;

/// Deviation of the middle of a cluster that is cut by the fan's edge or by something nearer by this much: a round one, another.
const CUT_PLACE_M: [f64; 2] = [0.15, 0.6];
const CUT_M: f64 = 0.15;

/// Farthest that a cluster may lie from where its track is expected.
const GATE_M: [f64; 2] = [0.3, 0.8];

/// What makes a track one of a thing that moves: scans, metres from where it began, speeds, and the deviation of its speed.
const LEAST_SCANS: u32 = 6;
const LEAST_WAY_M: f64 = 0.2;
const SPEEDS_MPS: [f64; 2] = [0.22, 3.0];
const UNSURE_MPS: f64 = 0.35;

/// Scans that look through the place of a track until it is given up, seconds without sight of it, before and after it is sure, and
/// the doubt of its place.
const MISSES: u32 = 8;
const UNSEEN_S: [f64; 2] = [0.3, 25.0];
const MOST_UNSURE_M: f64 = 12.0;

/// Tracks nearer together than this are of one thing.
const TWINS_M: f64 = 0.35;

/// A thing that moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mover {
    pub x_m: f64,
    pub y_m: f64,
    pub east_mps: f64,
    pub north_mps: f64,
    /// Half its size, and the deviation of its place.
    pub half_m: f64,
    pub unsure_m: f64,
    /// Seconds since it was seen.
    pub unseen_s: f64,
}

/// An earlier scan.
#[derive(Clone, Debug)]
struct Past {
    time_s: f64,
    sensor: Pose,
    angle_min_rad: f64,
    angle_increment_rad: f64,
    /// What the beams told: how far they are free, and whether they met something there; NaN for nothing.
    beams: Vec<(f64, bool)>,
}

/// What an earlier scan tells of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    Free,
    Taken,
    Nothing,
}

impl Past {
    /// What the beams next to a place tell of it.
    fn tells(&self, (x_m, y_m): (f64, f64)) -> Told {
        let (dx, dy) = (x_m - self.sensor.x_m, y_m - self.sensor.y_m);
        // For every point of a scan and every earlier scan, so not by the slower hypot.
        let away_m = (dx * dx + dy * dy).sqrt();
        let off_rad = wrap(dy.atan2(dx) - self.sensor.heading_rad - self.angle_min_rad);
        let turn = std::f64::consts::TAU;
        let count = self.beams.len() as f64;
        let place = [off_rad, off_rad + turn, off_rad - turn]
            .map(|off_rad| off_rad / self.angle_increment_rad)
            .into_iter()
            .find(|place| (0.0..=count - 1.0).contains(place));
        let Some(place) = place else { return Told::Nothing };
        let beside = (BESIDE_M / (away_m * self.angle_increment_rad.abs())).clamp(1.0, count) as usize;
        let before = place.floor() as usize;
        let asked = self
            .beams
            .iter()
            .take(before + beside + 2)
            .skip(before.saturating_sub(beside));
        let (mut through, mut known) = (0, 0);
        for &(free_m, is_hit) in asked {
            if free_m.is_nan() {
                continue;
            }
            known += 1;
            if is_hit && (free_m - away_m).abs() < THROUGH_M {
                return Told::Taken;
            }
            through += u32::from(free_m > away_m + THROUGH_M);
        }
        if known >= 2 && through == known {
            Told::Free
        } else {
            Told::Nothing
        }
    }

    /// Whether a thing that ends at a beam may go on behind something nearer, or beyond the fan.
    fn cuts(&self, beam: usize, side: isize, range_m: f64) -> bool {
        let mut next = beam;
        loop {
            match next.checked_add_signed(side).filter(|&next| next < self.beams.len()) {
                None => return true,
                Some(at) if self.beams[at].0.is_nan() => next = at,
                Some(at) => return self.beams[at].0 < range_m - CUT_M,
            }
        }
    }
}

/// Returns that lie together.
#[derive(Clone, Copy, Debug)]
struct Cluster {
    x_m: f64,
    y_m: f64,
    half_m: f64,
    wide_m: f64,
    new: usize,
    old: usize,
    /// Whether only a part of it may be seen.
    is_cut: bool,
    is_round: bool,
}

impl Cluster {
    fn new_share(&self) -> f64 {
        self.new as f64 / (self.new + self.old).max(1) as f64
    }
}

/// The middle of a circle of a radius through points, near a place (Gauss-Newton): right also where only a part of it is seen. `None`
/// where the points are too few, or lie on no such circle.
fn round(points: &[(usize, f64, f64, f64)], near: (f64, f64), radius_m: f64) -> Option<(f64, f64)> {
    if points.len() < LEAST_ROUND {
        return None;
    }
    let (mut x_m, mut y_m) = near;
    let mut off_m2 = 0.0;
    for _ in 0..ROUNDS {
        let (mut xx, mut xy, mut yy, mut x_sum, mut y_sum) = (0.0, 0.0, 0.0, 0.0, 0.0);
        off_m2 = 0.0;
        for &(_, px, py, _) in points {
            let (dx, dy) = (x_m - px, y_m - py);
            let away_m = dx.hypot(dy).max(1e-6);
            let (east, north, off_m) = (dx / away_m, dy / away_m, away_m - radius_m);
            xx += east * east;
            xy += east * north;
            yy += north * north;
            x_sum += east * off_m;
            y_sum += north * off_m;
            off_m2 += off_m * off_m;
        }
        let whole = xx * yy - xy * xy;
        if whole < 1e-3 {
            return None;
        }
        x_m -= (yy * x_sum - xy * y_sum) / whole;
        y_m -= (xx * y_sum - xy * x_sum) / whole;
    }
    let is_near = (x_m - near.0).hypot(y_m - near.1) < radius_m;
    (is_near && (off_m2 / points.len() as f64).sqrt() < ROUND_M).then_some((x_m, y_m))
}

/// A track; both axes have the same covariance.
#[derive(Clone, Debug)]
struct Track {
    at: [f64; 2],
    speed: [f64; 2],
    /// Variances of place and speed, and their covariance.
    place_var: f64,
    both_var: f64,
    speed_var: f64,
    half_m: f64,
    born: [f64; 2],
    seen_s: f64,
    scans: u32,
    misses: u32,
    is_sure: bool,
}

impl Track {
    fn expect(&mut self, step_s: f64) {
        let noise = WHIM * step_s;
        for axis in 0..2 {
            self.at[axis] += self.speed[axis] * step_s;
        }
        self.place_var += step_s * (2.0 * self.both_var + step_s * self.speed_var) + noise * step_s * step_s / 3.0;
        self.both_var += step_s * self.speed_var + noise * step_s / 2.0;
        self.speed_var += noise;
    }

    fn take_in(&mut self, cluster: &Cluster, time_s: f64) {
        let place_m = match (cluster.is_cut, cluster.is_round) {
            (false, _) => PLACE_M,
            (true, is_round) => CUT_PLACE_M[usize::from(!is_round)],
        };
        let whole = self.place_var + place_m * place_m;
        let (gain, speed_gain) = (self.place_var / whole, self.both_var / whole);
        for (axis, seen) in [cluster.x_m, cluster.y_m].into_iter().enumerate() {
            let off = seen - self.at[axis];
            self.at[axis] += gain * off;
            self.speed[axis] += speed_gain * off;
        }
        self.speed_var -= speed_gain * self.both_var;
        self.both_var -= gain * self.both_var;
        self.place_var -= gain * self.place_var;
        self.half_m = self.half_m.max(cluster.half_m);
        self.seen_s = time_s;
        self.scans += 1;
        self.misses = 0;
        let speed_mps = self.speed[0].hypot(self.speed[1]);
        let way_m = (self.at[0] - self.born[0]).hypot(self.at[1] - self.born[1]);
        // The seen end of what is cut creeps along a thing that stands, but comes onto nothing that was free then.
        let is_telling = !cluster.is_cut || (cluster.is_round && cluster.new_share() >= NEW_IF_CUT);
        self.is_sure |= is_telling
            && self.scans >= LEAST_SCANS
            && way_m >= LEAST_WAY_M
            && (SPEEDS_MPS[0]..=SPEEDS_MPS[1]).contains(&speed_mps)
            && self.speed_var.sqrt() < UNSURE_MPS;
    }
}

/// The tracks and what they come from.
#[derive(Clone, Debug, Default)]
pub(super) struct Tracks {
    past: VecDeque<Past>,
    time_s: f64,
    all: Vec<Track>,
    /// What beams of the present scan tell.
    pub beams: Vec<Return>,
}

impl Tracks {
    /// Forgets everything.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Takes in a scan; `self.beams` tells what its beams tell.
    pub fn observe(&mut self, time_s: f64, pose: &Pose, scan: &Scan) {
        let sensor = pose.of_mount(&scan.mount);
        let step_s = time_s - self.time_s;
        self.time_s = time_s;
        if !(0.0..1.0).contains(&step_s) || scan.angle_increment_rad == 0.0 {
            self.all.clear();
            self.past.clear();
        }
        for track in &mut self.all {
            track.expect(step_s.clamp(0.0, 1.0));
        }
        if scan.angle_increment_rad == 0.0 || self.beams.len() != scan.ranges_m.len() {
            return;
        }
        let beams = self
            .beams
            .iter()
            .map(|told| {
                let is_hit = matches!(told, Return::Obstacle { .. });
                (told.range_m().unwrap_or(f64::NAN), is_hit)
            })
            .collect();
        let now = Past {
            time_s,
            sensor,
            angle_min_rad: scan.angle_min_rad,
            angle_increment_rad: scan.angle_increment_rad,
            beams,
        };
        let clusters = self.clusters(&now);
        self.match_up(&now, &clusters);
        while self.past.front().is_some_and(|past| past.time_s < time_s - PAST_S) {
            self.past.pop_front();
        }
        if self.past.back().is_none_or(|past| past.time_s <= time_s - PAST_STEP_S) {
            self.past.push_back(now);
        }
    }

    /// Whether something came to a place lately, or stood there.
    fn tells(&self, time_s: f64, place: (f64, f64)) -> Told {
        let mut known = Told::Nothing;
        for past in &self.past {
            if past.time_s > time_s - PAST_LEAST_S {
                break;
            }
            match past.tells(place) {
                Told::Free => return Told::Free,
                Told::Taken => known = Told::Taken,
                Told::Nothing => {}
            }
        }
        known
    }

    fn clusters(&self, now: &Past) -> Vec<Cluster> {
        let mut found = Vec::new();
        let mut points: Vec<(usize, f64, f64, f64)> = Vec::new();
        let mut end = |points: &mut Vec<(usize, f64, f64, f64)>| {
            found.extend(self.cluster(now, points));
            points.clear();
        };
        for (beam, &(range_m, is_hit)) in now.beams.iter().enumerate() {
            if !is_hit || range_m > FAR_M {
                continue;
            }
            let bearing_rad = now.sensor.heading_rad + now.angle_min_rad + now.angle_increment_rad * beam as f64;
            let (sin, cos) = bearing_rad.sin_cos();
            let (x_m, y_m) = (now.sensor.x_m + range_m * cos, now.sensor.y_m + range_m * sin);
            if let Some(&(_, last_x_m, last_y_m, _)) = points.last() {
                let (dx, dy) = (x_m - last_x_m, y_m - last_y_m);
                let one_m = ONE_M.max(ONE_BEAMS * range_m * now.angle_increment_rad.abs());
                if dx * dx + dy * dy > one_m * one_m {
                    end(&mut points);
                }
            }
            points.push((beam, x_m, y_m, range_m));
        }
        end(&mut points);
        found
    }

    fn cluster(&self, now: &Past, points: &[(usize, f64, f64, f64)]) -> Option<Cluster> {
        let (first, last) = (points.first()?, points.last()?);
        let wide_m = (first.1 - last.1).hypot(first.2 - last.2);
        if wide_m > WIDEST_M {
            return None;
        }
        let count = points.len() as f64;
        let (x_m, y_m) = (
            points.iter().map(|point| point.1).sum::<f64>() / count,
            points.iter().map(|point| point.2).sum::<f64>() / count,
        );
        let (mut new, mut old) = (0, 0);
        for point in points {
            match self.tells(now.time_s, (point.1, point.2)) {
                Told::Free => new += 1,
                Told::Taken => old += 1,
                Told::Nothing => {}
            }
        }
        // The middle of a half circle lies 2 r / pi before that of the circle.
        let half_m = (wide_m / 2.0).clamp(HALF_M[0], HALF_M[1]);
        let (dx, dy) = (x_m - now.sensor.x_m, y_m - now.sensor.y_m);
        let away_m = dx.hypot(dy).max(1e-6);
        let behind_m = half_m * std::f64::consts::FRAC_2_PI;
        let about = (x_m + dx / away_m * behind_m, y_m + dy / away_m * behind_m);
        let is_cut = [now.cuts(first.0, -1, first.3), now.cuts(last.0, 1, last.3)];
        // Where one end is cut, the middle lies beside the other, at right angles to the beam.
        let beside = |end: &(usize, f64, f64, f64), side: f64| {
            let (dx, dy) = (end.1 - now.sensor.x_m, end.2 - now.sensor.y_m);
            let shift = side * now.angle_increment_rad.signum() * half_m / end.3.max(1e-6);
            (end.1 - shift * dy, end.2 + shift * dx)
        };
        let about = match is_cut {
            [false, true] => beside(first, 1.0),
            [true, false] => beside(last, -1.0),
            _ => about,
        };
        let middle = round(points, about, half_m);
        let (x_m, y_m) = middle.unwrap_or(about);
        Some(Cluster {
            x_m,
            y_m,
            half_m,
            wide_m,
            new,
            old,
            is_cut: is_cut != [false; 2],
            is_round: middle.is_some(),
        })
    }

    /// Gives every track its nearest cluster, begins tracks and ends them.
    fn match_up(&mut self, now: &Past, clusters: &[Cluster]) {
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (number, cluster) in clusters.iter().enumerate() {
            let is_known = cluster.new + cluster.old > 0;
            for (which, track) in self.all.iter().enumerate() {
                let away_m = (track.at[0] - cluster.x_m).hypot(track.at[1] - cluster.y_m);
                let gate_m = (3.0 * (track.place_var + PLACE_M * PLACE_M).sqrt()).clamp(GATE_M[0], GATE_M[1]);
                let goes_on = if is_known {
                    cluster.new_share() >= NEW_TO_GO_ON
                } else {
                    track.is_sure
                };
                if away_m <= gate_m && goes_on {
                    pairs.push((away_m, which, number));
                }
            }
        }
        pairs.sort_by(|one, other| one.0.total_cmp(&other.0));
        let mut matched = vec![false; self.all.len()];
        let mut taken = vec![false; clusters.len()];
        for (_, which, number) in pairs {
            if !matched[which] && !taken[number] {
                (matched[which], taken[number]) = (true, true);
                self.all[which].take_in(&clusters[number], now.time_s);
            }
        }
        let mut which = 0;
        self.all.retain_mut(|track| {
            let is_matched = matched[which];
            which += 1;
            if is_matched {
                return true;
            }
            if now.tells((track.at[0], track.at[1])) == Told::Free {
                track.misses += 1;
            }
            let is_vague = track.place_var > MOST_UNSURE_M.powi(2);
            track.misses < MISSES && !is_vague && now.time_s - track.seen_s < UNSEEN_S[usize::from(track.is_sure)]
        });
        self.all.sort_by(|one, other| {
            other
                .is_sure
                .cmp(&one.is_sure)
                .then(other.seen_s.total_cmp(&one.seen_s))
        });
        let mut kept: Vec<[f64; 2]> = Vec::new();
        self.all.retain(|track| {
            let is_twin = kept
                .iter()
                .any(|at| (track.at[0] - at[0]).hypot(track.at[1] - at[1]) < TWINS_M);
            kept.push(track.at);
            !is_twin
        });
        for (cluster, taken) in clusters.iter().zip(taken) {
            let is_new = cluster.new >= LEAST_NEW && cluster.new_share() >= NEW_TO_BEGIN && cluster.wide_m <= WIDEST_M;
            let near = |track: &Track| (track.at[0] - cluster.x_m).hypot(track.at[1] - cluster.y_m) < GATE_M[0];
            if taken || !is_new || self.all.iter().any(near) {
                continue;
            }
            let at = [cluster.x_m, cluster.y_m];
            self.all.push(Track {
                at,
                speed: [0.0; 2],
                place_var: PLACE_M * PLACE_M,
                both_var: 0.0,
                speed_var: 1.0,
                half_m: cluster.half_m,
                born: at,
                seen_s: now.time_s,
                scans: 1,
                misses: 0,
                is_sure: false,
            });
        }
    }

    /// What moves, where it is at a time.
    pub fn found(&self, time_s: f64) -> Vec<Mover> {
        let since_s = (time_s - self.time_s).clamp(0.0, 1.0);
        self.all
            .iter()
            .filter(|track| track.is_sure && track.speed[0].hypot(track.speed[1]) >= SPEEDS_MPS[0])
            .map(|track| {
                let [east_mps, north_mps] = track.speed;
                Mover {
                    x_m: track.at[0] + since_s * east_mps,
                    y_m: track.at[1] + since_s * north_mps,
                    east_mps,
                    north_mps,
                    half_m: track.half_m,
                    unsure_m: track.place_var.sqrt(),
                    unseen_s: time_s - track.seen_s,
                }
            })
            .collect()
    }
}
