"""Pieces of the way from sessions to features, each of which can run in a process of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.trial_set import TrialRef, opened
from rigctl.encoding.features import FeatureLayout, feature_matrices
from rigctl.encoding.force import ForceMatrix, force_matrix
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.presets import EncoderParameters
from rigctl.errors import WrongUse
from rigctl.session.sample_map import SampleFile

Features = NDArray[np.float64]


class Condition(NamedTuple):
    """All trials of one texture at one speed; ``given``: C by force instead of a search."""

    files: tuple[SampleFile, ...]
    trials: tuple[TrialRef, ...]
    normalisation: Normalisation
    parameters: EncoderParameters
    layouts: tuple[FeatureLayout, FeatureLayout]
    forces_g: tuple[float, ...]
    reference_g: float
    given: tuple[NDArray[np.float64], ...]


class Encoded(NamedTuple):
    """Feature matrices (unscaled, speed scaled) without and with C, and the C that was found."""

    plain: list[Features]
    forced: list[Features]
    force: ForceMatrix | None


def range_of(
    job: tuple[tuple[SampleFile, ...], tuple[TrialRef, ...]],
) -> list[NDArray[np.uint16]]:
    """The lowest and highest readings of each trial."""
    files, trials = job
    ends = []
    with opened(files) as reader:
        for trial in trials:
            samples = reader.of(trial)
            ends.append(np.stack([samples.min(axis=0), samples.max(axis=0)]))
    return ends


def encoded_condition(condition: Condition) -> Encoded:
    """Features of one texture and speed: with the C it is given, or plain and with its own."""
    with opened(condition.files) as reader:
        samples = [reader.of(trial) for trial in condition.trials]
    if condition.given:
        by_force = dict(zip(condition.forces_g, condition.given, strict=True))
        return Encoded([], _features(condition, samples, by_force), None)
    plain = _features(condition, samples, None)
    if not condition.forces_g:
        return Encoded(plain, [], None)
    texture, speed = condition.trials[0].texture, condition.trials[0].speed_mm_s

    def trials_of(_texture: str, _speed: float, force: float) -> list[NDArray[np.uint16]]:
        both = zip(condition.trials, samples, strict=True)
        return [readings for trial, readings in both if trial.force_g == force]

    ways = (condition.normalisation, condition.parameters)
    force = force_matrix(
        trials_of,
        [texture],
        [speed],
        condition.forces_g,
        *ways,
        reference_g=condition.reference_g,
    )
    by_force = {f: force.of(texture, speed, f) for f in condition.forces_g}
    return Encoded(plain, _features(condition, samples, by_force), force)


def _features(
    condition: Condition,
    samples: Sequence[NDArray[np.uint16]],
    c_of_force: dict[float, NDArray[np.float64]] | None,
) -> list[Features]:
    scale = None
    if c_of_force is not None:
        scale = np.array([c_of_force[trial.force_g] for trial in condition.trials])
    speeds = [trial.speed_mm_s for trial in condition.trials]
    ways = (condition.normalisation, condition.layouts, condition.parameters)
    return feature_matrices(samples, speeds, *ways, sa_scale=scale)


def joined_matrix(pieces: Sequence[ForceMatrix]) -> ForceMatrix:
    """One matrix out of those of single textures and speeds, which come in sorted order."""
    textures = tuple(sorted({piece.textures[0] for piece in pieces}))
    speeds = tuple(sorted({piece.speeds_mm_s[0] for piece in pieces}))
    if len(textures) * len(speeds) != len(pieces):
        raise WrongUse("the force matrix lacks a texture at some speed")

    def joined(name: str) -> NDArray[np.float64]:
        rows = [
            np.concatenate([getattr(p, name) for p in pieces if p.textures[0] == texture], axis=2)
            for texture in textures
        ]
        return np.concatenate(rows, axis=0)

    first = pieces[0]
    return ForceMatrix(
        textures,
        speeds,
        first.forces_g,
        first.reference_g,
        joined("c"),
        joined("status").astype(np.int8),
        joined("residual_hz"),
        joined("evaluations").astype(np.int64),
    )
