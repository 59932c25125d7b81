"""The page of one report: tables, figures and every input, from the values of ``results.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rigctl.analysis.comparisons import NAME_OF
from rigctl.analysis.report.figure import Figure
from rigctl.analysis.report.findings import findings
from rigctl.analysis.report.html_page import render_page
from rigctl.analysis.report.responses import Responses

Results = Mapping[str, Any]


def html_report(
    results: Results,
    accuracy: Figure,
    confusions: Sequence[Figure],
    responses: Responses,
    fig2c: Path,
    origin: str,
) -> str:
    """Return the page. ``results``: from :func:`rigctl.analysis.result_tables.as_dict`.

    ``fig2c``: the PNG of one taxel. ``origin``: of the trials, in a few words, below the figures.
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
