//! The search over a grid of costs per metre: Dijkstra with buckets, on fixed-point costs that the result is checked
//! against, inside limits from a coarse grid.
//!
//! 1. One look at all costs finds their range. Costs beyond what products of floats hold are scaled by a power of two.
//! 2. A search in a tube around the way over the coarse grid gives a way, hence an upper bound on the least cost. With the
//!    coarse lower bounds it tells for every block when it is too late to expand its cells ([`limits`]).
//! 3. The search inside these limits writes 4 bytes a cell ([`labels::Fixed`]), without parents.
//! 4. The cost of the way is worked out in floats. Rounding down makes the fixed-point cost a lower bound; when both are
//!    further apart than [`PROMISE`], as after free or very unequal costs, the search is done again in floats.

#![allow(
    clippy::inline_always,
    reason = "the loop is one page of code in five files, and half as fast when its parts are called"
)]

mod costs;
mod labels;
mod limits;
mod queue;
mod settle;
mod stencil;
#[cfg(test)]
mod tests;
mod way;

use crate::grid::Cell;
use crate::progress::Report;

use super::PlannerError;
use super::search::Search;
use labels::{Fixed, Floats, Labels};
use limits::Coarse;
use settle::Settled;
use stencil::{Eight, Sixteen, Stencil};
use way::Way;

pub use costs::CellCost;
pub(super) use costs::Range;
pub(super) use queue::Buckets;
pub(super) use settle::Ground;

/// Greatest relative distance of a returned cost to the least one.
const PROMISE: f64 = 1e-8;
/// Maps of fewer cells are searched without limits.
const GUIDED_CELLS: usize = 1 << 12;
/// Outside these, costs are scaled so that sums and products of them are floats in full precision.
const FLOAT_COSTS: std::ops::RangeInclusive<f64> = 1e-250..=1e250;
/// Fewest units of the least step in fixed point.
const LEAST_UNITS_MIN: f64 = 256.0;
/// Fewest units of a step over cheap ground that let fixed-point costs hope to keep the promise.
const CHEAP_UNITS_MIN: f64 = 0.5 / PROMISE;
/// Cells that are looked at to learn what is usual.
const SAMPLE: usize = 1 << 10;
/// Widths of buckets in units, as powers of two.
const SHIFTS: std::ops::RangeInclusive<u32> = 16..=26;
/// Most buckets of the circle for floats.
const FLOAT_BUCKETS: f64 = 65536.0;
/// Buckets for floats that a step over usual ground spans at most.
const BUCKETS_PER_STEP: f64 = 64.0;

/// What is asked of the search.
#[derive(Clone, Copy, Debug)]
pub(super) struct Request {
    pub(super) start: Cell,
    pub(super) goal: Cell,
    pub(super) sixteen: bool,
    /// Whether the coarse grid limits the search.
    pub(super) guided: bool,
    /// Most bytes that the search may hold.
    pub(super) memory_limit_bytes: Option<u64>,
}

/// Bytes a cell of fixed-point labels.
pub(super) const FIXED_BYTES: u64 = 4;
/// Bytes a cell of floats and the steps that led there.
const FLOAT_BYTES: u64 = 9;

impl Request {
    /// Refuses a search that holds `per_cell` bytes a cell beside what goes by the rim of the map and by blocks.
    pub(super) fn require(&self, rows: usize, columns: usize, per_cell: u64) -> Result<(), PlannerError> {
        // Buckets hold the rim of what is settled.
        let queue = 256 * (rows + columns) as u64;
        let coarse = limits::bytes(rows, columns, limits::shift(self.start, self.goal));
        let needed = per_cell * (rows * columns) as u64 + queue + if self.guided { coarse } else { 0 };
        match self.memory_limit_bytes {
            Some(limit) if needed > limit => Err(PlannerError::Memory {
                needed,
                limit,
                cells: (limit as f64 * (rows * columns) as f64 / needed as f64) as u64,
            }),
            _ => Ok(()),
        }
    }
}

/// What costs are to be multiplied with before the search, if anything.
fn factor(range: Range) -> Option<f64> {
    let outside = range.most > 0.0 && !FLOAT_COSTS.contains(&range.most);
    outside.then(|| 2.0f64.powi(if range.most > 1.0 { -400 } else { 600 }))
}

/// A cheapest way; ends and costs were checked.
///
/// # Errors
/// [`PlannerError::Memory`].
pub(super) fn find<C: CellCost>(
    ground: &Ground<C>,
    range: Range,
    request: Request,
    report: &mut Report,
) -> Result<Search, PlannerError> {
    if request.start == request.goal {
        let cells = vec![request.start];
        return Ok(Search::Found { cells, cost: 0.0 });
    }
    if let Some(factor) = factor(range) {
        let per_cell = FLOAT_BYTES + size_of::<f64>() as u64;
        request.require(ground.rows, ground.columns, per_cell)?;
        let costs: Vec<f64> = ground.costs.iter().map(|cost| cost.per_metre() * factor).collect();
        let scaled = ground.with_costs(&costs);
        let mut found = find(&scaled, range.times(factor), request, report)?;
        if let Search::Found { cost, .. } = &mut found {
            *cost /= factor;
        }
        return Ok(found);
    }
    if request.sixteen {
        find_over::<C, Sixteen, 5, 16>(ground, range, request, report)
    } else {
        find_over::<C, Eight, 3, 8>(ground, range, request, report)
    }
}

fn find_over<C: CellCost, S: Stencil<W, N>, const W: usize, const N: usize>(
    ground: &Ground<C>,
    range: Range,
    request: Request,
    report: &mut Report,
) -> Result<Search, PlannerError> {
    let (rows, columns) = (ground.rows, ground.columns);
    let longest = S::STEPS.iter().map(|step| step.length_cells()).fold(0.0, f64::max);
    let mut settled = 0;
    let unit_metres = Fixed::STEP_MAX / (range.most * longest);
    let least_units = range.least * unit_metres;
    let [cheap, _] = usual(ground.costs);
    if !range.free && least_units >= LEAST_UNITS_MIN && cheap * unit_metres >= CHEAP_UNITS_MIN {
        request.require(rows, columns, FIXED_BYTES)?;
        let shift = least_units.log2().floor() as u32;
        let mut kind = Fixed {
            shift: shift.clamp(*SHIFTS.start(), *SHIFTS.end()),
        };
        let in_units = ground.with_metres(unit_metres);
        let way = match way_over::<C, S, _, W, N>(&in_units, &mut kind, request, &mut settled, report) {
            Ok(way) => way,
            Err(no_way) => return Ok(no_way),
        };
        let units = way.cost::<C, S, W, N>(&in_units);
        let passed_over = 1.0 + units / f64::from(u32::MAX);
        let least = way.units::<C, S, W, N>(&in_units) as f64 - passed_over;
        if units - least <= PROMISE * units {
            return Ok(way.into_search::<C, S, W, N>(ground));
        }
    }
    request.require(rows, columns, FLOAT_BYTES)?;
    let mut kind = floats(ground, range);
    kind.came = vec![0; rows * columns];
    Ok(
        match way_over::<C, S, _, W, N>(ground, &mut kind, request, &mut settled, report) {
            Ok(way) => way.into_search::<C, S, W, N>(ground),
            Err(no_way) => no_way,
        },
    )
}

/// The lower quartile and the median of open costs above zero, from a sample; 0 when it holds none.
fn usual<C: CellCost>(costs: &[C]) -> [f64; 2] {
    let every = (costs.len() / SAMPLE).max(1) | 1;
    let open = |cost: &f64| *cost > 0.0 && *cost < f64::INFINITY;
    let mut sample: Vec<f64> = costs
        .iter()
        .step_by(every)
        .map(|cost| cost.per_metre())
        .filter(open)
        .collect();
    sample.sort_by(f64::total_cmp);
    [4, 2].map(|part| sample.get(sample.len() / part).copied().unwrap_or(0.0))
}

/// Floats as labels, with buckets that suit the costs: within wide ones cells are taken again, narrow ones are many.
fn floats<C: CellCost>(ground: &Ground<C>, range: Range) -> Floats {
    let [_, median] = usual(ground.costs);
    let width = range.least.max(median / BUCKETS_PER_STEP) * ground.metres;
    if !width.is_finite() {
        return Floats {
            buckets_per_cost: 1.0,
            circle: 2,
            came: Vec::new(),
        };
    }
    // A knight's move is the longest step; costlier ones wait outside the circle.
    let longest = (3.0 * range.most * ground.metres / width).min(FLOAT_BUCKETS - 2.0);
    Floats {
        buckets_per_cost: 1.0 / width,
        circle: (longest as usize + 2).next_power_of_two(),
        came: Vec::new(),
    }
}

/// Costs from `start` to all cells in floats, infinite where no way leads; `None` when the caller asked to stop.
///
/// # Errors
/// [`PlannerError::Memory`].
pub(super) fn field<C: CellCost>(
    ground: &Ground<C>,
    range: Range,
    request: Request,
    report: &mut Report,
) -> Result<Option<Vec<f64>>, PlannerError> {
    if let Some(factor) = factor(range) {
        request.require(ground.rows, ground.columns, 2 * size_of::<f64>() as u64)?;
        let costs: Vec<f64> = ground.costs.iter().map(|cost| cost.per_metre() * factor).collect();
        let found = field(&ground.with_costs(&costs), range.times(factor), request, report)?;
        return Ok(found.map(|field| field.into_iter().map(|cost| cost / factor).collect()));
    }
    request.require(ground.rows, ground.columns, size_of::<f64>() as u64)?;
    let start = request.start.row * ground.columns + request.start.column;
    let mut labels = vec![f64::INFINITY; ground.rows * ground.columns];
    if !ground.costs[start].per_metre().is_finite() {
        return Ok(Some(labels));
    }
    let (mut kind, mut settled) = (floats(ground, range), 0);
    let (labels_, settled_) = (&mut labels, &mut settled);
    let ended = if request.sixteen {
        ground.settle::<Sixteen, _, 5, 16>(start, None, None, &mut kind, labels_, settled_, report)
    } else {
        ground.settle::<Eight, _, 3, 8>(start, None, None, &mut kind, labels_, settled_, report)
    };
    Ok((ended != Settled::Stopped).then_some(labels))
}

/// A cheapest way in labels of one kind, or why there is none.
fn way_over<C: CellCost, S: Stencil<W, N>, L: Labels, const W: usize, const N: usize>(
    ground: &Ground<C>,
    kind: &mut L,
    request: Request,
    settled: &mut u64,
    report: &mut Report,
) -> Result<Way, Search> {
    let index = |cell: Cell| cell.row * ground.columns + cell.column;
    let ends = [index(request.start), index(request.goal)];
    let mut labels = vec![L::UNREACHED; ground.rows * ground.columns];
    let mut limits = None;
    if request.guided && labels.len() >= GUIDED_CELLS {
        let mut coarse = Coarse::new(ground, request.start, request.goal, request.sixteen);
        if coarse.bound(request.start) == f64::INFINITY {
            return Err(Search::Unreachable);
        }
        let tube = coarse.tube(request.start);
        let tried =
            ground.settle::<S, L, W, N>(ends[0], Some(ends[1]), Some(&tube), kind, &mut labels, settled, report);
        if tried == Settled::Stopped {
            return Err(Search::Stopped);
        }
        if tried == Settled::Goal {
            let most = Way::trace::<C, S, L, W, N>(ground, kind, &labels, ends).cost::<C, S, W, N>(ground);
            limits = Some(coarse.limits(most * (1.0 + 1e-12), |cost| kind.last_bucket(cost)));
        }
        coarse.for_each_labelled(&tube, |range| labels[range].fill(L::UNREACHED));
    }
    let ended = ground.settle::<S, L, W, N>(
        ends[0],
        Some(ends[1]),
        limits.as_ref(),
        kind,
        &mut labels,
        settled,
        report,
    );
    match ended {
        Settled::Goal => Ok(Way::trace::<C, S, L, W, N>(ground, kind, &labels, ends)),
        Settled::All => Err(Search::Unreachable),
        Settled::Stopped => Err(Search::Stopped),
    }
}
