"""Polls, moves, settings and calibration of the drum."""
