"""Live data of a followed session: its new rows, encoded as the engine's, for the same views."""

from __future__ import annotations

import numpy as np

from rigctl.acquisition.follow.growing_session import at_loadcell, loadcell_times
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.taxels.pipeline import SamplePipeline
from rigctl.encoding.encoder import Encoder
from rigctl.encoding.normalisation import Normalisation, RunningRange
from rigctl.encoding.parameters import DEFAULT, preset
from rigctl.session.format.metadata.header import SessionHeader
from rigctl.session.read.part import StructuredArray
from rigctl.values import Block

MIN_RANGE_COUNTS = 128


class FollowedLive:
    """Writes blocks and polls of a session as live data."""

    def __init__(self, writer: LiveWriter, header: SessionHeader) -> None:
        self._writer = writer
        self._range = RunningRange(header.n_taxels, MIN_RANGE_COUNTS)
        self._follows_range = not header.taxel_low
        low, high = (np.array(s, np.uint16) for s in (header.taxel_low, header.taxel_high))
        full = Normalisation.full_scale(header.n_taxels)
        first = full if self._follows_range else Normalisation(low, high)
        self._encoder = Encoder(
            first, preset(header.encoder_preset) if header.encoder_preset else DEFAULT
        )
        self._pipeline = SamplePipeline(
            self._encoder, writer, waits_for_disk=False, batch_samples=1
        )
        writer.set_range(first.low, first.high)
        self._polls: StructuredArray | None = None

    def add_block(self, block: Block) -> None:
        """Encode and store samples."""
        if self._follows_range and self._range.update(block.samples):
            self._encoder.normalisation = widened = self._range.normalisation
            self._writer.set_range(widened.low, widened.high)
        self._pipeline.add_block(block)

    def add_drum(self, polls: StructuredArray, loadcell: StructuredArray) -> None:
        """Store load-cell samples with the drum's values at the poll that brought each."""
        if len(polls):
            self._polls = polls
        if self._polls is None or not len(loadcell):
            return
        known = self._polls
        self._writer.add_drum(
            loadcell_times(loadcell, known),
            force_g=loadcell["force_g"].astype(np.float64),
            **{
                name: at_loadcell(name, loadcell, known)
                for name in ("force_set_g", "speed_mm_s", "speed_set_mm_s", "state")
            },
        )
