"""The demo: the story that it tells, and everything that it leaves behind."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

import commands
from commands import PLAN_FILES
from swathe.cli import story
from swathe.export.folder import DRIVE_PICTURES, RUN_LOG
from swathe.runlog import RunLog
from swathe.scenario import load_scenario

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder that the demo leaves, and what it says."""
    place = tmp_path_factory.mktemp("demo")
    finished = commands.run("demo", cwd=place)
    assert (finished.code, finished.err) == (0, "")
    return place / "swathe-demo", finished.out


def test_the_demo_tells_its_story(demo: tuple[Path, str]) -> None:
    folder, out = demo
    assert out.rstrip().endswith("swathe-demo/tractor/report.html")
    told: dict[str, Any] = {}
    for chapter in ("tractor", "no-soil", "pickup", "ridge-tractor", "ridge-pickup"):
        told[chapter] = json.loads((folder / chapter / "summary.json").read_text())
    assert told["tractor"]["length_m"] > 1.5 * told["tractor"]["straight_m"], "a long way round"
    assert told["tractor"]["length_m"] > 1.2 * told["no-soil"]["length_m"], "because of the soil"
    assert told["pickup"]["length_m"] < 1.15 * told["pickup"]["straight_m"], "the 4x4 goes nearly straight"
    assert told["ridge-tractor"]["status"] == "no_route"
    assert told["ridge-tractor"]["reason"] in out
    assert told["ridge-pickup"]["status"] == "route_found"
    for summary in told.values():
        assert summary["soil"] is None or "generated" in " ".join(summary["notes"])


def test_the_demo_drives_a_field_leg_and_leaves_its_log_pictures_and_film(demo: tuple[Path, str]) -> None:
    folder, out = demo[0] / "drive", demo[1]
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["status"], summary["collisions"], summary["no_go_entries"]) == ("reached", 0, 0)
    assert summary["goal_distance_m"] < 1
    assert summary["distance_m"] > summary["plan"]["length_m"], "around things that no map shows"
    assert "among things that no map shows: reached the goal;" in out
    assert "swathe-demo/drive/report.html" in out
    names = {path.name for path in folder.iterdir()}
    assert names == {*PLAN_FILES, "drivable.geojson", RUN_LOG, *DRIVE_PICTURES}
    assert set(summary["outputs"].values()) == names
    log = RunLog.read(folder / RUN_LOG)
    assert log.is_complete
    assert log.outcome is not None
    assert (log.outcome["status"], log.outcome["distance_m"]) == ("reached", summary["distance_m"])
    for name in DRIVE_PICTURES:
        with Image.open(folder / name) as picture:
            frames = getattr(picture, "n_frames", 1)
            assert (frames > 20) == (name == "drive.gif"), name
            levels = np.asarray(picture.convert("L"))
            assert np.ptp(levels) > 100, f"{name} shows something"
    page = (folder / "report.html").read_text()
    assert page.count("data:image/gif;base64,") == 1


def test_a_demo_whose_drive_does_not_arrive_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        story, "load_scenario", lambda name: load_scenario(name).with_changes({"drive.time_limit_s": 2.0})
    )
    assert story.tell(tmp_path / "demo", as_json=False, quiet=True) == 3
