"""Elevation that is read when it is needed: only what the swarm looks at, with the answers of the whole map."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rasterio

import commands
import raster_files
from range_server import Log, serving
from swathe import mission, nest, planner, rank, swarm
from swathe.config import Settings, TerrainRequest
from swathe.errors import InterruptedBySignalError, InvalidParameterError, ShapeMismatchError, UnreadableFileError
from swathe.grid import Cell, GridGeometry, Position, Window
from swathe.io import lazy as lazily
from swathe.io import sources
from swathe.io import window as windows
from swathe.io.elevation import TILE_SIZE, open_elevation
from swathe.io.lazy import LazyElevation
from swathe.objective import Objective
from swathe.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

SIDE = 3000
TRACTOR = Settings(vehicle="tractor")


def place(row: float, column: float) -> tuple[float, float]:
    return raster_files.WEST + raster_files.CELL * column, raster_files.NORTH - raster_files.CELL * row


START, GOAL = place(400.5, 300.5), place(700.5, 2300.5)


@pytest.fixture(scope="module")
def dem(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cloud optimised file of 3,000 x 3,000 rough hills in blocks of 256."""
    heights = raster_files.hills(SIDE, SIDE) + np.random.default_rng(1).random((SIDE, SIDE), dtype=np.float32)
    path = tmp_path_factory.mktemp("dem") / "cog.tif"
    return raster_files.write(path, heights, driver="COG", blocksize=256, overviews="NONE")


@pytest.fixture
def server(dem: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Log]:
    """A server of the file, asked without pauses."""
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(lazily, "PAUSE_S", 0.0)
    monkeypatch.setitem(sources.REMOTE_SETTINGS, "GDAL_HTTP_MAX_RETRY", "0")
    with serving(dem.parent) as log:
        yield log


def native(*dem: Path | str, **more: Any) -> TerrainRequest:
    return TerrainRequest(dem=tuple(map(str, dem)), points_crs="native", **more)


def route(folder: Path) -> Any:
    return json.loads((folder / "route.geojson").read_text())["features"]


def blocks(path: Path) -> dict[tuple[int, int], tuple[int, int]]:
    """The bytes of every block of a file, by its row and column of blocks."""
    with rasterio.open(path) as dataset:
        found = {}
        for (row, column), _ in dataset.block_windows(1):
            offset = dataset.get_tag_item(f"BLOCK_OFFSET_{column}_{row}", "TIFF", bidx=1)
            size = dataset.get_tag_item(f"BLOCK_SIZE_{column}_{row}", "TIFF", bidx=1)
            found[row, column] = (int(offset), int(offset) + int(size) - 1)
        return found


def test_a_plan_asks_a_server_for_the_blocks_along_the_way_alone_and_finds_the_route_of_the_whole_map(
    server: Log, dem: Path, tmp_path: Path
) -> None:
    found = mission.plan_route(native(f"{server.address}/cog.tif"), START, GOAL, TRACTOR, tmp_path / "remote")
    whole = mission.plan_route(native(dem), START, GOAL, TRACTOR, tmp_path / "whole")
    assert route(tmp_path / "remote") == route(tmp_path / "whole")
    for key in ("cost", "cells_evaluated", "nest_count", "cells_total", "tiles_total", "swarm"):
        assert found[key] == whole[key], key
    assert whole["tiles_read"] == whole["tiles_total"] == 144
    assert 8 <= found["tiles_read"] < 36
    assert found["bytes_read"] == 4 * TILE_SIZE**2 * found["tiles_read"]
    assert any(f"{found['tiles_read']} of 144 tiles" in note for note in found["notes"])

    # What really went over the line: the head of the file, and of each block that was not needed at most an edge that
    # the reading of whole pages of 16 KiB takes along.
    with rasterio.open(tmp_path / "remote" / "rank.tif") as ranks:
        top = round((raster_files.NORTH - ranks.bounds.top) / raster_files.CELL)
        left = round((ranks.bounds.left - raster_files.WEST) / raster_files.CELL)
        judged = np.argwhere(ranks.read(1) > 0) + np.array([top, left])
    needed = {(int(row), int(column)) for row, column in np.unique(judged // TILE_SIZE, axis=0)}
    assert len(needed) == found["tiles_read"]
    offsets = blocks(dem)
    first_block = min(low for low, _ in offsets.values())
    page = 16_384
    wanted = sum(high + 1 - low for key, (low, high) in offsets.items() if key in needed)
    # Neighbours in the file are read ahead.
    assert server.sent < 1.25 * wanted + first_block + page
    for one in server.ranges:
        near = (
            one.first <= high + page and low <= one.last + page for key, (low, high) in offsets.items() if key in needed
        )
        assert one.first < first_block or any(near), one
    assert server.sent < dem.stat().st_size / 4


def test_maps_of_a_lazy_run_show_what_was_read_and_only_that(
    dem: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(windows, "WHOLE_MAP_CELLS", SIDE * SIDE - 1)
    found = mission.plan_route(native(dem), START, GOAL, TRACTOR, tmp_path / "lazy")
    assert {path.name for path in (tmp_path / "lazy").iterdir()} == commands.PLAN_FILES
    assert found["tiles_read"] < 36
    with rasterio.open(tmp_path / "lazy" / "rank.tif") as ranks:
        shown = ranks.read(1)
        top = round((raster_files.NORTH - ranks.bounds.top) / raster_files.CELL)
        left = round((ranks.bounds.left - raster_files.WEST) / raster_files.CELL)
    heights = rasterio.open(dem).read(1)
    geometry = GridGeometry(SIDE, SIDE, raster_files.CELL, raster_files.WEST, raster_files.NORTH)
    full = rank.rank_map(rank.Region(geometry, heights, load_vehicle("tractor"))).rank
    there = full[top : top + shown.shape[0], left : left + shown.shape[1]]
    assert shown.shape != full.shape
    assert np.array_equal(shown[shown > 0], there[shown > 0])
    assert 0.9 * TILE_SIZE**2 * found["tiles_read"] < np.count_nonzero(shown) <= TILE_SIZE**2 * found["tiles_read"]


def test_what_needs_the_whole_map_is_not_read_lazily(server: Log, tmp_path: Path) -> None:
    for settings in (
        replace(TRACTOR, arc="line"),
        replace(TRACTOR, certify=True),
        replace(TRACTOR, width_m=3000.0),
        replace(TRACTOR, method="exact"),
        replace(TRACTOR, objective=Objective(risk=1.0)),
        replace(TRACTOR, rank=rank.RankParams(profile="paper"), arc="relaid"),
    ):
        assert not settings.looks_where_it_goes
    assert TRACTOR.looks_where_it_goes
    near = place(450.5, 330.5)
    address = f"{server.address}/cog.tif"
    found = mission.plan_route(native(address), START, near, replace(TRACTOR, arc="line"), tmp_path / "run")
    assert found["status"] == "route_found"
    assert "Only the part of the map around start and goal was read." in found["notes"]


def test_places_outside_and_on_unknown_ground_are_answered_from_little(server: Log, tmp_path: Path) -> None:
    address = f"{server.address}/cog.tif"
    found = mission.plan_route(native(address), START, (700_000.0, START[1]), TRACTOR, tmp_path / "run")
    assert (found["status"], found["tiles_read"]) == ("outside_map", 1)
    assert (tmp_path / "run" / "report.html").is_file()


def test_a_server_that_falters_is_asked_again(server: Log, dem: Path, tmp_path: Path) -> None:
    (dem.parent / "falters.tif").write_bytes(dem.read_bytes())
    server.good, server.bad = 4, 4
    told: list[tuple[str, int, int]] = []

    def on_progress(stage: str, done: int, total: int) -> bool:
        told.append((stage, done, total))
        return True

    address = f"{server.address}/falters.tif"
    found = mission.plan_route(native(address), START, GOAL, TRACTOR, tmp_path / "run", on_progress=on_progress)
    assert server.refused == 4
    assert ("reading again", 1, 2) in told
    mission.plan_route(native(dem), START, GOAL, TRACTOR, tmp_path / "whole")
    assert found["status"] == "route_found"
    assert route(tmp_path / "run") == route(tmp_path / "whole")


def test_a_server_that_dies_midway_leaves_the_work_and_says_which_tile(
    server: Log, dem: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (dem.parent / "dies.tif").write_bytes(dem.read_bytes())
    server.good, server.bad = 4, float("inf")
    out = tmp_path / "run"
    ends = (f"{START[0]},{START[1]}", f"{GOAL[0]},{GOAL[1]}")
    words = commands.way(
        f"{server.address}/dies.tif", "--vehicle", "tractor", "--json", "--out", str(out), from_to=ends
    )
    finished = commands.run_here(capsys, *words)
    assert (finished.code, finished.answer["kind"]) == (4, "unreadable_file")
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["status"], summary["reason"]) == ("error", finished.answer["message"])
    assert summary["remedy"] == finished.answer["remedy"]
    for part in ("dies.tif", "tile of rows", "tried 3 times", f"{summary['cells_evaluated']:,} cells", "of 144 tiles"):
        assert part in summary["reason"], part
    assert str(out) in summary["remedy"]
    assert summary["cells_evaluated"] > 0
    assert 0 < summary["tiles_read"] < 20
    nests = json.loads((out / "nests.geojson").read_text())["features"]
    assert nests
    assert summary["nest_count"] > 0
    assert {path.name for path in out.iterdir()} == {"summary.json", "nests.geojson"}
    # The folder is one of ours: the next run may have it, and the report of what is known can be made.
    assert commands.run_here(capsys, "report", str(out)).code == 0
    server.good = float("inf")
    again = commands.run_here(capsys, *words)
    assert (again.code, again.answer["status"]) == (0, "route_found")
    assert {path.name for path in out.iterdir()} == commands.PLAN_FILES


class Ground:
    """Heights that are given tile by tile, with the log of what was asked for."""

    def __init__(self, heights: NDArray[np.float32], most: int = 10**9) -> None:
        self.heights = heights
        self.most = most
        self.asked: list[tuple[int, int, int, int]] = []

    def read(self, row: int, column: int, rows: int, columns: int) -> NDArray[np.float32] | None:
        if len(self.asked) == self.most:
            return None
        self.asked.append((row, column, rows, columns))
        return np.ascontiguousarray(self.heights[row : row + rows, column : column + columns])

    def region(self, tile_size: int = 32, first: tuple[int, int] = (0, 0)) -> rank.TiledRegion:
        rows, columns = self.heights.shape
        geometry = GridGeometry(rows, columns, 30.0)
        return rank.TiledRegion(geometry, self.read, load_vehicle("tractor"), tile_size=tile_size, first=first)


def ends_in(geometry: GridGeometry) -> tuple[Position, Position]:
    return geometry.position_of(Cell(40, 40)), geometry.position_of(Cell(60, 360))


@pytest.mark.parametrize("first", [(0, 0), (5, 31)])
def test_a_plan_of_a_tiled_region_is_that_of_the_region(first: tuple[int, int]) -> None:
    ground = Ground(raster_files.hills(300, 400))
    region = ground.region(first=first)
    ends = ends_in(region.geometry)
    tiled = planner.plan(region, *ends)
    whole = planner.plan(rank.Region(region.geometry, ground.heights, region.vehicle), *ends)
    assert tiled.route == whole.route
    assert tiled.route is not None
    assert (tiled.path, tiled.cells_evaluated) == (whole.path, whole.cells_evaluated)
    assert tiled.nests is not None
    assert whole.nests is not None
    assert np.array_equal(tiled.nests.labels, whole.nests.labels)
    assert len(ground.asked) == len(set(ground.asked)) < 13 * 10 / 2
    assert tiled.is_complete
    # What was read stays: the same plan again reads nothing.
    planner.plan(region, *ends)
    assert len(ground.asked) == len(set(ground.asked))


def test_a_finished_swarm_on_tiles_has_the_nests_of_the_full_rank_map() -> None:
    ground = Ground(raster_files.hills(150, 170))
    region = ground.region()
    whole = rank.Region(region.geometry, ground.heights, region.vehicle)
    found = swarm.run_swarm(region)
    oracle = nest.exact_nests(rank.rank_map(whole).rank)
    assert np.array_equal(found.nests.labels, oracle.labels)


def test_heights_that_cannot_be_read_are_said_and_what_the_reader_raises_comes_out() -> None:
    ground = Ground(raster_files.hills(300, 400), most=5)
    region = ground.region()
    found = planner.plan(region, *ends_in(region.geometry))
    assert (found.status, found.route, found.is_complete) == ("unread", None, False)
    assert found.nests is not None
    assert found.nests.count > 0
    assert found.reason
    with pytest.raises(UnreadableFileError):
        planner.plan(region, *ends_in(region.geometry), method="exact")

    def broken(*_: int) -> NDArray[np.float32]:
        raise InterruptedBySignalError("Enough.", "")

    with pytest.raises(InterruptedBySignalError, match="Enough"):
        planner.plan(replace(region, read=broken), *ends_in(region.geometry))
    with pytest.raises(TypeError):
        planner.plan(replace(region, read=lambda *_: "heights"), *ends_in(region.geometry))  # type: ignore[arg-type]
    # Heights of the wrong shape are as good as none.
    found = planner.plan(replace(region, read=lambda *_: np.zeros((2, 2), np.float32)), *ends_in(region.geometry))
    assert found.status == "unread"


def test_tiles_that_cannot_be_are_refused() -> None:
    ground = Ground(raster_files.hills(300, 400))
    for tile_size, first in ((100, (0, 0)), (32, (32, 0)), (0, (0, 0))):
        with pytest.raises(InvalidParameterError, match="Tiles of"):
            _ = ground.region(tile_size, first).core
    region = replace(ground.region(), soil=np.zeros((3, 3), np.uint8))
    with pytest.raises(ShapeMismatchError):
        _ = region.core


def test_tiles_are_read_once_for_all_windows_and_warped_tiles_are_those_of_the_whole(dem: Path) -> None:
    with open_elevation([str(dem)], cell_size_m=47.0) as source:
        assert source.warped
        whole = source.read()
        lazy = LazyElevation(source, Window(0, 0, *source.frame.geometry.shape))
        for window in (Window(100, 200, 700, 900), Window(40, 8, 800, 1200)):
            read = lazy.reader(window)
            for row, column in ((0, 0), (412 - window.row, 768 - window.column), (600, 800)):
                height, width = (
                    min(20, TILE_SIZE - (row + window.row) % TILE_SIZE),
                    min(30, TILE_SIZE - (column + window.column) % TILE_SIZE),
                )
                block = read(row, column, height, width)
                there = whole[window.row + row :, window.column + column :][:height, :width]
                assert block is not None
                assert np.array_equal(block, there)
        assert lazy.tiles_read <= 5
        extent = lazy.extent(Window(100, 200, 700, 900))
        assert extent is not None
        heights = lazy.heights(extent)
        known = np.isfinite(heights)
        assert np.array_equal(
            heights[known], whole[extent.row :, extent.column :][: extent.rows, : extent.columns][known]
        )
        trusted = lazy.surroundings_read(extent)
        assert trusted.any()
        assert known[trusted].all()
