//! Ground that is connected through all grids together.

use crate::grid::{GridGeometry, Layer};

use super::super::UnionFind;
use super::OverlappingGrids;

/// Overlaps are compared with the robot's size up to this share of a cell: a quarter offset leaves exactly a quarter.
const ROUNDING: f64 = 1e-9;

impl OverlappingGrids {
    /// Labels of every grid's cells, counted from 1 through all grids together: two cells have one label when a robot
    /// of the given size gets from one to the other along edges inside a grid, or from grid to grid where their
    /// suitable cells overlap by at least its size along both axes. 0 is no nest. This is the connectivity of
    /// [`super::GridMode::Or`].
    pub fn joined_nests(&self) -> Vec<Layer<u32>> {
        let nests: Vec<_> = (0..self.phases.len()).filter_map(|grid| self.nests(grid)).collect();
        let mut firsts = vec![0];
        for of_grid in &nests {
            firsts.push(firsts[firsts.len() - 1] + of_grid.count() as u32);
        }
        let total = firsts[firsts.len() - 1];
        let mut sets = UnionFind::new(total as usize);
        let least = self.params.size_in_cells() - ROUNDING;
        for a in 0..nests.len() {
            for b in a + 1..nests.len() {
                let south = overlapping_steps(self.phases[b].south - self.phases[a].south, least);
                let east = overlapping_steps(self.phases[b].east - self.phases[a].east, least);
                let steps = south.flat_map(|down| east.clone().map(move |right| (down, right)));
                for (down, right) in steps {
                    join_shifted(&mut sets, [&nests[a], &nests[b]], [firsts[a], firsts[b]], (down, right));
                }
            }
        }
        // Roots are least members, so new numbers follow the grids and the raster order inside each.
        let mut numbers: Vec<u32> = Vec::with_capacity(total as usize);
        let mut count = 0;
        for nest in 0..total {
            let root = sets.find(nest);
            if root == nest {
                count += 1;
                numbers.push(count);
            } else {
                numbers.push(numbers[root as usize]);
            }
        }
        let relabelled = nests.into_iter().zip(firsts).map(|(of_grid, first)| {
            let mut labels = of_grid.into_labels();
            for label in labels.data_mut().iter_mut().filter(|label| **label > 0) {
                *label = numbers[(first + *label - 1) as usize];
            }
            labels
        });
        relabelled.collect()
    }
}

/// The steps from a cell to those cells of a grid moved by `offset` cells that overlap it by at least `least` cells.
fn overlapping_steps(offset: f64, least: f64) -> impl Iterator<Item = i32> + Clone {
    (-1..=1).filter(move |&step| 1.0 - (f64::from(step) + offset).abs() >= least)
}

/// Joins the nests of two grids wherever a cell of the first and the cell one step away of the second have one.
fn join_shifted(sets: &mut UnionFind, nests: [&super::Nests; 2], firsts: [u32; 2], (down, right): (i32, i32)) {
    let geometry: GridGeometry = nests[0].geometry();
    for cell in geometry.cells() {
        let from = nests[0].label(cell);
        let to = geometry
            .offset(cell, down, right)
            .map_or(0, |near| nests[1].label(near));
        if from > 0 && to > 0 {
            sets.union(firsts[0] + from - 1, firsts[1] + to - 1);
        }
    }
}
