"""The navigator from Python under whatever a driver may hand it: never no number, never beyond the vehicle's limits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swathe import rank
from swathe.drive import DriveParams, Navigator, Region
from swathe.grid import GridGeometry
from swathe.rank import RankParams
from swathe.sensor import PenetrometerReading, Pose, Scan
from swathe.soil import SoilClass
from swathe.vehicle import load_vehicle

STANDING = {"reached", "stopped", "no_route", "fault"}
ANY = st.floats()
FIGURE = st.one_of(st.floats(-4, 4), st.floats(-4, 4), st.floats(-4, 4), ANY, st.just(0.0))
RANGES = st.one_of(
    st.lists(st.one_of(st.floats(0, 9), ANY), max_size=40),
    st.builds(np.full, st.integers(0, 1100), st.sampled_from([0.0, 3.0, 8.0, math.inf, math.nan, -1.0])),
)
FAN = st.tuples(
    st.one_of(st.just(-math.pi / 2), ANY),
    st.one_of(st.just(math.pi / 180), st.just(0.0), ANY),
    st.one_of(st.just(0.1), ANY),
    st.one_of(st.just(8.0), ANY),
    st.tuples(FIGURE, FIGURE, FIGURE),
)
SCAN = st.builds(lambda ranges, fan: Scan(ranges, *fan), RANGES, FAN)
READING = st.builds(
    PenetrometerReading,
    ANY,
    ANY,
    st.lists(st.floats(), max_size=4).map(tuple),
    st.lists(st.floats(), max_size=4).map(tuple),
    st.one_of(st.none(), ANY),
)
#: time on, pose, speed and turn rate, scan, reading, a cone's range and width
STEP = st.tuples(
    st.one_of(st.floats(0, 0.3), ANY),
    st.tuples(FIGURE, FIGURE, FIGURE, FIGURE, FIGURE),
    st.tuples(FIGURE, FIGURE),
    st.one_of(st.none(), SCAN),
    st.one_of(st.none(), READING),
    st.one_of(st.none(), st.tuples(ANY, st.one_of(st.just(math.pi / 6), ANY))),
)


def clear() -> Scan:
    return Scan(np.full(181, np.inf), -math.pi / 2, math.pi / 180, 0.1, 8.0)


def learning(vehicle: str) -> Region:
    """Gravel with a patch of sand, a slope in the east, a hole of unknown height, around the origin."""
    soil = np.full((12, 12), int(SoilClass.GRAVEL), np.uint8)
    soil[5:8, 6:9] = int(SoilClass.SAND)
    heights = np.repeat(np.maximum(np.arange(12) - 7, 0)[None, :], 12, axis=0).astype(np.float32)
    heights[2, 2] = np.nan
    geometry = GridGeometry(12, 12, 2.0, -12.0, 12.0)
    ground = rank.Region(geometry, heights, load_vehicle(vehicle), soil, params=RankParams(moisture_percent=40.0))
    return Region.of(ground)


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(STEP, min_size=1, max_size=12),
    vehicle=st.sampled_from(["jackal", "tractor"]),
    has_map=st.booleans(),
    method=st.sampled_from(["vfh", "vfh+", "vfh*", "player"]),
)
def test_no_input_breaks_a_step_or_gets_a_command_beyond_the_limits(
    steps: list[Any], vehicle: str, method: Any, *, has_map: bool
) -> None:
    machine = load_vehicle(vehicle)
    region = learning(vehicle) if has_map else None
    params = DriveParams(method=method, probing="every 2 m")
    navigator = Navigator(machine, (2.0, 8.0), region=region, params=params)
    time_s = 0.0
    for on_s, pose, (speed_mps, turn_rate_radps), scan, reading, cone in steps:
        place = Pose(*pose)
        if cone is not None:
            heard = Scan([cone[0]], 0.0, 0.0, 0.1, 5.0)
            refused = navigator.sense(time_s, place, heard, cone_rad=cone[1])
            assert refused is None or refused.endswith(".")
        command = navigator.step(time_s + on_s, place, speed_mps, turn_rate_radps, scan, reading)
        # What is no number fails every comparison.
        assert abs(command.speed_mps) <= machine.max_speed_mps
        assert abs(command.turn_rate_radps) <= machine.max_turn_rate_radps
        if machine.min_turn_radius_m > 0:
            assert abs(command.turn_rate_radps) <= abs(command.speed_mps) / machine.min_turn_radius_m + 1e-9
        if command.status in STANDING:
            assert command.speed_mps == 0.0
        assert command.reason
        time_s += on_s if math.isfinite(on_s) and abs(on_s) < 1e6 else 0.1
    # Whatever came, what is usable is driven with again: a clock and a pose that jump cost a step.
    for later in range(3):
        command = navigator.step(1e9 + 0.1 * later, Pose(0, 0, 0), 0.0, 0.0, clear())
    assert command.status != "fault"


@pytest.mark.parametrize(
    "reading",
    [
        PenetrometerReading(1.0, 0.0, (0.05, 0.1), (math.nan, 300.0)),
        PenetrometerReading(1.0, 0.0, (0.05, 0.1), (-300.0, 300.0)),
        PenetrometerReading(1.0, 0.0, (0.05, 0.1), (1e9, 1e9)),
        PenetrometerReading(1.0, 0.0, (0.05, 0.1), (300.0,)),
        PenetrometerReading(1.0, 0.0, (0.1, 0.05), (300.0, 300.0)),
        PenetrometerReading(1.0, 0.0, (0.05, 99.0), (300.0, 300.0)),
        PenetrometerReading(1.0, 0.0, (), ()),
        PenetrometerReading(1.0, 0.0, (), (), -1.0),
        PenetrometerReading(math.inf, 0.0, (0.05, 0.1), (300.0, 300.0)),
        PenetrometerReading(1e12, 0.0, (0.05, 0.1), (300.0, 300.0)),
    ],
)
def test_a_reading_that_no_instrument_gives_is_refused_aloud_and_teaches_nothing(reading: PenetrometerReading) -> None:
    navigator = Navigator("jackal", (2.0, 8.0), region=learning("jackal"))
    navigator.step(0.0, Pose(0, 0, 0), 0.0, 0.0, clear())
    before = navigator.ranks
    command = navigator.step(0.1, Pose(0, 0, 0), 0.0, 0.0, clear(), reading)
    assert "reading_refused" in {event.kind for event in navigator.events}
    assert command.status == "driving"
    assert np.array_equal(before, navigator.ranks)  # type: ignore[arg-type]
