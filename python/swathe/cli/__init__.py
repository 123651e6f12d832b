"""The command line: ``swathe``. It turns options into the use cases of ``swathe.mission`` and answers into words.

Results go to stdout, progress and messages to stderr. Exit codes: 0 done, 2 wrong usage, 3 a negative answer, 4
unusable input or surroundings, 130 interrupted, 1 our own bug.
"""

from __future__ import annotations

import io
import json
import os
import signal
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

EXIT_BUG = 1
EXIT_USAGE = 2
EXIT_UNUSABLE = 4
EXIT_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and end the process with its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    _prepare()
    try:
        code = _run(words)
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader has gone; what is left of the output has no reader either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    except OSError as error:  # stdout is a file on a full disk
        sys.stderr.write(f"swathe: The answer cannot be printed: {error.strerror or error}.\n")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = EXIT_UNUSABLE
    sys.exit(code)


def _prepare() -> None:
    """Let a stop by ``kill`` clean up as Ctrl-C does, and let no file name be unprintable."""
    with suppress(ValueError):  # only the main thread may
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _run(words: list[str]) -> int:
    as_json, debug = "--json" in words, "--debug" in words
    try:
        return _command(words, as_json=as_json, debug=debug)
    except KeyboardInterrupt:
        return _fail("interrupted", "Interrupted.", "Nothing half-written is left.", EXIT_INTERRUPTED, as_json=as_json)


def _command(words: list[str], *, as_json: bool, debug: bool) -> int:
    from swathe.errors import SwatheError

    try:
        import typer

        from swathe.cli.app import app

        answer = app(words, prog_name="swathe", standalone_mode=False)
    except SwatheError as error:
        if debug:
            _show_traceback()
        return _fail(error.kind, error.message, error.remedy, error.exit_code, as_json=as_json)
    except typer.Exit as end:
        return end.exit_code
    except typer.Abort:
        raise KeyboardInterrupt from None
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        command = "swathe" if context is None else context.command_path
        message = " ".join(error.format_message().replace("Value error, ", "").split())
        return _fail("usage", message, f"Try `{command} --help`.", EXIT_USAGE, as_json=as_json)
    except UnicodeEncodeError as error:
        message = f"The name {error.object!r} holds bytes that are no text."
        return _fail("unreadable_file", message, "Rename the file or folder.", EXIT_UNUSABLE, as_json=as_json)
    except MemoryError:
        remedy = "Choose a smaller window with `--bounds`, or coarser cells with `--cell-size`."
        return _fail("too_large", "The memory does not suffice.", remedy, EXIT_UNUSABLE, as_json=as_json)
    except BrokenPipeError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever else comes is our own bug, and is called one
        if debug:
            _show_traceback()
        message = " ".join(f"Swathe has a bug: {type(error).__name__}: {error}".split())
        return _fail("bug", message, "Please report it with the output of `--debug`.", EXIT_BUG, as_json=as_json)
    return answer if isinstance(answer, int) else 0


def _show_traceback() -> None:
    import traceback

    traceback.print_exc()


def _fail(kind: str, message: str, remedy: str, code: int, *, as_json: bool) -> int:
    if as_json:
        answer = {"status": "error", "kind": kind, "message": message, "remedy": remedy}
        sys.stdout.write(json.dumps(answer, ensure_ascii=False) + "\n")
    else:
        sys.stderr.write(f"swathe: {message}\n")
        if remedy:
            sys.stderr.write(f"        {remedy}\n")
    return code
