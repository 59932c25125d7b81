"""Render the page on very many trials from measured rates, which it holds as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

SETS = (24_000, 10**6, 10**8)
WORKERS = (1, 100)
DRAWS, CONDITIONS = 20, 80
TALL_TRIALS = 2160 / 0.225
"""Trials from which on every fit of a draw has more rows than features."""
MARK = "```json\n"

UNITS = {
    "session_bytes": "B a trial", "join_s": "s a trial", "table_bytes": "B a trial",
    "encode_s": "s a trial", "write_s": "s a trial", "counts_bytes": "B a trial",
    "feature_bytes": "B a trial", "condition_bytes": "B a trial",
    "condition_job_bytes": "B a trial", "draw_job_bytes": "B a trial",
    "draw_s": "s a trial", "draw_fixed_s": "s",
    "draw_bytes": "B a trial", "task_s": "s", "travel_bytes_s": "B/s", "synced_bytes_s": "B/s",
}  # fmt: skip

HEAD = """\
# The cost of very many trials

`make scale` writes this page (`python -m tests.benchmarks.encoder.scale PAGE`) from rates that it
measures in the same run. A test renders the page from the rates at its end and fails if a number
differs. The page extrapolates linearly from {trials} trials; it is not an experiment with larger
sets. Times are processor time of one core; only the disk is timed by the clock. The measured set is
in the page cache, so reading a large set from the disk is a separate row.

Measured on {made}, on {machine}.

## Rates

Rates are for one trial unless the row says otherwise.

"""
BREAKS = """
## Limits

Each row is data that grows with the number of trials, and the number of trials at which it alone
fills the measuring machine ({memory} of memory, {disk} free on its disk). The first row reaches its
limit first.

"""


ALIKE = """
The covariance of features does not grow with the number of trials: 2160² × 8 bytes are
{covariance}, so a draw can sum it over pieces of its rows. `results.json` does not grow either: it
holds draws × components of each task and representation.

## Rates of this run

"""


BOUND = """\
Below {tall:,.0f} trials, a fit has fewer rows than features and needs a whole singular value
decomposition. Above, it needs a covariance and its leading vectors, which cost less. The times of
draws are therefore upper bounds.
"""


class GrowthLimit(NamedTuple):
    """Data that grows with the number of trials until it fills memory or disk."""

    what: str
    bytes_per_trial: float
    store: str
    remedy: str


def render(rates: Mapping[str, Any]) -> str:
    """Return the whole page."""
    memory, disk = (_bytes(rates[key]) for key in ("memory_bytes", "disk_free_bytes"))
    return (
        HEAD.format(trials=rates["trials"], machine=rates["machine"], made=rates["made"])
        + _shares(rates)
        + _of_line(rates)
        + "\n## Sets of 24,000, 10⁶ and 10⁸ trials\n\n"
        + _sets(rates)
        + BREAKS.format(memory=memory, disk=disk)
        + _limits(rates)
        + ALIKE.format(covariance=_bytes(2160**2 * 8))
        + MARK
        + json.dumps(dict(rates), indent=1)
        + "\n```\n"
    )


def rates_of(text: str) -> dict[str, Any]:
    """Return the rates that a page was rendered from."""
    found: dict[str, Any] = json.loads(text.partition(MARK)[2].partition("```")[0])
    return found


def _shares(rates: Mapping[str, Any]) -> str:
    whole = f"{_time(rates['draw_s'])}, and {_time(rates['draw_fixed_s'])} for each draw"
    return _table(
        ("rate", "measured"),
        [
            ("session on disk, as recorded", _bytes(rates["session_bytes"])),
            ("row in the table of trials, in memory", _bytes(rates["table_bytes"])),
            ("opening the session", _time(rates["join_s"])),
            ("reading, encoding, search for C (workers share this)", _time(rates["encode_s"])),
            ("writing features (first process only)", _time(rates["write_s"])),
            ("spike counts, kept until C is known", _bytes(rates["counts_bytes"])),
            ("features in all representations, on disk", _bytes(rates["feature_bytes"])),
            ("one draw of all tasks and representations, per trial of the set", whole),
            ("rows of one draw in memory, per trial of the set", _bytes(rates["draw_bytes"])),
            ("one task through Dask", _time(rates["task_s"])),
            ("results from Dask workers", f"{_bytes(rates['travel_bytes_s'])}/s"),
            ("this disk, written and synced", f"{_bytes(rates['synced_bytes_s'])}/s"),
        ],
    )


def _sets(rates: Mapping[str, Any]) -> str:
    rows: list[tuple[str, ...]] = []

    def add(what: str, of: Any) -> None:
        rows.append((what, *(of(n) for n in SETS)))

    for what, key in (
        ("sessions on disk", "session_bytes"),
        ("features on disk", "feature_bytes"),
        ("table of trials, memory", "table_bytes"),
        ("counts in the first process, memory", "counts_bytes"),
        ("one draw of 2160 features, memory", "draw_bytes"),
        ("conditions sent with the task of one draw", "draw_job_bytes"),
    ):
        add(what, lambda n, key=key: _bytes(n * rates[key]))
    one = rates["condition_bytes"] / CONDITIONS
    add(f"one condition of {CONDITIONS}, memory", lambda n: _bytes(n * one))
    add("sessions once through this disk, at its write speed", lambda n: _time(_read_s(n, rates)))
    bound = ", at most" if _is_bound(rates) else ""
    for workers in WORKERS:
        name = "one process" if workers == 1 else f"{workers} Dask workers"
        add(f"encoding and C, {name}", lambda n, w=workers: _time(_encoded_s(n, w, rates)))
        add(f"{DRAWS} draws, {name}{bound}", lambda n, w=workers: _time(_drawn_s(n, w, rates)))
    return _table(("", *(f"{n:,}" for n in SETS)), rows)


def _of_line(rates: Mapping[str, Any]) -> str:
    """Return how the cost of a draw was measured, and whether it is an upper bound."""
    low, high = (f"{n:,}" for n in rates["sweep_trials"])
    text = f"The cost of a draw is a line through {low} and {high} generated trials."
    if not _is_bound(rates):
        return f"\n{text}\n"
    return f"\n{text}\n{BOUND.format(tall=TALL_TRIALS)}"


def _is_bound(rates: Mapping[str, Any]) -> bool:
    return bool(min(rates["sweep_trials"]) < TALL_TRIALS)


def _read_s(n: int, rates: Mapping[str, Any]) -> float:
    return float(n * rates["session_bytes"] / rates["synced_bytes_s"])


def _encoded_s(n: int, workers: int, rates: Mapping[str, Any]) -> float:
    """Return the time of encoding: shared work, the first process, and with Dask its overhead."""
    beside = n * (rates["join_s"] + rates["write_s"])
    work = n * rates["encode_s"] / min(workers, CONDITIONS)
    if workers == 1:
        return float(work + beside)
    tasks = (n / rates["chunk_trials"] + 2 * CONDITIONS) * rates["task_s"]
    return float(work + beside + tasks + n * rates["counts_bytes"] / rates["travel_bytes_s"])


def _drawn_s(n: int, workers: int, rates: Mapping[str, Any]) -> float:
    """Return the time of all draws; each draw, family and representation is a task: 240 tasks."""
    pieces = 12 * DRAWS
    work = DRAWS * (n * rates["draw_s"] + rates["draw_fixed_s"]) / min(workers, pieces)
    sent = pieces * (rates["task_s"] + n * rates["draw_job_bytes"] / rates["travel_bytes_s"])
    return float(work + (sent if workers > 1 else 0.0))


def growth_limits(rates: Mapping[str, Any]) -> list[tuple[float, GrowthLimit]]:
    """Return the numbers of trials at which data fills its store, the smallest first."""
    found = [
        GrowthLimit("the rows of one draw", rates["draw_bytes"], "memory",
            "sum means and covariances over pieces of the rows, each worker its own"),
        GrowthLimit("counts kept until C is known", rates["counts_bytes"], "memory",
            "write the unscaled rows first and read the counts back from the cache"),
        GrowthLimit("the table of trials", rates["table_bytes"], "memory",
            "columns of numbers (25 bytes a trial) instead of one object a trial"),
        GrowthLimit(f"one of {CONDITIONS} conditions", rates["condition_bytes"] / CONDITIONS,
            "memory",
            "search C on a sample of the condition's trials, and encode the rest in pieces"),
        GrowthLimit("the features", rates["feature_bytes"], "disk",
            "store counts as bytes instead of float64, or one representation at a time"),
        GrowthLimit("the sessions", rates["session_bytes"], "disk",
            "sessions on several disks or an object store; the analysis reads them in place"),
    ]  # fmt: skip
    store = {"memory": rates["memory_bytes"], "disk": rates["disk_free_bytes"]}
    return sorted((store[limit.store] / limit.bytes_per_trial, limit) for limit in found)


def _limits(rates: Mapping[str, Any]) -> str:
    rows = [
        (limit.what, f"{_bytes(limit.bytes_per_trial)} of {limit.store}", _round(n), limit.remedy)
        for n, limit in growth_limits(rates)
    ]
    text = _table(("data", "per trial", "full at, trials", "remedy"), rows)
    at = 10**8
    tasks = at / rates["chunk_trials"] * rates["task_s"]
    return (
        f"{text}\nLimits in time, at 10⁸ trials:\n\n"
        f"- Dask's scheduler and client take {_time(tasks)} to distribute the reading in chunks of "
        f"{rates['chunk_trials']} trials. Remedy: larger chunks.\n"
        f"- The first process writes features for {_time(at * rates['write_s'])}, with any number "
        "of workers. Remedy: each worker writes its own files.\n"
        f"- More than {CONDITIONS} workers do not speed up the search for C, because a condition "
        "is one task. Remedy: divide conditions into pieces.\n"
    )


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(cells) + " |" for cells in [head, tuple("---" for _ in head), *rows]]
    return "\n".join(lines) + "\n"


def _bytes(value: float) -> str:
    for unit in ("B", "kB", "MB", "GB", "TB"):
        if value < 1000:
            return f"{_round(value)} {unit}"
        value /= 1000
    return f"{_round(value)} PB"


def _time(seconds: float) -> str:
    for unit, size in (("µs", 1e-6), ("ms", 1e-3), ("s", 1.0), ("min", 60.0), ("h", 3600.0)):
        limit = {"µs": 1e-3, "ms": 1.0, "s": 120.0, "min": 7200.0, "h": 2 * 86400.0}[unit]
        if seconds < limit:
            return f"{_round(seconds / size)} {unit}"
    return f"{_round(seconds / 86400.0)} d"


def _round(value: float) -> str:
    """Format a value with two significant digits."""
    rounded = float(f"{value:.2g}")
    return f"{rounded:,.0f}" if rounded >= 10 else f"{rounded:g}"
