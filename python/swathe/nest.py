"""Nests: connected regions of suitable cells in which the vicinity of every core is suitable too."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.grid import Cell

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from swathe.grid import GridGeometry


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
    array = np.ascontiguousarray(rank, dtype=np.uint8)
    if array.ndim != 2:
        raise ShapeMismatchError(f"The rank map has the shape {array.shape}.", "Give an array of rows and columns.")
    labels, sizes = _core.exact_nests(array, asdict(NestParams(_rank(rank_min), vicinity, contact, border)))
    return Nests(labels, np.asarray(sizes, dtype=np.uint32))


def outlines(nests: Nests, geometry: GridGeometry, *, least_cells: int = 1) -> list[Outline]:
    """Return the outlines of nests of at least ``least_cells`` as polygons along cell edges."""
    found = _core.outlines(nests.labels, _shape(geometry), least_cells)
    return [
        Outline(nest, np.asarray(exterior), tuple(np.asarray(hole) for hole in holes))
        for nest, exterior, holes in found
    ]


def nest_graph(nests: Nests, geometry: GridGeometry) -> list[Gap]:
    """Return the gaps between nests that lie next to each other, ordered by nests."""
    return [
        Gap(a, b, Cell(*from_cell), Cell(*to_cell), distance_m)
        for a, b, from_cell, to_cell, distance_m in _core.nest_graph(nests.labels, _shape(geometry))
    ]


def _shape(geometry: GridGeometry) -> tuple[int, int, float, float, float]:
    return (geometry.rows, geometry.columns, geometry.cell_size_m, geometry.west_m, geometry.north_m)


def _rank(value: int) -> int:
    if not 2 <= value <= 10:
        raise InvalidParameterError(f"A lowest suitable rank of {value} is not usable.", "Give 2 to 10.")
    return value
