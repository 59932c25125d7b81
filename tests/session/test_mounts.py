"""The mounting of a trial's plate in a session."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rigctl.analysis.trial_set import join_sessions
from rigctl.session.session import Session
from rigctl.session.summary import summarise_session
from tests.session.building import SyntheticRig, plan, recorder


def test_a_trial_says_its_mounting(tmp_path: Path) -> None:
    folder, trial = tmp_path / "session", replace(plan().trials[0], mount=2)
    with recorder(folder) as rec:
        rec.begin_part("start", "A")
        SyntheticRig(rec).trial(trial)
    with Session.open(folder) as session:
        assert session.trial_row(0).trial == trial
    assert summarise_session(folder)["mounts"] == 2
    assert [one.mount for one in join_sessions([folder]).trials] == [2]
