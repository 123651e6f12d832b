"""The command line: ``swathe``. It turns options into the use cases of ``swathe.mission`` and answers into words.

Results go to stdout, progress and messages to stderr. Exit codes: 0 done, 2 wrong usage, 3 a negative answer, 4
unusable input or surroundings, 130 interrupted, 1 our own bug.
"""

from __future__ import annotations

import errno
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
    except OSError as error:
        # What is left of the output goes nowhere, so that Python does not try again at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = _unprinted(error)
    sys.exit(code)


def _unprinted(error: OSError) -> int:
    """Say that the answer could not be printed, unless its reader has simply gone."""
    if isinstance(error, BrokenPipeError):
        return 0
    sys.stderr.write(f"swathe: The answer cannot be printed: {error.strerror or error}.\n")
    return EXIT_UNUSABLE


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
    from swathe.cli.say import PrintError

    try:
        return _invoke(words)
    except PrintError as error:
        raise error.cause from error
    except Exception as error:
        if isinstance(error, OSError) and error.filename is None and error.errno in {errno.EPIPE, errno.ENOSPC}:
            raise  # a help text that cannot be printed
        if debug:
            _show_traceback()
        kind, message, remedy, code = _explained(error)
        return _fail(kind, " ".join(message.split()), remedy, code, as_json=as_json)


def _invoke(words: list[str]) -> int:
    """Run a command and return its exit code."""
    import typer
    from typer.main import get_command

    from swathe.cli.app import app

    try:
        # Not app(words): that has ways of its own to end a process.
        command = get_command(app)
        with command.make_context("swathe", list(words)) as context:
            answer = command.invoke(context)
    except typer.Exit as end:
        return end.exit_code
    except typer.Abort:
        raise KeyboardInterrupt from None
    return answer if isinstance(answer, int) else 0


def _explained(error: Exception) -> tuple[str, str, str, int]:
    """Return the kind, message, remedy and exit code of an error; what nobody foresaw is our own bug."""
    import typer

    from swathe.errors import SwatheError

    if isinstance(error, SwatheError):
        return error.kind, error.message, error.remedy, error.exit_code
    if isinstance(error, typer.TyperException):
        context = getattr(error, "ctx", None)
        command = "swathe" if context is None else context.command_path
        message = error.format_message().replace("Value error, ", "")
        return "usage", message, f"Try `{command} --help`.", EXIT_USAGE
    if isinstance(error, UnicodeEncodeError):
        message = f"The name {error.object!r} holds bytes that are no text."
        return "unreadable_file", message, "Rename the file or folder.", EXIT_UNUSABLE
    if isinstance(error, MemoryError):
        remedy = "Choose a smaller window with `--bounds`, or coarser cells with `--cell-size`."
        return "too_large", "The memory does not suffice.", remedy, EXIT_UNUSABLE
    message = f"Swathe has a bug: {type(error).__name__}: {error}"
    return "bug", message, "Please report it with the output of `--debug`.", EXIT_BUG


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
