"""What a run leaves behind: GeoJSON that the standard and GDAL accept, and a folder that is never half new."""

from __future__ import annotations

import errno
import json
import math
import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyogrio.raw
import pyproj
import pytest
import shapely

from swathe.errors import OutputError
from swathe.export.folder import (
    DRIVE_PICTURES,
    FIGURES,
    OUR_FILES,
    SUMMARY,
    finite,
    require_ours,
    require_ours_or_runs,
    run_folder,
    to_json,
    write_text,
)
from swathe.export.geojson import nest_collection, route_collection
from swathe.grid import Cell, GridGeometry
from swathe.io.crs import Frame
from swathe.nest import Nests, exact_nests, nest_graph, outlines
from swathe.planner import Route, plan
from swathe.rank import Region, rank_map
from swathe.vehicle import load_vehicle
from worlds import smooth_hills

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

ORIGIN = {"version": "0.1.0", "seed": 7, "inputs": []}
UTM16 = "EPSG:32616"
MOON = "IAU_2015:30110"


def hills(west_m: float = 740_000.0, north_m: float = 4_050_000.0) -> Region:
    elevation = smooth_hills(8, 70, 90, height_m=190, cell_size_m=30, wave_m=1400)
    return Region(GridGeometry(70, 90, 30.0, west_m, north_m), elevation, load_vehicle("tractor"))


def driven(region: Region) -> tuple[Route, Nests]:
    nests = exact_nests(rank_map(region).rank)
    cells = np.argwhere(nests.labels == 1 + np.argmax(nests.sizes))
    start, goal = (region.geometry.position_of(Cell(*map(int, cells[place]))) for place in (0, -1))
    answer = plan(region, start, goal, method="exact")
    assert answer.route is not None
    return answer.route, nests


def nests_of(region: Region, nests: Nests, frame: Frame) -> dict[str, Any]:
    found = outlines(nests, region.geometry)
    return nest_collection(nests, found, nest_graph(nests, region.geometry), 900.0, frame=frame, origin=ORIGIN)


def check_position(position: list[float]) -> None:
    longitude, latitude = position
    assert -180 <= longitude <= 180
    assert -90 <= latitude <= 90
    assert [round(value, 8) for value in position] == position


def check_ring(ring: list[list[float]], *, exterior: bool) -> None:
    for position in ring:
        check_position(position)
    assert len(ring) >= 4
    assert ring[0] == ring[-1]
    assert shapely.LinearRing(ring).is_ccw == exterior


def check_rfc_7946(text: str) -> dict[str, Any]:
    """Check a FeatureCollection in longitude and latitude by the words of RFC 7946 and return it."""
    collection: dict[str, Any] = json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert collection["type"] == "FeatureCollection"
    # Sections 4 and 7.1.
    assert not {"crs", "coordinates", "geometries", "geometry", "properties"} & set(collection)
    for feature in collection["features"]:
        assert set(feature) == {"type", "geometry", "properties"}
        assert feature["type"] == "Feature"
        kind, coordinates = feature["geometry"]["type"], feature["geometry"]["coordinates"]
        assert set(feature["geometry"]) == {"type", "coordinates"}
        if kind == "LineString":
            assert len(coordinates) >= 2
            for position in coordinates:
                check_position(position)
        else:
            assert kind in ("Polygon", "MultiPolygon")
            for polygon in [coordinates] if kind == "Polygon" else coordinates:
                for number, ring in enumerate(polygon):
                    check_ring(ring, exterior=number == 0)
    return collection


def read_with_gdal(path: Path) -> tuple[dict[str, Any], NDArray[np.object_], dict[str, NDArray[Any]]]:
    meta, _, geometry, columns = pyogrio.raw.read(path)
    return meta, shapely.from_wkb(geometry), dict(zip(meta["fields"], columns, strict=True))


@pytest.mark.parametrize(
    ("crs", "west_m", "north_m"), [(UTM16, 740_000.0, 4_050_000.0), ("EPSG:32734", 255_000.0, 6_240_000.0)]
)
def test_a_route_is_one_line_per_leg_where_it_is(tmp_path: Path, crs: str, west_m: float, north_m: float) -> None:
    region = hills(west_m, north_m)
    route, _ = driven(region)
    text = to_json(route_collection(route, Frame(region.geometry, crs), ORIGIN))
    collection = check_rfc_7946(text)
    assert collection["swathe"] == ORIGIN
    (tmp_path / "route.geojson").write_text(text, encoding="utf-8")
    meta, lines, columns = read_with_gdal(tmp_path / "route.geojson")
    assert meta["crs"] == "EPSG:4326"
    assert len(lines) == len(route.legs) > 3
    back = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    for line, leg in zip(lines, route.legs, strict=True):
        x_m, y_m = back.transform(*np.transpose(shapely.get_coordinates(line)))
        # Eight decimals of a degree are a millimetre.
        assert np.allclose(np.column_stack([x_m, y_m]), [leg.start, leg.end], atol=2e-3)
    assert columns["leg"].tolist() == list(range(1, len(route.legs) + 1))
    for name in ("length_m", "time_s", "grade_max", "grade_min", "side_slope_max", "climb_m", "descent_m", "speed_mps"):
        assert np.allclose(columns[name], [getattr(leg, name) for leg in route.legs], atol=5e-4), name
    assert columns["soil"].tolist() == ["unknown"] * len(route.legs)
    assert all(columns["reason"])


def test_nests_are_polygons_largest_first_with_their_cells(tmp_path: Path) -> None:
    region = hills()
    suitable = np.random.default_rng(0).random(region.geometry.shape) < 0.8
    nests = exact_nests(np.where(suitable, 8, 1), contact="corner")
    frame = Frame(region.geometry, UTM16)
    text = to_json(nests_of(region, nests, frame))
    collection = check_rfc_7946(text)
    (tmp_path / "nests.geojson").write_text(text, encoding="utf-8")
    _, shapes, columns = read_with_gdal(tmp_path / "nests.geojson")
    assert len(shapes) == nests.count > 3
    assert {feature["geometry"]["type"] for feature in collection["features"]} == {"Polygon", "MultiPolygon"}
    assert columns["cells"].tolist() == sorted(nests.sizes.tolist(), reverse=True)
    assert shapely.is_valid(shapes).all()
    back = pyproj.Transformer.from_crs("EPSG:4326", UTM16, always_xy=True).transform
    for shape, nest, area_m2 in zip(shapes, columns["nest"], columns["area_m2"], strict=True):
        in_metres = shapely.transform(shape, lambda points: np.column_stack(back(*points.T)))
        assert area_m2 == nests.sizes[nest - 1] * 900
        assert in_metres.area == pytest.approx(area_m2, rel=1e-4)
    for feature in collection["features"]:
        facts = feature["properties"]
        assert facts["nearest_nest"] != facts["nest"]
        assert facts["gap_m"] > 0


def test_one_nest_alone_has_no_neighbour_and_no_route_has_no_feature() -> None:
    region = hills()
    nests = exact_nests(np.full(region.geometry.shape, 8))
    frame = Frame(region.geometry, UTM16)
    (feature,) = check_rfc_7946(to_json(nests_of(region, nests, frame)))["features"]
    assert (feature["properties"]["nearest_nest"], feature["properties"]["gap_m"]) == (None, None)
    assert check_rfc_7946(to_json(route_collection(None, frame, ORIGIN)))["features"] == []


@pytest.mark.parametrize(("crs", "named"), [(None, "local metric frame"), (MOON, "Moon")])
def test_a_frame_without_longitude_and_latitude_keeps_its_metres_and_says_so(crs: str | None, named: str) -> None:
    region = hills(0.0, 2100.0)
    route, nests = driven(region)
    frame = Frame(region.geometry, crs)
    for collection in (route_collection(route, frame, ORIGIN), nests_of(region, nests, frame)):
        words = " ".join(value for value in collection.values() if isinstance(value, str))
        assert named in words
        assert "not longitude and latitude" in words
    lines = route_collection(route, frame, ORIGIN)["features"]
    assert np.allclose(lines[0]["geometry"]["coordinates"], [route.legs[0].start, route.legs[0].end], atol=1e-3)


def test_the_note_about_the_frame_has_no_reserved_name() -> None:
    route, _ = driven(hills(0.0, 2100.0))
    collection = route_collection(route, Frame(hills().geometry, None), ORIGIN)
    assert not {"crs", "coordinates", "geometries", "geometry", "properties"} & set(collection)


def test_json_has_no_numbers_that_are_not_finite_and_keeps_words() -> None:
    value = {"a": math.nan, "b": [math.inf, -math.inf, 1.5, 2], "c": (True, None, "Ebergötzen"), 4: {"d": 1e308}}
    assert finite(value) == {"a": None, "b": [None, None, 1.5, 2], "c": [True, None, "Ebergötzen"], "4": {"d": 1e308}}
    text = to_json(value)
    assert json.loads(text) == finite(value)
    assert "Ebergötzen" in text
    assert text.endswith("}\n")


# The folder -----------------------------------------------------------------------------------------------------------


def summary(run: str) -> str:
    return to_json({"command": "plan", "version": "0.1.0", "inputs": [], "run": run})


def write_run(folder: Path, run: str, names: tuple[str, ...]) -> None:
    for name in names:
        write_text(folder / name, f"{name} of {run}\n")
    write_text(folder / SUMMARY, summary(run))


OLD = ("map.png", "nests.geojson", "report.html")
NEW = ("map.png", "nests.geojson", "route.geojson")


def state_of(out: Path) -> dict[str, str]:
    return {entry.name: entry.read_text(encoding="utf-8") for entry in out.iterdir() if entry.is_file()}


def state_after(run: str, names: tuple[str, ...]) -> dict[str, str]:
    return {**{name: f"{name} of {run}\n" for name in names}, SUMMARY: summary(run)}


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """A folder with an earlier run."""
    out = tmp_path / "out"
    with run_folder(out) as folder:
        write_run(folder, "old", OLD)
    assert state_of(out) == state_after("old", OLD)
    return out


def test_a_run_replaces_the_files_of_the_earlier_one(old: Path) -> None:
    with run_folder(old) as folder:
        assert folder.parent == old
        write_run(folder, "new", NEW)
        assert state_of(old) == state_after("old", OLD)
    assert state_of(old) == state_after("new", NEW)
    assert {entry.name for entry in old.iterdir()} == {*NEW, SUMMARY}


class BrokenError(Exception):
    """Anything that a run may raise."""


def run_that_fails(out: Path, failure: type[BaseException]) -> None:
    with run_folder(out) as folder:
        write_run(folder, "new", NEW)
        raise failure("half way")


@pytest.mark.parametrize("failure", [BrokenError, KeyboardInterrupt, SystemExit, OutputError, MemoryError])
def test_a_failing_run_leaves_the_old_folder_and_nothing_of_its_own(old: Path, failure: type[BaseException]) -> None:
    with pytest.raises(failure):
        run_that_fails(old, failure)
    assert state_of(old) == state_after("old", OLD)
    assert {entry.name for entry in old.iterdir()} == {*OLD, SUMMARY}


@pytest.mark.parametrize("failure", [BrokenError, KeyboardInterrupt])
def test_a_failing_run_leaves_no_folder_where_none_was(tmp_path: Path, failure: type[BaseException]) -> None:
    with pytest.raises(failure):
        run_that_fails(tmp_path / "deep" / "out", failure)
    assert list(tmp_path.iterdir()) == []


MOVES = len(OLD) + len(NEW) + 2


@pytest.mark.parametrize("fatal", range(MOVES))
@pytest.mark.parametrize("failure", [KeyboardInterrupt, OSError(errno.ENOSPC, "No space left on device")], ids=repr)
def test_a_failure_while_files_are_moved_puts_the_old_ones_back(
    old: Path, monkeypatch: pytest.MonkeyPatch, fatal: int, failure: Any
) -> None:
    moves = iter(range(1000))
    move = Path.replace

    def counted(self: Path, target: Path) -> Path:
        if next(moves) == fatal:
            raise failure
        return move(self, target)

    monkeypatch.setattr(Path, "replace", counted)
    with pytest.raises((KeyboardInterrupt, OutputError)), run_folder(old) as folder:
        write_run(folder, "new", NEW)
    monkeypatch.undo()
    assert state_of(old) == state_after("old", OLD)
    assert {entry.name for entry in old.iterdir()} == {*OLD, SUMMARY}


KILLED = """
import os, signal, sys
from pathlib import Path
from swathe.export.folder import run_folder, write_text
out, fatal, move, moves = Path(sys.argv[1]), int(sys.argv[2]), Path.replace, iter(range(1000))
def counted(self, target):
    if next(moves) == fatal:
        os.kill(os.getpid(), signal.SIGKILL)
    return move(self, target)
Path.replace = counted
with run_folder(out) as folder:
    for number, argument in enumerate(sys.argv[3:]):
        name, _, text = argument.partition(":")
        if fatal < 0 and number == 2:
            (folder / name).write_text("half of ")
            os.kill(os.getpid(), signal.SIGKILL)
        write_text(folder / name, text)
"""


@pytest.mark.parametrize("fatal", range(-1, MOVES + 1))
def test_a_run_that_is_killed_leaves_a_folder_that_the_next_one_accepts(old: Path, fatal: int) -> None:
    files = [f"{name}:{text}" for name, text in state_after("new", NEW).items()]
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(old), str(fatal), *files],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        capture_output=True,
        text=True,
        check=False,
    )
    finished = fatal == MOVES
    assert done.returncode == (0 if finished else -signal.SIGKILL), done.stderr
    left = state_of(old)
    if SUMMARY in left:
        # A folder with a summary is complete.
        assert left in (state_after("old", OLD), state_after("new", NEW))
    assert all(text.endswith("\n") for text in left.values())
    require_ours(old)
    with run_folder(old) as folder:
        write_run(folder, "next", OLD)
    assert state_of(old) == state_after("next", OLD)
    assert {entry.name for entry in old.iterdir()} == {*OLD, SUMMARY}


def test_the_part_of_a_run_that_still_runs_is_left_alone(old: Path) -> None:
    with run_folder(old) as slow:
        write_run(slow, "slow", OLD)
        with run_folder(old) as quick:
            write_run(quick, "quick", NEW)
        assert slow.is_dir()
        assert state_of(old) == state_after("quick", NEW)
    assert state_of(old) == state_after("slow", OLD)


@pytest.mark.parametrize("alien", ["notes.txt", "route.geojson.bak", ".hidden", "photos/"])
def test_a_folder_with_anything_else_in_it_is_refused_untouched(old: Path, alien: str) -> None:
    (old / alien).mkdir() if alien.endswith("/") else (old / alien).write_text("mine", encoding="utf-8")
    before = sorted(old.iterdir())
    with pytest.raises(OutputError, match=alien.rstrip("/")), run_folder(old):
        pytest.fail("the block must not run")
    assert sorted(old.iterdir()) == before


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '"command version inputs"', "3", "null", '{"command": 1}', "[" * 100_000, "\udcff"]
)
def test_a_summary_of_somebody_else_is_refused_untouched(tmp_path: Path, text: str) -> None:
    (tmp_path / SUMMARY).write_bytes(text.encode("utf-8", errors="surrogateescape"))
    with pytest.raises(OutputError, match="not ours"), run_folder(tmp_path):
        pytest.fail("the block must not run")
    assert (tmp_path / SUMMARY).read_bytes() == text.encode("utf-8", errors="surrogateescape")


def test_our_names_without_a_summary_are_somebody_elses(tmp_path: Path) -> None:
    (tmp_path / "map.png").write_text("my holiday", encoding="utf-8")
    with pytest.raises(OutputError, match=r"map\.png"), run_folder(tmp_path):
        pytest.fail("the block must not run")


def test_an_empty_folder_and_a_missing_one_are_accepted(tmp_path: Path) -> None:
    for out in (tmp_path, tmp_path / "a" / "b"):
        if out.exists():
            assert list(out.iterdir()) == []
        with run_folder(out) as folder:
            write_run(folder, "new", NEW)
        assert state_of(out) == state_after("new", NEW)
        for entry in out.iterdir():
            entry.unlink()


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file", encoding="utf-8")
    with pytest.raises(OutputError, match="is a file"), run_folder(tmp_path / "out"):
        pytest.fail("the block must not run")
    with pytest.raises(OutputError, match="cannot be written"), run_folder(tmp_path / "out" / "below"):
        pytest.fail("the block must not run")
    assert (tmp_path / "out").read_text(encoding="utf-8") == "a file"


@contextmanager
def as_nobody() -> Iterator[None]:
    """Drop the rights of root, who may write everywhere."""
    me = os.geteuid()
    if me == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        if me == 0:
            os.seteuid(0)


@pytest.mark.parametrize("mode", [0o555, 0o000])
@pytest.mark.parametrize("name", [".", "new"])
def test_a_folder_that_may_not_be_written_is_refused(tmp_path: Path, name: str, mode: int) -> None:
    locked = tmp_path / "locked"
    locked.mkdir(mode=mode)
    locked.chmod(mode)
    try:
        refused = pytest.raises(OutputError, match="cannot be written: Permission denied")
        with as_nobody(), refused, run_folder(locked / name):
            pytest.fail("the block must not run")
    finally:
        locked.chmod(0o755)
    assert list(locked.iterdir()) == []


def run_on_a_full_disk(out: Path) -> None:
    with run_folder(out) as folder:
        write_text(folder / "map.png", "fits\n")
        (folder / "nests.geojson").symlink_to("/dev/full")
        write_text(folder / "nests.geojson", "does not fit\n")


def test_a_full_disk_is_said_and_leaves_the_old_folder(old: Path) -> None:
    with pytest.raises(OutputError, match="No space left on device") as caught:
        run_on_a_full_disk(old)
    assert str(old) in caught.value.message
    assert ".swathe-part-" not in caught.value.message
    assert "free space" in caught.value.remedy
    assert state_of(old) == state_after("old", OLD)
    assert {entry.name for entry in old.iterdir()} == {*OLD, SUMMARY}


def test_text_is_written_with_plain_line_ends_and_names_that_are_no_text(tmp_path: Path) -> None:
    write_text(tmp_path / "x", "Höhe\nname\udcff\n")
    assert (tmp_path / "x").read_bytes() == "Höhe\nname\\udcff\n".encode()


def test_a_demo_folder_holds_runs_and_nothing_else(tmp_path: Path) -> None:
    require_ours_or_runs(tmp_path / "missing", ("plan",))
    (tmp_path / "plan").mkdir()
    require_ours_or_runs(tmp_path, ("plan", "drive"))
    (tmp_path / "thesis.tex").write_text("years", encoding="utf-8")
    with pytest.raises(OutputError, match=r"thesis\.tex"):
        require_ours_or_runs(tmp_path, ("plan", "drive"))
    with pytest.raises(OutputError, match="is a file"):
        require_ours_or_runs(tmp_path / "thesis.tex", ("plan",))


def test_every_file_of_a_run_is_one_that_the_design_names() -> None:
    expected = {"summary.json", "route.geojson", "nests.geojson", "rank.tif", "map.png", "profile.png", "report.html"}
    expected |= {"drivable.geojson", "trials.csv", "trials.png", *(f"worst-{number}.mcap" for number in range(1, 11))}
    animation = {"animation.gif", "animation.html"}
    drive = {"run.mcap", *DRIVE_PICTURES}
    assert expected | animation | drive | {*FIGURES, "index.html"} == OUR_FILES
