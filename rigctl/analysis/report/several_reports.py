"""Table 1's comparisons over several reports: one page that says in how many sets each holds."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypedDict

import msgspec
import numpy as np

from rigctl.analysis.comparisons import NAME_OF, Agreement
from rigctl.analysis.files import atomic_directory
from rigctl.analysis.report.html_page import render_page
from rigctl.analysis.report.html_report import Results, ablation_sets, unconfirmed
from rigctl.config.text_file import read_bytes
from rigctl.errors import WrongUse

RESULTS = "results.json"
MAX_BYTES = 16 * 1024 * 1024
"""Of the sixteen textures of the paper with 50 components and 20 draws: 0.2 MB."""

Count = Annotated[int, msgspec.Meta(ge=1, le=1_000_000_000)]
Numbers = list[float]


class _Test(TypedDict):
    p: float | None
    effect: float | None


class _Pair(TypedDict):
    better: str
    worse: str
    verdict: str
    points: float
    test: _Test
    paper_points: float
    measured_beside: list[str]


class _Order(TypedDict):
    compared: list[_Pair]


class _Curve(TypedDict):
    mean: Numbers
    sd: Numbers | None


class _Task(TypedDict):
    title: str
    figure: str
    shown_components: Count
    paper: dict[str, tuple[float, float]]
    representations: dict[str, _Curve]
    order: _Order | None


class _Half(TypedDict):
    texture: float
    speed: float
    force: float
    within: float
    mean_by_force: Numbers


class _Halves(TypedDict):
    SA: _Half
    RA: _Half


class _Alone(TypedDict):
    SA: float
    RA: float


class _Evidence(TypedDict):
    draws: Count
    halves: dict[str, _Halves]
    alone: dict[str, dict[str, _Alone]]


class _Settings(TypedDict):
    iterations: Count
    k_max: Count
    engine: str
    encoder: dict[str, str | int | float | bool]
    analysis: dict[str, dict[str, Any]]


class _Input(TypedDict):
    path: str
    plan_hash: str
    begun_utc: str
    seed: int
    simulation_seed: int | None


class _Trials(TypedDict):
    used: Count


class SavedResults(TypedDict):
    """The members of ``results.json`` that other pages read."""

    simulated: bool
    inputs: list[_Input]
    settings: _Settings
    trials: _Trials
    tasks: dict[str, _Task]
    evidence: _Evidence | None


def load_results(folder: Path) -> dict[str, Any]:
    """Return the results of a report's folder. Raises WrongUse with the member that is wrong."""
    path = folder / RESULTS
    remedy = "name folders of rigctl analyse"
    text = read_bytes(path, MAX_BYTES)
    try:
        results = msgspec.json.decode(text, type=dict[str, Any])
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise WrongUse(f"{path} is not the JSON of a report ({error}): {remedy}") from None
    settings = results.get("settings")
    older = isinstance(settings, dict) and "analysis" not in settings
    if "evidence" not in results or older:
        raise WrongUse(f"{folder} was made by an older rigctl: analyse its sessions again")
    try:
        msgspec.convert(results, type=SavedResults)
    except msgspec.ValidationError as error:
        raise WrongUse(f"{path}: {error}: {remedy}") from None
    if problem := next(_inconsistencies(results), None):
        raise WrongUse(f"{path}: {problem}: {remedy}")
    return results


def _inconsistencies(results: dict[str, Any]) -> Iterator[str]:
    """Yield what no report has: unknown names, and fewer accuracies than components."""
    for key, task in results["tasks"].items():
        named = {*task["representations"], *task["paper"]}
        pairs = task["order"]["compared"] if task["order"] else []
        compared = {pair[end] for pair in pairs for end in ("better", "worse")}
        if unpublished := compared - task["paper"].keys():
            yield f"tasks.{key}.paper has no value of {min(unpublished)!r}, which is compared"
        named |= compared
        if unknown := named - NAME_OF.keys():
            yield f"tasks.{key}: there is no representation {min(unknown)!r}"
        for name, curve in task["representations"].items():
            lengths = {len(values) for values in (curve["mean"], curve["sd"]) if values is not None}
            if min(lengths) < task["shown_components"]:
                yield f"tasks.{key}.representations.{name} has fewer values than components"
    yield from _unknown_evidence(results)


def _unknown_evidence(results: dict[str, Any]) -> Iterator[str]:
    evidence = results["evidence"] or {"halves": {}, "alone": {}}
    if unknown := evidence["halves"].keys() - NAME_OF.keys():
        yield f"evidence.halves: there is no representation {min(unknown)!r}"
    for task, by_name in evidence["alone"].items():
        if task not in results["tasks"] or by_name.keys() != evidence["halves"].keys():
            yield f"evidence.alone.{task} has other tasks or representations than the rest"


EQUAL_SETTINGS = ("iterations", "k_max", "engine", "encoder")
NOT_OF_REPORTS = ("draws", "finger", "further", "stimulation")
"""Constants that change nothing of a report of the drum but its draws."""
WIDE_SDS = 2
IDENTITY = ("plan_hash", "begun_utc", "seed", "simulation_seed")
OUTCOMES = (
    "hold in every set",
    "hold in some",
    "cannot be told apart in any",
    "do not hold in some and cannot be told apart in others",
    "hold in none",
)

Sets = Sequence[Results]


def write_comparisons(folders: Sequence[Path], out: Path, made: str) -> dict[str, Any]:
    """Write ``orders.html`` and ``orders.json`` to the new folder ``out``; return the summary."""
    sets = load_reports(folders)
    names = [folder.name for folder in folders]
    tasks = compare_sets(sets)
    described = [_describe(folder, one) for folder, one in zip(folders, sets, strict=True)]
    values = {"made": made, "sets": described, "tasks": tasks}
    page = render_page(
        "orders.html",
        made=made,
        sets=sets,
        set_names=names,
        tasks=tasks,
        sentences=[*summary_sentences(tasks), *missing_sentences(sets)],
        unconfirmed=unconfirmed(sets, names),
        ablation_sets=ablation_sets(sets),
    )
    text = json.dumps(values, indent=1, allow_nan=False)
    with atomic_directory(out) as folder:
        (folder / "orders.json").write_text(text + "\n", encoding="utf-8")
        (folder / "orders.html").write_text(page, encoding="utf-8")
    return tasks


def load_reports(folders: Sequence[Path]) -> list[dict[str, Any]]:
    """Return the contents of each ``results.json``. Raises WrongUse for sets that do not match."""
    sets = [_load(folder) for folder in folders]
    for folder, one in zip(folders[1:], sets[1:], strict=True):
        for name in EQUAL_SETTINGS:
            if one["settings"][name] != sets[0]["settings"][name]:
                raise WrongUse(
                    f"{folder} was made with another {name} than {folders[0]}: "
                    "analyse both with the same settings"
                )
        if _constants(one) != _constants(sets[0]):
            raise WrongUse(
                f"{folder} was made with other constants of an analysis file than {folders[0]} "
                "(analysis.toml in each): analyse both with the same file"
            )
        if _contents(one) != _contents(sets[0]):
            raise WrongUse(
                f"{folder} has other tasks or representations than {folders[0]}: "
                "analyse sets of one protocol"
            )
    _check_distinct(folders, sets)
    return sets


def _constants(one: dict[str, Any]) -> dict[str, Any]:
    """Return the constants that determine a report of the drum, but for the number of draws."""
    return {k: v for k, v in one["settings"]["analysis"].items() if k not in NOT_OF_REPORTS}


def _load(folder: Path) -> dict[str, Any]:
    results = load_results(folder)
    if not any(task["order"] for task in results["tasks"].values()):
        raise WrongUse(f"{folder} has none of the tasks of the paper's Table 1")
    return results


def _contents(one: Results) -> list[Any]:
    """Return the tasks of a set with their representations and pairs, and its evidence."""
    tasks = [
        (
            key,
            list(task["representations"]),
            [(pair["better"], pair["worse"]) for pair in _pairs(task)],
        )
        for key, task in one["tasks"].items()
    ]
    return [*tasks, *map(sorted, _measured(one))]


def _measured(one: Results) -> tuple[Sequence[str], Sequence[str]]:
    """Return the representations and tasks that the evidence of a set has."""
    evidence = one["evidence"] or {"halves": (), "alone": ()}
    return list(evidence["halves"]), list(evidence["alone"])


def _check_distinct(folders: Sequence[Path], sets: Sets) -> None:
    """Raise WrongUse for a session in two sets: it would count as two confirmations."""
    folder_of: dict[tuple[Any, ...], Path] = {}
    for folder, one in zip(folders, sets, strict=True):
        for source in one["inputs"]:
            identity = tuple(source[key] for key in IDENTITY)
            if identity in folder_of:
                raise WrongUse(
                    f"{folder} and {folder_of[identity]} hold the same session: drop one"
                )
            folder_of[identity] = folder


def compare_sets(sets: Sets) -> dict[str, Any]:
    """Return, by task, accuracies beside the paper's and each of its comparisons in every set.

    ``points``: our differences in percentage points, one a set; ``over_sets``: their mean and
    standard deviation, None for a single set. ``wide``: the paper's means are further apart than
    :data:`WIDE_SDS` of its standard deviations of the pair.
    """
    return {
        key: {
            "title": task["title"],
            "figure": task["figure"],
            "accuracy": _accuracies(key, sets),
            "pairs": [_compare_pair(key, n, sets) for n in range(len(_pairs(task)))],
        }
        for key, task in sets[0]["tasks"].items()
        if task["order"] is not None
    }


def _accuracies(key: str, sets: Sets) -> dict[str, Any]:
    task = sets[0]["tasks"][key]
    return {
        name: {
            "paper": task["paper"].get(name),
            "sets": [_mean_and_sd(one["tasks"][key], name) for one in sets],
        }
        for name in task["representations"]
    }


def _mean_and_sd(task: Results, name: str) -> list[float | None]:
    """Return μ and σ in per cent with the shown components."""
    curve, k = task["representations"][name], task["shown_components"] - 1
    sd = None if curve["sd"] is None else round(100 * curve["sd"][k], 2)
    return [round(100 * curve["mean"][k], 2), sd]


def _compare_pair(key: str, number: int, sets: Sets) -> dict[str, Any]:
    pairs = [_pairs(one["tasks"][key])[number] for one in sets]
    points = [float(pair["points"]) for pair in pairs]
    over_sets = None
    if len(points) > 1:
        over_sets = [round(float(np.mean(points)), 2), round(float(np.std(points, ddof=1)), 2)]
    return {
        "better": pairs[0]["better"],
        "worse": pairs[0]["worse"],
        "paper_points": pairs[0]["paper_points"],
        "wide": _is_wide(sets[0]["tasks"][key]["paper"], pairs[0]),
        "points": points,
        "p": [pair["test"]["p"] for pair in pairs],
        "d": [pair["test"]["effect"] for pair in pairs],
        "verdicts": [pair["verdict"] for pair in pairs],
        "over_sets": over_sets,
    }


def _is_wide(paper: Mapping[str, tuple[float, float]], pair: Mapping[str, Any]) -> bool:
    deviation = math.hypot(paper[pair["better"]][1], paper[pair["worse"]][1])
    return bool(pair["paper_points"] > WIDE_SDS * deviation)


def _pairs(task: Results) -> list[dict[str, Any]]:
    return list(task["order"]["compared"]) if task["order"] else []


def summary_sentences(tasks: Results) -> list[str]:
    """Return a sentence for each task: how many comparisons hold in every set, in some, in none.

    The last sentences count all tasks, set by set.
    """
    sentences = []
    for task in tasks.values():
        n = len(task["pairs"])
        if not n:
            sentences.append(f"{task['title']}: the paper's own values separate no pair")
            continue
        counts = Counter(_outcome(pair["verdicts"]) for pair in task["pairs"])
        listed = ", ".join(f"{counts[name]} {name}" for name in OUTCOMES if counts[name])
        sentences.append(f"{task['title']}: of {n} comparisons {listed}")
    pairs = [pair for task in tasks.values() for pair in task["pairs"]]
    wide = [pair for pair in pairs if pair["wide"]]
    if pairs:
        sentences.append(f"All tasks: of {len(pairs)} comparisons {_held(pairs)} hold, set by set")
    if wide:
        sentences.append(
            f"Of the {len(wide)} whose difference in the paper is larger than {WIDE_SDS} standard "
            f"deviations of the pair {_held(wide)} hold"
        )
    return sentences


def _held(pairs: Sequence[Mapping[str, Any]]) -> str:
    """Return how many comparisons hold in each set, with commas."""
    by_set = zip(*(pair["verdicts"] for pair in pairs), strict=True)
    return ", ".join(str(verdicts.count(Agreement.HOLDS)) for verdicts in by_set)


def missing_sentences(sets: Sets) -> list[str]:
    """Return a sentence for each part and group of trials that the sessions of the sets lack."""
    sources = [source for one in sets for source in one["inputs"]]
    return [f"{source['path']}: {line}" for source in sources for line in source.get("missing", ())]


def _outcome(agreements: Sequence[str]) -> str:
    kinds = set(agreements)
    if kinds == {Agreement.HOLDS}:
        return OUTCOMES[0]
    if Agreement.HOLDS in kinds:
        return OUTCOMES[1]
    if kinds == {Agreement.TIED}:
        return OUTCOMES[2]
    return OUTCOMES[3] if Agreement.TIED in kinds else OUTCOMES[4]


def _describe(folder: Path, one: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "report": str(folder),
        "trials": one["trials"]["used"],
        "simulated": one["simulated"],
        "inputs": one["inputs"],
        "settings": one["settings"],
    }
