"""A robot whose map changes, as a GIF: what a repair of its route looks at, beside what a fresh plan looks at.

Equal costs and patches give equal bytes.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from swathe.errors import InvalidParameterError
from swathe.planner import Path as Way
from swathe.planner import Replanner
from swathe.report.animation import _fitted, _font
from swathe.report.output import replacing
from swathe.report.palette import INK_COLOUR

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray
    from PIL import Image

    from swathe.grid import Cell

_PANEL_PX = 420
_EDGE_PX, _GAP_PX, _HEAD_PX, _FOOT_PX = 16, 20, 88, 74
_PAPER, _FAINT = (246, 246, 243), (98, 104, 115)
_WAY, _DRIVEN, _OLD = (36, 56, 194), (35, 38, 43), (150, 152, 160)
_LOOKED_AT = (16, 150, 140)
_CLOSED = (92, 34, 50)
_EDGES = {"dearer": (214, 110, 20), "cheaper": (60, 130, 40), "closed": _CLOSED}
_STEP_MS, _CHANGE_MS, _ANSWER_MS, _LAST_MS = 120, 700, 1600, 2600
_CELLS_PER_FRAME = 5


@dataclass(frozen=True, slots=True)
class Patch:
    """A square of changed cells that appears when the robot has gone on.

    Attributes:
        after_cells: how many cells of its way the robot drives before.
        ahead_cells: how far ahead on the way the middle of the square lies.
        side_cells: side of the square.
        kind: ``dearer`` (four times the cost), ``cheaper`` (a third, but no cheaper than the cheapest
            cell there is) or ``closed``.
    """

    after_cells: int
    ahead_cells: int
    side_cells: int
    kind: Literal["dearer", "cheaper", "closed"]


@dataclass(frozen=True, eq=False)
class _Scene:
    """What one frame shows."""

    costs: NDArray[np.float64]
    ahead: Sequence[Cell]
    driven: Sequence[Cell]
    squares: Sequence[tuple[slice, slice, str]]
    looked_at: tuple[NDArray[np.bool_], NDArray[np.bool_]]
    fade: float
    counts: tuple[str, str]
    words: str
    time_ms: int


def write_repair_gif(
    path: Path | str,
    costs: NDArray[np.float64],
    start: tuple[int, int],
    goal: tuple[int, int],
    patches: Sequence[Patch],
    *,
    neighbours: int = 8,
) -> None:
    """Drive a robot over costs per metre on which patches appear, and write the two searches as an animated GIF.

    On the left the cells that the repair expands, on the right those of a fresh plan from the same place on the same
    costs; both costs are equal. The drive ends at the goal, or where a patch leaves no way.

    Raises:
        UsageError: there is no way at first, or a cost or a cell is not usable.
        OutputError: the file cannot be written.
    """
    from PIL import Image

    scenes = _drive(np.array(costs, dtype=np.float64), start, goal, patches, neighbours)
    pictures = [_sheet(scene, goal) for scene in scenes]
    sample = Image.new("RGB", (pictures[0].width, pictures[0].height * 3))
    for place, picture in enumerate((pictures[0], pictures[len(pictures) // 2], pictures[-1])):
        sample.paste(picture, (0, place * picture.height))
    mixed = sample.quantize(150, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).getpalette() or []
    # What few pixels of these three show is kept as it is: the key, and ground that has become dearer.
    greys = [(grey, grey, grey) for grey in range(120, 244, 6)]
    kept = [_PAPER, _FAINT, _WAY, _DRIVEN, _LOOKED_AT, *_EDGES.values(), *greys]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*itertools.chain.from_iterable(kept), *mixed[: 3 * 150]])
    indexed = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    times = [scene.time_ms for scene in scenes]
    with replacing(path) as stream:
        indexed[0].save(
            stream, format="GIF", save_all=True, append_images=indexed[1:], duration=times, loop=0, optimize=False
        )


class _Drive:
    """A drive over changing cells, and the frames that show it."""

    def __init__(
        self, costs: NDArray[np.float64], start: tuple[int, int], goal: tuple[int, int], neighbours: int
    ) -> None:
        self.costs, self.goal, self.neighbours = costs, goal, neighbours
        self.replanner = Replanner(costs, start, goal, neighbours=neighbours, keep_expanded=True)
        way = self.replanner.path()
        if not isinstance(way, Way):
            raise InvalidParameterError(way.reason, "Choose a start and a goal that are connected.")
        self.ahead = way.cells
        self.driven = [way.cells[0]]
        self.squares: list[tuple[slice, slice, str]] = []
        self.looked_at = (_mask(costs.shape, self.replanner.expanded),) * 2
        self.sums = np.full(2, len(self.replanner.expanded))
        self.counts = (f"{self.sums[0]:,} cells",) * 2
        self.words = "The first plan is the same for both."
        self.scenes: list[_Scene] = []
        self.show(_ANSWER_MS, fade=1.0)

    def show(self, time_ms: int, *, fade: float) -> None:
        """Add a frame; ``fade`` is how strongly the cells that the searches expanded are shown, 0 to 1."""
        self.scenes.append(
            _Scene(
                self.costs.copy(), self.ahead, self.driven[:], self.squares[:], self.looked_at, fade, self.counts,
                self.words, time_ms,
            )
        )  # fmt: skip

    def go_on(self, cells: int) -> None:
        """Drive a number of cells, or to the goal."""
        for place in range(1, min(cells, len(self.ahead) - 1) + 1):
            self.driven.append(self.ahead[1])
            self.ahead = self.ahead[1:]
            if place % _CELLS_PER_FRAME == 0:
                self.show(_STEP_MS, fade=max(0.0, 1 - place / 15))

    def change(self, patch: Patch) -> bool:
        """Let a patch appear and plan on both sides; returns whether a way is left."""
        self.replanner.move_to(self.ahead[0])
        middle = self.ahead[min(patch.ahead_cells, len(self.ahead) - 1)]
        rows, columns = _square(middle, patch.side_cells, self.costs.shape)
        values = _changed(self.costs[rows, columns], patch.kind, float(np.nanmin(self.costs)))
        _keep_open(values, rows, columns, (self.ahead[0], self.goal), self.costs)
        self.costs[rows, columns] = values
        self.squares.append((rows, columns, patch.kind))
        self.words = f"Cells become {patch.kind}."
        self.show(_CHANGE_MS, fade=0.0)
        self.replanner.update(rows, columns, values)
        found = self.replanner.path()
        fresh = Replanner(self.costs, self.ahead[0], self.goal, neighbours=self.neighbours, keep_expanded=True)
        again = fresh.path()
        both = [self.replanner.expanded, fresh.expanded]
        self.looked_at = (_mask(self.costs.shape, both[0]), _mask(self.costs.shape, both[1]))
        latest = np.array([len(cells) for cells in both])
        self.sums = self.sums + latest
        self.counts = (
            f"{latest[0]:,} cells, {self.sums[0]:,} in all",
            f"{latest[1]:,} cells, {self.sums[1]:,} in all",
        )
        if not isinstance(found, Way) or not isinstance(again, Way):
            self.words, self.ahead = "No way is left.", self.ahead[:1]
            self.show(_LAST_MS, fade=1.0)
            return False
        self.ahead = found.cells
        same = "equal cost" if found.cost == again.cost else f"costs {found.cost!r} and {again.cost!r}"
        fewer = f"{latest[1] / max(1, latest[0]):,.0f} times fewer cells expanded"
        how = "given up for a fresh plan" if self.replanner.tally.afresh else fewer
        self.words = f"Cells became {patch.kind}: {same}, {how}."
        self.show(_ANSWER_MS, fade=1.0)
        return True


def _drive(
    costs: NDArray[np.float64], start: tuple[int, int], goal: tuple[int, int], patches: Sequence[Patch], neighbours: int
) -> list[_Scene]:
    """Return the frames of a drive."""
    drive = _Drive(costs, start, goal, neighbours)
    for patch in patches:
        drive.go_on(patch.after_cells)
        if len(drive.ahead) == 1:
            break
        if not drive.change(patch):
            return drive.scenes
    drive.go_on(len(drive.ahead))
    drive.words = f"At the goal. Cells expanded in all: {drive.sums[0]:,} repaired, {drive.sums[1]:,} planned afresh."
    drive.show(_LAST_MS, fade=0.0)
    return drive.scenes


def _mask(shape: tuple[int, ...], cells: NDArray[np.uint32]) -> NDArray[np.bool_]:
    mask = np.zeros(shape, dtype=np.bool_)
    mask[cells[:, 0], cells[:, 1]] = True
    return mask


def _square(middle: Cell, side: int, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return the rows and columns of a square that lies inside."""
    spans = []
    for at, size in zip(middle, shape, strict=True):
        low = min(max(0, at - side // 2), max(0, size - side))
        spans.append(slice(low, min(size, low + side)))
    return spans[0], spans[1]


def _changed(values: NDArray[np.float64], kind: str, cheapest: float) -> NDArray[np.float64]:
    if kind == "closed":
        return np.full_like(values, np.inf)
    return values * 4 if kind == "dearer" else np.maximum(values / 3, cheapest)


def _keep_open(
    values: NDArray[np.float64],
    rows: slice,
    columns: slice,
    cells: Sequence[tuple[int, int]],
    costs: NDArray[np.float64],
) -> None:
    """Leave the robot and the goal the cells that they stand on."""
    for row, column in cells:
        if rows.start <= row < rows.stop and columns.start <= column < columns.stop:
            values[row - rows.start, column - columns.start] = costs[row, column]


def _sheet(scene: _Scene, goal: tuple[int, int]) -> Image.Image:
    """Return the picture of one frame: heading, both panels with their counts, words and key."""
    from PIL import Image, ImageDraw

    panels = [_panel(scene, looked_at, goal) for looked_at in scene.looked_at]
    width, height = panels[0].size
    sheet = Image.new("RGB", (2 * width + _GAP_PX + 2 * _EDGE_PX, height + _HEAD_PX + _FOOT_PX), _PAPER)
    pen = ImageDraw.Draw(sheet)
    room = sheet.width - 2 * _EDGE_PX
    title = "A route repaired while the map changes"
    pen.text((_EDGE_PX, 10), _fitted(title, _font(18, bold=True), room), INK_COLOUR, _font(18, bold=True))
    pen.text((_EDGE_PX, 36), _fitted(scene.words, _font(13), room), _FAINT, _font(13))
    for number, (name, panel) in enumerate(zip(("repaired", "planned afresh"), panels, strict=True)):
        x = _EDGE_PX + number * (width + _GAP_PX)
        pen.text((x, 64), name, INK_COLOUR, _font(13, bold=True))
        count = scene.counts[number]
        pen.text((x + width - _font(13).getlength(count), 64), count, INK_COLOUR, _font(13))
        sheet.paste(panel, (x, _HEAD_PX))
    below = _HEAD_PX + height + 12
    left = float(_EDGE_PX)
    for colour, name in (
        (_LOOKED_AT, "expanded by the search"),
        (_WAY, "way ahead"),
        (_DRIVEN, "driven"),
        *((colour, f"became {kind}") for kind, colour in _EDGES.items()),
    ):
        pen.rectangle((left, below + 3, left + 14, below + 14), fill=colour)
        pen.text((left + 20, below), name, _FAINT, _font(12))
        left += 40 + _font(12).getlength(name)
    note = "Pale ground is cheap, dark ground is dear. Both searches are D* Lite from the goal towards the robot."
    pen.text((_EDGE_PX, below + 26), _fitted(note, _font(12), room), _FAINT, _font(12))
    return sheet


def _panel(scene: _Scene, looked_at: NDArray[np.bool_], goal: tuple[int, int]) -> Image.Image:
    """Return the ground with what a search expanded, the changed squares, the way and the robot."""
    from PIL import Image, ImageDraw

    rows, columns = scene.costs.shape
    zoom = _PANEL_PX / max(rows, columns)
    size = (max(1, round(columns * zoom)), max(1, round(rows * zoom)))
    open_ = np.isfinite(scene.costs)
    dear = np.log1p(np.where(open_, scene.costs, 0.0))
    grey = 242 - 112 * np.clip(dear / np.log1p(16.0), 0, 1)
    colours = np.repeat(grey[:, :, None], 3, axis=2)
    share = 0.55 * scene.fade
    colours[looked_at] = (1 - share) * colours[looked_at] + share * np.array(_LOOKED_AT)
    colours[~open_] = _CLOSED
    # Drawn at twice the size and halved, so that lines are smooth.
    double = (2 * size[0], 2 * size[1])
    picture = Image.fromarray(colours.astype(np.uint8), mode="RGB").resize(double, Image.Resampling.NEAREST)
    pen = ImageDraw.Draw(picture)

    def at(cell: tuple[int, int]) -> tuple[float, float]:
        return (cell[1] + 0.5) * 2 * zoom, (cell[0] + 0.5) * 2 * zoom

    for across, along, kind in scene.squares:
        west, north, east, south = (2 * zoom * edge for edge in (along.start, across.start, along.stop, across.stop))
        pen.rectangle((west, north, east - 1, south - 1), outline=_EDGES[kind], width=4)
    for cells, colour in ((scene.driven, _DRIVEN), (scene.ahead, _WAY)):
        if len(cells) > 1:
            pen.line([at(cell) for cell in cells], fill=colour, width=6, joint="curve")
    x, y = at(goal)
    pen.ellipse((x - 11, y - 11, x + 11, y + 11), fill=(255, 255, 255), outline=_WAY, width=5)
    x, y = at(scene.driven[-1])
    pen.ellipse((x - 13, y - 13, x + 13, y + 13), fill=_DRIVEN, outline=(255, 255, 255), width=4)
    return picture.resize(size, Image.Resampling.LANCZOS)
