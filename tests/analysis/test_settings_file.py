"""Analysis files: what they set, what the paper's defaults are, and how mistakes are named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.analysis import published
from rigctl.analysis.settings import (
    AnalysisSettings,
    WindowSettings,
    as_plain,
    check_reference_force,
    differences_from_paper,
    load_settings,
    to_toml,
)
from rigctl.errors import ConfigError, WrongUse


def written(folder: Path, text: str) -> Path:
    file = folder / "analysis.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_an_empty_file_is_the_paper(tmp_path: Path) -> None:
    found = load_settings(written(tmp_path, ""))
    assert found == AnalysisSettings()
    assert differences_from_paper(found) == ()
    assert found.groups.group_of == published.GROUPS
    assert found.conditions.training_text == "40, 60, 80 mm/s and 250, 500 g"
    assert (found.folds.count, found.draws.count, found.draws.components) == (4, 20, 50)
    assert found.statistics.asterisks == (("**", 0.01, 1.0), ("*", 0.05, 0.5))
    assert found.statistics.proportion_asterisks == (("**", 0.01, 0.5), ("*", 0.05, 0.2))
    assert (found.windows.length_ms, found.windows.reference_speed_mm_s) == (100, 120.0)
    assert found.finger.draws == 100


def test_a_written_file_reads_back_and_explains_every_key(tmp_path: Path) -> None:
    ours = replace(AnalysisSettings(), windows=WindowSettings(50, 80.0, 0, 12))
    text = to_toml(ours)
    assert load_settings(written(tmp_path, text)) == ours
    assert "length_ms = 50 # ms: length, at the reference speed" in text
    assert differences_from_paper(ours) == (
        "settings other than the paper's: windows.length_ms 50 (paper: 100); "
        "windows.reference_speed_mm_s 80 (paper: 120); windows.speed_scaled 12 (paper: 0)",
    )


def test_groups_of_other_plates_replace_the_papers(tmp_path: Path) -> None:
    found = load_settings(
        written(tmp_path, '[groups]\nrough = ["x1", "x2"]\n"very fine" = ["y"]\n')
    )
    assert found.groups.group_of == {"x1": "rough", "x2": "rough", "y": "very fine"}
    assert found.groups.present(["y", "z"]) == ("very fine",)
    assert as_plain(found)["groups"] == {"rough": ["x1", "x2"], "very fine": ["y"]}
    assert "groups.smooth none (paper: A); " in differences_from_paper(found)[0]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "[conditions]\ntrained_speed = [2]",
            r"line 2: conditions.trained_speed: unknown key; did",
        ),
        ("[folds]\n\ncount = 1", "line 3: folds.count: 1 is outside 2 to 100"),
        (
            "[extrapolation]\ntrained_share = 75",
            "line 2: .*trained_share: 75 is outside 0.001 to 1",
        ),
        ("[windows]\nlength_ms = 0", "line 2: windows.length_ms: 0 is outside 1 to 60000"),
        ("[conditions]\nuntrained_forces_g = [500]", "line 2: .* 500 is trained too: name it once"),
        ('[groups]\na = ["A"]\nb = ["A"]', "line 3: groups.b: texture 'A' is in the group 'a' too"),
        (
            "[statistics]\none_star_p = 0.001",
            r"line 2: statistics.one_star_p: \*\* is easier to reach than \*: change two_star_p",
        ),
        ('[groups]\na = ["A"]', "line 1: groups: needs two groups or more"),
        (
            '[finger]\ntrained_profiles = ["slw"]',
            "line 2: finger.trained_profiles: 'slw' is none of",
        ),
        ("[fold]\ncount = 4", "line 1: fold: unknown key; did you mean 'folds'"),
    ],
)
def test_a_mistake_is_named_with_its_line(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=f"analysis.toml, {sentence}"):
        load_settings(written(tmp_path, text))


def test_a_reference_force_that_no_trial_has_is_named_with_its_line(tmp_path: Path) -> None:
    found = load_settings(written(tmp_path, "[conditions]\nreference_force_g = 700\n"))
    with pytest.raises(
        WrongUse, match=r"line 2: conditions.reference_force_g: no .* \(250, 500 g\)"
    ):
        check_reference_force(found, (250.0, 500.0))
    check_reference_force(found.with_reference_force(100.0), (250.0, 500.0))
    check_reference_force(AnalysisSettings(), (250.0,))
