"""Numbers and answers in words: lengths, times, grades, and the one sentence that says how it went."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

MISSING = "\N{EN DASH}"
_KM_FROM_M = 1000.0
_KWH_FROM_J = 360_000.0  # a tenth of a kilowatt hour
_UNITS = {
    "mps2": "m/s²",
    "radps": "rad/s",
    "mps": "m/s",
    "kpa": "kPa",
    "m2": "m²",
    "kg": "kg",
    "m": "m",
    "s": "s",
    "w": "W",
    "j": "J",
}
# Status -> (headline, whether the wish was fulfilled).
_STATUS = {
    "route_found": ("Route found", True),
    "no_route": ("No route", False),
    "start_blocked": ("No route: the start is blocked", False),
    "goal_blocked": ("No route: the goal is blocked", False),
    "outside_map": ("No route: a point lies outside the map", False),
    "reached": ("Goal reached", True),
    "not_reached": ("Goal not reached", False),
    "collision": ("Goal not reached: the robot collided", False),
    "timeout": ("Goal not reached in time", False),
}


def number(value: object) -> float | None:
    """Return ``value`` as a finite number, or None for anything else (true and false included)."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        plain = float(value)
    except OverflowError:
        return None
    return plain if math.isfinite(plain) else None


def plain_text(value: object) -> str:
    """Return ``value`` as one line of printable text; what a page or terminal might act upon becomes a space."""
    text = str(value).encode("utf-8", "replace").decode("utf-8")
    return " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())


def length(value: object) -> str:
    """Return metres as 23.1 km, 512 m or 3.5 m."""
    metres = number(value)
    if metres is None:
        return MISSING
    if abs(metres) >= _KM_FROM_M:
        return f"{metres / _KM_FROM_M:,.1f} km"
    return f"{metres:.0f} m" if abs(metres) >= 10 or metres == round(metres) else f"{metres:.1f} m"


def metres(value: object) -> str:
    """Return a short distance as 0.52 m."""
    plain = number(value)
    return MISSING if plain is None else f"{plain:.2f} m"


def duration(value: object) -> str:
    """Return seconds as 1 h 04 min, 12 min, 48 s or 0.35 s."""
    seconds = number(value)
    if seconds is None or seconds < 0:
        return MISSING
    if seconds < 10:
        return f"{seconds:.2g} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 600:
        return f"{whole // 60} min {whole % 60:02d} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def energy(value: object) -> str:
    """Return joules as 4.2 kWh, 12 Wh or 30 J."""
    joules = number(value)
    if joules is None:
        return MISSING
    if abs(joules) >= _KWH_FROM_J:
        return f"{joules / 3.6e6:,.1f} kWh"
    return f"{joules / 3600:.1f} Wh" if abs(joules) >= 360 else f"{joules:.0f} J"


def percent(value: object, *, signed: bool = False) -> str:
    """Return a share or a grade (rise over run) as 12 %, with a sign where asked."""
    share = number(value)
    if share is None:
        return MISSING
    whole = round(100 * share)
    shown = f"{whole:+d} %" if signed and whole else f"{whole:d} %"
    return shown.replace("-", "\N{MINUS SIGN}")


def speed(value: object) -> str:
    """Return metres per second as 0.70 m/s (2.5 km/h)."""
    metres = number(value)
    return MISSING if metres is None else f"{metres:.2g} m/s"


def count(value: object) -> str:
    """Return a whole number with thousands separated, any other number shortly, anything else as text."""
    plain = number(value)
    if plain is None:
        if value is None:
            return MISSING
        return {True: "yes", False: "no"}[value] if isinstance(value, bool) else plain_text(value)
    return f"{plain:,.0f}" if plain == round(plain) and abs(plain) < 1e15 else f"{plain:,.6g}"


def name_and_unit(key: str) -> tuple[str, str]:
    """Split a key such as ``max_speed_mps`` into ``max speed`` and ``m/s``."""
    stem, _, suffix = key.rpartition("_")
    if stem and suffix in _UNITS:
        return plain_text(stem.replace("_", " ")), _UNITS[suffix]
    return plain_text(key.replace("_", " ")), ""


def is_fulfilled(summary: Mapping[str, object]) -> bool | None:
    """Return whether the run did what was wanted; None where the question does not arise."""
    if summary.get("command") == "nests" and summary.get("status") not in _STATUS:
        return None
    return _STATUS.get(str(summary.get("status")), ("", None))[1]


def headline(summary: Mapping[str, object]) -> str:
    """Return the answer in one short line."""
    status = str(summary.get("status"))
    if summary.get("command") == "nests" and status not in {"start_blocked", "goal_blocked", "outside_map"}:
        nests = number(summary.get("nest_count"))
        if nests is None:
            return "Navigable regions"
        return "One navigable region" if nests == 1 else f"{count(nests)} navigable regions"
    words = _STATUS.get(status, (plain_text(status) if summary.get("status") else "Run", None))[0]
    metres = summary.get("length_m") if status == "route_found" else summary.get("distance_m")
    if _STATUS.get(status, ("", False))[1] and number(metres) is not None:
        words += f": {length(metres)}"
        if number(summary.get("duration_s")) is not None:
            words += f" in {duration(summary['duration_s'])}"
    return words
