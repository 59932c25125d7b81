"""Measure the texts of the window against the places that they have."""
