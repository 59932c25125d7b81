"""The sensor's answer to the force is measured on a smooth plate, and reported."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.sensor_response import SensorResponse, measure, summary_lines
from rigctl.cli import main
from rigctl.config.resources import find_protocol
from rigctl.encoder.reading import Reading
from rigctl.errors import WrongUse
from rigctl.protocol.loader import load_protocol
from rigctl.rig import open_rig
from rigctl.session.sensor_layout import SensorLayout
from rigctl.session.sensor_passport import read_passport
from rigctl.session.session import Session
from tests.engine.engine_harness import engine_on, open_harness

SHORT = """
name = "sensor"
textures = ["A"]
speeds_mm_s = [120]
forces_g = [200, 400, 600, 800]
repeats = 2

[order]
kind = "up-down"

[trial]
travel_mm = 20
"""
LEVELS_G = np.array([100.0, 200.0, 400.0, 800.0])


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Four forces up and down on the virtual rig."""
    with open_harness(tmp_path_factory.mktemp("sensor")) as harness:
        harness.record(SHORT)
        yield harness.session


def response(curve: np.ndarray, falling_more: float = 0.0, drift: float = 0.0) -> SensorResponse:
    """Return four repeats of two taxels with one curve; a repeat lasts an hour."""
    set_g = np.concatenate([LEVELS_G, LEVELS_G[::-1]] * 2)
    falls = np.repeat([0.0, falling_more, 0.0, falling_more], len(LEVELS_G))
    hours = np.linspace(0.0, 4.0, len(set_g))
    readings = np.interp(set_g, LEVELS_G, curve) + falls + drift * hours
    return SensorResponse(
        Path("session"),
        {"simulated": True, "sensor": "s1", "begun_utc": "", "closing_digest": ""},
        SensorLayout.default(2),
        Reading.COUNTS,
        np.stack([readings, 2 * readings], axis=1),
        set_g,
        set_g,
        np.full(len(set_g), 80.0),
        hours,
        np.repeat([1, 2, 3, 4], len(LEVELS_G)),
    )


def test_the_protocol_goes_up_and_down_by_turns() -> None:
    trials = load_protocol(find_protocol("sensor")).plan().trials
    assert len(trials) == 240
    for repeat in (1, 2, 3, 4):
        forces_g = [trial.force_g for trial in trials[60 * (repeat - 1) : 60 * repeat]]
        assert forces_g == sorted(forces_g, reverse=repeat % 2 == 0)
        assert {trial.speed_mm_s for trial in trials[:3]} == {40, 80, 120}


def test_hysteresis_drift_and_saturation_are_shares_of_the_span() -> None:
    plain = response(np.array([100.0, 200, 400, 800]))
    assert plain.span.tolist() == [700, 1400]
    assert plain.hysteresis.tolist() == [0, 0] and plain.drift_per_hour.tolist() == [0, 0]
    assert plain.end_slope.tolist() == [1, 1]
    slow = response(np.array([100.0, 200, 400, 800]), falling_more=70.0)
    # At the turn of the highest force the trials count as rising.
    assert slow.hysteresis == pytest.approx(np.full(2, 70.0 / slow.span[0]), rel=0.3)
    drifting = response(np.array([100.0, 200, 400, 800]), drift=7.0)
    assert drifting.drift_per_hour == pytest.approx(np.full(2, 0.01), rel=0.15)
    saturated = response(np.array([100.0, 400, 500, 510]))
    assert np.all(saturated.end_slope < 0.02)


def test_the_force_is_estimated_from_the_curve_of_the_other_repeats() -> None:
    plain = response(np.array([100.0, 200, 400, 800]))
    assert plain.estimated_g == pytest.approx(plain.force_g)
    off = replace(plain, readings=plain.readings * np.where(plain.repeat == 4, 1.1, 1.0)[:, None])
    fourth = off.repeat == 4
    inside = fourth & (off.set_g < 800)  # beyond the curve's end, an estimate stays at its end
    assert off.estimated_g[inside] == pytest.approx(1.1 * off.force_g[inside])
    assert off.estimated_g[fourth].max() == 800


def test_taxels_that_do_not_answer_are_named() -> None:
    plain = response(np.array([100.0, 200, 400, 800]))
    assert plain.findings == []
    readings = plain.readings.copy()
    readings[:, 0] = 5.0
    (finding,) = replace(plain, readings=readings).findings
    assert finding.startswith("taxel 1 does not answer to the force: its mean reading spans 0")
    readings[:, 0] = 1000.0 - plain.readings[:, 0]
    assert replace(plain, readings=readings).findings == [
        "taxel 1 reads less at higher forces: it falls by 100% of its span"
    ]


def test_the_virtual_sensor_answers_with_all_taxels(session: Path) -> None:
    found = measure(session)
    assert found.findings == [] and found.curves.shape == (4, 18)
    assert np.all(np.diff(found.curves.sum(axis=1)) > 0)
    assert found.measured_g == pytest.approx(found.levels_g, rel=0.05)
    assert found.force_error.max() < 0.1
    assert "18 taxels over 200 to 800 g, 8 trials" in summary_lines(found)[0]


def test_the_command_writes_a_report_that_says_simulated(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "report"
    words = ["calibrate", "--rig", "virtual", "--json", "sensor", "--session", str(session)]
    assert main([*words, "--out", str(out)]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["simulated"] and len(answer["taxels"]) == 18
    assert {path.name for path in out.iterdir()} == {
        "report.html", "sensor.json", "sensor.png", "sensor.svg",
    }  # fmt: skip
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Simulated." in page and "18 taxels over 200 to 800 g" in page
    for existing in ([*words, "--out", str(out)], [*words[:5], "--out", str(out)]):
        assert main(existing) == 2  # without a session too: before it records for half an hour
        assert "already exists" in capsys.readouterr().err


def test_later_sessions_of_the_rig_carry_the_passport(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rig.toml"
    path.write_text('[ports]\nsimulate = "virtual"  # a rehearsal\n')
    words = ["calibrate", "--rig", str(path), "--yes"]
    measured = ["sensor", "--session", str(session), "--out"]
    assert main([*words, "--dry", *measured, str(tmp_path / "dry")]) == 0
    assert "passport" not in path.read_text()
    assert main([*words, *measured, str(tmp_path / "report")]) == 0
    assert "every later session carries it" in capsys.readouterr().out
    assert (
        'passport = "report/sensor.json"' in path.read_text()
        and "# a rehearsal" in path.read_text()
    )
    with engine_on(open_rig(str(path), seed=1, paced=False), tmp_path) as harness:
        harness.record(SHORT.replace("[200, 400, 600, 800]", "[500]"))
        later = harness.session
    with Session.open(later) as opened:
        passport = read_passport(opened.header.passport)
    assert passport.curves == pytest.approx(measure(session).curves, abs=0.01)
    assert passport.session_digest and passport.reading is Reading.CONDUCTANCE


def test_several_plates_or_few_forces_are_refused(tmp_path: Path) -> None:
    for text, words in (
        (SHORT.replace('["A"]', '["A", "B"]'), "has the plates A, B"),
        (SHORT.replace("[200, 400, 600, 800]", "[200, 400]"), "has 2 forces"),
    ):
        folder = tmp_path / words
        folder.mkdir()
        with open_harness(folder) as harness:
            harness.record(text)
            with pytest.raises(WrongUse, match=words):
                measure(harness.session)
