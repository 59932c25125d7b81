"""Identify the unknown parameters of the simulated bench; see decision 0018."""
