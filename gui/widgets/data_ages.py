"""How old the newest data of each source are, and from when on they are no longer live."""

from __future__ import annotations

from dataclasses import dataclass

from gui.widgets.formatting import duration
from rigctl.acquisition.rpc.messages import EngineStatus

STALE_S = 0.4
"""Values this old are shown grey with their age; data come at least ten times a second."""


@dataclass(frozen=True, slots=True)
class DataAges:
    """Seconds since the newest data of each source; None before any."""

    engine_s: float | None = None
    drum_s: float | None = None
    loadcell_s: float | None = None
    taxels_s: float | None = None


def data_ages(status: EngineStatus, since_status_s: float) -> DataAges:
    """Return the ages that a status reported, ``since_status_s`` after it came."""

    def older(age_s: float | None) -> float | None:
        return None if age_s is None else age_s + since_status_s

    return DataAges(
        since_status_s,
        older(status.poll_age_s),
        older(status.loadcell_age_s),
        older(status.last_block_age_s),
    )


def stale_words(age_s: float | None) -> str:
    """Return the age of data that are no longer live, empty for live ones and before any."""
    if age_s is None or age_s <= STALE_S:
        return ""
    if age_s < 10:
        return f"{age_s:.1f} s old"
    whole_s = age_s if age_s < 60 else age_s - age_s % 60  # a narrow plot has no room for both
    return f"{duration(whole_s).removesuffix(' 00 s')} old"
