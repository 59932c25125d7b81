"""The 16 printed textures as height profiles along the travel.

A is smooth, B–F circular ridges, G–K rectangular ridges, L–P waves; within a group: base,
double height, double space, half height, half space. Heights and spacings are not published:
they are parameters of the world.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import WrongUse
from rigctl.world.parameters import WorldParameters

GRID_MM = 0.05
"""Spacing of the height tables."""

FOOTPRINT_TAXELS = 3


class Texture(NamedTuple):
    """One plate: its group and its height and spacing over those of the base.

    ``ridge_share`` is 0 where that of all plates holds.
    """

    name: str
    group: str
    height: float
    space: float
    ridge_share: float = 0.0


_VARIATIONS = ((1.0, 1.0), (2.0, 1.0), (1.0, 2.0), (0.5, 1.0), (1.0, 0.5))
_GROUPS = (("circular ridges", "BCDEF"), ("rectangular ridges", "GHIJK"), ("waves", "LMNOP"))

CATALOGUE: dict[str, Texture] = {"A": Texture("A", "smooth", 0.0, 1.0)} | {
    letter: Texture(letter, group, height, space)
    for group, letters in _GROUPS
    for letter, (height, space) in zip(letters, _VARIATIONS, strict=True)
}


class HeightTables(NamedTuple):
    """Heights along one turn at :data:`GRID_MM`, mm over the plate's mean; each float64 (n,).

    ``top``, ``bottom``: as felt by a taxel of that layer; ``footprint``: mean under the sensor.
    """

    top: NDArray[np.float64]
    bottom: NDArray[np.float64]
    footprint: NDArray[np.float64]


def texture(name: str, parameters: WorldParameters) -> Texture:
    """One plate, the lab's own where it has one. Raises WrongUse for a name not ``A``–``P``."""
    if name not in CATALOGUE:
        raise WrongUse(f"no plate {name!r}: the catalogue has A to P")
    own = next((plate for plate in parameters.plates if plate.name == name), None)
    if own is None:
        return CATALOGUE[name]
    height = own.height_mm / parameters.base_height_mm if own.group != "smooth" else 0.0
    return Texture(
        name, own.group, height, own.space_mm / parameters.base_space_mm, own.ridge_share
    )


def profile(
    plate: Texture, along_mm: NDArray[np.float64], parameters: WorldParameters
) -> NDArray[np.float64]:
    """Printed height over the plate's ground, mm, at places from the plate's start."""
    height_mm = parameters.base_height_mm * plate.height
    phase = along_mm / (parameters.base_space_mm * plate.space) % 1.0
    share = plate.ridge_share or parameters.ridge_share
    across = 2.0 * phase / share - 1.0  # -1 … 1 over a ridge
    on_ridge = np.abs(across) <= 1.0
    if plate.group == "circular ridges":
        return height_mm * np.sqrt(np.where(on_ridge, 1.0 - across**2, 0.0))
    if plate.group == "rectangular ridges":
        return height_mm * on_ridge.astype(np.float64)
    return height_mm * 0.5 * (1.0 - np.cos(2.0 * np.pi * phase))


def height_tables(plate: Texture, parameters: WorldParameters, seating_mm: float) -> HeightTables:
    """What skin and contact feel of a plate around the whole drum, snapped in so far forward."""
    heights = _around(plate, parameters, seating_mm)
    taxel = _window_hann(parameters.taxel_size_mm)
    sensor = np.ones(_cells(FOOTPRINT_TAXELS * parameters.taxel_pitch_mm))
    felt = _blurred(heights, taxel)
    return HeightTables(
        _blurred(felt, _window_gauss(parameters.top_blur_mm)),
        _blurred(felt, _window_gauss(parameters.bottom_blur_mm)),
        _blurred(heights, sensor),
    )


def _around(plate: Texture, parameters: WorldParameters, seating_mm: float) -> NDArray[np.float64]:
    cells = round(parameters.circumference_mm / GRID_MM)
    along_mm = np.arange(cells, dtype=np.float64) * GRID_MM - parameters.plate_start_mm
    on_plate = (along_mm >= 0.0) & (along_mm < parameters.plate_length_mm)
    heights = profile(plate, along_mm + seating_mm, parameters)
    # A plate is printed once: its roughness is its own, whatever the seed of the session.
    print_noise = np.random.Generator(np.random.Philox(ord(plate.name)))
    heights += parameters.print_roughness_mm * print_noise.standard_normal(cells)
    # Heights count from the plate's mean, so that every plate touches at the same travel.
    return np.where(on_plate, heights - heights[on_plate].mean(), 0.0)


def _cells(width_mm: float) -> int:
    return 2 * round(width_mm / GRID_MM / 2) + 1


def _window_hann(width_mm: float) -> NDArray[np.float64]:
    return np.hanning(_cells(width_mm) + 2)[1:-1]


def _window_gauss(sigma_mm: float) -> NDArray[np.float64]:
    half = _cells(8.0 * sigma_mm) // 2
    along_mm: NDArray[np.float64] = np.arange(-half, half + 1, dtype=np.float64) * GRID_MM
    return np.exp(-0.5 * (along_mm / sigma_mm) ** 2)


def _blurred(heights: NDArray[np.float64], window: NDArray[np.float64]) -> NDArray[np.float64]:
    """Circular convolution with a centred window of unit sum."""
    kernel = np.zeros_like(heights)
    kernel[: window.size] = window / window.sum()
    kernel = np.roll(kernel, -(window.size // 2))
    spectrum = np.fft.rfft(heights) * np.fft.rfft(kernel)
    blurred: NDArray[np.float64] = np.fft.irfft(spectrum, heights.size)
    return blurred
