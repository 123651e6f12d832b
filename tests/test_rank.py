"""Ranks: the paper's tables, the metric bands, gates with their reasons, weights."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swathe.errors import InvalidParameterError, OutsideGridError, ShapeMismatchError
from swathe.grid import Cell, GridGeometry
from swathe.rank import (
    REASONS,
    RankMap,
    RankParams,
    Region,
    ahp,
    as_dict,
    grey_levels,
    height_goodness,
    moisture_percent,
    rank_cell,
    rank_map,
    rank_metric,
)
from swathe.soil import SoilClass, soil_goodness
from swathe.terrain import group_mean, height_map
from swathe.vehicle import Vehicle, load_vehicle
from worlds import changed, region_of, smooth_hills

if TYPE_CHECKING:
    from numpy.typing import NDArray

PIONEER = load_vehicle("pioneer-3at")
TRACTOR = load_vehicle("tractor")
# Ten metres: too coarse for the roughness of single steps, so that slope and soil alone decide.
CELL_M = 10.0
MIDDLE = Cell(2, 2)


def ramp(grade: float, direction_rad: float = 0.0) -> NDArray[np.float32]:
    row, column = np.mgrid[0:5, 0:5]
    rise = grade * CELL_M * (column * math.cos(direction_rad) - row * math.sin(direction_rad))
    return np.asarray(rise, dtype=np.float32)


def of_soil(soil_class: SoilClass) -> NDArray[np.uint8]:
    return np.full((5, 5), soil_class, dtype=np.uint8)


def middle_of(
    grade: float,
    soil_class: SoilClass | None = None,
    vehicle: Vehicle = PIONEER,
    direction_rad: float = 0.0,
    **params: Any,
) -> tuple[int, str]:
    """Return rank and reason of the middle of a ramp."""
    soil = None if soil_class is None else of_soil(soil_class)
    ground = region_of(ramp(grade, direction_rad), CELL_M, vehicle=vehicle, soil=soil, params=RankParams(**params))
    return rank_cell(ground, MIDDLE)


#: Table I of the paper: goodness by the size of the difference, both signs.
TABLE_I = {5: (0, 0), 4: (1, 66), 3: (67, 129), 2: (130, 192), 1: (193, 255)}
#: Table II and, where it differs, the text.
TABLE_II = {"GRAVEL": (5, 5), "SAND": (4, 4), "CLAY": (3, 3), "SILT": (3, 2), "ROCK": (1, 1)}


def test_table_1_for_every_difference_of_grey_levels() -> None:
    for difference in range(-255, 256):
        (expected,) = [goodness for goodness, (low, high) in TABLE_I.items() if low <= abs(difference) <= high]
        assert height_goodness(difference) == expected, difference
        # As printed, -192 stands in two bins; the worse one holds.
        literal = height_goodness(difference, bands="literal")
        assert literal == (1 if difference == -192 else expected), difference


@pytest.mark.parametrize(
    ("difference", "rounded", "real"), [(0.4, 5, 4), (-0.5, 4, 4), (66.4, 4, 3), (66.5, 3, 3), (-129.5, 2, 2)]
)
def test_real_differences_are_rounded_away_from_zero_or_meet_half_open_bins(
    difference: float, rounded: int, real: int
) -> None:
    assert height_goodness(difference) == rounded
    assert height_goodness(difference, rounding="real") == real


@pytest.mark.parametrize("name", TABLE_II)
def test_table_2_and_the_text(name: str) -> None:
    printed, text = TABLE_II[name]
    assert soil_goodness(SoilClass[name], table="table2") == printed
    assert soil_goodness(SoilClass[name]) == text


# Slopes whose height goodness is 5, 4, 3 within the limit, and soils by their goodness (silt twice).
GRADES = {5: 0.05, 4: 0.12, 3: 0.19}


@pytest.mark.parametrize(("height", "name", "table"), list(itertools.product(GRADES, TABLE_II, ("table2", "text"))))
def test_rank_is_the_sum_of_both_goodnesses(height: int, name: str, table: Any) -> None:
    soil = TABLE_II[name][0 if table == "table2" else 1]
    vehicle = changed(PIONEER, grade_up=0.2, grade_down=0.2, side_slope=0.2)
    expected = (height + soil, "none")
    assert middle_of(GRADES[height], SoilClass[name], vehicle, soil_table=table, moisture_percent=10.0) == expected


# One grey cell beside the middle makes each goodness of Table I; without gates all 25 combinations can be seen.
@pytest.mark.parametrize(("height", "name"), list(itertools.product(TABLE_I, TABLE_II)))
def test_equal_weights_are_equation_1_for_all_25_combinations(height: int, name: str) -> None:
    grey = np.full((5, 5), 20.0, dtype=np.float32)
    grey[2, 3] += TABLE_I[height][1] if height > 1 else 200
    ground = region_of(
        ramp(0.0),
        CELL_M,
        soil=of_soil(SoilClass[name]),
        grey=grey,
        params=RankParams(profile="literal", soil_table="table2"),
    )
    assert rank_cell(ground, MIDDLE) == (height + TABLE_II[name][0], "none")


@pytest.mark.parametrize(("height", "name"), list(itertools.product(TABLE_I, TABLE_II)))
def test_the_worse_of_both_rules_with_min_and_a_weight_of_one_listens_to_one(height: int, name: str) -> None:
    grey = np.full((5, 5), 20.0, dtype=np.float32)
    grey[2, 3] += TABLE_I[height][1] if height > 1 else 200
    ground = region_of(ramp(0.0), CELL_M, soil=of_soil(SoilClass[name]), grey=grey)
    literal = RankParams(profile="literal")
    soil = TABLE_II[name][1]
    for params, expected in (
        (replace(literal, combine="min"), 2 * min(height, soil)),
        (replace(literal, height_weight=1.0, soil_weight=0.0), 2 * height),
        (replace(literal, height_weight=0.0, soil_weight=1.0), 2 * soil),
    ):
        assert rank_cell(replace(ground, params=params), MIDDLE)[0] == expected


@pytest.mark.parametrize(
    ("share", "rank"), [(0.0, 10), (0.32, 10), (0.35, 9), (0.65, 9), (0.68, 8), (0.99, 8), (1.01, 1), (1.6, 1)]
)
def test_metric_bands_are_thirds_of_the_grade_limit(share: float, rank: int) -> None:
    vehicle = changed(PIONEER, grade_up=0.25, grade_down=0.25, side_slope=0.25)
    assert middle_of(0.25 * share, SoilClass.GRAVEL, vehicle) == (rank, "none" if rank > 1 else "grade")


@given(grade=st.floats(0, 0.4), more=st.floats(0, 0.2), angle=st.floats(0, 2 * math.pi))
def test_rank_never_rises_with_slope(grade: float, more: float, angle: float) -> None:
    assert middle_of(grade + more, None, PIONEER, angle)[0] <= middle_of(grade, None, PIONEER, angle)[0]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        # 30 % is the Pioneer's limit downhill, 25 % uphill.
        ({"grade": 0.29}, (6, "none")),
        ({"grade": 0.31}, (1, "grade")),
        ({"grade": 0.05, "soil_class": SoilClass.NONE}, (1, "no_ground")),
        ({"grade": 0.05, "soil_class": SoilClass.UNKNOWN}, (8, "none")),
        ({"grade": 0.05, "soil_class": SoilClass.UNKNOWN, "unknown_soil": "avoid"}, (1, "unknown_soil")),
        ({"grade": 0.05, "soil_class": SoilClass.UNKNOWN, "unknown_soil": "gravel"}, (10, "none")),
        ({"grade": 0.05, "soil_class": SoilClass.UNKNOWN, "unknown_soil": "none"}, (1, "no_ground")),
        ({"grade": 0.05, "unknown_soil": "rock"}, (6, "none")),
        ({"grade": 0.05, "soil_class": SoilClass.ROCK}, (6, "none")),
        # Clay at 80 % is soup for a tractor: RCI = exp(15.506 - 3.530 ln 80) psi = 1.0 psi.
        ({"grade": 0.05, "soil_class": SoilClass.CLAY, "vehicle": TRACTOR, "moisture_percent": 80.0},
         (1, "soil_strength")),
        ({"grade": 0.05, "soil_class": SoilClass.CLAY, "vehicle": TRACTOR, "moisture_percent": 20.0}, (8, "none")),
        # Rock and gravel never gate, however wet.
        ({"grade": 0.05, "soil_class": SoilClass.ROCK, "vehicle": TRACTOR, "moisture_percent": 80.0}, (6, "none")),
        ({"grade": 0.05, "soil_class": SoilClass.GRAVEL, "vehicle": TRACTOR, "moisture_percent": 80.0}, (10, "none")),
    ],
)  # fmt: skip
def test_gates_name_their_reason(arguments: dict[str, Any], expected: tuple[int, str]) -> None:
    assert middle_of(**arguments) == expected


def test_a_slope_that_no_heading_can_take_is_a_side_slope() -> None:
    # Straight up a slope of 14 % works with 2 % sideways, but not where the slope lies between two of 16 headings.
    narrow = changed(PIONEER, grade_up=0.15, grade_down=0.15, side_slope=0.02)
    assert middle_of(0.14, None, narrow) == (6, "none")
    assert middle_of(0.14, None, narrow, math.radians(12)) == (1, "side_slope")


def test_fine_cells_see_steps_and_roughness() -> None:
    ledge = np.zeros((5, 5), dtype=np.float32)
    ledge[2, 2] = 0.10  # above the Pioneer's 0.08 m
    fine = region_of(ledge, 0.5, vehicle="pioneer-3at")
    assert rank_cell(fine, MIDDLE) == (1, "step")
    bumpy = np.zeros((5, 5), dtype=np.float32)
    bumpy[2, 2] = 0.05
    rank, reason = rank_cell(region_of(bumpy, 0.5, vehicle="pioneer-3at"), MIDDLE)
    level = rank_cell(region_of(np.zeros((5, 5), dtype=np.float32), 0.5, vehicle="pioneer-3at"), MIDDLE)[0]
    assert (rank < level, reason) == (True, "none")
    # A coarse cell cannot say what a wheel feels.
    assert rank_cell(region_of(ledge, CELL_M, vehicle="pioneer-3at"), MIDDLE) == (level, "none")


def test_zones_and_voids() -> None:
    elevation = ramp(0.0)
    elevation[1, 1] = np.nan
    zones = np.zeros((5, 5), dtype=np.bool_)
    zones[3, 2] = zones[1, 1] = True
    found = rank_map(region_of(elevation, CELL_M, zones=zones))
    assert (found.rank[3, 2], REASONS[found.reason[3, 2]]) == (1, "zone")
    assert (found.rank[1, 1], REASONS[found.reason[1, 1]]) == (0, "unknown_elevation")
    assert (np.delete(found.rank.ravel(), [6, 17]) == 8).all()


def test_the_literal_profile_has_no_gates_and_the_paper_s_has_its_grade() -> None:
    grey = np.full((5, 5), 20.0, dtype=np.float32)
    steep = region_of(ramp(0.28), CELL_M, vehicle="pickup-4x4", grey=grey)
    ranks = {
        profile: rank_cell(replace(steep, params=RankParams(profile=profile)), MIDDLE)
        for profile in ("metric", "paper", "literal")
    }
    assert ranks == {"metric": (7, "none"), "paper": (1, "grade"), "literal": (8, "none")}
    drowned = replace(steep, soil=of_soil(SoilClass.NONE), params=RankParams(profile="literal"))
    assert rank_cell(drowned, MIDDLE) == (6, "none")


@pytest.mark.parametrize(
    ("step", "directions", "goodness"),
    [
        # A ramp of grey levels to the east: the edges differ by the step, diagonals by step over root two, north by 0.
        (0.0, "worst", 5),
        (40.0, "worst", 4),
        (70.0, "worst", 3),
        (70.0, "four", 3),
        (70.0, "best", 5),
        (70.0, "mean", 4),
    ],
)
def test_the_paper_s_profile_on_a_grey_ramp(step: float, directions: Any, goodness: int) -> None:
    grey = np.asarray(np.tile(step * np.arange(5), (5, 1)), dtype=np.float32)
    params = RankParams(profile="paper", directions=directions)
    assert rank_cell(region_of(ramp(0.0), CELL_M, grey=grey, params=params), MIDDLE) == (goodness + 3, "none")


def test_grey_levels_are_the_height_map_in_groups() -> None:
    elevation = smooth_hills(1, 32, 40, height_m=50, cell_size_m=30, wave_m=400)
    assert np.array_equal(grey_levels(elevation, "8x8"), group_mean(height_map(elevation), "8x8"))
    assert grey_levels(elevation, "8x8").shape == (4, 5)


@given(
    seed=st.integers(0, 2**32 - 1),
    rows=st.integers(1, 12),
    columns=st.integers(1, 80),
    cell_size_m=st.sampled_from([0.3, 2.0, 30.0]),
    profile=st.sampled_from(["metric", "paper", "literal"]),
    with_soil=st.booleans(),
    with_zones=st.booleans(),
    moisture=st.floats(5, 60),
)
def test_one_pass_and_one_cell_say_the_same(
    seed: int,
    rows: int,
    columns: int,
    cell_size_m: float,
    profile: Any,
    with_soil: bool,
    with_zones: bool,
    moisture: float,
) -> None:
    draw = np.random.default_rng(seed)
    elevation = np.asarray(draw.normal(0, 0.15 * cell_size_m, (rows, columns)).cumsum(axis=1), dtype=np.float32)
    elevation[draw.random(elevation.shape) < 0.05] = np.nan
    ground = region_of(
        elevation,
        cell_size_m,
        soil=draw.integers(0, 7, elevation.shape, dtype=np.uint8) if with_soil else None,
        zones=draw.random(elevation.shape) < 0.1 if with_zones else None,
        grey=np.asarray(draw.integers(0, 256, elevation.shape), dtype=np.float32),
        params=RankParams(profile=profile, moisture_percent=moisture),
    )
    whole = rank_map(ground)
    assert ((whole.rank == 0) == np.isnan(elevation)).all()
    assert ((whole.reason > 0) == (whole.rank < 2)).all()
    assert whole.rank.max() <= 10
    for _ in range(20):
        cell = Cell(int(draw.integers(rows)), int(draw.integers(columns)))
        assert rank_cell(ground, cell) == (whole.rank[cell], REASONS[whole.reason[cell]])


def test_ranks_go_into_the_callers_array_when_it_fits() -> None:
    ground = region_of(smooth_hills(2, 20, 30, height_m=70, cell_size_m=CELL_M, wave_m=500), CELL_M)
    out = np.full((20, 30), 255, np.uint8)
    found = rank_map(ground, out=out)
    assert np.shares_memory(found.packed, out)
    np.testing.assert_array_equal(out, rank_map(ground).packed)
    for wrong in (np.zeros((30, 20), np.uint8), np.zeros((20, 30), np.int8)):
        with pytest.raises(ShapeMismatchError):
            rank_map(ground, out=wrong)  # type: ignore[arg-type]
    fixed = np.zeros((20, 30), np.uint8)
    fixed.flags.writeable = False
    for unusable in (fixed, np.zeros((20, 60), np.uint8)[:, ::2]):
        with pytest.raises(InvalidParameterError):
            rank_map(ground, out=unusable)


def test_rank_metric_is_the_rank_map_of_the_same_arrays() -> None:
    elevation = smooth_hills(2, 30, 40, height_m=60, cell_size_m=30, wave_m=500)
    soil = np.random.default_rng(0).integers(0, 7, elevation.shape)
    found = rank_metric(elevation, soil, 30.0, "tractor")
    region = Region(GridGeometry(30, 40, 30.0), elevation, TRACTOR, np.asarray(soil, dtype=np.uint8))
    expected = rank_map(region)
    assert isinstance(found, RankMap)
    assert np.array_equal(found.rank, expected.rank)
    assert np.array_equal(found.reason, expected.reason)


#: Comparison matrices with weights, principal eigenvalue and consistency ratio as published.
KNOWN_MATRICES = [
    ([[1]], (1.0,), 1.0, 0.0),
    ([[1, 1], [1, 1]], (0.5, 0.5), 2.0, 0.0),
    ([[1, 3], [1 / 3, 1]], (0.75, 0.25), 2.0, 0.0),
    # Consistent by construction: 4 : 2 : 1.
    ([[1, 2, 4], [0.5, 1, 2], [0.25, 0.5, 1]], (4 / 7, 2 / 7, 1 / 7), 3.0, 0.0),
    # The usual textbook example, four decimals.
    ([[1, 3, 5], [1 / 3, 1, 3], [1 / 5, 1 / 3, 1]], (0.6370, 0.2583, 0.1047), 3.0385, 0.0332),
]


@pytest.mark.parametrize(("matrix", "weights", "eigenvalue", "ratio"), KNOWN_MATRICES)
def test_ahp_of_known_matrices(
    matrix: list[list[float]], weights: tuple[float, ...], eigenvalue: float, ratio: float
) -> None:
    found = ahp(matrix)
    assert found.weights == pytest.approx(weights, abs=5e-5)
    assert found.lambda_max == pytest.approx(eigenvalue, abs=5e-5)
    assert found.consistency_ratio == pytest.approx(ratio, abs=5e-5)


@given(st.lists(st.sampled_from([1, 2, 3, 1 / 2, 1 / 3, 5, 1 / 5]), min_size=3, max_size=10))
def test_ahp_weights_are_numpys_principal_eigenvector(entries: list[float]) -> None:
    size = {3: 3, 4: 3, 5: 3, 6: 4, 7: 4, 8: 4, 9: 4, 10: 5}[len(entries)]
    matrix = np.ones((size, size))
    for (i, j), value in zip(itertools.combinations(range(size), 2), entries, strict=False):
        matrix[i, j], matrix[j, i] = value, 1 / value
    values, vectors = np.linalg.eig(matrix)
    first = int(np.argmax(values.real))
    expected = np.abs(vectors[:, first].real)
    found = ahp(matrix.tolist(), force=True)
    assert found.weights == pytest.approx(expected / expected.sum(), abs=1e-8)
    assert found.lambda_max == pytest.approx(values[first].real, abs=1e-8)
    index = (found.lambda_max - size) / (size - 1)
    assert found.consistency_ratio == pytest.approx(max(0, index / {3: 0.58, 4: 0.90, 5: 1.12}[size]), abs=1e-8)


def test_contradicting_comparisons_are_refused_unless_forced() -> None:
    circle = [[1, 9, 1 / 9], [1 / 9, 1, 9], [9, 1 / 9, 1]]
    with pytest.raises(InvalidParameterError, match="contradict"):
        ahp(circle)
    assert ahp(circle, force=True).consistency_ratio > 1


@pytest.mark.parametrize(
    ("matrix", "why"),
    [
        ([], "0 criteria"),
        ([[1] * 11] * 11, "11 criteria"),
        ([[1, 2]], "2 entries"),
        ([[1, 2], [2, 1]], "not reciprocal"),
        ([[1, 10], [0.1, 1]], "1/9 to 9"),
        ([[1, math.nan], [math.nan, 1]], "1/9 to 9"),
    ],
)
def test_matrices_that_compare_nothing_are_refused(matrix: list[list[float]], why: str) -> None:
    with pytest.raises(InvalidParameterError, match=why):
        ahp(matrix)


@pytest.mark.parametrize(
    ("text", "percent"), [("dry", 15.0), ("normal", 20.0), ("wet", 35.0), ("27.5", 27.5), (" 8 ", 8.0)]
)
def test_moisture_words_and_numbers(text: str, percent: float) -> None:
    assert moisture_percent(text) == percent


def test_moistures_that_are_none_are_refused() -> None:
    with pytest.raises(InvalidParameterError, match="damp"):
        moisture_percent("damp")
    for bad in (0.0, 201.0, math.nan, moisture_percent("nan")):
        with pytest.raises(InvalidParameterError, match="moisture"):
            middle_of(0.0, moisture_percent=bad)


@pytest.mark.parametrize(
    ("params", "named"),
    [
        ({"profile": "lunar"}, "profile"),
        ({"soil_table": "table3"}, "soil table"),
        ({"unknown_soil": "mud"}, "Unknown soil"),
        ({"directions": "north"}, "directions"),
        ({"bands": "wide"}, "bands"),
        ({"rounding": "up"}, "rounding"),
        ({"height_weight": 0.9}, "weights"),
        ({"height_weight": -0.5, "soil_weight": 1.5}, "weights"),
        ({"height_weight": math.nan}, "weights"),
        ({"paper_grade": 0.0}, "grade"),
        ({"profile": "paper"}, "grey levels"),
        ({"combine": "product"}, "combin"),
    ],
)
def test_rules_that_nobody_knows_are_refused(params: dict[str, Any], named: str) -> None:
    with pytest.raises(InvalidParameterError, match=named):
        middle_of(0.0, **params)


def test_layers_that_do_not_fit_are_refused() -> None:
    level = np.zeros((5, 4), dtype=np.float32)
    with pytest.raises(ShapeMismatchError, match="soil"):
        region_of(level, CELL_M, soil=np.zeros((4, 5), dtype=np.uint8))
    with pytest.raises(ShapeMismatchError, match="elevation"):
        Region(GridGeometry(4, 5, CELL_M), level, TRACTOR)


@pytest.mark.parametrize("bad", [7, 256 + 1, -1])
def test_soil_codes_that_no_class_has_are_refused(bad: int) -> None:
    soil = np.full((5, 5), 1)
    soil[0, 0] = bad
    with pytest.raises(InvalidParameterError, match=r"[Ss]oil"):
        rank_metric(ramp(0.0), soil, CELL_M, TRACTOR)
    with pytest.raises(InvalidParameterError, match=r"[Ss]oil"):
        rank_map(region_of(ramp(0.0), CELL_M, soil=soil))


@pytest.mark.parametrize("cell", [Cell(-1, 0), Cell(5, 0), Cell(0, 5)])
def test_cells_outside_are_refused(cell: Cell) -> None:
    with pytest.raises(OutsideGridError, match=f"{cell.row}, {cell.column}"):
        rank_cell(region_of(ramp(0.0), CELL_M), cell)


def test_parameters_as_plain_values() -> None:
    assert as_dict(RankParams(profile="paper"))["profile"] == "paper"
    assert {RankParams(profile=profile).rank_min for profile in ("metric", "paper")} == {6}
    assert RankParams(profile="literal").rank_min == 7
