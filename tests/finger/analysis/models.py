"""A trained and calibrated model of made-up scans."""

from __future__ import annotations

from rigctl.finger.analysis.classifier import calibrate_finger_model, train_finger_model
from rigctl.finger.analysis.scans import FingerDataSet, FingerEncoding
from rigctl.finger.model_file import FingerModel
from rigctl.finger.values import ScanKind
from rigctl.session.model_file import TrainingInfo
from tests.finger.analysis.made_scans import RANGES

ENCODING = FingerEncoding(RANGES, sensor="finger 1")
INFO = TrainingInfo("2030-01-01T00:00:00Z", "1", "", 0, True, 50, (), (), ({"path": "a"},))


def calibrated_model(
    data_set: FingerDataSet, kind: ScanKind = ScanKind.SPEED_SCALED, components: int = 25
) -> FingerModel:
    """Return the model of a data set."""
    model = train_finger_model(data_set.training, kind, ENCODING, INFO, components)
    return calibrate_finger_model(model, data_set.calibration)
