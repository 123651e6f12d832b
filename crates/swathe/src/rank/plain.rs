//! Ranks of plain terrain by arithmetic that the compiler turns into vector instructions, and a look-up for each cell.

use crate::vehicle::Vehicle;

use super::CellRank;
use super::criteria::Criteria;

/// Cells that are ranked in one go; what is known of them in between stays in the nearest cache.
pub(super) const STRETCH: usize = 256;

/// Mark of a cell that the tables alone do not decide.
const DOUBTFUL: u8 = 0x80;

/// Ranks by exceeded bands and soil code, with the squared slopes up to which they hold.
#[derive(Clone, Debug)]
pub(super) struct PlainRanks {
    /// At eight times the number of exceeded bands plus the code of the soil.
    ranks: [CellRank; 32],
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
        Self {
            ranks: std::array::from_fn(|index| ranks[index % 8][index / 8]),
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
        [north, here, south]: [&[f32]; 3],
        soil: Option<&[u8]>,
        out: &mut [T],
        wrap: impl Fn(CellRank) -> T,
        alone: impl Fn(usize) -> CellRank,
    ) {
        let (mut slopes, mut entries) = ([0.0; STRETCH], [0; STRETCH]);
        let cells = out.len();
        let (slopes, entries) = (&mut slopes[..cells], &mut entries[..cells]);
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
            let exceeded = u8::from(slope > first) + u8::from(slope > second) + u8::from(slope > limit);
            // An unknown slope fails both comparisons.
            // Both are compared, so that no branch keeps the loop from becoming vector code.
            #[allow(clippy::needless_bitwise_bool, reason = "a branch would keep the loop scalar")]
            let decided = (slope <= everywhere) | (slope > limit);
            *entry = exceeded << 3 | if decided { 0 } else { DOUBTFUL };
            doubts |= *entry;
        }
        if let Some(soil) = soil {
            for (entry, code) in entries.iter_mut().zip(soil) {
                *entry |= code & 7;
            }
        }
        let rank = |entry: u8| self.ranks[usize::from(entry & 31)];
        if doubts & DOUBTFUL == 0 {
            for (cell, &entry) in out.iter_mut().zip(&*entries) {
                *cell = wrap(rank(entry));
            }
            return;
        }
        for (place, (cell, &entry)) in out.iter_mut().zip(&*entries).enumerate() {
            let decided = entry & DOUBTFUL == 0 || slopes[place] <= self.plain_squared[usize::from(entry & 7)];
            *cell = wrap(if decided { rank(entry) } else { alone(place) });
        }
    }
}

/// Square of Horn's slope; differences are taken first so that single precision loses nothing that the heights had.
#[inline]
pub(super) fn slope_squared([nw, n, ne, w, e, sw, s, se]: [f32; 8], scale: f32) -> f32 {
    let east = (ne - nw) + 2.0 * (e - w) + (se - sw);
    let north = (nw - sw) + 2.0 * (n - s) + (ne - se);
    (east * east + north * north) * scale
}
