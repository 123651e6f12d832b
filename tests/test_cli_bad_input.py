"""Whatever is wrong with the input ends in one or two plain lines, the right exit code, and nothing written."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from affine import Affine

import commands
import raster_files
from commands import GOAL, START, way

if TYPE_CHECKING:
    from collections.abc import Callable

    from commands import Finished

    Words = tuple[str, ...]
    Case = tuple[Callable[[Path], Words], int, str, tuple[str, ...]]


def raster(folder: Path, name: str = "odd.tif", bands: object = None, **options: object) -> Path:
    heights = raster_files.hills(80, 90) if bands is None else bands
    return raster_files.write(folder / name, heights, **options)  # type: ignore[arg-type]


def text(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def truncated(folder: Path) -> Path:
    whole = commands.hills(folder).read_bytes()
    return text(folder, "cut.tif", whole[: len(whole) // 2])


def huge(folder: Path) -> Path:
    """Write 60,000 x 60,000 cells that take almost no room, heights known nowhere until they are written."""
    import rasterio

    path = folder / "huge.tif"
    place = Affine(1, 0, 740_000, 0, -1, 4_050_000)
    options = {"tiled": True, "blockxsize": 512, "blockysize": 512, "SPARSE_OK": True, "BIGTIFF": "YES"}
    with rasterio.open(
        path, "w", driver="GTiff", height=60_000, width=60_000, count=1, dtype="int16", crs="EPSG:32616",
        transform=place, **options,
    ):  # fmt: skip
        pass
    return path


def grey(folder: Path) -> Path:
    """Write a grey picture that lies nowhere."""
    return raster(folder, "grey.png", np.zeros((60, 60), np.uint8), crs=None, transform=None, driver="PNG")


def soil_far_away(folder: Path) -> Path:
    codes = np.ones((20, 20), dtype=np.uint8)
    return raster(folder, "soil.tif", codes, transform=Affine(30, 0, 100_000, 0, -30, 4_000_000))


def soil_vector(folder: Path, labels: tuple[str, ...] = ("sand", "clay")) -> Path:
    """Write two polygons side by side that cover the hills."""
    import pyogrio.raw
    import shapely

    west, north, middle = raster_files.WEST, raster_files.NORTH, raster_files.WEST + 1350
    boxes = [shapely.box(west, north - 2400, middle, north), shapely.box(middle, north - 2400, west + 2700, north)]
    path = folder / "soil.gpkg"
    pyogrio.raw.write(
        path, np.array([shapely.to_wkb(box) for box in boxes], dtype=object),
        [np.array([1, 2]), np.array(labels, dtype=object)], np.array(["cat", "label"]),
        layer="soils", geometry_type="Polygon", crs=raster_files.UTM16,
    )  # fmt: skip
    return path


def on_hills(*more: str) -> Callable[[Path], Words]:
    return lambda folder: way(commands.hills(folder), *more)


def between(start: str, goal: str, *more: str) -> Callable[[Path], Words]:
    return lambda folder: ("plan", "--dem", str(commands.hills(folder)), "--start", start, "--goal", goal, *more)


def vehicle_file(content: str) -> Callable[[Path], Words]:
    return lambda folder: way(commands.hills(folder), "--vehicle", str(text(folder, "rover.toml", content)))


# name -> the command, its exit code, its kind, and what its two lines must say.
CASES: dict[str, Case] = {
    "missing elevation": (lambda _: way("no.tif"), 4, "missing_file", ("no.tif", "path")),
    "missing soil": (on_hills("--soil", "no.gpkg"), 4, "missing_file", ("no.gpkg",)),
    "missing legend": (
        lambda folder: way(commands.hills(folder), "--soil", str(soil_vector(folder)), "--soil-legend", "no.csv"),
        4, "missing_file", ("no.csv",),
    ),
    "missing vehicle file": (on_hills("--vehicle", "no/rover.toml"), 4, "missing_file", ("rover.toml",)),
    "truncated": (lambda folder: way(truncated(folder)), 4, "unreadable_file", ("cut.tif", "cut short")),
    "zero bytes": (lambda folder: way(text(folder, "nil.tif", b"")), 4, "unreadable_file", ("nil.tif", "empty")),
    "zero-byte soil": (
        lambda folder: way(commands.hills(folder), "--soil", str(text(folder, "nil.gpkg", b""))),
        4, "unreadable_file", ("nil.gpkg",),
    ),
    "no raster": (lambda folder: way(text(folder, "words.tif", "hello")), 4, "unreadable_file", ("words.tif",)),
    "no soil map": (
        lambda folder: way(commands.hills(folder), "--soil", str(text(folder, "words.gpkg", "hello"))),
        4, "unreadable_file", ("words.gpkg",),
    ),
    "empty folder": (way, 4, "missing_file", ("no raster",)),
    "colour picture": (
        lambda folder: way(raster(folder, bands=np.zeros((3, 60, 60), dtype=np.uint8))),
        4, "not_elevation", ("odd.tif", "3 bands"),
    ),
    "complex numbers": (
        lambda folder: way(raster(folder, bands=np.zeros((60, 60), dtype=np.complex64))),
        4, "not_elevation", ("odd.tif", "complex"),
    ),
    "no system": (
        lambda folder: way(raster(folder, crs=None, transform=None)),
        4, "missing_crs", ("odd.tif", "--crs", "--cell-size", "--height-range"),
    ),
    "grey picture without a scale": (
        lambda folder: way(grey(folder)), 4, "missing_crs", ("grey.png", "--cell-size", "--height-range"),
    ),
    "soil elsewhere": (
        lambda folder: way(commands.hills(folder), "--soil", str(soil_far_away(folder))),
        4, "no_overlap", ("soil.tif",),
    ),
    "all voids": (
        lambda folder: way(raster(folder, bands=np.full((60, 60), -9999, np.float32), nodata=-9999)),
        4, "all_void", ("odd.tif", "no known elevation"),
    ),
    "one row": (
        lambda folder: way(raster(folder, bands=np.zeros((1, 60), np.float32))),
        4, "too_small", ("odd.tif", "1 x 60"),
    ),
    "too few cells for the paper's groups": (
        lambda folder: way(raster(folder, bands=np.zeros((60, 20), np.float32)), "--profile", "paper"),
        4, "too_small", ("7 x 2", "--profile metric"),
    ),
    "far apart on a huge map": (
        lambda folder: way(huge(folder), from_to=("741000,4049000", "799000,3991000")),
        4, "too_large", ("huge.tif", "GB", "--bounds", "--cell-size"),
    ),
    "nests of a huge map": (
        lambda folder: ("nests", "--dem", str(huge(folder))), 4, "too_large", ("60,000 x 60,000", "--cell-size")
    ),
    "memory limit": (
        lambda folder: way(huge(folder), "--memory-limit", "0.001", from_to=("741000,4049000", "741100,4048000")),
        4, "too_large", ("1 MB can be used", "--bounds"),
    ),
    "memory limit of nothing": (on_hills("--memory-limit", "-1"), 2, "invalid_parameter", ("--memory-limit",)),
    "memory limit that is no number": (on_hills("--memory-limit", "nan"), 2, "invalid_parameter", ("--memory-limit",)),
    "tiny cells": (on_hills("--cell-size", "0.0001"), 4, "too_large", ("--cell-size",)),
    "cells larger than the map": (on_hills("--cell-size", "1e7"), 4, "too_small", ("hills.tif", "--cell-size")),
    "negative cells": (on_hills("--cell-size", "-5"), 2, "invalid_parameter", ("-5 m",)),
    "cells of nothing": (on_hills("--cell-size", "0"), 2, "invalid_parameter", ("0 m",)),
    "cells that are no number": (on_hills("--cell-size", "nan"), 2, "invalid_parameter", ("nan",)),
    "cells in words": (on_hills("--cell-size", "big"), 2, "usage", ("--cell-size", "swathe plan --help")),
    "one number": (between("5", "6,7"), 2, "usage", ("--start", "'5'", "--start=1,2")),
    "three numbers": (between("5,6", "6,7,8"), 2, "usage", ("--goal", "'6,7,8'")),
    "words for a point": (between("here,there", "6,7"), 2, "usage", ("--start", "'here,there'")),
    "not a finite point": (between("nan,1", "6,7"), 2, "usage", ("finite",)),
    "not a latitude": (between("740500,4049500", "5,5"), 2, "usage", ("longitude", "--points-crs")),
    "unknown system of points": (between("1,2", "3,4", "--points-crs", "EPSG:999999"), 4, "invalid_crs", ("999999",)),
    "unknown projection": (on_hills("--crs", "banana"), 4, "invalid_crs", ("banana",)),
    "projection in degrees": (on_hills("--crs", "EPSG:4326"), 4, "invalid_crs", ("metres",)),
    "unknown soil field": (
        lambda folder: way(commands.hills(folder), "--soil", str(soil_vector(folder)), "--soil-field", "texture"),
        4, "soil_field", ("texture", "cat", "label"),
    ),
    "soil that nobody understands": (
        lambda folder: way(
            commands.hills(folder), "--soil", str(soil_vector(folder, ("Qx1", "Qx2"))), "--soil-field", "label"
        ),
        4, "soil_field", ("Qx1", "--soil-legend"),
    ),
    "unknown vehicle": (on_hills("--vehicle", "tracktor"), 4, "invalid_vehicle", ("tracktor", "tractor")),
    "vehicle without figures": (vehicle_file('name = "rover"\n'), 4, "invalid_vehicle", ("rover.toml",)),
    "vehicle file that is no TOML": (vehicle_file("name = = 1\n"), 4, "invalid_vehicle", ("rover.toml", "line 1")),
    "empty vehicle file": (vehicle_file(""), 4, "unreadable_file", ("rover.toml",)),
    "unknown profile": (on_hills("--profile", "fast"), 2, "usage", ("--profile", "fast")),
    "unknown method": (on_hills("--method", "magic"), 2, "usage", ("--method", "magic")),
    "unknown option": (on_hills("--nonsense"), 2, "usage", ("--nonsense", "--help")),
    "no elevation": (lambda _: ("plan", "--start", "1,2", "--goal", "3,4"), 2, "usage", ("--dem",)),
    "unknown command": (lambda _: ("fly",), 2, "usage", ("fly", "swathe --help")),
    "heights upside down": (
        lambda folder: way(grey(folder), "--cell-size", "5", "--height-range", "200,100"),
        2, "invalid_parameter", ("200", "100"),
    ),
    "heights of heights": (on_hills("--height-range", "0,100"), 2, "invalid_parameter", ("--height-range",)),
    "bounds elsewhere": (on_hills("--bounds", "0,0,10,10"), 4, "no_overlap", ("0,0,10,10", "hills.tif")),
    "bounds inside out": (on_hills("--bounds", "9,0,8,1"), 2, "invalid_parameter", ("west,south,east,north",)),
    "bounds of three": (on_hills("--bounds", "1,2,3"), 2, "usage", ("--bounds", "4 numbers")),
    "no agents": (on_hills("--agents", "0"), 2, "invalid_parameter", ("agents",)),
    "no pellets": (on_hills("--pellets", "0"), 2, "invalid_parameter", ("pellet",)),
    "negative seed": (on_hills("--seed", "-1"), 2, "invalid_parameter", ("seed",)),
    "no threads": (on_hills("--threads", "0"), 2, "invalid_parameter", ("threads",)),
    "unknown moisture": (on_hills("--moisture", "soggy"), 2, "invalid_parameter", ("soggy", "wet")),
    "moisture below nothing": (on_hills("--moisture", "-4"), 2, "invalid_parameter", ("moisture",)),
    "unknown unknown soil": (on_hills("--unknown-soil", "cheese"), 2, "invalid_parameter", ("cheese", "gravel")),
    "weights beyond one": (on_hills("--weights", "0.9,0.9"), 2, "invalid_parameter", ("weights",)),
    "weights that are no numbers": (on_hills("--weights", "nan,nan"), 2, "invalid_parameter", ("weights",)),
    "width below nothing": (on_hills("--width", "-10"), 2, "invalid_parameter", ("width",)),
    "width that is no number": (on_hills("--width", "nan"), 2, "invalid_parameter", ("width",)),
    "sagitta of no number": (on_hills("--arc", "circle", "--sagitta", "nan"), 2, "invalid_parameter", ("sagitta",)),
    "grade below nothing": (on_hills("--paper-grade", "-1"), 2, "invalid_parameter", ("grade",)),
    "no server": (lambda _: way("http://127.0.0.1:9/dem.tif"), 4, "unreadable_file", ("dem.tif", "network")),
    "out is a file": (
        lambda folder: way(commands.hills(folder), "--out", str(text(folder, "notes.txt", "mine"))),
        4, "output", ("notes.txt", "--out"),
    ),
    "out lies below a file": (
        lambda folder: way(commands.hills(folder), "--out", str(text(folder, "notes.txt", "mine") / "run")),
        4, "output", ("notes.txt", "--out"),
    ),
    "out where nothing can be written": (on_hills("--out", "/proc/swathe/run"), 4, "output", ("/proc/swathe/run",)),
    "out with a name that is too long": (on_hills("--out", "n" * 300), 4, "output", ("--out",)),
    "report of nothing": (lambda folder: ("report", str(folder / "no")), 4, "missing_file", ("no",)),
    "report of a folder without a run": (lambda folder: ("report", str(folder)), 4, "missing_file", ("summary.json",)),
    "report of a broken summary": (
        lambda folder: ("report", str(text(folder, "summary.json", "{").parent)),
        4, "unreadable_file", ("summary.json",),
    ),
}  # fmt: skip


def listing(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def assert_plain(finished: Finished, code: int, says: tuple[str, ...]) -> None:
    assert finished.code == code, finished
    assert finished.out == ""
    lines = finished.err.splitlines()
    assert 1 <= len(lines) <= 2, finished.err
    assert lines[0].startswith("swathe: ")
    assert "Traceback" not in finished.err
    assert "bug" not in lines[0]
    for word in says:
        assert word in finished.err


@pytest.mark.parametrize("name", CASES)
def test_bad_input_is_refused_in_plain_words_and_leaves_nothing(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make, code, kind, says = CASES[name]
    inputs, place = tmp_path / "inputs", tmp_path / "place"
    inputs.mkdir()
    place.mkdir()
    monkeypatch.chdir(place)
    words = make(inputs)
    before = listing(inputs)

    # How much memory is free changes between two runs.
    monkeypatch.setattr("swathe.io.memory.available_bytes", lambda: 16_000_000_000)
    plain = commands.run_here(capsys, *words)
    as_json = commands.run_here(capsys, *words, "--json")

    assert_plain(plain, code, says)
    assert as_json.code == code
    assert as_json.err == ""
    answer = as_json.answer
    assert list(answer) == ["status", "kind", "message", "remedy"]
    assert (answer["status"], answer["kind"]) == ("error", kind)
    assert plain.err == f"swathe: {answer['message']}\n        {answer['remedy']}\n"
    assert list(place.iterdir()) == [], "no output folder, not even an empty one"
    assert listing(inputs) == before


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("holiday.jpg", b"a picture"),
        ("summary.json", b'{"command": "of somebody else"}'),
        ("summary.json", b"[1, 2]"),
        ("summary.json", b"{"),
        ("map.png", b"a map that no run made"),
    ],
)
def test_a_folder_that_is_not_ours_is_refused_and_stays(
    name: str, content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / name).write_bytes(content)
    for command in (way(commands.hills(tmp_path)), ("demo",)):
        finished = commands.run_here(capsys, *command, "--out", str(folder))
        assert_plain(finished, 4, (str(folder), name, "--out"))
        assert listing(folder) == {name: content}


def test_a_refusal_leaves_the_earlier_run_as_it_was(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dem, out = commands.hills(tmp_path), tmp_path / "run"
    assert commands.run_here(capsys, *way(dem, "--out", str(out))).code == 0
    before = listing(out)
    assert commands.run_here(capsys, *way("no.tif", "--out", str(out))).code == 4
    assert commands.run_here(capsys, *way(dem, "--width", "nan", "--out", str(out))).code == 2
    assert listing(out) == before


def test_a_run_to_which_somebody_added_a_file_is_not_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dem, out = commands.hills(tmp_path), tmp_path / "run"
    assert commands.run_here(capsys, *way(dem, "--out", str(out))).code == 0
    (out / "notes.txt").write_text("mine")
    before = listing(out)
    assert_plain(commands.run_here(capsys, *way(dem, "--out", str(out))), 4, ("notes.txt", "--out"))
    assert listing(out) == before


def test_folders_made_on_the_way_to_out_vanish_with_a_refusal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    deep = tmp_path / "a" / "b" / "c"
    assert commands.run_here(capsys, *way("no.tif", "--out", str(deep))).code == 4
    assert list(tmp_path.iterdir()) == []


# Ends on hills with a hole, a cliff around a plateau, and a wall: name -> start, goal, status, words of the answer.
WALLED = {
    "start outside": ("739000,4049500", GOAL, "outside_map", "start"),
    "goal outside": (START, "749000,4048000", "outside_map", "goal"),
    "start on a void": ("742500,4048900", GOAL, "start_blocked", "unknown"),
    "goal on a void": (START, "742500,4048900", "goal_blocked", "unknown"),
    "goal on a no-go cell": (START, "741230,4048200", "goal_blocked", "steep"),
    "other side of a wall": (START, "742500,4049800", "no_route", "between"),
}


def walled(folder: Path) -> Path:
    """Write gentle ground with a hole in the east, a steep wall down the middle and around the east."""
    heights = np.full((80, 90), 300, dtype=np.float32)
    ramp = 40 * (1 - np.abs(np.arange(-8, 9)) / 8.0)  # 8 cells of 30 m, 40 m each: 133 %
    heights[:, 37:54] += 8 * ramp[None, :].astype(np.float32)
    heights[26:50, 70:88] = np.nan
    return raster(folder, "walled.tif", heights, nodata=float("nan"))


@pytest.mark.parametrize("name", WALLED)
def test_a_negative_answer_has_exit_code_3_a_reason_and_a_folder(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start, goal, status, word = WALLED[name]
    out = tmp_path / "run"
    words = way(walled(tmp_path), "--out", str(out), from_to=(start, goal))
    as_json = commands.run_here(capsys, *words, "--json")
    assert (as_json.code, as_json.err) == (3, "")
    answer = as_json.answer
    assert answer["status"] == status
    assert word in answer["reason"]
    assert answer["remedy"]
    assert answer["length_m"] is None
    assert {"summary.json", "map.png", "nests.geojson", "rank.tif", "report.html"} <= {f.name for f in out.iterdir()}
    assert Path(answer["outputs"]["map"]).is_file()


def test_start_equal_to_goal_is_a_route_of_no_length(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "run"
    words = way(commands.hills(tmp_path), "--json", "--out", str(out), from_to=(START, START))
    finished = commands.run_here(capsys, *words)
    assert finished.code == 0
    assert (finished.answer["status"], finished.answer["length_m"]) == ("route_found", 0)
    assert (out / "summary.json").is_file()


def test_soil_that_is_partly_understood_is_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    soil = soil_vector(tmp_path, ("sand", "Qx7"))
    words = way(commands.hills(tmp_path), "--soil", str(soil), "--soil-field", "label", "--out", str(tmp_path / "run"))
    finished = commands.run_here(capsys, *words)
    assert finished.code == 0
    assert "Qx7" in finished.out
    assert "--soil-legend" in finished.out


def test_the_odd_bytes_of_a_file_name_do_no_harm(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    odd = tmp_path / os.fsdecode(b"d\xff <b>&.tif")
    commands.hills(tmp_path).rename(odd)
    finished = commands.run_here(capsys, *way(odd, "--json", "--out", str(tmp_path / "run")))
    assert finished.code in {0, 4}, "read, or refused in plain words"
    assert finished.err == ""
    if finished.code == 4:
        assert finished.answer["kind"] == "unreadable_file"
