"""The picture of what overlapping grids gain: how often gaps of one to two navigation cells are found.

Importing this module is quick; matplotlib is loaded by the first drawing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from swathe.errors import InvalidParameterError
from swathe.nest import DIAGONAL_PHASES, HALF_PHASES, GridMode, gap_share, gaps_found

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Literal


class Setting(NamedTuple):
    """One set of grids in the picture: its name, its phases and how they combine."""

    name: str
    phases: tuple[tuple[float, float], ...]
    mode: GridMode


#: From the most cautious to the one that finds most.
SETTINGS = (
    Setting("both of two grids, a quarter cell apart", DIAGONAL_PHASES, "and"),
    Setting("one grid", DIAGONAL_PHASES, "single"),
    Setting("either of two grids, a quarter cell apart", DIAGONAL_PHASES, "or"),
    Setting("any of four grids, half a cell apart", HALF_PHASES, "or"),
    Setting("any of all sixteen quarter phases", DIAGONAL_PHASES, "exact16"),
)

#: Sides of the gaps that are counted, in navigation cells.
SIDES_IN_CELLS = tuple(1 + step / 8 for step in range(9))
_STEPS = 120


class Gain(NamedTuple):
    """How one setting does: counted shares at ``SIDES_IN_CELLS``, and the exact curve through them."""

    setting: Setting
    counted: tuple[float, ...]
    exact_sides: tuple[float, ...]
    exact: tuple[float, ...]


def gap_gains(shape: Literal["corridor", "pocket"], *, trials: int = 1000, seed: int = 0) -> list[Gain]:
    """Count and compute for each setting what share of gaps it finds.

    Raises:
        InvalidParameterError: ``trials`` or ``seed`` is outside its range.
    """
    sides = tuple(1 + step / _STEPS for step in range(_STEPS + 1))
    return [
        Gain(
            setting,
            tuple(
                gaps_found(shape, side, mode=setting.mode, phases=setting.phases, trials=trials, seed=seed) / trials
                for side in SIDES_IN_CELLS
            ),
            sides,
            tuple(gap_share(shape, side, mode=setting.mode, phases=setting.phases) for side in sides),
        )
        for setting in SETTINGS
    ]


def draw_gap_gain(
    path: Path | str, *, trials: int = 1000, seed: int = 0, metadata: Mapping[str, str] | None = None
) -> None:
    """Draw as PNG at ``path`` how often gaps are found; equal input gives equal bytes.

    Corridors stand on the left, pockets on the right. Marks are counts on drawn ground, lines the exact shares.

    Args:
        path: the file to write.
        trials: gaps drawn for each mark, 1 to 1,000,000.
        seed: seed of their places.
        metadata: text entries of the PNG.

    Raises:
        InvalidParameterError: ``trials`` or ``seed`` is outside its range.
        OutputError: the file cannot be written.
    """
    if trials < 1:
        raise InvalidParameterError(f"The number of trials of {trials} is not usable.", "Give 1 or more.")
    from swathe.report.grids_sheet import draw_sheet

    gains = {shape: gap_gains(shape, trials=trials, seed=seed) for shape in ("corridor", "pocket")}
    draw_sheet(path, gains["corridor"], gains["pocket"], trials, metadata or {})
