"""The files of a run's folder: route, nests, ranks, pictures, report and, last, the summary."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from swathe import nest as nesting
from swathe import planner
from swathe.errors import InterruptedBySignalError, UnreadableFileError
from swathe.export.folder import SUMMARY, to_json, write_text
from swathe.export.geojson import drivable_collection, nest_collection, route_collection
from swathe.io.lazy import TRIES
from swathe.io.raster import write_raster
from swathe.planning import ranks_of
from swathe.report.palette import rank_colour_table

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from swathe.io.lazy import LazyElevation
    from swathe.planner import Plan
    from swathe.preparation import Ground, Stopwatch

    OnProgress = Callable[[str, int, int], bool]


def write(
    folder: Path,
    out: Path,
    ground: Ground,
    found: Plan | nesting.Nests,
    summary: dict[str, Any],
    *,
    watch: Stopwatch,
    on_progress: OnProgress | None,
    log: Path | None = None,
) -> None:
    """Write every file of a run into its staging folder, the summary last; ``log`` is one that is already in place."""
    answer = found if isinstance(found, planner.Plan) else None
    nests = found if isinstance(found, nesting.Nests) else found.nests
    frame, region = ground.frame, ground.region
    origin = {key: summary[key] for key in ("version", "seed", "inputs")}
    tags = {
        "swathe_version": str(summary["version"]),
        "swathe_seed": str(summary["seed"]),
        "swathe_inputs": "; ".join(f"{given['name']} {given['sha256']}" for given in summary["inputs"]),
    }
    tell(on_progress, "writing", 0, 5)
    if answer is not None:
        with watch.step("write_route"):
            write_text(folder / "route.geojson", to_json(route_collection(answer.route, frame, origin)))
            if answer.drivable is not None:
                write_text(folder / "drivable.geojson", to_json(drivable_collection(answer.drivable, frame, origin)))
    tell(on_progress, "writing", 1, 5)
    with watch.step("write_maps"):
        outlines: list[nesting.Outline] = []
        if nests is not None:
            outlines = nesting.outlines(nests, region.geometry)
            gaps = nesting.nest_graph(nests, region.geometry)
            area_m2 = region.geometry.cell_size_m**2
            collection = nest_collection(nests, outlines, gaps, area_m2, frame=frame, origin=origin)
            write_text(folder / "nests.geojson", to_json(collection))
        ranks = ranks_of(ground)
        write_raster(
            folder / "rank.tif",
            ranks,
            frame,
            nodata=0,
            colours=rank_colour_table(),
            tags=tags,
            description="rank: 0 unknown, 1 no-go, 2 worst to 10 best",
        )
        tell(on_progress, "writing", 2, 5)
        from swathe.report import run_pictures

        run_pictures.draw(folder, region, frame, ranks, outlines, plan=answer, summary=summary, metadata=tags)
    tell(on_progress, "writing", 4, 5)
    write_summary(folder, out, summary, watch, ("report.html", *(() if log is None else (log.name,))))
    from swathe.report.html import write_html

    write_html(folder, log=log)
    tell(on_progress, "writing", 5, 5)


def unread_error(
    lazy: LazyElevation | None, answer: Plan, summary: dict[str, Any], out: Path
) -> UnreadableFileError | None:
    """Return the error of a plan that could not read what it needed, its words put into the summary, or None."""
    if lazy is None or answer.status != "unread":
        return None
    why = "" if lazy.failure is None else lazy.failure.message
    remedy = "" if lazy.failure is None else lazy.failure.remedy
    place = ""
    if lazy.failed_window is not None:
        row, column, rows, columns = lazy.failed_window
        place = f" The tile of rows {row} to {row + rows - 1}, columns {column} to {column + columns - 1} was tried"
        place += f" {TRIES} times."
    error = UnreadableFileError(
        f"{why}{place} Until then {summary['cells_evaluated']:,} cells were evaluated and {summary['tiles_read']:,} of "
        f"{summary['tiles_total']:,} tiles read.",
        f"{remedy} The nests found so far are in {out}.",
    )
    summary |= {"status": "error", "kind": error.kind, "reason": error.message, "remedy": error.remedy}
    return error


def write_unread(
    folder: Path, out: Path, ground: Ground, answer: Plan, summary: dict[str, Any], *, watch: Stopwatch
) -> None:
    """Write what is known when the ground could not be read: the nests, and the summary."""
    region = ground.region
    origin = {key: summary[key] for key in ("version", "seed", "inputs")}
    if answer.nests is not None:
        with watch.step("write_maps"):
            outlines = nesting.outlines(answer.nests, region.geometry)
            gaps = nesting.nest_graph(answer.nests, region.geometry)
            area_m2 = region.geometry.cell_size_m**2
            collection = nest_collection(answer.nests, outlines, gaps, area_m2, frame=ground.frame, origin=origin)
            write_text(folder / "nests.geojson", to_json(collection))
    write_summary(folder, out, summary, watch, ())


def write_summary(folder: Path, out: Path, summary: dict[str, Any], watch: Stopwatch, later: tuple[str, ...]) -> None:
    """Write the summary, which names every file of the folder and those that come ``later``."""
    names = sorted({entry.name for entry in folder.iterdir()} | {SUMMARY, *later})
    summary["outputs"] = {_output_key(name): name for name in names}
    summary["timings_s"] = {name: round(seconds, 4) for name, seconds in watch.seconds.items()}
    write_text(folder / SUMMARY, to_json(summary))
    # Callers get paths that they can open; the file holds names, so that the folder can be moved.
    summary["outputs"] = {name: str(out / path) for name, path in summary["outputs"].items()}


def _output_key(name: str) -> str:
    """Return the name of an output: that of its file without the ending, but where two would be one."""
    two = {"animation.gif": "animation_gif", "animation.html": "animation_html", "drive.gif": "drive_gif"}
    return two.get(name, name.partition(".")[0])


def tell(on_progress: OnProgress | None, stage: str, done: int, total: int) -> None:
    """Report progress; raises InterruptedBySignalError when the user asks to stop."""
    # Only False stops: a callback that returns nothing means "go on".
    if on_progress is not None and on_progress(stage, done, total) is False:
        raise InterruptedBySignalError("Writing was stopped.", "Nothing was written.")
