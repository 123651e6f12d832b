"""The options that several commands share, and what they ask for."""

from __future__ import annotations

import getpass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

if TYPE_CHECKING:
    from swathe.config import Settings, TerrainRequest

GROUND = "The ground"
METHOD = "How it is judged"
OUTPUT = "What you get"

Dem = Annotated[
    list[str] | None,
    typer.Option(
        "--dem",
        help="Elevation: a file, folder, pattern or http(s) address of anything GDAL reads, or bundled:jacksboro. "
        "Several are put together.",
        rich_help_panel=GROUND,
    ),
]
Soil = Annotated[
    str | None,
    typer.Option("--soil", help="Soil map: vector or raster, or bundled:jacksboro.", rich_help_panel=GROUND),
]
Store = Annotated[
    str | None,
    typer.Option(
        "--store",
        help="In the place of --dem and --soil: a project folder, or postgresql://..., that `swathe import` filled.",
        rich_help_panel=GROUND,
    ),
]
RegionName = Annotated[str | None, typer.Option("--region", help="Region of the store.", rich_help_panel=GROUND)]
Keep = Annotated[
    bool, typer.Option("--keep", help="File route, ranks and nests in the store too.", rich_help_panel=OUTPUT)
]
SoilField = Annotated[
    str | None, typer.Option("--soil-field", help="Attribute of the soil map that names the soil, e.g. cat.")
]
SoilLegend = Annotated[str | None, typer.Option("--soil-legend", help="CSV that explains the soil map's values.")]
CostRaster = Annotated[
    str | None,
    typer.Option(
        "--cost-raster",
        help="Raster of factors of at least 0 on the cost of each cell; NaN, infinite or empty is closed.",
    ),
]
Objective = Annotated[
    str,
    typer.Option(
        "--objective",
        help="What the route saves: time, energy, risk, or weights such as time=1,energy=0.5,risk=2. The sum is in "
        "seconds: of driving, of rated power (joules over watts), and near no-go ground (up to 1 a second).",
    ),
]
CellSize = Annotated[float | None, typer.Option("--cell-size", help="Size of terrain cells in metres.")]
HeightRange = Annotated[
    str | None, typer.Option("--height-range", help="LOW,HIGH in metres of black and white in a grey height map.")
]
Crs = Annotated[str | None, typer.Option("--crs", help="Projection to plan in, e.g. EPSG:32632. [default: UTM]")]
PointsCrs = Annotated[
    str | None,
    typer.Option(
        "--points-crs",
        help="System of points and bounds: native (the elevation's) or EPSG:n; x,y order always. [default: WGS 84 "
        "longitude,latitude]",
    ),
]
Bounds = Annotated[str | None, typer.Option("--bounds", help="WEST,SOUTH,EAST,NORTH of the part to use.")]
MemoryLimit = Annotated[float | None, typer.Option("--memory-limit", help="Most memory to use, in GB.")]
VehicleName = Annotated[
    str, typer.Option("--vehicle", help="A vehicle of `swathe vehicles`, or a TOML file of your own.")
]
Profile = Annotated[
    Literal["metric", "paper", "literal"],
    typer.Option(
        "--profile",
        help="metric: slope against the vehicle's limits. paper: the paper's tables with gates. "
        "literal: the paper's tables without gates.",
    ),
]
Method = Annotated[
    Literal["swarm", "exact"], typer.Option("--method", help="Termite swarm, or one exact pass over the whole map.")
]
Moisture = Annotated[str, typer.Option("--moisture", help="dry, normal, wet, or per cent of the dry weight.")]
UnknownSoil = Annotated[
    str,
    typer.Option(
        "--unknown-soil", help="What unknown soil counts as: a class, avoid, or neutral (goodness 3, not gated)."
    ),
]
Agents = Annotated[int | None, typer.Option("--agents", help="Termites. [default: 1024; 10 in the paper's profiles]")]
Pellets = Annotated[
    int | None, typer.Option("--pellets", help="Pellets that make a focus. [default: 1; 3 in the paper's profiles]")
]
Seed = Annotated[int, typer.Option("--seed", help="Seed of every random draw.")]
Threads = Annotated[int | None, typer.Option("--threads", help="Threads; the result is the same for any number.")]
Arc = Annotated[
    Literal["relaid", "spine", "circle", "line"] | None,
    typer.Option("--arc", help="How the arc is laid. [default: relaid; circle in the paper's profiles]"),
]
Sagitta = Annotated[float | None, typer.Option("--sagitta", help="Height of the circular arc over its chord, metres.")]
Width = Annotated[float | None, typer.Option("--width", help="Width of the swathe, metres. [default: 1/4 of the way]")]
PathOption = Annotated[
    Literal["auto", "grid8", "grid16", "any-angle", "drivable"],
    typer.Option(
        "--path",
        help="grid8: steps to 8 neighbours. grid16: to 16, then shortcuts. any-angle: vertices anywhere. drivable: "
        "arcs within the turning radius. auto: drivable for vehicles that need it on cells fine enough, else grid16.",
    ),
]
StartBearing = Annotated[
    float | None,
    typer.Option("--start-bearing", help="Degrees from north of the nose at the start of a drivable path."),
]
GoalBearing = Annotated[float | None, typer.Option("--goal-bearing", help="The same at the goal.")]
SoilTable = Annotated[
    Literal["text", "table2"], typer.Option("--soil-table", help="Goodness of silt: the paper's text 2, its table 3.")
]
Combine = Annotated[
    Literal["weighted", "min"], typer.Option("--combine", help="How height and soil goodness become a rank.")
]
Weights = Annotated[
    str | None, typer.Option("--weights", help="HEIGHT,SOIL weights that sum to 1. [default: 0.5,0.5, eq. 1]")
]
Directions = Annotated[
    Literal["worst", "mean", "best", "four"],
    typer.Option("--directions", help="Which differences count in the paper's table."),
]
Bands = Annotated[Literal["symmetric", "literal"], typer.Option("--bands", help="How the paper's bins are read.")]
Rounding = Annotated[
    Literal["half_away", "real"], typer.Option("--rounding", help="How real differences meet the paper's bins.")
]
PaperGrade = Annotated[float, typer.Option("--paper-grade", help="The paper's bound on safe travel, rise over run.")]
Explore = Annotated[
    Literal["walk", "uniform", "permute"],
    typer.Option(
        "--explore",
        help="How termites look about: step by step, deployed anew every tick, or each cell once an epoch. With the "
        "re-laid arc they are sent, and look about only where no arc leads.",
    ),
]
Stop = Annotated[
    Literal["good", "connected", "finished", "statistical"] | None,
    typer.Option(
        "--stop",
        help="When termites stop: the route is good enough, start and goal connect, nothing more can be found, or at "
        "most 0.1 % of the cells can be left to find (95 % confidence). [default: good with a start, a goal and the "
        "re-laid arc; else finished]",
    ),
]
MaxTicks = Annotated[int | None, typer.Option("--max-ticks", help="Most ticks; what is known by then is answered.")]
MaxEvaluations = Annotated[int | None, typer.Option("--max-evaluations", help="Most cells that termites look at.")]
MaxSeconds = Annotated[
    float | None,
    typer.Option("--max-seconds", help="Most seconds for the termites. Such a run is not reproducible."),
]
Out = Annotated[Path | None, typer.Option("--out", help="Folder to write. [default: swathe-<command>]")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]


def author_name(given: str | None) -> str:
    """Return who does something: the name given, or that of the user."""
    if given is not None:
        return given
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return ""


def terrain_request(
    *,
    dem: list[str] | None,
    soil: str | None,
    soil_field: str | None,
    soil_legend: str | None,
    cell_size: float | None,
    height_range: str | None,
    crs: str | None,
    points_crs: str | None,
    bounds: str | None,
    memory_limit: float | None,
    cost_raster: str | None = None,
    store: str | None = None,
    region: str | None = None,
    needs_ground: bool = True,
) -> TerrainRequest:
    """Return the ground that the options name."""
    from swathe.cli import say
    from swathe.config import TerrainRequest
    from swathe.errors import UsageError
    from swathe.io.memory import limit_of

    if needs_ground and not dem and store is None and region is None:
        raise UsageError("No ground was named.", "Give `--dem`, or `--store` and `--region`.")
    low_high = None if height_range is None else say.numbers("--height-range", height_range, 2)
    box = None if bounds is None else say.numbers("--bounds", bounds, 4)
    return TerrainRequest(
        dem=tuple(dem or ()),
        soil=soil,
        soil_field=soil_field,
        soil_legend=soil_legend,
        cost_raster=cost_raster,
        cell_size_m=cell_size,
        crs=crs,
        height_range_m=None if low_high is None else (low_high[0], low_high[1]),
        points_crs=points_crs,
        bounds=None if box is None else (box[0], box[1], box[2], box[3]),
        memory_limit_bytes=None if memory_limit is None else limit_of(memory_limit),
        store=store,
        region=region,
    )


def settings_of(
    *,
    vehicle: str,
    method: Literal["swarm", "exact"],
    profile: Literal["metric", "paper", "literal"],
    moisture: str,
    unknown_soil: str,
    agents: int | None,
    pellets: int | None,
    seed: int,
    threads: int | None,
    weights: str | None,
    arc: Literal["relaid", "spine", "circle", "line"] | None = None,
    sagitta: float | None = None,
    width: float | None = None,
    path: Literal["auto", "grid8", "grid16", "any-angle", "drivable"] = "auto",
    start_bearing: float | None = None,
    goal_bearing: float | None = None,
    objective: str = "time",
    bridge: bool = False,
    certify: bool = False,
    explore: Literal["walk", "uniform", "permute"] = "walk",
    stop: Literal["good", "connected", "finished", "statistical"] | None = None,
    max_ticks: int | None = None,
    max_evaluations: int | None = None,
    max_seconds: float | None = None,
    **rules: Any,  # noqa: ANN401 - the rank options, by the names of RankParams
) -> Settings:
    """Return how the ground is judged and the route found, as the options say."""
    from swathe.cli import say
    from swathe.config import Settings, use_threads
    from swathe.objective import as_objective
    from swathe.rank import RankParams, moisture_percent
    from swathe.swarm import StopParams

    use_threads(threads)
    height_soil = (0.5, 0.5) if weights is None else say.numbers("--weights", weights, 2)
    params = RankParams(
        profile=profile,
        moisture_percent=moisture_percent(moisture),
        unknown_soil=unknown_soil,
        height_weight=height_soil[0],
        soil_weight=height_soil[1],
        **rules,
    )
    return Settings(
        vehicle=vehicle,
        rank=params,
        method=method,
        agents=agents,
        pellet_max=pellets,
        explore=explore,
        stop=StopParams(rule=stop, max_ticks=max_ticks, max_evaluations=max_evaluations, max_seconds=max_seconds),
        seed=seed,
        arc=arc,
        sagitta_m=sagitta,
        width_m=width,
        path=path,
        start_bearing_deg=start_bearing,
        goal_bearing_deg=goal_bearing,
        objective=as_objective(objective),
        bridge=bridge,
        certify=certify,
    )
