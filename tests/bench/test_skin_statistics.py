"""Figures of readings that are known, C on slides, and the page's tables."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.analysis.trial_set import Design
from rigctl.bench.parameters import parameter_infos
from rigctl.encoder.force_search import mean_sa_rates_hz
from rigctl.encoder.normalisation import Normalisation
from tools.skin_figures import skin_figures
from tools.skin_statistics import MECHANISMS, PAGE, kept_rows, searched_c
from tools.slides import SlideSession

TEXTURES, SPEEDS_MM_S, PRESSES, REPEATS = 3, (40.0, 80.0), (250.0, 500.0), 2


def design() -> Design:
    cells = [
        (texture, speed, press)
        for texture in range(TEXTURES)
        for speed in SPEEDS_MM_S
        for press in PRESSES
        for _ in range(REPEATS)
    ]
    texture, speed, press = np.array(cells).T
    return Design(("A", "B", "C"), texture.astype(np.int64), speed, press)


def trials(of: Design) -> list[NDArray[np.uint16]]:
    """Return a square wave of ± 50 counts; each texture has its own level, each press a factor."""
    wave = np.where(np.arange(2000) // 50 % 2, 50, -50)[:, None]
    levels = [200 + 100 * t for t in of.texture]
    factors = of.force_g / 250.0
    return [
        np.repeat((level + wave) * factor, 18, axis=1).astype(np.uint16)
        for level, factor in zip(levels, factors, strict=True)
    ]


def test_textures_differ_by_their_means_and_the_rest_by_nothing() -> None:
    of = design()
    figures = skin_figures(trials(of), of)
    span = 2 * 450 - 150
    least, most = figures.levels
    assert (least.press, most.press) == PRESSES
    assert least.textures == pytest.approx(100 / span)
    assert most.textures == pytest.approx(200 / span)
    assert (least.speeds, least.repeats) == (0.0, 0.0)
    assert least.within == pytest.approx(50 / span)
    assert figures.mean_growth == pytest.approx(2.0)
    assert figures.amplitude_growth == pytest.approx(2.0)


def test_a_set_without_repeats_has_no_figure_between_them() -> None:
    of = design()
    rows = slice(None, None, REPEATS)
    single = Design(of.textures, of.texture[rows], of.speed_mm_s[rows], of.force_g[rows])
    figures = skin_figures(trials(single), single)
    assert np.isnan(figures.levels[0].repeats) and figures.cells[2] == "–"


def test_c_brings_the_rates_of_a_press_to_those_of_the_reference() -> None:
    of = design()
    samples = trials(of)
    c = searched_c(SlideSession(samples, of, 0.0), 500.0)
    assert (c[of.force_g == 500.0] == 1.0).all() and (c[of.force_g == 250.0] > 1.0).all()
    ranges = Normalisation.from_samples(samples, "all trials")
    (light, heavy) = (
        np.flatnonzero((of.texture == 1) & (of.speed_mm_s == 40.0) & (of.force_g == press))
        for press in PRESSES
    )
    reached = mean_sa_rates_hz([samples[row] for row in light], ranges, c=c[light[0]])
    aimed = mean_sa_rates_hz([samples[row] for row in heavy], ranges)
    assert np.abs(reached - aimed).max() < 0.5


def test_the_page_has_every_mechanism_and_keeps_the_fabrics() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert all(f"| {mechanism.name} |" in page for mechanism in MECHANISMS)
    rows = [kept_rows(page, table).splitlines() for table in ("statistics", "accuracies")]
    assert [len(lines) for lines in rows] == [2, 1]
    known = {row.name for row in parameter_infos()}
    assert all(known.issuperset(mechanism.parameters) for mechanism in MECHANISMS)
