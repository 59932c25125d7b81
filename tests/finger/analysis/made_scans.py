"""Scans of made-up textures: each taxel fires at a rate that depends on its place on the plate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.normalisation import Normalisation
from rigctl.finger.analysis.scans import FingerDataSet, ScanRecording, ScanSet, scan_set
from rigctl.finger.values import Stage, VelocityProfile

TEXTURES = ("A", "B", "D", "L", "N")
RANGES = Normalisation.full_scale(9)
ENDS_MM_S = {
    VelocityProfile.SLOW: (70, 70),
    VelocityProfile.MEDIUM: (120, 120),
    VelocityProfile.FAST: (180, 180),
    VelocityProfile.SLOW_TO_FAST: (70, 180),
    VelocityProfile.FAST_TO_SLOW: (180, 70),
}


def made_recordings(
    stages: dict[Stage, int],
    seed: int,
    *,
    contrast: float = 0.02,
    textures: tuple[str, ...] = TEXTURES,
) -> list[ScanRecording]:
    """Return scans: ``stages`` has the repeats of each texture and profile.

    ``contrast``: how much the rate of a taxel varies along the plate, in spikes a millisecond.
    """
    random = np.random.default_rng(seed)
    order = [
        (stage, texture, profile)
        for stage, repeats in stages.items()
        for texture in textures
        for profile in VelocityProfile
        for _ in range(repeats)
    ]
    return [_recording(number, *one, contrast, random) for number, one in enumerate(order, start=1)]


def made_scans(stages: dict[Stage, int], seed: int, contrast: float = 0.02) -> ScanSet:
    """Return the set of made-up scans."""
    return scan_set(
        f"session {seed}", made_recordings(stages, seed, contrast=contrast), RANGES, simulated=True
    )


def made_data_set(seed: int, repeats: int = 2, contrast: float = 0.02) -> FingerDataSet:
    """Return a data set whose calibration has half as many repeats."""
    first = made_scans({Stage.TRAIN: repeats}, 2 * seed, contrast)
    stages = {Stage.CALIBRATE: max(repeats // 2, 1), Stage.RUN: repeats}
    new = made_scans(stages, 2 * seed + 1, contrast)
    return FingerDataSet.from_sessions(f"set {seed}", first, new)


def _recording(
    number: int,
    stage: Stage,
    texture: str,
    profile: VelocityProfile,
    contrast: float,
    random: np.random.Generator,
) -> ScanRecording:
    begin, end = ENDS_MM_S[profile]
    factor = random.uniform(0.9, 1.1)
    samples = round(200_000 / ((begin + end) / 2 * factor))
    speed_mm_s = np.linspace(begin, end, samples) * factor
    along_mm = np.cumsum(speed_mm_s) / 1000.0
    spikes = random.random((samples, 9)) < 0.06 + contrast * _pattern(texture, along_mm)
    pressure = random.uniform(0.8, 1.2)
    readings = np.clip(500 * pressure + random.normal(0, 10, (samples, 9)), 0, 1023)
    means = [speed_mm_s[at : at + 100].mean() for at in range(0, samples, 100)]
    velocities = np.array([round(1000 * mean) for mean in means], np.int64)
    encoded = spikes.astype(np.uint8)
    return ScanRecording(
        readings.astype(np.uint16), encoded, velocities, texture, profile, stage, number
    )


def _pattern(texture: str, along_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each taxel's modulation along a plate, float64 (n, 9), −1 to 1."""
    random = np.random.default_rng([ord(texture), 7])
    period_mm, phase = random.uniform(30, 80, 9), random.uniform(0, 2 * np.pi, 9)
    return np.asarray(np.sin(2 * np.pi * along_mm[:, None] / period_mm + phase))
