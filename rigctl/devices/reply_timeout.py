"""How long to wait for a reply before the question is asked again."""

from __future__ import annotations

USUAL_REPLIES = 8
"""What is usual changes over so many replies."""


class ReplyTimeout:
    """Twice as long as replies took of late, between two bounds.

    ``wait_s`` begins with the longest. A reply that did not come makes it longer: a line that
    got slower is not asked again and again before it can answer.
    """

    def __init__(self, least_s: float, longest_s: float) -> None:
        self._least_s, self._longest_s = least_s, longest_s
        self._usual_s = longest_s

    @property
    def wait_s(self) -> float:
        """Longest wait for the next reply."""
        return min(self._longest_s, max(self._least_s, 2.0 * self._usual_s))

    def answered(self, took_s: float) -> None:
        """A question asked once was answered after so long."""
        self._usual_s = max(took_s, self._usual_s + (took_s - self._usual_s) / USUAL_REPLIES)

    def missed(self) -> None:
        """No reply came within the wait."""
        self._usual_s = min(self._longest_s, self._usual_s + self.wait_s / 16)
