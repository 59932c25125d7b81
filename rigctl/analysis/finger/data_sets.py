"""Data sets of the real-time experiment: a training session and a later one that is tested."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.analysis.finger.scans import ScanSet
from rigctl.errors import WrongUse
from rigctl.protocol.finger import Stage


@dataclass(frozen=True, slots=True)
class FingerDataSet:
    """The scans of one data set: a training session, and calibration and run of a later one."""

    name: str
    training: ScanSet
    calibration: ScanSet
    tested: ScanSet

    @classmethod
    def from_sessions(cls, name: str, first: ScanSet, new: ScanSet) -> FingerDataSet:
        """Return the data set of two sessions, by their stages train, calibrate and run.

        Raises :class:`WrongUse` for a missing stage, or other textures in a later stage.
        """
        parts = (
            first.of_stage(Stage.TRAIN),
            new.of_stage(Stage.CALIBRATE),
            new.of_stage(Stage.RUN),
        )
        for part in parts[1:]:
            if part.textures != parts[0].textures:
                raise WrongUse(
                    f"{new.session} has the textures {', '.join(part.textures)}, {first.session} "
                    f"{', '.join(parts[0].textures)}: pair sessions of one protocol"
                )
        return cls(name, *parts)

    @property
    def textures(self) -> tuple[str, ...]:
        """Names of the textures, sorted."""
        return self.training.textures
