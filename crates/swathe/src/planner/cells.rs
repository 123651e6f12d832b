//! Cheapest ways over plain costs per metre: the planner without a vehicle.

use crate::grid::{Cell, EIGHT, GridError, GridGeometry, LayerView, SIXTEEN, Step};
use crate::progress::Report;

use super::PlannerError;
use super::kernel::{CellCost, Ground, Range, Request, field, find};
use super::search::{Search, StepGraph, search};

/// What a diagonal step may pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Corners {
    /// Cells that a step passes at a corner must be passable.
    Keep,
    /// Corners may be cut, for comparison with planners that do.
    Cut,
}

/// Which search runs; the way is a cheapest one each time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Algorithm {
    /// Dijkstra with buckets inside limits from a coarse grid: cells from which the goal cannot be reached in time are left
    /// out. The quickest on almost every map.
    Auto,
    /// Dijkstra with buckets over the whole map, until the goal is reached.
    Dijkstra,
    /// Textbook A* in floats, with the least cost per metre times the straight distance as bound.
    AStar,
}

/// Costs per metre as a graph of 8 or 16 neighbours.
#[derive(Clone, Debug)]
pub struct CostCells<'a, C = f64> {
    costs: LayerView<'a, C>,
    steps: &'static [Step],
    corners: Corners,
    range: Range,
    /// Bound on the cost of a metre towards the goal.
    least: f64,
    goal: Cell,
}

impl<'a, C: CellCost> CostCells<'a, C> {
    /// A graph over costs per metre; NaN and infinite cells are closed.
    ///
    /// # Errors
    /// [`PlannerError::NegativeCost`] naming the first negative cell, [`PlannerError::Neighbours`] for a number other than
    /// 8 or 16, [`PlannerError::Grid`] when the goal lies outside.
    pub fn new(
        costs: LayerView<'a, C>,
        goal: Cell,
        neighbours: u32,
        corners: Corners,
        algorithm: Algorithm,
    ) -> Result<Self, PlannerError> {
        let geometry = costs.geometry();
        let steps: &[Step] = match neighbours {
            8 => &EIGHT,
            16 => &SIXTEEN,
            given => return Err(PlannerError::Neighbours { given }),
        };
        inside(&geometry, goal)?;
        let range = Range::of(costs.data()).map_err(|index| {
            let Cell { row, column } = geometry.cell(index);
            let cost = costs.data()[index].per_metre();
            PlannerError::NegativeCost { row, column, cost }
        })?;
        let bounded = algorithm != Algorithm::Dijkstra && range.least.is_finite() && !range.free;
        Ok(Self {
            costs,
            steps,
            corners,
            range,
            least: if bounded { range.least } else { 0.0 },
            goal,
        })
    }

    fn ground(&self) -> Ground<'a, C> {
        let geometry = self.costs.geometry();
        Ground {
            costs: self.costs.data(),
            rows: geometry.rows(),
            columns: geometry.columns(),
            metres: geometry.cell_size_m(),
            keep: self.corners == Corners::Keep && self.range.closed,
        }
    }
}

fn inside(geometry: &GridGeometry, cell: Cell) -> Result<(), GridError> {
    if cell.row < geometry.rows() && cell.column < geometry.columns() {
        return Ok(());
    }
    Err(GridError::OutsideGrid {
        row: cell.row as i64,
        column: cell.column as i64,
        rows: geometry.rows(),
        columns: geometry.columns(),
    })
}

impl<C: CellCost> StepGraph for CostCells<'_, C> {
    fn geometry(&self) -> GridGeometry {
        self.costs.geometry()
    }

    fn steps(&self) -> &[Step] {
        self.steps
    }

    fn edge_cost(&self, from: Cell, step: usize) -> f64 {
        let geometry = self.geometry();
        let Step { rows, columns } = self.steps[step];
        let Some(to) = geometry.offset(from, rows, columns) else {
            return f64::INFINITY;
        };
        let at = |cell: Cell| {
            let cost = self.costs[cell].per_metre();
            if cost.is_finite() { cost } else { f64::INFINITY }
        };
        let length_m = geometry.cell_size_m() * self.steps[step].length_cells();
        // The cells between both ends: beside a diagonal, under a knight's move.
        let between = match (rows.abs(), columns.abs()) {
            (1, 1) => Some([(rows, 0), (0, columns)]),
            (1, 2) => Some([(0, columns / 2), (rows, columns / 2)]),
            (2, 1) => Some([(rows / 2, 0), (rows / 2, columns)]),
            _ => None,
        };
        let ends = at(from) + at(to);
        let Some(between) = between else {
            return length_m / 2.0 * ends;
        };
        let [first, second] = between.map(|(rows, columns)| {
            at(Cell::new(
                (from.row as i64 + i64::from(rows)) as usize,
                (from.column as i64 + i64::from(columns)) as usize,
            ))
        });
        let diagonal = rows.abs() == columns.abs();
        if diagonal {
            if self.corners == Corners::Keep && !(first + second).is_finite() {
                return f64::INFINITY;
            }
            length_m / 2.0 * ends
        } else {
            length_m / 4.0 * (ends + (first + second))
        }
    }

    fn bound(&self, cell: Cell) -> f64 {
        if self.least == 0.0 {
            return 0.0;
        }
        let geometry = self.geometry();
        // A hair less than the bound, so that rounding cannot make it inconsistent.
        self.least * (1.0 - 1e-12) * geometry.centre(cell).distance_m(geometry.centre(self.goal))
    }
}

/// A cheapest way over costs per metre; see [`CostCells::new`].
///
/// Its cost is worked out in floats, and is above the least by no more than 1e-8 of it. `memory_limit_bytes` bounds what
/// the search holds beside `costs`; `report` counts expanded cells.
///
/// # Errors
/// Those of [`CostCells::new`], [`PlannerError::Grid`] when the start lies outside, and [`PlannerError::Memory`].
#[allow(clippy::too_many_arguments, reason = "the options of one search")]
pub fn shortest_path<C: CellCost>(
    costs: LayerView<C>,
    start: Cell,
    goal: Cell,
    neighbours: u32,
    corners: Corners,
    algorithm: Algorithm,
    memory_limit_bytes: Option<u64>,
    report: &mut Report,
) -> Result<Search, PlannerError> {
    let graph = CostCells::new(costs, goal, neighbours, corners, algorithm)?;
    inside(&graph.geometry(), start)?;
    let request = Request {
        start,
        goal,
        sixteen: neighbours == 16,
        guided: algorithm == Algorithm::Auto,
        memory_limit_bytes,
    };
    let ground = graph.ground();
    // The kernel leaves out some long steps that cut corners.
    if algorithm == Algorithm::AStar || (neighbours == 16 && corners == Corners::Cut) {
        // A float and a bit.
        request.require(ground.rows, ground.columns, 9)?;
        return Ok(search(&graph, start, goal, report));
    }
    find(&ground, graph.range, request, report)
}

/// Costs from `start` to every cell in floats, exact but for rounding: infinite where no way leads, everywhere when the
/// start is closed; `None` when the caller asked to stop.
///
/// # Errors
/// As [`shortest_path`].
pub fn cell_cost_field<C: CellCost>(
    costs: LayerView<C>,
    start: Cell,
    neighbours: u32,
    corners: Corners,
    memory_limit_bytes: Option<u64>,
    report: &mut Report,
) -> Result<Option<Vec<f64>>, PlannerError> {
    let graph = CostCells::new(costs, start, neighbours, corners, Algorithm::Dijkstra)?;
    let request = Request {
        start,
        goal: start,
        sixteen: neighbours == 16,
        guided: false,
        memory_limit_bytes,
    };
    field(&graph.ground(), graph.range, request, report)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Layer;
    use crate::planner::search::cost_field;
    use crate::progress::silent;
    use proptest::prelude::*;
    use rstest::rstest;

    /// A world as text: '#' closed, a digit its cost per metre, 's' and 'g' cost 1.
    fn world(rows: &[&str]) -> (Layer<f64>, Cell, Cell) {
        let geometry = GridGeometry::new(rows.len(), rows[0].len(), 1.0, 0.0, 0.0).unwrap();
        let bytes: Vec<u8> = rows.iter().flat_map(|row| row.bytes()).collect();
        let find = |wanted| geometry.cell(bytes.iter().position(|&b| b == wanted).unwrap());
        let costs = bytes.iter().map(|&byte| match byte {
            b'#' => f64::INFINITY,
            b'0'..=b'9' => f64::from(byte - b'0'),
            _ => 1.0,
        });
        let costs = Layer::new(geometry, costs.collect(), "costs").unwrap();
        (costs, find(b's'), find(b'g'))
    }

    const DIAGONAL_GAP: [&str; 3] = ["1#g", "11#", "s11"];
    const WALL: [&str; 4] = ["s1#11", "11#11", "11#11", "1111g"];
    const HILL: [&str; 3] = ["19991", "s191g", "11111"];

    #[rstest]
    #[case(&WALL, 8, Corners::Keep, Some(2.0f64.sqrt() * 1.0 + 5.0))]
    #[case(&DIAGONAL_GAP, 8, Corners::Keep, None)]
    #[case(&DIAGONAL_GAP, 8, Corners::Cut, Some(2.0 * 2.0f64.sqrt()))]
    #[case(&HILL, 8, Corners::Keep, Some(2.0 + 2.0 * 2.0f64.sqrt()))]
    #[case(&HILL, 16, Corners::Keep, Some(2.0 * 5.0f64.sqrt()))]
    fn drawn_worlds(
        #[case] rows: &[&str],
        #[case] neighbours: u32,
        #[case] corners: Corners,
        #[case] expected: Option<f64>,
    ) {
        for algorithm in [Algorithm::Dijkstra, Algorithm::AStar, Algorithm::Auto] {
            let (costs, start, goal) = world(rows);
            let found = shortest_path(
                costs.view(),
                start,
                goal,
                neighbours,
                corners,
                algorithm,
                None,
                &mut silent(),
            )
            .unwrap();
            match (found, expected) {
                (Search::Found { cost, cells }, Some(expected)) => {
                    approx::assert_relative_eq!(cost, expected, epsilon = 1e-12);
                    assert_eq!((cells[0], cells[cells.len() - 1]), (start, goal));
                }
                (Search::Unreachable, None) => {}
                (found, expected) => panic!("{found:?} instead of {expected:?}"),
            }
        }
    }

    fn costs() -> impl Strategy<Value = Layer<f64>> {
        let cell = prop_oneof![
            6 => 0.5f64..9.0, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY), 1 => Just(0.0)
        ];
        (1usize..9, 1usize..9).prop_flat_map(move |(rows, columns)| {
            prop::collection::vec(cell.clone(), rows * columns).prop_map(move |data| {
                let geometry = GridGeometry::new(rows, columns, 2.0, 0.0, 0.0).unwrap();
                Layer::new(geometry, data, "costs").unwrap()
            })
        })
    }

    proptest! {
        #[test]
        fn a_star_dijkstra_and_an_outside_search_agree(
            layer in costs(), a: prop::sample::Index, b: prop::sample::Index, sixteen: bool, cut: bool,
        ) {
            let geometry = layer.geometry();
            let (start, goal) = (
                geometry.cell(a.index(geometry.cell_count())), geometry.cell(b.index(geometry.cell_count())),
            );
            let neighbours = if sixteen { 16 } else { 8 };
            let corners = if cut { Corners::Cut } else { Corners::Keep };
            let graph = CostCells::new(layer.view(), goal, neighbours, corners, Algorithm::Auto).unwrap();
            // Fixed point, since the outside search wants ordered costs.
            let scale = |cost: f64| (cost * 1e9).round() as u64;
            let outside = pathfinding::prelude::dijkstra(
                &start,
                |&cell| {
                    let graph = &graph;
                    (0..graph.steps().len()).filter_map(move |k| {
                        let cost = graph.edge_cost(cell, k);
                        let to = graph.steps()[k].from(&graph.geometry(), cell)?;
                        cost.is_finite().then(|| (to, scale(cost)))
                    }).collect::<Vec<_>>()
                },
                |&cell| cell == goal,
            );
            let field = cost_field(
                &CostCells::new(layer.view(), goal, neighbours, corners, Algorithm::Dijkstra).unwrap(),
                start, &mut silent(),
            ).unwrap();
            for algorithm in [Algorithm::Dijkstra, Algorithm::AStar] {
                let found =
                    shortest_path(layer.view(), start, goal, neighbours, corners, algorithm, None, &mut silent()).unwrap();
                match (&found, &outside) {
                    (Search::Found { cells, cost }, Some((_, best))) => {
                        prop_assert!((cost - *best as f64 / 1e9).abs() < 1e-6);
                        prop_assert!((cost - field[geometry.index(goal)]).abs() < 1e-9);
                        let walked: f64 = cells.windows(2).map(|pair| {
                            let k = graph.steps().iter().position(|s| s.from(&geometry, pair[0]) == Some(pair[1]));
                            graph.edge_cost(pair[0], k.unwrap())
                        }).sum();
                        prop_assert!((cost - walked).abs() < 1e-9);
                        prop_assert_eq!((cells[0], cells[cells.len() - 1]), (start, goal));
                    }
                    (Search::Unreachable, None) => {}
                    other => prop_assert!(false, "{:?}", other),
                }
            }
        }

        #[test]
        fn an_obstacle_never_lowers_the_cost(layer in costs(), at: prop::sample::Index) {
            let geometry = layer.geometry();
            let (start, goal) = (geometry.cell(0), geometry.cell(geometry.cell_count() - 1));
            let mut closed = layer.clone();
            closed.data_mut()[at.index(geometry.cell_count())] = f64::INFINITY;
            let cost = |layer: &Layer<f64>| {
                match shortest_path(
                    layer.view(), start, goal, 16, Corners::Keep, Algorithm::Auto, None, &mut silent(),
                ).unwrap() {
                    Search::Found { cost, .. } => cost,
                    _ => f64::INFINITY,
                }
            };
            prop_assert!(cost(&closed) >= cost(&layer) - 1e-9);
        }
    }

    #[test]
    fn bad_requests_are_named_and_a_report_stops() {
        let (mut costs, start, goal) = world(&WALL);
        let ask = |costs: &Layer<f64>, goal, neighbours| {
            shortest_path(
                costs.view(),
                start,
                goal,
                neighbours,
                Corners::Keep,
                Algorithm::Auto,
                None,
                &mut |_, _| false,
            )
        };
        assert_eq!(ask(&costs, goal, 8), Ok(Search::Stopped));
        assert_eq!(ask(&costs, goal, 4), Err(PlannerError::Neighbours { given: 4 }));
        assert!(matches!(
            ask(&costs, Cell::new(9, 0), 8),
            Err(PlannerError::Grid(GridError::OutsideGrid { .. }))
        ));
        costs.data_mut()[3] = -1.0;
        assert!(matches!(
            ask(&costs, goal, 8),
            Err(PlannerError::NegativeCost { row: 0, column: 3, .. })
        ));
    }
}
