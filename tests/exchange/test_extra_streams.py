"""Streams of other programs are recorded beside a session, by the real liblsl."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import h5py
import numpy as np
import pyarrow.parquet as pq
import pynwb
import pytest

import rigctl
from rigctl.cli import main
from rigctl.config.rig_config import RecordingConfig, RigConfig, parse_config
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from rigctl.errors import ConfigError
from rigctl.exchange.export.selection import Selection
from rigctl.session.extra_stream import ExtraStream, stream_paths
from rigctl.session.session import open_session
from rigctl.session.verify import verify
from tests.engine.engine_harness import TINY, EngineHarness, open_harness, until_ended
from tests.exchange.export.conftest import export

pytest.importorskip("pylsl", reason="its wheels have liblsl for x86-64 and ARM Macs only")


@pytest.fixture(autouse=True)
def this_computer_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lsl_api.cfg").write_text("[multicast]\nResolveScope = machine\n")
    monkeypatch.setenv("LSLAPICFG", str(tmp_path / "lsl_api.cfg"))
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))


@contextmanager
def sender(name: str) -> Iterator[subprocess.Popen[str]]:
    """Send two streams from another process."""
    script = Path(__file__).with_name("sender_of_lsl.py")
    command = [sys.executable, str(script), name]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None and process.stdout.readline() == "sending\n"
        yield process
        process.kill()


def config(*streams: str) -> RigConfig:
    return RigConfig(recording=RecordingConfig(streams=streams))


def send_cue(process: subprocess.Popen[str], text: str) -> None:
    assert process.stdin is not None
    process.stdin.write(f"{text}\n")
    process.stdin.flush()


async def run_when_recording(harness: EngineHarness, process: subprocess.Popen[str]) -> None:
    """Let the run begin once two streams are recorded, and end when the sender has died."""
    run = harness.engine.run
    assert run is not None
    await harness.until(lambda: _told(harness, "recording the stream") == 2, 1e6)
    send_cue(process, "the run begins ä")
    await harness.until(lambda: _rows(harness.session) > 50, 1e6)
    process.send_signal(signal.SIGKILL)
    await harness.until(lambda: _told(harness, "has ended: the run goes on") == 2, 1e6)
    while not harness.has_ended():
        if run.control.prompt is not None:
            run.control.answer(run.control.prompt.id, "ok")
        await harness.wait(1)


def _told(harness: EngineHarness, words: str) -> int:
    return sum(words in text for text in harness.texts("stream"))


def _rows(session: Path) -> int:
    """Return how many rows of numbers another process reads while they are recorded."""
    streams = [ExtraStream(path) for path in stream_paths(session)]
    counts = [stream.n_rows for stream in streams if not stream.is_text]
    for stream in streams:
        stream.close()
    return max(counts, default=0)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record four trials beside two streams whose sender dies meanwhile; return the session."""
    folder = tmp_path_factory.mktemp("streams")
    (folder / "lsl_api.cfg").write_text("[multicast]\nResolveScope = machine\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LSLAPICFG", str(folder / "lsl_api.cfg"))
        with (
            sender("bench") as process,
            open_harness(folder, config=config("bench samples", "type=Markers")) as harness,
        ):
            harness.run(
                lambda each: run_when_recording(each, process), harness.request(TINY, yes=False)
            )
            assert harness.engine.run is not None and harness.engine.run.outcome == "done"
            return harness.session


def test_every_sample_and_text_is_there_with_its_sender_and_channels(recorded: Path) -> None:
    with open_session(recorded) as session:
        numbers, texts = sorted(session.streams, key=lambda stream: stream.is_text)
        assert (numbers.name, numbers.kind, numbers.rate_hz) == ("bench samples", "EMG", 200.0)
        assert numbers.channels == ("count", "thumb", "wrist") and numbers.units[0] == "mV"
        values, steps_s = numbers.values(), np.diff(numbers.lsl_s())
        assert values.shape == (numbers.n_rows, 3) and numbers.n_rows > 50
        assert np.array_equal(np.diff(values[:, 0]), np.ones(numbers.n_rows - 1)), "none is lost"
        assert (steps_s > 0).all() and numbers.reason == "its sender has ended"
        assert texts.values().tolist() == ["the run begins ä"]
        start_s = session.header.start_loop_s
        for stream in (numbers, texts):
            times_s = stream.times_s()
            assert (times_s > start_s).all() and (np.diff(times_s) >= 0).all()


def test_the_session_is_whole_with_them_and_says_so(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = verify(recorded)
    assert report.whole, report.problems
    assert any("bench samples" in note and "3 channels at 200 Hz" in note for note in report.notes)
    assert main(["info", str(recorded)]) == 0
    assert "bench cues" in capsys.readouterr().out


def test_a_changed_missing_or_exchanged_stream_is_found(recorded: Path, tmp_path: Path) -> None:
    def copy(name: str) -> Path:
        target = tmp_path / name
        target.mkdir()
        for path in recorded.iterdir():
            (target / path.name).write_bytes(path.read_bytes())
        return target

    changed, missing, exchanged = copy("changed"), copy("missing"), copy("exchanged")
    numbers = next(path for path in stream_paths(changed) if not _is_text(path))
    with h5py.File(numbers, "r+") as file:
        file["/stream/values"][7, 1] += 1
    assert any(f"{numbers.name}: rows" in line for line in verify(changed).problems)
    (missing / "stream-0001.h5").unlink()
    assert verify(missing).problems == ["stream-0001.h5: is missing"]
    (exchanged / "stream-0001.h5").write_bytes((exchanged / "stream-0002.h5").read_bytes())
    assert any("is not the file that was recorded" in p for p in verify(exchanged).problems)


@pytest.mark.parametrize("part", ["cut", "text", "attribute"])
def test_a_damaged_stream_costs_itself_and_is_named(
    recorded: Path, tmp_path: Path, part: str
) -> None:
    for path in recorded.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    damaged = tmp_path / "stream-0001.h5"
    if part == "cut":
        damaged.write_bytes(damaged.read_bytes()[:3000])
    elif part == "text":
        damaged.write_text("no HDF5")
    else:
        with h5py.File(damaged, "r+") as file:
            del file.attrs["previous_digest"]
            file.attrs["rate_hz"] = "fast"
    with open_session(tmp_path) as session:
        assert [stream.path.name for stream in session.streams] == ["stream-0002.h5"]
    assert main(["info", str(tmp_path)]) == 0
    (problem,) = verify(tmp_path).problems
    assert problem.startswith(str(damaged))


def _is_text(path: Path) -> bool:
    stream = ExtraStream(path)
    stream.close()
    return stream.is_text


def test_exports_have_them_on_the_time_of_the_samples(recorded: Path, tmp_path: Path) -> None:
    export(recorded, "parquet", tmp_path / "tables", Selection())
    (numbers,) = (tmp_path / "tables").glob("stream_*_bench_samples.parquet")
    table = pq.read_table(numbers).to_pydict()
    assert table["value_count"][1] - table["value_count"][0] == 1
    assert 0 < table["time_s"][0] < table["time_s"][-1]
    export(recorded, "nwb", tmp_path / "session.nwb", Selection())
    with pynwb.NWBHDF5IO(tmp_path / "session.nwb", "r") as io:
        nwb = io.read()
        (name,) = [each for each in nwb.acquisition if "bench_samples_value" in each]
        assert nwb.acquisition[name].data.shape == (len(table["time_s"]), 3)
        assert any("bench_cues" in each for each in nwb.processing["misc"].data_interfaces)


def test_a_stream_that_is_absent_is_told_and_stops_nothing(tmp_path: Path) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await harness.until(lambda: bool(harness.texts("stream")), 1e6)
        run = harness.engine.run
        assert run is not None
        while not harness.has_ended():
            if run.control.prompt is not None:
                run.control.answer(run.control.prompt.id, "ok")
            await harness.wait(1)

    with open_harness(tmp_path, config=config("nobody sends this")) as harness:
        harness.run(scenario, harness.request(TINY, yes=False))
        assert harness.texts("stream") == [
            "there is no LSL stream nobody sends this: the run goes on without it, and records it "
            "as soon as it is there"
        ]
        assert harness.engine.run is not None and harness.engine.run.outcome == "done"
        assert stream_paths(harness.session) == [] and verify(harness.session).whole


def test_without_pylsl_a_run_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "without").mkdir()
    (tmp_path / "without" / "pylsl.py").write_text("raise ImportError('no pylsl here')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "without"))
    with open_harness(tmp_path, config=config("anything")) as harness:
        harness.run(until_ended, harness.request())
        (told,) = harness.texts("stream")
        assert told.startswith("LSL needs pylsl: run `pip install 'rigctl[lsl]'`")
        assert harness.engine.run is not None and harness.engine.run.outcome == "done"


CLOCKS_AGREE_S = 5.0
"""On a computer with ten times as much work as it has processors."""


def test_a_recording_by_hand_has_them_on_the_clock_of_its_events(tmp_path: Path) -> None:
    rig_toml = tmp_path / "rig.toml"
    rig_toml.write_text(
        '[ports]\nsimulate = "virtual"\n[recording]\nstreams = ["hand cues"]\n', encoding="utf-8"
    )
    with ExitStack() as stack:
        process = stack.enter_context(sender("hand"))
        rig = stack.enter_context(rigctl.connect(rig_toml))
        stack.enter_context(rig.record(tmp_path / "session"))
        _wait_event(rig, "recording the stream hand cues")
        send_cue(process, "arm")
        rig.arm()
        armed_s = rig.status.at_s
        rig.disarm()
        send_cue(process, "disarmed")
        disarmed_s = rig.status.at_s
        rig.tare()
    with open_session(tmp_path / "session") as session:
        (cues,) = session.streams
        assert cues.values().tolist() == ["arm", "disarmed"]
        first_s, second_s = cues.times_s().tolist()
        # The sender's own clock counts from the start of the computer.
        assert first_s < armed_s and second_s == pytest.approx(disarmed_s, abs=CLOCKS_AGREE_S)
        sent_s = float(np.diff(cues.lsl_s())[0])
        assert second_s - first_s == pytest.approx(sent_s, abs=CLOCKS_AGREE_S)
    assert verify(tmp_path / "session").whole


def test_a_run_streams_from_the_command_line_while_it_goes_on(tmp_path: Path) -> None:
    (tmp_path / "tiny.toml").write_text(TINY)
    words = ["run", str(tmp_path / "tiny.toml"), "--out", str(tmp_path / "session"), "--lsl"]
    pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL}
    with subprocess.Popen([sys.executable, "-m", "rigctl", *words], text=True, **pipes) as run:
        assert run.stdin is not None and run.stderr is not None
        said = next(line for line in run.stderr if "streams of" in line)
        assert "rigctl virtual taxels, rigctl virtual spikes" in said
        run.stdin.write("a\n")
        run.stdin.flush()
        run.stderr.read()
        assert run.wait(60) == 130, "it was aborted while it waited for its first plate"


def _wait_event(rig: rigctl.ConnectedRig, beginning: str) -> None:
    for _ in range(200):
        if any(str(e.get("text")).startswith(beginning) for e in rig.client.wait(0.1)):
            return
    raise AssertionError(f"nothing begins with {beginning}")


@pytest.mark.parametrize("words", ["it's", 'a\\"b', " "])
def test_words_that_name_no_stream_are_refused_in_the_rig_file(words: str) -> None:
    with pytest.raises(ConfigError, match="streams: must name LSL streams without quotes"):
        parse_config(f'[recording]\nstreams = ["{words}"]\n')
