"""LabRecorder records what ``rigctl lsl`` streams, and pyxdf reads it: ``make exchange``."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pylsl
import pytest
from numpy.typing import NDArray

import rigctl
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE

STREAMS = [f"rigctl virtual {what}" for what in ("taxels", "spikes", "pulses", "events")]


@pytest.fixture
def recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, dict[str, Any]]:
    """Press once in real time; return the folder of record and .xdf, and what the latter holds."""
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    script = Path(__file__).with_name("recorder_of_lsl.py")
    command = [os.environ["RIGCTL_READERS_PYTHON"], str(script), str(tmp_path / "a.xdf"), *STREAMS]
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with ExitStack() as stack:
        rig = stack.enter_context(rigctl.connect("virtual"))
        rig.mount("B")
        rig.set(force_g=300)
        streams = [sys.executable, "-m", "rigctl", "lsl"]
        sender = stack.enter_context(subprocess.Popen(streams, **pipes))
        assert sender.stdout is not None and sender.stdout.readline().startswith("streams of")
        recorder = stack.enter_context(subprocess.Popen(command, **pipes))
        assert recorder.stdout is not None and recorder.stdout.readline() == "recording\n"
        with rig.record(tmp_path / "session"):
            rig.arm()
            rig.tare()
            rig.approach()
            rig.lift()
            rig.disarm()
        said, _ = recorder.communicate("\n", timeout=60)
        rig.close()
        assert sender.wait(30) == 0, "the streams end with their engine, which they do not keep"
    return tmp_path, json.loads(said.splitlines()[-1])


def is_there(streamed: NDArray[np.int16], row: int, samples: NDArray[np.uint16]) -> bool:
    """Return whether the rows from this one on are those of the record from its third second on."""
    return np.array_equal(streamed[row : row + 50], samples[2000:2050])


def test_every_sample_is_recorded_once_with_spikes_pulses_and_events(
    recorded: tuple[Path, dict[str, Any]],
) -> None:
    folder, found = recorded
    streamed = np.load(folder / "a.xdf.taxels.npy")
    with rigctl.open_session(folder / "session") as session:
        samples = np.concatenate(
            [part.read("/taxels/samples", 0, part.n_samples) for part in session.parts]
        )
    assert len(samples) > 3000
    begins = [row - 2000 for row in range(2000, len(streamed)) if is_there(streamed, row, samples)]
    n = len(streamed[begins[0] : begins[0] + len(samples)])
    assert len(begins) == 1 and n > len(samples) - 1500, "the recorder drops its last second"
    assert np.array_equal(streamed[begins[0] :][:n], samples[:n])
    assert found["taxels"]["longest_ms"] < 2.0
    assert found["pulses"]["rows"] > 0 and found["spikes"]["rows"] >= found["pulses"]["rows"]
    assert "state: armed, lifted" in found["events"]["texts"]


def test_the_moving_finger_streams_its_taxels_spikes_and_events(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    (tmp_path / "lsl_api.cfg").write_text("[multicast]\nResolveScope = machine\n")
    monkeypatch.setenv("LSLAPICFG", str(tmp_path / "lsl_api.cfg"))
    words = ["realtime", "train", "--out", str(tmp_path / "session"), "--paced", "--yes", "--lsl"]
    pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL}
    with subprocess.Popen([sys.executable, "-m", "rigctl", *words], text=True, **pipes) as run:
        assert run.stderr is not None
        said = next(line for line in run.stderr if "streams of" in line)
        assert "rigctl virtual taxels, rigctl virtual spikes" in said
        found = {each.type(): each for each in pylsl.resolve_streams(2.0)}
        inlets = {kind: pylsl.StreamInlet(found[kind]) for kind in ("Tactile", "Spikes")}
        train, _ = inlets["Spikes"].pull_sample(30.0)
        readings, times_s = inlets["Tactile"].pull_chunk(10.0, 500)
        for inlet in inlets.values():
            inlet.close_stream()
        run.send_signal(signal.SIGINT)
        run.stderr.read()
        assert run.wait(60) == 130
    assert np.shape(readings) == (500, 9) and np.ptp(readings) > 0
    assert np.diff(times_s).min() >= 0 and np.median(np.diff(times_s)) == pytest.approx(1e-3)
    assert train is not None and 0 <= train[0] < 9
    assert {"Stimulation", "Markers"} <= found.keys()
