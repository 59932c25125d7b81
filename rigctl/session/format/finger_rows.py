"""Encode the moving finger's values as rows of its tables and parse them back."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.finger_values import (
    BatchRow,
    FingerTrialRow,
    LatencyRow,
    PredictionRow,
    TrackRow,
    WindowRow,
)
from rigctl.session.format.finger_layout import (
    BATCHES,
    FINGER_TRIALS,
    LATENCIES,
    PREDICTIONS,
    SPIKE_COLUMNS,
    TRACK,
    WINDOWS,
)
from rigctl.session.format.table_rows import Row, encode_row, parse_verdict
from rigctl.session.hdf5_file import parse_json

NOT_CLASSIFIED = -1
PROBABILITY_DIGITS = 6
_TEXT_BYTES = {column.name: column.text_bytes for column in PREDICTIONS.columns}


def track_row(row: TrackRow) -> Row:
    """Return one row of /track."""
    return encode_row(row, TRACK)


def batch_row(row: BatchRow) -> Row:
    """Return one row of /batches."""
    return encode_row(row, BATCHES)


def window_row(row: WindowRow) -> Row:
    """Return one row of /windows."""
    return encode_row((*row[:3], *row.spikes, row.arrived_s), WINDOWS)


def latency_row(row: LatencyRow) -> Row:
    """Return one row of /latencies."""
    return encode_row(row, LATENCIES)


def prediction_row(row: PredictionRow) -> Row:
    """Return one row of /predictions; what does not fit its column is left out, from the end."""
    ordered = sorted(row.probabilities.items(), key=lambda item: -item[1])
    probabilities = [(name, round(value, PROBABILITY_DIGITS)) for name, value in ordered]
    texts = {
        "probabilities": _fit(probabilities, dict, _TEXT_BYTES["probabilities"]),
        "texture_set": _fit(list(row.texture_set), list, _TEXT_BYTES["texture_set"]),
    }
    return encode_row({**row._asdict(), **texts}.values(), PREDICTIONS)


def parse_prediction(row: Any, path: Path) -> PredictionRow:
    """Return the answer in a row of /predictions, text as Unicode.

    Raises SessionError that names the part at ``path`` if its texts are not JSON.
    """
    values = dict(zip(row.dtype.names, row.item(), strict=True))
    fields = {name: values[name] for name in PredictionRow._fields}
    place = f"the answer at {fields['at_s']:g} s in /predictions"
    fields["probabilities"] = parse_json(fields["probabilities"], dict, path, place)
    fields["texture_set"] = tuple(parse_json(fields["texture_set"], list, path, place))
    fields.update({name: bool(fields[name]) for name in ("known", "decided", "is_final")})
    return PredictionRow(**fields)


def finger_trial_row(row: FingerTrialRow, part: int, first_sample: int) -> Row:
    """Return one row of /trials; the writer supplies ``part`` and ``first_sample``."""
    stored = replace(row, part=part, first_sample=first_sample)
    *values, correct = astuple(stored)
    code = NOT_CLASSIFIED if correct is None else int(correct)
    return encode_row((*values, code), FINGER_TRIALS)


def parse_finger_trial(row: Any) -> FingerTrialRow:
    """Return the attempt in a row of /trials, text as Unicode."""
    values = parse_verdict(dict(zip(row.dtype.names, row.item(), strict=True)))
    code = values.pop("correct")
    return FingerTrialRow(**values, correct=None if code == NOT_CLASSIFIED else bool(code))


def spike_counts(rows: NDArray[np.void]) -> NDArray[np.int64]:
    """Return the spikes in rows of /windows, int64 (windows, 9)."""
    columns = [rows[name].astype(np.int64) for name in SPIKE_COLUMNS]
    return np.stack(columns, axis=1)


def _fit(items: list[Any], make: Callable[[list[Any]], Any], width: int) -> str:
    """Return JSON of at most ``width`` bytes of the first items."""
    for kept in range(len(items), 0, -1):
        text = json.dumps(make(items[:kept]), ensure_ascii=False)
        if len(text.encode()) <= width:
            return text
    return json.dumps(make([]))
