"""Drives from the command line: what is answered, what stays when something goes wrong, and that logs are verified."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import commands
from swathe import driving, proving, trials
from swathe.errors import InputError, InvalidScenarioError, OutputError
from swathe.export.folder import RUN_LOG
from swathe.preparation import Stopwatch
from swathe.runlog import RunLog, verify
from swathe.scenario import load_scenario, scenario_names, scenario_of
from swathe.staging import stage

if TYPE_CHECKING:
    from swathe.recording import Live

# The contract of `drive --json`.
FIELDS = {
    "status", "reason", "distance_m", "duration_s", "min_clearance_m", "collisions", "replans", "probes",
    "soil_updates", "no_go_entries", "real_time_factor", "seed", "body", "outputs",
}  # fmt: skip
PICTURES = {"drive-map.png", "drive-frames.png", "drive-profile.png"}
QUICK = ("--no-animate", "--json")


def drive(*words: str, out: Path) -> tuple[int, dict[str, Any]]:
    finished = commands.run("drive", *words, *QUICK, "--out", str(out))
    return finished.code, json.loads(finished.out)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a drive without a map."""
    out = tmp_path_factory.mktemp("drive") / "crates"
    code, summary = drive("--scenario", "crates", out=out)
    assert (code, summary["status"]) == (0, "reached")
    return out


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The folder and the answer of the paper's run."""
    out = tmp_path_factory.mktemp("drive") / "paper"
    code, summary = drive("--scenario", "paper", out=out)
    assert code == 0
    return out, summary


def test_a_drive_answers_with_the_contract_and_leaves_a_whole_folder(driven: Path) -> None:
    summary = json.loads((driven / "summary.json").read_text())
    assert summary.keys() >= FIELDS
    names = {path.name for path in driven.iterdir()}
    assert names == {"summary.json", "report.html", RUN_LOG, *PICTURES}
    assert set(summary["outputs"].values()) == names
    assert summary["collisions"] == 0
    assert summary["distance_m"] == pytest.approx(30, abs=6)
    assert summary["real_time_factor"] > 1
    log = RunLog.read(driven / RUN_LOG)
    assert log.is_complete
    assert log.outcome is not None
    assert log.outcome["distance_m"] == summary["distance_m"]
    assert log.seconds == pytest.approx(summary["duration_s"], abs=1.1)


def test_the_papers_run_goes_around_the_bog_that_it_was_told_of(paper: tuple[Path, dict[str, Any]]) -> None:
    folder, summary = paper
    assert summary["status"] == "reached"
    assert (summary["profile"], summary["vehicle"], summary["local_method"]) == ("paper", "pioneer-2dx", "vfh")
    assert summary["soil_updates"] == 1
    assert summary["probes"] >= 3
    assert summary["collisions"] == summary["no_go_entries"] == 0
    assert summary["distance_m"] > summary["plan"]["length_m"]
    assert {"route.geojson", "nests.geojson", "rank.tif", "map.png", "profile.png"} <= {
        p.name for p in folder.iterdir()
    }
    log = RunLog.read(folder / RUN_LOG)
    kinds = {event.kind for event in log.events}
    assert {"soil_news", "soil_update", "nests_changed", "route_repaired", "probe_wanted", "reading_taken"} <= kinds
    # Both grids were asked at every step, and each answer was logged.
    assert log.grids.answers.shape == (len(log.commands.times_s), 2)
    news = next(event.fields for event in log.events if event.kind == "soil_news")
    near = ((log.truth.x_m - news["x_m"]) ** 2 + (log.truth.y_m - news["y_m"]) ** 2) ** 0.5
    assert near.min() > news["radius_m"] - 1


def test_a_finished_drive_is_verified_byte_for_byte(driven: Path) -> None:
    told = commands.run("replay", str(driven), "--verify", "--json")
    answer = json.loads(told.out)
    assert (told.code, answer["status"]) == (0, "equal")
    assert answer["verdict"]["compared_bytes"] == (driven / RUN_LOG).stat().st_size
    assert commands.run("replay", str(driven / RUN_LOG)).out.startswith(str(driven / RUN_LOG))


@pytest.mark.parametrize("sensor", ["sonar", "both"])
def test_a_drive_with_a_sonar_ring_is_logged_drawn_and_verified(sensor: str, tmp_path: Path) -> None:
    out = tmp_path / sensor
    code, summary = drive("--scenario", "crates", "--vehicle", "pioneer-2dx", "--sensor", sensor, out=out)
    assert (code, summary["status"], summary["collisions"]) == (0, "reached", 0)
    log = RunLog.read(out / RUN_LOG)
    assert len(log.sonar.times_s) > 25 * 8 * (log.seconds - 2)
    assert len(log.sonar.mounts) == 8
    assert bool(len(log.scans.times_s)) == (sensor == "both")
    assert {path.name for path in out.iterdir()} == {"summary.json", "report.html", RUN_LOG, *PICTURES}
    told = commands.run("replay", str(out), "--verify", "--json")
    assert (told.code, json.loads(told.out)["status"]) == (0, "equal")


def test_news_and_probes_are_verified_too(paper: tuple[Path, dict[str, Any]]) -> None:
    assert driving.replay(paper[0], again=True)["status"] == "equal"


def test_a_forged_log_is_found_out(driven: Path, tmp_path: Path) -> None:
    content = bytearray((driven / RUN_LOG).read_bytes())
    content[len(content) // 2] ^= 1
    forged = tmp_path / RUN_LOG
    forged.write_bytes(content)
    answer = driving.replay(forged, again=True)
    assert not answer["complete"] or answer["status"] == "different"


def test_the_log_of_another_seed_is_told_apart(driven: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    assert drive("--scenario", "crates", "--seed", "3", out=other)[0] == 0
    verdict = verify(driven / RUN_LOG, other / RUN_LOG)
    assert not verdict
    assert "seed" in verdict.words


def test_a_killed_drive_leaves_a_log_that_is_verified_up_to_its_cut(tmp_path: Path) -> None:
    out = tmp_path / "killed"
    process = subprocess.Popen(
        [commands.PROGRAM, "drive", "--scenario", "heath", "--out", str(out)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    log = out / RUN_LOG
    waited_until = time.monotonic() + 300
    while not (log.exists() and log.stat().st_size > 300_000) and time.monotonic() < waited_until:
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (out / "summary.json").exists()
    told = commands.run("replay", str(out), "--verify", "--json")
    answer = json.loads(told.out)
    assert (told.code, answer["status"]) == (0, "equal")
    assert not answer["complete"]
    assert answer["verdict"]["is_cut"]
    assert answer["verdict"]["compared_bytes"] > 200_000
    # The folder can be driven into again.
    code, summary = drive("--scenario", "crates", out=out)
    assert (code, summary["status"]) == (0, "reached")
    assert {path.name for path in out.iterdir()} == {"summary.json", "report.html", RUN_LOG, *PICTURES}


def test_ctrl_c_keeps_the_log_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "stopped"
    process = subprocess.Popen(
        [commands.PROGRAM, "drive", "--scenario", "heath", "--out", str(out)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    log = out / RUN_LOG
    waited_until = time.monotonic() + 300
    while not (log.exists() and log.stat().st_size > 100_000) and time.monotonic() < waited_until:
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert b"Interrupted" in err
    assert [path.name for path in out.iterdir()] == [RUN_LOG]
    assert RunLog.read(log).cut is not None


def test_a_full_disk_ends_the_drive_with_a_plain_error_and_a_readable_log(tmp_path: Path) -> None:
    out = tmp_path / "full"
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000)); "
    run = "import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); from swathe.cli import main; "
    call = f"main(['drive', '--scenario', 'heath', '--no-animate', '--out', {str(out)!r}])"
    finished = subprocess.run([sys.executable, "-c", limit + run + call], capture_output=True, text=True, check=False)
    assert finished.returncode == 4, finished.stderr
    assert RUN_LOG in finished.stderr
    assert "Traceback" not in finished.stderr
    log = RunLog.read(out / RUN_LOG)
    assert log.cut is not None
    assert log.seconds >= 1


def test_no_route_is_an_answer_with_its_reason_and_no_log(tmp_path: Path) -> None:
    out = tmp_path / "walled"
    # The other bank of the gully, with no way around inside the bounds.
    words = ("--scenario", "heath", "--goal", "230,300", "--start", "60,300", "--bounds", "0,240,320,320")
    code, summary = drive(*words, out=out)
    assert (code, summary["status"]) == (3, "not_reached")
    assert "steep" in summary["reason"]
    assert summary["plan"]["status"] == "no_route"
    assert RUN_LOG not in {path.name for path in out.iterdir()}
    assert (out / "map.png").exists()


def test_start_at_the_goal_is_reached_without_a_drive(tmp_path: Path) -> None:
    code, summary = drive("--scenario", "heath", "--goal", "40,150", "--start", "40,150", out=tmp_path / "here")
    assert (code, summary["status"], summary["distance_m"]) == (0, "reached", 0.0)


def test_a_goal_inside_a_crate_is_not_reached_and_not_run_into(tmp_path: Path) -> None:
    scenario = tmp_path / "blocked.toml"
    scenario.write_text(
        '[terrain]\ndem = ["bundled:heath"]\npoints_crs = "native"\n[drive]\nstart = [40, 60]\ngoal = [60, 60]\n'
        "[obstacles]\nboxes = [{ x_m = 60, y_m = 60, length_m = 3, width_m = 3 }]\n"
    )
    code, summary = drive("--scenario", str(scenario), out=tmp_path / "out")
    # Every way to it is tried first, which may take more than the time that the drive has.
    assert (code, summary["status"] in {"not_reached", "timeout"}) == (3, True)
    assert summary["collisions"] == 0


def test_news_from_a_file_turn_the_drive_aside_and_are_verified_without_the_file(tmp_path: Path) -> None:
    feed = tmp_path / "news.jsonl"
    lines = [
        {"time_s": 2.0, "x_m": 110.0, "y_m": 70.0, "radius_m": 12.0, "class": "none", "source": "scout"},
        {"time_s": 3.0, "x_m": 1e6, "y_m": 0.0, "radius_m": 1.0, "class": "sand"},
    ]
    feed.write_text("this is no news\n" + "".join(json.dumps(line) + "\n" for line in lines))
    scenario = tmp_path / "fed.toml"
    scenario.write_text(
        'vehicle = "husky"\n[terrain]\ndem = ["bundled:heath"]\nsoil = "bundled:heath"\npoints_crs = "native"\n'
        "[drive]\nstart = [90, 70]\ngoal = [135, 70]\n"
    )
    out = tmp_path / "out"
    code, summary = drive("--scenario", str(scenario), "--soil-feed", str(feed), out=out)
    assert (code, summary["status"], summary["soil_updates"]) == (0, "reached", 1)
    log = RunLog.read(out / RUN_LOG)
    assert ((log.truth.x_m - 110) ** 2 + (log.truth.y_m - 70) ** 2).min() > 11**2
    refused = [event.fields for event in log.events if event.kind == "soil_news_refused"]
    assert refused[0]["line"] == 1
    assert len(refused) == 2
    feed.unlink()
    # Each of the two drives hears the news: the one that is written, and the one that is compared.
    assert driving.replay(out, again=True, out=tmp_path / "again")["status"] == "equal"
    assert (tmp_path / "again" / RUN_LOG).read_bytes() == (out / RUN_LOG).read_bytes()
    missing = commands.run("drive", "--scenario", str(scenario), "--soil-feed", str(feed), "--out", str(tmp_path / "x"))
    assert missing.code == 4
    assert "does not exist" in missing.err


def test_the_last_line_of_a_feed_counts_without_its_end_and_is_told_when_it_never_is_whole(tmp_path: Path) -> None:
    feed, out = tmp_path / "news.jsonl", tmp_path / "out"
    feed.write_text('{"time_s": 2, "x_m": 60, "y_m": 80, "radius_m": 3, "class": "none"}')
    scenario = scenario_of(
        {
            "vehicle": "husky",
            "terrain": {
                "dem": ["bundled:heath"], "soil": "bundled:heath", "points_crs": "native", "bounds": [30, 30, 90, 90]
            },
            "drive": {"start": (40, 60), "goal": (70, 60)},
        },
        "it",
    )  # fmt: skip

    def scout_breaks_off(live: Live) -> None:
        if live.time_s == 5.0:
            with feed.open("a") as file:
                file.write('\n{"time_s": 6, "x_m": 60, "y_')

    summary = driving.drive(scenario, out, soil_feed=feed, animate=False, on_second=scout_breaks_off)
    assert (summary["status"], summary["soil_updates"]) == ("reached", 1)
    log = RunLog.read(out / RUN_LOG)
    assert [event.time_s for event in log.events if event.kind == "soil_news"] == [2.0]
    (refused,) = (event for event in log.events if event.kind == "soil_news_refused")
    assert refused.time_s == pytest.approx(summary["duration_s"])
    assert refused.fields["line"] == 2
    feed.unlink()
    assert driving.replay(out, again=True)["status"] == "equal"


def test_hand_readings_and_a_table_of_soil_types_are_known_before_the_drive(tmp_path: Path) -> None:
    readings, table, scenario = (tmp_path / name for name in ("readings.csv", "types.toml", "drive.toml"))
    readings.write_text("x,y,class\n110,70,none\n")
    table.write_text((resources.files("swathe") / "soil_types.toml").read_text("utf-8"))
    scenario.write_text(
        'vehicle = "husky"\n[terrain]\ndem = ["bundled:heath"]\nsoil = "bundled:heath"\npoints_crs = "native"\n'
        '[drive]\nstart = [90, 70]\ngoal = [135, 70]\nsoil_types = "types.toml"\n'
    )
    out = tmp_path / "out"
    code, summary = drive("--scenario", str(scenario), "--readings", str(readings), out=out)
    assert (code, summary["status"]) == (0, "reached")
    log = RunLog.read(out / RUN_LOG)
    assert ((log.truth.x_m - 110) ** 2 + (log.truth.y_m - 70) ** 2).min() > 9**2
    assert {"readings.csv", "types.toml"} <= log.header.inputs.keys()
    assert driving.replay(out, again=True)["status"] == "equal"
    # Another table is another input, and one that lacks a class is refused before anything is driven.
    table.write_text(table.read_text() + "# changed\n")
    with pytest.raises(InputError, match=r"types\.toml"):
        driving.replay(out, again=True)
    table.write_text("[gravel]\n")
    refused = commands.run("drive", "--scenario", str(scenario), "--out", str(tmp_path / "x"))
    assert refused.code == 2
    assert "types.toml" in refused.err
    missing = commands.run("drive", "--scenario", "heath", "--readings", "none.csv", "--out", str(tmp_path / "x"))
    assert missing.code == 4
    assert "none.csv" in missing.err
    no_map = commands.run("drive", "--scenario", "crates", "--readings", str(readings), "--out", str(tmp_path / "x"))
    assert no_map.code == 4
    assert "no map of the soil" in no_map.err


def test_a_plan_is_driven_from_its_folder(tmp_path: Path) -> None:
    dem = commands.hills(tmp_path)
    planned = tmp_path / "plan"
    ends = ("--points-crs", "native", "--start", commands.START, "--goal", "740650,4049450")
    assert commands.run("plan", "--dem", str(dem), *ends, "--vehicle", "husky", "--out", str(planned)).code == 0
    out = tmp_path / "drive"
    code, summary = drive("--plan", str(planned), "--crates", "5", out=out)
    assert (code, summary["status"], summary["vehicle"]) == (0, "reached", "husky")
    assert (out / "route.geojson").read_bytes() == (planned / "route.geojson").read_bytes()
    # The map is another one now.
    commands.hills(tmp_path, rows=81)
    told = commands.run("replay", str(out), "--verify")
    assert told.code == 4
    assert dem.name in told.err
    dem.unlink()
    assert commands.run("replay", str(out), "--verify").code == 4


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ((), 2, "--scenario NAME"),
        (("--scenario", "crates", "--plan", "x"), 2, "one of"),
        (("--scenario", "nowhere"), 4, "no scenario named"),
        (("--scenario", "crates", "--crates", "-1"), 4, "obstacles.crates"),
        (("--scenario", "crates", "--soil-error", "2"), 4, "soil_error"),
        (("--plan", "nowhere"), 4, "summary.json"),
        (("--dem", "bundled:heath"), 2, "--start"),
        (("--dem", "bundled:heath", "--start", "1,2", "--goal", "x"), 2, "--goal"),
        (("--scenario", "crates", "--vehicle", "boat"), 4, "boat"),
    ],
)
def test_wrong_words_are_answered_plainly(words: tuple[str, ...], code: int, said: str, tmp_path: Path) -> None:
    finished = commands.run("drive", *words, "--out", str(tmp_path / "out"))
    assert (finished.code, said in finished.err) == (code, True), finished.err
    assert "Traceback" not in finished.err
    assert not (tmp_path / "out").exists()


def test_the_bundled_scenarios_are_listed() -> None:
    listed = commands.run("drive", "--list").out
    assert "paper" in listed
    assert "wrong-soil" in listed


# The paper's run hears news, and is driven above with them; the wrong soil map does not always leave a way.
@pytest.mark.parametrize("name", sorted(set(scenario_names()) - {"paper", "wrong-soil"}))
def test_every_other_bundled_scenario_is_driven_to_its_goal(name: str) -> None:
    scenario = load_scenario(name)
    episode, _ = stage(scenario, watch=Stopwatch()).episode(records=False)
    outcome = episode.run()
    assert (outcome.status, outcome.collisions) == ("reached", 0), outcome
    assert bool(outcome.probes) == (scenario.probing.policy != "never")


def test_a_vehicle_of_ones_own_is_kept_in_the_log(tmp_path: Path) -> None:
    own = tmp_path / "rover.toml"
    text = (Path(driving.__file__).parent / "vehicles" / "jackal.toml").read_text()
    own.write_text(text.replace('name = "jackal"', 'name = "rover"'))
    out = tmp_path / "out"
    code, summary = drive("--scenario", "crates", "--vehicle", str(own), out=out)
    assert (code, summary["vehicle"]) == (0, "rover")
    own.unlink()
    assert driving.replay(out, again=True)["status"] == "equal"


def test_a_drive_is_written_again_from_its_log(driven: Path, tmp_path: Path) -> None:
    answer = driving.replay(driven, out=tmp_path / "again")
    assert (tmp_path / "again" / RUN_LOG).read_bytes() == (driven / RUN_LOG).read_bytes()
    assert set(answer["again"]) >= {"summary", "run", "drive-map"}


def test_a_log_is_never_replayed_into_the_folder_that_holds_it(driven: Path, tmp_path: Path) -> None:
    folder, linked = tmp_path / "folder", tmp_path / "linked"
    shutil.copytree(driven, folder)
    linked.mkdir()
    (linked / RUN_LOG).symlink_to(folder / RUN_LOG)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    roundabout = linked / ".." / "folder"
    for run, out in ((folder, folder), (folder / RUN_LOG, roundabout), (linked, folder), (folder, linked)):
        told = commands.run("replay", str(run), "--verify", "--out", str(out))
        assert (told.code, str(out) in told.err, "Choose another folder" in told.err) == (4, True, True), told.err
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    # The worst runs of trials lie under other names in their folder.
    (folder / RUN_LOG).rename(folder / "worst-1.mcap")
    with pytest.raises(OutputError, match="holds the log that is replayed"):
        driving.replay(folder / "worst-1.mcap", out=folder)
    assert (folder / "worst-1.mcap").read_bytes() == before[RUN_LOG]


def test_trials_of_drawn_worlds_and_of_a_scenario_tell_a_table(tmp_path: Path) -> None:
    summary = proving.run_trials(
        tmp_path / "drawn", runs=3, methods=("navigator", "vfh+"), vehicles=("jackal",), workers=1
    )
    assert [arm["arm"] for arm in summary["arms"]] == ["navigator", "vfh+"]
    assert (tmp_path / "drawn" / "trials.csv").read_text().count("\n") == 7
    assert "navigator" in summary["table"]
    # The worst are kept, each the drive that its row tells of.
    assert len(summary["worst"]) >= 3
    for number, row in enumerate(summary["worst"][:3], 1):
        log = tmp_path / "drawn" / f"worst-{number}.mcap"
        outcome = RunLog.read(log).outcome
        assert outcome is not None
        assert {name: outcome[name] for name in ("status", "distance_m", "duration_s", "replans")} == {
            name: row[name] for name in ("status", "distance_m", "duration_s", "replans")
        }
    assert driving.replay(log, again=True)["status"] == "equal"
    base = tmp_path / "short.toml"
    base.write_text(
        '[terrain]\ndem = ["bundled:heath"]\nsoil = "bundled:heath"\npoints_crs = "native"\nbounds = [30, 30, 90, 90]\n'
        "[drive]\nstart = [40, 60]\ngoal = [70, 60]\n[truth]\nsoil_error = 0.3\n[obstacles]\ncrates = 4\n"
    )
    told = proving.run_trials(
        tmp_path / "mapped", runs=2, scenario=str(base), grids=("single", "or"), vehicles=("husky",), workers=1
    )
    assert [arm["arm"] for arm in told["arms"]] == ["husky, grids single", "husky, grids or"]
    assert told["pairs"][0]["seeds"] == 2
    assert all(arm["reached"] == 2 for arm in told["arms"])
    assert {path.name for path in (tmp_path / "mapped").iterdir()} == {
        "summary.json", "trials.csv", "trials.png", "worst-1.mcap", "worst-2.mcap", "worst-3.mcap"
    }  # fmt: skip


@pytest.mark.parametrize("noisy", [False, True])
@pytest.mark.parametrize("vehicle", ["jackal", "warthog"])
def test_a_trial_is_a_scenario(vehicle: str, *, noisy: bool) -> None:
    trial = trials.Trial(seed=5, kind="corridor", density=4.0, vehicle=vehicle, noisy=noisy)
    there, _ = trials.begin(trial, records=False)
    here, _ = stage(proving.scenario_of_trial(trial), watch=Stopwatch()).episode(records=False)
    ends = [asdict(outcome) | {"longest_step_s": 0.0} for outcome in (there.run(), here.run())]
    assert ends[0] == ends[1]


def test_trials_refuse_what_does_not_fit(tmp_path: Path) -> None:
    for words, said in (
        (("--runs", "0"), "0 runs"),
        (("--keep", "99"), "99 runs"),
        (("--local", "dwa"), "dwa"),
        (("--grids", "or"), "no map"),
    ):
        finished = commands.run("trials", *words, "--out", str(tmp_path / "out"))
        assert (finished.code, said in finished.err) == (2, True), finished.err


def test_more_crates_is_another_scenario_and_the_same_route() -> None:
    paper = load_scenario("paper")
    more = paper.with_changes({"obstacles.crates": 50})
    assert more.obstacles.crates == 50
    assert more.drive == paper.drive
    with pytest.raises(InvalidScenarioError):
        paper.with_changes({"obstacles": {"crates": "many"}})


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "precious.txt").write_text("mine")
    finished = commands.run("drive", "--scenario", "crates", "--out", str(tmp_path))
    assert finished.code == 4
    assert [path.name for path in tmp_path.iterdir()] == ["precious.txt"]
