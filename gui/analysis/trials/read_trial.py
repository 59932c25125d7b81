"""Read one recorded attempt of the drum with everything that its views show."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gui.analysis.tasks.task_values import BLOCK, TrialCourse, TrialData, TrialFeatures

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rigctl.encoding.normalisation import Normalisation
    from rigctl.session.session import Session
    from rigctl.values import Spikes

MANY_SAMPLES = 100_000
N_WARM_TAXELS, N_WARM_SAMPLES, WARM_MM_S = 18, 100, 40.0


def read_trial(session: Session, row: int, taxel_range: Normalisation) -> TrialData:
    """Return the samples, spikes, drum and features of an attempt. Raises SessionError."""
    from rigctl.encoding.encoder import encode_trials

    trial = session.trials[row]
    samples = np.ascontiguousarray(session.samples(row))
    title = (
        f"Trial {trial['trial_id']}: plate {trial['texture']}, {trial['speed_mm_s']:g} mm/s, "
        f"{trial['force_g']:g} g, {trial['verdict']}"
    )
    (spikes,) = encode_trials([samples], taxel_range)
    trains = [spikes.train(lane) for lane in range(spikes.n_trains)]
    lanes = np.repeat(np.arange(len(trains)), list(map(len, trains)))
    return TrialData(
        title,
        samples,
        lanes,
        np.concatenate(trains).astype(np.int64),
        session.sensor_layout,
        _course(session, row),
        _features(spikes, float(trial["speed_mm_s"])),
        session.header.simulated,
        block_extremes(samples) if len(samples) > MANY_SAMPLES else None,
    )


def block_extremes(samples: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Return the lowest and highest readings of whole blocks, (2, n // BLOCK, n_taxels)."""
    n_blocks = len(samples) // BLOCK
    blocks = samples[: n_blocks * BLOCK].reshape(n_blocks, BLOCK, samples.shape[1])
    return np.stack([blocks.min(axis=1), blocks.max(axis=1)])


def load_encoder() -> None:
    """Load the compiled encoder by a trial of zeros, so that the first trial is drawn at once."""
    from rigctl.encoding.encoder import encode_trials
    from rigctl.encoding.normalisation import Normalisation

    full = np.full(N_WARM_TAXELS, 1023, np.uint16)
    taxel_range = Normalisation(np.zeros_like(full), full, "none")
    (spikes,) = encode_trials([np.zeros((N_WARM_SAMPLES, len(full)), np.uint16)], taxel_range)
    _features(spikes, WARM_MM_S)


def _course(session: Session, row: int) -> TrialCourse:
    trial, drum = session.trials[row], session.drum(row)
    return TrialCourse(
        np.array(drum.loadcell_s),
        np.array(drum.loadcell["force_g"], np.float64),
        np.array(drum.polls_s),
        np.array(drum.polls["speed_mm_s"], np.float64),
        float(trial["force_g"]),
        float(trial["speed_mm_s"]),
    )


def _features(spikes: Spikes, speed_mm_s: float) -> TrialFeatures:
    """Return the speed-scaled features, or those of plain time for a trial without motion."""
    from rigctl.encoding.features import FeatureLayout, trial_features

    is_scaled = speed_mm_s > 0
    layout = FeatureLayout.covering([spikes.n_samples], [speed_mm_s], scaled=is_scaled)
    values = trial_features(spikes, speed_mm_s, layout).reshape(spikes.n_trains, -1)
    window_mm = layout.reference_mm_s * layout.window_ms / 1000 if is_scaled else 0.0
    return TrialFeatures(values, window_mm, layout.window_ms)
