"""Swathe: off-road route planning and navigation for ground robots.

The documented modules (``swathe.planner``, ``swathe.terrain``, ...) are loaded when they are first used, so that
importing the package costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import ModuleType

__all__ = [
    "belief",
    "corridor",
    "drive",
    "episode",
    "errors",
    "export",
    "grid",
    "io",
    "local",
    "mission",
    "nest",
    "planner",
    "rank",
    "report",
    "sensor",
    "sim",
    "soil",
    "store",
    "swarm",
    "terrain",
    "trials",
    "vehicle",
]


def __getattr__(name: str) -> ModuleType | str:
    if name == "__version__":
        core = importlib.import_module("swathe._core")
        version: str = core.__version__
        return version
    if name in __all__:
        return importlib.import_module(f"swathe.{name}")
    raise AttributeError(f"module 'swathe' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
