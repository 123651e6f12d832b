"""The planner without a vehicle: cheapest ways over costs per metre, over cells and at any angle, and cost fields."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, OutsideGridError, ShapeMismatchError, TooLargeError
from swathe.grid import Cell
from swathe.terrain import require_length

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

Status = Literal["route_found", "no_route", "start_blocked", "goal_blocked", "outside_map", "unread"]


@dataclass(frozen=True, slots=True)
class Path:
    """A cheapest way over cells: its cells from start to goal, its cost and its length in metres."""

    cells: list[Cell]
    cost: float
    length_m: float


@dataclass(frozen=True, eq=False)
class AnyAnglePath:
    """A way of straight segments at any angle.

    Attributes:
        points: (n, 2) vertices from start to goal as row and column; whole numbers are the centres of cells.
        cost: the integral of the cost per metre along the segments.
        length_m: their length in metres.
    """

    points: NDArray[np.float64]
    cost: float
    length_m: float


@dataclass(frozen=True, slots=True)
class NoRoute:
    """No way; falsy. ``status`` is ``no_route``, ``start_blocked`` or ``goal_blocked``, ``reason`` one sentence."""

    status: Status
    reason: str

    def __bool__(self) -> bool:
        """Return False, so that ``if path:`` reads well."""
        return False


def shortest_path(
    cells: ArrayLike,
    start: tuple[int, int],
    goal: tuple[int, int],
    *,
    cell_size_m: float = 1.0,
    neighbours: int = 8,
    method: Literal["auto", "astar", "dijkstra"] = "auto",
    corners: Literal["keep", "cut"] = "keep",
    memory_limit_bytes: int | None = None,
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> Path | NoRoute:
    """Return a cheapest way over cells from ``start`` to ``goal``, both (row, column).

    Args:
        cells: (rows, columns); bool = passable at cost 1, numbers = cost per metre (NaN and infinity are closed).
            Contiguous arrays of bool, uint8, uint16, float32 and float64 are read where they are; others are copied.
        start: row and column of the first cell.
        goal: row and column of the last cell.
        cell_size_m: side of a cell.
        neighbours: 8 or 16 directions.
        method: ``auto`` leaves out ground from which, by a coarse grid's bound, the goal cannot be reached in time;
            ``dijkstra`` searches in all directions until the goal is reached; ``astar`` is the textbook search with the
            least cost times the straight distance, slower and kept for comparison. The cost is the same.
        corners: ``keep`` lets no step pass a closed cell at a corner; ``cut`` allows it, for comparison with peers.
        memory_limit_bytes: most memory that the search may hold beside ``cells``, copies of them included.
        on_progress: called with ``"route"``, the cells settled so far and 0; returning False stops with an error.

    An edge costs its metres times the length-weighted mean of the cells that it crosses (with 8 neighbours the mean of
    both ends). The cost is the way's own, summed in floats, and above the least there is by at most 1e-8 of it; it is
    infinite when the sum is beyond what a float holds.

    >>> import numpy as np
    >>> shortest_path(np.ones((3, 4), dtype=bool), (0, 0), (0, 3)).cost
    3.0

    Raises:
        UsageError: a cost is negative, a cell lies outside, or an argument is not one of those named.
        TooLargeError: the search would need more memory than ``memory_limit_bytes``.
        InterruptedBySignalError: ``on_progress`` asked to stop.
    """
    costs, left_bytes = _costs(cells, memory_limit_bytes)
    options = _cell_search(cell_size_m, neighbours, corners, left_bytes)
    if method not in ("auto", "astar", "dijkstra"):
        raise InvalidParameterError(f"The method {method!r} is not known.", "Give auto, astar or dijkstra.")
    first, last = as_cell(start, costs.shape), as_cell(goal, costs.shape)
    blocked = _blocked_end(costs, first, last)
    if blocked is not None:
        return blocked
    found = _core.shortest_path(costs, first, last, options, method, on_progress)
    if found is None:
        return NoRoute("no_route", _SEPARATED)
    way, cost = found
    steps = np.diff(np.asarray(way, dtype=np.float64), axis=0)
    length_m = float(np.hypot(steps[:, 0], steps[:, 1]).sum() * cell_size_m) if len(way) > 1 else 0.0
    return Path([Cell(*cell) for cell in way], cost, length_m)


def cost_field(
    cells: ArrayLike,
    start: tuple[int, int],
    *,
    cell_size_m: float = 1.0,
    neighbours: int = 8,
    corners: Literal["keep", "cut"] = "keep",
    memory_limit_bytes: int | None = None,
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> NDArray[np.float64]:
    """Return the least cost from ``start``, (row, column), to every cell: infinite where no way leads.

    Arguments and edges are those of :func:`shortest_path`. From a closed start no way leads anywhere.

    >>> import numpy as np
    >>> cost_field(np.ones((2, 3), dtype=bool), (0, 0))[0].tolist()
    [0.0, 1.0, 2.0]

    Raises:
        UsageError: a cost is negative, a cell lies outside, or an argument is not one of those named.
        TooLargeError: the field would need more memory than ``memory_limit_bytes``.
        InterruptedBySignalError: ``on_progress`` asked to stop.
    """
    costs, left_bytes = _costs(cells, memory_limit_bytes)
    options = _cell_search(cell_size_m, neighbours, corners, left_bytes)
    field: NDArray[np.float64] = _core.cost_field(costs, as_cell(start, costs.shape), options, on_progress)
    return field


def any_angle_path(
    cells: ArrayLike,
    start: tuple[int, int],
    goal: tuple[int, int],
    *,
    cell_size_m: float = 1.0,
    method: Literal["auto", "theta", "eikonal"] = "auto",
    corners: Literal["keep", "cut"] = "keep",
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> AnyAnglePath | NoRoute:
    """Return a cheap way of straight segments at any angle from the centre of ``start`` to the centre of ``goal``.

    Args:
        cells: (rows, columns); bool = passable at cost 1, numbers = cost per metre (NaN and infinity are closed).
        start: row and column of the first cell.
        goal: row and column of the last cell.
        cell_size_m: side of a cell.
        method: ``theta`` refines what Lazy Theta* and the search over 16 neighbours find, ``eikonal`` the way down the
            eikonal field; ``auto`` takes the cheapest of all.
        corners: ``keep`` lets no segment touch a closed cell, not even at a corner; ``cut`` allows it.
        on_progress: called with stage, work done and work expected; returning False stops with an error.

    The cost is the integral of the cost per metre along the segments, so it is never less than that of a cheapest way;
    with ``auto`` and ``theta`` it is never more than that of ``shortest_path``. How near it comes to the cheapest is
    measured in docs/any-angle.md. Where corners are cut, ``eikonal`` alone finds only ways that share sides of cells.

    >>> import numpy as np
    >>> any_angle_path(np.ones((4, 5)), (0, 0), (3, 4)).cost
    5.0

    Raises:
        UsageError: a cost is negative, a cell lies outside, or an argument is not one of those named.
        InterruptedBySignalError: ``on_progress`` asked to stop.
    """
    costs = as_costs(cells)
    if method not in ("auto", "theta", "eikonal"):
        raise InvalidParameterError(f"The method {method!r} is not known.", "Give auto, theta or eikonal.")
    _require_corners(corners)
    cell_size_m = require_length(cell_size_m)
    first, last = as_cell(start, costs.shape), as_cell(goal, costs.shape)
    blocked = _blocked_end(costs, first, last)
    if blocked is not None:
        return blocked
    found = _core.any_angle_path(costs, first, last, cell_size_m, method, corners == "cut", on_progress)
    if found is None:
        return NoRoute("no_route", _SEPARATED)
    way, cost = found
    points = np.asarray(way, dtype=np.float64)
    points[0], points[-1] = first, last  # without the rounding of metres
    steps = np.diff(points, axis=0)
    return AnyAnglePath(points, cost, float(np.hypot(steps[:, 0], steps[:, 1]).sum() * cell_size_m))


def eikonal_field(
    cells: ArrayLike,
    start: tuple[int, int],
    *,
    cell_size_m: float = 1.0,
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> NDArray[np.float64]:
    """Return the costs from the centre of ``start`` to the centre of every cell, as if any heading could be taken.

    Args:
        cells: (rows, columns); bool = passable at cost 1, numbers = cost per metre (NaN and infinity are closed).
        start: row and column of the start.
        cell_size_m: side of a cell.
        on_progress: called with stage, work done and work expected; returning False stops with an error.

    The values solve the eikonal equation by fast marching (Sethian 1996, 1999), of second order where the cost is
    smooth. Right for costs that change little from cell to cell; docs/any-angle.md tells the errors. Infinite where no
    way of steps along rows and columns leads, and everywhere when the start is closed.

    >>> import numpy as np
    >>> eikonal_field(np.ones((1, 4)), (0, 0))
    array([[0., 1., 2., 3.]])

    Raises:
        UsageError: a cost is negative, or the start lies outside.
        InterruptedBySignalError: ``on_progress`` asked to stop.
    """
    costs = as_costs(cells)
    cell_size_m = require_length(cell_size_m)
    first = as_cell(start, costs.shape)
    field: NDArray[np.float64] = _core.eikonal_field(costs, first, cell_size_m, on_progress)
    return field


_SEPARATED = "Closed cells separate start and goal."


def _require_corners(corners: str) -> None:
    if corners not in ("keep", "cut"):
        raise InvalidParameterError(f"The corners {corners!r} are not known.", "Give keep or cut.")


def _blocked_end(costs: NDArray[Any], start: Cell, goal: Cell) -> NoRoute | None:
    """Return the refusal when start or goal is closed."""
    for name, cell in (("start", start), ("goal", goal)):
        if not (costs[cell] if costs.dtype == np.bool_ else math.isfinite(costs[cell])):
            refuse_negative(costs)  # the core, which looks otherwise, is not asked
            status: Status = "start_blocked" if name == "start" else "goal_blocked"
            return NoRoute(status, f"The {name} cell ({cell.row}, {cell.column}) is closed.")
    return None


def _cell_search(cell_size_m: float, neighbours: int, corners: str, left_bytes: int | None) -> dict[str, Any]:
    if neighbours not in (8, 16):
        raise InvalidParameterError(f"{neighbours} neighbours are not offered.", "Give 8 or 16.")
    _require_corners(corners)
    return {
        "cell_size_m": require_length(cell_size_m),
        "neighbours": neighbours,
        "cut_corners": corners == "cut",
        "memory_limit_bytes": left_bytes,
    }


_IN_PLACE = (np.bool_, np.uint8, np.uint16, np.float32, np.float64)


def _costs(cells: ArrayLike, limit_bytes: int | None) -> tuple[NDArray[Any], int | None]:
    """Return costs as the core reads them, and what is left of the memory allowed."""
    if limit_bytes is not None:
        limit_bytes = _bytes(limit_bytes)
    array: NDArray[Any] = np.asarray(cells)
    if array.ndim != 2 or array.size == 0:
        raise ShapeMismatchError(f"The cells have the shape {array.shape}.", "Give an array of rows and columns.")
    if array.dtype.kind not in "biuf":
        raise InvalidParameterError("The cells do not hold numbers.", "Give costs per metre or booleans.")
    dtype = array.dtype if array.dtype in _IN_PLACE else np.dtype(np.float64)
    if array.dtype == dtype and array.flags.c_contiguous and array.flags.aligned:
        return array, limit_bytes
    copied_bytes = array.size * dtype.itemsize
    if limit_bytes is not None and copied_bytes > limit_bytes:
        raise TooLargeError(
            f"The cells, {array.dtype} in this layout, are copied first, which takes {copied_bytes} bytes of the "
            f"{limit_bytes} allowed: about {limit_bytes // (dtype.itemsize + 4)} cells would fit.",
            "Give a contiguous array of float32, or allow more memory.",
        )
    left_bytes = None if limit_bytes is None else limit_bytes - copied_bytes
    return np.require(array, dtype, ["C", "A"]), left_bytes


def _bytes(given: int) -> int:
    try:
        count = operator.index(given)
    except TypeError:
        count = -1
    if count < 0:
        raise InvalidParameterError(f"A memory limit of {given!r} is not usable.", "Give a whole number of bytes.")
    return min(count, 2**63)


def as_costs(cells: ArrayLike) -> NDArray[np.float64]:
    """Return costs as floats, infinite where a boolean says closed."""
    costs, _ = _costs(cells, None)
    return np.where(costs, 1.0, np.inf) if costs.dtype == np.bool_ else np.ascontiguousarray(costs, np.float64)


def refuse_negative(costs: NDArray[Any]) -> None:
    """Raise an error that names the first cell whose cost is negative."""
    if costs.dtype != np.bool_ and len(below := np.argwhere(costs < 0)):
        row, column = below[0]
        raise InvalidParameterError(
            f"The cost {costs[row, column]:g} at cell ({row}, {column}) is negative.",
            "Mark closed cells with NaN or infinity instead.",
        )


def as_cell(cell: tuple[int, int], shape: tuple[int, ...]) -> Cell:
    """Return a cell that lies in a grid of this shape; raise an error for anything else."""
    try:
        row, column = (operator.index(value) for value in cell)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError(f"{cell!r} is not a cell.", "Give a row and a column, whole numbers.") from error
    if not (0 <= row < shape[0] and 0 <= column < shape[1]):
        raise OutsideGridError(
            f"Cell ({row}, {column}) lies outside {shape[0]} rows and {shape[1]} columns.",
            "Rows and columns count from 0 at the north-west.",
        )
    return Cell(row, column)
