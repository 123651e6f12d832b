"""What every picture shares: a figure measured in inches, plain text, and deterministic PNG output.

Figures are drawn on the Agg canvas without pyplot and with matplotlib's own defaults, so that a user's matplotlibrc
changes nothing and the same input gives the same bytes.
"""

from __future__ import annotations

import textwrap
import warnings
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from swathe.report.output import replacing
from swathe.report.palette import FAINT_INK_COLOUR, INK_COLOUR

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.text import Text

DPI = 150
POINTS_PER_INCH = 72
_STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.edgecolor": FAINT_INK_COLOUR,
    "axes.labelcolor": FAINT_INK_COLOUR,
    "axes.linewidth": 0.6,
    "xtick.color": FAINT_INK_COLOUR,
    "ytick.color": FAINT_INK_COLOUR,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "text.color": INK_COLOUR,
    "text.parse_math": False,
    "path.simplify": True,
}


@contextmanager
def drawing(width_in: float, height_in: float) -> Iterator[Figure]:
    """Give a new white figure whose content is drawn with the report's style and no one else's."""
    with warnings.catch_warnings(), mpl.rc_context():
        # A place name in a script that the font lacks is drawn as boxes; that must not stop a plan.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)  # type: ignore[arg-type]  # the stub wants every key as a literal
        figure = Figure(figsize=(width_in, height_in), dpi=DPI, facecolor="white")
        FigureCanvasAgg(figure)
        yield figure


def save(figure: Figure, path: Path | str, metadata: Mapping[str, str]) -> None:
    """Write ``figure`` as PNG in one step; ``metadata`` becomes its text entries.

    Raises:
        OutputError: the file cannot be written.
    """
    # matplotlib would write its own version as the software; the key is fixed so that equal pictures have equal bytes.
    entries = {_keyword(key): _one_line(value) for key, value in metadata.items()} | {"Software": "Swathe"}
    with replacing(path) as stream:
        figure.savefig(stream, format="png", dpi=DPI, metadata=entries)


def add_axes_in(figure: Figure, left_in: float, bottom_in: float, width_in: float, height_in: float) -> Axes:
    """Add axes whose place and size are given in inches from the figure's lower left corner."""
    whole_width, whole_height = figure.get_size_inches()
    return figure.add_axes(
        (left_in / whole_width, bottom_in / whole_height, width_in / whole_width, height_in / whole_height)
    )


def add_heading(figure: Figure, left_in: float, title: str, subtitle: str) -> None:
    """Write the title and the line under it at the top of the figure, wrapped to its width."""
    width_in, height_in = (float(side) for side in figure.get_size_inches())
    title_lines = wrapped(title, (width_in - left_in) * 9.6, 2)
    figure.text(
        left_in / width_in, 1 - 0.16 / height_in, title_lines, fontsize=13, fontweight="bold", va="top", linespacing=1.2
    )
    below = 0.44 + 0.21 * title_lines.count("\n")
    figure.text(
        left_in / width_in,
        1 - below / height_in,
        wrapped(subtitle, (width_in - left_in) * 15, 2),
        fontsize=9,
        color=FAINT_INK_COLOUR,
        va="top",
        linespacing=1.25,
    )


def heading_height_in(width_in: float, left_in: float, title: str, subtitle: str) -> float:
    """Return the height that ``add_heading`` needs, in inches."""
    title_lines = wrapped(title, (width_in - left_in) * 9.6, 2).count("\n") + 1
    subtitle_lines = wrapped(subtitle, (width_in - left_in) * 15, 2).count("\n") + 1 if subtitle.strip() else 0
    return 0.28 + 0.21 * title_lines + 0.17 * subtitle_lines


def wrapped(text: str, characters: float, max_lines: int) -> str:
    """Return ``text`` in at most ``max_lines`` lines of about ``characters`` each, shortened where it is longer."""
    return "\n".join(textwrap.wrap(_one_line(text), max(int(characters), 8), max_lines=max_lines, placeholder=" …"))


def with_halo(text: Text, width_pt: float = 2.5) -> Text:
    """Put a light edge around the letters so that they can be read on any ground."""
    text.set_path_effects([withStroke(linewidth=width_pt, foreground="white", alpha=0.9)])
    return text


def _one_line(text: str) -> str:
    return " ".join("".join(sign if sign.isprintable() else " " for sign in str(text)).split())


def _keyword(key: str) -> str:
    """Return a valid PNG keyword: 1 to 79 Latin-1 signs."""
    plain = _one_line(key).encode("ascii", "replace").decode("ascii")
    return plain[:79].strip() or "Comment"
