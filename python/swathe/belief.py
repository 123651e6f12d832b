"""Soil belief: what penetrometer readings and the soil map together say of the ground.

A belief starts from the soil map, takes readings in any order, and keeps for one vehicle the soil code of every cell
that ranking should use. Codes carry the go/no-go decision: ranks made from them at the same moisture have it in them.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import asdict, dataclass, field
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, MissingFileError, ShapeMismatchError, UnreadableFileError
from swathe.grid import as_codes
from swathe.soil import SoilClass
from swathe.vehicle import Vehicle, load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from swathe.grid import Cell, GridGeometry

#: The classes that a belief tells apart, in the order of all its probabilities.
CLASSES: tuple[SoilClass, ...] = tuple(SoilClass(code) for code in _core.belief_classes())

_DEFAULTS: dict[str, Any] = _core.belief_defaults()
_FIGURES = (
    "cone_index_kpa",
    "cone_index_spread_ln",
    "gradient_kpa_per_m",
    "roughness",
    "refusal",
    "remoulding_index",
)
#: Patches of cells that share edges: nests of single cells.
_PATCHES = {"rank_min": 10, "vicinity": "cell", "contact": "edge", "border": "unsuitable"}


@dataclass(frozen=True, slots=True)
class SoilType:
    """What a penetrometer meets on one soil class, over the layer that carries the vehicle.

    Attributes:
        cone_index_kpa: median of the mean cone index.
        cone_index_spread_ln: standard deviation of its natural logarithm, above 0.
        gradient_kpa_per_m: rise with depth and its standard deviation.
        roughness: standard deviation about the straight line over the mean, and its own standard deviation.
        refusal: chance that the cone is refused within the layer, above 0 and below 1.
        remoulding_index: rating cone index over cone index, above 0 and at most 1.
        source: where the figures come from.
    """

    cone_index_kpa: float
    cone_index_spread_ln: float
    gradient_kpa_per_m: tuple[float, float]
    roughness: tuple[float, float]
    refusal: float
    remoulding_index: float
    source: str = "estimate"

    def _row(self) -> tuple[float, ...]:
        return (
            self.cone_index_kpa,
            self.cone_index_spread_ln,
            *self.gradient_kpa_per_m,
            *self.roughness,
            self.refusal,
            self.remoulding_index,
        )


def load_soil_types(path: str | Path | None = None) -> dict[SoilClass, SoilType]:
    """Return the table of soil types: the bundled ``soil_types.toml``, or one of the same form.

    Raises:
        MissingFileError: the file does not exist.
        UnreadableFileError: it is no TOML.
        InvalidParameterError: a class or figure is missing, unknown or not a number.
    """
    if path is None:
        name, text = "soil_types.toml", resources.files("swathe").joinpath("soil_types.toml").read_text("utf-8")
    else:
        name, file = str(path), Path(path)
        if not file.is_file():
            raise MissingFileError(f"The table of soil types {name} does not exist.", "Check the path.")
        try:
            text = file.read_text("utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise UnreadableFileError(
                f"The table of soil types {name} cannot be read.", "Give a TOML file in UTF-8."
            ) from error
    try:
        stored = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UnreadableFileError(
            f"The table of soil types {name} is not valid TOML: {error}.", "Correct the line that is named."
        ) from error
    known = {soil.name.lower(): soil for soil in CLASSES}
    wrong = sorted(known.keys() ^ stored.keys())
    if wrong:
        raise InvalidParameterError(
            f"The table of soil types {name} has missing or unknown sections: {', '.join(wrong)}.",
            f"Give one for each of {', '.join(known)}.",
        )
    return {soil: _soil_type(name, section, stored[section]) for section, soil in known.items()}


def _soil_type(name: str, section: str, figures: object) -> SoilType:
    def refuse(what: str) -> InvalidParameterError:
        return InvalidParameterError(
            f"In the table of soil types {name}, [{section}] {what}.", "The bundled soil_types.toml shows the form."
        )

    if not isinstance(figures, dict):
        raise refuse("is not a section")
    wrong = sorted((set(_FIGURES) ^ figures.keys()) - {"source"})
    if wrong:
        raise refuse(f"has missing or unknown figures: {', '.join(wrong)}")
    read: dict[str, Any] = {"source": str(figures.get("source", "estimate"))}
    for figure in _FIGURES:
        value = figures[figure]
        pair = figure in {"gradient_kpa_per_m", "roughness"}
        numbers = value if pair and isinstance(value, list) else [value]
        if len(numbers) != 1 + pair or not all(
            isinstance(number, int | float) and not isinstance(number, bool) and math.isfinite(number)
            for number in numbers
        ):
            raise refuse(f"{figure} must be {'two numbers, middle and deviation' if pair else 'a number'}")
        read[figure] = tuple(map(float, numbers)) if pair else float(value)
    if read["cone_index_kpa"] <= 0:
        raise refuse("cone_index_kpa must be above 0")
    return SoilType(**read)


@dataclass(frozen=True, slots=True)
class BeliefParams:
    """How readings change a belief. All defaults are estimates of this project (docs/belief.md).

    Attributes:
        rule: ``bayes``, or ``paper_relabel``: the observed class replaces the polygon's.
        relabel_radius_m: with ``paper_relabel``, how far a reading reaches; None for its whole polygon.
        matching: a bare profile counts by the ``table`` of soil types, or by the best match and the ``confusion``.
        confusion: chance that a class (row) is observed as another (column), in the order of ``CLASSES``.
        purity: share of a mapped polygon that is of its mapped class.
        map_weight: readings that the map is worth.
        length_m: distance over which a reading's direct say falls to 1/e.
        same_symbol_share: what a reading adds to other polygons of the same map symbol.
        layer_depth_m: depth of the layer that carries the vehicle.
        refusal_kpa: cone index from which the ground refuses the cone.
        refusal_depth_m: depth within which refusal speaks for rock.
        goodness_confidence: probability that the soil is at least as good as its goodness.
        no_go_tolerance: greatest probability of ground that does not carry the vehicle.
        table_spread_ln: standard deviation of the logarithm of true strength about the class's table.
        reading_spread_ln: the same of a measured cone index about the strength of its place.
        far_strength_weight: say of a reading in the strength of its class far away in its polygon, 0 to 1.
        types: the table of soil types.
    """

    rule: Literal["bayes", "paper_relabel"] = "bayes"
    relabel_radius_m: float | None = None
    matching: Literal["table", "confusion"] = "table"
    confusion: tuple[tuple[float, ...], ...] = tuple(tuple(row) for row in _DEFAULTS["confusion"])
    purity: float = _DEFAULTS["purity"]
    map_weight: float = _DEFAULTS["map_weight"]
    length_m: float = _DEFAULTS["length_m"]
    same_symbol_share: float = _DEFAULTS["same_symbol_share"]
    layer_depth_m: float = _DEFAULTS["layer_depth_m"]
    refusal_kpa: float = _DEFAULTS["refusal_kpa"]
    refusal_depth_m: float = _DEFAULTS["refusal_depth_m"]
    goodness_confidence: float = _DEFAULTS["goodness_confidence"]
    no_go_tolerance: float = _DEFAULTS["no_go_tolerance"]
    table_spread_ln: float = _DEFAULTS["table_spread_ln"]
    reading_spread_ln: float = _DEFAULTS["reading_spread_ln"]
    far_strength_weight: float = _DEFAULTS["far_strength_weight"]
    types: Mapping[SoilClass, SoilType] = field(default_factory=load_soil_types)

    def core_arguments(self) -> dict[str, Any]:
        """Return the parameters as the core takes them."""
        missing = [soil.name.lower() for soil in CLASSES if soil not in self.types]
        if missing:
            raise InvalidParameterError(
                f"The table of soil types lacks {', '.join(missing)}.", "Start from load_soil_types()."
            )
        size = len(CLASSES)
        if len(self.confusion) != size or any(len(row) != size for row in self.confusion):
            raise InvalidParameterError(
                f"The confusion matrix is not {size} x {size}.", "Give a row and a column for each class."
            )
        arguments = {name: getattr(self, name) for name in _DEFAULTS}
        return arguments | {
            "rule": self.rule,
            "relabel_radius_m": self.relabel_radius_m,
            "matching": self.matching,
            "types": [self.types[soil]._row() for soil in CLASSES],  # noqa: SLF001  # one module
        }


@dataclass(frozen=True, slots=True)
class PenetrometerReading:
    """One push of a cone penetrometer, in the map's metres.

    Attributes:
        x_m: east.
        y_m: north.
        depths_m: depths of the samples, rising, 0 to 5 m.
        cone_indices_kpa: cone index at each, 0 to 100 000 kPa.
        refusal_depth_m: depth at which the cone could not be pushed on.
        sleeve_frictions_kpa: sleeve friction at each depth, where it is measured.
    """

    x_m: float
    y_m: float
    depths_m: tuple[float, ...] = ()
    cone_indices_kpa: tuple[float, ...] = ()
    refusal_depth_m: float | None = None
    sleeve_frictions_kpa: tuple[float, ...] | None = None

    def validate(self) -> None:
        """Raise InvalidParameterError naming the first figure that is missing or outside its physical range."""
        _core.check_reading(self._row())

    def _row(self) -> tuple[float, float, list[float], list[float], float | None, list[float] | None]:
        sleeve = self.sleeve_frictions_kpa
        return (
            float(self.x_m),
            float(self.y_m),
            [float(value) for value in self.depths_m],
            [float(value) for value in self.cone_indices_kpa],
            self.refusal_depth_m,
            None if sleeve is None else [float(value) for value in sleeve],
        )


@dataclass(frozen=True, slots=True)
class ClassReading:
    """Somebody's word on the soil of a place, in the map's metres."""

    x_m: float
    y_m: float
    soil_class: SoilClass


@dataclass(frozen=True, slots=True)
class Match:
    """What a reading says.

    ``likelihood`` has one figure for each of ``CLASSES``, 1 for the best; ``cone_index_kpa`` is None where refused.
    """

    likelihood: tuple[float, ...]
    observed: SoilClass
    cone_index_kpa: float | None


def match_profile(reading: PenetrometerReading, params: BeliefParams | None = None) -> Match:
    """Return what a reading says of the soil: by refusal, else by sleeve friction, else by its features.

    Raises:
        InvalidParameterError: the reading is not physical, or has no sample in the layer that carries the vehicle.
    """
    arguments = (params or BeliefParams()).core_arguments()
    likelihood, observed, cone_index_kpa = _core.match_profile(reading._row(), arguments)  # noqa: SLF001  # one module
    return Match(tuple(likelihood), SoilClass(observed), cone_index_kpa)


@dataclass(frozen=True, slots=True)
class Unit:
    """One polygon of the soil map.

    Attributes:
        soil_class: its mapped class.
        symbol: its map symbol; polygons of one symbol learn from each other. Empty for none.
        shares: instead of the class, the share of each class, summing to 1 (map components with their percentages).
    """

    soil_class: SoilClass = SoilClass.UNKNOWN
    symbol: str = ""
    shares: Mapping[SoilClass, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Changed:
    """Where a belief has changed.

    Attributes:
        reading: number of the reading that was added or withdrawn.
        units: numbers of the polygons whose belief may differ; 0 is ground without a polygon.
        cells: indices (row-major) of the cells whose belief may differ.
        code_cells: indices of the cells whose soil code differs now.
        codes: their new codes.
    """

    reading: int
    units: tuple[int, ...]
    cells: NDArray[np.uint32]
    code_cells: NDArray[np.uint32]
    codes: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Decision:
    """What a vehicle may count on at a cell.

    Attributes:
        code: the class that ranking takes: where the ground carries the vehicle, the best one that is no better than
            ``goodness`` and carries it by the table; else one that fails.
        goodness: greatest goodness 1 to 5 reached with the confidence asked for.
        no_go_probability: probability that the ground does not carry the vehicle.
        go: whether that is no more than what is tolerated.
    """

    code: SoilClass
    goodness: int
    no_go_probability: float
    go: bool


@dataclass(frozen=True, slots=True)
class ProbeValue:
    """What a reading is worth before it is taken: the expected saving of route cost, and its parts by observation."""

    expected_saving: float
    chances: tuple[float, ...]
    savings: tuple[float, ...]


def units_of_classes(soil: ArrayLike) -> tuple[NDArray[np.uint32], dict[int, Unit]]:
    """Return units for a soil layer of class codes: every connected patch (four neighbours) of a class is a polygon.

    Unknown soil has no polygon. Patches of one class share a symbol.
    """
    codes = np.asarray(soil)
    if codes.ndim != 2 or codes.size == 0:
        raise ShapeMismatchError(f"The soil has the shape {codes.shape}.", "Give an array of rows and columns.")
    layer = np.zeros(codes.shape, dtype=np.uint32)
    units: dict[int, Unit] = {}
    for code in np.unique(codes):
        if code == SoilClass.UNKNOWN:
            continue
        inside = codes == code
        patches, sizes = _core.exact_nests(np.where(inside, 10, 1).astype(np.uint8), _PATCHES)
        layer[inside] = patches[inside] + np.uint32(len(units))
        soil_class = SoilClass(int(code))
        first = len(units) + 1
        units |= {number: Unit(soil_class, soil_class.name.lower()) for number in range(first, first + len(sizes))}
    return layer, units


def core_units(units: Mapping[int, Unit]) -> list[tuple[int, int, int, list[float] | None]]:
    """Return polygons as the core takes them.

    Raises:
        InvalidParameterError: a number is none of a polygon.
    """
    symbols = {symbol: number for number, symbol in enumerate(sorted({u.symbol for u in units.values()} - {""}), 1)}
    rows = []
    for number, unit in units.items():
        if not 0 < number <= 0xFFFFFFFF:
            raise InvalidParameterError(f"{number} is no number of a polygon.", "Number polygons from 1 on.")
        shares = None if unit.shares is None else [float(unit.shares.get(soil, 0.0)) for soil in CLASSES]
        rows.append((number, symbols.get(unit.symbol, 0), int(unit.soil_class), shares))
    return rows


class SoilBelief:
    """What is believed of the soil, with the decisions for one vehicle kept up to date.

    Args:
        geometry: where the cells lie.
        layer: (rows, columns) number of each cell's polygon, 0 for none.
        units: the polygons by number.
        vehicle: the vehicle, its name or file.
        moisture_percent: gravimetric moisture of the soil, 1 to 200 %; rank with the same.
        soil_table: goodness of silt by the paper's ``text`` or its ``table2``.
        params: how readings count.

    Raises:
        UsageError: a figure is outside its range, or a polygon of the layer is not among the units.
    """

    def __init__(
        self,
        geometry: GridGeometry,
        layer: ArrayLike,
        units: Mapping[int, Unit],
        vehicle: Vehicle | str | Path,
        *,
        moisture_percent: float = 20.0,
        soil_table: Literal["text", "table2"] = "text",
        params: BeliefParams | None = None,
    ) -> None:
        if soil_table not in {"text", "table2"}:
            raise InvalidParameterError(f"The soil table {soil_table!r} is not known.", "Give text or table2.")
        numbers = np.asarray(layer)
        if numbers.shape != geometry.shape:
            raise ShapeMismatchError(
                f"The layer of polygons has the shape {numbers.shape} where the grid has {geometry.shape}.",
                "Read all layers on one geometry.",
            )
        if numbers.dtype.kind not in "iu" or int(numbers.min()) < 0 or int(numbers.max()) > 0xFFFFFFFF:
            raise InvalidParameterError(
                "The layer of polygons does not hold numbers from 0 to 4294967295.", "Number the polygons."
            )
        machine = vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
        self.geometry = geometry
        self.params = params or BeliefParams()
        self._core = _core.SoilBelief(
            (geometry.rows, geometry.columns, geometry.cell_size_m, geometry.west_m, geometry.north_m),
            np.ascontiguousarray(numbers, dtype=np.uint32),
            core_units(units),
            self.params.core_arguments(),
            machine.core.cone_index()[0],
            float(moisture_percent),
            soil_table == "table2",
        )

    def add(self, reading: PenetrometerReading | ClassReading) -> Changed:
        """Take a reading into account. The order of readings does not matter.

        Raises:
            UsageError: the reading is not physical, says nothing, or lies outside the map.
        """
        if isinstance(reading, ClassReading):
            found = self._core.add_class(float(reading.x_m), float(reading.y_m), int(reading.soil_class))
        else:
            found = self._core.add_reading(reading._row())  # noqa: SLF001  # one module
        return _changed(found)

    def withdraw(self, reading: int) -> Changed:
        """Forget a reading by its number."""
        if reading < 0:
            raise InvalidParameterError(f"There is no reading {reading}.", "Give a number that `add` returned.")
        return _changed(self._core.withdraw(reading))

    def class_probabilities(self, cell: Cell | tuple[int, int]) -> tuple[float, ...]:
        """Return the probability of each of ``CLASSES`` at a cell; they sum to 1."""
        row, column = cell
        return tuple(self._core.class_probabilities(row, column))

    def decide(self, cell: Cell | tuple[int, int]) -> Decision:
        """Return what the vehicle may count on at a cell."""
        row, column = cell
        code, goodness, chance, go = self._core.decide(row, column)
        return Decision(SoilClass(code), goodness, chance, go)

    def soil(self) -> NDArray[np.uint8]:
        """Return the soil codes of all cells: a soil layer for ``swathe.rank.Region``."""
        codes: NDArray[np.uint8] = self._core.decisions()[0]
        return codes

    def soil_beside(self, mapped: ArrayLike) -> NDArray[np.uint8]:
        """Return the soil codes of all cells beside those of a map, as a drive that learns has them.

        Where nothing was measured the map's word stands; what was measured must speak against it before it is left.
        ``mapped``: (rows, columns) codes of ``swathe.soil.SoilClass``.

        Raises:
            ShapeMismatchError: the map has other cells.
        """
        codes = as_codes(mapped, "soil map")
        if codes.shape != self.geometry.shape:
            raise ShapeMismatchError(
                f"The soil map has the shape {codes.shape}, the belief {self.geometry.shape}.", "Give the same cells."
            )
        found: NDArray[np.uint8] = self._core.codes_beside(codes)
        return found

    def no_go(self) -> NDArray[np.bool_]:
        """Return whether each cell is too likely not to carry the vehicle."""
        closed: NDArray[np.bool_] = self._core.decisions()[1]
        return closed

    def probe_value(
        self,
        cell: Cell | tuple[int, int],
        price: Callable[[NDArray[np.uint32], NDArray[np.uint8]], tuple[float, float]],
        *,
        dead_end_cost: float,
    ) -> ProbeValue:
        """Return the expected saving of route cost by a reading at a cell.

        Args:
            cell: where the reading would be taken.
            price: for each class that may be observed it is given the cells (indices, row-major) whose soil code would
                change and their new codes, and returns the cost of the present route and of the best one; infinite
                where there is none.
            dead_end_cost: what a present route costs that turns out closed.
        """
        row, column = cell
        saving, chances, savings = self._core.probe_value(row, column, float(dead_end_cost), price)
        return ProbeValue(saving, tuple(chances), tuple(savings))


def next_probe(
    policy: str,
    candidates: Sequence[Cell],
    value: Callable[[Cell], float],
    *,
    here: Cell,
    since_last_m: float,
) -> Cell | None:
    """Return where to take the next reading, or None for none now.

    Args:
        policy: ``never``, ``every N m`` (metres driven since the last reading), ``where it matters``: the candidate
            whose reading is expected to save most, ``where it pays``: the first whose reading is expected to save
            anything; with ``above C`` behind it only when that exceeds the cost C.
        candidates: cells that could be probed, in the order in which they are met.
        value: expected saving at a candidate, for instance by ``SoilBelief.probe_value``.
        here: the robot's cell.
        since_last_m: metres since the last reading.
    """
    word, figure = probing_policy(policy)
    found = _core.next_probe(
        word, figure, float(since_last_m), len(candidates), lambda place: float(value(candidates[place]))
    )
    if found is None:
        return None
    return here if found < 0 else candidates[found]


def probing_policy(text: str) -> tuple[str, float]:
    """Return a probing policy as the core takes it: its word and its figure.

    Raises:
        InvalidParameterError: it is none of ``never``, ``every N m``, ``where it matters [above C]`` and ``where it
            pays [above C]``.
    """
    words = text.split()
    try:
        if words == ["never"]:
            return "never", 0.0
        if len(words) == 3 and words[0] == "every" and words[2] == "m":
            return "every", float(words[1])
        place = "_".join(words[:3])
        if place in {"where_it_matters", "where_it_pays"} and len(words) in {3, 5} and words[3:4] in ([], ["above"]):
            return place, float(words[4]) if len(words) == 5 else 0.0
    except ValueError:
        pass
    raise InvalidParameterError(
        f"The probing policy {text!r} is not known.",
        "Give never, every N m, where it matters [above C], or where it pays [above C].",
    )


def _changed(found: tuple[int, list[int], Any, Any, Any]) -> Changed:
    reading, units, cells, code_cells, codes = found
    return Changed(reading, tuple(units), cells, code_cells, codes)


def as_dict(params: BeliefParams) -> dict[str, Any]:
    """Return the parameters as plain values for JSON."""
    plain = {name: value for name in params.core_arguments() if name != "types" for value in [getattr(params, name)]}
    return plain | {"types": {soil.name.lower(): asdict(kind) for soil, kind in params.types.items()}}
