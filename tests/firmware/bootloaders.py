"""The factory bootloaders of the boards, as Debian's arduino-core-avr has them."""

from pathlib import Path

FOLDER = Path("/usr/share/arduino/hardware/arduino/avr/bootloaders")
MEGA = FOLDER / "stk500v2/stk500boot_v2_mega2560.hex"
UNO = FOLDER / "optiboot/optiboot_atmega328.hex"
OLD_NANO = FOLDER / "atmega/ATmegaBOOT_168_atmega328.hex"
