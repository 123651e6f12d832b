"""The navigator: from what a robot senses to what it should do, one step at a time."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from swathe import _core
from swathe.errors import ShapeMismatchError
from swathe.vehicle import Vehicle, load_vehicle

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import ArrayLike

    from swathe.grid import GridGeometry
    from swathe.sensor import PenetrometerReading, Pose, Scan

Status = Literal["driving", "recovering", "reached", "stopped", "no_route", "fault"]


@dataclass(frozen=True, slots=True)
class Command:
    """What the robot is told to do until the next step, within the vehicle's limits.

    Attributes:
        speed_mps: forward speed, negative when backing.
        turn_rate_radps: counter-clockwise.
        status: how the drive stands.
        reason: why, in a sentence.
    """

    speed_mps: float
    turn_rate_radps: float
    status: Status
    reason: str = ""


@dataclass(frozen=True, slots=True)
class DriveParams:
    """How a navigator drives; None takes the vehicle's figure.

    Attributes:
        method: local method.
        outside_nests: ground outside the nests costs more, or is blocked as in the paper.
        arrival_m: distance to the goal that counts as arrival.
        margin_m: distance kept from obstacles at rest.
        stale_s: age at which a scan no longer counts.
        sensor_height_m: height of the range sensor.
        memory: whether a route is laid on what was seen.
        recover: whether the robot gets out of traps.
    """

    method: Literal["vfh", "vfh+", "vfh*", "player"] = "vfh+"
    outside_nests: Literal["cost", "block"] = "cost"
    arrival_m: float = 0.5
    max_turn_rate_radps: float | None = None
    acceleration_mps2: float | None = None
    braking_mps2: float | None = None
    margin_m: float = 0.1
    stale_s: float = 0.5
    sensor_height_m: float = 0.3
    memory: bool = True
    recover: bool = True


@dataclass(frozen=True, slots=True)
class Region:
    """What a map knows: ranks of terrain cells (0 to 10), their geometry, and points of a global route."""

    ranks: ArrayLike
    geometry: GridGeometry
    route: Sequence[tuple[float, float]] = ()


class Navigator:
    """Drives a robot to a goal around what it sees; with a region, also around what a map knows."""

    def __init__(
        self,
        vehicle: Vehicle | str | Path,
        goal: tuple[float, float],
        *,
        region: Region | None = None,
        params: DriveParams | None = None,
        seed: int = 0,
    ) -> None:
        """Make a navigator that waits for its first scan.

        Args:
            vehicle: a vehicle, the name of one, or a TOML file.
            goal: metres east and north.
            region: what a map knows, in the goal's frame.
            params: how to drive.
            seed: kept for methods that draw random numbers; none does so far.

        Raises:
            UsageError: a figure is outside its range.
            InvalidVehicleError: the vehicle is not usable.
        """
        chosen = vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
        figures = asdict(params or DriveParams())
        for name, limit in (
            ("max_turn_rate_radps", chosen.max_turn_rate_radps),
            ("acceleration_mps2", chosen.max_acceleration_mps2),
            ("braking_mps2", chosen.max_braking_mps2),
        ):
            figures[name] = limit if figures[name] is None else min(figures[name], limit)
        self.seed = seed
        self._core = _core.Navigator(chosen.core, (float(goal[0]), float(goal[1])), figures, _map_of(region))

    def step(  # noqa: PLR0917 - what a robot senses, in the order that its drivers call it
        self,
        time_s: float,
        pose: Pose,
        speed_mps: float,
        turn_rate_radps: float,
        scan: Scan | None,
        reading: PenetrometerReading | None = None,
    ) -> Command:
        """Return what to do, given what the robot senses; input that cannot be used leads to a stop with its reason."""
        ranges, figures = None, [0.0] * 7
        if scan is not None:
            ranges = np.ascontiguousarray(scan.ranges_m, dtype=np.float64).ravel()
            figures = [scan.angle_min_rad, scan.angle_increment_rad, scan.range_min_m, scan.range_max_m, *scan.mount]
        probe = None
        if reading is not None:
            depths, indices = list(reading.depths_m), list(reading.cone_indices_kpa)
            probe = (reading.x_m, reading.y_m, depths, indices, reading.refusal_depth_m)
        place = (pose.x_m, pose.y_m, pose.heading_rad, pose.pitch_rad, pose.roll_rad)
        told = self._core.step(time_s, place, (speed_mps, turn_rate_radps), ranges, figures, probe)
        return Command(told[0], told[1], cast("Status", told[2]), told[3])

    @property
    def events(self) -> list[str]:
        """What happened in the last step."""
        return self._core.events()

    @property
    def core(self) -> _core.Navigator:
        """The navigator in the core."""
        return self._core

    @property
    def way(self) -> list[tuple[float, float]]:
        """The way on the memory from the robot on, in metres."""
        return self._core.way()


def _map_of(
    region: Region | None,
) -> tuple[object, tuple[int, int, float, float, float], list[tuple[float, float]]] | None:
    if region is None:
        return None
    geometry, ranks = region.geometry, np.ascontiguousarray(region.ranks, dtype=np.uint8)
    if ranks.shape != (geometry.rows, geometry.columns):
        raise ShapeMismatchError(
            f"Ranks of the shape {ranks.shape} do not fit the geometry.", "Give one rank for each cell."
        )
    shape = (geometry.rows, geometry.columns, geometry.cell_size_m, geometry.west_m, geometry.north_m)
    return ranks, shape, [(float(x), float(y)) for x, y in region.route]
