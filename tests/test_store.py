"""Laws that hold for every terrain store, whatever keeps it.

Why this file is long: the laws of one interface stand together, so that a new store can be held against all of them.
"""

from __future__ import annotations

import random
import threading
from typing import TYPE_CHECKING

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import stored
from swathe.errors import (
    InvalidParameterError,
    MissingLayerError,
    MissingRegionError,
    OutsideGridError,
    RegionConflictError,
    StoreBusyError,
    StoreError,
    UsageError,
)
from swathe.grid import Window
from swathe.soil import SoilClass
from swathe.store import StoredRoute, StoredRun, TerrainStore, Zone, open_store

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    import postgis

HOSTILE = [
    "it's",
    'a "quoted" one',
    "x'); DROP TABLE regions; --",
    "../../etc/passwd",
    "täler & höhen 山 🚜",
    "a" * 200,
    "CON",
    "100%_[a-z]*?",
    "{braces} $1 :name",
]


@pytest.fixture(params=["files", pytest.param("postgis", marks=pytest.mark.postgis)])
def store_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An address where a store can be made, for each kind of store."""
    if request.param == "files":
        return str(tmp_path / "project")
    cluster: postgis.Cluster = request.getfixturevalue("postgis_cluster")
    return cluster.url(request.getfixturevalue("postgis_database"))


@pytest.fixture
def store(store_url: str) -> Iterator[TerrainStore]:
    with open_store(store_url, create=True) as opened:
        yield opened


def waves(rows: int, columns: int) -> NDArray[np.float32]:
    row, column = np.mgrid[0:rows, 0:columns]
    heights: NDArray[np.float32] = (500 + 99 * np.sin(row / 7) * np.cos(column / 11)).astype(np.float32)
    heights[row * 31 + column * 17 % 97 == 5] = np.nan
    return heights


def test_a_store_that_was_made_is_there_for_the_next(store_url: str) -> None:
    with pytest.raises(StoreError):
        open_store(store_url)
    with open_store(store_url, create=True) as store:
        stored.put(store, "valley", "elevation", waves(70, 90))
    with open_store(store_url) as again, open_store(store_url, create=True) as third:
        assert [region.name for region in again.regions()] == ["valley"]
        assert third.region("valley") == again.region("valley")
        assert again.region("valley").frame == stored.frame(70, 90)


def test_every_window_is_bit_equal_to_what_was_written(store: TerrainStore) -> None:
    heights = waves(530, 777)
    stored.put(store, "valley", "elevation", heights)

    @settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(st.integers(0, 529), st.integers(0, 776), st.data())
    def law(row: int, column: int, data: st.DataObject) -> None:
        rows = data.draw(st.integers(1, 530 - row))
        columns = data.draw(st.integers(1, 777 - column))
        read = store.read_window("valley", "elevation", Window(row, column, rows, columns))
        assert read.dtype == np.float32
        np.testing.assert_array_equal(read, heights[row : row + rows, column : column + columns])

    law()


@pytest.mark.parametrize(("dtype", "top"), [("uint8", 255), ("uint16", 65535), ("int32", 2**31 - 1), ("float32", 1e30)])
def test_all_kinds_of_numbers_come_back(store: TerrainStore, dtype: str, top: float) -> None:
    numbers = np.zeros((300, 270), dtype=dtype)
    numbers[5, 5], numbers[299, 269], numbers[100:140, 250:262] = top, 1, 7
    stored.put(store, "valley", "rank of the tractor", numbers, details={"vehicle": "tractor"})
    np.testing.assert_array_equal(store.read_window("valley", "rank of the tractor", Window(0, 0, 300, 270)), numbers)
    assert store.region("valley").layers["rank of the tractor"].dtype == dtype
    assert store.region("valley").layers["rank of the tractor"].details == {"vehicle": "tractor"}


@pytest.mark.parametrize("shape", [(512, 768), (300, 310), (40, 30)])
@pytest.mark.parametrize("overview", [2, 8, 64])
def test_overviews_hold_the_mean_of_known_heights(store: TerrainStore, shape: tuple[int, int], overview: int) -> None:
    rows, columns = shape
    row, column = np.mgrid[0:rows, 0:columns]
    heights = (100 + 0.5 * row + 0.25 * column).astype(np.float32)
    stored.put(store, "valley", "elevation", heights)
    read = store.read_window("valley", "elevation", Window(0, 0, rows, columns), overview=overview)
    assert read.shape == (-(-rows // overview), -(-columns // overview))
    whole = (rows // overview * overview, columns // overview * overview)
    blocks = heights[: whole[0], : whole[1]].reshape(whole[0] // overview, overview, whole[1] // overview, overview)
    np.testing.assert_allclose(
        read[: blocks.shape[0], : blocks.shape[2]], blocks.mean(axis=(1, 3)), rtol=1e-5, atol=0.02
    )
    codes = (1 + (row // 16 + column // 16) % 5).astype(np.uint8)
    stored.put(store, "valley", "rank", codes)
    few = store.read_window("valley", "rank", Window(0, 0, rows, columns), overview=overview)
    assert set(np.unique(few)) <= set(np.unique(codes)) | {0}
    if overview <= 8:
        inside = few[: blocks.shape[0], : blocks.shape[2]]
        np.testing.assert_array_equal(inside, codes[: whole[0] : overview, : whole[1] : overview])


def test_windows_that_cannot_be_read_are_refused(store: TerrainStore) -> None:
    stored.put(store, "valley", "elevation", waves(40, 50))
    for window in (Window(0, 0, 41, 50), Window(-1, 0, 2, 2), Window(0, 50, 1, 1), Window(3, 3, 0, 4)):
        with pytest.raises(OutsideGridError):
            store.read_window("valley", "elevation", window)
    for window, overview in ((Window(0, 0, 4, 4), 3), (Window(1, 0, 4, 4), 2), (Window(0, 0, 4, 4), 128)):
        with pytest.raises(InvalidParameterError):
            store.read_window("valley", "elevation", window, overview=overview)
    with pytest.raises(MissingLayerError):
        store.read_window("valley", "soil", Window(0, 0, 1, 1))
    with pytest.raises(MissingRegionError, match="vallye"):
        store.read_window("vallye", "elevation", Window(0, 0, 1, 1))


def test_readers_see_the_old_until_the_new_is_whole(store: TerrainStore, store_url: str) -> None:
    old, new = waves(300, 300), np.full((300, 300), 7, dtype=np.float32)
    stored.put(store, "valley", "elevation", old, "a")
    whole = Window(0, 0, 300, 300)
    with open_store(store_url) as reader:
        with store.begin_import("valley", "elevation", stored.provenance("b"), details=stored.DETAILS) as session:
            assert not session.is_current
            for (row, column), tile in stored.tiles(new).items():
                session.write_tile(row, column, tile)
                np.testing.assert_array_equal(reader.read_window("valley", "elevation", whole), old)
            session.commit()
            np.testing.assert_array_equal(reader.read_window("valley", "elevation", whole), new)
        with store.begin_import("valley", "elevation", stored.provenance("a"), details=stored.DETAILS) as session:
            session.write_tile(0, 0, old[:256, :256])
            session.abort()
        np.testing.assert_array_equal(reader.read_window("valley", "elevation", whole), new)
    assert store.region("valley").layers["elevation"].provenance.inputs == (("b.tif", "b" * 64),)


def test_tiles_that_were_not_written_are_unknown(store: TerrainStore) -> None:
    store.create_region("valley", stored.frame(300, 600))
    with store.begin_import("valley", "elevation", stored.provenance("a"), details=stored.DETAILS) as session:
        session.write_tile(1, 2, np.full((44, 88), 3, dtype=np.float32))
        session.commit()
    read = store.read_window("valley", "elevation", Window(0, 0, 300, 600))
    assert np.isnan(read[:256]).all()
    assert np.isnan(read[:, :512]).all()
    assert (read[256:, 512:] == 3).all()


def test_whole_tiles_may_stick_out_over_the_edge(store: TerrainStore) -> None:
    store.create_region("valley", stored.frame(300, 310))
    with store.begin_import("valley", "rank", stored.provenance("a"), dtype="uint8") as session:
        for row in range(2):
            for column in range(2):
                session.write_tile(row, column, np.full((256, 256), 1 + row + 2 * column, dtype=np.uint8))
        session.commit()
    read = store.read_window("valley", "rank", Window(0, 0, 300, 310))
    assert (read[256:, 256:] == 4).all()
    assert (read[:256, :256] == 1).all()


def test_an_import_goes_on_where_it_stopped(store: TerrainStore, store_url: str) -> None:
    heights = waves(600, 600)
    store.create_region("valley", stored.frame(600, 600))
    parts = stored.tiles(heights)
    with store.begin_import("valley", "elevation", stored.provenance("a"), details=stored.DETAILS) as session:
        for row, column in [(0, 0), (2, 1), (1, 1)]:
            session.write_tile(row, column, parts[row, column])
    with open_store(store_url) as other:
        with other.begin_import("valley", "elevation", stored.provenance("a"), details=stored.DETAILS) as session:
            assert session.have() == {(0, 0), (2, 1), (1, 1)}
            for row, column in parts.keys() - session.have():
                session.write_tile(row, column, parts[row, column])
            session.commit()
        with other.begin_import("valley", "elevation", stored.provenance("a"), details=stored.DETAILS) as session:
            assert session.is_current
    np.testing.assert_array_equal(store.read_window("valley", "elevation", Window(0, 0, 600, 600)), heights)


def test_what_was_begun_of_another_source_does_not_count(store: TerrainStore) -> None:
    store.create_region("valley", stored.frame(300, 300))
    for other in (stored.provenance("b"), stored.provenance("a", cell_size="5.0")):
        with store.begin_import("valley", "elevation", stored.provenance("a"), details=stored.DETAILS) as session:
            session.write_tile(0, 0, np.ones((256, 256), dtype=np.float32))
        with store.begin_import("valley", "elevation", other, details=stored.DETAILS) as session:
            assert session.have() == frozenset()


def test_two_imports_of_one_layer_exclude_each_other(store: TerrainStore, store_url: str) -> None:
    stored.put(store, "valley", "elevation", waves(40, 40))
    with (
        open_store(store_url) as other,
        store.begin_import("valley", "elevation", stored.provenance("b"), details=stored.DETAILS),
    ):
        with pytest.raises(StoreBusyError):
            other.begin_import("valley", "elevation", stored.provenance("c"), details=stored.DETAILS)
        # Another layer is another matter.
        stored.put(other, "valley", "rank", np.ones((40, 40), dtype=np.uint8))
    with open_store(store_url) as other:
        other.begin_import("valley", "elevation", stored.provenance("c"), details=stored.DETAILS).close()


def test_a_tile_that_does_not_fit_is_refused(store: TerrainStore) -> None:
    store.create_region("valley", stored.frame(300, 300))
    with store.begin_import("valley", "elevation", stored.provenance("a"), details=stored.DETAILS) as session:
        for row, column, shape in ((2, 0, (256, 256)), (0, 0, (255, 256)), (1, 1, (45, 44)), (-1, 0, (256, 256))):
            with pytest.raises(UsageError):
                session.write_tile(row, column, np.zeros(shape, dtype=np.float32))
    with pytest.raises(InvalidParameterError):
        store.begin_import("valley", "elevation", stored.provenance("a"), dtype="complex64")


@pytest.mark.parametrize("name", HOSTILE)
def test_any_name_is_only_a_name(store: TerrainStore, name: str) -> None:
    heights = waves(30, 40)
    stored.put(store, "other", "elevation", heights + 1)
    stored.put(store, name, "elevation", heights)
    stored.put(store, name, name, np.ones((30, 40), dtype=np.uint8))
    shape = stored.box(0, 0, 30, 40)
    piece = stored.polygon(shape, SoilClass.SAND, name)
    details = {"source": name, "field": name, "legend": [[name, name, "sand", True]]}
    store.write_soil_polygons(name, [[piece]], stored.provenance(name), details=details)
    store.write_zones(name, [[Zone(shapely.to_wkb(shape), name, {name: name})]], stored.provenance(name))
    store.add_readings(name, [stored.push(name, 3, 3, author=name, instrument=name)])
    store.add_route(name, StoredRoute(name, shapely.to_wkb(shapely.LineString([(0, 0), (1, 1)])), name, {name: name}))
    store.add_run(name, StoredRun(name, name, {name: name}, name))
    assert {region.name for region in store.regions()} == {"other", name}
    np.testing.assert_array_equal(store.read_window(name, "elevation", Window(0, 0, 30, 40)), heights)
    np.testing.assert_array_equal(store.read_window("other", "elevation", Window(0, 0, 30, 40)), heights + 1)
    assert [soil.value for soil in store.soil_polygons(name)] == [name]
    assert [zone.attributes for zone in store.zones(name)] == [{name: name}]
    assert [(one.id, one.author) for one in store.readings(name)] == [(name, name)]
    assert store.routes(name)[0].summary == store.runs(name)[0].summary == {name: name}
    assert store.withdraw(name, name, instrument=name) == 1
    assert store.readings(name, withdrawn=True)[0].reason == name
    store.drop_region(name)
    assert [region.name for region in store.regions()] == ["other"]
    with pytest.raises(MissingRegionError):
        store.region(name)


@pytest.mark.parametrize("name", ["", "  ", "a" * 201, "line\nbreak", "nul\0", "half \ud800"])
def test_names_that_cannot_be_shown_are_refused(store: TerrainStore, name: str) -> None:
    with pytest.raises(InvalidParameterError):
        store.create_region(name, stored.frame(3, 3))


def test_names_that_look_alike_in_files_stay_apart(store: TerrainStore) -> None:
    names = ["Valley", "valley", "VALLEY", "va/lley", "va:lley", "va_lley"]
    for number, name in enumerate(names):
        stored.put(store, name, "elevation", np.full((10, 10), number, dtype=np.float32))
    for number, name in enumerate(names):
        assert (store.read_window(name, "elevation", Window(0, 0, 10, 10)) == number).all()


def test_a_region_never_changes_its_cells(store: TerrainStore) -> None:
    made = store.create_region("valley", stored.frame(30, 40))
    assert store.create_region("valley", stored.frame(30, 40)) == made
    for other in (stored.frame(31, 40), stored.frame(30, 40, 29.0)):
        with pytest.raises(RegionConflictError, match="valley"):
            store.create_region("valley", other)


def test_a_region_that_was_dropped_can_be_made_anew(store: TerrainStore) -> None:
    stored.two_soils(store)
    store.add_readings("valley", [stored.push("a", 3, 3)])
    store.drop_region("valley")
    stored.put(store, "valley", "elevation", waves(50, 20))
    assert set(store.region("valley").layers) == {"elevation"}
    assert store.readings("valley") == []
    assert [change.kind for change in store.changes("valley")] == ["region", "layer"]


def test_an_import_into_a_region_that_is_dropped_meanwhile_comes_to_nothing(
    store: TerrainStore, store_url: str
) -> None:
    stored.put(store, "valley", "elevation", waves(50, 20))
    with open_store(store_url) as other, pytest.raises(StoreError):  # noqa: PT012 - what is refused, and when, may differ
        with other.begin_import("valley", "elevation", stored.provenance("b"), details=stored.DETAILS) as session:
            session.write_tile(0, 0, np.ones((50, 20), dtype=np.float32))
            store.drop_region("valley")
            store.create_region("valley", stored.frame(60, 30))
            session.commit()
        raise AssertionError("it was taken")
    assert dict(store.region("valley").layers) == {}


def test_soil_polygons_come_back_in_their_order_with_everything(store: TerrainStore) -> None:
    stored.put(store, "valley", "elevation", waves(100, 100))
    pieces = [
        stored.polygon(stored.box(n % 90, n * 7 % 90, 5, 5), SoilClass(1 + n % 6), f"unit {n}", n if n % 2 else None)
        for n in range(500)
    ]
    assert store.write_soil_polygons(
        "valley", (pieces[n : n + 70] for n in range(0, 500, 70)), stored.provenance("s"), details=stored.legend()
    )
    assert list(store.soil_polygons("valley")) == pieces
    assert not store.write_soil_polygons("valley", [], stored.provenance("s"), details=stored.legend())

    @settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(st.integers(0, 95), st.integers(0, 95), st.integers(1, 60), st.integers(1, 60))
    def law(row: int, column: int, rows: int, columns: int) -> None:
        window = shapely.buffer(stored.box(row, column, rows, columns), -1, join_style="mitre")
        near = [piece for piece in pieces if shapely.intersects(shapely.from_wkb(piece.wkb), window)]
        assert list(store.soil_polygons("valley", tuple(shapely.bounds(window)))) == near

    law()


def test_readers_of_soil_see_the_old_map_until_the_new_is_whole(store: TerrainStore) -> None:
    stored.two_soils(store)
    before = store.soil_window("valley", Window(0, 0, 40, 60))
    seen = []

    def batches() -> Iterator[list[object]]:
        yield [stored.polygon(stored.box(0, 0, 40, 60), SoilClass.ROCK)]
        seen.append(store.soil_window("valley", Window(0, 0, 40, 60)))
        raise OSError("the source went away")

    with pytest.raises(Exception, match="went away"):
        store.write_soil_polygons(
            "valley",
            batches(),  # type: ignore[arg-type]
            stored.provenance("t"),
            details=stored.legend(SoilClass.ROCK),
        )
    np.testing.assert_array_equal(seen[0], before)
    np.testing.assert_array_equal(store.soil_window("valley", Window(0, 0, 40, 60)), before)
    rock = [[stored.polygon(stored.box(0, 0, 40, 60), SoilClass.ROCK)]]
    assert store.write_soil_polygons("valley", rock, stored.provenance("t"), details=stored.legend(SoilClass.ROCK))
    assert (store.soil_window("valley", Window(0, 0, 40, 60)) == SoilClass.ROCK).all()


def test_where_soils_overlap_the_worse_counts_whatever_their_order(store: TerrainStore) -> None:
    stored.put(store, "valley", "elevation", waves(20, 20))
    sand = stored.polygon(stored.box(0, 0, 20, 12), SoilClass.SAND)
    water = stored.polygon(stored.box(5, 5, 10, 15), SoilClass.NONE)
    found = []
    for of, pieces in (("s", [sand, water]), ("t", [water, sand])):
        details = stored.legend(SoilClass.SAND, SoilClass.NONE)
        store.write_soil_polygons("valley", [pieces], stored.provenance(of), details=details)
        layer = store.soil_layer("valley", Window(0, 0, 20, 20))
        assert layer is not None
        assert layer.report.disputed_cells == 10 * 7
        found.append(layer.codes)
    np.testing.assert_array_equal(found[0], found[1])
    assert (found[0][5:15, 5:] == SoilClass.NONE).all()
    assert (found[0][:5, :12] == SoilClass.SAND).all()
    assert (found[0][:5, 12:] == SoilClass.UNKNOWN).all()


def test_soil_is_joined_by_the_centre_or_by_the_greatest_area(store: TerrainStore) -> None:
    stored.put(store, "valley", "elevation", waves(3, 4))
    west, north, cell = stored.WEST, stored.NORTH, stored.CELL
    # A stripe of clay over the middle of column 1, narrower than half of it, and a corner of gravel.
    stripe = shapely.box(west + 1.4 * cell, north - 3 * cell, west + 1.6 * cell, north)
    rest = shapely.difference(stored.box(0, 0, 3, 4), stripe)
    corner = shapely.box(west + 3.3 * cell, north - 0.9 * cell, west + 4 * cell, north)
    pieces = [
        stored.polygon(stripe, SoilClass.CLAY),
        stored.polygon(shapely.difference(rest, corner), SoilClass.SAND),
        stored.polygon(corner, SoilClass.GRAVEL),
    ]
    details = stored.legend(SoilClass.CLAY, SoilClass.SAND, SoilClass.GRAVEL)
    store.write_soil_polygons("valley", [pieces], stored.provenance("s"), details=details)
    centre = store.soil_window("valley", Window(0, 0, 3, 4))
    area = store.soil_window("valley", Window(0, 0, 3, 4), join="area")
    sand, clay, gravel = SoilClass.SAND, SoilClass.CLAY, SoilClass.GRAVEL
    assert centre.tolist() == [[sand, clay, sand, gravel], [sand, clay, sand, sand], [sand, clay, sand, sand]]
    assert area.tolist() == [[sand, sand, sand, gravel], [sand, sand, sand, sand], [sand, sand, sand, sand]]
    with pytest.raises(InvalidParameterError):
        store.soil_window("valley", Window(0, 0, 1, 1), join="middle")  # type: ignore[arg-type]


def test_the_area_join_agrees_with_counting_a_thousand_points(store: TerrainStore) -> None:
    stored.put(store, "valley", "elevation", waves(6, 6))
    draw = random.Random(3)
    pieces = []
    for n in range(7):
        middle = shapely.Point(stored.WEST + draw.uniform(0, 180), stored.NORTH - draw.uniform(0, 180))
        pieces.append(stored.polygon(middle.buffer(draw.uniform(25, 60)), SoilClass(1 + n % 5)))
    covered = shapely.from_wkb(pieces[0].wkb)
    apart = [pieces[0]]
    for piece in pieces[1:]:  # cut so that they do not overlap
        shape = shapely.difference(shapely.from_wkb(piece.wkb), covered)
        covered = shapely.union(covered, shape)
        apart.append(stored.polygon(shape, piece.soil_class))
    details = stored.legend(*(SoilClass(n) for n in range(1, 6)))
    store.write_soil_polygons("valley", [apart], stored.provenance("s"), details=details)
    area = store.soil_window("valley", Window(0, 0, 6, 6), join="area")
    steps = (np.arange(32) + 0.5) / 32 * stored.CELL
    compared = 0
    for row in range(6):
        for column in range(6):
            x, y = np.meshgrid(stored.WEST + column * stored.CELL + steps, stored.NORTH - row * stored.CELL - steps)
            counts = {
                int(soil): sum(
                    int(shapely.contains_xy(shapely.from_wkb(piece.wkb), x, y).sum())
                    for piece in apart
                    if piece.soil_class == soil
                )
                for soil in SoilClass
            }
            counts[0] = x.size - sum(counts.values())
            first, second = sorted(counts.values())[-1:-3:-1]
            if first - second > 20:  # a clear case
                assert area[row, column] == max(counts, key=lambda soil: counts[soil]), (row, column, counts)
                compared += 1
    assert compared > 25


def test_readings_are_facts(store: TerrainStore, store_url: str) -> None:
    stored.two_soils(store)
    first = [stored.push("a", 3, 3), stored.word("b", 4, 40, SoilClass.ROCK, error=None)]
    assert store.add_readings("valley", first) == 2
    assert store.add_readings("valley", [stored.push("a", 9, 9, 9000.0), stored.push("c", 5, 5)]) == 1
    assert store.add_readings("valley", first) == 0
    with open_store(store_url) as other:
        found = other.readings("valley")
    assert [one.id for one in found] == ["a", "b", "c"]
    assert found[0].reading == first[0].reading
    assert found[1].reading == first[1].reading
    assert (found[0].author, found[0].time, found[0].instrument, found[0].error) == (
        "rover 1", "2026-05-01T12:00:00Z", "CP-17", 0.3,
    )  # fmt: skip
    assert found[1].error is None
    assert [one.id for one in store.readings("valley", since=found[0].revision)] == ["c"]
    assert found[0].revision == found[1].revision < found[2].revision


def test_readings_that_cannot_be_are_refused_whole(store: TerrainStore) -> None:
    stored.two_soils(store)
    for wrong in (
        stored.push("x", 41, 3),
        stored.push("x", 3, -1),
        stored.push("x", float("nan"), 3),
        stored.push("x", 3, 3, -5.0),
        stored.push("x", 3, 3, error=-1.0),
        stored.push("", 3, 3),
    ):
        with pytest.raises(UsageError):
            store.add_readings("valley", [stored.push("good", 3, 3), wrong])
    assert store.readings("valley") == []


def test_a_wrong_instrument_is_withdrawn_and_the_past_can_still_be_seen(store: TerrainStore) -> None:
    stored.two_soils(store)
    store.add_readings("valley", [stored.push("a", 3, 3, instrument="good"), stored.push("b", 4, 4, instrument="bad")])
    store.add_readings("valley", [stored.push("c", 5, 5, instrument="bad", author="rover 2")])
    then = store.changes("valley")[-1].revision
    assert store.withdraw("valley", "spring broken", instrument="bad") == 2
    assert store.withdraw("valley", "again", instrument="bad") == 0
    assert [one.id for one in store.readings("valley")] == ["a"]
    assert [one.id for one in store.readings("valley", until=then)] == ["a", "b", "c"]
    gone = [one for one in store.readings("valley", withdrawn=True) if one.withdrawn_at is not None]
    assert [(one.id, one.reason, one.withdrawn_at) for one in gone] == [
        ("b", "spring broken", then + 1), ("c", "spring broken", then + 1),
    ]  # fmt: skip
    assert store.changes("valley")[-1].detail == {"ids": ["b", "c"], "reason": "spring broken"}
    assert store.withdraw("valley", "left the club", author="rover 2") == 0
    assert store.withdraw("valley", "typo", ids=["a", "nobody"]) == 1
    assert store.readings("valley") == []
    for wrong in ({}, {"instrument": "a", "author": "b"}):
        with pytest.raises(InvalidParameterError):
            store.withdraw("valley", "why", **wrong)


def test_belief_does_not_depend_on_the_order_of_filing(store: TerrainStore) -> None:
    pushes = [stored.push(f"p{n}", 3 + n * 2 % 30, 5 + n * 7 % 50, 150.0 + 170 * (n % 5)) for n in range(12)]
    pushes.append(stored.word("w", 20, 20, SoilClass.CLAY))
    beliefs = []
    for number in range(3):
        region = f"valley {number}"
        stored.two_soils(store, region)
        shuffled = random.Random(number).sample(pushes, len(pushes))
        for first in range(0, len(shuffled), 1 + 3 * number):
            store.add_readings(region, shuffled[first : first + 1 + 3 * number])
        belief = store.belief(region, "tractor", moisture_percent=35)
        beliefs.append([belief.soil(), belief.class_probabilities((10, 10)), belief.class_probabilities((20, 20))])
    for other in beliefs[1:]:
        np.testing.assert_array_equal(other[0], beliefs[0][0])
        assert other[1:] == beliefs[0][1:]


def test_belief_follows_readings_and_what_is_withdrawn(store: TerrainStore) -> None:
    stored.two_soils(store)
    before = store.belief("valley", "tractor").class_probabilities((3, 3))
    revision = store.changes("valley")[-1].revision
    store.add_readings("valley", [stored.word("a", 3.5, 3.5, SoilClass.ROCK, instrument="eye")])
    after = store.belief("valley", "tractor").class_probabilities((3, 3))
    assert after != before
    assert store.belief("valley", "tractor", until=revision).class_probabilities((3, 3)) == before
    store.withdraw("valley", "drunk", instrument="eye")
    assert store.belief("valley", "tractor").class_probabilities((3, 3)) == before
    part = store.belief("valley", "tractor", window=Window(2, 2, 10, 10), until=revision + 1)
    assert part.class_probabilities((1, 1)) == pytest.approx(after)
    store.create_region("bare", stored.frame(5, 5))
    with pytest.raises(MissingLayerError):
        store.belief("bare", "tractor")


def test_changes_count_up_without_a_gap(store: TerrainStore) -> None:
    stored.two_soils(store)
    store.add_readings("valley", [stored.push("a", 3, 3), stored.push("b", 3, 4)])
    store.withdraw("valley", "why", ids=["a"])
    line = shapely.to_wkb(shapely.LineString([(stored.WEST, stored.NORTH), (stored.WEST + 9, stored.NORTH - 9)]))
    store.add_route("valley", StoredRoute("r", line, "tractor", {"length_m": 12.5}, "me", "2026-05-01T00:00:00Z"))
    store.add_run("valley", StoredRun("d", "runs/run.mcap", {"status": "reached"}, "me", "2026-05-01T00:00:00Z"))
    changes = store.changes("valley")
    assert [change.revision for change in changes] == list(range(1, len(changes) + 1))
    assert [(change.kind, change.subject, change.count) for change in changes] == [
        ("region", "valley", 1), ("layer", "elevation", 1), ("layer", "soil", 1), ("readings", "", 2),
        ("withdrawal", "", 1), ("route", "r", 1), ("run", "d", 1),
    ]  # fmt: skip
    assert store.changes("valley", since=5) == changes[5:]
    assert changes[3].detail["ids"] == ["a", "b"]
    (route,), (run,) = store.routes("valley"), store.runs("valley")
    assert (route.wkb, route.vehicle, route.summary) == (line, "tractor", {"length_m": 12.5})
    assert (run.log, run.summary) == ("runs/run.mcap", {"status": "reached"})


def test_a_subscriber_hears_of_what_others_do(store: TerrainStore, store_url: str) -> None:
    stored.two_soils(store)
    with open_store(store_url) as other, store.subscribe("valley") as ears:
        assert ears.poll() == []
        other.add_readings("valley", [stored.push("a", 3, 3)])
        assert [change.kind for change in ears.poll(5)] == ["readings"]
        assert ears.poll(0.01) == []

        def later() -> None:
            other.withdraw("valley", "why", ids=["a"])

        timer = threading.Timer(0.3, later)
        timer.start()
        (heard,) = ears.poll(20)
        timer.join()
        assert (heard.kind, heard.detail["ids"]) == ("withdrawal", ["a"])
        with store.subscribe("valley", since=0) as late:
            assert [change.revision for change in late.poll()] == [1, 2, 3, 4, 5]


def test_writers_at_once_lose_nothing(store: TerrainStore, store_url: str) -> None:
    stored.two_soils(store)
    failures: list[BaseException] = []

    def file(author: str) -> None:
        try:
            with open_store(store_url) as own:
                for n in range(10):
                    own.add_readings("valley", [stored.push(f"{author}-{n}", 3 + n, 3, author=author)])
                own.add_readings(
                    "valley", [stored.push(f"{author}-{n}", 3 + n % 30, 3, author=author) for n in range(10, 40)]
                )
        except BaseException as error:  # noqa: BLE001 - a thread has nobody to tell
            failures.append(error)

    writers = [threading.Thread(target=file, args=(f"rover {n}",)) for n in range(8)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert failures == []
    found = store.readings("valley")
    assert len({one.id for one in found}) == len(found) == 8 * 40
    revisions = [change.revision for change in store.changes("valley")]
    assert revisions == list(range(1, 3 + 8 * 11 + 1))


def test_zones_close_every_cell_that_they_touch(store: TerrainStore) -> None:
    from swathe.store.soil import closed_by_zones

    stored.put(store, "valley", "elevation", waves(10, 10))
    info = store.region("valley")
    assert closed_by_zones(store, info, info.frame) is None
    sliver = shapely.box(stored.WEST + 65, stored.NORTH - 100, stored.WEST + 66, stored.NORTH - 40)
    assert store.write_zones("valley", [[Zone(shapely.to_wkb(sliver), "pipe")]], stored.provenance("z"))
    assert not store.write_zones("valley", [[]], stored.provenance("z"))
    info = store.region("valley")
    closed = closed_by_zones(store, info, info.frame)
    assert closed is not None
    assert {(int(row), int(column)) for row, column in np.argwhere(closed)} == {(1, 2), (2, 2), (3, 2)}
    assert [zone.name for zone in store.zones("valley", (0, 0, 1, 1))] == []
