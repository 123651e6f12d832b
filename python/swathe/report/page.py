"""The text of the HTML report, section by section. Every value that comes from a file is escaped."""

from __future__ import annotations

import base64
import hashlib
import html
import itertools
from importlib import resources
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from swathe.export.folder import DRIVE_PICTURES
from swathe.report import wording
from swathe.report.palette import SOIL_COLOURS
from swathe.report.wording import MISSING, number

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from swathe.episode import Event
    from swathe.report.html import RunFolder

# Longer tables of legs are folded away; past the second limit the rest is left to the GeoJSON file.
_MOST_OPEN_LEGS = 40
_MOST_LEGS = 2000
_MOST_NESTS = 20
_MOST_NEST_COLUMNS = 7
_MOST_EVENTS = 500
_MOST_OF_A_KIND = 3
_DRIVE_WORDS = {
    "drive-map.png": "Map of the drive: the global route, the way that was driven dotted, obstacles and what was seen.",
    "drive.gif": "The drive as an animation.",
    "drive-frames.png": "Moments of the drive: scan, certainty grid, polar histogram and command.",
    "drive-profile.png": "Speed, clearance and turn rate over time.",
}


def page(run: RunFolder) -> str:
    """Return the whole page."""
    style = resources.files("swathe.report").joinpath("page.css").read_text(encoding="utf-8")
    style += "".join(f".soil-{name} {{ background: {colour}; }}\n" for name, colour in SOIL_COLOURS.items())
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    policy = f"default-src 'none'; img-src data:; style-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    summary = run.summary
    sections = [
        _header(summary),
        _tiles(summary),
        _drive(run),
        _picture(run.map_base64, f"Map of the run. {wording.headline(summary)}."),
        _picture(run.profile_base64, "Height, soil, grade and speed along the route."),
        _legs(run.legs),
        _nests(run.nests, summary),
        _soil(summary.get("soil")),
        _notes(summary.get("notes")),
        _making(summary),
        f"<footer>{_text('Swathe ' + str(summary.get('version') or ''))}</footer>",
    ]
    body = "\n".join(section for section in sections if section)
    return (
        "<!doctype html>\n"
        '<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{html.escape(policy)}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="referrer" content="no-referrer">\n'
        f"<title>{_text(wording.headline(summary))}</title>\n"
        f"<style>{style}</style>\n</head>\n<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _text(value: object) -> str:
    """Return a value from outside as text that no browser takes for markup."""
    return html.escape(wording.plain_text(value))


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _dict(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _header(summary: dict[str, Any]) -> str:
    fulfilled = wording.is_fulfilled(summary)
    mood = {True: ' class="good"', False: ' class="bad"', None: ""}[fulfilled]
    parts = [
        "<header>",
        f'<p class="kind">{_text("swathe " + str(summary.get("command") or "run"))}</p>',
        f"<h1{mood}>{_text(wording.headline(summary))}</h1>",
        f'<p class="lead">{_lead(summary)}</p>',
    ]
    if fulfilled is not True:
        said = [
            f"<p>{label}{_text(summary[key])}</p>"
            for key, label in (
                ("reason", ""),
                ("where", "<b>Where.</b> "),
                ("remedy", "<b>What would change it.</b> "),
            )
            if summary.get(key)
        ]
        if said:
            parts.append(f'<div class="refusal">{"".join(said)}</div>')
    elif summary.get("reason"):
        parts.append(f'<p class="lead">{_text(summary["reason"])}</p>')
    return "\n".join([*parts, "</header>"])


def _lead(summary: dict[str, Any]) -> str:
    ends = []
    for key, word in (("start", "From"), ("goal", "to")):
        place = _place(summary.get(key))
        if place:
            ends.append(f"{word} {place}")
    way = " ".join(ends)
    vehicle = f"Vehicle: {_text(summary['vehicle'])}" if summary.get("vehicle") else ""
    return " ".join(f"{part[:1].upper()}{part[1:]}." for part in (way, vehicle) if part)


def _place(point: object) -> str:
    given = _dict(point)
    lon, lat = number(given.get("lon")), number(given.get("lat"))
    x_m, y_m = number(given.get("x_m")), number(given.get("y_m"))
    if lon is not None and lat is not None:
        return (
            f'<span class="whole">{abs(lat):.5f}° {"N" if lat >= 0 else "S"}, '
            f"{abs(lon):.5f}° {'E' if lon >= 0 else 'W'}</span>"
        )
    if x_m is not None and y_m is not None:
        return f'<span class="whole">x {x_m:,.1f} m, y {y_m:,.1f} m</span>'
    return ""


def _tiles(summary: dict[str, Any]) -> str:
    tiles: list[tuple[str, str, str]] = []

    def add(name: str, key: str, shown: str, more: str = "") -> None:
        if number(summary.get(key)) is not None:
            tiles.append((name, shown, more))

    length_m, straight_m = number(summary.get("length_m")), number(summary.get("straight_m"))
    detour = f"{length_m / straight_m:.2f} times the straight line" if length_m is not None and straight_m else ""
    add("Length", "length_m", wording.length(length_m), detour)
    add("Driving time", "duration_s", wording.duration(summary.get("duration_s")))
    add("Energy", "energy_j", wording.energy(summary.get("energy_j")))
    add("Near no-go ground", "risk_s", wording.duration(summary.get("risk_s")), "weighted by nearness")
    add("Climb", "climb_m", wording.length(summary.get("climb_m")))
    add("Descent", "descent_m", wording.length(summary.get("descent_m")))
    add("Steepest grade", "max_grade", wording.percent(summary.get("max_grade")), _limit(summary, "grade_up"))
    add("Side slope", "max_side_slope", wording.percent(summary.get("max_side_slope")), _limit(summary, "side_slope"))
    add("Cost", "cost", wording.count(summary.get("cost")), _bound(summary))
    if summary.get("objective"):
        tiles.append(("Objective", str(summary["objective"]), "what the route saves"))
    add("Nests", "nest_count", wording.count(summary.get("nest_count")), "navigable regions")
    total, evaluated = number(summary.get("cells_total")), number(summary.get("cells_evaluated"))
    share = f"of {wording.count(total)}" if total else ""
    shown = wording.percent(evaluated / total) if evaluated is not None and total else wording.count(evaluated)
    add("Cells looked at", "cells_evaluated", shown, share)
    if not tiles:
        return ""
    items = "".join(
        f'<div class="tile"><dt>{_text(name)}</dt><dd>{_text(value)}</dd>'
        + (f'<dd class="more">{_text(more)}</dd>' if more else "")
        + "</div>"
        for name, value, more in tiles
    )
    return f'<dl class="tiles">{items}</dl>'


def _limit(summary: dict[str, Any], figure: str) -> str:
    value = number(_dict(_dict(summary.get("vehicle_figures")).get(figure)).get("value"))
    return "" if value is None else f"limit {wording.percent(value)}"


def _bound(summary: dict[str, Any]) -> str:
    if summary.get("optimal") is True:
        return "certified optimal"
    cost, bound = number(summary.get("cost")), number(summary.get("cost_lower_bound"))
    if cost is None or not bound or bound <= 0 or cost < bound:
        return ""
    return f"at most {100 * (cost / bound - 1):.1f} % above the best"


def _picture(content_base64: str | None, alt: str, kind: str = "png") -> str:
    if content_base64 is None:
        return ""
    return f'<figure class="picture"><img alt="{_text(alt)}" src="data:image/{kind};base64,{content_base64}"></figure>'


def _drive(run: RunFolder) -> str:
    """Return how a drive went: its figures, pictures and events; nothing where there was none."""
    if not run.drive_base64 and not run.events and run.cut is None:
        return ""
    summary = run.summary
    shown = [
        ("Outcome", wording.headline({"status": summary.get("status")}) if summary.get("status") else ""),
        ("Why", _text(summary.get("reason") or "")),
        ("Driven", wording.length(summary.get("distance_m"))),
        ("Time", wording.duration(summary.get("duration_s"))),
        ("Nearest to an obstacle", wording.metres(summary.get("min_clearance_m"))),
        *(
            (name, wording.count(summary.get(key)))
            for name, key in (
                ("Collisions", "collisions"),
                ("Local routes laid", "replans"),
                ("Soil readings", "probes"),
                ("News of the soil", "soil_updates"),
                ("Times on no-go ground", "no_go_entries"),
            )
        ),
        ("Log", _text(f"It was cut. {run.cut}") if run.cut else ""),
    ]
    facts = "".join(f"<dt>{name}</dt><dd>{value}</dd>" for name, value in shown if value not in {"", MISSING})
    pictures = [
        _picture(run.drive_base64.get(name), _DRIVE_WORDS[name], name.rpartition(".")[2]) for name in DRIVE_PICTURES
    ]
    return "\n".join(["<h2>Drive</h2>", f'<dl class="facts">{facts}</dl>', *pictures, _events(run.events)])


def _events(events: Sequence[Event]) -> str:
    """Return the table of events; many of one kind in a row are one line."""
    rows = []
    for kind, group in itertools.groupby(events, key=lambda event: event.kind):
        same = list(group)
        if len(same) > _MOST_OF_A_KIND:
            until = f"until {same[-1].time_s:.1f} s, {len(same):,} times"
            rows.append((f"{same[0].time_s:.1f} s", _text(kind.replace("_", " ")), _text(until)))
        else:
            rows += [(f"{e.time_s:.1f} s", _text(kind.replace("_", " ")), _pairs(e.fields)) for e in same]
    if not rows:
        return ""
    table = _table([("Time", "right"), ("Event", "tight"), ("", "wide")], rows[:_MOST_EVENTS])
    if len(rows) > _MOST_EVENTS:
        table += f'<p class="under">The other {len(rows) - _MOST_EVENTS:,} are in run.mcap.</p>'
    if len(rows) > _MOST_OPEN_LEGS:
        table = f"<details><summary>Show {len(rows):,} events</summary>{table}</details>"
    return f"<h3>Events</h3>{table}"


def _table(head: Sequence[tuple[str, str]], rows: Iterable[Sequence[str]]) -> str:
    """Return a table from (name, class) of each column and cells that are escaped already."""
    classes = [f' class="{name}"' if name else "" for _, name in head]
    titles = "".join(f'<th scope="col"{css}>{_text(title)}</th>' for (title, _), css in zip(head, classes, strict=True))
    lines = "\n".join(
        "<tr>" + "".join(f"<td{css}>{cell}</td>" for cell, css in zip(row, classes, strict=True)) + "</tr>"
        for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{titles}</tr></thead><tbody>\n{lines}\n</tbody></table></div>'


def _soil_name(value: object) -> str:
    if not value:
        return MISSING
    name = str(value)
    css = f" soil-{name}" if name in SOIL_COLOURS else ""
    return f'<span class="swatch{css}"></span>{_text(name)}'


def _legs(legs: Sequence[dict[str, Any]]) -> str:
    if not legs:
        return ""
    head = [
        ("Leg", "right"),
        ("Length", "right"),
        ("Grade", "right"),
        ("Side slope", "right"),
        ("Soil", "tight"),
        ("Rank", "right"),
        ("Speed", "right"),
        ("Time", "right"),
        ("Energy", "right"),
        ("Risk", "right"),
        ("Why", "wide"),
    ]
    rows = [
        (
            _text(wording.count(leg.get("leg", place))),
            _text(wording.length(leg.get("length_m"))),
            _text(_grades(leg)),
            _text(wording.percent(leg.get("side_slope_max"))),
            _soil_name(leg.get("soil")),
            _text(wording.count(leg.get("rank_min"))),
            _text(wording.speed(leg.get("speed_mps"))),
            _text(wording.duration(leg.get("time_s"))),
            _text(wording.energy(leg.get("energy_j"))),
            _text(wording.duration(leg.get("risk_s"))),
            _text(leg.get("reason") or ""),
        )
        for place, leg in enumerate(legs[:_MOST_LEGS], 1)
    ]
    table = _table(head, rows)
    if len(legs) > _MOST_LEGS:
        table += f'<p class="under">The other {len(legs) - _MOST_LEGS:,} legs are in route.geojson.</p>'
    if len(legs) > _MOST_OPEN_LEGS:
        table = f"<details><summary>Show {len(legs):,} legs</summary>{table}</details>"
    return f"<h2>Legs</h2>{table}"


def _grades(leg: dict[str, Any]) -> str:
    steepest = wording.percent(leg.get("grade_max"), signed=True)
    lowest = wording.percent(leg.get("grade_min"), signed=True)
    return steepest if lowest in {MISSING, steepest} else f"{lowest} to {steepest}"


def _nests(nests: Sequence[dict[str, Any]], summary: dict[str, Any]) -> str:
    """Return the table of the largest nests; a plan has its route to show instead."""
    if not nests or summary.get("command") != "nests":
        return ""
    keys = list(dict.fromkeys(key for nest in nests[:_MOST_NESTS] for key in nest))[:_MOST_NEST_COLUMNS]
    if not keys:
        return ""
    head = []
    for key in keys:
        name, unit = wording.name_and_unit(key)
        numeric = all(number(nest.get(key)) is not None or nest.get(key) is None for nest in nests[:_MOST_NESTS])
        head.append((f"{name} ({unit})" if unit else name, "right" if numeric else "wide"))
    rows = [[_text(wording.count(nest.get(key))) for key in keys] for nest in nests[:_MOST_NESTS]]
    rest = len(nests) - len(rows)
    more = f'<p class="under">{rest:,} more in nests.geojson.</p>' if rest > 0 else ""
    return f"<h2>Nests</h2>{_table(head, rows)}{more}"


def _soil(value: object) -> str:
    soil = _dict(value)
    entries = [entry for entry in _list(soil.get("entries")) if isinstance(entry, dict)]
    if not soil:
        return ""
    field = f", field {_text(soil['field'])}" if soil.get("field") else ""
    covered = number(soil.get("covered_fraction"))
    share = f", covering {wording.percent(covered)} of the cells" if covered is not None else ""
    line = f'<p class="under">Source: {_text(soil.get("source") or "none")}{field}{share}.</p>'
    lost = sum(1 for entry in entries if entry.get("understood") is False)
    if lost:
        line += f'<p class="under">{lost} not understood: counted as unknown soil.</p>'
    if not entries:
        return f"<h2>Soil</h2>{line}"
    head = [("Value", ""), ("Label", "wide"), ("Taken as", "tight"), ("Cells", "right")]
    rows = [
        (
            _text(entry.get("value", "")),
            _text(entry.get("label", "")),
            "not understood" if entry.get("understood") is False else _soil_name(entry.get("soil_class")),
            _text(wording.count(entry.get("cells"))),
        )
        for entry in entries
    ]
    return f"<h2>Soil</h2>{_table(head, rows)}{line}"


def _notes(value: object) -> str:
    notes = [note for note in _list(value) if note]
    if not notes:
        return ""
    return '<h2>Notes</h2><ul class="notes">' + "".join(f"<li>{_text(note)}</li>" for note in notes) + "</ul>"


def _making(summary: dict[str, Any]) -> str:
    """Return how the answer came about: method, ground, swarm, inputs, files and the vehicle's figures."""
    facts: list[tuple[str, str]] = []

    def add(name: str, shown: str) -> None:
        if shown and shown != MISSING:
            facts.append((name, shown))

    for key, name in (("method", "Method"), ("profile", "Cost profile"), ("vehicle", "Vehicle"), ("crs", "Projection")):
        add(name, _text(summary[key]) if summary.get(key) is not None else "")
    rows, columns = number(summary.get("rows")), number(summary.get("columns"))
    if rows is not None and columns is not None:
        cell = number(summary.get("cell_size_m"))
        size = f" of {cell:g} m" if cell is not None else ""
        add("Grid", _text(f"{rows:,.0f} rows by {columns:,.0f} columns{size}"))
    add("Corridor", _pairs(summary.get("corridor")))
    add("Swarm", _pairs(summary.get("swarm")))
    add("Seed", _text(wording.count(summary.get("seed"))))
    for key, name in (("start", "Start moved by"), ("goal", "Goal moved by")):
        moved = number(_dict(summary.get(key)).get("snapped_m"))
        add(name, _text(wording.length(moved)) if moved else "")
    inputs = [given for given in _list(summary.get("inputs")) if isinstance(given, dict)]
    add("Inputs", "<br>".join(_input(given) for given in inputs))
    add("Files", ", ".join(_link(name, path) for name, path in _dict(summary.get("outputs")).items()))
    add("Version", _text(summary["version"]) if summary.get("version") else "")
    listed = "".join(f"<dt>{_text(name)}</dt><dd>{shown}</dd>" for name, shown in facts)
    body = f'<dl class="facts">{listed}</dl>' if facts else ""
    figures = _figures(summary)
    return f"<h2>How it was made</h2>{body}{figures}" if body or figures else ""


def _pairs(value: object) -> str:
    """Return a dictionary of figures as ``name value unit`` pairs in one line."""
    shown = []
    for key, given in _dict(value).items():
        if given is None or isinstance(given, dict | list):
            continue
        name, unit = wording.name_and_unit(str(key))
        value = f"{wording.count(given)} {unit}".strip()
        shown.append(f'<span class="whole">{_text(name)} {_text(value)}</span>')
    return ", ".join(shown)


def _input(given: dict[str, Any]) -> str:
    digest = f" <code>{_text(given['sha256'])}</code>" if given.get("sha256") else ""
    return f"{_text(given.get('name', ''))}{digest}"


def _link(name: object, path: object) -> str:
    # The leading "./" keeps a hostile path from being taken for a scheme or another host.
    return f'<a href="./{html.escape(quote(wording.plain_text(path)))}">{_text(name)}</a>'


def _figures(summary: dict[str, Any]) -> str:
    rows = []
    for key, given in _dict(summary.get("vehicle_figures")).items():
        figure = given if isinstance(given, dict) else {"value": given}
        if figure.get("value") is None:
            continue
        name, unit = wording.name_and_unit(str(key))
        value = _text(wording.count(figure["value"])) + (f" {_text(unit)}" if unit else "")
        rows.append((_text(name), value, _text(figure.get("source") or "not given")))
    if not rows:
        return ""
    head = [("Figure", ""), ("Value", "right"), ("Source", "wide")]
    return (
        f"<h3>The vehicle: {_text(summary.get('vehicle') or 'its figures')}</h3>"
        f"<details><summary>Show {len(rows)} figures and their sources</summary>{_table(head, rows)}</details>"
    )
