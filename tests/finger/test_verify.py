"""``rigctl verify`` recomputes a finger's spikes and windows, and names each fault."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rigctl.cli import create_parser
from rigctl.cli import verify as command
from rigctl.finger.recorder import FingerRecorder
from rigctl.session.hdf5_file import write_attributes
from rigctl.session.verify import verify
from rigctl.values import Verdict
from tests.finger.finger_building import (
    PROTOCOL,
    RIG,
    SyntheticFinger,
    finger_trial_row,
    header,
    plan,
    recorder,
)
from tests.session.forging import rewrite_digests
from tests.session.spoiling import Spoil, set_row

FIRST = 30
"""Row of the first sample of a part's first scan, after the idle ones."""


@pytest.fixture
def recorded(finger: Path) -> Path:
    return finger


def test_a_complete_session_has_no_problem(
    finger: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["verify", str(finger)]
    assert command.run(create_parser(["verify"]).parse_args(words)) == 0
    assert "is whole: 8 trials committed, 3,976 samples, 0 lost" in capsys.readouterr().out


def add_to(path: str, at: Any, number: int) -> Spoil:
    def spoil(file: h5py.File) -> None:
        file[path][at] = file[path][at] + number

    return spoil


def drop_row(path: str, row: int) -> Spoil:
    def spoil(file: h5py.File) -> None:
        kept = np.delete(file[path][:], row)
        file[path].resize(len(kept), axis=0)
        file[path][:] = kept

    return spoil


def set_attribute(name: str, value: str | int) -> Spoil:
    def spoil(file: h5py.File) -> None:
        write_attributes(file, {name: value})

    return spoil


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (
            add_to("/taxels/spikes", (FIRST + 200, 4), 1),
            "trial 5, attempt 1: its spikes differ from the encoder's in 1 samples, first at "
            "counter 2218, taxel 5",
        ),
        (add_to("/taxels/samples", (FIRST + 120, 2), 90), "its spikes differ from the encoder's"),
        (set_attribute("taxel_low", str([45] * 9)), "its spikes differ from the encoder's"),
        (set_row("/windows", 3, spikes_2=99), "attempt 1: window 3 differs from the spikes and"),
        (set_row("/windows", 3, real_ms=1), "trial 5, attempt 1: window 3 differs from the"),
        (drop_row("/windows", 4), "trial 5, attempt 1: window 4 is not recorded"),
        (drop_row("/batches", 2), "trial 5, attempt 1: batch 2 is not recorded"),
        (drop_row("/batches", 4), "trial 5, attempt 1: batch 4 is not recorded"),
        (set_row("/batches", 1, velocity_um_s=200_000), "batch 2 does not begin where its"),
        (set_row("/batches", 4, samples=36), "its batches have 436 samples, its window 437"),
        (set_row("/batches", 2, samples=99), "a batch before its last one is short"),
        (set_row("/batches", 2, batch=1), "batch 2 is not recorded"),
        (
            set_attribute("reference_um_per_s", 50_000),
            "has another reference_um_per_s than the first part",
        ),
        (set_row("/trials", 0, first_counter=2017, first_sample=29), "is not the first of the"),
        (set_row("/trials", 0, scan=6), "scan 6 is that of 2 attempts"),
        (set_row("/trials", 0, texture="N"), "part-0002.h5: trial 5 is not in the plan"),
        (set_row("/trials", 0, profile="slow"), "part-0002.h5: trial 5 is not in the plan"),
        (set_row("/trials", 1, trial_id=5), "trial 5 is committed 2 times"),
        (set_row("/trials", 0, ended_s=-1), "it ended before it began"),
        (set_attribute("seed", 4), "has another seed than the first part"),
        (drop_row("/events", -1), "of /events were removed or altered, the table is shorter"),
    ],
)
def test_each_damage_is_named(session: Path, spoil: Spoil, words: str) -> None:
    with h5py.File(session / "part-0002.h5", "r+") as file:
        spoil(file)
    problems = verify(session).problems
    assert any(words in line for line in problems), problems


def record_scan(folder: Path, **losses: range) -> None:
    with recorder(folder) as rec, SyntheticFinger(rec) as finger:
        rec.begin_part("start")
        finger.trial(plan().trials[0], **losses)


@pytest.mark.parametrize("miss", [range(4), range(120, 127), range(433, 436)])
def test_samples_that_the_board_lost_have_no_spikes(tmp_path: Path, miss: range) -> None:
    record_scan(tmp_path / "s", miss=miss)
    report = verify(tmp_path / "s")
    assert report.problems == []
    assert report.lost_samples == len(miss)
    assert [line for line in report.notes if "trial 1" in line] == []
    with h5py.File(tmp_path / "s" / "part-0001.h5", "r+") as file:
        set_row("/windows", 0, spikes_1=60)(file)
    rewrite_digests(tmp_path / "s")
    assert "window 0 differs" in verify(tmp_path / "s").problems[0]


def test_samples_that_only_the_board_had_leave_the_rest_unproved(tmp_path: Path) -> None:
    record_scan(tmp_path / "s", lose=range(250, 253))
    report = verify(tmp_path / "s")
    assert report.whole
    assert report.lost_samples == 3
    assert any("from counter 230 on were lost between board and host" in n for n in report.notes)
    with h5py.File(tmp_path / "s" / "part-0001.h5", "r+") as file:
        add_to("/taxels/spikes", (FIRST + 100, 0), 1)(file)
    rewrite_digests(tmp_path / "s")
    assert "its spikes differ from the encoder's" in verify(tmp_path / "s").problems[0]


def test_rejected_scans_are_not_recomputed(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec, SyntheticFinger(rec) as finger:
        rec.begin_part("start")
        finger.trial(plan().trials[0], Verdict.REJECTED)
        rec.commit_trial(finger_trial_row(plan().trials[0], 0, -1, Verdict.ABORTED, 2))
    with h5py.File(tmp_path / "s" / "part-0001.h5", "r+") as file:
        drop_row("/batches", 2)(file)
    rewrite_digests(tmp_path / "s")
    report = verify(tmp_path / "s")
    assert report.whole
    assert "8 of 8 planned trials are not committed" in report.notes


def test_another_protocol_or_stage_is_found(tmp_path: Path) -> None:
    for name, changes in (("hash", {"plan_hash": "0" * 32}), ("stages", {"stages": ("train",)})):
        with FingerRecorder(tmp_path / name, replace(header(), **changes), PROTOCOL, RIG) as rec:
            rec.begin_part("start")
        problems = verify(tmp_path / name).problems
        assert problems == ["the plan hash does not match the session's protocol, stages and seed"]
    with FingerRecorder(tmp_path / "text", header(), "textures = 1", RIG) as rec:
        rec.begin_part("start")
    assert "the protocol in the session is not readable" in verify(tmp_path / "text").problems[0]
