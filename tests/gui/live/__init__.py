"""Tests of the window: samples as they come, and replayed."""
