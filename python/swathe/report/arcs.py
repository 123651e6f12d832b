"""Arcs on the pictures of a swarm: the present one strong, earlier ones fading, a route in the colour of routes."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.report.palette import INK_COLOUR, ROUTE_CASING_COLOUR, ROUTE_COLOUR

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from PIL import Image, ImageFont

    from swathe.grid import GridGeometry, Position
    from swathe.swarm import Frame

#: The arc that is laid anew; unlike any colour of the ground.
LAID_COLOUR = "#e0115f"

#: Opacity of earlier arcs, the latest first.
FADING = (0.6, 0.46, 0.34, 0.24, 0.15)

#: Points of an arc that are kept are so far apart at least, in blocks.
_APART = 0.8

#: Arcs are drawn so many times as large, for smooth lines.
_FINE = 2


def in_blocks(geometry: GridGeometry, step: int, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return map metres as (n, 2) x to the right and y down in blocks of ``step`` cells, thinned where points crowd."""
    points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
    side_m = geometry.cell_size_m * step
    xy: NDArray[np.float64] = np.column_stack(
        [(points[:, 0] - geometry.west_m) / side_m, (geometry.north_m - points[:, 1]) / side_m]
    )
    if len(xy) < 3:
        return xy
    # Each vertex that leaves the last kept one far enough behind stays, and the last always does.
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
    kept = np.unique(np.searchsorted(travelled, np.arange(0.0, travelled[-1], _APART)))
    kept = np.unique(np.append(kept, len(xy) - 1))
    return xy[kept]


def arcs_before(frames: Sequence[Frame], number: int) -> list[int]:
    """Return the numbers of earlier frames whose arcs differ, the latest first; none of routes and before them."""
    found: list[int] = []
    if frames[number].is_route:
        return found
    last = frames[number].arc
    for earlier in range(number - 1, -1, -1):
        arc = frames[earlier].arc
        if len(found) == len(FADING) or arc is None or last is None:
            break
        if len(arc) and not np.array_equal(arc, last):
            found.append(earlier)
            last = arc
    return found


def draw(
    ground: Image.Image,
    geometry: GridGeometry,
    frames: Sequence[Frame],
    number: int,
    *,
    ends: Sequence[Position],
    font: ImageFont.FreeTypeFont,
) -> Image.Image:
    """Return the ground with the arcs of a frame and with start and goal."""
    from PIL import Image, ImageColor, ImageDraw

    frame = frames[number]
    zoom = ground.width / frame.seen.shape[1] * _FINE
    sheet = Image.new("RGBA", (ground.width * _FINE, ground.height * _FINE), (255, 255, 255, 0))

    def line(of: Frame, colour: str, opacity: float, width: int) -> None:
        if of.arc is None or len(of.arc) < 2:
            return
        points = [(x * zoom, y * zoom) for x, y in in_blocks(geometry, of.step, of.arc).tolist()]
        layer = Image.new("RGBA", sheet.size, (*ImageColor.getrgb(colour)[:3], 0))
        fill = (*ImageColor.getrgb(colour)[:3], round(255 * opacity))
        ImageDraw.Draw(layer).line(points, fill=fill, width=width * _FINE, joint="curve")
        sheet.alpha_composite(layer)

    for opacity, earlier in reversed(list(zip(FADING, arcs_before(frames, number), strict=False))):
        line(frames[earlier], LAID_COLOUR, opacity, 2)
    line(frame, ROUTE_CASING_COLOUR, 0.9, 5)
    line(frame, ROUTE_COLOUR if frame.is_route else LAID_COLOUR, 1.0, 3)
    pen = ImageDraw.Draw(sheet)
    for filled, end in zip((False, True), ends, strict=False):
        ((x, y),) = in_blocks(geometry, frame.step, np.array([end])).tolist()
        x, y, radius = x * zoom, y * zoom, 6 * _FINE
        pen.ellipse((x - radius, y - radius, x + radius, y + radius), ROUTE_CASING_COLOUR, INK_COLOUR, 2 * _FINE)
        if filled:
            inner = radius / 2
            pen.ellipse((x - inner, y - inner, x + inner, y + inner), INK_COLOUR)
    smooth = sheet.resize(ground.size, Image.Resampling.BOX)
    done = Image.alpha_composite(ground.convert("RGBA"), smooth).convert("RGB")
    pen = ImageDraw.Draw(done)
    for name, end in zip(("start", "goal"), ends, strict=False):
        ((x, y),) = (in_blocks(geometry, frame.step, np.array([end])) * (zoom / _FINE)).tolist()
        left = min(x + 10, done.width - font.getlength(name) - 4)
        pen.text((left, y - 7), name, INK_COLOUR, font, stroke_width=3, stroke_fill=ROUTE_CASING_COLOUR)
    return done


def as_json(geometry: GridGeometry, frames: Sequence[Frame], ends: Sequence[Position]) -> dict[str, Any]:
    """Return what the page draws: each arc once, which one every frame shows, and start and goal; nothing without arcs.

    Points are pairs of 16-bit numbers, sixteenths of a block to the right and down.
    """
    if all(frame.arc is None for frame in frames):
        return {}
    step = frames[0].step
    lines: list[str] = []
    shown: list[int] = []
    last = None
    for frame in frames:
        arc = np.empty((0, 2)) if frame.arc is None else frame.arc
        if last is None or not np.array_equal(arc, last):
            lines.append(_packed(in_blocks(geometry, step, arc)))
            last = arc
        shown.append(len(lines) - 1)
    places = [_packed(in_blocks(geometry, step, np.array([end]))) for end in ends]
    return {
        "arcs": lines,
        "shown": shown,
        "routes": [frame.is_route for frame in frames],
        "ends": places,
        "fading": FADING,
        "laid": LAID_COLOUR,
        "route": ROUTE_COLOUR,
    }


def _packed(xy: NDArray[np.float64]) -> str:
    sixteenths = np.clip(np.rint(xy * 16), 0, 2**16 - 1).astype("<u2")
    return base64.b64encode(sixteenths.tobytes()).decode("ascii")
