"""Figures and HTML pages of an analysis."""
