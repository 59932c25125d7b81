"""The constants of the real-time experiment's analysis: ``[finger]`` of an analysis file."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.analysis.settings import LEAST_SHARE, MAX_COMPONENTS, MAX_DRAWS, MAX_SPEED_MM_S
from rigctl.config.toml_reader import number, text, texts
from rigctl.encoder.features import WINDOW_MS
from rigctl.finger import published
from rigctl.finger.scaled_time import N_WINDOWS, Gaps
from rigctl.finger.values import VelocityProfile

PROFILES = tuple(str(profile) for profile in VelocityProfile)


@dataclass(frozen=True, slots=True)
class FingerAnalysisSettings:
    """The real-time experiment. A reference speed of 0 stands for that of the sessions.

    Empty untrained profiles stand for all others. The paper's reference speed is 100 mm/s.
    """

    draws: int = number(published.DRAWS, "", 1, MAX_DRAWS, "random draws of each data set")
    folds: int = number(published.N_FOLDS, "", 2, 100, "folds in the same session (Figure 4B)")
    trained_share: float = number(
        published.TRAINED_SHARE, "", LEAST_SHARE, 1, "share of the training scans in a draw"
    )
    components: int = number(
        published.COMPONENTS, "", 1, MAX_COMPONENTS, "components of the deployed classifier"
    )
    session_components: int = number(
        published.SAME_SESSION.k_max, "", 1, MAX_COMPONENTS, "components at most in Figure 4B"
    )
    profile_components: int = number(
        published.TRAINED.k_max, "", 1, MAX_COMPONENTS, "components at most in Figure 4C"
    )
    deployed_components: int = number(
        published.DEPLOYED.k_max, "", 1, MAX_COMPONENTS, "components at most in Figure S5"
    )
    trained_profiles: tuple[str, ...] = texts(
        tuple(map(str, published.TRAINED_PROFILES)), "velocity profiles to train on", PROFILES
    )
    untrained_profiles: tuple[str, ...] = texts(
        (), "velocity profiles to test without training; none: all others", PROFILES
    )
    windows: int = number(N_WINDOWS, "", 1, 1000, "windows of a scan")
    window_ms: int = number(WINDOW_MS, "ms", 10, 1000, "length of a window, at the reference speed")
    gaps: str = text(
        Gaps.SPLIT.value, "gap across two batches: split at their border, or whole", tuple(Gaps)
    )
    reference_speed_mm_s: float = number(
        0.0, "mm/s", 0, MAX_SPEED_MM_S, "speed to which time is scaled; 0: that of the sessions"
    )

    def k_max(self, task: published.FingerTask) -> int:
        """Return the largest number of components of a task."""
        by_figure = {
            published.SAME_SESSION.figure: self.session_components,
            published.TRAINED.figure: self.profile_components,
            published.DEPLOYED.figure: self.deployed_components,
        }
        return by_figure[task.figure]
