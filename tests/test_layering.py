"""The import order of ARCHITECTURE.md holds, and the check that says so can fail."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "python" / "swathe"

# What the order of layers cannot say: modules that see less than everything below them.
NARROW_VIEWS = {
    "local": {"errors", "random", "progress", "grid", "sensor", "vehicle"},
    "sim": {"errors", "random", "progress", "grid", "terrain", "soil", "vehicle", "sensor"},
}


def lint_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the contracts of pyproject.toml over the package in ``folder``/python."""
    return subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as run; run()", "--no-cache"],
        cwd=folder,
        env={"PYTHONPATH": str(folder / "python"), "PATH": "/usr/bin:/bin", "COLUMNS": "200"},
        capture_output=True,
        text=True,
        check=False,
    )


def violations_of_narrow_views(graph: grimp.ImportGraph) -> list[str]:
    """List the direct imports by which a module of NARROW_VIEWS sees more than it may."""
    found = []
    for importer in sorted(graph.modules):
        parts = importer.split(".")
        if len(parts) < 2 or parts[1] not in NARROW_VIEWS:
            continue
        for imported in sorted(graph.find_modules_directly_imported_by(importer)):
            seen = imported.split(".")
            if len(seen) > 1 and seen[0] == parts[0] and seen[1] not in NARROW_VIEWS[parts[1]] | {parts[1]}:
                found.append(f"{importer} -> {imported}")
    return found


@pytest.fixture
def copy_of_package(tmp_path: Path) -> Path:
    shutil.copytree(PACKAGE, tmp_path / "python" / "swathe", ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def test_every_module_imports_downwards_only() -> None:
    run = lint_imports(ROOT)
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.parametrize(
    ("module", "line", "contract"),
    [
        ("grid", "from swathe import mission", "Modules import downwards only"),
        ("errors", "from swathe.grid import Cell", "Modules import downwards only"),
        ("gadgets", "import math", "Modules import downwards only"),
        ("planner", "import rasterio", "Rasters, vectors and projections live in io"),
        ("grid", "from pyproj import CRS", "Rasters, vectors and projections live in io"),
        ("grid", "def draw():\n    import matplotlib.figure", "Drawing lives in report"),
        ("mission", "import typer", "The terminal lives in cli"),
        ("grid", "from rich.progress import Progress", "The terminal lives in cli"),
        ("grid", "import pydantic", "Validation models live in vehicle, config and scenario"),
    ],
)
def test_a_wrong_import_is_found(copy_of_package: Path, module: str, line: str, contract: str) -> None:
    package = copy_of_package / "python" / "swathe"
    if not (package / "mission.py").exists():
        (package / "mission.py").write_text("", encoding="utf-8")
    with (package / f"{module}.py").open("a", encoding="utf-8") as file:
        file.write(f"\n{line}\n")
    run = lint_imports(copy_of_package)
    assert run.returncode != 0, run.stdout
    assert f"{contract} BROKEN" in run.stdout, run.stdout + run.stderr


def test_the_simulated_world_and_the_local_planner_see_only_what_they_may() -> None:
    assert violations_of_narrow_views(grimp.build_graph("swathe", cache_dir=None)) == []


def test_a_world_that_looks_at_the_robots_beliefs_is_found() -> None:
    graph = grimp.ImportGraph()
    for importer, imported in [
        ("sim.world", "belief"),
        ("sim.world", "terrain"),
        ("local", "planner"),
        ("drive", "belief"),
    ]:
        graph.add_import(importer=f"swathe.{importer}", imported=f"swathe.{imported}")
    assert violations_of_narrow_views(graph) == ["swathe.local -> swathe.planner", "swathe.sim.world -> swathe.belief"]


def test_importing_the_package_loads_nothing_heavy() -> None:
    heavy = ("rasterio", "pyogrio", "pyproj", "shapely", "matplotlib", "pydantic", "typer", "rich", "numpy")
    code = f"import sys, swathe, swathe.errors; print(*(name for name in {heavy!r} if name in sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == []
