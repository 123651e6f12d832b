"""Filling a store: elevation, soil, zones and readings from anything that a plan reads.

What is imported is read in pieces, so that memory stays flat. The same source twice is no change; an import that was
broken off goes on where it stopped.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.errors import AllVoidError, InterruptedBySignalError, InvalidParameterError
from swathe.grid import Window
from swathe.io.elevation import open_elevation
from swathe.io.readings import read_readings
from swathe.io.soil_intake import PolygonSoil, RasterSoil, open_soil
from swathe.io.sources import BUNDLED_PREFIX, single
from swathe.io.tiled_raster import small_cache
from swathe.io.zones import ZonePolygons
from swathe.store.interface import ELEVATION, SOIL, TILE_SIZE, Provenance, SoilPolygon, StoredReading, Zone
from swathe.store.soil import legend_details

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from swathe.store.interface import ImportSession, TerrainStore

    OnProgress = Callable[[str, int, int], bool]

#: Files that belong to a vector or raster and are named like it.
_BESIDE = (".dbf", ".prj", ".cpg", ".qpj", ".tfw", ".aux.xml")
_CHUNK_BYTES = 1 << 20


def import_elevation(
    store: TerrainStore,
    region: str,
    sources: Sequence[str],
    *,
    cell_size_m: float | None = None,
    crs: str | None = None,
    height_range_m: tuple[float, float] | None = None,
    licence: str = "",
    author: str = "",
    on_progress: OnProgress | None = None,
) -> dict[str, Any]:
    """Import elevation, which makes the region when it is not there, and return what was done.

    ``sources`` to ``height_range_m`` are those of ``swathe.io.elevation.open_elevation``.

    Raises:
        SwatheError: a source cannot be used, the region lies on other cells, or the user stopped.
    """
    with (
        small_cache(),
        open_elevation(sources, cell_size_m=cell_size_m, crs=crs, height_range_m=height_range_m) as source,
    ):
        _tell(on_progress, "checking", 0, 1)
        options = _options(
            cell_size="" if cell_size_m is None else repr(float(cell_size_m)),
            crs=crs or "",
            height_range="" if height_range_m is None else f"{height_range_m[0]!r},{height_range_m[1]!r}",
        )
        inputs = tuple(source.fingerprint().items())
        provenance = Provenance(inputs, source.source_crs_wkt or "", licence, author, options=options)
        details = {
            "source_crs_wkt": source.source_crs_wkt,
            "warped": source.warped,
            "native_cell_size_m": source.native_cell_size_m,
            "height_range_m": None if height_range_m is None else [float(height) for height in height_range_m],
        }
        store.create_region(region, source.frame)
        with store.begin_import(region, ELEVATION, provenance, details=details) as session:
            if session.is_current:
                return _done(ELEVATION, region, inputs, changed=False)
            bands = _bands(source.frame.geometry.shape)
            if not _write_bands(session, bands, source.read, on_progress, "importing elevation"):
                session.abort()
                raise AllVoidError(f"{', '.join(source.names)} holds no known elevation.", "Choose another file.")
            _tell(on_progress, "compressing", 0, 1)
            session.commit()
        rows, columns = source.frame.geometry.shape
        return _done(ELEVATION, region, inputs, changed=True, rows=rows, columns=columns)


def import_soil(
    store: TerrainStore,
    region: str,
    source: str,
    *,
    field: str | None = None,
    legend: str | None = None,
    licence: str = "",
    author: str = "",
    on_progress: OnProgress | None = None,
) -> dict[str, Any]:
    """Import a soil map, polygons or a raster, and return what was done.

    ``source``, ``field`` and ``legend`` are those of ``swathe.io.soil.read_soil``.

    Raises:
        SwatheError: the source cannot be used, there is no such region, or the user stopped.
    """
    info = store.region(region)
    _tell(on_progress, "checking", 0, 1)
    soil = open_soil(source, info.frame, field=field, legend=legend)
    name, sha256 = soil.source.name, soil.source.fingerprint()
    options = _options(
        field=field or "",
        legend="" if legend is None else _sha256(Path(legend).expanduser()),
        beside=_beside(soil.source.path),
        layer=source.partition("|layername=")[2],
    )
    values = len(soil.values)
    if isinstance(soil, PolygonSoil):
        provenance = Provenance(((name, sha256),), soil.crs_wkt or "", licence, author, options=options)
        details = legend_details(name, soil.field, soil.values, soil.meanings)
        changed = store.write_soil_polygons(region, _soil_batches(soil, on_progress), provenance, details=details)
        return _done(
            SOIL, region, provenance.inputs, changed=changed, values=values, features=soil.count, left_out=soil.left_out
        )
    provenance = Provenance(((name, sha256),), "", licence, author, options=options)
    details = legend_details(soil.name, None, soil.values, soil.meanings)
    with small_cache(), store.begin_import(region, SOIL, provenance, dtype=np.uint16, details=details) as session:
        if not session.is_current:
            _write_raster_soil(session, soil, info.frame.geometry.rows, on_progress)
        changed = not session.is_current
        session.commit()
    return _done(SOIL, region, provenance.inputs, changed=changed, values=values)


def import_zones(
    store: TerrainStore,
    region: str,
    source: str,
    *,
    licence: str = "",
    author: str = "",
    on_progress: OnProgress | None = None,
) -> dict[str, Any]:
    """Import polygons that are closed to every vehicle, and return what was done.

    ``source`` is any vector; one layer of it is named by ``PATH|layername=NAME``.

    Raises:
        SwatheError: the source cannot be used, there is no such region, or the user stopped.
    """
    path, _, layer = source.partition("|layername=")
    file = single(path)
    polygons = ZonePolygons(file, layer or None, store.region(region).frame)
    provenance = Provenance(
        ((file.name, polygons.source.fingerprint()),),
        polygons.crs_wkt or "",
        licence,
        author,
        options=_options(beside=_beside(file.path), layer=layer),
    )

    def batches() -> Iterator[list[Zone]]:
        done = 0
        for batch in polygons.batches():
            done += len(batch)
            _tell(on_progress, "importing zones", done, polygons.count)
            yield [Zone(wkb, name, attributes) for wkb, name, attributes in batch]

    changed = store.write_zones(region, batches(), provenance, details={"source": file.name})
    return _done("zones", region, provenance.inputs, changed=changed, left_out=polygons.left_out)


def import_readings(
    store: TerrainStore,
    region: str,
    source: str,
    *,
    points_crs: str | None = None,
    author: str = "",
    instrument: str = "",
    error: float | None = None,
    time: str = "",
) -> dict[str, Any]:
    """File the readings of a CSV (``swathe.io.readings``) and return what was done.

    Args:
        store: where to.
        region: the region they lie in.
        source: the file.
        points_crs: what columns ``x,y`` are in.
        author: who took them.
        instrument: with what.
        error: standard deviation of the cone index over the cone index.
        time: when, ISO 8601; by default when the file was last changed.

    Raises:
        SwatheError: the file cannot be used, or a reading lies outside the region.
    """
    info = store.region(region)
    layer = info.layers.get(ELEVATION)
    native = None if layer is None else layer.details.get("source_crs_wkt")
    file = Path(source).expanduser()
    taken = read_readings(file, info.frame, points_crs=points_crs, source_crs_wkt=native)
    digest = _sha256(file)
    when = _utc(time) if time else _changed_at(file)
    stored = [
        # The same line of the same file is the same reading, however often it is imported.
        StoredReading(f"{digest[:16]}-{number}", reading, author, when, instrument, error)
        for number, reading in enumerate(taken, start=1)
    ]
    new = store.add_readings(region, stored)
    return _done("readings", region, ((file.name, digest),), changed=new > 0, readings=len(stored), new=new)


def _write_bands(
    session: ImportSession,
    bands: Sequence[Window],
    read: Callable[[Window], NDArray[np.float32]],
    on_progress: OnProgress | None,
    stage: str,
) -> bool:
    """Write what is not there yet, a row of tiles at a time, and return whether any cell is known."""
    have = session.have()
    known = bool(have)
    for done, window in enumerate(bands):
        _tell(on_progress, stage, done, len(bands))
        row = window.row // TILE_SIZE
        missing = [column for column in range(-(-window.columns // TILE_SIZE)) if (row, column) not in have]
        if missing:
            band = read(window)
            known = known or not bool(np.isnan(band).all())
            for column in missing:
                session.write_tile(row, column, band[:, column * TILE_SIZE : (column + 1) * TILE_SIZE])
    return known


def _write_raster_soil(session: ImportSession, soil: RasterSoil, rows: int, on_progress: OnProgress | None) -> None:
    have = session.have()
    for window, numbers in soil.bands(TILE_SIZE):
        for top in range(0, window.rows, TILE_SIZE):
            _tell(on_progress, "importing soil", window.row + top, rows)
            row = (window.row + top) // TILE_SIZE
            for column in range(-(-window.columns // TILE_SIZE)):
                if (row, column) not in have:
                    left = column * TILE_SIZE
                    session.write_tile(row, column, numbers[top : top + TILE_SIZE, left : left + TILE_SIZE])


def _soil_batches(soil: PolygonSoil, on_progress: OnProgress | None) -> Iterator[list[SoilPolygon]]:
    done = 0
    for batch in soil.batches():
        _tell(on_progress, "importing soil", done, soil.count)
        done += len(batch)
        yield [
            SoilPolygon(wkb, value, meaning.soil_class, cat, attributes)
            for wkb, value, meaning, cat, attributes in batch
        ]


def _bands(shape: tuple[int, int]) -> list[Window]:
    rows, columns = shape
    return [Window(top, 0, min(TILE_SIZE, rows - top), columns) for top in range(0, rows, TILE_SIZE)]


def _done(
    what: str,
    region: str,
    inputs: Sequence[tuple[str, str]],
    *,
    changed: bool,
    **more: Any,  # noqa: ANN401
) -> dict[str, Any]:
    listed = [{"name": name, "sha256": sha256} for name, sha256 in inputs]
    status = "done" if changed else "no_change"
    return {"command": "import", "status": status, "what": what, "region": region, "inputs": listed, **more}


def _options(**options: str) -> dict[str, str]:
    return {name: value for name, value in options.items() if value}


def _beside(path: str) -> str:
    """Return the SHA-256 of the files that belong to a vector or raster, empty without any."""
    if path.startswith(BUNDLED_PREFIX):
        return ""
    file = Path(path)
    digest = hashlib.sha256()
    found = False
    for suffix in _BESIDE:
        for other in (file.with_suffix(suffix), Path(f"{path}{suffix}")):
            if other.is_file() and other != file:
                digest.update(suffix.encode() + _sha256(other).encode())
                found = True
    return digest.hexdigest() if found else ""


def _sha256(file: Path) -> str:
    digest = hashlib.sha256()
    with file.open("rb") as content:
        while chunk := content.read(_CHUNK_BYTES):
            digest.update(chunk)
    return digest.hexdigest()


def _changed_at(file: Path) -> str:
    from datetime import UTC, datetime

    return datetime.fromtimestamp(file.stat().st_mtime, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _utc(text: str) -> str:
    from datetime import UTC, datetime

    try:
        when = datetime.fromisoformat(text)
    except ValueError as error:
        raise InvalidParameterError(f"{text!r} is no time.", "Write it like 2026-05-01T12:00:00Z.") from error
    if when.tzinfo is None:
        when = when.replace(tzinfo=UTC)
    return when.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _tell(on_progress: OnProgress | None, stage: str, done: int, total: int) -> None:
    # Only False stops: a callback that returns nothing means "go on".
    if on_progress is not None and on_progress(stage, done, total) is False:
        raise InterruptedBySignalError("The import was stopped.", "Give the same command again to go on.")
