"""What drives of a scenario are judged by: the best route on the ground as it is, which the map need not tell."""

from __future__ import annotations

import pytest

from swathe.proving import MapTrial, run_map_trial
from swathe.scenario import scenario_of

BOUNDS = (20, 10, 120, 110)

# Clay that the map does not show lies across the way. At 40 % it does not carry a tractor, on a normal day it does.
CLAY = [{"soil": "clay", "x_m": 70, "y_m": 60, "radius_m": 15}]


@pytest.mark.parametrize(
    ("planned", "true", "carries"),
    [("normal", None, True), ("normal", "40", False), ("40", None, False), ("40", "normal", True)],
)
def test_the_best_route_is_that_of_the_true_moisture(planned: str, true: str | None, *, carries: bool) -> None:
    scenario = scenario_of(
        {
            "vehicle": "tractor",
            "terrain": {"dem": ["bundled:fields"], "soil": "bundled:fields", "points_crs": "native", "bounds": BOUNDS},
            "plan": {"moisture": planned, "method": "exact"},
            "drive": {"start": (40, 60), "goal": (100, 60), "time_limit_s": 3},
            "truth": {"patches": CLAY, **({} if true is None else {"moisture": true})},
        },
        "it",
    )
    row = run_map_trial(MapTrial("it", scenario))
    assert row.best_m is not None
    assert (row.best_m < 63) == carries, row
    assert row.best_m < 90
