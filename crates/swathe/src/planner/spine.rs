//! The arc that follows the ground: a search on coarse cells.

use crate::grid::{Cell, GridError, GridGeometry, Layer, LayerView, Position};
use crate::progress::silent;
use crate::rank::{Profile, RankParams, Ranker};
use crate::vehicle::Vehicle;

use super::PlannerError;
use super::answer::Terrain;
use super::cells::{Algorithm, Corners, shortest_path};
use super::search::Search;

/// Cells of the map that make one cell of the coarse map, per side.
const COARSE: usize = 8;

/// Cost per metre of coarse cells that are no-go on the average: dear but open, since a finer way may exist there.
const NO_GO_COST: f64 = 6.0;

/// Cost per metre that each rank below the best adds.
const COST_PER_RANK: f64 = 0.3;

/// The coarse cells that are looked at to find a way, all of the coarse map.
pub(super) fn coarse_count(geometry: GridGeometry) -> u64 {
    (geometry.rows().div_ceil(COARSE) * geometry.columns().div_ceil(COARSE)) as u64
}

/// The cheapest way from start to goal on a coarse map on which nothing but unknown ground is closed; `None` where that
/// separates them.
///
/// # Errors
/// [`PlannerError`] when the ranking is not usable.
pub(super) fn spine(
    terrain: Terrain,
    vehicle: &Vehicle,
    params: &RankParams,
    [start, goal]: [Position; 2],
) -> Result<Option<Vec<Position>>, PlannerError> {
    let geometry = terrain.elevation_m.geometry();
    let coarse = GridGeometry::new(
        geometry.rows().div_ceil(COARSE),
        geometry.columns().div_ceil(COARSE),
        geometry.cell_size_m() * COARSE as f64,
        geometry.west_m(),
        geometry.north_m(),
    )?;
    let elevation = coarse_mean(terrain.elevation_m, coarse)?;
    let soil = terrain.soil.map(|soil| coarse_centres(soil, coarse)).transpose()?;
    let params = RankParams {
        profile: Profile::Metric,
        ..*params
    };
    let soil = soil.as_ref().map(Layer::view);
    let map = Ranker::new(elevation.view(), soil, None, None, vehicle, params)?.rank_all();
    let costs = map.cells().data().iter().map(|found| match found.rank() {
        0 => f64::INFINITY,
        1 => NO_GO_COST,
        rank => 1.0 + COST_PER_RANK * (10.0 - f64::from(rank)),
    });
    let costs = Layer::new(coarse, costs.collect(), "the coarse costs")?;
    let mut points = None;
    if let (Some(from), Some(to)) = (coarse.cell_at(start), coarse.cell_at(goal)) {
        let search = shortest_path(
            costs.view(),
            from,
            to,
            16,
            Corners::Cut,
            Algorithm::Auto,
            None,
            &mut silent(),
        )?;
        if let Search::Found { cells, .. } = search {
            let inner = cells.iter().skip(1).take(cells.len().saturating_sub(2));
            let mut way = vec![start];
            way.extend(inner.map(|&cell| coarse.centre(cell)));
            way.push(goal);
            points = Some(way);
        }
    }
    Ok(points)
}

/// The soil in the middle of each coarse cell.
fn coarse_centres(soil: LayerView<u8>, coarse: GridGeometry) -> Result<Layer<u8>, GridError> {
    let geometry = soil.geometry();
    let middle = |index: usize, last: usize| (index * COARSE + COARSE / 2).min(last - 1);
    let codes = coarse.cells().map(|cell| {
        soil[Cell::new(
            middle(cell.row, geometry.rows()),
            middle(cell.column, geometry.columns()),
        )]
    });
    Layer::new(coarse, codes.collect(), "the coarse soil")
}

/// Means of the known heights of coarse cells; NaN where none is known.
fn coarse_mean(elevation_m: LayerView<f32>, coarse: GridGeometry) -> Result<Layer<f32>, GridError> {
    let geometry = elevation_m.geometry();
    let data = coarse.cells().map(|cell| {
        let (mut sum, mut count) = (0.0, 0u32);
        for row in (cell.row * COARSE..(cell.row + 1) * COARSE).take_while(|&row| row < geometry.rows()) {
            let from = cell.column * COARSE;
            let to = (from + COARSE).min(geometry.columns());
            for height in (from..to).map(|column| elevation_m[Cell::new(row, column)]) {
                if height.is_finite() {
                    sum += f64::from(height);
                    count += 1;
                }
            }
        }
        (sum / f64::from(count)) as f32
    });
    Layer::new(coarse, data.collect(), "the coarse elevation")
}
