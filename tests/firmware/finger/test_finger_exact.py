"""Image, host build and encoder agree to the bit."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator

import pytest

from rigctl.encoder.force_gain import ForceScaling
from rigctl.finger import board_messages
from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.board_messages import ScanEnded
from rigctl.finger.decoder import FingerDecoder
from rigctl.finger.neuron_header import HEADER, neuron_header
from tests.firmware.building import built
from tests.firmware.finger.scans import (
    GAINS,
    differing_trains,
    differing_windows,
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
    assert differing_trains(sent, SCANS) == 0


@pytest.mark.parametrize("scaling", ForceScaling)
def test_a_gain_gives_the_encoders_spikes_in_every_build(
    sent: bytes, scaling: ForceScaling
) -> None:
    built("firmware/finger.elf")
    gain, scans = GAINS[scaling], SCANS[:5]
    requests = board_messages.set_gain(gain) + board_messages.read_settings()
    board = FingerFirmware()
    host_build = through_host_build(scans, board, requests)
    board.close()
    image, count = through_image(scans, requests)
    assert image == host_build
    assert count.longest < 600_000 // 20, "a twentieth of a Teensy's cycles in a millisecond"
    assert differing_trains(image, scans, gain) == 0
    assert (differing_trains(image, scans) > 20) == (scaling is not ForceScaling.NONE)


def test_windows_hold_the_spikes_of_ten_millimetres_each(sent: bytes) -> None:
    _, messages = FingerDecoder().feed(sent)
    assert {m.scan for m in messages if isinstance(m, ScanEnded)} == {s.number for s in SCANS}
    assert differing_windows(sent, SCANS) == 0


def test_the_neurons_constants_are_the_encoders() -> None:
    assert HEADER.read_text(encoding="utf-8") == neuron_header()


def test_scaled_time_batches_and_windows_pass_their_tests_under_sanitizers() -> None:
    command = [str(built("firmware/native-finger"))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]


def test_the_sketch_compiles_against_a_stub_of_the_teensy_core() -> None:
    assert built("firmware/finger-teensy.o").stat().st_size > 0
