"""The use cases as a library: large maps read in part, maps on a server, and real terrain."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pytest

import commands
import raster_files
from commands import PLAN_FILES
from range_server import Log, serving
from swathe import mission
from swathe.config import Settings, TerrainRequest
from swathe.errors import InterruptedBySignalError, TooLargeError
from swathe.grid import Window
from swathe.io import window as windows
from swathe.io.elevation import ElevationSource
from swathe.rank import RankParams

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

TRACTOR = Settings(vehicle="tractor")
# Well inside the large map, 8 km apart.
NEAR = ((800_500.0, 3_989_500.0), (806_200.0, 3_984_000.0))


def native(*dem: Path | str, **more: Any) -> TerrainRequest:
    return TerrainRequest(dem=tuple(map(str, dem)), points_crs="native", **more)


def legs(folder: Path) -> list[dict[str, Any]]:
    features = json.loads((folder / "route.geojson").read_text())["features"]
    assert isinstance(features, list)
    return features


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """6,000 x 6,000 cells of rolling hills, in tiles."""
    folder = tmp_path_factory.mktemp("large")
    heights = np.empty((6000, 6000), dtype=np.float32)
    column = np.arange(6000, dtype=np.float32)[None, :]
    for top in range(0, 6000, 500):
        row = np.arange(top, top + 500, dtype=np.float32)[:, None]
        heights[top : top + 500] = 500 + 150 * np.sin(row / 17) * np.cos(column / 23) + 0.1 * row
    return raster_files.write(folder / "large.tif", heights, tiled=True, blockxsize=256, blockysize=256)


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[Window]:
    """The windows that are read, as they are read."""
    seen: list[Window] = []
    read = ElevationSource.read

    def watched(self: ElevationSource, window: Window | None = None, *more: Any) -> Any:
        assert window is not None
        seen.append(window)
        return read(self, window, *more)

    monkeypatch.setattr(ElevationSource, "read", watched)
    return seen


def test_only_a_window_of_a_large_map_is_read_and_the_route_is_the_same(
    large: Path, reads: list[Window], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spine = replace(TRACTOR, arc="spine")
    part = mission.plan_route(native(large), *NEAR, spine, tmp_path / "part")
    assert len(reads) == 1
    assert reads[0].rows * reads[0].columns < 6000 * 6000 / 50
    assert "Only the part of the map around start and goal was read." in part["notes"]

    monkeypatch.setattr(windows, "WHOLE_MAP_CELLS", 6000 * 6000)
    whole = mission.plan_route(native(large), *NEAR, spine, tmp_path / "whole")
    assert reads[1] == Window(0, 0, 6000, 6000)
    assert part["status"] == whole["status"] == "route_found"
    assert legs(tmp_path / "part") == legs(tmp_path / "whole")
    assert part["cost"] == pytest.approx(whole["cost"], rel=1e-9)


def test_a_place_outside_a_large_map_is_told_from_a_part_of_it(
    large: Path, reads: list[Window], tmp_path: Path
) -> None:
    far = (NEAR[0], (NEAR[1][0], 3_000_000.0))
    assert mission.plan_route(native(large), NEAR[0], (700_000.0, NEAR[0][1]), TRACTOR, tmp_path / "a")["status"] == (
        "outside_map"
    )
    assert reads[0].rows < 6000
    assert mission.plan_route(native(large), *far, TRACTOR, tmp_path / "b")["status"] == "outside_map"


def test_the_window_grows_until_there_is_a_way_round(
    reads: list[Window], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heights = np.full((1200, 1200), 300, dtype=np.float32)
    heights[100:, 596:604] = 900  # a wall that ends far in the north
    dem = raster_files.write(tmp_path / "wall.tif", heights)
    place = [(raster_files.WEST + 30 * column, raster_files.NORTH - 30 * 900) for column in (560.5, 640.5)]
    monkeypatch.setattr(windows, "WHOLE_MAP_CELLS", 1000)
    found = mission.plan_route(native(dem), place[0], place[1], TRACTOR, tmp_path / "run")
    assert found["status"] == "route_found"
    assert found["length_m"] > 2 * 30 * 790, "round the end of the wall"
    sizes = [window.rows * window.columns for window in reads]
    assert len(sizes) > 1
    assert sizes == sorted(sizes)
    assert found["cells_total"] == sizes[-1]


def test_windows_begin_at_whole_groups_so_that_the_papers_averages_agree(
    large: Path, reads: list[Window], tmp_path: Path
) -> None:
    settings = Settings(vehicle="tractor", rank=RankParams(profile="paper"))
    mission.plan_route(native(large), *NEAR, settings, tmp_path / "run")
    assert reads[0].rows < 6000
    assert all(number % 8 == 0 for number in reads[0])


def test_bounds_cut_the_map(large: Path, reads: list[Window], tmp_path: Path) -> None:
    west, north = raster_files.WEST, raster_files.NORTH
    box = (west + 3000, north - 9000, west + 6000, north - 6000)
    found = mission.find_nests(native(large, bounds=box), TRACTOR, tmp_path / "run")
    assert reads[0][:2] == (200, 100)
    assert {found["rows"], found["columns"]} <= {100, 101}


def test_memory_stays_flat_however_large_the_map_is(large: Path, tmp_path: Path) -> None:
    small = raster_files.write(tmp_path / "small.tif", raster_files.hills(1200, 1200))
    offset_m = 30 * 300
    near = [(raster_files.WEST + offset_m, raster_files.NORTH - offset_m)]
    near.append((near[0][0] + NEAR[1][0] - NEAR[0][0], near[0][1] + NEAR[1][1] - NEAR[0][1]))
    code = """
import resource, sys
from swathe.cli import main
try:
    main()
finally:
    sys.stderr.write(str(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss))
"""
    peak_kb = []
    for dem, ends in ((small, near), (large, NEAR)):
        from_to = (f"{ends[0][0]},{ends[0][1]}", f"{ends[1][0]},{ends[1][1]}")
        words = commands.way(dem, "--out", str(tmp_path / dem.stem), "--vehicle", "tractor", from_to=from_to)
        done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
        peak_kb.append(int(done.stderr))
    whole_kb = 4 * 6000 * 6000 / 1024
    assert peak_kb[1] < peak_kb[0] + 0.25 * whole_kb


def test_what_does_not_fit_is_refused_before_it_is_read(large: Path, reads: list[Window], tmp_path: Path) -> None:
    with pytest.raises(TooLargeError, match="6,000 x 6,000") as refusal:
        mission.find_nests(native(large, memory_limit_bytes=10**8), TRACTOR, tmp_path / "run")
    assert reads == []
    suggested = re.search(r"--cell-size ([\d.]+)", refusal.value.remedy)
    assert suggested is not None
    fits = native(large, memory_limit_bytes=10**8, cell_size_m=float(suggested[1]))
    assert mission.find_nests(fits, TRACTOR, tmp_path / "run")["status"] == "done"


def test_a_callback_can_stop_at_every_stage(tmp_path: Path) -> None:
    dem = commands.hills(tmp_path)
    ends = [tuple(map(float, text.split(","))) for text in (commands.START, commands.GOAL)]
    start, goal = (ends[0][0], ends[0][1]), (ends[1][0], ends[1][1])
    stages: list[str] = []

    def told(stage: str, _done: int, _total: int) -> bool:
        stages.append(stage)
        return True

    mission.plan_route(native(dem), start, goal, TRACTOR, tmp_path / "run", on_progress=told)
    assert stages[0] == "reading elevation"
    assert stages[-1] == "writing"
    for stop in dict.fromkeys(stages):
        with pytest.raises(InterruptedBySignalError):
            mission.plan_route(
                native(dem),
                start,
                goal,
                TRACTOR,
                tmp_path / "other",
                on_progress=lambda stage, *_, stop=stop: stage != stop,
            )
        assert not (tmp_path / "other").exists()


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Log]:
    """A server of ``tmp_path`` and what it has sent."""
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    with serving(tmp_path) as log:
        yield log


def test_a_plan_over_a_map_on_a_server_fetches_only_a_part(
    server: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rough = np.random.default_rng(1).random((2000, 2000), dtype=np.float32)
    path = raster_files.write(
        tmp_path / "cog.tif", raster_files.hills(2000, 2000) + rough, driver="COG", blocksize=256, overviews="NONE"
    )
    ends = ("770000,4020000", "772000,4018500")
    words = ("--vehicle", "tractor", "--json", "--out")
    remote = commands.run_here(
        capsys, *commands.way(f"{server.address}/cog.tif", *words, str(tmp_path / "remote"), from_to=ends)
    )
    assert remote.code == 0, remote
    assert remote.answer["inputs"] == [{"name": f"{server.address}/cog.tif", "sha256": "remote"}]
    assert 0 < server.sent < path.stat().st_size / 2
    local = commands.run_here(capsys, *commands.way(path, *words, str(tmp_path / "local"), from_to=ends))
    assert local.code == 0
    assert legs(tmp_path / "remote") == legs(tmp_path / "local")


def test_what_a_server_does_not_have_is_missing(
    server: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    finished = commands.run_here(capsys, *commands.way(f"{server.address}/no.tif", "--json", "--out", str(out)))
    assert (finished.code, finished.answer["kind"]) == (4, "missing_file")
    assert not out.exists()


class Real(NamedTuple):
    """A plan over real terrain and how it ends."""

    dem: str
    start: tuple[float, float]
    goal: tuple[float, float]
    vehicle: str
    status: str = "route_found"
    says: str = ""
    soil: str | None = None
    legend: str | None = None
    points_crs: str | None = "native"


EBERGOETZEN = Real(
    "ebergotzen/ebergotzen_dem_25m.tif", (3_571_000, 5_709_000), (3_578_500, 5_716_500), "tractor",
    soil="ebergotzen/ebergotzen_soil_zones.gpkg",
)  # fmt: skip
CAPE_TOWN = Real(
    "dem/cape_town_srtm_3arcsec_voids.tif", (18.62, -33.666), (18.65, -33.95), "pickup-4x4", points_crs=None
)
REAL = {
    "Ebergoetzen": EBERGOETZEN,
    "Ebergoetzen, soil types of a raster": EBERGOETZEN._replace(
        soil="ebergotzen/ebergotzen_soiltype_25m.tif", legend="ebergotzen/ebergotzen_soiltype_classes.csv"
    ),
    "Fort Bragg": Real(
        "fortbragg/fortbragg_elevation_2016_1m.tif", (597_250, 150_650), (597_600, 150_980), "pioneer-3at",
        soil="fortbragg/fortbragg_soils.gpkg",
    ),
    "Spearfish": Real(
        "spearfish/spearfish_elevation_dem_30m.tif", (592_000, 4_925_000), (600_915, 4_923_615), "tractor"
    ),
    "White Mountains": Real("dem/N44W072.hgt", (-71.7, 44.1), (-71.5, 44.3), "tractor", points_crs=None),
    "St Helens, two sides of the mountain": Real(
        "dem/SainteHelens.dem", (560_130, 5_111_430), (563_070, 5_121_300), "pioneer-3at", "no_route", "too steep"
    ),
    "Cape Town": CAPE_TOWN,
    "Cape Town, from the sea": CAPE_TOWN._replace(
        start=(18.30, -33.70), status="start_blocked", says="unknown elevation"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REAL)
def test_real_terrain_ends_as_expected_with_a_complete_folder(name: str, swathe_data: Path, tmp_path: Path) -> None:
    case = REAL[name]
    soil, legend = (None if file is None else str(swathe_data / file) for file in (case.soil, case.legend))
    request = TerrainRequest(
        dem=(str(swathe_data / case.dem),), soil=soil, soil_legend=legend, points_crs=case.points_crs
    )
    out = tmp_path / "run"
    found = mission.plan_route(request, case.start, case.goal, Settings(vehicle=case.vehicle), out)
    assert found["status"] == case.status, found["reason"]
    kept = json.loads((out / "summary.json").read_text())
    assert kept["status"] == case.status
    if case.status == "route_found":
        assert {path.name for path in out.iterdir()} == PLAN_FILES
        assert found["length_m"] >= 0.98 * found["straight_m"] - 2 * found["cell_size_m"]
        assert sum(leg["properties"]["length_m"] for leg in legs(out)) == pytest.approx(found["length_m"], rel=1e-4)
    else:
        assert {path.name for path in out.iterdir()} == PLAN_FILES - {"profile.png"}
        assert case.says in found["reason"]
        assert found["where"]
        assert found["remedy"]
    if soil is not None:
        assert found["soil"]["covered_fraction"] > 0.4
        assert any(entry["understood"] for entry in found["soil"]["entries"])
