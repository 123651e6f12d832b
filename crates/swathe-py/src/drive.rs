//! The navigator.

use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::belief::{Extent, PerClass, SoilBelief, SoilUpdate, Word};
use swathe::drive::{DriveParams, Knowledge, Method, Observation, OutsideNests, Region};
use swathe::grid::{Cell, Layer, Position};
use swathe::local::Evidence;
use swathe::nest::GridsParams;
use swathe::sensor::{Mount, Pose, Scan};
use swathe::soil::SoilClass;

use crate::belief::{ReadingRow, UnitRow, params_of, probe_policy, reading_of, unit_of};
use crate::convert::{Shape, array, entry, geometry, nest_params, position, values, word};
use crate::error::{CoreError, invalid};
use crate::events::{event_fields, standing};
use crate::grids;
use crate::vehicle::Vehicle;

const METHODS: [(&str, Method); 4] = [
    ("vfh", Method::Vfh),
    ("vfh+", Method::VfhPlus),
    ("vfh*", Method::VfhStar),
    ("player", Method::Player),
];

const OUTSIDE: [(&str, OutsideNests); 2] = [("cost", OutsideNests::Cost), ("block", OutsideNests::Block)];

fn evidence(given: &str) -> PyResult<Evidence> {
    let known = [("log-odds", Evidence::default()), ("himm", Evidence::himm())];
    word("evidence", given, &known)
}

fn params(dict: &Bound<PyDict>) -> PyResult<DriveParams> {
    Ok(DriveParams {
        method: word("method", &entry::<String>(dict, "method")?, &METHODS)?,
        outside_nests: word("outside_nests", &entry::<String>(dict, "outside_nests")?, &OUTSIDE)?,
        evidence: evidence(&entry::<String>(dict, "evidence")?)?,
        fade_s: entry(dict, "fade_s")?,
        lookahead_m: entry(dict, "lookahead_m")?,
        unknown_cost: entry(dict, "unknown_cost")?,
        trap_s: entry(dict, "trap_s")?,
        most_recoveries: entry(dict, "most_recoveries")?,
        follow_walls: entry(dict, "follow_walls")?,
        arrival_m: entry(dict, "arrival_m")?,
        max_turn_rate_radps: entry(dict, "max_turn_rate_radps")?,
        acceleration_mps2: entry(dict, "acceleration_mps2")?,
        braking_mps2: entry(dict, "braking_mps2")?,
        margin_m: entry(dict, "margin_m")?,
        stale_s: entry(dict, "stale_s")?,
        sensor_height_m: entry(dict, "sensor_height_m")?,
        sonar_height_m: entry(dict, "sonar_height_m")?,
        memory: entry(dict, "memory")?,
        recover: entry(dict, "recover")?,
        probing: entry::<(String, f64)>(dict, "probing").and_then(|(policy, figure)| probe_policy(&policy, figure))?,
        probe_wait_s: entry(dict, "probe_wait_s")?,
        probe_boom_m: entry(dict, "probe_boom_m")?,
        ..DriveParams::default()
    })
}

/// (ranks, shape, heights or None, route, grids or None) of a region that says what it says.
type Map<'py> = (
    PyReadonlyArray2<'py, u8>,
    Shape,
    Option<PyReadonlyArray2<'py, f32>>,
    Vec<(f64, f64)>,
    Option<Bound<'py, PyDict>>,
);

/// (region, polygons, units, belief, nests, whether heights explain returns, grids or None) of a region that learns.
type Learning<'py> = (
    Bound<'py, crate::region::Region>,
    PyReadonlyArray2<'py, u32>,
    Vec<UnitRow>,
    Bound<'py, PyDict>,
    Bound<'py, PyDict>,
    bool,
    Option<Bound<'py, PyDict>>,
);

/// (time, source, extent, what is said, cone index or None) of an update. The extent is (unit, None, None),
/// (None, (x, y, radius), None) or (None, None, cells); what is said a class's code, or probabilities.
type UpdateRow = (
    f64,
    String,
    (Option<u32>, Option<(f64, f64, f64)>, Option<Vec<(usize, usize)>>),
    (Option<u8>, Option<PerClass>),
    Option<f64>,
);

/// x, y, heading, pitch, roll.
type PoseFigures = (f64, f64, f64, f64, f64);

fn pose_of((x_m, y_m, heading_rad, pitch_rad, roll_rad): PoseFigures) -> Pose {
    Pose {
        x_m,
        y_m,
        heading_rad,
        pitch_rad,
        roll_rad,
    }
}

/// A scan of ranges and first angle, angle between beams, least and greatest range, mount.
fn scan_of(ranges_m: &PyReadonlyArray1<'_, f64>, figures: [f64; 7]) -> PyResult<Scan> {
    let Ok(ranges_m) = ranges_m.as_slice() else {
        return Err(invalid(
            "The ranges are not contiguous.".to_owned(),
            "Use numpy.ascontiguousarray.",
        ));
    };
    let [
        angle_min_rad,
        angle_increment_rad,
        range_min_m,
        range_max_m,
        x_m,
        y_m,
        heading_rad,
    ] = figures;
    Ok(Scan {
        ranges_m: ranges_m.to_vec(),
        angle_min_rad,
        angle_increment_rad,
        range_min_m,
        range_max_m,
        mount: Mount { x_m, y_m, heading_rad },
    })
}

fn fixed(map: Map<'_>) -> PyResult<Region> {
    let (ranks, shape, heights, route, grids) = map;
    let geometry = geometry(shape)?;
    let ranks = Layer::new(geometry, values(&ranks)?.to_vec(), "the rank map").map_err(CoreError::from)?;
    let heights = heights.as_ref().map(values).transpose()?;
    let heights = heights.map(|heights| Layer::new(geometry, heights.to_vec(), "the elevation"));
    Ok(Region {
        ranks,
        elevation_m: heights.transpose().map_err(CoreError::from)?,
        route: route.into_iter().map(position).collect(),
        grids: grids.as_ref().map(grids::params).transpose()?,
    })
}

fn knowledge(py: Python<'_>, learning: Learning<'_>) -> PyResult<(Knowledge, Option<GridsParams>)> {
    let (region, layer, units, belief, nest, explains_returns, grids) = learning;
    let map = region.get().known_map(py, nest_params(&nest)?, explains_returns)?;
    let layer = Layer::new(
        map.elevation_m.geometry(),
        values(&layer)?.to_vec(),
        "the layer of map units",
    );
    let layer = layer.map_err(CoreError::from)?;
    let units = units.into_iter().map(unit_of).collect::<Result<Vec<_>, _>>()?;
    let (mut params, grids) = (params_of(&belief)?, grids.as_ref().map(grids::params).transpose()?);
    params.types = params
        .types
        .on_day(map.rank.moisture_percent)
        .map_err(CoreError::from)?;
    let made = py.detach(|| -> Result<Knowledge, CoreError> {
        Ok(Knowledge::new(map, SoilBelief::new(&layer, &units, params)?)?)
    });
    Ok((made?, grids))
}

fn update_of(row: UpdateRow) -> Result<SoilUpdate, CoreError> {
    let (time_s, source, (unit, disc, cells), (code, shares), cone_index_kpa) = row;
    let extent = match (unit, disc) {
        (Some(unit), _) => Extent::Unit(unit),
        (None, Some((x_m, y_m, radius_m))) => Extent::Disc {
            at: Position::new(x_m, y_m),
            radius_m,
        },
        (None, None) => Extent::Cells(
            cells
                .unwrap_or_default()
                .into_iter()
                .map(|(row, column)| Cell::new(row, column))
                .collect(),
        ),
    };
    let word = match shares {
        Some(shares) => Word::Probabilities(shares),
        None => Word::Class(SoilClass::from_code(code.unwrap_or(0))?),
    };
    Ok(SoilUpdate {
        time_s,
        source,
        extent,
        word,
        cone_index_kpa,
    })
}

/// The navigator with all that it remembers.
#[pyclass(module = "swathe._core")]
pub(crate) struct Navigator {
    pub(crate) inner: swathe::drive::Navigator,
    time_s: f64,
}

#[pymethods]
impl Navigator {
    #[new]
    #[pyo3(signature = (vehicle, goal, dict, region, learning))]
    fn new(
        py: Python<'_>,
        vehicle: &Vehicle,
        goal: (f64, f64),
        dict: &Bound<'_, PyDict>,
        region: Option<Map<'_>>,
        learning: Option<Learning<'_>>,
    ) -> PyResult<Self> {
        let (goal, params) = (position(goal), params(dict)?);
        let made = match learning {
            None => swathe::drive::Navigator::new(&vehicle.inner, goal, region.map(fixed).transpose()?, params),
            Some(learning) => {
                let (knowledge, grids) = knowledge(py, learning)?;
                swathe::drive::Navigator::with_knowledge(&vehicle.inner, goal, knowledge, grids, params)
            }
        };
        Ok(Self {
            inner: made.map_err(CoreError::from)?,
            time_s: 0.0,
        })
    }

    /// A step: (speed, turn rate, status, reason).
    #[pyo3(signature = (time_s, pose, speeds, ranges_m, scan, reading))]
    #[allow(clippy::too_many_arguments, clippy::type_complexity, reason = "what a robot senses")]
    fn step(
        &mut self,
        py: Python<'_>,
        time_s: f64,
        pose: PoseFigures,
        speeds: (f64, f64),
        ranges_m: Option<PyReadonlyArray1<'_, f64>>,
        scan: [f64; 7],
        reading: Option<ReadingRow>,
    ) -> PyResult<(f64, f64, &'static str, &'static str)> {
        let scan = ranges_m.map(|ranges_m| scan_of(&ranges_m, scan)).transpose()?;
        let reading = reading.map(reading_of);
        let seen = Observation {
            time_s,
            pose: pose_of(pose),
            speed_mps: speeds.0,
            turn_rate_radps: speeds.1,
            scan: scan.as_ref(),
            reading: reading.as_ref(),
        };
        self.time_s = time_s;
        let inner = &mut self.inner;
        let command = py.detach(|| inner.step(&seen));
        let reason = self.inner.reason().text();
        Ok((
            command.speed_mps,
            command.turn_rate_radps,
            command.status.name(),
            reason,
        ))
    }

    /// Takes in what another sensor sees; the reason why it was left out, if it was.
    fn sense(
        &mut self,
        py: Python<'_>,
        time_s: f64,
        pose: PoseFigures,
        ranges_m: PyReadonlyArray1<'_, f64>,
        scan: [f64; 7],
        cone_rad: f64,
    ) -> PyResult<Option<&'static str>> {
        let (scan, inner) = (scan_of(&ranges_m, scan)?, &mut self.inner);
        let taken = py.detach(|| inner.sense(time_s, &pose_of(pose), &scan, cone_rad));
        Ok(taken.err().map(swathe::drive::Reason::text))
    }

    /// What happened in the last step: time, kind and fields of each event.
    #[allow(clippy::type_complexity, reason = "a list of triples")]
    fn events<'py>(&self, py: Python<'py>) -> PyResult<Vec<(f64, &'static str, Bound<'py, PyDict>)>> {
        let fields = |event| Ok((self.time_s, swathe::drive::Event::kind(event), event_fields(py, event)?));
        self.inner.events().iter().map(fields).collect()
    }

    /// Sets another goal.
    fn set_goal(&mut self, py: Python<'_>, goal: (f64, f64)) -> PyResult<()> {
        let inner = &mut self.inner;
        Ok(py.detach(|| inner.set_goal(position(goal))).map_err(CoreError::from)?)
    }

    /// Takes in news of the soil of an area; returns how many cells have another rank.
    fn learn_soil(&mut self, py: Python<'_>, update: UpdateRow) -> PyResult<usize> {
        let update = update_of(update)?;
        let inner = &mut self.inner;
        let learnt = py.detach(|| inner.learn_soil(&update)).map_err(CoreError::from)?;
        Ok(learnt.ranks.len())
    }

    /// Takes in a reading of another vehicle; returns how many cells have another rank.
    fn learn_reading(&mut self, py: Python<'_>, reading: ReadingRow) -> PyResult<usize> {
        let reading = reading_of(reading);
        let inner = &mut self.inner;
        let learnt = py.detach(|| inner.learn_reading(&reading)).map_err(CoreError::from)?;
        Ok(learnt.ranks.len())
    }

    /// Whether the robot stands and waits for a reading.
    fn wants_probe(&self) -> bool {
        self.inner.wants_probe()
    }

    /// The way from the robot on.
    fn way(&self) -> Vec<(f64, f64)> {
        self.inner.way().iter().map(|point| (point.x_m, point.y_m)).collect()
    }

    /// Points of the global route.
    fn global_route(&self) -> Vec<(f64, f64)> {
        let route = self.inner.global_route().iter();
        route.map(|point| (point.x_m, point.y_m)).collect()
    }

    /// (cost or None, how robot and goal stand to each other) of the global route that is kept right.
    fn global_cost(&self) -> Option<(Option<f64>, &'static str)> {
        let knowledge = self.inner.knowledge()?;
        Some((knowledge.route_cost(), standing(knowledge.standing())))
    }

    /// Ranks and soil codes in use.
    #[allow(clippy::type_complexity, reason = "two arrays")]
    fn ground<'py>(&self, py: Python<'py>) -> PyResult<Option<(Bound<'py, PyArray2<u8>>, Bound<'py, PyArray2<u8>>)>> {
        let Some(knowledge) = self.inner.knowledge() else {
            return Ok(None);
        };
        let geometry = knowledge.geometry();
        let ranks = array(py, geometry, knowledge.ranks().data().to_vec())?;
        Ok(Some((ranks, array(py, geometry, knowledge.codes().data().to_vec())?)))
    }

    /// Probability of each class, and of ground that does not carry, at a place.
    fn soil_at(&self, at: (f64, f64)) -> Option<(PerClass, f64)> {
        self.inner.knowledge()?.soil_at(position(at))
    }

    /// (shape, certainty of every cell, 255 where nothing was seen).
    #[allow(clippy::type_complexity, reason = "a layer")]
    fn certainty<'py>(&self, py: Python<'py>) -> PyResult<Option<(Shape, Bound<'py, PyArray2<u8>>)>> {
        let Some(window) = self.inner.certainty_window() else {
            return Ok(None);
        };
        let grid = window.geometry();
        let shape = (
            grid.rows(),
            grid.columns(),
            grid.cell_size_m(),
            grid.west_m(),
            grid.north_m(),
        );
        Ok(Some((shape, array(py, grid, window.into_data())?)))
    }

    /// (densities, blocked, masked, direction of sector 0, thresholds low and high, chosen direction or None) of the last step.
    #[allow(clippy::type_complexity, reason = "what a histogram shows")]
    fn histogram(&self) -> Option<(Vec<f32>, Vec<bool>, Vec<bool>, f64, (f64, f64), Option<f64>)> {
        let shown = self.inner.histogram()?;
        Some((
            shown.densities,
            shown.blocked,
            shown.masked,
            shown.first_rad,
            shown.thresholds,
            shown.direction_rad,
        ))
    }
}
