"""Reading heights that fit as they are, from every kind of file, and refusing what is no elevation."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from affine import Affine

from raster_files import CELL, NORTH, UTM16, WEST, hills, write
from swathe.errors import (
    AllVoidError,
    InterruptedBySignalError,
    InvalidCrsError,
    InvalidParameterError,
    MissingCrsError,
    MissingFileError,
    NotElevationError,
    OutsideGridError,
    SwatheError,
    TooSmallError,
    UnreadableFileError,
)
from swathe.grid import GridGeometry, Window
from swathe.io.elevation import open_elevation, require_known

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


def read(*paths: Path | str, **options: Any) -> NDArray[np.float32]:
    with open_elevation([str(path) for path in paths], **options) as source:
        return source.read()


def test_a_metric_square_north_up_raster_is_handed_through_bit_by_bit(tmp_path: Path) -> None:
    heights = hills(600, 300)
    path = write(tmp_path / "dem.tif", heights, tiled=True, blockxsize=128, blockysize=128, compress="deflate")
    with open_elevation([str(path)]) as source:
        assert source.frame.geometry == GridGeometry(600, 300, CELL, WEST, NORTH)
        assert source.frame.name == "WGS 84 / UTM zone 16N"
        assert not source.warped
        assert not source.grey
        assert source.native_cell_size_m == CELL
        assert source.names == ("dem.tif",)
        assert source.fingerprint() == {"dem.tif": hashlib.sha256(path.read_bytes()).hexdigest()}
        np.testing.assert_array_equal(source.read(), heights)
        np.testing.assert_array_equal(source.read(Window(250, 7, 300, 20)), heights[250:550, 7:27])


@pytest.mark.parametrize("dtype", ["uint8", "int16", "uint16", "int32", "float32", "float64"])
def test_whole_numbers_and_floats_are_metres(tmp_path: Path, dtype: str) -> None:
    heights = (hills(20, 20) / 4).astype(dtype)
    np.testing.assert_array_equal(read(write(tmp_path / "dem.tif", heights)), heights.astype(np.float32))


def test_a_south_up_raster_is_turned_over(tmp_path: Path) -> None:
    heights = hills(40, 30)
    path = write(
        tmp_path / "south_up.tif", heights[::-1].copy(), transform=Affine(CELL, 0, WEST, 0, CELL, NORTH - 40 * CELL)
    )
    with open_elevation([str(path)]) as source:
        assert source.frame.geometry == GridGeometry(40, 30, CELL, WEST, NORTH)
        np.testing.assert_array_equal(source.read(), heights)
        np.testing.assert_array_equal(source.read(Window(3, 2, 9, 8)), heights[3:12, 2:10])


@pytest.mark.parametrize(
    ("numbers", "options"),
    [
        (np.float32(-9999), {"nodata": -9999}),
        (np.float32(-1e10), {"nodata": -1e10}),
        (np.float32(np.nan), {}),
        (np.float32(np.inf), {}),
        (np.float32(-np.inf), {}),
        (np.float32(-3.4e38), {}),
        (np.float64(-1.7e308), {}),
        (np.float32(-9999), {}),
        (np.float32(30_000), {}),
        (np.int16(-32768), {}),
        (np.int16(12), {"nodata": 12}),
        (np.int32(2**31 - 1), {}),
    ],
)
def test_what_is_no_height_is_unknown_and_nothing_else_is(tmp_path: Path, numbers: Any, options: Any) -> None:
    heights = hills(10, 10).astype(numbers.dtype)
    heights[4, 5] = numbers
    found = read(write(tmp_path / "dem.tif", heights, **options))
    assert np.isnan(found[4, 5])
    assert np.isnan(found).sum() == 1


def test_cells_that_a_mask_hides_are_unknown(tmp_path: Path) -> None:
    def prepare(dataset: Any) -> None:
        mask = np.full((10, 10), 255, dtype=np.uint8)
        mask[2, 3] = 0
        dataset.write_mask(mask)

    found = read(write(tmp_path / "dem.tif", hills(10, 10), prepare=prepare))
    assert list(np.argwhere(np.isnan(found))[0]) == [2, 3]


@pytest.mark.parametrize(("unit", "metres"), [("ft", 0.3048), ("US survey foot", 1200 / 3937), ("m", 1.0)])
def test_heights_in_feet_become_metres(tmp_path: Path, unit: str, metres: float) -> None:
    def prepare(dataset: Any) -> None:
        dataset.units = [unit]

    heights = hills(10, 10)
    found = read(write(tmp_path / "feet.tif", heights, prepare=prepare))
    np.testing.assert_allclose(found, heights * metres, rtol=1e-6)


def test_a_vertical_system_in_feet_makes_metres_and_leaves_the_plane_alone(tmp_path: Path) -> None:
    heights = hills(10, 10)
    path = write(tmp_path / "navd88.tif", heights, crs="EPSG:26916+6360")  # NAVD88 height in US survey feet
    with open_elevation([str(path)]) as source:
        assert source.frame.geometry == GridGeometry(10, 10, CELL, WEST, NORTH)
        np.testing.assert_allclose(source.read(), heights * 1200 / 3937, rtol=1e-6)


def test_scale_and_offset_of_a_band_count(tmp_path: Path) -> None:
    def prepare(dataset: Any) -> None:
        dataset.scales, dataset.offsets = [0.1], [100.0]

    numbers = np.arange(100, dtype=np.int16).reshape(10, 10)
    found = read(write(tmp_path / "packed.tif", numbers, prepare=prepare))
    np.testing.assert_allclose(found, numbers * 0.1 + 100, rtol=1e-6)


def test_the_band_that_is_named_as_elevation_is_taken(tmp_path: Path) -> None:
    def prepare(dataset: Any) -> None:
        dataset.descriptions = ["slope", "Elevation [m]", "aspect"]

    heights = hills(10, 10)
    stack = np.stack([heights * 0, heights, heights * 0 + 1])
    np.testing.assert_array_equal(read(write(tmp_path / "stack.tif", stack, prepare=prepare)), heights)


def test_tiles_of_one_lattice_are_put_together_and_the_gap_stays_unknown(tmp_path: Path) -> None:
    heights = hills(90, 90)
    for row in range(3):
        for column in range(3):
            if (row, column) != (1, 1):
                part = heights[row * 30 : row * 30 + 30, column * 30 : column * 30 + 30]
                place = Affine(CELL, 0, WEST + column * 30 * CELL, 0, -CELL, NORTH - row * 30 * CELL)
                write(tmp_path / f"tile_{row}{column}.tif", part, transform=place)
    expected = heights.copy()
    expected[30:60, 30:60] = np.nan
    (tmp_path / "readme.txt").write_text("not a raster")
    by_folder = read(tmp_path)
    np.testing.assert_array_equal(by_folder, expected)
    np.testing.assert_array_equal(read(tmp_path / "tile_*.tif"), expected)
    np.testing.assert_array_equal(read(*sorted(tmp_path.glob("*.tif"), reverse=True)), expected)


def test_of_overlapping_tiles_the_first_that_knows_wins(tmp_path: Path) -> None:
    first, second = np.full((10, 10), 1, dtype=np.float32), np.full((10, 10), 2, dtype=np.float32)
    first[0, 0] = np.nan
    a, b = write(tmp_path / "a.tif", first), write(tmp_path / "b.tif", second)
    found = read(a, b)
    assert found[0, 0] == 2
    assert found[0, 1] == 1
    assert read(b, a)[0, 1] == 2


def test_land_cover_beside_elevation_is_not_taken_for_it(tmp_path: Path) -> None:
    write(tmp_path / "a_cover.tif", np.ones((20, 20), dtype=np.uint8))
    write(tmp_path / "b_elevation.tif", hills(20, 20))
    with pytest.raises(NotElevationError, match=r"a_cover\.tif"):
        read(tmp_path)


def test_a_window_reads_only_the_tiles_under_it(tmp_path: Path) -> None:
    paths = []
    for column in range(3):
        place = Affine(CELL, 0, WEST + column * 30 * CELL, 0, -CELL, NORTH)
        paths.append(write(tmp_path / f"{column}.tif", hills(30, 30), transform=place))
    with open_elevation([str(path) for path in paths]) as source:
        source.close()
        paths[2].unlink()  # would be missed if it were touched
        np.testing.assert_array_equal(source.read(Window(0, 0, 30, 60)), np.hstack([hills(30, 30)] * 2))


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_a_grey_picture_becomes_heights_in_a_local_frame(tmp_path: Path, bits: int, suffix: str) -> None:
    white = 2**bits - 1
    grey = np.linspace(0, white, 12).round().astype(f"uint{bits}").reshape(3, 4)
    path = write(
        tmp_path / f"grey.{suffix}", grey, crs=None, transform=None, driver={"png": "PNG", "tif": "GTiff"}[suffix]
    )
    with open_elevation([str(path)], cell_size_m=5.0, height_range_m=(100.0, 355.0)) as source:
        assert source.grey
        assert source.frame.geometry == GridGeometry(3, 4, 5.0, 0.0, 15.0)
        assert source.frame.name == "local metric frame"
        assert not source.frame.has_lonlat
        np.testing.assert_allclose(source.read(), 100 + grey.astype(float) / white * 255, rtol=1e-6)


def test_transparent_cells_of_a_grey_picture_are_unknown(tmp_path: Path) -> None:
    grey = np.full((2, 5, 5), 255, dtype=np.uint8)
    grey[1, 2, 2] = 0
    path = write(tmp_path / "alpha.png", grey, crs=None, transform=None, driver="PNG")
    found = read(path, cell_size_m=1.0, height_range_m=(0.0, 10.0))
    assert np.isnan(found[2, 2])
    assert np.nansum(found) == 240


def test_an_ascii_grid_without_a_system_is_local_or_takes_the_one_given(tmp_path: Path) -> None:
    path = tmp_path / "grid.asc"
    rows = "\n".join(" ".join(str(10 * r + c) for c in range(4)) for r in range(5))
    path.write_text(f"ncols 4\nnrows 5\nxllcorner 740000\nyllcorner 4050000\ncellsize 10\nNODATA_value -9999\n{rows}\n")
    with open_elevation([str(path)], cell_size_m=10.0) as source:
        assert source.frame.geometry == GridGeometry(5, 4, 10.0, 0.0, 50.0)
        assert source.frame.file_origin == (740000.0, 4050000.0)
        assert source.read()[1].tolist() == [10, 11, 12, 13]
    with open_elevation([str(path)], crs=UTM16) as source:
        assert source.frame.geometry == GridGeometry(5, 4, 10.0, 740000.0, 4050050.0)
        assert source.frame.has_lonlat
    with pytest.raises(MissingCrsError) as refusal:
        read(path)
    assert "--cell-size" in refusal.value.remedy
    assert "--crs" in refusal.value.remedy


def test_a_degree_grid_that_does_not_say_so_is_warped_once_told(tmp_path: Path) -> None:
    place = Affine(0.001, 0, -84.4, 0, -0.001, 36.7)
    path = write(tmp_path / "degrees.tif", hills(60, 60), crs=None, transform=place)
    with open_elevation([str(path)], crs="EPSG:4326") as source:
        assert source.warped
        assert source.frame.name == "WGS 84 / UTM zone 16N"


def rgb(path: Path) -> Path:
    return write(path / "photo.png", np.zeros((3, 20, 20), dtype=np.uint8), driver="PNG", crs=None, transform=None)


def palette(path: Path) -> Path:
    def prepare(dataset: Any) -> None:
        dataset.write_colormap(1, {1: (255, 0, 0, 255)})

    return write(path / "classes.tif", np.ones((20, 20), dtype=np.uint8), prepare=prepare, photometric="palette")


def complex_numbers(path: Path) -> Path:
    return write(path / "radar.tif", np.ones((20, 20), dtype=np.complex64))


def zero_bytes(path: Path) -> Path:
    (path / "empty.tif").touch()
    return path / "empty.tif"


def text(path: Path) -> Path:
    (path / "notes.tif").write_text("these are not the heights you are looking for")
    return path / "notes.tif"


def cut_in_the_head(path: Path) -> Path:
    whole = write(path / "cut.tif", hills(400, 400))
    whole.write_bytes(whole.read_bytes()[:100])
    return whole


def cut_in_the_data(path: Path) -> Path:
    whole = write(path / "cut.tif", hills(400, 400))
    whole.write_bytes(whole.read_bytes()[:300_000])
    return whole


def grey_without_system(path: Path) -> Path:
    return write(path / "grey.png", np.ones((20, 20), dtype=np.uint8), crs=None, transform=None, driver="PNG")


def heights_without_system(path: Path) -> Path:
    return write(path / "heights.tif", hills(20, 20), crs=None, transform=None)


def thin(path: Path) -> Path:
    return write(path / "thin.tif", hills(2, 500))


def missing(path: Path) -> Path:
    return path / "nowhere.tif"


def empty_folder(path: Path) -> Path:
    return path


def pattern_without_match(path: Path) -> Path:
    return path / "*.hgt"


@pytest.mark.parametrize(
    ("make", "kind", "word"),
    [
        (rgb, NotElevationError, "photo.png"),
        (palette, NotElevationError, "colour table"),
        (complex_numbers, NotElevationError, "complex"),
        (zero_bytes, UnreadableFileError, "empty.tif is empty"),
        (text, UnreadableFileError, "notes.tif"),
        (cut_in_the_head, UnreadableFileError, "cut.tif"),
        (cut_in_the_data, UnreadableFileError, "cut.tif"),
        (grey_without_system, MissingCrsError, "--height-range"),
        (heights_without_system, MissingCrsError, "--cell-size"),
        (thin, TooSmallError, "2 x 500"),
        (missing, MissingFileError, "nowhere.tif does not exist"),
        (empty_folder, MissingFileError, "holds no raster"),
        (pattern_without_match, MissingFileError, "No file matches"),
    ],
)
def test_what_is_no_elevation_is_refused_in_one_line(
    tmp_path: Path, make: Any, kind: type[SwatheError], word: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = make(tmp_path)
    with pytest.raises(kind) as refusal:
        read(path)
    assert word in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert refusal.value.remedy
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        ({"cell_size_m": 0.0}, InvalidParameterError),
        ({"cell_size_m": float("nan")}, InvalidParameterError),
        ({"cell_size_m": 1e6}, TooSmallError),
        ({"crs": "EPSG:999999"}, InvalidCrsError),
        ({"crs": "EPSG:4326"}, InvalidCrsError),
        ({"crs": "EPSG:2264"}, InvalidCrsError),
        ({"height_range_m": (0.0, 10.0)}, InvalidParameterError),
    ],
)
def test_options_that_cannot_be_are_refused(tmp_path: Path, options: Any, kind: type[SwatheError]) -> None:
    with pytest.raises(kind):
        read(write(tmp_path / "dem.tif", hills(50, 50)), **options)


def test_a_reversed_height_range_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidParameterError, match="lowest"):
        read(grey_without_system(tmp_path), cell_size_m=1.0, height_range_m=(10.0, 0.0))


def test_rasters_with_and_without_a_system_do_not_mix(tmp_path: Path) -> None:
    with pytest.raises(MissingCrsError, match=r"heights\.tif"):
        read(write(tmp_path / "dem.tif", hills(20, 20)), heights_without_system(tmp_path))


@pytest.mark.parametrize("window", [Window(-1, 0, 5, 5), Window(0, 0, 51, 5), Window(0, 48, 5, 5), Window(0, 0, 0, 5)])
def test_a_window_must_lie_inside(tmp_path: Path, window: Window) -> None:
    with (
        open_elevation([str(write(tmp_path / "dem.tif", hills(50, 50)))]) as source,
        pytest.raises(OutsideGridError, match="50 rows"),
    ):
        source.read(window)


def test_nothing_known_is_said(tmp_path: Path) -> None:
    found = read(write(tmp_path / "void.tif", np.full((9, 9), -9999, dtype=np.float32), nodata=-9999))
    with pytest.raises(AllVoidError, match=r"void\.tif"):
        require_known(found, "void.tif")
    found[3, 3] = 0
    require_known(found, "void.tif")


def test_reading_tells_how_far_it_is_and_stops_on_request(tmp_path: Path) -> None:
    path = write(tmp_path / "dem.tif", hills(600, 600))
    for options in ({}, {"cell_size_m": 29.0}):
        seen: list[tuple[int, int]] = []
        with open_elevation([str(path)], **options) as source:  # type: ignore[arg-type]
            source.read(on_progress=lambda done, total, seen=seen: seen.append((done, total)) or True)  # type: ignore[misc]
            assert seen[-1] == (9, 9)
            assert seen == sorted(seen)
            with pytest.raises(InterruptedBySignalError):
                source.read(Window(0, 0, 300, 300), on_progress=lambda done, _: done < 2)


def test_files_of_one_name_keep_their_folders(tmp_path: Path) -> None:
    for number, folder in enumerate("ab"):
        (tmp_path / folder).mkdir()
        place = Affine(CELL, 0, WEST + number * 30 * CELL, 0, -CELL, NORTH)
        write(tmp_path / folder / "dem.tif", hills(30, 30), transform=place)
    with open_elevation([str(tmp_path / "*" / "dem.tif")]) as source:
        assert len(set(source.names)) == len(source.fingerprint()) == 2


def test_opening_a_plain_raster_does_not_wake_the_slow_libraries(tmp_path: Path) -> None:
    path = write(tmp_path / "dem.tif", hills(50, 50))
    program = (
        "import sys; from swathe.io.elevation import open_elevation; "
        f"open_elevation([{str(path)!r}]).read(); "
        "print([m for m in ('pyogrio', 'pandas', 'xarray', 'matplotlib', 'shapely', 'scipy') if m in sys.modules])"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout == "[]\n"
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("path", "frame", "range_m", "void_percent"),
    [
        ("dem/SainteHelens.dem", ("NAD27 / UTM zone 10N", (468, 327)), (682, 2543), 2.71),
        ("dem/bigtujunga_30m.tif", ("WGS 84 / UTM zone 11N", (643, 1197)), (315, 2295), 0),
        ("spearfish/spearfish_elevation_dem_30m.tif", ("NAD27 / UTM zone 13N", (477, 634)), (1066, 1840), 3.34),
        ("ebergotzen/ebergotzen_dem_25m.tif", ("DHDN / 3-degree Gauss-Kruger zone 3", (400, 400)), (159, 428), 0),
        (
            "fortbragg/fortbragg_elevation_2012_1m.tif",
            ("NAD83(HARN) / North Carolina", (450, 450)),
            (89.37, 112.71),
            0,
        ),
    ],
)
def test_real_metric_terrain_is_read_as_it_is(
    swathe_data: Path, path: str, frame: tuple[str, Any], range_m: tuple[float, float], void_percent: float
) -> None:
    with open_elevation([str(swathe_data / path)]) as source:
        heights = source.read()
        assert (source.frame.name, source.frame.geometry.shape) == frame
        assert not source.warped
    assert (np.nanmin(heights), np.nanmax(heights)) == pytest.approx(range_m, abs=0.01)
    assert 100 * np.isnan(heights).mean() == pytest.approx(void_percent, abs=0.01)
