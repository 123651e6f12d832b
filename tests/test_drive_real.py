"""A drive on real terrain whose soil map is wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from swathe.preparation import Stopwatch
from swathe.scenario import scenario_of
from swathe.staging import stage

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("policy", ["never", "where-it-pays"])
def test_a_husky_crosses_fort_bragg_among_crates_with_a_wrong_soil_map(policy: str, swathe_data: Path) -> None:
    folder = swathe_data / "fortbragg"
    scenario = scenario_of(
        {
            "vehicle": "husky",
            "seed": 1,
            "terrain": {
                "dem": [str(folder / "fortbragg_elevation_2016_1m.tif")],
                "soil": str(folder / "fortbragg_soils.gpkg"),
                "points_crs": "native",
            },
            "drive": {"start": (597_250, 150_650), "goal": (597_600, 150_980)},
            "probing": {"policy": policy},
            "truth": {"soil_error": 0.4},
            "obstacles": {"crates": 60},
        },
        "Fort Bragg",
    )
    made = stage(scenario, watch=Stopwatch())
    assert made.found is not None
    assert made.world is not None
    told = made.found.shown.region.soil
    assert told is not None
    assert 0.3 < np.mean(np.asarray(made.world.soil) != np.asarray(told)) < 0.5
    episode, navigator = made.episode()
    before = navigator.ranks
    while episode.outcome is None:
        episode.advance(10.0)
    outcome = episode.outcome
    assert (outcome.status, outcome.collisions, outcome.no_go_entries) == ("reached", 0, 0), outcome
    assert outcome.distance_m < 1.1 * made.route.length_m
    assert outcome.replans > 100
    # What was read of the soil changed what the ground is worth; without readings nothing did.
    assert (outcome.probes > 2) == (policy != "never")
    assert before is not None
    assert navigator.ranks is not None
    assert (navigator.ranks != before).any() == (policy != "never")
