"""The codec of PostGIS rasters, against PostGIS itself and against GDAL's own driver."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
import rasterio
from hypothesis import given
from hypothesis import strategies as st

import postgis
from swathe.errors import InvalidParameterError, UnreadableFileError
from swathe.store.raster_wkb import HEADER_BYTES, RasterTile, decode, encode

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

DTYPES = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")
POSTGIS_TYPES = {
    "1BB": "u1", "2BUI": "u1", "4BUI": "u1", "8BSI": "i1", "8BUI": "u1", "16BSI": "i2", "16BUI": "u2", "32BSI": "i4",
    "32BUI": "u4", "32BF": "f4", "64BF": "f8",
}  # fmt: skip
SHAPES = arrays.array_shapes(min_dims=2, max_dims=2, max_side=9)


def same_bits(one: NDArray[Any], other: NDArray[Any]) -> bool:
    return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()


@given(
    arrays.arrays(st.sampled_from(DTYPES), SHAPES),
    st.floats(-1e7, 1e7),
    st.floats(1e-3, 1e4),
    st.integers(0, 999_999),
    st.none() | st.just(0.0) | st.just(float("nan")),
)
def test_what_was_written_is_read_bit_for_bit(
    pixels: NDArray[Any], corner: float, cell: float, srid: int, nodata: float | None
) -> None:
    if nodata is not None and np.isnan(nodata) and pixels.dtype.kind != "f":
        nodata = 0.0
    read = decode(encode(RasterTile(pixels, corner, -corner, cell, -cell, srid, nodata)))
    assert same_bits(read.pixels, pixels)
    assert (read.west, read.north, read.scale_x, read.scale_y, read.srid) == (corner, -corner, cell, -cell, srid)
    assert read.nodata == nodata or (nodata is not None and np.isnan(nodata) and np.isnan(read.nodata or 0))


@given(st.binary(max_size=200))
def test_no_bytes_are_too_strange(noise: bytes) -> None:
    for wkb in (noise, encode(RasterTile(np.zeros((2, 3), "f4"), 0, 0, 1, -1))[:61] + noise):
        with contextlib.suppress(UnreadableFileError):
            decode(wkb)


@pytest.mark.parametrize("length", [0, 1, 60, 61, 62, 65, 80])
def test_a_tile_that_is_cut_short_is_refused(length: int) -> None:
    whole = encode(RasterTile(np.ones((4, 4), "f4"), 0, 0, 1, -1, nodata=float("nan")))
    assert len(whole) == HEADER_BYTES + 5 + 64
    with pytest.raises(UnreadableFileError, match="cut short"):
        decode(whole[:length])


@pytest.mark.parametrize(
    "pixels", [np.zeros(4, "f4"), np.zeros((2, 2), "f2"), np.zeros((2, 2), "c8"), np.zeros((1, 65_536), "u1")]
)
def test_what_no_raster_can_hold_is_refused(pixels: NDArray[Any]) -> None:
    with pytest.raises(InvalidParameterError):
        encode(RasterTile(pixels, 0, 0, 1, -1))


def test_postgis_sees_what_we_wrote_and_we_read_what_it_wrote(
    postgis_cluster: postgis.Cluster, postgis_database: str
) -> None:
    pixels = np.array([[1.5, np.nan, -3.25], [1e-30, 3e38, 0.1]], dtype="f4")
    ours = encode(RasterTile(pixels, 500_000, 5_000_000, 10, -10, 32632, float("nan")))
    with postgis_cluster.connect(postgis_database) as connection:
        seen = connection.execute(
            "WITH given AS (SELECT ST_RastFromWKB(%s) AS r) SELECT ST_Width(r), ST_Height(r), ST_SRID(r), "
            "ST_UpperLeftX(r), ST_UpperLeftY(r), ST_ScaleX(r), ST_ScaleY(r), ST_Value(r, 1, 1), ST_Value(r, 2, 1), "
            "ST_Value(r, 3, 2), ST_Count(r) FROM given",
            (ours,),
        ).fetchone()
        assert seen == (3, 2, 32632, 500_000, 5_000_000, 10, -10, 1.5, None, float(pixels[1, 2]), 5)
        for kind, dtype in POSTGIS_TYPES.items():
            made = connection.execute(
                "SELECT ST_AsBinary(ST_SetValue(ST_AddBand(ST_MakeEmptyRaster(3, 2, 7, 9, 2, -2, 0, 0, 32632), "
                "%s::text, 1, NULL::float8), 2, 1, 0))",
                (kind,),
            ).fetchone()
            assert made is not None
            theirs = decode(made[0])
            assert theirs.pixels.dtype == dtype
            assert theirs.pixels.tolist() == [[1, 0, 1], [1, 1, 1]]
            assert (theirs.west, theirs.north, theirs.scale_x, theirs.srid, theirs.nodata) == (7, 9, 2, 32632, None)
        back = connection.execute("SELECT ST_AsBinary(ST_RastFromWKB(%s))", (ours,)).fetchone()
        assert back is not None
        assert bytes(back[0]) == ours


def test_gdal_reads_our_rasters_bit_for_bit(
    postgis_cluster: postgis.Cluster, postgis_database: str, tmp_path: Path
) -> None:
    rows, columns, side = 300, 500, 128
    heights = np.random.default_rng(5).normal(300, 60, (rows, columns)).astype("f4")
    heights[40:90, 100:300] = np.nan
    with postgis_cluster.connect(postgis_database) as connection:
        connection.execute("CREATE TABLE ground (rid serial PRIMARY KEY, rast raster)")
        for row in range(0, rows, side):
            for column in range(0, columns, side):
                part = heights[row : row + side, column : column + side]
                tile = RasterTile(part, 5e5 + 10 * column, 5e6 - 10 * row, 10, -10, 32632, float("nan"))
                connection.execute("INSERT INTO ground (rast) VALUES (ST_RastFromWKB(%s))", (encode(tile),))
    where = "schema=public table=ground column=rast mode=2"
    with rasterio.open(postgis.read_with_gdal(postgis_cluster, postgis_database, where, tmp_path)) as seen:
        assert seen.transform.to_gdal() == (5e5, 10, 0, 5e6, 0, -10)
        assert seen.crs.to_epsg() == 32632
        assert same_bits(seen.read(1), heights)
