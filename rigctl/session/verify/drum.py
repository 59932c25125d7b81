"""Check a drum session's trials against its plan, and the simulated bench's own log."""

from __future__ import annotations

from rigctl.errors import RigctlError, SessionError
from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.plan import Plan
from rigctl.session.files.ground_truth import summarise_truth
from rigctl.session.files.truth_file import PARTIAL, log_number, log_paths, open_truth
from rigctl.session.format import file_names
from rigctl.session.format.table_rows import parse_trial
from rigctl.session.read.session import Session
from rigctl.session.verify.report import OnProgress, VerifyReport

WORLD = "the world's own log"
PROGRESS_INTERVAL_TRIALS = 500


def check_drum_plan(session: Session, report: VerifyReport) -> None:
    """Check that each attempt is at a trial of the plan."""
    plan = _rebuild_plan(session, report)
    if plan is not None:
        planned = {trial.trial_id: trial for trial in plan.trials}
        for index, row in enumerate(map(parse_trial, session.trials)):
            if index not in session.left_out and planned.get(row.trial.trial_id) != row.trial:
                name = file_names.part_name(row.part)
                report.problems.append(f"{name}: trial {row.trial.trial_id} is not in the plan")


def _rebuild_plan(session: Session, report: VerifyReport) -> Plan | None:
    """Return the plan from the protocol and seed; its hash must match the recorded one."""
    if not session.protocol_text:
        report.notes.append("the session has no protocol, so its trials have no plan")
        return None
    try:
        protocol = parse_protocol(session.protocol_text, file_names.PROTOCOL_FILE, session.config)
    except RigctlError as error:
        report.problems.append(f"the protocol in the session is not readable: {error}")
        return None
    plan = protocol.plan(session.header.seed)
    if plan.hash != session.header.plan_hash:
        report.problems.append("the plan hash does not match the session's protocol and seed")
        return None
    return plan


def check_truth(
    session: Session, report: VerifyReport, on_progress: OnProgress, done_share: float
) -> None:
    """Compare the committed trials with the simulated bench's own log.

    ``done_share`` is the share of the work that is done already.
    """

    def on_trial(done: int, trials: int) -> None:
        if done % PROGRESS_INTERVAL_TRIALS == 0:
            on_progress(done_share + (1.0 - done_share) * done / trials, WORLD)

    _check_logs(session, report)
    truth = summarise_truth(session, on_trial)
    if truth is None:
        if session.header.simulated:
            report.notes.append("recorded at a simulated bench; the world's own log is missing")
    elif not truth["trials"]:
        report.notes.append("recorded at a simulated bench; its log holds no committed trial")
    else:
        report.notes.append(
            f"recorded at a simulated bench; its log holds {truth['trials']} trials; largest "
            f"error {truth['max_speed_error_permille']} ‰ in speed, "
            f"{truth['max_force_error_permille']} ‰ in force"
        )


def _check_logs(session: Session, report: VerifyReport) -> None:
    """Check every log by its digests; note the partial ones."""
    for path in log_paths(session.path):
        try:
            with open_truth(path) as log:
                log.check()
                if log.sitting != log_number(path):
                    report.problems.append(
                        f"{path.name}: is the log of sitting {log.sitting}, it was copied or "
                        "renamed: give it its own name, or remove the copy"
                    )
                if path.suffix == PARTIAL:
                    report.notes.append(
                        f"{path.name}: the log of the simulated world was not closed, its writer "
                        f"was killed or could not write; it holds {log.n_rows / 1000:g} s"
                    )
        except SessionError as error:
            report.problems.append(str(error))
