"""Why a run waits, and the words for it, which a window shows."""

from __future__ import annotations

from collections.abc import Iterable

OPERATOR, PROMPT, LINK, DISK, FAULT = "operator", "prompt", "link", "disk", "fault"
_REASON_WORDS = {
    LINK: "a board is lost",
    DISK: "too little disk space",
    FAULT: "a fault of the drum",
    "tracker": "the tracker is lost",
}


def reason_words(reasons: Iterable[str]) -> str:
    """Return what a run waits for in words; a question speaks for itself."""
    return ", ".join(_REASON_WORDS.get(reason, reason) for reason in reasons if reason != PROMPT)
