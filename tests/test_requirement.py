from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import requirement


@pytest.mark.parametrize(
    ("switch", "expected"),
    [
        ("", frozenset()),
        (" , ", frozenset()),
        ("gdal", frozenset({"gdal"})),
        ("gdal, data", frozenset({"gdal", "data"})),
        ("all", requirement.KNOWN),
    ],
)
def test_the_switch_names_what_must_be_there(switch: str, expected: frozenset[str]) -> None:
    assert requirement.required_names(switch) == expected


def test_a_name_nobody_knows_is_refused_with_the_known_ones() -> None:
    with pytest.raises(
        ValueError, match=r"names gdall\. It may be: all, or some of browser, data, gdal, git, grass, postgis\."
    ):
        requirement.required_names("gdall")


def test_missing_is_a_skip_unless_it_is_required(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SWATHE_REQUIRE", "data")
    with pytest.raises(pytest.skip.Exception, match="sudo apt-get install --no-install-recommends gdal-bin"):
        requirement.program("gdal", ("no-such-program",), "gdal-bin")
    monkeypatch.setenv("SWATHE_REQUIRE", "all")
    with pytest.raises(pytest.fail.Exception, match="SWATHE_REQUIRE asks for gdal"):
        requirement.program("gdal", ("no-such-program",), "gdal-bin")


def test_the_second_candidate_is_found() -> None:
    assert requirement.program("git", ("no-such-program", "sh"), "dash").name == "sh"


def test_a_relative_data_folder_counts_from_the_root(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SWATHE_DATA", "python")
    assert requirement.data_folder() == requirement.ROOT / "python"


def test_without_data_a_test_is_skipped_and_a_wrong_folder_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SWATHE_REQUIRE", raising=False)
    monkeypatch.delenv("SWATHE_DATA", raising=False)
    with pytest.raises(pytest.skip.Exception, match="SWATHE_DATA is not set"):
        requirement.data_folder()
    monkeypatch.setenv("SWATHE_DATA", "no/such/folder")
    with pytest.raises(pytest.skip.Exception, match="no/such/folder"):
        requirement.data_folder()


def test_a_run_with_an_unknown_requirement_stops_at_once(tmp_path: Path) -> None:
    source = Path(__file__).with_name("conftest.py")
    (tmp_path / "conftest.py").write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "test_nothing.py").write_text("def test_nothing(): pass\n", encoding="utf-8")
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)],
        env={"PYTHONPATH": str(source.parent), "PATH": "/usr/bin:/bin", "SWATHE_REQUIRE": "everything"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == pytest.ExitCode.USAGE_ERROR
    assert "SWATHE_REQUIRE names everything" in run.stderr
