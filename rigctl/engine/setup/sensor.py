"""The sensor: supply and self-test of its board, noise at rest, and its taxels' order."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.taxel_frames import SelfTest, input_name, number_word
from rigctl.config.rig_config import ADC_MAX, PAPER_ARRAY
from rigctl.engine.calibration_values import wiring_words
from rigctl.engine.setup.check_result import DONE, CheckResult, Question, Remedy
from rigctl.engine.setup.context import SetupContext
from rigctl.engine.wiring_steps import WiringStep, WiringSteps, mean_readings
from rigctl.errors import WrongUse

LEAST_SUPPLY_V, MOST_SUPPLY_V = 4.6, 5.4
MOST_NOISE_COUNTS = 8.0
NO_DIVIDER_SHARE = 0.9
REST_S = 1.0
TRIES = 3

LEAVE_SENSOR = Question("leave_sensor", "Put the sensor in, unpressed, and do not touch it.")


class SensorReadings(NamedTuple):
    """The untouched sensor: its board's supply in V, findings, and each taxel's mean and spread.

    ``shares``: the sum of each input's readings over full scale, near 1 without a divider.
    """

    supply_v: float
    test: SelfTest
    findings: tuple[str, ...]
    mean: NDArray[np.float64]
    sd: NDArray[np.float64]
    shares: tuple[float, ...] = (0.0,) * PAPER_ARRAY.inputs


async def check_sensor(context: SetupContext) -> CheckResult:
    """Let the taxel board test itself, and read the untouched sensor.

    The board of a driver has no self-test; its readings are judged as if it had 10 bits.
    """
    await context.ask(LEAVE_SENSOR)
    taxels = context.rig.taxels
    array = context.rig.config.taxels
    is_ours = context.rig.sensor_plugin is None
    test = await taxels.test() if is_ours else SelfTest(0, 0)
    samples = await context.taxel_samples(REST_S) * ((ADC_MAX + 1) / (array.full_scale + 1))
    supply_v = taxels.status.supply_mv / 1000 if taxels.status else 0.0
    mean, sd = samples.mean(axis=0), samples.std(axis=0)
    found = tuple(taxels.findings)
    shares = input_shares(mean, array.order, array.inputs) if is_ours else (0.0,)
    return judge_sensor(SensorReadings(supply_v, test, found, mean, sd, shares))


def input_shares(
    mean: NDArray[np.float64], order: Sequence[int], n_inputs: int
) -> tuple[float, ...]:
    """Return the sum of each input's readings over full scale; ``mean`` is in the sensor's order.

    Taxels share an input: with conductances G the readings are G over their sum with the
    divider's, so that without a divider they add up to full scale.
    """
    inputs = np.array(order) % n_inputs
    return tuple(float(mean[inputs == i].sum() / ADC_MAX) for i in range(n_inputs))


def judge_sensor(seen: SensorReadings) -> CheckResult:
    """Judge the supply, the board's own findings, and each taxel's noise."""
    expected = f"{LEAST_SUPPLY_V:g} to {MOST_SUPPLY_V:g} V, no finding, noise below 8 counts"
    found = (
        f"{seen.supply_v:.2f} V, {'; '.join(seen.findings) or 'no finding'}, noise up to "
        f"{seen.sd.max():.1f} counts"
    )
    problem, *causes = _sensor_problem(seen)
    return CheckResult(expected, found, problem, tuple(causes))


def _sensor_problem(seen: SensorReadings) -> tuple[str, ...]:
    if seen.supply_v and not LEAST_SUPPLY_V <= seen.supply_v <= MOST_SUPPLY_V:
        return (
            f"the board's supply is {seen.supply_v:.2f} V instead of 5 V: use a short USB cable "
            "at a port of the computer itself, and feed nothing else from the board's 5 V pin",
            "supply at 4.4 V",
        )
    if seen.findings:
        more = f" ({len(seen.findings)} findings)" if len(seen.findings) > 1 else ""
        return (f"{seen.findings[0]}{more}", *_test_causes(seen))
    for input_, share in enumerate(seen.shares):
        if share > NO_DIVIDER_SHARE:
            return (
                f"the {number_word(seen.mean.size // len(seen.shares))} taxels of input "
                f"{input_name(input_)} add up to {100 * share:.0f} % of "
                "full scale untouched: solder its resistor to ground",
                "taxel divider missing",
            )
    stuck = np.flatnonzero((seen.sd == 0) & (seen.mean >= ADC_MAX))
    if stuck.size:
        return (
            f"taxel {stuck[0] + 1} stays at {seen.mean[stuck[0]]:.0f} counts: it is shorted, or "
            "pressed by how the sensor is mounted; look for a short, and free the sensor",
        )
    noisy = int(seen.sd.argmax())
    if seen.sd[noisy] > MOST_NOISE_COUNTS:
        return (
            f"taxel {noisy + 1} scatters by {seen.sd[noisy]:.0f} counts: its wires are long or lie "
            "beside the motor's, or its contact is loose; lay them apart and press the plug in",
        )
    return ("",)


def _test_causes(seen: SensorReadings) -> tuple[str, ...]:
    test, n_silent, n_inputs = seen.test, seen.test.silent.bit_count(), len(seen.shares)
    named = {
        "taxel inputs shorted": test.inputs_together,
        "taxel divider missing": test.inputs_open,
        "taxel line open": n_silent >= n_inputs,
        "taxel input open": 0 < n_silent < n_inputs,
    }
    return tuple(name for name, is_found in named.items() if is_found)


async def check_order(context: SetupContext) -> CheckResult:
    """Identify each taxel's reading by unplugging a layer and pressing each place."""
    steps = WiringSteps(context.rig, partial(mean_readings, context.rig, context.require_taxels))
    try:
        while steps.step is not WiringStep.DONE:
            if problem := await _take(context, steps):
                return _unclear_order(context.rig.config.taxels.order, problem)
    finally:
        steps.end()
    return judge_order(steps.wiring, context.rig.config.taxels.order)


async def _take(context: SetupContext, steps: WiringSteps) -> str:
    """Take one step; what is not clear is asked again. Return why it stays so, else nothing."""
    unclear = ""
    for _ in range(TRIES):
        key = f"sensor_{steps.step.name.lower()}"
        before = f"Not clear: {unclear}. " if unclear else ""
        await context.ask(Question(key, before + steps.question, (DONE,)))
        try:
            await steps.take()
        except WrongUse as refusal:
            unclear = str(refusal)
        else:
            return ""
    return unclear


def _unclear_order(order: Sequence[int], unclear: str) -> CheckResult:
    """Return the result of presses that stay unclear; two inputs that touch always do."""
    return CheckResult(
        wiring_words(order),
        "presses that are not clear",
        f"{unclear}; where it was one place only, the two inputs touch each other: separate them",
        ("taxel inputs shorted",),
    )


def judge_order(wiring: Sequence[int], expected: Sequence[int]) -> CheckResult:
    """Judge the order of the taxels that was found, against that of ``rig.toml``."""
    asked, found = wiring_words(expected), wiring_words(wiring)
    if tuple(wiring) == tuple(expected):
        return CheckResult(asked, found)
    text = f"{found}, from the next connection on"
    remedy = Remedy("taxels", {"wiring": list(wiring)}, text)
    half = len(expected) // 2
    if tuple(wiring) == (*expected[half:], *expected[:half]):
        return CheckResult(
            asked,
            found,
            "the two layers are exchanged: the bottom layer's read lines are where the top "
            "layer's belong; plug A0 to A2 and A3 to A5 the other way round, or let rig.toml take "
            "the order that was found",
            ("taxel layers exchanged",),
            remedy,
        )
    return CheckResult(
        asked,
        found,
        "lines or read lines of the sensor are exchanged against rig.toml, so taxels would change "
        "places: compare D4 to D6 and A0 to A5 with the drawing and plug them so, or let rig.toml "
        "take the order that was found",
        ("taxel lines permuted", "taxel inputs permuted"),
        remedy,
    )
