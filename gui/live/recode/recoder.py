"""An encoder beside the engine's, for the views only. This module does not import Qt."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.wire.taxels.frames import Flag


class Recoder:
    """Encodes samples as they arrive; starts from rest after a gap and where sync rises.

    ``sa_scale``: float64 (n_taxels,), C, or None for 1; ``inputs``: the input of each taxel, for
    conductances.
    """

    def __init__(
        self,
        ranges: Normalisation,
        parameters: EncoderParameters,
        sa_scale: NDArray[np.float64] | None,
        inputs: tuple[int, ...] = (),
    ) -> None:
        # The compiler of the encoder takes long to load: not before somebody encodes anew.
        from rigctl.encoding.encoder import Encoder

        self._encoder = Encoder(ranges, parameters, sa_scale, inputs)
        self._encoder.warm_up()
        self._next = -1
        self._has_sync = True

    def set_ranges(self, ranges: Normalisation) -> None:
        """Use other ranges from the next sample on."""
        if not ranges.has_ranges_of(self._encoder.normalisation):
            self._encoder.normalisation = ranges

    def __call__(
        self,
        positions: NDArray[np.int64],
        samples: NDArray[np.uint16],
        flags: NDArray[np.uint8],
    ) -> NDArray[np.uint8]:
        """Return the spikes of n samples, uint8 (n, 2·n_taxels): SA, then RA."""
        sync = (flags & Flag.SYNC) > 0
        rises = sync & ~np.concatenate([[self._has_sync], sync[:-1]])
        apart = np.diff(positions, prepend=self._next - 1) != 1
        bounds = [*np.flatnonzero(rises | apart).tolist(), len(positions)]
        self._next, self._has_sync = int(positions[-1]) + 1, bool(sync[-1])
        parts = [self._encode(samples[: bounds[0]])]
        for first, end in pairwise(bounds):
            self._encoder.reset()
            parts.append(self._encode(samples[first:end]))
        return np.concatenate(parts)

    def _encode(self, samples: NDArray[np.uint16]) -> NDArray[np.uint8]:
        if not len(samples):
            return np.zeros((0, 2 * samples.shape[1]), np.uint8)
        return self._encoder.encode(np.ascontiguousarray(samples))
