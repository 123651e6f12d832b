"""A staged drive before it begins: what it knows of the ground, and what the ground is in truth."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING, Any

from swathe.grid import Cell, Position
from swathe.preparation import Stopwatch
from swathe.scenario import scenario_of
from swathe.sensor import Pose
from swathe.soil import SoilClass
from swathe.staging import stage

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from swathe.drive import Navigator
    from swathe.staging import Stage

#: Gravel and sand in the north, silt in the south. At 40 % of moisture all of it carries a tractor and clay would not,
#: at 60 % silt does not either.
BOUNDS = (20, 10, 120, 110)
ON_GRAVEL, ON_SILT = (70, 60), (50, 20)
SOFT, FIRM = "40,45,50", "1800,2000,2200"


def staged(*, moisture: str = "40", truth: dict[str, Any] | None = None, **drive: Any) -> Stage:
    scenario = scenario_of(
        {
            "vehicle": "tractor",
            "terrain": {"dem": ["bundled:fields"], "soil": "bundled:fields", "points_crs": "native", "bounds": BOUNDS},
            "plan": {"moisture": moisture, "method": "exact"},
            "drive": {"start": (55, 75), "goal": (75, 75), **drive},
            "truth": truth or {},
        },
        "it",
    )
    return stage(scenario, watch=Stopwatch())


def profiles(folder: Path, *pushes: tuple[tuple[int, int], str]) -> str:
    """Write hand readings, each a place and what it says at three depths, and return the file."""
    path = folder / "readings.csv"
    rows = "".join(f"{x},{y},{kpa}\n" for (x, y), kpa in pushes)
    path.write_text("x,y,ci_5cm,ci_10cm,ci_15cm\n" + rows, encoding="utf-8")
    return str(path)


def navigator(made: Stage) -> Navigator:
    return made.episode()[1]


def ranks(made: Stage) -> NDArray[np.uint8]:
    found = navigator(made).ranks
    assert found is not None
    return found


def cell(made: Stage, place: tuple[int, int]) -> Cell:
    assert made.found is not None
    found = made.found.shown.region.geometry.cell_at(Position(*place))
    assert found is not None
    return found


def test_a_profile_of_soft_ground_closes_it_before_the_drive(tmp_path: Path) -> None:
    told = staged(readings=profiles(tmp_path, (ON_GRAVEL, SOFT)))
    before, after = ranks(staged()), ranks(told)
    at = cell(told, ON_GRAVEL)
    assert (before > 1).all()
    assert (before[at], after[at]) == (10, 1)
    # All that is closed is of the gravel that the reading speaks for.
    assert 100 < (after == 1).sum() < (before == 10).sum()
    assert (after[before < 10] == before[before < 10]).all()
    soil = navigator(told).soil_at(ON_GRAVEL)
    assert soil is not None
    assert soil.no_go_probability > 0.9


def test_profiles_of_firm_ground_open_it_before_the_drive(tmp_path: Path) -> None:
    x, y = ON_SILT
    firm = profiles(tmp_path, *(((x + aside, y), FIRM) for aside in (-10, 0, 10)))
    before, after = ranks(staged(moisture="60")), ranks(staged(moisture="60", readings=firm))
    at = cell(staged(), ON_SILT)
    assert (before[at], after[at]) == (1, 9)
    assert 100 < (before == 1).sum() - (after == 1).sum() < (before == 1).sum()
    assert (after[before > 1] == before[before > 1]).all()


def test_a_table_of_ones_own_changes_what_a_reading_is_taken_for(tmp_path: Path) -> None:
    bundled = (resources.files("swathe") / "soil_types.toml").read_text("utf-8")
    table = tmp_path / "types.toml"
    # Here sand is firmer than gravel, and what would be sand elsewhere is silt.
    table.write_text(bundled.replace("cone_index_kpa = 1200.0", "cone_index_kpa = 5000.0"), encoding="utf-8")
    readings = profiles(tmp_path, (ON_GRAVEL, "900,1000,1100"))
    usual, own = staged(readings=readings), staged(readings=readings, soil_types=str(table))
    likeliest = []
    for made in (usual, own):
        soil = navigator(made).soil_at(ON_GRAVEL)
        assert soil is not None
        likeliest.append(max(soil.probabilities, key=soil.probabilities.__getitem__))
    assert likeliest == [SoilClass.SAND, SoilClass.SILT]
    at = cell(own, ON_GRAVEL)
    assert (ranks(usual)[at], ranks(own)[at]) == (9, 7)
    # Without a reading the table says nothing.
    assert (ranks(staged(soil_types=str(table))) == ranks(staged())).all()


def test_the_true_moisture_decides_what_carries_and_the_map_does_not_know_it() -> None:
    x, y = ON_GRAVEL
    patch = {"patches": [{"soil": "clay", "x_m": x, "y_m": y, "radius_m": 5}]}
    shown = ranks(staged(moisture="normal"))
    for planned, true, why_not in (
        ("normal", {}, None),
        ("normal", {"moisture": "40"}, "soil"),
        ("40", {}, "soil"),
        ("40", {"moisture": "normal"}, None),
    ):
        made = staged(moisture=planned, truth=patch | true)
        assert made.world is not None
        assert made.world.no_go("tractor", Pose(x, y, 0.0)) == why_not, (planned, true)
        assert made.world.no_go("tractor", Pose(x, y + 20, 0.0)) is None
        if planned == "normal":
            assert (ranks(made) == shown).all()
