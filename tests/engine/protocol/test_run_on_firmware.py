"""A protocol on the boards' real firmware, compared with the ground truth."""

from __future__ import annotations

from pathlib import Path

from rigctl.session.ground_truth import trial_truths
from rigctl.session.verify import verify
from tests.engine.engine_harness import TINY, open_harness, open_session


def test_a_trial_on_both_firmware_images_is_complete_and_true(tmp_path: Path) -> None:
    with open_harness(tmp_path, rig_kind="firmware") as harness:
        run = harness.record(TINY.replace('"A", "L"', '"D"').replace("100, 120", "120"))
        assert (run.outcome, run.complete) == ("done", True)
        with open_session(harness.session) as session:
            assert len(session.gaps) == 0
            assert session.header.rig == "firmware"
            (truth,) = trial_truths(session)
        assert verify(harness.session).whole
    assert abs(truth.speed_error) < 0.001
    assert abs(truth.force_error) < 0.02
