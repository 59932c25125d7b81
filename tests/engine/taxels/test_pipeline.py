"""The sample pipeline: each sample encoded once, as offline, for any block size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from rigctl.encoder.encoder import Encoder, encode_trial
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT
from rigctl.encoder.reading import Reading, conductance, input_of_each
from rigctl.engine.live_file import LiveReader, LiveWriter
from rigctl.engine.pipeline import FAST, REAL_TIME, Batching, SamplePipeline
from rigctl.session.data_quality import BASELINE_SAMPLES
from rigctl.session.layout import ARRIVALS
from rigctl.session.session import Session
from rigctl.values import DRAWN_WIRING, Block, Gap
from tests.session.building import recorder

N = 1200
RISES = (300, 700)


def touch(n: int = N, lost: range = range(0)) -> Block:
    """Return a block with one press and two rises of the sync line."""
    counters = np.arange(n)
    wave = 400 + 300 * np.sin(counters / 40)[:, None] + 10 * np.arange(18)
    rises = sum((counters >= frame).astype(np.int64) for frame in RISES)
    kept = ~np.isin(counters, np.array(lost))
    gaps = (Gap(lost.start, len(lost), "lost on the line"),) if len(lost) else ()
    flags = np.zeros(n, np.uint8)
    samples = wave.astype(np.uint16)
    edges = (rises % 4).astype(np.uint8)
    return Block(counters[kept], samples[kept], flags[kept], edges[kept], gaps, 1.0)


def pieces(block: Block, length: int) -> Iterator[Block]:
    for first in range(0, len(block), length):
        part = slice(first, first + length)
        behind = {int(counter) for counter in block.counters[part]}
        inside = tuple(g for g in block.gaps if g.first_counter + g.count in behind)
        yield Block(
            block.counters[part],
            block.samples[part],
            block.flags[part],
            block.edges[part],
            inside,
            1.0 + first / 1000,
        )


@pytest.fixture
def live(tmp_path: Path) -> Iterator[LiveWriter]:
    writer = LiveWriter(tmp_path / "live.ring", 18, taxel_rows=4096, drum_rows=16)
    yield writer
    writer.close()


def encoder() -> Encoder:
    return Encoder(Normalisation.full_scale(18))


def run_pipeline(
    live: LiveWriter, block: Block, length: int, batching: Batching = REAL_TIME
) -> tuple[SamplePipeline, np.ndarray]:
    pipeline = SamplePipeline(encoder(), live, waits_for_disk=False, batching=batching)
    for piece in pieces(block, length):
        pipeline.add_block(piece)
    pipeline.flush()
    view = LiveReader(live.path)
    try:
        return pipeline, view.taxels(4096).spikes
    finally:
        view.close()


def offline(block: Block, starts: list[int]) -> np.ndarray:
    """Return the spikes of a new encoder for each section."""
    bounds = [0, *starts, len(block)]
    return np.concatenate([encoder().encode(block.samples[a:b]) for a, b in pairwise(bounds)])


@pytest.mark.parametrize("batching", [REAL_TIME, FAST])
@pytest.mark.parametrize("length", [1, 5, 7, 20, 33, 1200])
def test_live_spikes_equal_offline_spikes_from_each_rise(
    live: LiveWriter, length: int, batching: Batching
) -> None:
    block = touch()
    pipeline, spikes = run_pipeline(live, block, length, batching)
    expected = offline(block, [frame + 1 for frame in RISES])
    assert np.array_equal(spikes, expected)
    assert expected.sum() > 100
    assert pipeline.sample_count == N


def test_a_fast_rig_is_recorded_by_tenths_of_a_second_and_encoded_by_seconds(
    live: LiveWriter, tmp_path: Path
) -> None:
    pipeline = SamplePipeline(encoder(), live, waits_for_disk=False, batching=FAST)
    with recorder(tmp_path / "session") as session:
        session.begin_part("start", "A")
        pipeline.set_recorder(session)
        encoded = []
        pipeline.subscribe(lambda block: encoded.append(len(block)))
        for piece in pieces(touch(), 20):
            pipeline.add_block(piece)
        pipeline.set_recorder(None)
    with Session.open(tmp_path / "session") as recorded:
        rows = recorded.parts[0].rows(ARRIVALS)["first_row"]
    assert rows.tolist() == list(range(0, N, 100))
    assert encoded == [1000, 200]


@pytest.mark.parametrize("length", [1, 20, 1200])
def test_live_conductances_encode_as_those_of_the_recorded_counts(
    live: LiveWriter, length: int
) -> None:
    block, inputs = touch(), input_of_each(DRAWN_WIRING, 6, "rig.toml")
    block = replace(block, samples=block.samples // 3)
    parameters = replace(DEFAULT, reading=Reading.CONDUCTANCE)
    readings = conductance(block.samples, inputs)
    ranges = Normalisation.from_samples([readings], "all", Reading.CONDUCTANCE)
    pipeline = SamplePipeline(
        Encoder(ranges, parameters, inputs=inputs), live, waits_for_disk=False
    )
    for piece in pieces(block, length):
        pipeline.add_block(piece)
    pipeline.flush()
    view = LiveReader(live.path)
    shown = view.taxels(4096)
    view.close()
    bounds = [0, *(frame + 1 for frame in RISES), N]
    for first, end in pairwise(bounds):
        spikes = encode_trial(readings[first:end], ranges, parameters)
        for row in range(36):
            found = np.repeat(np.arange(end - first), shown.spikes[first:end, row])
            assert np.array_equal(found, spikes.train(row))
    assert np.array_equal(shown.samples, block.samples), "the live data hold counts"
    assert shown.spikes.sum() > 100


def test_the_encoder_resets_after_a_gap(live: LiveWriter) -> None:
    block = touch(lost=range(500, 520))
    pipeline, spikes = run_pipeline(live, block, 20)
    assert np.array_equal(spikes, offline(block, [301, 500, 681]))
    assert (pipeline.gap_count, pipeline.lost_samples) == (1, 20)


@pytest.mark.parametrize("length", [1, 5, 20, 1200])
@pytest.mark.parametrize("lost", [[500], [500, 501, 502], [320, 510, 511, 699, 702, 703]])
def test_up_to_three_lost_samples_are_encoded_as_the_one_before(
    live: LiveWriter, lost: list[int], length: int
) -> None:
    whole = touch()
    kept = np.setdiff1d(np.arange(N), lost)
    held = whole.samples[kept[np.searchsorted(kept, np.arange(N), side="right") - 1]]
    expected = offline(replace(whole, samples=held), [301, 701])
    arrays = ("counters", "samples", "flags", "edges")
    missing = replace(whole, **{name: getattr(whole, name)[kept] for name in arrays})
    _, spikes = run_pipeline(live, missing, length)
    assert len(spikes) == len(kept)
    assert np.array_equal(np.cumsum(spikes, axis=0), np.cumsum(expected, axis=0)[kept])


def test_sample_times_are_even_though_blocks_arrive_unevenly(live: LiveWriter) -> None:
    pipeline = SamplePipeline(encoder(), live, waits_for_disk=False)
    random = np.random.default_rng(2)
    for piece in pieces(touch(), 20):
        late = float(random.uniform(0, 0.008))
        pipeline.add_block(
            Block(
                piece.counters,
                piece.samples,
                piece.flags,
                piece.edges,
                (),
                10 + piece.counters[-1] / 1000 + late,
            )
        )
    view = LiveReader(live.path)
    times = view.taxels(4096).time_s
    view.close()
    assert np.all(np.diff(times) > 0.0005)
    assert abs(times[-1] - (10 + 1.199)) < 0.01


def test_a_reboot_of_the_board_resets_the_pipeline(live: LiveWriter) -> None:
    pipeline = SamplePipeline(encoder(), live, waits_for_disk=False)
    pipeline.trial_cutter.expect(100)
    pipeline.add_block(touch())
    pipeline.add_block(touch(n=40))
    pipeline.flush()
    assert pipeline.sample_count == N + 40
    assert pipeline.trial_cutter.trial is None


@pytest.mark.parametrize("batching", [REAL_TIME, FAST])
def test_a_baseline_is_of_the_first_readings_after_the_lift(
    live: LiveWriter, batching: Batching
) -> None:
    pipeline = SamplePipeline(encoder(), live, waits_for_disk=False, batching=batching)
    block = touch(n=300)
    pipeline.trial_cutter.expect(1000)
    for piece in pieces(block, 20):
        pipeline.add_block(piece)
    pipeline.flush()
    baseline = pipeline.trial_cutter.baseline
    assert baseline is not None
    assert baseline.tolist() == block.samples[:BASELINE_SAMPLES].mean(axis=0).tolist()
