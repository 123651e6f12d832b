"""Maps of real GRASS locations as inputs: bit by bit, untouched, and with plain errors."""

from __future__ import annotations

import json
import os
import shutil
import signal
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyogrio
import pyogrio.raw
import pytest
import shapely
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st

import commands
import raster_files
from commands import GOAL, START, way
from grass_location import Location
from raster_files import CELL, NORTH, WEST
from swathe.errors import AllVoidError, GrassError, SwatheError
from swathe.io.elevation import open_elevation
from swathe.io.grass_session import scrubbed
from swathe.io.soil import read_soil
from swathe.io.sources import single
from swathe.soil import SoilClass

if TYPE_CHECKING:
    from collections.abc import Callable

    import postgis
    from swathe.io.crs import Frame

ROWS, COLUMNS = 80, 90
#: Corners of soil areas, as rows and columns of cells; the last is an island in the first.
AREAS = {
    (0, 0, 80, 30): "sand",
    (0, 30, 40, 90): "clay",
    (40, 30, 80, 60): "silt",
    (40, 60, 60, 90): "gravel",
    (20, 5, 40, 20): "rock",
}


def heights_with_holes() -> np.ndarray[Any, Any]:
    heights = raster_files.hills(ROWS, COLUMNS)
    heights[5:9, 70:80] = np.nan
    heights[0, 0] = np.nan
    return heights


def write_soils(path: Path) -> Path:
    """Write the areas as polygons with a number, a name and columns that a GeoPackage keeps for itself."""
    boxes = [
        shapely.box(WEST + left * CELL, NORTH - bottom * CELL, WEST + right * CELL, NORTH - top * CELL)
        for top, left, bottom, right in AREAS
    ]
    boxes[0] = boxes[0].difference(boxes[-1])
    pyogrio.raw.write(
        path,
        shapely.to_wkb(np.array(boxes, dtype=object)),
        [np.arange(1, 6, dtype=np.int32), np.array(list(AREAS.values()), dtype=object), np.arange(5.0)],
        np.array(["number", "texture", "geom_fid"], dtype=object),
        layer="soils",
        crs=raster_files.UTM16,
        geometry_type="Polygon",
        driver="GPKG",
        VERSION="1.2",
    )
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    raster_files.write(folder / "dem.tif", heights_with_holes(), nodata=np.nan)
    write_soils(folder / "soils.gpkg")
    return folder


@pytest.fixture(scope="module")
def location(grass: Path, files: Path, tmp_path_factory: pytest.TempPathFactory) -> Location:
    """A location with elevation, soil as areas and as categories, and a second mapset."""
    made = Location(grass, tmp_path_factory.mktemp("grassdata") / "hills", files / "dem.tif")
    names = "\n".join(f"{number}|{name}" for number, name in enumerate(AREAS.values(), start=1))
    (files / "labels").write_text(names + "\n", encoding="ascii")
    made.run(
        ["r.in.gdal", f"input={files / 'dem.tif'}", "output=dem"],
        ["v.in.ogr", f"input={files / 'soils.gpkg'}", "layer=soils", "output=soils", "key=number"],
        "g.region raster=dem",
        "v.to.rast input=soils output=soil_classes use=cat",
        ["r.category", "map=soil_classes", "separator=pipe", f"rules={files / 'labels'}"],
    )
    made.new_mapset("other")
    made.run(f"g.region n={NORTH} s={NORTH - 300} w={WEST} e={WEST + 600} save=corner", mapset="other")
    return made


@pytest.fixture(scope="module")
def frame(files: Path) -> Frame:
    with open_elevation([str(files / "dem.tif")]) as source:
        return source.frame


@pytest.fixture
def copy(location: Location, tmp_path: Path) -> Path:
    """A copy of the location that a test may spoil."""
    folder = tmp_path / "spoilt"
    shutil.copytree(location.folder, folder)
    return folder


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


def reclassed(copy: Path) -> str:
    (copy / "PERMANENT" / "fcell" / "dem").write_bytes(b"\0" * 100)
    return "dem"


def headless(copy: Path) -> str:
    (copy / "PERMANENT" / "cellhd" / "dem").write_text("nothing of the kind\n", encoding="ascii")
    return "dem"


def of_the_future(copy: Path) -> str:
    coordinates = copy / "PERMANENT" / "vector" / "soils" / "coor"
    coordinates.write_bytes(b"\x07\x01\x07\x01" + coordinates.read_bytes()[4:])
    return "soils"


def without_topology(copy: Path) -> str:
    (copy / "PERMANENT" / "vector" / "soils" / "topo").unlink()
    return "soils"


def without_table(copy: Path) -> str:
    shutil.rmtree(copy / "PERMANENT" / "sqlite")
    return "soils"


def with_a_dead_server(copy: Path) -> str:
    link = copy / "PERMANENT" / "vector" / "soils" / "dbln"
    link.write_text("1/soils|soils|number|dbname=gone host=/nowhere password=tell-nobody|pg\n", encoding="ascii")
    return "soils"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (reclassed, "GRASS cannot read grass:spoilt/dem@PERMANENT: Error reading format"),
        (headless, "GRASS cannot read grass:spoilt/dem@PERMANENT: Syntax error in cell header"),
        (of_the_future, "grass:spoilt/soils@PERMANENT was written by a newer GRASS"),
        (without_topology, "grass:spoilt/soils@PERMANENT has no valid topology. .*v.build map=soils@PERMANENT"),
        (without_table, "keeps its attributes in a database that does not answer as it should"),
        (with_a_dead_server, "keeps its attributes in a database that does not answer.*PGPASSWORD or ~/.pgpass"),
    ],
)  # fmt: skip
def test_a_map_that_cannot_be_read_says_why(copy: Path, spoil: Callable[[Path], str], words: str) -> None:
    name = spoil(copy)
    with pytest.raises(GrassError, match=words) as refusal:
        single(f"grass:{copy}/PERMANENT/{name}")
    assert "tell-nobody" not in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("hils/PERMANENT/dem", r"location .*hils does not exist\. Did you mean hills\?"),
        ("PERMANENT/dem", "is not a GRASS location. It holds the locations hills"),
        ("hills/PERMANET/dem", "has no mapset 'PERMANET'. Did you mean PERMANENT?"),
        ("hills/PERMANENT/dm", "has no map 'dm'. Did you mean dem?"),
        ("hills/other/soils", "has no map 'soils'. There is soils@PERMANENT"),
        ("hills/PERMANENT/soils?type=raster", "is a vector, where a raster is needed"),
        ("hills/PERMANENT/dem?region=nowhere", "has no saved region 'nowhere'"),
        ("hills/PERMANENT/soils?region=corner", "is a vector, for which there is no region"),
        ("hills/PERMANENT/dem?size=3", "option 'size' that is not known. Use region, layer, type"),
        ("hills/PERMANENT/soils?type=table", "asks for the type 'table'"),
        ("hills/PERMANENT/soils?layer=7", r"holds no areas with a category in layer 7\."),
    ],
)
def test_a_name_that_is_not_there_gets_the_nearest(location: Location, address: str, words: str) -> None:
    with pytest.raises(GrassError, match=words):
        single(f"grass:{location.folder.parent}/{address}")


def test_a_name_of_two_kinds_is_a_raster_where_heights_are_meant(location: Location) -> None:
    location.run("g.copy --overwrite vector=soils@PERMANENT,dem raster=dem@PERMANENT,dem", mapset="other")
    address = location.address("dem", "other")
    with pytest.raises(GrassError, match=r"has a raster and a vector 'dem'\. Add \?type=raster or \?type=vector"):
        single(address)
    assert single(f"{address}?type=vector").path.endswith(".gpkg")
    with open_elevation([address]) as source:
        assert source.read().shape == (ROWS, COLUMNS)


def test_a_vector_is_no_elevation(location: Location) -> None:
    with pytest.raises(GrassError, match="soils@PERMANENT in hills is a vector, where a raster is needed"):
        open_elevation([location.address("soils")])


def test_a_map_of_nulls_is_void(location: Location) -> None:
    location.run("g.region raster=dem@PERMANENT", "r.mapcalc --overwrite 'nothing = null()'", mapset="other")
    finished = commands.run(*way(location.address("nothing", "other"), "--json"))
    assert (finished.code, finished.answer["kind"]) == (4, AllVoidError.kind)


def test_without_grass_the_line_to_install_it_is_said(location: Location, tmp_path: Path) -> None:
    finished = commands.run(*way(location.address("dem"), "--json"), env={"PATH": str(tmp_path)}, cwd=tmp_path)
    assert finished.code == 4
    assert finished.answer["kind"] == "grass"
    assert finished.answer["message"] == "GRASS is not installed."
    assert finished.answer["remedy"].endswith("sudo apt-get install --no-install-recommends grass-core")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("part", ["PERMANENT/cellhd", "PERMANENT/fcell/dem", "PERMANENT", ""])
def test_a_location_that_may_not_be_read_is_refused(copy: Path, part: str) -> None:
    folder = copy / part
    mode = folder.stat().st_mode
    for parent in [copy, *copy.parents][:4]:
        parent.chmod(0o755)
    folder.chmod(0)
    me = os.geteuid()
    try:
        if me == 0:
            os.seteuid(65534)
        with pytest.raises(GrassError, match=r"may not be read|is not a GRASS location|no permission"):
            single(f"grass:{copy}/PERMANENT/dem")
    finally:
        if me == 0:
            os.seteuid(0)
        folder.chmod(mode)


def processes_with(text: str) -> list[tuple[int, str]]:
    """The processes whose command line holds a text, and their names."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with suppress(OSError):
                words = (folder / "cmdline").read_bytes().split(b"\0")
                if any(text.encode() in word for word in words):
                    found.append((int(folder.name), Path(os.fsdecode(words[0])).name))
    return found


@pytest.fixture(scope="module")
def large(location: Location) -> str:
    """The address of a map that takes GRASS a while."""
    location.run(
        f"g.region n={NORTH} s={NORTH - 6000} w={WEST} e={WEST + 6000} res=1.5",
        "r.mapcalc --overwrite 'large = double(row()) * col() / 7'",
        mapset="other",
    )
    return location.address("large", "other")


def wait_for(program: str, text: str) -> int:
    for _ in range(6000):
        for process, name in processes_with(text):
            if name == program:
                return process
        time.sleep(0.005)
    raise AssertionError(f"{program} was not seen")


def test_grass_being_killed_is_said_and_leaves_nothing(
    large: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def kill() -> None:
        os.kill(wait_for("r.out.gdal", str(tmp_path)), signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    with pytest.raises(GrassError, match=r"GRASS was killed \(SIGKILL\) while it worked on grass:hills/large@other"):
        single(large)
    killer.join()
    assert list(tmp_path.iterdir()) == []
    assert processes_with(str(tmp_path)) == []


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_plan_leaves_neither_files_nor_grass(large: str, tmp_path: Path, stop: signal.Signals) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    running = commands.start(*way(large, "--out", str(tmp_path / "out")), env={"TMPDIR": str(scratch)})
    # Stopped, it never ends by itself.
    os.kill(wait_for("r.out.gdal", str(scratch)), signal.SIGSTOP)
    running.send_signal(stop)
    _, said = running.communicate(timeout=60)
    assert running.returncode == 130, said
    assert list(scratch.iterdir()) == []
    assert processes_with(str(scratch)) == []
    assert not (tmp_path / "out").exists()


@given(
    st.text(max_size=40) | st.lists(st.sampled_from(["/", "@", "..", "~", "?", "a", "PERMANENT", "\0"])).map("".join)
)
def test_no_address_is_a_bug(text: str) -> None:
    with pytest.raises((SwatheError, UnicodeEncodeError)):
        single(f"grass:{text}")


@given(
    st.text("abcXYZ019.!#%-_", min_size=4),
    st.sampled_from(
        ["dbname=x password={} host=y", "PASSWORD = {},user=z", "postgresql://me:{}@host/x", "passwd='{}'"]
    ),
)
def test_no_password_of_a_connection_is_repeated(secret: str, form: str) -> None:
    secret = f"Q{secret}Q"
    assert secret not in scrubbed(f"Unable to open database <{form.format(secret)}> by driver <pg>")


def test_attributes_that_lie_in_postgresql_are_read(
    location: Location, frame: Frame, postgis_cluster: postgis.Cluster, postgis_database: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Soils whose table was copied into a database with a password, as `db.connect driver=pg` has it."""
    import postgis

    with postgis_cluster.connect(postgis_database) as connection:
        connection.execute("CREATE TABLE soil_facts (number integer PRIMARY KEY, texture text)")
        for number, texture in enumerate(AREAS.values(), start=1):
            connection.execute("INSERT INTO soil_facts VALUES (%s, %s)", (number, texture))
        connection.execute("GRANT ALL ON soil_facts TO guarded")
    database = f"host={postgis_cluster.folder},dbname={postgis_database}"
    monkeypatch.setenv("PGHOST", str(postgis_cluster.folder))
    monkeypatch.setenv("PGUSER", "postgres")
    location.run(
        "g.copy --overwrite vector=soils@PERMANENT,served",
        "v.db.connect -d map=served layer=1",
        ["v.db.connect", "-o", "map=served", "driver=pg", f"database={database}", "table=soil_facts", "key=number"],
        mapset="other",
    )
    monkeypatch.delenv("PGHOST")
    monkeypatch.setenv("PGUSER", "guarded")
    monkeypatch.setenv("PGPASSWORD", postgis.PASSWORD)
    found = read_soil(location.address("served", "other"), frame, field="texture")
    np.testing.assert_array_equal(found.codes, read_soil(location.address("soils"), frame).codes)
    monkeypatch.setenv("PGPASSWORD", "not-this-one")
    with pytest.raises(GrassError, match=r"keeps its attributes in a database.*password authentication failed") as said:
        single(location.address("served", "other"))
    assert "not-this-one" not in str(said.value)


def test_geometry_that_lies_in_postgis_is_read(
    location: Location, files: Path, frame: Frame, postgis_cluster: postgis.Cluster, postgis_database: str,
) -> None:  # fmt: skip
    """Soils of a table of PostGIS that `v.external` links to."""
    meta, _, shapes, columns = pyogrio.raw.read(files / "soils.gpkg")
    table = dict(zip(meta["fields"], columns, strict=True))
    with postgis_cluster.connect(postgis_database) as connection:
        connection.execute(
            "CREATE TABLE far_soils (fid serial PRIMARY KEY, texture text, geom geometry(Polygon, 32616))"
        )
        for texture, shape in zip(table["texture"].tolist(), shapes, strict=True):
            connection.execute(
                "INSERT INTO far_soils (texture, geom) VALUES (%s, ST_GeomFromWKB(%s, 32616))", (texture, shape)
            )
    where = f"PG:host={postgis_cluster.folder} dbname={postgis_database} user=postgres"
    location.run(["v.external", "--overwrite", f"input={where}", "layer=far_soils", "output=far"], mapset="other")
    found = read_soil(location.address("far", "other"), frame, field="texture")
    np.testing.assert_array_equal(found.codes, read_soil(location.address("soils"), frame).codes)
    postgis_cluster.drop(postgis_database)
    with pytest.raises(GrassError, match=r"grass:hills/far@other .*database"):
        single(location.address("far", "other"))


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
