"""Flash a Teensy with teensy_loader_cli; its image is the one that the Arduino IDE exports."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rigctl.config.intel_hex import Segments
from rigctl.devices.flashing.programs import TEENSY_LOADER, find_program, run_program
from rigctl.errors import LinkLost, WrongUse

MCU = "TEENSY40"
FLASH_BASE, FLASH_BYTES = 0x6000_0000, 2_031_616
"""Where the chip maps its external flash, and how much of it PJRC's core offers."""
BUTTON_S = 60.0
"""How long the person may take to press the button."""


def require_teensy_image(path: Path, image: Segments) -> None:
    """Raise WrongUse for an image that is not one for a Teensy 4.0."""
    end = image[-1][0] + len(image[-1][1])
    if image[0][0] < FLASH_BASE or end > FLASH_BASE + FLASH_BYTES:
        raise WrongUse(
            f"{path} is an image for another board: in the Arduino IDE select Teensy 4.0, then "
            "Sketch, Export Compiled Binary"
        )


async def write_teensy(path: Path, report: Callable[[str], None]) -> None:
    """Write an image. Raises WrongUse without the loader, LinkLost where no Teensy takes it."""
    command = [*find_program(TEENSY_LOADER), f"--mcu={MCU}", "-w", "-v", str(path)]
    report(f"press the button on the Teensy, within {BUTTON_S:g} s")

    def progressed(text: str) -> bool:
        is_found = "Found" in text or "Programming" in text
        if is_found:
            report("writing")
        return is_found

    done = await run_program(command, BUTTON_S, progressed)
    if done.exit_code != 0:
        last = (done.output.split("\n")[-2:] or [""])[0].strip()
        what = "no Teensy was found" if done.exit_code is None else f"the loader ended ({last})"
        raise LinkLost(
            f"{what}: connect the Teensy 4.0 by USB, press its button, and run the same command "
            "again"
        )
