"""The page of one report: tables, figures and every input, from the values of ``results.json``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rigctl.analysis.comparisons import NAME_OF, Agreement
from rigctl.analysis.report.figure import Figure
from rigctl.analysis.report.html_page import render_page
from rigctl.analysis.report.responses import Responses

Results = Mapping[str, Any]


def html_report(
    results: Results,
    accuracy: Figure,
    confusions: Sequence[Figure],
    responses: Responses,
    fig2c: Path,
    further: Mapping[str, Sequence[Figure]],
    origin: str,
) -> str:
    """Return the page. ``results``: from :func:`rigctl.analysis.result_tables.as_dict`.

    ``fig2c``: the PNG of one taxel. ``further``: figures of each further analysis. ``origin``: of
    the trials, in a few words, below the figures.
    """
    tasks = results["tasks"].values()
    present = {key for task in tasks for key in task["representations"]}
    tests = [found for task in tasks for found in task["differences_from_original"].values()]
    assumptions = [sentence for found in tests for sentence in found["assumptions"]]
    return render_page(
        "report.html",
        results=results,
        accuracy=accuracy,
        confusions=confusions,
        responses=responses,
        fig2c=fig2c,
        further=further,
        origin=origin,
        findings=findings(results),
        keys=[key for key in NAME_OF if key in present],
        compared=[task for task in tasks if task["order"] is not None],
        unconfirmed=unconfirmed([results], [""]),
        ablation_sets=ablation_sets([results]),
        short_titles=[task["figure"] or task["title"] for task in tasks],
        assumptions=list(dict.fromkeys(assumptions)),
        preset_rows=_preset_rows(results["sensitivity"]),
    )


def unconfirmed(sets: Sequence[Results], names: Sequence[str]) -> list[dict[str, Any]]:
    """Return the comparisons that do not hold in every set, each with its results by set name."""
    rows = []
    for key, task in sets[0]["tasks"].items():
        if task["order"] is None:
            continue
        for number, pair in enumerate(task["order"]["compared"]):
            pairs = [one["tasks"][key]["order"]["compared"][number] for one in sets]
            explained = [
                (name, found)
                for name, found in zip(names, pairs, strict=True)
                if found["measured_beside"]
            ]
            if explained:
                rows.append({"task": task, "pair": pair, "sets": explained})
    return rows


def ablation_sets(sets: Sequence[Results]) -> list[Results]:
    """Return the sets whose features were measured by :mod:`rigctl.analysis.comparisons`."""
    return [one for one in sets if one["evidence"] is not None]


def _preset_rows(table: Mapping[str, Any] | None) -> list[dict[str, Any]]:
    """Return a row for each encoder preset and representation; none without such a table."""
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    for line in table["rows"] if table else ():
        preset, key = line["preset"], line["representation"]
        rates_hz = (line["sa_hz"], line["ra_hz"])
        empty = {"preset": preset, "key": key, "rates_hz": rates_hz, "by_task": {}}
        rows.setdefault((preset, key), empty)["by_task"][line["task"]] = line
    return list(rows.values())


_VERDICTS = {
    Agreement.HOLDS: ("holds", "hold"),
    Agreement.TIED: ("cannot be told apart", "cannot be told apart"),
    Agreement.REVERSED: ("does not hold", "do not hold"),
}
"""The words for one difference, and for several."""
LABELLED = ("force", "speed_force")
"""Representations with the C of the true texture."""


def findings(results: Results) -> list[str]:
    """Return sentences from the values of ``results.json``, the most general one first."""
    tasks = list(results["tasks"].values())
    return [_best(tasks), *_blind(tasks), *_mountings(results["mountings"]), _paper(tasks)]


def _accuracy(task: Results, key: str) -> float:
    return float(task["representations"][key]["mean"][task["shown_components"] - 1])


def _best(tasks: list[Any]) -> str:
    """Return the best accuracy in the first task, and in the one where Original is worst."""
    hardest = min(tasks, key=lambda task: _accuracy(task, "original"))
    shown = tasks[:1] if hardest is tasks[0] else [tasks[0], hardest]
    return f"Trials classified right: {'; '.join(map(_best_in_task, shown))}."


def _best_in_task(task: Results) -> str:
    k = task["shown_components"]
    best = max(task["representations"], key=lambda key: _accuracy(task, key))
    name = f"{task['title'].lower()} {_accuracy(task, best):.1%} ({NAME_OF[best]}"
    beside = f"chance {task['chance']:.1%}; {k} component{'s' if k > 1 else ''})"
    if best == "original":
        return f"{name}; {beside}"
    return f"{name}; Original {_accuracy(task, 'original'):.1%}, {beside}"


def _blind(tasks: list[Any]) -> list[str]:
    """Return where most accuracy goes when C does not know the texture."""
    lost = [
        (_accuracy(task, key) - _accuracy(task, f"{key}_blind"), task, key)
        for task in tasks
        for key in LABELLED
        if {key, f"{key}_blind"} <= task["representations"].keys()
    ]
    if not lost:
        return []
    points, task, key = max(lost, key=lambda one: one[0])
    if points <= 0:
        return ["A texture-blind C loses no accuracy in any task."]
    return [
        f"Without the texture's label in C, at most {100 * points:.1f} points are lost "
        f"({task['title'].lower()}, {NAME_OF[key]})."
    ]


def _mountings(gaps: list[Any]) -> list[str]:
    """Return how much of the accuracy of Original is how the plates sat, if that was measured."""
    shown = [gap for gap in gaps if gap["representation"] == "original"]
    if not shown:
        return []
    parts = [
        f"{gap['other_mounting_percent']:.1f}% instead of {gap['same_mounting_percent']:.1f}%"
        f"{' at untrained speeds' if gap['untrained_speed'] else ''}"
        for gap in shown
    ]
    return [f"With plates mounted again, Original reaches {' and '.join(parts)}."]


def _paper(tasks: list[Any]) -> str:
    pairs = [pair for task in tasks if task["order"] for pair in task["order"]["compared"]]
    if not pairs:
        return "The paper has no table for these tasks."
    counts = Counter(pair["verdict"] for pair in pairs)
    verdicts = [
        f"{counts[verdict]} {words[counts[verdict] > 1]}"
        for verdict, words in _VERDICTS.items()
        if counts[verdict]
    ]
    noun = "difference" if len(pairs) == 1 else "differences"
    return (
        f"Of {len(pairs)} {noun} between representations that the paper separates, "
        f"{', '.join(verdicts)}."
    )
