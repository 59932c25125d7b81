"""The bench with both boards' real firmware images on simavr, in lock-step.

A slice is one simulated millisecond: first the drum's chip runs it, then the bench with that chip's
outputs. The taxels' chip, on which only the host depends, follows every four slices with the
resulting voltages and edges. Edges between the chips have cycle stamps. The drum's chip sees the
bench one slice late, except for the index mark, which moves with each step pulse. Bytes from the
host are on the wire from the time of the call; bytes to the host are delivered at the end of an
advance.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from rigctl.bench.bench import Bench
from rigctl.bench.chips.simavr import (
    CHANNELS,
    Chip,
    Input,
    Kind,
    Output,
    ResetBy,
    load_library,
)
from rigctl.bench.circuit import TestPoints
from rigctl.bench.electrics import actuator_pins
from rigctl.bench.ground_truth import GroundTruth
from rigctl.bench.hands import SimulatedHands
from rigctl.bench.mechanics import RING_MS, DrumTrajectory
from rigctl.bench.noise import NoiseRows, NoiseStream, random_generator
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.simulated_rig import (
    DRUM,
    TAXELS,
    FaultInjection,
    SimulatedLink,
    SimulatedRig,
)
from rigctl.config.resources import checkout
from rigctl.config.rig_config import PAPER_ARRAY, TaxelArray
from rigctl.errors import RigFault

NOMINAL_HZ = 16_000_000
BITS_PER_BYTE = 10


class BoardClock:
    """Exact conversion between simulated µs and chip cycles.

    The resonator is fast by ``ppm``; the chip is switched on at ``on_us``.
    """

    def __init__(self, ppm: float, on_us: int = 0) -> None:
        self._on_us = on_us
        self._rate_mhz = NOMINAL_HZ * 1000 + round(ppm * NOMINAL_HZ / 1000)

    def cycle(self, at_us: float) -> int:
        """Return the cycle at a simulated time; 0 before the chip is switched on."""
        return int(max(0, at_us - self._on_us) * self._rate_mhz // 10**9)

    def us(self, cycle: int) -> float:
        """Return the simulated time of a cycle."""
        return self._on_us + cycle * 1e9 / self._rate_mhz

    @property
    def cycles_per_us(self) -> float:
        """Cycles in one simulated microsecond."""
        return self._rate_mhz / 1e9


class ChipBoard:
    """A chip with clock and cable. ``now_us`` returns the time at which the host writes.

    ``baud`` is the host's; each byte takes its real time in both directions.
    """

    def __init__(
        self,
        chip: Chip,
        clock: BoardClock,
        link: SimulatedLink,
        baud: int,
        now_us: Callable[[], int],
    ) -> None:
        self.chip = chip
        self.clock = clock
        self.link = link
        self._now_us = now_us
        self._to_board = b""
        self._written_us = 0
        self._waiting = self._replying = False
        self._to_host = bytearray()
        self._on_wire = b""
        self._arrived_us = 0.0
        byte_us = BITS_PER_BYTE * 1e6 / baud
        chip.io.host_byte_q16 = round(byte_us * clock.cycles_per_us * 65536)
        link.attach(self._receive)

    def is_reply_pending(self, timeout_us: int) -> bool:
        """Return whether a reply to the host's last write may still arrive.

        The reply has ended when the board has sent something and was then silent for one run.
        """
        return self._waiting and self._now_us() - self._written_us < timeout_us

    def run(self, until_us: int) -> None:
        """Run the chip up to a simulated time."""
        if self._to_board:
            taken = self.chip.send(self._to_board, self.clock.cycle(self._written_us))
            self._to_board = self._to_board[taken:]
        end = self.clock.cycle(until_us)
        self.chip.run(end)
        self._collect(end)

    def deliver(self) -> None:
        """Deliver the bytes that have arrived at the host since the last call."""
        if self._to_host:
            data, self._to_host = bytes(self._to_host), bytearray()
            self.link.deliver(data, self._arrived_us / 1e6)

    def _receive(self, data: bytes) -> None:
        self._to_board += data
        self._written_us = self._now_us()
        self._waiting, self._replying = True, False

    def _collect(self, end: int) -> None:
        """Collect the bytes whose stop bit has ended; a last one may still be on the wire."""
        count = self.chip.io.tx_count
        self._to_host += self._on_wire
        self._on_wire = b""
        self._waiting = self._waiting and not (self._replying and count == 0)
        self._replying = count > 0
        if count == 0:
            return
        cycles = self.chip.tx_cycle[:count]
        arrived = count
        while arrived and cycles[arrived - 1] > end:
            arrived -= 1
        self._to_host += self.chip.tx[:arrived].tobytes()
        self._on_wire = self.chip.tx[arrived:count].tobytes()
        # If all are still on the wire, the bytes before them arrived a moment earlier.
        self._arrived_us = self.clock.us(int(cycles[arrived - 1]) if arrived else end)


SLICE_US = 1000
DRUM_BAUD = 115_200
TAXELS_BAUD = 500_000
REPLY_TIMEOUT_US = 60_000
BATCH = 4
"""Slices that the taxels' chip runs at a time; USB delivers about every 4 ms."""
SPIKE_EVERY_MS, SPIKE_US = 50, 5
"""Period and length of spikes on the wires of switches with noise."""

_WIRES = {int(Output.SYNC): Input.SYNC, int(Output.INDEX): Input.INDEX}


class ChipSimulation:
    """A :class:`~rigctl.bench.simulated_rig.SimulatedRig` whose boards are simulated chips.

    ``drum_board`` and ``taxels_board`` give tests and benchmarks access to the chips.
    """

    def __init__(
        self,
        bench: Bench,
        drum_chip: Chip,
        taxels_chip: Chip,
        with_bootloader: Collection[str] = (),
    ) -> None:
        self.time_us = 0
        self._closed = False
        self._done_ms = self._taxels_done_ms = 0
        self._bench = bench
        self.drum = SimulatedLink(DRUM, bench.seed)
        self.taxels = SimulatedLink(TAXELS, bench.seed + 1)
        drum_clock, taxels_clock = _clocks(bench)

        def now_us() -> int:
            return self.time_us

        self.drum_board = ChipBoard(drum_chip, drum_clock, self.drum, DRUM_BAUD, now_us)
        self.taxels_board = ChipBoard(taxels_chip, taxels_clock, self.taxels, TAXELS_BAUD, now_us)
        links = {DRUM: self.drum, TAXELS: self.taxels}
        disturbances, on_change = bench.disturbances, self._apply_disturbances
        self.faults = FaultInjection(
            links, disturbances, on_change, self._reset, self._stall_computer
        )
        self.hands = SimulatedHands(bench, self.faults, lambda: self.test_points)
        self._adc_noise = NoiseRows(bench.seed, NoiseStream.ADC, CHANNELS)
        self._edges: list[tuple[Input, int, float]] = []
        self._input_levels = {Input.ESTOP: 0, Input.END_UP: 0, Input.END_DOWN: 0}
        self._start_steps = self._connect_bench()
        for board in with_bootloader:
            links[board].reset_on_open(partial(self._reset, board))

    @property
    def truth(self) -> GroundTruth:
        return self._bench.truth

    @property
    def slice_us(self) -> int:
        """Time to the next slice's end while a reply is pending, else to the next batch's end."""
        if self.drum_board.is_reply_pending(REPLY_TIMEOUT_US):
            return SLICE_US - self.time_us % SLICE_US
        return BATCH * SLICE_US - self.time_us % (BATCH * SLICE_US)

    def advance(self, until_us: int) -> None:
        """Run every whole slice up to a time, then deliver what has arrived at the host.

        A closed rig only advances its time: an event loop may still have timers.
        """
        while not self._closed and (self._done_ms + 1) * SLICE_US <= until_us:
            self._run_slice()
            if self._done_ms - self._taxels_done_ms >= BATCH:
                self._run_taxels()
        self.time_us = until_us
        for board in (self.drum_board, self.taxels_board):
            board.deliver()

    @property
    def plate(self) -> str:
        return self._bench.plate

    def set_plate(self, texture: str) -> None:
        self._bench.set_plate(texture)

    def skip_mountings(self, count: int) -> None:
        self._bench.skip_mountings(count)

    @property
    def test_points(self) -> TestPoints:
        return self._bench.test_points(self.drum_board.chip.io)

    def dip_supply(self, board: str) -> None:
        """Let a board's supply dip until its brown-out detector resets the chip."""
        self._reset(board, ResetBy.BROWN_OUT)

    def close(self) -> None:
        self._closed = True
        self.drum.close()
        self.taxels.close()
        self.drum_board.chip.close()
        self.taxels_board.chip.close()

    def _connect_bench(self) -> float:
        """Set up drum, mark and amplifier as on the bench; return the drum's position in steps."""
        p = self._bench.parameters
        io = self.drum_board.chip.io
        io.analog_rows = 2
        self._wire_drum()
        self.drum_board.chip.place_drum(round(p.start_mm / p.mm_per_step))
        return float(io.drum_place)

    def _wire_drum(self) -> None:
        circuit, io = self._bench.disturbances.circuit, self.drum_board.chip.io
        self._bench.wire_drum(io)
        period_cycles = self._bench.loadcell.period_us * self.drum_board.clock.cycles_per_us
        io.loadcell_period_q16 = round(period_cycles * 65536)
        io.loadcell_clock_open, io.loadcell_data_open = (
            not circuit.cell_clock,
            not circuit.cell_data,
        )
        io.supply_mv = circuit.logic_mv

    def _wire_taxels(self) -> None:
        circuit, io = self._bench.disturbances.circuit, self.taxels_board.chip.io
        io.supply_mv = circuit.logic_mv
        io.inputs_together = sum(1 << at for at in circuit.shorted_inputs)
        io.inputs_open = sum(1 << at for at in circuit.missing_dividers)

    def _run_slice(self) -> None:
        end_ms = self._done_ms + 1
        self._run_drum(end_ms)
        io = self.drum_board.chip.io
        if io.edge_count:
            self._collect_edges()
        travel_mm = (io.drum_place - self._start_steps) * self._bench.parameters.mm_per_step
        self._bench.advance(end_ms, io.drive, DrumTrajectory(end_ms * 1000.0, travel_mm, 0.0))
        self._done_ms = end_ms

    def _run_drum(self, end_ms: int) -> None:
        chip, bench = self.drum_board.chip, self._bench
        share, up, down = actuator_pins(
            bench.electrics, bench.plant.rod_mm, bench.parameters.actuator_travel_mm, self._done_ms
        )
        chip.analog[0, 0] = chip.analog[1, 0]
        chip.analog[1, 0] = share
        self._set_input(Input.END_UP, int(up), end_ms)
        self._set_input(Input.END_DOWN, int(down), end_ms)
        if bench.disturbances.circuit.switch_noise and end_ms % SPIKE_EVERY_MS == 0:
            self._disturb_switches(end_ms)
        if chip.io.loadcell_ready <= self.drum_board.clock.cycle(end_ms * SLICE_US):
            chip.io.loadcell_counts = bench.loadcell.weigh(self._done_ms * 1000)
        self.drum_board.run(end_ms * SLICE_US)

    def _disturb_switches(self, end_ms: int) -> None:
        """Put a spike on each switch's wire, at a time in the slice that the seed determines."""
        random = random_generator(self._bench.seed, NoiseStream.SWITCHES, end_ms)
        begin_us = max(self.time_us, self._done_ms * SLICE_US)
        starts_us = begin_us + np.sort(random.integers(1, SLICE_US // 4, len(self._input_levels)))
        for (signal, level), at_us in zip(self._input_levels.items(), starts_us, strict=True):
            for at, shown in ((at_us, 1 - level), (at_us + SPIKE_US, level)):
                cycle = self.drum_board.clock.cycle(float(at))
                self.drum_board.chip.set_input(signal, cycle, shown)

    def _set_input(self, signal: Input, level: int, end_ms: int) -> None:
        if self._input_levels[signal] != level:
            self._input_levels[signal] = level
            at_us = max(self.time_us, (end_ms - 1) * SLICE_US)
            self.drum_board.chip.set_input(signal, self.drum_board.clock.cycle(at_us), level)

    def _collect_edges(self) -> None:
        """Collect the drum's edges on the two wires to the taxel board, in simulated time."""
        chip, clock = self.drum_board.chip, self.drum_board.clock
        for i in range(chip.io.edge_count):
            wire = _WIRES.get(int(chip.edge_signal[i]))
            if wire is None:
                continue
            at_us, level = clock.us(int(chip.edge_cycle[i])), int(chip.edge_level[i])
            if wire is Input.SYNC:
                self._bench.set_sync(level, int(at_us))
                self._edges.append((wire, self._bench.sync_level, at_us))
                continue
            at_taxels = self._bench.index_at_taxels(level)
            if at_taxels is not None:
                self._edges.append((wire, at_taxels, at_us))

    def _run_taxels(self) -> None:
        """Run the taxels' chip up to the bench's present time."""
        chip, skin = self.taxels_board.chip, self._bench.skin
        for signal, level, at_us in self._edges:
            chip.set_input(signal, self.taxels_board.clock.cycle(at_us), level)
        self._edges.clear()
        skin.advance()
        first, count = self._taxels_done_ms, self._done_ms - self._taxels_done_ms
        rows = np.arange(first, first + count + 1) % RING_MS
        chip.analog[: count + 1] = skin.conductances[rows]
        noise = self._adc_noise.rows(first, count)
        np.multiply(noise, self._bench.parameters.adc_noise_counts, out=chip.noise[:count])
        chip.io.analog_rows = count + 1
        self._taxels_done_ms = self._done_ms
        self.taxels_board.run(self._done_ms * SLICE_US)

    def _apply_disturbances(self) -> None:
        disturbances, sync = self._bench.disturbances, self._bench.sync_level
        self._bench.apply_disturbances()
        self._wire_drum()
        self._wire_taxels()
        self.drum_board.chip.io.loadcell_mode = int(disturbances.loadcell)
        self._set_input(Input.ESTOP, int(disturbances.estop_level()), self._done_ms + 1)
        if self._bench.sync_level != sync:
            self._edges.append((Input.SYNC, self._bench.sync_level, self._done_ms * SLICE_US))

    def _stall_computer(self, seconds: float) -> None:
        self.advance(self.time_us + round(seconds * 1e6))

    def _reset(self, board: str, by: ResetBy = ResetBy.PIN) -> None:
        if self._taxels_done_ms < self._done_ms:
            self._run_taxels()
        chip = {DRUM: self.drum_board, TAXELS: self.taxels_board}[board].chip
        chip.reset(by)


def _clocks(bench: Bench) -> tuple[BoardClock, BoardClock]:
    """Return the clocks of drum and taxels; the boards are not switched on at the same µs."""
    on_us = int(random_generator(bench.seed, NoiseStream.POWER_UP).integers(0, SLICE_US))
    p = bench.parameters
    return BoardClock(p.drum_clock_ppm), BoardClock(p.taxel_clock_ppm, on_us)


def open_chip_simulation(
    parameters: WorldParameters,
    seed: int,
    drum_image: Path,
    taxels_image: Path,
    bootloaders: Mapping[str, Path] = {},
    sensor: TaxelArray = PAPER_ARRAY,
) -> SimulatedRig:
    """Return a bench whose boards run these images, reproducible for a seed.

    A board with one of the ``bootloaders``, Intel HEX files by board, starts in it, and opening its
    cable resets it as the line DTR of a serial port does.
    Raises RigFault if image or shim is missing, WrongUse for a parameter outside its range.
    """
    root = checkout()
    if root is None:
        raise RigFault("simulated chips need a checkout: use --rig virtual")
    library = load_library(root / "build" / "sim" / "libchips.so")
    bench = Bench(parameters, seed, has_network=True, sensor=sensor)
    drum_chip = Chip(library, drum_image, Kind.DRUM, bootloaders.get(DRUM))
    try:
        taxels_chip = Chip(library, taxels_image, Kind.TAXELS, bootloaders.get(TAXELS))
    except RigFault:
        drum_chip.close()
        raise
    return ChipSimulation(bench, drum_chip, taxels_chip, bootloaders)
