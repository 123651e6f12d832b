"""The paper's table in PostGIS against the core, and plans that read it against plans from files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from store_worlds import frame, import_heights
from swathe import mission
from swathe.config import Settings, TerrainRequest
from swathe.grid import GridGeometry, Window
from swathe.rank import RankParams, Region, rank_map
from swathe.soil import SoilClass, soil_goodness
from swathe.store import open_store
from swathe.store.imports import import_elevation, import_readings, import_soil
from swathe.store.postgis import PostgisStore
from swathe.terrain import group_mean, height_map
from swathe.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    import postgis

BUNDLED = "bundled:jacksboro"


@pytest.fixture
def store(postgis_cluster: postgis.Cluster, postgis_database: str) -> Iterator[PostgisStore]:
    with open_store(postgis_cluster.url(postgis_database), create=True) as opened:
        assert isinstance(opened, PostgisStore)
        yield opened


def stored_cells(cluster: postgis.Cluster, database: str, region: str) -> dict[str, NDArray[Any]]:
    """Return the columns of the table as layers, as anybody's SQL sees them."""
    with cluster.connect(database) as connection:
        rows = connection.execute(
            'SELECT "row", "column", height, elevation_m, soil_category, gradient_goodness, soil_goodness, rank '
            "FROM swathe.cells c JOIN swathe.regions r ON r.id = c.region_id WHERE r.name = %s ORDER BY 1, 2",
            (region,),
        ).fetchall()
    shape = (1 + max(row[0] for row in rows), 1 + max(row[1] for row in rows))
    assert len(rows) == shape[0] * shape[1], "a row for every cell"
    names = ("height", "elevation_m", "soil_category", "gradient_goodness", "soil_goodness", "rank")
    # Text of a real number is as long as a float32 needs.
    return {
        name: np.array([np.nan if row[place] is None else row[place] for row in rows], dtype=np.float32).reshape(shape)
        for place, name in enumerate(names, start=2)
    }


def require_as_in_the_core(
    cells: dict[str, NDArray[Any]], heights: NDArray[np.float32], soil: NDArray[np.uint8] | None, cell_size_m: float
) -> None:
    """Compare the table with what the core makes of the heights and of the soil of the groups."""
    grey, means = group_mean(height_map(heights)), group_mean(heights)
    assert np.array_equal(cells["height"], grey, equal_nan=True)
    assert np.array_equal(cells["elevation_m"], means, equal_nan=True)
    geometry = GridGeometry(grey.shape[0], grey.shape[1], 8 * cell_size_m)
    literal = Region(geometry, means, load_vehicle("tractor"), soil, grey, params=RankParams(profile="literal"))
    assert np.array_equal(cells["rank"], rank_map(literal).rank)
    codes = np.zeros(grey.shape, np.uint8) if soil is None else soil
    assert np.array_equal(cells["soil_category"], codes)
    goodness = np.array([soil_goodness(soil_class) for soil_class in SoilClass])
    assert np.array_equal(cells["soil_goodness"], goodness[codes])
    known = np.isfinite(grey)
    assert np.array_equal(np.isnan(cells["gradient_goodness"]), ~known)
    total = cells["gradient_goodness"] + cells["soil_goodness"]
    assert np.array_equal(cells["rank"], np.where(known, total, 0))


def test_on_real_terrain_the_table_is_what_the_core_computes(
    store: PostgisStore, postgis_cluster: postgis.Cluster, postgis_database: str, swathe_data: Path
) -> None:
    folder = swathe_data / "ebergotzen"
    import_elevation(store, "e", [str(folder / "ebergotzen_dem_25m.tif")])
    import_soil(store, "e", str(folder / "ebergotzen_soil_zones.gpkg"))
    assert store.fill_cells("e") > 0
    geometry = store.region("e").frame.geometry
    whole = Window(0, 0, *geometry.shape)
    table = store.cell_table("e")
    assert table is not None
    assert table.soil is not None
    cells = stored_cells(postgis_cluster, postgis_database, "e")
    require_as_in_the_core(cells, store.read_window("e", "elevation", whole), table.soil.codes, geometry.cell_size_m)
    assert len(np.unique(cells["rank"])) > 2, "worth comparing"


def test_postgis_joins_height_and_soil_like_we_do(
    store: PostgisStore, postgis_cluster: postgis.Cluster, postgis_database: str, swathe_data: Path
) -> None:
    # An outside truth: the soil under the centre of every cell, by the database's own geometry.
    folder = swathe_data / "ebergotzen"
    import_elevation(store, "e", [str(folder / "ebergotzen_dem_25m.tif")])
    import_soil(store, "e", str(folder / "ebergotzen_soil_zones.gpkg"))
    store.fill_cells("e")
    with postgis_cluster.connect(postgis_database) as connection:
        all_cells, on_edges, different = connection.execute(
            """
            WITH centres AS (
                SELECT c.soil_category, r.name, ST_SetSRID(ST_MakePoint(
                    r.west_m + (c."column" + 0.5) * 8 * r.cell_size_m, r.north_m - (c."row" + 0.5) * 8 * r.cell_size_m
                ), r.srid) AS centre
                FROM swathe.cells c JOIN swathe.regions r ON r.id = c.region_id
            ), joined AS (
                SELECT soil_category, under.soil_class, coalesce(on_edge, false) AS on_edge
                FROM centres LEFT JOIN LATERAL (
                    SELECT max(s.soil_class) AS soil_class,
                           bool_or(ST_Intersects(ST_Boundary(s.geom), centre)) AS on_edge
                    FROM swathe.soil s WHERE s.region = name AND ST_Intersects(s.geom, centre)
                ) under ON true
            )
            SELECT count(*), count(*) FILTER (WHERE on_edge),
                   count(*) FILTER (WHERE NOT on_edge AND coalesce(soil_class, 0) <> soil_category)
            FROM joined
            """
        ).fetchone() or (0, 0, 1)
    assert all_cells == 2500
    # A centre on the very edge belongs to either side.
    assert on_edges <= 2
    assert different == 0


#: Grey levels of groups whose differences lie on and beside the edges of Table I, and none.
LEVELS = arrays.arrays(
    np.float32,
    arrays.array_shapes(min_dims=2, max_dims=2, min_side=4, max_side=9),
    elements=st.sampled_from([0.0, 0.5, 1.0, 65.5, 66.0, 66.5, 67.0, 129.0, 129.5, 130.0, 192.0, 192.5, 193.0, 254.5])
    | st.just(float("nan")),
)


def ground_of(levels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return heights whose groups of 8 x 8 have these mean levels: of halves, half of the group is one level up."""
    heights = np.repeat(np.repeat(levels, 8, axis=0), 8, axis=1)
    upper = np.arange(heights.shape[0])[:, None] % 8 < 4
    return np.where(upper, np.ceil(heights), np.floor(heights)).astype(np.float32)


def test_any_heights_give_the_table_that_the_core_computes(
    store: PostgisStore, postgis_cluster: postgis.Cluster, postgis_database: str
) -> None:
    number = 0

    @settings(max_examples=25, suppress_health_check=list(HealthCheck))
    @given(LEVELS)
    def law(levels: NDArray[np.float32]) -> None:
        nonlocal number
        number += 1
        name = f"r{number}"
        levels[0, 0], levels[-1, -1] = 0.0, 255.0
        heights = ground_of(levels)
        store.create_region(name, frame(heights.shape[0], heights.shape[1]))
        import_heights(store, name, heights, f"drawn {number}")
        store.fill_cells(name)
        cells = stored_cells(postgis_cluster, postgis_database, name)
        assert np.array_equal(cells["height"], levels, equal_nan=True)
        require_as_in_the_core(cells, heights, None, 10.0)
        store.drop_region(name)

    law()


def test_the_table_follows_its_layers(
    store: PostgisStore, postgis_cluster: postgis.Cluster, postgis_database: str
) -> None:
    store.create_region("r", frame(80, 80))
    assert store.cell_table("r") is None
    first, second = (np.random.default_rng(seed).normal(0, 50, (80, 80)).astype("f4") for seed in (1, 2))
    for number, heights in enumerate((first, second)):
        import_heights(store, "r", heights, f"{number}")
        table = store.cell_table("r")
        assert table is not None
        assert np.array_equal(table.elevation_m, group_mean(heights))
        assert np.array_equal(table.height, group_mean(height_map(heights)))
    with postgis_cluster.connect(postgis_database) as connection:
        assert connection.execute("SELECT count(*) FROM swathe.cells").fetchone() == (100,)


def test_who_may_not_write_plans_without_the_table(
    store: PostgisStore, postgis_cluster: postgis.Cluster, postgis_database: str
) -> None:
    store.create_region("r", frame(80, 80))
    import_heights(store, "r", np.random.default_rng(1).normal(0, 50, (80, 80)).astype("f4"), "a")
    url = postgis_cluster.url(postgis_database) + "&options=-c%20default_transaction_read_only%3Don"
    with open_store(url) as reader:
        assert reader.cell_table("r") is None
        store.fill_cells("r")
        assert reader.cell_table("r") is not None


@pytest.mark.parametrize("profile", ["paper", "literal", "metric"])
def test_a_plan_from_the_store_is_that_from_files_to_the_byte(
    store: PostgisStore,
    postgis_cluster: postgis.Cluster,
    postgis_database: str,
    tmp_path: Path,
    profile: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import_elevation(store, "jacksboro", [BUNDLED])
    import_soil(store, "jacksboro", BUNDLED)
    url = postgis_cluster.url(postgis_database)
    wanted = Settings(vehicle="pickup-4x4", rank=RankParams(profile=profile))
    start, goal = (-84.1311, 36.4621), (-84.1872, 36.5762)
    files = mission.plan_route(TerrainRequest((BUNDLED,), soil=BUNDLED), start, goal, wanted, tmp_path / "files")
    read: list[str] = []
    original = PostgisStore.read_window

    def watched(self: PostgisStore, region: str, layer: str, *more: Any, **named: Any) -> NDArray[Any]:
        read.append(layer)
        return original(self, region, layer, *more, **named)

    store.fill_cells("jacksboro")
    monkeypatch.setattr(PostgisStore, "read_window", watched)
    asked = TerrainRequest((), store=url, region="jacksboro")
    stored = mission.plan_route(asked, start, goal, wanted, tmp_path / "store")
    assert stored["status"] == files["status"]
    for name in ("route.geojson", "nests.geojson", "rank.tif"):
        one, other = tmp_path / "files" / name, tmp_path / "store" / name
        assert one.exists() == other.exists()
        if one.exists():
            assert one.read_bytes() == other.read_bytes(), name
    assert (tmp_path / "store" / "nests.geojson").exists()
    if profile == "metric":
        assert read
    else:
        assert read == [], "the paper's profiles read the table alone"
    of_the_way_of_reading = {"outputs", "timings_s", "bytes_read", "request"}
    different = {key for key in files if key not in of_the_way_of_reading and files[key] != stored[key]}
    assert different == set()


def test_readings_change_a_plan_that_reads_the_table(
    store: PostgisStore, postgis_cluster: postgis.Cluster, postgis_database: str, tmp_path: Path
) -> None:
    import_elevation(store, "jacksboro", [BUNDLED])
    import_soil(store, "jacksboro", BUNDLED)
    asked = TerrainRequest((), store=postgis_cluster.url(postgis_database), region="jacksboro")
    wanted = Settings(vehicle="pickup-4x4", rank=RankParams(profile="paper"))
    start, goal = (-84.1311, 36.4621), (-84.1872, 36.5762)
    before = mission.plan_route(asked, start, goal, wanted, tmp_path / "before")
    csv = tmp_path / "pushes.csv"
    csv.write_text("lon,lat,ci_5cm,ci_10cm,ci_15cm\n-84.1311,36.4621,40,40,40\n", encoding="ascii")
    import_readings(store, "jacksboro", str(csv), author="rover")
    after = mission.plan_route(asked, start, goal, wanted, tmp_path / "after")
    assert any("1 readings" in note for note in after["notes"])
    assert not any("readings" in note for note in before["notes"])
