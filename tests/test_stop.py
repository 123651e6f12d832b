"""What ends a swarm: rules and budgets, from Python and from the command line."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import commands
from commands import GOAL, START
from swathe import planner
from swathe.corridor import CorridorParams
from swathe.errors import InvalidParameterError
from swathe.grid import Cell
from swathe.nest import exact_nests
from swathe.rank import rank_map
from swathe.swarm import Frame, StopParams, Stopped, SwarmParams, Tally, run_swarm
from worlds import region_of, smooth_hills

if TYPE_CHECKING:
    from pathlib import Path

    from swathe.grid import Position
    from swathe.rank import Region
    from swathe.swarm import Rule

ARCS = ("relaid", "spine", "circle", "line")
RULES: tuple[Rule, ...] = ("good", "connected", "finished", "statistical")


def hills() -> Region:
    return region_of(smooth_hills(5, 40, 50, height_m=70, cell_size_m=30, wave_m=500), 30.0)


def exact(region: Region) -> np.ndarray[Any, np.dtype[np.uint32]]:
    return exact_nests(rank_map(region).rank, rank_min=region.params.rank_min).labels


def ends_in(region: Region) -> tuple[Position, Position]:
    """Return the first and the last cell of the largest nest, which lie far apart."""
    labels = exact(region)
    cells = np.argwhere(labels == 1 + np.argmax(np.bincount(labels[labels > 0] - 1)))
    first, last = (region.geometry.position_of(Cell(int(row), int(column))) for row, column in (cells[0], cells[-1]))
    return first, last


@pytest.fixture
def dem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    return str(commands.hills(tmp_path))


@settings(max_examples=40)
@given(
    rule=st.sampled_from(["finished", "statistical"]),
    explore=st.sampled_from(["walk", "uniform", "permute"]),
    seed=st.sampled_from([0, 2**64 - 1, 77]),
    agents=st.integers(1, 3000),
    max_ticks=st.none() | st.integers(0, 60),
    max_evaluations=st.none() | st.integers(0, 2500),
    max_seconds=st.sampled_from([None, 0.0, 1e300]),
)
def test_a_swarm_keeps_its_budgets_and_its_nests_are_nests(
    rule: Any,
    explore: Any,
    seed: int,
    agents: int,
    max_ticks: int | None,
    max_evaluations: int | None,
    max_seconds: float | None,
) -> None:
    region = hills()
    stop = StopParams(
        rule, open_share=0.02, max_ticks=max_ticks, max_evaluations=max_evaluations, max_seconds=max_seconds
    )
    done = run_swarm(region, SwarmParams(agents=agents, explore=explore, seed=seed), stop=stop)
    assert not (done.nests.labels[exact(region) == 0] > 0).any()
    assert done.stopped is not None
    assert done.stopped.unknown_cells == region.geometry.cell_count - done.tally.cells_evaluated
    if max_ticks is not None:
        assert done.tally.ticks <= max_ticks
    if max_evaluations is not None:
        assert done.tally.cells_evaluated <= max_evaluations
    if max_seconds == 0:
        assert done.tally.visits == 0
    if done.stopped.by == "finished":
        assert np.array_equal(done.nests.labels > 0, exact(region) > 0)
    else:
        assert done.stopped.by in {"statistical", "max_ticks", "max_evaluations", "max_seconds"}


@pytest.mark.parametrize("explore", ["walk", "uniform", "permute"])
def test_the_statistical_bound_holds_more_often_than_it_promises(explore: Any) -> None:
    region = hills()
    suitable = rank_map(region).rank >= region.params.rank_min
    stop = StopParams("statistical", open_share=0.02, doubt=0.2)
    broken = 0
    for seed in range(40):
        frames: list[Frame] = []
        params = SwarmParams(agents=20, explore=explore, seed=seed, teleport=0.5)
        done = run_swarm(region, params, stop=stop)
        again = run_swarm(region, params, ticks=done.tally.ticks, on_frame=frames.append, frame_every=10**6)
        assert again.tally == done.tally
        open_share = float((suitable & (frames[-1].pellets == 0)).mean())
        broken += open_share > stop.open_share
    assert broken <= 0.2 * 40


@pytest.mark.parametrize("arc", ARCS)
def test_every_rule_ends_with_a_route_and_says_what_is_unseen(arc: Any) -> None:
    region = hills()
    looked = {}
    for rule in RULES:
        answer = planner.plan(
            region, *ends_in(region), corridor=CorridorParams(arc), stop=StopParams(rule, open_share=0.02)
        )
        assert answer.status == "route_found"
        assert answer.stopped is not None
        # Few cells are soon finished, whatever the rule.
        assert answer.stopped.by in {rule, "finished"}
        assert 0 <= answer.stopped.unknown_share <= 1
        looked[rule] = answer.cells_evaluated
    assert looked["connected"] <= looked["good"] <= looked["finished"]
    assert looked["connected"] < looked["finished"]


def test_pictures_change_nothing_and_show_the_arc_being_laid_anew() -> None:
    region = hills()
    plain = planner.plan(region, *ends_in(region), swarm=SwarmParams(agents=30))
    shown = planner.plan(region, *ends_in(region), swarm=SwarmParams(agents=30), frames=20)
    assert plain.swarm == shown.swarm
    assert plain.path == shown.path
    assert plain.frames == ()
    assert 2 <= len(shown.frames) <= 20
    arcs = [frame.arc for frame in shown.frames if frame.arc is not None]
    assert len(arcs) == len(shown.frames)
    for before, after in itertools.pairwise(shown.frames):
        assert before.tally.ticks < after.tally.ticks
        assert (before.seen <= after.seen).all()
    assert any(not np.array_equal(before, after) for before, after in itertools.pairwise(arcs))
    for arc in arcs:
        assert np.hypot(*(arc[0] - np.array(ends_in(region)[0]))) < 100
    assert shown.frames[-1].is_route
    assert not shown.frames[0].is_route


def test_what_is_left_of_a_budget() -> None:
    stop = StopParams("good", max_ticks=10, max_evaluations=100, max_seconds=2.0)
    left = stop.after(Tally(4, 9, 130, 1, None), 0.5)
    assert left == StopParams("good", max_ticks=6, max_evaluations=0, max_seconds=1.5)
    assert StopParams().after(Tally(4, 9, 130, 1, None), 0.5) == StopParams()
    assert Stopped("max_ticks", 0, 0).unknown_share == 0


@pytest.mark.parametrize(
    "wrong",
    [
        {"rule": "soon"},
        {"max_ticks": -1},
        {"max_evaluations": -5},
        {"max_evaluations": 2**63},
        {"max_seconds": -0.1},
        {"max_seconds": float("nan")},
        {"open_share": 0.0},
        {"doubt": 1.0},
    ],
)
def test_what_cannot_be_kept_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InvalidParameterError):
        StopParams(**wrong)


def test_a_rule_of_start_and_goal_needs_both() -> None:
    for rule in ("good", "connected"):
        with pytest.raises(InvalidParameterError, match="start and a goal"):
            run_swarm(hills(), stop=StopParams(rule))


@pytest.mark.parametrize("budget", ["--max-ticks", "--max-evaluations", "--max-seconds"])
def test_a_budget_of_nothing_is_a_refusal_that_claims_nothing(
    budget: str, dem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    done = commands.run_here(capsys, *commands.way(dem, budget, "0", "--json"))
    assert done.code == 3
    answer = done.answer
    assert answer["status"] == "no_route"
    assert answer["reason"].startswith("Stopped early: ")
    assert answer["reason"].endswith("is not known.")
    assert budget in answer["remedy"]
    assert answer["stopped_by"] == budget.lstrip("-").replace("-", "_")
    assert (answer["cells_evaluated"], answer["unknown_share"]) == (0, 1.0)
    assert answer["stop"]["reproducible"] is (budget != "--max-seconds")
    assert any("were not looked at" in note for note in answer["notes"])


def test_a_route_found_early_says_what_it_does_not_know(dem: str, capsys: pytest.CaptureFixture[str]) -> None:
    whole = commands.run_here(capsys, *commands.way(dem, "--json")).answer
    assert whole["stopped_by"] == "good"
    early = commands.run_here(capsys, *commands.way(dem, "--stop", "connected", "--json")).answer
    assert early["status"] == "route_found"
    assert early["stopped_by"] == "connected"
    assert early["cells_evaluated"] <= whole["cells_evaluated"]
    assert early["unknown_cells"] > 0
    assert any("A better route may exist" in note for note in early["notes"])
    most = whole["cells_evaluated"] - 1
    almost = commands.run_here(capsys, *commands.way(dem, "--max-evaluations", str(most), "--json")).answer
    assert almost["stopped_by"] == "max_evaluations"
    assert almost["status"] == "route_found"
    assert almost["cells_evaluated"] == most


def test_a_statistical_stop_states_its_bound(dem: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("nests", "--dem", dem, "--explore", "uniform", "--stop", "statistical", "--json")
    answer = commands.run_here(capsys, *words).answer
    assert answer["stopped_by"] in {"statistical", "finished"}
    bound = answer["stop"]["statistical"]
    assert (bound["open_share"], bound["holds"]) == (0.001, True)
    assert bound["quiet_visits"] > 2996
    assert bound["confidence"] == pytest.approx(0.95)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--max-ticks=-1",), "-1 ticks"),
        (("--max-seconds=nan",), "nan seconds"),
        (("--max-evaluations=-3",), "-3 evaluations"),
        (("--method", "exact", "--stop", "connected"), "exact pass"),
        (("--method", "exact", "--animate"), "exact pass"),
        (("--stop", "soon"), "soon"),
        (("--max-ticks", "many"), "--max-ticks"),
    ],
)
def test_bad_rules_and_budgets_are_refused_plainly(
    words: tuple[str, ...], said: str, dem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    done = commands.run_here(capsys, *commands.way(dem, *words))
    assert done.code == 2
    assert said in done.err
    assert "Traceback" not in done.err


@pytest.mark.parametrize("arc", ["relaid", "spine"])
def test_a_plan_is_animated(arc: str, tmp_path: Path, dem: str, capsys: pytest.CaptureFixture[str]) -> None:
    answers = [
        commands.run_here(capsys, *commands.way(dem, "--arc", arc, *more, "--json", "--out", name)).answer
        for name, more in (("a", ["--animate"]), ("b", ["--animate"]), ("c", []))
    ]
    for name in ("animation.gif", "animation.html"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
        assert f"a/{name}" in answers[0]["outputs"].values()
    for name in ("route.geojson", "nests.geojson"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "c" / name).read_bytes()
    page = (tmp_path / "a/animation.html").read_text(encoding="utf-8")
    assert '"shown":[' in page
    assert 'class="end goal"' in page


def test_nests_between_two_ends_are_animated_with_their_arc(
    tmp_path: Path, dem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("nests", "--dem", dem, "--points-crs", "native", "--start", START, "--goal", GOAL, "--animate", "--json")
    assert commands.run_here(capsys, *words).code == 0
    assert '"arcs":[' in (tmp_path / "swathe-nests/animation.html").read_text(encoding="utf-8")
