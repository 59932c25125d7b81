"""Panels that open sessions, run analyses and show results."""
