"""Imports from the command line, and plans that are the same from a store as from the files that were imported."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from affine import Affine

import commands
import raster_files
from swathe.config import Settings, TerrainRequest
from swathe.grid import Window
from swathe.io.elevation import open_elevation
from swathe.io.soil import read_soil
from swathe.preparation import prepare_ground
from swathe.rank import RankParams
from swathe.soil import SoilClass
from swathe.store import open_store
from swathe.store.imports import import_elevation, import_readings, import_soil, import_zones

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from swathe.preparation import Ground

WEST, NORTH, CELL = raster_files.WEST, raster_files.NORTH, raster_files.CELL
ROWS, COLUMNS = 80, 90
START, GOAL = commands.START, commands.GOAL


def block(row: float, column: float, rows: float, columns: float) -> Any:
    """Return the outline of a block of cells."""
    west, north = WEST + column * CELL, NORTH - row * CELL
    return shapely.box(west, north - rows * CELL, west + columns * CELL, north)


def write_vector(
    path: Path, shapes: Sequence[Any], labels: Sequence[str], crs: str | None = raster_files.UTM16, **more: Any
) -> Path:
    """Write polygons with a label and a category."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "'crs' was not provided")
        pyogrio.raw.write(
            path,
            geometry=np.array([None if shape is None else shapely.to_wkb(shape) for shape in shapes], dtype=object),
            field_data=[np.array(labels, dtype=object), np.arange(1, len(labels) + 1, dtype=np.int32)],
            fields=["label", "cat"],
            crs=crs,
            geometry_type="Unknown",
            **more,
        )
    return path


def tangled(folder: Path) -> Path:
    """Write a soil map with everything that can be wrong: overlaps, bow ties, spikes, holes, nothing at all."""
    bow = shapely.Polygon([(0, 0), (900, 900), (900, 0), (0, 900)])
    bow = shapely.transform(bow, lambda points: points + np.array([WEST + 700, NORTH - 1900]))
    spike = shapely.Polygon(
        [
            (WEST, NORTH - 60),
            (WEST + 900, NORTH - 60),
            (WEST + 1500, NORTH - 60),
            (WEST + 900, NORTH - 60),
            (WEST, NORTH),
        ]
    )
    ring = shapely.difference(block(30, 40, 30, 40), block(40, 50, 10, 10))
    shapes = [
        block(-20, -20, 130, 70), block(-5, 45, 100, 60), block(10, 30, 30, 30), bow, spike, ring,
        shapely.Polygon(), None, shapely.LineString([(WEST, NORTH), (WEST + 1, NORTH)]), block(500, 500, 3, 3),
    ]  # fmt: skip
    labels = ["loamy sand", "clay", "gravel", "silt loam", "rock", "water", "sand", "clay", "sand", "gravel"]
    return write_vector(folder / "soil.gpkg", shapes, labels)


def turned(path: Path, folder: Path, crs: str) -> Path:
    """Write a vector again in another system."""
    from swathe.io.crs import transformer_between

    meta, _, wkb, data = pyogrio.raw.read(path)
    way = transformer_between(meta["crs"], crs)
    shapes = [None if one is None else shapely.from_wkb(one) for one in wkb]
    moved = [
        None if shape is None else shapely.transform(shape, lambda p: np.column_stack(way.transform(p[:, 0], p[:, 1])))
        for shape in shapes
    ]
    return write_vector(folder / "turned.gpkg", moved, [str(label) for label in data[0]], crs=crs)


def soil_raster(folder: Path) -> Path:
    """Write a soil raster of coarser cells that does not cover all."""
    row, column = np.mgrid[0:20, 0:25]
    codes = (1 + (row // 5 + column // 6) % 4).astype(np.uint8)
    codes[3, 3] = 0
    path = raster_files.write(
        folder / "soil.tif", codes, transform=Affine(101, 0, WEST + 13, 0, -101, NORTH - 17), nodata=0
    )
    legend = folder / "legend.csv"
    legend.write_text("value,class\n1,gravel\n2,sand\n3,clay\n4,sand\n", encoding="utf-8")
    return path


def same_ground(files: TerrainRequest, stored: TerrainRequest, settings: Settings) -> Ground:
    """Prepare ground from files and from a store, compare all that a plan is made of, and return it."""
    one, other = prepare_ground(files, settings), prepare_ground(stored, settings)
    for layer in ("elevation_m", "soil", "grey", "zones"):
        first, second = getattr(one.region, layer), getattr(other.region, layer)
        assert (first is None) is (second is None), layer
        if first is not None:
            np.testing.assert_array_equal(first, second, err_msg=layer)
    for what in ("frame", "soil", "notes", "is_whole"):
        assert getattr(one, what) == getattr(other, what), what
    for what in ("names", "warped", "source_crs_wkt", "native_cell_size_m", "height_range_m"):
        assert getattr(one.source, what) == getattr(other.source, what), what
    assert one.source.fingerprint() == other.source.fingerprint()
    if one.soil_source is not None and other.soil_source is not None:
        assert one.soil_source.name == other.soil_source.name
        assert one.soil_source.fingerprint() == other.soil_source.fingerprint()
    return other


@pytest.fixture
def hills(tmp_path: Path) -> Path:
    return commands.hills(tmp_path, ROWS, COLUMNS)


NATIVE = ("--points-crs", "native", "--vehicle", "tractor")


@pytest.mark.parametrize("kind", ["polygons", "turned", "raster", "bundled", "none"])
def test_the_ground_of_a_store_is_that_of_the_files(tmp_path: Path, hills: Path, kind: str) -> None:
    dem, soil, field, legend = str(hills), None, None, None
    if kind in {"polygons", "turned"}:
        file, field = tangled(tmp_path), "label"
        soil = str(turned(file, tmp_path, "EPSG:4326") if kind == "turned" else file)
    elif kind == "raster":
        soil, legend = str(soil_raster(tmp_path)), str(tmp_path / "legend.csv")
    elif kind == "bundled":
        dem = soil = "bundled:jacksboro"
    with open_store(tmp_path / "project", create=True) as store:
        import_elevation(store, "r", [dem])
        if soil is not None:
            import_soil(store, "r", soil, field=field, legend=legend)
    files = TerrainRequest(dem=(dem,), soil=soil, soil_field=field, soil_legend=legend)
    from_store = TerrainRequest(store=str(tmp_path / "project"), region="r")
    box = (740_300.0, 4_048_000.0, 742_000.0, 4_049_500.0)
    metric, paper = Settings(vehicle="tractor"), Settings(vehicle="tractor", rank=RankParams("paper"))
    ground = same_ground(files, from_store, metric)
    if kind == "polygons":
        assert ground.soil is not None
        assert ground.soil.disputed_cells > 0
    if kind != "raster":  # a raster of other cells is laid on the region's cells once
        same_ground(files, from_store, paper)
    if kind in {"polygons", "raster"}:
        one, other = (replace(request, bounds=box, points_crs="native") for request in (files, from_store))
        same_ground(one, other, metric)


def test_warped_maps_and_grey_pictures_are_the_same_from_a_store(tmp_path: Path) -> None:
    degrees = Affine(0.0003, 0, -84.32, 0, -0.0003, 36.56)
    heights = raster_files.hills(ROWS, COLUMNS)
    dem = raster_files.write(tmp_path / "degrees.tif", heights, crs="EPSG:4326", transform=degrees)
    picture = raster_files.write(
        tmp_path / "grey.png", (heights / 3).astype(np.uint8), crs=None, transform=None, driver="PNG"
    )
    settings = Settings(vehicle="tractor", rank=RankParams("paper"))
    with open_store(tmp_path / "project", create=True) as store:
        import_elevation(store, "d", [str(dem)], cell_size_m=20)
        import_elevation(store, "g", [str(picture)], cell_size_m=10, height_range_m=(0, 90))
    stored_d, stored_g = (TerrainRequest(store=str(tmp_path / "project"), region=name) for name in "dg")
    same_ground(TerrainRequest(dem=(str(dem),), cell_size_m=20), stored_d, settings)
    grey = TerrainRequest(dem=(str(picture),), cell_size_m=10, height_range_m=(0, 90))
    assert same_ground(grey, stored_g, settings).region.grey is not None


def test_a_plan_and_nests_from_a_store_have_the_bytes_of_those_from_files(tmp_path: Path, hills: Path) -> None:
    soil = turned(tangled(tmp_path), tmp_path, "EPSG:4326")
    ground = ("--store", str(tmp_path / "project"), "--region", "hills")
    for given in (("dem", str(hills), "--licence", "free"), ("soil", str(soil), "--soil-field", "label")):
        done = commands.run("import", *given, *ground, "--json")
        assert done.answer["status"] == "done", done.err
    files = ("--dem", str(hills), "--soil", str(soil), "--soil-field", "label")
    answers = []
    for name, words in (("files", list(files)), ("store", list(ground))):
        out = tmp_path / name
        done = commands.run("plan", *words, *NATIVE, "--start", START, "--goal", GOAL, "--out", str(out), "--json")
        assert done.answer["status"] == "route_found", done.err
        summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
        # The request names the ground, which is files or a store.
        del summary["timings_s"], summary["bytes_read"], summary["request"]
        written = {path.name: path.read_bytes() for path in out.iterdir() if path.suffix in {".geojson", ".tif"}}
        done = commands.run("nests", *words, "--vehicle", "tractor", "--out", str(out / "nests"), "--json")
        nests = {key: value for key, value in done.answer.items() if key not in {"timings_s", "outputs"}}
        answers.append((summary, written, nests))
    assert answers[0] == answers[1]
    assert set(answers[0][1]) == {"route.geojson", "nests.geojson", "rank.tif"}
    with open_store(tmp_path / "project") as opened:
        layer = opened.region("hills").layers["elevation"]
    assert layer.provenance.licence == "free"
    assert layer.provenance.time.endswith("Z")
    assert layer.provenance.author


def test_a_large_map_is_read_from_a_store_where_the_swarm_goes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import swathe.io.window
    from swathe import mission

    monkeypatch.setattr(swathe.io.window, "WHOLE_MAP_CELLS", 10_000)
    dem = raster_files.write(
        tmp_path / "large.tif", raster_files.hills(900, 1000), tiled=True, blockxsize=256, blockysize=256
    )
    with open_store(tmp_path / "project", create=True) as store:
        import_elevation(store, "large", [str(dem)])
    ends = ((WEST + 400 * CELL, NORTH - 300 * CELL), (WEST + 440 * CELL, NORTH - 330 * CELL))
    routes = []
    for out, request in (
        ("a", TerrainRequest(dem=(str(dem),), points_crs="native")),
        ("b", TerrainRequest(store=str(tmp_path / "project"), region="large", points_crs="native")),
    ):
        summary = mission.plan_route(request, *ends, Settings(vehicle="tractor"), tmp_path / out)
        assert 0 < summary["tiles_read"] < summary["tiles_total"]
        routes.append((tmp_path / out / "route.geojson").read_bytes())
    assert routes[0] == routes[1]


def test_the_same_source_twice_is_no_change(tmp_path: Path, hills: Path, capsys: pytest.CaptureFixture[str]) -> None:
    soil = tangled(tmp_path)
    shape = write_vector(tmp_path / "zones.shp", [block(3, 3, 5, 5)], ["lake"], driver="ESRI Shapefile")
    csv = tmp_path / "readings.csv"
    csv.write_text(f"x,y,ci_5cm,ci_10cm,ci_15cm\n{WEST + 99},{NORTH - 99},300,340,390\n", encoding="utf-8")
    ground = ("--store", str(tmp_path / "project"), "--region", "hills")
    for what, source in (("dem", hills), ("soil", soil), ("zones", shape), ("readings", csv)):
        first, again = (commands.run_here(capsys, "import", what, str(source), *ground, "--json") for _ in range(2))
        assert (first.code, first.answer["status"]) == (0, "done"), first.err
        assert (again.code, again.answer["status"]) == (0, "no_change"), again.err
    with open_store(tmp_path / "project") as store:
        changes = [(change.kind, change.subject) for change in store.changes("hills")]
        assert store.readings("hills")[0].author
        assert store.readings("hills")[0].time.startswith("20")
    assert changes == [
        ("region", "hills"), ("layer", "elevation"), ("layer", "soil"), ("layer", "zones"), ("readings", ""),
    ]  # fmt: skip
    # The attributes of a shapefile lie in a file beside it.
    write_vector(tmp_path / "zones.shp", [block(3, 3, 5, 5)], ["pond"], driver="ESRI Shapefile")
    assert commands.run_here(capsys, "import", "zones", str(shape), *ground, "--json").answer["status"] == "done"
    # Another cell size is another map, and another map is another region.
    refused = commands.run_here(capsys, "import", "dem", str(hills), "--cell-size", "20", *ground, "--json")
    assert (refused.code, refused.answer["kind"]) == (4, "region_conflict")


def test_an_import_that_was_killed_goes_on(tmp_path: Path) -> None:
    dem = raster_files.write(tmp_path / "dem.tif", raster_files.hills(2500, 2600))
    words = ("import", "dem", str(dem), "--store", str(tmp_path / "project"), "--region", "r")
    began = commands.start(*words)
    journal = tmp_path / "project" / "staging" / "r.elevation" / "done"
    end = time.monotonic() + 60
    while time.monotonic() < end and began.poll() is None and not (journal.exists() and journal.stat().st_size):
        time.sleep(0.002)
    began.send_signal(signal.SIGKILL)
    began.communicate()
    assert journal.stat().st_size > 0
    done = commands.run(*words, "--json")
    assert done.answer["status"] == "done"
    with open_store(tmp_path / "project") as store:
        read = store.read_window("r", "elevation", Window(0, 0, 2500, 2600))
    np.testing.assert_array_equal(read, raster_files.hills(2500, 2600))
    assert not journal.exists()


def test_ctrl_c_keeps_what_was_done(tmp_path: Path) -> None:
    dem = raster_files.write(tmp_path / "dem.tif", raster_files.hills(1200, 300))
    calls = []

    def stop(stage: str, done: int, total: int) -> bool:
        calls.append((stage, done, total))
        return stage != "importing elevation" or done < 3

    with open_store(tmp_path / "project", create=True) as store:
        with pytest.raises(Exception, match="stopped") as told:
            import_elevation(store, "r", [str(dem)], on_progress=stop)
        assert getattr(told.value, "exit_code", 0) == 130
        assert store.region("r").layers == {}
        again: list[tuple[str, int, int]] = []

        def go_on(*words: Any) -> bool:
            again.append(words)
            return True

        import_elevation(store, "r", [str(dem)], on_progress=go_on)
        assert store.region("r").layers.keys() == {"elevation"}
    assert calls[-1] == ("importing elevation", 3, 5)
    assert ("importing elevation", 4, 5) in again


@pytest.mark.parametrize(
    ("words", "kind", "code"),
    [
        (["import", "soil", "{soil}", "--store", "{store}", "--region", "elsewhere"], "missing_region", 4),
        (["import", "soil", "{soil}", "--store", "{nowhere}", "--region", "r"], "store_unavailable", 4),
        (["import", "soil", "{soil}", "--soil-field", "no", "--store", "{store}", "--region", "r"], "soil_field", 4),
        (["import", "soil", "nothing.gpkg", "--store", "{store}", "--region", "r"], "missing_file", 4),
        (["import", "dem", "nothing.tif", "--store", "{store}", "--region", "r"], "missing_file", 4),
        (["import", "dem", "{soil}", "--store", "{store}", "--region", "r"], "unreadable_file", 4),
        (["import", "zones", "{away}", "--store", "{store}", "--region", "r"], "no_overlap", 4),
        (["import", "zones", "{bare}", "--store", "{store}", "--region", "r"], "missing_crs", 4),
        (["import", "readings", "{csv}", "--store", "{store}", "--region", "r"], "outside_grid", 2),
        (["import", "dem", "{dem}", "--store", "{store}"], "usage", 2),
        (["import", "dem", "{dem}", "--store", "{store}", "--region", ""], "invalid_parameter", 2),
        (["plan", "--store", "{store}", "--start", "1,1", "--goal", "2,2"], "usage", 2),
        (["plan", "--region", "r", "--start", "1,1", "--goal", "2,2"], "usage", 2),
        (["plan", "--start", "1,1", "--goal", "2,2"], "usage", 2),
        (
            ["plan", "--store", "{store}", "--region", "r", "--soil", "{soil}", "--start", "1,1", "--goal", "2,2"],
            "usage",
            2,
        ),
        (["plan", "--store", "{store}", "--region", "q", "--start", "1,1", "--goal", "2,2"], "missing_region", 4),
        (["plan", "--store", "{nowhere}", "--region", "q", "--start", "1,1", "--goal", "2,2"], "store_unavailable", 4),
    ],
)
def test_what_cannot_be_is_refused_in_plain_words(
    tmp_path: Path, hills: Path, capsys: pytest.CaptureFixture[str], words: list[str], kind: str, code: int
) -> None:
    with open_store(tmp_path / "project", create=True) as store:
        import_elevation(store, "r", [str(hills)])
    csv = tmp_path / "far.csv"
    csv.write_text("x,y,ci_5cm\n1,1,300\n", encoding="utf-8")
    names = {
        "soil": tangled(tmp_path),
        "store": tmp_path / "project",
        "nowhere": tmp_path / "nowhere",
        "away": write_vector(tmp_path / "away.gpkg", [block(900, 900, 3, 3)], ["x"]),
        "bare": write_vector(tmp_path / "bare.shp", [block(3, 3, 3, 3)], ["x"], crs=None, driver="ESRI Shapefile"),
        "csv": csv,
        "dem": hills,
    }
    answer = commands.run_here(capsys, *(word.format(**names) for word in words), "--json")
    assert (answer.code, answer.answer["kind"]) == (code, kind), answer.out
    assert answer.answer["remedy"]


def test_soil_in_a_store_is_that_of_the_file(tmp_path: Path, hills: Path) -> None:
    soil = tangled(tmp_path)
    with open_elevation([str(hills)]) as source:
        frame = source.frame
    expected = read_soil(str(soil), frame, field="label")
    with open_store(tmp_path / "project", create=True) as store:
        import_elevation(store, "r", [str(hills)])
        done = import_soil(store, "r", str(soil), field="label")
        layer = store.soil_layer("r", Window(0, 0, ROWS, COLUMNS))
        pieces = list(store.soil_polygons("r"))
    assert layer is not None
    np.testing.assert_array_equal(layer.codes, expected.codes)
    assert layer.report == expected.report
    assert done["left_out"] == 1
    assert [piece.cat for piece in pieces] == [1, 2, 3, 4, 5, 6]
    assert pieces[0].attributes == {"label": "loamy sand", "cat": 1}
    assert all(shapely.is_valid(shapely.from_wkb(piece.wkb)) for piece in pieces)
    assert {shapely.from_wkb(piece.wkb).geom_type for piece in pieces} <= {"Polygon", "MultiPolygon"}


def test_readings_change_the_next_plan(tmp_path: Path, hills: Path) -> None:
    soil = write_vector(tmp_path / "clay.gpkg", [block(0, 0, ROWS, COLUMNS)], ["clay"])
    csv = tmp_path / "readings.csv"
    lines = [f"{WEST + (8 + n % 10 * 8) * CELL},{NORTH - (8 + n // 10 * 18) * CELL},12,12,12" for n in range(40)]
    csv.write_text("\n".join(["x,y,ci_5cm,ci_10cm,ci_15cm", *lines]) + "\n", encoding="utf-8")
    with open_store(tmp_path / "project", create=True) as store:
        import_elevation(store, "r", [str(hills)])
        import_soil(store, "r", str(soil))
    words = (
        "plan", "--store", str(tmp_path / "project"), "--region", "r", *NATIVE, "--start", START, "--goal", GOAL,
        "--out", str(tmp_path / "out"), "--json",
    )  # fmt: skip
    before = commands.run(*words)
    assert (before.code, before.answer["status"]) == (0, "route_found"), before.out
    ranks = (tmp_path / "out" / "rank.tif").read_bytes()
    with open_store(tmp_path / "project") as store:
        filed = import_readings(store, "r", str(csv), points_crs="native", author="me", instrument="CP-17", error=0.2)
        assert filed["new"] == 40
    after = commands.run(*words)
    # Ground around the readings is closed; far from any the map's word stands.
    assert (tmp_path / "out" / "rank.tif").read_bytes() != ranks
    assert "Soil is believed after 40 readings of the store." in after.answer["notes"]
    with open_store(tmp_path / "project") as store:
        assert store.withdraw("r", "the cone was worn", instrument="CP-17") == 40
    again = commands.run(*words)
    assert again.answer["cost"] == before.answer["cost"]
    assert again.answer["notes"] == before.answer["notes"]
    assert (tmp_path / "out" / "rank.tif").read_bytes() == ranks


def test_zones_of_a_store_are_not_entered(tmp_path: Path, hills: Path) -> None:
    # A wall across the way with one gate in it.
    walls = [block(40, 0, 1, 70), block(40, 73, 1, 17)]
    zones = write_vector(
        tmp_path / "zones.geojson", walls, ["west wall", "east wall"], driver="GeoJSON", crs="EPSG:32616"
    )
    out = tmp_path / "out"
    with open_store(tmp_path / "project", create=True) as store:
        import_elevation(store, "r", [str(hills)])
        import_zones(store, "r", str(zones))
        assert [zone.attributes["label"] for zone in store.zones("r")] == ["west wall", "east wall"]
    done = commands.run(
        "plan", "--store", str(tmp_path / "project"), "--region", "r", *NATIVE, "--start", START, "--goal", GOAL,
        "--out", str(out), "--json", "--keep",
    )  # fmt: skip
    assert done.answer["status"] == "route_found", done.out
    with open_elevation([str(hills)]) as source:
        frame = source.frame
    route = json.loads((out / "route.geojson").read_text(encoding="utf-8"))
    points = np.array([point[:2] for leg in route["features"] for point in leg["geometry"]["coordinates"]])
    x, y = frame.from_lonlat(points[:, 0], points[:, 1])
    line = shapely.LineString(np.column_stack([x, y]))
    assert not any(shapely.intersects(line, shapely.buffer(wall, -0.1)) for wall in walls)
    assert shapely.intersects(line, block(40, 70, 1, 3))
    # What was found is filed.
    with open_store(tmp_path / "project") as store, rasterio.open(out / "rank.tif") as ranks:
        kept = store.read_window("r", f"rank of {done.answer['vehicle']}", Window(0, 0, ROWS, COLUMNS))
        np.testing.assert_array_equal(kept, ranks.read(1))
        (filed,) = store.routes("r")
        nests = store.read_window("r", f"nests of {done.answer['vehicle']}", Window(0, 0, ROWS, COLUMNS))
        assert store.changes("r")[-1].kind == "route"
    assert nests.max() == done.answer["nest_count"]
    way = shapely.from_wkb(filed.wkb)
    assert shapely.hausdorff_distance(way, line) < 0.01
    assert filed.summary["length_m"] == done.answer["length_m"]


CHILD = """
import sys
from swathe.store import open_store
from swathe.store.imports import import_elevation, import_soil
with open_store(sys.argv[1], create=True) as store:
    import_elevation(store, "r", [sys.argv[2]])
    print(import_soil(store, "r", sys.argv[3], field="label")["features"])
with open("/proc/self/status") as status:
    print(next(line for line in status if line.startswith("VmHWM")).split()[1])
"""


def test_memory_stays_flat(tmp_path: Path) -> None:
    """Four times the cells and ten times the polygons take hardly more memory."""
    peaks = {}
    for side, count in ((1280, 5_000), (2560, 50_000)):
        dem = raster_files.write(
            tmp_path / f"{side}.tif", raster_files.hills(side, side), tiled=True, blockxsize=256, blockysize=256
        )
        across = int(count**0.5) + 1
        step = side / across
        shapes = [block(n // across * step, n % across * step, step, step) for n in range(count)]
        soil = write_vector(tmp_path / f"{side}.gpkg", shapes, ["sand", "clay"] * (count // 2))
        done = subprocess.run(
            [sys.executable, "-c", CHILD, tmp_path / f"p{side}", dem, soil],
            capture_output=True, text=True, check=True, env=os.environ,
        )  # fmt: skip
        features, peak = map(int, done.stdout.split())
        assert features == count
        peaks[side] = peak // 1024
    assert peaks[2560] < peaks[1280] + 80, peaks
    assert peaks[2560] < 450, peaks


def test_a_soil_without_a_class_that_is_known_is_refused(tmp_path: Path, hills: Path) -> None:
    soil = write_vector(tmp_path / "odd.gpkg", [block(0, 0, 9, 9)], ["xyzzy"])
    with open_store(tmp_path / "project", create=True) as store:
        import_elevation(store, "r", [str(hills)])
        with pytest.raises(Exception, match="xyzzy") as told:
            import_soil(store, "r", str(soil), field="label")
        assert getattr(told.value, "kind", "") == "soil_field"
        legend = tmp_path / "legend.csv"
        legend.write_text("label,class\nxyzzy,silt\n", encoding="utf-8")
        import_soil(store, "r", str(soil), field="label", legend=str(legend))
        assert store.soil_window("r", Window(0, 0, 3, 3))[0, 0] == SoilClass.SILT


def test_regions_are_listed_with_their_origin_and_readings_withdrawn(
    tmp_path: Path, hills: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    csv = tmp_path / "readings.csv"
    csv.write_text(f"x,y,class\n{WEST + 99},{NORTH - 99},clay\n{WEST + 999},{NORTH - 99},rock\n", encoding="utf-8")
    store = ("--store", str(tmp_path / "project"))
    with open_store(tmp_path / "project", create=True) as opened:
        assert commands.run_here(capsys, "regions", *store).out.endswith("has no regions yet.\n")
        import_elevation(opened, "tal", [str(hills)], licence="dl-de/by-2-0", author="Ada")
        import_readings(opened, "tal", str(csv), points_crs="native", author="Ada", instrument="CP-17")
    shown = commands.run_here(capsys, "regions", *store).out
    assert "tal: 80 x 90 cells of 30 m, WGS 84 / UTM zone 16N, 2 readings" in shown
    assert "hills.tif, 20" in shown
    assert "by Ada, dl-de/by-2-0" in shown
    region = ("--region", "tal", "--reason", "worn", "--json")
    for words, count in ((("--instrument", "CP-16"), 0), (("--instrument", "CP-17"), 2), (("--author", "Ada"), 0)):
        answer = commands.run_here(capsys, "withdraw", *store, *region, *words).answer
        assert (answer["withdrawn"], answer["status"]) == (count, "done" if count else "no_change")
    (listed,) = commands.run_here(capsys, "regions", *store, "--json").answer["regions"]
    assert listed["readings"] == 0
    assert listed["layers"][0]["inputs"][0]["name"] == "hills.tif"
    assert commands.run_here(capsys, "withdraw", *store, *region).code == 2
