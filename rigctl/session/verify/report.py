"""The findings of a check of a session."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(slots=True)
class VerifyReport:
    """Findings of :func:`rigctl.session.verify.session.verify`.

    A problem is one line that begins with the file's name. ``outcome``: how the last sitting
    ended, in words. ``closing_digest``: the last digest of a session that was closed, else empty.
    """

    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    samples: int = 0
    trials_committed: int = 0
    lost_samples: int = 0
    outcome: str = ""
    closing_digest: str = ""

    @property
    def whole(self) -> bool:
        """Whether there is no problem."""
        return not self.problems


OnProgress = Callable[[float, str], None]
"""Takes the share of the work done, 0 to 1, and the next step."""
OnShare = Callable[[float], None]
"""Takes the share of a part that is checked, 0 to 1."""
