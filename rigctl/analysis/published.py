"""The paper's experiments as published: tasks, groups, trained conditions, quoted accuracies."""

from __future__ import annotations

from typing import NamedTuple

ITERATIONS = 20
K_MAX = 50
N_FOLDS = 4
DRAWN_SHARE = 500 / 1500
TRAINED_SHARE = 75 / 100
TESTED_SHARE = 25 / 100
TRAINED_SPEEDS_MM_S = (40.0, 60.0, 80.0)
TRAINED_FORCES_G = (250.0, 500.0)
SMOOTH = "A"
GROUPS = {SMOOTH: "smooth"} | {
    letter: group
    for group, letters in (
        ("circular ridges", "BCDEF"),
        ("rectangular ridges", "GHIJK"),
        ("waves", "LMNOP"),
    )
    for letter in letters
}


class Task(NamedTuple):
    """A classification task. ``family``: the splits that it shares with other tasks."""

    key: str
    title: str
    figure: str
    family: str
    grouped: bool = False


TASKS = (
    Task("textures", "Individual textures", "Fig. 3A", "folds"),
    Task("groups", "Texture groups", "Fig. 3B", "folds", grouped=True),
    Task("untrained-both", "Untrained speed and force", "Fig. 3C", "extrapolation"),
    Task("untrained-force", "Untrained force", "Fig. 3D", "extrapolation"),
    Task("untrained-speed", "Untrained speed", "Fig. 3E", "extrapolation"),
    Task("trained-both", "Trained speed and force", "Fig. 3F", "extrapolation"),
)
MOUNT_TASKS = (
    Task("trained-mount", "Same mounting", "", "leave-mount-out"),
    Task("leave-mount-out", "Other mounting", "", "leave-mount-out"),
    Task("trained-mount-untrained-speed", "Same mounting, untrained speed", "", "leave-mount-out"),
    Task(
        "leave-mount-out-untrained-speed", "Other mounting, untrained speed", "", "leave-mount-out"
    ),
)
_COLUMNS = ("original", "speed", "force", "speed_force")
_ROWS: dict[str, tuple[tuple[float, float], ...]] = {
    "textures": ((91.78, 0.55), (97.76, 0.14), (96.84, 0.43), (98.85, 0.16)),
    "groups": ((81.83, 0.53), (95.89, 0.26), (92.20, 0.43), (97.78, 0.19)),
    "untrained-both": ((37.44, 1.28), (69.98, 0.87), (67.01, 0.85), (83.15, 0.80)),
    "untrained-force": ((57.35, 0.79), (64.18, 0.55), (89.38, 0.43), (88.73, 0.52)),
    "untrained-speed": ((36.81, 0.66), (85.52, 0.34), (67.53, 0.78), (91.50, 0.27)),
    "trained-both": ((99.93, 0.04), (99.95, 0.04), (99.91, 0.06), (99.96, 0.04)),
}
TABLE_1 = {task: dict(zip(_COLUMNS, cells, strict=True)) for task, cells in _ROWS.items()}
"""μ and σ in per cent with 50 components, by task and representation key."""
UNCONVERGED_C = (62, 4320)
"""Entries of C that did not converge, of all (Materials and Methods, Force Invariance Module)."""
REFERENCE_C = 16 * 18 * 5
"""Entries among the 4,320 that are 1 by definition: those at 500 g, one of the three forces."""
UNCONVERGED_RATE_HZ = 2.0
"""Highest spike rate of the trains whose C did not converge (ibid.)."""
CONFUSION_TASK = "untrained-both"
CONFUSION_TRIALS = 16_000
CONFUSION_PERCENT = {
    "original": ("Fig. S1", 36.78),
    "speed": ("Fig. S2", 69.64),
    "force": ("Fig. S3", 66.66),
    "speed_force": ("Fig. S4", 83.06),
}
"""Captions of Figures S1 to S4: accuracy over 16,000 test trials of Figure 3C with 50 components.

They differ from Table 1 by 0.09 to 0.66 points; the paper does not say why.
"""
