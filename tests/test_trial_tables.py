"""The tables of trials: rows that stay, runs that go on, ways of driving side by side."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import trial_report
import trial_rows
import trials as bench
import trials_plot
from swathe import proving, trials
from swathe.vehicle import load_vehicle

WORDS = st.text('a "word", and another.')
ROWS = st.builds(
    trials.Row,
    seed=st.integers(0, 2**64 - 1),
    kind=WORDS,
    density=st.floats(0, 36),
    vehicle=WORDS,
    method=WORDS,
    status=WORDS,
    reason=WORDS,
    alone=st.booleans(),
    shortest_m=st.none() | st.floats(0, 1e3),
    goal_distance_m=st.floats(0, 1e3),
    free_s=st.floats(0, 1e3),
)
MAP_ROWS = st.builds(
    proving.MapRow,
    arm=WORDS,
    status=WORDS,
    reason=WORDS,
    planned_s=st.none() | st.floats(0, 1e4),
    best_s=st.none() | st.floats(0, 1e3),
    grids_differed=st.none() | st.floats(0, 1),
)


def run_set(folder: Path, count: int, *, code: str = "a", again: bool = False) -> list[trials.Row]:
    asked = [trials.Trial(seed=seed, density=0.0, vehicle="husky") for seed in range(count)]
    rows, complete = trial_rows.run_set(
        folder, "open", asked, bench.DRIVES, code=code, arguments=["--open"], processes=1, again=again
    )
    assert complete
    assert [row.seed for row in rows[:count]] == list(range(count))
    return rows


def row(seed: int, status: str, duration_s: float, **fields: object) -> trials.Row:
    known = trials.Row(
        seed=seed,
        kind="clutter",
        density=1.0,
        vehicle="jackal",
        method="vfh+",
        alone=False,
        noisy=False,
        shortest_m=30.0,
        fastest_s=15.0,
        status=status,
        duration_s=duration_s,
        distance_m=30.0,
    )
    return replace(known, **fields)  # type: ignore[arg-type]  # fields of a row


@given(st.lists(ROWS, max_size=4))
def test_rows_come_back_from_their_file(rows: list[trials.Row]) -> None:
    assert trial_rows.rows_of(trial_rows.text_of(rows, trials.Row), trials.Row) == rows


@given(st.lists(MAP_ROWS, max_size=4))
def test_rows_of_scenarios_come_back_from_their_file(rows: list[proving.MapRow]) -> None:
    assert trial_rows.rows_of(trial_rows.text_of(rows, proving.MapRow), proving.MapRow) == rows


@given(st.lists(ROWS, min_size=1, max_size=3), st.data())
def test_of_a_file_that_was_cut_every_whole_row_is_kept(rows: list[trials.Row], data: st.DataObject) -> None:
    whole = trial_rows.text_of(rows, trials.Row)
    last = trial_rows.text_of(rows[-1:], trials.Row, head=False)
    cut = data.draw(st.integers(1, len(last)))
    assert trial_rows.rows_of(whole[:-cut], trials.Row) == rows[:-1]


def test_what_the_same_code_has_run_is_not_run_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = run_set(tmp_path, 2)
    assert "0 there, 2 to run" in capsys.readouterr().out
    more = run_set(tmp_path, 3)
    assert "2 there, 1 to run" in capsys.readouterr().out
    assert more[:2] == first
    # As a run leaves it that was killed while it wrote the last row.
    path = tmp_path / "open.csv"
    path.write_text(path.read_text()[:-9])
    run_set(tmp_path, 3)
    assert "2 there, 1 to run" in capsys.readouterr().out
    assert len(run_set(tmp_path, 1)) == 3
    run_set(tmp_path, 2, code="b")
    assert "0 there, 2 to run" in capsys.readouterr().out
    run_set(tmp_path, 2, code="b", again=True)
    assert "0 there, 2 to run" in capsys.readouterr().out
    note = json.loads((tmp_path / trial_rows.NOTES).read_text())["open"]
    assert note["code"] == "b"
    assert {"commit", "command", "machine", "date", "versions", "wall_s"} <= note.keys()


def test_the_code_is_all_that_can_change_a_row(tmp_path: Path) -> None:
    for name in (
        "Cargo.lock",
        "crates/a/src/lib.rs",
        "python/swathe/sim.py",
        "python/swathe/report/map.py",
        "docs/a.md",
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("one")
    code = trial_rows.code_of(tmp_path)
    for name, matters in (
        ("docs/a.md", False),
        ("python/swathe/report/map.py", False),
        ("python/swathe/sim.py", True),
        ("crates/a/src/lib.rs", True),
        ("Cargo.lock", True),
    ):
        (tmp_path / name).write_text("two")
        assert (trial_rows.code_of(tmp_path) != code) == matters, name
        (tmp_path / name).write_text("one")
    assert trial_rows.code_of(tmp_path) == code


def test_two_ways_of_driving_are_compared_on_what_both_drove() -> None:
    these = [row(seed, "reached", 20.0 + seed) for seed in range(8)] + [row(8, "reached", 9.0), row(10, "reached", 9.0)]
    others = [row(seed, "reached", 10.0) for seed in range(8)] + [row(8, "timeout", 900.0)]
    others.append(row(10, "not_passable", 0.0))
    line = trial_report.pair_row("a", these, others)
    ratios = [2.0 + seed / 10 for seed in range(8)]
    p = stats.wilcoxon(ratios, [1.0] * 8).pvalue
    assert line.startswith("| a | 9 | 1 / 0, p = 1.000 | 8 | 1.00 (1.00 to 1.00), p = 1.000 | 2.35 (")
    assert line.endswith(f"p = {p:.3f} |")


def test_the_page_and_the_picture_show_what_there_is(tmp_path: Path) -> None:
    folder = tmp_path / "rows"
    folder.mkdir()
    drawn = [
        row(
            seed,
            "reached" if seed % 3 else "timeout",
            20.0 + seed,
            density=seed % 36,
            vehicle=trials.VEHICLES[seed % 7],
        )
        for seed in range(120)
    ]
    (folder / "drawn.csv").write_text(trial_rows.text_of(drawn, trials.Row))
    note = {"machine": {"processor": "abacus", "cores": 2}, "commit": "c0ffee", "code": "f" * 64, "wall_s": 5.0}
    (folder / trial_rows.NOTES).write_text(json.dumps({"drawn": note}))
    bench.publish(folder, tmp_path / "TRIALS.md", tmp_path / "trials.png")
    page = (tmp_path / "TRIALS.md").read_text()
    assert "## 120 drawn worlds" in page
    assert "| all | 120 | 66.7 % (57.8 to 74.5) |" in page
    assert "](trials.png)" in page
    assert "Methods" not in page
    assert "| drawn | 120 | ffffffffffff | c0ffee | abacus, 2 cores | 5 s |" in page
    assert (tmp_path / "trials.png").stat().st_size < 200_000
    trials_plot.draw(tmp_path / "none.png", [])


def test_the_page_tells_why_goals_were_not_reached_with_and_without_noise(tmp_path: Path) -> None:
    hit = {"reason": "The vehicle ran into something.", "collisions": 1}
    drawn = [row(0, "reached", 20.0), row(1, "timeout", 1800.0), row(2, "not_passable", 0.0, shortest_m=None)]
    noisy = [row(3, "collision", 9.0, vehicle=name, **hit) for name in ("tractor", "husky", "tractor")]
    noisy += [row(4, "reached", 9.0, vehicle="tractor"), row(5, "timeout", 1800.0)]
    notes = {}
    for name, rows in (("drawn", drawn), ("noisy", noisy)):
        (tmp_path / f"{name}.csv").write_text(trial_rows.text_of(rows, trials.Row))
        notes[name] = {"machine": {"processor": "abacus", "cores": 2}, "commit": "c", "code": "f", "wall_s": 5.0}
    (tmp_path / trial_rows.NOTES).write_text(json.dumps(notes))
    page = trial_report.page(trial_report.Found.of(tmp_path), None, tmp_path)
    assert "1 of 2 passable drawn worlds:\n\n- 1 x timeout: jackal 1 of 2\n" in page
    told = "- 3 x The vehicle ran into something: husky 1 of 1, tractor 2 of 3\n- 1 x timeout: jackal 1 of 1\n"
    assert f"4 of 5 passable drawn worlds with noise and delay:\n\n{told}" in page


def test_the_page_says_when_drives_have_which_time() -> None:
    page = trial_report.page(trial_report.Found([], [], [], {}, {}, {}), None, Path())
    jackal, tractor = load_vehicle("jackal"), load_vehicle("tractor")
    assert "over after 1800 s" in page
    assert trials.limit_s(jackal, 0.0) == 1800 < trials.limit_s(tractor, 0.0)
    assert "after 20\ntimes what the shortest way takes at full speed" in page
    assert trials.limit_s(jackal, 1000.0) == 20 * 1000


def test_the_page_says_which_methods_had_less_time(tmp_path: Path) -> None:
    rows = {
        "full-vfh": [row(0, "timeout", 1800.0), row(1, "reached", 9.0)],
        "alone-player": [row(0, "timeout", 900.0), row(1, "reached", 9.0)],
    }
    page = trial_report.page(trial_report.Found([], [], [], rows, {}, {}), None, tmp_path)
    assert page.count("by an earlier rule") == 1
    assert "Drives of Player's alone were over after 900 s, by an earlier rule." in page


@pytest.mark.parametrize("words", [["--only", "draughts"], ["--worlds", "0"]])
def test_what_cannot_be_run_is_refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        bench.main(words)
    assert "drawn, noisy, open, methods, grids" in capsys.readouterr().err


def test_only_the_sets_that_are_asked_for_are_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run: list[str] = []

    def note(_folder: Path, name: str, *_given: object, **_more: object) -> tuple[list[trials.Row], bool]:
        run.append(name)
        return [], True

    monkeypatch.setattr("trial_rows.run_set", note)
    few = ["--folder", str(tmp_path), "--only", "open,methods", "--methods", "1", "--open", "1"]
    assert bench.main([*few, "--sets", "full-vfh,open"]) == 0
    assert run == ["open", "full-vfh"]
    with pytest.raises(SystemExit):
        bench.main([*few, "--sets", "full-vfh,drawn"])
    assert "open, alone-vfh, full-vfh," in capsys.readouterr().err


def test_every_set_is_of_its_own_and_named_once() -> None:
    sets = [asked for group, _, _ in bench.GROUPS.values() for asked in group(3)]
    assert len({asked.name for asked in sets}) == len(sets)
    for asked in sets:
        keys = [asked.job.key_of_item(item) for item in asked.items]
        assert len(set(keys)) == len(keys) > 0
    methods = [asked for asked in sets if asked.name.startswith(("alone", "full"))]
    assert len(methods) == 8
    assert len({tuple(trial.seed for trial in asked.items) for asked in methods}) == 1


def test_without_options_as_many_drives_are_run_as_the_readme_says() -> None:
    readme = Path(bench.__file__).with_name("README.md").read_text(encoding="utf-8")
    said = dict(re.findall(r"\| `(\w+)` \|.*\| ([\d,]+) \|\n", readme))
    for name, (group, usual, _) in bench.GROUPS.items():
        assert said[name] == f"{sum(len(asked.items) for asked in group(usual)):,}", name
