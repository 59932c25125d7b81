"""Further analyses: what is offered, what a report has of each, and what is left out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from rigctl.analysis.further_analyses import ANALYSES
from rigctl.analysis.options import AnalysisOptions
from rigctl.analysis.report.report_folder import make_report
from rigctl.cli import main
from tests.analysis.recordings import record

WHEN = "2026-11-21T12:00:00Z"


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
    options = AnalysisOptions(
        (session,), out=out, iterations=2, k_max=4, also=(name,),
        settings=session.parent / "file.toml", **changed,
    )  # fmt: skip
    make_report(options, WHEN)
    results: dict[str, Any] = json.loads((out / "results.json").read_text(encoding="utf-8"))
    page = (out / "report.html").read_text(encoding="utf-8")
    for sentence in results["further"][name]["sentences"]:
        assert sentence.split(",")[0] in page
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
