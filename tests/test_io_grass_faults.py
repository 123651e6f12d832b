"""What goes wrong with maps of GRASS locations, and maps that lie in a database: plain errors, and nothing left."""

from __future__ import annotations

import os
import shutil
import signal
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyogrio
import pyogrio.raw
import pytest
from hypothesis import given
from hypothesis import strategies as st

import commands
from commands import way
from grass_location import AREAS, COLUMNS, ROWS, Location, as_nobody, hills_location
from raster_files import NORTH, WEST
from swathe.errors import AllVoidError, GrassError, SwatheError
from swathe.io.elevation import open_elevation
from swathe.io.grass import find_map, mapsets
from swathe.io.grass_session import scrubbed
from swathe.io.soil import read_soil
from swathe.io.sources import single

if TYPE_CHECKING:
    from collections.abc import Callable

    import postgis
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


@pytest.fixture
def copy(location: Location, tmp_path: Path) -> Path:
    """A copy of the location that a test may spoil."""
    folder = tmp_path / "spoilt"
    shutil.copytree(location.folder, folder)
    return folder


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
    with as_nobody(copy.parent):
        assert find_map(f"grass:{copy}/PERMANENT/dem").name == "dem"
    folder.chmod(0)
    refused = pytest.raises(GrassError, match=r"may not be read|is not a GRASS location|no permission")
    try:
        with as_nobody(copy.parent), refused:
            single(f"grass:{copy}/PERMANENT/dem")
    finally:
        folder.chmod(mode)


def test_a_mapset_that_others_keep_to_themselves_is_passed_over(copy: Path) -> None:
    (copy / "other").chmod(0)
    try:
        with as_nobody(copy):
            assert mapsets(copy) == ["PERMANENT"]
            assert find_map(f"grass:{copy}/PERMANENT/dem").full_name == "dem@PERMANENT"
            with pytest.raises(GrassError, match="has no mapset 'other'"):
                find_map(f"grass:{copy}/other/dem")
    finally:
        (copy / "other").chmod(0o755)


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
    exporting = wait_for("r.out.gdal", str(scratch))
    os.kill(exporting, signal.SIGSTOP)  # so that it never ends by itself
    try:
        running.send_signal(stop)
        _, said = running.communicate(timeout=60)
    finally:
        with suppress(ProcessLookupError):
            os.kill(exporting, signal.SIGKILL)
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
