"""Byte links to a board: serial port, TCP."""
