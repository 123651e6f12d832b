"""Every error that Swathe raises, in one tree.

An error says what was given, what is allowed and what to try: ``message`` is one plain sentence that names the
thing, ``remedy`` one that says what to do. ``kind`` is the stable word that ``--json`` prints and ``exit_code`` the
exit status of the command line. A negative answer of the planner ("no route", "start blocked") is not an error.
"""

from __future__ import annotations


class SwatheError(Exception):
    """Base of every error raised by Swathe."""

    kind = "error"
    exit_code = 1

    def __init__(self, message: str, remedy: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.remedy = remedy

    def __str__(self) -> str:
        return f"{self.message} {self.remedy}".strip()


class UsageError(SwatheError, ValueError):
    """The caller asked for something that is not allowed."""

    kind = "usage"
    exit_code = 2


class InvalidParameterError(UsageError):
    """A parameter is outside its range."""

    kind = "invalid_parameter"


class ShapeMismatchError(UsageError):
    """Two layers that must cover the same cells do not."""

    kind = "shape_mismatch"


class OutsideGridError(UsageError):
    """A cell or position lies outside the grid."""

    kind = "outside_grid"


class InputError(SwatheError):
    """A file, folder or service that was named cannot be used."""

    kind = "input"
    exit_code = 4


class MissingFileError(InputError):
    """A file that was named does not exist."""

    kind = "missing_file"


class UnreadableFileError(InputError):
    """A file exists but cannot be read: truncated, empty, of another format, or without permission."""

    kind = "unreadable_file"


class NotElevationError(InputError):
    """A raster does not hold elevations (a colour picture, complex numbers, several bands, impossible heights)."""

    kind = "not_elevation"


class MissingCrsError(InputError):
    """A raster or vector has no coordinate reference system."""

    kind = "missing_crs"


class InvalidCrsError(InputError):
    """A coordinate reference system is unknown or cannot be used."""

    kind = "invalid_crs"


class NoOverlapError(InputError):
    """Two inputs do not overlap."""

    kind = "no_overlap"


class AllVoidError(InputError):
    """No cell of the elevation is known."""

    kind = "all_void"


class TooLargeError(InputError):
    """The request needs more memory than the machine can give."""

    kind = "too_large"


class TooSmallError(InputError):
    """The elevation has too few rows or columns to have a gradient."""

    kind = "too_small"


class SoilFieldError(InputError):
    """The soil field or legend does not fit the soil map."""

    kind = "soil_field"


class ReadingFileError(InputError):
    """A file of penetrometer readings has a column or a line that cannot be used."""

    kind = "reading_file"


class InvalidVehicleError(InputError):
    """A vehicle file is missing a figure or has one outside its range."""

    kind = "invalid_vehicle"


class InvalidScenarioError(InputError):
    """A scenario breaks a rule."""

    kind = "invalid_scenario"


class GrassError(InputError):
    """GRASS is missing, or a location, mapset or map of it cannot be used."""

    kind = "grass"


class MissingExtraError(InputError):
    """An optional part of Swathe is not installed."""

    kind = "missing_extra"


class StoreError(InputError):
    """A store cannot do what was asked."""

    kind = "store"


class StoreUnavailableError(StoreError):
    """There is no store at an address, its server does not answer, or it went away."""

    kind = "store_unavailable"


class StoreSchemaError(StoreError):
    """A store was made by a newer version, must be migrated first, or lacks an extension."""

    kind = "store_schema"


class StoreReadOnlyError(StoreError):
    """A store may be read and not written."""

    kind = "store_read_only"


class StoreBusyError(StoreError):
    """Somebody else is writing, for longer than we wait."""

    kind = "store_busy"


class StoreFullError(StoreError):
    """The disk of a store is full."""

    kind = "store_full"


class StoreDamagedError(StoreError):
    """A store's files are cut short or not what they were."""

    kind = "store_damaged"


class MissingRegionError(StoreError):
    """A store has no region of this name."""

    kind = "missing_region"


class MissingLayerError(StoreError):
    """A region of a store has no such layer."""

    kind = "missing_layer"


class RegionConflictError(StoreError):
    """A region of this name lies on other cells."""

    kind = "region_conflict"


class OutputError(InputError):
    """The output folder cannot be written, is full, or is not ours."""

    kind = "output"


class InterruptedBySignalError(SwatheError):
    """The user stopped a long operation."""

    kind = "interrupted"
    exit_code = 130
