"""Coordinate reference systems: the one place where degrees become metres and back.

Everything behind ``io`` works in a projected, north-up frame of metres. ``Frame`` ties such a frame to the world.
Projections never use the network: datum shifts that need a downloaded grid fall back to the best that is installed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import TYPE_CHECKING, cast

import numpy as np
import pyproj
from pyproj.crs import CRS, ProjectedCRS
from pyproj.crs.coordinate_operation import PolarStereographicAConversion, TransverseMercatorConversion
from pyproj.exceptions import ProjError
from pyproj.network import set_network_enabled  # type: ignore[attr-defined]  # documented, but not in its __all__

from swathe.errors import InvalidCrsError, UsageError
from swathe.grid import GridGeometry, Position, Window

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

set_network_enabled(active=False)

WGS84 = "EPSG:4326"
# Every ellipsoid and sphere in use for the Earth lies in here; Venus (6,052 km) and Mars (3,396 km) do not.
EARTH_SEMI_MAJOR_M = (6_300_000.0, 6_400_000.0)
# UTM is defined from 80 degrees south to 84 degrees north; beyond it the polar stereographic twins take over.
UTM_SOUTH_DEG, UTM_NORTH_DEG = -80.0, 84.0
UPS_NORTH, UPS_SOUTH = "EPSG:5041", "EPSG:5042"


@dataclass(frozen=True, slots=True)
class Frame:
    """A map frame: the cells in metres, and the coordinate reference system that those metres belong to.

    ``crs_wkt`` is None for a local metric frame (a height map without a place in the world): there the origin is the
    south-west corner of the raster, x goes east and y north. ``file_origin`` and ``file_unit_m`` say which coordinates
    the file itself had written down for that corner and how many metres one of its units is, so that a soil map without
    a coordinate reference system can be laid over it; they mean nothing when ``crs_wkt`` is set.
    """

    geometry: GridGeometry
    crs_wkt: str | None = None
    file_origin: tuple[float, float] = (0.0, 0.0)
    file_unit_m: float = 1.0

    @property
    def name(self) -> str:
        """What people call the frame: ``WGS 84 / UTM zone 16N``, or ``local metric frame``."""
        return "local metric frame" if self.crs_wkt is None else crs_name(crs_from_wkt(self.crs_wkt))

    @property
    def is_earth(self) -> bool:
        """False only when the coordinate reference system belongs to another body (the Moon, Mars)."""
        return self.crs_wkt is None or is_earth(crs_from_wkt(self.crs_wkt))

    @property
    def has_lonlat(self) -> bool:
        """True when positions have a longitude and latitude on the Earth."""
        return self.crs_wkt is not None and self.is_earth

    def to_lonlat(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return WGS 84 longitude and latitude (degrees, arrays of the shape given) of map positions in metres.

        Raises UsageError when the frame has none (local frame, another body).
        """
        transformer = self._lonlat_transformer(inverse=True)
        lon, lat = transformer.transform(np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64))
        return np.asarray(lon), np.asarray(lat)

    def from_lonlat(self, lon: ArrayLike, lat: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return map x and y (metres, arrays of the shape given) of WGS 84 longitude and latitude in degrees.

        Raises UsageError when the frame has no longitude and latitude.
        """
        transformer = self._lonlat_transformer(inverse=False)
        x_m, y_m = transformer.transform(np.asarray(lon, dtype=np.float64), np.asarray(lat, dtype=np.float64))
        return np.asarray(x_m), np.asarray(y_m)

    def from_points(self, x: float, y: float, points_crs: str | None, source_crs_wkt: str | None) -> Position:
        """Return the map position of one point that a user gave.

        ``points_crs`` None means WGS 84 longitude,latitude; ``native`` the elevation's own system ``source_crs_wkt``
        (metres from the south-west corner in a local frame); anything else is a system's name such as ``EPSG:31467``.
        Values are always x,y = easting,northing, whatever axis order the system declares. Raises UsageError when the
        point cannot be placed and InvalidCrsError when the system is unknown.
        """
        if not (math.isfinite(x) and math.isfinite(y)):
            raise UsageError(f"The point {x:g},{y:g} is not finite.", "Give two numbers.")
        if points_crs is None:
            points = crs_from_wkt(WGS84)
            self._lonlat_transformer(inverse=False)  # for its refusal
            if not (-90 <= y <= 90 and -360 <= x <= 360):
                raise UsageError(
                    f"The point {x:g},{y:g} is no longitude,latitude.",
                    "Give longitude first, then latitude, in degrees, or name the system with `--points-crs`.",
                )
        elif points_crs.strip().lower() == "native":
            if self.crs_wkt is None or source_crs_wkt is None:
                return Position(float(x), float(y))
            points = crs_from_wkt(source_crs_wkt)
        elif self.crs_wkt is None:
            raise UsageError(
                f"The map is a {self.name}, where points in {points_crs} have no place.",
                "Use `--points-crs native` and give metres east and north of the map's south-west corner.",
            )
        else:
            points = parse_crs(points_crs)
        x_m, y_m = transformer_between(points.to_wkt(), cast("str", self.crs_wkt)).transform(x, y)
        if not (math.isfinite(x_m) and math.isfinite(y_m)):
            raise UsageError(
                f"The point {x:g},{y:g} cannot be placed in {self.name}.",
                "Check the order (x,y or longitude,latitude) and `--points-crs`.",
            )
        return Position(float(x_m), float(y_m))

    def window(self, window: Window) -> Frame:
        """Return the frame of a block of cells, on the same lattice."""
        return replace(self, geometry=self.geometry.window(*window))

    def _lonlat_transformer(self, *, inverse: bool) -> pyproj.Transformer:
        if self.crs_wkt is None or not self.is_earth:
            raise UsageError(
                f"The map ({self.name}) has no longitude and latitude on the Earth.",
                "Use `--points-crs native` and give x,y in the map's own coordinates.",
            )
        wgs84 = crs_from_wkt(WGS84).to_wkt()
        return transformer_between(*((self.crs_wkt, wgs84) if inverse else (wgs84, self.crs_wkt)))


def parse_crs(text: str) -> CRS:
    """Return the system that ``text`` names (``EPSG:32616``, ``IAU_2015:30100``, WKT or a PROJ string).

    Raises InvalidCrsError when there is none of that name.
    """
    try:
        return CRS.from_user_input(text.strip())
    except ProjError as error:
        shown = text if len(text) <= 60 else text[:57] + "..."
        raise InvalidCrsError(
            f"The coordinate reference system {shown!r} is not known.", "Name one such as EPSG:32616."
        ) from error


def parse_target_crs(text: str) -> CRS:
    """Return the projection that ``text`` names as the frame of a map; it must be in metres.

    Raises InvalidCrsError for anything else.
    """
    crs = horizontal(parse_crs(text))
    if metres_per_unit(crs) != 1.0:
        raise InvalidCrsError(
            f"{crs_name(crs)} is not a projection in metres.", "Name one that is, such as the region's UTM zone."
        )
    return crs


def utm_crs_for(lon: float, lat: float) -> str:
    """Return the name (``EPSG:n``) of the WGS 84 UTM zone at a longitude and latitude, or of UPS near the poles.

    The exceptions of the zone lattice around Norway and Svalbard are left out: they are a map sheet custom.
    """
    if lat >= UTM_NORTH_DEG:
        return UPS_NORTH
    if lat < UTM_SOUTH_DEG:
        return UPS_SOUTH
    zone = math.floor(((lon + 180.0) % 360.0) / 6.0) + 1
    return f"EPSG:{(32600 if lat >= 0 else 32700) + min(zone, 60)}"


def local_projection(geographic: CRS, lon: float, lat: float) -> CRS:
    """Return a projection in metres around a point, on the ellipsoid of ``geographic``: for bodies without UTM."""
    place = f"{crs_name(geographic)} / {'{}'} at {lon:.3f}, {lat:.3f}"
    if UTM_SOUTH_DEG <= lat < UTM_NORTH_DEG:
        conversion = TransverseMercatorConversion(
            latitude_natural_origin=lat, longitude_natural_origin=lon, scale_factor_natural_origin=1.0
        )
        return ProjectedCRS(conversion, name=place.format("Transverse Mercator"), geodetic_crs=geographic)
    pole = PolarStereographicAConversion(latitude_natural_origin=math.copysign(90.0, lat), longitude_natural_origin=0.0)
    return ProjectedCRS(pole, name=place.format("Polar Stereographic"), geodetic_crs=geographic)


@lru_cache(maxsize=64)
def crs_from_wkt(wkt: str) -> CRS:
    """Return the system that a WKT text (or a name) holds; kept, because parsing is slow."""
    return parse_crs(wkt)


@cache
def transformer_between(from_wkt: str, to_wkt: str) -> pyproj.Transformer:
    """Return the transformer from one system to another, x before y. Raises InvalidCrsError when there is none."""
    try:
        return pyproj.Transformer.from_crs(crs_from_wkt(from_wkt), crs_from_wkt(to_wkt), always_xy=True)
    except ProjError as error:
        names = f"{crs_name(crs_from_wkt(from_wkt))} to {crs_name(crs_from_wkt(to_wkt))}"
        raise InvalidCrsError(
            f"There is no way from {names}.", "Use coordinate reference systems of the same body."
        ) from error


def horizontal(crs: CRS) -> CRS:
    """Return the part of a system that lies in the plane, without heights."""
    return horizontal(crs.sub_crs_list[0]) if crs.is_compound else crs.to_2d()


def height_unit_m(crs: CRS) -> float | None:
    """Return the metres of one unit of the system's height axis (negative for depths), or None without one."""
    if crs.is_compound:
        return next((unit for unit in map(height_unit_m, crs.sub_crs_list) if unit is not None), None)
    for axis in crs.axis_info:
        if axis.direction in ("up", "down"):
            return axis.unit_conversion_factor * (1.0 if axis.direction == "up" else -1.0)
    return None


def metres_per_unit(crs: CRS) -> float | None:
    """Return the metres of one unit of a projected system, or None for one that is not projected (degrees)."""
    return crs.axis_info[0].unit_conversion_factor if crs.is_projected else None


def is_earth(crs: CRS) -> bool:
    """Return whether a system belongs to the Earth, judged by its ellipsoid."""
    low, high = EARTH_SEMI_MAJOR_M
    return crs.ellipsoid is None or low <= crs.ellipsoid.semi_major_metre <= high


def crs_name(crs: CRS) -> str:
    """Return the name of a system as people know it."""
    if crs.name.strip().lower() not in ("", "unknown", "unnamed", "undefined"):
        return crs.name
    number = crs.to_epsg()  # old formats have the figures of a system without its name
    return "a projection without a name" if number is None else CRS.from_epsg(number).name


def same_crs(first_wkt: str | None, second_wkt: str | None) -> bool:
    """Return whether two systems give the same coordinates to the same place."""
    if first_wkt is None or second_wkt is None or first_wkt == second_wkt:
        return first_wkt == second_wkt
    return crs_from_wkt(first_wkt).equals(crs_from_wkt(second_wkt), ignore_axis_order=True)


def registered_name(wkt: str) -> tuple[str, str, int] | None:
    """Return name, authority and code of a system that an authority has registered, or None."""
    crs = crs_from_wkt(wkt)
    found = crs.to_authority(min_confidence=100)
    return (crs_name(crs), found[0], int(found[1])) if found is not None and found[1].isdigit() else None


def old_wkt(wkt: str) -> str | None:
    """Return a system as WKT 1, which GeoPackages hold, or None when that cannot say it."""
    try:
        return crs_from_wkt(wkt).to_wkt("WKT1_GDAL")
    except ProjError:
        return None
