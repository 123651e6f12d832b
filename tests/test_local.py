"""The local methods from Python: where they steer, and what they refuse."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from swathe.errors import InvalidParameterError, ShapeMismatchError, UsageError
from swathe.local import Body, PlayerParams, PlayerVfh, VfhPlus
from swathe.sensor import Pose, Scan

BODY = Body(0.4)


def wall_ahead() -> np.ndarray:
    """Return a window whose wall stands a metre east of the robot, two metres long."""
    window = np.zeros((61, 61), dtype=np.uint8)
    window[20:41, 40] = 15
    return window


def test_free_space_leads_to_the_target_and_a_wall_past_its_nearer_end() -> None:
    assert VfhPlus().steer(np.zeros((61, 61)), 0.0, 0.3, BODY).direction_rad == pytest.approx(0.3)
    left = VfhPlus().steer(wall_ahead(), 0.0, 0.3, BODY).direction_rad
    right = VfhPlus().steer(wall_ahead(), 0.0, -0.3, BODY).direction_rad
    assert left is not None
    assert right is not None
    assert left > 1.0 > -1.0 > right


def test_many_windows_are_steered_through_one_after_the_other() -> None:
    windows = np.stack([np.zeros((61, 61)), wall_ahead(), np.full((61, 61), 15)])
    told = VfhPlus().steer_all(windows, 0.0, 0.3, BODY)
    one = VfhPlus()
    for row, window in zip(told, windows, strict=True):
        direction = one.steer(window, 0.0, 0.3, BODY).direction_rad
        assert (math.isnan(row[0]) and direction is None) or row[0] == direction
    density, blocked, masked = one.histogram()
    assert density.shape == blocked.shape == masked.shape == (72,)
    assert masked.all()


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ShapeMismatchError, match="61 by 61"):
        VfhPlus().steer(np.zeros((33, 33)), 0.0, 0.0, BODY)
    with pytest.raises(InvalidParameterError, match="certainty of 16"):
        VfhPlus().steer(np.full((61, 61), 16), 0.0, 0.0, BODY)
    with pytest.raises(InvalidParameterError, match="side of the window"):
        VfhPlus(window_cells=60)
    with pytest.raises(InvalidParameterError, match="figure of the robot"):
        VfhPlus().steer(np.zeros((61, 61)), math.nan, 0.0, BODY)
    with pytest.raises(InvalidParameterError, match="radius"):
        PlayerVfh(robot_radius_m=-1.0)
    with pytest.raises(UsageError, match="all beams"):
        PlayerVfh().update(Scan(np.ones(1000), 0.0, 0.1, 0.1, 8.0), 0.0, 0.0, 0.1)


def test_players_method_drives_at_the_goal_and_spins_when_something_is_close() -> None:
    free = Scan(np.full(181, np.inf), -math.pi / 2, math.radians(1), 0.0, 8.0)
    speed, turn, direction = PlayerVfh().update(free, 0.1, 0.2, 0.1)
    assert speed > 0
    assert direction == pytest.approx(0.2)
    assert turn > 0
    close = Scan(np.full(181, 0.2), -math.pi / 2, math.radians(1), 0.0, 8.0)
    speed, turn, _ = PlayerVfh().update(close, 0.1, 0.0, 0.1)
    assert speed == 0.0
    assert turn == pytest.approx(math.radians(40))


FREE = Scan(np.full(181, math.inf), -math.pi / 2, math.pi / 180, 0.0, 8.0)
CLOSED = Scan(np.full(181, 0.2), -math.pi / 2, math.pi / 180, 0.0, 8.0)


def test_players_driver_goes_to_a_place_and_turns_into_the_heading() -> None:
    vfh = PlayerVfh(PlayerParams(max_speed=0.5, distance_epsilon=0.2, angle_epsilon=5.0, min_turnrate=20.0))
    pose, goal, speed = Pose(0.0, 0.0, 0.0), Pose(2.0, 1.0, 3.0), 0.0
    told = []
    for _ in range(600):
        speed, turn, state = vfh.drive(FREE, pose, speed, goal, 0.1)
        told.append(state)
        if state == "turning":
            assert speed == 0.0
            assert math.radians(20.0) <= abs(turn) <= math.radians(40.0)
        if state == "there":
            break
        heading_rad = pose.heading_rad + turn * 0.1
        east_m, north_m = speed * 0.1 * math.cos(heading_rad), speed * 0.1 * math.sin(heading_rad)
        pose = Pose(pose.x_m + east_m, pose.y_m + north_m, heading_rad)
    assert list(dict.fromkeys(told)) == ["driving", "turning", "there"]
    assert math.hypot(pose.x_m - 2.0, pose.y_m - 1.0) <= 0.2
    assert abs(math.remainder(pose.heading_rad - 3.0, math.tau)) <= math.radians(5.0)


def test_players_driver_escapes_only_when_it_is_told_how() -> None:
    pose, goal = Pose(0.0, 0.0, 0.0), Pose(5.0, 0.0, 0.0)
    assert PlayerVfh().drive(CLOSED, pose, 0.0, goal, 0.1)[2] == "driving"
    params = PlayerParams(escape_speed=-0.1, escape_time=2.0, escape_max_turnrate=30.0)
    turns = []
    for seed in range(20):
        speed, turn, state = PlayerVfh(params, seed=seed).drive(CLOSED, pose, 0.0, goal, 0.1)
        assert (speed, state) == (-0.1, "escaping")
        turns.append(turn)
    assert max(map(abs, turns)) <= math.radians(30.0)
    assert min(turns) < 0 < max(turns)


@pytest.mark.parametrize(
    ("name", "slow", "fast"),
    [
        ("safety_dist", 0.1, 0.6),
        ("max_turnrate", 40.0, 80.0),
        ("free_space_cutoff", 2e6, 1e3),
        ("obs_cutoff", 2e6, 1e3),
    ],
)
def test_players_parameters_change_with_the_speed(name: str, slow: float, fast: float) -> None:
    there = Scan(np.where(np.abs(np.arange(181) - 90) < 8, 1.2, 7.9), -math.pi / 2, math.pi / 180, 0.0, 8.0)

    def told(params: PlayerParams, speed_mps: float) -> list[float]:
        vfh = PlayerVfh(params)
        return [*vfh.update(there, speed_mps, 0.9, 0.1), float(vfh.histogram().sum())]

    def params(**given: Any) -> PlayerParams:
        return replace(PlayerParams(obs_cutoff_0ms=2e6), **given)

    changing = params(**{f"{name}_0ms": slow, f"{name}_1ms": fast})
    same, other = params(**{f"{name}_0ms": slow}), params(**{f"{name}_0ms": fast})
    assert told(changing, 0.0) == told(same, 0.0)
    assert told(changing, 1.0) == told(other, 1.0)
    if name in {"safety_dist", "max_turnrate"}:
        assert told(same, 1.0) != told(other, 1.0)


@pytest.mark.parametrize(
    ("name", "given"),
    [("cell_size", 0.0), ("window_diameter", 1), ("sector_angle", 0.0), ("max_speed", math.nan), ("escape_time", -1.0)],
)
def test_players_parameters_outside_their_range_are_refused(name: str, given: Any) -> None:
    with pytest.raises(InvalidParameterError, match=name):
        replace(PlayerParams(), **{name: given})


def test_players_driver_refuses_what_is_no_pose() -> None:
    with pytest.raises(InvalidParameterError, match="finite"):
        PlayerVfh().drive(FREE, Pose(math.nan, 0.0, 0.0), 0.0, Pose(1.0, 0.0, 0.0), 0.1)
