"""``rigctl verify`` names values that no rig records, and only notes what a faulty rig does."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.session.verify import verify
from rigctl.values import LoadcellSample
from tests.session import building
from tests.session.building import drum_state
from tests.session.forging import rewrite_digests
from tests.session.spoiling import Spoil, set_array, set_row

N_CONVERSIONS = 80
TARE_COUNTS, SCALE_G = 8000, 0.0024


def problems_of(recorded: Path, folder: Path, spoil: Spoil) -> list[str]:
    """Return what verify finds in a copy whose digests agree with the spoilt rows."""
    copy = Path(shutil.copytree(recorded, folder / "s"))
    with h5py.File(copy / "part-0001.h5", "r+") as file:
        spoil(file)
    rewrite_digests(copy)
    return verify(copy).problems


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (set_array("/taxels/samples", (40, 3), 1024), "/taxels/samples is 1024 in row 40, above"),
        (set_array("/taxels/edges", 40, 16), "/taxels/edges is 16 in row 40, has bits without"),
        (set_array("/taxels/counter", 0, -1), "/taxels/counter begins below 0"),
        (set_row("/taxels/arrivals", 1, arrived_s=np.nan), "arrived_s of /taxels/arrivals is nan"),
        (set_row("/drum", 0, state=12), "state of /drum is 12 in row 0, no known value"),
        (set_row("/drum", 0, fault=23), "fault of /drum is 23 in row 0, no known value"),
        (set_row("/drum", 0, fault_bits=1), "fault_bits of /drum is 1 in row 0, has bits without"),
        (
            set_row("/drum", 0, status_bits=32768),
            "status_bits of /drum is 32768 in row 0, has bits",
        ),
        (set_row("/drum", 0, force_g=np.nan), "force_g of /drum is nan in row 0, not from"),
        (set_row("/drum", 0, angle_deg=np.inf), "angle_deg of /drum is inf in row 0, not from"),
        (set_row("/drum", 2, board_time_us=0), "board_time_us of /drum runs back at row 2"),
        (set_row("/drum", 0, loadcell_lost=-1), "loadcell_lost of /drum is -1 in row 0, below 0"),
        (set_row("/loadcell", 1, force_g=1e9), "force_g of /loadcell is 1e+09 in row 1"),
        (set_row("/loadcell", 1, force_g=np.nan), "force_g of /loadcell is nan in row 1"),
        (set_row("/loadcell", 1, raw_counts=1 << 24), "raw_counts of /loadcell is 16777216 in"),
        (set_row("/loadcell", 2, board_time_us=0), "board_time_us of /loadcell runs back at row 2"),
        (set_row("/loadcell", 2, sequence=1), "/loadcell holds a conversion twice"),
        (set_row("/events", 0, at_s=np.inf), "at_s of /events is inf in row 0"),
        (set_row("/events", 0, data=b"[1"), "data of /events is [1 in row 0, not a JSON object"),
        (set_row("/trials", 1, speed_mm_s=0.0), "mm at 0 mm/s cannot be recorded"),
        (set_row("/trials", 1, speed_mm_s=np.nan), "mm at nan mm/s cannot be recorded"),
        (set_row("/trials", 1, mean_force_g=np.nan), "mean_force_g of /trials is nan in row 1"),
        (set_row("/trials", 1, verdict=b"lost"), "verdict of /trials is lost in row 1, no known"),
        (set_row("/trials", 1, attempt=0), "attempt of /trials is 0 in row 1, below 1"),
    ],
)
def test_values_that_no_drum_records_are_named(
    drum: Path, tmp_path: Path, spoil: Spoil, words: str
) -> None:
    problems = problems_of(drum, tmp_path, spoil)
    assert any(words in line for line in problems), problems


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (set_array("/taxels/flags", 40, 8), "/taxels/flags is 8 in row 40, has bits without"),
        (set_row("/track", 3, x_mm=np.inf), "x_mm of /track is inf in row 3"),
        (set_row("/track", 3, valid=2), "valid of /track is 2 in row 3, no known value"),
        (set_row("/track", 3, at_s=-1), "at_s of /track runs back at row 3"),
        (set_row("/batches", 1, velocity_um_s=-1), "velocity_um_s of /batches is -1 in row 1"),
        (set_row("/batches", 1, velocity_source=3), "velocity_source of /batches is 3 in row 1"),
        (set_row("/batches", 1, batch=-4), "batch of /batches is -4 in row 1, below 0"),
        (set_row("/batches", 1, samples=101), "samples of /batches is 101 in row 1"),
        (set_row("/batches", 1, reported_s=np.nan), "reported_s of /batches is nan in row 1"),
        (set_row("/windows", 1, real_ms=-1), "real_ms of /windows is -1 in row 1, below 0"),
        (set_row("/predictions", 1, known=7), "known of /predictions is 7 in row 1, no known"),
        (set_row("/predictions", 1, probabilities=b"{"), "probabilities of /predictions is {"),
        (set_row("/latencies", 0, ms=np.nan), "ms of /latencies is nan in row 0"),
        (set_row("/trials", 1, contact_share=1.5), "contact_share of /trials is 1.5 in row 1"),
        (set_row("/trials", 1, mean_mm_s=np.nan), "mean_mm_s of /trials is nan in row 1"),
        (set_row("/trials", 1, correct=2), "correct of /trials is 2 in row 1, no known value"),
    ],
)
def test_values_that_no_finger_records_are_named(
    finger: Path, tmp_path: Path, spoil: Spoil, words: str
) -> None:
    problems = problems_of(finger, tmp_path, spoil)
    assert any(words in line for line in problems), problems


def test_a_range_that_ends_before_it_begins_is_named(drum: Path, tmp_path: Path) -> None:
    def reverse(file: h5py.File) -> None:
        for name, value in (("taxel_low", 600), ("taxel_high", 500)):
            text = np.array(str([value] * 18).encode())
            file.attrs.create(name, text, dtype=h5py.string_dtype("utf-8", text.itemsize))

    problems = problems_of(drum, tmp_path, reverse)
    assert any("the range of taxel 1 begins at 600 and ends at 500" in line for line in problems)


def record_forces(folder: Path, change: Callable[[int, float], float], raw_step: int = 700) -> Path:
    """Record load-cell samples of changing force; ``change`` alters the force of a row."""
    with building.recorder(folder) as rec:
        rec.begin_part("start", "A")
        for row in range(0, N_CONVERSIONS, 2):
            state = drum_state(row * 0.0125 + 0.1, row)
            samples = []
            for sample in state.loadcell:
                raw = min(TARE_COUNTS + raw_step * (sample.sequence % 37), (1 << 23) - 1)
                force_g = change(sample.sequence, (raw - TARE_COUNTS) * SCALE_G)
                changes = {"raw_counts": raw, "force_g": force_g}
                samples.append(LoadcellSample(*sample._replace(**changes)))
            fields = {name: getattr(state, name) for name in type(state).__slots__}
            rec.add_drum(type(state)(**{**fields, "loadcell": tuple(samples)}), 250, 40)
    return folder


def test_forces_with_one_scale_and_a_tare_in_between_are_whole(tmp_path: Path) -> None:
    record_forces(tmp_path, lambda row, force_g: force_g - (30.0 if row > 40 else 0.0))
    report = verify(tmp_path)
    assert report.problems == []


def test_a_force_that_is_not_that_of_its_counts_is_named(tmp_path: Path) -> None:
    record_forces(tmp_path, lambda row, force_g: force_g + (25.0 if row == 33 else 0.0))
    (problem,) = verify(tmp_path).problems
    assert "force_g of /loadcell is" in problem
    assert "in row 33, its raw_counts give another force" in problem


@pytest.mark.parametrize("factor", [0.001, 1000.0])
def test_a_scale_that_no_cell_has_is_named(tmp_path: Path, factor: float) -> None:
    record_forces(tmp_path, lambda row, force_g: force_g * factor, raw_step=200)
    (problem,) = verify(tmp_path).problems
    assert "µg a count, a load cell has 200 to 25000" in problem


def test_a_saturated_load_cell_is_noted_and_no_damage(tmp_path: Path) -> None:
    record_forces(tmp_path, lambda row, force_g: force_g, raw_step=300_000)
    report = verify(tmp_path)
    assert report.problems == []
    assert any("the load cell was at the end of its range in" in note for note in report.notes)
