"""Find the trials that a model was trained on, so that they do not count as a result.

A trial is known by the hash of its samples, in every copy of its session and whatever was recorded
there since. Models from before hashes were kept know whole sessions only, by their content.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.analysis.data.cache import Resources
from rigctl.analysis.data.trial_set import TrialSet
from rigctl.analysis.features.transferred_c import unseen_sessions
from rigctl.session.model_file import Model

_RECORDING = ("plan_hash", "begun_utc", "seed", "simulation_seed")


def find_trained(
    model: Model, trials: TrialSet, hashes: Sequence[int], resources: Resources
) -> list[bool | None]:
    """Return for each trial of a set whether the model was trained on it; None if not known.

    ``hashes``: XXH3 of each trial's samples.
    """
    known = model.training.trial_hashes
    if known is not None:
        return [one in known for one in hashes]
    sources = model.training.inputs
    unseen = set(unseen_sessions(trials, sources, resources))
    recordings = {_recording(source) for source in sources}
    of_session: list[bool | None] = []
    for path, source in zip(trials.paths, trials.provenance, strict=True):
        changed = _recording(source) in recordings
        of_session.append(True if path not in unseen else None if changed else False)
    return [of_session[trial.session] for trial in trials.trials]


def trained_remarks(trained: Sequence[bool | None]) -> list[str]:
    """Return a remark on the trials that the model was trained on, or may have been."""
    remarks = []
    if n := sum(one is True for one in trained):
        remarks.append(
            f"the model was trained on {n} of these {len(trained)} trials: how it names them says "
            "nothing about others"
        )
    if n := sum(one is None for one in trained):
        remarks.append(
            f"{n} trials may be among those that the model was trained on: its file is of an older "
            "version that does not list them, and their session has changed since. Train it again"
        )
    return remarks


def _recording(source: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(source.get(key) for key in _RECORDING)
