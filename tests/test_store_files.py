"""The store in a project folder: what other programs see of it, and what it does when things go wrong."""

from __future__ import annotations

import ctypes
import json
import os
import resource
import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import shapely

import killed_imports
import requirement
import stored
from swathe.errors import (
    StoreBusyError,
    StoreDamagedError,
    StoreError,
    StoreFullError,
    StoreSchemaError,
    StoreUnavailableError,
)
from swathe.grid import Window
from swathe.io.tiled_raster import write_cog
from swathe.soil import SoilClass
from swathe.store import StoredRoute, Zone, open_store

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

HEIGHTS = np.arange(300 * 400, dtype=np.float32).reshape(300, 400)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A project folder with something of everything."""
    folder = tmp_path / "project"
    with open_store(folder, create=True) as store:
        stored.put(store, "valley", "elevation", HEIGHTS)
        west, east = stored.box(0, 0, 300, 200), stored.box(0, 200, 300, 200)
        pieces = [stored.polygon(west, SoilClass.SAND, cat=1), stored.polygon(east, SoilClass.CLAY, cat=2)]
        details = stored.legend(SoilClass.SAND, SoilClass.CLAY)
        store.write_soil_polygons("valley", [pieces], stored.provenance("s"), details=details)
        store.write_zones("valley", [[Zone(shapely.to_wkb(stored.box(5, 5, 9, 9)), "lake")]], stored.provenance("z"))
        store.add_readings("valley", [stored.push("a", 3, 3), stored.word("b", 9, 9, SoilClass.ROCK)])
        line = shapely.LineString([(stored.WEST + 30, stored.NORTH - 30), (stored.WEST + 90, stored.NORTH - 60)])
        store.add_route("valley", StoredRoute("r", shapely.to_wkb(line), "tractor", {"length_m": 67.0}))
    return folder


@pytest.fixture
def ogrinfo() -> Path:
    return requirement.program("gdal", ("ogrinfo",), "gdal-bin")


def output_of(*words: str | Path) -> str:
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "ERROR" not in done.stderr, done.stderr
    assert "Warning" not in done.stderr, done.stderr
    return done.stdout


def test_ogr_reads_every_layer_of_the_geopackage(folder: Path, ogrinfo: Path) -> None:
    listed = output_of(ogrinfo, "-ro", "-so", "-al", folder / "swathe.gpkg")
    with sqlite3.connect(folder / "swathe.gpkg") as inside:
        tables = dict(inside.execute("SELECT table_name, data_type FROM gpkg_contents"))
        checks = [inside.execute(f"PRAGMA {check}").fetchall() for check in ("integrity_check", "foreign_key_check")]
    assert checks == [[("ok",)], []]
    counts = {
        name: int(listed.split(f"Layer name: {name}\n")[1].split("Feature Count: ")[1].split("\n")[0])
        for name in tables
    }
    features = {name.split("_")[0]: counts[name] for name, kind in tables.items() if kind == "features"}
    assert features == {"regions": 1, "soil": 2, "zones": 1, "readings": 2, "routes": 1}
    assert counts["layers"] == 3
    assert counts["changes"] == 6
    assert listed.count('ID["EPSG",32616]') == 4
    soil = next(name for name in tables if name.startswith("soil_"))
    shown = output_of(ogrinfo, "-ro", "-where", "cat = 2", folder / "swathe.gpkg", soil)
    assert "soil_class (String) = clay" in shown
    assert 'attributes (String) = {"grün":"ja","n":1.5}' in shown
    west, north = stored.WEST + 1000, stored.NORTH - 1000
    near = output_of(
        ogrinfo, "-ro", "-so", "-spat", *(str(n) for n in (west, north - 10, west + 10, north)),
        folder / "swathe.gpkg", soil,
    )  # fmt: skip
    assert "Feature Count: 1" in near


def test_ogr_may_edit_a_layer_and_its_index_follows(folder: Path, ogrinfo: Path) -> None:
    with sqlite3.connect(folder / "swathe.gpkg") as inside:
        found = inside.execute("SELECT table_name FROM gpkg_contents WHERE data_type = 'features'").fetchall()
        tables = {name.split("_")[0]: name for (name,) in found}
    zones, soil = tables["zones"], tables["soil"]
    for sql in (
        f"DELETE FROM {zones}",
        f"INSERT INTO {zones} (geom, name, attributes) SELECT geom, 'east', '{{}}' FROM {soil} WHERE cat = 2",
    ):
        output_of(ogrinfo, folder / "swathe.gpkg", "-sql", sql)
    west, east = (shapely.bounds(stored.box(50, column, 1, 1)) for column in (50, 350))
    with open_store(folder) as store:
        assert [zone.name for zone in store.zones("valley")] == ["east"]
        assert [zone.name for zone in store.zones("valley", tuple(west))] == []
        assert [zone.name for zone in store.zones("valley", tuple(east))] == ["east"]


def test_gdal_reads_the_elevation_with_identical_sums(folder: Path, gdaldem: Path) -> None:
    (file,) = (folder / "elevation").iterdir()
    info = json.loads(output_of(gdaldem.with_name("gdalinfo"), "-json", "-stats", file))
    assert info["metadata"]["IMAGE_STRUCTURE"]["LAYOUT"] == "COG"
    assert info["metadata"]["IMAGE_STRUCTURE"]["COMPRESSION"] == "ZSTD"
    (band,) = info["bands"]
    assert band["block"] == [256, 256]
    assert band["overviews"]
    assert info["geoTransform"] == [stored.WEST, stored.CELL, 0, stored.NORTH, 0, -stored.CELL]
    figures = band["metadata"][""]
    assert float(figures["STATISTICS_MINIMUM"]) == 0
    assert float(figures["STATISTICS_MAXIMUM"]) == HEIGHTS.size - 1
    assert float(figures["STATISTICS_MEAN"]) == pytest.approx((HEIGHTS.size - 1) / 2, rel=1e-12)
    checked = output_of(
        gdaldem.with_name("gdal_translate"), "-q", "-of", "XYZ", "-srcwin", "390", "290", "5", "5", file, "/vsistdout/"
    )
    assert len(checked.splitlines()) == 25
    assert float(checked.split()[2]) == HEIGHTS[290, 390]


@pytest.mark.parametrize("seed", [1])
def test_an_import_that_is_killed_leaves_the_old_or_the_new_and_goes_on(tmp_path: Path, seed: int) -> None:
    driver = Path(killed_imports.__file__)
    done = subprocess.run(
        [sys.executable, driver, tmp_path / "project", "12", str(seed)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in done.stdout.splitlines()]
    for what, killed, finished, old, new, mixture, resumed in rows[2:]:
        assert what in {"elevation", "soil"}
        assert int(killed) + int(finished) == int(old) + int(new) == int(resumed) == 12
        assert int(killed) >= 2
        assert mixture == "0"
    left = {path.name for path in (tmp_path / "project").rglob("*") if path.is_file()}
    assert left - {"valley.elevation.lock", "valley.soil.lock"} == {"swathe.gpkg"} | {
        path.name for path in (tmp_path / "project" / "elevation").iterdir()
    }
    assert len(list((tmp_path / "project" / "elevation").iterdir())) == 1


def test_a_reading_that_was_accepted_outlives_its_writer(tmp_path: Path) -> None:
    url = str(tmp_path / "project")
    with open_store(url, create=True) as store:
        stored.two_soils(store, rows=60)
    code = f"import killed_imports; killed_imports.file_readings({url!r}, 0)"
    for _ in range(3):
        writer = subprocess.Popen(
            [sys.executable, "-c", code], cwd=Path(killed_imports.__file__).parent, stdout=subprocess.PIPE, text=True
        )
        assert writer.stdout is not None
        heard = [writer.stdout.readline() for _ in range(4)]
        writer.kill()
        heard += writer.stdout.readlines()
        writer.wait()
        writer.stdout.close()
        accepted = {line.split()[1] for line in heard if line.endswith("\n")}
        with open_store(url) as store:
            assert accepted <= {one.id for one in store.readings("valley")}
            revisions = [change.revision for change in store.changes("valley")]
        assert revisions == list(range(1, len(revisions) + 1))


@pytest.mark.parametrize("damage", ["empty", "half", "head", "text", "other"])
def test_a_geopackage_that_is_damaged_or_not_ours_is_told(folder: Path, damage: str) -> None:
    file = folder / "swathe.gpkg"
    content = file.read_bytes()
    if damage == "other":
        file.unlink()
        with sqlite3.connect(file) as inside:
            inside.execute("CREATE TABLE somebody (something)")
        expected: type[StoreError] = StoreSchemaError
    else:
        spoilt = {"empty": b"", "half": content[: len(content) // 2], "head": content[:50], "text": b"hello" * 999}
        file.write_bytes(spoilt[damage])
        expected = StoreSchemaError if damage == "empty" else StoreDamagedError

    def use() -> None:
        with open_store(folder) as store:
            store.regions()
            list(store.soil_polygons("valley"))
            store.readings("valley")
            store.routes("valley")

    with pytest.raises(expected) as told:
        use()
    assert told.value.exit_code == 4
    assert told.value.remedy
    assert "project" in told.value.message


def test_a_newer_schema_is_left_alone(folder: Path) -> None:
    with sqlite3.connect(folder / "swathe.gpkg") as inside:
        inside.execute("UPDATE swathe_store SET value = '999' WHERE key = 'schema'")
    for create in (False, True):
        with pytest.raises(StoreSchemaError, match="999"):
            open_store(folder, create=create)


def test_there_is_no_store_where_there_is_none(tmp_path: Path) -> None:
    for place in (tmp_path, tmp_path / "nowhere", tmp_path / "a" / "b"):
        with pytest.raises(StoreUnavailableError, match=place.name):
            open_store(place)
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").write_text("x")
    with pytest.raises(StoreUnavailableError):
        open_store(tmp_path / "file", create=True)
    with pytest.raises(StoreUnavailableError, match="ftp"):
        open_store("ftp://somewhere/else")
    with open_store((tmp_path / "with space ü").as_uri(), create=True):
        assert (tmp_path / "with space ü" / "swathe.gpkg").is_file()


def test_a_raster_that_is_cut_short_or_gone_is_told(folder: Path) -> None:
    (file,) = (folder / "elevation").iterdir()
    content = file.read_bytes()
    for left in (content[: len(content) // 2], content[:20], None):
        file.unlink(missing_ok=True)
        if left is not None:
            file.write_bytes(left)
        with open_store(folder) as store, pytest.raises(StoreDamagedError, match="elevation"):
            store.read_window("valley", "elevation", Window(0, 0, 300, 400))
    with open_store(folder) as store:
        stored.put(store, "valley", "elevation", HEIGHTS)  # the same source again mends it
        np.testing.assert_array_equal(store.read_window("valley", "elevation", Window(0, 0, 300, 400)), HEIGHTS)


def heed_permissions() -> None:
    """Take from this process what lets root write where nobody may (the capabilities DAC_OVERRIDE and FOWNER)."""
    if os.geteuid() == 0:
        for capability in (1, 3):
            ctypes.CDLL(None).prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP


def without_rights(code: str) -> subprocess.CompletedProcess[str]:
    """Run Python where permissions hold for root too."""
    return subprocess.run(
        [sys.executable, "-B", "-c", code],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=heed_permissions,
    )


@pytest.fixture
def locked_folder(folder: Path) -> Iterator[Path]:
    """The project folder where anybody may read and nobody write."""
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    yield folder
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o755)


def test_a_folder_that_may_only_be_read_is_read_and_not_written(locked_folder: Path) -> None:
    code = f"""
import stored
from swathe.errors import StoreReadOnlyError
from swathe.grid import Window
from swathe.io.tiled_raster import write_cog
from swathe.store import open_store
with open_store({str(locked_folder)!r}) as store:
    assert store.read_window("valley", "elevation", Window(1, 2, 1, 1))[0, 0] == 402
    assert len(list(store.soil_polygons("valley"))) == 2
    assert len(store.readings("valley")) == 2
    assert store.soil_window("valley", Window(0, 0, 3, 3))[0, 0] == 2
    for write in (
        lambda: store.add_readings("valley", [stored.push("c", 3, 3)]),
        lambda: store.create_region("new", stored.frame(3, 3)),
        lambda: store.begin_import("valley", "elevation", stored.provenance("q")),
        lambda: store.write_soil_polygons("valley", [], stored.provenance("q")),
        lambda: store.drop_region("valley"),
    ):
        try:
            write()
        except StoreReadOnlyError as error:
            assert error.exit_code == 4
        else:
            raise SystemExit("it was written")
print("read")
"""
    done = without_rights(code)
    assert (done.returncode, done.stdout) == (0, "read\n"), done.stderr
    made = without_rights(
        f"from swathe.store import open_store; open_store({str(locked_folder / 'new')!r}, create=True)"
    )
    assert "StoreReadOnlyError" in made.stderr


def test_changes_that_only_the_journal_holds_are_not_left_out_in_silence(folder: Path) -> None:
    code = f"""
import os, stored
from swathe.store import open_store
open_store({str(folder)!r}).add_readings("valley", [stored.push("late", 3, 3)])
os._exit(0)
"""
    assert subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parent, check=False).returncode == 0
    assert (folder / "swathe.gpkg-wal").stat().st_size > 0
    (folder / "swathe.gpkg-shm").unlink()
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    done = without_rights(
        f"from swathe.store import open_store; print(len(open_store({str(folder)!r}).readings('valley')))"
    )
    assert done.stdout.strip() == "3" or "StoreReadOnlyError" in done.stderr, done.stderr
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o755)
    with open_store(folder) as store:
        assert len(store.readings("valley")) == 3


def limited(size: int) -> Callable[[], None]:
    """Return what lets a process write files up to a size."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


@pytest.mark.parametrize("limit", [150_000, 400_000, 900_000, 2_200_000])
def test_a_full_disk_loses_nothing_and_the_import_goes_on(tmp_path: Path, limit: int) -> None:
    url = str(tmp_path / "project")
    noise = np.random.default_rng(1).normal(size=(500, 500)).astype(np.float32)
    with open_store(url, create=True) as store:
        stored.put(store, "valley", "elevation", np.zeros((500, 500), dtype=np.float32), "a")
    np.save(tmp_path / "noise.npy", noise)
    code = f"""
import numpy as np, stored
from swathe.errors import StoreFullError
from swathe.store import open_store
try:
    with open_store({url!r}) as store:
        stored.put(store, "valley", "elevation", np.load({str(tmp_path / "noise.npy")!r}), "b")
except StoreFullError as error:
    print("full:", error)
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limited(limit),
    )
    assert done.returncode == 0, done.stderr
    wide_enough = limit > 2_000_000
    assert done.stdout.startswith("full:") is not wide_enough, done.stdout
    with open_store(url) as store:
        whole = Window(0, 0, 500, 500)
        np.testing.assert_array_equal(store.read_window("valley", "elevation", whole), noise if wide_enough else 0)
        stored.put(store, "valley", "elevation", noise, "b")
        np.testing.assert_array_equal(store.read_window("valley", "elevation", whole), noise)


def test_a_full_disk_refuses_readings_and_keeps_those_that_are_there(folder: Path) -> None:
    code = f"""
import stored
from swathe.errors import StoreFullError
from swathe.store import open_store
with open_store({str(folder)!r}) as store:
    done = 0
    try:
        for n in range(4000):
            store.add_readings("valley", [stored.push(f"n{{n}}-{{k}}", 3, 3) for k in range(40)])
            done += 40
    except StoreFullError as error:
        print(done)
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limited((folder / "swathe.gpkg").stat().st_size + 200_000),
    )
    assert done.returncode == 0, done.stderr
    with open_store(folder) as store:
        assert len(store.readings("valley")) == 2 + int(done.stdout)
        store.add_readings("valley", [stored.push("later", 3, 3)])


def test_a_tile_that_the_machine_lost_is_written_again(tmp_path: Path) -> None:
    with open_store(tmp_path / "project", create=True) as store:
        store.create_region("valley", stored.frame(600, 600))
        with store.begin_import("valley", "elevation", stored.provenance("a"), details=stored.DETAILS) as session:
            for place in ((0, 0), (1, 1), (1, 0)):
                session.write_tile(*place, np.ones((256, 256), dtype=np.float32))
        (bench,) = tmp_path.rglob("tiles.tif")
        content = bytearray(bench.read_bytes())
        spot = content.index(np.ones(4, dtype=np.float32).tobytes())
        content[spot : spot + 4] = b"\0\0\0\0"
        bench.write_bytes(bytes(content))
        (journal,) = tmp_path.rglob("done")
        journal.write_bytes(journal.read_bytes() + b"cut")
        with store.begin_import("valley", "elevation", stored.provenance("a"), details=stored.DETAILS) as session:
            assert session.have() == {(1, 1), (1, 0)}
            session.write_tile(0, 0, np.ones((256, 256), dtype=np.float32))
        with store.begin_import("valley", "elevation", stored.provenance("a"), details=stored.DETAILS) as session:
            assert session.have() == {(0, 0), (1, 1), (1, 0)}
            session.commit()
        assert store.read_window("valley", "elevation", Window(0, 0, 10, 10)).sum() == 100


def test_a_cog_that_is_not_what_was_written_does_not_count(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from swathe.store import file_import

    def spoilt(workbench: Path, target: Path) -> None:
        write_cog(workbench, target)
        content = bytearray(target.read_bytes())
        content[-2000:-1000] = bytes(1000)
        target.write_bytes(bytes(content))

    new = np.random.default_rng(1).normal(size=HEIGHTS.shape).astype(np.float32)
    with open_store(folder) as store:
        with monkeypatch.context() as patch:
            patch.setattr(file_import, "write_cog", spoilt)
            with pytest.raises(StoreFullError, match="whole"):
                stored.put(store, "valley", "elevation", new, "n")
        np.testing.assert_array_equal(store.read_window("valley", "elevation", Window(0, 0, 300, 400)), HEIGHTS)
        stored.put(store, "valley", "elevation", new, "n")
        np.testing.assert_array_equal(store.read_window("valley", "elevation", Window(0, 0, 300, 400)), new)


def test_a_map_that_is_replaced_under_a_reader_is_told(folder: Path) -> None:
    with open_store(folder) as reader, open_store(folder) as writer:
        many = [stored.polygon(stored.box(n % 290, n % 390, 3, 3), SoilClass.SAND) for n in range(5000)]
        writer.write_soil_polygons("valley", [many], stored.provenance("m"), details=stored.legend(SoilClass.SAND))
        pieces = reader.soil_polygons("valley")
        next(pieces)
        writer.write_soil_polygons("valley", [many[:1]], stored.provenance("n"), details=stored.legend(SoilClass.SAND))
        with pytest.raises(StoreBusyError, match="replaced"):
            list(pieces)


def test_a_writer_that_hangs_is_not_waited_for_without_end(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swathe.store.geopackage.BUSY_S", 0.2)
    with open_store(folder) as store, sqlite3.connect(folder / "swathe.gpkg", isolation_level=None) as hanging:
        hanging.execute("BEGIN IMMEDIATE")
        with pytest.raises(StoreBusyError):
            store.add_readings("valley", [stored.push("x", 3, 3)])
        assert len(store.readings("valley")) == 2  # readers do not wait
        hanging.execute("ROLLBACK")
        assert store.add_readings("valley", [stored.push("x", 3, 3)]) == 1
    hanging.close()


def test_a_local_height_map_and_another_body_have_a_store_too(tmp_path: Path) -> None:
    from swathe.grid import GridGeometry
    from swathe.io.crs import Frame, parse_crs

    moon = parse_crs("IAU_2015:30110").to_wkt()
    with open_store(tmp_path, create=True) as store:
        for name, frame in (
            ("picture", Frame(GridGeometry(20, 30, 2.5, 0.0, 50.0), None, (7.0, 9.0), 0.5)),
            ("moon", Frame(GridGeometry(20, 30, 100.0, -500.0, 900.0), moon)),
        ):
            store.create_region(name, frame)
            assert store.region(name).frame == frame


def test_stores_are_made_at_once_by_many(tmp_path: Path) -> None:
    code = f"""
import sys, stored
from swathe.store import open_store
with open_store({str(tmp_path / "project")!r}, create=True) as store:
    store.create_region(sys.argv[1], stored.frame(3, 3))
"""
    makers = [
        subprocess.Popen([sys.executable, "-c", code, f"region {n}"], cwd=Path(__file__).parent) for n in range(4)
    ]
    assert [maker.wait() for maker in makers] == [0] * 4
    with open_store(tmp_path / "project") as store:
        assert len(store.regions()) == 4
