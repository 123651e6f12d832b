"""Choosing the frame that elevations are brought into: their own when that is metric, square and north-up, or UTM."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pyproj

from swathe.errors import InvalidCrsError, TooSmallError
from swathe.grid import GridGeometry
from swathe.io.crs import (
    UTM_NORTH_DEG,
    UTM_SOUTH_DEG,
    Frame,
    crs_from_wkt,
    crs_name,
    is_earth,
    local_projection,
    metres_per_unit,
    parse_crs,
    parse_target_crs,
    same_crs,
    transformer_between,
    utm_crs_for,
)
from swathe.io.mosaic import Mosaic, is_rotated
from swathe.io.warp import Bounds, bounds_in

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pyproj.crs import CRS

SQUARE_TOLERANCE = 1e-6
# A projection whose metres differ by more than this from metres on the ground (web Mercator away from the equator)
# would give wrong slopes: it is warped like degrees are.
SCALE_TOLERANCE = 0.05
# A UTM zone is 6 degrees wide; two neighbours on either side still have less than 2 % error.
UTM_WIDTH_LIMIT_DEG = 30.0
FEWEST_CELLS = 3
# A share of a cell that rounding may add to an extent without adding a cell.
EDGE_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class Target:
    """The frame to read into, whether that takes resampling, and the mean ground cell of the finest source."""

    frame: Frame
    warped: bool
    native_cell_size_m: float


def choose_target(
    mosaics: Sequence[Mosaic],
    names: str,
    *,
    cell_size_m: float | None,
    crs: str | None,
    default_cell_size_m: float | None,
) -> Target:
    """Return where to read placed mosaics into.

    Raises InvalidCrsError when no projection in metres fits and TooSmallError when less than 3 x 3 cells are left.
    """
    first = mosaics[0]
    native_m = min(ground_cell_size_m(mosaic) for mosaic in mosaics)
    wanted_wkt = None if crs is None else parse_target_crs(crs).to_wkt()
    own = len({mosaic.crs_wkt for mosaic in mosaics}) == 1 and is_metric(first, chosen=wanted_wkt is not None)
    if own and (wanted_wkt is None or same_crs(first.crs_wkt, wanted_wkt)):
        target = _in_own_system(mosaics, native_m, cell_size_m)
    else:
        wkt = wanted_wkt or _default_crs(mosaics, names).to_wkt()
        cell_m = cell_size_m or default_cell_size_m or neat_cell_size_m(native_m, first)
        target = Target(Frame(_snapped(mosaics, wkt, cell_m, names), wkt), warped=True, native_cell_size_m=native_m)
    require_size(target.frame.geometry, names)
    return target


def require_size(geometry: GridGeometry, names: str) -> None:
    """Raise TooSmallError when a grid has too few rows or columns to have a gradient."""
    if min(geometry.shape) < FEWEST_CELLS:
        raise TooSmallError(
            f"{names} covers {geometry.rows} x {geometry.columns} cells of {geometry.cell_size_m:g} m.",
            f"At least {FEWEST_CELLS} x {FEWEST_CELLS} are needed: use a larger map or a smaller `--cell-size`.",
        )


def is_metric(mosaic: Mosaic, *, chosen: bool = False) -> bool:
    """Return whether a mosaic's coordinates are metres on the ground (``chosen``: the user says that they are)."""
    crs = crs_from_wkt(str(mosaic.crs_wkt))
    if metres_per_unit(crs) != 1.0:
        return False
    if chosen:
        return True
    along, across = _scales(mosaic, crs)
    return abs(along - 1) <= SCALE_TOLERANCE and abs(across - 1) <= SCALE_TOLERANCE


def ground_cell_size_m(mosaic: Mosaic) -> float:
    """Return the side in metres of a square as large on the ground as a cell at the middle of a mosaic."""
    crs = crs_from_wkt(str(mosaic.crs_wkt))
    area = abs(mosaic.transform.a * mosaic.transform.e - mosaic.transform.b * mosaic.transform.d)
    unit_m = metres_per_unit(crs)
    if unit_m is not None:
        if is_metric(mosaic):
            return math.sqrt(area)
        along, across = _scales(mosaic, crs)
        return math.sqrt(area / (along * across)) * unit_m
    _, lat = _middle(mosaic)
    geod = crs.get_geod() or pyproj.Geod(ellps="WGS84")
    half_deg = 0.005
    _, _, north_m = geod.inv(0, max(lat - half_deg, -90), 0, min(lat + half_deg, 90))
    _, _, east_m = geod.inv(-half_deg, lat, half_deg, lat)
    # At a pole a degree of longitude has no length; a hundredth keeps the cell a cell.
    return math.sqrt(area * north_m * max(east_m, north_m / 100)) / (2 * half_deg)


def neat_cell_size_m(native_m: float, mosaic: Mosaic) -> float:
    """Return a cell size that people can say: degrees have no exact size, so theirs is rounded more."""
    scale = 10.0 ** math.floor(math.log10(native_m))
    if metres_per_unit(crs_from_wkt(str(mosaic.crs_wkt))) is not None:
        return float(f"{native_m:.3g}")
    step = scale / 2 if native_m >= 5 * scale else scale / 10
    return float(f"{round(native_m / step) * step:.3g}")


def _scales(mosaic: Mosaic, crs: CRS) -> tuple[float, float]:
    """Return the projected metres per metre on the ground, along the meridian and across, at the middle."""
    projection = pyproj.Proj(crs)
    lon, lat = projection(*_middle(mosaic), inverse=True)
    if not (math.isfinite(lon) and math.isfinite(lat)):
        return (1.0, 1.0)
    factors = projection.get_factors(lon, lat)
    scales = (float(factors.meridional_scale), float(factors.parallel_scale))
    return scales if all(math.isfinite(scale) and scale > 0 for scale in scales) else (1.0, 1.0)


def _middle(mosaic: Mosaic) -> tuple[float, float]:
    x, y = mosaic.transform @ (mosaic.columns / 2, mosaic.rows / 2)
    return (float(x), float(y))


def _default_crs(mosaics: Sequence[Mosaic], names: str) -> CRS:
    """Return the projection for data that has none of its own in metres."""
    crs = crs_from_wkt(str(mosaics[0].crs_wkt))
    geographic = crs.geodetic_crs
    if geographic is None:
        raise InvalidCrsError(f"{crs_name(crs)} of {names} has no place on a body.", "Name its system with `--crs`.")
    earth = is_earth(crs)
    boxes = [bounds_in(mosaic, "EPSG:4326" if earth else geographic.to_wkt()) for mosaic in mosaics]
    known = [box for box in boxes if box is not None]
    if not known:
        raise InvalidCrsError(
            f"The coordinates of {names} lie outside its system {crs_name(crs)}.", "Name its right system with `--crs`."
        )
    box = known[0]
    for other in known[1:]:
        box = box.united(other)
    lat = (box.south + box.north) / 2
    near_pole = not UTM_SOUTH_DEG <= lat < UTM_NORTH_DEG
    if box.east - box.west > UTM_WIDTH_LIMIT_DEG and not near_pole:
        # Data over the date line has longitudes on both sides of it: its own middle says where it is.
        box = _over_date_line(mosaics, box)
        if box.east - box.west > UTM_WIDTH_LIMIT_DEG:
            raise InvalidCrsError(
                f"{names} spans {box.east - box.west:.0f} degrees of longitude, too wide for one UTM zone.",
                "Cut out the region, or name a projection in metres with `--crs`.",
            )
    lon = (box.west + box.east) / 2
    return parse_crs(utm_crs_for(lon, lat)) if earth else local_projection(geographic, lon, lat)


def _over_date_line(mosaics: Sequence[Mosaic], box: Bounds) -> Bounds:
    """Return the box with western longitudes counted on beyond 180 degrees, when that is narrower."""
    west, east = math.inf, -math.inf
    for mosaic in mosaics:
        own = crs_from_wkt(str(mosaic.crs_wkt))
        if own.is_geographic:
            spans = [(mosaic.transform.c, mosaic.transform.c + mosaic.transform.a * mosaic.columns)]
        else:
            transformer = transformer_between(own.to_wkt(), "EPSG:4326")
            corners = [mosaic.transform @ (c, r) for c in (0, mosaic.columns) for r in (0, mosaic.rows)]
            longitudes = [float(transformer.transform(x, y)[0]) % 360 for x, y in corners]
            spans = [(min(longitudes), max(longitudes))]
        for low, high in spans:
            turn = 360.0 * math.floor(low / 360.0)
            west, east = min(west, low - turn), max(east, high - turn)
    return Bounds(west, box.south, east, box.north) if east - west < box.east - box.west else box


def _in_own_system(mosaics: Sequence[Mosaic], native_m: float, cell_size_m: float | None) -> Target:
    """Return the target that keeps the source's system: its very lattice when nothing else is asked for."""
    first = mosaics[0]
    place = first.transform
    across, along = abs(place.a), abs(place.e)
    square = not is_rotated(place) and abs(across - along) <= SQUARE_TOLERANCE * across
    if not square:
        cell_m = cell_size_m or neat_cell_size_m(native_m, first)
        geometry = _snapped(mosaics, str(first.crs_wkt), cell_m, "")
        return Target(Frame(geometry, first.crs_wkt), warped=True, native_cell_size_m=native_m)
    # A coarser lattice begins at the source's own corner, so that whole groups of cells are averaged.
    cell_m = cell_size_m or across
    warped = len(mosaics) > 1 or abs(cell_m - across) > SQUARE_TOLERANCE * across
    box = bounds_in(first, str(first.crs_wkt))
    for mosaic in mosaics[1:]:
        other = bounds_in(mosaic, str(first.crs_wkt))
        box = box.united(other) if box is not None and other is not None else box
    if box is None:  # coordinates are always finite here
        raise InvalidCrsError("The coordinates are not finite.", "Check the file.")
    if not warped:
        geometry = GridGeometry(first.rows, first.columns, across, place.c, place.f)
    else:
        west = place.c - math.ceil((place.c - box.west) / cell_m - EDGE_TOLERANCE) * cell_m
        north = place.f + math.ceil((box.north - place.f) / cell_m - EDGE_TOLERANCE) * cell_m
        geometry = GridGeometry(
            max(math.ceil((north - box.south) / cell_m - EDGE_TOLERANCE), 1),
            max(math.ceil((box.east - west) / cell_m - EDGE_TOLERANCE), 1),
            cell_m, west, north,
        )  # fmt: skip
    return Target(Frame(geometry, first.crs_wkt), warped=warped, native_cell_size_m=native_m)


def _snapped(mosaics: Sequence[Mosaic], wkt: str, cell_m: float, names: str) -> GridGeometry:
    """Return the grid around all mosaics whose lines lie on multiples of the cell size."""
    boxes = [box for box in (bounds_in(mosaic, wkt) for mosaic in mosaics) if box is not None]
    if not boxes:
        raise InvalidCrsError(f"{names} cannot be shown in {crs_name(crs_from_wkt(wkt))}.", "Name another `--crs`.")
    box = boxes[0]
    for other in boxes[1:]:
        box = box.united(other)
    west = math.floor(box.west / cell_m + EDGE_TOLERANCE)
    east = math.ceil(box.east / cell_m - EDGE_TOLERANCE)
    south = math.floor(box.south / cell_m + EDGE_TOLERANCE)
    north = math.ceil(box.north / cell_m - EDGE_TOLERANCE)
    return GridGeometry(max(north - south, 1), max(east - west, 1), cell_m, west * cell_m, north * cell_m)
