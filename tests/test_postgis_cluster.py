"""The throw-away cluster itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import psycopg
import pytest

if TYPE_CHECKING:
    import postgis


def test_a_database_has_both_extensions_and_is_empty(postgis_cluster: postgis.Cluster, postgis_database: str) -> None:
    with postgis_cluster.connect(postgis_database) as connection:
        found = connection.execute("SELECT extname FROM pg_extension WHERE extname LIKE 'postgis%' ORDER BY 1")
        assert [name for (name,) in found] == ["postgis", "postgis_raster"]
        tables = connection.execute("SELECT count(*) FROM pg_tables WHERE schemaname = 'swathe'").fetchone()
        assert tables == (0,)


def test_a_server_that_was_killed_comes_back_with_what_was_committed(
    postgis_cluster: postgis.Cluster, postgis_database: str
) -> None:
    with postgis_cluster.connect(postgis_database) as connection:
        connection.execute("CREATE TABLE kept (n int)")
        connection.execute("INSERT INTO kept VALUES (4711)")
        # The cluster is quick, so that what must survive is written out by hand.
        connection.execute("CHECKPOINT")
    postgis_cluster.kill()
    assert not postgis_cluster.is_running()
    with pytest.raises(psycopg.OperationalError):
        postgis_cluster.connect(postgis_database)
    postgis_cluster.start()
    with postgis_cluster.connect(postgis_database) as connection:
        assert connection.execute("SELECT n FROM kept").fetchall() == [(4711,)]


def test_only_one_user_needs_a_password(postgis_cluster: postgis.Cluster, postgis_database: str) -> None:
    with pytest.raises(psycopg.OperationalError, match="password"):
        postgis_cluster.connect(postgis_database, "guarded")
