"""Whether the heartbeat may be sent: only while everybody who must be alive has checked in."""

from __future__ import annotations

from collections.abc import Callable

CHECK_IN_LIMIT_S = 1.0


class HeartbeatGate:
    """Who checked in when, in loop time.

    A name counts from its first :meth:`check_in` until :meth:`excuse`. One that stays silent
    longer than the limit withholds the beat; the drum then ramps down and lifts by itself.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._seen_s: dict[str, float] = {}

    def check_in(self, name: str) -> None:
        """``name`` is alive now."""
        self._seen_s[name] = self._now_s()

    def excuse(self, name: str) -> None:
        """``name`` has nothing to do any more."""
        self._seen_s.pop(name, None)

    @property
    def silent(self) -> list[str]:
        """Names that should have checked in and did not."""
        oldest_s = self._now_s() - CHECK_IN_LIMIT_S
        return [name for name, seen_s in self._seen_s.items() if seen_s < oldest_s]

    def may_beat(self) -> bool:
        """Whether nobody is silent."""
        return not self.silent
