"""Pictures and pages: that they show what happened, hold at the extremes, and never leave half a file behind."""

from __future__ import annotations

import os
import subprocess
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image

from pictures import picture_of, pixels, pixels_near, route_profile
from swathe.errors import (
    InvalidParameterError,
    OutputError,
    ShapeMismatchError,
)
from swathe.grid import GridGeometry
from swathe.report.graticule import round_below
from swathe.report.map import MapPicture, draw_map
from swathe.report.output import replacing
from swathe.report.palette import RANK_COLOURS, ROUTE_COLOUR, SOIL_COLOURS, rank_colour_table, rank_hex
from swathe.report.profile import draw_profile
from swathe.report.relief import MAX_SIDE, draw_relief

ROUTE_RGB = tuple(int(ROUTE_COLOUR[place : place + 2], 16) for place in (1, 3, 5))
PYTHON_FOLDER = Path(__file__).resolve().parent.parent / "python"


def lightness(colour: tuple[int, ...]) -> float:
    """CIE L* of an sRGB colour."""
    linear = [(part / 255 / 12.92) if part <= 10 else ((part / 255 + 0.055) / 1.055) ** 2.4 for part in colour[:3]]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return 116 * luminance ** (1 / 3) - 16 if luminance > 0.008856 else 903.3 * luminance


# ---- colours


def test_palette_has_a_colour_for_every_code_and_a_plain_table() -> None:
    assert set(RANK_COLOURS) == set(range(11))
    assert rank_colour_table() == RANK_COLOURS
    assert rank_colour_table() is not RANK_COLOURS
    assert all(0 <= part <= 255 for colour in RANK_COLOURS.values() for part in colour)
    assert rank_hex(1) == "#" + "".join(f"{part:02x}" for part in RANK_COLOURS[1][:3])
    assert set(SOIL_COLOURS) == {"gravel", "sand", "clay", "silt", "rock", "unknown", "none"}


def test_ranks_grow_lighter_from_no_go_to_best_so_that_no_eye_loses_the_order() -> None:
    steps = np.diff([lightness(RANK_COLOURS[code]) for code in range(1, 11)])
    assert (steps > 0.5).all()


@pytest.mark.parametrize(
    "confusion",
    [
        # Machado, Oliveira, Fernandes 2009, severity 1.0: protanopia, deuteranopia.
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    ],
)
def test_neighbouring_ranks_stay_apart_for_the_colour_blind(confusion: list[list[float]]) -> None:
    seen = np.array([RANK_COLOURS[code][:3] for code in range(1, 11)]) @ np.array(confusion).T
    assert (np.linalg.norm(np.diff(seen, axis=0), axis=1) > 14).all()


@pytest.mark.parametrize("module", ["palette", "map", "profile", "html", "wording"])
def test_importing_the_surface_of_the_report_loads_no_matplotlib(module: str) -> None:
    code = f"import sys, swathe.report.{module}; sys.exit('matplotlib' in sys.modules)"
    environment = {**os.environ, "PYTHONPATH": str(PYTHON_FOLDER)}
    assert subprocess.run([sys.executable, "-c", code], env=environment, check=False).returncode == 0


# ---- the ground under the map


def test_relief_shows_each_cell_in_the_colour_of_its_rank() -> None:
    rank = np.arange(11, dtype=np.uint8).reshape(1, 11)
    image, rows, columns = draw_relief(
        rank, np.zeros((1, 11), np.float32), None, cell_size_m=1.0, target_shape=(20, 220)
    )
    assert (rows, columns) == (1, 11)
    centres = image[image.shape[0] // 2, image.shape[1] // 22 :: image.shape[1] // 11]
    assert [tuple(centre) for centre in centres[1:]] == [RANK_COLOURS[code][:3] for code in range(1, 11)]
    unknown = image[:, : image.shape[1] // 11]
    assert len(np.unique(unknown.reshape(-1, 3), axis=0)) == 2, "unknown ground is hatched in two greys"


def test_relief_is_lit_from_the_north_west() -> None:
    row, column = np.mgrid[:40, :40]
    cone = (-np.hypot(row - 19.5, column - 19.5)).astype(np.float32)
    image, _, _ = draw_relief(np.full((40, 40), 6, np.uint8), cone, None, cell_size_m=1.0, target_shape=(40, 40))
    assert image[10, 10].sum() > image[30, 30].sum() + 60


def test_relief_fades_what_lies_outside_the_swathe_and_draws_its_edge() -> None:
    rank = np.full((60, 60), 3, np.uint8)
    swathe = np.zeros((60, 60), np.bool_)
    swathe[:, :30] = True
    image, _, _ = draw_relief(rank, np.zeros((60, 60), np.float32), swathe, cell_size_m=1.0, target_shape=(60, 60))
    inside, outside = image[30, 10].astype(int), image[30, 50].astype(int)
    assert np.ptp(outside) < np.ptp(inside) / 3
    assert outside.min() > inside.min()
    assert image[30, 28:32].sum(axis=1).min() < 300


def test_relief_averages_blocks_of_large_rasters_including_the_last_narrow_ones() -> None:
    side = 2 * MAX_SIDE + 1
    rank = np.zeros((3, side), np.uint8)
    rank[:, 0::2], rank[:, 1::2] = 2, 10
    image, rows, columns = draw_relief(
        rank, np.zeros(rank.shape, np.float32), None, cell_size_m=1.0, target_shape=(3, MAX_SIDE)
    )
    assert (rows, columns) == (3, 3 * ((side + 2) // 3))
    ends = np.array([RANK_COLOURS[2][:3], RANK_COLOURS[10][:3]])
    mixed = [(2 * ends[more] + ends[1 - more]) / 3 for more in (0, 1)]
    apart = [np.abs(image[:, :-1] - one).max(axis=2) for one in mixed]
    assert np.minimum(*apart).max() <= 1
    assert np.abs(image[:, -1] - ends.mean(axis=0)).max() <= 1


def test_relief_of_a_large_raster_takes_little_memory() -> None:
    rank = np.full((4000, 6000), 7, np.uint8)
    heights = np.zeros(rank.shape, np.float32)
    tracemalloc.start()
    try:
        draw_relief(rank, heights, None, cell_size_m=1.0, target_shape=(800, 1200))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 2.5 * heights.nbytes


# ---- the map


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (3, 3), (1, 40), (5000, 50), (50, 5000), (40, 60)])
def test_map_holds_at_every_shape(tmp_path: Path, rows: int, columns: int) -> None:
    path = tmp_path / "map.png"
    draw_map(path, picture_of(rows, columns))
    with Image.open(path) as image:
        assert image.format == "PNG"
        assert 500 < image.width < 2400
        assert 300 < image.height < 2400
    assert pixels_near(path, ROUTE_RGB) > 100
    assert [file.name for file in tmp_path.iterdir()] == ["map.png"]


def test_map_with_everything_unknown_and_no_way_is_drawn(tmp_path: Path) -> None:
    geometry = GridGeometry(30, 40, 25.0)
    path = tmp_path / "map.png"
    here = (500.0, -400.0)
    draw_map(
        path,
        MapPicture(
            geometry=geometry,
            elevation_m=np.full(geometry.shape, np.nan, np.float32),
            rank=np.zeros(geometry.shape, np.uint8),
            title="Nothing is known",
            start_xy_m=here,
            goal_xy_m=here,
            route_xy_m=np.array([here, here]),
            nest_rings=(np.empty((0, 2)),),
        ),
    )
    assert pixels_near(path, ROUTE_RGB) == 0


def test_map_shows_the_route_only_where_there_is_one(tmp_path: Path) -> None:
    with_route, without = tmp_path / "with.png", tmp_path / "without.png"
    draw_map(with_route, picture_of())
    draw_map(without, picture_of(route_xy_m=None))
    assert pixels_near(with_route, ROUTE_RGB) > 1000
    assert pixels_near(without, ROUTE_RGB) == 0


NEST_RING = np.array([[500_050, 4_999_950], [500_450, 4_999_950], [500_450, 4_999_700], [500_050, 4_999_950]], float)


@pytest.mark.parametrize(
    "addition",
    [
        {"nest_rings": (NEST_RING,)},
        {"arc_xy_m": np.array([[500_050, 4_999_900], [500_500, 4_999_700]], float)},
        {"blocked_xy_m": (500_300.0, 4_999_800.0)},
        {"swathe": np.tri(40, 60, dtype=np.bool_)},
        {"notes": ("Soil generated by rule.",)},
        {"subtitle": "tractor, seed 0"},
        {"lonlat_of": lambda x_m, y_m: (x_m / 1e5, y_m / 1e5)},
    ],
)  # fmt: skip
def test_every_part_of_the_map_leaves_a_trace(tmp_path: Path, addition: dict[str, Any]) -> None:
    plain, richer = tmp_path / "plain.png", tmp_path / "richer.png"
    draw_map(plain, picture_of())
    draw_map(richer, picture_of(**addition))
    before, after = pixels(plain), pixels(richer)
    assert before.shape != after.shape or (before != after).any(axis=2).sum() > 50


def test_map_is_the_same_bytes_again_whatever_the_user_s_style(tmp_path: Path) -> None:
    first, second = tmp_path / "first.png", tmp_path / "second.png"
    metadata = {"Version": "0.1.0", "Seed": "0"}
    draw_map(first, picture_of(), metadata=metadata)
    with mpl.rc_context({"font.size": 30, "axes.spines.left": False, "xtick.direction": "in", "savefig.dpi": 40}):
        draw_map(second, picture_of(), metadata=metadata)
        assert mpl.rcParams["font.size"] == 30, "the user's own settings must survive"
    assert first.read_bytes() == second.read_bytes()
    with Image.open(first) as image:
        assert image.info["Version"] == "0.1.0"
        assert image.info["Software"] == "Swathe"
        assert not any("time" in str(key).lower() or "date" in str(key).lower() for key in image.info)


def test_hostile_titles_and_metadata_are_drawn_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    title = "$\\frac{1}{0}$ _^{ 日本 \u202e\0\n" + "x" * 900
    draw_map(path, picture_of(title=title, subtitle=title, notes=(title,)), metadata={"Né\n日": title, "": "\0"})
    assert path.stat().st_size > 10_000


def test_interrupted_map_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    path.write_bytes(b"old")

    def interrupt(_x_m: Any, _y_m: Any) -> Any:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        draw_map(path, picture_of(lonlat_of=interrupt))
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["map.png"]


@pytest.mark.parametrize(
    ("given", "raised"),
    [(KeyboardInterrupt(), KeyboardInterrupt), (OSError(28, "No space left on device"), OutputError)],
)
def test_interrupted_or_failed_writing_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, given: BaseException, raised: type[BaseException]
) -> None:
    path = tmp_path / "page.html"
    path.write_bytes(b"old")

    def fail_half_way() -> None:
        with replacing(path) as stream:
            stream.write(b"half")
            raise given

    with pytest.raises(raised):
        fail_half_way()
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["page.html"]
    with replacing(path) as stream:
        stream.write(b"new")
    assert path.read_bytes() == b"new"


@pytest.mark.parametrize(
    ("limit", "length"), [(9.99, 5), (10, 10), (2.3, 2), (0.0199, 0.01), (4990, 2000), (5000, 5000)]
)
def test_scale_bar_has_a_round_length(limit: float, length: float) -> None:
    assert round_below(limit) == pytest.approx(length)


def test_map_into_a_missing_folder_or_onto_a_folder_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    for path in (tmp_path / "none" / "map.png", tmp_path / "file" / "map.png", tmp_path):
        with pytest.raises(OutputError, match="cannot be written") as caught:
            draw_map(path, picture_of())
        assert caught.value.remedy
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


def test_layers_of_other_shapes_and_codes_are_refused() -> None:
    with pytest.raises(ShapeMismatchError, match="elevation_m"):
        picture_of(elevation_m=np.zeros((3, 3), np.float32))
    with pytest.raises(ShapeMismatchError, match="swathe"):
        picture_of(swathe=np.zeros((3, 3), np.bool_))
    with pytest.raises(InvalidParameterError, match="rank"):
        picture_of(rank=np.full((40, 60), 11, np.uint8))


def test_map_of_real_terrain_with_voids(swathe_data: Path, tmp_path: Path) -> None:
    import rasterio
    from rasterio.warp import transform

    with rasterio.open(swathe_data / "spearfish" / "spearfish_elevation_dem_30m.tif") as source:
        heights = source.read(1, masked=True).filled(np.nan).astype(np.float32)
        geometry = GridGeometry(source.height, source.width, 30.0, source.transform.c, source.transform.f)
        crs = source.crs
    grade = np.hypot(*np.gradient(heights, 30.0))
    rank = np.where(np.isnan(grade), 0, np.where(grade > 0.25, 1, 10 - np.nan_to_num(grade) * 32)).astype(np.uint8)

    def lonlat_of(x_m: Any, y_m: Any) -> Any:
        return tuple(np.array(values) for values in transform(crs, "EPSG:4326", list(x_m), list(y_m)))

    path = tmp_path / "map.png"
    draw_map(path, MapPicture(geometry, heights, rank, "Spearfish", lonlat_of=lonlat_of))
    assert pixels_near(path, RANK_COLOURS[1][:3]) > 5000


# ---- the profile


def test_profile_is_drawn_with_the_soils_it_crosses_and_is_the_same_again(tmp_path: Path) -> None:
    first, second = tmp_path / "first.png", tmp_path / "second.png"
    draw_profile(first, **route_profile(), metadata={"Seed": "0"})
    draw_profile(second, **route_profile(), metadata={"Seed": "0"})
    assert first.read_bytes() == second.read_bytes()
    drawn = {
        soil: pixels_near(first, tuple(int(colour[place : place + 2], 16) for place in (1, 3, 5)))
        for soil, colour in SOIL_COLOURS.items()
    }
    assert drawn["clay"] > 500
    assert drawn["sand"] == pytest.approx(2 * drawn["clay"], rel=0.15), "two legs of sand, one of clay"
    assert drawn["none"] == 0


def test_profile_holds_without_heights_without_legs_and_for_one_point(tmp_path: Path) -> None:
    nothing = np.array([])
    legless: dict[str, Any] = {
        "leg_distance_m": nothing,
        "leg_grade": nothing,
        "leg_speed_mps": nothing,
        "leg_soil": [],
    }
    cases: dict[str, dict[str, Any]] = {
        "unknown": {"elevation_m": np.full(200, np.nan)},
        "point": {"distance_m": np.zeros(1), "elevation_m": np.ones(1), **legless},
        "empty": {"distance_m": nothing, "elevation_m": nothing, **legless},
        "no speed": {"leg_speed_mps": np.full(6, np.nan), "leg_grade": np.full(6, np.nan)},
    }
    for name, changes in cases.items():
        path = tmp_path / f"{name}.png"
        draw_profile(path, **{**route_profile(), **changes})
        assert path.stat().st_size > 5000


@pytest.mark.parametrize("key", ["elevation_m", "leg_distance_m", "leg_grade", "leg_speed_mps", "leg_soil"])
def test_profile_refuses_arrays_that_do_not_belong_together(tmp_path: Path, key: str) -> None:
    values = route_profile()
    with pytest.raises(ShapeMismatchError):
        draw_profile(tmp_path / "profile.png", **{**values, key: values[key][:-1]})
    assert not list(tmp_path.iterdir())
