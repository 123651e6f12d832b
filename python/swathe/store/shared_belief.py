"""What all vehicles together have measured: a soil belief made of every reading that counts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from swathe.belief import SoilBelief
from swathe.grid import Position, Window
from swathe.store.interface import require_window
from swathe.store.soil import soil_units

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swathe.belief import BeliefParams, ClassReading, PenetrometerReading
    from swathe.io.crs import Frame
    from swathe.store.interface import RegionInfo, StoredReading, TerrainStore
    from swathe.vehicle import Vehicle


def belief(
    store: TerrainStore,
    region: str,
    vehicle: Vehicle | str,
    *,
    window: Window | None = None,
    moisture_percent: float = 20.0,
    soil_table: Literal["text", "table2"] = "text",
    params: BeliefParams | None = None,
    until: int | None = None,
) -> SoilBelief:
    """Return the belief of a window; see ``TerrainStore.belief``."""
    info = store.region(region)
    window = Window(0, 0, *info.frame.geometry.shape) if window is None else Window(*window)
    require_window(info.frame.geometry, window)
    readings = store.readings(region, until=until)
    return belief_of_frame(
        store,
        info,
        info.frame.window(window),
        readings,
        vehicle,
        moisture_percent=moisture_percent,
        soil_table=soil_table,
        params=params,
    )


def belief_of_frame(
    store: TerrainStore,
    info: RegionInfo,
    frame: Frame,
    readings: Sequence[StoredReading],
    vehicle: Vehicle | str,
    **judged: Any,  # noqa: ANN401 - how soil is judged, by the names of SoilBelief
) -> SoilBelief:
    """Return the belief of a frame inside the region by the readings inside it."""
    layer, units = soil_units(store, info, frame)
    found = SoilBelief(frame.geometry, layer, units, vehicle, **judged)
    for reading in in_order(readings, frame):
        found.add(reading)
    return found


def in_order(readings: Sequence[StoredReading], frame: Frame) -> tuple[PenetrometerReading | ClassReading, ...]:
    """Return the readings inside a frame.

    Sums of the same numbers in another order differ in the last digit, so the order is not that of filing.
    """
    inside = [
        stored.reading
        for stored in sorted(readings, key=_order)
        if frame.geometry.cell_at(Position(stored.reading.x_m, stored.reading.y_m)) is not None
    ]
    return tuple(inside)


def _order(stored: StoredReading) -> tuple[float, float, str, str]:
    return (stored.reading.x_m, stored.reading.y_m, stored.time, stored.id)
