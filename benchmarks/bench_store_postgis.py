"""The store in PostGIS: a large import against raster2pgsql, windows against ST_Union, and eight writers at once."""

from __future__ import annotations

import shutil
import subprocess
import sys
from functools import partial
from typing import TYPE_CHECKING

import grass_peer
import terrain_fields
from harness import Benchmark, Contender
from postgis_server import Server

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

SIDE = 10_000
CELL_M = 10.0
WRITERS = 8
OVERVIEWS = "2,4,8,16,32,64"


def prepare_import() -> tuple[Server, Path]:
    server = Server()
    server.folder.joinpath("input").mkdir(mode=0o755)
    source = server.folder / "input" / "dem.tif"
    grass_peer.write_geotiff(source, terrain_fields.elevation(SIDE), CELL_M)
    server.restart()
    return server, source


def run_ours(prepared: tuple[Server, Path]) -> None:
    from swathe.store import open_store
    from swathe.store.imports import import_elevation

    server, source = prepared
    with open_store(server.url, create=True) as store:
        import_elevation(store, "bench", [str(source)])
    server.stop()


def run_raster2pgsql(prepared: tuple[Server, Path], *, overviews: bool) -> None:
    server, source = prepared
    program, psql = shutil.which("raster2pgsql"), shutil.which("psql")
    if program is None or psql is None:
        raise RuntimeError("raster2pgsql is not installed: sudo apt-get install --no-install-recommends postgis")
    # COPY, tiles as ours, the index as ours; without overviews it does less than we do.
    more = ["-l", OVERVIEWS] if overviews else []
    command = [program, "-s", "32632", "-t", "256x256", "-I", "-Y", *more, str(source), "public.dem"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as making:
        load = [psql, "-q", "-v", "ON_ERROR_STOP=1", "-d", server.url, "-o", "/dev/null"]
        subprocess.run(load, stdin=making.stdout, check=True)
    server.stop()


FACTS = """
    SELECT sum(ST_Width(rast) * ST_Height(rast)), sum((s).count), sum((s).sum), min((s).min), max((s).max)
    FROM {}, LATERAL ST_SummaryStats(rast) s
"""


def facts_of_import(table: tuple[str, str], prepared: tuple[Server, Path], _result: None) -> dict[str, float]:
    from psycopg import sql

    server, _ = prepared
    server.start()
    with server.connect() as connection:
        found = connection.execute(sql.SQL(FACTS).format(sql.Identifier(*table))).fetchone()
    server.remove()
    return dict(zip(("cells", "known", "sum", "least", "greatest"), map(float, found), strict=True))


WINDOW_MAP, WINDOW_SIDE, WINDOWS = 4096, 1000, 20


def prepare_windows() -> Server:
    from swathe.grid import GridGeometry
    from swathe.io.crs import Frame, parse_crs
    from swathe.store import TILE_SIZE, Provenance, open_store

    server = Server()
    heights = terrain_fields.elevation(WINDOW_MAP)
    geometry = GridGeometry(WINDOW_MAP, WINDOW_MAP, CELL_M, grass_peer.WEST_M, grass_peer.SOUTH_M + WINDOW_MAP * CELL_M)
    with open_store(server.url, create=True) as store:
        store.create_region("bench", Frame(geometry, parse_crs("EPSG:32632").to_wkt()))
        with store.begin_import("bench", "elevation", Provenance((("made", "here"),))) as session:
            for top in range(0, WINDOW_MAP, TILE_SIZE):
                for left in range(0, WINDOW_MAP, TILE_SIZE):
                    tile = heights[top : top + TILE_SIZE, left : left + TILE_SIZE]
                    session.write_tile(top // TILE_SIZE, left // TILE_SIZE, tile)
            session.commit()
    server.restart()
    return server


def corners() -> list[tuple[int, int]]:
    """Return rows and columns where windows begin, none on the edge of a tile."""
    return [(37 + 150 * n, 3000 - 140 * n) for n in range(WINDOWS)]


def run_windows(server: Server) -> float:
    """Read the windows and return the sum of their cells."""
    from swathe.grid import Window
    from swathe.store import open_store

    total = 0.0
    with open_store(server.url) as store:
        for row, column in corners():
            window = store.read_window("bench", "elevation", Window(row, column, WINDOW_SIDE, WINDOW_SIDE))
            total += float(window.sum(dtype="f8"))
    server.stop()
    return total


def run_union(server: Server) -> float:
    """Let the server put the tiles together and cut the same windows out of what it sends."""
    from swathe.store.raster_wkb import decode

    total = 0.0
    asked = (
        "SELECT ST_AsBinary(ST_Union(rast)) FROM swathe.tiles "
        "WHERE tile_row BETWEEN %s AND %s AND tile_column BETWEEN %s AND %s"
    )
    with server.connect() as connection, connection.cursor(binary=True) as cursor:
        for row, column in corners():
            first, left = row // 256, column // 256
            ends = (row + WINDOW_SIDE - 1) // 256, (column + WINDOW_SIDE - 1) // 256
            (wkb,) = cursor.execute(asked, (first, ends[0], left, ends[1])).fetchone()
            top, start = row - first * 256, column - left * 256
            pixels = decode(wkb).pixels[top : top + WINDOW_SIDE, start : start + WINDOW_SIDE]
            total += float(pixels.sum(dtype="f8"))
    server.stop()
    return total


def facts_of_windows(server: Server, total: float) -> dict[str, float]:
    server.remove()
    return {"sum": total}


WRITER = """
import sys
from pathlib import Path
url, author, count, batch = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
import psycopg
from swathe.belief import PenetrometerReading
from swathe.store import StoredReading, open_store

def reading(n):
    push = PenetrometerReading(500005.0 + n % 9000, 5000005.0, (0.05, 0.1, 0.15), (300.0, 350.0, 400.0 + n % 50))
    return StoredReading(f"{author}-{n}", push, author, "2026-05-01T10:00:00Z", "cone-1", 0.1)

def wait():
    print("ready", flush=True)
    sys.stdin.readline()

if sys.argv[5] == "ours":
    with open_store(url) as store:
        wait()
        for first in range(0, count, batch):
            store.add_readings("bench", [reading(n) for n in range(first, first + batch)])
else:
    with psycopg.connect(url) as connection:
        wait()
        statement = "INSERT INTO plain VALUES (%s, %s, %s, %s, %s, %s, %s, %s, %s)"
        for first in range(0, count, batch):
            rows = []
            for stored in map(reading, range(first, first + batch)):
                push = stored.reading
                rows.append((stored.id, author, stored.time, stored.instrument, stored.error, push.x_m, push.y_m,
                             list(push.depths_m), list(push.cone_indices_kpa)))
            with connection.cursor() as cursor:
                cursor.executemany(statement, rows)
            connection.commit()
"""


def prepare_writers(side: str, count: int, batch: int) -> tuple[Server, list[subprocess.Popen[str]]]:
    from swathe.grid import GridGeometry
    from swathe.io.crs import Frame, parse_crs
    from swathe.store import open_store

    server = Server()
    with open_store(server.url, create=True) as store:
        store.create_region(
            "bench", Frame(GridGeometry(1000, 1000, 10, 500_000, 5_010_000), parse_crs("EPSG:32632").to_wkt())
        )
    with server.connect() as connection:
        connection.execute(
            "CREATE TABLE plain (id text PRIMARY KEY, author text, time text, instrument text, error float8, "
            "x_m float8, y_m float8, depths_m float8[], cone_index_kpa float8[])"
        )
    server.restart()
    writers = [
        subprocess.Popen(
            [sys.executable, "-c", WRITER, server.url, f"rover {n}", str(count), str(batch), side],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for n in range(WRITERS)
    ]
    for writer in writers:
        if writer.stdout is None or writer.stdout.readline() != "ready\n":
            raise RuntimeError("A writer does not start.")
    return server, writers


def run_writers(prepared: tuple[Server, list[subprocess.Popen[str]]]) -> None:
    """Let all writers go at once: readings over wall-clock seconds of this is the rate."""
    server, writers = prepared
    for writer in writers:
        if writer.stdin is not None:
            writer.stdin.write("go\n")
            writer.stdin.flush()
    if sum(writer.wait() for writer in writers) != 0:
        raise RuntimeError("A writer failed.")
    server.stop()


def facts_of_writers(
    side: str, prepared: tuple[Server, list[subprocess.Popen[str]]], _result: None
) -> dict[str, float]:
    server, _ = prepared
    server.start()
    count = "SELECT count(*) FROM swathe.readings" if side == "ours" else "SELECT count(*) FROM plain"
    with server.connect() as connection:
        (filed,) = connection.execute(count).fetchone()
    server.remove()
    return {"readings": float(filed)}


def writers(name: str, count: int, batch: int) -> Benchmark:
    def side(which: str) -> tuple[Callable[[], object], Callable[..., dict[str, float]]]:
        return partial(prepare_writers, which, count, batch), partial(facts_of_writers, which)

    ours, peer = side("ours"), side("plain")
    return Benchmark(
        name,
        ours=Contender("swathe.store, eight processes", ours[0], run_writers, ours[1]),
        peer=Contender("psycopg, INSERT into a bare table", peer[0], run_writers, peer[1]),
        must=0.3,
        goal=0.5,
    )


def import_against(name: str, *, overviews: bool, must: float, goal: float) -> Benchmark:
    return Benchmark(
        name,
        ours=Contender(
            "swathe.store import, with overviews",
            prepare_import,
            run_ours,
            partial(facts_of_import, ("swathe", "tiles")),
        ),
        peer=Contender(
            "raster2pgsql -Y" + (f" -l {OVERVIEWS}" if overviews else "") + " | psql",
            prepare_import,
            partial(run_raster2pgsql, overviews=overviews),
            partial(facts_of_import, ("public", "dem")),
        ),
        must=must,
        goal=goal,
        agree_relative=1e-9,
    )


BENCHMARKS = [
    Benchmark(
        "store-postgis-windows",
        ours=Contender("swathe.store read_window", prepare_windows, run_windows, facts_of_windows),
        peer=Contender("ST_AsBinary(ST_Union(rast))", prepare_windows, run_union, facts_of_windows),
        must=5.0,
        goal=10.0,
        agree_relative=1e-12,
    ),
    import_against("store-postgis-import", overviews=False, must=1.0, goal=2.0),
    import_against("store-postgis-import-overviews", overviews=True, must=1.0, goal=3.0),
    writers("store-postgis-readings", 250, 1),
    writers("store-postgis-readings-100", 5000, 100),
]
