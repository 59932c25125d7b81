"""Worked example: a task of the analysis is one file, and everything that lists tasks follows."""

from __future__ import annotations

import json
from pathlib import Path

from rigctl.analysis.further_tasks import FURTHER, OFFERED, TASKS
from rigctl.analysis.splits import FAMILIES
from tests.analysis.recordings import record
from tests.architecture.lab_copy import changed_files, copy_program, run_in

EDITS = {
    "rigctl/analysis/further_tasks.py": {
        "FURTHER = (\n": '''def _early_late(
    design: Design, random: np.random.Generator
) -> list[TrainAndTests]:
    """Train on the first half of each condition, and test on the second: do taxels wear?"""
    halves = [np.array_split(rows, 2) for rows in design.conditions()]
    early, late = (np.concatenate(part) for part in zip(*halves, strict=True))
    return [(early, {"early-late": late})]


FURTHER = (
    Family(
        "early-late",
        "Early trials, late trials",
        (Task("early-late", "Early to late", "", "early-late"),),
        _early_late,
    ),
'''
    }
}
OFFER = """
from rigctl.analysis.options import TASKS
print(dict(TASKS)["early-late"])
"""


def test_a_task_is_offered_run_and_reported(tmp_path: Path) -> None:
    session = record(tmp_path / "session", ("A", "B"), repeats=4, speeds=(40,), forces=(500,))
    copy = copy_program(tmp_path, EDITS)
    assert changed_files(copy) == set(EDITS)
    assert run_in(copy, "-c", OFFER) == "Early trials, late trials\n"
    report = tmp_path / "report"
    options = ("--task", "early-late", "--iterations", "2", "--k-max", "2", "--no-cache")
    run_in(copy, "-m", "rigctl", "analyse", str(session), "--out", str(report), *options)
    tasks = json.loads((report / "results.json").read_text(encoding="utf-8"))["tasks"]
    assert list(tasks) == ["early-late"]
    assert "Early to late" in (report / "table1.csv").read_text(encoding="utf-8")
    assert "Early to late" in (report / "report.html").read_text(encoding="utf-8")


def test_every_family_is_offered_once_and_its_draws_stay() -> None:
    names = [name for name, _ in OFFERED]
    assert len(set(names)) == len(names)
    assert {family.name for family in FURTHER} <= set(names)
    assert {task.family for task in TASKS} == set(FAMILIES)
