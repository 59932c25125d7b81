"""`rigctl watch --http`: the page of a run, read by a client of HTTP, and nothing else there."""

from __future__ import annotations

import http.client
import re
import socket
from pathlib import Path
from xml.etree import ElementTree

import pytest

from rigctl.cli import main
from rigctl.cli.session_looks import NOTHING_YET, Look, TrialRaster, looks
from rigctl.cli.watch_page import WatchPage, listen_address, raster_svg
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from rigctl.errors import WrongUse
from tests.engine.engine_harness import TINY, EngineHarness, open_harness


@pytest.fixture(autouse=True)
def no_other_engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))


def get(
    page: WatchPage, path: str = "/", method: str = "GET", host: str = ""
) -> tuple[int, str, http.client.HTTPMessage]:
    """Return status, text and headers of one request."""
    port = int(page.address.rpartition(":")[2])
    client = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    try:
        client.request(method, path, headers={"Host": host} if host else {})
        answer = client.getresponse()
        return answer.status, answer.read().decode(), answer.headers
    finally:
        client.close()


def test_the_page_follows_a_run_to_its_end(tmp_path: Path) -> None:
    pages: list[str] = []

    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        await harness.until(lambda: run.control.prompt is not None)
        view = iter(looks(harness.session, with_raster=True))
        with WatchPage(("127.0.0.1", 0), harness.session) as page:
            while not harness.has_ended():
                page.show(next(view))
                pages.append(get(page)[1])
                if run.control.prompt is not None:
                    run.control.answer(run.control.prompt.id, "ok")
                await harness.wait(2.0)
            page.show(next(view))
            pages.append(get(page)[1])

    with open_harness(tmp_path) as harness:
        harness.run(scenario, harness.request(TINY, yes=False))
    assert NOTHING_YET in pages[0] and 'http-equiv="refresh"' in pages[0]
    assert any("of 4 trials, 0 rejected" in page and "<svg" in page for page in pages[1:-1])
    last = pages[-1]
    assert "4 of 4 trials" in last and "the session is closed" in last
    assert "refresh" not in last, "nothing more comes"
    assert re.search(r"<h2>SIMULATED: trial \d \([AL], 1\d0 mm/s, 500 g\), \d+ ms</h2>", last)
    drawing = re.search(r"<svg.*</svg>", last)
    assert drawing is not None
    trains = ElementTree.fromstring(drawing[0]).findall("path")
    assert len(trains) == 36 and any(train.get("d") for train in trains)


def test_it_only_answers_get_of_its_one_page_to_this_computer(tmp_path: Path) -> None:
    with WatchPage(("127.0.0.1", 0), tmp_path / "<b>name") as page:
        page.show(Look(["an <event>"], "1 of 4 trials; 3 lost", not_good=["trial 1 rejected: <x>"]))
        status, text, headers = get(page)
        assert status == 200 and headers["Cache-Control"] == "no-store"
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert "&lt;b&gt;name" in text and "an &lt;event&gt;" in text and "&lt;x&gt;" in text
        assert get(page, "/etc/passwd")[0] == get(page, "/x/../..")[0] == 404
        assert get(page, method="POST")[0] == get(page, method="DELETE")[0] == 501
        assert get(page, host="evil.example:80")[0] == 403
        assert get(page, host="localhost:1234")[0] == 200


def test_a_drawing_is_bounded_however_many_spikes_there_are() -> None:
    import numpy as np

    every = np.arange(600_000, dtype=np.int32)
    assert len(raster_svg(TrialRaster("t", [("SA ", [every])], len(every)))) < 20_000


@pytest.mark.parametrize("text", ["", "http", "70000", "-1", "localhost:", "1.2.3.4:x"])
def test_what_is_no_port_is_refused(text: str) -> None:
    with pytest.raises(WrongUse, match="is no port: give one such as 8080"):
        listen_address("--http", text)


def test_addresses() -> None:
    assert listen_address("--http", "8080") == ("127.0.0.1", 8080)
    assert listen_address("--http", "0.0.0.0:80") == ("0.0.0.0", 80)


def test_a_taken_port_is_told_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["watch", str(tmp_path), "--http", str(port)]) == 2
    assert f"127.0.0.1:{port} cannot be had (Address already in use)" in capsys.readouterr().err
