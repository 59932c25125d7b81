"""The drum's layout: every data set and column with its type, unit and meaning.

``docs/reference/session.md`` shows the same tables. The tables of arrivals, events and gaps are
those of every session.
"""

from __future__ import annotations

from enum import StrEnum

from rigctl.session.format.data_sets import ArrayLayout, Column, SessionLayout, TableLayout

LAYOUT = "rigctl-session"
LAYOUT_VERSION = 1
DRUM_EXPERIMENT = "drum"
"""``experiment`` of a session of the drum; its parts have no such attribute."""
PART_END_KIND = "part_end"
"""Kind of the event in the last row of a finished part."""
SESSION_END_KIND = "session_end"
"""Kind of the event before it in the last part of a sitting; its data are ``outcome``, of
:class:`SessionOutcome`, and the numbers of ``committed`` and ``planned`` trials."""

SAMPLE_UNIT = "attribute `sample_unit`"
"""The unit of a reading depends on the source, so an attribute of the part holds it."""

PLACES = "one column for each place, layer by layer; attribute `wiring`: the reading at each"

SAMPLES, COUNTER, FLAGS, EDGES = (
    "/taxels/samples",
    "/taxels/counter",
    "/taxels/flags",
    "/taxels/edges",
)

COUNTER_ARRAY = ArrayLayout(
    COUNTER, "counters", "i8", "samples", "the board's own sample number, unwrapped"
)

TAXEL_ARRAYS = (
    ArrayLayout(SAMPLES, "samples", "u2", SAMPLE_UNIT, PLACES, per_taxel=True, raw=True),
    COUNTER_ARRAY,
    ArrayLayout(
        FLAGS, "flags", "u1", "", "bits of the taxel wire's flags; bit 0 is the sync level"
    ),
    ArrayLayout(EDGES, "edges", "u1", "", "sync rises mod 4 in bits 0–1, index marks mod 4 in 2–3"),
)

ARRIVALS = TableLayout(
    "/taxels/arrivals",
    "one row for each block of samples, as received",
    1024,
    (
        Column("first_row", "i8", "rows", "first row of the block in /taxels/samples"),
        Column("arrived_s", "f8", "s", "loop time at which the block's bytes arrived"),
    ),
)

DRUM = TableLayout(
    "/drum",
    "one row for each poll of the drum",
    512,
    (
        Column("at_s", "f8", "s", "loop time of the reply"),
        Column("board_time_us", "i8", "µs", "the drum's clock at the reply, unwrapped"),
        Column("state", "u1", "", "state of the drum"),
        Column("fault", "u1", "", "first latched fault, 0 when none"),
        Column("fault_bits", "u4", "", "causes present at the poll", older_code="u2"),
        Column("status_bits", "u2", "", "status bits of the drum wire"),
        Column("steps", "i8", "steps", "signed microsteps"),
        Column("angle_deg", "f4", "°", "drum angle from the steps"),
        Column("speed_mm_s", "f4", "mm/s", "surface speed commanded to the stepper"),
        Column("speed_set_mm_s", "f4", "mm/s", "speed set-point"),
        Column("force_g", "f4", "g", "newest load-cell reading after tare and scale"),
        Column("force_set_g", "f4", "g", "force set-point"),
        Column("actuator_position_um", "i4", "µm", "actuator travel from its upper end"),
        Column("actuator_drive_permille", "i2", "‰", "signed duty, positive presses"),
        Column("sync_count", "i8", "", "rises of the sync line"),
        Column("sync_rise_us", "i8", "µs", "board time of the last rise"),
        Column("sync_fall_us", "i8", "µs", "board time of the last fall"),
        Column("index_count", "i8", "", "index marks seen"),
        Column("loadcell_lost", "i4", "", "load-cell samples lost directly before this poll"),
    ),
)

LOADCELL = TableLayout(
    "/loadcell",
    "one row for each conversion of the load cell",
    1024,
    (
        Column("sequence", "i8", "", "number of the conversion, unwrapped"),
        Column("board_time_us", "i8", "µs", "the drum's clock when it was ready, unwrapped"),
        Column("raw_counts", "i4", "counts", "reading of the amplifier"),
        Column("force_g", "f4", "g", "after tare and scale"),
    ),
)

ATTEMPT = (
    Column("trial_id", "i4", "", "number in planned order, from 1"),
    Column("attempt", "i2", "", "1 for the first attempt"),
    Column("part", "i2", "", "part that holds the row and its samples"),
)
OUTCOME = (
    Column("verdict", "S12", "", "committed, rejected or aborted"),
    Column("reasons", "S192", "", "reasons of the verdict, joined by '; '"),
    Column("started_s", "f8", "s", "loop time at which the attempt began"),
    Column("ended_s", "f8", "s", "loop time at which it ended"),
)
"""First columns and outcome of a trial's row in every experiment."""

TRIALS = TableLayout(
    "/trials",
    "one row for each attempt at a trial, written at its end",
    32,
    (
        *ATTEMPT,
        Column("texture", "S16", "", "name of the plate"),
        Column("speed_mm_s", "f8", "mm/s", "planned speed"),
        Column("force_g", "f8", "g", "planned force; 0 in force mode position"),
        Column("repeat", "i4", "", "repeat of this condition, from 1; anew with each of `mounts`"),
        Column("travel_mm", "f8", "mm", "texture travel of the recorded window"),
        Column("force_mode", "S12", "", "hold, lock or position"),
        Column("direction", "S12", "", "forward or backward"),
        Column("depth_mm", "f8", "mm", "planned depth below contact, force mode position"),
        Column("first_counter", "i8", "samples", "counter of the first sample; -1: no window"),
        Column("first_sample", "i8", "rows", "its row in /taxels/samples; -1: no window"),
        Column("count", "i8", "samples", "length of the window, counted from first_counter"),
        *OUTCOME,
        Column("mean_speed_mm_s", "f8", "mm/s", "over the window, from the polls"),
        Column("mean_force_g", "f8", "g", "over the window, from the load cell"),
        Column("mount", "i4", "", "mounting of this plate, from 1; older parts lack it: 1", 1),
    ),
)

EVENTS = TableLayout(
    "/events",
    "events, for people and programs",
    64,
    (
        Column("at_s", "f8", "s", "loop time"),
        Column("kind", "S16", "", "short lower-case word"),
        Column("text", "S192", "", "one sentence"),
        Column("data", "S320", "", "details as a JSON object"),
    ),
)

GAPS = TableLayout(
    "/gaps",
    "samples that the board took and that are not in this file",
    64,
    (
        Column("first_counter", "i8", "samples", "counter of the first lost sample"),
        Column("count", "i8", "samples", "number of lost samples"),
        Column("row", "i8", "rows", "row of /taxels/samples before which they are missing"),
        Column("reason", "S32", "", "place of the loss"),
    ),
)

TABLES = (ARRIVALS, DRUM, LOADCELL, TRIALS, EVENTS, GAPS)
DRUM_LAYOUT = SessionLayout(DRUM_EXPERIMENT, "taxel board", TAXEL_ARRAYS, TABLES, TRIALS)


class SessionOutcome(StrEnum):
    """How a sitting of a session ended; after a crash or a kill there is no such event."""

    FINISHED = "finished"
    STOPPED = "stopped"
    FAILED = "failed"
