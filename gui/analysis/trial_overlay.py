"""Trials of several sessions to lay over each other. This module does not import Qt."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gui.analysis.open_sessions import OpenSessions
from gui.analysis.trial_sections import EncodedTrial, read_course
from gui.live.drum_course import thin_out
from rigctl.analysis.published import SMOOTH
from rigctl.values import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    from rigctl.encoder.normalisation import Normalisation
    from rigctl.session.session import Session

Floats = NDArray[np.float64]
Place = tuple[str, int]
"""The path of a session, and the row of a trial in it."""

MOST_TRIALS = 6
MOST_POINTS = 1 << 17
"""Of a curve; of a longer trial the lowest and highest of groups of points are kept."""
CHANNELS = ("SA", "RA")
TRIALS_FOR_C, SAMPLES_FOR_C = 5, 60 * SAMPLE_RATE_HZ
"""C is searched on so many trials of a condition, and on so much of each."""
SEVERAL = "several conditions"
CONDITION = ("texture", "speed_mm_s", "force_g")


class OverlaidTrial(NamedTuple):
    """A trial's courses over the time since its first sample; float64, each pair of equal length.

    ``name``: of its session and its own; ``spikes_s``: of the chosen neuron, as it was encoded;
    ``forced_s``: behind the force module, with ``c`` on the SA current; ``scaled_s``: behind the
    speed module too, in the time of the reference speed (equation 2). ``c`` is None where its
    session has no trial at the reference force: nothing is scaled by force.
    """

    name: str
    force_s: Floats
    force_g: Floats
    reading_s: Floats
    reading: Floats
    spikes_s: Floats
    forced_s: Floats
    scaled_s: Floats
    c: float | None


class TrialOverlay(NamedTuple):
    """Trials of one neuron, and what was left out, as a sentence or empty.

    ``condition``: plate, speed and force, of all trials or several. ``taxel``: of the neuron, from
    0; ``is_ra``: whether it is RA. ``n_taxels``: of the first session.
    """

    condition: str
    taxel: int
    is_ra: bool
    n_taxels: int
    trials: tuple[OverlaidTrial, ...]
    left_out: str
    simulated: bool

    @property
    def neuron(self) -> str:
        """Name of the neuron, as in the raster."""
        return f"T_{CHANNELS[self.is_ra]}-{self.taxel + 1}"


def overlay_trials(
    sessions: OpenSessions,
    paths: Sequence[str],
    trials: Sequence[Place],
    taxel: int,
    is_ra: bool,
) -> TrialOverlay:
    """Return trials of sessions of the drum to lay over each other. Raises SessionError.

    ``trials``: several, or one, to which each other session gives the one that is most like it;
    without any, it is the first of the condition that most sessions have.
    """
    chosen = list(trials) or _shared(sessions, paths)
    places = _alike(sessions, paths, chosen[0]) if len(chosen) == 1 else chosen
    names = _names(sessions, places)
    has = {place: _has(sessions.drum_session(place[0]), place[1], taxel) for place in places}
    usable = [place for place in places if has[place]]
    shown = [
        _read(sessions, *place, name, taxel, is_ra)
        for place, name in zip(places, names, strict=True)
        if place in usable[:MOST_TRIALS]
    ]
    n_lacking = (len(chosen) if len(chosen) > 1 else len(paths)) - len(usable)
    about = {_condition(sessions.drum_session(path), row) for path, row in usable}
    first = sessions.drum_session(paths[0])
    return TrialOverlay(
        about.pop() if len(about) == 1 else SEVERAL,
        taxel,
        is_ra,
        first.sensor_layout.n_taxels,
        tuple(shown),
        _left_out(n_lacking, len(usable)),
        any(sessions.drum_session(path).header.simulated for path, _ in usable),
    )


def _has(session: Session, row: int, taxel: int) -> bool:
    return taxel < session.sensor_layout.n_taxels and session.sample_count(row) > 0


def _shared(sessions: OpenSessions, paths: Sequence[str]) -> list[Place]:
    """Return the first trial of the condition that most sessions have, of a texture if it can be.

    None where no trial counts.
    """
    first: dict[tuple[str, float, float], Place] = {}
    n_sessions: Counter[tuple[str, float, float]] = Counter()
    for path in paths:
        session = sessions.drum_session(path)
        rows = session.committed().tolist()
        conditions = session.trials[list(CONDITION)][rows].tolist()
        n_sessions.update(dict.fromkeys(conditions, 1))
        for condition, row in zip(conditions, rows, strict=True):
            first.setdefault(condition, (path, row))
    ranks = {one: (n, one[0] != SMOOTH) for one, n in n_sessions.items()}
    return [first[max(ranks, key=ranks.__getitem__)]] if ranks else []


def _alike(sessions: OpenSessions, paths: Sequence[str], chosen: Place) -> list[Place]:
    """Return the chosen trial, and of each other session the committed one of its condition.

    Of several it is that of the nearest mounting and repeat.
    """
    row = sessions.drum_session(chosen[0]).trials[chosen[1]]
    found = []
    for path in paths:
        if path == chosen[0]:
            found.append(chosen)
            continue
        session = sessions.drum_session(path)
        rows = session.committed()
        others = session.trials[rows]
        is_same = np.all([others[name] == row[name] for name in CONDITION], axis=0)
        far = [np.abs(others[name][is_same] - row[name]) for name in ("repeat", "mount")]
        if is_same.any():
            found.append((path, int(rows[is_same][np.lexsort(far)[0]])))
    return found


def _condition(session: Session, row: int) -> str:
    trial = session.trials[row]
    return f"plate {trial['texture']}, {trial['speed_mm_s']:g} mm/s, {trial['force_g']:g} g"


def _left_out(n_lacking: int, n_usable: int) -> str:
    parts = []
    if n_lacking:
        parts.append(f"Sessions or trials without such a neuron or condition: {n_lacking}.")
    if n_usable > MOST_TRIALS:
        parts.append(f"Shown are the first {MOST_TRIALS} of {n_usable}: choose fewer for others.")
    return " ".join(parts)


def _names(sessions: OpenSessions, places: Sequence[Place]) -> list[str]:
    """Return session and number of each trial; of equal names with the folder they are in."""
    folders = {Path(path) for path, _ in places}
    is_clear = len({folder.name for folder in folders}) == len(folders)
    names = []
    for path, row in places:
        number = int(sessions.drum_session(path).trials[row]["trial_id"])
        folder = Path(path)
        name = folder.name if is_clear else f"{folder.parent.name}/{folder.name}"
        names.append(f"{name}, trial {number}")
    return names


def _read(
    sessions: OpenSessions, path: str, row: int, name: str, taxel: int, is_ra: bool
) -> OverlaidTrial:
    from rigctl.encoder.features import REFERENCE_SPEED_MM_S

    session = sessions.drum_session(path)
    train = taxel + is_ra * session.sensor_layout.n_taxels
    blocks = [
        (samples[:, taxel].astype(np.float64), spikes[:, train] > 0)
        for samples, spikes in EncodedTrial(session, row, sessions.taxel_range(path)).blocks()
    ]
    reading, has_spike = (np.concatenate(part) for part in zip(*blocks, strict=True))
    time_s = np.arange(len(reading)) / SAMPLE_RATE_HZ
    course = read_course(session, row)
    known = np.isfinite(course.force_s)
    force = thin_out(course.force_s[known], course.force_g[known], MOST_POINTS)
    spikes_s = forced_s = time_s[has_spike]
    taxel_range = _of_taxel(sessions.taxel_range(path), taxel)
    c = None if is_ra else _search_c(session, row, taxel, taxel_range)
    if c is not None:
        forced_s = _sa_spikes_s(reading, taxel_range, c)
    speed_mm_s = float(session.trials[row]["speed_mm_s"])
    scaled_s = forced_s * (speed_mm_s / REFERENCE_SPEED_MM_S if speed_mm_s > 0 else 1.0)
    drawn = thin_out(time_s, reading, MOST_POINTS)
    return OverlaidTrial(name, *force, *drawn, spikes_s, forced_s, scaled_s, c)


def _of_taxel(ranges: Normalisation, taxel: int) -> Normalisation:
    return replace(ranges, low=ranges.low[[taxel]], high=ranges.high[[taxel]])


def _sa_spikes_s(reading: Floats, taxel_range: Normalisation, c: float) -> Floats:
    """Return the times of a taxel's SA spikes with C on the current."""
    from rigctl.encoder.encoder import encode_trials

    samples = reading.astype(np.uint16)[:, None]
    (spikes,) = encode_trials([samples], taxel_range, sa_scale=np.array([[c]]))
    return spikes.train(0) / SAMPLE_RATE_HZ


def _search_c(session: Session, row: int, taxel: int, taxel_range: Normalisation) -> float | None:
    """Return the C of a trial's plate, speed and force for one taxel: equation 1."""
    from rigctl.encoder.force_matrix import REFERENCE_FORCE_G
    from rigctl.encoder.force_search import mean_sa_rates_hz, search_c

    own_g = float(session.trials[row]["force_g"])
    if own_g == REFERENCE_FORCE_G:
        return 1.0
    own, reference = (
        _alike_readings(session, row, taxel, force_g) for force_g in (own_g, REFERENCE_FORCE_G)
    )
    if not own or not reference:
        return None
    target_hz = mean_sa_rates_hz(reference, taxel_range)
    mean = np.array([taxel_range.apply(np.concatenate(reference)).mean()])
    return float(search_c(own, mean, target_hz, taxel_range).c[0])


def _alike_readings(
    session: Session, row: int, taxel: int, force_g: float
) -> list[NDArray[np.uint16]]:
    """Return readings of some committed trials of a trial's plate and speed, at a force."""
    trials, chosen = session.trials, session.committed()
    for name, value in (
        ("texture", trials[row]["texture"]),
        ("speed_mm_s", trials[row]["speed_mm_s"]),
        ("force_g", force_g),
    ):
        chosen = chosen[trials[name][chosen] == value]
    return [
        np.ascontiguousarray(session.samples(one, 0, SAMPLES_FOR_C)[:, [taxel]])
        for one in chosen[:TRIALS_FOR_C].tolist()
    ]
