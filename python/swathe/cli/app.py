"""The commands and their options."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

if TYPE_CHECKING:
    from swathe.mission import Settings, TerrainRequest

app = typer.Typer(
    name="swathe",
    help="Plan routes for ground vehicles where there is no road.\n\n"
    "Start with `swathe demo`. Every command has examples under `--help`.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)

GROUND = "The ground"
METHOD = "How it is judged"
OUTPUT = "What you get"

Dem = Annotated[
    list[str],
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
SoilField = Annotated[
    str | None, typer.Option("--soil-field", help="Attribute of the soil map that names the soil, e.g. cat.")
]
SoilLegend = Annotated[str | None, typer.Option("--soil-legend", help="CSV that explains the soil map's values.")]
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
Out = Annotated[Path | None, typer.Option("--out", help="Folder to write. [default: swathe-<command>]")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    from swathe.cli import say

    if version:
        import swathe

        say.show(f"swathe {swathe.__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        say.show(context.get_help())
        raise typer.Exit


@app.command()
def demo(out: Out = None, json: Json = False, quiet: Quiet = False, debug: Debug = False) -> int:  # noqa: ARG001
    """Plan on bundled real terrain and tell the story.

    A farm tractor and a 4x4 cross the hills at the Jacksboro fault (USGS elevation, soil generated from it by rule):
    the tractor goes a long way round, the 4x4 nearly straight, and at a ridge the tractor is refused with a reason.

    Example:

      swathe demo --out my-demo
    """
    from swathe.cli.story import tell

    return tell(out or Path("swathe-demo"), as_json=json, quiet=quiet)


@app.command()
def plan(
    *,
    dem: Dem,
    start: Annotated[str, typer.Option("--start", help="LON,LAT where the vehicle is.")],
    goal: Annotated[str, typer.Option("--goal", help="LON,LAT where it should go.")],
    soil: Soil = None,
    soil_field: SoilField = None,
    soil_legend: SoilLegend = None,
    vehicle: VehicleName = "pioneer-3at",
    method: Method = "swarm",
    profile: Profile = "metric",
    cell_size: CellSize = None,
    height_range: HeightRange = None,
    crs: Crs = None,
    points_crs: PointsCrs = None,
    bounds: Bounds = None,
    moisture: Moisture = "normal",
    unknown_soil: UnknownSoil = "neutral",
    agents: Agents = None,
    pellets: Pellets = None,
    seed: Seed = 0,
    threads: Threads = None,
    arc: Arc = None,
    sagitta: Sagitta = None,
    width: Width = None,
    bridge: Annotated[
        bool, typer.Option("--bridge", help="Allow suitable ground outside nests when nothing else connects.")
    ] = False,
    certify: Annotated[
        bool, typer.Option("--certify", help="Widen the swathe until the route is known to be the map's best.")
    ] = False,
    soil_table: SoilTable = "text",
    combine: Combine = "weighted",
    weights: Weights = None,
    directions: Directions = "worst",
    bands: Bands = "symmetric",
    rounding: Rounding = "half_away",
    paper_grade: PaperGrade = 0.25,
    memory_limit: MemoryLimit = None,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """Plan a route and write its folder: route and nests as GeoJSON, ranks as GeoTIFF, map, profile and report.

    Examples:

      swathe plan --dem dem.tif --soil soil.gpkg --soil-field cat --start 10.05,51.53 --goal 10.15,51.60

      swathe plan --dem N44W072.hgt --start=-71.7,44.1 --goal=-71.5,44.3 --vehicle tractor --moisture wet

      swathe plan --dem heights.png --cell-size 10 --height-range 0,255 --points-crs native --start 50,50 --goal 900,700

    A negative answer (exit code 3) says what is in the way, where, and what would change it.
    """
    from swathe import mission
    from swathe.cli import say

    terrain = _terrain(
        dem=dem,
        soil=soil,
        soil_field=soil_field,
        soil_legend=soil_legend,
        cell_size=cell_size,
        height_range=height_range,
        crs=crs,
        points_crs=points_crs,
        bounds=bounds,
        memory_limit=memory_limit,
    )
    settings = _settings(
        vehicle=vehicle,
        method=method,
        profile=profile,
        moisture=moisture,
        unknown_soil=unknown_soil,
        agents=agents,
        pellets=pellets,
        seed=seed,
        threads=threads,
        arc=arc,
        sagitta=sagitta,
        width=width,
        bridge=bridge,
        certify=certify,
        soil_table=soil_table,
        combine=combine,
        weights=weights,
        directions=directions,
        bands=bands,
        rounding=rounding,
        paper_grade=paper_grade,
    )
    ends = say.pair("--start", start), say.pair("--goal", goal)
    with say.progress(quiet=quiet or json) as report:
        summary = mission.plan_route(terrain, *ends, settings, out or Path("swathe-plan"), on_progress=report)
    say.result(summary, as_json=json)
    return 0 if summary["status"] == "route_found" else 3


@app.command()
def nests(
    *,
    dem: Dem,
    soil: Soil = None,
    soil_field: SoilField = None,
    soil_legend: SoilLegend = None,
    vehicle: VehicleName = "pioneer-3at",
    method: Method = "swarm",
    profile: Profile = "metric",
    start: Annotated[
        str | None, typer.Option("--start", help="LON,LAT; with --goal only the swathe is searched.")
    ] = None,
    goal: Annotated[str | None, typer.Option("--goal", help="LON,LAT of the other end of the swathe.")] = None,
    compare: Annotated[
        bool,
        typer.Option("--compare", help="Run swarm, exact pass and, with --start and --goal, lazy A* side by side."),
    ] = False,
    seeds: Annotated[int, typer.Option("--seeds", help="Seeds that --compare runs, for 95 % intervals.")] = 1,
    animate: Annotated[
        bool, typer.Option("--animate", help="Add an animation of the swarm, as GIF and as HTML page.")
    ] = False,
    cell_size: CellSize = None,
    height_range: HeightRange = None,
    crs: Crs = None,
    points_crs: PointsCrs = None,
    bounds: Bounds = None,
    moisture: Moisture = "normal",
    unknown_soil: UnknownSoil = "neutral",
    agents: Agents = None,
    pellets: Pellets = None,
    seed: Seed = 0,
    threads: Threads = None,
    arc: Arc = None,
    sagitta: Sagitta = None,
    width: Width = None,
    soil_table: SoilTable = "text",
    combine: Combine = "weighted",
    weights: Weights = None,
    directions: Directions = "worst",
    bands: Bands = "symmetric",
    rounding: Rounding = "half_away",
    paper_grade: PaperGrade = 0.25,
    memory_limit: MemoryLimit = None,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """Find the navigable regions (nests) of the whole map.

    Examples:

      swathe nests --dem dem.tif --soil soil.gpkg --vehicle tractor

      swathe nests --dem bundled:jacksboro --soil bundled:jacksboro --vehicle tractor --compare

      swathe nests --dem dem.tif --start 10.03,51.52 --goal 10.12,51.58 --compare --seeds 20

      swathe nests --dem bundled:jacksboro --vehicle tractor --animate
    """
    from swathe import mission
    from swathe.cli import say
    from swathe.cli.compare import ends_of

    terrain = _terrain(
        dem=dem,
        soil=soil,
        soil_field=soil_field,
        soil_legend=soil_legend,
        cell_size=cell_size,
        height_range=height_range,
        crs=crs,
        points_crs=points_crs,
        bounds=bounds,
        memory_limit=memory_limit,
    )
    settings = _settings(
        vehicle=vehicle,
        method=method,
        profile=profile,
        moisture=moisture,
        unknown_soil=unknown_soil,
        agents=agents,
        pellets=pellets,
        seed=seed,
        threads=threads,
        arc=arc,
        sagitta=sagitta,
        width=width,
        soil_table=soil_table,
        combine=combine,
        weights=weights,
        directions=directions,
        bands=bands,
        rounding=rounding,
        paper_grade=paper_grade,
    )
    with say.progress(quiet=quiet or json) as report:
        summary = mission.find_nests(
            terrain,
            settings,
            out or Path("swathe-nests"),
            ends=ends_of(start, goal),
            compare=compare,
            seeds=seeds,
            animate=animate,
            on_progress=report,
        )
    say.result(summary, as_json=json)
    return 0


@app.command()
def figures(
    *,
    dem: Annotated[
        list[str] | None,
        typer.Option("--dem", help="Elevation, as with `swathe plan`. [default: bundled:jacksboro with its soil]"),
    ] = None,
    soil: Soil = None,
    soil_field: SoilField = None,
    soil_legend: SoilLegend = None,
    start: Annotated[str | None, typer.Option("--start", help="LON,LAT where the global path begins.")] = None,
    goal: Annotated[str | None, typer.Option("--goal", help="LON,LAT where it ends.")] = None,
    vehicle: VehicleName = "tractor",
    method: Method = "swarm",
    profile: Profile = "metric",
    cell_size: CellSize = None,
    height_range: HeightRange = None,
    crs: Crs = None,
    points_crs: PointsCrs = None,
    bounds: Bounds = None,
    moisture: Moisture = "normal",
    unknown_soil: UnknownSoil = "neutral",
    seed: Seed = 0,
    threads: Threads = None,
    memory_limit: MemoryLimit = None,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """Draw the paper's figures: flow charts, height map, terrain, soil, grids, nests and global path.

    Example:

      swathe figures --out my-figures
    """
    from swathe.cli import figures as drawing
    from swathe.cli.compare import ends_of

    terrain = _terrain(
        dem=dem or [],
        soil=soil,
        soil_field=soil_field,
        soil_legend=soil_legend,
        cell_size=cell_size,
        height_range=height_range,
        crs=crs,
        points_crs=points_crs,
        bounds=bounds,
        memory_limit=memory_limit,
    )
    settings = _settings(
        vehicle=vehicle,
        method=method,
        profile=profile,
        moisture=moisture,
        unknown_soil=unknown_soil,
        agents=None,
        pellets=None,
        seed=seed,
        threads=threads,
        weights=None,
    )
    ends = ends_of(start, goal)
    return drawing.draw(terrain, settings, out or Path("swathe-figures"), ends=ends, as_json=json, quiet=quiet)


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(help="A run's folder.")],
    json: Json = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """Write a run's report anew: one HTML file that needs nothing else.

    Example:

      swathe report swathe-plan
    """
    from swathe.cli import say
    from swathe.report.html import write_html

    say.line({"status": "done", "outputs": {"report": str(path := write_html(folder))}}, str(path), as_json=json)
    return 0


@app.command()
def vehicles(
    name: Annotated[str | None, typer.Argument(help="A vehicle, or a TOML file of your own, to show in full.")] = None,
    json: Json = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """List the vehicles, or show one with every figure and its source.

    Examples:

      swathe vehicles

      swathe vehicles tractor

      swathe vehicles my-rover.toml
    """
    from swathe.cli import say

    say.vehicles(name, as_json=json)
    return 0


@app.command()
def doctor(json: Json = False, debug: Debug = False) -> int:  # noqa: ARG001
    """Check this installation: versions, terrain, memory, and what optional parts are missing.

    Example:

      swathe doctor
    """
    from swathe.cli.doctor import examine

    return examine(as_json=json)


def _terrain(
    *,
    dem: list[str],
    soil: str | None,
    soil_field: str | None,
    soil_legend: str | None,
    cell_size: float | None,
    height_range: str | None,
    crs: str | None,
    points_crs: str | None,
    bounds: str | None,
    memory_limit: float | None,
) -> TerrainRequest:
    from swathe.cli import say
    from swathe.io.memory import limit_of
    from swathe.mission import TerrainRequest

    low_high = None if height_range is None else say.numbers("--height-range", height_range, 2)
    box = None if bounds is None else say.numbers("--bounds", bounds, 4)
    return TerrainRequest(
        dem=tuple(dem),
        soil=soil,
        soil_field=soil_field,
        soil_legend=soil_legend,
        cell_size_m=cell_size,
        crs=crs,
        height_range_m=None if low_high is None else (low_high[0], low_high[1]),
        points_crs=points_crs,
        bounds=None if box is None else (box[0], box[1], box[2], box[3]),
        memory_limit_bytes=None if memory_limit is None else limit_of(memory_limit),
    )


def _settings(
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
    bridge: bool = False,
    certify: bool = False,
    **rules: Any,  # noqa: ANN401 - the rank options, by the names of RankParams
) -> Settings:
    from swathe.cli import say
    from swathe.mission import Settings, use_threads
    from swathe.rank import RankParams, moisture_percent

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
        seed=seed,
        arc=arc,
        sagitta_m=sagitta,
        width_m=width,
        bridge=bridge,
        certify=certify,
    )
