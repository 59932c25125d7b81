"""``rigctl encode``: the content of the file, the options, and interruptions."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rigctl.analysis.cache import Cache, Resources
from rigctl.analysis.encoded_sessions import encode_sessions
from rigctl.analysis.force_scaling import ScaledBy
from rigctl.analysis.spike_counts import c_per_trial
from rigctl.analysis.taxel import EncodeRequest
from rigctl.analysis.trial_set import join_sessions, open_trials
from rigctl.cli import main
from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.features import SPEED_SCALED, UNSCALED, trial_features
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, EncoderParameters, override, preset
from rigctl.encoder.reading import Reading, conductance, input_of_each
from rigctl.errors import WrongUse
from rigctl.session.analysis_file import load_force, load_ranges
from rigctl.session.header import IMPORTED
from rigctl.session.sensor_layout import SensorLayout
from rigctl.session.session import Session
from tests.analysis.recordings import record

WHEN = "2026-11-21T12:00:00Z"
CONDUCTANCE = replace(DEFAULT, reading=Reading.CONDUCTANCE)


@pytest.fixture(scope="module")
def days(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("days")
    sessions = [
        record(folder / "one", "AB", travel_mm=24.0, torn=(5,), repeats=2),
        record(folder / "two", "B", travel_mm=24.0, seed=4),
    ]
    for day in sessions:
        os.utime(day / "part-0001.h5", ns=(10**18, 10**18))  # older than the cache distrusts
    return sessions


def encode(days: list[Path], out: Path, **options: Any) -> h5py.File:
    request = EncodeRequest(tuple(days), **options)
    return h5py.File(encode_sessions(request, out, WHEN, Resources()).file)


def test_conductances_are_encoded_as_a_named_choice(days: list[Path], tmp_path: Path) -> None:
    trials = join_sessions(days).without_gaps()
    with open_trials(trials.files) as reader:
        counts = [reader.read(trial) for trial in trials.trials]
    with Session.open(days[0]) as session:
        inputs = input_of_each(session.wiring, 6, "")
    samples = [conductance(one, inputs) for one in counts]
    ranges = Normalisation.from_samples(samples, "", Reading.CONDUCTANCE)
    with encode(days, tmp_path / "out", parameters=CONDUCTANCE) as file:
        assert file["encoder/reading"][()].decode() == "conductance"
        assert np.array_equal(file["encoder/taxel_high"][:], ranges.high)
        ptr, sample = file["spikes/ptr"][:], file["spikes/sample"][:]
        rows = [row for _, row in SensorLayout.default(18).train_names()]
        for spikes, pointers in zip(encode_trials(samples, ranges, CONDUCTANCE), ptr, strict=True):
            for train, row in enumerate(rows):
                found = sample[pointers[train] : pointers[train + 1]]
                np.testing.assert_array_equal(found, spikes.train(row))
    with encode(days, tmp_path / "counts") as counted, h5py.File(file_of(tmp_path / "out")) as file:
        assert np.array_equal(counted["trials/content"][:], file["trials/content"][:])
        assert not np.array_equal(counted["spikes/ptr"][:], ptr)


def test_readings_are_not_mixed(days: list[Path], tmp_path: Path) -> None:
    with encode(days, tmp_path / "counts"):
        pass
    counts = file_of(tmp_path / "counts")
    ranges = load_ranges(counts)
    with pytest.raises(WrongUse, match="of counts, the encoder takes conductance"):
        encode(days, tmp_path / "mixed", parameters=CONDUCTANCE, ranges=ranges)
    with pytest.raises(WrongUse, match="its C was searched with reading = counts"):
        load_force(counts, Reading.CONDUCTANCE)
    assert not (tmp_path / "mixed").exists()


def test_a_session_whose_inputs_are_not_known_has_no_conductances(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = record(tmp_path / "imported", "AB", travel_mm=24.0, rig=IMPORTED)
    assert main(["encode", str(session), "--out", "x", "--reading", "conductance"]) == 2
    assert "does not say which taxels share an input" in capsys.readouterr().err


def file_of(folder: Path) -> Path:
    return folder / "spikes.h5"


@pytest.mark.parametrize("scaled_by", list(ScaledBy))
def test_spikes_windows_and_c_are_those_of_the_trials(
    days: list[Path], tmp_path: Path, scaled_by: ScaledBy
) -> None:
    trials = join_sessions(days)
    trials = trials.without_gaps()
    with open_trials(trials.files) as reader:
        samples = [reader.read(trial) for trial in trials.trials]
    ranges = Normalisation.from_samples(samples, "")
    with encode(days, tmp_path / "out", scaled_by=scaled_by) as file:
        force, _ = load_force(Path(file.filename), Reading.COUNTS)
        scale = None
        if scaled_by is not ScaledBy.NONE:
            scale = c_per_trial(trials.trials, force, blind=scaled_by is ScaledBy.BLIND)
        expected = encode_trials(samples, ranges, sa_scale=scale)
        ptr, sample = file["spikes/ptr"][:], file["spikes/sample"][:]
        assert ptr.dtype == np.int64 and sample.dtype == np.int32
        assert ptr[0, 0] == 0 and ptr[-1, -1] == len(sample)
        rows = [row for _, row in SensorLayout.default(18).train_names()]
        for trial, spikes, pointers in zip(trials.trials, expected, ptr, strict=True):
            for train, row in enumerate(rows):
                found = sample[pointers[train] : pointers[train + 1]]
                np.testing.assert_array_equal(found, spikes.train(row))
            windows = {"unscaled": UNSCALED, "speed_scaled": SPEED_SCALED}
            for name, layout in windows.items():
                given = json.loads(file[f"windows/{name}_layout"][()])
                layout = type(layout)(**given)
                i = trials.trials.index(trial)
                counts, seconds = (file[f"windows/{name}{end}"][i] for end in ("", "_s"))
                rates = np.divide(counts, seconds, out=np.zeros(counts.shape), where=seconds > 0)
                slow = np.array([row < 18 for row in rows])[:, None]
                vector = trial_features(spikes, trial.speed_mm_s, layout).reshape(36, -1)[rows]
                np.testing.assert_array_equal(np.where(slow, rates, counts), vector)


def test_the_file_describes_itself(days: list[Path], tmp_path: Path) -> None:
    with encode(days, tmp_path / "out") as file:
        names = [name.decode() for name in file["rows"]]
        assert names[:10] == [f"SAI-{i}" for i in range(1, 10)] + ["RAI-1"]
        assert names[18] == "SAII-10" and names[-1] == "RAII-18"
        speeds = np.repeat(
            file["trials/speed_mm_s"][:], np.diff(file["spikes/ptr"][:, [0, -1]])[:, 0]
        )
        scaled = file["spikes/sample"][:] * 1000 * speeds / 120
        np.testing.assert_allclose(file["spikes/scaled_us"][:], scaled, atol=0.5)
        trains = [file[f"train/{column}"][:] for column in ("receptor", "layer", "taxel")]
        said = [f"{r.decode()}{layer.decode()}-{n}" for r, layer, n in zip(*trains, strict=True)]
        assert said == names
        assert file.attrs["simulated"] == 1 and b"SIMULATED" in file["origin"][()]
        assert [source["seed"] for source in json.loads(file["inputs"][()])] == [3, 4]
        assert "gaps in their samples: 5" in file["remarks"][0].decode()
        parameters = {name: file[f"encoder/{name}"][()] for name in DEFAULT.as_dict()}
        assert parameters["sa_gain"] == 100.0 and parameters["name"] == b"default"
        assert set(file["c"]) >= {"c", "status", "evaluations", "residual_hz", "rate_hz"}
        assert len(file["trials/trial_id"]) == 12 * 2 + 6 - 1
        assert set(file["trials/mount"][:].tolist()) == {1}
        undescribed = []
        file.visititems(
            lambda name, node: (
                undescribed.append(name)
                if isinstance(node, h5py.Dataset) and not node.attrs.get("doc")
                else None
            )
        )
        assert undescribed == []


def test_a_second_run_takes_everything_from_the_cache(
    days: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["encode", *map(str, days), "--cache", str(tmp_path / "cache"), "--workers", "2"]
    for name in ("one", "two"):
        assert main([*words, "--out", str(tmp_path / name)]) == 0
        output = capsys.readouterr().out
    assert "0 of 9 tasks computed, 9 read from the cache" in output
    with h5py.File(tmp_path / "one/spikes.h5") as one, h5py.File(tmp_path / "two/spikes.h5") as two:
        np.testing.assert_array_equal(one["spikes/sample"][:], two["spikes/sample"][:])
    assert main([*words, "--out", str(tmp_path / "two")]) == 2
    assert "already exists" in capsys.readouterr().err


def test_an_interrupted_run_leaves_no_folder_and_can_be_continued(
    days: list[Path], tmp_path: Path
) -> None:
    def interrupt(stage: str, done: int, all_: int) -> None:
        if stage == "writing spikes":
            raise KeyboardInterrupt

    request = EncodeRequest(tuple(days))
    with pytest.raises(KeyboardInterrupt):
        resources = Resources(cache=Cache(tmp_path / "cache"), progress=interrupt)
        encode_sessions(request, tmp_path / "out", WHEN, resources)
    assert not (tmp_path / "out").exists() and not (tmp_path / "out.partial").exists()
    again = Cache(tmp_path / "cache")
    encode_sessions(request, tmp_path / "out", WHEN, Resources(cache=again))
    assert again.hits == 2 + 6 and (tmp_path / "out" / "spikes.h5").is_file()


def test_ranges_come_from_all_from_training_or_from_a_file(
    days: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["encode", str(days[0]), "--no-cache", "--out"]
    assert main([*words, str(tmp_path / "training"), "--ranges", "training"]) == 0
    assert "readings outside, which are clipped" in capsys.readouterr().out
    narrow = load_ranges(tmp_path / "training" / "spikes.h5")
    assert main([*words, str(tmp_path / "all")]) == 0
    wide = load_ranges(tmp_path / "all" / "spikes.h5")
    assert (wide.low <= narrow.low).all() and (wide.high > narrow.high).any()
    given = str(tmp_path / "training" / "spikes.h5")
    assert main([*words, str(tmp_path / "given"), "--ranges", given]) == 0
    with h5py.File(given) as one, h5py.File(tmp_path / "given" / "spikes.h5") as two:
        np.testing.assert_array_equal(one["spikes/sample"][:], two["spikes/sample"][:])
    capsys.readouterr()
    assert main([*words, str(tmp_path / "no"), "--ranges", str(days[0] / "part-0001.h5")]) == 2
    assert "not a model or a spikes.h5: --ranges takes" in capsys.readouterr().err


def test_one_layer_is_not_split_into_types(tmp_path: Path) -> None:
    layout = SensorLayout(3, 6, ("skin",))
    session = record(tmp_path / "s", "A", travel_mm=12.0, forces=(250,), layout=layout)
    with encode([session], tmp_path / "out") as file:
        names = [name.decode() for name in file["rows"]]
        assert names == [f"{channel}-{n}" for channel in ("SA", "RA") for n in range(1, 19)]
        assert json.loads(file["sensor_layout"][()]) == {
            "rows": 3, "columns": 6, "layers": ["skin"],
        }  # fmt: skip


def test_a_taxel_is_drawn_and_tabulated(days: list[Path], tmp_path: Path) -> None:
    words = ["encode", str(days[0]), "--no-cache", "--out", str(tmp_path / "out")]
    assert main([*words, "--trial", "3", "--taxel", "7"]) == 0
    assert {f.name for f in (tmp_path / "out").iterdir()} == {
        "spikes.h5", "taxel.svg", "taxel.png", "taxel.csv"
    }  # fmt: skip
    table = np.loadtxt(tmp_path / "out" / "taxel.csv", delimiter=",", skiprows=2)
    with h5py.File(tmp_path / "out" / "spikes.h5") as file:
        i = file["trials/trial_id"][:].tolist().index(3)
        names = file["rows"][:].tolist()
        for column, name in ((9, b"SAI-7"), (10, b"RAI-7")):
            train = file["spikes/ptr"][i, names.index(name) :][:2]
            assert table[:, column].sum() == train[1] - train[0]


def test_without_the_reference_force_there_are_spikes_and_no_c(tmp_path: Path) -> None:
    session = record(tmp_path / "session", "A", travel_mm=12.0, forces=(250, 1000))
    with encode([session], tmp_path / "out") as file:
        assert "c" not in file and len(file["spikes/sample"]) > 0
        assert any("reference force of 500 g" in remark.decode() for remark in file["remarks"])
    with pytest.raises(WrongUse, match="--scaled-by blind needs C"):
        encode([session], tmp_path / "none", scaled_by=ScaledBy.BLIND)


def test_depths_have_a_c_for_the_middle_one(tmp_path: Path) -> None:
    session = record(tmp_path / "session", "A", travel_mm=12.0, depths_mm=(0.5, 1.0, 1.5))
    encode([session], tmp_path / "out", scaled_by=ScaledBy.TEXTURE).close()
    force, _ = load_force(tmp_path / "out" / "spikes.h5", Reading.COUNTS)
    assert (force.reference_g, force.forces_g) == (1.0, (0.5, 1.0, 1.5))


def test_every_parameter_can_be_set() -> None:
    ours = override(preset("explicit"), ["sa_gain=120", "substeps=8", "clamp_v=true"])
    assert (ours.sa_gain, ours.substeps, ours.clamp_v) == (120.0, 8, True)
    assert ours.recovery == preset("explicit").recovery
    assert ours.name == "explicit, sa_gain=120.0, substeps=8, clamp_v=True"
    for name, value in DEFAULT.as_dict().items():
        if name != "name":
            text = str(value).lower() if isinstance(value, bool) else str(value)
            assert isinstance(override(DEFAULT, [f"{name}={text}"]), EncoderParameters)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("gain=3", "give name=value with one of a, b"),
        ("sa_gain", "give name=value"),
        ("sa_gain=loud", "give a number"),
        ("substeps=2.5", "give a whole number"),
        ("clamp_v=perhaps", "give true or false"),
        ("recovery=never", "give one of"),
        ("sa_gain=nan", "give a finite number"),
    ],
)
def test_a_wrong_parameter_is_refused_with_a_reason(setting: str, words: str) -> None:
    with pytest.raises(WrongUse, match=words):
        override(DEFAULT, [setting])


def test_an_analysis_file_sets_windows_ranges_and_the_reference_force(
    days: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "analysis.toml"
    file.write_text(
        "[conditions]\ntrained_speeds_mm_s = [40]\ntrained_forces_g = [250]\n"
        "reference_force_g = 250\n[windows]\nlength_ms = 50\nreference_speed_mm_s = 80\n"
    )
    words = ["encode", str(days[0]), "--no-cache", "--settings", str(file), "--ranges", "training"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    assert "over the trials at 40 mm/s and 250 g" in capsys.readouterr().out
    with h5py.File(file_of(tmp_path / "out")) as spikes:
        assert spikes["c/reference_g"][()] == 250
        layout = json.loads(spikes["windows/speed_scaled_layout"][()])
        assert (layout["window_ms"], layout["reference_mm_s"], layout["n_windows"]) == (50, 80.0, 6)
    file.write_text("[conditions]\nreference_force_g = 333\n")
    assert main([*words, "--out", str(tmp_path / "none")]) == 2
    assert "line 2: conditions.reference_force_g: no trial was made at 333 g" in (
        capsys.readouterr().err
    )
    assert not (tmp_path / "none").exists()
