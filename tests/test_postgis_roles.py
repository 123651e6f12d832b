"""The grants that the manual shows are enough for each role, and no more."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import psycopg
import pytest

import requirement
import stored
from swathe.errors import StoreReadOnlyError
from swathe.grid import Window
from swathe.soil import SoilClass
from swathe.store import StoredRoute, StoredRun, TerrainStore, open_store

if TYPE_CHECKING:
    from collections.abc import Iterator

    import postgis

ROLES = ("planners", "vehicles", "importers")
WHOLE = Window(0, 0, 40, 60)


def grants() -> str:
    """Return the statements of the manual."""
    text = (requirement.ROOT / "docs" / "postgis.md").read_text(encoding="utf-8")
    blocks: list[str] = re.findall(r"```sql\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == len(ROLES)
    return "\n".join(blocks)


@pytest.fixture
def urls(postgis_cluster: postgis.Cluster, postgis_database: str) -> Iterator[dict[str, str]]:
    """Return an address for each role, on a store with a region."""
    with open_store(postgis_cluster.url(postgis_database), create=True) as store:
        stored.two_soils(store)
    with postgis_cluster.connect(postgis_database) as connection:
        for role in ROLES:
            connection.execute(f"CREATE ROLE {role} LOGIN")
        connection.execute(grants())
    yield {role: postgis_cluster.url(postgis_database, role) for role in ROLES}
    with postgis_cluster.connect(postgis_database) as connection:
        for role in ROLES:
            connection.execute(f"DROP OWNED BY {role}")
            connection.execute(f"DROP ROLE {role}")


def replace_elevation(store: TerrainStore) -> None:
    stored.put(store, "valley", "elevation", np.ones((40, 60), np.float32), "b")


def file_a_drive(store: TerrainStore) -> None:
    line = bytes.fromhex("010200000002000000" + "00" * 32)
    store.add_route("valley", StoredRoute("r", line, "tractor", {}))
    store.add_run("valley", StoredRun("d", "run.mcap", {}))


def test_a_planner_reads_and_changes_nothing(urls: dict[str, str]) -> None:
    with open_store(urls["planners"]) as store:
        assert store.read_window("valley", "elevation", WHOLE).shape == (40, 60)
        assert store.belief("valley", "tractor").soil()[0, 0] == SoilClass.SAND
        with store.subscribe("valley") as ears:
            assert ears.poll() == []
        assert store.cell_table("valley") is None
        with pytest.raises(StoreReadOnlyError):
            store.add_readings("valley", [stored.push("a", 3, 3)])
        with pytest.raises(StoreReadOnlyError):
            file_a_drive(store)
        with pytest.raises(StoreReadOnlyError):
            replace_elevation(store)


def test_a_vehicle_files_what_it_measures_and_changes_no_map(urls: dict[str, str]) -> None:
    with open_store(urls["vehicles"]) as store:
        assert store.add_readings("valley", [stored.push("a", 3, 3)]) == 1
        assert store.withdraw("valley", "spring broken", ids=["a"]) == 1
        file_a_drive(store)
        file_a_drive(store)
        with pytest.raises(StoreReadOnlyError):
            replace_elevation(store)
        with pytest.raises(StoreReadOnlyError):
            store.drop_region("valley")
        assert len(store.changes("valley")) == 9
    with psycopg.connect(urls["vehicles"], autocommit=True) as connection:
        for forbidden in (
            "DELETE FROM swathe.readings",
            "UPDATE swathe.readings SET author = 'me'",
            "UPDATE swathe.regions SET name = 'mine'",
            "DELETE FROM swathe.changes",
        ):
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                connection.execute(forbidden)


def test_an_importer_fills_everything(urls: dict[str, str]) -> None:
    with open_store(urls["importers"]) as store:
        replace_elevation(store)
        assert (store.read_window("valley", "elevation", WHOLE) == 1).all()
        table = store.cell_table("valley")
        assert table is not None
        assert table.geometry.shape == (5, 7)
        stored.two_soils(store, "another")
        store.drop_region("valley")
        assert [region.name for region in store.regions()] == ["another"]


def test_a_fact_is_changed_by_nobody(urls: dict[str, str], postgis_cluster: postgis.Cluster) -> None:
    with open_store(urls["vehicles"]) as store:
        store.add_readings("valley", [stored.push("a", 3, 3)])
    database = urls["vehicles"].rpartition("/")[2].partition("?")[0]
    with (
        postgis_cluster.connect(database) as owner,
        pytest.raises(psycopg.errors.RestrictViolation, match="readings are facts"),
    ):
        owner.execute("UPDATE swathe.readings SET author = 'somebody'")
