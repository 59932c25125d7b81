"""What can go wrong, named by who is guilty and how a program should end.

::

    RigctlError                     every failure that a user can meet; one sentence with the cure
    ├── NegativeAnswer   exit 1     the question was answered, and the answer is no (verify, check)
    ├── WrongUse         exit 2     the user asked for something impossible; nothing was touched
    │   ├── ConfigError             rig.toml or a world file: names file and key
    │   ├── ProtocolError           protocols/*.toml: names file, line or key
    │   └── SessionError            a folder that is not a session, is locked, or is damaged
    ├── CrewLost         exit 3     the processes or machines that worked for an analysis are gone
    └── RigFault         exit 3     the bench failed; the rig is safe, what was recorded is kept
        ├── LinkLost                a port vanished or fell silent
        ├── WrongBoard              somebody answered, but not the board or firmware asked for
        ├── CommandRefused          the board said no: wrong state or out of range
        ├── BoardFault              the board latched a fault
        └── DiskFault               the recorder cannot write

A message says what failed, where, and what to do. It never needs a traceback beside it.
"""


class RigctlError(Exception):
    """Base of every failure a user can meet."""

    exit_code = 3


class NegativeAnswer(RigctlError):
    """The question was answered, and the answer is no."""

    exit_code = 1


class WrongUse(RigctlError):
    """The request was impossible; nothing was touched."""

    exit_code = 2


class ConfigError(WrongUse):
    """A description of a rig or a world that cannot be used; the message names file and key."""


class ProtocolError(WrongUse):
    """A trial protocol that cannot be run; the message names file, line or key."""


class SessionError(WrongUse):
    """A folder that is not a session, is in use, or is damaged."""


class WorkersLost(RigctlError):
    """Processes or machines that worked for an analysis are gone; no report was made."""


class RigFault(RigctlError):
    """The bench failed; the rig was made safe and what was recorded is kept."""


class LinkLost(RigFault):
    """A port vanished or fell silent."""


class BoardRebooted(LinkLost):
    """The board rebooted by itself: its settings are the defaults, connect it again."""


class WrongBoard(RigFault):
    """Somebody answered, but not the board or the firmware that was asked for."""


class CommandRefused(RigFault):
    """The board refused: wrong state, or a value out of range; nothing changed."""


class BoardFault(RigFault):
    """The board latched a fault; it clears by command once the cause is gone."""


class DiskFault(RigFault):
    """The recorder cannot write; the run stops and committed trials are kept."""
