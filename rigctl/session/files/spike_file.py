"""Write the spikes of trials as plain, self-describing HDF5 arrays, without pickles or code.

``docs/reference/encode.md`` shows the layout. The writer appends trials one after another, so
a file of any size needs little memory.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.session.files.analysis_file import LAYOUT_VERSION, SPIKES_LAYOUT
from rigctl.session.files.encoder_group import write_encoder
from rigctl.session.files.force_matrix_file import write_force
from rigctl.session.files.seal import SEALED, seal
from rigctl.session.format.data_sets import LIBVER
from rigctl.session.format.metadata.sensor_layout import ATTRIBUTE, SensorLayout
from rigctl.session.hdf5_file import (
    Attributes,
    write_array,
    write_attributes,
    write_text,
    write_texts,
)

SAMPLE_CHUNK = 1 << 16


@dataclass(frozen=True, slots=True)
class EncodingInfo:
    """Metadata of a file of spikes.

    ``trials``: columns by name, each with a unit, a meaning, and n values. ``layout``: that of the
    sensor, which names the trains. ``scaled_by``: C that multiplies the SA current: none, texture
    or blind. ``inputs``: a mapping for each source session.
    """

    made_utc: str
    software: str
    simulated: bool
    inputs: Sequence[dict[str, Any]]
    remarks: Sequence[str]
    trials: dict[str, tuple[str, str, NDArray[Any] | Sequence[str]]]
    layout: SensorLayout
    parameters: EncoderParameters
    normalisation: Normalisation
    scaled_by: str
    force: ForceMatrix | None
    layouts: dict[str, FeatureLayout]


class SpikeFileWriter:
    """Writer of one file; use it in a ``with`` block. May raise OSError."""

    def __init__(self, path: Path, encoding: EncodingInfo) -> None:
        self._path = path
        self._file = h5py.File(path, "x", libver=LIBVER)
        self._n_trials = len(encoding.trials["trial_id"][2])
        self._trial = self._spikes = 0
        try:
            self._write_header(encoding)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> SpikeFileWriter:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        self._file.close()
        if error is None:
            seal(self._path)

    def add(self, counts: NDArray[Any], samples: NDArray[Any]) -> None:
        """Append trials: spike counts of each train (n, n_trains), and all their samples."""
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
        """Write spike counts (n_trials, n_trains, n_windows) and the windows' real time."""
        group = self._file["windows"]
        axes = "trial, train, window"
        write_array(group, name, counts, "spikes", "spikes of each train in each window", axes)
        doc = "real time that the trial spends in the window"
        write_array(group, f"{name}_s", seconds, "s", doc, "trial, window")

    def _write_header(self, encoding: EncodingInfo) -> None:
        header: Attributes = {"layout": SPIKES_LAYOUT, "layout_version": LAYOUT_VERSION}
        header |= {"simulated": int(encoding.simulated), SEALED: 1}
        write_attributes(self._file, header)
        origin = "SIMULATED: not recorded at a real bench" if encoding.simulated else "a real bench"
        write_text(self._file, "origin", origin, "where the samples come from")
        write_text(self._file, "made_utc", encoding.made_utc, "wall clock, ISO 8601")
        write_text(self._file, "software", encoding.software, "version and commit of rigctl")
        inputs = json.dumps(list(encoding.inputs), ensure_ascii=False)
        write_text(self._file, "inputs", inputs, "JSON: a mapping for each session, in order")
        write_texts(self._file, "remarks", encoding.remarks, "what was left out or cut", "remark")
        names = [name for name, _ in encoding.layout.train_names()]
        write_texts(self._file, "rows", names, "trains in the order of a trial", "train")
        layout = json.dumps(encoding.layout.to_values(), ensure_ascii=False)
        write_text(self._file, ATTRIBUTE, layout, "JSON: rows, columns, layers of the sensor")
        self._write_trials(encoding)
        group = self._file.create_group("encoder")
        write_encoder(group, encoding.parameters, encoding.normalisation)
        doc = "C on the SA current: none; texture: that of the trial's own; blind: mean over all"
        write_text(group, "scaled_by", encoding.scaled_by, doc)
        if encoding.force is not None:
            write_force(self._file.create_group("c"), encoding.force)
        self._create_spikes(len(names))
        self._write_layouts(encoding.layouts)

    def _write_trials(self, encoding: EncodingInfo) -> None:
        group = self._file.create_group("trials")
        for name, (unit, doc, values) in encoding.trials.items():
            if isinstance(values, np.ndarray):
                write_array(group, name, values, unit, doc, "trial")
            else:
                write_texts(group, name, values, doc, "trial")

    def _create_spikes(self, n_trains: int) -> None:
        group = self._file.create_group("spikes")
        doc = "spikes of train r of trial i are sample[ptr[i, r]:ptr[i, r + 1]]"
        ptr = np.zeros((self._n_trials, n_trains + 1), np.int64)
        write_array(group, "ptr", ptr, "", doc, "trial, train + 1")
        sample = group.create_dataset(
            "sample", (0,), "<i4", maxshape=(None,), chunks=(SAMPLE_CHUNK,)
        )
        doc = "0-based sample of the trial in which v crossed, one entry a spike"
        write_attributes(sample, {"unit": "samples", "doc": doc, "shape": "(spike)"})

    def _write_layouts(self, layouts: dict[str, FeatureLayout]) -> None:
        group = self._file.create_group("windows")
        fields = ("n_windows", "scaled", "window_ms", "reference_mm_s")
        for name, windows in layouts.items():
            text = json.dumps({field: getattr(windows, field) for field in fields})
            write_text(group, f"{name}_layout", text, "JSON: which windows")
