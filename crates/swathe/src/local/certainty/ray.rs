//! A beam that passes through cells, and what it tells of their parts.

use super::counts::{BLOCK_BITS, Counts};

/// Half the side of a part of a cell, in cells.
const HALF_PART: f64 = 1.0 / 16.0;

/// Bits of the fraction of a cell. Sums of a thousand such steps are off by less than a millionth of a cell.
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
    /// Calls for the cells of a window that the beam crosses, nearest first, all but surely free ones and the last; some are told twice,
    /// and free ones beside others. It must begin in the window.
    pub fn each_unsure(&self, window: &Window, counts: &Counts, call: impl FnMut(usize)) {
        let along = |axis: usize, low: i64, high: i64, shift: u32| Along {
            from: self.from[axis],
            to: self.to[axis],
            low,
            high,
            shift,
        };
        let x = along(0, window.first.1, window.last.1, 0);
        let y = along(1, window.first.0, window.last.0, window.shift);
        if x.length() >= y.length() {
            walk(&x, &y, window.mask(), counts, call);
        } else {
            walk(&y, &x, window.mask(), counts, call);
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

/// What there is of a line along one axis.
struct Along {
    /// Where it begins and ends.
    from: f64,
    to: f64,
    /// First and last cell of the window.
    low: i64,
    high: i64,
    /// By how many bits the indices of cells are shifted.
    shift: u32,
}

impl Along {
    fn length(&self) -> f64 {
        (self.to - self.from).abs()
    }
}

/// Walks along a line by the axis on which it goes farther: every step crosses one border of that axis and at most one of the other.
/// Where that is comes from a sum of whole numbers, so nothing decides which axis is next.
#[inline]
fn walk(far: &Along, near: &Along, mask: i64, counts: &Counts, mut call: impl FnMut(usize)) {
    let [first, last] = [far.from, far.to].map(|place| place.floor() as i64);
    let [near_first, near_last] = [near.from, near.to].map(|place| place.floor() as i64);
    let length = far.length();
    let slope = if length > 0.0 {
        (near.to - near.from) / length
    } else {
        0.0
    };
    let fixed = |cells: f64| (cells * (1_u64 << FRACTION_BITS) as f64) as i64;
    let is_forward = far.to > far.from;
    let to_border = if is_forward {
        (first + 1) as f64 - far.from
    } else {
        far.from - first as f64
    };
    let border = fixed(near.from - near_first as f64 + to_border * slope);
    let slope = fixed(slope);
    // A line that has left the window does not come back: steps of which all cells are inside.
    let steps = (last - first).abs();
    let to_leave = if is_forward { far.high - first } else { first - far.low } + 1;
    let room = if slope >= 0 {
        ((near.high - near_first + 1) << FRACTION_BITS) - 1 - border
    } else {
        border - ((near.low - near_first) << FRACTION_BITS)
    };
    let to_leave_near = room.div_euclid(slope.abs().max(1)) + 1;
    let inside = steps.min(to_leave).min(to_leave_near).max(0);
    // Indices of cells, of which both axes have bits of their own; where the lattice begins does not matter to what wraps around.
    let (far_mask, near_mask) = (mask << far.shift, mask << near.shift);
    let near_index = |place: i64| (place >> (FRACTION_BITS - near.shift)) & near_mask;
    let forward = if is_forward { 1 } else { -1 };
    let mut index = (first & mask) << far.shift;
    let mut place = ((near_first & mask) << FRACTION_BITS) + border;
    let mut beside = (near_first & mask) << near.shift;
    let mut left = inside;
    while left > 0 {
        // To the border of the block; as the line goes no farther along the other axis, it meets two blocks at most.
        let within = (index >> far.shift) & (BLOCK - 1);
        let run = if is_forward { BLOCK - within } else { within + 1 }.min(left);
        left -= run;
        let here = index & far_mask;
        let beside_last = near_index(place + (run - 1) * slope);
        if counts.is_block_free((here | beside) as usize) && counts.is_block_free((here | beside_last) as usize) {
            beside = beside_last;
            index += (forward * run) << far.shift;
            place += run * slope;
            continue;
        }
        for _ in 0..run {
            let (here, next) = (index & far_mask, near_index(place));
            let cells = [here | beside, here | next].map(|index| index as usize);
            // Both are the same where the line goes on to the next step at once.
            if !(counts.is_free(cells[0]) && counts.is_free(cells[1])) {
                cells.into_iter().for_each(&mut call);
            }
            beside = next;
            index += forward << far.shift;
            place += slope;
        }
    }
    let is_last = inside == steps && beside == (near_last & mask) << near.shift;
    if !is_last && (far.low..=far.high).contains(&(first + forward * inside)) {
        call((index & far_mask | beside) as usize);
    }
}
