"""The paper's figures: all there, none blank, and flow charts that follow the table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

import commands
from swathe import swarm
from swathe.export.folder import FIGURES
from swathe.report import flow_chart
from swathe.report.paper_figures import mixed_window
from swathe.swarm import Transition, state_texts, transitions

if TYPE_CHECKING:
    from pathlib import Path


def colours(path: Path) -> int:
    return len(np.unique(np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3), axis=0))


def ink(path: Path) -> float:
    """Return the share of a picture that is not paper."""
    return float((np.asarray(Image.open(path).convert("L")) < 250).mean())


def test_every_figure_of_the_bundled_terrain_is_drawn_and_none_is_blank(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    finished = commands.run_here(capsys, "figures", "--out", str(tmp_path / "f"), "--json")
    assert finished.code == 0, finished.err
    assert {path.name for path in (tmp_path / "f").iterdir()} == {*FIGURES, "index.html", "summary.json"}
    page = (tmp_path / "f/index.html").read_text(encoding="utf-8")
    for name in FIGURES:
        path = tmp_path / "f" / name
        assert colours(path) > 20, name
        assert ink(path) > 0.03, name
        assert f'src="{name}"' in page
    assert page.index("swarm-flow.png") < page.index("global-path.png")
    again = commands.run_here(capsys, "figures", "--out", str(tmp_path / "again"), "--json")
    assert again.code == 0
    for name in (*FIGURES, "index.html", "summary.json"):
        assert (tmp_path / "f" / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


def test_ground_without_soil_has_no_soil_figure_and_a_small_vehicle_is_shown_close_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dem = commands.hills(tmp_path)
    finished = commands.run_here(
        capsys, "figures", "--dem", str(dem), "--vehicle", "jackal", "--out", str(tmp_path / "f"), "--json"
    )
    assert finished.code == 0, finished.err
    assert "soil" not in finished.answer["outputs"]
    assert ink(tmp_path / "f/overlapping-grids.png") > 0.1
    outside = commands.run_here(
        capsys, "figures", "--dem", str(dem), "--points-crs", "native", "--start", "1,1", "--goal", "2,2", "--json"
    )
    assert "outside the map" in outside.answer["message"]


@pytest.mark.parametrize("chart", ["swarm", "nest"])
def test_a_flow_chart_draws_every_row_of_the_table_and_nothing_else(
    chart: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[str] = []
    real = flow_chart._words

    def noted(axes: Any, at: tuple[float, float], when: str) -> None:
        drawn.append(when)
        real(axes, at, when)

    monkeypatch.setattr(flow_chart, "_words", noted)
    rows = [row for row in transitions() if row.chart == chart]
    flow_chart.draw_flow_chart(tmp_path / "whole.png", chart, rows, state_texts())
    assert drawn == [row.when for row in rows]
    for missing in range(len(rows)):
        part = [row for number, row in enumerate(rows) if number != missing]
        flow_chart.draw_flow_chart(tmp_path / "part.png", chart, part, state_texts())
        assert (tmp_path / "part.png").read_bytes() != (tmp_path / "whole.png").read_bytes(), rows[missing]


def test_a_way_that_no_row_of_the_table_has_is_not_kept_and_a_state_without_a_place_is_noticed(tmp_path: Path) -> None:
    pairs = {(row.chart, row.from_state, row.to_state) for row in transitions()}
    assert set(flow_chart._WAYS) <= pairs
    states = {chart: {state for c, a, b in pairs if c == chart for state in (a, b)} for chart in ("swarm", "nest")}
    assert {chart: set(places) for chart, places in flow_chart._PLACES.items()} == states
    with pytest.raises(KeyError):
        flow_chart.draw_flow_chart(
            tmp_path / "a.png",
            "swarm",
            [Transition("swarm", "forage", "fly", "at night")],
            {**state_texts(), "fly": "Fly"},
        )


def test_questions_of_the_table_have_more_than_one_answer() -> None:
    for state, text in swarm.state_texts().items():
        answers = [row for row in transitions() if row.from_state == state]
        assert not text.endswith("?") or len(answers) > 1, state


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 1.0])
def test_a_window_of_mixed_ground_lies_on_the_map(share: float) -> None:
    suitable = np.random.default_rng(1).random((30, 40)) < share
    for rows, columns in ((2, 3), (16, 20), (60, 60)):
        window = mixed_window(suitable, rows, columns)
        assert (window.rows, window.columns) == (min(rows, 30), min(columns, 40))
        assert 0 <= window.row <= 30 - window.rows
        assert 0 <= window.column <= 40 - window.columns
