"""SpikeInterface, pynapple, nwbinspector and Octave read what an export wrote: ``make exchange``.

The readers have an environment of their own, whose Python ``RIGCTL_READERS_PYTHON`` names.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pynwb
import pytest

from rigctl.session.session import Session
from tests.analysis.recordings import record
from tests.exchange.export.conftest import export

MISSED = ["BEST_PRACTICE_SUGGESTION check_experimenter_exists", "CRITICAL check_subject_exists"]
"""A drum has no subject, and the recording of this test names no operator."""
OCTAVE = """
d = load("{file}");
printf("%d %d %s\\n", size(d.samples.readings), class(d.samples.readings));
printf("%d ", d.samples.readings(1, :)); printf("\\n");
printf("%s\\n", char(d.about.data));
printf("%s|", cellstr(char(d.trials.texture)){{:}});
"""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("readers") / "Sitzung 1", textures="AB")


@pytest.fixture(scope="module")
def nwb(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export(session, "nwb", tmp_path_factory.mktemp("nwb") / "Sitzung 1.nwb").target


@pytest.fixture(scope="module")
def said(nwb: Path) -> dict[str, Any]:
    script = Path(__file__).with_name("readers_of_nwb.py")
    command = [os.environ["RIGCTL_READERS_PYTHON"], str(script), str(nwb)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def digest(array: Any) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def test_the_inspector_misses_what_there_is_not(said: dict[str, Any]) -> None:
    assert sorted(said["inspector"]) == MISSED


@pytest.mark.parametrize("reader", ["spikeinterface", "pynapple"])
def test_readers_see_the_samples_and_spikes_to_the_bit(
    reader: str, said: dict[str, Any], session: Path, nwb: Path
) -> None:
    with Session.open(session) as opened:
        samples = [p.read("/taxels/samples", 0, p.n_samples) for p in opened.parts]
    assert said[reader]["taxels"] == digest(np.concatenate(samples))
    with pynwb.NWBHDF5IO(str(nwb), "r") as io:
        trains = io.read().units["spike_times"]
        ticks = [np.rint(trains[unit] * 1000).astype(np.int64) for unit in range(36)]
    assert said[reader]["spikes"] == [digest(train) for train in ticks]


def test_octave_reads_numbers_and_character_matrices(session: Path, tmp_path: Path) -> None:
    file = export(session, "matlab", tmp_path / "session.mat").target
    command = ["octave-cli", "-q", "--eval", OCTAVE.format(file=file)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    size, first, data, textures = done.stdout.splitlines()
    with Session.open(session) as opened:
        assert size == f"{opened.n_samples} 18 uint16"
        assert first.split() == [str(v) for v in opened.parts[0].read("/taxels/samples", 0, 1)[0]]
        wanted = opened.trials["texture"].tolist()
    assert data == "SIMULATED data"
    assert [text.strip() for text in textures.split("|")[:-1]] == wanted
