"""The sample session between windows: one makes it, and remnants never become a session."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.errors import SessionError
from rigctl.session.writer_lock import WriterLock
from rigctl.synth.sample_session import SampleSession


def _told(stage: str, line: str) -> None:
    """Hear nothing."""


@pytest.mark.parametrize(("written", "sentence"), [("", "window"), ("s.partial", "process")])
def test_while_another_one_makes_it_nobody_else_does(
    tmp_path: Path, written: str, sentence: str
) -> None:
    (tmp_path / written).mkdir(exist_ok=True)
    lock = WriterLock(tmp_path / written)
    with pytest.raises(SessionError, match=f"another {sentence} makes it"):
        SampleSession(tmp_path / "s", _told).provide()
    lock.release()
    assert not (tmp_path / "s").exists()


def test_one_that_is_cancelled_before_it_begins_starts_no_command(tmp_path: Path) -> None:
    sample = SampleSession(tmp_path / "s", _told)
    sample.cancel()
    assert not sample.provide()
    assert list(tmp_path.iterdir()) == []
