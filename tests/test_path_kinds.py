"""The example that draws four kinds of path in one picture runs and shows all four."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

import raster_files
from pictures import pixels_near

EXAMPLE = Path(__file__).resolve().parent.parent / "examples" / "path_kinds.py"


def test_four_kinds_of_path_are_drawn_in_one_picture(tmp_path: Path) -> None:
    dem = raster_files.write(tmp_path / "hills.tif", raster_files.hills(120, 120))
    main = runpy.run_path(str(EXAMPLE))["main"]
    west, north, cell_m = raster_files.WEST, raster_files.NORTH, raster_files.CELL
    ends = [f"{west + column * cell_m},{north - row * cell_m}" for row, column in ((12.5, 10.5), (101.5, 90.5))]
    question = [str(dem), *ends, "tractor"]
    main([str(tmp_path / "one.png"), *question])
    main([str(tmp_path / "again.png"), *question])
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "again.png").read_bytes()
    for colour in ((230, 159, 0), (204, 42, 138), (0, 0, 0)):
        assert pixels_near(tmp_path / "one.png", colour) > 100


def test_a_question_with_a_part_missing_shows_how_to_ask() -> None:
    main = runpy.run_path(str(EXAMPLE))["main"]
    with pytest.raises(SystemExit, match="OUT"):
        main(["out.png", "dem.tif", "1,2"])
