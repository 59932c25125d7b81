"""A protocol on the virtual rig and on the real firmware, compared with the ground truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigctl import __version__
from rigctl.config.resources import source_commit
from rigctl.session.ground_truth import trial_truths
from rigctl.session.verify import verify
from tests.engine.engine_harness import TINY, EngineHarness, open_harness, open_session


def test_every_trial_is_committed_complete_and_true(harness: EngineHarness) -> None:
    run = harness.record()
    assert (run.outcome, run.complete) == ("done", True)
    assert harness.exit_code == 0
    with open_session(harness.session) as session:
        assert session.trials["verdict"].tolist() == ["committed"] * 4
        assert len(session.gaps) == 0
        for index in session.committed():
            window = session.window(int(index))
            assert window.complete
            assert np.all(window.flags & 1), "sync is high through the whole trial"
        truths = trial_truths(session)
    assert len(truths) == 4
    for truth in truths:
        assert abs(truth.speed_error) < 0.001
        assert abs(truth.force_error) < 0.02
    assert verify(harness.session).whole


def test_the_window_begins_at_the_first_sample_after_the_rise(harness: EngineHarness) -> None:
    harness.record()
    with open_session(harness.session) as session:
        for index in session.committed():
            window = session.window(int(index))
            part = session.parts[int(session.trials["part"][index]) - 1]
            row = int(session.trials["first_sample"][index])
            edges = part.read("/taxels/edges", row - 2, row + 1) & 3
            assert (int(edges[1]) - int(edges[0])) % 4 == 1, "the rise falls into the frame before"
            assert edges[2] == edges[1]
            assert window.counters[0] == window.first_counter


def test_two_runs_with_one_seed_are_equal_to_the_bit(tmp_path: Path) -> None:
    recorded = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        with open_harness(tmp_path / name, seed=11) as harness:
            harness.record(TINY.replace('"A", "L"', '"C"'))
            with open_session(harness.session) as session:
                part = session.parts[0]
                samples = part.read("/taxels/samples", 0, part.n_samples)
                counters = part.read("/taxels/counter", 0, part.n_samples)
                windows = session.trials["first_counter"].tolist()
            recorded.append((samples, counters, windows))
    for first, second in zip(*recorded, strict=True):
        assert np.array_equal(first, second)


def test_both_clocks_and_boards_are_published(harness: EngineHarness) -> None:
    harness.record()
    ppm = harness.engine.status().clock_ppm
    assert ppm["drum"] is not None and abs(ppm["drum"] - 1200) < 100
    assert ppm["taxels"] is not None and abs(ppm["taxels"] + 900) < 100
    with open_session(harness.session) as session:
        clocks = [event for event in session.events if event.kind == "clock"]
        header = session.header
        assert header.simulated
        assert (header.software_version, header.software_commit) == (__version__, source_commit())
        assert {board.board for board in header.boards} == {"drum", "taxels"}
    assert clocks, "the corrections stand in the session"


EVERY_STEP = """
name = "steps"
textures = ["A", "D"]
speeds_mm_s = [120]
forces_g = [400]
repeats = 2
[order]
kind = "shuffled"
seed = 7
[trial]
travel_mm = 120
direction = "alternate"
[[steps]]
at = "start"
kind = "message"
text = "Wipe the sensor."
wait = true
[[steps]]
at = "start"
kind = "baseline"
seconds = 2
[[steps]]
at = "plate_start"
kind = "approach_only"
force_g = 300
seconds = 1
[[steps]]
at = "every"
trials = 1
kind = "tare"
[[steps]]
at = "end"
kind = "rest"
seconds = 1
"""


def test_every_kind_of_step_runs_unattended(harness: EngineHarness) -> None:
    run = harness.record(EVERY_STEP)
    assert (run.outcome, run.complete) == ("done", True)
    with open_session(harness.session) as session:
        kinds = [event.kind for event in session.events]
        assert set(session.trials["direction"].tolist()) == {"forward", "backward"}
        truths = trial_truths(session)
    assert kinds.count("baseline") == 2
    assert kinds.count("approach") == 4
    assert harness.texts("message") == ["Wipe the sensor."]
    assert max(abs(truth.speed_error) for truth in truths) < 0.001
    assert verify(harness.session).whole


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
