"""The virtual finger's tracker and person as cables that other programs connect to.

The tracker sends the lines of ``docs/reference/trackers.md``, and datagrams where a port is named.
The person reads one command a line and answers each with a line.
"""

from __future__ import annotations

import asyncio
import socket
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from rigctl.errors import WrongUse
from rigctl.finger.bench.tracker import SimulatedTracker
from rigctl.finger.bench.virtual import VirtualFinger
from rigctl.finger.values import VelocityProfile
from rigctl.values import Position

LOOPBACK = "127.0.0.1"
READY_S = 0.02
"""Period at which the person checks whether the hand is free for the next move."""
LONGEST_LINE = 200
LONGEST_LOSS_S = 60.0
COMMANDS = "slide PLATE PROFILE, touch CORNER, or lose SECONDS"

OnBytes = Callable[[bytes, float], None]
OnLost = Callable[[str], None]


class TrackerCable:
    """The tracker's cable: ``time_ms,x,y,z,valid`` in each line, by the tracker's own clock.

    ``udp_port``: a port of this computer that gets each position as a datagram, too.
    """

    name = "tracker"

    def __init__(self, tracker: SimulatedTracker, udp_port: int | None = None) -> None:
        self._tracker = tracker
        self._udp_port = udp_port
        self._socket: socket.socket | None = None
        self._on_bytes: OnBytes | None = None
        self._sequence = 0

    def open(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        """Start to send. Raises LinkLost where the tracker is switched off or in use."""
        self._tracker.open(self._send, on_lost)
        self._on_bytes = on_bytes
        if self._udp_port is not None:
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.setblocking(False)

    def write(self, data: bytes) -> None:
        """Ignore what programs send: a tracker takes no requests."""

    def close(self) -> None:
        """Stop; a second call does nothing."""
        self._tracker.close()
        self._on_bytes = None
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, position: Position) -> None:
        time_ms = self._tracker.measured_us / 1000.0
        _, x, y, z, valid = position
        line = f"{time_ms:.3f},{x:.4f},{y:.4f},{z:.4f},{int(valid)}\n"
        if self._on_bytes is not None:
            self._on_bytes(line.encode(), position.at_s)
        if self._socket is not None and self._udp_port is not None:
            with suppress(OSError):  # nobody listens, or the buffer is full: a datagram is lost
                datagram = f"{self._sequence},{line}".encode()
                self._socket.sendto(datagram, (LOOPBACK, self._udp_port))
        self._sequence += 1


class PersonCable:
    """The line to the person who moves the finger.

    ``slide PLATE PROFILE`` makes one slide, ``touch CORNER`` rests the finger on a corner of the
    plate until the next slide, both as soon as the hand is free; ``lose SECONDS`` hides the tracker
    from its base stations. The answer begins with ``error:`` where that is not possible.
    """

    name = "person"

    def __init__(self, finger: VirtualFinger, loop: asyncio.AbstractEventLoop) -> None:
        self._finger = finger
        self._loop = loop
        self._received = b""
        self._moves: deque[Callable[[], None]] = deque()
        self._timer: asyncio.TimerHandle | None = None
        self._on_bytes: OnBytes | None = None

    def open(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        """Start to answer; a person is never lost."""
        self._on_bytes = on_bytes

    def write(self, data: bytes) -> None:
        """Take bytes of commands, one a line; what is too long for a line is dropped."""
        *lines, rest = (self._received + data).replace(b"\r", b"\n").split(b"\n")
        self._received = rest[-LONGEST_LINE:]
        for line in lines:
            words = line.decode("utf-8", "replace").split()
            if words:
                self._guarded(partial(self._act, words))

    def close(self) -> None:
        """Forget the moves that have not begun, and stop to answer."""
        self._on_bytes = None
        self._moves.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _act(self, words: list[str]) -> None:
        match words:
            case ["slide", plate, profile]:
                self._plan(partial(self._slide, plate, _profile(profile)))
            case ["touch", *corner]:
                self._plan(partial(self._touch, " ".join(corner)))
            case ["lose", seconds]:
                duration_s = _seconds(seconds)
                self._finger.faults.lose_tracker(duration_s)
                self._say(f"losing the tracker for {duration_s:g} s")
            case _:
                raise WrongUse(f"{' '.join(words)!r} is no command: write {COMMANDS}")

    def _plan(self, move: Callable[[], None]) -> None:
        self._moves.append(move)
        if self._timer is None:
            self._begin_moves()

    def _begin_moves(self) -> None:
        """Begin the next move if the hand is free, and look again soon if there are more."""
        self._timer = None
        if self._moves and not self._finger.sliding:
            self._guarded(self._moves.popleft())
        if self._moves:
            self._timer = self._loop.call_later(READY_S, self._begin_moves)

    def _touch(self, corner: str) -> None:
        self._finger.touch_corner(corner)
        self._say(f"touching {corner}")

    def _slide(self, plate: str, profile: VelocityProfile) -> None:
        self._finger.slide(plate, profile)
        self._say(f"sliding {plate} {profile.value}")

    def _guarded(self, act: Callable[[], None]) -> None:
        try:
            act()
        except WrongUse as error:
            self._say(f"error: {error}")

    def _say(self, text: str) -> None:
        if self._on_bytes is not None:
            self._on_bytes(f"{text}\n".encode(), self._loop.time())


def _profile(name: str) -> VelocityProfile:
    known = [profile.value for profile in VelocityProfile]
    if name not in known:
        raise WrongUse(f"there is no profile {name!r}: the profiles are {', '.join(known)}")
    return VelocityProfile(name)


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0.0 < seconds <= LONGEST_LOSS_S:
        raise WrongUse(f"{text!r} is no time: write seconds, up to {LONGEST_LOSS_S:g}")
    return seconds
