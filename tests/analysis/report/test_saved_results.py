"""``rigctl orders`` reads ``results.json`` of strangers: each is a report, or refused."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rigctl.analysis.comparisons import NAME_OF
from rigctl.cli import main

BETTER, WORSE = list(NAME_OF)[:2]
HALF = {"texture": 0.5, "speed": 0.1, "force": 0.1, "within": 0.3, "mean_by_force": [1.0, 2]}
PAIR = {
    "better": BETTER,
    "worse": WORSE,
    "verdict": "holds",
    "points": 3.5,
    "test": {"p": None, "effect": None},
    "paper_points": 4,
    "measured_beside": ["rates differ"],
}
RESULTS: dict[str, Any] = {
    "simulated": True,
    "inputs": [
        {"path": "day", "plan_hash": "a", "begun_utc": "b", "seed": 1, "simulation_seed": None}
    ],
    "settings": {
        "iterations": 2,
        "k_max": 2,
        "engine": "own",
        "encoder": {"name": "default"},
        "analysis": {"windows": {"length_ms": 100}},
    },
    "trials": {"used": 32},
    "tasks": {
        "textures": {
            "title": "Textures",
            "figure": "Fig. 3",
            "shown_components": 2,
            "paper": {BETTER: [90.0, 1.0], WORSE: [86.0, 0.5]},
            "representations": {
                BETTER: {"mean": [0.5, 0.9], "sd": [0.1, 0.1]},
                WORSE: {"mean": [0.4, 0.8], "sd": None},
            },
            "order": {"compared": [PAIR]},
        }
    },
    "evidence": {
        "draws": 2,
        "halves": {BETTER: {"SA": HALF, "RA": HALF}},
        "alone": {"textures": {BETTER: {"SA": 0.5, "RA": 0.6}}},
    },
}
LENGTH_MS = ("settings", "analysis", "windows", "length_ms")
WRONG = [None, -1, 10**30, "x", [], {}, [[]], {"\x1b": 1}, True, 0.5]


def compare(folder: Path, text: str | bytes) -> int:
    """Return the exit code of ``rigctl orders`` for a report of this text."""
    report = folder / "report"
    report.mkdir(exist_ok=True)
    content = text if isinstance(text, bytes) else text.encode()
    (report / "results.json").write_bytes(content)
    return main(["orders", str(report), "--out", str(folder / "page")])


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every member."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, item in items:
        yield (*path, key)
        if isinstance(item, dict | list):
            yield from places(item, (*path, key))


def changed(path: tuple[Any, ...], wrong: Any) -> str:
    results = copy.deepcopy(RESULTS)
    parent = results
    for key in path[:-1]:
        parent = parent[key]
    parent[path[-1]] = wrong
    return json.dumps(results)


def test_a_report_is_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert compare(tmp_path, json.dumps(RESULTS)) == 0
    assert "of 1 comparisons 1 hold in every set" in capsys.readouterr().out


def report(folder: Path, begun: str, verdict: str, deviation: float) -> str:
    """Write a report whose only pair is 4 points apart in the paper; return its folder."""
    results = copy.deepcopy(RESULTS)
    results["inputs"][0]["begun_utc"] = begun
    results["tasks"]["textures"]["paper"][WORSE] = [86.0, deviation]
    results["tasks"]["textures"]["order"]["compared"][0]["verdict"] = verdict
    folder.mkdir()
    (folder / "results.json").write_text(json.dumps(results), encoding="utf-8")
    return str(folder)


@pytest.mark.parametrize(("deviation", "is_wide"), [(1.7, True), (1.8, False)])
def test_pairs_that_the_paper_separates_widely_are_counted_set_by_set(
    deviation: float, is_wide: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    verdicts = ("holds", "does not hold")
    reports = [report(tmp_path / word, word, word, deviation) for word in verdicts]
    assert main(["orders", *reports, "--out", str(tmp_path / "page")]) == 0
    printed = capsys.readouterr().out
    assert "of 1 comparisons 1, 0 hold" in printed
    assert ("standard deviations of the pair 1, 0 hold" in printed) == is_wide


def test_a_compared_representation_without_a_published_value_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paper = ("tasks", "textures", "paper")
    assert compare(tmp_path, changed(paper, {BETTER: [90.0, 1.0]})) == 2
    assert "tasks.textures.paper has no value of" in capsys.readouterr().err


@pytest.mark.parametrize("path", list(places(RESULTS)), ids=lambda path: ".".join(map(str, path)))
def test_a_member_of_another_type_is_refused_or_harmless(
    path: tuple[Any, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number, wrong in enumerate(WRONG):
        folder = tmp_path / str(number)
        folder.mkdir()
        code = compare(folder, changed(path, wrong))
        errors = capsys.readouterr().err
        assert code in (0, 2)
        assert errors.count("\n") == (1 if code else 0)
        assert (folder / "page").exists() == (code == 0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 100_000, "is not the JSON of a report"),
        ("\x00", "is not the JSON of a report"),
        (b"\xff", "is not the JSON of a report"),
        ('{"evidence": NaN}', "is not the JSON of a report"),
        ("{}", "was made by an older rigctl"),
        ('{"evidence": null}', "missing required field"),
        (b" " * (16 * 1024 * 1024 + 1), "is larger than 16,777,216 bytes"),
    ],
)
def test_what_is_no_report_is_refused(
    text: str | bytes, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert compare(tmp_path, text) == 2
    assert words in capsys.readouterr().err


def test_reports_of_other_constants_are_not_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names, words = ("paper", "short"), [json.dumps(RESULTS), changed(LENGTH_MS, 50)]
    for name, text in zip(names, words, strict=True):
        (tmp_path / name).mkdir()
        (tmp_path / name / "results.json").write_text(text, encoding="utf-8")
    folders = [str(tmp_path / name) for name in names]
    assert main(["orders", *folders, "--out", str(tmp_path / "page")]) == 2
    assert "short was made with other constants of an analysis file" in capsys.readouterr().err
