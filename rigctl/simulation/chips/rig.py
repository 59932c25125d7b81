"""The bench with both boards' real firmware: compiled images on simavr, in lock-step.

A slice is one world millisecond: first the drum's chip runs it, then the world with what that
chip did. The taxels' chip, on which nothing depends but the host, follows every four slices
with the voltages and edges that came of them. Edges between the chips carry cycle stamps.
Towards the drum's chip the world is one slice late, except for the index mark, which its step
pulses move pulse by pulse. Bytes that the host writes go onto the wire at the world time of the
call; bytes that arrive are handed over at the end of an advance.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigctl.config.resources import checkout
from rigctl.errors import RigFault
from rigctl.simulation.bench.bench import Bench
from rigctl.simulation.bench.ground_truth import GroundTruth
from rigctl.simulation.bench.mechanics import RING_MS, RodMotion
from rigctl.simulation.bench.noise import NoiseRows, Stream, generator
from rigctl.simulation.bench.parameters import WorldParameters
from rigctl.simulation.chips.board import BoardClock, ChipBoard
from rigctl.simulation.chips.simavr import (
    CHANNELS,
    Chip,
    Input,
    Kind,
    Output,
    ResetBy,
    load_library,
)
from rigctl.simulation.simulated_rig import (
    DRUM,
    TAXELS,
    FaultInjection,
    SimulatedLink,
    SimulatedRig,
)
from rigctl.wire.drum.codes import Signal

SLICE_US = 1000
DRUM_BAUD = 115_200
TAXELS_BAUD = 500_000
ANSWER_US = 60_000
"""Longest time for which an answer of the drum is awaited."""
BATCH = 4
"""Slices that the taxels' chip follows at a time: as USB hands over about every 4 ms."""
END_MM = 0.05
"""Actuator travel left at which an end switch opens."""

_WIRES = {int(Output.SYNC): Input.SYNC, int(Output.INDEX): Input.INDEX}


class ChipSimulation:
    """See :class:`rigctl.simulation.simulated_rig.SimulatedRig`.

    ``drum_board`` and ``taxels_board`` give tests and benchmarks the chips themselves.
    """

    def __init__(self, bench: Bench, drum_chip: Chip, taxels_chip: Chip) -> None:
        self.time_us = 0
        self._closed = False
        self._done_ms = self._taxels_ms = 0
        self._bench = bench
        self.drum = SimulatedLink(DRUM, bench.seed)
        self.taxels = SimulatedLink(TAXELS, bench.seed + 1)
        drum_clock, taxels_clock = _clocks(bench)
        self.drum_board = ChipBoard(drum_chip, drum_clock, self.drum, DRUM_BAUD, self._now_us)
        self.taxels_board = ChipBoard(
            taxels_chip, taxels_clock, self.taxels, TAXELS_BAUD, self._now_us
        )
        self.faults = FaultInjection(
            {DRUM: self.drum, TAXELS: self.taxels}, bench.disturbances, self._disturb, self._reset
        )
        self._adc_noise = NoiseRows(bench.seed, Stream.ADC, CHANNELS)
        self._edges: list[tuple[Input, int, float]] = []
        self._switches = {Input.ESTOP: 0, Input.END_UP: 0, Input.END_DOWN: 0}
        self._start_steps = self._wire_up()

    @property
    def truth(self) -> GroundTruth:
        """What really happened, up to now."""
        return self._bench.truth

    @property
    def slice_us(self) -> int:
        """To the next slice's end while an answer of the drum may come, else to the next batch."""
        if self.drum_board.is_awaited(ANSWER_US):
            return SLICE_US - self.time_us % SLICE_US
        return BATCH * SLICE_US - self.time_us % (BATCH * SLICE_US)

    def advance(self, until_us: int) -> None:
        """Run every whole slice up to a world time, then hand over what arrived.

        Once closed, only the time goes on: a loop may have timers left.
        """
        while not self._closed and (self._done_ms + 1) * SLICE_US <= until_us:
            self._run_slice()
            if self._done_ms - self._taxels_ms >= BATCH:
                self._run_taxels()
        self.time_us = until_us
        for board in (self.drum_board, self.taxels_board):
            board.deliver()

    def set_plate(self, texture: str) -> None:
        """Snap in the plate of a texture. Raises WrongUse for another name."""
        self._bench.set_plate(texture)

    def close(self) -> None:
        """Free the chips; the links close."""
        self._closed = True
        self.drum.close()
        self.taxels.close()
        self.drum_board.chip.close()
        self.taxels_board.chip.close()

    def _now_us(self) -> int:
        return self.time_us

    def _wire_up(self) -> float:
        """Put drum, mark and amplifier as the bench has them; the drum's place in steps."""
        p = self._bench.parameters
        x = self.drum_board.chip.exchange
        x.analog_rows = 2
        x.steps_per_turn = round(p.steps_per_turn)
        self._wire_mark()
        period_cycles = self._bench.loadcell.period_us * self.drum_board.clock.cycles_per_us
        x.loadcell_period_q16 = round(period_cycles * 65536)
        self.drum_board.chip.place_drum(round(p.start_mm / p.mm_per_step))
        return float(x.drum_place)

    def _wire_mark(self) -> None:
        p, bench = self._bench.parameters, self._bench.disturbances
        x = self.drum_board.chip.exchange
        there = Signal.INDEX not in bench.absent
        x.mark_length_steps = there * round(p.index_length_mm / p.mm_per_step)
        x.mark_inverted = int(Signal.INDEX in bench.inverted)

    def _run_slice(self) -> None:
        end_ms = self._done_ms + 1
        self._run_drum(end_ms)
        x = self.drum_board.chip.exchange
        if x.edge_count:
            self._note_edges()
        travel_mm = (x.drum_place - self._start_steps) * self._bench.parameters.mm_per_step
        self._bench.advance(end_ms, x.drive, RodMotion(end_ms * 1000.0, travel_mm, 0.0))
        self._done_ms = end_ms

    def _run_drum(self, end_ms: int) -> None:
        chip, plant = self.drum_board.chip, self._bench.plant
        x = chip.exchange
        rod_mm, travel_mm = plant.rod_mm, self._bench.parameters.actuator_travel_mm
        chip.analog[0, 0] = chip.analog[1, 0]
        chip.analog[1, 0] = self._potentiometer(rod_mm / travel_mm)
        wire = self._bench.disturbances.wire
        ends = (rod_mm < END_MM, rod_mm > travel_mm - END_MM)
        self._switch(Input.END_UP, int(wire(Signal.END_SWITCHES, ends[0])), end_ms)
        self._switch(Input.END_DOWN, int(wire(Signal.END_SWITCHES, ends[1])), end_ms)
        if x.loadcell_ready <= self.drum_board.clock.cycle(end_ms * SLICE_US):
            x.loadcell_counts = self._bench.loadcell.weigh(self._done_ms * 1000)
        self.drum_board.run(end_ms * SLICE_US)

    def _potentiometer(self, share: float) -> float:
        """What its wire shows; a missing one drifts somewhere."""
        bench = self._bench.disturbances
        if Signal.POSITION in bench.absent:
            return 0.37
        return 1.0 - share if Signal.POSITION in bench.inverted else share

    def _switch(self, signal: Input, level: int, end_ms: int) -> None:
        if self._switches[signal] != level:
            self._switches[signal] = level
            at_us = max(self.time_us, (end_ms - 1) * SLICE_US)
            self.drum_board.chip.set_input(signal, self.drum_board.clock.cycle(at_us), level)

    def _note_edges(self) -> None:
        """What the drum did on the two wires to the taxel board, in world time."""
        chip, clock = self.drum_board.chip, self.drum_board.clock
        for i in range(chip.exchange.edge_count):
            wire = _WIRES.get(int(chip.edge_signal[i]))
            if wire is None:
                continue
            at_us, level = clock.us(int(chip.edge_cycle[i])), int(chip.edge_level[i])
            if wire is Input.SYNC:
                self._bench.sync(level, int(at_us))
                level = self._bench.sync_level
            self._edges.append((wire, level, at_us))

    def _run_taxels(self) -> None:
        """Let the taxels' chip follow up to where the world is."""
        chip, skin = self.taxels_board.chip, self._bench.skin
        for signal, level, at_us in self._edges:
            chip.set_input(signal, self.taxels_board.clock.cycle(at_us), level)
        self._edges.clear()
        skin.advance()
        first, count = self._taxels_ms, self._done_ms - self._taxels_ms
        rows = np.arange(first, first + count + 1) % RING_MS
        chip.analog[: count + 1] = skin.levels[rows]
        noise = self._adc_noise.rows(first, count)
        np.multiply(noise, self._bench.parameters.adc_noise_counts, out=chip.noise[:count])
        chip.exchange.analog_rows = count + 1
        self._taxels_ms = self._done_ms
        self.taxels_board.run(self._done_ms * SLICE_US)

    def _disturb(self) -> None:
        bench = self._bench.disturbances
        x = self.drum_board.chip.exchange
        self._wire_mark()
        x.loadcell_mode = int(bench.loadcell)
        x.motor_jammed = int(bench.motor_jammed)
        estop = bench.wire(Signal.ESTOP, bench.estop_pressed)
        self._switch(Input.ESTOP, int(estop), self._done_ms + 1)
        self._bench.disturb()

    def _reset(self, board: str) -> None:
        if self._taxels_ms < self._done_ms:
            self._run_taxels()
        chip = {DRUM: self.drum_board, TAXELS: self.taxels_board}[board].chip
        chip.reset(ResetBy.PIN)


def _clocks(bench: Bench) -> tuple[BoardClock, BoardClock]:
    """The drum's clock and the taxels'; nobody switches on two boards in the same microsecond."""
    on_us = int(generator(bench.seed, Stream.POWER_UP).integers(0, SLICE_US))
    p = bench.parameters
    return BoardClock(p.drum_clock_ppm), BoardClock(p.taxel_clock_ppm, on_us)


def shim_path() -> Path:
    """The compiled simavr shim of this checkout. Raises RigFault outside of a checkout."""
    root = checkout()
    if root is None:
        raise RigFault("simulated chips need a checkout: use --rig virtual")
    return root / "build" / "sim" / "libchips.so"


def open_chips(
    parameters: WorldParameters, seed: int, drum_image: Path, taxels_image: Path
) -> SimulatedRig:
    """A bench whose boards run these images, the same for a seed.

    Raises RigFault where image or shim is missing, WrongUse for an impossible parameter.
    """
    library = load_library(shim_path())
    bench = Bench(parameters, seed)
    drum_chip = Chip(library, drum_image, Kind.DRUM)
    try:
        taxels_chip = Chip(library, taxels_image, Kind.TAXELS)
    except RigFault:
        drum_chip.close()
        raise
    return ChipSimulation(bench, drum_chip, taxels_chip)
