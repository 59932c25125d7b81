"""The benchmark goes on to its next group where one fails, and names what failed at its end."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import tests.benchmarks
from tests.benchmarks.__main__ import OUTPUT, main
from tests.benchmarks.encoder import processors

FAILS = """
def measure():
    yield {"name": "first.figure", "value": 1.0}
    raise RuntimeError("the engine did not end")
"""
UNKNOWN = "import no_such_peer"
WORKS = """
def measure():
    yield {"name": "last.figure", "value": 2.0, "limit": LIMIT}
"""


def test_a_group_that_fails_is_named_and_the_next_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    groups = {"a_fails": FAILS, "b_unknown": UNKNOWN, "c_works": WORKS.replace("LIMIT", "3.0")}
    for name, source in {**groups, "d_slow": WORKS.replace("LIMIT", "1.0")}.items():
        (tmp_path / f"{name}.py").write_text(source)
    monkeypatch.setattr(tests.benchmarks, "__path__", [str(tmp_path)])
    monkeypatch.chdir(tmp_path)
    assert main([]) == 1
    said = capsys.readouterr().err.splitlines()
    assert said[-3:] == [
        "a_fails failed: the engine did not end",
        "b_unknown failed: No module named 'no_such_peer'",
        "last.figure is 2.0, its limit 1.0",
    ]
    figures = [json.loads(line)["name"] for line in OUTPUT.read_text().splitlines()]
    assert figures == ["first.figure", "last.figure", "last.figure"]
    assert main(["c_works"]) == 0


def test_what_differs_between_processors_is_counted() -> None:
    first = {"readings": np.array([5, 6, 7, 8]), "trains": np.array([1, 2])}
    other = {"readings": np.array([5, 6, 7, 10]), "trains": np.array([1, 2])}
    readings, trains = processors.differences("same_readings", first, other, 0.0)
    assert readings["name"] == "processors.same_readings.readings_differing"
    assert (readings["value"], readings["largest"], readings["limit"]) == (25.0, 2.0, 0.0)
    assert trains["value"] == 0.0 and "largest" not in trains
