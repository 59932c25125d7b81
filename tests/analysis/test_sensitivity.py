"""The table over encoder presets: rates as encoded, answers over the same draws."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.cache import Resources
from rigctl.analysis.options import AnalysisOptions
from rigctl.analysis.report import report_folder
from rigctl.analysis.representations import REPRESENTATIONS, represent
from rigctl.analysis.sensitivity import PRESET_ORDER, STAGE, mean_rates_hz
from rigctl.analysis.tasks import run_tasks
from rigctl.analysis.trial_set import join_sessions
from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.parameters import MODEL_PRESETS, PRESETS, SA_PRESETS
from rigctl.session.session import Session
from tests.analysis.recordings import record


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sensitivity") / "session"
    return record(folder, "ABG", repeats=2, travel_mm=12.0, speeds=(40, 80))


def test_rates_are_those_of_the_spikes(session: Path, tmp_path: Path) -> None:
    representations = represent(join_sessions([session]), PRESETS["explicit"], tmp_path)
    with Session.open(session) as opened:
        samples = [opened.samples(int(row)) for row in opened.committed()]
    trains = encode_trials(samples, representations.normalisation, representations.parameters)
    by_hand = []
    for spikes in trains:
        counts = np.diff(spikes.row_start) / (spikes.n_samples / 1000)
        by_hand.append([counts[:18].mean(), counts[18:].mean()])
    for representation in REPRESENTATIONS[:2]:
        found = mean_rates_hz(representations, representation)
        assert found == pytest.approx(np.mean(by_hand, axis=0), rel=1e-9)


def test_every_preset_answers_the_same_questions(session: Path, tmp_path: Path) -> None:
    reported: list[tuple[int, int]] = []

    def listen(stage: str, done: int, all_: int) -> None:
        if stage == STAGE:
            reported.append((done, all_))

    options = AnalysisOptions(
        (session,), out=tmp_path / "r", iterations=2, k_max=12, seed=5, task=("textures",),
        sensitivity=True,
    )  # fmt: skip
    report_folder.make_report(options, "2026-11-21T12:00:00Z", Resources(progress=listen))
    plain = json.loads((tmp_path / "r" / "results.json").read_text())
    rows = plain["sensitivity"]["rows"]
    assert list(dict.fromkeys(row["preset"] for row in rows)) == list(PRESET_ORDER)
    assert len(rows) == len(PRESETS) * 8
    shares = [done / all_ for done, all_ in reported]
    assert shares == sorted(shares) and shares[-1] == 1.0 and len(set(shares)) > 10

    by = {(row["preset"], row["representation"]): row for row in rows}
    rate = {name: by[name, "original"]["sa_hz"] for name in PRESET_ORDER}
    assert 2 * rate["quarter-rate"] < rate["default"] < rate["explicit"]
    ra_rate = {name: by[name, "original"]["ra_hz"] for name in PRESET_ORDER}
    readings = [name for name in PRESET_ORDER if name not in (*SA_PRESETS, *MODEL_PRESETS)]
    assert 0 < rate["adaptive-lif"] < rate["lif"]
    assert {rate[name] for name in readings} == {rate["default"]}
    assert ra_rate["ra-per-sample"] == 0.0
    assert len({ra_rate[name] for name in readings} | {ra_rate["default"]}) == 1 + len(readings)
    curve = plain["tasks"]["textures"]["representations"]["speed"]
    k = by["default", "speed"]["components"] - 1
    assert by["default", "speed"]["mean_percent"] == pytest.approx(100 * curve["mean"][k], abs=1e-4)

    neuron, models, channel = plain["sensitivity"]["sentences"]
    assert models.startswith("Between the 3 neurons, an accuracy")
    assert neuron.startswith("Between the 5 presets that differ in the neuron, an accuracy")
    assert channel.startswith("Between the 7 readings of the RA channel, an accuracy")
    widest = max(
        np.ptp([by[name, key]["mean_percent"] for name in SA_PRESETS])
        for key in {row["representation"] for row in rows}
    )
    assert f"at most by {widest:.1f} (" in neuron and "individual textures" in neuron

    alone = represent(join_sessions([session]), PRESETS["iskarous2022"], tmp_path)
    (result,), _ = run_tasks(alone, options.sweep)
    expected = result.curve("original")
    assert expected is not None
    found = by["iskarous2022", "original"]["mean_percent"]
    assert found == pytest.approx(100 * float(expected.mean[k]), abs=1e-4)

    with (tmp_path / "r" / "sensitivity.csv").open() as file:
        rows_csv = list(csv.DictReader(file))
    assert [float(row["sa_hz"]) for row in rows_csv] == [row["sa_hz"] for row in rows]
    page = (tmp_path / "r" / "report.html").read_text()
    assert "Encoder presets" in page and "iskarous2022" in page
    assert not (tmp_path / "r" / "features").exists()
