"""The navigator from Python: what it commands, and that it stops when it should."""

from __future__ import annotations

import math

import numpy as np
import pytest

from swathe.drive import Command, DriveParams, Navigator, Region
from swathe.errors import UsageError
from swathe.grid import GridGeometry
from swathe.sensor import Pose, Scan
from swathe.vehicle import load_vehicle, vehicle_names

GRAVITY_MPS2 = 9.80665


def clear(ranges_m: object = None) -> Scan:
    ranges = np.full(181, np.inf) if ranges_m is None else ranges_m
    return Scan(ranges, -math.pi / 2, math.pi / 180, 0.1, 8.0)  # type: ignore[arg-type]


def test_free_ground_is_driven_to_the_goal() -> None:
    navigator = Navigator("jackal", (10.0, 0.0))
    x, time, speed = 0.0, 0.0, 0.0
    command = Command(0.0, 0.0, "driving")
    while time < 30 and command.status != "reached":
        command = navigator.step(time, Pose(x, 0.0, 0.0), speed, 0.0, clear())
        speed = command.speed_mps
        x, time = x + 0.1 * speed, time + 0.1
    assert command.status == "reached"
    assert x == pytest.approx(10.0, abs=0.6)


def test_a_blind_scan_moves_nothing() -> None:
    command = Navigator("jackal", (10.0, 0.0)).step(0.0, Pose(0, 0, 0), 0.0, 0.0, clear(np.full(181, np.nan)))
    assert (command.speed_mps, command.turn_rate_radps, command.status) == (0.0, 0.0, "fault")
    assert command.reason == "No beam of the scan says anything."


def test_a_region_of_no_go_ground_stops_the_robot() -> None:
    region = Region(np.ones((20, 20), dtype=np.uint8), GridGeometry(20, 20, 2.0, -20.0, 20.0))
    navigator = Navigator("jackal", (10.0, 0.0), region=region)
    assert navigator.step(0.0, Pose(0, 0, 0), 0.0, 0.0, clear()).status == "stopped"
    told = next(event for event in navigator.events if event.kind == "navigability")
    assert told.as_dict() == {
        "kind": "navigability",
        "time_s": 0.0,
        "grids": [False, False],
        "navigable": False,
        "disagreement": False,
    }


@pytest.mark.parametrize("name", vehicle_names())
def test_what_stands_a_stopping_distance_away_on_any_side_is_held_for_every_bundled_vehicle(name: str) -> None:
    vehicle = load_vehicle(name)
    speed = vehicle.max_speed_mps
    braking = min(vehicle.max_braking_mps2, GRAVITY_MPS2 * vehicle.braking_friction)
    stopping_m = speed * vehicle.reaction_time_s + speed**2 / (2 * braking)
    # The nearest place of the footprint's circle is what must not come there.
    range_m = stopping_m + vehicle.circumscribed_radius_m
    around = np.radians(np.arange(-180, 180))
    ring = Scan(np.full(360, range_m), -math.pi, math.radians(1), 0.1, range_m + 10)
    x_m, y_m = 3.07, -5.02
    navigator = Navigator(name, (1000.0, 0.0))
    for step in range(8):
        navigator.step(step / 10, Pose(x_m, y_m, 0.0), 0.0, 0.0, ring)
    certainty = navigator.certainty
    geometry = certainty.geometry
    rows = np.floor((geometry.north_m - (y_m + range_m * np.sin(around))) / geometry.cell_size_m).astype(int)
    columns = np.floor((x_m + range_m * np.cos(around) - geometry.west_m) / geometry.cell_size_m).astype(int)
    assert min(rows.min(), columns.min()) >= 0
    assert max(rows.max(), columns.max()) < geometry.rows
    assert (certainty.cells[rows, columns] >= 6).all()
    assert (certainty.cells[rows, columns] <= 15).all()


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(UsageError, match="arrival distance"):
        Navigator("jackal", (1.0, 1.0), params=DriveParams(arrival_m=-1.0))
    with pytest.raises(UsageError, match="goal's x"):
        Navigator("jackal", (math.nan, 1.0))
