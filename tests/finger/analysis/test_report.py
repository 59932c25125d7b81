"""The report of the real-time experiment: figures, values beside the paper's, and its words."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rigctl.analysis.cache import Resources
from rigctl.analysis.report.figure import Panel, PublishedValue
from rigctl.analysis.statistics import k_ranges
from rigctl.encoder.force_gain import ForceScaling
from rigctl.errors import WrongUse
from rigctl.finger.analysis.figures import accuracy_figures, draw_latencies, gain_figure
from rigctl.finger.analysis.report import (
    CAPTIONS,
    findings,
    held_above,
    held_double,
    summary_lines,
    write_finger_report,
)
from rigctl.finger.analysis.results import FingerAnalysis, analyse_finger
from rigctl.finger.analysis.scans import FingerDataSet, Rates, ScanSet
from rigctl.finger.analysis.tasks import DrawSettings
from rigctl.finger.published import NEW_SESSION, SAME_SESSION
from rigctl.finger.values import ScanKind
from tests.finger.analysis.made_scans import made_data_set

DIAMOND = 'd="M-4.183,0L0,-4.183L4.183,0L0,4.183Z"'


@pytest.fixture(scope="module")
def analysis() -> FingerAnalysis:
    shown: list[tuple[str, int, int]] = []
    resources = Resources(progress=lambda *step: shown.append(step))
    latencies = {"features": np.linspace(0.5, 4.0, 100), "prediction": np.linspace(1, 30, 100)}
    found = analyse_finger(
        [made_data_set(1, contrast=0.012)],
        DrawSettings(3),
        resources,
        latencies=latencies,
        remarks=["session 2: trial 4 was left out"],
    )
    stages = {stage for stage, _, _ in shown}
    assert stages == {"classifying draws", "measuring answers", "leaving textures out"}
    assert all(any(s == stage and d == n for s, d, n in shown) for stage in stages)
    return found


@pytest.fixture(scope="module")
def folder(analysis: FingerAnalysis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("report") / "out"
    assert write_finger_report(analysis, out, "2030-01-01T00:00:00Z") == out / "report.html"
    return out


@pytest.mark.parametrize(("left", "words"), [(1, "single training trial: D"), (2, "2 folds")])
def test_a_texture_with_few_training_trials_is_told_and_the_rest_analysed(
    left: int, words: str
) -> None:
    whole = made_data_set(1, contrast=0.012)
    kept = np.ones(len(whole.training), bool)
    kept[np.flatnonzero(whole.training.texture == "D")[left:]] = False
    found = analyse_finger([replace(whole, training=whole.training.select(kept))], DrawSettings(1))
    assert any(words in remark for remark in found.remarks)
    assert ("D" in found.data_sets[0].textures) == (left > 1)
    assert len(found.tasks) == 5


def test_every_figure_is_there_and_says_that_it_is_simulated(folder: Path) -> None:
    for name in ("fig4b", "fig4c", "figs5", "gains", "evidence", "promises", "latencies"):
        assert (folder / f"{name}.png").stat().st_size > 10_000
        assert "Simulated finger · 1 data set" in (folder / f"{name}.svg").read_text("utf-8")


def test_every_representation_says_what_it_knows_of_the_force(tmp_path: Path) -> None:
    plain = made_data_set(1, contrast=0.012)

    def with_gain(scans: ScanSet) -> ScanSet:
        rates = Rates(scans.windows, scans.time_rates)
        return replace(scans, gained={ForceScaling.DIVIDED: rates})

    parts = (with_gain(one) for one in (plain.training, plain.calibration, plain.tested))
    found = analyse_finger([FingerDataSet("gained", *parts)], DrawSettings(1))
    page = write_finger_report(found, tmp_path / "out", "2030-01-01T00:00:00Z").read_text("utf-8")
    values: dict[str, Any] = json.loads((tmp_path / "out" / "results.json").read_text("utf-8"))
    assert values["knows"] == dict.fromkeys(
        ("Original", "Speed Scaled", "Divided", "Speed Scaled and Divided"), "nothing"
    )
    for task in values["tasks"].values():
        assert task["curves"]["Speed Scaled and Divided"] == task["curves"]["Speed Scaled"]
    divided = [one for one in values["force_invariance"] if one["scaling"] == "Divided"]
    assert {one["verdict"] for one in divided} == {"no significant difference"}
    (figure,) = accuracy_figures(values, {"Fig. S5": "Figure S5: one"})
    assert len(figure.panels[0].series) == 2, "the paper's figure has the paper's two"
    assert len(gain_figure(values).panels[0].series) == 4
    assert "what it knows of the force" in page and "<td>Speed Scaled and Divided</td>" in page


def test_the_figures_have_the_papers_values_and_both_representations(folder: Path) -> None:
    text = (folder / "fig4b.svg").read_text("utf-8")
    for words in ("Same session: Original", "New session: Speed Scaled", "n = 3 draws"):
        assert words in text
    deployed = (folder / "figs5.svg").read_text("utf-8")
    assert "h &gt; 0.2" in deployed and "n = 50 trials" in deployed


@pytest.mark.parametrize(("name", "quoted"), [("fig4b", 4), ("fig4c", 4), ("figs5", 2)])
def test_the_papers_quoted_accuracies_are_drawn(folder: Path, name: str, quoted: int) -> None:
    assert (folder / f"{name}.svg").read_text("utf-8").count(DIAMOND) == quoted


def test_answers_are_told_by_texture_and_by_velocity_profile(
    analysis: FingerAnalysis, folder: Path
) -> None:
    values: dict[str, Any] = json.loads((folder / "results.json").read_text("utf-8"))
    deployed = next(one for one in analysis.tasks if one.task.key == "deployed")
    for kind, one in zip(deployed.accuracy, values["answers"], strict=True):
        confusion = np.array(one["confusion"])
        assert confusion.sum() == sum(one["tested"].values()) == 50
        assert np.trace(confusion) == sum(one["right"].values())
        share = deployed.accuracy[kind][0][one["components"] - 1]
        assert np.trace(confusion) / 50 == pytest.approx(share)
        assert set(one["tested"]) == {"slow", "medium", "fast", "slow-to-fast", "fast-to-slow"}
    page = (folder / "report.html").read_text("utf-8")
    assert "Which textures, which velocities" in page
    assert "slow-to-fast" in (folder / "profiles.svg").read_text("utf-8")
    assert (folder / "confusion.png").stat().st_size > 10_000


def test_results_hold_every_number_of_components(folder: Path) -> None:
    values: dict[str, Any] = json.loads((folder / "results.json").read_text("utf-8"))
    assert values["simulated"] is True and values["settings"]["draws"] == 3
    assert set(values["tasks"]) == {
        "same-session", "new-session", "trained-profiles", "untrained-profiles", "deployed",
    }  # fmt: skip
    for key, task in values["tasks"].items():
        for curve in task["curves"].values():
            assert len(curve["mean"]) == len(curve["standard_error"]) == task["k_max"]
        tests = values["curve_tests"][key]["Speed Scaled"]
        assert tests["against"] == "Original" and tests["in_paper"] is True
        assert len(tests["p"]) == len(tests["effect"]) == len(tests["stars"]) == task["k_max"]
    assert values["curve_tests"]["new-session"]["Speed Scaled"]["effect_name"] == "Cohen's d"
    assert values["curve_tests"]["deployed"]["Speed Scaled"]["effect_name"] == "Cohen's h"
    deployed = values["tasks"]["deployed"]
    assert deployed["paper"]["accuracy"]["Speed Scaled"] == {"percent": 61.67, "components": 25}
    assert any("same trials" in text for text in deployed["assumptions"])
    assert values["tasks"]["new-session"]["paper"]["shares"] == []
    quoted = {"Original": 52.33, "Speed Scaled": 61.67}
    assert deployed["paper"]["shares"]
    for share in deployed["paper"]["shares"]:
        paper = quoted[share["kind"]]
        assert (share["of"], share["paper"]["percent"], share["paper"]["of"]) == (50, paper, 300)
        ours = deployed["curves"][share["kind"]]["mean"][share["components"] - 1]
        assert share["correct"] == round(50 * ours)
        assert np.sign(share["paper"]["test"]["effect"]) == np.sign(100 * ours - paper)
    assert values["latencies"]["features"]["p99"] == pytest.approx(3.965, abs=0.001)


def test_the_page_says_what_is_simulated_and_what_was_left_out(folder: Path) -> None:
    page = (folder / "report.html").read_text("utf-8")
    for words in ("<b>Simulated.</b>", "trial 4 was left out", "61.67 %", "mean size", "Latency"):
        assert words in page


def test_the_page_begins_with_what_was_found(analysis: FingerAnalysis, folder: Path) -> None:
    page = (folder / "report.html").read_text("utf-8")
    found = findings(analysis)
    assert page.index("is more accurate than Original in") < page.index("Ours beside the paper")
    assert "same session" in found[0] and "better by two asterisks" in found[1]
    assert found[2].startswith(("Not reproduced", "Every peak"))
    assert any("sets hold the texture (95% promised)" in sentence for sentence in found)


def test_the_curves_have_the_papers_values_and_asterisks(folder: Path) -> None:
    values: dict[str, Any] = json.loads((folder / "results.json").read_text("utf-8"))
    figures = accuracy_figures(values, CAPTIONS)
    assert [one.title[:10] for one in figures] == ["Figure 4B:", "Figure 4C:", "Figure S5:"]
    (panel,) = figures[0].panels
    assert isinstance(panel, Panel)
    assert [one.name for one in panel.series] == [
        "Same session: Original", "Same session: Speed Scaled",
        "New session: Original", "New session: Speed Scaled",
    ]  # fmt: skip
    peak = PublishedValue(54, 50.45, "the paper's peak: 50.45 % with 54 components")
    assert panel.series[2].published == [peak]
    assert [one.colour for one in panel.series] == ["light-blue", "blue", "light-green", "green"]
    assert "about 90 %" in panel.series[1].published[0].text
    same = values["tasks"]["same-session"]["curves"]["Speed Scaled"]
    assert panel.series[1].y == [100 * share for share in same["mean"]]
    assert panel.series[1].spread == [100 * share for share in same["standard_error"]]
    assert panel.series[1].stars == values["curve_tests"]["same-session"]["Speed Scaled"]["stars"]
    page = (folder / "report.html").read_text("utf-8")
    assert page.index("Figure 4B") < page.index("Ours beside the paper")
    assert page.count("<figure class=chart") == 6


def test_a_claim_is_counted_at_the_papers_numbers_of_components(analysis: FingerAnalysis) -> None:
    accuracy = {ScanKind.ORIGINAL: np.zeros((3, 70)), ScanKind.SPEED_SCALED: np.zeros((3, 70))}
    accuracy[ScanKind.SPEED_SCALED][:, 4:15] = 0.5
    accuracy[ScanKind.ORIGINAL][:, 20] = 0.25
    new = next(one for one in analysis.tasks if one.task is NEW_SESSION)
    above = held_above(replace(new, accuracy=accuracy))
    assert above == ("10 to 26", 6, 17)
    same = next(one for one in analysis.tasks if one.task is SAME_SESSION)
    assert held_above(same) is None
    double = held_double(same)
    assert (double.words, double.tested) == ("1 to 70", same.k_max)
    assert double.held == sum(d.stars == "**" and (d.effect or 0) > 0 for d in same.differences())


def test_equal_latencies_are_visible(tmp_path: Path) -> None:
    """A simulation without a pace has the same latency throughout."""
    png = draw_latencies({"features": np.ones(50)}, "Simulated finger", tmp_path / "latencies")
    with Image.open(png) as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    assert np.all(pixels == (0x1F, 0x4F, 0xD1), axis=1).sum() > 1000


def test_the_summary_has_a_line_for_each_task_and_promise(
    analysis: FingerAnalysis, folder: Path
) -> None:
    lines = summary_lines(analysis)
    assert json.loads((folder / "results.json").read_text("utf-8"))["sentences"] == lines
    assert lines[0] == "note: session 2: trial 4 was left out"
    assert sum("components: Original" in line for line in lines) == 5
    assert sum("mean size" in line for line in lines) == 2
    assert sum("never trained" in line for line in lines) == 2
    assert all(line.startswith("Simulated: ") for line in lines[1:])


def test_a_folder_is_never_overwritten(analysis: FingerAnalysis, folder: Path) -> None:
    with pytest.raises(WrongUse, match="already exists"):
        write_finger_report(analysis, folder, "2030-01-01T00:00:00Z")


def test_data_sets_of_one_protocol_are_needed() -> None:
    with pytest.raises(WrongUse, match="needs a data set"):
        analyse_finger([], DrawSettings(1))


def test_numbers_are_written_as_ranges() -> None:
    assert k_ranges(np.array([], np.intp)) == "none"
    assert k_ranges(np.array([1, 2, 3, 7, 9, 10])) == "1–3, 7, 9–10"
