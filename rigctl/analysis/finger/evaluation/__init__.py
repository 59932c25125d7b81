"""Measurements beyond the paper: evidence, kept promises, force invariance, profiles."""
