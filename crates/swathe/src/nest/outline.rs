//! Outlines of nests as closed rings along cell edges.

use crate::grid::{GridGeometry, Position};

use super::Nests;

/// A closed ring of map positions, the first repeated at the end.
pub type Ring = Vec<Position>;

/// One polygon of a nest: its outer ring counter-clockwise, holes clockwise.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Label of the nest.
    pub nest: u32,
    /// Outer ring.
    pub exterior: Ring,
    /// Holes.
    pub holes: Vec<Ring>,
}

/// Directions of travel along cell edges: east, north, west, south as (rows, columns) of grid corners.
const TURNS: [(i64, i64); 4] = [(0, 1), (-1, 0), (0, -1), (1, 0)];

/// The outlines of every nest, ordered by nest. Parts of a nest that touch only at corners are polygons of their own.
///
/// `wanted` chooses nests by label.
pub fn outlines(nests: &Nests, wanted: impl Fn(u32) -> bool) -> Vec<Outline> {
    let geometry = nests.geometry();
    let mut traced = vec![false; geometry.cell_count()];
    let mut exteriors: Vec<(u32, Vec<(i64, i64)>)> = Vec::new();
    let mut holes: Vec<(u32, Vec<(i64, i64)>)> = Vec::new();
    for cell in geometry.cells() {
        let nest = nests.label(cell);
        let index = geometry.index(cell);
        let south = geometry.offset(cell, 1, 0).map_or(0, |near| nests.label(near));
        if nest == 0 || south == nest || traced[index] || !wanted(nest) {
            continue;
        }
        let ring = trace(nests, nest, (cell.row as i64 + 1, cell.column as i64), &mut traced);
        if doubled_area(&ring) > 0 {
            exteriors.push((nest, ring));
        } else {
            holes.push((nest, ring));
        }
    }
    exteriors.sort_by_key(|(nest, _)| *nest);
    let mut found: Vec<Outline> = exteriors
        .iter()
        .map(|(nest, ring)| Outline {
            nest: *nest,
            exterior: positions(&geometry, ring),
            holes: Vec::new(),
        })
        .collect();
    for (nest, ring) in holes {
        let first = exteriors.partition_point(|(other, _)| *other < nest);
        let same = exteriors[first..].iter().take_while(|(other, _)| *other == nest);
        // The smallest ring around the hole is its own polygon's.
        let owner = same
            .enumerate()
            .filter(|(_, (_, exterior))| holds(exterior, &ring))
            .min_by_key(|(_, (_, exterior))| doubled_area(exterior));
        if let Some((index, _)) = owner {
            found[first + index].holes.push(positions(&geometry, &ring));
        }
    }
    found
}

/// Walks along the edge of a nest with the nest on the left, from the south-west corner of a cell to the east.
fn trace(nests: &Nests, nest: u32, start: (i64, i64), traced: &mut [bool]) -> Vec<(i64, i64)> {
    let geometry = nests.geometry();
    let inside = |row: i64, column: i64| {
        geometry
            .checked(row, column)
            .is_some_and(|cell| nests.label(cell) == nest)
    };
    let mut ring = vec![start];
    let (mut corner, mut direction) = (start, 0usize);
    loop {
        if direction == 0 {
            let cell = geometry.checked(corner.0 - 1, corner.1);
            if let Some(cell) = cell {
                traced[geometry.index(cell)] = true;
            }
        }
        let (rows, columns) = TURNS[direction];
        corner = (corner.0 + rows, corner.1 + columns);
        // The two cells beyond this corner, left and right of the direction of travel.
        let (left, right) = match direction {
            0 => ((corner.0 - 1, corner.1), (corner.0, corner.1)),
            1 => ((corner.0 - 1, corner.1 - 1), (corner.0 - 1, corner.1)),
            2 => ((corner.0, corner.1 - 1), (corner.0 - 1, corner.1 - 1)),
            _ => ((corner.0, corner.1), (corner.0, corner.1 - 1)),
        };
        let turned = if !inside(left.0, left.1) {
            (direction + 1) % 4
        } else if inside(right.0, right.1) {
            (direction + 3) % 4
        } else {
            direction
        };
        if corner == start && turned == 0 {
            ring.push(start);
            return ring;
        }
        if turned != direction {
            ring.push(corner);
        }
        direction = turned;
    }
}

/// Twice the signed area in cells, positive counter-clockwise with north up.
fn doubled_area(ring: &[(i64, i64)]) -> i64 {
    ring.windows(2)
        .map(|pair| {
            let ((row_a, column_a), (row_b, column_b)) = (pair[0], pair[1]);
            row_a * column_b - row_b * column_a
        })
        .sum()
}

/// Whether a ring of the same nest holds another (tested at the middle of the other's first edge, just outside the
/// nest).
fn holds(exterior: &[(i64, i64)], hole: &[(i64, i64)]) -> bool {
    // The first edge of a traced ring runs east; the cell south of it is in the hole.
    let (row, column) = (hole[0].0 as f64 + 0.5, hole[0].1 as f64 + 0.5);
    let crossings = exterior
        .windows(2)
        .filter(|pair| {
            let ((row_a, column_a), (row_b, _)) = (pair[0], pair[1]);
            let (low, high) = (row_a.min(row_b) as f64, row_a.max(row_b) as f64);
            low <= row && row < high && column < column_a as f64
        })
        .count();
    crossings % 2 == 1
}

fn positions(geometry: &GridGeometry, ring: &[(i64, i64)]) -> Ring {
    let size = geometry.cell_size_m();
    ring.iter()
        .map(|&(row, column)| {
            Position::new(
                geometry.west_m() + column as f64 * size,
                geometry.north_m() - row as f64 * size,
            )
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nest::{Contact, NestParams, Vicinity, exact_nests};
    use crate::rank::RankMap;
    use proptest::prelude::*;

    fn area(ring: &Ring) -> f64 {
        let doubled: f64 = ring.windows(2).map(|p| p[0].x_m * p[1].y_m - p[1].x_m * p[0].y_m).sum();
        doubled / 2.0
    }

    fn nests(rows: usize, columns: usize, ranks: &[u8], contact: Contact) -> Nests {
        let geometry = GridGeometry::new(rows, columns, 2.0, 10.0, 90.0).unwrap();
        let map = RankMap::from_ranks(geometry, ranks).unwrap();
        let params = NestParams {
            vicinity: Vicinity::Cell,
            contact,
            ..NestParams::default()
        };
        exact_nests(&map, None, &params).unwrap()
    }

    #[test]
    fn a_ring_around_a_hole_has_both() {
        let ranks = [9, 9, 9, 9, 1, 9, 9, 9, 9];
        let found = outlines(&nests(3, 3, &ranks, Contact::Edge), |_| true);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].exterior.len(), 5);
        assert_eq!(area(&found[0].exterior), 36.0);
        assert_eq!(area(&found[0].holes[0]), -4.0);
    }

    proptest! {
        #[test]
        fn areas_are_those_of_the_cells(
            columns in 1usize..9, ranks in prop::collection::vec(prop_oneof![Just(1u8), Just(9u8)], 72), corner: bool,
        ) {
            let rows = 72 / 9;
            let ranks: Vec<u8> = ranks.chunks(9).flat_map(|row| &row[..columns]).copied().collect();
            let nests = nests(rows, columns, &ranks, if corner { Contact::Corner } else { Contact::Edge });
            let found = outlines(&nests, |_| true);
            for (nest, &size) in (1..).zip(nests.sizes()) {
                let parts = found.iter().filter(|outline| outline.nest == nest);
                let total: f64 = parts
                    .flat_map(|part| std::iter::once(&part.exterior).chain(&part.holes))
                    .map(area)
                    .sum();
                prop_assert!((total - 4.0 * f64::from(size)).abs() < 1e-6);
            }
        }
    }
}
