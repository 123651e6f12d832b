"""A drive as a GIF: the map with what the robot has seen so far, and beside it what it sees and decides at the moment.

Equal drives give equal bytes. The picture stays below a size that a mail or a page can carry; long drives are shown
faster.
"""

from __future__ import annotations

import io
import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.episode import STATUSES
from swathe.report.animation import _fitted, _font
from swathe.report.drive import certainty_rgba, last_before, masked_sectors, rectangle, sector_directions
from swathe.report.output import replacing
from swathe.report.palette import (
    DRIVEN_COLOUR,
    INK_COLOUR,
    LIMIT_COLOUR,
    LOCAL_WAY_COLOUR,
    OBSTACLE_COLOUR,
    ROUTE_COLOUR,
    SEEN_COLOUR,
    SPEED_COLOUR,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray
    from PIL import Image, ImageDraw

    from swathe.report.drive import Drive

    Points = NDArray[np.float64]

_PAPER, _PANEL, _FAINT = "#ffffff", "#f1efea", "#626873"
_MAP_PX = (560, 430)
_VIEW_PX = 300
_EDGE_PX, _GAP_PX, _HEAD_PX, _FOOT_PX = 14, 18, 62, 36
#: Lines of the key, and where the name of a colour begins beside it.
_LINE_PX, _SWATCH_PX = 20, 20
#: Everything is drawn so many times as large and made smaller, for smooth lines.
_FINE = 2
_FILM_MS, _LAST_MS = 11_000, 1_800
_MOST_BYTES = 1_500_000
_MOST_FRAMES, _FEWEST_FRAMES = 100, 16
_RING = (0.69, 0.98)
_BLOCKED_COLOUR, _DENSITY_COLOUR, _MOVER_COLOUR, _EDGE_COLOUR = "#efb9b2", "#7f8894", "#c9a13b", "#4c4944"
_GOAL_COLOUR, _BEAM_COLOUR = "#ffd23f", "#eccdb9"
#: A vehicle is drawn at least so long on the map.
_VEHICLE_PX = 15


def write_drive_gif(path: Path | str, drive: Drive) -> None:
    """Write a drive as an animated GIF of 12 to 13 seconds and at most 1.5 MB.

    Raises:
        OutputError: the file cannot be written.
    """
    film, content, most = _Film(drive), b"", _MOST_FRAMES
    while not content or (len(content) > _MOST_BYTES and most > _FEWEST_FRAMES):
        # A film is about as large as it has frames.
        most = most if not content else max(_FEWEST_FRAMES, int(0.96 * most * _MOST_BYTES / len(content)))
        content = _encoded(film, np.linspace(drive.start_s, drive.end_s, most).tolist())
    with replacing(path) as stream:
        stream.write(content)


def _encoded(film: _Film, times_s: Sequence[float]) -> bytes:
    from PIL import Image

    pictures = [film.sheet(time_s) for time_s in times_s]
    sample = Image.new("RGB", (pictures[0].width, pictures[0].height * 3))
    for place, picture in enumerate((pictures[0], pictures[len(pictures) // 2], pictures[-1])):
        sample.paste(picture, (0, place * picture.height))
    mixed = sample.quantize(72, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).getpalette() or []
    # What few pixels show is kept as it is, the keys and thin lines above all.
    names = [_PAPER, _PANEL, _FAINT, INK_COLOUR, DRIVEN_COLOUR, ROUTE_COLOUR, LOCAL_WAY_COLOUR, SEEN_COLOUR]
    names += [
        SPEED_COLOUR,
        LIMIT_COLOUR,
        OBSTACLE_COLOUR,
        _BLOCKED_COLOUR,
        _DENSITY_COLOUR,
        _MOVER_COLOUR,
        _GOAL_COLOUR,
        _BEAM_COLOUR,
    ]
    kept = [tuple(int(name[place : place + 2], 16) for place in (1, 3, 5)) for name in names]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*itertools.chain.from_iterable(kept), *mixed[: 3 * 72]])
    indexed = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    # A GIF counts in hundredths of a second.
    each_ms = max(20, round(_FILM_MS / len(pictures) / 10) * 10)
    stream = io.BytesIO()
    times_ms = [each_ms] * (len(pictures) - 1) + [_LAST_MS]
    # Optimised, what does not change from frame to frame is left out.
    indexed[0].save(
        stream, format="GIF", save_all=True, append_images=indexed[1:], duration=times_ms, loop=0, optimize=True
    )
    return stream.getvalue()


class _Film:
    """What stays the same from frame to frame."""

    def __init__(self, drive: Drive) -> None:
        self.drive = drive
        extent = drive.extent
        wide_m, high_m = extent.east_m - extent.west_m, extent.north_m - extent.south_m
        self.zoom = min(_MAP_PX[0] / wide_m, _MAP_PX[1] / high_m)
        self.size = (max(40, round(wide_m * self.zoom)), max(40, round(high_m * self.zoom)))
        self.base = self._base()
        self.seen, self.seen_s = self.base.copy(), -math.inf
        sides = [max(window.certainty.shape) * window.cell_size_m / 2 for window in drive.log.maps]
        self.half_m = max(2.0 * drive.length_m, min(max(sides, default=4.0), 12 * drive.length_m))

    def at(self, points_m: Points) -> list[tuple[float, float]]:
        """Return map metres as pixels of the large map panel."""
        extent, zoom = self.drive.extent, self.zoom * _FINE
        return [((x - extent.west_m) * zoom, (extent.north_m - y) * zoom) for x, y in np.asarray(points_m).tolist()]

    def _base(self) -> Image.Image:
        from PIL import Image, ImageDraw

        size = (self.size[0] * _FINE, self.size[1] * _FINE)
        picture = Image.new("RGB", size, _PANEL)
        ground = self.drive.ground
        if ground is not None:
            from swathe.report.drive_ground import relief_of

            image, covered = relief_of(ground, self.drive.extent, size[0])
            corners = self.at(np.array([[covered.west_m, covered.north_m], [covered.east_m, covered.south_m]]))
            (left, top), (right, bottom) = corners
            spread = (max(1, round(right - left)), max(1, round(bottom - top)))
            whole = Image.fromarray(image, mode="RGB").resize(spread, Image.Resampling.BILINEAR)
            picture.paste(whole, (round(left), round(top)))
        pen = ImageDraw.Draw(picture)
        route = self.drive.route_m
        if route is not None:
            pen.line(self.at(route), fill="#ffffff", width=5 * _FINE, joint="curve")
            pen.line(self.at(route), fill=ROUTE_COLOUR, width=3 * _FINE, joint="curve")
        for shape in self.drive.shapes:
            pen.polygon(self.at(np.asarray(shape.exterior.coords)), fill=OBSTACLE_COLOUR, outline=_EDGE_COLOUR)
        return picture

    def sheet(self, time_s: float) -> Image.Image:
        """Return the frame of a time."""
        from PIL import Image, ImageDraw

        width = self.size[0] + _GAP_PX + _VIEW_PX + 2 * _EDGE_PX
        room = width - 2 * _EDGE_PX
        key = self._key(room)
        foot = _HEAD_PX + max(self.size[1], _VIEW_PX + 74)
        height = foot + _FOOT_PX + _LINE_PX * (len(key) - 1)
        sheet = Image.new("RGB", (width, height), _PAPER)
        pen = ImageDraw.Draw(sheet)
        title, subtitle = self.drive.title, self.drive.subtitle
        pen.text((_EDGE_PX, 10), _fitted(title, _font(18, bold=True), room), INK_COLOUR, _font(18, bold=True))
        pen.text((_EDGE_PX, 36), _fitted(subtitle, _font(13), room), _FAINT, _font(13))
        sheet.paste(self._map(time_s), (_EDGE_PX, _HEAD_PX))
        left = _EDGE_PX + self.size[0] + _GAP_PX
        sheet.paste(self._view(time_s), (left, _HEAD_PX))
        for line, (words, colour) in enumerate(self._words(time_s)):
            font = _font(14, bold=line == 0)
            pen.text((left, _HEAD_PX + _VIEW_PX + 8 + 20 * line), _fitted(words, font, _VIEW_PX), colour, font)
        for number, entries in enumerate(key):
            y = foot + 10 + _LINE_PX * number
            for left_px, name, colour in entries:
                x = _EDGE_PX + left_px
                pen.rectangle((x, y + 3, x + 14, y + 13), fill=colour)
                pen.text((x + _SWATCH_PX, y), name, _FAINT, _font(12))
        return sheet

    def _map(self, time_s: float) -> Image.Image:
        from PIL import ImageDraw

        drive = self.drive
        self._see_until(time_s)
        picture = self.seen.copy()
        pen = ImageDraw.Draw(picture)
        movers = drive.log.movers
        for mover, radius_m in enumerate(movers.radii_m.tolist()):
            place = [np.interp(time_s, movers.times_s, movers.positions_m[:, mover, axis]) for axis in (0, 1)]
            (x, y), r = self.at(np.array([place]))[0], radius_m * self.zoom * _FINE
            pen.ellipse((x - r, y - r, x + r, y + r), fill=_MOVER_COLOUR, outline=_EDGE_COLOUR)
        way = last_before(drive.log.ways, time_s)
        if way is not None and len(way.points_m) > 1:
            pen.line(self.at(way.points_m), fill=LOCAL_WAY_COLOUR, width=2 * _FINE, joint="curve")
        _dotted(pen, self.at(drive.driven_m[drive.log.truth.times_s <= time_s]))
        if drive.goal_m is not None:
            _star(pen, self.at(np.array([drive.goal_m]))[0], 11 * _FINE)
        larger = max(1.0, _VEHICLE_PX / (drive.length_m * self.zoom))
        _vehicle(pen, drive, drive.pose_at(time_s), self.at, larger)
        return picture.reduce(_FINE)

    def _see_until(self, time_s: float) -> None:
        """Add to the map what was seen since the frame before, or begin anew when this one is earlier."""
        from PIL import ImageDraw

        if time_s < self.seen_s:
            self.seen, self.seen_s = self.base.copy(), -math.inf
        pen, points = ImageDraw.Draw(self.seen), self.drive.seen_m
        for x, y in self.at(points[(points[:, 2] > self.seen_s) & (points[:, 2] <= time_s), :2]):
            pen.rectangle((x - _FINE, y - _FINE, x + _FINE - 1, y + _FINE - 1), fill=SEEN_COLOUR)
        self.seen_s = time_s

    def _view(self, time_s: float) -> Image.Image:
        """Return the surroundings of the robot with its histogram around them, north up."""
        from PIL import Image, ImageDraw

        drive, side = self.drive, _VIEW_PX * _FINE
        row = drive.scan_before(time_s)
        pose = drive.pose_at(time_s) if row is None else drive.believed(row)
        zoom = _RING[0] * side / 2 / self.half_m

        def at(points_m: Points) -> list[tuple[float, float]]:
            shifted = np.asarray(points_m) - pose[:2]
            return [(side / 2 + x * zoom, side / 2 - y * zoom) for x, y in shifted.tolist()]

        picture = Image.new("RGB", (side, side), _PANEL)
        self._paste_certainty(picture, time_s, at)
        pen = ImageDraw.Draw(picture)
        if row is not None:
            hits = at(drive.map_points(row))
            origin = at(np.array([pose[:2]]))[0]
            for hit in hits:
                pen.line((origin, hit), fill=_BEAM_COLOUR, width=1)
            for x, y in hits:
                pen.ellipse((x - 4, y - 4, x + 4, y + 4), fill=SEEN_COLOUR)
        way = last_before(drive.log.ways, time_s)
        if way is not None and len(way.points_m) > 1:
            pen.line(at(way.points_m), fill=LOCAL_WAY_COLOUR, width=3 * _FINE, joint="curve")
        _vehicle(pen, drive, pose, at)
        self._draw_ring(picture, time_s)
        return picture.reduce(_FINE)

    def _paste_certainty(
        self, picture: Image.Image, time_s: float, at: Callable[[Points], list[tuple[float, float]]]
    ) -> None:
        from PIL import Image

        window = last_before(self.drive.log.maps, time_s)
        if window is None:
            return
        height, width = (side * window.cell_size_m for side in window.certainty.shape)
        corners = np.array([[window.west_m, window.north_m], [window.west_m + width, window.north_m - height]])
        (left, top), (right, bottom) = at(corners)
        size = (max(1, round(right - left)), max(1, round(bottom - top)))
        colours = Image.fromarray(certainty_rgba(window), mode="RGBA").resize(size, Image.Resampling.NEAREST)
        picture.paste(colours, (round(left), round(top)), colours)

    def _draw_ring(self, picture: Image.Image, time_s: float) -> None:
        """Draw the polar histogram as a ring of bars, and an arrow in the direction that was chosen."""
        from PIL import Image, ImageDraw

        side = picture.width
        middle, inner, outer = side / 2, _RING[0] * side / 2, _RING[1] * side / 2
        mask = Image.new("L", picture.size, 255)
        ImageDraw.Draw(mask).ellipse((middle - inner, middle - inner, middle + inner, middle + inner), fill=0)
        picture.paste(Image.new("RGB", picture.size, _PAPER), (0, 0), mask)
        pen = ImageDraw.Draw(picture)
        histogram = last_before(self.drive.log.histograms, time_s)
        fields: dict[str, Any] = {} if histogram is None else histogram.fields
        densities = np.nan_to_num(np.array(fields.get("densities") or [], np.float64), posinf=0.0)
        count, directions = len(densities), sector_directions(fields).tolist()
        thresholds = [float(value) for value in fields.get("thresholds") or []]
        ceiling = max([2.2 * value for value in thresholds] or [float(densities.max(initial=0.0))]) or 1.0
        closed = masked_sectors(fields)

        def band(sector: int, low: float, high: float) -> list[tuple[float, float]]:
            edges = [directions[sector] + 2 * math.pi * share / count for share in (-0.44, 0.0, 0.44)]
            return [(middle + low * math.cos(a), middle - low * math.sin(a)) for a in edges] + [
                (middle + high * math.cos(a), middle - high * math.sin(a)) for a in reversed(edges)
            ]

        for sector in range(count):
            if closed[sector]:
                pen.polygon(band(sector, inner, outer), fill=_BLOCKED_COLOUR)
            share = min(float(densities[sector]) / ceiling, 1.0)
            if share > 0:
                pen.polygon(band(sector, inner, inner + share * (outer - inner)), fill=_DENSITY_COLOUR)
        for value in thresholds:
            r = inner + value / ceiling * (outer - inner)
            pen.ellipse((middle - r, middle - r, middle + r, middle + r), outline=LIMIT_COLOUR, width=2)
        pen.ellipse((middle - inner, middle - inner, middle + inner, middle + inner), outline=INK_COLOUR, width=3)
        direction = fields.get("direction_rad")
        if direction is not None:
            ray = np.array([math.cos(direction), -math.sin(direction)])
            across = np.array([-ray[1], ray[0]])
            tip, foot = middle + ray * (outer - 2), middle + ray * (0.3 * inner)
            neck = tip - ray * 24
            pen.line((*foot.tolist(), *neck.tolist()), fill=SPEED_COLOUR, width=4 * _FINE)
            head = [tip, neck + across * 15, neck - across * 15]
            pen.polygon([(float(x), float(y)) for x, y in head], fill=SPEED_COLOUR)

    def _words(self, time_s: float) -> list[tuple[str, str]]:
        drive, commands = self.drive, self.drive.log.commands
        row = int(np.searchsorted(commands.times_s, time_s + 1e-9, side="right")) - 1
        status = "driving" if row < 0 else STATUSES[int(commands.status[row])]
        truth = drive.log.truth
        at = max(int(np.searchsorted(truth.times_s, time_s, side="right")) - 1, 0)
        way_m = float(np.hypot(*np.diff(drive.driven_m[: at + 1], axis=0).T).sum())
        colour = INK_COLOUR if status in {"driving", "reached"} else LIMIT_COLOUR
        return [
            (f"{time_s - drive.start_s:.1f} s   {status.replace('_', ' ')}", colour),
            (f"{truth.speed_mps[at]:.2f} m/s   {way_m:.1f} m driven", _FAINT),
            (self._latest(time_s), _FAINT),
        ]

    def _latest(self, time_s: float) -> str:
        """Return what happened last, as long as it is worth reading."""
        span_s = max(1.0, (self.drive.end_s - self.drive.start_s) / 12)
        told = ("recover", "trap", "probe", "reading", "collision", "fault", "jump", "soil", "slip")
        events = [event for event in self.drive.log.events if any(part in event.kind.lower() for part in told)]
        last = last_before(events, time_s)
        return last.kind.replace("_", " ") if last is not None and time_s - last.time_s < span_s else ""

    def _key(self, room_px: float) -> list[list[tuple[float, str, str]]]:
        """Return the keys in lines that find room: how far from the left each begins, its name and its colour."""
        entries = [("driven", DRIVEN_COLOUR), ("local way", LOCAL_WAY_COLOUR), ("seen", SEEN_COLOUR)]
        if self.drive.route_m is not None:
            entries.insert(0, ("global route", ROUTE_COLOUR))
        if self.drive.shapes:
            entries.append(("obstacle", OBSTACLE_COLOUR))
        if len(self.drive.log.movers.radii_m):
            entries.append(("moving", _MOVER_COLOUR))
        if self.drive.log.histograms:
            entries += [("direction", SPEED_COLOUR), ("density", _DENSITY_COLOUR), ("closed", _BLOCKED_COLOUR)]
        lines: list[list[tuple[float, str, str]]] = [[]]
        left_px = 0.0
        for name, colour in entries:
            wide_px = _SWATCH_PX + _font(12).getlength(name)
            if lines[-1] and left_px + wide_px > room_px:
                lines.append([])
                left_px = 0.0
            lines[-1].append((left_px, name, colour))
            left_px += wide_px + _GAP_PX
        return lines


def _dotted(pen: ImageDraw.ImageDraw, points: Sequence[tuple[float, float]]) -> None:
    """Draw a line as dots at equal distances."""
    line = np.array(points)
    if len(line) < 2:
        return
    reached = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    places = np.arange(0.0, reached[-1], 6.0 * _FINE)
    r = 1.6 * _FINE
    for x, y in zip(*(np.interp(places, reached, line[:, axis]).tolist() for axis in (0, 1)), strict=True):
        pen.ellipse((x - r, y - r, x + r, y + r), fill=DRIVEN_COLOUR)


def _star(pen: ImageDraw.ImageDraw, at: tuple[float, float], radius: float) -> None:
    corners = [
        (at[0] + r * math.sin(math.pi * k / 5), at[1] - r * math.cos(math.pi * k / 5))
        for k in range(10)
        for r in [radius if k % 2 == 0 else 0.42 * radius]
    ]
    pen.polygon(corners, fill=_GOAL_COLOUR, outline=INK_COLOUR, width=_FINE)


def _vehicle(
    pen: ImageDraw.ImageDraw,
    drive: Drive,
    pose: tuple[float, float, float],
    at: Callable[[Points], list[tuple[float, float]]],
    larger: float = 1.0,
) -> None:
    corners = pose[:2] + larger * (rectangle(drive, pose) - pose[:2])
    pen.polygon(at(corners), fill="#ffffff", outline=INK_COLOUR, width=_FINE)
    pen.polygon(at(np.array([corners[0], pose[:2], corners[3]])), fill=INK_COLOUR)
