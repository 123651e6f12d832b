//! Exact nests in one linear pass: threshold, opening by the vicinity, components.

use rayon::prelude::*;

use crate::grid::{GridError, GridGeometry, Layer, Step};
use crate::rank::{RankMap, RankView};

use super::bit_rows::pack_at_least;
use super::opening::{BAND_ROWS, opened};
use super::{BitRows, Contact, NestError, NestParams, Nests, UnionFind, Vicinity};

/// The cells whose rank is high enough, optionally only those inside a mask.
pub fn suitable_cells(rank: &RankMap, rank_min: u8, inside: Option<&Layer<bool>>) -> BitRows {
    let geometry = rank.cells().geometry();
    let mut suitable = BitRows::at_least(geometry, rank.cells().data(), rank_min, |cell| cell.rank());
    if let Some(inside) = inside {
        suitable.keep(&BitRows::at_least(geometry, inside.data(), 1, |&inside| {
            u8::from(inside)
        }));
    }
    suitable
}

/// Nests of a rank map, optionally only inside a mask: what the swarm ends with.
///
/// # Errors
/// [`NestError`] when a parameter is outside its range or the mask does not fit.
pub fn exact_nests(rank: &RankMap, inside: Option<&Layer<bool>>, params: &NestParams) -> Result<Nests, NestError> {
    let geometry = rank.cells().geometry();
    if let Some(inside) = inside {
        // The mask must be of the same cells.
        Layer::new(geometry, vec![(); inside.data().len()], "the swathe")?;
    }
    let steps = params.validate()?;
    let suitable = suitable_cells(rank, params.rank_min, inside);
    let inside = inside.map(|inside| BitRows::at_least(geometry, inside.data(), 1, |&inside| u8::from(inside)));
    let mut labels = Layer::filled(geometry, 0);
    let sizes = label_suitable(&suitable, inside.as_ref(), &steps, params, labels.data_mut());
    Ok(Nests::new(labels, sizes))
}

/// Labels the nests of plain ranks in an array of the caller's, which holds zeros, and returns the cells of each nest.
///
/// Cells outside nests are not written. The memory needed beside is an eighth of a byte for each cell and eight bytes for
/// each stretch of nest cells in a row.
///
/// # Errors
/// [`NestError`] when a parameter is outside its range or there is not one label per cell.
pub fn label_nests(ranks: RankView, params: &NestParams, labels: &mut [u32]) -> Result<Vec<u32>, NestError> {
    let steps = params.validate()?;
    let geometry = ranks.geometry();
    let (expected, found) = (geometry.cell_count(), labels.len());
    if found != expected {
        let what = "the labels";
        return Err(GridError::ShapeMismatch { what, expected, found }.into());
    }
    let (columns, least) = (geometry.columns(), params.rank_min);
    let cells = ranks.ranks();
    if params.vicinity == Vicinity::Moore1 && !params.border_suitable && params.contact != Contact::Overlap {
        let nests = opened(geometry, BAND_ROWS, |row, words| {
            let row = &cells[row * columns..(row + 1) * columns];
            pack_at_least(row, least, |&rank| rank, words);
        });
        return Ok(label_runs(&nests, params.contact, labels));
    }
    let suitable = BitRows::at_least(geometry, cells, least, |&rank| rank);
    Ok(label_suitable(&suitable, None, &steps, params, labels))
}

/// Labels the nests of suitable cells, all of them inside the mask.
fn label_suitable(
    suitable: &BitRows,
    inside: Option<&BitRows>,
    steps: &[Step],
    params: &NestParams,
    labels: &mut [u32],
) -> Vec<u32> {
    let (cores, nests);
    if params.border_suitable {
        // Cells beyond the mask count as suitable for their neighbours, but are no ground themselves.
        let mut kind = suitable.clone();
        if let Some(inside) = inside {
            kind.add_missing(inside);
        }
        let mut kept = kind.eroded(steps, true);
        kept.keep(suitable);
        cores = kept;
        let mut grown = cores.dilated(steps);
        grown.keep(suitable);
        nests = grown;
    } else {
        cores = suitable.eroded(steps, false);
        nests = cores.dilated(steps);
    }
    if params.contact == Contact::Overlap {
        label_overlapping(&cores, &nests, steps, labels)
    } else {
        label_runs(&nests, params.contact, labels)
    }
}

/// Nests that share no cell are apart even side by side, so cells are joined one by one.
fn label_overlapping(cores: &BitRows, nests: &BitRows, steps: &[Step], labels: &mut [u32]) -> Vec<u32> {
    let geometry = nests.geometry();
    let mut sets = UnionFind::new(geometry.cell_count());
    for cell in geometry.cells().filter(|&cell| cores.get(cell)) {
        for near in steps.iter().filter_map(|step| step.from(&geometry, cell)) {
            if nests.get(near) {
                sets.union(geometry.index(cell) as u32, geometry.index(near) as u32);
            }
        }
    }
    sets.label(|index| nests.get(geometry.cell(index)), labels)
}

/// Components of a mask, cells joined by edges or also by corners, labelled run by run.
///
/// # Errors
/// [`NestError::Grid`] when the mask does not fit the geometry.
pub fn nests_of_cells(geometry: GridGeometry, cells: &BitRows, contact: Contact) -> Result<Nests, NestError> {
    let mut labels = Layer::filled(geometry, 0);
    let (expected, found) = (geometry.cell_count(), cells.rows() * cells.columns());
    if found != expected {
        let what = "the mask";
        return Err(GridError::ShapeMismatch { what, expected, found }.into());
    }
    let sizes = label_runs(cells, contact, labels.data_mut());
    Ok(Nests::new(labels, sizes))
}

/// Writes the labels of a mask's components over zeros, and returns their sizes.
fn label_runs(mask: &BitRows, contact: Contact, labels: &mut [u32]) -> Vec<u32> {
    let reach = usize::from(contact == Contact::Corner);
    let mut sets = UnionFind::new(0);
    let mut run_cells: Vec<u32> = Vec::new();
    let mut row_starts = Vec::with_capacity(mask.rows() + 1);
    row_starts.push(0);
    let (mut above, mut here) = (Vec::new(), Vec::new());
    for row in 0..mask.rows() {
        std::mem::swap(&mut above, &mut here);
        here.clear();
        let mut candidate = 0;
        let first_above: usize = row.checked_sub(1).map_or(0, |north| row_starts[north]);
        mask.runs(row, |from, to| {
            let number = sets.push();
            run_cells.push((to - from) as u32);
            here.push((from, to));
            while above
                .get(candidate)
                .is_some_and(|run: &(usize, usize)| run.1 + reach <= from)
            {
                candidate += 1;
            }
            let mut touching = candidate;
            while above.get(touching).is_some_and(|run| run.0 < to + reach) {
                sets.union(number, (first_above + touching) as u32);
                touching += 1;
            }
        });
        row_starts.push(sets.len());
    }
    let (numbers, sizes) = sets.into_numbers(&run_cells);
    let columns = mask.columns();
    let fill = |(row, labels): (usize, &mut [u32])| {
        let mut numbers = numbers[row_starts[row]..row_starts[row + 1]].iter();
        mask.runs(row, |from, to| {
            if let Some(&number) = numbers.next() {
                labels[from..to].fill(number);
            }
        });
    };
    labels
        .par_chunks_mut(columns)
        .with_min_len(FILL_ROWS)
        .enumerate()
        .for_each(fill);
    sizes
}

/// Rows that one thread labels at a time.
const FILL_ROWS: usize = 256;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Cell;
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
            let mut labels = vec![0; rows * columns];
            let sizes = label_nests(RankView::new(geometry, &ranks).unwrap(), &params, &mut labels).unwrap();
            prop_assert_eq!((&labels[..], &sizes[..]), (nests.labels().data(), nests.sizes()));
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
