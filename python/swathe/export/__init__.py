"""What a run leaves behind: its folder, GeoJSON, and the summary."""

from __future__ import annotations
