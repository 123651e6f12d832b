"""What is asked for: which ground, judged how, and how a route is found."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from swathe.corridor import CorridorParams
from swathe.errors import InvalidParameterError, UsageError
from swathe.nest import NestParams
from swathe.objective import Objective
from swathe.rank import RankParams
from swathe.swarm import StopParams, SwarmParams

if TYPE_CHECKING:
    from swathe.planner import PathKind


@dataclass(frozen=True, slots=True)
class TerrainRequest:
    """Which ground is meant.

    Attributes:
        dem: elevation sources; several are put together.
        soil: soil vector or raster, or None.
        soil_field: its attribute.
        soil_legend: CSV that explains its values.
        cost_raster: raster of the user's factors on costs, or None; closed where it is NaN, infinite or has no value.
        cell_size_m: size of terrain cells; the source's when None.
        crs: projection to plan in; UTM or the source's own when None.
        height_range_m: heights of black and white of a grey picture.
        points_crs: system of points and bounds; None is WGS 84 longitude,latitude.
        bounds: west, south, east, north of the part to use, in ``points_crs``.
        memory_limit_bytes: most memory that may be used; None takes what is free.
        store: address of a terrain store that holds elevation and soil, in the place of ``dem`` and ``soil``.
        region: the region of the store.
        revision: the revision up to which its readings count; all of them when None.
    """

    dem: tuple[str, ...] = ()
    soil: str | None = None
    soil_field: str | None = None
    soil_legend: str | None = None
    cost_raster: str | None = None
    cell_size_m: float | None = None
    crs: str | None = None
    height_range_m: tuple[float, float] | None = None
    points_crs: str | None = None
    bounds: tuple[float, float, float, float] | None = None
    memory_limit_bytes: int | None = None
    store: str | None = None
    region: str | None = None
    revision: int | None = None

    def __post_init__(self) -> None:
        if self.store is None and self.region is None:
            return
        if self.store is None or self.region is None:
            raise UsageError("A region is part of a store.", "Give both `--store URL` and `--region NAME`.")
        asked = {
            "--dem": bool(self.dem),
            "--soil": self.soil is not None,
            "--soil-field": self.soil_field is not None,
            "--soil-legend": self.soil_legend is not None,
            "--cell-size": self.cell_size_m is not None,
            "--crs": self.crs is not None,
            "--height-range": self.height_range_m is not None,
        }
        wrong = [option for option, given in asked.items() if given]
        if wrong:
            raise UsageError(
                f"With `--store` the ground is what was imported, so {', '.join(wrong)} cannot be given too.",
                "Give it to `swathe import` instead.",
            )


@dataclass(frozen=True, slots=True)
class Settings:
    """How the ground is judged and the route is found.

    ``agents``, ``pellet_max`` and ``arc`` are the profile's when None: 1024, 1 and a re-laid arc, or with the paper's
    profiles 10, 3 and a circle. Bearings are those of the nose at the ends of a drivable path, clockwise from the map's
    north; free when None.
    """

    vehicle: str = "pioneer-3at"
    rank: RankParams = field(default_factory=RankParams)
    method: Literal["swarm", "exact"] = "swarm"
    agents: int | None = None
    pellet_max: int | None = None
    explore: Literal["walk", "uniform", "permute"] = "walk"
    stop: StopParams = field(default_factory=StopParams)
    seed: int = 0
    arc: Literal["relaid", "spine", "circle", "line"] | None = None
    sagitta_m: float | None = None
    width_m: float | None = None
    path: PathKind = "auto"
    start_bearing_deg: float | None = None
    goal_bearing_deg: float | None = None
    objective: Objective = field(default_factory=Objective)
    bridge: bool = False
    certify: bool = False

    @property
    def follows_paper(self) -> bool:
        """Whether the profile is one of the paper's."""
        return self.rank.profile != "metric"

    def swarm_params(self) -> SwarmParams:
        """Return the swarm's parameters."""
        return SwarmParams(
            agents=self.agents if self.agents is not None else (10 if self.follows_paper else 1024),
            pellet_max=self.pellet_max if self.pellet_max is not None else (3 if self.follows_paper else 1),
            nest=NestParams(rank_min=self.rank.rank_min),
            explore=self.explore,
            seed=self.seed,
        )

    @property
    def looks_where_it_goes(self) -> bool:
        """Whether the plan is that of the swarm whose arc is re-laid, which needs to see but a part of the map."""
        plain = self.method == "swarm" and not (self.follows_paper or self.certify) and self.width_m is None
        # Risk is counted from no-go cells, which the swarm need not have seen.
        return plain and self.corridor_params().arc == "relaid" and self.objective.risk == 0

    def headings_rad(self) -> tuple[float | None, float | None]:
        """Return the headings at start and goal, counter-clockwise from east.

        Raises:
            InvalidParameterError: a bearing is not finite.
        """
        return _heading_rad(self.start_bearing_deg), _heading_rad(self.goal_bearing_deg)

    def corridor_params(self) -> CorridorParams:
        """Return the arc and width of the swathe."""
        arc = self.arc or ("circle" if self.follows_paper else "relaid")
        return CorridorParams(arc, self.sagitta_m, self.width_m)


def _heading_rad(bearing_deg: float | None) -> float | None:
    if bearing_deg is None:
        return None
    if not math.isfinite(bearing_deg):
        raise InvalidParameterError(f"A bearing of {bearing_deg} is not a direction.", "Give degrees from north.")
    return math.radians(90 - bearing_deg)


def use_threads(threads: int | None) -> None:
    """Set the number of threads of the core, before its first work. The result does not depend on it.

    Raises:
        InvalidParameterError: the number is not at least one.
    """
    if threads is None:
        return
    if threads < 1:
        raise InvalidParameterError(f"{threads} threads cannot work.", "Give at least 1, or leave it out.")
    os.environ["RAYON_NUM_THREADS"] = str(threads)


def require_swarm(settings: Settings, *, animate: bool, compare: bool = False) -> None:
    """Refuse what the exact pass cannot do: it looks at the whole map at once.

    Raises:
        InvalidParameterError: a rule, a budget or an animation is asked of the exact pass.
    """
    if settings.method == "exact" and not compare and (animate or settings.stop != StopParams()):
        what = "animated" if animate else "stopped early"
        raise InvalidParameterError(
            f"The exact pass cannot be {what}: it looks at the whole map at once.", "Leave out `--method exact`."
        )
