"""From the places of the world to the metres of the map and back."""

from __future__ import annotations

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj.network import is_network_enabled  # type: ignore[attr-defined]  # documented, not in its __all__

from swathe.errors import InvalidCrsError, UsageError
from swathe.grid import GridGeometry, Position, Window
from swathe.io.crs import Frame, parse_crs, parse_target_crs, utm_crs_for

GEOMETRY = GridGeometry(100, 100, 10.0, 740_000.0, 4_050_000.0)
UTM16 = Frame(GEOMETRY, pyproj.CRS("EPSG:32616").to_wkt())
LOCAL = Frame(GridGeometry(100, 100, 10.0, 0.0, 1000.0))
MOON = Frame(GEOMETRY, pyproj.CRS("IAU_2015:30110").to_wkt())
WGS84_WKT = pyproj.CRS("EPSG:4326").to_wkt()


def test_a_known_place_lands_where_surveyors_say() -> None:
    # The intersection of the zone's middle meridian and the 36th parallel.
    x_m, y_m = UTM16.from_lonlat(-87.0, 36.0)
    assert float(x_m) == pytest.approx(500_000, abs=0.001)
    assert float(y_m) == pytest.approx(3_983_948.453, abs=0.001)


@given(st.floats(-90, -84), st.floats(0, 80))
def test_there_and_back_is_the_same_place(lon: float, lat: float) -> None:
    back_lon, back_lat = UTM16.to_lonlat(*UTM16.from_lonlat(lon, lat))
    assert float(back_lon) == pytest.approx(lon, abs=1e-8)
    assert float(back_lat) == pytest.approx(lat, abs=1e-8)


def test_arrays_keep_their_shape() -> None:
    lon, lat = UTM16.to_lonlat(np.full((2, 3), 740_000.0), np.full((2, 3), 4_050_000.0))
    assert lon.shape == lat.shape == (2, 3)


@pytest.mark.parametrize(
    ("lon", "lat", "name"),
    [
        (-84.2, 36.6, "EPSG:32616"),
        (10.2, 51.5, "EPSG:32632"),
        (18.4, -34.0, "EPSG:32734"),
        (180.0, 0.0, "EPSG:32601"),
        (-180.0, -0.1, "EPSG:32701"),
        (179.999, 10.0, "EPSG:32660"),
        (275.8, 36.6, "EPSG:32616"),
        (0.0, 84.0, "EPSG:5041"),
        (0.0, 83.9, "EPSG:32631"),
        (0.0, -80.0, "EPSG:32731"),
        (0.0, -80.1, "EPSG:5042"),
    ],
)
def test_every_place_has_its_zone(lon: float, lat: float, name: str) -> None:
    assert utm_crs_for(lon, lat) == name


def test_frames_say_what_they_are() -> None:
    assert (UTM16.name, UTM16.is_earth, UTM16.has_lonlat) == ("WGS 84 / UTM zone 16N", True, True)
    assert (LOCAL.name, LOCAL.is_earth, LOCAL.has_lonlat) == ("local metric frame", True, False)
    assert "Moon" in MOON.name
    assert (MOON.is_earth, MOON.has_lonlat) == (False, False)


def test_points_are_longitude_latitude_unless_said_otherwise() -> None:
    x_m, y_m = UTM16.from_lonlat(-84.2, 36.6)
    expected = pytest.approx((float(x_m), float(y_m)), abs=1e-6)
    assert UTM16.from_points(-84.2, 36.6, None, None) == expected
    assert UTM16.from_points(-84.2, 36.6, "EPSG:4326", None) == expected  # x first, although the system says latitude
    assert UTM16.from_points(-84.2, 36.6, "native", WGS84_WKT) == expected
    assert UTM16.from_points(*expected.expected, "native", UTM16.crs_wkt) == expected
    assert isinstance(UTM16.from_points(-84.2, 36.6, None, None), Position)


def test_native_points_of_a_local_frame_are_metres_from_the_south_west() -> None:
    assert LOCAL.from_points(12.5, 30.0, "native", None) == Position(12.5, 30.0)


@pytest.mark.parametrize("frame", [LOCAL, MOON])
def test_a_frame_without_longitudes_names_the_option_to_use(frame: Frame) -> None:
    with pytest.raises(UsageError, match="--points-crs native"):
        frame.from_points(-84.2, 36.6, None, None)
    with pytest.raises(UsageError, match="--points-crs native"):
        frame.to_lonlat(0.0, 0.0)
    with pytest.raises(UsageError, match="--points-crs native"):
        frame.from_lonlat(0.0, 0.0)


def test_points_that_cannot_be_are_refused() -> None:
    with pytest.raises(UsageError, match="longitude first"):
        UTM16.from_points(36.6, -184.2, None, None)
    with pytest.raises(UsageError, match="finite"):
        UTM16.from_points(float("nan"), 36.6, None, None)
    with pytest.raises(UsageError, match="local metric frame"):
        LOCAL.from_points(1.0, 2.0, "EPSG:32616", None)
    with pytest.raises(InvalidCrsError, match="EPSG:0"):
        UTM16.from_points(1.0, 2.0, "EPSG:0", None)
    with pytest.raises(InvalidCrsError, match="same body"):
        MOON.from_points(1.0, 2.0, "EPSG:4326", None)


@pytest.mark.parametrize("text", ["", "EPSG:999999", "mercator please", "PROJCS[", "EPSG:"])
def test_an_unknown_system_is_refused(text: str) -> None:
    with pytest.raises(InvalidCrsError, match="EPSG:32616"):
        parse_crs(text)


@pytest.mark.parametrize("text", ["EPSG:4326", "EPSG:2264"])
def test_a_frame_is_in_metres(text: str) -> None:
    with pytest.raises(InvalidCrsError, match="metres"):
        parse_target_crs(text)


def test_a_window_stays_on_the_lattice() -> None:
    part = UTM16.window(Window(10, 20, 5, 6))
    assert part.geometry == GridGeometry(5, 6, 10.0, 740_200.0, 4_049_900.0)
    assert part.crs_wkt == UTM16.crs_wkt


def test_projections_never_use_the_network() -> None:
    assert not is_network_enabled()
