"""Spikes of a set of trials as plain HDF5 arrays that explain themselves; no pickle, no code.

``docs/reference/encode.md`` shows the layout. Trials come one after another, so a file of any
size is written in little memory.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.session.files.encoder_group import put_encoder
from rigctl.session.files.force_matrix_file import put_force
from rigctl.session.format import layout
from rigctl.session.format.annotated_arrays import put_array, put_text, put_texts

LAYOUT, LAYOUT_VERSION = "rigctl-spikes", 1
SAMPLE_CHUNK = 1 << 16


@dataclass(frozen=True, slots=True)
class EncodingInfo:
    """All that a file of spikes says before its first spike.

    ``trials``: columns by name, each with a unit, a meaning, and n values. ``rows``: names of the
    trains in the order in which they stand. ``scaled_by``: C of which the SA current was a
    multiple: none, texture or blind. ``inputs``: a plain mapping for each session.
    """

    made_utc: str
    software: str
    simulated: bool
    inputs: Sequence[dict[str, Any]]
    remarks: Sequence[str]
    trials: dict[str, tuple[str, str, NDArray[Any] | Sequence[str]]]
    rows: Sequence[str]
    parameters: EncoderParameters
    normalisation: Normalisation
    scaled_by: str
    force: ForceMatrix | None
    layouts: dict[str, FeatureLayout]


def train_names(n_taxels: int) -> list[tuple[str, int]]:
    """Name and row in :class:`rigctl.values.Spikes` of each train, in the paper's order.

    SAI, RAI, SAII, RAII: the upper layer (the first half of the taxels), then the lower one;
    taxels count from 1. With an odd number of taxels there is one layer.
    """
    layers = [("I", range(n_taxels // 2)), ("II", range(n_taxels // 2, n_taxels))]
    if n_taxels % 2:
        layers = [("I", range(n_taxels))]
    return [
        (f"{channel}{layer}-{taxel + 1}", first + taxel)
        for layer, taxels in layers
        for channel, first in (("SA", 0), ("RA", n_taxels))
        for taxel in taxels
    ]


class SpikeFile:
    """Writes one file; use it in a ``with``. May raise OSError."""

    def __init__(self, path: Path, encoding: EncodingInfo) -> None:
        self._file = h5py.File(path, "x", libver=layout.LIBVER)
        self._n_trials = len(encoding.trials["trial_id"][2])
        self._trial = self._spikes = 0
        try:
            self._begin(encoding)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> SpikeFile:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def add(self, counts: NDArray[Any], samples: NDArray[Any]) -> None:
        """Append trials: spikes of each train (n, n_trains), and the samples of all of them."""
        n = len(counts)
        ptr = np.empty((n, counts.shape[1] + 1), np.int64)
        ends = np.cumsum(counts, dtype=np.int64).reshape(counts.shape)
        ptr[:, 1:] = self._spikes + ends
        ptr[:, 0] = self._spikes + np.concatenate([[0], ends[:-1, -1]])
        self._file["spikes/ptr"][self._trial : self._trial + n] = ptr
        sample = self._file["spikes/sample"]
        sample.resize(self._spikes + len(samples), axis=0)
        sample[self._spikes :] = samples
        self._trial, self._spikes = self._trial + n, self._spikes + len(samples)

    def add_windows(self, name: str, counts: NDArray[Any], seconds: NDArray[np.float64]) -> None:
        """Store spikes in windows (n_trials, n_trains, n_windows) and the windows' real time."""
        group = self._file["windows"]
        axes = "trial, train, window"
        put_array(group, name, counts, "spikes", "spikes of each train in each window", axes)
        doc = "real time that the trial spends in the window"
        put_array(group, f"{name}_s", seconds, "s", doc, "trial, window")

    def _begin(self, encoding: EncodingInfo) -> None:
        head: dict[str, str | int | float] = {"layout": LAYOUT, "layout_version": LAYOUT_VERSION}
        layout.describe(self._file, {**head, "simulated": int(encoding.simulated)})
        said = "SIMULATED: no bench stood behind it" if encoding.simulated else "a real bench"
        put_text(self._file, "origin", said, "where the samples come from")
        put_text(self._file, "made_utc", encoding.made_utc, "wall clock, ISO 8601")
        put_text(self._file, "software", encoding.software, "version and commit of rigctl")
        inputs = json.dumps(list(encoding.inputs), ensure_ascii=False)
        put_text(self._file, "inputs", inputs, "JSON: a mapping for each session, in order")
        put_texts(self._file, "remarks", encoding.remarks, "what was left out or cut", "remark")
        put_texts(self._file, "rows", encoding.rows, "trains in the order of a trial", "train")
        self._put_trials(encoding)
        group = self._file.create_group("encoder")
        put_encoder(group, encoding.parameters, encoding.normalisation)
        doc = "C on the SA current: none; texture: that of the trial's own; blind: mean over all"
        put_text(group, "scaled_by", encoding.scaled_by, doc)
        if encoding.force is not None:
            put_force(self._file.create_group("c"), encoding.force)
        self._put_spikes(len(encoding.rows))
        self._put_layouts(encoding.layouts)

    def _put_trials(self, encoding: EncodingInfo) -> None:
        group = self._file.create_group("trials")
        for name, (unit, doc, values) in encoding.trials.items():
            if isinstance(values, np.ndarray):
                put_array(group, name, values, unit, doc, "trial")
            else:
                put_texts(group, name, values, doc, "trial")

    def _put_spikes(self, n_trains: int) -> None:
        group = self._file.create_group("spikes")
        doc = "spikes of train r of trial i are sample[ptr[i, r]:ptr[i, r + 1]]"
        ptr = np.zeros((self._n_trials, n_trains + 1), np.int64)
        put_array(group, "ptr", ptr, "", doc, "trial, train + 1")
        sample = group.create_dataset(
            "sample", (0,), "<i4", maxshape=(None,), chunks=(SAMPLE_CHUNK,)
        )
        doc = "0-based sample of the trial in which v crossed, one entry a spike"
        layout.describe(sample, {"unit": "samples", "doc": doc, "shape": "(spike)"})

    def _put_layouts(self, layouts: dict[str, FeatureLayout]) -> None:
        group = self._file.create_group("windows")
        for name, windows in layouts.items():
            put_text(group, f"{name}_layout", json.dumps(_plain(windows)), "JSON: which windows")


def _plain(windows: FeatureLayout) -> dict[str, Any]:
    names = ("n_windows", "scaled", "window_ms", "reference_mm_s")
    return {name: getattr(windows, name) for name in names}
