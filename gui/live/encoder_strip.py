"""Choose the encoder of the live views, and the factor on its SA current."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QCheckBox, QLineEdit, QWidget

from gui.live.live_data import LiveData
from gui.widgets.background import Background
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import ElidedLabel, label, show_text
from gui.widgets.layouts import FlowLayout, combo_box, vbox
from gui.widgets.number_box import NumberBox
from gui.widgets.typed_paths import typed_path
from rigctl.boards.taxel_frames import Flag
from rigctl.encoder.force_gain import ForceScaling
from rigctl.encoder.force_matrix import ForceMatrix
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import PRESETS, EncoderParameters, preset
from rigctl.encoder.reading import Reading
from rigctl.engine.rpc.messages import EngineStatus
from rigctl.errors import WrongUse
from rigctl.session.sensor_passport import SensorPassport, gain_source, load_passport

if TYPE_CHECKING:
    from rigctl.encoder.encoder import GainOf


class Recoder:
    """Encodes samples as they arrive; starts from rest after a gap and where sync rises.

    ``sa_scale``: float64 (n_taxels,), C, or None for 1; ``inputs``: the input of each taxel, for
    conductances; ``gain_of``: gives the gain on the SA current for taxel ranges, None for 1.
    """

    def __init__(
        self,
        ranges: Normalisation,
        parameters: EncoderParameters,
        sa_scale: NDArray[np.float64] | None,
        inputs: tuple[int, ...] = (),
        gain_of: GainOf | None = None,
    ) -> None:
        # The compiler of the encoder takes long to load: not before somebody encodes anew.
        from rigctl.encoder.encoder import Encoder

        self._encoder = Encoder(ranges, parameters, sa_scale, inputs, gain_of)
        self._encoder.warm_up()
        self._next = -1
        self._has_sync = True

    def set_ranges(self, ranges: Normalisation) -> None:
        """Use other ranges from the next sample on."""
        if not ranges.has_ranges_of(self._encoder.normalisation):
            self._encoder.normalisation = ranges

    def __call__(
        self,
        positions: NDArray[np.int64],
        samples: NDArray[np.uint16],
        flags: NDArray[np.uint8],
    ) -> NDArray[np.uint8]:
        """Return the spikes of n samples, uint8 (n, 2·n_taxels): SA, then RA."""
        sync = (flags & Flag.SYNC) > 0
        rises = sync & ~np.concatenate([[self._has_sync], sync[:-1]])
        apart = np.diff(positions, prepend=self._next - 1) != 1
        bounds = [*np.flatnonzero(rises | apart).tolist(), len(positions)]
        self._next, self._has_sync = int(positions[-1]) + 1, bool(sync[-1])
        parts = [self._encode(samples[: bounds[0]])]
        for first, end in pairwise(bounds):
            self._encoder.reset()
            parts.append(self._encode(samples[first:end]))
        return np.concatenate(parts)

    def _encode(self, samples: NDArray[np.uint16]) -> NDArray[np.uint8]:
        if not len(samples):
            return np.zeros((0, 2 * samples.shape[1]), np.uint8)
        return self._encoder.encode(np.ascontiguousarray(samples))


ENGINE, NO_C, BLIND, OF_PLATE, TYPED = "engine", "none", "blind", "plate", "typed"
GAINS = {
    ForceScaling.DIVIDED: "divided by all taxels, which knows nothing",
    ForceScaling.CALIBRATED: "calibrated by the sensor's passport",
}
_HIGHEST_C = 20.0
_LIVE_PRESETS = tuple(name for name, known in PRESETS.items() if not known.filters_whole_trials)


_LONGEST_NAME = 14  # letters


class EncoderStrip(QWidget):
    """Replaces the spikes of the views from now on; the record and its spikes stay as they are."""

    path_requested = Signal(object, object)
    """A :class:`PathKind`, and the function that takes the chosen path."""
    changed = Signal(str)
    """What the views show from now on, in words."""
    per_mm_toggled = Signal(bool)
    """Whether to show spikes per mm of texture instead of per second."""

    def __init__(self, data: LiveData) -> None:
        super().__init__()
        self._data = data
        self._force: ForceMatrix | None = None
        self._passport: SensorPassport | None = None
        self._background = Background("rigctl-live-c")
        self._condition = ("", 0.0, 0.0)
        self.preset = combo_box({"the engine's": ENGINE, **{name: name for name in _LIVE_PRESETS}})
        scalings = {"no C": NO_C, "C, blind": BLIND, "C of the plate": OF_PLATE, "C, typed": TYPED}
        scalings |= {kind.capitalize(): kind for kind in GAINS}
        self.scaling = combo_box(scalings)
        self.scaling.setToolTip(
            "What the scaling knows: C of the plate its name, force and speed; C, blind force and\n"
            "speed; Divided nothing; Calibrated the sensor's passport, a sensor.json"
        )
        for box in (self.preset, self.scaling):
            box.setMinimumContentsLength(_LONGEST_NAME)
        self.c = NumberBox(minimum=0.01, maximum=_HIGHEST_C, value=1.0, singleStep=0.1)
        self.c.setPrefix("C = ")
        self.c.setToolTip("One factor on the SA current of all taxels, without a unit")
        self.c.setKeyboardTracking(False)
        self.model = QLineEdit()
        self.model.setPlaceholderText("model file with C")
        self.sentence = ElidedLabel("", "muted")
        browse = browse_button(self.path_requested, PathKind.MODEL, self._choose_model)
        self._of_model = (self.model, browse)
        first = (label("Encoder"), self.preset, label("Force scaling"), self.scaling)
        self.model.setMinimumWidth(130)
        row = FlowLayout(*first, self.c, self.model, browse)
        self.per_mm = QCheckBox("speed scaling: rates per mm")
        self.per_mm.setToolTip(
            "Spikes in the last second divided by the texture that passed in it, so that rates at\n"
            "different speeds compare; nothing while less than 1 mm passes"
        )
        self.per_mm.toggled.connect(self.per_mm_toggled)
        self.setLayout(vbox(row, self.per_mm, self.sentence, spacing=2, margins=(6, 0, 6, 0)))
        self.preset.activated.connect(lambda _: self._apply())
        self.scaling.activated.connect(lambda _: self._choose_scaling())
        self.c.valueChanged.connect(lambda _: self._apply())
        self.model.editingFinished.connect(self._load)
        self._show_fields()

    def show_status(self, status: EngineStatus) -> None:
        """Take plate, speed and force, of which C depends."""
        condition = (status.texture or "", status.speed_set_mm_s, status.force_set_g)
        if condition != self._condition:
            self._condition = condition
            if self._force is not None and self.scaling.currentData() != NO_C:
                self._apply()

    def set_ranges(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
        """Use these ranges of the taxels, in counts, (n_taxels,) each."""
        if isinstance(recode := self._data.history.recode, Recoder):
            recode.set_ranges(_ranges(low, high, self._data.reading))

    def apply_reading(self) -> None:
        """Encode the reading that the views show from now on; C and passport are of one."""
        if self.scaling.currentData() in (BLIND, OF_PLATE, ForceScaling.CALIBRATED):
            self._load()
        elif self._data.history.recode is not None or self._data.has_own_range:
            self._apply()

    def close_files(self) -> None:
        """Wait for a model that is being read, as before the window closes."""
        self._background.close()

    def _choose_scaling(self) -> None:
        self._show_fields()
        self._load()

    def _show_fields(self) -> None:
        """Show the number to type, or the file to read C or the passport from."""
        scaling = self.scaling.currentData()
        self.c.setVisible(scaling == TYPED)
        for field in self._of_model:
            field.setVisible(scaling not in (TYPED, ForceScaling.DIVIDED))
        is_calibrated = scaling == ForceScaling.CALIBRATED
        named = "sensor.json of the sensor" if is_calibrated else "model file with C"
        self.model.setPlaceholderText(named)

    def _choose_model(self, path: str) -> None:
        self.model.setText(path)
        self._load()

    def _load(self) -> None:
        """Read C or the passport in a thread, as a disk may be slow."""
        path, scaling = self.model.text().strip(), self.scaling.currentData()
        if scaling in (NO_C, TYPED, ForceScaling.DIVIDED) or not path:
            self._take(None)
            return
        read = self._read_passport if scaling == ForceScaling.CALIBRATED else self._read
        self._background.run(lambda: read(path), self._take, partial(self._take, None))

    def _read_passport(self, path: str) -> SensorPassport:
        """Return a sensor's passport. Raises RigctlError, also for another sensor's."""
        return load_passport(typed_path(path), len(self._data.low))

    def _read(self, path: str) -> ForceMatrix:
        """Return C of a model file. Raises RigctlError, also for another sensor's."""
        from rigctl.session.analysis_file import load_force

        force, _ = load_force(typed_path(path), self._data.reading)
        n_taxels = force.c.shape[1]
        if n_taxels != len(self._data.low):
            raise WrongUse(f"C of {path} is for {n_taxels} taxels")
        return force

    def _take(self, found: ForceMatrix | SensorPassport | None, problem: str = "") -> None:
        self._force = found if isinstance(found, ForceMatrix) else None
        self._passport = found if isinstance(found, SensorPassport) else None
        self._apply(problem)

    def _apply(self, problem: str = "") -> None:
        scaling, name = self.scaling.currentData(), self.preset.currentData()
        scale, gain_of, words = None, None, "without C"
        if scaling != NO_C and not problem:
            try:
                if scaling in GAINS:
                    kind = ForceScaling(scaling)
                    gain_of, words = self._gain_of(kind), GAINS[kind]
                else:
                    scale, words = self._scale(scaling)
            except WrongUse as error:
                problem = str(error)
        is_plain = scale is None and gain_of is None
        if name == ENGINE and is_plain and not self._data.has_own_range:
            self._data.history.recode = None
            text = "The spikes are the engine's."
        else:
            reading = self._data.reading
            parameters = replace(preset("default" if name == ENGINE else name), reading=reading)
            ranges = _ranges(self._data.low, self._data.high, reading)
            inputs = self._data.history.inputs
            self._data.history.recode = Recoder(ranges, parameters, scale, inputs, gain_of)
            of = "" if reading is Reading.COUNTS else f" of the {reading}"
            chosen = f"encoder {parameters.name}{of}, {words}"
            text = f"From here on {chosen}; the record stays as it is."
        show_text(self.sentence, f"{text} {problem}".strip())
        self.changed.emit(text)

    def _gain_of(self, scaling: ForceScaling) -> GainOf | None:
        """Return what gives the gain for taxel ranges. Raises WrongUse without a passport."""
        if scaling is ForceScaling.CALIBRATED and self._passport is None:
            raise WrongUse("name the sensor.json that rigctl calibrate sensor wrote")
        return gain_source(scaling, self._passport, self._data.reading)

    def _scale(self, scaling: str) -> tuple[NDArray[np.float64], str]:
        """Return C of the present condition, and words. Raises WrongUse without one."""
        if scaling == TYPED:
            c = self.c.value()
            return np.full(len(self._data.low), c), f"C = {c:g} for all taxels"
        if self._force is None:
            raise WrongUse("name a model file that has C")
        plate, speed_mm_s, force_g = self._condition
        if scaling == OF_PLATE:
            return self._force.c_at(plate, speed_mm_s, force_g), f"C of plate {plate}"
        return self._force.texture_blind(speed_mm_s, force_g), "C blind to the plate"


def _ranges(low: NDArray[np.float64], high: NDArray[np.float64], reading: Reading) -> Normalisation:
    limits = low.astype(np.uint16), high.astype(np.uint16)
    return Normalisation(*limits, "range of the live views", reading)
