"""Vehicles: footprint, motion, limits, power and ground contact of one machine, read from TOML.

A vehicle file has the sections ``[footprint] [mass] [motion] [limits] [power] [ground]`` and one of ``[wheels]`` and
``[tracks]``. Each figure is a bare value or ``{ value = 0.508, source = "data sheet" }``; the bundled files always give
the source. Grades and side slopes are rise over run. In Python every figure is a flat attribute of ``Vehicle``; those
of the running gear carry its name in front (``wheels.count`` is ``wheel_count``).
"""

from __future__ import annotations

import difflib
import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from swathe.errors import InvalidVehicleError, MissingFileError, UnreadableFileError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from swathe import _core

_BUNDLED = Path(__file__).parent / "vehicles"
_STANDARD_GRAVITY_MPS2 = 9.80665
# A vehicle file holds some forty lines; what is larger is something else given by mistake.
_MAX_FILE_BYTES = 1_000_000
_MAX_NAME_LENGTH = 80
_MAX_DESCRIPTION_LENGTH = 400

_Length = Annotated[float, Field(gt=0, le=100)]
_Height = Annotated[float, Field(ge=0, le=10)]
_Grade = Annotated[float, Field(gt=0, le=2)]
_Friction = Annotated[float, Field(gt=0, le=2)]
_Acceleration = Annotated[float, Field(gt=0, le=50)]
_Count = Annotated[int, Field(ge=1, le=64)]

# Section of the file -> figure in the file -> attribute of Vehicle. The only place that knows both spellings.
_SECTIONS: dict[str, dict[str, str]] = {
    "footprint": {name: name for name in ("length_m", "width_m", "height_m", "ground_clearance_m", "gauge_m")},
    "mass": {name: name for name in ("mass_kg", "centre_of_gravity_m")},
    "motion": {
        name: name
        for name in (
            "steering",
            "max_speed_mps",
            "max_turn_rate_radps",
            "min_turn_radius_m",
            "max_acceleration_mps2",
            "max_braking_mps2",
            "reaction_time_s",
            "sight_distance_m",
        )
    },
    "limits": {name: name for name in ("grade_up", "grade_down", "side_slope", "step_height_m")},
    "power": {name: name for name in ("power_w", "drive_efficiency", "idle_power_w")},
    "ground": {
        name: name
        for name in ("traction_friction", "braking_friction", "ground_pressure_kpa", "vehicle_cone_index_kpa")
    },
    "wheels": {
        "count": "wheel_count",
        "diameter_m": "wheel_diameter_m",
        "width_m": "wheel_width_m",
        "section_height_m": "wheel_section_height_m",
        "deflection_m": "wheel_deflection_m",
        "chains": "wheel_chains",
        "manual_transmission": "manual_transmission",
    },
    "tracks": {
        "contact_length_m": "track_contact_length_m",
        "width_m": "track_width_m",
        "grousers_over_38_mm": "track_grousers",
        "road_wheels": "track_road_wheels",
        "shoe_area_m2": "track_shoe_area_m2",
        "manual_transmission": "manual_transmission",
    },
}
_RUNNING_GEARS = ("wheels", "tracks")
_OPTIONAL = frozenset({"vehicle_cone_index_kpa", "gauge_m", "centre_of_gravity_m"})


class Vehicle(BaseModel):
    """One machine: its figures in SI units, and where each figure comes from.

    Figures of the running gear that the machine does not have are None. ``vehicle_cone_index_kpa`` is a measured value
    that replaces the formula; None means that the formula is used. ``min_turn_radius_m`` 0 turns in place. ``gauge_m``,
    the distance between the centre lines of left and right wheels or tracks, and ``centre_of_gravity_m``, the height of
    the centre of gravity above the ground, say on which side slope the machine tips over; without them only
    ``side_slope`` holds.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    name: Annotated[str, Field(min_length=1, max_length=_MAX_NAME_LENGTH)]
    description: Annotated[str, Field(max_length=_MAX_DESCRIPTION_LENGTH)] = ""
    running_gear: Literal["wheels", "tracks"]

    length_m: _Length
    width_m: _Length
    height_m: _Length
    ground_clearance_m: _Height
    gauge_m: _Length | None = None
    mass_kg: Annotated[float, Field(gt=0, le=1_000_000)]
    centre_of_gravity_m: _Length | None = None

    steering: Literal["differential", "skid", "ackermann"]
    max_speed_mps: Annotated[float, Field(gt=0, le=100)]
    max_turn_rate_radps: Annotated[float, Field(gt=0, le=100)]
    min_turn_radius_m: Annotated[float, Field(ge=0, le=1000)]
    max_acceleration_mps2: _Acceleration
    max_braking_mps2: _Acceleration
    reaction_time_s: Annotated[float, Field(ge=0, le=60)]
    sight_distance_m: Annotated[float, Field(gt=0, le=10_000)]

    grade_up: _Grade
    grade_down: _Grade
    side_slope: _Grade
    step_height_m: _Height

    power_w: Annotated[float, Field(gt=0, le=100_000_000)]
    drive_efficiency: Annotated[float, Field(gt=0, le=1)]
    idle_power_w: Annotated[float, Field(ge=0, le=100_000_000)]

    traction_friction: _Friction
    braking_friction: _Friction
    ground_pressure_kpa: Annotated[float, Field(gt=0, le=10_000)]
    vehicle_cone_index_kpa: Annotated[float, Field(gt=0, le=10_000)] | None = None

    manual_transmission: bool

    wheel_count: _Count | None = None
    wheel_diameter_m: _Length | None = None
    wheel_width_m: _Length | None = None
    wheel_section_height_m: _Length | None = None
    wheel_deflection_m: _Length | None = None
    wheel_chains: bool | None = None

    track_contact_length_m: _Length | None = None
    track_width_m: _Length | None = None
    track_grousers: bool | None = None
    track_road_wheels: _Count | None = None
    track_shoe_area_m2: Annotated[float, Field(gt=0, le=100)] | None = None

    sources: dict[str, str] = Field(default_factory=dict)

    @property
    def core(self) -> _core.Vehicle:
        """The vehicle as the core sees it."""
        from swathe import _core

        return _core.Vehicle(self.core_arguments())

    @property
    def circumscribed_radius_m(self) -> float:
        """Radius of the circle around the footprint: what the machine needs to turn in place anywhere."""
        return math.hypot(self.length_m, self.width_m) / 2

    @property
    def weight_n(self) -> float:
        """Weight in newtons, at standard gravity (9.80665 m/s2)."""
        return self.mass_kg * _STANDARD_GRAVITY_MPS2

    @property
    def max_grade(self) -> float:
        """The steeper of the two grades along the direction of travel, rise over run."""
        return max(self.grade_up, self.grade_down)

    @property
    def rollover_slope(self) -> float | None:
        """The side slope on which the machine tips over at rest, rise over run; None when it is not known.

        Half the gauge over the height of the centre of gravity: the static stability factor.
        """
        if self.gauge_m is None or self.centre_of_gravity_m is None:
            return None
        return self.gauge_m / (2 * self.centre_of_gravity_m)

    def core_arguments(self) -> dict[str, float | str | bool | None]:
        """Return all figures as one flat dictionary for the core.

        Keys are the attribute names; figures of the other running gear are None.
        """
        return self.model_dump(exclude={"name", "description", "sources"})

    def as_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON: name, description, running gear, and figure -> {value, source}.

        Figures the machine does not have are left out; a figure given without a source has the source None.
        """
        figures = {
            figure: {"value": value, "source": self.sources.get(figure)}
            for figure, value in self.core_arguments().items()
            if value is not None and figure != "running_gear"
        }
        return {
            "name": self.name,
            "description": self.description,
            "running_gear": self.running_gear,
            "figures": figures,
        }


def vehicle_names() -> tuple[str, ...]:
    """Return the names of the bundled vehicles, sorted."""
    return tuple(sorted(path.stem for path in _BUNDLED.glob("*.toml")))


def load_vehicle(name_or_path: str | Path) -> Vehicle:
    """Return a bundled vehicle by name, or one from a TOML file.

    Text that is a bundled name means that vehicle. A ``Path``, text that ends in ``.toml`` or holds a path separator,
    and text that names an existing file are read as a file.

    Raises:
        InvalidVehicleError: unknown name, or a file that breaks a rule; the message lists every bad field.
        MissingFileError: the file does not exist.
        UnreadableFileError: the file is empty, too large, not text, a folder, or may not be read.
    """
    if isinstance(name_or_path, str) and name_or_path in vehicle_names():
        return _read_vehicle(_BUNDLED / f"{name_or_path}.toml")
    if not str(name_or_path).strip():
        raise InvalidVehicleError("No vehicle is named.", f"Name one of {', '.join(vehicle_names())}, or a TOML file.")
    path = Path(name_or_path)
    if isinstance(name_or_path, Path) or path.suffix.lower() == ".toml" or len(path.parts) > 1 or _exists(path):
        return _read_vehicle(path)
    known = vehicle_names()
    raise InvalidVehicleError(
        f"There is no vehicle named {name_or_path!r}{_did_you_mean(name_or_path.lower(), known)}.",
        f"Use one of {', '.join(known)}, or the path of a TOML file.",
    )


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # a name too long for the file system, or one with a zero byte
        return False


def _did_you_mean(word: str, known: Iterable[str]) -> str:
    match = difflib.get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f" (did you mean {match[0]!r}?)" if match else ""


def _read_text(path: Path) -> str:
    try:
        if not path.exists():
            raise MissingFileError(
                f"The vehicle file {path} does not exist.",
                f"Check the path, or use one of {', '.join(vehicle_names())}.",
            )
        if not path.is_file():
            raise UnreadableFileError(f"{path} is not a file.", "Give the path of a vehicle TOML file.")
        if path.stat().st_size > _MAX_FILE_BYTES:
            raise UnreadableFileError(
                f"{path} is too large to be a vehicle file.", "Give a TOML file of some forty lines."
            )
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UnreadableFileError(
            f"The vehicle file {path} cannot be read: {reason}.", "Check the path and its permissions."
        ) from error
    if not content.strip():
        raise UnreadableFileError(
            f"The vehicle file {path} is empty.", "Copy a bundled vehicle and change its figures."
        )
    try:
        # Editors on Windows put a byte order mark first, which TOML itself does not allow.
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnreadableFileError(
            f"The vehicle file {path} is not text in UTF-8.", "Save it as UTF-8 text in TOML form."
        ) from error


def _read_vehicle(path: Path) -> Vehicle:
    text = _read_text(path)
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # tomllib recurses into nested arrays without a limit
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise InvalidVehicleError(
            f"The vehicle file {path} is not valid TOML: {reason}.", "Correct the line that is named."
        ) from error
    reading = _Reading()
    reading.read(document)
    vehicle: Vehicle | None = None
    try:
        vehicle = Vehicle.model_validate({**reading.values, "sources": reading.sources})
    except ValidationError as error:
        reading.add_validation_errors(error)
    if vehicle is not None:
        reading.problems.extend(_contradictions(vehicle))
    if vehicle is None or reading.problems:
        raise InvalidVehicleError(
            f"The vehicle file {path} is not valid: {'; '.join(reading.problems)}.",
            "Correct these fields; the bundled vehicles show the form.",
        )
    return vehicle


@dataclass
class _Reading:
    """What was found in a vehicle file so far, and what is wrong with it, one clause for each field."""

    values: dict[str, Any] = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    reported: set[str] = field(default_factory=set)

    def read(self, document: dict[str, Any]) -> None:
        """Take the figures out of the parsed file; note what is unknown, of the wrong form or missing."""
        allowed = ("name", "description", *_SECTIONS)
        for key, content in document.items():
            if key not in allowed:
                self.problems.append(f"{key} is not a known section{_did_you_mean(key, allowed)}")
            elif key not in _SECTIONS:
                self.values[key] = content
            elif not isinstance(content, dict):
                self.problems.append(f"{key} must be a section with figures, not {content!r:.40}")
                self.reported.update(_SECTIONS[key].values())
            else:
                self._read_section(key, content)
        gears = [gear for gear in _RUNNING_GEARS if gear in document]
        if len(gears) == 1:
            self.values["running_gear"] = gears[0]
        else:
            self.problems.append(
                f"exactly one of [wheels] and [tracks] must be given, not {'both' if gears else 'none'}"
            )
            self.reported.update(("running_gear", "manual_transmission"))
        self._note_missing(document, gears)

    def _read_section(self, section: str, content: dict[str, Any]) -> None:
        figures = _SECTIONS[section]
        for figure, given in content.items():
            path = f"{section}.{figure}"
            if figure not in figures:
                self.problems.append(f"{path} is not a known figure{_did_you_mean(figure, figures)}")
                continue
            attribute = figures[figure]
            value = given
            if isinstance(given, dict):
                unknown = sorted(set(given) - {"value", "source"})
                source = given.get("source")
                if unknown or "value" not in given:
                    self.problems.append(f"{path} must have a value and may have a source, nothing else")
                    self.reported.add(attribute)
                    continue
                if source is not None and not (isinstance(source, str) and source.strip()):
                    self.problems.append(f"{path}.source must be text")
                elif source is not None:
                    self.sources[attribute] = source.strip()
                value = given["value"]
            self.values[attribute] = value

    def _note_missing(self, document: dict[str, Any], gears: list[str]) -> None:
        for section, figures in _SECTIONS.items():
            if section in _RUNNING_GEARS and section not in gears:
                continue
            if section not in document:
                self.problems.append(f"the section [{section}] is missing")
                self.reported.update(figures.values())
                continue
            for figure, attribute in figures.items():
                if attribute not in self.values and attribute not in self.reported | _OPTIONAL:
                    self.problems.append(f"{section}.{figure} is missing")
                    self.reported.add(attribute)

    def add_validation_errors(self, error: ValidationError) -> None:
        """Put the model's complaints into the words of the file."""
        seen: set[str] = set(self.reported)
        for complaint in error.errors(include_url=False):
            attribute = str(complaint["loc"][0])
            if attribute in seen:
                continue
            seen.add(attribute)
            path = _path_of(attribute, str(self.values.get("running_gear", "")))
            if complaint["type"] == "missing":
                self.problems.append(f"{path} is missing")
            else:
                self.problems.append(f"{path} is {_shown(complaint['input'])}, must be {_demand_of(attribute)}")


def _shown(value: object) -> str:
    """Return a value as its TOML file has it, shortened."""
    return str(value).lower() if isinstance(value, bool) else f"{value!r:.60}"


def _path_of(attribute: str, running_gear: str) -> str:
    """Return the figure's place in the file, such as ``limits.grade_up``."""
    for section, figures in _SECTIONS.items():
        if section in _RUNNING_GEARS and running_gear and section != running_gear:
            continue
        for figure, name in figures.items():
            if name == attribute:
                return f"{section}.{figure}"
    return attribute


def _demand_of(attribute: str) -> str:
    """Return what the model demands of a figure in words, read from the model itself."""
    schema = Vehicle.model_json_schema()["properties"][attribute]
    schema = next((choice for choice in schema.get("anyOf", []) if choice.get("type") != "null"), schema)
    if "enum" in schema:
        return "one of " + ", ".join(map(repr, schema["enum"]))
    if schema["type"] == "boolean":
        return "true or false"
    if schema["type"] == "string":
        return f"text of {schema.get('minLength', 0)} to {schema['maxLength']} characters"
    lower = (
        f"above {schema['exclusiveMinimum']:g}" if "exclusiveMinimum" in schema else f"at least {schema['minimum']:g}"
    )
    whole = "a whole number, " if schema["type"] == "integer" else ""
    return f"{whole}{lower} and at most {schema['maximum']:,.10g}"


def _contradictions(vehicle: Vehicle) -> list[str]:
    """Return what single figures cannot show: figures that do not fit together."""
    found = []
    if vehicle.ground_clearance_m >= vehicle.height_m:
        found.append("footprint.ground_clearance_m must be less than footprint.height_m")
    if (vehicle.gauge_m is None) != (vehicle.centre_of_gravity_m is None):
        found.append(
            "footprint.gauge_m and mass.centre_of_gravity_m must be given together: they say when it tips over"
        )
    if vehicle.gauge_m is not None and vehicle.gauge_m > vehicle.width_m:
        found.append("footprint.gauge_m must be at most footprint.width_m")
    if vehicle.centre_of_gravity_m is not None and vehicle.centre_of_gravity_m > vehicle.height_m:
        found.append("mass.centre_of_gravity_m must be at most footprint.height_m")
    if vehicle.steering == "ackermann" and vehicle.min_turn_radius_m == 0:
        found.append("motion.min_turn_radius_m must be above 0 for ackermann steering")
    if vehicle.wheel_diameter_m is not None and vehicle.wheel_section_height_m is not None:
        if vehicle.wheel_section_height_m >= vehicle.wheel_diameter_m / 2:
            found.append("wheels.section_height_m must be less than half of wheels.diameter_m")
        if vehicle.wheel_deflection_m is not None and vehicle.wheel_deflection_m >= vehicle.wheel_section_height_m:
            found.append("wheels.deflection_m must be less than wheels.section_height_m")
    return found
