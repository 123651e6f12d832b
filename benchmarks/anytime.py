"""How little the guided swarm looks at, and how good its routes are: a fixed draw of pairs on real terrain.

Pairs lie in one nest of the exact method, more than 0.4 map sides apart. Cells evaluated are shares of the map; the
cost is compared with the best route of the whole map (``--method exact``) on the same graph. Writes
``runs/anytime/DATE.json`` and ``ANYTIME.md``. The bundled terrain always runs; the others need SWATHE_DATA.

    .venv/bin/python benchmarks/anytime.py [PAIRS]
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import run as harness_run

if TYPE_CHECKING:
    from collections.abc import Iterator

    from swathe.grid import Cell
    from swathe.rank import Region

HERE = Path(__file__).resolve().parent
SEED = 7
LEAST_SIDES = 0.4

#: name, elevation, soil, vehicle; paths are below SWATHE_DATA unless bundled
TERRAINS = (
    ("Jacksboro, 90 m", "bundled:jacksboro", "bundled:jacksboro", "pickup-4x4"),
    ("Ebergoetzen, 25 m", "ebergotzen/ebergotzen_dem_25m.tif", "ebergotzen/ebergotzen_soil_zones.gpkg", "tractor"),
    ("Spearfish, 30 m", "spearfish/spearfish_elevation_dem_30m.tif", None, "pickup-4x4"),
)


def region_of(dem: str, soil: str | None, vehicle: str) -> Region | None:
    from swathe.io.elevation import open_elevation
    from swathe.io.soil import read_soil
    from swathe.rank import Region
    from swathe.vehicle import load_vehicle

    data = os.environ.get("SWATHE_DATA")
    if not dem.startswith("bundled:") and data is None:
        return None

    def placed(name: str) -> str:
        return name if name.startswith("bundled:") else str(Path(str(data)) / name)

    with open_elevation([placed(dem)]) as source:
        codes = None if soil is None else read_soil(placed(soil), source.frame).codes
        return Region(source.frame.geometry, source.read(), load_vehicle(vehicle), codes)


def pairs(region: Region) -> Iterator[tuple[Cell, Cell]]:
    from swathe.grid import Cell
    from swathe.nest import exact_nests
    from swathe.rank import rank_map

    labels = exact_nests(rank_map(region).rank, rank_min=region.params.rank_min).labels
    draw = np.random.default_rng(SEED)
    least = LEAST_SIDES * max(region.geometry.shape)
    while True:
        start, goal = draw.integers(0, region.geometry.shape, (2, 2))
        label = labels[tuple(start)]
        if label and label == labels[tuple(goal)] and np.hypot(*(start - goal)) > least:
            yield Cell(*start.tolist()), Cell(*goal.tolist())


def measure(region: Region, count: int) -> list[dict[str, Any]]:
    from swathe.planner import plan

    found: list[dict[str, Any]] = []
    for start, goal in pairs(region):
        places = region.geometry.position_of(start), region.geometry.position_of(goal)
        best = plan(region, *places, method="exact")
        if best.path_cost is None:
            continue
        began = time.process_time()
        guided = plan(region, *places)
        seconds = time.process_time() - began
        if guided.path_cost is None or guided.swarm is None:
            raise RuntimeError(f"The guided swarm refused {start} to {goal}: {guided.reason}")
        found.append(
            {
                "start": start,
                "goal": goal,
                "share_evaluated": guided.cells_evaluated / region.geometry.cell_count,
                "excess_cost": guided.path_cost / best.path_cost - 1,
                "ticks": guided.swarm.ticks,
                "cpu_s": seconds,
            }
        )
        if len(found) == count:
            return found
    return found


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    run: dict[str, Any] = {**harness_run.surroundings(sys.argv), "seed": SEED, "terrains": {}}
    lines = [
        "# The guided swarm: cells evaluated and cost above the optimum",
        "",
        (
            f"{count} pairs each, in one exact nest, over {LEAST_SIDES} map sides apart, seed {SEED}; 1,024 agents. "
            "Written by `benchmarks/anytime.py`."
        ),
        "",
        "| terrain | vehicle | evaluated, median | 90th | cost above optimum, median | 90th | CPU s, median |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name, dem, soil, vehicle in TERRAINS:
        region = region_of(dem, soil, vehicle)
        if region is None:
            print(f"{name}: skipped, SWATHE_DATA is not set")
            continue
        found = measure(region, count)
        run["terrains"][name] = found

        def quantile(key: str, share: float, found: list[dict[str, Any]] = found) -> float:
            return float(np.quantile([entry[key] for entry in found], share))

        shown = [
            f"{quantile('share_evaluated', 0.5):.1%}",
            f"{quantile('share_evaluated', 0.9):.1%}",
            f"{quantile('excess_cost', 0.5):.2%}",
            f"{quantile('excess_cost', 0.9):.2%}",
            f"{quantile('cpu_s', 0.5):.3f}",
        ]
        lines.append("| " + " | ".join([name, vehicle, *shown]) + " |")
        print(lines[-1])
    folder = HERE / "runs" / "anytime"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{time.strftime('%Y-%m-%d')}.json").write_text(json.dumps(run) + "\n")
    (HERE / "ANYTIME.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
