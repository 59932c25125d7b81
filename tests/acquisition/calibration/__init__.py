"""Tests of the calibrations."""
