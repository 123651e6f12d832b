"""The run log of a drive against its budget, and against rosbags' serializer with mcap's own writer."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from harness import Benchmark, Contender

_SECONDS = 20
_TOPICS = ("/scan", "/odom", "/truth", "/cmd_vel", "/tf")


def _drive() -> list[Any]:
    """Drive for some seconds among 40 crates, with the modules that will write imported."""
    import swathe.runlog  # noqa: F401 - importing it is not writing
    from swathe import sim
    from swathe.drive import Navigator
    from swathe.episode import Episode

    world, start, goal = sim.random_world(3)
    robot = sim.Robot(world, "pioneer-2dx", start, seed=3)
    episode = Episode(world, robot, Navigator("pioneer-2dx", (goal.x_m, goal.y_m)))
    return [episode.advance() for _ in range(_SECONDS)]


def _write(seconds: list[Any]) -> Path:
    from swathe.runlog import LogHeader, RunLogWriter

    path = Path(tempfile.mkdtemp()) / "run.mcap"
    with RunLogWriter(path, LogHeader(seed=3, scenario="", vehicle="pioneer-2dx")) as log:
        for second in seconds:
            log.write(second)
        log.close({})
    return path


def _budget(_: list[Any]) -> None:
    """Take a millisecond of CPU time for each second."""
    import time

    until = time.process_time() + _SECONDS * 1e-3
    while time.process_time() < until:
        pass


def _messages(path: Path) -> list[tuple[str, int, bytes]]:
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        found = make_reader(stream).iter_messages(_TOPICS, log_time_order=False)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in found]


def _prepare_peer() -> tuple[Any, list[tuple[str, str, int, Any]]]:
    """Return the messages of the same log as objects, ready to be written."""
    import mcap.writer  # noqa: F401 - importing it is not writing
    from rosbags.typesys import Stores, get_typestore

    from swathe.runlog.definitions import TOPICS

    store, found = get_typestore(Stores.ROS2_HUMBLE), []
    for topic, time_ns, body in _messages(_write(_drive())):
        name = TOPICS[topic].message.replace("/", "/msg/")
        found.append((topic, name, time_ns, store.deserialize_cdr(body, name)))
    return store, found


def _write_peer(prepared: tuple[Any, list[tuple[str, str, int, Any]]]) -> Path:
    from mcap.writer import CompressionType, Writer

    store, messages = prepared
    path = Path(tempfile.mkdtemp()) / "peer.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("ros2")
        channels = {topic: writer.register_channel(topic, "cdr", 0) for topic in _TOPICS}
        for topic, name, time_ns, message in messages:
            writer.add_message(channels[topic], time_ns, bytes(store.serialize_cdr(message, name)), time_ns)
        writer.finish()  # type: ignore[no-untyped-call]  # the package leaves it open
    return path


def _sizes(_: object, path: Path) -> dict[str, float]:
    return {"seconds": _SECONDS, "bytes": path.stat().st_size}


def _facts(_: object, path: Path) -> dict[str, float]:
    messages = _messages(path)
    return {"messages": len(messages), "bytes": sum(len(body) for _, _, body in messages)}


BENCHMARKS = [
    Benchmark(
        name="log-drive",
        ours=Contender("swathe.runlog.RunLogWriter, 20 s of a drive", _drive, _write, _sizes),
        peer=Contender("a millisecond of CPU time a second", _drive, _budget, lambda *_: {"seconds": _SECONDS}),
        must=1.0,
        goal=2.0,
        agree_relative=None,
        repeats=5,
    ),
    Benchmark(
        name="log-drive-rosbags",
        ours=Contender("swathe.runlog.RunLogWriter, 20 s of a drive", _drive, _write, _facts),
        peer=Contender(
            "rosbags' serializer and mcap's writer, without JSON and maps", _prepare_peer, _write_peer, _facts
        ),
        must=3.0,
        goal=10.0,
        repeats=5,
    ),
]
