"""Figures of the health strip and their verdicts."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import Any

import pytest

from gui.live.health import board_lines, disk_reading, readings
from gui.protocol.protocol_panel import disk_sentence
from gui.widgets.labels import Level
from rigctl.engine.rpc.messages import parse_status
from tests.gui.fake_engine import STATUS
from tests.gui.steps import Harness, wait_until

SPIKED = {"boards": {"drum": {"loadcell_spikes": 3}}}


def _read(**changes: Any) -> dict[str, Any]:
    return dict(readings(parse_status({**STATUS, **changes})))


@pytest.mark.parametrize(
    ("cell", "changes", "text", "level"),
    [
        ("rate", {}, "1000 Hz", Level.OK),
        ("rate", {"frame_rate_hz": 940.0}, "940 Hz", Level.BAD),
        ("rate", {"taxels_connected": False, "frame_rate_hz": 0.0}, "0 Hz", Level.BAD),
        ("lost", {}, "0", Level.OK),
        ("lost", {"lost_samples": 17, "lost_age_s": 59.0}, "17", Level.BAD),
        ("lost", {"lost_samples": 17, "lost_age_s": 180.0}, "17, 3 min ago", Level.OK),
        ("lost", {"lost_samples": 12_345, "lost_age_s": 0.0}, "12 k", Level.BAD),
        ("lost", {"lost_samples": 17}, "17 earlier", Level.OK),
        ("block", {"last_block_age_s": 0.02}, "20 ms", Level.OK),
        ("block", {"last_block_age_s": 4.0}, "4 s", Level.BAD),
        ("poll", {"poll_age_s": 0.31}, "310 ms", Level.BAD),
        ("poll", {"poll_retries": 3}, "20 ms, 3×", Level.OK),
        ("loadcell", {"loadcell_lost": 1, "loadcell_lost_age_s": 2.0}, "1", Level.BAD),
        ("loadcell", {"boards": {"drum": {"loadcell_spikes": 0}}}, "0", Level.OK),
        ("loadcell", {"boards": {"drum": {"loadcell_spikes": 1}}}, "1 spike", Level.WARN),
        ("loadcell", SPIKED, "3 spikes", Level.WARN),
        ("loadcell", {"loadcell_lost": 2, "loadcell_lost_age_s": 2.0, **SPIKED}, "2", Level.BAD),
        ("disk", {}, "210 GB", Level.OK),
        ("clock", {}, "+1187, −904", Level.OK),
        ("clock", {"clock_ppm": {"drum": None, "taxels": 6000.0}}, "+6000", Level.BAD),
        ("boards", {}, "5.01 V", Level.OK),
        ("boards", {"boards": {}}, "–", Level.OFF),
        ("boards", {"boards": {"taxels": {"supply_v": 4.21}}}, "4.21 V", Level.BAD),
        ("boards", {"boards": {"taxels": {"self_test": ["a", "b"]}}}, "2 findings", Level.BAD),
        ("boards", {"boards": {"drum": {"unwanted": True}}}, "restarted", Level.BAD),
        ("boards", {"boards": {"drum": {"stack_free_percent": 24}}}, "stack 24 %", Level.WARN),
        ("boards", {"boards": {"drum": {"stack_free_percent": 25}}}, "–", Level.OFF),
        ("ticks", {}, "0 late, 25 µs", Level.OK),
        ("ticks", {"boards": {}}, "–", Level.OFF),
        ("ticks", {"boards": {"drum": {"late_ticks": 2}}}, "2 late", Level.WARN),
        ("trial", {}, "–", Level.OFF),
    ],
)
def test_each_figure_has_a_verdict(
    cell: str, changes: dict[str, Any], text: str, level: Level
) -> None:
    assert tuple(_read(**changes)[cell])[:2] == (text, level)


@pytest.mark.parametrize(
    ("age_s", "text"),
    [
        (8.4, "8 s ago"),
        (99.4, "99 s ago"),
        (100.0, "1 min ago"),
        (5999.0, "99 min ago"),
        (6000.0, "1 h ago"),
        (200_000.0, "2 d ago"),
    ],
)
def test_the_last_trial_was_so_long_ago_in_one_unit(age_s: float, text: str) -> None:
    assert _read(run={**STATUS["run"], "trial_age_s": age_s})["trial"].text == text


def test_disk_is_judged_by_the_remaining_time() -> None:
    recording = {**STATUS["recording"], "active": True, "hours_left": 0.4}
    assert _read(recording=recording)["disk"].level is Level.BAD


@pytest.mark.parametrize(
    ("hours", "lasts"),
    [(0.4, "24 min"), (1.9, "1 h"), (47.5, "47 h"), (71.0, "2 d"), (72.0, "3 d")],
)
def test_disk_left_is_the_same_in_the_strip_and_in_the_run(hours: float, lasts: str) -> None:
    """They said 2 d and 1 d 23 h at a time, and the run said it of a recording of before."""
    status = parse_status(
        {"recording": {**STATUS["recording"], "active": True, "hours_left": hours}}
    )
    assert readings(status)["disk"].text == f"210 GB, {lasts}"
    assert disk_sentence(status.recording) == f"210 GB free, enough for {lasts}"
    waits = replace(status.recording, active=False)
    assert (disk_reading(waits).text, disk_sentence(waits)) == ("210 GB", "210 GB free")


def test_bad_is_shown_in_words_and_shape(harness: Harness) -> None:
    harness.update(gaps=1, lost_samples=888, lost_age_s=1.0)
    cell = harness.window.health_strip.cells["lost"]
    assert cell.verdict.text() == "BAD"
    assert cell.lamp.level is Level.BAD
    harness.update(lost_age_s=100.0)
    assert cell.verdict.text() == "OK" and cell.lamp.level is Level.OK
    assert "888 taxel samples are lost, the last of them 1 min ago.\nGaps: 1." in cell.toolTip()
    size = harness.window.size()
    harness.window.resize(1024, 700)
    wait_until(lambda: cell.value.width() < 100)
    harness.update(lost_age_s=101.0)
    assert cell.value.text() == "888 earlier"
    harness.window.resize(size)


def test_late_tick_is_a_warning_in_words_and_shape(harness: Harness) -> None:
    boards = deepcopy(STATUS["boards"])
    boards["taxels"]["late_ticks"] = 3
    harness.update(boards=boards)
    cell = harness.window.health_strip.cells["ticks"]
    assert (cell.value.text(), cell.verdict.text()) == ("3 late, 25 µs", "WARN")
    assert cell.lamp.level is Level.WARN
    assert "taxels: 3 late ticks, longest interrupt 22.56 µs, idle 52.5 %" in cell.toolTip()


def test_missing_fields_have_defaults() -> None:
    status = parse_status({"rig": "virtual"})
    assert status.state is None and status.run.state == "idle"
    with pytest.raises(ValueError, match="Expected `float`, got `str`"):
        parse_status({"force_g": "much"})


def test_tooltip_describes_each_board() -> None:
    text = deepcopy(STATUS["boards"])
    text["taxels"]["self_test"] = ["line D5 stays low: it is connected to ground; free it"]
    lines = board_lines(parse_status({**STATUS, "boards": text}).boards)
    assert lines == [
        "drum: firmware 0.1, boot 4 by power-up",
        "drum: 5386 bytes of stack never used, 66 % of its RAM",
        "taxels: firmware 1.1, boot 7 by its reset pin, supply 5.01 V",
        "taxels: 1344 bytes of stack never used, 66 % of its RAM",
        "line D5 stays low: it is connected to ground; free it",
    ]
