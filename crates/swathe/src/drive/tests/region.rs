//! What a map says of the ground, as the route is laid on it.

use std::collections::BTreeSet;

use super::world::pioneer;
use crate::drive::DriveParams;
use crate::drive::region::{Region, RegionState, Source};
use crate::drive::route::Ground as _;
use crate::grid::{Cell, GridGeometry, Layer, Position};
use crate::nest::{Footprint, GridsParams, OverlappingGrids, RankCodes};

#[test]
fn ground_that_one_grid_alone_holds_costs_a_fifth_more_and_outside_them_three_times() {
    let (vehicle, params) = (pioneer(), DriveParams::default());
    let at = Position::new(5.0, 5.0);
    let geometry = GridGeometry::new(100, 100, 0.1, 0.0, 10.0).unwrap();
    let point = Footprint::circle(0.0).unwrap();
    let mut seen = BTreeSet::new();
    // A lane that is suitable in ground that is not, over the cells of one grid or of both as it moves.
    for lane in 0..12 {
        let rank = |cell: Cell| {
            if (25 + lane..65 + lane).contains(&cell.row) {
                8
            } else {
                2
            }
        };
        let ranks = Layer::new(geometry, geometry.cells().map(rank).collect(), "ranks").unwrap();
        let grids = OverlappingGrids::new(GridsParams::for_vehicle(&vehicle), at, &RankCodes(ranks.view())).unwrap();
        let source = Source::Ranked(Region {
            ranks,
            elevation_m: None,
            route: Vec::new(),
            grids: None,
        });
        let factors = RegionState::new(source, &vehicle, &params, at)
            .unwrap()
            .factors(&geometry);
        // Ground is asked about in blocks of a few cells: the first of each row of blocks tells, whatever their size.
        for row in (2..98).step_by(4) {
            let place = geometry.centre(Cell::new(row, 50));
            let answer = grids.navigable(place, 0.0, &point);
            let tenths = match (answer.navigable(), answer.disagreement()) {
                (true, false) => 10,
                (true, true) => 12,
                (false, _) => 30,
            };
            assert_eq!(
                (10.0 * factors[row * 100 + 50]).round() as i32,
                tenths,
                "row {row} of lane {lane}"
            );
            seen.insert(tenths);
        }
    }
    assert_eq!(seen.into_iter().collect::<Vec<_>>(), [10, 12, 30]);
}
