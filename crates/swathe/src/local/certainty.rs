//! The certainty grid: what the range sensors have seen around the robot, in a square window that moves with it.
//!
//! Two ways of counting evidence. Log-odds after Moravec and Elfes 1985, clamped so that a moved obstacle is forgotten after
//! a few scans (Hornung et al., `OctoMap`, 2013). Histogramic in-motion mapping after Borenstein and Koren, 1991: a hit
//! adds 3, a cell that a beam crossed loses 1, between 0 and 15.

use crate::sensor::{Pose, Return, Scan};

/// Greatest certainty that an obstacle stands in a cell, the scale of the vector field histogram.
pub const CERTAINTY_MAX: u8 = 15;

/// A cell that no beam has reached.
const UNSEEN: i16 = i16::MIN;

/// Log-odds are counted in this many steps per natural unit.
const STEPS: f64 = 256.0;

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

/// The window of certainty.
#[derive(Clone, Debug)]
pub struct CertaintyGrid {
    params: CertaintyParams,
    side: i64,
    /// Lattice row (down from y = 0) and column (right from x = 0) of the cell in the middle.
    middle: (i64, i64),
    /// Evidence, wrapped around at both sides so that moving on copies nothing.
    evidence: Vec<i16>,
    /// Number of the last scan that counted for a cell.
    counted: Vec<u32>,
    scan: u32,
    levels: Levels,
    /// Cells that the last scan counted for, by lattice row and column.
    touched: Vec<(i64, i64)>,
}

/// Steps of evidence and what they mean.
#[derive(Clone, Debug)]
struct Levels {
    hit: i16,
    miss: i16,
    low: i16,
    high: i16,
    /// Certainty of every step from low to high.
    certainty: Vec<u8>,
}

impl Levels {
    fn of(evidence: Evidence) -> Self {
        let (hit, miss, low, high) = match evidence {
            Evidence::Himm { hit, miss } => (hit, miss, 0, i16::from(CERTAINTY_MAX)),
            Evidence::LogOdds { hit, miss, clamp } => {
                let steps = |p: f64| {
                    let p = p.clamp(1e-6, 1.0 - 1e-6);
                    (STEPS * (p / (1.0 - p)).ln()).round() as i16
                };
                (steps(hit), -steps(miss), steps(clamp[0]), steps(clamp[1]))
            }
        };
        let certainty = |level: i16| match evidence {
            Evidence::Himm { .. } => level as u8,
            // 15 max(0, 2p - 1), and 2p - 1 is tanh(l / 2).
            Evidence::LogOdds { .. } => {
                let excess = (f64::from(level) / STEPS / 2.0).tanh().max(0.0);
                (f64::from(CERTAINTY_MAX) * excess).round() as u8
            }
        };
        Self {
            hit: hit.max(0),
            miss: miss.max(0),
            low: low.min(0),
            high: high.max(0),
            certainty: (low.min(0)..=high.max(0)).map(certainty).collect(),
        }
    }
}

impl CertaintyGrid {
    /// A window around a place, nothing seen.
    pub fn new(params: CertaintyParams, x_m: f64, y_m: f64) -> Self {
        let side = params.side_cells.max(3) | 1;
        let mut grid = Self {
            params,
            side: side as i64,
            middle: (0, 0),
            evidence: vec![UNSEEN; side * side],
            counted: vec![0; side * side],
            scan: 0,
            levels: Levels::of(params.evidence),
            touched: Vec::new(),
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
        self.evidence.fill(UNSEEN);
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
        for row in entered(down, target.0) {
            let start = (row.rem_euclid(self.side) * self.side) as usize;
            self.evidence[start..start + self.side as usize].fill(UNSEEN);
        }
        for column in entered(right, target.1) {
            for row in 0..self.side {
                self.evidence[(row * self.side + column.rem_euclid(self.side)) as usize] = UNSEEN;
            }
        }
    }

    /// Lets evidence fade for some seconds.
    pub fn fade(&mut self, seconds: f64) {
        let keep = (-seconds.max(0.0) / self.params.fade_s).exp();
        if keep >= 1.0 {
            return;
        }
        for level in &mut self.evidence {
            if *level != UNSEEN {
                *level = (f64::from(*level) * keep) as i16;
            }
        }
    }

    /// Takes a scan from a pose; `classify` says what each beam tells. Every cell counts once a scan, and a hit wins.
    ///
    /// The scan must have passed [`Scan::validate`] and the pose must be finite.
    pub fn observe(&mut self, pose: &Pose, scan: &Scan, mut classify: impl FnMut(usize) -> Return) {
        // Two marks a scan: cells that were hit, and cells that were only crossed.
        if self.scan >= u32::MAX - 2 {
            self.counted.fill(0);
            self.scan = 0;
        }
        self.scan += 1;
        self.touched.clear();
        let sensor = pose.of_mount(&scan.mount);
        let reach_m = self.side as f64 * self.params.cell_size_m;
        let end = |beam: usize, range_m: f64| {
            let (sin, cos) = (sensor.heading_rad + scan.beam_rad(beam)).sin_cos();
            let range_m = range_m.min(reach_m);
            (sensor.x_m + range_m * cos, sensor.y_m + range_m * sin)
        };
        let mut crossed = Vec::with_capacity(scan.ranges_m.len());
        for beam in 0..scan.ranges_m.len() {
            let (range_m, is_hit) = match classify(beam) {
                Return::Invalid => continue,
                Return::Obstacle { range_m } => (range_m, range_m <= reach_m),
                Return::Ground { range_m } | Return::Clear { range_m } => (range_m, false),
            };
            let (x_m, y_m) = end(beam, range_m);
            crossed.push((x_m, y_m));
            let cell = self.lattice(x_m, y_m);
            if is_hit && let Some(index) = self.index(cell) {
                self.count(index, cell, self.levels.hit);
            }
        }
        let start = (sensor.x_m, sensor.y_m);
        for end in crossed {
            self.cross(start, end);
        }
    }

    /// Counts the cells that a beam crossed, all but the last, nearest first.
    fn cross(&mut self, from: (f64, f64), to: (f64, f64)) {
        let size = self.params.cell_size_m;
        let (mut row, mut column) = self.lattice(from.0, from.1);
        let last = self.lattice(to.0, to.1);
        // Rows run south: the beam in units of cells, x right, y down.
        let along = [(to.0 - from.0) / size, (from.1 - to.1) / size];
        let place = [from.0 / size, -from.1 / size];
        let next = |axis: usize, cell: i64| {
            if along[axis] > 0.0 {
                ((cell + 1) as f64 - place[axis]) / along[axis]
            } else if along[axis] < 0.0 {
                (cell as f64 - place[axis]) / along[axis]
            } else {
                f64::INFINITY
            }
        };
        let step = along.map(|part| if part > 0.0 { 1 } else { -1 });
        let span = along.map(|part| 1.0 / part.abs());
        let (mut to_column, mut to_row) = (next(0, column), next(1, row));
        // Rounding could miss the last cell; no beam crosses more borders than this.
        let borders = (last.0 - row).abs() + (last.1 - column).abs();
        for _ in 0..borders {
            let Some(index) = self.index((row, column)) else {
                // The sensor may sit at the window's edge; a beam that has left does not come back.
                return;
            };
            self.count(index, (row, column), -self.levels.miss);
            if to_column < to_row {
                column += step[0];
                to_column += span[0];
            } else {
                row += step[1];
                to_row += span[1];
            }
        }
    }

    fn count(&mut self, index: usize, cell: (i64, i64), change: i16) {
        if self.counted[index] == self.scan {
            return;
        }
        self.counted[index] = self.scan;
        self.touched.push(cell);
        let level = self.evidence[index];
        let level = if level == UNSEEN { 0 } else { level };
        self.evidence[index] = (level + change).clamp(self.levels.low, self.levels.high);
    }

    /// Sets a place to the greatest certainty, as when the robot has felt an obstacle.
    pub fn stamp(&mut self, x_m: f64, y_m: f64) {
        if let Some(index) = self.index(self.lattice(x_m, y_m)) {
            self.evidence[index] = self.levels.high;
        }
    }

    /// Certainty from 0 to 15 that an obstacle stands at a place; `None` where nothing was seen or outside the window.
    pub fn certainty_at(&self, x_m: f64, y_m: f64) -> Option<u8> {
        let level = self.evidence[self.index(self.lattice(x_m, y_m))?];
        (level != UNSEEN).then(|| self.certainty(level))
    }

    fn certainty(&self, level: i16) -> u8 {
        self.levels.certainty[(level - self.levels.low) as usize]
    }

    /// Copies the certainties of a square of cells around a place, row by row from the north-west; 0 where nothing is known.
    ///
    /// `window` must hold `side` times `side` cells, `side` odd.
    pub fn copy_window(&self, x_m: f64, y_m: f64, side: usize, window: &mut [u8]) {
        let (row, column) = self.lattice(x_m, y_m);
        let half = (side / 2) as i64;
        for (down, cells) in (row - half..=row + half).zip(window.chunks_exact_mut(side)) {
            for (right, cell) in (column - half..=column + half).zip(cells) {
                *cell = match self.index((down, right)).map(|index| self.evidence[index]) {
                    None | Some(UNSEEN) => 0,
                    Some(level) => self.certainty(level),
                };
            }
        }
    }

    /// The cells that the last scan counted for, as row (down from y = 0) and column (right from x = 0) of the lattice of
    /// cells, hits first.
    pub fn touched(&self) -> &[(i64, i64)] {
        &self.touched
    }

    /// Row and column on the lattice of the cell that holds a place.
    pub fn cell_of(&self, x_m: f64, y_m: f64) -> (i64, i64) {
        self.lattice(x_m, y_m)
    }

    /// Certainty of a cell of the lattice; `None` where nothing was seen or outside the window.
    pub fn certainty_of(&self, cell: (i64, i64)) -> Option<u8> {
        let level = self.evidence[self.index(cell)?];
        (level != UNSEEN).then(|| self.certainty(level))
    }

    /// Every cell that has been seen: metres east and north of its centre, and its certainty.
    pub fn seen(&self) -> impl Iterator<Item = (f64, f64, u8)> {
        let half = self.side / 2;
        let (row, column) = self.middle;
        (row - half..=row + half)
            .flat_map(move |row| (column - half..=column + half).map(move |column| (row, column)))
            .filter_map(|cell| {
                let level = self.evidence[self.index(cell)?];
                let (x_m, y_m) = self.centre_m(cell);
                (level != UNSEEN).then(|| (x_m, y_m, self.certainty(level)))
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

    fn index(&self, (row, column): (i64, i64)) -> Option<usize> {
        let half = self.side / 2;
        let inside = (row - self.middle.0).abs() <= half && (column - self.middle.1).abs() <= half;
        inside.then(|| (row.rem_euclid(self.side) * self.side + column.rem_euclid(self.side)) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::Mount;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn beam(range_m: f64) -> Scan {
        Scan {
            ranges_m: vec![range_m],
            angle_min_rad: 0.0,
            angle_increment_rad: 0.0,
            range_min_m: 0.1,
            range_max_m: 5.0,
            mount: Mount::default(),
        }
    }

    fn grid(evidence: Evidence, fade_s: f64) -> CertaintyGrid {
        let params = CertaintyParams {
            side_cells: 41,
            evidence,
            fade_s,
            ..CertaintyParams::default()
        };
        CertaintyGrid::new(params, 0.05, 0.05)
    }

    fn look(grid: &mut CertaintyGrid, pose: &Pose, scan: &Scan) {
        grid.observe(pose, scan, |index| scan.beam(index));
    }

    #[test]
    fn himm_adds_three_at_the_hit_and_takes_one_before_it() {
        let mut grid = grid(Evidence::himm(), f64::INFINITY);
        let pose = Pose::level(0.05, 0.05, 0.0);
        for _ in 0..2 {
            look(&mut grid, &pose, &beam(1.0));
        }
        assert_eq!(grid.certainty_at(1.05, 0.05), Some(6));
        assert_eq!(grid.certainty_at(0.55, 0.05), Some(0));
        assert_eq!(grid.certainty_at(1.15, 0.05), None);
        // The obstacle goes: the cell is crossed and loses one a scan.
        look(&mut grid, &pose, &beam(1.5));
        assert_eq!(grid.certainty_at(1.05, 0.05), Some(5));
        for _ in 0..9 {
            look(&mut grid, &pose, &beam(1.0));
        }
        assert_eq!(grid.certainty_at(1.05, 0.05), Some(15));
    }

    #[test]
    fn log_odds_follow_the_formula_and_stay_between_the_clamps() {
        let mut grid = grid(Evidence::default(), f64::INFINITY);
        let pose = Pose::level(0.05, 0.05, 0.0);
        look(&mut grid, &pose, &beam(1.0));
        // One hit: p = 0.7, 15 (2p - 1) = 6.
        assert_eq!(grid.certainty_at(1.05, 0.05), Some(6));
        look(&mut grid, &pose, &beam(1.0));
        // Two: odds (7/3)², p = 0.845, 10.3.
        assert_eq!(grid.certainty_at(1.05, 0.05), Some(10));
        for _ in 0..20 {
            look(&mut grid, &pose, &beam(1.0));
        }
        assert_eq!(grid.certainty_at(1.05, 0.05), Some(14));
        // From 0.97, crossed nine times, less than even odds are left.
        for _ in 0..9 {
            look(&mut grid, &pose, &beam(1.5));
        }
        assert_eq!(grid.certainty_at(1.05, 0.05), Some(0));
    }

    #[test]
    fn a_hit_wins_over_other_beams_of_the_same_scan_and_clear_beams_only_clear() {
        let mut grid = grid(Evidence::himm(), f64::INFINITY);
        let mut fan = beam(1.0);
        fan.ranges_m = vec![1.5, 1.0, 1.5, f64::INFINITY, f64::NAN];
        look(&mut grid, &Pose::level(0.05, 0.05, 0.0), &fan);
        assert_eq!(grid.certainty_at(1.05, 0.05), Some(3));
        assert_eq!(grid.certainty_at(1.55, 0.05), Some(3));
        assert_eq!(grid.certainty_at(1.85, 0.05), Some(0));
    }

    #[test]
    fn ground_is_no_obstacle() {
        let mut grid = grid(Evidence::himm(), f64::INFINITY);
        let scan = beam(1.0);
        grid.observe(&Pose::level(0.05, 0.05, 0.0), &scan, |_| Return::Ground {
            range_m: 1.0,
        });
        assert_eq!(grid.certainty_at(0.95, 0.05), Some(0));
        assert_eq!(grid.certainty_at(1.05, 0.05), None);
    }

    #[test]
    fn evidence_fades() {
        let mut grid = grid(Evidence::himm(), 30.0);
        grid.stamp(1.0, 1.0);
        assert_eq!(grid.certainty_at(1.0, 1.0), Some(15));
        grid.fade(30.0);
        assert_eq!(grid.certainty_at(1.0, 1.0), Some(5));
        grid.fade(f64::INFINITY);
        assert_eq!(grid.certainty_at(1.0, 1.0), Some(0));
    }

    proptest! {
        #[test]
        fn moving_keeps_what_stays_in_the_window_and_forgets_the_rest(
            places in prop::collection::vec((-1.9f64..1.9, -1.9f64..1.9), 1..20),
            moves in prop::collection::vec((-1.5f64..1.5, -1.5f64..1.5), 1..6),
        ) {
            let mut grid = grid(Evidence::himm(), f64::INFINITY);
            for &(x_m, y_m) in &places {
                grid.stamp(x_m, y_m);
            }
            let mut kept: Vec<_> = places.iter().map(|&(x, y)| grid.lattice(x, y)).collect();
            let (mut x_m, mut y_m) = (0.05, 0.05);
            for (right, up) in moves {
                (x_m, y_m) = (x_m + right, y_m + up);
                grid.move_to(x_m, y_m);
                kept.retain(|&cell| grid.index(cell).is_some());
            }
            kept.sort_unstable();
            kept.dedup();
            let mut seen: Vec<_> = grid.seen().map(|(x, y, certainty)| {
                assert_eq!(certainty, 15);
                grid.lattice(x, y)
            }).collect();
            seen.sort_unstable();
            prop_assert_eq!(seen, kept);
        }

        #[test]
        fn a_beam_crosses_the_cells_that_its_points_lie_in(
            x in -0.5f64..0.5, y in -0.5f64..0.5, heading in -PI..PI, range in 0.2f64..1.4,
        ) {
            let mut grid = grid(Evidence::himm(), f64::INFINITY);
            look(&mut grid, &Pose::level(x, y, heading), &beam(range));
            let last = grid.lattice(x + range * heading.cos(), y + range * heading.sin());
            for part in 0..1000 {
                let along = range * f64::from(part) / 1000.0;
                let (px, py) = (x + along * heading.cos(), y + along * heading.sin());
                let is_last = grid.lattice(px, py) == last;
                let certainty = grid.certainty_at(px, py);
                // A point next to a border may be rounded to the other side of it.
                let near = |v: f64| { let f = (v / 0.1).rem_euclid(1.0); !(1e-6..=1.0 - 1e-6).contains(&f) };
                let expected = if is_last { 3 } else { 0 };
                prop_assert!(certainty == Some(expected) || near(px) || near(py));
            }
            let seen = grid.seen().count() as i64;
            let first = grid.lattice(x, y);
            prop_assert_eq!(seen, (last.0 - first.0).abs() + (last.1 - first.1).abs() + 1);
        }

        #[test]
        fn no_scan_can_break_the_grid(
            ranges in prop::collection::vec(prop::num::f64::ANY, 0..50),
            x in -1e3f64..1e3, y in -1e3f64..1e3, heading in -10.0f64..10.0,
        ) {
            let mut grid = grid(Evidence::default(), f64::INFINITY);
            let mut scan = beam(1.0);
            scan.angle_increment_rad = 0.1;
            scan.ranges_m = ranges;
            look(&mut grid, &Pose::level(x, y, heading), &scan);
            let mut window = vec![0; 33 * 33];
            grid.copy_window(x, y, 33, &mut window);
            prop_assert!(window.iter().all(|&certainty| certainty <= CERTAINTY_MAX));
        }
    }
}
