"""Table 1's orders over several reports: one page that says in how many of them each stands."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.analysis.data.atomic_directory import atomic_directory
from rigctl.analysis.paper.comparisons import NAME_OF, Agreement
from rigctl.analysis.report.comparison_html import (
    NOT_THE_SAME,
    Sets,
    beside_section,
    evidence_section,
)
from rigctl.analysis.report.html_parts import ABSENT, STYLE, table, task_name
from rigctl.errors import WrongUse

RESULTS = "results.json"
SAME = ("iterations", "k_max", "engine", "encoder")


def read_reports(folders: Sequence[Path]) -> list[dict[str, Any]]:
    """What their ``results.json`` hold. Raises WrongUse where they cannot stand side by side."""
    sets = [_read(folder) for folder in folders]
    for folder, one in zip(folders[1:], sets[1:], strict=True):
        for what in SAME:
            if one["settings"][what] != sets[0]["settings"][what]:
                raise WrongUse(
                    f"{folder} was made with another {what} than {folders[0]}: analyse both alike"
                )
        if _questions(one) != _questions(sets[0]):
            raise WrongUse(
                f"{folder} has other tasks or representations than {folders[0]}: "
                "analyse sets of one protocol"
            )
    _all_different(folders, sets)
    return sets


def _read(folder: Path) -> dict[str, Any]:
    path = folder / RESULTS
    try:
        plain: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise WrongUse(f"{path} cannot be read ({error}): name folders of rigctl analyse") from None
    if "evidence" not in plain:
        raise WrongUse(f"{folder} was made by an older rigctl: analyse its sessions again")
    if not any(task["order"] for task in plain["tasks"].values()):
        raise WrongUse(f"{folder} has none of the tasks of the paper's Table 1")
    return plain


def _questions(one: Mapping[str, Any]) -> list[Any]:
    return [
        (key, list(task["representations"]), [_keys(p) for p in _compared(task)])
        for key, task in one["tasks"].items()
    ]


def _all_different(folders: Sequence[Path], sets: Sets) -> None:
    """Trials that stand in two sets would be counted as two confirmations."""
    seen: dict[tuple[Any, ...], Path] = {}
    for folder, one in zip(folders, sets, strict=True):
        for source in one["inputs"]:
            identity = tuple(
                source[key] for key in ("plan_hash", "begun_utc", "seed", "simulation_seed")
            )
            if identity in seen:
                raise WrongUse(f"{folder} and {seen[identity]} hold the same session: drop one")
            seen[identity] = folder


def summary(sets: Sets) -> dict[str, Any]:
    """By task: accuracies beside the paper's, and for each of its differences where it stands.

    ``points``: our differences in percentage points, a set each; ``over_sets``: their mean and
    standard deviation, None for a single set.
    """
    return {
        key: {
            "title": task["title"],
            "figure": task["figure"],
            "accuracy": _accuracies(key, sets),
            "pairs": [_stands(key, n, sets) for n in range(len(_compared(task)))],
        }
        for key, task in sets[0]["tasks"].items()
        if task["order"] is not None
    }


def _accuracies(key: str, sets: Sets) -> dict[str, Any]:
    task = sets[0]["tasks"][key]
    return {
        name: {
            "paper": task["paper"].get(name),
            "sets": [_shown(one["tasks"][key], name) for one in sets],
        }
        for name in task["representations"]
    }


def _shown(task: Mapping[str, Any], name: str) -> list[float | None]:
    """μ and σ in per cent."""
    curve, k = task["representations"][name], task["shown_components"] - 1
    sd = None if curve["sd"] is None else round(100 * curve["sd"][k], 2)
    return [round(100 * curve["mean"][k], 2), sd]


def _stands(key: str, number: int, sets: Sets) -> dict[str, Any]:
    pairs = [_compared(one["tasks"][key])[number] for one in sets]
    points = [float(pair["points"]) for pair in pairs]
    over = None
    if len(points) > 1:
        over = [round(float(np.mean(points)), 2), round(float(np.std(points, ddof=1)), 2)]
    return {
        "better": pairs[0]["better"],
        "worse": pairs[0]["worse"],
        "paper_points": pairs[0]["paper_points"],
        "points": points,
        "spread_points": [pair["spread_points"] for pair in pairs],
        "verdicts": [pair["verdict"] for pair in pairs],
        "over_sets": over,
    }


def _compared(task: Mapping[str, Any]) -> list[dict[str, Any]]:
    return list(task["order"]["compared"]) if task["order"] else []


def _keys(pair: Mapping[str, Any]) -> tuple[str, str]:
    return pair["better"], pair["worse"]


def sentences(found: Mapping[str, Any]) -> list[str]:
    """One sentence a task: how many of its orders stand in every set, in some, in none."""
    said = []
    for task in found.values():
        n = len(task["pairs"])
        if not n:
            said.append(f"{task['title']}: the paper's own spreads separate no pair")
            continue
        kinds = Counter(_kind(pair["verdicts"]) for pair in task["pairs"])
        told = ", ".join(f"{kinds[kind]} {kind}" for kind in KINDS if kinds[kind])
        said.append(f"{task['title']}: of {n} orders {told}")
    return said


KINDS = (
    "hold in every set",
    "hold in some",
    "cannot be told apart in any",
    "do not hold in some and cannot be told apart in others",
    "hold in none",
)


def _kind(verdicts: Sequence[str]) -> str:
    kinds = set(verdicts)
    if kinds == {Agreement.HOLDS}:
        return KINDS[0]
    if Agreement.HOLDS in kinds:
        return KINDS[1]
    if kinds == {Agreement.TIED}:
        return KINDS[2]
    return KINDS[3] if Agreement.TIED in kinds else KINDS[4]


def write_orders(folders: Sequence[Path], out: Path, made: str) -> dict[str, Any]:
    """The page ``orders.html`` and ``orders.json`` in the new folder ``out``; the summary."""
    sets = read_reports(folders)
    names = [folder.name for folder in folders]
    found = summary(sets)
    plain = {"made": made, "sets": list(map(_described, folders, sets)), "tasks": found}
    page, text = _page(found, sets, names, made), json.dumps(plain, indent=1, allow_nan=False)
    with atomic_directory(out) as folder:
        (folder / "orders.json").write_text(text + "\n", encoding="utf-8")
        (folder / "orders.html").write_text(page, encoding="utf-8")
    return found


def _described(folder: Path, one: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "report": str(folder),
        "trials": one["trials"]["used"],
        "simulated": one["simulated"],
        "inputs": one["inputs"],
        "settings": one["settings"],
    }


def _page(found: Mapping[str, Any], sets: Sets, names: Sequence[str], made: str) -> str:
    body = [
        f"<h1>Whether the paper's orders stand</h1><p class=lead>{_lead(sets, names)}</p>",
        _simulated(sets),
        f"<ul>{''.join(f'<li>{escape(s)}</li>' for s in sentences(found))}</ul>",
        f"<h2>Accuracy beside the paper's Table 1</h2>{_accuracy_table(found, names)}",
        f"<h2>The paper's orders, set by set</h2>{_pair_table(found, names)}",
        f"<small>{NOT_THE_SAME}</small>{beside_section(sets, names)}{evidence_section(sets)}",
        f"<p><small>{escape(made)}. Every number is in orders.json beside this page.</small></p>",
    ]
    return (
        "<!doctype html><html lang=en><meta charset=utf-8><title>Orders of Table 1</title>"
        '<meta name=viewport content="width=device-width">'
        f"<style>{STYLE}</style><body>{''.join(body)}</body></html>\n"
    )


def _lead(sets: Sets, names: Sequence[str]) -> str:
    told = ", ".join(
        f"{name} ({one['trials']['used']:,} trials)" for name, one in zip(names, sets, strict=True)
    )
    return escape(f"{len(sets)} sets: {told}. {sets[0]['settings']['iterations']} draws each.")


def _simulated(sets: Sets) -> str:
    if not any(one["simulated"] for one in sets):
        return ""
    return (
        "<p class=simulated><b>Simulated.</b> Trials come from a simulated bench, not from a "
        "sensor. They are not the paper's experiment, and what stands here says nothing about "
        "whether its results hold.</p>"
    )


def _accuracy_table(found: Mapping[str, Any], names: Sequence[str]) -> str:
    rows = []
    for task in found.values():
        for number, (key, both) in enumerate(task["accuracy"].items()):
            cells = [_mean(values) for values in (both["paper"], *both["sets"])]
            rows.append(["" if number else task_name(task, ""), NAME_OF[key], *cells])
    return table(["task", "representation", "the paper", *names], rows, named=True)


def _mean(values: Sequence[float | None] | None) -> str:
    if values is None:
        return ABSENT
    mean, sd = values
    return f"{mean:.2f}" if sd is None else f"{mean:.2f} ± {sd:.2f}"


def _pair_table(found: Mapping[str, Any], names: Sequence[str]) -> str:
    rows = []
    for task in found.values():
        for number, pair in enumerate(task["pairs"]):
            order = f"{NAME_OF[pair['better']]} over {NAME_OF[pair['worse']]}"
            ours = [
                f"{points:+.2f} (± {ABSENT if spread is None else f'{spread:.2f}'})<br>"
                f"<span class=paper>{verdict}</span>"
                for points, spread, verdict in zip(
                    pair["points"], pair["spread_points"], pair["verdicts"], strict=True
                )
            ]
            over = pair["over_sets"]
            mean = ABSENT if over is None else f"{over[0]:+.2f} ± {over[1]:.2f}"
            theirs = f"{pair['paper_points']:+.2f}"
            rows.append(["" if number else task_name(task, ""), order, theirs, *ours, mean])
    head = ["task", "the paper's order", "the paper", *names, "over sets"]
    note = "Differences in percentage points; behind ±, two standard deviations of the pair."
    return f"<div class=dense>{table(head, rows, named=True)}</div><p><small>{note}</small></p>"
