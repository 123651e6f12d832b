"""What readings are good for: the same drives with a false soil map, with and without them."""

from __future__ import annotations

import pytest

from swathe import trials
from swathe.proving import MapRow, MapTrial, run_map_trial
from swathe.scenario import load_scenario

# As they come: neither arm was looked at to choose them.
SEEDS = range(1000, 1006)


@pytest.fixture(scope="module")
def rows() -> dict[str, list[MapRow]]:
    base = load_scenario("wrong-soil")
    asked = [
        MapTrial(policy, base.with_changes({"seed": seed, "probing.policy": policy}))
        for seed in SEEDS
        for policy in ("never", "where-it-pays")
    ]
    found, complete = trials.run_all(run_map_trial, asked, processes=2)
    assert complete
    return {policy: [row for row in found if row.arm == policy] for policy in ("never", "where-it-pays")}


def test_a_drive_with_a_false_soil_map_reaches_more_goals_with_readings_than_without(
    rows: dict[str, list[MapRow]],
) -> None:
    blind, probing = ([row.status == "reached" for row in rows[arm]] for arm in ("never", "where-it-pays"))
    assert sum(probing) >= sum(blind) + 2, (rows, blind, probing)


def test_readings_keep_it_off_ground_that_does_not_carry(rows: dict[str, list[MapRow]]) -> None:
    blind, probing = (sum(row.no_go_entries > 0 for row in rows[arm]) for arm in ("never", "where-it-pays"))
    assert blind >= 3
    assert probing <= blind - 2


def test_only_a_drive_that_probes_takes_readings(rows: dict[str, list[MapRow]]) -> None:
    assert all(row.probes == 0 for row in rows["never"])
    assert all(row.probes > 0 for row in rows["where-it-pays"])
