"""Spike trains on the screen: raster, rates, and the order of their rows."""
