"""Whether Table 1's orders stand, in one analysis or in several, as pieces of an HTML page.

``sets`` are what several ``results.json`` hold; a cell then has one value a set.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from rigctl.analysis.paper.comparisons import NAME_OF
from rigctl.analysis.report.html_parts import ABSENT, table, task_name

NOT_THE_SAME = (
    "A difference counts where it is larger than two standard deviations of the pair; where both "
    "lie closer the two cannot be told apart, which is not the contrary. It is not the same "
    "experiment: other plates, another sensor, another bench."
)
MEASURED = (
    "What stands beside a pair was measured on the same trials. It shows where the difference "
    "could have come from; it does not prove a cause."
)

LINES = "<br>"
"""Between the values of several sets in one cell: side by side they would leave the page."""

Sets = Sequence[Mapping[str, Any]]


def orders_section(plain: Mapping[str, Any]) -> str:
    """The section of one report: verdicts, what was measured beside them, and its tables."""
    tasks = [task for task in plain["tasks"].values() if task["order"] is not None]
    if not tasks:
        return "<p>The paper has no table for the tasks that this set allows.</p>"
    rows = []
    for task in tasks:
        found = task["order"]
        other = escape("; ".join(found["reasons"])) or ABSENT
        rows.append([task_name(task, ""), escape(found["sentence"]), other])
    head = ["task", "the paper's differences between two representations", "what is different here"]
    verdicts = f"{table(head, rows, words=True)}<small>{NOT_THE_SAME}</small>"
    return verdicts + beside_section([plain], [""]) + evidence_section([plain])


def beside_section(sets: Sets, names: Sequence[str]) -> str:
    """What was measured beside each pair that does not hold somewhere, set by set."""
    rows = []
    for key, task in sets[0]["tasks"].items():
        if task["order"] is None:
            continue
        for number in range(len(task["order"]["compared"])):
            pairs = [one["tasks"][key]["order"]["compared"][number] for one in sets]
            if any(pair["measured_beside"] for pair in pairs):
                pair = f"{NAME_OF[pairs[0]['better']]} over {NAME_OF[pairs[0]['worse']]}"
                rows.append([task_name(task, ""), pair, _beside(pairs, names)])
    if not rows:
        return ""
    head = ["task", "the paper's order", "measured beside it"]
    return (
        f"<h3>Where it does not hold</h3>{table(head, rows, words=True)}<small>{MEASURED}</small>"
    )


def _beside(pairs: Sequence[Mapping[str, Any]], names: Sequence[str]) -> str:
    told = []
    for pair, name in zip(pairs, names, strict=True):
        if pair["measured_beside"]:
            where = f"<b>{escape(name)}</b>: " if name else ""
            beside = escape("; ".join(pair["measured_beside"]))
            told.append(f"{where}<i>{pair['verdict']}</i>. {beside}.")
    return "<br>".join(told)


def evidence_section(sets: Sets) -> str:
    """Variance of features by what explains it, and accuracies from SA or RA alone."""
    sets = [one for one in sets if one["evidence"] is not None]
    if not sets:
        return ""
    n = sets[0]["evidence"]["draws"]
    each = " Each line is a set, in the order above." if len(sets) > 1 else ""
    return (
        f"<h3>What explains the features</h3>{_halves(sets)}"
        "<small>Share of the variance between trials that one factor explains alone, and that "
        "inside conditions; means over windows and taxels by force, ascending. C acts on SA only."
        f"{each}</small><h3>SA rates and RA counts alone</h3>{_alone(sets)}"
        f"<small>Accuracy in % from one half of the features, mean of {n} draws.{each}</small>"
    )


def _halves(sets: Sets) -> str:
    head = ["representation", "", "texture", "speed", "force", "within", "mean by force"]
    rows = []
    for key in sets[0]["evidence"]["halves"]:
        for number, name in enumerate(("SA", "RA")):
            halves = [one["evidence"]["halves"][key][name] for one in sets]
            shares = [
                LINES.join(f"{100 * half[part]:.1f} %" for half in halves)
                for part in ("texture", "speed", "force", "within")
            ]
            means = LINES.join(
                ", ".join(f"{mean:.3g}" for mean in half["mean_by_force"]) for half in halves
            )
            unit = "SA, Hz" if name == "SA" else "RA, a window"
            rows.append(["" if number else NAME_OF[key], unit, *shares, means])
    return table(head, rows, named=True)


def _alone(sets: Sets) -> str:
    alone = [one["evidence"]["alone"] for one in sets]
    keys = list(sets[0]["evidence"]["halves"])
    rows = []
    for task in alone[0]:
        for number, half in enumerate(("SA", "RA")):
            name = "" if number else task_name(sets[0]["tasks"][task], "")
            cells = [LINES.join(f"{100 * a[task][key][half]:.1f}" for a in alone) for key in keys]
            rows.append([name, half, *cells])
    return table(["task", "", *(NAME_OF[key] for key in keys)], rows, named=True)
