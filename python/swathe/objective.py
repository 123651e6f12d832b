"""What a way should save: time, energy, risk or a weighted sum of them, and the user's own factor on costs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.terrain import slope

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from swathe.rank import Region

    #: Called once for each block with its rows, its columns and its layers; returns a factor for each of its cells.
    CostFunction: TypeAlias = Callable[[slice, slice, dict[str, NDArray[Any]]], ArrayLike]

Word = Literal["time", "energy", "risk"]

_BLOCK_CELLS = 256
_MOST_FACTOR = float(np.finfo(np.float32).max)


@dataclass(frozen=True, slots=True)
class Objective:
    """Weights of what a way costs.

    The sum is in seconds: cost = time * t + energy * E / P + risk * sum of t * max(0, 1 - d / d0)**2, with the seconds
    t, the joules E over the vehicle's rated power P (``power_w``; energy counts as the seconds that this power takes to
    deliver it), and the distance d to the nearest no-go or unknown cell.

    Attributes:
        time: weight of a second of driving, 0 to 1,000,000.
        energy: weight of a second of rated power, the same range.
        risk: weight of a second right beside no-go ground, the same range.
        risk_distance_m: the distance d0 from which no-go ground counts, up to 64 cells; when None, twice the radius
            of the circle around the vehicle, at least 3 and at most 64 cells.
    """

    time: float = 1.0
    energy: float = 0.0
    risk: float = 0.0
    risk_distance_m: float | None = None

    @property
    def text(self) -> str:
        """The objective as ``--objective`` takes it: a word, or weights such as ``time=1,energy=0.5``."""
        for word, weights in _WORDS.items():
            if self == Objective(**weights):
                return word
        weights = {"time": self.time, "energy": self.energy, "risk": self.risk}
        given = [f"{name}={weight:g}" for name, weight in weights.items() if weight]
        return ",".join(given + ([] if self.risk_distance_m is None else [f"risk_distance_m={self.risk_distance_m:g}"]))

    def core_argument(self) -> tuple[float, float, float, float | None]:
        """Return the weights as the core takes them."""
        return (self.time, self.energy, self.risk, self.risk_distance_m)


# Nearness to no-go ground alone measures nothing on open ground: risk adds it to the time, once.
_WORDS: dict[str, dict[str, float]] = {
    "time": {"time": 1.0},
    "energy": {"time": 0.0, "energy": 1.0},
    "risk": {"time": 1.0, "risk": 1.0},
}
_WEIGHTS = ("time", "energy", "risk", "risk_distance_m")
_REMEDY = "Give time, energy or risk, or weights such as time=1,energy=0.5."


def as_objective(given: Objective | Word | str | Mapping[str, float]) -> Objective:
    """Return the objective that a word, a text of weights or a mapping of weights stands for.

    ``time`` is the quickest way, ``energy`` the one of least energy, ``risk`` the quickest when every second near no-go
    ground counts up to twice. Weights that are not named are 0.

    >>> as_objective("time=1,energy=0.5").energy
    0.5

    Raises:
        InvalidParameterError: a word or weight is not known, or no weight of time or energy is above 0.
    """
    if isinstance(given, Objective):
        return _checked(given)
    if isinstance(given, str):
        if given in _WORDS:
            return Objective(**_WORDS[given])
        given = _weights_of(given)
    if not isinstance(given, Mapping):
        raise InvalidParameterError(f"The objective {given!r} is neither a word nor weights.", _REMEDY)
    weights: dict[str, Any] = {"time": 0.0, **given}
    unknown = [name for name in weights if name not in _WEIGHTS]
    if unknown:
        raise InvalidParameterError(f"The objective knows no {unknown[0]!r}.", _REMEDY)
    return _checked(Objective(**weights))


def _weights_of(text: str) -> dict[str, float]:
    weights: dict[str, float] = {}
    for part in text.split(","):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        try:
            number = float(value)
        except ValueError:
            equals = ""
        if not equals or name in weights:
            raise InvalidParameterError(f"The objective {text!r} is not understood at {part.strip()!r}.", _REMEDY)
        weights[name] = number
    return weights


def _checked(objective: Objective) -> Objective:
    """Return the objective with plain numbers; their ranges are the core's to check."""
    numbers: dict[str, float | None] = {}
    for name in _WEIGHTS:
        value = getattr(objective, name)
        if value is None and name == "risk_distance_m":
            numbers[name] = None
        elif isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
            raise InvalidParameterError(f"The objective's {name} of {value!r} is not a number.", _REMEDY)
        else:
            numbers[name] = float(value)
    return Objective(**numbers)  # type: ignore[arg-type]


def cost_factor(region: Region, cost: ArrayLike | CostFunction) -> NDArray[np.float32]:
    """Return the factor on the cost of every cell of a region, from an array or a function of blocks.

    Args:
        region: the ground.
        cost: numbers of the region's shape, at least 0, NaN or infinite where the ground is closed; or a function
            ``f(rows, columns, layers)`` that is called once for each block of at most 256 x 256 cells with two slices
            and the block's layers (``elevation_m`` in metres, ``slope`` as rise over run, ``soil`` as codes of
            ``swathe.soil.SoilClass``; read-only) and returns such numbers for its cells.

    Raises:
        ShapeMismatchError: there is not one number for each cell.
        InvalidParameterError: a factor is negative, is no number or too large, every cell is closed, or the function
            raised.
    """
    if callable(cost):
        factor = np.empty(region.geometry.shape, dtype=np.float32)
        for block in _blocks(region):
            rows, columns, layers = block
            where = (
                f"for the block of rows {rows.start} to {rows.stop - 1}, columns {columns.start} to {columns.stop - 1}"
            )
            try:
                given = np.asarray(cost(rows, columns, layers))
            except Exception as error:
                raise InvalidParameterError(
                    f"The cost function failed {where}: {type(error).__name__}: {error}.", "Correct the function."
                ) from error
            shape = (rows.stop - rows.start, columns.stop - columns.start)
            factor[rows, columns] = _factors(
                given, shape, f"The cost function's answer {where}", (rows.start, columns.start)
            )
    else:
        factor = _factors(np.asarray(cost), region.geometry.shape, "The cost raster", (0, 0))
    if not np.isfinite(factor).any():
        raise InvalidParameterError("The cost closes every cell.", "Give a finite factor where the ground is open.")
    return factor


def _blocks(region: Region) -> list[tuple[slice, slice, dict[str, NDArray[Any]]]]:
    height, width = region.geometry.shape
    steep = slope(region.elevation_m, region.geometry.cell_size_m)
    soil = np.zeros((height, width), dtype=np.uint8) if region.soil is None else region.soil
    found = []
    for top in range(0, height, _BLOCK_CELLS):
        for left in range(0, width, _BLOCK_CELLS):
            rows, columns = slice(top, min(top + _BLOCK_CELLS, height)), slice(left, min(left + _BLOCK_CELLS, width))
            layers: dict[str, NDArray[Any]] = {
                name: layer[rows, columns].view()
                for name, layer in (("elevation_m", region.elevation_m), ("slope", steep), ("soil", soil))
            }
            for layer in layers.values():
                layer.flags.writeable = False
            found.append((rows, columns, layers))
    return found


def _factors(given: NDArray[Any], shape: tuple[int, int], what: str, origin: tuple[int, int]) -> NDArray[np.float32]:
    if given.shape != shape:
        raise ShapeMismatchError(
            f"{what} has the shape {given.shape} where {shape} is needed.", "Give one number a cell."
        )
    if given.dtype.kind not in "iuf":
        raise InvalidParameterError(f"{what} holds {given.dtype}, not numbers.", "Give factors of at least 0.")
    numbers = given.astype(np.float64)
    for wrong, why, remedy in (
        (numbers < 0, "is negative", "Mark closed cells with NaN or infinity instead."),
        (np.isfinite(numbers) & (numbers > _MOST_FACTOR), "is too large", "Mark closed cells with NaN or infinity."),
    ):
        if wrong.any():
            row, column = (int(index) for index in np.argwhere(wrong)[0])
            raise InvalidParameterError(
                f"{what} {why} at cell ({row + origin[0]}, {column + origin[1]}): {numbers[row, column]:g}.", remedy
            )
    return numbers.astype(np.float32)


def closed_where(region: Region, factor: NDArray[np.float32] | None) -> Region:
    """Return the region with zones where a factor closes the ground, so that nests keep out of it."""
    if factor is None:
        return region
    closed = ~np.isfinite(factor)
    if region.zones is not None:
        closed |= region.zones
    if not closed.any() or (region.zones is not None and (closed == region.zones).all()):
        return region
    return replace(region, zones=closed)
