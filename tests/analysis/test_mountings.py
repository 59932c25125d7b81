"""The task of mountings tells what a classifier learned of how a plate sat."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from rigctl.analysis.report.html_report import findings
from rigctl.analysis.representations import RepresentationSet, represent
from rigctl.analysis.result_tables import describe_mountings, table_rows
from rigctl.analysis.tasks import SweepSettings, run_tasks
from rigctl.analysis.trial_set import join_sessions
from rigctl.encoder.parameters import DEFAULT
from tests.analysis.recordings import record

KEYS = [
    "trained-mount",
    "leave-mount-out",
    "trained-mount-untrained-speed",
    "leave-mount-out-untrained-speed",
]
DRAWS = SweepSettings(iterations=2, k_max=8)


@pytest.fixture(scope="module")
def representations(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RepresentationSet]:
    """A set whose levels say which plate it is in which mounting, much more than the texture."""
    folder = tmp_path_factory.mktemp("set")
    session = record(
        folder / "session", "ABG", repeats=2, travel_mm=12.0, mounts=2, seat=0.06,
        speeds=(40, 60, 80, 120), forces=(250, 500, 1000),
    )  # fmt: skip
    yield represent(join_sessions([session]), DEFAULT, folder)


def test_plates_that_were_mounted_again_are_tested_beside_the_papers_tasks(
    representations: RepresentationSet,
) -> None:
    results, remarks = run_tasks(representations, DRAWS)
    assert [result.task.key for result in results[-4:]] == KEYS
    assert [result.task.figure[-1] for result in results[:6]] == list("ABCDEF")
    assert not [remark for remark in remarks if "mounting: left out" in remark]
    values = describe_mountings(results)
    assert len(values) == 2 * len(results[0].curves)
    assert values[0]["representation"] == "original"
    assert values[0]["same_mounting_percent"] > 90 and values[0]["points"] > 20
    assert values[0]["points"] == pytest.approx(
        values[0]["same_mounting_percent"] - values[0]["other_mounting_percent"]
    )
    assert values[0]["sd_points"] >= 0
    titles = [row["task"] for row in table_rows(results)]
    assert {"Same mounting", "Other mounting, untrained speed"} < set(titles)


def test_the_report_begins_with_what_the_mounting_adds(representations: RepresentationSet) -> None:
    results, _ = run_tasks(representations, SweepSettings(1, 4, tasks=("leave-mount-out",)))
    curves = {c.representation.key: {"mean": c.mean.tolist()} for c in results[0].curves}
    task = {
        "title": "Same mounting", "shown_components": 4, "chance": 1 / 3,
        "representations": curves, "order": None,
    }  # fmt: skip
    values = {"tasks": {"trained-mount": task}, "mountings": describe_mountings(results)}
    (sentence,) = (one for one in findings(values) if "mounted again" in one)
    assert "at untrained speeds" in sentence
    assert findings(values | {"mountings": []}) == [
        one for one in findings(values) if one != sentence
    ]


def test_sessions_are_mountings_where_the_task_is_requested(tmp_path: Path) -> None:
    folders = [
        record(tmp_path / name, "AB", repeats=2, travel_mm=12.0, seed=seed, forces=(500,))
        for name, seed in (("one", 1), ("two", 2))
    ]
    sets = represent(join_sessions(folders), DEFAULT, tmp_path)
    results, _ = run_tasks(sets, SweepSettings(1, 3, tasks=("leave-mount-out",)))
    assert [result.task.key for result in results] == KEYS[:2]
    by_default, _ = run_tasks(sets, SweepSettings(1, 3))
    assert not {result.task.key for result in by_default} & set(KEYS)
