"""Samples of a driver from outside: cut anywhere, damaged, repeated, restarted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.boards.sensor_driver import SENSORS, DriverDecoder, Readings, SensorDriver
from rigctl.errors import LinkLost
from rigctl.values import Gap


@pytest.fixture
def driver(examples: Path) -> SensorDriver:
    plugin, create = SENSORS.plugin("teensy16"), SENSORS.load("teensy16")
    assert plugin is not None and create is not None
    return SensorDriver(plugin, create)


def wire(driver: SensorDriver, first: int, end: int, sync: int = 10**9) -> bytes:
    """Return the frames of some samples; the line is high from one of them on."""
    numbers = np.arange(first, end, dtype=np.int64)
    samples = np.repeat((numbers % 60_000).astype(np.uint16)[:, None], 16, axis=1)
    create: Any = driver.create
    return bytes(create().encode(numbers, samples, numbers >= sync))


def counters(blocks: Any) -> list[int]:
    return [number for block in blocks for number in block.counters.tolist()]


def test_slices_of_any_length_give_the_same_samples(driver: SensorDriver) -> None:
    data = b"\x5a\xa5\xa5" + wire(driver, 70_000, 70_040, sync=70_020)
    decoder, found = DriverDecoder(driver), []
    for at in range(0, len(data), 7):
        found += decoder.feed(data[at : at + 7], at / 1000).blocks
    assert counters(found) == list(range(70_000, 70_040))
    assert all((block.samples == block.counters[:, None] % 60_000).all() for block in found)
    edges = np.concatenate([block.edges for block in found])
    flags = np.concatenate([block.flags for block in found])
    assert edges.tolist() == flags.tolist() == [0] * 20 + [1] * 20


def test_damage_is_a_gap_and_a_repeat_is_stale(driver: SensorDriver) -> None:
    data = bytearray(wire(driver, 0, 10))
    data[41 * 4 + 20] ^= 1
    decoder = DriverDecoder(driver)
    first = decoder.feed(bytes(data), 0.0)
    assert counters(first.blocks) == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    assert first.blocks[0].gaps == (Gap(4, 1, "lost on the line"),)
    assert (first.rejected_frames, first.rejected_bytes) == (1, 41)
    again = decoder.feed(wire(driver, 8, 12), 0.01)
    assert counters(again.blocks) == [10, 11] and again.stale_frames == 2


def test_a_long_loss_is_a_gap_and_a_restart_a_reboot(driver: SensorDriver) -> None:
    decoder = DriverDecoder(driver)
    decoder.feed(wire(driver, 5000, 5010), 10.0)
    decoder.resync()
    after = decoder.feed(wire(driver, 65_010, 65_012), 70.0)
    assert after.blocks[0].gaps == (Gap(5010, 60_000, "lost on the line"),) and not after.reboots
    restarted = decoder.feed(wire(driver, 65_012, 65_014) + wire(driver, 0, 3), 70.1)
    assert restarted.reboots == 1
    assert [counters([block]) for block in restarted.blocks] == [[65_012, 65_013], [0, 1, 2]]


def test_a_counter_that_wraps_goes_on(driver: SensorDriver) -> None:
    decoder = DriverDecoder(driver)
    decoder.feed(wire(driver, (1 << 32) - 2, 1 << 32), 0.0)
    assert counters(decoder.feed(wire(driver, 0, 2), 0.002).blocks) == [1 << 32, (1 << 32) + 1]


WRONG = [
    (np.zeros((1, 16), np.int32), r"samples are int32 \(1, 16\) instead of uint16 \(1, 16\)"),
    (np.zeros((1, 12), np.uint16), r"samples are uint16 \(1, 12\) instead of uint16 \(1, 16\)"),
]


@pytest.mark.parametrize(("samples", "reason"), WRONG)
def test_readings_of_another_shape_are_a_lost_link(
    driver: SensorDriver, monkeypatch: pytest.MonkeyPatch, samples: Any, reason: str
) -> None:
    found = Readings(np.array([1]), samples, np.array([True]))
    monkeypatch.setattr(driver.create, "decode", lambda self, data: found)
    with pytest.raises(LinkLost, match=f"sensor teensy16 of .* failed .ValueError: {reason}"):
        DriverDecoder(driver).feed(b"", 0.0)
