"""Check the parts of a session of the moving finger, and its trials against what was planned.

The encoder and the time map of this program take the recorded readings, ranges and velocities; the
board's spikes and windows must be equal to theirs (``docs/reference/finger-wire.md``, *A scan*).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.encoder import Encoder
from rigctl.encoder.force_gain import ForceGain
from rigctl.encoder.normalisation import Normalisation
from rigctl.errors import ProtocolError, WrongUse
from rigctl.finger.board_messages import BATCH_SAMPLES, SampleFlag, VelocitySource
from rigctl.finger.layout import (
    BATCHES,
    FINGER_TRIALS,
    LATENCIES,
    PREDICTIONS,
    SPIKES,
    TRACK,
    WINDOWS,
    spike_counts,
)
from rigctl.finger.plan import parse_finger_protocol
from rigctl.finger.scaled_time import scale_windows
from rigctl.finger.session import FingerSession, board_ranges
from rigctl.finger.values import Stage
from rigctl.session import layout
from rigctl.session.header import IMPORTED
from rigctl.session.layout import COUNTER, FLAGS, SAMPLES
from rigctl.session.part import PartReader, StructuredArray
from rigctl.session.verify_part import (
    attempt_windows,
    check_attempt,
    check_contents,
    check_overlap,
    check_window,
    read_columns,
    window_rows,
)
from rigctl.session.verify_values import (
    ATTEMPT_RULES,
    COMMON_RULES,
    MAX_MM,
    MAX_MM_S,
    MAX_U32,
    Rule,
    a_time,
    at_least,
    check_recorded,
    check_times,
    json_objects,
    one_of,
    within,
)

MAX_MISSING = 1000
"""Missing batches that are listed: more than a minute of a scan."""


@dataclass(frozen=True, slots=True)
class RecordedScan:
    """One committed scan as recorded.

    ``counters`` int64 (n,), ``samples`` uint16 (n, 9), ``spikes`` uint8 (n, 9), ``flags`` uint8
    (n,): n is ``count`` less the lost samples. ``batches``, ``windows``: its rows of these tables.
    """

    first_counter: int
    count: int
    counters: NDArray[np.int64]
    samples: NDArray[np.uint16]
    spikes: NDArray[np.uint8]
    flags: NDArray[np.uint8]
    batches: StructuredArray
    windows: StructuredArray
    normalisation: Normalisation
    reference_um_per_s: int
    gain: ForceGain | None = None

    @property
    def n_scanned(self) -> int:
        """Samples of the scan by the board's batches."""
        return int(self.batches["samples"].sum(dtype=np.int64))

    @property
    def at(self) -> NDArray[np.int64]:
        """Place of each recorded sample in the scan, in ms.

        Samples that the board lost directly before the first one may belong to the scan, too.
        """
        lost_first = self.n_scanned - self.count
        return self.counters - self.first_counter + lost_first


def check_scan(scan: RecordedScan) -> tuple[list[str], list[str]]:
    """Return problems and notes on what does not agree in a scan, sentences without its name."""
    problems = [*_check_flags(scan), *_check_batches(scan)]
    if problems:  # without whole batches, nothing tells which samples the board had
        return [*problems, *_check_spikes(scan, len(scan.counters))], []
    known = _rows_before_a_loss(scan)
    problems += _check_spikes(scan, known)
    if known == len(scan.counters):
        return [*problems, *_check_windows(scan)], []
    first = scan.counters[known - 1] + 1 if known else scan.first_counter
    return problems, [
        f"samples from counter {first} on were lost between board and host: later spikes and "
        "windows cannot be recomputed"
    ]


def _check_flags(scan: RecordedScan) -> Iterator[str]:
    if not scan.flags[0] & SampleFlag.FIRST:
        yield "its first sample is not the first of the board's scan"
    if np.any(scan.flags[1:] & SampleFlag.FIRST):
        yield "the board began another scan in it"
    outside = np.count_nonzero((scan.flags & SampleFlag.IN_SCAN) == 0)
    if outside:
        yield f"{outside} of its samples are outside the board's scan"


def _check_batches(scan: RecordedScan) -> Iterator[str]:
    """Check that batches follow each other, as long and as far along as the scan."""
    numbers = scan.batches["batch"].tolist()
    expected = max(-(-scan.count // BATCH_SAMPLES), max(numbers, default=-1) + 1)
    if expected > len(numbers) + MAX_MISSING:
        yield f"it has {scan.count} samples, but {len(numbers)} batches are recorded"
        return
    missing = sorted(set(range(expected)) - set(numbers))
    if missing:
        yield f"batch {', '.join(map(str, missing))} is not recorded"
        return
    if numbers != list(range(len(numbers))):
        yield "its batches are recorded twice or out of order"
        return
    samples = scan.batches["samples"].astype(np.int64)
    lost_first = scan.n_scanned - scan.count
    if np.any(samples[:-1] != BATCH_SAMPLES):
        yield "a batch before its last one is short"
    elif lost_first < 0 or (lost_first and not scan.flags[0] & SampleFlag.LOST_BEFORE):
        yield f"its batches have {scan.n_scanned} samples, its window {scan.count}"
    elif np.any(scan.at < 0) or np.any(scan.at >= scan.n_scanned):
        yield "it has samples outside its batches"
    moved_nm = np.cumsum(samples * scan.batches["velocity_um_s"])
    wrong = np.flatnonzero(scan.batches["start_nm"] != np.concatenate([[0], moved_nm[:-1]]))
    if len(wrong):
        yield f"batch {wrong[0]} does not begin where its velocities lead"


def _rows_before_a_loss(scan: RecordedScan) -> int:
    """Return the recorded samples before the first batch with one that only the board had."""
    batch = scan.at // BATCH_SAMPLES
    recorded = np.bincount(batch, minlength=len(scan.batches))
    had = scan.batches["samples"].astype(np.int64) - scan.batches["lost_samples"]
    incomplete = np.flatnonzero(recorded < had)
    return int(np.searchsorted(batch, incomplete[0])) if len(incomplete) else len(batch)


def _check_spikes(scan: RecordedScan, known: int) -> Iterator[str]:
    encoder = Encoder(scan.normalisation)
    n_taxels = scan.normalisation.n_taxels
    readings = np.ascontiguousarray(scan.samples[:known])
    scaled = readings if scan.gain is None else scan.gain.apply(readings)
    expected = encoder.encode(scaled)[:, :n_taxels]
    rows, taxels = np.nonzero(expected != scan.spikes[:known])
    if len(rows):
        yield (
            f"its spikes differ from the encoder's in {len(set(rows.tolist()))} samples, first at "
            f"counter {scan.counters[rows[0]]}, taxel {taxels[0] + 1}"
        )


def _check_windows(scan: RecordedScan) -> Iterator[str]:
    spikes = np.zeros((scan.n_scanned, scan.normalisation.n_taxels), np.uint8)
    spikes[scan.at] = scan.spikes
    velocities = scan.batches["velocity_um_s"]
    try:
        expected = scale_windows(spikes, velocities, scan.reference_um_per_s)
    except WrongUse as error:
        yield f"its velocities cannot be scaled: {error}"
        return
    numbers = scan.windows["window"].tolist()
    if numbers != list(range(len(expected.real_ms))):
        yield from _misplaced_windows(numbers, len(expected.real_ms))
        return
    other = np.any(expected.counts != spike_counts(scan.windows), axis=1)
    other |= expected.real_ms != scan.windows["real_ms"]
    if np.any(other):
        listed = ", ".join(map(str, np.flatnonzero(other)))
        yield f"window {listed} differs from the spikes and velocities of the scan"


def _misplaced_windows(numbers: list[int], expected: int) -> Iterator[str]:
    missing = sorted(set(range(expected)) - set(numbers))
    if missing:
        yield f"window {', '.join(map(str, missing))} is not recorded"
    else:
        yield f"it has {len(numbers)} windows, its velocities lead to {expected}"


_TRIALS = (
    *ATTEMPT_RULES,
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


def _value_rules() -> dict[str, tuple[Rule, ...]]:
    """Return the rules of each table's values."""
    places = ("x_mm", "y_mm", "z_mm", "along_mm", "across_mm", "height_mm")
    track = (
        a_time("at_s"),
        one_of("valid", (0, 1)),
        *(within(name, -MAX_MM, MAX_MM, unknown=True) for name in places),
    )
    batches = (
        at_least("batch", 0),
        within("velocity_um_s", 0, MAX_U32),
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
        TRACK: track,
        BATCHES: batches,
        WINDOWS: windows,
        PREDICTIONS: predictions,
        LATENCIES: latencies,
        FINGER_TRIALS: _TRIALS,
    }
    return COMMON_RULES | {table.path: rules for table, rules in tables.items()}


def check_finger_part(part: PartReader, trials: StructuredArray) -> tuple[list[str], list[str]]:
    """Return problems and notes of one part and of its rows of /trials, one line each.

    The spikes and windows of every committed scan must be those of the encoder.
    """
    problems, notes = _check_trials(part, trials)
    wrong, noted = check_recorded(part, _value_rules(), FLAGS, sum(SampleFlag))
    wrong += check_times(part, TRACK, PREDICTIONS)
    return [*problems, *wrong], [*notes, *noted]


def _check_trials(part: PartReader, trials: StructuredArray) -> tuple[list[str], list[str]]:
    columns = read_columns(part, COUNTER)
    tables = part.rows(BATCHES), part.rows(WINDOWS)
    rows = attempt_windows(trials)
    problems, notes = [*check_contents(part), *_check_scan_numbers(trials)], []
    for row, stored in zip(rows, trials, strict=True):
        window = window_rows(columns, part.n_samples, row)
        lines = [*check_attempt(row), *check_window(columns, part.n_samples, row)]
        if window:
            wrong, noted = check_scan(_recorded_scan(part, window, stored, tables))
            lines += wrong
            notes += [f"{row.name}: {line}" for line in noted]
        problems += [f"{row.name}: {line}" for line in lines]
    return [*problems, *check_overlap(rows)], notes


def _recorded_scan(
    part: PartReader,
    window: range,
    trial: np.void,
    tables: tuple[StructuredArray, StructuredArray],
) -> RecordedScan:
    batches, windows = (rows[rows["scan"] == trial["scan"]] for rows in tables)
    counters, samples, spikes, flags = (
        part.read(path, window.start, window.stop) for path in (COUNTER, SAMPLES, SPIKES, FLAGS)
    )
    ranges = board_ranges(part.header)
    return RecordedScan(
        first_counter=int(trial["first_counter"]),
        count=int(trial["count"]),
        counters=counters,
        samples=samples,
        spikes=spikes,
        flags=flags,
        batches=batches,
        windows=windows,
        normalisation=ranges,
        reference_um_per_s=part.header.reference_um_per_s,
        gain=part.header.gain(ranges),
    )


def _check_scan_numbers(trials: StructuredArray) -> Iterator[str]:
    """Check that each scan of a part has a number of its own, which its rows are found by."""
    counts = Counter(trials["scan"][trials["first_counter"] >= 0].tolist())
    for scan, count in counts.items():
        if count > 1:
            yield f"the board's scan {scan} is that of {count} attempts"


def check_finger_plan(session: FingerSession) -> list[str]:
    """Return a problem for each attempt that is not at a trial of the plan; an import has none."""
    header = session.header
    if header.rig == IMPORTED:
        return []
    try:
        protocol = parse_finger_protocol(session.protocol_text, layout.PROTOCOL_FILE)
        plan = protocol.plan([Stage(stage) for stage in header.stages], header.seed)
    except (ProtocolError, ValueError) as error:
        return [f"the protocol in the session is not readable: {error}"]
    if plan.hash != header.plan_hash:
        return ["the plan hash does not match the session's protocol, stages and seed"]
    planned = {trial.trial_id: astuple(trial)[1:] for trial in plan.trials}
    return [
        f"{layout.part_name(row.part)}: trial {row.trial_id} is not in the plan"
        for index, row in enumerate(map(session.trial_row, range(len(session.trials))))
        if index not in session.left_out
        and planned.get(row.trial_id) != (row.stage, row.texture, row.profile, row.repeat)
    ]
