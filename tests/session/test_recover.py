"""``rigctl recover`` closes killed parts; a damaged part stays and is read around."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

import h5py
import pytest

from rigctl.cli import main
from rigctl.errors import DiskFault, SessionError
from rigctl.session.recover import recover
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.session.building import recorder
from tests.session.damage import is_closed, kill_while_recording, record_four_parts, truncate, zero


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("killed")
    kill_while_recording(folder / "s", 6, folder / "scratch", idle=5000)
    return folder / "s"


def digests_of(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def trial_ids(folder: Path) -> list[int]:
    with Session.open(folder) as opened:
        assert all(opened.window(index).complete for index in opened.committed())
        return [int(opened.trials["trial_id"][index]) for index in opened.committed()]


def test_a_killed_part_is_closed_with_its_rows_and_digests(session: Path) -> None:
    part = session / "part-0001.h5"
    before, trials = part.read_bytes(), trial_ids(session)
    assert not verify(session).whole and not is_closed(part)
    assert recover(session, dry_run=True).closed == ("part-0001.h5",)
    assert part.read_bytes() == before
    assert recover(session).closed == ("part-0001.h5",)
    assert part.read_bytes()[48:] == before[48:] and is_closed(part)
    with h5py.File(part) as file:  # no option of a writer's
        assert len(file["/trials"]) == 6
    assert trial_ids(session) == trials and len(trials) == 6
    report = verify(session)
    assert report.whole, report.problems
    assert "its writer was killed, and it was closed afterwards" in " ".join(report.notes)
    assert not (session / "writer.lock").exists()
    again = digests_of(session)
    assert recover(session).closed == ()
    assert digests_of(session) == again


def test_a_part_that_was_cut_short_stays_and_is_read_as_far_as_it_goes(session: Path) -> None:
    truncate(session / "part-0001.h5", 0.8)
    before = digests_of(session)
    result = recover(session)
    assert result.closed == ()
    assert any("was cut short" in line for line in result.missing)
    assert before.items() >= digests_of(session).items()
    assert 0 < len(trial_ids(session)) < 6


def test_a_damaged_part_is_named_and_read_around(tmp_path: Path) -> None:
    record_four_parts(tmp_path / "s")
    zero(tmp_path / "s" / "part-0002.h5")
    before = digests_of(tmp_path / "s")
    result = recover(tmp_path / "s")
    assert result.closed == () and digests_of(tmp_path / "s") == before
    (line,) = result.missing
    assert line.startswith("part-0002.h5 is damaged") and "its trials are left out" in line
    assert len(trial_ids(tmp_path / "s")) == 6


def test_a_full_disk_leaves_the_part_as_it_was(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = session / "part-0001.h5"
    before = part.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left")))
        with pytest.raises(DiskFault, match=r"cannot be closed: .*; make room, it is unchanged"):
            recover(session)
    assert part.read_bytes() == before
    assert not list(session.glob("*.closed"))
    assert recover(session).closed == ("part-0001.h5",)


def test_what_is_written_or_no_session_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="is not a session"):
        recover(tmp_path)
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        rec.wait_written()
        with pytest.raises(SessionError, match=f"being written by process {os.getpid()}"):
            recover(tmp_path / "s")


def test_the_command_says_what_it_did(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recover", "--dry-run", str(session)]) == 0
    assert "part-0001.h5: would be closed" in capsys.readouterr().out
    assert main(["recover", "--json", str(session)]) == 0
    assert json.loads(capsys.readouterr().out)["closed"] == ["part-0001.h5"]
    assert main(["recover", str(session)]) == 0
    assert "has no part to close" in capsys.readouterr().out
    assert main(["recover", str(session / "none")]) == 2
