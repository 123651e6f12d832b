//! Soil classes.

use pyo3::prelude::*;
use swathe::soil::{SoilClass, SoilTable, check_moisture};

use crate::error::CoreError;

/// Goodness 1 to 5 of a class, by the paper's text or its Table II.
#[pyfunction]
pub(crate) fn soil_goodness(code: u8, table2: bool) -> PyResult<u8> {
    let table = if table2 { SoilTable::Table2 } else { SoilTable::Text };
    Ok(SoilClass::from_code(code).map_err(CoreError::from)?.goodness(table))
}

/// Rating cone index in kPa, or None where it does not apply.
#[pyfunction]
pub(crate) fn rating_cone_index_kpa(code: u8, moisture_percent: f64) -> PyResult<Option<f64>> {
    let moisture = check_moisture(moisture_percent).map_err(CoreError::from)?;
    let class = SoilClass::from_code(code).map_err(CoreError::from)?;
    Ok(class.rating_cone_index_kpa(moisture))
}
