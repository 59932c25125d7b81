"""One taxel of one trial, with its reading, voltages and spikes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigctl.analysis.data.trial_set import TrialRef, TrialSet, open_trials
from rigctl.analysis.report.paper_figures import TaxelData
from rigctl.encoding.encoder import encode_trial, membrane_mv
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.errors import WrongUse
from rigctl.session.format.header import IMPORTED
from rigctl.values import SAMPLE_RATE_HZ

SHOWN_TRIAL = ("L", 80.0, 500.0)
"""Texture, speed and force of the paper's Figure 2C."""
SAMPLES_HEADER = "sample,reading,sa_mv,ra_mv,sa_spikes,ra_spikes"


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


def load_taxel(
    trials: TrialSet,
    ranges: Normalisation,
    parameters: EncoderParameters,
    trial_id: int | None = None,
    taxel: int | None = None,
) -> TaxelData:
    """Return reading, voltages and spikes of a trial and taxel, by default as in Figure 2C.

    The default taxel has the largest standard deviation. Raises WrongUse for a trial with gaps.
    """
    trial = _shown_trial(trials, trial_id)
    with open_trials(trials.files) as reader:
        samples = reader.read(trial)
    x = (samples.astype(np.float64) - ranges.low) * ranges.scale
    index = taxel - 1 if taxel else int(x.std(axis=0).argmax())
    n = trials.n_taxels
    spikes = encode_trial(samples, ranges, parameters)
    voltage = membrane_mv(samples, ranges, parameters)[:, [index, n + index]]
    title = (
        f"Texture {trial.texture} at {trial.speed_mm_s:g} mm/s and {trial.force_g:g} g: "
        f"taxel {index + 1} of trial {trial.trial_id}, up to its first second (as Fig. 2C)"
    )
    trains = (spikes.train(index), spikes.train(n + index))
    return TaxelData(title, trials_origin(trials), x[:, index], voltage, trains)


def write_samples(data: TaxelData, path: Path) -> None:
    """Write each sample as a line of text: reading (0–1), v in mV, spikes."""
    n = len(data.reading)
    counts = [np.bincount(train, minlength=n) for train in data.spikes]
    columns = (np.arange(n), data.reading, *data.membrane_mv.T, *counts)
    formats = ("%d", "%.6f", "%.4f", "%.4f", "%d", "%d")
    comment = f"# {data.title}; {data.origin}; {SAMPLE_RATE_HZ} samples a second\n"
    with path.open("w", encoding="utf-8") as file:
        file.write(f"{comment}{SAMPLES_HEADER}\n")
        np.savetxt(file, np.column_stack(columns), fmt=",".join(formats))


def _shown_trial(trials: TrialSet, trial_id: int | None) -> TrialRef:
    texture, speed, force = SHOWN_TRIAL
    if trial_id is not None:
        matching = [t for t in trials.trials if t.trial_id == trial_id]
        if not matching:
            raise WrongUse(f"trial {trial_id} has gaps: choose another for the figure")
        return matching[0]

    def distance(t: TrialRef) -> tuple[bool, float, float]:
        return t.texture != texture, abs(t.speed_mm_s - speed), abs(t.force_g - force)

    return min(trials.trials, key=distance)
