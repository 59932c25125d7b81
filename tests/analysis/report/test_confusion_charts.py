"""Confusion matrices of the page: which tasks come first, what a cell says, what is too large."""

from __future__ import annotations

from typing import Any

from rigctl.analysis.report.charts.confusion_charts import MAX_CLASSES, confusion_charts


def task(title: str, counts: list[list[int]], classes: list[str]) -> dict[str, Any]:
    """A task with one representation, of which the paper's caption states 36.78 %."""
    paper = {"figure": "Fig. S1", "percent": 36.78}
    return {
        "title": title,
        "classes": classes,
        "shown_components": 5,
        "representations": {
            "original": {"confusion": counts, "c_knows_the_label": False},
            "force_blind": {"confusion": counts, "c_knows_the_label": False},
        },
        "confusion_shares": {"original": {"percent": 75.0, "paper": paper}},
    }


def test_the_papers_task_comes_first_and_a_cell_says_its_trials() -> None:
    counts = [[3, 1], [0, 8]]
    tasks = {name: task(name, counts, ["A", "cord"]) for name in ("textures", "untrained-both")}
    first, second = confusion_charts({"tasks": tasks})
    assert (first.task["title"], second.task["title"]) == ("untrained-both", "textures")
    (panel,) = first.panels
    assert panel.title == "Original: 75.00 %" and panel.paper == "the paper's Fig. S1: 36.78 %"
    assert panel.note == "% of 4–8 trials a row"
    right, wrong, other = panel.cells
    assert (right.title, right.text, right.dark) == ("A: 3 of 4 trials (75.0%)", "75", True)
    assert wrong.title == "A taken for cord: 1 of 4 trials (25.0%)" and not wrong.dark
    assert (other.x, other.y) == (panel.cell, panel.cell)
    assert panel.width >= panel.left + panel.side
    assert not panel.upright and panel.left > 30.0


def test_long_names_are_cut_and_a_class_without_trials_is_empty() -> None:
    long = "a very long name of a texture"
    (chart,) = confusion_charts({"tasks": {"textures": task("T", [[1, 0], [0, 0]], ["A", long])}})
    (panel,) = chart.panels
    assert panel.labels == ["A", "a very long n…"] and len(panel.cells) == 1


def test_a_matrix_of_too_many_classes_stays_an_image() -> None:
    n = MAX_CLASSES + 1
    (chart,) = confusion_charts({"tasks": {"textures": task("T", [[1] * n] * n, ["A"] * n)}})
    assert chart.panels == ()
