"""Firmware onto boards: their bootloaders, the programs that write, and the steps of a flash."""
