"""Every kind of error has its class, its sentence and its remedy, and no kind is forgotten."""

from __future__ import annotations

import inspect
import re

import pytest

from swathe import _core, errors
from swathe.errors import (
    AllVoidError,
    InterruptedBySignalError,
    InvalidParameterError,
    InvalidVehicleError,
    OutsideGridError,
    ShapeMismatchError,
    SwatheError,
    TooLargeError,
    UnreadableFileError,
)

EMPTY = (
    InvalidParameterError,
    "A grid of 0 rows and 0 columns has no cells.",
    "Give at least one row and one column.",
)
SOIL_CODE = (
    InvalidParameterError,
    "Soil code 9 is not one of 0 (unknown) to 6 (none).",
    "Use the codes of swathe.soil.SoilClass.",
)
FIGURE = (
    InvalidVehicleError,
    "The vehicle's mass in kilograms of -1 is not usable: it must be finite and above 0.",
    "Correct the figure in the vehicle's file.",
)
NO_GREY = (
    InvalidParameterError,
    "The paper's profiles rank grey levels, and none were given.",
    "Give the grey levels, or choose profile metric.",
)
WIDTH = (
    InvalidParameterError,
    "The swathe's width of -1 m is not usable: it must be above 0.",
    "Leave it out for the usual value.",
)
RANK_MIN_0 = (
    InvalidParameterError,
    "A lowest suitable rank of 0 is not usable: 2 to 10 is allowed.",
    "Give 6 with gates or 7 without.",
)
SWARM = (
    InvalidParameterError,
    "The swarm's width of -1 is not usable: it must be above 0.",
    "Leave it out for the usual value.",
)

#: What Python makes of one error of every kind that the core knows: class, message, remedy.
CORE_ERRORS: dict[str, tuple[type[SwatheError], str, str]] = {
    "grid.empty": (
        InvalidParameterError,
        "A grid of 0 rows and 3 columns has no cells.",
        "Give at least one row and one column.",
    ),
    "grid.too_many_cells": (
        InvalidParameterError,
        "A grid of 1048576 rows and 1048576 columns has more than 4294967294 cells.",
        "Choose a window or coarser cells.",
    ),
    "grid.not_a_length": (
        InvalidParameterError,
        "The cell size of 0 m is not usable: it must be finite.",
        "Give it in metres.",
    ),
    "grid.shape_mismatch": (
        ShapeMismatchError,
        "the soil layer has 3 cells where the grid has 4.",
        "Read all layers on one geometry, for instance with the same window.",
    ),
    "grid.tile_side": (
        InvalidParameterError,
        "Tiles of 3 cells a side that begin 0 rows and 0 columns before the grid cannot be made.",
        "Give a power of two up to 32768, and a place inside a tile.",
    ),
    "grid.outside_grid": (
        OutsideGridError,
        "Cell (9, 0) lies outside a grid of 3 rows and 3 columns.",
        "Rows and columns count from 0 at the north-west.",
    ),
    "terrain.grid": EMPTY,
    "terrain.all_void": (
        AllVoidError,
        "No cell of the elevation is known.",
        "Give elevation data that covers the area.",
    ),
    "terrain.height_range": (
        InvalidParameterError,
        "The height range 2 .. 1 m is not usable: both must be finite and the first lower.",
        "Give low,high in metres.",
    ),
    "soil.unknown_code": SOIL_CODE,
    "soil.moisture": (
        InvalidParameterError,
        "A moisture of -3 % is not usable: it must be from 1 to 200 % of the dry weight.",
        "Give dry, normal, wet or a number of per cent.",
    ),
    "belief.grid": EMPTY,
    "belief.soil": (
        InvalidParameterError,
        "A moisture of -3 % is not usable: it must be from 1 to 200 % of the dry weight.",
        "Give dry, normal, wet or a number of per cent.",
    ),
    "belief.reading": (
        InvalidParameterError,
        "The reading holds neither a cone index nor a refusal depth.",
        "Leave the reading out, or correct it.",
    ),
    "belief.parameter": (
        InvalidParameterError,
        "The width of -1 is not usable: it must be above 0.",
        "Leave it out for the usual value.",
    ),
    "belief.type": (
        InvalidParameterError,
        "The width of clay is -1: it must be above 0.",
        "Correct the figure in the table of soil types.",
    ),
    "belief.mixture": (
        InvalidParameterError,
        "The shares of soil classes in map unit 3 are no mixture: they must be at least 0 and sum to 1.",
        "Give one share from 0 to 1 for each class.",
    ),
    "belief.unit": (
        InvalidParameterError,
        "Map unit 3 is given twice.",
        "Give every polygon a number of its own, above 0.",
    ),
    "belief.outside_map": (
        OutsideGridError,
        "The reading at (1, 2) m lies outside the map.",
        "Rows and columns count from 0 at the north-west.",
    ),
    "belief.no_class": (
        InvalidParameterError,
        "A reading must name a soil class; unknown soil is none.",
        "Give gravel, sand, clay, silt, rock or none.",
    ),
    "belief.no_reading": (
        InvalidParameterError,
        "There is no reading 4.",
        "Give a number that adding a reading returned.",
    ),
    "vehicle.figure": FIGURE,
    "rank.grid": EMPTY,
    "rank.soil": SOIL_CODE,
    "rank.vehicle": FIGURE,
    "rank.rank": (
        InvalidParameterError,
        "Rank 11 is not one of 0 (unknown), 1 (no-go), 2 to 10.",
        "Give ranks as swathe.rank makes them.",
    ),
    "rank.parameter": (
        InvalidParameterError,
        "The width of -1 is not usable: it must be above 0.",
        "Leave it out for the usual value.",
    ),
    "rank.no_height_map": NO_GREY,
    "rank.matrix": (
        InvalidParameterError,
        "The comparison matrix is not usable: it has 0 criteria.",
        "Give a square matrix with a_ji = 1 / a_ij.",
    ),
    "rank.inconsistent": (
        InvalidParameterError,
        "The comparisons contradict each other: consistency ratio 0.500, at most 0.10 is allowed.",
        "Review the comparisons, or pass force=True to use them anyway.",
    ),
    "drive.vehicle": FIGURE,
    "drive.belief": (
        InvalidParameterError,
        "A reading must name a soil class; unknown soil is none.",
        "Give gravel, sand, clay, silt, rock or none.",
    ),
    "drive.rank": (
        InvalidParameterError,
        "Rank 11 is not one of 0 (unknown), 1 (no-go), 2 to 10.",
        "Give ranks as swathe.rank makes them.",
    ),
    "drive.no_knowledge": (
        InvalidParameterError,
        "The navigator's region cannot learn: it holds finished ranks, or there is none.",
        "Make the region with swathe.drive.Region.of.",
    ),
    "drive.nest": (
        InvalidParameterError,
        "A lowest suitable rank of 11 is not usable: 2 to 10 is allowed.",
        "Give 6 with gates or 7 without.",
    ),
    "drive.figure": (
        InvalidParameterError,
        "The navigator's width of -1 is not usable: it must be above 0.",
        "Leave it out for the usual value.",
    ),
    "episode.figure": (
        InvalidParameterError,
        "The episode's width of -1 is not usable: it must be above 0.",
        "Leave it out for the usual value.",
    ),
    "corridor.length": WIDTH,
    "nest.grid": EMPTY,
    "nest.rank_min": (
        InvalidParameterError,
        "A lowest suitable rank of 11 is not usable: 2 to 10 is allowed.",
        "Give 6 with gates or 7 without.",
    ),
    "nest.vicinity": (
        InvalidParameterError,
        "A vicinity of radius -1 cells is not usable: 0 to 50 is allowed.",
        "Give moore1, von_neumann1, cell or disk:r.",
    ),
    "nest.figure": (
        InvalidParameterError,
        "The width of -1 is not usable: it must be above 0.",
        "Leave it out for the usual value, or give one inside the range.",
    ),
    "nest.evidence_moved": (
        InvalidParameterError,
        "The terrain is not on the geometry that the overlapping grids were made on.",
        "Make new grids on the new terrain.",
    ),
    "swarm.nest": RANK_MIN_0,
    "swarm.grid": EMPTY,
    "swarm.parameter": SWARM,
    "swarm.source": (
        UnreadableFileError,
        "The tile at row 256, column 0 cannot be read.",
        "Check the file and the network, and try again.",
    ),
    "planner.grid": EMPTY,
    "planner.rank": NO_GREY,
    "planner.corridor": WIDTH,
    "planner.nest": RANK_MIN_0,
    "planner.swarm": SWARM,
    "planner.source": (InterruptedBySignalError, "Reading was stopped.", ""),
    "planner.negative_cost": (
        InvalidParameterError,
        "The cost -1 at cell (0, 1) is negative: costs must be at least 0, NaN or infinite where closed.",
        "Mark closed cells with NaN or infinity instead.",
    ),
    "planner.neighbours": (
        InvalidParameterError,
        "5 neighbours are not offered: 8 or 16 is allowed.",
        "Give 8 or 16.",
    ),
    "planner.weight": (
        InvalidParameterError,
        "A weight of 0.5 for the bound is not usable: 1 to 1000 is allowed.",
        "Give 1 to 1000.",
    ),
    "planner.drivable": (
        InvalidParameterError,
        "A width of -1 is not usable: it must be above 0.",
        "Leave it out for the usual value.",
    ),
    "planner.objective": (
        InvalidParameterError,
        "The objective's width of -1 is not usable: it must be above 0.",
        "Give time, energy, risk or weights such as time=1,energy=0.5.",
    ),
    "planner.negative_factor": (
        InvalidParameterError,
        "The cost factor -1 at cell (0, 1) is negative: factors must be at least 0, NaN or infinite where closed.",
        "Mark closed cells with NaN or infinity instead.",
    ),
    "planner.not_a_place": (
        InvalidParameterError,
        "The start (NaN, 0) is not a place: both coordinates must be finite.",
        "Give two finite numbers.",
    ),
    "planner.memory": (
        TooLargeError,
        "The search needs 400 bytes beside the costs, more than the 100 allowed: about 25 cells would fit.",
        "Use coarser cells or a part of the map, or allow more memory.",
    ),
    "planner.stopped": (InterruptedBySignalError, "The planner was stopped.", ""),
    "sim.grid": EMPTY,
    "sim.soil": SOIL_CODE,
    "sim.vehicle": FIGURE,
    "sim.figure": (
        InvalidParameterError,
        "The simulated width of -1 is not usable: it must be above 0.",
        "Leave it out for the usual value.",
    ),
}

#: The word that `--json` prints and the exit status of the command line, for every class of the tree.
CLASSES = {
    "SwatheError": ("error", 1),
    "UsageError": ("usage", 2),
    "InvalidParameterError": ("invalid_parameter", 2),
    "ShapeMismatchError": ("shape_mismatch", 2),
    "OutsideGridError": ("outside_grid", 2),
    "InputError": ("input", 4),
    "MissingFileError": ("missing_file", 4),
    "UnreadableFileError": ("unreadable_file", 4),
    "NotElevationError": ("not_elevation", 4),
    "MissingCrsError": ("missing_crs", 4),
    "InvalidCrsError": ("invalid_crs", 4),
    "NoOverlapError": ("no_overlap", 4),
    "AllVoidError": ("all_void", 4),
    "TooLargeError": ("too_large", 4),
    "TooSmallError": ("too_small", 4),
    "ReadingFileError": ("reading_file", 4),
    "SoilFieldError": ("soil_field", 4),
    "InvalidScenarioError": ("invalid_scenario", 4),
    "InvalidVehicleError": ("invalid_vehicle", 4),
    "GrassError": ("grass", 4),
    "MissingExtraError": ("missing_extra", 4),
    "StoreError": ("store", 4),
    "StoreUnavailableError": ("store_unavailable", 4),
    "StoreSchemaError": ("store_schema", 4),
    "StoreReadOnlyError": ("store_read_only", 4),
    "StoreBusyError": ("store_busy", 4),
    "StoreFullError": ("store_full", 4),
    "StoreDamagedError": ("store_damaged", 4),
    "MissingRegionError": ("missing_region", 4),
    "MissingLayerError": ("missing_layer", 4),
    "RegionConflictError": ("region_conflict", 4),
    "OutputError": ("output", 4),
    "InterruptedBySignalError": ("interrupted", 130),
}


def error_classes() -> dict[str, type[SwatheError]]:
    return {
        name: member
        for name, member in vars(errors).items()
        if inspect.isclass(member) and issubclass(member, SwatheError)
    }


def test_the_table_names_every_kind_of_the_core_and_no_other() -> None:
    assert list(CORE_ERRORS) == _core.error_kinds()


@pytest.mark.parametrize("kind", _core.error_kinds())
def test_each_kind_of_the_core_becomes_its_class_with_message_and_remedy(kind: str) -> None:
    expected, message, remedy = CORE_ERRORS[kind]
    with pytest.raises(SwatheError) as caught:
        _core.raise_error(kind)
    assert type(caught.value) is expected
    assert (caught.value.message, caught.value.remedy) == (message, remedy)
    assert str(caught.value) == f"{message} {remedy}".strip()


def test_a_kind_that_nobody_knows_raises_nothing() -> None:
    _core.raise_error("no such kind")


@pytest.mark.parametrize(("message", "remedy"), [(entry[1], entry[2]) for entry in CORE_ERRORS.values()])
def test_messages_and_remedies_are_sentences_on_one_line(message: str, remedy: str) -> None:
    for sentence in filter(None, (message, remedy)):
        assert sentence.endswith(".")
        assert "\n" not in sentence
        assert not re.search(r"panick|unwrap|Err\(|[A-Za-z]+ \{", sentence), sentence


def test_the_tree_of_errors_is_the_one_that_is_promised() -> None:
    assert {name: (cls.kind, cls.exit_code) for name, cls in error_classes().items()} == CLASSES


def test_kinds_are_unique_words() -> None:
    kinds = [cls.kind for cls in error_classes().values()]
    assert len(set(kinds)) == len(kinds)
    assert all(re.fullmatch(r"[a-z]+(_[a-z]+)*", kind) for kind in kinds)


@pytest.mark.parametrize("name", CLASSES)
def test_an_error_is_its_sentence_and_its_remedy(name: str) -> None:
    error = error_classes()[name]("The cell size of -1 m is not a length.", "Give a number above zero.")
    assert isinstance(error, SwatheError)
    assert str(error) == "The cell size of -1 m is not a length. Give a number above zero."
    assert error.args == ("The cell size of -1 m is not a length.",)


def test_wrong_values_are_value_errors_too() -> None:
    with pytest.raises(ValueError, match="neighbours"):
        _core.raise_error("planner.neighbours")
