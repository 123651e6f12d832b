"""Fixtures and rules that all tests share."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import hypothesis
import pytest

import postgis
import requirement

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

# The same examples on every run, and no verdict by the clock: a slow machine is not a broken program.
hypothesis.settings.register_profile("swathe", derandomize=True, deadline=None)
hypothesis.settings.load_profile("swathe")

MARKER_OF_FIXTURE = {
    "chromium": "browser",
    "gdaldem": "gdal",
    "grass": "grass",
    "postgis_cluster": "postgis",
    "swathe_data": "data",
}


def pytest_configure() -> None:
    try:
        requirement.required_names(os.environ.get("SWATHE_REQUIRE", ""))
    except ValueError as error:
        raise pytest.UsageError(str(error)) from error


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark each test by what it needs, so that `-m "not browser"` works without anyone writing marks."""
    for item in items:
        for fixture in getattr(item, "fixturenames", ()):
            if fixture in MARKER_OF_FIXTURE:
                item.add_marker(MARKER_OF_FIXTURE[fixture])


@pytest.fixture(scope="session")
def swathe_data() -> Path:
    """The folder of real terrain that SWATHE_DATA names."""
    return requirement.data_folder()


@pytest.fixture(scope="session")
def gdaldem() -> Path:
    """GDAL's own slope and aspect program, an outside truth."""
    return requirement.program("gdal", ("gdaldem",), "gdal-bin")


@pytest.fixture(scope="session")
def chromium() -> Path:
    """A real browser."""
    return requirement.program("browser", ("chromium", "chromium-browser"), "chromium")


@pytest.fixture(scope="session")
def grass() -> Path:
    """GRASS, whose locations are read and written."""
    return requirement.program("grass", ("grass",), "grass-core")


@pytest.fixture(scope="session")
def postgis_cluster() -> Iterator[postgis.Cluster]:
    """A PostgreSQL server with PostGIS that nobody else uses."""
    with postgis.running_cluster() as cluster:
        yield cluster


@pytest.fixture
def postgis_database(postgis_cluster: postgis.Cluster) -> Iterator[str]:
    """The name of an empty database with PostGIS in ``postgis_cluster``."""
    name = postgis_cluster.new_database()
    yield name
    postgis_cluster.drop(name)
