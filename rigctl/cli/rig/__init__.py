"""Commands that drive a rig, find its ports, calibrate it or judge it."""
