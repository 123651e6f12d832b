"""Writing a finished file in one step: a reader sees the old file or the new one, never a half."""

from __future__ import annotations

import os
import secrets
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from swathe.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import BinaryIO


@contextmanager
def replacing(path: Path | str) -> Iterator[BinaryIO]:
    """Open a new file that takes the place of ``path`` when the block ends well, and vanishes when it does not.

    Raises:
        OutputError: the folder does not exist, may not be written or is full, or ``path`` is a folder.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{os.getpid()}-{secrets.token_hex(4)}.part")
    try:
        with temporary.open("xb") as stream:
            yield stream
        temporary.replace(target)
    except OSError as error:
        raise OutputError(
            f"{target} cannot be written: {error.strerror or error}.",
            "Check that its folder exists, may be written and is not full.",
        ) from error
    finally:
        # After a success nothing is left under this name; after an error or Ctrl-C the half file is.
        with suppress(OSError):
            temporary.unlink()
