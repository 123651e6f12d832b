"""A swarm at work, as a GIF and as one HTML page that plays without anything else.

Both show the same pictures: grey relief below, on it what the agents have looked at, their pellets, the nests in
colours of their own, the agents as dots, and for a planner's swarm the arc. Equal frames give equal bytes.
"""

from __future__ import annotations

import base64
import hashlib
import html
import io
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from swathe.errors import InvalidParameterError
from swathe.report import arcs
from swathe.report.output import replacing
from swathe.report.palette import INK_COLOUR, ROUTE_COLOUR
from swathe.swarm import run_swarm

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from PIL import Image, ImageFont

    from swathe.grid import GridGeometry, Position
    from swathe.planner import Plan
    from swathe.rank import Region
    from swathe.swarm import Frame, SwarmParams

#: Blocks per side above which frames are taken coarser.
MOST_BLOCKS = 400

#: Frames of a planner's animation.
MOST_FRAMES = 72

_LONG_SIDE_PX = 640
_HEAD_PX, _FOOT_PX, _EDGE_PX = 58, 58, 14
_FRAME_MS, _LAST_MS = 110, 2600

#: Ground that is shown around where something happens, in blocks and as a share of that.
_LEAST_MARGIN, _MARGIN_SHARE = 6, 0.06
_PAPER = (246, 246, 243)
_FAINT = (98, 104, 115)

# Overlay codes: outside the swathe, not looked at, not suitable, suitable, pellet, then nests.
_OUTSIDE, _UNSEEN, _UNSUITABLE, _SUITABLE, _PELLET, _FIRST_NEST = range(6)
_OVERLAY: tuple[tuple[int, int, int, int], ...] = (
    (246, 246, 243, 190),
    (0, 0, 0, 0),
    (106, 40, 58, 175),
    (236, 202, 134, 215),
    (222, 130, 40, 235),
    (23, 112, 106, 225),
    (60, 146, 190, 225),
    (120, 170, 70, 225),
    (120, 96, 176, 225),
    (40, 150, 120, 225),
    (86, 120, 200, 225),
    (160, 176, 60, 225),
    (150, 100, 160, 225),
    (70, 170, 170, 225),
)
_NEST_COLOURS = len(_OVERLAY) - _FIRST_NEST
_LEGEND = (
    (_UNSUITABLE, "not suitable"),
    (_SUITABLE, "suitable"),
    (_PELLET, "pellet"),
    (_FIRST_NEST, "nest (a colour each)"),
)


@dataclass(frozen=True, eq=False)
class Film:
    """What an animation shows: the ground, frames of one swarm on it from first to last, and start and goal if any.

    ``map_cells`` are the cells of the whole map where the ground shown is a part of it.
    """

    geometry: GridGeometry
    elevation_m: NDArray[np.float32]
    frames: Sequence[Frame]
    title: str
    subtitle: str
    ends: tuple[Position, ...] = ()
    map_cells: int | None = None

    def __post_init__(self) -> None:
        if not self.frames:
            raise InvalidParameterError("An animation without frames shows nothing.", "Give at least one frame.")

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the ground in pixels."""
        rows, columns = self.frames[0].seen.shape
        zoom = _LONG_SIDE_PX / max(rows, columns)
        return max(1, round(columns * zoom)), max(1, round(rows * zoom))


def animate(
    folder: Path,
    region: Region,
    params: SwarmParams,
    inside: NDArray[np.bool_] | None,
    *,
    ticks: int | None,
    source: str,
) -> None:
    """Run a swarm again, which gives the same swarm, and write ``animation.gif`` and ``animation.html`` into a folder.

    ``ticks`` is how long it runs, None until it is finished; ``source`` names the elevation.

    Raises:
        OutputError: a file cannot be written.
    """
    last = run_swarm(region, params, inside=inside).tally.ticks if ticks is None else ticks
    frames: list[Frame] = []
    run_swarm(
        region,
        params,
        inside=inside,
        ticks=last,
        on_frame=frames.append,
        frame_every=frame_ticks(last),
        frame_step=frame_step(region.geometry),
    )
    title = f"{params.agents:,} termites look for ground that the {region.vehicle.name} can cross"
    film = Film(region.geometry, region.elevation_m, frames, title, _subtitle(region, params, source))
    write_gif(folder / "animation.gif", film)
    write_page(folder / "animation.html", film)


def animate_plan(
    folder: Path, region: Region, params: SwarmParams, answer: Plan, ends: tuple[Position, Position], *, source: str
) -> None:
    """Write ``animation.gif`` and ``animation.html`` of a planner at work, whose answer brought frames.

    The last picture shows the route, if there is one.

    Raises:
        OutputError: a file cannot be written.
    """
    frames = list(answer.frames)
    if answer.route is not None and len(answer.route.legs):
        frames.append(replace(frames[-1], arc=answer.route.xy_m, is_route=True, agents=frames[-1].agents[:0]))
    title = f"{params.agents:,} termites look for a way for the {region.vehicle.name}"
    subtitle = _subtitle(region, params, source)
    film = _zoomed(Film(region.geometry, region.elevation_m, frames, title, subtitle, ends))
    write_gif(folder / "animation.gif", film)
    write_page(folder / "animation.html", film)


def _zoomed(film: Film) -> Film:
    """Return the film of the part of the map where something happens."""
    rows, columns = film.frames[0].seen.shape
    step = film.frames[0].step
    happens = np.zeros((rows, columns), dtype=np.bool_)
    for frame in film.frames:
        happens |= frame.seen > _UNSEEN
        points = np.empty((0, 2)) if frame.arc is None else arcs.in_blocks(film.geometry, step, frame.arc)
        points = np.concatenate([points, arcs.in_blocks(film.geometry, step, np.array(film.ends))])
        x, y = points.astype(np.int64).T
        happens[np.clip(y, 0, rows - 1), np.clip(x, 0, columns - 1)] = True
    sides = []
    for axis, count in ((1, rows), (0, columns)):
        (at,) = np.nonzero(happens.any(axis=axis))
        margin = max(_LEAST_MARGIN, round(_MARGIN_SHARE * (at[-1] - at[0])))
        sides.append((max(0, int(at[0]) - margin), min(count, int(at[-1]) + 1 + margin)))
    (top, bottom), (left, right) = sides
    part = (slice(top, bottom), slice(left, right))
    cells = tuple(slice(side.start * step, side.stop * step) for side in part)
    elevation_m = film.elevation_m[cells]
    return replace(
        film,
        geometry=film.geometry.window(top * step, left * step, *elevation_m.shape),
        elevation_m=elevation_m,
        frames=[_cut(frame, part) for frame in film.frames],
        map_cells=film.geometry.cell_count,
    )


def _cut(frame: Frame, part: tuple[slice, slice]) -> Frame:
    low = np.array([side.start for side in part])
    high = np.array([side.stop for side in part])
    agents = frame.agents.astype(np.int64)
    agents = agents[((agents >= low) & (agents < high)).all(axis=1)] - low
    return replace(
        frame,
        seen=np.ascontiguousarray(frame.seen[part]),
        pellets=np.ascontiguousarray(frame.pellets[part]),
        nests=np.ascontiguousarray(frame.nests[part]),
        agents=agents.astype(np.uint32),
    )


def _subtitle(region: Region, params: SwarmParams, source: str) -> str:
    rows, columns = region.geometry.shape
    return f"{source}: {rows} x {columns} cells of {region.geometry.cell_size_m:g} m, seed {params.seed}"


def frame_step(geometry: GridGeometry) -> int:
    """Return the cells per side of a block that keep frames of this map small."""
    return math.ceil(max(geometry.shape) / MOST_BLOCKS)


def frame_ticks(last_tick: int, count: int = 48) -> list[int]:
    """Return rising ticks up to the last one, close together at first, when most happens."""
    return sorted({round(last_tick * (number / count) ** 2.2) for number in range(1, count + 1)})


def write_gif(path: Path | str, film: Film) -> None:
    """Write the frames as an animated GIF that repeats.

    Raises:
        OutputError: the file cannot be written.
    """
    from PIL import Image, ImageColor

    base = _relief(film)
    pictures = [_sheet(film, base, number) for number in range(len(film.frames))]
    sample = Image.new("RGB", (pictures[0].width, pictures[0].height * 3))
    for place, picture in enumerate((pictures[0], pictures[len(pictures) // 2], pictures[-1])):
        sample.paste(picture, (0, place * picture.height))
    mixed = sample.quantize(120, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).getpalette() or []
    # The colours of the key are kept as they are, however few pixels have them.
    key = [channel for code, _ in _LEGEND for channel in _OVERLAY[code][:3]]
    lines = [channel for colour in _line_colours(film) for channel in ImageColor.getrgb(colour)[:3]]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*key, *lines, *_PAPER, *mixed[: 3 * 120]])
    indexed = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    times = [_FRAME_MS] * (len(indexed) - 1) + [_LAST_MS]
    with replacing(path) as stream:
        indexed[0].save(
            stream, format="GIF", save_all=True, append_images=indexed[1:], duration=times, loop=0, optimize=False
        )


def write_page(path: Path | str, film: Film) -> None:
    """Write the frames as one HTML page with play, pause and a slider; nothing is loaded from anywhere.

    Raises:
        OutputError: the file cannot be written.
    """
    here = Path(__file__).parent
    style = (here / "animation.css").read_text(encoding="utf-8")
    script = (here / "animation.js").read_text(encoding="utf-8")
    width, height = film.size_px
    frames = [
        {
            "picture": _data_uri(_overlay_png(frame)),
            "agents": base64.b64encode(frame.agents.astype("<u2").tobytes()).decode("ascii"),
            "words": _words(film, frame),
        }
        for frame in film.frames
    ]
    rows, columns = film.frames[0].seen.shape
    laid = arcs.as_json(film.geometry, film.frames, film.ends)
    data = json.dumps({"rows": rows, "columns": columns, "frames": frames, **laid}, separators=(",", ":"))
    legend = (
        "".join(f'<li><i class="c{code}"></i>{html.escape(name)}</li>' for code, name in _LEGEND)
        + '<li><i class="agent"></i>agent</li>'
        + "".join(f'<li><i class="line {name}"></i>{name}</li>' for name, _ in _lines(film))
        + ('<li><i class="end"></i>start</li><li><i class="end goal"></i>goal</li>' if film.ends else "")
    )
    style += "".join(
        f"\n.c{code} {{ background: rgb({red} {green} {blue}); }}"
        for code, _ in _LEGEND
        for red, green, blue, _alpha in (_OVERLAY[code],)
    )
    style += "".join(f"\n.{name} {{ background: {colour}; }}" for name, colour in _lines(film))
    last = _sheet(film, _relief(film), len(film.frames) - 1)
    policy = f"default-src 'none'; img-src data:; style-src '{_hash(style)}'; script-src '{_hash(script)}'"
    page = f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{html.escape(film.title)}</title>
<style>{style}</style>
</head>
<body>
<main>
<h1>{html.escape(film.title)}</h1>
<p class="lead">{html.escape(film.subtitle)}</p>
<figure>
<canvas id="ground" width="{width}" height="{height}" role="img" aria-label="The swarm on its ground"></canvas>
<noscript><img src="{_data_uri(_png(last))}" alt="The last state of the swarm"></noscript>
</figure>
<div class="bar">
<button id="play" type="button" aria-pressed="false">Play</button>
<input id="at" type="range" min="0" max="{len(frames) - 1}" value="0" aria-label="Frame">
<label class="box"><input id="show" type="checkbox" checked> agents</label>
</div>
<p id="words" class="words" aria-live="off"></p>
<ul class="legend">{legend}</ul>
<p class="lead">Space plays and pauses, the arrow keys go frame by frame.</p>
<img id="base" src="{_data_uri(_png(_relief(film)))}" alt="" hidden>
<script id="film" type="application/json">{data}</script>
</main>
<script>{script}</script>
</body>
</html>
"""
    with replacing(path) as stream:
        stream.write(page.encode("utf-8"))


def _lines(film: Film) -> list[tuple[str, str]]:
    """Return the name and colour of every kind of line that the frames show."""
    kinds = {frame.is_route for frame in film.frames if frame.arc is not None}
    names = ((False, "arc", arcs.LAID_COLOUR), (True, "route", ROUTE_COLOUR))
    return [(name, colour) for is_route, name, colour in names if is_route in kinds]


def _line_colours(film: Film) -> list[str]:
    return [colour for _, colour in _lines(film)]


def _words(film: Film, frame: Frame) -> str:
    """Return what a frame has come to, in words."""
    tally = frame.tally
    share = tally.cells_evaluated / (film.map_cells or film.geometry.cell_count)
    nests = len(np.unique(frame.nests[frame.nests > 0]))
    return (
        f"tick {tally.ticks:,} \N{MIDDLE DOT} {tally.visits:,} visits \N{MIDDLE DOT} {share:.1%} of the map looked at "
        f"\N{MIDDLE DOT} {tally.cores:,} cores \N{MIDDLE DOT} {nests:,} nests"
    )


def _codes(frame: Frame) -> NDArray[np.uint8]:
    """Return the overlay's code of every block."""
    codes = frame.seen.astype(np.uint8)
    codes[(codes == _SUITABLE) & (frame.pellets > 0)] = _PELLET
    nests = frame.nests > 0
    # Knuth's multiplicative hash gives neighbours in number colours that are far apart.
    names = (frame.nests[nests].astype(np.uint64) * np.uint64(2_654_435_761)) >> np.uint64(7)
    codes[nests] = _FIRST_NEST + (names % np.uint64(_NEST_COLOURS)).astype(np.uint8)
    return codes


def _overlay_png(frame: Frame) -> bytes:
    from PIL import Image

    picture = Image.fromarray(_codes(frame), mode="P")
    picture.putpalette([channel for colour in _OVERLAY for channel in colour[:3]])
    stream = io.BytesIO()
    picture.save(stream, format="PNG", transparency=bytes(colour[3] for colour in _OVERLAY), optimize=True)
    return stream.getvalue()


def _relief(film: Film) -> Image.Image:
    """Return the ground as a pale grey relief."""
    from PIL import Image

    from swathe.report.palette import BEST_RANK
    from swathe.report.relief import draw_relief

    width, height = film.size_px
    level = np.full(film.geometry.shape, BEST_RANK, dtype=np.uint8)
    shaded, _, _ = draw_relief(
        level, film.elevation_m, None, cell_size_m=film.geometry.cell_size_m, target_shape=(height, width)
    )
    grey = shaded.astype(np.float32).mean(axis=2)
    grey = np.clip(36 + grey * (176 / 221), 0, 250).astype(np.uint8)
    return Image.fromarray(grey, mode="L").convert("RGB").resize((width, height), Image.Resampling.BILINEAR)


def _sheet(film: Film, base: Image.Image, number: int) -> Image.Image:
    """Return one picture of the GIF: heading, ground, words and key."""
    from PIL import Image, ImageDraw

    frame = film.frames[number]
    width, height = base.size
    sheet = Image.new(
        "RGB", (max(width, 640 if film.ends else 560) + 2 * _EDGE_PX, height + _HEAD_PX + _FOOT_PX), _PAPER
    )
    colours = np.array(_OVERLAY, dtype=np.uint8)[_codes(frame)]
    overlay = Image.fromarray(colours, mode="RGBA").resize((width, height), Image.Resampling.NEAREST)
    ground = Image.alpha_composite(base.convert("RGBA"), overlay).convert("RGB")
    pen = ImageDraw.Draw(ground)
    zoom = width / frame.seen.shape[1]
    for row, column in frame.agents.tolist():
        x, y = (column + 0.5) * zoom, (row + 0.5) * zoom
        pen.ellipse((x - 1.2, y - 1.2, x + 1.2, y + 1.2), fill=INK_COLOUR)
    if frame.arc is not None:
        ground = arcs.draw(ground, film.geometry, film.frames, number, ends=film.ends, font=_font(12, bold=True))
    sheet.paste(ground, (_EDGE_PX, _HEAD_PX))
    pen = ImageDraw.Draw(sheet)
    room = sheet.width - 2 * _EDGE_PX
    pen.text((_EDGE_PX, 10), _fitted(film.title, _font(18, bold=True), room), INK_COLOUR, _font(18, bold=True))
    pen.text((_EDGE_PX, 35), _fitted(film.subtitle, _font(12), room), _FAINT, _font(12))
    below = _HEAD_PX + height + 8
    pen.text((_EDGE_PX, below), _fitted(_words(film, frame), _font(12), room), INK_COLOUR, _font(12))
    x = float(_EDGE_PX)
    for code, name in _LEGEND:
        pen.rectangle((x, below + 25, x + 14, below + 36), fill=_OVERLAY[code][:3])
        pen.text((x + 20, below + 22), name, _FAINT, _font(12))
        x += 38 + _font(12).getlength(name)
    pen.ellipse((x + 4, below + 28, x + 9, below + 33), fill=INK_COLOUR)
    pen.text((x + 16, below + 22), "agent", _FAINT, _font(12))
    x += 34 + _font(12).getlength("agent")
    for name, colour in _lines(film):
        pen.line((x, below + 30, x + 16, below + 30), fill=colour, width=3)
        pen.text((x + 22, below + 22), name, _FAINT, _font(12))
        x += 40 + _font(12).getlength(name)
    return sheet


def _fitted(text: str, font: ImageFont.FreeTypeFont, room_px: float) -> str:
    """Return a text shortened to the room it has."""
    if font.getlength(text) <= room_px:
        return text
    while text and font.getlength(text + " …") > room_px:
        text = text[:-1]
    return text.rstrip() + " …"


def _font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return the font that the other pictures have too; matplotlib brings it."""
    import matplotlib as mpl
    from PIL import ImageFont

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(mpl.get_data_path()) / "fonts" / "ttf" / name), size)


def _png(picture: Image.Image) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, format="PNG", optimize=True)
    return stream.getvalue()


def _data_uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
