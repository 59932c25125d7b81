"""How far the features of one texture differ between velocity profiles.

Scaled time is exact, but the neuron is not a copy of its input: it adapts, and its rate follows a
fast ridge less than a slow one. What remains after scaling is measured here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.finger.scans import ScanKind, ScanSet
from rigctl.protocol.finger import VelocityProfile

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ProfileDifferences:
    """``rate_hz``: mean rate by profile, over textures and taxels. Shares of the features' variance
    (η²): ``texture_share`` by the texture, ``profile_share`` by the profile within a texture,
    and the rest varies between scans of one texture and profile.
    """

    kind: ScanKind
    rate_hz: dict[str, float]
    texture_share: float
    profile_share: float

    @property
    def spread(self) -> float:
        """Largest less smallest mean rate, relative to their mean."""
        rates = np.array(list(self.rate_hz.values()))
        return float(np.ptp(rates) / rates.mean()) if rates.mean() > 0 else 0.0


def profile_differences(scans: ScanSet, kind: ScanKind) -> ProfileDifferences:
    """Return the differences between profiles in a session's scans."""
    features = scans.features(kind)
    names = [str(profile) for profile in VelocityProfile if (scans.profile == profile).any()]
    rates = {name: float(features[scans.profile == name].mean()) for name in names}
    total = _scatter(features, np.zeros(len(scans), np.int64))
    texture = scans.labels(scans.textures)
    both = texture * len(names) + np.array([names.index(p) for p in scans.profile.tolist()])
    within_texture, within_both = _scatter(features, texture), _scatter(features, both)
    if total == 0:
        return ProfileDifferences(kind, rates, 0.0, 0.0)
    return ProfileDifferences(
        kind, rates, 1.0 - within_texture / total, (within_texture - within_both) / total
    )


def _scatter(features: Floats, groups: NDArray[np.int64]) -> float:
    """Return the sum of squared deviations from the mean of each group."""
    return sum(
        float(((rows - rows.mean(axis=0)) ** 2).sum())
        for group in np.unique(groups)
        for rows in [features[groups == group]]
    )
