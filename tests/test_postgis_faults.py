"""Everything that can go wrong with a server: a clear error with a remedy each, and nothing lost."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import psycopg
import pytest

import postgis
from store_worlds import fill, frame, heights, import_heights, provenance, reading
from swathe.errors import (
    InvalidParameterError,
    MissingRegionError,
    StoreBusyError,
    StoreError,
    StoreFullError,
    StoreReadOnlyError,
    StoreSchemaError,
    StoreUnavailableError,
)
from swathe.grid import Window
from swathe.store import open_store
from swathe.store.postgis import PostgisStore
from swathe.store.postgis_schema import migrations

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from swathe.store import Change, ImportSession, TerrainStore

ROWS, COLUMNS = 600, 700
WHOLE = Window(0, 0, ROWS, COLUMNS)
OLD, NEW = 1, 2


@pytest.fixture(scope="module")
def safe_cluster() -> Iterator[postgis.Cluster]:
    """A cluster that keeps what it has acknowledged, whatever happens to it; some tests end it."""
    with postgis.running_cluster(quick=False) as cluster:
        yield cluster


@pytest.fixture
def safe_database(safe_cluster: postgis.Cluster) -> Iterator[str]:
    if not safe_cluster.is_running():
        safe_cluster.start()
    name = safe_cluster.new_database()
    yield name
    if not safe_cluster.is_running():
        safe_cluster.start()
    safe_cluster.drop(name)


def opened(cluster: postgis.Cluster, database: str, user: str = "postgres", more: str = "") -> PostgisStore:
    store = open_store(cluster.url(database, user) + more, create=True)
    assert isinstance(store, PostgisStore)
    return store


def with_old(cluster: postgis.Cluster, database: str) -> PostgisStore:
    """Return a store whose region ``r`` holds the old heights."""
    store = opened(cluster, database)
    store.create_region("r", frame(ROWS, COLUMNS))
    import_heights(store, "r", heights(ROWS, COLUMNS, OLD), f"seed {OLD}")
    return store


def finish(session: ImportSession, layer: NDArray[np.float32]) -> None:
    fill(session, layer)
    session.commit()


def import_often(store: TerrainStore, layer: NDArray[np.float32]) -> None:
    for number in range(9):
        import_heights(store, "r", layer, f"seed {NEW}", layer=f"more {number}")


def seed_of(layer: NDArray[np.float32]) -> int:
    """Return which heights a layer is, every cell of it."""
    rows, columns = layer.shape
    found = [seed for seed in (OLD, NEW) if np.array_equal(layer, heights(rows, columns, seed))]
    assert len(found) == 1, "neither the old nor the new"
    return found[0]


def require_plain(error: StoreError | InvalidParameterError) -> None:
    assert error.exit_code == (2 if isinstance(error, InvalidParameterError) else 4)
    assert error.message.endswith(".")
    assert error.remedy.endswith((".", "does it.", ";"))
    assert postgis.PASSWORD not in str(error)
    assert "Traceback" not in str(error)


# At the door


def test_a_server_that_is_down_says_so(tmp_path: Path) -> None:
    with pytest.raises(StoreUnavailableError, match=r"postgresql://me@/region does not answer\.") as caught:
        open_store(f"postgresql://me@/region?host={tmp_path}")
    require_plain(caught.value)


def test_a_database_that_is_not_there_says_so(postgis_cluster: postgis.Cluster) -> None:
    with pytest.raises(StoreUnavailableError, match="There is no database") as caught:
        open_store(postgis_cluster.url("nowhere"))
    require_plain(caught.value)


def test_a_user_who_is_not_known_says_so(postgis_cluster: postgis.Cluster, postgis_database: str) -> None:
    with pytest.raises(StoreUnavailableError, match="does not know the user stranger") as caught:
        open_store(postgis_cluster.url(postgis_database, "stranger"))
    require_plain(caught.value)


@pytest.mark.parametrize("given", [None, "wrong-but-secret"])
def test_a_wrong_password_is_refused_and_never_shown(
    postgis_cluster: postgis.Cluster, postgis_database: str, monkeypatch: pytest.MonkeyPatch, given: str | None
) -> None:
    monkeypatch.delenv("PGPASSWORD", raising=False)
    if given is not None:
        monkeypatch.setenv("PGPASSWORD", given)
    with pytest.raises(StoreUnavailableError, match="does not let the user guarded in") as caught:
        open_store(postgis_cluster.url(postgis_database, postgis.GUARDED))
    require_plain(caught.value)
    assert "PGPASSWORD or ~/.pgpass" in caught.value.remedy
    shown = [caught.value, caught.value.__cause__, caught.value.__context__]
    assert not any("wrong-but-secret" in f"{error!r}{error}" for error in shown)


@pytest.mark.parametrize("source", ["environment", "file"])
def test_the_right_password_comes_from_the_environment_or_the_file(
    postgis_cluster: postgis.Cluster,
    postgis_database: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    source: str,
) -> None:
    opened(postgis_cluster, postgis_database).close()
    with postgis_cluster.connect(postgis_database) as connection:
        connection.execute(f"GRANT USAGE ON SCHEMA swathe TO {postgis.GUARDED}")
        connection.execute(f"GRANT SELECT ON ALL TABLES IN SCHEMA swathe TO {postgis.GUARDED}")
    if source == "environment":
        monkeypatch.setenv("PGPASSWORD", postgis.PASSWORD)
    else:
        file = tmp_path / "pgpass"
        file.write_text(f"*:*:*:{postgis.GUARDED}:{postgis.PASSWORD}\n", encoding="ascii")
        file.chmod(0o600)
        monkeypatch.setenv("PGPASSFILE", str(file))
    with open_store(postgis_cluster.url(postgis_database, postgis.GUARDED)) as store:
        assert store.regions() == []
        assert postgis.PASSWORD not in f"{store.address}{vars(store)}"


@pytest.mark.parametrize(
    "url",
    [
        "postgresql://me:hush-hush@somewhere/region",
        "postgresql://me@somewhere/region?password=hush-hush",
        "postgresql://me@somewhere/region?sslpassword=hush-hush",
        "postgres://me:hush-hush@somewhere:5433/region?sslmode=require",
    ],
)
def test_an_address_with_a_password_is_refused_without_showing_it(url: str) -> None:
    with pytest.raises(InvalidParameterError, match="holds a password") as caught:
        open_store(url)
    require_plain(caught.value)
    assert "me@somewhere" in caught.value.message
    error: BaseException | None = caught.value
    while error is not None:
        assert "hush-hush" not in f"{error!r}{error}"
        error = error.__context__


def test_an_address_that_is_none_is_refused_without_showing_it() -> None:
    with pytest.raises(InvalidParameterError, match="none of PostgreSQL") as caught:
        open_store("postgresql://me:hush-hush@somewhere/%zz")
    assert "hush-hush" not in str(caught.value)


def test_missing_extensions_are_named_with_what_to_run(postgis_cluster: postgis.Cluster) -> None:
    name = postgis_cluster.new_database(template="template0")
    try:
        with postgis_cluster.connect() as connection:
            with contextlib.suppress(psycopg.errors.DuplicateObject):
                connection.execute("CREATE ROLE plain LOGIN")
            connection.execute(f"GRANT CREATE ON DATABASE {name} TO plain")
        with pytest.raises(StoreSchemaError, match="lacks the extension postgis and postgis_raster") as caught:
            opened(postgis_cluster, name, "plain")
        require_plain(caught.value)
        assert "CREATE EXTENSION postgis; CREATE EXTENSION postgis_raster;" in caught.value.remedy
        # An administrator needs no help.
        opened(postgis_cluster, name).close()
    finally:
        postgis_cluster.drop(name)


# Schemas of other versions


def test_without_a_store_there_is_none_unless_it_shall_be_made(
    postgis_cluster: postgis.Cluster, postgis_database: str
) -> None:
    with pytest.raises(StoreUnavailableError, match="holds no store") as caught:
        open_store(postgis_cluster.url(postgis_database))
    require_plain(caught.value)
    opened(postgis_cluster, postgis_database).close()
    open_store(postgis_cluster.url(postgis_database)).close()


def test_a_newer_schema_is_refused(postgis_cluster: postgis.Cluster, postgis_database: str) -> None:
    opened(postgis_cluster, postgis_database).close()
    with postgis_cluster.connect(postgis_database) as connection:
        connection.execute("INSERT INTO swathe.schema_versions (version, name) VALUES (9999, 'from the future')")
    with pytest.raises(StoreSchemaError, match="newer version of Swathe") as caught:
        opened(postgis_cluster, postgis_database)
    require_plain(caught.value)


@pytest.mark.parametrize("taken", range(1, len(migrations())))
def test_an_older_schema_goes_forward_with_rights_and_says_so_without(
    postgis_cluster: postgis.Cluster, postgis_database: str, monkeypatch: pytest.MonkeyPatch, taken: int
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("swathe.store.postgis_schema.migrations", lambda: migrations()[:taken])
        opened(postgis_cluster, postgis_database).close()
    with postgis_cluster.connect(postgis_database) as connection:
        with contextlib.suppress(psycopg.errors.DuplicateObject):
            connection.execute("CREATE ROLE visitor LOGIN")
        connection.execute("GRANT USAGE ON SCHEMA swathe TO visitor")
        connection.execute("GRANT SELECT ON ALL TABLES IN SCHEMA swathe TO visitor")
    with pytest.raises(StoreSchemaError, match="older version of Swathe") as caught:
        open_store(postgis_cluster.url(postgis_database, "visitor"))
    require_plain(caught.value)
    with open_store(postgis_cluster.url(postgis_database)) as store:
        store.create_region("r", frame())
        assert store.add_readings("r", [reading(1)]) == 1
    with postgis_cluster.connect(postgis_database) as connection:
        found = [version for (version,) in connection.execute("SELECT version FROM swathe.schema_versions ORDER BY 1")]
    assert found == [step.version for step in migrations()]


def test_many_may_make_the_same_store_at_once(postgis_cluster: postgis.Cluster, postgis_database: str) -> None:
    failures: list[BaseException] = []

    def make() -> None:
        try:
            opened(postgis_cluster, postgis_database).close()
        except BaseException as error:  # noqa: BLE001 - handed to the test
            failures.append(error)

    threads = [threading.Thread(target=make) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []


# Rights


def test_a_reader_reads_and_is_told_that_he_may_not_write(
    postgis_cluster: postgis.Cluster, postgis_database: str
) -> None:
    with_old(postgis_cluster, postgis_database).close()
    with postgis_cluster.connect(postgis_database) as connection:
        with contextlib.suppress(psycopg.errors.DuplicateObject):
            connection.execute("CREATE ROLE visitor LOGIN")
        connection.execute("GRANT USAGE ON SCHEMA swathe TO visitor")
        connection.execute("GRANT SELECT ON ALL TABLES IN SCHEMA swathe TO visitor")
    with open_store(postgis_cluster.url(postgis_database, "visitor")) as store:
        assert seed_of(store.read_window("r", "elevation", WHOLE)) == OLD
        assert store.readings("r") == []
        attempts: list[Any] = [
            lambda: store.create_region("another", frame()),
            lambda: store.add_readings("r", [reading(1)]),
            lambda: store.withdraw("r", "wrong", author="rover"),
            lambda: store.drop_region("r"),
            lambda: store.begin_import("r", "elevation", provenance("other")),
        ]
        for attempt in attempts:
            with pytest.raises(StoreReadOnlyError) as caught:
                attempt()
            require_plain(caught.value)
        assert [region.name for region in store.regions()] == ["r"]


def test_a_server_that_only_reads_says_so(postgis_cluster: postgis.Cluster, postgis_database: str) -> None:
    with_old(postgis_cluster, postgis_database).close()
    url = postgis_cluster.url(postgis_database) + "&options=-c%20default_transaction_read_only%3Don"
    with open_store(url) as store, pytest.raises(StoreReadOnlyError) as caught:
        store.add_readings("r", [reading(1)])
    require_plain(caught.value)


# Slow, busy, full


def test_a_question_that_takes_too_long_is_given_up(postgis_cluster: postgis.Cluster, postgis_database: str) -> None:
    with_old(postgis_cluster, postgis_database).close()
    limit = "&options=-c%20statement_timeout%3D200"
    with postgis_cluster.connect(postgis_database) as connection, connection.transaction():
        connection.execute("LOCK TABLE swathe.regions")
        store = opened(postgis_cluster, postgis_database, more=limit)
        with store, pytest.raises(StoreUnavailableError, match="took too long") as caught:
            store.regions()
        require_plain(caught.value)


def test_who_waits_for_a_lock_for_too_long_is_told(postgis_cluster: postgis.Cluster, postgis_database: str) -> None:
    with_old(postgis_cluster, postgis_database).close()
    limit = "&options=-c%20lock_timeout%3D200"
    with postgis_cluster.connect(postgis_database) as connection, connection.transaction():
        connection.execute("SELECT * FROM swathe.regions FOR UPDATE")
        store = opened(postgis_cluster, postgis_database, more=limit)
        with store, pytest.raises(StoreBusyError, match="Somebody else is writing") as caught:
            store.add_readings("r", [reading(1)])
        require_plain(caught.value)


def test_two_imports_of_one_layer_do_not_mix(postgis_cluster: postgis.Cluster, postgis_database: str) -> None:
    store = with_old(postgis_cluster, postgis_database)
    other = opened(postgis_cluster, postgis_database)
    with store, other, store.begin_import("r", "elevation", provenance(f"seed {NEW}")) as first:
        first.write_tile(0, 0, heights(ROWS, COLUMNS, NEW)[:256, :256])
        with pytest.raises(StoreBusyError, match="Somebody else is importing") as caught:
            other.begin_import("r", "elevation", provenance("third"))
        require_plain(caught.value)
        # Other layers are free, and readers see the old one.
        other.begin_import("r", "rank", provenance("third"), dtype="uint8").close()
        assert seed_of(other.read_window("r", "elevation", WHOLE)) == OLD
        fill(first, heights(ROWS, COLUMNS, NEW))
        first.commit()
        assert seed_of(other.read_window("r", "elevation", WHOLE)) == NEW


def test_a_region_that_is_removed_under_an_import_ends_it_clearly(
    postgis_cluster: postgis.Cluster, postgis_database: str
) -> None:
    with with_old(postgis_cluster, postgis_database) as store:
        session = store.begin_import("r", "elevation", provenance(f"seed {NEW}"))
        fill(session, heights(ROWS, COLUMNS, NEW))
        store.drop_region("r")
        with pytest.raises(MissingRegionError, match="removed") as caught:
            session.commit()
        require_plain(caught.value)
        session.close()


def test_a_full_disk_keeps_the_old_and_the_import_resumes(
    postgis_cluster: postgis.Cluster, postgis_database: str
) -> None:
    mount = shutil.which("mount")
    if os.geteuid() != 0 or mount is None:
        pytest.skip("Only root can make a small disk.")
    disk = Path(tempfile.mkdtemp(prefix="swathe-disk-"))
    disk.chmod(0o755)
    if subprocess.run([mount, "-t", "tmpfs", "-o", "size=24m", "tmpfs", disk], check=False).returncode != 0:
        disk.rmdir()
        pytest.skip("This root may not mount.")
    try:
        shutil.chown(disk, "postgres", "postgres")
        with postgis_cluster.connect() as connection:
            connection.execute(f"CREATE TABLESPACE small LOCATION '{disk}'")
        store = with_old(postgis_cluster, postgis_database)
        with postgis_cluster.connect(postgis_database) as connection:
            connection.execute("ALTER TABLE swathe.tiles SET TABLESPACE small")
        ballast = disk / "ballast"
        ballast.write_bytes(bytes(16_000_000))
        shutil.chown(ballast, "postgres", "postgres")
        new = heights(ROWS, COLUMNS, NEW)
        with store:
            with pytest.raises(StoreFullError, match="is full") as caught:
                import_often(store, new)
            require_plain(caught.value)
            assert seed_of(store.read_window("r", "elevation", WHOLE)) == OLD
            ballast.unlink()
            import_heights(store, "r", new, f"seed {NEW}")
            assert seed_of(store.read_window("r", "elevation", WHOLE)) == NEW
    finally:
        postgis_cluster.drop(postgis_database)
        with postgis_cluster.connect() as connection:
            connection.execute("DROP TABLESPACE IF EXISTS small")
        subprocess.run(["umount", disk], check=False)  # noqa: S607 - beside mount
        disk.rmdir()


# Death in the middle


def test_a_backend_that_is_ended_is_told_and_replaced(postgis_cluster: postgis.Cluster, postgis_database: str) -> None:
    with with_old(postgis_cluster, postgis_database) as store:
        with store.begin_import("r", "elevation", provenance(f"seed {NEW}")) as session:
            session.write_tile(0, 0, heights(ROWS, COLUMNS, NEW)[:256, :256])
            _end_backends(postgis_cluster, postgis_database)
            with pytest.raises(StoreUnavailableError, match="went away in the middle") as caught:
                finish(session, heights(ROWS, COLUMNS, NEW))
            require_plain(caught.value)
        with pytest.raises(StoreUnavailableError, match="went away in the middle"):
            store.regions()
        # The next call opens a connection anew.
        assert seed_of(store.read_window("r", "elevation", WHOLE)) == OLD
        import_heights(store, "r", heights(ROWS, COLUMNS, NEW), f"seed {NEW}")
        assert seed_of(store.read_window("r", "elevation", WHOLE)) == NEW


def _end_backends(cluster: postgis.Cluster, database: str) -> None:
    with cluster.connect() as connection:
        connection.execute("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = %s", (database,))


def test_a_server_that_dies_in_an_import_loses_nothing(safe_cluster: postgis.Cluster, safe_database: str) -> None:
    with with_old(safe_cluster, safe_database) as store:
        assert store.add_readings("r", [reading(number) for number in range(7)]) == 7
        session = store.begin_import("r", "elevation", provenance(f"seed {NEW}"))
        new = heights(ROWS, COLUMNS, NEW)
        session.write_tile(0, 0, new[:256, :256])
        subscription = store.subscribe("r")
        safe_cluster.kill()
        with pytest.raises(StoreUnavailableError):
            finish(session, new)
        session.close()
        with pytest.raises(StoreUnavailableError):
            store.regions()
        with pytest.raises(StoreUnavailableError, match="does not answer"):
            store.regions()
        with pytest.raises(StoreUnavailableError):
            subscription.poll(0.1)
        safe_cluster.start()
        assert seed_of(store.read_window("r", "elevation", WHOLE)) == OLD
        assert len(store.readings("r")) == 7
        import_heights(store, "r", new, f"seed {NEW}")
        assert seed_of(store.read_window("r", "elevation", WHOLE)) == NEW
        assert [change.subject for change in subscription.poll(1)] == ["elevation"], "missed while the server was away"
        subscription.close()


def test_an_import_that_is_killed_at_any_moment_leaves_old_or_new_and_resumes(
    postgis_cluster: postgis.Cluster, postgis_database: str
) -> None:
    rounds = int(os.environ.get("SWATHE_KILLS", "12"))
    draws = np.random.default_rng(4711)
    rows, columns, tiles = 1300, 1500, 36
    outcomes: list[tuple[bool, int]] = []
    with opened(postgis_cluster, postgis_database) as store:
        store.create_region("r", frame(rows, columns))
        import_heights(store, "r", heights(rows, columns, OLD), f"seed {OLD}")
        whole = Window(0, 0, rows, columns)
        for number in range(rounds):
            seed = NEW if number % 2 == 0 else OLD
            words = [postgis_cluster.url(postgis_database), "r", str(rows), str(columns), str(seed)]
            child = subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name("store_worlds.py")), *words],
                stdout=subprocess.PIPE,
                text=True,
            )
            assert child.stdout is not None
            # By steps and not by the clock, so that a slow machine is killed everywhere too; every third at the switch.
            for _ in range(tiles + 1 if number % 3 == 0 else draws.integers(0, tiles + 1)):
                assert child.stdout.readline() in {"tile\n", "commit\n"}
            time.sleep(draws.uniform(0, 0.03))
            child.kill()
            child.wait()
            child.stdout.close()
            with open_store(postgis_cluster.url(postgis_database)) as again:
                found = seed_of(again.read_window("r", "elevation", whole))
                with again.begin_import("r", "elevation", provenance(f"seed {seed}")) as session:
                    kept = len(session.have())
                    if not session.is_current:
                        fill(session, heights(rows, columns, seed))
                        session.commit()
                assert seed_of(again.read_window("r", "elevation", whole)) == seed
            outcomes.append((found == seed, kept))
        with postgis_cluster.connect(postgis_database) as connection:
            rest = connection.execute("SELECT count(DISTINCT layer_id), count(*) FROM swathe.tiles").fetchone()
    assert rest == (1, tiles), "nothing of the killed is left"
    # The table of a long run stands in docs/store.md.
    record = os.environ.get("SWATHE_KILLS_TABLE")
    if record:
        Path(record).write_text("\n".join(f"{int(new)} {kept}" for new, kept in outcomes) + "\n", encoding="ascii")


# Many at once


def test_no_reader_ever_sees_a_mix(postgis_cluster: postgis.Cluster, postgis_database: str) -> None:
    failures: list[BaseException] = []

    def replace_again_and_again() -> None:
        try:
            with opened(postgis_cluster, postgis_database) as writer:
                for number in range(8):
                    seed = NEW if number % 2 == 0 else OLD
                    import_heights(writer, "r", heights(ROWS, COLUMNS, seed), f"turn {number}")
        except BaseException as error:  # noqa: BLE001 - handed to the test
            failures.append(error)

    with with_old(postgis_cluster, postgis_database) as reader:
        writing = threading.Thread(target=replace_again_and_again)
        writing.start()
        seen = []
        while writing.is_alive():
            seen.append(seed_of(reader.read_window("r", "elevation", WHOLE)))
        writing.join()
        assert failures == []
        assert seed_of(reader.read_window("r", "elevation", WHOLE)) == OLD
        assert [change.subject for change in reader.changes("r")][1:] == ["elevation"] * 9
    assert set(seen) <= {OLD, NEW}


WRITER = """
import sys
from store_worlds import reading
from swathe.store import open_store
url, author, count, batch = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
with open_store(url) as store:
    for first in range(0, count, batch):
        added = store.add_readings("r", [reading(n, author) for n in range(first, min(first + batch, count))])
        assert added == min(batch, count - first), added
"""


@pytest.mark.parametrize(("count", "batch"), [(40, 1), (600, 100)])
def test_eight_writers_at_once_lose_nothing(
    safe_cluster: postgis.Cluster, safe_database: str, count: int, batch: int
) -> None:
    writers = 8
    url = safe_cluster.url(safe_database)
    with open_store(url, create=True) as store:
        store.create_region("r", frame())
        subscription = store.subscribe("r")
        children = [
            subprocess.Popen(
                [sys.executable, "-c", WRITER, url, f"rover {number}", str(count), str(batch)],
                env={**os.environ, "PYTHONPATH": str(Path(__file__).parent)},
            )
            for number in range(writers)
        ]
        # Who follows while they write sees every revision once and in order: none becomes visible behind his back.
        seen: list[Change] = []
        while len(seen) < writers * count // batch and any(child.poll() is None for child in children):
            seen += subscription.poll(0.2)
        assert [child.wait() for child in children] == [0] * writers
        seen += subscription.poll(0.2)
        subscription.close()
        assert [change.revision for change in seen] == list(range(2, 2 + writers * count // batch))
        stored = store.readings("r")
    expected = {f"rover {writer}-{number}" for writer in range(writers) for number in range(count)}
    assert {one.id for one in stored} == expected
    assert len(stored) == writers * count
    told = {identity: change.revision for change in seen for identity in change.detail["ids"]}
    assert told == {one.id: one.revision for one in stored}
