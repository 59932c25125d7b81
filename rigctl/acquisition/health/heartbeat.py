"""The condition for the heartbeat: every part of the engine checks in."""

from __future__ import annotations

from collections.abc import Callable

CHECK_IN_LIMIT_S = 1.0


class HeartbeatGate:
    """Last check-in of each part, in loop time.

    A part counts from its first :meth:`check_in` until :meth:`check_out`. One that is silent for
    longer than the limit blocks the heartbeat; without it the drum ramps down and lifts.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._checked_in_s: dict[str, float] = {}

    def check_in(self, name: str) -> None:
        """Record that ``name`` is alive now."""
        self._checked_in_s[name] = self._now_s()

    def check_out(self, name: str) -> None:
        """Expect no more check-ins of ``name``."""
        self._checked_in_s.pop(name, None)

    @property
    def overdue(self) -> list[str]:
        """Names whose check-in is overdue."""
        oldest_s = self._now_s() - CHECK_IN_LIMIT_S
        return [name for name, at_s in self._checked_in_s.items() if at_s < oldest_s]

    def is_open(self) -> bool:
        """Return whether the heartbeat may be sent."""
        return not self.overdue
