"""Read a session of the drum: cut its trials, also while a writer appends to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rigctl.config.rig_config import RigConfig, parse_config
from rigctl.encoding.reading import Reading, conductance, input_of_each
from rigctl.errors import SessionError
from rigctl.session.format import file_names, layout
from rigctl.session.format.data_sets import SessionLayout
from rigctl.session.format.metadata.header import ADC_COUNTS, IMPORTED
from rigctl.session.format.metadata.wiring import session_wiring
from rigctl.session.format.table_rows import parse_trial
from rigctl.session.read.part import PartReader, StructuredArray
from rigctl.session.read.sample_index import SampleFile, SampleRange, locate_samples, locate_windows
from rigctl.session.read.session_reader import SessionReader
from rigctl.values import Gap, TrialRow

SCALING_KIND = "scaling"
"""Kind of an import's events with the scale of the stored counts, one for each taxel."""


@dataclass(frozen=True, slots=True)
class TrialSamples:
    """Received samples of one trial's window.

    ``samples``: uint16 (n, n_taxels); ``counters``: int64 (n,); ``flags``, ``edges``:
    uint8 (n,). n is ``count`` less the lost samples, which ``gaps`` lists by the board's counter.
    """

    first_counter: int
    count: int
    samples: NDArray[np.uint16]
    counters: NDArray[np.int64]
    flags: NDArray[np.uint8]
    edges: NDArray[np.uint8]

    @property
    def complete(self) -> bool:
        """Whether no sample of the window is missing."""
        return len(self.counters) == self.count

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Runs of missing samples in the window."""
        end = self.first_counter + self.count
        bounds = np.concatenate([[self.first_counter - 1], self.counters, [end]])
        before = np.flatnonzero(np.diff(bounds) > 1)
        return tuple(
            Gap(int(bounds[i]) + 1, int(bounds[i + 1] - bounds[i]) - 1, "missing") for i in before
        )


@dataclass(frozen=True, slots=True)
class TrialDrum:
    """Drum polls and load-cell samples of one attempt, with its approach and retraction.

    ``polls``: rows of /drum; ``loadcell``: rows of /loadcell. ``polls_s`` and ``loadcell_s``
    (float64) are seconds since the rise of sync by the drum's clock, NaN without a window.
    """

    polls: StructuredArray
    loadcell: StructuredArray
    polls_s: NDArray[np.float64]
    loadcell_s: NDArray[np.float64]


class Session(SessionReader):
    """Reader of a session of the drum."""

    layout: ClassVar[SessionLayout] = layout.DRUM_LAYOUT

    @property
    def config(self) -> RigConfig:
        """Parsed description of the rig. Raises ConfigError."""
        return parse_config(self.rig_text, str(self.path / file_names.RIG_FILE))

    @property
    def wiring(self) -> tuple[int, ...]:
        """Reading of the taxel wire in each column of the samples; empty if unknown."""
        return session_wiring(self.header, self.parts[0].text("/rig_toml"))

    @property
    def inputs(self) -> tuple[int, ...]:
        """Analog input of each column of the samples, for conductances. Raises WrongUse."""
        is_counted = self.header.sample_unit == ADC_COUNTS and self.header.rig != IMPORTED
        wiring = self.header.wiring or self.wiring
        return input_of_each(wiring if is_counted else (), str(self.path))

    def readings(self, index: int) -> NDArray[np.uint16]:
        """Return a trial's samples as the live encoder took them, uint16 (n, n_taxels)."""
        samples = np.ascontiguousarray(self.samples(index))
        if self.header.encoder_reading == Reading.COUNTS:
            return samples
        return conductance(samples, self.inputs)

    @property
    def scaling(self) -> tuple[tuple[float, float], ...]:
        """Offset and scale of each taxel's stored counts; empty if the counts are the readings."""
        data = [event.data for event in self.events_of(SCALING_KIND)]
        values = [each.get(name) for each in data for name in ("offset", "scale")]
        if not all(isinstance(value, float | int) for value in values):
            raise SessionError(f"{self.path} is damaged: a scaling in /events has no numbers")
        pairs = tuple((float(each["offset"]), float(each["scale"])) for each in data)
        return () if all(pair == (0.0, 1.0) for pair in pairs) else pairs

    def loadcell_lost(self) -> int:
        """Return the number of load-cell samples that the host never received."""
        return sum(int(part.rows(layout.DRUM)["loadcell_lost"].sum()) for part in self.parts)

    def trial_row(self, index: int) -> TrialRow:
        """Return one attempt."""
        return parse_trial(self.trials[index])

    def sample_files(self) -> tuple[SampleFile, ...]:
        """Return the chunk index of the samples of each of ``parts``."""
        return tuple(map(locate_samples, self.parts))

    def sample_ranges(self, indices: Sequence[int], first_file: int = 0) -> list[SampleRange]:
        """Return the rows of trials' windows; ``first_file`` is the first part's ``file``.

        Raises SessionError for a part that is missing or that HDF5 cannot read.
        """
        rows = self.trials[list(indices)]
        ranges: dict[int, SampleRange] = {}
        for number, part in enumerate(self.parts):
            chosen = np.flatnonzero(rows["part"] == part.number)
            windows = locate_windows(part, rows[chosen], first_file + number)
            ranges.update(zip(chosen.tolist(), windows, strict=True))
        if len(ranges) < len(rows):
            lost = rows[min(set(range(len(rows))) - set(ranges))]
            raise SessionError(
                f"{self.path}: trial {lost['trial_id']} should be in part {lost['part']}, "
                "which is missing"
            )
        return [ranges[i] for i in range(len(rows))]

    def window(self, index: int) -> TrialSamples:
        """Return one trial's window with counters, flags and gaps."""
        part, start, stop = self._rows_of(index)
        row = self.trials[index]
        return TrialSamples(
            int(row["first_counter"]),
            int(row["count"]),
            *(part.read(array.path, start, stop) for array in layout.TAXEL_ARRAYS),
        )

    def drum(self, index: int) -> TrialDrum:
        """Return the polls and load-cell samples between an attempt's start and end."""
        row = self.trials[index]
        part = self._part(int(row["part"]))
        polls = part.rows_between(layout.DRUM, "at_s", row["started_s"], row["ended_s"])
        loadcell = _loadcell_of(part, polls)
        rise_us = float(polls["sync_rise_us"][-1]) if len(polls) else np.nan
        if row["first_counter"] < 0:
            rise_us = np.nan
        return TrialDrum(
            polls,
            loadcell,
            (polls["board_time_us"] - rise_us) * 1e-6,
            (loadcell["board_time_us"] - rise_us) * 1e-6,
        )


def _loadcell_of(part: PartReader, polls: StructuredArray) -> StructuredArray:
    """Return the load-cell samples between the first and the last poll."""
    if not len(polls):
        return part.rows(layout.LOADCELL, 0, 0)
    board_us = polls["board_time_us"]
    return part.rows_between(layout.LOADCELL, "board_time_us", board_us[0], board_us[-1])
