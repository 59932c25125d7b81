"""What the worker process does for a replay. This module does not import Qt."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gui.analysis.task_values import TrialCourse, TrialData
from gui.live.drum_course import DrumCourse
from gui.live.timeline import Timeline
from gui.widgets.file_browser import typed_path
from rigctl.errors import WrongUse
from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    from rigctl.analysis.executors import Progress
    from rigctl.encoder.normalisation import Normalisation
    from rigctl.session.session import Session


class ReplayTrial(NamedTuple):
    """A trial as the live views keep it: sample 0 is at position 0.

    ``low``, ``high``: uint16 (n_taxels,), each taxel's lowest and highest reading.
    """

    title: str
    simulated: bool
    layout: SensorLayout
    timeline: Timeline
    drum: DrumCourse
    low: NDArray[np.uint16]
    high: NDArray[np.uint16]


def replay_trial(data: TrialData) -> ReplayTrial:
    """Return a trial for the live views, with what draws any part of it quickly."""
    n, n_taxels = data.samples.shape
    counters = np.arange(n, dtype=np.int64)
    timeline = Timeline(n_taxels, 2 * n_taxels, max(n, 1))
    flags = np.zeros(n, np.uint8)
    spikes = data.spike_counts
    timeline.append(counters / SAMPLE_RATE_HZ, counters, data.samples, flags, spikes)
    low, high = data.samples.min(axis=0), data.samples.max(axis=0)
    drum = _drum_course(data.course)
    return ReplayTrial(data.title, data.simulated, data.layout, timeline, drum, low, high)


def _drum_course(course: TrialCourse | None) -> DrumCourse:
    drum = DrumCourse()
    if course is None or not np.isfinite(course.speed_s).any():
        return drum
    known = np.isfinite(course.force_s)
    at_s = course.force_s[known]
    columns = {
        "force_g": course.force_g[known],
        "force_set_g": np.full(len(at_s), course.planned_g),
        "speed_mm_s": np.interp(at_s, course.speed_s, course.speed_mm_s),
        "speed_set_mm_s": np.full(len(at_s), course.planned_mm_s),
    }
    drum.append(at_s * SAMPLE_RATE_HZ, columns)
    return drum


def neuron_voltage(
    session: Session, row: int, taxel: int, ranges: Normalisation
) -> NDArray[np.float64]:
    """Return the membrane voltage of SA and RA of a taxel, from 0, float64 (n, 2) in mV."""
    from rigctl.encoder.encoder import membrane_mv
    from rigctl.encoder.normalisation import Normalisation

    samples = np.ascontiguousarray(session.samples(row)[:, [taxel]])
    own = Normalisation(ranges.low[[taxel]], ranges.high[[taxel]], ranges.source)
    return membrane_mv(samples, own)


def write_movie(
    session: Session, row: int, taxel: int, section_s: tuple[float, float], out: str, show: Progress
) -> str:
    """Write the movie of a taxel, from 0, as ``rigctl encode --movie`` does; return its path.

    ``section_s``: where the shown part of the trial begins, and its length. Raises WrongUse for an
    attempt that does not count.
    """
    from rigctl.analysis.cache import Resources
    from rigctl.analysis.taxel import EncodeRequest, encode_taxel

    if row not in session.committed():
        raise WrongUse("this attempt does not count: choose a committed one for a movie")
    request = EncodeRequest(
        (session.path,),
        trial=int(session.trials[row]["trial_id"]),
        taxel=taxel + 1,
        start_s=section_s[0],
        seconds=section_s[1],
        movie=typed_path(out),
    )
    encode_taxel(request, Resources(progress=show))
    return out
