"""The simulated world: collisions, beams, motion and what reaches the robot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, Point
from shapely import Polygon as Area

from swathe import sim
from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.sensor import Pose
from swathe.vehicle import load_vehicle

JACKAL = load_vehicle("jackal")
PLACES = st.floats(-4, 4).map(lambda number: round(number, 3))


def plain(**options: object) -> sim.World:
    """Make 40 x 40 m of level gravel around the origin."""
    return sim.World(np.zeros((80, 80)), cell_size_m=0.5, west_m=-20, north_m=20, **options)  # type: ignore[arg-type]


def footprint(pose: Pose) -> Area:
    box = sim.Box(pose.x_m, pose.y_m, JACKAL.length_m, JACKAL.width_m, pose.heading_rad)
    return Area(box.corners)


@given(x=PLACES, y=PLACES, turn=PLACES, other=st.tuples(PLACES, PLACES, PLACES), size=st.floats(0.05, 3))
def test_collisions_are_shapelys(
    x: float, y: float, turn: float, other: tuple[float, float, float], size: float
) -> None:
    box = sim.Box(x, y, size, 0.7, turn)
    pose = Pose(*other)
    shapes: list[tuple[sim.Box | sim.Wall, Area | LineString]] = [
        (box, Area(box.corners)),
        (sim.Wall([(x, y), (turn, size)]), LineString([(x, y), (turn, size)])),
    ]
    for shape, area in shapes:
        world = plain()
        world.place(shape)
        apart = footprint(pose).distance(area)
        overlap = footprint(pose).intersection(area)
        # Within rounding of touching either answer is right.
        if apart > 1e-9:
            assert not world.collides(JACKAL, pose)
        elif overlap.area > 1e-9 or overlap.length > 1e-6:
            assert world.collides(JACKAL, pose)


@given(x=PLACES, y=PLACES, radius=st.floats(0.05, 2), heading=PLACES)
def test_collisions_with_discs_are_by_exact_distance(x: float, y: float, radius: float, heading: float) -> None:
    world = plain()
    world.place(sim.Disc(x, y, radius))
    apart = footprint(Pose(0, 0, heading)).distance(Point(x, y)) - radius
    if abs(apart) > 1e-9:
        assert world.collides(JACKAL, Pose(0, 0, heading)) == (apart < 0)


def test_beams_end_where_shapely_says() -> None:
    world, start, _ = sim.random_world(3)
    exact = sim.RobotParams()
    quiet = {field: getattr(sim.Laser.preset(), field) for field in sim.Laser.__dataclass_fields__}
    laser = sim.Laser(**{**quiet, "noise_m": 0.0, "resolution_m": 0.0})
    robot = sim.Robot(world, JACKAL, start, laser=laser, params=exact)
    scan = robot.scan()
    areas = [Area(list(o.points)) for o in world.obstacles if isinstance(o, sim.Polygon)]
    x, y = start.x_m + scan.mount[0], start.y_m
    assert np.isfinite(scan.ranges_m).any()
    for beam, range_m in enumerate(scan.ranges_m):
        angle = scan.angle_min_rad + beam * scan.angle_increment_rad
        ray = LineString([(x, y), (x + 9 * math.cos(angle), y + 9 * math.sin(angle))])
        nearest = min(
            (ray.intersection(a.exterior).distance(Point(x, y)) for a in areas if ray.intersects(a)), default=9.0
        )
        if nearest < scan.range_max_m:
            assert range_m == pytest.approx(nearest, abs=1e-9)
        else:
            assert math.isinf(range_m)


def test_a_drive_repeats_by_seed_to_the_bit() -> None:
    params = sim.RobotParams(
        scale_error=0.02, distance_noise_m=0.01, heading_noise_rad=0.01, fix_rate_hz=0.5, fix_noise_m=0.3,
        scan_delay_s=0.1, scan_dropout=0.1, slip_variation=0.5,
    )  # fmt: skip

    def drive(seed: int) -> list[object]:
        world, start, _ = sim.random_world(5, kind="moving")
        robot = sim.Robot(world, JACKAL, start, params=params, seed=seed)
        found: list[object] = []
        for _ in range(100):
            seen = robot.step((1.0, 0.1), 0.05)
            scan = None if seen.scan is None else np.asarray(seen.scan.ranges_m).tobytes()
            found.append((seen.pose, scan, seen.scan_time_s, seen.state))
        return found

    assert drive(1) == drive(1)
    assert drive(1) != drive(2)


def test_scans_come_late_by_their_delay() -> None:
    robot = sim.Robot(plain(), JACKAL, Pose(0, 0, 0), params=sim.RobotParams(scan_delay_s=0.2))
    seen = [robot.step((0.0, 0.0), 0.05) for _ in range(10)]
    assert [s.scan is not None for s in seen[:4]] == [False] * 4
    for s in seen[4:]:
        assert s.scan_time_s == pytest.approx(s.state.time_s - 0.2)


def test_odometry_drifts_and_a_fix_brings_it_back() -> None:
    def worst(fix_rate_hz: float) -> float:
        params = sim.RobotParams(scale_error=0.1, heading_drift_radps=0.02, fix_rate_hz=fix_rate_hz)
        robot = sim.Robot(plain(), JACKAL, Pose(-15, 0, 0), params=params, seed=4)
        return max(
            math.hypot(seen.pose.x_m - seen.state.pose.x_m, seen.pose.y_m - seen.state.pose.y_m)
            for seen in (robot.step((1.0, 0.0), 0.1) for _ in range(200))
        )

    assert worst(0) > 1
    assert worst(2) < 0.5


def test_a_probe_stops_the_robot_and_takes_its_time() -> None:
    soil = np.full((80, 80), 3, dtype=np.uint8)
    world = sim.World(np.zeros((80, 80)), soil, cell_size_m=0.5, west_m=-20, north_m=20)
    robot = sim.Robot(world, JACKAL, Pose(0, 0, 0))
    robot.step((1.0, 0.0), 2.0)
    before = robot.state
    reading = robot.probe()
    after = robot.state
    assert before.speed_mps > 0 == after.speed_mps
    assert after.time_s - before.time_s > 15
    assert len(reading.depths_m) == len(reading.cone_indices_kpa) == 12
    # The cone stands on a boom half a metre before the front edge.
    assert reading.x_m == pytest.approx(after.pose.x_m + JACKAL.length_m / 2 + 0.5)


@pytest.mark.parametrize("kind", ["clutter", "corridor", "u-trap", "dead-end", "moving"])
def test_drawn_worlds_know_whether_there_is_a_way(kind: sim.Kind) -> None:
    world, start, goal = sim.random_world(2, kind=kind)
    straight_m = math.hypot(goal.x_m - start.x_m, goal.y_m - start.y_m)
    length_m = world.passable(JACKAL, start, goal)
    assert length_m is None or length_m > straight_m - 0.5
    world.place(sim.Wall([(0, -20), (0, 20)]))
    assert world.passable(JACKAL, start, goal) is None


def test_unknown_ground_under_the_wheels_and_places_outside_are_said() -> None:
    void = sim.World(np.full((4, 4), np.nan))
    assert void.no_go(JACKAL, Pose(2, 2, 0)) == "unknown"
    assert void.no_go(JACKAL, Pose(9, 2, 0)) == "outside"
    robot = sim.Robot(void, JACKAL, Pose(2, 2, 0))
    seen = robot.step((1.0, 0.0), 1.0)
    assert seen.state.no_go == "unknown"
    assert np.isinf(np.asarray(robot.scan().ranges_m)).all()


def test_the_truth_behind_a_map_differs_as_asked() -> None:
    errors = sim.TruthErrors(height_m=1.0, patch_m=5.0, soil_share=0.3)
    truth = sim.World(np.zeros((60, 60)), np.full((60, 60), 3), errors=errors, seed=1)
    assert 0.3 < truth.elevation_m.std() < 1.5
    assert 0 < (truth.soil != 3).mean() < 0.6
    truth.dig([(0, 30), (60, 30)], 2, 5)
    assert truth.elevation_m[29:31].mean() < -4


@pytest.mark.parametrize(
    ("name", "beams", "range_m", "resolution_m", "rate_hz"),
    [
        ("sick-lms200-8m", 181, 8.192, 0.001, 35),
        ("sick-lms200-8m-361", 361, 8.192, 0.001, 32),
        ("sick-lms200-80m", 181, 81.92, 0.01, 35),
        ("sick-lms200-80m-361", 361, 81.92, 0.01, 32),
    ],
)
def test_a_preset_of_the_lms_200_is_what_its_name_says(
    name: sim.Preset, beams: int, range_m: float, resolution_m: float, rate_hz: float
) -> None:
    laser = sim.Laser.preset(name)
    assert (laser.beams, laser.range_max_m, laser.resolution_m, laser.rate_hz) == (
        beams,
        range_m,
        resolution_m,
        rate_hz,
    )
    assert laser.angle_min_rad == pytest.approx(-math.pi / 2)
    assert laser.angle_increment_rad * (beams - 1) == pytest.approx(math.pi)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ShapeMismatchError):
        sim.World(np.zeros((3, 3)), np.ones((2, 2)))
    with pytest.raises(ShapeMismatchError):
        sim.World(np.zeros((0, 3)))
    with pytest.raises(InvalidParameterError):
        sim.random_world(-1)
    with pytest.raises(InvalidParameterError):
        sim.random_world(1, kind="maze")  # type: ignore[arg-type]
    with pytest.raises(InvalidParameterError):
        sim.Laser.preset("hokuyo")  # type: ignore[arg-type]
    world = plain()
    with pytest.raises(InvalidParameterError):
        world.place(sim.Disc(0, 0, math.nan))
    with pytest.raises(InvalidParameterError):
        sim.Robot(world, JACKAL, Pose(math.nan, 0, 0))
    with pytest.raises(InvalidParameterError):
        sim.Robot(world, JACKAL, Pose(0, 0, 0), params=sim.RobotParams(scan_delay_s=-1))
