"""Small multiples of a set: what each panel shows of its trials, on scales that all share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from rigctl.analysis.report.charts import condition_responses
from rigctl.analysis.report.charts.condition_responses import measure_responses
from rigctl.analysis.report.charts.small_multiples import SmallMultiples, small_multiples
from rigctl.analysis.trial_set import TrialSet, join_sessions, open_trials
from rigctl.encoding.encoder import encode_trial
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT
from tests.analysis.recordings import record

RANGES = Normalisation(np.zeros(18, np.uint16), np.full(18, 1023, np.uint16), "by hand")


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrialSet]:
    folder = tmp_path_factory.mktemp("multiples") / "session"
    yield join_sessions([record(folder, "AB", repeats=6, travel_mm=44.0, speeds=(40, 80))])


def test_a_response_is_that_of_the_trials_first_second(trials: TrialSet) -> None:
    found = {
        (r.texture, r.force_g, r.speed_mm_s): r for r in measure_responses(trials, RANGES, DEFAULT)
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
    for response in measure_responses(trials, above, DEFAULT):
        assert response.reading.min() >= 0 and response.reading.max() <= 1


def test_panels_stand_by_texture_and_speed_for_each_force(trials: TrialSet) -> None:
    missing = tuple(
        t for t in trials.trials if (t.texture, t.force_g, t.speed_mm_s) != ("A", 250.0, 80.0)
    )
    multiples = small_multiples(replace(trials, trials=missing), RANGES, DEFAULT)
    light, heavy = multiples.blocks
    assert (light.force_g, light.speeds_mm_s, heavy.force_g) == (250.0, (40.0, 80.0), 500.0)
    assert [name for name, _ in light.rows] == ["A", "B"]
    shown = [[panel is not None for panel in panels] for _, panels in light.rows]
    assert shown == [[True, False], [True, True]]
    panel = heavy.rows[1][1][0]
    assert panel is not None and "4 of 6 trials averaged" in panel.title
    assert panel.raster.startswith("data:image/png;base64,") and panel.reading.startswith("M")
    assert "spikes/s a neuron" in multiples.note and "are not" not in multiples.note


def test_the_number_of_panels_is_bounded_and_said(
    trials: TrialSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(condition_responses, "MAX_CONDITIONS", 3)
    multiples = small_multiples(trials, RANGES, DEFAULT)
    assert (len(multiples.responses), multiples.left_out) == (3, 5)
    assert "Only 3 conditions are shown, 5 are not." in multiples.note


def test_a_silent_sensor_has_panels_too(trials: TrialSet) -> None:
    silent = Normalisation(np.zeros(18, np.uint16), np.zeros(18, np.uint16), "by hand")
    (first, *_) = measure_responses(trials, silent, DEFAULT)
    (block,) = SmallMultiples([first]).blocks
    assert block.rows[0][1][0] is not None and not first.raster.any()
