"""The load cell: its readings at rest, under a finger, and under known masses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rigctl.engine.calibration_values import MassReading
from rigctl.engine.calibrator import loadcell_values
from rigctl.engine.load_cell_scale import FULL_SCALE_COUNTS, fit_scale
from rigctl.engine.setup.check_result import CheckResult, Question, Remedy
from rigctl.engine.setup.context import SetupContext
from rigctl.errors import WrongUse
from rigctl.values import DrumState

REST_S, PRESS_S = 5.0, 1.0
SPIKE_SPREADS, SPIKE_COUNTS = 12.0, 20_000.0
RATE_SHARE = 0.12
"""Error of an HX711's own oscillator."""
UNIQUE_OF = 64
LEAST_UNIQUE = 8
LEAST_NOISE_COUNTS, MOST_NOISE_COUNTS, OPEN_NOISE_COUNTS = 2.0, 1500.0, 9000.0
"""A bridge at gain 128 scatters by some tens to some hundreds of counts, open inputs by more."""
PRESS_SIGMAS, LEAST_PRESS_COUNTS = 6.0, 2000.0
HX711_COUNTS_PER_SENSITIVITY = 256 * 2**23
"""Counts at capacity are the sensitivity times this (`rigctl.values`)."""
RIGHT_SCALE = (0.7, 1.4)
"""Found over expected scale: cells differ by some percent, mechanics by some ten."""
TWICE = (1.4, 2.9)

FREE_CELL = Question(
    "free_cell", "Take everything off the drum, and touch nothing until the next question."
)
PRESS_CELL = Question(
    "press_cell",
    "Press on the load cell with a finger, the way the sensor pushes the drum, about as hard as "
    "on a door bell, and keep pressing.",
)
RELEASE_CELL = Question("release_cell", "Let the load cell go.")
CAPACITY = Question(
    "capacity", "Which capacity has the load cell, by its label?", (), "g", 100, 50_000
)
SENSITIVITY = Question(
    "sensitivity", "Which rated output has it, by its label or data sheet?", (), "mV/V", 0.3, 4
)
MASS = Question("mass_first", "Which known mass do you have, near 200 g?", (), "g", 20, 5_000)
SECOND_MASS = Question("mass_second", "And a second one, near 500 g?", (), "g", 20, 5_000)


class CellReadings(NamedTuple):
    """A load cell for some seconds: samples a second, mean, spread and distinct values.

    ``spikes``: single samples far from all others, which mean and spread leave out.
    """

    rate_hz: float
    mean_counts: float
    sd_counts: float
    unique: int
    spikes: int = 0

    @property
    def text(self) -> str:
        """The readings in words."""
        return (
            f"{self.rate_hz:.1f} samples/s, {self.unique} different values of {UNIQUE_OF}, "
            f"noise {self.sd_counts:.0f} counts, mean {self.mean_counts:.0f}, "
            f"{self.spikes} single samples far off"
        )


def read_cell(polls: Sequence[DrumState]) -> CellReadings:
    """Return what the polls of some seconds say of the load cell."""
    samples = [sample for poll in polls for sample in poll.loadcell]
    if len(samples) < 2:
        return CellReadings(0.0, 0.0, 0.0, len(samples))
    counts = np.array([sample.raw_counts for sample in samples], np.float64)
    span_us = samples[-1].board_time_us - samples[0].board_time_us
    taken = samples[-1].sequence - samples[0].sequence
    off = np.abs(counts - np.median(counts))
    is_spike = off > SPIKE_SPREADS * max(1.0, float(np.median(off)))
    is_spike &= off > SPIKE_COUNTS
    rest = counts[~is_spike]
    return CellReadings(
        taken * 1e6 / max(1, span_us),
        float(rest.mean()),
        float(rest.std()),
        len(set(counts[-UNIQUE_OF:].tolist())),
        int(np.count_nonzero(is_spike)),
    )


async def check_at_rest(context: SetupContext) -> CheckResult:
    """Read the load cell while nobody touches it."""
    await context.ask(FREE_CELL)
    rate_hz = context.rig.config.loadcell.rate_hz
    return judge_at_rest(read_cell(await context.watch(REST_S)), rate_hz)


def judge_at_rest(seen: CellReadings, rate_hz: float = 80) -> CheckResult:
    """Judge rate, noise and values of an untouched load cell; ``rate_hz`` as configured."""
    expected = (
        f"{rate_hz:g} samples/s, more than {LEAST_UNIQUE} different values of {UNIQUE_OF}, noise "
        f"{LEAST_NOISE_COUNTS:g} to {MOST_NOISE_COUNTS:g} counts"
    )
    problem, *causes = _rest_problem(seen, rate_hz)
    return CheckResult(expected, seen.text, problem, tuple(causes))


def _rest_problem(seen: CellReadings, rate_hz: float) -> tuple[str, ...]:
    if seen.rate_hz == 0.0:
        return (
            "the load cell's amplifier sends nothing: its DOUT wire (D19) or its supply is off; "
            "check DOUT, VCC and GND at the amplifier and at the board",
            "cell data unplugged",
        )
    if abs(seen.mean_counts) >= FULL_SCALE_COUNTS - 1:
        return (
            "the load cell reads the end of its range: one arm of its bridge is off or a signal "
            "wire touches a supply; connect its four wires as its data sheet says",
        )
    if seen.unique < LEAST_UNIQUE or seen.sd_counts < LEAST_NOISE_COUNTS:
        return (
            "the load cell reads the same again and again, which no bridge does: the amplifier's "
            "SCK wire (D5) is off, or the amplifier hangs; check SCK, then switch its supply off "
            "and on",
            "cell clock unplugged",
        )
    if abs(seen.rate_hz / rate_hz - 1) > RATE_SHARE:
        return (
            f"the load cell's amplifier takes {seen.rate_hz:.0f} samples a second instead of "
            f"{rate_hz:g}: connect its RATE pin to its supply for 80 (most modules come with it "
            "at ground, for 10), or set [loadcell] rate_hz in rig.toml, which for 10 needs lower "
            "gains",
            "cell at 10 samples a second",
        )
    return _noise_problem(seen)


def _noise_problem(seen: CellReadings) -> tuple[str, ...]:
    if seen.sd_counts > OPEN_NOISE_COUNTS:
        return (
            "the load cell's reading scatters as that of open inputs does: A+ and A− hang on "
            "nothing; plug the cell in, and check these two wires",
            "cell unplugged",
        )
    if seen.sd_counts > MOST_NOISE_COUNTS:
        return (
            "the load cell's reading scatters far more than a bridge's: E− does not reach ground, "
            "a defect of some amplifier modules, or the cell's wires lie beside the motor's; "
            "measure from E− to GND, join them if they are apart, and lay the wires apart",
            "E− not connected to ground",
        )
    if seen.spikes:
        return (
            f"{seen.spikes} single samples of the load cell are far from all others: a plug of "
            "the cell or the amplifier is loose, or SCK picks up noise; solder the wires, keep "
            "them short, and lay them apart from the motor's",
            "single bad cell samples",
        )
    return ("",)


async def check_under_finger(context: SetupContext) -> CheckResult:
    """Compare the load cell's readings without and with a finger on it."""
    free = read_cell(await context.watch(PRESS_S))
    await context.ask(PRESS_CELL)
    pressed = read_cell(await context.watch(PRESS_S))
    await context.ask(RELEASE_CELL)
    return judge_press(free, pressed, context.rig.config.loadcell.scale_ug_per_count)


def judge_press(free: CellReadings, pressed: CellReadings, ug_per_count: int) -> CheckResult:
    """Judge whether and which way the reading follows a finger, with the scale's sign."""
    change = pressed.mean_counts - free.mean_counts
    grams = change * ug_per_count * 1e-6
    least = max(LEAST_PRESS_COUNTS, PRESS_SIGMAS * free.sd_counts)
    expected = f"a change to more force under the finger, by more than {least:,.0f} counts"
    words = f"more force, {grams:.0f} g" if grams > 0 else f"less force, −{-grams:.0f} g"
    found = f"a change by {change:+,.0f} counts: {words} by the scale so far".replace("-", "−")
    if abs(change) < least:
        return CheckResult(
            expected,
            f"a change by {change:+,.0f} counts, which is none".replace("-", "−"),
            "the load cell does not feel the finger: nothing feeds its bridge (E+ is off), A+ and "
            "A− touch each other, or its signal is on B+ and B− while channel A is read, which "
            "look alike; measure E+ to E− (the amplifier's supply), then A+ to A− unplugged "
            "(its rated resistance), then look that no screw bridges the cell",
            ("cell excitation open", "cell inputs shorted", "cell on channel B"),
        )
    if grams < 0:
        text = f"scale_ug_per_count = {-ug_per_count}"
        return CheckResult(
            expected,
            found,
            "the load cell reads less when it is pressed, so the drum would press harder and "
            f"harder: swap its two signal wires A+ and A−, or let rig.toml say {text}",
            ("cell reversed",),
            Remedy("loadcell", {"scale_ug_per_count": -ug_per_count}, text),
        )
    return CheckResult(expected, found)


async def check_scale(context: SetupContext) -> CheckResult:
    """Weigh two known masses, save the scale, and compare it with the cell's label."""
    capacity_g = await context.number(CAPACITY)
    sensitivity = await context.number(SENSITIVITY)
    masses_g = [await context.number(MASS), await context.number(SECOND_MASS)]
    await context.ask(FREE_CELL)
    readings = [await context.calibrator.read_mass(0.0)]
    for mass_g in masses_g:
        text = f"Lay {mass_g:g} g on the load cell, and let it come to rest."
        await context.ask(Question("lay_mass", text, unit="g", low=mass_g, high=mass_g))
        readings.append(await context.calibrator.read_mass(mass_g))
    await context.ask(FREE_CELL)
    result = judge_scale(readings, capacity_g * 1e6 / sensitivity * 1e3)
    if result.passed:
        scale = fit_scale(readings)
        values = loadcell_values(scale, masses_g, context.today())
        context.keep("loadcell", values.keys)
        await context.calibrator.save_settings(**values.settings)
    return result


def judge_scale(readings: Sequence[MassReading], capacity_ug_per_unit: float) -> CheckResult:
    """Judge the scale that the readings give, against that of the label.

    ``capacity_ug_per_unit``: µg at which the bridge's output is 1 V/V.
    """
    label_ug = capacity_ug_per_unit / HX711_COUNTS_PER_SENSITIVITY
    expected = f"{label_ug:.0f} µg a count by the label, and a straight line"
    try:
        scale = fit_scale(readings)
    except WrongUse as implausible:
        return CheckResult(expected, "no straight line", str(implausible))
    found = f"{scale.ug_per_count} µg a count, {100 * scale.nonlinearity_share:.2f} % off a line"
    ratio = abs(scale.ug_per_count) / label_ug
    problem, *causes = _scale_problem(ratio)
    return CheckResult(expected, found, problem, tuple(causes))


def _scale_problem(ratio: float) -> tuple[str, ...]:
    if RIGHT_SCALE[0] <= ratio <= RIGHT_SCALE[1]:
        return ("",)
    if TWICE[0] < ratio <= TWICE[1]:
        return (
            "the load cell gives about half of what its label says: only half of its bridge is "
            "connected, or the amplifier's gain is 64 instead of 128, which no reading tells "
            "apart; measure between its four wires: a full bridge shows about its rated "
            "resistance between E+ and E−, and no pair is open",
            "cell half-bridge",
            "amplifier at gain 64",
        )
    return (
        f"the load cell's scale is {ratio:.2g} times that of its label: a mass is not what was "
        "typed, or the label was misread; check both, and weigh again",
    )
