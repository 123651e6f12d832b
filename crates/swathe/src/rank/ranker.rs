//! Ranks of terrain: one cell, or all of them in one parallel pass with the same result.

use rayon::prelude::*;

use crate::grid::{Cell, EIGHT, GridError, GridGeometry, Layer, LayerView};
use crate::soil::{SoilClass, check_moisture};
use crate::terrain::{allowed_headings, gradient_at, neighbourhood, roughness_at};
use crate::vehicle::Vehicle;

use super::RANK_REACH_CELLS;
use super::criteria::Criteria;
use super::paper::goodness_of;
use super::plain::{PlainRanks, STRETCH, slope_squared};
use super::{CellRank, CellSource, Combine, Profile, RankError, RankMap, RankParams, Reason, SourceFault, TileReader};

/// Ranks cells of a terrain for a vehicle.
#[derive(Clone, Debug)]
pub struct Ranker<'a> {
    elevation_m: LayerView<'a, f32>,
    soil: Option<LayerView<'a, u8>>,
    grey: Option<LayerView<'a, f32>>,
    zones: Option<LayerView<'a, bool>>,
    params: RankParams,
    criteria: Criteria,
    vehicle: &'a Vehicle,
    /// Whether cells are fine enough to see what the wheels feel.
    fine: bool,
    plain: PlainRanks,
    /// Reads ground that is missing; none where all is there.
    reader: Option<&'a dyn TileReader>,
}

impl<'a> Ranker<'a> {
    /// A ranker of an elevation (NaN unknown), an optional soil layer of class codes, and, for the paper's profiles,
    /// the averaged grey levels of the same cells. `zones` marks cells that are closed.
    ///
    /// # Errors
    /// [`RankError`] when layers do not fit each other, a soil code is unknown, or the vehicle, the moisture, a weight or a
    /// limit is outside its range.
    pub fn new(
        elevation_m: LayerView<'a, f32>,
        soil: Option<LayerView<'a, u8>>,
        grey: Option<LayerView<'a, f32>>,
        zones: Option<LayerView<'a, bool>>,
        vehicle: &'a Vehicle,
        params: RankParams,
    ) -> Result<Self, RankError> {
        vehicle.validate()?;
        check_moisture(params.moisture_percent)?;
        check_params(&params)?;
        let geometry = elevation_m.geometry();
        let fits = |geometry: GridGeometry, what| {
            let (expected, found) = (elevation_m.geometry().cell_count(), geometry.cell_count());
            if found == expected {
                Ok(())
            } else {
                Err(GridError::ShapeMismatch { what, expected, found })
            }
        };
        if let Some(soil) = soil {
            fits(soil.geometry(), "the soil layer")?;
            let chunks = soil.data().par_chunks(1 << 16);
            let worst = chunks.map(|codes| codes.iter().copied().fold(0, u8::max)).max();
            let worst = worst.unwrap_or(0);
            SoilClass::from_code(worst)?;
        }
        if let Some(grey) = grey {
            fits(grey.geometry(), "the height map")?;
        }
        if let Some(zones) = zones {
            fits(zones.geometry(), "the zones")?;
        }
        if params.profile != Profile::Metric && grey.is_none() {
            return Err(RankError::NoHeightMap);
        }
        let gated = params.profile != Profile::Literal;
        let limit = match params.profile {
            Profile::Metric | Profile::Literal => vehicle.max_grade(),
            Profile::Paper => vehicle.max_grade().min(params.paper_grade),
        };
        let criteria = Criteria::new(vehicle, &params, limit, gated);
        Ok(Self {
            elevation_m,
            soil,
            grey,
            zones,
            params,
            plain: PlainRanks::new(&criteria, vehicle, geometry.cell_size_m()),
            criteria,
            vehicle,
            fine: params.profile == Profile::Metric && geometry.cell_size_m() <= vehicle.length_m,
            reader: None,
        })
    }

    /// The same for an elevation in tiles, of which `reader` reads those that are missing when they are needed.
    #[must_use]
    pub fn reading(self, reader: &'a dyn TileReader) -> Self {
        let reader = Some(reader);
        Self { reader, ..self }
    }

    /// Whether ground is read when it is first needed.
    pub fn reads_when_needed(&self) -> bool {
        self.reader.is_some()
    }

    /// Ranks every cell, rows in parallel.
    pub fn rank_all(&self) -> RankMap {
        let mut cells = Layer::filled(self.geometry(), CellRank::UNKNOWN);
        self.rank_into(cells.data_mut(), |rank| rank);
        RankMap::new(cells)
    }

    /// Ranks every cell into an array of the caller's, rows in parallel: the rank in the low four bits, the code of the
    /// reason in the high four.
    ///
    /// # Errors
    /// [`RankError::Grid`] when there is not one byte per cell.
    pub fn rank_bytes(&self, bytes: &mut [u8]) -> Result<(), RankError> {
        let (expected, found) = (self.geometry().cell_count(), bytes.len());
        if found != expected {
            let what = "the rank map";
            return Err(GridError::ShapeMismatch { what, expected, found }.into());
        }
        self.rank_into(bytes, CellRank::byte);
        Ok(())
    }

    fn rank_into<T: Send>(&self, cells: &mut [T], wrap: impl Fn(CellRank) -> T + Copy + Sync) {
        cells
            .par_chunks_mut(self.geometry().columns())
            .with_min_len(16)
            .enumerate()
            .for_each(|(row, out)| self.rank_stretch(row, 0, out, wrap));
    }

    /// Ranks cells that follow each other in a row, from `column` on.
    fn rank_stretch<T>(&self, row: usize, column: usize, out: &mut [T], wrap: impl Fn(CellRank) -> T + Copy) {
        let geometry = self.geometry();
        let alone = |column| wrap(self.cell_rank(Cell::new(row, column)));
        let plain = self.params.profile == Profile::Metric
            && !self.fine
            && self.zones.is_none()
            && !self.elevation_m.is_tiled();
        if !plain || row == 0 || row + 1 >= geometry.rows() {
            for (place, cell) in out.iter_mut().enumerate() {
                *cell = alone(column + place);
            }
            return;
        }
        // The map's first and last column lack neighbours.
        let end = column + out.len();
        let first = column.max(1).min(end);
        let last = end.min(geometry.columns() - 1).max(first);
        for outer in (column..first).chain(last..end) {
            out[outer - column] = alone(outer);
        }
        let inner = &mut out[first - column..last - column];
        let [north, here, south] = [row - 1, row, row + 1].map(|row| self.elevation_m.row(row));
        for (number, out) in inner.chunks_mut(STRETCH).enumerate() {
            let first = first + number * STRETCH;
            let heights = [north, here, south].map(|heights| &heights[first - 1..=first + out.len()]);
            let soil = self.soil.map(|soil| &soil.row(row)[first..first + out.len()]);
            let cell_rank = |place| self.cell_rank(Cell::new(row, first + place));
            self.plain.rank(heights, soil, out, wrap, cell_rank);
        }
    }

    fn slope_squared_at(&self, cell: Cell) -> Option<f32> {
        let run = 8.0 * self.geometry().cell_size_m() as f32;
        let [nw, n, ne, w, _, e, sw, s, se] = neighbourhood(self.elevation_m, cell)?;
        Some(slope_squared(
            [nw, n, ne, w, e, sw, s, se].map(|height| height as f32),
            1.0 / (run * run),
        ))
    }

    /// The side slope gate: some heading must keep both limits.
    fn heading_gate(&self, cell: Cell) -> Option<Reason> {
        if self.params.profile == Profile::Literal {
            return None;
        }
        let gradient = gradient_at(self.elevation_m, cell)?;
        let Vehicle {
            grade_up, grade_down, ..
        } = *self.vehicle;
        (allowed_headings(gradient, grade_up, grade_down, self.vehicle.max_side_slope()) == 0)
            .then_some(Reason::SideSlope)
    }

    fn grey_goodness(&self, grey: LayerView<f32>, cell: Cell) -> u8 {
        let geometry = grey.geometry();
        let differences = EIGHT.iter().enumerate().filter_map(|(k, step)| {
            let near = step.from(&geometry, cell)?;
            let difference = f64::from(grey[near] - grey[cell]) / step.length_cells();
            difference.is_finite().then_some((difference, k % 2 == 0))
        });
        let RankParams {
            directions,
            bands,
            rounding,
            ..
        } = self.params;
        goodness_of(differences, directions, bands, rounding)
    }
}

impl CellSource for Ranker<'_> {
    fn geometry(&self) -> GridGeometry {
        self.elevation_m.geometry()
    }

    fn cell_rank(&self, cell: Cell) -> CellRank {
        let Some(squared) = self.slope_squared_at(cell) else {
            return CellRank::UNKNOWN;
        };
        if self.zones.is_some_and(|zones| zones[cell]) {
            return CellRank::no_go(Reason::Zone);
        }
        let soil = self.soil.map_or(0, |soil| soil[cell]);
        let mut goodness = match self.grey {
            Some(grey) if self.params.profile != Profile::Metric => self.grey_goodness(grey, cell),
            _ => self.criteria.slope_goodness(squared),
        };
        let mut step = None;
        if self.fine
            && let Some(roughness) = roughness_at(self.elevation_m, cell)
        {
            goodness = goodness.min(self.criteria.roughness_goodness(roughness));
            step = self.criteria.step_gate(roughness);
        }
        let ranked = self.criteria.cell_rank(squared, soil, goodness);
        if ranked.rank() == 1 {
            return ranked;
        }
        match step.or_else(|| self.heading_gate(cell)) {
            Some(reason) => CellRank::no_go(reason),
            None => ranked,
        }
    }

    fn rank_window(&self, row: usize, column: usize, ranks: &mut [CellRank]) {
        self.rank_stretch(row, column, ranks, |rank| rank);
    }

    fn prefetch(&self, cells: &mut dyn Iterator<Item = Cell>, reach: usize) -> Result<(), SourceFault> {
        match self.reader {
            Some(reader) => reader.read_around(cells, reach + RANK_REACH_CELLS),
            None => Ok(()),
        }
    }
}

fn check_params(params: &RankParams) -> Result<(), RankError> {
    if let Combine::Weighted { height, soil } = params.combine {
        let sum = height + soil;
        if !(height >= 0.0 && soil >= 0.0 && (sum - 1.0).abs() < 1e-6) {
            return Err(RankError::Parameter {
                name: "sum of the weights of height and soil",
                given: sum,
                allowed: "both must be at least 0 and sum to 1",
            });
        }
    }
    if !(params.paper_grade.is_finite() && params.paper_grade > 0.0) {
        return Err(RankError::Parameter {
            name: "paper's grade limit",
            given: params.paper_grade,
            allowed: "it must be finite and above 0",
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rank::UnknownSoil;
    use crate::vehicle::fixtures::{pioneer, tractor};
    use proptest::prelude::*;
    use rstest::rstest;

    fn ramp(slope: f64) -> Layer<f32> {
        let geometry = GridGeometry::new(5, 5, 30.0, 0.0, 0.0).unwrap();
        let data = geometry
            .cells()
            .map(|cell| (slope * 30.0 * cell.column as f64) as f32)
            .collect();
        Layer::new(geometry, data, "ramp").unwrap()
    }

    fn soil_of(class: SoilClass, like: &Layer<f32>) -> Layer<u8> {
        Layer::filled(like.geometry(), class as u8)
    }

    #[rstest]
    // The pioneer's steepest grade is 30 %: bands end at 10, 20, 30 and 45 %.
    #[case(0.05, SoilClass::Gravel, 10, Reason::None)]
    #[case(0.12, SoilClass::Sand, 8, Reason::None)]
    #[case(0.28, SoilClass::Clay, 6, Reason::None)]
    #[case(0.05, SoilClass::Silt, 7, Reason::None)]
    #[case(0.05, SoilClass::Rock, 6, Reason::None)]
    #[case(0.31, SoilClass::Gravel, 1, Reason::Grade)]
    #[case(0.60, SoilClass::Gravel, 1, Reason::Grade)]
    #[case(0.05, SoilClass::None, 1, Reason::NoGround)]
    #[case(0.05, SoilClass::Unknown, 8, Reason::None)]
    fn metric_ranks(#[case] slope: f64, #[case] soil: SoilClass, #[case] rank: u8, #[case] reason: Reason) {
        let (vehicle, elevation) = (pioneer(), ramp(slope));
        let soil = soil_of(soil, &elevation);
        let params = RankParams::default();
        let ranker = Ranker::new(elevation.view(), Some(soil.view()), None, None, &vehicle, params).unwrap();
        let found = ranker.cell_rank(Cell::new(2, 2));
        assert_eq!((found.rank(), found.reason()), (rank, reason));
    }

    #[test]
    fn wet_clay_stops_the_tractor_and_moisture_is_the_reason() {
        let (vehicle, elevation) = (tractor(), ramp(0.02));
        let soil = soil_of(SoilClass::Clay, &elevation);
        let at = |moisture_percent| {
            let params = RankParams {
                moisture_percent,
                ..RankParams::default()
            };
            let ranker = Ranker::new(elevation.view(), Some(soil.view()), None, None, &vehicle, params).unwrap();
            ranker.cell_rank(Cell::new(2, 2)).reason()
        };
        assert_eq!(at(20.0), Reason::None);
        assert_eq!(at(45.0), Reason::SoilStrength);
    }

    #[test]
    fn unknown_soil_can_be_avoided_or_taken_as_a_class() {
        let (vehicle, elevation) = (pioneer(), ramp(0.02));
        let at = |unknown_soil| {
            let params = RankParams {
                unknown_soil,
                ..RankParams::default()
            };
            let ranker = Ranker::new(elevation.view(), None, None, None, &vehicle, params).unwrap();
            ranker.cell_rank(Cell::new(2, 2))
        };
        assert_eq!(at(UnknownSoil::Avoid).reason(), Reason::UnknownSoil);
        assert_eq!(at(UnknownSoil::Class(SoilClass::Gravel)).rank(), 10);
    }

    #[test]
    fn paper_keeps_the_gate_that_literal_drops() {
        let (vehicle, elevation) = (pioneer(), ramp(0.4));
        let grey = Layer::new(
            elevation.geometry(),
            elevation.data().iter().map(|z| z / 48.0 * 255.0).collect(),
            "grey",
        )
        .unwrap();
        let soil = soil_of(SoilClass::Gravel, &elevation);
        let at = |profile| {
            let params = RankParams {
                profile,
                ..RankParams::default()
            };
            let view = (elevation.view(), Some(soil.view()), Some(grey.view()));
            let ranker = Ranker::new(view.0, view.1, view.2, None, &vehicle, params).unwrap();
            ranker.cell_rank(Cell::new(2, 2))
        };
        // 64 grey levels a cell: Table I says 4, gravel 5.
        assert_eq!(at(Profile::Literal).rank(), 9);
        assert_eq!(at(Profile::Paper).reason(), Reason::Grade);
    }

    #[test]
    fn fine_cells_show_steps_and_roughness_that_coarse_cells_hide() {
        let vehicle = tractor();
        let kerb = |cell_size_m| {
            let geometry = GridGeometry::new(5, 5, cell_size_m, 0.0, 0.0).unwrap();
            let data = geometry
                .cells()
                .map(|c| f32::from(u8::from(c.column > 2)) * 0.5)
                .collect();
            let elevation = Layer::new(geometry, data, "kerb").unwrap();
            let ranker = Ranker::new(elevation.view(), None, None, None, &vehicle, RankParams::default()).unwrap();
            ranker.cell_rank(Cell::new(2, 2))
        };
        assert_eq!(kerb(1.5).reason(), Reason::Step);
        assert_eq!(kerb(30.0).rank(), 8);
    }

    proptest! {
        #[test]
        fn one_pass_and_cell_by_cell_agree(
            heights in prop::collection::vec(prop_oneof![9 => 0.0f32..40.0, 1 => Just(f32::NAN)], 72),
            soils in prop::collection::vec(0u8..7, 72),
            moisture_percent in 5.0f64..60.0,
            size in prop_oneof![3 => Just(30.0), 3 => Just(200.0), 1 => Just(1.0)],
            side_slope in prop_oneof![Just(0.2), Just(0.02)],
            place in 0usize..72,
            long in 0usize..10,
        ) {
            let geometry = GridGeometry::new(8, 9, size, 0.0, 0.0).unwrap();
            let elevation = Layer::new(geometry, heights, "z").unwrap();
            let soil = Layer::new(geometry, soils, "soil").unwrap();
            let vehicle = Vehicle { side_slope, ..tractor() };
            let params = RankParams { moisture_percent, ..RankParams::default() };
            let ranker =
                Ranker::new(elevation.view(), Some(soil.view()), None, None, &vehicle, params).unwrap();
            let map = ranker.rank_all();
            for cell in geometry.cells() {
                prop_assert_eq!(map.cells()[cell], ranker.cell_rank(cell), "{:?}", cell);
            }
            let mut bytes = vec![0; 72];
            ranker.rank_bytes(&mut bytes).unwrap();
            let packed: Vec<u8> = map.cells().data().iter().map(|rank| rank.byte()).collect();
            prop_assert_eq!(bytes, packed);
            let (row, column) = (place / 9, place % 9);
            let mut window = vec![CellRank::UNKNOWN; (9 - column).min(long)];
            ranker.rank_window(row, column, &mut window);
            prop_assert_eq!(&window[..], &map.cells().data()[place..place + window.len()]);
        }

        #[test]
        fn rank_never_rises_with_slope(slope in 0.0f64..0.5, more in 0.0f64..0.3) {
            let vehicle = pioneer();
            let rank = |slope| {
                let elevation = ramp(slope);
                let ranker =
                    Ranker::new(elevation.view(), None, None, None, &vehicle, RankParams::default()).unwrap();
                ranker.cell_rank(Cell::new(2, 2)).rank()
            };
            prop_assert!(rank(slope + more) <= rank(slope));
        }
    }

    #[test]
    fn layers_that_do_not_fit_and_bad_numbers_are_refused() {
        let (vehicle, elevation) = (pioneer(), ramp(0.1));
        let small = Layer::filled(GridGeometry::new(2, 2, 30.0, 0.0, 0.0).unwrap(), 1u8);
        let new = |soil, params| Ranker::new(elevation.view(), soil, None, None, &vehicle, params).map(|_| ());
        assert!(matches!(
            new(Some(small.view()), RankParams::default()),
            Err(RankError::Grid(_))
        ));
        let alien = Layer::filled(elevation.geometry(), 9u8);
        assert!(matches!(
            new(Some(alien.view()), RankParams::default()),
            Err(RankError::Soil(_))
        ));
        let wet = RankParams {
            moisture_percent: f64::NAN,
            ..RankParams::default()
        };
        assert!(new(None, wet).is_err());
        let unweighted = RankParams {
            combine: Combine::Weighted { height: 0.9, soil: 0.9 },
            ..RankParams::default()
        };
        assert!(matches!(new(None, unweighted), Err(RankError::Parameter { .. })));
        let paper = RankParams {
            profile: Profile::Paper,
            ..RankParams::default()
        };
        assert_eq!(new(None, paper), Err(RankError::NoHeightMap));
    }
}
