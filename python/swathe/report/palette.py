"""Colours shared by the map, the profile, the HTML report and the colour table of the rank raster.

The ranks run from dark rust over sand to pale aqua: lightness rises from step to step and the hue changes along the
axis from yellow to blue, so that the order survives the common forms of colour blindness and a grey print. No-go is
darker than every rank. Importing this module needs nothing but the standard library.
"""

from __future__ import annotations

UNKNOWN_RANK = 0
NO_GO_RANK = 1
WORST_RANK = 2
BEST_RANK = 10

# Rank code -> red, green, blue, alpha, each 0..255.
RANK_COLOURS: dict[int, tuple[int, int, int, int]] = {
    UNKNOWN_RANK: (178, 178, 182, 255),
    NO_GO_RANK: (106, 40, 58, 255),
    2: (158, 84, 56, 255),
    3: (180, 104, 62, 255),
    4: (200, 127, 72, 255),
    5: (216, 152, 86, 255),
    6: (229, 178, 106, 255),
    7: (236, 202, 134, 255),
    8: (232, 220, 164, 255),
    9: (212, 229, 196, 255),
    10: (196, 238, 228, 255),
}

# Soil class -> #rrggbb.
SOIL_COLOURS: dict[str, str] = {
    "gravel": "#a39a8c",
    "sand": "#edcf82",
    "clay": "#b4623a",
    "silt": "#86b49a",
    "rock": "#565a68",
    "unknown": "#dcdcdc",
    "none": "#6aa7d6",
}

ROUTE_COLOUR = "#2438c2"
ROUTE_CASING_COLOUR = "#ffffff"
NEST_COLOUR = "#0c4a46"
ARC_COLOUR = "#3a3a40"
LIMIT_COLOUR = "#b3232f"
SPEED_COLOUR = "#1c7a74"
DRIVEN_COLOUR = "#111317"
OBSTACLE_COLOUR = "#8f8b86"
SEEN_COLOUR = "#cf4a12"
LOCAL_WAY_COLOUR = "#9b3fb5"
INK_COLOUR = "#23262b"
FAINT_INK_COLOUR = "#6b7079"


def rank_colour_table() -> dict[int, tuple[int, int, int, int]]:
    """Return rank code -> (red, green, blue, alpha), each 0..255, as a colour table of an 8-bit raster wants it."""
    return dict(RANK_COLOURS)


def rank_hex(rank: int) -> str:
    """Return the colour of a rank code (0..10) as #rrggbb."""
    red, green, blue, _ = RANK_COLOURS[rank]
    return f"#{red:02x}{green:02x}{blue:02x}"
