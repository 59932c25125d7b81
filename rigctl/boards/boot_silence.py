"""Silence while a board's bootloader may be listening, because every byte holds it there.

Opening a serial port resets most Arduinos into their bootloader, and so do the reset button and a
dip of the supply. A Mega's stays as long as bytes come in its first 0.83 s, and afterwards until
4.3 s of silence; those of Uno and Nano give up within 1.4 s (decision 41).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress

from rigctl.boards.links import ByteLink

WATCHDOG_INTERVAL_S = 0.05


class SilenceWatch:
    """Calls ``on_silence`` where nothing is heard for ``timeout_s``, or up to 50 ms later.

    ``heard_s``: loop time at which something was heard last, 0 before.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, timeout_s: float, on_silence: Callable[[], None]
    ) -> None:
        self.heard_s = 0.0
        self._loop = loop
        self._timeout_s = timeout_s
        self._on_silence = on_silence
        self._timer: asyncio.TimerHandle | None = None

    @property
    def running(self) -> bool:
        """True between start and stop."""
        return self._timer is not None

    def start(self) -> None:
        """Start to watch: silence counts from now."""
        self.stop()
        self.heard_s = self._loop.time()
        self._schedule(self.heard_s + WATCHDOG_INTERVAL_S)

    def stop(self) -> None:
        """Stop to watch; stopping twice is harmless."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _schedule(self, at_s: float) -> None:
        self._timer = self._loop.call_at(at_s, self._check, at_s)

    def _check(self, due_s: float) -> None:
        """Report silence, unless the loop itself is late and has bytes to read first."""
        now_s = self._loop.time()
        self._schedule(max(self.heard_s + self._timeout_s, now_s + WATCHDOG_INTERVAL_S))
        if now_s - self.heard_s > self._timeout_s and now_s - due_s < WATCHDOG_INTERVAL_S:
            self._on_silence()


AFTER_OPEN_S = 2.0
"""From opening a port on; the slowest bootloader, that of a Mega or an old Nano, needs 1.4 s."""
AFTER_LOSS_S = 5.0
"""After a board that talked does not answer; a Mega's bootloader leaves after 4.3 s."""
ASK_S = 1.0
"""How long a board is asked that does not answer."""
IN_FLIGHT_S = 0.25
"""Bytes that come this soon after opening may have been sent before the reset."""


class BootSilence:
    """Says when the board behind a link may be asked, and until when.

    A link that resets no board is never silent. ``on_begin(text)`` is called with a sentence for
    the user when a silence begins, once until the board has answered; ``hint`` is what else may
    be the matter with a board that talked.
    """

    def __init__(self, link: ByteLink, loop: asyncio.AbstractEventLoop, hint: str = "") -> None:
        self.on_begin: Callable[[str], None] = lambda text: None
        self._link = link
        self._loop = loop
        self._opened_s = self._until_s = self._heard_s = float("-inf")
        self._seconds = 0.0
        self._over = asyncio.Event()
        self._hint = hint
        self._told = ""

    @property
    def is_on(self) -> bool:
        """Whether nothing may be sent now."""
        return self._loop.time() < self._until_s

    @property
    def text(self) -> str:
        """A sentence about the present silence."""
        return (
            f"{self._link.name}: the board's bootloader may be listening: silent for "
            f"{self._seconds:g} s{self._hint if self._seconds == AFTER_LOSS_S else ''}"
        )

    def open_link(
        self, on_bytes: Callable[[bytes, float], None], on_lost: Callable[[str], None]
    ) -> None:
        """Open the link, or take it over where it is open. A reset board is then left in peace."""
        was_open = self._link.is_open
        self._link.open(on_bytes, on_lost)
        if not was_open:
            self._opened_s = self._loop.time()
            self._begin(AFTER_OPEN_S)

    def close_link(self) -> None:
        """Close the link, unless opening it again would reset the board."""
        if not self._link.resets_board:
            self._link.close()

    def hear(self, at_s: float) -> None:
        """Note that the board's program talks, so that no bootloader does."""
        if at_s > self._opened_s + IN_FLIGHT_S:
            self._heard_s, self._told = at_s, ""
            self.end()

    def end(self) -> None:
        """End the silence."""
        self._until_s = min(self._until_s, self._loop.time())
        self._over.set()

    def lose(self) -> bool:
        """Begin the silence after a board that talked did not answer; return whether one is."""
        if self._heard_s > float("-inf"):
            self._begin(AFTER_LOSS_S)
        return self.is_on

    def ask_until_s(self, timeout_s: float) -> float:
        """Return the loop time until which to ask; ``timeout_s``: of a link that resets no board.

        A board that talked is asked until a second after its last answer.
        """
        if not self._link.resets_board:
            return self._loop.time() + timeout_s
        before_s = max(self._heard_s, self._until_s)
        return (before_s if before_s > float("-inf") else self._loop.time()) + ASK_S

    async def wait(self) -> None:
        """Return when the board may be asked."""
        while self.is_on:
            self._over.clear()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._over.wait(), self._until_s - self._loop.time())

    def _begin(self, seconds: float) -> None:
        if self._link.resets_board:
            self._seconds = seconds
            self._until_s = self._loop.time() + seconds
            if self._told != self.text:
                self._told = self.text
                self.on_begin(self.text)
