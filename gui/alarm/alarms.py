"""The alarms of a status: what is wrong, which session it concerns, and how to go on."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from gui.widgets.formatting import capitalised
from rigctl.acquisition.rpc.messages import DISCONNECTED_TEXT, EngineStatus, RunStatus
from rigctl.wire.drum.states import State

RELEASE_FIRST = "Release the emergency stop first"
CONTINUE = "Protocol → Continue a session … runs the remaining trials"


class Alarm(NamedTuple):
    """What is wrong, in a title and a text; ``command`` is what its button sends to the engine.

    ``blocked``: why the button is off, empty where it is on. ``key`` is the same while it is the
    same alarm. One that ``stays`` is over only when the user dismisses it.
    """

    key: str
    title: str
    text: str
    command: str = ""
    button: str = ""
    blocked: str = ""
    stays: bool = False


def status_alarms(status: EngineStatus) -> list[Alarm]:
    """Return the alarms of a status, the most important first.

    A drum that does not answer comes before its fault, which is an old value that nothing clears.
    """
    of_drum, links = (_fault(status), _contact(status)), _links(status)
    first = (*of_drum, links) if status.drum_connected else (links, *of_drum)
    return [alarm for alarm in (*first, _run_end(status.run)) if alarm is not None]


def lost_engine(reason: str, last: EngineStatus) -> Alarm:
    """Return the alarm of an engine that has ended or is out of reach, after its last status."""
    if reason == DISCONNECTED_TEXT:
        return Alarm("lost", "CONNECTION LOST", f"{capitalised(reason)}.", stays=True)
    text = f"{capitalised(reason)}. {_how_to_go_on(last.run)}"
    return Alarm("lost", "ENGINE LOST", text, stays=True)


def silent_engine(last: EngineStatus) -> Alarm:
    """Return the alarm of an engine that does not answer, after its last status."""
    text = "The engine does not answer: press the emergency stop at the rig if the drum moves."
    session = f" It recorded {_session(last.run)}." if last.run.is_active else ""
    return Alarm("silent", "ENGINE SILENT", text + session)


def _fault(status: EngineStatus) -> Alarm | None:
    if not status.fault:
        return None
    contact = " The drum is still in contact with the sensor." if status.is_left_in_contact else ""
    words = f"{capitalised(status.fault_words)}.{contact}"
    session = f" Session: {_session(status.run)}." if status.run.is_active else ""
    can_clear = status.state is State.FAULT_OFF and not status.run.is_active
    button = ("clear_fault", "Clear fault") if can_clear else ("", "")
    blocked = RELEASE_FIRST if status.estop_pressed else ""
    return Alarm(f"fault {status.fault}", "FAULT", words + session, *button, blocked)


def _contact(status: EngineStatus) -> Alarm | None:
    if status.fault or not status.is_left_in_contact:
        return None
    text = "The drum is off and still in contact with the sensor. Lift it before anything else."
    button = ("", "") if status.run.is_active else ("arm", "Lift the drum")
    return Alarm("contact", "STILL IN CONTACT", text, *button)


def _links(status: EngineStatus) -> Alarm | None:
    boards = {"drum": status.drum_connected, "taxel": status.taxels_connected}
    lost = [name for name, connected in boards.items() if not connected]
    if not lost or not status.boards:
        return None
    text = f"No {' and no '.join(lost)} board answers: check its cable and its supply."
    session = f" The run of {_session(status.run)} waits for it." if status.run.is_active else ""
    return Alarm(f"link {lost}", "BOARD LOST", text + session)


def _run_end(run: RunStatus) -> Alarm | None:
    if run.state != "failed":
        return None
    text = f"{capitalised(run.text.rstrip('.'))}. {_how_to_go_on(run)}"
    return Alarm(f"run {run.session}", "RUN FAILED", text, stays=True)


def _how_to_go_on(run: RunStatus) -> str:
    if not run.session:
        return "Connect starts it again."
    connect = "" if run.state == "failed" else "Connect starts it again; "
    return f"{_session(run)} is kept. {connect}{CONTINUE}."


def _session(run: RunStatus) -> str:
    """Return a session's name, and how many of its trials are recorded."""
    name = Path(run.session).name if run.session else "no session"
    return f"{name} ({run.trials_committed} of {run.trials_planned} trials)"
