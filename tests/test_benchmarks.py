from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import bench_route
import bench_route_peers
import grass_peer
import harness
import plot
import results
import terrain_fields

if TYPE_CHECKING:
    from pathlib import Path


def sample(cpu_s: float, peak_bytes: int | None = None, facts: dict[str, float] | None = None) -> dict[str, Any]:
    return harness.Sample(cpu_s, cpu_s, peak_bytes, facts or {}).as_dict()


def run_file(name: str, ours_s: float, errors: list[str] | None = None) -> str:
    record = {
        "name": name,
        "ours": "ours",
        "peer": "theirs",
        "must": 8,
        "goal": 12,
        "errors": errors or [],
        "samples": {"ours": [sample(ours_s, 2_000_000)], "peer": [sample(1.0), sample(3.0), sample(2.0)]},
    }
    machine = {"processor": "abacus", "cores": 2}
    return json.dumps({"commit": "c0ffee", "machine": machine, "benchmarks": [record]})


def test_every_benchmark_names_both_sides_and_its_bars() -> None:
    benchmarks = harness.load_benchmarks()
    assert {"rank", "regions-4000", "route-1000", "route-2000"} <= set(benchmarks)
    for benchmark in benchmarks.values():
        assert 0 < benchmark.must <= benchmark.goal
        assert benchmark.contender("ours").name != benchmark.contender("peer").name


def test_a_sample_measures_the_job_and_not_its_preparation() -> None:
    contender = harness.Contender(
        "fill",
        prepare=lambda: np.ones(60_000_000, np.uint8).sum(),
        run=lambda _: np.ones(20_000_000, np.uint8),
        facts=lambda _, made: {"bytes": made.nbytes},
    )
    measured = harness.measure(contender, repeats=3)
    assert measured.facts == {"bytes": 20_000_000}
    assert measured.cpu_s > 0
    assert measured.wall_s > 0
    if measured.peak_bytes is not None:
        assert 15_000_000 < measured.peak_bytes < 40_000_000


@pytest.mark.parametrize(
    ("ours", "peer", "relative", "count"),
    [
        ({"cost": 1.0}, {"cost": 1.0}, 0.0, 0),
        ({"cost": 1.0}, {"cost": 1.0 + 1e-9}, 1e-6, 0),
        ({"cost": 1.0}, {"cost": 1.001}, 1e-6, 1),
        ({"cost": 1.001}, {"cost": 1.0}, 1e-6, 1),
        ({"cost": 1.0}, {}, 1e-6, 1),
        ({"cost": 1.0}, {"cost": 2.0}, None, 0),
    ],
)
def test_results_that_disagree_are_said(
    ours: dict[str, float], peer: dict[str, float], relative: float | None, count: int
) -> None:
    samples = {"ours": [sample(1, facts=ours)], "peer": [sample(1, facts=peer)]}
    assert len(results.disagreements(samples, relative)) == count


def test_the_table_shows_the_newest_figures_of_each_job_and_marks_what_failed(tmp_path: Path) -> None:
    (tmp_path / "1.json").write_text(run_file("route", 1.0), encoding="utf-8")
    (tmp_path / "2.json").write_text(run_file("route", 0.5), encoding="utf-8")
    (tmp_path / "3.json").write_text(run_file("rank", 0.5, ["results disagree on cost"]), encoding="utf-8")
    text = results.table(tmp_path)
    assert "| route | 0.5000 | 2.0000 | **4.00** | 8 | 12 | 2.0 | - |" in text
    assert "| rank | 0.5000 | 2.0000 | failed |" in text
    assert "- rank: results disagree on cost" in text


def test_the_table_tells_what_one_step_takes_where_samples_say_how_many_they_did(tmp_path: Path) -> None:
    run = json.loads(run_file("navigator-step", 1.0))
    run["benchmarks"].append(json.loads(run_file("route", 1.0))["benchmarks"][0])
    facts = {"steps": 1000.0, "p99_us": 700.0}
    run["benchmarks"][0]["samples"] = {
        "ours": [sample(0.2, facts=facts), sample(0.3, facts=facts | {"p99_us": 750.0})],
        "peer": [sample(2.0)],
    }
    (tmp_path / "1.json").write_text(json.dumps(run), encoding="utf-8")
    text = results.table(tmp_path)
    assert "| job | one | mean | 99 % | peer, mean | must | goal | bytes | machine |" in text
    assert "| navigator-step | step | 250.0 | 725.0 | - | 2000, 99 % | 500, 99 % | - | abacus, 2 cores |" in text
    assert "| route | step" not in text
    run["benchmarks"][:1] = []
    (tmp_path / "1.json").write_text(json.dumps(run), encoding="utf-8")
    assert "CPU time of one" not in results.table(tmp_path)


def test_a_pipe_in_a_name_ends_no_cell(tmp_path: Path) -> None:
    run = json.loads(run_file("load", 1.0))
    run["benchmarks"][0]["peer"] = "load | run"
    (tmp_path / "1.json").write_text(json.dumps(run), encoding="utf-8")
    assert "| load | `ours` | load \\| run | [1.json]" in results.table(tmp_path)


def test_bytes_are_told_of_one_too(tmp_path: Path) -> None:
    run = json.loads(run_file("log", 1.0))
    facts = {"seconds": 20.0, "bytes": 3_000_000.0}
    run["benchmarks"][0]["samples"] = {
        "ours": [sample(0.01, facts=facts)],
        "peer": [sample(0.02, facts={"seconds": 20})],
    }
    (tmp_path / "1.json").write_text(json.dumps(run), encoding="utf-8")
    assert "| log | second | 500.0 | 1000.0 | - | - | 150000 | abacus, 2 cores |" in results.table(tmp_path)


@pytest.mark.parametrize(("ours", "peer", "count"), [(1.0, 1.0, 0), (0.9, 1.0, 0), (1.0 + 1e-9, 1.0, 0), (1.1, 1.0, 1)])
def test_a_dearer_path_than_the_peers_is_said(ours: float, peer: float, count: int) -> None:
    samples = {"ours": [sample(1, facts={"cost": ours})], "peer": [sample(1, facts={"cost": peer})]}
    assert len(results.dearer(samples)) == count


def test_the_picture_shows_every_job_that_did_not_fail(tmp_path: Path) -> None:
    picture = tmp_path / "results.png"
    plot.draw(tmp_path, picture)
    assert not picture.exists()
    (tmp_path / "1.json").write_text(run_file("route", 0.5), encoding="utf-8")
    plot.draw(tmp_path, picture)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_peers_agree_with_each_other_on_the_cost() -> None:
    field = bench_route_peers.costs(90)
    truth = bench_route_peers.facts(field, bench_route_peers.route_of_scipy(field))
    assert bench_route_peers.facts_of_ours(field, bench_route_peers.route_of_ours(field)) == pytest.approx(truth)


def test_a_path_that_grass_writes_becomes_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    location = object.__new__(grass_peer.Location)
    monkeypatch.setattr(location, "_region", lambda: {"n": 30.0, "w": 500.0, "nsres": 10.0, "ewres": 10.0})
    text = ["VERTI:", "L  3 1", " 525  5", " 515.5 15", " 505 25", " 1     1"]
    assert location._cells(text).tolist() == [[0, 0], [1, 1], [2, 2]]


def test_the_cost_of_a_path_is_metres_times_the_mean_of_both_cells() -> None:
    costs = np.array([[1.0, 3.0], [5.0, 7.0]])
    assert bench_route.path_cost(costs, [(0, 0), (0, 1), (1, 0)]) == pytest.approx(2 + 2**0.5 * 4)
    with pytest.raises(ValueError, match="jumps or stands still"):
        bench_route.path_cost(costs, [(0, 0), (0, 0)])


def test_fields_are_the_same_every_time_and_hold_what_they_promise() -> None:
    assert np.array_equal(terrain_fields.elevation(200), terrain_fields.elevation(200))
    assert set(np.unique(terrain_fields.ranks(400))) == set(range(1, 11))
    assert set(np.unique(terrain_fields.soil_codes(400))) <= set(range(6))
    costs = terrain_fields.costs(400)
    assert costs.min() >= 1
    assert costs.max() <= 8
