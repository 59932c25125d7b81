"""Disturb a list of frames on their way: drops, repeats, swaps of neighbours, flipped bits."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

LONGEST_BURST = 30
LATEST_REPEAT = 3
"""Frames that a repeat may come behind its original."""


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Shares of the frames that are dropped, repeated, swapped with the next, or hit by a bit."""

    name: str
    drops: float = 0.0
    repeats: float = 0.0
    swaps: float = 0.0
    flips: float = 0.0

    def apply(self, frames: list[bytes], rng: np.random.Generator) -> list[bytes]:
        """Return what arrives. A tenth of the drops are the first of a burst."""
        n = len(frames)
        kept = [frame for frame, keep in zip(frames, self._kept(n, rng), strict=True) if keep]
        kept = self._swapped(kept, rng)
        kept = self._repeated(kept, rng)
        for i in np.flatnonzero(rng.random(len(kept)) < self.flips).tolist():
            hit = bytearray(kept[i])
            hit[int(rng.integers(len(hit)))] ^= 1 << int(rng.integers(8))
            kept[i] = bytes(hit)
        return kept

    def _kept(self, n: int, rng: np.random.Generator) -> list[bool]:
        kept = np.ones(n, np.bool_)
        for i in np.flatnonzero(rng.random(n) < self.drops).tolist():
            burst = int(rng.integers(2, LONGEST_BURST)) if rng.random() < 0.1 else 1
            kept[i : i + burst] = False
        return kept.tolist()

    def _swapped(self, frames: list[bytes], rng: np.random.Generator) -> list[bytes]:
        for i in np.flatnonzero(rng.random(max(len(frames) - 1, 0)) < self.swaps).tolist():
            frames[i], frames[i + 1] = frames[i + 1], frames[i]
        return frames

    def _repeated(self, frames: list[bytes], rng: np.random.Generator) -> list[bytes]:
        out: list[bytes] = []
        late: list[tuple[int, bytes]] = []
        repeats = rng.random(len(frames)) < self.repeats
        behind = rng.integers(0, LATEST_REPEAT + 1, len(frames))
        for i, frame in enumerate(frames):
            out.append(frame)
            if repeats[i]:
                late.append((i + int(behind[i]), frame))
            out += [again for due, again in late if due == i]
            late = [entry for entry in late if entry[0] > i]
        return out


DISTURBANCES = (
    Disturbance("none"),
    Disturbance("1 % dropped", drops=0.01),
    Disturbance("1 % repeated", repeats=0.01),
    Disturbance("1 % swapped", swaps=0.01),
    Disturbance("1 % with a flipped bit", flips=0.01),
    Disturbance("1 % of each", 0.01, 0.01, 0.01, 0.01),
    Disturbance("10 % of each", 0.1, 0.1, 0.1, 0.1),
)


def cut(wire: bytes, rng: np.random.Generator, longest: int = 2000) -> list[bytes]:
    """Return the bytes in slices of any length."""
    edges = np.cumsum(rng.integers(1, longest, 2 * len(wire) // longest + 2))
    inside = [0, *edges[edges < len(wire)].tolist(), len(wire)]
    return [wire[a:b] for a, b in pairwise(inside)]
