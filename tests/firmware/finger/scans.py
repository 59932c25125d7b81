"""Scans as a finger would make them, and the same scan through each build of the firmware."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.encoder import Encoder
from rigctl.encoder.force_gain import ForceGain, ForceScaling, calibrated, divided
from rigctl.encoder.normalisation import Normalisation
from rigctl.finger import board_messages
from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.bench.qemu import InstructionCount, Line, Script, run_script
from rigctl.finger.board_messages import (
    BATCH_SAMPLES,
    N_TAXELS,
    NO_GAIN,
    SampleFlag,
    WindowReport,
)
from rigctl.finger.decoder import FingerBlock, FingerDecoder

LOW = tuple(range(40, 40 + N_TAXELS))
HIGH = tuple(range(700, 700 + N_TAXELS))
PROFILES = {
    "slow": (50, 50),
    "medium": (100, 100),
    "fast": (200, 200),
    "slow-to-fast": (50, 200),
    "fast-to-slow": (200, 50),
}
"""Velocities in mm/s at the start and at the end of the scan."""
RANGES = Normalisation(np.array(LOW, np.uint16), np.array(HIGH, np.uint16))
FORCES_G = np.geomspace(50.0, 1200.0, 12)
CURVES = LOW + np.linspace(3.0, 7.0, N_TAXELS) * FORCES_G[:, None] ** 0.7
GAINS = {
    ForceScaling.NONE: NO_GAIN,
    ForceScaling.DIVIDED: divided(RANGES),
    ForceScaling.CALIBRATED: calibrated(FORCES_G, CURVES, RANGES),
}
SETTINGS = board_messages.set_ranges(LOW, HIGH) + board_messages.read_settings()


@dataclass(frozen=True)
class SyntheticScan:
    """Readings uint16 (n, 9), and the velocity of each batch of 100 in µm/s."""

    number: int
    readings: NDArray[np.uint16]
    velocities_um_per_s: list[int]


def synthetic_scan(number: int, seed: int = 1) -> SyntheticScan:
    """Return scan ``number`` over ridges 2.5 mm apart, with the profiles in turns.

    Some taxels barely reach the threshold of their neurons, where a rounding moves a spike.
    """
    rng = np.random.default_rng((seed, number))
    begin, end = list(PROFILES.values())[number % len(PROFILES)]
    samples = int(200_000 / ((begin + end) / 2)) + int(rng.integers(0, 100))
    speed = np.linspace(begin, end, samples) * rng.uniform(0.85, 1.15)
    position_mm = np.cumsum(speed) / 1000.0
    phase = rng.uniform(0, 2 * np.pi, N_TAXELS)
    ridges = np.sin(2 * np.pi * position_mm[:, None] / 2.5 + phase)
    level = np.exp(rng.uniform(np.log(0.03), np.log(0.7), N_TAXELS))
    pressure = level * (1.0 + 0.2 * np.sin(position_mm / 40.0 + phase[0]))[:, None]
    counts = np.array(LOW) + 660.0 * pressure * (1.0 + 0.5 * ridges)
    noise = rng.normal(0.0, 2.0, (samples, N_TAXELS))
    readings = np.clip(counts + noise, 0, 1023).astype(np.uint16)
    means = [speed[at : at + BATCH_SAMPLES].mean() for at in range(0, samples, BATCH_SAMPLES)]
    return SyntheticScan(number, readings, [round(mean * 1000) for mean in means])


def steps(scan: SyntheticScan) -> list[tuple[Line, bytes]]:
    """Return what reaches the board in a scan: start, samples, velocities, stop."""
    whole = len(scan.readings) // BATCH_SAMPLES
    done: list[tuple[Line, bytes]] = [(Line.HOST, board_messages.start(scan.number))]
    for batch, velocity in enumerate(scan.velocities_um_per_s):
        rows = scan.readings[batch * BATCH_SAMPLES : (batch + 1) * BATCH_SAMPLES]
        done.append((Line.CONVERTER, rows.tobytes()))
        if batch == whole:  # the last, short one
            done.append((Line.HOST, board_messages.stop(scan.number)))
        done.append((Line.HOST, board_messages.velocity(scan.number, batch, velocity)))
    if len(scan.velocities_um_per_s) == whole:
        done.append((Line.HOST, board_messages.stop(scan.number)))
    return done


def through_host_build(
    scans: list[SyntheticScan], board: FingerFirmware, requests: bytes = b""
) -> bytes:
    """Return the bytes that the core sends on this computer, from its boot on."""
    board.boot(0)
    board.receive(SETTINGS + requests)
    sent = [board.take_sent()]
    for line, data in (step for scan in scans for step in steps(scan)):
        if line is Line.HOST:
            board.receive(data)
        else:
            board.run(np.frombuffer(data, np.uint16).reshape(-1, N_TAXELS))
        sent.append(board.take_sent())
    return b"".join(sent)


def through_image(
    scans: list[SyntheticScan], requests: bytes = b""
) -> tuple[bytes, InstructionCount]:
    """Return the bytes that the Cortex-M7 image sends, and its instructions."""
    script = Script()
    script.add(Line.HOST, SETTINGS + requests)
    for line, data in (step for scan in scans for step in steps(scan)):
        script.add(line, data)
    return run_script(script)


def differing_trains(sent: bytes, scans: list[SyntheticScan], gain: ForceGain = NO_GAIN) -> int:
    """Return how many spike trains differ from the encoder's, of 9 in each scan."""
    block, _ = FingerDecoder().feed(sent)
    encoder = Encoder(RANGES, gain_of=lambda _: gain)
    differing = 0
    for rows, scan in zip(_rows(block, scans), scans, strict=True):
        encoder.reset()
        expected = encoder.encode(scan.readings)[:, :N_TAXELS]
        assert np.array_equal(block.readings[rows], scan.readings)
        differing += int(np.any(block.spikes[rows] != expected, axis=0).sum())
    return differing


def differing_windows(sent: bytes, scans: list[SyntheticScan]) -> int:
    """Return how many windows lack the spikes of their 10 mm, or the time that those took."""
    block, decoded = FingerDecoder().feed(sent)
    differing = 0
    for rows, scan in zip(_rows(block, scans), scans, strict=True):
        index = _window_of_each_sample(scan)
        expected = [
            (window, int(np.sum(inside)), tuple(block.spikes[rows][inside].sum(axis=0).tolist()))
            for window in sorted(set(index.tolist()))
            for inside in [index == window]
        ]
        windows = [m for m in decoded if isinstance(m, WindowReport) and m.scan == scan.number]
        found = [(w.window, w.real_ms, w.spikes) for w in windows]
        differing += len(set(expected) ^ set(found))
    return differing


def _rows(block: FingerBlock, scans: list[SyntheticScan]) -> list[slice]:
    begins = np.flatnonzero(block.flags & SampleFlag.FIRST)
    lengths = [len(scan.readings) for scan in scans]
    return [slice(begin, begin + n) for begin, n in zip(begins, lengths, strict=True)]


def _window_of_each_sample(scan: SyntheticScan) -> NDArray[np.int64]:
    velocities = np.repeat(np.array(scan.velocities_um_per_s), BATCH_SAMPLES)
    distance_nm = np.concatenate([[0], np.cumsum(velocities[: len(scan.readings) - 1])])
    windows: NDArray[np.int64] = distance_nm // 10_000_000
    return windows
