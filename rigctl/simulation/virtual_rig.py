"""The virtual rig: the bench with both boards' firmware, compiled for this computer."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rigctl.simulation.bench.bench import LOG_EVERY_MS, Bench
from rigctl.simulation.bench.ground_truth import GroundTruth
from rigctl.simulation.bench.parameters import WorldParameters
from rigctl.simulation.boards.drum import VirtualDrum
from rigctl.simulation.boards.drum_stepper import DrumStepper
from rigctl.simulation.boards.taxels import FLUSH_US, VirtualTaxels
from rigctl.simulation.simulated_rig import DRUM, TAXELS, FaultInjection, SimulatedLink

SLICE_US = 20_000
WARM_US = 300_000
"""By then the boards have booted, the load cell speaks and frames were sent."""


def open_virtual(
    parameters: WorldParameters | None = None, seed: int = 0, drum_library: Path | None = None
) -> VirtualRig:
    """A virtual rig at power-up, the same for a seed; the drum's board may be another's.

    Raises WrongUse when a parameter lies outside its plausible range, RigFault where a board's
    library cannot be used.
    """
    return VirtualRig(Bench(parameters or WorldParameters(), seed), drum_library)


@cache
def warm() -> None:
    """Have everything compiled that a simulated bench needs, or load what was.

    Later it would hold up a world that is watched: after an update it takes half a minute.
    """
    rig = open_virtual()
    rig.advance(WARM_US)
    rig.close()


class VirtualRig:
    """A :class:`~rigctl.simulation.simulated_rig.SimulatedRig` whose boards run in this process."""

    def __init__(self, bench: Bench, drum_library: Path | None = None) -> None:
        self.time_us = 0
        self._closed = False
        self._bench = bench
        self.drum = SimulatedLink(DRUM, 2 * bench.seed)
        self.taxels = SimulatedLink(TAXELS, 2 * bench.seed + 1)
        self.drum_bench = DrumStepper(bench, drum_library)
        self._drum = VirtualDrum(self.drum_bench, self.drum)
        self._taxels = VirtualTaxels(bench)
        self.taxels.attach(self._taxels.board.receive)
        self.drum_bench.on_mark = self._taxels.mark_edge
        bench.on_sync = self._taxels.sync_edge
        links = {DRUM: self.drum, TAXELS: self.taxels}
        self.faults = FaultInjection(
            links, bench.disturbances, self.drum_bench.disturb, self._reset
        )

    @property
    def truth(self) -> GroundTruth:
        """What really happened, up to now."""
        return self._bench.truth

    @property
    def slice_us(self) -> int:
        """Longest useful advance from now, µs."""
        return max(1, int(min(SLICE_US, self._drum.next_us - self.time_us)))

    def advance(self, until_us: int) -> None:
        """Run every whole millisecond up to a world time.

        Once closed, only the time goes on: a loop may have timers left.
        """
        while not self._closed and (self.drum_bench.time_ms + 1) * 1000 <= until_us:
            self._run(until_us // 1000)
        self.time_us = until_us
        if not self._closed:
            self._drum.pass_time(until_us)

    def set_plate(self, texture: str) -> None:
        """Snap in the plate of texture ``"A"``–``"P"``. Raises WrongUse for another name."""
        self._bench.set_plate(texture)

    def close(self) -> None:
        """Close both cables and free the boards."""
        self._closed = True
        self.drum.close()
        self.taxels.close()
        self.drum_bench.board.close()
        self._taxels.board.close()

    def _run(self, until_ms: int) -> None:
        """Up to the next flush of the taxels' cable, or as far as is wanted."""
        done_ms, flush_ms = self.drum_bench.time_ms, FLUSH_US // 1000
        flush_at_ms = (done_ms // flush_ms + 1) * flush_ms
        self.drum_bench.run(min(until_ms, flush_at_ms, done_ms + LOG_EVERY_MS))
        if self.drum_bench.time_ms == flush_at_ms:
            data = self._taxels.send(flush_at_ms * 1000)
            if data:
                self.taxels.deliver(data, flush_at_ms * 1e-3)

    def _reset(self, board: str) -> None:
        if board == DRUM:
            self.drum_bench.reset()
            self._drum.reset()
        else:
            self._taxels.reset(self.time_us)
