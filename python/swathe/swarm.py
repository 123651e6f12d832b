"""The termite swarm: agents drop pellets on suitable cells, full cells become cores of nests, touching nests merge.

Limits first: for a full static map the swarm does more work than the one pass of ``swathe.nest.exact_nests``, with
which it agrees cell for cell once it is finished. At every earlier time its nests lie inside the exact ones.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.nest import NestParams, Nests

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from swathe.rank import Region

#: Ticks that a swarm which can finish never needs.
UNTIL_FINISHED = 2**63


@dataclass(frozen=True, slots=True)
class SwarmParams:
    """How the swarm works.

    Attributes:
        agents: number of agents, 1 to 1,000,000 (the paper: 10).
        pellet_max: pellets that make a cell a focus, 1 to 255 (profile ``paper``: 3).
        nest: what a nest is.
        teleport: probability of a new deployment per tick, 0 to 1.
        attract: pull of pellets on the walk, at least 0.
        explore: ``walk``, ``uniform`` (a new deployment every tick) or ``permute`` (each cell once an epoch).
        seed: seed of every draw, 0 to 2**64 - 1; the same seed gives the same result for any number of threads.
    """

    agents: int = 1024
    pellet_max: int = 1
    nest: NestParams = NestParams()
    teleport: float = 0.05
    attract: float = 0.0
    explore: Literal["walk", "uniform", "permute"] = "walk"
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("number of agents", self.agents, 1, 1_000_000),
            ("pellet limit", self.pellet_max, 1, 255),
            ("seed", self.seed, 0, 2**64 - 1),
            ("lowest suitable rank", self.nest.rank_min, 2, 10),
        ):
            if not low <= value <= high:
                raise InvalidParameterError(f"The {name} of {value} is not usable.", f"Give {low} to {high}.")

    def core_arguments(self) -> dict[str, Any]:
        """Return the parameters as the flat dictionary that the core takes."""
        flat = asdict(self)
        nest = flat.pop("nest")
        return {**flat, **nest}


@dataclass(frozen=True, slots=True)
class Tally:
    """What a swarm has done.

    Attributes:
        ticks: ticks so far.
        visits: visits of agents to cells.
        cells_evaluated: cells whose rank was asked for, each once.
        cores: cores found.
        connected_at: tick in which start and goal came into one nest, if they did.
    """

    ticks: int
    visits: int
    cells_evaluated: int
    cores: int
    connected_at: int | None


@dataclass(frozen=True, eq=False)
class Swarm:
    """The nests that a swarm has built and how far it came: ``finished``, ``ticks_spent`` or ``stopped``."""

    nests: Nests
    ending: str
    tally: Tally


def run_swarm(
    region: Region,
    params: SwarmParams | None = None,
    *,
    inside: NDArray[np.bool_] | None = None,
    ticks: int | None = None,
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> Swarm:
    """Run a swarm over a region until it is finished, ``ticks`` are over or ``on_progress`` returns False.

    ``inside`` limits it to a mask of cells. A walk without teleport may never finish: give it ``ticks``.

    Raises:
        UsageError: a parameter is outside its range or the mask does not fit.
    """
    params = params or SwarmParams(nest=NestParams(rank_min=region.params.rank_min))
    mask = None if inside is None else np.ascontiguousarray(inside, dtype=np.bool_)
    if mask is not None and mask.shape != region.geometry.shape:
        raise ShapeMismatchError(
            f"The mask has the shape {mask.shape} where the grid has {region.geometry.shape}.",
            "Give one value per cell.",
        )
    limit = UNTIL_FINISHED if ticks is None else ticks
    if not 0 <= limit <= UNTIL_FINISHED:
        raise InvalidParameterError(f"{ticks} ticks cannot be spent.", "Give 0 or more.")
    found = _core.run_swarm(region.core, mask, params.core_arguments(), limit, on_progress)
    nests = Nests(found["labels"], np.asarray(found["sizes"], dtype=np.uint32))
    return Swarm(nests, found["ending"], tally(found))


def tally(found: dict[str, Any]) -> Tally:
    """Return the tally out of the core's answer."""
    names = ("ticks", "visits", "cells_evaluated", "cores", "connected_at")
    return Tally(**{name: found[name] for name in names})
