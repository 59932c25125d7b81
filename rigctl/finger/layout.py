"""The moving finger's layout: every data set and column, and the rows of its tables.

``docs/reference/session.md`` shows the same tables.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.experiments import FINGER_EXPERIMENT
from rigctl.finger.values import (
    N_FINGER_TAXELS,
    BatchRow,
    FingerTrialRow,
    LatencyRow,
    PredictionRow,
    TrackRow,
    WindowRow,
)
from rigctl.session.hdf5_file import parse_json
from rigctl.session.layout import (
    ARRIVALS,
    ATTEMPT,
    COUNTER,
    COUNTER_ARRAY,
    EVENTS,
    FLAGS,
    GAPS,
    OUTCOME,
    SAMPLE_UNIT,
    SAMPLES,
    ArrayLayout,
    Column,
    Row,
    SessionLayout,
    TableLayout,
    encode_row,
    parse_verdict,
)

SPIKES = "/taxels/spikes"
SPIKE_COLUMNS = tuple(f"spikes_{taxel}" for taxel in range(1, N_FINGER_TAXELS + 1))
"""Columns of /windows with the spikes of each taxel."""

_SCAN = Column("scan", "u4", "", "the board's number of the scan")

FINGER_ARRAYS = (
    ArrayLayout(
        SAMPLES,
        "samples",
        "u2",
        SAMPLE_UNIT,
        "one column for each taxel of the finger, row by row",
        per_taxel=True,
        raw=True,
    ),
    ArrayLayout(
        SPIKES,
        "spikes",
        "u1",
        "spikes",
        "spikes of each taxel's neuron in this sample, from the board",
        per_taxel=True,
    ),
    COUNTER_ARRAY,
    ArrayLayout(
        FLAGS,
        "flags",
        "u1",
        "",
        "bits of the finger wire's flags: in a scan, first of a scan, lost before",
    ),
)

TRACK = TableLayout(
    "/track",
    "one row for each position of the tracker",
    1024,
    (
        Column("at_s", "f8", "s", "loop time at which the position holds"),
        Column("x_mm", "f8", "mm", "in the tracker's frame"),
        Column("y_mm", "f8", "mm", "in the tracker's frame"),
        Column("z_mm", "f8", "mm", "in the tracker's frame"),
        Column("along_mm", "f8", "mm", "along the plate, 0 to 300"),
        Column("across_mm", "f8", "mm", "across the plate"),
        Column("height_mm", "f8", "mm", "above the plate"),
        Column("valid", "u1", "", "0 where the tracker has lost its reference"),
    ),
)

BATCHES = TableLayout(
    "/batches",
    "one row for each batch of a scan, as the board scaled it",
    256,
    (
        _SCAN,
        Column("batch", "i4", "", "number in the scan, from 0"),
        Column("velocity_um_s", "i8", "µm/s", "mean velocity that the board used"),
        Column("velocity_source", "u1", "", "0 received, 1 held from the batch before, 2 missing"),
        Column("estimate_mm_s", "f8", "mm/s", "mean velocity by the tracker; negative: reversed"),
        Column("estimate_source", "S16", "", "measured, interpolated or held"),
        Column("dropouts", "i4", "", "positions that are missing in the batch"),
        Column("outliers", "i4", "", "positions that the estimate left out"),
        Column("samples", "u1", "samples", "length of the batch, lost samples included"),
        Column("lost_samples", "u1", "samples", "samples that the board itself did not get"),
        Column("start_nm", "i8", "nm", "distance at its first sample"),
        Column("sent_s", "f8", "s", "loop time at which the velocity was sent"),
        Column("reported_s", "f8", "s", "loop time at which the board's report arrived"),
    ),
    "scan",
)

WINDOWS = TableLayout(
    "/windows",
    "one row for each window of scaled time, as the board counted it",
    256,
    (
        _SCAN,
        Column("window", "i4", "", "number in the scan, from 0"),
        Column("real_ms", "i4", "ms", "real time that the window took"),
        *(
            Column(name, "u2", "spikes", f"spikes of taxel {taxel}")
            for taxel, name in enumerate(SPIKE_COLUMNS, start=1)
        ),
        Column("arrived_s", "f8", "s", "loop time at which the window arrived"),
    ),
    "scan",
)

PREDICTIONS = TableLayout(
    "/predictions",
    "one row for each answer of the classifier",
    256,
    (
        _SCAN,
        Column("at_s", "f8", "s", "loop time of the answer"),
        Column("windows", "i4", "", "complete windows that it rests on"),
        Column("distance_mm", "f8", "mm", "distance of the scan so far"),
        Column("seconds", "f8", "s", "time of the scan so far"),
        Column("texture", "S16", "", "most probable texture"),
        Column("probabilities", "S160", "", "JSON: probability of each texture, largest first"),
        Column("texture_set", "S96", "", "JSON: textures of the set with the asked-for confidence"),
        Column("known", "u1", "", "0 where the plate is none of the trained ones"),
        Column("decided", "u1", "", "1 from the answer that was sure enough"),
        Column("is_final", "u1", "", "1 for the answer at the end of the scan"),
    ),
    "scan",
)

LATENCIES = TableLayout(
    "/latencies",
    "time from the arrival of a velocity to what follows from it",
    256,
    (
        Column("at_s", "f8", "s", "loop time at the end of the measurement"),
        _SCAN,
        Column("kind", "S16", "", "features, prediction or screen"),
        Column("ms", "f8", "ms", "time since the velocity arrived"),
    ),
)

FINGER_TRIALS = TableLayout(
    "/trials",
    "one row for each attempt at a trial, written at its end",
    32,
    (
        *ATTEMPT,
        Column("stage", "S16", "", "normalise, train, calibrate or run"),
        Column("texture", "S16", "", "name of the plate"),
        Column("profile", "S16", "", "planned velocity profile"),
        Column("repeat", "i4", "", "repeat of this condition, from 1"),
        _SCAN,
        Column("first_counter", "i8", "samples", "counter of the first sample; -1: no scan"),
        Column("first_sample", "i8", "rows", "its row in /taxels/samples; -1: no scan"),
        Column("count", "i8", "samples", "length of the scan, counted from first_counter"),
        *OUTCOME,
        Column("distance_mm", "f8", "mm", "distance of the scan by the velocities used"),
        Column("mean_mm_s", "f8", "mm/s", "mean velocity of the scan"),
        Column("first_half_mm_s", "f8", "mm/s", "mean velocity of the first half of the distance"),
        Column("second_half_mm_s", "f8", "mm/s", "mean velocity of the second half"),
        Column("tracker_lost_s", "f8", "s", "time of the scan without a valid position"),
        Column("contact_share", "f8", "", "share of the scan in which the sensor was touched"),
        Column("predicted", "S16", "", "texture that the classifier named; empty: none"),
        Column("correct", "i1", "", "1 right, 0 wrong, -1 not classified"),
    ),
)

FINGER_TABLES = (
    ARRIVALS,
    TRACK,
    BATCHES,
    WINDOWS,
    PREDICTIONS,
    LATENCIES,
    FINGER_TRIALS,
    EVENTS,
    GAPS,
)
FINGER_TRUTH = (
    ArrayLayout("/along_mm", "along_mm", "f4", "mm", "place of the fingertip along the plate"),
    ArrayLayout("/across_mm", "across_mm", "f4", "mm", "its place across, from the middle"),
    ArrayLayout("/height_mm", "height_mm", "f4", "mm", "its height over the plate"),
    ArrayLayout("/force_g", "force_g", "f4", "g", "contact force"),
    ArrayLayout("/plate", "plate", "S1", "", "plate under the finger; - before the first slide"),
    ArrayLayout("/slide", "slide", "i4", "", "number of the slide; -1 before the first"),
)
FINGER_LAYOUT = SessionLayout(
    FINGER_EXPERIMENT,
    "finger board",
    FINGER_ARRAYS,
    FINGER_TABLES,
    FINGER_TRIALS,
    (SAMPLES, COUNTER, SPIKES, BATCHES.path),
    truth=FINGER_TRUTH,
)


NOT_CLASSIFIED = -1
PROBABILITY_DIGITS = 6
_TEXT_BYTES = {column.name: column.text_bytes for column in PREDICTIONS.columns}


FingerRow = TrackRow | BatchRow | WindowRow | PredictionRow | LatencyRow
_TABLES: dict[type[FingerRow], tuple[TableLayout, str]] = {
    TrackRow: (TRACK, "at_s"),
    BatchRow: (BATCHES, "reported_s"),
    WindowRow: (WINDOWS, "arrived_s"),
    PredictionRow: (PREDICTIONS, "at_s"),
    LatencyRow: (LATENCIES, "at_s"),
}
"""The table of each kind of row, and the value that is its loop time."""


def finger_row(row: FingerRow) -> tuple[TableLayout, float, Row]:
    """Return the table of a row, its loop time and its values as stored."""
    table, at = _TABLES[type(row)]
    at_s = float(getattr(row, at))
    if isinstance(row, PredictionRow):
        return table, at_s, prediction_row(row)
    if isinstance(row, WindowRow):
        return table, at_s, encode_row((*row[:3], *row.spikes, row.arrived_s), table)
    return table, at_s, encode_row(row, table)


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
