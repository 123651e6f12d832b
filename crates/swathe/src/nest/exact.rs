//! Exact nests in one linear pass: threshold, opening by the vicinity, components.

use crate::grid::{Cell, Layer};
use crate::rank::RankMap;

use super::{BitRows, Contact, NestError, NestParams, Nests, UnionFind};

/// The cells whose rank is high enough, optionally only those inside a mask.
pub fn suitable_cells(rank: &RankMap, rank_min: u8, inside: Option<&Layer<bool>>) -> BitRows {
    let geometry = rank.cells().geometry();
    let columns = geometry.columns();
    let cells = rank.cells().data();
    match inside.map(Layer::data) {
        None => BitRows::from_fn(geometry, |row, column| cells[row * columns + column].rank() >= rank_min),
        Some(inside) => BitRows::from_fn(geometry, |row, column| {
            let index = row * columns + column;
            inside[index] && cells[index].rank() >= rank_min
        }),
    }
}

/// Nests of a rank map, optionally only inside a mask: what the swarm ends with.
///
/// # Errors
/// [`NestError`] when a parameter is outside its range or the mask does not fit.
pub fn exact_nests(rank: &RankMap, inside: Option<&Layer<bool>>, params: &NestParams) -> Result<Nests, NestError> {
    let steps = params.validate()?;
    let geometry = rank.cells().geometry();
    if let Some(inside) = inside {
        // The mask must be of the same cells.
        Layer::new(geometry, vec![(); inside.data().len()], "the swathe")?;
    }
    let suitable = suitable_cells(rank, params.rank_min, inside);
    let mut cores;
    let mut opened;
    if params.border_suitable {
        // Cells beyond the mask count as suitable for their neighbours, but are no ground themselves.
        let beyond = |row, column| inside.is_some_and(|inside| !inside[Cell::new(row, column)]);
        let kind = BitRows::from_fn(geometry, |row, column| {
            beyond(row, column) || suitable.get(Cell::new(row, column))
        });
        cores = kind.eroded(&steps, true);
        cores = BitRows::from_fn(geometry, |row, column| {
            cores.get(Cell::new(row, column)) && suitable.get(Cell::new(row, column))
        });
        opened = cores.dilated(&steps);
        opened = BitRows::from_fn(geometry, |row, column| {
            opened.get(Cell::new(row, column)) && suitable.get(Cell::new(row, column))
        });
    } else {
        cores = suitable.eroded(&steps, false);
        opened = cores.dilated(&steps);
    }
    if params.contact != Contact::Overlap {
        return nests_of_cells(geometry, &opened, params.contact);
    }
    let mut sets = UnionFind::new(geometry.cell_count());
    for cell in geometry.cells().filter(|&cell| cores.get(cell)) {
        for near in steps.iter().filter_map(|step| step.from(&geometry, cell)) {
            if opened.get(near) {
                sets.union(geometry.index(cell) as u32, geometry.index(near) as u32);
            }
        }
    }
    let labels = geometry.cells().map(|cell| {
        if opened.get(cell) {
            sets.find(geometry.index(cell) as u32) + 1
        } else {
            0
        }
    });
    let labels = labels.collect();
    Nests::from_labels(geometry, labels)
}

/// Components of a mask, cells joined by edges or also by corners, labelled run by run.
///
/// # Errors
/// [`NestError::Grid`] when the mask does not fit the geometry.
pub fn nests_of_cells(
    geometry: crate::grid::GridGeometry,
    cells: &BitRows,
    contact: Contact,
) -> Result<Nests, NestError> {
    struct Run {
        from: u32,
        to: u32,
    }
    let reach = u32::from(contact == Contact::Corner);
    let mut sets = UnionFind::new(0);
    let mut runs: Vec<Run> = Vec::new();
    let mut row_starts = vec![0];
    for row in 0..cells.rows() {
        let above = row.checked_sub(1).map_or(0..0, |_| row_starts[row - 1]..runs.len());
        let mut candidate = above.start;
        let mut found = Vec::new();
        cells.runs(row, |from, to| {
            found.push(Run {
                from: from as u32,
                to: to as u32,
            });
        });
        for run in found {
            let number = sets.push();
            while candidate < above.end && runs[candidate].to + reach <= run.from {
                candidate += 1;
            }
            let mut touching = candidate;
            while touching < above.end && runs[touching].from < run.to + reach {
                sets.union(number, touching as u32);
                touching += 1;
            }
            runs.push(run);
        }
        row_starts.push(runs.len());
    }
    let mut numbers = vec![0; runs.len()];
    let mut sizes = Vec::new();
    let mut labels = Layer::filled(geometry, 0);
    let columns = geometry.columns();
    for row in 0..cells.rows() {
        for index in row_starts[row]..row_starts[row + 1] {
            // The root is the first run of its component, so numbers follow raster order.
            let root = sets.find(index as u32) as usize;
            if root == index {
                sizes.push(0);
                numbers[index] = sizes.len() as u32;
            }
            let label = numbers[root];
            let Run { from, to } = runs[index];
            sizes[label as usize - 1] += to - from;
            labels.data_mut()[row * columns + from as usize..row * columns + to as usize].fill(label);
        }
    }
    Ok(Nests::new(labels, sizes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::GridGeometry;
    use crate::nest::Vicinity;
    use proptest::prelude::*;

    /// A world as text: '#' suitable, '.' not.
    fn world(rows: &[&str]) -> RankMap {
        let geometry = GridGeometry::new(rows.len(), rows[0].len(), 1.0, 0.0, 0.0).unwrap();
        let ranks: Vec<u8> = rows
            .iter()
            .flat_map(|row| row.bytes().map(|byte| if byte == b'#' { 9 } else { 1 }))
            .collect();
        RankMap::from_ranks(geometry, &ranks).unwrap()
    }

    fn drawn(nests: &Nests) -> Vec<String> {
        let data = nests.labels().data();
        data.chunks(nests.geometry().columns())
            .map(|row| {
                row.iter()
                    .map(|&label| if label == 0 { '.' } else { (b'0' + label as u8) as char })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn narrow_ground_is_opened_away_and_contact_decides_what_is_one() {
        let map = world(&[
            "###....###",
            "###....###",
            "#########.",
            "..........",
            "...###....",
            "...###....",
            "...###....",
            "......###.",
            "......###.",
            "......###.",
        ]);
        let nests = |contact| {
            let params = NestParams {
                contact,
                ..NestParams::default()
            };
            drawn(&exact_nests(&map, None, &params).unwrap())
        };
        assert_eq!(
            nests(Contact::Edge),
            [
                "111.......",
                "111.......",
                "111.......",
                "..........",
                "...222....",
                "...222....",
                "...222....",
                "......333.",
                "......333.",
                "......333.",
            ]
        );
        let joined = nests(Contact::Corner);
        assert_eq!(joined[7], "......222.");
        assert_eq!(nests(Contact::Overlap), nests(Contact::Edge));
    }

    #[test]
    fn nests_that_share_an_edge_but_no_cell_are_apart_under_overlap() {
        let map = world(&["######", "######", "######"]);
        let with = |contact, vicinity| NestParams {
            vicinity,
            contact,
            ..NestParams::default()
        };
        let one = exact_nests(&map, None, &with(Contact::Overlap, Vicinity::Moore1)).unwrap();
        assert_eq!(one.count(), 1);
        let cells = exact_nests(&map, None, &with(Contact::Overlap, Vicinity::Cell)).unwrap();
        assert_eq!(cells.count(), 18);
        let edges = exact_nests(&map, None, &with(Contact::Edge, Vicinity::Cell)).unwrap();
        assert_eq!((edges.count(), edges.sizes()), (1, &[18][..]));
    }

    #[test]
    fn a_map_smaller_than_the_vicinity_has_no_nest_and_a_kind_border_gives_one() {
        let map = world(&["#"]);
        assert_eq!(exact_nests(&map, None, &NestParams::default()).unwrap().count(), 0);
        let kind = NestParams {
            border_suitable: true,
            ..NestParams::default()
        };
        assert_eq!(exact_nests(&map, None, &kind).unwrap().count(), 1);
    }

    proptest! {
        #[test]
        fn labels_are_the_components_of_the_opening(
            rows in 1usize..12, columns in 1usize..80, seed: u64, corner: bool,
        ) {
            let geometry = GridGeometry::new(rows, columns, 1.0, 0.0, 0.0).unwrap();
            let ranks: Vec<u8> = (0..rows * columns)
                .map(|i| if crate::random::philox([i as u32, 0, 0, 0], seed)[0].is_multiple_of(16) { 3 } else { 8 })
                .collect();
            let map = RankMap::from_ranks(geometry, &ranks).unwrap();
            let contact = if corner { Contact::Corner } else { Contact::Edge };
            let params = NestParams { contact, ..NestParams::default() };
            let nests = exact_nests(&map, None, &params).unwrap();
            let mut sets = UnionFind::new(rows * columns);
            let steps: &[crate::grid::Step] = if corner { &crate::grid::EIGHT } else { &crate::grid::FOUR };
            for cell in geometry.cells() {
                // In a nest exactly when some 3 x 3 block of suitable cells holds it.
                let ring = crate::grid::disc(1.5);
                let block = |core: Cell| ring.iter().all(|step| {
                    step.from(&geometry, core).is_some_and(|c| ranks[geometry.index(c)] >= 6)
                });
                let opened = ring.iter().filter_map(|step| step.from(&geometry, cell)).any(block);
                prop_assert_eq!(nests.label(cell) > 0, opened);
                for near in steps.iter().filter_map(|step| step.from(&geometry, cell)) {
                    if nests.label(cell) > 0 && nests.label(near) > 0 {
                        prop_assert_eq!(nests.label(cell), nests.label(near));
                        sets.union(geometry.index(cell) as u32, geometry.index(near) as u32);
                    }
                }
            }
            let mut first_seen = Vec::new();
            for cell in geometry.cells().filter(|&cell| nests.label(cell) > 0) {
                let root = sets.find(geometry.index(cell) as u32);
                if !first_seen.contains(&root) {
                    first_seen.push(root);
                }
                let number = first_seen.iter().position(|&r| r == root).unwrap() as u32 + 1;
                prop_assert_eq!(nests.label(cell), number);
            }
            prop_assert_eq!(nests.count(), first_seen.len());
        }
    }
}
