"""A sample passes few modules: counted while real ones go from a port to HDF5 and to the raster."""

from __future__ import annotations

import asyncio
import os
import sys
import threading
import tty
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import h5py
import numpy as np
import pytest

from gui.live.raster import Raster
from gui.live.sample_history import SampleHistory, TimeWindow
from gui.widgets.theme import LIGHT
from rigctl.boards.links import SerialLink
from rigctl.boards.taxels import Taxels
from rigctl.encoder.encoder import Encoder
from rigctl.encoder.normalisation import Normalisation
from rigctl.engine.live_file import LiveReader, LiveWriter
from rigctl.engine.pipeline import Batching, SamplePipeline
from rigctl.session.sensor_layout import PAPER_SENSOR
from rigctl.values import Block
from tests.architecture.imports import CHECKOUT
from tests.boards import taxel_encoder
from tests.session.building import recorder, value_of

N = 23
"""Samples; no other axis has this length."""
MOST_TO_HDF5, MOST_TO_RASTER = 8, 10
PAGE = (CHECKOUT / "docs/explanation/life-of-a-trial.md").read_text(encoding="utf-8")


def carries_samples(value: object) -> bool:
    """Return whether a value is bytes, blocks or arrays of samples, or holds some."""
    if isinstance(value, bytes):
        return len(value) >= N
    if isinstance(value, np.ndarray):
        return N in value.shape
    if isinstance(value, Block):
        return carries_samples(getattr(value, "counters", None))  # None while it is made
    if isinstance(value, partial):
        return carries_samples(value.args)
    if isinstance(value, dict):
        return any(map(carries_samples, value.values()))
    return isinstance(value, list | tuple) and any(map(carries_samples, value))


class Call:
    """A call of one of the program's functions, and the modules that made samples for it."""

    def __init__(self, frame: FrameType) -> None:
        self.module = str(frame.f_globals["__name__"])
        self.function = frame.f_code.co_name
        self.has_samples = any(map(carries_samples, frame.f_locals.values()))
        self.sources: set[str] = set()


class Profile:
    """Follows samples through calls: ``paths`` has the modules by which they came to a function."""

    def __init__(self, *ends: tuple[str, str]) -> None:
        self.paths: dict[tuple[str, str], set[str]] = {end: set() for end in ends}
        self._calls = threading.local()

    def __call__(self, frame: FrameType, event: str, value: Any) -> None:
        if not str(frame.f_globals.get("__name__")).startswith(("rigctl.", "gui.")):
            return
        calls = self._calls.__dict__.setdefault("stack", [])
        if event == "call":
            calls.append(Call(frame))
            self._note(calls)
        elif event == "return" and calls:
            done = calls.pop()
            if calls and carries_samples(value):
                calls[-1].sources |= done.sources | {done.module}

    def _note(self, calls: list[Call]) -> None:
        end = (calls[-1].module, calls[-1].function)
        if end not in self.paths or not calls[-1].has_samples:
            return
        first = next(i for i, call in enumerate(calls) if call.has_samples or call.sources)
        for call in calls[first:]:
            self.paths[end] |= call.sources | {call.module}


QUEUED = ("rigctl.session.recorder", "_put")
STORED = ("rigctl.session.writer", "_append")
SHARED = ("rigctl.engine.live_file", "append")
SHOWN = ("gui.live.sample_history", "append")


@pytest.fixture
def profile() -> Iterator[Profile]:
    profile = Profile(QUEUED, STORED, SHARED, SHOWN)
    threading.setprofile(profile)
    sys.setprofile(profile)
    yield profile
    sys.setprofile(None)
    threading.setprofile(None)


def frames() -> bytes:
    counters = np.arange(N, dtype=np.int64)
    nothing = np.zeros(N, np.uint8)
    return taxel_encoder.encode_data(counters, value_of(counters), nothing, nothing)


async def record(folder: Path, pipeline: SamplePipeline) -> None:
    """Send samples through a port to a recorder; return when they are on disk."""
    board, port = os.openpty()
    tty.setraw(port)
    loop = asyncio.get_running_loop()
    taxels = Taxels(SerialLink(os.ttyname(port), 500_000, loop, 0.01), loop)
    arrived = asyncio.Event()
    taxels.on_block(pipeline.add_block)
    pipeline.subscribe(lambda _: arrived.set())
    with recorder(folder) as session:
        session.begin_part("start", "A")
        pipeline.set_recorder(session)
        taxels._listens = True
        taxels.link.open(taxels._receive, pytest.fail)
        os.write(board, frames())
        await asyncio.wait_for(arrived.wait(), 60)
        taxels.close()
        pipeline.set_recorder(None)
    for end in (board, port):
        os.close(end)


def draw(path: Path) -> None:
    reader = LiveReader(path)
    history, raster = SampleHistory(18, 36), Raster(LIGHT, PAPER_SENSOR)
    history.pull(reader)
    raster.refresh(history, TimeWindow(N, N, 0), 100, 100, 1.0)
    assert len(np.unique(raster.render_columns(history, history.columns(0, N, N, N)))) > 1
    reader.close()


async def test_a_sample_passes_few_modules(tmp_path: Path, qapp: object, profile: Profile) -> None:
    live = LiveWriter(tmp_path / "live.ring", 18)
    encoder = Encoder(Normalisation.full_scale(18))
    pipeline = SamplePipeline(encoder, live, waits_for_disk=False, batching=Batching(N, 1))
    await record(tmp_path / "session", pipeline)
    draw(live.path)
    live.close()
    with h5py.File(tmp_path / "session/part-0001.h5") as part:
        assert part["/taxels/samples"].shape[0] == N
    to_hdf5 = profile.paths[QUEUED] | profile.paths[STORED]
    to_raster = profile.paths[SHARED] | profile.paths[SHOWN] | {Raster.__module__}
    assert all(profile.paths.values())
    assert len(to_hdf5) <= MOST_TO_HDF5, to_hdf5
    assert len(to_raster) <= MOST_TO_RASTER, to_raster
    assert sorted(n for n in to_hdf5 | to_raster if f"`{file_of(n)}`" not in PAGE) == []


def file_of(module: str) -> str:
    """Return a module's file as the page names it."""
    return f"{module.removeprefix('rigctl.').replace('.', '/')}.py"
