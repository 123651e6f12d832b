"""Route repair after a square patch of 1 % of the cells beside the robot has changed, against planning afresh.

The robot has driven a quarter of its way from corner to corner. The patch touches it on a side to which the way leads,
so that about a side of the patch of the way lies in it; on other sides of the robot a repair is quicker still. Taking
in the change counts as part of the repair. Both sides give the cost of the way; they sum it in different orders.

`repair-far` has the patch at the goal, so that every cost to go changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

import terrain_fields
from harness import Benchmark, Contender

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from swathe.planner import NoRoute, Path, Replanner

    Answer = Path | NoRoute


@dataclass(frozen=True, eq=False)
class Change:
    """A robot on its way, the change that it meets, and the costs after it."""

    replanner: Replanner
    costs: NDArray[np.float64]
    robot: tuple[int, int]
    goal: tuple[int, int]
    rows: slice
    columns: slice
    patch: NDArray[np.float64]


KINDS: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
    "dearer": lambda costs: costs * 3,
    "cheaper": lambda costs: np.maximum(costs / 3, 1.0),
    "closed": lambda costs: np.full_like(costs, np.inf),
    "far": lambda costs: costs * 3,
}


def change(side: int, kind: str) -> Change:
    import swathe.planner

    costs = terrain_fields.costs(side)
    goal = (side - 1, side - 1)
    replanner = swathe.planner.Replanner(costs, (0, 0), goal)
    way = replanner.path()
    if isinstance(way, swathe.planner.NoRoute):
        raise TypeError(way.reason)
    robot = way.cells[len(way.cells) // 4]
    replanner.move_to(robot)
    replanner.path()
    patch = side // 10
    rows = slice(robot.row + 2, robot.row + 2 + patch)
    columns = slice(max(0, robot.column - patch // 2), max(0, robot.column - patch // 2) + patch)
    if kind == "far":
        rows = columns = slice(side - 2 - patch, side - 2)
    values = KINDS[kind](costs[rows, columns])
    costs[rows, columns] = values
    return Change(replanner, costs, robot, goal, rows, columns, values)


def prepare(side: int, kind: str, run: Callable[[Change], Answer]) -> Callable[[], Change]:
    def prepared() -> Change:
        run(change(200, kind))  # imports and threads are not the job
        return change(side, kind)

    return prepared


def run_repair(job: Change) -> Answer:
    job.replanner.update(job.rows, job.columns, job.patch)
    return job.replanner.path()


def run_search(job: Change) -> Answer:
    import swathe.planner

    return swathe.planner.shortest_path(job.costs, job.robot, job.goal)


def run_afresh(job: Change) -> Answer:
    import swathe.planner

    return swathe.planner.Replanner(job.costs, job.robot, job.goal).path()


def facts(_job: Change, answer: Answer) -> dict[str, float]:
    import swathe.planner

    if isinstance(answer, swathe.planner.NoRoute):
        raise TypeError(answer.reason)
    return {"cost": answer.cost}


PEERS: dict[str, tuple[str, Callable[[Change], Answer]]] = {
    "": ("swathe.planner.shortest_path", run_search),
    "-afresh": ("a new swathe.planner.Replanner", run_afresh),
}

BENCHMARKS = [
    Benchmark(
        f"repair-{kind}-{side}{suffix}",
        ours=Contender("swathe.planner.Replanner", prepare(side, kind, run_repair), run_repair, facts),
        peer=Contender(name, prepare(side, kind, run), run, facts),
        must=0.83 if kind == "far" else 5,
        goal=1 if kind == "far" else 20,
        agree_relative=1e-12,
    )
    for side in (1000, 2000)
    for kind in KINDS
    for suffix, (name, run) in PEERS.items()
    if kind != "far" or suffix
]
