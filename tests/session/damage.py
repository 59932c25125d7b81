"""Damage the parts of recorded sessions, as disks, people and kills do."""

from __future__ import annotations

import shutil
from pathlib import Path

from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.plan import Plan
from rigctl.session.part import map_as_closed
from rigctl.session.recorder import Recorder
from tests.session.building import PROTOCOL, RIG, SyntheticRig, header, plan, recorder


def record_four_parts(folder: Path, repeats: int = 2) -> Plan:
    """Record the small plan, a quarter of its trials in each of four parts."""
    text = PROTOCOL.replace("repeats = 2", f"repeats = {repeats}")
    of = parse_protocol(text, "small.toml").plan()
    with Recorder(folder, header(of), text, RIG) as rec:
        source = SyntheticRig(rec)
        for number, trial in enumerate(of.trials):
            if number % (len(of.trials) // 4) == 0:
                rec.begin_part("plate change", trial.texture)
            source.trial(trial)
    return of


def kill_while_recording(folder: Path, trials: int, scratch: Path, idle: int = 0) -> Plan:
    """Record the first trials of the small plan; leave the folder as a killed writer leaves it.

    ``idle``: samples before each trial, so that the trials are in several chunks.
    """
    of = plan()
    with recorder(scratch) as rec:
        rec.begin_part("start", of.trials[0].texture)
        source = SyntheticRig(rec)
        for trial in of.trials[:trials]:
            source.idle(idle)
            source.trial(trial)
            rec.wait_written()
        shutil.copytree(scratch, folder)
    return of


def truncate(path: Path, share: float) -> None:
    """Keep the first ``share`` of a file."""
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])


def zero(path: Path) -> None:
    """Replace a file by zeros of its length."""
    path.write_bytes(bytes(path.stat().st_size))


def is_closed(path: Path) -> bool:
    """Return whether the superblock says that no writer has the file open."""
    with map_as_closed(path) as view:
        return bytes(view[:]) == path.read_bytes()
