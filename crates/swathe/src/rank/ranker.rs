//! Ranks of terrain: one cell, or all of them in one parallel pass with the same result.

use rayon::prelude::*;

use crate::grid::{Cell, EIGHT, GridGeometry, Layer, LayerView};
use crate::soil::{SoilClass, check_moisture};
use crate::terrain::{allowed_headings, gradient_at, neighbourhood, roughness_at};
use crate::vehicle::Vehicle;

use super::criteria::Criteria;
use super::paper::goodness_of;
use super::{CellRank, CellSource, Combine, Profile, RankError, RankMap, RankParams, Reason};

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
}

/// Ranks of plain terrain by soil code and exceeded bands, with the squared slopes up to which they hold.
struct Lookup {
    ranks: [[CellRank; 4]; 8],
    bands_squared: [f32; 3],
    plain_squared: [f32; 8],
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
        let fits = |found: usize, what| {
            let expected = geometry.cell_count();
            if found == expected {
                Ok(())
            } else {
                Err(crate::grid::GridError::ShapeMismatch { what, expected, found })
            }
        };
        if let Some(soil) = soil {
            fits(soil.data().len(), "the soil layer")?;
            let worst = soil.data().par_iter().copied().max().unwrap_or(0);
            SoilClass::from_code(worst)?;
        }
        if let Some(grey) = grey {
            fits(grey.data().len(), "the height map")?;
        }
        if let Some(zones) = zones {
            fits(zones.data().len(), "the zones")?;
        }
        if params.profile != Profile::Metric && grey.is_none() {
            return Err(RankError::NoHeightMap);
        }
        let gated = params.profile != Profile::Literal;
        let limit = match params.profile {
            Profile::Metric | Profile::Literal => vehicle.max_grade(),
            Profile::Paper => vehicle.max_grade().min(params.paper_grade),
        };
        Ok(Self {
            elevation_m,
            soil,
            grey,
            zones,
            params,
            criteria: Criteria::new(vehicle, &params, limit, gated),
            vehicle,
            fine: params.profile == Profile::Metric && geometry.cell_size_m() <= vehicle.length_m,
        })
    }

    /// Ranks every cell, rows in parallel.
    pub fn rank_all(&self) -> RankMap {
        let geometry = self.geometry();
        let mut cells = Layer::filled(geometry, CellRank::UNKNOWN);
        let columns = geometry.columns();
        let plain = self.params.profile == Profile::Metric && !self.fine && self.zones.is_none();
        let lookup = self.lookup();
        cells.data_mut().par_chunks_mut(columns).enumerate().for_each_init(
            || vec![0.0; columns],
            |slopes, (row, out)| {
                if plain && row > 0 && row + 1 < geometry.rows() && columns > 2 {
                    self.rank_row(row, &lookup, slopes, out);
                } else {
                    for (column, cell) in out.iter_mut().enumerate() {
                        *cell = self.cell_rank(Cell::new(row, column));
                    }
                }
            },
        );
        RankMap::new(cells)
    }

    /// Ranks an inner row: a pass of arithmetic that the compiler turns into vector instructions, then look-ups.
    fn rank_row(&self, row: usize, lookup: &Lookup, slopes: &mut [f32], out: &mut [CellRank]) {
        let run = 8.0 * self.geometry().cell_size_m() as f32;
        let scale = 1.0 / (run * run);
        let inner = out.len() - 2;
        let [north, here, south] = [row - 1, row, row + 1].map(|row| self.elevation_m.row(row));
        let [(nw, n, ne), (w, h, e), (sw, s, se)] =
            [north, here, south].map(|row| (&row[..inner], &row[1..=inner], &row[2..]));
        for (i, slope) in slopes[..inner].iter_mut().enumerate() {
            let around = [nw[i], n[i], ne[i], w[i], e[i], sw[i], s[i], se[i]];
            // Adding nothing of the cell's own height makes an unknown cell's slope unknown.
            *slope = slope_squared(around, scale) + 0.0 * h[i];
        }
        let soil = self.soil.map(|soil| &soil.row(row)[1..=inner]);
        let [first, second, limit] = lookup.bands_squared;
        for (i, (&slope, cell)) in slopes[..inner].iter().zip(&mut out[1..=inner]).enumerate() {
            let code = usize::from(soil.map_or(0, |soil| soil[i])) & 7;
            let exceeded = usize::from(slope > first) + usize::from(slope > second) + usize::from(slope > limit);
            // Unknown slopes fail the comparison too.
            *cell = if slope <= lookup.plain_squared[code] || slope > limit {
                lookup.ranks[code][exceeded]
            } else {
                self.cell_rank(Cell::new(row, i + 1))
            };
        }
        out[0] = self.cell_rank(Cell::new(row, 0));
        out[inner + 1] = self.cell_rank(Cell::new(row, inner + 1));
    }

    /// The tables of a pass over plain terrain.
    fn lookup(&self) -> Lookup {
        let (ranks, steepest) = self.criteria.tables();
        // Down or up a slope some of the sixteen headings lies within 13.3 degrees of the fall line, where the side slope
        // is at most 0.23 of the slope: up to here the heading gate cannot fail.
        let headed = self.vehicle.max_grade().min(self.vehicle.side_slope / 0.23);
        let headed_squared = (headed * headed * (1.0 - 1e-6)) as f32;
        Lookup {
            ranks,
            bands_squared: self.criteria.bands_squared(),
            plain_squared: steepest.map(|squared| squared.min(headed_squared)),
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
            grade_up,
            grade_down,
            side_slope,
            ..
        } = *self.vehicle;
        (allowed_headings(gradient, grade_up, grade_down, side_slope) == 0).then_some(Reason::SideSlope)
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
}

/// Square of Horn's slope; differences are taken first so that single precision loses nothing that the heights had.
#[inline]
fn slope_squared([nw, n, ne, w, e, sw, s, se]: [f32; 8], scale: f32) -> f32 {
    let east = (ne - nw) + 2.0 * (e - w) + (se - sw);
    let north = (nw - sw) + 2.0 * (n - s) + (ne - se);
    (east * east + north * north) * scale
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
