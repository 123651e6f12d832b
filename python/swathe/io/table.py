"""Polygons in a table of PostGIS that somebody else keeps: ``postgresql://[USER@]HOST[:PORT]/DB?table=SCHEMA.NAME``.

The geometry column and its system come from the catalogue of PostGIS; ``&geometry=COLUMN`` chooses among several. What
lies near the map is fetched in batches into a temporary GeoPackage, in a transaction that can only read. The password
comes from PGPASSWORD or ``~/.pgpass``, as with every program of PostgreSQL: an address that holds one is refused,
because others on the machine could read it.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import tempfile
import warnings
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn
from urllib.parse import parse_qsl, quote, unquote, urlencode, urlsplit, urlunsplit
from weakref import finalize

import numpy as np

from swathe.errors import (
    InvalidCrsError,
    InvalidParameterError,
    MissingCrsError,
    MissingExtraError,
    NoOverlapError,
    StoreSchemaError,
    StoreUnavailableError,
    UnreadableFileError,
)
from swathe.io.crs import horizontal, parse_crs
from swathe.io.soil_raster import require_system
from swathe.io.soil_vector import box_near
from swathe.io.sources import Source

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from swathe.io.crs import Frame

BATCH_ROWS = 4096
CONNECT_TIMEOUT_S = 10
# A server that has gone silent is given up after about a minute.
KEEPALIVES = {"keepalives_idle": 20, "keepalives_interval": 10, "keepalives_count": 4, "tcp_user_timeout": 60_000}
# Columns of other types name no soil.
FETCHED_AS = {
    **dict.fromkeys(("smallint", "integer", "bigint"), "int8"),
    **dict.fromkeys(("numeric", "real", "double precision"), "float8"),
    **dict.fromkeys(("text", "character", "character varying", "name", "boolean"), "text"),
}
SECRETS = ("password", "sslpassword", "passfile")


@dataclass(frozen=True, slots=True)
class TableAddress:
    """A table of a database; ``connection`` has no password, ``shown`` neither that nor a user."""

    connection: str
    shown: str
    schema: str | None
    table: str
    geometry: str | None

    @property
    def name(self) -> str:
        """The table's name with its schema when that was given."""
        return self.table if self.schema is None else f"{self.schema}.{self.table}"


def table_address(address: str) -> TableAddress:
    """Return the parts of an address. Raises InvalidParameterError, which never repeats a password."""
    try:
        parts = urlsplit(address)
        _ = parts.port
    except ValueError as error:
        raise InvalidParameterError("The address of the soil table cannot be read.", _EXAMPLE) from error
    options = parse_qsl(parts.query, keep_blank_values=True)
    if parts.password is not None or any(name.lower() in SECRETS for name, _ in options):
        raise InvalidParameterError(
            "The address of the soil table holds a password, which others on this machine could read.",
            "Leave it out, and put it into the variable PGPASSWORD or the file ~/.pgpass.",
        )
    chosen = dict(options)
    table = chosen.pop("table", "")
    geometry = chosen.pop("geometry", None)
    names = _split_name(table)
    # The host may be the folder of a socket, given among the options.
    host = parts.hostname or (chosen.get("host", "") if "/" not in chosen.get("host", "") else "")
    shown = f"{parts.scheme}://{host}{parts.path}?table={table}"
    if names is None:
        raise InvalidParameterError(f"{shown} does not name a table.", _EXAMPLE)
    query = urlencode(chosen, quote_via=quote)
    connection = urlunsplit(("postgresql", parts.netloc, parts.path, query, ""))
    schema, table = names
    return TableAddress(connection, shown, schema, table, geometry)


_EXAMPLE = "Write postgresql://USER@HOST/DATABASE?table=SCHEMA.NAME."


def fetch_near(source: Source, frame: Frame, what: str = "soil") -> Source:
    """Return the part of a table near a frame as a file in the table's system, for as long as somebody holds it.

    The same table gives the same polygons in the same order, and the same ``sha256``, whatever the order of its rows.

    Raises:
        StoreUnavailableError: the server does not answer or went away.
        UnreadableFileError: there is no such table, or it may not be read.
        NoOverlapError, MissingCrsError: the table lies elsewhere, or does not say where.
    """
    address = table_address(source.path)
    with _reading(address) as connection:
        schema, geometry, srid, is_geography = _geometry_column(connection, address)
        crs_wkt = _system(connection, address, srid)
        require_system(source, frame, crs_wkt, what)
        near = box_near(frame, crs_wkt)
        fields = _fields(connection, schema, address.table)
        file = _Fetched(crs_wkt, address.table, fields)
        with connection.cursor(name="swathe", binary=True) as cursor:
            cursor.itersize = BATCH_ROWS
            if near is not None:
                statement = _statement(schema, address.table, geometry, fields, is_geography=is_geography)
                cursor.execute(statement, (*near[0], srid))
                while rows := cursor.fetchmany(BATCH_ROWS):
                    file.add(rows)
    if not file.rows:
        raise NoOverlapError(f"{source.name} lies outside the map.", f"Name a {what} map of the same region.")
    return Source(source.name, str(file.path), keeper=file, sha256=file.digest.hexdigest())


class _Fetched:
    """Rows of a table in a GeoPackage that goes with its last holder."""

    def __init__(self, crs_wkt: str | None, table: str, fields: dict[str, str]) -> None:
        folder = Path(tempfile.mkdtemp(prefix="swathe-table-"))
        finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.path = folder / "table.gpkg"
        self.rows = 0
        self.digest = hashlib.sha256(repr((crs_wkt, list(fields))).encode())
        self._crs_wkt, self._layer, self._fields = crs_wkt, table, fields

    def add(self, rows: list[tuple[Any, ...]]) -> None:
        """Append rows: a geometry as WKB, then the fields."""
        import pyogrio.raw

        for row in rows:
            self.digest.update(repr(row).encode())
        # The table may have columns with the names that a GeoPackage gives to its own.
        first = {} if self.rows else {"FID": "swathe_fid", "GEOMETRY_NAME": "swathe_geometry"}
        columns = [
            _column([row[number] for row in rows], kind) for number, kind in enumerate(self._fields.values(), start=1)
        ]
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "'crs' was not provided")
            pyogrio.raw.write(
                self.path,
                np.array([None if row[0] is None else bytes(row[0]) for row in rows], dtype=object),
                [values for values, _ in columns],
                np.array(list(self._fields), dtype=object),
                field_mask=[missing for _, missing in columns],
                layer=self._layer,
                driver="GPKG",
                crs=self._crs_wkt,
                geometry_type="Unknown",
                append=bool(self.rows),
                **first,
            )
        self.rows += len(rows)


@contextmanager
def _reading(address: TableAddress) -> Iterator[Any]:
    """Give a connection that can only read; whatever the server does becomes a plain error."""
    try:
        import psycopg
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            "PostgreSQL needs the library psycopg, which is not installed.",
            "Install it with `pip install 'swathe[postgis]'`.",
        ) from error
    given = urlsplit(address.connection).query
    defaults: dict[str, Any] = {name: value for name, value in KEEPALIVES.items() if name not in given}
    if "connect_timeout" not in given:
        defaults["connect_timeout"] = CONNECT_TIMEOUT_S
    try:
        with psycopg.connect(address.connection, application_name="swathe", **defaults) as connection:
            connection.read_only = True
            connection.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
            yield connection
    except psycopg.errors.InsufficientPrivilege as error:
        raise _unreadable(address) from error
    except psycopg.ProgrammingError as error:
        if error.sqlstate is None:  # it never came to the server
            raise InvalidParameterError(f"{address.shown}: {_said(error)}", _EXAMPLE) from error
        raise UnreadableFileError(f"{address.shown} cannot be read: {_said(error)}", "Check the table.") from error
    except psycopg.OperationalError as error:
        raise StoreUnavailableError(f"{address.shown}: {_said(error)}", _remedy(str(error))) from error
    except psycopg.Error as error:
        raise UnreadableFileError(f"{address.shown} cannot be read: {_said(error)}", "Check the table.") from error


def _said(error: Exception) -> str:
    """Return the words of the server on one line. They hold no password: none is ever sent in the clear."""
    words = " ".join(str(error).split()) or type(error).__name__
    return words if words.endswith((".", "?", "!")) else f"{words}."


def _remedy(said: str) -> str:
    if "password" in said or "authentication" in said:
        return "Put the right password into PGPASSWORD or ~/.pgpass."
    if "does not exist" in said:
        return "Check the names in the address."
    return "Check that the server runs and can be reached."


def _geometry_column(connection: Any, address: TableAddress) -> tuple[str, str, int, bool]:  # noqa: ANN401
    """Return the schema of the table, its geometry column, the SRID, and whether it is of type geography."""
    if connection.execute("SELECT to_regclass('geometry_columns')").fetchone()[0] is None:
        raise StoreSchemaError(
            f"{address.shown} lies in a database without PostGIS.", "Ask its owner for CREATE EXTENSION postgis."
        )
    rows = connection.execute(
        "SELECT f_table_schema, f_table_name, f_geometry_column, srid, false FROM geometry_columns UNION ALL "
        "SELECT f_table_schema, f_table_name, f_geography_column, srid, true FROM geography_columns"
    ).fetchall()
    own = [row for row in rows if row[1] == address.table and address.schema in (None, row[0])]
    if address.schema is None and len({row[0] for row in own}) > 1:
        shown = ", ".join(sorted({f"{row[0]}.{row[1]}" for row in own}))
        raise UnreadableFileError(f"{address.shown} can mean {shown}.", "Give the schema too.")
    columns = [str(row[2]) for row in own]
    if not own:
        _refuse_table(connection, address, sorted({f"{row[0]}.{row[1]}" for row in rows}))
    if address.geometry is not None:
        own = [row for row in own if row[2] == address.geometry]
    if len(own) != 1:
        raise UnreadableFileError(
            f"{address.shown} has the geometry columns {', '.join(columns)}.", "Choose one with &geometry=COLUMN."
        )
    schema, _, column, srid, is_geography = own[0]
    if srid == 0:  # a column that says nothing of its system, where every geometry may
        srid = _first_srid(connection, schema, address.table, column)
    return str(schema), str(column), int(srid), bool(is_geography)


def _first_srid(connection: Any, schema: str, table: str, column: str) -> int:  # noqa: ANN401
    from psycopg import sql

    found = connection.execute(
        sql.SQL("SELECT ST_SRID({shape}) FROM {table} WHERE {shape} IS NOT NULL LIMIT 1").format(
            shape=sql.Identifier(column), table=sql.Identifier(schema, table)
        )
    ).fetchone()
    return 0 if found is None else int(found[0])


def _refuse_table(connection: Any, address: TableAddress, spatial: list[str]) -> NoReturn:  # noqa: ANN401
    found = connection.execute(
        "SELECT bool_or(has_table_privilege(c.oid, 'SELECT')) FROM pg_class c "
        "JOIN pg_namespace n ON n.oid = c.relnamespace WHERE c.relname = %s AND (%s::text IS NULL OR n.nspname = %s)",
        (address.table, address.schema, address.schema),
    ).fetchone()[0]
    if found is False:
        raise _unreadable(address)
    close = get_close_matches(address.table, {name.partition(".")[2] for name in spatial}, 3)
    near = [name for name in spatial if name.partition(".")[2] in close] or spatial[:8]
    remedy = f"There is {', '.join(near)}." if near else "No table of this database has one that you may read."
    raise UnreadableFileError(f"{address.shown} {'has no geometry column' if found else 'does not exist'}.", remedy)


def _unreadable(address: TableAddress) -> UnreadableFileError:
    return UnreadableFileError(
        f"{address.shown} may not be read by this user.", f"Ask its owner for GRANT SELECT ON {address.name}."
    )


def _system(connection: Any, address: TableAddress, srid: int) -> str | None:  # noqa: ANN401
    """Return the coordinate reference system of an SRID as WKT, or None for SRID 0, which says nothing."""
    if srid == 0:
        return None
    found = connection.execute(
        "SELECT auth_name, auth_srid, srtext, proj4text FROM spatial_ref_sys WHERE srid = %s", (srid,)
    ).fetchone()
    if found is None:
        raise MissingCrsError(
            f"{address.shown} has the SRID {srid}, which its database does not explain.", "Add it to spatial_ref_sys."
        )
    authority, number, wkt, proj = found
    for text in (f"{authority}:{number}" if authority and number else None, wkt, proj):
        if text:
            try:
                return horizontal(parse_crs(text)).to_wkt()
            except InvalidCrsError:
                continue
    raise InvalidCrsError(
        f"{address.shown} has the SRID {srid}, which is no system that is known.", "Mend its line in spatial_ref_sys."
    )


def _fields(connection: Any, schema: str, table: str) -> dict[str, str]:  # noqa: ANN401
    """Return the columns that could name a soil, in the table's order, and the type as which each is fetched."""
    rows = connection.execute(
        "SELECT a.attname, format_type(a.atttypid, NULL), t.typtype FROM pg_attribute a "
        "JOIN pg_class c ON c.oid = a.attrelid JOIN pg_namespace n ON n.oid = c.relnamespace "
        "JOIN pg_type t ON t.oid = a.atttypid "
        "WHERE n.nspname = %s AND c.relname = %s AND a.attnum > 0 AND NOT a.attisdropped ORDER BY a.attnum",
        (schema, table),
    ).fetchall()
    # Enumerations have names of their own as types.
    wanted = {str(name): "text" if sort in ("e", b"e") else FETCHED_AS.get(kind) for name, kind, sort in rows}
    return {name: kind for name, kind in wanted.items() if kind is not None}


def _statement(schema: str, table: str, geometry: str, fields: dict[str, str], *, is_geography: bool) -> Any:  # noqa: ANN401
    from psycopg import sql

    shape = sql.Identifier(geometry)
    box = sql.SQL("ST_MakeEnvelope(%s, %s, %s, %s, %s)")
    columns = [sql.SQL(", {}::{}").format(sql.Identifier(field), sql.SQL(kind)) for field, kind in fields.items()]
    return sql.SQL(
        "SELECT ST_AsBinary(ST_Force2D(ST_CurveToLine({shape}{cast}))){fields} FROM {table} "
        # A table has no order of its own, and the same table shall give the same result.
        "WHERE {shape} && {box} ORDER BY {order}"
    ).format(
        shape=shape,
        cast=sql.SQL("::geometry" if is_geography else ""),
        fields=sql.SQL("").join(columns),
        order=sql.SQL(", ".join(str(place) for place in range(1, len(columns) + 2))),
        table=sql.Identifier(schema, table),
        box=sql.SQL("{}::geography").format(box) if is_geography else box,
    )


def _column(values: list[Any], kind: str) -> tuple[NDArray[Any], NDArray[np.bool_] | None]:
    """Return a field's values, and where there is none if the values cannot say it."""
    if kind == "float8":
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64), None
    missing = np.array([value is None for value in values], dtype=np.bool_)
    if kind == "int8":
        return np.array([value or 0 for value in values], dtype=np.int64), missing
    return np.array(["" if value is None else value for value in values], dtype=object), missing


def _split_name(name: str) -> tuple[str | None, str] | None:
    """Return schema and table of ``schema.table``; either may stand in double quotes, which keep dots."""
    found = re.fullmatch(r'(?:("(?:[^"]|"")+"|[^".]+)\.)?("(?:[^"]|"")+"|[^".]+)', unquote(name))
    if found is None:
        return None
    schema, table = (None if part is None else part.strip('"').replace('""', '"') for part in found.groups())
    return schema, str(table)
