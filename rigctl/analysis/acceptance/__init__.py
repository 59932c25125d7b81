"""Measurements and limits that say whether a rig is accepted."""
