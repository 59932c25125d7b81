"""The quality of a trial on its data: dead, stuck, saturated and noisy taxels, drift, outliers.

A trial is compared with the trials of the same condition before it: a taxel that nothing touches
reads nothing in every one of them. What is broken is a reason to repeat. What is only unusual is
not: a condition whose unusual trials are repeated until they look usual has a false spread, so
such a trial is put into quarantine, where a person decides.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import pi
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.protocol.plan import Condition, Quality

Floats = NDArray[np.float64]

PASS, REPEAT, QUARANTINE, GIVEN_UP = "pass", "repeat", "quarantine", "given up"
VERDICTS = (PASS, QUARANTINE, REPEAT, GIVEN_UP)
SHOWN_PERCENT = 30.0
"""Ends of the colour scale, of the usual reading."""
TITLES = "Reading of each taxel beside equal trials", "Lifted readings since the start"
MARKED = {GIVEN_UP: "X", REPEAT: "|", QUARANTINE: "d"}
"""The verdicts that are marked, and the shape of the mark."""

MEMORY = 20
"""Trials of a condition that a trial is compared with, the last ones: a slow drift is followed."""
LEAST_REFERENCES = 3
TAIL_FREEDOM = 30
"""Of Student's t, whose tails the scatter of equal trials has: over three virtual sets of 2,400
trials without a fault, 0.08 % are unusual where 0.1 % are stated, and 0.55 % where 1 % are."""
LEAST_RESIDUALS = 30
MAX_RESIDUALS = 1000
MOVES_COUNTS = 8
"""The noise of a taxel without contact stays within this many counts."""
PLAIN_COUNTS = 2 * MOVES_COUNTS
"""A taxel that usually moves less, as some do under a smooth plate, may in any trial move by less
than its noise: whether it lives is not seen there."""
QUIET_SHARE, QUIET_COUNTS = 0.1, 2.0
"""A taxel stays where it moves less than this share of equal trials, with so small a deviation."""
NOISE_FACTOR = 4.0
MOST_NOISE_COUNTS = 3.0
"""A taxel is noisy with more than this, and with this many times its noise in equal trials."""
MOST_CELL_NOISE_G = 2.0
LEAST_SCATTER = 0.02
"""Scatter of equal trials below which no trial is unusual, a share."""
MAD_TO_SD = 1.4826
BASELINE_SAMPLES = 100
"""Lifted readings before the approach that a baseline is the mean of, for all trials of a contact.
"""


class CellStatistics(NamedTuple):
    """The load cell in a trial: noise from reading to reading, and the worst single reading, g.

    ``spike_g``: the distance of one reading from the mean of its neighbours. NaN: not measured.
    """

    noise_g: float = float("nan")
    spike_g: float = float("nan")


def cell_statistics(force_g: Floats) -> CellStatistics:
    """Return the statistics of the forces of a trial in order, float64 (n,)."""
    if len(force_g) < 3:
        return CellStatistics()
    bends = force_g[1:-1] - (force_g[:-2] + force_g[2:]) / 2.0
    # The bend of white noise has 1.5 times its variance.
    noise_g = MAD_TO_SD * float(np.median(np.abs(bends))) / 1.5**0.5
    return CellStatistics(noise_g, float(np.abs(bends).max()))


@dataclass(frozen=True, slots=True)
class TrialStatistics:
    """Statistics of the taxels over a trial, in counts, (n_taxels,) each.

    ``noise``: from sample to sample. ``top_share``: of the samples at the end of the range.
    ``baseline``: lifted, before the last approach; NaN where it is not known. ``sa_spikes``: of all
    taxels.
    """

    mean: Floats
    sd: Floats
    noise: Floats
    low: Floats
    high: Floats
    top_share: Floats
    baseline: Floats
    cell: CellStatistics
    sa_spikes: float

    @property
    def compared(self) -> Floats:
        """What is compared with equal trials, float64 (n_taxels + 2,): differences are shares.

        Logarithms of each taxel's mean, of the usual deviation, and of the SA spikes.
        """
        spread, spikes = np.log(self.sd + 1.0).mean(), np.log(self.sa_spikes + 30.0)
        return np.concatenate((np.log(self.mean + 4.0), (spread, spikes)))

    @property
    def movement(self) -> Floats:
        """How far each taxel gets from its lifted reading, or within the trial, counts.

        0 where that is less than a taxel without contact does. An unknown baseline counts as 0.
        """
        rise = np.abs(self.mean - np.nan_to_num(self.baseline))
        far = np.maximum(rise, self.high - self.low)
        return np.where(far > MOVES_COUNTS, far, 0.0)

    def name_of(self, compared: int) -> str:
        """Return the name of a value of :attr:`compared`."""
        others = ("deviation of the taxels", "number of SA spikes")
        n = len(self.mean)
        return f"mean of taxel {compared + 1}" if compared < n else others[compared - n]


class DataVerdict(NamedTuple):
    """Reasons to repeat a trial, and reasons to put it into quarantine; in words.

    ``broken``: the taxels that the reasons to repeat are about, from 0.
    """

    repeat: tuple[str, ...] = ()
    quarantine: tuple[str, ...] = ()
    broken: tuple[int, ...] = ()


@dataclass
class TrialHistory:
    """The trials that were good, by condition, and how they judge the next one."""

    limits: Quality
    _trials: dict[Condition, deque[TrialStatistics]] = field(
        default_factory=lambda: defaultdict(lambda: deque(maxlen=MEMORY))
    )
    _good: deque[tuple[Condition, TrialStatistics]] = field(
        default_factory=lambda: deque(maxlen=MAX_RESIDUALS)
    )
    _residuals: deque[Floats] = field(default_factory=lambda: deque(maxlen=MAX_RESIDUALS))
    _first_baseline: Floats | None = None

    def judge(self, condition: Condition, trial: TrialStatistics) -> DataVerdict:
        """Judge a trial of a condition; a good one is what later trials are compared with."""
        equal = self._trials[condition]
        if len(equal) >= LEAST_REFERENCES:
            still, loud = self._still(equal, np.median, trial), self._loud(equal, trial)
            still = {text: taxel for text, taxel in still.items() if not self._held(trial)[taxel]}
            repeat = (*still, *loud, *self._cell(equal, condition[2], trial))
            if repeat:
                return DataVerdict(tuple(repeat), broken=(*still.values(), *loud.values()))
        else:
            still = self._still(self._pressed_no_harder(condition, condition[0]), np.min, trial)
            if still:
                return DataVerdict(tuple(still), broken=tuple(still.values()))
        # On another plate a taxel may lose its contact: that is for a person to say.
        unusual = [*self._still(self._pressed_no_harder(condition), np.min, trial)]
        unusual += [*self._saturated(trial), *self._drifted(trial)]
        if len(equal) >= LEAST_REFERENCES:
            unusual += self._outliers(equal, trial)
        if not unusual:
            equal.append(trial)
            self._good.append((condition, trial))
        return DataVerdict((), tuple(unusual))

    def _pressed_no_harder(self, condition: Condition, plate: str = "") -> list[TrialStatistics]:
        """Return the last good trials with no more force or depth, of a plate or of all."""
        *_, force_g, depth_mm = condition
        found = [
            one
            for (of, _, g, mm), one in self._good
            if g <= force_g and mm <= depth_mm and of == (plate or of)
        ]
        return found[-MEMORY:] if len(found) >= LEAST_REFERENCES else []

    @staticmethod
    def _still(
        others: Sequence[TrialStatistics], usual: Callable[..., Floats], trial: TrialStatistics
    ) -> dict[str, int]:
        """Return a reason for each taxel that stays where it usually moves, with its place."""
        if not others:
            return {}
        usually = usual([one.movement for one in others], axis=0)
        moves = np.where(usually >= PLAIN_COUNTS, QUIET_SHARE * usually, 0.0)
        still = np.flatnonzero((trial.movement < moves) & (trial.sd < QUIET_COUNTS)).tolist()
        return {f"taxel {i + 1} stays at {trial.mean[i]:.0f} counts": i for i in still}

    @staticmethod
    def _loud(equal: Sequence[TrialStatistics], trial: TrialStatistics) -> dict[str, int]:
        """Return a reason for each noisy taxel, with its place."""
        usual = np.median([one.noise for one in equal], axis=0)
        loud = trial.noise > np.maximum(MOST_NOISE_COUNTS, NOISE_FACTOR * usual)
        return {
            f"taxel {i + 1} scatters by {trial.noise[i]:.1f} counts from sample to sample": i
            for i in np.flatnonzero(loud).tolist()
        }

    def _cell(
        self, references: Sequence[TrialStatistics], force_g: float, trial: TrialStatistics
    ) -> Iterator[str]:
        noise_g, spike_g = trial.cell
        usual_g = float(np.median([one.cell.noise_g for one in references]))
        if noise_g > max(MOST_CELL_NOISE_G, NOISE_FACTOR * usual_g):
            yield f"the load cell scatters by {noise_g:.1f} g from reading to reading"
        if spike_g > max(self.limits.max_spike_percent / 100 * force_g, 10 * usual_g):
            yield f"one reading of the load cell is {spike_g:.0f} g off its neighbours"

    def _held(self, trial: TrialStatistics) -> NDArray[np.bool_]:
        """Return which taxels something else presses, a hand or a cable: they live, and drifted."""
        if self._first_baseline is None:
            return np.zeros(len(trial.mean), np.bool_)
        risen = trial.baseline - self._first_baseline > self.limits.max_drift_counts
        return np.asarray(risen & (trial.top_share == 0.0))

    def _saturated(self, trial: TrialStatistics) -> Iterator[str]:
        most = self.limits.max_saturated_percent / 100
        for taxel in np.flatnonzero(trial.top_share > most).tolist():
            share = trial.top_share[taxel]
            yield f"taxel {taxel + 1} is at the end of its range in {share:.0%} of the samples"

    def _drifted(self, trial: TrialStatistics) -> Iterator[str]:
        if not np.isfinite(trial.baseline).all():
            return
        if self._first_baseline is None:
            self._first_baseline = trial.baseline
        drift = trial.baseline - self._first_baseline
        for taxel in np.flatnonzero(np.abs(drift) > self.limits.max_drift_counts).tolist():
            yield f"taxel {taxel + 1} reads {drift[taxel]:+.0f} counts, lifted, since the start"

    def _outliers(
        self, references: Sequence[TrialStatistics], trial: TrialStatistics
    ) -> Iterator[str]:
        """Yield the most unusual taxel, where it is more unusual than chance makes one."""
        equal = [one.compared for one in references]
        # A median of m normal values has pi / (2 m) of their variance.
        residual = (trial.compared - np.median(equal, axis=0)) / (1 + pi / 2 / len(equal)) ** 0.5
        past = np.abs(self._residuals)
        self._residuals.append(residual)
        if len(past) < LEAST_RESIDUALS or not self.limits.false_alarms_percent:
            return
        scatter = np.maximum(MAD_TO_SD * np.median(past, axis=0), LEAST_SCATTER)
        tail = self.limits.false_alarms_percent / 100 / residual.size / 2
        worst = int(np.abs(residual / scatter).argmax())
        if abs(residual[worst]) > student_quantile(tail) * scatter[worst]:
            off, usual = np.expm1(residual[worst]), scatter[worst]
            name = trial.name_of(worst)
            yield f"the {name} is {off:+.0%} off equal trials, which scatter by {usual:.0%}"


def student_quantile(tail: float) -> float:
    """Return what Student's t with 30 degrees of freedom exceeds with this probability.

    Abramowitz and Stegun 26.7.5, to 1 %; SciPy takes as long to load as an engine to start.
    """
    z, n = -NormalDist().inv_cdf(tail), TAIL_FREEDOM
    first, second = (z**3 + z) / 4, (5 * z**5 + 16 * z**3 + 3 * z) / 96
    third = (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384
    return z + first / n + second / n**2 + third / n**3
