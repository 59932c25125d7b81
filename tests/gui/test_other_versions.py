"""What an engine of another version may send: one sentence, and never a traceback."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import pytest

from tests.gui.fake_engine import STATUS
from tests.gui.fake_finger import STATUS as FINGER_STATUS
from tests.gui.steps import FingerWindow, Harness

STRANGE: tuple[Any, ...] = ("x", "", -1, 1.5, 1e300, 10**15, -(10**15), [], [1], {}, {"a": 1}, True)
MISSING = object()


@pytest.fixture
def errors(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """Yield what reaches the hook for exceptions, which slots do, too."""
    found: list[str] = []

    def keep(kind: type[BaseException], error: BaseException, trace: Any) -> None:
        while trace.tb_next is not None:
            trace = trace.tb_next
        place = f"{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}"
        found.append(f"{kind.__name__}: {error} in {place}")

    monkeypatch.setattr(sys, "excepthook", keep)
    yield found


def places(data: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the path of each value in a message."""
    for name, value in data.items():
        yield (*path, name)
        if isinstance(value, dict):
            yield from places(value, (*path, name))


def changed(data: dict[str, Any], path: tuple[str, ...], value: object) -> dict[str, Any]:
    """Return a copy with another value at a path, or without it."""
    copy = deepcopy(data)
    inner = copy
    for name in path[:-1]:
        inner = inner[name]
    if value is MISSING:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return copy


def tried(window: Any, engine: Any, status: dict[str, Any]) -> None:
    """Let a window get a strange value in each place of a status, one after another."""
    for path in places(status):
        for value in (*STRANGE, None, MISSING):
            data = changed(status, path, value)
            engine._messages.append({"event": "status", "at_s": 1.0, "text": "", "data": data})
            window.poll()


def test_a_status_with_strange_values(harness: Harness, errors: list[str]) -> None:
    tried(harness.window, harness.engine, STATUS)
    assert not errors, "\n".join(errors)


def test_a_status_of_the_finger_with_strange_values(
    finger: FingerWindow, errors: list[str]
) -> None:
    tried(finger.window, finger.engine, FINGER_STATUS)
    assert not errors, "\n".join(errors)


EVENTS = ("control", "trial", "batch", "prediction", "instruction", "stage", "prompt", "pause")
EVENTS += ("fault", "state", "board", "clock", "run", "note", "left_out", "calibration", "novel")
KEYS = ("clients", "holder", "asking", "trial_id", "texture", "verdict", "reasons", "scan")
KEYS += ("scaled_s", "distance_mm", "velocity_mm_s", "profile", "state", "digest", "sent_s")
COMMANDS = ("introduce", "history", "jog", "set", "record", "end_record", "calibrate_range")
COMMANDS += ("test_taxels", "calibrate_loadcell", "calibrate_force", "plate", "inject", "start")


def strange_events(window: Any, engine: Any) -> None:
    """Let a window get each event, and the reply to each command, with strange contents."""
    contents = [None, 5, "x", [], *(dict.fromkeys(KEYS, value) for value in STRANGE)]
    for data in contents:
        for kind in EVENTS:
            engine._messages.append({"event": kind, "at_s": "x", "text": 5, "data": data})
        engine._messages.append({"event": "control"})
        window.poll()


def strange_replies(window: Any, engine: Any, link: Any) -> None:
    """Let a window get the reply to each command with strange contents."""
    engine.replies, engine.welcome = False, {}
    for result in (None, {}, {"client": "x", "control": 5, "events": [5]}, {"events": "x"}):
        for command in COMMANDS:
            link.request(command)
            engine._messages.append({"reply": engine._number, "ok": True, "result": result})
        window.poll()


def test_events_and_replies_with_strange_contents(harness: Harness, errors: list[str]) -> None:
    strange_events(harness.window, harness.engine)
    strange_replies(harness.window, harness.engine, harness.window.engine_link)
    assert not errors, "\n".join(errors)


def test_events_of_the_finger_with_strange_contents(
    finger: FingerWindow, errors: list[str]
) -> None:
    strange_events(finger.window, finger.engine)
    strange_replies(finger.window, finger.engine, finger.tab.link)
    assert not errors, "\n".join(errors)


def test_the_log_says_once_that_a_status_is_of_another_version(harness: Harness) -> None:
    window = harness.window
    for _ in range(3):
        harness.update(force_g="much")
    text = window.event_log.toPlainText()
    assert text.count("the engine's status (force_g: Expected `float`, got `str`) cannot be") == 1
    assert "use the same version of rigctl for window and engine" in text
    harness.update(force_g=1.0, state=99, fault=99)
    assert window.engine_link.status.state is None
    assert window.toolbar.state_words.text() == "fault 99"
    harness.update(fault=0)
