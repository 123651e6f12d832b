//! What a search writes on a cell: fixed-point costs modulo 2^32, or floats.

/// Labels of one kind, and what a step does to them.
pub(super) trait Labels {
    /// A cell's label.
    type Label: Copy + PartialEq;
    /// The label of a cell that no way has reached.
    const UNREACHED: Self::Label;
    /// The label of the start.
    const START: Self::Label;

    /// The labels behind steps of a cost (not finite where closed), and a bit for each that improves the one that is there.
    fn improved<const N: usize>(
        &self,
        here: Self::Label,
        near: &[Self::Label; N],
        costs: &[f64; N],
    ) -> ([Self::Label; N], u32);

    /// The bucket of a label, given the bucket whose turn it is.
    fn bucket(&self, label: Self::Label, round: u64) -> u64;

    /// How many buckets the queue's circle wants.
    fn circle(&self) -> usize;

    /// The last bucket in which a cell of a cost can be.
    fn last_bucket(&self, cost: f64) -> u64;

    /// Told that a cell was labelled over the step `k`.
    fn came(&mut self, index: usize, k: usize);

    /// Whether the step `k`, of a cost, from a cell labelled `before` explains the label of a cell.
    fn explains(
        &self,
        index: usize,
        k: usize,
        before: Self::Label,
        label: Self::Label,
        cost: impl FnOnce() -> f64,
    ) -> bool;
}

/// Costs in units of a fixed size, modulo 2^32: 4 bytes a cell for ways of any length.
///
/// Neighbours differ by at most one step, so that costs of less than 2^31 units a step suffice to compare them. Steps are
/// rounded down and cost at least one unit: labels are never above the true cost in units, but for the value 0, which
/// stands for "not reached" and is passed over as 1 (once in 2^32 units).
pub(super) struct Fixed {
    /// Base 2 logarithm of the width of a bucket.
    pub(super) shift: u32,
}

/// Above every step; closed steps cost this.
const CLOSED_UNITS: f64 = i32::MAX as f64;
/// Adding this leaves the whole part of a number in the low bits of its float.
const WHOLE: f64 = (1u64 << 52) as f64;

impl Fixed {
    /// Greatest cost of a step in units: what the bucket in progress may add stays below 2^31.
    pub(super) const STEP_MAX: f64 = 2_147_000_000.0;

    /// The cost of a step in units, rounded down; `i32::MAX` where closed.
    #[inline(always)]
    pub(super) fn units(cost: f64) -> u32 {
        // Not a number compares as false.
        let cost = if cost < CLOSED_UNITS { cost } else { CLOSED_UNITS + 0.5 };
        ((cost - 0.5) + WHOLE).to_bits() as u32
    }

    /// The label behind a step that is open.
    #[inline(always)]
    fn behind(here: u32, units: u32) -> u32 {
        let label = here.wrapping_add(units);
        label.wrapping_add(u32::from(label == 0))
    }
}

impl Labels for Fixed {
    type Label = u32;
    const UNREACHED: u32 = 0;
    const START: u32 = 1;

    #[inline(always)]
    fn improved<const N: usize>(&self, here: u32, near: &[u32; N], costs: &[f64; N]) -> ([u32; N], u32) {
        let units = costs.map(Self::units);
        let mut improves = [false; N];
        for k in 0..N {
            let gap = near[k].wrapping_sub(here) as i32;
            let gap = if near[k] == Self::UNREACHED { i32::MAX } else { gap };
            improves[k] = gap > units[k] as i32;
        }
        (units.map(|units| Self::behind(here, units)), bits(improves))
    }

    #[inline(always)]
    fn bucket(&self, label: u32, round: u64) -> u64 {
        let circle = u32::MAX >> self.shift;
        round + u64::from((label >> self.shift).wrapping_sub(round as u32) & circle)
    }

    fn circle(&self) -> usize {
        1 << (32 - self.shift)
    }

    fn last_bucket(&self, cost: f64) -> u64 {
        // The margin is for the values passed over.
        (cost * (1.0 + 1e-9) / f64::from(1u32 << self.shift)) as u64 + 1
    }

    #[inline(always)]
    fn came(&mut self, _: usize, _: usize) {}

    fn explains(&self, _: usize, _: usize, before: u32, label: u32, cost: impl FnOnce() -> f64) -> bool {
        if before == Self::UNREACHED {
            return false;
        }
        let cost = cost();
        cost < CLOSED_UNITS && Self::behind(before, Self::units(cost)) == label
    }
}

/// Costs as floats, with the step that led to each cell if wanted.
pub(super) struct Floats {
    /// Buckets per unit of cost.
    pub(super) buckets_per_cost: f64,
    /// How many buckets the queue's circle has.
    pub(super) circle: usize,
    /// The step that led to every cell; empty when not wanted.
    pub(super) came: Vec<u8>,
}

impl Labels for Floats {
    type Label = f64;
    const UNREACHED: f64 = f64::INFINITY;
    const START: f64 = 0.0;

    #[inline(always)]
    fn improved<const N: usize>(&self, here: f64, near: &[f64; N], costs: &[f64; N]) -> ([f64; N], u32) {
        let labels = costs.map(|cost| here + cost);
        let improves: [bool; N] = std::array::from_fn(|k| labels[k] < near[k]);
        (labels, bits(improves))
    }

    #[inline(always)]
    fn bucket(&self, label: f64, _: u64) -> u64 {
        (label * self.buckets_per_cost) as u64
    }

    #[inline(always)]
    fn came(&mut self, index: usize, k: usize) {
        if let Some(came) = self.came.get_mut(index) {
            *came = k as u8;
        }
    }

    fn circle(&self) -> usize {
        self.circle
    }

    fn last_bucket(&self, cost: f64) -> u64 {
        ((cost * (1.0 + 1e-9) * self.buckets_per_cost) as u64).saturating_add(1)
    }

    fn explains(&self, index: usize, k: usize, before: f64, _: f64, _: impl FnOnce() -> f64) -> bool {
        before < f64::INFINITY && self.came.get(index).is_some_and(|&came| usize::from(came) == k)
    }
}

/// The bits of what holds.
#[inline(always)]
fn bits<const N: usize>(holds: [bool; N]) -> u32 {
    let mut bits = 0;
    for (k, &holds) in holds.iter().enumerate() {
        bits |= u32::from(holds) << k;
    }
    bits
}
