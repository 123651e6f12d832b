"""Nests: connected regions of suitable cells in which the vicinity of every core is suitable too."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.grid import Cell, as_codes

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from swathe.grid import GridGeometry


_Ring = list[tuple[float, float]]


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


def _rank(value: int) -> int:
    if not 2 <= value <= 10:
        raise InvalidParameterError(f"A lowest suitable rank of {value} is not usable.", "Give 2 to 10.")
    return value
