"""Vehicles that share what they measure: the next one avoids it, and one under way turns aside."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import shapely

from swathe import driving, mission
from swathe.config import Settings, TerrainRequest
from swathe.errors import UsageError
from swathe.export.folder import RUN_LOG
from swathe.rank import RankParams
from swathe.runlog import RunLog
from swathe.scenario import Scenario, scenario_of
from swathe.soil import SoilClass
from swathe.store import Provenance, SoilPolygon, open_store
from swathe.store.imports import import_elevation

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    import postgis
    from swathe.recording import Live

REGION = "heath"
FIELD_M = 40.0
#: The field that is soft in truth, whatever its map says: 200 to 240 m east, 40 to 80 m north.
SOFT = (220.0, 60.0)


@pytest.fixture(params=["files", pytest.param("postgis", marks=pytest.mark.postgis)])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A store with the heath in fields of 40 m, all of sand on the map."""
    if request.param == "files":
        address = str(tmp_path / "project")
    else:
        cluster: postgis.Cluster = request.getfixturevalue("postgis_cluster")
        address = cluster.url(request.getfixturevalue("postgis_database"))
    with open_store(address, create=True) as store:
        import_elevation(store, REGION, ["bundled:heath"])
        fields = [
            SoilPolygon(
                shapely.to_wkb(shapely.box(x, y, x + FIELD_M, y + FIELD_M)), f"field {x:g} {y:g}", SoilClass.SAND
            )
            for x in np.arange(0, 320, FIELD_M)
            for y in np.arange(0, 320, FIELD_M)
        ]
        legend = [[field.value, field.value, "sand", True] for field in fields]
        details = {"source": "fields", "field": "name", "legend": legend}
        store.write_soil_polygons(REGION, [fields], Provenance((("fields", "f" * 64),)), details=details)
    return address


def scenario(url: str, vehicle: str, **probing: Any) -> Scenario:
    return scenario_of(
        {
            "vehicle": vehicle,
            "terrain": {"store": url, "region": REGION, "points_crs": "native"},
            "plan": {"moisture": "40"},
            "drive": {"start": (170, 60), "goal": (285, 60)},
            "probing": probing,
            "truth": {"patches": [{"soil": "clay", "x_m": SOFT[0], "y_m": SOFT[1], "radius_m": 14}]},
        },
        "it",
    )


def nearest_m(folder: Path) -> float:
    truth = RunLog.read(folder / RUN_LOG).truth
    away: NDArray[np.float64] = np.hypot(truth.x_m - SOFT[0], truth.y_m - SOFT[1])
    return float(away.min())


def test_the_second_vehicle_avoids_what_the_first_has_measured(url: str, tmp_path: Path) -> None:
    blind = driving.drive(scenario(url, "tractor"), tmp_path / "blind", animate=False)
    assert blind["no_go_entries"] > 0
    assert nearest_m(tmp_path / "blind") < 15
    # A light vehicle crosses where the tractor would sink in, and measures.
    scout = driving.drive(
        scenario(url, "husky", policy="every", every_m=8), tmp_path / "scout", share_as="scout", animate=False
    )
    assert scout["probes"] >= 8
    with open_store(url) as store:
        readings = store.readings(REGION)
        assert {stored.author for stored in readings} == {"scout"}
        assert len(readings) == scout["probes"]
        assert [run.author for run in store.runs(REGION)] == ["scout"]
    second = driving.drive(scenario(url, "tractor"), tmp_path / "second", animate=False)
    assert (second["status"], second["no_go_entries"]) == ("reached", 0)
    assert nearest_m(tmp_path / "second") > 14
    request = TerrainRequest(store=url, region=REGION, points_crs="native")
    settings = Settings("tractor", RankParams(moisture_percent=40))
    planned = mission.plan_route(request, (170, 60), (285, 60), settings, tmp_path / "plan")
    assert planned["length_m"] > 120
    assert any("readings of the store" in note for note in planned["notes"])
    # All of this is as it was when the log is verified, though readings have come in since.
    assert driving.replay(tmp_path / "blind", again=True)["status"] == "equal"
    assert driving.replay(tmp_path / "second", again=True)["status"] == "equal"


def test_a_drive_under_way_turns_aside_for_what_another_measures(url: str, tmp_path: Path) -> None:
    scout = driving.drive(
        scenario(url, "husky", policy="every", every_m=8), tmp_path / "scout", share_as="scout", animate=False
    )
    with open_store(url) as store:
        filed = store.readings(REGION)
        assert len(filed) == scout["probes"]
        store.withdraw(REGION, "kept back for the test", author="scout")

        def scout_reports(live: Live) -> None:
            if live.time_s == 1.0:
                again = [type(stored)(stored.id + "-again", stored.reading, "scout", stored.time) for stored in filed]
                store.add_readings(REGION, again)

        told = driving.drive(scenario(url, "tractor"), tmp_path / "tractor", animate=False, on_second=scout_reports)
    assert (told["status"], told["no_go_entries"]) == ("reached", 0)
    assert nearest_m(tmp_path / "tractor") > 14
    log = RunLog.read(tmp_path / "tractor" / RUN_LOG)
    heard = [event.time_s for event in log.events if event.kind == "reading_heard"]
    assert len(heard) == len(filed)
    assert all(1.0 <= time_s <= 3.0 for time_s in heard)
    assert driving.replay(tmp_path / "tractor", again=True)["status"] == "equal"


def test_sharing_needs_a_store(tmp_path: Path) -> None:
    drawn = scenario_of({"world": {"kind": "clutter"}}, "it")
    with pytest.raises(UsageError, match="store"):
        driving.drive(drawn, tmp_path / "out", share_as="me")
