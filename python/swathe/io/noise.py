"""Smooth noise that depends on nothing but a cell's row and column, the same on every machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def smooth_noise(shape: tuple[int, int], wavelength_cells: float, first: int = 0) -> NDArray[np.float64]:
    """Return smooth noise in -1..1: hashed values on a coarse lattice, blended between its corners.

    ``first`` is the first row and column of the lattice; another one gives other noise.
    """
    row, column = (np.arange(size) / wavelength_cells for size in shape)
    start = np.uint64(first)
    top, left = np.floor(row).astype(np.uint64) + start, np.floor(column).astype(np.uint64) + start
    down, right = ((fraction - np.floor(fraction)) for fraction in (row, column))
    down, right = (part * part * (3 - 2 * part) for part in (down, right))
    one = np.uint64(1)
    corners = [[hashed(top + r, left + c) for c in (np.uint64(0), one)] for r in (np.uint64(0), one)]
    upper = corners[0][0] * (1 - right) + corners[0][1] * right
    lower = corners[1][0] * (1 - right) + corners[1][1] * right
    noise: NDArray[np.float64] = upper * (1 - down[:, None]) + lower * down[:, None]
    return noise


def hashed(rows: NDArray[np.uint64], columns: NDArray[np.uint64]) -> NDArray[np.float64]:
    """Return a value in -1..1 for every pair of a row and a column (the finaliser of SplitMix64)."""
    state = rows[:, None] * np.uint64(0x9E3779B97F4A7C15) + columns[None, :] * np.uint64(0xD1B54A32D192ED03)
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    state ^= state >> np.uint64(31)
    value: NDArray[np.float64] = (state >> np.uint64(11)).astype(np.float64) / float(1 << 52) - 1.0
    return value
