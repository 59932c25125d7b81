"""The figures of one taxel: as in the paper's Figure 2C, or with every signal of Figure 2D."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.analysis.data.atomic_file import atomic_file
from rigctl.analysis.report.figures import DPI, MUTED, caption, new_figure, save_figure
from rigctl.analysis.taxel.taxel_course import TaxelCourse
from rigctl.analysis.taxel.taxel_panels import (
    HEIGHTS_OF_2C,
    HEIGHTS_OF_2D,
    Section,
    TaxelPanels,
)
from rigctl.errors import WrongUse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN_S = 1.0
"""Length of the paper's Figure 2C."""
FORMATS = (".svg", ".png", ".pdf")


def draw_taxel(course: TaxelCourse, stem: Path) -> Path:
    """Draw reading, voltages and spikes of the first second to ``stem``.svg and .png."""
    section = Section(0.0, min(SHOWN_S, course.duration_s))
    figure = _figure(course, section, (9.5, 5.6), HEIGHTS_OF_2C)
    title = f"{course.title}, up to its first second (as Fig. 2C)"
    return save_figure(figure, stem, title, course.origin)


def draw_every_signal(course: TaxelCourse, section: Section, stem: Path) -> Path:
    """Draw every signal of a section to ``stem``.svg and .png; return the PNG."""
    figure = _every_signal(course, section)
    return save_figure(figure, stem, _title_of(course), course.origin)


def write_taxel_figure(course: TaxelCourse, section: Section, out: Path) -> None:
    """Write the figure of every signal of a section, as the end of the name says.

    Raises WrongUse as :func:`check_figure_file` does, DiskFault where it cannot be written.
    """
    import matplotlib as mpl

    check_figure_file(out)
    figure = _every_signal(course, section)
    caption(figure, _title_of(course), course.origin)
    date = "CreationDate" if out.suffix == ".pdf" else "Date"
    metadata = {"Software": None} if out.suffix == ".png" else {date: None}
    with (
        atomic_file(out) as partial,
        mpl.rc_context({"svg.hashsalt": "rigctl", "svg.fonttype": "none"}),
    ):
        figure.savefig(partial, format=out.suffix[1:], dpi=DPI, metadata=metadata)


def check_figure_file(out: Path) -> None:
    """Raise WrongUse for a name that is no figure's, or whose file exists."""
    if out.suffix not in FORMATS:
        raise WrongUse(f"{out} is none of {', '.join(FORMATS)}: give the file one of these ends")
    if out.exists():
        raise WrongUse(f"{out} already exists: name another file, or remove it")


def _title_of(course: TaxelCourse) -> str:
    return f"{course.title}: from the reading to spikes (Fig. 2D)"


def _every_signal(course: TaxelCourse, section: Section) -> Figure:
    figure = _figure(course, section, (9.5, 9.0), HEIGHTS_OF_2D)
    figure.axes[0].set_title(course.words, size=8.5, loc="left", color=MUTED)
    return figure


def _figure(
    course: TaxelCourse, section: Section, size_in: tuple[float, float], heights: tuple[float, ...]
) -> Figure:
    figure, rows = new_figure(size_in, len(heights), 1, sharex=True, height_ratios=heights)
    TaxelPanels(list(rows), course, section)
    figure.align_ylabels(rows)
    return figure
