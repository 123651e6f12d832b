"""The shape of the ground against GDAL, numpy and scipy."""

from __future__ import annotations

import math
import subprocess
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rasterio
import scipy.linalg
import scipy.ndimage
import xarray
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from raster_files import write
from swathe import terrain
from swathe.errors import AllVoidError, InvalidParameterError, ShapeMismatchError
from worlds import smooth_hills

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

VOID = -9999.0
# GDAL works and writes in single precision: a slope of 1 (100 %) has about 7 digits, of which cancellation between
# heights of some 1,000 m takes three.
SLOPE_TOLERANCE = 2e-4
EAST, NORTH, WEST, SOUTH = 0, 2, 4, 6
#: (rows, columns) of the eight directions, counter-clockwise from east.
OFFSETS = ((0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1))

heights = arrays.arrays(
    np.float32,
    arrays.array_shapes(min_dims=2, max_dims=2, max_side=20),
    elements=st.one_of(st.floats(-500, 500, width=32), st.just(np.float32(np.nan))),
)
known_heights = arrays.arrays(
    np.float32, arrays.array_shapes(min_dims=2, max_dims=2, max_side=20), elements=st.floats(-500, 500, width=32)
)


def run_gdaldem(
    program: Path, folder: Path, elevation_m: NDArray[np.float32], cell_size_m: float, *words: str
) -> NDArray[np.float32]:
    """Return what gdaldem makes of heights; its own "no answer" becomes NaN."""
    place = Affine(cell_size_m, 0, 500_000, 0, -cell_size_m, 4_000_000)
    filled = np.where(np.isnan(elevation_m), np.float32(VOID), elevation_m)
    source, target = write(folder / "dem.tif", filled, transform=place, nodata=VOID), folder / "out.tif"
    mode, *options = words
    done = subprocess.run(
        [program, mode, source, target, "-q", *options], capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    with rasterio.open(target) as dataset:
        result: NDArray[np.float32] = dataset.read(1)
    return np.where(result == VOID, np.float32(np.nan), result)


def away_from_voids(elevation_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return the known cells none of whose eight neighbours is unknown."""
    near: NDArray[np.bool_] = scipy.ndimage.binary_dilation(np.isnan(elevation_m), np.ones((3, 3)))
    return ~near


def inner(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    mask = np.zeros(shape, dtype=np.bool_)
    mask[1:-1, 1:-1] = True
    return mask


def not_corners(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return all but the four corners: there gdaldem repeats the edge's column, which halves the slope along it."""
    mask = np.ones(shape, dtype=np.bool_)
    mask[:: shape[0] - 1, :: shape[1] - 1] = False
    return mask


def check_slope(program: Path, folder: Path, elevation_m: NDArray[np.float32], cell_size_m: float) -> None:
    ours = terrain.slope(elevation_m, cell_size_m)
    usual = run_gdaldem(program, folder, elevation_m, cell_size_m, "slope", "-p") / 100
    edges = run_gdaldem(program, folder, elevation_m, cell_size_m, "slope", "-p", "-compute_edges") / 100
    clear = away_from_voids(elevation_m)
    for theirs, cells in ((usual, clear & inner(ours.shape)), (edges, clear & not_corners(ours.shape))):
        assert cells.sum() > 0.5 * cells.size
        assert np.isfinite(theirs[cells]).all()
        assert (np.abs(ours[cells] - theirs[cells]) <= SLOPE_TOLERANCE * np.maximum(1, theirs[cells])).all()
    assert (np.isnan(ours) == np.isnan(elevation_m)).all()


def check_aspect(program: Path, folder: Path, elevation_m: NDArray[np.float32], cell_size_m: float) -> None:
    ours = terrain.aspect_rad(elevation_m, cell_size_m)
    azimuth = run_gdaldem(program, folder, elevation_m, cell_size_m, "aspect", "-compute_edges")
    # The direction of ground that is nearly level is rounding noise in either program.
    steep = terrain.slope(elevation_m, cell_size_m) > 0.01
    cells = away_from_voids(elevation_m) & not_corners(ours.shape) & steep
    assert cells.sum() > 0.3 * cells.size
    theirs = np.deg2rad(90.0 - azimuth[cells].astype(np.float64))
    difference = np.angle(np.exp(1j * (ours[cells] - theirs)))
    assert np.abs(difference).max() < np.deg2rad(0.5)
    assert np.median(np.abs(difference)) < np.deg2rad(0.01)


def with_holes(elevation_m: NDArray[np.float32]) -> NDArray[np.float32]:
    holed = elevation_m.copy()
    holed[20:25, 30:33] = np.nan
    holed[0, 50] = np.nan
    return holed


@pytest.mark.parametrize("cell_size_m", [1.0, 30.0])
def test_slope_is_gdals_on_made_hills(gdaldem: Path, tmp_path: Path, cell_size_m: float) -> None:
    hills = smooth_hills(3, 90, 120, height_m=8 * cell_size_m, cell_size_m=cell_size_m, wave_m=20 * cell_size_m)
    check_slope(gdaldem, tmp_path, with_holes(hills), cell_size_m)


def test_aspect_is_gdals_on_made_hills(gdaldem: Path, tmp_path: Path) -> None:
    hills = smooth_hills(4, 90, 120, height_m=240, cell_size_m=30, wave_m=600)
    check_aspect(gdaldem, tmp_path, with_holes(hills), 30.0)


REAL = [
    "ebergotzen/ebergotzen_dem_25m.tif",
    "spearfish/spearfish_elevation_dem_30m.tif",
    "fortbragg/fortbragg_elevation_2016_1m.tif",
    "dem/bigtujunga_30m.tif",
]


def real_heights(path: Path) -> tuple[NDArray[np.float32], float]:
    with rasterio.open(path) as dataset:
        values: NDArray[np.float32] = dataset.read(1, masked=True).astype(np.float32).filled(np.nan)
        return values, float(dataset.transform.a)


@pytest.mark.parametrize("name", REAL)
def test_slope_and_aspect_are_gdals_on_real_ground(gdaldem: Path, swathe_data: Path, tmp_path: Path, name: str) -> None:
    values, cell_size_m = real_heights(swathe_data / name)
    check_slope(gdaldem, tmp_path, values, cell_size_m)
    check_aspect(gdaldem, tmp_path, values, cell_size_m)


@given(east=st.floats(-2, 2), north=st.floats(-2, 2), rows=st.integers(2, 9), columns=st.integers(2, 9), data=st.data())
def test_a_plane_with_voids_has_its_own_slope_and_aspect_everywhere(
    east: float, north: float, rows: int, columns: int, data: st.DataObject
) -> None:
    row, column = np.mgrid[0:rows, 0:columns]
    plane = np.asarray(5 * (east * column - north * row), dtype=np.float32)
    hole = data.draw(st.tuples(st.integers(0, rows - 1), st.integers(0, columns - 1)))
    if rows > 3 and columns > 3:
        plane[hole] = np.nan
    known = ~np.isnan(plane)
    steep = math.hypot(east, north)
    assert np.allclose(terrain.slope(plane, 5.0)[known], steep, atol=1e-4)
    if steep > 0.01:
        turn = terrain.aspect_rad(plane, 5.0)[known] - math.atan2(-north, -east)
        assert np.abs(np.angle(np.exp(1j * turn))).max() < 1e-2


@given(known_heights.filter(lambda layer: min(layer.shape) > 1))
def test_beyond_every_edge_and_corner_heights_go_on_in_a_straight_line(layer: NDArray[np.float32]) -> None:
    padded = np.pad(layer.astype(np.float64), 1, mode="reflect", reflect_type="odd")
    east, south = (scipy.ndimage.sobel(padded, axis)[1:-1, 1:-1] / 8 / 2.0 for axis in (1, 0))
    assert np.allclose(terrain.slope(layer, 2.0), np.hypot(east, south), rtol=1e-5, atol=1e-4)


def test_level_ground_has_no_aspect_and_a_void_has_nothing() -> None:
    level = np.full((4, 4), 7.0, dtype=np.float32)
    level[0, 0] = np.nan
    assert np.isnan(terrain.aspect_rad(level, 1.0)).all()
    for layer in (terrain.slope(level, 1.0), terrain.roughness_m(level, 1.0)):
        assert np.isnan(layer[0, 0])
        assert (layer.ravel()[1:] == 0).all()


@given(known_heights)
def test_roughness_is_the_distance_from_the_plane_of_least_squares(layer: NDArray[np.float32]) -> None:
    found = terrain.roughness_m(layer, 2.0)
    row, column = np.mgrid[-1:2, -1:2]
    design = np.column_stack([np.ones(9), row.ravel(), column.ravel()])
    for r in range(1, layer.shape[0] - 1):
        for c in range(1, layer.shape[1] - 1):
            window = layer[r - 1 : r + 2, c - 1 : c + 2].astype(np.float64).ravel()
            plane, *_ = scipy.linalg.lstsq(design, window)
            expected = math.sqrt(float(np.mean((window - design @ plane) ** 2)))
            assert found[r, c] == pytest.approx(expected, rel=1e-5, abs=1e-4)


@given(heights)
def test_grey_levels_are_0_to_255_over_the_known_range(layer: NDArray[np.float32]) -> None:
    known = np.isfinite(layer)
    if not known.any():
        with pytest.raises(AllVoidError):
            terrain.height_map(layer)
        return
    grey = terrain.height_map(layer)
    assert (np.isfinite(grey) == known).all()
    low, high = (float(value) for value in (layer[known].min(), layer[known].max()))
    if low == high:
        assert (grey[known] == 0).all()
        return
    scaled = (layer[known].astype(np.float64) - low) * 255 / (high - low)
    assert (grey[known] == np.floor(scaled + 0.5)).all()
    assert (grey[known].min(), grey[known].max()) == (0, 255)


def test_grey_levels_over_a_given_range_are_cut_off_at_black_and_white() -> None:
    grey = terrain.height_map([[-10.0, 0.0, 50.0, 100.0, 400.0]], (0.0, 100.0))
    assert grey.tolist() == [[0.0, 0.0, 128.0, 255.0, 255.0]]


@pytest.mark.parametrize("limits", [(2.0, 1.0), (1.0, 1.0), (math.nan, 1.0), (0.0, math.inf)])
def test_a_height_range_that_is_none_is_refused(limits: tuple[float, float]) -> None:
    with pytest.raises(InvalidParameterError, match="height range"):
        terrain.height_map([[1.0, 2.0]], limits)


@pytest.mark.parametrize(("group", "tall", "wide"), [("8x8", 8, 8), ("2x4", 2, 4), ("none", 1, 1)])
def test_groups_are_numpys_means_and_maxima(group: Any, tall: int, wide: int) -> None:
    layer = smooth_hills(5, 45, 70, height_m=100, cell_size_m=30, wave_m=900)
    layer[3, 4] = np.nan
    rows, columns = 45 // tall, 70 // wide
    blocks = layer[: rows * tall, : columns * wide].reshape(rows, tall, columns, wide)
    mean = terrain.group_mean(layer, group)
    assert mean.shape == (rows, columns)
    assert np.allclose(mean, blocks.astype(np.float64).mean(axis=(1, 3)), rtol=1e-6, equal_nan=True)
    assert np.isnan(mean).sum() == 1
    greatest = terrain.block_max(layer, group)
    hollow = np.where(np.isnan(blocks), -np.inf, blocks).max(axis=(1, 3))
    assert (np.where(np.isnan(greatest), -np.inf, greatest) == hollow).all()


def test_a_map_smaller_than_a_group_is_one_group() -> None:
    assert terrain.group_mean([[1.0, 2.0, 6.0]]).tolist() == [[3.0]]


@given(heights, st.integers(0, 7))
def test_differences_are_those_to_the_shifted_layer(layer: NDArray[np.float32], direction: int) -> None:
    found = terrain.directional_difference(layer, direction)
    padded = np.pad(layer, 1, constant_values=np.nan)
    rows, columns = OFFSETS[direction]
    shifted = padded[1 + rows : 1 + rows + layer.shape[0], 1 + columns : 1 + columns + layer.shape[1]]
    assert np.array_equal(found, shifted - layer, equal_nan=True)


def test_direction_0_is_east_and_2_is_north() -> None:
    layer = np.arange(9, dtype=np.float32).reshape(3, 3)
    middle = {d: terrain.directional_difference(layer, d)[1, 1] for d in (EAST, NORTH, WEST, SOUTH)}
    assert middle == {EAST: 1, NORTH: -3, WEST: -1, SOUTH: 3}


def test_infinite_heights_are_unknown_and_xarray_is_accepted() -> None:
    layer = xarray.DataArray(np.array([[1.0, np.inf], [2.0, -np.inf]]), dims=("y", "x"))
    assert np.isnan(terrain.slope(layer, 1.0)).tolist() == [[False, True], [False, True]]


@pytest.mark.parametrize("bad", [[1.0, 2.0], 3.0, np.zeros((0, 4)), np.zeros((2, 2, 2))])
def test_heights_without_rows_and_columns_are_refused(bad: Any) -> None:
    with pytest.raises(ShapeMismatchError, match="The elevation has the shape"):
        terrain.slope(bad, 1.0)


@pytest.mark.parametrize("bad", [[["high", "low"]], [[1.0], [1.0, 2.0]]])
def test_heights_that_are_no_numbers_are_refused(bad: Any) -> None:
    with pytest.raises(InvalidParameterError, match="does not hold numbers"):
        terrain.slope(bad, 1.0)


@pytest.mark.parametrize("bad", [0.0, -30.0, math.nan, math.inf])
def test_cell_sizes_that_are_no_lengths_are_refused(bad: float) -> None:
    for function in (terrain.slope, terrain.aspect_rad, terrain.roughness_m):
        with pytest.raises(InvalidParameterError, match="cell size"):
            function([[1.0, 2.0]], bad)


@pytest.mark.parametrize("bad", [-1, 8])
def test_directions_beyond_eight_are_refused(bad: int) -> None:
    with pytest.raises(InvalidParameterError, match=f"Direction {bad}"):
        terrain.directional_difference([[1.0, 2.0]], bad)


def test_groups_that_nobody_knows_are_refused() -> None:
    with pytest.raises(InvalidParameterError, match="3x3"):
        terrain.group_mean([[1.0]], "3x3")  # type: ignore[arg-type]
