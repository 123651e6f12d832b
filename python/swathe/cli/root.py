"""The command line's root, which every command is added to."""

from __future__ import annotations

import typer

app = typer.Typer(
    name="swathe",
    help="Plan routes for ground vehicles where there is no road.\n\n"
    "Start with `swathe demo`. Every command has examples under `--help`.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
