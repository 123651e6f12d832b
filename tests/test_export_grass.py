"""Runs in real GRASS locations: maps that equal the run's files, and nothing of the user's lost."""

from __future__ import annotations

import json
import os
import shutil
import signal
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pyogrio.raw
import pytest
import rasterio
import shapely

import commands
import raster_files
from commands import way
from grass_location import Location, as_nobody
from swathe.config import TerrainRequest
from swathe.errors import GrassError, InvalidParameterError, MissingFileError, OutputError, UnreadableFileError
from swathe.export.grass import GrassTarget, export_grass
from swathe.io.elevation import open_elevation
from swathe.io.sources import single

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

MAPS = {
    "rank": "swathe_rank@swathe",
    "elevation": "swathe_elevation@swathe",
    "nests": "swathe_nests@swathe",
    "route": "swathe_route@swathe",
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an elevation and a run on it."""
    folder = tmp_path_factory.mktemp("files")
    heights = raster_files.hills(80, 90)
    heights[5:9, 70:80] = np.nan
    raster_files.write(folder / "hills.tif", heights, nodata=np.nan)
    finished = commands.run(
        *way(folder / "hills.tif", "--vehicle", "tractor", "--method", "exact", "--out", str(folder / "run"))
    )
    assert finished.code == 0, finished.err
    return folder


@pytest.fixture
def terrain(files: Path) -> TerrainRequest:
    return TerrainRequest(dem=(str(files / "hills.tif"),))


@pytest.fixture
def location(grass: Path, files: Path, tmp_path: Path) -> Location:
    """Somebody's location with a map in each of two mapsets."""
    made = Location(grass, tmp_path / "theirs", files / "hills.tif")
    made.new_mapset("work")
    for mapset in ("PERMANENT", "work"):
        made.run(["r.in.gdal", f"input={files / 'hills.tif'}", "output=dem"], mapset=mapset)
    return made


def features(path: Path) -> list[dict[str, Any]]:
    listed: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))["features"]
    return listed


def band(path: Path | str) -> NDArray[np.float64]:
    source = single(str(path))
    with rasterio.open(source.path) as dataset:
        return np.asarray(dataset.read(1, masked=True).astype(float).filled(np.nan))


def in_location(grass: Path, folder: Path) -> Location:
    """A location that is there already."""
    found = object.__new__(Location)
    found._program, found.folder = grass, folder
    return found


def check_maps(made: Location, files: Path, mapset: str = "swathe") -> None:
    """Compare everything in a mapset with the run's files."""
    run = files / "run"
    np.testing.assert_array_equal(band(made.address("swathe_elevation", mapset)), band(files / "hills.tif"))
    np.testing.assert_array_equal(band(made.address("swathe_rank", mapset)), band(run / "rank.tif"))
    nests = single(made.address("swathe_nests", mapset))
    meta, _, shapes, columns = pyogrio.raw.read(nests.path)
    table = dict(zip(meta["fields"], columns, strict=True))
    expected = {feature["properties"]["nest"]: feature["properties"] for feature in features(run / "nests.geojson")}
    areas: dict[int, float] = {}
    for number, area in zip(table["nest"].tolist(), shapely.area(shapely.from_wkb(shapes)).tolist(), strict=True):
        areas[number] = areas.get(number, 0.0) + area
    assert areas == pytest.approx({number: facts["area_m2"] for number, facts in expected.items()}, rel=1e-12)
    assert dict(zip(table["nest"].tolist(), table["cells"].tolist(), strict=False)) == {
        number: facts["cells"] for number, facts in expected.items()
    }


def test_a_run_comes_back_from_a_new_location_as_it_was(
    grass: Path, files: Path, terrain: TerrainRequest, tmp_path: Path
) -> None:
    target = GrassTarget(tmp_path / "made")
    assert export_grass(files / "run", target, terrain=terrain) == MAPS
    assert {path.name for path in tmp_path.iterdir()} == {"made"}
    made = in_location(grass, tmp_path / "made")
    assert {path.name for path in made.folder.iterdir()} == {"PERMANENT", "swathe"}
    check_maps(made, files)
    assert "EPSG:32616" in made.run("g.proj -g")
    with open_elevation([made.address("swathe_elevation", "swathe")]) as kept, open_elevation(terrain.dem) as given:
        assert kept.frame == given.frame


def test_ranks_have_colours_and_categories(grass: Path, files: Path, tmp_path: Path) -> None:
    export_grass(files / "run", GrassTarget(tmp_path / "made"))
    made = in_location(grass, tmp_path / "made")
    lines = made.run("r.category map=swathe_rank separator=pipe", mapset="swathe").splitlines()
    ranks = {int(value) for value in np.unique(band(files / "run" / "rank.tif")) if np.isfinite(value)}
    labels = dict(line.split("|") for line in lines)
    names = {1: "no-go", **{rank: f"rank {rank}" for rank in range(3, 10)}, 2: "rank 2, worst", 10: "rank 10, best"}
    assert labels == {str(rank): names[rank] for rank in ranks}
    assert len(ranks) > 2
    with rasterio.open(files / "run" / "rank.tif") as dataset:
        colours = dataset.colormap(1)
    kept = dict(
        line.split()
        for line in made.run("r.colors.out map=swathe_rank", mapset="swathe").splitlines()
        if line[0].isdigit()
    )
    for rank in ranks:
        assert kept[str(rank)] == ":".join(map(str, colours[rank][:3]))
    assert "seed 0, vehicle tractor" in made.run("r.info -e map=swathe_rank", mapset="swathe")


def test_every_leg_is_a_line_with_its_facts(grass: Path, files: Path, tmp_path: Path) -> None:
    export_grass(files / "run", GrassTarget(tmp_path / "made"))
    made = in_location(grass, tmp_path / "made")
    legs = features(files / "run" / "route.geojson")
    assert f"lines={len(legs)}" in made.run("v.info -t swathe_route", mapset="swathe").split()
    report = made.run("v.to.db -p map=swathe_route option=length units=meters separator=comma", mapset="swathe")
    lengths = {int(line.split(",")[0]): float(line.split(",")[1]) for line in report.splitlines() if line[0].isdigit()}
    table = made.run("v.db.select -c map=swathe_route columns=leg,soil,time_s separator=comma", mapset="swathe")
    facts = {int(line.split(",")[0]): line.split(",")[1:] for line in table.splitlines()}
    for leg in legs:
        own = leg["properties"]
        number = own["leg"]
        assert facts[number][0] == own["soil"]
        assert float(facts[number][1]) == own["time_s"]
        # The length of a leg follows the ground, its line lies flat; the location's system has a scale of its own.
        assert lengths[number] == pytest.approx(own["length_m"], rel=0.02)


def test_a_new_mapset_joins_a_location_and_changes_nothing_else(
    location: Location, files: Path, terrain: TerrainRequest
) -> None:
    before = location.contents()
    export_grass(files / "run", GrassTarget(location.folder, "routes"), terrain=terrain)
    after = location.contents()
    assert {name: facts for name, facts in after.items() if name.partition("/")[0] != "routes"} == before
    check_maps(location, files, "routes")


def test_names_that_are_taken_are_refused_until_overwriting_is_asked_for(
    location: Location, files: Path, terrain: TerrainRequest
) -> None:
    location.run("g.copy raster=dem,swathe_rank", mapset="work")
    before = location.contents()
    target = GrassTarget(location.folder, "work")
    with pytest.raises(GrassError, match="The mapset work of theirs has swathe_rank already"):
        export_grass(files / "run", target, terrain=terrain)
    assert location.contents() == before
    export_grass(files / "run", GrassTarget(location.folder, "work", prefix="other"), terrain=terrain)
    np.testing.assert_array_equal(band(location.address("swathe_rank", "work")), band(files / "hills.tif"))
    for _ in range(2):
        export_grass(files / "run", GrassTarget(location.folder, "work", overwrite=True), terrain=terrain)
        check_maps(location, files, "work")
    names = location.run("g.list type=raster,vector mapset=work").split()
    kinds = ("elevation", "nests", "rank", "route")
    assert sorted(names) == sorted(["dem", *(f"{prefix}_{kind}" for prefix in ("other", "swathe") for kind in kinds)])


def test_a_location_of_another_system_is_refused_and_stays_as_it_is(grass: Path, files: Path, tmp_path: Path) -> None:
    other = Location(grass, tmp_path / "other", "EPSG:31467")
    for mapset in ("swathe", "PERMANENT"):
        before = {name for name in other.contents() if "/.tmp" not in name}
        with pytest.raises(GrassError, match="lies in another coordinate reference system than the location"):
            export_grass(files / "run", GrassTarget(other.folder, mapset))
        assert {name for name in other.contents() if "/.tmp" not in name} == before


def test_a_locked_mapset_is_refused(location: Location, files: Path) -> None:
    lock = location.folder / "work" / ".gislock"
    lock.write_bytes(os.getpid().to_bytes(4, "little"))
    before = location.contents()
    with pytest.raises(GrassError, match=r"The mapset work is locked: somebody works in it\."):
        export_grass(files / "run", GrassTarget(location.folder, "work"))
    assert location.contents() == before


@pytest.mark.parametrize("mapset", ["work", "new"])
def test_a_location_that_may_not_be_written_is_refused(location: Location, files: Path, mapset: str) -> None:
    run = shutil.copytree(files / "run", location.folder.parent / "run")
    folder = location.folder / "work" if mapset == "work" else location.folder
    folder.chmod(0o555)
    try:
        with as_nobody(folder), pytest.raises((OutputError, GrassError), match=r"cannot be written|no permission"):
            export_grass(run, GrassTarget(location.folder, mapset))
    finally:
        folder.chmod(0o755)
    assert not (location.folder / "new").exists()


def test_what_is_no_run_or_no_name_is_refused(files: Path, terrain: TerrainRequest, tmp_path: Path) -> None:
    target = GrassTarget(tmp_path / "made")
    with pytest.raises(MissingFileError, match="is not the folder of a finished run"):
        export_grass(tmp_path, target)
    with pytest.raises(InvalidParameterError, match="no name of a mapset"):
        export_grass(files / "run", GrassTarget(tmp_path / "made", "../escape"))
    with pytest.raises(InvalidParameterError, match="'my hills' is no name that GRASS allows for a location"):
        export_grass(files / "run", GrassTarget(tmp_path / "my hills"))
    with pytest.raises(InvalidParameterError, match="cannot begin the names of maps"):
        export_grass(files / "run", GrassTarget(tmp_path / "made", prefix="a,b"))
    with pytest.raises(OutputError, match="does not exist"):
        export_grass(files / "run", GrassTarget(tmp_path / "no" / "such" / "place"))
    elsewhere = raster_files.write(
        tmp_path / "far.tif",
        raster_files.hills(20, 20),
        transform=raster_files.PLACE @ raster_files.PLACE.translation(900, 0),
    )
    with pytest.raises(InvalidParameterError, match="lies outside the run's map"):
        export_grass(files / "run", target, terrain=TerrainRequest(dem=(str(elsewhere),)))
    with pytest.raises(InvalidParameterError, match=r"The elevation lies in .*, the run in"):
        export_grass(files / "run", target, terrain=TerrainRequest(dem=terrain.dem, crs="EPSG:32617"))
    broken = shutil.copytree(files / "run", tmp_path / "broken")
    (broken / "nests.geojson").write_text('{"features": 3}', encoding="ascii")
    with pytest.raises(UnreadableFileError, match=r"nests\.geojson is not one of a run's files"):
        export_grass(broken, target)
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("delay_s", [0.3, 0.8, 1.1])
def test_a_killed_export_leaves_no_half_location(files: Path, tmp_path: Path, delay_s: float) -> None:
    words = ("export", str(files / "run"), "--format", "grass", "--location", str(tmp_path / "made"))
    running = commands.start(*words)
    time.sleep(delay_s)
    running.send_signal(signal.SIGKILL)
    running.communicate()
    made = tmp_path / "made"
    if made.exists():  # it was quicker
        assert len(list((made / "swathe" / "vector").iterdir())) == 2
    export_grass(files / "run", GrassTarget(tmp_path / "again"))


def test_the_command_says_what_it_made(files: Path, tmp_path: Path) -> None:
    words = (
        "export", str(files / "run"), "--format", "grass", "--location", str(tmp_path / "made"),
        "--dem", str(files / "hills.tif"),
    )  # fmt: skip
    finished = commands.run(*words, "--json")
    assert (finished.code, finished.err) == (0, "")
    assert finished.answer == {"status": "done", "location": str(tmp_path / "made"), "outputs": MAPS}
    again = commands.run(*words)
    assert again.code == 4
    assert "--overwrite" in again.err
    replaced = commands.run(*words, "--overwrite")
    assert (replaced.code, replaced.err) == (0, "")
    assert "swathe_nests@swathe" in replaced.out


def test_a_local_map_goes_into_a_location_without_a_system(grass: Path, tmp_path: Path) -> None:
    heights = raster_files.write(tmp_path / "plain.tif", raster_files.hills(60, 60), crs=None, transform=None)
    run = tmp_path / "run"
    finished = commands.run(
        *way(heights, "--cell-size", "30", "--out", str(run), "--vehicle", "tractor", from_to=("100,100", "1500,1600"))
    )
    assert finished.code == 0, finished.err
    terrain = TerrainRequest(dem=(str(heights),), cell_size_m=30.0)
    maps = export_grass(run, GrassTarget(tmp_path / "made"), terrain=terrain)
    made = in_location(grass, tmp_path / "made")
    np.testing.assert_array_equal(band(made.address("swathe_elevation", "swathe")), raster_files.hills(60, 60))
    assert set(maps) == {"rank", "elevation", "nests", "route"}
