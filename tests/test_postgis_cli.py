"""The commands on a PostGIS store: the same answers as from files, clear refusals, and no password anywhere."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
import rasterio

import commands
import postgis
import stored
from swathe.grid import Window
from swathe.store import open_store

if TYPE_CHECKING:
    from pathlib import Path


def imported(url: str, dem: Path, *more: str) -> commands.Finished:
    return commands.run("import", "dem", str(dem), "--store", url, "--region", "hills", "--json", *more)


def planned(url: str, out: Path, *more: str) -> commands.Finished:
    words = ("--points-crs", "native", "--start", commands.START, "--goal", commands.GOAL, "--out", str(out))
    return commands.run("plan", "--store", url, "--region", "hills", "--json", *words, *more)


@pytest.mark.parametrize("profile", ["metric", "paper"])
def test_import_and_plan_give_what_files_give(
    postgis_cluster: postgis.Cluster, postgis_database: str, tmp_path: Path, profile: str
) -> None:
    url, dem = postgis_cluster.url(postgis_database), commands.hills(tmp_path)
    assert imported(url, dem).answer["status"] == "done"
    assert imported(url, dem).answer["status"] == "no_change"
    more = ("--profile", profile, "--vehicle", "tractor")
    from_store = planned(url, tmp_path / "store", *more)
    from_files = commands.run(*commands.way(dem, "--json", "--out", str(tmp_path / "files"), *more))
    assert from_store.code == from_files.code
    assert from_store.answer["status"] == from_files.answer["status"]
    for name in ("nests.geojson", "route.geojson", "rank.tif"):
        if (tmp_path / "files" / name).exists():
            assert (tmp_path / "store" / name).read_bytes() == (tmp_path / "files" / name).read_bytes(), name


def test_readings_and_zones_count_in_the_next_plan(
    postgis_cluster: postgis.Cluster, postgis_database: str, tmp_path: Path
) -> None:
    url = postgis_cluster.url(postgis_database)
    with open_store(url, create=True) as store:
        stored.two_soils(store, "hills", 80, 90)
    csv = tmp_path / "pushes.csv"
    csv.write_text("x,y,ci_5cm,ci_10cm,ci_15cm\n740500,4049500,40,45,50\n740600,4049400,41,44,52\n", encoding="ascii")
    words = ("--store", url, "--region", "hills", "--points-crs", "native", "--json")
    first = commands.run("import", "readings", str(csv), *words)
    assert (first.code, first.answer["status"], first.answer["new"]) == (0, "done", 2)
    again = commands.run("import", "readings", str(csv), *words)
    assert (again.answer["status"], again.answer["new"]) == ("no_change", 0)
    assert any("2 readings" in note for note in planned(url, tmp_path / "out").answer["notes"])


def test_what_a_plan_found_is_kept_for_the_next(
    postgis_cluster: postgis.Cluster, postgis_database: str, tmp_path: Path
) -> None:
    url, dem = postgis_cluster.url(postgis_database), commands.hills(tmp_path)
    assert imported(url, dem).code == 0
    finished = planned(url, tmp_path / "out", "--vehicle", "tractor", "--keep")
    assert finished.code == 0
    with open_store(url) as store:
        (route,) = store.routes("hills")
        assert route.summary["length_m"] == finished.answer["length_m"]
        layers = store.region("hills").layers
        assert {"rank of tractor", "nests of tractor"} <= layers.keys()
        ranks = store.read_window("hills", "rank of tractor", Window(0, 0, 80, 90))
    with rasterio.open(tmp_path / "out" / "rank.tif") as source:
        assert np.array_equal(source.read(1), ranks)
    listed = commands.run("regions", "--store", url, "--json")
    assert listed.code == 0
    assert "hills" in listed.out


def test_a_server_that_is_down_is_a_clear_end(tmp_path: Path) -> None:
    dem = commands.hills(tmp_path)
    url = f"postgresql://me@/region?host={tmp_path}"
    for finished in (imported(url, dem), planned(url, tmp_path / "out")):
        assert (finished.code, finished.answer["kind"]) == (4, "store_unavailable")
        assert "does not answer" in finished.answer["message"]
        assert finished.answer["remedy"]
        assert finished.err == ""
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("more", [(), ("--json",), ("--debug",), ("--json", "--debug")])
def test_a_password_in_the_address_is_refused_and_shown_nowhere(tmp_path: Path, more: tuple[str, ...]) -> None:
    dem = commands.hills(tmp_path)
    url = "postgresql://me:hush-hush@localhost:1/region"
    finished = commands.run("import", "dem", str(dem), "--store", url, "--region", "hills", *more)
    assert finished.code == 2
    assert "~/.pgpass" in finished.out + finished.err
    assert "hush-hush" not in finished.out + finished.err


@pytest.mark.parametrize("more", [(), ("--json",), ("--debug",)])
def test_a_password_of_the_environment_is_shown_nowhere(
    postgis_cluster: postgis.Cluster, postgis_database: str, tmp_path: Path, more: tuple[str, ...]
) -> None:
    with open_store(postgis_cluster.url(postgis_database), create=True) as store:
        rows, columns = 80, 90
        stored.put(store, "hills", "elevation", np.zeros((rows, columns), np.float32))
    with postgis_cluster.connect(postgis_database) as connection:
        connection.execute(f"GRANT USAGE ON SCHEMA swathe TO {postgis.GUARDED}")
        connection.execute(f"GRANT SELECT ON ALL TABLES IN SCHEMA swathe TO {postgis.GUARDED}")
    url = postgis_cluster.url(postgis_database, postgis.GUARDED)
    words = ("--points-crs", "native", "--start", commands.START, "--goal", commands.GOAL)
    out = tmp_path / "out"
    plan = ("plan", "--store", url, "--region", "hills", *words, "--out", str(out), *more)
    for password, code in ((postgis.PASSWORD, 0), ("wrong-but-secret", 4)):
        finished = commands.run(*plan, env={"PGPASSWORD": password})
        assert finished.code == code, finished.err
        assert password not in finished.out + finished.err
    files = [path for path in out.rglob("*") if path.is_file()]
    assert files
    for path in files:
        assert postgis.PASSWORD.encode() not in path.read_bytes(), path.name
    assert postgis.PASSWORD not in postgis_cluster.log


def test_gdal_reads_the_finished_elevation_of_a_region(
    postgis_cluster: postgis.Cluster, postgis_database: str, tmp_path: Path
) -> None:
    url, dem = postgis_cluster.url(postgis_database), commands.hills(tmp_path, 300, 290)
    assert imported(url, dem).code == 0
    with rasterio.open(dem) as source:
        heights, transform = source.read(1), source.transform
    for factor in (1, 2, 8):
        column = "rast" if factor == 1 else f"rast_{factor}"
        where = f"schema=swathe table=elevation column={column} where='region=$$hills$$' mode=2"
        with rasterio.open(postgis.read_with_gdal(postgis_cluster, postgis_database, where, tmp_path)) as seen:
            assert seen.crs.to_epsg() == 32616
            assert seen.transform.a == transform.a * factor
            assert (seen.transform.c, seen.transform.f) == (transform.c, transform.f)
            pixels = seen.read(1)
        if factor == 1:
            assert pixels.tobytes() == heights.astype("f4").tobytes(), "identical to the file"
        else:
            whole = Window(0, 0, 300 // factor * factor, 290 // factor * factor)
            with open_store(url) as store:
                ours = store.read_window("hills", "elevation", whole, overview=factor)
            assert np.array_equal(pixels[: ours.shape[0], : ours.shape[1]], ours)


def test_json_errors_are_one_object(postgis_cluster: postgis.Cluster, postgis_database: str, tmp_path: Path) -> None:
    with open_store(postgis_cluster.url(postgis_database), create=True) as store:
        store.create_region("hills", stored.frame(80, 90))
    finished = planned(postgis_cluster.url(postgis_database), tmp_path / "out")
    assert (finished.code, json.loads(finished.out)["kind"]) == (4, "missing_layer")
