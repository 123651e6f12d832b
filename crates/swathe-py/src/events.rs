//! What happened in a step of the navigator, as words and plain values that JSON can hold.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::belief::CLASSES;
use swathe::drive::{Event, Recovery, Standing};
use swathe::grid::Position;

/// The word for how robot and goal stand to each other.
pub(crate) fn standing(standing: Standing) -> &'static str {
    match standing {
        Standing::Unasked => "unasked",
        Standing::InNests => "in_nests",
        Standing::Outside => "outside_nests",
        Standing::Unknown => "unknown",
        Standing::CutOff => "cut_off",
    }
}

fn place(fields: &Bound<PyDict>, at: Position) -> PyResult<()> {
    fields.set_item("x_m", at.x_m)?;
    fields.set_item("y_m", at.y_m)
}

fn recovery_fields(fields: &Bound<PyDict>, recovery: Recovery) -> PyResult<()> {
    match recovery {
        Recovery::TurnInPlace { left_rad } => {
            fields.set_item("recovery", "turn_in_place")?;
            fields.set_item("left_rad", left_rad)?;
        }
        Recovery::BackOff { left_m } => {
            fields.set_item("recovery", "back_off")?;
            fields.set_item("left_m", left_m)?;
        }
        Recovery::Thread => fields.set_item("recovery", "thread")?,
        Recovery::FollowWall { from, on_left } => {
            fields.set_item("recovery", "follow_wall")?;
            fields.set_item("on_left", on_left)?;
            place(fields, from)?;
        }
        Recovery::Forget => fields.set_item("recovery", "forget")?,
        Recovery::Retreat { to } => {
            fields.set_item("recovery", "retreat")?;
            place(fields, to)?;
        }
    }
    Ok(())
}

/// The fields of an event, without its kind and time.
pub(crate) fn event_fields<'py>(py: Python<'py>, event: &Event) -> PyResult<Bound<'py, PyDict>> {
    let fields = PyDict::new(py);
    match event {
        Event::Status { status, reason } => {
            fields.set_item("status", status.name())?;
            fields.set_item("reason", reason.name())?;
            fields.set_item("text", reason.text())?;
        }
        Event::Navigability {
            grids,
            navigable,
            disagreement,
        } => {
            fields.set_item("grids", grids)?;
            fields.set_item("navigable", navigable)?;
            fields.set_item("disagreement", disagreement)?;
        }
        Event::ScanRefused { reason } | Event::Trap { reason } => fields.set_item("reason", reason.name())?,
        Event::PoseJump { distance_m, turn_rad } => {
            fields.set_item("distance_m", distance_m)?;
            fields.set_item("turn_rad", turn_rad)?;
        }
        Event::Route { length_m, afresh } => {
            fields.set_item("length_m", length_m)?;
            fields.set_item("afresh", afresh)?;
        }
        Event::LocalClosed | Event::ReadingRefused => {}
        Event::Recovery { recovery, attempt } => {
            fields.set_item("attempt", attempt)?;
            recovery_fields(&fields, *recovery)?;
        }
        Event::Stamped { at } => place(&fields, *at)?,
        Event::WindowGrown { cells } => fields.set_item("cells", cells)?,
        Event::Slip { share } => fields.set_item("share", share)?,
        Event::ReadingTaken {
            at,
            class,
            probabilities,
            cone_index_kpa,
            cells_changed,
        } => {
            place(&fields, *at)?;
            fields.set_item("soil_class", class.name())?;
            let shares = PyDict::new(py);
            for (class, share) in CLASSES.iter().zip(probabilities) {
                shares.set_item(class.name(), share)?;
            }
            fields.set_item("probabilities", shares)?;
            fields.set_item("cone_index_kpa", cone_index_kpa)?;
            fields.set_item("cells_changed", cells_changed)?;
        }
        Event::SoilUpdate {
            source,
            told_s,
            class,
            cells_changed,
        } => {
            fields.set_item("source", source)?;
            fields.set_item("told_s", told_s)?;
            fields.set_item("soil_class", class.name())?;
            fields.set_item("cells_changed", cells_changed)?;
        }
        Event::NestsChanged {
            cells_gained,
            cells_lost,
            nests,
        } => {
            fields.set_item("cells_gained", cells_gained)?;
            fields.set_item("cells_lost", cells_lost)?;
            fields.set_item("nests", nests)?;
        }
        Event::RouteRepaired {
            cost_before,
            cost_after,
            cells,
            standing,
            afresh,
        } => {
            fields.set_item("cost_before_s", cost_before)?;
            fields.set_item("cost_after_s", cost_after)?;
            fields.set_item("cells", cells)?;
            fields.set_item("standing", self::standing(*standing))?;
            fields.set_item("afresh", afresh)?;
        }
        Event::ProbeWanted { at, expected_saving_s } => {
            place(&fields, *at)?;
            fields.set_item("expected_saving_s", expected_saving_s)?;
        }
        Event::ProbeMissed { waited_s } => fields.set_item("waited_s", waited_s)?,
    }
    Ok(fields)
}
