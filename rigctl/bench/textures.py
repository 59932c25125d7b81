"""The printed textures as height profiles along the travel: 16, and those of a world file.

A is smooth, B–F are circular ridges, G–K rectangular ridges, L–P waves; within a group: base,
double height, double space, half height, half space. Heights and spacings are not published:
they are parameters of the world.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.parameters import WorldParameters
from rigctl.errors import WrongUse

GRID_MM = 0.05
"""Spacing of the height tables."""

OVERHANG_MM = 10.0
"""Length of the print beyond the positions at which trials begin and end."""

Values = TypeVar("Values", NDArray[np.float32], NDArray[np.float64])


class Texture(NamedTuple):
    """One plate: its group, and its height and spacing relative to those of the base.

    A ``ridge_share`` of 0 stands for the world's common value.
    """

    name: str
    group: str
    height: float
    space: float
    ridge_share: float = 0.0


_VARIATIONS = ((1.0, 1.0), (2.0, 1.0), (1.0, 2.0), (0.5, 1.0), (1.0, 0.5))
_GROUPS = (("circular ridges", "BCDEF"), ("rectangular ridges", "GHIJK"), ("waves", "LMNOP"))

_RELATIVE = {2.0: "double", 0.5: "half"}

CATALOGUE: dict[str, Texture] = {"A": Texture("A", "smooth", 0.0, 1.0)} | {
    letter: Texture(letter, group, height, space)
    for group, letters in _GROUPS
    for letter, (height, space) in zip(letters, _VARIATIONS, strict=True)
}


def find_texture(name: str, parameters: WorldParameters) -> Texture:
    """Return a plate, the world's own one if it defines it. Raises WrongUse for an unknown name."""
    own = next((plate for plate in parameters.plates if plate.name == name), None)
    if own is None:
        if name not in CATALOGUE:
            raise WrongUse(
                f"no plate {name!r}: the catalogue has A to P, a world file adds others by "
                "[plates.NAME]"
            )
        return CATALOGUE[name]
    height = own.height_mm / parameters.base_height_mm if own.group != "smooth" else 0.0
    return Texture(
        name, own.group, height, own.space_mm / parameters.base_space_mm, own.ridge_share
    )


def plate_names(parameters: WorldParameters) -> tuple[str, ...]:
    """Return the names of the catalogue's plates and of those that the world adds."""
    return tuple(dict.fromkeys((*CATALOGUE, *(plate.name for plate in parameters.plates))))


def describe(plate: Texture, parameters: WorldParameters | None) -> str:
    """Return the texture of a plate in a few words.

    Without a world nobody knows its sizes: they are then relative to the base of the group.
    """
    if plate.group == "smooth":
        return plate.group
    if parameters is not None:
        height_mm = parameters.base_height_mm * plate.height
        space_mm = parameters.base_space_mm * plate.space
        return f"{plate.group}, {height_mm:g} mm high, every {space_mm:g} mm"
    sizes = {"height": plate.height, "spacing": plate.space}
    relative = [f"{_RELATIVE[size]} {name}" for name, size in sizes.items() if size in _RELATIVE]
    return ", ".join((plate.group, *relative))


def printed_heights(
    plate: Texture, along_mm: NDArray[np.float64], parameters: WorldParameters
) -> NDArray[np.float64]:
    """Return the printed height over the plate's base, mm, at distances from the plate's start."""
    height_mm = parameters.base_height_mm * plate.height
    phase = along_mm / (parameters.base_space_mm * plate.space) % 1.0
    share = plate.ridge_share or parameters.ridge_share
    across = 2.0 * phase / share - 1.0  # -1 … 1 over a ridge
    on_ridge = np.abs(across) <= 1.0
    if plate.group == "circular ridges":
        return height_mm * np.sqrt(np.where(on_ridge, 1.0 - across**2, 0.0))
    if plate.group == "rectangular ridges":
        return height_mm * on_ridge.astype(np.float64)
    if plate.group == "waves":
        return height_mm * 0.5 * (1.0 - np.cos(2.0 * np.pi * phase))
    if plate.group == "smooth":
        return np.zeros_like(along_mm)
    raise ValueError(f"no shape is known of the group {plate.group!r}")


def drum_heights(
    plate: Texture, parameters: WorldParameters
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the heights around the whole drum at :data:`GRID_MM`, mm, and the plate's mask.

    The print extends beyond both ends of the plate's travel, so that it supports the whole length
    of the sensor at either end.
    """
    cells = round(parameters.circumference_mm / GRID_MM)
    along_mm = np.arange(cells, dtype=np.float64) * GRID_MM - parameters.plate_start_mm
    turn_mm = parameters.circumference_mm
    within_mm = (along_mm + OVERHANG_MM) % turn_mm
    on_plate = within_mm < parameters.plate_length_mm + 2.0 * OVERHANG_MM
    heights = printed_heights(plate, within_mm - OVERHANG_MM, parameters)
    # A plate is printed once: its roughness does not depend on the session's seed.
    print_noise = np.random.Generator(np.random.Philox(int.from_bytes(plate.name.encode())))
    heights += parameters.print_roughness_mm * print_noise.standard_normal(cells)
    return heights, on_plate


def odd_cell_count(width_mm: float) -> int:
    """Return the odd number of cells that is nearest to a width."""
    return 2 * round(width_mm / GRID_MM / 2) + 1


def hann_window(width_mm: float) -> NDArray[np.float64]:
    """Return a Hann window."""
    return np.hanning(odd_cell_count(width_mm) + 2)[1:-1]


def gaussian_window(sigma_mm: float) -> NDArray[np.float64]:
    """Return a Gaussian window of four sigma to each side."""
    half = odd_cell_count(8.0 * sigma_mm) // 2
    along_mm: NDArray[np.float64] = np.arange(-half, half + 1, dtype=np.float64) * GRID_MM
    return np.exp(-0.5 * (along_mm / sigma_mm) ** 2)


def blur_circular(values: Values, *windows: NDArray[np.float64]) -> Values:
    """Convolve circularly along the last axis with centred windows, each scaled to unit sum."""
    size = values.shape[-1]
    spectrum: NDArray[Any] = np.fft.rfft(values)
    for window in windows:
        kernel = np.zeros(size)
        kernel[: window.size] = window / window.sum()
        kernel = np.roll(kernel, -(window.size // 2))
        spectrum *= np.fft.rfft(kernel).astype(spectrum.dtype)
    return np.fft.irfft(spectrum, size).astype(values.dtype)
