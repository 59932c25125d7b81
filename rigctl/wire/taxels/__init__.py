"""Frames of the taxel board: bytes to samples, status and self-test."""
