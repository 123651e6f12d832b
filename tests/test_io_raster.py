"""Writing layers: whole or not at all, and always the same bytes."""

from __future__ import annotations

import resource
from typing import TYPE_CHECKING, Any

import numpy as np
import pyproj
import pytest
import rasterio

from swathe.errors import InvalidParameterError, OutputError, ShapeMismatchError
from swathe.grid import GridGeometry
from swathe.io.crs import Frame
from swathe.io.elevation import open_elevation
from swathe.io.raster import write_raster

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

FRAME = Frame(GridGeometry(600, 700, 5.0, 740_000.0, 4_050_000.0), pyproj.CRS("EPSG:32616").to_wkt())
COLOURS = {value: (20 * value, 255 - 20 * value, 0, 0 if value == 0 else 255) for value in range(11)}


def ranks() -> NDArray[np.uint8]:
    return np.random.default_rng(3).integers(0, 11, FRAME.geometry.shape, dtype=np.uint8)


def test_a_layer_comes_back_with_all_that_was_said_of_it(tmp_path: Path) -> None:
    path = tmp_path / "rank.tif"
    write_raster(path, ranks(), FRAME, nodata=0, colours=COLOURS, tags={"SWATHE_SEED": "0"}, description="rank")
    with rasterio.open(path) as dataset:
        np.testing.assert_array_equal(dataset.read(1), ranks())
        assert dataset.crs.to_epsg() == 32616
        assert dataset.transform[:6] == (5, 0, 740_000, 0, -5, 4_050_000)
        assert dataset.nodata == 0
        assert dataset.tags()["SWATHE_SEED"] == "0"
        assert dataset.descriptions == ("rank",)
        assert {value: dataset.colormap(1)[value] for value in COLOURS} == COLOURS
        assert dataset.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert dataset.tags(ns="IMAGE_STRUCTURE")["COMPRESSION"] == "DEFLATE"
        assert dataset.block_shapes == [(256, 256)]
        assert dataset.overviews(1) == [2, 4]
    assert [file.name for file in tmp_path.iterdir()] == ["rank.tif"]


def test_overviews_never_mix_classes_and_average_floats(tmp_path: Path) -> None:
    layer = np.where(ranks() > 5, 10, 2).astype(np.uint8)
    write_raster(tmp_path / "classes.tif", layer, FRAME)
    write_raster(tmp_path / "heights.tif", layer.astype(np.float32), FRAME)
    with rasterio.open(tmp_path / "classes.tif", overview_level=0) as overview:
        assert set(np.unique(overview.read(1))) == {2, 10}
    with rasterio.open(tmp_path / "heights.tif", overview_level=0) as overview:
        means = layer.astype(np.float32).reshape(300, 2, 350, 2).mean(axis=(1, 3))
        np.testing.assert_allclose(overview.read(1), means, rtol=1e-6)


def test_the_same_layer_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.tif", "b.tif"):
        write_raster(tmp_path / name, ranks(), FRAME, nodata=0, colours=COLOURS, tags={"a": "1", "b": "2"})
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()


@pytest.mark.parametrize("dtype", ["uint8", "int16", "uint16", "int32", "uint32", "float32", "float64", "bool"])
def test_every_kind_of_number_survives(tmp_path: Path, dtype: str) -> None:
    layer = (ranks() / 2 > 2 if dtype == "bool" else ranks() / 2).astype(dtype)
    write_raster(tmp_path / "layer.tif", layer, FRAME)
    with rasterio.open(tmp_path / "layer.tif") as dataset:
        np.testing.assert_array_equal(dataset.read(1), layer)


def test_what_was_written_is_read_as_elevation_again(tmp_path: Path) -> None:
    heights = np.linspace(0, 900, 600 * 700, dtype=np.float32).reshape(600, 700)
    heights[5, 5] = np.nan
    write_raster(tmp_path / "dem.tif", heights, FRAME, nodata=float("nan"))
    with open_elevation([str(tmp_path / "dem.tif")]) as source:
        assert source.frame.geometry == FRAME.geometry
        np.testing.assert_array_equal(source.read(), heights)


def test_a_local_frame_is_written_without_a_system(tmp_path: Path) -> None:
    write_raster(tmp_path / "local.tif", np.ones((3, 4), np.uint8), Frame(GridGeometry(3, 4, 2.0, 0.0, 6.0)))
    with rasterio.open(tmp_path / "local.tif") as dataset:
        assert dataset.crs is None
        assert dataset.transform[:6] == (2, 0, 0, 0, -2, 6)


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    cases: list[tuple[Any, type[Exception], dict[str, Any]]] = [
        (np.ones((3, 4), np.uint8), ShapeMismatchError, {}),
        (np.ones(FRAME.geometry.shape, np.complex64), InvalidParameterError, {}),
        (np.ones(FRAME.geometry.shape, np.float32), InvalidParameterError, {"colours": COLOURS}),
    ]
    for layer, kind, options in cases:
        with pytest.raises(kind):
            write_raster(tmp_path / "layer.tif", layer, FRAME, **options)
    with pytest.raises(OutputError, match="does not exist"):
        write_raster(tmp_path / "nowhere" / "layer.tif", ranks(), FRAME)
    assert list(tmp_path.iterdir()) == []


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "rank.tif"
    write_raster(path, np.zeros_like(ranks()), FRAME)
    before = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))  # as if the disk were full after 1000 bytes
    try:
        with pytest.raises(OutputError, match=r"rank\.tif"):
            write_raster(path, ranks(), FRAME)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["rank.tif"]
