"""Episodes: the navigator drives the simulated robot, and every second of it is told."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from swathe import sim
from swathe.drive import Navigator
from swathe.episode import STATUSES, Episode, EpisodeParams, Fault, FaultKind, Motion, Second
from swathe.errors import InvalidParameterError
from swathe.preparation import Stopwatch
from swathe.scenario import load_scenario
from swathe.sensor import Pose
from swathe.staging import Stage, stage
from swathe.vehicle import load_vehicle


def begin(seed: int = 3, kind: sim.Kind = "clutter", params: EpisodeParams | None = None) -> Episode:
    world, start, goal = sim.random_world(seed, kind=kind)
    robot = sim.Robot(world, "jackal", start, seed=seed)
    return Episode(world, robot, Navigator("jackal", (goal.x_m, goal.y_m)), params=params)


def rows(motion: Motion) -> list[np.ndarray]:
    return [getattr(motion, name) for name in Motion.__slots__]


def everything(second: Second) -> list[object]:
    arrays = [*rows(second.odometry), *rows(second.truth), second.scans.ranges_m, second.movers.positions_m]
    arrays += [second.commands.speed_mps, second.commands.status]
    arrays += [window.certainty for window in second.maps] + [line.points_m for line in second.ways]
    return [array.tobytes() for array in arrays] + [repr(second.events)]


def test_a_drive_is_told_in_rows_that_belong_together() -> None:
    episode = begin(kind="moving")
    seconds = list(episode.seconds())
    outcome = episode.outcome
    assert outcome is not None
    assert outcome.status == "reached"
    assert outcome.goal_distance_m < 0.6
    end = 0.0
    for second in seconds:
        assert second.start_s == end
        end = second.end_s
        count = len(second.truth.times_s)
        assert all(len(row) == count for row in rows(second.odometry) + rows(second.truth))
        assert len(second.commands.status) == count
        assert second.scans.ranges_m.dtype == np.float32
        assert second.scans.ranges_m.shape == (len(second.scans.times_s), 181)
        assert second.movers.positions_m.shape == (len(second.movers.times_s), 6, 2)
        assert all(window.certainty.shape == (161, 161) for window in second.maps)
        assert all(line.points_m.shape[1] == 2 for line in second.ways)
        json.dumps([event.fields for event in second.events], allow_nan=False)
        moments = [event.time_s for event in second.events]
        assert moments == sorted(moments)
    driven = np.concatenate([np.column_stack([second.truth.x_m, second.truth.y_m]) for second in seconds])
    assert np.hypot(*np.diff(driven, axis=0).T).sum() == pytest.approx(outcome.distance_m, abs=0.1)
    assert seconds[-1].events[-1].kind == "end"
    assert STATUSES[seconds[-1].commands.status[-1]] == "reached"


def test_the_same_seed_gives_the_same_bytes() -> None:
    def drive(seed: int) -> list[object]:
        return [everything(second) for second in begin(seed, "moving").seconds()]

    assert drive(5) == drive(5)
    assert drive(5) != drive(6)


@pytest.mark.parametrize(
    ("kind", "figures", "reason"),
    [
        ("scan_dead", (), "too old"),
        ("scan_nan", (), "No beam"),
        ("scan_zero", (), "No beam"),
        ("scan_beams", (0.0,), "cannot be used"),
        ("scan_beams", (1000.0,), "cannot be used"),
        ("scan_late", (30.0,), "too old"),
        ("scan_repeated", (), "repeats itself"),
        ("clock_off", (-3.0,), "clock went back"),
        ("pose_off", (5.0, 0.0, 0.0), "pose jumped"),
    ],
)
def test_a_fault_stops_the_robot_and_is_told(kind: FaultKind, figures: tuple[float, ...], reason: str) -> None:
    fault = Fault(kind, 3.0, 9.0, figures)
    episode = begin(params=EpisodeParams(faults=(fault,)))
    seconds = list(episode.seconds())
    events = [event for second in seconds for event in second.events]
    assert [event.fields["fault"] for event in events if event.kind == "fault_begins"] == [kind]
    told = [event.fields["text"] for event in events if event.kind == "status" and event.fields["status"] == "fault"]
    assert any(reason in sentence for sentence in told)
    assert episode.outcome is not None
    assert episode.outcome.collisions == 0


@pytest.mark.parametrize(
    ("kind", "figures"),
    [("scan_late", (0.2,)), ("scan_late", (2.0,)), ("scan_swapped", ()), ("scan_max", ()), ("scan_beams", (90.0,))],
)
def test_scans_that_are_late_swapped_short_or_clear_break_nothing(kind: FaultKind, figures: tuple[float, ...]) -> None:
    fault = Fault(kind, 3.0, 4.0, figures)
    outcome = begin(params=EpisodeParams(faults=(fault,))).run()
    assert outcome.collisions == 0
    assert outcome.status == "reached"


def with_sonar(params: EpisodeParams | None = None, *, has_laser: bool = False, vehicle: str = "jackal") -> Episode:
    world, start, goal = sim.random_world(3)
    robot = sim.Robot(world, vehicle, start, params=sim.RobotParams(has_laser=has_laser, sonar=True), seed=3)
    return Episode(world, robot, Navigator(vehicle, (goal.x_m, goal.y_m)), params=params)


@pytest.mark.parametrize("has_laser", [False, True])
def test_a_sonar_ring_is_driven_with_and_told_cone_by_cone(has_laser: bool) -> None:
    episode = with_sonar(has_laser=has_laser)
    seconds = list(episode.seconds())
    outcome = episode.outcome
    assert outcome is not None
    assert (outcome.status, outcome.collisions) == ("reached", 0)
    assert all(bool(len(second.scans.times_s)) == has_laser for second in seconds)
    sonar = seconds[1].sonar
    assert len(sonar.mounts) == 8
    # 25 shots a second, each of eight cones in order.
    assert sonar.cones.tolist() == list(range(8)) * 25
    assert np.ptp(sonar.times_s.reshape(25, 8), axis=1).max() == 0
    heard = np.isfinite(sonar.ranges_m)
    assert heard.any()
    assert (sonar.ranges_m[heard] < sonar.range_max_m).all()


def test_a_ring_sits_on_the_edge_of_any_vehicle() -> None:
    pioneer, tractor = (with_sonar(vehicle=name).advance(0.1).sonar.mounts for name in ("pioneer-2dx", "tractor"))
    for (x, y, turned), (far_x, far_y, far_turned) in zip(pioneer, tractor, strict=True):
        assert turned == far_turned
        assert far_x == pytest.approx(x * 4.4 / 0.44)
        assert far_y == pytest.approx(y * 2.3 / 0.38)


@pytest.mark.parametrize(
    ("kind", "figures", "reason"),
    [
        ("scan_dead", (), "too old"),
        ("scan_nan", (), "No beam"),
        ("scan_zero", (), "No beam"),
        ("scan_beams", (0.0,), "cannot be used"),
        ("scan_late", (30.0,), "too old"),
    ],
)
def test_a_ring_that_fails_stops_the_robot_and_is_told(
    kind: FaultKind, figures: tuple[float, ...], reason: str
) -> None:
    episode = with_sonar(EpisodeParams(faults=(Fault(kind, 3.0, 9.0, figures),)))
    seconds = list(episode.seconds())
    events = [event for second in seconds for event in second.events]
    told = [event.fields["text"] for event in events if event.kind == "status" and event.fields["status"] == "fault"]
    assert any(reason in sentence for sentence in told)
    assert float(np.abs(seconds[7].truth.speed_mps).max()) == 0.0
    assert episode.outcome is not None
    assert (episode.outcome.status, episode.outcome.collisions) == ("reached", 0)


def test_with_both_sensors_a_dead_one_is_made_up_for() -> None:
    world, start, goal = sim.random_world(3)
    params = sim.RobotParams(sonar=True)
    robot = sim.Robot(world, "jackal", start, params=params, laser=replace(sim.Laser.preset(), dropout=1.0), seed=3)
    outcome = Episode(world, robot, Navigator("jackal", (goal.x_m, goal.y_m))).run()
    assert (outcome.status, outcome.collisions) == ("reached", 0)


def test_a_probe_stops_the_robot_and_takes_its_time() -> None:
    episode = begin()
    episode.advance(3.0)
    episode.ask_for_probe()
    second = episode.advance(30.0)
    begun = next(event for event in second.events if event.kind == "probe_begins")
    ((done_s, reading),) = second.readings
    assert done_s - begun.time_s == pytest.approx(begun.fields["seconds"], abs=0.03)
    assert begun.fields["seconds"] == pytest.approx(15.0)
    during = (second.truth.times_s > begun.time_s) & (second.truth.times_s < done_s)
    assert np.ptp(second.truth.x_m[during]) < 0.01
    at = np.searchsorted(second.odometry.times_s, begun.time_s)
    # The cone stands on a boom, half a metre before the front edge.
    ahead_m = load_vehicle("jackal").length_m / 2 + 0.5
    heading_rad = second.odometry.heading_rad[at]
    assert reading.x_m == pytest.approx(second.odometry.x_m[at] + ahead_m * math.cos(heading_rad))
    assert reading.y_m == pytest.approx(second.odometry.y_m[at] + ahead_m * math.sin(heading_rad))


@pytest.fixture(scope="module")
def probing() -> Stage:
    """The paper's ground without its bog: the robot probes every 25 m, and may go everywhere."""
    firm = load_scenario("paper").with_changes({"truth.patches": [], "soil_news": []})
    return stage(firm, watch=Stopwatch())


def limit_s(made: Stage, **changes: object) -> float:
    asked = {f"probing.{key}": value for key, value in changes.items()}
    return replace(made, scenario=made.scenario.with_changes({"drive.time_limit_s": None, **asked})).time_limit_s


def test_the_time_that_a_drive_may_take_grows_with_the_readings_that_it_may_stop_for(probing: Stage) -> None:
    without_s = limit_s(probing, policy="never")
    stops_s = [limit_s(probing, policy="every", every_m=spacing_m) - without_s for spacing_m in (50.0, 25.0, 10.0)]
    length_m = probing.route.length_m
    assert stops_s == pytest.approx([30 * length_m / 50, 30 * length_m / 25, 30 * length_m / 10])
    for policy in ("where-it-matters", "where-it-pays"):
        assert limit_s(probing, policy=policy) == pytest.approx(without_s + stops_s[-1])
    asked = probing.scenario.with_changes({"drive.time_limit_s": 77.0})
    assert replace(probing, scenario=asked).time_limit_s == 77.0


def probe_with(made: Stage, fault: Fault) -> tuple[Episode, Navigator]:
    """Begin a staged drive once more, with a fault."""
    assert made.world is not None
    _, navigator = made.episode()
    robot = sim.Robot(made.world, made.vehicle, made.start)
    return Episode(made.world, robot, navigator, params=EpisodeParams(faults=(fault,))), navigator


def kinds_of(seconds: list[Second], *kinds: str) -> list[str]:
    return [event.kind for second in seconds for event in second.events if event.kind in kinds]


@pytest.mark.parametrize("kpa", [-300.0, math.nan, 1e9, math.inf])
def test_a_reading_that_no_ground_gives_is_refused_and_the_drive_goes_on(probing: Stage, kpa: float) -> None:
    fault = Fault("reading_of", 0.0, 120.0, (kpa,))
    episode, navigator = probe_with(probing, fault)
    seconds = [episode.advance(1.0)]
    places = [(float(x_m), float(y_m)) for x_m in range(10, 120, 5) for y_m in range(10, 120, 5)]
    before = [navigator.soil_at(place) for place in places]
    assert len(set(map(str, before))) > 1, "the map knows several soils"
    seconds += [episode.advance(1.0) for _ in range(119)]
    given = [reading for second in seconds for _, reading in second.readings]
    assert len(given) >= 2
    for reading in given:
        assert len(reading.depths_m) > 5
        assert np.array_equal(reading.cone_indices_kpa, np.full(len(reading.depths_m), kpa), equal_nan=True)
    # Each is refused aloud, none teaches anything, and the robot drives on after each.
    assert kinds_of(seconds, "reading_refused", "reading_taken", "nests_changed") == ["reading_refused"] * len(given)
    assert [navigator.soil_at(place) for place in places] == before
    assert math.dist(*((reading.x_m, reading.y_m) for reading in (given[0], given[-1]))) > 20
    later = list(episode.seconds())
    outcome = episode.outcome
    assert outcome is not None
    assert (outcome.status, outcome.collisions) == ("reached", 0)
    assert outcome.probes == len(kinds_of(later, "reading_taken")) > 0, "what was refused is none"
    # The penetrometer is believed again when it is well.
    assert kinds_of(later, "reading_refused") == []
    assert [navigator.soil_at(place) for place in places] != before


def test_a_wrong_reading_that_some_ground_could_give_is_believed(probing: Stage) -> None:
    """What a fault makes the penetrometer say does reach the belief: soft ground where the map says sand."""
    episode, navigator = probe_with(probing, Fault("reading_of", figures=(50.0,)))
    seconds = [episode.advance(1.0)]
    soil = navigator.soil
    for second in episode.seconds():
        seconds.append(second)
        if second.readings:
            break
    assert kinds_of(seconds, "reading_taken", "reading_refused") == ["reading_taken"]
    assert not np.array_equal(soil, navigator.soil)  # type: ignore[arg-type]


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InvalidParameterError, match="control period"):
        begin(params=EpisodeParams(control_period_s=math.nan))
    with pytest.raises(InvalidParameterError, match="end of a fault"):
        begin(params=EpisodeParams(faults=(Fault("scan_dead", 3.0, 2.0),)))
    world, start, goal = sim.random_world(3)
    robot = sim.Robot(sim.random_world(4).world, "jackal", Pose(start.x_m, start.y_m, 0.0))
    with pytest.raises(InvalidParameterError, match="another world"):
        Episode(world, robot, Navigator("jackal", (goal.x_m, goal.y_m)))
