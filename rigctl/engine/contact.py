"""What a drum that is switched off does to the sensor: an E-stop leaves it pressed."""

from __future__ import annotations

from rigctl.boards.drum_codes import Status
from rigctl.boards.drum_states import State
from rigctl.values import DrumState

PRESSING_STATES = (State.APPROACH, State.HOLD, State.RUN)
RESTING_STATES = (State.BOOT, State.SELFTEST, State.IDLE, State.ARMED, State.FAULT_OFF)
STILL_IN_CONTACT = "still in contact with the sensor"
MAY_BE_IN_CONTACT = "it may rest on the sensor"
_REMEDY = {
    State.IDLE: "arm it, which lifts it off",
    State.FAULT_OFF: "clear the fault, then arm it, which lifts it off",
}


def has_status(drum: DrumState, bit: Status) -> bool:
    """Return whether a bit of the drum's status is set."""
    return bool(drum.status_bits >> bit & 1)


def is_left_in_contact(drum: DrumState) -> bool:
    """Return whether the drum is switched off where it pressed; no tare is from before a boot."""
    may_stand = has_status(drum, Status.CONTACT_MAY_STAND)
    return drum.state in _REMEDY and may_stand and has_status(drum, Status.TARED)


def contact_words(drum: DrumState) -> str:
    """Return what is known of the contact of a drum that is switched off; empty once lifted."""
    if is_left_in_contact(drum):
        return STILL_IN_CONTACT
    may_stand = has_status(drum, Status.CONTACT_MAY_STAND)
    return MAY_BE_IN_CONTACT if drum.state == State.IDLE and may_stand else ""


def contact_sentence(drum: DrumState) -> str:
    """Return how a drum that was left in contact is lifted off."""
    return f"the drum is off and {STILL_IN_CONTACT}: {_REMEDY[State(drum.state)]}"
