"""Nests: connected regions of suitable cells in which the vicinity of every core is suitable too."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.grid import Cell, GridGeometry, as_codes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from swathe.grid import Position, Window
    from swathe.vehicle import Vehicle


_Ring = list[tuple[float, float]]

GridMode = Literal["or", "and", "single", "exact16"]
#: Two grids a quarter of a cell apart along both axes: shares of a cell to the east and to the south.
DIAGONAL_PHASES = ((0.0, 0.0), (0.25, 0.25))
#: Four grids that between them find every square of one and a half cells.
HALF_PHASES = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))


@dataclass(frozen=True, slots=True)
class NestParams:
    """What a nest is.

    Attributes:
        rank_min: lowest suitable rank, 2 to 10.
        vicinity: the cells around a core that must be suitable: ``moore1`` (3 x 3), ``von_neumann1``, ``cell``,
            ``disk:r`` (r in cells).
        contact: when nests are one: ``edge``, ``corner`` or ``overlap``.
        border: whether cells beyond the map or swathe count as ``suitable`` or ``unsuitable``.
    """

    rank_min: int = 6
    vicinity: str = "moore1"
    contact: Literal["edge", "corner", "overlap"] = "edge"
    border: Literal["unsuitable", "suitable"] = "unsuitable"


@dataclass(frozen=True, eq=False)
class Nests:
    """Labelled nests: 0 is no nest; nests count from 1 in raster order. ``sizes[n - 1]`` are the cells of nest n."""

    labels: NDArray[np.uint32]
    sizes: NDArray[np.uint32]

    @property
    def count(self) -> int:
        """Number of nests."""
        return len(self.sizes)


class Outline(NamedTuple):
    """A polygon of a nest in map metres: closed (n, 2) rings, the exterior counter-clockwise, holes clockwise."""

    nest: int
    exterior: NDArray[np.float64]
    holes: tuple[NDArray[np.float64], ...]


class Gap(NamedTuple):
    """The narrowest gap found between two neighbouring nests: a cell of each, and the metres between them."""

    from_nest: int
    to_nest: int
    from_cell: Cell
    to_cell: Cell
    distance_m: float


class Navigability(NamedTuple):
    """Whether ground is navigable.

    Attributes:
        navigable: the answer in the mode of the grids.
        grids: for each grid, whether every cell that the footprint touches lies in a nest of it.
        disagreement: whether one grid alone of several says yes: a reason to drive at half speed.
    """

    navigable: bool
    grids: tuple[bool, ...]
    disagreement: bool


class OverlappingGrids:
    """Grids of navigation cells, four robot sizes wide, a part of a cell apart, in a window that follows the robot.

    A navigation cell is suitable when every terrain cell that it touches is suitable, so what any of the grids holds is
    free ground, and a second grid finds gaps that the first one misses. All grids are made from the same ranks. They
    hold what the map says, never what sensors see.
    """

    def __init__(
        self,
        rank: ArrayLike,
        geometry: GridGeometry,
        position: Position,
        *,
        vehicle: Vehicle | None = None,
        size_m: float | None = None,
        reading: Literal["side", "area"] = "side",
        mode: GridMode = "or",
        phases: Sequence[tuple[float, float]] | None = None,
        window_cells: int | None = None,
        rank_min: int = 6,
    ) -> None:
        """Make the grids from a rank map, in a window around a position.

        Args:
            rank: rank of every terrain cell, 0 to 10.
            geometry: geometry of the terrain; the first grid begins at its north-west corner.
            position: what the window is laid around.
            vehicle: its circumscribed diameter is the robot's size, unless ``size_m`` is given.
            size_m: the robot's size, above 0.
            reading: "four robot sizes" as the ``side`` of a cell, or as its ``area`` (the side is two sizes).
            mode: ``or`` (some grid holds the footprint), ``and`` (every grid), ``single`` (the first alone) or
                ``exact16`` (some of all sixteen quarter phases).
            phases: 1 to 64 shares of a cell, at least 0 and below 1, by which each grid lies (east, south) of the
                first; the usual ones are ``DIAGONAL_PHASES``, better ones ``HALF_PHASES``.
            window_cells: navigation cells across the window, 2 to 512; usually 32.
            rank_min: lowest suitable rank, 2 to 10.

        Raises:
            UsageError: a parameter is outside its range, neither vehicle nor size is given, or the rank map is not of
                this geometry.
        """
        if size_m is None:
            if vehicle is None:
                raise InvalidParameterError("The robot's size is not known.", "Give a vehicle or size_m.")
            size_m = 2 * vehicle.circumscribed_radius_m
        if window_cells is not None and window_cells < 0:
            raise InvalidParameterError(f"A window of {window_cells} cells is not usable.", "Give 2 to 512.")
        self._geometry = geometry
        self._rank = self._ranks_of(rank)
        params = {
            "size_m": size_m,
            "reading": reading,
            "mode": mode,
            "phases": None if phases is None else [(float(east), float(south)) for east, south in phases],
            "window_cells": window_cells,
            "rank_min": _rank(rank_min),
        }
        shape = (geometry.rows, geometry.columns, geometry.cell_size_m, geometry.west_m, geometry.north_m)
        self._core = _core.OverlappingGrids(self._rank, shape, _place(position), params)

    @property
    def phases(self) -> tuple[tuple[float, float], ...]:
        """Shares of a cell by which each grid lies east and south of the first."""
        return tuple(self._core.phases())

    def navigable(
        self,
        position: Position,
        *,
        heading_rad: float = 0.0,
        radius_m: float | None = None,
        rectangle_m: tuple[float, float] | None = None,
    ) -> Navigability:
        """Return whether a robot at this pose, a disc or a (length, width) along its heading, is on navigable ground.

        Ground outside the window or the terrain is not, and neither is a pose that is not finite.

        Raises:
            InvalidParameterError: not one of radius and rectangle is given, or a length is not finite or below 0.
        """
        answer, grids, disagreement = self._core.navigable(_place(position), heading_rad, radius_m, rectangle_m)
        return Navigability(answer, tuple(grids), disagreement)

    def recentre(self, position: Position) -> int:
        """Move the window and evaluate what came in; return how many terrain cells were evaluated.

        The result equals new grids at that position.

        Raises:
            InvalidParameterError: the position is not finite.
        """
        return self._core.recentre(self._rank, _place(position))

    def refresh(self, rank: ArrayLike, changed: Window) -> int:
        """Take a new rank map that differs inside ``changed`` alone; return how many terrain cells were evaluated.

        Raises:
            UsageError: the rank map is not of the terrain's geometry, or the window has a side below 0.
        """
        if min(changed) < 0:
            raise InvalidParameterError(f"The window {tuple(changed)} is not usable.", "Give counts of 0 or more.")
        self._rank = self._ranks_of(rank)
        row, column, rows, columns = changed
        return self._core.refresh(self._rank, (row, column, rows, columns))

    def geometry(self, grid: int) -> GridGeometry:
        """Return the geometry of a grid's cells in the window.

        Raises:
            InvalidParameterError: there is no grid of this number.
        """
        return GridGeometry(*self._core.geometry(self._number(grid)))

    def ranks(self, grid: int) -> NDArray[np.uint8]:
        """Return the least terrain rank under each cell of a grid, 0 where the cell reaches beyond the terrain.

        Raises:
            InvalidParameterError: there is no grid of this number.
        """
        ranks: NDArray[np.uint8] = self._core.ranks(self._number(grid))
        return ranks

    def nests(self, grid: int) -> Nests:
        """Return the nests of a grid in the window.

        Raises:
            InvalidParameterError: there is no grid of this number.
        """
        labels, sizes = self._core.nests(self._number(grid))
        return Nests(labels, np.asarray(sizes, dtype=np.uint32))

    def joined_nests(self) -> tuple[NDArray[np.uint32], ...]:
        """Return labels of every grid's cells, from 1 through all grids; 0 is no nest.

        Cells have one label when the robot gets from one to the other inside a grid, or from grid to grid where
        suitable cells overlap by at least its size along both axes.
        """
        return tuple(self._core.joined_nests())

    def _ranks_of(self, rank: ArrayLike) -> NDArray[np.uint8]:
        array = as_codes(rank, "rank map")
        if array.shape != self._geometry.shape:
            raise ShapeMismatchError(
                f"The rank map has the shape {array.shape} where the grid has {self._geometry.shape}.",
                "Give the geometry of the rank map.",
            )
        if array.max() > 10:
            raise InvalidParameterError(f"A rank of {array.max()} is not known.", "Give ranks from 0 to 10.")
        return array

    def _number(self, grid: int) -> int:
        if not 0 <= grid < len(self.phases):
            raise InvalidParameterError(f"There is no grid {grid}.", f"Give 0 to {len(self.phases) - 1}.")
        return grid


def gaps_found(
    shape: Literal["corridor", "pocket"],
    side_in_cells: float,
    *,
    mode: GridMode = "or",
    phases: Sequence[tuple[float, float]] = DIAGONAL_PHASES,
    trials: int = 1000,
    seed: int = 0,
) -> int:
    """Count how many of ``trials`` gaps at random places, above 0 and up to 2 navigation cells wide, the grids find.

    A ``corridor`` is limited in width alone, a ``pocket`` is a square. Each gap is drawn as terrain, grids are made
    from it, and it counts when some point of it is navigable. ``gap_share`` is what to expect.

    Raises:
        InvalidParameterError: a parameter is outside its range.
    """
    for name, value, low, high in (("number of trials", trials, 1, 1_000_000), ("seed", seed, 0, 2**64 - 1)):
        if not low <= value <= high:
            raise InvalidParameterError(f"The {name} of {value} is not usable.", f"Give {low} to {high}.")
    return _core.gaps_found(shape, side_in_cells, mode, list(phases), trials, seed)


def gap_share(
    shape: Literal["corridor", "pocket"],
    side_in_cells: float,
    *,
    mode: GridMode = "or",
    phases: Sequence[tuple[float, float]] = DIAGONAL_PHASES,
) -> float:
    """Return the share of all places of a gap at which the grids find it, exactly.

    Raises:
        InvalidParameterError: a parameter is outside its range.
    """
    return _core.gap_share(shape, side_in_cells, mode, list(phases))


def exact_nests(
    rank: ArrayLike,
    *,
    rank_min: int = 6,
    vicinity: str = "moore1",
    contact: Literal["edge", "corner", "overlap"] = "edge",
    border: Literal["unsuitable", "suitable"] = "unsuitable",
) -> Nests:
    """Return the nests of a rank map in one linear pass: what the swarm ends with, and the oracle beside it.

    Raises:
        UsageError: the ranks are not (rows, columns) of 0 to 10, or a parameter is outside its range.
    """
    array = as_codes(rank, "rank map")
    labels, sizes = _core.exact_nests(array, asdict(NestParams(_rank(rank_min), vicinity, contact, border)))
    return Nests(labels, np.asarray(sizes, dtype=np.uint32))


def outlines(nests: Nests, geometry: GridGeometry, *, least_cells: int = 1) -> list[Outline]:
    """Return the outlines of nests of at least ``least_cells`` as polygons along cell edges.

    Parts of a nest that touch only at corners are polygons of their own, and no ring touches itself.

    Raises:
        ShapeMismatchError: the nests are not of this geometry.
        InvalidParameterError: ``least_cells`` is below 1.
    """
    if least_cells < 1:
        raise InvalidParameterError(f"A least size of {least_cells} cells is not usable.", "Give 1 or more.")
    found = _core.outlines(nests.labels, _shape(nests, geometry), least_cells)
    return [_outline(nest, exterior, holes) for nest, exterior, holes in found]


def nest_graph(nests: Nests, geometry: GridGeometry) -> list[Gap]:
    """Return the gaps between nests that lie next to each other, ordered by nests.

    The distance is that of the cells from which fronts growing over 8 neighbours meet; it can exceed the nearest
    pair's by some per cent.

    Raises:
        ShapeMismatchError: the nests are not of this geometry.
    """
    return [
        Gap(a, b, Cell(*from_cell), Cell(*to_cell), distance_m)
        for a, b, from_cell, to_cell, distance_m in _core.nest_graph(nests.labels, _shape(nests, geometry))
    ]


def _outline(nest: int, exterior: _Ring, holes: list[_Ring]) -> Outline:
    outer, *parts = _simple_rings(exterior)
    inner = [*parts, *(ring for hole in holes for ring in _simple_rings(hole))]
    return Outline(nest, outer, tuple(inner))


def _simple_rings(ring: _Ring) -> list[NDArray[np.float64]]:
    """Cut a closed ring where it touches itself; the ring around all others comes first.

    The core follows ground that meets at a corner as one ring; a polygon's rings may touch each other, but not
    themselves.
    """
    points = np.asarray(ring, dtype=np.float64)
    if len(np.unique(points[:-1], axis=0)) == len(points) - 1:
        return [points]
    found: list[NDArray[np.float64]] = []
    walk: list[tuple[float, float]] = []
    place: dict[tuple[float, float], int] = {}
    for point in ring:
        if point in place:
            start = place[point]
            found.append(np.asarray([*walk[start:], point], dtype=np.float64))
            for dropped in walk[start + 1 :]:
                del place[dropped]
            del walk[start + 1 :]
        else:
            place[point] = len(walk)
            walk.append(point)
    return sorted(found, key=lambda part: -float(np.ptp(part[:, 0]) * np.ptp(part[:, 1])))


def _shape(nests: Nests, geometry: GridGeometry) -> tuple[int, int, float, float, float]:
    if nests.labels.shape != geometry.shape:
        raise ShapeMismatchError(
            f"The nests have the shape {nests.labels.shape} where the grid has {geometry.shape}.",
            "Give the geometry on which the nests were found.",
        )
    return (geometry.rows, geometry.columns, geometry.cell_size_m, geometry.west_m, geometry.north_m)


def _place(position: Position) -> tuple[float, float]:
    x_m, y_m = position
    return (x_m, y_m)


def _rank(value: int) -> int:
    if not 2 <= value <= 10:
        raise InvalidParameterError(f"A lowest suitable rank of {value} is not usable.", "Give 2 to 10.")
    return value
