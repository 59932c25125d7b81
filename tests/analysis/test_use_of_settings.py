"""What an analysis file changes: splits, groups, windows, the reference force and the report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.published import TASKS
from rigctl.analysis.settings import (
    AnalysisSettings,
    ConditionSettings,
    ExtrapolationSettings,
    FoldSettings,
    TextureGroups,
)
from rigctl.analysis.splits import extrapolation_fits, make_splits, textures_left_out
from rigctl.analysis.trial_set import Design
from rigctl.cli import main
from tests.analysis.recordings import record

GROUPS = next(task for task in TASKS if task.grouped)


def design(settings: AnalysisSettings, n: int = 4, textures: str = "ABX") -> Design:
    axes = np.meshgrid(np.arange(len(textures)), (20.0, 40.0, 90.0), (100.0, 300.0), indexing="ij")
    texture, speed, force = (np.repeat(axis.ravel(), n) for axis in axes)
    return Design(tuple(textures), texture.astype(np.int64), speed, force, settings)


def test_other_levels_are_trained_and_tested_by_name() -> None:
    conditions = ConditionSettings((20.0,), (100.0,), untrained_speeds_mm_s=(90.0,))
    half = ExtrapolationSettings(0.5, 1.0)
    ours = design(replace(AnalysisSettings(), conditions=conditions, extrapolation=half))
    assert not extrapolation_fits(design(AnalysisSettings())) and extrapolation_fits(ours)
    (fit,) = make_splits(ours, "extrapolation", 1, 0)
    assert set(ours.speed_mm_s[fit.train]) == {20.0} and len(fit.train) == 3 * 2
    assert set(ours.speed_mm_s[fit.tests["untrained-speed"]]) == {90.0}
    assert {key: len(rows) for key, rows in fit.tests.items()} == {
        "trained-both": 6, "untrained-speed": 12, "untrained-force": 12, "untrained-both": 12,
    }  # fmt: skip


def test_folds_and_drawn_share_are_those_of_the_file() -> None:
    ours = design(replace(AnalysisSettings(), folds=FoldSettings(3, 0.5)))
    folds = make_splits(ours, "folds", 1, 0)
    assert [len(fit.tests["textures"]) for fit in folds] == [12, 12, 12]


def test_a_texture_without_group_is_left_out_of_the_groups_only() -> None:
    groups = TextureGroups((("fine", ("A",)), ("coarse", ("B", "Q"))))
    ours = design(replace(AnalysisSettings(), groups=groups))
    assert ours.classes(GROUPS) == ("fine", "coarse") and ours.ungrouped == ("X",)
    for fit in make_splits(ours, "folds", 1, 0):
        assert set(ours.labels(GROUPS)[fit.tests["groups"]]) == {0, 1}
        assert set(ours.texture[fit.tests["textures"]]) == {0, 1, 2}


def test_a_texture_with_too_few_trials_costs_itself_only() -> None:
    whole = design(AnalysisSettings(), textures="ABG")
    keep = np.flatnonzero((whole.texture != 2) | (np.arange(len(whole.texture)) == 60))
    torn = Design(whole.textures, whole.texture[keep], whole.speed_mm_s[keep], whole.force_g[keep])
    assert textures_left_out(torn, "folds") == ("G",)
    drawn = np.concatenate([fit.tests["textures"] for fit in make_splits(torn, "folds", 1, 0)])
    assert set(torn.texture[drawn]) == {0, 1}
    trained = replace(AnalysisSettings(), conditions=ConditionSettings((20.0,), (100.0,)))
    extrapolated = replace(torn, settings=trained)
    assert textures_left_out(extrapolated, "extrapolation") == ("G",)
    (fit,) = make_splits(extrapolated, "extrapolation", 1, 0)
    tested = np.concatenate([fit.train, *fit.tests.values()])
    assert set(torn.texture[tested]) == {0, 1}


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("settings") / "session"
    return record(folder, "ABX", repeats=4, travel_mm=12.0, speeds=(40, 80), forces=(250, 500))


def analyse(session: Path, folder: Path, text: str, *options: str) -> tuple[int, Path]:
    file, out = folder / "analysis.toml", folder / "report"
    file.write_text(text, encoding="utf-8")
    words = ["analyse", str(session), "--out", str(out), "--settings", str(file), "--no-cache"]
    return main([*words, *options]), out


def test_a_report_keeps_the_settings_it_was_made_with(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = """\
[conditions]
trained_speeds_mm_s = [40]
trained_forces_g = [250]
reference_force_g = 250
[groups]
fine = ["A"]
coarse = ["B"]
[windows]
length_ms = 50
reference_speed_mm_s = 80
speed_scaled = 3
[draws]
count = 2
components = 3
"""
    code, out = analyse(session, tmp_path, text)
    assert code == 0
    results = json.loads((out / "results.json").read_text(encoding="utf-8"))
    settings = results["settings"]
    assert (settings["iterations"], settings["k_max"]) == (2, 3)
    assert settings["analysis"]["windows"]["length_ms"] == 50
    assert settings["analysis_file"] == str(tmp_path / "analysis.toml")
    windows = {"unscaled": 6, "speed_scaled": 3, "window_ms": 50, "reference_mm_s": 80.0}
    assert results["trials"]["windows"] == windows
    assert results["tasks"]["groups"]["classes"] == ["fine", "coarse"]
    assert "untrained-both" in results["tasks"]
    assert "at 250 g" in results["force_matrix"]["sentence"]
    shown = capsys.readouterr().out
    assert "; windows.length_ms 50 (paper: 100); " in shown
    assert "texture groups: textures left out for having no group: X" in shown
    assert "length_ms = 50" in (out / "analysis.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[window]\nlength_ms = 50\n", "line 1: window: unknown key; did you mean 'windows'?"),
        (
            "[conditions]\nreference_force_g = 700\n",
            "line 2: conditions.reference_force_g: no trial was made at 700 g",
        ),
    ],
)
def test_a_file_that_cannot_be_used_writes_nothing(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, sentence: str
) -> None:
    code, out = analyse(session, tmp_path, text)
    assert code == 2 and not out.exists() and not out.with_name("report.partial").exists()
    assert f"{tmp_path / 'analysis.toml'}, {sentence}" in capsys.readouterr().err
