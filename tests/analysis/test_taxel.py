"""One taxel of one trial: its signals, figure, table and movie, and ``rigctl encode`` for them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text
from PIL import Image

from rigctl.analysis.movies import FRAME_S, HOLD_S, Movie
from rigctl.analysis.taxel import (
    COLUMNS,
    Section,
    TaxelCourse,
    load_course,
    taxel_movie,
    write_course,
    write_taxel_figure,
    write_taxel_movie,
)
from rigctl.analysis.trial_set import TrialSet, join_sessions, open_trials
from rigctl.cli import main
from rigctl.encoder.encoder import encode_trial
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, preset
from rigctl.errors import WrongUse
from tests.analysis.recordings import record

TRIAL, TAXEL = 3, 7
SECTION = Section(0.05, 0.15)
MOVIE_S = 0.4


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("taxel") / "day", "AL", travel_mm=24.0, torn=(5,))


@pytest.fixture(scope="module")
def trials(session: Path) -> TrialSet:
    return join_sessions([session]).without_gaps()


@pytest.fixture(scope="module")
def ranges(trials: TrialSet) -> Normalisation:
    with open_trials(trials.files) as reader:
        samples = [reader.read(trial) for trial in trials.trials]
    return Normalisation.from_samples(samples, "")


@pytest.fixture(scope="module")
def course(trials: TrialSet, ranges: Normalisation) -> TaxelCourse:
    return load_course(trials, ranges, DEFAULT, TRIAL, TAXEL)


def texts_of(movie: Movie) -> list[str]:
    return [t.get_text() for t in movie.figure.findobj(Text) if isinstance(t, Text)]


def test_the_signals_lead_to_the_trials_own_spikes(
    trials: TrialSet, ranges: Normalisation, course: TaxelCourse
) -> None:
    trial = next(t for t in trials.trials if t.trial_id == TRIAL)
    with open_trials(trials.files) as reader:
        spikes = encode_trial(reader.read(trial), ranges)
    for channel, row in enumerate((TAXEL - 1, 18 + TAXEL - 1)):
        np.testing.assert_array_equal(course.spikes[channel], spikes.train(row))
        fired = np.flatnonzero(course.membrane_mv[:, channel] >= DEFAULT.threshold_mv)
        np.testing.assert_array_equal(fired, np.unique(course.spikes[channel]))
    np.testing.assert_allclose(course.current[:, 0], 100 * course.reading)
    np.testing.assert_allclose(course.current[:, 1], 3 * course.derivative)
    change = np.diff(course.low_passed, prepend=course.low_passed[0])
    np.testing.assert_allclose(course.derivative, 1000 * change, atol=1e-9)
    assert course.low_passed[0] == pytest.approx(course.reading[0])
    assert course.derivative_unit == "1/s" and "layer I, row 3, column 1" in course.words


def test_c_multiplies_the_sa_current_alone(
    trials: TrialSet, ranges: Normalisation, course: TaxelCourse
) -> None:
    c = np.full((len(trials.trials), trials.n_taxels), 1.5)
    scaled = load_course(trials, ranges, DEFAULT, TRIAL, TAXEL, c)
    np.testing.assert_allclose(scaled.current[:, 0], 1.5 * course.current[:, 0])
    np.testing.assert_array_equal(scaled.current[:, 1], course.current[:, 1])
    assert len(scaled.spikes[0]) > len(course.spikes[0])
    assert "C = 1.5" in scaled.words and "without C" in course.words


def test_a_derivative_per_sample_says_so(trials: TrialSet, ranges: Normalisation) -> None:
    course = load_course(trials, ranges, preset("ra-per-sample"), TRIAL, TAXEL)
    assert course.derivative_unit == "1/sample"
    np.testing.assert_allclose(course.current[:, 1], 3 * course.derivative)


def test_the_table_has_every_signal_and_its_units(course: TaxelCourse, tmp_path: Path) -> None:
    write_course(course, tmp_path / "taxel.csv")
    comment, names = (tmp_path / "taxel.csv").read_text(encoding="utf-8").splitlines()[:2]
    assert "Simulated bench" in comment and "currents mV/ms" in comment and "1/s" in comment
    assert tuple(names.split(",")) == COLUMNS
    table = np.loadtxt(tmp_path / "taxel.csv", delimiter=",", skiprows=2)
    np.testing.assert_allclose(table[:, 5], 100 * table[:, 2], atol=1e-3)
    assert table[:, 9].sum() == len(course.spikes[0])


def test_the_figure_names_every_signal_with_its_unit(course: TaxelCourse, tmp_path: Path) -> None:
    write_taxel_figure(course, SECTION, tmp_path / "taxel.svg")
    drawn = (tmp_path / "taxel.svg").read_text(encoding="utf-8")
    for text in ("low-passed, for RA", "derivative", "(1/s)", "SA current", "(mV/ms)", "RA v(t)",
                 "(mV)", "time since the trial window opened (s)", "Simulated bench"):  # fmt: skip
        assert text in drawn
    write_taxel_figure(course, SECTION, tmp_path / "again.svg")
    assert (tmp_path / "again.svg").read_text(encoding="utf-8") == drawn


def test_the_signals_grow_from_frame_to_frame(course: TaxelCourse) -> None:
    movie = taxel_movie(course, SECTION, MOVIE_S)
    reading = movie.figure.axes[0].lines[0]
    lengths = []
    for number in range(movie.n_frames):
        movie.set_frame(number)
        lengths.append(len(np.asarray(reading.get_xdata())))
    assert lengths[0] == 1 and lengths[-1] == 100 and lengths == sorted(set(lengths))
    texts = texts_of(movie)
    assert "SIMULATED" in texts and "0.150 s" in texts
    assert any("plays 4 times slower than real time" in text for text in texts)


def test_scaled_spikes_grow_with_those_that_they_are_of(course: TaxelCourse) -> None:
    assert course.time_scale == pytest.approx(120 / 120)
    movie = taxel_movie(replace(course, time_scale=0.4), SECTION, MOVIE_S)
    for number in (0, movie.n_frames // 2, movie.n_frames - 1):
        movie.set_frame(number)
        for channel, row in enumerate((4, 7)):
            plain = np.asarray(movie.figure.axes[row].lines[0].get_xdata())
            scaled = np.asarray(movie.figure.axes[8].lines[channel].get_xdata())
            start_s = SECTION.start_s
            np.testing.assert_allclose(scaled, start_s + 0.4 * (plain - start_s))
    assert any("scaled\n(× 0.4)" in text for text in texts_of(movie))


def test_a_real_recording_is_not_called_simulated(course: TaxelCourse) -> None:
    assert "SIMULATED" not in texts_of(taxel_movie(replace(course, simulated=False), SECTION))


def test_the_movie_file_plays_for_its_time(course: TaxelCourse, tmp_path: Path) -> None:
    out = tmp_path / "taxel.gif"
    write_taxel_movie(course, SECTION, out, lambda *_: None, MOVIE_S)
    with Image.open(out) as image:
        durations = []
        for number in range(getattr(image, "n_frames", 1)):
            image.seek(number)
            durations.append(image.info["duration"])
    assert sum(durations) == pytest.approx(1000 * (MOVIE_S + HOLD_S), abs=1000 * FRAME_S)


def test_the_command_needs_no_folder_of_spikes(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {name: tmp_path / f"taxel{end}" for name, end in (
        ("--figure", ".pdf"), ("--csv", ".csv"), ("--movie", ".png")
    )}  # fmt: skip
    words = ["encode", str(session), "--no-cache", "--trial", "3", "--taxel", "7"]
    for name, file in files.items():
        words += [name, str(file)]
    assert main([*words, "--start", "0.1", "--seconds", "0.1"]) == 0
    said = capsys.readouterr().out
    assert all(f"{file}: " in said for file in files.values()) and "gaps in their samples" in said
    assert "without C" in files["--csv"].read_text(encoding="utf-8")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "taxel.csv", "taxel.pdf", "taxel.png"
    ]  # fmt: skip


def test_the_command_searches_c_where_it_is_asked_for(tmp_path: Path) -> None:
    session = record(tmp_path / "day", "L", travel_mm=12.0, speeds=(80,))
    words = ["encode", str(session), "--no-cache", "--scaled-by", "texture", "--trial"]
    for trial in ("1", "2"):
        assert main([*words, trial, "--csv", str(tmp_path / f"{trial}.csv")]) == 0
    comments = [(tmp_path / f"{trial}.csv").read_text(encoding="utf-8") for trial in ("1", "2")]
    assert sum("SA current times C = 1 ·" in comment for comment in comments) == 1
    assert all("SA current times C = " in comment for comment in comments)


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ((), "nothing to write: give --out DIR"),
        (("--figure", "a.txt"), r"none of .svg, .png, .pdf"),
        (("--movie", "a.avi"), r"none of .gif, .mp4, .png"),
        (("--csv", "old.csv"), "already exists"),
        (("--csv", "a.csv", "--trial", "99"), "no session has a committed trial 99"),
        (("--csv", "a.csv", "--trial", "5"), "trial 5 has gaps or no C"),
        (("--csv", "a.csv", "--taxel", "19"), "no taxel 19: choose 1 to 18"),
        (("--figure", "a.svg", "--start", "9"), "--start 9 is behind the end of the trial"),
    ],
)
def test_what_cannot_be_shown_is_refused_whole(
    session: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    problem: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("old.csv").touch()
    assert main(["encode", str(session), "--no-cache", *words]) == WrongUse.exit_code
    error = capsys.readouterr().err
    assert problem.replace("\\", "") in error and "Traceback" not in error
    assert [path.name for path in tmp_path.iterdir()] == ["old.csv"]
