"""What readings make of the soil map, from the profile to the route."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swathe import _core
from swathe.belief import (
    CLASSES,
    BeliefParams,
    ClassReading,
    PenetrometerReading,
    SoilBelief,
    Unit,
    as_dict,
    load_soil_types,
    match_profile,
    next_probe,
    units_of_classes,
)
from swathe.errors import (
    InvalidParameterError,
    MissingFileError,
    OutsideGridError,
    ShapeMismatchError,
    UnreadableFileError,
)
from swathe.grid import Cell, GridGeometry
from swathe.planner import Path as Way
from swathe.planner import Replanner, shortest_path
from swathe.rank import REASONS, Region, rank_map
from swathe.soil import SoilClass
from swathe.vehicle import load_vehicle

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

UNKNOWN, GRAVEL, SAND, CLAY, SILT, ROCK, NONE = SoilClass
LETTERS = {".": UNKNOWN, "g": GRAVEL, "s": SAND, "c": CLAY, "i": SILT, "r": ROCK, "w": NONE}
CELL_M = 10.0


def drawn(rows: list[str]) -> tuple[GridGeometry, NDArray[np.uint8]]:
    codes = np.array([[LETTERS[letter] for letter in row] for row in rows], dtype=np.uint8)
    return GridGeometry(codes.shape[0], codes.shape[1], CELL_M, 0.0, codes.shape[0] * CELL_M), codes


def believed(
    rows: list[str], *, moisture: float = 20.0, params: BeliefParams | None = None, vehicle: str = "tractor"
) -> SoilBelief:
    geometry, codes = drawn(rows)
    layer, units = units_of_classes(codes)
    return SoilBelief(geometry, layer, units, vehicle, moisture_percent=moisture, params=params)


def push(x_m: float, y_m: float, *kpa: float, refusal_m: float | None = None) -> PenetrometerReading:
    return PenetrometerReading(x_m, y_m, tuple(0.05 * (n + 1) for n in range(len(kpa))), kpa, refusal_m)


def test_the_bundled_table_and_the_cores_are_one() -> None:
    types = load_soil_types()
    assert list(types) == list(CLASSES)
    assert [types[soil]._row() for soil in CLASSES] == [pytest.approx(row) for row in _core.soil_types()]
    assert all(soil.source for soil in types.values())


def test_a_table_of_ones_own_changes_what_a_profile_is_matched_to(tmp_path: Path) -> None:
    reading = push(5, 5, 560.0, 600.0, 640.0)
    assert match_profile(reading).observed is CLAY
    text = (_bundled_table()).replace("cone_index_kpa = 800.0", "cone_index_kpa = 8000.0")
    (tmp_path / "mine.toml").write_text(text)
    mine = BeliefParams(types=load_soil_types(tmp_path / "mine.toml"))
    assert match_profile(reading, mine).observed is SILT


def _bundled_table() -> str:
    from importlib import resources

    return resources.files("swathe").joinpath("soil_types.toml").read_text("utf-8")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[silt]", "[mud]", "mud"),
        ("refusal = 0.4", "", "refusal"),
        ("refusal = 0.4", 'refusal = "often"', r"\[gravel\] refusal"),
        ("[0.5, 0.2]", "0.5", "roughness must be two numbers"),
        ("cone_index_kpa = 800.0", "cone_index_kpa = -1", "above 0"),
        ("cone_index_kpa = 800.0", "cone_index_kpa = nan", "a number"),
    ],
)
def test_a_wrong_table_is_refused_by_name(tmp_path: Path, old: str, new: str, said: str) -> None:
    (tmp_path / "t.toml").write_text(_bundled_table().replace(old, new, 1))
    with pytest.raises(InvalidParameterError, match=said):
        load_soil_types(tmp_path / "t.toml")


def test_a_table_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError):
        load_soil_types(tmp_path / "none.toml")
    (tmp_path / "t.toml").write_text("[gravel")
    with pytest.raises(UnreadableFileError, match="not valid TOML"):
        load_soil_types(tmp_path / "t.toml")


def test_patches_of_a_class_are_polygons_with_one_symbol() -> None:
    layer, units = units_of_classes(drawn(["ss.c", "..sc"])[1])
    assert layer[0, 0] == layer[0, 1] != layer[1, 2] > 0
    assert layer[0, 2] == 0
    assert {units[int(number)].symbol for number in (layer[0, 0], layer[1, 2])} == {"sand"}
    assert len(units) == 3


def test_without_readings_ranks_are_those_of_the_map() -> None:
    rows = ["sscc", "rriw", "...."]
    geometry, codes = drawn(rows)
    belief = believed(rows)
    np.testing.assert_array_equal(belief.soil(), codes)
    np.testing.assert_array_equal(belief.no_go(), codes == NONE)
    assert belief.geometry is geometry or belief.geometry == geometry


def test_a_reading_changes_the_codes_that_it_says() -> None:
    belief = believed(["ssssss", "cccccc"], moisture=35.0)
    before = belief.soil()
    changed = belief.add(push(5.0, 15.0, 40.0, 50.0, 60.0))
    after = belief.soil()
    index = np.flatnonzero(before != after)
    np.testing.assert_array_equal(np.sort(changed.code_cells), index)
    assert index.size > 0
    assert changed.cells.tolist() == list(range(6))  # the clay next door is another polygon
    by_place = dict(zip(changed.code_cells.tolist(), changed.codes.tolist(), strict=True))
    assert all(after.flat[place] == code for place, code in by_place.items())
    undone = belief.withdraw(changed.reading)
    np.testing.assert_array_equal(belief.soil(), before)
    np.testing.assert_array_equal(np.sort(undone.code_cells), index)


@given(
    st.lists(st.tuples(st.floats(0.0, 59.9), st.floats(0.1, 20.0), st.sampled_from(CLASSES)), min_size=0, max_size=6)
)
def test_codes_carry_the_gate_into_ranks(words: list[tuple[float, float, SoilClass]]) -> None:
    belief = believed(["ssswww", "ccc..i"], moisture=35.0)
    for x_m, y_m, soil_class in words:
        belief.add(ClassReading(x_m, y_m, soil_class))
    region = Region(
        belief.geometry, np.zeros(belief.geometry.shape, np.float32), load_vehicle("tractor"), belief.soil()
    )
    from dataclasses import replace

    region = replace(region, params=replace(region.params, moisture_percent=35.0))
    ranks = rank_map(region)
    gated = np.isin(ranks.reason, [REASONS.index("soil_strength"), REASONS.index("no_ground")])
    np.testing.assert_array_equal(gated, belief.no_go())
    for row in range(2):
        for column in range(6):
            chances = belief.class_probabilities((row, column))
            assert math.isclose(sum(chances), 1.0)
            assert belief.decide((row, column)).go is not bool(belief.no_go()[row, column])


def test_a_changed_belief_goes_on_to_ranks_and_the_route_in_one_step() -> None:
    """A sand bridge between two lakes turns out soft: the route goes round by what one call returns."""
    rows = ["ssssssss", "sswwwwss", "ssssssss", "sswwwwss", "gggggggg"]
    geometry, codes = drawn(rows)
    layer = np.zeros(codes.shape, np.uint32)
    layer[2, 2:6] = 1
    layer[codes == NONE] = 2
    layer[codes == GRAVEL] = 3
    layer[layer == 0] = 4
    units = {1: Unit(SAND), 2: Unit(NONE), 3: Unit(GRAVEL), 4: Unit(SAND)}
    belief = SoilBelief(geometry, layer, units, "tractor", moisture_percent=35.0)
    vehicle = load_vehicle("tractor")

    def costs() -> NDArray[np.float64]:
        rank = rank_map(Region(geometry, np.zeros(geometry.shape, np.float32), vehicle, belief.soil())).rank
        return np.where(rank >= 2, 1.0, np.inf)

    replanner = Replanner(costs(), (2, 0), (2, 7), cell_size_m=CELL_M)
    before = replanner.path()
    assert isinstance(before, Way)
    assert before.cost == pytest.approx(70.0)
    changed = belief.add(push(45.0, 25.0, 20.0, 30.0, 40.0))
    closed = costs()
    assert np.isinf(closed.flat[changed.code_cells]).any()
    for place in changed.code_cells.tolist():
        row, column = divmod(place, geometry.columns)
        replanner.update(slice(row, row + 1), slice(column, column + 1), closed[row, column])
    after = replanner.path()
    fresh = shortest_path(closed, (2, 0), (2, 7), cell_size_m=CELL_M)
    assert isinstance(after, Way)
    assert isinstance(fresh, Way)
    assert after.cost == pytest.approx(fresh.cost)
    assert after.cost > before.cost


def test_a_reading_where_it_matters_is_worth_most() -> None:
    """The short way leads over ground that is sand or wet clay; the same ground off the way is worth nothing."""
    geometry, _ = drawn(["." * 7] * 5)
    layer = np.full((5, 7), 3, np.uint32)
    layer[1:4, 3] = [2, 1, 2]
    layer[4, 0] = 4
    half = {SAND: 0.5, CLAY: 0.5}
    units = {1: Unit(shares=half), 2: Unit(NONE), 3: Unit(GRAVEL), 4: Unit(shares=half)}
    params = BeliefParams(no_go_tolerance=0.2)
    belief = SoilBelief(geometry, layer, units, "tractor", moisture_percent=40.0, params=params)
    vehicle = load_vehicle("tractor")

    def cost(codes: NDArray[np.uint8]) -> float:
        from swathe.rank import RankParams

        region = Region(
            geometry, np.zeros((5, 7), np.float32), vehicle, codes, params=RankParams(moisture_percent=40.0)
        )
        way = shortest_path(rank_map(region).rank >= 2, (2, 0), (2, 6), cell_size_m=CELL_M)
        return way.cost if isinstance(way, Way) else math.inf

    present = cost(belief.soil())
    assert present > 60.0  # the unknown cell is closed for now

    def price(cells: NDArray[np.uint32], codes: NDArray[np.uint8]) -> tuple[float, float]:
        soil = belief.soil()
        soil.flat[cells] = codes
        return present, cost(soil)

    def value(cell: Cell) -> float:
        return belief.probe_value(cell, price, dead_end_cost=1000.0).expected_saving

    on_the_way, elsewhere = Cell(2, 3), Cell(4, 0)
    worth = belief.probe_value(on_the_way, price, dead_end_cost=1000.0)
    chance_open = sum(c for c, saving in zip(worth.chances, worth.savings, strict=True) if saving > 0)
    assert worth.expected_saving == pytest.approx(chance_open * (present - 60.0))
    assert 0.3 < chance_open < 0.7
    assert value(elsewhere) == 0.0
    candidates = [elsewhere, on_the_way]
    here = Cell(2, 0)
    assert next_probe("where it matters", candidates, value, here=here, since_last_m=0.0) == on_the_way
    assert next_probe("where it matters above 500", candidates, value, here=here, since_last_m=0.0) is None
    assert next_probe("where it pays", [on_the_way, Cell(2, 4)], value, here=here, since_last_m=0.0) == on_the_way
    assert next_probe("where it pays above 500", candidates, value, here=here, since_last_m=0.0) is None
    assert next_probe("never", candidates, value, here=here, since_last_m=1e9) is None
    assert next_probe("every 50 m", candidates, value, here=here, since_last_m=49.0) is None
    assert next_probe("every 50 m", candidates, value, here=here, since_last_m=50.0) == here
    for wrong in ("sometimes", "every m", "every -5 m", "every x m", "where it matters above", "where it pays 3"):
        with pytest.raises(InvalidParameterError):
            next_probe(wrong, candidates, value, here=here, since_last_m=1.0)


def test_a_price_that_fails_is_told() -> None:
    belief = believed(["sscc"], moisture=35.0)

    def price(_cells: NDArray[np.uint32], _codes: NDArray[np.uint8]) -> tuple[float, float]:
        raise RuntimeError("no planner")

    with pytest.raises(RuntimeError, match="no planner"):
        belief.probe_value((0, 3), price, dead_end_cost=1.0)


def test_the_papers_rule_takes_the_observed_class() -> None:
    belief = believed(["cccccc"], params=BeliefParams(rule="paper_relabel"))
    belief.add(ClassReading(5.0, 5.0, SAND))
    assert (belief.soil() == SAND).all()
    near = believed(["cccccc"], params=BeliefParams(rule="paper_relabel", relabel_radius_m=15.0))
    near.add(ClassReading(5.0, 5.0, SAND))
    assert near.soil().tolist() == [[SAND, SAND, CLAY, CLAY, CLAY, CLAY]]


def test_what_cannot_be_used_is_refused() -> None:
    belief = believed(["ss", "cc"])
    with pytest.raises(InvalidParameterError, match="not physical"):
        belief.add(push(5.0, 5.0, -3.0))
    with pytest.raises(InvalidParameterError, match="neither"):
        belief.add(push(5.0, 5.0))
    with pytest.raises(OutsideGridError, match="outside the map"):
        belief.add(push(500.0, 5.0, 300.0))
    with pytest.raises(InvalidParameterError, match="name a soil class"):
        belief.add(ClassReading(5.0, 5.0, UNKNOWN))
    for number in (-1, 7):
        with pytest.raises(InvalidParameterError, match="no reading"):
            belief.withdraw(number)
    with pytest.raises(OutsideGridError):
        belief.decide((5, 0))
    geometry, codes = drawn(["ss"])
    with pytest.raises(ShapeMismatchError):
        SoilBelief(geometry, codes.T, {}, "tractor")
    with pytest.raises(InvalidParameterError, match="not among the units"):
        SoilBelief(geometry, codes, {}, "tractor")
    with pytest.raises(InvalidParameterError, match="no mixture"):
        SoilBelief(geometry, np.ones((1, 2), int), {1: Unit(shares={SAND: 0.7})}, "tractor")
    with pytest.raises(InvalidParameterError, match="6 x 6"):
        match_profile(push(0, 0, 1.0), BeliefParams(confusion=((1.0,),)))
    with pytest.raises(InvalidParameterError, match="purity"):
        believed(["ss"], params=BeliefParams(purity=2.0))


def test_parameters_become_plain_values() -> None:
    plain = as_dict(BeliefParams())
    assert plain["purity"] == 0.75
    assert plain["types"]["clay"]["remoulding_index"] == 0.8
