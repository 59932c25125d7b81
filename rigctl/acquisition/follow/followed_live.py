"""Live data of a followed session: its new rows, encoded as the engine's, for the same views."""

from __future__ import annotations

import numpy as np

from rigctl.acquisition.follow.growing_session import at_loadcell, loadcell_times
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.taxels.pipeline import SamplePipeline
from rigctl.encoding.encoder import Encoder
from rigctl.encoding.normalisation import RunningRange
from rigctl.encoding.reading import Reading
from rigctl.session.part import StructuredArray
from rigctl.session.session import Session
from rigctl.values import Block


class FollowedLive:
    """Writes blocks and polls of a session as live data."""

    def __init__(self, writer: LiveWriter, session: Session) -> None:
        self._writer = writer
        header = session.header
        parameters, calibrated = header.encoder_parameters, header.calibrated_ranges
        least_width = parameters.reading.least_range
        self._range = RunningRange(header.n_taxels, least_width, parameters.reading)
        self._follows_range = calibrated is None
        first = calibrated or self._range.normalisation
        takes_counts = parameters.reading is Reading.COUNTS
        inputs = () if takes_counts else session.inputs
        self._encoder = Encoder(first, parameters, inputs=inputs)
        self._pipeline = SamplePipeline(
            self._encoder, writer, waits_for_disk=False, batch_samples=1
        )
        writer.set_range(first.low, first.high)
        self._polls: StructuredArray | None = None

    def add_block(self, block: Block) -> None:
        """Encode and store samples."""
        if self._follows_range and self._range.update(self._encoder.readings(block.samples)):
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
