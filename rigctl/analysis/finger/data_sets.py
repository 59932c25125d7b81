"""Data sets of the real-time experiment: a training session and a later one that is tested."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.analysis.finger.scans import ScanSet
from rigctl.errors import WrongUse
from rigctl.protocol.finger import Stage

LEAST_COMMON = 0.5
"""Share of the textures that all stages must have; the others are left out."""


@dataclass(frozen=True, slots=True)
class FingerDataSet:
    """The scans of one data set: a training session, and calibration and run of a later one.

    ``remarks``: textures that were left out, because a stage lacks them.
    """

    name: str
    training: ScanSet
    calibration: ScanSet
    tested: ScanSet
    remarks: tuple[str, ...] = ()

    @classmethod
    def from_sessions(cls, name: str, first: ScanSet, new: ScanSet) -> FingerDataSet:
        """Return the data set of two sessions, by their stages train, calibrate and run.

        Textures that a stage lacks are left out. Raises :class:`WrongUse` for a missing stage, or
        where most textures are not in all stages.
        """
        parts = (
            first.of_stage(Stage.TRAIN),
            new.of_stage(Stage.CALIBRATE),
            new.of_stage(Stage.RUN),
        )
        common = common_textures([part.textures for part in parts])
        if common is None:
            other = next(part for part in parts[1:] if part.textures != parts[0].textures)
            raise WrongUse(
                f"{new.session} has the textures {', '.join(other.textures)}, {first.session} "
                f"{', '.join(parts[0].textures)}: pair sessions of one protocol"
            )
        return cls(name, *parts).of_textures(common)

    @property
    def textures(self) -> tuple[str, ...]:
        """Names of the textures, sorted."""
        return self.training.textures

    def of_textures(self, textures: Sequence[str]) -> FingerDataSet:
        """Return the scans of some textures, with a remark on the others."""
        parts = (self.training, self.calibration, self.tested)
        left_out = sorted({name for part in parts for name in part.textures} - set(textures))
        if not left_out:
            return self
        remark = f"{self.name}: textures left out, which a stage lacks: {', '.join(left_out)}"
        training, calibration, tested = (part.of_textures(textures) for part in parts)
        return FingerDataSet(self.name, training, calibration, tested, (*self.remarks, remark))


def common_textures(each: Sequence[Sequence[str]]) -> tuple[str, ...] | None:
    """Return the textures that all stages or sets have, None where those are too few."""
    common = set(each[0]).intersection(*each[1:])
    every = set(each[0]).union(*each[1:])
    if len(common) < max(2.0, LEAST_COMMON * len(every)) and common != every:
        return None
    return tuple(sorted(common))
