"""Regions and layers as rows of the database."""

from __future__ import annotations

import difflib
import json
from typing import TYPE_CHECKING, Any, NamedTuple

from swathe.errors import MissingLayerError, MissingRegionError
from swathe.grid import GridGeometry
from swathe.io.crs import Frame
from swathe.store.interface import LayerInfo, Provenance, RegionInfo
from swathe.store.naming import checked_name
from swathe.store.queries import query

if TYPE_CHECKING:
    from swathe.store.postgis_server import Connection


class RegionRow(NamedTuple):
    """What writers and readers need of a region."""

    id: int
    name: str
    srid: int
    rows: int
    columns: int
    cell_size_m: float
    west_m: float
    north_m: float
    revision: int

    @property
    def geometry(self) -> GridGeometry:
        """Its cells."""
        return GridGeometry(self.rows, self.columns, self.cell_size_m, self.west_m, self.north_m)


def region_row(connection: Connection, name: str) -> RegionRow:
    """Return the row of a region.

    Raises:
        MissingRegionError: there is none of this name.
    """
    found = connection.execute(query("read_region"), (checked_name(name),)).fetchone()
    if found is None:
        raise missing_region(connection, name)
    return RegionRow(*found)


def missing_region(connection: Connection, name: str) -> MissingRegionError:
    """Return the error for a region that is not there."""
    names = [str(row[0]) for row in connection.execute(query("list_regions"))]
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.0)
    remedy = f"Name one of {', '.join(map(repr, near))}." if near else "Import an elevation first."
    return MissingRegionError(f"The store has no region {name!r}.", remedy)


def missing_layer(region: str, layer: str) -> MissingLayerError:
    """Return the error for a layer that is not there."""
    return MissingLayerError(f"The region {region!r} has no {layer} of this kind.", "Import it with `swathe import`.")


def read_regions(connection: Connection, name: str | None = None) -> list[RegionInfo]:
    """Return all regions, or the one of a name, with their finished layers."""
    regions: dict[int, RegionInfo] = {}
    for row in connection.execute(query("read_regions"), {"name": name}):
        number, title, crs_wkt, _, rows, columns, size_m, west_m, north_m, origin_x, origin_y, unit_m, _, *layer = row
        if number not in regions:
            geometry = GridGeometry(rows, columns, size_m, west_m, north_m)
            regions[number] = RegionInfo(title, Frame(geometry, crs_wkt, (origin_x, origin_y), unit_m), {})
        if layer[0] is not None:
            info = _layer_info(layer)
            layers = regions[number].layers
            assert isinstance(layers, dict)  # noqa: S101 - made above
            layers[info.name] = info
    return list(regions.values())


def _layer_info(row: list[Any]) -> LayerInfo:
    name, kind, dtype, inputs, crs, licence, author, time, options, details = row
    files = tuple((str(file), str(sha256)) for file, sha256 in inputs)
    return LayerInfo(name, kind, dtype, Provenance(files, crs, licence, author, time, options), details)


def region_values(name: str, frame: Frame, srid: int) -> dict[str, Any]:
    """Return the values of a region's row."""
    geometry = frame.geometry
    return {
        "name": name,
        "crs_wkt": frame.crs_wkt,
        "srid": srid,
        "rows": geometry.rows,
        "columns": geometry.columns,
        "cell_size_m": geometry.cell_size_m,
        "west_m": geometry.west_m,
        "north_m": geometry.north_m,
        "file_origin_x": frame.file_origin[0],
        "file_origin_y": frame.file_origin[1],
        "file_unit_m": frame.file_unit_m,
    }


def layer_values(region_id: int, layer: LayerInfo) -> dict[str, Any]:
    """Return the values of a layer's row."""
    provenance = layer.provenance
    return {
        "region": region_id,
        "name": layer.name,
        "kind": layer.kind,
        "dtype": layer.dtype,
        "digest": provenance.digest,
        "inputs": json.dumps(provenance.inputs),
        "crs": provenance.crs,
        "licence": provenance.licence,
        "author": provenance.author,
        "time": provenance.time,
        "options": json.dumps(dict(provenance.options)),
        "details": json.dumps(dict(layer.details)),
    }
