//! From scans to what is known of the surroundings: certainty grid and memory.

use crate::sensor::{Pose, Return, Scan, wrap};

use super::event::{Event, Reason};
use super::memory::Seen;
use super::navigator::{Navigator, is_place};

/// Certainty from which on something stands in a cell, and below which it is gone again.
pub(super) const SURE: u8 = 6;
const GONE: u8 = 3;

/// Memory cells are this many certainty cells wide.
pub(super) const MEMORY_CELLS: i64 = 2;

/// Beams and returns from which on a scan that repeats itself to the last bit while the robot moves cannot be a coincidence; a few
/// beams may well read the same along a wall.
const TELLING_BEAMS: usize = 16;
const TELLING_RETURNS: usize = 3;

/// Cells with things in them from which on, and as often as, those that the memory has given up are let go.
const MOST_MET: usize = 1 << 18;
const MET_STEP: usize = 1 << 12;

/// Widest cone of a beam, and most rays to each side of its middle.
const CONE_MAX_RAD: f64 = std::f64::consts::PI;
const MOST_RAYS: usize = 32;

/// Further sensors of which the last scan is kept.
const MOST_SENSORS: usize = 16;

/// The last scan of a sensor, and the pose from which it first looked so.
#[derive(Clone, Debug, Default)]
pub(super) struct Repeat {
    ranges_m: Vec<f64>,
    since: Pose,
}

impl Repeat {
    /// Whether a scan repeats the last one to the last bit while the robot has moved: nothing that stands still looks the same
    /// from elsewhere.
    fn is_frozen(&mut self, scan: &Scan, pose: &Pose) -> bool {
        let beams = 0..scan.ranges_m.len();
        let returns = beams
            .filter(|&beam| matches!(scan.beam(beam), Return::Obstacle { .. }))
            .count();
        let is_telling = scan.ranges_m.len() >= TELLING_BEAMS && returns >= TELLING_RETURNS;
        // A beam that was lost, not a number, is lost again in a scan that is repeated.
        let mut pairs = self.ranges_m.iter().zip(&scan.ranges_m);
        let is_same = self.ranges_m.len() == scan.ranges_m.len() && pairs.all(|(a, b)| a.to_bits() == b.to_bits());
        if !(is_telling && is_same) {
            self.ranges_m.clone_from(&scan.ranges_m);
            self.since = *pose;
            return false;
        }
        let turned_rad = wrap(self.since.heading_rad - pose.heading_rad).abs();
        self.since.distance_m(pose) > 0.3 || turned_rad > 0.3
    }
}

/// Refuses what is no scan, and one without a beam that tells anything.
fn check_beams(scan: &Scan) -> Result<(), Reason> {
    scan.validate().map_err(|_| Reason::BadScan)?;
    if (0..scan.ranges_m.len()).all(|beam| scan.beam(beam) == Return::Invalid) {
        return Err(Reason::BlindScan);
    }
    Ok(())
}

impl Navigator {
    /// Takes in a scan, or notes why not; returns whether there was one to take in.
    pub(super) fn look(&mut self, time_s: f64, pose: &Pose, scan: Option<&Scan>, step_s: f64) -> bool {
        self.grid.move_to(pose.x_m, pose.y_m);
        self.grid.doubt_poses(self.odometry.doubt());
        // Nobody sets a vehicle down nearer to things than a cell.
        let is_first = self.scan_time_s.is_none();
        let beside_m = if is_first { self.grid.params().cell_size_m } else { 0.0 };
        let half_width_m = self.shape.half_width_m + beside_m;
        self.grid.stand_on(pose, self.shape.half_length_m, half_width_m);
        self.grid.fade(step_s);
        self.remember();
        let Some(scan) = scan else { return false };
        if let Err(reason) = self.check_scan(scan, pose) {
            self.refused = Some(reason);
            self.events.push(Event::ScanRefused { reason });
            return false;
        }
        self.refused = None;
        self.scan_time_s = Some(time_s);
        self.take_in(pose, scan);
        // A single return makes the robot brake, whatever the certainty grid says yet.
        self.unconfirmed
            .observe(time_s, (pose, scan), &self.tracks.beams, &self.grid, &self.shape);
        self.tracks.observe(time_s, pose, scan);
        true
    }

    fn take_in(&mut self, pose: &Pose, scan: &Scan) {
        let (height_m, tolerance_m) = (self.params.sensor_height_m, self.params.ground_tolerance_m);
        let beams = &mut self.tracks.beams;
        beams.clear();
        let mut note = |told: Return| {
            beams.push(told);
            told
        };
        match self
            .region
            .as_ref()
            .and_then(|region| region.attitude(pose, scan, height_m, tolerance_m))
        {
            Some(attitude) => self.grid.observe(pose, scan, |beam| note(attitude.explain(scan, beam))),
            None => self.grid.observe(pose, scan, |beam| note(scan.beam(beam))),
        }
        self.remember();
    }

    /// Takes in one beam as a cone.
    fn take_in_cone(&mut self, pose: &Pose, scan: &Scan, beam: usize, cone_rad: f64, sides: usize) {
        let (height_m, tolerance_m) = (self.params.sonar_height_m, self.params.ground_tolerance_m);
        let attitude = self
            .region
            .as_ref()
            .and_then(|region| region.attitude(pose, scan, height_m, tolerance_m));
        let told = attitude.map_or_else(|| scan.beam(beam), |attitude| attitude.explain(scan, beam));
        let Some(range_m) = told.range_m() else { return };
        let rays = Scan {
            ranges_m: vec![range_m; 2 * sides + 1],
            angle_min_rad: scan.beam_rad(beam) - cone_rad / 2.0,
            angle_increment_rad: cone_rad / (2 * sides) as f64,
            ..*scan
        };
        self.grid.observe(
            pose,
            &rays,
            |ray| if ray == sides { told } else { Return::Clear { range_m } },
        );
        self.remember();
    }

    /// Takes in what another sensor sees, between the steps: a cone of a sonar ring, a second laser. It counts like a scan of a
    /// step and may be the only one that the robot has.
    ///
    /// `cone_rad` is the width of a beam. Up to its range the whole cone is free; what it met is taken to stand in its middle, as
    /// in histogramic in-motion mapping: the next readings put it right (Borenstein and Koren 1991).
    ///
    /// # Errors
    /// The [`Reason`] why it was left out.
    pub fn sense(&mut self, time_s: f64, pose: &Pose, scan: &Scan, cone_rad: f64) -> Result<(), Reason> {
        let taken = self.hear(time_s, pose, scan, cone_rad);
        // What a step says of a robot that sees nothing more.
        match taken {
            Ok(()) => self.refused = None,
            Err(reason @ (Reason::BadScan | Reason::BlindScan | Reason::FrozenScan)) => self.refused = Some(reason),
            Err(_) => {}
        }
        taken
    }

    fn hear(&mut self, time_s: f64, pose: &Pose, scan: &Scan, cone_rad: f64) -> Result<(), Reason> {
        if !(is_place(time_s, pose) && (0.0..=CONE_MAX_RAD).contains(&cone_rad)) {
            return Err(Reason::BadState);
        }
        check_beams(scan)?;
        // A clock that went back or a pose that jumped is the next step's to tell.
        let far_m = self.grid.side_cells() as f64 * self.grid.params().cell_size_m / 2.0;
        let (x_m, y_m) = self.grid.middle_m();
        if (x_m - pose.x_m).hypot(y_m - pose.y_m) > far_m && self.scan_time_s.is_some() {
            return Err(Reason::PoseJumped);
        }
        // The middle of a cone tells the nearest of all it meets, and that may well stay the same along a wall.
        if cone_rad == 0.0 && self.is_frozen_between_steps(scan, pose) {
            return Err(Reason::FrozenScan);
        }
        let pose = self.odometry.now(&Pose {
            heading_rad: wrap(pose.heading_rad),
            ..*pose
        });
        self.grid.move_to(pose.x_m, pose.y_m);
        // No two rays of a cone lie farther apart at its end than a cell is wide.
        let ray_rad = self.grid.params().cell_size_m / scan.range_max_m;
        let sides = ((cone_rad / 2.0 / ray_rad).ceil() as usize).min(MOST_RAYS);
        if sides == 0 {
            self.take_in(&pose, scan);
        } else {
            for beam in 0..scan.ranges_m.len() {
                self.take_in_cone(&pose, scan, beam, cone_rad, sides);
            }
        }
        self.scan_time_s = Some(self.scan_time_s.map_or(time_s, |last| last.max(time_s)));
        Ok(())
    }

    /// Whether a further sensor, told by where it is mounted, repeats itself.
    fn is_frozen_between_steps(&mut self, scan: &Scan, pose: &Pose) -> bool {
        let known = self.repeats.iter().position(|(mount, _)| *mount == scan.mount);
        let place = known.unwrap_or_else(|| {
            if self.repeats.len() >= MOST_SENSORS {
                self.repeats.remove(0);
            }
            self.repeats.push((scan.mount, Repeat::default()));
            self.repeats.len() - 1
        });
        self.repeats[place].1.is_frozen(scan, pose)
    }

    fn check_scan(&mut self, scan: &Scan, pose: &Pose) -> Result<(), Reason> {
        check_beams(scan)?;
        if self.repeat.is_frozen(scan, pose) {
            return Err(Reason::FrozenScan);
        }
        Ok(())
    }

    /// Merges what the last scan has changed into the memory, and into the window of the route.
    fn remember(&mut self) {
        let mut before = None;
        // What the memory has given up is of no use any more.
        if self.met.len() >= MOST_MET && self.met.len().is_multiple_of(MET_STEP) {
            let memory = &self.memory;
            self.met.retain(|&(row, column), _| {
                memory.get((row.div_euclid(MEMORY_CELLS), column.div_euclid(MEMORY_CELLS))) != Seen::Unknown
            });
        }
        for &cell in self.grid.reshaped() {
            if let Some(parts) = self.met.get_mut(&cell) {
                *parts = self.grid.parts_met(cell);
            }
        }
        for &(row, column) in self.grid.changed() {
            match self.grid.certainty_of((row, column)) {
                Some(certainty) if certainty >= SURE => {
                    let parts = self.grid.parts_met((row, column));
                    self.met.insert((row, column), parts);
                }
                Some(certainty) if certainty < GONE => {
                    self.met.remove(&(row, column));
                }
                _ => {}
            }
            let cell = (row.div_euclid(MEMORY_CELLS), column.div_euclid(MEMORY_CELLS));
            // Beams cross the cells of one memory cell one after the other.
            if before == Some(cell) {
                continue;
            }
            before = Some(cell);
            let known = self.memory.get(cell);
            if known == Seen::Stamped {
                continue;
            }
            let most = (0..MEMORY_CELLS * MEMORY_CELLS).filter_map(|part| {
                let (down, right) = (part / MEMORY_CELLS, part % MEMORY_CELLS);
                self.grid
                    .certainty_of((cell.0 * MEMORY_CELLS + down, cell.1 * MEMORY_CELLS + right))
            });
            let most = most.max().unwrap_or(0);
            let seen = match known {
                Seen::Occupied if most >= GONE => Seen::Occupied,
                _ if most >= SURE => Seen::Occupied,
                _ => Seen::Free,
            };
            if seen != known {
                self.memory.set(cell, seen);
                if let Some(window) = &mut self.window {
                    window.set(cell, seen);
                }
            }
        }
    }
}
