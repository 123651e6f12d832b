//! The steps out of a cell and what they cost, from the costs around it.

use crate::grid::{EIGHT, SIXTEEN, Step};

/// A set of steps, with the square of `W` by `W` cells that they reach and cross.
pub(super) trait Stencil<const W: usize, const N: usize> {
    /// The steps.
    const STEPS: [Step; N];

    /// What the steps cost for costs per metre around a cell; not finite where closed.
    ///
    /// `metres` is the side of a cell times any scale. With `keep`, cells that a step passes at a corner must be open.
    fn costs(around: &[[f64; W]; W], metres: f64, keep: bool) -> [f64; N];

    /// The values where the steps lead.
    #[inline(always)]
    fn pick<T: Copy>(around: &[[T; W]; W]) -> [T; N] {
        Self::STEPS.map(|step| around[(W as i32 / 2 + step.rows) as usize][(W as i32 / 2 + step.columns) as usize])
    }
}

/// The eight neighbours.
pub(super) struct Eight;

impl Stencil<3, 8> for Eight {
    const STEPS: [Step; 8] = EIGHT;

    #[inline(always)]
    fn costs(around: &[[f64; 3]; 3], metres: f64, keep: bool) -> [f64; 8] {
        let here = around[1][1];
        let (side, diagonal) = (metres / 2.0, metres * std::f64::consts::SQRT_2 / 2.0);
        let mut costs = [0.0; 8];
        for (k, cost) in costs.iter_mut().enumerate() {
            let Step { rows, columns } = EIGHT[k];
            let half = if k % 2 == 0 { side } else { diagonal };
            let ends = here + around[(1 + rows) as usize][(1 + columns) as usize];
            *cost = half * ends;
        }
        if keep {
            for k in [1, 3, 5, 7] {
                let beside = costs[k - 1] + costs[(k + 1) % 8];
                costs[k] = if beside < f64::INFINITY {
                    costs[k]
                } else {
                    f64::INFINITY
                };
            }
        }
        costs
    }
}

/// The sixteen neighbours.
pub(super) struct Sixteen;

impl Stencil<5, 16> for Sixteen {
    const STEPS: [Step; 16] = SIXTEEN;

    #[inline(always)]
    fn costs(around: &[[f64; 5]; 5], metres: f64, keep: bool) -> [f64; 16] {
        let at = |rows: i32, columns: i32| around[(2 + rows) as usize][(2 + columns) as usize];
        let near: [[f64; 3]; 3] = std::array::from_fn(|row| std::array::from_fn(|column| around[row + 1][column + 1]));
        let eight = Eight::costs(&near, metres, keep);
        std::array::from_fn(|k| {
            if k % 2 == 0 {
                return eight[k / 2];
            }
            let Step { rows, columns } = SIXTEEN[k];
            // The two cells under a knight's move; each of the four crossed has a quarter of its length.
            let (first, second) = ((rows / 2, columns / 2), (rows - rows / 2, columns - columns / 2));
            let sum = at(0, 0) + at(rows, columns) + (at(first.0, first.1) + at(second.0, second.1));
            metres * 5.0f64.sqrt() / 4.0 * sum
        })
    }
}
