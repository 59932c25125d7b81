"""A request for the course of one taxel: sessions in, figure, table and movie out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.cache import Resources
from rigctl.analysis.encoded_sessions import ScaledBy, sa_factors, trials_to_encode
from rigctl.analysis.files import atomic_file
from rigctl.analysis.movies import check_movie_file
from rigctl.analysis.report.example_taxel import check_selection
from rigctl.analysis.spike_counts import (
    PreparedTrials,
    RangesOver,
    count_conditions,
    group_by_condition,
    join_searched_c,
    prepare_trials,
)
from rigctl.analysis.taxel import (
    SHOWN_S,
    Section,
    TaxelCourse,
    check_figure_file,
    load_course,
    write_course,
    write_taxel_figure,
    write_taxel_movie,
)
from rigctl.analysis.trial_set import join_sessions
from rigctl.encoding.force_matrix import REFERENCE_FORCE_G
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, EncoderParameters
from rigctl.errors import WrongUse


@dataclass(frozen=True, slots=True)
class TaxelRequest:
    """Which taxel of which trial, how it is encoded, and the files to write.

    ``start_s``, ``seconds``: the section of figure and movie; the table has the whole trial.
    """

    sessions: tuple[Path, ...]
    parameters: EncoderParameters = DEFAULT
    reference_g: float = REFERENCE_FORCE_G
    ranges: RangesOver | Normalisation = RangesOver.ALL
    scaled_by: ScaledBy = ScaledBy.NONE
    trial: int | None = None
    taxel: int | None = None
    start_s: float = 0.0
    seconds: float = SHOWN_S
    figure: Path | None = None
    csv: Path | None = None
    movie: Path | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """The files to write."""
        return tuple(filter(None, (self.figure, self.csv, self.movie)))

    def check_files(self) -> None:
        """Raise WrongUse for a file that exists, or whose name has another end."""
        if self.figure is not None:
            check_figure_file(self.figure)
        if self.csv is not None and self.csv.exists():
            raise WrongUse(f"{self.csv} already exists: name another file, or remove it")
        if self.movie is not None:
            check_movie_file(self.movie)


def encode_taxel(request: TaxelRequest, resources: Resources) -> tuple[str, ...]:
    """Write the files of a request; return remarks on the trials.

    Raises WrongUse for a trial, taxel or section that is not there and for files that exist,
    SessionError for what cannot be encoded, DiskFault where a file cannot be written.
    """
    request.check_files()
    trials = join_sessions(request.sessions, resources.progress, request.parameters.reading)
    check_selection(trials, request.trial, request.taxel)
    trials = trials_to_encode(trials, request.reference_g, request.scaled_by)
    prepared = prepare_trials(trials, resources, request.ranges)
    c = _searched_factors(request, prepared, resources)
    chosen = request.parameters, request.trial, request.taxel
    course = load_course(prepared.trials, prepared.normalisation, *chosen, c)
    section = _section_of(request, course)
    if request.figure is not None:
        write_taxel_figure(course, section, request.figure)
    if request.csv is not None:
        with atomic_file(request.csv) as partial:
            write_course(course, partial)
    if request.movie is not None:
        write_taxel_movie(course, section, request.movie, resources.progress)
    return prepared.trials.remarks


def _section_of(request: TaxelRequest, course: TaxelCourse) -> Section:
    if request.start_s >= course.duration_s:
        raise WrongUse(
            f"--start {request.start_s:g} is behind the end of the trial, which has "
            f"{course.duration_s:g} s: choose an earlier one"
        )
    return Section(request.start_s, min(request.start_s + request.seconds, course.duration_s))


def _searched_factors(
    request: TaxelRequest, prepared: PreparedTrials, resources: Resources
) -> NDArray[np.float64] | None:
    """Return the factors on the SA current; C is searched only where the request asks for it."""
    if request.scaled_by is ScaledBy.NONE:
        return None
    conditions = group_by_condition(
        prepared, request.parameters, request.reference_g, search_c=True
    )
    counted = list(count_conditions(prepared, conditions, resources))
    return sa_factors(prepared, join_searched_c(conditions, counted), request.scaled_by)
