//! A beam that passes through cells, and what it tells of their parts.

use super::counts::{BLOCK_BITS, Counts};

/// Half the side of a part of a cell, in cells.
const HALF_PART: f64 = 1.0 / 16.0;

/// Bits of the fraction of a cell. Sums of such steps are off by less than a millionth of a cell over any window.
const FRACTION_BITS: u32 = 32;

/// Cells along the side of a block.
const BLOCK: i64 = 1 << BLOCK_BITS;

/// The cells of a window, by row and column of the lattice, and where they are kept: rows and columns wrap around by a power of two.
pub(super) struct Window {
    pub first: (i64, i64),
    pub last: (i64, i64),
    pub shift: u32,
}

impl Window {
    fn mask(&self) -> i64 {
        (1 << self.shift) - 1
    }

    /// The cell of an index.
    pub fn cell(&self, index: usize) -> (i64, i64) {
        let (row, column) = ((index >> self.shift) as i64, index as i64);
        let unwrapped = |first: i64, along: i64| first + (along.wrapping_sub(first) & self.mask());
        (unwrapped(self.first.0, row), unwrapped(self.first.1, column))
    }
}

/// A beam in units of cells, x right and y down.
pub(super) struct Ray {
    pub from: [f64; 2],
    pub to: [f64; 2],
    /// Half the angle to the next beam.
    pub half_rad: f64,
    /// How far the beam may be off, and by what angle.
    pub doubt: f64,
    pub doubt_rad: f64,
}

impl Ray {
    /// Calls for the cells of a window that the beam crosses and that are not surely free, nearest first and all but the last; some
    /// twice, and some that are surely free. It must begin in the window.
    pub fn each_unsure(&self, window: &Window, counts: &Counts, call: impl FnMut(usize)) {
        let [x, y] = [0, 1].map(|axis| (self.from[axis], self.to[axis]));
        let columns = (window.first.1, window.last.1, 0);
        let rows = (window.first.0, window.last.0, window.shift);
        if (x.1 - x.0).abs() >= (y.1 - y.0).abs() {
            walk((x, columns), (y, rows), window.mask(), counts, call);
        } else {
            walk((y, rows), (x, columns), window.mask(), counts, call);
        }
    }

    /// Whether the beam comes so near to a part in which something was met that it tells of it: a corner that fills a part of a
    /// cell is not gone when beams cross the rest of it.
    pub fn passes(&self, cell: (i64, i64), parts: u64) -> bool {
        let along = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
        let length = along[0].hypot(along[1]).max(1e-9);
        let toward = along.map(|part| part / length);
        let corner = [cell.1 as f64 - self.from[0], cell.0 as f64 - self.from[1]];
        let mut rest = parts;
        while rest != 0 {
            let part = rest.trailing_zeros();
            rest &= rest - 1;
            let x = corner[0] + (f64::from(part % 8) + 0.5) / 8.0;
            let y = corner[1] + (f64::from(part / 8) + 0.5) / 8.0;
            let away = x * toward[0] + y * toward[1];
            let aside = (x * toward[1] - y * toward[0]).abs();
            if aside <= (self.half_rad * away).max(HALF_PART) + self.doubt + self.doubt_rad * away {
                return true;
            }
        }
        parts == 0
    }
}

/// A line on one axis, from where to where, and the window there: first and last cell, and by how many bits their indices are shifted.
type Along = ((f64, f64), (i64, i64, u32));

/// Walks along a line by the axis on which it goes farther: every step crosses one border of that axis and at most one of the other.
/// Where that is comes from a sum of whole numbers, so no step waits for a decision.
#[inline]
fn walk(far: Along, near: Along, mask: i64, counts: &Counts, mut call: impl FnMut(usize)) {
    let (((from, to), (low, high, shift)), ((near_from, near_to), (near_low, near_high, near_shift))) = (far, near);
    let [first, last, near_first, near_last] = [from, to, near_from, near_to].map(|place| place.floor() as i64);
    let length = (to - from).abs();
    let slope = if length > 0.0 {
        (near_to - near_from) / length
    } else {
        0.0
    };
    let fixed = |cells: f64| (cells * (1_u64 << FRACTION_BITS) as f64) as i64;
    let to_border = if to > from {
        (first + 1) as f64 - from
    } else {
        from - first as f64
    };
    let border = fixed(near_from - near_first as f64 + to_border * slope);
    let slope = fixed(slope);
    // A line that has left the window does not come back: steps of which all cells are inside.
    let steps = (last - first).abs();
    let mut inside = steps;
    if !(low..=high).contains(&last) {
        inside = if to > from { high - first } else { first - low } + 1;
    }
    if !(near_low..=near_high).contains(&near_last) && slope != 0 {
        let room = if slope > 0 {
            ((near_high - near_first + 1) << FRACTION_BITS) - 1 - border
        } else {
            border - ((near_low - near_first) << FRACTION_BITS)
        };
        inside = inside.min(room.div_euclid(slope.abs()) + 1);
    }
    let inside = inside.clamp(0, steps);
    // Indices of cells, of which both axes have bits of their own; where the lattice begins does not matter to what wraps around.
    let (index_mask, near_mask) = (mask << shift, mask << near_shift);
    let near_index = |place: i64| (place >> (FRACTION_BITS - near_shift)) & near_mask;
    let forward = if to > from { 1 } else { -1 };
    let mut index = (first & mask) << shift;
    let mut place = ((near_first & mask) << FRACTION_BITS) + border;
    let mut near = (near_first & mask) << near_shift;
    let mut left = inside;
    while left > 0 {
        // To the border of the block; as the line goes no farther along the other axis, it meets two blocks at most.
        let within = (index >> shift) & (BLOCK - 1);
        let run = if forward > 0 { BLOCK - within } else { within + 1 }.min(left);
        left -= run;
        let (here, last) = (index & index_mask, near_index(place + (run - 1) * slope));
        if counts.is_block_free((here | near) as usize) && counts.is_block_free((here | last) as usize) {
            near = last;
            index += (forward * run) << shift;
            place += run * slope;
            continue;
        }
        for _ in 0..run {
            let (next, here) = (near_index(place), index & index_mask);
            let cells = [here | near, here | next].map(|index| index as usize);
            // Both are the same where the line goes on to the next step at once.
            if !(counts.is_free(cells[0]) && counts.is_free(cells[1])) {
                cells.into_iter().for_each(&mut call);
            }
            near = next;
            index += forward << shift;
            place += slope;
        }
    }
    let is_last = inside == steps && near == (near_last & mask) << near_shift;
    if !is_last && (low..=high).contains(&(first + forward * inside)) {
        call((index & index_mask | near) as usize);
    }
}
