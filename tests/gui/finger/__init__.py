"""Tests of the window: the moving finger."""
