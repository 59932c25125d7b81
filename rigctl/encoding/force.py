"""Force scaling: the factor C on the SA current that brings a taxel's rate to its rate at 500 g.

One C for each texture, taxel, speed and force (the paper's eq. 1). C is indexed by the true
texture, so whatever is classified with it has seen the label, and it has seen every force it was
made for; :meth:`ForceMatrix.texture_blind` averages over the textures. A change of the sensor voids
it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum

import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.bulk import (
    Counts,
    mean_level,
    sa_rates_hz,
    stretch_counts,
    whole_trials,
)
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.presets import DEFAULT, EncoderParameters
from rigctl.errors import WrongUse

Floats = NDArray[np.float64]
Trials = Sequence[NDArray[np.uint16]]

REFERENCE_FORCE_G = 500.0
TOLERANCE_HZ = 0.1
HIGHEST_C = 5.0
NARROWEST = 1e-6
MOST_EVALUATIONS = 60


class Status(IntEnum):
    """How the search for one C ended."""

    REFERENCE = 0  # the reference force itself: C is 1
    CONVERGED = 1  # the rate is within the tolerance
    CAPPED = 2  # even the highest C leaves the rate too low; C is that
    DISCONTINUITY = 3  # the rate jumps over the target; C is the nearer side


class Method(StrEnum):
    """How the next C is chosen inside the bracket."""

    REGULA_FALSI = "regula-falsi"
    BISECTION = "bisection"


@dataclass(frozen=True, slots=True)
class Search:
    """What the search found for the taxels of one texture, speed and force.

    ``c``, ``rate_hz``: float64 (n_taxels,); ``status``: int8; ``evaluations``: int64, encodings
    of the taxel that it took; ``counts``: uint32 (n_trials, n_taxels, n_stretches), SA spikes
    with that C.
    """

    c: Floats
    rate_hz: Floats
    status: NDArray[np.int8]
    evaluations: NDArray[np.int64]
    counts: Counts


@dataclass(frozen=True, slots=True)
class ForceMatrix:
    """C with how it was found, arrays of shape (textures, n_taxels, speeds, forces).

    ``residual_hz``: the rate reached less the target.
    """

    textures: tuple[str, ...]
    speeds_mm_s: tuple[float, ...]
    forces_g: tuple[float, ...]
    reference_g: float
    c: Floats
    status: NDArray[np.int8]
    residual_hz: Floats
    evaluations: NDArray[np.int64]

    def of(self, texture: str, speed_mm_s: float, force_g: float) -> Floats:
        """C of each taxel, float64 (n_taxels,). Raises WrongUse for a condition it lacks."""
        try:
            t = self.textures.index(texture)
        except ValueError:
            raise WrongUse(f"the force matrix has no texture {texture}") from None
        v, f = self._place(speed_mm_s, force_g)
        return self.c[t, :, v, f]

    def texture_blind(self, speed_mm_s: float, force_g: float) -> Floats:
        """Mean of C over the textures, float64 (n_taxels,): knows no label."""
        v, f = self._place(speed_mm_s, force_g)
        mean: Floats = self.c[:, :, v, f].mean(axis=0)
        return mean

    @property
    def unconverged(self) -> int:
        """Entries that were capped or lie at a jump (the paper: 62 of 4,320)."""
        return int(np.sum(self.status > Status.CONVERGED))

    def _place(self, speed_mm_s: float, force_g: float) -> tuple[int, int]:
        try:
            return self.speeds_mm_s.index(speed_mm_s), self.forces_g.index(force_g)
        except ValueError:
            raise WrongUse(
                f"the force matrix was not made for {speed_mm_s:g} mm/s and {force_g:g} g"
            ) from None


def force_matrix(
    trials_of: Callable[[str, float, float], Trials],
    textures: Sequence[str],
    speeds_mm_s: Sequence[float],
    forces_g: Sequence[float],
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    *,
    reference_g: float = REFERENCE_FORCE_G,
    tolerance_hz: float = TOLERANCE_HZ,
    method: Method = Method.REGULA_FALSI,
) -> ForceMatrix:
    """Search every C. ``trials_of(texture, speed, force)`` gives the trials of a condition.

    Raises :class:`WrongUse` where the reference force is none of the forces, or a condition has no
    trials.
    """
    if reference_g not in forces_g:
        raise WrongUse(f"force scaling needs trials at the reference force of {reference_g:g} g")
    shape = (len(textures), normalisation.n_taxels, len(speeds_mm_s), len(forces_g))
    c, residual = np.ones(shape), np.zeros(shape)
    status, evaluations = np.zeros(shape, np.int8), np.zeros(shape, np.int64)
    for t, texture in enumerate(textures):
        for v, speed in enumerate(speeds_mm_s):
            reference = _trials(trials_of, texture, speed, reference_g)
            target = mean_sa_rates_hz(reference, normalisation, parameters)
            for f, force in enumerate(forces_g):
                if force == reference_g:
                    continue
                trials = _trials(trials_of, texture, speed, force)
                found = search_to(
                    trials,
                    reference,
                    target,
                    normalisation,
                    parameters,
                    tolerance_hz=tolerance_hz,
                    method=method,
                )
                c[t, :, v, f], status[t, :, v, f] = found.c, found.status
                residual[t, :, v, f] = found.rate_hz - target
                evaluations[t, :, v, f] = found.evaluations
    names = (tuple(textures), tuple(speeds_mm_s), tuple(forces_g))
    return ForceMatrix(*names, reference_g, c, status, residual, evaluations)


def mean_sa_rates_hz(
    trials: Trials,
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    c: Floats | None = None,
) -> Floats:
    """Mean SA rate of each taxel over trials, float64 (n_taxels,); ``c`` scales its current."""
    scale = None if c is None else np.tile(c, (len(trials), 1))
    counts = stretch_counts(
        trials, whole_trials(trials), normalisation, parameters, sa_scale=scale, sa_only=True
    )
    return sa_rates_hz(counts, list(map(len, trials)), parameters)


def search_to(
    trials: Trials,
    reference: Trials,
    target_hz: Floats,
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    *,
    tolerance_hz: float = TOLERANCE_HZ,
    method: Method = Method.REGULA_FALSI,
    cuts: NDArray[np.int64] | None = None,
) -> Search:
    """:func:`search` that starts where readings are as high as those of the reference trials."""
    level, goal = mean_level(trials, normalisation), mean_level(reference, normalisation)
    start = np.divide(goal, level, out=np.ones_like(level), where=level > 0)
    return search(trials, target_hz, start, normalisation, parameters, tolerance_hz, method, cuts)


def search(
    trials: Trials,
    target_hz: Floats,
    start: Floats,
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    tolerance_hz: float = TOLERANCE_HZ,
    method: Method = Method.REGULA_FALSI,
    cuts: NDArray[np.int64] | None = None,
) -> Search:
    """C of every taxel of one condition; taxels that are found are not encoded again.

    ``cuts``: of the stretches in which spikes are counted; without them a trial is one stretch.
    """
    brackets = [_Bracket(float(t), float(s), method) for t, s in zip(target_hz, start, strict=True)]
    cuts = whole_trials(trials) if cuts is None else cuts
    lengths = list(map(len, trials))
    kept = np.zeros((len(trials), len(brackets), len(cuts) - 1), np.uint32)
    for _ in range(MOST_EVALUATIONS):
        open_ones = [i for i, b in enumerate(brackets) if b.status is None]
        if not open_ones:
            break
        guesses = np.array([brackets[i].guess for i in open_ones])
        counts = stretch_counts(
            trials,
            cuts,
            normalisation,
            parameters,
            sa_scale=np.tile(guesses, (len(trials), 1)),
            taxels=np.array(open_ones),
            sa_only=True,
        )
        rates = sa_rates_hz(counts, lengths, parameters)
        for place, (i, rate) in enumerate(zip(open_ones, rates, strict=True)):
            if brackets[i].learn(float(rate), tolerance_hz):
                kept[:, i] = counts[:, place]
    for bracket in brackets:
        bracket.give_up()
    return Search(
        np.array([b.best_c for b in brackets]),
        np.array([b.best_rate for b in brackets]),
        np.array([b.status for b in brackets], np.int8),
        np.array([b.evaluations for b in brackets], np.int64),
        kept,
    )


class _Bracket:
    """One taxel's search: the rate rises with C from 0 at C = 0, in jumps.

    Regula falsi with the Illinois rule: an end that stays twice has its distance halved, so that
    the other end moves too.
    """

    def __init__(self, target: float, start: float, method: Method) -> None:
        self.status: Status | None = None
        self.evaluations = 0
        self.best_c, self.best_rate = 0.0, 0.0
        self._target = target
        self._bisects = method is Method.BISECTION
        self._low, self._below = 0.0, -target
        self._high, self._above = HIGHEST_C, float("nan")
        self._last_side = 0
        self.guess = HIGHEST_C / 2 if self._bisects else min(max(start, 0.0), HIGHEST_C)

    def learn(self, rate: float, tolerance_hz: float) -> bool:
        """Take in the rate at the guess and make the next one. True where it was the best yet."""
        self.evaluations += 1
        distance = rate - self._target
        best = self.evaluations == 1 or abs(distance) < abs(self.best_rate - self._target)
        if abs(distance) < tolerance_hz:
            self.status = Status.CONVERGED
        elif distance < 0 and self.guess >= HIGHEST_C:
            self.status, best = Status.CAPPED, True
        if best:
            self.best_c, self.best_rate = self.guess, rate
        if self.status is None:
            self._narrow(distance)
        return best

    def give_up(self) -> None:
        """Call a search that is still open a jump over the target."""
        if self.status is None:
            self.status = Status.DISCONTINUITY

    def _narrow(self, distance: float) -> None:
        side = -1 if distance < 0 else 1
        stays = side == self._last_side
        if side < 0:
            # Before anything was found above the target, the highest C is not known to be.
            previous, self._low = self._low, self.guess
            slope = (distance - self._below) / max(self.guess - previous, NARROWEST)
            self._below = distance
            self._above = self._above / 2 if stays else self._above
        else:
            slope = 0.0
            self._high, self._above = self.guess, distance
            self._below = self._below / 2 if stays else self._below
        self._last_side = side
        self.guess = self._next(slope)
        if self._high - self._low < NARROWEST:
            self.status = Status.DISCONTINUITY

    def _next(self, slope: float) -> float:
        if self._bisects:
            middle = (self._low + self._high) / 2
            return HIGHEST_C if self._low > HIGHEST_C - 2 * NARROWEST else middle
        if np.isnan(self._above):
            # Nothing above yet: follow the slope, at least a quarter further, at most to the cap.
            step = -self._below / slope if slope > 0 else HIGHEST_C
            return min(HIGHEST_C, self._low + max(1.02 * step, 0.25 * self._low, 0.05))
        width = self._high - self._low
        share = self._below / (self._below - self._above) if self._above > self._below else 0.5
        # A guess on the rim would learn nothing.
        return self._low + width * min(max(share, 0.02), 0.98)


def _trials(
    trials_of: Callable[[str, float, float], Trials], texture: str, speed: float, force: float
) -> Trials:
    trials = trials_of(texture, speed, force)
    if not trials:
        raise WrongUse(
            f"force scaling has no trial of texture {texture} at {speed:g} mm/s and {force:g} g"
        )
    return trials
