"""An acceptance session on the virtual rig, measured and checked."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.acceptance import (
    RigMeasurements,
    check_limits,
    is_accepted,
    measure,
    settling_time_s,
)
from rigctl.cli import main
from rigctl.config.resources import find_protocol
from rigctl.errors import SessionError
from rigctl.protocol.loader import load_protocol
from rigctl.protocol.steps import RunTrial, Turn
from tests.engine.engine_harness import open_harness

SHORT = """
name = "acceptance"
textures = ["A"]
speeds_mm_s = [120]
forces_g = [300]
repeats = 20

[trial]
travel_mm = 20

[[steps]]
at = "plate_end"
kind = "turn"
speed_mm_s = 120
turns = 2
"""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Twenty presses and two turns on the virtual rig."""
    folder = tmp_path_factory.mktemp("acceptance")
    with open_harness(folder) as harness:
        harness.record(SHORT)
        yield harness.session


@pytest.fixture(scope="module")
def found(session: Path) -> RigMeasurements:
    """The measurements of that session."""
    return measure(session)


def test_the_protocol_holds_a_hundred_presses_of_each_kind_and_turns() -> None:
    plan = load_protocol(find_protocol("acceptance")).plan()
    steps = plan.steps
    assert sum(isinstance(step, RunTrial) for step in steps) == 900
    assert sorted(step.speed_mm_s for step in steps if isinstance(step, Turn)) == [40, 80, 120]


def test_the_virtual_rig_is_accepted(found: RigMeasurements) -> None:
    checks = check_limits(found)
    assert is_accepted(checks), [check for check in checks if not check.passed]
    (condition,) = found.conditions
    assert len(condition.presses) == 20
    assert abs(condition.drift) < 0.005
    assert 0.05 < np.median(condition.column("settle_s")) < 1.0


def test_whole_turns_are_timed_by_the_mark(found: RigMeasurements) -> None:
    (turns,) = found.turns
    assert len(turns.errors) == 2
    assert np.abs(turns.errors).max() < 0.001
    assert len(found.index_errors_steps) == 21
    assert max(map(abs, found.index_errors_steps)) <= 1


def test_a_rig_that_is_off_is_not_accepted(found: RigMeasurements) -> None:
    (condition,) = found.conditions
    presses = [replace(press, error=0.03 * i / 19) for i, press in enumerate(condition.presses)]
    worse = replace(found, conditions=(replace(condition, presses=tuple(presses)),), faults=("x",))
    failed = [check.name for check in check_limits(worse) if not check.passed]
    assert failed == ["mean force in the window", "drift, last ten minus first ten", "faults"]


def test_a_rig_with_missing_measurements_is_not_accepted(found: RigMeasurements) -> None:
    few = replace(found.conditions[0], presses=found.conditions[0].presses[:5])
    checks = check_limits(replace(found, conditions=(few,), turns=()))
    assert [check.found for check in checks if check.passed is None] == ["not measured"] * 2
    assert not is_accepted(checks)


def test_settling_is_counted_to_the_last_mean_outside() -> None:
    times = np.arange(80) * 0.0125
    force = np.where(times < 0.2, 400.0, 500.0)
    assert settling_time_s(times, force, 500.0) == pytest.approx(0.2, abs=0.026)
    assert np.isnan(settling_time_s(times, np.full(80, 450.0), 500.0))
    assert np.isnan(settling_time_s(times[:3], force[:3], 500.0))


def test_the_command_answers_with_its_exit_code_and_makes_a_report(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "report"
    assert main(["accept", str(session), "--out", str(out)]) == 0
    out_text = capsys.readouterr().out
    assert "pass  settling time" in out_text
    assert "the simulated rig is accepted" in out_text
    assert sorted(p.name for p in out.iterdir()) == [
        "acceptance.json",
        "acceptance.png",
        "acceptance.svg",
        "report.html",
    ]
    assert "Simulated" in (out / "report.html").read_text(encoding="utf-8")
    assert main(["accept", str(session), "--out", str(out)]) == 2
    capsys.readouterr()
    assert main(["accept", str(session), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["conditions"][0]["presses"] == 20


def test_a_session_without_a_press_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SessionError):
        measure(tmp_path)
