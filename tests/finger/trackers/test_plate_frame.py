"""The plate's frame from touched corners: exact for a rigid transform, and honest for bad ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rigctl.errors import ConfigError, RigFault
from rigctl.finger.trackers.plate_frame import PlateFrame, fit_plate_frame
from rigctl.finger.values import PLATE_CORNERS_MM
from rigctl.values import Position

Touched = list[tuple[str, tuple[float, float, float]]]


def touch(rotation: Rotation, offset: np.ndarray, noise_mm: float = 0.0, seed: int = 1) -> Touched:
    """The tracker's positions while the finger touches the corners."""
    noise = np.random.default_rng(seed).normal(0.0, 1.0, (4, 3)) * noise_mm
    places = np.array([(*place, 0.0) for place in PLATE_CORNERS_MM.values()])
    points = rotation.inv().apply(places - offset) + noise
    return [(name, tuple(map(float, p))) for name, p in zip(PLATE_CORNERS_MM, points, strict=True)]


TILTED = Rotation.from_euler("xyz", [20, -110, 65], degrees=True)
FAR = np.array([1200.0, -300.0, 900.0])
angles = st.floats(-180, 180)


@settings(max_examples=50, deadline=None)
@given(st.tuples(angles, angles, angles), st.tuples(*[st.floats(-5000, 5000)] * 3))
def test_touched_corners_give_the_frame_back(
    euler: tuple[float, float, float], offset: tuple[float, float, float]
) -> None:
    rotation = Rotation.from_euler("xyz", euler, degrees=True)
    frame = fit_plate_frame(touch(rotation, np.array(offset)))
    inside = rotation.inv().apply(np.array([123.0, -7.0, 4.0]) - np.array(offset))
    on_plate = frame.to_plate(Position(5.0, *map(float, inside), valid=True))
    assert on_plate.at_s == 5.0 and on_plate.valid
    assert on_plate[1:4] == pytest.approx((123.0, -7.0, 4.0), abs=1e-6)
    assert frame.residual_mm < 1e-6
    assert PlateFrame.from_toml(frame.to_toml()) == frame


def test_noise_of_the_touches_stays_in_the_residual() -> None:
    frame = fit_plate_frame(touch(TILTED, FAR, noise_mm=0.3) + touch(TILTED, FAR, 0.3, seed=2))
    assert 0.05 < frame.residual_mm < 2.0


@pytest.mark.parametrize("name", PLATE_CORNERS_MM)
def test_a_corner_that_was_touched_wrongly_is_named(name: str) -> None:
    touched = [
        (corner, (x, y + 12.0 * (corner == name), z)) for corner, (x, y, z) in touch(TILTED, FAR)
    ]
    with pytest.raises(RigFault, match=rf"'{name}' does not fit the others by \d+\.\d mm: touch"):
        fit_plate_frame(touched)


def test_corners_without_spread_missing_or_unknown_are_refused() -> None:
    touched = touch(TILTED, FAR)
    with pytest.raises(RigFault, match="touch also the corner 'end right'"):
        fit_plate_frame(touched[:3])
    with pytest.raises(RigFault, match="there is no corner 'middle': touch start left"):
        fit_plate_frame([*touched, ("middle", (0.0, 0.0, 0.0))])
    for points in ([(0.0, 0.0, 0.0)] * 4, [(float(i), 2.0 * i, 0.0) for i in range(0, 400, 100)]):
        with pytest.raises(RigFault, match="lie on a line or in one place"):
            fit_plate_frame(list(zip(PLATE_CORNERS_MM, points, strict=True)))
    with pytest.raises(RigFault, match="a touched corner has no position"):
        fit_plate_frame([*touched[:3], ("end right", (float("nan"), 0.0, 0.0))])


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("along = [1.0,", "along = [0.9,", "no right-handed axes of length 1"),
        ("height = [0.0, 0.0, 1.0]", "height = [0.0, 0.0, -1.0]", "no right-handed axes"),
        ("offset_mm = [0.0, 0.0, 0.0]", "offset_mm = [0.0]", "offset_mm: must be a list of 3"),
        ("residual_mm", "residue_mm", "unknown key"),
    ],
)
def test_a_text_that_is_no_frame_is_refused(old: str, new: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        PlateFrame.from_toml(PlateFrame().to_toml().replace(old, new), "plate.toml")
