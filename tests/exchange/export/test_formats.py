"""Each format gives back what the session holds, to the bit, and says that it is simulated."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import mat73
import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pynwb
import pytest

from rigctl.analysis.cache import SERIAL_RESOURCES
from rigctl.analysis.encoded_sessions import encode_sessions
from rigctl.analysis.taxel import EncodeRequest
from rigctl.encoder.parameters import DEFAULT
from rigctl.errors import SessionError
from rigctl.exchange.export.content import Content, joined
from rigctl.exchange.export.selection import Representation, Selection
from rigctl.finger.session import FingerSession
from rigctl.session.session import Session, open_session
from tests.exchange.export.conftest import INSTALLED, export, needs_nix
from tests.session.building import record_by_hand


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    with pynwb.NWBHDF5IO(str(path), "r") as io:
        yield io.read()


def all_samples(path: Path) -> Any:
    with open_session(path) as session:
        return np.concatenate([p.read("/taxels/samples", 0, p.n_samples) for p in session.parts])


def spikes_of_encode(session: Path, out: Path) -> list[np.ndarray]:
    """Return the spikes of ``rigctl encode`` in each trial, unit by unit, in samples."""
    encode_sessions(EncodeRequest((session,), DEFAULT), out, "2026-01-01", SERIAL_RESOURCES)
    with h5py.File(out / "spikes.h5") as file:
        ends, samples = file["/spikes/ptr"][:], file["/spikes/sample"][:]
    return [samples[a:b] for row in ends for a, b in pairwise(row)]


@pytest.mark.parametrize("to", INSTALLED)
def test_a_session_without_trials_has_its_readings(to: str, tmp_path: Path) -> None:
    record_by_hand(tmp_path / "by-hand")
    target = tmp_path / {"nwb": "x.nwb", "matlab": "x.mat", "neo": "x.nix"}.get(to, "x")
    with pytest.raises(SessionError, match=r"has no trials.*\(--representations readings\)"):
        export(tmp_path / "by-hand", to, target)
    export(tmp_path / "by-hand", to, target, Selection(representations=(Representation.READINGS,)))
    if to == "nwb":
        assert pynwb.validate(path=str(target)) == []
        with opened(target) as file:
            readings = file.acquisition["taxels"].data[:]
            assert np.array_equal(readings, all_samples(tmp_path / "by-hand"))
            assert len(file.trials) == 0
    assert target.exists()


def test_nwb_is_valid_and_holds_the_samples_on_a_rate(nwb: Path, drum: Path) -> None:
    assert pynwb.validate(path=str(nwb)) == []
    with opened(nwb) as file:
        taxels = file.acquisition["taxels"]
        assert np.array_equal(taxels.data[:], all_samples(drum))
        assert file.acquisition["force"].unit == "newtons"
        assert {"surface_speed", "drum_angle", "drum_state"} <= set(file.acquisition)
        assert "SIMULATED" in file.session_description and "simulated" in file.keywords


def test_nwb_has_the_trials_where_the_reader_cuts_them(nwb: Path, drum: Path) -> None:
    with opened(nwb) as file, Session.open(drum) as session:
        trials, taxels = file.trials.to_dataframe(), file.acquisition["taxels"]
        assert trials["texture"].tolist() == session.trials["texture"].tolist()
        for index, trial in enumerate(trials.itertuples()):
            times = np.array([trial.start_time, trial.stop_time])
            if taxels.rate is not None:
                first, end = np.rint((times - taxels.starting_time) * taxels.rate).astype(int)
            else:
                first, end = np.searchsorted(taxels.timestamps[:], times - 1e-6)
            assert np.array_equal(taxels.data[first:end], session.samples(index))


def test_nwb_units_are_the_trains_of_encode(nwb: Path, drum: Path, tmp_path: Path) -> None:
    wanted = spikes_of_encode(drum, tmp_path / "encoded")
    with opened(nwb) as file:
        units = file.units
        assert len(units) == 36 and units["unit_name"][0] == "SAI-1"
        assert units["receptor"][35] == "RA" and units["layer"][35] == "II"
        assert units["taxel"].data[35] == 17 and units["encoder"][0] == "default"
        starts_s = file.trials["start_time"][:]
        for unit in range(36):
            windows = zip(starts_s, file.trials["stop_time"][:], strict=True)
            times_s = units["spike_times"][unit]
            for trial, (start_s, stop_s) in enumerate(windows):
                own = times_s[(times_s > start_s - 1e-6) & (times_s < stop_s - 1e-6)]
                samples = np.rint((own - start_s) * 1000).astype(int)
                assert np.array_equal(samples, wanted[trial * 36 + unit])


def test_nwb_of_the_finger_has_the_spikes_of_its_board(finger: Path, tmp_path: Path) -> None:
    target = export(finger, "nwb", tmp_path / "finger.nwb").target
    assert pynwb.validate(path=str(target)) == []
    with opened(target) as file, FingerSession.open(finger) as session:
        n = sum(int(p.read("/taxels/spikes", 0, p.n_samples).sum()) for p in session.parts)
        assert len(file.units) == 9
        assert sum(len(file.units["spike_times"][unit]) for unit in range(9)) == n
        assert np.array_equal(file.acquisition["taxels"].data[:], all_samples(finger))
        assert len(file.processing["misc"]["batches"]) > 0


@pytest.mark.parametrize("to", ["parquet", "csv"])
def test_tables_hold_every_row(to: str, drum: Path, tmp_path: Path) -> None:
    folder = export(drum, to, tmp_path / "tables").target
    read = pyarrow.parquet.read_table if to == "parquet" else pyarrow.csv.read_csv
    samples = read(folder / f"samples.{to}")
    readings = np.stack([samples[f"I{'I' * (n > 9)}-{n}"].to_numpy() for n in range(1, 19)], axis=1)
    assert np.array_equal(readings, all_samples(drum))
    assert all(samples["simulated"].to_pylist())
    assert json.loads((folder / "about.json").read_text())["data"] == "SIMULATED data"
    with Session.open(drum) as session:
        content = Content(session, Selection())
        for series in (content.trials, *content.tables):
            table, rows = read(folder / f"{series.name}.{to}"), joined(series)
            for column in series.columns:
                if not column.is_text:
                    found = table[column.name].to_numpy().astype(np.float64)
                    wanted = rows[column.name].astype(np.float64)
                    assert np.array_equal(found, wanted, equal_nan=True)


def test_matlab_holds_structures_of_columns(drum: Path, tmp_path: Path) -> None:
    data = mat73.loadmat(str(export(drum, "matlab", tmp_path / "drum.mat").target))
    assert data["about"]["data"] == "SIMULATED data"
    assert np.array_equal(data["samples"]["readings"], all_samples(drum))
    n = int(data["trials"]["n_rows"])
    letters = data["trials"]["texture"]  # mat73 gives a character matrix column by column
    with Session.open(drum) as session:
        textures = [letters[row::n].rstrip() for row in range(n)]
        assert textures == session.trials["texture"].tolist()
        assert np.array_equal(data["trials"]["count"], session.trials["count"])
    assert data["gaps"]["n_rows"] == 0 and list(data["gaps"]) == ["n_rows"]


@needs_nix
def test_neo_has_signals_trains_and_epochs(drum: Path, tmp_path: Path) -> None:
    from neo.io import NixIO

    io = NixIO(str(export(drum, "neo", tmp_path / "drum.nix").target), "ro")
    blocks = io.read_all_blocks()
    io.close()
    (segment,) = blocks[0].segments
    signals = [*segment.analogsignals, *segment.irregularlysampledsignals]
    taxels = next(signal for signal in signals if signal.name == "taxels")
    assert np.array_equal(taxels.magnitude, all_samples(drum))
    assert {"drum", "loadcell"} <= {signal.name for signal in signals}
    assert len(segment.spiketrains) == 36
    assert blocks[0].annotations["data"] == "SIMULATED data"
    with Session.open(drum) as session:
        assert len(segment.epochs[0]) == len(session.trials)


def test_counts_are_the_spikes_of_their_trials(drum: Path, tmp_path: Path) -> None:
    folder = export(drum, "parquet", tmp_path / "tables").target
    spikes = pyarrow.parquet.read_table(folder / "spikes.parquet")
    for name in ("counts_unscaled", "counts_speed_scaled"):
        counts = pyarrow.parquet.read_table(folder / f"{name}.parquet").to_pandas()
        totals = counts.drop(columns=["trial_id", "simulated"]).sum(axis=1)
        by_trial = spikes.to_pandas().groupby("trial_id").size()
        for trial, total in zip(counts["trial_id"], totals, strict=True):
            assert total == by_trial.get(trial, 0)


def test_a_selection_has_its_trials_and_taxels_only(drum: Path, tmp_path: Path) -> None:
    chosen = Selection(frozenset({2, 3}), frozenset({1, 12}), (Representation.READINGS,))
    folder = export(drum, "parquet", tmp_path / "tables", chosen).target
    samples = pyarrow.parquet.read_table(folder / "samples.parquet")
    assert not (folder / "spikes.parquet").exists()
    with Session.open(drum) as session:
        rows = [i for i, t in enumerate(session.trials["trial_id"]) if t in (2, 3)]
        wanted = np.concatenate([session.samples(i) for i in rows])[:, [0, 11]]
    found = np.stack([samples["I-1"].to_numpy(), samples["II-12"].to_numpy()], axis=1)
    assert np.array_equal(found, wanted)
    assert pyarrow.parquet.read_table(folder / "trials.parquet")["trial_id"].to_pylist() == [2, 3]
