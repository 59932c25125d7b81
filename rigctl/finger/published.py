"""The real-time experiment as published: its tasks, numbers of trials, and quoted accuracies."""

from __future__ import annotations

from typing import NamedTuple

from rigctl.finger.values import VelocityProfile

DRAWS = 100
N_FOLDS = 4
TRAINED_SHARE = 0.75
COMPONENTS = 25
DEPLOYED_TRIALS = 300
"""Trials of Figure S5: 100 in each of three data sets."""
TRAINED_PROFILES = (VelocityProfile.SLOW, VelocityProfile.MEDIUM)


class QuotedAccuracy(NamedTuple):
    """An accuracy from the text: in per cent, with ``components``, or None for a saturation."""

    percent: float
    components: int | None = None


class FingerTask(NamedTuple):
    """A task of the real-time experiment.

    ``k_max``: the number of components that its training set allows. ``quoted``: Original's and
    Speed Scaled's accuracy. ``claims``: what the paper says of the difference; ``double``: numbers
    of components at which it gives Speed Scaled two asterisks; ``above``: those at which Speed
    Scaled exceeds Original's peak, None where the paper does not say.
    """

    key: str
    title: str
    figure: str
    k_max: int
    quoted: tuple[QuotedAccuracy, QuotedAccuracy]
    claims: str
    double: range
    above: range | None


SAME_SESSION = FingerTask(
    "same-session",
    "Same session",
    "Fig. 4B",
    70,
    (QuotedAccuracy(65.0), QuotedAccuracy(90.0)),
    "Speed Scaled is better at all components (p < 0.01, d > 1)",
    range(1, 71),
    None,
)
NEW_SESSION = FingerTask(
    "new-session",
    "New session",
    "Fig. 4B",
    70,
    (QuotedAccuracy(50.45, 54), QuotedAccuracy(50.0)),
    "both saturate around 50 %; Speed Scaled is better (p < 0.01, d > 1) from 5 to 30 components "
    "and above Original's peak from 10 to 26",
    range(5, 31),
    range(10, 27),
)
TRAINED = FingerTask(
    "trained-profiles",
    "Trained profiles",
    "Fig. 4C",
    25,
    (QuotedAccuracy(38.6, 20), QuotedAccuracy(48.1, 18)),
    "Speed Scaled is above Original's peak from 5 components, ** from 4 to 16, p < 0.01 and "
    "0.5 < d < 1 at the others",
    range(4, 17),
    range(5, 26),
)
UNTRAINED = FingerTask(
    "untrained-profiles",
    "Untrained profiles",
    "Fig. 4C",
    25,
    (QuotedAccuracy(28.2, 23), QuotedAccuracy(42.7, 9)),
    "Speed Scaled is above Original's peak from 4 components, ** from 4 to 22, p < 0.01 and "
    "0.5 < d < 1 at the others",
    range(4, 23),
    range(4, 26),
)
DEPLOYED = FingerTask(
    "deployed",
    "Real-time classifier",
    "Fig. S5",
    95,
    (QuotedAccuracy(52.33, 67), QuotedAccuracy(61.67, 25)),
    "Speed Scaled is above Original's peak at most numbers of components from 7, ** at many from "
    "6 to 26, * at most up to 34",
    range(6, 27),
    range(7, 96),
)
FINGER_TASKS = (SAME_SESSION, NEW_SESSION, TRAINED, UNTRAINED, DEPLOYED)
