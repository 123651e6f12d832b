"""A drive as its pictures need it: the log, the ground and the truth around it, and the moments worth showing."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeVar

import numpy as np
import shapely

from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.runlog.writer import MOST_CERTAIN, UNSEEN
from swathe.sim import Box, Disc, Polygon, Wall

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from numpy.typing import NDArray

    from swathe.episode import CertaintyMap
    from swathe.grid import GridGeometry
    from swathe.runlog import RunLog

    Obstacle = Disc | Box | Polygon | Wall

#: Points of the scans nearer to each other than this are one in a picture.
_SEEN_CELL_M = 0.1
#: A return nearer than this many lengths of the vehicle is the first obstacle.
_NEAR_LENGTHS = 4.0
_MARGIN_M = 1.5
#: Certainty from which a cell is shown as closed.
_SURELY = 8
_FREE_RGBA, _CLOSED_RGBA = (255, 255, 255, 190), (48, 48, 54, 255)
#: Walls have no thickness; they are drawn as if they had this much to each side.
_HALF_WALL_M = 0.02

#: What the kind of an event tells (a part of it), and how the pictures call it, the most telling first.
_TELLING = (
    ("collision", "collision"),
    ("probe", "probing the soil"),
    ("reading", "soil reading"),
    ("soil", "news of the soil"),
    ("trap", "trap"),
    ("recover", "recovery"),
    ("fault", "fault"),
    ("jump", "pose jump"),
    ("slip", "slip"),
)

_ENDINGS = {"reached": "at the goal", "collision": "collision", "timeout": "out of time", "not_reached": "given up"}


class Extent(NamedTuple):
    """A rectangle of the map, in metres."""

    west_m: float
    east_m: float
    south_m: float
    north_m: float


class Moment(NamedTuple):
    """A time worth showing, and why."""

    time_s: float
    name: str


@dataclass(frozen=True, eq=False)
class Ground:
    """The map under a drive: layers of one geometry in the drive's frame; ``rank`` holds 0 unknown, 1 no-go, 2..10."""

    geometry: GridGeometry
    elevation_m: NDArray[np.float32]
    rank: NDArray[np.uint8]

    def __post_init__(self) -> None:
        for name, layer in (("elevation_m", self.elevation_m), ("rank", self.rank)):
            if layer.shape != self.geometry.shape:
                raise ShapeMismatchError(
                    f"The drive's {name} has the shape {layer.shape}, its geometry {self.geometry.shape}.",
                    "Give layers of one geometry.",
                )


@dataclass(frozen=True, eq=False)
class Drive:
    """What the pictures of a drive are made of.

    Attributes:
        log: the run log.
        length_m: length of the vehicle's rectangle around its pose.
        width_m: its width.
        title: heading of the pictures.
        subtitle: the line under it.
        goal_m: where the drive should end.
        obstacles: what stands in truth.
        ground: the map, where there is one.
        step_height_m: how high a thing the vehicle climbs.
    """

    log: RunLog
    length_m: float
    width_m: float
    title: str
    subtitle: str = ""
    goal_m: tuple[float, float] | None = None
    obstacles: Sequence[Obstacle] = ()
    ground: Ground | None = None
    step_height_m: float = 0.0

    def __post_init__(self) -> None:
        if not len(self.log.truth.times_s):
            raise InvalidParameterError(
                "The run log holds no second of a drive, so there is nothing to draw.",
                "Draw a log that goes on longer.",
            )

    @property
    def start_s(self) -> float:
        """When the log begins."""
        return float(self.log.truth.times_s[0])

    @property
    def end_s(self) -> float:
        """When it ends."""
        return float(self.log.truth.times_s[-1])

    @property
    def driven_m(self) -> NDArray[np.float64]:
        """Where the body went in truth, (n, 2)."""
        return np.column_stack([self.log.truth.x_m, self.log.truth.y_m])

    @property
    def route_m(self) -> NDArray[np.float64] | None:
        """The first global route, (k, 2)."""
        return next((line.points_m for line in self.log.routes if len(line.points_m) > 1), None)

    @cached_property
    def extent(self) -> Extent:
        """The part of the map to show: all that was driven, start, goal and route, with a margin."""
        places = [self.driven_m]
        places += [line.points_m for line in self.log.routes if len(line.points_m)]
        if self.goal_m is not None:
            places.append(np.array([self.goal_m]))
        every = np.concatenate(places)
        low, high = every.min(axis=0), every.max(axis=0)
        margin = _MARGIN_M + self.length_m + 0.06 * float((high - low).max())
        # A straight drive is not shown as a thin strip.
        half = np.maximum((high - low) / 2 + margin, 0.3 * float((high - low).max()) + margin)
        middle = (low + high) / 2
        west, south = (middle - half).tolist()
        east, north = (middle + half).tolist()
        if self.ground is not None:
            # Not beyond the map, unless the drive itself goes there.
            geometry = self.ground.geometry
            west, south = min(max(west, geometry.west_m), low[0]), min(max(south, geometry.south_m), low[1])
            east, north = max(min(east, geometry.east_m), high[0]), max(min(north, geometry.north_m), high[1])
        return Extent(float(west), float(east), float(south), float(north))

    @cached_property
    def shapes(self) -> list[shapely.Polygon]:
        """The obstacles as polygons without holes, of a wall one for each of its straight parts."""
        parts = (part for obstacle in self.obstacles for part in _shapes(obstacle))
        return [part.buffer(_HALF_WALL_M) if isinstance(part, shapely.LineString) else part for part in parts]

    def pose_at(self, time_s: float) -> tuple[float, float, float]:
        """Return x, y and heading of the body at a time (the last row before it)."""
        truth = self.log.truth
        row = max(int(np.searchsorted(truth.times_s, time_s, side="right")) - 1, 0)
        return float(truth.x_m[row]), float(truth.y_m[row]), float(truth.heading_rad[row])

    def scan_before(self, time_s: float) -> int | None:
        """Return the row of the last scan that had arrived."""
        row = int(np.searchsorted(self._sight[1], time_s + 1e-9, side="right")) - 1
        return row if row >= 0 else None

    def body_points(self, row: int) -> NDArray[np.float64]:
        """Return what a scan hit, ahead and left of the body, (n, 2)."""
        points, rows = self._hits
        found: NDArray[np.float64] = points[rows == row]
        return found

    def map_points(self, row: int) -> NDArray[np.float64]:
        """Return where a scan's hits lie on the map by the pose that the robot believed, (n, 2)."""
        return _placed(self.body_points(row), *self.believed(row))

    @cached_property
    def seen_m(self) -> NDArray[np.float64]:
        """What the robot took for closed when it last saw it, in the order of time: x, y and since when, (n, 3).

        Cells of the certainty windows; without these all that scans hit, ground included.
        """
        if self.log.maps:
            return _closed_cells(self.log.maps)
        points, rows = self._hits
        odometry, (times_s, arrivals_s) = self.log.odometry, self._sight
        heading = np.interp(times_s, odometry.times_s, np.unwrap(odometry.heading_rad))[rows]
        x_m = np.interp(times_s, odometry.times_s, odometry.x_m)[rows]
        y_m = np.interp(times_s, odometry.times_s, odometry.y_m)[rows]
        placed = _placed(points, x_m, y_m, heading)
        cells = np.rint(placed / _SEEN_CELL_M).astype(np.int64)
        _, first = np.unique(cells, axis=0, return_index=True)
        first.sort()
        return np.column_stack([placed[first], arrivals_s[rows[first]]])

    @cached_property
    def clearance_seen_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times of the scans, and how far the vehicle's rectangle was from the nearest hit of each (infinite: none)."""
        points, rows = self._hits
        beyond = np.maximum(np.abs(points) - np.array([self.length_m, self.width_m]) / 2, 0.0)
        times_s, _ = self._sight
        nearest = np.full(len(times_s), np.inf)
        np.minimum.at(nearest, rows, np.hypot(*beyond.T))
        return times_s, nearest

    @cached_property
    def clearance_true_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times, and how far the vehicle's rectangle truly was from what stands and moves (infinite: nothing does).

        What the vehicle climbs does not count.
        """
        truth, movers = self.log.truth, self.log.movers
        corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (self.length_m / 2, self.width_m / 2)
        cos, sin = np.cos(truth.heading_rad), np.sin(truth.heading_rad)
        turned = np.stack(
            [
                truth.x_m[:, None] + cos[:, None] * corners[:, 0] - sin[:, None] * corners[:, 1],
                truth.y_m[:, None] + sin[:, None] * corners[:, 0] + cos[:, None] * corners[:, 1],
            ],
            axis=-1,
        )
        bodies = shapely.polygons(turned)
        nearest = np.full(len(bodies), np.inf)
        in_the_way = [one for one in self.obstacles if one.height_m > self.step_height_m]
        if in_the_way:
            tree = shapely.STRtree([part for obstacle in in_the_way for part in _shapes(obstacle)])
            (rows, _), nearest_m = tree.query_nearest(bodies, return_distance=True, all_matches=False)
            nearest[rows] = nearest_m
        for mover in range(len(movers.radii_m)):
            at = [np.interp(truth.times_s, movers.times_s, movers.positions_m[:, mover, axis]) for axis in (0, 1)]
            apart = shapely.distance(bodies, shapely.points(*at)) - movers.radii_m[mover]
            nearest = np.minimum(nearest, np.maximum(apart, 0.0))
        return truth.times_s, nearest

    def moments(self, count: int = 8) -> list[Moment]:
        """Return ``count`` moments in order: the ends, the first obstacle, what went wrong or was learnt, others."""
        wanted = [Moment(self.start_s, "start"), Moment(self.end_s, self._ending())]
        times_s, nearest = self.clearance_seen_m
        near = np.flatnonzero(nearest < _NEAR_LENGTHS * self.length_m)
        if len(near):
            wanted.append(Moment(float(times_s[near[0]]), "first obstacle near"))
            wanted.append(Moment(float(times_s[np.argmin(nearest)]), "nearest to an obstacle"))
        for part, name in _TELLING:
            found = [event.time_s for event in self.log.events if part in event.kind.lower()]
            wanted += [Moment(found[place], name) for place in _spread(len(found), 2)]
        apart_s = max(0.4, 0.35 * (self.end_s - self.start_s) / count)
        chosen: list[Moment] = []
        for moment in wanted:
            if len(chosen) < count and all(abs(moment.time_s - other.time_s) >= apart_s for other in chosen):
                chosen.append(moment)
        while len(chosen) < count and self.end_s > self.start_s:
            chosen.sort()
            _, widest = max((after.time_s - before.time_s, before.time_s) for before, after in pairwise(chosen))
            gap_s = next(after.time_s for after in chosen if after.time_s > widest) - widest
            chosen.append(Moment(widest + gap_s / 2, "on the way"))
        return sorted(chosen)

    def _ending(self) -> str:
        outcome = self.log.outcome or {}
        return _ENDINGS.get(str(outcome.get("status")), "end of the log")

    @cached_property
    def _sight(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """When the scans were taken and when they arrived; of a robot without a laser, the shots of its sonar ring."""
        scans, sonar = self.log.scans, self.log.sonar
        if len(scans.times_s) or not len(sonar.times_s):
            return scans.times_s, scans.arrivals_s
        first = np.flatnonzero(np.diff(sonar.arrivals_s, prepend=-np.inf))
        return sonar.times_s[first], sonar.arrivals_s[first]

    @cached_property
    def _hits(self) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """What all scans hit, ahead and left of the body, and the row of the scan of each."""
        if not len(self.log.scans.times_s):
            return self._echoes
        scans = self.log.scans
        ranges = scans.ranges_m.astype(np.float64)
        with np.errstate(invalid="ignore"):
            hit = np.isfinite(ranges) & (ranges >= scans.range_min_m) & (ranges < scans.range_max_m)
        rows, beams = np.nonzero(hit)
        ahead_m, left_m, turned_rad = scans.mount
        angle = turned_rad + scans.angle_min_rad + beams * scans.angle_increment_rad
        far = ranges[rows, beams]
        return np.column_stack([ahead_m + far * np.cos(angle), left_m + far * np.sin(angle)]), rows

    @property
    def _echoes(self) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """What the sonar ring hit, taken to stand in the middle of its cone, and the row of the shot of each."""
        sonar = self.log.sonar
        ranges = sonar.ranges_m.astype(np.float64)
        with np.errstate(invalid="ignore"):
            hit = np.isfinite(ranges) & (ranges >= sonar.range_min_m) & (ranges < sonar.range_max_m)
        shots = np.searchsorted(self._sight[1], sonar.arrivals_s)
        ahead_m, left_m, turned_rad = np.array(sonar.mounts, np.float64).reshape(-1, 3)[sonar.cones[hit]].T
        points = [ahead_m + ranges[hit] * np.cos(turned_rad), left_m + ranges[hit] * np.sin(turned_rad)]
        return np.column_stack(points), shots[hit]

    def believed(self, row: int) -> tuple[float, float, float]:
        """Return where the robot thought it was when a scan was taken: x, y and heading."""
        odometry, time_s = self.log.odometry, self._sight[0][row]
        at = int(np.searchsorted(odometry.times_s, time_s + 1e-9, side="right")) - 1
        at = max(at, 0)
        return float(odometry.x_m[at]), float(odometry.y_m[at]), float(odometry.heading_rad[at])


def rectangle(drive: Drive, pose: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the corners of the vehicle's rectangle at a pose, (4, 2)."""
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (drive.length_m / 2, drive.width_m / 2)
    return _placed(corners, *pose)


class _Timed(Protocol):
    @property
    def time_s(self) -> float: ...


_Item = TypeVar("_Item", bound=_Timed)


def last_before(items: Sequence[_Item], time_s: float) -> _Item | None:
    """Return the last of things in the order of time that is not later than a time, or None."""
    before = [item for item in items if item.time_s <= time_s + 1e-9]
    return before[-1] if before else None


def _spread(count: int, most: int) -> list[int]:
    return sorted({round(place) for place in np.linspace(0, count - 1, min(count, most))}) if count else []


def _placed(
    points: NDArray[np.float64],
    x_m: float | NDArray[np.float64],
    y_m: float | NDArray[np.float64],
    heading_rad: float | NDArray[np.float64],
) -> NDArray[np.float64]:
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    ahead, left = points[:, 0], points[:, 1]
    return np.column_stack([x_m + cos * ahead - sin * left, y_m + sin * ahead + cos * left])


def certainty_rgba(window: CertaintyMap) -> NDArray[np.uint8]:
    """Return the colours of a certainty window: never seen is clear, free pale, closed dark."""
    share = np.minimum(window.certainty, MOST_CERTAIN)[..., None] / MOST_CERTAIN
    colours = (1 - share) * np.array(_FREE_RGBA) + share * np.array(_CLOSED_RGBA)
    colours[window.certainty == UNSEEN] = 0
    plain: NDArray[np.uint8] = colours.astype(np.uint8)
    return plain


def sector_directions(fields: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return where each sector of a histogram points, counter-clockwise from east."""
    count = len(fields.get("densities") or [])
    first_rad = float(fields.get("first_rad") or 0.0)
    return np.array([first_rad + sector * 2 * math.pi / count for sector in range(count)])


def masked_sectors(fields: Mapping[str, Any]) -> NDArray[np.bool_]:
    """Return which sectors of a histogram are closed; none where it does not say."""
    count = len(fields.get("densities") or [])
    masked = np.array(fields.get("masked") or [], np.bool_)
    return masked if len(masked) == count else np.zeros(count, np.bool_)


def _closed_cells(maps: Sequence[CertaintyMap]) -> NDArray[np.float64]:
    """Return the cells that were closed in the last window that showed them: x, y and since when, (n, 3)."""
    cell_m = maps[0].cell_size_m
    rows, columns, since_s = np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    for window in maps:
        # Windows lie on one grid: its columns count east from the frame's origin, its rows south.
        top, left = round(-window.north_m / cell_m), round(window.west_m / cell_m)
        height, width = window.certainty.shape
        certainty = np.where(window.certainty == UNSEEN, 0, window.certainty)
        inside = (rows >= top) & (rows < top + height) & (columns >= left) & (columns < left + width)
        told = window.certainty[rows[inside] - top, columns[inside] - left]
        kept = ~inside
        kept[inside] = (told >= _SURELY) | (told == UNSEEN)
        certainty[rows[inside & kept] - top, columns[inside & kept] - left] = 0  # known already
        rows, columns, since_s = rows[kept], columns[kept], since_s[kept]
        new_rows, new_columns = np.nonzero(certainty >= _SURELY)
        rows, columns = np.append(rows, new_rows + top), np.append(columns, new_columns + left)
        since_s = np.append(since_s, np.full(len(new_rows), window.time_s))
    return np.column_stack([(columns + 0.5) * cell_m, -(rows + 0.5) * cell_m, since_s])


def _shapes(obstacle: Obstacle) -> list[shapely.Geometry]:
    """Return what an obstacle is made of; the straight parts of a wall have no thickness."""
    if isinstance(obstacle, Disc):
        return [shapely.Point(obstacle.x_m, obstacle.y_m).buffer(obstacle.radius_m)]
    if isinstance(obstacle, Wall):
        return [shapely.LineString(part) for part in pairwise(obstacle.points) if part[0] != part[1]]
    return [shapely.Polygon(obstacle.corners if isinstance(obstacle, Box) else list(obstacle.points))]
