"""The commands and their options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from swathe.cli.options import (
    Agents,
    Arc,
    Bands,
    Bounds,
    CellSize,
    Combine,
    CostRaster,
    Crs,
    Debug,
    Dem,
    Directions,
    Explore,
    GoalBearing,
    HeightRange,
    Json,
    Keep,
    MaxEvaluations,
    MaxSeconds,
    MaxTicks,
    MemoryLimit,
    Method,
    Moisture,
    Objective,
    Out,
    PaperGrade,
    PathOption,
    Pellets,
    PointsCrs,
    Profile,
    Quiet,
    RegionName,
    Rounding,
    Sagitta,
    Seed,
    Soil,
    SoilField,
    SoilLegend,
    SoilTable,
    StartBearing,
    Stop,
    Store,
    Threads,
    UnknownSoil,
    VehicleName,
    Weights,
    Width,
    author_name,
    settings_of,
    terrain_request,
)
from swathe.cli.root import app as app  # noqa: PLC0414 - what this module is imported for
from swathe.cli.store import import_app, regions, withdraw


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
    """Plan and drive on bundled real terrain and tell the story.

    A farm tractor and a 4x4 cross the hills at the Jacksboro fault (USGS elevation, soil generated from it by rule):
    the tractor goes a long way round, the 4x4 nearly straight, and at a ridge the tractor is refused with a reason.
    Then the tractor drives a field leg, around things that no map shows.

    Example:

      swathe demo --out my-demo
    """
    from swathe.cli.story import tell

    return tell(out or Path("swathe-demo"), as_json=json, quiet=quiet)


@app.command()
def plan(
    *,
    dem: Dem = None,
    store: Store = None,
    region: RegionName = None,
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
    explore: Explore = "walk",
    stop: Stop = None,
    max_ticks: MaxTicks = None,
    max_evaluations: MaxEvaluations = None,
    max_seconds: MaxSeconds = None,
    arc: Arc = None,
    sagitta: Sagitta = None,
    width: Width = None,
    path: PathOption = "auto",
    start_bearing: StartBearing = None,
    goal_bearing: GoalBearing = None,
    objective: Objective = "time",
    cost_raster: CostRaster = None,
    bridge: Annotated[
        bool, typer.Option("--bridge", help="Allow suitable ground outside nests when nothing else connects.")
    ] = False,
    certify: Annotated[
        bool, typer.Option("--certify", help="Widen the swathe until the route is known to be the map's best.")
    ] = False,
    animate: Annotated[
        bool, typer.Option("--animate", help="Add an animation of termites and arc, as GIF and as HTML page.")
    ] = False,
    keep: Keep = False,
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

      swathe plan --dem dem.tif --start 10.05,51.53 --goal 10.15,51.60 --max-evaluations 20000 --animate

      swathe plan --store my-project --region valley --start 10.05,51.53 --goal 10.15,51.60

    A negative answer (exit code 3) says what is in the way, where, and what would change it.
    """
    from swathe import mission
    from swathe.cli import say

    terrain = terrain_request(
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
        cost_raster=cost_raster,
        store=store,
        region=region,
    )
    settings = settings_of(
        vehicle=vehicle,
        method=method,
        profile=profile,
        moisture=moisture,
        unknown_soil=unknown_soil,
        agents=agents,
        pellets=pellets,
        seed=seed,
        threads=threads,
        explore=explore,
        stop=stop,
        max_ticks=max_ticks,
        max_evaluations=max_evaluations,
        max_seconds=max_seconds,
        arc=arc,
        sagitta=sagitta,
        width=width,
        path=path,
        start_bearing=start_bearing,
        goal_bearing=goal_bearing,
        objective=objective,
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
        summary = mission.plan_route(
            terrain,
            *ends,
            settings,
            out or Path("swathe-plan"),
            animate=animate,
            keep_as=author_name(None) if keep else None,
            on_progress=report,
        )
    say.result(summary, as_json=json)
    return 0 if summary["status"] == "route_found" else 3


@app.command()
def nests(
    *,
    dem: Dem = None,
    soil: Soil = None,
    store: Store = None,
    region: RegionName = None,
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
    explore: Explore = "walk",
    stop: Stop = None,
    max_ticks: MaxTicks = None,
    max_evaluations: MaxEvaluations = None,
    max_seconds: MaxSeconds = None,
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

      swathe nests --dem dem.tif --explore uniform --stop statistical --max-ticks 5000
    """
    from swathe import mission
    from swathe.cli import say
    from swathe.cli.compare import ends_of

    terrain = terrain_request(
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
        store=store,
        region=region,
    )
    settings = settings_of(
        vehicle=vehicle,
        method=method,
        profile=profile,
        moisture=moisture,
        unknown_soil=unknown_soil,
        agents=agents,
        pellets=pellets,
        seed=seed,
        threads=threads,
        explore=explore,
        stop=stop,
        max_ticks=max_ticks,
        max_evaluations=max_evaluations,
        max_seconds=max_seconds,
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
    store: Store = None,
    region: RegionName = None,
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

    terrain = terrain_request(
        dem=dem,
        store=store,
        region=region,
        soil=soil,
        soil_field=soil_field,
        soil_legend=soil_legend,
        cell_size=cell_size,
        height_range=height_range,
        crs=crs,
        points_crs=points_crs,
        bounds=bounds,
        memory_limit=memory_limit,
        needs_ground=False,
    )
    settings = settings_of(
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
def export(
    folder: Annotated[Path, typer.Argument(help="A run's folder.")],
    *,
    to: Annotated[Literal["grass"], typer.Option("--format", help="What to write.")],  # noqa: ARG001 - one so far
    location: Annotated[Path, typer.Option("--location", help="GRASS location; made when it is not there.")],
    mapset: Annotated[str, typer.Option("--mapset", help="Its mapset; made when it is not there.")] = "swathe",
    prefix: Annotated[str, typer.Option("--prefix", help="How the names of the maps begin.")] = "swathe",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace maps of these names.")] = False,
    dem: Annotated[
        list[str] | None,
        typer.Option("--dem", help="Elevation of the run, as it was given there; without it none is written."),
    ] = None,
    cell_size: CellSize = None,
    height_range: HeightRange = None,
    crs: Crs = None,
    json: Json = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """Write a run's ranks, nests, route and elevation for another program.

    Example:

      swathe export swathe-plan --format grass --location grassdata/hills --dem dem.tif
    """
    from swathe.cli import export as exporting

    terrain = terrain_request(
        dem=dem or [],
        soil=None,
        soil_field=None,
        soil_legend=None,
        cell_size=cell_size,
        height_range=height_range,
        crs=crs,
        points_crs=None,
        bounds=None,
        memory_limit=None,
    )
    return exporting.write(
        folder, location, mapset=mapset, prefix=prefix, overwrite=overwrite, terrain=terrain, as_json=json
    )


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


app.add_typer(import_app, name="import")
app.command()(regions)
app.command()(withdraw)


# Imported last, so that its commands stand behind these in the list.
from swathe.cli import drives as _drives  # noqa: E402, F401
