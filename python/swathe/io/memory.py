"""How much memory the machine can give, and refusing what would need more."""

from __future__ import annotations

import math
import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from swathe.errors import InvalidParameterError, TooLargeError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swathe.grid import Window

#: Bytes per cell of a plan with its maps: heights 4, soil 1, planning 16, nests, ranks and pictures for the report.
BYTES_PER_CELL = 40

#: Share of the free memory that a plan may take.
_SHARE = 0.8

_CGROUP_LIMITS = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"))


def available_bytes() -> int:
    """Return the memory that can still be taken: what the system says is free, and no more than a container's limit."""
    candidates = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    with suppress(OSError, ValueError):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        candidates += [int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")]
    for path in _CGROUP_LIMITS:
        with suppress(OSError, ValueError):  # no such limit, or the word "max"
            candidates.append(int(path.read_text(encoding="ascii")))
    return min(candidates)


def require_memory(window: Window, cell_size_m: float, names: Sequence[str], limit_bytes: int | None) -> None:
    """Raise TooLargeError when a window of cells needs more memory than there is, saying what would fit."""
    allowed = int(_SHARE * available_bytes()) if limit_bytes is None else limit_bytes
    cells = window.rows * window.columns
    needed = cells * BYTES_PER_CELL
    if needed <= allowed and cells < 2**32 - 1:
        return
    fits = min(allowed / BYTES_PER_CELL, 2.0**32 - 2)
    coarser_m = cell_size_m * (cells / max(fits, 1.0)) ** 0.5
    side_km = max(fits, 1.0) ** 0.5 * cell_size_m / 1000
    raise TooLargeError(
        f"{', '.join(names)}: {window.rows:,} x {window.columns:,} cells would need about {_shown(needed)}; "
        f"{_shown(allowed)} can be used.",
        f"Choose a window of up to {side_km:,.1f} km a side with `--bounds`, or coarser cells with "
        f"`--cell-size {_rounded_up(coarser_m):g}`.",
    )


def limit_of(gigabytes: float) -> int:
    """Return a limit in bytes.

    Raises:
        InvalidParameterError: it is not above zero and finite.
    """
    if not 0 < gigabytes < math.inf:
        raise InvalidParameterError(
            f"A limit of {gigabytes:g} GB is no limit.", "Give `--memory-limit` in GB, above zero."
        )
    return int(gigabytes * 1e9)


def _shown(count: float) -> str:
    return f"{count / 1e9:,.1f} GB" if count >= 1e9 else f"{count / 1e6:,.3g} MB"


def _rounded_up(length_m: float) -> float:
    """Return a length rounded up to two digits."""
    digits = 10.0 ** (len(f"{length_m:.0f}") - 2) if length_m >= 10 else 0.1
    return float(-(-length_m // digits) * digits)
