"""Search C for one texture, speed and force: first on a pilot of the trials, then on all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.batch import (
    Counts,
    Floats,
    count_spikes,
    count_spikes_without_and_with_c,
    mean_readings,
    normalise_mean_readings,
    sa_rates_hz,
    single_bin_edges,
)
from rigctl.encoder.kernel import Trials, TrialViews
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, EncoderParameters
from rigctl.encoder.root_bracket import LIMIT_C, Bracket, Method

TOLERANCE_HZ = 0.1
MAX_EVALUATIONS = 60

# The pilot is every eighth trial: with its mean reading corrected for, its rate misses that of all
# trials by a tenth of a hertz. Fewer rounds than a jump would take: all trials decide.
PILOT_STRIDE, MIN_PILOT_TRIALS = 8, 3
PILOT_TOLERANCE_HZ, MAX_PILOT_EVALUATIONS = 0.2, 6


@dataclass(frozen=True, slots=True)
class ForceSearch:
    """Result of the search for the taxels of one texture, speed and force.

    ``c``, ``rate_hz``: float64 (n_taxels,); ``status``: int8; ``evaluations``: float64, encodings
    of the taxel, those of the pilot by its share of the samples; ``counts``: uint32
    (n_trials, n_taxels, n_bins), SA spikes with that C. ``plain``: uint32 (n_trials, 2 n_taxels,
    n_bins), the spikes of both channels without C; empty unless asked for.
    """

    c: Floats
    rate_hz: Floats
    status: NDArray[np.int8]
    evaluations: Floats
    counts: Counts
    plain: Counts


def mean_sa_rates_hz(
    trials: Trials,
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    c: Floats | None = None,
) -> Floats:
    """Encode trials and return the mean SA rate of each taxel, float64 (n_taxels,).

    ``c`` scales the SA current.
    """
    scale = None if c is None else np.tile(c, (len(trials), 1))
    views = TrialViews.from_arrays(trials)
    counts = count_spikes(
        views, single_bin_edges(views), normalisation, parameters, sa_scale=scale, sa_only=True
    )
    return sa_rates_hz(counts, views.lengths.tolist(), parameters)


def search_c(
    trials: Trials,
    reference_reading: Floats,
    target_hz: Floats,
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    *,
    tolerance_hz: float = TOLERANCE_HZ,
    method: Method = Method.REGULA_FALSI,
    bin_edges: NDArray[np.int64] | None = None,
    with_plain: bool = False,
) -> ForceSearch:
    """Search C of every taxel of one condition; taxels that are done are not encoded again.

    Starts with the C that makes the mean reading equal to ``reference_reading``, float64
    (n_taxels,). Regula falsi searches every eighth trial first and starts with that result; the
    rate of all trials decides. ``bin_edges``: of the bins to count spikes in (default one bin a
    trial). ``with_plain``: whether the first encoding also counts the spikes without C.
    """
    views = TrialViews.from_arrays(trials)
    bin_edges = single_bin_edges(views) if bin_edges is None else bin_edges
    condition = _Condition(views, bin_edges, normalisation, parameters)
    readings = mean_readings(views, normalisation)
    start = _ratio(reference_reading, normalise_mean_readings(readings, normalisation))
    slopes, pilot_evaluations = np.zeros_like(start), np.zeros_like(start)
    if method is Method.REGULA_FALSI and len(trials) >= PILOT_STRIDE * MIN_PILOT_TRIALS:
        start, slopes, pilot_evaluations = _pilot(condition, readings, target_hz, start)
    known = zip(target_hz.tolist(), start.tolist(), slopes.tolist(), strict=True)
    brackets = [Bracket(target, guess, method, slope) for target, guess, slope in known]
    best_counts = np.zeros((len(trials), len(brackets), len(bin_edges) - 1), np.uint32)
    plain: list[Counts] | None = [] if with_plain else None
    rounds = condition.evaluate(brackets, tolerance_hz, MAX_EVALUATIONS, plain)
    for taxels, counts, best in rounds:
        best_counts[:, taxels[best]] = counts[:, best]
    for bracket in brackets:
        bracket.give_up()
    return ForceSearch(
        np.array([b.best_c for b in brackets]),
        np.array([b.best_rate for b in brackets]),
        np.array([b.status for b in brackets], np.int8),
        pilot_evaluations + [b.evaluations for b in brackets],
        best_counts,
        plain[0] if plain else best_counts[:0],
    )


def _pilot(
    condition: _Condition, readings: Floats, target_hz: Floats, start: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return C and slope of the rate from some of the trials, and the encodings they took.

    Their readings differ in height from those of all trials, but that difference is known, and a C
    that corrects for it gives much the same rate. So the pilot's C is searched, then converted.
    """
    selected = slice(PILOT_STRIDE // 2, None, PILOT_STRIDE)
    pilot = condition.select(selected)
    ratio = _ratio(
        normalise_mean_readings(readings[selected], condition.normalisation),
        normalise_mean_readings(readings, condition.normalisation),
    )
    known = zip(target_hz.tolist(), (start / ratio).tolist(), strict=True)
    brackets = [
        Bracket(target, guess, Method.REGULA_FALSI, highest=LIMIT_C) for target, guess in known
    ]
    for _ in pilot.evaluate(brackets, PILOT_TOLERANCE_HZ, MAX_PILOT_EVALUATIONS):
        pass
    share = pilot.views.lengths.sum() / max(1, condition.views.lengths.sum())
    c, slopes = np.array([(b.predicted_c, b.slope) for b in brackets]).T
    return c * ratio, slopes / ratio, share * np.array([b.evaluations for b in brackets])


class _Condition(NamedTuple):
    """Trials of one condition, to encode with one C after another."""

    views: TrialViews
    bin_edges: NDArray[np.int64]
    normalisation: Normalisation
    parameters: EncoderParameters

    def select(self, which: slice) -> _Condition:
        """Return some of the trials, with one bin each."""
        views = self.views.select(which)
        return self._replace(views=views, bin_edges=single_bin_edges(views))

    def evaluate(
        self,
        brackets: Sequence[Bracket],
        tolerance_hz: float,
        max_rounds: int,
        plain: list[Counts] | None = None,
    ) -> Iterator[tuple[NDArray[np.int64], Counts, NDArray[np.bool_]]]:
        """Encode with the guesses of all open brackets until none is open.

        Each round yields the taxels, their counts, and whether each guess was the best so far. The
        first one adds the counts without C to ``plain``.
        """
        lengths = self.views.lengths.tolist()
        for number in range(max_rounds):
            taxels = np.array([i for i, b in enumerate(brackets) if b.status is None], np.int64)
            if not len(taxels):
                return
            guesses = np.array([brackets[i].guess for i in taxels])
            if number == 0 and plain is not None:
                scale = np.tile(guesses, (len(self.views), 1))
                without, counts = count_spikes_without_and_with_c(*self, scale)
                plain.append(without)
            else:
                counts = self._count(taxels, guesses)
            rates = zip(taxels, sa_rates_hz(counts, lengths, self.parameters).tolist(), strict=True)
            yield taxels, counts, np.array([brackets[i].update(r, tolerance_hz) for i, r in rates])

    def _count(self, taxels: NDArray[np.int64], c: Floats) -> Counts:
        return count_spikes(
            self.views,
            self.bin_edges,
            self.normalisation,
            self.parameters,
            sa_scale=np.tile(c, (len(self.views), 1)),
            taxels=taxels,
            sa_only=True,
        )


def _ratio(numerator: Floats, denominator: Floats) -> Floats:
    """Return the ratio of two mean readings, 1 where either is 0."""
    return np.divide(
        numerator,
        denominator,
        out=np.ones_like(denominator),
        where=(denominator > 0) & (numerator > 0),
    )
