"""Import of finger recordings: the session that comes of them, its analysis, and refusals."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rigctl.cli import main
from rigctl.finger.analysis.scans import ScanRecording, read_data_sets, read_scans
from rigctl.finger.session import FingerSession
from rigctl.finger.values import Stage
from tests.finger.analysis.made_scans import made_recordings

HEADER = "time_s," + ",".join(f"taxel_{n}" for n in range(1, 10))


ONE = made_recordings({Stage.TRAIN: 1}, 5, textures=("A",))[:1]


def write_list(folder: Path, scans: list[ScanRecording], motion: str = "velocity_mm_s") -> Path:
    """Write scans as tables with a list of them, as another program would."""
    folder.mkdir()
    lines = ["file,texture,stage,profile"]
    for number, one in enumerate(scans):
        n = len(one.readings)
        speed = np.repeat(one.velocities_um_per_s / 1000, 100)[:n]
        way = np.concatenate([[0.0], np.cumsum(speed)[:-1]]) / 1000
        values = speed if motion == "velocity_mm_s" else way
        table = np.column_stack([np.arange(n) / 1000, one.readings, values])
        name = f"scan-{number}.csv"
        np.savetxt(folder / name, table, "%.9g", ",", header=f"{HEADER},{motion}", comments="")
        lines.append(f"{name},{one.texture},{one.stage},{one.profile}")
    (folder / "list.csv").write_text("\n".join(lines) + "\n")
    return folder / "list.csv"


@pytest.mark.parametrize("motion", ["velocity_mm_s", "along_mm"])
def test_recordings_become_a_session_with_their_velocities(
    tmp_path: Path, motion: str, capsys: pytest.CaptureFixture[str]
) -> None:
    scans = made_recordings({Stage.NORMALISE: 1, Stage.TRAIN: 1}, 5, textures=("A", "B"))
    listed = write_list(tmp_path / "files", scans, motion)
    assert main(["realtime", "import", str(listed), "--out", str(tmp_path / "session")]) == 0
    assert "20 scans: 10 normalise, 10 train" in capsys.readouterr().out
    read = read_scans(tmp_path / "session")
    trained = [one for one in scans if one.stage is Stage.TRAIN]
    assert len(read.recordings) == len(trained) and not read.simulated
    for ours, theirs in zip(read.recordings, trained, strict=True):
        assert np.array_equal(ours.readings, theirs.readings)
        assert (ours.texture, ours.profile) == (theirs.texture, str(theirs.profile))
        np.testing.assert_allclose(ours.velocities_um_per_s, theirs.velocities_um_per_s, atol=600)
    normalised = np.concatenate([one.readings for one in scans if one.stage is Stage.NORMALISE])
    with FingerSession.open(tmp_path / "session") as session:
        ranges = session.normalisation(0)
    assert np.array_equal(ranges.low, normalised.min(axis=0))
    assert main(["verify", str(tmp_path / "session")]) == 0


def test_imported_sessions_are_analysed_as_recorded_ones(tmp_path: Path) -> None:
    stages = ({Stage.NORMALISE: 1, Stage.TRAIN: 2}, {Stage.CALIBRATE: 1, Stage.RUN: 1})
    for number, each in enumerate(stages):
        scans = made_recordings(each, 6 + number, contrast=0.015, textures=("A", "B", "D"))
        listed = write_list(tmp_path / f"files-{number}", scans)
        out = str(tmp_path / f"session-{number}")
        assert main(["realtime", "import", str(listed), "--out", out, "--sensor", "ours"]) == 0
    (one,) = read_data_sets([tmp_path / "session-0", tmp_path / "session-1"]).data_sets
    assert one.textures == ("A", "B", "D")
    assert (len(one.training), len(one.calibration), len(one.tested)) == (30, 15, 15)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("train", "trian", "line 2: stage 'trian' is none of normalise, train"),
        ("slow", "slwo", "line 2: profile 'slwo' is none of slow"),
        ("scan-0", "scan-9", "cannot be read as CSV"),
    ],
)
def test_a_mistake_in_the_list_is_named_with_its_line(
    tmp_path: Path, old: str, new: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    listed = write_list(
        tmp_path / "files", made_recordings({Stage.TRAIN: 1}, 5, textures=("A",))[:1]
    )
    listed.write_text(listed.read_text().replace(old, new))
    assert main(["realtime", "import", str(listed), "--out", str(tmp_path / "session")]) == 2
    assert sentence in capsys.readouterr().err and not (tmp_path / "session").exists()


@pytest.mark.parametrize(
    ("edit", "sentence"),
    [
        (lambda rows: [rows[0].replace("taxel_9", "taxel_X"), *rows[1:]], "no column taxel_9"),
        (lambda rows: [rows[0].replace("velocity_mm_s", "v"), *rows[1:]], "neither a column"),
        (lambda rows: [rows[0], *rows[2:40], *rows[600:]], "has a gap at 0.037 s"),
        (lambda rows: [rows[0], rows[2], rows[1], *rows[3:]], "times that rise"),
        (lambda rows: [rows[0], rows[1].replace(",", ",0.5,", 1).rsplit(",", 1)[0], *rows[2:]],
         "no whole numbers from 0 to 65535"),
        (lambda rows: [rows[0], rows[1] + "x", *rows[2:]], "no number"),
        (lambda rows: rows[:60], "less than 100 ms"),
    ],
)  # fmt: skip
def test_a_table_that_cannot_be_a_scan_is_refused_in_a_sentence(
    tmp_path: Path,
    edit: Callable[[list[str]], list[str]],
    sentence: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    listed = write_list(
        tmp_path / "files", made_recordings({Stage.TRAIN: 1}, 5, textures=("A",))[:1]
    )
    table = listed.parent / "scan-0.csv"
    rows = table.read_text().splitlines()
    table.write_text("\n".join(edit(rows)) + "\n")
    assert main(["realtime", "import", str(listed), "--out", str(tmp_path / "session")]) == 2
    assert sentence in capsys.readouterr().err and not (tmp_path / "session").exists()
