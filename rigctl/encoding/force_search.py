"""The search for the C of one texture, speed and force: some trials are asked first, then all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.batch import (
    Counts,
    levels_of,
    mean_of_levels,
    sa_rates_hz,
    stretch_counts,
    whole_trials,
)
from rigctl.encoding.kernel.prefetch import TrialRows, Trials
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, EncoderParameters
from rigctl.encoding.root_bracket import Bracket, Method

Floats = NDArray[np.float64]
Encode = Callable[[Floats], Counts]

TOLERANCE_HZ = 0.1
MOST_EVALUATIONS = 60

# Trials that are asked before all are: their rate misses that of all by a tenth of a hertz, once
# it is known how high they read. Fewer rounds than a jump would take: all trials will tell.
PILOT_EVERY, FEWEST_IN_PILOT = 8, 3
PILOT_TOLERANCE_HZ, MOST_IN_PILOT = 0.2, 6


@dataclass(frozen=True, slots=True)
class ForceSearch:
    """What the search found for the taxels of one texture, speed and force.

    ``c``, ``rate_hz``: float64 (n_taxels,); ``status``: int8; ``evaluations``: float64, encodings
    of the taxel that it took, those of some trials by their share of the samples; ``counts``:
    uint32 (n_trials, n_taxels, n_stretches), SA spikes with that C.
    """

    c: Floats
    rate_hz: Floats
    status: NDArray[np.int8]
    evaluations: Floats
    counts: Counts


def mean_sa_rates_hz(
    trials: Trials,
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    c: Floats | None = None,
) -> Floats:
    """Mean SA rate of each taxel over trials, float64 (n_taxels,); ``c`` scales its current."""
    scale = None if c is None else np.tile(c, (len(trials), 1))
    rows = TrialRows.of(trials)
    counts = stretch_counts(
        rows, whole_trials(rows), normalisation, parameters, sa_scale=scale, sa_only=True
    )
    return sa_rates_hz(counts, rows.lengths.tolist(), parameters)


def search_to(
    trials: Trials,
    goal: Floats,
    target_hz: Floats,
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    *,
    tolerance_hz: float = TOLERANCE_HZ,
    method: Method = Method.REGULA_FALSI,
    cuts: NDArray[np.int64] | None = None,
    first: Encode | None = None,
) -> ForceSearch:
    """:func:`search` that starts where readings are as high as ``goal``, those of the reference."""
    rows = TrialRows.of(trials)
    levels = levels_of(rows, normalisation)
    start = _ratio(goal, mean_of_levels(levels, normalisation))
    ways = (normalisation, parameters, tolerance_hz, method)
    return search(rows, target_hz, start, *ways, cuts, first, levels)


def search(
    trials: Trials,
    target_hz: Floats,
    start: Floats,
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    tolerance_hz: float = TOLERANCE_HZ,
    method: Method = Method.REGULA_FALSI,
    cuts: NDArray[np.int64] | None = None,
    first: Encode | None = None,
    levels: Floats | None = None,
) -> ForceSearch:
    """C of every taxel of one condition; taxels that are found are not encoded again.

    Regula falsi asks every eighth trial first, and starts with what these say; what all trials say
    decides. ``cuts``: of the stretches in which spikes are counted; without them a trial is one
    stretch. ``first``: gives the counts of all taxels with the first C, for who has more to do
    with the same readings. ``levels``: as :func:`rigctl.encoding.batch.levels_of` tells them, for
    who knows.
    """
    rows = TrialRows.of(trials)
    cuts = whole_trials(rows) if cuts is None else cuts
    every = _Encoded(rows, cuts, normalisation, parameters)
    slopes, asked = np.zeros_like(start), np.zeros_like(start)
    if method is Method.REGULA_FALSI and len(trials) >= PILOT_EVERY * FEWEST_IN_PILOT:
        levels = levels_of(rows, normalisation) if levels is None else levels
        start, slopes, asked = _pilot(every, levels, target_hz, start)
    told = zip(target_hz.tolist(), start.tolist(), slopes.tolist(), strict=True)
    brackets = [Bracket(target, first, method, slope) for target, first, slope in told]
    kept = np.zeros((len(trials), len(brackets), len(cuts) - 1), np.uint32)
    rounds = every.rounds(brackets, tolerance_hz, MOST_EVALUATIONS, first)
    for open_ones, counts, best in rounds:
        kept[:, open_ones[best]] = counts[:, best]
    for bracket in brackets:
        bracket.give_up()
    return ForceSearch(
        np.array([b.best_c for b in brackets]),
        np.array([b.best_rate for b in brackets]),
        np.array([b.status for b in brackets], np.int8),
        asked + [b.evaluations for b in brackets],
        kept,
    )


def _pilot(
    every: _Encoded, levels: Floats, target_hz: Floats, start: Floats
) -> tuple[Floats, Floats, Floats]:
    """What some of the trials say of C and of the rate's slope, and the encodings that it took.

    Their readings are not as high as those of all, but how much they differ is known, and a C that
    makes up for it brings much the same rate. So C is searched on them, and told for all.
    """
    which = slice(PILOT_EVERY // 2, None, PILOT_EVERY)
    some = every.some(which)
    higher = _ratio(*(mean_of_levels(own, every.normalisation) for own in (levels[which], levels)))
    told = zip(target_hz.tolist(), (start / higher).tolist(), strict=True)
    brackets = [Bracket(target, first, Method.REGULA_FALSI) for target, first in told]
    for _ in some.rounds(brackets, PILOT_TOLERANCE_HZ, MOST_IN_PILOT):
        pass
    share = some.trials.lengths.sum() / max(1, every.trials.lengths.sum())
    foreseen, slopes = (np.array([getattr(b, n) for b in brackets]) for n in ("foreseen", "slope"))
    return foreseen * higher, slopes / higher, share * np.array([b.evaluations for b in brackets])


class _Encoded(NamedTuple):
    """Trials of one condition, to be encoded with one C after another."""

    trials: TrialRows
    cuts: NDArray[np.int64]
    normalisation: Normalisation
    parameters: EncoderParameters

    def some(self, which: slice) -> _Encoded:
        """Some of the trials, whole."""
        chosen = self.trials.some(which)
        return self._replace(trials=chosen, cuts=whole_trials(chosen))

    def rounds(
        self,
        brackets: Sequence[Bracket],
        tolerance_hz: float,
        most: int,
        first: Encode | None = None,
    ) -> Iterator[tuple[NDArray[np.int64], Counts, NDArray[np.bool_]]]:
        """Encode with the guesses of all brackets that are open until none is.

        Each round gives the taxels, their counts, and for which of them the guess was the best yet.
        """
        lengths = self.trials.lengths.tolist()
        for number in range(most):
            taxels = np.array([i for i, b in enumerate(brackets) if b.status is None], np.int64)
            if not len(taxels):
                return
            guesses = np.array([brackets[i].guess for i in taxels])
            counts = first(guesses) if first and number == 0 else self._counts(taxels, guesses)
            rates = sa_rates_hz(counts, lengths, self.parameters).tolist()
            learnt = zip(taxels, rates, strict=True)
            yield taxels, counts, np.array([brackets[i].learn(r, tolerance_hz) for i, r in learnt])

    def _counts(self, taxels: NDArray[np.int64], c: Floats) -> Counts:
        return stretch_counts(
            self.trials,
            self.cuts,
            self.normalisation,
            self.parameters,
            sa_scale=np.tile(c, (len(self.trials), 1)),
            taxels=taxels,
            sa_only=True,
        )


def _ratio(of: Floats, to: Floats) -> Floats:
    """One level over another, 1 where there is none."""
    return np.divide(of, to, out=np.ones_like(to), where=(to > 0) & (of > 0))
