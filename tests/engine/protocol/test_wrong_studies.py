"""A protocol that no trial can keep, a resume with another plan or sensor: told, nothing lost."""

from __future__ import annotations

from pathlib import Path

from rigctl.config.rig_config import About, RigConfig
from rigctl.engine.run_request import RunRequest
from rigctl.errors import SessionError
from rigctl.session.layout import PROTOCOL_FILE
from rigctl.session.verify import verify
from tests.engine.engine_harness import EngineHarness, open_harness, until_ended
from tests.engine.protocol.test_interruptions import PAIR

IMPOSSIBLE = PAIR.replace("forces_g = [500]", "forces_g = [50]")
"""Its band of two percent is a gram, less than the noise of the load cell."""


def test_limits_that_cannot_be_met_end_the_run_in_a_sentence(harness: EngineHarness) -> None:
    run = harness.record(IMPOSSIBLE)
    assert run.outcome == "failed"
    assert run.text.startswith("settling at the force, within settle.band_percent of the protocol")
    assert harness.engine.status().state_words == "off"
    report = verify(harness.session)
    assert report.problems == [] and report.trials_committed == 0


def recorded_half(folder: Path, sensor: str) -> Path:
    """Record the first trial of a pair with a sensor of this name."""

    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        await harness.until(lambda: run.status().trials_committed == 1)
        run.control.abort("for today")
        await until_ended(harness)

    with open_harness(folder, config=RigConfig(about=About(sensor=sensor))) as harness:
        harness.run(scenario, harness.request(PAIR))
        return harness.session


def resumed(folder: Path, session: Path, sensor: str, said: str = "") -> str:
    """Resume a session with a rig that names a sensor; return the refusal, empty without one."""
    folder.mkdir()

    async def start(harness: EngineHarness) -> None:
        harness.engine.start(RunRequest(resume=str(session), yes=True, sensor=said))
        await until_ended(harness)

    with open_harness(folder, config=RigConfig(about=About(sensor=sensor))) as harness:
        try:
            harness.run(start)
        except SessionError as error:
            return str(error)
    return ""


def test_another_sensor_is_refused_and_its_own_goes_on(tmp_path: Path) -> None:
    session = recorded_half(tmp_path, "S1")
    before = {path.name: path.read_bytes() for path in session.iterdir()}
    for number, named in enumerate((("S2", ""), ("S1", "S2"))):
        told = resumed(tmp_path / str(number), session, *named)
        assert "was recorded with the sensor 'S1', this rig has 'S2': resume it with its" in told
    assert {path.name: path.read_bytes() for path in session.iterdir()} == before
    assert resumed(tmp_path / "own", session, "") == ""
    assert verify(session).whole


def test_another_plan_is_refused_and_nothing_is_lost(tmp_path: Path) -> None:
    session = recorded_half(tmp_path, "S1")
    path = session / PROTOCOL_FILE
    own = path.read_text()
    path.write_text(own.replace("repeats = 2", "repeats = 3"))
    assert "was recorded with another protocol or seed" in resumed(tmp_path / "a", session, "S1")
    path.write_text(own)
    assert resumed(tmp_path / "b", session, "S1") == ""
    assert verify(session).whole
