"""Laying heights onto another lattice: degrees, feet, rotation, other cells, other bodies, and servers."""

from __future__ import annotations

import contextlib
import functools
import http.server
import math
import re
import threading
from typing import TYPE_CHECKING, Any

import numpy as np
import pyproj
import pytest
from affine import Affine
from rasterio.crs import CRS

from raster_files import CELL, NORTH, UTM16, WEST, hills, write
from swathe.errors import InvalidCrsError, MissingFileError, UnreadableFileError
from swathe.grid import Cell, Window
from swathe.io.elevation import ElevationSource, open_elevation

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray


def plane_error_m(source: ElevationSource, east_rise: float, north_rise: float, at: Affine, crs: str) -> float:
    """Return the worst difference, on inner cells, from a plane that rises along the file's own columns and rows."""
    heights = source.read()
    geometry = source.frame.geometry
    known = np.argwhere(~np.isnan(heights))
    x = geometry.west_m + (known[:, 1] + 0.5) * geometry.cell_size_m
    y = geometry.north_m - (known[:, 0] + 0.5) * geometry.cell_size_m
    way = pyproj.Transformer.from_crs(str(source.frame.crs_wkt), crs, always_xy=True)
    file_x, file_y = way.transform(x, y)
    if crs == "EPSG:4326":  # the file may count its longitudes beyond 180
        file_x = file_x + 360 * np.round((at.c - file_x) / 360)
    column, row = ~at @ (np.asarray(file_x), np.asarray(file_y))
    inner = (column > 1) & (column < 198) & (row > 1) & (row < 198)
    assert inner.mean() > 0.5
    expected = 100 + east_rise * column + north_rise * row
    found = heights[known[:, 0], known[:, 1]]
    return float(np.abs(found - expected)[inner].max())


def plane(east_rise: float, north_rise: float) -> NDArray[np.float32]:
    row, column = np.mgrid[0:200, 0:200] + 0.5
    return np.asarray(100 + east_rise * column + north_rise * row, dtype=np.float32)


@pytest.mark.parametrize(
    ("at", "crs", "name", "cell_m"),
    [
        (Affine(1 / 1200, 0, -84.4, 0, -1 / 1200, 36.7), "EPSG:4326", "WGS 84 / UTM zone 16N", 85),
        (Affine(1 / 1200, 0, 275.6, 0, -1 / 1200, 36.7), "EPSG:4326", "WGS 84 / UTM zone 16N", 85),
        (Affine(1 / 1200, 0, 18.4, 0, -1 / 1200, -34.0), "EPSG:4326", "WGS 84 / UTM zone 34S", 85),
        (Affine(1 / 1200, 0, 179.9, 0, -1 / 1200, -16.5), "EPSG:4326", "WGS 84 / UTM zone 60S", 90),
        (Affine(1 / 120, 0, 30.0, 0, -1 / 1200, 87.0), "EPSG:4326", "WGS 84 / UPS North (E,N)", 70),
        (Affine(100, 0, 1_970_000, 0, -100, 560_000), "EPSG:2264", "WGS 84 / UTM zone 17N", 30.5),
        (Affine(10, 0, WEST, 0, -20, NORTH), UTM16, "WGS 84 / UTM zone 16N", 14.1),
        (Affine(30, 0, 1_000_000, 0, -30, 6_000_000), "EPSG:3857", "WGS 84 / UTM zone 32N", 20.4),
        (
            Affine.translation(WEST, NORTH) @ Affine.rotation(30) @ Affine.scale(10, -10),
            UTM16,
            "WGS 84 / UTM zone 16N",
            10,
        ),
    ],
    ids=["degrees", "0-360", "south", "date line", "polar", "feet", "not square", "web Mercator", "rotated"],
)
def test_a_plane_stays_a_plane_in_a_metric_frame(
    tmp_path: Path, at: Affine, crs: str, name: str, cell_m: float
) -> None:
    path = write(tmp_path / "plane.tif", plane(0.5, 0.25), crs=crs, transform=at)
    with open_elevation([str(path)]) as source:
        assert source.warped
        assert source.frame.name == name
        geometry = source.frame.geometry
        assert geometry.cell_size_m == pytest.approx(cell_m, rel=0.03)
        assert geometry.west_m / geometry.cell_size_m == pytest.approx(round(geometry.west_m / geometry.cell_size_m))
        # A hundredth of a source cell either way rises 0.0075 m on this plane.
        assert plane_error_m(source, 0.5, 0.25, at, crs) < 0.01


def test_every_window_is_bit_equal_to_the_same_window_of_the_whole(tmp_path: Path) -> None:
    at = Affine(1 / 1200, 0, -84.4, 0, -1 / 1200, 36.7)
    heights = hills(700, 900)
    heights[300:310, 400:420] = np.nan
    path = write(tmp_path / "dem.tif", heights, crs="EPSG:4326", transform=at)
    draw = np.random.default_rng(0)
    for options in ({}, {"cell_size_m": 200.0}, {"crs": "EPSG:32617", "cell_size_m": 77.0}):
        with open_elevation([str(path)], **options) as source:
            whole = source.read()
            rows, columns = whole.shape
        with open_elevation([str(path)], **options) as source:
            for _ in range(12):
                row, column = int(draw.integers(rows - 1)), int(draw.integers(columns - 1))
                size = int(draw.integers(1, rows - row)), int(draw.integers(1, columns - column))
                part = source.read(Window(row, column, *size))
                assert part.tobytes() == whole[row : row + size[0], column : column + size[1]].tobytes()


def test_voids_stay_voids_and_do_not_leak(tmp_path: Path) -> None:
    at = Affine(1 / 1200, 0, -84.4, 0, -1 / 1200, 36.7)
    heights = plane(0.5, 0.25)
    heights[80:120, 80:120] = -9999
    path = write(tmp_path / "dem.tif", heights, crs="EPSG:4326", transform=at, nodata=-9999)
    with open_elevation([str(path)]) as source:
        found = source.read()
        inside = source.frame.geometry.cell_at(
            source.frame.from_points(-84.4 + 100 / 1200, 36.7 - 100 / 1200, None, None)
        )
        assert inside is not None
        assert np.isnan(found[inside])
        assert np.nanmin(found) >= 100
        # 40 x 40 of 200 x 200 source cells.
        known = np.isfinite(found)
        hole = np.isnan(found[inside.row - 60 : inside.row + 60, inside.column - 60 : inside.column + 60])
        assert hole.sum() / (known.sum() + hole.sum()) == pytest.approx(1600 / 40000, rel=0.1)
        assert np.isnan(found[0, 0])


@pytest.mark.parametrize("factor", [2, 8])
def test_coarser_cells_are_means_of_whole_groups(tmp_path: Path, factor: int) -> None:
    heights = hills(64 * factor, 40 * factor)
    heights[0 : factor // 2, 0:factor] = np.nan  # half of the first group
    heights[-factor:, -factor:] = np.nan  # all of the last
    path = write(tmp_path / "dem.tif", heights)
    with open_elevation([str(path)], cell_size_m=CELL * factor) as source:
        assert source.frame.geometry.shape == (64, 40)
        assert (source.frame.geometry.west_m, source.frame.geometry.north_m) == (WEST, NORTH)
        found = source.read()
    groups = heights.astype(float).reshape(64, factor, 40, factor)
    known = np.isfinite(groups).sum(axis=(1, 3))
    expected = np.nansum(groups, axis=(1, 3)) / np.where(known, known, np.nan)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("cell_m", [11.0, 17.0, 19.9])
def test_cells_up_to_twice_as_large_are_interpolated_exactly(tmp_path: Path, cell_m: float) -> None:
    at = Affine(10, 0, WEST, 0, -10, NORTH)
    path = write(tmp_path / "plane.tif", plane(0.5, 0.25), transform=at)
    with open_elevation([str(path)], cell_size_m=cell_m) as source:
        assert plane_error_m(source, 0.5, 0.25, at, UTM16) < 1e-4


def test_a_much_coarser_map_is_made_in_pieces_of_the_same_means(tmp_path: Path) -> None:
    heights = hills(1280, 640)
    path = write(tmp_path / "dem.tif", heights)
    with open_elevation([str(path)], cell_size_m=CELL * 32) as source:
        found = source.read()
    np.testing.assert_allclose(found, heights.astype(float).reshape(40, 32, 20, 32).mean(axis=(1, 3)), rtol=1e-6)


def test_tiles_of_several_systems_and_resolutions_meet(tmp_path: Path) -> None:
    west = write(tmp_path / "a.tif", plane(0, 0), crs="EPSG:4326", transform=Affine(0.001, 0, -84.2, 0, -0.001, 36.7))
    east = write(tmp_path / "b.tif", plane(0, 0), crs=UTM16, transform=Affine(60, 0, 766_000, 0, -60, 4_064_000))
    with open_elevation([str(west), str(east)]) as source:
        assert source.warped
        found = source.read()
        for lon, lat in ((-84.15, 36.6), (-83.95, 36.6)):
            cell = source.frame.geometry.cell_at(source.frame.from_points(lon, lat, None, None))
            assert cell is not None
            assert found[cell] == pytest.approx(100)


def test_neighbouring_degree_tiles_leave_no_seam(tmp_path: Path) -> None:
    heights = hills(400, 801)
    for number, columns in enumerate((slice(0, 401), slice(400, 801))):  # one shared column, as SRTM has it
        at = Affine(1 / 1200, 0, -84.4 + columns.start / 1200, 0, -1 / 1200, 36.7)
        write(tmp_path / f"{number}.tif", heights[:, columns].copy(), crs="EPSG:4326", transform=at)
    one = write(
        tmp_path / "whole.tif", heights, crs="EPSG:4326", transform=Affine(1 / 1200, 0, -84.4, 0, -1 / 1200, 36.7)
    )
    with open_elevation([str(tmp_path / "[01].tif")]) as tiles, open_elevation([str(one)]) as whole:
        assert tiles.frame == whole.frame
        np.testing.assert_array_equal(tiles.read(), whole.read())


def test_the_moon_gets_a_frame_in_metres_and_no_longitude(tmp_path: Path) -> None:
    moon = CRS.from_wkt(pyproj.CRS("IAU_2015:30100").to_wkt())
    at = Affine(0.01, 0, 20, 0, -0.01, 12)
    path = write(tmp_path / "moon.tif", plane(1, 1), crs=moon, transform=at)
    with open_elevation([str(path)]) as source:
        assert "Moon" in source.frame.name
        assert not source.frame.is_earth
        assert not source.frame.has_lonlat
        assert source.frame.geometry.cell_size_m == pytest.approx(math.radians(0.01) * 1_737_400, rel=0.05)
        assert plane_error_m(source, 1, 1, at, moon.to_wkt()) < 0.02
        native = source.frame.from_points(21.0, 11.0, "native", source.source_crs_wkt)
        assert source.frame.geometry.cell_at(native) is not None
    metric = CRS.from_wkt(pyproj.CRS("IAU_2015:30110").to_wkt())
    heights = plane(1, 1) + 25_000  # too high for the Earth
    path = write(tmp_path / "metric.tif", heights, crs=metric, transform=Affine(100, 0, 0, 0, -100, 0))
    with open_elevation([str(path)]) as source:
        assert not source.warped
        np.testing.assert_array_equal(source.read(), heights)


def test_data_too_wide_for_one_zone_asks_for_a_projection(tmp_path: Path) -> None:
    path = write(tmp_path / "world.tif", hills(180, 360), crs="EPSG:4326", transform=Affine(1, 0, -180, 0, -1, 90))
    with pytest.raises(InvalidCrsError, match="--crs"):
        open_elevation([str(path)])


def test_a_projection_of_choice_is_used(tmp_path: Path) -> None:
    path = write(tmp_path / "dem.tif", hills(50, 50))
    with open_elevation([str(path)], crs="EPSG:26916") as source:
        assert source.frame.name == "NAD83 / UTM zone 16N"
    with open_elevation([str(path)], crs=UTM16) as source:
        assert not source.warped


@pytest.mark.parametrize(
    ("path", "frame", "range_m"),
    [
        ("dem/N44W072.hgt", ("WGS 84 / UTM zone 19N", 80), (115, 1908)),
        ("dem/cape_town_srtm_3arcsec_voids.tif", ("WGS 84 / UTM zone 34S", 85), (-28, 1077)),
        ("dem/north_texas_flat_3arcsec.tif", ("WGS 84 / UTM zone 14N", 85), (147, 298)),
    ],
)
def test_real_degree_terrain_is_warped_without_a_window_showing(
    swathe_data: Path, path: str, frame: tuple[str, float], range_m: tuple[float, float]
) -> None:
    with open_elevation([str(swathe_data / path)]) as source:
        assert (source.frame.name, source.frame.geometry.cell_size_m) == frame
        whole = source.read()
    low, high = range_m
    assert low - 0.01 <= np.nanmin(whole) < low + 5
    assert high - 15 < np.nanmax(whole) <= high + 0.01
    with open_elevation([str(swathe_data / path)]) as source:
        for window in (Window(0, 0, 1, 1), Window(255, 100, 3, 200), Window(301, 7, 44, 300)):
            row, column, rows, columns = window
            assert source.read(window).tobytes() == whole[row : row + rows, column : column + columns].tobytes()


def test_the_voids_of_cape_town_stay(swathe_data: Path) -> None:
    with open_elevation([str(swathe_data / "dem/cape_town_srtm_3arcsec_voids.tif")]) as source:
        heights = source.read()
        sea = source.frame.geometry.cell_at(source.frame.from_points(18.30, -33.70, None, None))
        table_mountain = source.frame.geometry.cell_at(source.frame.from_points(18.4094, -33.9628, None, None))
    assert isinstance(sea, Cell)
    assert isinstance(table_mountain, Cell)
    assert np.isnan(heights[sea])
    assert heights[table_mountain] > 900


class RangeHandler(http.server.SimpleHTTPRequestHandler):
    """Serves files in parts, counts the bytes, and hides files called ``plain`` from range requests."""

    sent = 0
    asked: list[str]

    def do_GET(self) -> None:
        type(self).asked.append(self.path)
        if "missing" in self.path:
            self.send_error(404)
            return
        with open(self.translate_path(self.path), "rb") as file:  # noqa: PTH123 - the handler speaks of plain paths
            content = file.read()
        span = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        ranged = span is not None and "plain" not in self.path
        first, last = (int(span[1]), min(int(span[2]), len(content) - 1)) if ranged and span else (0, len(content) - 1)
        self.send_response(206 if ranged else 200)
        if ranged:
            self.send_header("Accept-Ranges", "bytes")
            self.send_header("Content-Range", f"bytes {first}-{last}/{len(content)}")
        self.send_header("Content-Length", str(last + 1 - first))
        self.end_headers()
        if self.command == "GET":
            body = content[first : last + 1]
            type(self).sent += len(body)
            with contextlib.suppress(OSError):  # the reader may have heard enough
                self.wfile.write(body)

    do_HEAD = do_GET  # noqa: N815 - the handler's name for it

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    RangeHandler.sent, RangeHandler.asked = 0, []
    handler = functools.partial(RangeHandler, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{running.server_address[1]}"
        running.shutdown()
        thread.join()


def write_cog(path: Path, heights: NDArray[np.float32]) -> Path:
    return write(path, heights, driver="COG", blocksize=256, overviews="NONE")


def test_only_the_window_of_a_remote_file_is_fetched(tmp_path: Path, server: str) -> None:
    heights = hills(1500, 1500) + np.random.default_rng(1).random((1500, 1500), dtype=np.float32)
    path = write_cog(tmp_path / "cog.tif", heights)
    with open_elevation([f"{server}/cog.tif?token=secret"]) as source:
        found = source.read(Window(700, 800, 100, 100))
        assert source.names == (f"{server}/cog.tif",)
        assert source.fingerprint() == {f"{server}/cog.tif": "remote"}
    np.testing.assert_array_equal(found, heights[700:800, 800:900])
    assert 0 < RangeHandler.sent < path.stat().st_size / 4
    # No neighbour of the file is asked for.
    assert {asked.partition("?")[0] for asked in RangeHandler.asked} == {"/cog.tif"}


def test_a_server_without_parts_a_missing_file_and_no_server_are_one_line(
    tmp_path: Path, server: str, capfd: pytest.CaptureFixture[str]
) -> None:
    write_cog(tmp_path / "plain.tif", hills(1500, 1500))
    cases: list[tuple[str, type[Any]]] = [
        (f"{server}/plain.tif", UnreadableFileError),
        (f"{server}/missing.tif", MissingFileError),
        ("http://127.0.0.1:9/dem.tif", UnreadableFileError),
    ]
    for address, kind in cases:
        with pytest.raises(kind) as refusal, open_elevation([address]) as source:
            source.read(Window(700, 800, 100, 100))
        assert address in str(refusal.value)
        assert "\n" not in str(refusal.value)
    assert capfd.readouterr() == ("", "")
