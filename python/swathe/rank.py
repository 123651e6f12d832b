"""Rank of every cell: 0 unknown, 1 no-go, 2 (worst) to 10 (best), with the reason of every no-go.

Profile ``metric`` judges the slope against the vehicle's limits; ``paper`` follows the tables of Vckay, Aneja and
Deodhare on grey levels with the vehicle's limits and the paper's 25 % grade as gates; ``literal`` drops the gates.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.grid import Cell, GridGeometry, as_codes
from swathe.terrain import as_heights, group_mean, height_map
from swathe.vehicle import Vehicle, load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

Profile = Literal["metric", "paper", "literal"]

#: Reason names by code; code 0 is "none".
REASONS: tuple[str, ...] = tuple(_core.reasons())

#: Gravimetric moisture in per cent that the words stand for (estimates for fine-grained soil).
MOISTURE_PERCENT = {"dry": 15.0, "normal": 20.0, "wet": 35.0}


@dataclass(frozen=True, slots=True)
class RankParams:
    """How cells are ranked.

    Attributes:
        profile: ``metric``, ``paper`` or ``literal``.
        moisture_percent: gravimetric moisture of the soil, 1 to 200 %.
        soil_table: goodness of silt by the paper's ``text`` (2) or its ``table2`` (3).
        unknown_soil: ``neutral`` (goodness 3, no gate), ``avoid``, or the name of a soil class.
        combine: ``weighted`` sum (halves are the paper's eq. 1) or ``min``.
        height_weight: weight of the height goodness; with soil_weight it sums to 1.
        soil_weight: weight of the soil goodness.
        paper_grade: the paper's bound on safe travel, rise over run (profile ``paper``).
        directions: which differences count in Table I: ``worst``, ``mean`` or ``best`` of eight, or ``four``.
        bands: bins of Table I, ``symmetric`` or ``literal`` as printed.
        rounding: how real differences meet integer bins, ``half_away`` or ``real``.
    """

    profile: Profile = "metric"
    moisture_percent: float = 20.0
    soil_table: Literal["text", "table2"] = "text"
    unknown_soil: str = "neutral"
    combine: Literal["weighted", "min"] = "weighted"
    height_weight: float = 0.5
    soil_weight: float = 0.5
    paper_grade: float = 0.25
    directions: Literal["worst", "mean", "best", "four"] = "worst"
    bands: Literal["symmetric", "literal"] = "symmetric"
    rounding: Literal["half_away", "real"] = "half_away"

    def __post_init__(self) -> None:
        # The other words are checked by the core; this one decides there which parameters count.
        if self.combine not in ("weighted", "min"):
            raise InvalidParameterError(f"The combination {self.combine!r} is not known.", "Give weighted or min.")

    @property
    def rank_min(self) -> int:
        """Lowest suitable rank: 6 where gates hold, 7 in ``literal``, where 6 would let gravel cliffs pass."""
        return 7 if self.profile == "literal" else 6


def moisture_percent(text: str) -> float:
    """Return the moisture that ``dry``, ``normal``, ``wet`` or a number of per cent stands for."""
    if text in MOISTURE_PERCENT:
        return MOISTURE_PERCENT[text]
    try:
        return float(text)
    except ValueError:
        raise InvalidParameterError(
            f"The moisture {text!r} is not known.", "Give dry, normal, wet or a number of per cent."
        ) from None


@dataclass(frozen=True, eq=False)
class Region:
    """The layers that are ranked and planned on, with the vehicle and the rules.

    Attributes:
        geometry: where the cells lie.
        elevation_m: (rows, columns) float32 heights, NaN unknown.
        vehicle: the vehicle.
        soil: (rows, columns) uint8 codes of ``swathe.soil.SoilClass``, or None.
        grey: grey levels of the same cells, needed by the paper's profiles.
        zones: (rows, columns) bool, True where the ground is closed.
        params: how cells are ranked.
    """

    geometry: GridGeometry
    elevation_m: NDArray[np.float32]
    vehicle: Vehicle
    soil: NDArray[np.uint8] | None = None
    grey: NDArray[np.float32] | None = None
    zones: NDArray[np.bool_] | None = None
    params: RankParams = RankParams()

    def __post_init__(self) -> None:
        for name, layer in (
            ("elevation", self.elevation_m),
            ("soil", self.soil),
            ("height map", self.grey),
            ("zones", self.zones),
        ):
            if layer is not None and layer.shape != self.geometry.shape:
                raise ShapeMismatchError(
                    f"The {name} has the shape {layer.shape} where the grid has {self.geometry.shape}.",
                    "Read all layers on one geometry.",
                )

    @property
    def shape(self) -> tuple[int, int, float, float, float]:
        """(rows, columns, cell size, west, north) as the core takes it."""
        geometry = self.geometry
        return (geometry.rows, geometry.columns, geometry.cell_size_m, geometry.west_m, geometry.north_m)

    @cached_property
    def core(self) -> _core.Region:
        """The region as the core sees it."""
        return _core.Region(
            self.shape,
            np.ascontiguousarray(self.elevation_m, dtype=np.float32),
            None if self.soil is None else as_codes(self.soil, "soil"),
            None if self.grey is None else np.ascontiguousarray(self.grey, dtype=np.float32),
            None if self.zones is None else np.ascontiguousarray(self.zones, dtype=np.bool_),
            self.vehicle.core,
            asdict(self.params),
        )


@dataclass(frozen=True, eq=False)
class TiledRegion:
    """A region whose heights are read when they are first needed, for the planner.

    Attributes:
        geometry: where the cells lie.
        read: gives the float32 heights of (row, column, rows, columns), cells within one tile, or None when they
            cannot be read; called between two ticks, each tile once.
        vehicle: the vehicle.
        soil: (rows, columns) uint8 codes of ``swathe.soil.SoilClass``, or None.
        params: how cells are ranked; profile ``metric``.
        tile_size: side of a tile in cells, a power of two.
        first: row and column inside its tile of the cell in the north-west.
    """

    geometry: GridGeometry
    read: Callable[[int, int, int, int], NDArray[np.float32] | None]
    vehicle: Vehicle
    soil: NDArray[np.uint8] | None = None
    params: RankParams = RankParams()
    tile_size: int = 256
    first: tuple[int, int] = (0, 0)

    @cached_property
    def core(self) -> _core.Region:
        """The region as the core sees it. What was read stays in it."""
        geometry = self.geometry
        return _core.Region.tiled(
            (geometry.rows, geometry.columns, geometry.cell_size_m, geometry.west_m, geometry.north_m),
            self.tile_size,
            self.first,
            self.read,
            None if self.soil is None else as_codes(self.soil, "soil"),
            self.vehicle.core,
            asdict(self.params),
        )


@dataclass(frozen=True, eq=False)
class RankMap:
    """Ranks of a region: ``packed`` holds the rank in the low four bits and the reason's code in the high four."""

    packed: NDArray[np.uint8]

    @cached_property
    def rank(self) -> NDArray[np.uint8]:
        """0 unknown, 1 no-go, 2 (worst) to 10 (best)."""
        return self.packed & np.uint8(15)

    @cached_property
    def reason(self) -> NDArray[np.uint8]:
        """Why a cell is no-go or unknown: an index into ``REASONS``, 0 elsewhere."""
        return self.packed >> np.uint8(4)


def rank_map(region: Region, *, out: NDArray[np.uint8] | None = None) -> RankMap:
    """Rank every cell of a region in one parallel pass.

    Args:
        region: the ground.
        out: a writeable, contiguous array of the region's shape that takes the result, so that maps ranked again and
            again need no new memory.

    Raises:
        UsageError: a parameter is outside its range, or the layers or ``out`` do not fit.
    """
    if out is not None and (out.shape != region.geometry.shape or out.dtype != np.uint8):
        raise ShapeMismatchError(
            f"The array for the ranks has the shape {out.shape} and the type {out.dtype}.",
            f"Give one of uint8 with the shape {region.geometry.shape}.",
        )
    return RankMap(_core.rank_map(region.core, out))


def rank_cell(region: Region, cell: Cell) -> tuple[int, str]:
    """Rank one cell alone; the answer is that of ``rank_map``. Returns the rank and the name of the reason."""
    rank, reason = _core.rank_cell(region.core, cell.row, cell.column)
    return rank, REASONS[reason]


def rank_metric(
    elevation_m: ArrayLike,
    soil: ArrayLike | None,
    cell_size_m: float,
    vehicle: Vehicle | str | Path,
    params: RankParams | None = None,
) -> RankMap:
    """Rank a terrain that stands alone: ``rank_map`` for arrays without a map frame."""
    heights = as_heights(elevation_m)
    codes = None if soil is None else as_codes(soil, "soil")
    machine = vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
    geometry = GridGeometry(heights.shape[0], heights.shape[1], cell_size_m)
    return rank_map(Region(geometry, heights, machine, codes, params=params or RankParams()))


def grey_levels(elevation_m: NDArray[np.float32], group: Literal["8x8", "2x4", "none"]) -> NDArray[np.float32]:
    """Return the paper's averaged grey levels: 0-255 over the map's range, then means of groups of pixels."""
    return group_mean(height_map(elevation_m), group)


@dataclass(frozen=True, slots=True)
class Ahp:
    """Weights of an analytic hierarchy process.

    Attributes:
        weights: one per criterion, summing to 1.
        lambda_max: principal eigenvalue of the comparison matrix.
        consistency_ratio: 0 is perfect, up to 0.10 acceptable.
    """

    weights: tuple[float, ...]
    lambda_max: float
    consistency_ratio: float


def ahp(matrix: Sequence[Sequence[float]], *, force: bool = False) -> Ahp:
    """Return the weights of a reciprocal comparison matrix (Saaty 1980).

    ``matrix[i][j]`` says how much more criterion i counts than j, 1/9 to 9. Weights of (height, soil) go into
    ``RankParams(height_weight=..., soil_weight=...)``; equal comparisons reproduce the paper's eq. 1.

    Raises:
        InvalidParameterError: the matrix is not square and reciprocal, or its consistency ratio exceeds 0.10 and
            ``force`` is not set.
    """
    weights, lambda_max, ratio = _core.ahp([[float(value) for value in row] for row in matrix], force)
    return Ahp(tuple(weights), lambda_max, ratio)


def height_goodness(
    difference: float,
    *,
    bands: Literal["symmetric", "literal"] = "symmetric",
    rounding: Literal["half_away", "real"] = "half_away",
) -> int:
    """Return the goodness 5 (level) to 1 of a signed difference of grey levels: Table I of the paper."""
    return int(_core.height_goodness(difference, bands, rounding))


def as_dict(params: RankParams) -> dict[str, Any]:
    """Return the parameters as plain values for JSON."""
    return asdict(params)
