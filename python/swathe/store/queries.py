"""The plain SQL of the PostGIS store, by the names of its files."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import LiteralString


@cache
def query(name: str) -> LiteralString:
    """Return the statement of ``sql/<name>.sql``. It holds places for parameters and never a value."""
    return resources.files("swathe.store").joinpath("sql", f"{name}.sql").read_text(encoding="utf-8")
