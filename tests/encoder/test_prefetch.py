"""Trials side by side, of any lengths and taxels: each gives the same spikes as alone."""

from __future__ import annotations

import ctypes
import mmap
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.encoder import encoder
from rigctl.encoder.batch import count_spikes, single_bin_edges
from rigctl.encoder.encoder import encode_trial, encode_trials
from rigctl.encoder.kernel import TrialViews
from rigctl.encoder.kernel.spike_counters import LANE_OF_BYTE
from rigctl.encoder.kernel.transpose_bits import (
    LINE_WORDS,
    WORD,
    pack_words,
    transpose_words,
)
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, PRESETS, EncoderParameters
from rigctl.errors import WrongUse

HOT = replace(DEFAULT, sa_gain=3000.0, ra_gain=90.0)


def noise(rng: np.random.Generator, n: int, taxels: int) -> NDArray[np.uint16]:
    """Readings with sudden changes, so that SA and RA neurons both spike."""
    steps = rng.integers(0, 1024, (-(-n // 20), taxels))
    return np.repeat(steps, 20, axis=0)[:n].astype(np.uint16)


@pytest.mark.parametrize("tile_lanes", [1, 2048])
@pytest.mark.parametrize("taxels", [1, 5, 7, 8, 9, 16, 18, 33])
def test_a_trial_among_others_spikes_as_alone(
    taxels: int, tile_lanes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(encoder, "TILE_LANES", tile_lanes)
    rng, ranges = np.random.default_rng(taxels), Normalisation.full_scale(taxels)
    lengths = [300, 1, 31, 32, 33, 63, 64, 65, 128, 700, 0, 640]
    trials = [noise(rng, n, taxels) for n in lengths]
    together = encode_trials(trials, ranges)
    for samples, spikes in zip(trials, together, strict=True):
        alone = encode_trial(samples, ranges)
        np.testing.assert_array_equal(spikes.row_start, alone.row_start)
        np.testing.assert_array_equal(spikes.sample_index, alone.sample_index)
    assert sum(len(spikes.sample_index) for spikes in together) > 50


@pytest.mark.parametrize("scheme", [HOT, PRESETS["explicit"]])
def test_a_later_tile_may_have_several_spikes_in_a_sample(
    scheme: EncoderParameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first tile is silent; a later one needs memory for several spikes a sample."""
    monkeypatch.setattr(encoder, "TILE_LANES", 1)
    ranges = Normalisation.full_scale(3)
    silent = np.zeros((100, 3), np.uint16)
    loud = np.full((200, 3), 1023, np.uint16)
    trials = [silent, silent, loud, loud[:150], loud]
    together = encode_trials(trials, ranges, scheme)
    for samples, spikes in zip(trials, together, strict=True):
        alone = encoder.Encoder(ranges, scheme).encode(samples)
        counts = [np.bincount(spikes.train(row), minlength=len(samples)) for row in range(6)]
        np.testing.assert_array_equal(np.array(counts).T, alone)
    assert (np.bincount(together[2].train(0)).max() > 1) == (scheme is HOT)


@pytest.mark.parametrize("planes", [1, 2, 4])
@pytest.mark.parametrize("most", [0, 1, 2, 4])
@pytest.mark.parametrize("n", [1, 63, 64])
def test_bits_equal_the_counters(n: int, most: int, planes: int) -> None:
    rng = np.random.default_rng(n)
    counters = rng.integers(0, most + 1, (WORD, WORD)).astype(np.uint8)
    counters[0, 0] = most
    packed = np.full((planes, 2 * LINE_WORDS, WORD), 7, np.uint64)
    words = np.zeros((planes, 3 * WORD, 2 * LINE_WORDS), np.uint64)
    assert pack_words(counters.reshape(-1).copy(), n, packed, 3) == most
    transpose_words(packed, 4, words, WORD)
    bits = np.unpackbits(words[:, WORD : 2 * WORD, 3].copy().view(np.uint8), bitorder="little")
    counted = bits.reshape(planes, WORD, WORD).sum(axis=0)
    np.testing.assert_array_equal(counted[LANE_OF_BYTE, :n], np.minimum(counters[:n], planes).T)
    assert not words[:, :WORD].any() and not words[:, 2 * WORD :].any() and not counted[:, n:].any()


def test_words_are_transposed_to_their_train_and_time() -> None:
    n = 2 * LINE_WORDS + 1
    packed, words = (
        np.zeros((1, 3 * LINE_WORDS, WORD), np.uint64),
        np.zeros((1, WORD, 3 * LINE_WORDS), np.uint64),
    )
    rng = np.random.default_rng(1)
    counters = rng.integers(0, 2, (n, WORD, WORD)).astype(np.uint8)
    for word in range(n):
        pack_words(counters[word].reshape(-1), WORD, packed, word)
    transpose_words(packed, n, words, 0)
    bits = np.unpackbits(words[0, :, :n].copy().view(np.uint8), axis=1, bitorder="little")
    np.testing.assert_array_equal(bits[LANE_OF_BYTE], counters.reshape(n * WORD, WORD).T)


@pytest.mark.skipif(sys.platform == "win32", reason="protects pages as POSIX does")
def test_no_byte_outside_a_trial_is_read() -> None:
    """Encode trials between protected pages, in another process."""
    subprocess.run([sys.executable, "-m", __name__], check=True, timeout=300)


def between_protected_pages(n: int, taxels: int, at_end: bool) -> NDArray[np.uint16]:
    """Return memory for a trial that ends before a protected page, or begins behind one."""
    page, size = mmap.PAGESIZE, 2 * n * taxels
    inside = -(-size // page) * page
    buffer = mmap.mmap(-1, inside + 2 * page)
    memory = np.frombuffer(buffer, np.uint8)
    libc = ctypes.CDLL(None, use_errno=True)
    for start in (0, page + inside):
        if libc.mprotect(ctypes.c_void_p(memory.ctypes.data + start), page, 0) != 0:
            raise OSError(ctypes.get_errno(), "mprotect")
    start = page + (inside - size if at_end else 0)
    return memory[start : start + size].view(np.uint16).reshape(n, taxels)


def read_between_protected_pages() -> None:
    rng = np.random.default_rng(0)
    for taxels in (1, 7, 8, 9, 18, 33):
        trials = []
        for n in (1, 40, 64, 77, 300):
            for at_end in (False, True):
                trials.append(between_protected_pages(n, taxels, at_end))
                trials[-1][...] = noise(rng, n, taxels)
        ranges, some = Normalisation.full_scale(taxels), np.arange(taxels // 4, taxels)
        encode_trials(trials, ranges)
        count_spikes(trials, single_bin_edges(trials), ranges, taxels=some, sa_only=True)


if __name__ == "__main__":
    read_between_protected_pages()


def test_trials_in_one_memory_count_as_in_separate_arrays() -> None:
    rng = np.random.default_rng(7)
    memory = rng.integers(0, 1024, (500, 18)).astype(np.uint16)
    starts, lengths = np.array([300, 0, 120]), np.array([200, 97, 0])
    ranges = Normalisation.full_scale(18)
    apart = [memory[b : b + n].copy() for b, n in zip(starts, lengths, strict=True)]
    expected = count_spikes(apart, single_bin_edges(apart), ranges)
    for one in (memory, np.asfortranarray(memory), np.repeat(memory, 2, axis=1)[:, ::2]):
        rows = TrialViews.from_memory(one, starts, lengths)
        np.testing.assert_array_equal(count_spikes(rows, single_bin_edges(rows), ranges), expected)


@pytest.mark.parametrize(("begin", "n"), [(-1, 5), (0, -1), (6, 5), (11, 0)])
def test_trials_outside_their_memory_are_refused(begin: int, n: int) -> None:
    with pytest.raises(WrongUse, match="memory of 10 rows"):
        TrialViews.from_memory(np.zeros((10, 3), np.uint16), np.array([begin]), np.array([n]))
