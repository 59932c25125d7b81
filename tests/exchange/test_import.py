"""Imported recordings: every format, every label, and a report of every defect."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.io import savemat

from rigctl import __version__
from rigctl.analysis.trial_set import join_sessions
from rigctl.cli import main
from rigctl.config.resources import source_commit
from rigctl.encoder.normalisation import Normalisation
from rigctl.errors import ConfigError, DiskFault, SessionError, WrongUse
from rigctl.exchange.column_map import load_map
from rigctl.exchange.importer import FILE, import_files
from rigctl.exchange.inspection import Inspection
from rigctl.session.session import Session
from rigctl.session.verify import verify
from rigctl.session.writer import RecorderStatus

PATTERN = r"""
[files]
pattern = '(?P<texture>[a-z]+)_(?P<speed>-?\d+)cm_(?P<force>[\d.]+)N_(?P<repeat>\d+)'

[labels]
speed_unit = "cm/s"
force_unit = "N"
"""
TIMED = PATTERN + '[time]\ncolumn = "t"\nunit = "ms"\n[taxels]\ncolumns = ["a..c"]\n'
RATED = PATTERN + '[time]\nrate_hz = 1000\n[taxels]\ncolumns = ["1..3"]\n'


def run_import(
    folder: Path, text: str, files: Sequence[Path], out: str = "session"
) -> tuple[Path, Inspection]:
    path = folder / "map.toml"
    path.write_text(text)
    session = folder / out
    inspection, whole = import_files(files, load_map(path), session, "2026-01-02T03:04:05+00:00")
    assert whole
    return session, inspection


def write_csv(
    path: Path, time_ms: NDArray[np.float64], columns: NDArray[np.float64], end: str = ""
) -> Path:
    rows = [",".join(f"{value:g}" for value in row) for row in np.c_[time_ms, columns]]
    path.write_text("\n".join(["t, a, b, c", *rows]) + end)
    return path


def ramp(n: int, step: float = 1.0) -> NDArray[np.float64]:
    return np.arange(n)[:, None] * step + np.array([0.0, 100.0, 200.0])


def test_rows_between_milliseconds_are_interpolated_linearly(tmp_path: Path) -> None:
    time_ms = 5000.0 + np.arange(101) * 10.0
    file = write_csv(tmp_path / "cotton_-5cm_2.5N_3.csv", time_ms, ramp(101))
    folder, inspection = run_import(tmp_path, TIMED, [file])
    assert verify(folder).problems == []
    with Session.open(folder) as session:
        row = session.trial_row(0).trial
        assert (row.texture, row.speed_mm_s, row.direction, row.repeat) == (
            *("cotton", 50.0, "backward"),
            3,
        )
        assert row.force_g == pytest.approx(254.93, abs=0.01)
        header = session.header
        assert (header.simulated, header.rig) == (False, "import")
        assert (header.software_version, header.software_commit) == (__version__, source_commit())
        samples = session.samples(0)
        assert samples.shape == (1001, 3)
        scaling = [event.data for event in session.events if event.kind == "scaling"]
        assert [entry["name"] for entry in scaling] == ["a", "b", "c"]
        restored = np.array([s["offset"] for s in scaling]) + samples * np.array(
            [s["scale"] for s in scaling]
        )
        expected = np.arange(1001)[:, None] / 10 + np.array([0.0, 100.0, 200.0])
        np.testing.assert_allclose(restored, expected, atol=0.001)
        remarks = [event.text for event in session.events if event.kind == "import"]
        assert tuple(remarks) == inspection.remarks
    assert (folder / "import.toml").read_text() == TIMED


def test_every_format_gives_the_same_samples(tmp_path: Path) -> None:
    table = np.random.Generator(np.random.Philox(1)).integers(0, 1024, (300, 3))
    files = {name: tmp_path / f"silk_6cm_5N_1.{name}" for name in ("npy", "npz", "mat", "tsv")}
    np.save(files["npy"], table)
    np.savez(files["npz"], table)
    savemat(files["mat"], {"table": table})
    np.savetxt(files["tsv"], table, fmt="%d", delimiter="\t")
    new = tmp_path / "new"
    new.mkdir()
    files["v73"] = new / "silk_6cm_5N_1.mat"
    with h5py.File(files["v73"], "w", userblock_size=512) as file:
        file["table"] = table.T
    for name, path in files.items():
        folder, inspection = run_import(tmp_path, RATED, [path], name)
        assert inspection.remarks == ()
        with Session.open(folder) as session:
            assert np.array_equal(session.samples(0), table), name


def test_several_trials_in_a_file_are_not_taken_for_one(tmp_path: Path) -> None:
    time_ms = np.tile(np.arange(100.0), 2)
    file = write_csv(tmp_path / "silk_6cm_5N_1.csv", time_ms, ramp(200))
    with pytest.raises(WrongUse, match=r"time runs backwards before 99 of 200 rows, first row 102"):
        run_import(tmp_path, TIMED, [file])
    assert not (tmp_path / "session").exists()


def test_defects_of_time_are_reported_and_gaps_are_not_interpolated(tmp_path: Path) -> None:
    time_ms = np.arange(200.0)
    time_ms[20] = time_ms[19]
    time_ms[30:33] -= 15.0
    time_ms[100:] += 50.0
    columns = ramp(200)
    columns[150, 1] = 9000.0
    file = write_csv(tmp_path / "silk_6cm_5N_1.csv", time_ms, columns, "\n250,1")
    folder, inspection = run_import(tmp_path, TIMED, [file])
    remarks = "\n".join(inspection.remarks)
    assert "time runs backwards before 3 rows, first row 32" in remarks
    assert "1 rows repeat a time stamp, first row 22" in remarks
    assert "gap from 0.099 to 0.150 s" in remarks
    assert "outliers from 0.200 s on, kept: b 1" in remarks
    assert "is incomplete" in remarks
    report = verify(folder)
    assert report.problems == []
    assert report.lost_samples == 53
    with Session.open(folder) as session:
        window = session.window(0)
        assert not window.complete
        assert [(gap.first_counter, gap.count) for gap in window.gaps] == [(30, 3), (100, 50)]


def test_rows_with_empty_cells_are_skipped(tmp_path: Path) -> None:
    columns = ramp(50)
    columns[7, 0] = np.nan
    file = write_csv(tmp_path / "silk_6cm_5N_1.csv", np.arange(50.0), columns)
    _, inspection = run_import(tmp_path, TIMED, [file])
    assert inspection.remarks[0].endswith("1 rows lack a value, the first is row 9: left out")


@pytest.mark.parametrize(
    ("old", "new"),
    [("\n", ",\n"), ("\n", "\n\n"), ("\n", "\r\n"), (",", " , "), (",", "§")],
    ids=["delimiter at the end", "empty lines", "Windows", "spaces", "no ASCII"],
)
def test_other_forms_of_a_table_are_read_alike(tmp_path: Path, old: str, new: str) -> None:
    path = write_csv(tmp_path / "silk_6cm_5N_1.csv", np.arange(50.0), ramp(50))
    head, _, rows = path.read_text().partition("\n")
    divided = head.replace(",", "§") if new == "§" else head
    path.write_text(f"{divided}\n{rows.replace(old, new)}", newline="")
    text = TIMED.replace("[files]\n", '[files]\ndelimiter = "§"\n') if new == "§" else TIMED
    folder, inspection = run_import(tmp_path, text, [path])
    assert inspection.remarks == ()
    with Session.open(folder) as session:
        np.testing.assert_array_equal(session.samples(0), ramp(50))


def test_a_gap_at_a_block_edge_is_a_gap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigctl.exchange.importer.BLOCK_ROWS", 100)
    time_ms = np.arange(300.0)
    time_ms[200:] += 40.0
    file = write_csv(tmp_path / "silk_6cm_5N_1.csv", time_ms, ramp(300))
    folder, _ = run_import(tmp_path, TIMED, [file])
    report = verify(folder)
    assert (report.problems, report.lost_samples) == ([], 40)


def fast_csv(path: Path, hertz: float) -> Path:
    """Write half a second at 8 kHz: a slow wave, and a fast one that aliases at 1 kHz."""
    time_ms = np.arange(4000) / 8
    wave = 500 + 200 * np.sin(2 * np.pi * 20 * time_ms / 1000)
    fine = 200 * np.sin(2 * np.pi * hertz * time_ms / 1000)
    return write_csv(path, time_ms, np.stack([wave, wave + fine, fine], axis=1))


def spectrum(session: Path) -> NDArray[np.float64]:
    """Return the amplitude spectrum without the trial's ends, file's units, float64 (250, 3)."""
    with Session.open(session) as opened:
        samples = opened.samples(0)[:500].astype(float)
        data = [event.data for event in opened.events if event.kind == "scaling"]
    values = samples * np.array([entry["scale"] for entry in data])
    return 2 * np.abs(np.fft.rfft(values, axis=0))[:250] / len(values)


def test_rows_faster_than_1_khz_are_low_pass_filtered(tmp_path: Path) -> None:
    file = fast_csv(tmp_path / "silk_6cm_5N_1.csv", 900)  # would alias to 100 Hz
    kept, inspection = run_import(tmp_path, TIMED, [file], "kept")
    assert "taken at 1 kHz behind a low-pass of 400 Hz" in inspection.remarks[-1]
    filtered = spectrum(kept)
    assert filtered[10, 0] == pytest.approx(200, rel=0.02)  # 20 Hz passes; a line is 2 Hz
    assert filtered[50, 1] < 1.0
    raw, inspection = run_import(tmp_path, TIMED + "[quality]\nlow_pass_hz = 0\n", [file], "raw")
    assert "without a filter, as the map says" in inspection.remarks[-1]
    assert spectrum(raw)[50, 1] == pytest.approx(200, rel=0.05)
    slow = write_csv(tmp_path / "silk_6cm_5N_2.csv", np.arange(100.0), ramp(100))
    assert run_import(tmp_path, TIMED, [slow], "slow")[1].remarks == ()


def test_a_filter_stops_at_gaps(tmp_path: Path) -> None:
    time_ms = np.arange(2000) / 4
    time_ms[1000:] += 100
    step = np.where(np.arange(2000) < 1000, 0.0, 1000.0)[:, None] * np.ones(3)
    file = write_csv(tmp_path / "silk_6cm_5N_1.csv", time_ms, step)
    folder, _ = run_import(tmp_path, TIMED, [file])
    with Session.open(folder) as session:
        samples = session.samples(0)
    assert set(np.unique(samples)) == {0, 65535}


def test_the_session_stores_the_unit_of_a_reading(tmp_path: Path) -> None:
    text = TIMED.replace('columns = ["a..c"]', 'columns = ["a..c"]\nunit = "mV"')
    plain = write_csv(tmp_path / "silk_6cm_5N_1.csv", np.arange(50.0), ramp(50))
    scaled = write_csv(tmp_path / "silk_6cm_5N_2.csv", np.arange(50.0), ramp(50) / 7)
    for name, file, unit in (
        ("plain", plain, "mV, 0–65535"),
        ("scaled", scaled, "0–65535 from each taxel's lowest to its highest value; scaling events "
         "turn it into mV"),
    ):  # fmt: skip
        folder, _ = run_import(tmp_path, text, [file], name)
        with Session.open(folder) as session:
            assert session.header.sample_unit == unit
            assert session.parts[0].dataset_attributes()["/taxels/samples"]["unit"] == unit
            full = Normalisation.full_scale(3, session.header.highest_reading)
            assert full.count_clipped(session.samples(0)).sum() == 0 and "0–65535" in full.source


def test_separate_imports_are_combined_only_with_the_same_scale(tmp_path: Path) -> None:
    apart, alike = [], []
    for number in (1, 2):
        values = ramp(50) / 7 * number
        file = write_csv(tmp_path / f"silk_6cm_5N_{number}.csv", np.arange(50.0), values)
        apart.append(run_import(tmp_path, TIMED, [file], f"apart{number}")[0])
        text = TIMED.replace("[taxels]\n", "[taxels]\nlow = -10\nhigh = 40\n")
        folder, inspection = run_import(tmp_path, text, [file], f"alike{number}")
        alike.append(folder)
        remarks = "\n".join(inspection.remarks)
        assert ("c leaves the range -10 to 40: clipped" in remarks) == (number == 2)
        with Session.open(folder) as session:
            stored, scaling = session.samples(0), session.scaling
        assert scaling == ((-10.0, 50 / 65535),) * 3
        restored = -10 + stored * (50 / 65535)
        np.testing.assert_allclose(restored, np.minimum(values, 40), atol=0.001)
    with pytest.raises(
        SessionError, match=r"apart2 stores readings on another scale than .*apart1"
    ):
        join_sessions(apart)
    assert len(join_sessions(alike).trials) == 2


def test_sampling_too_slow_for_the_texture_is_reported(tmp_path: Path) -> None:
    file = write_csv(tmp_path / "silk_10cm_5N_1.csv", np.arange(100) * 28.0, ramp(100))
    _, inspection = run_import(tmp_path, TIMED, [file])
    assert "100 mm/s: 35.7 Hz shows nothing finer than 5.6 mm" in inspection.remarks[-1]


def test_load_cell_and_extra_channels_are_imported(tmp_path: Path) -> None:
    n = 400
    table = np.c_[np.arange(n) * 2.0, ramp(n), np.full(n, 2.0), np.linspace(0, 1, n)]
    path = tmp_path / "silk_6cm_5N_1.csv"
    header = "t,a,b,c,load,heat"
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    text = TIMED + '[loadcell]\ncolumn = "load"\nunit = "N"\n[extra]\ncolumns = ["heat"]\n'
    other = tmp_path / "silk_6cm_5N_2.csv"
    other.write_text(path.read_text())
    folder, _ = run_import(tmp_path, text, [path, other])
    assert verify(folder).problems == []
    with Session.open(folder) as session:
        for index in (0, 1):
            drum = session.drum(index)
            assert len(drum.loadcell) == n
            assert drum.loadcell_s[[0, -1]] == pytest.approx([0.0, 0.798])
            assert drum.loadcell["force_g"].mean() == pytest.approx(203.94, abs=0.01)
        rows = session.n_samples
    with h5py.File(folder / FILE) as file:
        assert list(file.attrs["names"]) == ["heat"]
        assert file["values"].shape == (rows, 1)


def test_files_without_a_number_are_numbered_and_sorted_by_condition(tmp_path: Path) -> None:
    text = (
        "[files]\npattern = '(?P<texture>[a-z])'\n[labels]\nspeed_mm_s = 20\n"
        '[time]\nrate_hz = 500\n[taxels]\ncolumns = ["1", "3"]\n'
    )
    files = []
    for name in ("b1", "a1", "b2"):
        files.append(tmp_path / f"{name}.npy")
        np.save(files[-1], ramp(40))
    folder, _ = run_import(tmp_path, text, files)
    with Session.open(folder) as session:
        rows = [session.trial_row(k).trial for k in range(3)]
        assert [(row.texture, row.repeat) for row in rows] == [("a", 1), ("b", 1), ("b", 2)]
        assert session.samples(0).shape == (79, 2)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"a..c"', '"a..d"', "no column 'd'"),
        (r"(?P<speed>-?\d+)cm", r"(?P<speed>[a-z]+)", "does not match the pattern"),
        ("?P<repeat>", "?P<count>", "groups are texture, speed, force, repeat"),
        ("(?P<texture>", "(?P<texture>(", "not a regular expression"),
        ('unit = "ms"', 'unit = "min"', "must be one of s, ms, us, ns"),
        ('column = "t"', "rate_hz = 0", "either a time column, or rate_hz"),
        ("[taxels]", "[taxel]", "taxel"),
    ],
)
def test_a_wrong_map_raises_one_sentence(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = write_csv(tmp_path / "silk_6cm_5N_1.csv", np.arange(9.0), ramp(9))
    with pytest.raises((WrongUse, ConfigError), match=message.replace("?", r"\?")):
        run_import(tmp_path, TIMED.replace(old, new), [file])
    assert not (tmp_path / "session").exists()


def test_wrong_files_raise_one_sentence_and_nothing_is_written(tmp_path: Path) -> None:
    good = "silk_6cm_5N_1"
    cases: dict[str, tuple[Path, str]] = {}
    for name in ("word", "short", "empty", "binary", "cube", "struct", "broken", "gone", "odd"):
        (tmp_path / name).mkdir()
    (tmp_path / "word" / f"{good}.csv").write_text("t,a,b,c\n1,2,3,x\n")
    cases["word"] = tmp_path / "word" / f"{good}.csv", "row 2, column c: 'x' is not a number"
    (tmp_path / "short" / f"{good}.csv").write_text("t,a,b,c\n1,2\n2,3,4,5\n3,4,5,6\n")
    cases["short"] = tmp_path / "short" / f"{good}.csv", "row 2: has 2 cells"
    (tmp_path / "empty" / f"{good}.csv").write_text("")
    cases["empty"] = tmp_path / "empty" / f"{good}.csv", "is empty"
    (tmp_path / "binary" / f"{good}.csv").write_bytes(b"\xff\xfe\x00")
    cases["binary"] = tmp_path / "binary" / f"{good}.csv", "not a text table"
    savemat(tmp_path / "cube" / f"{good}.mat", {"x": np.zeros((3, 3, 3))})
    cases["cube"] = tmp_path / "cube" / f"{good}.mat", "x is 3 × 3 × 3"
    savemat(tmp_path / "struct" / f"{good}.mat", {"x": {"y": "text"}})
    cases["struct"] = tmp_path / "struct" / f"{good}.mat", "not columns|no plain numbers|no column"
    (tmp_path / "broken" / f"{good}.npy").write_bytes(b"\x93NUMPY")
    cases["broken"] = tmp_path / "broken" / f"{good}.npy", "is damaged"
    cases["gone"] = tmp_path / "gone" / f"{good}.csv", "cannot read"
    cases["odd"] = tmp_path / "odd" / f"{good}.xlsx", "can be imported end in"
    for path, message in cases.values():
        with pytest.raises(WrongUse, match=message):
            run_import(tmp_path, TIMED, [path])
    assert not (tmp_path / "session").exists()


def test_files_with_another_number_of_taxels_are_refused(tmp_path: Path) -> None:
    files = []
    for number, width in ((1, 3), (2, 4)):
        files.append(tmp_path / f"silk_6cm_5N_{number}.npy")
        np.save(files[-1], np.zeros((20, width)))
    text = RATED.replace('"1..3"', '"1", "2", "3"')
    run_import(tmp_path, text, files)
    named = PATTERN + '[time]\nrate_hz = 1000\n[taxels]\ncolumns = ["4"]\n'
    with pytest.raises(WrongUse, match="no column '4'"):
        run_import(tmp_path, named, files, "other")


def test_the_command_prints_its_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write_csv(tmp_path / "silk_10cm_5N_1.csv", np.arange(100) * 28.0, ramp(100))
    (tmp_path / "map.toml").write_text(TIMED)
    words = ["import", "--map", str(tmp_path / "map.toml"), str(file), "--out"]
    assert main([*words, str(tmp_path / "one")]) == 0
    captured = capsys.readouterr()
    assert "1 trials of 3 taxels" in captured.out
    assert "sampled too slowly" in captured.err
    assert main([*words, str(tmp_path / "two"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["trials"] == 1
    assert main([*words, str(tmp_path / "one")]) == 2
    assert "one" in capsys.readouterr().err


def test_a_second_import_into_a_session_names_what_import_can_do(tmp_path: Path) -> None:
    file = write_csv(tmp_path / "cotton_-5cm_2.5N_3.csv", np.arange(50.0), ramp(50))
    run_import(tmp_path, TIMED, [file])
    with pytest.raises(WrongUse, match=r"already holds a session: name a new folder with --out"):
        run_import(tmp_path, TIMED, [file])


def test_a_disk_that_fails_during_an_import_names_what_import_can_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = write_csv(tmp_path / "cotton_-5cm_2.5N_3.csv", np.arange(50.0), ramp(50))
    reason = "the disk is full: make room, then resume the session"
    failed = RecorderStatus(1, 0, 0, 0, failure=reason)
    monkeypatch.setattr("rigctl.session.recorder.Recorder.status", property(lambda self: failed))
    with pytest.raises(DiskFault, match="make room, then import into another new folder"):
        run_import(tmp_path, TIMED, [file])
