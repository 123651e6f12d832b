"""Trials: what is drawn, what is judged, and what the numbers mean."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from swathe import trials

WORLDS = 40


def told(row: trials.Row) -> dict[str, object]:
    return {**asdict(row), "cpu_s": 0.0}


@pytest.fixture(scope="module")
def rows() -> list[trials.Row]:
    drawn = [trials.draw(seed) for seed in range(WORLDS)]
    # The CI's part: half as dense as the whole range, so that forty drives stay short.
    easier = [replace(trial, density=round(trial.density / 2, 2)) for trial in drawn]
    found, complete = trials.run(easier, processes=2)
    assert complete
    return found


def test_forty_worlds_hold_what_is_promised(rows: list[trials.Row]) -> None:
    summary = trials.summarise(rows)
    assert summary.trials == WORLDS
    assert summary.passable >= 0.8 * WORLDS
    assert summary.reached_share >= 0.9, trials.worst(rows, 6)
    static = [row for row in rows if row.kind != "moving"]
    # None is wanted; one was seen (a Pioneer in a packed trap).
    assert trials.summarise(static).collisions_seen <= 1, [row for row in static if row.seen_in_time]
    # One is seen: what crosses is told from its traces, not always in time.
    assert summary.collisions_seen <= 2, [row for row in rows if row.seen_in_time]
    assert trials.summarise(static).reached_share >= 0.9, trials.worst(rows, 6)
    jackal = [row for row in static if row.vehicle == "jackal"]
    assert trials.summarise(jackal).time_ratio[0] <= 2.2


def test_nothing_is_shorter_or_faster_than_the_truth_allows(rows: list[trials.Row]) -> None:
    for row in rows:
        if row.status == "reached":
            assert row.length_ratio is not None
            # The search goes along sixteen directions and ends nearer to the goal than the robot must.
            assert row.length_ratio > 0.93
            assert row.time_ratio is not None
            assert row.time_ratio > 1.0
            assert row.goal_distance_m < 1.0


def test_trials_are_drawn_evenly_from_what_there_is() -> None:
    drawn = [trials.draw(seed) for seed in range(4000)]
    for name, share in (("kind", trials.KINDS), ("vehicle", trials.VEHICLES)):
        expected = {value: share.count(value) / len(share) for value in share}
        found = [sum(getattr(trial, name) == value for trial in drawn) for value in expected]
        assert stats.chisquare(found, [4000 * part for part in expected.values()]).pvalue > 1e-3
    low, high = trials.DENSITIES
    spread = stats.uniform(low, high - low)
    assert stats.kstest([trial.density for trial in drawn], spread.cdf).pvalue > 1e-3
    pairs = [(trials.KINDS.index(trial.kind), trial.density) for trial in drawn]
    assert stats.spearmanr(pairs).pvalue > 1e-3


def test_rows_are_the_same_in_any_number_of_workers() -> None:
    asked = [trials.Trial(seed=seed, density=4.0) for seed in range(3)]
    alone, _ = trials.run(asked, processes=1)
    together, _ = trials.run(asked, processes=2, chunk=1)
    assert [told(row) for row in alone] == [told(row) for row in together]


def test_an_interrupt_keeps_what_is_done() -> None:
    def stop(done: int, count: int) -> None:
        assert count == 5
        if done == 2:
            raise KeyboardInterrupt

    kept, complete = trials.run([trials.Trial(seed=seed) for seed in range(5)], processes=1, progress=stop)
    assert not complete
    assert [row.seed for row in kept] == [0, 1]


def test_rows_come_back_from_their_table(rows: list[trials.Row]) -> None:
    lines = list(csv.DictReader(io.StringIO(trials.csv_text(rows))))
    assert len(lines) == len(rows)
    for line, row in zip(lines, rows, strict=True):
        assert int(line["seed"]) == row.seed
        assert line["status"] == row.status
        assert (line["shortest_m"] == "") == (row.shortest_m is None)
        assert trials.trial_of(row).seed == row.seed


def test_the_bootstrap_agrees_with_scipys() -> None:
    values = np.random.default_rng(7).lognormal(0.0, 0.6, size=80)
    middle, low, high = trials.bootstrap_median(values, draws=20_000)
    expected = stats.bootstrap(
        (values,), np.median, n_resamples=20_000, method="percentile", rng=np.random.default_rng(1)
    ).confidence_interval
    assert middle == np.median(values)
    # Both draw: their ends differ by the distance of neighbours in the data.
    assert low == pytest.approx(expected.low, abs=0.03)
    assert high == pytest.approx(expected.high, abs=0.03)


@given(count=st.integers(1, 2000), share=st.floats(0, 1))
def test_wilsons_interval_is_scipys(count: int, share: float) -> None:
    successes = round(share * count)
    low, high = trials.wilson(successes, count)
    expected = stats.binomtest(successes, count).proportion_ci(0.95, "wilson")
    assert low == pytest.approx(expected.low, abs=1e-6)
    assert high == pytest.approx(expected.high, abs=1e-6)


def test_the_bootstrap_covers_the_median_as_often_as_it_says() -> None:
    chance = np.random.Generator(np.random.PCG64(1))
    hits = 0
    for seed in range(200):
        _, low, high = trials.bootstrap_median(chance.lognormal(0.0, 0.5, size=60), seed=seed, draws=400)
        hits += low <= 1.0 <= high
    assert 0.90 <= hits / 200 <= 0.99
    assert all(math.isnan(figure) for figure in trials.bootstrap_median([]))
