//! Ranks of plain terrain by arithmetic that the compiler turns into vector instructions, and a look-up for each two cells.
//!
//! The code is compiled twice, and the version for the wider vectors is taken where the processor has them. Both do the same
//! operations in the same order, so the ranks are the same.

use pulp::Arch;

use crate::vehicle::Vehicle;

use super::CellRank;
use super::criteria::Criteria;

/// Cells that are ranked in one go; what is known of them in between stays in the nearest cache.
pub(super) const STRETCH: usize = 256;

/// The bits of an entry that the table is asked for, and those of two entries.
const ENTRY: u8 = 31;
const PAIR: u16 = u16::from_ne_bytes([ENTRY; 2]);
const PAIRS: usize = PAIR as usize + 1;

/// Mark of a cell that the tables alone do not decide.
const DOUBTFUL: u8 = 0x80;

/// Ranks by exceeded bands and soil code, with the squared slopes up to which they hold.
#[derive(Clone, Debug)]
pub(super) struct PlainRanks {
    /// Ranks of two cells, at their two entries: eight times the number of exceeded bands plus the code of the soil.
    pairs: Box<[u16; PAIRS]>,
    bands_squared: [f32; 3],
    /// By soil code: up to here, or beyond the limit, the table decides.
    plain_squared: [f32; 8],
    /// The least of them.
    plain_squared_everywhere: f32,
    scale: f32,
}

impl PlainRanks {
    pub(super) fn new(criteria: &Criteria, vehicle: &Vehicle, cell_size_m: f64) -> Self {
        let (ranks, steepest) = criteria.tables();
        // Down or up a slope some of the sixteen headings lies within 13.3 degrees of the fall line, where the side slope
        // is at most 0.23 of the slope: up to here the heading gate cannot fail.
        let headed = vehicle.max_grade().min(vehicle.max_side_slope() / 0.23);
        let headed_squared = (headed * headed * (1.0 - 1e-6)) as f32;
        let plain_squared = steepest.map(|squared| squared.min(headed_squared));
        let run = 8.0 * cell_size_m as f32;
        let byte = |entry: u8| ranks[usize::from(entry % 8)][usize::from(entry / 8)].byte();
        let mut pairs = Box::new([0; PAIRS]);
        for first in 0..=ENTRY {
            for second in 0..=ENTRY {
                let ranks = u16::from_ne_bytes([byte(first), byte(second)]);
                pairs[usize::from(u16::from_ne_bytes([first, second]))] = ranks;
            }
        }
        Self {
            pairs,
            bands_squared: criteria.bands_squared(),
            plain_squared,
            plain_squared_everywhere: plain_squared.into_iter().fold(f32::INFINITY, f32::min),
            scale: 1.0 / (run * run),
        }
    }

    /// Ranks the cells of `out`, at most [`STRETCH`], from three rows of heights that begin one cell to the west and end one
    /// to the east. `alone` ranks a cell that the tables do not decide.
    pub(super) fn rank<T>(
        &self,
        heights: [&[f32]; 3],
        soil: Option<&[u8]>,
        out: &mut [T],
        wrap: impl Fn(CellRank) -> T,
        alone: impl Fn(usize) -> CellRank,
    ) {
        Arch::new().dispatch(|| self.rank_in_vectors(heights, soil, out, wrap, alone));
    }

    #[inline(always)]
    #[allow(
        clippy::inline_always,
        reason = "code takes on the vectors of the function that it stands in"
    )]
    fn rank_in_vectors<T>(
        &self,
        [north, here, south]: [&[f32]; 3],
        soil: Option<&[u8]>,
        out: &mut [T],
        wrap: impl Fn(CellRank) -> T,
        alone: impl Fn(usize) -> CellRank,
    ) {
        let (mut slopes, mut all_entries) = ([0.0; STRETCH], [0; STRETCH]);
        let cells = out.len();
        let (slopes, entries) = (&mut slopes[..cells], &mut all_entries[..cells]);
        let [(nw, n, ne), (w, h, e), (sw, s, se)] =
            [north, here, south].map(|row| (&row[..cells], &row[1..=cells], &row[2..cells + 2]));
        for (i, slope) in slopes.iter_mut().enumerate() {
            let around = [nw[i], n[i], ne[i], w[i], e[i], sw[i], s[i], se[i]];
            // Adding nothing of the cell's own height makes an unknown cell's slope unknown.
            *slope = slope_squared(around, self.scale) + 0.0 * h[i];
        }
        let [first, second, limit] = self.bands_squared;
        let everywhere = self.plain_squared_everywhere;
        let mut doubts = 0;
        for (entry, &slope) in entries.iter_mut().zip(&*slopes) {
            // In words as wide as the slope's, so that the answers are made narrow once.
            let exceeded = u32::from(slope > first) + u32::from(slope > second) + u32::from(slope > limit);
            // An unknown slope fails both comparisons.
            // Both are compared, so that no branch keeps the loop from becoming vector code.
            #[allow(clippy::needless_bitwise_bool, reason = "a branch would keep the loop scalar")]
            let decided = (slope <= everywhere) | (slope > limit);
            let marked = exceeded << 3 | u32::from(!decided) << DOUBTFUL.trailing_zeros();
            doubts |= marked;
            *entry = marked as u8;
        }
        if let Some(soil) = soil {
            for (entry, code) in entries.iter_mut().zip(soil) {
                *entry |= code & 7;
            }
        }
        let mut ranks = [0; STRETCH];
        // What stands beyond the cells of the stretch is looked up too, and not used.
        for (ranks, entries) in ranks.as_chunks_mut().0.iter_mut().zip(all_entries.as_chunks().0) {
            let pair = u16::from_ne_bytes(*entries) & PAIR;
            *ranks = self.pairs[usize::from(pair)].to_ne_bytes();
        }
        if doubts & u32::from(DOUBTFUL) > 0 {
            for (place, (rank, &entry)) in ranks.iter_mut().zip(&all_entries[..cells]).enumerate() {
                let decided = entry & DOUBTFUL == 0 || slopes[place] <= self.plain_squared[usize::from(entry & 7)];
                if !decided {
                    *rank = alone(place).byte();
                }
            }
        }
        for (cell, &rank) in out.iter_mut().zip(&ranks) {
            *cell = wrap(CellRank(rank));
        }
    }
}

/// Square of Horn's slope; differences are taken first so that single precision loses nothing that the heights had.
#[inline(always)]
#[allow(
    clippy::inline_always,
    reason = "code takes on the vectors of the function that it stands in"
)]
pub(super) fn slope_squared([nw, n, ne, w, e, sw, s, se]: [f32; 8], scale: f32) -> f32 {
    let east = (ne - nw) + 2.0 * (e - w) + (se - sw);
    let north = (nw - sw) + 2.0 * (n - s) + (ne - se);
    (east * east + north * north) * scale
}
