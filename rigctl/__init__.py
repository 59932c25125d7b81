"""Drum, taxels and spikes: acquisition and analysis for a tactile texture rig."""

__version__ = "0.1.0"
