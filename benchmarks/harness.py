"""What a benchmark is, and how one sample of it is measured."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import resource
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

FOLDER = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Contender:
    """One way to do a job.

    ``prepare`` makes the input, ``run`` does the job on it (this alone is measured), ``facts`` boils the result down to
    numbers that the contenders must agree on.
    """

    name: str
    prepare: Callable[[], Any]
    run: Callable[[Any], Any]
    facts: Callable[[Any, Any], dict[str, float]]


@dataclass(frozen=True)
class Benchmark:
    """A job done by us and by a peer, and the ratio of CPU seconds (peer over ours) that we want to reach."""

    name: str
    ours: Contender
    peer: Contender
    must: float
    goal: float
    agree_relative: float | None = 0.0
    """Largest relative difference between facts of the same name; None when there is nothing to compare."""
    no_dearer: bool = False
    """Whether our fact ``cost`` must not exceed the peer's, for peers that minimise something a little different."""
    repeats: int = 1
    """How often one sample does the job; short jobs need more, and the sample is the mean."""

    def contender(self, side: str) -> Contender:
        """Return ``ours`` or ``peer``."""
        return self.ours if side == "ours" else self.peer


@dataclass(frozen=True)
class Sample:
    """One measurement. ``peak_bytes`` is memory above the start of the job, None where the system cannot tell.

    Programs that the job starts count: their CPU seconds, and the peak of the largest.
    """

    cpu_s: float
    wall_s: float
    peak_bytes: int | None
    facts: dict[str, float] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return the sample as plain values for JSON."""
        return asdict(self)


def load_benchmarks() -> dict[str, Benchmark]:
    """Return every benchmark of every ``bench_*.py``, by name, in the order of the files."""
    if str(FOLDER) not in sys.path:
        sys.path.insert(0, str(FOLDER))
    found: dict[str, Benchmark] = {}
    for path in sorted(FOLDER.glob("bench_*.py")):
        for benchmark in importlib.import_module(path.stem).BENCHMARKS:
            if benchmark.name in found:
                raise ValueError(f"Two benchmarks are called {benchmark.name}.")
            found[benchmark.name] = benchmark
    return found


def measure(contender: Contender, repeats: int = 1) -> Sample:
    """Do the job ``repeats`` times in this process and return the mean of one."""
    prepared = contender.prepare()
    memory_before = _restart_peak_memory()
    cpu_before = _cpu_seconds()
    wall_before = time.perf_counter()
    children_before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    result = None
    for _ in range(repeats):
        result = None  # Two results at once would count as memory of one job.
        result = contender.run(prepared)
    wall_s = (time.perf_counter() - wall_before) / repeats
    cpu_s = (_cpu_seconds() - cpu_before) / repeats
    peak = _memory_figure("VmHWM")
    peak_bytes = max(0, peak - memory_before) if peak is not None and memory_before is not None else None
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    if peak_bytes is not None and children > children_before:
        peak_bytes = max(peak_bytes, children * 1024)
    return Sample(cpu_s, wall_s, peak_bytes, contender.facts(prepared, result))


def _cpu_seconds() -> float:
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def _restart_peak_memory() -> int | None:
    """Forget the peak so far (preparing may have needed more than the job) and return what is held now."""
    gc.collect()
    with contextlib.suppress(OSError, AttributeError):
        # Memory that preparing freed but the C library kept would let the job look leaner than it is.
        ctypes.CDLL(None).malloc_trim(0)
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return None
    return _memory_figure("VmRSS")


def _memory_figure(name: str) -> int | None:
    """Return a figure of this process in bytes, None where the system has no such table."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    for line in lines:
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) * 1024
    return None
