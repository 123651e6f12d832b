"""Noisy sensors are the same ones in a drive, in trials of a scenario and in trials of drawn worlds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NoReturn

import commands
from swathe import driving, proving, trials
from swathe.errors import InputError
from swathe.scenario import load_scenario

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

    from swathe.proving import MapTrial
    from swathe.scenario import Scenario

#: Every tenth beam lost, scans 0.1 s late, odometry off by 2 %, a fix of 0.3 m once a second that is weighed against
#: it. The published trials were driven with these.
FIGURES = {
    "beam_dropout": 0.1,
    "scan_delay_s": 0.1,
    "scale_error": 0.02,
    "distance_noise_m": 0.02,
    "heading_noise_rad": 0.01,
    "fix_rate_hz": 1.0,
    "fix_noise_m": 0.3,
    "fix_heading_noise_rad": 0.05,
    "fuses_fixes": True,
}


class Asked:
    """Stands for what would drive, and keeps what it was asked for."""

    def __init__(self) -> None:
        self.scenarios: list[Scenario] = []

    def drive(self, scenario: Scenario, *_given: Any, **_more: Any) -> NoReturn:
        self.scenarios.append(scenario)
        raise InputError("Not driven.", "This is a test.")

    def run_all(self, _job: Any, items: list[MapTrial], **_more: Any) -> NoReturn:
        self.drive(items[0].scenario)


def test_a_noisy_drive_has_the_noise_of_trials(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    asked = Asked()
    monkeypatch.setattr(driving, "drive", asked.drive)
    monkeypatch.setattr(trials, "run_all", asked.run_all)
    out = ("--out", str(tmp_path / "out"))
    assert commands.run_here(capsys, "drive", "--scenario", "crates", "--sensor", "both", "--noise", *out).code == 4
    assert commands.run_here(capsys, "trials", "--scenario", "crates", "--runs", "1", "--noise", *out).code == 4
    drawn = proving.scenario_of_trial(trials.Trial(seed=1, noisy=True))
    usual = load_scenario("crates").sensors.model_dump()
    driven, tried = (scenario.sensors.model_dump() for scenario in asked.scenarios)
    assert driven == usual | FIGURES | {"sensor": "both"}
    assert tried == usual | FIGURES
    assert drawn.sensors.model_dump() == usual | FIGURES | {"laser": drawn.sensors.laser}


def test_without_noise_nothing_is_late_lost_or_off(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = Asked()
    monkeypatch.setattr(driving, "drive", asked.drive)
    assert commands.run_here(capsys, "drive", "--scenario", "crates").code == 4
    assert not any(asked.scenarios[0].sensors.model_dump()[name] for name in FIGURES)
