//! Ground that is kept while its soil changes: the directions that cells allow outlive the borrowed layers.

use crate::grid::{Cell, Layer, LayerView, Position, SIXTEEN};
use crate::soil::{SoilClass, Trafficability};
use crate::terrain::gradient_at;
use crate::vehicle::Vehicle;

use super::limits::Limits;
use super::motion::steady_grades;
use super::template::{Template, template};
use super::{Ground, Objective, Pricing};

/// The directions that every cell of a ground allows, to make the same ground again after its soil has changed.
#[derive(Clone, Debug)]
pub struct Headings {
    pub(super) allowed: Layer<u16>,
    pub(super) soils_met: u8,
}

impl<'a> Ground<'a> {
    /// The ground whose open cells and directions are known. They must be of this elevation, vehicle and moisture, and of
    /// this soil but for cells that [`Self::reconsider`] is told of.
    pub fn on(
        elevation_m: LayerView<'a, f32>,
        soil: Option<LayerView<'a, u8>>,
        vehicle: &'a Vehicle,
        moisture_percent: f64,
        headings: Headings,
        goal: Position,
    ) -> Self {
        let geometry = elevation_m.geometry();
        let soils = SoilClass::ALL.map(|class| Trafficability::of(vehicle, class, moisture_percent));
        let radius_m = vehicle.circumscribed_radius_m();
        let templates: Vec<Template> = SIXTEEN.iter().map(|step| template(*step, geometry, radius_m)).collect();
        let reach = templates
            .iter()
            .flat_map(|template| &template.swept)
            .map(|step| step.rows.abs().max(step.columns.abs()) as usize)
            .max()
            .unwrap_or(0);
        let Headings { allowed, soils_met } = headings;
        let mut ground = Self {
            elevation_m,
            soil,
            vehicle,
            pricing: Pricing::new(vehicle, &soils, Objective::default()),
            soils,
            limits: Limits::new(vehicle),
            headings: allowed,
            soils_met,
            bridged: None,
            radius_m,
            templates,
            steady: soils.map(|soil| steady_grades(vehicle, &soil)),
            fastest_mps: vehicle.max_speed_mps,
            reach,
            goal,
            reversed: false,
        };
        ground.note_fastest();
        ground
    }

    /// What the cells allow, for the same ground another time.
    pub fn into_headings(self) -> Headings {
        Headings {
            allowed: self.headings,
            soils_met: self.soils_met,
        }
    }

    /// Works out anew what a cell allows whose soil has changed, or which has been opened or closed.
    pub fn reconsider(&mut self, cell: Cell, is_open: bool) {
        let gradient = if is_open {
            gradient_at(self.elevation_m, cell)
        } else {
            None
        };
        let code = self.soil_code(cell);
        self.headings[cell] = gradient.map_or(0, |gradient| self.limits.headings(gradient, &self.soils[code]));
        if gradient.is_some() && self.soils_met >> code & 1 == 0 {
            self.soils_met |= 1 << code;
            self.note_fastest();
        }
    }

    /// Works out the speed that no piece exceeds; where nothing is open any will do.
    fn note_fastest(&mut self) {
        let met = self
            .soils
            .iter()
            .enumerate()
            .filter(|(code, _)| self.soils_met >> code & 1 == 1);
        let fastest_mps = met.fold(0.0, |fastest: f64, (_, soil)| fastest.max(soil.speed_mps));
        self.fastest_mps = if fastest_mps > 0.0 {
            fastest_mps
        } else {
            self.vehicle.max_speed_mps
        };
    }
}
