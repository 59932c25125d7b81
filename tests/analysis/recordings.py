"""Synthetic sessions; each plate has its own wavelength, so that textures can be classified."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.reading import Reading
from rigctl.protocol.loader import parse_protocol
from rigctl.session.header import SessionHeader
from rigctl.session.recorder import Recorder
from rigctl.session.sensor_layout import SensorLayout
from rigctl.session.sensor_passport import SensorPassport, TaxelResponse
from rigctl.values import Block, DrumState, Gap, PlannedTrial
from tests.session.building import drum_state, trial_row

PROTOCOL = """\
name = "by hand"
textures = [{textures}]
speeds_mm_s = {speeds}
{presses}
repeats = {repeats}
mounts = {mounts}
[trial]
travel_mm = {travel}
{mode}"""
WAVELENGTHS_MM = {"A": 0.0, "B": 4.0, "D": 8.0, "L": 5.5, "G": 6.5, "X": 7.0}
IDLE = 300
BLOCK = 100


def readings(trial: PlannedTrial, n: int, seed: int, seat: float = 0.0) -> NDArray[np.uint16]:
    """Return readings of 18 taxels over a wave of the plate's length, weaker in the lower layer.

    A millimetre of depth presses like 500 g. ``seat``: how much each mounting of a plate changes
    the level of each taxel.
    """
    rng = np.random.default_rng([seed, trial.trial_id])
    travel = trial.speed_mm_s * np.arange(n)[:, None] / 1000
    place = 5.0 * (np.arange(18) % 9 // 3)
    wavelength = WAVELENGTHS_MM[trial.texture]
    wave = np.sin(2 * np.pi * (travel + place) / wavelength) if wavelength else np.zeros((n, 18))
    layer = np.where(np.arange(18) < 9, 1.0, 0.5)
    level = np.random.default_rng(5).uniform(0.3, 0.5, 18)
    level *= (trial.force_g / 500 or trial.depth_mm) ** 0.4
    seated = np.random.default_rng([ord(trial.texture), trial.mount]).normal(0, 1, 18)
    level = level + seat * seated
    x: NDArray[np.float64] = level + 0.12 * layer * wave + rng.normal(0, 0.012, (n, 18))
    return np.round(1023 * np.clip(x, 0, 1)).astype(np.uint16)


def sensor_passport(gain: float = 1.0, sensor: str = "S1") -> SensorPassport:
    """Return what a calibration of the sensor of :func:`readings` finds, ``gain`` times as much."""
    forces_g = (100.0, 250.0, 500.0, 1000.0, 1200.0)
    level = np.random.default_rng(5).uniform(0.3, 0.5, 18)
    curves = 4096 * gain * level[:, None] * (np.array(forces_g) / 500) ** 0.4
    taxels = tuple(
        TaxelResponse(tuple(curve.tolist()), float(np.ptp(curve)), repeatability=0.01)
        for curve in curves
    )
    made = (sensor, "2026-11-20T12:00:00Z", "0" * 64, True, Reading.CONDUCTANCE)
    return SensorPassport(*made, forces_g, (0.02,) * len(forces_g), taxels)


def record(
    folder: Path,
    textures: str = "ABDL",
    *,
    repeats: int = 1,
    travel_mm: float = 48.0,
    torn: tuple[int, ...] = (),
    speeds: tuple[int, ...] = (40, 80, 120),
    forces: tuple[int, ...] = (250, 500),
    depths_mm: tuple[float, ...] = (),
    seed: int = 3,
    layout: SensorLayout | None = None,
    mounts: int = 1,
    seat: float = 0.0,
    rig: str = "virtual",
    passport: SensorPassport | None = None,
    has_loadcell: bool = True,
) -> Path:
    """Record every trial of a small plan, pressed to depths if there are any.

    Trials in ``torn`` lack a few samples.
    """
    names = ", ".join(f'"{name}"' for name in textures)
    text = PROTOCOL.format(
        textures=names,
        repeats=repeats,
        travel=travel_mm,
        speeds=list(speeds),
        presses=f"depths_mm = {list(depths_mm)}" if depths_mm else f"forces_g = {list(forces)}",
        mode='force_mode = "position"\n' if depths_mm else "",
        mounts=mounts,
    )
    plan = parse_protocol(text, "by hand").plan()
    header = SessionHeader(plan.hash, seed, len(plan.trials), rig, True, "2026-11-21T12:00:00Z")
    carried = {} if passport is None else passport.to_values()
    header = replace(header, sensor_layout=layout, passport=carried)
    counter, sequence = 0, 0
    with Recorder(folder, header, text, "") as recorder:
        recorder.begin_part("start", textures[0])
        for trial in plan.trials:
            first = counter + IDLE
            samples = readings(trial, IDLE + trial.n_samples + IDLE, seed, seat)
            counter = _record(recorder, samples, counter, trial.trial_id in torn)
            for at in np.arange(first - IDLE + 25, counter, 25):
                state = drum_state(at / 1000, sequence, first * 1000)
                sequence += 2
                recorder.add_drum(
                    _loadcell(state, trial, sequence), trial.force_g, trial.speed_mm_s
                )
            row = trial_row(trial, first)
            mean_force_g = row.mean_force_g if has_loadcell else float("nan")
            recorder.commit_trial(
                replace(
                    row,
                    started_s=(first - IDLE) / 1000,
                    ended_s=counter / 1000,
                    mean_force_g=mean_force_g,
                )
            )
    return folder


def _record(recorder: Recorder, samples: NDArray[np.uint16], counter: int, torn: bool) -> int:
    n = len(samples)
    for start in range(0, n, BLOCK):
        rows = np.arange(start, min(start + BLOCK, n))
        gaps: tuple[Gap, ...] = ()
        if torn and start == IDLE:
            gaps, rows = (Gap(counter + start, 7, "by hand"),), rows[7:]
        zeros = np.zeros(len(rows), np.uint8)
        block = Block(counter + rows, samples[rows], zeros, zeros, gaps, (counter + start) / 1e3)
        recorder.add_block(block)
    return counter + n


def _loadcell(state: DrumState, trial: PlannedTrial, sequence: int) -> DrumState:
    """Return the state with load-cell readings at the set-point plus a little noise."""
    noise = np.random.default_rng(sequence).normal(0, 1.5, len(state.loadcell))
    cells = zip(state.loadcell, noise, strict=True)
    return replace(
        state,
        loadcell=tuple(cell._replace(force_g=trial.force_g + float(e)) for cell, e in cells),
    )
