"""Soil from tables of PostGIS that somebody else keeps: any system, any column, and every way a server can fail."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from typing import TYPE_CHECKING

import numpy as np
import pyogrio
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import commands
import postgis
import raster_files
from commands import way
from raster_files import CELL, NORTH, WEST
from swathe.errors import (
    InputError,
    InvalidParameterError,
    MissingCrsError,
    NoOverlapError,
    SoilFieldError,
    StoreSchemaError,
    StoreUnavailableError,
    UnreadableFileError,
)
from swathe.io.elevation import open_elevation
from swathe.io.soil import read_soil
from swathe.io.sources import single
from swathe.io.table import fetch_near, table_address
from swathe.soil import SoilClass
from test_io_soil import write_vector

if TYPE_CHECKING:
    from pathlib import Path

    from swathe.io.crs import Frame
    from swathe.io.soil import SoilLayer

ROWS, COLUMNS = 40, 50
#: Twelve stripes of cells, west to east, as wide as their number and one more.
TEXTURES = ("sand", "clay", "silt", "gravel", "peat", "rock") * 2
CIRCLE = (
    f"CURVEPOLYGON(CIRCULARSTRING({WEST} {NORTH - 600}, {WEST + 600} {NORTH}, {WEST + 1200} {NORTH - 600}, "
    f"{WEST + 600} {NORTH - 1200}, {WEST} {NORTH - 600}))"
)
#: The same soils in other systems, types and names, and tables that are no soil map.
STATEMENTS = [
    "CREATE SCHEMA survey",
    "CREATE TABLE survey.degrees (texture text, g geometry(Polygon, 4326))",
    "INSERT INTO survey.degrees SELECT texture, ST_Transform(ST_Segmentize(shape, 50), 4326) FROM soils",
    "CREATE TABLE survey.earth AS SELECT texture, g::geography(Polygon, 4326) AS g FROM survey.degrees",
    "CREATE VIEW survey.seen AS SELECT texture::varchar(20) AS texture, shape FROM soils",
    'CREATE TABLE survey."Odd\' DROP TABLE soils --" AS SELECT texture AS "the \'soil""x", shape FROM soils',
    "CREATE TABLE survey.soils AS SELECT texture, shape FROM soils WHERE number < 3",
    "CREATE TABLE twins AS SELECT texture, shape, ST_Translate(shape, 1e6, 0) AS far FROM soils",
    "CREATE TABLE nowhere AS SELECT texture, ST_SetSRID(shape, 0)::geometry(Polygon, 0) AS shape FROM soils",
    "CREATE TABLE plain (a int)",
    "CREATE TABLE untyped (texture text, shape geometry)",
    "INSERT INTO untyped SELECT texture, shape FROM soils",
    "CREATE TYPE earth AS ENUM ('sand', 'clay', 'silt', 'gravel', 'peat', 'rock')",
    "CREATE TABLE chosen AS SELECT texture::earth AS texture, shape FROM soils WHERE number IS NOT NULL",
    "CREATE TABLE secret AS SELECT * FROM soils",
    "GRANT USAGE ON SCHEMA survey TO guarded",
    "GRANT SELECT ON survey.degrees TO guarded",
    "",
]


def stripes() -> list[shapely.Polygon]:
    edges = np.concatenate([[0], np.cumsum(np.arange(2, 14))])
    edges = WEST + edges * COLUMNS * CELL / edges[-1]
    return [
        shapely.box(left, NORTH - ROWS * CELL, right, NORTH)
        for left, right in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    ]


@pytest.fixture(scope="module")
def database(postgis_cluster: postgis.Cluster) -> str:
    """A database with a soil table in several systems and under odd names."""
    name = postgis_cluster.new_database()
    with postgis_cluster.connect(name) as connection:
        connection.execute(
            "CREATE TABLE soils (gid serial PRIMARY KEY, number numeric, texture text, "
            "notes jsonb, shape geometry(Polygon, 32616))"
        )
        for number, (texture, polygon) in enumerate(zip(TEXTURES, stripes(), strict=True)):
            connection.execute(
                "INSERT INTO soils (number, texture, shape) VALUES (%s, %s, ST_GeomFromWKB(%s, 32616))",
                (number, texture, polygon.wkb),
            )
        connection.execute("INSERT INTO soils (texture) VALUES ('nowhere')")
        for statement in STATEMENTS:
            connection.execute(statement)
        connection.execute(
            "CREATE TABLE curved AS SELECT 'sand'::text AS texture, ST_GeomFromText(%s, 32616) AS shape", (CIRCLE,)
        )
    return name


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an elevation and the same soils as a file."""
    made = tmp_path_factory.mktemp("files")
    raster_files.write(made / "dem.tif", raster_files.hills(ROWS, COLUMNS))
    write_vector(made / "soils.gpkg", stripes(), {"texture": TEXTURES, "number": range(12)})
    return made


@pytest.fixture(scope="module")
def frame(folder: Path) -> Frame:
    with open_elevation([str(folder / "dem.tif")]) as source:
        return source.frame


@pytest.fixture(scope="module")
def expected(folder: Path, frame: Frame) -> SoilLayer:
    return read_soil(str(folder / "soils.gpkg"), frame, field="texture")


@pytest.mark.parametrize(
    ("table", "field"),
    [
        ("public.soils", "texture"),
        ("public.soils", None),
        ("survey.degrees", None),
        ("survey.earth", "texture"),
        ("survey.seen", None),
        ("twins&geometry=shape", "texture"),
        ("chosen", None),
        ("untyped", None),
        ("survey.Odd' DROP TABLE soils --", "the 'soil\"x"),
        ('survey."Odd\' DROP TABLE soils --"', None),
    ],
)
def test_a_table_gives_the_soil_that_a_file_gives(
    postgis_cluster: postgis.Cluster, database: str, frame: Frame, expected: SoilLayer, table: str, field: str | None
) -> None:
    found = read_soil(f"{postgis_cluster.url(database)}&table={table}", frame, field=field)
    np.testing.assert_array_equal(found.codes, expected.codes)
    assert [(entry.label, entry.cells) for entry in found.report.entries] == [
        (entry.label, entry.cells) for entry in expected.report.entries
    ]
    assert found.report.source == f"postgresql:///{database}?table={table.partition('&')[0]}"


def test_numbers_are_explained_by_a_legend(
    postgis_cluster: postgis.Cluster, database: str, frame: Frame, expected: SoilLayer, tmp_path: Path
) -> None:
    legend = tmp_path / "legend.csv"
    names = [{"peat": "none"}.get(texture, texture) for texture in TEXTURES]
    legend.write_text("n,class\n" + "".join(f"{n},{name}\n" for n, name in enumerate(names)), encoding="ascii")
    url = f"{postgis_cluster.url(database)}&table=public.soils"
    found = read_soil(url, frame, field="number", legend=str(legend))
    np.testing.assert_array_equal(found.codes, expected.codes)


def test_curves_are_followed(postgis_cluster: postgis.Cluster, database: str, frame: Frame) -> None:
    found = read_soil(f"{postgis_cluster.url(database)}&table=curved", frame)
    known = (found.codes == SoilClass.SAND).sum() * CELL**2
    assert known == pytest.approx(np.pi * 600**2, rel=0.01)


def test_only_what_lies_near_the_map_is_fetched_in_batches(
    postgis_cluster: postgis.Cluster, postgis_database: str, frame: Frame
) -> None:
    """Polygons elsewhere are left there; eight thousand here come in two batches, in any order the same."""
    with postgis_cluster.connect(postgis_database) as connection:
        connection.execute(
            "CREATE TABLE cells AS SELECT (ARRAY['sand','clay','silt'])[1 + (r / 2 + c / 2) %% 3] AS texture, "
            "ST_Translate(ST_MakeEnvelope(c * 15, r * -15 - 15, c * 15 + 15, r * -15, 32616), %s, %s) AS shape "
            "FROM generate_series(0, 79) r, generate_series(0, 99) c",
            (WEST, NORTH),
        )
        connection.execute(
            "INSERT INTO cells SELECT 'gravel', ST_MakeEnvelope(n, 0, n + 1, 1, 32616) FROM generate_series(1, 99999) n"
        )
        connection.execute("CREATE INDEX ON cells USING gist (shape)")
        url = f"{postgis_cluster.url(postgis_database)}&table=cells"
        first = read_soil(url, frame)
        connection.execute("CREATE TABLE again AS SELECT * FROM cells ORDER BY random()")
        mixed = f"{postgis_cluster.url(postgis_database)}&table=again"
        second = read_soil(mixed, frame)
        fetched = [fetch_near(single(one), frame) for one in (url, mixed)]
    assert [pyogrio.read_info(one.path)["features"] for one in fetched] == [8000, 8000]
    assert fetched[0].fingerprint() == fetched[1].fingerprint() != "remote"
    assert first.report.covered_fraction == 1
    np.testing.assert_array_equal(first.codes, second.codes)
    assert first.report.entries == second.report.entries
    assert {entry.label for entry in first.report.entries} == {"sand", "clay", "silt"}


def test_a_plan_on_a_table_equals_a_plan_on_a_file(
    postgis_cluster: postgis.Cluster, database: str, folder: Path, tmp_path: Path
) -> None:
    url = f"{postgis_cluster.url(database)}&table=public.soils"
    routes = []
    for number, soil in enumerate((url, str(folder / "soils.gpkg"))):
        out = tmp_path / str(number)
        ends = (f"{WEST + 100},{NORTH - 100}", f"{WEST + 250},{NORTH - 1000}")
        words = way(folder / "dem.tif", "--soil", soil, "--out", str(out), "--vehicle", "tractor", from_to=ends)
        finished = commands.run(*words)
        assert finished.code == 0, finished.err
        route = (out / "route.geojson").read_text(encoding="utf-8")
        routes.append(route.partition('"features"')[2])
    assert routes[0] == routes[1]


@pytest.mark.parametrize(
    ("table", "kind", "words"),
    [
        ("public.soil", UnreadableFileError, r"does not exist\. There is public\.soils"),
        ("plain", UnreadableFileError, "has no geometry column"),
        ("twins", UnreadableFileError, "has the geometry columns shape, far. Choose one with &geometry=COLUMN"),
        ("soils", UnreadableFileError, r"can mean public\.soils, survey\.soils\. Give the schema too"),
        ("nowhere", MissingCrsError, "has no coordinate reference system"),
        ("twins&geometry=far", NoOverlapError, "lies outside the map"),
        ("public.soils&foo=bar", InvalidParameterError, "foo"),
        ("a.b.c", InvalidParameterError, "does not name a table"),
        ("", InvalidParameterError, "does not name a table"),
    ],
)
def test_a_table_that_cannot_be_used_says_why(
    postgis_cluster: postgis.Cluster, database: str, frame: Frame, table: str, kind: type[Exception], words: str
) -> None:
    with pytest.raises(kind, match=words):
        read_soil(f"{postgis_cluster.url(database)}&table={table}", frame)


def test_a_field_that_is_not_there_is_named_with_those_that_are(
    postgis_cluster: postgis.Cluster, database: str, frame: Frame
) -> None:
    with pytest.raises(SoilFieldError, match="has no field 'notes'; it has gid, number, texture"):
        read_soil(f"{postgis_cluster.url(database)}&table=public.soils", frame, field="notes")


def test_databases_and_servers_that_are_not_there_are_refused(
    postgis_cluster: postgis.Cluster, frame: Frame, tmp_path: Path
) -> None:
    with pytest.raises(StoreUnavailableError, match=r'database "nobody" does not exist. Check the names'):
        read_soil(f"{postgis_cluster.url('nobody')}&table=soils", frame)
    with pytest.raises(StoreSchemaError, match="without PostGIS"):
        read_soil(f"{postgis_cluster.url('postgres')}&table=soils", frame)
    with pytest.raises(StoreUnavailableError, match="Check that the server runs"):
        read_soil(f"postgresql://me@/x?host={tmp_path}&table=soils", frame)
    with pytest.raises(StoreUnavailableError, match="Check that the server runs"):
        read_soil("postgresql://me@127.0.0.1:1/x?table=soils", frame)


def test_a_table_is_no_elevation() -> None:
    with pytest.raises(InvalidParameterError, match="no elevation"):
        open_elevation(["postgresql://me@host/x?table=soils"])


def test_the_password_comes_from_the_surroundings_and_is_never_shown(
    postgis_cluster: postgis.Cluster, database: str, folder: Path, tmp_path: Path
) -> None:
    url = f"{postgis_cluster.url(database, postgis.GUARDED)}&table=survey.degrees"
    ends = (f"{WEST + 100},{NORTH - 100}", f"{WEST + 250},{NORTH - 1000}")
    words = way(folder / "dem.tif", "--soil", url, "--out", str(tmp_path / "out"), "--debug", from_to=ends)
    wrong = commands.run(*words, env={"PGPASSWORD": "guess-1234"})
    assert wrong.code == 4
    assert "Put the right password into PGPASSWORD or ~/.pgpass" in wrong.err
    assert "guess-1234" not in wrong.err + wrong.out
    right = commands.run(*words, env={"PGPASSWORD": postgis.PASSWORD})
    assert right.code in (0, 3), right.err
    kept = "".join(
        path.read_text(encoding="utf-8")
        for path in (tmp_path / "out").iterdir()
        if path.suffix in (".json", ".html", ".geojson")
    )
    assert f"postgresql:///{database}?table=survey.degrees" in kept
    assert postgis.PASSWORD not in kept + right.out + right.err
    passes = tmp_path / "pgpass"
    passes.write_text(f"*:*:*:{postgis.GUARDED}:{postgis.PASSWORD}\n", encoding="ascii")
    passes.chmod(0o600)
    by_file = commands.run(*words, env={"PGPASSFILE": str(passes)})
    assert by_file.code == right.code, by_file.err


def test_a_user_without_rights_is_told_so(
    postgis_cluster: postgis.Cluster, database: str, frame: Frame, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PGPASSWORD", postgis.PASSWORD)
    for table in ("secret", "public.soils"):
        with pytest.raises(UnreadableFileError, match=r"may not be read by this user\. Ask its owner for GRANT SELECT"):
            read_soil(f"{postgis_cluster.url(database, postgis.GUARDED)}&table={table}", frame)


SECRET = "xyzzy-1234"  # noqa: S105 - of nothing


@pytest.mark.parametrize(
    "address",
    [
        f"postgresql://me:{SECRET}@host/x?table=t",
        f"postgres://me:{SECRET}@host:port/x?table=t",
        f"postgresql://me@host/x?table=t&password={SECRET}",
        f"postgresql://me@host/x?PASSWORD={SECRET}",
        f"postgresql://me@host/x?table=t&sslpassword={SECRET}",
        f"postgresql://me:{SECRET}@host/x",
        f"postgresql://me:{SECRET}@[host/x?table=t",
    ],
)
def test_an_address_with_a_password_is_refused_without_repeating_it(
    address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InvalidParameterError) as refusal:
        single(address)
    assert SECRET not in str(refusal.value)
    words = ("--dem", "bundled:jacksboro", "--start=-84.1311,36.4621", "--goal=-84.1872,36.5762", "--soil", address)
    finished = commands.run_here(capsys, "plan", *words, "--json")
    assert finished.code == 2
    assert SECRET not in finished.out + finished.err


@given(st.text(max_size=30), st.text(max_size=30))
def test_no_address_of_a_table_is_a_bug(first: str, second: str) -> None:
    try:
        found = table_address(f"postgresql://{first}?{second}")
    except InputError:
        return
    except InvalidParameterError:
        return
    assert found.table


def test_a_server_that_goes_away_in_the_middle_is_said(
    postgis_cluster: postgis.Cluster, postgis_database: str, frame: Frame
) -> None:
    with postgis_cluster.connect(postgis_database) as connection:
        # A view that takes its time.
        connection.execute(
            "CREATE VIEW slow AS SELECT 'sand'::text AS texture, (CASE WHEN pg_sleep(5) IS NULL THEN NULL ELSE "
            "ST_MakeEnvelope(0, 0, 1, 1, 32616) END)::geometry(Polygon, 32616) AS shape FROM generate_series(1, 100)"
        )

    def end() -> None:
        for _ in range(2000):
            with postgis_cluster.connect() as connection:
                ended = connection.execute(
                    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                    "WHERE application_name = 'swathe' AND query LIKE '%ST_AsBinary%' OR query LIKE 'FETCH%'"
                ).fetchall()
            if ended:
                return
            time.sleep(0.02)

    ender = threading.Thread(target=end)
    ender.start()
    with pytest.raises(StoreUnavailableError, match=r"terminating connection|closed the connection"):
        read_soil(f"{postgis_cluster.url(postgis_database)}&table=slow", frame)
    ender.join()


def test_without_psycopg_the_line_to_install_it_is_said(folder: Path) -> None:
    code = f"""
import sys
sys.modules["psycopg"] = None
from swathe.cli import main
main(["plan", "--dem", {str(folder / "dem.tif")!r}, "--soil", "postgresql://me@host/x?table=t", "--json",
      "--points-crs", "native", "--start", "{WEST + 100},{NORTH - 100}", "--goal", "{WEST + 250},{NORTH - 1000}"])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=folder)
    assert done.returncode == 4, done.stderr
    assert "pip install 'swathe[postgis]'" in done.stdout
