"""What a simulated drive is made of: the ground, the vehicle, what the map does not know, sensors, and soil news.

A scenario is a TOML file of the form below, a bundled one by name, or what the options of ``swathe drive`` say. It is
kept whole in a drive's log, so that the drive can be run again.
"""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from swathe.config import Settings, TerrainRequest
from swathe.errors import InvalidScenarioError, MissingFileError, UnreadableFileError
from swathe.objective import as_objective
from swathe.rank import RankParams, moisture_percent
from swathe.swarm import StopParams

if TYPE_CHECKING:
    from collections.abc import Mapping

_BUNDLED = Path(__file__).parent / "scenarios"
_MAX_FILE_BYTES = 1 << 20

Point = tuple[float, float]
Metres = Annotated[float, Field(ge=0, le=1e5, allow_inf_nan=False)]
Length = Annotated[float, Field(gt=0, le=1e5, allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Soil = Literal["gravel", "sand", "clay", "silt", "rock", "none"]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True)


class Terrain(_Part):
    """``[terrain]``: what the map says. The options of ``swathe plan`` have the same names."""

    dem: tuple[str, ...] = ()
    store: str | None = None
    region: str | None = None
    revision: int | None = Field(default=None, ge=0)
    soil: str | None = None
    soil_field: str | None = None
    soil_legend: str | None = None
    cost_raster: str | None = None
    cell_size_m: Length | None = None
    crs: str | None = None
    height_range_m: tuple[float, float] | None = None
    points_crs: str | None = None
    bounds: tuple[float, float, float, float] | None = None

    @model_validator(mode="after")
    def _names_ground(self) -> Terrain:
        if not self.dem and self.store is None:
            raise ValueError("name dem, or store and region")
        return self

    @classmethod
    def of(cls, request: TerrainRequest) -> Terrain:
        """Return the ground that a plan was asked for."""
        return cls(**{name: getattr(request, name) for name in cls.model_fields})


class PlanPart(_Part):
    """``[plan]``: how the ground is judged and the global route is found, as the options of ``swathe plan`` say."""

    profile: Literal["metric", "paper", "literal"] = "metric"
    method: Literal["swarm", "exact"] = "swarm"
    moisture: str = "normal"
    unknown_soil: str = "neutral"
    soil_table: Literal["text", "table2"] = "text"
    combine: Literal["weighted", "min"] = "weighted"
    weights: tuple[float, float] = (0.5, 0.5)
    paper_grade: float = 0.25
    directions: Literal["worst", "mean", "best", "four"] = "worst"
    bands: Literal["symmetric", "literal"] = "symmetric"
    rounding: Literal["half_away", "real"] = "half_away"
    agents: int | None = Field(default=None, ge=1)
    pellets: int | None = Field(default=None, ge=1)
    explore: Literal["walk", "uniform", "permute"] = "walk"
    stop: Literal["good", "connected", "finished", "statistical"] | None = None
    max_ticks: int | None = Field(default=None, ge=0)
    max_evaluations: int | None = Field(default=None, ge=0)
    arc: Literal["relaid", "spine", "circle", "line"] | None = None
    sagitta_m: float | None = None
    width_m: float | None = None
    path: Literal["auto", "grid8", "grid16", "any-angle", "drivable"] = "auto"
    objective: str = "time"
    bridge: bool = False
    certify: bool = False

    @classmethod
    def of(cls, settings: Settings) -> PlanPart:
        """Return what a plan was asked for."""
        rank = settings.rank
        return cls(
            profile=rank.profile,
            method=settings.method,
            moisture=repr(rank.moisture_percent),
            unknown_soil=rank.unknown_soil,
            soil_table=rank.soil_table,
            combine=rank.combine,
            weights=(rank.height_weight, rank.soil_weight),
            paper_grade=rank.paper_grade,
            directions=rank.directions,
            bands=rank.bands,
            rounding=rank.rounding,
            agents=settings.agents,
            pellets=settings.pellet_max,
            explore=settings.explore,
            stop=settings.stop.rule,
            max_ticks=settings.stop.max_ticks,
            max_evaluations=settings.stop.max_evaluations,
            arc=settings.arc,
            sagitta_m=settings.sagitta_m,
            width_m=settings.width_m,
            path=settings.path,
            objective=settings.objective.text,
            bridge=settings.bridge,
            certify=settings.certify,
        )


class DrivePart(_Part):
    """``[drive]``: from where to where, and how. Points are in ``terrain.points_crs``, metres without a terrain."""

    start: Point | None = None
    goal: Point | None = None
    start_bearing_deg: float | None = None
    goal_bearing_deg: float | None = None
    method: Literal["vfh", "vfh+", "vfh*", "player"] = "vfh+"
    grids: Literal["or", "and", "single", "exact16"] = "or"
    outside_nests: Literal["cost", "block"] = "cost"
    evidence: Literal["log-odds", "himm"] = "log-odds"
    fade_s: Annotated[float, Field(ge=0.1, le=1e6, allow_inf_nan=False)] | None = None
    memory: bool = True
    recover: bool = True
    arrival_m: Length = 0.5
    margin_m: Metres = 0.1
    time_limit_s: Seconds | None = None
    soil_rule: Literal["bayes", "paper_relabel"] = "bayes"
    soil_types: str | None = None
    readings: str | None = None


class ProbingPart(_Part):
    """``[probing]``: when the drive stops to push the penetrometer in, and how far before its front edge."""

    policy: Literal["never", "every", "where-it-matters", "where-it-pays"] = "never"
    every_m: Length = 25.0
    above_s: Seconds = 15.0
    boom_m: float = Field(default=0.5, ge=-20.0, le=20.0)

    @property
    def text(self) -> str:
        """The policy as the navigator takes it."""
        if self.policy == "never":
            return "never"
        if self.policy == "every":
            return f"every {self.every_m:g} m"
        return self.policy.replace("-", " ") + (f" above {self.above_s:g}" if self.above_s > 0 else "")


class Patch(_Part):
    """A disc of ground whose true soil is another than the map says; at a place, or along the route (0..1)."""

    soil: Soil
    radius_m: Length
    x_m: float | None = None
    y_m: float | None = None
    along: Share | None = None
    offset_m: float = 0.0

    @model_validator(mode="after")
    def _has_place(self) -> Patch:
        _require_place(self)
        return self


class TruthPart(_Part):
    """``[truth]``: how the ground differs from the map.

    ``hollows`` are drawn with their middle on ``hollow_in``, none nearer to start and goal than ``clear_m``: discs
    with a radius between the two of ``hollow_m``, in the inner half of ``core_soil``, around it of ``rim_soil``.
    ``wrong_polygons`` is the share of the soil map's polygons (connected patches of a class) that are of another class
    as wholes, drawn from ``wrong_soils``; those of start and goal are right.
    """

    height_error_m: Metres = 0.0
    soil_error: Share = 0.0
    patch_m: Length = 30.0
    moisture: str | None = None
    patches: tuple[Patch, ...] = ()
    hollows: int = Field(default=0, ge=0, le=10_000)
    hollow_m: tuple[Length, Length] = (20.0, 32.0)
    hollow_in: Soil = "sand"
    rim_soil: Soil = "silt"
    core_soil: Soil = "clay"
    clear_m: Metres = 10.0
    wrong_polygons: Share = 0.0
    wrong_soils: tuple[Soil, ...] = Field(default=("gravel", "sand", "clay", "silt"), min_length=2)


class Box(_Part):
    """A crate; at a place in metres, or along the route (0..1) and to the left of it."""

    x_m: float | None = None
    y_m: float | None = None
    along: Share | None = None
    offset_m: float = 0.0
    length_m: Length = 0.6
    width_m: Length = 0.6
    heading_deg: float = 0.0
    height_m: Length = 0.6

    @model_validator(mode="after")
    def _has_place(self) -> Box:
        _require_place(self)
        return self


class WallLine(_Part):
    """A thin wall along points in metres."""

    points: tuple[Point, ...] = Field(min_length=2)
    height_m: Length = 1.5


class MoverPath(_Part):
    """A disc that goes to and fro along points in metres."""

    path: tuple[Point, ...] = Field(min_length=2)
    speed_mps: Length = 0.5
    radius_m: Length = 0.3
    start_m: Metres = 0.0


class Ditch(_Part):
    """A ditch along points in metres."""

    line: tuple[Point, ...] = Field(min_length=2)
    width_m: Length = 1.0
    depth_m: Length = 0.5


class ObstaclesPart(_Part):
    """``[obstacles]``: what stands or moves in the world and is on no map.

    ``crates`` are drawn along the route, at most ``spread_m`` aside of it and ``clear_m`` from start and goal.
    """

    crates: int = Field(default=0, ge=0, le=10_000)
    crate_m: tuple[Length, Length] = (0.5, 1.1)
    spread_m: Length = 6.0
    clear_m: Length = 3.0
    boxes: tuple[Box, ...] = ()
    walls: tuple[WallLine, ...] = ()
    movers: tuple[MoverPath, ...] = ()
    ditches: tuple[Ditch, ...] = ()


class SensorsPart(_Part):
    """``[sensors]``: what the robot carries and how well it knows where it is.

    ``sensor``: what it sees with, ``laser``, the Pioneer's ring of sonars, or both.
    """

    sensor: Literal["laser", "sonar", "both"] = "laser"
    laser: Literal["sick-lms200-8m", "sick-lms200-80m", "sick-lms200-8m-361", "sick-lms200-80m-361"] = "sick-lms200-8m"
    beam_dropout: Share = 0.0
    scan_delay_s: Seconds = 0.0
    scan_dropout: Share = 0.0
    scale_error: float = Field(default=0.0, ge=0, le=0.5)
    distance_noise_m: float = Field(default=0.0, ge=0, le=1)
    heading_noise_rad: float = Field(default=0.0, ge=0, le=1)
    heading_drift_radps: float = Field(default=0.0, ge=0, le=1)
    fix_rate_hz: float = Field(default=0.0, ge=0, le=100)
    fix_noise_m: float = Field(default=0.0, ge=0, le=10)
    fix_heading_noise_rad: float = Field(default=0.0, ge=0, le=1)
    blind_to_slip: bool = False
    fuses_fixes: bool = False


class SoilNews(_Part):
    """News of the soil that reaches the drive at a time: the class of a disc, with how sure its source is."""

    time_s: Seconds
    soil: Soil
    radius_m: Length
    x_m: float | None = None
    y_m: float | None = None
    along: Share | None = None
    offset_m: float = 0.0
    source: str = "scenario"

    @model_validator(mode="after")
    def _has_place(self) -> SoilNews:
        _require_place(self)
        return self


class WorldPart(_Part):
    """``[world]``: a drawn world without a map, instead of ``[terrain]``; ``scale`` enlarges it for larger vehicles."""

    kind: Literal["clutter", "corridor", "u-trap", "dead-end", "moving"] = "clutter"
    density: float = Field(default=2.5, ge=0, le=50)
    scale: float = Field(default=1.0, ge=1, le=20)


class Scenario(_Part):
    """A simulated drive, whole."""

    title: str = ""
    vehicle: str = "pioneer-3at"
    seed: int = Field(default=0, ge=0, lt=2**64)
    terrain: Terrain | None = None
    world: WorldPart | None = None
    plan: PlanPart = PlanPart()
    drive: DrivePart = DrivePart()
    probing: ProbingPart = ProbingPart()
    truth: TruthPart = TruthPart()
    obstacles: ObstaclesPart = ObstaclesPart()
    sensors: SensorsPart = SensorsPart()
    soil_news: tuple[SoilNews, ...] = ()

    @model_validator(mode="after")
    def _has_ground(self) -> Scenario:
        if (self.terrain is None) == (self.world is None):
            raise ValueError("either a [terrain] or a drawn [world] is needed, not both")
        if self.terrain is not None and (self.drive.start is None or self.drive.goal is None):
            raise ValueError("drive.start and drive.goal are needed with a [terrain]")
        if self.world is not None and (self.truth != TruthPart() or self.soil_news or self.probing.policy != "never"):
            raise ValueError("a drawn [world] has no map of the soil: leave out truth, probing and soil_news")
        if self.world is not None and not (self.drive.soil_types is None is self.drive.readings):
            raise ValueError("a drawn [world] has no map of the soil: leave out drive.soil_types and drive.readings")
        if self.sensors.sensor == "sonar" and self.drive.method == "player":
            raise ValueError("drive.method player steers by scans of a laser: sensors.sensor must be laser or both")
        return self

    @property
    def true_moisture_percent(self) -> float:
        """Moisture of the true ground: that of the plan, unless the truth has its own."""
        return moisture_percent(self.truth.moisture or self.plan.moisture)

    def terrain_request(self) -> TerrainRequest:
        """Return the ground as ``swathe plan`` asks for it."""
        assert self.terrain is not None  # noqa: S101 - callers ask with a terrain only
        return TerrainRequest(**self.terrain.model_dump())

    def settings(self) -> Settings:
        """Return how the ground is judged and the route is found."""
        plan = self.plan
        rank = RankParams(
            profile=plan.profile,
            moisture_percent=moisture_percent(plan.moisture),
            unknown_soil=plan.unknown_soil,
            soil_table=plan.soil_table,
            combine=plan.combine,
            height_weight=plan.weights[0],
            soil_weight=plan.weights[1],
            paper_grade=plan.paper_grade,
            directions=plan.directions,
            bands=plan.bands,
            rounding=plan.rounding,
        )
        return Settings(
            vehicle=self.vehicle,
            rank=rank,
            method=plan.method,
            agents=plan.agents,
            pellet_max=plan.pellets,
            explore=plan.explore,
            stop=StopParams(rule=plan.stop, max_ticks=plan.max_ticks, max_evaluations=plan.max_evaluations),
            seed=self.seed,
            arc=plan.arc,
            sagitta_m=plan.sagitta_m,
            width_m=plan.width_m,
            path=plan.path,
            start_bearing_deg=self.drive.start_bearing_deg,
            goal_bearing_deg=self.drive.goal_bearing_deg,
            objective=as_objective(plan.objective),
            bridge=plan.bridge,
            certify=plan.certify,
        )

    def to_toml(self) -> str:
        """Return the scenario as TOML, without what is as usual; ``scenario_from_toml`` reads it."""
        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True, exclude_defaults=True))

    def with_changes(self, changes: Mapping[str, Any]) -> Scenario:
        """Return the scenario with some fields other; nested fields are named with a dot (``obstacles.crates``).

        Raises:
            InvalidScenarioError: the scenario is not valid then.
        """
        content = self.model_dump()
        for name, value in changes.items():
            *parts, last = name.split(".")
            inner = content
            for part in parts:
                if inner.get(part) is None:
                    inner[part] = {}
                inner = inner[part]
            inner[last] = value
        return scenario_of(content, "The scenario")


def request_of(terrain: TerrainRequest, settings: Settings, ends: tuple[Point, Point]) -> dict[str, Any] | None:
    """Return a plan's request as a scenario's plain values, so that its route can be driven; None if it cannot.

    A plan that a clock has ended cannot be found again.
    """
    if settings.stop.max_seconds is not None:
        return None
    scenario = Scenario(
        vehicle=settings.vehicle,
        seed=settings.seed,
        terrain=Terrain.of(terrain),
        plan=PlanPart.of(settings),
        drive=DrivePart(
            start=ends[0],
            goal=ends[1],
            start_bearing_deg=settings.start_bearing_deg,
            goal_bearing_deg=settings.goal_bearing_deg,
        ),
    )
    return scenario.model_dump(mode="json", exclude_none=True, exclude_defaults=True)


def scenario_of(content: Mapping[str, Any], what: str) -> Scenario:
    """Return a scenario from plain values, as a TOML file or a log holds them.

    Raises:
        InvalidScenarioError: a field is not known or not usable; the message names every one. ``what`` begins it.
    """
    try:
        return Scenario.model_validate(content)
    except ValidationError as error:
        problems = "; ".join(_in_words(problem) for problem in error.errors(include_url=False))
        raise InvalidScenarioError(
            f"{what} is not valid: {problems}.", "Correct these fields; docs/scenario.md shows the form."
        ) from error


def scenario_from_toml(text: str, what: str) -> Scenario:
    """Return a scenario from TOML; paths are taken as they are. ``what`` begins the message of an error.

    Raises:
        InvalidScenarioError: it is not valid.
    """
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise InvalidScenarioError(f"{what} is not valid TOML: {reason}.", "Correct the line that is named.") from error
    return scenario_of(content, what)


def scenario_names() -> tuple[str, ...]:
    """Return the names of the bundled scenarios, sorted."""
    return tuple(sorted(path.stem for path in _BUNDLED.glob("*.toml")))


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Return a bundled scenario by name, or one from a TOML file, whose relative paths are those of its folder.

    Raises:
        InvalidScenarioError: there is none of that name, or the file breaks a rule.
        MissingFileError: the file does not exist.
        UnreadableFileError: it cannot be read.
    """
    if isinstance(name_or_path, str) and name_or_path in scenario_names():
        path = _BUNDLED / f"{name_or_path}.toml"
    else:
        path = Path(name_or_path)
        if isinstance(name_or_path, str) and path.suffix.lower() != ".toml" and len(path.parts) == 1:
            known = scenario_names()
            close = difflib.get_close_matches(name_or_path.lower(), known, n=1, cutoff=0.5)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise InvalidScenarioError(
                f"There is no scenario named {name_or_path!r}{hint}.",
                f"Use one of {', '.join(known)}, or the path of a TOML file.",
            )
    scenario = scenario_from_toml(_read(path), f"The scenario file {path.name}")
    changes: dict[str, Any] = {}
    if scenario.terrain is not None:
        terrain = scenario.terrain
        changes["terrain.dem"] = tuple(_resolved(name, path.parent) for name in terrain.dem)
        for key in ("soil", "soil_legend", "cost_raster"):
            if (name := getattr(terrain, key)) is not None:
                changes[f"terrain.{key}"] = _resolved(name, path.parent)
    for key in ("soil_types", "readings"):
        if (name := getattr(scenario.drive, key)) is not None:
            changes[f"drive.{key}"] = _resolved(name, path.parent)
    if scenario.vehicle.endswith(".toml"):
        changes["vehicle"] = _resolved(scenario.vehicle, path.parent)
    return scenario.with_changes(changes)


def _read(path: Path) -> str:
    try:
        if not path.exists():
            raise MissingFileError(f"The scenario file {path} does not exist.", "Check the path.")
        if not path.is_file() or path.stat().st_size > _MAX_FILE_BYTES:
            raise UnreadableFileError(f"{path} is not a scenario file.", "Give the path of a TOML file.")
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnreadableFileError(f"The scenario file {path} is not text in UTF-8.", "Save it as UTF-8.") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UnreadableFileError(
            f"The scenario file {path} cannot be read: {reason}.", "Check the path and its permissions."
        ) from error


def _resolved(name: str, folder: Path) -> str:
    """Return the path of a file that a scenario in a folder names; addresses and bundled names stay."""
    return name if ":" in name or Path(name).is_absolute() else str(folder / name)


def _require_place(part: Patch | Box | SoilNews) -> None:
    at = (part.x_m is not None) + (part.y_m is not None)
    if at + 2 * (part.along is not None) != 2:
        raise ValueError("give x_m and y_m, or along")


def _in_words(problem: Any) -> str:  # noqa: ANN401 - pydantic's own type is private
    place = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        return f"{place} is not known"
    message = str(problem["msg"]).removeprefix("Value error, ")
    message = message[:1].lower() + message[1:]
    shown = "" if problem["type"] in {"missing", "value_error"} else f" (given: {problem['input']!r:.40})"
    return f"{place}: {message}{shown}" if place else message
