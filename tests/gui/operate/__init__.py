"""Tests of the window: a rig driven by hand, set up and calibrated."""
