"""A region that learns, from Python: readings and news change ranks, nests and route, and the events tell it."""

from __future__ import annotations

import json
import math
from typing import Literal

import numpy as np
import pytest

from swathe import rank
from swathe.belief import BeliefParams, Unit
from swathe.drive import Command, DriveParams, Event, Histogram, Navigator, Region, SoilUpdate
from swathe.errors import InvalidParameterError, OutsideGridError, UsageError
from swathe.grid import GridGeometry, Position
from swathe.nest import NestParams, exact_nests
from swathe.rank import RankParams
from swathe.sensor import PenetrometerReading, Pose, Scan
from swathe.soil import SoilClass
from swathe.vehicle import Vehicle, load_vehicle

CELL_M = 4.0
GRAVEL, SAND = int(SoilClass.GRAVEL), int(SoilClass.SAND)


def vehicle() -> Vehicle:
    return load_vehicle("jackal")


def ground(*, moisture: float = 40.0) -> rank.Region:
    """Gravel with a patch of sand in the middle; level, 4 m cells, y = 0 in the middle."""
    soil = np.full((13, 16), GRAVEL, dtype=np.uint8)
    soil[4:9, 4:12] = SAND
    geometry = GridGeometry(13, 16, CELL_M, 0.0, 26.0)
    params = RankParams(moisture_percent=moisture)
    return rank.Region(geometry, np.zeros((13, 16), dtype=np.float32), vehicle(), soil, params=params)


def clear() -> Scan:
    return Scan(np.full(181, np.inf), -math.pi / 2, math.pi / 180, 0.1, 8.0)


def push(x: float, y: float, kpa: float) -> PenetrometerReading:
    return PenetrometerReading(x, y, (0.05, 0.10, 0.15), (0.9 * kpa, kpa, 1.1 * kpa))


def kinds(events: list[Event]) -> set[str]:
    return {event.kind for event in events}


def waits(navigator: Navigator) -> bool:
    return navigator.wants_probe


def histogram(navigator: Navigator) -> Histogram | None:
    return navigator.histogram


def stand(
    navigator: Navigator, time_s: float, at: tuple[float, float], reading: PenetrometerReading | None = None
) -> Command:
    return navigator.step(time_s, Pose(at[0], at[1], 0.0), 0.0, 0.0, clear(), reading)


def test_without_news_the_drive_knows_what_the_plan_knows() -> None:
    region = ground()
    navigator = Navigator(vehicle(), (60.0, 0.0), region=Region.of(region))
    stand(navigator, 0.0, (6.0, 0.0))
    assert navigator.ranks is not None
    assert np.array_equal(navigator.ranks, rank.rank_map(region).rank)
    assert np.array_equal(navigator.soil, region.soil)  # type: ignore[arg-type]
    route = navigator.global_route
    assert route.standing == "in_nests"
    assert route.points[0] == (6.0, 0.0)
    assert route.points[-1] == (60.0, 0.0)
    assert route.cost_s == pytest.approx(54.0 / vehicle().max_speed_mps, rel=0.2)


def test_a_reading_changes_ranks_nests_and_route_and_the_events_tell_it() -> None:
    navigator = Navigator(vehicle(), (60.0, 0.0), region=Region.of(ground(), grids="exact16"))
    stand(navigator, 0.0, (6.0, 0.0))
    before = navigator.global_route
    told: list[Event] = []
    for step, x in enumerate((24.0, 32.0, 40.0), 1):
        stand(navigator, 0.1 * step, (6.0, 0.0), push(x, 0.0, 4.0))
        told += navigator.events
    assert {"reading_taken", "nests_changed", "route_repaired"} <= kinds(told)
    assert navigator.ranks is not None
    assert navigator.ranks[6, 8] == 1
    after = navigator.global_route
    assert before.cost_s is not None
    assert after.cost_s is not None
    assert after.cost_s > before.cost_s
    assert max(abs(y) for _, y in after.points) > 8.0
    reading = next(event for event in told if event.kind == "reading_taken")
    plain = json.loads(json.dumps(reading.as_dict()))
    assert plain["kind"] == "reading_taken"
    assert sum(plain["probabilities"].values()) == pytest.approx(1.0)
    assert set(plain["probabilities"]) == {"gravel", "sand", "clay", "silt", "rock", "none"}
    soil = navigator.soil_at((32.0, 0.0))
    assert soil is not None
    assert soil.no_go_probability > 0.05
    assert navigator.soil_at((-5.0, 0.0)) is None


def test_every_event_is_ready_for_json() -> None:
    navigator = Navigator("jackal", (60.0, 0.0), region=Region.of(ground()))
    for step in range(40):
        speed = 0.0 if step == 0 else 1.0
        pose = Pose(6.0 + 0.1 * step, 0.0, 0.0)
        ranges = np.full(181, np.inf if step % 7 else np.nan)
        scan = Scan(ranges, -math.pi / 2, math.pi / 180, 0.1, 8.0)
        reading = push(6.0, 0.0, math.nan) if step == 5 else None
        navigator.step(0.1 * step, pose, speed, 0.0, scan, reading)
        for event in navigator.events:
            assert json.loads(json.dumps(event.as_dict()))["time_s"] == pytest.approx(0.1 * step)


def test_news_of_the_soil_hold_at_once_and_later_ones_count() -> None:
    navigator = Navigator(vehicle(), (60.0, 0.0), region=Region.of(ground()))
    stand(navigator, 0.0, (6.0, 0.0))
    flood = SoilUpdate(10.0, disc=(32.0, 0.0, 9.0), soil_class=SoilClass.NONE, source="gauge")
    changed = navigator.learn_soil(flood)
    assert changed > 10
    assert navigator.ranks is not None
    assert (navigator.ranks == 1).sum() == changed
    stand(navigator, 0.1, (6.0, 0.0))
    told = next(event for event in navigator.events if event.kind == "soil_update")
    assert told.fields == {"source": "gauge", "told_s": 10.0, "soil_class": "none", "cells_changed": changed}
    # Older news of the same ground change nothing, newer ones do.
    older = SoilUpdate(5.0, disc=(32.0, 0.0, 9.0), soil_class=SoilClass.SAND)
    assert navigator.learn_soil(older) == 0
    newer = SoilUpdate(20.0, disc=(32.0, 0.0, 9.0), soil_class=SoilClass.SAND)
    assert navigator.learn_soil(newer) == changed


def test_the_papers_rule_replaces_the_polygon() -> None:
    region = Region.of(ground(moisture=20.0), belief=BeliefParams(rule="paper_relabel"))
    navigator = Navigator(vehicle(), (60.0, 0.0), region=region)
    stand(navigator, 0.0, (6.0, 0.0), push(32.0, 0.0, 400.0))
    assert navigator.soil is not None
    inside = np.zeros((13, 16), dtype=bool)
    inside[4:9, 4:12] = True
    told = next(event for event in navigator.events if event.kind == "reading_taken")
    observed = SoilClass[told.fields["soil_class"].upper()]
    assert observed != SoilClass.SAND
    assert (navigator.soil[inside] == int(observed)).all()
    assert (navigator.soil[~inside] == GRAVEL).all()


def test_own_polygons_and_nests_may_be_given() -> None:
    layer = np.ones((13, 16), dtype=np.uint32)
    units = {1: Unit(SoilClass.GRAVEL, "g")}
    nest = NestParams(vicinity="disk:2")
    navigator = Navigator(
        vehicle(), (60.0, 0.0), region=Region.of(ground(), layer=layer, units=units, nest=nest, grids="single")
    )
    stand(navigator, 0.0, (6.0, 0.0))
    told = next(event for event in navigator.events if event.kind == "navigability")
    assert len(told.fields["grids"]) == 1
    assert navigator.learn_soil(SoilUpdate(1.0, polygon=1, soil_class=SoilClass.NONE)) == 13 * 16
    assert navigator.global_route.standing == "cut_off"
    assert exact_nests(navigator.ranks, rank_min=6).count == 0  # type: ignore[arg-type]
    assert stand(navigator, 0.2, (6.0, 0.0)).status == "stopped"
    with pytest.raises(InvalidParameterError, match="belong together"):
        Region.of(ground(), layer=layer)


def test_probing_is_asked_for_and_ends_with_the_reading() -> None:
    params = DriveParams(probing="every 2 m", probe_wait_s=5.0)
    navigator = Navigator(vehicle(), (60.0, 0.0), region=Region.of(ground()), params=params)
    stand(navigator, 0.0, (6.0, 0.0))
    assert not waits(navigator)
    navigator.step(1.0, Pose(7.1, 0.0, 0.0), 1.1, 0.0, clear())
    command = navigator.step(2.0, Pose(8.2, 0.0, 0.0), 1.1, 0.0, clear())
    assert command.speed_mps < 1.1
    assert command.reason == "The robot stands for a penetrometer reading."
    assert stand(navigator, 3.0, (8.3, 0.0)).status == "driving"
    assert waits(navigator)
    assert "probe_wanted" in kinds(navigator.events)
    stand(navigator, 4.0, (8.3, 0.0), push(8.3, 0.0, 5000.0))
    assert not waits(navigator)
    with pytest.raises(InvalidParameterError, match="probing policy"):
        Navigator(vehicle(), (60.0, 0.0), params=DriveParams(probing="sometimes"))


def test_what_cannot_be_used_is_refused_and_changes_nothing() -> None:
    navigator = Navigator(vehicle(), (60.0, 0.0), region=Region.of(ground()))
    stand(navigator, 0.0, (6.0, 0.0))
    for update in (
        SoilUpdate(0.0, polygon=99, soil_class=SoilClass.SAND),
        SoilUpdate(0.0, disc=(0.0, 0.0, -1.0), soil_class=SoilClass.SAND),
        SoilUpdate(math.nan, polygon=1, soil_class=SoilClass.SAND),
        SoilUpdate(0.0, polygon=1, soil_class=SoilClass.UNKNOWN),
        SoilUpdate(0.0, polygon=1, probabilities={SoilClass.SAND: 0.2}),
        SoilUpdate(0.0, soil_class=SoilClass.SAND),
    ):
        with pytest.raises(UsageError):
            navigator.learn_soil(update)
    with pytest.raises(OutsideGridError):
        navigator.learn_soil(SoilUpdate(0.0, cells=[(0, 99)], soil_class=SoilClass.SAND))
    assert np.array_equal(navigator.ranks, rank.rank_map(ground()).rank)  # type: ignore[arg-type]
    fixed = Navigator(vehicle(), (5.0, 0.0))
    with pytest.raises(InvalidParameterError, match="cannot learn"):
        fixed.learn_soil(SoilUpdate(0.0, polygon=1, soil_class=SoilClass.SAND))
    assert fixed.ranks is None
    assert fixed.soil_at((0.0, 0.0)) is None


def test_what_is_seen_can_be_looked_at() -> None:
    navigator = Navigator(vehicle(), (60.0, 0.0), region=Region.of(ground()))
    assert histogram(navigator) is None
    ranges = np.full(181, np.inf)
    ranges[80:100] = 2.0
    scan = Scan(ranges, -math.pi / 2, math.pi / 180, 0.1, 8.0)
    for step in range(4):
        navigator.step(0.1 * step, Pose(6.0, 0.0, 0.0), 0.0, 0.0, scan)
    seen = navigator.certainty
    cell = seen.geometry.cell_at(Position(8.0, 0.0))
    assert cell is not None
    row, column = cell
    around = seen.cells[row - 2 : row + 3, column - 2 : column + 3]
    assert around[around < 255].max() in range(6, 16)
    assert (around == 255).any()
    assert seen.cells.shape == seen.geometry.shape
    shown = histogram(navigator)
    assert shown is not None
    assert len(shown.densities) == len(shown.blocked) == len(shown.masked) == 72
    assert all(masked for masked, blocked in zip(shown.masked, shown.blocked, strict=True) if blocked)
    assert shown.blocked[0]
    assert 0 < shown.thresholds[0] < shown.thresholds[1]
    assert shown.direction_rad is None or abs(shown.direction_rad) > 0.1
    navigator.set_goal((6.0, 20.0))
    assert navigator.global_route.points[-1] == (6.0, 20.0)
    with pytest.raises(UsageError):
        navigator.set_goal((math.nan, 0.0))


@pytest.mark.parametrize("name", ["vfh", "vfh+", "vfh*", "player"])
def test_what_a_turning_circle_masks_can_be_looked_at(name: Literal["vfh", "vfh+", "vfh*", "player"]) -> None:
    # A pick-up beside a wall on its left: behind the wall's near end nothing is dense, but it cannot be turned to.
    bearing_rad = np.linspace(-math.pi / 2, math.pi / 2, 181)
    ranges = np.where((bearing_rad > 0.6) & (bearing_rad < 1.5), 3.0 / np.sin(np.abs(bearing_rad) + 1e-9), np.inf)
    scan = Scan(ranges, -math.pi / 2, math.pi / 180, 0.1, 20.0)
    navigator = Navigator(load_vehicle("pickup-4x4"), (60.0, 0.0), params=DriveParams(method=name))
    for step in range(10):
        navigator.step(0.1 * step, Pose(6.0, 0.0, 0.0), 0.0, 0.0, scan)
    shown = histogram(navigator)
    assert shown is not None
    masked, blocked = np.array(shown.masked), np.array(shown.blocked)
    assert masked.any()
    assert (masked >= blocked).all()
    assert (masked & ~blocked).any() == (name != "vfh")
