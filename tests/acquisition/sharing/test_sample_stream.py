"""Live data over the socket: the same rows as in the engine's memory, and nothing damaged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.acquisition.live_buffer import DRUM_LIVE, LiveReader, LiveWriter
from rigctl.acquisition.rpc.engine_files import EngineFile, write_engine_file
from rigctl.acquisition.rpc.queues import connected_client
from rigctl.acquisition.sharing.remote_client import read_remote_engine
from rigctl.acquisition.sharing.sample_stream import append_samples
from rigctl.errors import LinkLost, WrongUse
from tests.acquisition.engine_harness import EngineHarness
from tests.acquisition.sharing.client_connection import ClientConnection

WHOLE: dict[str, Any] = {
    "taxels": {"rows": 0, "bytes": ""},
    "other": {"rows": 0, "bytes": ""},
    "range": "A" * 96,
}


def test_streamed_rows_are_those_of_the_engine(harness: EngineHarness) -> None:
    far = LiveWriter(harness.folder / "far.live")

    async def scenario(harness: EngineHarness) -> None:
        client = await ClientConnection.connect(harness.address)
        await client.request("stream")
        for _ in range(12):
            append_samples(far.file, DRUM_LIVE, (await client.until("samples"))["data"])
        await client.close()

    harness.run(scenario)
    there, here = LiveReader(harness.folder / "far.live"), harness.engine.boards.pipeline
    assert there.taxel_head > 500 and here.sample_count >= there.taxel_head
    window, drum = there.taxels(5000), there.drum(5000)
    assert np.all(np.diff(window.counters) == 1)
    assert window.samples.max() > 0 and len(drum) > 0
    assert np.all(np.diff(drum.time_s) > 0)
    there.close()
    far.close()


def test_a_client_that_does_not_read_gets_no_samples_until_it_has_caught_up(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connected_client, "SAMPLES_LIMIT_BYTES", -1)

    async def scenario(harness: EngineHarness) -> None:
        client = await ClientConnection.connect(harness.address)
        await client.request("stream")
        await harness.wait(2.0)
        await client.request("status")
        assert not [event for event in client.events if event.get("event") == "samples"]
        await client.close()

    harness.run(scenario)


@pytest.mark.parametrize(
    "change",
    [
        {"taxels": None},
        {"taxels": {"rows": 1, "bytes": ""}},
        {"taxels": {"rows": 1, "bytes": "AAAA"}},
        {"taxels": {"rows": -1, "bytes": ""}},
        {"taxels": {"rows": 10**9, "bytes": ""}},
        {"other": {"rows": 0, "bytes": "no base64"}},
        {"other": {"rows": 0, "bytes": 7}},
        {"range": "AAAA"},
        {"range": ["A"]},
    ],
    ids=str,
)
def test_a_damaged_stream_is_one_sentence(tmp_path: Path, change: dict[str, Any]) -> None:
    far = LiveWriter(tmp_path / "far.live")
    append_samples(far.file, DRUM_LIVE, WHOLE)
    with pytest.raises(LinkLost, match="stream of samples is damaged"):
        append_samples(far.file, DRUM_LIVE, {**WHOLE, **change})
    assert far.file.taxels.head == far.file.other.head == 0
    far.close()


def test_a_copied_engine_file_names_the_socket_beside_it(tmp_path: Path) -> None:
    engine = EngineFile("one", 7, 0, "secret", "bench.toml", "", socket="/run/there/one.sock")
    path = write_engine_file(tmp_path, engine)
    with pytest.raises(
        WrongUse,
        match=r"ssh -N -o StreamLocalBindUnlink=yes -L .*one\.sock:/run/there/one\.sock HOST",
    ):
        read_remote_engine(path)
    (tmp_path / "one.sock").touch()
    assert read_remote_engine(path).socket == str(tmp_path / "one.sock")
    path.write_text("[]")
    with pytest.raises(WrongUse, match="is no file of an engine"):
        read_remote_engine(path)
    with pytest.raises(WrongUse, match="cannot be read"):
        read_remote_engine(tmp_path / "absent")
