"""The swarm in frames, and the animation made of them."""

from __future__ import annotations

import base64
import hashlib
import itertools
import json
import re
import subprocess
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

import commands
from commands import GOAL, START
from swathe.errors import InvalidParameterError
from swathe.report.animation import Film, frame_step, frame_ticks, write_gif, write_page
from swathe.swarm import Frame, SwarmParams, run_swarm
from worlds import region_of, smooth_hills

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from swathe.rank import Region


def hills() -> Region:
    return region_of(smooth_hills(5, 40, 50, height_m=70, cell_size_m=30, wave_m=500), 30.0)


def film(agents: int = 40, step: int = 1) -> Film:
    region, frames = hills(), []  # type: tuple[Region, list[Frame]]
    run_swarm(region, SwarmParams(agents=agents), on_frame=frames.append, frame_every=[2, 5, 20, 80], frame_step=step)
    return Film(region.geometry, region.elevation_m, frames, "Termites <at> work", "hills & more")


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**64 - 1),
    every=st.one_of(st.integers(1, 9), st.lists(st.integers(0, 40), max_size=5)),
    ticks=st.integers(0, 40),
    step=st.integers(1, 7),
)
def test_watching_changes_nothing_and_frames_tell_the_truth(
    seed: int, every: int | list[int], ticks: int, step: int
) -> None:
    region, params, frames = hills(), SwarmParams(agents=30, pellet_max=2, seed=seed), []  # type: tuple[Region, SwarmParams, list[Frame]]
    plain = run_swarm(region, params, ticks=ticks)
    watched = run_swarm(region, params, ticks=ticks, on_frame=frames.append, frame_every=every, frame_step=step)
    assert watched.tally == plain.tally
    assert np.array_equal(watched.nests.labels, plain.nests.labels)
    assert frames[0].tally.ticks == 0
    assert frames[-1].tally == plain.tally
    rows, columns = -(-40 // step), -(-50 // step)
    for frame in frames:
        assert frame.seen.shape == frame.pellets.shape == frame.nests.shape == (rows, columns)
        assert (frame.agents < (rows, columns)).all()
    if step == 1:
        assert np.array_equal(frames[-1].nests > 0, plain.nests.labels > 0)


def test_what_a_viewer_raises_comes_through_and_wrong_frames_are_refused() -> None:
    def fail(_: Frame) -> None:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        run_swarm(hills(), on_frame=fail)
    for wrong in ({"frame_every": 0}, {"frame_step": 0}, {"frame_every": [-1]}):
        with pytest.raises(InvalidParameterError, match="Frames"):
            run_swarm(hills(), on_frame=fail, **wrong)


@given(last=st.integers(0, 10**7), count=st.integers(1, 100))
def test_frames_are_taken_close_together_first_and_end_with_the_last_tick(last: int, count: int) -> None:
    ticks = frame_ticks(last, count)
    assert ticks == sorted(set(ticks))
    assert ticks[-1] == last
    assert len(ticks) <= count


@pytest.mark.parametrize("write", [write_gif, write_page])
def test_equal_films_are_equal_bytes_and_other_films_are_not(
    write: Callable[[Path, Film], None], tmp_path: Path
) -> None:
    for name, made in (("first", film()), ("again", film()), ("other", film(agents=41))):
        write(tmp_path / name, made)
    first, again, other = ((tmp_path / name).read_bytes() for name in ("first", "again", "other"))
    assert first == again
    assert first != other


def test_the_gif_moves(tmp_path: Path) -> None:
    made = film()
    write_gif(tmp_path / "a.gif", made)
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == len(made.frames)  # type: ignore[attr-defined]
        pictures = []
        for number in range(len(made.frames)):
            gif.seek(number)
            pictures.append(np.asarray(gif.convert("RGB")))
    for before, after in itertools.pairwise(pictures):
        assert (before != after).any()
    assert len(np.unique(pictures[-1].reshape(-1, 3), axis=0)) > 20


def test_the_page_needs_nothing_else_and_names_its_own_script_and_style(tmp_path: Path) -> None:
    write_page(tmp_path / "a.html", film())
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "http" not in re.sub(r"http-equiv", "", page)
    assert "Termites &lt;at&gt; work" in page
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    assert policy.group(1).startswith("default-src 'none'")
    for tag in ("style", "script"):
        (text,) = re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy.group(1)
    (data,) = re.findall(r'<script id="film" type="application/json">(.*?)</script>', page, re.DOTALL)
    frames = json.loads(data)["frames"]
    assert len(frames) > 3
    assert all(frame["picture"].startswith("data:image/png;base64,") and "tick" in frame["words"] for frame in frames)
    assert "prefers-color-scheme: dark" in page


def test_the_page_plays_in_a_browser(chromium: Path, tmp_path: Path) -> None:
    write_page(tmp_path / "a.html", film())
    shots = []
    for number in (0, 4):
        picture = tmp_path / f"{number}.png"
        subprocess.run(
            [
                chromium, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--window-size=700,900",
                "--virtual-time-budget=2000", f"--screenshot={picture}", f"file://{tmp_path}/a.html#{number}",
            ],
            check=True,
            capture_output=True,
        )  # fmt: skip
        shots.append(np.asarray(Image.open(picture).convert("RGB")))
    # The ground is drawn, in more colours than the page itself has, and the frames differ.
    assert all(len(np.unique(shot[150:500].reshape(-1, 3), axis=0)) > 40 for shot in shots)
    # Relief and page are grey; nests and pellets are not.
    coloured = [float((np.ptp(shot[150:500], axis=2) > 60).mean()) for shot in shots]
    assert coloured[0] < 0.02
    assert coloured[1] > 0.2


def test_a_film_needs_a_frame_and_large_maps_are_shown_in_blocks() -> None:
    region = hills()
    with pytest.raises(InvalidParameterError, match="frames"):
        Film(region.geometry, region.elevation_m, [], "a", "b")
    assert frame_step(region.geometry) == 1
    assert frame_step(region.geometry.window(0, 0, 4001, 900)) == 11


def test_the_command_animates_a_swathe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = (
        "nests",
        "--dem",
        str(commands.hills(tmp_path)),
        "--points-crs",
        "native",
        "--start",
        START,
        "--goal",
        GOAL,
    )
    answers = [commands.run_here(capsys, *words, "--animate", "--json", "--out", name).answer for name in ("a", "b")]
    for name in ("animation.gif", "animation.html"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
        assert f"a/{name}" in answers[0]["outputs"].values()
    assert commands.run_here(capsys, *words, "--json", "--out", "a").code == 0
    assert not (tmp_path / "a/animation.gif").exists(), "what a run does not make is not left from another"
