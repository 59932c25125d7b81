"""The rules of each table, by its path; those of a trial's row in each experiment."""

from __future__ import annotations

from rigctl.protocol.finger import Stage
from rigctl.session.format import finger_layout, layout
from rigctl.session.verify.values.rules import (
    Rule,
    a_time,
    at_least,
    bits,
    json_objects,
    one_of,
    within,
)
from rigctl.values import SCALE_BAND_UG_PER_COUNT, Verdict
from rigctl.wire.drum.codes import Status
from rigctl.wire.drum.states import Fault, State
from rigctl.wire.finger.messages import BATCH_SAMPLES, VelocitySource

HIGHEST_COUNT = 1 << 23
"""The load cell's converter has 24 bits with a sign."""
MAX_FORCE_G = 2 * HIGHEST_COUNT * SCALE_BAND_UG_PER_COUNT[1] * 1e-6
"""No cell reads more: the converter's whole span, with the coarsest scale."""
MAX_MM, MAX_MM_S = 1e6, 1e5
_U32 = (1 << 32) - 1
_FAULT_BITS = sum(1 << fault for fault in Fault if fault)
_STATUS_BITS = sum(1 << bit for bit in Status)

_GAPS = (at_least("count", 1), at_least("row", 0))
_ATTEMPT = (
    at_least("trial_id", 1),
    at_least("attempt", 1),
    at_least("first_counter", -1),
    at_least("first_sample", -1),
    at_least("count", 0),
    one_of("verdict", Verdict),
    a_time("started_s"),
    a_time("ended_s"),
)
_COMMON: dict[str, tuple[Rule, ...]] = {
    layout.ARRIVALS.path: (at_least("first_row", 0), a_time("arrived_s")),
    layout.EVENTS.path: (a_time("at_s"), json_objects("data")),
    layout.GAPS.path: _GAPS,
}


def drum_rules(measured: bool) -> dict[str, tuple[Rule, ...]]:
    """Return the rules of the drum's tables; an import has forces and speeds only if ``measured``.

    A NaN stands for what was not measured.
    """
    unknown = not measured
    drum = (
        a_time("at_s"),
        at_least("board_time_us", 0),
        one_of("state", State),
        one_of("fault", Fault),
        bits("fault_bits", _FAULT_BITS),
        bits("status_bits", _STATUS_BITS),
        within("angle_deg", -MAX_MM, MAX_MM),
        within("speed_mm_s", -MAX_MM_S, MAX_MM_S, unknown),
        within("speed_set_mm_s", -MAX_MM_S, MAX_MM_S, unknown),
        within("force_g", -MAX_FORCE_G, MAX_FORCE_G, unknown),
        within("force_set_g", -MAX_FORCE_G, MAX_FORCE_G, unknown),
        within("actuator_drive_permille", -1000, 1000),
        at_least("sync_count", 0),
        at_least("index_count", 0),
        at_least("loadcell_lost", 0),
    )
    loadcell = (
        at_least("sequence", 0),
        at_least("board_time_us", -MAX_CLOCK_LEAD_US),
        within("raw_counts", -HIGHEST_COUNT, HIGHEST_COUNT),
        within("force_g", -MAX_FORCE_G, MAX_FORCE_G),
    )
    trials = (
        *_ATTEMPT,
        within("speed_mm_s", 0, MAX_MM_S),
        within("force_g", 0, MAX_FORCE_G),
        within("travel_mm", 0, MAX_MM),
        within("depth_mm", -MAX_MM, MAX_MM),
        within("mean_speed_mm_s", -MAX_MM_S, MAX_MM_S, unknown=True),
        within("mean_force_g", -MAX_FORCE_G, MAX_FORCE_G, unknown=True),
        at_least("mount", 1),
    )
    tables = (layout.DRUM, layout.LOADCELL, layout.TRIALS)
    rules = zip(tables, (drum, loadcell, trials), strict=True)
    return _COMMON | {table.path: each for table, each in rules}


MAX_CLOCK_LEAD_US = 1_000_000
"""The first conversion may be from before the board's clock began, by as much."""


def finger_rules() -> dict[str, tuple[Rule, ...]]:
    """Return the rules of the moving finger's tables."""
    places = ("x_mm", "y_mm", "z_mm", "along_mm", "across_mm", "height_mm")
    track = (
        a_time("at_s"),
        one_of("valid", (0, 1)),
        *(within(name, -MAX_MM, MAX_MM, unknown=True) for name in places),
    )
    batches = (
        at_least("batch", 0),
        within("velocity_um_s", 0, _U32),
        one_of("velocity_source", VelocitySource),
        within("estimate_mm_s", -MAX_MM_S, MAX_MM_S, unknown=True),
        at_least("dropouts", 0),
        at_least("outliers", 0),
        within("samples", 1, BATCH_SAMPLES),
        within("lost_samples", 0, BATCH_SAMPLES),
        at_least("start_nm", 0),
        a_time("sent_s", unknown=True),
        a_time("reported_s"),
    )
    windows = (at_least("window", 0), at_least("real_ms", 0), a_time("arrived_s"))
    predictions = (
        a_time("at_s"),
        at_least("windows", 0),
        within("distance_mm", 0, MAX_MM),
        within("seconds", 0, MAX_MM),
        json_objects("probabilities"),
        *(one_of(name, (0, 1)) for name in ("known", "decided", "is_final")),
    )
    latencies = (a_time("at_s"), within("ms", 0, MAX_MM))
    tables = {
        finger_layout.TRACK: track,
        finger_layout.BATCHES: batches,
        finger_layout.WINDOWS: windows,
        finger_layout.PREDICTIONS: predictions,
        finger_layout.LATENCIES: latencies,
        finger_layout.FINGER_TRIALS: _FINGER_TRIALS,
    }
    return _COMMON | {table.path: rules for table, rules in tables.items()}


_FINGER_TRIALS = (
    *_ATTEMPT,
    one_of("stage", Stage),
    within("distance_mm", 0, MAX_MM),
    *(
        within(name, -MAX_MM_S, MAX_MM_S, unknown=True)
        for name in ("mean_mm_s", "first_half_mm_s", "second_half_mm_s")
    ),
    within("tracker_lost_s", 0, MAX_MM),
    within("contact_share", 0, 1),
    one_of("correct", (-1, 0, 1)),
)
