//! Soil belief.

use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::belief::{
    BeliefParams, CLASS_COUNT, CLASSES, Changed, Decisions, Going, Match, Matching, Observation, PerClass, Prior,
    ProbePolicy, RoutePrices, Rule, SoilType, SoilTypes, Spread, Unit,
};
use swathe::grid::{Cell, GridError, Layer, Position};
use swathe::sensor::PenetrometerReading;
use swathe::soil::{SoilClass, SoilTable};

use crate::convert::{array, entry, geometry, values, word};
use crate::error::{CoreError, invalid};

type TypeRow = (f64, f64, f64, f64, f64, f64, f64, f64);
/// (number, symbol, class code, shares or None) of a unit.
pub(crate) type UnitRow = (u32, u32, u8, Option<PerClass>);
/// (x, y, depths, cone indices, refusal depth, sleeve frictions) of a reading.
pub(crate) type ReadingRow = (f64, f64, Vec<f64>, Vec<f64>, Option<f64>, Option<Vec<f64>>);
/// (reading, units, cells, cells whose code differs, their codes).
type Outcome<'py> = (
    u64,
    Vec<u32>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<u8>>,
);

struct Inner {
    belief: swathe::belief::SoilBelief,
    going: Going,
    decisions: Decisions,
}

/// A soil belief with the decisions for one vehicle, kept up to date.
#[pyclass(frozen, module = "swathe._core")]
pub(crate) struct SoilBelief(Mutex<Inner>);

#[pymethods]
impl SoilBelief {
    #[new]
    #[pyo3(signature = (shape, layer, units, params, needed_kpa, moisture_percent, table2))]
    #[allow(clippy::too_many_arguments, reason = "the mirror's keyword arguments")]
    fn new(
        py: Python<'_>,
        shape: (usize, usize, f64, f64, f64),
        layer: PyReadonlyArray2<'_, u32>,
        units: Vec<UnitRow>,
        params: &Bound<'_, PyDict>,
        needed_kpa: f64,
        moisture_percent: f64,
        table2: bool,
    ) -> PyResult<Self> {
        let grid = geometry(shape)?;
        let params = params_of(params)?;
        let units = units.into_iter().map(unit_of).collect::<Result<Vec<_>, _>>()?;
        let data = values(&layer)?.to_vec();
        let table = if table2 { SoilTable::Table2 } else { SoilTable::Text };
        let made = py.detach(|| -> Result<Inner, CoreError> {
            let layer = Layer::new(grid, data, "the layer of map units")?;
            let going = Going::with_cone_index(needed_kpa, moisture_percent, table)?;
            let belief = swathe::belief::SoilBelief::new(&layer, &units, params)?;
            let decisions = belief.decide_all(&going);
            Ok(Inner {
                belief,
                going,
                decisions,
            })
        });
        Ok(Self(Mutex::new(made?)))
    }

    /// Takes a push of the penetrometer into account.
    fn add_reading<'py>(&self, py: Python<'py>, reading: ReadingRow) -> PyResult<Outcome<'py>> {
        let observation = Observation::Reading(reading_of(reading));
        self.change(py, |belief| belief.add(&observation))
    }

    /// Takes somebody's word into account.
    fn add_class<'py>(&self, py: Python<'py>, x_m: f64, y_m: f64, code: u8) -> PyResult<Outcome<'py>> {
        let class = SoilClass::from_code(code).map_err(CoreError::from)?;
        let at = Position::new(x_m, y_m);
        self.change(py, |belief| belief.add(&Observation::Class { at, class }))
    }

    /// Forgets a reading.
    fn withdraw<'py>(&self, py: Python<'py>, reading: u64) -> PyResult<Outcome<'py>> {
        self.change(py, |belief| belief.withdraw(reading))
    }

    /// Probabilities of the classes at a cell.
    fn class_probabilities(&self, row: i64, column: i64) -> PyResult<PerClass> {
        let inner = self.inner();
        Ok(inner.belief.class_probabilities(cell_of(&inner, row, column)?))
    }

    /// (code, goodness, no-go probability, go) of a cell.
    fn decide(&self, row: i64, column: i64) -> PyResult<(u8, u8, f64, bool)> {
        let inner = self.inner();
        let found = inner.belief.decide(cell_of(&inner, row, column)?, &inner.going);
        Ok((found.code as u8, found.goodness, found.no_go_probability, found.go))
    }

    /// Soil codes of all cells, and whether each is no-go.
    #[allow(clippy::type_complexity, reason = "two arrays")]
    fn decisions<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyArray2<u8>>, Bound<'py, PyArray2<bool>>)> {
        let Decisions { codes, no_go } = self.inner().decisions.clone();
        let grid = codes.geometry();
        Ok((array(py, grid, codes.into_data())?, array(py, grid, no_go.into_data())?))
    }

    /// Soil codes of all cells beside those of a map.
    fn codes_beside<'py>(
        &self,
        py: Python<'py>,
        mapped: PyReadonlyArray2<'py, u8>,
    ) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let data = values(&mapped)?.to_vec();
        // The lock is not held without the interpreter.
        let (belief, going) = {
            let inner = self.inner();
            (inner.belief.clone(), inner.going)
        };
        let grid = belief.geometry();
        let mapped = Layer::new(grid, data, "the mapped soil").map_err(CoreError::from)?;
        let codes = py.detach(|| belief.codes_beside(&mapped, &going));
        array(py, grid, codes.into_data())
    }

    /// (expected saving, chances, savings) of a reading at a cell; `price` takes cells and codes and gives both prices.
    fn probe_value(
        &self,
        py: Python<'_>,
        row: i64,
        column: i64,
        dead_end_cost: f64,
        price: &Bound<'_, PyAny>,
    ) -> PyResult<(f64, PerClass, PerClass)> {
        // The caller's function may look at this belief, so it is not held while that runs.
        let (belief, decisions, going, cell) = {
            let inner = self.inner();
            let cell = cell_of(&inner, row, column)?;
            (inner.belief.clone(), inner.decisions.clone(), inner.going, cell)
        };
        let mut failed = None;
        let ask = |cells: &[(Cell, u8)]| {
            let (indices, codes) = columns_of(py, &belief, cells);
            let answer = price
                .call1((indices, codes))
                .and_then(|found| found.extract::<(f64, f64)>());
            let (kept, best) = answer.unwrap_or_else(|error| {
                failed.get_or_insert(error);
                (0.0, 0.0)
            });
            RoutePrices { kept, best }
        };
        let found = swathe::belief::probe_value(&belief, &decisions, cell, &going, dead_end_cost, ask);
        if let Some(error) = failed {
            return Err(error);
        }
        let found = found.map_err(CoreError::from)?;
        Ok((found.expected_saving, found.chances, found.savings))
    }
}

impl SoilBelief {
    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change<'py, F>(&self, py: Python<'py>, change: F) -> PyResult<Outcome<'py>>
    where
        F: FnOnce(&mut swathe::belief::SoilBelief) -> Result<Changed, swathe::belief::BeliefError> + Send,
    {
        let (changed, other, grid) = py.detach(|| -> Result<_, CoreError> {
            let mut inner = self.inner();
            let Inner {
                belief,
                going,
                decisions,
            } = &mut *inner;
            let changed = change(belief)?;
            let other = belief.redecide(decisions, &changed, going);
            Ok((changed, other, belief.geometry()))
        })?;
        let indices = PyArray1::from_iter(py, other.iter().map(|&(cell, _)| grid.index(cell) as u32));
        let codes = PyArray1::from_iter(py, other.iter().map(|&(_, code)| code));
        let cells = PyArray1::from_vec(py, changed.cells);
        Ok((changed.reading, changed.units, cells, indices, codes))
    }
}

fn columns_of<'py>(
    py: Python<'py>,
    belief: &swathe::belief::SoilBelief,
    cells: &[(Cell, u8)],
) -> (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u8>>) {
    let grid = belief.geometry();
    let indices = PyArray1::from_iter(py, cells.iter().map(|&(cell, _)| grid.index(cell) as u32));
    (indices, PyArray1::from_iter(py, cells.iter().map(|&(_, code)| code)))
}

/// (likelihoods, observed code, mean cone index in kPa or None) of a reading.
#[pyfunction]
pub(crate) fn match_profile(reading: ReadingRow, params: &Bound<'_, PyDict>) -> PyResult<(PerClass, u8, Option<f64>)> {
    let params = params_of(params)?;
    params.validate().map_err(CoreError::from)?;
    let found = swathe::belief::match_profile(&reading_of(reading), &params).map_err(CoreError::from)?;
    let Match {
        likelihood,
        observed,
        cone_index_kpa,
    } = found;
    Ok((likelihood, observed as u8, cone_index_kpa))
}

/// Refuses a reading that is not physical.
#[pyfunction]
pub(crate) fn check_reading(reading: ReadingRow) -> PyResult<()> {
    let checked = reading_of(reading)
        .validate()
        .map_err(swathe::belief::BeliefError::from);
    Ok(checked.map_err(CoreError::from)?)
}

/// A probing policy from its word and its figure.
pub(crate) fn probe_policy(policy: &str, figure: f64) -> PyResult<ProbePolicy> {
    let known = [
        ("never", ProbePolicy::Never),
        ("every", ProbePolicy::EveryMetres(figure)),
        ("where_it_matters", ProbePolicy::WhereItMatters { probe_cost: figure }),
        ("where_it_pays", ProbePolicy::WhereItPays { probe_cost: figure }),
    ];
    word("probing policy", policy, &known)
}

/// Place among the candidates of the next reading, -1 for here, or None; `value` is asked for a candidate's place.
#[pyfunction]
pub(crate) fn next_probe(
    policy: &str,
    figure: f64,
    since_last_m: f64,
    candidates: usize,
    value: &Bound<'_, PyAny>,
) -> PyResult<Option<i64>> {
    let policy = probe_policy(policy, figure)?.validate().map_err(CoreError::from)?;
    // A candidate is told by its place in the list; the robot's own cell by the place after the last.
    let cells: Vec<Cell> = (0..candidates).map(|place| Cell::new(0, place)).collect();
    let here = Cell::new(0, candidates);
    let mut failed = None;
    let worth = |cell: Cell| {
        let answer = value.call1((cell.column,)).and_then(|found| found.extract::<f64>());
        answer.unwrap_or_else(|error| {
            failed.get_or_insert(error);
            0.0
        })
    };
    let found = swathe::belief::next_probe(policy, here, since_last_m, &cells, worth);
    match failed {
        Some(error) => Err(error),
        None => Ok(found.map(|cell| if cell == here { -1 } else { cell.column as i64 })),
    }
}

/// The core's parameters, as the mirror's constructor takes them, and its table of soil types.
#[pyfunction]
pub(crate) fn belief_defaults(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let params = BeliefParams::default();
    let dict = PyDict::new(py);
    for (name, value) in [
        ("purity", params.purity),
        ("map_weight", params.map_weight),
        ("length_m", params.length_m),
        ("same_symbol_share", params.same_symbol_share),
        ("layer_depth_m", params.layer_depth_m),
        ("refusal_kpa", params.refusal_kpa),
        ("refusal_depth_m", params.refusal_depth_m),
        ("goodness_confidence", params.goodness_confidence),
        ("no_go_tolerance", params.no_go_tolerance),
        ("table_spread_ln", params.table_spread_ln),
        ("reading_spread_ln", params.reading_spread_ln),
        ("far_strength_weight", params.far_strength_weight),
    ] {
        dict.set_item(name, value)?;
    }
    dict.set_item("confusion", params.confusion.to_vec())?;
    Ok(dict)
}

/// The core's table of soil types, a row for each class.
#[pyfunction]
pub(crate) fn soil_types() -> Vec<TypeRow> {
    let row = |soil: &SoilType| {
        let (cone, gradient, roughness) = (soil.cone_index_ln_kpa, soil.gradient_kpa_per_m, soil.roughness);
        (
            cone.mean.exp(),
            cone.deviation,
            gradient.mean,
            gradient.deviation,
            roughness.mean,
            roughness.deviation,
            soil.refusal,
            soil.remoulding_index,
        )
    };
    SoilTypes::default().0.iter().map(row).collect()
}

/// Codes of the classes in the order of probabilities.
#[pyfunction]
pub(crate) fn belief_classes() -> Vec<u8> {
    CLASSES.iter().map(|&class| class as u8).collect()
}

fn cell_of(inner: &Inner, row: i64, column: i64) -> Result<Cell, CoreError> {
    let grid = inner.belief.geometry();
    grid.checked(row, column).ok_or_else(|| {
        let (rows, columns) = (grid.rows(), grid.columns());
        let outside = GridError::OutsideGrid {
            row,
            column,
            rows,
            columns,
        };
        outside.into()
    })
}

pub(crate) fn unit_of((id, symbol, code, shares): UnitRow) -> Result<Unit, CoreError> {
    let prior = match shares {
        Some(shares) => Prior::Mixture(shares),
        None => Prior::Class(SoilClass::from_code(code)?),
    };
    Ok(Unit { id, symbol, prior })
}

pub(crate) fn reading_of(row: ReadingRow) -> PenetrometerReading {
    let (x_m, y_m, depths_m, cone_indices_kpa, refusal_depth_m, sleeve_frictions_kpa) = row;
    PenetrometerReading {
        x_m,
        y_m,
        depths_m,
        cone_indices_kpa,
        refusal_depth_m,
        sleeve_frictions_kpa,
    }
}

fn type_of(row: TypeRow) -> SoilType {
    let spread = |mean, deviation| Spread { mean, deviation };
    SoilType {
        cone_index_ln_kpa: spread(row.0.ln(), row.1),
        gradient_kpa_per_m: spread(row.2, row.3),
        roughness: spread(row.4, row.5),
        refusal: row.6,
        remoulding_index: row.7,
    }
}

pub(crate) fn params_of(dict: &Bound<'_, PyDict>) -> PyResult<BeliefParams> {
    let rule: String = entry(dict, "rule")?;
    let relabel = Rule::PaperRelabel {
        radius_m: entry(dict, "relabel_radius_m")?,
    };
    let matching: String = entry(dict, "matching")?;
    let types: Vec<TypeRow> = entry(dict, "types")?;
    let confusion: Vec<PerClass> = entry(dict, "confusion")?;
    let rows = |what: &str| {
        invalid(
            format!("The {what} needs {CLASS_COUNT} rows."),
            "Give one for each class.",
        )
    };
    Ok(BeliefParams {
        rule: word("rule", &rule, &[("bayes", Rule::Bayes), ("paper_relabel", relabel)])?,
        matching: word(
            "matching",
            &matching,
            &[("table", Matching::Table), ("confusion", Matching::Confusion)],
        )?,
        confusion: confusion.try_into().map_err(|_| rows("confusion matrix"))?,
        purity: entry(dict, "purity")?,
        map_weight: entry(dict, "map_weight")?,
        length_m: entry(dict, "length_m")?,
        same_symbol_share: entry(dict, "same_symbol_share")?,
        layer_depth_m: entry(dict, "layer_depth_m")?,
        refusal_kpa: entry(dict, "refusal_kpa")?,
        refusal_depth_m: entry(dict, "refusal_depth_m")?,
        goodness_confidence: entry(dict, "goodness_confidence")?,
        no_go_tolerance: entry(dict, "no_go_tolerance")?,
        table_spread_ln: entry(dict, "table_spread_ln")?,
        reading_spread_ln: entry(dict, "reading_spread_ln")?,
        far_strength_weight: entry(dict, "far_strength_weight")?,
        types: SoilTypes(
            types
                .into_iter()
                .map(type_of)
                .collect::<Vec<_>>()
                .try_into()
                .map_err(|_| rows("table of soil types"))?,
        ),
    })
}
