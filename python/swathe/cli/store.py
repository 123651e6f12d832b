"""``swathe import``, ``regions`` and ``withdraw``: filling a terrain store and looking after it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from swathe.cli.options import (
    CellSize,
    Crs,
    Debug,
    HeightRange,
    Json,
    PointsCrs,
    Quiet,
    SoilField,
    SoilLegend,
    author_name,
)

if TYPE_CHECKING:
    from collections.abc import Callable

import_app = typer.Typer(
    name="import",
    help="Put elevation, soil, zones and readings into a store, from which plans are made.\n\n"
    "The same source twice is no change; what was broken off goes on where it stopped.\n\n"
    "Example:\n\n"
    "  swathe import dem dem.tif --store my-project --region valley",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Url = Annotated[
    str, typer.Option("--store", help="Project folder, made when it is not there, or postgresql://host/database.")
]
Region = Annotated[str, typer.Option("--region", help="Name of the region.")]
Licence = Annotated[str, typer.Option("--licence", help="A note on the terms of the data, kept with it.")]
Author = Annotated[str | None, typer.Option("--author", help="Who imports it. [default: your user name]")]


@import_app.command()
def dem(
    sources: Annotated[list[str], typer.Argument(metavar="SOURCE...", help="Elevation, as with `swathe plan --dem`.")],
    *,
    store: Url,
    region: Region,
    cell_size: CellSize = None,
    crs: Crs = None,
    height_range: HeightRange = None,
    licence: Licence = "",
    author: Author = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """Import elevation; it makes the region.

    Examples:

      swathe import dem dem.tif --store my-project --region valley --licence "dl-de/by-2-0"

      swathe import dem N44W072.hgt N44W071.hgt --store postgresql:///terrain --region "White Mountains"
    """
    from swathe.cli import say
    from swathe.store import imports

    low_high = None if height_range is None else say.pair("--height-range", height_range)
    return _filled(
        lambda opened, report: imports.import_elevation(
            opened,
            region,
            sources,
            cell_size_m=cell_size,
            crs=crs,
            height_range_m=low_high,
            licence=licence,
            author=author_name(author),
            on_progress=report,
        ),
        store,
        create=True,
        as_json=json,
        quiet=quiet,
    )


@import_app.command()
def soil(
    source: Annotated[str, typer.Argument(help="Soil map, as with `swathe plan --soil`.")],
    *,
    store: Url,
    region: Region,
    soil_field: SoilField = None,
    soil_legend: SoilLegend = None,
    licence: Licence = "",
    author: Author = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """Import a soil map: polygons, or a raster.

    Example:

      swathe import soil soil.gpkg --soil-field cat --soil-legend legend.csv --store my-project --region valley
    """
    from swathe.store import imports

    return _filled(
        lambda opened, report: imports.import_soil(
            opened,
            region,
            source,
            field=soil_field,
            legend=soil_legend,
            licence=licence,
            author=author_name(author),
            on_progress=report,
        ),
        store,
        as_json=json,
        quiet=quiet,
    )


@import_app.command()
def zones(
    source: Annotated[str, typer.Argument(help="Vector of polygons, or PATH|layername=NAME.")],
    *,
    store: Url,
    region: Region,
    licence: Licence = "",
    author: Author = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """Import zones that no vehicle may enter.

    Example:

      swathe import zones reserves.gpkg --store my-project --region valley
    """
    from swathe.store import imports

    return _filled(
        lambda opened, report: imports.import_zones(
            opened, region, source, licence=licence, author=author_name(author), on_progress=report
        ),
        store,
        as_json=json,
        quiet=quiet,
    )


@import_app.command()
def readings(
    source: Annotated[str, typer.Argument(help="CSV of penetrometer readings, one push a line.")],
    *,
    store: Url,
    region: Region,
    points_crs: PointsCrs = None,
    instrument: Annotated[str, typer.Option("--instrument", help="The very instrument, e.g. its serial number.")] = "",
    error: Annotated[
        float | None, typer.Option("--error", help="Standard deviation of the cone index over the cone index.")
    ] = None,
    time: Annotated[str, typer.Option("--time", help="When, ISO 8601. [default: when the file was changed]")] = "",
    author: Author = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """File readings of a penetrometer; the next plan heeds them.

    Example:

      swathe import readings readings.csv --instrument CP-17 --store my-project --region valley
    """
    from swathe.store import imports

    return _filled(
        lambda opened, _: imports.import_readings(
            opened,
            region,
            source,
            points_crs=points_crs,
            author=author_name(author),
            instrument=instrument,
            error=error,
            time=time,
        ),
        store,
        as_json=json,
        quiet=quiet,
    )


def regions(
    *,
    store: Url,
    json: Json = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """List the regions of a store, with their layers and where these come from.

    Example:

      swathe regions --store my-project
    """
    from swathe.cli import say
    from swathe.store import open_store

    listed, lines = [], []
    with open_store(store) as opened:
        for region in opened.regions():
            geometry = region.frame.geometry
            counting = len(opened.readings(region.name))
            lines.append(
                f"{region.name}: {geometry.rows:,} x {geometry.columns:,} cells of {geometry.cell_size_m:g} m, "
                f"{region.frame.name}, {counting:,} readings"
            )
            layers = []
            for layer in region.layers.values():
                origin = layer.provenance
                names = ", ".join(name for name, _ in origin.inputs)
                licence = f", {origin.licence}" if origin.licence else ""
                lines.append(f"  {layer.name:12} {names}, {origin.time[:10]} by {origin.author or 'nobody'}{licence}")
                inputs = [{"name": name, "sha256": sha256} for name, sha256 in origin.inputs]
                told = {"inputs": inputs, "licence": origin.licence, "author": origin.author, "time": origin.time}
                layers.append({"name": layer.name, "kind": layer.kind, **told})
            listed.append(
                {
                    "name": region.name,
                    "rows": geometry.rows,
                    "columns": geometry.columns,
                    "cell_size_m": geometry.cell_size_m,
                    "crs": region.frame.name,
                    "readings": counting,
                    "layers": layers,
                }
            )
        address = opened.address
    answer = {"status": "done", "store": address, "regions": listed}
    say.line(answer, "\n".join(lines) or f"{address} has no regions yet.", as_json=json)
    return 0


def withdraw(
    *,
    store: Url,
    region: Region,
    reason: Annotated[str, typer.Option("--reason", help="Why; kept with the readings.")],
    instrument: Annotated[str | None, typer.Option("--instrument", help="All readings of this instrument.")] = None,
    author: Annotated[str | None, typer.Option("--author", help="All readings of this author.")] = None,
    reading: Annotated[
        list[str] | None, typer.Option("--reading", help="A reading by its id; may be repeated.")
    ] = None,
    json: Json = False,
    debug: Debug = False,  # noqa: ARG001
) -> int:
    """Let readings of a store count no more; they are kept, and what is believed of the soil follows.

    Example:

      swathe withdraw --instrument CP-17 --reason "the cone was worn" --store my-project --region valley
    """
    from swathe.cli import say
    from swathe.store import open_store

    with open_store(store) as opened:
        gone = opened.withdraw(region, reason, instrument=instrument, author=author, ids=reading)
    answer = {"status": "done" if gone else "no_change", "region": region, "withdrawn": gone}
    say.line(answer, f"{gone:,} readings of {region} count no more.", as_json=json)
    return 0


def _filled(
    fill: Callable[[Any, Any], dict[str, Any]], url: str, *, create: bool = False, as_json: bool, quiet: bool
) -> int:
    """Open the store, fill it and say what was done."""
    from swathe.cli import say
    from swathe.store import open_store

    with open_store(url, create=create) as opened:
        with say.progress(quiet=quiet or as_json) as report:
            answer = fill(opened, report)
        answer["store"] = opened.address
    say.line(answer, _words(answer), as_json=as_json)
    return 0


def _words(answer: dict[str, Any]) -> str:
    names = ", ".join(entry["name"] for entry in answer["inputs"])
    where = f"{answer['region']} of {answer['store']}"
    if answer["status"] == "no_change":
        return f"No change: {where} holds the {answer['what']} of {names} already."
    more = ""
    if "rows" in answer:
        more = f", {answer['rows']:,} x {answer['columns']:,} cells"
    elif "new" in answer:
        more = f", {answer['new']:,} new of {answer['readings']:,}"
    if answer.get("left_out"):
        more += f"; {answer['left_out']:,} features without area were left out"
    return f"Imported {answer['what']} from {names} into {where}{more}."
