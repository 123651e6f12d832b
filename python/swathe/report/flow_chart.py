"""Flow charts of the swarm, drawn from the core's table of transitions; only the places are set here."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, NamedTuple

from matplotlib.patches import Ellipse, FancyArrowPatch, FancyBboxPatch, Polygon
from matplotlib.path import Path

from swathe.report.figure import add_axes_in, add_heading, drawing, save
from swathe.report.palette import FAINT_INK_COLOUR, INK_COLOUR, LIMIT_COLOUR, NEST_COLOUR, ROUTE_COLOUR

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path as FilePath

    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

    from swathe.swarm import Transition

_WIDTH_IN, _TOP_IN = 8.4, 0.85
_BOX_IN = (1.95, 0.62)
_QUESTION_IN = (2.5, 1.05)


class _Way(NamedTuple):
    """How an arrow goes where it is not straight: its corners, and the middle of its words, in inches."""

    corners: tuple[tuple[float, float], ...]
    words_in: tuple[float, float]


# Chart -> state -> place of its middle in inches from the lower left corner.
_PLACES: dict[str, dict[str, tuple[float, float]]] = {
    "swarm": {
        "deploy": (1.65, 6.95),
        "forage": (6.2, 5.35),
        "look": (1.65, 5.35),
        "count": (1.65, 3.75),
        "drop": (1.65, 2.15),
        "build": (1.65, 0.6),
        "done": (6.9, 6.95),
    },
    "nest": {
        "build": (2.3, 6.6),
        "examine": (2.3, 5.15),
        "reject": (6.3, 5.15),
        "core": (2.3, 3.6),
        "join": (2.3, 1.95),
        "merge": (6.3, 1.95),
        "forage": (6.3, 3.6),
    },
}
_HEIGHT_IN = {"swarm": 7.5, "nest": 7.1}
_WAYS: dict[tuple[str, str, str], _Way] = {
    ("swarm", "forage", "deploy"): _Way(((5.5, 5.66), (5.5, 6.95), (2.8, 6.95)), (4.15, 6.95)),
    ("swarm", "forage", "done"): _Way(((6.9, 5.66), (6.9, 6.57)), (6.9, 6.12)),
    ("swarm", "forage", "forage"): _Way(((7.18, 5.48), (7.6, 5.48), (7.6, 5.22), (7.19, 5.22)), (7.75, 4.85)),
    ("swarm", "forage", "look"): _Way(((5.22, 5.5), (2.62, 5.5)), (4.1, 5.5)),
    ("swarm", "look", "forage"): _Way(((2.54, 5.2), (5.21, 5.2)), (3.4, 5.2)),
    ("swarm", "count", "forage"): _Way(((2.9, 3.75), (5.7, 3.75), (5.7, 5.03)), (3.4, 3.75)),
    ("swarm", "drop", "forage"): _Way(((2.9, 2.15), (6.2, 2.15), (6.2, 5.03)), (3.4, 2.15)),
    ("swarm", "build", "forage"): _Way(((2.63, 0.6), (6.7, 0.6), (6.7, 5.03)), (4.3, 0.6)),
    ("nest", "build", "reject"): _Way(((3.28, 6.42), (6.3, 6.42), (6.3, 5.47)), (4.8, 6.42)),
    ("nest", "examine", "examine"): _Way(((1.65, 4.89), (0.7, 4.89), (0.7, 5.41), (1.6, 5.41)), (0.8, 4.66)),
    ("nest", "build", "forage"): _Way(((3.28, 6.76), (7.75, 6.76), (7.75, 3.6), (7.29, 3.6)), (7.75, 4.4)),
    ("nest", "join", "join"): _Way(((1.65, 1.69), (0.7, 1.69), (0.7, 2.21), (1.6, 2.21)), (0.8, 1.46)),
    ("nest", "join", "forage"): _Way(((2.98, 2.19), (4.3, 2.19), (4.3, 3.45), (5.31, 3.45)), (4.3, 2.85)),
    ("nest", "merge", "join"): _Way(((6.0, 1.64), (6.0, 1.05), (2.3, 1.05), (2.3, 1.4)), (4.3, 1.05)),
    ("nest", "merge", "merge"): _Way(((7.28, 2.08), (7.7, 2.08), (7.7, 1.82), (7.29, 1.82)), (7.65, 1.5)),
}
_TITLES = {
    "swarm": ("The swarm", "What every agent does, tick by tick"),
    "nest": ("Nest building", "What happens at a focus: a cell that is full of pellets"),
}


def draw_flow_chart(
    path: FilePath | str,
    chart: str,
    transitions: Sequence[Transition],
    texts: Mapping[str, str],
    *,
    metadata: Mapping[str, str] | None = None,
) -> None:
    """Draw one chart of the table, ``swarm`` or ``nest``, as PNG.

    Raises:
        KeyError: a state of the table has no place in the chart yet.
        OutputError: the file cannot be written.
    """
    rows = [row for row in transitions if row.chart == chart]
    states = list(dict.fromkeys(state for row in rows for state in (row.from_state, row.to_state)))
    places = _PLACES[chart]
    height_in = _HEIGHT_IN[chart] + _TOP_IN
    with drawing(_WIDTH_IN, height_in) as figure:
        title, subtitle = _TITLES[chart]
        add_heading(figure, 0.35, title, subtitle)
        axes = add_axes_in(figure, 0, 0, _WIDTH_IN, height_in - _TOP_IN)
        axes.set_axis_off()
        axes.set_xlim(0, _WIDTH_IN)
        axes.set_ylim(0, _HEIGHT_IN[chart])
        shapes = {state: _state(axes, places[state], state, texts[state]) for state in states}
        for row in rows:
            way = _WAYS.get((chart, row.from_state, row.to_state))
            if way is None:
                ends = places[row.from_state], places[row.to_state]
                _straight(axes, ends, (shapes[row.from_state], shapes[row.to_state]), row.when)
            else:
                _bent(axes, way, row.when)
        save(figure, path, metadata or {})


def _is_question(text: str) -> bool:
    return text.endswith("?")


def _state(axes: Axes, middle: tuple[float, float], state: str, text: str) -> Patch:
    x_in, y_in = middle
    edge = {"reject": LIMIT_COLOUR, "core": NEST_COLOUR, "merge": NEST_COLOUR, "join": NEST_COLOUR}.get(
        state, INK_COLOUR
    )
    shape: Patch
    if _is_question(text):
        wide, high = _QUESTION_IN
        corners = [(x_in - wide / 2, y_in), (x_in, y_in + high / 2), (x_in + wide / 2, y_in), (x_in, y_in - high / 2)]
        shape = Polygon(corners, closed=True)
        characters = 20
    elif state in {"deploy", "done"}:
        shape = Ellipse(middle, _BOX_IN[0] + 0.3, _BOX_IN[1] + 0.14)
        characters = 24
    else:
        wide, high = _BOX_IN
        shape = FancyBboxPatch(
            (x_in - wide / 2 + 0.06, y_in - high / 2 + 0.06), wide - 0.12, high - 0.12, boxstyle="round,pad=0.06"
        )
        characters = 24
    face = {"reject": "#fbeeee", "core": "#e3f1ee", "merge": "#e3f1ee", "build": "#e9ecfa"}.get(state, "#f6f6f3")
    shape.set(facecolor="#fdf6e6" if _is_question(text) else face, edgecolor=edge, linewidth=1.3, zorder=3)
    axes.add_patch(shape)
    words = "\n".join(textwrap.wrap(text, characters))
    axes.text(x_in, y_in, words, ha="center", va="center", fontsize=8.5, linespacing=1.15, zorder=4)
    return shape


def _straight(
    axes: Axes, ends: tuple[tuple[float, float], tuple[float, float]], shapes: tuple[Patch, Patch], when: str
) -> None:
    arrow = FancyArrowPatch(
        ends[0], ends[1], patchA=shapes[0], patchB=shapes[1], arrowstyle="-|>", mutation_scale=13, shrinkA=1, shrinkB=2
    )
    arrow.set(linewidth=1.2, color=_colour(when), zorder=2)
    axes.add_patch(arrow)
    _words(axes, ((ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2), when)


def _bent(axes: Axes, way: _Way, when: str) -> None:
    """Draw an arrow around corners."""
    line = FancyArrowPatch(path=Path(way.corners), arrowstyle="-|>", mutation_scale=13, joinstyle="round")
    line.set(linewidth=1.2, color=_colour(when), zorder=2)
    axes.add_patch(line)
    _words(axes, way.words_in, when)


def _colour(when: str) -> str:
    first = when.partition(",")[0]
    return {"yes": NEST_COLOUR, "all are": NEST_COLOUR, "no": LIMIT_COLOUR}.get(first, ROUTE_COLOUR)


def _words(axes: Axes, middle: tuple[float, float], when: str) -> None:
    label = axes.text(*middle, "\n".join(textwrap.wrap(when, 18)), ha="center", va="center", fontsize=8, zorder=5)
    label.set(color=_colour(when) if when in {"yes", "no"} else FAINT_INK_COLOUR, linespacing=1.1)
    label.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 1.5})
