"""Scenario files: what the bundled ones promise, and what a user's own file is told when it is wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swathe.config import Settings, TerrainRequest
from swathe.errors import InvalidScenarioError, MissingFileError, UnreadableFileError
from swathe.objective import Objective
from swathe.rank import RankParams
from swathe.scenario import (
    DrivePart,
    PlanPart,
    Scenario,
    Terrain,
    load_scenario,
    request_of,
    scenario_from_toml,
    scenario_names,
    scenario_of,
)
from swathe.swarm import StopParams

if TYPE_CHECKING:
    from pathlib import Path

DRAWN = {"world": {"kind": "clutter"}}
MAPPED = {"terrain": {"dem": ["dem.tif"]}, "drive": {"start": [1, 2], "goal": [3, 4]}}


@pytest.mark.parametrize("name", scenario_names())
def test_every_bundled_scenario_is_the_same_through_toml(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.title
    assert scenario_from_toml(scenario.to_toml(), "it") == scenario


def test_the_papers_run_is_the_papers() -> None:
    paper = load_scenario("paper")
    assert paper.vehicle == "pioneer-2dx"
    assert (paper.plan.profile, paper.plan.agents) == ("paper", 10)
    assert (paper.drive.method, paper.drive.grids, paper.drive.soil_rule) == ("vfh", "or", "paper_relabel")
    assert paper.sensors.laser == "sick-lms200-8m"
    assert paper.obstacles.crates > 0
    assert paper.soil_news
    assert paper.truth.patches


@given(
    seed=st.integers(0, 2**64 - 1),
    crates=st.integers(0, 10_000),
    soil_error=st.floats(0, 1),
    start=st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)),
    title=st.text(alphabet=st.characters(exclude_categories=("Cs", "Cc")), max_size=30),
)
def test_any_scenario_is_the_same_through_toml(
    seed: int, crates: int, soil_error: float, start: tuple[float, float], title: str
) -> None:
    content = {
        **MAPPED,
        "title": title,
        "seed": seed,
        "drive": {"start": start, "goal": [3, 4]},
        "obstacles": {"crates": crates},
        "truth": {"soil_error": soil_error},
    }
    scenario = scenario_of(content, "it")
    assert scenario_from_toml(scenario.to_toml(), "it") == scenario


def test_what_a_plan_was_asked_for_comes_back() -> None:
    rank = RankParams(profile="paper", moisture_percent=31.25, combine="min", height_weight=0.25, soil_weight=0.75)
    settings = Settings(
        "tractor",
        rank,
        agents=12,
        pellet_max=2,
        stop=StopParams(rule="connected", max_ticks=900),
        seed=5,
        arc="spine",
        path="grid8",
        objective=Objective(1, 0.5, 2, 30),
        bridge=True,
    )
    request = TerrainRequest(("a.tif", "b.tif"), soil="s.gpkg", soil_field="cat", bounds=(1, 2, 3, 4))
    scenario = Scenario(
        vehicle="tractor",
        seed=5,
        terrain=Terrain.of(request),
        plan=PlanPart.of(settings),
        drive=DrivePart(start=(0, 0), goal=(1, 1)),
    )
    assert scenario.settings() == settings
    assert scenario.terrain_request() == request
    kept = request_of(request, settings, ((0, 0), (1, 1)))
    assert kept is not None
    assert scenario_of(kept, "it") == scenario
    assert request_of(request, Settings(stop=StopParams(max_seconds=1)), ((0, 0), (1, 1))) is None


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ({}, r"\[terrain\] or a drawn \[world\]"),
        ({**DRAWN, **MAPPED}, "not both"),
        ({"terrain": {"dem": ["x"]}}, "drive.start and drive.goal"),
        ({"terrain": {"dem": []}, "drive": MAPPED["drive"]}, "name dem, or store and region"),
        ({**DRAWN, "colour": 1}, "colour is not known"),
        ({**DRAWN, "obstacles": {"crates": -1}}, r"obstacles\.crates"),
        ({**DRAWN, "obstacles": {"boxes": [{"x_m": 1}]}}, "x_m and y_m, or along"),
        ({**DRAWN, "obstacles": {"boxes": [{"x_m": 1, "y_m": 1, "along": 0.5}]}}, "x_m and y_m, or along"),
        ({**DRAWN, "sensors": {"beam_dropout": 1.5}}, r"sensors\.beam_dropout.*1\.5"),
        ({**DRAWN, "sensors": {"sensor": "radar"}}, r"sensors\.sensor.*sonar"),
        ({**DRAWN, "sensors": {"sensor": "sonar"}, "drive": {"method": "player"}}, "laser or both"),
        ({**DRAWN, "drive": {"method": "dwa"}}, r"drive\.method.*vfh"),
        ({**DRAWN, "drive": {"arrival_m": float("nan")}}, r"drive\.arrival_m"),
        ({**MAPPED, "truth": {"patches": [{"soil": "mud", "radius_m": 1, "along": 0.5}]}}, r"truth\.patches\.0\.soil"),
        ({**DRAWN, "probing": {"policy": "every"}}, "no map of the soil"),
        ({**DRAWN, "seed": -1}, "seed"),
    ],
)
def test_a_wrong_field_is_named(content: dict[str, object], named: str) -> None:
    with pytest.raises(InvalidScenarioError, match=named):
        scenario_of(content, "The scenario")


def test_all_wrong_fields_are_named_at_once() -> None:
    with pytest.raises(InvalidScenarioError) as told:
        load_scenario("crates").with_changes({"obstacles.crates": -1, "drive.hurry": True})
    assert "obstacles.crates" in told.value.message
    assert "drive.hurry is not known" in told.value.message


def test_paths_of_a_file_are_those_of_its_folder(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'vehicle = "rover.toml"\n[terrain]\ndem = ["dem.tif", "bundled:heath"]\nsoil = "soil.gpkg"\n'
        "[drive]\nstart = [0, 0]\ngoal = [1, 1]\n"
    )
    scenario = load_scenario(path)
    assert scenario.terrain is not None
    assert scenario.terrain.dem == (str(tmp_path / "dem.tif"), "bundled:heath")
    assert scenario.terrain.soil == str(tmp_path / "soil.gpkg")
    assert scenario.vehicle == str(tmp_path / "rover.toml")


def test_files_that_are_no_scenarios_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(InvalidScenarioError, match="did you mean 'paper'"):
        load_scenario("papre")
    with pytest.raises(MissingFileError, match="nowhere"):
        load_scenario(tmp_path / "nowhere.toml")
    (tmp_path / "a.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UnreadableFileError, match="UTF-8"):
        load_scenario(tmp_path / "a.toml")
    (tmp_path / "b.toml").write_text("title = ")
    with pytest.raises(InvalidScenarioError, match="not valid TOML"):
        load_scenario(str(tmp_path / "b.toml"))
    (tmp_path / "c.toml").write_text("a=" + "[" * 5000 + "]" * 5000)
    with pytest.raises(InvalidScenarioError, match="nested"):
        load_scenario(str(tmp_path / "c.toml"))
    with pytest.raises(UnreadableFileError, match="not a scenario file"):
        load_scenario(tmp_path)
