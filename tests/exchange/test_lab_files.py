"""Files as labs have them: odd headers, clocks, comments, decimals and encodings, each a case."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from unicodedata import normalize

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from rigctl.cli import main
from rigctl.errors import WrongUse
from rigctl.exchange.column_map import load_map
from rigctl.exchange.guess import guess_map
from rigctl.exchange.importer import import_files
from rigctl.exchange.inspection import Inspection
from rigctl.exchange.recording_files import find_recordings
from rigctl.exchange.text_table import TextFormat, read_text_table
from rigctl.session.session import Session
from tests.exchange.test_matlab import write_73

N_ROWS, N_TAXELS = 300, 4
ROW = np.arange(N_ROWS)
VALUES = np.round(500 + 80 * np.sin(ROW[:, None] / (5 + np.arange(N_TAXELS))), 3)
NAMES = [f"ch{k}" for k in range(N_TAXELS)]
NAME = "felt_20mms_1.csv"
UTC = "2026-11-27T12:00:00Z"


def lines(times: list[str] | None = None, delimiter: str = ",", end: str = "") -> list[str]:
    """Return the rows of the recording, each behind its time."""
    cells = [[f"{value:.3f}" for value in row] for row in VALUES]
    if times is not None:
        cells = [[at, *row] for at, row in zip(times, cells, strict=True)]
    return [delimiter.join(row) + end for row in cells]


def seconds(step_s: float = 0.001) -> list[str]:
    return [f"{k * step_s:.6f}" for k in ROW]


def clock(step_ms: int = 1, day: str = "", begin_s: int = 12 * 3600) -> list[str]:
    """Return times of day, of one millisecond or more."""
    stamps = begin_s * 1000 + ROW * step_ms
    ms = stamps % 86_400_000
    texts = [
        f"{t // 3_600_000:02}:{t // 60_000 % 60:02}:{t // 1000 % 60:02}.{t % 1000:03}" for t in ms
    ]
    return [f"{day} {text}" for text in texts] if day else texts


def written(folder: Path, rows: list[str], name: str = NAME, encoding: str = "utf-8") -> Path:
    path = folder / name
    path.write_bytes("\n".join([*rows, ""]).encode(encoding))
    return path


def header(time: str = "t", delimiter: str = ",") -> str:
    return delimiter.join([time, *NAMES])


def trailing_delimiter(folder: Path) -> Path:
    return written(folder, [header(), *lines(seconds(), end=",")])


def greek_mu(folder: Path) -> Path:
    """Write microseconds with U+03BC, the letter, where U+00B5 is the sign."""
    return written(folder, [header("time (\u03bcs)"), *lines([str(k * 1000) for k in ROW])])


def quoted_decimals(folder: Path) -> Path:
    rows = [row.split(",") for row in lines(seconds())]
    quoted = [",".join(f'"{cell.replace(".", ",")}"' for cell in row) for row in rows]
    return written(folder, [header(), *quoted])


def labview(folder: Path) -> Path:
    head = ["LabVIEW Measurement\t", "Separator\tTab", "X_Columns\tOne", "***End_of_Header***\t"]
    head += ["\t", f"Channels\t{N_TAXELS}\t\t\t\t", "\t".join(["Samples", *["300"] * N_TAXELS, ""])]
    head += ["***End_of_Header***\t\t\t\t\t", "\t".join(["X_Value", *NAMES, "Comment"])]
    return written(folder, [*head, *lines(seconds(), "\t")], "felt_20mms_1.lvm")


def comments(folder: Path) -> Path:
    rows = [header(), *lines(seconds())]
    rows[150:150] = ["# paused, by the user", "// and went on"]
    return written(folder, rows)


def footer(folder: Path) -> Path:
    return written(folder, [header(), *lines(seconds()), "", "finished", "all, is well"])


def times_of_day(folder: Path) -> Path:
    return written(folder, [header("Time"), *lines(clock())])


def midnight(folder: Path) -> Path:
    return written(folder, [header("Time"), *lines(clock(begin_s=86_400 - 1)[:])])


def date_times(folder: Path) -> Path:
    return written(folder, [header("timestamp"), *lines(clock(day="2026-10-27"))])


def german_date_times(folder: Path) -> Path:
    texts = [text.replace(".", ",") for text in clock()]
    rows = [row.replace(".", ",") for row in lines(None, ";")]
    stamped = [f"27.10.2026 {at};{row}" for at, row in zip(texts, rows, strict=True)]
    return written(folder, [header("Zeit", ";"), *stamped])


def datetime64(folder: Path) -> Path:
    path = folder / "felt_20mms_1.npz"
    np.savez(path, time=np.datetime64("2026-10-27T12:00:00", "ms") + ROW, ch=VALUES)
    return path


def matlab_days(folder: Path) -> Path:
    path = folder / "felt_20mms_1.mat"
    savemat(path, {"t": 739_000 + ROW[:, None] / 86_400_000, "ch": VALUES})
    return path


def spreadsheet_days(folder: Path) -> Path:
    return written(folder, [header("when"), *lines([f"{45_000 + k / 86.4e6:.11f}" for k in ROW])])


def bursts(folder: Path) -> Path:
    """Write ten rows 20 µs apart every 10 ms."""
    times = [f"{k // 10 * 0.01 + k % 10 * 2e-5:.6f}" for k in ROW]
    return written(folder, [header(), *lines(times)])


def one_stamp(folder: Path) -> Path:
    return written(folder, [header(), *lines([f"{k // 10 * 0.01:.3f}" for k in ROW])])


def coarse_clock(folder: Path) -> Path:
    """Write milliseconds of a clock that ticks every 16 ms, without a header."""
    return written(folder, lines([str(k // 16 * 16) for k in ROW]))


def utf_16(folder: Path) -> Path:
    return written(folder, [header(), *lines(seconds())], encoding="utf-16")


def byte_order_mark(folder: Path) -> Path:
    return written(folder, [header(), *lines(seconds())], encoding="utf-8-sig")


def pandas_index(folder: Path) -> Path:
    """Write the index and the column numbers that pandas gives a table without names."""
    counted = "," + ",".join(str(k) for k in range(N_TAXELS))
    return written(folder, [counted, *lines([str(k) for k in ROW])])


def pandas_columns(folder: Path) -> Path:
    return written(folder, [",".join(str(k) for k in range(N_TAXELS)), *lines()])


@pytest.mark.parametrize(
    "write",
    [
        *(trailing_delimiter, greek_mu, quoted_decimals, labview, comments, footer, times_of_day),
        *(midnight, date_times, german_date_times, datetime64, matlab_days, spreadsheet_days),
        *(bursts, one_stamp, coarse_clock, utf_16, byte_order_mark, pandas_index, pandas_columns),
    ],
    ids=lambda write: write.__name__,
)
def test_a_guess_reads_what_a_lab_has(tmp_path: Path, write: Callable[[Path], Path]) -> None:
    path = write(tmp_path)
    guessed = guess_map([path])
    assert guessed.problem == ""
    map_file = tmp_path / "map.toml"
    map_file.write_text(guessed.text, encoding="utf-8")
    inspection, _ = import_files([path], load_map(map_file), tmp_path / "session", UTC)
    with Session.open(tmp_path / "session") as session:
        counts = session.samples(0)
    stored = inspection.scaling.offset + inspection.scaling.scale * counts
    assert stored.shape[1] == N_TAXELS
    assert abs(len(stored) - N_ROWS) <= 10
    kept = min(len(stored), N_ROWS)
    np.testing.assert_allclose(stored[:kept], VALUES[:kept], atol=30)
    assert np.abs(stored[:kept] - VALUES[:kept]).mean() < 3


@pytest.mark.parametrize(
    ("write", "remark"),
    [
        (comments, "2 lines are comments: left out"),
        (footer, "2 lines at its end have no numbers: left out"),
        (pandas_columns, "its first row 0, 1, …, 3 counts the columns, so it is a header"),
    ],
    ids=lambda case: getattr(case, "__name__", ""),
)
def test_what_is_left_out_is_told(
    tmp_path: Path, write: Callable[[Path], Path], remark: str
) -> None:
    table = read_text_table(write(tmp_path), TextFormat(","))
    assert remark in "\n".join(table.remarks)
    assert table.values.shape[0] == N_ROWS


MAP = """
[files]
pattern = '^(?P<texture>.+?)_(?P<speed>\\d+)mms_(?P<repeat>\\d+)[.][^.]+$'
{files}
[time]
{time}
[taxels]
columns = [{columns}]
[labels]
speed_unit = "mm/s"
"""


def imported(
    folder: Path, path: Path, time: str, files: str = "", columns: str = '"ch0..ch3"'
) -> Inspection:
    map_file = folder / "map.toml"
    map_file.write_text(MAP.format(files=files, time=time, columns=columns), encoding="utf-8")
    return import_files([path], load_map(map_file), folder / "session", UTC)[0]


@pytest.mark.parametrize(
    ("write", "time", "words"),
    [
        (bursts, 'column = "t"', "1000 rows a second on average: give rate_hz = 1000 in [time]"),
        (one_stamp, 'column = "t"', "give rate_hz = 1000 in [time]"),
        (
            times_of_day,
            'column = "Time"\nunit = "ms"',
            "times of day, which are read as",
        ),
        (spreadsheet_days, 'column = "when"', "300 rows span"),
    ],
    ids=lambda case: getattr(case, "__name__", ""),
)
def test_a_map_with_the_wrong_time_stops(
    tmp_path: Path, write: Callable[[Path], Path], time: str, words: str
) -> None:
    with pytest.raises(WrongUse) as refused:
        imported(tmp_path, write(tmp_path), time)
    assert words in str(refused.value)
    assert not (tmp_path / "session").exists()


def test_a_map_reads_the_first_row_as_it_says(tmp_path: Path) -> None:
    path = pandas_columns(tmp_path)
    found = imported(tmp_path, path, "rate_hz = 1000", columns='"1..4"')
    assert "counts the columns" in found.remarks[0]
    assert found.trials[0].count == N_ROWS
    for folder, said, count in (("as", "true", N_ROWS), ("not", "false", N_ROWS + 1)):
        (tmp_path / folder).mkdir()
        found = imported(tmp_path / folder, path, "rate_hz = 1000", f"header = {said}", '"1..4"')
        assert (found.remarks, found.trials[0].count) == ((), count)


def test_the_index_of_a_table_is_told_where_a_map_takes_it_for_a_taxel(tmp_path: Path) -> None:
    found = imported(tmp_path, pandas_index(tmp_path), "rate_hz = 1000", columns='"1..5"')
    assert any("column 1 counts the rows, so it is no taxel" in line for line in found.remarks)


def test_a_clock_of_32_bits_goes_on_behind_its_overflow(tmp_path: Path) -> None:
    """An Arduino's micros() begins again after 71 minutes."""
    stamps = [str((2**32 - 150_000 + 1000 * k) % 2**32) for k in ROW]
    path = written(tmp_path, [header("micros"), *lines(stamps)])
    found = imported(tmp_path, path, 'column = "micros"\nunit = "us"')
    assert found.trials[0].count == N_ROWS
    assert any("begins again at 2³² 1 times" in line for line in found.remarks)


def test_a_stamp_that_is_no_time_of_day_is_named(tmp_path: Path) -> None:
    times = clock()
    times[7] = "noon"
    path = written(tmp_path, [header("Time"), *lines(times)])
    with pytest.raises(WrongUse, match="row 9, column Time: 'noon' is not a number"):
        imported(tmp_path, path, 'column = "Time"')


@pytest.mark.parametrize(
    ("encoding", "words"), [("utf-16-le", "save it as UTF-8"), ("cp1252", "save it as UTF-8")]
)
def test_another_encoding_is_refused_with_the_cure(
    tmp_path: Path, encoding: str, words: str
) -> None:
    path = written(tmp_path, [header("t µs"), *lines(seconds())], encoding=encoding)
    with pytest.raises(WrongUse, match=words):
        guess_map([path])


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_map_may_have_a_byte_order_mark(tmp_path: Path, encoding: str) -> None:
    path = trailing_delimiter(tmp_path)
    text = guess_map([path]).text
    (tmp_path / "map.toml").write_text(text, encoding=encoding)
    assert load_map(tmp_path / "map.toml").taxels == ("ch0..ch3",)
    (tmp_path / "map.toml").write_text(text, encoding="utf-16-le")
    with pytest.raises(WrongUse, match="is not UTF-8 text: save it as UTF-8"):
        load_map(tmp_path / "map.toml")


@pytest.mark.parametrize(
    ("kind", "cure"),
    [
        ("table", "S = table2struct(NAME, 'ToScalar', true)"),
        ("timetable", "S = table2struct(NAME, 'ToScalar', true)"),
        ("string", "save char(NAME) instead"),
        ("datetime", "save seconds(NAME - NAME(1)) instead"),
    ],
)
def test_what_only_matlab_reads_is_refused_with_the_line_that_helps(
    tmp_path: Path, kind: str, cure: str
) -> None:
    path = write_73(tmp_path / "felt_20mms_1.mat", {"data": np.arange(6, dtype=np.uint32)})

    with h5py.File(path, "r+") as file:
        file["data"].attrs["MATLAB_class"] = np.bytes_(kind)
        file["data"].attrs["MATLAB_object_decode"] = np.int32(3)
    with pytest.raises(WrongUse) as refused:
        imported(tmp_path, path, "rate_hz = 1000", columns='"data"')
    assert f"is a MATLAB {kind}, which only MATLAB reads" in str(refused.value)
    assert cure in str(refused.value)
    with pytest.raises(WrongUse, match=f"is a MATLAB {kind}"):
        guess_map([path])


def test_a_folder_of_two_layouts_tells_them_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for repeat in (1, 2, 3):
        written(tmp_path, [header(), *lines(seconds())], f"felt_20mms_{repeat}.csv")
    written(tmp_path, [header("ms"), *lines(seconds())], "silk_20mms_1.csv")
    assert main(["import", "--guess", str(tmp_path), "--map", str(tmp_path / "map.toml")]) == 2
    told = capsys.readouterr().err
    assert "3 with the columns t, ch0" in told and "such as felt_20mms_1.csv" in told
    assert "1 with the columns ms, ch0" in told and "such as silk_20mms_1.csv" in told
    assert "Guess a map for the files of each" in told


def test_a_texture_of_one_trial_is_left_out_of_an_analysis_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    random = np.random.default_rng(1)
    for texture, n_trials in (("felt", 12), ("cord", 2), ("silk", 1)):
        for repeat in range(1, n_trials + 1):
            values = VALUES + 200 * (texture == "cord") * (ROW[:, None] % 30 < 15)
            noise = random.normal(0, 5, values.shape)
            rows = [",".join(f"{cell:.3f}" for cell in row) for row in values + noise]
            written(tmp_path, [",".join(NAMES), *rows], f"{texture}_20mms_{repeat}.csv")
    files = sorted(tmp_path.glob("*.csv"))
    (tmp_path / "map.toml").write_text(
        MAP.format(files="", time="rate_hz = 1000", columns='"ch0..ch3"')
    )
    import_files(files, load_map(tmp_path / "map.toml"), tmp_path / "session", UTC)
    report = ["analyse", str(tmp_path / "session"), "--out", str(tmp_path / "report")]
    assert main([*report, "--iterations", "1"]) == 0
    told = capsys.readouterr().out
    assert "textures left out for too few trials to train and test with: silk" in told
    assert "Individual textures (1 components)" in told


def with_thousands(decimal: str) -> list[str]:
    """Return rows whose readings are grouped as people write them."""
    points = [f"{value * 1000:,.2f}" for value in VALUES[:, 0]]
    if decimal == ",":
        points = [text.translate(str.maketrans(",.", ".,")) for text in points]
        return [
            f"{at.replace('.', ',')};{text}" for at, text in zip(seconds(), points, strict=True)
        ]
    return [f"{at};{text}" for at, text in zip(seconds(), points, strict=True)]


def imported_by_guess(folder: Path, paths: list[Path], missing: str = "") -> Inspection:
    """Import by the guessed map, with the marks of missing values if there are any."""
    text = guess_map(paths).text
    map_file = folder / "map.toml"
    text = text.replace("[files]", f"[files]\nmissing = {missing}") if missing else text
    map_file.write_text(text, encoding="utf-8")
    return import_files(paths, load_map(map_file), folder / f"session{missing}", UTC)[0]


@pytest.mark.parametrize("decimal", [".", ","])
def test_separators_of_thousands_are_refused(tmp_path: Path, decimal: str) -> None:
    path = written(tmp_path, ["t;ch0", *with_thousands(decimal)])
    with pytest.raises(WrongUse, match="separators of thousands beside decimals"):
        guess_map([path])


def test_a_group_of_thousands_is_no_decimal(tmp_path: Path) -> None:
    path = written(tmp_path, ["t;ch0", "0;12,5", "1;1.234"])  # 1234 to who writes decimal commas
    with pytest.raises(WrongUse, match=r"row 3, column ch0: '1.234' has separators of thousands"):
        read_text_table(path, TextFormat(";", ","))


@pytest.mark.parametrize(
    ("content", "cure"),
    [
        (
            b"PK\x03\x04\x14\x00\x08\x08\xff",
            "an Excel workbook or a ZIP archive: save its sheet as CSV",
        ),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an Excel workbook: save its sheet as CSV"),
        (b"\x1f\x8b\x08\x08\xff\xff", "compressed by gzip: unpack it"),
    ],
)
def test_another_kind_of_file_is_named(tmp_path: Path, content: bytes, cure: str) -> None:
    (tmp_path / NAME).write_bytes(content)
    with pytest.raises(WrongUse, match=f"is {cure}"):
        guess_map([tmp_path / NAME])


def test_two_recordings_in_one_file_are_refused_where_the_header_stands_again(
    tmp_path: Path,
) -> None:
    rows = [header(), *lines(seconds())]
    with pytest.raises(WrongUse, match="row 302, column t: 't' is the header again"):
        guess_map([written(tmp_path, rows + rows)])


def test_a_column_of_times_that_stand_still_gives_no_rate(tmp_path: Path) -> None:
    """Seconds since 1970 in single precision move in steps of two minutes."""
    unix = np.float64(np.float32(1_764_200_000 + ROW / 1000))
    path = written(tmp_path, [header("time"), *lines([f"{at:.3f}" for at in unix])])
    guess = guess_map([path])
    assert "rate_hz = 0  # time is no clock: " in guess.text
    assert "rate_hz" in guess.problem


def test_the_same_letters_in_two_forms_are_one_texture(tmp_path: Path) -> None:
    rows = [header(), *lines(seconds())]
    forms = (normalize("NFC", "Gemäß"), normalize("NFD", "Gemäß"))
    paths = [written(tmp_path, rows, f"{name}_20mms_{k}.csv") for k, name in enumerate(forms, 1)]
    found = imported_by_guess(tmp_path, paths)
    assert {trial.label.texture for trial in found.trials} == {forms[0]}


def test_files_that_office_programs_leave_are_no_recordings(tmp_path: Path) -> None:
    path = written(tmp_path, [header(), *lines(seconds())])
    for name in (f"~${NAME}", f"._{NAME}", f".~lock.{NAME}#"):
        (tmp_path / name).write_bytes(b"\x05owner")
    assert find_recordings([tmp_path]).files == [path]


def test_a_mark_for_a_missing_value_is_told_and_left_out(tmp_path: Path) -> None:
    rows = lines(seconds())
    for row in range(100, 130):
        rows[row] = f"{row / 1000:.6f}" + ",-9999" * N_TAXELS
    path = written(tmp_path, [header(), *rows])
    found = imported_by_guess(tmp_path, [path])
    assert any("-9999 stands 120 times" in remark for remark in found.remarks)
    found = imported_by_guess(tmp_path, [path], missing="[-9999]")
    assert found.scaling.offset.min() > 400, "the mark stretched the range of a taxel"
    assert any("gap from 0.099 to 0.130 s" in remark for remark in found.remarks)
