"""Drum, taxels, finger and trackers as a scientist names them; their bytes and ports."""
