"""The command line: ``swathe``. It turns options into the use cases of ``swathe.mission`` and answers into words.

Results go to stdout, progress and messages to stderr. Exit codes: 0 done, 2 wrong usage, 3 a negative answer, 4 unusable
input or surroundings, 130 interrupted, 1 our own bug.
"""

from __future__ import annotations

import json
import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

EXIT_BUG = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and end the process with its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        code = _run(words)
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader has gone; what is left of the output has no reader either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    sys.exit(code)


def _run(words: list[str]) -> int:
    import click

    from swathe.errors import SwatheError

    as_json, debug = "--json" in words, "--debug" in words
    try:
        from swathe.cli.app import app

        answer = app(words, prog_name="swathe", standalone_mode=False)
    except SwatheError as error:
        if debug:
            raise
        return _fail(as_json, error.kind, error.message, error.remedy, error.exit_code)
    except click.exceptions.Exit as end:
        return end.exit_code
    except click.ClickException as error:
        command = getattr(getattr(error, "ctx", None), "command_path", "swathe")
        message = error.format_message().replace("\n", " ")
        return _fail(as_json, "usage", message, f"Try `{command} --help`.", EXIT_USAGE)
    except (click.Abort, KeyboardInterrupt):
        return _fail(as_json, "interrupted", "Interrupted.", "Nothing was changed.", EXIT_INTERRUPTED)
    except MemoryError:
        remedy = "Choose a smaller window with `--bounds`, or coarser cells with `--cell-size`."
        return _fail(as_json, "too_large", "The memory does not suffice.", remedy, 4)
    except BrokenPipeError:
        raise
    except Exception as error:
        if debug:
            raise
        message = f"Swathe has a bug: {type(error).__name__}: {error}".replace("\n", " ")
        return _fail(as_json, "bug", message, "Please report it with the output of `--debug`.", EXIT_BUG)
    return answer if isinstance(answer, int) else 0


def _fail(as_json: bool, kind: str, message: str, remedy: str, code: int) -> int:  # noqa: FBT001
    if as_json:
        answer = {"status": "error", "kind": kind, "message": message, "remedy": remedy}
        sys.stdout.write(json.dumps(answer, ensure_ascii=False) + "\n")
    else:
        sys.stderr.write(f"swathe: {message}\n")
        if remedy:
            sys.stderr.write(f"        {remedy}\n")
    return code
