"""The commands that drive: ``drive``, ``trials`` and ``replay``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from swathe.cli.options import (
    Bounds,
    CellSize,
    Crs,
    Debug,
    HeightRange,
    Json,
    Out,
    PointsCrs,
    Quiet,
    RegionName,
    Soil,
    SoilField,
    SoilLegend,
    Store,
    Threads,
)
from swathe.cli.root import app

if TYPE_CHECKING:
    from swathe.scenario import Scenario

_DEM = Annotated[list[str] | None, typer.Option("--dem", help="Elevation, as with `swathe plan`.")]
_START = Annotated[str | None, typer.Option("--start", help="LON,LAT where the vehicle is.")]
_GOAL = Annotated[str | None, typer.Option("--goal", help="LON,LAT where it should go.")]
_VEHICLE = Annotated[
    str | None, typer.Option("--vehicle", help="A vehicle of `swathe vehicles`, or a TOML file. [default: pioneer-3at]")
]
_SEED = Annotated[int | None, typer.Option("--seed", help="Seed of every random draw. [default: 0]")]
_LOCAL = Annotated[
    Literal["vfh", "vfh+", "vfh*", "player"] | None,
    typer.Option("--local", help="Local method: VFH 1991, VFH+ 1998, VFH* 2000, or as Player's. [default: vfh+]"),
]
_GRIDS = Annotated[
    Literal["or", "and", "single", "exact16"] | None,
    typer.Option("--grids", help="How the overlapping grids answer together. [default: or]"),
]


@app.command()
def drive(
    *,
    scenario: Annotated[
        str | None, typer.Option("--scenario", help="A bundled scenario (see `--list`) or a TOML file.")
    ] = None,
    plan: Annotated[Path | None, typer.Option("--plan", help="Folder of a plan whose route is to be driven.")] = None,
    dem: _DEM = None,
    store: Store = None,
    region: RegionName = None,
    share_as: Annotated[
        str | None,
        typer.Option("--share-as", help="With --store: file the drive's readings and its run, under this name."),
    ] = None,
    soil: Soil = None,
    soil_field: SoilField = None,
    soil_legend: SoilLegend = None,
    start: _START = None,
    goal: _GOAL = None,
    vehicle: _VEHICLE = None,
    profile: Annotated[
        Literal["metric", "paper", "literal"] | None, typer.Option("--profile", help="As with `swathe plan`.")
    ] = None,
    method: Annotated[
        Literal["swarm", "exact"] | None, typer.Option("--method", help="How the global route is found.")
    ] = None,
    moisture: Annotated[str | None, typer.Option("--moisture", help="As with `swathe plan`.")] = None,
    unknown_soil: Annotated[str | None, typer.Option("--unknown-soil", help="As with `swathe plan`.")] = None,
    agents: Annotated[int | None, typer.Option("--agents", help="Termites.")] = None,
    cell_size: CellSize = None,
    height_range: HeightRange = None,
    crs: Crs = None,
    points_crs: PointsCrs = None,
    bounds: Bounds = None,
    crates: Annotated[
        int | None, typer.Option("--crates", help="Crates along the route that the map does not show.")
    ] = None,
    soil_error: Annotated[
        float | None, typer.Option("--soil-error", help="Share (0..1) of the ground whose true soil is another.")
    ] = None,
    height_error: Annotated[
        float | None, typer.Option("--height-error", help="Deviation of the true heights from the map, metres.")
    ] = None,
    true_moisture: Annotated[
        str | None, typer.Option("--true-moisture", help="Moisture of the true ground. [default: that of --moisture]")
    ] = None,
    local: _LOCAL = None,
    grids: _GRIDS = None,
    outside_nests: Annotated[
        Literal["cost", "block"] | None,
        typer.Option("--outside-nests", help="Ground outside the nests costs more, or is closed as in the paper."),
    ] = None,
    soil_rule: Annotated[
        Literal["bayes", "paper_relabel"] | None,
        typer.Option("--soil-rule", help="What a reading changes: the belief by Bayes, or the class as in the paper."),
    ] = None,
    soil_types: Annotated[
        str | None,
        typer.Option("--soil-types", help="TOML table of what each soil type is like, in place of the bundled one."),
    ] = None,
    readings: Annotated[
        str | None,
        typer.Option("--readings", help="CSV of hand readings of a penetrometer that are known before the drive."),
    ] = None,
    probing: Annotated[
        Literal["never", "every", "where-it-matters", "where-it-pays"] | None,
        typer.Option("--probing", help="When the robot stops to push the penetrometer in."),
    ] = None,
    probe_every: Annotated[
        float | None, typer.Option("--probe-every", help="Metres between probes of `--probing every`.")
    ] = None,
    soil_feed: Annotated[
        Path | None,
        typer.Option("--soil-feed", help="JSON lines with news of the soil, taken in while driving."),
    ] = None,
    sensor: Annotated[
        Literal["laser", "sonar", "both"] | None,
        typer.Option("--sensor", help="What the robot sees with: a laser, a ring of sonars, or both. [default: laser]"),
    ] = None,
    laser: Annotated[
        Literal["sick-lms200-8m", "sick-lms200-80m", "sick-lms200-8m-361", "sick-lms200-80m-361"] | None,
        typer.Option("--laser", help="The laser. [default: sick-lms200-8m]"),
    ] = None,
    noise: Annotated[
        bool, typer.Option("--noise", help="Late scans, lost beams, odometry that drifts between fixes.")
    ] = False,
    body: Annotated[Literal["sim"], typer.Option("--body", help="What is driven: the built-in simulation.")] = "sim",
    time_limit: Annotated[float | None, typer.Option("--time-limit", help="Simulated seconds at most.")] = None,
    animate: Annotated[bool, typer.Option("--animate/--no-animate", help="Draw the animation of the drive.")] = True,
    list_scenarios: Annotated[bool, typer.Option("--list", help="List the bundled scenarios.")] = False,
    seed: _SEED = None,
    threads: Threads = None,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """Plan a route and drive it in a simulated world that differs from the map, around what the map does not show.

    The folder holds what `swathe plan` writes, the log of the drive (run.mcap, readable by ROS 2 tools), pictures and
    an animation.

    Examples:

      swathe drive --scenario paper

      swathe drive --dem dem.tif --soil soil.gpkg --start 10.05,51.53 --goal 10.06,51.54 --crates 40 --soil-error 0.3

      swathe drive --plan swathe-plan --crates 20 --probing where-it-pays

      swathe drive --scenario my-drive.toml --seed 7 --local "vfh*"

    Exit code 3 says that the goal was not reached, and why.
    """
    from swathe import driving
    from swathe.cli import say
    from swathe.config import use_threads
    from swathe.trials import NOISE

    if list_scenarios:
        say.scenarios(as_json=json)
        return 0
    use_threads(threads)
    changes = _changes(
        {
            "terrain.dem": dem or None,
            "terrain.store": store,
            "terrain.region": region,
            "terrain.soil": soil,
            "terrain.soil_field": soil_field,
            "terrain.soil_legend": soil_legend,
            "terrain.cell_size_m": cell_size,
            "terrain.crs": crs,
            "terrain.points_crs": points_crs,
            "terrain.height_range_m": None if height_range is None else say.numbers("--height-range", height_range, 2),
            "terrain.bounds": None if bounds is None else say.numbers("--bounds", bounds, 4),
            "vehicle": vehicle,
            "seed": seed,
            "plan.profile": profile,
            "plan.method": method,
            "plan.moisture": moisture,
            "plan.unknown_soil": unknown_soil,
            "plan.agents": agents,
            "drive.start": None if start is None else say.pair("--start", start),
            "drive.goal": None if goal is None else say.pair("--goal", goal),
            "drive.method": local,
            "drive.grids": grids,
            "drive.outside_nests": outside_nests,
            "drive.soil_rule": soil_rule,
            "drive.soil_types": soil_types,
            "drive.readings": readings,
            "drive.time_limit_s": time_limit,
            "probing.policy": probing,
            "probing.every_m": probe_every,
            "truth.soil_error": soil_error,
            "truth.height_error_m": height_error,
            "truth.moisture": true_moisture,
            "obstacles.crates": crates,
            "sensors.sensor": sensor,
            "sensors.laser": laser,
        }
    )
    wanted = _scenario(scenario, plan, changes)
    if noise:
        wanted = wanted.with_changes({"sensors": {**wanted.sensors.model_dump(), **NOISE}})
    with say.driving(quiet=quiet or json) as on_second, say.progress(quiet=quiet or json) as report:
        summary = driving.drive(
            wanted,
            out or Path("swathe-drive"),
            body=body,
            soil_feed=soil_feed,
            share_as=share_as,
            animate=animate,
            on_second=on_second,
            on_progress=report,
        )
    say.result(summary, as_json=json)
    return 0 if summary["status"] == "reached" else 3


def _changes(given: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in given.items() if value is not None}


def _scenario(name: str | None, plan: Path | None, changes: dict[str, Any]) -> Scenario:
    """Return the scenario that the options ask for."""
    from swathe.errors import UsageError
    from swathe.scenario import load_scenario, scenario_of

    if name is not None and plan is not None:
        raise UsageError("Both a scenario and a plan are named.", "Give one of `--scenario` and `--plan`.")
    if name is not None:
        return load_scenario(name).with_changes(changes)
    if plan is not None:
        from swathe.driving import scenario_of_plan

        return scenario_of_plan(plan).with_changes(changes)
    ground = {key: changes[f"terrain.{key}"] for key in ("dem", "store", "region") if f"terrain.{key}" in changes}
    if not ground:
        raise UsageError(
            "Nothing to drive on is named.",
            "Give `--scenario NAME`, `--plan DIR`, or `--dem FILE --start LON,LAT --goal LON,LAT`; `--list` shows the "
            "bundled scenarios.",
        )
    if not {"drive.start", "drive.goal"} <= changes.keys():
        raise UsageError("Start and goal are needed.", "Give `--start LON,LAT --goal LON,LAT`.")
    ends = {"start": changes["drive.start"], "goal": changes["drive.goal"]}
    return scenario_of({"terrain": ground, "drive": ends}, "The drive").with_changes(changes)


@app.command()
def trials(
    *,
    runs: Annotated[int, typer.Option("--runs", help="Seeds, from --seed on.")] = 100,
    scenario: Annotated[
        str | None, typer.Option("--scenario", help="Drive this scenario with other seeds instead of drawn worlds.")
    ] = None,
    vehicle: Annotated[
        list[str] | None, typer.Option("--vehicle", help="Vehicles in turn. [default: several of 0.4 to 4 m]")
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option(
            "--local",
            help="Methods side by side: navigator (VFH+ with memory and recoveries), vfh, vfh+, vfh*, player (alone). "
            "[default: navigator]",
        ),
    ] = None,
    grids: Annotated[
        list[str] | None, typer.Option("--grids", help="Modes of the overlapping grids side by side, with --scenario.")
    ] = None,
    probing: Annotated[
        list[str] | None, typer.Option("--probing", help="Probing policies side by side, with --scenario.")
    ] = None,
    noise: Annotated[
        bool, typer.Option("--noise", help="Late scans, lost beams, odometry that drifts between fixes.")
    ] = False,
    keep: Annotated[
        int, typer.Option("--keep", help="Of the worst runs so many are driven again, each into a log: worst-1.mcap.")
    ] = 3,
    workers: Annotated[int | None, typer.Option("--workers", help="Processes. [default: one a core]")] = None,
    seed: Annotated[int, typer.Option("--seed", help="The first seed.")] = 0,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """Drive many seeded worlds and tell how often, how far and how fast: a table with confidence intervals and CSV.

    The worst runs are listed, and kept as logs for `swathe replay`. Ctrl-C keeps what is done.

    Examples:

      swathe trials --runs 200

      swathe trials --runs 100 --local navigator --local "vfh+" --local vfh

      swathe trials --scenario wrong-soil --runs 100 --probing never --probing where-it-pays

      swathe replay swathe-trials/worst-1.mcap --out worst
    """
    from swathe import proving
    from swathe.cli import say

    with say.progress(quiet=quiet or json) as report:
        summary = proving.run_trials(
            out or Path("swathe-trials"),
            runs=runs,
            first_seed=seed,
            scenario=scenario,
            vehicles=vehicle,
            methods=method,
            grids=grids,
            probing=probing,
            noise=noise,
            workers=workers,
            keep=keep,
            on_progress=report,
        )
    say.line(summary, f"{summary['table']}\n{summary['outputs']['csv']}", as_json=json)
    return 0 if summary["status"] == "done" else 130


@app.command()
def replay(
    run: Annotated[Path, typer.Argument(help="A drive's folder, or its run.mcap.")],
    *,
    verify: Annotated[bool, typer.Option("--verify", help="Drive again and compare the logs byte for byte.")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder to write the drive to again, not the log's own.")
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """Tell what a log holds, drive it again from what it holds, or verify that it says the truth.

    Examples:

      swathe replay swathe-drive

      swathe replay swathe-drive --verify

      swathe replay swathe-drive/run.mcap --out again

    A log that was cut (a drive that was killed) is verified up to its cut. Exit code 3: the logs differ.
    """
    from swathe import driving
    from swathe.cli import say

    with say.driving(quiet=quiet or json) as on_second:
        answer = driving.replay(run, again=verify, out=out, on_second=on_second)
    say.line(answer, "\n".join(answer.pop("lines")), as_json=json)
    return 0 if answer["status"] in {"done", "equal"} else 3
