"""The computer is kept awake by a helper for as long as a run lasts; where it cannot be, told."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from rigctl.engine import keep_awake
from rigctl.engine.keep_awake import kept_awake
from tests.engine.engine_harness import EngineHarness, until_ended
from tests.engine.protocol.test_interruptions import PAIR
from tests.waiting import until

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="helpers are programs of Unix")


def use(monkeypatch: pytest.MonkeyPatch, helper: Sequence[str]) -> list[str]:
    """Let this be the helper; return the list of what is told."""
    monkeypatch.setitem(keep_awake.HELPERS, sys.platform, helper)
    return []


def test_a_helper_holds_until_the_end(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    mark = tmp_path / "held"
    script = f"trap '' TERM; touch {mark}; echo held; cat; rm {mark}"
    told = use(monkeypatch, ["sh", "-c", script])
    with kept_awake(told.append):
        until(mark.exists)
    assert not mark.exists() and told == []


def test_a_helper_ends_with_its_process(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    mark = tmp_path / "ended"
    # Its process may be gone before it says that it holds.
    helper = ["sh", "-c", f"trap '' PIPE; echo held; cat; touch {mark}"]
    code = (
        "import os, sys\nfrom rigctl.engine import keep_awake\n"
        f"keep_awake.HELPERS[sys.platform] = {helper!r}\n"
        "with keep_awake.kept_awake(print):\n    os.kill(os.getpid(), 9)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=False)
    until(mark.exists)


@pytest.mark.parametrize(
    ("helper", "words"),
    [
        (
            ["sh", "-c", "echo 'Failed to connect to bus.' >&2; exit 1"],
            "Failed to connect to bus: ",
        ),
        (["no-such-helper"], "no-such-helper is not there: switch sleep"),
    ],
)
def test_a_computer_that_cannot_be_kept_awake_is_told(
    monkeypatch: pytest.MonkeyPatch, helper: Sequence[str], words: str
) -> None:
    told = use(monkeypatch, helper)
    with kept_awake(told.append):
        until(lambda: told)
    assert words in told[0]


def test_a_run_says_where_it_cannot(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, ["no-such-helper"])
    harness.engine.keep_awake = kept_awake
    harness.run(until_ended, harness.request(PAIR))
    (text,) = harness.texts("awake")
    assert text.startswith("this computer may sleep or restart during the run")
