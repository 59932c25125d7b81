"""Checks that values are ones that a rig can record: ranges, known codes, times that ascend."""
