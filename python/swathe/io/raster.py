"""Writing layers as cloud optimised GeoTIFF: the same layer always gives the same bytes."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from affine import Affine
from rasterio.crs import CRS
from rasterio.enums import ColorInterp
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.io import MemoryFile

from swathe.errors import InvalidParameterError, OutputError, ShapeMismatchError, UnreadableFileError, UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from swathe.io.crs import Frame

BLOCK_SIZE = 256
# TIFF predictors: differences of bytes for whole numbers, of split bytes for floats; pictures of classes have none.
INTEGER_PREDICTOR, FLOAT_PREDICTOR = "STANDARD", "FLOATING_POINT"


def write_raster(
    path: str | os.PathLike[str],
    array: NDArray[Any],
    frame: Frame,
    *,
    nodata: float | None = None,
    colours: Mapping[int, tuple[int, int, int, int]] | None = None,
    tags: Mapping[str, str] | None = None,
    description: str = "",
) -> None:
    """Write a layer of the shape of ``frame`` (8-, 16-, 32-bit whole numbers, floats or booleans) as a GeoTIFF.

    ``nodata``: the number that means unknown. ``colours``: red, green, blue, opacity (0..255) of values of a uint8
    layer. ``tags`` and ``description`` are kept in the file. Overviews take the nearest value of whole numbers, which
    are classes, and the mean of floats. The file appears whole or not at all. Raises OutputError when it cannot be
    written, ShapeMismatchError and InvalidParameterError for a layer that does not fit.
    """
    layer = _checked(array, frame, colours)
    target = Path(path)
    if not target.parent.is_dir():
        raise OutputError(f"The folder {target.parent} does not exist.", "Make it, or choose another `--out`.")
    # The process number keeps two writers of one file apart.
    part = target.with_name(f".{target.name}.{os.getpid()}.part")
    geometry = frame.geometry
    is_float = layer.dtype.kind == "f"
    profile = {
        "driver": "COG",
        "height": geometry.rows,
        "width": geometry.columns,
        "count": 1,
        "dtype": layer.dtype.name,
        "nodata": nodata,
        "crs": None if frame.crs_wkt is None else CRS.from_wkt(frame.crs_wkt),
        "transform": Affine(geometry.cell_size_m, 0, geometry.west_m, 0, -geometry.cell_size_m, geometry.north_m),
        "compress": "DEFLATE",
        "predictor": FLOAT_PREDICTOR if is_float else ("NO" if colours else INTEGER_PREDICTOR),
        "blocksize": BLOCK_SIZE,
        "overview_resampling": "AVERAGE" if is_float else "NEAREST",
        "bigtiff": "IF_SAFER",
    }
    # Made in memory first: GDAL finds a full disk only while closing, and is silent about it.
    with MemoryFile() as memory:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with memory.open(**profile) as dataset:
                dataset.write(layer, 1)
                if colours:
                    dataset.write_colormap(1, dict(colours))
                if tags:
                    dataset.update_tags(**tags)
                if description:
                    dataset.set_band_description(1, description)
        try:
            part.write_bytes(memory.getbuffer())
            part.replace(target)
        except OSError as error:
            raise OutputError(
                f"{target.name} cannot be written in {target.parent}.",
                "Check permissions and free space, or choose another `--out`.",
            ) from error
        finally:
            part.unlink(missing_ok=True)


def read_frame(path: str | os.PathLike[str]) -> tuple[Frame, dict[int, tuple[int, int, int, int]]]:
    """Return the frame of a raster that ``write_raster`` wrote, and the colours of its values (none without a table).

    Raises UnreadableFileError when it is no raster, or none of ours.
    """
    import rasterio

    from swathe.grid import GridGeometry
    from swathe.io.crs import Frame

    name = Path(path).name
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path) as dataset:
                place = dataset.transform
                geometry = GridGeometry(dataset.height, dataset.width, place.a, place.c, place.f)
                wkt = dataset.crs.to_wkt() if dataset.crs else None
                colours = dataset.colormap(1) if dataset.colorinterp[0] == ColorInterp.palette else {}
    except (RasterioError, UsageError) as error:
        raise UnreadableFileError(f"{name} cannot be read as a raster of a run.", "Make the run again.") from error
    return Frame(geometry, wkt), {int(value): tuple(colour) for value, colour in colours.items()}


def _checked(
    array: NDArray[Any], frame: Frame, colours: Mapping[int, tuple[int, int, int, int]] | None
) -> NDArray[Any]:
    layer = np.asarray(array)
    if layer.shape != frame.geometry.shape:
        raise ShapeMismatchError(
            f"A layer of shape {layer.shape} does not fit a frame of {frame.geometry.shape}.", "Give the frame's shape."
        )
    if layer.dtype == np.bool_:
        layer = layer.astype(np.uint8)
    if layer.dtype.kind not in "iuf" or layer.dtype.name == "float16":
        raise InvalidParameterError(f"A layer of {layer.dtype} cannot be written.", "Give numbers of 8 to 64 bits.")
    if colours and layer.dtype != np.uint8:
        raise InvalidParameterError(f"A layer of {layer.dtype} cannot have a colour table.", "Give uint8.")
    return np.ascontiguousarray(layer)
