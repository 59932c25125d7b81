"""Tests of the window: protocols written, planned and run."""
