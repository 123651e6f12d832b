"""Places as the summary tells them: longitude and latitude where the map has them, and metres of the map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swathe.grid import Position
    from swathe.io.crs import Frame


def end_of_route(
    asked: tuple[float, float], place: Position, moved: tuple[Position, float] | None, frame: Frame
) -> dict[str, Any]:
    """Return a start or goal: what was asked for, where the route really ends, and how far that was moved."""
    at, snapped_m = (place, 0.0) if moved is None else moved
    lon, lat = _lonlat(at, frame)
    return {
        "asked": list(asked),
        "lon": lon,
        "lat": lat,
        "x_m": round(at.x_m, 3),
        "y_m": round(at.y_m, 3),
        "snapped_m": round(snapped_m, 3),
    }


def in_words(place: Position | None, frame: Frame) -> str | None:
    """Return a place as text that can be given back as ``--start``, or in metres where there are no degrees."""
    if place is None:
        return None
    lon, lat = _lonlat(place, frame)
    if lon is None or lat is None:
        return f"x {place.x_m:.1f} m, y {place.y_m:.1f} m"
    return f"{lon:.6f},{lat:.6f} (longitude,latitude)"


def _lonlat(place: Position, frame: Frame) -> tuple[float | None, float | None]:
    if not frame.has_lonlat:
        return None, None
    lon, lat = frame.to_lonlat(place.x_m, place.y_m)
    return round(float(lon), 8), round(float(lat), 8)
