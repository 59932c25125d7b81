"""Figures of results: curves and confusion matrices that can be read, pictures that stay sharp."""
