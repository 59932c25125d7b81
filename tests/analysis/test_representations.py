"""Sessions to feature files: joined sets, omissions with their remarks, and the effect of C."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.cache import Resources
from rigctl.analysis.executors import local_executor
from rigctl.analysis.force_scaling import ForceMatrixSource, count_search_statuses, force_sentence
from rigctl.analysis.representations import (
    represent,
)
from rigctl.analysis.settings import AnalysisSettings
from rigctl.analysis.spike_counts import c_per_trial
from rigctl.analysis.trial_set import join_sessions, open_trials
from rigctl.encoder.features import feature_matrices
from rigctl.encoder.parameters import DEFAULT
from rigctl.errors import SessionError
from rigctl.session.recorder import Recorder
from rigctl.values import Verdict
from tests.analysis.recordings import record
from tests.session.building import PROTOCOL, RIG, SyntheticRig, header, plan

AT_250_G = AnalysisSettings().with_reference_force(250.0)


def test_two_days_make_one_set(tmp_path: Path) -> None:
    days = [
        record(tmp_path / "one", "AB", travel_mm=24.0, torn=(9,), forces=(250, 500)),
        record(tmp_path / "two", "B", travel_mm=24.0, seed=4, forces=(250, 500)),
    ]
    joined = join_sessions(days)
    assert len(joined.trials) == 12 + 6
    assert joined.textures == ("A", "B") and joined.forces_g == (250.0, 500.0)
    assert [source["seed"] for source in joined.provenance] == [3, 4]
    made = represent(joined, DEFAULT, tmp_path)
    assert len(made.trials.trials) == 17
    assert any("1 trial left out for gaps in their samples: 9" in remark for remark in made.remarks)
    with open_trials(made.trials.files) as reader:
        samples = [reader.read(trial) for trial in made.trials.trials]
    speeds = [trial.speed_mm_s for trial in made.trials.trials]
    layouts = (made.unscaled, made.scaled)
    plain = feature_matrices(samples, speeds, made.normalisation, layouts)
    by_key = {r.key: made.features(r) for r in made.present}
    np.testing.assert_array_equal(by_key["original"], plain[0])
    np.testing.assert_array_equal(by_key["speed"], plain[1])
    assert list(by_key) == [
        "original", "speed", "force", "speed_force", "force_blind", "speed_force_blind",
        "divided", "speed_divided",
    ]  # fmt: skip
    assert made.force is not None
    matrix = made.force
    for key, blind in (("force", False), ("force_blind", True)):
        c = c_per_trial(made.trials.trials, matrix, blind=blind)
        forced = feature_matrices(samples, speeds, made.normalisation, layouts, sa_scale=c)
        np.testing.assert_array_equal(by_key[key], forced[0])
        np.testing.assert_array_equal(by_key[key.replace("force", "speed_force")], forced[1])
    at_500 = [trial.force_g == 500 for trial in made.trials.trials]
    np.testing.assert_array_equal(by_key["force"][at_500], plain[0][at_500])
    assert not np.array_equal(by_key["force"], plain[0])
    assert not np.array_equal(by_key["force"], by_key["force_blind"])
    assert all(np.isfinite(matrix).all() for matrix in by_key.values())
    assert made.force is not None
    assert sum(count_search_statuses(made.force).values()) == 2 * 3 * 18
    assert "(the paper: 1.4 %, 62 of 4,320)" in force_sentence(made.force)


def test_processes_give_equal_features(tmp_path: Path) -> None:
    session = record(tmp_path / "session", "AB", travel_mm=12.0)
    folders = [tmp_path / "alone", tmp_path / "together"]
    for folder in folders:
        folder.mkdir()
    alone = represent(join_sessions([session]), DEFAULT, folders[0])
    with local_executor(2) as executor:
        together = represent(
            join_sessions([session]), DEFAULT, folders[1], resources=Resources(executor)
        )
    for representation in alone.present:
        first, second = (made.files[representation.key] for made in (alone, together))
        assert first.read_bytes() == second.read_bytes()


def test_without_the_reference_force_c_is_left_out_with_a_remark(tmp_path: Path) -> None:
    session = record(tmp_path / "session", "AB", travel_mm=12.0, forces=(250, 1000))
    made = represent(join_sessions([session]), DEFAULT, tmp_path)
    assert [r.key for r in made.present] == ["original", "speed", "divided", "speed_divided"]
    assert any("reference force of 500 g" in remark for remark in made.remarks)
    other = represent(join_sessions([session]), DEFAULT, tmp_path, settings=AT_250_G)
    assert len(other.present) == 8 and other.force is not None
    assert (other.force.c[..., 0] == 1).all() and (other.force.c[..., 1] < 1).all()


def test_depths_are_scaled_to_the_middle_one_or_to_the_one_that_is_named(tmp_path: Path) -> None:
    depths_mm = (0.6, 0.9, 1.2, 1.5)
    session = record(tmp_path / "session", "AB", travel_mm=12.0, depths_mm=depths_mm)
    trials = join_sessions([session])
    assert trials.forces_g == depths_mm
    made = represent(trials, DEFAULT, tmp_path)
    assert len(made.present) == 8 and made.force is not None
    assert made.force.reference_g == made.settings.conditions.reference_force_g == 0.9
    assert (made.force.c[..., 0] > 1).all() and (made.force.c[..., 2:] < 1).all()
    assert any("C aims at the middle depth, 0.9 mm" in remark for remark in made.remarks)
    deepest = AnalysisSettings().with_reference_force(1.5)
    other = represent(trials, DEFAULT, tmp_path, settings=deepest)
    assert other.force is not None and other.force.reference_g == 1.5
    assert not any("C aims at" in remark for remark in other.remarks)


def test_depths_and_forces_are_not_analysed_together(tmp_path: Path) -> None:
    forces = record(tmp_path / "forces", "A", travel_mm=12.0)
    depths = record(tmp_path / "depths", "A", travel_mm=12.0, depths_mm=(0.5, 1.0))
    with pytest.raises(SessionError, match=r"depths was pressed to depths, .*forces to forces"):
        join_sessions([forces, depths])


def test_the_rate_error_of_a_given_c_has_the_reference_of_that_c(tmp_path: Path) -> None:
    trials = join_sessions([record(tmp_path / "session", "AB", travel_mm=12.0)])
    made = represent(trials, DEFAULT, tmp_path, settings=AT_250_G)
    assert made.force is not None
    source = ForceMatrixSource(tmp_path / "c.h5", made.force, ())
    found = represent(trials, DEFAULT, tmp_path, source=source).transferred_c
    assert found is not None
    assert {error.force_g for error in found.rate_errors} == {500.0}
    assert all(error.with_c_hz < error.without_c_hz for error in found.rate_errors)


def test_other_layouts_and_empty_sets_are_refused_by_name(tmp_path: Path) -> None:
    session = record(tmp_path / "eighteen", "A", travel_mm=12.0)
    nine = header(n_taxels=9)
    with Recorder(tmp_path / "nine", nine, PROTOCOL, RIG) as recorder:
        recorder.begin_part("start", "A")
    with pytest.raises(SessionError, match=r"nine has 9 taxels, .*eighteen has 18"):
        join_sessions([session, tmp_path / "nine"])
    with pytest.raises(SessionError, match="no committed trial with motion"):
        join_sessions([tmp_path / "nine"])
    with pytest.raises(SessionError, match="named twice"):
        join_sessions([session, tmp_path / "nine" / ".." / "eighteen"])
    torn = record(tmp_path / "torn", "A", travel_mm=12.0, torn=tuple(range(1, 7)))
    with pytest.raises(SessionError, match="no complete trial is left"):
        represent(join_sessions([torn]), DEFAULT, tmp_path)


def test_aborted_attempts_that_were_repeated_have_a_remark(tmp_path: Path) -> None:
    folder = tmp_path / "session"
    with Recorder(folder, header(), PROTOCOL, RIG) as recorder:
        recorder.begin_part("start", "A")
        bench = SyntheticRig(recorder)
        trials = plan().trials
        bench.trial(trials[0], Verdict.ABORTED)
        for trial in trials:
            bench.trial(trial, attempt=2)
    joined = join_sessions([folder])
    assert any("attempts repeated: 1 aborted" in remark for remark in joined.remarks)
    assert len(joined.trials) == len(trials)
    assert joined.provenance[0]["firmware"] == {"taxels": "1.0 0badcafe"}
