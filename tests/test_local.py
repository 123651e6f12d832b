"""The local methods from Python: where they steer, and what they refuse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from swathe.errors import InvalidParameterError, ShapeMismatchError, UsageError
from swathe.local import Body, PlayerVfh, VfhPlus
from swathe.sensor import Scan

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
