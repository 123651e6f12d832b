"""Swarm, exact pass and lazy A* side by side on the same ground, over as many seeds as asked for.

Without two places the whole map is searched and nests are compared; with two, the swarm keeps to its swathe and ways
are compared too. Intervals are Student's, 95 %, for the mean over seeds; one seed has none.
"""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from swathe import planner, swarm
from swathe.errors import InvalidParameterError
from swathe.nest import Nests, exact_nests
from swathe.rank import rank_map

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from swathe.corridor import Corridor, CorridorParams
    from swathe.grid import Cell, Position
    from swathe.rank import Region
    from swathe.swarm import StopParams, Stopped, SwarmParams, Tally

    OnProgress = Callable[[str, int, int], bool]
    Ends = tuple[Position, Position]

Method = Literal["swarm", "exact", "lazy_astar", "lazy_astar_1.25"]

#: Weights of the bound of lazy A*, by the name of the method.
LAZY_WEIGHTS: dict[str, float] = {"lazy_astar": 1.0, "lazy_astar_1.25": 1.25}

MOST_SEEDS = 10_000

# Two-sided 95 % quantiles of Student's distribution by degrees of freedom, where the series below is too coarse.
_STUDENT = (12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060, 2.2622, 2.2281)
_NORMAL = 1.959964


@dataclass(frozen=True, slots=True)
class Measured:
    """What one method found with one seed, and what that took; None where it has no such figure.

    Attributes:
        nest_count: nests found.
        cells_evaluated: cells whose rank was asked for.
        recall: share of the exact nests' cells that were found (of the swathe's, where there is one).
        recall_cores: the same for cores, found when their whole vicinity was.
        precision: share of the cells found that lie in exact nests of the whole map.
        visits: visits of agents to cells.
        ticks: ticks of the swarm.
        connected_at: tick in which start and goal first came into one nest.
        cost: cost of the way in seconds of driving.
        cost_excess: cost above the optimum of the whole map, as a share of it.
        seconds: time of computing.
    """

    nest_count: int | None = None
    cells_evaluated: int | None = None
    recall: float | None = None
    recall_cores: float | None = None
    precision: float | None = None
    visits: int | None = None
    ticks: int | None = None
    connected_at: int | None = None
    cost: float | None = None
    cost_excess: float | None = None
    seconds: float | None = None


@dataclass(frozen=True, eq=False)
class FoundNests:
    """Nests with what finding them took. ``inside`` is the swathe when it is not the whole map."""

    nests: Nests
    cells_evaluated: int
    tally: Tally | None
    corridor: Corridor | None = None
    stopped: Stopped | None = None

    def inside(self, region: Region) -> NDArray[np.bool_] | None:
        """Return the cells that were searched, None for the whole map."""
        return None if self.corridor is None else self.corridor.cells(region.geometry)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Every method's figures seed by seed, and the first seed's nests."""

    seeds: tuple[int, ...]
    measured: dict[str, list[Measured]]
    by_swarm: FoundNests
    exact: FoundNests

    def as_dict(self) -> dict[str, Any]:
        """Return means, medians, 95 % intervals and the first seed's recall and precision as plain values for JSON."""
        methods: dict[str, Any] = {}
        for name, runs in self.measured.items():
            means, medians, intervals = {}, {}, {}
            for figure in asdict(runs[0]):
                values = [value for run in runs if (value := getattr(run, figure)) is not None]
                means[figure] = None if len(values) < len(runs) else _mean(values)
                medians[figure] = None if means[figure] is None else float(np.median(values))
                interval = student_interval(values)
                if means[figure] is not None and interval is not None:
                    intervals[figure] = list(interval)
            methods[name] = {**means, "median": medians, "interval_95": intervals}
        first = self.measured["swarm"][0]
        return {
            "precision": first.precision,
            "recall": first.recall,
            "recall_cores": first.recall_cores,
            "seeds": list(self.seeds),
            "comparison": methods,
        }


def compare(
    region: Region,
    params: SwarmParams,
    corridor: CorridorParams,
    *,
    ends: Ends | None = None,
    seeds: int = 1,
    stop: StopParams | None = None,
    on_progress: OnProgress | None = None,
) -> Comparison:
    """Run every method on one region, the swarm with as many seeds as asked for, counted up from its own.

    The methods take turns, so that a busy machine slows all of them.

    ``stop`` ends the swarm.

    Raises:
        InvalidParameterError: the number of seeds is not usable, or one of the places lies outside the map.
        UsageError: a parameter is outside its range.
        InterruptedBySignalError: ``on_progress`` asked to stop.
    """
    if not 1 <= seeds <= MOST_SEEDS:
        raise InvalidParameterError(f"{seeds} seeds cannot be compared.", f"Give 1 to {MOST_SEEDS}.")
    names = (params.seed + number for number in range(seeds))
    drawn = tuple(seed % 2**64 for seed in names)
    runs: dict[str, list[Measured]] = {"swarm": [], "exact": []}
    _ = region.core  # made once, and no method's business
    firsts: tuple[FoundNests, FoundNests] | None = None
    for seed in drawn:
        with_seed = replace(params, seed=seed)
        ours, our_plan, our_seconds = _timed(
            region, "swarm", with_seed, corridor, ends, stop=stop, on_progress=on_progress
        )
        exact, best, seconds = _timed(region, "exact", with_seed, corridor, ends, stop=None, on_progress=on_progress)
        optimum = None if best is None else best.path_cost
        runs["exact"].append(
            Measured(
                nest_count=exact.nests.count,
                cells_evaluated=exact.cells_evaluated,
                recall=1.0,
                recall_cores=1.0,
                precision=1.0,
                cost=optimum,
                cost_excess=None if optimum is None else 0.0,
                seconds=seconds,
            )
        )
        truth = _truth(region, with_seed, ours, exact)
        runs["swarm"].append(
            _measured(region, with_seed, ours, exact.nests, truth, plan=our_plan, best=best, seconds=our_seconds)
        )
        if best is not None and best.path:
            for name, weight in LAZY_WEIGHTS.items():
                runs.setdefault(name, []).append(
                    _lazy(region, with_seed, weight, path=best.path, optimum=optimum, on_progress=on_progress)
                )
        firsts = firsts or (ours, exact)
    assert firsts is not None  # noqa: S101 - there is at least one seed
    return Comparison(drawn, runs, *firsts)


def find(
    region: Region,
    method: Literal["swarm", "exact"],
    params: SwarmParams,
    corridor: CorridorParams,
    ends: Ends | None,
    *,
    stop: StopParams | None = None,
    on_progress: OnProgress | None = None,
) -> tuple[FoundNests, planner.Plan | None]:
    """Find nests of the whole map, or with ``ends`` of the swathe between them, and then the plan too.

    Raises:
        InvalidParameterError: one of the places lies outside the map.
        UsageError, InterruptedBySignalError: as ``planner.plan``.
    """
    if ends is not None:
        answer = planner.plan(
            region, *ends, method=method, swarm=params, corridor=corridor, stop=stop, on_progress=on_progress
        )
        if answer.nests is None:
            raise InvalidParameterError(answer.reason or "There are no nests.", answer.remedy or "")
        # A guided swarm has no swathe to be complete in: what it found is measured against the whole map.
        guided = method == "swarm" and corridor.arc == "relaid" and corridor.width_m is None
        swathe = None if guided else answer.corridor
        return FoundNests(answer.nests, answer.cells_evaluated, answer.swarm, swathe, answer.stopped), answer
    if method == "swarm":
        done = swarm.run_swarm(region, params, stop=stop, on_progress=on_progress)
        return FoundNests(done.nests, done.tally.cells_evaluated, done.tally, stopped=done.stopped), None
    return FoundNests(_exact(rank_map(region).rank, params), region.geometry.cell_count, None), None


def student_interval(values: Sequence[float]) -> tuple[float, float] | None:
    """Return the 95 % interval of the mean by Student's distribution; None for fewer than two values."""
    count = len(values)
    if count < 2:
        return None
    mean = math.fsum(values) / count
    spread = math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (count - 1))
    half = student_quantile(count - 1) * spread / math.sqrt(count)
    return mean - half, mean + half


def student_quantile(degrees: int) -> float:
    """Return the two-sided 95 % quantile of Student's distribution (Abramowitz and Stegun 26.7.5 beyond ten)."""
    if degrees <= len(_STUDENT):
        return _STUDENT[degrees - 1]
    z = _NORMAL
    first = (z**3 + z) / 4
    second = (5 * z**5 + 16 * z**3 + 3 * z) / 96
    third = (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384
    return z + first / degrees + second / degrees**2 + third / degrees**3


def cores(nests: Nests, params: SwarmParams) -> NDArray[np.bool_]:
    """Return the cores of nests as a mask: the cells whose whole vicinity lies in nests."""
    inside = nests.labels > 0
    reach, offsets = _vicinity(params.nest.vicinity)
    padded = np.pad(inside, reach, constant_values=params.nest.border == "suitable")
    rows, columns = inside.shape
    whole = np.ones(inside.shape, dtype=np.bool_)
    for row, column in offsets:
        whole &= padded[reach + row : reach + row + rows, reach + column : reach + column + columns]
    return whole


def _vicinity(name: str) -> tuple[int, list[tuple[int, int]]]:
    """Return how far a vicinity reaches and its cells, as rows and columns from its core."""
    radius = {"cell": 0.0, "von_neumann1": 1.0, "moore1": 1.5}.get(name)
    if radius is None:
        radius = float(name.partition(":")[2])
    reach = int(radius)
    along = range(-reach, reach + 1)
    return reach, [(row, column) for row in along for column in along if math.hypot(row, column) <= radius]


def _timed(
    region: Region,
    method: Literal["swarm", "exact"],
    params: SwarmParams,
    corridor: CorridorParams,
    ends: Ends | None,
    *,
    stop: StopParams | None,
    on_progress: OnProgress | None,
) -> tuple[FoundNests, planner.Plan | None, float]:
    began = time.perf_counter()
    nests, answer = find(region, method, params, corridor, ends, stop=stop, on_progress=on_progress)
    return nests, answer, time.perf_counter() - began


def _exact(ranks: NDArray[np.uint8], params: SwarmParams) -> Nests:
    nest = params.nest
    return exact_nests(ranks, rank_min=nest.rank_min, vicinity=nest.vicinity, contact=nest.contact, border=nest.border)


def _truth(region: Region, params: SwarmParams, ours: FoundNests, exact: FoundNests) -> Nests:
    """Return the exact nests of the cells that the swarm was to search."""
    inside = ours.inside(region)
    if inside is None or inside.all():
        return exact.nests
    return _exact(np.where(inside, rank_map(region).rank, np.uint8(0)), params)


def _measured(
    region: Region,
    params: SwarmParams,
    ours: FoundNests,
    whole: Nests,
    truth: Nests,
    *,
    plan: planner.Plan | None,
    best: planner.Plan | None,
    seconds: float,
) -> Measured:
    found, wanted = ours.nests.labels > 0, truth.labels > 0
    wanted_cores = cores(truth, params)
    found_cores = wanted_cores & cores(ours.nests, params)
    tally = ours.tally
    cost = None if plan is None else plan.path_cost
    return Measured(
        nest_count=ours.nests.count,
        cells_evaluated=ours.cells_evaluated,
        recall=_share(int((found & wanted).sum()), int(wanted.sum())),
        recall_cores=_share(int(found_cores.sum()), int(wanted_cores.sum())),
        precision=_share(int((found & (whole.labels > 0)).sum()), int(found.sum())),
        visits=None if tally is None else tally.visits,
        ticks=None if tally is None else tally.ticks,
        connected_at=None if tally is None else tally.connected_at,
        cost=cost,
        cost_excess=_excess(region, params, plan, best),
        seconds=seconds,
    )


def _excess(region: Region, params: SwarmParams, plan: planner.Plan | None, best: planner.Plan | None) -> float | None:
    """Return the cost above that of the best way between the same cells."""
    if plan is None or plan.path_cost is None or not plan.path:
        return None
    optimum = None
    if best is not None and best.path and (best.path[0], best.path[-1]) == (plan.path[0], plan.path[-1]):
        optimum = best.path_cost
    else:
        optimum = planner.lazy_astar(region, plan.path[0], plan.path[-1], nest=params.nest).cost
    if optimum is None:
        return None
    return plan.path_cost / optimum - 1 if optimum > 0 else 0.0


def _lazy(
    region: Region,
    params: SwarmParams,
    weight: float,
    *,
    path: list[Cell],
    optimum: float | None,
    on_progress: OnProgress | None,
) -> Measured:
    began = time.perf_counter()
    found = planner.lazy_astar(region, path[0], path[-1], nest=params.nest, weight=weight, on_progress=on_progress)
    seconds = time.perf_counter() - began
    excess = None if found.cost is None or not optimum else found.cost / optimum - 1
    return Measured(cells_evaluated=found.cells_evaluated, cost=found.cost, cost_excess=excess, seconds=seconds)


def _share(part: int, whole: int) -> float:
    return part / whole if whole else 1.0


def _mean(values: Sequence[float]) -> float | int:
    mean = math.fsum(values) / len(values)
    return int(mean) if all(isinstance(value, int) for value in values) and mean == int(mean) else mean
