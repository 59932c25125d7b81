"""The moving finger's layout: every data set and column with its type, unit and meaning.

``docs/reference/session.md`` shows the same tables.
"""

from __future__ import annotations

from rigctl.finger_values import N_FINGER_TAXELS
from rigctl.session.format.data_sets import ArrayLayout, Column, SessionLayout, TableLayout
from rigctl.session.format.layout import (
    ARRIVALS,
    ATTEMPT,
    COUNTER_ARRAY,
    EVENTS,
    FLAGS,
    GAPS,
    OUTCOME,
    SAMPLE_UNIT,
    SAMPLES,
)

FINGER_EXPERIMENT = "finger"
"""``experiment`` of a session of the moving finger."""
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
FINGER_LAYOUT = SessionLayout(
    FINGER_EXPERIMENT, "finger board", FINGER_ARRAYS, FINGER_TABLES, FINGER_TRIALS
)
