"""The steps of an identification of the taxels: what a person does, then a measurement.

Every step can be repeated: one whose result is not clear changes nothing.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from rigctl.config.rig_config import PAPER_ARRAY, TaxelArray
from rigctl.engine.rig import Rig
from rigctl.engine.wiring_identification import (
    PER_LAYER,
    ContradictoryPresses,
    MeanReadings,
    WiringIdentification,
    place_name,
)
from rigctl.errors import RigFault, WrongUse
from rigctl.values import Block

STALE_S = 0.5
"""Samples that arrive this soon after an answer may be older than it, so they are dropped."""
SAMPLES = 1000
POLL_S = 0.05
TIMEOUT_S = 5.0


class WiringStep(Enum):
    """A step, with what a person does before its measurement."""

    UNPLUG = (
        "Unplug the three read lines of the bottom layer (A3, A4, A5 if wired as drawn). "
        "Do not touch the sensor."
    )
    FLAT = "Press the whole sensor flat and hold it."
    PLUG = "Plug the lines in again. Do not touch the sensor."
    PRESS = "Press {place} with a blunt tip of about 3 mm and hold it."
    DONE = ""


class WiringSteps:
    """The steps of one identification; ``measure`` returns the mean readings of a second.

    A simulated rig is touched as each step says.
    """

    def __init__(self, rig: Rig, measure: Callable[[], Awaitable[MeanReadings]]) -> None:
        self._rig = rig
        self._measure = measure
        self._identification = WiringIdentification()
        self._rest: MeanReadings | None = None
        self.wiring: tuple[int, ...] = ()
        """The reading at each place, empty before all are known."""

    @property
    def step(self) -> WiringStep:
        """The step that is next."""
        if self.wiring:
            return WiringStep.DONE
        if not self._identification.lower:
            return WiringStep.UNPLUG if self._rest is None else WiringStep.FLAT
        return WiringStep.PLUG if self._rest is None else WiringStep.PRESS

    @property
    def place(self) -> int | None:
        """The place to press, row by row from 0; None in another step."""
        return self._identification.place if self.step is WiringStep.PRESS else None

    @property
    def question(self) -> str:
        """What a person does before the next measurement, empty when all is known."""
        place = self.place
        return self.step.value.format(place="" if place is None else place_name(place))

    @property
    def number(self) -> int:
        """Number of the next step, from 0 to ``N_STEPS`` of the identification."""
        before = (WiringStep.UNPLUG, WiringStep.FLAT, WiringStep.PLUG)
        if self.step in before:
            return before.index(self.step)
        return len(before) + self._identification.place

    @property
    def pressed(self) -> tuple[tuple[int, int], ...]:
        """The two readings of each place that was pressed, the top layer's first."""
        return self._identification.pairs

    async def take(self) -> str:
        """Measure the step; return a sentence on its result.

        Raises WrongUse where it is not clear, so that it is repeated, ContradictoryPresses where
        the identification begins again.
        """
        step = self.step
        simulates = self._rig.touch_sensor(self._pressed_places(), step in _UNPLUGGED)
        try:
            readings = await self._measure()
        finally:
            if simulates:
                self._rig.touch_sensor((), step in _UNPLUGGED)
        return self._add(step, readings)

    def undo_press(self) -> None:
        """Ask for the last place again. Raises WrongUse where none was pressed."""
        self._identification.remove_press()
        self.wiring = ()

    def end(self) -> None:
        """Leave a simulated sensor untouched."""
        self._rig.touch_sensor((), unplugged=False)

    def _pressed_places(self) -> Sequence[int]:
        if self.step is WiringStep.FLAT:
            return range(PER_LAYER)
        return () if self.place is None else (self.place,)

    def _add(self, step: WiringStep, readings: MeanReadings) -> str:
        rest = self._rest
        if rest is None:
            self._rest = readings
            return "the readings of the untouched sensor are known"
        if step is WiringStep.FLAT:
            self._rest = None  # the lines are plugged in again, or unplugged once more
            return self._identification.add_unplugged_press(rest, readings)
        said = self._identification.add_press(rest, readings)
        if self._identification.place == PER_LAYER:
            self._finish()
        return said

    def _finish(self) -> None:
        """Take the order, or begin again where the presses contradict each other."""
        try:
            self.wiring = self._identification.wiring()
        except ContradictoryPresses:
            self._identification, self._rest = WiringIdentification(), None
            raise


_UNPLUGGED = (WiringStep.UNPLUG, WiringStep.FLAT)


def require_identifiable(taxels: TaxelArray, name: str) -> None:
    """Raise WrongUse for a sensor of another shape; ``name`` begins the sentence."""
    if (taxels.shape, taxels.inputs) != (PAPER_ARRAY.shape, PAPER_ARRAY.inputs):
        raise WrongUse(
            f"{name}: only 3 × 3 taxels in two layers can be identified; write wiring by hand"
        )


async def mean_readings(rig: Rig, check: Callable[[], None]) -> MeanReadings:
    """Return the mean of one second, float64 (n_taxels,), in the order of the wire.

    ``check`` may raise, as for a lost board. Raises RigFault where too few samples arrive.
    """
    samples: list[NDArray[np.uint16]] = []

    def add(block: Block) -> None:
        samples.append(block.samples)

    await asyncio.sleep(STALE_S)
    check()
    unsubscribe = rig.taxels.on_block(add)
    try:
        await _wait_for_samples(samples, check)
    finally:
        unsubscribe()
    return _in_wire_order(rig.config.taxels, np.concatenate(samples).mean(axis=0))


async def _wait_for_samples(
    samples: Sequence[NDArray[np.uint16]], check: Callable[[], None]
) -> None:
    loop = asyncio.get_running_loop()
    end_s = loop.time() + TIMEOUT_S
    while sum(map(len, samples)) < SAMPLES:
        await asyncio.sleep(POLL_S)
        check()
        if loop.time() > end_s:
            raise RigFault(
                f"the taxel board sent fewer than {SAMPLES} samples in {TIMEOUT_S:g} s: "
                "check its cable"
            )


def _in_wire_order(taxels: TaxelArray, means: NDArray[np.float64]) -> MeanReadings:
    """Return means of the sensor's places at their readings."""
    readings = np.empty(means.size)
    readings[list(taxels.order)] = means
    return readings
