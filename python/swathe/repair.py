"""Repair of ways over cells that change while a robot moves (D* Lite)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.grid import Cell
from swathe.terrain import require_length
from swathe.ways import NoRoute, Path, Status, as_cell, as_costs

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True)
class RepairTally:
    """What the last search of a :class:`Replanner` did, and how many there were.

    Attributes:
        expanded: cells that it settled, unsettled or looked ahead from, some of them more than once.
        looked_at: the same, with the cells around changed ones and those whose way was withdrawn.
        afresh: whether it began from nothing.
        fresh_plans: searches from nothing so far.
        repairs: repairs so far.
    """

    expanded: int
    looked_at: int
    afresh: bool
    fresh_plans: int
    repairs: int


class Replanner:
    """A cheapest way over cells that is kept right while cells change and the robot moves (D* Lite).

    The cost of :meth:`path` is that of a new ``Replanner`` on the changed cells to the last bit: the least over all
    ways of the sum of their steps, taken from the goal backwards. :func:`shortest_path` sums in another order, so it
    may differ from it in the last bits.

    >>> import numpy as np
    >>> replanner = Replanner(np.ones((3, 5)), (1, 0), (1, 4))
    >>> replanner.path().cost
    4.0
    >>> replanner.update(slice(0, 2), slice(2, 3), np.inf)
    2
    >>> replanner.move_to((1, 1))
    >>> round(replanner.path().cost, 3)
    4.414
    """

    def __init__(
        self,
        cells: ArrayLike,
        start: tuple[int, int],
        goal: tuple[int, int],
        *,
        cell_size_m: float = 1.0,
        neighbours: int = 8,
        corners: Literal["keep", "cut"] = "keep",
        repair_share: float = 0.2,
        keep_expanded: bool = False,
    ) -> None:
        """Take a copy of the cells; the arguments that :func:`shortest_path` has too mean the same.

        Args:
            cells: (rows, columns); bool = passable at cost 1, numbers = cost per metre (NaN and infinity are closed).
            start: row and column of the robot.
            goal: row and column of the last cell.
            cell_size_m: side of a cell.
            neighbours: 8 or 16 directions.
            corners: ``keep`` or ``cut``.
            repair_share: share of a fresh plan's work, 0 or more, after which a repair is given up for a fresh plan.
            keep_expanded: whether :attr:`expanded` is kept, for pictures.

        Raises:
            UsageError: a cost is negative, a cell lies outside, or an argument is not one of those named.
        """
        costs = as_costs(cells)
        if neighbours not in (8, 16):
            raise InvalidParameterError(f"{neighbours} neighbours are not offered.", "Give 8 or 16.")
        if corners not in ("keep", "cut"):
            raise InvalidParameterError(f"The corners {corners!r} are not known.", "Give keep or cut.")
        if not repair_share >= 0:
            raise InvalidParameterError(f"A repair share of {repair_share} is not usable.", "Give 0 or more.")
        self._cell_size_m = require_length(cell_size_m)
        self._start, self._goal = as_cell(start, costs.shape), as_cell(goal, costs.shape)
        self._shape = costs.shape
        self._core = _core.Replanner(
            costs,
            self._start,
            self._goal,
            self._cell_size_m,
            neighbours,
            corners == "cut",
            float(repair_share),
            keep_expanded,
        )

    @property
    def start(self) -> Cell:
        """Where the robot is."""
        return self._start

    @property
    def goal(self) -> Cell:
        """Where it should go."""
        return self._goal

    def move_to(self, cell: tuple[int, int]) -> None:
        """Move the robot to a cell (row, column).

        Raises:
            UsageError: the cell lies outside.
        """
        self._start = as_cell(cell, self._shape)
        self._core.move_to(self._start)

    def update(self, rows: ArrayLike | slice, columns: ArrayLike | slice, values: ArrayLike) -> int:
        """Give cells new values and return how many of them are now others than before.

        Args:
            rows: a slice for a rectangle of cells, or whole numbers for single ones.
            columns: as ``rows``.
            values: what ``cells`` may hold, one for each cell or one for all.

        Raises:
            UsageError: a value is negative, a cell lies outside, or the shapes do not fit; nothing has changed then.
        """
        if isinstance(rows, slice) and isinstance(columns, slice):
            spans = [range(*span.indices(size)) for span, size in zip((rows, columns), self._shape, strict=True)]
            if any(span.step != 1 for span in spans):
                raise InvalidParameterError("A rectangle of cells has no gaps.", "Give slices without a step.")
            shape = (len(spans[0]), len(spans[1]))
            costs = _costs_like(values, shape)
            return self._core.update_window(spans[0].start, spans[1].start, costs) if costs.size else 0
        if isinstance(rows, slice) or isinstance(columns, slice):
            raise InvalidParameterError("Rows and columns are not of one kind.", "Give two slices or two arrays.")
        row, column = (_numbers(name, given) for name, given in (("rows", rows), ("columns", columns)))
        try:
            row, column = np.broadcast_arrays(row, column)
        except ValueError as error:
            raise ShapeMismatchError(
                f"Rows of the shape {row.shape} do not fit columns of the shape {column.shape}.",
                "Give one row and one column for each cell.",
            ) from error
        costs = _costs_like(values, row.shape)
        return self._core.update_cells(np.ravel(row), np.ravel(column), np.ravel(costs))

    def path(self, *, on_progress: Callable[[str, int, int], bool] | None = None) -> Path | NoRoute:
        """Return a cheapest way from the robot to the goal, repaired or searched afresh as needed.

        Args:
            on_progress: called with ``route``, the cells looked at and 0; returning False stops with an error, and the
                next call goes on.

        Raises:
            InterruptedBySignalError: ``on_progress`` asked to stop.
        """
        ends: tuple[tuple[Status, str, Cell], ...] = (
            ("start_blocked", "start", self._start),
            ("goal_blocked", "goal", self._goal),
        )
        for status, name, cell in ends:
            if math.isinf(self._core.cost(cell)):
                return NoRoute(status, f"The {name} cell ({cell.row}, {cell.column}) is closed.")
        found = self._core.path(on_progress)
        if found is None:
            return NoRoute("no_route", "Closed cells separate start and goal.")
        way, cost = found
        length_m = math.fsum(map(math.dist, way, way[1:])) * self._cell_size_m
        return Path(list(map(Cell._make, way)), cost, length_m)

    @property
    def tally(self) -> RepairTally:
        """What the last search did."""
        return RepairTally(*self._core.tally())

    @property
    def expanded(self) -> NDArray[np.uint32]:
        """Rows and columns of the cells that the last search expanded, (n, 2) in their order; see ``keep_expanded``."""
        return np.asarray(self._core.expanded())


def _numbers(name: str, given: ArrayLike) -> NDArray[np.int64]:
    array = np.asarray(given)
    if array.size == 0:
        return array.astype(np.int64)
    if array.dtype.kind not in "iu":
        raise InvalidParameterError(f"The {name} are not whole numbers.", "Give rows and columns counted from 0.")
    return array.astype(np.int64)


def _costs_like(values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return costs per metre of a shape from what ``cells`` may hold."""
    array = np.asarray(values)
    if array.dtype == np.bool_:
        array = np.where(array, 1.0, np.inf)
    if array.dtype.kind not in "iuf":
        raise InvalidParameterError("The values do not hold numbers.", "Give costs per metre or booleans.")
    try:
        return np.ascontiguousarray(np.broadcast_to(array, shape), dtype=np.float64)
    except ValueError as error:
        raise ShapeMismatchError(
            f"Values of the shape {array.shape} do not fit cells of the shape {shape}.",
            "Give one value for each cell, or one for all.",
        ) from error
