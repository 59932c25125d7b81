"""The movie of a recorded scan: what its frames hold, and the files it becomes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text
from PIL import Image

from rigctl.analysis.movies import FRAME_S, HOLD_S, Movie, check_movie_file
from rigctl.bench.world_file import NOMINAL_WORLD
from rigctl.errors import DiskFault, SessionError, WrongUse
from rigctl.finger.analysis.movie import (
    LEAD_S,
    RIGHT,
    TRAIL_S,
    WRONG,
    ScanTimeline,
    answer_words,
    doubt_words,
    foot_of,
    frame_at,
    frame_times,
    plate_relief,
    read_timeline,
    scan_movie,
    taxel_colours,
    taxel_places_mm,
    title_of,
    words_of,
    write_movie,
)
from rigctl.finger.scaled_time import scale_windows
from rigctl.finger.session import FingerSession
from rigctl.finger.values import PredictionRow
from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import Verdict
from tests.finger import finger_building
from tests.finger.finger_building import SCAN_MS, VELOCITIES_UM_S, SyntheticFinger

RUN_TRIAL, TRAIN_TRIAL = 5, 1
ANSWER = PredictionRow(
    1, 0.0, 7, 70.0, 0.61, "A", {"A": 0.6, "B": 0.3, "D": 0.1}, ("A", "B"), True, False, False
)


@pytest.fixture(scope="module")
def timeline(finger: Path) -> ScanTimeline:
    return read_timeline(finger, RUN_TRIAL)


@pytest.fixture(scope="module")
def short(timeline: ScanTimeline) -> ScanTimeline:
    """A scan of few frames."""
    return replace(timeline, duration_s=0.01, answers=(), answer_s=np.zeros(0))


def ignore(*_: object) -> None:
    """Take no notice of progress."""


def test_the_clock_of_a_scan_begins_at_its_first_sample(finger: Path) -> None:
    with FingerSession.open(finger) as reader:
        row = reader.trials[0]
        # The synthetic board sends its samples without a delay, in blocks of ten.
        assert reader.scan_start_s(0) == pytest.approx(row["first_counter"] / 1000, abs=0.0011)


def test_a_frame_holds_what_the_computer_had_at_its_moment(timeline: ScanTimeline) -> None:
    before, during = frame_at(timeline, -0.01), frame_at(timeline, 0.25)
    after = frame_at(timeline, 1.0)
    assert (before.n_readings, before.n_batches, before.n_windows, before.answer) == (0, 0, 0, None)
    assert during.n_readings == pytest.approx(251, abs=1) and during.n_batches == 2
    assert during.answer is not None and not during.answer.is_final
    assert after.n_readings == SCAN_MS and after.n_batches == len(VELOCITIES_UM_S)
    assert after.n_windows == len(timeline.rates_hz) > during.n_windows > 0
    assert after.answer is not None and after.answer.is_final
    assert after.spikes.all() and 0 < during.spikes.sum() < len(during.spikes)


def test_time_and_distance_stop_with_the_scan(timeline: ScanTimeline) -> None:
    before, after = frame_at(timeline, -0.3), frame_at(timeline, 9.0)
    assert (before.scan_s, before.distance_mm) == (0.0, 0.0)
    assert after.scan_s == SCAN_MS / 1000
    assert after.distance_mm == pytest.approx(200 * SCAN_MS / 1000, abs=2.5)


def test_spikes_lie_in_the_windows_that_count_them(finger: Path, timeline: ScanTimeline) -> None:
    window = (timeline.spike_mm // timeline.window_mm).astype(int)
    counts = np.zeros((len(timeline.rates_hz), 9), int)
    np.add.at(counts, (window, timeline.spike_taxel), 1)
    with FingerSession.open(finger) as reader:
        index = int(np.flatnonzero(reader.trials["trial_id"] == RUN_TRIAL)[0])
        scaled = scale_windows(reader.scan_spikes(index), reader.velocities_um_s(index))
    assert np.array_equal(counts, scaled.counts)
    assert np.array_equal(timeline.rates_hz, scaled.rates_hz)


def test_the_batches_are_the_velocities_that_the_board_used(timeline: ScanTimeline) -> None:
    assert timeline.batch_mm_s.tolist() == [value / 1000 for value in VELOCITIES_UM_S]
    assert timeline.batch_end_s[-1] == pytest.approx(SCAN_MS / 1000)
    assert np.all(timeline.batch_known_s >= timeline.batch_end_s - 0.002)


def test_frames_follow_real_time(timeline: ScanTimeline) -> None:
    times = frame_times(timeline)
    assert np.allclose(np.diff(times), FRAME_S)
    assert times[0] == -LEAD_S and times[-1] >= timeline.duration_s + TRAIL_S


def test_a_training_scan_shows_no_answer(finger: Path) -> None:
    trained = read_timeline(finger, TRAIN_TRIAL)
    assert trained.trial.stage == "train"
    without = replace(trained, answers=(), answer_s=np.zeros(0))
    texts = [text.get_text() for text in texts_of(scan_movie(without))]
    assert "this scan is not classified" in texts
    assert not any("✓" in text or "✗" in text for text in texts)


def texts_of(movie: Movie, number: int = -1) -> list[Text]:
    """Return the texts of a frame, by default of the last one."""
    movie.set_frame(number % movie.n_frames)
    return [text for text in movie.figure.findobj(Text) if isinstance(text, Text)]


def test_the_picture_names_plate_answer_time_and_origin(timeline: ScanTimeline) -> None:
    movie = scan_movie(timeline)
    assert "no answer yet" in [text.get_text() for text in texts_of(movie, 0)]
    texts = [text.get_text() for text in texts_of(movie)]
    plate = timeline.trial.texture
    for text in (f"{plate} ✓", f"plate ▸ {plate}", "SIMULATED", "75%", "velocity (mm/s)", "Hz"):
        assert text in texts
    assert any(text.startswith("0.44 s   ") for text in texts)
    assert "real time, 12.5 frames a second" in foot_of(timeline)
    assert title_of(timeline) == f"Plate {plate}"


def test_taxels_have_the_places_and_colours_of_their_rows(timeline: ScanTimeline) -> None:
    assert timeline.sensor_layout == SensorLayout(3, 3, ("I",))
    places = taxel_places_mm(timeline.sensor_layout)
    assert places[0].tolist() == [-5.0, -5.0] and places[5].tolist() == [0.0, 5.0]
    colours = taxel_colours(timeline.sensor_layout)
    assert [len(set(colours[row : row + 3])) for row in (0, 3, 6)] == [1, 1, 1]
    assert len(set(colours)) == 3


def test_a_wrong_answer_is_red_and_a_right_one_green(timeline: ScanTimeline) -> None:
    wrong = replace(timeline, answers=tuple(a._replace(texture="other") for a in timeline.answers))
    for one, sign, colour in ((timeline, "✓", RIGHT), (wrong, "✗", WRONG)):
        texts = texts_of(scan_movie(one))
        assert [text.get_color() for text in texts if sign in text.get_text()] == [colour]


def test_an_answer_says_what_it_rests_on() -> None:
    assert answer_words(ANSWER) == "so far, after 7 of 20 windows"
    assert answer_words(ANSWER._replace(is_final=True)) == "final answer, 0.61 s, 70 mm"
    assert doubt_words(ANSWER) == "95% set: A B"
    assert doubt_words(ANSWER._replace(texture_set=("A", "B", "D"))) == "95% set: every texture"
    assert doubt_words(ANSWER._replace(decided=True)).endswith("sure enough to decide")
    assert doubt_words(ANSWER._replace(known=False)) == "unlike every trained texture"


def test_a_simulated_plate_has_the_relief_of_its_world() -> None:
    header = finger_building.header()
    assert plate_relief(header, "B", Path("s")) is None
    known = replace(header, simulation=NOMINAL_WORLD.header_fields())
    relief = plate_relief(known, "D", Path("s"))
    assert relief is not None and relief.words == "circular ridges, 12.4 mm apart"
    assert np.allclose(relief.heights_mm[:248], relief.heights_mm[248:496]), "62 mm are five spaces"
    smooth = plate_relief(known, "A", Path("s"))
    assert smooth is not None and smooth.words == "smooth" and not smooth.heights_mm.any()
    old = replace(header, simulation={"world": {"another": 1.0}})
    assert plate_relief(old, "D", Path("s")) is None
    assert plate_relief(known, "cork", Path("s")) is None
    assert plate_relief(replace(known, simulated=False), "D", Path("s")) is None


def test_the_gif_plays_in_real_time(timeline: ScanTimeline, tmp_path: Path) -> None:
    steps: list[tuple[int, int]] = []
    out = tmp_path / "scan.gif"
    write_movie(timeline, out, lambda _, done, total: steps.append((done, total)))
    n_frames = len(frame_times(timeline))
    assert steps == [(done, n_frames) for done in range(n_frames + 1)]
    with Image.open(out) as image:
        durations = []
        for number in range(getattr(image, "n_frames", 1)):
            image.seek(number)
            durations.append(image.info["duration"])
        assert image.info["loop"] == 0
    assert sum(durations) == round(1000 * ((n_frames - 1) * FRAME_S + HOLD_S))
    assert out.stat().st_size < 3_000_000
    assert list(tmp_path.iterdir()) == [out]


def test_the_png_is_the_last_frame(timeline: ScanTimeline, tmp_path: Path) -> None:
    write_movie(timeline, tmp_path / "scan.png", ignore)
    with Image.open(tmp_path / "scan.png") as image:
        pixels = np.asarray(image)
    movie = scan_movie(timeline)
    assert np.array_equal(pixels, movie.draw(movie.n_frames - 1))


def test_what_is_cancelled_leaves_nothing(short: ScanTimeline, tmp_path: Path) -> None:
    def cancel(_: str, done: int, total: int) -> None:
        if done == total // 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_movie(short, tmp_path / "scan.gif", cancel)
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_never_overwritten_and_has_a_known_end(tmp_path: Path) -> None:
    (tmp_path / "scan.gif").touch()
    with pytest.raises(WrongUse, match="already exists"):
        check_movie_file(tmp_path / "scan.gif")
    with pytest.raises(WrongUse, match=r"none of \.gif, \.mp4, \.png"):
        check_movie_file(tmp_path / "scan.avi")


def test_an_mp4_without_ffmpeg_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(WrongUse, match="needs ffmpeg"):
        check_movie_file(tmp_path / "scan.mp4")


@pytest.mark.parametrize(("code", "made"), [(0, True), (1, False)])
def test_an_mp4_is_what_ffmpeg_makes(
    short: ScanTimeline, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, made: bool
) -> None:
    """A stand-in takes the frames and writes their number of bytes."""
    stand_in = tmp_path / "bin" / "ffmpeg"
    stand_in.parent.mkdir()
    stand_in.write_text(f'#!/bin/sh\nfor last; do :; done\nwc -c > "$last"\nexit {code}\n')
    stand_in.chmod(0o755)
    monkeypatch.setenv("PATH", str(stand_in.parent), prepend=":")
    out = tmp_path / "scan.mp4"
    if made:
        write_movie(short, out, ignore)
        assert int(out.read_text()) == len(frame_times(short)) * 1120 * 650 * 4
        return
    with pytest.raises(DiskFault, match="ffmpeg could not write"):
        write_movie(short, out, ignore)
    assert [path.name for path in tmp_path.iterdir()] == ["bin"]


def test_trials_that_cannot_be_shown_are_refused(finger: Path, tmp_path: Path) -> None:
    with pytest.raises(WrongUse, match="has no trial 99"):
        read_timeline(finger, 99)
    with pytest.raises(SessionError, match="not a session"):
        read_timeline(tmp_path)


def test_a_rejected_scan_says_why(tmp_path: Path) -> None:
    trial = finger_building.plan().trials[0]
    with finger_building.recorder(tmp_path / "s") as rec, SyntheticFinger(rec) as finger:
        rec.begin_part("start")
        finger.trial(trial, Verdict.REJECTED)
    with pytest.raises(WrongUse, match="no committed scan"):
        read_timeline(tmp_path / "s")
    shown = read_timeline(tmp_path / "s", trial.trial_id)
    assert words_of(shown).endswith("rejected: the finger was lifted; too fast")


def test_the_last_committed_scan_is_the_default(finger: Path) -> None:
    assert read_timeline(finger).trial.trial_id == len(finger_building.plan().trials)
