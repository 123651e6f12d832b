"""Rows of trials in files: kept as they come, so that what was run once is not run again.

A set of trials is ``runs/trials/<name>.csv``, a row a drive, and an entry in ``sets.json`` that says on which machine,
with which commit and command, and by which code it was run. The code is a SHA-256 over everything that can change a
row: the Rust core, its Python layer and its lock file, and the Python package without what only shows (``report``,
``cli``). Rows by the same code stay and are not run again, so that a commit which changes none of it does not matter;
a set by other code is begun anew.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import time
import types
from dataclasses import asdict, fields
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Generic, TypeVar, Union, get_args, get_origin, get_type_hints

import harness
import run
from swathe import trials

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable, Sequence
    from pathlib import Path

    from swathe import proving

Item = TypeVar("Item")
Row = TypeVar("Row", bound="trials.Row | proving.MapRow")

NOTES = "sets.json"
_SOURCES = (("crates", (".rs", ".toml")), ("python/swathe", (".py", ".toml", ".sql")))
_ONLY_SHOWS = ("python/swathe/report/", "python/swathe/cli/")

#: Seconds between two lines of progress.
_TELL_S = 10.0


class Job(Generic[Item, Row]):
    """How the items of a set are run and told apart.

    ``work`` is a function of a module; ``row`` the class of its answers; ``key_of_item`` and ``key_of_row`` agree for
    an item and its row.
    """

    def __init__(
        self,
        work: Callable[[Item], Row],
        row: type[Row],
        key_of_item: Callable[[Item], Hashable],
        key_of_row: Callable[[Row], Hashable],
    ) -> None:
        """Keep what is given."""
        self.work, self.row, self.key_of_item, self.key_of_row = work, row, key_of_item, key_of_row


def code_of(root: Path) -> str:
    """Return the SHA-256 of all sources that can change a row."""
    whole = hashlib.sha256()
    paths = [root / "Cargo.lock"]
    for folder, endings in _SOURCES:
        paths += [path for path in sorted((root / folder).rglob("*")) if path.suffix in endings]
    for path in paths:
        name = path.relative_to(root).as_posix()
        if not name.startswith(_ONLY_SHOWS) and path.is_file():
            whole.update(f"{name}\0{hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return whole.hexdigest()


def rows_of(text: str, kind: type[Row]) -> list[Row]:
    """Return the rows of a CSV; a last line that was cut is left out."""
    text = text[: text.rfind("\n") + 1]
    hints = get_type_hints(kind)
    names = [field.name for field in fields(kind)]
    return [
        kind(**{name: _value(line[name], hints[name]) for name in names})
        for line in csv.DictReader(io.StringIO(text))
        if list(line) == names and None not in line.values()
    ]


def text_of(rows: Iterable[Row], kind: type[Row], *, head: bool = True) -> str:
    """Return rows as CSV; None is an empty field."""
    text = io.StringIO()
    names = [field.name for field in fields(kind)]
    writer = csv.DictWriter(text, names, lineterminator="\n")
    if head:
        writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    return text.getvalue()


def _value(text: str, hint: object) -> Any:  # noqa: ANN401 - whatever the field holds
    if get_origin(hint) in {Union, types.UnionType}:
        if not text:
            return None
        hint = next(part for part in get_args(hint) if part is not type(None))
    if hint is bool:
        return text == "True"
    return {int: int, float: float}.get(hint, str)(text)  # type: ignore[call-overload]  # any hint may be asked


def notes_of(folder: Path) -> dict[str, dict[str, Any]]:
    """Return what is noted of the sets of a folder, by name."""
    path = folder / NOTES
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def run_set(
    folder: Path,
    name: str,
    items: Sequence[Item],
    job: Job[Item, Row],
    *,
    code: str,
    arguments: list[str],
    processes: int | None,
    again: bool = False,
) -> tuple[list[Row], bool]:
    """Run what no row is there for, keep every row as it comes, return all rows of the set and whether it is complete.

    Rows of the set that are not asked for stay when the same code made them.
    """
    path = folder / f"{name}.csv"
    noted = notes_of(folder)
    is_same = not again and path.exists() and noted.get(name, {}).get("code") == code
    kept = rows_of(path.read_text(encoding="utf-8"), job.row) if is_same else []
    there = {job.key_of_row(row) for row in kept}
    missing = [item for item in items if job.key_of_item(item) not in there]
    print(f"{name}: {len(items)} asked for, {len(items) - len(missing)} there, {len(missing)} to run", flush=True)
    if not missing:
        return kept, True
    before_s = float(noted.get(name, {}).get("wall_s", 0.0)) if is_same else 0.0
    folder.mkdir(parents=True, exist_ok=True)
    run.write_text(path, text_of(kept, job.row))
    told = {
        **run.surroundings(arguments),
        "command": " ".join(["python", "benchmarks/trials.py", *arguments]),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "code": code,
        "wall_s": before_s,
    }
    # Noted before the first row, so that what a killed run leaves is known to be of this code.
    run.write_text(folder / NOTES, json.dumps({**noted, name: told}, indent=1) + "\n")
    begun_s = time.monotonic()
    with path.open("a", encoding="utf-8") as stream:

        def keep(row: Row) -> None:
            stream.write(text_of([row], job.row, head=False))
            stream.flush()

        found, is_complete = trials.run_all(
            job.work, missing, processes=processes, progress=_teller(name, begun_s), keep=keep
        )
    order = {job.key_of_item(item): number for number, item in enumerate(items)}
    rows = sorted([*kept, *found], key=lambda row: order.get(job.key_of_row(row), len(order)))
    run.write_text(path, text_of(rows, job.row))
    told["wall_s"] = round(before_s + time.monotonic() - begun_s, 1)
    run.write_text(folder / NOTES, json.dumps({**noted, name: told}, indent=1) + "\n")
    return rows, is_complete


def _teller(name: str, begun_s: float) -> Callable[[int, int], None]:
    last_s = begun_s

    def tell(done: int, count: int) -> None:
        nonlocal last_s
        now_s = time.monotonic()
        if now_s - last_s < _TELL_S and done < count:
            return
        last_s = now_s
        gone_s = now_s - begun_s
        left = minutes(gone_s / done * (count - done))
        print(f"{name}: {done} of {count}, {minutes(gone_s)} gone, about {left} left", flush=True)

    return tell


def minutes(seconds: float) -> str:
    """Return a time for people."""
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"


def root() -> Path:
    """Return the folder of the sources."""
    return harness.FOLDER.parent
