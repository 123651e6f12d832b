"""Drawn numbers: Philox4x32-10, as in the core (Salmon et al., SC 2011)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from swathe import _core

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def uniform(seed: int, stream: int, count: int) -> NDArray[np.float64]:
    """Return so many numbers from 0 to below 1.

    ``seed`` is from 0 to 2^64 - 1, ``stream`` from 0 to 2^32 - 1; every draw depends on seed, stream and its own number
    alone, so that a longer draw begins with a shorter one.
    """
    drawn: NDArray[np.float64] = _core.uniform(seed, stream, count)
    return drawn
