"""Run benchmarks: ours and the peer in turns, each sample in a child process of its own.

    python benchmarks/run.py [NAME ...] [--rounds N] [--list]

Writes runs/<time>.json, RESULTS.md and results.png beside this file. Exits with 1 when a job failed or
results disagree.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import platform
import shutil
import subprocess
import sys
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import harness
import plot
import results

LIBRARIES = ("swathe", "numpy", "scipy", "scikit-image", "dijkstra3d", "xarray-spatial", "mcap", "rosbags")


def main(arguments: list[str]) -> int:
    """Run what ``arguments`` ask for and return the exit status."""
    parser = argparse.ArgumentParser(description="Measure Swathe against named peers.")
    parser.add_argument("names", nargs="*", help="benchmarks to run (all when none is named)")
    parser.add_argument("--rounds", type=int, default=5, help="samples of each contender (5)")
    parser.add_argument("--list", action="store_true", help="list the benchmarks")
    parser.add_argument("--sample", nargs=2, metavar=("NAME", "SIDE"), help=argparse.SUPPRESS)
    chosen = parser.parse_args(arguments)
    benchmarks = harness.load_benchmarks()
    if chosen.sample:
        name, side = chosen.sample
        print(json.dumps(harness.measure(benchmarks[name].contender(side), benchmarks[name].repeats).as_dict()))
        return 0
    if chosen.list:
        print("\n".join(benchmarks))
        return 0
    unknown = [name for name in chosen.names if name not in benchmarks]
    if unknown or chosen.rounds < 1:
        parser.error(f"Known benchmarks: {', '.join(benchmarks)}. Rounds: at least 1.")
    started = datetime.now(UTC)
    records = [run_benchmark(benchmarks[name], chosen.rounds) for name in chosen.names or benchmarks]
    run = {"date": started.isoformat(timespec="seconds"), **surroundings(arguments), "benchmarks": records}
    runs = harness.FOLDER / "runs"
    runs.mkdir(exist_ok=True)
    path = runs / f"{started:%Y-%m-%dT%H%M%SZ}.json"
    write_text(path, json.dumps(run, indent=1) + "\n")
    write_text(harness.FOLDER / "RESULTS.md", results.table(runs))
    plot.draw(runs, harness.FOLDER / "results.png")
    print(f"\n{path.relative_to(harness.FOLDER.parent)}\n{results.table_of_run(run)}")
    return 1 if any(record["errors"] for record in records) else 0


def run_benchmark(benchmark: harness.Benchmark, rounds: int) -> dict[str, Any]:
    """Measure ours and the peer in turns and return the record of the run file."""
    samples: dict[str, list[dict[str, Any]]] = {"ours": [], "peer": []}
    # No job needs them, and threads that spin while they wait for one would count as work.
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    errors: list[str] = []
    for turn in range(rounds):
        # Turns swap, so that neither always runs on the machine that the other has warmed or tired.
        for side in ("ours", "peer") if turn % 2 == 0 else ("peer", "ours"):
            print(f"{benchmark.name} {turn + 1}/{rounds} {benchmark.contender(side).name}", flush=True)
            command = [sys.executable, str(harness.FOLDER / "run.py"), "--sample", benchmark.name, side]
            child = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False, env=environment)
            if child.returncode != 0:
                errors.append(f"{benchmark.contender(side).name} ended with status {child.returncode}")
                break
            samples[side].append(json.loads(child.stdout.splitlines()[-1]))
        if errors:
            break
    if not errors:
        errors += results.disagreements(samples, benchmark.agree_relative)
    if not errors and benchmark.no_dearer:
        errors += results.dearer(samples)
    for error in errors:
        print(f"{benchmark.name}: {error}", file=sys.stderr)
    return {
        "name": benchmark.name,
        "ours": benchmark.ours.name,
        "peer": benchmark.peer.name,
        "must": benchmark.must,
        "goal": benchmark.goal,
        "errors": errors,
        "samples": samples,
    }


def surroundings(arguments: list[str]) -> dict[str, Any]:
    """Return the machine, the commit, the command and the versions that the figures belong to."""
    return {
        "command": " ".join(["python", "benchmarks/run.py", *arguments]),
        "commit": commit(),
        "machine": {
            "processor": processor(),
            "cores": os.cpu_count(),
            "memory_bytes": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
            "kernel": f"{platform.system()} {platform.release()}",
            "load_average": os.getloadavg()[0],
        },
        "versions": {"python": platform.python_version()} | versions(),
    }


def versions() -> dict[str, str]:
    """Return the versions of the libraries and programs that are measured, as far as they are installed."""
    found = {}
    for name in LIBRARIES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    if (grass := shutil.which("grass")) is not None:
        asked = subprocess.run([grass, "--config", "version"], capture_output=True, text=True, check=False)
        found["grass"] = asked.stdout.strip()
    return found


def commit() -> str:
    """Return the commit, with a plus sign when files differ from it."""
    git = shutil.which("git")
    if git is None:
        return "unknown"
    command = [git, "-C", str(harness.FOLDER), "describe", "--always", "--abbrev=12", "--dirty=+"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip() or "unknown"


def processor() -> str:
    """Return the model of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
