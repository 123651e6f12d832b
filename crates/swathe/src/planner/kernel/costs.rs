//! Costs per metre in the caller's own kind of number.

/// A kind of number that costs per metre are given in.
pub trait CellCost: Copy + Send + Sync {
    /// Cost per metre, not negative; NaN or infinite where closed.
    fn per_metre(self) -> f64;
}

impl CellCost for f64 {
    #[inline(always)]
    fn per_metre(self) -> f64 {
        self
    }
}

macro_rules! cell_cost {
    ($($kind:ty),*) => {
        $(impl CellCost for $kind {
            #[inline(always)]
            fn per_metre(self) -> f64 {
                f64::from(self)
            }
        })*
    };
}
cell_cost!(f32, u8, u16);

/// Passable at cost 1, or closed.
impl CellCost for bool {
    #[inline(always)]
    fn per_metre(self) -> f64 {
        if self { 1.0 } else { f64::INFINITY }
    }
}

/// What one look at all costs says about them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::planner) struct Range {
    /// Least open cost above zero; infinite when there is none.
    pub(in crate::planner) least: f64,
    /// Greatest open cost; 0 when there is none.
    pub(in crate::planner) most: f64,
    /// Whether a cell costs nothing.
    pub(in crate::planner) free: bool,
    /// Whether a cell is closed.
    pub(in crate::planner) closed: bool,
}

impl Range {
    /// The range of costs, or the first cell of a cost below zero.
    pub(in crate::planner) fn of<C: CellCost>(costs: &[C]) -> Result<Self, usize> {
        let (mut least, mut most) = ([f64::INFINITY; LANES], [0.0; LANES]);
        let (mut free, mut closed, mut below) = (false, false, false);
        let mut look = |lane: usize, cost: f64| {
            below |= cost < 0.0;
            let open = cost < f64::INFINITY;
            closed |= !open;
            free |= cost == 0.0;
            let above = if cost > 0.0 { cost } else { f64::INFINITY };
            least[lane] = if above < least[lane] { above } else { least[lane] };
            let open = if open { cost } else { 0.0 };
            most[lane] = if open > most[lane] { open } else { most[lane] };
        };
        let (chunks, rest) = costs.as_chunks::<LANES>();
        for chunk in chunks {
            for (lane, cost) in chunk.iter().enumerate() {
                look(lane, cost.per_metre());
            }
        }
        for &cost in rest {
            look(0, cost.per_metre());
        }
        if below && let Some(index) = costs.iter().position(|cost| cost.per_metre() < 0.0) {
            return Err(index);
        }
        Ok(Self {
            least: least.into_iter().fold(f64::INFINITY, f64::min),
            most: most.into_iter().fold(0.0, f64::max),
            free,
            closed,
        })
    }

    /// The range of costs that were multiplied with a factor.
    pub(super) fn times(self, factor: f64) -> Self {
        Self {
            least: self.least * factor,
            most: self.most * factor,
            free: self.free || self.least * factor == 0.0,
            closed: self.closed,
        }
    }
}

/// Costs looked at side by side.
const LANES: usize = 8;
