"""A run asks for each plate again, and again after an interruption."""

from __future__ import annotations

from pathlib import Path

from rigctl.engine.run_request import RunRequest
from tests.engine.engine_harness import EngineHarness, open_harness, open_session, until_ended

TWICE = """
textures = ["A"]
speeds_mm_s = [120]
forces_g = [500]
mounts = 2
"""


async def confirm(harness: EngineHarness) -> str:
    """Wait for a question and confirm it; return its text."""
    run = harness.engine.run
    assert run is not None
    await harness.until(lambda: run.status().prompt is not None)
    prompt = run.status().prompt
    assert prompt is not None and run.control.answer(prompt.id, "ok")
    await harness.until(lambda: run.status().prompt is None)
    return prompt.text


def test_the_second_mounting_is_asked_for_also_after_an_interruption(tmp_path: Path) -> None:
    asked: list[str] = []

    async def first_sitting(harness: EngineHarness) -> None:
        asked.append(await confirm(harness))
        run = harness.engine.run
        assert run is not None
        await harness.until(lambda: run.status().prompt is not None)
        run.control.abort("enough for today")
        await until_ended(harness)

    async def second_sitting(harness: EngineHarness) -> None:
        asked.append(await confirm(harness))
        await harness.until(lambda: harness.engine.status().run.current is not None)
        current = harness.engine.status().run.current
        assert current is not None and current.mount == 2
        await until_ended(harness)

    with open_harness(tmp_path) as harness:
        harness.run(first_sitting, harness.request(TWICE, yes=False))
    with open_harness(tmp_path) as harness:
        harness.run(second_sitting, RunRequest(resume=str(harness.session)))
    assert ["mounting 1 of 2" in asked[0], "mounting 2 of 2" in asked[1]] == [True, True]
    with open_session(tmp_path / "session") as session:
        assert session.trials["mount"].tolist() == [1, 2]
        first, second = (session.samples(row).mean(axis=0) for row in (0, 1))
    # A bench that began its mountings anew would press the plate exactly as in the first sitting.
    assert abs(first - second).mean() > 0.5
