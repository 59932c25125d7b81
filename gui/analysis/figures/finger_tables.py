"""The numbers behind the pictures of the moving finger's report. This module has no Qt."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import zip_longest
from typing import Any

from gui.analysis.export.value_file import rows_csv

Values = Mapping[str, Any]


def evidence_csv(values: Values) -> str:
    """Return accuracy against the way and against time."""
    names = ("representation", "way (mm)", "accuracy (%)", "time (s)", "accuracy by time (%)")
    rows = []
    for one in values["evidence"]:
        columns = (one["at_mm"], _percent(one["by_mm"]), one["at_s"], _percent(one["by_s"]))
        rows += [(one["kind"], *row) for row in zip_longest(*columns)]
    return rows_csv(names, rows)


def promises_csv(values: Values) -> str:
    """Return coverage and size of the sets, and the calls of unknown plates, by windows."""
    names = (
        "representation", "quantity", "unit", *(f"{n} windows" for n in range(1, 21)),
    )  # fmt: skip
    rows: list[tuple[Any, ...]] = []
    for one in values["coverage"]:
        rows.append((one["kind"], "sets that hold the texture", "%", *_percent(one["coverage"])))
        rows.append((one["kind"], "mean size of a set", "textures", *one["mean_size"]))
    for one in values["novelty"]:
        rows.append((one["kind"], "untrained called unknown", "%", *_percent(one["detected"])))
        rows.append((one["kind"], "trained called unknown", "%", *_percent(one["false_alarms"])))
    return rows_csv(names, rows)


def latencies_csv(values: Values) -> str:
    """Return the number and the percentiles of each latency."""
    names = ("latency", "number", "p50 (ms)", "p99 (ms)", "p99.9 (ms)", "largest (ms)")
    return rows_csv(names, [(kind, *one.values()) for kind, one in values["latencies"].items()])


def _percent(shares: list[float]) -> list[float]:
    return [round(100 * share, 4) for share in shares]


FIGURES = (
    ("Evidence", "evidence", evidence_csv),
    ("Promises", "promises", promises_csv),
    ("Latencies", "latencies", latencies_csv),
)
"""Page, file and numbers of each picture."""
