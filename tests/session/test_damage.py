"""The trials whose rows were altered are found, and no others; analyses leave out just those."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.analysis.trial_set import join_sessions
from rigctl.finger.analysis.scans import read_scans
from rigctl.finger.session import FingerSession
from rigctl.session.digests import PartDamage, RowRange, check_digests, damaged_trials
from rigctl.session.hdf5_file import text_scalar
from rigctl.session.layout import SAMPLES, TRIALS
from rigctl.session.part import PartReader
from rigctl.session.session import Session
from tests.finger import finger_building
from tests.session import building
from tests.session.building import SyntheticRig, plan


@pytest.fixture
def recorded(in_blocks: Path) -> Path:
    return in_blocks


def flip_sample(folder: Path, part: int, row: int) -> None:
    with h5py.File(folder / f"part-{part:04d}.h5", "r+") as file:
        file[SAMPLES][row, 0] ^= 1


def test_an_intact_session_has_no_damage(session: Path) -> None:
    with Session.open(session) as opened:
        assert damaged_trials(opened) == {}
        assert [check_digests(part) for part in opened.parts] == [PartDamage()] * 2


def test_altered_samples_are_those_of_one_trial(session: Path) -> None:
    with Session.open(session) as opened:
        row = opened.trials[5]
        at = int(row["first_sample"]) + 20
    flip_sample(session, int(row["part"]), at)
    with Session.open(session) as opened:
        assert list(damaged_trials(opened)) == [5]
        (rows,) = check_digests(opened.parts[1], {SAMPLES}).altered
        assert rows.table == SAMPLES and rows.first_row <= at < rows.end


def test_tables_that_no_analysis_needs_cost_no_trial(session: Path) -> None:
    with h5py.File(session / "part-0001.h5", "r+") as file:
        rows = file["/drum"][:]
        rows["speed_mm_s"] += 1
        file["/drum"][:] = rows
    with Session.open(session) as opened:
        assert damaged_trials(opened) == {}
        assert {rows.table for rows in check_digests(opened.parts[0]).altered} == {"/drum"}


def test_an_altered_description_concerns_all_trials_of_its_part(session: Path) -> None:
    with h5py.File(session / "part-0001.h5", "r+") as file:
        file.attrs.create("sensor", text_scalar("another"))
    with Session.open(session) as opened:
        found = damaged_trials(opened)
        assert set(found) == set(np.flatnonzero(opened.trials["part"] == 1).tolist())
        assert "attributes or texts are not those" in found[0]


def test_an_altered_row_of_the_trials_is_left_out(session: Path) -> None:
    with h5py.File(session / "part-0001.h5", "r+") as file:
        row = file[TRIALS.path][1]
        row["force_g"] = 300
        file[TRIALS.path][1] = row
    with Session.open(session) as opened:
        assert list(damaged_trials(opened)) == [1]


def test_rows_that_were_added_to_a_closed_part_are_damage(session: Path) -> None:
    path = session / "part-0001.h5"
    with h5py.File(path, "r+") as file:
        trials = file[TRIALS.path]
        trials.resize(len(trials) + 1, axis=0)
        trials[-1] = trials[0]
    part = PartReader(path)
    assert check_digests(part) == PartDamage(uncovered=(RowRange(TRIALS.path, 4, 1),))
    part.close()


def test_analyses_of_the_drum_leave_out_just_the_altered_trial(session: Path) -> None:
    whole = join_sessions([session])
    flip_sample(session, 1, whole.trials[1].sample_range.start + 3)
    stages: list[str] = []
    rest = join_sessions([session], lambda stage, done, total: stages.append(stage))
    left_out = {trial.trial_id for trial in whole.trials} - {t.trial_id for t in rest.trials}
    assert left_out == {whole.trials[1].trial_id}
    (remark,) = [line for line in rest.remarks if "left out" in line]
    assert f"part-0001.h5: trial {whole.trials[1].trial_id} is left out: rows" in remark
    assert remark.endswith("of /taxels/samples are not those that were recorded")
    assert set(stages) == {"checking digests, MiB"}
    assert len(rest.provenance[0]["closing_digest"]) == 64


def test_analyses_of_the_finger_leave_out_just_the_altered_scan(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    with (
        finger_building.recorder(folder) as rec,
        finger_building.SyntheticFinger(rec) as finger,
    ):
        rec.begin_part("start")
        for trial in finger_building.plan().trials[:4]:
            finger.trial(trial)
            rec.wait_written()
    whole = read_scans(folder)
    with FingerSession.open(folder) as opened:
        at = int(opened.trials[2]["first_sample"]) + 50
    with h5py.File(folder / "part-0001.h5", "r+") as file:
        file["/taxels/spikes"][at, 0] ^= 1
    rest = read_scans(folder)
    assert len(rest.recordings) == len(whole.recordings) - 1
    assert any("trial 3 is left out: rows" in remark for remark in rest.remarks)


def test_a_growing_session_is_not_held_up(tmp_path: Path) -> None:
    with building.recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        SyntheticRig(rec).trial(plan().trials[0])
        rec.wait_written()
        with Session.open(tmp_path / "s") as opened:
            assert damaged_trials(opened) == {}
