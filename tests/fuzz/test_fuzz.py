"""The short form of ``make fuzz``: a few mutated files of every kind, always the same ones."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from random import Random

import pytest

from rigctl.engine.drum_commands import DrumCommands
from rigctl.finger.commands import FingerCommands
from tests.fuzz.campaign import Campaign
from tests.fuzz.kinds.every_kind import KINDS
from tests.fuzz.requests import DRUM, FINGER, Requests

FILES = 6
SEED = 18


def test_no_mutated_file_does_more_than_be_refused(tmp_path: Path) -> None:
    campaign = Campaign(tmp_path / "work", tmp_path / "findings", SEED, quiet=True)
    campaign.run(FILES, list(KINDS), processes=2)
    assert not campaign.causes, campaign.report()
    assert campaign.done == dict.fromkeys(KINDS, FILES)


@pytest.mark.parametrize(
    ("handler", "valid"), [(DrumCommands, DRUM), (FingerCommands, FINGER)], ids=["drum", "finger"]
)
def test_every_declared_command_is_among_the_requests(
    handler: type[DrumCommands | FingerCommands], valid: Sequence[tuple[str, object]]
) -> None:
    assert handler.declared_commands().keys() - {"shutdown"} <= {name for name, _ in valid}


def test_a_line_of_damage_is_one_that_can_be_sent() -> None:
    requests = Requests(FINGER, Random("lines"))
    for number in range(20_000):
        assert b"\n" not in requests.line(number)


GUIDED = """
import json
import sys
from pathlib import Path
from tests.fuzz.kinds.every_kind import KINDS
from tests.fuzz.worker import Worker

worker = Worker(KINDS["engine-file"], Path(sys.argv[1]), 18)
worker.prepare(limited=False)
for name in ("engine0", "engine1", "engine0"):
    dead = json.loads(worker.seed_bytes(0)) | {"name": name, "pid": 2**22 - 3, "live": ""}
    assert worker.judge_bytes(json.dumps(dead).encode()) == []
"""
"""Runs apart, as a worker hooks the signals of its process."""


def test_guided_bytes_are_written_anew_where_a_reading_removes_their_file(tmp_path: Path) -> None:
    command = [sys.executable, "-c", GUIDED, str(tmp_path / "work")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
