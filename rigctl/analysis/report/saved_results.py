"""``results.json`` of a report, read back: what another page takes from it is checked first."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, TypedDict

import msgspec

from rigctl.analysis.comparisons import NAME_OF
from rigctl.config.text_file import read_bytes
from rigctl.errors import WrongUse

RESULTS = "results.json"
MAX_BYTES = 16 * 1024 * 1024
"""Of the sixteen textures of the paper with 50 components and 20 draws: 0.2 MB."""

Count = Annotated[int, msgspec.Meta(ge=1, le=1_000_000_000)]
Numbers = list[float]


class _Pair(TypedDict):
    better: str
    worse: str
    verdict: str
    points: float
    spread_points: float | None
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
        named |= {pair[end] for pair in pairs for end in ("better", "worse")}
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
