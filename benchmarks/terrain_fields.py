"""Synthetic ground for benchmarks: smooth, seeded, the same on every machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def smooth_noise(side: int, wavelength_cells: int, seed: int) -> NDArray[np.float32]:
    """Return a ``side`` x ``side`` field in 0..1 that varies over about ``wavelength_cells`` cells.

    Random values on a coarse lattice, interpolated with a smooth step; octaves of half the wavelength and half the
    height are added down to eight cells.
    """
    total = np.zeros((side, side), np.float32)
    height, wavelength, weight = 1.0, wavelength_cells, 0.0
    generator = np.random.default_rng(seed)
    while wavelength >= 8:
        nodes = side // wavelength + 2
        lattice = generator.random((nodes, nodes), np.float32)
        place = np.arange(side, dtype=np.float32) / np.float32(wavelength)
        low = place.astype(np.int64)
        step = place - low
        step = step * step * (3 - 2 * step)
        rows = lattice[low] * (1 - step[:, None]) + lattice[low + 1] * step[:, None]
        total += np.float32(height) * (rows[:, low] * (1 - step) + rows[:, low + 1] * step)
        weight += height
        height /= 2
        wavelength //= 2
    total /= np.float32(weight)
    return total


def elevation(side: int) -> NDArray[np.float32]:
    """Return hills of about 300 m for cells of 10 m, with plains and slopes beyond any vehicle's limit."""
    return 300 * smooth_noise(side, side // 8, seed=1) + 0.5


def soil_codes(side: int) -> NDArray[np.uint8]:
    """Return patches of the six soil classes (codes 1 to 5, and 0 for unknown)."""
    return np.minimum(smooth_noise(side, side // 4, seed=2) * 12 % 6, 5).astype(np.uint8)


def ranks(side: int) -> NDArray[np.uint8]:
    """Return ranks 1 to 10 in patches, about half of them 6 or more."""
    noise = smooth_noise(side, 64, seed=3)
    order = np.quantile(noise[::7, ::7], np.linspace(0, 1, 11)[1:-1])
    return (np.digitize(noise, order) + 1).astype(np.uint8)


def costs(side: int) -> NDArray[np.float64]:
    """Return costs per metre of 1 to about 8."""
    noise = smooth_noise(side, side // 10, seed=4).astype(np.float64)
    return 1 + 7 * noise * noise
