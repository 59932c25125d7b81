"""Files of the analysis: open models and files of spikes, and write the spikes of trials.

All are plain, self-describing HDF5 arrays, without pickles or code. ``docs/reference/encode.md``
shows the layout of a file of spikes; its writer appends trials one after another, so a file of any
size needs little memory.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypedDict

import h5py
import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from rigctl.config.rig_config import MAX_TAXELS
from rigctl.config.text_file import open_file, refuse_link_outside
from rigctl.encoder.features import REFERENCE_SPEED_MM_S, FeatureLayout
from rigctl.encoder.force_matrix import ForceMatrix
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import EncoderParameters
from rigctl.encoder.reading import Reading
from rigctl.errors import DiskFault, SessionError, WrongUse
from rigctl.session.hdf5_file import (
    Attributes,
    Hdf5File,
    damage,
    parse_objects,
    write_array,
    write_attributes,
    write_text,
    write_texts,
)
from rigctl.session.layout import LIBVER
from rigctl.session.part import part_paths
from rigctl.session.sensor_layout import ATTRIBUTE, SensorLayout

MODEL_LAYOUT, SPIKES_LAYOUT = "rigctl-model", "rigctl-spikes"
FINGER_MODEL_LAYOUT = "rigctl-finger-model"
_KINDS: dict[tuple[str, ...], str] = {
    (MODEL_LAYOUT,): "model",
    (FINGER_MODEL_LAYOUT,): "model of the finger",
}
LAYOUT_VERSION = 1


@contextmanager
def open_analysis_file(path: Path, hint: str, *layouts: str) -> Iterator[Hdf5File]:
    """Open a file of one of ``layouts``, by default a model or a file of spikes.

    Raises SessionError for a missing, damaged, newer or other file, and for one with values that
    the ``with`` block finds impossible. ``hint``: which file to give instead.
    """
    kind = _KINDS.get(layouts, "model or a spikes.h5")
    try:
        file = Hdf5File(path)
    except SessionError as error:
        raise SessionError(f"{error}: {hint}") from error
    with file:
        _check_layout(file, kind, hint, layouts or (MODEL_LAYOUT, SPIKES_LAYOUT))
        try:
            yield file
        except SessionError:
            raise
        except WrongUse as error:
            raise SessionError(f"{path} is not a {kind}, or is damaged: {error}") from error


def _check_layout(file: Hdf5File, kind: str, hint: str, layouts: tuple[str, ...]) -> None:
    attributes = file.attributes()
    if attributes.get("layout") not in layouts:
        raise SessionError(f"{file.path} is an HDF5 file, but not a {kind}: {hint}")
    version = attributes.get("layout_version")
    if version != LAYOUT_VERSION:
        raise SessionError(
            f"{file.path} has layout version {version}, this program reads {LAYOUT_VERSION}: "
            "use the rigctl that made it, or make it again"
        )


def check_output_path(path: Path) -> None:
    """Raise WrongUse if the file exists or its folder does not."""
    if path.exists():
        raise WrongUse(f"{path} already exists: name another file, or remove it")
    if not path.parent.is_dir():
        raise WrongUse(f"{path.parent} is not a folder: create it, or name another file")


@contextmanager
def new_analysis_file(path: Path) -> Iterator[Any]:
    """Open a new file that appears complete or not at all. Raises WrongUse or DiskFault."""
    check_output_path(path)
    partial = path.with_name(f"{path.name}.partial")
    try:
        with h5py.File(partial, "w", libver=LIBVER, locking=False) as file:
            yield file
        partial.rename(path)
    except OSError as error:
        raise DiskFault(f"{path} cannot be written ({error}): choose another place") from error
    finally:
        partial.unlink(missing_ok=True)


def content_digest(folder: Path) -> str:
    """Return the SHA-256 of the hexadecimal SHA-256 of each part's bytes, in order.

    The writer never changes a closed part, so equal recordings have equal digests wherever they
    are stored; one that is damaged or lacks a part has another. Raises SessionError for another
    kind of folder or one that it cannot read.
    """
    total = hashlib.sha256()
    for path in part_paths(folder):
        refuse_link_outside(path, SessionError)
        try:
            with open_file(path, SessionError) as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise SessionError(f"{path} cannot be read: {error.strerror or error}") from error
        total.update(digest.encode())
    return total.hexdigest()


def load_inputs(path: Path) -> tuple[dict[str, Any], ...]:
    """Return a mapping for each source session. Raises SessionError for a damaged or other file."""
    with open_analysis_file(path, "give one that rigctl made") as file:
        return read_inputs(file)


def read_inputs(file: Hdf5File) -> tuple[dict[str, Any], ...]:
    """Return the source sessions in an open file. Raises SessionError for missing or wrong ones."""
    return read_source_sessions(file, "training/inputs" if file.has("training") else "inputs")


class SourceSession(TypedDict, total=False):
    """The values of a source session that the program uses."""

    path: str
    content: str
    rig: str
    plan_hash: str
    begun_utc: str
    seed: int | None
    simulation_seed: int | None
    trials_committed: int | None
    n_taxels: Annotated[int, Meta(ge=0, le=MAX_TAXELS)] | None
    wiring: list[int] | None
    scaling: list[list[float]]


def read_source_sessions(file: Hdf5File, path: str) -> tuple[dict[str, Any], ...]:
    """Return a mapping for each source session in the text ``path``.

    Raises SessionError for damage and for values of another type than the program uses.
    """
    sources = parse_objects(file.text(path), file.path, path)
    try:
        msgspec.convert(sources, tuple[SourceSession, ...])
    except msgspec.ValidationError as error:
        raise damage(file.path, path, f"has a wrong value of a session: {error}") from error
    return sources


HIGHEST_RATE_HZ = 1e6
ENCODER_UNITS = {
    "a": "1/ms", "b": "1/ms", "c_mv": "mV", "d": "mV/ms", "quadratic": "1/(mV ms)",
    "linear": "1/ms", "constant": "mV/ms", "threshold_mv": "mV", "start_v_mv": "mV",
    "start_u": "mV/ms", "substep_ms": "ms", "sa_gain": "mV/ms", "ra_gain": "mV",
    "ra_lowpass_hz": "Hz", "sample_rate_hz": "Hz",
}  # fmt: skip


LATER_PARAMETERS = (("ra_filter", "ra_order", "ra_derivative"), ("reading",))
"""Parameters that files of older versions lack; those were encoded with the default."""


def write_encoder(group: Any, parameters: EncoderParameters, ranges: Normalisation) -> None:
    """Write every parameter and the ranges."""
    for name, value in parameters.as_dict().items():
        doc = f"EncoderParameters.{name}"
        if isinstance(value, str):
            write_text(group, name, value, doc)
        else:
            write_array(group, name, value, ENCODER_UNITS.get(name, ""), doc)
    unit = ranges.reading.unit
    write_array(group, "taxel_low", ranges.low, unit, "reading that becomes 0", "taxel")
    write_array(group, "taxel_high", ranges.high, unit, "reading that becomes 1", "taxel")
    write_text(group, "taxel_range_source", ranges.source, "what the ranges are from")


def read_parameters(file: Hdf5File, group: str) -> EncoderParameters:
    """Return the parameters in a group. Raises SessionError or WrongUse for invalid ones."""
    defaults = EncoderParameters().as_dict()
    for names in LATER_PARAMETERS:
        if not any(file.has(f"{group}/{name}") for name in names):
            defaults = {k: v for k, v in defaults.items() if k not in names}
    values = {name: _value(file, f"{group}/{name}", kind) for name, kind in defaults.items()}
    parameters = EncoderParameters.from_dict(values)
    if parameters.sample_rate_hz > HIGHEST_RATE_HZ:
        raise WrongUse(f"encoder parameter sample_rate_hz is {parameters.sample_rate_hz:g}")
    return parameters


def read_ranges(file: Hdf5File, group: str) -> Normalisation:
    """Return the taxel ranges in a group. Raises SessionError or WrongUse for invalid ones."""
    low, high = (file.array(f"{group}/taxel_{side}", 1, np.uint16) for side in ("low", "high"))
    if not 1 <= len(low) <= MAX_TAXELS:
        raise WrongUse(f"{group}/taxel_low has {len(low)} taxels")
    source = file.text(f"{group}/taxel_range_source")
    return Normalisation(low, high, source, read_reading(file, group))


def read_reading(file: Hdf5File, group: str) -> Reading:
    """Return the reading that ranges and neurons in a group take; older files have counts."""
    path = f"{group}/reading"
    if not file.has(path):
        return Reading.COUNTS
    if file.text(path) not in list(Reading):
        raise WrongUse(f"{path} is {file.text(path)!r}, not one of {', '.join(Reading)}")
    return Reading(file.text(path))


def load_ranges(path: Path) -> Normalisation:
    """Return the taxel ranges of a spikes or model file. Raises SessionError for another file."""
    with open_analysis_file(path, "--ranges takes all, training or one") as file:
        ranges = read_ranges(file, "encoder")
    return replace(ranges, source=f"those of {path}: {ranges.source}")


def _value(file: Hdf5File, path: str, default: Any) -> str | float | int | bool:
    """Return a parameter of the type of its default."""
    if isinstance(default, str):
        return file.text(path)
    if isinstance(default, bool):
        return bool(file.integer(path))
    return file.integer(path) if isinstance(default, int) else file.number(path)


AXES = "texture, taxel, speed, force"
EVALUATIONS_DOC = "encodings in the search; one of some trials counts as their share of samples"
STATUS_DOC = "-1 absent, 0 reference force, 1 converged, 2 limited to 5, 3 at a jump of the rate"


def write_force(group: Any, force: ForceMatrix) -> None:
    """Write C with the results of its search."""
    write_texts(
        group, "textures", force.textures, "names, in the order of the first axis", "texture"
    )
    write_array(group, "speeds_mm_s", np.array(force.speeds_mm_s), "mm/s", "planned", "speed")
    write_array(group, "forces_g", np.array(force.forces_g), "g", "planned", "force")
    write_array(group, "reference_g", force.reference_g, "g", "force with the target SA rates")
    write_array(group, "c", force.c, "none", "factor on the SA current", AXES)
    write_array(group, "status", force.status, "none", STATUS_DOC, AXES)
    write_array(group, "residual_hz", force.residual_hz, "Hz", "rate reached less the target", AXES)
    write_array(group, "evaluations", force.evaluations, "none", EVALUATIONS_DOC, AXES)
    if force.rate_hz is not None:
        write_array(group, "rate_hz", force.rate_hz, "Hz", "mean SA rate reached with C", AXES)


def read_force(file: Hdf5File, group: str) -> ForceMatrix:
    """Return C in a group. Raises SessionError or WrongUse if there is none or an invalid one."""
    rates = f"{group}/rate_hz"
    force = ForceMatrix(
        file.texts(f"{group}/textures"),
        tuple(file.array(f"{group}/speeds_mm_s", 1).tolist()),
        tuple(file.array(f"{group}/forces_g", 1).tolist()),
        file.number(f"{group}/reference_g"),
        file.array(f"{group}/c", 4),
        file.array(f"{group}/status", 4, np.int8),
        file.array(f"{group}/residual_hz", 4),
        file.array(f"{group}/evaluations", 4),
        file.array(rates, 4) if file.has(rates) else None,
    )
    _check(force)
    return force


def _check(force: ForceMatrix) -> None:
    conditions = len(force.textures), len(force.speeds_mm_s), len(force.forces_g)
    shape = (conditions[0], force.c.shape[1], *conditions[1:])
    measured = [force.residual_hz] if force.rate_hz is None else [force.residual_hz, force.rate_hz]
    shapes = {force.status.shape, force.evaluations.shape, *(array.shape for array in measured)}
    if {force.c.shape, *shapes} != {shape} or not np.isfinite(force.c).all():
        raise WrongUse("C lacks a finite value for some texture, taxel, speed or force")
    if not all(np.isfinite(array).all() for array in measured):
        raise WrongUse("C has an SA rate that is not finite")
    if not np.isfinite([*force.speeds_mm_s, *force.forces_g]).all():
        raise WrongUse("C has a speed or a force that is not finite")


def load_force(path: Path, reading: Reading) -> tuple[ForceMatrix, tuple[dict[str, Any], ...]]:
    """Return C of a model or spikes file, and the source sessions of its search.

    ``reading``: what the encoder takes that is to use this C.

    Raises SessionError for a newer, damaged or other file and for one without C, WrongUse for a C
    of another reading.
    """
    with open_analysis_file(path, "--c takes a model or a spikes.h5") as file:
        if not file.has("c"):
            raise SessionError(
                f"{path} contains no C: name a model of a Force Scaled representation, or a "
                "spikes.h5 of sessions with several forces"
            )
        if (searched_on := read_reading(file, "encoder")) is not reading:
            raise WrongUse(
                f"{path}: its C was searched with reading = {searched_on}, this encoder takes "
                f"{reading}: use the same reading, or a C that was searched with it"
            )
        return read_force(file, "c"), read_inputs(file)


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
        self._file = h5py.File(path, "x", libver=LIBVER, locking=False)
        self._n_trials = len(encoding.trials["trial_id"][2])
        self._trial = self._spikes = 0
        try:
            self._write_header(encoding)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> SpikeFileWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(
        self, counts: NDArray[Any], samples: NDArray[Any], scaled_us: NDArray[np.int64]
    ) -> None:
        """Append trials: spike counts of each train (n, n_trains), and all their samples.

        ``scaled_us``: the time of each spike in µs at the reference speed.
        """
        n = len(counts)
        ptr = np.empty((n, counts.shape[1] + 1), np.int64)
        ends = np.cumsum(counts, dtype=np.int64).reshape(counts.shape)
        ptr[:, 1:] = self._spikes + ends
        ptr[:, 0] = self._spikes + np.concatenate([[0], ends[:-1, -1]])
        self._file["spikes/ptr"][self._trial : self._trial + n] = ptr
        for name, values in (("sample", samples), ("scaled_us", scaled_us)):
            stored = self._file[f"spikes/{name}"]
            stored.resize(self._spikes + len(values), axis=0)
            stored[self._spikes :] = values
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
        header["simulated"] = int(encoding.simulated)
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
        self._write_trains(encoding.layout)
        self._write_trials(encoding)
        group = self._file.create_group("encoder")
        write_encoder(group, encoding.parameters, encoding.normalisation)
        doc = "C on the SA current: none; texture: that of the trial's own; blind: mean over all"
        write_text(group, "scaled_by", encoding.scaled_by, doc)
        if encoding.force is not None:
            write_force(self._file.create_group("c"), encoding.force)
        reference_mm_s = next(
            (one.reference_mm_s for one in encoding.layouts.values()), REFERENCE_SPEED_MM_S
        )
        self._create_spikes(len(names), reference_mm_s)
        self._write_layouts(encoding.layouts)

    def _write_trains(self, layout: SensorLayout) -> None:
        """Write what each train is, in the order of ``rows``."""
        group, rows = self._file.create_group("train"), [row for _, row in layout.train_names()]
        taxels = [row % layout.n_taxels for row in rows]
        layers = [layout.layers[layout.layer_of(taxel)] for taxel in taxels]
        write_texts(group, "layer", layers, "name of its layer", "train")
        receptors = ["SA" if row < layout.n_taxels else "RA" for row in rows]
        write_texts(group, "receptor", receptors, "SA or RA", "train")
        numbers = np.array(taxels, np.int32) + 1
        write_array(group, "taxel", numbers, "", "number over all layers, from 1", "train")

    def _write_trials(self, encoding: EncodingInfo) -> None:
        group = self._file.create_group("trials")
        for name, (unit, doc, values) in encoding.trials.items():
            if isinstance(values, np.ndarray):
                write_array(group, name, values, unit, doc, "trial")
            else:
                write_texts(group, name, values, doc, "trial")

    def _create_spikes(self, n_trains: int, reference_mm_s: float) -> None:
        group = self._file.create_group("spikes")
        doc = "spikes of train r of trial i are sample[ptr[i, r]:ptr[i, r + 1]]"
        ptr = np.zeros((self._n_trials, n_trains + 1), np.int64)
        write_array(group, "ptr", ptr, "", doc, "trial, train + 1")
        docs = {
            "sample": ("samples", "0-based sample of the trial in which v crossed, one a spike"),
            "scaled_us": ("µs", f"time of that sample × speed / {reference_mm_s:g} mm/s"),
        }
        for name, (unit, doc) in docs.items():
            stored = group.create_dataset(
                name, (0,), "<i4", maxshape=(None,), chunks=(SAMPLE_CHUNK,)
            )
            write_attributes(stored, {"unit": unit, "doc": doc, "shape": "(spike)"})

    def _write_layouts(self, layouts: dict[str, FeatureLayout]) -> None:
        group = self._file.create_group("windows")
        fields = ("n_windows", "scaled", "window_ms", "reference_mm_s")
        for name, windows in layouts.items():
            text = json.dumps({field: getattr(windows, field) for field in fields})
            write_text(group, f"{name}_layout", text, "JSON: which windows")
