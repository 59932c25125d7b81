"""Tests of the window, driven by clicks, without a display."""
