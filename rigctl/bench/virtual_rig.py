"""The virtual rig: the bench with both boards' firmware, compiled for this computer."""

from __future__ import annotations

import math
from collections import deque
from functools import cache
from itertools import pairwise
from pathlib import Path

from rigctl.bench.bench import LOG_EVERY_MS, Bench
from rigctl.bench.boards.driver_board import DriverBoard
from rigctl.bench.boards.drum_cosimulation import DrumCosimulation
from rigctl.bench.boards.taxels import FLUSH_US, VirtualTaxels
from rigctl.bench.circuit import TestPoints
from rigctl.bench.ground_truth import GroundTruth
from rigctl.bench.hands import SimulatedHands
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.simulated_rig import DRUM, TAXELS, FaultInjection, SimulatedLink
from rigctl.boards.sensor_driver import SensorDriver
from rigctl.config.rig_config import PAPER_ARRAY, TaxelArray

SLICE_US = 100_000
"""A timer of the host, or a reply of the drum, ends nearly every advance before."""
WARM_UP_US = 300_000
"""By then the boards have booted, the load cell converts and the taxels send frames."""

BYTE_CYCLES = 16_000_000 * 10 // 115_200
"""Duration of a byte; a longer gap separates two replies."""


def open_virtual_rig(
    parameters: WorldParameters | None = None,
    seed: int = 0,
    drum_library: Path | None = None,
    sensor: TaxelArray = PAPER_ARRAY,
    driver: SensorDriver | None = None,
) -> VirtualRig:
    """Return a virtual rig with this sensor at power-up, reproducible for a seed.

    ``driver``: of the sensor's board, which then sends as that driver encodes. Raises WrongUse for
    a parameter outside its plausible range, RigFault if a board's library cannot be used,
    ConfigError if the taxel board's was compiled for another sensor or the driver cannot encode.
    """
    bench = Bench(parameters or WorldParameters(), seed, sensor=sensor)
    return VirtualRig(bench, drum_library, None if driver is None else DriverBoard(driver))


@cache
def compile_kernels(sensor: TaxelArray = PAPER_ARRAY, driver: SensorDriver | None = None) -> None:
    """Compile or load every kernel of a simulated bench.

    Compiling takes half a minute after an update; during a run it would stall a paced simulation.
    """
    rig = open_virtual_rig(sensor=sensor, driver=driver)
    rig.advance(WARM_UP_US)
    rig.truth.take()
    rig.close()


class DrumCable:
    """Carries bytes between a link and the drum board. Times are simulated microseconds."""

    def __init__(self, drum: DrumCosimulation, link: SimulatedLink) -> None:
        self._drum = drum
        self._link = link
        self._replies: deque[tuple[bytes, float]] = deque()
        self._request_end_us = -math.inf
        self._now_us = 0
        link.attach(self._receive)

    @property
    def next_us(self) -> float:
        """Time at which a request is complete or a reply arrives; infinite on an idle cable."""
        if self._replies:
            return self._replies[0][1]
        return self._request_end_us if self._request_end_us >= self._now_us else math.inf

    def advance(self, now_us: int) -> None:
        """Deliver the replies that have arrived completely by now."""
        self._now_us = now_us
        if self._drum.firmware.io.tx_count:
            self._split_replies()
        while self._replies and self._replies[0][1] <= now_us:
            data, at_us = self._replies.popleft()
            self._link.deliver(data, at_us * 1e-6)

    def reset(self) -> None:
        """Discard what the board had not sent when it was reset."""
        self._drum.firmware.take_sent()
        self._replies.clear()
        self._request_end_us = -math.inf

    def _receive(self, data: bytes) -> None:
        self._drum.firmware.receive(data, self._drum.cycle(self._now_us))
        # Whole milliseconds: the board runs in them, and has replied at the end of the next.
        end_us = self._drum.us(self._drum.firmware.io.rx_end_cycle)
        self._request_end_us = 1000.0 * math.ceil(end_us * 1e-3)

    def _split_replies(self) -> None:
        data, cycles = self._drum.firmware.take_sent()
        pauses = (cycles[1:] - cycles[:-1] > 1.5 * BYTE_CYCLES).nonzero()[0] + 1
        for first, end in pairwise((0, *pauses.tolist(), len(data))):
            self._replies.append((data[first:end], self._drum.us(int(cycles[end - 1]))))


class VirtualRig:
    """A :class:`~rigctl.bench.simulated_rig.SimulatedRig` whose boards run in this process."""

    def __init__(
        self, bench: Bench, drum_library: Path | None = None, board: DriverBoard | None = None
    ) -> None:
        self.time_us = 0
        self._closed = False
        self._flushed_us = 0
        self._bench = bench
        self.drum = SimulatedLink(DRUM, 2 * bench.seed)
        self.taxels = SimulatedLink(TAXELS, 2 * bench.seed + 1)
        self.cosimulation = DrumCosimulation(bench, drum_library)
        self._drum_cable = DrumCable(self.cosimulation, self.drum)
        self._taxels = VirtualTaxels(bench, board)
        self.taxels.attach(self._taxels.firmware.receive)
        self.cosimulation.on_index = self._taxels.set_index
        bench.on_sync = self._taxels.set_sync
        links = {DRUM: self.drum, TAXELS: self.taxels}
        self.faults = FaultInjection(
            links, bench.disturbances, self._apply_disturbances, self._reset, self._stall_computer
        )
        self.hands = SimulatedHands(bench, self.faults, lambda: self.test_points)

    @property
    def truth(self) -> GroundTruth:
        return self._bench.truth

    @property
    def slice_us(self) -> int:
        return max(1, math.ceil(min(SLICE_US, self._drum_cable.next_us - self.time_us)))

    def advance(self, until_us: int) -> None:
        """Simulate every whole millisecond up to a time.

        A closed rig only advances its time: an event loop may still have timers.
        """
        until_ms = until_us // 1000
        while not self._closed and self.cosimulation.time_ms < until_ms:
            self.cosimulation.run(min(until_ms, self.cosimulation.time_ms + LOG_EVERY_MS))
            self._flush_taxels()
        self.time_us = until_us
        if not self._closed:
            self._drum_cable.advance(until_us)

    @property
    def plate(self) -> str:
        return self._bench.plate

    def set_plate(self, texture: str) -> None:
        self._bench.set_plate(texture)

    def skip_mountings(self, count: int) -> None:
        self._bench.skip_mountings(count)

    @property
    def test_points(self) -> TestPoints:
        return self._bench.test_points(self.cosimulation.firmware.io)

    def close(self) -> None:
        self._closed = True
        self.drum.close()
        self.taxels.close()
        self.cosimulation.firmware.close()
        self._taxels.firmware.close()

    def _flush_taxels(self) -> None:
        """Deliver what the taxels' cable has flushed by now."""
        now_us = self.cosimulation.time_ms * 1000
        while self._flushed_us + FLUSH_US <= now_us and not self._closed:
            self._flushed_us += FLUSH_US
            data = self._taxels.send(self._flushed_us)
            if data:
                self.taxels.deliver(data, self._flushed_us * 1e-6)

    def _apply_disturbances(self) -> None:
        self.cosimulation.apply_disturbances()
        self._taxels.firmware.io.supply_mv = self._bench.disturbances.circuit.logic_mv

    def _stall_computer(self, seconds: float) -> None:
        self.advance(self.time_us + round(seconds * 1e6))

    def _reset(self, board: str) -> None:
        if board == DRUM:
            self.cosimulation.reset()
            self._drum_cable.reset()
        else:
            self._taxels.reset(self.time_us)
