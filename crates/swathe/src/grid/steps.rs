//! Steps from a cell to its neighbours: 4, 8 and 16 directions, and discs.

use super::{Cell, GridGeometry};

/// A step from a cell to a neighbour. Rows grow southwards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// Rows to the south.
    pub rows: i32,
    /// Columns to the east.
    pub columns: i32,
}

impl Step {
    const fn new(rows: i32, columns: i32) -> Self {
        Self { rows, columns }
    }

    /// Length in cells.
    pub fn length_cells(self) -> f64 {
        f64::from(self.rows).hypot(f64::from(self.columns))
    }

    /// Heading, counter-clockwise from east.
    pub fn heading_rad(self) -> f64 {
        f64::from(-self.rows).atan2(f64::from(self.columns))
    }

    /// The neighbour of a cell, if inside the grid.
    pub fn from(self, geometry: &GridGeometry, cell: Cell) -> Option<Cell> {
        geometry.offset(cell, self.rows, self.columns)
    }
}

/// The 16 directions counter-clockwise from east: axes, diagonals and knight's moves between them.
/// Direction `k + 8` is the reverse of direction `k`.
pub const SIXTEEN: [Step; 16] = [
    Step::new(0, 1),
    Step::new(-1, 2),
    Step::new(-1, 1),
    Step::new(-2, 1),
    Step::new(-1, 0),
    Step::new(-2, -1),
    Step::new(-1, -1),
    Step::new(-1, -2),
    Step::new(0, -1),
    Step::new(1, -2),
    Step::new(1, -1),
    Step::new(2, -1),
    Step::new(1, 0),
    Step::new(2, 1),
    Step::new(1, 1),
    Step::new(1, 2),
];

/// The 8 neighbours counter-clockwise from east (every second one of [`SIXTEEN`]).
pub const EIGHT: [Step; 8] = [
    SIXTEEN[0],
    SIXTEEN[2],
    SIXTEEN[4],
    SIXTEEN[6],
    SIXTEEN[8],
    SIXTEEN[10],
    SIXTEEN[12],
    SIXTEEN[14],
];

/// The 4 neighbours that share an edge, counter-clockwise from east.
pub const FOUR: [Step; 4] = [SIXTEEN[0], SIXTEEN[4], SIXTEEN[8], SIXTEEN[12]];

/// Every step of at most `radius_cells`, the zero step included, in row-major order.
pub fn disc(radius_cells: f64) -> Vec<Step> {
    let reach = radius_cells.max(0.0).floor() as i32;
    let mut steps = Vec::new();
    for rows in -reach..=reach {
        for columns in -reach..=reach {
            let step = Step::new(rows, columns);
            if step.length_cells() <= radius_cells {
                steps.push(step);
            }
        }
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_turn_counter_clockwise_and_reverse_after_eight() {
        for k in 0..16 {
            let turn = SIXTEEN[(k + 1) % 16].heading_rad() - SIXTEEN[k].heading_rad();
            assert!((0.3..0.5).contains(&turn.rem_euclid(std::f64::consts::TAU)));
            let reverse = SIXTEEN[(k + 8) % 16];
            assert_eq!((reverse.rows, reverse.columns), (-SIXTEEN[k].rows, -SIXTEEN[k].columns));
        }
    }

    #[test]
    fn discs_grow_by_distance() {
        assert_eq!(disc(0.0).len(), 1);
        assert_eq!(disc(1.0).len(), 5);
        assert_eq!(disc(1.5).len(), 9);
        assert_eq!(disc(2.0).len(), 13);
    }
}
