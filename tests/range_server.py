"""A server on this machine that sends parts of files, keeps the log of what was asked for, and breaks when told to."""

from __future__ import annotations

import contextlib
import functools
import http.server
import re
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator


class Range(NamedTuple):
    """Bytes of a file that were sent, both ends included."""

    first: int
    last: int

    @property
    def size(self) -> int:
        return self.last + 1 - self.first


@dataclass
class Log:
    """What was sent, in order, and how the server fails.

    ``good`` requests for ranges are answered, then ``bad`` are refused, then all are answered again.
    """

    address: str = ""
    ranges: list[Range] = field(default_factory=list)
    refused: int = 0
    good: float = float("inf")
    bad: float = 0

    @property
    def sent(self) -> int:
        """Bytes that were sent."""
        return sum(one.size for one in self.ranges)

    def refuses(self) -> bool:
        """Return whether this request is to be refused, and count it."""
        if self.good > 0:
            self.good -= 1
            return False
        if self.bad > 0:
            self.bad -= 1
            self.refused += 1
            return True
        return False


class RangeHandler(http.server.SimpleHTTPRequestHandler):
    """Serves parts of files."""

    def __init__(self, *given: object, log: Log, directory: str) -> None:
        self._log = log
        super().__init__(*given, directory=directory)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        path = Path(self.translate_path(self.path))
        if not path.is_file():
            self.send_error(404)
            return
        size = path.stat().st_size
        span = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        if span and self._log.refuses():
            self.send_error(503)
            return
        first, last = (int(span[1]), min(int(span[2]), size - 1)) if span else (0, size - 1)
        self.send_response(206 if span else 200)
        self.send_header("Accept-Ranges", "bytes")
        if span:
            self.send_header("Content-Range", f"bytes {first}-{last}/{size}")
        self.send_header("Content-Length", str(last + 1 - first))
        self.end_headers()
        if self.command == "GET":
            with path.open("rb") as file, contextlib.suppress(OSError):  # the reader may have heard enough
                file.seek(first)
                self._log.ranges.append(Range(first, last))
                self.wfile.write(file.read(last + 1 - first))

    do_HEAD = do_GET  # noqa: N815 - the handler's name for it

    def log_message(self, *_: object) -> None:
        pass


@contextlib.contextmanager
def serving(folder: Path) -> Iterator[Log]:
    """Serve a folder; its address and the log of what is sent are those of the value."""
    log = Log()
    handler = functools.partial(RangeHandler, log=log, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        log.address = f"http://127.0.0.1:{running.server_address[1]}"
        try:
            yield log
        finally:
            running.shutdown()
            thread.join()
