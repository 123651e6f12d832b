//! The graph of nests: which nests lie next to each other, and how wide the gap between them is.

use std::collections::{BTreeMap, VecDeque};

use crate::grid::{Cell, EIGHT};

use super::Nests;

/// The narrowest gap found between two neighbouring nests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// The nest with the lower label.
    pub from_nest: u32,
    /// The nest with the higher label.
    pub to_nest: u32,
    /// The cell of the first nest at the gap.
    pub from: Cell,
    /// The cell of the second nest at the gap.
    pub to: Cell,
    /// Distance between the centres of both cells, in metres.
    pub distance_m: f64,
}

/// Gaps between nests whose zones of nearest cells meet, ordered by nests.
///
/// Fronts grow from all nests at once and carry the nest cell that they started from; where two meet, the distance of
/// their origins is a gap. The distance is that of the nearest origin by 8-neighbour growth, which can exceed the
/// Euclidean nearest pair by a few per cent.
pub fn nest_graph(nests: &Nests) -> Vec<Gap> {
    const NOWHERE: u32 = u32::MAX;
    let geometry = nests.geometry();
    let mut origin = vec![NOWHERE; geometry.cell_count()];
    let mut front = VecDeque::new();
    for cell in geometry.cells().filter(|&cell| nests.label(cell) > 0) {
        let index = geometry.index(cell);
        origin[index] = index as u32;
        let edge = EIGHT.iter().any(|step| {
            step.from(&geometry, cell)
                .is_some_and(|near| nests.label(near) != nests.label(cell))
        });
        if edge {
            front.push_back(index);
        }
    }
    let mut gaps: BTreeMap<(u32, u32), Gap> = BTreeMap::new();
    while let Some(index) = front.pop_front() {
        let here = geometry.cell(origin[index] as usize);
        for near in EIGHT
            .iter()
            .filter_map(|step| step.from(&geometry, geometry.cell(index)))
        {
            let next = geometry.index(near);
            if origin[next] == NOWHERE {
                origin[next] = origin[index];
                front.push_back(next);
                continue;
            }
            let there = geometry.cell(origin[next] as usize);
            let ((a, from), (b, to)) = {
                let (one, other) = ((nests.label(here), here), (nests.label(there), there));
                if one.0 <= other.0 { (one, other) } else { (other, one) }
            };
            if a == b {
                continue;
            }
            let distance_m = geometry.centre(from).distance_m(geometry.centre(to));
            let gap = Gap {
                from_nest: a,
                to_nest: b,
                from,
                to,
                distance_m,
            };
            gaps.entry((a, b))
                .and_modify(|known| {
                    if (distance_m, from, to).partial_cmp(&(known.distance_m, known.from, known.to))
                        == Some(std::cmp::Ordering::Less)
                    {
                        *known = gap;
                    }
                })
                .or_insert(gap);
        }
    }
    gaps.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::GridGeometry;
    use crate::nest::{NestParams, exact_nests};
    use crate::rank::RankMap;

    #[test]
    fn neighbours_are_joined_by_their_narrowest_gap() {
        let rows = [
            "###...###......",
            "###...###......",
            "###...###......",
            "...............",
            "............###",
            "............###",
            "............###",
        ];
        let geometry = GridGeometry::new(7, 15, 10.0, 0.0, 0.0).unwrap();
        let ranks: Vec<u8> = rows
            .iter()
            .flat_map(|row| row.bytes().map(|byte| if byte == b'#' { 9 } else { 1 }))
            .collect();
        let map = RankMap::from_ranks(geometry, &ranks).unwrap();
        let nests = exact_nests(&map, None, &NestParams::default()).unwrap();
        let graph = nest_graph(&nests);
        let pairs: Vec<_> = graph.iter().map(|gap| (gap.from_nest, gap.to_nest)).collect();
        // The second nest lies between the others, so they are no neighbours.
        assert_eq!(pairs, [(1, 2), (2, 3)]);
        assert_eq!(graph[0].distance_m, 40.0);
        assert_eq!((graph[1].from, graph[1].to), (Cell::new(2, 8), Cell::new(4, 12)));
    }
}
