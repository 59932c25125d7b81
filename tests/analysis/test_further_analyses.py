"""Further analyses: what is offered, what a report has of each, and what is left out."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.analysis.further_analyses import ANALYSES
from rigctl.analysis.lost_taxels import NEW, OLD, columns_of
from rigctl.analysis.options import AnalysisOptions
from rigctl.analysis.poisson_control import poisson_features
from rigctl.analysis.reading_noise import CLEAN, NOISY
from rigctl.analysis.report.report_folder import make_report
from rigctl.analysis.train_choice import parse_choice, usual_choices
from rigctl.analysis.train_distances import draw_trials
from rigctl.analysis.training_curve import part_of
from rigctl.analysis.trial_set import Design, join_sessions, open_trials
from rigctl.cli import main
from rigctl.errors import WrongUse
from rigctl.session.sensor_layout import SensorLayout
from tests.analysis.recordings import record

WHEN = "2026-11-21T12:00:00Z"
PAPER = SensorLayout.default(18)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two textures at two speeds and two forces, of which the extrapolation trains one each."""
    folder = tmp_path_factory.mktemp("further")
    (folder / "file.toml").write_text(
        "[conditions]\ntrained_speeds_mm_s = [40]\ntrained_forces_g = [500]\n"
    )
    return record(
        folder / "session", "ABL", repeats=4, travel_mm=24.0, speeds=(40, 80), forces=(250, 500)
    )


def further(session: Path, out: Path, name: str, **changed: Any) -> dict[str, Any]:
    """Return the values of one analysis in a report."""
    usual: dict[str, Any] = {"settings": session.parent / "file.toml"}
    options = AnalysisOptions(
        (session,), out=out, iterations=2, k_max=4, also=(name,), **(usual | changed)
    )
    make_report(options, WHEN)
    results: dict[str, Any] = json.loads((out / "results.json").read_text(encoding="utf-8"))
    page = (out / "report.html").read_text(encoding="utf-8")
    for sentence in results["further"][name]["sentences"]:
        assert escape(sentence.split(",")[0]) in page
    assert (out / f"{name}.csv").read_text(encoding="utf-8").count("\n") == 1 + len(
        results["further"][name]["rows"]
    )
    return results


def test_both_taxel_ranges_stand_side_by_side(session: Path, tmp_path: Path) -> None:
    results = further(session, tmp_path / "all", "ranges", ranges="all")
    rows = results["further"]["ranges"]["rows"]
    by = {(row["task"], row["representation"]): row for row in rows}
    task = results["tasks"]["untrained-force"]
    mean = task["representations"]["original"]["mean"][task["shown_components"] - 1]
    row = by["Untrained force", "Original"]
    assert row["all_percent"] == pytest.approx(100 * mean, abs=1e-3)
    again = further(session, tmp_path / "training", "ranges", ranges="training")
    curve = again["tasks"]["untrained-force"]["representations"]["original"]["mean"]
    assert row["training_percent"] == pytest.approx(100 * curve[row["components"] - 1], abs=1e-3)
    assert again["further"]["ranges"]["rows"] == rows


def test_an_analysis_that_the_trials_do_not_allow_is_a_note(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["analyse", str(session), "--iterations", "1", "--no-cache", "--also", "ranges"]
    assert main([*words, "--task", "textures", "--out", str(tmp_path / "out")]) == 0
    assert "both taxel ranges: left out, it needs the extrapolation" in capsys.readouterr().out
    assert json.loads((tmp_path / "out" / "results.json").read_text())["further"] == {}
    assert main([*words, "--also", "rages", "--out", str(tmp_path / "none")]) == 2
    assert "no further analysis 'rages'" in capsys.readouterr().err


def test_every_analysis_has_a_page_in_the_documentation() -> None:
    page = (Path(__file__).parents[2] / "docs/reference/analysis.md").read_text(encoding="utf-8")
    for one in ANALYSES:
        assert f"\n| `{one.name}` |" in page


def test_trains_are_chosen_by_receptor_layer_row_and_number() -> None:
    def rows(text: str) -> tuple[int, ...]:
        return parse_choice(text, PAPER).rows

    assert rows("SA") == tuple(range(18)) and rows("RA layer II") == tuple(range(27, 36))
    assert rows("SA layer I row 2") == (3, 4, 5)
    assert rows("sa column 3 taxels 1-6, 12") == (2, 5, 11)
    names = [one.name for one in usual_choices(PAPER)]
    assert names == [
        "all trains", "SA", "RA", "layer I", "layer II", "SAI", "RAI", "SAII", "RAII",
        "row 1", "row 2", "row 3",
    ]  # fmt: skip
    for text, sentence in (
        ("layer III", "there is no layer III: the sensor has I, II"),
        ("taxels 17-19", "there is no taxel 19: choose 1 to 18"),
        ("row 4", "there is no row 4: the sensor has 3"),
        ("layer II taxel 3", "no taxel is in all of its parts"),
        ("thumb", "names no trains: write SA or RA"),
    ):
        with pytest.raises(WrongUse, match=sentence):
            parse_choice(text, PAPER)


def test_some_trains_classify_as_their_features_alone(session: Path, tmp_path: Path) -> None:
    file = session.parent / "file.toml"
    file.write_text(file.read_text() + '[further]\ntrains = ["RA taxel 4", "layer V"]\n')
    results = further(session, tmp_path / "out", "trains")
    found = results["further"]["trains"]
    assert found["sentences"][0] == (
        "further.trains: there is no layer V: the sensor has I, II; left out."
    )
    by = {(row["task"], row["representation"], row["trains"]): row for row in found["rows"]}
    task = results["tasks"]["textures"]
    mean = task["representations"]["speed"]["mean"][task["shown_components"] - 1]
    whole = by["Individual textures", "Speed Scaled", "all trains"]
    assert whole["mean_percent"] == pytest.approx(100 * mean, abs=1e-3)
    alone = results["evidence"]["alone"]["textures"]["speed"]
    for half in ("SA", "RA"):
        row = by["Individual textures", "Speed Scaled", half]
        assert row["mean_percent"] == pytest.approx(100 * alone[half], abs=1e-3)
    assert by["Individual textures", "Speed Scaled", "RA taxel 4"]["number_of_trains"] == 1


def test_losing_no_taxel_changes_nothing_and_losing_most_does(
    session: Path, tmp_path: Path
) -> None:
    results = further(session, tmp_path / "out", "lost")
    rows = results["further"]["lost"]["rows"]
    task = results["tasks"]["textures"]
    mean = task["representations"]["original"]["mean"][task["shown_components"] - 1]
    mine = [r for r in rows if (r["task"], r["representation"]) == (task["title"], "Original")]
    before = {r["taxels_lost"]: r["mean_percent"] for r in mine if r["classifier"] == OLD}
    after = {r["taxels_lost"]: r["mean_percent"] for r in mine if r["classifier"] == NEW}
    assert before[0] == after[0] == pytest.approx(100 * mean, abs=1e-3)
    assert list(before) == [0, 1, 2, 3, 4, 6, 8, 10, 12, 15, 17]
    assert before[17] < before[0]
    assert columns_of([1], 3, 12).tolist() == [2, 3, 8, 9], "SA and RA of the second taxel"


def test_noise_is_the_same_whoever_reads_and_harms_what_was_trained_without(
    session: Path, tmp_path: Path
) -> None:
    trials = join_sessions([session])
    noisy = tuple(replace(file, noise_counts=30.0) for file in trials.files)
    some = trials.trials[3:6]
    with open_trials(trials.files) as clean, open_trials(noisy) as reader:
        block = reader.read_block(some).arrays
        for one, together in zip(some, block, strict=True):
            alone = reader.read(one)
            assert np.array_equal(alone, together)
            difference = alone.astype(int) - clean.read(one)
            assert 25 < difference.std() < 35 and abs(difference.mean()) < 2
    file = session.parent / "noise.toml"
    file.write_text("[further]\nnoise_counts = [0.01, 300]\n")
    results = further(session, tmp_path / "out", "noise", task=("textures",), settings=file)
    by = {
        (row["representation"], row["classifier"], row["noise_counts"]): row["mean_percent"]
        for row in results["further"]["noise"]["rows"]
    }
    task = results["tasks"]["textures"]
    for key, name in (("original", "Original"), ("force", "Force Scaled")):
        mean = 100 * task["representations"][key]["mean"][task["shown_components"] - 1]
        for trained in (CLEAN, NOISY):
            # A hundredth of a count changes no reading.
            assert (
                by[name, trained, 0.0] == by[name, trained, 0.01] == pytest.approx(mean, abs=0.01)
            )
        assert by[name, CLEAN, 300] < mean


def test_classifiers_are_scored_on_ldas_folds(session: Path, tmp_path: Path) -> None:
    results = further(session, tmp_path / "out", "classifiers")
    rows = results["further"]["classifiers"]["rows"]
    names = list(dict.fromkeys(row["classifier"] for row in rows))
    assert names == [
        "LDA", "5 nearest neighbours", "linear SVM", "logistic regression", "k-means clusters",
    ]  # fmt: skip
    task = results["tasks"]["textures"]
    by = {
        (row["representation"], row["classifier"]): row
        for row in rows
        if row["task"] == task["title"]
    }
    mean = task["representations"]["speed"]["mean"][task["shown_components"] - 1]
    assert by["Speed Scaled", "LDA"]["mean_percent"] == pytest.approx(100 * mean, abs=1e-3)
    for name in names[1:]:
        assert by["Speed Scaled", name]["mean_percent"] > 100 * task["chance"]


def test_the_training_curve_ends_at_the_report(session: Path, tmp_path: Path) -> None:
    results = further(session, tmp_path / "out", "training", task=("textures",))
    task, rows = results["tasks"]["textures"], results["further"]["training"]["rows"]
    mine = [row for row in rows if row["representation"] == "Speed Scaled"]
    trained = [row["training_trials"] for row in mine]
    assert trained == sorted(trained) and len(trained) > 2
    mean = task["representations"]["speed"]["mean"][task["shown_components"] - 1]
    assert mine[-1]["mean_percent"] == pytest.approx(100 * mean, abs=1e-3)
    texture = np.repeat([0, 1, 2], 10)
    part = part_of(np.arange(30), texture, 0.2, [1])
    assert np.bincount(texture[part]).tolist() == [2, 2, 2]


def test_distances_tell_textures_apart_across_speeds_where_trains_are_scaled(
    session: Path, tmp_path: Path
) -> None:
    results = further(session, tmp_path / "out", "distances", task=("textures",))
    found = results["further"]["distances"]
    assert found["sentences"][0].startswith("48 of 48 trials, drawn evenly")
    rows = {(row["representation"], row["distance"]): row for row in found["rows"]}
    assert len(rows) == 8
    for distance in ("Victor-Purpura", "van Rossum"):
        original, scaled = (rows[name, distance] for name in ("Original", "Speed Scaled"))
        assert 0 < scaled["same_texture_same_condition"] < scaled["other_texture_same_condition"]
        assert scaled["contrast"] > original["contrast"]
    design = Design(("A", "B"), np.repeat([0, 1], 12), np.tile([40.0, 80.0], 12), np.ones(24))
    rows_drawn = draw_trials(design, 8, 0)
    cells = design.texture[rows_drawn] * 100 + design.speed_mm_s[rows_drawn]
    assert np.unique(cells, return_counts=True)[1].tolist() == [2, 2, 2, 2]


def test_poisson_trains_have_the_expected_spikes_and_more_spread(
    session: Path, tmp_path: Path
) -> None:
    features = np.tile([50.0, 20.0, 4.0, 0.0], (4000, 1))  # one taxel, two windows, SA and RA
    seconds = np.tile([0.1, 0.3], (4000, 1))
    drawn = poisson_features(features, seconds, np.random.default_rng(0))
    np.testing.assert_allclose(drawn.mean(axis=0), features[0], rtol=0.05)
    variance = np.array([50 / 0.1, 20 / 0.3, 4.0])
    np.testing.assert_allclose(drawn.var(axis=0)[:3], variance, rtol=0.1)
    rows = further(session, tmp_path / "out", "poisson", task=("textures",))["further"]["poisson"]
    by = {(row["representation"], row["spikes"]): row["mean_percent"] for row in rows["rows"]}
    assert by["Speed Scaled", "Poisson"] < by["Speed Scaled", "as encoded"]


def test_trains_lie_on_each_other_behind_the_module_that_scales_them(
    session: Path, tmp_path: Path
) -> None:
    results = further(session, tmp_path / "out", "invariance", task=("textures",))
    rows = results["further"]["invariance"]["rows"]
    assert "Texture L" in results["further"]["invariance"]["sentences"][0]

    def pair(name: str, one: str, other: str) -> dict[str, Any]:
        chosen = {"representation": name, "receptor": "SA", "condition": one}
        chosen["other_condition"] = other
        return next(row for row in rows if chosen.items() <= row.items())

    speeds = ("40 mm/s, 500 g", "80 mm/s, 500 g")
    before, after = (pair(name, *speeds) for name in ("Original", "Speed Scaled"))
    assert after["correlation"] > 0.6 > before["correlation"] + 0.2
    forces = ("40 mm/s, 250 g", "40 mm/s, 500 g")
    before, after = (pair(name, *forces) for name in ("Original", "Force Scaled"))
    assert after["difference_percent"] < before["difference_percent"]
    rates = [[one["rate_hz"], one["other_rate_hz"]] for one in (before, after)]
    assert 3 * np.ptp(rates[1]) < np.ptp(rates[0]), "C brings the rates of a taxel together"
    picture = (tmp_path / "out" / "invariance.svg").read_text(encoding="utf-8")
    assert "SA 40 mm/s, 250 g" in picture and "RA 80 mm/s, 500 g" in picture


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ('texture = "Z"', "there is no texture Z: choose from A, B, L"),
        ("taxel = 19", "there is no taxel 19: choose 1 to 18"),
    ],
)
def test_a_texture_or_taxel_that_is_not_there_is_a_note(
    session: Path, tmp_path: Path, line: str, sentence: str
) -> None:
    file = tmp_path / "file.toml"
    file.write_text(f"[further]\n{line}\n")
    options = AnalysisOptions(
        (session,), out=tmp_path / "out", iterations=1, k_max=3, also=("invariance",),
        settings=file, task=("textures",),
    )  # fmt: skip
    report = make_report(options, WHEN)
    assert any(sentence in remark for remark in report.remarks)


def test_c_and_the_rates_before_and_after_it_are_drawn(session: Path, tmp_path: Path) -> None:
    results = further(session, tmp_path / "out", "c", task=("textures",))
    rows = results["further"]["c"]["rows"]
    reference = {row["texture"]: row["before_hz"] for row in rows if row["force_g"] == 500}
    for row in rows:
        assert row["after_hz"] == pytest.approx(reference[row["texture"]], abs=0.3)
        if row["force_g"] == 250:
            assert row["before_hz"] < reference[row["texture"]] - 3
    assert "C at 250 g" in (tmp_path / "out" / "c-2.svg").read_text(encoding="utf-8")


def test_loadings_say_what_each_component_explains(session: Path, tmp_path: Path) -> None:
    rows = further(session, tmp_path / "out", "loadings", task=("textures",))["further"]["loadings"]
    mine = [row for row in rows["rows"] if row["representation"] == "Speed Scaled"]
    shares = [row["variance_percent"] for row in mine]
    assert shares == sorted(shares, reverse=True) and mine[-1]["cumulative_percent"] <= 100.001
    assert sum(shares) == pytest.approx(mine[-1]["cumulative_percent"], abs=0.01)
    for row in mine:
        assert row["layer_I_percent"] + row["layer_II_percent"] == pytest.approx(100, abs=0.01)
        assert 0 <= row["sa_percent"] <= 100


def test_every_stage_of_figure_1b_is_of_a_trial_that_the_classifier_has_not_seen(
    session: Path, tmp_path: Path
) -> None:
    found = further(session, tmp_path / "out", "stages", task=("textures",))["further"]["stages"]
    by = {row["texture"]: row["posterior_percent"] for row in found["rows"]}
    assert list(by) == ["A", "B", "L"] and sum(by.values()) == pytest.approx(100, abs=0.01)
    (sentence,) = found["sentences"]
    assert re.search("texture L, .* 250 g", sentence), "where C changes something"
    assert f"name it {max(by, key=by.__getitem__)}" in sentence
    picture = (tmp_path / "out" / "stages.svg").read_text(encoding="utf-8")
    for words in ("i Readings", "ii Scaled by C", "iii Spikes", "iv Spikes in scaled time",
                  "v SA rate (Hz)", "v RA count (spikes)", "vi Texture", "L (true)"):  # fmt: skip
        assert words in re.sub(r"\s+", " ", picture)


def test_a_set_by_depth_is_named_in_millimetres(tmp_path: Path) -> None:
    session = record(
        tmp_path / "session", "BL", repeats=3, travel_mm=24.0, speeds=(80,), depths_mm=(0.4, 0.6, 1)
    )
    options = AnalysisOptions(
        (session,), out=tmp_path / "out", iterations=1, k_max=3, task=("textures",),
        also=("stages", "invariance", "c"),
    )  # fmt: skip
    make_report(options, WHEN)
    found = json.loads((tmp_path / "out" / "results.json").read_text("utf-8"))["further"]
    assert re.search(r"texture L, 80 mm/s, (0.4|1) mm\.", found["stages"]["sentences"][0])
    assert "0.4, 1 mm." in found["invariance"]["sentences"][0]
    assert "C at 0.4 mm" in (tmp_path / "out" / "c-2.svg").read_text("utf-8")
