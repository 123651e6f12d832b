"""Paths that a car can drive: curves against a library of their own, paths on drawn worlds, and what is refused."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st
from ompl import base

import commands
import raster_files
from swathe import _core
from swathe.drivable import (
    CurveArc,
    DrivableParams,
    DrivablePath,
    NotDrivable,
    Pose,
    drivable_path,
    dubins,
    reeds_shepp,
)
from swathe.errors import InterruptedBySignalError, UsageError
from swathe.grid import Position
from swathe.planner import plan
from swathe.vehicle import load_vehicle
from worlds import mask, region_of

if TYPE_CHECKING:
    from pathlib import Path

    from swathe.rank import Region

TRACTOR = load_vehicle("tractor")
RADIUS_M = TRACTOR.min_turn_radius_m

#: 2 m cells: a wall between start and goal that the tractor goes around.
WALL = ["." * 40] * 6 + ["." * 18 + "##" + "." * 20] * 20
START, GOAL = Position(1011.0, 8959.0), Position(1069.0, 8959.0)


def walled(vehicle: str = "tractor") -> Region:
    """Return level ground with the wall as a closed zone."""
    zones = mask(WALL)
    return region_of(np.full(zones.shape, 50, dtype=np.float32), 2.0, vehicle=vehicle, zones=zones)


def driven(start: Pose, arcs: list[CurveArc]) -> Pose:
    """Drive arcs by small chords, without the core's formulas."""
    x, y, heading = start
    for arc in arcs:
        steps = 2000
        for _ in range(steps):
            length = arc.length_m / steps
            middle = heading + arc.curvature_per_m * length / 2
            x, y = x + length * math.cos(middle), y + length * math.sin(middle)
            heading += arc.curvature_per_m * length
    return Pose(x, y, heading)


def length_by_ompl(space: Any, start: Pose, goal: Pose) -> float:
    """Return the distance of two poses in a state space of the Open Motion Planning Library."""
    states = []
    for pose in (start, goal):
        state = space.allocState()
        state.setX(pose.x_m)
        state.setY(pose.y_m)
        state.setYaw(pose.heading_rad)
        states.append(state)
    return float(space.distance(*states))


# Hundredths: within their tolerance libraries differ by a whole turn on what is the same pose.
coordinates = st.integers(-3000, 3000).map(lambda hundredths: hundredths / 100)
headings = st.integers(-314, 314).map(lambda hundredths: hundredths / 100)
poses = st.builds(Pose, coordinates, coordinates, headings)


@given(start=poses, goal=poses, radius_m=st.floats(0.5, 12))
def test_curves_are_as_short_as_those_of_another_library(start: Pose, goal: Pose, radius_m: float) -> None:
    for curve, space in ((dubins, base.DubinsStateSpace(radius_m)), (reeds_shepp, base.ReedsSheppStateSpace(radius_m))):
        arcs = curve(start, goal, radius_m)
        length_m = sum(abs(arc.length_m) for arc in arcs)
        # Equal, but where the length jumps with the pose: there rounding decides on which side it falls.
        assert length_m <= length_by_ompl(space, start, goal) + 1e-4 * radius_m
        end = driven(start, arcs)
        assert math.hypot(end.x_m - goal.x_m, end.y_m - goal.y_m) < 1e-3 * radius_m
        assert math.remainder(end.heading_rad - goal.heading_rad, 2 * math.pi) == pytest.approx(0, abs=1e-4)
        assert all(abs(arc.curvature_per_m) <= 1 / radius_m * (1 + 1e-12) for arc in arcs)


def audit(path: DrivablePath, radius_m: float) -> None:
    """Fit circles to the poses and see that they move where they point."""
    xy, heading = path.poses[:, :2], path.poses[:, 2]
    steps = np.diff(xy, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    moving = lengths > 1e-6
    nose = np.arctan2(steps[:, 1], steps[:, 0]) + np.where(path.reverse[:-1], np.pi, 0)
    turned = np.abs((nose - heading[:-1] + np.pi) % (2 * np.pi) - np.pi)
    assert (turned[moving] < 0.11).all()
    for i in range(1, len(xy) - 1):
        if path.reverse[i - 1] == path.reverse[i] == path.reverse[i + 1] and min(lengths[i - 1 : i + 1]) > 1e-6:
            a, b, c = xy[i - 1], xy[i], xy[i + 1]
            cross = abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
            curvature = 2 * cross / (lengths[i - 1] * lengths[i] * np.hypot(*(c - a)))
            assert curvature <= 1 / radius_m * (1 + 1e-3)
    assert (np.abs(path.curvature_per_m) <= 1 / radius_m * (1 + 1e-9)).all()
    assert path.cusps == np.count_nonzero(np.diff(path.reverse.astype(int)))


@pytest.mark.parametrize("ends", [(None, None), (0.0, 0.0), (math.pi, math.pi / 2), (None, -math.pi / 2)])
def test_a_plan_of_a_tractor_on_fine_cells_is_drivable(ends: tuple[float | None, float | None]) -> None:
    found = plan(walled(), START, GOAL, start_heading_rad=ends[0], goal_heading_rad=ends[1])
    path = found.drivable
    assert found.route is not None
    assert path is not None
    audit(path, RADIUS_M)
    assert tuple(path.poses[0, :2]) == START
    assert tuple(path.poses[-1, :2]) == GOAL
    for heading, pose in zip(ends, path.poses[[0, -1]], strict=True):
        assert heading is None or math.remainder(heading - pose[2], 2 * math.pi) == pytest.approx(0, abs=1e-6)
    assert path.radius_m == RADIUS_M
    # No path is quicker than the route that turns in place, but for what shortcuts leave.
    assert path.cost >= 0.97 * found.route.cost
    # The middle of the vehicle stays off the wall by the radius of its circle.
    aside = np.maximum(np.abs(path.poses[:, 0] - 1038) - 2, 0)
    above = np.maximum(path.poses[:, 1] - 8988, 0)
    assert (np.hypot(aside, above) >= TRACTOR.circumscribed_radius_m - 0.006 * RADIUS_M).all()
    again = plan(walled(), START, GOAL, start_heading_rad=ends[0], goal_heading_rad=ends[1]).drivable
    assert again is not None
    assert np.array_equal(path.poses, again.poses)


def test_who_turns_in_place_and_who_is_asked_not_to_keep_the_route() -> None:
    assert plan(walled("husky"), START, GOAL).drivable is None
    assert plan(walled(), START, GOAL, path="grid16").drivable is None
    coarse = region_of(np.full((20, 20), 50, dtype=np.float32), 10.0)
    assert plan(coarse, Position(1035, 8965), Position(1150, 8850)).drivable is None
    asked = plan(walled("husky"), START, GOAL, path="drivable")
    assert asked.drivable is not None
    assert asked.route is not None
    assert asked.drivable.radius_m == 0
    assert asked.drivable.cost == pytest.approx(asked.route.cost)
    assert np.allclose(asked.drivable.poses[-1, :2], GOAL)


def test_without_room_to_turn_the_refusal_says_so() -> None:
    lane = mask(["##############", *["." * 14] * 3, "##############"])
    region = region_of(np.full(lane.shape, 50, dtype=np.float32), 2.0, zones=lane)
    start, goal = Position(1005.0, 8995.0), Position(1023.0, 8995.0)
    found = plan(region, start, goal, start_heading_rad=math.pi / 2)
    assert found.status == "no_route"
    assert found.reason is not None
    assert "turning radius of 4.8 m" in found.reason
    assert found.route is None
    assert found.drivable is None
    direct = drivable_path(region, [start, goal], start_heading_rad=math.pi / 2)
    assert isinstance(direct, NotDrivable)
    assert not direct
    assert direct.remedy
    assert drivable_path(region, [start, goal])


def test_a_slope_is_driven_at_its_own_cost() -> None:
    column = np.arange(60) * 2.0
    heights = np.tile(0.1 * column, (40, 1)).astype(np.float32)
    region = region_of(heights, 2.0)
    ends = [(1020.0, 8960.0), (1090.0, 8960.0)]
    up, down = drivable_path(region, ends), drivable_path(region, ends[::-1])
    assert isinstance(up, DrivablePath)
    assert isinstance(down, DrivablePath)
    assert up.energy_j > 2 * down.energy_j
    assert [(arc.curvature_per_m, arc.reverse) for arc in up.arcs] == [(0.0, False)]
    assert up.length_m == pytest.approx(70 * math.hypot(1, 0.1), rel=1e-6)
    back = drivable_path(region, ends, start_heading_rad=math.pi, goal_heading_rad=math.pi)
    assert isinstance(back, DrivablePath)
    assert back.cost > up.cost


def test_defaults_are_those_of_the_core() -> None:
    assert asdict(DrivableParams()) == _core.drivable_defaults()


@pytest.mark.parametrize(
    "change",
    [
        {"points": [1.0, 2.0]},
        {"points": [(1.0, math.nan)]},
        {"start_heading_rad": math.inf},
        {"goal_heading_rad": math.nan},
        {"params": DrivableParams(reverse_factor=0.5)},
        {"params": DrivableParams(cusp_time_s=-1)},
        {"params": DrivableParams(weight=math.nan)},
        {"params": DrivableParams(most_states=0)},
    ],
)
def test_bad_input_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        drivable_path(walled(), **{"points": [START, GOAL], **change})


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan])
def test_curves_need_a_radius_and_poses(bad: float) -> None:
    for curve in (dubins, reeds_shepp):
        with pytest.raises(UsageError):
            curve(Pose(0, 0, 0), Pose(1, 0, 0), bad)
        with pytest.raises(UsageError):
            curve(Pose(0, 0, math.nan), Pose(1, 0, 0), 1.0)


def test_no_points_make_no_path_and_a_stop_is_honoured() -> None:
    empty = drivable_path(walled(), np.empty((0, 2)))
    assert isinstance(empty, DrivablePath)
    assert len(empty.arcs) == 0
    with pytest.raises(InterruptedBySignalError):
        drivable_path(walled(), [START, GOAL], on_progress=lambda *_: False)


def test_the_command_writes_the_arcs_and_tells_of_turns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fine = Affine(3, 0, raster_files.WEST, 0, -3, raster_files.NORTH)
    dem = raster_files.write(tmp_path / "fine.tif", raster_files.hills(80, 90) * np.float32(0.05), transform=fine)
    ends = (
        f"{raster_files.WEST + 40},{raster_files.NORTH - 40}",
        f"{raster_files.WEST + 220},{raster_files.NORTH - 190}",
    )
    words = (*commands.way(dem, "--vehicle", "tractor", "--json", from_to=ends), "--start-bearing", "0")
    finished = commands.run_here(capsys, *words, "--out", str(tmp_path / "a"))
    assert finished.code == 0
    told = finished.answer["drivable"]
    assert told["turning_radius_m"] == RADIUS_M
    assert any("turning radius of 4.8 m" in note for note in finished.answer["notes"])
    features = json.loads((tmp_path / "a" / "drivable.geojson").read_text())["features"]
    assert len(features) == told["arcs"]
    assert features[0]["properties"]["heading_deg"] == 0
    lines = [feature["geometry"]["coordinates"] for feature in features]
    # One line ends where the next begins.
    assert all(np.allclose(a[-1], b[0], atol=1e-7) for a, b in itertools.pairwise(lines))
    length_m = sum(feature["properties"]["length_m"] for feature in features)
    assert length_m == pytest.approx(told["length_m"], rel=1e-4)
    assert sum(f["properties"]["length_m"] for f in features if f["properties"]["direction"] == "reverse") == (
        pytest.approx(told["reverse_m"], abs=0.5)
    )
    plain = commands.run_here(capsys, *words, "--out", str(tmp_path / "b"), "--path", "grid16")
    assert plain.answer["drivable"] is None
    assert any("not checked" in note for note in plain.answer["notes"])
    assert not (tmp_path / "b" / "drivable.geojson").exists()
    wrong = commands.run_here(capsys, *words[:-1], "nan", "--out", str(tmp_path / "c"))
    assert wrong.code == 2
