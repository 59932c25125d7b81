"""NWB as recordings: exported sessions come back, a file that is none is refused."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np
import pytest
from pynwb import NWBHDF5IO, NWBFile, TimeSeries

from rigctl.errors import WrongUse
from rigctl.exchange.column_map import load_map
from rigctl.exchange.guess import guess_map
from rigctl.exchange.importer import import_files
from rigctl.exchange.nwb import read_nwb
from rigctl.session.session import Session
from tests.exchange.export.conftest import drum, nwb

__all__ = ["drum", "nwb"]
LABELS = ("texture", "speed_mm_s", "force_g", "repeat")


def import_guessed(file: Path, folder: Path) -> Path:
    """Import a file by the map that is guessed for it."""
    path = folder / "map.toml"
    path.write_text(guess_map([file]).text)
    import_files([file], load_map(path), folder / "back", "2026-01-02T03:04:05+00:00")
    return folder / "back"


def labels_of(session: Session) -> list[tuple[object, ...]]:
    return list(zip(*(session.trials[name].tolist() for name in LABELS), strict=True))


def test_an_exported_session_comes_back_to_the_bit(nwb: Path, drum: Path, tmp_path: Path) -> None:
    back = import_guessed(nwb, tmp_path)
    with Session.open(drum) as one, Session.open(back) as other:
        rows = {label: row for row, label in enumerate(labels_of(one))}
        assert sorted(labels_of(other)) == sorted(rows)
        for number, label in enumerate(labels_of(other)):
            assert np.array_equal(other.samples(number), one.samples(rows[label]))
        assert other.header.simulated


def empty_file() -> NWBFile:
    return NWBFile(
        session_description="by hand",
        identifier="1",
        session_start_time=datetime(2026, 1, 2, tzinfo=UTC),
    )


def write_nwb(path: Path, *series: TimeSeries) -> Path:
    """Write the file of another lab, with two trials of plain labels."""
    file = empty_file()
    for one in series:
        file.add_acquisition(one)
    file.add_trial_column(name="texture", description="what lies under the skin")
    file.add_trial(start_time=0.1, stop_time=0.3, texture="felt")
    file.add_trial(start_time=0.5, stop_time=0.8, texture="cork")
    with NWBHDF5IO(str(path), "w") as io:
        io.write(file)
    return path


def test_series_on_other_clocks_stand_beside_the_fastest(tmp_path: Path) -> None:
    skin = TimeSeries(name="skin", data=np.arange(2000).reshape(1000, 2), unit="V", rate=1000.0)
    slow_s = np.arange(0.0203, 1.0, 0.1)
    load = TimeSeries(name="load", data=np.arange(10.0), unit="N", timestamps=slow_s)
    found = read_nwb(write_nwb(tmp_path / "x.nwb", skin, load))
    assert found["trials.1.texture"] == "felt" and found["trials.2.texture"] == "cork"
    assert found["trials.1.skin"][:, 0].tolist() == list(range(200, 600, 2))
    assert found["trials.2.time"][[0, -1]] == pytest.approx([0.5, 0.799])
    load_g = found["trials.1.load"]
    assert np.flatnonzero(np.isfinite(load_g)).tolist() == [20, 120]
    assert load_g[[20, 120]].tolist() == [1.0, 2.0]


def test_a_file_without_trials_is_one(tmp_path: Path) -> None:
    file = empty_file()
    file.add_acquisition(TimeSeries(name="skin", data=np.arange(40.0), unit="V", rate=100.0))
    with NWBHDF5IO(str(tmp_path / "x.nwb"), "w") as io:
        io.write(file)
    found = read_nwb(tmp_path / "x.nwb")
    assert sorted(found) == ["skin", "time"] and found["time"][-1] == pytest.approx(0.39)


def test_what_is_no_recording_is_refused_in_a_sentence(tmp_path: Path) -> None:
    damaged, text = tmp_path / "damaged.nwb", tmp_path / "text.nwb"
    whole = write_nwb(
        tmp_path / "whole.nwb", TimeSeries(name="skin", data=np.zeros(9), unit="V", rate=1.0)
    )
    damaged.write_bytes(whole.read_bytes()[:3000])
    text.write_text(json.dumps({"no": "HDF5"}))
    for path in (damaged, text):
        with pytest.raises(WrongUse, match=f"{path.name} is not an NWB file, or is damaged"):
            read_nwb(path)
    with pytest.raises(WrongUse, match="no time series with numbers"):
        read_nwb(write_nwb(tmp_path / "empty.nwb"))


def test_data_in_another_file_are_not_read(tmp_path: Path) -> None:
    skin = TimeSeries(name="skin", data=np.zeros(9), unit="V", timestamps=np.arange(9.0))
    path = write_nwb(tmp_path / "x.nwb", skin)
    with h5py.File(path, "r+") as file:
        del file["acquisition/skin/timestamps"]
        file["acquisition/skin/timestamps"] = h5py.ExternalLink("/etc/passwd", "/x")
    with pytest.raises(WrongUse, match="link to another place"):
        read_nwb(path)


def test_a_rate_that_is_no_number_is_refused(tmp_path: Path) -> None:
    """A fuzzer gave one an imaginary part, of which NumPy only warned."""
    skin = TimeSeries(name="skin", data=np.zeros(9), unit="V", rate=1.0)
    path = write_nwb(tmp_path / "x.nwb", skin)
    with h5py.File(path, "r+") as file:
        file["acquisition/skin/starting_time"].attrs["rate"] = 1j
    with pytest.raises(WrongUse, match="starting_time or its rate is not a number"):
        read_nwb(path)
