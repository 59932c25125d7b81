"""Image, host build and encoder agree to the bit."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator

import numpy as np
import pytest

from rigctl.encoding.encoder import Encoder
from rigctl.encoding.neuron_header import HEADER, neuron_header
from rigctl.encoding.normalisation import Normalisation
from rigctl.simulation.boards.finger_firmware import FingerFirmware
from rigctl.wire.finger.decoder import FingerDecoder
from rigctl.wire.finger.messages import N_TAXELS, SampleFlag, ScanEnded, WindowReport
from tests.firmware.building import built
from tests.firmware.finger.scans import (
    HIGH,
    LOW,
    SyntheticScan,
    synthetic_scan,
    through_host_build,
    through_image,
)

SCANS = [synthetic_scan(number) for number in range(20)]


@pytest.fixture(scope="module")
def sent() -> Iterator[bytes]:
    """Bytes that the host build sends in 20 scans of all velocity profiles."""
    board = FingerFirmware()
    yield through_host_build(SCANS, board)
    board.close()


def test_the_cortex_m7_image_sends_the_same_bytes_as_the_host_build(sent: bytes) -> None:
    built("firmware/finger.elf")
    image, count = through_image(SCANS)
    assert image == sent
    assert count.samples == sum(len(scan.readings) for scan in SCANS)
    assert count.longest < 600_000 // 20, "a twentieth of a Teensy's cycles in a millisecond"


def test_no_spike_train_differs_from_the_encoder(sent: bytes) -> None:
    block, _ = FingerDecoder().feed(sent)
    encoder = Encoder(Normalisation(np.array(LOW, np.uint16), np.array(HIGH, np.uint16)))
    begins = np.flatnonzero(block.flags & SampleFlag.FIRST)
    assert len(begins) == len(SCANS)
    for begin, scan in zip(begins, SCANS, strict=True):
        rows = slice(begin, begin + len(scan.readings))
        encoder.reset()
        expected = encoder.encode(scan.readings)[:, :N_TAXELS]
        assert np.array_equal(block.readings[rows], scan.readings)
        assert np.array_equal(block.spikes[rows], expected)


def test_windows_hold_the_spikes_of_ten_millimetres_each(sent: bytes) -> None:
    block, messages = FingerDecoder().feed(sent)
    begins = np.flatnonzero(block.flags & SampleFlag.FIRST)
    ended = {message.scan for message in messages if isinstance(message, ScanEnded)}
    assert ended == {scan.number for scan in SCANS}
    for begin, scan in zip(begins, SCANS, strict=True):
        spikes = block.spikes[begin : begin + len(scan.readings)]
        windows = [m for m in messages if isinstance(m, WindowReport) and m.scan == scan.number]
        index = _window_of_each_sample(scan)
        assert [window.window for window in windows] == sorted(set(index.tolist()))
        for window in windows:
            inside = index == window.window
            assert window.real_ms == np.count_nonzero(inside)
            assert window.spikes == tuple(spikes[inside].sum(axis=0).tolist())


def _window_of_each_sample(scan: SyntheticScan) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    velocities = np.repeat(np.array(scan.velocities_um_per_s), 100)[: len(scan.readings)]
    distance_nm = np.concatenate([[0], np.cumsum(velocities)[:-1]])
    windows: np.ndarray[tuple[int], np.dtype[np.int64]] = distance_nm // 10_000_000
    return windows


def test_the_neurons_constants_are_the_encoders() -> None:
    assert HEADER.read_text(encoding="utf-8") == neuron_header()


def test_scaled_time_batches_and_windows_pass_their_tests_under_sanitizers() -> None:
    command = [str(built("firmware/native-finger"))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]


def test_the_sketch_compiles_against_a_stub_of_the_teensy_core() -> None:
    assert built("firmware/finger-teensy.o").stat().st_size > 0
