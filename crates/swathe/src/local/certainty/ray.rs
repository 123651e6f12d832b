//! A beam that passes through cells, and what it tells of their parts.

/// Half the side of a part of a cell, in cells.
const HALF_PART: f64 = 1.0 / 16.0;

/// A beam in units of cells, x right and y down.
pub(super) struct Ray {
    pub from: [f64; 2],
    pub toward: [f64; 2],
    /// Half the angle to the next beam.
    pub half_rad: f64,
    /// How far the beam may be off, and by what angle.
    pub doubt: f64,
    pub doubt_rad: f64,
}

impl Ray {
    /// Whether the beam comes so near to a part in which something was met that it tells of it: a corner that fills a part of a
    /// cell is not gone when beams cross the rest of it.
    pub fn passes(&self, cell: (i64, i64), parts: u64) -> bool {
        let corner = [cell.1 as f64 - self.from[0], cell.0 as f64 - self.from[1]];
        let mut rest = parts;
        while rest != 0 {
            let part = rest.trailing_zeros();
            rest &= rest - 1;
            let x = corner[0] + (f64::from(part % 8) + 0.5) / 8.0;
            let y = corner[1] + (f64::from(part / 8) + 0.5) / 8.0;
            let away = x * self.toward[0] + y * self.toward[1];
            let aside = (x * self.toward[1] - y * self.toward[0]).abs();
            if aside <= (self.half_rad * away).max(HALF_PART) + self.doubt + self.doubt_rad * away {
                return true;
            }
        }
        parts == 0
    }
}
