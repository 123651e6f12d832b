"""What ``summary.json`` holds."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

import swathe
from swathe import rank, swarm
from swathe.export import place

if TYPE_CHECKING:
    from swathe.config import Settings
    from swathe.planner import Plan
    from swathe.planning import Found
    from swathe.preparation import Ground


def shared_summary(command: str, ground: Ground, settings: Settings) -> dict[str, Any]:
    """Return the part of the summary that every command shares."""
    geometry = ground.planned.geometry
    soil = None if ground.soil is None else ground.soil.as_dict()
    vehicle = ground.planned.vehicle
    return {
        "command": command,
        "version": swathe.__version__,
        "cells_total": geometry.cell_count,
        "method": settings.method,
        "profile": settings.rank.profile,
        "vehicle": vehicle.name,
        "vehicle_figures": vehicle.as_dict()["figures"],
        "seed": settings.seed,
        "rank_params": rank.as_dict(settings.rank),
        "soil": soil,
        "crs": ground.frame.name,
        "cell_size_m": geometry.cell_size_m,
        "rows": geometry.rows,
        "columns": geometry.columns,
        "inputs": inputs_of(ground),
        "notes": list(ground.notes),
    }


def inputs_of(ground: Ground) -> list[dict[str, str]]:
    """Return name and SHA-256 of every input."""
    inputs = [{"name": name, "sha256": digest} for name, digest in ground.source.fingerprint().items()]
    if ground.soil_source is not None:
        inputs.append({"name": ground.soil_source.name, "sha256": ground.soil_source.fingerprint()})
    if ground.cost_source is not None:
        inputs.append({"name": ground.cost_source.name, "sha256": ground.cost_source.fingerprint()})
    return inputs


def swarm_summary(tally: swarm.Tally, settings: Settings) -> dict[str, Any]:
    """Return what the swarm did."""
    params = settings.swarm_params()
    return {
        "agents": params.agents,
        "pellet_max": params.pellet_max,
        "rank_min": params.nest.rank_min,
        "ticks": tally.ticks,
        "visits": tally.visits,
        "cores": tally.cores,
        "connected_at": tally.connected_at,
    }


def usual_rule(settings: Settings, *, has_ends: bool) -> swarm.Rule:
    """Return the rule that ends the swarm when none is asked for."""
    corridor = settings.corridor_params()
    guided = has_ends and corridor.arc == "relaid" and corridor.width_m is None and not settings.certify
    return "good" if guided else "finished"


def stop_summary(stopped: swarm.Stopped | None, settings: Settings, *, has_ends: bool) -> dict[str, Any]:
    """Return what ended the swarm and what it left unseen; nothing but None for the exact pass."""
    if stopped is None:
        return {"stopped_by": None, "unknown_cells": None, "unknown_share": None, "stop": None}
    stop = settings.stop
    rule = stop.rule or usual_rule(settings, has_ends=has_ends)
    bound = None
    if rule == "statistical":
        bound = {
            "open_share": stop.open_share,
            "confidence": 1 - stop.doubt,
            "quiet_visits": stopped.quiet_visits,
            "holds": stopped.by in ("statistical", "finished"),
        }
    return {
        "stopped_by": stopped.by,
        "unknown_cells": stopped.unknown_cells,
        "unknown_share": stopped.unknown_share,
        "stop": {
            "rule": rule,
            "max_ticks": stop.max_ticks,
            "max_evaluations": stop.max_evaluations,
            "max_seconds": stop.max_seconds,
            "reproducible": stop.max_seconds is None,
            "statistical": bound,
        },
    }


def stop_notes(stopped: swarm.Stopped | None, settings: Settings) -> list[str]:
    """Return what is not known yet, in words; nothing where the usual rule ended the search."""
    if stopped is None:
        return []
    stop, notes = settings.stop, []
    unseen = (
        f"{stopped.unknown_cells:,} of {stopped.swathe_cells:,} cells of the swathe ({stopped.unknown_share:.1%}) "
        "were not looked at"
    )
    budgets = {
        "max_ticks": f"the budget of {stop.max_ticks} ticks",
        "max_evaluations": f"the budget of {stop.max_evaluations} evaluations",
        "max_seconds": f"the budget of {stop.max_seconds} seconds",
    }
    if stopped.by in budgets:
        notes.append(
            f"Stopped early by {budgets[stopped.by]}: {unseen}. Nests may reach farther than shown, and a better route "
            "may exist."
        )
    elif stopped.by == "connected":
        notes.append(f"Stopped as soon as start and goal were connected: {unseen}. A better route may exist.")
    elif stopped.by == "statistical" and stopped.quiet_visits is not None:
        notes.append(
            f"Stopped by the statistical rule: {stopped.quiet_visits:,} random visits in a row met nothing new, so at "
            f"most {stop.open_share:.2%} of the cells searched are suitable and not yet marked (confidence "
            f"{1 - stop.doubt:.0%}); {unseen}."
        )
    if stop.max_seconds is not None:
        notes.append("A budget of seconds depends on the machine: the same command may find something else.")
    return notes


def _turning_notes(ground: Ground, answer: Plan, settings: Settings) -> list[str]:
    """Say what is known of the turns of a route; nothing for vehicles that turn in place."""
    radius_m, cell_size_m = ground.planned.vehicle.min_turn_radius_m, ground.planned.geometry.cell_size_m
    if radius_m == 0 or answer.route is None:
        return []
    path = answer.drivable
    if path is not None:
        changes = "no change" if path.cusps == 0 else f"{path.cusps} change{'s' if path.cusps > 1 else ''}"
        note = f"The drivable path keeps a turning radius of {radius_m:g} m: {path.length_m:.0f} m in "
        return [note + f"{path.time_s:.0f} s, {changes} of direction, {path.reverse_m:.0f} m in reverse."]
    if settings.path == "auto" and radius_m < cell_size_m:
        note = f"The vehicle's turning radius of {radius_m:g} m is below a terrain cell of {cell_size_m:g} m; "
        return [note + "turns were not checked."]
    return [f"Turns were not checked against the vehicle's turning radius of {radius_m:g} m (path {settings.path})."]


def _drivable_summary(answer: Plan) -> dict[str, Any] | None:
    path = answer.drivable
    if path is None:
        return None
    return {
        "length_m": path.length_m,
        "duration_s": path.time_s,
        "energy_j": path.energy_j,
        "cost": path.cost,
        "turning_radius_m": path.radius_m,
        "direction_changes": path.cusps,
        "reverse_m": path.reverse_m,
        "arcs": len(path.arcs),
        "states": path.states,
    }


def plan_summary(
    found: Found, settings: Settings, asked: tuple[tuple[float, float], tuple[float, float]]
) -> dict[str, Any]:
    """Return the summary of a plan; ``asked`` are the ends as given."""
    ground, answer, ends, tiles = found.planned, found.answer, found.ends, found.tiles
    is_lazy = found.lazy is not None
    route = answer.route
    corridor = answer.corridor
    notes = list(ground.notes)
    for name, moved in (("start", answer.start), ("goal", answer.goal)):
        if moved is not None and moved[1] > 0:
            notes.append(f"The {name} was moved {moved[1]:.0f} m to the nearest safe ground.")
    if corridor is not None and corridor.widened:
        times = "once" if corridor.widened == 1 else f"{corridor.widened} times"
        notes.append(f"The swathe was widened {times}, to {corridor.width_m:.0f} m.")
    notes += _turning_notes(ground, answer, settings)
    if is_lazy:
        notes.append(
            f"The map was read where the swarm looked: {tiles[0]:,} of {tiles[1]:,} tiles. Maps show nothing elsewhere."
        )
    elif not ground.is_whole:
        notes.append("Only the part of the map around start and goal was read.")
    if route is not None and not answer.is_complete:
        notes.append("Not all of the map that was wanted could be read: the route is valid, a better one may exist.")
    notes += stop_notes(answer.stopped, settings)
    return {
        **shared_summary("plan", ground, settings),
        "status": answer.status,
        "reason": answer.reason,
        "where": place.in_words(answer.place, ground.frame),
        "remedy": answer.remedy,
        "path": settings.path,
        "drivable": _drivable_summary(answer),
        "length_m": None if route is None else route.length_m,
        "straight_m": float(np.hypot(ends[0].x_m - ends[1].x_m, ends[0].y_m - ends[1].y_m)),
        "objective": settings.objective.text,
        "objective_weights": asdict(settings.objective),
        "duration_s": None if route is None else route.time_s,
        "energy_j": None if route is None else route.energy_j,
        "risk_s": None if route is None else route.risk_s,
        "climb_m": None if route is None else route.climb_m,
        "descent_m": None if route is None else route.descent_m,
        "max_grade": None if route is None else max(route.grade_max, -route.grade_min, 0.0),
        "max_side_slope": None if route is None else route.side_slope_max,
        "outside_nests_m": None if route is None else route.bridged_m,
        "cost": None if route is None else route.cost,
        "cost_lower_bound": answer.cost_lower_bound,
        "grid_cost": answer.path_cost,
        "optimal": answer.optimal,
        "cells_evaluated": answer.cells_evaluated,
        "tiles_read": tiles[0],
        "tiles_total": tiles[1],
        # Decoded, from files; what the bundled terrain takes is not counted.
        "bytes_read": ground.source.bytes_read or None,
        **stop_summary(answer.stopped, settings, has_ends=True),
        "nest_count": None if answer.nests is None else answer.nests.count,
        "start": place.end_of_route(asked[0], ends[0], answer.start, ground.frame),
        "goal": place.end_of_route(asked[1], ends[1], answer.goal, ground.frame),
        "swarm": None if answer.swarm is None else swarm_summary(answer.swarm, settings),
        "corridor": None
        if corridor is None
        else {
            "arc": settings.corridor_params().arc,
            "width_m": corridor.width_m,
            "widened": corridor.widened,
            "sagitta_m": corridor.sagitta_m,
        },
        "notes": notes,
    }
