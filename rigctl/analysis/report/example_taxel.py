"""The trial and taxel that a figure shows, and the origin of the data."""

from __future__ import annotations

from rigctl.analysis.trial_set import TrialSet
from rigctl.errors import WrongUse
from rigctl.session.header import IMPORTED

SHOWN_TRIAL = ("L", 80.0, 500.0)
"""Texture, speed and force of the paper's Figure 2C."""


def trials_origin(trials: TrialSet) -> str:
    """Return the origin of the data, for the foot of a figure."""
    rigs = {str(source["rig"]) for source in trials.provenance}
    bench = "Imported recordings" if rigs == {IMPORTED} else "Real bench"
    bench = "Simulated bench" if trials.simulated else bench
    first, n = trials.paths[0].name, len(trials.paths)
    rest = f" and {n - 1} more" if n > 1 else ""
    return f"{bench} · session {first}{rest} · {len(trials.trials):,} trials"


def check_selection(trials: TrialSet, trial: int | None, taxel: int | None) -> None:
    """Raise WrongUse for a trial or a taxel, counted from 1, that the set does not have."""
    if taxel is not None and not 1 <= taxel <= trials.n_taxels:
        raise WrongUse(f"there is no taxel {taxel}: choose 1 to {trials.n_taxels}")
    if trial is not None and not any(t.trial_id == trial for t in trials.trials):
        raise WrongUse(f"no session has a committed trial {trial} with motion")


def chosen_trial(trials: TrialSet, trial_id: int | None = None) -> int:
    """Return the row of a trial, by default of that nearest to the paper's Figure 2C.

    Of several sessions with a trial of this number, the first counts. Raises WrongUse for a trial
    with gaps.
    """
    texture, speed, force = SHOWN_TRIAL
    if trial_id is not None:
        matching = [row for row, t in enumerate(trials.trials) if t.trial_id == trial_id]
        if not matching:
            raise WrongUse(f"trial {trial_id} has gaps or no C: choose another for the figure")
        return matching[0]

    def distance(row: int) -> tuple[bool, float, float]:
        t = trials.trials[row]
        return t.texture != texture, abs(t.speed_mm_s - speed), abs(t.force_g - force)

    return min(range(len(trials.trials)), key=distance)
