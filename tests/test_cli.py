"""The command line: what it prints where, how it ends, and what it leaves behind."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import psycopg
import pytest

import commands
import raster_files
from commands import GOAL, PLAN_FILES, START, way
from swathe.export.folder import run_folder

if TYPE_CHECKING:
    from collections.abc import Iterator

    from syrupy.assertion import SnapshotAssertion

COMMANDS = (
    "demo", "plan", "nests", "figures", "report", "export", "vehicles", "doctor", "regions", "withdraw", "drive",
    "trials", "replay", "import",
)  # fmt: skip
IMPORTS = ("import dem", "import soil", "import zones", "import readings")
HEAVY = ("numpy", "rasterio", "pyogrio", "pyproj", "shapely", "matplotlib", "pydantic", "rich", "swathe._core")

# The contract of `plan --json`.
PLAN_FIELDS = {
    "status", "reason", "length_m", "duration_s", "energy_j", "climb_m", "descent_m", "max_grade", "max_side_slope",
    "cost", "cost_lower_bound", "optimal", "cells_total", "cells_evaluated", "nest_count", "method", "profile",
    "vehicle", "seed", "timings_s", "outputs",
}  # fmt: skip

BUNDLED = ("--dem", "bundled:jacksboro", "--soil", "bundled:jacksboro")
OVER_THE_RIDGES = ("--start=-84.1311,36.4621", "--goal=-84.1872,36.5762")


def contents(folder: Path) -> dict[str, bytes]:
    """Return every file of a run; of the summary all but the seconds that it took."""
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    summary = json.loads(files["summary.json"])
    assert summary.pop("timings_s")
    files["summary.json"] = json.dumps(summary).encode()
    return files


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to run commands in."""
    place = tmp_path / "here"
    place.mkdir()
    monkeypatch.chdir(place)
    return place


@pytest.fixture
def dem(tmp_path: Path) -> Path:
    return commands.hills(tmp_path)


@pytest.mark.parametrize("command", ["", *COMMANDS, *IMPORTS])
def test_help_stays_as_it_is_and_gives_an_example(command: str, snapshot: SnapshotAssertion) -> None:
    finished = commands.run(*command.split(), "--help", env={"COLUMNS": "100"})
    assert (finished.code, finished.err) == (0, "")
    assert finished.out == snapshot
    assert re.search(rf"^ +swathe {command}" if command else r"`swathe demo`", finished.out, re.MULTILINE)


def test_every_command_is_listed_here() -> None:
    listed = commands.run("--help").out.partition("Commands:")[2]
    found = re.findall(r"^  (\w+)", listed, re.MULTILINE)
    assert found == list(dict.fromkeys(command.split()[0] for command in COMMANDS))


def test_help_imports_nothing_heavy() -> None:
    code = f"""
import sys
from swathe.cli import main
try:
    main(["--help"])
except SystemExit as end:
    assert end.code == 0
sys.stderr.write(" ".join(name for name in {HEAVY} if name in sys.modules))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], env=commands.environment(), capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    assert done.stdout.startswith("Usage:")


def test_plan_prints_one_json_object_with_every_promised_field(here: Path, dem: Path) -> None:
    finished = commands.run(*way(dem, "--json", "--seed", "7", "--vehicle", "tractor"))
    assert (finished.code, finished.err) == (0, "")
    answer = finished.answer
    assert answer.keys() >= PLAN_FIELDS
    assert answer["status"] == "route_found"
    assert answer["reason"] is None
    straight_m = np.hypot(*(np.array(START.split(","), float) - np.array(GOAL.split(","), float)))
    assert straight_m - 60 <= answer["length_m"] < 2 * straight_m
    assert answer["duration_s"] > 0
    assert answer["energy_j"] > 0
    assert 0 <= answer["max_grade"] <= 0.30
    assert 0 <= answer["max_side_slope"] <= 0.20
    assert answer["cost_lower_bound"] <= answer["grid_cost"]
    assert (answer["cells_total"], answer["method"], answer["profile"]) == (80 * 90, "swarm", "metric")
    assert (answer["vehicle"], answer["seed"]) == ("tractor", 7)
    assert set(answer["outputs"].values()) == {f"swathe-plan/{name}" for name in PLAN_FILES}
    assert {path.name for path in (here / "swathe-plan").iterdir()} == PLAN_FILES
    assert all((here / path).stat().st_size > 0 for path in answer["outputs"].values())
    # The file holds names, so that the folder can be moved.
    assert set(json.loads((here / "swathe-plan/summary.json").read_text())["outputs"].values()) == PLAN_FILES


def test_a_plan_in_words_says_how_far_how_steep_and_where_the_report_is(
    here: Path, dem: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    finished = commands.run_here(capsys, *way(dem))
    assert (finished.code, finished.err) == (0, "")
    assert re.match(r"Route found: [\d.]+ km in .*\n", finished.out)
    for words in ("steepest grade", "side slope", "note: No soil map", f"report: {Path('swathe-plan/report.html')}"):
        assert words in finished.out
    assert (here / "swathe-plan/report.html").is_file()


@pytest.mark.parametrize("method", ["swarm", "exact"])
def test_nests_are_found_and_compared(method: str, here: Path, dem: Path, capsys: pytest.CaptureFixture[str]) -> None:
    finished = commands.run_here(capsys, "nests", "--dem", str(dem), "--method", method, "--compare", "--json")
    answer = finished.answer
    assert (finished.code, answer["status"], answer["method"]) == (0, "done", method)
    assert answer["nest_count"] == len(json.loads((here / "swathe-nests/nests.geojson").read_text())["features"])
    assert 0 < answer["largest_nest_cells"] <= answer["nest_cells"] <= answer["cells_total"]
    assert answer["precision"] == 1
    assert answer["recall_cores"] == 1, "a finished swarm has found every core"
    assert set(answer["comparison"]) == {"swarm", "exact"}
    assert {path.name for path in (here / "swathe-nests").iterdir()} == PLAN_FILES - {"route.geojson", "profile.png"}


def test_nests_compared_in_words_is_a_table(here: Path, dem: Path, capsys: pytest.CaptureFixture[str]) -> None:
    finished = commands.run_here(capsys, "nests", "--dem", str(dem), "--compare")
    assert re.search(r"swarm +exact\n  nests +\d+ +\d+\n", finished.out)
    assert "recall" in finished.out
    assert (here / "swathe-nests/summary.json").is_file()


def test_the_same_seed_gives_the_same_bytes_and_threads_do_not_matter(
    tmp_path: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dem = commands.hills(tmp_path, 240, 240)
    words = way(dem, "--agents", "5000", "--vehicle", "tractor", from_to=("740500,4049500", "746500,4043500"))
    assert commands.run_here(capsys, *words, "--out", "first").code == 0
    for threads in ("1", "3"):
        finished = commands.run(*words, "--threads", threads, "--out", f"with-{threads}")
        assert finished.code == 0, finished.err
        assert contents(here / f"with-{threads}") == contents(here / "first")
    assert commands.run_here(capsys, *words, "--seed", "1", "--out", "other").code == 0
    assert contents(here / "other") != contents(here / "first")


def test_the_report_is_made_again_byte_by_byte(here: Path, dem: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert commands.run_here(capsys, *way(dem)).code == 0
    report = here / "swathe-plan/report.html"
    before = report.read_bytes()
    report.unlink()
    finished = commands.run_here(capsys, "report", "swathe-plan")
    assert (finished.code, finished.out) == (0, "swathe-plan/report.html\n")
    assert report.read_bytes() == before
    again = commands.run_here(capsys, "report", "swathe-plan", "--json")
    assert again.answer == {"status": "done", "outputs": {"report": "swathe-plan/report.html"}}


def test_a_new_run_takes_the_place_of_an_earlier_one(here: Path, dem: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert commands.run_here(capsys, *way(dem, "--out", "run")).code == 0
    assert commands.run_here(capsys, "nests", "--dem", str(dem), "--out", "run").code == 0
    assert json.loads((here / "run/summary.json").read_text())["command"] == "nests"
    assert not (here / "run/route.geojson").exists(), "the earlier run's route is not this run's"


def test_outputs_name_the_version_the_seed_and_the_inputs(
    here: Path, dem: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import hashlib

    import rasterio

    import swathe

    assert commands.run_here(capsys, *way(dem, "--seed", "3")).code == 0
    digest = hashlib.sha256(dem.read_bytes()).hexdigest()
    folder = here / "swathe-plan"
    with rasterio.open(folder / "rank.tif") as ranks:
        tags = ranks.tags()
        assert ranks.colormap(1)[1] != ranks.colormap(1)[10]
    assert tags["swathe_version"] == swathe.__version__
    assert tags["swathe_seed"] == "3"
    assert f"hills.tif {digest}" in tags["swathe_inputs"]
    for name in ("route.geojson", "nests.geojson", "summary.json"):
        told = json.loads((folder / name).read_text())
        origin = told.get("swathe", told)
        assert (origin["version"], origin["seed"]) == (swathe.__version__, 3)
        assert origin["inputs"] == [{"name": "hills.tif", "sha256": digest}]
    for name in ("map.png", "profile.png", "report.html"):
        assert digest.encode() in (folder / name).read_bytes()


def test_no_words_and_version() -> None:
    assert commands.run().out == commands.run("--help").out
    assert re.fullmatch(r"swathe \d+\.\d+\.\d+\n", commands.run("--version").out)


def test_two_vehicles_choose_different_ways(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    routes = {}
    for vehicle in ("tractor", "pickup-4x4"):
        words = ("plan", *BUNDLED, *OVER_THE_RIDGES, "--vehicle", vehicle, "--json", "--out", vehicle)
        answer = commands.run_here(capsys, *words).answer
        assert answer["status"] == "route_found"
        routes[vehicle] = (answer["length_m"], (here / vehicle / "route.geojson").read_bytes())
    assert routes["tractor"][0] > 1.2 * routes["pickup-4x4"][0]
    assert routes["tractor"][1] != routes["pickup-4x4"][1]


@pytest.mark.parametrize("profile", ["paper", "literal"])
def test_the_papers_profiles_tell_sagitta_and_width(
    profile: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("plan", *BUNDLED, *OVER_THE_RIDGES, "--vehicle", "pickup-4x4", "--profile", profile)
    assert commands.run_here(capsys, *words, "--seed", "2").code in {0, 3}
    summary = json.loads((here / "swathe-plan/summary.json").read_text())
    assert summary["profile"] == profile
    assert summary["cell_size_m"] == 8 * 90
    assert (summary["swarm"]["agents"], summary["swarm"]["pellet_max"]) == (10, 3)
    assert summary["corridor"]["arc"] == "circle"
    assert summary["corridor"]["sagitta_m"] == pytest.approx(summary["straight_m"] / 10)
    finished = commands.run_here(capsys, *words, "--seed", "2")
    assert re.search(r"arc with a sagitta of [\d.]+ k?m, swathe [\d.]+ k?m wide", finished.out)
    assert "groups of 8 x 8 pixels" in finished.out


def test_a_grey_picture_is_a_map(tmp_path: Path, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    levels = raster_files.hills(96, 120)
    grey = ((levels - levels.min()) / np.ptp(levels) * 255).astype(np.uint8)
    picture = raster_files.write(tmp_path / "heights.png", grey, crs=None, transform=None, driver="PNG")
    words = way(picture, "--cell-size", "10", "--height-range", "0,60", from_to=("100,100", "1100,860"))
    finished = commands.run_here(capsys, *words, "--json", "--vehicle", "tractor")
    assert (finished.code, finished.answer["crs"]) == (0, "local metric frame")
    route = json.loads((here / "swathe-plan/route.geojson").read_text())
    assert "local metric frame" in route["reference_system"]
    first = route["features"][0]["geometry"]["coordinates"][0]
    assert np.hypot(first[0] - 100, first[1] - 100) < 30, "metres from the south-west corner"
    paper = commands.run_here(capsys, *words, "--profile", "literal", "--json")
    assert paper.answer["rows"] == 12


def test_vehicles_are_listed_and_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from swathe.vehicle import vehicle_names

    listed = commands.run_here(capsys, "vehicles")
    assert all(name in listed.out for name in vehicle_names())
    assert [one["name"] for one in commands.run_here(capsys, "vehicles", "--json").answer["vehicles"]] == list(
        vehicle_names()
    )
    assert "grade_up" in commands.run_here(capsys, "vehicles", "tractor").out
    import swathe

    own = tmp_path / "rover.toml"
    own.write_text((Path(swathe.__file__).parent / "vehicles/jackal.toml").read_text().replace("jackal", "rover"))
    assert commands.run_here(capsys, "vehicles", str(own), "--json").answer["name"] == "rover"
    assert commands.run_here(capsys, "vehicles", "tracktor").code == 4


def test_the_doctor_finds_this_installation_healthy(capsys: pytest.CaptureFixture[str]) -> None:
    assert commands.run_here(capsys, "doctor").code == 0
    answer = commands.run_here(capsys, "doctor", "--json").answer
    assert answer["status"] == "done"
    assert all(check["ok"] for check in answer["checks"])
    extra = next(check for check in answer["checks"] if check["name"] == "psycopg")
    assert extra["found"].startswith(psycopg.__version__)
    assert "PostGIS" in extra["found"]


def test_the_doctor_says_what_a_missing_extra_is_for(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    finished = commands.run_here(capsys, "doctor")
    assert finished.code == 0
    line = next(line for line in finished.out.splitlines() if "psycopg" in line)
    assert "not here" in line
    assert "pip install 'swathe[postgis]'" in line


def test_debug_shows_where_an_error_came_from(capsys: pytest.CaptureFixture[str]) -> None:
    finished = commands.run_here(capsys, *way("no.tif", "--debug"))
    assert finished.code == 4
    assert "Traceback" in finished.err
    assert finished.err.splitlines()[-2].startswith("swathe: no.tif")


def test_our_own_bug_is_called_one(
    here: Path, dem: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise RuntimeError("unforeseen")

    monkeypatch.setattr("swathe.planner.plan", broken)
    finished = commands.run_here(capsys, *way(dem))
    assert finished.code == 1
    assert finished.err.splitlines()[0] == "swathe: Swathe has a bug: RuntimeError: unforeseen"
    assert "--debug" in finished.err
    assert list(here.iterdir()) == []
    assert commands.run_here(capsys, *way(dem, "--json")).answer["kind"] == "bug"


class Terminal:
    """A command whose stderr is a terminal."""

    def __init__(self, *words: str, cwd: Path) -> None:
        ours, theirs = pty.openpty()
        self.process = subprocess.Popen(
            [commands.PROGRAM, *words], cwd=cwd, env=commands.environment({"TERM": "xterm", "COLUMNS": "100"}),
            stdout=subprocess.PIPE, stderr=theirs, text=True, preexec_fn=commands.hear_interrupts,
        )  # fmt: skip
        os.close(theirs)
        self.screen = ""
        self._terminal = ours

    def read_until(self, words: str | None) -> None:
        """Read the screen until ``words`` are on it, or until it closes."""
        while words is None or words not in self.screen:
            try:
                piece = os.read(self._terminal, 4096)
            except OSError:  # a terminal without its program
                break
            if not piece:
                break
            self.screen += piece.decode()

    def finish(self) -> commands.Finished:
        self.read_until(None)
        out, _ = self.process.communicate()
        os.close(self._terminal)
        return commands.Finished(self.process.returncode, out, self.screen)


def test_progress_is_shown_on_stderr_only_and_quiet_means_quiet(here: Path, dem: Path) -> None:
    finished = Terminal(*way(dem), cwd=here).finish()
    assert finished.code == 0
    assert finished.out.startswith("Route found")
    assert "Writing maps" in finished.err
    for flag in ("--quiet", "--json"):
        assert Terminal(*way(dem, flag), cwd=here).finish().err == ""


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map over which a plan takes seconds."""
    return commands.hills(tmp_path_factory.mktemp("large"), 2500, 2500)


CORNERS = ("740500,4049500", "814000,3976000")


def staged(out: Path) -> list[Path]:
    return list(out.glob(".swathe-part-*"))


def wait_for(process: subprocess.Popen[str], out: Path, name: str = "") -> None:
    """Wait until a run has begun its folder, or has written a file of that name into it."""
    while process.poll() is None:
        if any((folder / name).exists() for folder in staged(out)):
            return
        time.sleep(0.005)
    pytest.fail("the command ended too early")


@pytest.mark.parametrize(
    ("stage", "by"),
    [
        ("Laying the arc", signal.SIGINT),
        ("Termites at work", signal.SIGINT),
        ("Searching the route", signal.SIGTERM),
        ("Writing maps", signal.SIGINT),
    ],
)
def test_an_interrupted_plan_leaves_nothing(stage: str, by: signal.Signals, large: Path, here: Path) -> None:
    running = Terminal(*way(large, "--vehicle", "tractor", "--arc", "spine", from_to=CORNERS), cwd=here)
    running.read_until(stage)
    running.process.send_signal(by)
    finished = running.finish()
    assert finished.code == 130
    assert finished.out == ""
    assert "swathe: Interrupted." in finished.err
    assert "Traceback" not in finished.err
    assert list(here.iterdir()) == []


def test_an_interrupted_plan_leaves_the_earlier_run_as_it_was(large: Path, here: Path, dem: Path) -> None:
    assert commands.run(*way(dem, "--out", "run")).code == 0
    before = {path.name: path.read_bytes() for path in (here / "run").iterdir()}
    running = commands.start(*way(large, "--json", "--out", "run", from_to=CORNERS))
    wait_for(running, here / "run")
    running.send_signal(signal.SIGINT)
    out, err = running.communicate()
    assert (running.returncode, err) == (130, "")
    assert json.loads(out)["kind"] == "interrupted"
    assert {path.name: path.read_bytes() for path in (here / "run").iterdir()} == before


def test_after_a_kill_the_same_folder_works_again(large: Path, here: Path, dem: Path) -> None:
    running = commands.start(*way(large, "--out", "run", from_to=CORNERS))
    wait_for(running, here / "run")
    running.kill()
    running.communicate()
    assert not (here / "run/summary.json").exists()
    assert staged(here / "run"), "a kill leaves what was there"
    assert commands.run(*way(dem, "--out", "run")).code == 0
    assert {path.name for path in (here / "run").iterdir()} == PLAN_FILES


def test_an_interruption_between_two_files_leaves_the_earlier_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "run"
    summary = json.dumps({"command": "plan", "version": "0", "inputs": []})
    for run in ("earlier", "later"):
        with contextlib.suppress(KeyboardInterrupt), run_folder(out) as folder:
            for name in PLAN_FILES if run == "earlier" else PLAN_FILES - {"profile.png"}:
                (folder / name).write_text(summary if name == "summary.json" else run)
            if run == "later":
                replace, calls = Path.replace, iter(range(100))

                def interrupted(self: Path, target: Path) -> Path:
                    if next(calls) == 10:  # noqa: B023 - called before the loop goes on
                        raise KeyboardInterrupt
                    return replace(self, target)  # noqa: B023

                monkeypatch.setattr(Path, "replace", interrupted)
    assert {path.name: path.read_text() for path in out.iterdir()} == {
        name: summary if name == "summary.json" else "earlier" for name in PLAN_FILES
    }


def test_what_a_killed_run_left_goes_and_what_a_living_run_makes_stays(tmp_path: Path) -> None:
    out = tmp_path / "run"
    dead, alive = out / ".swathe-part-999999999-00", out / f".swathe-part-{os.getpid()}-00"
    for folder in (dead, alive):
        folder.mkdir(parents=True)
    with run_folder(out) as folder:
        (folder / "summary.json").write_text("{}")
    assert {path.name for path in out.iterdir()} == {"summary.json", alive.name}


def test_a_reader_that_leaves_early_does_no_harm() -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    done = subprocess.run(
        [commands.PROGRAM, "vehicles"], stdout=theirs, stderr=subprocess.PIPE, env=commands.environment(), check=False
    )
    os.close(theirs)
    assert (done.returncode, done.stderr) == (0, b"")


def test_an_answer_that_cannot_be_printed_is_no_success() -> None:
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [commands.PROGRAM, "vehicles"], stdout=full, stderr=subprocess.PIPE, env=commands.environment(), check=False
        )
    assert done.returncode == 4
    assert done.stderr.startswith(b"swathe: The answer cannot be printed: No space left")
    assert done.stderr.count(b"\n") == 1


@pytest.fixture
def mounted(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Path]:
    """A file system of its own, of the size that the test asks for."""
    place = tmp_path / "small"
    place.mkdir()
    mount, umount = shutil.which("mount"), shutil.which("umount")
    if mount is None or umount is None:
        pytest.skip("This test needs the programs mount and umount.")
    size = getattr(request, "param", "1m")
    done = subprocess.run(
        [mount, "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        pytest.skip(f"This test needs root to mount a small file system: {done.stderr.strip()}")
    yield place
    subprocess.run([umount, str(place)], check=True)


@pytest.mark.parametrize("mounted", ["4k", "20k", "100k", "400k"], indirect=True)
def test_a_full_disk_is_refused_and_nothing_stays(mounted: Path, dem: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = mounted / "run"
    finished = commands.run_here(capsys, *way(dem, "--out", str(out)))
    assert finished.code == 4
    assert "No space left" in finished.err
    assert f"{out}/" in finished.err or f"{out} " in finished.err
    assert ".swathe-part" not in finished.err
    assert len(finished.err.splitlines()) == 2
    assert list(mounted.iterdir()) == []


def test_a_disk_that_may_not_be_written_is_refused(
    mounted: Path, dem: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    subprocess.run([str(shutil.which("mount")), "-o", "remount,ro", str(mounted)], check=True)
    finished = commands.run_here(capsys, *way(dem, "--out", str(mounted / "run")), "--json")
    assert finished.code == 4
    assert finished.answer["kind"] == "output"
    assert "Read-only file system" in finished.answer["message"]


def test_a_plan_saves_what_the_objective_says_and_follows_a_cost_raster(here: Path, dem: Path) -> None:
    quick = commands.run(*way(dem, "--json", "--vehicle", "tractor")).answer
    energy = commands.run(*way(dem, "--json", "--vehicle", "tractor", "--objective", "energy")).answer
    assert "\n  objective risk: cost " in commands.run(*way(dem, "--objective", "risk")).out
    assert (quick["objective"], energy["objective"]) == ("time", "energy")
    assert quick["cost"] == pytest.approx(quick["duration_s"], rel=1e-9)
    power_w = energy["vehicle_figures"]["power_w"]["value"]
    assert energy["cost"] == pytest.approx(energy["energy_j"] / power_w, rel=1e-9)
    assert energy["energy_j"] <= quick["energy_j"]
    assert energy["cost_lower_bound"] <= energy["cost"]
    assert "Objective" in (here / "swathe-plan/report.html").read_text()
    cost = np.full((80, 90), 3.0, dtype=np.float32)
    cost[0, :5] = np.nan
    raster = raster_files.write(here / "cost.tif", cost)
    dear = commands.run(*way(dem, "--json", "--vehicle", "tractor", "--cost-raster", str(raster))).answer
    assert dear["cost"] == pytest.approx(3 * quick["cost"], rel=1e-6)
    assert [given["name"] for given in dear["inputs"]] == [*(given["name"] for given in quick["inputs"]), "cost.tif"]
    assert any("multiplied by 3 to 3" in note and "0.1 %" in note for note in dear["notes"])
    legs = json.loads((here / "swathe-plan/route.geojson").read_text())["features"]
    assert sum(leg["properties"]["risk_s"] for leg in legs) == pytest.approx(dear["risk_s"], abs=0.01 * len(legs))


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--objective", "fast"), "'fast'"),
        (("--objective", "time=0"), "time or energy"),
        (("--objective", "time=nan"), "NaN"),
        (("--cost-raster", "nowhere.tif"), "nowhere.tif"),
        (("--cost-raster", "away.tif"), "outside the map"),
        (("--cost-raster", "negative.tif"), "negative"),
        (("--cost-raster", "closed.tif"), "every cell"),
        (("--cost-raster", "local.tif"), "no coordinate reference system"),
    ],
)
def test_an_objective_or_cost_raster_that_is_none_is_refused(
    here: Path, dem: Path, options: tuple[str, str], text: str
) -> None:
    ones = np.ones((80, 90), dtype=np.float32)
    raster_files.write(here / "away.tif", ones, transform=raster_files.PLACE @ raster_files.PLACE.translation(9000, 0))
    raster_files.write(here / "negative.tif", -ones)
    raster_files.write(here / "closed.tif", np.nan * ones)
    raster_files.write(here / "local.tif", ones, crs=None)
    finished = commands.run(*way(dem, *options))
    assert finished.code in {2, 4}
    assert text in finished.err
    assert "Traceback" not in finished.err
    assert not (here / "swathe-plan").exists()
