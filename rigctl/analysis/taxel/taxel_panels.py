"""The panels of one taxel: what they show of its signals, whole or up to a moment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.report.figures import FAINT, MUTED, RA_COLOUR, TEXT
from rigctl.analysis.taxel.taxel_course import CHANNELS, TaxelCourse
from rigctl.values import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

Floats = NDArray[np.float64]

SA_COLOUR = "#1f4fd1"
COLOURS = (SA_COLOUR, RA_COLOUR)
HEIGHTS_OF_2C = (2.2, 1.6, 0.5, 1.6, 0.5)
HEIGHTS_OF_2D = (1.7, 1.2, 1.2, 1.3, 0.5, 1.2, 1.3, 0.5)
"""Relative heights of the panels of Figure 2C, and of all signals of Figure 2D."""


class Section(NamedTuple):
    """The part of a trial that is shown, in seconds since the trial window opened."""

    start_s: float
    end_s: float


class _Trace(NamedTuple):
    line: Line2D
    at_s: Floats
    values: Floats


class TaxelPanels:
    """Axes, one above the other, with the signals of a section; :meth:`show_until` cuts them.

    ``axes``: as many as ``HEIGHTS_OF_2C`` or, with every signal, ``HEIGHTS_OF_2D``.
    """

    def __init__(self, axes: list[Axes], course: TaxelCourse, section: Section) -> None:
        self._course, self._section = course, section
        self._traces: list[_Trace] = []
        every_signal = len(axes) == len(HEIGHTS_OF_2D)
        rows = iter(axes)
        self._add_readings(next(rows), every_signal)
        if every_signal:
            label = f"derivative\n({course.derivative_unit})"
            self._add_signal(next(rows), label, course.derivative, RA_COLOUR)
        for channel in range(len(CHANNELS)):
            self._add_neuron(rows, channel, every_signal)
        for panel in axes[:-1]:
            panel.tick_params(labelbottom=False)
        axes[-1].set_xlim(*section)
        axes[-1].set_xlabel("time since the trial window opened (s)")

    def show_until(self, at_s: float) -> None:
        """Show what there was up to a moment, in seconds since the trial window opened."""
        for trace in self._traces:
            n = int(np.searchsorted(trace.at_s, at_s, side="right"))
            trace.line.set_data(trace.at_s[:n], trace.values[:n])

    def _add_readings(self, axes: Axes, every_signal: bool) -> None:
        course = self._course
        if not every_signal:
            self._add_signal(axes, "reading\n(0–1)", course.reading, TEXT)
            return
        self._add_signal(axes, "reading\n(0–1)", course.reading, MUTED, "reading I(t)")
        self._trace(axes, course.low_passed, RA_COLOUR, 1.2, "low-passed, for RA")
        axes.legend(loc="upper right", ncols=2, fontsize=8, framealpha=0.85, edgecolor=FAINT)
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.35 * (high - low))

    def _add_neuron(self, rows: Any, channel: int, every_signal: bool) -> None:
        course, name, colour = self._course, CHANNELS[channel], COLOURS[channel]
        if every_signal:
            label = f"{name} current\n(mV/ms)"
            self._add_signal(next(rows), label, course.current[:, channel], colour)
        voltage = course.membrane_mv[:, channel]
        self._add_signal(next(rows), f"{name} v(t)\n(mV)", voltage, colour, width=0.7)
        self._add_spikes(next(rows), channel)

    def _add_signal(
        self,
        axes: Axes,
        label: str,
        values: Floats,
        colour: str,
        name: str | None = None,
        width: float = 1.0,
    ) -> None:
        self._trace(axes, values, colour, width, name)
        axes.set_ylabel(label)
        axes.set_xlim(*self._section)
        axes.set_ylim(*_limits(values[self._shown(len(values))]))

    def _trace(
        self, axes: Axes, values: Floats, colour: str, width: float, name: str | None
    ) -> None:
        shown = self._shown(len(values))
        at_s = np.arange(len(values))[shown] / SAMPLE_RATE_HZ
        (line,) = axes.plot(at_s, values[shown], color=colour, lw=width, label=name)
        self._traces.append(_Trace(line, at_s, values[shown]))

    def _add_spikes(self, axes: Axes, channel: int) -> None:
        """Draw the spikes as one broken line: a tick from 0 to 1 at each."""
        at_s = self._course.spikes[channel] / SAMPLE_RATE_HZ
        at_s = at_s[(at_s >= self._section.start_s) & (at_s < self._section.end_s)]
        x, y = np.repeat(at_s, 3), np.tile([0.0, 1.0, np.nan], len(at_s))
        (line,) = axes.plot(x, y, color=COLOURS[channel], lw=0.9, solid_capstyle="butt")
        self._traces.append(_Trace(line, x, y))
        axes.set(ylim=(-0.1, 1.1), yticks=[], xlim=tuple(self._section))
        axes.set_ylabel("spikes", rotation=0, ha="right", va="center", size=8, color=MUTED)
        if not len(at_s):
            style: Any = {"ha": "center", "va": "center", "size": 8, "color": MUTED}
            axes.text(0.5, 0.5, f"no {CHANNELS[channel]} spike", transform=axes.transAxes, **style)

    def _shown(self, n: int) -> slice:
        first = round(self._section.start_s * SAMPLE_RATE_HZ)
        return slice(min(first, n), min(round(self._section.end_s * SAMPLE_RATE_HZ), n))


def _limits(values: Floats) -> tuple[float, float]:
    """Return the limits of an axis around values, also where all are equal."""
    low, high = float(values.min()), float(values.max())
    margin = 0.06 * (high - low) or 0.5
    return low - margin, high + margin
