//! The certainty grid: what the range sensors have seen around the robot, in a square window that moves with it.
//!
//! Two ways of counting evidence. Log-odds after Moravec and Elfes 1985, clamped so that a moved obstacle is forgotten after
//! a few scans (Hornung et al., `OctoMap`, 2013). Histogramic in-motion mapping after Borenstein and Koren, 1991: a hit
//! adds 3, a cell that a beam crossed loses 1, between 0 and 15.

mod counts;
mod levels;
mod ray;

use crate::grid::Position;
use crate::random::{philox, unit};
use crate::sensor::{Pose, Return, Scan};

use counts::{BLOCK_BITS, Count, Counts};
use levels::Levels;
use ray::{Ray, Window};

/// Greatest certainty that an obstacle stands in a cell, the scale of the vector field histogram.
pub const CERTAINTY_MAX: u8 = 15;

/// Certainty of a cell that no beam has reached, beyond every other.
const UNSEEN: u8 = u8::MAX;

/// Evidence fades this many times while it falls to 1/e: oftener, rounding would be all that happens.
const FADES: f64 = 64.0;

/// How evidence is counted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Evidence {
    /// Log-odds of occupancy.
    LogOdds {
        /// Probability of an obstacle where a beam ended.
        hit: f64,
        /// Probability of an obstacle where a beam passed.
        miss: f64,
        /// Lowest and highest probability that a cell keeps.
        clamp: [f64; 2],
    },
    /// Histogramic in-motion mapping.
    Himm {
        /// What a hit adds.
        hit: i16,
        /// What a passing beam takes away.
        miss: i16,
    },
}

impl Default for Evidence {
    fn default() -> Self {
        Self::LogOdds {
            hit: 0.7,
            miss: 0.4,
            clamp: [0.12, 0.97],
        }
    }
}

impl Evidence {
    /// The paper's increments.
    pub fn himm() -> Self {
        Self::Himm { hit: 3, miss: 1 }
    }
}

/// What the window is like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CertaintyParams {
    /// Side of a cell in metres.
    pub cell_size_m: f64,
    /// Cells along the window's side; made odd, so that the robot has a cell in the middle.
    pub side_cells: usize,
    /// How evidence is counted.
    pub evidence: Evidence,
    /// Seconds in which evidence fades to 1/e; infinite for a world that stands still.
    pub fade_s: f64,
}

impl Default for CertaintyParams {
    fn default() -> Self {
        Self {
            cell_size_m: 0.1,
            side_cells: 161,
            evidence: Evidence::default(),
            fade_s: f64::INFINITY,
        }
    }
}

/// How far poses from which scans are taken may be off each other: a robot that is told a better pose has seen the same wall at
/// two places.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseDoubt {
    /// Metres, in any direction.
    pub place_m: f64,
    /// Radians.
    pub heading_rad: f64,
}

/// The window of certainty.
#[derive(Clone, Debug)]
pub struct CertaintyGrid {
    params: CertaintyParams,
    side: i64,
    /// Lattice row (down from y = 0) and column (right from x = 0) of the cell in the middle.
    middle: (i64, i64),
    /// Cells along the sides of what is kept, less one: a power of two less one, so that rows and columns wrap around by
    /// a mask and moving on copies nothing.
    mask: i64,
    /// Bits of a column in the index of a cell.
    shift: u32,
    counts: Counts,
    /// Where in every cell something was met.
    met: Vec<Met>,
    /// Certainty of every cell, or [`UNSEEN`]; what everybody else reads.
    certainty: Vec<u8>,
    scan: u16,
    doubt: PoseDoubt,
    levels: Levels,
    /// Seconds for which evidence has not faded yet, and how often it did.
    unfaded_s: f64,
    fades: u32,
    /// Cells that the last scan first saw or whose certainty it changed, by lattice row and column.
    changed: Vec<(i64, i64)>,
    /// Cells in which the last scan met something in another part than before.
    reshaped: Vec<(i64, i64)>,
    /// Ends of beams, and indices of cells on the way of one that are not sure to be free; kept for their storage.
    ends: Vec<(f64, f64)>,
    unsure: Vec<usize>,
}

/// Where in a cell something was met.
#[derive(Clone, Copy, Debug, Default)]
struct Met {
    /// Where the last scan that hit it did so nearest to the sensor: right and down, in parts of 256, and how far away.
    part: [u8; 2],
    range_cm: u16,
    /// The parts of the cell, eight by eight, in which something was met.
    hits: u64,
}

/// Where in its cell a place lies, in parts of 256 of the cell, right and down.
fn part_of((x_m, y_m): (f64, f64), cell_size_m: f64) -> [u8; 2] {
    [x_m, -y_m].map(|along_m| {
        let along = along_m / cell_size_m;
        (256.0 * (along - along.floor())) as u8
    })
}

/// The one of the eight by eight parts of a cell, as a bit, for a place in parts of 256, right and down.
fn bit_of([right, down]: [u8; 2]) -> u64 {
    1 << (u32::from(down) / 32 * 8 + u32::from(right) / 32)
}

impl CertaintyGrid {
    /// A window around a place, nothing seen.
    pub fn new(params: CertaintyParams, x_m: f64, y_m: f64) -> Self {
        let side = params.side_cells.max(3) | 1;
        let stride = side.next_power_of_two().max(1 << BLOCK_BITS);
        let shift = stride.trailing_zeros();
        let levels = Levels::of(params.evidence);
        let mut grid = Self {
            params,
            side: side as i64,
            middle: (0, 0),
            mask: stride as i64 - 1,
            shift,
            counts: Counts::new(shift, levels.low),
            met: vec![Met::default(); stride * stride],
            certainty: vec![UNSEEN; stride * stride],
            scan: 0,
            doubt: PoseDoubt::default(),
            levels,
            unfaded_s: 0.0,
            fades: 0,
            changed: Vec::new(),
            reshaped: Vec::new(),
            ends: Vec::new(),
            unsure: Vec::new(),
        };
        grid.middle = grid.lattice(x_m, y_m);
        grid
    }

    /// What the window is like.
    pub fn params(&self) -> &CertaintyParams {
        &self.params
    }

    /// Cells along the window's side, an odd number.
    pub fn side_cells(&self) -> usize {
        self.side as usize
    }

    /// Centre of the cell in the middle, in metres east and north.
    pub fn middle_m(&self) -> (f64, f64) {
        self.centre_m(self.middle)
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.certainty.fill(UNSEEN);
        self.counts = Counts::new(self.shift, self.levels.low);
    }

    fn forget(&mut self, cells: std::ops::Range<usize>) {
        self.certainty[cells.clone()].fill(UNSEEN);
        self.counts.forget(cells);
    }

    /// Forgets everything farther from a place than some metres, along either axis.
    pub fn clear_beyond(&mut self, x_m: f64, y_m: f64, near_m: f64) {
        let reach = (near_m / self.params.cell_size_m).ceil() as i64;
        let (row, column) = self.lattice(x_m, y_m);
        let half = self.side / 2;
        for down in self.middle.0 - half..=self.middle.0 + half {
            for right in self.middle.1 - half..=self.middle.1 + half {
                if (down - row).abs() > reach || (right - column).abs() > reach {
                    let index = self.wrapped((down, right));
                    self.forget(index..index + 1);
                }
            }
        }
    }

    /// Moves the window so that a place lies in its middle; what leaves it is forgotten.
    pub fn move_to(&mut self, x_m: f64, y_m: f64) {
        let target = self.lattice(x_m, y_m);
        let (down, right) = (target.0 - self.middle.0, target.1 - self.middle.1);
        let half = self.side / 2;
        self.middle = target;
        if down.abs() >= self.side || right.abs() >= self.side {
            return self.clear();
        }
        // Rows and columns that came in hold what was far away before.
        let entered = |step: i64, middle: i64| {
            if step > 0 {
                middle + half - step + 1..middle + half + 1
            } else {
                middle - half..middle - half - step
            }
        };
        let stride = self.mask + 1;
        for row in entered(down, target.0) {
            let start = ((row & self.mask) * stride) as usize;
            self.forget(start..start + stride as usize);
        }
        for column in entered(right, target.1) {
            for row in 0..stride {
                let index = (row * stride + (column & self.mask)) as usize;
                self.forget(index..index + 1);
            }
        }
    }

    /// Lets evidence fade for some seconds. [`Self::changed`] holds the cells whose certainty that changed as well.
    ///
    /// Levels are whole numbers: they are rounded up or down by chance, drawn anew for every cell and time, so that on average they
    /// fall as they should.
    pub fn fade(&mut self, seconds: f64) {
        if self.params.fade_s.is_infinite() {
            return;
        }
        self.unfaded_s += seconds.max(0.0);
        if self.unfaded_s < self.params.fade_s / FADES {
            return;
        }
        let keep = (-std::mem::take(&mut self.unfaded_s) / self.params.fade_s).exp();
        self.fades = self.fades.wrapping_add(1);
        let Window { first, last, .. } = self.window();
        for cell in (first.0..=last.0).flat_map(|row| (first.1..=last.1).map(move |column| (row, column))) {
            let index = self.wrapped(cell);
            if self.certainty[index] == UNSEEN {
                continue;
            }
            let count = self.counts.get(index);
            let drawn = unit(philox([cell.0 as u32, cell.1 as u32, self.fades, 0], 0)[0]);
            let level = (f64::from(count.level) * keep + drawn).floor() as i16;
            self.counts.set(index, Count { level, ..count });
            let after = self.levels.certainty(level);
            if after != self.certainty[index] {
                self.certainty[index] = after;
                self.changed.push(cell);
            }
        }
    }

    /// Tells how far the poses of the scans to come may be off those before: beams from doubtful poses clear what stands beside
    /// them too, for it may have been seen at a wrong place.
    pub fn doubt_poses(&mut self, doubt: PoseDoubt) {
        self.doubt = doubt;
    }

    /// Takes a scan from a pose; `classify` says what each beam tells. Every cell counts once a scan, and a hit wins.
    ///
    /// The scan must have passed [`Scan::validate`] and the pose must be finite.
    pub fn observe(&mut self, pose: &Pose, scan: &Scan, mut classify: impl FnMut(usize) -> Return) {
        if self.scan == u16::MAX {
            self.counts.forget_scans();
            self.scan = 0;
        }
        self.scan += 1;
        self.changed.clear();
        self.reshaped.clear();
        let sensor = pose.of_mount(&scan.mount);
        let reach_m = self.side as f64 * self.params.cell_size_m;
        let mut ends = std::mem::take(&mut self.ends);
        ends.clear();
        for beam in 0..scan.ranges_m.len() {
            let told = classify(beam);
            let Some(range_m) = told.range_m() else { continue };
            let is_hit = matches!(told, Return::Obstacle { .. }) && range_m <= reach_m;
            let range_m = range_m.min(reach_m);
            let Position { x_m, y_m } = scan.end_of(beam, range_m, &sensor);
            ends.push((x_m, y_m));
            let cell = self.lattice(x_m, y_m);
            if is_hit && let Some(index) = self.index(cell) {
                let count = self.counts.get(index);
                let is_first = count.scan != self.scan;
                if is_first && count.level <= 0 {
                    self.met[index].hits = 0;
                }
                self.count(index, cell, self.levels.hit);
                let met = &mut self.met[index];
                let range_cm = (100.0 * range_m) as u16;
                let part = part_of((x_m, y_m), self.params.cell_size_m);
                if is_first || range_cm < met.range_cm {
                    met.part = part;
                    met.range_cm = range_cm;
                }
                let bit = bit_of(part);
                if met.hits & bit == 0 {
                    met.hits |= bit;
                    self.reshaped.push(cell);
                }
            }
        }
        // Hits are counted before, so that they win.
        let start = (sensor.x_m, sensor.y_m);
        let half_rad = 0.5 * scan.angle_increment_rad.abs();
        if self.holds(self.lattice(start.0, start.1)) {
            let window = self.window();
            for &end in &ends {
                self.cross(&window, start, end, half_rad);
            }
        }
        self.ends = ends;
    }

    fn window(&self) -> Window {
        let half = self.side / 2;
        Window {
            first: (self.middle.0 - half, self.middle.1 - half),
            last: (self.middle.0 + half, self.middle.1 + half),
            shift: self.shift,
        }
    }

    /// Counts the cells of the window that a beam from one of them crossed, all but the last, nearest first; `half_rad` is half the
    /// angle to the next beam.
    fn cross(&mut self, window: &Window, from: (f64, f64), to: (f64, f64), half_rad: f64) {
        let size = self.params.cell_size_m;
        // Rows run south: places in units of cells, x right, y down.
        let ray = Ray {
            from: [from.0 / size, -from.1 / size],
            to: [to.0 / size, -to.1 / size],
            half_rad,
            doubt: self.doubt.place_m / size,
            doubt_rad: self.doubt.heading_rad,
        };
        let mut unsure = std::mem::take(&mut self.unsure);
        unsure.clear();
        ray.each_unsure(window, &self.counts, |index| unsure.push(index));
        let is_himm = matches!(self.params.evidence, Evidence::Himm { .. });
        for &index in &unsure {
            let (count, cell) = (self.counts.get(index), window.cell(index));
            if count.scan != self.scan && (count.level <= 0 || is_himm || ray.passes(cell, self.met[index].hits)) {
                self.count(index, cell, -self.levels.miss);
            }
        }
        self.unsure = unsure;
    }

    fn count(&mut self, index: usize, cell: (i64, i64), change: i16) {
        let before = self.counts.get(index);
        if before.scan == self.scan {
            return;
        }
        let level = (before.known_level() + change).clamp(self.levels.low, self.levels.high);
        self.counts.set(index, Count { level, scan: self.scan });
        let after = self.levels.certainty(level);
        if after != self.certainty[index] {
            self.certainty[index] = after;
            self.changed.push(cell);
        }
    }

    /// Where in a cell something was met last, as near to the sensor as in any beam of that scan.
    pub fn met_at(&self, cell: (i64, i64)) -> (f64, f64) {
        let size = self.params.cell_size_m;
        let [right, down] = self
            .index(cell)
            .map_or([128; 2], |index| self.met[index].part)
            .map(|part| (f64::from(part) + 0.5) / 256.0);
        ((cell.1 as f64 + right) * size, -(cell.0 as f64 + down) * size)
    }

    /// In which of the eight by eight parts of a cell something was met, since the cell was last free.
    pub(crate) fn parts_met(&self, cell: (i64, i64)) -> u64 {
        self.index(cell).map_or(0, |index| self.met[index].hits)
    }

    /// Whether something was met at a place, to the part of its cell, and often enough for a certainty.
    pub(crate) fn is_met_at(&self, x_m: f64, y_m: f64, sure: u8) -> bool {
        let cell = self.lattice(x_m, y_m);
        let is_sure = || self.certainty_of(cell).is_some_and(|certainty| certainty >= sure);
        is_sure() && self.parts_met(cell) & bit_of(part_of((x_m, y_m), self.params.cell_size_m)) != 0
    }

    /// The middles of such parts, in metres east and north.
    pub(crate) fn places_of(&self, cell: (i64, i64), parts: u64) -> impl Iterator<Item = (f64, f64)> + use<> {
        let size = self.params.cell_size_m;
        (0..64_u32).filter(move |part| parts >> part & 1 == 1).map(move |part| {
            let (right, down) = ((f64::from(part % 8) + 0.5) / 8.0, (f64::from(part / 8) + 0.5) / 8.0);
            ((cell.1 as f64 + right) * size, -(cell.0 as f64 + down) * size)
        })
    }

    /// Cells in which the last scan met something in another part than before, by row and column of the lattice.
    pub(crate) fn reshaped(&self) -> &[(i64, i64)] {
        &self.reshaped
    }

    /// Notes that the robot stands on the ground of a rectangle around a pose: it has not seen it, but nothing else is there. What
    /// is known of the cells already stays: bodies may reach over what is low. [`Self::changed`] holds the others then.
    pub fn stand_on(&mut self, pose: &Pose, half_length_m: f64, half_width_m: f64) {
        self.changed.clear();
        self.reshaped.clear();
        let size = self.params.cell_size_m;
        let (sin, cos) = pose.heading_rad.sin_cos();
        let half = (half_length_m.hypot(half_width_m) / size).ceil() as i64;
        let (row, column) = self.lattice(pose.x_m, pose.y_m);
        for cell in
            (row - half..=row + half).flat_map(|row| (column - half..=column + half).map(move |column| (row, column)))
        {
            let unseen = self.index(cell).filter(|&index| self.certainty[index] == UNSEEN);
            let Some(index) = unseen else { continue };
            let (x_m, y_m) = self.centre_m(cell);
            let (dx, dy) = (x_m - pose.x_m, y_m - pose.y_m);
            if (cos * dx + sin * dy).abs() <= half_length_m && (cos * dy - sin * dx).abs() <= half_width_m {
                self.counts.set(index, Count { level: 0, scan: 0 });
                self.met[index] = Met::default();
                self.certainty[index] = self.levels.certainty(0);
                self.changed.push(cell);
            }
        }
    }

    /// Sets a place to the greatest certainty, as when the robot has felt an obstacle.
    pub fn stamp(&mut self, x_m: f64, y_m: f64) {
        if let Some(index) = self.index(self.lattice(x_m, y_m)) {
            let count = self.counts.get(index);
            let level = self.levels.high;
            self.counts.set(index, Count { level, ..count });
            let met = &mut self.met[index];
            met.part = [128; 2];
            met.hits |= bit_of(met.part);
            self.certainty[index] = self.levels.certainty(self.levels.high);
        }
    }

    /// Certainty from 0 to 15 that an obstacle stands at a place; `None` where nothing was seen or outside the window.
    pub fn certainty_at(&self, x_m: f64, y_m: f64) -> Option<u8> {
        self.certainty_of(self.lattice(x_m, y_m))
    }

    /// Copies the certainties of a square of cells around a place, row by row from the north-west; 0 where nothing is known.
    ///
    /// `window` must hold `side` times `side` cells, `side` odd.
    pub fn copy_window(&self, x_m: f64, y_m: f64, side: usize, window: &mut [u8]) {
        let (row, column) = self.lattice(x_m, y_m);
        let half = (side / 2) as i64;
        window.fill(0);
        for (down, cells) in (row - half..=row + half).zip(window.chunks_exact_mut(side)) {
            for (first, known) in self.known(down, column - half..column + half + 1) {
                let start = (first - (column - half)) as usize;
                for (cell, &certainty) in cells[start..start + known.len()].iter_mut().zip(known) {
                    *cell = if certainty == UNSEEN { 0 } else { certainty };
                }
            }
        }
    }

    /// Calls for every cell of a square around a cell whose certainty is at least `sure`, row by row.
    pub fn each_sure(&self, (row, column): (i64, i64), half: i64, sure: u8, mut call: impl FnMut((i64, i64))) {
        for down in row - half..=row + half {
            for (first, known) in self.known(down, column - half..column + half + 1) {
                // Blocks without any are the rule and passed over at once.
                for (block, cells) in known.chunks(32).enumerate() {
                    let is_sure = |certainty: u8| certainty >= sure && certainty != UNSEEN;
                    if !cells.iter().fold(false, |any, &certainty| any | is_sure(certainty)) {
                        continue;
                    }
                    for (right, &certainty) in cells.iter().enumerate() {
                        if is_sure(certainty) {
                            call((down, first + (32 * block + right) as i64));
                        }
                    }
                }
            }
        }
    }

    /// The part of a row of the lattice that lies in the window, in at most two pieces with their first columns.
    fn known(&self, row: i64, columns: std::ops::Range<i64>) -> impl Iterator<Item = (i64, &[u8])> {
        let half = self.side / 2;
        let is_row = (row - self.middle.0).abs() <= half;
        let first = columns.start.max(self.middle.1 - half);
        let end = columns.end.min(self.middle.1 + half + 1);
        let stride = self.mask + 1;
        let start = (row & self.mask) * stride;
        // What is kept wraps around where the masked column would be 0.
        let wrap = ((first | self.mask) + 1).clamp(first, end.max(first));
        [(first, wrap), (wrap, end)]
            .into_iter()
            .filter(move |(from, to)| is_row && from < to)
            .map(move |(from, to)| {
                let at = (start + (from & self.mask)) as usize;
                (from, &self.certainty[at..at + (to - from) as usize])
            })
    }

    /// The cells that the last scan, or the last [`Self::stand_on`], first saw or whose certainty it changed, as row (down from
    /// y = 0) and column (right from x = 0) of the lattice of cells, hits first.
    pub fn changed(&self) -> &[(i64, i64)] {
        &self.changed
    }

    /// Row and column on the lattice of the cell that holds a place.
    pub fn cell_of(&self, x_m: f64, y_m: f64) -> (i64, i64) {
        self.lattice(x_m, y_m)
    }

    /// Certainty of a cell of the lattice; `None` where nothing was seen or outside the window.
    pub fn certainty_of(&self, cell: (i64, i64)) -> Option<u8> {
        let certainty = self.certainty[self.index(cell)?];
        (certainty != UNSEEN).then_some(certainty)
    }

    /// Every cell that has been seen: metres east and north of its centre, and its certainty.
    pub fn seen(&self) -> impl Iterator<Item = (f64, f64, u8)> {
        let half = self.side / 2;
        let (row, column) = self.middle;
        (row - half..=row + half)
            .flat_map(move |row| (column - half..=column + half).map(move |column| (row, column)))
            .filter_map(|cell| {
                let certainty = self.certainty_of(cell)?;
                let (x_m, y_m) = self.centre_m(cell);
                Some((x_m, y_m, certainty))
            })
    }

    fn lattice(&self, x_m: f64, y_m: f64) -> (i64, i64) {
        let size = self.params.cell_size_m;
        ((-y_m / size).floor() as i64, (x_m / size).floor() as i64)
    }

    fn centre_m(&self, (row, column): (i64, i64)) -> (f64, f64) {
        let size = self.params.cell_size_m;
        ((column as f64 + 0.5) * size, -(row as f64 + 0.5) * size)
    }

    fn holds(&self, (row, column): (i64, i64)) -> bool {
        let half = self.side / 2;
        (row - self.middle.0).abs() <= half && (column - self.middle.1).abs() <= half
    }

    fn wrapped(&self, (row, column): (i64, i64)) -> usize {
        ((row & self.mask) << self.shift | column & self.mask) as usize
    }

    fn index(&self, cell: (i64, i64)) -> Option<usize> {
        self.holds(cell).then(|| self.wrapped(cell))
    }
}

#[cfg(test)]
mod tests;
