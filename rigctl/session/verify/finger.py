"""Check the parts of a session of the moving finger, and its trials against what was planned."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import astuple

import numpy as np

from rigctl.errors import ProtocolError
from rigctl.protocol.finger import Stage
from rigctl.protocol.finger_plan import FingerPlan, parse_finger_protocol
from rigctl.session.format import file_names
from rigctl.session.format.finger_layout import BATCHES, SPIKES, WINDOWS
from rigctl.session.format.layout import COUNTER, FLAGS, SAMPLES
from rigctl.session.read.finger_session import FingerSession, board_ranges
from rigctl.session.read.part import PartReader, StructuredArray
from rigctl.session.verify.finger_scan import RecordedScan, check_scan
from rigctl.session.verify.part_checks import (
    attempt_windows,
    check_attempt,
    check_contents,
    check_overlap,
    check_window,
    read_columns,
    window_rows,
)
from rigctl.session.verify.report import VerifyReport


def check_finger_part(part: PartReader, trials: StructuredArray) -> tuple[list[str], list[str]]:
    """Return problems and notes of one part and of its rows of /trials, one line each.

    The spikes and windows of every committed scan must be those of the encoder.
    """
    columns = read_columns(part, COUNTER)
    tables = part.rows(BATCHES), part.rows(WINDOWS)
    rows = attempt_windows(trials)
    problems, notes = [*check_contents(part), *_check_scan_numbers(trials)], []
    for row, stored in zip(rows, trials, strict=True):
        window = window_rows(columns, part.n_samples, row)
        lines = [*check_attempt(row), *check_window(columns, part.n_samples, row)]
        if window:
            found = check_scan(_recorded_scan(part, window, stored, tables))
            lines += found.problems
            notes += [f"{row.name}: {line}" for line in found.notes]
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
    return RecordedScan(
        first_counter=int(trial["first_counter"]),
        count=int(trial["count"]),
        counters=counters,
        samples=samples,
        spikes=spikes,
        flags=flags,
        batches=batches,
        windows=windows,
        normalisation=board_ranges(part.header),
        reference_um_per_s=part.header.reference_um_per_s,
    )


def _check_scan_numbers(trials: StructuredArray) -> Iterator[str]:
    """Check that each scan of a part has a number of its own, which its rows are found by."""
    counts = Counter(trials["scan"][trials["first_counter"] >= 0].tolist())
    for scan, count in counts.items():
        if count > 1:
            yield f"scan {scan} is that of {count} attempts"


def check_finger_plan(session: FingerSession, report: VerifyReport) -> None:
    """Check that each attempt is at a trial of the plan."""
    plan = _rebuild_plan(session, report)
    if plan is None:
        return
    planned = {trial.trial_id: trial for trial in plan.trials}
    for index in range(len(session.trials)):
        row = session.trial_row(index)
        trial = planned.get(row.trial_id)
        if index in session.left_out:
            continue
        if trial is None or astuple(trial)[1:] != (row.stage, row.texture, row.profile, row.repeat):
            name = file_names.part_name(row.part)
            report.problems.append(f"{name}: trial {row.trial_id} is not in the plan")


def _rebuild_plan(session: FingerSession, report: VerifyReport) -> FingerPlan | None:
    """Return the plan from the protocol, stages and seed; its hash must match the recorded one."""
    header = session.header
    try:
        protocol = parse_finger_protocol(session.protocol_text, file_names.PROTOCOL_FILE)
        plan = protocol.plan([Stage(stage) for stage in header.stages], header.seed)
    except (ProtocolError, ValueError) as error:
        report.problems.append(f"the protocol in the session is not readable: {error}")
        return None
    if plan.hash != header.plan_hash:
        report.problems.append(
            "the plan hash does not match the session's protocol, stages and seed"
        )
        return None
    return plan
