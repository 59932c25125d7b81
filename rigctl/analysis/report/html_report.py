"""The report as one HTML file that needs no other: tables, figures inside, every input named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from rigctl.analysis.paper.comparisons import NAME_OF
from rigctl.analysis.paper.result_tables import LABELS_SEEN
from rigctl.analysis.report.comparison_html import orders_section
from rigctl.analysis.report.html_parts import ABSENT, STYLE, inline
from rigctl.analysis.report.html_parts import sentences as _list
from rigctl.analysis.report.html_parts import table as _table
from rigctl.analysis.report.html_parts import task_name as _task_name

Figures = Mapping[str, Path]


def html_report(plain: Mapping[str, Any], figures: Figures) -> str:
    """The whole page. ``plain``: from :func:`rigctl.analysis.paper.result_tables.as_plain`."""
    tasks = plain["tasks"]
    body = [
        f"<h1>Textures told apart</h1><p class=lead>{_lead(plain)}</p>",
        _simulated(plain),
        f"<h2>Accuracy beside the paper's Table 1</h2>{_table_1(tasks)}",
        f"<h2>Whether the paper's orders hold</h2>{orders_section(plain)}",
        f"<h2>Accuracy over components</h2>{inline(figures['fig3'], 'Accuracy over components')}",
        f"<h2>Components needed</h2>{_needed(tasks)}",
        f"<h2>Differences from Original</h2>{_differences(tasks)}",
        f"<h2>Who is taken for whom</h2>{inline(figures['confusion'], 'Confusion matrices')}",
        f"<h2>Force scaling</h2>{_force(plain['force_matrix'])}",
        *_sensitivity(plain["sensitivity"], tasks),
        f"<h2>One taxel</h2>{inline(figures['fig2c'], 'One taxel, its spikes')}",
        f"<h2>Left out, changed, to be known</h2>{_list(plain['remarks'], 'Nothing.')}",
        f"<h2>Where it comes from</h2>{_provenance(plain)}",
    ]
    title = "Textures told apart"
    return (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{title}</title>"
        '<meta name=viewport content="width=device-width">'
        f"<style>{STYLE}</style><body>{''.join(body)}</body></html>\n"
    )


def _lead(plain: Mapping[str, Any]) -> str:
    trials, settings = plain["trials"], plain["settings"]
    n = len(plain["inputs"])
    return escape(
        f"{trials['used']:,} trials from {n} session{'s' if n > 1 else ''}: "
        f"{len(trials['textures'])} textures × {_numbers(trials['speeds_mm_s'])} mm/s × "
        f"{_numbers(trials['forces_g'])} g. {settings['iterations']} draws, PCA and LDA by "
        f"{'scikit-learn' if settings['engine'] == 'sklearn' else 'the nested sweep'}, encoder "
        f"preset {settings['encoder']['name']}, seed {settings['seed']}."
    )


def _simulated(plain: Mapping[str, Any]) -> str:
    if not plain["simulated"]:
        return ""
    return (
        "<p class=simulated><b>Simulated.</b> These trials come from a simulated bench, not from "
        "a sensor. They show that the method runs; they are not the paper's experiment.</p>"
    )


def _table_1(tasks: Mapping[str, Any]) -> str:
    keys = _keys(tasks)
    head = ["task", *(NAME_OF[key] for key in keys)]
    rows = []
    for task in tasks.values():
        k, theirs = task["shown_components"], task["paper"]
        cells = [_task_name(task, f"{k} components, chance {task['chance']:.1%}")]
        for key in keys:
            curve = task["representations"].get(key)
            cells.append(_accuracy(curve, k, theirs.get(key)))
        rows.append(cells)
    note = "Ours, mean ± standard deviation in %; below, the paper's with 50 components."
    return f"{_table(head, rows)}<small>{note}</small>"


def _accuracy(curve: Mapping[str, Any] | None, k: int, theirs: Sequence[float] | None) -> str:
    if curve is None:
        return ABSENT
    sd = "" if curve["sd"] is None else f" ± {100 * curve['sd'][k - 1]:.2f}"
    paper = f"{theirs[0]:.2f} ± {theirs[1]:.2f}" if theirs else ABSENT
    return f"{100 * curve['mean'][k - 1]:.2f}{sd}<br><span class=paper>{paper}</span>"


def _needed(tasks: Mapping[str, Any]) -> str:
    head = ["task", "representation", "80 %", "90 %", "95 %", "as Original"]
    rows = []
    for task in tasks.values():
        for number, (key, needed) in enumerate(task["components_needed"].items()):
            cells = [ABSENT if k is None else str(k) for k in needed.values()]
            rows.append(["" if number else _task_name(task, ""), NAME_OF[key], *cells])
    note = (
        "Fewest components with which the mean accuracy is reached; "
        f"{ABSENT}: never. As Original: the accuracy of Original with the components of the first "
        "table."
    )
    return f"{_table(head, rows, named=True)}<small>{note}</small>"


def _differences(tasks: Mapping[str, Any]) -> str:
    head = ["task", "representation", "Welch t", "p", "Cohen's d", ""]
    rows, said = [], {}
    for task in tasks.values():
        for number, (key, found) in enumerate(task["differences_from_original"].items()):
            name = "" if number else _task_name(task, "")
            values = [_number(found[part]) for part in ("statistic", "p", "effect")]
            rows.append([name, NAME_OF[key], *values, found["stars"]])
            said.update(dict.fromkeys(found["assumptions"]))
    note = "* p &lt; 0.05 and d &gt; 0.5; ** p &lt; 0.01 and d &gt; 1 (the paper's rule)."
    return f"{_table(head, rows, named=True)}<small>{note}</small>{_list(list(said), '')}"


def _force(force: Mapping[str, Any] | None) -> str:
    if force is None:
        return "<p>Force was not scaled; the remarks below say why.</p>"
    took = f" A search took {force['mean_evaluations']:.1f} encodings on average."
    return (
        f"<p>{escape(force['sentence'])}.{'' if force['from_file'] else took}</p>"
        f"<p class=seen><b>What C has seen.</b> {escape(LABELS_SEEN)}</p>"
    )


def _sensitivity(table: Mapping[str, Any] | None, tasks: Mapping[str, Any]) -> list[str]:
    """Rates and accuracies by encoder preset, a row a representation; nothing if not asked for."""
    if table is None:
        return []
    by_row: dict[tuple[str, str], dict[str, Any]] = {}
    for line in table["rows"]:
        by_row.setdefault((line["preset"], line["representation"]), {})[line["task"]] = line
    rows, before = [], ""
    for (preset, key), lines in by_row.items():
        one = next(iter(lines.values()))
        cells = [f"{one['sa_hz']:.1f}", f"{one['ra_hz']:.1f}"]
        cells += [_percent(lines.get(task)) for task in tasks]
        rows.append(["" if preset == before else preset, NAME_OF[key], *cells])
        before = preset
    head = ["preset", "representation", "SA Hz", "RA Hz"]
    # Ten columns have to stand on a page, so a task is named by its figure where it has one.
    head += [escape(task["figure"] or task["title"]) for task in tasks.values()]
    note = (
        f"Mean rates over trials and taxels; accuracy with {table['components']} components (fewer "
        "where the trials allow fewer), mean ± standard deviation in %, over the same draws."
    )
    shown = f"<div class=dense>{_table(head, rows, named=True)}</div>"
    return [f"<h2>Encoder presets</h2>{shown}<small>{note}</small>"]


def _percent(line: Mapping[str, Any] | None) -> str:
    if line is None:
        return ABSENT
    sd = "" if line["sd_percent"] is None else f" ± {line['sd_percent']:.1f}"
    return f"{line['mean_percent']:.1f}{sd}"


def _provenance(plain: Mapping[str, Any]) -> str:
    keys = (
        ("path", "session"), ("simulated", "simulated"), ("rig", "rig"), ("begun_utc", "begun"),
        ("protocol", "protocol"), ("plan_hash", "plan"), ("seed", "seed"),
        ("simulation_seed", "seed of the bench"), ("software", "software"),
        ("firmware", "firmware"), ("trials_committed", "trials"), ("closed", "closed"),
    )  # fmt: skip
    rows = [[words, *(_value(source[key]) for source in plain["inputs"])] for key, words in keys]
    encoder = ", ".join(f"{k} {v}" for k, v in plain["settings"]["encoder"].items())
    made = f"rigctl {plain['program']['version']}, {plain['made_utc']}"
    return (
        f"<div class=wide>{_table(['', *('' for _ in plain['inputs'])], rows, words=True)}</div>"
        f"<p><small>Report by {escape(made)}. Encoder: {escape(encoder)}. Every number is in "
        "results.json beside this page.</small></p>"
    )


def _keys(tasks: Mapping[str, Any]) -> list[str]:
    there = {key for task in tasks.values() for key in task["representations"]}
    return [key for key in NAME_OF if key in there]


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return escape("; ".join(f"{k} {v}" for k, v in value.items())) or ABSENT
    if isinstance(value, bool):
        return "yes" if value else "no"
    return escape(str(value)) if value not in (None, "") else ABSENT


def _number(value: float | None) -> str:
    if value is None:
        return ABSENT
    return f"{value:.2g}" if abs(value) < 0.01 else f"{value:.2f}"


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)
