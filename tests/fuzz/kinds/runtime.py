"""What engines leave in the runtime folder: their files and their live data."""

from __future__ import annotations

import json
import os
import re
from dataclasses import asdict
from pathlib import Path
from random import Random

import numpy as np

from rigctl.engine.live_file import LiveReader, LiveWriter
from rigctl.engine.rpc.engine_files import (
    EngineFile,
    engine_file_path,
    running_engines,
)
from rigctl.finger.live_file import FingerLiveReader, FingerLiveWriter
from rigctl.finger.trackers.plate_frame import PlatePosition
from tests.fuzz.kind import Kind, Place
from tests.fuzz.mutations.bytes import BYTES
from tests.fuzz.mutations.folders import FOLDER
from tests.fuzz.mutations.texts import TEXT

LIVE = "live.ring"
PLACE = "/the/folder"
HEAD_BYTES = 1100
"""The numbers of the file and of its first ring."""


def build_engines(folder: Path) -> None:
    """Leave the files of a running engine and of a dead one."""
    for number, pid in enumerate((os.getpid(), 2**22 - 3)):
        live = folder / f"engine{number}.ring"
        live.write_bytes(b"live")
        port, token = 40_000 + number, "ab" * 16
        engine = EngineFile(f"engine{number}", pid, port, token, "virtual", f"{PLACE}/{live.name}")
        # Writing it as an engine does removes those where nothing answers.
        engine_file_path(folder, engine.name).write_text(json.dumps(asdict(engine)))


def settle_engines(folder: Path) -> None:
    """Write the folder into the files, and this process as the running engine."""
    for path in folder.glob("*.json"):
        text = path.read_text().replace(PLACE, str(folder))
        path.write_text(re.sub(r'"pid": \d{1,6}\b', f'"pid": {os.getpid()}', text))


def list_engines(folder: Path) -> object:
    """List the running engines and sweep what dead ones left."""
    return running_engines(folder)


def build_live(folder: Path) -> None:
    """Leave live data of the drum's engine, as a killed one does."""
    kept = folder / "kept"
    writer = LiveWriter(folder / LIVE, 18)
    os.link(folder / LIVE, kept)
    writer.close()
    kept.rename(folder / LIVE)


def build_finger_live(folder: Path) -> None:
    """Leave live data of the finger's engine."""
    kept = folder / "kept"
    writer = FingerLiveWriter(folder / LIVE)
    for number in range(20):
        writer.add_position(PlatePosition(number / 10, 1.0, 2.0, 3.0, True))
    os.link(folder / LIVE, kept)
    writer.close()
    kept.rename(folder / LIVE)


def read_live(folder: Path) -> object:
    """Copy the newest rows of the drum's live data, as a window does."""
    reader = LiveReader(folder / LIVE)
    try:
        rows = reader.taxels(500)
        return len(rows), len(reader.drum(500)), reader.taxel_head, reader.normalisation.sum()
    finally:
        reader.close()


def read_finger_live(folder: Path) -> object:
    """Copy the newest rows of the finger's live data."""
    reader = FingerLiveReader(folder / LIVE)
    try:
        return len(reader.taxels(500)), len(reader.track(500)), np.sum(reader.normalisation)
    finally:
        reader.close()


def set_head(random: Random, path: Path) -> str:
    """Put a number at its limit in one of the words at the head."""
    words = (0, 1, -1, 2**15, 2**31, 2**40, 2**62, -(2**62), 2**63 - 1)
    at, value = 8 * random.randrange(HEAD_BYTES // 8), random.choice(words)
    with path.open("r+b") as file:
        file.seek(at)
        file.write(value.to_bytes(8, "little", signed=True))
    return f"{value} at {at}"


LIVE_FILE = (Place(LIVE, (*(set_head,) * len(BYTES), *BYTES)),)
RUNTIME_KINDS = (
    Kind(
        "engine-file",
        build_engines,
        (Place("*.json", TEXT), Place("*.json", TEXT), Place(".", FOLDER)),
        (list_engines,),
        guided=True,
        settle=settle_engines,
    ),
    Kind("live-file", build_live, LIVE_FILE, (read_live,)),
    Kind("finger-live-file", build_finger_live, LIVE_FILE, (read_finger_live,)),
)
