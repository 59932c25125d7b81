"""The taxel board's image on its chip, with access to pins and edges by cycle."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.chips.simavr import Chip, Input, Kind, Output, load_library
from rigctl.boards.taxel_decoder import FrameDecoder
from rigctl.boards.taxel_frames import SelfTest, TaxelIdentity, TaxelStatus
from rigctl.values import Block
from tests.firmware.building import built

FRAME_CYCLES = 16_000
SLOT_CYCLES = 800
BYTE_CYCLES = 320
ENTRY_CYCLES = 4
"""Interrupt entry of the 328P, which the simulator does not count."""


def counts_of(conductances: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the readings of taxels (18,) with these conductances, in units of the divider's."""
    columns = conductances.reshape(3, 6)
    shares = columns / (1 + columns.sum(axis=0))
    return (shares.ravel() * 1023 + 0.5).astype(np.int64)


class TaxelChip:
    """An image on a chip; leaving the context frees it."""

    def __init__(self, image: str = "firmware/taxels.elf", bootloader: Path | None = None) -> None:
        library = load_library(built("sim/libchips.so"))
        self.chip = Chip(library, built(image), Kind.TAXELS, bootloader)
        self.x = self.chip.io
        self.x.report_samples = 1
        self.x.host_byte_q16 = BYTE_CYCLES << 16
        self.x.analog_rows = 1
        self.blocks: list[Block] = []
        self.statuses: list[TaxelStatus] = []
        self.identities: list[TaxelIdentity] = []
        self.tests: list[SelfTest] = []
        self.rejected = 0
        self._decoder = FrameDecoder(18)
        self._samples: list[NDArray[np.int64]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.chip.close()

    def run(self, milliseconds: int) -> None:
        """Run in steps of a millisecond."""
        for _ in range(milliseconds):
            self.run_slice(1)

    def run_slice(self, milliseconds: int) -> None:
        """Run in one step."""
        self.chip.run((self.x.cycle // FRAME_CYCLES + milliseconds) * FRAME_CYCLES)
        self._collect()

    def edge(self, signal: Input, level: int, cycle: int) -> None:
        """Change a pin at a future cycle."""
        self.chip.set_input(signal, cycle, level)

    def _collect(self) -> None:
        x, chip = self.x, self.chip
        decoded = self._decoder.feed(chip.tx[: x.tx_count].tobytes(), x.cycle / 16e6)
        self.blocks += decoded.blocks
        self.statuses += decoded.statuses
        self.identities += decoded.identities
        self.tests += decoded.self_tests
        self.rejected += decoded.rejected_frames
        sampled = chip.edge_signal[: x.edge_count] == Output.SAMPLE
        stamps = chip.edge_cycle[: x.edge_count][sampled].astype(np.int64)
        levels = chip.edge_level[: x.edge_count][sampled].astype(np.int64)
        self._samples.append(np.stack([stamps, levels], axis=1))

    def sampled(self, taxel: int) -> NDArray[np.int64]:
        """Return the cycles at which a taxel was sampled, without the ADC's first conversion."""
        rows = np.concatenate(self._samples)
        cycles: NDArray[np.int64] = rows[rows[:, 1] == taxel, 0]
        return cycles[1:] if taxel == 0 else cycles

    @property
    def counters(self) -> NDArray[np.int64]:
        """Counters of all received frames, int64 (n,)."""
        return np.concatenate([np.empty(0, np.int64), *[b.counters for b in self.blocks]])

    @property
    def samples(self) -> NDArray[np.uint16]:
        """Readings of all received frames, uint16 (n, 18)."""
        return np.concatenate([np.empty((0, 18), np.uint16), *[b.samples for b in self.blocks]])

    @property
    def flags(self) -> NDArray[np.uint8]:
        """Flags of all received frames, uint8 (n,)."""
        return np.concatenate([np.empty(0, np.uint8), *[b.flags for b in self.blocks]])

    @property
    def edges(self) -> NDArray[np.uint8]:
        """Edge counts of all received frames, uint8 (n,)."""
        return np.concatenate([np.empty(0, np.uint8), *[b.edges for b in self.blocks]])
