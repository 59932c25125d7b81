"""The responses of a set: what each panel shows of its trials, on scales that all share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from rigctl.analysis.report import responses
from rigctl.analysis.report.responses import Responses, measure_responses
from rigctl.analysis.report.vega import still
from rigctl.analysis.trial_set import TrialSet, join_sessions, open_trials
from rigctl.encoder.encoder import encode_trial
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT
from tests.analysis.recordings import record

RANGES = Normalisation(np.zeros(18, np.uint16), np.full(18, 1023, np.uint16), "by hand")


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrialSet]:
    folder = tmp_path_factory.mktemp("multiples") / "session"
    yield join_sessions([record(folder, "AB", repeats=6, travel_mm=44.0, speeds=(40, 80))])


def test_a_response_is_that_of_the_trials_first_second(trials: TrialSet) -> None:
    found = {
        (r.texture, r.force_g, r.speed_mm_s): r
        for r in measure_responses(trials, RANGES, DEFAULT).conditions
    }
    assert len(found) == 2 * 2 * 2
    one = found["B", 500.0, 40.0]
    assert (one.n_trials, one.averaged, len(one.reading), one.raster.shape) == (
        6,
        4,
        100,
        (2, 18, 201),
    )
    first = next(
        t for t in trials.trials if (t.texture, t.force_g, t.speed_mm_s) == ("B", 500.0, 40.0)
    )
    with open_trials(trials.files) as reader:
        spikes = encode_trial(reader.read(first)[:1000], RANGES)
    assert one.raster[0, 3].nonzero()[0].tolist() == sorted({*(spikes.train(3) // 5).tolist()})
    assert one.raster[1, 17].nonzero()[0].tolist() == sorted({*(spikes.train(35) // 5).tolist()})
    assert 0.2 < one.reading.mean() < 0.6
    # A trial of 0.55 s is shown as long as it is.
    assert len(found["B", 500.0, 80.0].reading) == 55


def test_readings_outside_the_ranges_are_clipped(trials: TrialSet) -> None:
    above = Normalisation(np.full(18, 1022, np.uint16), np.full(18, 1023, np.uint16), "by hand")
    for response in measure_responses(trials, above, DEFAULT).conditions:
        assert response.reading.min() >= 0 and response.reading.max() <= 1


def test_panels_stand_by_texture_and_speed_for_each_force(trials: TrialSet) -> None:
    missing = tuple(
        t for t in trials.trials if (t.texture, t.force_g, t.speed_mm_s) != ("A", 250.0, 80.0)
    )
    found = measure_responses(replace(trials, trials=missing), RANGES, DEFAULT)
    light, heavy = found.grids().values()
    assert list(found.grids()) == [250.0, 500.0]
    panels = [row for row in light["data"]["values"] if "words" in row]
    places = [(row["texture"], row["speed"]) for row in panels]
    assert places == [("A", 40.0), ("B", 40.0), ("B", 80.0)]
    svg = still(heavy)
    for words in ("40 mm/s", "reading", "spikes/s", "0 s", "Texture B, 80 mm/s, 500 g: mean"):
        assert words in svg
    assert svg.count("4 of 6 trials averaged") == svg.count("data:image/png;base64,") == 4
    assert "spikes/s a neuron" in found.note and "are not" not in found.note


def test_all_panels_have_the_same_scales(trials: TrialSet) -> None:
    found = measure_responses(trials, RANGES, DEFAULT)
    rows = [row for grid in found.grids().values() for row in grid["data"]["values"]]
    readings = [y for row in rows if row.get("colour") == "var(--ink)" for y in row["y"]]
    assert (min(readings), max(readings)) == pytest.approx((1.0, 23.0), abs=4.0)
    rates = [y for row in rows if row.get("colour") == "var(--sa)" for y in row["y"]]
    assert min(rates) == 65.0 and max(rates) <= 89.0


def test_the_number_of_panels_is_bounded_and_said(
    trials: TrialSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(responses, "MAX_CONDITIONS", 3)
    found = measure_responses(trials, RANGES, DEFAULT)
    assert (len(found.conditions), found.left_out) == (3, 5)
    assert "Only 3 conditions are shown, 5 are not." in found.note


def test_a_silent_sensor_has_panels_too(trials: TrialSet) -> None:
    silent = Normalisation(np.zeros(18, np.uint16), np.zeros(18, np.uint16), "by hand")
    first = measure_responses(trials, silent, DEFAULT).conditions[0]
    assert not first.raster.any()
    assert "Texture A" in still(Responses([first]).grids()[first.force_g])
