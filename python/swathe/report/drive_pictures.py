"""All pictures of a drive, into its folder."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from swathe.report.drive import Drive


def draw(folder: Path, drive: Drive, metadata: Mapping[str, str] | None = None, *, animate: bool = True) -> None:
    """Draw ``drive-map.png``, ``drive-frames.png``, ``drive-profile.png`` and ``drive.gif``; equal drives, equal bytes.

    Without ``animate`` there is no animation.

    Raises:
        OutputError: the folder does not exist or may not be written.
    """
    from swathe.report.drive_film import write_drive_gif
    from swathe.report.drive_frames import draw_frames
    from swathe.report.drive_map import draw_drive_map
    from swathe.report.drive_profile import draw_profile

    named = metadata or {}
    draw_drive_map(folder / "drive-map.png", drive, named)
    draw_frames(folder / "drive-frames.png", drive, named)
    draw_profile(folder / "drive-profile.png", drive, named)
    if animate:
        write_drive_gif(folder / "drive.gif", drive)
