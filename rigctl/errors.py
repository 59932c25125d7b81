"""Errors that users see, with the exit code of each.

A message says what failed, where, and what to do, without a traceback.
"""


class RigctlError(Exception):
    """Base of all errors that users see."""

    exit_code = 3


class CheckFailed(RigctlError):
    """A check was made and its result is negative."""

    exit_code = 1


class WrongUse(RigctlError):
    """The request was impossible; nothing was changed.

    ``key_path``, ``line`` and ``reason`` are those of a wrong key of a TOML text, else empty: the
    path of the key, the line from 1, and the message without the place.
    """

    exit_code = 2
    key_path: tuple[str | int, ...] = ()
    line: int = 0
    reason: str = ""


class ConfigError(WrongUse):
    """A description of a rig or a world that cannot be used; the message names file and key."""


class ProtocolError(WrongUse):
    """A trial protocol that cannot be run; the message names file, line or key."""


class SessionError(WrongUse):
    """A folder that is not a session, is in use, or is damaged."""


class WorkersLost(RigctlError):
    """The worker processes or machines of an analysis are gone; no report was made."""


class RigFault(RigctlError):
    """The bench failed; the rig was made safe and recorded data is kept."""


class LinkLost(RigFault):
    """A port vanished or fell silent."""


class BoardRebooted(LinkLost):
    """The board rebooted without a request and has its default settings: connect it again."""


class WrongBoard(RigFault):
    """Another board or another firmware than expected answered."""


class CommandRefused(RigFault):
    """The board refused: wrong state, or a value out of range; nothing changed."""


class BoardFault(RigFault):
    """The board latched a fault; a command clears it once the cause is gone."""


class DiskFault(RigFault):
    """The disk is full or not writable; a run stops and its committed trials are kept."""
