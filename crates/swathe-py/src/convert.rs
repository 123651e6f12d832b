//! Words and dictionaries to the core's parameters.

use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadwriteArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::corridor::ArcKind;
use swathe::grid::{GridGeometry, Position};
use swathe::nest::{Contact, NestParams, Vicinity};
use swathe::planner::Method;
use swathe::rank::{Bands, Combine, Directions, Profile, RankParams, Rounding, UnknownSoil};
use swathe::soil::{SoilClass, SoilTable};
use swathe::swarm::{Explore, SwarmParams};

use crate::error::{CoreError, invalid};

/// (rows, columns, cell size, west, north) of a grid.
pub(crate) type Shape = (usize, usize, f64, f64, f64);

pub(crate) fn geometry(shape: Shape) -> PyResult<GridGeometry> {
    let (rows, columns, cell_size_m, west_m, north_m) = shape;
    Ok(GridGeometry::new(rows, columns, cell_size_m, west_m, north_m).map_err(CoreError::from)?)
}

/// The values of an array that is contiguous by the mirror's promise.
pub(crate) fn values<'a, T: numpy::Element>(array: &'a PyReadonlyArray2<T>) -> PyResult<&'a [T]> {
    array
        .as_slice()
        .map_err(|_| invalid("An array is not contiguous.".to_owned(), "Use numpy.ascontiguousarray."))
}

/// The values of a new array, to be written.
pub(crate) fn values_mut<'a, T: numpy::Element>(array: &'a mut PyReadwriteArray2<T>) -> PyResult<&'a mut [T]> {
    array
        .as_slice_mut()
        .map_err(|_| invalid("An array is not contiguous.".to_owned(), "Use numpy.ascontiguousarray."))
}

/// A new array of the grid's shape.
pub(crate) fn array<T: numpy::Element>(
    py: Python<'_>,
    geometry: GridGeometry,
    data: Vec<T>,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    numpy::PyArray1::from_vec(py, data).reshape([geometry.rows(), geometry.columns()])
}

/// A required entry of a dictionary.
pub(crate) fn entry<'py, T>(dict: &Bound<'py, PyDict>, name: &str) -> PyResult<T>
where
    T: for<'a> FromPyObject<'a, 'py, Error = PyErr>,
{
    match dict.get_item(name)? {
        Some(value) => value.extract(),
        None => Err(invalid(format!("The parameter {name} is missing."), "")),
    }
}

pub(crate) fn word<T>(name: &str, given: &str, table: &[(&str, T)]) -> PyResult<T>
where
    T: Copy,
{
    let found = table.iter().find(|(word, _)| *word == given);
    found.map(|(_, value)| *value).ok_or_else(|| {
        let words: Vec<&str> = table.iter().map(|(word, _)| *word).collect();
        invalid(
            format!("The {name} {given:?} is not known; known are {}.", words.join(", ")),
            "Choose one of them.",
        )
    })
}

pub(crate) fn position((x_m, y_m): (f64, f64)) -> Position {
    Position::new(x_m, y_m)
}

pub(crate) fn rank_params(dict: &Bound<PyDict>) -> PyResult<RankParams> {
    let unknown: String = entry(dict, "unknown_soil")?;
    let unknown_soil = match unknown.as_str() {
        "neutral" => UnknownSoil::Neutral,
        "avoid" => UnknownSoil::Avoid,
        class => {
            let known = SoilClass::ALL.into_iter().find(|known| known.name() == class);
            UnknownSoil::Class(known.ok_or_else(|| {
                let known = SoilClass::ALL.map(SoilClass::name).join(", ");
                invalid(
                    format!("Unknown soil cannot count as {class:?}; known are neutral, avoid, {known}."),
                    "Choose one of them.",
                )
            })?)
        }
    };
    let combine: String = entry(dict, "combine")?;
    let combine = match combine.as_str() {
        "min" => Combine::Min,
        "weighted" => Combine::Weighted {
            height: entry(dict, "height_weight")?,
            soil: entry(dict, "soil_weight")?,
        },
        other => {
            return Err(invalid(
                format!("The combination {other:?} is not known; known are weighted, min."),
                "Choose one of them.",
            ));
        }
    };
    Ok(RankParams {
        profile: word(
            "profile",
            &entry::<String>(dict, "profile")?,
            &[
                ("metric", Profile::Metric),
                ("paper", Profile::Paper),
                ("literal", Profile::Literal),
            ],
        )?,
        moisture_percent: entry(dict, "moisture_percent")?,
        soil_table: word(
            "soil table",
            &entry::<String>(dict, "soil_table")?,
            &[("text", SoilTable::Text), ("table2", SoilTable::Table2)],
        )?,
        unknown_soil,
        combine,
        paper_grade: entry(dict, "paper_grade")?,
        directions: word("directions", &entry::<String>(dict, "directions")?, &DIRECTIONS)?,
        bands: word("bands", &entry::<String>(dict, "bands")?, &BANDS)?,
        rounding: word("rounding", &entry::<String>(dict, "rounding")?, &ROUNDING)?,
    })
}

const DIRECTIONS: [(&str, Directions); 4] = [
    ("worst", Directions::Worst),
    ("mean", Directions::Mean),
    ("best", Directions::Best),
    ("four", Directions::Four),
];

const BANDS: [(&str, Bands); 2] = [("symmetric", Bands::Symmetric), ("literal", Bands::Literal)];

const ROUNDING: [(&str, Rounding); 2] = [("half_away", Rounding::HalfAway), ("real", Rounding::Real)];

pub(crate) fn bands(name: &str) -> PyResult<Bands> {
    word("bands", name, &BANDS)
}

pub(crate) fn rounding(name: &str) -> PyResult<Rounding> {
    word("rounding", name, &ROUNDING)
}

pub(crate) fn vicinity(name: &str) -> PyResult<Vicinity> {
    if let Some(radius) = name.strip_prefix("disk:") {
        // A radius that is no number is refused by the core's range check.
        return Ok(Vicinity::Disc(radius.parse().unwrap_or(f64::NAN)));
    }
    word(
        "vicinity",
        name,
        &[
            ("moore1", Vicinity::Moore1),
            ("von_neumann1", Vicinity::VonNeumann1),
            ("cell", Vicinity::Cell),
        ],
    )
}

pub(crate) fn contact(name: &str) -> PyResult<Contact> {
    word(
        "contact",
        name,
        &[
            ("edge", Contact::Edge),
            ("corner", Contact::Corner),
            ("overlap", Contact::Overlap),
        ],
    )
}

pub(crate) fn nest_params(dict: &Bound<PyDict>) -> PyResult<NestParams> {
    let border: String = entry(dict, "border")?;
    Ok(NestParams {
        rank_min: entry(dict, "rank_min")?,
        vicinity: vicinity(&entry::<String>(dict, "vicinity")?)?,
        contact: contact(&entry::<String>(dict, "contact")?)?,
        border_suitable: word("border", &border, &[("unsuitable", false), ("suitable", true)])?,
    })
}

pub(crate) fn swarm_params(dict: &Bound<PyDict>) -> PyResult<SwarmParams> {
    Ok(SwarmParams {
        agents: entry(dict, "agents")?,
        pellet_max: entry(dict, "pellet_max")?,
        nest: nest_params(dict)?,
        teleport: entry(dict, "teleport")?,
        attract: entry(dict, "attract")?,
        explore: word(
            "exploration",
            &entry::<String>(dict, "explore")?,
            &[
                ("walk", Explore::Walk),
                ("uniform", Explore::Uniform),
                ("permute", Explore::Permute),
            ],
        )?,
        seed: entry(dict, "seed")?,
    })
}

pub(crate) fn arc_kind(name: &str, sagitta_m: Option<f64>) -> PyResult<ArcKind> {
    word(
        "arc",
        name,
        &[
            ("line", ArcKind::Line),
            ("circle", ArcKind::Circle { sagitta_m }),
            ("spine", ArcKind::Spine),
            ("relaid", ArcKind::Relaid),
        ],
    )
}

pub(crate) fn method(name: &str) -> PyResult<Method> {
    word("method", name, &[("swarm", Method::Swarm), ("exact", Method::Exact)])
}
