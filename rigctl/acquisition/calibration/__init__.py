"""Calibration of load cell, force loop, imbalance and wiring, by any client."""
