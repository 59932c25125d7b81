"""``rigctl analyse`` end to end: the folder, its numbers, its page, and what it refuses."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from rigctl.analysis import published
from rigctl.analysis.comparisons import Agreement, compare_task, components_needed
from rigctl.analysis.report import report_folder
from rigctl.analysis.report.html_page import describe_p
from rigctl.analysis.representations import REPRESENTATIONS
from rigctl.analysis.tasks import Curve, TaskResult
from rigctl.cli import main
from rigctl.cli.progress import ProgressLine
from tests.analysis.recordings import record
from tests.analysis.report.chromium import CHROMIUM, ask_page

FILES = {
    "analysis.toml", "report.html", "results.json", "table1.csv", "unconverged_c.csv",
    "fig3.svg", "fig3.png", "confusion.svg", "confusion.png", "fig2c.svg", "fig2c.png", "fig2c.csv",
}  # fmt: skip


ASK_CHART = """
var refused = [];
addEventListener("securitypolicyviolation", function (e) { refused.push(e.violatedDirective); });
function send(at, names) {
  var x = at.x + at.width / 2, y = at.y + at.height / 2, to = document.elementFromPoint(x, y);
  names.forEach(function (name) {
    to.dispatchEvent(new PointerEvent(name, { bubbles: true, clientX: x, clientY: y }));
  });
}
var wait = setInterval(function () {
  var view = document.querySelector(".live .vega-embed svg");
  if (!view) return;
  clearInterval(wait);
  send(view.querySelectorAll(".role-legend-label text")[1].getBoundingClientRect(), ["click"]);
  setTimeout(function () {
    var faded = view.querySelectorAll('[opacity="0.08"]').length;
    send(view.querySelector(".role-mark").getBoundingClientRect(), ["pointerover", "pointermove"]);
    var over = document.querySelector("#vg-tooltip-element");
    answer({
      refused: refused, faded: faded, words: over.innerText,
      components: over.querySelector(".value").innerText,
      cell: document.querySelector(".matrices title").textContent,
      drawings: document.querySelectorAll("svg.marks").length
    });
  }, 500);
}, 100);
"""
"""Clicks on a curve's name, then points at the middle of the first panel."""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    yield record(
        tmp_path_factory.mktemp("analyse") / "session", "ABG", repeats=3, travel_mm=12.0,
        torn=(7,), speeds=(40, 60, 80, 120), forces=(250, 500, 1000),
    )  # fmt: skip


@pytest.fixture(scope="module")
def report(session: Path) -> Iterator[Path]:
    out = session.parent / "report"
    assert main(["analyse", str(session), "--out", str(out), "--iterations", "2"]) == 0
    yield out


def test_the_folder_holds_everything_and_nothing_else(report: Path) -> None:
    assert {path.name for path in report.iterdir()} == FILES
    assert not list(report.parent.glob("*.partial"))
    for svg in report.glob("*.svg"):
        text = " ".join(ElementTree.parse(svg).getroot().itertext())
        assert "Simulated bench" in text
        assert "nan" not in text.lower().split()


def test_numbers_agree_between_the_files(report: Path) -> None:
    def refuse(word: str) -> None:
        raise AssertionError(word)

    plain = json.loads((report / "results.json").read_text(), parse_constant=refuse)
    assert plain["simulated"] is True and plain["trials"]["used"] == 107
    assert plain["inputs"][0]["plan_hash"] and plain["settings"]["encoder"]["sa_gain"] == 100.0
    assert list(plain["tasks"]) == [task.key for task in published.TASKS[:6]]
    with (report / "table1.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6 * 8
    for row, entry in zip(rows, plain["table1"], strict=True):
        assert float(row["mean_percent"]) == entry["mean_percent"]
    first = plain["tasks"]["textures"]["representations"]["original"]
    k = plain["tasks"]["textures"]["shown_components"]
    assert float(rows[0]["mean_percent"]) == pytest.approx(
        100 * np.mean([a[k - 1] for a in first["accuracy"]])
    )
    assert (rows[0]["paper_mean_percent"], rows[0]["c_knows_the_label"]) == ("91.78", "no")
    assert rows[2]["c_knows_the_label"] == "yes"
    knows = {row["representation"]: row["scaling_knows"] for row in rows}
    assert knows["Force Scaled"] == "label, set force, speed" and knows["Divided"] == "nothing"
    tests = plain["curve_tests"]["untrained-both"]["speed"]
    assert len(tests["stars"]) == plain["tasks"]["untrained-both"]["k_max"]
    shown = plain["tasks"]["untrained-both"]["differences_from_original"]["speed"]
    k = plain["tasks"]["untrained-both"]["shown_components"]
    assert (shown["stars"], shown["rule"]) == (tests["stars"][k - 1], tests["rule"])
    assert (
        plain["tasks"]["untrained-both"]["confusion_shares"]["speed"]["paper"]["percent"] == 69.64
    )
    assert plain["force_matrix"]["paper"]["unconverged"] == 62
    with (report / "unconverged_c.csv").open() as file:
        entries = list(csv.DictReader(file))
    found = plain["force_matrix"]["unconverged_entries"]
    assert len(entries) == len(found) == plain["force_matrix"]["unconverged"] > 0
    for row, entry in zip(entries, found, strict=True):
        assert row["texture"] == entry["texture"] and int(row["taxel"]) == entry["taxel"]
        difference = float(row["rate_hz"]) - float(row["target_hz"])
        assert difference == pytest.approx(entry["difference_hz"], abs=2e-4)


def test_the_page_is_self_contained_and_has_the_results(report: Path) -> None:
    class Page(HTMLParser):
        sources: list[str] = []  # noqa: RUF012
        words = ""

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            self.sources += [v or "" for k, v in attrs if k in ("src", "href", "xlink:href")]

        def handle_data(self, data: str) -> None:
            self.words += data

    page = Page()
    page.feed((report / "report.html").read_text())
    formats = [source.partition(";base64,")[0] for source in page.sources]
    assert formats.count("data:image/svg+xml") == 1
    assert formats.count("data:image/png") == 3 * 4 * 3, "a raster for each condition"
    assert set(formats) == {"data:image/svg+xml", "data:image/png"}
    for words in (
        "Simulated.",
        "Trials classified right: individual textures",
        "differences between representations that the paper separates",
        "indexed by the true texture",
        "new to the classifier, but not to C",
        "(the paper: 1.4 %, 62 of 4,320)",
        "1 trial left out for gaps in their samples: 7",
        "98.85 ± 0.16",
        "differences that the paper separates hold",
        "not independent",
        "are our addition",
        "69.64 % of 16,000",
    ):
        assert words in page.words
    assert str(report.parent / "session") in page.words


def test_the_figures_say_what_asterisks_mean_and_show_the_captions(report: Path) -> None:
    text = (report / "fig3.svg").read_text("utf-8")
    quoted = 'd="M-4.183,0L0,-4.183L4.183,0L0,4.183Z"'
    assert text.count(quoted) == 6 * 4, "a diamond for each accuracy of Table 1"
    for words in ("p &lt; 0.05 and d &gt; 0.5", "our addition", "bars: standard deviation"):
        assert words in text
    text = (report / "confusion.svg").read_text("utf-8")
    assert "the paper's Fig. S2: 69.64 %" in text.replace("&#39;", "'")


@pytest.mark.skipif(CHROMIUM is None, reason="Debian's chromium is not installed")
def test_a_browser_shows_values_at_the_pointer_and_fades_the_other_curves(
    report: Path, tmp_path: Path
) -> None:
    page = tmp_path / "report.html"
    page.write_bytes((report / "report.html").read_bytes())
    found = ask_page(page, ASK_CHART)
    plain = json.loads((report / "results.json").read_text())
    curve = plain["tasks"]["textures"]["representations"]["original"]
    values = [
        f"{100 * mean:.2f} ± {100 * sd:.2f} %"
        for mean, sd in zip(curve["mean"], curve["sd"], strict=True)
    ]
    assert values[int(found["components"]) - 1] in found["words"]
    assert found["faded"] > 0 and found["refused"] == []
    assert found["cell"].endswith("%)") and found["drawings"] >= 6


def test_without_scripts_the_page_shows_every_figure(report: Path) -> None:
    text = (report / "report.html").read_text("utf-8")
    plots = text.split("<div class=plot>")[1:]
    assert [plot.startswith("<svg") for plot in plots] == [True]
    assert plots[0].count("chance") >= 6 and text.count("<div><svg") == 6 * 6


def test_several_reports_are_compared(
    report: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = json.loads((report / "results.json").read_text())
    assert set(plain["evidence"]["halves"]) == {r.key for r in REPRESENTATIONS[:8]}
    assert plain["evidence"]["alone"]["untrained-force"]["force"]["SA"] > 0
    words = (report / "report.html").read_text()
    assert "What explains the features" in words and "it does not prove a cause" in words

    def other(name: str, **changed: Any) -> str:
        (tmp_path / name).mkdir()
        second = {**plain, "inputs": [{**plain["inputs"][0], "seed": 77}], **changed}
        (tmp_path / name / "results.json").write_text(json.dumps(second))
        return str(tmp_path / name)

    again, out = other("again"), tmp_path / "orders"
    assert main(["orders", str(report), again, "--out", str(out)]) == 0
    assert "Untrained speed: of 6 comparisons" in capsys.readouterr().out
    found = json.loads((out / "orders.json").read_text())["tasks"]
    first = plain["tasks"]["textures"]["order"]["compared"][0]
    assert found["textures"]["pairs"][0]["points"] == [first["points"]] * 2
    assert found["textures"]["pairs"][0]["over_sets"] == [round(first["points"], 2), 0.0]
    assert found["textures"]["accuracy"]["original"]["paper"] == [91.78, 0.55]
    page = (out / "orders.html").read_text()
    assert "not the paper's experiment" in page and "cannot be told apart" in page
    assert "Each line is a set" in page and "Each line is a set" not in words
    for reports, message in (
        ([report, report], "hold the same session"),
        ([report, other("k", settings={**plain["settings"], "k_max": 7})], "another k_max"),
        ([report, other("old", evidence=None, tasks={})], "none of the tasks"),
        ([tmp_path], "cannot read"),
    ):
        assert main(["orders", *map(str, reports), "--out", str(tmp_path / "no")]) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def test_impossible_requests_are_refused_and_write_nothing(
    session: Path, report: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start = ["analyse", str(session), "--out"]
    for words, message in (
        ([str(report)], "already exists"),
        ([str(tmp_path / "r"), "--preset", "fast"], "unknown encoder preset 'fast'"),
        ([str(tmp_path / "r"), "--task", "colours"], "no task 'colours'"),
        ([str(tmp_path / "r"), "--iterations", "0"], "give a whole number from 1"),
    ):
        assert main([*start, *words]) == 2
        assert message in capsys.readouterr().err
    assert main(["analyse", str(tmp_path), "--out", str(tmp_path / "r")]) == 2
    assert list(tmp_path.iterdir()) == []


def test_an_interruption_leaves_no_partial_report(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(report_folder, "run_tasks", interrupt)
    assert main(["analyse", str(session), "--out", str(tmp_path / "r")]) == 130
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_reported(
    session: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(report_folder, "represent", full)
    assert main(["analyse", str(session), "--out", str(tmp_path / "r")]) == 3
    assert "free some space" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def result(**shares: list[float]) -> TaskResult:
    """A task-3C result; accuracies of two draws around each share, one component a share."""
    by_key = {r.key: r for r in REPRESENTATIONS}
    curves = tuple(
        Curve(by_key[key], np.add.outer([-0.001, 0.001], means),
              np.eye(16, dtype=np.int64), 800, 0, 0)
        for key, means in shares.items()
    )  # fmt: skip
    task = next(task for task in published.TASKS if task.key == "untrained-both")
    return TaskResult(task, tuple("ABCDEFGHIJKLMNOP"), 2, 7200, 1 / 16, curves)


def test_pairs_are_compared_where_the_paper_separates_them() -> None:
    found = compare_task(
        result(original=[0.2, 0.4], speed=[0.5, 0.7], force=[0.5, 0.75], speed_force=[0.6, 0.75]),
        simulated=True,
    )
    assert found is not None
    assert (len(found.pairs), len(found.keys(Agreement.HOLDS))) == (6, 4)
    assert found.keys(Agreement.REVERSED) == [("speed", "force")]
    assert found.keys(Agreement.TIED) == [("speed_force", "force")]
    assert "Reversed: Speed Scaled over Force Scaled" in found.sentence
    assert any("model" in reason for reason in found.caveats)


def test_a_p_of_zero_is_written_as_a_bound() -> None:
    shown = [describe_p(p) for p in (0.0, 0.031, 3e-9, None)]
    assert shown == ["< 1e-300", "0.03", "3e-09", "–"]


def test_components_needed_are_the_first_that_reach_it() -> None:
    needed = components_needed(result(original=[0.5, 0.85], speed=[0.86, 0.99]))
    assert needed["original"] == {"80%": 2, "90%": None, "95%": None, "as_original": 2}
    assert needed["speed"]["as_original"] == 1


def test_progress_shows_the_remaining_time(capsys: pytest.CaptureFixture[str]) -> None:
    import sys

    line = ProgressLine(sys.stderr)
    for done in range(3):
        line.show_stage("classifying", done, 2)
    assert capsys.readouterr().err.splitlines() == ["classifying: 0 of 2"]
