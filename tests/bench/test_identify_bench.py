"""Identification of the bench's unknown parameters by the Original column and by real skins."""

from __future__ import annotations

import re
import runpy
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from rigctl.analysis import published
from rigctl.bench import parameter_tables
from rigctl.bench.direct_rig import DirectRig
from rigctl.bench.parameters import IDENTIFIED, WorldParameters, parameter_infos
from rigctl.bench.world_file import NOMINAL_WORLD, SimulatedWorld, load_world
from rigctl.config.resources import protocols
from rigctl.config.rig_config import RigConfig
from rigctl.protocol.plan import Settle
from rigctl.synth.step_runner import DrumOperator
from rigctl.values import PlannedTrial
from tools import identify_bench
from tools.identify_bench import JUDGES, main
from tools.skin_figures import RANGES, SkinMeasures, measure_skin, skin_figures
from tools.slides import (
    DEPTHS_MM,
    LIFTED_MS,
    RESTING_MS,
    RUN_IN_MM,
    TRAVEL_MM,
    Slider,
    simulate_slides,
)

MOST_EXCESS = 0.1
"""A session's mountings move the figures: a tenth of a bound beyond their ranges, in sum."""


@pytest.fixture(scope="module")
def start() -> Iterator[identify_bench.Candidate]:
    """Use one session of two repeats per candidate, and two depths; return the first one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(identify_bench, "SHOWN_REPEATS", 2)
        patch.setattr(identify_bench, "DEPTHS_MM", DEPTHS_MM[:: len(DEPTHS_MM) - 1])
        yield identify_bench.evaluate(WorldParameters(), 2, [1])


def test_the_scaled_columns_are_never_read(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = {key: {"original": cells["original"]} for key, cells in published.TABLE_1.items()}
    before = dict(identify_bench.PAPER)
    with monkeypatch.context() as patch:
        patch.setattr(published, "TABLE_1", alone)
        assert before == runpy.run_path(identify_bench.__file__)["PAPER"]
    assert list(before.values()) == [91.78, 81.83, 37.44, 57.35, 36.81, 99.93]


def test_the_identified_parameters_are_searched_and_no_other() -> None:
    names = [row.name for row in identify_bench.identified_parameters(WorldParameters())]
    assert names == [row.name for row in parameter_infos() if row.source == IDENTIFIED]


@pytest.mark.parametrize(
    "world",
    [NOMINAL_WORLD, load_world(protocols() / "worlds" / "paper.toml")],
    ids=lambda w: w.file,
)
def test_the_skin_has_at_set_depths_the_statistics_of_printed_textures(
    world: SimulatedWorld,
) -> None:
    (slides,) = simulate_slides(world.parameters, 1, JUDGES[:1], DEPTHS_MM)
    figures = skin_figures(slides.samples, slides.design)
    assert figures.depth_excess < MOST_EXCESS, figures


def test_a_session_depends_only_on_its_own_seed() -> None:
    (alone,) = simulate_slides(WorldParameters(), 1, [2])
    beside = simulate_slides(WorldParameters(), 1, [1, 2])[1]
    assert all(map(np.array_equal, alone.samples, beside.samples))
    assert len(alone.samples) == 16 * 15


def test_a_plate_is_pressed_with_the_requested_force() -> None:
    slider = Slider(WorldParameters(), 1)
    slider.mount("C")
    means = [slider.trial(120.0, force).mean() for force in (250.0, 500.0, 1000.0)]
    assert means == sorted(means)
    assert len(slider.trial(120.0, 250.0)) == 2000


def test_a_slide_is_lifted_rests_and_runs_in_as_long_as_a_rig() -> None:
    rig = DirectRig(WorldParameters(), 1)
    operator = DrumOperator(rig, RigConfig(), Settle())
    operator.tare()
    for number in (1, 2):
        trial = PlannedTrial(number, "A", 80.0, 500.0, number, TRAVEL_MM)
        operator.prepare(trial)
        operator.approach()
        operator.run_window(lambda polls: None)
        operator.lift()
    truth = rig.truth.arrays()
    rig.close()
    window_ms = np.flatnonzero(np.diff(truth.sync.astype(int)) == 1)[-1]
    lifted = np.flatnonzero(truth.force_g[:window_ms] == 0.0)
    contact_ms, before = lifted[-1], np.flatnonzero(truth.force_g[: lifted[-1]])
    turning_ms = contact_ms + np.flatnonzero(truth.speed_mm_s[contact_ms:window_ms])[0]
    assert contact_ms - before[-1] == pytest.approx(LIFTED_MS, rel=0.1)
    assert turning_ms - contact_ms == pytest.approx(RESTING_MS, rel=0.2)
    assert truth.speed_mm_s[turning_ms:window_ms].sum() / 1000 == pytest.approx(RUN_IN_MM, abs=5)


def test_where_drag_adds_to_the_reading_a_fast_plate_is_pressed_with_less() -> None:
    slider = Slider(replace(WorldParameters(), loadcell_drag=0.3), 1)
    slider.mount("C")
    light, heavy = (
        slider.trial(120.0, force).mean() / slider.trial(40.0, force).mean()
        for force in (250.0, 1000.0)
    )
    assert heavy < light < 0.97


def test_with_the_most_drag_a_slow_plate_is_still_pressed_as_hard_as_a_protocol_may_ask() -> None:
    (most,) = (row.high for row in parameter_infos() if row.name == "loadcell_drag")
    slider = Slider(replace(WorldParameters(), loadcell_drag=most), 1)
    slider.mount("C")
    assert slider.trial(40.0, 1200.0).mean() > slider.trial(60.0, 1200.0).mean()


def test_a_step_replaces_the_best_only_if_better_and_is_reproducible(
    start: identify_bench.Candidate,
) -> None:
    candidates = []
    for _ in range(2):
        parameter_search = identify_bench.ParameterSearch(start, 5)
        candidates.append(parameter_search.step())
        assert parameter_search.best is min((start, candidates[-1]), key=lambda one: one.error)
    assert candidates[0] == candidates[1]
    assert candidates[0].parameters != start.parameters


def test_a_parameter_is_identified_by_the_figure_that_it_moves_and_others_are_free(
    start: identify_bench.Candidate,
) -> None:
    search = identify_bench.ParameterSearch(start, 5)
    for share in (-0.2, -0.1, 0.1, 0.2):
        moved = {**start.original, "groups": start.original["groups"] + 100.0 * share}
        value = start.parameters.relaxation * (1.0 + share)
        parameters = replace(start.parameters, relaxation=value)
        search.add(replace(start, parameters=parameters, original=moved))
    table = {line.split("`")[1]: line for line in search.precision().splitlines()[2:]}
    found = identify_bench.identified_parameters(start.parameters)
    assert list(table) == [row.name for row in found]
    assert "| ± " in table["relaxation"] and "| groups |" in table["relaxation"]
    assert all("| free |" in line for name, line in table.items() if name != "relaxation")


def test_the_command_prints_a_world_file(
    start: identify_bench.Candidate, capsys: pytest.CaptureFixture[str]
) -> None:
    judged = ["--steps", "0", "--repeats", "2", "--seeds", "1", "2"]
    assert main([*judged, "--set", "plate_tilt_mm=0.02"]) == 0
    output = capsys.readouterr().out
    assert "plate_tilt_mm = 0.02  # mm" in output
    assert re.search(r"# untrained-speed: \d+\.\d ± \d+\.\d \(paper 36\.8\)", output)
    assert "# from trial to trial: mean " in output


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (("--set", "plate_tilt_mm=9"), "plate_tilt_mm is 9 mm: choose 0 to 0.1"),
        (("--set", "plate_tilt=1"), "no parameter 'plate_tilt'"),
        (("--set", "plate_tilt_mm=much"), "write plate_tilt_mm=NUMBER"),
        (("--repeats", "1"), "'1': give a number from 2 on"),
        (("--seeds", "11", "-1"), "'-1': give a number from 0 on"),
    ],
)
def test_a_wrong_start_is_rejected_with_a_sentence(
    wrong: tuple[str, str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        assert main(["--steps", "0", *wrong]) == 2
    except SystemExit as end:
        assert end.code == 2
    assert why in capsys.readouterr().err


SEED, REPEATS = 1, 8


def test_the_skin_has_the_statistics_of_real_skins_and_of_the_page() -> None:
    (session,) = simulate_slides(WorldParameters(), REPEATS, [SEED])
    figures = measure_skin(session)
    print("\n".join(figures.lines()))
    for name, (low, high) in RANGES.items():
        assert low < getattr(figures, name) < high, name
    page = parameter_tables.PAGE.read_text(encoding="utf-8")
    for line in shown(figures):
        assert line in page, f"{line}: write it into docs/reference/world.md"


def shown(figures: SkinMeasures) -> list[str]:
    """Return the figures as the last columns of the page's table rows."""
    mean, amplitude = (
        " / ".join(f"{abs(share):.2f}" for share in shares)
        for shares in (figures.mean_shares, figures.amplitude_shares)
    )
    scatter = f"{figures.mean_scatter:.1%} / {figures.amplitude_scatter:.1%}"
    growths = f"× {figures.growth:.1f}", f"× {figures.mean_growth:.1f}"
    return [f"| {cell} |\n" for cell in (mean, amplitude, *growths, scatter)]
