"""The mounting of a trial's plate in a session, also in one from before there was such a column."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.analysis.trial_set import join_sessions
from rigctl.cli import main
from rigctl.session.format.file_names import part_name
from rigctl.session.read.session import Session
from rigctl.session.recover.replacement import write_prefix
from rigctl.session.summary import summarise_session
from tests.session.building import SyntheticRig, plan, record_plan, recorder
from tests.session.older_parts import without_mounts


def test_a_trial_says_its_mounting(tmp_path: Path) -> None:
    folder, trial = tmp_path / "session", replace(plan().trials[0], mount=2)
    with recorder(folder) as rec:
        rec.begin_part("start", "A")
        SyntheticRig(rec).trial(trial)
    with Session.open(folder) as session:
        assert session.trial_row(0).trial == trial
    assert summarise_session(folder)["mounts"] == 2
    assert [one.mount for one in join_sessions([folder]).trials] == [2]


def test_an_older_session_has_one_mounting_of_each_plate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "session"
    of = record_plan(folder)
    without_mounts(folder)
    with Session.open(folder) as session:
        assert [session.trial_row(row).trial for row in session.committed()] == list(of.trials)
        assert set(session.trials["mount"].tolist()) == {1}
    assert main(["verify", str(folder)]) == 0, capsys.readouterr().out


def test_an_older_session_is_resumed_with_mountings(tmp_path: Path) -> None:
    folder = tmp_path / "session"
    of = record_plan(folder)
    without_mounts(folder)
    with recorder(folder, resume=True) as rec:
        rec.begin_part("resume", "B")
        SyntheticRig(rec, 1_000_000).trial(replace(of.trials[-1], mount=3), attempt=2)
    with Session.open(folder) as session:
        assert session.trials["mount"].tolist() == [1] * len(of.trials) + [3]


def test_what_is_saved_of_an_older_part_has_the_first_mounting(tmp_path: Path) -> None:
    folder = tmp_path / "session"
    record_plan(folder)
    without_mounts(folder)
    (saved := tmp_path / "saved").mkdir()
    write_prefix(folder / part_name(1), saved / part_name(1), "quarantine")
    with Session.open(saved) as session:
        assert len(session.trials) == 4
        assert set(session.trials["mount"].tolist()) == {1}
