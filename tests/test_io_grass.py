"""Maps of real GRASS locations as inputs: bit by bit, untouched, and with plain errors."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyogrio
import pyogrio.raw
import pytest
import shapely
from affine import Affine

import commands
import raster_files
from commands import GOAL, START, way
from grass_location import AREAS, COLUMNS, ROWS, Location, heights_with_holes, hills_location
from raster_files import CELL, NORTH, WEST
from swathe.io.elevation import open_elevation
from swathe.io.soil import read_soil
from swathe.io.sources import single
from swathe.soil import SoilClass

if TYPE_CHECKING:
    from swathe.io.crs import Frame


@pytest.fixture(scope="module")
def location(grass: Path, tmp_path_factory: pytest.TempPathFactory) -> Location:
    return hills_location(grass, tmp_path_factory.mktemp("grassdata"))


@pytest.fixture(scope="module")
def files(location: Location) -> Path:
    """The folder of the files that the location was made of."""
    return location.folder.parent


@pytest.fixture(scope="module")
def frame(files: Path) -> Frame:
    with open_elevation([str(files / "dem.tif")]) as source:
        return source.frame


def numbers(kind: str) -> np.ndarray[Any, Any]:
    draw = np.random.default_rng(11)
    if kind == "int16":
        return draw.integers(-400, 8000, (37, 53)).astype(np.int16)
    if kind == "uint8":
        return draw.integers(0, 256, (37, 53)).astype(np.uint8)
    values = draw.normal(1000, 300, (37, 53))
    values[draw.random(values.shape) < 0.1] = np.nan
    return values.astype(kind)


@pytest.mark.parametrize("kind", ["int16", "uint8", "float32", "float64"])
def test_a_raster_comes_back_bit_by_bit(location: Location, tmp_path: Path, kind: str) -> None:
    values = numbers(kind)
    file = raster_files.write(tmp_path / "values.tif", values, nodata=np.nan if kind.startswith("float") else None)
    location.run(["r.in.gdal", "--overwrite", f"input={file}", f"output=values_{kind}"], mapset="other")
    with (
        open_elevation([location.address(f"values_{kind}", "other")]) as kept,
        open_elevation([str(file)]) as original,
    ):
        assert kept.frame == original.frame
        assert kept.source_crs_wkt == original.source_crs_wkt
        np.testing.assert_array_equal(kept.read(), original.read())
        assert np.isnan(kept.read()).sum() == np.isnan(values.astype(float)).sum()


def test_nulls_of_whole_numbers_are_unknown_and_zero_is_a_height(location: Location) -> None:
    expression = "holes = if(row() == 3, null(), if(row() == 4, 0, row() * 10 + col()))"
    location.run("g.region raster=dem@PERMANENT", ["r.mapcalc", "--overwrite", expression], mapset="other")
    with open_elevation([location.address("holes", "other")]) as source:
        heights = source.read()
    assert np.isnan(heights[2]).all()
    assert np.isfinite(np.delete(heights, 2, axis=0)).all()
    assert (heights[3] == 0).all()
    assert heights[10, 5] == 116


def test_both_ways_to_write_an_address_mean_the_same_map(location: Location) -> None:
    first = single(location.address("dem"))
    second = single(f"grass:{location.folder}/dem@PERMANENT")
    assert first == second
    assert first.name == "grass:hills/dem@PERMANENT"
    assert first.keeper is second.keeper, "it is fetched once"


def test_the_same_map_gives_the_same_bytes_and_leaves_nothing(location: Location) -> None:
    prints = []
    for name in ("dem", "soils", "soil_classes"):
        for _ in range(2):
            source = single(location.address(name))
            prints.append(source.fingerprint())
            kept = Path(source.path).parent
            assert kept.is_dir()
            del source
            assert not kept.exists()
    assert prints[::2] == prints[1::2]
    assert len(set(prints)) == 3


def test_a_location_in_an_odd_folder_is_read_through_a_link_and_without_a_home(
    location: Location, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "ü 'q\"; $HOME"
    folder.mkdir()
    (folder / "a link").symlink_to(location.folder)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("HOME", str(tmp_path / "nowhere"))
    with open_elevation(["grass:a link/PERMANENT/dem"]) as source:
        np.testing.assert_array_equal(source.read(), heights_with_holes())


def test_a_map_that_changed_is_fetched_again(location: Location) -> None:
    location.run("g.region raster=dem@PERMANENT", "r.mapcalc --overwrite 'changing = 1'", mapset="other")
    before = single(location.address("changing", "other"))
    location.run("r.mapcalc --overwrite 'changing = 2'", mapset="other")
    assert single(location.address("changing", "other")).fingerprint() != before.fingerprint()


def test_areas_keep_their_number_and_attributes(location: Location) -> None:
    source = single(location.address("soils"))
    info = pyogrio.read_info(source.path)
    assert info["features"] == len(AREAS)
    assert set(info["fields"]) == {"number", "texture", "geom_fid"}
    meta, _, shapes, columns = pyogrio.raw.read(source.path)
    table = dict(zip(meta["fields"], columns, strict=True))
    assert dict(zip(table["number"].tolist(), table["texture"].tolist(), strict=True)) == dict(
        enumerate(AREAS.values(), start=1)
    )
    areas = dict(zip(table["number"].tolist(), shapely.area(shapely.from_wkb(shapes)).tolist(), strict=True))
    cells = {number: (bottom - top) * (right - left) for number, (top, left, bottom, right) in enumerate(AREAS, 1)}
    cells[1] -= cells[5]
    assert areas == pytest.approx({number: count * CELL**2 for number, count in cells.items()}, rel=1e-12)


@pytest.mark.parametrize("name", ["soils", "soil_classes"])
def test_soil_of_a_location_equals_soil_of_files(location: Location, files: Path, frame: Frame, name: str) -> None:
    expected = read_soil(str(files / "soils.gpkg"), frame)
    found = read_soil(location.address(name), frame)
    np.testing.assert_array_equal(found.codes, expected.codes)
    assert {entry.label for entry in found.report.entries} == set(AREAS.values())
    assert (found.codes[60:, 60:] == SoilClass.UNKNOWN).all(), "where there is no area, nothing is known"


def test_soil_goes_by_category_with_a_legend(location: Location, frame: Frame, tmp_path: Path) -> None:
    legend = tmp_path / "table2.csv"
    legend.write_text("cat,class\n1,rock\n2,gravel\n3,clay\n4,silt\n", encoding="ascii")
    soil = read_soil(location.address("soils"), frame, field="number", legend=str(legend))
    assert [int(soil.codes[cell]) for cell in ((0, 0), (0, 40), (60, 40), (50, 70))] == [
        SoilClass.ROCK, SoilClass.GRAVEL, SoilClass.CLAY, SoilClass.SILT,
    ]  # fmt: skip


def test_cat_names_the_soil_of_areas_without_a_table(location: Location, frame: Frame, tmp_path: Path) -> None:
    location.run(
        "g.region raster=dem@PERMANENT",
        "r.to.vect -v --overwrite input=soil_classes@PERMANENT output=bare type=area",
        "v.db.connect -d map=bare layer=1",
        mapset="other",
    )
    legend = tmp_path / "legend.csv"
    legend.write_text("cat,class\n1,sand\n2,clay\n3,silt\n4,gravel\n5,rock\n", encoding="ascii")
    soil = read_soil(location.address("bare", "other"), frame, field="cat", legend=str(legend))
    np.testing.assert_array_equal(soil.codes, read_soil(location.address("soils"), frame).codes)


def test_reading_writes_nothing_into_the_location_and_heeds_no_mask(location: Location) -> None:
    location.run("g.region raster=dem@PERMANENT", "r.mask raster=soil_classes@PERMANENT maskcats=1", mapset="other")
    location.run("r.mapcalc --overwrite 'above = dem@PERMANENT + 1'", "r.mask -r", mapset="other")
    location.run("r.mapcalc --overwrite 'MASK = if(row() < 5, 1, null())'", mapset="other")
    before = location.contents()
    with open_elevation([location.address("dem")]) as source:
        assert np.isnan(source.read()).sum() == np.isnan(heights_with_holes()).sum()
    single(location.address("soils"))
    assert location.contents() == before
    location.run("r.mask -r", mapset="other")


def test_a_locked_mapset_is_read_all_the_same(location: Location) -> None:
    lock = location.folder / "PERMANENT" / ".gislock"
    lock.write_bytes(os.getpid().to_bytes(4, "little"))
    try:
        with pytest.raises(AssertionError, match="currently running GRASS"):
            location.run("g.region -p")
        with open_elevation([location.address("dem")]) as source:
            assert source.read().shape == (ROWS, COLUMNS)
    finally:
        lock.unlink()


@pytest.mark.parametrize("region", ["corner", "current"])
def test_a_region_of_the_location_chooses_a_part(location: Location, region: str) -> None:
    if region == "current":
        location.run("g.region region=corner", mapset="other")
    location.run("g.copy --overwrite raster=dem@PERMANENT,copy", mapset="other")
    with open_elevation([location.address("copy", "other") + f"?region={region}"]) as source:
        heights = source.read()
        assert source.frame.geometry.west_m == WEST
        assert source.frame.geometry.north_m == NORTH
    np.testing.assert_array_equal(heights, heights_with_holes()[:10, :20])


def test_bounds_choose_a_part(location: Location, tmp_path: Path) -> None:
    box = f"--bounds={WEST + 10 * CELL + 1},{NORTH - 70 * CELL + 1},{WEST + 80 * CELL - 1},{NORTH - 10 * CELL - 1}"
    words = ("nests", "--dem", location.address("dem"), "--points-crs", "native", box, "--out", str(tmp_path / "out"))
    finished = commands.run(*words, "--json")
    assert finished.code == 0, finished.err
    assert finished.answer["cells_total"] == 60 * 70


def test_a_location_in_degrees_equals_its_file(grass: Path, tmp_path: Path) -> None:
    place = Affine(1 / 1200, 0, -84.2, 0, -1 / 1200, 36.5)
    file = raster_files.write(tmp_path / "degrees.tif", raster_files.hills(60, 70), crs="EPSG:4326", transform=place)
    degrees = Location(grass, tmp_path / "degrees", file)
    degrees.run(["r.in.gdal", f"input={file}", "output=dem"])
    with open_elevation([degrees.address("dem")]) as kept, open_elevation([str(file)]) as original:
        assert kept.warped
        assert kept.frame.geometry.shape == original.frame.geometry.shape
        np.testing.assert_allclose(kept.read(), original.read(), atol=1e-3)


def test_a_location_without_a_system_is_a_local_map(grass: Path, tmp_path: Path) -> None:
    file = raster_files.write(tmp_path / "plain.tif", raster_files.hills(30, 40), crs=None)
    plain = Location(grass, tmp_path / "plain", "XY")
    plain.run(["r.in.gdal", "-o", f"input={file}", "output=dem"])
    with open_elevation([plain.address("dem")], cell_size_m=10.0) as source:
        assert source.frame.crs_wkt is None
        np.testing.assert_array_equal(source.read(), raster_files.hills(30, 40))


def same_features(first: Path, second: Path) -> bool:
    one, other = (json.loads(path.read_text(encoding="utf-8"))["features"] for path in (first, second))
    assert one
    return bool(one == other)


def test_a_plan_on_a_location_equals_a_plan_on_what_grass_exports(location: Location, tmp_path: Path) -> None:
    dem = location.read_raster("dem", tmp_path / "dem.tif")
    areas = tmp_path / "soils.gpkg"
    location.run(["v.out.ogr", "input=soils", "type=area", f"output={areas}", "format=GPKG"])
    kept, exported = tmp_path / "kept", tmp_path / "exported"
    options = ("--vehicle", "tractor", "--moisture", "wet")
    first = commands.run(
        *way(location.address("dem"), "--soil", location.address("soils"), "--out", str(kept), *options)
    )
    second = commands.run(*way(dem, "--soil", str(areas), "--out", str(exported), *options))
    assert (first.code, second.code) == (0, 0), first.err + second.err
    assert same_features(kept / "route.geojson", exported / "route.geojson")
    assert same_features(kept / "nests.geojson", exported / "nests.geojson")
    inputs = json.loads((kept / "summary.json").read_text(encoding="utf-8"))["inputs"]
    assert [entry["name"] for entry in inputs] == ["grass:hills/dem@PERMANENT", "grass:hills/soils@PERMANENT"]


@pytest.mark.data
def test_a_sample_location_of_real_soils_equals_its_files(grass: Path, swathe_data: Path, tmp_path: Path) -> None:
    folder = swathe_data / "ebergotzen"
    dem, soils = folder / "ebergotzen_dem_25m.tif", folder / "ebergotzen_soil_zones.gpkg"
    made = Location(grass, tmp_path / "ebergotzen", dem)
    made.run(
        ["r.in.gdal", f"input={dem}", "output=dem"],
        ["v.in.ogr", f"input={soils}", "layer=soils", "output=soils"],
    )
    with open_elevation([made.address("dem")]) as kept, open_elevation([str(dem)]) as original:
        assert kept.frame == original.frame
        np.testing.assert_array_equal(kept.read(), original.read())
        for field in (None, "label"):
            found, expected = (read_soil(name, kept.frame, field=field) for name in (made.address("soils"), str(soils)))
            np.testing.assert_array_equal(found.codes, expected.codes)
            assert found.report.entries == expected.report.entries


def test_a_store_imports_maps_of_a_location(
    location: Location, files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What was imported from a location is what is imported from the files, and the same map is no change."""
    routes = []
    for name, dem, soil in (
        ("kept", location.address("dem"), location.address("soils")),
        ("files", str(files / "dem.tif"), str(files / "soils.gpkg")),
    ):
        store = ("--store", str(tmp_path / name), "--region", "hills")
        for again in (False, True):
            first = commands.run_here(capsys, "import", "dem", dem, *store, "--json")
            second = commands.run_here(capsys, "import", "soil", soil, *store, "--json")
            assert (first.code, second.code) == (0, 0), first.err + second.err
            assert {first.answer["status"], second.answer["status"]} == {"no_change" if again else "done"}
        out = tmp_path / f"{name}-plan"
        words = ("--points-crs", "native", "--start", START, "--goal", GOAL, "--vehicle", "tractor", "--out", str(out))
        finished = commands.run_here(capsys, "plan", *store, *words)
        assert finished.code == 0, finished.err
        routes.append(out / "route.geojson")
    assert same_features(*routes)
