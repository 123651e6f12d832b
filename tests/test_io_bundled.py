"""The terrain that needs no files, and the soil that is made up for it."""

from __future__ import annotations

import subprocess
import sys
from os import environ, pathsep

import numpy as np
import pytest

from swathe.errors import MissingFileError
from swathe.grid import Window
from swathe.io.bundled import generate_soil
from swathe.io.elevation import open_elevation
from swathe.io.generated import GENERATED, generated_elevation, generated_soil
from swathe.io.soil import read_soil
from swathe.soil import SoilClass
from swathe.terrain import slope

NAME = "bundled:jacksboro"


def test_the_bundled_elevation_lies_in_tennessee_north_up() -> None:
    with open_elevation([NAME]) as source:
        heights = source.read()
        frame = source.frame
        assert frame.name == "WGS 84 / UTM zone 16N"
        assert frame.geometry.cell_size_m == 90
        assert source.native_cell_size_m == pytest.approx(83, abs=1)
        assert len(source.fingerprint()[NAME]) == 64
        west, south = frame.to_lonlat(frame.geometry.west_m, frame.geometry.south_m)
        assert [float(west), float(south)] == pytest.approx([-84.42, 36.44], abs=0.02)
        # The mountains stand in the south-west and the lake country lies in the south-east.
        quarter_m = {
            (south, east): float(np.nanmean(np.array_split(np.array_split(heights, 2, axis=0)[south], 2, axis=1)[east]))
            for south in (0, 1)
            for east in (0, 1)
        }
        assert max(quarter_m, key=lambda place: quarter_m[place]) == (1, 0)
        assert min(quarter_m, key=lambda place: quarter_m[place]) == (1, 1)
        assert 240 <= np.nanmin(heights) < 250
        assert 1050 < np.nanmax(heights) <= 1080


def test_other_cell_sizes_and_windows_work() -> None:
    with open_elevation([NAME], cell_size_m=30.0) as source:
        whole = source.read()
    with open_elevation([NAME], cell_size_m=30.0) as source:
        part = source.read(Window(400, 300, 77, 55))
    assert part.tobytes() == whole[400:477, 300:355].tobytes()


def test_the_generated_soil_is_plausible_coherent_and_says_what_it_is() -> None:
    with open_elevation([NAME]) as source:
        heights = source.read()
        layer = read_soil(NAME, source.frame)
    known = ~np.isnan(heights)
    np.testing.assert_array_equal(layer.codes != SoilClass.UNKNOWN, known)
    share = {soil: np.mean(layer.codes[known] == soil) for soil in SoilClass}
    assert 0.20 < share[SoilClass.SILT] < 0.30
    assert 0.10 < share[SoilClass.CLAY] < 0.16
    assert 0.20 < share[SoilClass.ROCK] < 0.30
    assert share[SoilClass.SAND] + share[SoilClass.GRAVEL] > 0.3
    # Low ground is fine, high steep ground is coarse.
    north, east = np.gradient(np.where(known, heights, 400), 90.0)
    grade = np.hypot(north, east)
    of = {soil: known & (layer.codes == soil) for soil in SoilClass}
    assert np.mean(grade[of[SoilClass.CLAY]]) < np.mean(grade[of[SoilClass.SAND]]) < np.mean(grade[of[SoilClass.ROCK]])
    assert np.mean(heights[of[SoilClass.CLAY]]) < np.mean(heights[of[SoilClass.ROCK]])
    # Patches, not salt and pepper: most neighbours are alike.
    alike = layer.codes[:, 1:] == layer.codes[:, :-1]
    assert alike[known[:, 1:] & known[:, :-1]].mean() > 0.75
    assert "generated" in layer.report.source
    assert layer.report.not_understood == ()


def test_soil_does_not_depend_on_the_window_or_the_process() -> None:
    with open_elevation([NAME]) as source:
        whole = read_soil(NAME, source.frame).codes
        part = read_soil(NAME, source.frame.window(Window(100, 120, 30, 40))).codes
    np.testing.assert_array_equal(part, whole[100:130, 120:160])
    program = (
        "import hashlib; from swathe.io.elevation import open_elevation; from swathe.io.soil import read_soil; "
        f"print(hashlib.sha256(read_soil({NAME!r}, open_elevation([{NAME!r}]).frame).codes).hexdigest())"
    )
    environment = environ | {"PYTHONPATH": pathsep.join(sys.path)}
    outputs = {
        subprocess.run([sys.executable, "-c", program], capture_output=True, check=True, env=environment).stdout
        for _ in range(2)
    }
    assert len(outputs) == 1


def test_the_rule_works_at_other_cell_sizes_and_on_voids() -> None:
    row, column = np.mgrid[0:120, 0:120]
    valley = (np.abs(column - 60.0) * 9 + 0.1 * row).astype(np.float32)  # a V of 30 % at 30 m
    valley[:5] = np.nan
    soil = generate_soil(valley, 30.0)
    assert np.all(soil[:5] == SoilClass.UNKNOWN)
    assert np.mean(np.isin(soil[10:, 59:62], (SoilClass.SILT, SoilClass.CLAY))) > 0.8
    assert np.mean(np.isin(soil[10:, 20:30], (SoilClass.SAND, SoilClass.GRAVEL))) > 0.8
    assert np.all(generate_soil(np.full((10, 10), np.nan, np.float32), 30.0) == SoilClass.UNKNOWN)


def test_an_unknown_name_is_refused_with_those_that_exist() -> None:
    for read in (lambda: open_elevation(["bundled:atlantis"]), lambda: read_soil("bundled:atlantis", None)):  # type: ignore[arg-type]
        with pytest.raises(MissingFileError, match="bundled:jacksboro"):
            read()


def test_reading_it_does_not_import_matplotlib() -> None:
    program = (
        "import sys; from swathe.io.elevation import open_elevation; "
        f"open_elevation([{NAME!r}]).read(); print('matplotlib' in sys.modules)"
    )
    environment = environ | {"PYTHONPATH": pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout == "False\n"


@pytest.mark.parametrize("name", sorted(GENERATED))
def test_maps_made_by_rule_are_read_like_files(name: str) -> None:
    with open_elevation([f"bundled:{name}"]) as source:
        heights_m, frame = source.read(), source.frame
        fingerprint = source.fingerprint()
    recipe = GENERATED[name]
    assert frame.crs_wkt is None
    assert frame.geometry.cell_size_m == recipe.cell_size_m
    np.testing.assert_array_equal(heights_m, generated_elevation(name))
    assert len(next(iter(fingerprint.values()))) == 64
    soil = read_soil(f"bundled:{name}", frame)
    np.testing.assert_array_equal(soil.codes, generated_soil(name))
    assert len(np.unique(soil.codes)) == (3 if recipe.parcels_m else 5)


def test_the_gully_of_the_heath_is_too_steep_to_cross_and_can_be_gone_around() -> None:
    grade = slope(generated_elevation("heath"), 1.0)
    # From the north edge to well past the middle every row has a wall of more than 25 %.
    assert (np.nanmax(grade[5:220, 110:215], axis=1) > 0.25).all()
    assert np.nanmax(grade[250:315]) < 0.25


def test_the_papers_ground_has_hills_over_and_under_the_papers_grade() -> None:
    grade = slope(generated_elevation("paper"), 0.25)
    steep = np.nanmean(grade > 0.25)
    assert 0.001 < steep < 0.1
