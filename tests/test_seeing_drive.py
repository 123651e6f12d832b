"""The pictures of a drive: they show what was driven, with and without terrain, and are the same every time."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import shapely
from PIL import Image

from drives import HEADER, OUTCOME, made_log, made_second
from pictures import hills, pixels, pixels_near
from swathe import sim
from swathe.drive import Navigator
from swathe.episode import CertaintyMap, Episode, Event, Fault, Histogram, Line, Outcome
from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.export.folder import DRIVE_PICTURES, OUR_FILES
from swathe.grid import GridGeometry
from swathe.report import drive_pictures
from swathe.report.drive import Drive, Ground, last_before
from swathe.report.drive_film import write_drive_gif
from swathe.report.drive_frames import draw_frames
from swathe.report.drive_map import draw_drive_map
from swathe.report.html import write_html
from swathe.report.palette import NO_GO_RANK, rank_hex
from swathe.runlog import LogHeader, RunLog, RunLogWriter, verify
from swathe.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

JACKAL = load_vehicle("jackal")
BLUE, DRIVEN, SEEN, STANDING = (36, 56, 194), (17, 19, 23), (207, 74, 18), (143, 139, 134)


@cache
def driven(folder: Path, seed: int = 5, kind: sim.Kind = "u-trap", density: float = 4.0) -> tuple[Drive, Path]:
    """Drive through a drawn world, and read the log back."""
    world, start, goal = sim.random_world(seed, kind=kind, density=density)
    robot = sim.Robot(world, JACKAL, start, seed=seed)
    episode = Episode(world, robot, Navigator(JACKAL, (goal.x_m, goal.y_m)))
    path = folder / f"{kind}-{seed}.mcap"
    with RunLogWriter(path, LogHeader(seed=seed, scenario=f'kind = "{kind}"\n', vehicle="jackal")) as log:
        for second in episode.seconds():
            log.write(second)
        assert episode.outcome is not None
        log.close(episode.outcome)
    found = Drive(
        RunLog.read(path),
        JACKAL.length_m,
        JACKAL.width_m,
        "Goal reached",
        "jackal",
        goal_m=(goal.x_m, goal.y_m),
        obstacles=world.obstacles,
        step_height_m=JACKAL.step_height_m,
    )
    return found, path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("drives")


@pytest.fixture(scope="module")
def drive(folder: Path) -> Drive:
    return driven(folder)[0]


def made_up(tmp_path: Path, **changes: Any) -> Drive:
    made_log(tmp_path / "made.mcap", 3, **changes)
    return Drive(RunLog.read(tmp_path / "made.mcap"), 0.5, 0.4, "Made <up>")


def ground() -> Ground:
    geometry = GridGeometry(60, 60, 1.0, -30.0, 30.0)
    rank = np.full((60, 60), 8, np.uint8)
    rank[:10] = NO_GO_RANK
    return Ground(geometry, hills(60, 60), rank)


def test_the_same_drive_again_is_the_same_log_and_another_is_not(folder: Path, tmp_path: Path) -> None:
    _, path = driven(folder)
    _, again = driven(tmp_path)
    assert verify(path, again)
    _, other = driven(tmp_path, 6)
    assert verify(path, other).difference is not None
    (tmp_path / "killed").write_bytes(path.read_bytes()[:500_000])
    verdict = verify(tmp_path / "killed", again)
    assert verdict
    assert verdict.is_cut
    assert RunLog.read(tmp_path / "killed").seconds > 2


def test_the_log_of_a_drive_agrees_with_how_it_ended(drive: Drive) -> None:
    outcome = drive.log.outcome
    assert outcome is not None
    assert outcome["status"] == "reached"
    assert "longest_step_s" in Outcome.__slots__
    assert "longest_step_s" not in outcome
    way_m = np.hypot(*np.diff(drive.driven_m, axis=0).T).sum()
    assert way_m == pytest.approx(outcome["distance_m"], abs=0.1)
    _, clearance = drive.clearance_true_m
    assert clearance.min() == pytest.approx(outcome["min_clearance_m"], abs=0.01)


@pytest.mark.parametrize(("of_step_height", "is_in_the_way"), [(0.9, False), (1.1, True)])
def test_what_the_vehicle_climbs_is_not_near_it(drive: Drive, of_step_height: float, is_in_the_way: bool) -> None:
    x_m, y_m = drive.driven_m[len(drive.driven_m) // 2]
    board = sim.Box(x_m, y_m, 0.3, 0.3, height_m=of_step_height * JACKAL.step_height_m)
    _, clearance = replace(drive, obstacles=[*drive.obstacles, board]).clearance_true_m
    assert (clearance.min() == 0.0) == is_in_the_way
    assert is_in_the_way or clearance.tolist() == drive.clearance_true_m[1].tolist()


def test_what_was_seen_lies_on_what_stands(drive: Drive) -> None:
    everything = shapely.union_all(drive.shapes)
    apart = shapely.distance(shapely.points(drive.seen_m[:, :2]), everything)
    assert len(apart) > 100
    assert np.quantile(apart, 0.95) < 0.15


def window(time_s: float, west_m: float, rows: str) -> CertaintyMap:
    """Make a window of cells of half a metre: # closed, . free, ? never seen."""
    cells = [[{"#": 15, ".": 0, "?": 255}[sign] for sign in row] for row in rows.split()]
    return CertaintyMap(time_s, np.array(cells, np.uint8), west_m, 1.0, 0.5)


def test_what_was_closed_and_is_seen_free_later_is_no_longer_shown(drive: Drive) -> None:
    def shown(*maps: CertaintyMap) -> list[list[float]]:
        return sorted(replace(drive, log=replace(drive.log, maps=list(maps))).seen_m.tolist())

    first = window(1.0, 0.0, "#.# ...")
    assert shown(first) == [[0.25, 0.75, 1.0], [1.25, 0.75, 1.0]]
    # The window goes on: the west cell is out of sight, the other one is seen free, and one behind is new.
    assert shown(first, window(2.0, 0.5, "..# ...")) == [[0.25, 0.75, 1.0], [1.75, 0.75, 2.0]]
    assert shown(first, window(2.0, 0.0, "?.# ...")) == shown(first)


def test_clearance_to_what_is_seen_is_that_to_the_truth_where_all_of_it_is_seen(drive: Drive) -> None:
    seen_s, seen_m = drive.clearance_seen_m
    true_s, true_m = drive.clearance_true_m
    there = np.interp(seen_s, true_s, true_m)
    assert (seen_m > there - 0.25).all()
    assert (np.abs(seen_m - there) < 0.1).mean() > 0.3


@pytest.mark.parametrize("write", [draw_drive_map, draw_frames])
def test_equal_drives_are_equal_pictures(
    folder: Path, drive: Drive, tmp_path: Path, write: Callable[[Path, Drive, dict[str, str]], None]
) -> None:
    for name, shown in (("a.png", drive), ("b.png", replace(drive)), ("c.png", driven(folder, 6)[0])):
        write(tmp_path / name, shown, {})
    first, again, other = ((tmp_path / name).read_bytes() for name in ("a.png", "b.png", "c.png"))
    assert first == again
    assert first != other


def test_the_map_shows_the_way_dotted_over_the_route(drive: Drive, tmp_path: Path) -> None:
    log = drive.log
    route = np.array([drive.driven_m[0], drive.goal_m])
    with_route = replace(drive, log=replace(log, routes=[Line(0.0, route)]))
    draw_drive_map(tmp_path / "a.png", drive, {})
    draw_drive_map(tmp_path / "b.png", with_route, {})
    draw_drive_map(tmp_path / "c.png", replace(drive, obstacles=()), {})
    draw_drive_map(tmp_path / "d.png", replace(with_route, ground=ground()), {})
    counts = {
        name: [pixels_near(tmp_path / name, colour) for colour in (BLUE, DRIVEN, SEEN, STANDING)]
        for name in ("a.png", "b.png", "c.png")
    }
    assert counts["a.png"][0] < 20
    assert counts["b.png"][0] > 2000
    assert counts["a.png"][1] > 500
    assert counts["a.png"][2] > 200
    assert counts["c.png"][3] < 0.1 * counts["a.png"][3]
    no_go = tuple(int(rank_hex(NO_GO_RANK)[place : place + 2], 16) for place in (1, 3, 5))
    assert pixels_near(tmp_path / "d.png", no_go) > 100
    assert pixels_near(tmp_path / "a.png", no_go) == 0


def test_the_dots_lie_where_was_driven(drive: Drive, tmp_path: Path) -> None:
    """A drive that is moved is drawn elsewhere: the dots follow the truth, not the belief."""
    truth = replace(drive.log.truth, y_m=drive.log.truth.y_m + 0.8)
    draw_drive_map(tmp_path / "a.png", drive, {})
    draw_drive_map(tmp_path / "b.png", replace(drive, log=replace(drive.log, truth=truth)), {})
    assert (pixels(tmp_path / "a.png").shape != pixels(tmp_path / "b.png").shape) or (
        np.abs(pixels(tmp_path / "a.png") - pixels(tmp_path / "b.png")).max() > 100
    )


def test_moments_are_the_ends_what_happened_and_others_between(drive: Drive) -> None:
    moments = drive.moments(8)
    times_s = [moment.time_s for moment in moments]
    assert len(moments) == 8
    assert times_s == sorted(set(times_s))
    assert (moments[0].name, moments[-1].name) == ("start", "at the goal")
    recovered = replace(drive, log=replace(drive.log, events=[Event(6.0, "recovery", {}), Event(9.0, "reading", {})]))
    named = {moment.name: moment.time_s for moment in recovered.moments(8)}
    assert named["recovery"] == 6.0
    assert named["soil reading"] == 9.0
    assert len(drive.moments(2)) == 2


@pytest.mark.parametrize("count", [1, 2, 6])
def test_a_drive_of_a_moment_has_moments(tmp_path: Path, count: int) -> None:
    moments = made_up(tmp_path, steps=1).moments(count)
    assert 1 <= len(moments) <= count


def test_the_film_moves_is_short_and_small(drive: Drive, tmp_path: Path) -> None:
    for name in ("a.gif", "b.gif"):
        write_drive_gif(tmp_path / name, drive)
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()
    assert (tmp_path / "a.gif").stat().st_size <= 1_500_000
    with Image.open(tmp_path / "a.gif") as gif:
        shown, length_ms = [], 0
        for number in range(gif.n_frames):  # type: ignore[attr-defined]
            gif.seek(number)
            length_ms += gif.info["duration"]
            shown.append(np.asarray(gif.convert("RGB")))
    assert 10_000 <= length_ms <= 15_000
    assert len(shown) >= 40
    assert all((before != after).any() for before, after in itertools.pairwise(shown))
    # The way grows.
    dots = [int((np.abs(picture.astype(int) - DRIVEN).max(axis=2) < 12).sum()) for picture in shown]
    assert dots[-1] > dots[len(dots) // 2] > dots[0]


def test_a_film_that_would_be_too_large_has_fewer_frames(
    drive: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swathe.report.drive_film._MOST_BYTES", 500_000)
    write_drive_gif(tmp_path / "a.gif", drive)
    assert (tmp_path / "a.gif").stat().st_size <= 500_000


def test_the_key_of_a_narrow_film_is_whole(drive: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A map so narrow that the key would run over the film's edge, with most that a key can name.
    monkeypatch.setattr("swathe.report.drive_film._MOST_FRAMES", 2)
    monkeypatch.setattr("swathe.report.drive_film._MAP_PX", (80, 430))
    fields = {"densities": [0.0, 90.0] * 36, "thresholds": [40.0, 60.0], "direction_rad": 0.5}
    named = replace(drive, log=replace(drive.log, histograms=[Histogram(0.0, fields)]))
    write_drive_gif(tmp_path / "a.gif", named)
    with Image.open(tmp_path / "a.gif") as gif:
        picture = np.asarray(gif.convert("RGB"))
    foot = picture[-80:]
    assert foot[:, -12:].min() > 250
    # The swatch of what is closed, the last of all.
    assert (np.abs(foot.astype(int) - (239, 185, 178)).max(axis=2) < 12).sum() > 100


def test_the_log_says_which_sectors_left_no_direction(drive: Drive) -> None:
    told = [histogram.fields for histogram in drive.log.histograms]
    assert len(told) > 20
    for fields in told:
        assert len(fields["masked"]) == len(fields["blocked"]) == len(fields["densities"])
        assert all(masked >= blocked for masked, blocked in zip(fields["masked"], fields["blocked"], strict=True))
        assert (fields["direction_rad"] is None) == all(fields["masked"])
    assert any(any(fields["masked"]) for fields in told)


def test_histograms_are_drawn_where_there_are_some(drive: Drive, tmp_path: Path) -> None:
    densities = [0.0] * 36 + [90.0] * 36
    fields = {
        "densities": densities,
        "thresholds": [40.0, 60.0],
        "masked": [d > 60 for d in densities],
        "direction_rad": 0.5,
    }
    told = [Histogram(float(at), fields) for at in range(20)]
    for name, histograms in (
        ("without", []),
        ("with", told),
        ("closed", [Histogram(0.0, {**fields, "direction_rad": None})]),
    ):
        draw_frames(tmp_path / f"{name}.png", replace(drive, log=replace(drive.log, histograms=histograms)), {})
    closed_sector = (243, 217, 213)
    counted = {name: pixels_near(tmp_path / f"{name}.png", closed_sector) for name in ("with", "without")}
    assert counted["with"] > counted["without"] + 20_000
    chosen = (28, 122, 116)
    assert pixels_near(tmp_path / "with.png", chosen) > pixels_near(tmp_path / "closed.png", chosen)


def test_every_drive_can_be_drawn(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swathe.report.drive_film._MOST_FRAMES", 8)
    nothing = made_second(events=[], ways=[], routes=[], maps=[], histograms=[], readings=[])
    with RunLogWriter(tmp_path / "bare.mcap", HEADER) as log:
        log.write(nothing)
    bare = RunLog.read(tmp_path / "bare.mcap")
    empty = np.zeros(0)
    unseen = replace(bare.scans, times_s=empty, arrivals_s=empty, ranges_m=np.zeros((0, 0), np.float32))
    echoing = replace(bare, scans=unseen)
    unheard = replace(
        bare.sonar, times_s=empty, arrivals_s=empty, cones=np.zeros(0, np.uint8), ranges_m=np.zeros(0, np.float32)
    )
    blind = replace(echoing, sonar=unheard)
    still = replace(bare, movers=replace(bare.movers, times_s=empty, positions_m=np.zeros((0, 0, 2)), radii_m=empty))
    mover, _ = driven(folder, 2, "moving")
    shapes = (
        sim.Disc(0, 0, 1),
        sim.Box(3, 3, 1, 2, 0.3),
        sim.Wall([(0, 3), (4, 4)]),
        sim.Polygon([(0, 0), (1, 0), (0, 1)]),
    )
    for number, shown in enumerate(
        (
            made_up(tmp_path),
            Drive(bare, 0.5, 0.4, "Bare"),
            Drive(blind, 4.0, 2.0, "Blind", obstacles=shapes, ground=ground()),
            Drive(still, 0.5, 0.4, "Still", goal_m=(500.0, 0.0)),
            mover,
            Drive(echoing, 0.5, 0.4, "Sonar"),
        )
    ):
        target = tmp_path / f"drive-{number}"
        target.mkdir()
        drive_pictures.draw(target, shown)
        assert {entry.name for entry in target.iterdir()} == set(DRIVE_PICTURES)
        assert (target / "drive.gif").stat().st_size <= 1_500_000


def test_echoes_stand_in_the_middle_of_their_cones(tmp_path: Path) -> None:
    with RunLogWriter(tmp_path / "a.mcap", HEADER) as log:
        log.write(made_second())
    bare = RunLog.read(tmp_path / "a.mcap")
    scans = replace(bare.scans, times_s=np.zeros(0), arrivals_s=np.zeros(0), ranges_m=np.zeros((0, 0), np.float32))
    drive = Drive(replace(bare, scans=scans), 0.5, 0.4, "Sonar")
    # Four shots of three cones; 0.5 m is heard by the first cone of the first shot, 2.25 m by the first of the second.
    assert drive.scan_before(0.5) == 3
    assert drive.body_points(0) == pytest.approx(np.array([[0.2 + 0.5 * np.cos(0.5), 0.1 + 0.5 * np.sin(0.5)]]))
    assert drive.body_points(1)[0] == pytest.approx([0.2 + 2.25 * np.cos(0.5), 0.1 + 2.25 * np.sin(0.5)])


def test_what_cannot_be_drawn_is_said(tmp_path: Path) -> None:
    with RunLogWriter(tmp_path / "empty.mcap", HEADER) as log:
        log.close(OUTCOME)
    with pytest.raises(InvalidParameterError, match="no second"):
        Drive(RunLog.read(tmp_path / "empty.mcap"), 0.5, 0.4, "Nothing")
    with pytest.raises(ShapeMismatchError):
        Ground(GridGeometry(3, 4, 1.0, 0.0, 0.0), np.zeros((3, 3), np.float32), np.ones((3, 4), np.uint8))


def test_the_last_thing_before_a_time() -> None:
    lines = [Line(at, np.zeros((0, 2))) for at in (1.0, 2.0)]
    assert [last_before(lines, at) for at in (0.5, 1.0, 1.9, 9.0)] == [None, lines[0], lines[0], lines[1]]


def test_the_report_has_a_section_on_the_drive(
    drive: Drive, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swathe.report.drive_film._MOST_FRAMES", 8)
    _, path = driven(folder)
    summary = {"command": "drive", "status": "reached", "version": "1", "distance_m": 34.4, "duration_s": 18.2}
    summary |= {"min_clearance_m": 0.524, "collisions": 0, "replans": 7, "probes": 2, "reason": "At <the> goal."}
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    assert "<h2>Drive</h2>" not in write_html(tmp_path).read_text()
    (tmp_path / "run.mcap").write_bytes(path.read_bytes())
    drive_pictures.draw(tmp_path, drive)
    page = write_html(tmp_path).read_text()
    assert {entry.name for entry in tmp_path.iterdir()} <= OUR_FILES
    for words in (
        "<h2>Drive</h2>",
        "0.52 m",
        "Soil readings</dt><dd>2",
        "At &lt;the&gt; goal.",
        "<h3>Events</h3>",
        ">route<",
        "times",
    ):
        assert words in page, words
    assert page.count("data:image/png;base64,") == 3
    assert page.count("data:image/gif;base64,") == 1
    assert "It was cut" not in page
    (tmp_path / "run.mcap").write_bytes(path.read_bytes()[:400_000])
    assert "It was cut" in write_html(tmp_path).read_text()


def test_a_drive_with_a_dead_sensor_is_shown_up_to_its_end(tmp_path: Path) -> None:
    from swathe.episode import EpisodeParams

    world, start, goal = sim.random_world(3)
    params = EpisodeParams(faults=(Fault("scan_dead", from_s=3.0),), patience_s=3.0)
    episode = Episode(world, sim.Robot(world, JACKAL, start), Navigator(JACKAL, (goal.x_m, goal.y_m)), params=params)
    with RunLogWriter(tmp_path / "a.mcap", HEADER) as log:
        for second in episode.seconds():
            log.write(second)
        assert episode.outcome is not None
        log.close(episode.outcome)
    log_read = RunLog.read(tmp_path / "a.mcap")
    assert "fault" in {Drive(log_read, 0.5, 0.4, "Dead").moments()[-1].name, *(e.kind for e in log_read.events)} | {
        str(event.fields.get("status")) for event in log_read.events
    }
    assert log_read.outcome is not None
    assert log_read.outcome["status"] == "not_reached"
    draw_frames(tmp_path / "a.png", Drive(log_read, 0.5, 0.4, "Dead"), {})
