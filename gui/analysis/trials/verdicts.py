"""What the trial table says of an attempt: its verdict, or that it is left out, and why."""

from __future__ import annotations

from typing import Any

LEFT_OUT = "left out"


def shown_verdicts(session: Any) -> list[str]:
    """Return the verdict of each attempt of an open session.

    An attempt that does not count though the recorder committed it (marked bad by a note, or cut
    short) is left out.
    """
    verdicts = session.trials["verdict"].tolist()
    for row in session.left_out:
        verdicts[row] = LEFT_OUT
    return list(map(str, verdicts))


def shown_reasons(session: Any) -> list[str]:
    """Return why each attempt of an open session does not count, empty for one that does."""
    reasons = session.trials["reasons"].tolist()
    for row, reason in session.left_out.items():
        reasons[row] = reason
    return list(map(str, reasons))
