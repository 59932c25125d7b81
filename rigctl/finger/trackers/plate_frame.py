"""The plate's frame: a rigid transform from a tracker's frame, fitted to touched corners."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.config.toml_reader import TomlTable, TomlText
from rigctl.errors import ConfigError, RigFault
from rigctl.finger.values import PLATE_CORNERS_MM
from rigctl.values import Position

MAX_RESIDUAL_MM = 2.0
"""A corner farther from its place than this was touched wrongly."""
MIN_SPREAD_MM = 10.0
"""Root of the summed squares across the longest line; the corners of a plate have 36 mm."""
_FARTHEST_MM = 1e6
_LONGEST_AXIS = 1.0 + 1e-6
_AXES = ("along", "across", "height")

_Floats = NDArray[np.float64]
Vector = tuple[float, float, float]


class PlatePosition(NamedTuple):
    """A position on the plate in mm: along 0 to 300 from its start, across from its middle line
    with left positive, height above its surface.
    """

    at_s: float
    along_mm: float
    across_mm: float
    height_mm: float
    valid: bool


@dataclass(frozen=True, slots=True)
class PlateFrame:
    """Rigid transform: plate = ``rotation`` · tracker + ``offset_mm``.

    The rows of ``rotation`` are the plate's axes (along, across, height) in the tracker's frame.
    ``residual_mm``: largest distance of a touched corner from its place.
    """

    rotation: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    offset_mm: Vector = (0.0, 0.0, 0.0)
    residual_mm: float = 0.0

    def to_plate(self, position: Position) -> PlatePosition:
        """Return the position on the plate."""
        at_s, x, y, z, valid = position
        along, across, height = (
            row[0] * x + row[1] * y + row[2] * z + offset
            for row, offset in zip(self.rotation, self.offset_mm, strict=True)
        )
        return PlatePosition(at_s, along, across, height, valid)

    def to_toml(self) -> str:
        """Return the frame as text; :meth:`from_toml` returns an equal frame."""
        axes = zip(_AXES, self.rotation, strict=True)
        rows = "".join(f"{name} = {list(row)}\n" for name, row in axes)
        return (
            "# From the tracker's frame to the plate's: plate = rotation · tracker + offset.\n"
            f"[plate_frame]\n{rows}offset_mm = {list(self.offset_mm)}\n"
            f"residual_mm = {self.residual_mm!r}\n"
        )

    @classmethod
    def from_toml(cls, text: str, name: str = "plate frame") -> PlateFrame:
        """Return the frame in a text. Raises ConfigError where it is no rigid transform."""
        source = TomlText(name, text, ConfigError)
        table = source.root.table("plate_frame")
        rows = [_vector(table, key, _LONGEST_AXIS) for key in _AXES]
        offset_mm = _vector(table, "offset_mm", _FARTHEST_MM)
        residual_mm = table.number("residual_mm", 0.0, unit="mm", low=0.0, high=_FARTHEST_MM)
        table.finish()
        if not _is_rotation(np.array(rows)):
            source.fail(
                ("plate_frame",),
                "along, across and height are no right-handed axes of length 1: touch the "
                "corners again",
            )
        return cls((rows[0], rows[1], rows[2]), offset_mm, residual_mm)


def fit_plate_frame(touched: Sequence[tuple[str, Vector]]) -> PlateFrame:
    """Return the frame that brings touched corners nearest to their places (least squares).

    ``touched``: names of :data:`~rigctl.finger.values.PLATE_CORNERS_MM` with the tracker's
    position in mm; each corner at least once. Raises RigFault where a corner is missing or
    unknown, where the points lie on a line, and where one is more than 2 mm from its place.
    """
    _require_corners([name for name, _ in touched])
    names = [name for name, _ in touched]
    points = np.array([point for _, point in touched], dtype=np.float64)
    places = np.array([(*PLATE_CORNERS_MM[name], 0.0) for name in names])
    _require_spread(points)
    frame, residuals = _fit(points, places)
    if residuals.max() > MAX_RESIDUAL_MM:
        worst, away_mm = _misplaced(points, places)
        raise RigFault(
            f"plate calibration: the corners are up to {residuals.max():.1f} mm from their places; "
            f"{names[worst]!r} does not fit the others by {away_mm:.1f} mm: touch it again"
        )
    return frame


def _vector(table: TomlTable, key: str, largest: float) -> Vector:
    x, y, z = table.vector(key, 3, low=-largest, high=largest)
    return x, y, z


def _is_rotation(matrix: _Floats) -> bool:
    return bool(np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6) and np.linalg.det(matrix) > 0)


def _require_corners(names: Sequence[str]) -> None:
    for name in names:
        if name not in PLATE_CORNERS_MM:
            known = ", ".join(PLATE_CORNERS_MM)
            raise RigFault(f"plate calibration: there is no corner {name!r}: touch {known}")
    missing = [name for name in PLATE_CORNERS_MM if name not in names]
    if missing:
        raise RigFault(f"plate calibration: touch also the corner {missing[0]!r}")


def _require_spread(points: _Floats) -> None:
    if not np.isfinite(points).all():
        raise RigFault("plate calibration: a touched corner has no position: touch it again")
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] < MIN_SPREAD_MM:
        raise RigFault(
            "plate calibration: the touched corners lie on a line or in one place: touch the four "
            "corners of the plate, and check that the tracker moves with the finger"
        )


def _fit(points: _Floats, places: _Floats) -> tuple[PlateFrame, _Floats]:
    """Return the frame of least squares and the distance of each point from its place in mm."""
    from scipy.spatial.transform import Rotation

    with warnings.catch_warnings():
        # Without one corner the others may lie on a line: their residuals show it.
        warnings.simplefilter("ignore", UserWarning)
        rotation, _ = Rotation.align_vectors(
            places - places.mean(axis=0), points - points.mean(axis=0)
        )
    matrix = rotation.as_matrix()
    offset = places.mean(axis=0) - matrix @ points.mean(axis=0)
    residuals: _Floats = np.linalg.norm(points @ matrix.T + offset - places, axis=1)
    rows = [(float(x), float(y), float(z)) for x, y, z in [*matrix, offset]]
    return PlateFrame((rows[0], rows[1], rows[2]), rows[3], float(residuals.max())), residuals


def _misplaced(points: _Floats, places: _Floats) -> tuple[int, float]:
    """Return the point without which the others fit best, and its distance from their frame."""
    fits = []
    for left_out, (point, place) in enumerate(zip(points, places, strict=True)):
        others = np.arange(len(points)) != left_out
        frame, residuals = _fit(points[others], places[others])
        moved = np.array(frame.rotation) @ point + np.array(frame.offset_mm)
        away_mm = float(np.linalg.norm(moved - place))
        fits.append((float(residuals.max()), left_out, away_mm))
    _, worst, away_mm = min(fits)
    return worst, away_mm
